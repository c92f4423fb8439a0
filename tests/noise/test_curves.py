"""Fits of the Allan curve on exact functions and on simulated truth."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sensorbook.errors import Refusal
from sensorbook.noise.allan import AllanCurve, allan_deviation, cluster_sizes
from sensorbook.noise.curves import (
    CurveFit,
    compare_fits,
    fit_aaa,
    fit_physical,
    fit_polynomial,
    fit_rational,
)
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.simulate.noise import coloured_noise

TAU = np.geomspace(0.1, 1000.0, 60)


# ---- what a fit says of itself ----


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_slope_of_each_term(term):
    # A central difference over 2e-4 in log τ: rounding leaves 1e-12/2e-4.
    fit = fit_physical({term.name: 0.3})
    np.testing.assert_allclose(fit.slope(TAU), term.slope, atol=1e-8)
    np.testing.assert_allclose(fit.deviation(TAU) ** 2, 0.3 * term.variance(TAU), rtol=1e-12)


def test_slope_of_a_mixture():
    squares = {"random_walk": 1.0, "rate_random_walk": 0.01}
    variance = NoiseTerms(random_walk=1.0, rate_random_walk=0.1).allan_variance(TAU)
    expected = (0.01 * TAU / 3 - 1 / TAU) / (2 * variance)
    np.testing.assert_allclose(fit_physical(squares).slope(TAU), expected, atol=1e-7)


def test_residual_is_in_decades_and_missing_where_the_fit_is_not_positive():
    fit = CurveFit("line", "raw", lambda tau: tau - 1.0)
    residual = fit.residual(np.array([0.5, 1.0, 11.0]), np.array([1.0, 1.0, 1.0]))
    np.testing.assert_allclose(residual, [np.nan, np.nan, 1.0])
    assert np.isnan(fit.slope(np.array([0.5]))).all()


# ---- polynomials ----


def test_polynomial_is_recovered_in_raw_variables():
    sigma = 3 - 2e-3 * TAU + 2e-6 * TAU**2
    fit = fit_polynomial(TAU, sigma, 5)
    assert (fit.name, fit.variables, fit.poles) == ("polynomial, degree 5", "raw", ())
    np.testing.assert_allclose(fit.deviation(TAU), sigma, rtol=1e-9)


def test_polynomial_is_recovered_in_logarithms():
    x = np.log(TAU)
    fit = fit_polynomial(TAU, np.exp(-3 - 0.4 * x + 0.05 * x**2), 2, logarithmic=True)
    assert fit.variables == "log"
    np.testing.assert_allclose(fit.slope(TAU), -0.4 + 0.1 * x, atol=1e-8)


def test_raw_polynomials_fail_where_their_logarithmic_twins_do_not():
    """Work A's finding (7.3): the degrees 5, 10 and 20 come nearer, and none is near."""
    sigma = np.sqrt(NoiseTerms(0, 1.0, 0.2, 0.02).allan_variance(TAU))
    missed = []
    for degree in (5, 10, 20):
        raw, log = (fit_polynomial(TAU, sigma, degree, way) for way in (False, True))
        missed.append(np.sqrt(np.mean((raw.deviation(TAU) - sigma) ** 2)))
        assert np.nanmax(np.abs(raw.residual(TAU, sigma))) > 0.2
        assert np.abs(log.residual(TAU, sigma)).max() < 0.02
    assert missed[0] > missed[1] > missed[2]


# ---- rational functions ----

ABOVE, BELOW = np.array([2.0, 0.5, 0.01, 1e-6, 1e-9]), np.array([1.0, 3.0, 0.2])


def test_rational_function_is_recovered_in_raw_variables():
    sigma = np.polynomial.polynomial.polyval(TAU, ABOVE)
    sigma = sigma / np.polynomial.polynomial.polyval(TAU, BELOW)
    fit = fit_rational(TAU, sigma)
    assert (fit.name, fit.variables, fit.poles) == ("rational 4/2", "raw", ())
    # Poles at −0.34 and −14.7 on a range of 1000: the linear problem loses half its digits.
    np.testing.assert_allclose(fit.deviation(TAU), sigma, rtol=1e-6)


def test_rational_function_is_recovered_in_logarithms():
    x = np.log(TAU)
    log_sigma = (x**4 / 50 - x**2 + x - 30) / ((x - 2) ** 2 + 9)
    fit = fit_rational(TAU, np.exp(log_sigma), logarithmic=True)
    assert fit.poles == ()
    between = np.sqrt(TAU[1:] * TAU[:-1])
    u = np.log(between)
    expected = (u**4 / 50 - u**2 + u - 30) / ((u - 2) ** 2 + 9)
    np.testing.assert_allclose(np.log(fit.deviation(between)), expected, rtol=1e-8)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_rational_fit_does_not_depend_on_the_unit(scale):
    sigma = np.sqrt(NoiseTerms(0, 1.0, 0.2, 0.02).allan_variance(TAU))
    one, other = fit_rational(TAU, sigma), fit_rational(TAU, scale * sigma)
    np.testing.assert_allclose(other.deviation(TAU), scale * one.deviation(TAU), rtol=1e-6)


