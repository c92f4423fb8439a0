"""A rest to its noise terms in one call, and what the curve says about averaging."""

from functools import cache

import numpy as np
import pytest
from scipy import signal

import sensorbook
from sensorbook import Recording, Refusal
from sensorbook.noise import TERMS, allan_deviation, best_averaging, identify_noise
from sensorbook.simulate.noise import coloured_noise

from .series import in_time, low_passed

RATE, SAMPLES = 100.0, 100_000
TIME = np.arange(SAMPLES) / RATE
TRUTH = {"n": 0.1, "b": 0.03, "k": 0.01}
LONG = {"random_walk": "n", "bias_instability": "b", "rate_random_walk": "k"}


@cache
def rest(seed=0):
    """(N, 3) 17 minutes of white noise of standard deviation 1, flicker and a walk; read-only."""
    rng = np.random.default_rng([91, 10, seed])
    values = np.stack([in_time(SAMPLES, RATE, rng, **TRUTH) for _ in range(3)], axis=1)
    values.flags.writeable = False
    return values


@cache
def clean(seed=0):
    return identify_noise(rest(seed), RATE, "gyroscope")


def inside(identified, i):
    """(T,) whether the curve's band holds what the terms make of it."""
    axis = identified.fit.axes[i]
    model = np.sqrt(axis.variance)
    return (axis.band[:, 0] <= model) & (model <= axis.band[:, 1])


# ---- a clean rest ----


def test_a_clean_rest_holds_noise_alone():
    for seed in range(3):
        found = clean(seed)
        assert found.shocks == ()
        assert found.periodic == ((), (), ())
        assert not np.any(found.kept_out)
        assert found.low_passes == (None, None, None)
        for axis in found.fit.axes:
            assert axis.model_error == 0
            assert axis.misfit is None
            assert axis.terms["quantization"] is None
            assert axis.terms["rate_ramp"] is None


def test_intervals_of_both_methods_hold_the_truth():
    hits = {"whittle": 0, "allan_fit": 0}
    for seed in range(3):
        for estimate in (clean(seed).fit, clean(seed).allan_fit):
            for axis in estimate.axes:
                for name, letter in LONG.items():
                    e, true = axis.terms[name], TRUTH[letter]
                    holds = e.low <= true <= e.high if e else true <= axis.upper_bounds[name]
                    hits[estimate.method] += holds
    # Of 27 at 95 %, fewer than 22 have a chance of 0.3 %.
    assert min(hits.values()) >= 22, hits


def test_the_terms_give_the_allan_curve():
    shares = [inside(clean(seed), i).mean() for seed in range(3) for i in range(3)]
    # 95 % of each cluster time; neighbours leave together, so that a curve has some ten chances.
    assert np.mean(shares) > 0.85
    for seed in range(3):
        for i, axis in enumerate(clean(seed).fit.axes):
            # Without low-pass and bands nothing is added to the terms.
            terms = axis.model.allan_variance(clean(seed).curve.tau)
            np.testing.assert_allclose(axis.variance, terms, rtol=1e-9)
            assert axis.band.shape == (len(terms), 2)
            assert (axis.band[:, 0] < clean(seed).curve.deviation[:, i]).all()
            assert (axis.band[:, 1] > clean(seed).curve.deviation[:, i]).all()


def test_curve_and_spectrum_are_those_of_the_record():
    found = clean()
    curve = allan_deviation(rest(), RATE, sensor="gyroscope")
    np.testing.assert_array_equal(found.curve.deviation, curve.deviation)
    np.testing.assert_array_equal(found.quiet.deviation, curve.deviation)
    assert found.curve.sensor == found.fit.sensor == "gyroscope"
    assert (found.fit.method, found.allan_fit.method) == ("whittle", "allan_fit")
    assert found.spectrum.samples == SAMPLES
    assert found._repr_html_() == found.fit._repr_html_()


# ---- what is no noise is found, named and kept out ----


def near_the_clean_terms(found, i=0, widths=1.0):
    """Terms within so many half widths of the intervals that the record without the disturbance has."""
    for name in LONG:
        a, b = clean().fit.axes[i].terms[name], found.fit.axes[i].terms[name]
        if a and b:
            assert abs(b.value - a.value) < widths * (a.high - a.low) / 2, name
        else:
            # At the threshold either may be stated.
            limits = [
                x.upper_bounds.get(name, np.inf) for x in (clean().fit.axes[i], found.fit.axes[i])
            ]
            assert min(limits) < 5 * TRUTH[LONG[name]]


