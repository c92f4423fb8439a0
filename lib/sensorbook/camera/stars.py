"""From an image of stars to an attitude: spots, which stars they are, and Wahba's problem.

>>> from sensorbook.camera.star_scene import made_up_sky, render_stars
>>> rng = np.random.default_rng(1)
>>> camera, sky = Camera(512, 512, 1450.0), made_up_sky(5.0, rng)  # 20° across
>>> image = render_stars(camera, sky, np.eye(3), rng)
>>> found = attitude_from_stars(image, camera, StarTable.of(sky.directions, camera), gain=40.0)
>>> found.status, bool(np.abs(found.matrix - np.eye(3)).max() < 1e-3)
('ok', True)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorbook.attitude import davenport
from sensorbook.attitude.sensors.star import StarSensor
from sensorbook.camera.model import Camera
from sensorbook.camera.star_blobs import Blobs, find_blobs
from sensorbook.camera.star_identify import LEAST, NONE, StarTable, identify, nearest

__all__ = ["StarAttitude", "StarTable", "attitude_from_stars"]

_OUTLIER = 4.5  # standard errors that a star may be off the attitude found
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class StarAttitude:
    """What one image of stars tells.

    Attributes
    ----------
    blobs : the spots found
    matched : (K,), the catalogue's row of each spot, −1 for none
    off : (K,), pixels, how far a spot lies from its star at the attitude found; NaN for none
    matrix : (3, 3), body from inertial; None where there is no solution
    covariance : (3, 3), rad², of the error vector in body axes
    across_std, roll_std : rad, standard errors across and about the camera's axis; NaN for none
    misfit : mean square of the stars' distances over their standard errors, 1 where these are right
    chance : expected number of false solutions as good as this one, in one image; NaN for none
    status : "ok", or the reason in words
    """

    blobs: Blobs
    matched: np.ndarray
    off: np.ndarray
    matrix: np.ndarray | None
    covariance: np.ndarray | None
    across_std: float
    roll_std: float
    misfit: float
    chance: float
    status: str

    def to_frame(self) -> pd.DataFrame:
        """One row a blob, the brightest first."""
        table = self.blobs.to_frame()
        table["star"] = self.matched
        table["off [pixels]"] = self.off
        return table


def attitude_from_stars(
    image: np.ndarray,
    camera: Camera,
    table: StarTable,
    gain: float,
    spread: float = 1.0,
    threshold: float = 6.0,
) -> StarAttitude:
    """The attitude of a body whose camera sees stars, lost in space: nothing is known before.

    Parameters
    ----------
    image : (height, width), uint8
    table : of the catalogue's stars as they are seen: aberration, 20″ from the Earth's motion, put in
    gain, spread, threshold : as for `find_blobs`
    """
    blobs = find_blobs(image, camera, gain, spread, threshold)
    spots = np.flatnonzero(blobs.usable)
    rays = camera.rays(blobs.pixels[spots])
    std = blobs.std[spots] * pixel_angle(rays, camera)
    identity = identify(rays, std, table)
    if identity.status != "ok":
        return _refused(blobs, identity.status)
    stars, solved = _settle(rays, std, identity.stars, table)
    if solved is None:
        return _refused(blobs, NONE)
    matched, off = np.full(len(blobs), -1), np.full(len(blobs), np.nan)
    named = stars >= 0
    matched[spots] = stars
    seen = camera.project(table.directions[stars[named]] @ solved.matrix.T)
    off[spots[named]] = np.linalg.norm(seen - blobs.pixels[spots[named]], axis=-1)
    across, roll = np.sqrt([np.diag(solved.covariance)[:2].mean(), solved.covariance[2, 2]])
    misfit = 2 * solved.loss / (2 * named.sum() - 3)
    turn = camera.to_body
    return StarAttitude(
        blobs,
        matched,
        off,
        turn @ solved.matrix,
        turn @ solved.covariance @ turn.T,
        float(across),
        float(roll),
        float(misfit),
        identity.chance,
        "ok",
    )


def pixel_angle(rays: np.ndarray, camera: Camera) -> np.ndarray:
    """Angle (…), rad, that a pixel spans at rays (…, 3): the rms of outward and across."""
    sensor = StarSensor(camera.focal_px, camera.width, camera.height)
    return np.sqrt((sensor.pixel_angles(rays) ** 2).mean(axis=-1))


def _settle(rays, std, stars, table):
    """Stars (K,) and the attitude of the camera by all of them, once no star is off by more than chance."""
    for _ in range(_ROUNDS):
        used = stars >= 0
        if used.sum() < LEAST:
            return stars, None
        solved = davenport(rays[used], table.directions[stars[used]], sigma=std[used])
        again = nearest(rays, solved.matrix, _OUTLIER * np.hypot(std, _std(rays, solved)), table)
        if (again == stars).all():
            break
        stars = again
    return stars, solved


def _std(rays: np.ndarray, solved) -> np.ndarray:
    """Standard error (K,), rad, that an attitude's own leaves at directions (K, 3), both axes together."""
    own = np.einsum("ka,ab,kb->k", rays, solved.covariance, rays)
    return np.sqrt(np.maximum(np.trace(solved.covariance) - own, 0.0))


def _refused(blobs: Blobs, reason: str) -> StarAttitude:
    none = np.full(len(blobs), -1)
    nothing = np.full(len(blobs), np.nan)
    return StarAttitude(blobs, none, nothing, None, None, *(np.nan,) * 4, f"no solution: {reason}")
