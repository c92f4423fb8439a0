"""Turns of a compass, temperature sweeps, references and images, against what the chapters reach."""

from __future__ import annotations

import numpy as np
import pytest

from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References
from sensorbook.attitude.kalman import mekf
from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate
from sensorbook.noise.model import NoiseTerms
from sensorbook.plan import images, rotation, thermal, trajectory
from sensorbook.simulate.noise import coloured_noise
from sensorbook.simulate.rotation import NOISE, draw_iron, noisy, read_field, turned
from sensorbook.thermal import fit_thermal, reduce_sweep


def of(**levels: float) -> dict[str, NoiseTerms]:
    return dict.fromkeys("xyz", NoiseTerms(**levels))


def turned_readings(rng, seconds: float, louder: float):
    """Readings at 50 Hz of a magnetometer turned by hand in a room, T, and its hard iron."""
    field = rotation.FIELD * np.array([0, np.cos(1.0), -np.sin(1.0)])
    iron = draw_iron(rng, rotation.FIELD) | {"alignment": np.eye(3)}
    clean = read_field(turned(rng, round(50 * seconds), 50.0, field, 9.8)["field"], iron)
    noise = {k: louder * v for k, v in NOISE["magnetometer"].items()}
    return noisy(rng, clean, 50.0, noise), iron["hard_iron"]


@pytest.mark.parametrize("louder", [1.0, 10.0])
def test_a_hard_iron_scatters_as_predicted(louder):
    levels = of(random_walk=louder * NOISE["magnetometer"]["random_walk"])
    planned = rotation.rotation(levels, 60.0)
    errors = []
    for k in range(12):
        m, true = turned_readings(np.random.default_rng([1, k]), 60.0, louder)
        found = calibrate(m)
        assert found.method == "ellipsoid"
        errors.append(found.hard_iron - true)
    ratio = np.sqrt(np.mean(np.square(errors))) / planned.std["hard_iron"]
    assert 1 / 1.5 < ratio < 1.5


def test_a_turn_clearly_short_of_the_plan_is_worse():
    short, planned = [], []
    for k in range(4):
        m, _ = turned_readings(np.random.default_rng([2, k]), rotation.SECONDS[0], 1.0)
        planned.append(calibrate(m).std[:3].max())
        try:
            found = calibrate(m[: 50 * 4])  # a few seconds see a part of the sphere
            short.append(found.std[:3].max() if found.method == "ellipsoid" else np.inf)
        except Refusal:
            short.append(np.inf)
    assert max(planned) < rotation.FIELD / 100
    assert min(short) > 2 * max(planned)


def test_longer_turns_go_with_the_root_and_the_first_that_serves_is_taken():
    levels = of(random_walk=60e-9)
    one, four = (rotation.rotation(levels, s).std for s in (60.0, 240.0))
    # And a little faster: a minute's directions are not even.
    assert all(2.1 < one[q] / four[q] < 2.2 for q in rotation.QUANTITIES)
    found, reached = rotation.planned("hard_iron", one["hard_iron"] / 1.9 * 2.02, levels)
    assert reached
    assert found.seconds == 240
    assert not rotation.planned("hard_iron", 1e-12, levels)[1]


def swept(rng, plan: thermal.Sweep, rate: float, terms: NoiseTerms):
    """Time, temperature and three axes with a curve of degree 3, and its true change."""
    seconds = np.arange(round(plan.duration * rate)) / rate
    phase = seconds / plan.duration * plan.cycles % 1
    temperature = 10 + plan.span * (1 - np.abs(2 * phase - 1))
    u = 2 * (temperature - 10) / plan.span - 1
    levels = {t: getattr(terms, t) for t in ("random_walk", "bias_instability", "rate_random_walk")}
    noise = [coloured_noise(len(seconds), rate, rng, **levels) for _ in range(3)]
    curve = 1e-3 * (u + 0.8 * u**2 + 0.9 * u**3)
    return seconds, temperature, curve[:, None] + np.transpose(noise), 1e-3 * 2 * (1 + 0.9)


