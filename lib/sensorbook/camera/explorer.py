"""Work C's simulator (4.4, fig. 4.14) as a function: orbit, place, angles and cameras in, what follows out.

The images are rendered with the attitude as set; work C's chain and the limb and the Sun together find
it again, and both are compared with what was set.
"""

from __future__ import annotations

import html
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd

from sensorbook import earth
from sensorbook.attitude import triad
from sensorbook.attitude.frames import circular_orbit
from sensorbook.attitude.rotations import (
    error_vector,
    euler_from_matrix,
    lock_margin,
    matrix_from_euler,
)
from sensorbook.camera.attitude import ImageAttitude, attitude_from_image
from sensorbook.camera.baseline import Baseline, baseline
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import (
    EARTH_CAMERA,
    EARTH_RADIUS,
    HEIGHTS,
    SUN_DISTANCE,
    Scene,
    render,
    texture,
)
from sensorbook.camera.steps import centre_bias
from sensorbook.camera.visibility import SEQUENCE, why_none
from sensorbook.errors import Refusal

LOOKS = ("full", "lambert", "textured")
CAMERAS = (1, 2)
SUN = np.array([0.5231, -0.5232, -0.6727])  # from the Earth, in C's frame (table 4.5)
SUN /= np.linalg.norm(SUN)
WRONG_SUN = np.radians(2)  # from the Sun, beyond which no centre of its disc can lie


@dataclass(frozen=True)
class Settings:
    """What is set.

    Parameters
    ----------
    orbit : "leo", "meo" or "geo", circular, of table 4.1
    place : rad, along the orbit from C's x axis towards y; C prints no orbital plane
    angles : (3,), rad, yaw, pitch and roll from the inertial to the body's axes, in this order
    cameras : 1, on the body's axes; or 2, a Sun camera there and an Earth camera as in table 4.3
    look : "full", "lambert" or "textured", a made-up ground with clouds under Lambert's shading
    noise : DN, standard deviation of a pixel
    seed : of the noise
    """

    orbit: str = "leo"
    place: float = np.pi / 6
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cameras: int = 1
    look: str = "full"
    noise: float = 2.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name, choices in (("orbit", tuple(HEIGHTS)), ("cameras", CAMERAS), ("look", LOOKS)):
            if getattr(self, name) not in choices:
                listed = ", ".join(map(str, choices))
                raise ValueError(f"{name} is {getattr(self, name)!r}: give one of {listed}")
        if len(self.angles) != 3 or not np.isfinite([*self.angles, self.place]).all():
            raise ValueError("place and the three angles must be finite numbers, rad")
        if not 0 <= self.noise < np.inf:
            raise ValueError(f"noise is {self.noise}: give 0 DN or more")

    @property
    def position(self) -> np.ndarray:
        """(3,), m, from the Earth's centre."""
        # C's heights are above its sphere, not above the equator.
        height = HEIGHTS[self.orbit] + EARTH_RADIUS - earth.EQUATOR_RADIUS
        return circular_orbit(height, 0.0, 0.0, self.place)[0]

    @property
    def sun(self) -> np.ndarray:
        """(3,), unit vector from the satellite to the Sun."""
        way = SUN_DISTANCE * SUN - self.position
        return way / np.linalg.norm(way)

    @property
    def attitude(self) -> np.ndarray:
        """(3, 3), body from inertial."""
        return matrix_from_euler(SEQUENCE, self.angles)

    @property
    def earth_camera(self) -> Camera:
        return _cameras(self.cameras)[0]

    @property
    def sun_camera(self) -> Camera:
        return _cameras(self.cameras)[1]


