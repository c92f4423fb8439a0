"""Where Earth and Sun are in the cameras' views: which attitudes show both, and why one does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sensorbook.attitude.rotations import euler_from_matrix, matrix_from_euler
from sensorbook.camera.attitude import ImageAttitude
from sensorbook.camera.scene import EARTH_RADIUS, SUN_DISTANCE, SUN_RADIUS
from sensorbook.camera.study import LEAST_ARC, LIT

if TYPE_CHECKING:
    from sensorbook.camera.explorer import Settings

SEQUENCE = "ZYX"  # yaw, pitch, roll
_STEP = np.radians(4)  # between the points of the limb that a view is judged by
_TRIALS = 4000
_MARGIN = 40  # pixels that a proposed attitude keeps the Sun from the border
_CLEAR = np.radians(2)  # of the limb, for the Sun to be told from it
_UNTOLD = "not told from the rest of the picture"
_STEEPEST = 60  # degrees, pitch of a proposed attitude: far from where the angles lock


def looking_at_both(settings: Settings, seed: int | None = None) -> tuple | None:
    """Angles (3,), rad, in whole degrees, with the Sun and 20° of lit limb in view; None if none are found.

    Those that show the most of the limb; with a `seed`, random ones instead.
    """
    camera, sun_camera = settings.earth_camera, settings.sun_camera
    limb, lit = _limb(settings)
    if _sun_above_limb(settings) < _CLEAR:
        return None
    rng = np.random.default_rng(0 if seed is None else seed)
    # The Sun anywhere in its camera's view, and the body turned about it.
    last = np.array([sun_camera.width - 1, sun_camera.height - 1])
    pixels = rng.uniform(_MARGIN, last - _MARGIN, (_TRIALS, 2))
    measured = sun_camera.rays(pixels) @ sun_camera.to_body.T
    attitudes = _triads(measured, rng.uniform(0, 2 * np.pi, _TRIALS)) @ _triads(
        settings.sun[None], np.zeros(1)
    ).swapaxes(-1, -2)
    angles = np.round(np.degrees(euler_from_matrix(SEQUENCE, attitudes)))
    attitudes = matrix_from_euler(SEQUENCE, np.radians(angles))
    seen = camera.sees(limb @ (camera.to_body.T @ attitudes).swapaxes(-1, -2))
    bright = (seen & lit).sum(axis=-1)
    good = (bright * np.degrees(_STEP) > LEAST_ARC) & (np.abs(angles[:, 1]) <= _STEEPEST)
    good &= sun_camera.sees(attitudes @ settings.sun @ sun_camera.to_body, _MARGIN / 2)
    if not good.any():
        return None
    best = np.argmax(good * (1 + bright + seen.sum(axis=-1))) if seed is None else np.argmax(good)
    return tuple(map(float, np.radians(angles[best])))


def _limb(settings: Settings, step: float = _STEP) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3), inertial, around the limb every `step`, rad, and whether (N,) it is lit there."""
    distance = np.linalg.norm(settings.position)
    down, size = -settings.position / distance, np.arcsin(EARTH_RADIUS / distance)
    around = np.arange(0, 2 * np.pi - step / 2, step)
    ring = np.zeros((len(around), 3))
    ring[:, 0], ring[:, 1] = np.sin(size) * np.cos(around), np.sin(size) * np.sin(around)
    ring[:, 2] = np.cos(size)
    frame = _triads(down[None], np.zeros(1))[0]  # its columns: down, and two across it
    limb = ring @ frame[:, [1, 2, 0]].T
    ground = (np.cos(size) * limb - down) / np.sin(size)
    # An evenly bright Earth is so at night, too, but edges that face away from the Sun are not trusted.
    return limb, ground @ settings.sun > (0 if settings.look == "full" else LIT)


