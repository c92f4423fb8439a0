"""Noise terms from an Allan curve as work A reads them off: the baseline of the weighted fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.estimate import Estimate
from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.covariance import variance_covariance
from sensorbook.noise.estimate import usable
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import FLAT, TERMS
from sensorbook.noise.result import AxisNoise, NoiseEstimate

READ_REACH = 10.0  # shortest cluster time, in units of the low-pass's 1/f_c (A3: τ ≫ 1/f_c)


def local_slopes(curve: AllanCurve, reach: int = 2) -> np.ndarray:
    """(T, A) slope d log σ / d log τ, by a straight line over ±`reach` points."""
    x, y = np.log(curve.tau), np.log(curve.deviation)
    slopes = np.empty_like(y)
    for i in range(len(x)):
        s = slice(max(0, i - reach), i + reach + 1)
        centred = x[s] - x[s].mean()
        slopes[i] = centred @ y[s] / (centred @ centred)
    return slopes


def read_off(curve: AllanCurve, low_passes: Sequence[LowPass | None] = ()) -> NoiseEstimate:
    """Noise terms as work A reads them off the curve: the baseline the fit is compared with.

    A line of the term's slope is laid through the points whose local slope lies within 0.1 of it,
    weighted by their degrees of freedom, and read at the term's cluster time (N at 1 s, K at 3 s); B
    is the minimum over 0.664. Cluster times below ten times the inverse of the cut-off are masked
    (A3). Where terms
    overlap, each reading holds a share of its neighbours. Intervals hold the statistical error alone.
    """
    low_passes = low_passes or (None,) * curve.deviation.shape[1]
    axes = []
    columns = zip(curve.deviation.T, local_slopes(curve).T, low_passes, strict=True)
    for y, slope, low_pass in columns:
        mask = usable(curve, low_pass, READ_REACH)
        terms = {}
        lowest = int(np.argmin(np.where(mask, y, np.inf)))
        for name, term in TERMS.items():
            if term.read_at is None:
                # a floor: the curve turns there, and is level
                inside = 0 < lowest < len(y) - 1 and abs(slope[lowest]) < 0.3
                points = np.array([lowest]) if inside else np.array([], dtype=int)
                level = y / np.sqrt(FLAT)
            else:
                side = np.arange(len(y)) < lowest if term.slope < 0 else np.arange(len(y)) > lowest
                points = np.flatnonzero(mask & side & (np.abs(slope - term.slope) < 0.1))
                level = y * (curve.tau / term.read_at) ** -term.slope
            enough = len(points) >= (1 if term.read_at is None else 3)
            terms[name] = _read(curve, y, level, points) if enough else None
        axes.append(AxisNoise(terms, {}, (float(curve.tau[mask][0]), float(curve.tau[-1])), None))
    return NoiseEstimate("read_off", curve.sensor, tuple(axes))


def _read(curve: AllanCurve, y, level, points) -> Estimate:
    tau = curve.tau[points]
    weight = (1 / tau) / np.sum(1 / tau)  # degrees of freedom fall as 1/τ
    # The covariance needs a noise type: the curve's own value as white noise at each cluster time.
    squares = {"random_walk": float(np.median(y[points] ** 2 * tau))}
    c = variance_covariance(curve.clusters[points], curve.samples, curve.rate, squares)
    s2 = squares["random_walk"] / tau
    spread = np.sqrt(weight @ (c / np.outer(s2, s2)) @ weight / 4)
    value = float(np.exp(weight @ np.log(level[points])))
    return Estimate(value, value * np.exp(-1.96 * spread), value * np.exp(1.96 * spread))
