"""Bags as independent libraries write them: rosbags, and mcap with its own encoders of ROS messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mcap.writer
import numpy as np
from mcap.writer import CompressionType
from mcap_ros1._vendor.genpy.dynamic import generate_dynamic
from mcap_ros1.writer import Writer as McapRos1
from mcap_ros2.writer import Writer as McapRos2
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

SECOND = 1_000_000_000
BEGIN = 1_700_000_000 * SECOND
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


@dataclass(frozen=True)
class Sent:
    """A message: stamp and time of receipt in ns, and the fields beside its header.

    A field of three or four numbers is a vector or quaternion; of nine, a covariance.
    """

    topic: str
    type: str
    stamp: int
    received: int
    fields: dict[str, float | Sequence[float]]
    frame: str = "imu_link"


def imu(
    gyro, force, *, topic="/imu/data", stamp=BEGIN, received=None, attitude=None, **more
) -> Sent:
    """An Imu message; without `attitude` (x y z w) it says that it gives none."""
    fields = {
        "orientation": (0.0, 0.0, 0.0, 0.0) if attitude is None else attitude,
        "orientation_covariance": (-1.0 if attitude is None else 1e-4,) + (0.0,) * 8,
        "angular_velocity": gyro,
        "angular_velocity_covariance": (0.0,) * 9,
        "linear_acceleration": force,
        "linear_acceleration_covariance": (0.0,) * 9,
    }
    received = stamp + 2_000_000 if received is None else received
    return Sent(topic, "sensor_msgs/msg/Imu", stamp, received, fields, **more)


def field(values, *, topic="/imu/mag", stamp=BEGIN, **more) -> Sent:
    """A MagneticField message."""
    fields = {"magnetic_field": values, "magnetic_field_covariance": (0.0,) * 9}
    return Sent(topic, "sensor_msgs/msg/MagneticField", stamp, stamp + 2_000_000, fields, **more)


def temperature(value, *, topic="/imu/temperature", stamp=BEGIN, **more) -> Sent:
    """A Temperature message."""
    fields = {"temperature": value, "variance": 0.0}
    return Sent(topic, "sensor_msgs/msg/Temperature", stamp, stamp + 2_000_000, fields, **more)


# ---- rosbags ----


def of_rosbags(store, sent: Sent):
    """The message as an object of a rosbags type store."""

    def built(value):
        if isinstance(value, float):
            return value
        if len(value) == 9:
            return np.array(value)
        name = "Vector3" if len(value) == 3 else "Quaternion"
        return store.types[f"geometry_msgs/msg/{name}"](*map(float, value))

    time = store.types["builtin_interfaces/msg/Time"](*divmod(sent.stamp, SECOND))
    more = {"seq": 7} if store is ROS1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=time, frame_id=sent.frame, **more)
    fields = {name: built(value) for name, value in sent.fields.items()}
    return store.types[sent.type](header=header, **fields)


def ros1(path: Path, messages: Sequence[Sent], compression: str = "") -> None:
    """A ROS 1 bag."""
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        there = {m.topic: m.type for m in messages}
        topics = {t: writer.add_connection(t, kind, typestore=ROS1) for t, kind in there.items()}
        for m in messages:
            data = ROS1.serialize_ros1(of_rosbags(ROS1, m), m.type)
            writer.write(topics[m.topic], m.received, data)


def ros2_folder(folder: Path, messages: Sequence[Sent], storage=StoragePlugin.SQLITE3) -> None:
    """The folder of a ROS 2 bag."""
    with rosbag2.Writer(folder, version=9, storage_plugin=storage) as writer:
        there = {m.topic: m.type for m in messages}
        topics = {t: writer.add_connection(t, kind, typestore=ROS2) for t, kind in there.items()}
        for m in messages:
            data = ROS2.serialize_cdr(of_rosbags(ROS2, m), m.type)
            writer.write(topics[m.topic], m.received, data)


def _ros2_file(storage, ending: str) -> Callable[[Path, Sequence[Sent]], None]:
    def write(path: Path, messages: Sequence[Sent]) -> None:
        folder = path.with_name(f"{path.name}.folder")
        ros2_folder(folder, messages, storage)
        (folder / f"{folder.name}{ending}").rename(path)

    return write


# ---- mcap ----


def _plain(sent: Sent) -> dict:
    """A message as a dictionary."""
    seconds, rest = divmod(sent.stamp, SECOND)
    fields = {
        name: dict(zip("xyzw", map(float, value), strict=False))
        if not isinstance(value, float) and len(value) < 9
        else value
        for name, value in sent.fields.items()
    }
    header = {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": sent.frame}
    return {"header": header, **fields}


def mcap_ros1(
    path: Path, messages: Sequence[Sent], compression=CompressionType.ZSTD, chunk=1 << 20
):
    """An MCAP file of messages as ROS 1 encodes them."""
    types = {}
    with path.open("wb") as stream, McapRos1(stream, chunk, compression) as writer:
        for m in messages:
            kind = m.type.replace("/msg/", "/")
            if kind not in types:
                text, _ = ROS1.generate_msgdef(m.type, ros_version=1)
                types[kind] = generate_dynamic(kind, text)
            made = types[kind][kind]()
            made.header.stamp.secs, made.header.stamp.nsecs = divmod(m.stamp, SECOND)
            made.header.frame_id = m.frame
            for name, value in _plain(m).items():
                if isinstance(value, dict) and name != "header":
                    for axis, number in value.items():
                        setattr(getattr(made, name), axis, number)
                elif name != "header":
                    setattr(made, name, value)
            writer.write_message(m.topic, made, log_time=m.received)


def mcap_ros2(
    path: Path, messages: Sequence[Sent], compression=CompressionType.ZSTD, chunk=1 << 20
):
    """An MCAP file of messages in CDR."""
    schemas = {}
    with path.open("wb") as stream, McapRos2(stream, chunk, compression) as writer:
        for m in messages:
            if m.type not in schemas:
                text, _ = ROS2.generate_msgdef(m.type, ros_version=2)
                schemas[m.type] = writer.register_msgdef(m.type, text)
            writer.write_message(m.topic, schemas[m.type], _plain(m), log_time=m.received)


def mcap_of_bytes(
    path: Path, kind: str, encoding: str, payloads: Sequence[bytes], **options
) -> None:
    """An MCAP file of one topic, "/imu", of any type, encoding and content."""
    with path.open("wb") as stream:
        writer = mcap.writer.Writer(stream, **options)
        writer.start()
        schema = writer.register_schema(kind, "ros2msg", b"")
        channel = writer.register_channel("/imu", encoding, schema)
        for k, payload in enumerate(payloads):
            writer.add_message(channel, BEGIN + k, payload, BEGIN + k)
        writer.finish()


WRITERS = {
    "ros1": ros1,
    "ros2-sqlite": _ros2_file(StoragePlugin.SQLITE3, ".db3"),
    "ros2-mcap": _ros2_file(StoragePlugin.MCAP, ".mcap"),
    "mcap-ros1": mcap_ros1,
    "mcap-ros2": mcap_ros2,
}
