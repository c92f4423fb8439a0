"""The slopes of the Allan curve, found automatically (work A leaves it to future work, 7.3).

A smoothing spline that knows the curve's own error gives the slope at every cluster time and how well it
is known; ranges are stated where it runs with a nominal slope by more than chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import interpolate, linalg, special

from sensorbook import units
from sensorbook.estimate import Estimate
from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.covariance import variance_covariance
from sensorbook.noise.estimate import SMALLEST, usable
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise

# Nominal slopes are 0.5 apart. A range is stated where the curve is nowhere further than TOLERANCE from
# one of them and where its mean slope is nearer to that one than to any other with 95 % certainty.
TOLERANCE, CELL = 0.15, 0.25
LEAST_DECADES = 0.5  # N and K alone hold a slope within 0.15 of zero for 0.27 decades: no flat
# Weight of curvature² against misfit². The bend from N to K has a mean square curvature of 1/10 over
# the three e-folds of τ it takes: a stiffer spline would cut such bends where the curve is known badly.
STIFFNESS = np.geomspace(0.01, 10, 7)
GRID = 40  # points a decade on which the ends of a range are sought


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """Smoothing spline of log σ in log τ with its uncertainty.

    Attributes
    ----------
    through : natural cubic spline through unit vectors at the knots: linear in what stands there
    mean, covariance : (T,) and (T, T), log σ at the knots
    """

    through: interpolate.CubicSpline
    mean: np.ndarray
    covariance: np.ndarray

    def deviation(self, tau: np.ndarray) -> np.ndarray:
        """σ at `tau` (s)."""
        return np.exp(self.through(np.log(tau)) @ self.mean)

    def slope(self, tau: np.ndarray) -> np.ndarray:
        """d log σ / d log τ."""
        return self.through(np.log(tau), 1) @ self.mean

    def slope_std(self, tau: np.ndarray) -> np.ndarray:
        """Standard error of the slope."""
        rows = self.through(np.log(tau), 1)
        return np.sqrt(np.einsum("ij,jk,ik->i", rows, self.covariance, rows))

    def mean_slope(self, low: float, high: float) -> Estimate:
        """Between two cluster times (s), with its 95 % interval."""
        row = np.diff(self.through(np.log([low, high])), axis=0)[0] / np.log(high / low)
        value, reach = row @ self.mean, 1.96 * np.sqrt(row @ self.covariance @ row)
        return Estimate(*map(float, (value, value - reach, value + reach)))


def smooth_curve(curve: AllanCurve, axis: str, noise: AxisNoise, points: np.ndarray) -> SmoothCurve:
    """Smoothing spline through the Allan curve of one axis.

    The points count by their full covariance (`covariance`), and curvature costs as much as is likeliest
    (restricted likelihood), within `STIFFNESS`. The spline is a posterior mean; 1.96 standard errors of its
    slope held the true slope in 92 % to 100 % of simulated records, by mixture and sixth of the range.

    Parameters
    ----------
    noise : the axis's terms, for the curve's uncertainty
    points : indices of the cluster times used
    """
    i = "xyz".index(axis)
    edf = noise.edf[points]
    x = np.log(curve.tau[points])
    # Variances are χ²: their logarithm is low by this on average, and scatters by its trigamma.
    y = np.log(curve.deviation[points, i]) + (np.log(edf / 2) - special.psi(edf / 2)) / 2
    std = np.sqrt(special.polygamma(1, edf / 2)) / 2
    c = variance_covariance(curve.clusters, curve.samples, curve.rate, noise.squares)
    c = c[np.ix_(points, points)]
    root = np.sqrt(np.diag(c))
    values, vectors = linalg.eigh(c / np.outer(root, root))
    whiten = (vectors / np.sqrt(np.maximum(values, SMALLEST))).T / std
    precision = whiten.T @ whiten

    h = np.diff(x)
    turn = np.zeros((len(x) - 2, len(x)))  # second divided differences, scaled to mean curvature
    for j, (left, right) in enumerate(pairwise(h)):
        turn[j, j : j + 3] = np.array([1 / left, -1 / left - 1 / right, 1 / right])
        turn[j] /= np.sqrt((left + right) / 2)
    penalty = turn.T @ turn

    best = (np.inf, None, None)
    for stiffness in STIFFNESS:
        total = precision + stiffness * penalty
        mean = np.linalg.solve(total, precision @ y)
        misfit = whiten @ (y - mean)
        unlikely = misfit @ misfit + stiffness * mean @ penalty @ mean
        unlikely += np.linalg.slogdet(total)[1] - len(turn) * np.log(stiffness)
        if unlikely < best[0]:
            best = (unlikely, mean, total)
    through = interpolate.CubicSpline(x, np.eye(len(x)), bc_type="natural")
    return SmoothCurve(through, best[1], np.linalg.inv(best[2]))


@dataclass(frozen=True)
class SlopeRange:
    """Cluster times in which a curve runs with one of the nominal slopes.

    Attributes
    ----------
    slope, term : nominal slope and the noise term it belongs to; a filter or a vibration may mimic it
    tau_low, tau_high : ends of the range, s
    mean_slope : between the ends
    coefficient : of the term, read off its line laid through the range, SI; holds what other terms add
    """

    slope: float
    term: str
    tau_low: float
    tau_high: float
    mean_slope: Estimate
    coefficient: float

    def line(self, tau: np.ndarray) -> np.ndarray:
        """σ of the line."""
        return self.coefficient * np.sqrt(TERMS[self.term].variance(tau))


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes of one axis's curve.

    Attributes
    ----------
    axis : x, y or z
    ranges : where it runs with a nominal slope, by increasing τ
    smooth : the curve on which they were found
    tau : (G,) cluster times at which its slope was looked at, s
    """

    axis: str
    ranges: tuple[SlopeRange, ...]
    smooth: SmoothCurve
    tau: np.ndarray

    @property
    def known_to(self) -> float:
        """Longest cluster time to which the slope is known to ±0.25 with 95 % certainty, s."""
        vague = 1.96 * self.smooth.slope_std(self.tau) > CELL
        return float(self.tau[np.argmax(vague) if vague.any() else -1])

    def to_results(self, sensor: str) -> list[dict]:
        """The ranges as results.json states them."""
        return [
            {
                "slope": r.slope,
                "term": r.term,
                "tau_range": [r.tau_low, r.tau_high],
                "mean_slope": r.mean_slope.to_results("1"),
                "coefficient": {"value": r.coefficient, "unit": units.si_unit(sensor, r.term)},
            }
            for r in self.ranges
        ]


