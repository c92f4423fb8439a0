"""Slopes of the Allan curve, found on exact curves and on simulated records."""

import json
from functools import cache

import numpy as np
import pytest

from sensorbook.noise.allan import AllanCurve, allan_deviation, cluster_sizes
from sensorbook.noise.curves import fit_physical
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import NoiseTerms
from sensorbook.noise.slopes import CELL, LEAST_DECADES, TOLERANCE, find_slopes, smooth_curve
from sensorbook.simulate.noise import coloured_noise

RATE = 10.0


def exact_slopes(terms, samples=720_000, rate=100.0):
    m = cluster_sizes(samples, rate)
    sigma = np.sqrt(terms.allan_variance(m / rate))[:, None]
    curve = AllanCurve(m / rate, m, sigma, samples - 2 * m + 1, samples, rate)
    return curve, find_slopes(curve, "x", fit_terms(curve).axes[0])


@cache
def found(seed, samples=100_000, **terms):
    """Slopes of a simulated record; `ramp` and `quantization` are added in the time domain."""
    rng = np.random.default_rng([421, seed, *(round(1000 * v) for v in terms.values())])
    ramp, step = terms.pop("ramp", 0.0), terms.pop("quantization", 0.0)
    values = coloured_noise(samples, RATE, rng, **terms) + ramp * np.arange(samples) / RATE
    values += step * RATE * np.diff(rng.standard_normal(samples + 1))
    curve = allan_deviation(values, RATE)
    return curve, find_slopes(curve, "x", fit_terms(curve).axes[0])


def kinds(slopes):
    return tuple(r.slope for r in slopes.ranges)


# ---- exact curves ----


def test_smooth_curve_has_the_slopes_of_an_exact_curve():
    terms = NoiseTerms(random_walk=1.0, bias_instability=0.2, rate_random_walk=0.02)
    curve, slopes = exact_slopes(terms)
    tau = np.geomspace(curve.tau[0], 300.0, 50)
    squares = {"random_walk": 1.0, "bias_instability": 0.04, "rate_random_walk": 0.0004}
    true = fit_physical(squares).slope(tau)
    # Without scatter what is left is the spline's stiffness and, at long τ, the mean of log χ².
    np.testing.assert_allclose(slopes.smooth.slope(tau), true, atol=0.04)
    # By less than its own error everywhere.
    assert (np.abs(slopes.smooth.slope(tau) - true) < slopes.smooth.slope_std(tau)).all()


def test_slope_is_the_derivative_of_the_smooth_curve():
    smooth = exact_slopes(NoiseTerms(random_walk=1.0, bias_instability=0.2))[1].smooth
    tau, step = np.geomspace(0.02, 500, 40), 1e-5
    ratio = smooth.deviation(tau * np.exp(step)) / smooth.deviation(tau * np.exp(-step))
    np.testing.assert_allclose(smooth.slope(tau), np.log(ratio) / (2 * step), atol=1e-7)
    whole = np.log(smooth.deviation(100.0) / smooth.deviation(1.0)) / np.log(100)
    mean = smooth.mean_slope(1.0, 100.0)
    assert mean.value == pytest.approx(whole)
    assert mean.low < mean.value < mean.high


def test_white_noise_and_walk_alone_hold_no_flat():
    curve, slopes = exact_slopes(NoiseTerms(random_walk=1.0, rate_random_walk=0.5))
    assert kinds(slopes) == (-0.5, 0.5)
    white, walk = slopes.ranges
    # slope ∓½ (1−x²)/(1+x²), x = τK/√3N, is within 0.15 of ∓½ for x below 0.42 and above 2.38
    turn = np.sqrt(3) / 0.5
    assert white.tau_low == pytest.approx(curve.tau[0])
    # Ends lie on a grid of forty points a decade, 6 % apart.
    assert white.tau_high == pytest.approx(0.420 * turn, rel=0.08)
    assert walk.tau_low == pytest.approx(2.380 * turn, rel=0.08)


def test_a_broad_flat_is_found_with_its_coefficient():
    _, slopes = exact_slopes(NoiseTerms(random_walk=1e-2, bias_instability=1.0))
    flat = slopes.ranges[-1]
    assert (flat.slope, flat.term) == (0.0, "bias_instability")
    # 0.15 from zero: white noise adds 43 % to σ² there, and ever less beyond.
    assert flat.coefficient == pytest.approx(1.0, rel=0.05)
    np.testing.assert_allclose(
        flat.line(np.array([1.0, 50.0])), 0.6643 * flat.coefficient, rtol=1e-4
    )


# ---- simulated records ----


