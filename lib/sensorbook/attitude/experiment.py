"""Work C's experiment (5.2) on every method: a poor gyroscope beside a rare reference, many times over.

Works from arrays: the true motion may be a stated one, or rates that were recorded and are taken for the
truth, as work C took its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import (
    Accuracy,
    Attitudes,
    GyroscopeNoise,
    Motion,
    References,
    accuracy,
)
from sensorbook.attitude.correction import (
    complementary,
    integrate,
    reset,
    reset_and_rate,
    steady_gain,
)
from sensorbook.attitude.kalman import mekf, smoother

NEVER = 0.0  # the reference rate of an attitude that has only its start
RATES = (0.1, 0.2, 1.0, 2.0, 10.0)  # Hz, C's
# C, table 5.2: mean errors of angles 1, 2, 3 (deg) by reference rate (Hz).
PRINTED = {
    NEVER: (47.7717, 13.5791, 31.7222),
    0.1: (10.3420, 3.6700, 7.3750),
    0.2: (6.3503, 2.4801, 4.2557),
    1.0: (1.4782, 1.2353, 1.2215),
    2.0: (1.1205, 0.7890, 0.9169),
    10.0: (0.3765, 0.3290, 0.3507),
}
# C, figure 5.8: error of angle 1 (deg) before an outage, at its end and after it.
PRINTED_OUTAGE = (0.84, 18.0, 1.05)
TIME_CONSTANT = 10.0  # s, of the complementary filter's bias: some references, and less than a run

KNOWN = "mekf, bias known"  # the yardstick: no method without the bias can be better on average


@dataclass(frozen=True, eq=False)
class Run:
    """One run of the experiment: N stamps.

    Attributes
    ----------
    motion : the gyroscope's readings, as increments
    references : one at every stamp
    true : (N, 4), reference → body
    bias : (3,) rad/s, true
    """

    motion: Motion
    references: References
    true: np.ndarray
    bias: np.ndarray

    def at(self, rate: float, outage: Sequence[float] | None = None) -> References:
        """The references at `rate` (Hz), or the first alone; none from outage[0] to outage[1] (s).

        They are chosen among those outside the outage: a tick at its end takes the first that follows.
        """
        if rate == NEVER:
            return self.references.where([0])
        time, allowed = self.motion.time, self.references
        if outage is not None:
            allowed = allowed.outside(time, *outage)
        return allowed.at_rate(time, rate)


def c_experiment(
    time: ArrayLike,
    increments: ArrayLike,
    true: ArrayLike,
    rng: int | np.random.Generator,
    bias: ArrayLike,
    random_walk: float,
    reference_std: ArrayLike,
) -> Run:
    """A true motion with a bias and white noise added to its rates, and references with white errors.

    Parameters
    ----------
    time : (N,) s
    increments : (N − 1, 3) rad, the true rotation in each step, in body axes
    true : (N, 4), reference → body, what the increments integrate to
    rng : a seed or a generator
    bias : (3,) rad/s
    random_walk : N, rad/s/√Hz, two-sided
    reference_std : rad about each body axis, one number or (3,), above 0
    """
    rng = np.random.default_rng(rng)
    true, bias = np.asarray(true, dtype=float), np.asarray(bias, dtype=float)
    std = np.broadcast_to(reference_std, 3).astype(float)
    step = np.diff(time)[:, None]
    white = random_walk * np.sqrt(step) * rng.standard_normal((len(step), 3))
    error = std * rng.standard_normal((len(true), 3))
    measured = Rotation.from_quat(true) * Rotation.from_rotvec(error)
    covariance = np.tile(np.diag(std**2), (len(true), 1, 1))
    return Run(
        Motion.of(time, increments + step * bias + white),
        References(np.arange(len(true)), measured.as_quat(), covariance),
        true,
        bias,
    )


def _complementary(run: Run, references: References, noise: GyroscopeNoise) -> Attitudes:
    """Tuned as one does without a bias in the model: by the noise, but never slower than the bias."""
    if len(references) < 2:
        return integrate(run.motion, references)
    period = float(np.median(np.diff(run.motion.time[references.at])))
    variance = np.trace(references.covariance, axis1=1, axis2=2) / 3
    white = float(np.sqrt(noise.growth(run.motion).mean()))
    settled = steady_gain(white, float(np.sqrt(np.median(variance))), period)
    slowest = -float(np.expm1(-period / TIME_CONSTANT))
    return complementary(run.motion, references, max(settled, slowest), TIME_CONSTANT)


METHODS: dict[str, Callable[[Run, References, GyroscopeNoise], Attitudes]] = {
    "integration": lambda run, references, noise: integrate(run.motion, references.where([0])),
    "reset": lambda run, references, noise: reset(run.motion, references),
    "reset_and_rate": lambda run, references, noise: reset_and_rate(run.motion, references),
    "complementary": _complementary,
    "mekf": lambda run, references, noise: mekf(run.motion, references, noise),
    KNOWN: lambda run, references, noise: mekf(
        run.motion, references, replace(noise, bias_std=0.0), run.bias
    ),
    "smoother": lambda run, references, noise: smoother(run.motion, references, noise),
}


def estimate(
    run: Run,
    method: str,
    rate: float,
    noise: GyroscopeNoise,
    outage: Sequence[float] | None = None,
) -> Attitudes:
    """The attitudes of one of `METHODS` with references at `rate` (Hz), and none in an outage."""
    return METHODS[method](run, run.at(rate, outage), noise)


@dataclass(frozen=True)
class Summary:
    """One method's errors over S runs, in rad; each a mean over the runs.

    Attributes
    ----------
    mean : of the total angle
    axes : (3,) of the error vector's components, absolute
    euler : (3,) of roll, pitch, yaw (C's angles 1 to 3), absolute
    scatter : standard deviation over the runs of the mean of `euler`; NaN for one run
    nees : normalised error squared, NaN where the method has no covariance
    bias_rms : rad/s an axis, of the bias at the run's end; NaN where the method has none
    """

    mean: float
    axes: np.ndarray
    euler: np.ndarray
    scatter: float
    nees: float
    bias_rms: float

    @classmethod
    def of(cls, runs: Sequence[Accuracy], biases: Sequence[np.ndarray | None]) -> Summary:
        off = [b for b in biases if b is not None]
        angles = [a.euler.mean() for a in runs]
        return cls(
            float(np.mean([a.mean for a in runs])),
            np.mean([a.axes for a in runs], axis=0),
            np.mean([a.euler for a in runs], axis=0),
            float(np.std(angles, ddof=1)) if len(runs) > 1 else np.nan,
            float(np.mean([a.nees for a in runs])),
            float(np.sqrt(np.mean(np.square(off)))) if off else np.nan,
        )


def study(
    runs: Sequence[Run],
    noise: GyroscopeNoise,
    rates: Iterable[float] = RATES,
    methods: Iterable[str] = tuple(METHODS),
) -> dict[tuple[str, float], Summary]:
    """Errors by (method, reference rate), each over the same runs.

    Integration takes the first reference alone, and is at `NEVER` whatever the rates are; the yardstick
    is there too. What the others have without references is integration.
    """
    methods = list(methods)
    pairs = [(m, NEVER) for m in ("integration", KNOWN) if m in methods]
    pairs += [(m, float(rate)) for rate in rates for m in methods if m != "integration"]
    found = {}
    for method, rate in pairs:
        attitudes = (estimate(run, method, rate, noise) for run in runs)
        each = [
            (accuracy(a, run.true), None if a.bias is None else a.bias[-1] - run.bias)
            for a, run in zip(attitudes, runs, strict=True)
        ]
        found[method, rate] = Summary.of(*zip(*each, strict=True))
    return found


@dataclass(frozen=True, eq=False)
class Consistency:
    """Whether errors are as large as a filter's covariance says, over S runs.

    Attributes
    ----------
    nees : (N,) normalised error squared at each stamp, mean over the runs
    low, high : 95 % bounds of that at one stamp: χ² of 3 S degrees of freedom over S
    inside : share of the stamps within them, about 0.95 where the covariance is right
    mean, mean_low, mean_high : mean over runs and stamps, and its 95 % interval by the scatter of the
        runs, which are independent while stamps are not
    error : mean of the whole angle's error, rad
    """

    nees: np.ndarray
    low: float
    high: float
    inside: float
    mean: float
    mean_low: float
    mean_high: float
    error: float


def consistency(runs: Sequence[Run], rate: float, noise: GyroscopeNoise) -> Consistency:
    """Of the MEKF with references at `rate` (Hz), tuned by `noise`; two runs or more."""
    count = len(runs)
    found = [estimate(run, "mekf", rate, noise) for run in runs]
    each = np.array([a.nees(run.true) for a, run in zip(found, runs, strict=True)])
    sizes = [np.linalg.norm(a.errors(run.true), axis=1) for a, run in zip(found, runs, strict=True)]
    nees = each.mean(axis=0)
    low, high = stats.chi2.ppf([0.025, 0.975], 3 * count) / count
    means = each.mean(axis=1)
    half = stats.t.ppf(0.975, count - 1) * means.std(ddof=1) / np.sqrt(count)
    return Consistency(
        nees,
        float(low),
        float(high),
        float(np.mean((nees >= low) & (nees <= high))),
        float(means.mean()),
        float(means.mean() - half),
        float(means.mean() + half),
        float(np.mean(sizes)),
    )


@dataclass(frozen=True, eq=False)
class Growth:
    """Errors without any reference after the first: rms over the runs and as predicted, rad, (N,)."""

    rms: np.ndarray
    predicted: np.ndarray

    def ratio(self, below: float) -> float:
        """Rms over predicted, mean over the stamps after the first with a prediction under `below`."""
        chosen = self.predicted < below
        chosen[0] = False
        return float(np.mean(self.rms[chosen] / self.predicted[chosen])) if chosen.any() else np.nan


def growth(runs: Sequence[Run], noise: GyroscopeNoise, known: bool) -> Growth:
    """The filter's error against its covariance without references, its bias `known` or not.

    Without references the filter integrates, so that only the first run needs the filter itself: its
    covariance hangs on the path, not on the noise.
    """
    squares = [
        np.sum(
            integrate(run.motion, run.at(NEVER), run.bias if known else 0.0).errors(run.true) ** 2,
            axis=1,
        )
        for run in runs
    ]
    filtered = estimate(runs[0], KNOWN if known else "mekf", NEVER, noise)
    variance = np.trace(filtered.covariance[:, :3, :3], axis1=1, axis2=2)
    return Growth(np.sqrt(np.mean(squares, axis=0)), np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class Outage:
    """Errors through an outage, means over the runs, rad; before, at its end and after it.

    Attributes
    ----------
    total : (N,) rms of the whole angle
    angle_1 : (3,) mean absolute error of roll, C's angle 1
    whole : (3,) mean of the whole angle
    """

    total: np.ndarray
    angle_1: np.ndarray
    whole: np.ndarray


def through_outage(
    runs: Sequence[Run], method: str, rate: float, noise: GyroscopeNoise, outage: Sequence[float]
) -> Outage:
    """A method with references at `rate` (Hz) but for an outage (s).

    *Before* is the mean of the four seconds before it, *at its end* the last stamp within it, *after* the
    mean of the four seconds from the first reference on.

    Raises
    ------
    ValueError
        no reference comes after the outage
    """
    time, used = runs[0].motion.time, runs[0].at(rate, outage).at
    following = used[time[used] >= outage[1]]
    if not len(following):
        raise ValueError("no reference comes after the outage")
    angle_1, size = [], []
    for run in runs:
        found = estimate(run, method, rate, noise, outage)
        angle_1.append(np.abs(found.euler_errors(run.true)[:, 0]))
        size.append(np.linalg.norm(found.errors(run.true), axis=1))
    back, stamps = int(following[0]), np.arange(len(time))
    # After one stamp more: work C's correction takes effect one step after the reference.
    parts = (
        (time >= outage[0] - 4) & (time < outage[0]),
        stamps == np.searchsorted(time, outage[1]) - 1,
        (stamps > back) & (time < time[back] + 4),
    )
    return Outage(
        np.sqrt(np.mean(np.square(size), axis=0)),
        np.array([np.mean(np.array(angle_1)[:, part]) for part in parts]),
        np.array([np.mean(np.array(size)[:, part]) for part in parts]),
    )


def rate_needed(rates: Sequence[float], errors: Sequence[float], wanted: float) -> float | None:
    """The lowest reference rate (Hz) for a wanted error, straight between points on log-log paper.

    None where even the highest of the ascending `rates` does not reach it; the lowest of them where that
    already does.
    """
    x, y = np.log(rates), np.log(errors)
    good = np.flatnonzero(y <= np.log(wanted))
    if not len(good):
        return None
    k = int(good[0])
    if k == 0:
        return float(rates[0])
    share = (y[k - 1] - np.log(wanted)) / (y[k - 1] - y[k])
    return float(np.exp(x[k - 1] + share * (x[k] - x[k - 1])))
