"""Do recordings made as planned reach the accuracy that `sensorbook plan` predicts?

    python benchmarks/plan_study.py [--seed 1] [--runs 60]

Each kind's recording is simulated as its plan has it, by generators that know nothing of the plan's formulas,
and goes through the chapter's estimator. Found is the rms error over runs and axes, predicted the plan's
standard error. Images are left out: their prediction is their own covariance, which camera_study.py holds
against errors.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
from scipy.signal import fftconvolve

from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References
from sensorbook.attitude.kalman import mekf
from sensorbook.calibration import find_faces, find_positions, multi_position, six_position
from sensorbook.calibration.coverage import STANDARD
from sensorbook.calibration.motions import Directions, all_motions
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.calibration.rest_to_rest import rest_to_rest
from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.coverage import even_directions
from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.model import NoiseTerms
from sensorbook.noise.whittle import fit_spectrum
from sensorbook.plan import rests, rotation, static, thermal, trajectory
from sensorbook.plan.levels import of_grade
from sensorbook.recordings import Recording
from sensorbook.simulate.noise import coloured_noise
from sensorbook.simulate.positions import LATITUDE, NOISE, RATE, hand_moved
from sensorbook.simulate.rotation import NOISE as MAGNETIC
from sensorbook.simulate.rotation import draw_iron, noisy, read_field, turned
from sensorbook.thermal import fit_thermal, reduce_sweep

GOAL = (0.8, 1.25)
TERMS = ("random_walk", "bias_instability", "rate_random_walk")
# N, B, K and the rate; the rest lasts as planned for B within 20 %.
RESTS = (
    (NoiseTerms(0.0, 0.003, 0.002, 3e-4), 20.0),
    (of_grade("gyroscope", "consumer").axes["x"], 10.0),
    (of_grade("accelerometer", "industrial").axes["x"], 10.0),
)
LEVELS = {
    sensor: dict.fromkeys("xyz", NoiseTerms(0.0, n["random_walk"], n["bias_instability"]))
    for sensor, n in NOISE.items()
}
SWEPT = NoiseTerms(0.0, 1.7e-4, 3.9e-5, 5e-7)


def in_time(rng, samples: int, rate: float, terms: NoiseTerms) -> np.ndarray:
    """Noise sample by sample, nothing of it by a spectrum."""
    step = np.arange(1, samples)
    h = np.concatenate([[1.0], np.cumprod((step - 0.5) / step)])
    white = terms.random_walk * np.sqrt(rate) * rng.standard_normal(samples)
    flicker = fftconvolve(terms.bias_instability * rng.standard_normal(samples), h)[:samples]
    return (
        white
        + flicker
        + np.cumsum(terms.rate_random_walk / np.sqrt(rate) * rng.standard_normal(samples))
    )


def rest(case: int, seconds: float, seed: int, index: int):
    """Relative errors of N, B, K, and whether B is stated."""
    terms, rate = RESTS[case]
    rng = np.random.default_rng([seed, index, 1, case])
    axis = fit_spectrum(
        cosine_spectrum(in_time(rng, round(seconds * rate), rate, terms), rate)
    ).axes[0]
    errors = [np.sqrt(axis.squares[t]) / getattr(terms, t) - 1 for t in TERMS]
    return errors, axis.terms["bias_instability"] is not None


def moved(names, seconds: float, levelling: float, rng):
    made = hand_moved(
        rng, [STANDARD[n] for n in names], levelling, initial=0.0, seconds=(seconds,) * 2
    )
    return made, *(
        Recording(s, "positions", "simulated", made["t"], made[s], rate=RATE)
        for s in ("accelerometer", "gyroscope")
    )


def positions(names, seconds: float, seed: int, index: int):
    """Errors of the accelerometer's nine and the gyroscope's twelve parameters; None where refused."""
    made, a, g = moved(names, seconds, 4.0, np.random.default_rng([seed, index, 2]))
    try:
        found = find_positions([a], [g], made["gravity"])
        level = multi_position(found.positions, made["gravity"], check=False)
        found = found[level.kept]
        directions = Directions.by(level, found.positions)
        fit = fit_rests(found.gyroscope, directions.acceleration, LATITUDE)
        turns = all_motions([g], [a], found, directions, level.model, fit)
        turned_by = rest_to_rest(turns, fit, made["gravity"], check=False)
    except Refusal:
        return None
    true = made["errors"]
    return tuple(
        c.values[:n] - np.r_[true[s]["matrix"][c.free], true[s]["bias"]]
        for s, c, n in (("accelerometer", level, 9), ("gyroscope", turned_by, 12))
    )


def faces(seconds: float, seed: int, index: int):
    made, a, _ = moved(rests.SIX, seconds, rests.LEVELLING, np.random.default_rng([seed, index, 3]))
    try:
        found, up = find_faces([a], made["gravity"])
        c = six_position(found.positions, up, made["gravity"])
    except Refusal:
        return None
    true = made["errors"]["accelerometer"]
    return (c.values - np.r_[true["matrix"][c.free], true["bias"]],)


def turn(seconds: float, louder: float, seed: int, index: int):
    """Errors of hard iron (T), soft iron, and of corrected directions (rad)."""
    rng = np.random.default_rng([seed, index, 4])
    field = rotation.FIELD * np.array([0, np.cos(1.0), -np.sin(1.0)])
    iron = draw_iron(rng, rotation.FIELD) | {"alignment": np.eye(3)}
    clean = read_field(turned(rng, round(50 * seconds), 50.0, field, 9.8)["field"], iron)
    noise = {k: louder * v for k, v in MAGNETIC["magnetometer"].items()}
    try:
        c = calibrate(noisy(rng, clean, 50.0, noise))
    except Refusal:
        return None
    true = iron["soft_iron"] / np.cbrt(np.linalg.det(iron["soft_iron"]))
    raw = read_field(rotation.FIELD * even_directions(), iron)
    seen = c.correct(raw)
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    angle = np.linalg.norm(np.cross(even_directions(), seen), axis=1)
    return c.hard_iron - iron["hard_iron"], (c.soft_iron - true)[np.triu_indices(3)], angle


def swept(planned: thermal.Sweep, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, temperature and one axis: noise on a curve of degree 3."""
    seconds = np.arange(round(planned.duration)) * 1.0
    u = 1 - 2 * np.abs(2 * (seconds / planned.duration * planned.cycles % 1) - 1)
    levels = {t: getattr(SWEPT, t) for t in TERMS}
    values = curve(u) + coloured_noise(len(seconds), 1.0, rng, **levels)
    return seconds, planned.span * (u + 1) / 2, values[:, None]


