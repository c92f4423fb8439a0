"""PX4's logs: what is written byte by byte is read, by pyulog and by us, and damage is told."""

import io
import struct
import sys
import tomllib

import numpy as np
import pytest
from pyulog import ULog

import sensorbook
from recordings.mutants import OPERATIONS, mutant
from recordings.ulog_writer import (
    ACCEL,
    ATTITUDE,
    COMBINED,
    FIFO,
    IMU,
    MAG,
    MAGIC,
    datum,
    definition,
    flags,
    log,
    message,
    subscription,
)
from sensorbook import InputError
from sensorbook.cli import main
from sensorbook.guessing import guess_files
from sensorbook.recordings import check, open_table
from sensorbook.recordings.tables import table_names

COUNT = 600
STEP = 5000  # µs
HEADER = MAGIC + b"\x01" + bytes(8)


def topics(count=COUNT, step=STEP, seed=1):
    """Columns of a rest: FRD axes, m/s², rad/s, gauss, °C; logged 700 µs after they were sampled."""
    rng = np.random.default_rng(seed)
    sampled = 2_000_000 + step * np.arange(count)
    common = {"timestamp": sampled + 700, "timestamp_sample": sampled, "device_id": np.full(count, 9),
              "temperature": np.linspace(40, 41, count, dtype=np.float32)}  # fmt: skip

    def vector(mean, scatter):
        return rng.normal(mean, scatter, (count, 3)).astype(np.float32)

    force, rate = vector((0.1, -0.2, -9.8), 0.02), vector(0.003, 0.002)
    field = vector((0.2, 0.03, 0.41), 0.003)
    imu = {"delta_angle": rate * np.float32(step * 1e-6), "delta_angle_dt": np.full(count, step),
           "delta_velocity": force * np.float32(step * 1e-6),
           "delta_velocity_dt": np.full(count, step)}  # fmt: skip
    return {
        "sensor_accel": ("sensor_accel", 0, ACCEL, common | axes(force)),
        "sensor_gyro": ("sensor_gyro", 0, ACCEL, common | axes(rate)),
        "sensor_mag": ("sensor_mag", 0, MAG, common | axes(field)),
        "sensor_accel:1": ("sensor_accel", 1, ACCEL, common | axes(force + np.float32(0.1))),
        "sensor_combined": ("sensor_combined", 0, COMBINED,
                            {"timestamp": sampled, "gyro_rad": rate, "accelerometer_m_s2": force}),
        "vehicle_imu": ("vehicle_imu", 0, IMU, common | imu),
    }  # fmt: skip


def axes(values):
    return dict(zip("xyz", values.T, strict=True))


@pytest.fixture
def write(tmp_path):
    """Writes a log of these topics, or of these bytes."""

    def write(*content, name="log.ulg", **options):
        path = tmp_path / name
        whole = isinstance(content[0], bytes)
        path.write_bytes(content[0] if whole else log(*content, **options))
        return path

    return write


def message_of(path, table=None):
    told = said_of(path, table)
    assert isinstance(told, str)
    return told


def said_of(path, table=None):
    """The message, or the columns where it can be read."""
    try:
        opened = open_table(path, table=table)
        opened.parse(range(len(opened.names)))
    except InputError as error:
        return str(error)
    return [opened.column(k) for k in range(len(opened.names))]


def dropout(stamp, milliseconds):
    return stamp, message("O", struct.pack("<H", milliseconds))


# ---- what is written is read ----


def test_every_value_of_every_topic(write):
    written = topics()
    path = write(*written.values())
    theirs = {(d.name, d.multi_id): d.data for d in ULog(str(path)).data_list}
    assert set(table_names(path)) == set(written)
    for name, (topic, instance, _, columns) in written.items():
        table = open_table(path, table=name)
        assert list(theirs[topic, instance]) == list(table.names)
        for column in table.names:
            values = table.column(column)
            np.testing.assert_array_equal(values, theirs[topic, instance][column])
            stem, _, place = column.rstrip("]").partition("[")
            if stem in columns:
                expected = np.asarray(columns[stem])
                np.testing.assert_array_equal(
                    values, expected[:, int(place)] if place else expected
                )
            else:
                assert not values.any()


