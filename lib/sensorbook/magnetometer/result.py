"""The result of a magnetometer's calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from sensorbook.calibration.result import rounded
from sensorbook.magnetometer.coverage import Coverage
from sensorbook.magnetometer.ellipsoid import ENTRIES, PARAMETERS, unpacked

MICROTESLA = 1e-6


@dataclass(frozen=True, eq=False)
class MagnetometerCalibration:
    """Hard and soft iron with their uncertainty: ``true = soft_iron · (raw − hard_iron)``, T.

    Attributes
    ----------
    method : "ellipsoid", "diagonal" (soft iron without cross-axis terms) or "hard_iron"
    hard_iron : (3,) T
    soft_iron : (3, 3) symmetric; determinant 1 where the field's strength is not known
    field : T, the strength that corrected readings have
    covariance : (10, 10) of hard iron, soft iron (xx, yy, zz, xy, xz, yz) and field. What a reduced
        model leaves out is in it, and the field's own uncertainty where its strength is known
    field_known : True where `field` comes from a model of the Earth's field
    field_source : where `field` comes from, in words
    dof : degrees of freedom of the covariance
    residual, residual_check, residual_before : rms of ``‖true‖ / field − 1``: of the readings used;
        held out, a fifth of the recording at a time
        (NaN where what remains determines nothing); as read, about its mean
    coverage : of the sphere by the directions of the corrected field
    used : (N,) which readings the fit rests on
    dilution : error of a corrected reading in the worst direction, over that of readings all over
    blocks : blocks of consecutive readings that the covariance rests on
    correlation : integrated correlation time of the residuals, samples
    inflation : of the hard iron's standard error over the formal one, which counts every reading as new
    reduced : why each fuller model was not taken
    """

    method: str
    hard_iron: np.ndarray
    soft_iron: np.ndarray
    field: float
    covariance: np.ndarray
    field_known: bool
    field_source: str
    dof: int
    residual: float
    residual_check: float
    residual_before: float
    coverage: Coverage
    used: np.ndarray
    dilution: float
    blocks: int
    correlation: float
    inflation: float
    reduced: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names in the order of `covariance`."""
        return (*PARAMETERS, "field")

    @property
    def values(self) -> np.ndarray:
        """(10,) in the order of `parameters`."""
        return np.r_[self.hard_iron, [self.soft_iron[e] for e in ENTRIES], self.field]

    @property
    def std(self) -> np.ndarray:
        """(10,) standard errors."""
        return np.sqrt(np.diag(self.covariance).clip(0))

    @property
    def interval_factor(self) -> float:
        """Half width of the 95 % interval in standard errors: Student's t."""
        return float(stats.t.ppf(0.975, self.dof))

    @property
    def semi_axes(self) -> np.ndarray:
        """(3,) T, of the ellipsoid of the readings, shortest first."""
        return self.field / np.linalg.eigvalsh(self.soft_iron)[::-1]

    @property
    def measured(self) -> tuple[float, float]:
        """Strength of the readings as they come, T, before any scale, and its standard error."""
        inverse = np.linalg.inv(self.soft_iron)
        strength = self.field / float(np.cbrt(np.linalg.det(self.soft_iron)))
        by = [-strength / 3 * inverse[e] * (1 if e[0] == e[1] else 2) for e in ENTRIES]
        by = np.r_[0, 0, 0, by, strength / self.field]
        return strength, float(np.sqrt(max(by @ self.covariance @ by, 0)))

    def correct(self, raw: np.ndarray) -> np.ndarray:
        """(N, 3) corrected readings, T, of raw ones (N, 3)."""
        return (raw - self.hard_iron) @ self.soft_iron

    def table(self) -> pd.DataFrame:
        """The parameters with 95 % intervals, as text."""
        rows = {
            name: {
                "value": rounded(v, h),
                "95 % interval": _interval(h),
                "unit": unit,
            }
            for name, v, h, unit in self._shown(self.values)
        }
        return pd.DataFrame(rows).T

    def against(self, truth: dict) -> pd.DataFrame:
        """Estimate beside the truth of a simulated device: its hard_iron, soft_iron and field, SI.

        Without a known field's strength the truth is scaled to determinant 1, too.
        """
        s, strength = np.array(truth["soft_iron"]), truth["field"]
        if not self.field_known:
            s, strength = relative(s, strength)
        true = np.r_[truth["hard_iron"], [s[e] for e in ENTRIES], strength]
        rows = {}
        for (name, v, h, unit), (_, t, _, _) in zip(
            self._shown(self.values), self._shown(true), strict=True
        ):
            rows[name] = {
                "truth": rounded(t, h),
                "estimate": rounded(v, h),
                "95 % interval": _interval(h),
                "unit": unit,
                "holds the truth": "yes" if abs(v - t) <= h else "no",
            }
        return pd.DataFrame(rows).T

    def _shown(self, values: np.ndarray):
        """(name, value, half width, unit) of each parameter in field units."""
        half = self.interval_factor * self.std
        for name, value, h in zip(self.parameters, values, half, strict=True):
            part, _, axis = name.partition(".")
            if part == "soft_iron":
                yield f"soft iron {axis}", value, h, "1"
            else:
                label = f"hard iron {axis}" if axis else "field"
                yield label, value / MICROTESLA, h / MICROTESLA, "µT"

    def _repr_html_(self) -> str:
        return self.table().to_html(border=0)

    def to_results(self) -> dict:
        """As results.json states a magnetometer's calibration."""
        return {
            "method": self.method,
            "hard_iron": self.hard_iron,
            "soft_iron": self.soft_iron,
            "field": self.field,
            "field_known": self.field_known,
            "field_source": self.field_source,
            "field_measured": self.measured[0],
            "residual_percent": 100 * self.residual,
            "residual_percent_check": None
            if np.isnan(self.residual_check)
            else 100 * self.residual_check,
            "residual_percent_before": 100 * self.residual_before,
            "coverage_percent": self.coverage.percent,
            "dilution": self.dilution,
            "std": {
                "hard_iron": self.std[:3],
                "soft_iron": unpacked(self.std[:9])[1],
                "field": self.std[9],
                "field_measured": self.measured[1],
            },
            "interval_factor": self.interval_factor,
            "parameters": list(self.parameters),
            "covariance": self.covariance,
            "degrees_of_freedom": self.dof,
            "blocks": self.blocks,
            "readings": int(self.used.sum()),
            "set_aside": int((~self.used).sum()),
            "unit": "T",
        }


