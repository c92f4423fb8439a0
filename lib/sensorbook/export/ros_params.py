"""A ROS 2 file of parameters, for nodes that correct an IMU's messages and for its driver.

Sources: direct_lidar_inertial_odometry (DLIO), src/dlio/odom.cc (`getParams`, `callbackImu`); imu_tools,
imu_filter_madgwick/src/imu_filter_ros.cpp (`imuMagCallback`); phidgets_drivers, phidgets_spatial
(README.md, `publishLatest`); mavros, src/plugins/imu.cpp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError
from sensorbook.export.autopilot import comments
from sensorbook.export.calibration import MENDS as CALIBRATE
from sensorbook.export.calibration import Absent, origin, part_of
from sensorbook.export.noise import noise_of, rate_of, strength
from sensorbook.export.source import Attempts, Entry, yaml_number
from sensorbook.export.triad import left_by_offsets, read_triad
from sensorbook.noise.discrete import discrete_values
from sensorbook.noise.model import NoiseTerms
from sensorbook.units import SENSOR_UNITS

TARGET = "a ROS driver"
STANDARD_DEVIATIONS = {
    "gyroscope": ("angular_velocity_stdev",),
    "accelerometer": ("linear_acceleration_stdev",),
    "magnetometer": ("magnetic_field_stdev", "magnetic_stdev"),  # phidgets_spatial's, mavros'
}
BIAS_MAX = 10.0  # of imu_filter_madgwick's mag_bias_*

HEAD = (
    "",
    "ROS 2 parameters of any node, by the wildcard: each takes those that it declares. Move what is for"
    " one node below its own name. Units are SI, as in sensor_msgs. Axes are those of the recording, in"
    " the order x, y, z, and must be those of the messages.",
)
INTRINSICS = (
    "",
    "For direct_lidar_inertial_odometry (DLIO), which computes",
    "linear_acceleration = sm * raw - bias, sm by rows, and angular_velocity = raw - bias.",
    "This is not the convention of the results, true = inverse(matrix) * (raw - bias): here"
    " sm = inverse(matrix) and the accelerometer's bias = inverse(matrix) * bias of the results.",
    "DLIO turns a message into its base frame first: where extrinsics/baselink2imu/R = R is not the"
    " identity, sm = R * sm * transpose(R) and bias = R * bias are to be written.",
)
HARD_IRON = (
    "",
    "For imu_filter_madgwick, which computes magnetic_field = raw - mag_bias, both in T.",
)
NOISE = (
    "",
    "For drivers (phidgets_spatial, mavros' imu plugin), which fill the diagonal of their messages'"
    " covariances with stdev^2, which robot_localization and others then read. stdev is that of the white"
    " noise of one sample, N sqrt(rate), N of the two-sided spectrum (random_walk in results.json), at the"
    " rate of the rest; the largest of three axes. At another rate, filtered at half of it, it is N"
    " sqrt(rate) there. Slow noise of the bias, and the error of a calibration, are not in it.",
)


def render(results: Entry) -> str:
    """The file.

    Raises
    ------
    InputError : with what is wrong in each part; or, where there is none, with what is missing
    """
    attempt, absent, parts = Attempts(), [], []
    head = attempt(origin, results) or ()
    results.at("sensors")
    for make in (_intrinsics, _hard_iron, _noise):
        try:
            parts += make(results, absent)
        except InputError as error:
            attempt.problems += error.problems
    if not parts and not attempt.problems:
        attempt.problems += absent
    attempt.end()
    left_out = dict.fromkeys(
        f"Not in this file: {one.where}, which {one.message}" for one in absent
    )
    lines = [*comments([*head, *left_out, *HEAD]), "/**:", "  ros__parameters:", *parts]
    return "\n".join(lines) + "\n"


def indented(lines: Sequence[str]) -> list[str]:
    """Comments below `ros__parameters`."""
    return [f"    {line}" for line in comments(lines)]


def flat(numbers: np.ndarray) -> str:
    """Numbers row by row, each a float to ROS, whose lists are of one type."""
    return f"[{', '.join(yaml_number(float(n)) for n in np.ravel(numbers))}]"


def affine(results: Entry) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Notes, SM (3, 3) and bias (3,) m/s² of the accelerometer, true = SM · raw − bias.

    Raises `InputError` as `read_triad` does.
    """
    triad = read_triad(results, "accelerometer")
    bias = triad.inverse @ [entry.number() for entry in triad.bias]
    return list(triad.head), triad.inverse, bias


