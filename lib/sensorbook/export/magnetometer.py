"""What the exports of a magnetometer's calibration to autopilots have in common."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from sensorbook.errors import InputError, Problem
from sensorbook.export.calibration import (
    IRON,
    MENDS,
    field_notes,
    inert,
    origin,
    same_unit,
    turn_deg,
)
from sensorbook.export.source import Entry
from sensorbook.units import SENSOR_UNITS

SCALED = "check unit and scale of the recording and its [site], and render the report again"
SYMMETRIC = 1e-12  # of the largest entry: rounding, far below what any calibration tells
# ArduPilot reads a file of parameters in pieces of 98 characters, each as a line of its own.
WIDTH = 90
FLOAT32_MAX = 3.4028234663852886e38  # both autopilots hold their parameters in 32 bits


@dataclass(frozen=True)
class Iron:
    """A calibration of the magnetometer, true = soft_iron · (raw − hard_iron).

    Attributes
    ----------
    head : lines of comment
    entry : the calibration
    hard_iron : of x, y, z, T
    diagonal, off_diagonal : of the symmetric soft_iron: xx, yy, zz and xy, xz, yz
    """

    head: tuple[str, ...]
    entry: Entry
    hard_iron: tuple[Entry, ...]
    diagonal: tuple[Entry, ...]
    off_diagonal: tuple[Entry, ...]


@dataclass(frozen=True)
class Group:
    """Three parameters of a target.

    Attributes
    ----------
    name : with {} for X, Y, Z
    entries : what they are made of
    unit : one of the parameter in the entry's unit; negative where the target turns the sign
    low, high : what the target accepts
    """

    name: str
    entries: tuple[Entry, ...]
    unit: float = 1.0
    low: float = -FLOAT32_MAX
    high: float = FLOAT32_MAX


def read_iron(results: Entry, target: str) -> Iron:
    """The magnetometer's calibration.

    Raises
    ------
    InputError : with what is missing, refused or wrong, or where `soft_iron` is not symmetric
    """
    problems, head = [], ()
    try:
        head = origin(results)
    except InputError as error:
        problems += error.problems
    try:
        iron = _iron(results, target, head)
    except InputError as error:
        problems += error.problems
    if problems:
        raise InputError(*dict.fromkeys(problems))
    return iron


def _iron(results: Entry, target: str, head: tuple[str, ...]) -> Iron:
    mend = MENDS["magnetometer"]
    entry = results.at("sensors", "magnetometer", "calibration", mend=mend)
    if entry.value is None:
        raise entry.wrong("is missing", mend)
    if (reason := entry.get("reason")).value is not None:
        raise entry.wrong(f"was refused: {reason.text()}", mend)
    method = entry.at("method").text()
    same_unit(entry.at("unit"), SENSOR_UNITS["magnetometer"])
    entry.at("hard_iron").array(3)
    _check_symmetric(entry.at("soft_iron"), target)
    rows = [row.items() for row in entry.at("soft_iron").items()]
    lines = [f"Magnetometer, method: {method}."]
    if (field := entry.get("field")).value is not None:
        lines.append(f"Length of a corrected reading: {field.number()!r} T.")
    lines += field_notes(entry)
    if (turn := turn_deg(entry)) is not None:
        x, y, z = (f"{angle:.2f}" for angle in turn)
        lines.append(
            "Corrected readings are in the magnetometer's own axes, turned by the rotation vector"
            f" ({x}, {y}, {z}) degrees from the accelerometer's, which these parameters do not take out."
        )
    if results.at("sensors", "magnetometer").get("thermal").value is not None:
        lines.append("The thermal model is not in this file.")
    lines += [
        "",
        f"Of the results: {IRON}.",
        "The offset is subtracted first, then the matrix multiplies the difference; this is not"
        " soft_iron * raw - hard_iron.",
    ]
    return Iron(
        (*head, *lines),
        entry,
        tuple(entry.at("hard_iron").items()),
        tuple(rows[i][i] for i in range(3)),
        tuple(rows[i][j] for i, j in combinations(range(3), 2)),
    )


def _check_symmetric(entry: Entry, target: str) -> None:
    matrix = entry.array(3, 3)
    largest = max(abs(value) for row in matrix for value in row)
    for i, j in combinations(range(3), 2):
        if abs(matrix[i][j] - matrix[j][i]) > SYMMETRIC * largest:
            raise entry.wrong(
                f"is not symmetric ([{i}][{j}] is {matrix[i][j]!r}, [{j}][{i}] is {matrix[j][i]!r}), "
                f"and {target} holds no other",
                "export it as yaml or c-header",
            )


def parameters(
    target: str, groups: tuple[Group, ...], known: Sequence[Problem] = ()
) -> dict[str, float]:
    """Values by name; raises `InputError` with `known` problems and each value out of its range."""
    values, problems = {}, list(known)
    for group in groups:
        for axis, entry in zip("XYZ", group.entries, strict=True):
            name = group.name.format(axis)
            value = entry.number() / group.unit + 0.0  # no negative zero
            values[name] = value
            if not group.low <= value <= group.high:
                problems += entry.wrong(
                    f"{name} would be {value!r}, and {target} accepts "
                    f"{group.low:.6g} to {group.high:.6g}",
                    SCALED,
                ).problems
    if problems:
        raise InputError(*problems)
    return values


def comments(lines: tuple[str, ...]) -> list[str]:
    """Lines that each begin with # and are short, whatever the text holds."""
    wrapped = []
    for line in lines:
        parts = textwrap.wrap(inert(line), WIDTH, break_on_hyphens=False) or [""]
        wrapped += [f"# {part}".rstrip() for part in parts]
    return wrapped
