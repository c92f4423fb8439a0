"""Static calibration of accelerometer and gyroscope (A 5.1–5.5, work B)."""

from __future__ import annotations

from sensorbook.calibration.find import find_faces, find_positions, require_gyroscope
from sensorbook.calibration.known_directions import recursive, six_position
from sensorbook.calibration.model import ErrorModel
from sensorbook.calibration.motions import Directions, all_motions
from sensorbook.calibration.multi_position import multi_position
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.calibration.rest_to_rest import rest_to_rest
from sensorbook.calibration.result import Calibration
from sensorbook.earth import STANDARD_GRAVITY

__all__ = [
    "Calibration",
    "ErrorModel",
    "calibrate_gyroscope",
    "calibrate_positions",
    "find_faces",
    "find_positions",
    "multi_position",
    "recursive",
    "six_position",
]


def calibrate_gyroscope(gyroscope, accelerometer, gravity: float = STANDARD_GRAVITY) -> Calibration:
    """A gyroscope's calibration from one recording of kind "positions" and the accelerometer's beside it."""
    found = find_positions([accelerometer], [gyroscope], gravity)
    require_gyroscope(found)
    level = multi_position(found.positions, gravity)
    found = found[level.kept]  # a rest that does not belong has no direction to trust
    rests = require_gyroscope(found)
    directions = Directions.by(level, found.positions)
    fit = fit_rests(rests, directions.acceleration)
    motions = all_motions([gyroscope], [accelerometer], found, directions, level.model, fit)
    return rest_to_rest(motions, fit, gravity)


def calibrate_positions(recording, gravity: float = STANDARD_GRAVITY) -> Calibration:
    """Multi-position calibration of one accelerometer recording of kind "positions"."""
    return multi_position(find_positions([recording], (), gravity).positions, gravity)
