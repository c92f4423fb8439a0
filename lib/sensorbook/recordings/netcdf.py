"""netCDF-3 through scipy; netCDF-4 is HDF5."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.arrays import Variable, places_of, tables_of
from sensorbook.recordings.hdf5 import unpacked
from sensorbook.recordings.tables import Source, Table

_ERRORS = (OSError, ValueError, TypeError, KeyError, IndexError, OverflowError, MemoryError,
           AttributeError, EOFError, AssertionError)  # fmt: skip


def table_names(source: Source) -> tuple[str, ...]:
    """Sets of equally long variables."""
    with _opened(source) as file:
        return tuple(sorted(tables_of(_variables(file))))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a file; `table` names a variable where they differ in length."""
    with _opened(source) as file:
        places = places_of(source, tables_of(_variables(file)), table, "variable")

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        with _opened(source) as file:
            for index in indices:
                place = places[index]
                try:
                    variable = file.variables[place.variable.path]
                    data = variable.data
                    if place.column is not None:
                        row = place.variable.is_row
                        data = data[place.column, :] if row else data[:, place.column]
                    out[index] = unpacked(np.array(data), dict(variable._attributes))
                except _ERRORS:
                    raise _damaged(source) from None
        return out

    names = tuple(place.name for place in places)
    return Table(source.file, names, read, units=tuple(p.variable.unit for p in places))


def _opened(source: Source):
    from scipy.io import netcdf_file

    if source.head.startswith(b"CDF\x05"):
        raise source.wrong("is a netCDF file of the 64-bit-data kind, which is not supported",
                           "convert it: nccopy -k nc4")  # fmt: skip
    try:
        file = netcdf_file(source.path, "r", mmap=False)
    except _ERRORS:
        raise _damaged(source) from None
    size = source.path.stat().st_size
    for name, variable in file.variables.items():
        if variable.data.nbytes > size:
            raise source.wrong("is cut off", "copy it again", f"variable {name!r}")
    return file


def _variables(file) -> list[Variable]:
    found = []
    for name, variable in file.variables.items():
        data = variable.data
        if data.dtype.kind in "iuf":
            unit = getattr(variable, "units", b"")
            unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else str(unit)
            found.append(Variable(name, tuple(data.shape), data.itemsize, unit))
    return found


def _damaged(source: Source) -> InputError:
    return source.wrong("is a damaged netCDF file, or one that is cut off", "save or copy it again")
