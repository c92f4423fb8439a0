"""Shocks, steps and periodic components: found, named, kept from the terms, and none where there is none."""

import numpy as np
import pytest

from sensorbook import Refusal
from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.disturbances import (
    bridge,
    calmed,
    find_bands,
    find_shocks,
    take_out_lines,
    take_out_steps,
)

from .series import in_time, low_passed

RATE, SAMPLES = 100.0, 60_000
TIME = np.arange(SAMPLES) / RATE


def rest(seed, samples=SAMPLES, axes=1):
    """White noise of standard deviation 1 with some flicker and a walk."""
    rng = np.random.default_rng([84, seed])
    return np.stack(
        [in_time(samples, RATE, rng, n=0.1, b=0.02, k=0.002) for _ in range(axes)], axis=1
    )


def bands_of(column):
    return find_bands(cosine_spectrum(column, RATE), 0)


# ---- nothing where there is nothing ----


def clean(name, rng, samples):
    white = rng.standard_normal(samples + 2000)
    match name:
        case "white":
            return white[:samples]
        case "flicker":
            return in_time(samples, RATE, rng, b=1.0)
        case "walk":
            return np.cumsum(white[:samples])
        case "corner":
            return in_time(samples, RATE, rng, n=0.1, b=0.1, k=1.0)
        case "low-pass 1":
            return low_passed(white, 1, 10.0, RATE)
        case "low-pass 2":
            return low_passed(white, 2, 20.0, RATE)
        case "low-pass 4":
            return low_passed(white, 4, 40.0, RATE)
        case "quantisation":
            return np.diff(white[: samples + 1]) + 0.3 * rng.standard_normal(samples)
        case "counts":
            return np.round(0.45 * white[:samples])


@pytest.mark.parametrize(
    "samples", [2000, 25_155, 60_000]
)  # 25 155: the last bin holds one line alone
@pytest.mark.parametrize(
    "name",
    ["white", "flicker", "walk", "corner", "low-pass 1", "low-pass 2", "low-pass 4", "quantisation",
     "counts"],
)  # fmt: skip
def test_nothing_is_found_in_clean_noise(name, samples):
    found = []
    for seed in range(20):
        column = clean(name, np.random.default_rng([84, 1000, seed, samples]), samples)
        assert find_shocks(column[:, None], RATE) == ()
        calm, lines = take_out_lines(column, RATE)
        assert calm is column
        found += lines + bands_of(column)[1]
    # Chance makes a bin stand out once in ten million, but its surroundings are known to some per cent
    # only, which raises that in short records: of 2000 samples, and of rising spectra, one in a hundred
    # holds a false band. Two of 20 are less likely than 2 %.
    assert len(found) <= 1, found


# ---- shocks ----


@pytest.mark.parametrize("start", [0, 20, 30_000, SAMPLES - 21, SAMPLES - 20])
@pytest.mark.parametrize("size", [30.0, 1e4])
def test_a_shock_is_found_where_it_is(start, size):
    values = rest(1, axes=3)
    values[start : start + 20, 1] += size
    (shock,) = find_shocks(values, RATE)
    assert (shock.start, shock.stop) == (start, start + 20)
    # The largest of 20 noise values on top; a median of 60 000 knows the scale to half a per cent.
    assert 0.98 * size < shock.size < 1.02 * size + 4


def test_a_single_sample_is_a_shock():
    values = rest(2)
    values[777] = 1e6
    (shock,) = find_shocks(values, RATE)
    assert (shock.start, shock.stop) == (777, 778)


def test_what_is_close_is_one_shock():
    values = rest(3)
    values[[10_000, 10_150, 10_400], 0] += 50
    # Two seconds apart at most: 1.5 s and 2.5 s.
    assert [(s.start, s.stop) for s in find_shocks(values, RATE)] == [
        (10_000, 10_151),
        (10_400, 10_401),
    ]


@pytest.mark.parametrize("sd", [0.2, 0.25, 0.3, 0.4, 0.45, 0.6, 1.5])
@pytest.mark.parametrize("offset", [0.0, 0.1, 0.5])
def test_shocks_in_coarse_counts(sd, offset):
    # Most samples may be alike: no shock in the noise, none missed of 40 steps.
    counts = sd * np.random.default_rng([84, 4]).standard_normal((SAMPLES, 1)) + offset
    assert find_shocks(np.round(counts), RATE) == ()
    assert find_shocks(np.round(counts).astype(np.int16), RATE) == ()
    counts[5000:5010] += 40
    (shock,) = find_shocks(np.round(counts), RATE)
    assert (shock.start, shock.stop) == (5000, 5010)


