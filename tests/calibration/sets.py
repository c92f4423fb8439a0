"""Sets of rests of an accelerometer with known errors, by their means and white noise alone."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.calibration.positions import Positions

G = 9.80665
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
EDGES = np.array(
    [[a, b, 0] for a in (1, -1) for b in (1, -1)]
    + [[a, 0, b] for a in (1, -1) for b in (1, -1)]
    + [[0, a, b] for a in (1, -1) for b in (1, -1)],
    dtype=float,
) / np.sqrt(2)
EIGHTEEN = np.vstack([FACES, EDGES])

# raw = MATRIX true + BIAS: a poor consumer part.
MATRIX = np.array([[1.012, 0, 0], [0.008, 0.987, 0], [-0.013, 0.004, 1.021]])
BIAS = np.array([0.35, -0.62, 0.11])


def by_hand(directions, degrees, rng) -> np.ndarray:
    """Directions missed by some degrees rms about each axis."""
    turn = np.radians(degrees) * rng.standard_normal(np.shape(directions))
    return Rotation.from_rotvec(turn).apply(directions)


def rests(
    directions, rng, *, matrix=MATRIX, bias=BIAS, white=0.01, wander=4e-4, samples=400, runs=None,
    temperature=None,
) -> Positions:  # fmt: skip
    """Rests with specific force G along `directions` (P, 3), SI.

    `white` is the standard deviation of a sample, `wander` that of a rest's mean besides.
    """
    parts = []
    for u in np.asarray(directions, dtype=float):
        mean = matrix @ (G * u) + bias + wander * rng.standard_normal(3)
        parts.append(mean + white * rng.standard_normal((samples, 3)))
    count = len(parts)
    ends = 10.0 * np.arange(count)[:, None] + [0.0, 4.0]
    return Positions(
        tuple(parts),
        ends,
        tuple(f"{k + 1} ({a:.1f}–{b:.1f} s)" for k, (a, b) in enumerate(ends)),
        np.zeros(count, dtype=int) if runs is None else np.asarray(runs),
        temperature,
    )