def test_rational_fit_is_nearly_exact_on_an_allan_curve():
    """Work A's finding (7.3), in its raw variables."""
    sigma = np.sqrt(NoiseTerms(0, 1.0, 0.2, 0.02).allan_variance(TAU))
    fit = fit_rational(TAU, sigma)
    assert fit.poles == ()
    assert np.abs(fit.residual(TAU, sigma)).max() < 0.05


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize(("at", "inside"), [(30.0, True), (0.02, False), (3000.0, False)])
def test_a_pole_is_flagged_where_it_lies_among_the_data(logarithmic, at, inside):
    x, pole = (np.log(TAU), np.log(at)) if logarithmic else (TAU, at)
    y = 2 + 0.1 * (x[-1] - x[0]) / (x - pole)
    # log σ takes any sign; σ itself is fitted as it is, positive or not
    fit = fit_rational(TAU, np.exp(y) if logarithmic else y, 2, 1, logarithmic)
    assert fit.poles == (pytest.approx((at,), rel=1e-6) if inside else ())


def test_complex_poles_near_the_axis_are_flagged_and_distant_ones_are_not():
    x = np.log(TAU)  # points 0.16 apart
    for width, flagged in ((0.05, True), (0.5, False)):
        y = 1 / ((x - 2) ** 2 + width**2)
        fit = fit_rational(TAU, np.exp(y / y.max()), 2, 2, logarithmic=True)
        assert bool(fit.poles) == flagged
        if flagged:
            assert fit.poles == pytest.approx((np.exp(2),), rel=1e-6)


# ---- AAA ----


def test_aaa_recovers_a_rational_function_of_log_tau():
    x = np.log(TAU)
    fit = fit_aaa(TAU, np.exp(x / (x**2 + 4)), 1e-10)
    assert (fit.name, fit.variables, fit.poles) == ("AAA", "log", ())
    between = np.sqrt(TAU[1:] * TAU[:-1])
    u = np.log(between)
    np.testing.assert_allclose(np.log(fit.deviation(between)), u / (u**2 + 4), atol=1e-9)


def test_aaa_flags_a_pole_among_the_data():
    fit = fit_aaa(TAU, np.exp(0.1 / (np.log(TAU) - 1.0)), 1e-10)
    assert fit.poles == pytest.approx((np.e,), rel=1e-6)


def test_aaa_stops_at_the_tolerance():
    sigma = np.sqrt(NoiseTerms(0, 1.0, 0.2, 0.02).allan_variance(TAU))
    missed = [np.abs(fit_aaa(TAU, sigma, t).residual(TAU, sigma)).max() for t in (0.1, 1e-3)]
    assert 1e-3 < missed[0] * np.log(10) < 0.1
    assert missed[1] * np.log(10) < 1e-3


# ---- too few points ----


@pytest.mark.parametrize("fit", [lambda t: fit_polynomial(t, t, 6), lambda t: fit_rational(t, t)])
def test_more_coefficients_than_points_are_refused(fit):
    with pytest.raises(
        ValueError, match="7 coefficients need more than 7 cluster times; the curve has 7"
    ):
        fit(TAU[:7])


# ---- comparison ----

TRUTH = {"random_walk": 1.0, "bias_instability": 0.3, "rate_random_walk": None}


@cache
def compared(truth=True):
    rng = np.random.default_rng(411)
    values = coloured_noise(200_000, 50.0, rng, random_walk=1.0, bias_instability=0.3)
    curve = allan_deviation(values, 50.0)
    return compare_fits(curve, "x", fit_terms(curve).axes[0], truth=TRUTH if truth else None)


def test_every_fit_has_its_row():
    names = [(r.fit.name, r.fit.variables) for r in compared().rows]
    polynomials = [f"polynomial, degree {d}" for d in (5, 10, 20)]
    assert names == [
        *((name, "raw") for name in (*polynomials, "rational 4/2")),
        *((name, "log") for name in (*polynomials, "rational 4/2", "AAA", "smoothing spline")),
        ("sum of noise terms", "variance"),
    ]
    assert compared().row("AAA", "log") is compared().rows[8]
    assert compared().row("AAA", "raw") is None
    assert len(compared().table()) == len(names)


def test_measures_are_those_of_the_fit():
    c = compared()
    row = c.row("rational 4/2", "log")
    residual = np.log10(row.fit.deviation(c.tau) / c.sigma)
    assert row.rms == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert row.largest == pytest.approx(np.abs(residual).max())
    true = fit_physical({"random_walk": 1.0, "bias_instability": 0.09}).slope(c.tau)
    assert row.slope_error == pytest.approx(np.sqrt(np.mean((row.fit.slope(c.tau) - true) ** 2)))
    assert row.sound == (not row.fit.poles)
    low, high = c.band.T
    assert (low < c.sigma).all()
    assert (c.sigma < high).all()


