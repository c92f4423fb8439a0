"""What tells a device's attitude beside its gyroscope, as references on the gyroscope's stamps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensorbook.attitude.agreement import agreement
from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References
from sensorbook.attitude.measured import align_frames, from_camera, from_gravity_and_field, widen
from sensorbook.attitude.preparation import (
    Readings,
    ReferenceTrack,
    motion,
    on_stamps,
    readings,
    reference_track,
    vectors_on_stamps,
)
from sensorbook.attitude.tuning import FEWEST, Disagreement, assumed, disagreement, tuned
from sensorbook.attitude.verdicts import judge
from sensorbook.earth import FIELD_YEARS, field_in_ned
from sensorbook.errors import Refusal
from sensorbook.recordings import Device, Recording


@dataclass(frozen=True, eq=False)
class Source:
    """Reference attitudes of one origin.

    Attributes
    ----------
    name : for a reader
    key : "" for the device's first source, else what its methods are called by in results.json
    references : on the stamps; their covariance is NaN where the origin tells none
    notes : what is to be said of them
    lasting : whether their errors last longer than the time between them
    """

    name: str
    key: str
    references: References
    notes: tuple[str, ...]
    lasting: bool = False

    @property
    def covariance_known(self) -> bool:
        return bool(np.isfinite(self.references.covariance).all())

    def with_std(self, std: float) -> Source:
        """The same with one standard error (rad) about each axis."""
        covariance = np.tile(std**2 * np.eye(3), (len(self.references), 1, 1))
        found = References(self.references.at, self.references.quaternion, covariance)
        return replace(self, references=found)


def sources(
    read: Readings,
    beside: Mapping[str, Recording],
    images: Iterable[Mapping] = (),
    declination: float = 0.0,
    delay: float = 0.0,
) -> tuple[Source, ...]:
    """The sources of a trajectory, best first: a recorded reference, a camera, gravity and field.

    One beside the first that cannot serve is left out, which the first's notes say.

    Parameters
    ----------
    read : the gyroscope's readings
    beside : recordings of the trajectory by sensor: reference, accelerometer, magnetometer
    images : the camera chapter's record of its images
    declination : rad, of magnetic north, east of true north
    delay : s, of the gyroscope against the first source; accelerometer and magnetometer share its clock,
        and are as late

    Raises
    ------
    Refusal
        nothing tells the attitude
    """
    moved = motion(read)
    late = replace(read, time=read.time + delay)
    solved = [image for image in images if image.get("quaternion") and image.get("time")]

    def reference() -> Source:
        track = reference_track(beside["reference"])
        at, quaternion = on_stamps(read, track, moved)
        unknown = np.full((len(at), 3, 3), np.nan)
        return Source("reference", "reference", References(at, quaternion, unknown), track.notes)

    def camera() -> Source:
        time, quaternion, covariance = from_camera(solved)
        at, quaternion = on_stamps(read, ReferenceTrack(time, quaternion), moved)
        nearest = np.abs(read.time[at][:, None] - time[None, :]).argmin(axis=1)
        return Source("camera", "camera", References(at, quaternion, covariance[nearest]), ())

    def vectors() -> Source:
        sensors = ("accelerometer", "magnetometer")
        force, field = (vectors_on_stamps(late, beside[sensor]) for sensor in sensors)
        measured = from_gravity_and_field(read.time, force, field, declination)
        return Source("gravity and field", "vectors", measured.references, measured.notes, True)

    there = []
    if "reference" in beside:
        there.append((reference, "The reference"))
    if solved:
        there.append((camera, "The camera"))
    if {"accelerometer", "magnetometer"} <= set(beside):
        there.append((vectors, "Gravity and field"))
    if not there:
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
    found, left_out = [], []
    for k, (source, name) in enumerate(there):
        try:
            each = source()
        except Refusal as refusal:
            if len(there) == 1 or (name == "The reference"):
                raise
            left_out.append(f"{name} cannot serve beside it: {refusal.reason}")
            continue
        rare = not each.covariance_known and len(each.references) < FEWEST
        if rare and k + 1 < len(there):
            left_out.append(
                f"The {each.name} tells {len(each.references)} attitudes, too few to find out how good they "
                "are: it is left out."
            )
            continue
        found.append(each)
    if not found:
        raise Refusal(" ".join(left_out), "Give recordings of one clock.")
    return (replace(found[0], key="", notes=(*found[0].notes, *left_out)), *found[1:])


def in_one_frame(found: Sequence[Source]) -> tuple[list[tuple[Source, float]], list[str]]:
    """The sources after the first in its frame, each with the angle left (rad rms), and why some are not."""
    turned, notes = [], []
    for each in found[1:]:
        try:
            turned.append(in_frame_of(each, found[0]))
        except Refusal as refusal:
            notes.append(f"{each.name.capitalize()} cannot be compared: {refusal.reason}")
    return turned, notes


def beside_of(device: Device, gyroscope: Recording) -> dict[str, Recording]:
    """What the device recorded along a gyroscope's trajectory, by sensor.

    Of several runs that of the same file is taken, else the longest.
    """
    found = {}
    for sensor in ("reference", "accelerometer", "magnetometer"):
        if runs := device.runs(sensor, "trajectory"):
            found[sensor] = next((r for r in runs if r.file == gyroscope.file), runs[0])
    return found


def declination_at(site: Mapping) -> tuple[float, str]:
    """rad, of magnetic north east of true north at a device's `[site]`, and which north that makes."""
    known = [site.get(key) for key in ("latitude", "longitude", "date")]
    if None in known or not FIELD_YEARS[0] <= known[2].year < FIELD_YEARS[1]:
        return 0.0, "magnetic north for north"
    place = np.radians(known[0]), np.radians(known[1]), site.get("height", 0.0)
    north, east, _ = field_in_ned(*place, known[2])
    angle = float(np.arctan2(east, north))
    side = "east" if angle >= 0 else "west"
    return (
        angle,
        f"true north for north: the compass points {np.degrees(abs(angle)):.1f}° {side} of it",
    )