# In standard deviations of the noise; beyond these 0.05 Hz passes for movement, and a band leaks.
@pytest.mark.parametrize(
    ("frequency", "amplitude"),
    [(0.05, 0.3), (0.05, 30.0), (7.3, 0.3), (7.3, 1000.0), (49.99, 0.3), (49.99, 3.0)],
)
def test_a_line_does_not_touch_the_terms(frequency, amplitude):
    values = rest() + amplitude * np.sin(2 * np.pi * frequency * TIME + 0.4)[:, None] * [1, 0, 0]
    found = identify_noise(values, RATE, "gyroscope")
    (line,) = found.periodic[0]
    assert found.periodic[1:] == ((), ())
    # At the end of the spectrum a band, whose centre is known to its width, else a line.
    assert line.frequency == pytest.approx(frequency, abs=0.3 if frequency > 49.9 else 1e-3)
    assert line.amplitude == pytest.approx(amplitude, rel=0.1)
    near_the_clean_terms(found)
    assert found.fit["y"].terms == clean().fit["y"].terms
    assert found.fit["x"].misfit is None


def test_a_band_does_not_touch_the_terms():
    phase = 2 * np.pi * (10 * TIME + 0.1 * TIME**2 / TIME[-1])
    found = identify_noise(rest() + 0.5 * np.sin(phase)[:, None], RATE)
    for i in range(3):
        strongest = found.periodic[i][0]
        assert not strongest.steady
        assert strongest.frequency == pytest.approx(10.1, abs=0.05)
        assert strongest.amplitude == pytest.approx(0.5, rel=0.05)
        assert found.kept_out[i].any()
        near_the_clean_terms(found, i)
        # What it adds is explained, to the width of the bins over that of the drift …
        ratio = np.sqrt(found.fit.axes[i].variance) / found.curve.deviation[:, i]
        short = found.curve.tau < 1
        assert np.abs(ratio[short] - 1).max() < 0.05
        # … and taken from the curve that is fitted.
        quiet = found.quiet.deviation[short, i] / clean().curve.deviation[short, i]
        assert np.abs(quiet - 1).max() < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_a_drifting_line_far_above_the_noise_gives_an_answer_and_a_warning(seed):
    # Its leakage covers the noise at every frequency: no terms can fit, and the fit must say so.
    phase = 2 * np.pi * (10 * TIME + 0.1 * TIME**2 / TIME[-1])
    found = identify_noise(rest(seed)[:, 0] + 100 * np.sin(phase), RATE)
    assert found.periodic[0][0].frequency == pytest.approx(10.1, abs=0.05)
    assert found.periodic[0][0].amplitude == pytest.approx(100, rel=0.01)
    assert found.fit["x"].model_error > 0.1


def test_periodic_components_are_told_the_strongest_first():
    lines = sum(a * np.sin(2 * np.pi * f * TIME) for a, f in ((0.2, 3.1), (0.9, 11.0), (0.4, 24.2)))
    (found,) = identify_noise(rest()[:, 0] + lines, RATE).periodic
    assert [p.frequency for p in found] == pytest.approx([11.0, 24.2, 3.1], abs=1e-3)
    assert [p.amplitude for p in found] == pytest.approx([0.9, 0.4, 0.2], abs=0.03)


@pytest.mark.parametrize("start", [0, 40_000, SAMPLES - 50])
def test_shocks_do_not_touch_the_terms(start):
    values = rest().copy()
    values[start : start + 50, 1] += 300 * np.hanning(52)[1:-1]
    values[70_000] -= 40
    found = identify_noise(values, RATE)
    spans = [(s.start, s.stop) for s in found.shocks]
    assert len(spans) == 2
    assert (70_000, 70_001) in spans
    assert any(abs(a - start) <= 6 and abs(b - start - 50) <= 6 for a, b in spans)
    for i in range(3):
        near_the_clean_terms(found, i)


def test_a_slow_swing_of_few_periods_is_a_misfit():
    # Five periods are no line and look like a walk to the spectrum; the Allan curve tells.
    values = rest()[:, 0] + 0.5 * np.sin(2 * np.pi * 0.005 * TIME)
    axis = identify_noise(values, RATE).fit["x"]
    assert axis.model_error > 0.1
    low, high = axis.misfit.tau_range
    # A sinusoid lifts the curve most at 0.37 of its period.
    assert low <= 0.45 * 200
    assert high >= 0.15 * 200
    assert axis.misfit.size > 0.2


