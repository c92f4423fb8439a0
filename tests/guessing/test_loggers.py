"""Logs as common recorders write them: every value right, or marked as not sure."""

import sqlite3

import numpy as np
import pandas
import pytest

from sensorbook.guessing import guess_files
from sensorbook.guessing.names import read_name

from .moved import moved

RATE = 100.0
NAMES = [  # name: role, sensor, axis, unit
    ("gx", "axis", "gyroscope", "x", ""),
    ("ax_m_s2", "axis", "accelerometer", "x", "m/s^2"),
    ("gyro_z_mdps", "axis", "gyroscope", "z", "mdps"),
    ("AccelX", "axis", "accelerometer", "x", ""),
    ("ACC_Y", "axis", "accelerometer", "y", ""),
    ("angular_velocity.x", "axis", "gyroscope", "x", ""),
    ("field.linear_acceleration.y", "axis", "accelerometer", "y", ""),
    ("w_RS_S_x [rad s^-1]", "axis", "gyroscope", "x", "rad/s"),
    ("a_RS_S_z [m s^-2]", "axis", "accelerometer", "z", "m/s^2"),
    ("MAGNETIC FIELD X (μT)", "axis", "magnetometer", "x", "μT"),
    ("Gyroscope z (°/s)", "axis", "gyroscope", "z", "°/s"),
    ("x_acc", "axis", "accelerometer", "x", ""),
    ("mag[2]", "axis", "magnetometer", "z", ""),
    ("field.orientation.w", "quaternion", "", "w", ""),
    ("qx", "quaternion", "", "x", ""),
    ("#timestamp [ns]", "time", "", "", "ns"),
    ("%time", "time", "", "", ""),
    ("seconds_elapsed", "time", "", "", "s"),
    ("millis", "time", "", "", "ms"),
    ("PacketCounter", "counter", "", "", ""),
    ("n_samples", "counter", "", "", ""),
    ("Temp_C", "temperature", "", "", "degC"),
    ("roll", "other", "", "", ""),
    ("gravity_x", "other", "", "x", ""),
    ("user_acceleration_x", "other", "", "x", ""),
    ("v1", "", "", "", ""),
]


@pytest.mark.parametrize(("name", "role", "sensor", "axis", "unit"), NAMES)
def test_names(name, role, sensor, axis, unit):
    named = read_name(name)
    assert (named.role, named.sensor, named.axis, named.unit) == (role, sensor, axis, unit)


@pytest.fixture
def motion():
    return moved("positions", 60, RATE, np.random.default_rng(41))


def tables_of(*paths):
    return {r.table["sensor"]: r.table for r in guess_files(list(paths)).recordings}


def test_euroc(tmp_path, motion):
    stamps = 1_403_636_579_758_555_392 + (np.arange(len(motion.gyroscope)) * 1e7).astype(np.int64)
    frame = pandas.DataFrame({"#timestamp [ns]": stamps})
    for axis, column in zip("xyz", motion.gyroscope.T, strict=True):
        frame[f"w_RS_S_{axis} [rad s^-1]"] = column
    for axis, column in zip("xyz", motion.accelerometer.T, strict=True):
        frame[f"a_RS_S_{axis} [m s^-2]"] = column
    frame.to_csv(tmp_path / "data.csv", index=False)
    tables = tables_of(tmp_path / "data.csv")
    assert {s: t["unit"] for s, t in tables.items()} == {
        "gyroscope": "rad/s",
        "accelerometer": "m/s^2",
    }
    assert all(t["time_unit"] == "ns" and t["kind"] == "positions" for t in tables.values())
    assert all("guessed" not in t for t in tables.values())


