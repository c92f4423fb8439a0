"""Noise terms from Allan curves of simulated truth."""

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook.noise import (
    TERMS,
    AllanCurve,
    NoiseTerms,
    against_truth,
    allan_deviation,
    cluster_sizes,
    find_low_pass,
    fit_terms,
    read_off,
)
from sensorbook.noise.estimate import FIT_REACH
from sensorbook.simulate.noise import coloured_noise

DEGREE = np.pi / 180


def exact_curve(terms: NoiseTerms, samples=720_000, rate=100.0, sensor="") -> AllanCurve:
    """The curve that the terms have on average, without chance."""
    m = cluster_sizes(samples, rate)
    tau = m / rate
    sigma = np.sqrt(terms.allan_variance(tau))[:, None]
    return AllanCurve(tau, m, sigma, samples - 2 * m + 1, samples, rate, sensor)


def fit(values, rate, low_pass=None, sensor="gyroscope"):
    curve = allan_deviation(values, rate, sensor=sensor)
    return fit_terms(curve, [low_pass] if low_pass else ()).axes[0]


# ---- coverage of the intervals ----

TRUTH = {"random_walk": 1.0, "bias_instability": 0.25, "rate_random_walk": 0.02}
RECORDS = 24


@cache
def records(walk):
    """Fits of 24 records of 5.6 h: N rules to 36 s, B to 200 s, then K of the given size."""
    found = []
    for i in range(RECORDS):
        rng = np.random.default_rng([4711, i, round(1000 * walk)])
        noise = coloured_noise(200_000, 10.0, rng, **{**TRUTH, "rate_random_walk": walk})
        found.append(fit(noise, 10.0))
    return found


def clean_fits():
    return records(TRUTH["rate_random_walk"])


def holds(axis, name, true):
    e = axis.terms[name]
    return e.low <= true <= e.high if e else true <= axis.upper_bounds[name]


def near(e, true):
    """Within twice the interval's reach, four standard errors: for a claim on every single record."""
    return 2 * e.low - e.value <= true <= 2 * e.high - e.value


def test_intervals_hold_the_truth():
    hits = {n: sum(holds(a, n, true) for a in clean_fits()) for n, true in TRUTH.items()}
    # Nominal 95 % of 72; their standard deviation is 1.85, so that 88 % is 2.7 of them below.
    assert sum(hits.values()) >= 0.88 * RECORDS * len(TRUTH), hits
    # No term may carry the others: at 95 %, fewer than 19 of 24 has a chance of 0.1 %.
    assert min(hits.values()) >= 19, hits


def test_intervals_are_not_needlessly_wide():
    # 20 000 independent clusters at 1 s know N to 0.5 %.
    widths = [
        np.median([a.terms[n].high / a.terms[n].low for a in clean_fits() if a.terms[n]])
        for n in TRUTH
    ]
    assert widths[0] < 1.02
    # From 200 s on 20 000 s hold 100 clusters, half of which tell K from B: 10 % and more of each.
    assert widths[1] < 2
    assert widths[2] < 3


def test_estimates_are_unbiased():
    for name, true in TRUTH.items():
        squares = np.array([a.squares.get(name, 0.0) for a in clean_fits()])
        error = squares.std(ddof=1) / np.sqrt(RECORDS)
        # The squares are what is linear in the data; the choice of terms costs K some of its mean.
        assert abs(squares.mean() - true**2) < 4 * error + 0.03 * true**2, name


def test_present_terms_are_stated_and_absent_ones_are_not():
    stated = {n: sum(a.terms[n] is not None for a in clean_fits()) for n in TERMS}
    assert stated["random_walk"] == RECORDS
    assert stated["bias_instability"] >= RECORDS - 2
    assert stated["rate_random_walk"] >= RECORDS - 2
    assert stated["quantization"] == 0
    # 24 decisions and more stand in a device's report, which shall rarely hold a false one.
    assert stated["rate_ramp"] <= 1
    for axis in clean_fits():
        assert set(axis.upper_bounds) == {n for n, e in axis.terms.items() if e is None}
        assert all(0 < bound < np.inf for bound in axis.upper_bounds.values())


@pytest.mark.parametrize("walk", [0.02, 0.01])
def test_no_misfit_on_clean_data(walk):
    # At 0.01 the random walk is barely visible, but the records hold nothing that is no term.
    told = {i: a.misfit for i, a in enumerate(records(walk)) if a.misfit}
    assert told == {}


