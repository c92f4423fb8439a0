"""What the directions of a rotation determine: of the sphere, and of each model's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from sensorbook.magnetometer.ellipsoid import BASES, ENTRIES, design, packed, unpacked

NEAR = np.radians(15.0)  # a direction counts as seen where a reading is within
MOST_DILUTION = 4.0  # times the error that readings all over the sphere leave
MOST_HARD_IRON = (
    0.05  # of the field: standard error of the hard iron, with what a reduced model neglects
)
MOST_ERROR = 0.10  # of the field: 95 % error of a corrected reading in the worst direction
# What a reduced model neglects, as standard deviations: soft iron of a sensor on a board is a few
# per cent, scale factors of uncalibrated ones differ by up to a tenth (data sheets of AMR and
# magneto-inductive triads state 5 to 15 %).
CROSS_AXIS, SCALE = 0.05, 0.10
FLAT = np.radians(20.0)  # half width of a belt that is called one plane
ONE_SIDED = 0.35  # length of the mean direction: of a half sphere it is 0.5
IDEAL = packed(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class Coverage:
    """How much of the sphere (N, 3) directions of the corrected field reach.

    Attributes
    ----------
    percent : share of the sphere within `NEAR` of a reading, %
    hole : (3,) unit direction farthest from every reading
    hole_angle : rad, from there to the nearest reading
    mean : (3,) mean direction, as a mean over the sphere seen; length 0 where it is even
    normal : (3,) unit direction along which the directions vary least
    flatness : rad, 90 % of the directions lie within this of a plane (or cone) across `normal`
    """

    percent: float
    hole: np.ndarray
    hole_angle: float
    mean: np.ndarray
    normal: np.ndarray
    flatness: float


def coverage(u: np.ndarray) -> Coverage:
    """The coverage of (N, 3) unit directions."""
    grid = even_directions()
    some = u[:: max(1, len(u) // 20000)]
    chord, _ = cKDTree(some).query(grid)
    angle = 2 * np.arcsin(np.clip(chord / 2, 0, 1))
    seen = grid[angle < NEAR]
    mean = seen.mean(axis=0) if len(seen) else u.mean(axis=0)
    normal = np.linalg.eigh(np.cov(u.T))[1][:, 0]
    along = u @ normal
    low, high = np.arcsin(np.clip(np.quantile(along, [0.05, 0.95]), -1, 1))
    farthest = int(angle.argmax())
    return Coverage(
        percent=100 * float((angle < NEAR).mean()),
        hole=grid[farthest],
        hole_angle=float(angle[farthest]),
        mean=mean,
        normal=normal * np.sign(along.mean() or 1.0),
        flatness=float(high - low) / 2,
    )


@cache
def even_directions(count: int = 1000) -> np.ndarray:
    """(count, 3) unit directions spread evenly (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    level = np.sqrt(1 - z**2)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)


def errors_by_direction(covariance: np.ndarray, parameters: np.ndarray = IDEAL) -> np.ndarray:
    """Standard error of the corrected unit vector in each of `even_directions`.

    `covariance` (9, 9) is that of `parameters` (9,), in any unit that has the field as 1.
    """
    effect = effects(even_directions(), parameters)
    return np.sqrt(np.einsum("gij,jk,gik->g", effect, covariance, effect))


def effects(u: np.ndarray, parameters: np.ndarray = IDEAL) -> np.ndarray:
    """(N, 3, 9) change of the corrected unit vectors `u` (N, 3) by each of the parameters (9,)."""
    s = unpacked(parameters)[1]
    read = np.linalg.solve(s, u.T).T
    result = np.zeros((len(u), 3, 9))
    result[:, :, :3] = -s
    for k, (i, j) in enumerate(ENTRIES):
        result[:, i, 3 + k] = read[:, j]
        result[:, j, 3 + k] = read[:, i]
    return result


def dilution(u: np.ndarray, model: str) -> float:
    """Worst-direction error of a corrected vector over that of readings all over the sphere.

    For directions `u` (N, 3) with the same independent error each; infinite where they do not
    determine the model.
    """
    return _worst(u, model) / _even(model)


@cache
def _even(model: str) -> float:
    return _worst(even_directions(), model)


def _worst(u: np.ndarray, model: str) -> float:
    basis = BASES[model]
    a = design(u, u, IDEAL) @ basis
    normal = a.T @ a / len(a)
    if np.linalg.cond(normal) > 1e10:
        return np.inf
    return float(errors_by_direction(basis @ np.linalg.inv(normal) @ basis.T).max())


def neglected(u: np.ndarray, model: str) -> np.ndarray:
    """(9, 9) covariance of the parameters by what a model leaves out, at h = 0, S = 1.

    What is left out is taken as random with the deviations above; the parameters that are fitted
    shift by the alias matrix times it (Box and Wilson 1951).
    """
    if model == "ellipsoid":
        return np.zeros((9, 9))
    left_out = np.eye(9)[:, 6:] * CROSS_AXIS
    if model == "hard_iron":
        # What the mean scale does not hold of three scale factors: two contrasts.
        contrast = np.zeros((9, 2))
        contrast[3:6] = np.array([[1, -1, 0], [1, 1, -2]]).T / np.sqrt([2, 6])
        left_out = np.hstack([contrast * SCALE, left_out])
    basis, a = BASES[model], design(u, u, IDEAL)
    # Readings that truly hold d (left_out) are fitted by basis · alias · d: the error is the difference.
    shift = basis @ np.linalg.lstsq(a @ basis, a @ left_out, rcond=None)[0] - left_out
    return shift @ shift.T


def motion_in_words(seen: Coverage) -> tuple[str, str]:
    """What the motion left out, and how to move instead; ("", "") where it left nothing out."""
    hole, away = axis_in_words(seen.hole), np.degrees(seen.hole_angle)
    if seen.percent > 90:
        return "", ""
    over = f"over, until its {hole} points along the field, too."
    if seen.flatness < FLAT:
        half, normal = np.degrees(seen.flatness), axis_in_words(seen.normal)
        return (
            f"the field stays within ±{half:.0f}° of one plane or cone across the device's {normal}",
            f"Tip it by 90° and {over}",
        )
    if np.linalg.norm(seen.mean) > ONE_SIDED:
        return (
            "the field is seen from one side only, about the device's "
            f"{axis_in_words(seen.mean)}, never within {away:.0f}° of {hole}",
            f"Turn it {over}",
        )
    return (
        f"the field is seen on {seen.percent:.0f} % of the sphere, never within {away:.0f}° of the device's "
        f"{hole}",
        f"Turn it {over}",
    )


def axis_in_words(direction: np.ndarray) -> str:
    """A direction in device axes by its nearest axes: "+x", or "+x −z" between two of them."""
    unit = direction / max(np.linalg.norm(direction), 1e-12)
    near = [k for k in range(3) if abs(unit[k]) > 0.4]  # of three equal ones each is 0.58
    return " ".join(("+" if unit[k] >= 0 else "−") + "xyz"[k] for k in near)
