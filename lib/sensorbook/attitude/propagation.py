"""Attitude from the body's rates alone: by matrix, by Euler angles and by quaternion (work C, 5.1).

A gyroscope's readings become rotation vectors, one a step, and every method turns the attitude by
them. Between references it all hangs on those: on the time that a reading stands for, and on the
rotation's axis, which moves within a step (coning).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.single import turn_by

FEW = 5000  # steps, up to which one by one is the faster way
_COARSE = 2.0  # times the usual step: beyond it neighbouring readings do not tell a rate's slope


def rotation_increments(
    time: ArrayLike, rate: ArrayLike, delay: float = 0.0, coning: bool = True
) -> np.ndarray:
    """The rotation of the body in each step between stamps, as rotation vectors in body axes.

    The rate at the middle of a step is interpolated between the readings. With the rate linear in
    time around it, ω = a + b s, the rotation vector of a step of length h is
    φ = a h + (h³/12) a × b (Bortz 1971, to third order): the second part is the coning correction.

    Parameters
    ----------
    time : (N,) s, ascending
    rate : (N, 3) rad/s
    delay : s, by which a reading is late: what is stamped t is the rate at t − delay. 0 for samples;
        half an interval where a reading is the mean since the stamp before; minus half an interval
        where it holds until the next one, as in work C's (5.2)
    coning : False leaves the correction out, as (5.2) does

    Returns
    -------
    (N − 1, 3) rad
    """
    time, rate = np.asarray(time, dtype=float), np.asarray(rate, dtype=float)
    if time.ndim != 1 or rate.shape != (len(time), 3):
        raise ValueError(f"time {time.shape} and rate {rate.shape}: needed are (N,) and (N, 3)")
    step = np.diff(time)
    if not (step > 0).all():
        raise ValueError("time does not ascend")
    middle = (time[1:] + time[:-1]) / 2
    mean = np.stack([np.interp(middle + delay, time, axis) for axis in rate.T], axis=1)
    turned = mean * step[:, None]
    if coning and len(turned) > 1:
        slope = np.gradient(mean, middle, axis=0)
        part = np.cross(turned, slope) * (step**2 / 12)[:, None]
        turned = turned + np.where((step > _COARSE * np.median(step))[:, None], 0.0, part)
    return turned


def propagate(increments: ArrayLike, start: ArrayLike) -> np.ndarray:
    """Attitudes (N, 4), reference → body, from the first on, turned by (N − 1, 3) rotation vectors.

    A long record's quaternions are multiplied in about √N blocks side by side, which is as exact as one by
    one, and faster where there are many.
    """
    increments = np.asarray(increments, dtype=float)
    count = len(increments)
    if count <= FEW:
        each = [tuple(np.asarray(start, dtype=float).tolist())]
        for x, y, z in increments.tolist():
            each.append(turn_by(each[-1], x, y, z))
        return np.array(each) / np.linalg.norm(each, axis=1, keepdims=True)
    length = max(1, round(np.sqrt(count)))
    blocks = -(-count // length)
    padded = np.zeros((blocks * length, 3))
    padded[:count] = increments
    turns = Rotation.from_rotvec(padded).as_quat().reshape(blocks, length, 4)
    for k in range(1, length):
        turns[:, k] = (
            Rotation.from_quat(turns[:, k - 1]) * Rotation.from_quat(turns[:, k])
        ).as_quat()
    at = Rotation.from_quat(np.asarray(start, dtype=float))
    attitudes = np.empty((blocks, length, 4))
    for block in range(blocks):
        attitudes[block] = (at * Rotation.from_quat(turns[block])).as_quat()
        at = Rotation.from_quat(attitudes[block, -1])
    return np.concatenate([[np.asarray(start, dtype=float)], attitudes.reshape(-1, 4)[:count]])


def turn_matrix(increment: ArrayLike) -> np.ndarray:
    """C = I + (sin σ/σ) [σ×] + ((1 − cos σ)/σ²) [σ×]² of (5.2), (…, 3, 3), for σ (…, 3), rad."""
    increment = np.asarray(increment, dtype=float)
    size = np.linalg.norm(increment, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(increment, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1)
    cross = cross.reshape(*increment.shape, 3)
    # sinc keeps both factors finite at σ = 0.
    first, half = np.sinc(size / np.pi), np.sinc(size / (2 * np.pi))
    return np.eye(3) + first * cross + half**2 / 2 * (cross @ cross)


def propagate_matrix(
    turns: ArrayLike, start: ArrayLike, orthogonal: bool = True, dtype: type = np.float64
) -> np.ndarray:
    """Matrices body → reference, A ← A C (5.2), (N, 3, 3), as work C has them.

    Parameters
    ----------
    turns : (N − 1, 3, 3), C of each step, as `turn_matrix` gives it
    start : (3, 3), body → reference: the transpose of the house's A
    orthogonal : made orthogonal after each step (5.6), as work C does
    dtype : of the arithmetic; np.float32 shows what a small processor makes of it
    """
    turns = np.asarray(turns, dtype=dtype)
    matrices = np.empty((len(turns) + 1, 3, 3), dtype=dtype)
    matrices[0] = start
    for k, turn in enumerate(turns):
        matrix = matrices[k] @ turn
        matrices[k + 1] = orthogonalise(matrix) if orthogonal else matrix
    return matrices


def orthogonalise(matrix: ArrayLike) -> np.ndarray:
    """The orthogonal matrix nearest to A = U S Vᵀ: U Vᵀ (5.5, 5.6); (…, 3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt


def orthogonality_error(matrix: ArrayLike) -> np.ndarray:
    """How far A is from orthogonal: the largest element of A Aᵀ − I, (…), for A (…, 3, 3)."""
    matrix = np.asarray(matrix)
    product = matrix @ np.swapaxes(matrix, -1, -2)
    return np.abs(product - np.eye(3, dtype=matrix.dtype)).max(axis=(-2, -1))


def euler_rates(angles: ArrayLike, rate: ArrayLike) -> np.ndarray:
    """Rates of roll φ, pitch θ and yaw ψ of the sequence Z-Y-X (5.1), (…, 3), rad/s.

    `angles` (…, 3) are φ, θ, ψ, rad, `rate` (…, 3) is in body axes. At θ = ±90° (the lock) they are
    infinite: there φ and ψ turn about one axis.
    """
    roll, pitch, _ = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    x, y, z = np.moveaxis(np.asarray(rate, dtype=float), -1, 0)
    across = y * np.sin(roll) + z * np.cos(roll)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack(
            [
                x + np.tan(pitch) * across,
                y * np.cos(roll) - z * np.sin(roll),
                across / np.cos(pitch),
            ],
            axis=-1,
        )


def propagate_euler(increments: ArrayLike, start: ArrayLike) -> np.ndarray:
    """Roll, pitch and yaw (N, 3), rad, by (5.1), from (N − 1, 3) rotation vectors, one a step.

    Integrated by the classical Runge–Kutta method with the rate constant in a step, so that what
    goes wrong is the lock's doing and not the integrator's.
    """
    increments = np.asarray(increments, dtype=float)
    angles = np.empty((len(increments) + 1, 3))
    angles[0] = start
    for k, turned in enumerate(increments):
        at = angles[k]
        one = euler_rates(at, turned)
        two = euler_rates(at + one / 2, turned)
        three = euler_rates(at + two / 2, turned)
        four = euler_rates(at + three, turned)
        angles[k + 1] = at + (one + 2 * two + 2 * three + four) / 6
    return angles