def test_a_step_of_the_bias_is_named_and_kept_from_the_terms():
    # Its spectrum is that of a walk of step/√T, which a spectrum cannot tell from it: 0.095 here.
    found = identify_noise(rest()[:, 0] + 3.0 * (TIME > 500), RATE)
    assert found.shocks == ()
    ((step,),) = found.steps
    assert step.start / RATE == pytest.approx(500, abs=0.1)
    assert step.size == pytest.approx(3.0, abs=0.4)
    near_the_clean_terms(found)


def test_a_shaken_record_is_refused():
    values = rest().copy()
    values[20_000:50_000] += 30 * np.random.default_rng([91, 11]).standard_normal((30_000, 3))
    with pytest.raises(Refusal) as refusal:
        identify_noise(values, RATE)
    assert refusal.value.reason.startswith("30 % of the record is knocked or moved")
    assert refusal.value.reason.endswith(": it is not a rest.")


def test_many_shocks_do_not_lower_n():
    values = rest().copy()
    starts = np.arange(1000, SAMPLES - 1000, 2500)
    values[starts] += 50
    found = identify_noise(values, RATE)
    assert len(found.shocks) == len(starts)
    for i in range(3):
        # 40 shocks of a second each are 4 % of the record: bridges without noise would lower N by 2 %.
        near_the_clean_terms(found, i)


# ---- bad input ----


def test_a_record_that_repeats_itself_is_refused():
    with pytest.raises(Refusal) as refusal:
        identify_noise(np.tile([0.0, 1.0], 5000), RATE)
    assert refusal.value.reason == (
        "The record repeats itself: its Allan deviation is zero at τ = 0.02 s. No sensor's noise does."
    )


def test_too_short():
    for samples in (0, 1, 999):
        with pytest.raises(Refusal) as refusal:
            identify_noise(rest()[:samples], RATE)
        assert refusal.value.reason == (
            f"The record has {samples} samples; the Allan deviation needs at least 1000."
        )
        assert refusal.value.remedy == "Record a rest of one hour or more."
    assert identify_noise(rest()[:1000], RATE).fit["x"].terms["random_walk"].value > 0


@pytest.mark.parametrize(("axis", "value"), [(0, 0.0), (1, 1.5), (2, -3e-7)])
def test_constant_data(axis, value):
    values = rest()[:5000].copy()
    values[:, axis] = value
    with pytest.raises(Refusal) as refusal:
        identify_noise(values, RATE)
    assert refusal.value.reason == (f"Axis {'xyz'[axis]} is constant: every sample is {value:g}.")
    assert refusal.value.remedy == "Record again with the sensor running, at a finer resolution."


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 500, 50_000, SAMPLES - 1])
def test_a_sample_that_is_not_finite(bad, row):
    values = rest().copy()
    values[row, 2] = bad
    with pytest.raises(ValueError, match="not finite") as error:
        identify_noise(values, RATE)
    assert str(error.value) == (
        "the signal holds samples that are not finite; bridge or cut them first "
        f"(the first is sample {row})"
    )


def recording(rows):
    values = rest()[rows]
    return Recording("gyroscope", "static", "a.csv", TIME[rows], values, rate=RATE, unit="rad/s")


def test_a_single_nan_is_bridged_on_the_way():
    values = rest().copy()
    values[50_000, 1] = np.nan
    run = Recording("gyroscope", "static", "a.csv", TIME, values, rate=RATE, unit="rad/s")
    even, done = run.evenly_sampled()
    assert done == (
        "1 missing sample in 1 short gap (1 row without a value among them) bridged linearly.",
    )
    found = identify_noise(even.values, even.rate, even.sensor)
    for i in range(3):
        near_the_clean_terms(found, i, widths=0.05)


def test_three_tenths_missing_here_and_there_are_refused():
    rows = np.flatnonzero(np.random.default_rng([91, 12]).uniform(size=SAMPLES) > 0.3)
    with pytest.raises(Refusal) as refusal:
        recording(rows).evenly_sampled()
    assert refusal.value.reason.startswith("a.csv has no even time base: only ")
    assert f" of {len(rows)} samples of the gyroscope follow one another" in refusal.value.reason
    assert refusal.value.remedy == "Record again without losses."


