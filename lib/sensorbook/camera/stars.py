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
from scipy.stats import chi2, poisson

from sensorbook.attitude import davenport
from sensorbook.attitude.sensors.star import StarSensor
from sensorbook.camera.model import Camera
from sensorbook.camera.star_blobs import Blobs, find_blobs
from sensorbook.camera.star_identify import LEAST, LIMIT, NONE, StarTable, identify, nearest

__all__ = ["StarAttitude", "StarTable", "attitude_from_stars"]

_OUTLIER = 4.5  # standard errors that a star may be off the attitude found
_ROUNDS = 10
_BY_CHANCE = 0.05  # how often stars with right standard errors fit worse than is taken for chance
_MOST_MISFIT = 5.0
_HALVINGS = 12
_BESIDE, _BESIDE_BY_CHANCE = 4.0, 1e-3  # times the reach; of an image with right standard errors
MISFIT = (
    "stars lie farther from their places than their standard errors allow: "
    "focal length, distortion or catalogue is wrong"
)


@dataclass(frozen=True, eq=False)
class StarAttitude:
    """What one image of stars tells.

    Attributes
    ----------
    blobs : the spots found
    matched : (K,), the catalogue's row of each spot, −1 for none
    off : (K,), pixels, how far a spot lies from its star at the attitude found; NaN for none
    matrix : (3, 3), body from inertial; None where there is no solution
    covariance : (3, 3), rad², of the error vector in body axes; times the misfit where that is more than
        chance. What turns all stars alike, as aberration does, no star shows: it is not in it
    across_std, roll_std : rad, standard errors across and about the camera's axis; NaN for none
    misfit : χ² of the stars' distances over its degrees of freedom, 1 where their standard errors are right
    chance : expected number of false solutions as good as this one, in one image, with standard errors as
        wide as the misfit makes them; NaN for none
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
    std = np.hypot(blobs.std[spots] * pixel_angle(rays, camera), table.std)
    identity = identify(rays, std, table)
    if identity.status != "ok":
        return _refused(blobs, identity.status)
    stars, solved, misfit = _settle(rays, std, identity.stars, table)
    if solved is None:
        return _refused(blobs, NONE)
    named = stars >= 0
    # Wider by √misfit: three angles of the first triangle, and both axes of every star that confirms it.
    chance = identity.chance * max(misfit, 1.0) ** (1.5 + (identity.stars >= 0).sum() - 3)
    if misfit > _MOST_MISFIT or chance > LIMIT or _more_beside(rays, std, stars, solved, table):
        return _refused(blobs, MISFIT, misfit)
    matched, off = np.full(len(blobs), -1), np.full(len(blobs), np.nan)
    matched[spots] = stars
    seen = camera.project(table.directions[stars[named]] @ solved.matrix.T)
    off[spots[named]] = np.linalg.norm(seen - blobs.pixels[spots[named]], axis=-1)
    covariance = solved.covariance
    across, roll = np.sqrt([np.diag(covariance)[:2].mean(), covariance[2, 2]])
    turn = camera.to_body
    return StarAttitude(
        blobs,
        matched,
        off,
        turn @ solved.matrix,
        turn @ covariance @ turn.T,
        float(across),
        float(roll),
        float(misfit),
        float(chance),
        "ok",
    )


def pixel_angle(rays: np.ndarray, camera: Camera) -> np.ndarray:
    """Angle (…), rad, that a pixel spans at rays (…, 3): the rms of outward and across."""
    sensor = StarSensor(camera.focal_px, camera.width, camera.height)
    return np.sqrt((sensor.pixel_angles(rays) ** 2).mean(axis=-1))


def _settle(rays, std, stars, table):
    """Stars (K,), the attitude by all of them once none is off by more than chance, and their misfit.

    Where all fit badly the reach grows with the misfit: else the stars that show it best would be left out.
    """
    for _ in range(_ROUNDS):
        used = stars >= 0
        if used.sum() < LEAST:
            return stars, None, np.nan
        solved, misfit, added = _solved(rays[used], table.directions[stars[used]], std[used])
        reach = _OUTLIER * np.sqrt(std**2 + added**2 + _std(rays, solved) ** 2)
        again = nearest(rays, solved.matrix, reach, table)
        if (again == stars).all():
            break
        stars = again
    return stars, solved, misfit


def _solved(rays, directions, std):
    """Attitude of stars (n, 3), the misfit of their standard errors (n,), and what it adds to each, rad.

    Where the misfit is more than chance, an error of the same size is added to all stars, as large as makes
    it 1 (Mandel and Paule 1970): a wrong catalogue or lens does not know which stars are bright.
    """
    freedom = 2 * len(rays) - 3

    def solve(added):
        found = davenport(rays, directions, sigma=np.hypot(std, added))
        return found, 2 * float(found.loss) / freedom

    solved, misfit = solve(0.0)
    if misfit <= chi2.isf(_BY_CHANCE, freedom) / freedom:
        return solved, misfit, 0.0
    low, high = 0.0, np.sqrt(misfit) * std.max()
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if solve(middle)[1] > 1 else (low, middle)
    return solve(high)[0], misfit, high


def _more_beside(rays, std, stars, solved, table) -> bool:
    """Whether spots lie just out of reach of stars, half as many as are named or more, and not by chance.

    Of stars that all fit badly, a few fit each other.
    """
    reach = _BESIDE * _OUTLIER * np.hypot(std, _std(rays, solved))
    unnamed = stars < 0
    beside = ((nearest(rays, solved.matrix, reach, table) >= 0) & unnamed).sum()
    mean = len(table.directions) * (1 - np.cos(np.minimum(reach[unnamed], np.pi))).sum() / 2
    return beside >= (~unnamed).sum() / 2 and poisson.sf(beside - 1, mean) < _BESIDE_BY_CHANCE


def _std(rays: np.ndarray, solved) -> np.ndarray:
    """Standard error (K,), rad, that an attitude's own leaves at directions (K, 3), both axes together."""
    own = np.einsum("ka,ab,kb->k", rays, solved.covariance, rays)
    return np.sqrt(np.maximum(np.trace(solved.covariance) - own, 0.0))


def _refused(blobs: Blobs, reason: str, misfit: float = np.nan) -> StarAttitude:
    none = np.full(len(blobs), -1)
    nothing = np.full(len(blobs), np.nan)
    numbers = np.nan, np.nan, misfit, np.nan
    return StarAttitude(blobs, none, nothing, None, None, *numbers, f"no solution: {reason}")
