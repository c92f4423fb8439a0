"""Calibration of magnetometers (A 6.1–6.9, 7.4) and their alignment with an accelerometer."""

from __future__ import annotations

from sensorbook.earth import field_at
from sensorbook.magnetometer.fit import calibrate
from sensorbook.magnetometer.result import MagnetometerCalibration
from sensorbook.magnetometer.runs import calibrate_runs, prepared

__all__ = ["MagnetometerCalibration", "calibrate", "calibrate_rotation"]


def calibrate_rotation(recording, site=None) -> MagnetometerCalibration:
    """A magnetometer's calibration from one recording of kind "rotation".

    `site` is a device's `[site]`; with place and date the Earth's field gives the scale.
    """
    return calibrate_runs([prepared(recording)[0]], field_at(site)).fit
