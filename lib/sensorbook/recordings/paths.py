"""Where a declared file is: inside the device folder, or nowhere."""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.schema import FILE


def resolve(folder: Path, name: str, where: str) -> Path:
    """The file `name` of a device folder; raises `InputError` unless it is a file within it.

    `name` has passed `checks.file_name`; symbolic links are followed here.
    """

    def wrong(message: str, mend: str) -> InputError:
        return InputError(Problem(FILE, where, f"{name!r} {message}", mend))

    try:
        path = (folder / name).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        there = sorted(p.relative_to(folder).as_posix() for p in folder.glob("*"))
        close = get_close_matches(name, there, n=1)
        mend = f"did you mean {close[0]!r}?" if close else "copy it into the device folder"
        raise wrong("does not exist", mend) from None
    if not path.is_relative_to(folder.resolve()):
        name = _link_out(folder, name)
        raise wrong(
            "is a link that leads out of the device folder", "copy the file into the folder"
        )
    if not path.is_file():
        raise wrong("is not a file", "name the file that holds the recording")
    return path


def _link_out(folder: Path, name: str) -> str:
    """The part of a name that leads out of a folder: a linked folder, or the file itself."""
    place, base = Path(), folder.resolve()
    for part in Path(name).parts:
        place /= part
        if not (folder / place).resolve().is_relative_to(base):
            return place.as_posix()
    return name