@dataclass(frozen=True, eq=False)
class Exploration:
    """What the cameras see, and what is made of it.

    Attributes
    ----------
    images : of the Earth camera and of the Sun camera, (height, width), uint8; of one camera the same
    found : by the limb's edges and the Sun's disc together, from the cone on
    chain : work C's, in the Earth camera's image and in the Sun camera's; of one camera the same
    chain_matrix : (3, 3), body from inertial, of C's chain by TRIAD, the Sun first; None without
    off_axis : rad, the Earth's centre from the Earth camera's axis
    angular_radius : rad, the Earth's
    status, chain_status : "ok", or sentences that say why there is no attitude
    """

    settings: Settings
    images: tuple[np.ndarray, np.ndarray]
    found: ImageAttitude
    chain: tuple[Baseline, Baseline]
    chain_matrix: np.ndarray | None
    off_axis: float
    angular_radius: float
    status: str
    chain_status: str

    @property
    def true(self) -> np.ndarray:
        """(3,), rad, the Euler angles of the true attitude, in their usual ranges (C's "Ref")."""
        return euler_from_matrix(SEQUENCE, self.settings.attitude)

    @property
    def computed(self) -> np.ndarray:
        """(3,), rad, by limb and Sun together; NaN without a solution."""
        return _angles(self.found.matrix)

    @property
    def chain_computed(self) -> np.ndarray:
        """(3,), rad, by C's chain (C's "Hes"); NaN without a solution."""
        return _angles(self.chain_matrix)

    @property
    def error(self) -> np.ndarray:
        """(3,), rad, rotation vector in body axes from the true attitude to the computed; NaN without."""
        return _error(self.found.matrix, self.settings.attitude)

    @property
    def chain_error(self) -> np.ndarray:
        """(3,), rad, the same of C's chain."""
        return _error(self.chain_matrix, self.settings.attitude)

    @property
    def chain_centre_error(self) -> float:
        """rad, from the Earth's centre to that of C's ellipse; NaN without one."""
        return self._centre_error(self.chain[0].earth_direction)

    @property
    def ellipse_bias(self) -> float:
        """rad, what the whole limb's ellipse makes of it; NaN where the limb's image is no ellipse."""
        bias = centre_bias(self.off_axis, self.angular_radius)
        return float("nan") if bias is None else bias

    @property
    def centre_error(self) -> float:
        """rad, from the Earth's centre to the cone's axis, the limb's alone; NaN without one."""
        return self._centre_error(self.found.limb.direction)

    def _centre_error(self, direction: np.ndarray | None) -> float:
        to_camera = self.settings.earth_camera.to_body.T @ self.settings.attitude
        return _apart(direction, to_camera @ -self.settings.position)

    @property
    def chain_sun_error(self) -> float:
        """rad, from the Sun to what C's chain takes for it; NaN where it takes nothing for it."""
        made, found = self.settings, self.chain[1].sun_direction
        return _apart(found, made.sun_camera.to_body.T @ made.attitude @ made.sun)

    @property
    def chain_doubt(self) -> str:
        """What is wrong with an attitude of C's chain without its knowing; "" for nothing known."""
        if self.chain_status != "ok" or not self.chain_sun_error > WRONG_SUN:
            return ""
        return (
            f"What C's chain takes for the Sun is {np.degrees(self.chain_sun_error):.0f}° from it: "
            "its attitude is none."
        )

    @property
    def locked(self) -> bool:
        """Whether the pitch is so near ±90° that yaw and roll are nearly one rotation."""
        return bool(lock_margin(SEQUENCE, self.true) < 0.05)

    def to_frame(self) -> pd.DataFrame:
        """Angles and errors in degrees, beside each other; NaN without a solution."""
        errors = [np.append(e, np.linalg.norm(e)) for e in (self.chain_error, self.error)]
        columns = {
            "true": np.append(self.true, np.full(4, np.nan)),
            "work C's chain": np.append(self.chain_computed, errors[0]),
            "limb and Sun together": np.append(self.computed, errors[1]),
        }
        rows = [f"{name} [°]" for name in ("yaw", "pitch", "roll")]
        rows += [f"error about {axis} [°]" for axis in "xyz"] + ["whole error [°]"]
        return pd.DataFrame(
            {k: np.degrees(v).round(3) + 0.0 for k, v in columns.items()}, index=rows
        )

    def _repr_html_(self) -> str:
        said = [self.status] if self.status != "ok" else []
        said += [f"Work C's chain: {self.chain_status}"] if self.chain_status != "ok" else []
        said += [self.chain_doubt] if self.chain_doubt else []
        said += [LOCKED] if self.locked else []
        table = self.to_frame().to_html(
            border=0, na_rep="–", float_format=lambda v: f"{v:.3f}".replace("-", "−")
        )
        return table + "".join(f"<p>{html.escape(one)}</p>" for one in said)


