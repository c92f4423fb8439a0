"""netCDF-3 through scipy; netCDF-4 is HDF5."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.io import netcdf_file

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
        places = places_of(source, _variables(file), table, wanted)

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
    if source.head.startswith(b"CDF\x05"):
        raise source.wrong("is a netCDF file of the 64-bit-data kind, which is not supported",
                           "convert it: nccopy -k nc4")  # fmt: skip
    try:
        file = _File(source.path, "r", mmap=True)
    except _ERRORS:
        raise _damaged(source) from None
    if not file.is_whole(source.path.stat().st_size):
        raise _damaged(source)
    size = source.path.stat().st_size
    for name, variable in file.variables.items():
        if variable.data.nbytes > size:
            raise source.wrong("is cut off", "copy it again", f"variable {name!r}")
    return file


class _File(netcdf_file):
    """A file that notes where its variables lie, which scipy believes unseen."""

    def __init__(self, *arguments, **options):
        self.__dict__[
            "placed"
        ] = []  # first byte, bytes, and bytes as noted beside, of each variable
        self.__dict__["header"] = 0
        super().__init__(*arguments, **options)

    def close(self):
        """Closes the file; columns are copies, whatever still points into its memory map."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            super().close()

    __del__ = close

    def _read_var(self):
        out = super()._read_var()
        shape, size, begin, noted = out[2], out[5], out[7], out[8]
        records = bool(shape) and shape[0] is None
        count = math.prod(shape[1:] if records else shape)
        self.placed.append((int(begin), count * size, int(noted), records))
        self.__dict__["header"] = self.fp.tell()
        return out

    def is_whole(self, size: int) -> bool:
        """True where the variables lie one after another up to the file's end, `size` in bytes.

        Each is padded to 4 bytes and notes its length, save where that takes more than 32 bits
        (The NetCDF Classic Format Specification).
        """
        end = self.header
        for begin, length, noted, _ in sorted(place for place in self.placed if not place[3]):
            if begin < end or noted not in (-(-length // 4) * 4, length, 0xFFFFFFFF, -1):
                return False
            end = begin + length
        records = sorted(place for place in self.placed if place[3])
        if records:
            step = sum(-(-length // 4) * 4 for _, length, *_ in records)
            if records[0][0] < end:
                return False
            step = records[0][1] if len(records) == 1 else step
            end = records[0][0] + self._recs * step
        return size in (end, -(-end // 4) * 4)


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
