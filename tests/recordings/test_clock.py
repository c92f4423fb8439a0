"""Time stamps: rate, gaps, and the even time base made of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensorbook import Refusal
from sensorbook.recordings.clock import lost_samples, measured_rate, missing_samples, shuffled

from .conftest import recording

# ---- the clock ----


@given(
    rate=st.sampled_from([1.0, 28.5714, 100.0, 102.4, 1000.0]),
    jitter=st.floats(min_value=0, max_value=0.4),
    start=st.sampled_from([0.0, 12.5, 1.7e9]),
)
def test_the_rate_is_found_whatever_the_jitter(rate, jitter, start):
    rng = np.random.default_rng(1)
    time = start + (np.arange(2000) + jitter * rng.uniform(-1, 1, 2000)) / rate
    # Stamps far from zero are rounded to 2.4e-7 s.
    assert measured_rate(time) == pytest.approx(rate, rel=1e-3 + 1e-6 * rate)
    assert not missing_samples(np.sort(time), rate).any()


def test_rows_out_of_order_are_told_from_clocks_that_err():
    rng = np.random.default_rng(2)
    time = np.arange(2000) / 100
    mixed = rng.permutation(time)
    assert shuffled(mixed)
    assert shuffled(np.where(rng.random(2000) < 0.1, np.nan, mixed))
    assert not shuffled(time)
    assert not shuffled(np.r_[time[1000:], time[:1000]])  # a block out of place
    assert not shuffled(np.tile(time[:100], 20))  # a clock that starts anew
    assert not shuffled(time + rng.normal(scale=0.02, size=2000))  # stamps of arrival
    assert not shuffled(np.full(2000, np.nan))


def test_what_only_wants_sorting_is_told_so():
    time = np.random.default_rng(3).permutation(1000) / 100
    with pytest.raises(Refusal) as caught:
        recording(time).evenly_sampled()
    assert caught.value.remedy == "Sort the file's rows by time."


@pytest.mark.parametrize("rate", [400.0, 600.0, 700.0, 900.0])
def test_a_clock_of_whole_milliseconds_is_no_gap(rate):
    time = np.floor(np.arange(5000) / rate * 1e3) * 1e-3
    found = measured_rate(time)
    assert found == pytest.approx(rate, rel=1e-3)
    assert missing_samples(time, found).sum() == 0


@given(st.sets(st.integers(min_value=5, max_value=980), max_size=30))
def test_every_missing_sample_is_counted(lost):
    time = np.delete(np.arange(1000), sorted(lost)) / 100
    assert measured_rate(time) == 100.0
    assert missing_samples(time, 100.0).sum() == len(lost)


PLACES = np.arange(50, 950, 90)  # 10 of 1000 rows


def lost_of(time):
    good, lost = lost_samples(time, 100.0)
    return {int(good[k + 1]): int(lost[k]) for k in np.flatnonzero(lost)}


@pytest.mark.parametrize("late", [0.5, 1.0, 3.0, 3.1, 2.9, 7.0])  # intervals
def test_rows_of_late_stamps_are_not_lost(late):
    time = np.arange(1000) / 100
    time[PLACES] += late / 100
    assert lost_of(time) == {}
    gone = np.delete(time, np.r_[420:425])  # 415 … 420 … 430: no place among PLACES
    assert lost_of(gone) == {420: 5}


def test_doubled_stamps_are_not_lost_rows():
    time = np.arange(1000) / 100
    time[PLACES] = time[PLACES - 1]
    assert lost_of(time) == {}
    time[PLACES] = time[PLACES + 1]
    assert lost_of(time) == {}
    assert lost_of(np.r_[0.0, 0.0, time[2:]]) == {}
    time = np.arange(1000) / 100
    time[300:400] -= 2.0  # a clock set back and on again
    assert lost_of(time) == {}
    assert lost_of(np.delete(time, np.r_[350:360])) == {390: 10}


def test_copied_rows_hide_no_gap():
    time = np.delete(np.sort(np.r_[np.arange(1000), PLACES]), np.r_[600:604]) / 100
    assert lost_of(time) == {600: 4}
    assert sum(lost_of(np.delete(np.arange(1000), [3, 400, 401]) / 100).values()) == 3


@given(st.lists(st.floats(allow_nan=True), min_size=2, max_size=50))
def test_any_stamps_have_a_number_of_lost_samples(stamps):
    good, lost = lost_samples(np.array(stamps), 100.0)
    assert len(lost) == max(len(good) - 1, 0)
    assert (lost >= 0).all()


# ---- the even time base ----


def test_an_even_recording_is_returned_as_it_is():
    run = recording(np.arange(200) / 100)
    assert run.evenly_sampled() == (run, ())


def test_short_gaps_and_missing_values_are_bridged():
    time = np.delete(np.arange(1000) / 100, [300, 301])
    values = np.column_stack([time, 2 * time, 3 * time])
    values[500, 1] = np.nan
    run, done = recording(time, values, temperature=5 * time).evenly_sampled()
    np.testing.assert_allclose(run.time, np.arange(1000) / 100, atol=1e-12)
    np.testing.assert_allclose(run.values, run.time[:, None] * [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(run.temperature, 5 * run.time, atol=1e-12)
    assert done == (
        "3 missing samples in 2 short gaps (1 row without a value among them) bridged linearly.",
    )


def test_stamps_that_do_not_advance_are_set_aside():
    time = np.sort(np.concatenate((np.arange(500) / 100, [1.0, 2.0])))
    run, done = recording(time).evenly_sampled()
    np.testing.assert_allclose(run.time, np.arange(500) / 100, atol=1e-12)
    assert done == ("2 rows whose time stamp does not advance set aside.",)


def test_the_longest_stretch_is_used_beside_a_long_gap():
    time = np.delete(np.arange(1000) / 100, np.s_[300:350])
    run, done = recording(time).evenly_sampled()
    assert (len(run), run.time[0]) == (650, pytest.approx(3.5))
    assert done == (
        "The longest stretch without a gap is used: 3.5 s to 9.99 s, 650 of 950 samples.",
    )


def test_many_short_gaps_are_not_bridged():
    time = np.delete(np.arange(1000) / 100, np.r_[10:90:2])
    run, _ = recording(time).evenly_sampled()
    assert len(run) == 911  # from the last gap on


@pytest.mark.parametrize(
    ("time", "used"),
    [(np.arange(50) / 100, 50), (np.delete(np.arange(1000) / 100, np.r_[0:1000:40]), 39)],
)
def test_too_little_is_refused(time, used):
    with pytest.raises(Refusal, match=f"only {used} of {len(time)} samples of the gyroscope"):
        recording(time).evenly_sampled()


@given(st.lists(st.floats(allow_nan=True), min_size=100, max_size=150), st.integers(0, 9))
def test_any_stamps_give_an_even_recording_or_a_refusal(stamps, seed):
    time = np.array(stamps)
    rate = measured_rate(time)
    try:
        run, done = recording(time, rate=rate).evenly_sampled()
    except Refusal:
        return
    assert len(done) or len(run) == len(time)
    assert len(run) >= 100
