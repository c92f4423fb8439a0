"""NumPy archives (.npz): one-dimensional arrays by name, columns of two-dimensional ones as "name:0"."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, too_large

# What zipfile and numpy raise on damage: places before the file's beginning are an OSError.
_ERRORS = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError,
           RuntimeError, SyntaxError, tokenize.TokenError, struct.error, OverflowError,
           MemoryError)  # fmt: skip


def table_names(source: Source) -> tuple[str, ...]:
    """None: all arrays of an archive are one table."""
    return ()


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens an archive; `table` names the one array whose columns are then addressed by index."""
    file = source.file
    try:
        archive = zipfile.ZipFile(source.path)
        if not is_whole(source, archive):
            raise _damaged(file)
        shapes = {
            entry.filename.removesuffix(".npy"): _header(archive, entry)
            for entry in archive.infolist()
            if entry.filename.endswith(".npy")
        }
    except InputError:
        raise
    except _ERRORS:
        raise _damaged(file) from None
    if table is not None:
        if table not in shapes:
            raise InputError(
                Problem(file, f"table {table!r}", "there is no such array",
                        f"arrays: {', '.join(sorted(shapes)) or 'none'}")
            )  # fmt: skip
        shapes = {table: shapes[table]}
    places = [  # array and column of every column of the table
        (name, k)
        for name, (shape, *_) in shapes.items()
        for k in (
            [None] if len(shape) == 1 else range(min(shape[1], 1000)) if len(shape) == 2 else []
        )
    ]
    if not places:
        raise InputError(
            Problem(
                file, "", "holds no array of samples", "save one array a column with numpy.savez"
            )
        )

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        arrays, columns = {}, {}
        for index in indices:
            name, k = places[index]
            if name not in arrays:
                arrays[name] = _array(archive, name, shapes[name], file)
            columns[index] = arrays[name] if k is None else arrays[name][:, k]
        return columns

    names = tuple(
        name if k is None or shapes[name][0][1] == 1 else f"{name}:{k}" for name, k in places
    )
    return Table(file, names, read)


def is_whole(source: Source, archive: zipfile.ZipFile) -> bool:
    """False where the directory at the archive's end counts other members than it lists.

    zipfile does not look at the count, at bytes 10 and 11 of the last record (APPNOTE.TXT 6.3.10,
    4.3.16), and passes over members whose entry is damaged. It raises where a member's name does
    not stand before its content.
    """
    with source.path.open("rb") as stream:
        stream.seek(max(source.path.stat().st_size - (1 << 16) - 22, 0))
        tail = stream.read()
    at = tail.rfind(b"PK\x05\x06")
    count = int.from_bytes(tail[at + 10 : at + 12], "little")
    if at < 0 or count not in (len(archive.infolist()), 0xFFFF):  # 0xFFFF: counted elsewhere
        return False
    for entry in archive.infolist():
        archive.open(entry).close()
    return True


def _header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[tuple[int, ...], int, str]:
    """Shape, declared size in bytes and dtype of an array, without reading it."""
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(stream)
        held = entry.file_size - stream.tell()
    size = dtype.itemsize
    for length in shape:  # Python integers: a declared shape may overflow any fixed width
        size *= length
    # One longer than its member would be allocated before its absence is noticed, and of a shorter
    # one the check sum, which stands for the whole member, would not be looked at.
    if size != held and not dtype.hasobject and size <= MAX_BYTES:
        raise ValueError(f"{held} bytes of {size}")
    return shape, max(size, entry.file_size), dtype.str


def _array(archive: zipfile.ZipFile, name: str, header, file: str) -> np.ndarray:
    _, size, dtype = header
    where = f"array {name!r}"
    if size > MAX_BYTES:
        raise too_large(file, where)
    if np.dtype(dtype).kind not in "iufbMmUS":
        raise InputError(
            Problem(file, where, f"holds {np.dtype(dtype).name} values", "save plain numbers")
        )
    try:
        with archive.open(f"{name}.npy") as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
    except _ERRORS:
        raise _damaged(file) from None
    return array


def _damaged(file: str) -> InputError:
    return InputError(Problem(file, "", "is a damaged .npz archive", "save or copy it again"))
