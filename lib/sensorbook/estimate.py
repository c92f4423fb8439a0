"""The one form in which a number with its uncertainty leaves a method."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % confidence interval, SI."""

    value: float
    low: float
    high: float

    def to_results(self, unit: str) -> dict:
        """As results.json states it."""
        value, low, high = map(float, (self.value, self.low, self.high))
        return {"value": value, "low": low, "high": high, "unit": unit}
