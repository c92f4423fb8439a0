"""A made-up sky, and what a camera sees of it: stars, false stars, hot pixels, the Moon, streaks.

Independent of everything that reads images: a star is a Gaussian spot integrated over each pixel, its
photoelectrons are counted with their shot noise, and the count is read out in 8 bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from sensorbook.attitude.rotations import matrix_from_axis_angle
from sensorbook.attitude.sensors.star import random_sky, reference_vectors
from sensorbook.camera.model import Camera

# Stars brighter than magnitude m in the whole sky: 6.57 exp(1.08 m) (Liebe 2002, IEEE Transactions on
# Aerospace and Electronic Systems 38, 587), that is log₁₀ N = 0.818 + 0.469 m.
STARS_TO_ZERO, GROWTH = 6.57, 1.08
MOON_RADIUS = 0.004521  # rad, from its mean distance: 1737.4 km over 384 400 km
_SPOT = 6  # standard deviations of a spot that are drawn
_MOST_STEPS = 4000


@dataclass(frozen=True, eq=False)
class Sky:
    """Stars: unit vectors `directions` (N, 3), inertial, as they are seen, and `magnitudes` (N,)."""

    directions: np.ndarray
    magnitudes: np.ndarray

    def brighter(self, limit: float) -> Sky:
        """The stars up to a magnitude: a catalogue is shorter than the sky."""
        kept = self.magnitudes <= limit
        return Sky(self.directions[kept], self.magnitudes[kept])


@dataclass(frozen=True)
class Optics:
    """What a lens and a detector make of a star.

    Attributes
    ----------
    electrons : photoelectrons of a star of magnitude 0 in one exposure
    spread : pixels, standard deviation of a star's spot
    background : electrons a pixel, of sky and dark current
    read_noise : electrons, standard deviation
    gain : electrons per DN
    """

    electrons: float = 4e5
    spread: float = 1.0
    background: float = 40.0
    read_noise: float = 20.0
    gain: float = 40.0

    def __post_init__(self) -> None:
        for name in ("electrons", "spread", "gain"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}: give a positive number")
        for name in ("background", "read_noise"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}: give electrons, 0 or more")


OPTICS = Optics()


def stars_to(limit: float) -> float:
    """How many stars the sky holds up to a magnitude.

    >>> round(stars_to(6.0))
    4283
    """
    return STARS_TO_ZERO * np.exp(GROWTH * limit)


def made_up_sky(limit: float, rng: np.random.Generator) -> Sky:
    """Stars up to a magnitude, spread evenly, as many of each brightness as the real sky has."""
    count = round(stars_to(limit))
    directions = reference_vectors(*random_sky(count, rng))
    return Sky(directions, limit + np.log(1 - rng.uniform(size=count)) / GROWTH)


def render_stars(
    camera: Camera,
    sky: Sky,
    attitude: ArrayLike,
    rng: np.random.Generator,
    optics: Optics = OPTICS,
    false: int = 0,
    hot: int = 0,
    turn: ArrayLike = (0.0, 0.0, 0.0),
    moon: ArrayLike | None = None,
) -> np.ndarray:
    """The image (height, width), uint8, of a camera on a body with `attitude` (3, 3), body from inertial.

    Parameters
    ----------
    false : spots that are no stars, anywhere, as bright as the brighter half of the sky's stars
    hot : pixels that a particle or a defect lights
    turn : (3,), rad, rotation vector of the body during the exposure; `attitude` is that in its middle
    moon : (3,), unit vector to the Moon, inertial; None where it is not up
    """
    to_camera = camera.to_body.T @ np.asarray(attitude, dtype=float)
    if not np.isfinite(turn).all() or np.shape(turn) != (3,):
        raise ValueError(f"turn is {turn}: give a rotation vector of three numbers, rad")
    seen = sky.directions @ to_camera.T
    right, bottom = camera.width - 1, camera.height - 1
    corners = [[0, 0], [right, 0], [0, bottom], [right, bottom]]
    # Corners without a direction say nothing: anything ahead may be in view.
    reach = np.arccos(np.nan_to_num(camera.rays(corners)[:, 2]).min()) + 0.02
    near = seen[:, 2] > np.cos(min(reach + np.linalg.norm(turn), np.pi))
    places = camera.project(_trail(camera, seen[near], camera.to_body.T @ np.asarray(turn)))
    electrons = optics.electrons * 10 ** (-0.4 * sky.magnitudes[near]) / len(places)
    mean = np.full((camera.height, camera.width), float(optics.background))
    last = np.array([camera.width, camera.height]) + _SPOT * optics.spread
    with np.errstate(invalid="ignore"):
        inside = ((places > -_SPOT * optics.spread) & (places < last)).all(axis=-1)
    for step, star in zip(*np.nonzero(inside), strict=True):
        _add_spot(mean, places[step, star], electrons[star], optics.spread)
    for place in rng.uniform([0, 0], [right, bottom], (false, 2)):
        magnitude = rng.uniform(*np.quantile(sky.magnitudes, [0.02, 0.5]))
        _add_spot(mean, place, optics.electrons * 10 ** (-0.4 * magnitude), optics.spread)
    full = 256 * optics.gain
    if moon is not None:
        up = to_camera @ np.asarray(moon, dtype=float)
        mean[camera.grid @ up > np.cos(MOON_RADIUS)] += 2 * full
    if hot:
        rows, columns = rng.integers(0, camera.height, hot), rng.integers(0, camera.width, hot)
        mean[rows, columns] += full * rng.uniform(0.1, 0.9, hot)
    counted = rng.poisson(mean) + optics.read_noise * rng.normal(size=mean.shape)
    return np.clip(np.rint(counted / optics.gain), 0, 255).astype(np.uint8)


def _trail(camera: Camera, directions: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Directions (T, N, 3) in camera axes at even times of the exposure, half a pixel apart or less."""
    angle = float(np.linalg.norm(turn))
    # Off the axis a turn about it and the tangent's growth move stars by up to this many pixels.
    across = np.hypot(camera.width, camera.height)
    steps = 1 + int(np.ceil(2 * angle * max(camera.focal_px, across) * 1.5))
    if steps > _MOST_STEPS:
        raise ValueError(f"turn is {np.degrees(angle):.3g}°: the trails would leave the image")
    if steps == 1:
        return directions[None]
    times = (np.arange(steps) + 0.5) / steps - 0.5
    turned = matrix_from_axis_angle(turn / angle, angle * times)
    return directions @ np.swapaxes(turned, -1, -2)


def _add_spot(mean: np.ndarray, place: np.ndarray, electrons: float, spread: float) -> None:
    """Adds a Gaussian spot to the image, each pixel its integral over the pixel's square."""
    x0, y0 = np.maximum(np.floor(place - _SPOT * spread).astype(int), 0)
    x1, y1 = np.floor(place + _SPOT * spread).astype(int) + 2
    x, y = np.arange(x0, min(x1, mean.shape[1]) + 1), np.arange(y0, min(y1, mean.shape[0]) + 1)
    if len(x) < 2 or len(y) < 2:
        return
    across, down = (
        np.diff(erf((edges - 0.5 - middle) / (np.sqrt(2) * spread))) / 2
        for edges, middle in ((x, place[0]), (y, place[1]))
    )
    mean[y0 : y0 + len(down), x0 : x0 + len(across)] += electrons * down[:, None] * across