@pytest.mark.parametrize(("samples", "size"), [(1, 30), (20, 60), (300, 200), (20, 1e4)])
def test_a_shock_on_a_drift(samples, size):
    values = rest(18) + 600 * np.linspace(0, 1, SAMPLES)[:, None]
    values[50_000 : 50_000 + samples] += size
    (shock,) = find_shocks(values, RATE)
    assert (shock.start, shock.stop) == (50_000, 50_000 + samples)


def test_a_knock_rings_and_is_one_shock():
    values = rest(19)
    ring = 300 * np.exp(-np.arange(200) / 40) * np.sin(0.9 * np.arange(200))
    values[20_000:20_200, 0] += ring
    (shock,) = find_shocks(values, RATE)
    last = 20_000 + np.flatnonzero(np.abs(ring) > 10)[-1]
    assert shock.start == pytest.approx(20_001, abs=1)
    assert shock.stop == pytest.approx(last + 1, abs=20)


def test_a_step_is_no_shock():
    values = rest(20)
    values[30_000:] += 30
    assert find_shocks(values, RATE) == ()


def test_a_fast_drift_is_no_shock():
    walk = np.cumsum(rest(5), axis=0)
    assert find_shocks(walk + 100 * np.exp(-TIME / 60)[:, None], RATE) == ()


def test_scale_does_not_matter_for_shocks():
    values = rest(6)
    values[3000:3010] += 25
    expected = find_shocks(values, RATE)
    for scale in (1e-9, 1e6):
        found = find_shocks(scale * values, RATE)
        assert [(s.start, s.stop) for s in found] == [(s.start, s.stop) for s in expected]
        assert found[0].size == pytest.approx(expected[0].size, rel=1e-9)


@pytest.mark.parametrize("start", [0, 30_000, SAMPLES - 20])
def test_bridge(start):
    values = rest(7, axes=2)
    original = values.copy()
    values[start : start + 20] += 1e3
    spoiled = values.copy()
    found = bridge(values, find_shocks(values, RATE), RATE)
    np.testing.assert_array_equal(values, spoiled)
    # Half a second on either side goes with it, the rest is left as it is.
    far = np.abs(np.arange(SAMPLES) - start - 10) > 66
    np.testing.assert_array_equal(found[far], original[far])
    # The means of half a second each, known to 0.14: no trace of a thousand is left.
    assert np.abs(found[~far]).max() < 6


def test_without_shocks_the_signal_is_the_same():
    values = rest(8)
    assert bridge(values, (), RATE) is values


def test_a_record_that_is_shaken_is_refused():
    values = rest(9)
    values[20_000:38_000] += 30 * np.random.default_rng([84, 9, 1]).standard_normal((18_000, 1))
    with pytest.raises(Refusal) as refusal:
        bridge(values, find_shocks(values, RATE), RATE)
    assert refusal.value.reason == (
        "30 % of the record is knocked or moved, in 1 stretches: it is not a rest."
    )
    assert refusal.value.remedy == (
        "Record with the sensor clamped to something heavy, far from people and machines."
    )


# ---- steady lines ----


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("frequency", [0.05, 0.5, 7.3, 7.30083, 33.333, 49.9])
def test_a_steady_line_is_taken_out(amplitude, frequency):
    column = rest(10)[:, 0]
    line = amplitude * np.cos(2 * np.pi * frequency * TIME + 0.7)
    calm, (found,) = take_out_lines(column + line, RATE)
    assert found.steady
    # The Cramér–Rao bound for white noise of standard deviation 1, under a Hann window 1.7 times that.
    # At 0.05 Hz the noise is twice as large.
    assert found.frequency == pytest.approx(
        frequency, abs=5 * 2 * np.sqrt(6) / (np.pi * SAMPLES**1.5 * amplitude) * RATE
    )
    assert found.amplitude == pytest.approx(amplitude, abs=5 * 2 * np.sqrt(2 / SAMPLES))
    assert found.band[0] < found.frequency < found.band[1]
    # What is left of the line, from errors of amplitude, phase and frequency, is not seen.
    assert np.sqrt(np.mean((calm - column) ** 2)) < 5 * 2 * np.sqrt(3 / SAMPLES)
    assert bands_of(calm)[1] == []
    assert type(found.frequency) is float


