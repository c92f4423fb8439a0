"""A multiplicative extended Kalman filter with bias states, and its smoother.

The attitude is a quaternion; the filter's state is what is wrong with it and with the bias. The
attitude's error ψ is kept in reference axes, R_est = exp(ψ) R_true for R body → reference, where it
does not turn with the body: over a step of length h, with readings ω + b + n,

    ψ ← ψ − S β + S n,   S = ∫ R dt,   β ← β + w

for the error β of the bias. The noise n gives N²/h to each reading, w gives K² h (Lefferts, Markley &
Shuster 1982; Markley 2003). What is given out is in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Attitudes, GyroscopeNoise, Motion, References
from sensorbook.attitude.single import (
    corrected,
    difference,
    exponential,
    logarithm,
    matrix_of_turn,
    product,
    turn_by,
)

LEAST = 1e-8  # rad, 0.002″: no reference is better, and rounding would make a better one's variances negative
AGAIN = 3  # times that a stretch is gone through again where its errors were large


@dataclass(frozen=True, eq=False)
class _Pass:
    """A forward pass over n stamps from the first reference on; errors in reference axes.

    quaternion (n, 4), bias (n, 3) and covariance (n, 6, 6) are those after the update; `carried`
    (n − 1, 3, 3) is S of each step, `update` (n, 6) what the references changed.
    """

    first: int
    quaternion: np.ndarray
    bias: np.ndarray
    covariance: np.ndarray
    carried: np.ndarray
    update: np.ndarray


def mekf(
    motion: Motion,
    references: References,
    noise: GyroscopeNoise,
    bias: np.ndarray | float = 0.0,
) -> Attitudes:
    """Attitude and bias with their covariance, each from the readings and references up to its stamp.

    Starts at the first reference; before it nothing is known. `bias` (3,) rad/s is what is known of
    the bias before, with the standard error `noise.bias_std`; 0 for the latter is the filter that
    knows the bias.

    Raises
    ------
    ValueError
        there is no reference
    """
    return _given_out(len(motion.time), _forward(motion, references, noise, bias))


def smoother(
    motion: Motion,
    references: References,
    noise: GyroscopeNoise,
    bias: np.ndarray | float = 0.0,
) -> Attitudes:
    """The same from all readings and references, before and after (Rauch, Tung & Striebel 1965).

    Where the filter was far off, it runs a second time, from the bias that the first pass back found: its
    errors are small from the start then, where the backward pass is linear in them.
    """
    found = _forward(motion, references, noise, bias)
    smoothed = _backward(found, motion, noise)
    far = Rotation.from_quat(smoothed.quaternion) * Rotation.from_quat(found.quaternion).inv()
    exact = np.sqrt(np.trace(references.covariance, axis1=1, axis2=2).min() / 3)
    # Of second order: beyond what a reference errs by it would count, as in the filter.
    if np.any(noise.bias_std) and far.magnitude().max() ** 2 > 2 * exact:
        found = _forward(motion, references, noise, smoothed.bias[0])
        smoothed = _backward(found, motion, noise)
    return _given_out(len(motion.time), smoothed)


def _forward(
    motion: Motion, references: References, noise: GyroscopeNoise, bias: np.ndarray | float
) -> _Pass:
    if not len(references):
        raise ValueError("there is no reference: the attitude has no start")
    first = int(references.at[0])
    steps, lost = motion.steps[first:], motion.lost[first:]
    n = len(motion.time) - first
    drift = np.diag(np.broadcast_to(noise.rate_random_walk, 3) ** 2)

    quaternions, biases = np.empty((n, 4)), np.empty((n, 3))
    covariances, carried = np.empty((n, 6, 6)), np.empty((n - 1, 3, 3))
    updates = np.zeros((n, 6))

    turn = Rotation.from_quat(references.quaternion).as_matrix()
    errors = turn @ references.covariance @ np.swapaxes(turn, -1, -2)  # in reference axes
    errors += LEAST**2 * np.eye(3)
    measured = references.quaternion.tolist()
    waiting = dict(zip((references.at - first).tolist(), range(len(references)), strict=True))

    forward, identity = np.eye(6), np.eye(3)
    increments, lengths, missing = motion.increments[first:].tolist(), steps.tolist(), lost.tolist()
    white = noise.growth(motion)[first:] / steps[:, None]  # S has a factor h on either side

    def step(k: int, at: tuple, matrix: np.ndarray, bias: tuple, p: np.ndarray):
        """To stamp k: the attitude, its matrix, S and the covariance there."""
        (x, y, z), (a, b, c), h = increments[k - 1], bias, lengths[k - 1]
        at = turn_by(at, x - a * h, y - b * h, z - c * h)
        after = matrix_of_turn(at)
        s = (matrix + after) * (h / 2)
        forward[:3, 3:] = -s
        p = forward @ p @ forward.T
        p[:3, :3] += (s * white[k - 1]) @ s.T
        p[3:, 3:] += drift * h
        if missing[k - 1]:
            p[:3, :3] += missing[k - 1] * identity
        return at, after, s, p

    def met(p: np.ndarray, off: np.ndarray, r: np.ndarray):
        """What a reference that is `off` (3,) with covariance r changes (6,), and the covariance after it."""
        weighted = _inverse_of_three(p[:3, :3] + r) @ p[:3]  # Kᵀ
        # (I − K) P = R (P + R)⁻¹ P, which does not cancel where the reference is near exact.
        upper = r @ weighted
        p = p - p[:, :3] @ weighted
        p[:3], p[3:, :3] = upper, upper[:, 3:].T
        return off @ weighted, p

    def again(last: int, here: int, start: tuple, change: np.ndarray):
        """The stretch up to a reference once more, about the bias that it showed.

        An attitude that was far off lets S point the wrong way. The bias's own mean before, as a
        state of the error about the new one, keeps what was known of it.
        """
        k0, at0, bias0, p0 = start
        for _ in range(AGAIN):
            near = np.subtract(bias0, change[3:])
            mean = np.concatenate([np.zeros(3), near - bias0])
            at, matrix, p = at0, matrix_of_turn(at0), p0
            for k in range(k0 + 1, last + 1):
                at, matrix, s, p = step(k, at, matrix, near.tolist(), p)
                mean[:3] -= s @ mean[3:]
            change, after = met(p, difference(at, measured[here]) - mean[:3], errors[here])
            left = change + mean
            change = np.concatenate([left[:3], bias0 - near + left[3:]])
            if left[:3] @ left[:3] < 2 * straight[here]:
                break
        return corrected(at, *left[:3].tolist()), tuple((near - left[3:]).tolist()), after

    straight = np.sqrt(np.trace(errors, axis1=1, axis2=2) / 3).tolist()
    sizes = np.linalg.eigvalsh(references.covariance)
    uneven = (sizes[:, 2] > 4 * sizes[:, 0]).tolist()
    at, bias = tuple(measured[0]), tuple(np.broadcast_to(bias, 3).astype(float).tolist())
    p = np.zeros((6, 6))
    p[:3, :3] = errors[0]
    p[3:, 3:] = np.diag(np.broadcast_to(noise.bias_std, 3).astype(float) ** 2)
    matrix, start = matrix_of_turn(at), (0, at, bias, p)
    quaternions[0], biases[0], covariances[0] = at, bias, p
    for k in range(1, n):
        at, matrix, carried[k - 1], p = step(k, at, matrix, bias, p)
        here = waiting.get(k)
        if here is not None:
            if uneven[here] and np.trace(p[:3, :3]) < straight[here] ** 2 * 3:
                # An axis that the reference hardly knows must not leak into those that it knows well.
                errors[here] = matrix @ references.covariance[here] @ matrix.T
            change, after = met(p, difference(at, measured[here]), errors[here])
            x, y, z, *turning = change.tolist()
            # Of second order in the correction: beyond what a reference errs by it would count.
            if x * x + y * y + z * z > 2 * straight[here] and any(turning):
                before, known = at, bias
                at, bias, p = again(k, here, start, change)
                change = np.concatenate([difference(before, at), np.subtract(known, bias)])
            else:
                at, p = corrected(at, x, y, z), after
                bias = tuple(b - c for b, c in zip(bias, turning, strict=True))
            updates[k] = change
            matrix, start = matrix_of_turn(at), (k, at, bias, p)
        quaternions[k], biases[k], covariances[k] = at, bias, p
    return _Pass(first, quaternions, biases, covariances, carried, updates)


def _backward(found: _Pass, motion: Motion, noise: GyroscopeNoise) -> _Pass:
    """Rauch, Tung and Striebel's pass from the end to the start, in errors of the forward one."""
    n = len(found.quaternion)
    steps, lost = motion.steps[found.first :], motion.lost[found.first :]
    forward = np.tile(np.eye(6), (n - 1, 1, 1))
    forward[:, :3, 3:] = -found.carried
    predicted = forward @ found.covariance[:-1] @ np.swapaxes(forward, -1, -2)
    white = noise.growth(motion)[found.first :] / steps[:, None]
    predicted[:, :3, :3] += (found.carried * white[:, None, :]) @ np.swapaxes(
        found.carried, -1, -2
    ) + lost[:, None, None] * np.eye(3)
    drift = np.broadcast_to(noise.rate_random_walk, 3) ** 2
    predicted[:, 3:, 3:] += np.diag(drift) * steps[:, None, None]
    # A bias that is known has no variance to invert: the pseudo-inverse leaves it alone.
    gain = found.covariance[:-1] @ np.swapaxes(forward, -1, -2) @ _inverse(predicted)

    off = np.zeros(6)  # of the smoothed from the filtered: what is still wrong with the latter
    offs, covariance = np.zeros((n, 6)), np.array(found.covariance)
    changed = found.update.any(axis=1).tolist()
    for k in range(n - 2, -1, -1):
        if changed[k + 1]:
            off = _joined(off, found.update[k + 1])
        off = gain[k] @ off
        offs[k] = off
        covariance[k] += gain[k] @ (covariance[k + 1] - predicted[k]) @ gain[k].T
    turned = Rotation.from_rotvec(-offs[:, :3]) * Rotation.from_quat(found.quaternion)
    bias = found.bias - offs[:, 3:]
    return _Pass(found.first, turned.as_quat(), bias, covariance, found.carried, found.update)