@pytest.mark.parametrize("seed", range(12))
def test_white_noise_has_slope_minus_one_half_alone(seed):
    curve, slopes = found(seed, random_walk=1.0)
    assert set(kinds(slopes)) == {-0.5}
    white = slopes.ranges[0]
    assert white.tau_low == pytest.approx(curve.tau[0])
    assert white.tau_high > 30 * curve.tau[0]
    # All of the range counts alike, and the last of its ten e-folds is known to 30 %: 3 % of the mean.
    assert white.coefficient == pytest.approx(1.0, rel=0.1)


# Of a hundred records of other seeds 99 show the walk and all the flicker: ten of twelve is failed by
# chance once in thousands. No slope that is not there may be shown at all.
@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        ({"random_walk": 1.0, "rate_random_walk": 0.2}, (-0.5, 0.5)),
        ({"random_walk": 1.0, "bias_instability": 0.5}, (-0.5, 0.0)),
        ({"random_walk": 1.0, "ramp": 0.02}, (-0.5, 1.0)),
        ({"random_walk": 0.2, "quantization": 0.3}, (-1.0, -0.5)),
    ],
    ids=["walk", "flicker", "ramp", "quantisation"],
)
def test_slopes_of_mixtures(terms, expected):
    shown = [kinds(found(seed, **terms)[1]) for seed in range(12)]
    assert sum(set(k) == set(expected) for k in shown) >= 10, shown
    assert set().union(*shown) == set(expected), shown


def test_bands_of_the_slope_hold_the_truth():
    terms = {"random_walk": 1.0, "bias_instability": 0.25, "rate_random_walk": 0.02}
    true = fit_physical({name: v**2 for name, v in terms.items()})
    held = []
    for seed in range(24):
        _, slopes = found(seed, **terms)
        error = np.abs(slopes.smooth.slope(slopes.tau) - true.slope(slopes.tau))
        held.append(error < 1.96 * slopes.smooth.slope_std(slopes.tau))
    # The prior is of the smoothest curve that bends: the bands are a little wide (97 %).
    assert np.mean(held) >= 0.93
    # At no cluster time fewer than 19 of 24: at 95 % that has a chance of 0.1 %.
    assert np.mean(held, axis=0).min() >= 19 / 24


def test_what_a_range_promises():
    curve, slopes = found(0, random_walk=1.0, rate_random_walk=0.2)
    for r in slopes.ranges:
        assert r.tau_high >= r.tau_low * 10**LEAST_DECADES
        inside = (slopes.tau >= r.tau_low) & (slopes.tau <= r.tau_high)
        away = np.abs(slopes.smooth.slope(slopes.tau[inside]) - r.slope)
        assert away.max() <= TOLERANCE + slopes.smooth.slope_std(slopes.tau[inside]).max()
        assert r.slope - CELL <= r.mean_slope.low < r.mean_slope.high <= r.slope + CELL
    known = slopes.smooth.slope_std(np.array([slopes.known_to]))[0] * 1.96
    assert known == pytest.approx(CELL, rel=0.1)
    assert curve.tau[0] < slopes.known_to < curve.tau[-1]


def test_a_longer_record_knows_the_slope_to_longer_times():
    short, long = (found(0, samples=n, random_walk=1.0)[1].known_to for n in (10_000, 100_000))
    # The clusters of a record ten times as long are as many at times ten times as long.
    assert long / short == pytest.approx(10, rel=0.3)


def test_cluster_times_of_the_low_pass_are_left_out():
    rng = np.random.default_rng(422)
    curve = allan_deviation(
        coloured_noise(100_000, 100.0, rng, random_walk=1.0, bandwidth=20.0), 100.0
    )
    low_pass = LowPass(20.0, 0.01, 1e-4, 20.0, {2: 1.0})
    noise = fit_terms(curve, [low_pass]).axes[0]
    slopes = find_slopes(curve, "x", noise, low_pass)
    assert slopes.tau[0] >= 2 / 20.0
    assert kinds(slopes) == (-0.5,)


def test_smooth_curve_scales_with_the_signal():
    rng = np.random.default_rng(423)
    values = rng.standard_normal(10_000)
    smooth = []
    for scale in (1.0, 1e-6):
        curve = allan_deviation(scale * values, RATE)
        points = np.arange(len(curve.tau))
        smooth.append(smooth_curve(curve, "x", fit_terms(curve).axes[0], points))
    tau = np.geomspace(0.1, 100.0, 20)
    np.testing.assert_allclose(smooth[1].deviation(tau), 1e-6 * smooth[0].deviation(tau), rtol=1e-6)


def test_results_are_plain():
    _, slopes = found(0, random_walk=1.0)
    results = slopes.to_results("gyroscope")
    json.dumps(results, allow_nan=False)
    assert results[0]["term"] == "random_walk"
    assert results[0]["coefficient"]["unit"] == "rad/s/sqrt(Hz)"
    assert results[0]["tau_range"] == [slopes.ranges[0].tau_low, slopes.ranges[0].tau_high]
