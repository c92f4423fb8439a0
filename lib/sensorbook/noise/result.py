"""The one result type of all noise estimators."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from sensorbook import units
from sensorbook.estimate import Estimate
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS, NoiseTerms


@dataclass(frozen=True)
class Misfit:
    """Where a curve departs from its terms.

    Attributes
    ----------
    tau_range : cluster times that depart, around the most significant, s
    tau, size : the most significant, s, and σ/model − 1 there
    """

    tau_range: tuple[float, float]
    tau: float
    size: float


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov process: autocovariance ``std² e^−|s|/T``.

    Attributes
    ----------
    correlation_time : T, s
    std : standard deviation, SI
    saved : deviance it saves, twice the gain of log-likelihood
    """

    correlation_time: Estimate
    std: Estimate
    saved: float

    def spectrum(self, f: np.ndarray) -> np.ndarray:
        """Two-sided density ``2 std² T/(1 + (2πfT)²)``; `f` in Hz (table A6, q_c T_c = std √2T)."""
        t = self.correlation_time.value
        return 2 * self.std.value**2 * t / (1 + (2 * np.pi * f * t) ** 2)

    def integral_growth(self, time: np.ndarray) -> np.ndarray:
        """Standard deviation of its integral after `time` (s): ``std √(2T(t − T + T e^{−t/T}))``."""
        t, tc = np.asarray(time, dtype=float), self.correlation_time.value
        return self.std.value * np.sqrt(2 * tc * (t + tc * np.expm1(-t / tc)))

    def allan_variance(self, tau: np.ndarray) -> np.ndarray:
        """σ²(τ) of table A6; `tau` in s."""
        x = np.asarray(tau) / self.correlation_time.value
        # Below, the three exponentials cancel to nothing: σ² = std² x/3 · (1 − 5x/8 …).
        small = x < 1e-3
        y = np.where(small, 1.0, x)
        whole = (1 - (3 - 4 * np.exp(-y) + np.exp(-2 * y)) / (2 * y)) * 2 / y
        return self.std.value**2 * np.where(small, 2 * x / 3, whole)


