"""Which temperature sweep tells a bias's change with temperature to a wanted accuracy.

The noise of the sweep's block means, exact in N, B and K (`means`), through the least squares of the thermal
chapter (A 5.3; `thermal.model.Form`) onto the change from the lowest to the highest temperature. A slow sweep
averages more of the white noise, and lets the bias wander farther; several cycles part the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sensorbook.noise.model import NoiseTerms
from sensorbook.plan.means import covariance_of_means
from sensorbook.thermal.fit import STRETCHES
from sensorbook.thermal.model import Form

SPAN = 25.0  # °C
DEGREE = 3  # work A: one is not enough, three is
PACES = (0.5, 0.25, 0.1)  # °C/min; faster, and the die lags its housing
CYCLES = (1, 2, 3, 4, 6, 8)  # up and down
LONGEST = 2 * 86400.0  # s
BLOCKS = 300  # means; 600 of the chapter tell the same


@dataclass(frozen=True)
class Sweep:
    """`cycles` up and down over `span` °C at `pace` °C/min.

    Attributes
    ----------
    std : expected standard error of the change over the span, of the worst axis, SI
    """

    span: float
    pace: float
    cycles: int
    std: float

    @property
    def half(self) -> float:
        """Half of its 95 % interval, by Student's t of the chapter's jackknife."""
        return float(stats.t.ppf(0.975, STRETCHES - 1)) * self.std

    @property
    def duration(self) -> float:
        """s."""
        return self.cycles * 2 * self.span / self.pace * 60


def sweep(
    terms: dict[str, NoiseTerms], span: float, pace: float, cycles: int, degree: int = DEGREE
) -> Sweep:
    """What such a sweep tells; `terms` by axis, SI."""
    seconds = cycles * 2 * span / pace * 60
    edges = np.linspace(0, seconds, BLOCKS + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    phase = middle / seconds * cycles % 1
    temperature = span * (1 - np.abs(2 * phase - 1))
    form = Form(degree)
    ends = np.array([0.0, span])
    a = np.hstack([np.ones((BLOCKS, 1)), form.columns(temperature, (0.0, span))])
    low, high = np.hstack([np.zeros((2, 1)), form.columns(ends, (0.0, span))])
    # The constant column takes all levels: the weights add up to zero.
    gain = (high - low) @ np.linalg.pinv(a)
    variances = [
        gain @ covariance_of_means(edges[:-1], np.diff(edges), t) @ gain
        for t in set(terms.values())
    ]
    return Sweep(span, pace, cycles, float(np.sqrt(max(variances))))


def planned(within: float, terms: dict[str, NoiseTerms], span: float = SPAN) -> tuple[Sweep, bool]:
    """The shortest sweep with a 95 % interval of ± `within` or less; else the best, and False."""
    tried = [
        sweep(terms, span, pace, cycles)
        for pace in PACES
        for cycles in CYCLES
        if cycles * 2 * span / pace * 60 <= LONGEST or (pace, cycles) == (PACES[0], 1)
    ]
    good = [s for s in tried if s.half <= within]
    if good:
        return min(good, key=lambda s: s.duration), True
    return min(tried, key=lambda s: s.std), False
