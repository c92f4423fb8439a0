"""An accelerometer's or gyroscope's calibration for targets that cannot hold all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.constants import g as STANDARD_GRAVITY

from sensorbook.export.calibration import MENDS, inverse, part_of, same_unit, square
from sensorbook.export.source import Entry
from sensorbook.units import SENSOR_UNITS


@dataclass(frozen=True)
class Triad:
    """raw = matrix · true + bias + g_sensitivity · acceleration.

    Attributes
    ----------
    head : lines of comment
    entry : the calibration
    bias : of x, y, z, m/s² or rad/s
    diagonal : of the matrix
    matrix, inverse : (3, 3)
    g_sensitivity : (3, 3) rad/s per m/s², zero where none is visible
    """

    head: tuple[str, ...]
    entry: Entry
    bias: tuple[Entry, ...]
    diagonal: tuple[Entry, ...]
    matrix: np.ndarray
    inverse: np.ndarray
    g_sensitivity: np.ndarray


def read_triad(results: Entry, sensor: str) -> Triad:
    """The calibration of an accelerometer or gyroscope.

    Raises
    ------
    Absent : where there is none, or it was refused
    InputError : with what is missing or wrong
    """
    entry = part_of(results, sensor, "calibration", MENDS[sensor])
    lines = [f"{sensor.capitalize()}, method: {entry.at('method').text()}."]
    same_unit(entry.at("unit"), SENSOR_UNITS[sensor])
    entry.at("bias").array(3)
    matrix = entry.at("matrix").array(3, 3)
    sensitivity = entry.get("g_sensitivity")
    reference = entry.get("reference_temperature")
    if reference.value is not None:
        lines.append(f"It holds at {reference.number()!r} degC.")
    if entry.get("temperature").value is not None:
        lines.append("Its change with temperature is not in this file.")
    if results.at("sensors", sensor).get("thermal").value is not None:
        lines.append("The thermal model is not in this file.")
    rows = [row.items() for row in entry.at("matrix").items()]
    return Triad(
        tuple(lines),
        entry,
        tuple(entry.at("bias").items()),
        tuple(rows[i][i] for i in range(3)),
        np.array(matrix),
        np.array(inverse(entry.at("matrix"), matrix)),
        np.zeros((3, 3)) if sensitivity.value is None else np.array(square(sensitivity)),
    )


def left_by_scales(triad: Triad) -> str:
    """What true = (raw - bias)/diagonal leaves of an accelerometer's error, in words.

    >>> from types import SimpleNamespace
    >>> left_by_scales(SimpleNamespace(matrix=np.array([[1, 0, 0], [0.01, 1, 0], [0, 0, 2]])))[:52]
    'Misalignments are lost. Of 1 g, 9.80665 m/s^2, up to'
    """
    part = _largest(triad.matrix / np.diag(triad.matrix)[:, None] - np.eye(3))
    return (
        f"Misalignments are lost. Of 1 g, {STANDARD_GRAVITY} m/s^2, up to"
        f" {part * STANDARD_GRAVITY:.3g} m/s^2 ({1000 * part:.3g} mg) is wrong for them, in the worst"
        " direction."
    )


def left_by_offsets(triad: Triad) -> str:
    """What true = raw - bias leaves of a gyroscope's error, in words."""
    part = _largest(triad.matrix - np.eye(3))
    text = (
        f"Scale factors and misalignments are lost. Up to {100 * part:.3g} % of a rate is wrong for them,"
        " in the worst direction."
    )
    if triad.g_sensitivity.any():
        rate = _largest(triad.g_sensitivity) * STANDARD_GRAVITY
        text += (
            " So is the sensitivity to acceleration: up to"
            f" {rate:.3g} rad/s ({np.degrees(rate):.3g} deg/s) at 1 g."
        )
    return text


def _largest(matrix: np.ndarray) -> float:
    """The longest that the matrix makes of a vector of length 1."""
    return float(np.linalg.norm(matrix, 2))
