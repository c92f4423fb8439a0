"""Confidence limits of an Allan curve against published limits and by their coverage."""

import numpy as np
import pytest
from scipy import stats

from sensorbook.noise.allan import allan_deviation
from sensorbook.noise.confidence import confidence_limits


def record(kind: str, samples: int, records: int, rng: np.random.Generator) -> np.ndarray:
    """(samples, records) noise of one type, in time."""
    if kind == "quantisation":
        return np.diff(rng.standard_normal((samples + 1, records)), axis=0)
    white = rng.standard_normal((8 * samples if kind == "flicker" else samples, records))
    if kind == "white":
        return white
    if kind == "random walk":
        return np.cumsum(white, axis=0)
    k = np.arange(1, len(white))
    response = np.cumprod(np.append(1.0, (k - 0.5) / k))
    n = 2 * len(white)
    spectrum = np.fft.rfft(response, n)[:, None] * np.fft.rfft(white, n, axis=0)
    return np.fft.irfft(spectrum, axis=0)[7 * samples : 8 * samples]


EXPECTED = {  # σ² at cluster time τ, δt = 1 (table A6)
    "quantisation": lambda tau: 3 / tau**2,
    "white": lambda tau: 1 / tau,
    "flicker": lambda tau: np.full_like(tau, 2 * np.log(2) / np.pi),
    "random walk": lambda tau: tau / 3,
}


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("kind", EXPECTED)
def test_limits_hold_as_often_as_they_say(kind, exact):
    records = 400
    values = record(kind, 2048, records, np.random.default_rng(83))
    curve = allan_deviation(values, 1.0, exact=exact)
    _, limits = confidence_limits(curve)
    used = curve.clusters >= 8  # shorter ones do not yet have the expectation of continuous time
    true = np.sqrt(EXPECTED[kind](curve.tau))[used, None]
    covered = ((limits[used, :, 0] <= true) & (true <= limits[used, :, 1])).mean(axis=1)
    # 400 records tell a share of 95 % to 1.1 %. σ² is only nearly χ², and the type of noise is told
    # from the same curve: 93 … 97 %, and three standard errors.
    assert covered.min() > 0.93 - 0.035
    assert covered.max() < 0.97 + 0.03


def test_phase_dat_as_stable32_limits_it(real_data):
    folder = real_data / "stable32"
    phase = np.loadtxt(folder / "PHASE.DAT")
    table = (folder / "phase_dat_oadev_octave.txt").read_text().splitlines()
    rows = [line.split() for line in table if line.strip() and not line.startswith("#")]
    clusters = [int(row[0]) for row in rows]
    curve = allan_deviation(phase, 1.0, clusters, phase=True)
    _, limits = confidence_limits(curve, 0.683)
    printed = np.array([[float(row[4]), float(row[6])] for row in rows])
    # Stable32 takes white noise and a formula for its degrees of freedom: within 0.3 % of σ.
    np.testing.assert_allclose(limits[:, 0], printed, rtol=0.003)


def test_degrees_of_freedom_of_white_noise():
    samples = 5000
    values = np.random.default_rng(89).normal(size=(samples, 2))
    edf, limits = confidence_limits(allan_deviation(values, 1.0, [1, 2, 4, 8]), 0.9)
    # First differences of white noise correlate by −1/2 with their neighbours alone.
    count = samples - 1
    expected = count**2 / (count + 2 * (count - 1) / 4)
    np.testing.assert_allclose(edf[0], expected, rtol=1e-9)
    deviation = allan_deviation(values, 1.0, [1]).deviation[0]
    for i, quantile in enumerate((0.95, 0.05)):
        bound = deviation * np.sqrt(expected / stats.chi2.ppf(quantile, expected))
        np.testing.assert_allclose(limits[0, :, i], bound, rtol=1e-9)


def test_types_follow_the_curve_axis_by_axis():
    rng = np.random.default_rng(97)
    both = record("white", 50_000, 2, rng)
    both[:, 1] += 0.05 * record("random walk", 50_000, 1, rng)[:, 0]  # from τ = 35 on
    clusters = [4, 8, 16, 250, 500, 1000]
    edf, _ = confidence_limits(allan_deviation(both, 1.0, clusters))
    np.testing.assert_allclose(edf[0, 1], edf[0, 0], rtol=1e-12)
    # 1.5 N/m − … for white noise, 1.16 N/m for random walk: 0.62 of it at long cluster times.
    np.testing.assert_allclose(edf[3:, 1] / edf[3:, 0], 0.62, atol=0.03)


def test_a_single_difference_has_one_degree_of_freedom():
    values = np.random.default_rng(101).normal(size=100)
    edf, limits = confidence_limits(allan_deviation(values, 1.0, [1, 10, 50]))
    assert edf[-1, 0] == 1
    assert np.isfinite(limits).all()


def test_thinned_quantisation_noise_has_fewer_degrees_of_freedom():
    values = record("quantisation", 5000, 1, np.random.default_rng(103))
    every, some = (
        confidence_limits(allan_deviation(values, 1.0, [64, 128, 256], exact=e))[0]
        for e in (True, False)
    )
    np.testing.assert_allclose(some[:, 0] / every[:, 0], [1 / 4, 1 / 8, 1 / 16], rtol=0.01)


def test_constant_data_has_no_spread():
    _, limits = confidence_limits(allan_deviation(np.zeros(2000), 1.0))
    assert (limits == 0).all()


def test_distant_cluster_times():
    values = np.random.default_rng(107).normal(size=100_000)
    edf, _ = confidence_limits(allan_deviation(values, 1.0, [1, 100, 10_000]))
    dense, _ = confidence_limits(allan_deviation(values, 1.0, [1, 50, 100, 200]))
    assert edf[1, 0] == pytest.approx(dense[2, 0], rel=1e-9)


def test_errors():
    values = np.random.default_rng(109).normal(size=2000)
    with pytest.raises(ValueError, match="are those of overlapping clusters"):
        confidence_limits(allan_deviation(values, 1.0, overlapping=False))
    with pytest.raises(ValueError, match="at least two cluster times"):
        confidence_limits(allan_deviation(values, 1.0, [7]))
