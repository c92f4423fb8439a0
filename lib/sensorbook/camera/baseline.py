"""Work C's image chain (4.1–4.2): median, Canny, the largest set of edges, an ellipse, its centre.

The baseline to compare with, kept as C describes it. Its centre of the ellipse is not the image of the
Earth's centre: in a wide picture it is degrees off.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from sensorbook.camera.ellipse import Ellipse, guaranteed_ellipse
from sensorbook.camera.model import FARTHEST, Camera
from sensorbook.errors import Refusal

WINDOW = 7  # pixels, of the median
# Canny's first step, which OpenCV leaves to its caller; σ = √2 px.
SMOOTHING = (7, 7), 2**0.5
# Slopes of the smoothed image, as Sobel's sums give them. A sharp step of h grey levels has 2.2 h: edges
# start at steps of 45 levels and go on along those of 18. C prints none; their ratio is customary.
LOW, HIGH = 40, 100
SUN_LEVEL = 250  # grey level from which a pixel may be the Sun's


@dataclass(frozen=True, eq=False)
class Baseline:
    """What the chain made of an image, step by step.

    Parameters
    ----------
    filtered : (H, W) uint8, after the median
    edges : (H, W) bool, Canny's edges
    chain : (N, 2) pixels x, y of the largest set of edges
    ellipse : fitted to the chain, or None
    earth_direction : (3,), unit vector to the ellipse's centre in camera axes, or None
    sun_direction : (3,), unit vector to the brightest blob's centroid in camera axes, or None
    status : "ok" where both were found, else what was not and why
    """

    filtered: np.ndarray
    edges: np.ndarray
    chain: np.ndarray
    ellipse: Ellipse | None
    earth_direction: np.ndarray | None
    sun_direction: np.ndarray | None
    status: str


def baseline(image: np.ndarray, camera: Camera) -> Baseline:
    """The Earth's and the Sun's directions in an image by work C's chain.

    C collects edges by walks: from a random edge pixel on to any neighbour among the eight, until none is
    left, then again from another; the set with the most pixels is the limb. Sets of pixels connected by
    those neighbours are its deterministic reading: whatever start a walk has, it stays within one.
    The Sun is the largest blob of near-white pixels, whatever its size: C takes it that nothing is
    brighter. Directions are (4.4) and (4.6), in camera axes; distortion, which C has none of, is taken
    out of them.

    Parameters
    ----------
    image : (H, W) uint8, grey
    camera : the camera that took it

    Raises
    ------
    ValueError : an image of another type, or of another size than the camera's
    """
    image = np.asarray(image)
    if image.dtype != np.uint8 or image.shape != (camera.height, camera.width):
        raise ValueError(
            f"image must be uint8 of shape {(camera.height, camera.width)}, "
            f"not {image.dtype} of shape {image.shape}"
        )
    image = np.ascontiguousarray(image)
    filtered = cv2.medianBlur(image, WINDOW)
    edges = cv2.Canny(cv2.GaussianBlur(filtered, *SMOOTHING), LOW, HIGH, L2gradient=True) > 0
    chain = _largest(edges)
    missing, ellipse, earth = [], None, None
    try:
        ellipse = guaranteed_ellipse(chain)
        earth = _direction(camera, ellipse.centre)
        if earth is None:
            missing.append("No Earth: the camera has no direction for the ellipse's centre.")
    except Refusal as refusal:
        reason = refusal.reason if len(chain) else "The image has no edge."
        missing.append(f"No Earth: {reason}")
    # In the image as it comes: the median takes away a Sun three pixels wide.
    blob = _largest(image >= SUN_LEVEL)
    sun = _direction(camera, blob.mean(axis=0)) if len(blob) else None
    if len(blob) and sun is None:
        missing.append("No Sun: the camera has no direction for the brightest blob.")
    elif sun is None:
        missing.append(f"No Sun: the brightest pixel has {image.max()} of 255, below {SUN_LEVEL}.")
    return Baseline(filtered, edges, chain, ellipse, earth, sun, " ".join(missing) or "ok")


def _direction(camera: Camera, pixel: np.ndarray) -> np.ndarray | None:
    """The line of sight (3,) through a pixel (2,); None too far out, or where a distortion turns back."""
    if np.abs(pixel).max() > FARTHEST:
        return None
    ray = camera.rays(pixel)
    return None if np.isnan(ray).any() else ray


def _largest(mask: np.ndarray) -> np.ndarray:
    """(N, 2) x, y of the largest set of pixels (H, W) that eight neighbours connect; (0, 2) of none."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if not len(areas):
        return np.empty((0, 2))
    y, x = np.nonzero(labels == 1 + np.argmax(areas))
    return np.stack([x, y], axis=1).astype(float)
