"""What a chapter's parameters may be: every value that makes no sense is named, before it does harm."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from sensorbook.errors import InputError, Problem

FILE = "parameters"


@dataclass(frozen=True)
class Range:
    """A number a parameter holds: its name, its unit ("" for none) and its bounds, in that unit."""

    name: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    open: bool = False  # the bounds themselves are no values
    whole: bool = False  # a count or a seed

    def problem(self, where: str, value: Any) -> Problem | None:
        """What is wrong with a value; `where` names the parameter."""
        unit = self.unit if self.unit in ("", "°") else f" {self.unit}"
        number = isinstance(value, int | float) and not isinstance(value, bool)
        inside = self.low < value < self.high if number and self.open else number
        inside = inside and math.isfinite(value) and (not self.whole or value == int(value))
        if inside and (self.open or self.low <= value <= self.high):
            return None
        found = f"{value:g}{unit}" if number else repr(value)
        kind = "a whole number, " if self.whole else ""
        return Problem(FILE, where, f"{self.name} is {found}", f"give {kind}{self._wanted(unit)}")

    def _wanted(self, unit: str) -> str:
        if math.isfinite(self.low) and math.isfinite(self.high):
            ends = ("more than ", " and less than ") if self.open else ("", " to ")
            return f"{ends[0]}{self.low:g}{ends[1]}{self.high:g}{unit}"
        if math.isfinite(self.low):
            return f"more than {self.low:g}{unit}" if self.open else f"{self.low:g}{unit} or more"
        if math.isfinite(self.high):
            return f"less than {self.high:g}{unit}" if self.open else f"{self.high:g}{unit} or less"
        return f"a finite number in {self.unit}" if unit else "a finite number"


@dataclass(frozen=True)
class Choice:
    """One of some texts."""

    choices: tuple[str, ...]

    def problem(self, where: str, value: Any) -> Problem | None:
        """What is wrong with a value; `where` names the parameter."""
        if value in self.choices:
            return None
        return Problem(FILE, where, f"is {value!r}", f"give one of {', '.join(self.choices)}")


def positive(name: str, unit: str = "") -> Range:
    """A number above zero."""
    return Range(name, unit, low=0.0, open=True)


def not_negative(name: str, unit: str = "") -> Range:
    """A number of zero or more: a noise, a bias or an error, which may be none."""
    return Range(name, unit, low=0.0)


def whole(name: str, low: int, high: int) -> Range:
    """A whole number from `low` to `high`: a count or a seed."""
    return Range(name, low=low, high=high, whole=True)


def check(*parameters: tuple[str, Any, Iterable[Range] | Range | Choice]) -> None:
    """Raises one `InputError` with a line for every value that makes no sense.

    `parameters` are (name, value, range) for a number, (name, values, ranges) for a list of them.

    >>> check(("rotor", [24000.0, 0.0], [positive("speed", "rev/min"), positive("radius", "mm")]))
    Traceback (most recent call last):
    ...
    sensorbook.errors.InputError: parameters: rotor: radius is 0 mm — give more than 0 mm
    """
    problems = []
    for where, value, ranges in parameters:
        if isinstance(ranges, Range | Choice):
            problems.append(ranges.problem(where, value))
            continue
        ranges = list(ranges)
        if not isinstance(value, list | tuple) or len(value) != len(ranges):
            names = ", ".join(r.name + (f" [{r.unit}]" if r.unit else "") for r in ranges)
            problems.append(
                Problem(FILE, where, f"is {value!r}", f"give a list of {len(ranges)}: {names}")
            )
            continue
        problems += [r.problem(where, v) for r, v in zip(ranges, value, strict=True)]
    found = [problem for problem in problems if problem]
    if found:
        raise InputError(*found)


def day(where: str, text: str) -> date:
    """The day of a parameter like "2026-01-01"."""
    try:
        return date.fromisoformat(text)
    except (TypeError, ValueError):
        raise InputError(
            Problem(FILE, where, f"{text!r} is no day", 'give year-month-day, as "2026-01-01"')
        ) from None


def utc(where: str, text: str) -> str:
    """The UTC time of a parameter like "2026-05-01T12:00:00", with or without its Z, without it."""
    mend = 'give UTC from 1972 to 2199, as "2026-05-01T12:00:00"'
    plain = str(text).strip().removesuffix("Z").removesuffix("z")
    try:
        year = date.fromisoformat(
            plain[:10]
        ).year  # refuses "now", and offsets that NumPy would turn
        if "+" in plain or plain.count("-") > 2:
            raise ValueError(plain)
        np.datetime64(plain, "us")
    except ValueError:
        raise InputError(Problem(FILE, where, f"{text!r} is no time", mend)) from None
    if not 1972 <= year < 2200:
        raise InputError(Problem(FILE, where, f"{text!r} is before UTC began or too late", mend))
    return plain