def curve(u: np.ndarray) -> np.ndarray:
    return 1e-3 * (u + 0.8 * u**2 + 0.9 * u**3)


def sweep(planned: thermal.Sweep, seed: int, index: int):
    """Error of the change by the chapter's least squares of the degree that is there."""
    run = swept(planned, np.random.default_rng([seed, index, 5]))
    reduced = reduce_sweep([run])
    fit = np.polynomial.Polynomial.fit(
        reduced.temperature, reduced.values[:, 0], thermal.DEGREE, w=np.sqrt(reduced.weight)
    )
    ends = np.array(reduced.span)  # of the block means
    return (np.diff(fit(ends)) - np.diff(curve(2 * ends / planned.span - 1)),)


def whole_sweep(planned: thermal.Sweep, seed: int, index: int):
    """By the chapter, its own choice of the degree included: whether it is right, and half the interval."""
    axis = fit_thermal(
        reduce_sweep([swept(planned, np.random.default_rng([seed, index, 5]))])
    ).axes[0]
    if axis.change is None or axis.jump:
        return np.array([False]), np.array([np.nan])
    degree = axis.model.to_results()["degree"]
    return np.array([degree == thermal.DEGREE]), np.array([axis.change.high - axis.change.value])


def aided(white: float, walk: float, reference: float, rate: float, seed: int, index: int):
    """Errors just before and just after references, once the filter has settled."""
    rng = np.random.default_rng([seed, index, 6])
    each, count = 10.0, 8000
    drift = np.cumsum(walk / np.sqrt(each) * rng.standard_normal((count, 3)), axis=0)
    increments = (drift + white * np.sqrt(each) * rng.standard_normal((count, 3))) / each
    at = np.arange(0, count + 1, round(each / rate))
    quaternion = np.c_[reference * rng.standard_normal((len(at), 3)) / 2, np.ones(len(at))]
    quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
    covariance = np.broadcast_to(reference**2 * np.eye(3), (len(at), 3, 3))
    motion = Motion.of(np.arange(count + 1) / each, increments)
    noise = GyroscopeNoise(white, walk, bias_std=1e-3 if walk else 1e-6)
    error = mekf(motion, References(at, quaternion, covariance), noise).errors(
        np.tile([0.0, 0, 0, 1], (count + 1, 1))
    )
    settled = at[len(at) // 8 :]
    return error[settled - 1].ravel(), error[settled].ravel()


class Study:
    """Prints a row a quantity and counts the goals that are missed."""

    def __init__(self):
        self.missed = 0

    def row(self, name: str, errors, predicted, unit: str, size: float = 1.0) -> None:
        """Of errors (any shape) and the standard error predicted, or one of each parameter."""
        predicted = float(np.sqrt(np.mean(np.square(predicted))))
        found = float(np.sqrt(np.mean(np.square(errors))))
        ratio = found / predicted
        good = GOAL[0] <= ratio <= GOAL[1]
        self.missed += not good
        print(f"  {name:42s}{predicted / size:11.4g}{found / size:11.4g} {unit:8s}{ratio:6.2f}"
              f"    goal {GOAL[0]:g} … {GOAL[1]:g}{'' if good else '   GOAL MISSED'}")  # fmt: skip

    def share(self, name: str, share: float, low: float, high: float) -> None:
        good = low <= share <= high
        self.missed += not good
        print(f"  {name:64s}{100 * share:5.0f} %   goal {100 * low:.0f} … {100 * high:.0f} %"
              f"{'' if good else '   GOAL MISSED'}")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=60, help="recordings of a kind")
    options = parser.parse_args()
    print(f"seed {options.seed}, {options.runs} recordings of a kind")
    print(f"  {'':42s}{'predicted':>11s}{'found':>11s} {'':8s} ratio")
    study = Study()
    with ProcessPoolExecutor() as pool:

        def each(what, *arguments, runs=options.runs):
            """Of all runs, those that were not refused; by part of what one gives."""
            made = list(pool.map(partial(what, *arguments, options.seed), range(runs), chunksize=2))
            kept = [m for m in made if m is not None]
            return [np.array(part) for part in zip(*kept, strict=True)], 1 - len(kept) / runs

        _static(study, each)
        _positions(study, each)
        _others(study, each, options.runs)
    print(f"{study.missed} goals missed")


