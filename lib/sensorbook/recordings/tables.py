"""Tables in files: one interface, one reader a format, chosen by content.

`open_table` gives a `Table`: its column names, and `column(reference)` for the values of one column
as they stand in the file, by name or 0-based index. A reader is a module with the functions
`open_table(source, table, wanted) -> Table` and `table_names(source)`, and one row of `READERS`; no
file is read whole.
"""

from __future__ import annotations

import gzip
import hashlib
import importlib
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

import numpy as np

from sensorbook.errors import InputError, Problem

# Declared sizes are not trusted: a few kB can claim or inflate to more than any memory holds.
MAX_BYTES = 4 << 30

_DENSEST = 150  # times; readings of a sensor at rest shrink some ten times
_BOMB = 64 << 20  # bytes below which that does not matter
HEAD_BYTES = 1 << 16

# first bytes of the content: the module that reads it; text is what remains
READERS = {
    b"PK\x03\x04": "zipped",
    b"PK\x05\x06": "zipped",
    b"PAR1": "arrow",
    b"ARROW1": "arrow",
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"MATLAB 7.3 MAT-file": "hdf5",
    b"MATLAB 5.0 MAT-file": "matlab",
    b"CDF\x01": "netcdf",
    b"CDF\x02": "netcdf",
    b"CDF\x05": "netcdf",
    b"SQLite format 3\0": "sqlite",
    b"#ROSBAG": "bags",
    b"\x89MCAP": "bags",
    b"\x28\xb5\x2f\xfd": "bags",  # zstd, as ROS 2 compresses whole files: told there
    b"ULog\x01\x12\x35": "ulog",
    b"": "text",
}
NOT_YET = {
    b"FEA1": "Feather v1",
    b"\xd0\xcf\x11\xe0": "Excel",
}
NO_TABLE = {
    b"\xff\xd8\xff": "a JPEG image",
    b"\x89PNG": "a PNG image",
    b"GIF8": "a GIF image",
    b"%PDF": "a PDF document",
}


@dataclass(frozen=True)
class Source:
    """A file to read a table from: nothing of it is held but its beginning.

    Attributes
    ----------
    path : the file
    file : its name for messages
    head : its first 64 KiB, inflated where it is compressed
    gzip : True where it is compressed: `open` inflates, other readers refuse it
    """

    path: Path
    file: str
    head: bytes
    gzip: bool

    def open(self) -> BinaryIO:
        """The content, inflated, from its beginning."""
        return gzip.open(self.path) if self.gzip else self.path.open("rb")

    def chunks(self, size: int = 1 << 20) -> Iterator[bytes]:
        """The content in pieces; raises `InputError` where it cannot be inflated or is too large."""
        total, size_on_disk = 0, self.path.stat().st_size
        with self.open() as stream:
            while chunk := _inflated(stream.read, size, self.file):
                total += len(chunk)
                if self.gzip and total > MAX_BYTES:
                    raise too_large(self.file)
                if self.gzip and total > _BOMB and total > _DENSEST * size_on_disk:
                    raise self.wrong(f"inflates more than {_DENSEST} times, as no recording does",
                                     "look at what it holds, and save it uncompressed")  # fmt: skip
                yield chunk

    def wrong(self, message: str, mend: str, where: str = "") -> InputError:
        """What to raise where the file cannot serve."""
        return InputError(Problem(self.file, where, message, mend))

    def sha256(self) -> str:
        """Of the file's bytes as they are."""
        with self.path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()


@dataclass
class Table:
    """A table in a file; the columns are parsed when first asked for.

    Parameters
    ----------
    file : name for messages, relative to the device folder
    names : one name a column, in the file's order; "" where the file gives none
    read : parses the columns of these 0-based indices
    sha256 : of the file's bytes
    units : units that the file itself declares, one a column, "" where it does not; () for none
    notes : lines before a text file's table
    losses : what the file itself says was lost while it was recorded, in words
    missing : how a file of this format says that a value is not given, in words
    """

    file: str
    names: tuple[str, ...]
    read: Callable[[Sequence[int]], dict[int, np.ndarray]]
    sha256: str = ""
    units: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    missing: str = ""
    _parsed: dict[int, np.ndarray] = field(default_factory=dict)

    def index(self, reference: str | int) -> int:
        """0-based index of the column of this name or index; raises `InputError` where absent."""
        if isinstance(reference, int):
            if 0 <= reference < len(self.names):
                return reference
            mend = f"the file has {len(self.names)} columns, 0 to {len(self.names) - 1}"
        elif self.names.count(reference) == 1:
            return self.names.index(reference)
        elif reference in self.names:
            mend = "several columns have this name: give the 0-based index"
            raise InputError(Problem(self.file, f"column {reference!r}", "is ambiguous", mend))
        else:
            close = get_close_matches(str(reference), self.names, n=1, cutoff=0.5)
            named = [name for name in self.names if name]
            mend = f"did you mean {close[0]!r}? " if close else ""
            mend += f"columns: {_listed(named)}" if named else "the file names no columns: "
            mend += "" if named else f"use indices 0 to {len(self.names) - 1}"
        raise InputError(
            Problem(self.file, f"column {reference!r}", "there is no such column", mend)
        )

    def column(self, reference: str | int) -> np.ndarray:
        """(N,) values as they stand in the file: numbers, or text where the file holds text."""
        index = self.index(reference)
        self.parse([reference])
        return self._parsed[index]

    def parse(self, references: Sequence[str | int]) -> None:
        """Parses these columns at one go, which is quicker; absent ones are passed over."""
        wanted = set()
        for reference in references:
            try:
                wanted.add(self.index(reference))
            except InputError:
                continue
        if wanted := sorted(wanted - self._parsed.keys()):
            self._parsed.update(self.read(wanted))


