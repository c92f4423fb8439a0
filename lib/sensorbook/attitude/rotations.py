"""Representations of attitude and the ways between them (work C, 2.1 to 2.5), over arrays.

The convention is C's, and passive: the direction-cosine matrix A turns a vector's components in the
reference frame into those in the body frame, v_body = A v_ref; its rows are the body's axes. scipy's
`Rotation` is active, so that A = Rotation.as_matrix().T; quaternion and rotation vector are the same
numbers in both. Leading dimensions are a batch, and angles are in radians.

Where a batch holds NaN, which is how an attitude that was not determined is written, that element's
result is NaN and the others stand.

Quaternions are Euler–Rodrigues symmetric parameters with the scalar last (2.9):
q = [e sin(Φ/2), cos(Φ/2)] for the Euler axis e and angle Φ. q and −q are one attitude.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.wahba import matrix_of

AXES = "XYZ"
# The same axis twice in a row is one rotation: 3 · 2 · 2 sequences are left.
SEQUENCES = tuple(a + b + c for a in AXES for b in AXES for c in AXES if a != b != c)

# What is given with four digits or more is taken and set right; anything worse is a mistake.
_WORST = 1e-3
_EPS = np.finfo(float).eps


def axis_rotation(axis: str, angle: ArrayLike) -> np.ndarray:
    """A(e, angle) about one coordinate axis, "X", "Y" or "Z": (…, 3, 3) for angles (…), rad (2.15, 2.16).

    >>> axis_rotation("Z", np.pi / 2).round(12) @ [1, 0, 0]  # the reference's x is the body's −y
    array([ 0., -1.,  0.])
    """
    k = _axis(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    angle = np.asarray(angle, dtype=float)
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., k, k] = 1
    matrix[..., i, i] = matrix[..., j, j] = np.cos(angle)
    matrix[..., i, j] = np.sin(angle)
    matrix[..., j, i] = -matrix[..., i, j]
    return matrix


def matrix_from_quaternion(quaternion: ArrayLike) -> np.ndarray:
    """A(q) (2.10), (…, 3, 3), for unit quaternions (…, 4)."""
    return _matrix(_unit(quaternion, 4, "quaternion"))


def quaternion_from_matrix(matrix: ArrayLike) -> np.ndarray:
    """The quaternion (…, 4) of a direction-cosine matrix (…, 3, 3), with q₄ ≥ 0.

    C gives the branch that divides by q₄ (2.11); here the largest component is found first, so that
    no attitude is near a division by zero.
    """
    rotation, none = _rotation(matrix)
    quaternion = rotation.as_quat(canonical=True)
    quaternion[none] = np.nan
    return quaternion


def matrix_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> np.ndarray:
    """A(e, Φ) = cosΦ I + (1 − cosΦ) e eᵀ − sinΦ [e×] (2.6), for unit axes (…, 3) and angles (…), rad."""
    return _matrix(_half_angle(axis, angle))


def axis_angle_from_matrix(matrix: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Euler axis (…, 3) and angle (…), 0 to π rad, of a direction-cosine matrix (2.7, 2.8).

    By way of the quaternion: C's arccosine loses half the digits at 0 and π, and its axis divides by
    sin Φ. At Φ = 0 every axis is right, and x is returned; at Φ = π the axis has two signs.
    """
    return axis_angle_from_quaternion(quaternion_from_matrix(matrix))


def quaternion_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> np.ndarray:
    """q = [e sin(Φ/2), cos(Φ/2)] (2.9), (…, 4), for unit axes (…, 3) and angles (…), rad; any sign of q₄."""
    return _half_angle(axis, angle)


