"""Covariance of Allan variances against many short simulated records."""

import numpy as np
import pytest
from scipy import stats

from sensorbook.noise import NoiseTerms, allan_deviation
from sensorbook.noise.covariance import RANDOM_TERMS, variance_covariance
from sensorbook.simulate.noise import coloured_noise

SAMPLES, RECORDS, RATE = 2000, 1000, 10.0
CLUSTERS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 32, 64, 128, 256, 400])
DT = 1 / RATE


def white(rng):
    return rng.standard_normal((SAMPLES, RECORDS)) / np.sqrt(DT)


def walk(rng):
    return np.cumsum(rng.standard_normal((SAMPLES, RECORDS)), axis=0) * np.sqrt(DT)


def flicker(rng):
    one = [
        coloured_noise(SAMPLES, RATE, rng, random_walk=0.0, bias_instability=1.0)
        for _ in range(RECORDS)
    ]
    return np.stack(one, axis=1)


def quantised(rng):
    # An angle that is wrong by Q at every sample, independently; its difference is the rate.
    return np.diff(rng.standard_normal((SAMPLES + 1, RECORDS)), axis=0) / DT


def mixture(rng):
    return white(rng) + 0.3 * walk(rng)


def ramp(rng):
    return white(rng) + 0.05 * np.arange(SAMPLES)[:, None] * DT


# Discrete sums stand for the random walk and the flicker noise below: at the shortest clusters they
# differ from the continuous terms, so these begin at m = 4 and 8.
CASES = {
    "white": (white, {"random_walk": 1.0}, 1),
    "random walk": (walk, {"rate_random_walk": 1.0}, 4),
    "flicker": (flicker, {"bias_instability": 1.0}, 8),
    "quantisation": (quantised, {"quantization": 1.0}, 1),
    "white and random walk": (mixture, {"random_walk": 1.0, "rate_random_walk": 0.3**2}, 1),
    "white and ramp": (ramp, {"random_walk": 1.0, "rate_ramp": 0.05**2}, 1),
}


@pytest.mark.parametrize("case", CASES)
def test_agrees_with_monte_carlo(case):
    make, squares, shortest = CASES[case]
    clusters = CLUSTERS[shortest <= CLUSTERS]
    values = make(np.random.default_rng([2024, list(CASES).index(case)]))
    variance = allan_deviation(values, RATE, clusters).deviation ** 2  # (T, RECORDS)
    terms = NoiseTerms(**{name: np.sqrt(v) for name, v in squares.items()})
    theory = variance_covariance(clusters, SAMPLES, RATE, squares)
    # The estimator is unbiased. Its mean has a relative error of √(2/(edf·RECORDS)), below 4 % at
    # edf = 2, the fewest here; random walk and flicker differ a little from their continuous forms.
    np.testing.assert_allclose(
        variance.mean(axis=1), terms.allan_variance(clusters / RATE), rtol=0.08
    )
    found = np.cov(variance)
    deviation = np.sqrt(np.diag(theory))
    # 1000 records know a standard deviation to 2.2 %; of a χ² with 3 degrees of freedom, to 3.9 %.
    np.testing.assert_allclose(np.sqrt(np.diag(found)), deviation, rtol=0.12)
    correlation = theory / np.outer(deviation, deviation)
    np.testing.assert_allclose(np.corrcoef(variance), correlation, atol=0.15)


@pytest.mark.parametrize("samples", [50, 1000])
def test_white_noise_at_one_sample_is_exact(samples):
    # Differences y(i+1) − y(i) are a moving average of two with correlation −1/2 and variance 2, so
    # that their mean square over M = N − 1, halved, has the variance 2/M² (M + (M − 1)/2).
    m = samples - 1
    found = variance_covariance([1], samples, 1.0, {"random_walk": 1.0})
    assert found[0, 0] == pytest.approx(2 / m**2 * (m + (m - 1) / 2), rel=1e-12)


