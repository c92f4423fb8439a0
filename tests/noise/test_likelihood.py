"""The likelihood of a cosine spectrum: maximum, profile, and whether the terms fit at all."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from sensorbook.noise import find_low_pass
from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.likelihood import Likelihood

RATE, SAMPLES = 100.0, 100_000
TERMS = ("quantization", "random_walk", "bias_instability", "rate_random_walk")
LINES = cosine_spectrum(np.random.default_rng([82, 0]).standard_normal(SAMPLES), RATE)
EVERY = np.ones(len(LINES.lines), dtype=bool)


def density(q=0.0, n=0.0, b=0.0, k=0.0):
    """(F,) expected power of the bins of `LINES`, table A6."""
    w = 2 * np.pi * LINES.frequency
    rising = 4 * RATE * np.sin(w / (2 * RATE)) ** 2
    return q**2 * rising + n**2 + b**2 * LINES.flicker / w + k**2 / w**2


def exact(ramp=0.0, scale=1.0, **terms):
    """A spectrum without chance, of noise and a ramp that happen to be orthogonal."""
    power = density(**terms) + ramp**2 * LINES.ramp_square
    return replace(
        LINES,
        density=scale**2 * power[:, None],
        ramp=scale * ramp * LINES.ramp_square[:, None],
    )


def simulated(index, **terms):
    """Bins of independent χ² lines: what the likelihood takes for granted, and nothing else."""
    rng = np.random.default_rng([82, 1, index])
    power = density(**terms) * rng.chisquare(LINES.lines) / LINES.lines
    return replace(LINES, density=power[:, None], ramp=0 * LINES.ramp)


def likelihood(spectrum, low_pass=None, used=EVERY):
    return Likelihood(spectrum, 0, used, low_pass)


MIXTURES = [
    {"n": 1.0},
    {"b": 1.0},
    {"k": 1.0},
    {"q": 1.0},
    {"n": 1.0, "b": 0.5},
    {"n": 1.0, "k": 0.1},
    {"n": 1.0, "b": 0.3, "k": 0.02},
    {"q": 0.01, "n": 1.0, "b": 0.3, "k": 0.02},
]
LETTER = dict(zip("qnbk", TERMS, strict=True))


@pytest.mark.parametrize("terms", MIXTURES, ids=lambda t: "".join(t))
def test_an_exact_spectrum_gives_its_coefficients_back(terms):
    found, deviance = likelihood(exact(**terms)).fit(TERMS)
    for letter, name in LETTER.items():
        # A term that is not there enters relative to what a thousandth of a decade of it would change.
        size = {"q": 1e-2, "n": 1.0, "b": 0.1, "k": 0.01}[letter] * max(terms.values())
        true = terms.get(letter, 0.0)
        assert np.sqrt(found[name]) == pytest.approx(true, rel=1e-5, abs=1e-5 * size)
    assert deviance == pytest.approx(0, abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    n=st.floats(0.1, 10), b=st.floats(0.1, 10), k=st.floats(0.01, 10), scale=st.floats(1e-12, 1e9)
)
def test_mixtures_of_any_size_and_unit(n, b, k, scale):
    found, deviance = likelihood(exact(n=n, b=b, k=k, scale=scale)).fit(TERMS[1:])
    model = likelihood(LINES).model(found) / scale**2
    # Where two terms hardly show each coefficient has fewer digits; their sum has them all.
    np.testing.assert_allclose(model, density(n=n, b=b, k=k), rtol=1e-4)
    assert deviance == pytest.approx(0, abs=1e-5)


def test_a_ramp_is_found_to_its_sign():
    for ramp in (0.01, -0.01):
        found, _ = likelihood(exact(n=1.0, ramp=ramp)).fit((*TERMS, "rate_ramp"))
        assert found["rate_ramp"] == pytest.approx(ramp, rel=1e-6)
        assert found["random_walk"] == pytest.approx(1, rel=1e-6)
        assert found["rate_random_walk"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("index", range(10))
def test_no_coefficient_is_negative_and_the_fit_is_a_maximum(index):
    fit = likelihood(simulated(index, n=1.0, k=0.02))
    found, deviance = fit.fit(TERMS)
    assert min(found.values()) >= 0
    # Neither a step in any coefficient nor leaving one out makes the data likelier.
    for name in TERMS:
        for value in (0.0, 0.98 * found[name], 1.02 * found[name], 1e-6):
            assert fit.fit(TERMS, {name: value})[1] >= deviance - 1e-6 * deviance
    # Twice the log-likelihood of SAMPLES − 1 lines, in bins: one a bin of many lines, more of few.
    assert deviance == pytest.approx(len(LINES.lines), rel=0.4)


def test_deviance_is_that_of_independent_lines():
    spectrum = simulated(20, n=1.0, b=0.3)
    fit = likelihood(spectrum)
    p = spectrum.density[:, 0]
    for names, fixed in ((TERMS, {}), (TERMS[1:], {"random_walk": 1.1}), (TERMS[1:2], {})):
        found, deviance = fit.fit(names, fixed)
        s = fit.model(found)
        expected = np.sum(LINES.lines * (p / s - 1 - np.log(p / s)))
        assert deviance == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", ["random_walk", "bias_instability", "rate_random_walk"])
def test_profile_limits_bracket_where_the_deviance_has_risen(name):
    fit = likelihood(simulated(21, n=1.0, b=0.4, k=0.1))
    names = TERMS[1:]
    squares, deviance = fit.fit(names)
    low, high = fit.profile(names, name, squares, deviance, 3.841)
    assert low < squares[name] < high
    for limit in (low, high):
        # Limits are sought to a hundredth of a standard error, which moves χ² by 2·1.96 of these.
        assert fit.fit(names, {name: limit})[1] - deviance == pytest.approx(3.841, abs=0.05)


def test_profile_of_an_absent_term_begins_at_zero():
    fit = likelihood(exact(n=1.0))
    squares, deviance = fit.fit(TERMS[1:])
    low, high = fit.profile(TERMS[1:], "rate_random_walk", squares, deviance, 3.841)
    assert low == 0
    assert high > 0
    assert fit.fit(TERMS[1:], {"rate_random_walk": high})[1] == pytest.approx(3.841, abs=0.05)


def test_profile_of_n_is_fishers():
    # Of one level alone known from ν lines, N² has the error √(2/ν); K² only frees the lowest lines.
    fit, names = likelihood(exact(n=1.0)), ("random_walk", "rate_random_walk")
    low, high = fit.profile(names, "random_walk", *fit.fit(names), 3.841)
    reach = 1.96 * np.sqrt(2 / LINES.lines.sum())
    # Skewness of χ² moves both ends by a thousandth of N's error, the search by a hundredth.
    assert (1 - low, high - 1) == pytest.approx((reach, reach), rel=0.02)


# ---- does the model fit ----


def test_model_error_is_zero_where_the_model_is_right():
    told = 0
    for index in range(60):
        fit = likelihood(simulated(100 + index, n=1.0, b=0.3, k=0.02))
        told += fit.model_error(fit.fit(TERMS)[0]) > 0
    # One in a thousand by its definition: two or more in 60 have a chance of 0.2 %.
    assert told <= 1


@pytest.mark.parametrize("size", [0.1, 0.3, 1.0])
def test_model_error_of_a_ripple(size):
    # A ripple over every octave that no term follows: of `size` its rms is size/√2.
    ripple = 1 + size * np.sin(9 * np.log(LINES.frequency))
    spectrum = simulated(30, n=1.0)
    spectrum = replace(spectrum, density=spectrum.density * np.maximum(ripple, 0.01)[:, None])
    fit = likelihood(spectrum)
    error = fit.model_error(fit.fit(TERMS)[0])
    # Windows of 20 bins, 0.2 in log f, average a ripple of this pitch to 0.87 of it. Chance of windows of
    # few lines and the cube root of a large departure leave a third.
    assert error == pytest.approx(size / np.sqrt(2), rel=0.35)


def test_what_is_allowed_for_widens_the_profile():
    fit, names = likelihood(exact(n=1.0)), ("random_walk", "rate_random_walk")
    before = fit.profile(names, "random_walk", *fit.fit(names), 3.841)
    fit.allow(0.1)
    after = fit.profile(names, "random_walk", *fit.fit(names), 3.841)
    assert after[0] < before[0] < before[1] < after[1]
    # Some 40 windows, the level of each known to 10 % at best.
    assert after[1] - after[0] > 2 * 1.96 * 0.1 / np.sqrt(len(LINES.lines) / 20)


def test_without_an_error_nothing_is_widened():
    fit = likelihood(exact(n=1.0))
    fit.allow(0.0)
    np.testing.assert_array_equal(fit.lines, LINES.lines)


# ---- low-pass, masks, Gauss–Markov ----


def test_an_error_of_the_low_pass_is_estimated_with_the_terms():
    sos = signal.butter(2, 20.0, fs=RATE, output="sos")
    white = np.random.default_rng([82, 2]).standard_normal(SAMPLES + 2000)
    values = signal.sosfilt(sos, white)[2000:]
    low_pass = find_low_pass(values, RATE)
    wrong = low_pass.shifted(np.full(len(low_pass.coefficients), 0.1))
    spectrum = cosine_spectrum(values, RATE)
    used = spectrum.frequency < 0.8 * low_pass.cutoff
    for shape in (low_pass, wrong):
        fit = Likelihood(spectrum, 0, used, shape)
        n = np.sqrt(fit.fit(TERMS[1:])[0]["random_walk"] * RATE)
        # The floor is 1/RATE; 32 000 lines below 16 Hz know N to 0.4 %, a shape beside it costs as much
        # again. Taken as it is the wrong one would move N by a tenth of its change at 16 Hz.
        assert n == pytest.approx(1, abs=0.02)


def test_bins_left_out_do_not_matter():
    spectrum = simulated(31, n=1.0, b=0.3)
    used = EVERY.copy()
    used[300:400] = False
    spoiled = spectrum.density.copy()
    spoiled[300:400] *= 1e6
    one = likelihood(spectrum, used=used).fit(TERMS)
    other = likelihood(replace(spectrum, density=spoiled), used=used).fit(TERMS)
    assert one == other


def test_gauss_markov_term():
    seconds, sd = 3.0, 2.0
    w = 2 * np.pi * LINES.frequency
    # Density of autocovariance sd² e^−|s|/T.
    process = 2 * sd**2 * seconds / (1 + (w * seconds) ** 2)
    spectrum = replace(LINES, density=(density(n=1.0) + process)[:, None], ramp=0 * LINES.ramp)
    fit = likelihood(spectrum)
    fit.set_correlation_time(seconds)
    found, deviance = fit.fit((*TERMS[1:], "gauss_markov"))
    assert found["random_walk"] == pytest.approx(1, rel=1e-6)
    assert found["gauss_markov"] == pytest.approx(2 * sd**2 / seconds, rel=1e-6)
    assert deviance == pytest.approx(0, abs=1e-6)
