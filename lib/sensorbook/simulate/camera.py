"""Presets `leo`, `meo` and `geo`: cameras that see the Earth and the Sun from work C's three orbits.

One camera for both bodies, and a pair of which one looks for the Earth and one for the Sun (C, tables
4.1 to 4.3). The images are cast by rays from known places, times and attitudes.
"""

from __future__ import annotations

from itertools import islice

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.frames import circular_orbit
from sensorbook.attitude.rotations import quaternion_from_matrix
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_CAMERA, EARTH_RADIUS, HEIGHTS, Scene, render, texture
from sensorbook.camera.study import lit_limb_in_view
from sensorbook.earth import EQUATOR_RADIUS, GRAVITATION, sun_direction
from sensorbook.simulate.folder import SimulatedDevice

START = np.datetime64("2024-06-21T12:00:00")  # UTC; the Sun is 23.4° north
# Inclination and right ascension of the ascending node, deg: a LEO above the boundary of day and night
# most of the time, a navigation satellite's MEO, and GEO above the equator.
PLANES = {"leo": (82.0, 150.0), "meo": (55.0, 120.0), "geo": (0.0, 0.0)}
# rad from the limb to the Sun: enough of the limb is lit, and one camera has both in view.
NEAREST, FARTHEST = np.radians(30), np.radians(95)
NOISE = 2.0  # DN
ALONE, PAIRS = 8, 5  # frames, of which the last lack something: two and one
ARC = 60  # degrees of lit limb in view, at least: more than a sliver at the image's edge
CLEAR = np.radians(1)  # from the image to the limb where the Earth is out of view

_left, _, _right = np.linalg.svd(EARTH_CAMERA)
CAMERAS = {  # C, table 4.2, by folder of images; the printed mounting made orthonormal
    "one": Camera(1280, 720, 369.5),
    "earth": Camera(1280, 720, 369.5, to_body=_left @ _right),
    "sun": Camera(1280, 720, 369.5),
}
SEES = {"one": "both", "earth": "earth", "sun": "sun"}

_DEVICE = """\
schema = 1
id = "{id}"
name = "Earth and Sun cameras at {height:.0f} km, simulated"
"""
_RECORDING = """
[[recording]]
sensor = "camera"
kind = "images"
file = "{name}/*.png"
poses = "poses.csv"              # image, time (UTC), x y z (ECI, m), qx qy qz qw (inertial to body)

[recording.camera]
width = {camera.width}
height = {camera.height}
focal_px = {camera.focal_px}
principal_point = {principal_point}
sees = "{sees}"
earth_radius = {radius}         # m, a sphere
to_body = {to_body}
"""


