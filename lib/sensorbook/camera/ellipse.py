"""Ellipses through points: the direct fit and the guaranteed fit with the Sampson distance (C 4.1–4.3).

A conic is a x² + b xy + c y² + d x + e y + f = 0, and an ellipse where 4ac − b² > 0. Both fits work on
whitened points (mean 0, mean squares 1 along the principal axes), which keeps short arcs and places far
from the origin well conditioned; distances are those of the points as given. The guaranteed fit's barrier
draws a short arc's ellipse towards a smaller, rounder one: by 68 px here if 70° of it are all there is.

>>> import numpy as np
>>> turn = np.radians(np.arange(0, 220, 5.0))  # three fifths of an ellipse
>>> arc = np.stack([640 + 300 * np.cos(turn), 360 + 200 * np.sin(turn)], axis=1)
>>> guaranteed_ellipse(arc)
Ellipse(centre=(640.000, 360.000), semi_axes=(300.000, 200.000), angle=0.0000)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.camera.sampson import (
    REMEDY,
    TINY,
    Barrier,
    ellipse_or_refusal,
    factored,
    inside,
    pull,
    refined,
)
from sensorbook.errors import Refusal

# Points whose spread across is below this part of their spread along lie on a line.
FLAT = 1e-9
# An ellipse whose smaller semi-axis is below so many times the points' distance from it is refused.
THIN = 3
# Standard errors that the barrier may pull by, and parts of the smaller semi-axis that an error may be.
# Within both, errors squared over their covariance average 5.3 on arcs of 30° to 360°, where 5 is right,
# and one in 500 is above 25; beyond, half of them are.
_MOST_PULL, _MOST_ERROR = 0.5, 0.02
_LARGEST = 1e60


@dataclass(frozen=True, eq=False, repr=False)
class Ellipse:
    """An ellipse in the plane of its points, in their unit (px).

    Parameters
    ----------
    centre : (2,), x and y
    semi_axes : (2,), the larger first
    angle : of the larger axis from x towards y, rad, in (−π/2, π/2]; 0 for a circle
    coefficients : (6,), a to f of a x² + b xy + c y² + d x + e y + f, which is −1 at the centre
    covariance : (5, 5) of centre, semi-axes and angle, to first order, from the points' own scatter, if
        each errs independently; the angle's variance of a circle is infinite. None of a direct fit, and of
        an arc too short for it: where the barrier pulls by half a standard error or more, or the standard
        error is 2 % of the smaller semi-axis or more, the fit is far more wrong than it tells
    """

    centre: np.ndarray
    semi_axes: np.ndarray
    angle: float
    coefficients: np.ndarray
    covariance: np.ndarray | None = None

    def __repr__(self) -> str:
        (x, y), (major, minor) = self.centre, self.semi_axes
        return (
            f"Ellipse(centre=({x:.3f}, {y:.3f}), semi_axes=({major:.3f}, {minor:.3f}), "
            f"angle={self.angle:.4f})"
        )

    def points(self, n: int) -> np.ndarray:
        """(n, 2) points of the ellipse, at even steps of the eccentric angle from the larger axis on."""
        turn = 2 * np.pi * np.arange(n) / n
        along = self.semi_axes * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return self.centre + along @ self._axes

    def distance(self, points: ArrayLike) -> np.ndarray:
        """Distance (…,) of points (…, 2) to the nearest point of the ellipse, exact to rounding.

        The foot of a point p in the axes of the ellipse is (A² p₁/(t + A²), B² p₂/(t + B²)), where t is the
        largest root of (A p₁/(t + A²))² + (B p₂/(t + B²))² = 1 (Eberly, "Distance from a point to an
        ellipse", 2013): the multiplier of a trust region, found by Newton's method on 1/√ of the left side,
        which rises to the root from below it (Moré and Sorensen 1983).
        """
        p = np.asarray(points, dtype=float)
        if p.ndim == 0 or p.shape[-1] != 2:
            raise ValueError(f"points must have shape (…, 2), not {p.shape}")
        local = np.abs((p - self.centre) @ self._axes.T)
        major, minor = self.semi_axes
        excess = (major - minor) * (major + minor) / minor**2
        # In units of B, τ = t/B² + 1. The floors give the centre and the axes their feet as limits.
        along = np.maximum(local[..., 0] * major / minor**2, TINY)
        across = np.maximum(local[..., 1] / minor, TINY)
        tau = np.maximum(across, along - excess)
        for _ in range(30):
            u, v = along / (tau + excess), across / tau
            square = u**2 + v**2
            step = square * (np.sqrt(square) - 1) / (u**2 / (tau + excess) + v**2 / tau)
            tau = tau + step
            if not (np.abs(step) > 4e-16 * tau).any():
                break
        u, v = along / (tau + excess), across / tau
        return np.abs(tau - 1) * minor * np.hypot(u * minor / major, v)

    @property
    def _axes(self) -> np.ndarray:
        """(2, 2), one row an axis."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([[c, s], [-s, c]])


def direct_ellipse(points: ArrayLike) -> Ellipse:
    """The direct least-squares ellipse (Fitzgibbon, Pilu and Fisher 1999): min Σ (aᵀu)², 4ac − b² = 1.

    In the partitioned form of Halíř and Flusser (1998), with orthogonal factors in place of the scatter
    matrices, so that a short arc keeps its digits and exact points give the exact ellipse. It does not
    depend on the points' unit or place, but shrinks the ellipse of noisy arcs: 20° of a circle of 300 px
    with 0.5 px noise come out as a sliver.

    Parameters
    ----------
    points : (N, 2), N ≥ 6, in any order

    Raises
    ------
    Refusal : fewer than 6 distinct points, points on a line, or a conic that is no ellipse
    ValueError : another shape, complex numbers or such that are not finite, or a unit in which they are
        beyond 1e±60
    """
    z, frame, mean = _whitened(_checked(points))
    return _placed(_direct(z), frame, mean)


def guaranteed_ellipse(points: ArrayLike) -> Ellipse:
    """The ellipse of least Sampson distance (Szpak, Chojnacki and van den Hengel 2012; C 4.1.4).

    Minimises Σ (aᵀu_i)² / (aᵀB_i a), the squared distances to first order, and the square of a barrier,
    α ‖a‖²/(4ac − b²) with α = 1e-3, in evenly scaled coordinates, by Levenberg–Marquardt from the direct
    fit, or from a circle where that lies nearer the points. The quadratic part is L Lᵀ with L lower
    triangular, so that no step leaves the ellipses.

    Of a hyperbola's points it makes an ellipse as well, as the published method does: the barrier gives
    it. It also pulls on a short arc, by nothing at 180° and by many pixels at 40°.

    Parameters and errors are those of `direct_ellipse`. Refused as well: points with no ellipse to start
    from, an exact parabola's, and an ellipse thinner than the points scatter.
    """
    points = _checked(points)
    z, frame, mean = _whitened(points)
    scale = (frame**2).sum(axis=0)
    starts = [_direct(z), _circle(z, scale)]
    off = [np.square(_placed(start, frame, mean).distance(points)).sum() for start in starts]
    barrier = Barrier.of(frame, z)
    conic = refined(z, scale, starts[int(np.argmin(off))], barrier)
    pulled = pull(z, scale, conic, barrier)
    ellipse = _placed(conic, frame, mean)
    scatter = np.sqrt(np.mean(ellipse.distance(points) ** 2))
    if ellipse.semi_axes[1] < THIN * scatter:
        # Of a line, the Sampson distance counts half: a sliver among the points pays.
        raise Refusal(
            f"The points tell no ellipse: the best is {ellipse.semi_axes[1]:.2g} thin, and they lie "
            f"{scatter:.2g} off it.",
            REMEDY,
        )
    covariance = _covariance(ellipse, points)
    error = np.sqrt(np.linalg.eigvalsh(covariance[:4, :4])[-1])
    if error >= _MOST_ERROR * ellipse.semi_axes[1] or pulled >= _MOST_PULL:
        covariance = None
    return replace(ellipse, covariance=covariance)


def _checked(points: ArrayLike) -> np.ndarray:
    """(N, 2) points, at least six of them distinct."""
    if np.iscomplexobj(points):
        raise ValueError("points are complex: give x and y in two columns")
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must have shape (N, 2), not {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("points must be finite")
    # Counted by taking each away in turn: sorting a thousand points takes longer than the fit.
    rest, distinct = points.view(complex)[:, 0], 0
    while len(rest) and distinct < 6:
        rest, distinct = rest[rest != rest[0]], distinct + 1
    if distinct < 6:
        raise Refusal(f"An ellipse needs 6 distinct points, and these are {distinct}.", REMEDY)
    # Coefficients go as the inverse square of the unit, and products of them have to be numbers.
    size, extent = np.abs(points).max(), np.ptp(points, axis=0).max()
    if not (extent > 1 / _LARGEST and size < _LARGEST):
        raise ValueError(
            f"points spread by {extent:.1g} and lie up to {size:.1g} away: give them in another unit, "
            f"between {1 / _LARGEST:.0e} and {_LARGEST:.0e}"
        )
    return points


def _whitened(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (N, 2), frame (2, 2) and mean (2,) with points = mean + frame z; frame's columns are orthogonal."""
    mean = points.mean(axis=0)
    x = points - mean
    size = np.abs(x).max()
    axes = np.linalg.eigh((x / size).T @ (x / size))[1][:, ::-1]
    y = x @ axes
    spread = size * np.sqrt(np.mean((y / size) ** 2, axis=0))
    rounding = 4 * np.finfo(float).eps * np.abs(points).max()
    if spread[1] <= max(FLAT * spread[0], rounding):
        raise Refusal(
            f"The {len(points)} points lie on a straight line: they spread by {spread[0]:.3g} along and "
            f"by {spread[1]:.1g} across.",
            REMEDY,
        )
    return y / spread, axes * spread, mean


def _direct(z: np.ndarray) -> np.ndarray:
    """(6,) conic of whitened points (N, 2) by the direct fit."""
    x, y = z.T
    r = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1), mode="r")
    # ‖D a‖² is least over d, e, f where ‖r₂₂ a₁‖² is left, a₁ = (a, b, c).
    values, turn = np.linalg.svd(r[3:, 3:])[1:]
    # b = Vᵀa₁ in units of values[2] / values: minimise ‖w‖² under wᵀ(T C T)w > 0. Of its eigenvalues
    # one is positive, and it is the largest by far where the points are near an ellipse.
    values = np.maximum(values, np.finfo(float).eps * values[0])
    t = values[2] / values
    vt = turn * t[:, None]
    constraint = vt @ np.array([[0, 0, 2.0], [0, -1, 0], [2, 0, 0]]) @ vt.T
    a = np.linalg.eigh(constraint)[1][:, 2] @ vt
    a /= np.linalg.norm(a) * np.copysign(1, a[0] + a[2])
    f, d, e = -np.linalg.solve(r[:3, :3], r[:3, 3:] @ a)
    return ellipse_or_refusal(np.array([*a, d, e, f]))


def _circle(z: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(6,) conic of whitened points (N, 2): the least-squares circle of the points (Kåsa 1976)."""
    d, e, f = -np.linalg.lstsq(np.c_[z, np.ones(len(z))], z**2 @ scale, rcond=None)[0]
    return np.array([scale[0], 0, scale[1], d, e, f])


def _placed(conic: np.ndarray, frame: np.ndarray, mean: np.ndarray) -> Ellipse:
    """The ellipse of a conic (6,) of whitened points, in the points' own plane."""
    p, q, t = factored(conic)[:3]
    low = inside(conic / np.linalg.norm(conic))
    a, b, c, d, e, _ = conic
    middle = np.array([b * e - 2 * c * d, b * d - 2 * a * e]) / (4 * a * c - b * b)
    # The ellipse is mean + frame (middle + L⁻ᵀ √−low (cos, sin)).
    root = frame @ np.array([[1 / p, -q / (p * t)], [0, 1 / t]]) * np.sqrt(-low)
    axes, semi_axes, _ = np.linalg.svd(root)
    round_ = semi_axes[0] - semi_axes[1] <= 4 * np.finfo(float).eps * semi_axes[0]
    axis = np.array([1.0, 0.0]) if round_ else axes[:, 0] * (1 if axes[0, 0] > 0 else -1)
    angle = np.pi / 2 if axis[0] == 0 else float(np.arctan2(axis[1], axis[0]))
    centre = mean + frame @ middle
    return Ellipse(centre, semi_axes, angle, _coefficients(centre, semi_axes, angle))


def _coefficients(centre: np.ndarray, semi_axes: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    m, n = 1 / semi_axes**2
    q = np.array([[m * c * c + n * s * s, (m - n) * c * s], [0, m * s * s + n * c * c]])
    q[1, 0] = q[0, 1]
    return np.array([q[0, 0], 2 * q[0, 1], q[1, 1], *(-2 * q @ centre), centre @ q @ centre - 1])


def _covariance(ellipse: Ellipse, points: np.ndarray) -> np.ndarray:
    """(5, 5) covariance of centre, semi-axes and angle of points (N, 2)."""
    major, minor = ellipse.semi_axes
    x, y = ((points - ellipse.centre) @ ellipse._axes.T / ellipse.semi_axes).T
    length = np.maximum(np.hypot(x / major, y / minor), TINY)
    normal = np.stack([x / major, y / minor], axis=1) / length[:, None]
    # How far the curve moves outwards at each point, by parameter; angles in units of the major axis.
    turned = (normal[:, 1] * x * major - normal[:, 0] * y * minor) / major
    jacobian = np.stack(
        [*(normal @ ellipse._axes).T, normal[:, 0] * x, normal[:, 1] * y, turned], axis=1
    )
    value = (x**2 + y**2 - 1) / (2 * length)
    if np.abs(turned).max() < 1e-12:
        jacobian = jacobian[:, :4]
    variance = value @ value / max(len(points) - 5, 1)
    size = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv(jacobian / size, rcond=1e-15) / size[:, None]
    k = len(inverse)
    covariance = np.diag([0, 0, 0, 0, np.inf])
    covariance[:k, :k] = variance * inverse @ inverse.T
    covariance[4] /= major
    covariance[:, 4] /= major
    return covariance