def test_a_walk_barely_visible_is_no_ramp():
    assert sum(a.terms["rate_ramp"] is not None for a in records(0.01)) <= 1


# ---- single terms, present and absent ----


@pytest.mark.parametrize(
    "present",
    [
        {"random_walk": 1.0},
        {"quantization": 0.5, "random_walk": 1.0, "bias_instability": 0.4},
        {"random_walk": 1.0, "bias_instability": 0.3, "rate_random_walk": 0.03},
        {"random_walk": 1.0, "rate_random_walk": 0.1},
        {"random_walk": 1.0, "rate_ramp": 3e-3},
        {
            "quantization": 0.5,
            "random_walk": 1.0,
            "bias_instability": 0.3,
            "rate_random_walk": 0.03,
        },
    ],
    ids=lambda present: "".join(TERMS[n].symbol for n in present),
)
def test_exact_curve_gives_its_terms_back(present):
    axis = fit_terms(exact_curve(NoiseTerms(**present))).axes[0]
    assert axis.misfit is None
    assert {n for n, e in axis.terms.items() if e} == set(present)
    for name, true in present.items():
        # Least squares on data without error, solved by non-negative least squares.
        assert axis.terms[name].value == pytest.approx(true, rel=1e-6), name
        assert axis.terms[name].low < true < axis.terms[name].high
        assert getattr(axis.coefficients, name) == axis.terms[name].value


@pytest.mark.parametrize("seed", range(4))
def test_rate_random_walk_is_null_with_a_bound_when_absent(seed):
    rng = np.random.default_rng([61, seed])
    axis = fit(coloured_noise(200_000, 10.0, rng, random_walk=1.0, bias_instability=0.2), 10.0)
    assert axis.terms["rate_random_walk"] is None
    assert axis.coefficients.rate_random_walk == 0.0
    # At the longest cluster time (4000 s) a walk has 2.8 degrees of freedom, of which chance leaves a
    # tenth once in twenty: the bound's σ² there may be ten times the measured one, and that in turn
    # some twice the flat.
    bound = axis.upper_bounds["rate_random_walk"]
    flat = 2 * np.log(2) / np.pi * 0.2**2
    assert 0 < bound**2 * 4000 / 3 < 20 * flat


@pytest.mark.parametrize("seed", range(4))
def test_rate_random_walk_is_found_when_strong(seed):
    rng = np.random.default_rng([62, seed])
    axis = fit(coloured_noise(200_000, 10.0, rng, random_walk=1.0, rate_random_walk=0.05), 10.0)
    found = axis.terms["rate_random_walk"]
    # From where K rules (τ = 35 s) 20 000 s hold some 500 clusters: σ² to 6 %, K to 3 %.
    assert found.value == pytest.approx(0.05, rel=0.15)
    assert found.low < found.value < found.high
    assert axis.terms["random_walk"].value == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_ramp_is_found(seed):
    rng = np.random.default_rng([63, seed])
    n, rate, ramp = 40_000, 10.0, -2e-3
    values = np.sqrt(rate) * rng.standard_normal(n) + ramp * np.arange(n) / rate
    axis = fit(values, rate)
    found = axis.terms["rate_ramp"]
    # A straight line through white noise has a slope known to √(12 N²/T³) = 1.4e-5, 0.7 %.
    assert found.value == pytest.approx(abs(ramp), rel=0.05)
    assert near(found, abs(ramp))
    assert axis.terms["rate_random_walk"] is None


@pytest.mark.parametrize("seed", range(4))
def test_quantisation_is_found_on_differenced_white_noise(seed):
    rng = np.random.default_rng([64, seed])
    n, rate, q = 200_000, 100.0, 0.05
    values = q * rate * np.diff(rng.standard_normal(n + 1)) + np.sqrt(rate) * rng.standard_normal(n)
    axis = fit(values, rate)
    found = axis.terms["quantization"]
    assert found.value == pytest.approx(q, rel=0.03)
    assert near(found, q)
    assert axis.terms["random_walk"].value == pytest.approx(1.0, rel=0.03)
    assert axis.misfit is None


