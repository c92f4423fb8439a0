"""What was guessed, in words, and as a commented `device.toml` that runs as it is."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from sensorbook.errors import InputError, Problem
from sensorbook.guessing.certainty import Guess
from sensorbook.guessing.guess import Guessed, GuessedRecording, device_id, guess_files
from sensorbook.recordings.bags import storage_file
from sensorbook.recordings.checks import file_name
from sensorbook.recordings.schema import FILE

_HEAD = """\
# Written by sensorbook from the recordings alone. Each value is followed by how sure it is and why:
# mend what is wrong. What `guessed` lists as low, reports warn of; what it lists as not known, they
# refuse: give the value, then delete it from `guessed`.
schema = 1
id = {id}
name = {id}
"""
_TAIL = """
# Where it was recorded, for local gravity, Earth rate and field; every key is optional.
# [site]
# latitude = 39.89                 # deg
# longitude = 32.78                # deg
# height = 900.0                   # m
# date = 2024-05-01
"""
_LIMITS = {  # an example a sensor
    "gyroscope": 'random_walk = { max = 0.30, unit = "deg/sqrt(h)" }',
    "accelerometer": 'random_walk = { max = 0.10, unit = "mg/sqrt(Hz)" }',
    "magnetometer": "residual_percent = { max = 2 }",
}


def new_device(folder: Path, files: Sequence[Path]) -> Guessed:
    """Writes `folder/device.toml` from recordings, which are copied there where they lie elsewhere.

    A folder among `files` is that of a ROS 2 bag, and stands for the recording in it.
    Raises `InputError` before anything is written where one of them cannot be used.
    """
    if (folder / FILE).exists():
        raise InputError(Problem(str(folder / FILE), "", "is there already",
                                 "edit it, or name another folder"))  # fmt: skip
    files = [storage_file(file) or file for file in files]
    names = _names(folder, files)
    guessed = guess_files(files, names)
    made: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for source, name in zip(files, names, strict=True):
            if source.resolve() != (folder / name).resolve():
                made.append(folder / name)
                shutil.copyfile(source, folder / name)
        identity = device_id(folder.resolve().name)
        with tempfile.NamedTemporaryFile("w", dir=folder, encoding="utf-8", delete=False) as aside:
            made.append(Path(aside.name))
            aside.write(device_toml(guessed, identity))
        os.chmod(aside.name, 0o644)
        os.replace(aside.name, folder / FILE)
    except OSError as error:
        for path in made:
            path.unlink(missing_ok=True)
        what = f"cannot be written: {error.strerror}"
        raise InputError(
            Problem(str(error.filename or folder), "", what, "choose another folder")
        ) from None
    return guessed


def _names(folder: Path, files: Sequence[Path]) -> list[str]:
    """How device.toml names the files: relative to the folder; raises where that cannot be."""
    names: list[str] = []
    problems: list[Problem] = []
    for file in files:
        inside = file.resolve().is_relative_to(folder.resolve())
        name = file.resolve().relative_to(folder.resolve()).as_posix() if inside else file.name

        def wrong(message: str, mend: str, file=file) -> None:
            problems.append(Problem(str(file), "", message, mend))

        if not file.is_file():
            wrong("is not a file" if file.exists() else "there is no such file", "name a recording")
        elif fault := file_name(name):
            wrong(fault[0], "rename it")
        elif name in names:
            wrong(f"two files are named {name!r}", "rename one of them")
        elif name == FILE:
            wrong("is what the declaration is named", "rename the recording")
        elif not inside and ((folder / name).exists() or (folder / name).is_symlink()):
            wrong(f"{folder / name} is there already", "name that one, or rename this one")
        names.append(name)
    if problems:
        raise InputError(*problems)
    return names


def device_toml(guessed: Guessed, identity: str) -> str:
    """The text of a `device.toml` that declares what was guessed, each value with its reason."""
    parts = [_HEAD.format(id=_toml(identity))]
    for recording in guessed.recordings:
        reasons = {g.key: f"# {g.certainty}: {_comment(g.reason)}\n" for g in recording.guesses}
        lines = [
            f"{reasons.get(key, '')}{key} = {_toml(value)}\n"
            for key, value in recording.table.items()
        ]
        parts.append("\n[[recording]]\n" + "".join(lines))
    if guessed.left_out:
        parts.append("\n" + "".join(f"# {_comment(text)}\n" for text in guessed.left_out))
    there = {recording.table["sensor"] for recording in guessed.recordings}
    sensor = next((name for name in _LIMITS if name in there), None)
    parts.append(_TAIL)
    if sensor:
        parts.append(
            "\n# Limits to be judged against, named as in results.json.\n"
            f"# [spec.{sensor}]\n# {_LIMITS[sensor]}\n"
        )
    return "".join(parts)


def told(guessed: Guessed) -> Iterator[str]:
    """Lines that show every guess with its certainty and reason."""
    for recording in guessed.recordings:
        yield _comment(_title(recording))
        for guess in recording.guesses:
            line = f"  {guess.key:<16} {_value(guess):<28} {guess.certainty:<9}  {guess.reason}"
            yield _comment(line)  # names of columns may hold anything
    yield from map(_comment, guessed.left_out)


def guess_rows(guessed: Guessed) -> list[dict[str, str]]:
    """Every guess as plain text, for results.json."""
    rows = [
        {
            "file": recording.table["file"],
            "sensor": recording.table["sensor"],
            "key": guess.key,
            "value": _value(guess),
            "confidence": guess.certainty,
            "reason": guess.reason,
        }
        for recording in guessed.recordings
        for guess in recording.guesses
    ]
    left = ("file", "sensor", "value", "confidence")
    return rows + [
        dict.fromkeys(left, "") | {"key": "left out", "reason": text} for text in guessed.left_out
    ]


def _title(recording: GuessedRecording) -> str:
    table = recording.table
    place = f"{table['file']}, {table['table']}" if "table" in table else table["file"]
    return f"{table['sensor']} ({place})"


def _value(guess: Guess) -> str:
    if isinstance(guess.value, dict):
        return ", ".join(f"{axis} {reference}" for axis, reference in guess.value.items())
    return str(guess.value)


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _toml(value: object) -> str:
    """A TOML value: text, number or a table of them on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, str):
        # A JSON string is a TOML basic string, but for DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
