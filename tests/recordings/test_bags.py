"""ROS bags and MCAP: what independent libraries wrote comes back, and what cannot be read is said."""

import bz2
import sqlite3
import sys
from dataclasses import replace

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType
from rosbags import rosbag2
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation

import sensorbook
from recordings import bag_writers
from recordings.bag_writers import BEGIN, ROS2, SECOND, WRITERS, field, imu, temperature
from recordings.mutants import OPERATIONS, mutant
from sensorbook import InputError, Refusal
from sensorbook.guessing import guess_files, new_device
from sensorbook.recordings import check, from_declaration, open_table
from sensorbook.recordings.tables import table_names

IMU = "sensor_msgs/msg/Imu"
COUNT = 300
STEP = 5_000_000  # ns
VECTORS = [
    f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"
]
QUATERNION = [f"orientation.{axis}" for axis in "xyzw"]


@pytest.fixture
def numbers():
    """(COUNT, 10) doubles of all sizes, with a NaN, and the stamps: ns since 1970, of odd digits."""
    rng = np.random.default_rng(5)
    numbers = rng.normal(size=(COUNT, 10)) * 10.0 ** rng.integers(-300, 300, (COUNT, 10))
    numbers[7, 2] = np.nan
    return numbers, BEGIN + STEP * np.arange(COUNT) + rng.integers(0, 1000, COUNT)


def sent(numbers, attitude=True):
    values, stamps = numbers
    return [
        imu(tuple(v[:3]), tuple(v[3:6]), stamp=int(t), attitude=tuple(v[6:]) if attitude else None)
        for v, t in zip(values.tolist(), stamps, strict=True)
    ]


def columns(table, names):
    return np.stack([table.column(name) for name in names], axis=1)


@pytest.mark.parametrize("form", WRITERS)
def test_what_was_written_comes_back_to_the_bit(tmp_path, numbers, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, sent(numbers))
    assert table_names(path) == ("/imu/data",)
    table = open_table(path)
    values, stamps = numbers
    np.testing.assert_array_equal(columns(table, VECTORS + QUATERNION), values)
    np.testing.assert_array_equal(table.column("stamp"), stamps)
    np.testing.assert_array_equal(table.column("received"), stamps + 2_000_000)
    units = dict(zip(table.names, table.units, strict=True))
    assert [units[name] for name in VECTORS] == ["rad/s"] * 3 + ["m/s^2"] * 3
    assert (units["stamp"], units["received"]) == ("ns", "ns")


@pytest.mark.parametrize("compression", CompressionType)
def test_chunks_are_inflated(tmp_path, numbers, compression):
    path = tmp_path / "log.mcap"
    bag_writers.mcap_ros2(path, sent(numbers), compression, chunk=10_000)
    np.testing.assert_array_equal(columns(open_table(path), VECTORS), numbers[0][:, :6])


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_chunks_of_a_ros_1_bag_are_inflated(tmp_path, numbers, compression):
    path = tmp_path / "log.bag"
    bag_writers.ros1(path, sent(numbers), compression)
    np.testing.assert_array_equal(columns(open_table(path), VECTORS), numbers[0][:, :6])


@pytest.mark.parametrize("form", ["ros1", "mcap-ros2"])
def test_names_of_frames_may_have_any_length_and_change(tmp_path, numbers, form):
    path = tmp_path / "log.dat"
    frames = ["", *("x" * k for k in range(1, 20))]
    messages = [replace(m, frame=frames[k % 20]) for k, m in enumerate(sent(numbers))]
    WRITERS[form](path, messages)
    np.testing.assert_array_equal(columns(open_table(path), VECTORS), numbers[0][:, :6])
    np.testing.assert_array_equal(open_table(path).column("stamp"), numbers[1])


def payloads(numbers, little_endian=True):
    return [
        bytes(
            ROS2.serialize_cdr(bag_writers.of_rosbags(ROS2, m), m.type, little_endian=little_endian)
        )
        for m in sent(numbers)
    ]


def test_cdr_of_either_byte_order(tmp_path, numbers):
    path = tmp_path / "log.mcap"
    data = payloads(numbers, little_endian=False)
    bag_writers.mcap_of_bytes(path, IMU, "cdr", data)
    table = open_table(path)
    np.testing.assert_array_equal(columns(table, VECTORS), numbers[0][:, :6])
    np.testing.assert_array_equal(table.column("stamp"), numbers[1])


