"""What the camera's accuracy hangs on, against own computations."""

from types import SimpleNamespace

import numpy as np
import pytest

from sensorbook.camera import accuracy
from sensorbook.camera.study import CAMERA, trials


def test_ellipse_and_cone_through_an_exact_limb():
    rho = np.arcsin(6371 / 8371)
    for degrees in (1, 10, 30, 40):
        theta = np.radians(degrees)
        middle = (np.tan(theta - rho) + np.tan(theta + rho)) / 2
        ellipse, cone = accuracy.exact_errors(theta, rho)
        assert ellipse == pytest.approx(np.arctan(middle) - theta, rel=1e-6)
        assert cone < 1e-12
    ellipse, cone = accuracy.exact_errors(np.radians(60), rho)
    assert ellipse is None, "a hyperbola"
    assert cone < 1e-12


def seen(off, sun):
    off = np.radians(off)
    return SimpleNamespace(
        off_axis=off,
        to_earth=np.array([np.sin(off), 0, np.cos(off)]),
        to_sun=np.asarray(sun, dtype=float) / np.linalg.norm(sun),
    )


def test_the_formula_s_attitude():
    rho = accuracy.angular_radius("geo")
    # The Sun in the plane in which the centre moves: TRIAD drops the error.
    bias, turned = accuracy.by_formula(seen(20, [-1, 0, 1]), rho)
    assert bias == pytest.approx(np.radians(0.49), rel=0.01)
    assert turned == pytest.approx(0, abs=1e-9)
    # Across it: Δ sin α/sin β, to the first order in Δ.
    trial = seen(20, [0, 1, 0.5])
    bias, turned = accuracy.by_formula(trial, rho)
    outward = np.array([np.cos(np.radians(20)), 0, -np.sin(np.radians(20))])
    across = np.cross(trial.to_sun, trial.to_earth)
    sine = np.linalg.norm(across)
    assert turned == pytest.approx(bias * abs(outward @ across) / sine / sine, rel=0.01)
    assert accuracy.by_formula(trial, np.radians(71)) is None


def test_the_formula_is_what_c_s_chain_errs_by():
    (trial,) = trials("meo", {}, 1, np.random.default_rng(1511), chain=True, chosen=True)
    _, turned = accuracy.by_formula(trial, accuracy.angular_radius("meo"))
    measured = np.linalg.norm(trial.chain_error)
    # Canny's whole pixels leave a tenth of one, 0.02°, at most.
    assert measured == pytest.approx(turned, abs=np.radians(0.05))
    assert turned > np.radians(0.2), "or it would say nothing"


def test_summary_counts_what_was_not_solved():
    made = [
        SimpleNamespace(error=np.array([3e-3, 4e-3, 0]), squared=2.0, found=None),
        SimpleNamespace(error=np.array([0, 0, 1e-3]), squared=4.0, found=None),
        SimpleNamespace(
            error=None, squared=None, found=SimpleNamespace(status="no solution: dark")
        ),
    ]
    found = accuracy.summarise(made)
    assert (found.count, found.solved) == (3, 2)
    assert (found.mean, found.median, found.largest) == pytest.approx((3e-3, 3e-3, 5e-3))
    assert found.squared == 3
    assert found.statuses == {"no solution: dark": 1}
    none = accuracy.summarise(made[2:])
    assert (none.solved, none.mean, none.squared) == (0, None, None)


def test_bins():
    rows = accuracy.binned([1, 2, 12, 35], [5, 7, 1, 2], np.arange(0, 50, 10))
    np.testing.assert_allclose(rows, [[1.5, 6, 5, 7], [12, 1, 1, 1], [35, 2, 2, 2]])
    assert accuracy.binned([], [], np.arange(3)).shape == (0, 4)


def test_a_scaled_camera_sees_as_much():
    half = accuracy.scaled(CAMERA, 0.5)
    assert (half.width, half.height) == (640, 360)
    assert half.width / half.focal_px == pytest.approx(CAMERA.width / CAMERA.focal_px)


def test_noise_and_pixels():
    drawn = accuracy.scenes("geo", 2, np.random.default_rng(1512))
    quiet, loud = (accuracy.looked_at(drawn, CAMERA, noise, 1) for noise in (1.0, 16.0))
    assert quiet.solved == loud.solved == 2
    assert loud.error > quiet.error
    assert loud.predicted > quiet.predicted
    # A fifth of the pixels: the Sun is less than one wide.
    coarse = accuracy.looked_at(drawn, accuracy.scaled(CAMERA, 0.2), 2.0, 1)
    assert coarse.solved + sum(coarse.statuses.values()) == 2


def test_haze_against_the_ground_s_radius():
    errors = accuracy.haze_errors("leo", 20e3, 2, np.random.default_rng(1513))
    assert list(errors) == list(accuracy.HAZE_WAYS)
    fixed, _, prior = (np.median(found) for found in errors.values())
    # 20 km are 0.21° there. Where on the haze's rise the edge is put is a few km.
    assert np.degrees(fixed) == pytest.approx(0.2, abs=0.1)
    assert prior < fixed


def test_crescents():
    rng = np.random.default_rng(1514)
    assert accuracy.crescent_statuses("geo", np.radians(60), {"lit": "lambert"}, 2, rng) == 2 * [
        "ok"
    ]
    dark = accuracy.crescent_statuses("geo", np.radians(1), {"lit": "lambert"}, 2, rng)
    assert all(status.startswith("no solution") for status in dark)


def test_the_sun_from_around_an_orbit():
    sun = np.array([0.6, 0.0, -0.8])
    vectors, change = accuracy.sun_vectors("geo", sun, 4)
    # At 0° the satellite is 53.13° from the Sun's direction, at 90° at right angles to it.
    assert change[1] == pytest.approx(np.arctan(42157e3 / 149.6e9), rel=1e-9)
    assert change[0] == pytest.approx(42157e3 / 149.6e9 * 0.8, rel=1e-3)
    expected = np.array([0.6 * 149.6e9, -42157e3, -0.8 * 149.6e9])
    np.testing.assert_allclose(vectors[1], expected / np.linalg.norm(expected), atol=1e-15)


def test_printed_vectors():
    nine = np.array([v for rows in accuracy.SUN_VECTORS.values() for v in rows])
    np.testing.assert_allclose(nine.std(axis=0, ddof=1), accuracy.SUN_VECTORS_STD, atol=1e-9)
    # Six digits, each half a unit off at most.
    assert np.abs(np.linalg.norm(nine, axis=1) - 1).max() < 0.9e-6
    home, share = accuracy.from_earth()
    assert share < 1
    most = np.repeat([8371e3, 26371e3, 42157e3], 3) / 149.6e9
    assert (np.linalg.norm(nine - home, axis=1) / most).max() == pytest.approx(share, rel=1e-2)
    # Vectors that no one Sun has: LEO's moved by ten times its radius.
    moved = accuracy.SUN_VECTORS | {
        "leo": ((0.5231, -0.5230, -0.67292), *accuracy.SUN_VECTORS["leo"][1:])
    }
    assert accuracy.from_earth(moved)[1] > 1
