"""Every method on one recording: errors where a true attitude is known, and what each expects of itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorbook.attitude.aiding import (
    Accuracy,
    Attitudes,
    GyroscopeNoise,
    Motion,
    References,
    accuracy,
)
from sensorbook.attitude.experiment import (
    NEVER,
    PRINTED,
    RATES,
    Run,
    c_experiment,
    estimate,
    study,
    through_outage,
)
from sensorbook.attitude.measured import widen
from sensorbook.attitude.propagation import propagate
from sensorbook.attitude.rotations import euler_from_matrix, matrix_from_quaternion
from sensorbook.attitude.sources import Source
from sensorbook.simulate.trajectory import C_BIAS, C_OUTAGE, C_RANDOM_WALK, REFERENCE_ERROR

C_BIAS_STD = np.radians(1.7)  # rad/s, what a filter is told of the bias beforehand

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
class DeviceRun(Run):
    """A device's recording as the methods take it; `true` is NaN where nothing judges them.

    Attributes
    ----------
    true_covariance : (N, 3, 3) rad², of the attitudes that judge
    own : the references themselves judge: those that a method was given do not judge it
    lasting : errors of the references last, so that those taken are widened, or they would count as
        independent
    """

    true_covariance: np.ndarray
    own: bool
    lasting: bool

    def at(self, rate: float, outage: Sequence[float] | None = None) -> References:
        """As `Run` has it, widened where errors last."""
        taken = super().at(rate, outage)
        return widen(taken, self.motion.time) if self.lasting else taken

    def judged_by(self, taken: References) -> np.ndarray:
        """(N, 4) the true attitudes for a method that was given some references; NaN where none judges.

        From a gap to the next reference no method knows the attitude: that says nothing of methods.
        """
        true = np.array(self.true)
        if self.own:
            true[taken.at] = np.nan
        stamps = np.arange(len(true))
        last = np.append(taken.at, len(true))[np.searchsorted(taken.at, stamps, side="right") - 1]
        lost = np.concatenate([[0], np.cumsum(self.motion.lost > 0)])
        true[(stamps >= taken.at[0]) & (lost > lost[np.minimum(last, len(lost) - 1)])] = np.nan
        return true


def run_of(motion: Motion, source: Source, judge: Source | None) -> DeviceRun:
    """A recording as the methods take it, judged by the attitudes of a source, its own or another."""
    count = len(motion.time)
    true, covariance = np.full((count, 4), np.nan), np.zeros((count, 3, 3))
    if judge is not None:
        true[judge.references.at] = judge.references.quaternion
        covariance[judge.references.at] = judge.references.covariance
    unknown = np.full(3, np.nan)
    return DeviceRun(
        motion, source.references, true, unknown, covariance, judge is source, source.lasting
    )


def rates_of(run: Run) -> tuple[float, ...]:
    """Work C's reference rates, Hz, that a recording's references allow; their own where it allows none."""
    stamps = run.motion.time[run.references.at]
    own = 1 / float(np.median(np.diff(stamps)))
    found = [r for r in RATES if r <= 1.01 * own and len(run.at(r)) >= FEWEST]
    return tuple(found) or (float(f"{own:.2g}"),)


def compare(
    run: DeviceRun, noise: GyroscopeNoise, rates: Iterable[float], methods: Iterable[str]
) -> dict[tuple[str, float], Entry]:
    """The methods by (name, reference rate); integration, which has the first reference alone, at `NEVER`."""
    found = {}
    for method in methods:
        for rate in (NEVER,) if method == "integration" else rates:
            attitudes, taken = estimate(run, method, rate, noise), run.at(rate)
            true = run.judged_by(taken)
            judged = np.isfinite(attitudes.quaternion + true).all(axis=1).any()
            found[method, float(rate)] = Entry(
                attitudes,
                accuracy(attitudes, true, run.true_covariance) if judged else None,
                _expected(attitudes),
                len(taken),
            )
    return found


def error_table(
    entries: Mapping[tuple[str, float], Entry], names: Mapping[str, str], expected: bool = False
) -> pd.DataFrame:
    """Mean errors in degrees, a row a method and a column a reference rate; or what each expects."""

    def cell(entry: Entry | None) -> str:
        if entry is None or (not expected and entry.accuracy is None):
            return "–"
        return f"{np.degrees(entry.expected if expected else entry.accuracy.mean):.3g}"

    told = {key: e for key, e in entries.items() if not expected or e.expected is not None}
    methods, rates = dict.fromkeys(m for m, _ in told), sorted({r for _, r in told})
    return pd.DataFrame(
        {_of_rate(r): [cell(told.get((m, r))) for m in methods] for r in rates},
        index=[names[m] for m in methods],
    )


def euler_angles(quaternion: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw (N, 3), rad, of attitudes (N, 4)."""
    return euler_from_matrix("ZYX", matrix_from_quaternion(quaternion))[:, ::-1]


@dataclass(frozen=True, eq=False)
class Through:
    """A method's total error through an outage, rad: (N,), the mean of the ten seconds before, the last
    within it."""

    total: np.ndarray
    before: float
    end: float


