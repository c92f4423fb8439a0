"""Edge points of a bright body before dark space, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.integrate import trapezoid
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtr

from sensorbook.camera.model import Camera, grey

_BLUR = 1.2  # pixels, standard deviation of the smoothing before the gradient
_EDGE, _WEAK = 7.0, 4.0  # of the gradient's own noise: an edge starts, and goes on
# Beyond an edge it must grow dark: by how many pixels, and to which part of the step's height. Haze of
# 20 km reaches eight pixels at the rim of a wide camera in low orbit.
_OUTSIDE = ((8.0, 0.4), (14.0, 0.12))
_PROFILE, _INSIDE = 6, 4  # pixels outside and inside of an edge that its profile has
_RISE = 4.0  # of the noise after the smoothing: an edge's height
_PROFILE_BLUR = 0.8  # pixels, smoothing before it

# √depth spread by a unit normal width, and its slope.
_TABLE = np.linspace(-8, 16, 961)
_FINE = np.linspace(0, np.sqrt(24), 4001)
_ROOT = np.array(
    [trapezoid(2 * _FINE**2 * np.exp(-0.5 * (t - _FINE**2) ** 2), _FINE) for t in _TABLE]
) / np.sqrt(2 * np.pi)
_ROOT_SLOPE = np.gradient(_ROOT, _TABLE)
_LENSES = (0.0, 0.5, 0.8, 1.1, 1.5)  # pixels, point spreads tried
_MOST_LENS = 1.3  # what is wider is haze, in front of a sharp edge
_LENS_PROFILES = 60  # that choose one
_LEAST_SIGMA = 0.03  # pixels: of an edge between square pixels
MOST_POINTS = 1500  # of the fit; more share their noise
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
    lens : pixels, point spread that their profiles were fitted with
    """

    pixels: np.ndarray
    inward: np.ndarray
    sigma: np.ndarray
    lens: float = 0.0

    def some(self, most: int) -> Edges:
        """At most so many of them, evenly."""
        if len(self.pixels) <= most:
            return self
        chosen = np.linspace(0, len(self.pixels) - 1, most).astype(int)
        return Edges(self.pixels[chosen], self.inward[chosen], self.sigma[chosen], self.lens)


def find_edges(
    image: np.ndarray, camera: Camera, sun: np.ndarray | None = None, soft: bool = False
) -> Edges:
    """Edges of a grey image (height, width), uint8, whose dark side is dark for some pixels on.

    `sun` is the Sun's pixel (2,), whose own edge is left out. `soft` edges are those of air alone, which
    has no sharper one.
    """
    image = grey(image, camera)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    size = np.hypot(dx, dy)
    grain = pixel_noise(image)
    noise = grain * _GRADIENT
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
    smoothed = grain * _SMOOTHED
    some = smooth[::8, ::8]
    dark = float(np.median(some[some <= np.percentile(some, 2) + 4 * smoothed]))
    # A thin crescent is brightest, and dark again, sooner.
    inside = np.maximum(*(sample(smooth, pixels + k * inward) for k in (1.5, 3.0)))
    good = inside > dark + 5 * smoothed
    for away, part in _OUTSIDE:
        allowed = dark + np.maximum(4 * smoothed, part * (inside - dark))
        good &= sample(smooth, pixels - away * inward) <= allowed
    if sun is not None and np.isfinite(sun).all():  # NaN: behind the camera
        good &= np.linalg.norm(pixels - sun, axis=-1) > 15 + 3 * 0.005 * camera.focal_px
    return placed(image, Edges(pixels[good], inward[good], np.ones(good.sum())), grain, soft=soft)


def placed(
    image: np.ndarray, edges: Edges, grain: float, together: int = 1, soft: bool = False
) -> Edges:
    """Edges put where the brightness profile across them begins; `grain` is a pixel's noise, DN.

    Profiles are averages over so many neighbours `together`, where these follow each other along an edge.

    A lit ball's brightness changes as the square root of the depth behind its limb, because its
    ground turns so quickly there; the steepest place of the image lies up to a pixel outside. The profile
    b₀ + a·step + b·√depth, spread by the image's own width, is fitted to each by Gauss and Newton.
    """
    edges = edges.some(MOST_POINTS)
    if not len(edges.pixels):
        return edges
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _PROFILE_BLUR)
    along = np.arange(-_PROFILE, _INSIDE + 1.0)
    places = edges.pixels[:, None] + along[:, None] * edges.inward[:, None]
    values = sample(smooth, places.reshape(-1, 2)).reshape(len(places), -1)
    values = uniform_filter1d(values, together, axis=0, mode="nearest")
    # Beyond the brightest place of a thin crescent, or of a cloud, the profile says nothing of the limb.
    base, top = values[:, :3].mean(axis=-1), values.max(axis=-1)
    thin = values[:, -1] - base < 0.5 * (top - base)
    beyond = np.arange(len(along)) > values.argmax(axis=-1)[:, None] + 1
    seen = ~(thin[:, None] & beyond)
    values = values * seen
    lens = _lens(values, seen, along, _LENSES[-1] if soft else _MOST_LENS)
    place, model, heights, size = _profiles(values, seen, along, lens)
    grain = grain / (2 * np.sqrt(np.pi) * _PROFILE_BLUR) / np.sqrt(together)
    # Neighbours along the profile share their noise; where the profile fits worse than noise lets it, the
    # ground's own pattern is in it.
    misfit = np.maximum(((values - model) ** 2).sum(axis=-1) / seen.sum(axis=-1) / grain**2, 1.0)
    sigma = np.hypot(
        _LEAST_SIGMA, grain * np.sqrt(misfit * _PROFILE_BLUR * 3.5 / np.maximum(size, 1e-9))
    )
    # A thin crescent is dark again at the profile's end.
    rise = model.max(axis=-1) - heights[:, 0]
    good = (np.abs(place) < 4.0) & (sigma < 1.5) & (rise > _RISE * grain)
    return Edges(
        edges.pixels[good] + place[good, None] * edges.inward[good],
        edges.inward[good],
        sigma[good],
        lens,
    )


