"""The Sun in an image: its direction from the brightest small blob of the raw image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from sensorbook.camera.model import Camera, grey

SUN_RADIUS = 0.004652  # rad, from 1 AU (IAU 2015: 695 700 km over 149 597 871 km)
_BRIGHT = (
    0.94  # of the largest value an image can hold: the Sun saturates every camera that sees ground
)
_WHOLE = 1.2  # pixels: a disc of this radius covers one pixel wholly, wherever it lies
_DIM = 0.5  # of the largest value: less is no Sun, however small
_MOST_BLOBS = 300
_LEAST_AREA = 0.3  # of its disc: a rim of a pixel's width does not saturate
_LIKE = 0.25  # of the Sun's area: a second spot as large leaves it open which is the Sun
_STD, _STD_BLOOMED = 0.03, 0.1  # pixels
# Pixels that a lens of σ = 1 px spreads a Sun by that is 10⁶ times as bright as saturates: √(2 ln 10⁶) = 5.3.
_BLOOM = 6.0
_ROUND = 0.6  # of its box that a round spot fills: 0.785


@dataclass(frozen=True)
class Sun:
    """The Sun's place.

    Attributes
    ----------
    pixel : (2,), the middle of its disc; None where it was not found
    direction : (3,), unit vector in camera axes
    std : rad, standard error of the direction in each axis across it
    status : "ok", or why there is none
    """

    pixel: np.ndarray | None
    direction: np.ndarray | None
    std: float | None
    status: str


def find_sun(image: np.ndarray, camera: Camera) -> Sun:
    """Finds the Sun in a raw grey image (height, width), uint8.

    The true Sun is three pixels wide in a wide camera, which work C's median of 7 × 7 erases. It is
    told from sunlit clouds by its size: a compact saturated blob with darkness around it.
    """
    image = grey(image, camera)
    # A disc of a pixel or two covers none of them wholly.
    fills = min(SUN_RADIUS * camera.focal_px / _WHOLE, 1.0)
    level = 255 * max(_BRIGHT * fills, _DIM)
    bright = (image >= level).astype(np.uint8)
    _, _, stats, middles = cv2.connectedComponentsWithStats(bright, connectivity=8)
    spots, found = [], []
    # The largest ones: noise may lift thousands of single pixels of bright ground over the bound.
    for blob in 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[:_MOST_BLOBS]:
        x, y, width, height, area = stats[blob]
        ray = camera.rays(middles[blob])
        if np.isnan(ray).any():  # where the distortion turns back
            continue
        # A small circle off the axis is an ellipse, longer by 1/cos outward and wider by 1/√cos.
        radius = SUN_RADIUS * camera.focal_px
        long, wide = radius / ray[2] ** 2, radius / ray[2]
        if max(width, height) > 2 * (long + _BLOOM) + 1 or area > np.pi * (
            (long + _BLOOM) * (wide + _BLOOM)
        ):
            continue
        # What is larger than the disc itself is so by the lens: a round halo.
        if area > 1.5 * np.pi * max(long * wide, 1) and area < _ROUND * width * height:
            continue
        around = _ring(image, x, y, width, height)
        # Space around it on most sides; the limb may be near.
        if not (around.size and np.mean(around < 0.5 * level) > 0.6):
            continue
        spots.append(area)
        # Hot pixels are fewer than those that the disc covers wholly.
        if area >= _LEAST_AREA * np.pi * long * wide or _at_edge(stats[blob], image):
            found.append((area, blob))
    if not found:
        return Sun(None, None, None, "Sun not in view")
    area, blob = max(found)
    if sum(other > _LIKE * area for other in spots) > 1:
        return Sun(None, None, None, "Sun not told from other bright spots")
    x, y, width, height, _ = stats[blob]
    left, top = max(x - 2, 0), max(y - 2, 0)
    patch = image[top : y + height + 2, left : x + width + 2].astype(float)
    level = np.median(_ring(image, x, y, width, height))
    weight = np.clip(patch - level - 12, 0, None)
    rows, columns = np.indices(patch.shape)
    pixel = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    pixel += [left, top]
    if _at_edge(stats[blob], image):
        return Sun(None, None, None, "Sun cut by the edge of the image")
    direction = camera.rays(pixel)
    if np.isnan(direction).any():
        return Sun(None, None, None, "Sun not in view")
    # Whole DN and saturation of partly covered pixels on the rim, a few hundredths of a pixel each way; an
    # overfull disc has lost its rim.
    disc = np.pi * (SUN_RADIUS * camera.focal_px) ** 2 / direction[2] ** 3
    std = _STD if stats[blob][cv2.CC_STAT_AREA] < 1.5 * max(disc, 1) else _STD_BLOOMED
    return Sun(pixel, direction, std / camera.focal_px, "ok")


def _at_edge(stats: np.ndarray, image: np.ndarray) -> bool:
    """Whether a blob touches the image's edge."""
    x, y, width, height, _ = stats
    return x <= 0 or y <= 0 or x + width >= image.shape[1] or y + height >= image.shape[0]


def _ring(image: np.ndarray, x: int, y: int, width: int, height: int) -> np.ndarray:
    """Values around a blob's box, three pixels away."""
    top, left, bottom, right = y - 4, x - 4, y + height + 4, x + width + 4
    box = image[max(top, 0) : bottom, max(left, 0) : right]
    inner = np.zeros(box.shape, dtype=bool)
    inner[1:-1, 1:-1] = True
    return box[~inner]
