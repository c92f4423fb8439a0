"""From a device's recordings of a trajectory to the arrays that the methods of this package take.

Recordings come as they were stamped, with what is wrong about them. What is set aside, left out or not
known is told in `notes`, sentences for a chapter's page; what can be mended is an `InputError`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Motion
from sensorbook.attitude.propagation import rotation_increments
from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings.clock import advancing, duration_words, missing_samples, shuffled
from sensorbook.recordings.corruption import IMPLAUSIBLE, implausible
from sensorbook.recordings.even import BRIDGED_INTERVALS, BRIDGED_SECONDS, MINIMUM_SAMPLES
from sensorbook.recordings.recording import QUATERNION, Recording
from sensorbook.recordings.schema import FILE

FASTEST = np.radians(2000.0)  # rad/s rms: the range of common gyroscopes
COARSEST = 1.0  # rad rms from sample to sample: beyond it the readings do not tell the path
UNKNOWN = np.pi**2 / 3  # rad², variance of an angle of which nothing is known
ROUNDED = 1e-3  # by which the length of a quaternion of four digits may be off 1 …
SCALED = 0.05  # … by which one that is meant as unit may be, and beyond which it is none
WILD_SHARE = 0.01  # of the rows: in more of them the columns are wrong, not the rows
TOUCHING = 0.01  # intervals: stamps nearer than this are one


@dataclass(frozen=True, eq=False)
class Readings:
    """A gyroscope's usable readings.

    Attributes
    ----------
    time : (N,) s on the file's own clock, strictly ascending
    rate : (N, 3) rad/s, finite
    lost : (N − 1,) true for a step across a gap that is too long to bridge
    notes : what was done to get them
    """

    time: np.ndarray
    rate: np.ndarray
    lost: np.ndarray
    notes: tuple[str, ...] = ()

    def first(self, count: int) -> Readings:
        """Those up to a number."""
        return Readings(self.time[:count], self.rate[:count], self.lost[: count - 1], self.notes)


@dataclass(frozen=True, eq=False)
class ReferenceTrack:
    """Attitudes to compare with or to aid by. Matrices become quaternions by `quaternion_from_matrix`.

    Attributes
    ----------
    time : (M,) s on the file's own clock, strictly ascending
    quaternion : (M, 4), reference → body, unit, scalar last
    notes : what was done to get them
    """

    time: np.ndarray
    quaternion: np.ndarray
    notes: tuple[str, ...] = ()


def readings(recording: Recording) -> Readings:
    """The readings of a gyroscope's trajectory.

    Rows without a rate or a stamp, or with a rate that no gyroscope reads, are left out, and rows whose
    stamp does not advance are set aside. Gaps up to 5 intervals, or 0.1 s where that is more, are
    bridged: the rate is interpolated across them. The rotation across a longer one is lost.

    Raises
    ------
    Refusal
        there is no time base, or fewer than 100 readings or less than half of the rows remain
    InputError
        the rates are too large for what they are declared as
    """
    _require_clock(recording)
    rows, done = _usable(recording, "rate")
    kept = np.flatnonzero(rows)
    if len(kept) < MINIMUM_SAMPLES or 2 * len(kept) < len(recording):
        raise Refusal(
            f"{recording.file}: only {len(kept)} of the gyroscope's {len(recording)} rows can be used. "
            f"{' '.join(done)}".rstrip(),
            "Sort the file's rows by time."
            if shuffled(recording.time)
            else "Record again without losses, each sample stamped when it is taken.",
        )
    time, rate = recording.start + recording.time[kept], recording.values[kept]
    _require_plausible(recording, rate)
    lost = _too_long(np.diff(time), recording.rate)
    missing = np.where(lost, 0, missing_samples(time, recording.rate))
    if missing.any():
        done.append(
            f"{_count(missing.sum(), 'reading')} of the gyroscope missing in "
            f"{_count(np.count_nonzero(missing), 'short gap')}: bridged linearly."
        )
    if lost.any():
        longest = int(np.argmax(np.where(lost, np.diff(time), 0.0)))
        length, place = time[longest + 1] - time[longest], time[longest] - recording.start
        one = lost.sum() == 1
        gaps = "A gap" if one else f"{lost.sum()} gaps"
        most = "" if one else "the longest "
        done.append(
            f"{gaps} in the gyroscope's readings, {most}of {duration_words(length)} at {place:.6g} s, "
            f"cannot be bridged: the attitude is not known across {'it' if one else 'them'}; each method "
            "goes on from the next reference."
        )
    return Readings(time, rate, lost, tuple(done))


def motion(readings: Readings, delay: float = 0.0) -> Motion:
    """The rotation in each step; `delay` (s) is the readings', as `rotation_increments` has it.

    A lost step's rotation is that of the interpolated rate. Its variance an axis is the square of the
    record's rms rate times the gap's length, at most that of an angle of which nothing is known.
    """
    steps = np.diff(readings.time)
    speed = float(np.sqrt((readings.rate**2).sum(axis=1).mean()))
    variance = np.where(readings.lost, np.minimum((speed * steps) ** 2, UNKNOWN), 0.0)
    increments = rotation_increments(readings.time, readings.rate, delay)
    return Motion(readings.time, increments, variance)


def reference_track(recording: Recording) -> ReferenceTrack:
    """The attitudes of a recording of the sensor "reference", in the house's sense.

    Rows without a stamp or an attitude (empty, or all zeros) are left out, rows whose stamp does not
    advance set aside. Lengths that are off 1 by up to 5 % are made 1.

    Raises
    ------
    Refusal
        there is no time base, or fewer than two attitudes remain
    InputError
        more than 1 % of the rows are no unit quaternions, or the quaternion's sense is not declared
    """
    _require_clock(recording)
    sense = recording.declaration.get("quaternion")
    if sense not in ("body_to_reference", "reference_to_body"):
        raise InputError(
            Problem(FILE, "reference: quaternion", "its sense is not declared",
                    'write "body_to_reference" or "reference_to_body"')
        )  # fmt: skip
    rows, done = _usable(recording, "attitude")
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(recording.values, axis=1)
        off = np.abs(length - 1)
    wild = rows & ~(off <= SCALED)
    if wild.any():
        first, count = int(np.argmax(wild)), int(wild.sum())
        of_length = f"row {first + 1} has the length {length[first]:.4g}"
        if count > WILD_SHARE * rows.sum():
            named = recording.declaration.get("columns", {})
            columns = " ".join(str(named.get(axis, axis)) for axis in "wxyz")
            raise InputError(
                Problem(
                    recording.file,
                    f"reference: columns {columns}",
                    f"{of_length}, where a quaternion has 1; off by more than {100 * SCALED:g} %: "
                    f"{count} of {rows.sum()} rows",
                    "name the columns that hold w, x, y and z of unit quaternions",
                )
            )
        rows &= ~wild
        done.append(
            f"{_count(count, 'row')} of the reference no unit quaternion ({of_length}): set aside."
        )
    if rows.sum() < 2:
        raise Refusal(
            f"{recording.file}: only {rows.sum()} of the reference's {len(recording)} rows can be used. "
            f"{' '.join(done)}".rstrip(),
            "Record a reference whose attitudes are stamped, or leave it out.",
        )
    scaled = rows & (off > ROUNDED)
    if scaled.any():
        worst = length[scaled][np.argmax(off[scaled])]
        done.append(
            f"{_count(scaled.sum(), 'quaternion')} of the reference not of unit length (one has "
            f"{worst:.4g}): made so."
        )
    quaternion = recording.values[rows] / length[rows, None]
    if sense == "reference_to_body":
        # A file's q v_ref q* = v_body is the house's conjugate.
        quaternion = quaternion * [-1.0, -1.0, -1.0, 1.0]
    return ReferenceTrack(recording.start + recording.time[rows], quaternion, tuple(done))


def on_stamps(
    readings: Readings, track: ReferenceTrack, motion: Motion
) -> tuple[np.ndarray, np.ndarray]:
    """The reference at the readings' stamps: numbers of the stamps (M,), ascending, and (M, 4).

    Each attitude goes to the nearest stamp, turned by its share of the motion's rotation in that step:
    R(t_k) = R(t_ref) exp(ω (t_k − t_ref)). None is moved within a lost step, or by more than half the
    usual interval beyond the readings' ends. Of two at one stamp the nearer is taken. The rate is the
    gyroscope's with its bias, which half an interval turns by little.

    Raises
    ------
    Refusal
        no attitude lies where the gyroscope was read
    """
    stamps, own = readings.time, track.time
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    step = np.clip(np.searchsorted(stamps, own, side="right") - 1, 0, len(steps) - 1)
    nearest = step + (own - stamps[step] > steps[step] / 2)
    off = stamps[nearest] - own
    inside = (own >= stamps[0]) & (own <= stamps[-1])
    reached = (inside | (np.abs(off) <= usual / 2)) & ~readings.lost[step]
    reached |= np.abs(off) <= TOUCHING * usual
    if not reached.any():
        raise Refusal(
            "None of the reference's attitudes was taken where the gyroscope was read: the gyroscope's "
            f"stamps go {_span(stamps)}, the reference's {_span(own)}.",
            "Stamp both by one clock.",
        )
    order = np.flatnonzero(reached)
    order = order[np.lexsort((np.abs(off[order]), nearest[order]))]
    at, first = np.unique(nearest[order], return_index=True)
    chosen = order[first]
    share = off[chosen] / steps[step[chosen]]
    turned = Rotation.from_rotvec(motion.increments[step[chosen]] * share[:, None])
    return at, (Rotation.from_quat(track.quaternion[chosen]) * turned).as_quat()


def vectors_on_stamps(readings: Readings, recording: Recording) -> np.ndarray:
    """Another sensor's vectors at the readings' stamps, interpolated linearly: (N, 3), in its unit.

    NaN before its first and after its last sample, and in gaps longer than 5 of its intervals, or
    than 0.1 s where that is more.
    """
    _require_clock(recording)
    rows, _ = _usable(recording, "value")
    own, values = recording.start + recording.time[rows], recording.values[rows]
    found = np.full((len(readings.time), 3), np.nan)
    if len(own) < 2:
        return found
    near = TOUCHING / recording.rate
    inside = (readings.time >= own[0] - near) & (readings.time <= own[-1] + near)
    at = readings.time[inside]
    step = np.clip(np.searchsorted(own, at, side="right") - 1, 0, len(own) - 2)
    apart = np.minimum(np.abs(at - own[step]), np.abs(at - own[step + 1]))
    known = ~_too_long(np.diff(own), recording.rate)[step] | (apart <= near)
    vectors = np.stack([np.interp(at, own, axis) for axis in values.T], axis=1)
    found[inside] = np.where(known[:, None], vectors, np.nan)
    return found


def _require_clock(recording: Recording) -> None:
    if recording.rate is None:
        raise Refusal(
            f"{recording.file}: the {recording.sensor} has no time base: neither a rate nor a time "
            "column is declared.",
            "Declare rate = … (Hz) or columns.time in device.toml.",
        )


def _usable(recording: Recording, what: str) -> tuple[np.ndarray, list[str]]:
    """(N,) rows that hold a value and whose stamp advances, and a sentence for each kind left out."""
    sensor, done = recording.sensor, []
    rows = np.isfinite(recording.values).all(axis=1)
    if recording.columns == QUATERNION:
        rows &= recording.values.any(axis=1)  # zeros stand for no attitude
    if not rows.all():
        count = len(rows) - int(rows.sum())
        share = 100 * count / len(rows)
        verb = "holds" if count == 1 else "hold"
        done.append(
            f"{count} of the {sensor}'s {len(rows)} rows ({share:.{2 if share < 99 else 4}g} %) {verb} no "
            f"{what}: left out."
        )
    if sensor in IMPLAUSIBLE and len(rows):
        absurd = implausible(recording.values, sensor)
        rows[absurd] = False
        if len(absurd):
            done.append(
                f"{_count(len(absurd), 'row')} of the {sensor} beyond {IMPLAUSIBLE[sensor]:g} "
                f"{recording.unit}: left out."
            )
    unstamped = rows & ~np.isfinite(recording.time)
    if unstamped.any():
        done.append(
            f"{_count(unstamped.sum(), 'row')} of the {sensor} without a time stamp: left out."
        )
        rows &= ~unstamped
    ordered = _in_order(recording, rows)
    if back := int(rows.sum() - ordered.sum()):
        why = ", as the file's rows are not sorted by time" if shuffled(recording.time) else ""
        done.append(
            f"{_count(back, 'row')} of the {sensor} whose time stamp does not advance: set aside{why}."
        )
    return ordered, done


def _in_order(recording: Recording, rows: np.ndarray) -> np.ndarray:
    """Those of `rows` (N,) whose stamp lies beyond that of every one before."""
    ordered = np.zeros_like(rows)
    # On the file's clock: far from its zero, stamps may round to the same number.
    stamps = recording.start + recording.time[rows]
    ordered[np.flatnonzero(rows)] = advancing(stamps)
    return ordered


def _too_long(steps: np.ndarray, rate: float) -> np.ndarray:
    """Which steps (s) between neighbouring samples at `rate` (Hz) are gaps that cannot be bridged."""
    bridged = max(BRIDGED_INTERVALS, round(BRIDGED_SECONDS * rate))
    return np.rint(steps * rate) > bridged


def _require_plausible(recording: Recording, rate: np.ndarray) -> None:
    speed = float(np.sqrt((rate**2).sum(axis=1).mean()))
    turned = speed / recording.rate
    if speed <= FASTEST and turned <= COARSEST:
        return
    scale = recording.declaration.get("scale", {})
    key, unit = "unit", recording.declaration.get("unit", recording.unit)
    if unit == "counts":
        key, unit = "scale.unit", scale.get("unit", recording.unit)
    mend = f"check {key}" if key == "unit" else "check scale"
    if unit == "rad/s":
        mend = f'write {key} = "deg/s" if the file holds degrees a second'
    if speed > FASTEST:
        what = f"more than {np.degrees(FASTEST):.0f} °/s, the range of common gyroscopes"
    else:
        what = f"a turn of {turned:.2g} rad from sample to sample, too much to follow"
        mend += "; otherwise record at a higher rate"
    raise InputError(
        Problem(recording.file, f"gyroscope: {key}", f"in {unit!r} it reads {speed:.3g} rad/s rms, {what}",
                mend)
    )  # fmt: skip


def _count(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _span(time: np.ndarray) -> str:
    return f"from {time[0]:.12g} s to {time[-1]:.12g} s"