def test_what_pyulog_writes_is_read_alike(write, tmp_path):
    written = topics(50)
    path = write(*written.values(), extra=[dropout(2_100_000, 40)])
    ULog(str(path)).write_ulog(str(tmp_path / "again.ulg"))
    assert (tmp_path / "again.ulg").read_bytes() != path.read_bytes()
    for name in written:
        one, other = (open_table(p, table=name) for p in (path, tmp_path / "again.ulg"))
        assert (one.names, one.units, one.losses) == (other.names, other.units, other.losses)
        for column in one.names:
            np.testing.assert_array_equal(one.column(column), other.column(column))


def test_units_are_those_of_px4s_messages(write):
    path = write(*topics(20).values())

    def units(table):
        opened = open_table(path, table=table)
        return {n: u for n, u in zip(opened.names, opened.units, strict=True) if u}

    common = {"timestamp": "us", "timestamp_sample": "us", "temperature": "degC"}
    for table, unit in (("sensor_accel", "m/s^2"), ("sensor_gyro", "rad/s"), ("sensor_mag", "gauss"),
                        ("sensor_accel:1", "m/s^2")):  # fmt: skip
        assert units(table) == common | dict.fromkeys("xyz", unit)
    assert units("sensor_combined") == {"timestamp": "us"} | {
        f"{name}[{k}]": unit
        for name, unit in (("gyro_rad", "rad/s"), ("accelerometer_m_s2", "m/s^2"))
        for k in range(3)
    }
    assert units("vehicle_imu")["delta_angle[0]"] == "rad"
    assert units("vehicle_imu")["delta_velocity[2]"] == "m/s"


def test_formats_within_formats(write):
    path = write(b"".join([
        HEADER, definition("point", "float[3] at;uint8_t mark;"),
        definition("pair", "uint64_t timestamp;point[2] p;double end;"), subscription("pair", 3),
        *(message("D", struct.pack("<HQ3fB3fBd", 3, k, k, 2, 3, 4, 5, 6, 7, 8, k / 8)) for k in range(9)),
    ]))  # fmt: skip
    table = open_table(path)
    assert table.names == ("timestamp", "p[0].at[0]", "p[0].at[1]", "p[0].at[2]", "p[0].mark",
                           "p[1].at[0]", "p[1].at[1]", "p[1].at[2]", "p[1].mark", "end")  # fmt: skip
    np.testing.assert_array_equal(table.column("p[0].at[0]"), np.arange(9))
    np.testing.assert_array_equal(table.column("p[1].mark"), np.full(9, 8))
    np.testing.assert_array_equal(table.column("end"), np.arange(9) / 8)


def test_a_fifo_is_read_sample_by_sample(write):
    rng = np.random.default_rng(2)
    sizes = np.array([8, 3, 32, 0, 7])
    ends = 5_000_000 + 125 * np.cumsum(sizes)  # µs: 8 kHz without a gap
    counts = rng.integers(-3000, 3000, (5, 3, 32))  # what is beyond a burst's size is left over
    columns = {"timestamp": ends + 90, "timestamp_sample": ends, "dt": np.full(5, 125.0),
               "scale": np.full(5, 0.5), "samples": sizes}  # fmt: skip
    columns |= {axis: counts[:, k] for k, axis in enumerate("xyz")}
    path = write(("sensor_gyro_fifo", 0, FIFO, columns))
    table = open_table(path)
    assert table.names == ("timestamp", "timestamp_sample", "x", "y", "z")
    assert table.units == ("us", "us", "rad/s", "rad/s", "rad/s")
    np.testing.assert_array_equal(
        table.column("timestamp_sample"), 5_000_000 + 125 * np.arange(1, 51)
    )
    for k, axis in enumerate("xyz"):
        expected = np.concatenate([counts[n, k, :size] for n, size in enumerate(sizes)]) * 0.5
        np.testing.assert_array_equal(table.column(axis), expected)
    columns["samples"] = sizes + 30
    assert message_of(write(("sensor_gyro_fifo", 0, FIFO, columns))) == (
        "log.ulg: is a damaged ULog file — copy it again"
    )


