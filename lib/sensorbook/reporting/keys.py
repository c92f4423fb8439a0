"""Keys that tell whether what is there is still what would be made: hashes of all that went into it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import sensorbook
from sensorbook.recordings.device import Device
from sensorbook.recordings.schema import FILE

_FILES = ("file", "segments", "poses")  # the keys of a recording that name files


def of(*parts: Any) -> str:
    """The key of values that JSON can hold."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def of_file(path: Path) -> str:
    """Of what a file holds; "" where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def in_record(path: Path) -> str | None:
    """The key that a chapter's record holds; None where there is none."""
    try:
        return json.loads(path.read_bytes()).get("key")
    except (OSError, ValueError, AttributeError, RecursionError):
        return None


@cache
def of_software() -> str:
    """Of this package's own files, and of the names and versions of all that is installed."""
    package = Path(sensorbook.__file__).parent
    ours = [
        (path.relative_to(package).as_posix(), of_file(path))
        for path in sorted(package.rglob("*"))
        if path.is_file() and path.suffix != ".pyc"
    ]
    theirs = sorted({f"{d.metadata['Name']} {d.version}" for d in distributions()})
    return of(ours, theirs)


def of_device(device: Device) -> str:
    """Of a device's declaration and of every file that it names."""
    bare = device.guessed is not None
    folder = device.path.parent if bare else device.path
    named = {FILE, "truth.json"} if not bare else {device.path.name}
    for declared in device.declared:
        named |= {declared.table.get(key) for key in _FILES} - {None}
    return of([(name, _of_named(folder, name)) for name in sorted(map(str, named))])


def _of_named(folder: Path, name: str) -> Any:
    """Of the file of a name, or of those that a camera's pattern finds."""
    if not any(character in name for character in "*?["):
        return of_file(folder / name)
    found: Iterable[Path] = ()
    try:
        found = sorted(folder.glob(name))
    except (OSError, ValueError, NotImplementedError):  # no pattern: reading tells
        return ""
    return [(path.relative_to(folder).as_posix(), of_file(path)) for path in found]
