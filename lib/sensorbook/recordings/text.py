"""Delimited text, whatever the logger wrote: delimiter, header and decimal sign are found by content."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import BinaryIO

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.layout import (
    COMMENT,
    NUMBER,
    PREAMBLE,
    Layout,
    cells_of,
    find_layout,
    is_header,
)
from sensorbook.recordings.tables import HEAD_BYTES, Source, Table, extended

_ROWS = 1 << 16  # rows parsed at one go
_COMMENT_LINE = re.compile(rb"(?:\A|\n)[ \t]*[#%]")


def table_names(source: Source) -> tuple[str, ...]:
    """None: a text is one table."""
    return ()


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens delimited or fixed-width text; `wanted` helps to find the header."""
    file = source.file
    if table is not None:
        mend = "leave `table` out, or name the file that holds it"
        raise source.wrong("is text and holds one table only", mend, f"table {table!r}")
    text = _Text.of(source)
    lines = _lines(text.head)
    # A last line without an end may be broken off: the layout is told by those before it.
    if text.is_cut or (len(lines) > 5 and not text.head.endswith(("\n", "\r"))):
        lines = lines[:-1]
    layout = find_layout(lines, [w for w in wanted if isinstance(w, str)])
    if layout is None:
        raise source.wrong("holds no rows of numbers", "write one sample a line, cells separated "
                           "by comma, semicolon, tab or blank")  # fmt: skip
    text.examine(layout)

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        return _parse(text, layout, indices, file)

    notes = tuple(line for line in lines[: min(layout.skip, PREAMBLE)] if line.strip())
    return Table(file, layout.names, read, units=layout.units, notes=notes)


