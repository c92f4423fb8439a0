"""The containers of ROS messages: which topics a file holds, and their messages as bytes.

`topics(source)` and `messages(source, topic)` choose by content: ROS 1 bags through rosbags, MCAP
through mcap, ROS 2 bags in SQLite through SQLite itself.
"""

from __future__ import annotations

import bz2
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import BinaryIO

from sensorbook.errors import InputError
from sensorbook.recordings import sqlite
from sensorbook.recordings.tables import Source

ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of a frame (RFC 8878)

_DENSEST = 150  # times that a chunk may inflate …
_BOMB = 64 << 20  # … where it holds more than so many bytes
_FOOTER = 9 + 20 + 8  # bytes at the end of MCAP: the footer's head and content, and the magic
# What the libraries raise on damage: asserted, unpacked, looked up, decoded, allocated.
_ERRORS = (ValueError, AssertionError, LookupError, TypeError, AttributeError, struct.error, OSError,
           EOFError, RuntimeError, OverflowError, MemoryError)  # fmt: skip


@dataclass(frozen=True)
class Topic:
    """A topic of a file.

    Attributes
    ----------
    name : such as "/imu/data"
    type : of its messages, spelled as in ROS 1: "sensor_msgs/Imu"
    encoding : of its messages: "ros1", "cdr" or another
    count : of its messages
    ids : of its publishers in the file
    """

    name: str
    type: str
    encoding: str
    count: int
    ids: tuple[int, ...]


def topics(source: Source) -> list[Topic]:
    """Those of a file, once each: where its publishers differ, the type names both."""
    found: dict[str, Topic] = {}
    for topic in _reader(source)[0](source):
        topic = replace(topic, type=topic.type.replace("/msg/", "/"))
        if other := found.get(topic.name):
            same = (other.type, other.encoding) == (topic.type, topic.encoding)
            topic = replace(topic, count=other.count + topic.count, ids=other.ids + topic.ids,
                            type=topic.type if same else f"{other.type} and {topic.type}")  # fmt: skip
        found[topic.name] = topic
    return list(found.values())


def messages(source: Source, topic: Topic) -> Iterator[tuple[int, bytes]]:
    """Time of receipt (ns) and bytes of each message, in the file's order, which is that of receipt."""
    return _reader(source)[1](source, topic)


def _reader(source: Source):
    if source.head.startswith(b"#ROSBAG"):
        return _topics_of_bag, _messages_of_bag
    if source.head.startswith(b"\x89MCAP"):
        return _topics_of_mcap, _messages_of_mcap
    if source.head.startswith(ZSTD):
        raise source.wrong("is compressed with zstd", f"inflate it first: zstd -d {source.file}")
    return _topics_of_database, _messages_of_database


# ---- ROS 1 bags ----


@contextmanager
def _bag(source: Source):
    """A `rosbags` reader of the file; what it raises is told in one line."""
    try:
        from rosbags.rosbag1 import Reader, ReaderError
    except ImportError:
        raise _missing(source, "a ROS 1 bag") from None
    try:
        with Reader(source.path) as reader:
            yield reader
    except InputError:
        raise
    except (*_ERRORS, ReaderError) as error:
        reason = str(error) if isinstance(error, ReaderError) else ""
        reindex = f"mend it with: rosbag reindex {source.file}"
        if "not indexed" in reason:
            raise source.wrong("has no index: its recorder was cut off", reindex) from None
        if "not supported" in reason:
            mend = "write it again with rosbag, without compression"
            raise source.wrong(f"cannot be read: {reason[:80].rstrip('.')}", mend) from None
        what = "is a damaged ROS 1 bag, or one that was cut off"
        raise source.wrong(what, f"copy it again, or {reindex}") from None


def _topics_of_bag(source: Source) -> list[Topic]:
    with _bag(source) as reader:
        counted = sum(sum(info.connection_counts.values()) for info in reader.chunk_infos)
        if counted != sum(c.msgcount for c in reader.connections):
            raise AssertionError  # part of the index is lost
        return [Topic(c.topic, c.msgtype, "ros1", c.msgcount, (c.id,)) for c in reader.connections]


def _messages_of_bag(source: Source, topic: Topic) -> Iterator[tuple[int, bytes]]:
    with _bag(source) as reader:
        import lz4.frame

        # Its own would inflate whatever a chunk says.
        names = {bz2.decompress: "bz2", lz4.frame.decompress: "lz4"}
        for at, chunk in reader.chunks.items():
            inflate = partial(_inflated, source, names.get(chunk.decompressor, "none"))
            reader.chunks[at] = chunk._replace(decompressor=inflate)
        # In the order of the file: by time, chunks that overlap would be inflated again and again.
        entries = [entry for mine in topic.ids for entry in reader.indexes[mine]]
        entries.sort(key=lambda entry: (entry.chunk_pos, entry.offset))
        first = next(c for c in reader.connections if c.id in topic.ids)
        reader.indexes = {first.id: entries}
        for connection, received, data in reader.messages([first]):
            if connection.id not in topic.ids:
                raise AssertionError
            yield received, data


# ---- MCAP ----


