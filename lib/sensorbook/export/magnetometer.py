"""What the exports of a magnetometer's calibration to autopilots have in common."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from sensorbook.export.calibration import (
    IRON,
    MENDS,
    field_notes,
    part_of,
    same_unit,
    turn_deg,
)
from sensorbook.export.source import Entry
from sensorbook.units import SENSOR_UNITS

SYMMETRIC = 1e-12  # of the largest entry: rounding, far below what any calibration tells


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


def read_iron(results: Entry, target: str) -> Iron:
    """The magnetometer's calibration.

    Raises
    ------
    Absent : where there is none, or it was refused
    InputError : with what is missing or wrong, or where `soft_iron` is not symmetric
    """
    entry = part_of(results, "magnetometer", "calibration", MENDS["magnetometer"])
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
        tuple(lines),
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
