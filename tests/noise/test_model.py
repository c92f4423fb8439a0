"""Noise terms: variances against quadrature of the spectra, and against independent formulas."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special

from sensorbook.noise import TERMS, NoiseTerms, variance_from_spectrum

Q, N, B, K, R = 3e-6, 2e-4, 5e-5, 7e-6, 4e-8
COEFFICIENT = {
    "quantization": Q,
    "random_walk": N,
    "bias_instability": B,
    "rate_random_walk": K,
    "rate_ramp": R,
}


# ---- table A6 ----


@settings(max_examples=25, deadline=None)
@given(tau=st.floats(1e-3, 1e5))
def test_variances_of_the_table(tau):
    expected = {
        "quantization": 3 * Q**2 / tau**2,
        "random_walk": N**2 / tau,
        "bias_instability": 2 * np.log(2) / np.pi * B**2,
        "rate_random_walk": K**2 * tau / 3,
        "rate_ramp": R**2 * tau**2 / 2,
    }
    for name, value in expected.items():
        alone = NoiseTerms(**{name: COEFFICIENT[name]})
        assert alone.allan_variance(tau) == pytest.approx(value, rel=1e-14)
    together = NoiseTerms(**COEFFICIENT)
    assert together.allan_variance(tau) == pytest.approx(sum(expected.values()), rel=1e-14)


@pytest.mark.parametrize("name", TERMS)
def test_read_at_points_and_slopes(name):
    term = TERMS[name]
    at = term.read_at or 17.0
    sigma = np.sqrt(term.variance(np.array([at, 2 * at])))
    # On the flat the coefficient is σ/0.664; elsewhere it is σ at the point of reading.
    expected = 1.0 if term.read_at else 0.664
    assert sigma[0] == pytest.approx(expected, abs=0.5e-3 if term.read_at is None else 1e-14)
    assert np.log2(sigma[1] / sigma[0]) == pytest.approx(term.slope, abs=1e-14)


def test_names_and_symbols():
    assert {t.symbol: t.read_at for t in TERMS.values()} == {
        "Q": pytest.approx(np.sqrt(3)),
        "N": 1.0,
        "B": None,
        "K": 3.0,
        "R": pytest.approx(np.sqrt(2)),
    }
    assert [t.name for t in TERMS.values()] == list(TERMS)


def test_any_shape_of_tau_and_absent_terms():
    terms = NoiseTerms(random_walk=N)
    assert terms.allan_variance([[1, 2], [4, 8]]).shape == (2, 2)
    assert terms.allan_variance([[1, 2], [4, 8]])[1, 1] == pytest.approx(N**2 / 8)
    np.testing.assert_array_equal(NoiseTerms().allan_variance([1.0, 10.0]), 0)


# ---- A 5.14: spectrum and Allan variance ----


@pytest.mark.parametrize("tau", [0.1, 3.0, 200.0])
@pytest.mark.parametrize("name", ["random_walk", "bias_instability", "rate_random_walk"])
def test_continuous_quadrature_gives_the_variance(name, tau):
    terms = NoiseTerms(**{name: COEFFICIENT[name]})
    # The quadrature ends at 2000/τ: white noise loses (4·3/8)/(2000 π²) = 7.6e-5 of its variance.
    found = variance_from_spectrum(lambda f: terms.spectrum(f, 1e-9), tau)
    assert found == pytest.approx(terms.allan_variance(tau), rel=1.5e-4)


@pytest.mark.parametrize("n", [1, 2, 5, 100])
@pytest.mark.parametrize("dt", [0.01, 1.0])
@pytest.mark.parametrize("name", ["quantization", "random_walk"])
def test_sampled_quadrature_is_exact(name, dt, n):
    terms = NoiseTerms(**{name: COEFFICIENT[name]})
    found = variance_from_spectrum(lambda f: terms.spectrum(f, dt), n * dt, dt)
    assert found == pytest.approx(terms.allan_variance(n * dt), rel=1e-6)


@pytest.mark.parametrize("name", ["bias_instability", "rate_random_walk"])
def test_sampled_quadrature_of_slow_terms(name):
    # These have little power near the Nyquist frequency: at n = 100 the cut is worth less than 1e-4.
    terms, dt = NoiseTerms(**{name: COEFFICIENT[name]}), 0.01
    found = variance_from_spectrum(lambda f: terms.spectrum(f, dt), 100 * dt, dt)
    assert found == pytest.approx(terms.allan_variance(1.0), rel=2e-4)


def test_continuous_kernel_cut_at_nyquist_loses_white_noise():
    # A5: 0.64 of the variance at n = 1, 0.94 at n = 5; the reason why the sampled kernel is there.
    dt = 0.01
    for n, share in ((1, 0.64), (5, 0.94)):
        tau = n * dt
        cut = lambda f: np.where(f <= 0.5 / dt, N**2, 0.0)  # noqa: E731
        # A step between two nodes costs up to half a cell, 1e-3/τ here.
        found = variance_from_spectrum(cut, tau, points=2_000_000)
        assert found / (N**2 / tau) == pytest.approx(share, abs=0.006)


def test_quantisation_depends_on_kernel_and_spectrum():
    # A6: exact S with the continuous kernel, cut at 1/2τz, gives 2.3 Q²/τ²; approximate S gives 3.
    dt, n = 0.01, 200
    tau, terms = n * dt, NoiseTerms(quantization=Q)
    below = lambda f: f <= 0.5 / dt  # noqa: E731
    exact = variance_from_spectrum(lambda f: terms.spectrum(f, dt) * below(f), tau)
    approximate = variance_from_spectrum(lambda f: (2 * np.pi * f) ** 2 * dt * Q**2 * below(f), tau)
    assert exact * tau**2 / Q**2 == pytest.approx(2.32, abs=0.02)
    assert approximate * tau**2 / Q**2 == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize("tau_over_tc", [0.3, 1.0, 10.0])
def test_quadrature_of_a_first_order_gauss_markov_process(tau_over_tc):
    qc, tc = 2e-4, 20.0
    tau = tau_over_tc * tc
    found = variance_from_spectrum(lambda f: (qc * tc) ** 2 / (1 + (2 * np.pi * f * tc) ** 2), tau)
    x = tau / tc
    expected = (qc * tc) ** 2 / tau * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
    # The trapezoids are 0.01/τ wide: 1e-4/12 times the integrand's slope, some 2e-4 of the whole.
    assert found == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("tau", [2.0, 30.0])
def test_quadrature_of_bias_instability_with_cut_off(tau):
    cut_off = 0.08
    s = lambda f: np.where(f <= cut_off, B**2 / (2 * np.pi * f), 0.0)  # noqa: E731
    u = np.pi * cut_off * tau
    sin, ci = np.sin(u), lambda x: special.sici(x)[1]
    # A 5.27
    bracket = np.log(2) - sin**3 / (2 * u**2) * (sin + 4 * u * np.cos(u)) + ci(2 * u) - ci(4 * u)
    # The step at the cut-off falls between two nodes 1e-3/τ apart: below 1 % where u is smallest.
    found = variance_from_spectrum(s, tau, points=2_000_000)
    assert found == pytest.approx(2 * B**2 / np.pi * bracket, rel=1e-2)


def test_quadrature_against_an_adaptive_one():
    dt, tau = 0.1, 0.7
    terms = NoiseTerms(Q, N, B, K)
    n = tau / dt

    def integrand(f):
        kernel = np.sin(np.pi * f * tau) ** 4 / (n * np.sin(np.pi * f * dt)) ** 2
        return 4 * float(terms.spectrum(f, dt)) * kernel

    edges = np.r_[1e-7 / tau, np.arange(1, 8) / (2 * tau)]
    parts = [
        integrate.quad(integrand, a, b, limit=200, epsabs=0)[0]
        for a, b in itertools.pairwise(edges)
    ]
    assert edges[-1] == pytest.approx(1 / (2 * dt))
    found = variance_from_spectrum(lambda f: terms.spectrum(f, dt), tau, dt)
    assert found == pytest.approx(sum(parts), rel=1e-5)


def test_spectrum_has_the_slopes_of_a4():
    f = np.array([0.01, 0.02])
    for name, slope in (
        ("random_walk", 0),
        ("bias_instability", -1),
        ("rate_random_walk", -2),
        ("quantization", 2),
    ):
        s = NoiseTerms(**{name: COEFFICIENT[name]}).spectrum(f, 1e-4)
        assert np.log2(s[1] / s[0]) == pytest.approx(slope, abs=1e-10)
    # The two-sided read-offs of A4, each inverted.
    w = 2 * np.pi * f
    whole = {n: NoiseTerms(**{n: c}).spectrum(f, 0.01) for n, c in COEFFICIENT.items()}
    np.testing.assert_allclose(np.sqrt(whole["random_walk"]), N)
    np.testing.assert_allclose(np.sqrt(w * whole["bias_instability"]), B)
    np.testing.assert_allclose(w * np.sqrt(whole["rate_random_walk"]), K)
    np.testing.assert_array_equal(whole["rate_ramp"], 0)  # deterministic: no density


# ---- growth of the integral ----


def test_growth_of_the_integral():
    time, dt = 900.0, 0.1
    growth = NoiseTerms(random_walk=N, bias_instability=B, rate_random_walk=K).integral_growth(time)
    assert set(growth) == {"random_walk", "bias_instability", "rate_random_walk", "rate_ramp"}
    assert growth["random_walk"] == pytest.approx(N * 30.0)
    # The sum of a random walk stepping by K√δt: step j lasts for n − j samples, so that the variance
    # is K²δt³ Σj², which tends to K²t³/3 with a relative excess of 3/2n.
    n = round(time / dt)
    discrete = K * np.sqrt(dt**3 * np.sum(np.arange(1.0, n + 1) ** 2))
    assert growth["rate_random_walk"] == pytest.approx(discrete, rel=1.0 / n)
    assert growth["bias_instability"] == pytest.approx(0.664 * B * time, rel=1e-3)


def test_a_ramp_grows_as_its_integral():
    time = np.linspace(0, 900.0, 9001)
    ramp = 2e-6 * time  # the trapezium rule is exact for a straight line
    growth = NoiseTerms(rate_ramp=2e-6).integral_growth(900.0)
    assert growth["rate_ramp"] == pytest.approx(np.trapezoid(ramp, time), rel=1e-12)
    assert growth["random_walk"] == growth["rate_random_walk"] == 0


def test_growth_keeps_the_shape_of_time():
    growth = NoiseTerms(random_walk=1.0).integral_growth([0.0, 4.0, 9.0])
    np.testing.assert_allclose(growth["random_walk"], [0, 2, 3])
    np.testing.assert_array_equal(growth["rate_random_walk"], [0, 0, 0])
