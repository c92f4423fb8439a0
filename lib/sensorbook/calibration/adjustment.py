"""What the solvers share: the excess scatter of positions, and who among them does not belong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize, stats

SIGNIFICANCE = 0.001  # that any position of a good set is rejected


def paule_mandel(chi_square_of: Callable[[float], float], dof: int, scale: float) -> float:
    """Standard deviation to add to every observation so that χ² equals its degrees of freedom.

    The mean of a rest is not as good as its white noise says: bias instability, a hand not quite
    still and the sensor's own nonlinearity come on top, for each rest anew and whatever its length
    (Paule & Mandel 1982, J. Res. NBS 87, 377).

    Parameters
    ----------
    chi_square_of : weighted sum of squares of a fit with that much excess, falling in it
    dof : degrees of freedom
    scale : root mean square of the residuals, an upper limit but for a factor of the redundancy
    """
    if dof < 1 or chi_square_of(0.0) <= dof or scale <= 0:
        return 0.0
    upper = scale
    while chi_square_of(upper) > dof:
        upper *= 2
    return float(optimize.brentq(lambda s: chi_square_of(s) - dof, 0, upper, rtol=1e-4))


def studentised(residuals: np.ndarray, design: np.ndarray) -> np.ndarray:
    """(P,) externally studentised residuals of a weighted fit (Cook & Weisberg 1982, 2.1.2).

    Parameters
    ----------
    residuals : (P,) divided by their standard deviations
    design : (P, K), its rows divided alike
    """
    p, k = design.shape
    orthogonal = np.linalg.qr(design)[0]
    free = np.maximum(1 - (orthogonal**2).sum(axis=1), 1e-12)
    if p - k < 2:
        return np.zeros(p)
    others = (residuals @ residuals - residuals**2 / free) / (p - k - 1)
    t = residuals / np.sqrt(np.maximum(others, 1e-300) * free)
    # A residual that the fit leaves hardly any freedom tells nothing.
    return np.where(free > 1e-6, t, 0.0)


def outlier(residuals: np.ndarray, design: np.ndarray) -> int | None:
    """Index of the one observation that does not belong at `SIGNIFICANCE` (Bonferroni), if any."""
    p, k = design.shape
    if p - k < 3:
        return None
    t = np.abs(studentised(residuals, design))
    worst = int(np.argmax(t))
    return worst if 2 * p * stats.t.sf(t[worst], p - k - 1) < SIGNIFICANCE else None


def rms(values: np.ndarray) -> float:
    """Root mean square of the finite values; NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
