"""MATLAB v5 to v7 through scipy; v7.3 is HDF5. Objects (tables, timetables) hold no plain arrays."""

from __future__ import annotations

import itertools
import math
import struct
import warnings
import zlib
from collections.abc import Iterator, Sequence

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.arrays import Place, Variable, places_of, tables_of
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, too_large

_OBJECTS = ("object", "opaque", "function")
_BATCH = 1 << 18  # values loaded at one go to learn what a file holds


def table_names(source: Source) -> tuple[str, ...]:
    """Matrices, structs and sets of equally long vectors."""
    return tuple(sorted(tables_of(_variables(source))))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a file; `table` names a variable or a struct, "imu/acc" a field of one.

    Of the file's variables those with columns asked for are held, one at a time: scipy reads a
    variable as a whole, be it a wide matrix or a struct.
    """
    places = places_of(source, tables_of(_variables(source)), table, "variable")

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        by_variable = itertools.groupby(indices, lambda index: _top(places[index]))
        for name, there in by_variable:
            arrays = _loaded(source, [name])
            for index in there:
                place = places[index]
                array = arrays[place.variable.path]
                column = array[place.column, :] if place.variable.is_row else array[:, place.column]
                # A view would keep all of a matrix.
                out[index] = np.array(
                    column,
                    dtype=column.dtype.newbyteorder("="),
                    copy=place.variable.width > 1 or None,
                )
            del arrays, array, column
        return out

    return Table(source.file, tuple(place.name for place in places), read)


def _top(place: Place) -> str:
    return place.variable.path.partition("/")[0]


def _variables(source: Source) -> list[Variable]:
    """Every array of real numbers in the file."""
    from scipy.io import whosmat

    _check_size(source)
    try:
        listed = whosmat(source.path)
    except Exception:  # scipy raises whatever its parser stumbles over
        raise _damaged(source) from None
    found: list[Variable] = []
    batch: list[str] = []
    values = 0
    for name, shape, kind in listed:
        if kind in _OBJECTS:
            continue
        batch.append(name)
        # A struct's size is not told: it is loaded alone.
        values += _BATCH if kind in ("struct", "cell") else math.prod(map(int, shape))
        if values >= _BATCH:
            found += _described(source, batch)
            batch, values = [], 0
    found += _described(source, batch)
    objects = [name for name, _, kind in listed if kind in _OBJECTS]
    if not found and objects:
        what = ", ".join(repr(name) for name in objects if name and name != "None")
        raise source.wrong(f"holds MATLAB objects only{f' ({what})' if what else ''}, such as tables",
                           "save the columns as plain variables, or use writetable")  # fmt: skip
    return found


def _described(source: Source, names: Sequence[str]) -> list[Variable]:
    arrays = _loaded(source, names) if names else {}
    return [Variable(path, a.shape, a.itemsize) for path, a in arrays.items()]


def _loaded(source: Source, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays of real numbers in these variables, by path."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            held = loadmat(
                source.path, variable_names=list(names), verify_compressed_data_integrity=True
            )
    except Exception:  # scipy raises whatever its parser stumbles over
        raise _damaged(source) from None
    return {path: array for name in names for path, array in _arrays(held.get(name), name)}


def _arrays(value, path: str, depth: int = 0) -> Iterator[tuple[str, np.ndarray]]:
    if not isinstance(value, np.ndarray) or depth > 8:
        return
    if value.dtype.names and value.size == 1:
        for name in value.dtype.names:
            yield from _arrays(value[name].flat[0], f"{path}/{name}", depth + 1)
    elif value.dtype.kind in "iuf" and value.ndim == 2:
        yield path, value


def _damaged(source: Source) -> InputError:
    return source.wrong("is a damaged MATLAB file, or one that is cut off", "save or copy it again")


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
                            total += len(inflate.decompress(chunk, 1 << 20))
                        except zlib.error:
                            return  # what reads it will say that it is damaged
                        chunk = inflate.unconsumed_tail
                        if total > MAX_BYTES:
                            raise too_large(source.file)
            at += 8 + length