def _intrinsics(results: Entry, absent: list) -> list[str]:
    lines = []
    try:
        notes, sm, bias = affine(results)
        lines += indented(notes)
        lines += [
            f"    imu/intrinsics/accel/sm: {flat(sm)}  # 1",
            f"    imu/intrinsics/accel/bias: {flat(bias)}  # m/s^2",
        ]
    except Absent as why:
        absent += why.problems
    try:
        triad = read_triad(results, "gyroscope")
        lines += indented([*triad.head, left_by_offsets(triad)])
        bias = [entry.number() for entry in triad.bias]
        lines.append(f"    imu/intrinsics/gyro/bias: {flat(bias)}  # rad/s")
    except Absent as why:
        absent += why.problems
    if not lines:
        return []
    return [
        *indented(INTRINSICS),
        "    imu/calibration: false  # not estimated anew at each start",
        *lines,
    ]


def _hard_iron(results: Entry, absent: list) -> list[str]:
    try:
        entry = part_of(results, "magnetometer", "calibration", CALIBRATE["magnetometer"])
    except Absent as why:
        absent += why.problems
        return []
    unit = entry.at("unit")
    if unit.text() != SENSOR_UNITS["magnetometer"]:
        raise unit.wrong(f"{unit.value!r} is not {SENSOR_UNITS['magnetometer']!r}")
    entry.at("hard_iron").array(3)
    angle = _turned(np.array(entry.at("soft_iron").array(3, 3)))
    lines = [
        *HARD_IRON,
        f"Method: {entry.at('method').text()}.",
        f"The soft iron is lost: the field's direction is wrong for it by up to {angle:.3g} deg.",
    ]
    if results.at("sensors", "magnetometer").get("thermal").value is not None:
        lines.append("The thermal model is not in this file.")
    parts = indented(lines)
    for axis, offset in zip("xyz", entry.at("hard_iron").items(), strict=True):
        if abs(offset.number()) > BIAS_MAX:
            raise offset.wrong(f"is not within ±{BIAS_MAX:g} T, which imu_filter_madgwick accepts")
        parts.append(f"    mag_bias_{axis}: {yaml_number(offset.number())}  # T")
    return parts


def _turned(soft_iron: np.ndarray) -> float:
    """The largest angle between a vector and soft_iron times it, degrees; 180 where it mirrors.

    A symmetric matrix turns by up to asin((k − 1)/(k + 1)), k its condition (Kantorovich); its rotation,
    where it has one, is added to that.
    """
    left, sizes, right = np.linalg.svd(soft_iron / (np.abs(soft_iron).max() or 1.0))
    if sizes[0] == 0 or np.linalg.det(left @ right) < 0:
        return 180.0
    largest, smallest = sizes[0], sizes[-1]
    rotation = np.arccos(np.clip((np.trace(left @ right) - 1) / 2, -1, 1))
    return float(np.degrees(np.arcsin((largest - smallest) / (largest + smallest)) + rotation))


def _noise(results: Entry, absent: list) -> list[str]:
    lines = []
    for sensor, names in STANDARD_DEVIATIONS.items():
        try:
            mend = f"record a rest of the {sensor} and render its report"
            noise = noise_of(results, sensor, mend)
        except Absent as why:
            absent += why.problems
            continue
        found, rate = strength(noise, sensor, "random_walk", TARGET), rate_of(results, sensor)
        value = discrete_values(NoiseTerms(random_walk=found.value), rate)["random_walk"]
        unit = SENSOR_UNITS[sensor]
        lines += indented([f"N, {unit}/sqrt(Hz): {found.axes}"])
        lines += [
            f"    {name}: {yaml_number(value)}  # {unit}; {found.what}, at {rate:.10g} Hz"
            for name in names
        ]
    return [*indented(NOISE), *lines] if lines else []
