"""PX4's calibrations, as a file of parameters that QGroundControl loads (.params).

Sources: PX4-Autopilot, src/lib/sensor_calibration: Magnetometer.hpp, Accelerometer.hpp, Gyroscope.hpp
(`Correct`), Magnetometer.cpp, Accelerometer.cpp, Gyroscope.cpp (`set_offset`, `set_scale`,
`set_offdiagonal`); src/modules/sensors/module.yaml (units and ranges);
QGroundControl, src/FactSystem/ParameterManager.cc (`readParametersFromStream`).
"""

from __future__ import annotations

from sensorbook.export.autopilot import Group, comments, parameters, read_parts
from sensorbook.export.source import Entry
from sensorbook.export.triad import left_by_offsets, left_by_scales

TARGET = "PX4"
GAUSS = 1e-4  # T
SCALE = (0.1, 3.0)
REAL32 = 9  # MAV_PARAM_TYPE_REAL32

HEAD = (
    "Onboard parameters for Vehicle 1",
    "",
    "QGroundControl wants the vehicle's own ID in the first column.",
)
MAGNETOMETER = (
    "",
    "Calibration of PX4's magnetometer 0, CAL_MAG0. It is that sensor's whose device ID stands in"
    " CAL_MAG0_ID, which PX4 sets when it first calibrates it; this file leaves it alone. Write"
    " CAL_MAG1 and so on where the ID is that of another.",
    "",
)
MAGNETOMETER_FORMULA = (
    "",
    "PX4 computes (calibration::Magnetometer::Correct), in gauss, 1 G = 1e-4 T:",
    "field = rotation * (M * (raw - OFF)), OFF = [XOFF, YOFF, ZOFF]",
    "M = [[XSCALE, XODIAG, YODIAG], [XODIAG, YSCALE, ZODIAG], [YODIAG, ZODIAG, ZSCALE]]",
    "Hence OFF = hard_iron in gauss, as PX4 subtracts it; M = soft_iron. raw is the reading with"
    " its compensation of power where CAL_MAG_COMP_TYP is not 0.",
    "Restart PX4 once the file is loaded: it takes up OFF (in gauss), the three SCALE and the three"
    " ODIAG each only where the vector is more than 0.01 away from what it has, which is 0, 1 and 0"
    " after a start. Smaller corrections may have no effect.",
    "",
    "Axes are those of the recording, in the order x, y, z, and must be those of PX4's topic"
    " sensor_mag. PX4 corrects first and rotates then, so that CAL_MAG0_ROT and SENS_BOARD_ROT"
    " stay. A recording made in other axes, such as the vehicle's, must be rotated back: with R from its"
    " axes to those of sensor_mag, OFF = R * hard_iron and M = R * soft_iron * transpose(R).",
)
ACCELEROMETER = (
    "",
    "Calibration of PX4's accelerometer 0, CAL_ACC0. It is that sensor's whose device ID stands in"
    " CAL_ACC0_ID, as with the magnetometer.",
    "",
)
ACCELEROMETER_FORMULA = (
    "",
    "PX4 computes (calibration::Accelerometer::Correct), in m/s^2, axis by axis before the rotation:",
    "acceleration = rotation * (SCALE * (raw - OFF)), OFF = [XOFF, YOFF, ZOFF]",
    "Of the results: true = inverse(matrix) * (raw - bias). Hence OFF = bias, SCALE = 1/(diagonal of"
    " matrix). raw is the reading less PX4's own thermal offset, where TC_A_ENABLE is not 0.",
    "Axes are those of the recording and must be those of PX4's topic sensor_accel. PX4 takes up OFF"
    " only where it is more than 0.01 m/s^2 away from what it has, which is 0 after a start, and SCALE"
    " where it is more than 0.01 away from 1 (lengths of the vectors).",
)
GYROSCOPE = (
    "",
    "Calibration of PX4's gyroscope 0, CAL_GYRO0. It is that sensor's whose device ID stands in"
    " CAL_GYRO0_ID, as with the magnetometer.",
    "",
)
GYROSCOPE_FORMULA = (
    "",
    "PX4 computes (calibration::Gyroscope::Correct), in rad/s:",
    "rate = rotation * (raw - OFF), OFF = [XOFF, YOFF, ZOFF]",
    "Hence OFF = bias. Axes are those of the recording and must be those of PX4's topic sensor_gyro."
    " Releases differ: some take up OFF only where it is longer than 0.01 rad/s. The estimator learns"
    " what remains.",
)
END = ("", "Vehicle-Id Component-Id Name Value Type")


def render(results: Entry) -> str:
    """The file; raises `InputError` as `read_parts` does, and for what PX4 does not accept."""
    parts = read_parts(results, TARGET)
    iron, accelerometer, gyroscope = parts.magnetometer, parts.accelerometer, parts.gyroscope
    groups = []
    if iron:
        groups += [
            Group("CAL_MAG0_{}OFF", iron.hard_iron, GAUSS),
            Group("CAL_MAG0_{}SCALE", iron.diagonal, 1.0, *SCALE),
            Group("CAL_MAG0_{}ODIAG", iron.off_diagonal),
        ]
    if accelerometer:
        groups += [
            Group("CAL_ACC0_{}OFF", accelerometer.bias),
            Group("CAL_ACC0_{}SCALE", accelerometer.diagonal, 1.0, *SCALE, inverse=True),
        ]
    if gyroscope:
        groups.append(Group("CAL_GYRO0_{}OFF", gyroscope.bias))
    values = parameters(TARGET, groups)
    head = [*HEAD, *parts.head]
    if iron:
        head += [*MAGNETOMETER, *iron.head, *MAGNETOMETER_FORMULA]
    if accelerometer:
        left = left_by_scales(accelerometer)
        head += [*ACCELEROMETER, *accelerometer.head, *ACCELEROMETER_FORMULA, left]
    if gyroscope:
        head += [*GYROSCOPE, *gyroscope.head, *GYROSCOPE_FORMULA, left_by_offsets(gyroscope)]
    rows = [f"1\t1\t{name}\t{value!r}\t{REAL32}" for name, value in values.items()]
    return "\n".join([*comments([*head, *END]), *rows]) + "\n"