@pytest.mark.parametrize("form", ["ros1", "ros2-sqlite", "mcap-ros2"])
def test_an_attitude_that_is_not_given_is_missing(tmp_path, numbers, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, sent(numbers, attitude=False))
    assert np.isnan(columns(open_table(path), QUATERNION)).all()


def several(count=1200, seed=3):
    """A rest at 100 Hz: an IMU, a magnetometer at 50 Hz, a thermometer at 10 Hz."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        t = BEGIN + k * 10_000_000
        gyro, force = rng.normal(0, 1e-3, 3), rng.normal([0, 0, 9.81], 0.02)
        out.append(imu(tuple(gyro.tolist()), tuple(force.tolist()), stamp=t))
        if k % 2 == 0:
            values = rng.normal([2e-5, 1e-6, -4e-5], 1e-7)
            out.append(field(tuple(values.tolist()), stamp=t))
        if k % 10 == 0:
            out.append(temperature(25 + float(rng.normal(0, 0.01)), stamp=t))
    return out


@pytest.mark.parametrize("form", WRITERS)
def test_each_topic_is_a_table(tmp_path, form):
    path = tmp_path / "log.dat"
    messages = several(200)
    WRITERS[form](path, messages)
    assert sorted(table_names(path)) == ["/imu/data", "/imu/mag", "/imu/temperature"]
    compass, thermometer = (open_table(path, table=f"/imu/{n}") for n in ("mag", "temperature"))
    wanted = [m.fields["magnetic_field"] for m in messages if m.topic == "/imu/mag"]
    np.testing.assert_array_equal(columns(compass, compass.names[:3]), wanted)
    assert compass.names[:3] == tuple(f"magnetic_field.{axis}" for axis in "xyz")
    wanted = [m.fields["temperature"] for m in messages if m.topic == "/imu/temperature"]
    np.testing.assert_array_equal(thermometer.column("temperature"), wanted)
    assert (compass.units[:3], thermometer.units[0]) == (("T",) * 3, "degC")
    with pytest.raises(InputError) as caught:
        open_table(path)
    assert str(caught.value) == (
        'log.dat: holds 3 topics of samples — say which with table = "…"; '
        "topics: '/imu/data', '/imu/mag', '/imu/temperature'"
    )
    with pytest.raises(InputError) as caught:
        open_table(path, table="/imu")
    assert str(caught.value) == (
        "log.dat: table '/imu': there is no such topic — "
        "topics: '/imu/data', '/imu/mag', '/imu/temperature'"
    )


# ---- the whole way ----


@pytest.mark.parametrize("form", ["ros1", "ros2-sqlite", "mcap-ros2"])
def test_new_declares_every_sensor_of_a_bag(tmp_path, form):
    messages = several()
    WRITERS[form](tmp_path / "log.dat", messages)
    new_device(tmp_path / "device", [tmp_path / "log.dat"])
    device = sensorbook.load(tmp_path / "device")
    kinds = {(d.sensor, d.kind, d.table["table"]) for d in device.declared}
    assert kinds == {
        ("gyroscope", "static", "/imu/data"),
        ("accelerometer", "static", "/imu/data"),
        ("magnetometer", "static", "/imu/mag"),
        ("temperature", "static", "/imu/temperature"),
    }
    for name, sensor, rate in (
        ("angular_velocity", "gyroscope", 100.0),
        ("linear_acceleration", "accelerometer", 100.0),
        ("magnetic_field", "magnetometer", 50.0),
    ):
        recording = device.runs(sensor, "static")[0]
        wanted = [m.fields[name] for m in messages if name in m.fields]
        np.testing.assert_array_equal(recording.values, wanted)
        assert recording.rate == rate
        assert recording.start == BEGIN / SECOND
        np.testing.assert_allclose(recording.temperature, 25, atol=0.05)
    assert "guessed" not in device.declared[0].table
    problems, findings = check(tmp_path / "log.dat")
    assert problems == []
    assert {f.kind for f in findings} <= {"guessed"}


def test_an_attitude_beside_motion_becomes_the_reference(tmp_path):
    rng = np.random.default_rng(8)
    smooth = np.cumsum(rng.normal(0, 0.05, (1500, 3)), axis=0) * 0.98 ** np.arange(1500)[:, None]
    rate = smooth + np.sin(np.arange(1500) / 40)[:, None] * [0.8, 0.5, 0.3]
    attitudes, attitude = [], Rotation.identity()
    for omega in rate:  # body to reference, REP 145
        attitudes.append(attitude)
        attitude = attitude * Rotation.from_rotvec(omega / 100)
    messages = [
        imu(tuple(w), tuple(a.inv().apply([0, 0, 9.81])), attitude=tuple(a.as_quat()),
            stamp=BEGIN + k * 10_000_000)
        for k, (w, a) in enumerate(zip(rate, attitudes, strict=True))
    ]  # fmt: skip
    path = tmp_path / "log.bag"
    bag_writers.ros1(path, messages)
    device = sensorbook.load(path)
    reference = next(d for d in device.declared if d.sensor == "reference")
    assert reference.table["quaternion"] == "body_to_reference"
    assert reference.table["columns"] == {
        "time": "stamp", **{axis: f"orientation.{axis}" for axis in "xyzw"}
    }  # fmt: skip


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_folder_stands_for_the_recording_in_it(tmp_path, storage):
    bag_writers.ros2_folder(tmp_path / "drive", several(300), storage)
    new_device(tmp_path / "device", [tmp_path / "drive"])
    file = next(p.name for p in (tmp_path / "drive").iterdir() if p.name != "metadata.yaml")
    for path in (tmp_path / "device", tmp_path / "drive"):
        device = sensorbook.load(path)
        assert {d.file for d in device.declared} == {file}
        assert len(device.gyroscope.static) == 300
    (tmp_path / "drive" / "drive_1.mcap").touch()
    with pytest.raises(InputError) as caught:
        sensorbook.load(tmp_path / "drive")
    first = min(tmp_path / "drive" / name for name in (file, "drive_1.mcap"))
    assert str(caught.value) == (
        f"{tmp_path / 'drive'}: is a ROS 2 bag of 2 files — name one, such as {first}"
    )


# ---- sensors that are not there ----


def of_imus(path, change):
    """A bag of a rest whose Imu messages' fields are changed."""
    messages = [m for m in several() if m.topic == "/imu/data"]
    path.unlink(missing_ok=True)
    bag_writers.ros1(path, [replace(m, fields=m.fields | change) for m in messages])


