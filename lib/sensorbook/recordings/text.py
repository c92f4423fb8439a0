"""Delimited text, whatever the logger wrote: delimiter, header and decimal sign are found by content."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.tables import Table
from sensorbook.units import UnitError, factor

DELIMITERS = (",", ";", "\t", "|", r"\s+")
_HEAD_BYTES = 1 << 16
_PREAMBLE = 20
_COMMENT = ("#", "%")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_STAMP = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d.*)?")
_MISSING = {"", "na", "n/a", "null", "none", "-", "nan"}


@dataclass(frozen=True)
class Layout:
    """How a text file is laid out: delimiter, decimal sign, lines before the data, names."""

    delimiter: str
    decimal: str
    skip: int
    names: tuple[str, ...]


def open_text(data: bytes, file: str, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens delimited text; `wanted` helps to find the header."""
    if table is not None:
        mend = "leave `table` out, or name the file that holds it"
        raise InputError(
            Problem(file, f"table {table!r}", "is text and holds one table only", mend)
        )
    data, encoding = _decoded(data, file)
    head = data[:_HEAD_BYTES].decode(encoding, errors="replace")
    lines = head.splitlines()
    if len(data) > _HEAD_BYTES:
        lines = lines[:-1]  # may be cut
    layout = find_layout(lines, [w for w in wanted if isinstance(w, str)])
    if layout is None:
        raise InputError(
            Problem(file, "", "holds no rows of numbers", "write one sample a line, cells separated "
                    "by comma, semicolon, tab or blank")
        )  # fmt: skip

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        return _parse(data, encoding, layout, indices, file)

    return Table(file, layout.names, read)


def _decoded(data: bytes, file: str) -> tuple[bytes, str]:
    """The text as bytes of an encoding that pandas' parser takes, and that encoding."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16").encode(), "utf-8"
        except UnicodeDecodeError:
            raise _binary(file) from None
    data = data.removeprefix(b"\xef\xbb\xbf")
    head = data[:_HEAD_BYTES]
    if re.search(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]", head):
        raise _binary(file)
    try:
        head[: head.rfind(b"\n") + 1 or None].decode()
        return data, "utf-8"
    except UnicodeDecodeError:
        # Western single-byte text holds a ° or µ among many plain characters; binary does not.
        if sum(byte > 127 for byte in head) > 0.1 * len(head):
            raise _binary(file) from None
        return data, "cp1252"


def _binary(file: str) -> InputError:
    return InputError(
        Problem(file, "", "is a binary file, not text", "save the columns as .csv or .npz")
    )


def find_layout(lines: Sequence[str], wanted: Sequence[str] = ()) -> Layout | None:
    """Layout of a text file from its first lines, or None where they hold no rows of numbers."""
    best, best_score = None, (0.0, 0)
    for delimiter in DELIMITERS:
        rows = [_cells(line, delimiter) for line in lines]
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
            best, best_score = Layout(delimiter, "," if comma else ".", first, names), score
    return best


def _first_of_table(data: list[int], rows: list[list[str]], width: int) -> int:
    """First line of the table: the data line after which no header-like line of its width comes."""
    lines = set(data)
    # Numbers in a preamble look like data; more than a few such lines are data.
    for k in reversed(range(min(data[-1], data[min(_PREAMBLE, len(data) - 1)]))):
        if k not in lines and len(rows[k]) == width and _is_header(rows[k]):
            return next(line for line in data if line > k)
    return data[0]


def _is_header(cells: list[str]) -> bool:
    return all(not _NUMBER.fullmatch(cell) for cell in cells) and any(cells)


def _cells(line: str, delimiter: str) -> list[str]:
    line = line.strip() if delimiter == r"\s+" else line.strip("\r\n")
    if not line.strip() or line.lstrip().startswith(_COMMENT):
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
        bool(_NUMBER.fullmatch(c) or _STAMP.fullmatch(c))
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
        cells = _cells(text.lstrip("#% ") if text.startswith(_COMMENT) else text, delimiter)
        if len(cells) == width - 1:
            cells = [*cells, ""]  # rows end with a delimiter, the header does not
        if len(cells) != width or not _is_header(cells):
            continue
        # The line nearest to the data, unless it gives units or an earlier one has the names wanted.
        score = (len(set(cells) & set(wanted)), -_units_among(cells))
        if score > best_score or best == ("",) * width:
            best, best_score = tuple(cells), score
    return best


def _units_among(cells: Sequence[str]) -> int:
    def is_unit(cell: str) -> bool:
        for si in ("rad/s", "m/s^2", "T", "degC", "s"):
            try:
                return bool(factor(cell.strip("()[] "), si))
            except UnitError:
                continue
        return False

    return int(sum(map(is_unit, cells)) > len(cells) / 2)


def _parse(
    data: bytes, encoding: str, layout: Layout, indices: Sequence[int], file: str
) -> dict[int, np.ndarray]:
    import pandas

    comment = next((c for c in _COMMENT if data.find(c.encode()) >= 0), None)
    try:
        frame = pandas.read_csv(
            io.BytesIO(data),
            sep=layout.delimiter,
            header=None,
            names=range(len(layout.names)),
            usecols=list(indices),
            index_col=False,
            skiprows=layout.skip,
            decimal=layout.decimal,
            comment=comment,
            skipinitialspace=True,
            encoding=encoding,
            encoding_errors="replace",
            low_memory=False,
        )
    except pandas.errors.EmptyDataError:
        return {index: np.empty(0) for index in indices}
    except (pandas.errors.ParserError, ValueError, OverflowError) as error:
        raise InputError(
            Problem(file, _line(str(error)), f"is no regular table: {_tidy(str(error))}",
                    "write the same number of cells on every line")
        ) from None  # fmt: skip
    _check_width(data, encoding, layout, len(frame), file)
    return {index: frame[index].to_numpy() for index in indices}


def _check_width(data: bytes, encoding: str, layout: Layout, rows: int, file: str) -> None:
    """Raises where a line holds more cells than the table: the parser drops what it has too many."""
    delimiter, width = layout.delimiter, len(layout.names)
    body = 0
    for _ in range(layout.skip):
        body = data.find(b"\n", body) + 1
    if len(delimiter) > 1 or data.count(delimiter.encode(), body) <= rows * (width - 1):
        return
    for number, line in enumerate(data.decode(encoding, "replace").splitlines(), start=1):
        cells = len(_cells(line, delimiter)) if number > layout.skip else 0
        if cells > width:
            raise InputError(
                Problem(file, f"line {number}", f"holds {cells} cells, the table has {width} columns",
                        "mend or remove the line")
            )  # fmt: skip


def _line(message: str) -> str:
    match = re.search(r"in line (\d+)", message)
    return f"line {match[1]}" if match else ""


def _tidy(message: str) -> str:
    message = re.sub(r"^Error tokenizing data\. C error: ", "", message).strip().rstrip(".")
    return re.sub(r" in line \d+", "", message)[:120]
