"""Corrupt stretches, as a locked screen or a broken link leaves them: frozen, or implausible."""

from __future__ import annotations

import numpy as np

FROZEN = 0.5  # s with one and the same reading …
FROZEN_SAMPLES = 20  # … of at least so many samples
FROZEN_TIMES = 5  # … and so many times the longest run that is ordinary
FROZEN_SHARE = 0.3  # of the record: more, and the sensor itself is that quiet
# Beyond what a sensor of a device that is calibrated by hand reads, SI: 100 g; 6000 deg/s, more than
# the fastest gyroscopes' range; 0.1 T, at the face of a strong magnet.
IMPLAUSIBLE = {"accelerometer": 1000.0, "gyroscope": 105.0, "magnetometer": 0.1}
FEW = 0.1  # share of the samples: more, and unit or scale are wrong throughout


def implausible(values: np.ndarray, sensor: str) -> np.ndarray:
    """Rows of (N, 3) readings (SI) that the sensor cannot have read; () where most are so."""
    with np.errstate(invalid="ignore"):
        rows = (np.abs(values) > IMPLAUSIBLE[sensor]).any(axis=1)
    return np.flatnonzero(rows) if rows.mean() < FEW else np.empty(0, dtype=np.intp)


def frozen(values: np.ndarray, rate: float) -> list[tuple[int, int]]:
    """First and last row of each stretch of (N, 3) readings at `rate` (Hz) that repeats one reading.

    A sensor that is quiet beside its resolution repeats readings, too, but in runs of all lengths and
    for much of the time. Only runs far longer than all others count, where they are few.
    """
    same = np.r_[False, (values[1:] == values[:-1]).all(axis=1), False].astype(int)
    edges = np.diff(same)
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths = ends - starts + 1
    long = lengths > max(FROZEN * rate, FROZEN_SAMPLES)
    if not long.any() or lengths[long].sum() > FROZEN_SHARE * len(values):
        return []
    if lengths[long].min() < FROZEN_TIMES * lengths[~long].max(initial=1):
        return []
    return list(zip(starts[long].tolist(), ends[long].tolist(), strict=True))
