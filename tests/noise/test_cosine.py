"""The cosine spectrum: what its lines are for each noise, and how bins gather them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import fft, integrate

from sensorbook.noise.cosine import cosine_spectrum, flicker_lines

RATE = 100.0


def covariance_of_lines(covariance):
    """Covariance of the lines j = 1 … n−1 of a signal with this covariance."""
    return fft.dct(fft.dct(covariance, norm="ortho", axis=0), norm="ortho", axis=1)[1:, 1:]


def test_lines_of_a_random_walk_are_independent():
    n = 64
    k = np.arange(1, n + 1)
    lines = covariance_of_lines(np.minimum.outer(k, k).astype(float))
    # The density of a cumulated sum of unit steps, 1/(4 sin²) per sample.
    expected = 1 / (4 * np.sin(np.pi * np.arange(1, n) / (2 * n)) ** 2)
    np.testing.assert_allclose(np.diag(lines), expected, rtol=1e-11)
    np.fill_diagonal(lines, 0)
    # The largest line is 4e2.
    assert np.abs(lines).max() < 1e-9


def test_spectrum_of_a_random_walk_has_no_leakage():
    # The periodogram of such records lies above the density by that of the step from end to start.
    steps = np.random.default_rng([81, 1]).standard_normal((4096, 50))
    spectrum = cosine_spectrum(np.cumsum(steps, axis=0), RATE)
    exact = 1 / RATE / (4 * np.sin(np.pi * spectrum.frequency / RATE) ** 2)
    ratio = spectrum.density.mean(axis=1) / exact
    # 50 records of `lines` each; a bin's width of 1 % costs 1e-4.
    spread = np.sqrt(2 / (50 * spectrum.lines))
    assert np.abs((ratio - 1) / spread).max() < 4.5
    assert abs(np.average(ratio, weights=spectrum.lines) - 1) < 4 * np.sqrt(2 / (50 * 4095))


def test_level_of_white_noise():
    values = 0.3 * np.random.default_rng([81, 2]).standard_normal((200_000, 2))
    spectrum = cosine_spectrum(values, RATE)
    level = np.average(spectrum.density, axis=0, weights=spectrum.lines)
    # Two-sided density: variance over rate. 200 000 lines know it to 0.3 %.
    np.testing.assert_allclose(level, 0.09 / RATE, rtol=4 * np.sqrt(2 / 200_000))


def test_power_is_the_variance():
    # Parseval, exact: a line is 1/(2 n δt) wide and S two-sided.
    values = np.random.default_rng([81, 3]).standard_normal(3001).cumsum() + 5.0
    spectrum = cosine_spectrum(values, RATE)
    power = np.sum(spectrum.density[:, 0] * spectrum.lines) * RATE / len(values)
    assert power == pytest.approx(values.var(), rel=1e-12)


@pytest.mark.parametrize("j", [1, 2, 3, 10])
def test_flicker_lines_by_quadrature(j):
    # |Φ_j|² of √2 cos πjt on 0 … 1 at the angular frequency w, cut at zeros of sin(w + πj).
    a = np.pi * j

    def window(w):
        half = [np.sinc((w + s * a) / (2 * np.pi)) * np.exp(-0.5j * s * a) for s in (-1, 1)]
        return np.abs(half[0] + half[1]) ** 2 / 2

    edges = np.arange(0, 2000) * np.pi
    parts = [integrate.quad(lambda w: window(w) / w, *e)[0] for e in pairwise(edges)]
    # ∫ |Φ|²/w dw/π over positive w and the density 1/a at the line itself; beyond the last edge |Φ|²
    # falls as w⁻², which leaves 1/(2 edge²).
    assert np.sum(parts) / np.pi * a == pytest.approx(flicker_lines(j), rel=1e-6)


def test_flicker_lines_of_the_first_and_of_high_ones():
    assert flicker_lines(1) == pytest.approx(0.774, abs=5e-4)
    j = np.array([1000, 1001, 100_000])
    # Si(x) = π/2 − cos x/x − …, the next order is 1/j³.
    np.testing.assert_allclose(flicker_lines(j), 1 - 2 / (np.pi**2 * j), rtol=1e-8)


def test_lines_of_flicker_noise_are_all_but_independent():
    # Autocovariance −ln|t| is the transform of 1/2|f|; averaged over the cells of two samples, and up to
    # a constant, which lines of zero mean do not see.
    n = 512
    k = np.arange(n + 1.0)
    twice = k**2 * np.log(np.maximum(k, 1)) / 2
    lag = 1.5 - np.concatenate([[2 * twice[1]], twice[2:] - 2 * twice[1:-1] + twice[:-2]])
    lines = covariance_of_lines(lag[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))])
    sd = np.sqrt(np.diag(lines))
    correlation = lines / np.outer(sd, sd)
    np.fill_diagonal(correlation, 0)
    assert np.abs(correlation).max() < 0.13
    # Line j is at j/2n: the density there is n/j. Averaging costs the first lines (πj/2n)²/3.
    j = np.arange(1, 9)
    np.testing.assert_allclose(sd[:8] ** 2 * j / n, flicker_lines(j), rtol=3e-4)


@pytest.mark.parametrize("samples", [1000, 1001, 20_000])
def test_ramp_lines_are_exact(samples):
    time = np.arange(samples) / RATE
    slope = -0.7
    noise = np.random.default_rng([81, 4]).standard_normal(samples)
    spectrum = cosine_spectrum(slope * time + 3.0, RATE)
    # The lines of a ramp are the slope times those of 1/s: product and square differ by it alone.
    np.testing.assert_allclose(
        spectrum.ramp[:, 0], slope * spectrum.ramp_square, rtol=1e-6, atol=1e-12
    )
    np.testing.assert_allclose(spectrum.density[:, 0], slope**2 * spectrum.ramp_square, rtol=1e-6,
                               atol=1e-12)  # fmt: skip
    # With noise the power less the ramp's is that of the noise alone, bin by bin.
    with_ramp = cosine_spectrum(slope * time + noise, RATE)
    less = (
        with_ramp.density[:, 0]
        - 2 * slope * with_ramp.ramp[:, 0]
        + slope**2 * with_ramp.ramp_square
    )
    alone = cosine_spectrum(noise, RATE).density[:, 0]
    np.testing.assert_allclose(less, alone, rtol=1e-6, atol=1e-9 * with_ramp.density.max())


@given(samples=st.integers(2, 20_000))
@settings(max_examples=60, deadline=None)
def test_bins_part_the_lines(samples):
    spectrum = cosine_spectrum(np.arange(samples, dtype=float) % 7, RATE)
    lines = spectrum.lines
    assert lines.sum() == samples - 1
    assert (lines >= 1).all()
    # Mean frequency of a bin's lines j: all lines' frequencies add up, and no bin is out of turn.
    last = np.cumsum(lines)
    expected = (last - (lines - 1) / 2) * RATE / (2 * samples)
    np.testing.assert_allclose(spectrum.frequency, expected, rtol=1e-12)
    # A hundredth of their frequency wide, rounded to whole lines.
    assert (lines <= np.maximum(0.01 * last + 1.5, 1)).all()


def test_axes_are_independent_of_each_other():
    values = np.random.default_rng([81, 5]).standard_normal((5000, 3)).cumsum(axis=0)
    together = cosine_spectrum(values, RATE)
    for i in range(3):
        alone = cosine_spectrum(values[:, i], RATE)
        np.testing.assert_array_equal(together.density[:, i], alone.density[:, 0])
        np.testing.assert_array_equal(together.ramp[:, i], alone.ramp[:, 0])


@pytest.mark.parametrize("kind", [np.int16, np.int32, np.float32])
def test_any_type_of_number(kind):
    counts = np.round(1000 * np.random.default_rng([81, 6]).standard_normal(5000)).astype(kind)
    before = counts.copy()
    found = cosine_spectrum(counts, RATE)
    np.testing.assert_array_equal(counts, before)
    # Whole numbers are exact in each type; a mean of float32 numbers is known to 7 digits.
    exact = cosine_spectrum(counts.astype(float), RATE)
    np.testing.assert_allclose(
        found.density, exact.density, rtol=1e-9 if kind != np.float32 else 1e-5
    )


def test_input_is_left_alone():
    values = np.random.default_rng([81, 7]).standard_normal((2000, 3))
    before = values.copy()
    cosine_spectrum(values, RATE)
    np.testing.assert_array_equal(values, before)


@given(scale=st.floats(1e-9, 1e9), offset=st.floats(-1e3, 1e3), rate=st.floats(0.01, 1e4))
@settings(max_examples=40, deadline=None)
def test_scale_offset_and_rate(scale, offset, rate):
    values = np.random.default_rng([81, 8]).standard_normal(1500)
    one = cosine_spectrum(values, 1.0)
    other = cosine_spectrum(scale * (values + offset), rate)
    # An offset of a thousand costs three of sixteen digits, weak lines some more.
    np.testing.assert_allclose(
        other.density, scale**2 / rate * one.density, rtol=1e-6, atol=1e-9 * scale**2 / rate
    )
    np.testing.assert_allclose(other.frequency, rate * one.frequency, rtol=1e-12)
