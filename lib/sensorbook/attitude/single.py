"""Single quaternions as tuples x, y, z, w: a tenth of the time that arrays of four take.

For loops in which one step hangs on the one before. A quaternion is reference → body, as everywhere; the
product is Hamilton's, as scipy's Rotation multiplies, so that a turn φ in body axes is q exp(φ).
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np


def turn_by(q: tuple, x: float, y: float, z: float) -> tuple:
    """q turned by a small rotation vector in body axes, q exp(φ)."""
    return product(q, exponential(x, y, z))


def corrected(q: tuple, x: float, y: float, z: float) -> tuple:
    """exp(−ψ) q: an error ψ in reference axes taken out, and the length made 1."""
    a, b, c, w = product(exponential(-x, -y, -z), q)
    size = sqrt(a * a + b * b + c * c + w * w)
    return a / size, b / size, c / size, w / size


def exponential(x: float, y: float, z: float) -> tuple:
    """The quaternion of a rotation vector."""
    size = sqrt(x * x + y * y + z * z)
    if size < 1e-8:
        return x / 2, y / 2, z / 2, 1.0
    factor = sin(size / 2) / size
    return x * factor, y * factor, z * factor, cos(size / 2)


def product(p: tuple, q: tuple) -> tuple:
    """Hamilton's product, scalar last: as scipy's Rotation multiplies."""
    a, b, c, d = p
    x, y, z, w = q
    return (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )


def difference(q: tuple, other: list) -> np.ndarray:
    """(3,) rotation vector in reference axes that turns `other` into q."""
    x, y, z, w = other
    return np.array(logarithm(*product(q, (-x, -y, -z, w))))


def logarithm(x: float, y: float, z: float, w: float) -> tuple:
    """The rotation vector of a quaternion, up to π long."""
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    size = sqrt(x * x + y * y + z * z)
    factor = 2.0 if size < 1e-9 else 2 * atan2(size, w) / size
    return x * factor, y * factor, z * factor


def matrix_of_turn(q: tuple) -> np.ndarray:
    """(3, 3), body → reference."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
