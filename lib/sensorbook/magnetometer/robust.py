"""An ellipsoid that a tenth of wrong readings does not move."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from sensorbook.magnetometer.ellipsoid import (
    BASES,
    algebraic,
    refine,
    residuals,
    sphere,
    spread,
    unpacked,
)

ASIDE = 3.5  # robust standard deviations; one normal reading in 2000 is farther off
NEIGHBOURS, DISTURBED = 25, 0.3  # where so many of so many neighbours are off, all are set aside
TRIED = 2000  # readings that starts are tried on
# Random starts, and readings each is made of: where a tenth is wrong, 0.28 of them hold none of it.
SUBSETS, SUBSET = 60, 12
NEAREST = 0.75  # share of the readings that a start must explain


def robust_ellipsoid(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (9,) and which of the readings (N, 3) they rest on (N,).

    Starts from the best of several algebraic fits, each drawn to the three quarters of the readings
    nearest to it (concentration steps; Rousseeuw and Van Driessen 1999), goes on by bisquare
    weights, sets aside what is more than `ASIDE` robust standard deviations off, and stretches that
    are full of such, and ends in plain least squares on the others, so that nothing is lost where
    nothing is wrong.
    """
    basis = BASES["ellipsoid"]
    parameters = refine(m, _start(m), basis, robust=True, steps=30)
    kept = _near(residuals(m, parameters)[0])
    for _ in range(2):
        parameters = refine(m[kept], parameters, basis)
        kept = _near(residuals(m, parameters)[0], kept)
    return refine(m[kept], parameters, basis), kept


def thinned(m: np.ndarray) -> np.ndarray:
    """Which of the readings (N, 3), in the order of time, to fit (N,): of a long rest every so many.

    A device that lies still for most of a recording would else decide alone what is near, and what
    errs there in common would count as often. A rest counts for a fortieth of the readings in motion; it
    is where these move, over half a block, by less than a fifth of what they do when turned.
    """
    kept = np.ones(len(m), dtype=bool)
    blocks = m[: len(m) // NEIGHBOURS * NEIGHBOURS].reshape(-1, NEIGHBOURS, 3)
    if len(blocks) < 50:
        return kept
    low, high = np.quantile(blocks, [0.25, 0.75], axis=1)  # outliers do not make a rest a motion
    moved = (high - low).max(axis=1)
    still = moved < 0.2 * np.quantile(moved, 0.95)
    most = max(4 * NEIGHBOURS, np.count_nonzero(~still) * NEIGHBOURS // 40)
    edges = np.flatnonzero(np.diff(still, prepend=False, append=False)) * NEIGHBOURS
    for start, end in edges.reshape(-1, 2):
        if end - start > most:
            kept[start:end] = np.arange(end - start) % -(-(end - start) // most) == 0
    return kept


def _near(r: np.ndarray, among: np.ndarray | None = None) -> np.ndarray:
    scale = spread(r if among is None else r[among])
    # Noise-free readings have a scale of rounding errors, which sorts nothing out.
    off = np.abs(r) > max(ASIDE * scale, 1e-9)
    # A magnet that came near shows in most readings of a while; in those across the field it does not.
    disturbed = ndimage.uniform_filter1d(off.astype(float), NEIGHBOURS) > DISTURBED
    return ~(off | disturbed)


def _start(m: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)  # a way to search, not a source of data: the same for all
    some = m[rng.permutation(len(m))[:TRIED]]
    best, least = None, np.inf
    for k in range(SUBSETS + 1):
        taken = some if k == 0 else some[rng.choice(len(some), min(SUBSET, len(some)), False)]
        for _ in range(3):
            parameters = algebraic(taken)
            if parameters is None:
                break
            distance = _distances(some, parameters)
            limit = np.quantile(distance, NEAREST)
            if limit < least:
                best, least = parameters, limit
            taken = some[distance <= limit]
    return sphere(m) if best is None else best


def _distances(m: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(N,) distances from the ellipsoid to first order, in the unit of the readings.

    Relative ones would favour huge ellipsoids, on which everything is near.
    """
    r, u = residuals(m, parameters)
    return np.abs(r) / np.linalg.norm(u @ unpacked(parameters)[1], axis=1)
