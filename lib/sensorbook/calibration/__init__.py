"""Static calibration of accelerometer and gyroscope (A 5.1–5.5, work B)."""

from __future__ import annotations

from sensorbook.calibration.find import find_faces, find_positions
from sensorbook.calibration.known_directions import recursive, six_position
from sensorbook.calibration.model import ErrorModel
from sensorbook.calibration.multi_position import multi_position
from sensorbook.calibration.result import Calibration
from sensorbook.earth import STANDARD_GRAVITY

__all__ = [
    "Calibration",
    "ErrorModel",
    "calibrate_positions",
    "find_faces",
    "find_positions",
    "multi_position",
    "recursive",
    "six_position",
]


def calibrate_positions(recording, gravity: float = STANDARD_GRAVITY) -> Calibration:
    """Multi-position calibration of one accelerometer recording of kind "positions"."""
    return multi_position(find_positions([recording], (), gravity).positions, gravity)
