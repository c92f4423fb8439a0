"""Preset `trajectory`: the motion that is stated, C's experiment on it, and a device true to its truth."""

import hashlib
import json

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook.attitude.rotations import error_vector, matrix_from_quaternion, transform
from sensorbook.earth import field_in_ned, normal_gravity
from sensorbook.guessing import guess_files
from sensorbook.noise import identify_noise
from sensorbook.recordings import check
from sensorbook.simulate import simulate
from sensorbook.simulate.trajectory import (
    C_BIAS,
    C_OUTAGE,
    C_STEP,
    LONGEST_RUN,
    NOISE,
    PITCH,
    ROLL,
    SITE,
    YAW,
    angles,
    experiment,
    motion,
    place,
)

SAMPLE = 0.169  # rad/s, white noise of one of C's readings as methods print it: √(0.001/0.035)
ERROR = np.radians(0.05)


def ned_to_body(yaw, pitch, roll):
    """(N, 3, 3) direction-cosine matrices of the sequence Z-Y-X as textbooks print them."""
    (cy, cp, cr), (sy, sp, sr) = ((f(yaw), f(pitch), f(roll)) for f in (np.cos, np.sin))
    rows = [
        [cp * cy, cp * sy, -sp],
        [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
        [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def errors(estimated, true):
    """(N, 3) rad, of quaternions (N, 4)."""
    return error_vector(matrix_from_quaternion(estimated), matrix_from_quaternion(true))


def integrated(start, rate, step=C_STEP):
    """(N, 4) attitudes by (5.2) from the first on, each rate over the interval before its stamp."""
    now, path = Rotation.from_quat(start), [start]
    for turn in rate[1:] * step:
        now = now * Rotation.from_rotvec(turn)
        path.append(now.as_quat())
    return np.array(path)


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


# ---- motion ----


def test_the_attitude_is_the_stated_angles():
    made = motion(60.0)
    expected = ned_to_body(*angles(made.time).T)
    np.testing.assert_allclose(matrix_from_quaternion(made.true), expected, rtol=0, atol=1e-14)
    # By hand, at 2 s: degrees of each sinusoid's phase, then the sum.
    by_hand = [
        60 * np.sin(np.radians(31.304348)) + 25 * np.sin(np.radians(138.630137)),
        30 * np.sin(np.radians(125.384615)) + 18 * np.sin(np.radians(318.032787)),
        40 * np.sin(np.radians(172.352941)) + 22 * np.sin(np.radians(445.849057)),
    ]
    np.testing.assert_allclose(np.degrees(angles(2.0)), by_hand, rtol=0, atol=1e-5)


def test_the_motion_stays_away_from_lock_and_is_lively():
    time = np.arange(0, 3600, 0.05)
    assert np.degrees(np.abs(angles(time)[:, 1])).max() < 50
    rate = np.degrees(np.sqrt((motion().rate ** 2).mean(axis=0)))
    assert rate.min() > 10  # °/s rms
    assert rate.max() < 30


def test_rates_are_those_of_the_angles():
    """Against the kinematics of Z-Y-X with derivatives by hand, in the middle of each interval."""
    made = motion(60.0)
    middle = made.time - C_STEP / 2
    yaw_rate, pitch_rate, roll_rate = (
        sum(
            np.radians(a) * 2 * np.pi / t * np.cos(2 * np.pi * middle / t + np.radians(p))
            for a, t, p in rows
        )
        for rows in (YAW, PITCH, ROLL)
    )
    _, pitch, roll = angles(middle).T
    expected = np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
            -pitch_rate * np.sin(roll) + yaw_rate * np.cos(pitch) * np.cos(roll),
        ],
        axis=-1,
    )
    # The mean differs from the middle's by Δt²/24 of a second derivative of 1 rad/s³: 5e-5.
    np.testing.assert_allclose(made.rate, expected, rtol=0, atol=2e-4)


def test_readings_lag_by_half_an_interval():
    """Least squares of the delay that takes the true rate at the stamps to the readings."""
    made = motion(60.0)
    # Ten points an interval are enough: they leave h² ω × ω′/12 with h = 3.5 ms.
    np.testing.assert_allclose(made.rate, motion(60.0, finer=100).rate, rtol=0, atol=2e-6)
    smooth = motion(60.0, C_STEP / 100, finer=1).rate[::100]  # of the last 0.35 ms: nearly at once
    slope = np.gradient(smooth, C_STEP, axis=0)
    delay = -((made.rate - smooth) * slope).sum() / (slope**2).sum()
    assert delay == pytest.approx((C_STEP - C_STEP / 100) / 2, rel=5e-3)


def test_averaged_rates_lose_only_the_coning_within_an_interval():
    made = motion(60.0)
    error = np.linalg.norm(errors(integrated(made.true[0], made.rate), made.true), axis=1)
    # 0.011° at most in 60 s: a mean rate is the mean rotation but for Δt³ ω × ω′/12.
    assert 1e-4 < np.degrees(error.max()) < 0.02


def test_force_and_field_are_the_site_s_in_the_body():
    made = motion(60.0)
    middle, h = made.time - C_STEP / 2, 1e-3
    moved = (place(middle + h) - 2 * place(middle) + place(middle - h)) / h**2
    assert 0.1 < np.sqrt((moved**2).mean()) < 0.3  # m/s²: a hand's
    assert np.abs(place(middle)).max() < 0.1  # m
    down = normal_gravity(SITE["latitude"], SITE["height"]) * np.array([0, 0, 1])
    turn = ned_to_body(*angles(middle).T)
    # Means and the middle differ by Δt²/24 times some ω² of the value: 5e-5 of it.
    force = np.einsum("nij,nj->ni", turn, moved - down)
    np.testing.assert_allclose(made.force, force, rtol=0, atol=2e-3)
    where = np.radians([SITE["latitude"], SITE["longitude"]])
    field = field_in_ned(*where, SITE["height"], SITE["date"])
    assert field[1] > 1e-6  # T: its declination is there, 6° east
    np.testing.assert_allclose(made.field, turn @ field, rtol=0, atol=1e-8)


# ---- experiment ----


@pytest.fixture(scope="module")
def runs():
    return [experiment(seed) for seed in range(8)]


def test_the_experiment_is_c_s(runs):
    run = runs[0]
    assert len(run.time) == len(run.rate) == len(run.reference) == 1715
    np.testing.assert_allclose(np.diff(run.time), 0.035, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(run.bias, [0.03, 0.04, -0.01])
    np.testing.assert_array_equal(run.true, motion(60.0).true)
    assert run.time[0] == 0


def test_the_true_rates_integrate_to_the_truth_exactly(runs):
    path = integrated(runs[0].true[0], runs[0].true_rate)
    # 1714 products: rounding alone.
    assert np.abs(errors(path, runs[0].true)).max() < 1e-12
    # The first rate belongs to the interval before 0 s.
    before = ned_to_body(*angles(np.array([-C_STEP, 0.0])).T)
    turned = error_vector(before[1], before[0])
    np.testing.assert_allclose(runs[0].true_rate[0], turned / C_STEP, rtol=0, atol=1e-12)


def test_noise_and_bias_of_the_readings(runs):
    added = np.concatenate([run.rate - run.true_rate for run in runs])
    n = len(added)
    # Four standard errors.
    np.testing.assert_allclose(added.mean(axis=0), C_BIAS, rtol=0, atol=4 * SAMPLE / n**0.5)
    np.testing.assert_allclose(added.std(axis=0), SAMPLE, rtol=4 / (2 * n) ** 0.5)
    white = (added - added.mean(axis=0)) / SAMPLE
    assert abs((white[1:] * white[:-1]).mean()) < 4 / (3 * n) ** 0.5
    across = np.corrcoef(white.T)[np.triu_indices(3, 1)]
    assert np.abs(across).max() < 4 / n**0.5


def test_errors_of_the_reference(runs):
    off = np.concatenate([errors(run.reference, run.true) for run in runs])
    n = len(off)
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=4 * ERROR / n**0.5)
    np.testing.assert_allclose(off.std(axis=0), ERROR, rtol=4 / (2 * n) ** 0.5)
    assert abs((off[1:] * off[:-1]).mean()) < 4 * ERROR**2 / (3 * n) ** 0.5


def test_a_seed_is_a_run_and_moves_no_truth(runs):
    again = experiment(np.random.default_rng(3))
    np.testing.assert_array_equal(again.rate, runs[3].rate)
    np.testing.assert_array_equal(again.reference, runs[3].reference)
    assert np.abs(runs[3].rate - runs[4].rate).max() > SAMPLE
    np.testing.assert_array_equal(runs[3].true, runs[4].true)
    np.testing.assert_array_equal(runs[3].true_rate, runs[4].true_rate)


def test_other_errors():
    run = experiment(1, 10.0, 0.01, bias=(0, 0, 0), random_walk=0.0, reference_error=0.0)
    assert len(run.time) == 1001
    np.testing.assert_array_equal(run.rate, run.true_rate)
    np.testing.assert_allclose(run.reference, run.true, rtol=0, atol=1e-15)
    noisy = experiment(1, 100.0, 0.01, random_walk=0.002)
    # N/√Δt of 30 003 values, known to 0.4 %.
    assert (noisy.rate - noisy.true_rate).std(axis=0) == pytest.approx(0.02, rel=0.02)


# ---- the folder ----


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "turned", "trajectory", seed=5)


