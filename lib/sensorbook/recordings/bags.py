"""ROS 1 bags, ROS 2 bags (SQLite) and MCAP: a topic of sensors is a table, its messages the rows.

Rows stand in the order in which they were received; nothing is sorted by the stamps in the messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.bag_files import ZSTD, Topic, messages, topics
from sensorbook.recordings.ros_messages import ENCODINGS, LAYOUTS, LayoutError, decode
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, choose, extended, too_large

_ROWS = 1 << 13  # messages decoded at one go
_NOT_GIVEN = (
    "a covariance that begins with −1 says that none is given, 0 that it is not known (REP 145)"
)
_WANTED = f"record a topic of {', '.join(LAYOUTS)}"


def table_names(source: Source) -> tuple[str, ...]:
    """The topics with readings of a sensor."""
    return tuple(topic.name for topic in topics(source) if _is_readable(topic))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens one topic; its columns are named as the message's fields are.

    `stamp` is the header's, `received` the recorder's own, both int64 in ns.
    """
    topic = _chosen(source, table)
    layout = LAYOUTS[topic.type]
    columns = partial(_columns, source, topic)
    missing = _NOT_GIVEN if any(f.covariance is not None for f in layout.fields) else ""
    return Table(source.file, layout.names, columns, units=layout.units, missing=missing)


def storage_file(folder: Path) -> Path | None:
    """The recording in the folder of a ROS 2 bag; None where it is no such folder.

    Raises `InputError` where it holds none, or several, which are recordings of their own.
    """
    if not (folder / "metadata.yaml").is_file():
        return None
    there = sorted(p for p in folder.iterdir() if p.is_file())
    files = [p for p in there if p.suffix in (".db3", ".mcap")]
    # Compressed as whole files: what to do with one is told where it is opened.
    files = files or [p for p in there if p.name.endswith((".db3.zstd", ".mcap.zstd"))]
    if len(files) == 1:
        return files[0]
    what = f"is a ROS 2 bag of {len(files)} files" if files else "holds no .db3 or .mcap file"
    mend = f"name one, such as {files[0]}" if files else "name the recording itself"
    raise InputError(Problem(str(folder), "", what, mend))


def _is_readable(topic: Topic) -> bool:
    """True where it holds readings of a sensor that can be decoded."""
    return topic.type in LAYOUTS and topic.encoding in ENCODINGS and topic.count > 0


def _chosen(source: Source, table: str | None) -> Topic:
    found = {topic.name: topic for topic in topics(source)}
    there = sorted(name for name, topic in found.items() if _is_readable(topic))
    if table in found and table not in there:
        topic = found[table]
        what = f"holds {_told(topic)}, which is not read" if topic.count else "holds no message"
        mend = f"name one of {', '.join(map(repr, there[:12]))}" if there else _mend([topic])
        raise source.wrong(what, mend, f"table {table!r}")
    if not there:
        others = ", ".join(f"{t.name[:40]} ({_told(t)})" for t in [*found.values()][:6])
        what = "holds no readings of a sensor"
        raise source.wrong(f"{what}: {others}" if others else what, _mend(found.values()))
    return found[choose(source, table, there, "topic")]


def _mend(found: Iterable[Topic]) -> str:
    """What to record where none of these topics can be read."""
    silent = [t.name[:40] for t in found if t.type in LAYOUTS and not t.count]
    return f"record it while something publishes {silent[0]}" if silent else _WANTED


def _told(topic: Topic) -> str:
    """Type of its messages, and their encoding or their absence where that is why they are not read."""
    kind = topic.type[:80] or "no type"
    if not topic.count:
        return f"{kind} without a message"
    return f"{kind} as {topic.encoding[:20]}" if topic.type in LAYOUTS else kind


def _columns(source: Source, topic: Topic, indices: Sequence[int]) -> dict[int, np.ndarray]:
    layout = LAYOUTS[topic.type]
    held = {index: np.empty(0) for index in indices}
    rows = 0
    stream = messages(source, topic)
    while block := list(islice(stream, _ROWS)):
        if (rows + len(block)) * 8 * len(indices) > MAX_BYTES:
            raise too_large(source.file, f"table {topic.name!r}")
        received, payloads = zip(*block, strict=True)
        try:
            columns = decode(layout, topic.encoding, payloads)
        except LayoutError as error:
            what, mend = f"is no {topic.type} in its {topic.encoding} encoding", "copy it again"
            if payloads[error.row].startswith(ZSTD):
                what, mend = "is compressed with zstd", "rewrite the bag with: ros2 bag convert"
            where = f"table {topic.name!r}, message {rows + error.row + 1}"
            raise source.wrong(what, mend, where) from None
        try:
            columns.append(np.array(received, dtype=np.int64))
        except OverflowError:
            raise source.wrong(
                "holds times of receipt after the year 2262", "copy it again"
            ) from None
        for index in indices:
            held[index] = extended(held[index], columns[index])
        rows += len(block)
    if rows != topic.count:
        raise source.wrong(f"holds {rows} messages, not the {topic.count} that it counts: damaged",
                           "copy it again", f"table {topic.name!r}")  # fmt: skip
    return held
