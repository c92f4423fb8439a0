"""Corrects recordings with what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from sensorbook.recordings import Recording
from sensorbook.thermal import ThermalModel

EDGE = 0.1  # °C beyond the calibrated range that does not count as outside; thermometers err by it
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
    width = max(1, round(SMOOTHING * (recording.rate or 1.0)))
    temperature, known = recording.temperature, np.isfinite(recording.temperature)
    if not known.any():
        return (
            recording,
            "The record's temperature is missing throughout: it stays uncompensated.",
            "",
        )
    temperature = np.interp(recording.time, recording.time[known], temperature[known])
    smooth = ndimage.uniform_filter1d(temperature, width, mode="nearest")
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
