"""Gyro-integrated attitude: work C's experiment, a real recording and speed, beside goals and peers.

    python benchmarks/integrated_attitude.py [--seed 1000] [--runs 48] [--steps 1000000]

`--seed` is the first of the runs' seeds. The recording is the folder `broad-slow` of
SENSORBOOK_REAL_DATA, left out where that is not there. The peer is `ahrs`' EKF on accelerometer and
magnetometer, which has an update at every step; timed in the same process, one thread.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # before numpy is imported

import numpy as np
from ahrs.filters import EKF
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook.attitude.agreement import agreement
from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References, accuracy
from sensorbook.attitude.correction import reset
from sensorbook.attitude.experiment import (
    KNOWN,
    NEVER,
    PRINTED,
    RATES,
    Run,
    c_experiment,
    consistency,
    growth,
    study,
)
from sensorbook.attitude.kalman import mekf, smoother
from sensorbook.attitude.preparation import motion, on_stamps, readings, reference_track
from sensorbook.attitude.propagation import propagate
from sensorbook.attitude.tuning import disagreement, tuned
from sensorbook.simulate.trajectory import (
    C_BIAS,
    C_RANDOM_WALK,
    REFERENCE_ERROR,
    experiment,
)

PRIOR = 0.03  # rad/s: the rms of C's bias over the axes
NOISE = GyroscopeNoise(C_RANDOM_WALK, 0.0, PRIOR)
GOALS = {0.1: 1.5, 0.2: 1.35, 1.0: 1.15, 2.0: 1.15, 10.0: 1.2}
REAL_GOALS = {0.1: (0.58, 1.45), 0.2: (0.50, 0.90), 1.0: (0.37, 0.40), 2.0: (0.25, 0.27)}
REAL_BIAS = (0.20, 0.12, -0.23)  # deg/s
REAL_DATA = os.environ.get(
    "SENSORBOOK_REAL_DATA", str(Path(__file__).parents[2] / "shared" / "data")
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=48)
    parser.add_argument("--steps", type=int, default=1_000_000)
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.runs)
    work_c(seeds)
    consistent(seeds)
    agreeing(seeds)
    real()
    speed(options.steps)


def runs(seeds: range, prior: bool = False) -> list[Run]:
    """C's experiment, 60 s; with biases drawn from the filter's prior, or C's own."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 0xB])
        truth = experiment(seed)
        bias = rng.normal(scale=PRIOR, size=3) if prior else np.array(C_BIAS)
        increments = truth.true_rate[1:] * np.diff(truth.time)[:, None]
        found.append(
            c_experiment(
                truth.time, increments, truth.true, rng, bias, C_RANDOM_WALK, REFERENCE_ERROR
            )
        )
    return found


def work_c(seeds: range) -> None:
    print(f"work C's experiment, 60 s, {len(seeds)} seeds from {seeds[0]}; degrees")
    found = study(runs(seeds), NOISE, RATES)
    for rate in (NEVER, *RATES):
        printed = np.mean(PRINTED[rate])
        print(f"{'never' if rate == NEVER else f'{rate:g} Hz'}: C prints {PRINTED[rate]}")
        for (method, at), summary in found.items():
            if at != rate:
                continue
            axes, euler = np.degrees(summary.axes), np.degrees(summary.euler)
            line = f"  {method:18s} axes {axes.round(3)} Euler {euler.round(3)}"
            if method == "reset":
                line += f"  over C's {euler.mean() / printed:.2f} (goal 0.6 to 1.4)"
            if method == "mekf":
                ratio = axes.mean() / np.degrees(found[KNOWN, rate].axes).mean()
                line += f"  over known bias {ratio:.3f} (goal {GOALS[rate]:.2f})"
            print(line)


def consistent(seeds: range) -> None:
    print("errors against covariance: mean NEES of the MEKF's attitude over runs (3 is right)")
    for name, many in (("C's bias", runs(seeds)), ("biases of the prior", runs(seeds, True))):
        for rate in RATES:
            found = consistency(many, rate, NOISE)
            print(
                f"  {name}, {rate:g} Hz: {found.mean:.2f} (goal {found.low:.2f} to {found.high:.2f}),"
                f" {100 * found.inside:.0f} % of the stamps within"
            )
    many = runs(seeds, True)
    for known in (True, False):
        found = growth(many, NOISE, known)
        scatter = 1 / np.sqrt(2 * 3 * len(seeds))  # of an rms of so many numbers
        print(
            f"  without references, bias {'known' if known else 'unknown'}: rms over predicted "
            f"{found.ratio(np.radians(30)):.2f} while below 30° (1 ± {1.96 * scatter:.2f})"
        )