def _triads(first: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) whose first columns are unit vectors (N, 3), the others turned about them."""
    least = np.eye(3)[np.argmin(np.abs(first), axis=-1)]
    side = np.cross(first, least)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(first, side)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return np.stack([first, cosine * side + sine * up, cosine * up - sine * side], axis=-1)


def _sun_above_limb(settings: Settings) -> float:
    """Angle, rad, of the Sun's centre above the Earth's limb, negative behind it."""
    distance = np.linalg.norm(settings.position)
    from_nadir = np.arccos(np.clip(-settings.position @ settings.sun / distance, -1, 1))
    return float(from_nadir - np.arcsin(EARTH_RADIUS / distance))


def why_none(settings: Settings, found: ImageAttitude) -> str:
    """Why there is no attitude, in the geometry's words where it tells, and what to do."""
    said = []
    if found.sun.status != "ok":
        said.append(_no_sun(settings))
    if found.limb.status != "ok":
        said.append(_no_limb(settings))
    if not said:  # both are found, and contradict each other or are in line
        reason = found.status.removeprefix("no solution: ")
        said.append(f"{reason[:1].upper()}{reason[1:].rstrip('.')}.")
    untold = all(_UNTOLD in one for one in said)
    said.append("Lower the noise, or turn the satellite." if untold else _what_to_do(settings))
    return " ".join(said)


def _what_to_do(settings: Settings) -> str:
    if looking_at_both(settings) is not None:
        return "Turn the satellite: other attitudes show both from here."
    above = np.degrees(_sun_above_limb(settings))
    if above < np.degrees(_CLEAR):
        reason = "the Sun is behind the Earth or at its limb"
    elif _limb(settings)[1].sum() * np.degrees(_STEP) < LEAST_ARC:
        reason = f"the Sun is {above:.0f}° above the limb and lights but a thin crescent"
    else:
        reason = f"the Sun is {above:.0f}° from the limb, more than the cameras' views span"
    return f"Move the satellite along its orbit: no attitude shows both from here, as {reason}."


def _no_sun(settings: Settings) -> str:
    above, size = _sun_above_limb(settings), np.arctan(SUN_RADIUS / SUN_DISTANCE)
    camera = settings.sun_camera
    seen = camera.to_body.T @ settings.attitude @ settings.sun
    name = "camera" if settings.cameras == 1 else "Sun camera"
    if above < -size:
        return "The Earth hides the Sun: the satellite is in its shadow."
    if not camera.sees(seen):
        angle = np.degrees(np.arccos(np.clip(seen[2], -1, 1)))
        return f"The Sun is out of the {name}'s view, {angle:.0f}° from its axis."
    if above < size:
        return "The Earth hides a part of the Sun."
    if not camera.sees(seen, 3):
        return f"The border of the {name}'s view cuts the Sun."
    near = ", so near to the limb" if above < _CLEAR else ""
    return f"The Sun is in the {name}'s view, but {_UNTOLD}{near}."


def _no_limb(settings: Settings) -> str:
    camera = settings.earth_camera
    limb, lit = _limb(settings, np.radians(1))
    to_camera = camera.to_body.T @ settings.attitude
    seen = camera.sees(limb @ to_camera.T)
    arc, bright = int(seen.sum()), int((seen & lit).sum())
    name = "camera" if settings.cameras == 1 else "Earth camera"
    if not arc:
        distance = np.linalg.norm(settings.position)
        if to_camera[2] @ -settings.position > np.sqrt(distance**2 - EARTH_RADIUS**2):
            return f"The ground fills the {name}'s view: no part of the limb is in it."
        return f"No part of the Earth is in the {name}'s view."
    side = "the side away from the Sun" if settings.look == "full" else "its night side"
    if not bright:
        return f"Of the limb only {side} is in the {name}'s view."
    if bright < LEAST_ARC:
        night = f" The rest of what is in view is at {side}." if bright < arc else ""
        return (
            f"Only {bright}° of the lit limb around the Earth are in the {name}'s view, too little "
            f"to tell it by.{night}"
        )
    return f"{bright}° of lit limb are in the {name}'s view, but {_UNTOLD}."
