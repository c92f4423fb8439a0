"""Finds the rests of a hand-moved recording (B, beyond): quiet beside the quietest, long, and still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

WINDOW = 0.5  # s, over which the scatter is taken
SHORTEST = 1.0  # s; the mean of less is no better than the hand that holds it
BRIEF = 0.1  # s; a rest of which so little is seen free of its ends lasted over half a second
THRESHOLDS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0)  # times the scatter of the initial rest
INITIAL = 5.0  # s at the start that serve as the initial rest, where they are quiet
STILL = 0.3  # degrees: a mean that moves by more within a rest is a slow turn
FEWEST_SAMPLES = 10  # in a window


@dataclass(frozen=True, eq=False)
class Scatter:
    """Rolling scatter of a sensor's samples, relative to its initial rest.

    Attributes
    ----------
    time : (N,) s
    ratio : (N,) standard deviation over `WINDOW` seconds, all axes, over that of the initial rest
    quiet : standard deviation of the initial rest, in the sensor's unit
    initial : s, span of that rest; (nan, nan) where the recording does not begin with one and the
        quietest tenth of it serves
    """

    sensor: str
    time: np.ndarray
    ratio: np.ndarray
    quiet: float
    initial: tuple[float, float]


def rolling_scatter(sensor: str, time: np.ndarray, values: np.ndarray, rate: float) -> Scatter:
    """The scatter of (N, 3) readings around each sample; N at least one window."""
    width = max(FEWEST_SAMPLES, round(WINDOW * rate)) | 1
    centred = values - np.median(values, axis=0)

    def mean(x):
        return ndimage.uniform_filter1d(x, width, axis=0, mode="nearest")

    variance = np.maximum(mean(centred**2) - mean(centred) ** 2, 0).sum(axis=1)
    # Rounding leaves a converter's step of scatter at least, or a rest of equal counts would be
    # quieter than any.
    steps = np.diff(np.unique(values[:, 0]))
    step = steps[steps > 0].min() if (steps > 0).any() else 0.0
    scatter = np.sqrt(variance + step**2 / 12)
    half = width // 2
    leading = scatter[half : max(half + 1, round(INITIAL * rate))]
    quietest = float(np.quantile(scatter[half : len(scatter) - half or None], 0.1))
    quiet, initial = quietest, (np.nan, np.nan)
    if len(leading) and np.quantile(leading, 0.9) < 3 * max(quietest, 1e-300):
        quiet = float(np.median(leading))
        loud = np.flatnonzero(scatter[half:] > 4 * quiet)
        last = half + (loud[0] if len(loud) else len(scatter) - half) - 1
        initial = (float(time[0]), float(time[min(last, len(time) - 1)]))
    if not quiet:
        quiet = float(scatter[scatter > 0].min()) if (scatter > 0).any() else 1.0
    return Scatter(sensor, time, scatter / quiet, quiet, initial)


def quiet_spans(
    scatters: Sequence[Scatter], threshold: float, least: float = SHORTEST
) -> list[tuple[float, float]]:
    """Start and end (s) of each stretch of at least `least` seconds where every sensor is quiet.

    The first of `scatters` gives the time base. A window that is quiet throughout leaves half its
    width free of motion on both sides, so that nothing needs to be trimmed.
    """
    first = scatters[0]
    quiet = first.ratio < threshold
    for other in scatters[1:]:
        quiet &= np.interp(first.time, other.time, other.ratio) < threshold
    gap = np.r_[False, np.diff(first.time) > WINDOW]  # a rest does not reach over missing samples
    edges = np.flatnonzero(np.diff(np.r_[0, (quiet & ~gap).astype(int), 0]))
    spans = [(float(first.time[a]), float(first.time[b - 1])) for a, b in edges.reshape(-1, 2)]
    return [span for span in spans if span[1] - span[0] >= least]
