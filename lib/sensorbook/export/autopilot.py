"""What the exports to autopilots have in common: the parts of a device, ranges, short comments."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from sensorbook.errors import InputError, Problem
from sensorbook.export.calibration import Absent, Refused, inert, origin
from sensorbook.export.magnetometer import Iron, read_iron
from sensorbook.export.source import Attempts, Entry
from sensorbook.export.triad import Triad, read_triad

SCALED = "check unit and scale of the recording and its [site], and render the report again"
# ArduPilot reads a file of parameters in pieces of 98 characters, each as a line of its own.
WIDTH = 90
FLOAT32_MAX = 3.4028234663852886e38  # both autopilots hold their parameters in 32 bits


@dataclass(frozen=True)
class Parts:
    """What there is of a device; `head` are lines of comment about the whole.

    A sensor without a calibration is None, and `head` says why.
    """

    head: tuple[str, ...]
    magnetometer: Iron | None
    accelerometer: Triad | None
    gyroscope: Triad | None


@dataclass(frozen=True)
class Group:
    """Three parameters of a target.

    Attributes
    ----------
    name : with {} for X, Y, Z
    entries : what they are made of
    unit : one of the parameter in the entry's unit; negative where the target turns the sign
    low, high : what the target accepts
    inverse : whether the parameter is one over the entry
    """

    name: str
    entries: tuple[Entry, ...]
    unit: float = 1.0
    low: float = -FLOAT32_MAX
    high: float = FLOAT32_MAX
    inverse: bool = False

    def value(self, entry: Entry) -> float:
        """What the parameter is to be."""
        number = entry.number()
        if self.inverse:
            return 1.0 / number if number else math.inf
        return number / self.unit + 0.0  # no negative zero


READERS = {  # in the order of `Parts`
    "magnetometer": read_iron,
    "accelerometer": lambda results, _: read_triad(results, "accelerometer"),
    "gyroscope": lambda results, _: read_triad(results, "gyroscope"),
}


def read_parts(results: Entry, target: str) -> Parts:
    """The calibrations of a device.

    Raises
    ------
    InputError : with what is wrong in each, or where there is none with why
    """
    attempt, found, absent, notes = Attempts(), {}, [], []
    head = attempt(origin, results) or ()
    results.at("sensors")
    for sensor, read in READERS.items():
        try:
            found[sensor] = read(results, target)
        except Absent as why:
            absent.append(why)
            message = why.problems[0].message.rstrip(".")
            notes.append(f"Not in this file: the {sensor}, whose calibration {message}.")
        except InputError as error:
            attempt.problems += error.problems
    if len(absent) == len(READERS):
        refused = [why for why in absent if isinstance(why, Refused)]
        attempt.problems += [problem for why in refused or absent for problem in why.problems]
    attempt.end()
    return Parts((*head, *notes), *map(found.get, READERS))


def parameters(
    target: str, groups: Sequence[Group], known: Sequence[Problem] = ()
) -> dict[str, float]:
    """Values by name; raises `InputError` with `known` problems and each value out of its range."""
    values, problems = {}, list(known)
    for group in groups:
        for axis, entry in zip("XYZ", group.entries, strict=True):
            name = group.name.format(axis)
            values[name] = value = group.value(entry)
            if not group.low <= value <= group.high:
                problems += entry.wrong(
                    f"{name} would be {value!r}, and {target} accepts "
                    f"{group.low:.6g} to {group.high:.6g}",
                    SCALED,
                ).problems
    if problems:
        raise InputError(*problems)
    return values


def comments(lines: Sequence[str]) -> list[str]:
    """Lines that each begin with # and are short, whatever the text holds."""
    wrapped = []
    for line in lines:
        parts = textwrap.wrap(inert(line), WIDTH, break_on_hyphens=False) or [""]
        wrapped += [f"# {part}".rstrip() for part in parts]
    return wrapped