NOT_GIVEN = "angular_velocity_covariance", "linear_acceleration_covariance"
TRIPLES = [", ".join(map(repr, VECTORS[:3])), ", ".join(map(repr, VECTORS[3:]))]
REP_145 = (
    "a covariance that begins with −1 says that none is given, 0 that it is not known (REP 145)"
)


def test_values_that_a_covariance_takes_back(tmp_path):
    path = tmp_path / "log.bag"
    of_imus(path, {name: (-1.0, *[0.0] * 8) for name in NOT_GIVEN})
    with pytest.raises(InputError) as caught:
        guess_files([path])
    assert str(caught.value) == (
        f"log.bag: holds three axes without a value that a sensor can read ({', '.join(TRIPLES)}) – "
        f"{REP_145} — record again with that sensor on"
    )
    of_imus(path, {"angular_velocity": (float("inf"), 0.0, 0.0)})
    told = f"log.bag: {TRIPLES[0]}: three axes without a value that a sensor can read: left out."
    assert told in guess_files([path]).left_out
    of_imus(path, {NOT_GIVEN[1]: (-1.0, *[0.0] * 8)})
    guessed = guess_files([path])
    assert [r.table["sensor"] for r in guessed.recordings] == ["gyroscope"]
    told = f"{TRIPLES[1]}: three axes without a value that a sensor can read – {REP_145}: left out."
    assert f"log.bag: {told}" in guessed.left_out


def test_an_accelerometer_that_reads_nothing_leaves_the_gyroscope(tmp_path):
    path = tmp_path / "log.bag"
    of_imus(path, {"linear_acceleration": (0.0, 0.0, 0.0)})
    new_device(tmp_path / "device", [path])
    device = sensorbook.load(tmp_path / "device")
    assert [d.sensor for d in device.declared] == ["gyroscope"]
    wanted = [m.fields["angular_velocity"] for m in several() if m.topic == "/imu/data"]
    np.testing.assert_array_equal(device.gyroscope.static.values, wanted)
    told = f"log.bag: {TRIPLES[1]}: three axes that read 0 throughout: left out."
    assert told in guess_files([path]).left_out
    of_imus(path, dict.fromkeys(("angular_velocity", "linear_acceleration"), (0.0, 0.0, 0.0)))
    with pytest.raises(InputError) as caught:
        guess_files([path])
    assert str(caught.value) == (
        f"log.bag: holds three axes that read 0 throughout ({', '.join(TRIPLES)}) — "
        "record again with that sensor on"
    )


