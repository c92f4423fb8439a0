"""The ellipsoid that a magnetometer's readings lie on: ``‖S (m − h)‖ = 1``, S symmetric.

A field of constant strength, seen in all attitudes, is a sphere; hard iron moves it by h, soft iron
and scale factors make it an ellipsoid (A 6.1–6.4, 6.19–6.31). Only the symmetric square root of its
quadric is seen: a turn of the sensor's axes leaves the length of the field as it is.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

# Parameters in the order of every vector here: h, then the entries of S in this order.
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
PARAMETERS = (
    *(f"hard_iron.{a}" for a in "xyz"),
    *(f"soft_iron.{'xyz'[i]}{'xyz'[j]}" for i, j in ENTRIES),
)
COARSE = 5000  # readings that a long recording is fitted on first
# Columns: what each model is free to change of these nine.
BASES = {
    "ellipsoid": np.eye(9),
    "diagonal": np.eye(9)[:, :6],
    "hard_iron": np.vstack([np.eye(3, 4), np.repeat([[0, 0, 0, 1.0]], 3, 0), np.zeros((3, 4))]),
}


def packed(h: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(9,) parameters of centre (3,) and symmetric matrix (3, 3)."""
    return np.r_[h, [s[e] for e in ENTRIES]]


def unpacked(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3,) and symmetric matrix (3, 3)."""
    s = np.empty((3, 3))
    for value, (i, j) in zip(parameters[3:], ENTRIES, strict=True):
        s[i, j] = s[j, i] = value
    return parameters[:3].copy(), s


def residuals(m: np.ndarray, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``‖S (m − h)‖ − 1`` (N,) and the unit directions (N, 3) of the corrected readings."""
    h, s = unpacked(parameters)
    corrected = (m - h) @ s
    length = np.linalg.norm(corrected, axis=1)
    length = np.maximum(length, np.finfo(float).tiny)
    return length - 1, corrected / length[:, None]