def _lens(values: np.ndarray, seen: np.ndarray, along: np.ndarray, most: float) -> float:
    """Point spread of the lens, pixels, that profiles (N, M) are fitted best with, of a few."""
    # The steepest ones tell it.
    rise = np.ptp(values, axis=1)
    chosen = np.argsort(-rise, kind="stable")[: max(len(rise) // 2, min(len(rise), 20))]
    chosen = chosen[:: max(len(chosen) // _LENS_PROFILES, 1)]
    misfits = [
        np.median(((values[chosen] - model) ** 2).sum(axis=-1))
        for _, model, _, _ in (
            _profiles(values[chosen], seen[chosen], along, lens) for lens in _LENSES
        )
    ]
    best = int(np.clip(np.argmin(misfits), 1, len(_LENSES) - 2))
    near = slice(best - 1, best + 2)
    bend, slope, _ = np.polyfit(_LENSES[near], misfits[near], 2)
    if bend <= 0:
        return 0.0
    found = min(-slope / (2 * bend), _LENSES[-1])
    # Next to none, and what no lens does but haze, whose slope is another.
    return float(found) if _LENSES[1] / 2 < found <= most else 0.0


def _profiles(values: np.ndarray, seen: np.ndarray, along: np.ndarray, lens: float):
    """Places (N,) along profiles (N, M), the fitted profiles, their heights (N, 3), and slopes squared."""
    # The smoothing's, the lens's, a pixel's own, and that of the interpolation.
    spread = np.sqrt(_PROFILE_BLUR**2 + lens**2 + 1 / 12 + 1 / 6)
    place = np.zeros(len(values))
    for _ in range(8):
        u = (along - place[:, None]) / spread
        step, root = ndtr(u), np.interp(u, _TABLE, _ROOT)
        basis = np.stack([np.ones_like(u), step, root], axis=-1) * seen[..., None]
        square = np.swapaxes(basis, -1, -2) @ basis + 1e-9 * np.eye(3)
        heights = np.linalg.solve(square, np.swapaxes(basis, -1, -2) @ values[..., None])[..., 0]
        model = (basis @ heights[..., None])[..., 0]
        slope = (
            -(heights[:, 1:2] * _bell(u) + heights[:, 2:] * np.interp(u, _TABLE, _ROOT_SLOPE))
            / spread
            * seen
        )
        # What of the slope the heights cannot take over (variable projection).
        own = np.linalg.solve(square, np.swapaxes(basis, -1, -2) @ slope[..., None])
        left = slope - (basis @ own)[..., 0]
        size = (left**2).sum(axis=-1)
        place = place + np.clip(
            (left * (values - model)).sum(axis=-1) / np.maximum(size, 1e-9), -0.5, 0.5
        )
    return place, model, heights, size


def _bell(u):
    return np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi)


def pixel_noise(image: np.ndarray) -> float:
    """Standard deviation of one pixel, DN, from the image itself.

    From differences of neighbours, which pictures have few of; a clipped dark sky has less than its own
    noise, so that a floor of 1 DN is kept. Where nearly all neighbours are equal there is none, and the
    few differences are the edges themselves.
    """
    thin = image[::4].astype(np.float32)
    pairs = np.abs(np.diff(thin, axis=1))
    unequal = pairs[pairs > 0]
    if len(unequal) > 0.05 * pairs.size:
        return max(1.4826 * float(np.median(unequal)) / np.sqrt(2), 1.0)
    return 1.0


def _peak(size: np.ndarray, pixels: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Where the gradient's size is largest along the gradient: a parabola's top, pixels, within ±1."""
    low, middle, high = (sample(size, pixels + k * inward) for k in (-1.0, 0.0, 1.0))
    bend = low - 2 * middle + high
    return np.clip(0.5 * (low - high) / np.where(bend < 0, bend, -1e9), -1, 1)


def sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
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