def outage_errors(
    run: DeviceRun, noise: GyroscopeNoise, rate: float, outage: Sequence[float]
) -> dict[str, Through]:
    """The methods with references at `rate` (Hz) and none in an outage (s); {} where nothing judges them."""
    time, found = run.motion.time, {}
    true = run.judged_by(run.at(rate, outage))
    for method in ("reset", "reset_and_rate", "complementary", "mekf", "smoother"):
        total = np.linalg.norm(estimate(run, method, rate, noise, outage).errors(true), axis=1)
        known = np.isfinite(total)
        before = known & (time >= outage[0] - 10) & (time < outage[0])
        within = np.flatnonzero(known & (time >= outage[0]) & (time < outage[1]))
        if not before.any() or not len(within):
            return {}
        found[method] = Through(total, float(total[before].mean()), float(total[within[-1]]))
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


@dataclass(frozen=True, eq=False)
class OwnExperiment:
    """Work C's experiment on recorded rates: means over the three angles, rad, by method and rate.

    Attributes
    ----------
    errors : by (method, reference rate, Hz)
    rates : Hz, those of `RATES` that the readings allow
    over_printed : the reset's over those that work C prints, by `rates`
    filter_over_reset : the Kalman filter's over the reset's, by `rates`
    steepest : rad, the largest pitch, up or down; at 90° the angles are locked
    time : (N,) s, of one run
    angles : roll, pitch, yaw (N, 3), rad, of that run: "true", "alone" (C's figure 5.5) and "reset", at
        2 Hz without references from 12 s to 20 s (C's figures 5.6 to 5.8)
    outage : rad, mean errors of roll before, at the end of and after that, over the runs; None where the
        stretch is too short
    """

    errors: Mapping[tuple[str, float], float]
    steepest: float
    rates: tuple[float, ...]
    time: np.ndarray
    angles: Mapping[str, np.ndarray]
    outage: np.ndarray | None

    @property
    def reset_errors(self) -> np.ndarray:
        """(N, 3) rad, the reset's angles less the true ones, in [−π, π]."""
        off = self.angles["reset"] - self.angles["true"]
        return (off + np.pi) % (2 * np.pi) - np.pi

    @property
    def over_printed(self) -> list[float]:
        return [np.degrees(self.errors["reset", r]) / np.mean(PRINTED[r]) for r in self.rates]

    @property
    def filter_over_reset(self) -> list[float]:
        return [self.errors["mekf", r] / self.errors["reset", r] for r in self.rates]

    def table(self, names: Mapping[str, str]) -> pd.DataFrame:
        """Degrees, a row a method and a column a rate, and work C's own."""
        methods = dict.fromkeys(m for m, _ in self.errors)
        rows = {
            names[m]: [
                f"{np.degrees(self.errors[m, r]):.3g}" if (m, r) in self.errors else "–"
                for r in (NEVER, *self.rates)
            ]
            for m in methods
        }
        rows["printed by work C"] = [f"{np.mean(PRINTED[r]):.3g}" for r in (NEVER, *self.rates)]
        return pd.DataFrame(rows, index=[_of_rate(r) for r in (NEVER, *self.rates)]).T


def own_experiment(
    motion: Motion, found: Attitudes, stretch: Sequence[float], runs: int = 6
) -> OwnExperiment:
    """Work C's experiment on a recording's own rates in a stretch (s): they are the truth by (5.2).

    C, 5.2.1: the recorded rates, integrated, are truth and reference; bias and noise are added. Here they
    are less the bias and from the attitude that a filter `found`, so that the path is near the true one.
    """
    inside = np.flatnonzero((motion.time >= stretch[0]) & (motion.time <= stretch[1]))
    inside = inside[np.isfinite(found.quaternion[inside]).all(axis=1)]
    time, bias = motion.time[inside], found.bias[-1]
    turned = motion.increments[inside[:-1]] - bias * np.diff(time)[:, None]
    true = propagate(turned, found.quaternion[inside[0]])
    many = [
        c_experiment(time - time[0], turned, true, seed, C_BIAS, C_RANDOM_WALK, REFERENCE_ERROR)
        for seed in range(runs)
    ]
    noise = GyroscopeNoise(C_RANDOM_WALK, 0.0, C_BIAS_STD)
    duration, step = time[-1] - time[0], float(np.median(np.diff(time)))
    rates = tuple(r for r in RATES if r * step <= 1 and r * duration >= FEWEST)
    found = study(many, noise, rates, ("integration", "reset", "reset_and_rate", "mekf"))
    errors = {key: float(summary.euler.mean()) for key, summary in found.items()}
    outage = C_OUTAGE if many[0].motion.time[-1] > C_OUTAGE[1] + 5 and 2.0 in rates else None
    shown = {
        "true": true,
        "alone": estimate(many[0], "integration", NEVER, noise).quaternion,
        "reset": estimate(many[0], "reset", min(2.0, rates[-1]), noise, outage).quaternion,
    }
    angles = {name: euler_angles(quaternion) for name, quaternion in shown.items()}
    return OwnExperiment(
        errors,
        float(np.abs(angles["true"][:, 1]).max()),
        rates,
        many[0].motion.time,
        angles,
        None if outage is None else through_outage(many, "reset", 2.0, noise, outage).angle_1,
    )


def _of_rate(rate: float) -> str:
    return f"{rate:g} Hz" if rate else "never"


def _expected(attitudes: Attitudes) -> float | None:
    if attitudes.covariance is None:
        return None
    variance = np.trace(attitudes.covariance[:, :3, :3], axis1=1, axis2=2)
    return float(np.sqrt(np.nanmean(variance)))
