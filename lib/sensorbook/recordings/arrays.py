"""Variables of a file as columns of a table, whatever the format: MATLAB, HDF5, netCDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sensorbook.errors import InputError
from sensorbook.recordings.tables import MAX_BYTES, Source, choose, too_large

FEWEST = 2  # values: a scalar is no column
SETTINGS = (
    16  # values: fewer are settings, such as a bias, where longer variables stand beside them
)
MOST_COLUMNS = 1000


@dataclass(frozen=True)
class Variable:
    """An array in a file: `path` to it, its shape, bytes a value, the unit it declares."""

    path: str
    shape: tuple[int, ...]
    size: int
    unit: str = ""
    is_complex: bool = False

    @property
    def samples(self) -> int:
        """Along the longer dimension, as MATLAB's files hold them either way round."""
        return max(self.shape, default=0)

    @property
    def is_usable(self) -> bool:
        """True where it has columns of samples."""
        return (
            self.samples >= FEWEST and len(self.shape) in (1, 2) and 1 <= self.width <= MOST_COLUMNS
        )

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

    def check(self, source: Source) -> None:
        """Raises `InputError` where its values are no real numbers."""
        if self.variable.is_complex:
            mend = "save its real and imaginary parts as columns of their own"
            raise source.wrong("holds complex values", mend, f"variable {self.variable.path!r}")


def tables_of(variables: Sequence[Variable]) -> dict[str, list[Variable]]:
    """The tables of a file by name: matrices, and levels whose vectors are equally long.

    A file of equally long vectors at its top is one table, named "".
    """
    tables = {}
    for level, there in _levels(variables).items():
        # Vectors and matrices of one length are columns of one table.
        if len({v.samples for v in there}) == 1 and (len(there) > 1 or there[0].width == 1):
            tables[level] = there
        else:
            tables |= {v.path: [v] for v in there}
    return tables


def _levels(variables: Sequence[Variable]) -> dict[str, list[Variable]]:
    """The variables that can be columns, by the path of the group that holds them."""
    usable = [v for v in variables if v.is_usable]
    samples = [v for v in usable if v.samples >= SETTINGS]
    levels: dict[str, list[Variable]] = {}
    for v in samples or usable:
        levels.setdefault(v.path.rpartition("/")[0], []).append(v)
    return levels


def places_of(
    source: Source,
    variables: Sequence[Variable],
    table: str | None,
    wanted: Sequence[str | int],
) -> list[Place]:
    """The columns of the table meant; raises `InputError` where none or several could be.

    Where the variables of a level differ in length, the columns wanted are found by name.
    """
    tables = tables_of(variables)
    alone = {v.path: [v] for v in variables if v.is_usable}
    if wanted and table not in tables and (table is not None or len(tables) > 1):
        levels = [columns_of(there) for level, there in _levels(variables).items()
                  if table in (None, level)]  # fmt: skip
        holding = [there for there in levels if set(wanted) <= {place.name for place in there}]
        if len(holding) == 1:
            return _checked(source, holding[0])
    if table in alone and table not in tables:
        return _checked(source, columns_of(alone[table]))
    return _checked(source, columns_of(tables[choose(source, table, sorted(tables), "variable")]))


def _checked(source: Source, places: list[Place]) -> list[Place]:
    # Declared sizes are not trusted: nothing is allocated before this.
    for v in {place.variable for place in places}:
        if v.samples * v.width * v.size > MAX_BYTES:
            raise too_large(source.file, f"variable {v.path!r}")
    return places


def columns_of(chosen: Sequence[Variable]) -> list[Place]:
    """The columns of a table: those of a matrix alone have no names, beside others "name:0"."""
    alone = len(chosen) == 1 and chosen[0].width > 1
    places = []
    for v in chosen:
        name = v.path.rpartition("/")[2]
        if v.width == 1:
            places.append(Place(v, None if len(v.shape) == 1 else 0, name))
        else:
            places += [Place(v, k, "" if alone else f"{name}:{k}") for k in range(v.width)]
    return places


def objects_only(source: Source, names: Sequence[str]) -> InputError:
    """What to raise where a MATLAB file holds nothing that can be read."""
    what = ", ".join(repr(name[:40]) for name in names[:12])
    return source.wrong(f"holds MATLAB objects only{f' ({what})' if what else ''}, such as tables",
                        "save the columns as plain variables, or use writetable")  # fmt: skip
