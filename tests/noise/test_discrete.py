"""Values per sample: what is simulated with them has the continuous-time coefficients again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import fftconvolve

from sensorbook import units
from sensorbook.estimate import Estimate
from sensorbook.noise import TERMS, NoiseTerms, allan_deviation
from sensorbook.noise.discrete import STEPS, discrete_values, per_sample
from sensorbook.noise.result import AxisNoise, NoiseEstimate
from sensorbook.simulate.noise import coloured_noise

N, B, K = 2e-4, 5e-5, 7e-6
COEFFICIENT = {"random_walk": N, "bias_instability": B, "rate_random_walk": K}
SAMPLES = 200_000


# ---- the formulas ----


@settings(max_examples=50, deadline=None)
@given(rate=st.floats(1e-3, 1e6))
def test_formulas_of_kalibr(rate):
    step = 1 / rate
    found = discrete_values(NoiseTerms(**COEFFICIENT), rate)
    assert found == {
        "random_walk": pytest.approx(N / np.sqrt(step), rel=1e-14),
        "bias_instability": B,
        "rate_random_walk": pytest.approx(K * np.sqrt(step), rel=1e-14),
    }


def test_absent_terms_are_zero():
    assert set(discrete_values(NoiseTerms(quantization=1e-6), 100.0).values()) == {0.0}


@pytest.mark.parametrize("rate", [0, -100.0, np.inf, np.nan])
def test_what_is_no_rate(rate):
    with pytest.raises(ValueError, match=r"rate .* Hz: give the sampling rate, above zero"):
        discrete_values(NoiseTerms(**COEFFICIENT), rate)


# ---- against simulation ----


def simulated(term: str, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """Noise made sample by sample from its value per sample."""
    white = rng.normal(0, sigma, SAMPLES)
    if term == "random_walk":
        return white
    if term == "rate_random_walk":
        return np.cumsum(white)
    k = np.arange(1, SAMPLES)
    h = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    return fftconvolve(white, h)[:SAMPLES]


@pytest.mark.parametrize("rate", [10.0, 400.0])
@pytest.mark.parametrize("term", STEPS)
def test_simulated_sample_by_sample_the_allan_deviation_is_the_terms(term, rate):
    terms = NoiseTerms(**{term: COEFFICIENT[term]})
    rng = np.random.default_rng([20240501, list(STEPS).index(term), int(rate)])
    signal = simulated(term, discrete_values(terms, rate)[term], rng)
    curve = allan_deviation(signal, rate, [64])
    # Some 3000 to 4500 independent differences: 1.3 % at most; four of these.
    assert curve.deviation[0, 0] == pytest.approx(
        np.sqrt(terms.allan_variance(64 / rate)), rel=0.05
    )


@pytest.mark.parametrize("rate", [10.0, 400.0])
def test_spectral_synthesis_scatters_and_steps_as_said(rate):
    rng = np.random.default_rng([20240502, int(rate)])
    sigma = discrete_values(NoiseTerms(**COEFFICIENT), rate)
    white = coloured_noise(SAMPLES, rate, rng, random_walk=N)
    # 1/√(2·200000) = 0.16 %; four of these
    assert white.std() == pytest.approx(sigma["random_walk"], rel=0.0064)
    walk = coloured_noise(SAMPLES, rate, rng, random_walk=0.0, rate_random_walk=K)
    # A spectrum cut at half the rate lacks 0.1 % of the growth in 100 steps; of 2000 independent
    # growths (3000 with overlap) the deviation is known to 1.6 %; four of these.
    grown = np.std(walk[100:] - walk[:-100])
    assert grown == pytest.approx(sigma["rate_random_walk"] * np.sqrt(100), rel=0.065)


# ---- the table ----


def estimate(sensor: str, *axes: dict) -> NoiseEstimate:
    """An estimate with these coefficients, an axis each, and no others."""
    made = []
    for coefficients in axes:
        terms = {
            name: Estimate(v, 0.9 * v, 1.1 * v) if (v := coefficients.get(name)) else None
            for name in TERMS
        }
        made.append(AxisNoise(terms, {}, (0.01, 1000.0), None))
    return NoiseEstimate("by hand", sensor, tuple(made))


def test_table_in_field_units():
    # 0.3 °/√h = 0.005 °/s/√Hz = 8.7266e-5 rad/s/√Hz: 0.05 °/s a sample at 100 Hz; 1.8 °/h/√s: 0.18 °/h.
    degree = np.pi / 180
    x = {"random_walk": 0.005 * degree, "rate_random_walk": 1.8 * degree / 3600}
    y = {"random_walk": 0.010 * degree, "bias_instability": 7.5 * degree / 3600}
    table = per_sample(estimate("gyroscope", x, y, y), 100.0)
    assert list(table.index) == [
        "N, random walk",
        "B, bias instability",
        "K, rate random walk",
    ]
    continuous, discrete = table["continuous time"], table["per sample"]
    assert list(continuous["unit"]) == ["°/√h", "°/h", "°/h/√s"]
    assert list(discrete["unit"]) == ["°/s", "°/h", "°/h"]
    assert list(discrete["formula"]) == ["σ_d = N/√δt", "σ_w = B", "σ_bd = K·√δt"]
    np.testing.assert_allclose(
        continuous[list("xyz")].to_numpy(float),
        [[0.3, 0.6, 0.6], [np.nan, 7.5, 7.5], [1.8, np.nan, np.nan]],
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        discrete[list("xyz")].to_numpy(float),
        [[0.05, 0.1, 0.1], [np.nan, 7.5, 7.5], [0.18, np.nan, np.nan]],
        rtol=1e-12,
    )


@pytest.mark.parametrize("sensor", units.SENSOR_UNITS)
def test_every_sensor_has_a_table_that_shows(sensor):
    table = per_sample(estimate(sensor, COEFFICIENT), 50.0)
    si = [units.factor(unit, units.SENSOR_UNITS[sensor]) for unit in table["per sample"]["unit"]]
    expected = [N * np.sqrt(50), B, K / np.sqrt(50)]
    np.testing.assert_allclose(table["per sample"]["x"].to_numpy(float) * si, expected, rtol=1e-12)
    assert "σ_bd = K·√δt" in table.to_html(border=0, na_rep="–")
