"""Where a camera was when it took its images: the `poses` file of a recording of images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.tables import Table

LEAST_DISTANCE = 6.3e6  # m: nobody takes pictures from inside the Earth
MOST_DISTANCE = 1e10  # m, a hundred times the Moon's: beyond it the Earth is a point
_UNIT = 1e-3  # quaternions are printed with four digits
_MOST_SAID = 20  # problems of a kind


@dataclass(frozen=True, eq=False)
class Pose:
    """What is known of one image.

    Attributes
    ----------
    time : UTC, datetime64[us], or None
    position : (3,), m, of the satellite from the Earth's centre, inertial (ECI), or None
    quaternion : (4,), true attitude, scalar last, inertial → body, or None
    """

    time: np.datetime64 | None
    position: np.ndarray | None
    quaternion: np.ndarray | None


def read_poses(table: Table, names: Sequence[str]) -> Mapping[str, Pose]:
    """The poses of the images `names`, by name; those that the table does not have are left out.

    Columns are image, and time, x y z, qx qy qz qw as far as they are known; cells may be empty. An image
    is named by its path in the device folder, or by the last part of it.
    """
    images = [str(name).strip() for name in table.column("image")]
    groups = {
        "position": ("x", "y", "z"),
        "quaternion": ("qx", "qy", "qz", "qw"),
    }
    problems: list[Problem] = []
    values = {}
    for what, columns in groups.items():
        there = [c for c in columns if c in table.names]
        if there and len(there) < len(columns):
            missing = ", ".join(c for c in columns if c not in there)
            problems.append(
                Problem(table.file, missing, f"is missing, and {', '.join(there)} is there",
                        f"a {what} is {' '.join(columns)}")
            )  # fmt: skip
        elif there:
            values[what] = [_numbers(table, c, problems) for c in columns]
    if problems:
        raise InputError(*problems)
    rows: dict[str, Pose] = {}
    wanted = set(names) | {PurePosixPath(name).name for name in names}
    times = table.column("time") if "time" in table.names else None
    for k, image in enumerate(images):
        if image not in wanted:
            continue
        place = f"row {k + 1} ({image})"
        if image in rows:
            problems.append(
                Problem(table.file, place, "is there twice", "leave one row for each image")
            )
        position, quaternion = (
            _vector([column[k] for column in values[what]], what, table.file, place, problems)
            if what in values
            else None
            for what in groups
        )
        time = None if times is None else _time(times[k], table.file, place, problems)
        rows[image] = Pose(time, position, quaternion)
    if problems:
        raise InputError(*problems[:_MOST_SAID])
    found = {name: rows.get(name, rows.get(PurePosixPath(name).name)) for name in names}
    return {name: pose for name, pose in found.items() if pose is not None}


def _numbers(table: Table, column: str, problems: list[Problem]) -> np.ndarray:
    """A column as numbers, NaN where a cell is empty."""
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
            if len(problems) < _MOST_SAID:
                message = f"{text[:40]!r} is no number"
                problems.append(
                    Problem(table.file, f"row {k + 1}, {column}", message, "mend the cell")
                )
    return numbers


def _vector(cells, what: str, file: str, place: str, problems: list[Problem]) -> np.ndarray | None:
    vector = np.array(cells, dtype=float)
    if np.isnan(vector).all():
        return None

    def wrong(message: str, mend: str) -> None:
        problems.append(Problem(file, place, message, mend))

    if not np.isfinite(vector).all():
        wrong(f"its {what} is not complete", "fill all of its cells, or leave all empty")
        return None
    size = np.linalg.norm(vector)
    if what == "quaternion":
        if abs(size - 1) > _UNIT:
            wrong(f"its quaternion has the length {size:.4g}, not 1", "give qx qy qz qw, qw last")
            return None
        return vector / size
    if not LEAST_DISTANCE < size < MOST_DISTANCE:
        where = "inside the Earth" if size <= LEAST_DISTANCE else "beyond any orbit"
        wrong(f"x y z are {size:.4g} m from the Earth's centre, {where}", "give metres, ECI")
        return None
    return vector


def _time(cell: object, file: str, place: str, problems: list[Problem]) -> np.datetime64 | None:
    from sensorbook.parameters import utc

    if isinstance(cell, np.datetime64):
        cell = "" if np.isnat(cell) else str(cell)
    text = str(cell).strip()
    if not text or text == "nan":
        return None
    try:
        return np.datetime64(utc(place, text), "us")
    except InputError as error:
        (problem,) = error.problems
        problems.append(Problem(file, f"{place}: time", problem.message, problem.mend))
        return None
