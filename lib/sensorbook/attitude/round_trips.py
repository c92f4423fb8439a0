"""How well attitudes come back near the singularities of their representations (work C, 2.5).

C's printed formulas stand here beside `rotations`, only to be measured against them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude import rotations
from sensorbook.attitude.rotations import AXES

# Down to nothing: 1 … 1e-16 rad in quarters of a decade.
DISTANCES = 10.0 ** np.arange(0, -16.25, -0.25)
COUNT = 400  # attitudes at each distance


@dataclass(frozen=True)
class RoundTrip:
    """Errors of an attitude that went to a representation and back.

    Attributes
    ----------
    distance : (D,), rad, from the singularity
    printed, ours : (D,), rad, the largest error among the attitudes at that distance, with C's formula
        and with `rotations`; π where a formula has no result
    """

    distance: np.ndarray
    printed: np.ndarray
    ours: np.ndarray

    @property
    def half_lost(self) -> float | None:
        """The largest distance, rad, at which C's formula errs by more than 1.5e-8, half the digits."""
        lost = self.distance[self.printed > np.sqrt(np.finfo(float).eps)]
        return float(lost.max()) if lost.size else None


def printed_euler(sequence: str, matrix: ArrayLike) -> np.ndarray:
    """Euler angles (…, 3) as in (2.20), each from elements of its own, for any sequence."""
    i, j, last = (AXES.index(letter) for letter in sequence)
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    a = np.asarray(matrix, dtype=float)
    if last == i:
        first = np.arctan2(a[..., i, j], -sign * a[..., i, k])
        second = np.arccos(np.clip(a[..., i, i], -1, 1))
        third = np.arctan2(a[..., j, i], sign * a[..., k, i])
    else:
        first = np.arctan2(-sign * a[..., k, j], a[..., k, k])
        second = np.arcsin(np.clip(sign * a[..., k, i], -1, 1))
        third = np.arctan2(-sign * a[..., j, i], a[..., i, i])
    return np.stack([first, second, third], axis=-1)


def printed_quaternion(matrix: ArrayLike) -> np.ndarray:
    """The quaternion (…, 4) as in (2.11), divided by q₄; not finite where that is 0."""
    a = np.asarray(matrix, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        q4 = 0.5 * np.sqrt(1 + np.trace(a, axis1=-2, axis2=-1))
        return np.concatenate([_off_diagonal(a) / (4 * q4[..., None]), q4[..., None]], axis=-1)


def printed_angle(matrix: ArrayLike) -> np.ndarray:
    """The Euler angle (…), rad, by the arccosine of (2.7)."""
    return np.arccos(np.clip((np.trace(matrix, axis1=-2, axis2=-1) - 1) / 2, -1, 1))


def euler_round_trip(sequence: str, seed: int) -> RoundTrip:
    """Matrix → Euler angles → matrix, by the second angle's distance from the lock."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (len(DISTANCES), COUNT, 3))
    lock = 0.0 if sequence[0] == sequence[2] else np.pi / 2
    angles[..., 1] = lock + (DISTANCES if lock == 0 else -DISTANCES)[:, None]
    a = _as_product(rotations.matrix_from_euler(sequence, angles), rng)
    found = [printed_euler(sequence, a), rotations.euler_from_matrix(sequence, a)]
    back = [_angle_between(rotations.matrix_from_euler(sequence, f), a) for f in found]
    return RoundTrip(DISTANCES, *(b.max(axis=1) for b in back))


def quaternion_round_trip(seed: int) -> RoundTrip:
    """Matrix → quaternion → matrix, by the Euler angle's distance from π, where q₄ is 0."""
    a = _turns(np.pi - DISTANCES, seed)
    printed, ours = printed_quaternion(a), rotations.quaternion_from_matrix(a)
    length = np.linalg.norm(printed, axis=-1, keepdims=True)
    sound = (np.isfinite(length) & (length > 0))[..., 0]
    back = np.full(sound.shape, np.pi)
    unit = printed[sound] / length[sound]
    back[sound] = _angle_between(rotations.matrix_from_quaternion(unit), a[sound])
    own = _angle_between(rotations.matrix_from_quaternion(ours), a)
    return RoundTrip(DISTANCES, back.max(axis=1), own.max(axis=1))


def angle_round_trip(seed: int) -> RoundTrip:
    """Euler angle → matrix → Euler angle, by the angle: what is lost of a small one."""
    a = _turns(DISTANCES, seed)
    printed, ours = printed_angle(a), rotations.axis_angle_from_matrix(a)[1]
    off = [np.abs(found - DISTANCES[:, None]).max(axis=1) for found in (printed, ours)]
    return RoundTrip(DISTANCES, *off)


def amplification(sequence: str, second: ArrayLike, error: float, seed: int) -> np.ndarray:
    """Rms errors (N, 3), rad, of the Euler angles where the attitude errs by `error` rad rms an axis.

    `second` (N,), rad, are the second angles; the first and the third are random.
    """
    rng = np.random.default_rng(seed)
    second = np.asarray(second, dtype=float)
    angles = rng.uniform(-np.pi, np.pi, (len(second), COUNT, 3))
    angles[..., 1] = second[:, None]
    delta = error * rng.normal(size=angles.shape)
    size = np.linalg.norm(delta, axis=-1)
    wrong = rotations.matrix_from_axis_angle(delta / size[..., None], size)
    found = rotations.euler_from_matrix(
        sequence, wrong @ rotations.matrix_from_euler(sequence, angles)
    )
    off = np.angle(np.exp(1j * (found - angles)))
    return np.sqrt((off**2).mean(axis=1))


def _turns(angles: np.ndarray, seed: int) -> np.ndarray:
    """Matrices (D, COUNT, 3, 3) of turns by `angles` (D,) about random axes."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(len(angles), COUNT, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    return _as_product(rotations.matrix_from_axis_angle(axes, angles[:, None]), rng)


def _as_product(a: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The attitudes as products of two, whose elements all err by rounding of 1, however small they are."""
    q = rng.normal(size=(*a.shape[:-2], 4))
    half = rotations.matrix_from_quaternion(q / np.linalg.norm(q, axis=-1, keepdims=True))
    return (a @ np.swapaxes(half, -1, -2)) @ half


def _off_diagonal(a: np.ndarray) -> np.ndarray:
    """A₂₃ − A₃₂, A₃₁ − A₁₃, A₁₂ − A₂₁."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return np.stack([a[..., i, j] - a[..., j, i] for i, j in pairs], axis=-1)


def _angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The angle between attitudes, rad, from the length of the matrices' difference, 2√2 sin(angle/2)."""
    chord = np.linalg.norm(one - other, axis=(-2, -1)) / np.sqrt(8)
    return 2 * np.arcsin(np.minimum(chord, 1))