@dataclass(frozen=True, eq=False)
class AxisNoise:
    """Noise terms of one axis.

    Attributes
    ----------
    terms : estimate by term, None where the term has no visible effect
    upper_bounds : 95 % upper bound of each term without visible effect, SI
    tau_range : cluster times used, s; None where the fit is to the spectrum
    misfit : where the terms do not describe the curve, None where they do
    squares : fitted squared coefficients (the one of 1/τ² may be negative), SI
    edf : (T,) equivalent degrees of freedom of the curve
    band : (T, 2) 95 % confidence limits of the curve
    variance : (T,) Allan variance that the terms explain, with low-pass and periodic components where the
        fit is to the spectrum; NaN at cluster times that were not used
    frequency_range : frequencies used, Hz; None where the fit is to the Allan curve
    model_error : what the spectrum departs from the terms by beyond chance, relative, rms
    gauss_markov : the process beside the terms, where one was asked for and found
    low_pass : what the noise has been through, its shape as the spectrum's fit has it
    """

    terms: dict[str, Estimate | None]
    upper_bounds: dict[str, float]
    tau_range: tuple[float, float] | None
    misfit: Misfit | None
    squares: dict[str, float] = field(default_factory=dict)
    edf: np.ndarray | None = None
    band: np.ndarray | None = None
    variance: np.ndarray | None = None
    frequency_range: tuple[float, float] | None = None
    model_error: float = 0.0
    gauss_markov: GaussMarkov | None = None
    low_pass: LowPass | None = None

    @property
    def coefficients(self) -> NoiseTerms:
        """The values alone, zero where a term is absent."""
        return NoiseTerms(**{name: e.value if e else 0.0 for name, e in self.terms.items()})

    @property
    def model(self) -> NoiseTerms:
        """Everything fitted, terms too weak to be stated included."""
        return NoiseTerms(**{name: max(v, 0.0) ** 0.5 for name, v in self.squares.items()})

    def allan_variance(self, tau: np.ndarray) -> np.ndarray:
        """σ²(τ) of everything fitted, a Gauss–Markov process included; `tau` in s."""
        process = self.gauss_markov.allan_variance(tau) if self.gauss_markov else 0.0
        return self.model.allan_variance(tau) + process

    def spectrum(self, f: np.ndarray, sample_time: float) -> np.ndarray:
        """Two-sided density of the same, before any low-pass; `f` in Hz."""
        process = self.gauss_markov.spectrum(f) if self.gauss_markov else 0.0
        return self.model.spectrum(f, sample_time) + process

    def integral_growth(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """What each term stated adds to the signal's integral after `time` (s), one standard deviation."""
        growth = self.coefficients.integral_growth(time)
        growth = {name: values for name, values in growth.items() if self.terms[name]}
        if process := self.gauss_markov:
            growth["gauss_markov"] = process.integral_growth(time)
        return growth


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """Noise terms of every axis by one method; `axes[0]` is x."""

    method: str
    sensor: str
    axes: tuple[AxisNoise, ...]

    def __getitem__(self, axis: str) -> AxisNoise:
        return self.axes["xyz".index(axis)]

    def to_results(self) -> dict:
        """As results.json states it: SI units, one-sided noise density beside the two-sided N."""
        return {
            name: _axis_results(axis, self.sensor)
            for name, axis in zip("xyz", self.axes, strict=False)
        }

    def to_frame(self) -> pd.DataFrame:
        """One row an axis and term, in field units."""
        rows = []
        for name, axis in zip("xyz", self.axes, strict=False):
            for term in TERMS:
                label, si = units.field_unit(self.sensor, term)
                e = axis.terms[term]
                bound = axis.upper_bounds.get(term, np.nan)
                rows.append(
                    (name, term.replace("_", " "), TERMS[term].symbol)
                    + ((e.value / si, e.low / si, e.high / si) if e else (np.nan,) * 3)
                    + (bound / si, label)
                )
        columns = ["axis", "term", "symbol", "value", "low", "high", "upper bound", "unit"]
        return pd.DataFrame(rows, columns=columns)

    def _repr_html_(self) -> str:
        return self.table().to_html()

    def table(self) -> pd.DataFrame:
        """One row a term, one column an axis: value and 95 % interval in field units, as text."""
        rows = {}
        for term, t in TERMS.items():
            label, si = units.field_unit(self.sensor, term)
            rows[f"{t.symbol}, {term.replace('_', ' ')} [{label}]"] = [
                _cell(axis.terms[term], axis.upper_bounds.get(term), si) for axis in self.axes
            ]
        if any(axis.gauss_markov for axis in self.axes):
            label, si = units.field_unit(self.sensor, "bias_instability")
            both = [(f"Gauss–Markov, std [{label}]", "std", si)]
            for name, part, unit in (
                *both,
                ("Gauss–Markov, correlation time [s]", "correlation_time", 1),
            ):
                rows[name] = [
                    _cell(getattr(a.gauss_markov, part), None, unit) if a.gauss_markov else "none"
                    for a in self.axes
                ]
        return pd.DataFrame.from_dict(rows, orient="index", columns=list("xyz")[: len(self.axes)])


def _cell(estimate: Estimate | None, bound: float | None, si: float) -> str:
    if estimate:
        return f"{estimate.value / si:.3g} ({estimate.low / si:.3g} … {estimate.high / si:.3g})"
    # A reading has no bound where it found no range: that is no statement of what is visible.
    return "no range" if bound is None else f"none visible (< {bound / si:.2g})"


def _axis_results(axis: AxisNoise, sensor: str) -> dict:
    result: dict = {}
    for name, e in axis.terms.items():
        result[name] = e and e.to_results(units.si_unit(sensor, name))
        if name == "random_walk":
            twin = Estimate(*(np.sqrt(2) * np.array([e.value, e.low, e.high]))) if e else None
            result["noise_density"] = twin and twin.to_results(
                units.si_unit(sensor, "noise_density")
            )
    if axis.upper_bounds:
        result["upper_bounds"] = {k: float(v) for k, v in axis.upper_bounds.items()}
    if axis.gauss_markov:
        result["gauss_markov"] = {
            "correlation_time": axis.gauss_markov.correlation_time.to_results("s"),
            "std": axis.gauss_markov.std.to_results(units.si_unit(sensor, "bias_instability")),
        }
    if axis.misfit:
        m = axis.misfit
        result["misfit"] = {"tau_range": list(m.tau_range), "tau": m.tau, "size": m.size}
    return result
