"""From a rest to its noise terms in one call, and what the curve says about averaging."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensorbook.estimate import Estimate
from sensorbook.noise.allan import AllanCurve, allan_deviation
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.result import AxisNoise, NoiseEstimate
from sensorbook.noise.lowpass import LowPass, find_low_pass

LEAST_EDF = 10.0  # a deviation with fewer degrees of freedom is uncertain by more than a quarter


@dataclass(frozen=True, eq=False)
class Identified:
    """Allan curve of a rest, the low-pass of each axis and the noise terms."""

    curve: AllanCurve
    low_passes: tuple[LowPass | None, ...]
    fit: NoiseEstimate

    def _repr_html_(self) -> str:
        return self.fit._repr_html_()


def identify_noise(values: np.ndarray, rate: float, sensor: str = "") -> Identified:
    """Noise terms of a rest, with the low-pass it has been through taken into account.

    Parameters
    ----------
    values : (N, A) evenly sampled, SI
    rate : Hz
    sensor : its name, for units
    """
    curve = allan_deviation(values, rate, sensor=sensor)
    columns = np.asarray(values, dtype=float).reshape(len(values), -1).T
    low_passes = tuple(find_low_pass(column, rate) for column in columns)
    return Identified(curve, low_passes, fit_terms(curve, low_passes))


def best_averaging(curve: AllanCurve, axis: AxisNoise, deviation: np.ndarray):
    """Where averaging has done what it can: cluster time (s), deviation there and what follows.

    What follows is "rises" where the curve climbs clear of it later, "falls" where the lowest point is
    the last one known well, else "level".

    Parameters
    ----------
    deviation : (T,) the axis's column of the curve
    """
    known = np.flatnonzero(axis.edf >= LEAST_EDF)
    at = int(known[np.argmin(deviation[known])])
    found = Estimate(float(deviation[at]), *map(float, axis.band[at]))
    rises = (axis.band[at:, 0] > found.high).any()
    follows = "rises" if rises else "falls" if at == known[-1] else "level"
    return float(curve.tau[at]), found, follows
