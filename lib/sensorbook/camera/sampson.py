"""The conic of least Sampson distance, kept an ellipse by a barrier.

Szpak, Chojnacki and van den Hengel 2012. Conics are (6,) a to f, of whitened points, as in `ellipse`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensorbook.errors import Refusal

# (4ac − b²) / (a + c)² of whitened points, below which the conic is a parabola or a pair of lines. A
# quarter of a degree of a circle has 1e-6.
LEAST_DISCRIMINANT = 1e-6
_BARRIER = 1e-3  # α of Szpak, Chojnacki and van den Hengel
_STEPS = 100
TINY = 1e-150  # whose square is still a number

REMEDY = "Give more of the outline, or take out what is none of it."


def ellipse_or_refusal(conic: np.ndarray) -> np.ndarray:
    """The conic (6,) as it is; raises `Refusal` where it is no ellipse."""
    discriminant = _discriminant(conic)
    if not (conic[0] + conic[2] > 0 and discriminant > LEAST_DISCRIMINANT and inside(conic) < 0):
        raise Refusal(
            "The conic that fits the points best is no ellipse: a parabola, a hyperbola or a pair of lines "
            f"(4ac − b² is {max(discriminant, 0):.1g} of (a + c)²).",
            REMEDY,
        )
    return conic


def _discriminant(conic: np.ndarray) -> float:
    """(4ac − b²) / (a + c)²: 1 for a circle, 0 for a parabola."""
    a, b, c, *_ = conic
    return (4 * a * c - b * b) / max((a + c) ** 2, TINY)


def inside(conic: np.ndarray) -> float:
    """The conic's value at its centre: below zero for a real ellipse with a, c > 0."""
    a, b, c, d, e, f = conic
    return f - (c * d * d - b * d * e + a * e * e) / (4 * a * c - b * b)


@dataclass(frozen=True, eq=False)
class Barrier:
    """α ‖a‖²/(4ac − b²), the residual that keeps the published fit from becoming a parabola.

    It is of the conic in evenly scaled coordinates, of length √2 on average as Hartley has them.
    """

    turn: np.ndarray  # (6, 6), conic of whitened points → of evenly scaled ones
    shrink: float  # of 4ac − b² by it
    size: float  # of a unit, in the points' own

    @classmethod
    def of(cls, frame: np.ndarray, z: np.ndarray) -> Barrier:
        size = float(np.mean(np.linalg.norm(z @ frame.T, axis=1))) / np.sqrt(2)
        (p, q), (r, s) = np.linalg.inv(frame) * size  # whitened = (p x + q y, r x + s y)
        turn = np.zeros((6, 6))
        turn[:3, :3] = [
            [p * p, p * r, r * r],
            [2 * p * q, p * s + q * r, 2 * r * s],
            [q * q, q * s, s * s],
        ]
        turn[3:5, 3:5] = [[p, r], [q, s]]
        turn[5, 5] = 1
        return cls(turn, (p * s - q * r) ** 2, size)

    def residual(self, conic: np.ndarray) -> tuple[float, np.ndarray]:
        """In the points' own unit, and its derivatives (6,) by the conic."""
        a, b, c, *_ = conic
        even = self.turn @ conic
        discriminant = self.shrink * (4 * a * c - b * b)
        factor = _BARRIER * self.size / discriminant
        by_discriminant = self.shrink * np.array([4 * c, -2 * b, 4 * a, 0, 0, 0]) / discriminant
        square = even @ even
        return factor * square, factor * (2 * even @ self.turn - square * by_discriminant)

    def bend(self, k: np.ndarray) -> np.ndarray:
        """(6, 6), the residual times its second derivatives by k of `factored`.

        Squared it grows as the inverse fourth power of l₂₂, whose curvature is 2½ times that of the slopes
        alone: without this the steps overshoot wherever the barrier holds.
        """
        conic, slopes = _conic(k), _conic_slopes(k)
        a, b, c, *_ = conic
        own, by_conic = self.residual(conic)
        even = self.turn @ conic
        square = even @ even
        relative = 2 * even @ self.turn / square  # slope of ln ‖a‖²
        steep = np.array([4 * c, -2 * b, 4 * a, 0, 0, 0]) / (4 * a * c - b * b)
        second = 2 * self.turn.T @ self.turn / square + 2 * np.outer(steep, steep)
        second -= np.outer(relative, steep) + np.outer(steep, relative)
        second[:3, :3] -= np.array([[0, 0, 4], [0, -2, 0], [4, 0, 0]]) / (4 * a * c - b * b)
        bend = own * slopes.T @ second @ slopes
        by_a, by_b, by_c = by_conic[:3]
        bend[:3, :3] += 2 * np.array([[by_a, by_b, 0], [by_b, by_c, 0], [0, 0, by_c]])
        return own * bend


