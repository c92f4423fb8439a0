"""The columns of a table that are no sensor's axes: time, counter, temperature, quaternion, idle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sensorbook.errors import InputError
from sensorbook.guessing.names import Named, read_name, unit_of
from sensorbook.recordings.clock import shuffled
from sensorbook.recordings.tables import Table


@dataclass(frozen=True, eq=False)
class Column:
    """A column: `reference` is how `device.toml` names it, `values` (N,) float64, or None for text."""

    index: int
    name: str
    reference: str | int
    named: Named
    values: np.ndarray | None
    stamps: bool = False  # holds dates

    @property
    def shown(self) -> str:
        return repr(self.reference) if self.name else f"column {self.index}"


@dataclass
class Roles:
    """What the columns of a table are."""

    time: list[Column] = field(default_factory=list)
    counter: list[Column] = field(default_factory=list)
    temperature: Column | None = None
    quaternion: list[Column] = field(default_factory=list)
    triples: list[list[Column]] = field(default_factory=list)
    idle: list[Column] = field(default_factory=list)


def read_columns(table: Table) -> list[Column]:
    """Every column of a table, parsed."""
    unreadable = _parse(table)
    units = table.units or ("",) * len(table.names)
    read = []
    for index, name in enumerate(table.names):
        named = read_name(name) if name else Named()
        if unit := unit_of(units[index]) if units[index] else "":
            named = Named(named.role, named.sensor, named.axis, unit, named.group)
        unique = bool(name) and table.names.count(name) == 1
        values, stamps = (None, False) if index in unreadable else _as_numbers(table.column(index))
        read.append(Column(index, name, name if unique else index, named, values, stamps))
    return read


def _parse(table: Table) -> set[int]:
    """Parses all columns; returns those that hold no samples, such as lists."""
    try:
        table.parse(range(len(table.names)))
    except InputError as error:
        unreadable = set()
        for index in range(len(table.names)):
            try:
                table.parse([index])
            except InputError:
                unreadable.add(index)
        if len(unreadable) == len(table.names):
            raise error from None
        return unreadable
    return set()


def _as_numbers(column: np.ndarray) -> tuple[np.ndarray | None, bool]:
    """Numbers of a column, and whether they stand for dates; None where it holds text."""
    if column.dtype.kind in "iuf":
        return column.astype(np.float64, copy=False), False
    if column.dtype.kind == "M":
        return column.astype("datetime64[ns]").astype(np.int64) / 1e9, True
    import pandas

    some = pandas.Series(column[:200].astype(object)).dropna()
    if len(some) and pandas.to_datetime(
        some, utc=True, format="ISO8601", errors="coerce"
    ).notna().all() and not pandas.to_numeric(some, errors="coerce").notna().any():  # fmt: skip
        whole = pandas.to_datetime(
            pandas.Series(column.astype(object)), utc=True, format="ISO8601", errors="coerce"
        )
        seconds = whole.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")
        return np.where(np.isnat(seconds), np.nan, seconds.astype(np.int64) / 1e9), True
    numeric = pandas.to_numeric(pandas.Series(column.astype(object)), errors="coerce")
    share = numeric.notna().mean() if len(numeric) else 0.0
    return (numeric.to_numpy(np.float64), False) if share > 0.9 else (None, False)


def sort_columns(columns: Sequence[Column]) -> Roles:
    """What each column is, by its name, and by how it behaves where the name is silent."""
    roles = Roles()
    rest: list[Column] = []
    for column in columns:
        role = column.named.role
        v = column.values
        finite = v[np.isfinite(v)] if v is not None else np.empty(0)
        still = len(finite) < 2 or finite.min() == finite.max()
        if v is None or (still and role != "axis"):
            roles.idle.append(column)
        elif column.name == "T" and not _rises(finite) and _slow(v):
            roles.temperature = roles.temperature or column
        elif column.stamps or (role == "time" and _tells_time(finite)):
            roles.time.append(column)
        elif role == "counter" and _advances(finite):
            roles.counter.append(column)
        elif role == "temperature" and -60 < np.median(finite) < 400:
            roles.temperature = roles.temperature or column
        elif role in ("other", "temperature", "counter", "time"):
            roles.idle.append(column)
        elif role not in ("axis", "quaternion") and _advances(finite):
            kind = roles.counter if _counts(finite) else roles.time
            kind.append(column)
        elif role != "axis" and role != "quaternion" and _flag(finite):
            roles.idle.append(column)
        else:
            rest.append(column)
    rest = _take_quaternion(rest, roles)
    rest = _take_named(rest, roles)
    _take_unnamed(rest, roles)
    return roles


def _tells_time(values: np.ndarray) -> bool:
    """True for what is named a time and is one, whatever the order of its rows, which is told later."""
    return _advances(values, 0.5) or _rises(values) or shuffled(values)


def _advances(values: np.ndarray, share: float = 0.98) -> bool:
    """True for what runs on: a time or a counter, but for a few stamps, or a larger share of them."""
    steps = np.diff(values)
    if len(steps) < 2:
        return False
    # A part of a stamp, such as its nanoseconds, begins anew again and again.
    if values[-1] - values[0] < 0.5 * steps[steps > 0].sum():
        return False
    # A reading never rises through thousands of samples, and a slow one stands still in between.
    return bool(np.median(steps) > 0 and np.count_nonzero(steps >= 0) >= share * len(steps))


def _rises(values: np.ndarray) -> bool:
    """True for what never falls but for a few stamps: a time, even where samples share stamps."""
    steps = np.diff(values)
    return bool(values[-1] > values[0] and np.count_nonzero(steps >= 0) >= 0.98 * len(steps))


def _counts(values: np.ndarray) -> bool:
    """True for 0, 1, 2 … or 1, 2, 3 …, which may be a counter as well as seconds."""
    return bool(np.median(np.diff(values)) == 1 and values[0] == np.round(values[0]))


def _flag(values: np.ndarray) -> bool:
    """True for a mark of few values, whole ones: a state, a label."""
    levels = np.unique(values[:100_000])
    return len(levels) <= 4 and bool((levels == np.round(levels)).all())


def _take_quaternion(columns: list[Column], roles: Roles) -> list[Column]:
    """Takes out four columns of unit length: named ones, else any four side by side."""
    named = [c for c in columns if c.named.role == "quaternion"]
    candidates = [named] if len(named) == 4 else []
    candidates += [columns[k : k + 4] for k in range(len(columns) - 3)]
    for four in candidates:
        if any(c.named.role == "axis" and c.named.sensor for c in four):
            continue
        values = np.stack([c.values for c in four], axis=1)
        values = values[np.isfinite(values).all(axis=1)]
        if _unit_length(values) and not (
            four is not named and (_unit_length(values[:, :3]) or _unit_length(values[:, 1:]))
        ):  # gravity in g is of unit length, too, whatever small stands beside it
            roles.quaternion = four
            break
    roles.idle += [c for c in named if c not in roles.quaternion]
    return [c for c in columns if c not in roles.quaternion and c.named.role != "quaternion"]


def _unit_length(values: np.ndarray) -> bool:
    off = np.abs((values**2).sum(axis=1) - 1)
    return len(off) > 10 and bool(np.quantile(off, 0.95) < 0.02)


def _take_named(columns: list[Column], roles: Roles) -> list[Column]:
    """Takes out the triples whose names give axis and group; returns what is left."""
    groups: dict[tuple[str, str], dict[str, Column]] = {}
    for column in columns:
        if column.named.axis in ("x", "y", "z"):
            key = (column.named.sensor, column.named.group)
            groups.setdefault(key, {}).setdefault(column.named.axis, column)
    taken: list[Column] = []
    for axes in groups.values():
        if len(axes) == 3:
            triple = [axes[a] for a in "xyz"]
            roles.triples.append(triple)
            taken += triple
    roles.triples.sort(key=lambda triple: min(c.index for c in triple))
    return [c for c in columns if c not in taken]


def _take_unnamed(columns: list[Column], roles: Roles) -> None:
    """Takes what names do not tell as triples side by side, and a slow odd one as temperature."""
    silent = [c for c in columns if not c.named.sensor and not c.named.axis]
    silent += [c for c in columns if c.named.sensor and not c.named.axis]  # acc1, acc2, acc3
    silent.sort(key=lambda c: c.index)
    roles.idle += [c for c in columns if c not in silent]
    if len(silent) % 3 == 1:
        slow = [c for c in (silent[-1], silent[0]) if _slow(c.values)]
        if not slow:
            roles.idle += silent
            return
        silent.remove(slow[0])
        if roles.temperature is None and -60 < np.nanmedian(slow[0].values) < 150:
            roles.temperature = slow[0]
        else:
            roles.idle.append(slow[0])
    if len(silent) % 3:
        roles.idle += silent
        return
    roles.triples += [silent[k : k + 3] for k in range(0, len(silent), 3)]


def _slow(values: np.ndarray) -> bool:
    """True for what drifts far more than it scatters from sample to sample, as a temperature does."""
    finite = values[np.isfinite(values)]
    scatter = float(np.sqrt(np.mean(np.diff(finite) ** 2) / 2)) if len(finite) > 2 else np.inf
    return scatter < 0.1 * float(finite.std())
