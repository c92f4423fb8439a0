"""Renders what a camera in orbit sees of the Earth and the Sun, by casting a ray through every pixel.

Independent of everything that reads images: no formula of the limb is used, only where rays meet the
ellipsoid, how the ground there is lit, and which part of a pixel is covered.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from sensorbook.camera.model import Camera, finite
from sensorbook.earth import EQUATOR_RADIUS, POLE_RADIUS

EARTH_RADIUS = 6371e3  # m, C's sphere (table 4.1)
WGS84 = (EQUATOR_RADIUS, EQUATOR_RADIUS, POLE_RADIUS)  # m, semi-axes
SUN_RADIUS = 695.7e6  # m (table 4.1)
SUN_DISTANCE = 149.6e9  # m (table 4.1)
HEIGHTS = {"leo": 2000e3, "meo": 20_000e3, "geo": 35_786e3}  # m (table 4.1)
GROUND, SUN = 200.0, 255.0  # DN: of fully lit ground, and of the Sun, which saturates

# Table 4.3: the Earth's camera of the two-camera design, printed to four digits.
EARTH_CAMERA = np.array(
    [[0.5001, 0, -0.8660], [-0.2560, 0.9553, -0.1478], [0.8273, 0.2956, 0.4777]]
)

_UNIT = 1e-6  # the Sun's disc ends where a cosine is 1e-5 below 1
_REACH = 8  # standard deviations of the blur: a Sun of 1e7 DN is below one from 6 on
_PARTS = 6  # samples across a pixel, where it is cut by an edge


@dataclass(frozen=True, eq=False)
class Scene:
    """Where satellite and Sun are, and what the Earth looks like.

    Parameters
    ----------
    position : (3,), m, of the satellite from the Earth's centre, inertial
    sun : (3,), unit vector from the satellite to the Sun, inertial
    semi_axes : (3,), m, of the Earth along the inertial axes
    lit : "full" for even brightness, "lambert" for ground lit by the Sun
    haze : m, height over which the air's brightness falls by e; 0 for no air
    texture : (rows, columns) brightness 0 to 1 by latitude (north first) and longitude, or None
    noise : DN, standard deviation of a pixel
    blur : pixels, standard deviation of the optics' point spread, a Gaussian; 0 for none
    sun_level : DN, the Sun's brightness before the image saturates; the real one is 1e5 times the ground's
    """

    position: np.ndarray
    sun: np.ndarray
    semi_axes: tuple[float, float, float] = field(default=(EARTH_RADIUS,) * 3)
    lit: str = "full"
    haze: float = 0.0
    texture: np.ndarray | None = None
    noise: float = 2.0
    blur: float = 0.0
    sun_level: float = SUN

    def __post_init__(self) -> None:
        if self.lit not in ("full", "lambert"):
            raise ValueError(f'lit is {self.lit!r}: give "full" or "lambert"')
        for name, unit in (("position", "x, y and z in metres"), ("sun", "a unit vector")):
            if not finite(getattr(self, name), (3,)):
                raise ValueError(f"{name} is {getattr(self, name)}: give {unit}")
        length = np.linalg.norm(self.sun)
        if not abs(length - 1) < _UNIT:
            raise ValueError(f"sun is no unit vector, its length {length:.4g}: divide by it")
        if not finite(self.semi_axes, (3,)) or not np.min(self.semi_axes) > 0:
            raise ValueError(
                f"semi_axes are {self.semi_axes}: give three lengths in metres, above 0"
            )
        if not np.linalg.norm(np.asarray(self.position) / np.asarray(self.semi_axes)) > 1:
            raise ValueError("position is inside the Earth: give metres from its centre")
        for name, unit in (
            ("haze", "metres"),
            ("noise", "DN"),
            ("blur", "pixels"),
            ("sun_level", "DN"),
        ):
            value = getattr(self, name)
            if not finite(value, ()) or value < 0:
                raise ValueError(f"{name} is {value}: give {unit}, 0 or more")
        painting = self.texture
        if painting is not None and (
            np.ndim(painting) != 2
            or not finite(painting, np.shape(painting))
            or not np.size(painting)
            or not (np.min(painting) >= 0 and np.max(painting) <= 1)
        ):
            raise ValueError(
                f"texture of shape {np.shape(painting)}: give rows and columns of brightness, 0 to 1"
            )


def render(
    camera: Camera, scene: Scene, attitude: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """The image (height, width), uint8, of a camera on a body with `attitude` (3, 3), body from inertial.

    Pixels that the camera has no direction for are dark.
    """
    turn = np.asarray(attitude)
    if (
        not finite(turn, (3, 3))
        or not np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=_UNIT)
        or np.linalg.det(turn) < 0
    ):
        raise ValueError(
            "attitude is no rotation: give 3 × 3 numbers, its rows right-handed unit vectors at right angles"
        )
    to_inertial = turn.T @ camera.to_body
    # With a blur, what lies beside the image spreads light into it.
    pad = int(np.ceil(_REACH * scene.blur))
    if pad:
        camera = replace(
            camera,
            width=camera.width + 2 * pad,
            height=camera.height + 2 * pad,
            principal_point=tuple(camera.centre + pad),
        )
    rays = camera.grid @ to_inertial.T
    bright, edge = _brightness(scene, rays, 1.5 / camera.focal_px)
    rows, columns = np.nonzero(edge)
    if len(rows):
        step = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
        x, y = np.meshgrid(step, step)
        parts = np.stack([columns, rows], axis=-1)[:, None] + np.stack([x, y], axis=-1).reshape(
            -1, 2
        )
        inside, _ = _brightness(scene, camera.rays(parts) @ to_inertial.T, 0.0)
        bright[rows, columns] = inside.mean(axis=-1)
    if pad:
        bright = gaussian_filter(bright, scene.blur, truncate=_REACH)[pad:-pad, pad:-pad]
    noisy = bright + scene.noise * rng.normal(size=bright.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def texture(seed: int, rows: int = 512) -> np.ndarray:
    """A made-up Earth (rows, 2·rows): dark seas, brighter land, white clouds, 0.15 to 1."""
    rng = np.random.default_rng(seed)

    latitude = np.pi * ((np.arange(rows) + 0.5) / rows - 0.5)
    frequency = np.fft.rfftfreq(2 * rows)

    def noise(sizes):
        made = 0.0
        for size in sizes:  # rows; along a parallel as many degrees of arc, not of longitude
            width = size / np.cos(latitude)[:, None]
            gain = np.exp(-0.5 * (2 * np.pi * frequency * width) ** 2)
            gain /= np.sqrt((gain**2).mean(axis=1, keepdims=True))
            white = np.fft.rfft(rng.normal(size=(rows, 2 * rows)), axis=1)
            along = np.fft.irfft(white * gain, axis=1)
            made = made + size * _even(gaussian_filter1d(along, size, axis=0, mode="nearest"))
        return _even(made)

    land, cloud = noise((24, 12, 6)), noise((16, 8, 4, 2))
    ground = np.where(land > 0.3, 0.35 + 0.08 * noise((3,)), 0.2)
    cover = np.clip(0.8 * (cloud - 0.2), 0, 1)
    return np.clip(ground * (1 - cover) + 0.95 * cover, 0.15, 1)


def _even(field_: np.ndarray) -> np.ndarray:
    return (field_ - field_.mean()) / field_.std()


def _brightness(scene: Scene, rays: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """DN along rays (…, 3), and which are within `near`, rad, of an edge."""
    axes = np.asarray(scene.semi_axes)
    distance = np.linalg.norm(scene.position)
    bright, edge = np.zeros(rays.shape[:-1]), np.zeros(rays.shape[:-1], dtype=bool)
    # Nearly all of most pictures is empty: only what may be of Earth or Sun is looked at closely.
    top = axes.max() + 20 * scene.haze
    reach = np.arcsin(min(top / distance, 1.0)) + 4 * near + 1e-3
    size = np.arctan(SUN_RADIUS / SUN_DISTANCE)
    sun = np.asarray(scene.sun)
    toward = rays @ np.stack([-np.asarray(scene.position) / distance, sun], axis=-1)
    earth = toward[..., 0] > (np.cos(reach) if reach < np.pi else -2)
    bright[earth], edge[earth], hit = _ground(scene, axes, rays[earth], near)
    shining = toward[..., 1] > np.cos(size + near + 1e-3)
    from_sun = np.arccos(np.clip(toward[shining][..., 1], -1, 1))
    hidden = np.zeros(earth.shape, dtype=bool)
    hidden[earth] = hit
    bright[shining] = np.where(
        (from_sun < size) & ~hidden[shining], scene.sun_level, bright[shining]
    )
    edge[shining] |= np.abs(from_sun - size) < near
    return bright, edge


def _ground(scene: Scene, axes: np.ndarray, rays: np.ndarray, near: float):
    """DN along rays (N, 3) at or near the Earth, which are within `near` of its limb, and which hit it."""
    place, sight = np.asarray(scene.position) / axes, rays / axes
    a = (sight**2).sum(axis=-1)
    b = sight @ place
    closest = np.maximum(-b, 0.0) / a  # the ray's parameter, m, where it is nearest to the centre
    passing = place + closest[..., None] * sight
    depth = 1 - np.sqrt((passing**2).sum(axis=-1))  # below the limb, in radii
    hit = (depth > 0) & (b < 0)
    reach = np.sqrt(np.maximum((1 - (1 - depth) ** 2) / a, 0.0))
    point = np.where(hit[..., None], passing - reach[..., None] * sight, passing)
    bright = np.where(hit, GROUND, 0.0)
    if scene.haze:
        above = np.maximum(-depth, 0.0) * axes.mean()
        bright = np.where(b < 0, GROUND * np.exp(-above / scene.haze), bright)
    if scene.lit == "lambert":
        normal = point / axes
        normal /= np.sqrt((normal**2).sum(axis=-1, keepdims=True))
        bright *= np.maximum(normal @ np.asarray(scene.sun), 0.0)
    if scene.texture is not None:
        bright *= _painted(scene.texture, point)
    distance = np.maximum(closest, 1.0) * np.sqrt((rays**2).sum(axis=-1)) / axes.mean()
    return bright, (np.abs(depth) < near * distance) & (b < 0), hit


def _painted(painting: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Brightness of the ground below points (N, 3) in units of the semi-axes, between the map's cells."""
    rows, columns = painting.shape
    latitude = np.arctan2(point[:, 2], np.hypot(point[:, 0], point[:, 1]))
    longitude = np.arctan2(point[:, 1], point[:, 0])
    row = np.clip((0.5 - latitude / np.pi) * rows - 0.5, 0, rows - 1)
    column = (longitude / (2 * np.pi) + 0.5) * columns - 0.5
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = row - top, column - left
    below, left, beside = np.minimum(top + 1, rows - 1), left % columns, (left + 1) % columns
    return (1 - down) * (
        (1 - right) * painting[top, left] + right * painting[top, beside]
    ) + down * ((1 - right) * painting[below, left] + right * painting[below, beside])
