"""The deterministic error model and its exact inverse (A 5.1, 5.2, 5.4, 5.5; B 2–4)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

# Entries of the matrix that are free, by number of parameters (with three biases).
FREE = {
    6: np.eye(3, dtype=bool),
    9: np.tri(3, dtype=bool),
    12: np.ones((3, 3), dtype=bool),
}


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """``raw = matrix · true + bias + g_sensitivity · acceleration`` (A 5.1, 5.2).

    Attributes
    ----------
    matrix : (3, 3) I + S + M: scale factors on the diagonal, misalignments (rad) off it
    bias : (3,) in the sensor's unit
    g_sensitivity : (3, 3) G, rad/s per m/s²; zero for an accelerometer. A has the diagonal alone, which
        may be given as (3,)

    >>> model = ErrorModel([[1.01, 0, 0], [0.002, 0.98, 0], [0, 0.001, 1]], [0.1, -0.2, 0.3])
    >>> true = np.array([[1.0, 2.0, 3.0]])
    >>> bool(np.allclose(model.correct(model.distort(true)), true, rtol=0, atol=1e-15))
    True
    """

    matrix: np.ndarray
    bias: np.ndarray
    g_sensitivity: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self):
        for name, shape in (("matrix", (3, 3)), ("bias", (3,)), ("g_sensitivity", (3, 3))):
            array = np.array(getattr(self, name), dtype=float)
            if name == "g_sensitivity" and array.shape == (3,):
                array = np.diag(array)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"{name} is not a finite array of shape {shape}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def distort(self, true: np.ndarray, acceleration: np.ndarray | None = None) -> np.ndarray:
        """(N, 3) what the sensor reads for (N, 3) true values and true accelerations (m/s²)."""
        raw = true @ self.matrix.T + self.bias
        return raw if acceleration is None else raw + acceleration @ self.g_sensitivity.T

    def correct(self, raw: np.ndarray, acceleration: np.ndarray | None = None) -> np.ndarray:
        """(N, 3) true values for (N, 3) readings; `acceleration` is the calibrated one (m/s²)."""
        offset = self.bias
        if acceleration is not None:
            offset = offset + acceleration @ self.g_sensitivity.T
        return np.linalg.solve(self.matrix, (raw - offset).T).T

    @property
    def scale_factor_errors(self) -> np.ndarray:
        """(3,) S: diagonal of the matrix minus one."""
        return np.diag(self.matrix) - 1

    @classmethod
    def from_results(cls, calibration: dict) -> ErrorModel:
        """The model of a `calibration` of results.json."""
        return cls(
            calibration["matrix"],
            calibration["bias"],
            calibration.get("g_sensitivity") or np.zeros(3),
        )


IDEAL = ErrorModel(np.eye(3), np.zeros(3))


def parameter_names(free: np.ndarray, part: str = "matrix") -> tuple[str, ...]:
    """Such as "matrix.yx" of each free entry, row by row."""
    rows, columns = np.nonzero(free)
    return tuple(f"{part}.{'xyz'[r]}{'xyz'[c]}" for r, c in zip(rows, columns, strict=True))
