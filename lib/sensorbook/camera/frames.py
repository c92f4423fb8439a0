"""The images of a device's cameras, one by one: what is seen in each, and the attitude it gives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from sensorbook.attitude.rotations import (
    error_vector,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from sensorbook.camera.attitude import ImageAttitude, attitude_from_image, expected_radius
from sensorbook.camera.limb import Limb, find_limb
from sensorbook.camera.model import Camera
from sensorbook.camera.picture import read_picture
from sensorbook.camera.scene import WGS84
from sensorbook.camera.sun import Sun, find_sun
from sensorbook.earth import sun_direction
from sensorbook.errors import Refusal
from sensorbook.recordings.images import Images
from sensorbook.recordings.poses import Pose

SAME_TIME = np.timedelta64(20, "ms")  # two cameras on one body, whose shutters are not one
NO_PAIR = "no solution: no image of the other camera at its time"
# Of an Earth whose distance nobody tells: 8.7° from a geostationary orbit, 7° from the highest that many
# use. The Moon's is 0.26°.
LEAST_RADIUS = np.radians(5.0)
MOST_RADIUS = np.radians(85.0)  # from 24 km up
_NO_POSE = Pose(None, None, None)


@dataclass(frozen=True, eq=False)
class Frame:
    """One image and what it told.

    Attributes
    ----------
    image : its name, as short as tells it from the device's others
    path, camera, sees : the file, the camera that took it, and "earth", "sun" or "both"
    semi_axes : (3,), m, of the Earth along the inertial axes
    pose : what is known of it
    status : "ok", or the reason in words
    note : what was done to the picture, or ""
    limb, sun : what was found; None where it was not looked for
    earth_direction : (3,), unit vector to the Earth's centre in camera axes, or None
    earth_std : rad, its standard error, rms of the two axes across it, or None
    matrix : (3, 3), body from inertial, or None; `covariance` (3, 3), rad², of its error vector
    error : (3,), rad, error vector against the true attitude in body axes, where that is known
    partner : the image of the other camera that the attitude took, or ""
    """

    image: str
    path: Path
    camera: Camera
    sees: str
    semi_axes: tuple[float, float, float] = WGS84
    pose: Pose = _NO_POSE
    status: str = "ok"
    note: str = ""
    limb: Limb | None = None
    sun: Sun | None = None
    earth_direction: np.ndarray | None = None
    earth_std: float | None = None
    matrix: np.ndarray | None = None
    covariance: np.ndarray | None = None
    error: np.ndarray | None = None
    partner: str = ""

    def record(self) -> dict:
        """The image's entry under `camera.images` of results.json."""
        found = self.limb is not None and self.limb.direction is not None
        return {
            "image": self.image,
            "time": None if self.pose.time is None else f"{self.pose.time}Z",
            "status": self.status,
            "sees": self.sees,
            "earth_direction": self.earth_direction,
            "earth_direction_std_deg": _degrees(self.earth_std),
            "earth_angular_radius_deg": _degrees(self.limb.angular_radius) if found else None,
            "earth_angular_radius_std_deg": (
                _degrees(np.sqrt(self.limb.covariance[2, 2])) if found else None
            ),
            "limb_residual_px": self.residual,
            "sun_direction": None if self.sun is None else self.sun.direction,
            "sun_direction_std_deg": None if self.sun is None else _degrees(self.sun.std),
            "quaternion": None if self.matrix is None else quaternion_from_matrix(self.matrix),
            "attitude_std_deg": (
                None if self.matrix is None else np.degrees(np.sqrt(np.diag(self.covariance)))
            ),
            "attitude_covariance": None if self.matrix is None else self.covariance,
            "error_deg": None if self.error is None else _degrees(np.linalg.norm(self.error)),
            "partner": self.partner or None,
            "note": self.note or None,
        }

    @property
    def residual(self) -> float | None:
        """Root mean square distance of the limb's edge points from the fit, pixels, or None."""
        if self.limb is None or self.limb.direction is None:
            return None
        return float(np.sqrt(np.mean(self.limb.residuals[self.limb.used] ** 2)))


def read_frames(runs: Sequence[Images]) -> Iterator[Frame]:
    """Every image of a device's cameras, in the order of its recordings.

    An image of a camera that sees the Earth alone goes with that of the Sun's camera taken at the same
    time, where the poses of both give it; the two then have one attitude.
    """
    names = image_names(runs)
    frames = [_frame(run, k, names) for run in runs for k in range(len(run))]
    timed = [f for f in frames if f.sees != "both" and f.pose.time is not None]
    partners = _partners(timed)
    paired = {frame.sees for frame in frames} >= {"earth", "sun"} and bool(timed)
    done: dict[tuple[str, str], Frame] = {}
    for frame in frames:
        if _key(frame) in done:
            yield done.pop(_key(frame))
            continue
        partner = partners.get(_key(frame))
        if partner is None:
            alone = _alone(frame)
            lonely = paired and frame.sees != "both" and alone.status == "ok"
            yield replace(alone, status=NO_PAIR) if lonely else alone
            continue
        earth, sun = _pair(*((frame, partner) if frame.sees == "earth" else (partner, frame)))
        mine, its = (earth, sun) if frame.sees == "earth" else (sun, earth)
        done[_key(its)] = its
        yield mine


def image_names(runs: Sequence[Images]) -> dict[str, str]:
    """By path, the last part of each, if that tells all of them apart; else the path."""
    names = [name for run in runs for name in run.names]
    short = [PurePosixPath(name).name for name in names]
    return dict(zip(names, short if len(set(short)) == len(names) else names, strict=True))


