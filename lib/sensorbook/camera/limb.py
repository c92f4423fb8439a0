"""The Earth's limb in an image: edge points to a fraction of a pixel, and the cone they lie on.

The lines of sight to a sphere's limb make the same angle ρ with the direction n to its centre:
u · n = cos ρ. That is linear in h = n/cos ρ (Christian and Robinson 2016), exact off the axis, where
the centre of the imaged ellipse is not the image of the centre, and works on any part of the limb.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.integrate import trapezoid
from scipy.special import ndtr

from sensorbook.camera.model import Camera, grey

_BLUR = 1.2  # pixels, standard deviation of the smoothing before the gradient
_EDGE, _WEAK = 7.0, 4.0  # of the gradient's own noise: an edge starts, and goes on
# Beyond an edge it must grow dark: by how many pixels, and to which part of the step's height. Haze of
# 20 km reaches eight pixels at the rim of a wide camera in low orbit.
_OUTSIDE = ((8.0, 0.4), (14.0, 0.12))
_TRIALS = 300
_INLIER = 1.5  # pixels
_ALIGNED = 0.8  # cosine between an edge's gradient and the way to the centre
_TUKEY = 4.685  # of the scale: 95 % efficient on normal errors
COPIES = 4.0  # pixels along the limb that share their noise, by the smoothing
LEAST_POINTS = 12
_LEAST_SHARE = 0.25  # of the edges that look out on dark space: scattered ones make no limb
_SMALLER = (2, 4, 8, 16)  # of how many pixels one is made, where the image shows no limb as it is
_PROFILE, _INSIDE = 6, 4  # pixels outside and inside of an edge that its profile has
_PROFILE_BLUR = 0.8  # pixels, smoothing before it

# √depth spread by a unit normal width, and its slope.
_TABLE = np.linspace(-8, 16, 961)
_FINE = np.linspace(0, np.sqrt(24), 4001)
_ROOT = np.array(
    [trapezoid(2 * _FINE**2 * np.exp(-0.5 * (t - _FINE**2) ** 2), _FINE) for t in _TABLE]
) / np.sqrt(2 * np.pi)
_ROOT_SLOPE = np.gradient(_ROOT, _TABLE)
_LEAST_SIGMA = 0.03  # pixels: of an edge between square pixels
_SPREAD = 1.4  # pixels: how wide a step is after smoothing and gradient
_MOST_POINTS = 1500  # of the fit; more share their noise
_MOST_SAMPLES = 30_000  # OpenCV's remap takes 32 767 rows

# What is left of unit white noise after the smoothing, and of that after Sobel's gradient over 8.
_SMOOTHED = 1 / (2 * np.sqrt(np.pi) * _BLUR)
_GRADIENT = 1 / np.sqrt(8 * np.pi * (_BLUR**2 + 0.4) ** 2)


@dataclass(frozen=True, eq=False)
class Edges:
    """Edge points that look out on dark space.

    Attributes
    ----------
    pixels : (N, 2)
    inward : (N, 2), unit vectors in the image from dark to bright
    sigma : (N,), pixels, standard error of the place along `inward`, from noise over the edge's steepness
    """

    pixels: np.ndarray
    inward: np.ndarray
    sigma: np.ndarray

    def some(self, most: int) -> Edges:
        """At most so many of them, evenly."""
        if len(self.pixels) <= most:
            return self
        chosen = np.linspace(0, len(self.pixels) - 1, most).astype(int)
        return Edges(self.pixels[chosen], self.inward[chosen], self.sigma[chosen])


@dataclass(frozen=True, eq=False)
class Limb:
    """The fitted limb.

    Attributes
    ----------
    direction : (3,), unit vector to the Earth's centre in camera axes; None where there is none
    angular_radius : rad
    covariance : (3, 3) of (two angles of the direction about the axes of `basis`, angular radius), rad²
    basis : (2, 3), unit vectors across the direction
    pixels : (N, 2), edge points; `used` (N,) those the fit kept; `residuals` (N,), pixels
    sigma : (N,), pixels, how well each is known
    rays, across : (N, 3), lines of sight through them, and how these turn over a pixel inward
    status : "ok", or why there is none
    scale : pixels of the image to one of the smaller image that the limb was found in
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

    Air is many pixels deep in a telephoto picture: where no edge is as sharp as a pixel, the limb is the
    best known of those in smaller images. Pixels, sigma and residuals are of the image given.
    """
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
        tried = fit_limb(find_edges(less, small, place), small, sun, radius)
        if tried.status == "ok":
            found.append(_enlarged(tried, scale))
    return min(found, key=lambda one: one.std, default=limb)


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


def find_edges(image: np.ndarray, camera: Camera, sun: np.ndarray | None = None) -> Edges:
    """Edges of a grey image (height, width), uint8, whose dark side is dark for some pixels on.

    `sun` is the Sun's pixel (2,), whose own edge is left out.
    """
    image = grey(image, camera)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    size = np.hypot(dx, dy)
    noise = _gradient_noise(image)
    scale = 4000 / max(float(size.max()), 1e-6)
    edges = cv2.Canny(
        np.clip(dx * scale, -32000, 32000).astype(np.int16),
        np.clip(dy * scale, -32000, 32000).astype(np.int16),
        _WEAK * noise * scale,
        _EDGE * noise * scale,
        L2gradient=True,
    )
    rows, columns = np.nonzero(edges)
    border = 2
    keep = (rows >= border) & (rows < image.shape[0] - border)
    keep &= (columns >= border) & (columns < image.shape[1] - border)
    rows, columns = rows[keep], columns[keep]
    if not len(rows):
        return Edges(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    inward = np.stack([dx[rows, columns], dy[rows, columns]], axis=-1).astype(float)
    inward /= np.maximum(np.linalg.norm(inward, axis=-1, keepdims=True), 1e-12)
    pixels = np.stack([columns, rows], axis=-1).astype(float)
    pixels += _peak(size, pixels, inward)[:, None] * inward
    grain = noise * _SMOOTHED / _GRADIENT
    some = smooth[::8, ::8]
    dark = float(np.median(some[some <= np.percentile(some, 2) + 4 * grain]))
    inside = _sample(smooth, pixels + 3.0 * inward)
    good = inside > dark + 5 * grain
    for away, part in _OUTSIDE:
        allowed = dark + np.maximum(4 * grain, part * (inside - dark))
        good &= _sample(smooth, pixels - away * inward) <= allowed
    if sun is not None and np.isfinite(sun).all():  # NaN: behind the camera
        good &= np.linalg.norm(pixels - sun, axis=-1) > 15 + 3 * 0.005 * camera.focal_px
    return _placed(image, Edges(pixels[good], inward[good], np.ones(good.sum())), noise / _GRADIENT)


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
    edges = edges.some(_MOST_POINTS)
    count = len(edges.pixels)
    nothing = np.zeros(count, dtype=bool), np.full(count, np.nan)
    if count < LEAST_POINTS:
        return Limb(None, None, None, None, edges.pixels, *nothing, "Earth not in view")
    rays = camera.rays(edges.pixels)
    step = 1e-3
    across = camera.rays(edges.pixels + step * edges.inward) - rays
    across /= step  # how the line of sight turns over a pixel, inward
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
    if not size > 1:
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
    )


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
    for _ in range(8):
        off, jacobian = _off(h, rays, across) / sigma, rays / ((across @ h) * sigma)[:, None]
        weight, scale = tukey(off)
        normal = jacobian.T @ (weight[:, None] * jacobian) / (scale**2 * COPIES)
        right = -jacobian.T @ (weight * off) / (scale**2 * COPIES)
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
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    basis = np.stack([first, np.cross(direction, first)])
    turn = np.vstack([basis / size, direction / (size * np.sqrt(max(size**2 - 1, 1e-12)))])
    return h, turn @ variance @ turn.T, basis


def tukey(off: np.ndarray) -> tuple[np.ndarray, float]:
    """Tukey's weights (N,) of residuals in standard errors, and by how much these are too small, ≥ 1."""
    scale = max(1.4826 * float(np.median(np.abs(off))), 1.0)
    return np.clip(1 - (off / (_TUKEY * scale)) ** 2, 0, None) ** 2, scale