@dataclass(frozen=True, eq=False)
class TunedFor:
    """What filters are given for a source.

    Attributes
    ----------
    noise : of the gyroscope
    source : the same source, its covariance known
    parts : how gyroscope and source part; None where it is too poor or too rare to show that
    """

    noise: GyroscopeNoise
    source: Source
    parts: Disagreement | None

    def record(self) -> dict:
        """`attitude.tuning` of results.json, SI."""
        found = {
            name: np.broadcast_to(getattr(self.noise, name), 3).tolist()
            for name in ("random_walk", "rate_random_walk", "bias_std")
        } | {"in_motion": self.noise.in_motion}
        if self.parts is not None:
            found["reference_std"] = self.parts.reference_at_most
        return found


def tuning_of(
    moved: Motion,
    source: Source,
    random_walk: tuple[float, float, float] | None,
    rate_random_walk: tuple[float, float, float] | None,
    bias_std: float,
) -> TunedFor:
    """What filters are given: N and K (SI, an axis) from a rest where known, the rest from how the two part.

    The errors of gravity and field last, so that they would be taken for the gyroscope's: they show
    nothing of it.

    Raises
    ------
    Refusal
        the source tells no covariance, and there are too few to show one
    """
    parts = None
    if not source.lasting:
        white = None if random_walk is None else float(np.sqrt(np.mean(np.square(random_walk))))
        try:
            parts = disagreement(moved, source.references, white)
        except Refusal:
            if not source.covariance_known:
                raise
    if parts is None:
        duration = float(moved.time[-1] - moved.time[0])
        return TunedFor(assumed(duration, random_walk, rate_random_walk, bias_std), source, None)
    if not source.covariance_known:
        source = source.with_std(parts.reference_at_most)
    return TunedFor(tuned(parts, random_walk, rate_random_walk, bias_std), source, parts)


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
    return replace(source, references=found), turned.rms


def of_device(device: Device, bias_std: float = 0.05) -> tuple[Motion, References, GyroscopeNoise]:
    """A device's longest trajectory as the filters take it, uncalibrated: `mekf(*of_device(device))`.

    The readings' delay and the noise of both sides are found against the device's best source. `bias_std`
    rad/s is what is known of the bias beforehand.

    Raises
    ------
    Refusal, InputError
        as `readings`, `sources`, `judge` and `tuning_of` do
    """
    gyroscope = device.runs("gyroscope", "trajectory")[0]
    read = readings(gyroscope)
    source = sources(read, beside_of(device, gyroscope), (), declination_at(device.site)[0])[0]
    at, quaternion = source.references.at, source.references.quaternion
    agreed = agreement(read.time, read.rate, at, quaternion, read.lost)
    judge(agreed, read.time, read.rate, at, quaternion, read.lost, name=source.name)
    moved = motion(read, 0.0 if source.lasting else agreed.delay_taken)
    found = tuning_of(moved, source, None, None, bias_std)
    references = found.source.references
    return moved, widen(references, read.time) if source.lasting else references, found.noise
