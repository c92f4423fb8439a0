"""Calibration of magnetometers (A 6.1–6.9, 7.4) and their alignment with an accelerometer."""

from __future__ import annotations

from sensorbook.earth import field_at
from sensorbook.magnetometer.fit import calibrate
from sensorbook.magnetometer.result import MagnetometerCalibration

__all__ = ["MagnetometerCalibration", "calibrate", "calibrate_rotation"]


def calibrate_rotation(recording, site=None) -> MagnetometerCalibration:
    """A magnetometer's calibration from one recording of kind "rotation".

    `site` is a device's `[site]`; with place and date the Earth's field gives the scale.
    """
    known = field_at(site)
    return calibrate(recording.values, known.strength, known.std, known.source)
