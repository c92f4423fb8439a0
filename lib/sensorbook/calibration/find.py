"""From recordings of a hand-moved device to its rest positions, each of them checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensorbook.calibration.aside import (
    in_motion,
    require_labels,
    require_unit,
    saturated,
    turning,
    unused_labels,
)
from sensorbook.calibration.coverage import distinct
from sensorbook.calibration.known_directions import face
from sensorbook.calibration.model import FREE
from sensorbook.calibration.multi_position import multi_position, require_coverage
from sensorbook.calibration.positions import FACES, Positions, cut
from sensorbook.calibration.rests import (
    BRIEF,
    SHORTEST,
    THRESHOLDS,
    Scatter,
    quiet_spans,
    rolling_scatter,
)
from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.errors import InputError, Problem, Refusal
from sensorbook.recordings.clock import advancing
from sensorbook.recordings.recording import Recording

TILTED = 20.0  # degrees: farther from a face, and a rest is none of the six
ALIKE = 1.1  # times the smallest residual is as good as that
KEPT = 0.8  # of the most rests that any threshold finds: fewer, and a small residual is no merit


@dataclass(frozen=True, eq=False)
class Found:
    """The rests of an accelerometer's recordings, and the gyroscope's beside them.

    Attributes
    ----------
    positions : of the accelerometer, m/s²
    gyroscope : of the gyroscope during the same rests, rad/s; None where it was not recorded
    aside : (label, reason) of each rest that was found and not used
    scatters : by recording the rolling scatter of each sensor
    threshold : chosen, in units of the initial rest's scatter; None for rests labelled by hand
    short : quiet stretches too short to serve
    sweep : (threshold, rests, residual in m/s² or None where refused) of each that was tried
    """

    positions: Positions
    gyroscope: Positions | None
    aside: tuple[tuple[str, str], ...]
    scatters: tuple[tuple[Scatter, ...], ...]
    threshold: float | None
    sweep: tuple[tuple[float, int, float | None], ...]
    short: int = 0

    def __getitem__(self, rows) -> Found:
        gyroscope = None if self.gyroscope is None else self.gyroscope[rows]
        return replace(self, positions=self.positions[rows], gyroscope=gyroscope)


@dataclass(frozen=True, eq=False)
class _Run:
    """One recording ready for use: finite samples on an advancing clock, the gyroscope on its time."""

    recording: Recording
    time: np.ndarray
    values: np.ndarray
    temperature: np.ndarray | None
    turn_time: np.ndarray | None
    turn: np.ndarray | None

    def temperature_on_turn(self) -> np.ndarray | None:
        """The temperature on the gyroscope's time."""
        if self.temperature is None:
            return None
        return np.interp(self.turn_time, self.time, self.temperature)


def beside(accelerometer: Recording, gyroscopes: Sequence[Recording]) -> Recording | None:
    """The gyroscope's recording in the same time base: of the same file, or overlapping it."""
    for g in gyroscopes:
        if g.file == accelerometer.file and g.declaration.get(
            "table"
        ) == accelerometer.declaration.get("table"):
            return g
    return max(
        (g for g in gyroscopes if _overlap(accelerometer, g) > 0.8),
        key=lambda g: _overlap(accelerometer, g),
        default=None,
    )


def find_positions(
    accelerometers: Sequence[Recording], gyroscopes: Sequence[Recording], gravity: float
) -> Found:
    """Rests labelled by hand where the recordings have segments, otherwise the quiet stretches.

    A stretch is quiet where the scatter over half a second, of the accelerometer and of the gyroscope
    beside it, stays below a threshold relative to the initial rest. The threshold is chosen from
    `THRESHOLDS` by the residual of the calibration that follows.

    Raises
    ------
    InputError : the unit is wrong (at rest the readings are far from gravity)
    Refusal : no rest, or a recording too short
    """
    runs = [_prepare(a, beside(a, gyroscopes)) for a in accelerometers]
    scatters = tuple(_scatters(run) for run in runs)
    if all(a.segments for a in accelerometers):
        once = [list({(s.start, s.end): s for s in a.segments}.values()) for a in accelerometers]
        spans = [[(s.start, s.end) for s in segments] for segments in once]
        labels = [[s.label for s in segments] for segments in once]
        found = _cut(runs, spans, labels)
        require_labels(found[0], accelerometers)
        require_unit(found[0], runs, gravity)
        made = _without_bad(runs, *found, in_motion(found[0]), scatters, None)
        return replace(made, aside=made.aside + unused_labels(found[0], accelerometers))
    tried = []
    for threshold in THRESHOLDS:
        spans = [quiet_spans(s, threshold) for s in scatters]
        if any(spans):
            found = _cut(runs, spans, None)
            require_unit(found[0], runs, gravity)
            made = _without_bad(runs, *found, {}, scatters, threshold)
            tried.append((made, _residual(made.positions, gravity)))
    if not tried:
        raise Refusal(
            f"No rest of at least {SHORTEST:g} s was found in {', '.join(a.file for a in accelerometers)}.",
            "Lay the device down for at least 2 s in each position, without holding it.",
        )
    sweep = tuple((made.threshold, len(made.positions), r) for made, r in tried)
    most = max(len(made.positions) for made, _ in tried)
    usable = [
        (made, r) for made, r in tried if r is not None and len(made.positions) >= KEPT * most
    ]
    if usable:
        # The strictest that is as good as any: rests begin and end late, and nothing else is lost.
        least = min(r for _, r in usable)
        best = next(made for made, r in usable if r <= ALIKE * least)
    else:
        best = max((made for made, _ in tried), key=_variety)
    threshold = best.threshold or THRESHOLDS[0]
    brief = sum(
        len(quiet_spans(s, threshold, BRIEF)) - len(quiet_spans(s, threshold)) for s in scatters
    )
    return replace(best, sweep=sweep, short=brief)


