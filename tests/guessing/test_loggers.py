"""Logs as common recorders write them: every value right, or marked as not sure."""

import sqlite3

import numpy as np
import pandas
import pytest

from sensorbook import InputError
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
    with pytest.raises(InputError) as caught:
        guess_files([tmp_path / "Linear Acceleration.csv"])
    assert "holds an acceleration without gravity, not a reading" in str(caught.value)
    frame.columns = ["t", "ax", "ay", "az"]
    frame.to_csv(tmp_path / "log.csv", index=False)
    (recording,) = guess_files([tmp_path / "log.csv"]).recordings
    (unit,) = (g for g in recording.guesses if g.key == "unit")
    assert unit.certainty == "not known"


def test_semicolons_and_decimal_commas(tmp_path, motion):
    lines = ["Zeit;gx;gy;gz"]
    for k, row in enumerate(np.degrees(motion.gyroscope[:2000])):
        lines.append(";".join(f"{v:.4f}".replace(".", ",") for v in (k / RATE, *row)))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    table = tables_of(tmp_path / "log.csv")["gyroscope"]
    assert table["columns"]["time"] == "Zeit"
    assert table["time_unit"] == "s"


def test_what_a_phone_computes_is_no_reading(tmp_path, motion):
    count = len(motion.gyroscope)
    epoch = 1_700_000_000_000_000_000 + np.arange(count) * 10**7
    gravity = motion.attitude.inv().apply([0, 0, 9.80665])
    noisy = motion.accelerometer
    for name, values in (("Gravity", gravity), ("Accelerometer", noisy - gravity),
                         ("TotalAcceleration", noisy), ("Gyroscope", motion.gyroscope)):  # fmt: skip
        frame = pandas.DataFrame(
            {"time": epoch, "z": values[:, 2], "y": values[:, 1], "x": values[:, 0]}
        )
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    guessed = guess_files(sorted(tmp_path.glob("*.csv")))
    assert sorted((r.table["sensor"], r.table["file"]) for r in guessed.recordings) == [
        ("accelerometer", "TotalAcceleration.csv"), ("gyroscope", "Gyroscope.csv")
    ]  # fmt: skip
    told = " ".join(guessed.left_out)
    assert "Gravity.csv: gravity as it is computed, not a reading: left out." in told
    assert (
        "Accelerometer.csv: another accelerometer at the same time as TotalAcceleration.csv" in told
    )


def test_a_head_that_speaks_of_other_rates(tmp_path, motion):
    rows = "\n".join(",".join(f"{v:.6f}" for v in row) for row in motion.gyroscope)
    head = "# Filter cut-off frequency: 50 Hz\n# GPS update rate: 5 Hz\n# Sample Rate: 100 Hz\n"
    (tmp_path / "log.csv").write_text(f"{head}gx,gy,gz\n{rows}\n")
    assert tables_of(tmp_path / "log.csv")["gyroscope"]["rate"] == 100.0


def test_stamps_that_the_head_denies_are_not_used(tmp_path, motion):
    rows = np.column_stack([np.arange(len(motion.gyroscope)) * 100, motion.gyroscope])
    body = "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows)
    (tmp_path / "log.csv").write_text(f"// Update Rate: 100.0Hz\nSampleTimeFine,gx,gy,gz\n{body}\n")
    table = tables_of(tmp_path / "log.csv")["gyroscope"]
    assert table["rate"] == 100.0
    assert "time" not in table["columns"]


def test_a_rest_that_warms_up_is_a_rest(tmp_path):
    rng = np.random.default_rng(43)
    time = np.arange(60_000) / RATE
    drift = 0.5 * (1 - np.exp(-time / 120))  # deg/s
    rows = np.column_stack([time, *(drift + rng.normal(scale=0.03, size=(3, len(time))))])
    np.savetxt(
        tmp_path / "log.csv",
        rows,
        "%.5f",
        ",",
        header="t,gyro_x_dps,gyro_y_dps,gyro_z_dps",
        comments="",
    )
    table = tables_of(tmp_path / "log.csv")["gyroscope"]
    assert (table["kind"], table["unit"]) == ("static", "deg/s")


def test_a_rate_table_about_the_vertical_is_no_rest(tmp_path):
    rng = np.random.default_rng(44)
    time = np.arange(12_000) / RATE
    turn = np.select([time < 20, time < 50, time < 80], [0.0, 57.0, -57.0], 114.0)
    rows = np.column_stack([
        time, rng.normal(0.1, 0.05, (len(time), 2)), turn + rng.normal(0.1, 0.05, len(time)),
        rng.normal((0.1, 0.1, 9.8), 0.01, (len(time), 3))
    ])  # fmt: skip
    np.savetxt(tmp_path / "log.csv", rows, "%.5f", ",", header="t,gx,gy,gz,ax,ay,az", comments="")
    assert {t["kind"] for t in tables_of(tmp_path / "log.csv").values()} == {"trajectory"}


