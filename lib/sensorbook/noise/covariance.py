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

RANDOM_TERMS = ("quantization", "random_walk", "bias_instability", "rate_random_walk")
_DIFFERENCE = np.array([1.0, -2.0, 1.0])
_COEFFICIENTS = np.outer(_DIFFERENCE, _DIFFERENCE).ravel()


def _generalised(s: np.ndarray) -> np.ndarray:
    """(4, …) generalised covariance of θ for unit Q², N², B², K²; `s` in samples, δt = 1."""
    size = np.abs(s)
    square = size * size
    log = np.log(np.where(size == 0, 1.0, size))
    return np.stack([size == 0, -size / 2, square * log / (2 * np.pi), size * square / 12])


def _nodes(m1: int, m2: int, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Integer lags and their quadrature weights, dense around the kinks of R₁₂.

    At unit spacing the trapezoid rule is the exact sum, so short clusters are summed exactly.
    """
    fine = np.arange(-24, 17) * m1 // 8  # multiples of m1/8: the kinks themselves are among them
    coarse = np.arange(-64, 97) * m2 // 16
    lags = np.concatenate([fine, fine + m2, fine + 2 * m2, coarse, [first, last]])
    lags = np.unique(lags[(lags >= first) & (lags <= last)])
    weights = np.ones(len(lags))
    if len(lags) > 1:
        gap = np.diff(lags)
        weights[1:-1] = (gap[1:] + gap[:-1]) / 2
        weights[[0, -1]] = (gap[0] + 1) / 2, (gap[-1] + 1) / 2
    return lags, weights


@lru_cache(maxsize=8)
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
            lags, weights = _nodes(m1, m2, 1 - n2, n1 - 1)
            r = np.einsum(
                "s,asl->al", _COEFFICIENTS, _generalised(lags.astype(float) + shifts[:, None])
            )
            # Pairs (k, l) with k − l = lag, over both estimates' start samples.
            pairs = np.minimum(n1, n2 + lags) - np.maximum(0, lags)
            # Quantisation acts at single lags and is summed there, not integrated.
            r_point = r * (r[0] != 0)
            smooth = r.copy()
            smooth[0] = 0
            w = pairs * weights
            product = np.einsum("l,al,bl->ab", w, smooth, smooth)
            point = np.einsum("l,al,bl->ab", pairs, r_point, r_point)
            product[0], product[:, 0] = point[0], point[:, 0]
            total = smooth @ w
            total[0] = r[0] @ pairs
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
