"""What directions reach and determine, against areas and simulations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.magnetometer.coverage import (
    CROSS_AXIS,
    SCALE,
    axis_in_words,
    coverage,
    dilution,
    effects,
    errors_by_direction,
    even_directions,
    motion_in_words,
    neglected,
)
from sensorbook.magnetometer.ellipsoid import (
    BASES,
    ENTRIES,
    design,
    packed,
    refine,
    sphere,
    unpacked,
)

from .turns import anywhere, soft_iron_of

DENSE = even_directions(40_000)  # 1° apart
MARGIN = np.radians(15)  # as coverage says: seen where a reading is within


def turned(u, seed):
    return Rotation.random(rng=np.random.default_rng(seed)).apply(u)


def in_cap(degrees):
    return DENSE[DENSE[:, 2] >= np.cos(np.radians(degrees))]


def in_belt(degrees):
    return DENSE[np.abs(DENSE[:, 2]) <= np.sin(np.radians(degrees))]


# ---- share of the sphere ----


@pytest.mark.parametrize("degrees", [5, 30, 60, 90, 120])
@pytest.mark.parametrize("seed", range(3))
def test_percent_of_a_cap(degrees, seed):
    """A cap as wide as its readings and the margin: (1 − cos) / 2 of the sphere."""
    found = coverage(turned(in_cap(degrees), seed))
    area = 50 * (1 - np.cos(np.radians(degrees) + MARGIN))
    # 1000 directions: one line of them on the edge is 0.1 √1000 · sin, and readings are 1° apart.
    assert found.percent == pytest.approx(area, abs=1.5)


@pytest.mark.parametrize("degrees", [2, 20, 45, 70])
@pytest.mark.parametrize("seed", range(3))
def test_percent_of_a_belt(degrees, seed):
    found = coverage(turned(in_belt(degrees), seed))
    area = 100 * np.sin(np.radians(degrees) + MARGIN)
    assert found.percent == pytest.approx(area, abs=1.5)


def test_all_round_nothing_is_left_out():
    found = coverage(DENSE)
    assert found.percent == 100
    assert np.degrees(found.hole_angle) < 2
    assert np.linalg.norm(found.mean) < 0.01
    assert motion_in_words(found) == ("", "")


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [0.6, 0, -0.8], [-1, 0, 0]])
def test_hole_mean_and_side_of_a_cap(axis):
    u = Rotation.align_vectors([axis], [[0, 0, 1.0]])[0].apply(in_cap(60))
    found = coverage(u)
    assert np.degrees(np.arccos(-found.hole @ np.array(axis))) < 4  # the grid is 3.5° apart
    assert np.degrees(found.hole_angle) == pytest.approx(120, abs=4)
    np.testing.assert_allclose(found.mean / np.linalg.norm(found.mean), axis, atol=0.02)
    # Of a cap as wide as the readings and the margin: (1 + cos) / 2.
    assert np.linalg.norm(found.mean) == pytest.approx((1 + np.cos(np.radians(75))) / 2, abs=0.01)


@pytest.mark.parametrize("degrees", [3, 10, 25])
def test_normal_and_flatness_of_a_belt(degrees):
    axis = np.array([2, -1, 2]) / 3
    u = Rotation.align_vectors([axis], [[0, 0, 1.0]])[0].apply(in_belt(degrees))
    found = coverage(u)
    assert abs(found.normal @ axis) > 0.999
    # 90 % of directions spread evenly lie within 0.9 of the sine.
    expected = np.arcsin(0.9 * np.sin(np.radians(degrees)))
    assert found.flatness == pytest.approx(expected, abs=np.radians(0.5))


def test_even_directions_are_even():
    u = even_directions()
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(u.mean(axis=0), 0, atol=2e-3)
    np.testing.assert_allclose(3 * u.T @ u / len(u), np.eye(3), atol=5e-3)


# ---- dilution ----


@pytest.mark.parametrize("model", BASES)
def test_dilution_of_even_directions_is_one(model):
    assert dilution(even_directions(), model) == pytest.approx(1, rel=1e-12)
    # Other spirals, however laid: evenness of 1000 and of 5000 directions.
    assert dilution(turned(even_directions(5000), 1), model) == pytest.approx(1, rel=0.02)


@pytest.mark.parametrize("model", BASES)
def test_dilution_of_one_plane_is_infinite(model):
    turn = np.linspace(0, 2 * np.pi, 100)
    u = turned(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), 2)
    assert dilution(u, model) == np.inf


def test_dilution_grows_as_the_cap_shrinks():
    found = [dilution(in_cap(d), "ellipsoid") for d in (180, 120, 90, 60, 30)]
    assert (np.diff(found) > 0).all()
    assert found[-1] > 100


def test_dilution_is_that_of_fits():
    """200 fits to noisy readings of a cap and of the whole sphere: ratio of the worst errors."""
    rng = np.random.default_rng(3)
    worst = []
    for u in (in_cap(100)[::40], DENSE[::40]):
        truth = packed(np.zeros(3), np.eye(3))
        errors = []
        for _ in range(200):
            m = u * (1 + 0.002 * rng.standard_normal((len(u), 1)))
            p = refine(m, truth, BASES["ellipsoid"])
            h, s = unpacked(p)
            errors.append((even_directions(200) - h) @ s - even_directions(200))
        rms = np.sqrt((np.array(errors) ** 2).sum(axis=2).mean(axis=0)).max()
        worst.append(rms * np.sqrt(len(u)))
    # 200 fits: each rms 5 % at one sd.
    assert worst[0] / worst[1] == pytest.approx(dilution(in_cap(100), "ellipsoid"), rel=0.2)


# ---- effects ----


def test_effects_by_finite_differences():
    rng = np.random.default_rng(4)
    p = packed(rng.uniform(-1, 1, 3), soft_iron_of(rng, [0.8, 1, 1.4]))
    h, s = unpacked(p)
    u = anywhere(rng, 20)
    m = np.linalg.solve(s, u.T).T + h
    step = 1e-6
    for k, e in enumerate(np.eye(9)):
        (h1, s1), (h0, s0) = unpacked(p + step * e), unpacked(p - step * e)
        numeric = ((m - h1) @ s1 - (m - h0) @ s0) / (2 * step)
        # Bilinear: central differences are exact but for rounding of 1e-16 / step.
        np.testing.assert_allclose(effects(u, p)[:, :, k], numeric, rtol=0, atol=1e-8)


def test_errors_by_direction_of_hard_iron_alone():
    covariance = np.zeros((9, 9))
    covariance[:3, :3] = np.diag([4.0, 1, 4])
    np.testing.assert_allclose(errors_by_direction(covariance), 3, rtol=1e-12)


# ---- what a reduced model neglects ----

CONTRASTS = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
MOTIONS = {"cap 75°": in_cap(75)[::20], "belt 25°": in_belt(25)[::20], "all": DENSE[::20]}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("model", ["diagonal", "hard_iron"])
def test_neglected_is_what_a_reduced_fit_errs_by(model, motion):
    """Sensors with a little of each thing left out, fitted without it: noise-free, one by one."""
    u = turned(MOTIONS[motion], 6)
    little = 1e-4
    found = np.zeros((9, 9))
    left_out = [(CROSS_AXIS, e) for e in np.eye(9)[6:]]
    if model == "hard_iron":
        left_out += [(SCALE, np.r_[np.zeros(3), c, np.zeros(3)]) for c in CONTRASTS]
    for size, one in left_out:
        truth = packed(np.zeros(3), np.eye(3)) + little * one
        m = np.linalg.solve(unpacked(truth)[1], u.T).T
        error = (refine(m, sphere(m), BASES[model]) - truth) / little * size
        found += np.outer(error, error)
    # Second order in `little`, over dilutions up to a hundred.
    np.testing.assert_allclose(neglected(u, model), found, rtol=0, atol=2e-2 * np.abs(found).max())


def test_the_full_ellipsoid_neglects_nothing():
    assert not neglected(in_cap(60), "ellipsoid").any()


# ---- words ----


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ([1, 0, 0], "+x"),
        ([0, -2, 0.1], "−y"),
        ([0, 0.7, -0.7], "+y −z"),
        ([-0.9, 0, 0.44], "−x +z"),
        ([0.6, 0.58, 0.55], "+x +y +z"),
    ],
)
def test_axis_in_words(direction, words):
    assert axis_in_words(np.array(direction, dtype=float)) == words


def test_words_of_a_plane():
    what, remedy = motion_in_words(coverage(in_belt(5)))
    assert what.startswith("the field stays within ±4° of one plane or cone across the device's ")
    assert what.endswith(("+z", "−z"))
    assert remedy.startswith("Tip it by 90° and over, until its ")
    assert "z points along the field, too" in remedy


def test_words_of_one_side():
    what, remedy = motion_in_words(coverage(in_cap(60)))
    assert what.startswith("the field is seen from one side only, about the device's +z, ")
    # 120°, to the grid of directions.
    assert what.endswith(("never within 117° of −z", "never within 118° of −z"))
    assert remedy.startswith("Turn it over, until its −z points along the field, too")


def test_words_of_a_hole():
    what, remedy = motion_in_words(coverage(in_cap(125)))
    assert what.startswith("the field is seen on 88 % of the sphere, never within 5")
    assert what.endswith(" of the device's −z")
    assert remedy.startswith("Turn it over, until its −z points along the field, too")


def test_entries_agree_with_the_design():
    u = np.array([[0.6, 0.0, 0.8]])
    quadratic = dict(zip(ENTRIES, design(u, u, packed(np.zeros(3), np.eye(3)))[0, 3:], strict=True))
    assert quadratic[0, 0] == pytest.approx(0.36)
    assert quadratic[0, 2] == pytest.approx(0.96)  # 2 · 0.6 · 0.8
    assert quadratic[0, 1] == 0