def _static(study: Study, each) -> None:
    for case, (terms, rate) in enumerate(RESTS):
        planned = static.shortest(terms, "bias_instability", 0.2 / 1.96, rate)
        print(f"static, {planned.seconds / 3600:g} h at {rate:g} Hz (case {case + 1})")
        (errors, stated), _ = each(rest, case, planned.seconds)
        for j, name in enumerate(TERMS):
            told = static.rest(terms, name, planned.seconds, rate)
            if told.stated:  # what is only bounded has no standard error
                study.row(name, errors[:, j], told.std, "%", 0.01)
        study.share("B stated", stated.mean(), 0.9, 1.0)
        short = planned.seconds / 16
        (_, stated), _ = each(rest, case, short)
        study.share("B stated in a sixteenth of it", stated.mean(), 0.0, 0.7)


def _positions(study: Study, each) -> None:
    scale, off = np.array([0, 2, 5]), np.array([1, 3, 4])
    diagonal = np.arange(0, 9, 4)
    of_turns = diagonal, np.setdiff1d(np.arange(9), diagonal), np.arange(9, 12)
    sensors = {"accelerometer": (scale, off, np.arange(6, 9)), "gyroscope": of_turns}
    accelerometer, gyroscope = (LEVELS[s] for s in sensors)
    for names, seconds in ((rests.EIGHTEEN, 4.0), (rests.EIGHTEEN, 10.0), (tuple(STANDARD), 6.0)):
        errors, refused = each(positions, names, seconds)
        turns = rests.gyroscope(gyroscope, accelerometer, names, seconds, LATITUDE)
        planned = {
            "accelerometer": rests.multi_position(accelerometer, names, seconds).every,
            "gyroscope": turns.every,
        }
        print(f"positions, {len(names)} rests of {seconds:g} s")
        for found, (sensor, columns) in zip(errors, sensors.items(), strict=True):
            _calibration(study, sensor, found, planned[sensor], columns)
        study.share("refused", refused, 0.0, 0.01)
    for seconds in (10.0, 30.0):
        errors, refused = each(faces, seconds)
        print(f"six_position, {seconds:g} s each")
        planned = rests.six_position(accelerometer, rests.SIX, seconds).every
        _calibration(study, "accelerometer", errors[0], planned, sensors["accelerometer"])
        study.share("refused", refused, 0.0, 0.01)
    short = tuple(n for n in STANDARD)[:8]
    study.share("positions, 8 attitudes: refused", _refused(short), 1.0, 1.0)


