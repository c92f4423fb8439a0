"""Where a camera was when it took its images: the `poses` file of a recording of images."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.recording import Finding
from sensorbook.recordings.tables import Table

LEAST_DISTANCE = 6.3e6  # m: nobody takes pictures from inside the Earth
MOST_DISTANCE = 1e10  # m, a hundred times the Moon's: beyond it the Earth is a point
POSITION, QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
COLUMNS = ("image", "time", *POSITION, *QUATERNION)
_UNIT = 1e-3  # quaternions are printed with four digits
_MOST_SAID = 20  # problems of a file
_BRACKETED = re.compile(r"(.*?)[\[(]([^\])]*)[\])]")
_METRES = ("m", "metre", "metres", "meter", "meters")
_OFFSET = re.compile(r".*\d[ tT]?\d\d:\d\d.*[+-]\d\d(:?\d\d)?")


@dataclass(frozen=True, eq=False)
class Pose:
    """What is known of one image.

    Attributes
    ----------
    time : UTC, datetime64[us], or None
    position : (3,), m, of the satellite from the Earth's centre, inertial (ECI), or None
    quaternion : (4,), true attitude, scalar last, inertial → body, or None
    row : what the file calls the image
    """

    time: np.datetime64 | None
    position: np.ndarray | None
    quaternion: np.ndarray | None
    row: str = ""


def read_poses(
    table: Table, names: Sequence[str], earth: np.ndarray | None = None
) -> tuple[Mapping[str, Pose], list[Finding]]:
    """The poses of the images `names`, by name, without those that the table does not have; findings.

    Columns are image, and time, x y z, qx qy qz qw as far as they are known; cells may be empty. An image
    is named by its path in the device folder, or by the last part of it. `earth` holds the semi-axes of
    the Earth that the camera sees, m; without it a sphere just below the Earth's surface stands for it.
    """
    problems: list[Problem] = []
    columns, unread = _columns(table, problems)
    if "image" not in columns:
        problems.append(
            Problem(
                table.file, "image", "there is no such column", f"columns are {', '.join(COLUMNS)}"
            )
        )
        raise InputError(*problems)
    images = [str(name).strip() for name in table.column(columns["image"])]
    values, bad = {}, {}
    for what, group in (("position", POSITION), ("quaternion", QUATERNION)):
        there = [c for c in group if c in columns]
        if there and len(there) < len(group):
            missing = ", ".join(c for c in group if c not in there)
            problems.append(
                Problem(table.file, missing, f"is missing, and {', '.join(there)} is there",
                        f"a {what} is {' '.join(group)}")
            )  # fmt: skip
        elif there:
            bad[what] = set()
            values[what] = [_numbers(table, columns[c], problems, bad[what]) for c in group]
    rows: dict[str, Pose] = {}
    lasts = [PurePosixPath(name).name for name in names]
    wanted = set(names) | set(lasts)
    times = table.column(columns["time"]) if "time" in columns else None
    earth = np.full(3, LEAST_DISTANCE) if earth is None else earth
    for k, image in enumerate(images):
        if image not in wanted:
            continue
        place = f"row {k + 1} ({image})"
        if image in rows:
            problems.append(
                Problem(table.file, place, "is there twice", "leave one row for each image")
            )

        def vector(what: str, k=k, place=place) -> np.ndarray | None:
            if what not in values or k in bad[what]:
                return None
            cells = [column[k] for column in values[what]]
            return _vector(cells, what, earth, table.file, place, problems)

        time = None if times is None else _time(times[k], table.file, place, problems)
        rows[image] = Pose(time, vector("position"), vector("quaternion"), image)
    if problems:
        raise InputError(*limited(problems))
    found = {name: rows.get(name, rows.get(last)) for name, last in zip(names, lasts, strict=True)}
    return {name: pose for name, pose in found.items() if pose is not None}, _unread(
        table.file, unread
    )


def limited(problems: Sequence[Problem]) -> list[Problem]:
    """The first of many problems of one file, and how many more there are."""
    if (more := len(problems) - _MOST_SAID) <= 0:
        return list(problems)
    last = Problem(problems[-1].file, "", f"and {more} more problems", "mend those above first")
    return [*problems[:_MOST_SAID], last]


def _columns(table: Table, problems: list[Problem]) -> tuple[dict[str, str], list[str]]:
    """The table's own names of the columns that are read, and the names of those that are not.

    Case, blanks and a bracketed unit that is the right one make no difference.
    """
    found: dict[str, str] = {}
    unread = []
    for name in table.names:
        bracketed = _BRACKETED.fullmatch(name.strip())
        plain, unit = bracketed.groups() if bracketed else (name, "")
        plain, unit = "".join(plain.split()).lower(), unit.strip()
        if plain not in COLUMNS:
            unread.append(name)
        elif plain in found:
            problems.append(
                Problem(table.file, f"column {name!r}", f"{plain} is {found[plain]!r} already",
                        "rename one of the two")
            )  # fmt: skip
        else:
            found[plain] = name
            if wanted := _other_unit(plain, unit):
                problems.append(
                    Problem(table.file, f"column {name!r}", f"is declared in {unit!r}", wanted)
                )
    return found, unread


def _other_unit(column: str, unit: str) -> str:
    """How to mend a unit that is none of this column's; "" where it is."""
    if not unit:
        return ""
    if column in POSITION:
        return "" if unit in _METRES else f"give metres, ECI, and name it {column} [m]"
    if column == "time":
        return "" if unit.lower() == "utc" else "give UTC, and name it time (UTC)"
    return "" if unit in ("-", "1") else f"it has no unit: name it {column}"


