"""A limb too faint or too broken for edges to show it, found where Sun and position say that it can be.

Once the Sun is found, and its angle from the nadir known, the Earth can only lie on a circle around it:
one number is left, and all of the lit limb votes for it together.
"""

from __future__ import annotations

import cv2
import numpy as np

from sensorbook.attitude.rotations import matrix_from_axis_angle
from sensorbook.camera.edges import Edges, pixel_noise, placed, sample
from sensorbook.camera.limb import across_of
from sensorbook.camera.model import Camera

_BLUR = 1.0  # pixels
_INSIDE, _OUTSIDE = 1.5, (2.5, 4.0, 5.5)  # pixels from the limb, where brightness is compared
_TOGETHER = 9  # pixels along the limb whose profiles are averaged
_POINTS = 120  # around the limb
_LEAST = (
    3.5  # standard errors of the noise that the limb stands out by; noise alone: 1.4, at most 2.2
)
_AHEAD = 1.6  # times that of any other place
_QUARTER = 0.8  # standard errors that three of the arc's quarters stand out by
_MOST = 4.0  # of the noise: what one point may add
_COVER = 0.25  # of the limb's pixels that must have an edge
_SHARE = 0.6  # of the limb that is brighter than what is outside: a spot on it is no limb


def guided_edges(
    image: np.ndarray, camera: Camera, sun: np.ndarray, separation: float, radius: float
) -> Edges | None:
    """Edge points along the limb that stands out best; None where none does.

    Parameters
    ----------
    image : (height, width), uint8
    sun : (3,), direction of the Sun in camera axes
    separation : rad, between Sun and nadir
    radius : rad, angular radius of the Earth
    """
    first = across_of(sun)[0]
    down = np.cos(separation) * sun + np.sin(separation) * first
    pixel = 1 / camera.focal_px  # rad, at the middle of the image
    e1, e2 = across_of(down)

    def limb(count, away):
        turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
        side = np.cos(turn) * e1 + np.sin(turn) * e2
        return np.cos(radius + away) * down + np.sin(radius + away) * side

    lit = (limb(_POINTS, 0.0) * np.cos(radius) - down) @ sun / np.sin(radius)
    bright = lit > 0.02
    inner = limb(_POINTS, -_INSIDE * pixel)[bright]
    outers = [limb(_POINTS, away * pixel)[bright] for away in _OUTSIDE]
    weight = lit[bright]
    # One pixel from one place to the next, at the limb's far side from the Sun.
    steps = int(2 * np.pi * max(np.sin(separation), 0.05) / pixel)
    turns = matrix_from_axis_angle(sun, np.linspace(0, 2 * np.pi, steps, endpoint=False))
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    grain = pixel_noise(image)
    smoothed = grain / (2 * np.sqrt(np.pi) * _BLUR)
    rise, seen = _contrast(smooth, camera, turns, inner, outers)
    rise = np.minimum(rise, _MOST * smoothed)  # or a star outshines the whole limb
    weights = weight * seen
    size = np.sqrt((weights**2).sum(axis=1))
    votes = (
        (weights * rise).sum(axis=1)
        / np.maximum(size, 1e-9)
        / (np.sqrt(1 + 1 / len(outers)) * smoothed)
    )
    votes[seen.sum(axis=1) < 5] = 0
    best = int(np.argmax(votes))
    apart = np.abs((np.arange(steps) - best + steps // 2) % steps - steps // 2)
    # A place less than a radius away shares some of the same limb.
    rival = votes[apart * pixel > radius].max(initial=0.0)
    if votes[best] < max(_LEAST, _AHEAD * rival):
        return None
    if not _everywhere(weights[best], rise[best] / smoothed):
        return None
    # A point a pixel, along the lit part that is in view.
    count = max(int(2 * np.pi * np.sin(radius) / pixel), _POINTS)
    there = limb(count, 0.0)
    there = there[(there * np.cos(radius) - down) @ sun > 0.02 * np.sin(radius)]
    deeper = there + pixel * (down - there * (there @ down)[:, None]) / np.sin(radius)
    pixels = camera.project(there @ turns[best])
    inward = camera.project(deeper @ turns[best]) - pixels
    inside = camera.sees(there @ turns[best], 6)
    inward = inward[inside] / np.linalg.norm(inward[inside], axis=-1, keepdims=True)
    edges = placed(image, Edges(pixels[inside], inward, np.ones(inside.sum())), grain, _TOGETHER)
    return edges if len(edges.pixels) >= _COVER * inside.sum() else None


def _everywhere(weight: np.ndarray, rise: np.ndarray) -> bool:
    """Whether the limb stands out along its arc, not at one spot: weights (K,), rises (K,) over noise."""
    if (weight * (rise > 0)).sum() < _SHARE * weight.sum():
        return False
    # From where the arc begins: it may run through the first direction.
    seen = np.flatnonzero(weight > 0)
    gap = np.argmax(np.diff(seen, append=seen[0] + len(weight)))
    seen = np.roll(seen, -1 - gap)
    quarter = np.minimum(4 * np.cumsum(weight[seen] ** 2) / (weight**2).sum(), 3.999).astype(int)
    votes = np.bincount(quarter, weight[seen] * rise[seen], 4)
    size = np.sqrt(np.bincount(quarter, weight[seen] ** 2, 4))
    return int((votes > _QUARTER * size).sum()) >= 3


def _contrast(smooth, camera, turns, inner, outers):
    """How much brighter `inner` directions (K, 3) are than the mean of `outers`, and where all are in view.

    Both (M, K), for M `turns` of the directions.
    """
    values, seen = [], []
    for directions in (inner, *outers):
        turned = directions @ turns
        inside = camera.sees(turned, 2)
        pixels = np.where(inside[..., None], camera.project(turned), 0.0)
        values.append(sample(smooth, pixels.reshape(-1, 2)).reshape(inside.shape))
        seen.append(inside)
    seen = np.logical_and.reduce(seen)
    return np.where(seen, values[0] - np.mean(values[1:], axis=0), 0.0), seen
