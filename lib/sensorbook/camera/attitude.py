"""From an image of Earth and Sun to an attitude."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude import two_vector
from sensorbook.attitude.rotations import matrix_from_axis_angle
from sensorbook.camera.edges import find_edges
from sensorbook.camera.guided import guided_edges
from sensorbook.camera.limb import Limb, across_of, around, find_limb, fit_limb, weighted
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS
from sensorbook.camera.sun import SUN_RADIUS, Sun, find_sun
from sensorbook.errors import Refusal

_APART = np.radians(1.0)  # an ellipsoid's limb, and clouds on it, are a tenth of that off
_MISTAKEN = 0.1  # pixels to one of the lens's spread, by which edges may be off together
_NEAR = 3.0  # pixels beyond the Sun's rim that the ground's glow may fill
_WHOLE = 0.7  # of the edge points on the limb: fewer may be of one of another size
_MORE = 1.3  # times as many points on another limb
FEW = 40  # edge points: so few may lie on a limb by chance, and are looked at again
HAZE, HAZE_STD = 10e3, 15e3  # m: where the air's brightness ends, seen from space


@dataclass(frozen=True, eq=False)
class ImageAttitude:
    """What one image tells.

    Attributes
    ----------
    sun, limb : what was found of either
    matrix : (3, 3), body from inertial; None where the image does not determine it
    covariance : (3, 3), rad², of the error vector in body axes
    status : "ok", or the reason in words
    haze : m, how high the limb stands above the ground, found with the attitude, and its standard error
    """

    sun: Sun
    limb: Limb
    matrix: np.ndarray | None
    covariance: np.ndarray | None
    status: str
    haze: tuple[float, float] | None = None


def attitude_from_image(
    image: np.ndarray,
    camera: Camera,
    position: ArrayLike,
    sun: ArrayLike,
    semi_axes: ArrayLike = (EARTH_RADIUS,) * 3,
    sun_view: tuple[np.ndarray, Camera] | None = None,
) -> ImageAttitude:
    """The attitude of a body whose camera sees Earth and Sun, or of one with a camera for each.

    Parameters
    ----------
    image : (height, width), uint8
    position : (3,), m, of the satellite from the Earth's centre, inertial
    sun : (3,), unit vector from the satellite to the Sun, inertial
    semi_axes : (3,), m, of the Earth along the inertial axes
    sun_view : image and camera that look for the Sun at the same time, where it has its own
    """
    position, sun = np.asarray(position, dtype=float), np.asarray(sun, dtype=float)
    semi_axes = np.asarray(semi_axes, dtype=float)
    if semi_axes.shape != (3,) or not (semi_axes > 0).all():
        raise ValueError(f"semi_axes are {semi_axes}: give three lengths in metres, above 0")
    if not 1 < np.linalg.norm(position / semi_axes) < np.inf:
        raise ValueError("position is inside the Earth: give metres from its centre")
    if not abs(np.linalg.norm(sun) - 1) < 1e-6:
        raise ValueError(
            f"sun is no unit vector, its length {np.linalg.norm(sun):.4g}: divide by it"
        )
    size = np.linalg.norm(position)
    apart = float(np.arccos(np.clip(-position @ sun / size, -1, 1)))
    radius = expected_radius(size, semi_axes.mean())
    sun_camera = camera if sun_view is None else sun_view[1]
    seen = find_sun(*(sun_view or (image, camera)))
    if seen.status == "ok" and (near := _too_near(apart - radius[0], sun_camera)):
        seen = replace(seen, direction=None, pixel=None, std=None, status=near)
    to_sun = None if seen.direction is None else sun_camera.to_body @ seen.direction
    its_sun = None if to_sun is None else camera.to_body.T @ to_sun
    limb = find_limb(image, camera, its_sun, radius)
    if its_sun is not None and limb.used.sum() < FEW:
        edges = guided_edges(image, camera, its_sun, apart, radius[0])
        if edges is not None:
            limb = fit_limb(edges, camera, its_sun, radius)
        elif limb.status == "ok":
            limb = replace(limb, direction=None, status="limb too faint")
    if len(limb.pixels) >= FEW and (limb.status != "ok" or limb.used.mean() < _WHOLE):
        limb = _or_contradicted(limb, image, camera, its_sun, radius)
    missing = [what.status for what in (seen, limb) if what.status != "ok"]
    if not missing:
        missing = _contradiction(limb, its_sun, apart)
    if missing:
        return ImageAttitude(seen, limb, None, None, "no solution: " + ", ".join(missing))
    down = -position / size
    measured = np.array([camera.to_body @ limb.direction, to_sun])
    try:
        first = two_vector(measured, [down, sun], sigma=[max(limb.std, 1e-6), seen.std])
    except Refusal as refusal:  # in line: the turn about both is not determined
        return ImageAttitude(seen, limb, None, None, f"no solution: {refusal.reason}")
    matrix, covariance, haze = _joint(
        first.matrix, limb, camera, to_sun, seen.std, position, sun, semi_axes
    )
    return ImageAttitude(seen, limb, matrix, covariance, "ok", haze)


def _too_near(gap: float, camera: Camera) -> str:
    """Why a Sun that time and position put at a `gap`, rad, from the ground is no direction, or ""."""
    if gap < -SUN_RADIUS:
        return "Sun behind the Earth by time and position"
    if gap < SUN_RADIUS + _NEAR / camera.focal_px:
        return "Sun too near the Earth's edge"
    return ""


def _or_contradicted(limb: Limb, image, camera: Camera, sun, radius: tuple[float, float]) -> Limb:
    """The limb, unless many more edge points lie on one of another size than the position gives."""
    pixel = None if sun is None else camera.project(sun)
    free = fit_limb(find_edges(image, camera, pixel), camera, sun)
    if free.status != "ok" or free.used.sum() < max(_MORE * limb.used.sum(), FEW):
        return limb
    off = abs(free.angular_radius - radius[0])
    if off < 0.1 * radius[0] or off < 6 * np.hypot(np.sqrt(free.covariance[2, 2]), radius[1]):
        return limb
    found, given = np.degrees([free.angular_radius, radius[0]])
    why = f"disc of {found:.1f}° radius, not the Earth's of {given:.1f}° that the position gives"
    return replace(limb, direction=None, angular_radius=None, covariance=None, status=why)


def _contradiction(limb: Limb, to_sun: np.ndarray, apart: float) -> list[str]:
    """What is wrong where Earth and Sun are not as far `apart`, rad, as time and position say; else []."""
    found = float(np.arccos(np.clip(limb.direction @ to_sun, -1, 1)))
    if abs(found - apart) < max(_APART, 6 * limb.std):
        return []
    found, apart = np.degrees([found, apart])
    return [
        f"Earth and Sun are {found:.1f}° apart in the image, {apart:.1f}° by time and position: check both"
    ]


def expected_radius(distance: float, radius: float) -> tuple[float, float]:
    """Angular radius of a limb at the usual height of haze, rad, and how far it may be off.

    Seen from `distance` to the centre of an Earth of mean `radius`, both m.
    """
    sine = min((radius + HAZE) / distance, 1.0)
    return float(np.arcsin(sine)), float(HAZE_STD / distance / np.sqrt(max(1 - sine**2, 1e-6)))


def _joint(matrix, limb, camera, to_sun, sun_std, position, sun, semi_axes):
    """Attitude (3, 3), its covariance (3, 3), and the haze's height with its error, from limb and Sun.

    A short arc of limb leaves the direction to the centre and the radius nearly one; the Sun's known
    distance from the nadir tells them apart. In units of the semi-axes an ellipsoid is a sphere and
    lines stay lines, so that it is no harder than a sphere.
    """
    rays = limb.rays[limb.used] @ camera.to_body.T
    across = limb.across[limb.used] @ camera.to_body.T
    sides, order = across_of(to_sun), around(limb.rays[limb.used], limb.direction)
    height = HAZE

    def misfits(turned, height):
        """Of limb and Sun in standard errors, and the limb's slope per pixel."""
        axes = semi_axes + height
        place = position / axes
        depth = _depth(rays @ turned, place, axes)
        ahead = _depth((rays + 1e-3 * across) @ turned, place, axes)
        slope = (ahead - depth) * 1e3
        return depth / slope / limb.sigma[limb.used], sides @ (turned @ sun - to_sun) / sun_std

    for _ in range(6):
        base = misfits(matrix, height)
        jacobian = []
        for k in range(3):
            moved = misfits(matrix_from_axis_angle(np.eye(3)[k], 1e-6) @ matrix, height)
            jacobian.append([(m - b) / 1e-6 for m, b in zip(moved, base, strict=True)])
        moved = misfits(matrix, height + 10.0)
        jacobian.append([(m - b) / 10.0 for m, b in zip(moved, base, strict=True)])
        weight = weighted(base[0], order)
        on_limb = np.stack([j[0] for j in jacobian], axis=-1)
        on_sun = np.stack([j[1] for j in jacobian], axis=-1)
        normal = on_limb.T @ (weight[:, None] * on_limb) + on_sun.T @ on_sun
        normal[3, 3] += 1 / HAZE_STD**2
        right = -on_limb.T @ (weight * base[0]) - on_sun.T @ base[1]
        right[3] -= (height - HAZE) / HAZE_STD**2
        move = np.linalg.solve(normal, right)
        angle = np.linalg.norm(move[:3])
        if angle > 0:
            matrix = matrix_from_axis_angle(move[:3] / angle, angle) @ matrix
        height += move[3]
        if angle < 1e-9:
            break
    covariance = np.linalg.inv(normal)
    # Thin haze looks like a lens, and puts the edges elsewhere.
    shift = _MISTAKEN * limb.lens * np.median(np.linalg.norm(across, axis=-1))
    covariance[:3, :3] += shift**2 * np.eye(3)
    return matrix, covariance[:3, :3], (float(height), float(np.sqrt(covariance[3, 3])))


def _depth(sight: np.ndarray, place: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """How far below the limb lines of sight (N, 3) pass, in radii."""
    sight = sight / axes
    along = (sight @ place) / (sight**2).sum(axis=-1)
    return 1 - np.linalg.norm(place - along[:, None] * sight, axis=-1)
