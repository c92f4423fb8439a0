"""ZIP archives: NumPy's (.npz), and the texts of phone recorders, each a table named by its member.

A member is read where it lies; nothing is unpacked to the disk.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

from sensorbook.errors import InputError
from sensorbook.recordings import npz, tables, text
from sensorbook.recordings.checks import shown
from sensorbook.recordings.tables import HEAD_BYTES, Source, Table, choose, too_large

_ERRORS = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError,
           RuntimeError, OverflowError, MemoryError)  # fmt: skip
_MOST = 1000  # members
_NESTED = (
    b"PK\x03\x04",
    b"\x1f\x8b",
    b"BZh",
    b"\xfd7zXZ",
    b"7z\xbc\xaf",
    b"Rar!",
    b"\x28\xb5\x2f\xfd",
)


@dataclass(frozen=True)
class _Member(Source):
    """A member of an archive in the place of a file; `name` is its name in the archive."""

    name: str = ""

    def open(self) -> BinaryIO:
        with zipfile.ZipFile(self.path) as archive:  # the stream keeps its file open
            return archive.open(self.name)

    def chunks(self, size: int = 1 << 20) -> Iterator[bytes]:
        """The content in pieces, its check sum looked at; raises `InputError` where it is damaged."""
        total = 0
        with zipfile.ZipFile(self.path) as archive:
            packed = archive.getinfo(self.name).compress_size
        with self.open() as stream:
            while True:
                try:
                    chunk = stream.read(size)
                except _ERRORS:
                    raise self.wrong("is damaged", "copy the archive again") from None
                if not chunk:
                    return
                total += len(chunk)
                if total > tables.MAX_BYTES:
                    raise too_large(self.file)
                if total > tables._BOMB and total > tables._DENSEST * packed:
                    raise self.wrong(f"inflates more than {tables._DENSEST} times, as no recording does",
                                     "look at what it holds, and save it alone")  # fmt: skip
                yield chunk


def table_names(source: Source) -> tuple[str, ...]:
    """The members that hold a table of numbers; none in NumPy's archives, which are one table."""
    return npz.table_names(source) if _is_npz(source) else tuple(_texts(source))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens one member's table, such as "Gyroscope.csv"."""
    if _is_npz(source):
        return npz.open_table(source, table, wanted)
    named = [m for m in _members(source) if m.name == table and not m.head.startswith(_NESTED)]
    if not named:
        if not (texts := _texts(source)):
            raise source.wrong("holds no text with rows of numbers",
                               "unpack it, and name the recordings")  # fmt: skip
        named = [texts[choose(source, table, list(texts), "file")]]
    opened = text.open_table(named[0], None, wanted)
    opened.file = source.file
    return opened


def _is_npz(source: Source) -> bool:
    """True where the first member is an array (APPNOTE.TXT 6.3.10, 4.3.7)."""
    length = int.from_bytes(source.head[26:28], "little")
    return source.head[30 : 30 + length].endswith(b".npy")


def _texts(source: Source) -> dict[str, _Member]:
    """The members that hold a table of numbers, by name, in the archive's order."""
    texts, nested = {}, []
    for member in _members(source):
        if member.head.startswith(_NESTED):
            nested.append(member.name)
        elif text.has_table(member):
            texts[member.name] = member
    if nested and not texts:
        raise source.wrong(f"holds archives in an archive ({shown(nested[0])})",
                           "unpack it, and name the recordings")  # fmt: skip
    return texts


def _members(source: Source) -> Iterator[_Member]:
    """Every file of an archive that is safe to read, with its beginning."""
    try:
        with zipfile.ZipFile(source.path) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
            _check(source, entries)
            if not npz.is_whole(source, archive):
                raise zipfile.BadZipFile
            for entry in entries:
                with archive.open(entry) as stream:
                    head = stream.read(HEAD_BYTES)
                if "__MACOSX" not in entry.filename:  # beside each file what its Finder knows of it
                    label = f"{source.file}, {entry.filename[:60]}"
                    yield _Member(source.path, label, head, False, entry.filename)
    except InputError:
        raise
    except _ERRORS:
        raise source.wrong(
            "is a damaged ZIP archive, or one that is cut off", "copy it again"
        ) from None


def _check(source: Source, entries: Sequence[zipfile.ZipInfo]) -> None:
    """Raises for what is no archive of recordings, and for what is not safe to unpack."""
    names = [entry.filename for entry in entries]
    if not names:
        raise source.wrong("is an empty archive", "name a file that holds the recording")
    if "[Content_Types].xml" in names:
        raise source.wrong("is an Excel file: format not supported yet", "save it as .csv")
    if len(names) > _MOST:
        raise source.wrong(f"holds {len(names)} files", "unpack it, and name the recordings")
    if len(set(names)) < len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise source.wrong(f"holds two files named {shown(twice)}", "make the archive anew")
    for entry in entries:
        name = entry.filename
        if re.match(r"[/\\]|[A-Za-z]:", name) or ".." in re.split(r"[/\\]", name):
            raise source.wrong(f"holds a file whose name leads out of it, {shown(name)}",
                               "do not unpack it: make the archive anew")  # fmt: skip
        if entry.flag_bits & 1:
            raise source.wrong(f"holds a file that is encrypted, {shown(name)}",
                               "unpack it with its password, and name the recordings")  # fmt: skip
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise source.wrong(f"holds a file packed by another method than deflate, {shown(name)}",
                               "unpack it, and name the recordings")  # fmt: skip