@np.errstate(all="ignore")  # of a step too far: a sum that is not finite is no improvement
def refined(z: np.ndarray, scale: np.ndarray, conic: np.ndarray, barrier: Barrier) -> np.ndarray:
    """(6,) conic of least Sampson distance and barrier of whitened points (N, 2), from `conic` on.

    `scale` (2,) are the squared lengths of a whitened unit along each axis.
    """

    def residuals(conic):
        r, slopes = _sampson(z, scale, conic)
        own, slope = barrier.residual(conic)
        return np.append(r, own), np.vstack([slopes, slope])

    k = factored(conic)
    r, slopes = residuals(_conic(k))
    damping, before = 1e-6, r @ r
    for _ in range(_STEPS):
        jacobian = slopes @ _conic_slopes(k)
        # Nothing changes along k's own scale, which is held.
        fixed = k * [1, 1, 1, 2, 2, 2]
        normal = jacobian.T @ jacobian + barrier.bend(k)
        normal += np.outer(fixed, fixed) * (np.trace(normal) / (fixed @ fixed))
        # The floor is for l₂₂ = 0, a parabola, where its column is empty.
        weights = np.diag(np.diag(normal) + 1e-9 * np.trace(normal))
        gradient = jacobian.T @ r
        while damping < 1e12:
            step = -np.linalg.solve(normal + damping * weights, gradient)
            new = _conic(k + step)
            new_r, new_slopes = residuals(new)
            after = new_r @ new_r
            if after <= before and inside(new) < 0:
                break
            damping = max(10 * damping, 1e-12)
        else:
            break
        moved = np.abs(step).max() / np.abs(k).max()
        damping, gain, before = damping / 10, before - after, after
        k, r, slopes = factored(new), new_r, new_slopes * np.linalg.norm(new)
        if moved < 1e-11 or gain == 0:
            break
    return ellipse_or_refusal(_conic(k))


def pull(z: np.ndarray, scale: np.ndarray, conic: np.ndarray, barrier: Barrier) -> float:
    """How far the barrier moves the conic (6,) to first order, in its standard errors by the points."""
    r, slopes = _sampson(z, scale, conic)
    own, slope = barrier.residual(conic)
    # The sixth is the conic's own scale.
    values, turn = np.linalg.svd(slopes, full_matrices=False)[1:]
    moved = own * (turn[:5] @ slope) / np.maximum(values[:5], TINY)
    error = np.sqrt(r @ r / max(len(z) - 5, 1))
    return float(np.linalg.norm(moved) / max(error, TINY))


def factored(conic: np.ndarray) -> np.ndarray:
    """(l₁₁, l₂₁, l₂₂, d, e, f) with L Lᵀ the quadratic part of the conic, at length 1."""
    a, b, c, *rest = conic / np.linalg.norm(conic)
    first = np.sqrt(a)
    second = b / 2 / first
    return np.array([first, second, np.sqrt(max(c - second**2, 0)), *rest])


def _conic(k: np.ndarray) -> np.ndarray:
    p, q, t, *rest = k
    return np.array([p * p, 2 * p * q, q * q + t * t, *rest])


def _conic_slopes(k: np.ndarray) -> np.ndarray:
    """(6, 6) derivatives of `_conic`."""
    p, q, t = k[:3]
    slopes = np.eye(6)
    slopes[:3, :3] = [[2 * p, 0, 0], [2 * q, 2 * p, 0], [0, 2 * q, 2 * t]]
    return slopes


def _sampson(z: np.ndarray, scale: np.ndarray, conic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed Sampson distances (N,) in the unit of the points, and their derivatives (N, 6) by the conic."""
    x, y = z.T
    a, b, c, d, e = conic[:5]
    u = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1)
    value = u @ conic
    gx, gy = (2 * a * x + b * y + d) / scale[0], (b * x + 2 * c * y + e) / scale[1]
    length = np.sqrt(scale[0] * gx**2 + scale[1] * gy**2)  # of the gradient by the points' own unit
    r = value / length
    zero = np.zeros_like(x)
    slope = np.stack([2 * x * gx, y * gx + x * gy, 2 * y * gy, gx, gy, zero], axis=1)
    return r, (u - slope * (value / length**2)[:, None]) / length[:, None]