@pytest.fixture(scope="module")
def device(folder):
    return sensorbook.load(folder)


@pytest.fixture(scope="module")
def truth(folder):
    """The attitude (N, 4) that truth.json names."""
    name = json.loads((folder / "truth.json").read_text())["attitude"]
    return pd.read_csv(folder / name)


def test_same_seed_same_bytes(folder, tmp_path):
    one = digests(folder)
    assert digests(simulate(tmp_path / "turned", "trajectory", seed=5)) == one
    other = digests(simulate(tmp_path / "other" / "turned", "trajectory", seed=6))
    assert set(one) == {"device.toml", "truth.json", "truth.csv", "trajectory.csv", "rest.npz"}
    differ = {name for name in one if one[name] != other[name]}
    assert differ == {"trajectory.csv", "rest.npz"}


def test_nothing_to_mend(folder):
    problems, _ = check(folder)
    assert problems == []


def test_recordings(device):
    for sensor in ("gyroscope", "accelerometer", "magnetometer", "reference"):
        run = device.runs(sensor, "trajectory")[0]
        assert (len(run), run.file) == (5144, "trajectory.csv")
        assert run.rate == pytest.approx(1 / 0.035)
    assert device.reference.trajectory.declaration["quaternion"] == "reference_to_body"
    rest = device.gyroscope.static
    assert rest.duration == pytest.approx(1200, abs=0.035)
    assert device.site["date"] == SITE["date"]


