"""Power spectral density against exact expectations, scipy and simulated noise of known coefficients."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from sensorbook import Refusal
from sensorbook.noise.psd import (
    CLEAR,
    PowerSpectrum,
    average_frequencies,
    low_pass_filter,
    periodogram,
    read_off_spectrum,
    read_ranges,
    spectral_slopes,
    welch,
)


def white(seed, samples, axes=1, scale=1.0):
    return scale * np.random.default_rng(seed).standard_normal((samples, axes))


def flicker(seed, samples, axes):
    """Unit bias instability at 1 Hz by the fractional filter h_k = h_{k−1}(k − 1/2)/k."""
    h = np.cumprod(np.concatenate([[1.0], (np.arange(1, samples) - 0.5) / np.arange(1, samples)]))
    return signal.fftconvolve(white(seed, samples, axes), h[:, None], axes=0)[:samples]


def spectrum_of(density, dof=2.0):
    """A spectrum of 1 Hz-sampled data with a given one-sided density at its lines."""
    count = len(density)
    lines = np.ones(count, dtype=np.int64)
    f = np.arange(1, count + 1) / (2 * count)
    return PowerSpectrum(f, density[:, None], np.full(count, dof), lines, 2 * count, 1.0)


# ---- periodogram ----


@pytest.mark.parametrize("samples", [4, 5, 1000, 1001, 99_991])
def test_parseval(samples):
    values = white(1, samples, 3) * [1.0, 1e-4, 30.0] + [0.0, 1.0, -5.0]
    found = periodogram(values, 50.0)
    total = found.density.sum(axis=0) * 50.0 / samples
    # Rounding grows with log N in the transform and the sum: some tens of ε.
    np.testing.assert_allclose(total, values.var(axis=0), rtol=1e-12)


@pytest.mark.parametrize("samples", [64, 65])
def test_a_sinusoid_has_the_power_of_half_its_square(samples):
    j, amplitude = 7, 0.3
    values = amplitude * np.sin(2 * np.pi * j * np.arange(samples) / samples + 0.2)
    found = periodogram(values, 10.0)
    power = found.density[:, 0] * 10.0 / samples
    assert found.frequency[j - 1] == pytest.approx(10.0 * j / samples, rel=1e-14)
    assert power[j - 1] == pytest.approx(amplitude**2 / 2, rel=1e-12)
    assert np.delete(power, j - 1).max() < 1e-28


def test_the_line_at_nyquist_is_not_doubled():
    even, odd = (periodogram(white(2, n), 1.0) for n in (64, 65))
    assert (even.frequency[-1], even.dof[-1], even.dof[-2]) == (0.5, 1.0, 2.0)
    assert odd.frequency[-1] < 0.5
    assert (odd.dof == 2).all()
    alternating = periodogram(np.tile([1.0, -1.0], 32), 1.0)
    assert alternating.density[-1, 0] / 64 == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("taper", [False, True])
@pytest.mark.parametrize("samples", [500, 501])
def test_agrees_with_scipy(samples, taper):
    values = white(3, samples, 2) + 4.0
    window = signal.windows.cosine(samples) if taper else np.ones(samples)
    f, expected = signal.periodogram(values, 20.0, window, detrend="constant", axis=0)
    found = periodogram(values, 20.0, taper=taper)
    np.testing.assert_allclose(found.frequency, f[1:], rtol=1e-14)
    np.testing.assert_allclose(found.density, expected[1:], rtol=1e-9, atol=1e-16)


def test_expectation_for_white_noise_and_a_random_walk():
    """Exact: the expected density is the sum of those of the responses to each single innovation."""
    samples, rate = 256, 4.0
    impulses, steps = np.eye(samples), np.tri(samples)
    for taper in (False, True):
        # S = variance/rate, one-sided twice that; of a sampled random walk S/(2 sin πfδt)².
        found = periodogram(impulses, rate, taper=taper)
        noise = found.density.sum(axis=1)[:-1] * rate / 2
        if taper:  # the mean, removed first, takes its share of the first lines
            np.testing.assert_allclose(noise[[0, 2]], [0.91, 1.0], atol=0.001)
            np.testing.assert_allclose(noise[6:], 1.0, atol=3e-5)
        else:
            np.testing.assert_allclose(noise, 1.0, rtol=1e-12)
        found = periodogram(steps, rate, taper=taper)
        walk = (
            found.density.sum(axis=1) * rate / 2 * 4 * np.sin(np.pi * found.frequency / rate) ** 2
        )
        if taper:
            # What is left of the ends: 48 % on the first line, 10 % on the third, 2 % on the seventh.
            np.testing.assert_allclose(walk[[0, 2, 6]], [1.48, 1.10, 1.02], atol=0.006)
            assert (walk[6:100] < 1.02).all()
            assert (walk[6:100] > 0.99).all()
        else:
            np.testing.assert_allclose(walk[:-1], 2.0, rtol=1e-10)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_samples_that_are_not_finite(bad):
    values = np.zeros((2000, 3))
    values[7, 2] = bad
    for method in (periodogram, welch):
        with pytest.raises(ValueError, match="samples that are not finite; bridge or cut them"):
            method(values, 1.0)


def test_too_few_samples():
    with pytest.raises(ValueError, match=r"^3 samples have no spectrum; at least 4 are needed$"):
        periodogram(np.zeros(3), 1.0)


@pytest.mark.parametrize("rate", [0, -100.0, np.inf, np.nan])
def test_what_is_no_rate(rate):
    for method in (periodogram, welch):
        with pytest.raises(ValueError, match=f"^rate {rate:g} Hz: give the sampling rate, above"):
            method(np.zeros(2000), rate)


# ---- Welch ----


@pytest.mark.parametrize("segment", [256, 255])
def test_welch_agrees_with_scipy(segment):
    values = white(4, 5000, 2)
    f, expected = signal.welch(values, 8.0, nperseg=segment, axis=0)
    found = welch(values, 8.0, segment)
    np.testing.assert_allclose(found.frequency, f[1:])
    np.testing.assert_allclose(found.density, expected[1:], rtol=1e-10)
    assert found.dof[-1] == (found.dof[0] / 2 if segment == 256 else found.dof[0])


def test_scatter_is_that_of_the_degrees_of_freedom():
    """Relative variance 2/ν, over 1200 records of white noise, with and without correlated lines."""
    values = white(5, 1024, 1200)
    plain, taper = (average_frequencies(periodogram(values, 1.0, taper=t)) for t in (False, True))
    segments = average_frequencies(welch(values, 1.0, 256))
    for found in (plain, taper, segments):
        scatter = (found.density / found.density.mean(axis=1, keepdims=True)).var(axis=1)
        # A variance of 1200 draws is known to √(2/1200) = 4 %, with χ²₂'s kurtosis to 8 %; averaged over
        # all points, whose number exceeds 60, to 1.5 % at worst. The first line of a window also sees
        # the mean removed.
        ratio = scatter[2:] * found.dof[2:] / 2
        assert ratio.mean() == pytest.approx(1, abs=0.05)
        assert ((ratio > 0.7) & (ratio < 1.35)).all()
        pooled = found.density[8:40].T @ found.lines[8:40] / found.lines[8:40].sum()
        expected = 2 / found.pooled_dof(slice(8, 40))
        assert pooled.var() / pooled.mean() ** 2 == pytest.approx(expected, rel=4 * 0.041)


def test_default_segment_and_refusal():
    assert welch(white(6, 1000), 1.0).frequency[0] == 1 / 256
    assert welch(white(6, 100_000), 1.0).frequency[0] == 1 / 2**14
    with pytest.raises(Refusal) as refused:
        welch(np.zeros(999), 1.0)
    assert refused.value.reason == "The record has 999 samples; a spectrum needs at least 1000."
    assert refused.value.remedy == "Record a rest of one hour or more."


@pytest.mark.parametrize("segment", [3, 2001])
def test_segment_outside_the_record(segment):
    with pytest.raises(ValueError, match=rf"^a segment of {segment} samples is outside 4 … 2000"):
        welch(np.zeros(2000), 1.0, segment)


# ---- table 5.1 ----


def test_table_5_1():
    found = average_frequencies(spectrum_of(np.ones(32768)))
    assert len(found.frequency) == 192
    assert found.lines.tolist() == [1] * 32 + [2**k for k in range(1, 11) for _ in range(16)]
    assert (found.dof == 2 * found.lines).all()


@settings(max_examples=60, deadline=None)
@given(samples=st.integers(4, 30_000), seed=st.integers(0, 2**32 - 1))
def test_averaging_loses_nothing_at_any_length(samples, seed):
    raw = periodogram(white(seed, samples, 2), 7.0)
    found = average_frequencies(raw)
    assert found.lines.sum() == len(raw.frequency)
    assert found.dof.sum() == raw.dof.sum() == samples - 1
    np.testing.assert_allclose(found.dof @ found.density, raw.dof @ raw.density, rtol=1e-10)
    np.testing.assert_array_equal(found.density[:32], raw.density[:32])
    assert (np.diff(found.frequency) > 0).all()
    # Only the last group may be short of its octave's size.
    first = np.cumsum(found.lines) - found.lines + 1
    full = 2.0 ** np.maximum(np.ceil(np.log2((first + found.lines - 1) / 32)), 0)
    assert (found.lines[:-1] == full[:-1]).all()
    assert found.lines[-1] <= full[-1]


def test_the_line_at_nyquist_counts_for_half():
    raw = spectrum_of(np.concatenate([np.ones(33), [4.0]]))
    raw.dof[-1] = 1.0
    found = average_frequencies(raw)
    assert (found.lines[-1], found.dof[-1]) == (2, 3.0)
    assert found.density[-1, 0] == pytest.approx((2 * 1 + 1 * 4) / 3)


def test_limits_are_those_of_chi_square():
    # χ²₂ is exponential: its quantiles are −2 ln(1 − p).
    found = spectrum_of(np.array([3.0, 5.0])).limits(0.9)
    np.testing.assert_allclose(found[:, 0, 0], np.array([3, 5]) / -np.log(0.05))
    np.testing.assert_allclose(found[:, 0, 1], np.array([3, 5]) / -np.log(0.95))
    many = average_frequencies(periodogram(white(8, 20_000, 30), 1.0))
    inside = (many.limits()[..., 0] < 2) & (many.limits()[..., 1] > 2)
    # 5400 points: 95 % to within four times √(0.05·0.95/5400) = 0.3 %.
    assert inside.mean() == pytest.approx(0.95, abs=0.012)


# ---- slopes ----


@pytest.mark.parametrize("slope", [-2.0, -1.0, 0.0, 2.0])
def test_slope_of_a_power_law_is_exact(slope):
    f = np.arange(1, 5001) / 10_000
    found = spectral_slopes(spectrum_of(f**slope, dof=4000.0))
    np.testing.assert_allclose(found[:, 0], slope, atol=1e-8)


def test_slope_of_scattered_lines_is_unbiased_and_as_well_known_as_said():
    f = np.arange(1, 2049) / 4096
    draws = np.random.default_rng(9).exponential(size=(2048, 300)) / f[:, None]
    base = spectrum_of(f)
    spectrum = PowerSpectrum(f, draws, base.dof, base.lines, 4096, 1.0)
    found = spectral_slopes(average_frequencies(spectrum))
    # A standard error of 0.2 over 300 draws is 0.012 of the mean.
    np.testing.assert_allclose(found.mean(axis=1), -1, atol=4 * 0.012)
    # The logarithm of single lines has a long tail, and 300 draws know a deviation to 4 %.
    assert found.std(axis=1).max() < 0.2 * 1.15


def test_a_slope_that_cannot_be_known():
    assert np.isnan(spectral_slopes(spectrum_of(np.ones(20)))).all()
    assert read_ranges(spectrum_of(np.ones(20))) == ({},)


# ---- read-off ----


@pytest.mark.parametrize(
    ("term", "slope"), [("random_walk", 0), ("bias_instability", -1), ("rate_random_walk", -2)]
)
def test_a_pure_term_is_read_exactly(term, slope):
    w = 2 * np.pi * np.arange(1, 5001) / 10_000
    spectrum = spectrum_of(2 * 0.3**2 * w**slope, dof=4000.0)
    found = read_off_spectrum(spectrum).axes[0]
    assert found.terms[term].value == pytest.approx(0.3, rel=1e-12)
    others = {n for n, e in found.terms.items() if e} - {term}
    assert not others
    assert set(found.upper_bounds) == {"random_walk", "bias_instability", "rate_random_walk"} - {
        term
    }
    # 2·10⁷ degrees of freedom: a relative error of 1.96/√(2ν) in the coefficient.
    half = 1.96 / np.sqrt(2 * 4000 * 5000)
    assert found.terms[term].low == pytest.approx(0.3 * (1 - half), rel=1e-6)
    assert found.terms[term].high == pytest.approx(0.3 * (1 + half), rel=1e-6)


@pytest.mark.parametrize(
    ("term", "values"),
    [
        ("random_walk", lambda: white(10, 20_000, 40)),
        ("bias_instability", lambda: flicker(11, 20_000, 40)),
        ("rate_random_walk", lambda: np.cumsum(white(12, 20_000, 40), axis=0)),
    ],
)
def test_simulated_noise_is_read_with_its_interval(term, values):
    """At 1 Hz N of white noise is its deviation, K of a random walk its step."""
    # The discrete generators are 1/(2 sin πf) to a power: right below a twentieth of the rate.
    low_pass = [SimpleNamespace(cutoff=0.05 / CLEAR)] * 40
    spectrum = average_frequencies(periodogram(values(), 1.0, taper=True))
    read = [a.terms[term] for a in read_off_spectrum(spectrum, low_pass).axes]
    assert all(read)
    found = np.array([e.value for e in read])
    # Each is read from nearly 1000 lines, with the taper worth 660: 1/(2√660) = 1.9 %, 40 of them to 0.3 %.
    # Choosing the range by the slope it shows, and what is left of the ends, add about as much.
    assert found.mean() == pytest.approx(1.0, abs=0.02)
    holds = np.mean([e.low < 1 < e.high for e in read])
    # 95 % of 40; below 82 % lie 0.3 % of binomial draws.
    assert holds >= 0.82


def test_a_term_that_is_not_seen_lies_below_its_bound():
    # K = 1e-4 beside N = 1 crosses it at f = 1.6e-5 Hz, the first line lies at 1e-4.
    values = white(13, 10_000, 60) + np.cumsum(white(14, 10_000, 60, 1e-4), axis=0)
    read = read_off_spectrum(average_frequencies(periodogram(values, 1.0, taper=True)))
    bounds = np.array([a.upper_bounds.get("rate_random_walk", np.nan) for a in read.axes])
    assert np.isfinite(bounds).all()
    assert (bounds > 1e-4).mean() >= 0.95
    # and says something: the first lines, 2π·1e-4·N, bound it within a factor of some ten.
    assert np.median(bounds) < 1e-2


def test_all_three_terms_and_their_ranges():
    """N = 1, B = 0.05, K = 1e-4 at 1 Hz: bends at 4e-4 and 6e-7 Hz; only the upper one can be seen."""
    values = white(15, 400_000) + 0.05 * flicker(16, 400_000, 1)
    spectrum = average_frequencies(periodogram(values, 1.0, "gyroscope", taper=True))
    (ranges,) = read_ranges(spectrum)
    read = read_off_spectrum(spectrum)
    assert read.method == "psd_read_off"
    assert read.sensor == "gyroscope"
    assert "rate_random_walk" not in ranges
    assert spectrum.frequency[ranges["random_walk"]][0] > 4e-4 / 3
    assert read["x"].terms["random_walk"].value == pytest.approx(1, rel=0.01)
    assert read["x"].terms["quantization"] is None
    assert read["x"].terms["rate_ramp"] is None


def test_nothing_is_read_above_a_fifth_of_the_cut_off():
    values = low_pass_filter(white(17, 400_000), 1.0, 0.1)
    spectrum = average_frequencies(periodogram(values, 1.0))
    low_pass = [SimpleNamespace(cutoff=0.1)]
    (ranges,) = read_ranges(spectrum, low_pass)
    assert 0.019 < spectrum.frequency[ranges["random_walk"]][-1] <= 0.02
    read = read_off_spectrum(spectrum, low_pass).axes[0]
    # Some 8000 lines: 1/(2√8000) = 0.6 % of N.
    assert read.terms["random_walk"].value == pytest.approx(1, rel=4 * 0.006)
    assert 50 <= read.tau_range[0] < 55
    # A bound is not taken where the filter has lowered the density either.
    assert read.upper_bounds["bias_instability"] > 0.0


def test_ranges_may_be_those_of_a_twin():
    values = np.cumsum(white(18, 50_000, 30), axis=0)
    taper, plain = (average_frequencies(periodogram(values, 1.0, taper=t)) for t in (True, False))
    ranges = [{"rate_random_walk": slice(3, 40)}] * 30
    k = [
        np.mean(
            [a.terms["rate_random_walk"].value ** 2 for a in read_off_spectrum(s, (), ranges).axes]
        )
        for s in (taper, plain)
    ]
    # 30 records; each untapered one is raised by a χ²₁ of its own about 1: √(2/30)/2 = 13 %.
    assert k[0] == pytest.approx(1.0, abs=0.1)
    assert k[1] == pytest.approx(2.0, abs=4 * 0.26)


# ---- low-pass ----


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("cutoff", [0.5, 20.0, 49.0])
def test_half_the_power_at_the_cut_off_and_no_delay(cutoff, order):
    t = np.arange(40_000) / 100.0
    wave = np.cos(2 * np.pi * cutoff * t)
    found = low_pass_filter(wave, 100.0, cutoff, order)
    inner = slice(10_000, 30_000)  # whole periods, far from the ends
    gain = found[inner] @ wave[inner] / (wave[inner] @ wave[inner])
    assert gain == pytest.approx(np.sqrt(0.5), rel=1e-6)
    np.testing.assert_allclose(found[inner], gain * wave[inner], atol=1e-6)


def test_low_pass_leaves_a_constant_and_every_axis_alone():
    values = white(19, 3000, 3)
    found = low_pass_filter(values, 100.0, 20.0)
    for i in range(3):
        np.testing.assert_allclose(found[:, i], low_pass_filter(values[:, i], 100.0, 20.0))
    np.testing.assert_allclose(low_pass_filter(np.full(500, 9.81), 100.0, 20.0), 9.81, rtol=1e-9)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 50.0, 80.0])
def test_cut_off_outside_the_band(cutoff):
    with pytest.raises(
        ValueError, match=rf"^a cut-off of {cutoff:g} Hz is outside 0 … 50 Hz, half"
    ):
        low_pass_filter(np.zeros(100), 100.0, cutoff)


# ---- the result ----


def test_frame():
    found = periodogram(white(20, 1000, 3), 4.0, "gyroscope")
    frame = found.to_frame()
    assert list(frame.columns) == ["x", "y", "z"]
    assert frame.index.name == "frequency [Hz]"
    np.testing.assert_array_equal(frame.to_numpy(), found.density)
    assert "frequency [Hz]" in found._repr_html_()