def test_data_appended_after_power_was_lost(write):
    written = topics(30)["sensor_gyro"]
    cut = log(written)[:-20]
    whole = log(written, begin=flags(appended=len(cut)))[:-20]
    path = write(whole + message("M", b"\x00\x11char[4] hardfaultTEXT"))
    np.testing.assert_array_equal(open_table(path).column("x"), written[3]["x"][:29])
    assert len(whole) == len(cut)
    assert message_of(write(whole[:-1] + message("M", b"\x00\x11char[4] hardfaultTEXT"))) != ""


# ---- what it is, told by itself ----


def test_a_log_alone_is_understood(write, tmp_path, capsys):
    path = write(*topics().values(), extra=[dropout(2_500_000, 40), dropout(3_000_000, 210)])
    assert main(["new", str(tmp_path / "mine"), "--from", str(path)]) == 0
    said = capsys.readouterr().out
    declared = tomllib.loads((tmp_path / "mine" / "device.toml").read_text())["recording"]
    assert {r["sensor"]: (r["table"], r["unit"], r["time_unit"], r["kind"]) for r in declared} == {
        "accelerometer": ("sensor_accel", "m/s^2", "us", "static"),
        "gyroscope": ("sensor_gyro", "rad/s", "us", "static"),
        "magnetometer": ("sensor_mag", "gauss", "us", "static"),
    }
    for table in declared:
        assert "guessed" not in table
        assert table["columns"] == {"time": "timestamp_sample", "x": "x", "y": "y", "z": "z",
                                    "temperature": "temperature"}  # fmt: skip
    assert "log.ulg, sensor_accel:1: another accelerometer at the same time" in said
    assert (
        "log.ulg, vehicle_imu: holds increments of angle and velocity, which are no rates, and no "
        "sensor's readings: left out."
    ) in said.splitlines()
    problems, findings = check(tmp_path / "mine")
    assert problems == []
    lost = [f for f in findings if f.kind == "gap"]
    assert [str(f).partition(" — ")[0] for f in lost] == [
        f"log.ulg: {sensor}: its logger dropped messages 2 times, for 0.25 s in all"
        for sensor in ("accelerometer", "gyroscope", "magnetometer")
    ]
    device = sensorbook.load(tmp_path / "mine")
    mag = topics()["sensor_mag"][3]
    np.testing.assert_allclose(
        device.magnetometer.static.values,
        1e-4 * np.stack([mag[a] for a in "xyz"], axis=1, dtype=float),
        rtol=1e-12,
    )
    assert device.gyroscope.static.rate == pytest.approx(200, rel=1e-9)


def test_what_is_logged_in_full_goes_before_what_is_logged_now_and_then(write):
    full, rare = topics(2000), topics(150, 66_000)
    path = write(rare["sensor_accel"], rare["sensor_gyro"], full["sensor_combined"])
    tables = {r.table["sensor"]: r.table for r in guess_files([path]).recordings}
    assert {s: t["table"] for s, t in tables.items()} == dict.fromkeys(
        ("accelerometer", "gyroscope"), "sensor_combined"
    )
    assert tables["gyroscope"]["columns"]["x"] == "gyro_rad[0]"
    assert tables["gyroscope"]["unit"] == "rad/s"
    assert tables["accelerometer"]["columns"]["z"] == "accelerometer_m_s2[2]"


def test_increments_alone_are_no_sensor(write):
    path = write(topics()["vehicle_imu"])
    with pytest.raises(
        InputError, match="holds increments of angle and velocity, which are no rates"
    ):
        guess_files([path])


def test_what_is_filtered_in_flight_is_no_reading(write):
    written = topics()
    fields = "uint64_t timestamp;float[3] xyz;"
    columns = {"timestamp": written["sensor_combined"][3]["timestamp"],
               "xyz": written["sensor_combined"][3]["gyro_rad"]}  # fmt: skip
    filtered = ("vehicle_angular_velocity", 0, fields, columns)
    assert table_names(write(filtered, written["sensor_gyro"])) == ("sensor_gyro",)
    path = write(filtered)
    with pytest.raises(
        InputError, match="holds what PX4 has corrected and filtered in flight, not a"
    ):
        guess_files([path])
    table = open_table(path, table="vehicle_angular_velocity")
    assert table.units == ("us", "rad/s", "rad/s", "rad/s")
    np.testing.assert_array_equal(table.column("xyz[1]"), columns["xyz"][:, 1])