def _placed(image: np.ndarray, edges: Edges, noise: float) -> Edges:
    """Edges put where the brightness profile across them begins.

    A lit ball's brightness changes as the square root of the depth behind its limb, because its
    ground turns so quickly there; the steepest place of the image lies up to a pixel outside. The profile
    b₀ + a·step + b·√depth, spread by the image's own width, is fitted to each by Gauss and Newton.
    """
    edges = edges.some(_MOST_POINTS)
    if not len(edges.pixels):
        return edges
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _PROFILE_BLUR)
    along = np.arange(-_PROFILE, _INSIDE + 1.0)
    places = edges.pixels[:, None] + along[:, None] * edges.inward[:, None]
    values = _sample(smooth, places.reshape(-1, 2)).reshape(len(places), -1)
    place = np.zeros(len(values))
    spread = np.sqrt(
        _PROFILE_BLUR**2 + 1 / 12 + 1 / 6
    )  # a pixel's own width, and that of interpolation
    for _ in range(8):
        u = (along - place[:, None]) / spread
        step, root = ndtr(u), np.interp(u, _TABLE, _ROOT)
        basis = np.stack([np.ones_like(u), step, root], axis=-1)
        square = np.swapaxes(basis, -1, -2) @ basis + 1e-9 * np.eye(3)
        heights = np.linalg.solve(square, np.swapaxes(basis, -1, -2) @ values[..., None])[..., 0]
        model = (basis @ heights[..., None])[..., 0]
        slope = (
            -(heights[:, 1:2] * _bell(u) + heights[:, 2:] * np.interp(u, _TABLE, _ROOT_SLOPE))
            / spread
        )
        # What of the slope the heights cannot take over (variable projection).
        own = np.linalg.solve(square, np.swapaxes(basis, -1, -2) @ slope[..., None])
        left = slope - (basis @ own)[..., 0]
        size = (left**2).sum(axis=-1)
        place = place + np.clip(
            (left * (values - model)).sum(axis=-1) / np.maximum(size, 1e-9), -0.5, 0.5
        )
    grain = noise / (2 * np.sqrt(np.pi) * _PROFILE_BLUR)
    # Neighbours along the profile share their noise; where the profile fits worse than noise lets it, the
    # ground's own pattern is in it.
    misfit = np.maximum(((values - model) ** 2).mean(axis=-1) / grain**2, 1.0)
    sigma = np.hypot(
        _LEAST_SIGMA, grain * np.sqrt(misfit * _PROFILE_BLUR * 3.5 / np.maximum(size, 1e-9))
    )
    # A thin crescent is dark again at the profile's end.
    rise = model.max(axis=-1) - heights[:, 0]
    good = (np.abs(place) < 4.0) & (sigma < 1.5) & (rise > 4 * grain)
    return Edges(
        edges.pixels[good] + place[good, None] * edges.inward[good], edges.inward[good], sigma[good]
    )