def places(orbit: str, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (count,), UTC, positions (count, 3), m, and the Sun's directions (count, 3), inertial.

    Evenly among those of one revolution from `START` on where one camera can see both bodies.
    """
    distance = EARTH_RADIUS + HEIGHTS[orbit]
    period = 2 * np.pi * np.sqrt(distance**3 / GRAVITATION)
    seconds = np.linspace(0, period, 1000, endpoint=False).astype(int)
    inclination, node = np.radians(PLANES[orbit])
    position, _ = circular_orbit(
        distance - EQUATOR_RADIUS, inclination, node, 2 * np.pi * seconds / period
    )
    times = START + seconds.astype("timedelta64[s]")
    sun = sun_direction(times, position)
    from_limb = np.arccos(-(position * sun).sum(axis=-1) / distance) - np.arcsin(
        EARTH_RADIUS / distance
    )
    (fit,) = np.nonzero((from_limb > NEAREST) & (from_limb < FARTHEST))
    chosen = fit[((np.arange(count) + 0.5) / count * len(fit)).astype(int)]
    # As poses.csv has them, to the millimetre.
    return times[chosen], position[chosen].round(3) + 0.0, sun[chosen]


def draw_attitude(
    rng: np.random.Generator,
    kind: str,
    looks_down: Camera,
    looks_up: Camera,
    position: np.ndarray,
    sun: np.ndarray,
) -> np.ndarray:
    """A random attitude (3, 3), body from inertial, of those with "both" bodies in view, the Earth of
    one camera and the Sun of the other or the same, or with "no sun" or "no earth"."""
    while True:
        attitude = Rotation.random(rng=rng).as_matrix()
        to_sun = looks_up.to_body.T @ attitude @ sun
        # Of its disc, some 5 pixels across in the corners, all or nothing.
        if looks_up.sees(to_sun, -10 if kind == "no sun" else 5) == (kind == "no sun"):
            continue
        to_camera = looks_down.to_body.T @ attitude
        if kind == "no earth":
            fits = _no_earth(position, to_camera, looks_down)
        else:
            fits = lit_limb_in_view(position, sun, to_camera, looks_down) >= ARC
        if fits:
            return attitude


def _no_earth(position: np.ndarray, to_camera: np.ndarray, camera: Camera) -> bool:
    """Nothing of the ground is in view, lit or not."""
    distance = np.linalg.norm(position)
    down, size = to_camera @ -position / distance, np.arcsin(EARTH_RADIUS / distance)
    return (camera.grid @ down).max() < np.cos(size + CLEAR)


def truth_of(position, sun, attitude, camera) -> dict:
    """What a camera truly has before it, in its own axes."""
    distance = np.linalg.norm(position)
    to_camera = camera.to_body.T @ attitude
    return {
        "quaternion": quaternion_from_matrix(attitude).tolist(),
        "earth_direction": (to_camera @ -position / distance).tolist(),
        "earth_angular_radius_deg": float(np.degrees(np.arcsin(EARTH_RADIUS / distance))),
        "earth_in_view": lit_limb_in_view(position, sun, to_camera, camera) > 0,
        "sun_direction": (to_camera @ sun).tolist(),
        "sun_in_view": bool(camera.sees(to_camera @ sun)),
    }


def frames(
    rng: np.random.Generator, orbit: str, alone: int = ALONE, pairs: int = PAIRS
) -> tuple[dict[str, np.ndarray], dict[str, list], dict[str, dict]]:
    """Images by name, their poses by column, and the truth by image.

    Of the one camera's frames the last two have no Sun and no Earth in view, of the pairs the last no
    Sun; where fewer are asked for, the first are made.
    """
    painted = texture(int(rng.integers(2**31)))
    shots = [
        (("one",), alone, ["both"] * (ALONE - 2) + ["no sun", "no earth"]),
        (("earth", "sun"), pairs, ["both"] * (PAIRS - 1) + ["no sun"]),
    ]
    images, truth = {}, {}
    poses = {name: [] for name in ("image", "time", "x", "y", "z", "qx", "qy", "qz", "qw")}
    for folders, wanted, kinds in shots:
        looks_down, looks_up = CAMERAS[folders[0]], CAMERAS[folders[-1]]
        whole = zip(kinds, *places(orbit, len(kinds)), strict=True)
        for number, (kind, time, position, sun) in enumerate(islice(whole, wanted), start=1):
            attitude = draw_attitude(rng, kind, looks_down, looks_up, position, sun)
            scene = Scene(position, sun, lit="lambert", texture=painted, noise=NOISE)
            for folder in folders:
                name = f"{folder}/{number:04d}.png"
                images[name] = render(CAMERAS[folder], scene, attitude, rng)
                truth[name] = truth_of(position, sun, attitude, CAMERAS[folder])
                row = [name, str(time), *position, *truth[name]["quaternion"]]
                for column, value in zip(poses.values(), row, strict=True):
                    column.append(value)
    return images, poses, truth


def build(rng: np.random.Generator, identifier: str, orbit: str) -> SimulatedDevice:
    """Draws the attitudes and renders what the cameras see from an orbit."""
    images, poses, truth = frames(rng, orbit)
    toml = _DEVICE.format(id=identifier, height=HEIGHTS[orbit] / 1e3)
    for name, camera in CAMERAS.items():
        toml += _RECORDING.format(
            name=name,
            camera=camera,
            principal_point=camera.centre.tolist(),
            sees=SEES[name],
            radius=EARTH_RADIUS,
            to_body=camera.to_body.tolist(),
        )
    return SimulatedDevice(toml, images | {"poses.csv": poses}, {"images": truth})