def find_faces(recordings: Sequence[Recording], gravity: float) -> tuple[Found, np.ndarray]:
    """Rests of six-position recordings, named by the axis that is up, and their (P, 3) directions.

    Labelled rests keep their labels where these name a face; all others are named by what they read.
    The strictest threshold that finds all six faces is taken.

    Raises
    ------
    InputError : the unit is wrong, or a label contradicts the reading
    Refusal : no rest
    """
    runs = [_prepare(a, None) for a in recordings]
    scatters = tuple(_scatters(run) for run in runs)
    tried = []
    if all(a.segments for a in recordings):
        spans = [[(s.start, s.end) for s in a.segments] for a in recordings]
        labels = [[s.label for s in a.segments] for a in recordings]
        tried.append((None, _cut(runs, spans, labels)[0]))
    for threshold in THRESHOLDS if not tried else ():
        spans = [quiet_spans(s, threshold) for s in scatters]
        if any(spans):
            tried.append((threshold, _cut(runs, spans, None)[0]))
    if not tried:
        raise Refusal(
            f"No rest of at least {SHORTEST:g} s was found in {', '.join(a.file for a in recordings)}.",
            "Lay the device on each of its six faces for at least 2 s.",
        )
    best = None
    for threshold, positions in tried:
        require_unit(positions, runs, gravity)
        motion = in_motion(positions) if threshold is None else {}
        found = _without_bad(runs, positions, None, motion, scatters, threshold)
        named = _named(found, recordings[0].file)
        if best is None or len(set(map(tuple, named[1]))) > len(set(map(tuple, best[1]))):
            best = named
    return best


def _named(found: Found, file: str) -> tuple[Found, np.ndarray]:
    """The rests near a face, labelled by it; the others set aside."""
    names, keep, aside = [], [], list(found.aside)
    for label, mean in zip(found.positions.labels, found.positions.means, strict=True):
        up = mean / np.linalg.norm(mean)
        name = max(FACES, key=lambda n: up @ np.array(FACES[n]))
        angle = float(np.degrees(np.arccos(np.clip(up @ np.array(FACES[name]), -1, 1))))
        try:
            told = face(label)
        except KeyError:
            told = name
        if told != name:
            raise InputError(
                Problem(
                    file,
                    f"rest {label}",
                    f"is labelled {told!r}, but by its readings ({', '.join(f'{v:.2f}' for v in mean)} "
                    f"m/s²) it is {name!r}",
                    "mend the label, or the columns' order and signs",
                )
            )
        if angle > TILTED:
            aside.append((label, f"no axis is up or down: {name} is {angle:.0f}° away"))
        keep.append(angle <= TILTED)
        names.append(f"{name} {label[label.index('(') :]}" if "(" in label else name)
    rows = np.array(keep, dtype=bool)
    kept = found.positions[rows]
    labels = tuple(n for n, k in zip(names, keep, strict=True) if k)
    kept = replace(kept, labels=labels)
    directions = np.array([FACES[face(label)] for label in labels], dtype=float).reshape(-1, 3)
    return replace(found, positions=kept, aside=tuple(aside)), directions


def gyroscopes_of(device) -> tuple[Recording, ...]:
    """The gyroscope's recordings of positions; none where they cannot be read, which is theirs to say."""
    try:
        return (
            tuple(device.runs("gyroscope", "positions"))
            if "positions" in device.kinds("gyroscope")
            else ()
        )
    except InputError:
        return ()


