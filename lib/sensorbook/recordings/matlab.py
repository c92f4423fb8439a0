"""MATLAB v5 to v7 through scipy; v7.3 is HDF5. Objects (tables, timetables) hold no plain arrays."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from sensorbook.recordings.arrays import Place, Variable, objects_only, places_of, tables_of
from sensorbook.recordings.mat5 import check_elements, damaged
from sensorbook.recordings.tables import MAX_BYTES, Source, Table

_OBJECTS = ("object", "opaque", "function")
_NO_COLUMNS = ("char", "logical", "cell", "sparse")
_BATCH = 1 << 18  # values loaded at one go to learn what a file holds


def table_names(source: Source) -> tuple[str, ...]:
    """Matrices, structs and sets of equally long vectors."""
    return tuple(sorted(tables_of(_variables(source))))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a file; `table` names a variable or a struct, "imu/acc" a field of one.

    Of the file's variables those with columns asked for are held, one at a time: scipy reads a
    variable as a whole, be it a wide matrix or a struct.
    """
    places = places_of(source, _variables(source), table, wanted)

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        by_variable = itertools.groupby(indices, lambda index: _top(places[index]))
        for name, there in by_variable:
            arrays, there = _loaded(source, [name]), list(there)
            for index in there:
                place = places[index]
                place.check(source)
                array = arrays[place.variable.path]
                column = array[place.column, :] if place.variable.is_row else array[:, place.column]
                # A view keeps all of a matrix, which is too much where few of its columns are read.
                out[index] = np.array(
                    column,
                    dtype=column.dtype.newbyteorder("="),
                    copy=place.variable.width > 3 * len(there) or None,
                )
            del arrays, array, column
        return out

    return Table(source.file, tuple(place.name for place in places), read)


def _top(place: Place) -> str:
    return place.variable.path.partition("/")[0]


def _variables(source: Source) -> list[Variable]:
    """Every array of numbers in the file."""
    from scipy.io import whosmat

    check_elements(source, MAX_BYTES)
    try:
        listed = whosmat(source.path)
    except Exception:  # scipy raises whatever its parser stumbles over
        raise damaged(source) from None
    found: list[Variable] = []
    batch: list[str] = []
    values = 0
    for name, shape, kind in listed:
        if kind in (*_OBJECTS, *_NO_COLUMNS):
            continue
        batch.append(name)
        # A struct's size is not told: it is loaded alone.
        values += _BATCH if kind == "struct" else math.prod(map(int, shape))
        if values >= _BATCH:
            found += _described(source, batch)
            batch, values = [], 0
    found += _described(source, batch)
    objects = [name for name, _, kind in listed if kind in _OBJECTS]
    if not found and objects:
        raise objects_only(source, [name for name in objects if name and name != "None"])
    return found


def _described(source: Source, names: Sequence[str]) -> list[Variable]:
    arrays = _loaded(source, names) if names else {}
    return [Variable(path, a.shape, a.itemsize, is_complex=a.dtype.kind == "c")
            for path, a in arrays.items()]  # fmt: skip


def _loaded(source: Source, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays of numbers in these variables, by path."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            held = loadmat(
                source.path, variable_names=list(names), verify_compressed_data_integrity=True
            )
    except Exception:  # scipy raises whatever its parser stumbles over
        raise damaged(source) from None
    return {path: array for name in names for path, array in _arrays(held.get(name), name)}


def _arrays(value, path: str, depth: int = 0) -> Iterator[tuple[str, np.ndarray]]:
    if not isinstance(value, np.ndarray) or depth > 8:
        return
    if value.dtype.names and value.size == 1:
        for name in value.dtype.names:
            yield from _arrays(value[name].flat[0], f"{path}/{name}", depth + 1)
    elif value.dtype.kind in "iufc" and value.ndim == 2:
        yield path, value
