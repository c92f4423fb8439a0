"""The result of a thermal calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorbook import units
from sensorbook.estimate import Estimate
from sensorbook.thermal.model import ThermalModel
from sensorbook.thermal.repeat import Repeatability


@dataclass(frozen=True)
class Candidate:
    """One form that was tried: rms of its residuals in the fit and on held-out data, SI."""

    name: str
    parameters: int
    rms: float
    rms_check: float


@dataclass(frozen=True, eq=False)
class ThermalAxis:
    """Thermal calibration of one axis, SI.

    Attributes
    ----------
    model : the chosen model; its offset is that of the first run
    offsets : reading at the reference temperature, one for each run
    std : standard error of each of the model's coefficients (jackknife over stretches of time)
    rms_before, rms_after, rms_check : of the block means about each run's mean, about the model, and
        about a model fitted without them
    change : across the calibrated range, highest minus lowest temperature; None for a constant
    jump : its size; None where there is none
    jump_range : °C
    candidates : every form tried; `polynomials` holds work A's degrees 1, 3 and 5 as models
    coefficients_per_run : straight-line temperature coefficient of each run, SI/°C
    repeatability : slopes of the cycles compared; None where there are no two to compare
    hysteresis : heating minus cooling: largest difference, where (°C), its standard error; None
        where the record does not hold both
    residual : (M,) block means minus model
    half_width : of the 95 % band of `change(T)`, on the grid (51,) over the range
    """

    model: ThermalModel
    offsets: tuple[float, ...]
    std: tuple[tuple[float, ...], ...]
    rms_before: float
    rms_after: float
    rms_check: float
    change: Estimate | None
    jump: Estimate | None
    jump_range: tuple[float, float] | None
    candidates: tuple[Candidate, ...]
    polynomials: dict[int, ThermalModel]
    coefficients_per_run: tuple[float, ...]
    repeatability: Repeatability | None
    hysteresis: tuple[float, float, float] | None
    residual: np.ndarray
    half_width: np.ndarray

    def rms_of(self, name: str) -> Candidate:
        """The candidate of that name."""
        return next(c for c in self.candidates if c.name == name)


@dataclass(frozen=True, eq=False)
class ThermalFit:
    """Thermal calibration of a sensor; `axes[0]` is x."""

    sensor: str
    files: tuple[str, ...]
    axes: tuple[ThermalAxis, ...]

    def __getitem__(self, axis: str) -> ThermalAxis:
        return self.axes["xyz".index(axis)]

    def to_results(self) -> dict:
        """As results.json states it, SI."""
        unit = units.SENSOR_UNITS.get(self.sensor, "")
        result = {}
        for name, a in zip("xyz", self.axes, strict=False):
            entry = a.model.to_results()
            if entry["model"] == "piecewise":
                for segment, std in zip(entry["segments"], a.std, strict=True):
                    segment["std"] = list(std)
            else:
                entry["std"] = list(a.std[0])
            entry |= {
                "unit": unit,
                "rms_before": a.rms_before,
                "rms_after": a.rms_after,
                "rms_check": a.rms_check,
                "change": a.change and a.change.to_results(unit),
                "jump": a.jump and a.jump.to_results(unit) | {"range": list(a.jump_range)},
                "candidates": [vars(c) for c in a.candidates],
                "runs": [
                    {"file": f, "offset": o, "temperature_coefficient": c}
                    for f, o, c in zip(self.files, a.offsets, a.coefficients_per_run, strict=True)
                ],
                "repeatable": a.repeatability and a.repeatability.repeatable,
                "repeatability": a.repeatability and a.repeatability.to_results(),
                "hysteresis": a.hysteresis
                and dict(zip(("value", "temperature", "std"), a.hysteresis, strict=True)),
            }
            result[name] = entry
        return result

    def to_frame(self) -> pd.DataFrame:
        """One row an axis, in field units, 95 % intervals in brackets."""
        label, si = units.field_unit(self.sensor, "signal")
        rows = {}
        for name, a in zip("xyz", self.axes, strict=False):
            place = a.jump_range and f" at {a.jump_range[0]:.1f} … {a.jump_range[1]:.1f} °C"
            rows[name] = {
                "model": f"jump{place}" if a.jump else f"degree {a.model.to_results()['degree']}",
                f"change [{label}]": _shown(a.change, si) if a.change else "none modelled",
                f"jump [{label}]": _shown(a.jump, si) if a.jump else "none",
                "rms before": f"{a.rms_before / si:.3g}",
                "after": f"{a.rms_after / si:.3g}",
                "held out": f"{a.rms_check / si:.3g}",
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    def _repr_html_(self) -> str:
        return self.to_frame().to_html()


def _shown(interval: Estimate, si: float) -> str:
    return f"{interval.value / si:.3g} ({interval.low / si:.3g} … {interval.high / si:.3g})"