def test_a_change_with_temperature_scatters_as_predicted():
    terms = NoiseTerms(0.0, 1.7e-4, 3.9e-5, 5e-7)
    plan = thermal.sweep(dict.fromkeys("xyz", terms), 25.0, 0.5, 1)
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(25):
        *run, true = swept(rng, plan, 1.0, terms)
        reduced = reduce_sweep([tuple(run)])
        for column in reduced.values.T:
            fit = np.polynomial.Polynomial.fit(
                reduced.temperature, column, thermal.DEGREE, w=np.sqrt(reduced.weight)
            )
            errors.append(fit(35.0) - fit(10.0) - true)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(plan.std, rel=0.25)


def test_the_thermal_chapter_determines_what_was_planned_and_refuses_a_small_sweep():
    terms = NoiseTerms(0.0, 1.7e-4, 3.9e-5)
    plan, reached = thermal.planned(4e-4, dict.fromkeys("xyz", terms))
    assert reached
    *run, true = swept(np.random.default_rng(3), plan, 1.0, terms)
    run[2] = run[2][:, :1]
    found = fit_thermal(reduce_sweep([tuple(run)])).axes[0]
    assert found.model.to_results()["degree"] == thermal.DEGREE
    assert abs(found.change.value - true) < 4 * plan.std
    assert 0.3 < (found.change.high - found.change.value) / (2.2 * plan.std) < 3
    small = [run[0], 10 + (run[1] - 10) * 0.15, run[2]]
    with pytest.raises(Refusal, match=r"moves by 3\.7 °C|moves by 3\.8 °C"):
        reduce_sweep([tuple(small)])


def test_slow_sweeps_let_a_bias_wander_and_average_white_noise():
    white, walk = of(random_walk=1e-4), of(random_walk=1e-6, rate_random_walk=1e-6)
    fast, slow = ([thermal.sweep(t, 25.0, p, 1).std for t in (white, walk)] for p in (0.5, 0.125))
    assert slow[0] == pytest.approx(fast[0] / 2, rel=0.01)
    assert slow[1] == pytest.approx(fast[1] * 2, rel=0.05)


@pytest.mark.parametrize("walk", [0.0, 2e-4])
def test_an_aided_attitude_errs_as_predicted(walk):
    white, reference, rate, each = 2e-3, 5e-3, 0.5, 10.0
    planned = trajectory.aided(white, walk, reference, rate)
    rng = np.random.default_rng(1)
    count, period = 16_000, round(each / rate)
    time = np.arange(count + 1) / each
    bias = np.cumsum(walk / np.sqrt(each) * rng.standard_normal((count, 3)), axis=0)
    turned_by = (bias + white * np.sqrt(each) * rng.standard_normal((count, 3))) / each
    at = np.arange(0, count + 1, period)
    half = reference * rng.standard_normal((len(at), 3)) / 2
    quaternion = np.c_[half, np.ones(len(at))]
    quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
    covariance = np.broadcast_to(reference**2 * np.eye(3), (len(at), 3, 3))
    noise = GyroscopeNoise(white, walk, bias_std=1e-6 if not walk else 1e-3)
    found = mekf(Motion.of(time, turned_by), References(at, quaternion, covariance), noise)
    error = found.errors(np.tile([0.0, 0, 0, 1], (count + 1, 1)))
    settled = at[len(at) // 10 :]
    after = np.sqrt(np.mean(error[settled] ** 2))
    before = np.sqrt(np.mean(error[settled - 1] ** 2))
    assert after == pytest.approx(planned.after, rel=0.1)
    # One interval of the gyroscope before the reference.
    assert before == pytest.approx(planned.before, rel=0.1)
    assert planned.before > planned.after


def test_references_come_no_more_often_than_needed():
    levels = of(random_walk=2e-4, rate_random_walk=1e-6)
    given = {"in_motion": 2e-3, "turning": 0.5, "reference": 0.01}
    found, reached = trajectory.planned(3e-3, levels, **given)
    assert reached
    rarer = trajectory.RATES[trajectory.RATES.index(found.rate) - 1]
    density = trajectory.density(levels["x"], 2e-3, 0.5)
    assert found.before <= 3e-3 < trajectory.aided(density, 1e-6, 0.01, rarer).before
    assert not trajectory.planned(1e-6, levels, **given)[1]
    assert found.seconds * found.rate >= 30  # windows that the chapter's tuning needs


def test_finer_images_need_a_longer_lens():
    own, needed = images.planned(1e-5)
    assert 0 < own.std < np.radians(0.05)
    assert needed.std == pytest.approx(1e-5)
    assert needed.focal_px == pytest.approx(own.focal_px * own.std / 1e-5)
