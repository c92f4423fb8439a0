"""Figures of the static calibrations: what they draw, with labels and units."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.calibration import find_positions, multi_position
from sensorbook.calibration.known_directions import recursion_history, six_position
from sensorbook.calibration.model import IDEAL
from sensorbook.calibration.multi_position import (
    directions_of_rests,
    norm_errors,
    twelve_parameter_correlation,
)
from sensorbook.calibration.positions import FACES, Positions
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.plots import calibration as plots
from sensorbook.recordings.recording import Recording
from sensorbook.simulate.positions import EDGES, RATE, hand_moved
from sensorbook.simulate.positions import FACES as UP

G = 9.80665


@pytest.fixture(scope="module")
def moved():
    made = hand_moved(np.random.default_rng(3), (*UP, *EDGES), gravity=G)
    a, w = (
        Recording(s, "positions", "log.csv", made["t"], made[s], rate=RATE)
        for s in ("accelerometer", "gyroscope")
    )
    found = find_positions([a], [w], G)
    return a, found, multi_position(found.positions, G)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_rests_over_the_signal(moved):
    a, found, _ = moved
    signal, quiet = plots.plot_rests(found, a)
    assert signal.get_ylabel() == "accelerometer [m/s²]"
    assert quiet.get_xlabel() == "time [s]"
    assert quiet.get_yscale() == "log"
    for axes in (signal, quiet):
        assert len(axes.patches) == len(found.positions)
    names = [t.get_text() for t in quiet.get_legend().get_texts()]
    assert names == ["accelerometer", "gyroscope", "threshold", "rest"]
    # Long recordings are thinned, and no peak is lost.
    assert (
        max(line.get_ydata().max() for line in quiet.lines[:1]) == found.scatters[0][0].ratio.max()
    )
    assert len(signal.lines[0].get_xdata()) <= 2 * plots.MOST_POINTS


def test_sweep_marks_the_chosen(moved):
    _, found, _ = moved
    axes = plots.plot_sweep(found)
    assert axes.get_ylabel() == "rms of ‖a‖ − g [mm/s²]"
    chosen = axes.lines[-1]
    assert chosen.get_xdata()[0] == found.threshold
    counts = [int(t.get_text()) for t in axes.texts]
    assert counts == [n for _, n, r in found.sweep if r is not None]


def test_directions_on_two_half_spheres():
    directions = np.array([[0, 0, 1.0], [0, 0, -1.0], [1, 0, 0]])
    up, down = plots.plot_directions(directions)
    shown = {c.get_label(): len(c.get_offsets()) for c in up.collections}
    assert shown["position"] == 2  # the equator is on both
    assert {c.get_label(): len(c.get_offsets()) for c in down.collections}["position"] == 2
    assert shown["not covered"] > 0
    # Equal area: 45° from the pole is √(1 − cos 45°) of the radius.
    up, _ = plots.plot_directions(np.array([[np.sqrt(0.5), 0, np.sqrt(0.5)]]))
    place = next(c for c in up.collections if c.get_label() == "position").get_offsets()[0]
    assert place[0] == pytest.approx(np.sqrt(1 - np.sqrt(0.5)))


def test_norms_in_millimetres_a_second_squared(moved):
    _, found, fit = moved
    before = norm_errors(IDEAL, found.positions, G)
    left, right = plots.plot_norms(before, fit.residuals, fit.residuals * 2)
    np.testing.assert_allclose(left.lines[0].get_ydata(), 1000 * before)
    np.testing.assert_allclose(right.lines[1].get_ydata(), 1000 * fit.residuals)
    assert "[mm/s²]" in right.get_ylabel()


def test_histograms_share_a_scale():
    rng = np.random.default_rng(4)
    a, b = plots.plot_histograms(
        {"six_position": rng.normal(0, 0.1, 5000), "multi_position": rng.normal(0, 0.05, 5000)}
    )
    assert a.get_xlim() == b.get_xlim()
    # 5000 samples: 1 % at one sd.
    assert float(a.get_title().split()[2]) == pytest.approx(100, rel=0.05)
    assert a.get_title().endswith("mm/s²")


def test_parameters_with_intervals_and_truth(moved):
    _, _, fit = moved
    truth = {"matrix": np.eye(3).tolist(), "bias": [0, 0, 0]}
    bias, scale, angles = plots.plot_parameters([fit], truth)
    assert bias.get_ylabel() == "bias [m/s²]"
    assert scale.get_ylabel() == "scale factor error [%]"
    assert [t.get_text() for t in angles.get_xticklabels()] == ["yx", "zx", "zy"]
    drawn = bias.containers[0].lines[0].get_ydata()
    assert drawn[0] == pytest.approx(fit.model.bias[0])
    low, high = (
        bias.containers[0].lines[1][0].get_ydata(),
        bias.containers[0].lines[1][1].get_ydata(),
    )
    assert (high - low)[0] == pytest.approx(2 * fit.interval_factor * fit.std_of("bias")[0])


def test_correlation(moved):
    _, found, fit = moved
    names, correlation = twelve_parameter_correlation(fit, found.positions)
    axes = plots.plot_correlation(names, correlation)
    assert [t.get_text() for t in axes.get_xticklabels()][:2] == ["M xx", "M xy"]
    np.testing.assert_array_equal(axes.images[0].get_array(), correlation)


def test_turns_in_degrees():
    ones = np.ones(4)
    axes = plots.plot_turns(0.1 * ones, 0.01 * ones, 0.02 * ones, np.arange(4.0))
    assert axes.get_xlabel() == "angle turned [°]"
    by_name = {line.get_label(): line.get_ydata()[0] for line in axes.lines}
    assert by_name["nominal scale"] == pytest.approx(np.degrees(0.1))
    assert by_name["held out"] == pytest.approx(np.degrees(0.02))


def test_rest_readings(moved):
    _, found, fit = moved
    felt = fit.model.correct(found.positions.means)
    rests = fit_rests(found.gyroscope, felt, 39.89)
    axes = plots.plot_rest_readings(found.gyroscope.means, felt, rests)
    assert [a.get_title() for a in axes] == ["x", "y", "z"]
    assert axes[0].get_ylabel() == "reading at rest − bias [°/s]"
    expected = np.degrees(felt @ rests.g_sensitivity.T)[:, 1]
    np.testing.assert_allclose(axes[1].lines[0].get_xdata(), expected)


def levelled():
    rng = np.random.default_rng(5)
    up = np.array(list(FACES.values()), dtype=float)
    samples = tuple(G * u + 0.01 * rng.standard_normal((200, 3)) for u in up)
    spans = 10.0 * np.arange(6)[:, None] + [0.0, 2.0]
    names = tuple(f"{n} (0.0–2.0 s)" for n in FACES)
    return Positions(samples, spans, names, np.zeros(6, dtype=int)), up


def test_levelling_and_recursion():
    faces, up = levelled()
    fit = six_position(faces, up, G)
    across, along = plots.plot_levelling(faces, up, fit)
    assert [t.get_text() for t in across.get_xticklabels()] == list(FACES)
    assert sum(len(line.get_xdata()) for line in across.lines[:3]) == 12
    assert sum(len(line.get_xdata()) for line in along.lines[:3]) == 6
    history = recursion_history(faces, up, G)
    bias, scale = plots.plot_recursion(history, fit.parameters)
    assert scale.lines[0].get_ydata()[-1] == pytest.approx(
        100 * (fit.model.matrix[0, 0] - 1), abs=1e-3
    )
    assert bias.get_ylabel() == "bias [mm/s²]"
    shown = np.concatenate([line.get_ydata() for line in scale.lines])
    assert np.nanmax(np.abs(shown)) < 20  # what is not known yet is left out


def test_directions_of_rests_are_unit_vectors(moved):
    _, found, _ = moved
    directions = directions_of_rests(found.positions, G)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
