"""A sweep reduced to block means."""

import numpy as np
import pytest

from sensorbook import Refusal
from sensorbook.thermal import reduce_sweep


def record(seconds=6000, rate=2.0, low=20.0, high=44.0, seed=1, noise=1.0):
    """Up and down once; three axes of white noise."""
    n = int(seconds * rate)
    time = np.arange(n) / rate
    temperature = low + (high - low) * (1 - np.abs(2 * time / seconds - 1))
    values = noise * np.random.default_rng([81, seed]).standard_normal((n, 3))
    return time, temperature, values


def test_blocks_are_means():
    time, temperature, values = record()
    values[:, 0], values[:, 1] = temperature, 3 * time
    sweep = reduce_sweep([(time, temperature, values)])
    assert len(sweep.time) == 600
    assert sweep.disturbed == 0
    # 12 000 samples at 2 Hz, 20 a block.
    np.testing.assert_allclose(sweep.time, time.reshape(600, 20).mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(sweep.values, values.reshape(600, 20, 3).mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(sweep.values[:, 0], sweep.temperature, rtol=1e-12)
    assert sweep.block_seconds == pytest.approx(10.0)
    assert sweep.files == ("run 1",)
    assert sweep.span == (sweep.temperature.min(), sweep.temperature.max())


def test_weights_are_even_over_temperature():
    # Nine tenths of the time at one end, as with a soak.
    time = np.arange(12_000) / 2.0
    temperature = np.interp(time, [0, 5400, 6000], [20.0, 21.0, 40.0])
    sweep = reduce_sweep([(time, temperature, np.zeros((12_000, 1)))])
    assert sweep.weight.mean() == pytest.approx(1)
    bins = ((sweep.temperature - sweep.span[0]) / np.ptp(sweep.temperature) * 20).clip(0, 19)
    share = np.bincount(bins.astype(int), sweep.weight)
    # No bin counts more than another, and thin ones are not raised beyond ten times.
    assert share.max() / share[0] < 1.01
    assert sweep.weight.max() / sweep.weight.min() <= 10.001


def test_direction():
    time = np.arange(12_000) / 2.0
    temperature = np.interp(time, [0, 1000, 3000, 4000, 6000], [20.0, 20.0, 40.0, 40.0, 20.0])
    temperature += 0.02 * np.random.default_rng(82).standard_normal(12_000)
    sweep = reduce_sweep([(time, temperature, np.zeros((12_000, 1)))])
    for start, end, sign in ((0, 1000, 0), (1000, 3000, 1), (3000, 4000, 0), (4000, 6000, -1)):
        # The line over ±4 blocks of 10 s blurs the turns.
        inside = (sweep.time > start + 60) & (sweep.time < end - 60)
        assert inside.sum() > 80
        assert (sweep.direction[inside] == sign).all()


def test_knocked_blocks_are_left_out_and_counted():
    time, temperature, values = record()
    clean = reduce_sweep([(time, temperature, values)])
    for second in (1004.0, 2504.0, 4004.0):  # in the middle of a block of 10 s
        values[round(2 * second), 1] += 100.0
    sweep = reduce_sweep([(time, temperature, values)])
    assert sweep.disturbed == 3
    assert len(sweep.time) == 597
    assert np.setdiff1d(clean.time, sweep.time) == pytest.approx([1004.75, 2504.75, 4004.75])
    assert np.abs(sweep.values).max() < 2


def test_a_steady_signal_has_no_knocks():
    time, temperature, _ = record()
    assert reduce_sweep([(time, temperature, np.ones((len(time), 3)))]).disturbed == 0


def test_rows_that_are_not_finite_are_left_out():
    time, temperature, values = record()
    clean = reduce_sweep([(time, temperature, values)])
    values[7000, 2] = np.nan
    temperature[7100] = np.inf
    time[7200] = np.nan
    sweep = reduce_sweep([(time, temperature, values)])
    assert np.isfinite(sweep.values).all()
    assert np.isfinite(sweep.temperature).all()
    assert len(sweep.time) == 600
    # One sample of twenty is missing from a block: its mean moves by a twentieth of the scatter.
    assert np.abs(sweep.values - clean.values).max() < 0.5


def test_runs_one_after_the_other():
    one, two = record(seed=1), record(seconds=3000, low=10.0, seed=2)
    sweep = reduce_sweep([one, two], ["a.csv", "b.csv"])
    assert sweep.files == ("a.csv", "b.csv")
    np.testing.assert_array_equal(np.unique(sweep.run), [0, 1])
    assert (np.diff(sweep.run) >= 0).all()
    alone = reduce_sweep([two])
    np.testing.assert_array_equal(sweep.values[sweep.run == 1], alone.values)
    assert sweep.span[0] == pytest.approx(10, abs=0.3)


@pytest.mark.parametrize("high", [24.9, 20.0])
def test_too_narrow_a_sweep(high):
    with pytest.raises(Refusal) as refused:
        reduce_sweep([record(high=high)])
    assert refused.value.reason.startswith(
        f"The temperature moves by {high - 20:.1f} °C in all; below"
    )
    assert (
        "below 5 °C a change with temperature cannot be told from a drift" in refused.value.reason
    )
    assert refused.value.remedy.startswith("Record a sweep over the range of use, up and down")


def test_five_degrees_are_enough():
    assert np.ptp(reduce_sweep([record(high=25.2)]).temperature) > 5


def test_too_few_stretches():
    time, temperature, values = record(seconds=59, rate=1.0)
    with pytest.raises(Refusal) as refused:
        reduce_sweep([(time, temperature, values)])
    assert refused.value.reason == (
        "The sweep leaves 59 undisturbed stretches; a thermal fit needs 60 or more."
    )
    assert refused.value.remedy == "Record a sweep of an hour or more with the sensor fixed."
    assert len(reduce_sweep([record(seconds=60, rate=1.0)]).time) == 60


@pytest.mark.parametrize("samples", [0, 1])
def test_an_empty_record_is_refused_not_a_fault(samples):
    time, temperature, values = (x[:samples] for x in record())
    with pytest.raises(Refusal, match="leaves 0 undisturbed stretches"):
        reduce_sweep([(time, temperature, values)])
