"""Sun sensors: cells and slits, forward and back, range, standard errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensorbook.attitude.sensors.sun import (
    SlitSensor,
    cell_angle,
    cell_currents,
    four_cell_direction,
    four_normals,
    pair_angle,
    pair_normals,
)

TILT = np.radians(45)
SLIT = SlitSensor(10e-3, 7e-6, 2048)


def in_plane(angle):
    angle = np.asarray(angle)
    return np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)


def sphere(count, seed):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@given(st.floats(0.01, 1.5))
def test_one_cell_has_two_answers(angle):
    current = cell_currents(in_plane([angle, -angle]), [[0, 0, 1.0]], 2.0)[:, 0]
    found = cell_angle(current, 2.0)
    assert found.angle == pytest.approx([angle, angle], abs=1e-9)
    assert found.both[0] == pytest.approx([angle, -angle], abs=1e-9)
    assert "cone" in found.ambiguity


def test_one_cell_in_the_dark_and_too_bright():
    found = cell_angle([0.0, 0.5, 1.2, np.nan], 1.0, 1e-3)
    assert [r[:20] for r in found.reasons] == [
        "the cell is dark: th", "", "the current is above", "a reading is no fini",
    ]  # fmt: skip
    assert np.isnan(found.angle[[0, 2, 3]]).all()
    assert found.std[1] == pytest.approx(1e-3 / np.sin(np.arccos(0.5)))


@given(st.floats(-0.78, 0.78), st.floats(0.1, 10))
def test_pair_round_trip(angle, full):
    currents = cell_currents(in_plane(angle), pair_normals(TILT), full)
    assert currents[0] - currents[1] == pytest.approx(
        2 * full * np.sin(TILT) * np.sin(angle), abs=1e-12 * full
    )
    assert pair_angle(currents, TILT, full).angle == pytest.approx(angle, abs=1e-9)


def test_pair_out_of_range():
    found = pair_angle(
        cell_currents(in_plane([0.5, 0.9, -0.9, 3.0]), pair_normals(TILT)), TILT, 1.0
    )
    assert found.reasons[0] == ""
    assert all("a cell is dark" in r for r in found.reasons[1:])
    assert np.isnan(found.angle[1:]).all()


def test_four_cells_are_exact_where_lit_and_never_wrong():
    sun = sphere(5000, 1)
    for full in (1.0, 3.7):
        found = four_cell_direction(cell_currents(sun, four_normals(TILT), full), TILT)
        lit = (sun @ four_normals(TILT).T > 0).all(axis=1)
        assert ((found.reasons == "") == lit).all()
        assert 0.1 < lit.mean() < 0.3
        assert np.abs(found.direction - sun)[lit].max() < 1e-12
        assert np.isnan(found.direction[~lit]).all()


def test_four_cells_with_noise_never_wrong():
    """Anywhere on the sphere: what is not refused is right within noise."""
    sun, sigma = sphere(5000, 2), 1e-3
    noise = np.random.default_rng(3).normal(0, sigma, (5000, 4))
    lit = cell_currents(sun, four_normals(TILT))
    found = four_cell_direction(lit + noise, TILT, sigma)
    taken = found.reasons == ""
    assert (np.abs(found.direction - sun)[taken] < 0.02).all()


def test_four_cells_refuse_a_shadow():
    currents = cell_currents([0.1, 0.1, 1.0], four_normals(TILT))
    currents[2] *= 0.8
    assert "sums disagree" in four_cell_direction(currents, TILT).reasons.item()
    assert "sums disagree" in four_cell_direction(currents, TILT, 1e-3).reasons.item()


def test_four_cells_covariance():
    true = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    noise = np.random.default_rng(4).normal(0, 1e-3, (10_000, 4))
    found = four_cell_direction(cell_currents(true, four_normals(TILT)) + noise, TILT, 1e-3)
    error = found.direction - true
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(found.covariance, 1e-6), error).mean()
    assert nees == pytest.approx(2, rel=0.03)
    assert np.sqrt((error**2).sum(axis=1).mean() / 2) == pytest.approx(found.std.mean(), rel=0.03)


def test_slit_angles_are_c_3_4():
    found = SLIT.direction([[1023.5 + 300, 1023.5 - 500]])
    tangents = np.array([300, -500]) * 7e-6 / 10e-3
    assert found.direction[0] == pytest.approx(
        np.array([1, *tangents]) / np.linalg.norm([1, *tangents])
    )
    assert np.tan(SLIT.angles([1323.5, 523.5])) == pytest.approx(tangents)


def test_slit_round_trip_within_a_pixel():
    tangents = np.random.default_rng(5).uniform(-0.7, 0.7, (10_000, 2))
    sun = np.column_stack([np.ones(10_000), tangents])
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    found = SLIT.direction(SLIT.read(sun))
    assert (found.reasons == "").all()
    off = np.tan(SLIT.angles(SLIT.read(sun))) - tangents
    assert np.abs(off).max() <= 0.5 * 7e-6 / 10e-3 * (1 + 1e-9)
    # Uniform: a pixel over √12, known to 1 % from 10⁴ samples.
    assert off.std() == pytest.approx(7e-6 / 10e-3 / np.sqrt(12), rel=0.02)
    assert SLIT.quantisation == pytest.approx(7e-6 / 10e-3 / np.sqrt(12))
    error = found.direction - sun
    assert np.sqrt((error**2).sum(axis=1).mean()) == pytest.approx(
        np.sqrt(2 * (found.std**2).mean()), rel=0.02
    )


def test_slit_field_of_view():
    edge = np.tan(SLIT.half_field)
    read = SLIT.read([[1, 0.999 * edge, 0], [1, 1.001 * edge, 0], [-1, 0, 0]])
    assert np.isfinite(read[0]).all()
    assert np.isnan(read[1:]).all()
    assert "outside the field" in SLIT.direction(read).reasons[1]
    assert "outside the field" in SLIT.direction([[5000.0, 10.0]]).reasons[0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: four_normals(2.0), "tilt is 2.0 rad"),
        (lambda: pair_angle([1, 2, 3], TILT, 1.0), r"needed is \(…, 2\)"),
        (lambda: cell_angle(0.5, -1), "full is -1"),
        (lambda: four_cell_direction([1, 1, 1, 1], TILT, sigma=0), "sigma is 0"),
        (lambda: SlitSensor(0, 1e-6, 10), "height is 0"),
        (lambda: SlitSensor(1, 1, 2.5), "pixels is 2.5: give a whole number"),
        (lambda: SLIT.direction([3, 4], noise=-1), "noise is -1"),
        (lambda: SLIT.direction([3, 4], noise=np.ones(2)), "noise is .* one standard error"),
        (lambda: pair_angle([1, 2], TILT, np.ones(2)), "full is .* the one current"),
        (lambda: cell_angle([1, 2], np.ones(2)), "full is .* the one current"),
        (lambda: four_cell_direction([1, 1, 1, 1], TILT, sigma=np.ones(4)), "give one positive"),
        (lambda: four_normals(np.ones(2)), "tilt is"),
    ],
)
def test_settings_out_of_range(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_pair_brighter_than_the_full_current():
    found = pair_angle([[5, 5.2], [0.8, 0.9]], np.radians(30), 1.0, sigma=1e-3)
    assert "above the full current" in found.reasons[0]
    assert np.isnan(found.angle[0])
    assert found.reasons[1] == ""
    assert "above the full current" in pair_angle([5, 5.2], np.radians(30), 1.0).reasons.item()
    # Noise on the Sun in one cell's normal: 5 standard errors are allowed.
    noise = np.random.default_rng(36).normal(0, 1e-3, (10_000, 2))
    full = cell_currents(in_plane(np.radians(30)), pair_normals(np.radians(30)))
    assert full[0] == pytest.approx(1)
    assert (pair_angle(full + noise, np.radians(30), 1.0, 1e-3).reasons == "").all()


def test_currents_as_they_are_stored():
    """Without `sigma`: single precision, six decimals and counts are all right, a shadow is not."""
    sun = in_plane(np.linspace(-0.3, 0.3, 200))
    sun[:, 1] = 0.1
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    exact = cell_currents(sun, four_normals(TILT))
    for stored, error in (
        (exact.astype(np.float32), 2e-7),
        (exact.round(6), 2e-6),
        (np.round(1000 * exact).astype(int), 2e-3),
    ):
        found = four_cell_direction(stored, TILT)
        assert (found.reasons == "").all()
        assert np.abs(found.direction - sun).max() < error
    exact = exact[0]
    for share, agree in ((0.009, True), (0.011, False)):
        shaded = exact - [0, 0, 0, share * exact[:2].sum()]
        assert (four_cell_direction(shaded, TILT).reasons == "") == agree
    assert cell_angle(np.float32(0.1), 0.1).reasons == ""
