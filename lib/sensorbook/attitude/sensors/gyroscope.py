"""Gyroscope as an attitude sensor: rates, whose errors grow with time (work C, 3.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.calibration.model import ErrorModel
from sensorbook.simulate.noise import coloured_noise

UNOBSERVABLE = (
    "A gyroscope sees how the attitude changes, not what it is: "
    "the start has to come from another sensor."
)


def gyroscope(
    scale: ArrayLike = (0.0, 0.0, 0.0),
    misalignment: ArrayLike = ((0.0, 0.0, 0.0),) * 3,
    drift: ArrayLike = (0.0, 0.0, 0.0),
) -> ErrorModel:
    """The model ŵ = (I + S) w + β (3.17) in the house's form, matrix = I + S and bias = β.

    `scale` is the diagonal of S, `misalignment` (3, 3), rad, its other entries, `drift` β, rad/s. Its
    `correct` is the inversion, w = (I + S)⁻¹ (ŵ − β).
    """
    other = np.asarray(misalignment, dtype=float)
    if other.shape != (3, 3) or np.diag(other).any():
        raise ValueError(
            "misalignment is no (3, 3) matrix with a diagonal of zeros: give the diagonal as `scale`"
        )
    return ErrorModel(np.eye(3) + np.diag(np.asarray(scale, dtype=float)) + other, drift)


def rates(
    model: ErrorModel,
    true: ArrayLike,
    rate: float,
    rng: np.random.Generator,
    *,
    angle_random_walk: float = 0.0,
    bias_instability: float = 0.0,
    rate_random_walk: float = 0.0,
) -> np.ndarray:
    """ŵ = (I + S) w + β + η (3.16, 3.17), (N, 3), rad/s, for true rates (N, 3) at `rate` Hz.

    `angle_random_walk` N is in rad/√s, so that a sample of white noise scatters by N√rate; B in rad/s
    and K in rad/s/√s add slower noise. The walk of K is a sum of steps of K/√rate from 0 at the start,
    because `coloured_noise`, which is periodic, makes it 6.5 % too small at the record's end.
    """
    true = np.asarray(true, dtype=float)
    if true.ndim != 2 or true.shape[1] != 3:
        raise ValueError(f"rates: shape is {true.shape}, needed is (N, 3)")
    terms = {"random_walk": angle_random_walk, "bias_instability": bias_instability}
    noise = np.column_stack([coloured_noise(len(true), rate, rng, **terms) for _ in range(3)])
    if rate_random_walk:
        steps = rng.normal(0.0, rate_random_walk / np.sqrt(rate), (max(len(true) - 1, 0), 3))
        noise[1:] += np.cumsum(steps, axis=0)
    return model.distort(true) + noise


def angle_error(
    time: ArrayLike, drift: float, angle_random_walk: float
) -> tuple[np.ndarray, np.ndarray]:
    """What integration makes of both after `time` (…), s: β t, and N √t as one standard deviation, rad."""
    time = np.asarray(time, dtype=float)
    return drift * time, angle_random_walk * np.sqrt(time)