def test_truth(device, truth):
    assert device.truth["bias"] == [0.03, 0.04, -0.01]
    assert device.truth["delay"] == 0.0175
    assert device.truth["reference_error"] == pytest.approx(np.radians(0.05))
    for axis in "xyz":
        assert device.truth["noise"]["gyroscope"][axis]["random_walk"] ** 2 == pytest.approx(0.001)
    np.testing.assert_allclose(truth["t"], device.gyroscope.trajectory.time, rtol=0, atol=1e-9)
    expected = ned_to_body(*angles(truth["t"].to_numpy()).T)
    found = matrix_from_quaternion(truth[["qx", "qy", "qz", "qw"]])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # nine digits are written


def test_readings_are_the_motion_with_the_sensors_noise(device):
    made = motion()
    true = {
        "gyroscope": made.rate + C_BIAS,
        "accelerometer": made.force,
        "magnetometer": made.field,
    }
    for sensor, expected in true.items():
        added = device.runs(sensor, "trajectory")[0].values - expected
        scatter, n = NOISE[sensor]["random_walk"] / C_STEP**0.5, len(added)
        np.testing.assert_allclose(added.mean(axis=0), 0, atol=4 * scatter / n**0.5)
        np.testing.assert_allclose(added.std(axis=0), scatter, rtol=4 / (2 * n) ** 0.5)


