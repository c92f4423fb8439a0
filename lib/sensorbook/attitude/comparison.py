"""Every method on one recording: errors where a true attitude is known, and what each expects of itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.attitude.aiding import (
    Accuracy,
    Attitudes,
    GyroscopeNoise,
    Motion,
    References,
    accuracy,
)
from sensorbook.attitude.experiment import NEVER, RATES, Run, c_experiment, estimate
from sensorbook.attitude.measured import widen
from sensorbook.attitude.propagation import propagate

FEWEST = 3  # references that a rate must give


@dataclass(frozen=True, eq=False)
class Entry:
    """One method at one reference rate.

    Attributes
    ----------
    attitudes : what it found
    accuracy : against the true attitudes, None where none is known
    expected : rad, rms of the total error as its covariance has it; None where it has none
    updates : number of references it was given
    """

    attitudes: Attitudes
    accuracy: Accuracy | None
    expected: float | None
    updates: int

    def record(self) -> dict:
        """Its entry under `attitude.methods` of results.json."""
        found = self.accuracy
        known = found is not None
        return {
            "mean_error_deg": float(np.degrees(found.mean)) if known else None,
            "mean_euler_error_deg": np.degrees(found.euler).tolist() if known else None,
            "rms_error_deg": float(np.degrees(found.rms)) if known else None,
            "expected_rms_deg": None if self.expected is None else float(np.degrees(self.expected)),
            "nees": found.nees if known and np.isfinite(found.nees) else None,
            "updates": self.updates,
            "samples": found.samples if known else None,
        }


@dataclass(frozen=True, eq=False)
class CorrelatedRun(Run):
    """A run whose references' errors last: those that are taken are widened, or they would count as
    independent."""

    def at(self, rate: float, outage: Sequence[float] | None = None) -> References:
        """As `Run` has it, widened."""
        return widen(super().at(rate, outage), self.motion.time)


def rates_of(run: Run) -> tuple[float, ...]:
    """Work C's reference rates, Hz, that a recording's references allow; their own where it allows none."""
    stamps = run.motion.time[run.references.at]
    own = 1 / float(np.median(np.diff(stamps)))
    found = [r for r in RATES if r <= 1.01 * own and len(run.at(r)) >= FEWEST]
    return tuple(found) or (float(f"{own:.2g}"),)


def compare(
    run: Run, noise: GyroscopeNoise, rates: Iterable[float], methods: Iterable[str]
) -> dict[tuple[str, float], Entry]:
    """The methods by (name, reference rate); integration, which has the first reference alone, at `NEVER`."""
    found = {}
    for method in methods:
        for rate in (NEVER,) if method == "integration" else rates:
            attitudes = estimate(run, method, rate, noise)
            found[method, float(rate)] = Entry(
                attitudes,
                accuracy(attitudes, run.true) if _compared(attitudes, run.true) else None,
                _expected(attitudes),
                len(run.at(rate)),
            )
    return found


def busiest(motion: Motion, seconds: float, after: float = 0.0) -> tuple[float, float] | None:
    """Start and end (s) of the stretch of so many seconds in which the body turned most, without a gap.

    `after` seconds at least lie before it, and as many after it; None where there is no such stretch.
    """
    time, steps = motion.time, motion.steps
    speed = np.concatenate([[0.0], np.cumsum((motion.increments**2).sum(axis=1) / steps)])
    lost = np.concatenate([[0.0], np.cumsum(motion.lost > 0)])
    first = np.flatnonzero((time >= time[0] + after) & (time + seconds <= time[-1] - after))
    if not len(first):
        return None
    last = np.searchsorted(time, time[first] + seconds)
    last = np.minimum(last, len(time) - 1)
    whole = lost[last] == lost[first]
    if not whole.any():
        return None
    turned = np.where(whole, speed[last] - speed[first], -1.0)
    start = float(time[first[np.argmax(turned)]])
    return start, start + seconds


def own_experiment(
    motion: Motion,
    stretch: Sequence[float],
    seeds: Iterable[int],
    bias: Sequence[float],
    random_walk: float,
    reference_std: float,
) -> list[Run]:
    """Work C's experiment on a recording's own rates, in a stretch (s): they are the truth by (5.2).

    C, 5.2.1: the recorded rates, integrated, are truth and reference; bias and noise are added.
    """
    inside = np.flatnonzero((motion.time >= stretch[0]) & (motion.time <= stretch[1]))
    time, turned = motion.time[inside], motion.increments[inside[:-1]]
    true = propagate(turned, [0.0, 0.0, 0.0, 1.0])
    return [
        c_experiment(time - time[0], turned, true, seed, bias, random_walk, reference_std)
        for seed in seeds
    ]


def _compared(attitudes: Attitudes, true: np.ndarray) -> bool:
    return bool(np.isfinite(attitudes.quaternion + true).all(axis=1).any())


def _expected(attitudes: Attitudes) -> float | None:
    if attitudes.covariance is None:
        return None
    variance = np.trace(attitudes.covariance[:, :3, :3], axis1=1, axis2=2)
    return float(np.sqrt(np.nanmean(variance)))