def test_the_estimated_attitude_serves_as_a_reference_where_it_is_declared(write, tmp_path):
    turned = np.array([0.5, -0.5, 0.1, 0.7])  # w, x, y, z
    stamps = 1_000_000 + 10_000 * np.arange(200)
    path = write(
        topics()["sensor_gyro"],
        ("vehicle_attitude", 0, ATTITUDE, {"timestamp": stamps, "q": np.tile(turned, (200, 1))}),
    )
    (tmp_path / "device.toml").write_text(
        'schema = 1\nid = "px4"\n[[recording]]\nsensor = "gyroscope"\nkind = "trajectory"\n'
        f'file = "{path.name}"\ntable = "sensor_gyro"\nunit = "rad/s"\ntime_unit = "us"\n'
        'columns = { time = "timestamp_sample", x = "x", y = "y", z = "z" }\n'
        f'[[recording]]\nsensor = "reference"\nkind = "trajectory"\nfile = "{path.name}"\n'
        'table = "vehicle_attitude"\nquaternion = "body_to_reference"\ntime_unit = "us"\n'
        'columns = { time = "timestamp", w = "q[0]", x = "q[1]", y = "q[2]", z = "q[3]" }\n'
    )
    values = sensorbook.load(tmp_path).runs("reference", "trajectory")[0].values
    np.testing.assert_allclose(
        np.abs(values), np.abs(np.float32(np.tile(turned[[1, 2, 3, 0]], (200, 1))))
    )


def test_stamps_out_of_order_are_told_and_not_sorted(write):
    gyro = topics()["sensor_gyro"]
    shuffled = gyro[3] | {"timestamp_sample": gyro[3]["timestamp_sample"].copy()}
    shuffled["timestamp_sample"][300:] -= 500_000
    path = write((*gyro[:3], shuffled))
    np.testing.assert_array_equal(
        open_table(path).column("timestamp_sample"), shuffled["timestamp_sample"]
    )
    _, findings = check(path)
    (back,) = (f for f in findings if f.kind == "backward")
    assert str(back).startswith(
        "log.ulg: gyroscope: the time goes back at 1 place, first at 1.495 s by 0.495 s"
    )


# ---- what is no log to be read ----


def test_which_topic_must_be_said(write):
    names = ("sensor_accel", "sensor_mag", "sensor_gyro")
    path = write(*(topics(20)[n] for n in names))
    listed = "topics: 'sensor_accel', 'sensor_gyro', 'sensor_mag'"
    assert message_of(path) == (
        f'log.ulg: holds 3 topics of samples — say which with table = "…"; {listed}'
    )
    assert message_of(path, "sensor_baro") == (
        f"log.ulg: table 'sensor_baro': there is no such topic — {listed}"
    )


def test_a_log_without_sensors(write):
    battery = "uint64_t timestamp;float voltage_v;"
    columns = {"timestamp": np.arange(200), "voltage_v": np.ones(200)}
    path = write(("battery_status", 0, battery, columns))
    assert table_names(path) == ()
    expected = (
        "log.ulg: holds no readings of a sensor: battery_status — "
        "log a topic such as sensor_accel, sensor_gyro or sensor_mag"
    )
    assert message_of(path) == expected
    problems, _ = check(path)
    assert [str(p) for p in problems] == [expected]
    assert len(open_table(path, table="battery_status").column("voltage_v")) == 200


@pytest.mark.parametrize("content", [
    HEADER, HEADER + flags(), HEADER + definition("sensor_gyro", ACCEL),
    HEADER + definition("sensor_gyro", ACCEL) + subscription("sensor_gyro", 0),
])  # fmt: skip
def test_an_empty_log(write, content):
    assert message_of(write(content)) == (
        "log.ulg: is a log without samples — log the topics of its sensors, such as sensor_accel"
    )


