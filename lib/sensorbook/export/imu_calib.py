"""The file of imu_calib's node apply_calib: the accelerometer's calibration.

Source: dpkoch/imu_calib, src/accel_calib/accel_calib.cpp (`loadCalib`, `applyCalib`), src/apply_calib.cpp.
"""

from __future__ import annotations

from sensorbook.export.autopilot import comments
from sensorbook.export.calibration import origin
from sensorbook.export.ros_params import affine, flat
from sensorbook.export.source import Attempts, Entry

CONVENTION = (
    "",
    "imu_calib computes acceleration = SM * raw - bias, in m/s^2, SM by rows.",
    "This is not the convention of the results, true = inverse(matrix) * (raw - bias): here"
    " SM = inverse(matrix) and bias = inverse(matrix) * bias of the results.",
    "Axes are those of the recording, in the order x, y, z, and must be those of the topic raw.",
    "The gyroscope is not in this file: apply_calib subtracts its mean at rest, measured at each start.",
)


def render(results: Entry) -> str:
    """The file; raises `InputError` as `read_triad` of the accelerometer does."""
    attempt = Attempts()
    head, found = attempt(origin, results), attempt(affine, results)
    attempt.end()
    notes, matrix, bias = found
    lines = comments([*head, *notes, *CONVENTION])
    return "\n".join([*lines, f"SM: {flat(matrix)}  # 1", f"bias: {flat(bias)}  # m/s^2"]) + "\n"
