"""Whether the dependence on temperature comes back from cycle to cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sensorbook.thermal.sweep import Sweep

SIGNIFICANCE = 0.01  # an axis is called not repeatable by chance this often
VARIATION = 0.5  # of the mean slope: below, a common model still takes off most of the effect
STRETCHES = 12  # of time a cycle is cut into for the standard error of its slope


@dataclass(frozen=True)
class Repeatability:
    """Straight-line slopes of the cycles compared, over the temperatures they share; SI/°C.

    Attributes
    ----------
    slopes, std : of each cycle; standard errors are a jackknife over stretches of time
    range : shared temperatures, °C
    variation : largest minus smallest slope over the size of the mean slope
    effect : that difference over the whole shared range, SI
    probability : of slopes so far apart if all cycles had one slope (F test of their scatter about
        the weighted mean against their standard errors)
    visible : some cycle's slope differs from zero (t test at 1 % over all cycles)
    predicted : the chosen model is more than a constant, or a straight line errs less than a constant
        on cycles left out
    """

    slopes: tuple[float, ...]
    std: tuple[float, ...]
    range: tuple[float, float]
    variation: float
    effect: float
    probability: float
    visible: bool
    predicted: bool

    @property
    def repeatable(self) -> bool:
        """Whether nothing speaks against one slope for all cycles.

        False where a slope is visible, the slopes vary by more than half of their mean (opposite signs
        always do), and either they differ beyond their standard errors or no model fitted to the other
        cycles predicts a cycle better than a constant. A difference that is real but small beside the
        effect does not count, nor does the scatter of slopes that are all noise.
        """
        apart = self.probability < SIGNIFICANCE or not self.predicted
        return not (self.visible and self.variation > VARIATION and apart)

    def to_results(self) -> dict:
        """The keys of results.json, SI."""
        return {
            "range": list(self.range),
            "slopes": list(self.slopes),
            "std": list(self.std),
            "variation": self.variation if np.isfinite(self.variation) else None,
            "effect": self.effect,
            "probability": self.probability,
            "predicted": self.predicted,
        }


def repeat_words(found: Repeatability) -> str:
    """The verdict in words."""
    if not found.repeatable:
        return "**it does not repeat**."
    if not found.visible:
        return "no dependence is visible in either, so that none can fail to repeat."
    if found.variation > VARIATION:
        return "that is within their errors, and one predicts the other: it repeats as far as this shows."
    return "it repeats."


def compare_cycles(sweep: Sweep, y: np.ndarray, predicted: bool) -> Repeatability | None:
    """Slopes of one axis `y` (M,) in each run of `sweep`, each run a cycle.

    `predicted` says whether a model fitted to the other cycles beats a constant on a cycle it has not seen.

    None where there is one cycle, one of fewer than 24 blocks, or where cycles share less than half of
    the temperature range of any of them: a curved dependence would then pass for a change.
    """
    cycles = [sweep.run == r for r in range(len(sweep.files))]
    least = 2 * STRETCHES  # blocks
    if len(cycles) < 2 or min(c.sum() for c in cycles) < least:
        return None
    t = sweep.temperature
    low, high = max(t[c].min() for c in cycles), min(t[c].max() for c in cycles)
    if high - low < 0.5 * max(np.ptp(t[c]) for c in cycles):
        return None
    shared = (t >= low) & (t <= high)
    if min((c & shared).sum() for c in cycles) < least:
        return None
    found = [_slope(t[m], y[m], sweep.weight[m]) for m in (c & shared for c in cycles)]
    slopes, std = (np.array(v) for v in zip(*found, strict=True))
    tiny = 1e-12 * max(np.abs(slopes).max(), np.finfo(float).tiny)  # exact data have no scatter
    weight = 1 / np.maximum(std, tiny) ** 2
    mean = np.average(slopes, weights=weight)
    scatter = np.sum(weight * (slopes - mean) ** 2) / (len(slopes) - 1)
    certain = stats.t.ppf(1 - SIGNIFICANCE / 2 / len(slopes), STRETCHES - 1)
    apart = float(np.ptp(slopes))
    size = abs(float(slopes.mean()))
    return Repeatability(
        slopes=tuple(float(s) for s in slopes),
        std=tuple(float(s) for s in std),
        range=(float(low), float(high)),
        variation=apart / size if size else (np.inf if apart else 0.0),
        effect=apart * float(high - low),
        probability=float(stats.f.sf(scatter, len(slopes) - 1, len(slopes) * (STRETCHES - 1))),
        visible=bool(np.any(np.abs(slopes) > certain * np.maximum(std, tiny))),
        predicted=predicted,
    )


def _slope(t, y, weight) -> tuple[float, float]:
    """Straight-line slope and its jackknife standard error over stretches of time."""
    stretch = np.arange(len(t)) * STRETCHES // len(t)
    root = np.sqrt(weight)

    def line(use):
        return np.polyfit(t[use] - t.mean(), y[use], 1, w=root[use])[0]

    left_out = np.array([line(stretch != s) for s in range(STRETCHES)])
    return float(line(slice(None))), float(np.sqrt((STRETCHES - 1) * left_out.var()))