def test_an_acceleration_without_gravity_leaves_the_gyroscope(tmp_path):
    path = tmp_path / "log.bag"
    messages = [m for m in several() if m.topic == "/imu/data"]
    for m in messages:
        x, y, z = m.fields["linear_acceleration"]
        m.fields["linear_acceleration"] = (x, y, z - 9.81)
    bag_writers.ros1(path, messages)
    guessed = guess_files([path])
    assert [r.table["sensor"] for r in guessed.recordings] == ["gyroscope"]
    told = f"log.bag: {TRIPLES[1]}: an acceleration without gravity, not a reading: left out."
    assert told in guessed.left_out


def test_a_bag_of_one_message_is_too_short(tmp_path):
    path = tmp_path / "log.bag"
    bag_writers.ros1(path, several(1)[:1])
    with pytest.raises(InputError) as caught:
        guess_files([path])
    assert str(caught.value) == (
        "log.bag: holds 1 row, too few for a recording — record 100 or more"
    )


# ---- stamps ----


def declared(path, **columns):
    """The gyroscope's recording of a bag, declared by hand."""
    axes = {axis: f"angular_velocity.{axis}" for axis in "xyz"}
    table = {"sensor": "gyroscope", "kind": "static", "file": path.name, "unit": "rad/s",
             "table": "/imu/data", "time_unit": "ns", "columns": axes | columns}  # fmt: skip
    device, problems = from_declaration(path.parent, {"schema": 1, "id": "a", "recording": [table]})
    assert problems == []
    return device


@pytest.fixture
def rest():
    return [m for m in several(400) if m.topic == "/imu/data"]


def test_stamps_that_were_never_set(tmp_path, rest):
    path = tmp_path / "log.bag"
    bag_writers.ros1(path, [replace(m, stamp=0) for m in rest])
    problems, _ = declared(path, time="stamp").check()
    assert list(map(str, problems)) == [
        "log.bag: column 'stamp': the time does not advance — "
        'take the time of receipt, time = "received", or give the rate'
    ]
    assert declared(path, time="received").gyroscope.static.rate == 100
    guessed = sensorbook.load(path)
    assert guessed.gyroscope.static.declaration["columns"]["time"] == "received"


@pytest.mark.parametrize("form", ["ros1", "ros2-sqlite", "mcap-ros2"])
def test_stamps_out_of_order_are_told_not_sorted(tmp_path, rest, form):
    order = np.random.default_rng(2).permutation(len(rest))
    mixed = [replace(rest[k], received=m.received) for k, m in zip(order, rest, strict=True)]
    path = tmp_path / "log.dat"
    WRITERS[form](path, mixed)
    stamps = open_table(path).column("stamp")
    np.testing.assert_array_equal(stamps, [m.stamp for m in mixed])
    back = np.flatnonzero(np.diff(stamps) < 0)
    for device in (declared(path, time="stamp"), sensorbook.load(path)):
        _, findings = device.check()
        told = next(f for f in findings if f.kind == "backward" and f.where == "gyroscope")
        assert told.message.startswith(f"the time goes back at {len(back)} places, first at ")
        assert told.remedy == "sort the rows by time"


def test_more_stamps_that_go_back_are_told_of_a_guessed_recording_too(tmp_path, rest):
    back = [replace(m, stamp=m.stamp - 25_000_000 * (k % 15 == 7)) for k, m in enumerate(rest)]
    bag_writers.mcap_ros2(tmp_path / "log.mcap", back)
    device = sensorbook.load(tmp_path / "log.mcap")
    assert device.gyroscope.static.declaration["columns"]["time"] == "stamp"
    assert device.gyroscope.static.rate == pytest.approx(100, rel=1e-3)
    _, findings = device.check()
    told = [f.message for f in findings if (f.kind, f.where) == ("backward", "gyroscope")]
    assert told == ["the time goes back at 27 places, first at 0.06 s by 0.015 s"]


