"""Work A's steps on its own sensor, and where its factors are right and wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.coverage import even_directions
from sensorbook.magnetometer.min_max import min_max, rotation
from sensorbook.simulate.rotation import MILLIGAUSS, work_a

DENSE = even_directions(40_000)
# A 7.4.1 and 7.4.2, written down by hand.
HARD_IRON = np.array([158.50, -37.49, 191.96])  # mG
ALPHA = np.array([1.0150, 0.9393, 1.0455])
PHI = 11.3  # deg


@pytest.fixture(scope="module")
def exact():
    """200 000 readings of A's sensor, mG: 0.5° apart, hardly any noise."""
    return work_a(np.random.default_rng([1, 1]), 200_000, noise=1e-6) / MILLIGAUSS


@pytest.fixture(scope="module")
def steps(exact):
    return min_max(exact)


def test_hard_iron(steps):
    np.testing.assert_allclose(steps.hard_iron, HARD_IRON, rtol=0, atol=0.5)


def test_angles(steps):
    np.testing.assert_allclose(np.degrees(steps.angles), [PHI, 0, 0], rtol=0, atol=0.1)


def test_factors_as_printed_are_not_those_of_the_sensor(steps):
    np.testing.assert_allclose(steps.printed_factors, [1.0255, 0.9490, 1.0255], rtol=0, atol=0.001)
    # Two of three major semi-axes always coincide.
    assert steps.major[0] == pytest.approx(steps.major[2], rel=1e-3)


def test_printed_factors_leave_an_ellipsoid(steps):
    """Semi-axes after them scatter by 1.4 %: 1.0103, 1.0103, 0.9809 by hand."""
    left = steps.semi_axes * steps.printed_factors
    assert 100 * left.std() / left.mean() == pytest.approx(1.4, abs=0.1)


def test_corrected_factors_are_those_of_the_sensor(steps):
    ratio = steps.factors / ALPHA
    np.testing.assert_allclose(ratio / ratio.mean(), 1, rtol=0, atol=0.002)


def test_corrected_readings_lie_on_a_sphere(exact, steps):
    def scatter(factors):
        length = np.linalg.norm((exact - steps.hard_iron) @ steps.soft_iron(factors), axis=1)
        return length.std() / length.mean()

    assert scatter(steps.factors) < 1e-3
    assert scatter(steps.printed_factors) > 5e-3


def test_turning_back_leaves_the_field_in_the_sensor_s_axes(steps):
    """A stops with the field turned by φ; turned back, the matrix is the sensor's own."""
    turn = Rotation.from_rotvec([-np.radians(PHI), 0, 0]).as_matrix()  # passive
    true = turn.T @ np.diag(ALPHA) @ turn
    found = steps.soft_iron(steps.factors)
    np.testing.assert_allclose(found * np.cbrt(np.linalg.det(true) / np.linalg.det(found)), true,
                               rtol=0, atol=0.002)  # fmt: skip


def test_the_ellipsoid_gives_the_truth():
    readings = work_a(np.random.default_rng([1, 2]), 6000, noise=0.0)
    fit = calibrate(readings, 400 * MILLIGAUSS)
    np.testing.assert_allclose(fit.hard_iron / MILLIGAUSS / 400, HARD_IRON / 400, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(fit.soft_iron), np.sort(ALPHA), rtol=0, atol=1e-9)
    turn = Rotation.from_rotvec([-np.radians(PHI), 0, 0]).as_matrix()
    np.testing.assert_allclose(fit.soft_iron, turn.T @ np.diag(ALPHA) @ turn, rtol=0, atol=1e-9)


def test_a_prolate_spheroid_is_what_the_printed_factors_are_for():
    steps = min_max(DENSE * [1, 1, 2] + [3, -1, 2])
    np.testing.assert_allclose(steps.hard_iron, [3, -1, 2], atol=2e-3)
    np.testing.assert_allclose(steps.printed_factors, np.array([2, 2, 1]) * 0.6, atol=2e-3)
    left = steps.semi_axes * steps.printed_factors
    assert left.std() / left.mean() < 2e-3


def test_an_oblate_spheroid_gets_no_correction_from_them():
    """Semi-axes 1, 2, 2: every plot has a major semi-axis of 2."""
    steps = min_max(DENSE * [1, 2, 2])
    np.testing.assert_allclose(steps.printed_factors, 1, atol=2e-3)
    left = steps.semi_axes * steps.factors
    assert left.std() / left.mean() < 2e-3


@pytest.mark.parametrize("degrees", [-40.0, -10.0, 5.0, 40.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_each_axis_is_found(axis, degrees):
    angles = np.zeros(3)
    angles[axis] = np.radians(degrees)
    semi_axes = np.array([1.0, 1.2, 1.5])
    # Readings whose turn by the angles lies along the axes.
    readings = (DENSE * semi_axes) @ rotation(*angles)
    steps = min_max(readings)
    assert np.degrees(steps.angles[axis]) == pytest.approx(degrees, abs=0.1)
    np.testing.assert_allclose(steps.semi_axes, semi_axes, rtol=2e-3)


# ---- A 6.5 to 6.8 ----


def test_rotation_about_one_axis_each_is_as_printed():
    """By the sines and cosines of 30°."""
    c, s, angle = np.sqrt(3) / 2, 0.5, np.pi / 6
    for found, printed in (
        (rotation(angle, 0, 0), [[1, 0, 0], [0, c, s], [0, -s, c]]),
        (rotation(0, angle, 0), [[c, 0, -s], [0, 1, 0], [s, 0, c]]),
        (rotation(0, 0, angle), [[c, s, 0], [-s, c, 0], [0, 0, 1]]),
    ):
        np.testing.assert_allclose(found, printed, rtol=0, atol=1e-15)


def test_rotation_is_the_product_and_orthogonal():
    r = rotation(0.3, -0.8, 1.9)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(r) == pytest.approx(1)
    np.testing.assert_allclose(
        r, rotation(0.3, 0, 0) @ rotation(0, -0.8, 0) @ rotation(0, 0, 1.9), atol=1e-15
    )
    # Passive: the transpose of scipy's active rotations, in reverse.
    active = Rotation.from_euler("xyz", [0.3, 0, 0]).as_matrix()
    np.testing.assert_allclose(rotation(0.3, 0, 0), active.T, atol=1e-15)
