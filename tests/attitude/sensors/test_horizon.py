"""Conical-scan horizon sensor: the scan against its inversion, refusals, standard errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook.attitude.rotations import axis_rotation
from sensorbook.attitude.sensors.conical import (
    EQUIVALENT_HEIGHT,
    RADIUS,
    Scan,
    angular_radius,
    greatest_height,
    scan,
    scan_ellipsoid,
    scan_vectors,
)
from sensorbook.attitude.sensors.horizon import NEARER, ONLY, one_cone, tilted, two_cones

LEO, GEO = 700e3, 35786e3
CONE = np.radians(45)
EXACT = 1e-9  # rad, the requirement; what is reached is rounding

angles = st.floats(-0.5, 0.5)


def attitudes(count, most, seed):
    roll, pitch = np.random.default_rng(seed).uniform(-most, most, (2, count))
    yaw = np.random.default_rng(seed + 1).uniform(-np.pi, np.pi, count)
    return roll, pitch, tilted(roll, pitch, yaw)


def test_angular_radius_of_work_c():
    # C 3.2 rounds: 135° from 500 km and 17.5° from GEO, of the solid Earth.
    assert np.degrees(2 * angular_radius(500e3, equivalent_height=0.0)) == pytest.approx(
        136, abs=0.1
    )
    assert np.degrees(2 * angular_radius(GEO, equivalent_height=0.0)) == pytest.approx(
        17.4, abs=0.1
    )


@pytest.mark.parametrize("height", [EQUIVALENT_HEIGHT, -5.0, np.nan])
def test_height_inside_the_earth(height):
    with pytest.raises(ValueError, match="above the infrared horizon"):
        angular_radius(height)


def test_level_crossings_have_a_closed_form():
    """Level, cos η · 0 + sin η cos δ = cos ρ: symmetric about the nadir."""
    found = scan(np.eye(3), LEO, CONE)
    expected = np.arccos(np.cos(angular_radius(LEO)) / np.sin(CONE))
    assert found.leave == pytest.approx(expected, abs=1e-13)
    assert found.enter == pytest.approx(-expected, abs=1e-13)


def test_crossings_lie_on_the_limb_and_are_in_order():
    _, _, body = attitudes(300, 0.4, 1)
    found = scan(body, LEO, CONE)
    good = found.reasons == ""
    assert 100 < good.sum() < 300
    assert (good == np.isfinite(found.enter)).all()
    nadir, rho = body[good][:, :, 2], angular_radius(LEO)
    for angle, sign in ((found.enter[good], 1), (found.leave[good], -1)):
        near = (scan_vectors(CONE, angle) * nadir).sum(axis=1)
        assert np.abs(near - np.cos(rho)).max() < 1e-13
        after = (scan_vectors(CONE, angle + 1e-4) * nadir).sum(axis=1)
        assert (sign * (after - near) > 0).all(), "nearer the nadir is inside the Earth"
    assert (found.leave[good] > found.enter[good]).all()


@pytest.mark.parametrize(
    ("roll", "cone", "reason"),
    [(0.0, np.radians(15), "passes beside"), (1.5, np.radians(20), "fills the scan")],
)
def test_no_crossing_says_why(roll, cone, reason):
    found = scan(tilted([roll, roll], [0.0, 0.0]), LEO, cone)
    assert all(reason in r for r in found.reasons)
    assert np.isnan(found.enter).all()
    fix = one_cone(found, LEO, cone, sigma=1e-3)
    assert np.isnan(fix.nadir).all()
    assert np.isnan(fix.roll_std).all()
    assert all("a crossing is missing" in r for r in fix.reasons)


@pytest.mark.parametrize("roll", [0.0, 0.2, -0.1])
def test_greatest_height(roll):
    body = tilted(roll, 0.1)
    most = greatest_height(body, CONE)
    assert scan(body, 0.999 * most, CONE).reasons == ""
    assert "passes beside" in scan(body, 1.001 * most, CONE).reasons.item()


def test_one_bad_sample_leaves_the_others():
    body = tilted([0.0, 0.1, -1.4], 0.05)
    body[1] = np.nan
    found = scan(body, LEO, CONE)
    assert found.reasons[0] == ""
    assert "no finite number" in found.reasons[1]
    fix = one_cone(found, LEO, CONE)
    assert fix.roll[0] == pytest.approx(0.0, abs=EXACT)
    assert np.isnan(fix.roll[1])


@settings(deadline=None, max_examples=60)
@given(angles, angles, st.floats(-3.1, 3.1), st.floats(300e3, 3000e3), st.sampled_from([1, -1]))
def test_one_cone_round_trip(roll, pitch, yaw, height, side):
    body = tilted(roll, pitch, yaw)
    fix = one_cone(scan(body, height, CONE, side), height, CONE, side)
    if fix.reasons == "":
        assert np.abs(fix.solutions - body[:, 2]).max(axis=-1).min() < EXACT, "one is the truth"
        if fix.choice == ONLY:
            assert fix.roll == pytest.approx(roll, abs=EXACT)
            assert fix.pitch == pytest.approx(pitch, abs=EXACT)


def test_one_cone_from_low_orbit_is_unique_and_exact():
    """With η < ρ the order of the crossings excludes the second solution."""
    roll, pitch, body = attitudes(500, 0.4, 3)
    fix = one_cone(scan(body, LEO, CONE), LEO, CONE)
    good = fix.reasons == ""
    assert good.sum() > 300
    assert (fix.choice[good] == ONLY).all()
    assert np.abs(fix.roll - roll)[good].max() < EXACT
    assert np.abs(fix.pitch - pitch)[good].max() < EXACT


def test_one_cone_from_far_has_two_solutions():
    """A small Earth: both solutions fulfil the equations and the order; the nearer nadir is taken."""
    cone = np.radians(85)
    roll, _, body = attitudes(300, 0.2, 4)
    fix = one_cone(scan(body, GEO, cone), GEO, cone)
    good = fix.reasons == ""
    assert good.sum() > 50
    assert fix.fits[good].all()
    assert (fix.choice[good] == NEARER).all()
    rho = angular_radius(GEO)
    for k in (0, 1):
        again = scan_vectors(cone, scan(body, GEO, cone).enter[good])
        assert np.abs((again * fix.solutions[good, k]).sum(axis=-1) - np.cos(rho)).max() < 1e-12
    other = np.take_along_axis(fix.solutions[good], 1 - fix.chosen[good, None, None], axis=1)[:, 0]
    assert (fix.nadir[good, 2] >= other[:, 2]).all()
    assert (
        np.abs(fix.solutions[good] - body[good, None, :, 2]).max(axis=-1).min(axis=-1).max() < EXACT
    )
    # The choice is a guess and can be wrong.
    wrong = np.abs(fix.roll - roll)[good] > 1e-3
    assert 0 < wrong.sum() < good.sum()


def test_two_cones_need_no_height():
    roll, pitch, body = attitudes(300, 0.2, 5)
    height = np.random.default_rng(6).uniform(300e3, 3000e3, 300)
    first, second = scan(body, height, CONE), scan(body, height, CONE, -1)
    fix = two_cones(first, second, CONE)
    good = fix.reasons == ""
    assert good.sum() > 150
    assert np.abs(fix.roll - roll)[good].max() < EXACT
    assert np.abs(fix.pitch - pitch)[good].max() < EXACT
    assert np.abs(fix.height / height - 1)[good].max() < 1e-9
    three = two_cones(first, Scan(second.enter, np.nan * second.leave, second.reasons), CONE)
    both = good & (three.reasons == "")
    assert both.sum() > 150
    assert np.abs(three.roll - roll)[both].max() < EXACT
    lone = two_cones(first, Scan(*(np.full((2, 300), np.nan)), second.reasons), CONE)
    assert all("fewer than three" in r for r in lone.reasons)


def test_degenerate_geometry_is_refused():
    near = one_cone(Scan(0.1, 0.1005, ""), LEO, CONE)
    assert "grazes" in near.reasons.item()
    # Cones of 90° about y and −y are one and the same circle.
    same = Scan(np.array([-0.9]), np.array([0.9]), np.array([""]))
    assert "cones that meet" in two_cones(same, same, np.pi / 2).reasons[0]


def test_nadir_in_the_plane_of_the_crossings_is_refused():
    # cos η cos γ + sin η cos w sin γ is largest where it equals cos ρ.
    rho = angular_radius(LEO)
    width = np.arccos(np.sqrt(np.cos(rho) ** 2 - 0.01) / np.sin(np.arccos(0.1)))
    fix = one_cone(Scan(-width, width, ""), LEO, np.arccos(0.1))
    assert "one plane with the nadir" in fix.reasons.item()
    apart = one_cone(Scan(-width - 0.1, width + 0.1, ""), LEO, np.arccos(0.1))
    assert "no attitude has such crossings" in apart.reasons.item()


def noisy(seed, sigma, third=False, count=10_000):
    body = tilted(0.1, -0.07, 0.4)
    error = np.random.default_rng(seed).normal(0, sigma, (4, count))
    first, second = scan(body, LEO, CONE), scan(body, LEO, CONE, -1)
    last = second.leave + (np.nan if third else 1) * error[3]
    return (
        body,
        Scan(first.enter + error[0], first.leave + error[1], ""),
        Scan(second.enter + error[2], last, ""),
    )


@pytest.mark.parametrize("kind", ["one", "two", "three"])
def test_standard_errors_by_nees(kind):
    sigma = 1e-3
    body, first, second = noisy(7, sigma, kind == "three")
    fix = (
        one_cone(first, LEO, CONE, sigma=sigma)
        if kind == "one"
        else two_cones(first, second, CONE, sigma=sigma)
    )
    error = np.cross(fix.nadir, body[:, 2])
    nees = np.einsum("ni,nij,nj->n", error, fix.information, error).mean()
    # χ² of two degrees of freedom; the mean of 10⁴ has a standard error of 1 %.
    assert nees == pytest.approx(2, rel=0.03)
    assert ((fix.roll - 0.1) ** 2 / fix.roll_std**2).mean() == pytest.approx(1, abs=0.05)
    assert ((fix.pitch + 0.07) ** 2 / fix.pitch_std**2).mean() == pytest.approx(1, abs=0.05)
    if kind != "one":
        assert ((fix.height - LEO) ** 2 / fix.height_std**2).mean() == pytest.approx(1, abs=0.05)


def test_yaw_has_no_information():
    _, first, second = noisy(8, 1e-3, count=50)
    fix = two_cones(first, second, CONE, sigma=1e-3)
    about = np.einsum("ni,nij,nj->n", fix.nadir, fix.information, fix.nadir)
    assert np.abs(about).max() < 1e-6 * np.trace(fix.information[0])
    along = np.einsum("nij,nj->ni", fix.covariance, fix.nadir)
    assert np.abs(along).max() < 1e-15
    assert "Yaw" in fix.unobservable
    assert "not observable" in fix.unobservable


def test_the_fourth_crossing_does_improve():
    """C 3.2.1, after its source, says that it cannot; with noise it takes a fifth or more off."""
    _, first, second = noisy(9, 1e-3)
    four = two_cones(first, second, CONE)
    three = two_cones(first, Scan(second.enter, np.nan * second.leave, ""), CONE)
    for angle, true in (("roll", 0.1), ("pitch", -0.07)):
        rms = [np.sqrt(((getattr(f, angle) - true) ** 2).mean()) for f in (four, three)]
        assert rms[0] < 0.8 * rms[1]


def test_ellipsoid_with_equal_axes_is_the_sphere():
    body = tilted(0.1, 0.05, 1.0)
    one = scan(body, LEO, CONE)
    position = [0.0, 0.0, -(RADIUS + LEO)]
    other = scan_ellipsoid(body, position, [RADIUS + EQUIVALENT_HEIGHT] * 3, CONE)
    assert other.enter == pytest.approx(one.enter, abs=1e-13)


def test_settings_out_of_range():
    with pytest.raises(ValueError, match="cone is"):
        scan(np.eye(3), LEO, 2.0)
    with pytest.raises(ValueError, match="side is 0"):
        scan(np.eye(3), LEO, CONE, side=0)
    with pytest.raises(ValueError, match="sigma is -1"):
        one_cone(Scan(-0.9, 0.9, ""), LEO, CONE, sigma=-1)
    with pytest.raises(ValueError, match=r"needed is \(…, 3, 3\)"):
        scan(np.eye(2), LEO, CONE)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [(2 * np.eye(3), "differs from the identity by 3"), (np.diag([1.0, -1, 1]), "it mirrors")],
)
def test_an_attitude_that_is_no_rotation(matrix, words):
    lost = np.full((3, 3), np.nan)  # a reason, not an error
    with pytest.raises(ValueError, match=words):
        scan([lost, matrix], LEO, CONE)
    with pytest.raises(ValueError, match=words):
        scan_ellipsoid(matrix, [0, 0, -7e6], [6.4e6] * 3, CONE)
    with pytest.raises(ValueError, match=words):
        greatest_height(matrix, CONE)


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("sigma", [1e-4, None])
def test_four_crossings_on_no_one_circle_are_refused(which, sigma):
    body = tilted(0.05, -0.08)
    true = [(s.enter, s.leave) for s in (scan(body, 500e3, CONE), scan(body, 500e3, CONE, -1))]
    angles = np.ravel(true)
    angles[which] -= np.radians(20)
    fix = two_cones(Scan(*angles[:2], ""), Scan(*angles[2:], ""), CONE, sigma=sigma)
    assert "on no one circle" in fix.reasons.item()
    assert np.isnan([fix.roll, fix.pitch, fix.height]).all()
    if sigma:
        assert np.isnan([fix.roll_std, fix.height_std]).all()
        assert np.isnan(fix.information).all()
    # Three crossings fit a circle always: the remedy where the culprit is known.
    angles[which] = np.nan
    left = two_cones(Scan(*angles[:2], ""), Scan(*angles[2:], ""), CONE, sigma=sigma)
    assert left.reasons == ""
    assert left.roll == pytest.approx(0.05, abs=EXACT)


def crossings(roll, pitch, height):
    body = tilted(roll, pitch, 0.4)
    both = scan(body, height, CONE), scan(body, height, CONE, -1)
    return np.array([angle for s in both for angle in (s.enter, s.leave)])


def misfit(first, second):
    """What no roll, pitch or height explains of four crossings (N) of `noisy`, rad, from the scan itself."""
    true, step = np.array([0.1, -0.07, LEO]), np.array([1e-5, 1e-5, 10.0])
    slopes = [crossings(*(true + d)) - crossings(*(true - d)) for d in np.diag(step)]
    across = np.linalg.svd(np.array(slopes))[2][3]
    angles = np.stack([first.enter, first.leave, second.enter, second.leave])
    return np.abs(across @ (angles - crossings(*true)[:, None]))


@pytest.mark.parametrize("sigma", [1e-4, 1e-3])
def test_the_misfit_of_four_crossings_is_tested_at_5_standard_errors(sigma):
    _, first, second = noisy(31, sigma)
    kept = two_cones(first, second, CONE, sigma=sigma)
    # Of 10⁴ samples of noise 0.006 are beyond.
    assert (kept.reasons == "").all()
    # A smaller standard error refuses of the same samples those whose misfit is beyond 5 of it.
    off = misfit(first, second)
    assert np.sqrt((off**2).mean()) == pytest.approx(sigma, rel=0.03), "one degree of freedom"
    told = off.max() / 10
    refused = two_cones(first, second, CONE, sigma=told).reasons != ""
    clear = np.abs(off / (5 * told) - 1) > 0.02  # the misfit here is of first order
    assert 0 < refused.sum() < len(off)
    assert (refused == (off > 5 * told))[clear].all()


@pytest.mark.parametrize("degrees", [90, 89.99, 89.9])
@pytest.mark.parametrize("crossings", [3, 4])
def test_two_cones_in_one_plane_are_refused(degrees, crossings):
    cone, sigma, rng = np.radians(degrees), np.radians(0.05), np.random.default_rng(31)
    body = tilted(*np.radians([6.0, 4.0, 25.0]))
    noise = rng.normal(0, sigma, (4, 2000))
    first, second = scan(body, 700e3, cone), scan(body, 700e3, cone, -1)
    one = Scan(first.enter + noise[0], first.leave + noise[1], "")
    last = second.leave + noise[3] if crossings == 4 else np.full(2000, np.nan)
    fix = two_cones(one, Scan(second.enter + noise[2], last, ""), cone, sigma=sigma)
    assert (fix.reasons != "").all()
    assert np.isnan(fix.height).all()
    assert np.isnan(fix.roll).all()
    assert all("the noise hides a tilt" in reason for reason in fix.reasons)
    # Without a standard error the plane itself, where no slope tells an angle, is still refused.
    if degrees == 90:
        told = two_cones(one, Scan(second.enter + noise[2], last, ""), cone)
        assert (told.reasons != "").all()


@pytest.mark.parametrize("degrees", [89, 85, 45])
def test_two_cones_that_carry_the_noise_are_kept_with_its_size(degrees):
    cone, sigma, rng = np.radians(degrees), np.radians(0.05), np.random.default_rng(32)
    body = tilted(*np.radians([6.0, 4.0, 25.0]))
    noise = rng.normal(0, sigma, (4, 2000))
    first, second = scan(body, 700e3, cone), scan(body, 700e3, cone, -1)
    one = Scan(first.enter + noise[0], first.leave + noise[1], "")
    fix = two_cones(
        one, Scan(second.enter + noise[2], second.leave + noise[3], ""), cone, sigma=sigma
    )
    assert np.mean(fix.reasons == "") > 0.999
    # 2000 samples know an rms to 1.6 %; near one plane what is not linear adds some.
    rms = np.sqrt(np.nanmean((fix.roll - np.radians(6)) ** 2))
    assert rms == pytest.approx(np.sqrt(np.nanmean(fix.roll_std**2)), rel=0.08)


def test_oblateness_is_no_fault_without_a_standard_error():
    """An ellipsoid's limb is a circle to some 0.1°: below the limit of 1°."""
    rng = np.random.default_rng(32)
    axes = np.array([6378137.0, 6378137.0, 6356752.314]) + EQUIVALENT_HEIGHT
    position = rng.normal(size=(300, 3))
    position *= (7078e3 / np.linalg.norm(position, axis=1))[:, None]
    down = -position / np.linalg.norm(position, axis=1)[:, None]
    side = np.cross(down, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    frame = np.stack([np.cross(side, down), side, down], axis=1)
    body = attitudes(300, 0.1, 33)[2] @ frame
    both = [scan_ellipsoid(body, position, axes, CONE, side) for side in (1, -1)]
    assert (two_cones(*both, CONE).reasons == "").all()
    told = two_cones(*both, CONE, sigma=1e-5)
    assert sum("oblateness" in r for r in told.reasons) > 150


@pytest.mark.parametrize(
    ("cone", "height", "pitch"), [(np.pi / 2, GEO, 0.02), (np.radians(85), GEO, np.pi / 2)]
)
def test_no_choice_between_two_solutions_as_near(cone, height, pitch):
    """About y's plane both mirror images fit; with the nadir along x both have z = 0."""
    body = tilted([0.03, -0.03, 0.1], pitch)
    # At pitch 90° roll turns about the nadir: the scan axis leans by a tilt in body axes instead.
    body = body if pitch < 1 else axis_rotation("Z", [0.03, -0.03, 0.1]) @ tilted(0.0, pitch)
    fix = one_cone(scan(body, height, cone), height, cone, sigma=1e-4)
    assert all("neither is nearer" in r for r in fix.reasons)
    assert all("narrower cone" in r for r in fix.reasons)
    assert np.isnan([fix.roll, fix.pitch, fix.roll_std]).all()
    assert (fix.chosen == -1).all()
    assert (fix.choice == "").all()
    assert fix.fits.all()
    near = np.abs(fix.solutions - body[:, None, :, 2]).max(axis=-1)
    assert near.min(axis=-1).max() < EXACT, "one of both is the truth"


def test_a_scan_along_the_limb_meets_it_four_times():
    axes = np.array([6378137.0, 6378137.0, 6356752.314]) + EQUIVALENT_HEIGHT
    position = np.array([6378137.0 + LEO, 0, 0])
    body = tilted(np.pi / 2, 0) @ axis_rotation("Y", -np.pi / 2)  # the scan axis to the nadir
    equator = np.arcsin(axes[0] / position[0])
    reasons = [
        scan_ellipsoid(body, position, axes, equator - np.radians(within)).reasons.item()
        for within in (-0.05, 0.05, 0.15)
    ]
    assert "passes beside" in reasons[0]
    assert "four times" in reasons[1]
    assert "fills the scan" in reasons[2]
    found = scan_ellipsoid(body, position, axes, equator - np.radians(0.05))
    assert np.isnan([found.enter, found.leave]).all()
    # A little aside the scan meets the limb twice, and every sample has its own answer.
    leaning = tilted([0.0, 0.01], 0.0) @ body
    assert (scan_ellipsoid(leaning, position, axes, equator - 9e-4).reasons == "").tolist() == [
        False,
        True,
    ]