def test_late_stamps_are_no_lost_samples(tmp_path, rest):
    """Every hundredth 30 ms late: the three after it stand aside, and are there."""
    late = [replace(m, stamp=m.stamp + 30_000_000 * (k % 100 == 50)) for k, m in enumerate(rest)]
    bag_writers.ros1(tmp_path / "log.bag", late)
    _, findings = declared(tmp_path / "log.bag", time="stamp").check()
    told = {f.kind: f.message for f in findings}
    assert told["backward"].startswith("the time goes back at 4 places, first at 0.53 s by 0.02 s")
    assert "gap" not in told


def test_stamps_that_spoil_the_time_base_are_mended_by_those_of_receipt(tmp_path):
    rest = [m for m in several(6000) if m.topic == "/imu/data"]
    late = [replace(m, stamp=m.stamp + 30_000_000 * (k % 100 == 50)) for k, m in enumerate(rest)]
    bag_writers.ros1(tmp_path / "log.bag", late)
    device = declared(tmp_path / "log.bag", time="stamp")
    mend = 'take the time of receipt, time = "received"'
    assert [f.remedy for f in device.check()[1] if f.kind == "backward"] == [mend]
    with pytest.raises(Refusal) as caught:
        device.gyroscope.static.evenly_sampled()
    assert caught.value.remedy == 'Take the time of receipt, time = "received".'
    whole, done = declared(tmp_path / "log.bag", time="received").gyroscope.static.evenly_sampled()
    assert (len(whole), done) == (6000, ())


def test_a_few_stamps_that_go_back_and_values_that_are_missing(tmp_path, rest):
    lost = {"angular_velocity": (float("nan"), 0.0, 0.0)}
    rest[7] = replace(rest[7], stamp=rest[3].stamp, fields=rest[7].fields | lost)
    bag_writers.mcap_ros2(tmp_path / "log.mcap", rest)
    _, findings = declared(tmp_path / "log.mcap", time="stamp").check()
    told = [(f.kind, f.message) for f in findings]
    assert ("backward", "the time goes back at 1 place, first at 0.06 s by 0.03 s") in told
    assert ("nan", "1 of 400 values missing (0.25 %)") in told


# ---- what cannot be read ----


def parsed(path, table=None):
    table = open_table(path, table=table)
    table.parse(range(len(table.names)))
    return table


def refused(path, table=None):
    with pytest.raises(InputError) as caught:
        parsed(path, table)
    assert len(caught.value.problems) == 1
    return str(caught.value)


DAMAGED = {
    "ros1": "log.dat: is a damaged ROS 1 bag, or one that was cut off — copy it again, "
            "or mend it with: rosbag reindex log.dat",
    "ros2-sqlite": "log.dat: is cut off — copy it again",
    "mcap-ros2": "log.dat: is a damaged MCAP file, or one that was cut off — copy it again, "
                 "or mend it with: mcap recover log.dat -o mended.mcap",
}  # fmt: skip


@pytest.mark.parametrize("form", DAMAGED)
def test_a_file_that_is_cut_off(tmp_path, rest, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, rest)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert refused(path) == DAMAGED[form]


@pytest.mark.parametrize("form", WRITERS)
def test_damage_is_refused_and_loses_no_row(tmp_path, rest, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, rest)
    whole, kinds = path.read_bytes(), []
    cuts = np.linspace(0, len(whole) - 1, 24).astype(int)
    for number in range(60):
        made = whole[: cuts[number]] if number < len(cuts) else None
        if made is None:
            rng = np.random.default_rng([5, number])
            made = mutant(whole, OPERATIONS[number % len(OPERATIONS)], rng).content
        path.write_bytes(made)
        try:
            for name in table_names(path):
                table = parsed(path, name)
                assert {len(table.column(k)) for k in range(len(table.names))} == {len(rest)}
            kinds.append("read")
        except InputError:
            kinds.append("refused")
    assert kinds[: len(cuts)] == ["refused"] * len(cuts)
    assert 0 < kinds.count("read") < 20


def test_a_recorder_that_was_cut_off(tmp_path, numbers, rest):
    path = tmp_path / "log.bag"
    bag_writers.ros1(path, rest)
    whole = bytearray(path.read_bytes())
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    whole[at : at + 8] = bytes(8)  # as its recorder leaves it until it is closed
    path.write_bytes(whole)
    assert refused(path) == (
        "log.bag: has no index: its recorder was cut off — mend it with: rosbag reindex log.bag"
    )
    path = tmp_path / "log.mcap"
    bag_writers.mcap_of_bytes(path, IMU, "cdr", payloads(numbers), use_statistics=False)
    assert refused(path) == (
        "log.mcap: holds no index of its topics — copy it again, "
        "or mend it with: mcap recover log.mcap -o mended.mcap"
    )


