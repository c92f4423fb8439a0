"""PX4's logs (ULog): a table a topic and instance, such as `sensor_accel` and `sensor_accel:1`.

The values come from pyulog (`pip install sensorbook[ulog]`). It passes over damage without a word and
takes what a log declares on trust; so the messages are walked through here first, by the PX4 Guide's
"ULog File Format", pyulog is given those of one topic, and must make as many rows of them.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import mmap
import re
import struct
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from string import ascii_letters

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, choose, too_large

_SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_SIZES = {"int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2,
          "int32_t": 4, "uint32_t": 4, "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8}  # fmt: skip
_FORMAT = re.compile(r"([\w/]+):([^:]*)", re.A)
_FIELD = re.compile(r"(\w+)(?:\[([1-9]\d{0,4})\])? (\w+)", re.A)
_LONGEST = 0xFFFF  # bytes of a message
_DATA = ord("D")
_KNOWN = b"ABCDFILMOPQRS"  # types of messages
_BLOCK = 1 << 14  # messages copied at one go
_DEEPEST = 16  # formats within formats
_MOST_FIELDS = 300_000  # of all topics; PX4 logs a few thousand

# Units as PX4's message definitions give them (msg/*.msg). delta_angle and delta_velocity are
# increments over delta_…_dt, no rates.
_UNITS = {
    "sensor_accel": {"x": "m/s^2", "y": "m/s^2", "z": "m/s^2"},
    "sensor_gyro": {"x": "rad/s", "y": "rad/s", "z": "rad/s"},
    "sensor_accel_fifo": {"x": "m/s^2", "y": "m/s^2", "z": "m/s^2"},
    "sensor_gyro_fifo": {"x": "rad/s", "y": "rad/s", "z": "rad/s"},
    "sensor_mag": {"x": "gauss", "y": "gauss", "z": "gauss"},
    "sensor_combined": {"gyro_rad": "rad/s", "accelerometer_m_s2": "m/s^2",
                        "magnetometer_ga": "gauss"},
    "vehicle_imu": {"delta_angle": "rad", "delta_velocity": "m/s", "delta_angle_dt": "us",
                    "delta_velocity_dt": "us"},
    "vehicle_angular_velocity": {"xyz": "rad/s"},
    "vehicle_acceleration": {"xyz": "m/s^2"},
    "vehicle_magnetometer": {"magnetometer_ga": "gauss"},
}  # fmt: skip
_UNITS_OF_ALL = {"timestamp": "us", "timestamp_sample": "us", "temperature": "degC"}
# As the sensors gave them; what PX4 makes of them is corrected and filtered in flight.
_RAW = ("sensor_accel", "sensor_gyro", "sensor_mag", "sensor_combined", "sensor_accel_fifo",
        "sensor_gyro_fifo", "vehicle_imu")  # fmt: skip
_WANTED = "log a topic such as sensor_accel, sensor_gyro or sensor_mag"
_FIFO_FIELDS = ("timestamp", "timestamp_sample", "x", "y", "z")


@dataclass(frozen=True, eq=False)
class _Topic:
    """A topic's instance.

    Attributes
    ----------
    fields : pairs of type and name, arrays spread out as "q[0]"
    subscribed : the message that begins it
    places : (N,) first bytes of its messages of data in the file
    """

    name: str
    instance: int
    fields: tuple[tuple[str, str], ...]
    subscribed: bytes
    places: np.ndarray

    @property
    def rows(self) -> int:
        return len(self.places)

    @property
    def shown(self) -> str:
        return f"{self.name}:{self.instance}" if self.instance else self.name

    @property
    def has_axes(self) -> bool:
        """True where x, y and z, or an array of three, are numbers with fractions or counts."""
        names = {name for kind, name in self.fields if kind not in ("char", "bool")}
        arrays = {name[:-3] for name in names if name.endswith("[2]")}
        return {"x", "y", "z"} <= names or any(f"{a}[3]" not in names for a in arrays)

    @property
    def burst(self) -> int:
        """Most samples of a message that holds several, as a sensor's FIFO gave them; else 0."""
        names = {name for _, name in self.fields}
        if not {"timestamp_sample", "dt", "scale", "samples", "x[0]", "y[0]", "z[0]"} <= names:
            return 0
        longest = [sum(name.startswith(f"{axis}[") for name in names) for axis in "xyz"]
        return longest[0] if len(set(longest)) == 1 else 0

    def unit(self, field: str) -> str:
        stem = field.partition("[")[0]
        return _UNITS.get(self.name, {}).get(stem, _UNITS_OF_ALL.get(stem, ""))