def test_a_topic_as_rostopic_prints_it(tmp_path, motion):
    stamps = 1_700_000_000_000_000_000 + (np.arange(len(motion.gyroscope)) * 1e7).astype(np.int64)
    quaternion = motion.attitude.as_quat()
    frame = pandas.DataFrame({"%time": stamps, "field.header.seq": np.arange(len(stamps)),
                              "field.header.stamp": stamps, "field.header.frame_id": "imu"})  # fmt: skip
    for k, axis in enumerate("xyzw"):
        frame[f"field.orientation.{axis}"] = quaternion[:, k]
    frame["field.orientation_covariance0"] = 0.0
    for k, axis in enumerate("xyz"):
        frame[f"field.angular_velocity.{axis}"] = motion.gyroscope[:, k]
    for k, axis in enumerate("xyz"):
        frame[f"field.linear_acceleration.{axis}"] = motion.accelerometer[:, k]
    frame.to_csv(tmp_path / "imu.csv", index=False)
    guessed = guess_files([tmp_path / "imu.csv"])
    tables = {r.table["sensor"]: r.table for r in guessed.recordings}
    assert tables["gyroscope"]["unit"] == "rad/s"
    assert tables["gyroscope"]["columns"]["time"] in ("time", "field.header.stamp")
    assert tables["accelerometer"]["columns"]["x"] == "field.linear_acceleration.x"
    assert tables["reference"]["quaternion"] == "body_to_reference"


def test_a_phone_recorder_with_a_table_a_sensor(tmp_path, motion):
    with sqlite3.connect(tmp_path / "phone.db") as database:
        for name, values, step in (("Accelerometer", motion.accelerometer, 1),
                                   ("Gyroscope", motion.gyroscope, 2),
                                   ("Magnetometer", motion.magnetometer * 1e6, 4)):  # fmt: skip
            rows = values[::step]
            frame = pandas.DataFrame({"time": 1_700_000_000_000_000_000 + np.arange(len(rows)) * step * 10**7,
                                      "z": rows[:, 2], "y": rows[:, 1], "x": rows[:, 0]})  # fmt: skip
            frame.to_sql(name, database, index=False)
    guessed = guess_files([tmp_path / "phone.db"])
    tables = {r.table["sensor"]: r.table for r in guessed.recordings}
    assert {s: t["table"] for s, t in tables.items()} == {
        "accelerometer": "Accelerometer", "gyroscope": "Gyroscope", "magnetometer": "Magnetometer"
    }  # fmt: skip
    assert all([t["columns"][a] for a in "xyz"] == ["x", "y", "z"] for t in tables.values())
    assert tables["accelerometer"]["unit"] == "m/s^2"
    assert tables["magnetometer"]["unit"] == "uT"
    assert all(t["time_unit"] == "ns" for t in tables.values())


def test_the_head_of_a_file_gives_the_rate(tmp_path, motion):
    names = ["PacketCounter", *(f"{s}_{a}" for s in ("Acc", "Gyr") for a in "XYZ")]
    rows = np.column_stack(
        [np.arange(len(motion.gyroscope)), motion.accelerometer, motion.gyroscope]
    )
    head = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Filter Profile: human (46.1)\n"
    body = "\n".join("\t".join(f"{v:.6f}" for v in row) for row in rows)
    (tmp_path / "MT.txt").write_text(head + "\t".join(names) + "\n" + body + "\n")
    tables = tables_of(tmp_path / "MT.txt")
    assert {s: (t["rate"], t["unit"]) for s, t in tables.items()} == {
        "accelerometer": (100.0, "m/s^2"), "gyroscope": (100.0, "rad/s")
    }  # fmt: skip


def test_acceleration_without_gravity_is_not_taken_for_one_that_has_it(tmp_path, motion):
    frame = pandas.DataFrame({"Time (s)": np.arange(len(motion.gyroscope)) / RATE})
    free = motion.accelerometer - motion.attitude.inv().apply([0, 0, 9.80665])
    for k, axis in enumerate("xyz"):
        frame[f"Linear Acceleration {axis} (m/s^2)"] = free[:, k]
    frame.to_csv(tmp_path / "Linear Acceleration.csv", index=False)
    (recording,) = guess_files([tmp_path / "Linear Acceleration.csv"]).recordings
    (unit,) = (g for g in recording.guesses if g.key == "unit")
    assert unit.certainty == "low"
    assert "without gravity?" in unit.reason


def test_semicolons_and_decimal_commas(tmp_path, motion):
    lines = ["Zeit;gx;gy;gz"]
    for k, row in enumerate(np.degrees(motion.gyroscope[:2000])):
        lines.append(";".join(f"{v:.4f}".replace(".", ",") for v in (k / RATE, *row)))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    table = tables_of(tmp_path / "log.csv")["gyroscope"]
    assert table["columns"]["time"] == "Zeit"
    assert table["time_unit"] == "s"
