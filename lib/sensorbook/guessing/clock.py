"""The time of a table: which column, in which unit, or how fast it was sampled at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.guessing.certainty import CERTAINTIES, HIGH, LOW, MEDIUM, UNKNOWN, weakest
from sensorbook.guessing.columns import Column
from sensorbook.recordings.clock import shuffled
from sensorbook.units import factor

_USUAL_RATES = (0.5, 8000.0)  # Hz, of the sensors this is for
# Stamps counted from 1970, 2001 to 2065: a number of this size can be nothing else.
_SINCE_1970 = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_NOTED_RATE = re.compile(
    r"(?:\b(?:sampl\w*|update|output|data)[ _-]*(?:data[ _-]*)?(?:rate|frequency|freq)|\bfs|\bodr)\b"
    r"[^0-9\n]{0,20}"
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
    noted = _noted(notes)
    if found:
        best = min(
            found, key=lambda c: (c.column is None, CERTAINTIES.index(c.certainty), not _taken(c))
        )
        if noted is None or abs(best.step / noted.step - 1) < 0.05:
            return best
        if best.column is not None and best.column.named.unit:
            reason = f"{best.reason}, though {noted.reason}"
            return Clock(best.column, best.unit, best.step, LOW, reason)
        reason = (
            f"{noted.reason}; the steps of {best.column.shown} fit it in no unit of time"
            if best.column is not None
            else noted.reason
        )
        for unit in ("s", "ms", "us", "ns") if best.column is not None else ():
            step = best.step / factor(best.unit or "s", "s") * factor(unit, "s")
            if best.unit and abs(step / noted.step - 1) < 0.05:
                return Clock(
                    best.column, unit, step, HIGH, f"its stamps fit what {noted.reason[:60]}"
                )
        return Clock(None, "", noted.step, MEDIUM, reason)
    if noted is not None:
        return noted
    if counters:
        reason = f"{counters[0].shown} counts samples and no column holds a time"
        return Clock(None, "", None, UNKNOWN, reason)
    return NO_CLOCK


def _taken(clock: Clock) -> bool:
    """True where its name says that it is when samples were taken, not when they were logged."""
    return clock.column is not None and clock.column.name == "timestamp_sample"  # PX4


def _noted(notes: Sequence[str]) -> Clock | None:
    """The rate that the head of a file gives; None where it gives none, or several."""
    found = {}
    for note in notes:
        if re.search(r"cut|filter|pass|band|notch|gps|gnss|baud|mag\w* rate", note, re.I):
            continue
        if match := _NOTED_RATE.search(note):
            rate = float(match[1]) * (1000 if (match[2] or "").lower() == "khz" else 1)
            if _USUAL_RATES[0] <= rate <= _USUAL_RATES[1]:
                sure = HIGH if match[2] else MEDIUM
                said = " ".join(note.split())[:60]
                found[rate] = Clock(None, "", 1 / rate, sure, f"the file's head says so: {said!r}")
    return next(iter(found.values())) if len(found) == 1 else None


def _of_column(column: Column) -> Clock | None:
    values = column.values[np.isfinite(column.values)]
    if shuffled(values):
        values = np.sort(values)
    steps = np.diff(values)
    steps = steps[steps > 0]
    if not len(steps):
        return None
    uneven = _uneven(values)
    step = float(np.median(steps))
    if uneven:
        step = float(values.max() - values.min()) / (len(values) - 1)
    elif np.spacing(values[-1]) > 1e-6 * step:  # ns since 1970 are told to 256 ns in a float64
        step = float(steps[np.abs(steps - step) <= 0.5 * step].mean())
    unit, certainty, reason = _unit(column, values, step)
    seconds = step * factor(unit or "s", "s")
    if uneven:
        reason = f"the mean over {column.shown}, whose stamps come {uneven}: {1 / seconds:.5g} Hz"
        return Clock(None, "", seconds, weakest(certainty, LOW), reason)
    return Clock(column, unit, seconds, certainty, reason)


def _unit(column: Column, values: np.ndarray, step: float) -> tuple[str, str, str]:
    """Unit of a time, "" for dates; how sure, and why."""
    if column.stamps:
        return "", HIGH, "it holds dates and times of day"
    unit = column.named.unit
    if unit and _USUAL_RATES[0] / 100 < 1 / (step * factor(unit, "s")) < 3 * _USUAL_RATES[1]:
        rate = 1 / (step * factor(unit, "s"))
        return (
            unit,
            HIGH,
            f"its name gives the unit; the stamps step by {step:.6g} {unit}, {rate:.5g} Hz",
        )
    for since, si in _SINCE_1970.items():
        if 9.8e8 < values[0] * si < 3e9 and _USUAL_RATES[0] / 10 < 1 / (step * si) < 1e5:
            return since, HIGH, f"counted from 1970 in {since}, {1 / (step * si):.5g} Hz"
    rates = {u: 1 / (step * factor(u, "s")) for u in ("s", "ms", "us", "ns")}
    possible = [u for u, rate in rates.items() if _USUAL_RATES[0] <= rate <= _USUAL_RATES[1]]
    seen = f"its stamps step by {step:.6g}"
    if unit:
        seen = f"its name says {unit}, but {seen}, which would be {rates.get(unit, 0):.4g} Hz"
        return possible[0] if possible else unit, LOW, seen
    if not possible:
        return "s", LOW, f"{seen}, which is usual in no unit of time"
    if "s" in possible and not (values[:1000] == np.round(values[:1000])).all():
        possible = ["s"]  # fractions are for seconds
    others = "".join(f", {rates[u]:.4g} Hz if it were {u}" for u in possible[1:])
    sure = LOW if others else (HIGH if column.named.role == "time" else MEDIUM)
    return possible[0], sure, f"{seen}: {rates[possible[0]]:.5g} Hz in {possible[0]}{others}"


def _uneven(values: np.ndarray) -> str:
    """How stamps come that do not tell when each sample was taken; "" for those that do."""
    steps = np.diff(values[:100_000])
    if np.count_nonzero(steps == 0) > 0.3 * len(steps):
        return "once for several samples"
    regular = steps[np.abs(steps - np.median(steps)) <= 0.5 * np.median(steps)]
    # A pause makes one long step; bursts make many, and hold most of the time.
    if len(regular) < 0.9 * len(steps) and regular.sum() < 0.5 * steps.sum():
        return "in bursts, as they arrived"
    return ""