@dataclass(frozen=True, eq=False)
class _Log:
    """What the walk through a log found: topics by name, and how long each dropout was (ms).

    `data` is its first byte after the definitions, `unknown` the types of messages passed over.
    """

    topics: dict[str, _Topic]
    dropouts: tuple[int, ...]
    data: int
    unknown: str


def table_names(source: Source) -> tuple[str, ...]:
    """The topics of sensors, those with most samples first; without any, what has three axes."""
    return tuple(_sensors(_survey(source)))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens one topic's instance, such as "sensor_gyro" or "sensor_gyro:1"."""
    log = _survey(source)
    _library(source)
    sensors = _sensors(log)
    if table is None and not sensors:
        shown = ", ".join(sorted(log.topics)[:6])
        raise source.wrong(f"holds no readings of a sensor: {shown}", _WANTED)
    there = sensors if table is None else [*sensors, *sorted(log.topics.keys() - set(sensors))]
    topic = log.topics[choose(source, table, there, "topic")]
    burst = topic.burst
    fields = _FIFO_FIELDS if burst else [name for kind, name in topic.fields if kind != "char"]

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        data = _values(source, log, topic)
        data = _one_by_one(source, data, burst) if burst else data
        return {index: data[fields[index]] for index in indices}

    units = tuple(topic.unit(name) for name in fields)
    return Table(source.file, tuple(fields), read, units=units, losses=_losses(log))


def _sensors(log: _Log) -> list[str]:
    """Topics of sensors as read; where there are none, all that have three axes."""
    three = [topic for topic in log.topics.values() if topic.has_axes or topic.burst]
    raw = [topic for topic in three if topic.name in _RAW]
    # Some are logged once a second beside one that is logged in full.
    order = sorted(
        raw or three,
        key=lambda t: (-t.rows.bit_length(), t.name == "sensor_combined", t.name, t.instance),
    )
    return [topic.shown for topic in order]


def _losses(log: _Log) -> tuple[str, ...]:
    said = []
    if count := len(log.dropouts):
        times = "once" if count == 1 else f"{count} times"
        lost = sum(log.dropouts) / 1000
        said.append(f"its logger dropped messages {times}, for {lost:.3g} s in all")
    if count := len(log.unknown):
        types = ", ".join(sorted(set(log.unknown)))
        messages = "1 message" if count == 1 else f"{count} messages"
        said.append(f"{messages} of a type that is not known ({types}) passed over")
    return tuple(said)


def _library(source: Source):
    try:
        from pyulog import ULog
    except ImportError:
        raise source.wrong("is a PX4 ULog file, and pyulog, which reads it, is not installed",
                           "pip install sensorbook[ulog]") from None  # fmt: skip
    return ULog


def _values(source: Source, log: _Log, topic: _Topic) -> dict[str, np.ndarray]:
    """(N,) values of each field, by its name."""
    library = _library(source)
    try:
        # It says on the standard output what it thinks of a file.
        with contextlib.redirect_stdout(io.StringIO()):
            (found,) = library(_excerpt(source, log, topic)).data_list
        columns = {
            name: np.ascontiguousarray(values, values.dtype.newbyteorder("="))
            for name, values in found.data.items()
        }
    except Exception:  # whatever it raises, the file is what it stumbled over
        raise _damaged(source.wrong) from None
    if {len(values) for values in columns.values()} != {topic.rows}:
        raise _damaged(source.wrong)
    return columns


def _excerpt(source: Source, log: _Log, topic: _Topic) -> io.BytesIO:
    """The log with the data of one topic alone: pyulog takes each message in turn, wanted or not."""
    file = np.memmap(source.path, np.uint8, "r")
    out = io.BytesIO()
    out.write(file[: log.data].tobytes())
    out.write(topic.subscribed)
    # Padding at the end is left out, as it may be: pyulog takes it for damage.
    size = 2 + sum(_SIZES[kind] for kind, _ in topic.fields)
    head = np.frombuffer(struct.pack("<HB", size, _DATA), np.uint8)
    number = np.frombuffer(topic.subscribed[4:6], np.uint8)
    for first in range(0, topic.rows, _BLOCK):
        content = file[topic.places[first : first + _BLOCK, None] + np.arange(3, 3 + size)]
        content[:, :2] = number  # of the first subscription, where there are several
        out.write(np.hstack([np.tile(head, (len(content), 1)), content]).tobytes())
    out.seek(0)
    return out


