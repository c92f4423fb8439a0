"""Tables in files: one interface, one reader a format, chosen by content.

`open_table` gives a `Table`: its column names, and `column(reference)` for the values of one column
as they stand in the file, by name or 0-based index. Adding a format is one reader and one row of
`READERS`.
"""

from __future__ import annotations

import gzip
import hashlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from sensorbook.errors import InputError, Problem

# Declared sizes are not trusted: a few kB can claim or inflate to more than any memory holds.
MAX_BYTES = 4 << 30

NOT_YET = {
    b"PAR1": "Parquet",
    b"SQLite format 3\0": "SQLite",
    b"\x89HDF\r\n\x1a\n": "HDF5 or MATLAB v7.3",
    b"MATLAB 7.3 MAT-file": "MATLAB v7.3",
    b"MATLAB 5.0 MAT-file": "MATLAB v5",
    b"ULog\x01\x12\x35": "PX4 ULog",
    b"#ROSBAG": "ROS bag",
    b"\x89MCAP": "MCAP",
    b"\xd0\xcf\x11\xe0": "Excel",
}


@dataclass
class Table:
    """A table in a file; the columns are parsed when first asked for.

    Parameters
    ----------
    file : name for messages, relative to the device folder
    names : one name a column, in the file's order; "" where the file gives none
    read : parses the columns of these 0-based indices
    sha256 : of the file's bytes
    """

    file: str
    names: tuple[str, ...]
    read: Callable[[Sequence[int]], dict[int, np.ndarray]]
    sha256: str = ""
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
    file = file or path.name
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            Problem(file, "", f"cannot be read: {error.strerror}", "check the file and its rights")
        ) from None
    sha256 = hashlib.sha256(data).hexdigest()
    if data[:2] == b"\x1f\x8b":
        data = _inflate(data, file)
    if not data.strip(b" \t\r\n\0"):
        raise InputError(Problem(file, "", "is empty", "name a file that holds the recording"))
    for magic, name in NOT_YET.items():
        if data.startswith(magic):
            raise InputError(
                Problem(file, "", f"is a {name} file: format not supported yet",
                        "save its columns as .csv or .npz")
            )  # fmt: skip
    opened = next(reader for magic, reader in READERS.items() if data.startswith(magic))(
        data, file, table, wanted
    )
    opened.sha256 = sha256
    return opened


def _inflate(data: bytes, file: str) -> bytes:
    try:
        with gzip.open(io.BytesIO(data)) as stream:
            inflated = stream.read(MAX_BYTES + 1)
    except (OSError, EOFError, gzip.zlib.error):
        raise InputError(
            Problem(file, "", "is a damaged gzip file", "compress or copy it again")
        ) from None
    if len(inflated) > MAX_BYTES:
        raise too_large(file)
    return inflated


def too_large(file: str, where: str = "") -> InputError:
    """The error of a file that would inflate beyond `MAX_BYTES`."""
    return InputError(
        Problem(
            file, where, f"holds more than {MAX_BYTES >> 30} GiB", "split it into several files"
        )
    )


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name[:40]) for name in names[:12])
    return shown + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _read_npz(*arguments) -> Table:
    from sensorbook.recordings.npz import open_npz

    return open_npz(*arguments)


def _read_text(*arguments) -> Table:
    from sensorbook.recordings.text import open_text

    return open_text(*arguments)


# first bytes of the content: reader(data, file, table, wanted); text is what remains
READERS = {b"PK\x03\x04": _read_npz, b"": _read_text}
