"""Allan deviation of a rate signal (A 5.13; IEEE Std 952-1997 annex C)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorbook.errors import Refusal

MINIMUM_SAMPLES = 1000  # below, not even three octaves of cluster times have an error under 20 %


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
    overlapping : whether every start sample was used
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


def allan_deviation(
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    overlapping: bool = True,
    phase: bool = False,
    sensor: str = "",
) -> AllanCurve:
    """Allan deviation of an evenly sampled signal.

    ``σ²(τ) = 1/(2 m² δt² (N−2m+1)) Σ (θ_{k+2m} − 2θ_{k+m} + θ_k)²`` with θ the running integral of
    the signal, over every start sample (overlapping, the default) or over every m-th one.

    Parameters
    ----------
    values : (N,) or (N, A) rate signal; with `phase` its integral, N + 1 samples
    rate : Hz
    clusters : cluster sizes m in samples; `cluster_sizes` where None
    overlapping : False gives the classical, non-overlapping estimator

    Raises
    ------
    Refusal
        fewer than 1000 samples where the cluster sizes are left to the function
    ValueError
        a cluster size below 1 or above N/2, or samples that are not finite

    Examples
    --------
    White noise of density N falls as N/√τ:

    >>> rng = np.random.default_rng(0)
    >>> curve = allan_deviation(0.01 * np.sqrt(100.0) * rng.standard_normal(100_000), 100.0)
    >>> abs(curve.at(1.0)[0] / 0.01 - 1) < 0.05
    np.True_
    """
    values = np.asarray(values, dtype=float)
    values = values[:, None] if values.ndim == 1 else values
    if not np.isfinite(values).all():
        raise ValueError("the signal holds samples that are not finite; bridge or cut them first")
    samples = len(values) - 1 if phase else len(values)
    if clusters is None:
        if samples < MINIMUM_SAMPLES:
            raise Refusal(
                f"The record has {samples} samples; the Allan deviation needs at least "
                f"{MINIMUM_SAMPLES}.",
                "Record a rest of one hour or more.",
            )
        clusters = cluster_sizes(samples, rate)
    clusters = np.asarray(clusters, dtype=np.int64)
    bad = clusters[(clusters < 1) | (2 * clusters > samples)]
    if bad.size:
        raise ValueError(
            f"cluster size {bad[0]} is outside 1 … {samples // 2}: two clusters must fit into "
            f"the record of {samples} samples"
        )
    if phase:
        theta = values * rate  # so that second differences count in samples
    else:
        theta = np.zeros((samples + 1, values.shape[1]))
        # Without the mean the running sum stays small and keeps its digits.
        np.cumsum(values - values.mean(axis=0), axis=0, out=theta[1:])
    theta = np.ascontiguousarray(theta.T)
    deviation = np.empty((len(clusters), values.shape[1]))
    terms = np.empty(len(clusters), dtype=np.int64)
    for i, m in enumerate(clusters):
        part = theta if overlapping else theta[:, ::m]
        n = m if overlapping else 1
        first = part[:, n:] - part[:, :-n]
        terms[i] = first.shape[1] - n
        for axis, row in enumerate(first):
            second = row[n:] - row[:-n]
            deviation[i, axis] = np.sqrt(second @ second / (2.0 * terms[i])) / m
    return AllanCurve(
        clusters / rate, clusters, deviation, terms, samples, rate, sensor, overlapping
    )
