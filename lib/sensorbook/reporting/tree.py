"""The report folder: files appear whole or not at all, and never outside of it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import socket
import tempfile
import uuid
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path


class Tree:
    """The folder that reports are written into; `aside` holds what is not complete yet."""

    def __init__(self, out: str | Path):
        self.root = Path(out).resolve()

    def __enter__(self) -> Tree:
        return self

    def __exit__(self, *_: object) -> None:
        if "aside" in vars(self):
            shutil.rmtree(self.aside, ignore_errors=True)

    @cached_property
    def aside(self) -> Path:
        """A folder of this process's, which goes when the tree is closed."""
        self.root.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=f"{_prefix()}{os.getpid()}-", dir=self.root))

    def tidy(self) -> None:
        """Removes what processes of this machine left aside that were ended before they could."""
        for stale in self.root.glob(f"{_prefix()}*"):
            process = stale.name.removeprefix(_prefix()).split("-")[0]
            if process.isdigit() and not _is_running(int(process)):
                shutil.rmtree(stale, ignore_errors=True)

    @contextlib.contextmanager
    def locked(self, name: str, waits: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Holds a folder of the tree against other runs; `waits` is called where one holds it now.

        A file system that cannot lock a folder, as NFS, lets both go on: files are whole all the same.
        """
        place = os.open(self.root / name, os.O_RDONLY)
        try:
            with contextlib.suppress(OSError):
                try:
                    fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    waits()
                    fcntl.flock(place, fcntl.LOCK_EX)
            yield
        finally:
            os.close(place)

    def folder(self, *parts: str) -> Path:
        """A subfolder, made when missing; a link to elsewhere is refused."""
        path = self.root.joinpath(*parts)
        if path.resolve() != path:
            raise OSError(f"{path} is a symbolic link that leads elsewhere; remove it first")
        path.mkdir(parents=True, exist_ok=True)
        return path

    def write(self, path: Path, text: str) -> None:
        """Writes a file aside, then moves it to its place."""
        name = self.aside / uuid.uuid4().hex
        try:
            name.write_text(text, encoding="utf-8", errors="backslashreplace")
        except OSError as error:  # a full disk, which Python names no file for
            raise OSError(error.errno, error.strerror, str(path)) from None
        os.replace(name, path)


def _prefix() -> str:
    return f".partial-{socket.gethostname()}-"


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
        # Ended, but its parent has yet to read how: to `kill` it is still there.
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        return state not in ("Z", "X")
    except ProcessLookupError:
        return False
    except OSError:  # another user's, or a system without /proc
        return True