@pytest.mark.parametrize("seed", range(4))
def test_white_noise_alone(seed):
    values = 10.0 * np.random.default_rng([65, seed]).standard_normal(200_000)
    axis = fit(values, 100.0)
    assert {n for n, e in axis.terms.items() if e} == {"random_walk"}
    # N² is a mean over 200 000 samples at the least: N to 0.16 % and more.
    assert axis.terms["random_walk"].value == pytest.approx(1.0, rel=0.01)


# ---- low-pass ----


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_low_pass_is_not_quantisation(seed, given):
    rng = np.random.default_rng([66, seed])
    values = coloured_noise(
        360_000, 100.0, rng, random_walk=1.0, bias_instability=0.2, bandwidth=20.0
    )
    low_pass = find_low_pass(values, 100.0) if given else None
    axis = fit(values, 100.0, low_pass)
    assert axis.terms["quantization"] is None
    if given:
        # Without it the shortest cluster times, which the filter bends, are in the fit.
        assert axis.squares["quantization"] < 0
        assert axis.tau_range[0] >= FIT_REACH / low_pass.cutoff
        assert axis.terms["random_walk"].value == pytest.approx(1.0, rel=0.03)
        assert axis.misfit is None


def test_one_low_pass_an_axis():
    curve = allan_deviation(np.random.default_rng(67).normal(size=(2000, 3)), 10.0)
    with pytest.raises(ValueError, match="shorter"):
        fit_terms(curve, [None, None])


# ---- departures ----


@pytest.mark.parametrize("frequency", [0.02, 0.2])
def test_a_sinusoid_is_told_with_its_cluster_time(frequency):
    rng = np.random.default_rng([68, round(100 * frequency)])
    n, rate = 200_000, 20.0
    hump = 0.3710 / frequency  # sin²x/x is largest at x = πfτ = 1.1656
    noise = coloured_noise(n, rate, rng, random_walk=1.0, bias_instability=0.05)
    # Twice the white noise's σ at the hump, where the sinusoid's is 0.725 of its amplitude.
    amplitude = 2 * np.sqrt(1 / hump) / 0.725
    values = noise + amplitude * np.sin(2 * np.pi * frequency * np.arange(n) / rate)
    axis = fit(values, rate)
    low, high = axis.misfit.tau_range
    assert low <= hump <= high
    # The worst place is the hump or the notch at one whole period, and the message names it.
    assert 0.5 * hump <= axis.misfit.tau <= 1.2 / frequency
    assert abs(axis.misfit.size) > 0.2
    # What the terms miss widens the interval, so that N is not claimed better than it is known.
    clean = fit(noise, rate).terms["random_walk"]
    told = axis.terms["random_walk"]
    assert told.high / told.low > clean.high / clean.low


# ---- scaling ----


@cache
def one_record():
    rng = np.random.default_rng(69)
    return coloured_noise(
        20_000, 10.0, rng, random_walk=1.0, bias_instability=0.2, rate_random_walk=0.05
    )


@settings(max_examples=6, deadline=None)
@given(exponent=st.floats(-8, 4), negative=st.booleans())
def test_scale_equivariance(exponent, negative):
    scale = 10.0**exponent
    one, other = fit(one_record(), 10.0), fit((-scale if negative else scale) * one_record(), 10.0)
    for name in TERMS:
        a, b = one.terms[name], other.terms[name]
        assert (a is None) == (b is None)
        if a:
            for part in ("value", "low", "high"):
                assert getattr(b, part) == pytest.approx(scale * getattr(a, part), rel=1e-5)
        else:
            assert other.upper_bounds[name] == pytest.approx(
                scale * one.upper_bounds[name], rel=1e-5
            )
    np.testing.assert_allclose(other.edf, one.edf, rtol=1e-6)
    np.testing.assert_allclose(other.band, scale * one.band, rtol=1e-6)


@settings(max_examples=6, deadline=None)
@given(exponent=st.integers(-6, 6))
def test_time_equivariance(exponent):
    # The same numbers at another rate: σ stays, τ stretches, each coefficient by its own power of it.
    stretch = 2.0**exponent
    one = allan_deviation(one_record(), 10.0)
    other = AllanCurve(
        one.tau * stretch,
        one.clusters,
        one.deviation,
        one.terms,
        one.samples,
        one.rate / stretch,
    )
    a, b = fit_terms(one).axes[0], fit_terms(other).axes[0]
    for name, term in TERMS.items():
        assert (a.terms[name] is None) == (b.terms[name] is None)
        if a.terms[name]:
            expected = a.terms[name].value * stretch**-term.slope
            assert b.terms[name].value == pytest.approx(expected, rel=1e-5)


