"""SQLite, as phone recorders write it: each sensor its own table and rate; and ROS 2's bags in it."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from urllib.parse import quote

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, choose, extended, too_large

_LONGEST = 120.0  # s that one query may take
_ROWS = 1 << 13  # fetched at one go
_BAG = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"topic_id", "timestamp", "data"},
}


def table_names(source: Source) -> tuple[str, ...]:
    """The tables; views and virtual tables are not read, since they can compute anything."""
    with closing(_connected(source)) as database:
        if not _is_bag(source, database):
            return _tables(source, database)
    from sensorbook.recordings import bags

    return bags.table_names(source)


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens one table of a database."""
    with closing(_connected(source)) as database:
        if is_bag := _is_bag(source, database):
            _check(source, database, "messages")
        else:
            name = choose(source, table, _tables(source, database), "table")
            _check(source, database, name)
            columns = _names(source, database, name)
    if is_bag:
        from sensorbook.recordings import bags

        return bags.open_table(source, table, wanted)

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        wanted = ", ".join(_quoted(columns[index]) for index in indices)
        held = {index: np.empty(0) for index in indices}
        with closing(_connected(source)) as database:
            # An index may hold all that is wanted, in an order of its own.
            cursor = _run(source, database, f"SELECT {wanted} FROM {_quoted(name)} NOT INDEXED")
            rows = 0
            while block := _fetch(source, cursor):
                rows += len(block)
                if rows * 8 * len(indices) > MAX_BYTES:
                    raise too_large(source.file, f"table {name!r}")
                for index, values in zip(indices, zip(*block, strict=True), strict=True):
                    held[index] = extended(held[index], _column(values))
        return held

    return Table(source.file, columns, read)


def blocks(source: Source, query: str) -> Iterator[list[tuple]]:
    """The rows that a query gives, some thousands at one go."""
    with closing(_connected(source)) as database:
        cursor = _run(source, database, query)
        while block := _fetch(source, cursor):
            yield block


def _is_bag(source: Source, database: sqlite3.Connection) -> bool:
    """True for a database as ROS 2's recorder writes it."""
    return all(columns <= set(_names(source, database, name)) for name, columns in _BAG.items())


def _check(source: Source, database: sqlite3.Connection, name: str) -> None:
    """Raises on damage in a table's tree of pages, which could lose rows or give them twice."""
    whole = _run(source, database, f"PRAGMA quick_check({_quoted(name)})")
    if _fetch(source, whole) != [("ok",)]:
        raise damaged(source)


def _names(source: Source, database: sqlite3.Connection, name: str) -> tuple[str, ...]:
    """Names of a table's columns."""
    return tuple(row[1] for row in _run(source, database, f"PRAGMA table_info({_quoted(name)})"))


def _column(values: Sequence) -> np.ndarray:
    """Numbers where all are; nulls are NaN; else whatever they are, for the reader to name the row."""
    kinds = set(map(type, values))
    if kinds == {int}:
        try:
            return np.array(values, dtype=np.int64)
        except OverflowError:
            return np.array(values, dtype=object)
    if kinds <= {int, float, type(None)}:
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    return np.array([v[:20].hex() if isinstance(v, bytes) else v for v in values], dtype=object)


def _tables(source: Source, database: sqlite3.Connection) -> tuple[str, ...]:
    # Virtual tables have no page; the locale is in every database of an Android phone.
    query = ("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
             " AND name NOT LIKE 'sqlite_%' AND name != 'android_metadata' ORDER BY name")  # fmt: skip
    names = [row[0] for row in _run(source, database, query) if isinstance(row[0], str)]
    filled = []
    for name in names[:1000]:
        if _run(source, database, f"SELECT 1 FROM {_quoted(name)} LIMIT 1").fetchone():
            filled.append(name)
    return tuple(filled)


def _connected(source: Source) -> sqlite3.Connection:
    for ending in ("-wal", "-journal"):
        beside = source.path.with_name(source.path.name + ending)
        if beside.is_file() and beside.stat().st_size > 32:
            raise source.wrong(f"was not closed by its recorder: {beside.name} holds more of it",
                               "open and close it once with sqlite3, or export it again")  # fmt: skip
    if int.from_bytes(source.head[16:18]) not in (1, *(1 << k for k in range(9, 16))):
        raise damaged(source)
    page = int.from_bytes(source.head[16:18])
    page = 65536 if page == 1 else page
    pages = int.from_bytes(source.head[28:32])
    size = source.path.stat().st_size
    if pages and size < pages * page:
        raise source.wrong("is cut off", "copy it again")
    # The count holds where it was made at the last change (SQLite Database File Format, 1.3.8).
    counted = pages and source.head[24:28] == source.head[92:96]
    if size % page or (counted and size != pages * page):
        raise damaged(source)
    path = quote(str(source.path.resolve()))
    try:
        # Immutable: no lock, no journal, nothing is written beside it.
        database = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA cell_size_check = ON")
        database.text_factory = lambda data: data.decode("utf-8", "replace")
    except sqlite3.Error:
        raise damaged(source) from None
    end = time.monotonic() + _LONGEST
    database.set_progress_handler(lambda: time.monotonic() > end, 100_000)
    return database


def _run(source: Source, database: sqlite3.Connection, query: str):
    try:
        return database.execute(query)
    except (sqlite3.Error, sqlite3.Warning, ValueError, OverflowError) as error:
        raise _failed(source, error) from None


def _fetch(source: Source, cursor) -> list[tuple]:
    try:
        return cursor.fetchmany(_ROWS)
    except (sqlite3.Error, ValueError, OverflowError) as error:
        raise _failed(source, error) from None


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _failed(source: Source, error: Exception) -> InputError:
    if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_INTERRUPT:
        return source.wrong(f"takes longer than {_LONGEST:g} s to read", "save the table as .csv")
    return damaged(source)


def damaged(source: Source) -> InputError:
    """What to raise where the file is not what SQLite or its recorder wrote."""
    return source.wrong("is a damaged SQLite file, or one that is cut off", "copy it again")
