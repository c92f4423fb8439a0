"""Variables of a file as columns of a table, whatever the format: MATLAB, HDF5, netCDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sensorbook.recordings.tables import MAX_BYTES, Source, choose, too_large

FEWEST = 2  # values: a scalar is no column
MOST_COLUMNS = 1000


@dataclass(frozen=True)
class Variable:
    """An array in a file: `path` to it, its shape, bytes a value, and the unit it declares."""

    path: str
    shape: tuple[int, ...]
    size: int
    unit: str = ""

    @property
    def samples(self) -> int:
        """Along the longer dimension, as MATLAB's files hold them either way round."""
        return max(self.shape, default=0)

    @property
    def is_row(self) -> bool:
        """True where the samples lie along the second dimension."""
        return len(self.shape) == 2 and self.shape[1] > self.shape[0]

    @property
    def width(self) -> int:
        """Number of columns."""
        return 1 if len(self.shape) == 1 else min(self.shape)


@dataclass(frozen=True)
class Place:
    """A column: the variable, and which of its columns (None for a vector)."""

    variable: Variable
    column: int | None
    name: str


def tables_of(variables: Sequence[Variable]) -> dict[str, list[Variable]]:
    """The tables of a file by name: matrices, and levels whose vectors are equally long.

    A file of equally long vectors at its top is one table, named "".
    """
    usable = [v for v in variables if v.samples >= FEWEST and len(v.shape) in (1, 2)]
    usable = [v for v in usable if v.width <= MOST_COLUMNS and v.width >= 1]
    tables = {v.path: [v] for v in usable if v.width > 1}
    levels: dict[str, list[Variable]] = {}
    for v in usable:
        levels.setdefault(v.path.rpartition("/")[0], []).append(v)
    for level, there in levels.items():
        lengths = {v.samples for v in there}
        # Vectors and matrices of one length are columns of one table.
        if len(lengths) == 1 and (len(there) > 1 or there[0].width == 1):
            for v in there:
                tables.pop(v.path, None)
            tables[level] = there
        else:
            tables |= {v.path: [v] for v in there}
    return tables


def places_of(
    source: Source, tables: Mapping[str, list[Variable]], table: str | None, what: str
) -> list[Place]:
    """The columns of the table meant; raises `InputError` where none or several could be."""
    members = {v.path: [v] for vs in tables.values() for v in vs}
    if table is not None and table not in tables and table in members:
        chosen, table = members[table], table
    else:
        table = choose(source, table, sorted(tables), what)
        chosen = tables[table]
    for v in chosen:
        # Declared sizes are not trusted: nothing is allocated before this.
        if v.samples * v.width * v.size > MAX_BYTES:
            raise too_large(source.file, f"{what} {v.path!r}")
    alone = len(chosen) == 1 and chosen[0].width > 1
    places = []
    for v in chosen:
        name = v.path.rpartition("/")[2]
        if v.width == 1:
            places.append(Place(v, None if len(v.shape) == 1 else 0, name))
        else:
            places += [Place(v, k, "" if alone else f"{name}:{k}") for k in range(v.width)]
    return places
