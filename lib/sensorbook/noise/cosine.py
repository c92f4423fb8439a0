"""Spectrum of a rest in cosine lines (DCT-II), gathered into bins for a likelihood.

The cosines ``√(2/n) cos(πj(k+½)/n)``, j = 1 … n−1, are the eigenvectors of white noise and of a random
walk less its mean: their lines are independent, and the variance of line j is that of the density at
``f_j = j/(2nδt)`` without leakage. (The periodogram takes the record for one turn of a loop; the step from a
walk's end to its start leaks over all frequencies and biases K by some 30 %.) Lines of flicker noise
are all but independent: correlations are below 0.13, and `flicker_lines` gives their exact variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft, special

BIN = 0.01  # width of a bin over its frequency; below 1/BIN lines each line is a bin of its own
NOTHING = 1e-30  # of the strongest bin's density: rounding


@dataclass(frozen=True, eq=False)
class CosineSpectrum:
    """Mean power of the cosine lines in each bin.

    Attributes
    ----------
    frequency : (F,) mean frequency of the bin's lines, Hz
    density : (F, A) two-sided density, signal unit²/Hz
    lines : (F,) lines in the bin, each of one degree of freedom
    flicker : (F,) variance of flicker noise over its density, see `flicker_lines`
    ramp : (F, A) mean product of the lines and those of a ramp of 1/s
    ramp_square : (F,) mean square of the latter
    samples, rate : of the record; rate in Hz
    """

    frequency: np.ndarray
    density: np.ndarray
    lines: np.ndarray
    flicker: np.ndarray
    ramp: np.ndarray
    ramp_square: np.ndarray
    samples: int
    rate: float


def cosine_spectrum(values: np.ndarray, rate: float) -> CosineSpectrum:
    """The binned cosine spectrum of an evenly sampled signal.

    Parameters
    ----------
    values : (N,) or (N, A) signal
    rate : Hz

    Examples
    --------
    White noise of density 0.01²/Hz:

    >>> values = 0.01 * np.sqrt(100.0) * np.random.default_rng(0).standard_normal(100_000)
    >>> s = cosine_spectrum(values, 100.0)
    >>> abs(np.average(s.density[:, 0], weights=s.lines) / 0.01**2 - 1) < 0.01
    np.True_
    """
    columns = np.asarray(values).reshape(len(values), -1).T
    n = columns.shape[1]
    j = np.arange(1, n)
    first, lines, flicker = _bins(n)

    def binned(quantity):
        return np.add.reduceat(quantity, first) / lines

    ramp = _ramp_lines(j, n, rate)
    density, product = [], []
    for column in columns:
        x = np.asarray(column, dtype=float)
        x = fft.dct(x - x.mean(), norm="ortho", overwrite_x=True)[1:] / np.sqrt(rate)
        product.append(binned(x * ramp))
        power = binned(np.square(x, out=x))
        # An alternating record has lines of exactly nothing, whose logarithm is none.
        density.append(np.maximum(power, NOTHING * power.max()))
    return CosineSpectrum(
        frequency=binned(j * (rate / (2 * n))),
        density=np.stack(density, axis=1),
        lines=lines,
        flicker=flicker,
        ramp=np.stack(product, axis=1),
        ramp_square=binned(ramp**2),
        samples=n,
        rate=rate,
    )


@lru_cache(maxsize=4)
def _bins(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First line of each bin of a record of n samples, counted from 0; its lines; its flicker."""
    first = np.unique(np.round(np.exp(np.arange(0, np.log(n), np.log1p(BIN)))).astype(np.int64))
    first = first[first < n] - 1
    lines = np.diff(np.append(first, n - 1))
    flicker = np.add.reduceat(flicker_lines(np.arange(1, n)), first) / lines
    for shared in (first, lines, flicker):
        shared.setflags(write=False)
    return first, lines, flicker


def flicker_lines(j: np.ndarray) -> np.ndarray:
    """Variance of line j of flicker noise over that of its density: ``2 Si(πj)/π − 2(1 − cos πj)/π²j``.

    From ``−4∫∫ cos πjt cos πju ln|t−u| dt du`` over the record, 0.774 for the first line and 1 for high ones.
    """
    j = np.asarray(j, dtype=float)
    return 2 / np.pi * special.sici(np.pi * j)[0] - 2 * (1 - np.cos(np.pi * j)) / (np.pi**2 * j)


def _ramp_lines(j: np.ndarray, n: int, rate: float) -> np.ndarray:
    """Lines of ``t``, scaled as those of the signal: ``−cos(x/2)/(2 sin²(x/2))`` for odd j, x = πj/n."""
    half = np.pi * j / (2 * n)
    odd = j % 2 == 1
    return np.where(odd, -np.cos(half) / (2 * np.sin(half) ** 2), 0.0) * np.sqrt(2 / n) / rate**1.5
