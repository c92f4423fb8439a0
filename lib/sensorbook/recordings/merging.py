"""Rates merged wrongly: rows of one sensor at the stamps of another, repeated or left empty.

A recorder's own CSV often joins its sensors' tables: each slow reading is repeated until the next, or
stands between empty cells, or the shorter table ends before the longer one.
"""

from __future__ import annotations

import numpy as np

FEWEST = 20  # readings that show a pattern
REPEATED = 1.25  # rows a reading, on the mean: fewer, and nothing is lost by it
# Variance of the run lengths over that of chance. Readings that equal their neighbours by chance come
# in runs with the variance m (m − 1) for a mean of m; where another clock repeats them it is 1/4 at most.
REGULAR = 0.5
EMPTY = 0.3  # share of rows
ENDED = 0.05  # share of rows after the last reading


def merged(values: np.ndarray, time: np.ndarray) -> str:
    """What shows that (N, 3) readings at (N,) stamps (s) come from a table of another rate; else "".

    >>> rng = np.random.default_rng(0)
    >>> merged(np.repeat(rng.normal(size=(500, 3)), 2, axis=0), np.arange(1000) / 200)
    'each reading stands in 2 rows, regularly: it is sampled at about 100 Hz, and repeated in faster rows'
    """
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite)
    if len(rows) < FEWEST:
        return ""
    within = rows[-1] + 1
    if within < (1 - ENDED) * len(values):
        return (f"its readings end at row {within} of {len(values)}: joined row by row with a longer "
                "table, whose stamps may not be its own")  # fmt: skip
    if len(rows) < (1 - EMPTY) * within:
        if not _regular(np.diff(rows)):
            return ""
        share = f"one row in {np.diff(rows).mean():.3g} holds a reading"
        return f"{share}, regularly: {_sampled(time[rows])}, in a faster table"
    readings, stamps = (values, time) if finite.all() else (values[finite], time[finite])
    changed = np.zeros(len(readings) - 1, dtype=bool)
    for column in readings.T:  # a tenth of the time that `any` takes over three columns
        changed |= column[1:] != column[:-1]
    changes = np.flatnonzero(changed) + 1
    runs = np.diff(changes)  # the first and the last may be cut
    if len(runs) < FEWEST:
        return ""
    runs = runs[runs <= 4 * np.median(runs)]  # but for a stretch that is frozen besides
    if runs.mean() < REPEATED or not _regular(runs):
        return ""
    return (f"each reading stands in {runs.mean():.3g} rows, regularly: {_sampled(stamps[changes])}, and "
            "repeated in faster rows")  # fmt: skip


def _regular(runs: np.ndarray) -> bool:
    """True for run lengths that a second clock makes, rather than chance."""
    mean = runs.mean()
    return bool(runs.var() < REGULAR * mean * (mean - 1))


def _sampled(stamps: np.ndarray) -> str:
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if not len(steps):
        return "it is sampled slowly"
    # Two readings that are equal by chance make one step of two.
    step = steps[steps <= 1.6 * np.median(steps)].mean()
    return f"it is sampled at about {1 / step:.3g} Hz"
