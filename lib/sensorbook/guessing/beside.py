"""Tables recorded at the same time, each sensor in its own: what one tells of another."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sensorbook.guessing.certainty import LOW, MEDIUM, Guess
from sensorbook.guessing.clock import Clock
from sensorbook.units import factor


def together(one: Clock, other: Clock, same_file: bool) -> bool:
    """True where two tables were recorded at the same time, as far as their clocks tell."""
    spans = [_absolute(clock) for clock in (one, other)]
    if None in spans:
        return same_file
    (a, b), (c, d) = spans
    return min(b, d) - max(a, c) > 0.5 * min(b - a, d - c)


def _absolute(clock: Clock) -> tuple[float, float] | None:
    """First and last second since 1970; None where the clock counts from anywhere."""
    if clock.column is None:
        return None
    values = clock.column.values * factor(clock.unit or "s", "s")
    first, last = float(np.nanmin(values)), float(np.nanmax(values))
    return (first, last) if first > 9e8 else None


def kind_beside(kind: Guess, sensor: str, beside: Iterable[dict]) -> Guess:
    """A gyroscope's kind by the accelerometer of another table (declarations of the same time).

    Alone it does not show whether its rests differ in attitude.
    """
    if sensor != "gyroscope" or (kind.value, kind.certainty) != ("positions", LOW):
        return kind
    for table in beside:
        if table["sensor"] == "accelerometer" and table["kind"] in ("positions", "six_position"):
            reason = f"the accelerometer in {table.get('table', table['file'])!r} rests in several attitudes"
            return Guess("kind", "positions", MEDIUM, reason)
    return kind
