"""The report folder: files appear whole or not at all, and never outside of it."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
import uuid
from pathlib import Path


class Tree:
    """The folder that reports are written into; `aside` holds what is not complete yet."""

    def __init__(self, out: str | Path):
        self.root = Path(out).resolve()
        self.root.mkdir(parents=True, exist_ok=True)
        mine = f".partial-{socket.gethostname()}-"
        for stale in self.root.glob(f"{mine}*"):
            process = stale.name.removeprefix(mine).split("-")[0]
            if process.isdigit() and not _is_running(int(process)):
                shutil.rmtree(stale, ignore_errors=True)
        self.aside = Path(tempfile.mkdtemp(prefix=f"{mine}{os.getpid()}-", dir=self.root))

    def __enter__(self) -> Tree:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.aside, ignore_errors=True)

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
        name.write_text(text, encoding="utf-8", errors="backslashreplace")
        os.replace(name, path)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