# ---- results ----


@pytest.mark.parametrize(
    ("sensor", "units"),
    [
        (
            "gyroscope",
            ["rad", "rad/s/sqrt(Hz)", "rad/s", "rad/s^2/sqrt(Hz)"],
        ),
        (
            "accelerometer",
            ["m/s", "m/s^2/sqrt(Hz)", "m/s^2", "m/s^3/sqrt(Hz)"],
        ),
    ],
)
def test_results(sensor, units):
    terms = NoiseTerms(0.5, 1.0, 0.3, 0.03)
    estimate = fit_terms(exact_curve(terms, sensor=sensor))
    results = estimate.to_results()
    json.dumps(results, allow_nan=False)
    x = results["x"]
    assert set(x) == {*TERMS, "noise_density", "upper_bounds"}
    assert [x[n]["unit"] for n in TERMS if x[n]] == units
    assert x["rate_ramp"] is None
    assert set(x["upper_bounds"]) == {"rate_ramp"}
    assert x["noise_density"]["unit"] == units[1]
    for part in ("value", "low", "high"):
        assert x["noise_density"][part] == pytest.approx(np.sqrt(2) * x["random_walk"][part])
        assert type(x["random_walk"][part]) is float
    assert x["random_walk"]["low"] < x["random_walk"]["value"] < x["random_walk"]["high"]
    assert estimate["x"] is estimate.axes[0]


def test_results_of_three_axes_with_absent_terms():
    rng = np.random.default_rng(70)
    values = np.stack(
        [coloured_noise(20_000, 10.0, rng, random_walk=s) for s in (1.0, 2.0, 3.0)], axis=1
    )
    values[:, 2] += 2.0 * np.sin(2 * np.pi * 0.05 * np.arange(20_000) / 10)
    curve = allan_deviation(values, 10.0, sensor="gyroscope")
    estimate = fit_terms(curve)
    results = estimate.to_results()
    json.dumps(results, allow_nan=False)
    assert list(results) == ["x", "y", "z"]
    for axis, size in (("x", 1.0), ("y", 2.0)):
        entry = results[axis]
        assert entry["random_walk"]["value"] == pytest.approx(size, rel=0.03)
        null = {n for n in TERMS if entry[n] is None}
        assert null == set(TERMS) - {"random_walk"} == set(entry["upper_bounds"])
        assert "misfit" not in entry
    assert set(results["z"]["misfit"]) == {"tau_range", "tau", "size"}
    assert estimate["z"].misfit.tau == results["z"]["misfit"]["tau"]
    # Nothing but chance separates the measured curve from its own band.
    for i, axis in enumerate(estimate.axes):
        low, high = axis.band.T
        assert axis.edf.shape == curve.tau.shape
        assert (low < curve.deviation[:, i]).all()
        assert (curve.deviation[:, i] < high).all()


def test_noise_density_is_null_with_the_random_walk():
    # A walk in steps of 1/32 s, averaged over each second: sampled at whole seconds it would hold
    # white noise of its own, N² = K²δt²/6.
    steps = np.random.default_rng(71).standard_normal((20_000, 32)) / np.sqrt(32)
    values = np.cumsum(steps).reshape(steps.shape).mean(axis=1)
    results = fit_terms(allan_deviation(values, 1.0, sensor="gyroscope")).to_results()["x"]
    assert results["random_walk"] is None
    assert results["noise_density"] is None
    assert "random_walk" in results["upper_bounds"]
    assert results["rate_random_walk"]["value"] == pytest.approx(1.0, rel=0.05)


def test_table_frame_and_html():
    n = 0.3 * DEGREE / 60  # 0.3 °/√h
    estimate = fit_terms(exact_curve(NoiseTerms(random_walk=n), 2000, 10.0, "gyroscope"))
    table = estimate.table()
    assert list(table.columns) == ["x"]
    assert list(table.index) == [
        "Q, quantization [°]",
        "N, random walk [°/√h]",
        "B, bias instability [°/h]",
        "K, rate random walk [°/h/√s]",
        "R, rate ramp [°/h/s]",
    ]
    assert table.loc["N, random walk [°/√h]", "x"].startswith("0.3 (0.29")
    assert table.loc["K, rate random walk [°/h/√s]", "x"].startswith("none visible (< ")
    frame = estimate.to_frame().set_index("term")
    assert frame.loc["random walk", "value"] == pytest.approx(0.3, rel=1e-6)
    assert frame.loc["random walk", "unit"] == "°/√h"
    assert frame.loc["random walk", "low"] < 0.3 < frame.loc["random walk", "high"]
    assert np.isnan(frame.loc["random walk", "upper bound"])
    assert np.isnan(frame.loc["rate random walk", "value"])
    assert frame.loc["rate random walk", "upper bound"] > 0
    html = estimate._repr_html_()
    assert "0.3 (0.29" in html
    assert "none visible (&lt; " in html


