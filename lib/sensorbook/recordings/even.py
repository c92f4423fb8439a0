"""From stamped samples to an even time base: what is set aside and bridged, and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sensorbook.errors import Refusal
from sensorbook.recordings.clock import advancing, missing_samples, shuffled
from sensorbook.recordings.recording import Recording

MINIMUM_SAMPLES = 100
BRIDGED_INTERVALS = 5  # a gap is short up to so many intervals …
BRIDGED_SECONDS = 0.1  # … or so many seconds, whichever is longer
BRIDGED_SHARE = 0.01  # and all short gaps together may be so much of the record


def evenly_sampled(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """See `Recording.evenly_sampled`."""
    if recording.rate is None:
        raise Refusal(
            f"{recording.file} has no time base: neither a rate nor a time column is declared.",
            "Declare rate = … (Hz) or columns.time in device.toml.",
        )
    done: list[str] = []
    rows = np.ones(len(recording), dtype=bool)

    stamped = advancing(recording.time)
    if not stamped.all():
        rows &= stamped
        done.append(f"{_rows(len(rows) - rows.sum())} whose time stamp does not advance set aside.")
    complete = np.isfinite(recording.values).all(axis=1)
    incomplete = int(np.count_nonzero(rows & ~complete))
    rows &= complete
    if rows.all() and not recording.gaps:
        _check_enough(recording, len(recording), "")
        return recording, ()

    kept = np.flatnonzero(rows)
    steps = 1 + missing_samples(recording.time[kept], recording.rate)  # in sampling intervals
    # A gap k intervals long misses k − 1 samples.
    longest_bridged = max(BRIDGED_INTERVALS, round(BRIDGED_SECONDS * recording.rate))
    first, last = _longest_stretch(steps <= longest_bridged)
    missing = int((steps[first:last] - 1).sum())
    if missing > BRIDGED_SHARE * (last - first + 1 + missing):
        first, last = _longest_stretch(steps == 1)
        missing = 0
    if missing:
        gaps = int(np.count_nonzero(steps[first:last] > 1))
        what = f" ({_rows(incomplete)} without a value among them)" if incomplete else ""
        done.append(
            f"{missing} missing sample{'s' * (missing > 1)} in {gaps} short "
            f"gap{'s' * (gaps > 1)}{what} bridged linearly."
        )
    elif incomplete:
        done.append(f"{_rows(incomplete)} without a value left out.")
    used = last - first + 1
    if used < len(kept):
        start, end = recording.time[kept[first]], recording.time[kept[last]]
        done.append(
            f"The longest stretch without a gap is used: {start:.6g} s to {end:.6g} s, "
            f"{used} of {len(recording)} samples."
        )
    _check_enough(recording, used, " ".join(d for d in done if "is used" not in d))

    kept = kept[first : last + 1]
    position = np.concatenate(([0], np.cumsum(steps[first:last])))
    grid = np.arange(position[-1] + 1)

    def even(column):
        good = np.isfinite(column)
        if not good.any():
            return np.full(len(grid), np.nan)
        return np.interp(grid, position[good], column[good])

    values = np.stack([even(column) for column in recording.values[kept].T], axis=1)
    temperature = recording.temperature
    if temperature is not None:
        temperature = even(temperature[kept])
    time = recording.time[kept[0]] + grid / recording.rate
    return replace(recording, time=time, values=values, temperature=temperature), tuple(done)


def _longest_stretch(joined: np.ndarray) -> tuple[int, int]:
    """First and last index of the longest run of samples whose neighbours are `joined`."""
    breaks = np.concatenate(([-1], np.flatnonzero(~joined), [len(joined)]))
    longest = int(np.argmax(np.diff(breaks)))
    return int(breaks[longest]) + 1, int(breaks[longest + 1])


def _check_enough(recording: Recording, used: int, done: str) -> None:
    if used < MINIMUM_SAMPLES or 2 * used < len(recording):
        mends = [f.remedy for f in recording.findings if f.kind == "backward" and f.remedy]
        if not mends and shuffled(recording.time):
            mends = ["sort the file's rows by time"]
        mend = mends[0] if mends else "record again without losses"
        raise Refusal(
            f"{recording.file} has no even time base: only {used} of {len(recording)} samples of the "
            f"{recording.sensor} follow one another without a gap. {done}".rstrip(),
            f"{mend[0].upper()}{mend[1:]}.",
        )


def _rows(count) -> str:
    return "1 row" if count == 1 else f"{count} rows"
