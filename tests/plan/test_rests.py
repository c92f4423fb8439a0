"""Attitudes and lengths of rests, against recordings moved as planned that the chapters calibrate."""

from __future__ import annotations

import numpy as np
import pytest

from sensorbook.calibration import find_faces, find_positions, multi_position, six_position
from sensorbook.calibration.coverage import STANDARD
from sensorbook.calibration.motions import Directions, all_motions
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.calibration.rest_to_rest import rest_to_rest
from sensorbook.errors import Refusal
from sensorbook.noise.model import NoiseTerms
from sensorbook.plan import rests
from sensorbook.plan.means import about_the_whole, covariance_of_means
from sensorbook.recordings import Recording
from sensorbook.simulate.noise import coloured_noise
from sensorbook.simulate.positions import LATITUDE, NOISE, RATE, hand_moved

SEEDS = 8  # of three axes each
LEVELS = {
    sensor: dict.fromkeys("xyz", NoiseTerms(0.0, n["random_walk"], n["bias_instability"]))
    for sensor, n in NOISE.items()
}


def recordings(rng, names, levelling: float, seconds: float):
    up = [STANDARD[name] for name in names]
    made = hand_moved(rng, up, levelling, initial=0.0, seconds=(seconds, seconds))
    runs = {
        s: Recording(s, "positions", "simulated", made["t"], made[s], rate=RATE) for s in LEVELS
    }
    return made, runs


def grouped(errors: np.ndarray, scale: np.ndarray, off: np.ndarray, bias: np.ndarray) -> dict:
    """rms over seeds and axes of each quantity."""
    columns = dict(zip(rests.QUANTITIES, (bias, scale, off), strict=True))
    return {name: rms(errors[:, at]) for name, at in columns.items()}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_means_err_as_stated():
    terms = NoiseTerms(random_walk=1.0, bias_instability=0.7, rate_random_walk=0.05)
    start, seconds = np.array([0.0, 20, 40, 70]), np.array([10.0, 10, 20, 30])
    rng = np.random.default_rng(1)
    means = []
    for _ in range(1000):
        x = coloured_noise(
            1000, 10.0, rng, random_walk=1.0, bias_instability=0.7, rate_random_walk=0.05
        )
        means.append([x[:100].mean(), x[200:300].mean(), x[400:600].mean(), x[700:].mean()])
    apart = np.eye(4) - 1 / 4
    found = np.cov((np.array(means) @ apart.T).T)
    expected = apart @ covariance_of_means(start, seconds, terms) @ apart.T
    assert found == pytest.approx(expected, abs=0.06 * expected.max())


def test_white_noise_is_no_part_of_the_bias():
    start, seconds = np.array([0.0, 10.0]), np.array([4.0, 8.0])
    found = about_the_whole(start, seconds, NoiseTerms(random_walk=2.0))
    assert found == pytest.approx(np.diag([1.0, 0.5]))


