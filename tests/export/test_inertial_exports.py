"""Accelerometer and gyroscope in formats that hold a part of them: each target's own formula, what it
leaves, and what is told of it."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import yaml
from consumers import read_param, read_params, said

from sensorbook import Recording
from sensorbook.apply import correct

G = 9.80665
AGAIN = "render it again with: sensorbook report"
POSITIONS = 'record rests in many attitudes (kind = "positions") and render the report'
TURN = 'record it turned freely (kind = "rotation") and render the report'
C = "sensors.accelerometer.calibration"

BIAS = {"accelerometer": [-0.31, 0.4567, 0.1], "gyroscope": [-0.0041, 0.0025, 0.03]}
SCALES = [0.98, 1.0123, 1.05]
MATRIX = {
    "accelerometer": [[0.98, 0.0, 0.0], [-0.006, 1.0123, 0.0], [0.0106, -0.0054, 1.05]],
    "gyroscope": [[1.01, 0.002, -0.011], [0.004, 0.99, 0.006], [0.0, -0.003, 1.002]],
}
SENSITIVITY = [[1e-4, -2e-5, 0.0], [3e-5, 5e-5, 1e-5], [0.0, 0.0, -4e-5]]
UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s", "magnetometer": "T"}
DENSITY = {"accelerometer": [1e-3, 3e-3, 2e-3], "gyroscope": [7e-5, 6e-5, 5e-5],
           "magnetometer": [4e-9, 5e-9, 3e-9]}  # fmt: skip
HARD_IRON, SOFT_IRON = [1.2e-5, -3e-6, 4e-5], np.diag([1.2, 1.0, 0.9]).tolist()
RATES = {"accelerometer": 50.0, "gyroscope": 200.0, "magnetometer": 25.0}


def triad(sensor):
    return {
        "method": "rest_to_rest",
        "matrix": MATRIX[sensor],
        "bias": BIAS[sensor],
        "g_sensitivity": None,
        "unit": UNITS[sensor],
        "reference_temperature": None,
    }


def noise(sensor):
    def entry(value):
        unit = f"{UNITS[sensor]}/sqrt(Hz)"
        return {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": unit}

    return {axis: {"random_walk": entry(n)} for axis, n in zip("xyz", DENSITY[sensor], strict=True)}


def results():
    """Of accelerometer and gyroscope, calibrated; nothing else."""
    return {
        "schema": 1,
        "device": {"id": "imu-7", "name": "An IMU", "model": "M 1", "serial": "0042"},
        "software": {"sensorbook": "0.1.0", "python": "3.11.7", "numpy": "2.0", "scipy": "1.13"},
        "created": "2024-05-01T12:00:00+00:00",
        "inputs": [
            {"file": "moved.csv", "sha256": "ab" * 32, "sensor": sensor, "kind": "positions"}
            for sensor in MATRIX
        ],
        "sensors": {sensor: {"calibration": triad(sensor)} for sensor in MATRIX},
    }


def everything(r):
    """All that ROS parameters hold: magnetometer and noise, too."""
    r["sensors"]["magnetometer"] = {
        "calibration": {"method": "ellipsoid", "hard_iron": HARD_IRON, "soft_iron": SOFT_IRON, "unit": "T"}
    }  # fmt: skip
    for sensor, rate in RATES.items():
        r["sensors"][sensor]["noise"] = noise(sensor)
        rest = {"file": "rest.csv", "sha256": "cd" * 32, "sensor": sensor, "kind": "static"}
        r["inputs"].append(rest | {"rate_hz": rate, "duration_s": 3600.0})


def diagonal(r):
    """What the autopilots hold without loss."""
    r["sensors"]["accelerometer"]["calibration"]["matrix"] = np.diag(SCALES).tolist()
    r["sensors"]["gyroscope"]["calibration"]["matrix"] = np.eye(3).tolist()


def applied(change, sensor, raw):
    """What sensorbook itself makes of raw readings."""
    found = results()
    change(found)
    time = np.arange(len(raw)) / 100
    run = Recording(sensor, "static", "a.csv", time, raw, rate=100.0, unit=UNITS[sensor])
    return correct(run, found["sensors"][sensor])[0].values


def told(text):
    """The comments, in one line."""
    return " ".join(re.sub(r"\n\s*# ?", " ", text).split())


RNG = np.random.default_rng(20240501)
RAW = {"accelerometer": RNG.normal(0, G, (500, 3)), "gyroscope": RNG.normal(0, 2, (500, 3)),
       "magnetometer": RNG.normal(0, 5e-5, (500, 3))}  # fmt: skip
DIRECTIONS = RNG.normal(size=(20000, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


# ---- the autopilots: what they do with a file, written anew from their sources ----


def correct_ardupilot(text, sensor, raw):
    """AP_InertialSensor_Backend::_rotate_and_correct_accel and _gyro, without rotation.

    In the precision of raw, which is (N, 3); the firmware's is single.
    """
    p = read_param(text)
    vector = {k: np.array([p[f"INS_{k}_{axis}"] for axis in "XYZ"], raw.dtype)
              for k in ("ACCOFFS", "ACCSCAL", "GYROFFS")}  # fmt: skip
    if sensor == "gyroscope":
        return raw - vector["GYROFFS"]
    return (raw - vector["ACCOFFS"]) * vector["ACCSCAL"]


def correct_px4(text, sensor, raw):
    """calibration::Accelerometer::Correct and calibration::Gyroscope::Correct, without rotation."""
    p = read_params(text)
    part = "ACC" if sensor == "accelerometer" else "GYRO"
    off = np.array([p[f"CAL_{part}0_{axis}OFF"] for axis in "XYZ"], raw.dtype)
    if sensor == "gyroscope":
        return raw - off
    return (raw - off) * np.array([p[f"CAL_ACC0_{axis}SCALE"] for axis in "XYZ"], raw.dtype)


AUTOPILOTS = {"ardupilot": correct_ardupilot, "px4": correct_px4}
TARGETS = {"ardupilot": "ArduPilot", "px4": "PX4"}


@pytest.mark.parametrize("sensor", MATRIX)
@pytest.mark.parametrize("name", AUTOPILOTS)
def test_what_an_autopilot_holds_it_corrects_as_the_library(name, sensor, exported):
    raw, text = RAW[sensor], exported(name, diagonal)
    expected = applied(diagonal, sensor, raw)
    got = AUTOPILOTS[name](text, sensor, raw)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    # As the firmware computes: four roundings of 6e-8 of up to 40 m/s^2.
    single = AUTOPILOTS[name](text, sensor, raw.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, rtol=0, atol=1e-5)


def by_hand(name):
    if name == "ardupilot":
        names = ["INS_ACCOFFS_{}", "INS_ACCSCAL_{}", "INS_GYROFFS_{}"]
    else:
        names = ["CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE", "CAL_GYRO0_{}OFF"]
    values = [BIAS["accelerometer"], [1 / 0.98, 1 / 1.0123, 1 / 1.05], BIAS["gyroscope"]]
    return {n.format(a): v for n, vs in zip(names, values, strict=True)
            for a, v in zip("XYZ", vs, strict=True)}  # fmt: skip


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_parameters_by_name(name, exported):
    read = {"ardupilot": read_param, "px4": read_params}[name]
    assert read(exported(name)) == pytest.approx(by_hand(name), rel=1e-15)


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_error_that_an_accelerometer_is_left_with_is_told(name, exported):
    text = exported(name)
    true = G * DIRECTIONS
    raw = true @ np.transpose(MATRIX["accelerometer"]) + BIAS["accelerometer"]
    worst = np.linalg.norm(AUTOPILOTS[name](text, "accelerometer", raw) - true, axis=1).max()
    stated = re.search(
        r"Of 1 g, 9.80665 m/s\^2, up to (\S+) m/s\^2 \((\S+) mg\) is wrong", told(text)
    )
    # 20000 directions come within some 0.1 % of the worst; three digits are told.
    assert float(stated[1]) == pytest.approx(worst, rel=0.006)
    assert float(stated[2]) == pytest.approx(1000 * worst / G, rel=0.006)


@pytest.mark.parametrize("name", [*AUTOPILOTS, "ros-params"])
def test_the_error_that_a_gyroscope_is_left_with_is_told(name, exported):
    def change(r):
        r["sensors"]["gyroscope"]["calibration"]["g_sensitivity"] = SENSITIVITY

    text = told(exported(name, change))
    raw = DIRECTIONS @ np.transpose(MATRIX["gyroscope"]) + BIAS["gyroscope"]
    worst = np.linalg.norm(raw - BIAS["gyroscope"] - DIRECTIONS, axis=1).max()
    stated = re.search(r"Up to (\S+) % of a rate is wrong", text)
    assert float(stated[1]) == pytest.approx(100 * worst, rel=0.006)
    by_g = np.linalg.norm(G * DIRECTIONS @ np.transpose(SENSITIVITY), axis=1).max()
    stated = re.search(
        r"sensitivity to acceleration: up to (\S+) rad/s \((\S+) deg/s\) at 1 g", text
    )
    assert float(stated[1]) == pytest.approx(by_g, rel=0.006)
    assert float(stated[2]) == pytest.approx(math.degrees(by_g), rel=0.006)
    assert "sensitivity" not in told(exported(name))


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_a_sensor_without_a_calibration_is_told_and_left_out(name, exported):
    def change(r):
        r["sensors"]["accelerometer"]["calibration"] = {"method": None, "reason": "Too few rests."}

    text = exported(name, change)
    for line in (
        "Not in this file: the accelerometer, whose calibration was refused: Too few rests.",
        "Not in this file: the magnetometer, whose calibration is missing.",
    ):
        assert line in told(text)
    read = {"ardupilot": read_param, "px4": read_params}[name]
    gyroscope = {k: v for k, v in by_hand(name).items() if "GYR" in k}
    assert read(text) == gyroscope


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_what_changes_with_temperature_is_told(name, exported):
    def change(r):
        found = r["sensors"]["accelerometer"]
        found["calibration"] |= {"reference_temperature": 22.5, "temperature": {"degree": 1}}
        found["thermal"] = {"x": None, "y": None, "z": None}

    text = told(exported(name, change))
    assert "It holds at 22.5 degC. Its change with temperature is not in this file." in text
    assert "The thermal model is not in this file." in text
    assert "temperature is not" not in told(exported(name))


SCALED = "check unit and scale of the recording and its [site], and render the report again"


@pytest.mark.parametrize(
    ("name", "low", "high", "parameter"),
    [("ardupilot", 0.8, 1.2, "INS_ACCSCAL_Y"), ("px4", 0.1, 3, "CAL_ACC0_YSCALE")],
)
def test_scales_out_of_range(name, low, high, parameter, exported):
    for scale in (1.001 / low, 0.999 / high, -1.0):

        def change(r, scale=scale):
            r["sensors"]["accelerometer"]["calibration"]["matrix"] = np.diag([1, scale, 1]).tolist()

        assert said(exported, name, change) == [
            f"{C}.matrix[1][1]: {parameter} would be {1 / scale!r}, and {TARGETS[name]} accepts "
            f"{low} to {high} — {SCALED}"
        ]


def test_what_does_not_arm(exported):
    def change(r):
        r["sensors"]["accelerometer"]["calibration"]["bias"] = [0.0, 1e-8, 0.0]

    assert said(exported, "ardupilot", change) == [
        f"{C}.bias: is zero, which ArduPilot takes for an accelerometer that is not calibrated — {AGAIN}"
    ]
    assert read_params(exported("px4", change))["CAL_ACC0_YOFF"] == 1e-8

    def far(r):
        r["sensors"]["accelerometer"]["calibration"]["bias"] = [0.0, 9.81, 0.0]

    assert said(exported, "ardupilot", far) == [
        f"{C}.bias[1]: INS_ACCOFFS_Y would be 9.81, and ArduPilot accepts -9.80665 to 9.80665 — {SCALED}"
    ]


# ---- ROS ----


def parameters(text):
    """As rcl_yaml_param_parser: lists of one type; a node takes those of the wildcard."""
    found = yaml.safe_load(text)["/**"]["ros__parameters"]
    for value in found.values():
        assert {type(v) for v in (value if isinstance(value, list) else [value])} in (
            {float},
            {bool},
        )
    return found


def correct_dlio(found, sensor, raw):
    """callbackImu of direct_lidar_inertial_odometry with imu/calibration false, without rotation."""
    assert found["imu/calibration"] is False
    if sensor == "gyroscope":
        return raw - found["imu/intrinsics/gyro/bias"]
    sm = np.reshape(found["imu/intrinsics/accel/sm"], (3, 3))
    return np.array([sm @ reading - found["imu/intrinsics/accel/bias"] for reading in raw])


def correct_imu_calib(text, raw):
    """AccelCalib::applyCalib of imu_calib."""
    found = yaml.safe_load(text)
    assert set(found) == {"SM", "bias"}
    sm = [found["SM"][3 * i : 3 * i + 3] for i in range(3)]
    return np.array(
        [[sum(sm[i][j] * v[j] for j in range(3)) - found["bias"][i] for i in range(3)] for v in raw]
    )


def test_ros_nodes_correct_the_accelerometer_as_the_library(exported):
    raw = RAW["accelerometer"]
    expected = applied(lambda r: None, "accelerometer", raw)
    got = correct_imu_calib(exported("imu-calib"), raw)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    got = correct_dlio(parameters(exported("ros-params")), "accelerometer", raw)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)


def test_a_ros_node_corrects_a_gyroscope_without_scale_errors_as_the_library(exported):
    raw = RAW["gyroscope"]
    got = correct_dlio(parameters(exported("ros-params", diagonal)), "gyroscope", raw)
    np.testing.assert_allclose(got, applied(diagonal, "gyroscope", raw), rtol=0, atol=1e-9)


def test_a_ros_filter_takes_out_the_hard_iron(exported):
    found = parameters(exported("ros-params", everything))
    raw = RAW["magnetometer"]
    got = raw - [found[f"mag_bias_{axis}"] for axis in "xyz"]  # imuMagCallback

    def hard(r):
        everything(r)
        r["sensors"]["magnetometer"]["calibration"]["soft_iron"] = np.eye(3).tolist()

    np.testing.assert_allclose(got, applied(hard, "magnetometer", raw), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "soft_iron",
    [
        SOFT_IRON,
        [[1.1, 0.05, 0.0], [0.05, 0.9, 0.1], [0.0, 0.1, 1.0]],
        [[math.cos(0.1), -math.sin(0.1), 0], [math.sin(0.1), math.cos(0.1), 0], [0, 0, 1]],
    ],
)
def test_the_turn_that_soft_iron_is_left_with_is_told(soft_iron, exported):
    def change(r):
        everything(r)
        r["sensors"]["magnetometer"]["calibration"]["soft_iron"] = soft_iron

    turned = DIRECTIONS @ np.transpose(soft_iron)
    cosine = (turned * DIRECTIONS).sum(axis=1) / np.linalg.norm(turned, axis=1)
    worst = np.degrees(np.arccos(cosine.min()))
    stated = re.search(r"wrong for it by up to (\S+) deg", told(exported("ros-params", change)))
    assert float(stated[1]) == pytest.approx(worst, rel=0.01)


def test_standard_deviations_for_covariances(exported):
    text = exported("ros-params", everything)
    found = parameters(text)
    # The largest of three axes, over the square root of the time between samples.
    assert found["linear_acceleration_stdev"] == pytest.approx(3e-3 * math.sqrt(50), rel=1e-14)
    assert found["angular_velocity_stdev"] == pytest.approx(7e-5 * math.sqrt(200), rel=1e-14)
    assert found["magnetic_field_stdev"] == pytest.approx(5e-9 * 5, rel=1e-14)
    assert found["magnetic_stdev"] == found["magnetic_field_stdev"]
    assert "# rad/s; axis x, at 200 Hz\n" in text
    # White noise of that density, averaged over a second, is N: independent of the rate.
    seconds = np.random.default_rng(5).normal(0, found["angular_velocity_stdev"], (20000, 200))
    assert seconds.mean(axis=1).std() == pytest.approx(7e-5, rel=0.02)  # 4 standard errors


def test_ros_parameters_of_what_there_is(exported):
    def change(r):
        everything(r)
        del r["sensors"]["gyroscope"], r["sensors"]["magnetometer"]
        r["sensors"]["accelerometer"]["calibration"] = {"method": None, "reason": "Too few rests."}

    text = exported("ros-params", change)
    assert set(parameters(text)) == {"linear_acceleration_stdev"}
    for line in (
        f"Not in this file: {C}, which was refused: Too few rests.",
        "Not in this file: sensors.gyroscope, which is missing",
        "Not in this file: sensors.magnetometer, which is missing",
    ):
        assert told(text).count(line) == 1


def test_ros_parameters_of_nothing(exported):
    rest = "record a rest of the {} and render its report"
    assert said(exported, "ros-params", lambda r: r.update(sensors={})) == [
        f"sensors.accelerometer: is missing — {POSITIONS}",
        f"sensors.gyroscope: is missing — {POSITIONS}",
        f"sensors.magnetometer: is missing — {TURN}",
        f"sensors.gyroscope: is missing — {rest.format('gyroscope')}",
        f"sensors.accelerometer: is missing — {rest.format('accelerometer')}",
        f"sensors.magnetometer: is missing — {rest.format('magnetometer')}",
    ]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda c: c.update(hard_iron=[0, 11, 0]),
         "hard_iron[1]: is not within ±10 T, which imu_filter_madgwick accepts"),
        (lambda c: c.update(unit="uT"), "unit: 'uT' is not 'T'"),
        (lambda c: c.update(soft_iron=[[1]]), "soft_iron: has 1 entries, not 3"),
        (lambda c: c.pop("method"), "method: is missing"),
    ],
)  # fmt: skip
def test_a_magnetometer_that_ros_cannot_be_given(change, line, exported):
    def damaged(r):
        everything(r)
        change(r["sensors"]["magnetometer"]["calibration"])

    assert said(exported, "ros-params", damaged) == [
        f"sensors.magnetometer.calibration.{line} — {AGAIN}"
    ]


# ---- what all of them say ----

NAMES = [*AUTOPILOTS, "ros-params", "imu-calib"]
FORMULAS = {
    "ardupilot": [
        "acceleration = INS_ACCSCAL * (raw - INS_ACCOFFS)",
        "INS_ACCOFFS = bias and INS_ACCSCAL = 1/(diagonal of matrix).",
        "rate = raw - INS_GYROFFS",
    ],
    "px4": [
        "acceleration = rotation * (SCALE * (raw - OFF)), OFF = [XOFF, YOFF, ZOFF]",
        "Hence OFF = bias, SCALE = 1/(diagonal of matrix).",
        "rate = rotation * (raw - OFF), OFF = [XOFF, YOFF, ZOFF]",
    ],
    "ros-params": [
        "linear_acceleration = sm * raw - bias, sm by rows, and angular_velocity = raw - bias"
    ],
    "imu-calib": ["imu_calib computes acceleration = SM * raw - bias, in m/s^2, SM by rows."],
}


@pytest.mark.parametrize("name", NAMES)
def test_formula_and_provenance(name, exported):
    text = exported(name)
    for line in (
        *FORMULAS[name],
        "Calibration of the device imu-7 (An IMU).",
        "Device: model M 1, serial 0042.",
        "Results of 2024-05-01T12:00:00+00:00; sensorbook 0.1.0, python 3.11.7, numpy 2.0, scipy 1.13.",
        f"Made of moved.csv, sha256 {'ab' * 32}.",
        "Accelerometer, method: rest_to_rest.",
    ):
        assert told(f"\n{text}").count(line) == 1
    assert text.isascii()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "nasty", ["a\nINS_ACCOFFS_X,9", "\x85SM: 1", "\u2028x: [", " " * 98 + "/**: 1"]
)
def test_no_text_becomes_a_parameter(name, nasty, exported):
    def change(r):
        r["device"].update(id=nasty, name=nasty, model=nasty, serial=nasty)
        r["inputs"][0].update(file=nasty, sha256=nasty)
        r["sensors"]["accelerometer"]["calibration"]["method"] = nasty

    def numbers(text):
        return [line for line in text.splitlines() if not line.lstrip().startswith("#")]

    assert numbers(exported(name, change)) == numbers(exported(name))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda c: c.update(unit="g"), "unit: 'g' is not 'm/s^2'"),
        (lambda c: c.pop("matrix"), "matrix: is missing"),
        (lambda c: c.update(bias=[1, 2]), "bias: has 2 entries, not 3"),
        (lambda c: c.update(bias=[1, math.nan, 2]), "bias[1]: nan is not a finite number"),
        (lambda c: c.update(matrix=np.zeros((3, 3)).tolist()), "matrix: has no inverse"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_key(name, change, line, exported):
    def damaged(r):
        change(r["sensors"]["accelerometer"]["calibration"])

    assert said(exported, name, damaged) == [f"{C}.{line} — {AGAIN}"]


def test_imu_calib_without_an_accelerometer(exported):
    assert said(exported, "imu-calib", lambda r: r["sensors"].pop("accelerometer")) == [
        f"sensors.accelerometer: is missing — {POSITIONS}"
    ]
