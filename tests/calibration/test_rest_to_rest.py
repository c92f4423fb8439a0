"""A gyroscope without a rate table: its rests, its motions, its nine parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.calibration import calibrate_gyroscope, find_positions, multi_position
from sensorbook.calibration.motions import (
    Directions,
    all_motions,
    predicted,
    rotation_matrices,
)
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.calibration.rest_to_rest import held_out_turns, rest_to_rest, turned_angles
from sensorbook.earth import EARTH_RATE
from sensorbook.errors import Refusal
from sensorbook.recordings.recording import Recording
from sensorbook.simulate.positions import EDGES, FACES, LATITUDE, RATE, hand_moved

from .sets import EIGHTEEN, rests

G = 9.80665
QUIET = {
    sensor: {"random_walk": 1e-9, "bias_instability": 1e-9, "full_scale": 20.0}
    for sensor in ("accelerometer", "gyroscope")
}


def moved(seed, directions=(*FACES, *EDGES), **more):
    made = hand_moved(np.random.default_rng([seed, 0xF2]), directions, gravity=G, **more)
    a, w = (
        Recording(s, "positions", "log.csv", made["t"], made[s], rate=RATE)
        for s in ("accelerometer", "gyroscope")
    )
    return a, w, made["errors"]["gyroscope"]


def calibrated(a, w, latitude=LATITUDE):
    found = find_positions([a], [w], G)
    level = multi_position(found.positions, G)
    directions = Directions.by(level, found.positions)
    fit = fit_rests(found.gyroscope, directions.acceleration, latitude)
    return all_motions([w], [a], found, directions, level.model, fit), fit


def test_without_noise_the_truth_comes_out():

    a, w, true = moved(1, noise=QUIET)
    motions, fit = calibrated(a, w)
    found = rest_to_rest(motions, fit, G)
    # Averages over samples of 10 ms leave the integral of a jerked motion to some 0.005°.
    np.testing.assert_allclose(found.model.matrix, true["matrix"], rtol=0, atol=2e-4)
    assert np.degrees(found.direction_errors[1]) < 0.02


def test_the_errors_are_those_that_are_stated():
    """25 devices: intervals of matrix, bias and sensitivity hold the truth."""
    covered = []
    for seed in range(25):
        a, w, true = moved(seed + 100)
        motions, fit = calibrated(a, w)
        found = rest_to_rest(motions, fit, G, check=False)
        if found.g_free.all():
            continue  # cross terms seen by chance, 0.3 % of devices
        truth = np.r_[true["matrix"].ravel(), true["bias"], true["g_sensitivity"]]
        covered.append(np.abs(found.values - truth) <= found.interval_factor * found.std)
    assert len(covered) >= 23
    # 25 · 15 intervals, correlated within a device: 95 % ± 1.5 %, three times that.
    assert 0.905 <= np.mean(covered) <= 0.99


def test_held_out_is_larger_than_fitted_and_far_below_nominal():
    a, w, _ = moved(3)
    motions, fit = calibrated(a, w)
    found = rest_to_rest(motions, fit, G)
    before, after, check = found.direction_errors
    assert after < check < 3 * after
    assert before > 10 * check
    assert np.sqrt(np.mean(held_out_turns(motions[found.kept]) ** 2)) == pytest.approx(check)


def test_two_line_form():
    a, w, true = moved(4)
    found = calibrate_gyroscope(w, a, G)
    np.testing.assert_allclose(found.model.matrix, true["matrix"], atol=2e-3)
    assert found.to_results()["method"] == "rest_to_rest"


def test_a_jerked_motion_is_named():
    a, w, _ = moved(5)
    motions, fit = calibrated(a, w)
    turns = motions.turns.copy()
    turns[6, 20] += [0.05, 0.02, 0.0]  # 3° that no sample tells of
    found = rest_to_rest(replace(motions, turns=turns), fit, G)
    assert motions.labels[6] in found.rejected
    assert len(found.rejected) <= 2


# --- refusals ---


def test_turned_about_one_axis_only():
    ring = [(np.cos(t), np.sin(t), 0.0) for t in np.linspace(0, 2 * np.pi, 16, endpoint=False)]
    rng = np.random.default_rng(6)
    u = np.array(ring)
    angle = np.diff(np.unwrap(np.arctan2(u[:, 1], u[:, 0])))
    turns = np.zeros((15, 10, 3))
    turns[:, :, 2] = -angle[:, None] / 10
    turns += 1e-4 * rng.standard_normal(turns.shape)
    from sensorbook.calibration.motions import Motions

    frame = np.zeros((15, 3, 9))
    motions = Motions(turns, np.ones(15), u[:-1], u[1:], frame, frame, tuple(map(str, range(15))))
    with pytest.raises(Refusal) as caught:
        rest_to_rest(motions, fit_of(rng), G)
    assert "turn the device too little about" in caught.value.reason
    assert "Add motions of 90° and more about" in caught.value.remedy


def fit_of(rng):
    positions = rests(EIGHTEEN, rng, matrix=np.eye(3), bias=np.zeros(3))
    still = replace(
        positions, samples=tuple(1e-3 * rng.standard_normal(s.shape) for s in positions.samples)
    )
    return fit_rests(still, G * EIGHTEEN, LATITUDE)


def test_too_few_motions():
    a, w, _ = moved(7)
    motions, fit = calibrated(a, w)
    with pytest.raises(Refusal, match="There are 6 motions"):
        rest_to_rest(motions[:6], fit, G)


def test_motions_with_missing_samples_are_left_out():
    a, w, _ = moved(8)
    found = find_positions([a], [w], G)
    end, start = found.positions.spans[4, 1], found.positions.spans[5, 0]
    middle = (end + start) / 2
    keep = (w.time < middle - 0.1) | (w.time > middle + 0.1)
    whole, _ = calibrated(a, w)
    holed, _ = calibrated(a, w._rows(keep))
    assert len(holed) == len(whole) - 1
    assert "5 → 6" not in holed.labels


def test_well_posed_devices_are_not_refused():
    for seed in range(30, 40):
        motions, fit = calibrated(*moved(seed)[:2])
        rest_to_rest(motions, fit, G, check=False)


# --- rests ---


def still(rng, g=None, bias=(0.01, -0.02, 0.005), noise=2e-3, earth=EARTH_RATE):
    """Rests of a gyroscope in 18 attitudes, heading at random."""
    parts = []
    for u in EIGHTEEN:
        across = np.cross(u, rng.standard_normal(3))
        level = across / np.linalg.norm(across) * np.cos(np.radians(LATITUDE))
        turn = earth * (u * np.sin(np.radians(LATITUDE)) + level)
        mean = np.array(bias) + turn + (0 if g is None else np.asarray(g) @ (G * u))
        parts.append(mean + noise * rng.standard_normal((400, 3)))
    ends = 10.0 * np.arange(18)[:, None] + [0.0, 4.0]
    return Positions(tuple(parts), ends, tuple(map(str, range(18))), np.zeros(18, dtype=int))


def test_cross_terms_of_the_g_sensitivity():
    """0.1 °/s/g off the diagonal is found; none is claimed where there is none."""
    g = np.zeros((3, 3))
    g[0, 1] = g[2, 0] = np.radians(0.1) / G
    fit = fit_rests(still(np.random.default_rng(50), g), G * EIGHTEEN, LATITUDE)
    assert fit.g_free.all()
    assert fit.visible
    np.testing.assert_allclose(fit.g_sensitivity, g, atol=5e-5)
    false_cross = false_any = 0
    for seed in range(200):
        fit = fit_rests(still(np.random.default_rng([seed, 51])), G * EIGHTEEN, LATITUDE)
        false_cross += bool(fit.g_free.all())
        false_any += fit.visible
    assert false_cross <= 4  # 0.3 % nominal
    assert false_any <= 5


def test_the_earth_s_rate_about_the_vertical():
    rng = np.random.default_rng(52)
    positions = still(rng, noise=2e-5)
    known = fit_rests(positions, G * EIGHTEEN, LATITUDE)
    assert not known.visible
    unknown = fit_rests(positions, G * EIGHTEEN, None)
    # ω_e sin φ / g looks like a sensitivity, which the uncertainty without a latitude covers.
    like = EARTH_RATE * np.sin(np.radians(LATITUDE)) / G
    std = np.sqrt(np.diag(unknown.covariance)[3:6])
    assert (std > like / 2).all()
    assert not unknown.visible


def test_too_few_rests():
    rng = np.random.default_rng(53)
    with pytest.raises(Refusal, match="The gyroscope has 5 rests"):
        fit_rests(still(rng)[:5], G * EIGHTEEN[:5], LATITUDE)


# --- parts ---


def test_rotation_matrices():
    rng = np.random.default_rng(60)
    vectors = np.vstack([rng.standard_normal((20, 3)), 1e-9 * np.ones(3), np.zeros(3)])
    expected = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(rotation_matrices(vectors), expected, rtol=0, atol=1e-14)


def test_derivatives_of_the_carried_direction():
    motions, _ = calibrated(*moved(61)[:2])
    motions = motions[:4]
    inverse = np.eye(3) + 0.01 * np.random.default_rng(61).standard_normal((3, 3))
    end, derivative, _ = predicted(motions, inverse)
    for k in range(9):
        step = np.zeros(9)
        step[k] = 1e-6
        up, down = (predicted(motions, inverse + s * step.reshape(3, 3))[0] for s in (1, -1))
        # Taken as if each step's turn were small, which costs a percent at some degrees a step.
        np.testing.assert_allclose(derivative[:, :, k], (up - down) / 2e-6, atol=0.03)
    np.testing.assert_allclose(np.linalg.norm(end, axis=1), 1, atol=1e-12)


def test_the_accelerometer_s_uncertainty_in_the_directions():
    rng = np.random.default_rng(62)
    positions = rests(EIGHTEEN, rng)
    level = multi_position(positions, G)
    directions = Directions.by(level, positions)
    factor = np.linalg.cholesky(level.covariance)
    for k in range(9):
        shift = 1e-3 * factor[:, k]
        moved_by = []
        for sign in (1, -1):
            matrix = level.model.matrix.copy()
            matrix[level.free] += sign * shift[:6]
            model = replace(level.model, matrix=matrix, bias=level.model.bias + sign * shift[6:])
            true = model.correct(positions.means)
            moved_by.append(true / np.linalg.norm(true, axis=1)[:, None])
        np.testing.assert_allclose(
            directions.frame[:, :, k], (moved_by[0] - moved_by[1]) / 2e-3, rtol=0, atol=1e-9
        )


def test_turned_angles():
    motions, _ = calibrated(*moved(63)[:2])
    angles = np.degrees(turned_angles(motions))
    assert (angles < 181).all()
    assert angles.mean() > 60


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda w: w[:, [1, 0, 2]],
            "axes are not the accelerometer's|does not carry the direction",
        ),
        (lambda w: w * [-1, 1, 1], "axes are not the accelerometer's|does not carry the direction"),
        (lambda w: np.clip(w, -0.5, 0.5), "does not carry the direction of gravity"),
        (lambda w: np.degrees(w), "By its unit the gyroscope turns by"),
    ],
)
def test_a_gyroscope_that_does_not_fit_is_refused(change, words):
    a, w, _ = moved(70)
    motions, fit = calibrated(a, replace(w, values=change(np.asarray(w.values))))
    with pytest.raises(Refusal, match=words):
        rest_to_rest(motions, fit, G)


def test_a_clock_three_seconds_off_is_refused():
    a, w, _ = moved(71)
    found = find_positions([a], [w], G)
    level = multi_position(found.positions, G)
    directions = Directions.by(level, found.positions)
    fit = fit_rests(found.gyroscope, directions.acceleration, LATITUDE)
    late = replace(w, time=w.time + 1.5)
    motions = all_motions([late], [a], found, directions, level.model, fit)
    with pytest.raises(Refusal, match="share one clock"):
        rest_to_rest(motions, fit, G)