def test_two_lines_close_together():
    near = 12 * RATE / SAMPLES  # three times the width of a window's peak
    column = rest(11)[:, 0] + sum(0.5 * np.sin(2 * np.pi * f * TIME) for f in (7.3, 7.3 + near))
    calm, lines = take_out_lines(column, RATE)
    assert sorted(p.frequency for p in lines) == pytest.approx([7.3, 7.3 + near], abs=1e-4)
    assert calm.std() == pytest.approx(1, rel=0.02)


def test_harmonics_of_a_square_wave():
    column = rest(12)[:, 0] + 0.5 * np.sign(np.sin(2 * np.pi * 1.7 * TIME + 0.1))
    calm, lines = take_out_lines(column, RATE)
    assert [round(p.frequency / 1.7) for p in lines[:4]] == [1, 3, 5, 7]
    # Sampled, a square wave of amplitude 1/2 has 2/πk to within (k·1.7/100)².
    assert [p.amplitude for p in lines[:4]] == pytest.approx(
        [2 / np.pi / k for k in (1, 3, 5, 7)], abs=0.03
    )
    # Of the wave's variance of 1/4 a percent or so is in the harmonics that the noise hides.
    assert calm.var() == pytest.approx(1.0, abs=0.03)


# ---- bands ----


def test_a_drifting_line_is_a_band():
    drift = 0.2  # Hz over the record
    phase = 2 * np.pi * (10 * TIME + drift * TIME**2 / (2 * TIME[-1]))
    column = rest(13)[:, 0] + 0.5 * np.sin(phase)
    assert take_out_lines(column, RATE)[1] == []
    mask, bands = bands_of(column)
    strongest = max(bands, key=lambda p: p.amplitude)
    assert not strongest.steady
    assert strongest.band[0] < 10.0
    assert strongest.band[1] > 10.2
    assert strongest.frequency == pytest.approx(10.1, abs=0.05)
    # 12 000 lines of noise beside it.
    assert strongest.amplitude == pytest.approx(0.5, rel=0.05)
    spectrum = cosine_spectrum(column, RATE)
    here = (spectrum.frequency > 10.0) & (spectrum.frequency < 10.2)
    assert mask[here].all()
    assert mask.mean() < 0.1


@pytest.mark.parametrize("frequency", [49.97, 49.99, 50.0])
def test_a_line_at_the_nyquist_frequency(frequency):
    # Mains at half the sampling rate. Too near the end for a line, but not for a band.
    mask, (band,) = bands_of(rest(14)[:, 0] + 0.5 * np.cos(2 * np.pi * frequency * TIME + 0.3))
    assert mask[-1]
    # The last line is half of its width below.
    assert band.band[0] < frequency <= band.band[1] + RATE / (2 * SAMPLES)
    assert band.frequency == pytest.approx(frequency, abs=0.3)


def test_a_resonance_is_a_band():
    rng = np.random.default_rng([84, 15, 1])
    pulse = np.sin(2 * np.pi * 12 * np.arange(200) / RATE) * np.hanning(200)
    column = rest(15)[:, 0] + 0.1 * np.convolve(rng.standard_normal(SAMPLES), pulse, "same")
    assert take_out_lines(column, RATE)[1] == []
    mask, bands = bands_of(column)
    strongest = max(bands, key=lambda p: p.amplitude)
    assert strongest.frequency == pytest.approx(12, abs=0.1)
    # The power of the resonance: its sinusoid has twice that.
    assert strongest.amplitude == pytest.approx(np.sqrt(2 * 0.01 * np.sum(pulse**2)), rel=0.1)
    assert mask.any()


def test_fewer_than_sixteen_periods_are_no_periodic_component():
    # 12 periods in the record: what it leaves in the terms is for their misfit to tell (`identify`).
    column = rest(16)[:, 0] + 0.3 * np.sin(2 * np.pi * 0.02 * TIME)
    assert take_out_lines(column, RATE)[1] == []
    assert bands_of(column)[1] == []