def test_three_tenths_missing_in_one_gap_leave_the_longer_part():
    rows = np.concatenate([np.arange(10_000), np.arange(40_000, SAMPLES)])
    even, done = recording(rows).evenly_sampled()
    assert done == (
        "The longest stretch without a gap is used: 400 s to 999.99 s, 60000 of 70000 samples.",
    )
    found = identify_noise(even.values, even.rate, even.sensor)
    assert found.curve.samples == 60_000
    n = found.fit["x"].terms["random_walk"]
    assert n.low < 0.1 < n.high


def test_cluster_times_beyond_half_of_the_record():
    with pytest.raises(ValueError, match="cluster size") as error:
        allan_deviation(rest()[:2000], RATE, [10, 1000, 1001, 1500])
    assert str(error.value) == (
        "cluster size 1001 is outside 1 … 1000: two clusters must fit into the record of 2000 samples"
    )


# ---- kinds of input ----


def test_one_axis_or_three():
    column = rest()[:20_000, 1]
    one, row = identify_noise(column, RATE), identify_noise(column[:, None], RATE)
    three = identify_noise(rest()[:20_000], RATE)
    assert len(one.fit.axes) == 1
    assert one.fit["x"].terms == row.fit["x"].terms == three.fit["y"].terms
    for name in TERMS:
        a, b = one.allan_fit["x"].terms[name], three.allan_fit["y"].terms[name]
        assert (a is None) == (b is None)
        # A column of three is summed in another order.
        assert a is None or b.value == pytest.approx(a.value, rel=1e-9)


def test_whole_numbers():
    counts = np.round(10 * rest()).astype(np.int16)
    found = identify_noise(counts, RATE)
    # Rounding adds 1/12 to a variance of 100.
    for a, b in zip(found.fit.axes, clean().fit.axes, strict=True):
        expected = 10 * b.coefficients.random_walk * np.sqrt(1 + 1 / 1200)
        assert a.coefficients.random_walk == pytest.approx(expected, rel=2e-3)
    assert found.periodic == ((), (), ())


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_unit_and_offset(scale):
    values = rest()[:20_000].copy()
    values[5000:5010] += 100
    values[:, 0] += np.sin(2 * np.pi * 7.3 * TIME[:20_000])
    one = identify_noise(values, RATE)
    other = identify_noise(scale * (values + 3.0), RATE)
    assert [(s.start, s.stop) for s in one.shocks] == [(s.start, s.stop) for s in other.shocks]
    for i in range(3):
        for estimate in ("fit", "allan_fit"):
            a, b = (getattr(f, estimate).axes[i] for f in (one, other))
            for name in TERMS:
                assert (a.terms[name] is None) == (b.terms[name] is None)
                if a.terms[name]:
                    assert b.terms[name].value == pytest.approx(
                        scale * a.terms[name].value, rel=1e-3
                    )
    assert other.periodic[0][0].amplitude == pytest.approx(scale, rel=0.05)


@pytest.mark.parametrize(("order", "cutoff"), [(1, 15.0), (4, 20.0)])
def test_the_low_pass_enters_the_explained_curve(order, cutoff):
    rng = np.random.default_rng([91, 13, order])
    values = low_passed(rng.standard_normal(SAMPLES + 2000), order, cutoff, RATE)
    found = identify_noise(values, RATE)
    n = found.fit["x"].terms["random_walk"]
    assert n.low < 0.1 < n.high
    ratio = np.sqrt(found.fit["x"].variance) / found.curve.deviation[:, 0]
    short = found.curve.tau < 1
    # N to 0.5 %, the curve at a second to 5 %; the terms alone are twice too high at the first sample.
    assert np.abs(ratio[short] - 1).max() < 0.05
    assert np.sqrt(found.fit["x"].model.allan_variance(0.01)) > 1.5 * found.curve.deviation[0, 0]


# ---- real recordings ----

RECORDINGS = ("adis16405-1", "adis16405-2", "adis16405-3")


@pytest.fixture(scope="module")
def real(real_data):
    """Identified by sensor and recording."""
    found = {}
    for sensor in ("gyroscope", "accelerometer"):
        for name in RECORDINGS:
            run = getattr(sensorbook.load(real_data / name), sensor).static
            found[sensor, name] = identify_noise(run.values, run.rate, sensor)
    return found


def n_of(real, sensor):
    return np.array(
        [[a.terms["random_walk"].value for a in real[sensor, name].fit.axes] for name in RECORDINGS]
    )


