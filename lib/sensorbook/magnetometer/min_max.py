"""Work A's method, step by step (A 6.4–6.9), and the two corrections that it needs.

Everything is read off the outlines of the three axis-pair plots, as A does by eye.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PLANES = {"yz": (1, 2), "zx": (2, 0), "xy": (0, 1)}  # A's order: the plots across x, y and z


@dataclass(frozen=True, eq=False)
class MinMax:
    """What A's steps give.

    Attributes
    ----------
    hard_iron : (3,) in the readings' unit, half of maximum plus minimum (A 6.4)
    angles : (3,) rad, φ, θ, ψ: turns about x, y and z that lay each plot's ellipse along its axes
    major : (3,) major semi-axes r_yz, r_zx, r_xy of the turned plots
    semi_axes : (3,) half widths along the turned axes
    """

    hard_iron: np.ndarray
    angles: np.ndarray
    major: np.ndarray
    semi_axes: np.ndarray

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) A's 6.8 as the product it is printed for: Rx(φ) Ry(θ) Rz(ψ)."""
        return rotation(*self.angles)

    @property
    def printed_factors(self) -> np.ndarray:
        """(3,) α as A prints it (A 6.9): each plot's major semi-axis over the mean of the three."""
        return self.major / self.major.mean()

    @property
    def factors(self) -> np.ndarray:
        """(3,) the factors that make a sphere: mean of the semi-axes over each of them."""
        return self.semi_axes.mean() / self.semi_axes

    def soft_iron(self, factors: np.ndarray) -> np.ndarray:
        """(3, 3) symmetric: turned to the ellipse's axes, scaled, and turned back, which A leaves out."""
        return self.rotation.T @ np.diag(factors) @ self.rotation


def min_max(m: np.ndarray) -> MinMax:
    """A's steps on readings (N, 3) of a device turned through all attitudes."""
    hard_iron = (m.max(axis=0) + m.min(axis=0)) / 2
    free = m - hard_iron
    angles = np.array([_tilt(free[:, i], free[:, j]) for i, j in PLANES.values()])
    turned = free @ rotation(*angles).T
    major = np.array(
        [np.sqrt(_outline(turned[:, i], turned[:, j]).max()) for i, j in PLANES.values()]
    )
    return MinMax(hard_iron, angles, major, np.ptp(turned, axis=0) / 2)


def rotation(phi: float, theta: float, psi: float) -> np.ndarray:
    """Rx(φ) Ry(θ) Rz(ψ), passive (A 6.5–6.7); A's expansion of 6.8 is the transpose of its product."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def _outline(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3,) half widths squared of a plot along its first axis, its second, and the widest way."""
    p, q, r = _ellipse(a, b)
    return np.array([p + r, p - r, p + np.hypot(q, r)])


def _tilt(a: np.ndarray, b: np.ndarray) -> float:
    """Angle, rad within ±45°, by which a plot's ellipse is turned from its axes."""
    _, q, r = _ellipse(a, b)
    half = np.arctan2(q, r) / 2
    return float((half + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def _ellipse(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3,) p, q, r of an outline whose half width along the direction β is √(p + q sin 2β + r cos 2β).

    That holds for every ellipse; by least squares over half a turn.
    """
    beta = np.arange(0, np.pi, np.pi / 60)
    way = np.stack([np.cos(beta), np.sin(beta)])
    points = np.stack([a, b], axis=1)
    along = points @ way
    squares = (np.ptp(along, axis=0) / 2) ** 2
    columns = np.stack([np.ones_like(beta), np.sin(2 * beta), np.cos(2 * beta)], axis=1)
    return np.linalg.lstsq(columns, squares, rcond=None)[0]