def test_scale_does_not_matter_for_periodic_components():
    column = rest(17)[:, 0] + 0.5 * np.sin(2 * np.pi * 7.3 * TIME)
    column += 0.5 * np.sin(2 * np.pi * (20 * TIME + 0.001 * TIME**2))
    lines, bands = take_out_lines(column, RATE)[1], bands_of(column)[1]
    assert lines
    assert bands
    for scale in (1e-9, 1e6):
        more = take_out_lines(scale * column, RATE)[1], bands_of(scale * column)[1]
        for one, other in zip((*lines, *bands), (*more[0], *more[1]), strict=True):
            assert other.amplitude == pytest.approx(scale * one.amplitude, rel=1e-6)
            assert other.frequency == pytest.approx(one.frequency, rel=1e-6)
            assert other.band == pytest.approx(one.band, rel=1e-6)


# ---- steps ----


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seconds", [100.0, 301.5, 520.0])
def test_a_step_is_found_and_taken_out(seconds, sign):
    noise = rest(60)[:, 0]
    values = noise + sign * np.where(seconds <= TIME, 2.0, 0.0)
    level, (step,) = take_out_steps(values)
    # Two standard deviations of a sample: seen to some samples, the size to that of means of a second or so.
    assert step.start / RATE == pytest.approx(seconds, abs=0.1)
    assert step.size == pytest.approx(sign * 2.0, abs=0.4)
    after, before = seconds + 1 <= TIME, seconds - 1 > TIME
    assert np.mean(level[after] - noise[after]) == pytest.approx(0, abs=0.4)
    np.testing.assert_array_equal(level[before], values[before])


def test_a_plateau_is_two_steps_in_order():
    plateau = np.where((TIME >= 200) & (TIME < 260), 1.5, 0.0)
    _, steps = take_out_steps(rest(61)[:, 0] + plateau)
    assert [s.start / RATE for s in steps] == pytest.approx([200, 260], abs=0.2)
    assert [s.size for s in steps] == pytest.approx([1.5, -1.5], abs=0.4)
    assert all(s.lasting for s in steps)


def test_an_edge_that_does_not_last_is_told_and_left_in():
    # Up at once, and down over a minute.
    bump = np.clip((TIME >= 300) * 2.0 - np.clip((TIME - 300) / 30, 0, None), 0, None)
    values = rest(63)[:, 0] + bump
    level, steps = take_out_steps(values)
    assert [s.start / RATE for s in steps] == pytest.approx([300], abs=0.2)
    assert [s.lasting for s in steps] == [False]
    np.testing.assert_array_equal(level, values)


@pytest.mark.parametrize("name", ["white", "flicker", "walk", "mixture"])
def test_noise_has_no_steps(name):
    terms = {
        "white": {"n": 0.1},
        "flicker": {"b": 1.0},
        "walk": {"k": 1.0},
        "mixture": {"n": 0.1, "b": 0.05, "k": 0.01},
    }[name]
    for seed in range(20):
        values = in_time(20_000, RATE, np.random.default_rng([84, 70, seed]), **terms)
        level, steps = take_out_steps(values)
        assert steps == []
        np.testing.assert_array_equal(level, values)


@pytest.mark.parametrize(
    "slow",
    [
        0.01 * TIME,
        20 * np.exp(-TIME / 100),
        3 * np.sin(2 * np.pi * TIME / 150),
        2 / (1 + np.exp(-(TIME - 300) / 20)),
    ],
    ids=["ramp", "warm-up", "swing", "slow change"],
)
def test_what_changes_slowly_is_no_step(slow):
    assert take_out_steps(rest(62)[:, 0] + slow)[1] == []


def test_a_constant_and_a_short_record_have_no_steps():
    assert take_out_steps(np.full(1000, 3.0))[1] == []
    assert take_out_steps(np.arange(100.0))[1] == []


def test_calmed_takes_out_shocks_then_steps():
    values = rest(64, axes=2)
    values[10_000:10_005, 0] += 80
    values[40_000:, 1] += 2
    calm = calmed(values, RATE)
    ((shock,), (first, (step,))) = calm.shocks, calm.steps
    assert (shock.start, shock.stop) == (10_000, 10_005)
    assert first == ()
    assert step.start == pytest.approx(40_000, abs=10)
    # half a second on either side
    assert calm.bridged == pytest.approx(105 / SAMPLES)
    assert np.abs(calm.values[9_900:10_100, 0]).max() < 10
    assert np.mean(calm.values[41_000:, 1]) - np.mean(calm.values[:39_000, 1]) == pytest.approx(
        0, abs=0.6
    )
    assert calmed(rest(64), RATE).bridged == 0
