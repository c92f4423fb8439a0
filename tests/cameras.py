"""Small camera devices with known truth: images of 640 × 360 from low orbit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import quaternion_from_matrix
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_CAMERA, EARTH_RADIUS, Scene, render
from sensorbook.camera.study import both_in_view, lit_limb_in_view
from sensorbook.earth import sun_direction

_left, _, _right = np.linalg.svd(EARTH_CAMERA)
ONE = Camera(640, 360, 184.75)
EARTH = Camera(640, 360, 184.75, to_body=_left @ _right)
SUN = ONE
DISTANCE = EARTH_RADIUS + 2e6

_RECORDING = """
[[recording]]
sensor = "camera"
kind = "images"
file = "{pattern}"
{poses}[recording.camera]
width = {camera.width}
height = {camera.height}
focal_px = {camera.focal_px}
sees = "{sees}"
earth_radius = {radius}
to_body = {to_body}
"""


@dataclass(frozen=True, eq=False)
class Shot:
    """A moment: where the satellite was, its attitude, and how to take an image of it."""

    time: str
    position: np.ndarray
    sun: np.ndarray
    attitude: np.ndarray

    def image(self, camera: Camera = ONE, seed: int = 0) -> np.ndarray:
        """(height, width), uint8."""
        scene = Scene(self.position, self.sun, lit="lambert", noise=2.0)
        return render(camera, scene, self.attitude, np.random.default_rng(seed))

    def row(self, name: str, known: Iterable[str] = ("time", "place", "truth")) -> dict:
        """Its row of poses.csv, with what is known."""
        row = {"image": name}
        if "time" in known:
            row["time"] = self.time
        if "place" in known:
            row |= dict(zip("xyz", self.position, strict=True))
        if "truth" in known:
            quaternion = quaternion_from_matrix(self.attitude)
            row |= dict(zip(("qx", "qy", "qz", "qw"), quaternion, strict=True))
        return row

    def down(self, camera: Camera) -> np.ndarray:
        """The true direction to the Earth's centre in a camera's axes."""
        return camera.to_body.T @ self.attitude @ (-self.position / np.linalg.norm(self.position))


def shot(seed: int, fits=None) -> Shot:
    """A random one of those that fit(position, sun, attitude): the one camera sees both bodies."""
    rng = np.random.default_rng(seed)
    time = f"2026-03-{1 + seed % 28:02d}T00:00:00Z"
    fits = fits or (lambda position, sun, attitude: both_in_view(position, sun, attitude, ONE))
    while True:
        place = rng.normal(size=3)
        position = DISTANCE * place / np.linalg.norm(place)
        sun = sun_direction(time.removesuffix("Z"), position)
        for _ in range(50):  # few places have an attitude that fits
            attitude = Rotation.random(rng=rng).as_matrix()
            if fits(position, sun, attitude):
                return Shot(time, position, sun, attitude)


def pair(seed: int) -> Shot:
    """One at which the Earth's camera sees lit limb and the Sun's camera the Sun."""

    def fits(position, sun, attitude):
        down = EARTH.to_body.T @ attitude
        return (
            bool(SUN.sees(attitude @ sun, 5)) and lit_limb_in_view(position, sun, down, EARTH) >= 40
        )

    return shot(seed, fits)


def recording(pattern: str, camera: Camera = ONE, sees: str = "both", poses: bool = True) -> str:
    """A `[[recording]]` of device.toml."""
    return _RECORDING.format(
        pattern=pattern,
        camera=camera,
        sees=sees,
        radius=EARTH_RADIUS,
        to_body=camera.to_body.tolist(),
        poses='poses = "poses.csv"\n' if poses else "",
    )


def write(
    folder: Path,
    recordings: Iterable[str],
    images: Mapping[str, np.ndarray | bytes],
    poses: Iterable[Mapping] = (),
) -> Path:
    """A device folder; images are arrays, or bytes as they are."""
    folder.mkdir(parents=True)
    for name, image in images.items():
        (folder / name).parent.mkdir(exist_ok=True)
        if isinstance(image, bytes):
            (folder / name).write_bytes(image)
        else:
            (folder / name).write_bytes(cv2.imencode(Path(name).suffix, image)[1].tobytes())
    poses = list(poses)
    if poses:
        columns = list(dict.fromkeys(column for row in poses for column in row))
        lines = [",".join(columns)]
        lines += [",".join(str(row.get(column, "")) for column in columns) for row in poses]
        (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    head = f'schema = 1\nid = "{folder.name}"\nname = "{folder.name}"\n'
    (folder / "device.toml").write_text(head + "".join(recordings))
    return folder


def png(image: np.ndarray) -> bytes:
    """An image as a file's bytes."""
    return cv2.imencode(".png", image)[1].tobytes()