def agreeing(seeds: range) -> None:
    print("gyroscope against reference: errors over standard errors, rms over runs (1 is right)")
    for name, axes in (("work C's motion", [1, 1, 1]), ("its turn about z alone", [0, 0, 1])):
        for every in (1, 28):
            off = []
            for seed in seeds:
                truth = experiment(seed)
                rng, step = np.random.default_rng([seed, 0xA]), np.diff(truth.time)[:, None]
                rate = truth.true_rate * axes
                track = propagate(rate[1:] * step, [0, 0, 0, 1])
                noise = rng.normal(size=rate.shape) * C_RANDOM_WALK / np.sqrt(step.mean())
                at = np.arange(0, len(rate), every)
                error = Rotation.from_rotvec(rng.normal(size=(len(at), 3)) * REFERENCE_ERROR)
                reference = (Rotation.from_quat(track[at]) * error).as_quat()
                found = agreement(truth.time, rate + C_BIAS + noise, at, reference)
                told = np.isfinite(found.misalignment_std)
                off.append(
                    [
                        (found.delay - step.mean() / 2) / found.delay_std,
                        *((found.bias - C_BIAS) / found.bias_std)[[2]],
                        (found.scale - 1) / found.scale_std,
                        rms((found.misalignment / found.misalignment_std)[told]),
                    ]
                )
            values = dict(zip(("delay", "bias z", "scale", "axes"), rms(off), strict=True))
            print(f"  {name}, every {every}:", *(f"{k} {v:.2f}" for k, v in values.items()))


def rms(values) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=0))


def real() -> None:
    folder = Path(REAL_DATA) / "broad-slow"
    if not folder.is_dir():
        print(f"{folder.name}: not there, left out")
        return
    device = sensorbook.load(folder)
    read = readings(device.gyroscope.trajectory)
    track = reference_track(device.reference.trajectory)
    # Its readings are means over the interval before their stamp (README of the recording).
    moved = motion(read, np.median(np.diff(read.time)) / 2)
    at, quaternion = on_stamps(read, track, moved)
    true = np.full((len(read.time), 4), np.nan)
    true[at] = quaternion
    found = disagreement(moved, References(at, quaternion, np.zeros((len(at), 3, 3))))
    covariance = np.tile(np.eye(3) * found.reference_std**2, (len(at), 1, 1))
    references, noise = References(at, quaternion, covariance), tuned(found)
    print(
        f"broad-slow: mean total error, degrees; reference {np.degrees(found.reference_std):.3f}°"
    )
    for rate, (goal, plain) in REAL_GOALS.items():
        some = references.at_rate(read.time, rate)
        filtered = mekf(moved, some, noise)
        errors = [
            np.degrees(accuracy(a, true).mean)
            for a in (filtered, smoother(moved, some, noise), reset(moved, some))
        ]
        off = np.abs(np.degrees(filtered.bias[-1]) - REAL_BIAS)
        print(
            f"  {rate:g} Hz: MEKF {errors[0]:.3f} (goal {goal:.2f}), smoother {errors[1]:.3f}, reset "
            f"{errors[2]:.3f} (said to be {plain:.2f}); bias {np.degrees(filtered.bias[-1]).round(3)} "
            f"deg/s, off by {off.max():.3f} (goal 0.03)"
        )


def speed(steps: int) -> None:
    rng = np.random.default_rng(1)
    rate = rng.normal(size=(steps, 3)) * 0.1
    moved = Motion.of(np.arange(steps + 1) * 0.01, rate * 0.01)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (steps + 1, 1))
    covariance = np.tile(np.eye(3) * 1e-4, (steps + 1, 1, 1))
    print(f"speed: {steps} steps, one thread")
    each = {}
    for every, name in (
        (1, "an update at each step"),
        (10, "at each 10th"),
        (100, "at each 100th"),
    ):
        at = np.arange(0, steps + 1, every)
        began = time.perf_counter()
        mekf(moved, References(at, still[at], covariance[at]), GyroscopeNoise(0.01, 1e-4))
        taken = time.perf_counter() - began
        each[every] = taken / steps
        print(f"  MEKF, {name}: {taken:.1f} s (goal 60), {1e6 * taken / steps:.1f} µs a step")
    few = min(steps, 10_000)
    force, field = (rng.normal(size=(few, 3)) * 0.1 + v for v in ([0, 0, 9.8], [30.0, 0, 40.0]))
    taken = np.inf
    for _ in range(3):
        began = time.perf_counter()
        EKF(frequency=100, gyr=rate[:few], acc=force, mag=field)
        taken = min(taken, time.perf_counter() - began)
    print(
        f"  ahrs' EKF, an update at each step: {1e6 * taken / few:.1f} µs a step, "
        f"{taken / few / each[1]:.1f} × ours (goal 3 ×)"
    )


if __name__ == "__main__":
    main()
