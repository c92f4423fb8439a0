"""What the solvers share: the excess scatter of positions, and who among them does not belong."""

from __future__ import annotations

import itertools
import math
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


def outliers(residuals: np.ndarray, design: np.ndarray, most: int) -> tuple[int, ...]:
    """Indices of observations that do not belong at `SIGNIFICANCE`, up to three that hide each other.

    F test of a mean shift of each set of one, two or three observations (Cook & Weisberg 1982, 2.2.2;
    Barnett & Lewis 1994), Bonferroni over the sets of that size; of several the clearest is taken.

    Parameters
    ----------
    residuals : (P,) divided by their standard deviations
    design : (P, K), its rows divided alike
    most : observations that may be named
    """
    p, k = design.shape
    orthogonal = np.linalg.qr(design)[0]
    free = np.eye(p) - orthogonal @ orthogonal.T
    total = float(residuals @ residuals)
    best, chosen = SIGNIFICANCE, ()
    # What hides among others has a residual, too: of the larger half up to forty are combined.
    candidates = np.argsort(-np.abs(residuals))[: min(max(12, p // 2), 40)]
    for size in range(1, min(most, 3) + 1):
        dof = p - k - size
        if dof < 2:
            break
        sets = np.array(list(itertools.combinations(candidates, size)))
        block = free[sets[:, :, None], sets[:, None, :]]
        # Sets that the fit leaves no freedom tell nothing.
        usable = np.linalg.eigvalsh(block)[:, 0] > 1e-6
        if not usable.any():
            continue
        sets, block = sets[usable], block[usable]
        e = residuals[sets]
        drop = np.einsum("si,si->s", e, np.linalg.solve(block, e[..., None])[..., 0])
        worst = int(np.argmax(drop))
        left = max(total - float(drop[worst]), 1e-300)
        p_value = math.comb(p, size) * stats.f.sf(drop[worst] / size / (left / dof), size, dof)
        if p_value < best:
            best, chosen = p_value, tuple(int(x) for x in sets[worst])
    return chosen


def rms(values: np.ndarray) -> float:
    """Root mean square of the finite values; NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
