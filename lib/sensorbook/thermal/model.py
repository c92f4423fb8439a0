"""The two forms of a thermal model: one polynomial, or two with a jump between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial, chebyshev

JOIN = Polynomial([0, 0, 3, -2])  # rises from 0 to 1 with level ends


@dataclass(frozen=True)
class ThermalModel:
    """Bias against temperature; `segments` cover `range` without gaps.

    Attributes
    ----------
    reference : reference temperature, °C
    segments : (low, high, coefficients) with ``B(T) = Σ coefficients[k] (T − reference)^k``, SI
    """

    reference: float
    segments: tuple[tuple[float, float, tuple[float, ...]], ...]

    @property
    def range(self) -> tuple[float, float]:
        """Calibrated range, °C."""
        return self.segments[0][0], self.segments[-1][1]

    def bias(self, temperature: np.ndarray) -> np.ndarray:
        """B(T), SI; outside the calibrated range the edge's value is held."""
        t = np.clip(np.asarray(temperature, dtype=float), *self.range)
        result = np.empty_like(t)
        for i, (low, _, coefficients) in enumerate(self.segments):
            inside = t >= low if i else np.ones_like(t, dtype=bool)
            result[inside] = np.polynomial.polynomial.polyval(
                t[inside] - self.reference, coefficients
            )
        return result

    def change(self, temperature: np.ndarray) -> np.ndarray:
        """B(T) − B(reference): what is subtracted from a reading."""
        return self.bias(temperature) - self.bias(np.array([self.reference]))[0]

    def jump(self) -> float:
        """Size of the jump, SI: both sides extended to its middle. For models with a jump only."""
        (_, low, left), _, (high, _, right) = self.segments
        middle = (low + high) / 2 - self.reference
        polyval = np.polynomial.polynomial.polyval
        return float(polyval(middle, right) - polyval(middle, left))

    def to_results(self) -> dict:
        """The keys of results.json that state the model."""
        common = {"reference_temperature": self.reference, "temperature_unit": "degC"}
        if len(self.segments) == 1:
            low, high, c = self.segments[0]
            return {
                "model": "polynomial",
                "degree": len(c) - 1,
                "coefficients": list(c),
                **common,
                "range": [low, high],
            }
        segments = [{"range": [a, b], "coefficients": list(c)} for a, b, c in self.segments]
        return {"model": "piecewise", "segments": segments, **common, "range": list(self.range)}

    @staticmethod
    def from_results(result: dict) -> ThermalModel:
        """The inverse of `to_results`."""
        segments = result.get("segments") or [result]
        return ThermalModel(
            result["reference_temperature"],
            tuple((*s["range"], tuple(s["coefficients"])) for s in segments),
        )


@dataclass(frozen=True)
class Form:
    """A candidate: polynomial degree, and the jump's (low, high) in °C where it has one."""

    degree: int
    jump: tuple[float, float] | None = None

    @property
    def size(self) -> int:
        """Free parameters beyond the offset."""
        return self.degree if self.jump is None else 2 * self.degree + 3

    def __str__(self) -> str:
        return f"degree {self.degree}" + (", jump" if self.jump else "")

    def columns(self, temperature: np.ndarray, span: tuple[float, float]) -> np.ndarray:
        """(M, P) design matrix without the constant column, in a variable scaled to −1 … 1.

        With a jump each side has its own polynomial; between `low` and `high` the two ends are joined
        by the cubic s²(3 − 2s), which leaves each side without a kink.
        """
        if self.jump is None:
            return chebyshev.chebvander(_scale(temperature, span), self.degree)[:, 1:]
        low, high = self.jump
        right = JOIN(np.clip((temperature - low) / (high - low), 0, 1))[:, None]
        left_part = chebyshev.chebvander(_scale(np.minimum(temperature, low), span), self.degree)
        right_part = chebyshev.chebvander(_scale(np.maximum(temperature, high), span), self.degree)
        return np.hstack([left_part[:, 1:] * (1 - right), right, right_part[:, 1:] * right])

    def model(self, offset, solution, span, reference: float) -> ThermalModel:
        """The fitted model in powers of T − reference."""
        d = self.degree
        left = np.r_[offset, solution[:d]]
        if self.jump is None:
            return ThermalModel(reference, ((*span, _powers(left, span, reference)),))
        low, high = self.jump
        right = np.r_[offset + solution[d], solution[d + 1 :]]
        ends = [chebyshev.chebval(_scale(t, span), c) for t, c in ((low, left), (high, right))]
        join = JOIN(Polynomial([reference - low, 1]) / (high - low))
        middle = tuple(float(c) for c in (ends[0] + (ends[1] - ends[0]) * join).coef)
        return ThermalModel(
            reference,
            (
                (span[0], low, _powers(left, span, reference)),
                (low, high, middle),
                (high, span[1], _powers(right, span, reference)),
            ),
        )


def _scale(temperature, span):
    return (2 * np.asarray(temperature) - span[0] - span[1]) / (span[1] - span[0])


def _powers(coefficients, span, reference) -> tuple[float, ...]:
    """Chebyshev series over `span` → powers of T − reference."""
    series = chebyshev.Chebyshev(coefficients, domain=span)
    shifted = series.convert(kind=Polynomial, domain=[reference - 1, reference + 1], window=[-1, 1])
    c = np.zeros(len(coefficients))
    c[: len(shifted.coef)] = shifted.coef
    return tuple(float(x) for x in c)