def design(u: np.ndarray, m: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(N, 9) derivatives of the residuals with directions `u` (N, 3) at readings `m` (N, 3)."""
    h, s = unpacked(parameters)
    d = m - h
    columns = [
        u[:, i] * d[:, i] if i == j else u[:, i] * d[:, j] + u[:, j] * d[:, i] for i, j in ENTRIES
    ]
    return np.hstack([-u @ s, np.stack(columns, axis=1)])


@np.errstate(all="ignore")  # of degenerate readings: what is not finite is None
def algebraic(m: np.ndarray) -> np.ndarray | None:
    """(9,) least-squares quadric of (N, 3) readings that is an ellipsoid; None where there is none.

    Li and Griffiths, "Least squares ellipsoid specific fitting" (GMP 2004), with 4J − I² = 1: any
    ellipsoid whose shortest axis is at least half its longest satisfies it, and what satisfies it is
    an ellipsoid. Flatter ones are left to `refine`.
    """
    centre = m.mean(axis=0)
    size = np.abs(m - centre).max()
    if size == 0:
        return None
    x, y, z = ((m - centre) / size).T
    d = np.stack([x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z,
                  np.ones_like(x)])  # fmt: skip
    scatter = d @ d.T
    constraint = np.zeros((6, 6))
    constraint[:3, :3] = 1 - 2 * np.eye(3)
    constraint[3:, 3:] = -4 * np.eye(3)
    try:
        rest = np.linalg.solve(scatter[6:, 6:], scatter[6:, :6])
        values, vectors = np.linalg.eig(
            np.linalg.solve(constraint, scatter[:6, :6] - scatter[:6, 6:] @ rest)
        )
    except np.linalg.LinAlgError:
        return None
    a, b, c, f, g, e = v = vectors[:, np.argmax(values.real)].real
    quadric = np.array([[a, e, g], [e, b, f], [g, f, c]])
    linear, constant = np.split(-rest @ v, [3])
    try:
        h = -np.linalg.solve(quadric, linear)
    except np.linalg.LinAlgError:
        return None
    quadric = quadric / (h @ quadric @ h - constant[0])
    if not np.isfinite(quadric).all():
        return None
    squares, turn = np.linalg.eigh(quadric)
    if squares[0] <= 0:
        return None
    return packed(centre + size * h, turn @ np.diag(np.sqrt(squares) / size) @ turn.T)


def sphere(m: np.ndarray, flat: float = 1e-6) -> np.ndarray:
    """(9,) least-squares sphere of (N, 3) readings; of a plane the one centred in it.

    As a plane count readings whose thinnest direction is below `flat` of their widest, where these are
    scaled to about 1.
    """
    centre = m.mean(axis=0)
    x = m - centre
    a = np.hstack([2 * x, np.ones((len(x), 1))])
    # Of a plane the shortest solution is taken, in it.
    solution = np.linalg.lstsq(a, (x**2).sum(axis=1), rcond=flat)[0]
    h, constant = solution[:3], solution[3]
    return packed(centre + h, np.eye(3) / np.sqrt(max(constant + h @ h, np.finfo(float).tiny)))


def refine(
    m: np.ndarray,
    start: np.ndarray,
    basis: np.ndarray,
    robust: bool = False,
    steps: int = 50,
) -> np.ndarray:
    """(9,) parameters that minimise the sum of squared residuals within `basis` (9, K).

    Levenberg–Marquardt from `start`. `robust` minimises Tukey's bisquare instead (c = 4.685, 95 %
    efficient; Beaton and Tukey 1974), the scale being that of the residuals' median at each step.
    """
    if len(m) > 2 * COARSE:
        # Most of the way on a part; poor motions go far, and slowly.
        start = refine(m[:: len(m) // COARSE], start, basis, robust, steps)
        steps = 10
    parameters, damping = start, 1e-9
    r, u = residuals(m, parameters)
    for _ in range(steps):
        w = bisquare(r) if robust else np.ones_like(r)
        jacobian = design(u, m, parameters) @ basis
        normal = jacobian.T @ (w[:, None] * jacobian)
        slope = jacobian.T @ (w * r)
        before, scaled = w @ r**2, np.diag(np.diag(normal)) + 1e-300 * np.eye(len(normal))
        while damping < 1e9:
            step = np.linalg.lstsq(normal + damping * scaled, -slope, rcond=None)[0]
            new = parameters + basis @ step
            new_r, new_u = residuals(m, new)
            # For the weights of this step: with the new ones the sum need not fall.
            if w @ new_r**2 <= before * (1 + 1e-12):
                break
            damping = max(10 * damping, 1e-6)
        else:
            break
        moved = np.abs(basis @ step).max() / np.abs(parameters).max()
        parameters, r, u, damping = new, new_r, new_u, damping / 10
        if moved < 1e-10:
            break
    return parameters


def noise_slopes(m: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(N, 9) what noise in the readings adds, on average, to ``design · residual`` of each reading.

    A noisy vector is longer than its mean by half the variance across it, and the derivatives at a
    noisy reading are correlated with its residual: to second order. Each axis has a variance of its
    own, which the squares of the residuals tell by direction.
    """
    r, u = residuals(m, parameters)
    s = unpacked(parameters)[1]
    normal = u @ s  # the residual's gradient
    variances = nnls(normal**2, r**2)[0]
    noise = normal * variances  # covariance of a reading with its residual
    across = ((s**2).sum(axis=0) @ variances - (normal * noise).sum(axis=1)) / 2
    # Steps far below the readings' size, and differences far above rounding.
    step = 1e-4 / (np.abs(s).max() * max(np.abs(noise).max(), np.finfo(float).tiny))
    ahead, behind = m + step * noise, m - step * noise
    turn = design(residuals(ahead, parameters)[1], ahead, parameters)
    turn -= design(residuals(behind, parameters)[1], behind, parameters)
    return turn / (2 * step) + design(u, m, parameters) * across[:, None]


def without_noise_bias(m: np.ndarray, parameters: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Least-squares parameters (9,) less what noise shifts them by, to second order.

    With 1 % noise that is 0.01 %; with 10 %, which cheap sensors in a weak field have, 1 %.
    """
    r, u = residuals(m, parameters)
    jacobian = design(u, m, parameters) @ basis
    normal = jacobian.T @ jacobian
    if np.linalg.cond(normal) > 1e14:
        return parameters
    wanted = (noise_slopes(m, parameters) @ basis).sum(axis=0) - jacobian.T @ r
    return parameters + basis @ np.linalg.solve(normal, wanted)


def spread(r: np.ndarray) -> float:
    """Standard deviation of residuals about zero from their median size, as of normal ones."""
    return 1.4826 * float(np.median(np.abs(r)))


def bisquare(r: np.ndarray) -> np.ndarray:
    """Tukey's weights of residuals (N,): c = 4.685, in robust standard deviations."""
    scale = spread(r)
    if scale == 0:
        return np.ones_like(r)
    return np.clip(1 - (r / (4.685 * scale)) ** 2, 0, None) ** 2
