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


def merged(values: np.ndarray, rate: float) -> str:
    """What shows that (N, 3) readings at `rate` (Hz) were merged from a table of another rate; else "".

    >>> rng = np.random.default_rng(0)
    >>> merged(np.repeat(rng.normal(size=(500, 3)), 2, axis=0), 200.0)[:48]
    'each reading stands in 2 rows on the mean, regul'
    """
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite)
    if len(rows) < FEWEST:
        return ""
    within = rows[-1] + 1
    if within < (1 - ENDED) * len(values):
        # The readings that are there stand row by row beside another table's.
        return (f"its readings end at row {within} of {len(values)}: joined row by row with a longer "
                "table, whose time is not its own where it was sampled faster or slower")  # fmt: skip
    if len(rows) < (1 - EMPTY) * within:
        steps = np.diff(rows)
        if _regular(steps):
            return (f"one row in {_number(steps.mean())} holds a reading, at regular places: a table of "
                    f"{_number(rate / steps.mean())} Hz in rows of {_number(rate)} Hz")  # fmt: skip
        return ""
    readings = values[finite]
    changes = np.flatnonzero((readings[1:] != readings[:-1]).any(axis=1)) + 1
    runs = np.diff(changes)  # the first and the last may be cut
    if len(runs) < FEWEST:
        return ""
    runs = runs[runs <= 4 * np.median(runs)]  # a stretch frozen besides
    mean = float(runs.mean())
    if mean < REPEATED or not _regular(runs):
        return ""
    return (f"each reading stands in {_number(mean)} rows on the mean, regularly: a table of "
            f"{_number(rate / mean)} Hz in rows of {_number(rate)} Hz")  # fmt: skip


def _regular(runs: np.ndarray) -> bool:
    """True for run lengths that a second clock makes, rather than chance."""
    mean = runs.mean()
    return bool(runs.var() < REGULAR * mean * (mean - 1))


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