def _frame(run: Images, k: int, names: dict[str, str]) -> Frame:
    name = run.names[k]
    sphere = run.camera.get("earth_radius")
    return Frame(
        names[name],
        run.paths[k],
        Camera.of(run.camera),
        run.camera.get("sees", "both"),
        WGS84 if sphere is None else (float(sphere),) * 3,
        run.poses.get(name, _NO_POSE),
    )


def _partners(frames: list[Frame]) -> dict[tuple[str, str], Frame]:
    """By image and what it looks for: that of the other camera nearest in time, and within `SAME_TIME`.

    Only where each is the other's. One file may be the image of both.
    """
    found = {}
    for frame in frames:
        others = [f for f in frames if f.sees != frame.sees]
        near = min(others, key=lambda f: abs(f.pose.time - frame.pose.time), default=None)
        if near is not None and abs(near.pose.time - frame.pose.time) <= SAME_TIME:
            found[_key(frame)] = near
    return {k: f for k, f in found.items() if _key(found.get(_key(f), f)) == k}


def _key(frame: Frame) -> tuple[str, str]:
    return frame.image, frame.sees


def _alone(frame: Frame) -> Frame:
    """What one image tells by itself."""
    try:
        picture, note = read_picture(frame.path, frame.camera)
    except Refusal as refusal:
        return replace(frame, status=f"no solution: {refusal.reason}")
    frame = replace(frame, note=note)
    position, time = frame.pose.position, frame.pose.time
    if frame.sees == "both" and position is not None and time is not None:
        found = attitude_from_image(
            picture, frame.camera, position, sun_direction(time, position), frame.semi_axes
        )
        return _with_attitude(replace(frame, limb=found.limb, sun=found.sun), found)
    sun = find_sun(picture, frame.camera) if frame.sees != "earth" else None
    limb = None
    if frame.sees != "sun":
        radius = None
        if position is not None:
            radius = expected_radius(np.linalg.norm(position), np.mean(frame.semi_axes))
        to_sun = None if sun is None else sun.direction
        limb = find_limb(picture, frame.camera, to_sun, radius)
        if radius is None and limb.status == "ok" and (odd := _odd_radius(limb.angular_radius)):
            limb = replace(limb, direction=None, angular_radius=None, covariance=None, status=odd)
    missing = [what.status for what in (sun, limb) if what is not None and what.status != "ok"]
    status = "no solution: " + ", ".join(missing) if missing else "ok"
    return _with_earth(replace(frame, limb=limb, sun=sun, status=status))


def _odd_radius(radius: float) -> str:
    """Why a limb of an angular `radius`, rad, is not taken for the Earth's where no position is given."""
    found = f"{np.degrees(radius):.1f}° radius"
    if radius < LEAST_RADIUS:
        return f"disc of {found}, too small for the Earth (5° or more where no position is given)"
    if radius > MOST_RADIUS:
        return f"edge of {found}, too straight for the Earth's from above 25 km"
    return ""


def _pair(earth: Frame, sun: Frame) -> tuple[Frame, Frame]:
    """The images of two cameras at one time, with the attitude that they give together."""
    earth, sun = replace(earth, partner=sun.image), replace(sun, partner=earth.image)
    position = earth.pose.position
    try:
        seen, note = read_picture(earth.path, earth.camera)
        lit, sun_note = read_picture(sun.path, sun.camera)
    except Refusal:
        position = None
    if position is None:
        alone = _alone(earth), _alone(sun)
        return _unpaired(*alone), _unpaired(*alone[::-1])
    to_sun = sun_direction(earth.pose.time, position)
    found = attitude_from_image(
        seen, earth.camera, position, to_sun, earth.semi_axes, sun_view=(lit, sun.camera)
    )
    return (
        _with_attitude(replace(earth, note=note, limb=found.limb), found),
        _with_attitude(replace(sun, note=sun_note, sun=found.sun), found),
    )


def _unpaired(frame: Frame, partner: Frame) -> Frame:
    """A frame whose partner gave no direction says so."""
    if frame.status == "ok" and partner.status != "ok":
        return replace(frame, status=f"{partner.status} ({partner.image})")
    return frame


def _with_attitude(frame: Frame, found: ImageAttitude) -> Frame:
    frame = replace(frame, status=found.status, matrix=found.matrix, covariance=found.covariance)
    if found.matrix is not None and frame.pose.quaternion is not None:
        true = matrix_from_quaternion(frame.pose.quaternion)
        frame = replace(frame, error=error_vector(found.matrix, true))
    return _with_earth(frame)


def _with_earth(frame: Frame) -> Frame:
    """The direction to the Earth's centre, and how well it is known.

    An attitude gives the centre's; the cone alone has the axis of a limb that the Earth's flattening f
    shifts: by f sin²ρ sin 2φ of an angle at latitude φ, 0.7 f sin²ρ rms.
    """
    limb = frame.limb
    if limb is None or limb.direction is None:
        return frame
    if frame.matrix is not None:
        direction = frame.matrix @ (-frame.pose.position / np.linalg.norm(frame.pose.position))
        across = np.trace(frame.covariance) - direction @ frame.covariance @ direction
        to_camera = frame.camera.to_body.T
        return replace(
            frame,
            earth_direction=to_camera @ direction,
            earth_std=float(np.sqrt(max(across, 0.0) / 2)),
        )
    flattening = 1 - frame.semi_axes[2] / frame.semi_axes[0]
    shift = flattening * np.sin(limb.angular_radius) ** 2 / np.sqrt(2)
    std = float(np.hypot(limb.std, shift))
    return replace(frame, earth_direction=limb.direction, earth_std=std)


def _degrees(value: float | None) -> float | None:
    return None if value is None else float(np.degrees(value))
