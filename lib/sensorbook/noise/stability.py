"""Relatives of the Allan deviation: modified, Hadamard and total (NIST SP 1065, chapter 5).

Each is the Allan sum of a series derived from the running integral θ, over every start sample. The
curves are not Allan curves of the noise terms: `fit_terms` and `confidence_limits` do not hold for them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sensorbook.noise.allan import (
    AllanCurve,
    as_columns,
    chosen_clusters,
    curve_from_sums,
    integrate,
    running_integrals,
    squared_differences,
)


def modified_allan_deviation(
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    phase: bool = False,
    sensor: str = "",
) -> AllanCurve:
    """``σ²(τ) = 1/(2 m⁴ δt² n) Σ_j (Σ_{i<m} θ_{j+i+2m} − 2θ_{j+i+m} + θ_{j+i})²``, n = N − 3m + 2.

    θ is averaged over a cluster before it is differenced, which tells white noise of θ, as quantisation
    is (slope −3/2), from its flicker noise (−1). Arguments and errors as `allan_deviation`; m up to N/3.
    """
    return _curve(_moving_means, values, rate, clusters, phase, sensor, span=3)


def hadamard_deviation(
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    phase: bool = False,
    sensor: str = "",
) -> AllanCurve:
    """``σ²(τ) = 1/(6 m² δt² n) Σ_k (θ_{k+3m} − 3θ_{k+2m} + 3θ_{k+m} − θ_k)²``, n = N − 3m + 1.

    A rate ramp has no effect on it. Arguments and errors as `allan_deviation`; m up to N/3.
    """
    return _curve(_increments, values, rate, clusters, phase, sensor, span=3)


def total_deviation(
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    phase: bool = False,
    sensor: str = "",
) -> AllanCurve:
    """``σ²(τ) = 1/(2 m² δt² n) Σ_k (θ_{k+m} − 2θ_k + θ_{k−m})²`` at the n = N − 1 inner points of θ.

    θ is continued beyond its ends by its reflection in them. That steadies long cluster times at the
    price of a bias: of the Allan variance E{σ²} is 1 − a m/N, with a = 0 for white noise, 1/(3 ln 2) for
    flicker noise and 3/4 for a random walk. Arguments and errors as `allan_deviation`; m up to N/2.
    """
    return _curve(_reflected, values, rate, clusters, phase, sensor, span=2)


def _moving_means(theta: np.ndarray, m: int) -> np.ndarray:
    total = np.zeros(len(theta) + 1)
    integrate(theta, theta.mean(), total)
    return (total[m:] - total[:-m]) / m


def _increments(theta: np.ndarray, m: int) -> np.ndarray:
    return (theta[m:] - theta[:-m]) / np.sqrt(3)


def _reflected(theta: np.ndarray, m: int) -> np.ndarray:
    before, after = theta[1:m][::-1], theta[-m:-1][::-1]
    return np.concatenate([2 * theta[0] - before, theta, 2 * theta[-1] - after])


def _curve(
    series: Callable[[np.ndarray, int], np.ndarray],
    values: np.ndarray,
    rate: float,
    clusters: np.ndarray | None,
    phase: bool,
    sensor: str,
    span: int,
) -> AllanCurve:
    values = as_columns(values)
    samples = len(values) - 1 if phase else len(values)
    clusters = chosen_clusters(clusters, samples, rate, span)
    sums = np.empty((len(clusters), values.shape[1]))
    terms = np.empty(len(clusters), dtype=np.int64)
    every = np.ones(1, dtype=np.int64)
    for axis, theta in enumerate(running_integrals(values, rate, phase)):
        for i, m in enumerate(clusters):
            y = series(theta, m)
            terms[i] = len(y) - 2 * m
            sums[i, axis] = squared_differences(y, clusters[i : i + 1], every)[0]
    return curve_from_sums(sums, terms, clusters, samples, rate, sensor)
