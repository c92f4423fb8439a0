"""The Earth's limb in an image: the cone that its edge points lie on.

The lines of sight to a sphere's limb make the same angle ρ with the direction n to its centre:
u · n = cos ρ. That is linear in h = n/cos ρ (Christian and Robinson 2016), exact off the axis, where
the centre of the imaged ellipse is not the image of the centre, and works on any part of the limb.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from sensorbook.camera.edges import MOST_POINTS, Edges, find_edges
from sensorbook.camera.model import Camera

_TRIALS = 300
_INLIER = 1.5  # pixels
_ALIGNED = 0.8  # cosine between an edge's gradient and the way to the centre
_TUKEY = 4.685  # of the scale: 95 % efficient on normal errors
_LEAST_SCALE = 0.5  # of the stated standard errors: few points may agree by chance
_COPIES = (
    4.0  # neighbours that share their error at least: the smoothing's, and the pixels' own grid
)
# What of the ground's pattern the cone itself takes up leaves no residual: measured on made-up clouds, the
# errors are twice what residuals tell. Without clouds that is too much.
_UNSEEN = 2.0
_COMMON = 0.02  # pixels that all edges may be off alike, out or in
_UNLIKE = 0.05  # correlation of residuals along the limb that is none
LEAST_POINTS = 12
_OTHER = 0.15  # of the expected radius: a body that is off by more may be another
_LEAST_SHARE = 0.25  # of the edges that look out on dark space: scattered ones make no limb
_SMALLER = (
    2,
    3,
    4,
    6,
    8,
    12,
    16,
)  # of how many pixels one is made, where the image shows no limb as it is


@dataclass(frozen=True, eq=False)
class Limb:
    """The fitted limb.

    Attributes
    ----------
    direction : (3,), unit vector to the Earth's centre in camera axes; None where there is none
    angular_radius : rad
    covariance : (3, 3) of (two angles of the direction along the axes of `basis`, angular radius), rad²
    basis : (2, 3), unit vectors across the direction
    pixels : (N, 2), edge points; `used` (N,) those the fit kept; `residuals` (N,), pixels
    sigma : (N,), pixels, how well each is known
    rays, across : (N, 3), lines of sight through them, and how these turn over a pixel inward
    status : "ok", or why there is none
    scale : pixels of the image to one of the smaller image that the limb was found in
    lens : pixels, point spread that the edges were fitted with
    """

    direction: np.ndarray | None
    angular_radius: float | None
    covariance: np.ndarray | None
    basis: np.ndarray | None
    pixels: np.ndarray
    used: np.ndarray
    residuals: np.ndarray
    status: str
    sigma: np.ndarray | None = None
    rays: np.ndarray | None = None
    across: np.ndarray | None = None
    scale: int = 1
    lens: float = 0.0

    @property
    def std(self) -> float | None:
        """Standard error of the direction, rad, rms of its two axes."""
        if self.covariance is None:
            return None
        return float(np.sqrt(np.trace(self.covariance[:2, :2]) / 2))


def find_limb(
    image: np.ndarray,
    camera: Camera,
    sun: np.ndarray | None = None,
    radius: tuple[float, float] | None = None,
) -> Limb:
    """The limb in a grey image (height, width), uint8; arguments as those of `fit_limb`.

    Air is many pixels deep in a telephoto picture: where no edge is as sharp as a pixel, the limb is
    that of a smaller image. Pixels, sigma and residuals are of the image given.
    """
    if sun is not None and not abs(np.linalg.norm(sun) - 1) < 1e-6:
        raise ValueError(f"sun is {sun}: give a unit vector in camera axes, or None")
    if radius is not None and not (
        np.shape(radius) == (2,) and 0 < radius[0] < np.pi / 2 and radius[1] > 0
    ):
        raise ValueError(f"radius is {radius}: give the angular radius and its standard error, rad")
    pixel = None if sun is None else camera.project(sun)
    limb = fit_limb(find_edges(image, camera, pixel), camera, sun, radius)
    found = []
    for scale in _SMALLER if limb.status != "ok" else ():
        width, height = camera.width // scale, camera.height // scale
        if min(width, height) < 64:
            break
        small = replace(
            camera,
            width=width,
            height=height,
            focal_px=camera.focal_px / scale,
            principal_point=tuple((camera.centre + 0.5) / scale - 0.5),
        )
        whole = image[: height * scale, : width * scale]
        less = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        place = None if pixel is None else (pixel + 0.5) / scale - 0.5
        tried = fit_limb(find_edges(less, small, place, soft=True), small, sun, radius)
        if tried.status == "ok":
            found.append(_enlarged(tried, scale))
    # The sharpest of those that know it about as well as the best.
    best = min((one.std for one in found), default=0.0)
    return next((one for one in found if one.std <= 3 * best), limb)


def _enlarged(limb: Limb, scale: int) -> Limb:
    """A limb of an image made smaller, in pixels of the image as it was."""
    return replace(
        limb,
        pixels=(limb.pixels + 0.5) * scale - 0.5,
        residuals=limb.residuals * scale,
        sigma=limb.sigma * scale,
        across=limb.across / scale,
        scale=scale,
    )


def fit_limb(
    edges: Edges,
    camera: Camera,
    sun: np.ndarray | None = None,
    radius: tuple[float, float] | None = None,
    seed: int = 0,
) -> Limb:
    """Fits the cone of the limb to edge points, whatever else is among them.

    Parameters
    ----------
    sun : (3,), direction of the Sun in camera axes: ground that is bright faces it
    radius : expected angular radius and its standard error, rad; free where left out
    seed : of the random trials
    """
    edges = edges.some(MOST_POINTS)
    rays = camera.rays(edges.pixels)
    step = 1e-3
    across = camera.rays(edges.pixels + step * edges.inward) - rays
    across /= step  # how the line of sight turns over a pixel, inward
    known = np.isfinite(across).all(axis=-1)  # not where a distortion turns back
    edges = Edges(edges.pixels[known], edges.inward[known], edges.sigma[known], edges.lens)
    rays, across = rays[known], across[known]
    count = len(edges.pixels)
    nothing = np.zeros(count, dtype=bool), np.full(count, np.nan)
    if count < LEAST_POINTS:
        return Limb(None, None, None, None, edges.pixels, *nothing, "Earth not in view")
    best = _consensus(rays, across, sun, radius, np.random.default_rng(seed))
    if best is None:
        return Limb(None, None, None, None, edges.pixels, *nothing, "no limb among the edges")
    normal, near = best, 3 * _INLIER
    for _ in range(4):
        used = np.abs(_off(normal, rays, across)) < near
        used &= _facing(normal, rays, across, sun)
        if used.sum() < max(LEAST_POINTS, _LEAST_SHARE * count):
            return Limb(None, None, None, None, edges.pixels, *nothing, "no limb among the edges")
        normal, covariance, basis = refined_cone(
            normal, rays[used], across[used], edges.sigma[used], radius
        )
        # Tops of clouds lie a few pixels inside the limb of air.
        spread = 1.4826 * np.median(np.abs(_off(normal, rays[used], across[used])))
        near = np.clip(_TUKEY * spread, _INLIER, 3 * _INLIER)
    size = np.linalg.norm(normal)
    residuals = _off(normal, rays, across)
    if not size > 1 or (
        radius is not None
        and _of_another(normal, rays[used], across[used], edges.sigma[used], radius)
    ):
        return Limb(None, None, None, None, edges.pixels, *nothing, "no limb among the edges")
    return Limb(
        normal / size,
        float(np.arccos(1 / size)),
        covariance,
        basis,
        edges.pixels,
        used,
        residuals,
        "ok",
        edges.sigma,
        rays,
        across,
        lens=edges.lens,
    )


def _of_another(h, rays, across, sigma, radius) -> bool:
    """Whether edge points, left free, tell of a body of a size that is not the Earth's.

    An arc of a small disc, the Moon's, lies on a larger circle for some way.
    """
    free, covariance, _ = refined_cone(h, rays, across, sigma)
    size = np.linalg.norm(free)
    found = np.arccos(min(1 / size, 1.0))
    off = abs(found - radius[0])
    return off > _OTHER * radius[0] and off > 6 * np.hypot(np.sqrt(covariance[2, 2]), radius[1])


def cone(rays: np.ndarray) -> tuple[np.ndarray, float]:
    """Direction (3,) and angular radius (rad) of the cone of unit vectors (N, 3), by linear least squares.

    >>> turn = np.linspace(0, 2, 50)[:, None]
    >>> rays = np.cos(0.5) * np.array([0, 0, 1.0]) + np.sin(0.5) * np.hstack(
    ...     [np.cos(turn), np.sin(turn), 0 * turn])
    >>> direction, radius = cone(rays)
    >>> direction.round(12) + 0.0, round(radius, 12)
    (array([0., 0., 1.]), 0.5)
    """
    # Not by the normal equations: a short arc is so flat that they lose half of the digits.
    h = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    size = np.linalg.norm(h)
    return h / size, float(np.arccos(min(1 / size, 1.0)))


def _off(h, rays: np.ndarray, across):
    """Distances from the limb, pixels, positive inside: u·h = 1 over how it changes by a pixel."""
    slope = across @ h
    least = 0.2 * np.linalg.norm(h, axis=0) * np.median(np.linalg.norm(across, axis=-1))
    return (rays @ h - 1) / np.where(np.abs(slope) < least, least, slope)


def _facing(h, rays, across, sun) -> np.ndarray:
    """Whether edges are brighter towards the centre, and the ground there can be lit."""
    size = np.linalg.norm(h, axis=0)
    length = np.linalg.norm(across, axis=-1)
    sine = np.sqrt(np.maximum(1 - 1 / size**2, 1e-12))  # of ρ: the way inward is not straight at n
    good = _ALIGNED * sine * size < ((across @ h).T / length).T
    if sun is not None:
        # The ground's normal at the limb is (u cos ρ − n)/sin ρ.
        lit = np.subtract.outer(rays @ sun, sun @ h)
        good &= lit > -0.02 * sine * size
    return good


def _consensus(rays, across, sun, radius, rng):
    """h of the three points that most others agree with."""
    count = len(rays)
    picked = rng.integers(0, count, (_TRIALS, 3))
    matrices = rays[picked]
    good = np.abs(np.linalg.det(matrices)) > 1e-9
    tried = np.linalg.solve(matrices[good], np.ones((good.sum(), 3, 1)))[..., 0]
    sizes = np.linalg.norm(tried, axis=-1)
    sane = sizes > 1.00001
    if radius is not None:
        expected, std = radius
        found = np.arccos(1 / np.maximum(sizes, 1))
        sane &= np.abs(found - expected) < 5 * std + 0.05
    thin = slice(None, None, max(1, count // 500))
    tried = tried[sane]
    if not len(tried):
        return None
    agree = np.abs(_off(tried.T, rays[thin], across[thin])) < _INLIER
    agree &= _facing(tried.T, rays[thin], across[thin], sun)
    votes = agree.sum(axis=0)
    best = int(np.argmax(votes))
    return tried[best] if votes[best] * max(1, count // 500) > LEAST_POINTS / 2 else None


def refined_cone(h, rays, across, sigma, radius=None):
    """Robust least squares (Tukey) of the limb's distances in pixels, from a first h (3,).

    `rays` (N, 3) are lines of sight, `across` (N, 3) how they turn over a pixel inward and `sigma` (N,),
    pixels, how well each is known; `radius` is the expected angular radius and its standard error, rad.
    Returns h, the covariance (3, 3), rad², of the direction along `basis` and of the angular radius, and
    `basis` (2, 3).
    """
    order = around(rays, h)
    for _ in range(8):
        off, jacobian = _off(h, rays, across) / sigma, rays / ((across @ h) * sigma)[:, None]
        weight = weighted(off, order)
        normal = jacobian.T @ (weight[:, None] * jacobian)
        right = -jacobian.T @ (weight * off)
        if radius is not None:
            size = np.linalg.norm(h)
            slope = h / (size**2 * np.sqrt(max(size**2 - 1, 1e-12)))  # of ρ = arccos(1/‖h‖)
            normal += np.outer(slope, slope) / radius[1] ** 2
            right -= slope * (np.arccos(1 / size) - radius[0]) / radius[1] ** 2
        move = np.linalg.lstsq(normal, right, rcond=1e-14)[0]
        h = h + move
        if np.abs(move).max() < 1e-10:
            break
    variance = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
    size = np.linalg.norm(h)
    direction = h / size
    basis = across_of(direction)
    turn = np.vstack([basis / size, direction / (size * np.sqrt(max(size**2 - 1, 1e-12)))])
    covariance = turn @ variance @ turn.T
    covariance[2, 2] += (_COMMON * np.median(np.linalg.norm(across, axis=-1))) ** 2
    return h, _UNSEEN**2 * covariance, basis


def weighted(off: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Weights (N,) of residuals (N,) in standard errors: Tukey's, over the variance that they really have.

    Neighbours along the limb (`order` sorts by the angle around it) err alike: by the smoothing over a
    pixel or two, by the pattern of the ground over tens. N of them tell as much as N over their
    integrated correlation.
    """
    scale = max(1.4826 * float(np.median(np.abs(off))), _LEAST_SCALE)
    robust = np.clip(1 - (off / (_TUKEY * scale)) ** 2, 0, None) ** 2
    z = (off * np.sqrt(robust))[order]
    size = len(z)
    power = np.abs(np.fft.rfft(z, 2 * size)) ** 2
    shared = np.fft.irfft(power)[: max(size // 4, 1)] / np.arange(
        size, size - max(size // 4, 1), -1
    )
    alike = shared[1:] / max(shared[0], 1e-12)
    ends = np.flatnonzero(alike < _UNLIKE)
    copies = max(1 + 2 * alike[: ends[0] if len(ends) else None].sum(), _COPIES)
    variance = max(float(np.sum(robust * off**2) / np.sum(robust)), _LEAST_SCALE**2)
    return robust / (variance * copies)


def around(rays: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The order of lines of sight (N, 3) by their angle around a direction (3,)."""
    first, second = across_of(direction)
    return np.argsort(np.arctan2(rays @ second, rays @ first), kind="stable")


def across_of(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3) across a direction (3,)."""
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])