WANTED = "record a topic of sensor_msgs/Imu, sensor_msgs/MagneticField, sensor_msgs/Temperature"


@pytest.mark.parametrize(("kind", "encoding", "told"), [
    ("sensor_msgs/msg/Image", "cdr", "/imu (sensor_msgs/Image)"),
    ("sensor_msgs/msg/Imu", "json", "/imu (sensor_msgs/Imu as json)"),
])  # fmt: skip
def test_topics_of_no_sensor(tmp_path, kind, encoding, told):
    path = tmp_path / "log.mcap"
    bag_writers.mcap_of_bytes(path, kind, encoding, [b"{}"] * 5)
    assert refused(path) == f"log.mcap: holds no readings of a sensor: {told} — {WANTED}"
    held = told.removeprefix("/imu (").removesuffix(")")
    expected = f"log.mcap: table '/imu': holds {held}, which is not read — {WANTED}"
    assert refused(path, "/imu") == expected
    assert table_names(path) == ()
    with pytest.raises(InputError, match="holds no readings of a sensor"):
        sensorbook.load(path)


@pytest.mark.parametrize("form", WRITERS)
def test_an_empty_bag(tmp_path, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, [])
    assert refused(path) == f"log.dat: holds no readings of a sensor — {WANTED}"


def test_a_topic_on_which_nothing_was_published(tmp_path):
    store, kind = bag_writers.ROS2, "sensor_msgs/msg/Imu"
    folder = tmp_path / "drive"
    with rosbag2.Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.add_connection("/imu/data", kind, typestore=store)
        writer.add_connection("/odometry", "nav_msgs/msg/Odometry", typestore=store)
    path = folder / "drive.db3"
    mend = "record it while something publishes /imu/data"
    assert refused(path) == (
        "drive.db3: holds no readings of a sensor: /imu/data (sensor_msgs/Imu without a message), "
        f"/odometry (nav_msgs/Odometry without a message) — {mend}"
    )
    assert refused(path, "/imu/data") == f"drive.db3: table '/imu/data': holds no message — {mend}"
    assert (
        refused(path, "/odometry") == f"drive.db3: table '/odometry': holds no message — {WANTED}"
    )


def test_messages_that_are_not_what_their_type_says(tmp_path, numbers):
    path = tmp_path / "log.mcap"
    whole = payloads(numbers)
    as_cdr = "log.mcap: table '/imu', message 3: is no sensor_msgs/Imu in its cdr encoding"
    for wrong in (
        whole[2][:-1], whole[2] + b"\0", b"", whole[2][:16],
        b"\0\7" + whole[2][2:],  # version 2 of the encoding, with another alignment
        b"\0\0" + whole[2][2:],  # said to be big-endian
        whole[2][:12] + b"\xff\xff\xff\xff" + whole[2][16:],  # a name longer than the message
    ):  # fmt: skip
        bag_writers.mcap_of_bytes(path, IMU, "cdr", [*whole[:2], wrong, *whole[3:]])
        assert refused(path) == f"{as_cdr} — copy it again"
    bag_writers.mcap_of_bytes(path, IMU, "cdr", list(map(zstandard.compress, whole)))
    assert refused(path) == (
        "log.mcap: table '/imu', message 1: is compressed with zstd — "
        "rewrite the bag with: ros2 bag convert"
    )


def test_messages_that_are_missing_are_counted(tmp_path, rest):
    path = tmp_path / "log.mcap"
    bag_writers.mcap_ros2(path, rest, CompressionType.NONE)
    whole = bytearray(path.read_bytes())
    counted = (1).to_bytes(2, "little") + len(rest).to_bytes(8, "little")
    assert whole.count(counted) == 1
    path.write_bytes(whole.replace(counted, counted[:2] + (401).to_bytes(8, "little")))
    assert refused(path) == (
        "log.mcap: table '/imu/data': holds 400 messages, not the 401 that it counts: damaged — "
        "copy it again"
    )