def test_a_log_cut_off_anywhere(write):
    whole = log(topics(2)["sensor_mag"], topics(2)["sensor_gyro"])
    bounds, at, first = {16}, 16, 0
    while at < len(whole):
        first = first or (at if whole[at + 2] == ord("D") else 0)
        at += 3 + int.from_bytes(whole[at : at + 2], "little")
        bounds.add(at)
    for size in range(1, len(whole)):
        path = write(whole[:size])
        if size in bounds:  # nothing shows that more came
            told = said_of(path, "sensor_mag")
            assert isinstance(told, str) == (size <= first)
            assert size > first or "is a log without samples" in told
            continue
        last = max((b for b in bounds if b < size), default=0)
        told = message_of(path, "sensor_mag")
        assert told.startswith("log.ulg: ")
        if size >= 16:
            assert told == (
                f"log.ulg: byte {last}: is cut off: its last message breaks off — copy it again, or keep "
                f"its first {last} bytes, which are whole"
            ), size


def test_without_its_library_the_command_that_installs_it_is_told(write, monkeypatch, capsys):
    path = write(topics(20)["sensor_gyro"], topics(20)["sensor_accel"])
    monkeypatch.setitem(sys.modules, "pyulog", None)
    assert main(["check", str(path)]) == 1
    said = capsys.readouterr()
    assert (said.out + said.err).strip() == (
        "log.ulg: is a PX4 ULog file, and pyulog, which reads it, is not installed — pip install "
        "sensorbook[ulog]"
    )


def test_what_a_newer_logger_writes_is_refused(write):
    whole = log(topics(20)["sensor_gyro"])
    assert message_of(write(whole[:7] + b"\x02" + whole[8:])) == (
        "log.ulg: is a ULog file of version 2, which is not known — copy it again, or save its topics as "
        ".csv with ulog2csv"
    )
    assert message_of(write(log(topics(20)["sensor_gyro"], begin=flags(incompatible=2)))) == (
        "log.ulg: is a ULog file with extensions that are not known — copy it again, or save its topics "
        "as .csv with ulog2csv"
    )


SMALL = "uint64_t timestamp;float x;float y;float z;"
ROW = datum(SMALL, 0, {"x": 1.0})