# ---- work A's read-off ----


@pytest.mark.parametrize("seed", range(6))
def test_read_off_of_white_noise(seed):
    values = np.sqrt(10.0) * np.random.default_rng([72, seed]).standard_normal(200_000)
    curve = allan_deviation(values, 10.0, sensor="gyroscope")
    terms = read_off(curve).axes[0].terms
    found = terms["random_walk"]
    assert found.value == pytest.approx(1.0, rel=0.02)
    assert found.low < found.value < found.high
    assert terms["bias_instability"] is None
    assert terms["rate_random_walk"] is None


def test_a_term_without_a_range_is_not_said_to_be_invisible():
    n = 0.3 * DEGREE / 60  # 0.3 °/√h
    curve = exact_curve(NoiseTerms(random_walk=n), 2000, 10.0, "gyroscope")
    read, fit = read_off(curve), fit_terms(curve)
    assert read.axes[0].terms["rate_random_walk"] is None
    assert read.table().loc["K, rate random walk [°/h/√s]", "x"] == "no range"
    truth = {"noise": {"gyroscope": {"x": {"random_walk": n, "rate_random_walk": None}}}}
    shown = against_truth(truth, read, fit).loc[("x", "K [°/h/√s]")]
    assert (shown["truth"], shown["read off"], shown["allan fit"]) == ("none", "no range", "none")


def test_read_off_of_a_random_walk():
    values = np.cumsum(np.random.default_rng(73).standard_normal(200_000)) * np.sqrt(0.1) * 0.5
    terms = read_off(allan_deviation(values, 10.0)).axes[0].terms
    # The lowest point is at the shortest cluster times, which weigh most: K to a per cent or two,
    # less the share a sampled walk lacks there.
    assert terms["rate_random_walk"].value == pytest.approx(0.5, rel=0.06)
    assert terms["random_walk"] is None


A_X = {
    "gyroscope": (0.245 * DEGREE / 60, 7.56 * DEGREE / 3600, 1.8 * DEGREE / 3600, 1.5),
    "accelerometer": (0.128e-3 * 9.80665, 0.03e-3 * 9.80665, 9.07 * 3600**-1.5, 1.6),
}


@pytest.mark.parametrize("sensor", A_X)
def test_read_off_of_b_holds_a_share_of_n_and_k(sensor):
    n, b, k, factor = A_X[sensor]
    curve = exact_curve(NoiseTerms(0, n, b, k), sensor=sensor)
    terms = read_off(curve).axes[0].terms
    # A6: 1.5 and 1.6 times too large on A's X axes, without any chance in it.
    assert terms["bias_instability"].value / b == pytest.approx(factor, abs=0.1)
    # The fit separates them: the same curve gives B back.
    assert fit_terms(curve).axes[0].terms["bias_instability"].value == pytest.approx(b, rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_read_off_of_b_on_a_simulated_record(seed):
    n, b, k, _ = A_X["gyroscope"]
    rng = np.random.default_rng([74, seed])
    values = coloured_noise(
        144_000, 20.0, rng, random_walk=n, bias_instability=b, rate_random_walk=k
    )
    found = read_off(allan_deviation(values, 20.0)).axes[0].terms["bias_instability"]
    assert 1.2 < found.value / b < 1.7


def test_read_off_masks_the_low_pass():
    rng = np.random.default_rng(75)
    values = coloured_noise(200_000, 100.0, rng, random_walk=1.0, bandwidth=20.0)
    curve = allan_deviation(values, 100.0)
    low_pass = find_low_pass(values, 100.0)
    axis = read_off(curve, [low_pass]).axes[0]
    assert axis.tau_range[0] >= 10 / low_pass.cutoff
    assert axis.terms["random_walk"].value == pytest.approx(1.0, rel=0.02)
