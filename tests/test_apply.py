"""Correcting a recording with the thermal model found."""

import numpy as np
import pytest

from sensorbook import Recording
from sensorbook.apply import SMOOTHING, remove_thermal
from sensorbook.thermal import ThermalModel

RATE = 10.0
SLOPES = (0.01, -0.02, 0.0)
THERMAL = {
    axis: ThermalModel(30.0, ((20.0, 40.0, (7.0, slope)),)).to_results()
    for axis, slope in zip("xyz", SLOPES, strict=True)
}


def recording(temperature, values=None, rate=RATE):
    n = 6000 if temperature is None else len(temperature)
    values = np.zeros((n, 3)) if values is None else values
    return Recording(
        "gyroscope",
        "static",
        "a.csv",
        np.arange(n) / RATE,
        values,
        temperature=temperature,
        rate=rate,
        unit="rad/s",
        sha256="abc",
        declaration={"unit": "rad/s"},
    )


def test_the_change_is_subtracted_not_the_reading():
    run = recording(np.full(6000, 35.0), np.full((6000, 3), 2.0))
    corrected, said, _ = remove_thermal(run, THERMAL)
    # 5 °C above the reference; the model's own offset, 7, stays out of it.
    np.testing.assert_allclose(corrected.values, np.tile(2 - 5 * np.array(SLOPES), (6000, 1)))
    assert said == (
        "The bias's change with temperature is subtracted, relative to 30 °C "
        "(model of this device, 20.0 … 40.0 °C; record 35.0 … 35.0 °C)."
    )


def test_nothing_changes_at_the_reference():
    values = np.random.default_rng(111).normal(size=(6000, 3))
    corrected, _, _ = remove_thermal(recording(np.full(6000, 30.0), values), THERMAL)
    np.testing.assert_array_equal(corrected.values, values)


def test_the_rest_of_the_record_stays():
    run = recording(np.full(6000, 35.0))
    corrected, _, _ = remove_thermal(run, THERMAL)
    assert (run.values == 0).all()
    for name in ("sensor", "kind", "file", "rate", "unit", "sha256", "declaration", "findings"):
        assert getattr(corrected, name) == getattr(run, name)
    np.testing.assert_array_equal(corrected.time, run.time)
    np.testing.assert_array_equal(corrected.temperature, run.temperature)


@pytest.mark.parametrize("direction", [1, -1])
def test_smoothing_does_not_shift_a_slow_ramp(direction):
    time = np.arange(12_000) / RATE
    pace = direction * 0.5 / 60  # °C/s
    temperature = 30.0 + pace * (time - 600)
    true = np.outer(temperature - 30, SLOPES)
    corrected, _, _ = remove_thermal(recording(temperature, true), THERMAL)
    inside = slice(round(SMOOTHING * RATE), -round(SMOOTHING * RATE))
    # A window of an even number of samples lies half a sample off.
    half_sample = 0.5 / RATE * abs(pace) * max(map(abs, SLOPES))
    assert np.abs(corrected.values[inside]).max() <= 1.01 * half_sample
    # At the ends half of the window is held: an eighth of its length.
    ends = SMOOTHING / 8 * abs(pace) * max(map(abs, SLOPES))
    assert np.abs(corrected.values).max() <= 1.05 * ends


def test_thermometer_noise_stays_out_of_the_signal():
    temperature = 35 + 0.5 * np.random.default_rng(112).standard_normal(60_000)
    corrected, _, _ = remove_thermal(recording(temperature), THERMAL)
    # A mean over 300 samples: 0.5/√300 = 0.029 °C.
    assert np.std(corrected.x) == pytest.approx(0.01 * 0.5 / np.sqrt(300), rel=0.2)


def test_outside_the_range_the_edge_is_held_and_said():
    # The last quarter is far above the range.
    temperature = np.where(np.arange(60_000) < 45_000, 35.0, 80.0)
    corrected, _, warned = remove_thermal(recording(temperature), THERMAL)
    assert corrected.x[-1] == pytest.approx(-0.01 * 10)
    assert corrected.x[0] == pytest.approx(-0.01 * 5)
    assert warned == (
        "For 25 % of the record the temperature is outside the thermal model's range; there the "
        "value at its edge is subtracted, and what changes beyond it stays."
    )


def test_below_the_range():
    corrected, _, warned = remove_thermal(recording(np.full(6000, -40.0)), THERMAL)
    assert corrected.y[100] == pytest.approx(-0.02 * 10)
    assert "For 100 % of the record" in warned


def test_a_jump_is_removed():
    model = ThermalModel(
        30.0, ((20.0, 24.0, (1.0,)), (24.0, 25.0, (6.0, 1 / 1.0)), (25.0, 40.0, (1.5,)))
    )
    thermal = dict.fromkeys("xyz", model.to_results())
    corrected, _, _ = remove_thermal(recording(np.full(6000, 22.0)), thermal)
    np.testing.assert_allclose(corrected.values, 0.5)


def test_no_temperature():
    run = recording(None)
    corrected, said, _ = remove_thermal(run, THERMAL)
    assert corrected is run
    assert said == "The record holds no temperature: it stays as it is, uncompensated."


@pytest.mark.parametrize("thermal", [None, {}])
def test_no_model(thermal):
    run = recording(np.full(6000, 35.0))
    corrected, said, _ = remove_thermal(run, thermal)
    assert corrected is run
    assert said == "No thermal model of this sensor is at hand: the record stays as it is."


def test_a_refused_model():
    run = recording(np.full(6000, 35.0))
    corrected, said, _ = remove_thermal(
        run, {"model": None, "reason": "The temperature stood still."}
    )
    assert corrected is run
    assert said == (
        "No thermal model of this sensor is at hand (The temperature stood still.): "
        "the record stays as it is."
    )


def test_without_a_rate():
    corrected, _, _ = remove_thermal(recording(np.full(6000, 35.0), rate=None), THERMAL)
    np.testing.assert_allclose(corrected.x, -0.05)


def test_a_missing_temperature_does_not_spoil_the_record():
    temperature = np.full(6000, 35.0)
    temperature[100] = np.nan
    corrected, said, _ = remove_thermal(recording(temperature), THERMAL)
    assert np.isfinite(corrected.values[1000:]).all()
    assert "nan" not in said
