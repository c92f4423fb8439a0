"""Allan deviation of a rate signal (A 5.13; IEEE Std 952-1997 annex C)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from numbers import Real

import numpy as np
import pandas as pd

from sensorbook.errors import Refusal

MINIMUM_SAMPLES = 1000  # below, not even three octaves of cluster times have an error under 20 %
EXACT_UP_TO = 2**17  # samples; beyond, start points are thinned unless asked otherwise
BLOCK = 2**15  # samples; with its differences a block stays within 1 MiB of second-level cache
SHORT = BLOCK // 8  # longest cluster whose first differences are taken once for both uses
# OpenBLAS sums longer vectors in several threads; on a busy machine that took thousands of times as long.
DOT = 2**13


@dataclass(frozen=True, eq=False)
class AllanCurve:
    """Allan deviation against cluster time.

    Attributes
    ----------
    tau : (T,) cluster times, s
    clusters : (T,) cluster sizes m, samples
    deviation : (T, A) Allan deviation, unit of the signal
    terms : (T,) number of second differences that were averaged
    samples : length N of the record
    rate : sampling rate, Hz
    sensor : name of the sensor, for field units; may be empty
    overlapping : False for the classical estimator, whose clusters follow one another
    """

    tau: np.ndarray
    clusters: np.ndarray
    deviation: np.ndarray
    terms: np.ndarray
    samples: int
    rate: float
    sensor: str = ""
    overlapping: bool = True

    def at(self, tau: float) -> np.ndarray:
        """(A,) deviation at `tau` (s), interpolated on the log–log curve."""
        return np.array(
            [np.exp(np.interp(np.log(tau), np.log(self.tau), np.log(y))) for y in self.deviation.T]
        )

    def to_frame(self) -> pd.DataFrame:
        """One row a cluster time, one column an axis, SI units."""
        names = list("xyz")[: self.deviation.shape[1]]
        return pd.DataFrame(self.deviation, index=pd.Index(self.tau, name="tau [s]"), columns=names)

    def _repr_html_(self) -> str:
        return self.to_frame().to_html(max_rows=12)


def cluster_sizes(samples: int, rate: float, per_octave: int = 4) -> np.ndarray:
    """Cluster sizes spaced by 2^(1/per_octave) around 1 s, from one sample to N/5.

    Beyond N/5 fewer than four independent differences are left and the estimate says little.
    """
    longest = samples // 5
    if longest < 1:
        return np.array([], dtype=int)
    k = np.arange(
        np.floor(-per_octave * np.log2(rate)), np.ceil(per_octave * np.log2(longest / rate)) + 1
    )
    m = np.unique(np.round(rate * 2.0 ** (k / per_octave)).astype(np.int64))
    return m[(m >= 1) & (m <= longest)]


def check_rate(rate: float) -> None:
    """ValueError where `rate` (Hz) is no sampling rate."""
    if not 0 < rate < math.inf:
        raise ValueError(f"rate {rate:g} Hz: give the sampling rate, above zero")


def whole_clusters(clusters: Iterable[int]) -> np.ndarray:
    """(T,) cluster sizes as integers; ValueError that names the first that is not a whole number."""
    clusters = list(clusters)
    for m in clusters:
        if not (isinstance(m, Real) and float(m).is_integer()):
            raise ValueError(f"cluster size {m} is not a whole number of samples")
    return np.array(clusters, dtype=np.int64)


def chosen_clusters(
    clusters: np.ndarray | None, samples: int, rate: float, span: int = 2
) -> np.ndarray:
    """(T,) cluster sizes asked for, or `cluster_sizes`, of which `span` must fit into the record.

    Raises
    ------
    Refusal
        fewer than 1000 samples where the cluster sizes are left to the function
    ValueError
        a rate that is not above zero, a cluster size below 1, above N/span or not whole
    """
    check_rate(rate)
    if clusters is None:
        if samples < MINIMUM_SAMPLES:
            raise Refusal(
                f"The record has {samples} samples; the Allan deviation needs at least "
                f"{MINIMUM_SAMPLES}.",
                "Record a rest of one hour or more.",
            )
        clusters = cluster_sizes(samples, rate)
    clusters = whole_clusters(clusters)
    bad = clusters[(clusters < 1) | (span * clusters > samples)]
    if bad.size:
        raise ValueError(
            f"cluster size {bad[0]} is outside 1 … {samples // span}: "
            f"{('two', 'three')[span - 2]} clusters must fit into the record of {samples} samples"
        )
    return clusters


def thinned(clusters: np.ndarray) -> np.ndarray:
    """(T,) distance of start points: the largest power of two up to m/16, or 1.

    Neighbouring second differences overlap so far that the rest add at most 0.5 % of information for
    white noise, less for flicker noise and random walk.
    """
    return 2 ** np.floor(np.log2(np.maximum(clusters / 16, 1))).astype(np.int64)


def squared_differences(
    theta: np.ndarray, clusters: np.ndarray, strides: np.ndarray, stop: int | None = None
) -> np.ndarray:
    """(T,) sums of the squared second differences of `theta` (P,) at lags `clusters`.

    Start points are 0, s, 2s … below `stop`, as far as two clusters reach. Cluster sizes of one
    stride take turns on each block of samples while it is in the cache.
    """
    sums = np.zeros(len(clusters))
    ends = len(theta) - 2 * clusters
    ends = ends if stop is None else np.minimum(ends, stop)
    for stride in np.unique(strides).tolist():
        members = [(i, int(clusters[i]), int(ends[i])) for i in np.flatnonzero(strides == stride)]
        count = max(BLOCK // stride, BLOCK // 8)  # fewer cost more in calls than in sums
        buffer, spare = np.empty(count), np.empty(count + SHORT)
        for first in range(0, max(end for _, _, end in members), count * stride):
            for i, m, end in members:
                last = min(first + count * stride, end)
                if last <= first:
                    continue
                middle = theta[first + m : last + m : stride]
                second = buffer[: len(middle)]
                if stride == 1 and m <= SHORT:
                    once = spare[: len(middle) + m]
                    np.subtract(theta[first + m : last + 2 * m], theta[first : last + m], out=once)
                    np.subtract(once[m:], once[:-m], out=second)
                else:
                    np.subtract(theta[first + 2 * m : last + 2 * m : stride], middle, out=second)
                    np.subtract(second, middle, out=second)
                    np.add(second, theta[first:last:stride], out=second)
                for j in range(0, len(second), DOT):
                    part = second[j : j + DOT]
                    sums[i] += part @ part
    return sums


def curve_from_sums(
    sums: np.ndarray,
    terms: np.ndarray,
    clusters: np.ndarray,
    samples: int,
    rate: float,
    sensor: str,
    overlapping: bool = True,
) -> AllanCurve:
    """The curve of (T, A) sums of `terms` squared second differences each, θ counted in samples."""
    deviation = np.sqrt(sums / (2.0 * terms[:, None])) / clusters[:, None]
    return AllanCurve(
        clusters / rate, clusters, deviation, terms, samples, rate, sensor, overlapping
    )


def as_columns(values: np.ndarray) -> np.ndarray:
    """(N, A) view of values (N,) or (N, A)."""
    values = np.asarray(values)
    return values[:, None] if values.ndim == 1 else values


def check_finite(values: np.ndarray, before: int = 0) -> None:
    """ValueError that names the first sample of `values` (N, A) that is not finite.

    `before` samples precede them in the record.
    """
    rows = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if rows.size:
        raise ValueError(
            "the signal holds samples that are not finite; bridge or cut them first "
            f"(the first is sample {before + rows[0]})"
        )


def integrate(column: np.ndarray, mean: float, theta: np.ndarray) -> None:
    """Continue the running integral: θ_{k+1} = θ_k + column_k − mean from the known ``theta[0]`` on.

    The sum of any type of number is in double precision, converted a block at a time.
    """
    for i in range(0, len(column), BLOCK):
        part = theta[1 + i : 1 + min(i + BLOCK, len(column))]
        np.subtract(column[i : i + BLOCK], mean, out=part, dtype=float)
        part[0] += theta[i]
        np.cumsum(part, out=part)


def running_integrals(values: np.ndarray, rate: float, phase: bool) -> Iterator[np.ndarray]:
    """θ (N + 1,) of one axis after the other, counted in samples, each in place of the one before."""
    means = values.mean(axis=0, dtype=float)
    if not np.isfinite(means).all():
        check_finite(values)
    theta = np.zeros(len(values) if phase else len(values) + 1)
    for column, mean in zip(values.T, means, strict=True):
        if phase:
            np.multiply(column, rate, out=theta, dtype=float)
        else:
            # Without the mean the running sum stays small and keeps its digits.
            integrate(column, mean, theta)
        yield theta


def allan_deviation(
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    overlapping: bool = True,
    phase: bool = False,
    exact: bool | None = None,
    sensor: str = "",
) -> AllanCurve:
    """Allan deviation of an evenly sampled signal.

    ``σ²(τ) = 1/(2 m² δt² (N−2m+1)) Σ (θ_{k+2m} − 2θ_{k+m} + θ_k)²`` with θ the running integral of
    the signal, over every start sample (overlapping, the default) or over every m-th one.

    Long records are thinned: from m = 32 on every s-th start sample is used, s the largest power of two
    up to m/16, and `terms` counts those. Up to m = N/5 that costs at most 0.5 % of the estimator's
    variance where white noise governs and less under flicker noise and random walk. Quantisation noise
    alone, which seldom governs beyond the shortest cluster times, has s times the variance: ask for
    `exact` there.

    Constant data give zeros, to within rounding.

    Memory beyond the input is one running integral in double precision, whatever the type and the
    number of axes. `allan_stream` is for records that do not fit into memory.

    Parameters
    ----------
    values : (N,) or (N, A) rate signal, of any real type; with `phase` its integral, N + 1 samples
    rate : Hz
    clusters : cluster sizes m in samples; `cluster_sizes` where None
    overlapping : False gives the classical, non-overlapping estimator
    exact : every start sample (True) or thinned (False); None: exact up to 2¹⁷ samples

    Raises
    ------
    Refusal
        fewer than 1000 samples where the cluster sizes are left to the function
    ValueError
        a rate that is not above zero; a cluster size below 1, above N/2 or not whole; samples that are
        not finite

    Examples
    --------
    White noise of density N falls as N/√τ:

    >>> rng = np.random.default_rng(0)
    >>> curve = allan_deviation(0.01 * np.sqrt(100.0) * rng.standard_normal(100_000), 100.0)
    >>> abs(curve.at(1.0)[0] / 0.01 - 1) < 0.05
    np.True_
    """
    values = as_columns(values)
    samples = len(values) - 1 if phase else len(values)
    clusters = chosen_clusters(clusters, samples, rate)
    if not overlapping:
        strides = clusters
    elif exact or (exact is None and samples <= EXACT_UP_TO):
        strides = np.ones_like(clusters)
    else:
        strides = thinned(clusters)
    sums = np.empty((len(clusters), values.shape[1]))
    for axis, theta in enumerate(running_integrals(values, rate, phase)):
        sums[:, axis] = squared_differences(theta, clusters, strides)
    terms = (samples - 2 * clusters) // strides + 1
    return curve_from_sums(sums, terms, clusters, samples, rate, sensor, overlapping)