def test_n_of_a_real_gyroscope_repeats(real):
    n = n_of(real, "gyroscope")
    assert np.abs(n / n.mean(axis=0) - 1).max() < 0.05


def test_n_of_a_real_accelerometer_follows_its_floor(real, real_data):
    # The floor itself moves by 5.2 % between the recordings: Welch's median between the lines and below
    # the roll-off, with which N goes up and down; what is left are their scatter and the lines' skirts.
    n, floor = n_of(real, "accelerometer"), []
    for name in RECORDINGS:
        run = sensorbook.load(str(real_data / name)).runs("accelerometer", "static")[0]
        f, density = signal.welch(run.values, run.rate, nperseg=4096, axis=0)
        floor.append(np.sqrt(np.median(density[(f > 4.2) & (f < 8)], axis=0) / 2))
    ratio = n / np.array(floor)
    assert np.abs(ratio / ratio.mean(axis=0) - 1).max() < 0.02
    assert np.abs(n / n.mean(axis=0) - 1).max() < 0.06


def test_shocks_of_a_real_accelerometer_are_named(real):
    spans = [(s.start / 100, s.stop / 100) for s in real["accelerometer", "adis16405-1"].shocks]
    for second in (3.3, 6.8):
        assert any(a - 0.05 < second < b + 0.05 for a, b in spans)
    # A quiet desk: 1e6 samples, and five standard deviations more than any normal variable has.
    assert len(spans) <= 6
    assert real["accelerometer", "adis16405-2"].shocks == ()


@pytest.mark.parametrize("name", RECORDINGS)
def test_periodic_component_of_real_accelerometers(real, name):
    for axis in real["accelerometer", name].periodic:
        near = [p for p in axis if 0.53 < p.frequency < 0.60]
        assert near
        assert near[0].amplitude > 0.004  # m/s²
        assert near[0].band[1] - near[0].band[0] < 0.3


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_terms_give_the_allan_curve_of_real_gyroscopes(real, name):
    found = real["gyroscope", name]
    for i, axis in enumerate(found.fit.axes):
        model, deviation = np.sqrt(axis.variance), found.curve.deviation[:, i]
        # Within 1 s a resonance of z, whose skirts no low-pass has, leaves the prediction 1.6 % off.
        assert np.abs(model / deviation - 1)[found.curve.tau < 1].max() < 0.02


def test_most_of_the_allan_curves_of_real_gyroscopes_lie_inside(real):
    shares = [inside(real["gyroscope", name], i).mean() for name in RECORDINGS for i in range(3)]
    assert np.mean(shares) > 0.85


# ---- low-pass, averaging ----


def test_the_low_pass_is_taken_into_account():
    # A digital filter on white noise; without its correlation time N would come out 2 % too small.
    rng = np.random.default_rng([91, 1])
    sos = signal.butter(2, 20.0, fs=100.0, output="sos")
    values = signal.sosfilt(sos, rng.standard_normal(360_000 + 2000))[2000:]
    found = identify_noise(values, 100.0, "gyroscope")
    assert found.low_passes[0].cutoff == pytest.approx(20.0, rel=0.05)
    n = found.fit["x"].terms["random_walk"]
    # Density of unit white noise at 100 Hz; known to some 0.5 % in an hour.
    assert n.value == pytest.approx(0.1, rel=0.015)
    assert n.low < 0.1 < n.high


@pytest.mark.parametrize(
    ("terms", "follows"),
    [
        ({"random_walk": 1.0, "rate_random_walk": 0.2}, {"rises"}),
        ({"random_walk": 1.0}, {"falls", "level"}),
        ({"random_walk": 1.0, "bias_instability": 1.0}, {"level", "falls"}),
    ],
)
def test_best_averaging(terms, follows):
    rng = np.random.default_rng([91, 2])
    found = identify_noise(coloured_noise(100_000, 10.0, rng, **terms), 10.0)
    tau, best, then = best_averaging(found.curve, found.fit["x"], found.curve.deviation[:, 0])
    assert then in follows
    assert best.low < best.value < best.high
    assert best.value == pytest.approx(found.curve.at(tau)[0], rel=1e-9)
    if then == "rises":
        # σ² = N²/τ + K²τ/3 is lowest at τ = √3 N/K = 8.7 s; the bottom is flat to an octave.
        assert 4 < tau < 18
