"""Random places, Suns and attitudes with both bodies in view, and what the ways make of them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude import triad
from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.attitude import ImageAttitude, attitude_from_image
from sensorbook.camera.baseline import Baseline, baseline
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS, WGS84, Scene, render, texture

CAMERA = Camera(1280, 720, 369.5)  # C, table 4.2
# C, table 4.4: mean errors of its three angles, degrees.
PRINTED = {
    "leo": (11.5631, 9.1812, 14.1154),
    "meo": (0.5864, 0.5391, 0.5488),
    "geo": (0.3273, 0.4404, 0.4317),
}
LIT = 0.15  # least cosine of the Sun's angle on limb that counts as lit
LEAST_ARC = 20  # degrees of lit limb in view


def looks() -> dict[str, dict]:
    """How the Earth may look: keyword arguments of `Scene` by name."""
    return {
        "full": {},
        "lambert": {"lit": "lambert"},
        "textured": {"lit": "lambert", "texture": texture(3)},
        "oblate, 20 km of haze": {"lit": "lambert", "semi_axes": WGS84, "haze": 20e3},
    }


@dataclass(frozen=True, eq=False)
class Trial:
    """One random image and what the two ways made of it.

    Attributes
    ----------
    off_axis : rad, between the camera's axis and the Earth's centre
    to_earth, to_sun : (3,), true directions to the Earth's centre and the Sun, in camera axes
    radius : rad, the Earth's angular radius
    lit_arc : rad, how much lit limb is in view, around the Earth
    whole : whether the Earth's whole disc is in the picture
    centred, larger : whether its centre is, and whether the disc is larger than the picture is high
    found : by this house's way; `error` (3,) its error vector, rad, and `squared` that over its covariance
    seconds : from the image to that
    chain : by C's; `chain_error` (3,), rad; both None where it was not asked, the error also where there is
        no solution
    """

    off_axis: float
    to_earth: np.ndarray
    to_sun: np.ndarray
    radius: float
    lit_arc: float
    whole: bool
    centred: bool
    larger: bool
    found: ImageAttitude
    error: np.ndarray | None
    squared: float | None
    seconds: float
    chain: Baseline | None
    chain_error: np.ndarray | None

    @property
    def as_chosen(self) -> bool:
        """Whether somebody who looks for a good picture would take it: C's attitudes are not printed.

        The Earth's whole disc is in it, or at least its centre where the disc is larger than the picture.
        """
        return _is_chosen(self.whole, self.centred, self.larger)


def trials(
    orbit: str,
    look: Mapping,
    count: int,
    rng: np.random.Generator,
    chain: bool = False,
    chosen: bool = False,
) -> Iterator[Trial]:
    """Random images of C's camera at one of its orbits, and what was found in them.

    By work C's chain, too, with `chain`; `chosen` leaves out what is not `as_chosen`.
    """
    for _ in range(count):
        position, sun, attitude = draw(rng, HEIGHTS[orbit], CAMERA)
        while chosen and not _is_chosen(*_in_view(position, attitude)):
            position, sun, attitude = draw(rng, HEIGHTS[orbit], CAMERA)
        image = render(CAMERA, Scene(position, sun, **look), attitude, rng)
        yield _trial(image, position, sun, attitude, look, chain)


def _trial(image, position, sun, attitude, look, chain: bool) -> Trial:
    began = time.perf_counter()
    found = attitude_from_image(
        image, CAMERA, position, sun, look.get("semi_axes", (EARTH_RADIUS,) * 3)
    )
    seconds = time.perf_counter() - began
    error = squared = by_chain = chain_error = None
    if found.matrix is not None:
        error = error_vector(found.matrix, attitude)
        squared = float(error @ np.linalg.solve(found.covariance, error))
    down = -position / np.linalg.norm(position)
    if chain:
        by_chain = baseline(image, CAMERA)
        if by_chain.status == "ok":
            measured = [by_chain.sun_direction, by_chain.earth_direction]
            chain_error = error_vector(triad(measured, [sun, down]).matrix, attitude)
    to_earth = attitude @ down
    return Trial(
        float(np.arccos(np.clip(to_earth[2], -1, 1))),
        to_earth,
        attitude @ sun,
        float(np.arcsin(EARTH_RADIUS / np.linalg.norm(position))),
        float(np.radians(lit_limb_in_view(position, sun, attitude, CAMERA))),
        *_in_view(position, attitude),
        found,
        error,
        squared,
        seconds,
        by_chain,
        chain_error,
    )


def _in_view(position: np.ndarray, attitude: np.ndarray) -> tuple[bool, bool, bool]:
    """Whether the disc is whole in the picture, its centre is, and it is larger than that is high."""
    distance = np.linalg.norm(position)
    return (
        bool(CAMERA.sees(_around(position, 90) @ attitude.T).all()),
        bool(CAMERA.sees(attitude @ -position)),
        bool(EARTH_RADIUS / distance > np.sin(np.arctan(CAMERA.height / 2 / CAMERA.focal_px))),
    )


def _is_chosen(whole: bool, centred: bool, larger: bool) -> bool:
    return whole or (centred and larger)


def draw(
    rng: np.random.Generator, height: float, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A place (3,), m, the Sun's direction (3,), inertial, and an attitude (3, 3) that sees both."""
    while True:
        down, sun = rng.normal(size=(2, 3))
        down, sun = down / np.linalg.norm(down), sun / np.linalg.norm(sun)
        attitude = Rotation.random(rng=rng).as_matrix()
        position = -down * (EARTH_RADIUS + height)
        if both_in_view(position, sun, camera.to_body.T @ attitude, camera):
            return position, sun, attitude


def both_in_view(
    position: np.ndarray, sun: np.ndarray, to_camera: np.ndarray, camera: Camera
) -> bool:
    """Whether the Sun, clear of the Earth, and 20° of lit limb are in a camera's view.

    `to_camera` (3, 3) turns inertial directions into camera axes.
    """
    distance = np.linalg.norm(position)
    down, size = -position / distance, np.arcsin(EARTH_RADIUS / distance)
    if np.arccos(np.clip(down @ sun, -1, 1)) < size + np.radians(2):
        return False
    if not camera.sees(to_camera @ sun, 5):
        return False
    return lit_limb_in_view(position, sun, to_camera, camera) >= LEAST_ARC


def lit_limb_in_view(
    position: np.ndarray, sun: np.ndarray, to_camera: np.ndarray, camera: Camera
) -> int:
    """Degrees of the limb around the Earth that are lit and in view."""
    distance = np.linalg.norm(position)
    down, sine = -position / distance, EARTH_RADIUS / distance
    limb = _around(position, 360)
    ground = (np.sqrt(1 - sine**2) * limb - down) / sine  # its normals there
    return int((camera.sees(limb @ to_camera.T) & (ground @ sun > LIT)).sum())


def _around(position: np.ndarray, count: int) -> np.ndarray:
    """Directions (count, 3) to the limb of the sphere, inertial."""
    distance = np.linalg.norm(position)
    down, size = -position / distance, np.arcsin(EARTH_RADIUS / distance)
    side = np.cross(down, [1, 0, 0.3])
    side /= np.linalg.norm(side)
    around = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    across = np.cos(around) * side + np.sin(around) * np.cross(down, side)
    return np.cos(size) * down + np.sin(size) * across