def test_a_fit_that_is_positive_at_the_points_alone_is_not_sound():
    rows = [r for r in compared().rows if r.not_positive]
    assert rows, "the raw polynomials swing below zero"
    for row in rows:
        assert not row.sound
        tau = np.geomspace(compared().tau[0], compared().tau[-1], 5000)
        # Another grid: the ends of each stretch may differ by a point.
        assert row.not_positive == pytest.approx(np.mean(row.fit.deviation(tau) <= 0), abs=0.01)


def test_the_order_of_merit_on_a_simulated_record():
    c = compared()
    assert c.reference == "truth"
    raw = [c.row(f"polynomial, degree {d}", "raw") for d in (5, 10, 20)]
    # Work A's polynomials miss by a tenth of a decade and more; between the points they swing.
    assert all(r.rms > 0.05 and r.slope_error > 1 for r in raw)
    assert c.row("rational 4/2", "raw").rms < 0.05
    physical = c.row("sum of noise terms", "variance")
    # Two terms known to a few per cent: their slope is the best of all.
    assert physical.slope_error < 0.02
    assert physical.slope_error == min(r.slope_error for r in c.rows)
    # Twenty degrees follow chance: nearer to the points used, further from those between.
    wild, calm = c.row("polynomial, degree 20", "log"), c.row("polynomial, degree 5", "log")
    assert wild.rms < calm.rms
    assert wild.held_out > 3 * wild.rms
    assert calm.held_out < 2 * calm.rms


def test_without_truth_the_fitted_terms_are_the_reference():
    c = compared(truth=False)
    assert c.reference == "fitted terms"
    assert c.row("sum of noise terms", "variance").slope_error is None
    assert all(r.slope_error > 0 for r in c.rows[:-1])


def test_results_are_plain():
    for c in (compared(), compared(truth=False)):
        results = json.loads(json.dumps(c.to_results(), allow_nan=False))
        assert [r["name"] for r in results] == [r.fit.name for r in c.rows]
        assert all(r["residual_rms_decades"] >= 0 for r in results)


def exact(variance, samples=720_000, rate=100.0):
    m = cluster_sizes(samples, rate)
    sigma = np.sqrt(variance(m / rate))[:, None]
    return AllanCurve(m / rate, m, sigma, samples - 2 * m + 1, samples, rate)


def test_the_low_pass_is_left_out_and_its_trace_accounted_for():
    t_c = 0.012
    # Near t_c itself the formula is not meant; those cluster times are left out.
    curve = exact(lambda tau: 1 / tau * np.where(tau > 3 * t_c, 1 - t_c / tau, 1.0))
    noise = replace(
        fit_terms(exact(NoiseTerms(random_walk=1.0).allan_variance)).axes[0],
        squares={"random_walk": 1.0},
    )
    low_pass = LowPass(20.0, t_c, 1e-4, 20.0, {2: 1.0})
    c = compare_fits(curve, "x", noise, low_pass, truth={"random_walk": 1.0})
    assert c.tau[0] >= 2 / 20.0
    row = c.row("sum of noise terms", "variance")
    assert row.rms < 1e-12
    assert row.slope_error < 1e-8
    assert c.row("polynomial, degree 20", "log").slope_error < 1e-3


def test_a_short_curve_goes_without_the_fits_it_cannot_carry():
    values = np.random.default_rng(412).normal(size=1000)
    curve = allan_deviation(values, 1.0)
    assert len(curve.tau) == 26  # more than twice 11 coefficients, not twice 21
    c = compare_fits(curve, "x", fit_terms(curve).axes[0])
    for way in ("raw", "log"):
        assert c.row("polynomial, degree 20", way) is None
        assert c.row("polynomial, degree 10", way) is not None
        assert c.row("rational 4/2", way) is not None
    # Without them no fit that is kept has a slope of nonsense, in logarithms.
    assert all(r.slope_error < 5 for r in c.rows if r.sound and r.fit.variables == "log")
    json.dumps(c.to_results(), allow_nan=False)


def test_a_curve_with_hardly_a_point_outside_the_low_pass_is_refused():
    values = np.random.default_rng(413).normal(size=1000)
    curve = allan_deviation(values, 1.0)
    noise = fit_terms(curve).axes[0]
    kept = curve.tau[-14:]
    with pytest.raises(Refusal) as refused:
        compare_fits(curve, "x", noise, LowPass(2 / kept[0], 0.1, 1e-3, 0.5, {2: 1.0}))
    assert refused.value.reason == (
        "Axis x: the Allan curve has 14 cluster times outside the low-pass's reach; "
        "curve fits need at least 15."
    )
    with_one_more = LowPass(2 / curve.tau[-15], 0.1, 1e-3, 0.5, {2: 1.0})
    assert compare_fits(curve, "x", noise, with_one_more).row("rational 4/2", "raw")