def _joined(off: np.ndarray, update: np.ndarray) -> np.ndarray:
    """What is wrong with the prediction: first the update, then what is wrong after it."""
    turned = logarithm(*product(exponential(*update[:3]), exponential(*off[:3])))
    return np.concatenate([turned, update[3:] + off[3:]])


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses of covariances (n, 6, 6), scaled to unit diagonals before; zero for what is known."""
    size = np.sqrt(np.diagonal(matrices, axis1=-2, axis2=-1))
    scale = np.where(size > 0, 1 / np.where(size > 0, size, 1), 0.0)
    scaled = matrices * scale[:, :, None] * scale[:, None, :]
    # Exact references and no noise leave one of two errors to tell the other: rounding's worth of its own.
    scaled += np.where(size > 0, 1e-13, 1.0)[:, :, None] * np.eye(6)
    return np.linalg.inv(scaled) * scale[:, :, None] * scale[:, None, :]


def _given_out(count: int, found: _Pass) -> Attitudes:
    """The result with the covariance in body axes, NaN before the first reference."""
    quaternion, bias = np.full((count, 4), np.nan), np.full((count, 3), np.nan)
    covariance = np.full((count, 6, 6), np.nan)
    quaternion[found.first :], bias[found.first :] = found.quaternion, found.bias
    turn = Rotation.from_quat(found.quaternion).as_matrix()
    back, known = np.swapaxes(turn, -1, -2), covariance[found.first :]
    known[:] = found.covariance
    known[:, :3, :3] = back @ known[:, :3, :3] @ turn
    known[:, :3, 3:] = back @ known[:, :3, 3:]
    known[:, 3:, :3] = np.swapaxes(known[:, :3, 3:], -1, -2)
    return Attitudes(quaternion, bias, covariance)


def _inverse_of_three(matrix: np.ndarray) -> np.ndarray:
    """The inverse of a symmetric (3, 3) matrix, by its cofactors."""
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    u, v, w = a * f - c * c, b * c - a * e, a * d - b * b
    size = a * x + b * y + c * z
    return np.array([[x, y, z], [y, u, v], [z, v, w]]) / size