def open_table(
    path: Path, file: str = "", table: str | None = None, wanted: Sequence[str | int] = ()
) -> Table:
    """Opens the table in a file, whatever its format; raises `InputError` where it cannot be read.

    Parameters
    ----------
    path : the file
    file : its name for messages; default, the path's last part
    table : which table, variable or array of the file, where it holds several
    wanted : names of columns expected, which help to tell the header from a line of units
    """
    source, reader = source_of(path, file or path.name)
    opened = reader.open_table(source, table, wanted)
    opened.sha256 = source.sha256()
    return opened


def table_names(path: Path, file: str = "") -> tuple[str, ...]:
    """What `table` may be for this file; () where it is a single table."""
    source, reader = source_of(path, file or path.name)
    return reader.table_names(source)


def source_of(path: Path, file: str) -> tuple[Source, ModuleType]:
    """The file and the module that reads its format."""
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
        compressed = head[:2] == b"\x1f\x8b"
        if compressed:
            with gzip.open(path) as stream:
                head = _inflated(stream.read, HEAD_BYTES, file)
    except OSError as error:
        raise InputError(
            Problem(file, "", f"cannot be read: {error.strerror}", "check the file and its rights")
        ) from None
    source = Source(path, file, head, compressed)
    if not head.strip(b" \t\r\n\0"):
        if any(chunk.strip(b" \t\r\n\0") for chunk in source.chunks()):
            raise source.wrong("begins with 64 KiB of nothing", "copy it again, or cut it off")
        raise source.wrong("is empty", "name a file that holds the recording")
    # A file cut within its first bytes could pass for text.
    if len(head) > 3 and any(len(head) < len(m) and m.startswith(head) for m in READERS):
        raise source.wrong("is cut off", "copy it again")
    for magic, name in NOT_YET.items():
        if head.startswith(magic):
            raise source.wrong(
                f"is a {name} file: format not supported yet", "save its columns as .csv or .npz"
            )
    for magic, name in NO_TABLE.items():
        if head.startswith(magic):
            mend = "name a file that holds the recording"
            if name.endswith("image"):
                mend += "; a camera's images need a device.toml that tells the camera"
            raise source.wrong(f"is {name}, not a table", mend)
    module = next(module for magic, module in READERS.items() if head.startswith(magic))
    if compressed and module != "text":
        raise source.wrong("is a compressed binary file", "inflate it first: gunzip")
    return source, importlib.import_module(f"sensorbook.recordings.{module}")


def _inflated(read: Callable[[int], bytes], size: int, file: str) -> bytes:
    try:
        return read(size)
    except EOFError:
        raise InputError(
            Problem(file, "", "is a gzip file that is cut off", "copy it again")
        ) from None
    except (OSError, zlib.error) as error:
        if isinstance(error, OSError) and error.errno:
            mend = "check the file and its rights"
            raise InputError(Problem(file, "", f"cannot be read: {error.strerror}", mend)) from None
        raise InputError(
            Problem(file, "", "is a damaged gzip file", "compress or copy it again")
        ) from None


def too_large(file: str, where: str = "") -> InputError:
    """The error of a file that would inflate beyond `MAX_BYTES`."""
    return InputError(
        Problem(
            file, where, f"holds more than {MAX_BYTES >> 30} GiB", "split it into several files"
        )
    )


def extended(column: np.ndarray, part: np.ndarray) -> np.ndarray:
    """A column with its next piece: integers where all are, text where any is."""
    if not (rows := len(column)):
        return part.copy()
    numeric = part.dtype.kind in "iuf" and column.dtype.kind in "iuf"
    column = column.astype(np.result_type(column, part) if numeric else object, copy=False)
    # In place: pieces joined at the end would hold the columns twice.
    column.resize(rows + len(part), refcheck=False)
    column[rows:] = part
    return column


def choose(source: Source, table: str | None, there: Sequence[str], what: str) -> str:
    """Which of a file's tables is meant: the one named, or the only one.

    `what` names them in messages, such as "variable".
    """
    listed = f"{what}s: {_listed(there)}" if there else f"it holds no {what} of samples"
    if table is None and len(there) == 1:
        return there[0]
    if table is None:
        mend = f'say which with table = "…"; {listed}' if there else "name another file"
        raise source.wrong(f"holds {len(there) or 'no'} {what}s of samples", mend)
    if table not in there:
        raise source.wrong(f"there is no such {what}", listed, f"table {table!r}")
    return table


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name[:40]) for name in names[:12])
    return shown + (f" and {len(names) - 12} more" if len(names) > 12 else "")
