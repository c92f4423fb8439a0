"""ArduPilot's parameters of compass and inertial sensors, as a file of NAME,VALUE lines (.param, .parm).

Sources: ArduPilot, libraries/AP_Compass: AP_Compass_Backend.cpp (`rotate_field`, `correct_field`),
AP_Compass.cpp (parameters, `configured`, `have_scale_factor`), CompassCalibrator.cpp
(`fit_acceptable`); libraries/AP_InertialSensor: AP_InertialSensor_Backend.cpp
(`_rotate_and_correct_accel`, `_rotate_and_correct_gyro`), AP_InertialSensor.cpp (parameters,
`accel_calibrated_ok_all`), libraries/AP_AccelCal/AccelCalibrator.cpp (`accept_result`);
libraries/AP_Arming/AP_Arming.cpp (checks); libraries/AP_Param/AP_Param.cpp (`parse_param_line`,
`read_param_defaults_file`).
"""

from __future__ import annotations

import math

from sensorbook.errors import Problem
from sensorbook.export.autopilot import Group, comments, parameters, read_parts
from sensorbook.export.magnetometer import Iron
from sensorbook.export.source import Entry
from sensorbook.export.triad import Triad, left_by_offsets, left_by_scales

TARGET = "ArduPilot"
MILLIGAUSS = 1e-7  # T
OFFSETS_MAX = 1800.0  # mG: COMPASS_OFFS_MAX as it is by default; longer offsets do not arm
OFFSETS_MIN = 2.0**-23  # mG: what is shorter is zero to its `is_zero`, and does not arm
DIAGONAL = (0.2, 5.0)  # outside of these, ArduPilot's own calibration is refused
OFF_DIAGONAL = 1.0
# Outside of these, ArduPilot's own calibration of an accelerometer is refused.
ACCELERATION_MAX = 9.80665  # m/s²
ACCELEROMETER_SCALE = (0.8, 1.2)
ZERO = 2.0**-23  # m/s²: what is shorter is zero to its `is_zero`, and does not arm

COMPASS = (
    "",
    "Parameters of ArduPilot's first compass: of the second they are COMPASS_OFS2_X, COMPASS_DIA2_X,"
    " COMPASS_ODI2_X, COMPASS_SCALE2 and so on, of the third COMPASS_OFS3_X and so on.",
    "",
)
COMPASS_FORMULA = (
    "",
    "ArduPilot computes (AP_Compass_Backend::correct_field), in milligauss, 1 mG = 1e-7 T:",
    "field = M * (COMPASS_SCALE * (raw + COMPASS_OFS))",
    "M = [[DIA_X, ODI_X, ODI_Y], [ODI_X, DIA_Y, ODI_Z], [ODI_Y, ODI_Z, DIA_Z]]",
    "Hence COMPASS_OFS = -hard_iron in milligauss, as ArduPilot adds it; M = soft_iron;"
    " COMPASS_SCALE scales nothing, as soft_iron holds the scale: it is 1, with which ArduPilot may"
    " compare the field with the world magnetic model, or 0 where the field's strength is not known.",
    "",
    "Axes are those of the recording, in the order x, y, z. ArduPilot rotates a reading before it"
    " corrects it: COMPASS_ORIENT (external compass) or AHRS_ORIENTATION (internal) must be 0, none,"
    " unless the recording was made in the vehicle's axes. Otherwise rotate: with R from the axes of"
    " the recording to the vehicle's, COMPASS_OFS = -R * hard_iron and M = R * soft_iron * transpose(R).",
)


