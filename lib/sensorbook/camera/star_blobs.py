"""Stars in an image: spots above the background, their middles to a part of a pixel, and how good these are.

The middle is where the spot, weighed by a Gaussian as wide as itself, has its mean. Noise far from the
spot counts for nothing, and a symmetric spot pulls to no side (Bertin's windowed positions, SExtractor).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd

from sensorbook.camera.model import Camera, grey

REASONS = ("", "saturated", "cut by the edge", "too large", "too narrow", "too wide", "not round")
_OK, _SATURATED, _CUT, _LARGE, _NARROW, _WIDE, _LONG = range(len(REASONS))
_BLOCK = 64  # pixels, over which the background is even
_ROUNDING = 12**-0.5  # DN, of whole numbers
_CLIPS = 6
_MOST_BLOBS = 3000
_STEPS = 12
# How broad a spot is, as a share: ½ where it is as wide as the weight, 1 for a point, 0 for a plain.
_NARROWEST, _WIDEST, _ROUNDEST = 0.72, 0.3, 0.15
_FLOOR = 0.003  # pixels; the pixels' grid


@dataclass(frozen=True, eq=False)
class Blobs:
    """Spots in an image, the brightest first.

    Attributes
    ----------
    pixels : (K, 2), middles
    std : (K,), pixels, standard error of a middle in x and in y
    flux : (K,), DN, of the whole spot
    area : (K,), pixels above the threshold
    reason : (K,), index into `REASONS`: 0 for a star, else why it counts for none
    background, noise : DN, medians over the image
    """

    pixels: np.ndarray
    std: np.ndarray
    flux: np.ndarray
    area: np.ndarray
    reason: np.ndarray
    background: float
    noise: float

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def usable(self) -> np.ndarray:
        """(K,), which may be stars."""
        return self.reason == _OK

    def to_frame(self) -> pd.DataFrame:
        """One row a blob."""
        return pd.DataFrame(
            {
                "x [pixels]": self.pixels[:, 0],
                "y [pixels]": self.pixels[:, 1],
                "standard error [pixels]": self.std,
                "flux [DN]": self.flux,
                "rejected": [REASONS[r] for r in self.reason],
            }
        )


def find_blobs(
    image: np.ndarray,
    camera: Camera,
    gain: float,
    spread: float = 1.0,
    threshold: float = 6.0,
) -> Blobs:
    """Spots in a grey image (height, width), uint8.

    Parameters
    ----------
    gain : electrons per DN, for the spots' own shot noise
    spread : pixels, standard deviation of a star's spot
    threshold : standard deviations of the smoothed background above which a spot begins
    """
    image = grey(image, camera)
    for name, value in (("gain", gain), ("spread", spread), ("threshold", threshold)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} is {value}: give a positive number")
    background, noise = _background(image)
    above = image - background
    smooth = cv2.GaussianBlur(above, (0, 0), spread, borderType=cv2.BORDER_REFLECT)
    # Smoothing leaves this part of white noise: the root of the sum of the kernel's squares.
    left = 1 / (2 * np.sqrt(np.pi) * max(spread, 0.3))
    mask = (smooth > threshold * left * noise).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    typical = float(np.median(background)), float(np.median(noise))
    found = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[:_MOST_BLOBS]
    if not len(found):
        none = np.zeros(0)
        return Blobs(np.zeros((0, 2)), none, none, none, none.astype(int), *typical)
    stats = stats[found]
    peaks = np.array(
        [_peak(smooth, labels, label, s) for label, s in zip(found, stats, strict=True)]
    )
    pixels, std, flux, shape = _middles(above, noise, peaks, gain, spread)
    reason = _reasons(image, labels, found, stats, pixels, shape, spread)
    flux = np.where(reason == _NARROW, flux / 2, flux)  # the weight takes in all of a point
    order = np.argsort(-flux, kind="stable")
    area = stats[:, cv2.CC_STAT_AREA]
    return Blobs(pixels[order], std[order], flux[order], area[order], reason[order], *typical)


def _background(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Background and standard deviation of its noise, DN, (height, width) each, float32."""
    level, _ = _even(image.astype(np.float32))
    _, spread = _even(image - level)
    return level, np.maximum(spread, _ROUNDING)