def _bell(u):
    return np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi)


def _gradient_noise(image: np.ndarray) -> float:
    """Standard deviation of one component of the smoothed gradient, DN a pixel, from the image itself.

    From differences of neighbours, which pictures have few of; a clipped dark sky has less than its own
    noise, so that a floor of 1 DN a pixel is kept. Where nearly all neighbours are equal there is none, and
    the few differences are the edges themselves.
    """
    thin = image[::4].astype(np.float32)
    pairs = np.abs(np.diff(thin, axis=1))
    unequal = pairs[pairs > 0]
    single = 1.0
    if len(unequal) > 0.05 * pairs.size:
        single = max(1.4826 * float(np.median(unequal)) / np.sqrt(2), 1.0)
    return single * _GRADIENT


def _peak(size: np.ndarray, pixels: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Where the gradient's size is largest along the gradient: a parabola's top, pixels, within ±1."""
    low, middle, high = (_sample(size, pixels + k * inward) for k in (-1.0, 0.0, 1.0))
    bend = low - 2 * middle + high
    return np.clip(0.5 * (low - high) / np.where(bend < 0, bend, -1e9), -1, 1)


def _sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values between pixels (N, 2), bilinear; those outside are the border's."""
    if not len(pixels):
        return np.empty(0)
    parts = [
        cv2.remap(
            image, part[:, :1], part[:, 1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for part in np.array_split(pixels.astype(np.float32), 1 + len(pixels) // _MOST_SAMPLES)
    ]
    return np.concatenate(parts)[:, 0].astype(float)