def has_table(source: Source) -> bool:
    """True where the beginning is text with rows of numbers."""
    try:
        return find_layout(_lines(_Text.of(source).head[: HEAD_BYTES // 4]), []) is not None
    except InputError:
        return False


class _Text:
    """The text of a file, in an encoding that pandas' parser takes, and what one pass over it showed.

    Attributes
    ----------
    head : its beginning; `is_cut` where that ends within the text
    encoding : of the bytes that `open` gives
    has_comments : a line begins with a comment sign
    delimiters : number of delimiters after the lines before the data
    """

    def __init__(self, source: Source, data: bytes | None, encoding: str, head: str, is_cut: bool):
        self.source, self.encoding, self.head, self.is_cut = source, encoding, head, is_cut
        self._data = data  # where it had to be decoded as a whole
        self.has_comments = False
        self.delimiters = 0

    @classmethod
    def of(cls, source: Source) -> _Text:
        if source.head.startswith((b"\xff\xfe", b"\xfe\xff")):
            try:
                data = b"".join(source.chunks()).decode("utf-16").encode()
            except UnicodeDecodeError:
                raise _binary(source) from None
            return cls(source, data, "utf-8", data[:HEAD_BYTES].decode(errors="replace"),
                       len(data) > HEAD_BYTES)  # fmt: skip
        head = source.head.removeprefix(b"\xef\xbb\xbf")
        if re.search(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]", head):
            if re.search(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f]", head) or b"\n" not in head[:4096]:
                raise _binary(source)
            raise _nul(source, 1 + head[: head.index(b"\0")].count(b"\n"))
        is_cut = len(source.head) == HEAD_BYTES
        encoding = "utf-8"
        try:
            head[: head.rfind(b"\n") + 1 or None].decode()
        except UnicodeDecodeError:
            # Western single-byte text holds a ° or µ among many plain characters; binary does not.
            if sum(byte > 127 for byte in head) > 0.1 * len(head):
                raise _binary(source) from None
            encoding = "cp1252"
        return cls(source, None, encoding, head.decode(encoding, errors="replace"), is_cut)

    def open(self) -> BinaryIO:
        """The text from its beginning, without a byte-order mark."""
        if self._data is not None:
            return io.BytesIO(self._data)
        stream = self.source.open()
        if self.source.head.startswith(b"\xef\xbb\xbf"):
            stream.read(3)
        return stream

    def open_without_comments(self) -> BinaryIO:
        """The text with its comment lines empty; within a line the sign is part of a cell."""
        stream = self.open()
        return io.BufferedReader(_Uncommented(stream), 1 << 20) if self.has_comments else stream

    def chunks(self) -> Iterator[bytes]:
        return iter((self._data,)) if self._data is not None else self.source.chunks()

    def examine(self, layout: Layout) -> None:
        """One pass over the text: comments, delimiters; raises where it is cut off or holds NUL."""
        sign = layout.delimiter.encode() if len(layout.delimiter) == 1 else b""
        line, tail = 1, b""
        for chunk in self.chunks():
            if (at := chunk.find(b"\0")) >= 0:
                raise _nul(self.source, line + chunk[:at].count(b"\n"))
            line += chunk.count(b"\n")
            self.delimiters += chunk.count(sign) if sign else 0
            if not self.has_comments and (b"#" in chunk or b"%" in chunk):
                self.has_comments = bool(_COMMENT_LINE.search(tail[-100:] + chunk))
            tail = (tail + chunk)[-HEAD_BYTES // 2 :]
        before = self.head.splitlines(keepends=True)[: layout.skip]
        self.delimiters -= "".join(before).count(layout.delimiter) if sign else 0
        if tail and not tail.endswith((b"\n", b"\r", b"\0")):
            _check_end(self.source, tail.decode(self.encoding, "replace"), line, layout)


def rewrite(
    source: Source, wanted: Sequence[str | int], columns: Mapping[int, np.ndarray], out
) -> None:
    """Writes the text again with some columns' numbers replaced, every other character as it was.

    Parameters
    ----------
    wanted : as for `open_table`
    columns : by 0-based index (N,) numbers; a cell that held no number stays as it is, and a number
        that is NaN leaves its cell empty
    out : binary stream

    Raises
    ------
    InputError : the text has columns of fixed width, which a new number may not fit
    """
    text = _Text.of(source)
    layout = find_layout(_lines(text.head), [w for w in wanted if isinstance(w, str)])
    if layout.edges:
        raise source.wrong("has columns of fixed width, which corrected numbers may not fit",
                           "name an output that ends in .parquet or .npz")  # fmt: skip
    row, order = 0, sorted(columns)
    count = len(columns[order[0]]) if order else 0
    encoding = text.encoding
    for mark, name in (
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
        (b"\xef\xbb\xbf", "utf-8"),
    ):
        if source.head.startswith(mark):
            out.write(mark)
            encoding = name
    with text.open() as stream:
        for number, line in enumerate(stream):
            decoded = line.decode(text.encoding, "surrogateescape")
            if number >= layout.skip and cells_of(decoded, layout.delimiter):
                if row == count:
                    raise _broken(source, count)
                new = [columns[k][row] for k in order]
                decoded = _replaced(decoded, layout, dict(zip(order, new, strict=True)))
                row += 1
            out.write(decoded.encode(encoding, "surrogateescape"))
    if row != count:
        raise _broken(source, count)


def _broken(source: Source, count: int) -> InputError:
    return source.wrong(f"has other lines of numbers than the {count} rows that were read",
                        "write one sample a line, without line breaks in cells")  # fmt: skip


def _lines(text: str) -> list[str]:
    """The lines as the parser counts them: `splitlines` breaks at more characters."""
    return re.split(r"\r\n|\r|\n", text.removesuffix("\n").removesuffix("\r"))


def _replaced(line: str, layout: Layout, values: dict[int, float]) -> str:
    """A line with the cells of these columns replaced."""
    delimiter = layout.delimiter
    if len(delimiter) == 1 and '"' not in line:
        body = line.rstrip("\r\n")
        cells = body.split(delimiter)
        for k, value in values.items():
            if k < len(cells):
                old = cells[k].strip()
                cells[k] = (
                    cells[k].replace(old, _number(old, value, layout.decimal, delimiter))
                    if old
                    else cells[k]
                )
        return delimiter.join(cells) + line[len(body) :]
    for k, (start, end) in reversed(list(enumerate(_spans(line, delimiter)))):
        if k in values:
            line = (
                line[:start]
                + _number(line[start:end], values[k], layout.decimal, delimiter)
                + line[end:]
            )
    return line


def _number(old: str, value: float, decimal: str, delimiter: str) -> str:
    """The new text of a cell: nine digits; what was no number stays, and NaN is an empty cell."""
    if not NUMBER.fullmatch(old.replace(",", ".")) or old.lower().endswith("nan"):
        return old
    if np.isnan(value):
        return "nan" if delimiter == r"\s+" else ""  # an empty cell between blanks is none
    return f"{value:.9g}".replace(".", decimal)


def _spans(line: str, delimiter: str) -> list[tuple[int, int]]:
    """Start and end of each cell's text in a line, without blanks and quotes around it."""
    body = line.rstrip("\r\n")
    if delimiter == r"\s+":
        parts = [m.span() for m in re.finditer(r"\S+", body)]
    else:
        parts, start, quoted = [], 0, False
        for place, character in enumerate(body + delimiter):
            quoted ^= character == '"'
            if character == delimiter and not quoted:
                parts.append((start, place))
                start = place + 1
    inner = []
    for a, b in parts:
        cell = body[a:b]
        a += len(cell) - len(cell.lstrip(' \t"'))
        inner.append((a, max(a, a + len(cell.strip(' \t"')))))
    return inner


class _Uncommented(io.RawIOBase):
    """A text whose comment lines are empty, so that lines keep their numbers."""

    def __init__(self, stream: BinaryIO):
        self._stream, self._left = stream, b""

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        self._stream.close()
        super().close()

    def readinto(self, target) -> int:
        if not self._left:
            lines = self._stream.readlines(len(target))
            self._left = b"".join(
                b"\n" if line.lstrip().startswith((b"#", b"%")) else line for line in lines
            )
        part, self._left = self._left[: len(target)], self._left[len(target) :]
        target[: len(part)] = part
        return len(part)


def _check_end(source: Source, tail: str, line: int, layout: Layout) -> None:
    """Raises where the last line, which has no end, breaks off within the table's row."""
    rows = tail.splitlines()
    whole = len(rows) == line  # else the first may have lost its beginning
    last, earlier = rows[-1], rows[0 if whole else 1 : -1][-100:]
    if not earlier or last.lstrip().startswith(COMMENT):
        return
    if layout.edges:
        if last.strip() and len(last.rstrip()) < min(
            len(row.rstrip()) for row in earlier if row.strip()
        ):
            raise _cut_off(source, line)
        return
    cells = cells_of(last, layout.delimiter)
    before = [cells_of(row, layout.delimiter) for row in earlier]
    usual = Counter(len(row) for row in before if row).most_common(1)[0][0] if any(before) else 0
    if not cells or not usual:
        return
    ends = [_decimals(row[-1], layout.decimal) for row in before
            if len(row) == usual and not is_header(row)]  # fmt: skip
    broken = (
        len(cells) < usual
        or re.fullmatch(r"[+-]|.*\d[eE][+-]?", cells[-1])
        or (len(ends) > 20 and _decimals(cells[-1], layout.decimal) < min(ends))
    )
    if broken:
        raise _cut_off(source, line)


def _cut_off(source: Source, line: int) -> InputError:
    return source.wrong("is cut off: its last line breaks off", "copy it again, or remove the line",
                        f"line {line}")  # fmt: skip


def _decimals(cell: str, decimal: str) -> int:
    return len(cell.partition(decimal)[2])


def _binary(source: Source) -> InputError:
    return source.wrong("is a binary file, not text", "save the columns as .csv or .npz")


def _nul(source: Source, line: int) -> InputError:
    return source.wrong("holds NUL bytes, as a logger leaves them that loses power",
                        "remove them", f"line {line}")  # fmt: skip


def _parse(text: _Text, layout: Layout, indices: Sequence[int], file: str) -> dict[int, np.ndarray]:
    import pandas

    common = {
        "header": None,
        "skiprows": layout.skip,
        "decimal": layout.decimal,
        "encoding": text.encoding,
        "encoding_errors": "replace",
    }
    columns = {index: np.empty(0) for index in indices}
    rows = 0
    try:
        with text.open_without_comments() as stream:
            if layout.edges:
                # All columns: a row that is blank in those wanted would be passed over.
                frames = pandas.read_fwf(
                    stream, colspecs=list(layout.edges), names=range(len(layout.names)),
                    usecols=list(indices), index_col=False, chunksize=_ROWS, **common,
                )  # fmt: skip
            else:
                frames = pandas.read_csv(
                    stream, sep=layout.delimiter, names=range(len(layout.names)),
                    usecols=list(indices), index_col=False, skipinitialspace=True,
                    low_memory=False, chunksize=_ROWS, **common,
                )  # fmt: skip
            with frames:
                for frame in frames:
                    for index in indices:
                        columns[index] = extended(columns[index], frame[index].to_numpy())
                    rows += len(frame)
    except pandas.errors.EmptyDataError:
        return columns
    except (pandas.errors.ParserError, ValueError, OverflowError) as error:
        raise InputError(
            Problem(file, _line(str(error)), f"is no regular table: {_tidy(str(error))}",
                    "write the same number of cells on every line")
        ) from None  # fmt: skip
    _check_width(text, layout, rows, file)
    return columns


def _check_width(text: _Text, layout: Layout, rows: int, file: str) -> None:
    """Raises where a line holds more cells than the table: the parser drops what it has too many."""
    delimiter, width = layout.delimiter, len(layout.names)
    if layout.edges or len(delimiter) > 1 or text.delimiters <= rows * (width - 1):
        return
    with io.TextIOWrapper(text.open(), encoding=text.encoding, errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            cells = len(cells_of(line, delimiter)) if number > layout.skip else 0
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
