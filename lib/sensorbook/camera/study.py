"""Random places, Suns and attitudes with both bodies in view, and what the ways make of them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS

LIT = 0.15  # least cosine of the Sun's angle on limb that counts as lit
LEAST_ARC = 20  # degrees of lit limb in view


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
    down, size = -position / distance, np.arcsin(EARTH_RADIUS / distance)
    side = np.cross(down, [1, 0, 0.3])
    side /= np.linalg.norm(side)
    around = np.linspace(0, 2 * np.pi, 360, endpoint=False)[:, None]
    across = np.cos(around) * side + np.sin(around) * np.cross(down, side)
    limb = np.cos(size) * down + np.sin(size) * across
    ground = (np.cos(size) * limb - down) / np.sin(size)  # its normals there
    return int((camera.sees(limb @ to_camera.T) & (ground @ sun > LIT)).sum())