def _unread(file: str, columns: Sequence[str]) -> list[Finding]:
    if not columns:
        return []
    named = ", ".join(repr(name[:40]) for name in columns[:6])
    more = f" and {len(columns) - 6} more" if columns[6:] else ""
    verb = "is" if len(columns) == 1 else "are"
    message = f"{named}{more} {verb} not read"
    return [Finding(file, "columns", "pose", message, f"those read are {', '.join(COLUMNS)}")]


def _numbers(table: Table, column: str, problems: list[Problem], bad: set[int]) -> np.ndarray:
    """A column as numbers, NaN where a cell is empty; rows whose cell is no number go into `bad`."""
    cells = table.column(column)
    if cells.dtype.kind in "iuf":
        return cells.astype(float)
    numbers = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        text = str(cell).strip()
        if not text:
            continue
        try:
            numbers[k] = float(text)
        except ValueError:
            bad.add(k)
            message = f"{text[:40]!r} is no number"
            problems.append(Problem(table.file, f"row {k + 1}, {column}", message, "mend the cell"))
    return numbers


def _vector(
    cells, what: str, earth: np.ndarray, file: str, place: str, problems: list[Problem]
) -> np.ndarray | None:
    vector = np.array(cells, dtype=float)
    if np.isnan(vector).all():
        return None

    def wrong(message: str, mend: str) -> None:
        problems.append(Problem(file, place, message, mend))

    if np.isinf(vector).any():
        wrong(f"its {what} is infinite", "give finite numbers, or leave all of its cells empty")
        return None
    if np.isnan(vector).any():
        wrong(f"its {what} is not complete", "fill all of its cells, or leave all empty")
        return None
    size = np.linalg.norm(vector)
    if what == "quaternion":
        if abs(size - 1) > _UNIT:
            wrong(f"its quaternion has the length {size:.4g}, not 1", "give qx qy qz qw, qw last")
            return None
        return vector / size
    inside = np.linalg.norm(vector / earth) <= 1
    if inside or size >= MOST_DISTANCE:
        where = "inside the Earth" if inside else "beyond any orbit"
        wrong(f"x y z are {size:.6g} m from the Earth's centre, {where}", "give metres, ECI")
        return None
    return vector


def _time(cell: object, file: str, place: str, problems: list[Problem]) -> np.datetime64 | None:
    from sensorbook.parameters import utc

    if isinstance(cell, np.datetime64):
        cell = "" if np.isnat(cell) else str(cell)
    text = str(cell).strip()
    if not text or text == "nan":
        return None
    if _OFFSET.fullmatch(text):
        message, mend = f"{text!r} is local time", 'give UTC, as "2026-05-01T12:00:00"'
        problems.append(Problem(file, f"{place}: time", message, mend))
        return None
    try:
        return np.datetime64(utc(place, text), "us")
    except InputError as error:
        (problem,) = error.problems
        problems.append(Problem(file, f"{place}: time", problem.message, problem.mend))
        return None
