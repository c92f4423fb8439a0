"""What time stamps tell: their order, the sampling rate, and where samples are missing."""

from __future__ import annotations

import numpy as np

_COUNTED = 6  # intervals
_SHUFFLED = 0.1  # of the steps go back, more than where a clock is set or a block is out of place …
_FAR = 10  # … by so many intervals, more than stamps of arrival jitter


def advancing(time: np.ndarray) -> np.ndarray:
    """(N,) true where a stamp lies beyond every earlier one; false for NaN."""
    latest = np.fmax.accumulate(time)
    advances = np.ones(len(time), dtype=bool)
    advances[1:] = ~(time[1:] <= latest[:-1])  # a NaN before the first stamp hides nothing
    return advances & np.isfinite(time)


def shuffled(time: np.ndarray) -> bool:
    """True where so many stamps (N,) go back, and so far, that the rows are out of order, not the clock."""
    known = time[np.isfinite(time)]
    with np.errstate(over="ignore", invalid="ignore"):  # absurd stamps
        steps = np.diff(known)
        back = -steps[steps < 0]
        if len(back) <= _SHUFFLED * len(steps):
            return False
        return bool(np.median(back) > _FAR * np.median(np.diff(np.sort(known))))


def measured_rate(time: np.ndarray, declared: float | None = None) -> float | None:
    """Sampling rate in Hz from stamps (N,) in s, whatever gaps and jitter they hold.

    `declared` (Hz) only decides where the stamps allow two readings.
    """
    stamps = time[advancing(time)]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        steps = np.diff(stamps)
        if not len(steps):
            return None
        typical = float(np.median(steps))
        regular = steps[np.abs(steps - typical) <= 0.6 * typical]
        confirmed = declared is not None and abs(typical * declared - 1) < 0.01
        if len(regular) < 0.9 * len(steps) and not confirmed:
            # A coarse clock at a rate it cannot tell: its stamps alternate between one step and two.
            regular = steps[steps <= 3 * typical]
        rate = 1 / regular.mean()
        if not np.isfinite(rate):
            return None
        intervals = 1 + missing_samples(stamps, rate)
        counted = intervals <= _COUNTED  # beyond, the count itself hangs on the rate
        if counted.any():
            rate = intervals[counted].sum() / steps[counted].sum()
    # Nine digits: what summation leaves beyond them is rounding.
    return float(f"{rate:.9g}") if np.isfinite(rate) else None


def missing_samples(time: np.ndarray, rate: float) -> np.ndarray:
    """(N − 1,) number of samples missing between neighbours of N advancing stamps (s) at `rate` (Hz).

    A sample late by less than an interval is jitter or a coarse clock, not a gap: what counts is how
    far the stamps after an interval stay behind those before it, on the mean of up to ten.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # absurd stamps
        intervals = np.diff(time) * rate
        missing = np.zeros(len(intervals), dtype=np.int64)
        candidates = np.flatnonzero(intervals > 1.5)
        if not len(candidates):
            return missing
        behind = (time - time[0]) * rate - np.arange(len(time))
        # Windows end where another sample is missing for certain: jitter below half an interval
        # stretches none to two.
        certain = np.concatenate(([-1], np.flatnonzero(intervals > 1.95), [len(time) - 1]))
        before = certain[np.searchsorted(certain, candidates) - 1]
        after = certain[np.searchsorted(certain, candidates, side="right")]
        window = np.arange(10)

        def mean(rows, inside):
            rows = np.where(inside, rows, 0)
            return np.where(inside, behind[rows], 0.0).sum(axis=1) / inside.sum(axis=1)

        earlier = candidates[:, None] - window
        later = candidates[:, None] + 1 + window
        jump = mean(later, later <= after[:, None]) - mean(earlier, earlier > before[:, None])
        # 10⁹ stands for any longer gap: none so long is bridged.
        jump = np.clip(np.nan_to_num(jump, nan=np.inf), 0, 1e9)
        missing[candidates] = np.rint(jump).astype(np.int64)
    return missing


def lost_samples(time: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows of advancing stamps (M,), and the number of samples lost between neighbours (M − 1,).

    Rows set aside are there, but for their stamps: those that stand in a gap, or whose stamps do, are
    not lost.
    """
    good = np.flatnonzero(advancing(time))
    missing = missing_samples(time[good], rate)
    if not missing.any():
        return good, missing
    aside = np.setdiff1d(np.flatnonzero(np.isfinite(time)), good)
    stands = np.searchsorted(good, aside) - 1
    says = np.searchsorted(time[good], time[aside]) - 1
    at = np.where(np.append(missing, 0)[stands] > 0, stands, says)
    at = at[(at >= 0) & (at < len(missing))]
    return good, np.maximum(missing - np.bincount(at, minlength=len(missing)), 0)


def duration_words(seconds: float) -> str:
    """A duration to three digits in the unit a reader would choose: `2 h`, `45.5 min`, `9.3 s`."""
    for unit, size, least in (("d", 86400, 172800), ("h", 3600, 7200), ("min", 60, 120)):
        if seconds >= least:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