def _one_by_one(source: Source, data: dict[str, np.ndarray], burst: int) -> dict[str, np.ndarray]:
    """The samples of bursts in the topic's unit, each with its stamp (µs, with fractions).

    A burst's stamp is its last sample's, those before it are `dt` µs apart, and a reading is
    count · `scale` (PX4, VehicleAcceleration.cpp and msg/SensorAccelFifo.msg).
    """
    samples = data["samples"].astype(np.int64)[:, None]
    if samples.max() > burst:
        raise _damaged(source.wrong)
    place = np.arange(burst)
    there = place < samples
    with np.errstate(over="ignore", invalid="ignore"):
        age = (samples - 1 - place) * data["dt"].astype(np.float64)[:, None]
        stamps = data["timestamp_sample"].astype(np.float64)[:, None] - age
        columns = {
            axis: (np.stack([data[f"{axis}[{k}]"] for k in place], axis=1)
                   * data["scale"].astype(np.float64)[:, None])[there]
            for axis in "xyz"
        }  # fmt: skip
    logged = np.broadcast_to(data["timestamp"][:, None], there.shape)[there]
    return {"timestamp": logged, "timestamp_sample": stamps[there], **columns}


# ---- the walk through a log ----


def _survey(source: Source) -> _Log:
    status = source.path.stat()
    if status.st_size > MAX_BYTES:
        raise too_large(source.file)
    return _surveyed(source.path, source.file, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=2)
def _surveyed(path: Path, file: str, size: int, changed: int) -> _Log:
    """Walks through all messages; a log that was not changed is not walked through again."""
    wrong = Source(path, file, b"", False).wrong
    if size < 16:
        raise _cut_off(wrong, 0)
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as view:
        log = _walk(view, min(size, len(view)), wrong)
    if not log.topics:
        raise wrong(
            "is a log without samples", "log the topics of its sensors, such as sensor_accel"
        )
    return log


def _walk(view: mmap.mmap, size: int, wrong) -> _Log:
    if view[7] > 1:
        raise wrong(f"is a ULog file of version {view[7]}, which is not known", "copy it again, or "
                    "save its topics as .csv with ulog2csv")  # fmt: skip
    begin, ends = _sections(view, size, wrong)
    formats: dict[str, list] = {}
    topics: dict[tuple[str, int], tuple] = {}  # name and instance: fields, message, places
    ids: dict[int, tuple[int, int, array]] = {}  # least and greatest size of a message, places
    dropouts, unknown, spread = [], bytearray(), 0
    head, word = struct.Struct("<HB").unpack_from, struct.Struct("<H").unpack_from
    data = 0  # where it begins
    at = begin
    for end in ends:
        while at < end:
            length, kind = head(view, at) if at + 3 <= end else (end, 0)
            stop = at + 3 + length
            if stop > end:
                if end == size:
                    raise _cut_off(wrong, at)
                break  # where power was lost; what was appended later follows
            if kind == _DATA:
                known = ids.get(word(view, at + 3)[0]) if length > 2 else None
                if known is None or not known[0] <= length <= known[1]:
                    raise _damaged(wrong, at)
                known[2].append(at)
            elif kind == 70 and not data:  # F, format
                name, fields = _format(view[at + 3 : stop], wrong, at)
                formats[name] = fields
            elif kind == 65:  # A, a topic is logged from here on
                data = data or at
                name, instance, number = _subscription(view[at + 3 : stop])
                fields, least, most = _fields(name, formats, wrong, at)
                spread += len(fields)
                if number in ids or spread > _MOST_FIELDS:
                    raise _damaged(wrong, at)
                # Added again under another number, it goes on.
                begun = topics.setdefault((name, instance), (fields, view[at:stop], array("q")))
                ids[number] = least, most, begun[2]
            elif kind == 79 and length == 2:  # O, a dropout
                dropouts.append(word(view, at + 3)[0])
            elif kind in b"LC":  # text
                data = data or at
            elif chr(kind) in ascii_letters and kind not in _KNOWN and length:
                # Of a newer logger, to be passed over (PX4 Guide); but for data with a damaged head.
                known = ids.get(word(view, at + 3)[0]) if length > 2 else None
                if known and known[0] <= length <= known[1]:
                    raise _damaged(wrong, at)
                unknown.append(kind)
            elif not (kind in b"IMPQR" and length) and not (
                kind == 83 and view[at + 3 : stop] == _SYNC
            ):
                raise _damaged(wrong, at)
            at = stop
        at = end
        ids = {}  # pyulog forgets them, too
    filled = [
        _Topic(*key, fields, begun, np.array(places))
        for key, (fields, begun, places) in topics.items()
        if places
    ]
    return _Log({topic.shown: topic for topic in filled}, tuple(dropouts), data, unknown.decode())