def test_estimates_scatter_as_predicted():
    seconds = 6.0
    accelerometer, gyroscope = (LEVELS[s] for s in ("accelerometer", "gyroscope"))
    planned = {
        "accelerometer": rests.multi_position(accelerometer, rests.EIGHTEEN, seconds).every,
        "gyroscope": rests.gyroscope(
            gyroscope, accelerometer, rests.EIGHTEEN, seconds, LATITUDE
        ).every,
    }
    errors = {"accelerometer": [], "gyroscope": []}
    for k in range(SEEDS):
        made, runs = recordings(np.random.default_rng([2, k]), rests.EIGHTEEN, 4.0, seconds)
        a, g = runs["accelerometer"], runs["gyroscope"]
        found = find_positions([a], [g], made["gravity"])
        level = multi_position(found.positions, made["gravity"], check=False)
        found = found[level.kept]
        directions = Directions.by(level, found.positions)
        fit = fit_rests(found.gyroscope, directions.acceleration, LATITUDE)
        motions = all_motions([g], [a], found, directions, level.model, fit)
        turned = rest_to_rest(motions, fit, made["gravity"], check=False)
        for sensor, c, count in (("accelerometer", level, 9), ("gyroscope", turned, 12)):
            true = made["errors"][sensor]
            errors[sensor].append(c.values[:count] - np.r_[true["matrix"][c.free], true["bias"]])
    scale, off = np.array([0, 2, 5]), np.array([1, 3, 4])
    found = grouped(np.array(errors["accelerometer"]), scale, off, np.arange(6, 9))
    for name, each in planned["accelerometer"].items():
        assert 1 / 1.5 < found[name] / rms(each) < 1.5, name
    scale = np.array([0, 4, 8])
    off = np.setdiff1d(np.arange(9), scale)
    found = grouped(np.array(errors["gyroscope"]), scale, off, np.arange(9, 12))
    for name, each in planned["gyroscope"].items():
        assert 1 / 1.5 < found[name] / rms(each) < 1.5, name


@pytest.mark.parametrize("levelling", [0.2, 0.05])
def test_levelled_faces_scatter_as_predicted(levelling):
    seconds = 10.0
    levels = LEVELS["accelerometer"]
    planned = rests.six_position(levels, rests.SIX, seconds, levelling).every
    errors = []
    for k in range(SEEDS):
        made, runs = recordings(np.random.default_rng([3, k]), rests.SIX, levelling, seconds)
        found, up = find_faces([runs["accelerometer"]], made["gravity"])
        c = six_position(found.positions, up, made["gravity"])
        true = made["errors"]["accelerometer"]
        errors.append(c.values - np.r_[true["matrix"][c.free], true["bias"]])
    scale, off = np.array([0, 2, 5]), np.array([1, 3, 4])
    found = grouped(np.array(errors), scale, off, np.arange(6, 9))
    for name, each in planned.items():
        assert 1 / 1.5 < found[name] / rms(each) < 1.5, name


@pytest.mark.parametrize("kind", ["positions", "six_position"])
def test_the_plan_is_the_shortest_that_serves_and_longer_is_better(kind):
    levels = LEVELS["accelerometer"]
    wide, reached = rests.planned(kind, "bias", 15e-4, terms=levels)
    narrow, reached_too = rests.planned(kind, "bias", 7e-4, terms=levels)
    assert reached
    assert reached_too
    assert narrow.half["bias"] <= 7e-4 < wide.half["bias"] <= 15e-4
    assert narrow.half["bias"] > 2 * narrow.std["bias"]  # few degrees of freedom
    assert narrow.duration > wide.duration
    nothing, reached = rests.planned(kind, "bias", 1e-9, terms=levels)
    assert not reached
    assert nothing.std["bias"] > 1e-9


def test_what_the_chapter_refuses_is_not_planned():
    levels = LEVELS["accelerometer"]
    names = rests.SIX + rests.EIGHTEEN[6:8]
    with pytest.raises(ValueError, match="8 attitudes"):
        rests.multi_position(levels, names, 6.0)
    made, runs = recordings(np.random.default_rng(4), names, 3.0, 6.0)
    found = find_positions([runs["accelerometer"]], [], made["gravity"])
    with pytest.raises(Refusal, match="do not determine"):
        multi_position(found.positions, made["gravity"])


def test_the_shortest_plan_is_not_refused():
    levels = LEVELS["accelerometer"]
    planned, _ = rests.planned("positions", "bias", 1.0, terms=levels)
    for k in range(2):
        rng = np.random.default_rng([5, k])
        made, runs = recordings(rng, planned.attitudes, 4.0, planned.seconds)
        found = find_positions([runs["accelerometer"]], [runs["gyroscope"]], made["gravity"])
        assert len(found.positions) == len(planned.attitudes)
        assert multi_position(found.positions, made["gravity"], check=False).kept.all()