def accelerometers_of(device, gyroscopes: Sequence[Recording]) -> tuple[Recording, ...]:
    """The accelerometer's recordings of positions in the same time base as the gyroscope's.

    Raises `Refusal` where there is none.
    """
    runs = (
        device.runs("accelerometer", "positions")
        if "positions" in device.kinds("accelerometer")
        else ()
    )
    found = tuple(a for a in runs if not a.declaration.get("check") and beside(a, gyroscopes))
    if not found:
        raise _no_accelerometer()
    return found


def _no_accelerometer() -> Refusal:
    return Refusal(
        "The gyroscope's recording has no accelerometer in the same time base, so that nothing says how "
        "far it was turned.",
        "Record both sensors in one file while the device is moved from rest to rest.",
    )


def require_gyroscope(found: Found) -> Positions:
    """The gyroscope's rests; raises `Refusal` where it was not recorded beside the accelerometer."""
    if found.gyroscope is None:
        raise _no_accelerometer()
    return found.gyroscope


def _variety(found: Found) -> int:
    means = found.positions.means
    return distinct(means / np.maximum(np.linalg.norm(means, axis=1), 1e-300)[:, None])


def _overlap(a: Recording, b: Recording) -> float:
    """Share of a's time that b covers, on the files' own clocks."""
    first, last = a.start + np.nanmin(a.time), a.start + np.nanmax(a.time)
    start, end = b.start + np.nanmin(b.time), b.start + np.nanmax(b.time)
    return (min(last, end) - max(first, start)) / max(last - first, 1e-12)


def _prepare(recording: Recording, turning: Recording | None) -> _Run:
    good = advancing(recording.time) & np.isfinite(recording.values).all(axis=1)
    if good.sum() < 50 or recording.rate is None:
        raise Refusal(
            f"{recording.file} holds {int(good.sum())} usable samples of the {recording.sensor}.",
            "Record at 20 Hz or more, for at least 2 s in each position.",
        )
    temperature = recording.temperature
    turn_time = turn = None
    if turning is not None:
        usable = advancing(turning.time) & np.isfinite(turning.values).all(axis=1)
        if usable.sum() >= 50 and turning.rate:
            turn_time = turning.time[usable] + turning.start - recording.start
            turn = turning.values[usable]
    return _Run(
        recording,
        recording.time[good],
        recording.values[good],
        None if temperature is None else temperature[good],
        turn_time,
        turn,
    )


def _scatters(run: _Run) -> tuple[Scatter, ...]:
    own = rolling_scatter("accelerometer", run.time, run.values, run.recording.rate)
    if run.turn is None:
        return (own,)
    rate = 1 / float(np.median(np.diff(run.turn_time)))
    return own, rolling_scatter("gyroscope", run.turn_time, run.turn, rate)


def _cut(runs, spans, labels) -> tuple[Positions, Positions | None]:
    positions = cut([(r.time, r.values, r.temperature) for r in runs], spans, labels)
    if any(r.turn is None for r in runs):
        return positions, None
    gyroscope = cut([(r.turn_time, r.turn, r.temperature_on_turn()) for r in runs], spans, labels)
    return positions, gyroscope if len(gyroscope) == len(positions) else None


def _without_bad(runs, positions, gyroscope, motion, scatters, threshold) -> Found:
    """Sets aside what is no rest, with the reason."""
    reasons = {**saturated(positions, runs), **turning(positions), **motion}
    for i, length in enumerate(np.linalg.norm(positions.means, axis=1)):
        if not 0.3 * STANDARD_GRAVITY < length < 3 * STANDARD_GRAVITY:
            reasons[i] = f"it reads {length:.3g} m/s², which is not gravity"
    for i, label_samples in enumerate(positions.samples):
        if len(label_samples) < 5:
            reasons.setdefault(i, f"it has {len(label_samples)} samples only")
    keep = np.array([i not in reasons for i in range(len(positions))], dtype=bool)
    aside = tuple((positions.labels[i], reasons[i]) for i in sorted(reasons))
    return Found(
        positions[keep],
        None if gyroscope is None else gyroscope[keep],
        aside,
        scatters,
        threshold,
        (),
    )


def _residual(positions: Positions, gravity: float) -> float | None:
    """Of the calibration that these rests give; None where they are refused."""
    try:
        require_coverage(positions, gravity, FREE[9])
        return multi_position(positions, gravity, check=False).rms_after
    except Refusal:
        return None
