"""Uncertainty of an ellipsoid from readings whose errors are alike for seconds.

The field along a hand's path is not the same everywhere, and a magnetometer's noise is not white:
formal errors, which count every sample as new, are several times too small. Blocks of consecutive
samples are left out instead, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import fft

from sensorbook.magnetometer.ellipsoid import refine, residuals

MOST_BLOCKS, FEWEST_BLOCKS = 40, 8
TIMES = 10  # correlation times a block should last, so that neighbours are nearly independent
HELD_OUT = 5  # blocks of the held-out residual


def correlation_time(r: np.ndarray) -> float:
    """Integrated correlation time of a series (N,) in samples: 1 for white noise.

    Sum of the autocorrelation up to where a pair of neighbouring lags turns negative (Geyer 1992).
    """
    x = r - r.mean()
    n = fft.next_fast_len(2 * len(x), real=True)
    c = fft.irfft(np.abs(fft.rfft(x, n)) ** 2, n)[: len(x) // 2]
    if len(c) < 2 or c[0] <= 0:
        return 1.0
    pairs = (c[: len(c) // 2 * 2] / c[0]).reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    last = negative[0] if len(negative) else len(pairs)
    return max(1.0, float(2 * pairs[:last].sum() - 1))


def longest_correlation(jacobian: np.ndarray, scores: np.ndarray) -> float:
    """Longest correlation time, samples, of what the readings add to the parameters, each of (K).

    That of the residuals alone is too short: noise that is slow in the sensor's axes changes its sign in
    them with every turn, but not in the hard iron.
    """
    influence = scores @ np.linalg.pinv(jacobian.T @ jacobian)
    return max(correlation_time(column) for column in influence.T)


def number_of_blocks(count: int, time: float) -> int:
    """Blocks for `count` samples whose errors have a correlation time of `time` samples."""
    return min(count, int(np.clip(count / (TIMES * time), FEWEST_BLOCKS, MOST_BLOCKS)))


def jackknife(jacobian: np.ndarray, scores: np.ndarray, blocks: int) -> tuple[np.ndarray, int]:
    """Covariance (K, K) of the parameters, and degrees of freedom for Student's t.

    Delete-one-block jackknife of the linearised problem about the mean of the deleted fits (Shao and
    Tu 1995, 9.1; for clustered errors Bell and McCaffrey's CR3). Infinite where a block alone holds
    what determines a parameter.

    Parameters
    ----------
    jacobian : (N, K) derivatives of the residuals at the estimate, in the order of time
    scores : (N, K) each residual times its row of `jacobian`, whose sum the estimate makes zero
    blocks : number of blocks of consecutive rows
    """
    rows, k = jacobian.shape
    parts = [slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(rows), blocks)]
    squares = np.stack([jacobian[part].T @ jacobian[part] for part in parts])
    slopes = np.stack([scores[part].sum(axis=0) for part in parts])
    left = squares.sum(axis=0) - squares
    if np.linalg.cond(left).max() > 1e14:
        return np.full((k, k), np.inf), 1
    deleted = np.linalg.solve(left, slopes[..., None])[..., 0]
    deleted -= deleted.mean(axis=0)
    covariance = (blocks - 1) / blocks * deleted.T @ deleted
    return covariance, max(1, blocks - (k if blocks == rows else 1))


def held_out(
    m: np.ndarray,
    parameters: np.ndarray,
    basis: np.ndarray,
    kept: np.ndarray,
    parts: Sequence[np.ndarray],
    determined: Callable[[np.ndarray], bool] = lambda rows: True,
) -> np.ndarray:
    """(N,) residuals, each of `parts` (rows) judged by a fit to the kept readings of the others.

    NaN where the others do not determine a fit, by `determined` of their mask (N,).
    """
    r = np.full(len(m), np.nan)
    for part in parts:
        others = kept.copy()
        others[part] = False
        if determined(others):
            r[part] = residuals(m[part], refine(m[others], parameters, basis))[0]
    return r