@pytest.mark.parametrize("parts", [
    # pyulog would recurse without an end, or build 65535² names.
    [definition("a", "uint64_t timestamp;a inner;"), subscription("a", 0), ROW],
    [definition("b", "float[65535] x;"), definition("a", "uint64_t timestamp;b[65535] y;"),
     subscription("a", 0), ROW],
    [definition("a", SMALL), subscription("a", 0), ROW, message("D", b"\x09\x00" + bytes(20))],
    [definition("a", SMALL), subscription("a", 0), ROW, message("D", bytes(12))],
    [definition("a", SMALL), subscription("a", 0), ROW, subscription("a", 0)],
    [definition("a", SMALL), subscription("a", 0), ROW, message("\7", b"1")],
    [definition("a", SMALL), subscription("a", 0), ROW, message("Z", b"")],
    [definition("a", SMALL), subscription("a", 0), ROW, message("E", ROW[3:])],
    [definition("a", SMALL), subscription("a", 0), ROW, bytes(30)],
    [definition("a", SMALL), subscription("a", 0), ROW, message("S", bytes(8))],
    [definition("a", SMALL), subscription("b", 0), ROW],
    [definition("a", "float x;float y;float z;"), subscription("a", 0), message("D", bytes(14))],
    [definition("a", SMALL + "float x;"), subscription("a", 0), message("D", bytes(26))],
    [definition("a", SMALL.replace("float z", "float16 z")), subscription("a", 0), ROW],
    [definition("a", SMALL.replace("float z", "float[0] z")), subscription("a", 0), ROW],
    [message("F", b"a:uint64_t timestamp;\xff\xfe x;"), subscription("a", 0), ROW],
    [message("B", bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", 1 << 60, 0, 0)),
     definition("a", SMALL), subscription("a", 0), ROW],
])  # fmt: skip
def test_what_a_log_declares_is_not_trusted(write, parts, capsys):
    told = message_of(write(HEADER + b"".join(parts)))
    assert "is a damaged ULog file — copy it again, or keep its first" in told
    assert capsys.readouterr() == ("", "")


def test_rows_after_a_message_that_pyulog_stumbles_over(write):
    """It ends there without a word where it reads the file by itself."""
    begin = HEADER + definition("a", SMALL) + subscription("a", 0) + ROW
    path = write(begin + message("P", b"\x09int32_t P" + b"\x01") + ROW)
    assert len(ULog(str(path)).data_list[0].data["x"]) == 1
    np.testing.assert_array_equal(open_table(path).column("x"), [1, 1])


def test_messages_of_a_newer_logger_are_passed_over_and_told(write):
    written = topics(200)["sensor_gyro"]
    path = write(log(written, extra=[(0, message("X", bytes(8))), (1, message("e", b"1"))]))
    table = open_table(path)
    for name, values in written[3].items():
        np.testing.assert_array_equal(table.column(name), values)
    assert table.losses == ("2 messages of a type that is not known (X, e) passed over",)


def test_a_topic_that_is_added_again_goes_on(write):
    rows = [datum(SMALL, k // 5, {"timestamp": k, "x": k}) for k in range(10)]
    begin = HEADER + definition("a", SMALL)
    again = subscription("a", 0) + b"".join(rows[:5]) + subscription("a", 1) + b"".join(rows[5:])
    path = write(begin + again)
    assert [len(d.data["x"]) for d in ULog(str(path)).data_list] == [5, 5]
    np.testing.assert_array_equal(open_table(path).column("x"), np.arange(10))
    np.testing.assert_array_equal(open_table(path).column("timestamp"), np.arange(10))


def test_a_header_that_is_cut_off(write):
    assert message_of(write(HEADER[:10])) == (
        "log.ulg: is cut off within its header — copy it again"
    )


def test_padding_that_some_messages_hold(write):
    padded = "uint64_t timestamp;float x;float y;float z;uint8_t[4] _padding0;"
    rows = [datum(padded, 0, {"timestamp": k, "x": k}) for k in range(9)]
    rows[4] = message("D", rows[4][3:] + bytes(4))
    path = write(HEADER + definition("a", padded) + subscription("a", 0) + b"".join(rows))
    np.testing.assert_array_equal(open_table(path).column("x"), np.arange(9))
    assert open_table(path).names == ("timestamp", "x", "y", "z")


def test_many_topics_of_many_fields_take_no_time(write):
    fields = definition("b", "float[16000] x;") + definition("a", "uint64_t timestamp;b y;")
    path = write(HEADER + fields + b"".join(
        message("A", struct.pack("<BH", k % 256, k) + b"a") for k in range(256)))  # fmt: skip
    assert "is a damaged ULog file" in message_of(path)


def test_damage_is_told_or_changes_values_alone(write, capsys):
    """300 damaged logs: refused, or as many rows as were written; only a cut may leave fewer."""
    written = topics(40)
    whole = log(*(written[n] for n in ("sensor_accel", "sensor_gyro", "sensor_mag")))
    refused, names = 0, ("sensor_accel", "sensor_gyro", "sensor_mag")
    for number in range(300):
        rng = np.random.default_rng([20240501, number])
        made = mutant(whole, OPERATIONS[number % len(OPERATIONS)], rng)
        path = write(made.content)
        read = [said_of(path, name) for name in names]
        if told := [r for r in read if isinstance(r, str)]:
            assert "\n" not in told[0]
            refused += 1
            continue
        rows = [len(columns[0]) for columns in read]
        assert rows == [40] * 3 or made.operation in ("cut", "repeat", "remove"), (number, rows)
        assert made.operation != "remove" or (made.stop - made.start) >= 30, (number, rows)
    assert 150 < refused < 290
    assert capsys.readouterr() == ("", "")


def test_logs_are_read_in_memory_once(write):
    """The survey of a log is kept, and made anew when the file has changed."""
    one, other = (log(topics(n)["sensor_gyro"]) for n in (20, 30))
    assert len(open_table(write(one)).column("x")) == 20
    assert len(open_table(write(other)).column("x")) == 30
    assert ULog(io.BytesIO(other)).data_list[0].data["x"].shape == (30,)
