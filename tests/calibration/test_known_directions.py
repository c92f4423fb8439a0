"""Six-position and recursive calibration."""

import csv
import json

import numpy as np
import pytest

from sensorbook.calibration import recursive, six_position
from sensorbook.calibration.known_directions import (
    face,
    recursion_history,
    turned_in_housing,
)
from sensorbook.calibration.positions import cut
from sensorbook.errors import Refusal

from .sets import BIAS, FACES, MATRIX, G, by_hand, rests

TRUE = np.r_[MATRIX[np.tri(3, dtype=bool)], BIAS]
SOLVERS = [six_position, recursive]
full = np.array([[1.01, 0.02, -0.01], [0.01, 0.99, 0.015], [-0.02, 0.005, 1.02]])


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize("data", ["means", "raw"])
def test_without_noise_the_truth_comes_out(solve, data):
    rng = np.random.default_rng(1)
    positions = rests(FACES, rng, white=1e-9, wander=0)
    np.testing.assert_allclose(
        solve(positions, FACES, G, data=data).values, TRUE, rtol=0, atol=1e-7
    )
    twelve = solve(rests(FACES, rng, matrix=full, white=1e-9, wander=0), FACES, G, 12, data)
    np.testing.assert_allclose(twelve.model.matrix, full, rtol=0, atol=1e-7)


@pytest.mark.parametrize("solve", SOLVERS)
def test_the_errors_are_those_that_are_stated_under_a_levelling_error(solve):
    """80 sets, each position level to 1°: intervals of nine parameters hold the truth."""
    covered = []
    for seed in range(80):
        rng = np.random.default_rng([seed, 2])
        fit = solve(rests(by_hand(FACES, 1.0, rng), rng), FACES, G)
        covered.append(np.abs(fit.values - TRUE) <= fit.interval_factor * fit.std)
    assert 0.90 <= np.mean(covered) <= 0.99


def test_bias_and_scale_come_from_the_axis_that_is_up():
    """Under a levelling error they are far better than in plain least squares (B 8 with P = I)."""
    weighted, plain = [], []
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        positions = rests(by_hand(FACES, 1.0, rng), rng)
        weighted.append(six_position(positions, FACES, G).model.bias - BIAS)
        plain.append(six_position(positions, FACES, G, data="raw").model.bias - BIAS)
    assert np.std(weighted) < np.std(plain) / 10


def test_recursion_ends_where_least_squares_is():
    rng = np.random.default_rng(4)
    positions = rests(by_hand(FACES, 0.1, rng), rng)
    a, b = six_position(positions, FACES, G), recursive(positions, FACES, G)
    # The inverse model weighs alike to first order: the difference is of the errors' square.
    assert np.abs((a.values - b.values) / a.std).max() < 0.5
    np.testing.assert_allclose(a.std, b.std, rtol=0.1)
    history = recursion_history(positions, FACES, G)
    assert history.shape == (6, 9)
    np.testing.assert_allclose(history[-1], b.values, rtol=0, atol=1e-12)


def test_twelve_where_the_sensor_is_turned_in_its_housing():
    rng = np.random.default_rng(5)
    square = rests(by_hand(FACES, 0.1, rng), rng)
    turned = rests(by_hand(FACES, 0.1, rng), rng, matrix=full)
    assert turned_in_housing(square, FACES, G) > 0.01
    assert turned_in_housing(turned, FACES, G) < 1e-3


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize(
    ("keep", "words"),
    [
        ([0, 1, 2, 3, 4], "Of the six positions z down is missing"),
        ([0, 2, 4], "z down, y down, x down are missing"),
        ([0, 0, 0, 0, 0, 0], "z up, z down, y up, y down, x down are missing"),
    ],
)
def test_missing_faces_are_named(solve, keep, words):
    rng = np.random.default_rng(6)
    with pytest.raises(Refusal) as caught:
        solve(rests(FACES[keep], rng), FACES[keep], G)
    assert words in caught.value.reason
    assert "Record a rest with" in caught.value.remedy


@pytest.mark.parametrize(
    ("label", "name"),
    [("z up (1.0–2.0 s)", "z up"), ("X_down", "x down"), ("y_p", "y up"), ("x_a", "x down"),
     ("+z", "z up"), ("-y", "y down")],
)  # fmt: skip
def test_labels_name_faces(label, name):
    assert face(label) == name


def test_a_label_that_names_none():
    with pytest.raises(KeyError):
        face("position 3")


@pytest.mark.parametrize("solve", SOLVERS)
def test_ferraris_session(solve, real_data):
    """Real faces labelled by hand; scale and bias as the recordings' README has them."""
    folder = real_data / "imucal-ferraris"
    with open(folder / "example_ferraris_session.csv") as file:
        rows = list(csv.DictReader(file))
    values = np.array([[float(r[f"acc_{a}"]) for a in "xyz"] for r in rows])
    marks = json.loads((folder / "example_ferraris_session_list.json").read_text())
    faces = [k for k in marks if "rot" not in k]
    time = np.arange(len(values)) / 102.4
    spans = [(marks[k]["start"] / 102.4, marks[k]["end"] / 102.4) for k in faces]
    positions = cut([(time, values, None)], [spans], [faces])
    up = np.array([{"p": 1, "a": -1}[k[2]] * np.eye(3)["xyz".index(k[0])] for k in faces])
    for parameters in (9, 12):
        model = solve(positions, up, G, parameters).model
        # README: 0.99675, 1.00244, 1.02340 and 0.537, −0.616, 0.399; the goals are 0.2 % and 0.005.
        np.testing.assert_allclose(np.diag(model.matrix), [0.99675, 1.00244, 1.02340], rtol=2e-3)
        np.testing.assert_allclose(model.bias, [0.537, -0.616, 0.399], rtol=0, atol=5e-3)