ACCELEROMETER = (
    "",
    "Parameters of ArduPilot's first accelerometer: of the second they are INS_ACC2OFFS_X, INS_ACC2SCAL_X"
    " and so on, of the third INS_ACC3OFFS_X and so on.",
    "",
)
ACCELEROMETER_FORMULA = (
    "",
    "ArduPilot computes (AP_InertialSensor_Backend::_rotate_and_correct_accel), in m/s^2, axis by axis:",
    "acceleration = INS_ACCSCAL * (raw - INS_ACCOFFS)",
    "Of the results: true = inverse(matrix) * (raw - bias). Hence INS_ACCOFFS = bias and INS_ACCSCAL ="
    " 1/(diagonal of matrix).",
    "Axes are those of the recording and must be the sensor's as its driver turns them, before"
    " AHRS_ORIENTATION. raw is the reading with its correction for temperature where INS_TCAL1_ENABLE is"
    " not 0. ArduPilot does not arm where INS_ACC_ID is not the ID of the sensor, which it sets when it"
    " first calibrates it; this file leaves it alone.",
)
GYROSCOPE = (
    "",
    "Parameters of ArduPilot's first gyroscope: of the second they are INS_GYR2OFFS_X and so on.",
    "",
)
GYROSCOPE_FORMULA = (
    "",
    "ArduPilot computes (AP_InertialSensor_Backend::_rotate_and_correct_gyro), in rad/s:",
    "rate = raw - INS_GYROFFS",
    "Hence INS_GYROFFS = bias, in the same axes as the accelerometer's. ArduPilot measures them anew at"
    " each start unless INS_GYR_CAL is 0.",
)


def render(results: Entry) -> str:
    """The file; raises `InputError` as `read_parts` does, and for what ArduPilot does not accept."""
    parts = read_parts(results, TARGET)
    iron, accelerometer, gyroscope = parts.magnetometer, parts.accelerometer, parts.gyroscope
    groups, problems = [], []
    if iron:
        groups += [
            Group("COMPASS_OFS_{}", iron.hard_iron, -MILLIGAUSS),
            Group("COMPASS_DIA_{}", iron.diagonal, 1.0, *DIAGONAL),
            Group("COMPASS_ODI_{}", iron.off_diagonal, 1.0, -OFF_DIAGONAL, OFF_DIAGONAL),
        ]
        problems += _unarmed(iron)
    if accelerometer:
        reach = (-ACCELERATION_MAX, ACCELERATION_MAX)
        groups += [
            Group("INS_ACCOFFS_{}", accelerometer.bias, 1.0, *reach),
            Group(
                "INS_ACCSCAL_{}", accelerometer.diagonal, 1.0, *ACCELEROMETER_SCALE, inverse=True
            ),
        ]
        problems += _unarmed_by_zero(accelerometer)
    if gyroscope:
        groups.append(Group("INS_GYROFFS_{}", gyroscope.bias))
    values = parameters(TARGET, groups, problems)
    head = [*parts.head]
    if iron:
        values["COMPASS_SCALE"] = 0.0 if iron.entry.get("field_known").value is False else 1.0
        head += [*COMPASS, *iron.head, *COMPASS_FORMULA]
    if accelerometer:
        left = left_by_scales(accelerometer)
        head += [*ACCELEROMETER, *accelerometer.head, *ACCELEROMETER_FORMULA, left]
    if gyroscope:
        head += [*GYROSCOPE, *gyroscope.head, *GYROSCOPE_FORMULA, left_by_offsets(gyroscope)]
    lines = comments(head)
    return "\n".join([*lines, *(f"{name},{value!r}" for name, value in values.items())]) + "\n"


def _unarmed(iron: Iron) -> list[Problem]:
    """Why ArduPilot would not arm with these offsets, if it would not."""
    entry = iron.entry.at("hard_iron")
    length = math.hypot(*(entry.number() for entry in iron.hard_iron)) / MILLIGAUSS
    if length > OFFSETS_MAX:
        return entry.wrong(
            f"is {length:.6g} mG long, and ArduPilot does not arm above {OFFSETS_MAX:g} mG "
            "(COMPASS_OFFS_MAX)",
            "move the magnetometer away from magnets and iron, and record it again",
        ).problems
    if length < OFFSETS_MIN:
        return entry.wrong(
            f"is {length:.6g} mG long, which ArduPilot takes for a compass that is not calibrated"
        ).problems
    return []


def _unarmed_by_zero(triad: Triad) -> list[Problem]:
    """Why ArduPilot would not arm with these offsets, if it would not."""
    if all(abs(entry.number()) < ZERO for entry in triad.bias):
        wrong = "is zero, which ArduPilot takes for an accelerometer that is not calibrated"
        return triad.entry.at("bias").wrong(wrong).problems
    return []