@contextmanager
def _mcap(source: Source):
    """The file, open; what the `mcap` library raises on it is told in one line."""
    try:
        from mcap.exceptions import McapError
    except ImportError:
        raise _missing(source, "an MCAP file") from None
    try:
        with source.open() as stream:
            yield stream
    except InputError:
        raise
    except (*_ERRORS, McapError):
        raise source.wrong(
            "is a damaged MCAP file, or one that was cut off", _recover(source)
        ) from None


def _topics_of_mcap(source: Source) -> list[Topic]:
    with _mcap(source) as stream:
        from mcap.records import Channel, Footer, Schema, Statistics

        stream.seek(-_FOOTER, os.SEEK_END)
        footer = next(_records(source, stream, skip_magic=True))
        if not isinstance(footer, Footer):
            raise ValueError
        stream.seek(footer.summary_start)  # 0 for none
        summary = _records(source, stream, skip_magic=True) if footer.summary_start else ()
        records = [r for r in summary if isinstance(r, Schema | Channel | Statistics)]
        types = {0: ""} | {r.id: r.name for r in records if isinstance(r, Schema)}
        channels = [r for r in records if isinstance(r, Channel)]
        counted = [r for r in records if isinstance(r, Statistics)]
        if not counted or counted[0].channel_count != len(channels):
            raise source.wrong("holds no index of its topics", _recover(source))
        counts = counted[0].channel_message_counts
        return [
            Topic(c.topic, types[c.schema_id], c.message_encoding, counts.get(c.id, 0), (c.id,))
            for c in channels
        ]


def _records(source: Source, stream: BinaryIO, **options) -> Iterator:
    """The records from where the stream stands; chunks as they are."""
    from mcap.stream_reader import StreamReader

    # No record is larger than its file, whatever it says.
    size = source.path.stat().st_size
    return StreamReader(stream, emit_chunks=True, record_size_limit=size, **options).records


def _messages_of_mcap(source: Source, topic: Topic) -> Iterator[tuple[int, bytes]]:
    with _mcap(source) as stream:
        from mcap.records import Chunk, Message
        from mcap.stream_reader import breakup_chunk

        for record in _records(source, stream, validate_crcs=True):
            parts = [record]
            if isinstance(record, Chunk):
                data = _inflated(source, record.compression or "none", record.data)
                if len(data) != record.uncompressed_size:
                    raise ValueError
                parts = breakup_chunk(replace(record, compression="", data=data), validate_crc=True)
            for part in parts:
                if isinstance(part, Message) and part.channel_id in topic.ids:
                    yield part.log_time, part.data


def _recover(source: Source) -> str:
    return f"copy it again, or mend it with: mcap recover {source.file} -o mended.mcap"


# ---- ROS 2 bags in SQLite ----


def _topics_of_database(source: Source) -> list[Topic]:
    def rows(query: str) -> list[tuple]:
        return [row for block in sqlite.blocks(source, query) for row in block]

    counts = dict(rows("SELECT topic_id, COUNT(*) FROM messages NOT INDEXED GROUP BY topic_id"))
    found = rows("SELECT id, name, type, serialization_format FROM topics")
    if any(list(map(type, row)) != [int, str, str, str] for row in found):
        raise sqlite.damaged(source)
    if not counts.keys() <= {row[0] for row in found}:
        raise sqlite.damaged(source)
    return [Topic(name, kind, form, counts.get(k, 0), (k,)) for k, name, kind, form in found]


def _messages_of_database(source: Source, topic: Topic) -> Iterator[tuple[int, bytes]]:
    mine = ", ".join(map(str, topic.ids))
    query = f"SELECT timestamp, data FROM messages NOT INDEXED WHERE topic_id IN ({mine})"
    for block in sqlite.blocks(source, query):
        for received, data in block:
            if type(received) is not int or type(data) is not bytes:
                raise sqlite.damaged(source)
            yield received, data


# ---- what they share ----


def _missing(source: Source, what: str) -> InputError:
    return source.wrong(f"is {what}, which takes packages that are not installed",
                        "pip install sensorbook[ros]")  # fmt: skip


def _inflated(source: Source, compression: str, data: bytes) -> bytes:
    """A chunk's content; raises `InputError` where it is compressed otherwise, or swells."""
    if compression == "none":
        return data
    most = max(_BOMB, _DENSEST * len(data))
    if compression == "bz2":
        whole = bz2.BZ2Decompressor().decompress(data, max_length=most + 1)
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        whole = LZ4FrameDecompressor().decompress(data, max_length=most + 1)
    elif compression == "zstd":
        from zstandard import ZstdDecompressor, ZstdError

        try:
            with ZstdDecompressor().stream_reader(data) as stream:
                whole = stream.read(most + 1)
        except ZstdError:
            raise ValueError from None
    else:
        raise source.wrong(f"holds chunks compressed with {compression[:40]!r}",
                           "write it again with zstd, lz4 or no compression")  # fmt: skip
    if len(whole) > most:
        raise source.wrong(f"holds chunks that inflate more than {_DENSEST} times, as no recording does",
                           "look at what it holds, and save it uncompressed")  # fmt: skip
    return whole
