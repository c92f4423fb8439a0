"""Covariance of Allan variance estimates at different cluster times.

Overlapping estimates at neighbouring cluster times come from the same samples and are strongly
correlated; a fit that takes them for independent states intervals several times too small. For a
Gaussian process the covariance of two mean squares is ``2/(M₁M₂) Σₖ Σₗ R₁₂(k−l)²`` (Isserlis), with R₁₂ the
covariance of the second differences of the running integral θ. These are linear in each term's
generalised covariance of θ:

    quantisation Q² δ(s) · white −N²|s|/2 · flicker B² s² ln|s| / 2π · random walk K²|s|³/12

whose second differences reproduce the variances of table A6.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sensorbook.shared import shared

RANDOM_TERMS = ("quantization", "random_walk", "bias_instability", "rate_random_walk")
_DIFFERENCE = np.array([1.0, -2.0, 1.0])
_COEFFICIENTS = np.outer(_DIFFERENCE, _DIFFERENCE).ravel()
_GAUSS = np.polynomial.legendre.leggauss(6)
SUMMED = 16  # longest cluster, in samples, whose lags are summed one by one


def _generalised(s: np.ndarray) -> np.ndarray:
    """(4, …) generalised covariance of θ for unit Q², N², B², K²; `s` in samples, δt = 1."""
    size = np.abs(s)
    square = size * size
    log = np.log(np.where(size == 0, 1.0, size))
    return np.stack([size == 0, -size / 2, square * log / (2 * np.pi), size * square / 12])


def _second_differences(lags: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """(4, L) covariance of the two second differences at each lag, by term."""
    return np.einsum("s,asl->al", _COEFFICIENTS, _generalised(lags + shifts[:, None]))


def _nodes(m1: int, m2: int, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Lags in samples and their weights, for sums over all lags from `first` to `last`.

    Around the kinks of R₁₂ short clusters are summed lag by lag; elsewhere, and for long clusters,
    the sum is an integral, by Gauss's rule from kink to kink (exact for the polynomial terms).
    """
    # of R₁₂; those of the number of pairs are 0 and `first + last`
    kinks = (np.arange(3) * m2 - np.arange(3)[:, None] * m1).ravel()
    tails = m2 * np.array([0.25, 1, 3, 8])  # flicker noise alone reaches beyond the kinks
    edges = [kinks, kinks.min() - tails, kinks.max() + tails, [0, first + last]]
    edges = np.unique(np.concatenate(edges).clip(first, last))
    if m1 > SUMMED:
        centre, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        lags = (centre[:, None] + half[:, None] * _GAUSS[0]).ravel()
        return lags, (half[:, None] * _GAUSS[1]).ravel()
    near = np.unique((np.arange(-3 * m1, m1 + 1) + np.arange(3)[:, None] * m2).ravel())
    near = near[(near >= first) & (near <= last)]
    # The stretches between, half a lag beyond the last summed one.
    ends = np.unique(np.concatenate([edges, near - 0.5, near + 0.5]))
    centre, half = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
    between = ~np.isin(np.round(centre), near)
    centre, half = centre[between, None], half[between, None]
    lags = np.concatenate([near, (centre + half * _GAUSS[0]).ravel()])
    return lags, np.concatenate([np.ones(len(near)), (half * _GAUSS[1]).ravel()])


@lru_cache(maxsize=8)
@shared
def _kernels(clusters: tuple[int, ...], samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Pair sums (T, T, 4, 4) of R_a R_b and (T, T, 4) of R_a, per unit coefficient, δt = 1."""
    count = len(clusters)
    products = np.zeros((count, count, 4, 4))
    sums = np.zeros((count, count, 4))
    for i, m1 in enumerate(clusters):
        for j in range(i, count):
            m2 = clusters[j]
            n1, n2 = samples - 2 * m1 + 1, samples - 2 * m2 + 1
            shifts = (np.arange(3)[:, None] * m1 - np.arange(3) * m2).ravel()
            lags, weights = _nodes(m1, m2, -n2, n1)  # no pair at either end
            r = _second_differences(lags, shifts)

            def pairs(lag, n1=n1, n2=n2):
                # (k, l) with k − l = lag, over both estimates' start samples
                return np.minimum(n1, n2 + lag) - np.maximum(0, lag)

            w = np.maximum(pairs(lags), 0) * weights
            product, total = np.einsum("l,al,bl->ab", w, r, r), r @ w
            # Quantisation acts at single lags and is summed there, not integrated.
            single = np.unique(-shifts)
            at = _second_differences(single, shifts)
            w = np.maximum(pairs(single), 0)
            point = np.einsum("l,al,bl->ab", w, at, at)
            product[0], product[:, 0], total[0] = point[0], point[:, 0], at[0] @ w
            scale = 1.0 / (n1 * n2 * (m1 * m2) ** 2)
            products[i, j] = products[j, i] = product * scale
            sums[i, j] = sums[j, i] = total / (n1 * n2 * m1 * m2)
    return products, sums


def variance_covariance(
    clusters: np.ndarray, samples: int, rate: float, squares: dict[str, float]
) -> np.ndarray:
    """Covariance (T, T) of overlapping Allan variance estimates under given noise terms.

    Parameters
    ----------
    clusters : (T,) cluster sizes, samples
    samples : length of the record
    rate : Hz
    squares : squared coefficients Q², N², B², K², R² in SI by name; absent means zero
    """
    products, sums = _kernels(tuple(int(m) for m in clusters), int(samples))
    dt = 1.0 / rate
    # From δt = 1 to seconds: θ counts samples, so each term scales by its own power of δt.
    scale = np.array([1 / dt**2, 1 / dt, 1.0, dt])
    c = scale * np.array([max(squares.get(name, 0.0), 0.0) for name in RANDOM_TERMS])
    result = np.einsum("ijab,a,b->ij", products, c, c) / 2
    ramp = max(squares.get("rate_ramp", 0.0), 0.0)
    if ramp:
        # The mean square of noise n plus a constant d = Rτ varies by 2d n̄ besides: half of it in σ².
        d = np.sqrt(ramp) * np.asarray(clusters) * dt
        result += np.einsum("i,j,ija,a->ij", d, d, sums, c)
    return result
