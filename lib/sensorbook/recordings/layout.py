"""How a text file is laid out: delimiter, decimal sign, header, units, widths; found by content."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.units import UnitError, factor

DELIMITERS = (",", ";", "\t", "|", r"\s+")
COMMENT = ("#", "%")
PREAMBLE = 20  # lines before a table that are looked at
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_STAMP = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d.*)?")
_MISSING = {"", "na", "n/a", "null", "none", "-", "nan"}


@dataclass(frozen=True)
class Layout:
    """How a text file is laid out: delimiter, decimal sign, lines before the data, names, units.

    `edges` are the first and last character (exclusive) of each column where widths are fixed.
    """

    delimiter: str
    decimal: str
    skip: int
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    edges: tuple[tuple[int, int], ...] = ()


def find_layout(lines: Sequence[str], wanted: Sequence[str] = ()) -> Layout | None:
    """Layout of a text file from its first lines, or None where they hold no rows of numbers."""
    best, best_score = None, (0.0, 0)
    for delimiter in DELIMITERS:
        rows = [cells_of(line, delimiter) for line in lines]
        numeric = [_numeric_share(row, delimiter) for row in rows]
        data = [k for k, share in enumerate(numeric) if share >= 0.5]
        if not data:
            continue
        width = Counter(len(rows[k]) for k in data).most_common(1)[0][0]
        data = [k for k in data if len(rows[k]) == width]
        first = _first_of_table(data, rows, width)
        score = (float(np.mean([numeric[k] for k in data])) * len(data), width)
        if score > best_score:
            cells = [cell for k in data for cell in rows[k]]
            comma = delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells)
            names = _header(lines[:first], delimiter, width, wanted)
            units = _units(lines[:first], delimiter, width, names)
            best = Layout(delimiter, "," if comma else ".", first, names, units)
            best_score = score
    if best is None or (best.delimiter == r"\s+" and _ragged(lines[best.skip :])):
        return _fixed_width(lines) or best
    return best


def _ragged(lines: Sequence[str]) -> bool:
    """True where many lines have other numbers of words than most."""
    counts = Counter(len(line.split()) for line in lines if line.strip())
    return counts.most_common(1)[0][1] < 0.95 * counts.total()


_FIXED = re.compile(r"[+-]?(?:\d+\.\d*|\.\d+|\d+)(?:[eEdD][+-]?\d+)?")


def _fixed_width(lines: Sequence[str]) -> Layout | None:
    """Layout of numbers that end at the same places on every line, whether or not they touch."""
    rows = [k for k, line in enumerate(lines) if line.strip() and not _FIXED.sub("", line).strip()]
    if len(rows) < 5:
        return None
    ends = Counter(m.end() for k in rows for m in _FIXED.finditer(lines[k]))
    places = sorted(place for place, count in ends.items() if count > 0.3 * len(rows))
    if len(places) < 2 or sum(ends[place] for place in places) < 0.98 * ends.total():
        return None
    edges = tuple(zip((0, *places[:-1]), places, strict=True))
    names = ("",) * len(places)
    for line in reversed(lines[: rows[0]]):
        cells = tuple(line[a:b].strip() for a, b in edges)
        if all(cells) and is_header(list(cells)):
            names = cells
            break
    return Layout("", ".", rows[0], names, edges=edges)


def _first_of_table(data: list[int], rows: list[list[str]], width: int) -> int:
    """First line of the table: the data line after which no header-like line of its width comes."""
    lines = set(data)
    # Numbers in a preamble look like data; more than a few such lines are data.
    for k in reversed(range(min(data[-1], data[min(PREAMBLE, len(data) - 1)]))):
        if k not in lines and len(rows[k]) == width and is_header(rows[k]):
            return next(line for line in data if line > k)
    return data[0]


def is_header(cells: list[str]) -> bool:
    return all(not NUMBER.fullmatch(cell) for cell in cells) and any(cells)


def cells_of(line: str, delimiter: str) -> list[str]:
    line = line.strip() if delimiter == r"\s+" else line.strip("\r\n")
    if not line.strip() or line.lstrip().startswith(COMMENT):
        return []
    if delimiter == r"\s+":
        return [cell.strip('"') for cell in line.split()]
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
        except (csv.Error, StopIteration):
            return []
    return [cell.strip() for cell in line.split(delimiter)]


def _numeric_share(cells: list[str], delimiter: str) -> float:
    """Share of the cells that hold a number, a time stamp or nothing; 0 where none holds one."""
    numbers = sum(
        bool(NUMBER.fullmatch(c) or _STAMP.fullmatch(c))
        or (delimiter != "," and bool(_DECIMAL_COMMA.fullmatch(c)))
        for c in cells
    )
    missing = sum(cell.lower() in _MISSING for cell in cells)
    return (numbers + missing) / len(cells) if numbers else 0.0


def _header(
    lines: Sequence[str], delimiter: str, width: int, wanted: Sequence[str]
) -> tuple[str, ...]:
    """Names of the columns, from the line before the data that fits best; "" where none does."""
    best, best_score = ("",) * width, (-1, -1)
    for line in reversed(lines[-20:]):
        text = line.strip()
        cells = cells_of(text.lstrip("#% ") if text.startswith(COMMENT) else text, delimiter)
        if len(cells) == width - 1:
            cells = [*cells, ""]  # rows end with a delimiter, the header does not
        if len(cells) != width or not is_header(cells):
            continue
        # The line nearest to the data, unless it gives units or an earlier one has the names wanted.
        score = (len(set(cells) & set(wanted)), -_units_among(cells))
        if score > best_score or best == ("",) * width:
            best, best_score = tuple(cells), score
    return best


def _units(
    lines: Sequence[str], delimiter: str, width: int, names: Sequence[str]
) -> tuple[str, ...]:
    """The line of units between header and data; () where there is none."""
    for line in reversed(lines[-3:]):
        text = line.strip()
        cells = cells_of(text.lstrip("#% ") if text.startswith(COMMENT) else text, delimiter)
        if len(cells) == width and tuple(cells) != tuple(names) and _units_among(cells):
            return tuple(cells)
    return ()


def _units_among(cells: Sequence[str]) -> int:
    def is_unit(cell: str) -> bool:
        for si in ("rad/s", "m/s^2", "T", "degC", "s"):
            try:
                return bool(factor(cell.strip("()[] "), si))
            except UnitError:
                continue
        return False

    return int(sum(map(is_unit, cells)) > len(cells) / 2)