def find_slopes(
    curve: AllanCurve, axis: str, noise: AxisNoise, low_pass: LowPass | None = None
) -> Slopes:
    """Where the curve of one axis runs with slope −1, −½, 0, +½ or +1, by increasing τ.

    On the smooth curve (`smooth_curve`) the slope stays within 0.15 of the nominal one for half a decade
    or more, short gaps apart that are within a standard error of it, and its mean over the range is within
    0.25 of it with 95 % certainty, so that no other nominal slope is nearer.

    Of 540 simulated records of 10⁵ samples (nine mixtures of N, B and K, sixty of each), one states a
    range whose true mean slope is 0.2 or more away from the nominal one.
    """
    points = np.flatnonzero(usable(curve, low_pass))
    smooth = smooth_curve(curve, axis, noise, points)
    ends = np.log10(curve.tau[points[[0, -1]]])
    decades = np.linspace(*ends, int(GRID * np.diff(ends)[0]) + 2)
    tau = 10**decades
    slope, std = smooth.slope(tau), smooth.slope_std(tau)
    found = []
    for name, term in TERMS.items():
        away = np.abs(slope - term.slope)
        runs: list[tuple[int, int]] = []
        for first, last in _stretches(away <= TOLERANCE):
            # A short gap, no further away than one standard error, does not end a range.
            start, end = runs[-1] if runs else (first, first)
            joined = runs and decades[first] - decades[end] < LEAST_DECADES
            joined = joined and (away[end:first] <= TOLERANCE + std[end:first]).all()
            if joined and _certain(smooth.mean_slope(tau[start], tau[last]), term.slope):
                runs[-1] = (start, last)
            else:
                runs.append((first, last))
        for first, last in runs:
            if decades[last] - decades[first] < LEAST_DECADES:
                continue
            mean = smooth.mean_slope(tau[first], tau[last])
            if not _certain(mean, term.slope):
                continue
            part = tau[first : last + 1]
            value = np.exp(np.mean(np.log(smooth.deviation(part) / np.sqrt(term.variance(part)))))
            low, high = float(tau[first]), float(tau[last])
            found.append(SlopeRange(term.slope, name, low, high, mean, float(value)))
    return Slopes(axis, tuple(sorted(found, key=lambda r: r.tau_low)), smooth, tau)


def _stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return list(zip(edges[::2], edges[1::2] - 1, strict=True))


def _certain(mean: Estimate, nominal: float) -> bool:
    return nominal - CELL <= mean.low and mean.high <= nominal + CELL