def _refused(names) -> float:
    """Share of recordings in these attitudes that the chapter refuses."""
    count = 0
    for k in range(5):
        made, a, g = moved(names, 6.0, 3.0, np.random.default_rng([k, 7]))
        try:
            multi_position(find_positions([a], [g], made["gravity"]).positions, made["gravity"])
        except Refusal:
            count += 1
    return count / 5


def _calibration(study: Study, sensor: str, errors, planned, columns) -> None:
    scale, off, bias = columns
    unit, size = ("mg", 9.80665e-3) if sensor == "accelerometer" else ("°/s", np.radians(1))
    study.row(f"{sensor}, bias", errors[:, bias], planned["bias"], unit, size)
    study.row(
        f"{sensor}, scale factor", errors[:, scale], planned["scale_factor_error"], "ppm", 1e-6
    )
    study.row(f"{sensor}, misalignment", errors[:, off], planned["misalignment"], "mrad", 1e-3)


def _others(study: Study, each, runs: int) -> None:
    for seconds, louder in ((60.0, 1.0), (180.0, 1.0), (60.0, 10.0)):
        levels = dict.fromkeys(
            "xyz", NoiseTerms(0.0, louder * MAGNETIC["magnetometer"]["random_walk"])
        )
        planned = rotation.rotation(levels, seconds).std
        (hard, soft, direction), refused = each(turn, seconds, louder)
        print(f"rotation, {seconds:g} s, {louder:g} times a consumer triad's noise")
        study.row("hard iron", hard, planned["hard_iron"], "nT", 1e-9)
        # The plan tells that of the worse of its diagonal and its cross terms.
        groups = soft[:, [0, 3, 5]], soft[:, [1, 2, 4]]
        worse = max(groups, key=lambda errors: np.mean(errors**2))
        study.row("soft iron", worse, planned["soft_iron"], "1e-3", 1e-3)
        study.row("direction", direction, planned["direction"], "°", np.radians(1))
        study.share("refused", refused, 0.0, 0.01)
    for cycles in (1, 3):
        planned = thermal.sweep(dict.fromkeys("xyz", SWEPT), 25.0, 0.5, cycles)
        (change,), _ = each(sweep, planned, runs=10 * runs)
        (right, half), _ = each(whole_sweep, planned, runs=max(8, runs // 6))
        print(f"thermal, {cycles} cycles of 25 °C at 0.5 °C/min")
        study.row("change", change, planned.std, "°/s", np.radians(1))
        told = np.degrees([planned.half, np.sqrt(np.mean(half[right] ** 2))])
        print(f"  half of the chapter's interval (jackknife){told[0]:11.4g}{told[1]:11.4g} °/s")
        study.share("degree found", right.mean(), 0.6, 1.0)
    for walk in (0.0, 2e-4):
        given = 2e-3, walk, 5e-3, 0.5
        planned = trajectory.aided(*given)
        (before, after), _ = each(aided, *given, runs=max(4, runs // 8))
        print(f"trajectory, a reference of 0.29° every 2 s, K {walk:g} rad/s/√s")
        study.row("just before a reference", before, planned.before, "°", np.radians(1))
        study.row("just after it", after, planned.after, "°", np.radians(1))


if __name__ == "__main__":
    main()
