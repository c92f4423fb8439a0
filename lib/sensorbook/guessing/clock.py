"""The time of a table: which column, in which unit, or how fast it was sampled at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.guessing.certainty import CERTAINTIES, HIGH, LOW, MEDIUM, UNKNOWN
from sensorbook.guessing.columns import Column
from sensorbook.units import factor

_USUAL_RATES = (0.5, 8000.0)  # Hz, of the sensors this is for
# Stamps counted from 1970, 2001 to 2065: a number of this size can be nothing else.
_SINCE_1970 = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_NOTED_RATE = re.compile(
    r"(?:sampl\w*|update|output|data)?[ _-]*(?:rate|frequency|freq|fs|odr)\b[^0-9\n]{0,20}"
    r"(\d+(?:\.\d+)?)\s*(k?hz|sps)?",
    re.I,
)


@dataclass(frozen=True)
class Clock:
    """When the samples were taken.

    Attributes
    ----------
    column : the time's, or None
    unit : of the time, "" without a column
    step : s from sample to sample, or None where it is not known
    certainty, reason : of the unit, or of the rate where there is no column
    """

    column: Column | None
    unit: str
    step: float | None
    certainty: str
    reason: str

    @property
    def rate(self) -> float | None:
        """Hz."""
        return None if not self.step else float(f"{1 / self.step:.6g}")


NO_CLOCK = Clock(None, "", None, UNKNOWN, "no column holds a time, and nothing else tells the rate")


def find_clock(times: Sequence[Column], counters: Sequence[Column], notes: Sequence[str]) -> Clock:
    """The clock of a table; among several times the one that its name, then its resolution favours."""
    found = [clock for column in times if (clock := _of_column(column)) is not None]
    if found:
        return min(found, key=lambda c: (c.column is None, CERTAINTIES.index(c.certainty)))
    for note in notes:
        if match := _NOTED_RATE.search(note):
            rate = float(match[1]) * (1000 if (match[2] or "").lower() == "khz" else 1)
            if _USUAL_RATES[0] <= rate <= _USUAL_RATES[1]:
                sure = HIGH if match[2] else MEDIUM
                said = " ".join(note.split())[:60]
                return Clock(None, "", 1 / rate, sure, f"the file's head says so: {said!r}")
    if counters:
        reason = f"{counters[0].shown} counts samples and no column holds a time"
        return Clock(None, "", None, UNKNOWN, reason)
    return NO_CLOCK


def _of_column(column: Column) -> Clock | None:
    values = column.values[np.isfinite(column.values)]
    steps = np.diff(values)
    steps = steps[steps > 0]
    if not len(steps):
        return None
    step = float(np.median(steps))
    if _coarse(values):
        return _of_coarse(column, values)
    if column.stamps:
        return Clock(column, "", step, HIGH, "it holds dates and times of day")
    if unit := column.named.unit:
        rate = 1 / (step * factor(unit, "s"))
        return Clock(column, unit, step * factor(unit, "s"), HIGH,
                     f"its name gives the unit; the stamps step by {step:.6g} {unit}, {rate:.5g} Hz")  # fmt: skip
    for unit, si in _SINCE_1970.items():
        if 9.8e8 < values[0] * si < 3e9 and _USUAL_RATES[0] / 10 < 1 / (step * si) < 1e5:
            return Clock(column, unit, step * si, HIGH, f"counted from 1970 in {unit}")
    possible = [u for u in ("s", "ms", "us", "ns")
                if _USUAL_RATES[0] <= 1 / (step * factor(u, "s")) <= _USUAL_RATES[1]]  # fmt: skip
    seen = f"its stamps step by {step:.6g}"
    if not possible:
        return Clock(column, "s", step, LOW, f"{seen}, which is usual in no unit of time")
    whole = bool((values[:1000] == np.round(values[:1000])).all())
    if not whole and "s" in possible:
        possible = ["s"]  # fractions are for seconds
    unit = possible[0]
    rate = 1 / (step * factor(unit, "s"))
    others = "".join(f", {1 / (step * factor(u, 's')):.4g} Hz if it were {u}" for u in possible[1:])
    sure = LOW if others else (HIGH if column.named.role == "time" else MEDIUM)
    return Clock(
        column, unit, step * factor(unit, "s"), sure, f"{seen}: {rate:.5g} Hz in {unit}{others}"
    )


def _of_coarse(column: Column, values: np.ndarray) -> Clock | None:
    """The mean rate of stamps that several samples share: whole seconds, a logger's blocks."""
    unit = "s" if column.stamps else column.named.unit
    known = (u for u, si in _SINCE_1970.items() if 9.8e8 < values[0] * si < 3e9)
    if not (unit := unit or next(known, "")):
        return None
    step = float(values.max() - values.min()) * factor(unit, "s") / (len(values) - 1)
    return Clock(None, "", step, MEDIUM, f"the mean over {column.shown}, whose stamps several "
                                         f"samples share: {1 / step:.5g} Hz")  # fmt: skip


def _coarse(values: np.ndarray) -> bool:
    """True where many neighbours have one stamp: whole seconds, say."""
    steps = np.diff(values[:10_000])
    return bool(np.count_nonzero(steps == 0) > 0.3 * max(len(steps), 1))