LOCKED = (
    "The pitch is near ±90°, where yaw and roll turn about nearly the same axis: small errors of the "
    "attitude are large ones of these two angles, and at ±90° itself the table may share the turn between "
    "them in another way than the sliders. Compare the errors about the axes."
)


def explore(settings: Settings) -> Exploration:
    """Renders the views, finds the attitude in both ways, and compares."""
    rng = np.random.default_rng(settings.seed)
    lit = "full" if settings.look == "full" else "lambert"
    painting = _painting() if settings.look == "textured" else None
    position, sun, attitude = settings.position, settings.sun, settings.attitude
    scene = Scene(position, sun, lit=lit, texture=painting, noise=settings.noise)
    camera, sun_camera = settings.earth_camera, settings.sun_camera
    image = sun_image = render(camera, scene, attitude, rng)
    chain = sun_chain = baseline(image, camera)
    sun_view = None
    if settings.cameras == 2:
        sun_image = render(sun_camera, scene, attitude, rng)
        sun_chain = baseline(sun_image, sun_camera)
        sun_view = sun_image, sun_camera
    found = attitude_from_image(image, camera, position, sun, sun_view=sun_view)
    down = -position / np.linalg.norm(position)
    chain_matrix, chain_status = _by_chain(settings, chain, sun_chain, down)
    return Exploration(
        settings,
        (image, sun_image),
        found,
        (chain, sun_chain),
        chain_matrix,
        float(np.arccos(np.clip((camera.to_body.T @ attitude @ down)[2], -1, 1))),
        float(np.arcsin(EARTH_RADIUS / np.linalg.norm(position))),
        "ok" if found.matrix is not None else why_none(settings, found),
        chain_status,
    )


@cache
def _cameras(count: int) -> tuple[Camera, Camera]:
    """Those for the Earth and for the Sun (tables 4.2 and 4.3)."""
    camera = Camera(1280, 720, 369.5)
    left, _, right = np.linalg.svd(
        EARTH_CAMERA
    )  # printed to four digits: the rotation nearest to it
    return (camera, camera) if count == 1 else (replace(camera, to_body=left @ right), camera)


@cache
def _painting() -> np.ndarray:
    return texture(3)


def _angles(matrix: np.ndarray | None) -> np.ndarray:
    return np.full(3, np.nan) if matrix is None else euler_from_matrix(SEQUENCE, matrix)


def _apart(found: np.ndarray | None, true: np.ndarray) -> float:
    if found is None:
        return float("nan")
    return float(np.arctan2(np.linalg.norm(np.cross(found, true)), found @ true))


def _error(matrix: np.ndarray | None, true: np.ndarray) -> np.ndarray:
    return np.full(3, np.nan) if matrix is None else error_vector(matrix, true)


def _by_chain(settings: Settings, chain: Baseline, sun_chain: Baseline, down: np.ndarray):
    """The attitude by C's chain, (3, 3) or None, and "ok" or why there is none."""
    missing = []
    for what, one, seen in (
        ("No Earth", chain, chain.earth_direction),
        ("No Sun", sun_chain, sun_chain.sun_direction),
    ):
        if seen is None:
            missing.append(what + one.status.partition(what)[2].partition(" No Sun: ")[0])
    if missing:
        return None, " ".join(missing)
    measured = [
        settings.sun_camera.to_body @ sun_chain.sun_direction,
        settings.earth_camera.to_body @ chain.earth_direction,
    ]
    try:
        return triad(measured, [settings.sun, down]).matrix, "ok"
    except Refusal as refusal:
        return None, refusal.reason