def test_chunks_that_swell_or_are_compressed_otherwise(tmp_path, monkeypatch, rest):
    from sensorbook.recordings import bag_files, tables

    source, _ = tables.source_of(_written(tmp_path / "log.mcap", b"\x89MCAP0\r\n"), "log.mcap")
    monkeypatch.setattr(bag_files, "_BOMB", 1 << 20)
    swollen = bytes(3 << 20)
    for name, compress in (
        ("bz2", bz2.compress), ("lz4", lz4.frame.compress), ("zstd", zstandard.compress)
    ):  # fmt: skip
        assert bag_files._inflated(source, name, compress(b"as it was")) == b"as it was"
        with pytest.raises(InputError, match="holds chunks that inflate more than 150 times"):
            bag_files._inflated(source, name, compress(swollen))
    monkeypatch.setattr(bag_files, "_BOMB", 1 << 16)
    zeros = [imu((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))] * 2500
    bag_writers.ros1(tmp_path / "swollen.bag", zeros, "BZ2")
    bag_writers.mcap_ros2(tmp_path / "swollen.mcap", zeros)
    for name in ("swollen.bag", "swollen.mcap"):
        assert refused(tmp_path / name) == (
            f"{name}: holds chunks that inflate more than 150 times, as no recording does — "
            "look at what it holds, and save it uncompressed"
        )
    path = tmp_path / "other.mcap"
    bag_writers.mcap_ros2(path, rest, CompressionType.LZ4)
    path.write_bytes(path.read_bytes().replace(b"\3\0\0\0lz4", b"\3\0\0\0lzo"))
    assert refused(path) == (
        "other.mcap: holds chunks compressed with 'lzo' — "
        "write it again with zstd, lz4 or no compression"
    )
    path = tmp_path / "other.bag"
    bag_writers.ros1(path, rest, "LZ4")
    path.write_bytes(path.read_bytes().replace(b"compression=lz4", b"compression=lzo"))
    assert refused(path) == (
        "other.bag: cannot be read: Compression 'lzo' is not supported — "
        "write it again with rosbag, without compression"
    )


def _written(path, content):
    path.write_bytes(content)
    return path


def test_a_whole_file_in_zstd(tmp_path):
    path = _written(tmp_path / "log.db3.zstd", zstandard.compress(b"SQLite format 3\0" * 99))
    told = "log.db3.zstd: is compressed with zstd — inflate it first: zstd -d log.db3.zstd"
    assert refused(path) == told
    assert list(map(str, check(path)[0])) == [told]


def test_the_folder_of_a_bag_whose_file_is_in_zstd(tmp_path, rest):
    folder = tmp_path / "drive"
    bag_writers.ros2_folder(folder, rest)
    plain = folder / "drive.db3"
    packed = _written(folder / "drive.db3.zstd", zstandard.compress(plain.read_bytes()))
    assert len(sensorbook.load(folder).gyroscope.static) == len(rest)  # inflated beside it
    plain.unlink()
    told = f"is compressed with zstd — inflate it first: zstd -d {packed.name}"
    assert [str(p) for p in check(folder)[0]] == [f"{packed.name}: {told}"]


def test_rows_of_a_database_that_are_no_messages(tmp_path, rest):
    path = tmp_path / "log.db3"
    WRITERS["ros2-sqlite"](path, rest)
    for change in (
        "UPDATE messages SET data = 'text' WHERE id = 3",
        "UPDATE messages SET topic_id = 99 WHERE id = 3",
    ):
        with sqlite3.connect(path) as database:
            database.execute(change)
        assert refused(path).startswith("log.db3: is a damaged SQLite file")


@pytest.mark.parametrize(("form", "library", "what"), [
    ("ros1", "rosbags.rosbag1", "a ROS 1 bag"),
    ("mcap-ros2", "mcap.exceptions", "an MCAP file"),
])  # fmt: skip
def test_without_the_libraries_the_command_that_installs_them_is_told(
    tmp_path, monkeypatch, rest, form, library, what
):
    path = tmp_path / "log.dat"
    WRITERS[form](path, rest)
    monkeypatch.setitem(sys.modules, library, None)
    assert refused(path) == (
        f"log.dat: is {what}, which takes packages that are not installed — "
        "pip install sensorbook[ros]"
    )
    problems, _ = check(path)
    assert [p.mend for p in problems] == ["pip install sensorbook[ros]"]


def test_a_bag_in_sqlite_takes_no_library(tmp_path, monkeypatch, rest):
    path = tmp_path / "log.db3"
    WRITERS["ros2-sqlite"](path, rest)
    for library in ("rosbags", "rosbags.rosbag1", "mcap", "mcap.exceptions"):
        monkeypatch.setitem(sys.modules, library, None)
    assert len(open_table(path).column("stamp")) == len(rest)