def _interval(half: float) -> str:
    return f"± {rounded(half, half)}" if half else "fixed"


def relative(soft_iron: np.ndarray, field: float) -> tuple[np.ndarray, float]:
    """Soft iron scaled to determinant 1, and the strength that readings have with it."""
    scale = np.cbrt(np.linalg.det(soft_iron))
    return soft_iron / scale, field / scale


def scaled(
    parameters: np.ndarray,
    covariance: np.ndarray,
    centre: np.ndarray,
    size: float,
    field: float | None,
    field_std: float,
) -> dict:
    """Hard iron, soft iron, field and their covariance, T, of an ellipsoid in units of its own.

    Parameters
    ----------
    parameters, covariance : (9,), (9, 9) for readings less `centre` (3,) over `size`, field 1
    field, field_std : T; None for a relative soft iron
    """
    h, s = unpacked(parameters)
    length = float(np.cbrt(np.linalg.det(s)))
    # Derivatives of ln length by the parameters: a third of the trace of S⁻¹ dS.
    inverse = np.linalg.inv(s)
    by = np.r_[0, 0, 0, [inverse[e] * (1 if e[0] == e[1] else 2) / 3 for e in ENTRIES]]
    change = np.zeros((10, 9))
    change[:3, :3] = size * np.eye(3)
    entries = np.array([s[e] for e in ENTRIES])
    if field is None:
        change[3:9, 3:] = np.eye(6) / length
        change[3:9] -= np.outer(entries / length, by)
        change[9] = -size / length * by
        soft, strength, own = s / length, size / length, np.zeros(10)
    else:
        change[3:9, 3:] = np.eye(6) * field / size
        soft, strength = s * field / size, field
        own = np.r_[0, 0, 0, entries / size, 1] * field_std
    return {
        "hard_iron": centre + size * h,
        "soft_iron": soft,
        "field": float(strength),
        "field_known": field is not None,
        "covariance": change @ covariance @ change.T + np.outer(own, own),
    }