@pytest.mark.parametrize(("case", "shortest"), [("white", 1), ("random walk", 4)])
def test_degrees_of_freedom_of_sp_1065(case, shortest):
    # NIST SP 1065, table 5: empirical edf of the overlapping Allan variance for N phase points, which
    # it calls good to a few per cent.
    n = 1025
    m = np.array([1, 2, 4, 8, 16, 32, 64])
    m = m[m >= shortest]
    squares = CASES[case][1]
    name = next(iter(squares))
    theory = variance_covariance(m, n - 1, 1.0, squares)
    variance = NoiseTerms(**{name: 1.0}).allan_variance(m)
    found = 2 * variance**2 / np.diag(theory)
    if case == "white":
        printed = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    else:
        printed = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2
    np.testing.assert_allclose(found, printed, rtol=0.08)


def test_confidence_limits_of_stable32(real_data):
    table = (real_data / "stable32" / "phase_dat_oadev_octave.txt").read_text().splitlines()
    rows = np.array([line.split() for line in table if line[:1] == " "], dtype=float)
    # At m = 1, where the exact value is known (above), Stable32's limits are 8 % too narrow.
    rows = rows[1:]
    m, low, sigma, high = rows[:, 0].astype(int), *rows[:, 4:7].T
    assert (rows[:, 3] == 0).all()  # white frequency noise, as the table has it
    theory = variance_covariance(m, 1000, 1.0, {"random_walk": 1.0})
    edf = 2 * (1.0 / m) ** 2 / np.diag(theory)
    limits = [sigma * np.sqrt(edf / stats.chi2.ppf(p, edf)) for p in (0.8415, 0.1585)]
    # Stable32's edf is Greenhall and Riley's, an approximation of a few per cent.
    np.testing.assert_allclose(limits[0] / sigma - 1, low / sigma - 1, rtol=0.08)
    np.testing.assert_allclose(limits[1] / sigma - 1, high / sigma - 1, rtol=0.08)


@pytest.mark.parametrize(
    ("name", "power"),
    [
        ("quantization", 4),  # σ² is Q²/τ²
        ("random_walk", 2),
        ("bias_instability", 0),
        ("rate_random_walk", -2),
    ],
)
def test_scaling_with_rate_and_size(name, power):
    m = [1, 4, 16, 50]
    unit = variance_covariance(m, 500, 1.0, {name: 1.0})
    changed = variance_covariance(m, 500, 100.0, {name: 9.0})
    np.testing.assert_allclose(changed, 81 * 100.0**power * unit, rtol=1e-12)


def test_ramp_scales_with_rate():
    m, r = [2, 8, 32], 100.0
    one = variance_covariance(m, 500, 1.0, {"random_walk": 1.0, "rate_ramp": 0.25})
    # In units of the sampling time: N² counts as N²/δt, R² as R²δt².
    other = variance_covariance(m, 500, r, {"random_walk": 1.0 / r, "rate_ramp": 0.25 * r**2})
    np.testing.assert_allclose(other, one, rtol=1e-12)


def test_a_ramp_alone_is_no_chance():
    found = variance_covariance([1, 2, 4], 100, 1.0, {"rate_ramp": 1.0})
    np.testing.assert_array_equal(found, 0)


def test_is_a_covariance():
    rng = np.random.default_rng(12)
    m = np.array([1, 2, 5, 10, 20, 50, 100])
    for _ in range(5):
        squares = dict(zip(RANDOM_TERMS, rng.exponential(size=4), strict=True))
        c = variance_covariance(m, 1000, 1.0, squares)
        np.testing.assert_array_equal(c, c.T)
        sd = np.sqrt(np.diag(c))
        assert np.abs(c / np.outer(sd, sd)).max() <= 1 + 1e-12
        # Long clusters are a quadrature: the smallest eigenvalue may miss zero by that much.
        assert np.linalg.eigvalsh(c / np.outer(sd, sd)).min() > -0.01


def test_negative_squares_count_as_absent():
    with_negative = variance_covariance(
        [1, 8], 200, 1.0, {"random_walk": 1.0, "quantization": -5.0}
    )
    without = variance_covariance([1, 8], 200, 1.0, {"random_walk": 1.0})
    np.testing.assert_array_equal(with_negative, without)
