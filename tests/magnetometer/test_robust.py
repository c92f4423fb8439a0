"""A tenth of wrong readings; nothing lost where nothing is wrong."""

import numpy as np
import pytest

from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.ellipsoid import BASES, algebraic, packed, refine, residuals
from sensorbook.magnetometer.robust import robust_ellipsoid

from .turns import FIELD, anywhere, iron_of, read, soft_iron_of, turned_by_hand

WRONG = {
    "spikes of any size": lambda rng, m, k: m[k] + rng.normal(scale=FIELD, size=(len(k), 3)),
    "all at one place": lambda rng, m, k: np.tile(m.mean(axis=0) + 0.8 * FIELD, (len(k), 1)),
    "6 µT to one side": lambda rng, m, k: m[k] + [6e-6, 0, 0],
    "full scale": lambda rng, m, k: np.full((len(k), 3), 800e-6),
}


def moved(name, stretch, seed):
    """How far wrong readings move the hard iron, in standard errors; their fit; which they are."""
    rng = np.random.default_rng([seed, 1])
    m = read(rng, turned_by_hand(rng), iron_of(rng))
    clean = calibrate(m)
    n = len(m) // 10
    k = rng.integers(len(m) - n) + np.arange(n) if stretch else rng.permutation(len(m))[:n]
    spoilt = m.copy()
    spoilt[k] = WRONG[name](rng, m, k)
    fit = calibrate(spoilt)
    assert fit.method == "ellipsoid"
    return np.abs((fit.hard_iron - clean.hard_iron) / fit.std[:3]).max(), fit, k


@pytest.mark.parametrize("stretch", [False, True], ids=["anywhere", "in one stretch"])
@pytest.mark.parametrize("name", [n for n in WRONG if n != "6 µT to one side"])
def test_a_tenth_of_wrong_readings_does_not_move_the_hard_iron(name, stretch):
    for seed in range(4):
        size, fit, k = moved(name, stretch, seed)
        assert size < 2
        if name in ("all at one place", "full scale"):
            assert not fit.used[k].any()


@pytest.mark.parametrize("stretch", [False, True], ids=["anywhere", "in one stretch"])
def test_an_offset_that_partly_looks_like_noise_moves_it_little(stretch):
    """Where the 6 µT lie across the field its length hardly changes: a third of them stay.

    The goal of 2 standard errors is met in all but a few of a hundred devices, where it is 2.0 to 2.5.
    """
    sizes = [moved("6 µT to one side", stretch, seed)[0] for seed in range(8)]
    assert np.mean(sizes) < 1.5
    assert np.sum(np.array(sizes) > 2) <= 1
    assert max(sizes) < 3


def test_full_scale_in_a_tenth_of_many_recordings():
    """Starts of a few readings each: some must be free of wrong ones, in every recording."""
    for seed in range(60):
        rng = np.random.default_rng([seed, 7])
        m = anywhere(rng, 1000) + 0.01 * rng.standard_normal((1000, 3))
        bad = rng.permutation(1000)[:100]
        m[bad] = 17.0
        kept = robust_ellipsoid(m)[1]
        assert not kept[bad].any()
        assert kept.sum() > 880  # of 900


def test_clean_readings_are_kept():
    """White noise: at most one reading in a thousand is lost."""
    lost = 0
    for seed in range(20):
        rng = np.random.default_rng([seed, 2])
        m = anywhere(rng, 3000) + 0.01 * rng.standard_normal((3000, 3))
        lost += (~robust_ellipsoid(m)[1]).sum()
    assert lost <= 60  # of 60 000


def test_noise_free_readings_are_all_kept():
    rng = np.random.default_rng(3)
    h, s = np.array([0.3, 0.2, -0.4]), soft_iron_of(rng, [0.9, 1, 1.2])
    m = np.linalg.solve(s, anywhere(rng, 500).T).T + h
    parameters, kept = robust_ellipsoid(m)
    assert kept.all()
    np.testing.assert_allclose(parameters, packed(h, s), rtol=0, atol=1e-9)


def test_nothing_is_lost_against_least_squares():
    """Where no reading is set aside, the result is plain least squares, which is efficient."""
    rng = np.random.default_rng(4)
    m = anywhere(rng, 1000) + 0.01 * rng.uniform(-1, 1, (1000, 3))
    parameters, kept = robust_ellipsoid(m)
    assert kept.all()
    plain = refine(m, algebraic(m), BASES["ellipsoid"])
    np.testing.assert_allclose(parameters, plain, rtol=0, atol=1e-8)


def test_readings_set_aside_are_those_far_off():
    rng = np.random.default_rng(5)
    m = anywhere(rng, 2000) + 0.01 * rng.standard_normal((2000, 3))
    bad = rng.permutation(2000)[:200]
    m[bad] *= rng.choice([0.7, 1.3], size=(200, 1))
    parameters, kept = robust_ellipsoid(m)
    assert not kept[bad].any()
    assert kept.sum() >= 1780  # of 1800
    # 0.01 · √(10 / 1800) ≈ 7e-4 a parameter at one standard error.
    assert np.abs(parameters - packed(np.zeros(3), np.eye(3))).max() < 4e-3
    assert np.abs(residuals(m[kept], parameters)[0]).max() < 0.05


def test_a_device_at_rest_for_a_third_of_the_recording():
    rng = np.random.default_rng(6)
    iron = iron_of(rng)
    u = turned_by_hand(rng)
    fit = calibrate(read(rng, np.vstack([np.tile(u[:1], (1500, 1)), u]), iron))
    assert fit.method == "ellipsoid"
    assert fit.used.mean() > 0.99
    error = np.abs(fit.hard_iron - iron["hard_iron"])
    # Half of a normal interval again, as three of them are looked at.
    assert (error < 1.5 * fit.interval_factor * fit.std[:3]).all()