@pytest.mark.parametrize("per_count", [1 / 16.4, 0.061, 0.0625, 0.05, 0.07, 1 / 32.8])
def test_gyroscope_counts_stay_counts(tmp_path, motion, per_count):
    counts = np.round(np.degrees(motion.gyroscope) / per_count)
    rows = np.column_stack([np.arange(len(counts)) / RATE, motion.accelerometer, counts])
    np.savetxt(tmp_path / "log.csv", rows, ["%.2f"] + ["%.4f"] * 3 + ["%d"] * 3, ",",
               header="t,ax,ay,az,gx,gy,gz", comments="")  # fmt: skip
    (gyroscope,) = (r for r in guess_files([tmp_path / "log.csv"]).recordings
                    if r.table["sensor"] == "gyroscope")  # fmt: skip
    assert gyroscope.table["unit"] == "counts"
    scale = gyroscope.table["scale"]
    stated = scale["factor"] * (1 if scale["unit"] == "deg/s" else np.degrees(1))
    assert stated == pytest.approx(per_count, rel=0.02)


def test_a_tilted_accelerometer_has_no_offset(tmp_path):
    rng = np.random.default_rng(45)
    counts = np.round(rng.normal(16384 * np.array([0.52, 0.57, 0.64]), 20, (3000, 3)))
    np.savetxt(tmp_path / "log.csv", counts, "%d", ",", header="ax,ay,az", comments="")
    table = tables_of(tmp_path / "log.csv")["accelerometer"]
    assert "offset" not in table["scale"]
    assert table["scale"]["factor"] == pytest.approx(9.80665 / 16384, rel=0.02)


def test_two_sets_of_sensors_are_told_apart(tmp_path, motion):
    frame = pandas.DataFrame({"t": np.arange(len(motion.gyroscope)) / RATE})
    for prefix in ("imu0_", "imu1_"):
        for k, axis in enumerate("xyz"):
            frame[f"{prefix}g{axis}"] = motion.gyroscope[:, k]
            frame[f"{prefix}a{axis}"] = motion.accelerometer[:, k]
    frame.to_csv(tmp_path / "log.csv", index=False)
    guessed = guess_files([tmp_path / "log.csv"])
    assert sorted(r.table["sensor"] for r in guessed.recordings) == ["accelerometer", "gyroscope"]
    assert sum("another" in text for text in guessed.left_out) == 2


def test_gauss_for_an_acceleration_is_meant_as_gravity(tmp_path, motion):
    frame = pandas.DataFrame(
        motion.accelerometer / 9.80665, columns=[f"acceleration{a}(G)" for a in "XYZ"]
    )
    frame.insert(0, "time", np.arange(len(frame)) / RATE)
    frame.to_csv(tmp_path / "log.csv", index=False)
    assert tables_of(tmp_path / "log.csv")["accelerometer"]["unit"] == "g"


def test_columns_that_hold_no_samples_are_passed_over(tmp_path, motion):
    frame = pandas.DataFrame(motion.gyroscope, columns=["gx", "gy", "gz"])
    frame["t"] = np.arange(len(frame)) / RATE
    frame["covariance"] = [[0.0, 1.0]] * len(frame)
    frame.to_parquet(tmp_path / "log.parquet")
    guessed = guess_files([tmp_path / "log.parquet"])
    assert [r.table["sensor"] for r in guessed.recordings] == ["gyroscope"]
    assert "'covariance'" in guessed.left_out[0]


@pytest.mark.parametrize(("gravity", "unit"), [(9.80665, "rad/s"), (1.0, "deg/s")])
def test_where_both_are_possible_the_accelerometer_beside_it_tells(tmp_path, gravity, unit):
    rng = np.random.default_rng(46)
    rows = np.column_stack([
        np.arange(2000) / RATE, rng.normal(0.004, 0.002, (2000, 3)),
        rng.normal((0.0, 0.1 * gravity, 0.995 * gravity), 0.002 * gravity, (2000, 3)),
    ])  # fmt: skip
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header="t,gx,gy,gz,ax,ay,az", comments="")
    table = tables_of(tmp_path / "log.csv")["gyroscope"]
    assert table["unit"] == unit
    assert table["guessed"] == {"unit": "low"}


@pytest.mark.parametrize("stamp", ["whole seconds", "tenths"])
def test_stamps_that_samples_share_are_no_temperature(tmp_path, stamp):
    rng = np.random.default_rng(47)
    time = np.arange(30_000) / RATE
    time = np.floor(time) if stamp == "whole seconds" else np.floor(time * 10) / 10
    rows = np.column_stack([time, rng.normal(0.1, 0.05, (len(time), 3))])
    np.savetxt(
        tmp_path / "log.csv", rows, "%.4f", ",", header="t,gx_dps,gy_dps,gz_dps", comments=""
    )
    (recording,) = guess_files([tmp_path / "log.csv"]).recordings
    assert recording.table["kind"] == "static"
    assert "temperature" not in recording.table["columns"]
    if "rate" in recording.table and "rate" not in recording.table.get("guessed", {}):
        assert recording.table["rate"] == pytest.approx(RATE, rel=0.01)
