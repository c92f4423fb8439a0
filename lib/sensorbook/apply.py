"""Corrects recordings with what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from sensorbook.calibration.model import ErrorModel
from sensorbook.errors import InputError, Problem
from sensorbook.recordings import Recording
from sensorbook.recordings.checks import finite
from sensorbook.thermal import ThermalModel

CHUNK = 1 << 16  # samples whose own matrices are held at once
EDGE = 0.1  # °C beyond the calibrated range that does not count as outside; thermometers err by it
STRENGTH = 1.5  # of the field's strength: more is another place, or readings in another unit
SMOOTHING = (
    30.0  # s; a die follows its housing no faster, and thermometer noise stays out of the signal
)


def remove_thermal(recording: Recording, thermal: dict | None) -> tuple[Recording, str, str]:
    """The recording less B(T) − B(reference), what was done, and a warning (empty for none).

    Parameters
    ----------
    recording : with its temperature; one without is returned as it is
    thermal : `thermal` of results.json for this sensor, by axis; None where there is no model
    """
    if not thermal or "reason" in thermal:
        reason = f" ({thermal['reason']})" if thermal else ""
        return (
            recording,
            f"No thermal model of this sensor is at hand{reason}: the record stays as it is.",
            "",
        )
    if recording.temperature is None:
        return recording, "The record holds no temperature: it stays as it is, uncompensated.", ""
    if not np.isfinite(recording.temperature).any():
        return (
            recording,
            "The record's temperature is missing throughout: it stays uncompensated.",
            "",
        )
    smooth = _smoothed_temperature(recording)
    values = np.array(recording.values)
    outside = np.zeros(len(values), dtype=bool)
    for i, axis in enumerate("xyz"):
        model = ThermalModel.from_results(thermal[axis])
        values[:, i] -= model.change(smooth)
        outside |= (smooth < model.range[0] - EDGE) | (smooth > model.range[1] + EDGE)
    low, high = model.range
    text = (
        f"The bias's change with temperature is subtracted, relative to {model.reference:g} °C "
        f"(model of this device, {low:.1f} … {high:.1f} °C; record {smooth.min():.1f} … "
        f"{smooth.max():.1f} °C)."
    )
    warning = ""
    if outside.any():
        warning = (
            f"For {100 * outside.mean():.0f} % of the record the temperature is outside the thermal "
            "model's range; there the value at its edge is subtracted, and what changes beyond it stays."
        )
    return replace(recording, values=values), text, warning


def correct(
    recording: Recording, result: dict, acceleration: np.ndarray | None = None
) -> tuple[Recording, list[str], list[str], list[str]]:
    """The recording corrected with what was found: thermal model first, then the calibration.

    Parameters
    ----------
    recording : raw, SI
    result : `sensors.<sensor>` of results.json
    acceleration : (N, 3) m/s², corrected, of the same samples, for a gyroscope's sensitivity to it

    Returns
    -------
    recording : corrected; NaN on all axes where one is missing
    steps : what was done, in words; empty where there is nothing to do
    notes : what to know about it
    reasons : why something was not done
    """
    steps, notes, reasons = [], [], []
    thermal, calibration = result.get("thermal"), result.get("calibration") or {}
    if thermal and "reason" in thermal:
        reasons.append(f"no thermal model: {thermal['reason']}")
    elif thermal:
        before = recording
        recording, sentence, warning = remove_thermal(recording, thermal)
        if recording is before:
            notes.append(sentence)
        else:
            steps.append("thermal model")
        if warning:
            notes.append(warning)
    if calibration.get("method") is None:
        reasons.append(f"no calibration: {calibration.get('reason', 'none was recorded')}")
    elif "soft_iron" in calibration:
        recording = _without_iron(recording, calibration)
        notes += _of_another_strength(recording, calibration)
        steps.append(f"hard and soft iron ({calibration['method'].replace('_', ' ')})")
    else:
        recording, more = _undistort(recording, calibration, acceleration)
        notes += more
        steps.append(f"calibration ({calibration['method'].replace('_', ' ')})")
    return recording, steps, notes, reasons


def _without_iron(recording: Recording, calibration: dict) -> Recording:
    """soft_iron · (raw − hard_iron)."""
    try:
        hard_iron, soft_iron = (
            np.array(calibration[name], dtype=np.float64) for name in ("hard_iron", "soft_iron")
        )
        if hard_iron.shape != (3,) or soft_iron.shape != (3, 3):
            raise ValueError(
                "hard_iron is not of three numbers, or soft_iron not of three by three"
            )
        if not (np.isfinite(hard_iron).all() and np.isfinite(soft_iron).all()):
            raise ValueError("hard_iron or soft_iron is not finite")
    except (KeyError, TypeError, ValueError) as error:
        raise _useless(recording, error) from None
    return replace(recording, values=(recording.values - hard_iron) @ soft_iron.T)


def _of_another_strength(corrected: Recording, calibration: dict) -> list[str]:
    """A note where corrected readings are far from the field's strength in the calibration."""
    field = calibration.get("field")
    lengths = np.linalg.norm(corrected.values, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    if not (finite(field) and field > 0 and len(lengths)):
        return []
    strength = float(np.median(lengths))
    if field / STRENGTH <= strength <= field * STRENGTH:
        return []
    return [
        f"corrected, the field is {1e6 * strength:.3g} µT strong in the median, where the calibration has "
        f"{1e6 * field:.3g} µT: the file's unit or the place is another"
    ]


def _useless(recording: Recording, error: Exception) -> InputError:
    where = f"sensors.{recording.sensor}.calibration"
    mend = "render it again with: sensorbook report"
    return InputError(Problem("results.json", where, f"cannot serve: {error}", mend))


def _undistort(recording: Recording, calibration: dict, acceleration: np.ndarray | None):
    """The exact inverse of the deterministic error model, and what to know about it."""
    notes = []
    try:
        model = ErrorModel.from_results(calibration)
        np.linalg.inv(model.matrix)
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise _useless(recording, error) from None
    if not model.g_sensitivity.any():
        acceleration = None
    elif acceleration is not None:
        acceleration = _bridged(acceleration)
    else:
        notes.append(
            "its sensitivity to acceleration is left in, as the file has no corrected accelerometer beside it"
        )
    entry = calibration.get("temperature")
    without = recording.temperature is None or not np.isfinite(recording.temperature).any()
    if not entry or without:
        if entry:
            notes.append(
                "the file holds no temperature: the calibration at the reference one is used"
            )
        return replace(recording, values=model.correct(recording.values, acceleration)), notes
    low, high = entry["range"]
    warmth = _smoothed_temperature(recording)
    outside = (warmth < low - EDGE) | (warmth > high + EDGE)
    if outside.any():
        notes.append(
            f"for {100 * outside.mean():.0f} % of the file the temperature is outside the calibrated "
            f"{low:.1f} … {high:.1f} °C; there the calibration at the edge is used"
        )
    step = np.clip(warmth, low, high) - calibration["reference_temperature"]
    values = np.empty_like(recording.values)
    for start in range(0, len(values), CHUNK):
        part = slice(start, start + CHUNK)
        powers = step[part, None] ** np.arange(1, entry["degree"] + 1)
        matrix = model.matrix + np.einsum("nk,kij->nij", powers, entry["matrix_coefficients"])
        bias = model.bias + powers @ np.array(entry["bias_coefficients"])
        if acceleration is not None:
            bias = bias + acceleration[part] @ model.g_sensitivity.T
        values[part] = np.linalg.solve(matrix, (recording.values[part] - bias)[..., None])[..., 0]
    return replace(recording, values=values), notes


def _bridged(values: np.ndarray) -> np.ndarray:
    """(N, 3) with missing rows bridged linearly: their effect on another sensor is of second order."""
    known = np.isfinite(values).all(axis=1)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    rows = np.arange(len(values))
    return np.stack([np.interp(rows, rows[known], column[known]) for column in values.T], axis=1)


def _smoothed_temperature(recording: Recording) -> np.ndarray:
    """(N,) °C, missing values bridged, thermometer noise smoothed away."""
    width = (
        round(SMOOTHING * (recording.rate or 1.0)) | 1
    )  # odd, or it would shift by half a sample
    known = np.isfinite(recording.temperature)
    bridged = np.interp(recording.time, recording.time[known], recording.temperature[known])
    return ndimage.uniform_filter1d(bridged, width, mode="nearest")
