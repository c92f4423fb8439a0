"""MATLAB v5 to v7 through scipy; v7.3 is HDF5. Objects (tables, timetables) hold no plain arrays."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Sequence

import numpy as np

from sensorbook.recordings.arrays import Variable, places_of, tables_of
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, too_large

_OBJECTS = ("object", "opaque", "function")


def table_names(source: Source) -> tuple[str, ...]:
    """Matrices, structs and sets of equally long vectors."""
    return tuple(sorted(tables_of(_variables(source)[0])))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a file; `table` names a variable or a struct, "imu/acc" a field of one."""
    variables, arrays = _variables(source)
    places = places_of(source, tables_of(variables), table, "variable")

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        for index in indices:
            place = places[index]
            array = arrays[place.variable.path]
            if place.column is None:
                column = array
            else:
                column = array[place.column, :] if place.variable.is_row else array[:, place.column]
            out[index] = np.ascontiguousarray(column, dtype=column.dtype.newbyteorder("="))
        return out

    return Table(source.file, tuple(place.name for place in places), read)


def _variables(source: Source) -> tuple[list[Variable], dict[str, np.ndarray]]:
    """Every array of real numbers in the file, and the arrays by path."""
    from scipy.io import loadmat, whosmat

    _check_size(source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            listed = whosmat(source.path)
            names = [name for name, _, kind in listed if kind not in _OBJECTS]
            objects = [name for name, _, kind in listed if kind in _OBJECTS]
            held = loadmat(source.path, variable_names=names, verify_compressed_data_integrity=True)
    except Exception:  # scipy raises whatever its parser stumbles over
        raise source.wrong("is a damaged MATLAB file, or one that is cut off",
                           "save or copy it again") from None  # fmt: skip
    arrays: dict[str, np.ndarray] = {}

    def take(value, path: str, depth: int) -> None:
        if not isinstance(value, np.ndarray) or depth > 8:
            return
        if value.dtype.names and value.size == 1:
            for name in value.dtype.names:
                take(value[name].flat[0], f"{path}/{name}", depth + 1)
        elif value.dtype.kind in "iuf" and value.ndim == 2:
            arrays[path] = value

    for name in names:
        take(held.get(name), name, 0)
    if not arrays and objects:
        what = ", ".join(repr(name) for name in objects if name and name != "None")
        raise source.wrong(f"holds MATLAB objects only{f' ({what})' if what else ''}, such as tables",
                           "save the columns as plain variables, or use writetable")  # fmt: skip
    return [Variable(path, a.shape, a.itemsize) for path, a in arrays.items()], arrays


def _check_size(source: Source) -> None:
    """Raises where compressed variables would inflate beyond all measure, or the file is cut.

    A file is a header of 128 bytes and elements, each with its type and size in bytes (MATLAB's
    MAT-File Format, 2022, 1-5); type 15 is compressed.
    """
    total, size = 0, source.path.stat().st_size
    order = "<" if source.head[126:128] == b"IM" else ">"
    with source.path.open("rb") as stream:
        at = 128
        while at + 8 <= size:
            stream.seek(at)
            kind, length = struct.unpack(f"{order}II", stream.read(8))
            if at + 8 + length > size:
                raise source.wrong("is cut off", "copy it again")
            if kind == 15:
                inflate, left = zlib.decompressobj(), length
                while left > 0 and not inflate.eof:
                    chunk = stream.read(min(left, 1 << 20))
                    left -= len(chunk)
                    while chunk:
                        try:
                            total += len(inflate.decompress(chunk, 1 << 24))
                        except zlib.error:
                            return  # what reads it will say that it is damaged
                        chunk = inflate.unconsumed_tail
                        if total > MAX_BYTES:
                            raise too_large(source.file)
            at += 8 + length
