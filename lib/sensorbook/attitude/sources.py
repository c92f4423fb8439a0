"""What tells a device's attitude beside its gyroscope, as references on the gyroscope's stamps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from sensorbook.attitude.aiding import References
from sensorbook.attitude.measured import align_frames, from_camera, from_gravity_and_field
from sensorbook.attitude.preparation import (
    Readings,
    ReferenceTrack,
    motion,
    on_stamps,
    reference_track,
    vectors_on_stamps,
)
from sensorbook.errors import Refusal
from sensorbook.recordings import Recording


@dataclass(frozen=True, eq=False)
class Source:
    """Reference attitudes of one origin.

    Attributes
    ----------
    name : for a reader
    key : "" for the device's first source, else what its methods are called by in results.json
    references : on the stamps; their covariance is NaN where the origin tells none
    notes : what is to be said of them
    """

    name: str
    key: str
    references: References
    notes: tuple[str, ...]

    @property
    def covariance_known(self) -> bool:
        return bool(np.isfinite(self.references.covariance).all())

    def with_std(self, std: float) -> Source:
        """The same with one standard error (rad) about each axis."""
        covariance = np.tile(std**2 * np.eye(3), (len(self.references), 1, 1))
        found = References(self.references.at, self.references.quaternion, covariance)
        return Source(self.name, self.key, found, self.notes)


def sources(
    read: Readings,
    beside: Mapping[str, Recording],
    images: Iterable[Mapping] = (),
    declination: float = 0.0,
) -> tuple[Source, ...]:
    """The sources of a trajectory, best first: a recorded reference, a camera, gravity and field.

    Parameters
    ----------
    read : the gyroscope's readings
    beside : recordings of the trajectory by sensor: reference, accelerometer, magnetometer
    images : the camera chapter's record of its images
    declination : rad, of magnetic north, east of true north

    Raises
    ------
    Refusal
        nothing tells the attitude
    """
    found, moved = [], motion(read)

    def add(name: str, key: str, track: ReferenceTrack, covariance: np.ndarray | None) -> None:
        at, quaternion = on_stamps(read, track, moved)
        spread = np.full((len(at), 3, 3), np.nan)
        if covariance is not None:
            nearest = np.abs(read.time[at][:, None] - track.time[None, :]).argmin(axis=1)
            spread = covariance[nearest]
        found.append(
            Source(name, key if found else "", References(at, quaternion, spread), track.notes)
        )

    if "reference" in beside:
        add("reference", "", reference_track(beside["reference"]), None)
    solved = [image for image in images if image.get("quaternion") and image.get("time")]
    if solved:
        time, quaternion, covariance = from_camera(solved)
        add("camera", "camera", ReferenceTrack(time, quaternion), covariance)
    if {"accelerometer", "magnetometer"} <= set(beside):
        force, field = (
            vectors_on_stamps(read, beside[sensor]) for sensor in ("accelerometer", "magnetometer")
        )
        measured = from_gravity_and_field(read.time, force, field, declination)
        found.append(
            Source(
                "gravity and field",
                "vectors" if found else "",
                measured.references,
                measured.notes,
            )
        )
    if not found:
        alone = "accelerometer" in beside or "magnetometer" in beside
        raise Refusal(
            "Nothing beside the gyroscope tells the attitude"
            + (
                ", as one of accelerometer and magnetometer alone leaves a turn open."
                if alone
                else "."
            )
            + " Its rates integrate to how the attitude changes, and to an error that nothing shows.",
            "Record accelerometer and magnetometer with it, or the attitude itself "
            '(sensor = "reference").',
        )
    return tuple(found)


def in_frame_of(source: Source, reference: Source) -> tuple[Source, float]:
    """A source turned into another's frame, by what they have in common, and the angle left, rad rms.

    Raises
    ------
    Refusal
        they have no stamp in common
    """
    _, mine, theirs = np.intersect1d(
        source.references.at, reference.references.at, assume_unique=True, return_indices=True
    )
    turned = align_frames(
        source.references.quaternion[mine], reference.references.quaternion[theirs]
    )
    found = References(
        source.references.at,
        turned.applied(source.references.quaternion),
        source.references.covariance,
    )
    return Source(source.name, source.key, found, source.notes), turned.rms
