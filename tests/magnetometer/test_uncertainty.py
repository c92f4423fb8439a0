"""The jackknife against closed forms; intervals that cover; correlation of known series."""

import numpy as np
import pytest
from scipy import signal

from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.ellipsoid import BASES, ENTRIES, algebraic, refine, residuals
from sensorbook.magnetometer.result import relative
from sensorbook.magnetometer.uncertainty import (
    FEWEST_BLOCKS,
    MOST_BLOCKS,
    correlation_time,
    held_out,
    jackknife,
    number_of_blocks,
)

from .turns import FIELD, anywhere, iron_of, read, turned_by_hand

# ---- jackknife ----


def linear_problem(rng, rows, noise):
    """Design (rows, 3), scores of the least-squares fit of `noise` (rows,)."""
    a = rng.standard_normal((rows, 3)) * [1, 2, 5] + [0.5, 0, 1]
    r = noise - a @ np.linalg.lstsq(a, noise, rcond=None)[0]
    return a, a * r[:, None]


def test_one_row_a_block_is_the_textbook_jackknife():
    """Fits without one row each, done one by one, as the docstring's formula has them."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(25)
    a, scores = linear_problem(rng, 25, noise)
    fits = np.array(
        [np.linalg.lstsq(np.delete(a, k, 0), np.delete(noise, k), rcond=None)[0] for k in range(25)]
    )
    textbook = 24 / 25 * (fits - fits.mean(axis=0)).T @ (fits - fits.mean(axis=0))
    covariance, dof = jackknife(a, scores, 25)
    np.testing.assert_allclose(covariance, textbook, rtol=1e-9)
    assert dof == 22


def test_independent_noise_gives_the_formal_covariance():
    ratios = []
    for seed in range(50):
        rng = np.random.default_rng([seed, 2])
        a, scores = linear_problem(rng, 4000, 0.1 * rng.standard_normal(4000))
        covariance, dof = jackknife(a, scores, 40)
        assert dof == 39
        formal = 0.01 * np.linalg.inv(a.T @ a)
        ratios.append(np.diag(covariance) / np.diag(formal))
    # χ² with 39 degrees of freedom over 39 has sd 0.23; the mean of 50 times 3, hardly correlated,
    # has 0.02 to 0.03. A jackknife's own bias is 1/40.
    assert np.mean(ratios) == pytest.approx(1, abs=0.08)


def test_copies_in_blocks_do_not_make_it_smaller():
    """Each row 25 times: the truth is that of the rows, the formal error is five times too small."""
    rng = np.random.default_rng(3)
    a, scores = linear_problem(rng, 400, rng.standard_normal(400))
    once, _ = jackknife(a, scores, 40)
    copies, _ = jackknife(np.repeat(a, 25, axis=0), np.repeat(scores, 25, axis=0), 40)
    np.testing.assert_allclose(copies, once, rtol=1e-9)
    formal = np.sqrt(np.diag(np.linalg.inv(25 * a.T @ a)))
    # √25, as far as a standard error of 39 degrees of freedom is known: 11 % at one sd.
    np.testing.assert_allclose(np.sqrt(np.diag(copies)) / formal, 5, rtol=0.35)


def test_a_block_that_alone_holds_a_parameter_makes_it_infinite():
    a = np.zeros((100, 2))
    a[:, 0] = 1
    a[:10, 1] = 1
    covariance, dof = jackknife(a, a * 0.1, 10)
    assert np.isinf(covariance).all()
    assert dof == 1


# ---- correlation ----


def first_order(rng, phi, count):
    """(count,) x[k] = φ x[k−1] + white noise, past its start."""
    return signal.lfilter([1], [1, -phi], rng.standard_normal(count + 2000))[2000:]


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.98])
def test_correlation_time_of_a_first_order_series(phi):
    found = [
        correlation_time(first_order(np.random.default_rng([seed, 4]), phi, 100_000))
        for seed in range(10)
    ]
    # (1 + φ) / (1 − φ); each known to √(4 M / N), M ≈ 5 times it: 14 % for φ = 0.98, of ten 5 %.
    assert np.mean(found) == pytest.approx((1 + phi) / (1 - phi), rel=0.12)


def test_correlation_time_is_never_below_a_sample():
    rng = np.random.default_rng(5)
    assert correlation_time(first_order(rng, -0.5, 10_000)) == 1
    assert correlation_time(np.zeros(50)) == 1
    assert correlation_time(np.array([1.0, 2.0])) == 1


@pytest.mark.parametrize(
    ("count", "time", "blocks"),
    [
        (100_000, 1.0, MOST_BLOCKS),
        (3000, 10.0, 30),
        (3000, 200.0, FEWEST_BLOCKS),
        (4, 1.0, 4),
    ],
)
def test_blocks_last_ten_correlation_times(count, time, blocks):
    assert number_of_blocks(count, time) == blocks


# ---- intervals ----


@pytest.mark.parametrize("louder", [1.0, 10.0])
def test_intervals_cover(louder):
    """80 devices turned by hand for a minute, white and flicker noise: nine parameters each."""
    inside = []
    for seed in range(80):
        rng = np.random.default_rng([seed, 6])
        iron = iron_of(rng)
        fit = calibrate(read(rng, turned_by_hand(rng), iron, louder))
        assert fit.method == "ellipsoid"
        s, field = relative(iron["soft_iron"], FIELD)
        truth = np.r_[iron["hard_iron"], [s[e] for e in ENTRIES], field]
        inside.append(np.abs(fit.values - truth) <= fit.interval_factor * fit.std)
    # 800 intervals, correlated within a device; of 80 alone 95 % is known to ± 2.4 % at one sd.
    assert 0.88 <= np.mean(inside) <= 0.99
    assert np.mean(inside, axis=0).min() >= 0.85


# ---- held out ----


def test_held_out_residuals_are_those_of_the_fits_to_the_rest():
    rng = np.random.default_rng(7)
    m = anywhere(rng, 500) + 0.02 * rng.standard_normal((500, 3))
    basis = BASES["ellipsoid"]
    p = refine(m, algebraic(m), basis)
    kept = rng.random(500) > 0.1
    r = held_out(m, p, basis, kept, np.array_split(np.arange(500), 5))
    others = kept & (np.arange(500) >= 100)
    own = refine(m[others], algebraic(m[others]), basis)
    np.testing.assert_allclose(r[:100], residuals(m[:100], own)[0], rtol=0, atol=1e-7)


def test_held_out_is_larger_than_fitted():
    for seed in range(20):
        rng = np.random.default_rng([seed, 8])
        fit = calibrate(read(rng, turned_by_hand(rng), iron_of(rng)))
        assert fit.residual_check >= fit.residual
        assert fit.residual_check < 1.3 * fit.residual