def axis_angle_from_quaternion(quaternion: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Euler axis (…, 3) and angle (…), 0 to π rad, of unit quaternions (…, 4)."""
    quaternion = _unit(quaternion, 4, "quaternion")
    quaternion = np.where(quaternion[..., 3:] < 0, -quaternion, quaternion)
    size = np.linalg.norm(quaternion[..., :3], axis=-1)
    none = size == 0
    axis = quaternion[..., :3] / np.where(none, 1.0, size)[..., None]
    axis[none] = [1.0, 0.0, 0.0]
    return axis, 2 * np.arctan2(size, quaternion[..., 3])


def matrix_from_euler(sequence: str, angles: ArrayLike) -> np.ndarray:
    """A(φ, θ, ψ) = A(e₃, ψ) A(e₂, θ) A(e₁, φ) (2.17) for one of the 12 `SEQUENCES`, first rotation first.

    Parameters
    ----------
    sequence : "ZYX" (yaw, pitch, roll), "ZXZ", …
    angles : (…, 3), rad, in the order of the sequence

    Returns
    -------
    (…, 3, 3)
    """
    first, second, third = _sequence(sequence)
    angles = _last(angles, 3, "Euler angles")
    return (
        axis_rotation(AXES[third], angles[..., 2])
        @ axis_rotation(AXES[second], angles[..., 1])
        @ axis_rotation(AXES[first], angles[..., 0])
    )


def euler_from_matrix(sequence: str, matrix: ArrayLike) -> np.ndarray:
    """Euler angles (…, 3), rad, of direction-cosine matrices (…, 3, 3) for one of the 12 `SEQUENCES`.

    The second angle is in [0, π] where first and last axis are the same, else in [−π/2, π/2]; the
    others are in [−π, π]. Where the second makes the other two axes one (`lock_margin` 0), only their
    sum or difference is determined: the first is then 0. The angles give the matrix back to rounding
    everywhere: what is noise in the first near the lock is taken up by the other two, which are read
    from A A(e₁, φ)ᵀ and not, as in (2.20) and (2.21), each from elements of A that vanish together.
    """
    i, j, last = _sequence(sequence)
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0  # whether i, j, k is right-handed
    rotation, none = _rotation(matrix)
    matrix = np.swapaxes(rotation.as_matrix(), -1, -2)
    matrix[none] = np.nan
    symmetric = last == i
    if symmetric:
        sine, cosine = matrix[..., i, j], -sign * matrix[..., i, k]
    else:
        sine, cosine = -sign * matrix[..., k, j], matrix[..., k, k]
    first = np.where(np.hypot(sine, cosine) < 8 * _EPS, 0.0, np.arctan2(sine, cosine))
    left = matrix @ np.swapaxes(axis_rotation(AXES[i], first), -1, -2)
    if symmetric:
        second = np.arctan2(-sign * left[..., i, k], left[..., i, i])
        third = np.arctan2(-sign * left[..., k, j], left[..., j, j])
        second = np.abs(second)  # below 0, or −π, by rounding only
    else:
        second = np.arctan2(sign * left[..., k, i], left[..., k, k])
        third = np.arctan2(sign * left[..., i, j], left[..., j, j])
        second = np.clip(second, -np.pi / 2, np.pi / 2)  # beyond by rounding only
    return np.stack([first, second, third], axis=-1)


def lock_margin(sequence: str, angles: ArrayLike) -> np.ndarray:
    """How far Euler angles (…, 3) are from their singularity: 1 is farthest, 0 is locked; (…).

    |sin θ| of the second angle where first and last axis are the same, else |cos θ|. An error of the
    attitude appears in the first and the third angle divided by it.
    """
    first, _, third = _sequence(sequence)
    second = _last(angles, 3, "Euler angles")[..., 1]
    return np.abs(np.sin(second) if first == third else np.cos(second))


def compose_quaternions(second: ArrayLike, first: ArrayLike) -> np.ndarray:
    """q″ = q′ ⊗ q (2.12), with A(q″) = A(q′) A(q): first q, then q′; (…, 4) each, batches broadcast."""
    second, first = _unit(second, 4, "quaternion"), _unit(first, 4, "quaternion")
    x, y, z, w = np.moveaxis(second, -1, 0)
    a, b, c, d = np.moveaxis(first, -1, 0)
    return np.stack(
        [
            w * a + z * b - y * c + x * d,
            -z * a + w * b + x * c + y * d,
            y * a - x * b + w * c + z * d,
            -x * a - y * b - z * c + w * d,
        ],
        axis=-1,
    )


def transform(quaternion: ArrayLike, vector: ArrayLike) -> np.ndarray:
    """v_body = q ⊗ v_ref ⊗ q⁻¹ (2.13), (…, 3), for quaternions (…, 4) and vectors (…, 3)."""
    vector = _last(vector, 3, "vector")
    return (matrix_from_quaternion(quaternion) @ vector[..., None])[..., 0]


def error_vector(estimated: ArrayLike, true: ArrayLike) -> np.ndarray:
    """The rotation vector (…, 3), rad, in body axes, that turns the true attitude into the estimated.

    A_estimated = A(δ) A_true with A(δ) ≈ I − [δ×]; its length is the angle between the two, right
    down to rounding and up to π. Both are direction-cosine matrices (…, 3, 3).
    """
    turned = np.asarray(estimated, dtype=float) @ np.swapaxes(np.asarray(true, dtype=float), -1, -2)
    axis, angle = axis_angle_from_matrix(turned)
    return axis * angle[..., None]


def _axis(axis: str) -> int:
    if axis not in ("X", "Y", "Z"):
        raise ValueError(f'axis is {axis!r}: give "X", "Y" or "Z"')
    return AXES.index(axis)


def _sequence(sequence: str) -> tuple[int, int, int]:
    if sequence not in SEQUENCES:
        raise ValueError(f"Euler sequence is {sequence!r}: give one of {', '.join(SEQUENCES)}")
    first, second, third = (AXES.index(letter) for letter in sequence)
    return first, second, third


def _last(array: ArrayLike, size: int, what: str) -> np.ndarray:
    array = np.asarray(array, dtype=float)
    if array.ndim < 1 or array.shape[-1] != size:
        raise ValueError(f"{what}: shape is {array.shape}, needed is (…, {size})")
    return array


def _unit(array: ArrayLike, size: int, what: str) -> np.ndarray:
    """The arrays made unit; a ValueError where they are not nearly so."""
    array = _last(array, size, what)
    norm = np.linalg.norm(array, axis=-1, keepdims=True)
    off = np.abs(norm - 1)
    if (off > _WORST).any():
        worst = norm.ravel()[np.nanargmax(off)]
        raise ValueError(f"{what}: its length is {worst:.6g}, needed is 1")
    return array / norm


def _half_angle(axis: ArrayLike, angle: ArrayLike) -> np.ndarray:
    axis = _unit(axis, 3, "Euler axis")
    half = np.asarray(angle, dtype=float)[..., None] / 2
    axis, half = np.broadcast_arrays(axis, half)
    return np.concatenate([axis * np.sin(half), np.cos(half[..., :1])], axis=-1)


def _rotation(matrix: ArrayLike) -> tuple[Rotation, np.ndarray]:
    """scipy's Rotation of direction-cosine matrices, and which are none for want of a number.

    A ValueError where a matrix is no rotation.
    """
    matrix = np.asarray(matrix, dtype=float)
    if matrix.ndim < 2 or matrix.shape[-2:] != (3, 3):
        raise ValueError(f"direction-cosine matrix: shape is {matrix.shape}, needed is (…, 3, 3)")
    none = np.isnan(matrix).any(axis=(-2, -1))
    matrix = np.where(none[..., None, None], np.eye(3), matrix)
    with np.errstate(invalid="ignore"):  # infinity: said below
        off = np.abs(matrix @ np.swapaxes(matrix, -1, -2) - np.eye(3)).max(initial=0.0)
    if not off <= _WORST:
        raise ValueError(
            f"direction-cosine matrix: A Aᵀ differs from the identity by {off:.2g}; it is no rotation"
        )
    if (np.linalg.det(matrix) < 0).any():
        raise ValueError(
            "direction-cosine matrix: its determinant is −1; it mirrors, a left-handed frame"
        )
    return Rotation.from_matrix(np.swapaxes(matrix, -1, -2)), none


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    rows = matrix_of(np.moveaxis(quaternion, -1, 0))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