def _sections(view: mmap.mmap, size: int, wrong) -> tuple[int, list[int]]:
    """First byte after the header and its flags, and where each section ends: one may be appended."""
    if size < 19 or view[18] != 66:  # B, flags
        return 16, [size]
    length = int.from_bytes(view[16:18], "little")
    if 19 + length > size:
        raise _cut_off(wrong, 16)
    if length < 40:
        raise _damaged(wrong, 16)
    flags = view[27:35]
    if flags[0] & ~1 or any(flags[1:]):
        raise wrong("is a ULog file with extensions that are not known", "copy it again, or save its "
                    "topics as .csv with ulog2csv")  # fmt: skip
    offsets = [o for o in struct.unpack_from("<3Q", view, 35) if o] if flags[0] else []
    edges = [19 + length, *offsets, size]
    if any(a > b for a, b in itertools.pairwise(edges)):
        raise _damaged(wrong, 16)
    return 19 + length, edges[1:]


def _format(content: bytes, wrong, at: int) -> tuple[str, list]:
    """Name of a format, and its fields: type, length of the array or 0, name."""
    match = _FORMAT.fullmatch(content.decode("ascii", "replace"))
    fields = [_FIELD.fullmatch(f) for f in match[2].rstrip(";").split(";")] if match else [None]
    if not all(fields):
        raise _damaged(wrong, at)
    return match[1], [(f[1], int(f[2] or 0), f[3]) for f in fields]


def _subscription(content: bytes) -> tuple[str, int, int]:
    """Name, instance and number of a topic that is logged from here on; "" where it is damaged."""
    if len(content) < 4:
        return "", 0, 0
    return (
        content[3:].decode("ascii", "replace"),
        content[0],
        int.from_bytes(content[1:3], "little"),
    )


def _fields(name: str, formats: dict, wrong, at: int) -> tuple[tuple, int, int]:
    """A topic's fields, and the least and greatest size of its messages."""
    fields = _flat(name, formats, wrong, at)
    most = sum(_SIZES[kind] for kind, _ in fields) + 2
    while fields and fields[-1][1].startswith("_padding"):  # need not be written
        fields = fields[:-1]
    least = sum(_SIZES[kind] for kind, _ in fields) + 2
    names = [field for _, field in fields]
    if most > _LONGEST or len(set(names)) < len(names) or ("uint64_t", "timestamp") not in fields:
        raise _damaged(wrong, at)
    return tuple(fields), least, most


def _flat(name: str, formats: dict, wrong, at: int, depth: int = 0) -> list[tuple[str, str]]:
    """Pairs of type and name of a format's fields, arrays and formats within it spread out."""
    if name not in formats or depth > _DEEPEST:
        raise _damaged(wrong, at)
    flat: list[tuple[str, str]] = []
    for kind, count, field in formats[name]:
        inner = [(kind, "")] if kind in _SIZES else _flat(kind, formats, wrong, at, depth + 1)
        # Declared lengths are not trusted: no message holds more.
        if len(flat) + max(count, 1) * len(inner) > _LONGEST:
            raise _damaged(wrong, at)
        for place in [f"{field}[{k}]" for k in range(count)] if count else [field]:
            flat += [(t, f"{place}.{n}" if n else place) for t, n in inner]
    return flat


def _cut_off(wrong, at: int) -> InputError:
    if not at:
        return wrong("is cut off within its header", "copy it again")
    return wrong("is cut off: its last message breaks off",
                 f"copy it again, or keep its first {at} bytes, which are whole", f"byte {at}")  # fmt: skip


def _damaged(wrong, at: int = 0) -> InputError:
    if not at:
        return wrong("is a damaged ULog file", "copy it again")
    return wrong("is a damaged ULog file", f"copy it again, or keep its first {at} bytes, before the "
                 "damage", f"byte {at}")  # fmt: skip