def test_the_reference_is_missing_in_the_outage_and_in_short_runs(device):
    reference = device.reference.trajectory
    lost = np.isnan(reference.values)
    np.testing.assert_array_equal(lost.any(axis=1), lost.all(axis=1))
    lost, time = lost[:, 0], reference.time
    outage = (time >= C_OUTAGE[0]) & (time < C_OUTAGE[1])
    assert lost[outage].all()
    n = np.count_nonzero(~outage)
    assert 0.03 <= lost[~outage].mean() < 0.03 + LONGEST_RUN / n
    edges = np.flatnonzero(np.diff(np.r_[False, lost, False].astype(int))).reshape(-1, 2)
    lengths = np.diff(edges, axis=1).ravel()
    # Runs may meet one another, and the outage.
    assert len(lengths) > 20
    assert np.sort(lengths)[-2] <= 3 * LONGEST_RUN


def test_the_file_s_quaternion_turns_north_east_down_into_the_body(folder, device):
    """The sense that is declared, by sensors that know nothing of it."""
    table = pd.read_csv(folder / "trajectory.csv").dropna()
    q = Rotation.from_quat(table[["qx", "qy", "qz", "qw"]])  # active: q v q*
    up = q.apply([0, 0, -1.0])
    force = table[["ax", "ay", "az"]].to_numpy()
    force /= np.linalg.norm(force, axis=1)[:, None]
    # 0.2 m/s² of true acceleration in 9.8 turn it by a degree or two, the delay by half a degree.
    assert np.median((up * force).sum(axis=1)) > np.cos(np.radians(3))
    field = field_in_ned(*np.radians([39.89, 32.78]), 900.0, "2024-05-01")
    read = 1e-6 * table[["mx", "my", "mz"]].to_numpy()
    # 0.32 µT of noise an axis, and the delay's 0.2 µT.
    assert np.sqrt(((q.apply(field) - read) ** 2).mean()) < 0.5e-6
    # The house's numbers are the conjugates.
    own = q.inv().as_quat()
    np.testing.assert_allclose(transform(own, field), q.apply(field), rtol=0, atol=1e-15)
    # And the other sense would be far off.
    assert np.median((q.inv().apply([0, 0, -1.0]) * force).sum(axis=1)) < np.cos(np.radians(20))
    guessed = guess_files([folder / "trajectory.csv"]).recordings
    assert [r.table.get("quaternion") for r in guessed][-1] == "reference_to_body"


def test_the_reference_errs_by_what_truth_says(device, truth):
    values = device.reference.trajectory.values
    there = np.isfinite(values).all(axis=1)
    off = errors(Rotation.from_quat(values[there]).inv().as_quat(),
                 truth.loc[there, ["qx", "qy", "qz", "qw"]])  # fmt: skip
    n = len(off)
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=4 * ERROR / n**0.5)
    np.testing.assert_allclose(off.std(axis=0), ERROR, rtol=4 / (2 * n) ** 0.5)


def test_the_rest_has_the_trajectory_s_noise_and_bias(device):
    rest = device.gyroscope.static
    n = len(rest)
    # Four standard errors of the mean: of white noise, and of a random walk, K √(T/3).
    walk = NOISE["gyroscope"]["rate_random_walk"] * (1200 / 3) ** 0.5
    expected = 4 * np.hypot(SAMPLE / n**0.5, walk)
    np.testing.assert_allclose(rest.values.mean(axis=0), C_BIAS, rtol=0, atol=expected)
    found = identify_noise(rest.values, rest.rate, "gyroscope").fit
    for axis, true in device.truth["noise"]["gyroscope"].items():
        terms, bounds = found[axis].terms, found[axis].upper_bounds
        # Of three intervals of 95 % the seed's all hold N; K is far too small to be seen.
        assert terms["random_walk"].low < true["random_walk"] < terms["random_walk"].high
        assert terms["rate_random_walk"] is None
        assert true["rate_random_walk"] < bounds["rate_random_walk"]
