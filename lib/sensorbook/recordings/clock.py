"""What time stamps tell: which advance, the sampling rate, and where samples are missing."""

from __future__ import annotations

import numpy as np


def advancing(time: np.ndarray) -> np.ndarray:
    """(N,) true where a stamp lies beyond every earlier one; false for NaN."""
    latest = np.fmax.accumulate(time)
    advances = np.ones(len(time), dtype=bool)
    advances[1:] = ~(time[1:] <= latest[:-1])  # a NaN before the first stamp hides nothing
    return advances & np.isfinite(time)


def measured_rate(time: np.ndarray, declared: float | None = None) -> float | None:
    """Sampling rate in Hz from stamps (N,) in s, whatever gaps and jitter they hold.

    `declared` (Hz) only decides where the stamps allow two readings.
    """
    steps = np.diff(time[advancing(time)])
    if not len(steps):
        return None
    typical = float(np.median(steps))
    regular = steps[np.abs(steps - typical) <= 0.6 * typical]
    confirmed = declared is not None and abs(typical * declared - 1) < 0.01
    if len(regular) < 0.9 * len(steps) and not confirmed:
        # A coarse clock at a rate it cannot tell: its stamps alternate between one step and two.
        regular = steps[steps <= 3 * typical]
    with np.errstate(over="ignore"):
        rate = 1 / regular.mean()
    # Nine digits: what summation leaves beyond them is rounding.
    return float(f"{rate:.9g}") if np.isfinite(rate) else None


def missing_samples(time: np.ndarray, rate: float) -> np.ndarray:
    """(N − 1,) number of samples missing between neighbours of N advancing stamps (s) at `rate` (Hz).

    A sample late by less than an interval is jitter or a coarse clock, not a gap: what counts is how
    far the stamps after an interval stay behind those before it, over up to five on either side.
    """
    intervals = np.diff(time) * rate
    missing = np.zeros(len(intervals), dtype=np.int64)
    candidates = np.flatnonzero(intervals > 1.5)
    if not len(candidates):
        return missing
    behind = (time - time[0]) * rate - np.arange(len(time))
    before = np.concatenate(([-1], candidates[:-1]))  # windows end where another gap may be
    after = np.concatenate((candidates[1:], [len(time) - 1]))
    window = np.arange(5)

    def mean(rows, inside):
        rows = np.where(inside, rows, 0)
        return np.where(inside, behind[rows], 0.0).sum(axis=1) / inside.sum(axis=1)

    earlier = candidates[:, None] - window
    later = candidates[:, None] + 1 + window
    jump = mean(later, later <= after[:, None]) - mean(earlier, earlier > before[:, None])
    # 10⁹ stands for any longer gap: none so long is bridged.
    missing[candidates] = np.rint(np.clip(jump, 0, 1e9)).astype(np.int64)
    return missing
