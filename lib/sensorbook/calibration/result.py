"""The one result of every static calibration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from scipy import stats

from sensorbook import units
from sensorbook.calibration.model import ErrorModel, parameter_names
from sensorbook.earth import STANDARD_GRAVITY

KNOWN_GRAVITY = (
    1e-3  # m/s²; seldom does gravity depart by more from the normal one at a known place
)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A deterministic calibration with its uncertainty, SI.

    Attributes
    ----------
    method : "six_position", "recursive", "multi_position" or "rest_to_rest"
    sensor, data : the sensor, and what was fed in: "raw", "denoised" or "means"
    model : the error model found
    free, g_free : (3, 3) which entries of the matrix and of the g-sensitivity were free
    covariance : (K, K) of the free matrix entries (row by row), biases and free g-sensitivities
    dof : degrees of freedom of the residuals that scaled the covariance
    chi_square : weighted sum of squared residuals over `dof` before that scaling: 1 where the
        samples' own noise explains them
    excess : standard deviation added to every position's, in the unit of the residuals
    residuals : (P,) ``‖a‖ − g`` of the positions fitted, m/s²; of a gyroscope the direction error of
        the motions fitted, rad
    kept : (P,) which of the positions offered were used; the others stand in `rejected` by name
    rms_before, rms_after, rms_check : ``‖a‖ − g`` as read, fitted, and fitted without the positions
        judged, m/s²; of a gyroscope its reading at rest, rad/s
    direction_errors : of a gyroscope, rms of the direction after a motion, rad: nominal, fitted, held
        out
    """

    method: str
    sensor: str
    data: str
    model: ErrorModel
    free: np.ndarray
    covariance: np.ndarray
    dof: int
    chi_square: float
    excess: float
    residuals: np.ndarray
    kept: np.ndarray
    rejected: tuple[str, ...]
    gravity: float
    rms_before: float = np.nan
    rms_after: float = np.nan
    rms_check: float = np.nan
    g_free: np.ndarray = field(default_factory=lambda: np.zeros((3, 3), dtype=bool))
    reference_temperature: float | None = None
    temperature: dict | None = None
    direction_errors: tuple[float, float, float] | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names in the order of `covariance`."""
        more = parameter_names(self.g_free, "g_sensitivity")
        return (*parameter_names(self.free), *(f"bias.{axis}" for axis in "xyz"), *more)

    @property
    def values(self) -> np.ndarray:
        """(K,) in the order of `parameters`."""
        m = self.model
        return np.r_[m.matrix[self.free], m.bias, m.g_sensitivity[self.g_free]]

    @property
    def std(self) -> np.ndarray:
        """(K,) standard errors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval_factor(self) -> float:
        """Half width of the 95 % interval in standard errors: Student's t."""
        return float(stats.t.ppf(0.975, max(self.dof, 1)))

    def with_gravity(self, std: float) -> Calibration:
        """The calibration with gravity's standard error (m/s²) in its own.

        The matrix is proportional to 1/g, the bias does not depend on it. At a known place gravity's
        anomalies, below `KNOWN_GRAVITY`, are left out.
        """
        if std <= KNOWN_GRAVITY:
            return self
        entries = np.zeros(len(self.covariance))
        entries[: self.free.sum()] = self.model.matrix[self.free]
        added = np.outer(entries, entries) * (std / self.gravity) ** 2
        return replace(self, covariance=self.covariance + added)

    def std_of(self, part: str) -> np.ndarray:
        """Standard errors of "matrix" or "g_sensitivity" (3, 3; zero where fixed), or "bias" (3,)."""
        count = int(self.free.sum())
        if part == "bias":
            return self.std[count : count + 3]
        free, own = {
            "matrix": (self.free, self.std[:count]),
            "g_sensitivity": (self.g_free, self.std[count + 3 :]),
        }[part]
        result = np.zeros((3, 3))
        result[free] = own
        return result

    def to_frame(self) -> pd.DataFrame:
        """One parameter a row: value, standard error and 95 % interval, SI."""
        half = self.interval_factor * self.std
        return pd.DataFrame(
            {
                "value": self.values,
                "std": self.std,
                "low": self.values - half,
                "high": self.values + half,
            },
            index=pd.Index(self.parameters, name="parameter"),
        )

    def table(self) -> pd.DataFrame:
        """The parameters in field units with 95 % intervals, as text."""
        rows = {
            name: {"value": rounded(v, h), "95 % interval": f"± {rounded(h, h)}", "unit": unit}
            for name, v, h, unit in self._shown(self.values)
        }
        return pd.DataFrame(rows).T

    def against(self, truth: dict) -> pd.DataFrame:
        """Estimate beside the truth of a simulated device: its matrix, bias and g_sensitivity, SI."""
        matrix = np.array(truth["matrix"])[self.free]
        g = np.array(truth.get("g_sensitivity") or np.zeros((3, 3)), dtype=float)
        g = np.diag(g) if g.ndim == 1 else g
        true = np.r_[matrix, truth["bias"], g[self.g_free]]
        rows = {}
        for (name, v, h, unit), (_, t, _, _) in zip(
            self._shown(self.values), self._shown(true), strict=True
        ):
            rows[name] = {
                "truth": rounded(t, h),
                "estimate": rounded(v, h),
                "95 % interval": f"± {rounded(h, h)}",
                "unit": unit,
                "holds the truth": "yes" if abs(v - t) <= h else "no",
            }
        return pd.DataFrame(rows).T

    def _shown(self, values: np.ndarray):
        """(name, value, half width, unit) of each parameter in field units."""
        label, si = units.field_unit(self.sensor, "signal")
        half = self.interval_factor * self.std
        for name, value, h in zip(self.parameters, values, half, strict=True):
            part, axis = name.split(".")
            if part == "bias":
                yield f"bias {axis}", value / si, h / si, label
            elif part == "g_sensitivity":
                factor = STANDARD_GRAVITY / si
                unseen = "" if np.any(self.model.g_sensitivity) else " (not visible)"
                name = f"g-sensitivity {axis[0] if axis[0] == axis[-1] else axis}{unseen}"
                yield name, value * factor, h * factor, f"{label}/g"
            elif axis[0] == axis[1]:
                yield f"scale factor error {axis[0]}", 1e6 * (value - 1), 1e6 * h, "ppm"
            else:
                yield f"misalignment {axis}", 1e3 * value, 1e3 * h, "mrad"

    def _repr_html_(self) -> str:
        return self.table().to_html(border=0)

    def to_results(self) -> dict:
        """As results.json states a calibration."""
        gyroscope = self.sensor == "gyroscope"
        std = {"matrix": self.std_of("matrix"), "bias": self.std_of("bias")}
        # A's G is diagonal: three numbers where that is all there is.
        whole = np.array_equal(self.g_free, np.ones((3, 3)))
        shape = (lambda g: g) if whole else np.diag
        visible = bool(np.any(self.model.g_sensitivity))
        if gyroscope:
            std["g_sensitivity"] = shape(self.std_of("g_sensitivity"))
        turns = {}
        for name, error in zip(
            ("before", "after", "check"), self.direction_errors or (), strict=False
        ):
            turns[f"direction_error_{name}_deg"] = float(np.degrees(error))
        return turns | {
            "method": self.method,
            "model": int(self.free.sum()) + 3,
            "input": self.data,
            "matrix": self.model.matrix,
            "bias": self.model.bias,
            "g_sensitivity": shape(self.model.g_sensitivity) if visible else None,
            "std": std,
            "interval_factor": self.interval_factor,
            "parameters": list(self.parameters),
            "covariance": self.covariance,
            "degrees_of_freedom": self.dof,
            "chi_square": None if np.isnan(self.chi_square) else self.chi_square,
            "rms_before": self.rms_before,
            "rms_after": self.rms_after,
            "rms_check": None if np.isnan(self.rms_check) else self.rms_check,
            "positions": int(self.kept.sum()),
            "rejected": list(self.rejected),
            "unit": "rad/s" if gyroscope else "m/s^2",
            "gravity": self.gravity,
            "reference_temperature": self.reference_temperature,
            "temperature_unit": "degC",
            "temperature": self.temperature,
        }


def rounded(value: float, uncertainty: float) -> str:
    """The value with as many digits as two of its uncertainty have."""
    if not 0 < uncertainty < np.inf:
        return f"{value:.5g}"
    digits = max(0, 1 - int(np.floor(np.log10(uncertainty))))
    return f"{value:.{digits}f}" if digits < 12 else f"{value:.5g}"
