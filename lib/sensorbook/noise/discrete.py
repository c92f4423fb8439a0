"""From continuous-time coefficients to standard deviations per sample.

Curves and spectra give strengths in continuous time, which belong to the sensor alone; simulators and
filters work sample by sample, at a rate of their own. The step δt = 1/rate between the two stands here
and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorbook import units
from sensorbook.noise.allan import check_rate
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.noise.result import NoiseEstimate


@dataclass(frozen=True)
class Step:
    """What one term does from sample to sample.

    Attributes
    ----------
    formula : its standard deviation per sample
    power : of the rate, by which the coefficient is multiplied
    quantity : the one in whose field unit it is shown (`units.field_unit`)
    """

    formula: str
    power: float
    quantity: str


STEPS = {
    "random_walk": Step("σ_d = N/√δt", 0.5, "bias"),  # white noise on each sample
    # What drives the filter h_k = h_{k−1}(k − ½)/k: flicker noise is the same at every rate.
    "bias_instability": Step("σ_w = B", 0.0, "bias_instability"),
    "rate_random_walk": Step("σ_bd = K·√δt", -0.5, "bias_instability"),  # step of the bias
}


def discrete_values(terms: NoiseTerms, rate: float) -> dict[str, float]:
    """Standard deviation per sample by term, in the signal's SI unit.

    White noise scatters each sample by N/√δt and the random walk steps by K√δt (Kalibr wiki, "IMU
    Noise Model"); flicker noise is white noise of B through a filter (Kasdin, Proc. IEEE 83, 1995).

    N/√δt is the scatter of samples whose noise was filtered at half the rate: a sensor of lower
    bandwidth scatters less, and one that is subsampled without a filter scatters as before.

    Parameters
    ----------
    terms : coefficients of the two-sided spectrum, SI
    rate : of the samples wanted, Hz

    Examples
    --------
    White noise that scatters by N√rate has the density N, its Allan deviation at 1 s:

    >>> from sensorbook.noise.allan import allan_deviation
    >>> sigma = discrete_values(NoiseTerms(random_walk=0.01), rate=100.0)["random_walk"]
    >>> round(sigma, 12)
    0.1
    >>> noise = np.random.default_rng(0).normal(0, sigma, 100_000)
    >>> abs(allan_deviation(noise, 100.0).at(1.0)[0] / 0.01 - 1) < 0.05
    np.True_
    """
    check_rate(rate)
    return {name: getattr(terms, name) * rate**step.power for name, step in STEPS.items()}


def per_sample(estimate: NoiseEstimate, rate: float) -> pd.DataFrame:
    """Continuous-time coefficients beside their values per sample at `rate` (Hz), in field units.

    One row a term, N, B and K; under "continuous time" a column an axis and the unit, under "per
    sample" the formula, a column an axis and the unit. NaN where a term has no visible effect.
    """
    axes = list("xyz")[: len(estimate.axes)]
    found = [axis.coefficients for axis in estimate.axes]
    discrete = [discrete_values(terms, rate) for terms in found]
    rows = {}
    for name, step in STEPS.items():
        label, si = units.field_unit(estimate.sensor, name)
        label_d, si_d = units.field_unit(estimate.sensor, step.quantity)
        # Zero stands for a term that is absent.
        rows[f"{TERMS[name].symbol}, {name.replace('_', ' ')}"] = (
            [getattr(terms, name) / si or np.nan for terms in found]
            + [label, step.formula]
            + [values[name] / si_d or np.nan for values in discrete]
            + [label_d]
        )
    columns = [("continuous time", c) for c in (*axes, "unit")]
    columns += [("per sample", c) for c in ("formula", *axes, "unit")]
    return pd.DataFrame.from_dict(rows, orient="index", columns=pd.MultiIndex.from_tuples(columns))