def _even(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation about every pixel of what is no spot, (height, width), float32.

    Of each block without what is far from its mean; the median of 3 × 3 blocks takes out what fills one.
    """
    height, width = values.shape
    down, across = -(-height // _BLOCK), -(-width // _BLOCK)
    below, right = down * _BLOCK - height, across * _BLOCK - width
    padded = cv2.copyMakeBorder(values, 0, below, 0, right, cv2.BORDER_REFLECT)
    blocks = padded.reshape(down, _BLOCK, across, _BLOCK).swapaxes(1, 2).reshape(down, across, -1)
    blocks = blocks[..., ::5]  # a fifth tells as much
    kept = np.ones(blocks.shape, dtype=bool)
    for _ in range(_CLIPS):
        count = kept.sum(axis=-1, keepdims=True)
        mean = (blocks * kept).sum(axis=-1, keepdims=True) / count
        far = (blocks - mean) ** 2
        square = (far * kept).sum(axis=-1, keepdims=True) / count
        # A block of one value keeps it all.
        kept = far <= np.maximum(3.5**2 * square, 1e-6)
    maps = []
    for each in (mean[..., 0], np.sqrt(square[..., 0])):
        calm = cv2.medianBlur(each.astype(np.float32), 3)
        # One more block on each side, on the straight line of the last two.
        wider = np.pad(calm, 1, mode="reflect", reflect_type="odd")
        size = (across + 2) * _BLOCK, (down + 2) * _BLOCK
        full = cv2.resize(wider, size, interpolation=cv2.INTER_LINEAR)
        maps.append(full[_BLOCK : _BLOCK + height, _BLOCK : _BLOCK + width])
    return maps[0], maps[1]


def _peak(smooth: np.ndarray, labels: np.ndarray, label: int, stats: np.ndarray) -> tuple[int, int]:
    """(x, y) of a blob's largest smoothed value."""
    x, y, width, height = stats[:4]
    box = slice(y, y + height), slice(x, x + width)
    own = np.where(labels[box] == label, smooth[box], -np.inf)
    row, column = np.unravel_index(np.argmax(own), own.shape)
    return x + column, y + row


def _middles(above, noise, peaks, gain, spread):
    """Middles (K, 2), their standard errors (K,), fluxes (K,) and shapes (K, 2, 2) of spots at `peaks`.

    Errors of the pixels move the middle by Σ w n d / Σ w I (1 − d²/s²), d the distance in x or y.
    """
    reach = int(np.ceil(4 * spread)) + 1
    step = np.arange(-reach, reach + 1)
    wide = [cv2.copyMakeBorder(a, *(reach,) * 4, cv2.BORDER_REPLICATE) for a in (above, noise)]
    rows, columns = peaks[:, 1, None] + step + reach, peaks[:, 0, None] + step + reach
    patch, spot_noise = (a[rows[:, :, None], columns[:, None, :]].astype(float) for a in wide)
    variance = spot_noise**2 + np.maximum(patch, 0) / gain
    offset = np.zeros(peaks.shape)
    for _ in range(_STEPS):
        dx, dy = step - offset[:, :1], step - offset[:, 1:]
        weight = np.exp(-(dx[:, None, :] ** 2 + dy[:, :, None] ** 2) / (2 * spread**2))
        lit = weight * patch
        total = np.maximum(lit.sum(axis=(1, 2)), 1e-9)
        pull = np.stack(
            [(lit.sum(axis=1) * dx).sum(axis=1), (lit.sum(axis=2) * dy).sum(axis=1)], -1
        )
        offset = np.clip(offset + 2 * pull / total[:, None], -reach / 2, reach / 2)
    distance = np.stack(np.broadcast_arrays(dx[:, None, :], dy[:, :, None]), axis=-1)
    second = np.einsum("kij,kija,kijb->kab", lit, distance, distance) / spread**2
    shape = np.eye(2) - second / total[:, None, None]
    slope = np.maximum(np.einsum("kaa->ka", shape), 0.1) * total[:, None]
    moved = np.einsum("kij,kija->ka", weight**2 * variance, distance**2)
    std = np.sqrt((moved / slope**2).mean(axis=-1) + _FLOOR**2)
    return peaks + offset, std, 2 * total, shape


def _reasons(image, labels, found, stats, pixels, shape, spread):
    """Why a blob is no star, (K,), index into `REASONS`."""
    area = stats[:, cv2.CC_STAT_AREA]
    reason = np.zeros(len(found), dtype=int)
    narrow = np.linalg.eigvalsh(shape)
    reason[narrow[:, 1] - narrow[:, 0] > 2 * _ROUNDEST] = _LONG
    reason[narrow[:, 0] < _WIDEST] = _WIDE
    reason[narrow[:, 1] > _NARROWEST] = _NARROW
    margin = 3 * spread
    last = np.array([image.shape[1], image.shape[0]]) - 1 - margin
    reason[((pixels < margin) | (pixels > last)).any(axis=-1)] = _CUT
    full = np.isin(found, np.unique(labels[image == 255]))
    reason[full] = _SATURATED
    # The brightest star's spot, a million times the threshold, is above it out to 7.4 smoothed spreads.
    reason[area > np.pi * 7.4**2 * 2 * spread**2] = _LARGE
    return reason
