"""The elements of a MATLAB v5 file, checked before scipy reads them: it looks up unknown types in memory.

A file is a header of 128 bytes and elements, each with its type and size in bytes; type 14 is a
matrix, which holds elements, and type 15 is one compressed (MATLAB's MAT-File Format, 2022, 1-5).
"""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO, Protocol

from sensorbook.errors import InputError
from sensorbook.recordings.tables import Source, too_large

_MATRIX, _COMPRESSED = 14, 15
_KINDS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, _MATRIX, 16, 17, 18}
_FLAGS = 6
_SPARSE, _PLAIN = 5, range(4, 16)  # classes: text, sparse and numbers
_DEEPEST = 32
_PIECE = 1 << 20


def check_elements(source: Source, most: int) -> None:
    """Raises `InputError` where the file is cut off or damaged, or inflates to more than `most` bytes."""
    size = source.path.stat().st_size
    order = "<" if source.head[126:128] == b"IM" else ">"
    try:
        with source.path.open("rb") as stream:
            at, inflated = 128, 0
            while at + 8 <= size:
                stream.seek(at)
                kind, length = struct.unpack(f"{order}II", stream.read(8))
                at += 8 + length
                if at > size:
                    raise source.wrong("is cut off", "copy it again")
                if kind == _COMPRESSED:
                    content = _Inflated(source, stream, length, most - inflated)
                    _walk(content, order, _length(content, order))
                    inflated += content.finish()
                elif kind == _MATRIX:
                    _walk(_Plain(stream), order, length)
    except (zlib.error, EOFError, ValueError, struct.error) as error:
        if isinstance(error, InputError):
            raise
        raise damaged(source) from None


def damaged(source: Source) -> InputError:
    return source.wrong("is a damaged MATLAB file, or one that is cut off", "save or copy it again")


class _Bytes(Protocol):
    def read(self, count: int) -> bytes: ...
    def skip(self, count: int) -> None: ...


class _Plain:
    def __init__(self, stream: BinaryIO):
        self._stream = stream

    def read(self, count: int) -> bytes:
        return self._stream.read(count)

    def skip(self, count: int) -> None:
        self._stream.seek(count, 1)


class _Inflated:
    """The content of a compressed element, `length` bytes from where the stream stands."""

    def __init__(self, source: Source, stream: BinaryIO, length: int, most: int):
        self._source, self._stream, self._left, self._most = source, stream, length, most
        self._inflate, self._held, self._total = zlib.decompressobj(), b"", 0

    def _next(self) -> bytes:
        chunk = self._inflate.unconsumed_tail
        if not chunk:
            chunk = self._stream.read(min(self._left, _PIECE))
            self._left -= len(chunk)
        if not chunk or self._inflate.eof:
            raise EOFError
        out = self._inflate.decompress(chunk, _PIECE)
        self._total += len(out)
        if self._total > self._most:
            raise too_large(self._source.file)
        return out

    def read(self, count: int) -> bytes:
        while len(self._held) < count:
            self._held += self._next()
        out, self._held = self._held[:count], self._held[count:]
        return out

    def skip(self, count: int) -> None:
        while len(self._held) < count:
            count -= len(self._held)
            self._held = self._next()
        self._held = self._held[count:]

    def finish(self) -> int:
        """Bytes inflated to the end, where the check sum is compared."""
        while not self._inflate.eof:
            self._next()
        return self._total


def _length(content: _Bytes, order: str) -> int:
    """Bytes of the one matrix that a compressed element holds."""
    kind, length = struct.unpack(f"{order}II", content.read(8))
    if kind != _MATRIX:
        raise ValueError(kind)
    return length


def _walk(content: _Bytes, order: str, length: int, depth: int = 0) -> None:
    """Steps over a matrix of `length` bytes; raises `ValueError` where its elements are none.

    Its first element are its flags, with its class; numbers have their values after flags, dimensions
    and name, and the imaginary ones if flagged. scipy does not ask whether they are there.
    """
    kinds, flags = [], 0
    if depth > _DEEPEST:
        raise ValueError(depth)
    while length > 0:
        word, size = struct.unpack(f"{order}II", content.read(8))
        length -= 8
        is_small = word >> 16  # its size; the second word is its content
        kind = word & 0xFFFF if is_small else word
        if kind not in _KINDS or is_small > 4 or (size > length and not is_small):
            raise ValueError(kind)
        kinds.append(kind)
        if len(kinds) == 1:
            if kind != _FLAGS or size != 8 or is_small:
                raise ValueError(kind)
            flags, _ = struct.unpack(f"{order}II", content.read(8))
            length -= 8
        elif not is_small:
            padding = min(-size % 8, length - size)
            if kind == _MATRIX:
                _walk(content, order, size, depth + 1)
                content.skip(padding)
            else:
                content.skip(size + padding)
            length -= size + padding
    kind = flags & 0xFF
    if kind in _PLAIN:
        values = (3 if kind == _SPARSE else 1) + (flags >> 11 & 1)  # and whether it is complex
        if len(kinds) != 3 + values or _MATRIX in kinds:
            raise ValueError(kind)
