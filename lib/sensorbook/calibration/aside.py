"""What is no rest though it was found or labelled as one, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.calibration.positions import Positions
from sensorbook.calibration.rests import STILL
from sensorbook.errors import InputError, Problem
from sensorbook.recordings.recording import Recording

IN_MOTION = 5.0  # times the scatter of the quietest rests: a labelled rest that was none
RESOLVED = 4  # values in a typical rest: fewer, and the converter is coarser than the noise
SATURATED = 0.2  # share of a rest's samples at the recording's very extreme


def require_unit(positions: Positions, runs, gravity: float) -> None:
    """Raises `InputError` where rests are far from gravity: a wrong unit or scale."""
    length = float(np.median(np.linalg.norm(positions.means, axis=1)))
    if 0.5 * gravity < length < 1.7 * gravity:
        return
    recording = runs[0].recording
    unit = recording.declaration.get("unit", recording.unit)
    mend = "check unit and scale"
    if 0.5 < length < 1.7:
        mend = 'that is 1 g: declare unit = "g"'
    elif 0.5 < length / gravity**2 < 1.7:
        mend = 'gravity was multiplied twice: declare unit = "m/s^2"'
    raise InputError(
        Problem(
            recording.file,
            "unit",
            f"at rest the accelerometer reads {length:.3g} m/s² with unit {unit!r}, "
            f"but gravity is {gravity:.3g} m/s²",
            mend,
        )
    )


def in_motion(positions: Positions) -> dict[int, str]:
    """Rests labelled by hand during which the device was moved."""
    scatter = np.array([np.sqrt(s.var(axis=0).sum()) for s in positions.samples])
    quiet = np.quantile(scatter, 0.25)
    return {
        i: f"the device was in motion: its readings scatter {scatter[i] / quiet:.0f} times as much as in "
        "the quietest rests"
        for i in np.flatnonzero(scatter > IN_MOTION * quiet)
    }


def require_labels(positions: Positions, recordings: Sequence[Recording]) -> None:
    """Raises `InputError` where no label holds a sample of its recording."""
    if not len(positions):
        first = recordings[0]
        ends = f"{np.nanmin(first.time):.6g} to {np.nanmax(first.time):.6g} s"
        raise InputError(
            Problem(
                first.file, "segments", f"no label lies within the recording, which lasts from {ends}",
                "give start and end in the recording's own time and time_unit",
            )
        )  # fmt: skip


def unused_labels(
    positions: Positions, recordings: Sequence[Recording]
) -> tuple[tuple[str, str], ...]:
    """Labels that hold no sample."""
    spans = zip(positions.runs, positions.spans, strict=True)
    used = {(int(r), float(a), float(b)) for r, (a, b) in spans}
    return tuple(
        (f"{s.label} ({s.start:.1f}–{s.end:.1f} s)", "it holds no sample of the recording")
        for r, recording in enumerate(recordings)
        for s in recording.segments
        if (r, s.start, s.end) not in used
    )


def saturated(positions: Positions, runs) -> dict[int, str]:
    """Rests at the end of the range: an extreme that is reached elsewhere, too, and never passed.

    A converter coarser than the noise reads one or two values in every rest, which says nothing.
    """
    found = {}
    if not len(positions):
        return found
    resolved = [
        np.median([len(np.unique(s[:, axis])) for s in positions.samples]) >= RESOLVED
        for axis in range(3)
    ]
    for r, run in enumerate(runs):
        for axis in np.flatnonzero(resolved):
            for i in np.flatnonzero(positions.runs == r):
                if not np.ptp(positions.samples[i][:, axis]):
                    value = positions.samples[i][0, axis]
                    found[i] = (
                        f"{'xyz'[axis]} reads {value:.5g} m/s² throughout, as no working sensor does: it is "
                        "saturated or frozen; choose a wider range"
                    )
            column = run.values[:, axis]
            for extreme in (column.max(), column.min()):
                places = np.flatnonzero(np.diff(np.r_[False, column == extreme].astype(int)) == 1)
                for i in np.flatnonzero(positions.runs == r):
                    share = float(np.mean(positions.samples[i][:, axis] == extreme))
                    # Once is enough where nothing but the extreme is read.
                    if share > SATURATED and (len(places) > 1 or share > 0.9):
                        found[i] = (
                            f"{'xyz'[axis]} is saturated: {100 * share:.0f} % of its samples are at "
                            f"{extreme:.5g} m/s², which the recording never passes; choose a wider range"
                        )
    return found


def turning(positions: Positions) -> dict[int, str]:
    """Rests during which the mean direction moves: a slow hand, not a table."""
    found = {}
    for i, samples in enumerate(positions.samples):
        n = len(samples) // 3
        if n < 5:
            continue
        first, last = samples[:n].mean(axis=0), samples[-n:].mean(axis=0)
        noise = np.sqrt(2 * samples.var(axis=0).sum() / n)
        moved = np.linalg.norm(last - first)
        angle = np.degrees(moved / max(np.linalg.norm(samples.mean(axis=0)), 1e-300))
        if angle > STILL and moved > 5 * noise:
            found[i] = f"the device was turned by {angle:.1f}° meanwhile"
    return found
