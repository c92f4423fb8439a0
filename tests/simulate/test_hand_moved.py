"""Devices moved by hand: what they read follows from how they moved, and from truth.json."""

import hashlib
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook.cli import main
from sensorbook.recordings import check
from sensorbook.simulate import simulate
from sensorbook.simulate.motion import attitude
from sensorbook.simulate.positions import (
    FACES,
    NOISE,
    RATE,
    draw_errors,
    hand_moved,
    truth_of,
)

PRESETS = ("positions", "phone")
# Somigliana at 39.89°, then 3.086e-6 m/s² less a metre for 900 m: 9.801599 − 0.002777.
GRAVITY = 9.798822


@pytest.fixture(scope="module")
def made():
    return hand_moved(np.random.default_rng([11, 1]))


@pytest.fixture(scope="module", params=PRESETS)
def folder(request, tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("moved") / request.param, request.param, seed=5)


def rows(made, rest):
    return (made["t"] >= rest["start"]) & (made["t"] < rest["end"])


# ---- kinematics ----


def test_attitude_points_up_where_it_should():
    rng = np.random.default_rng([11, 2])
    for up in (*FACES, *rng.normal(size=(20, 3))):
        found = attitude(up, rng.uniform(0, 7)).apply(np.array(up) / np.linalg.norm(up))
        np.testing.assert_allclose(found, [0, 0, 1], atol=1e-12)  # rounding
    turned = attitude([0, 0, 1], 0.3).inv() * attitude([0, 0, 1], 0.8)
    assert turned.magnitude() == pytest.approx(0.5, abs=1e-12)


def test_rests_read_gravity_along_up_and_the_earth_rate(made):
    for rest in made["rests"]:
        force = made["true_acceleration"][rows(made, rest)]
        np.testing.assert_allclose(
            force, np.tile(made["gravity"] * rest["up"], (len(force), 1)), rtol=0, atol=1e-9
        )
        rate = made["true_rate"][rows(made, rest)]
        np.testing.assert_allclose(np.linalg.norm(rate, axis=1), 7.292115e-5, rtol=1e-9)
        # Upwards the Earth turns with Ω sin φ, whatever the heading.
        np.testing.assert_allclose(
            rate @ rest["up"], 7.292115e-5 * np.sin(np.radians(39.89)), rtol=1e-9
        )
    assert made["gravity"] == pytest.approx(GRAVITY, abs=1e-5)


def test_rates_carry_one_rest_into_the_next_and_the_speed_ends_at_zero(made):
    for one, other in zip(made["rests"], made["rests"][1:], strict=False):
        moving = (made["t"] >= one["end"]) & (made["t"] < other["start"])
        # Not more than 2 rad/s on the mean over half a turn; not less than a second.
        assert 0.99 <= moving.sum() / RATE <= 3.01
        up, body, speed = one["up"], Rotation.identity(), np.zeros(3)
        for rate, force in zip(
            made["true_rate"][moving], made["true_acceleration"][moving], strict=True
        ):
            middle = body * Rotation.from_rotvec(rate / RATE / 2)
            speed += (middle.apply(force) - made["gravity"] * up) / RATE
            body = body * Rotation.from_rotvec(rate / RATE)
        # Coning within an interval of up to 0.04 rad, and 3 s of Earth rate (0.012°).
        carried = body.inv().apply(up)
        assert np.degrees(np.linalg.norm(np.cross(carried, other["up"]))) < 0.05
        assert carried @ other["up"] > 0
        # Of accelerations up to several m/s²; an attitude wrong by 0.05° for 3 s gives 0.03.
        assert np.linalg.norm(speed) < 0.03


def test_motions_are_felt(made):
    still = np.zeros(len(made["t"]), dtype=bool)
    for rest in made["rests"]:
        still |= rows(made, rest)
    assert 0.6 < still.mean() < 0.9
    length = np.linalg.norm(made["true_acceleration"][~still], axis=1)
    assert 0.5 < length.std() < 5  # a hand: tenths of g
    turning = np.linalg.norm(made["true_rate"], axis=1).max()
    assert np.radians(150) < turning < np.radians(500)


# ---- readings ----


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_readings_follow_from_the_errors(made, sensor):
    error, noise = made["errors"][sensor], NOISE[sensor]
    true = made["true_acceleration" if sensor == "accelerometer" else "true_rate"]
    expected = true @ error["matrix"].T + error["bias"]
    if sensor == "gyroscope":
        expected[:, 1] += error["g_sensitivity"][1] * made["true_acceleration"][:, 1]
    off = made[sensor] - expected
    step = noise["full_scale"] / 2**15
    white = np.sqrt(noise["random_walk"] ** 2 * RATE + step**2 / 12)
    # 23 000 samples know a deviation to 0.5 %; the flicker adds less than 2 %.
    np.testing.assert_allclose(off.std(axis=0), white, rtol=0.03)
    # The mean: N/√T over 230 s, four of it; the flicker has none.
    assert (np.abs(off.mean(axis=0)) < 4 * noise["random_walk"] / np.sqrt(len(off) / RATE)).all()
    counts = made[sensor] / step
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert (np.abs(counts) < 2**15 - 1).all()  # nowhere at the end of the range


def test_flicker_is_there(made):
    # Means of 0.5 s over 30 s: white noise alone scatters by N/√0.5 s; with ten times the usual
    # flicker, they scatter by more.
    loud = {s: n | {"bias_instability": 10 * n["bias_instability"]} for s, n in NOISE.items()}
    scatter = []
    for noise in (NOISE, loud):
        one = hand_moved(np.random.default_rng([11, 3]), FACES, noise=noise)
        half = one["accelerometer"][:3000].reshape(60, 50, 3).mean(axis=1)
        scatter.append(half.std(axis=0).mean())
    assert scatter[0] == pytest.approx(150e-6 * 9.80665 / np.sqrt(0.5), rel=0.2)
    assert scatter[1] > 1.2 * scatter[0]


def test_errors_are_of_the_size_said():
    for seed in range(50):
        errors = draw_errors(np.random.default_rng([11, 4, seed]))
        accelerometer, gyroscope = errors["accelerometer"], errors["gyroscope"]
        scale = np.abs(np.diag(accelerometer["matrix"]) - 1)
        assert ((scale >= 0.005) & (scale <= 0.025)).all()
        assert (accelerometer["matrix"][np.triu_indices(3, 1)] == 0).all()
        assert (
            np.abs(accelerometer["matrix"] - np.diag(np.diag(accelerometer["matrix"]))).max()
            <= 0.015
        )
        bias = np.abs(accelerometer["bias"])
        assert ((bias >= 0.05) & (bias <= 0.7)).all()
        scale = np.abs(np.diag(gyroscope["matrix"]) - 1)
        assert ((scale >= 0.01) & (scale <= 0.02)).all()
        assert (gyroscope["matrix"] != 0).all()
        g = np.degrees(gyroscope["g_sensitivity"]) * 9.80665
        np.testing.assert_allclose(g, [0, 0.05, 0], atol=1e-12)


def test_directions_come_in_order_with_the_levelling_asked_for():
    made = hand_moved(
        np.random.default_rng([11, 5]), FACES * 20, 1.0, seconds=(1.0, 1.0), initial=0.0
    )
    assert len(made["rests"]) == 120
    away = [np.cross(r["up"], d) for r, d in zip(made["rests"], FACES * 20, strict=True)]
    towards = [r["up"] @ d for r, d in zip(made["rests"], FACES * 20, strict=True)]
    assert min(towards) > 0.99
    # 1° about each of the two level axes: 240 angles, known to 5 %.
    rms = np.degrees(np.sqrt((np.array(away) ** 2).sum(axis=1).mean() / 2))
    assert rms == pytest.approx(1.0, rel=0.15)


def test_default_directions_are_faces_edges_and_corners(made):
    assert len(made["rests"]) == 25
    first = made["rests"][0]
    assert (first["start"], first["end"]) == (0.0, 30.0)
    lengths = [r["end"] - r["start"] for r in made["rests"][1:]]
    assert min(lengths) >= 3.99
    assert max(lengths) <= 8.01
    ups = np.array([r["up"] for r in made["rests"]])
    # 4° rms an axis: within 20° of one of the 26 attitudes, and each face is there.
    for face in FACES:
        assert np.degrees(np.arccos((ups @ face).max())) < 20
    # Directions of all rests span the sphere evenly: no axis of their scatter is short.
    assert np.linalg.eigvalsh(ups.T @ ups / len(ups)).min() > 0.2


# ---- folders ----


def test_same_seed_same_bytes(folder, tmp_path):
    def digests(path):
        return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in path.iterdir()}

    again = simulate(tmp_path / folder.name, folder.name, seed=5)
    assert digests(again) == digests(folder)
    other = digests(simulate(tmp_path / "other" / folder.name, folder.name, seed=6))
    same = {name for name, digest in digests(folder).items() if other[name] == digest}
    assert same <= {"device.toml"}


def test_nothing_to_mend(folder, capsys):
    assert check(folder) == ([], [])
    assert main(["check", str(folder)]) == 0
    assert capsys.readouterr().out == f"{folder}: nothing to mend\n"


@pytest.mark.parametrize("kind", ["positions", "six_position"])
def test_the_folder_reads_what_its_truth_says(folder, kind):
    device = sensorbook.load(folder)
    truth, known = device.truth, device.truth["calibration"]["accelerometer"]
    assert truth["gravity"] == pytest.approx(GRAVITY, abs=1e-5)
    runs = [r for r in device.runs("accelerometer", kind) if "check" not in r.declaration]
    (run,) = runs
    assert run.rate == pytest.approx(100, rel=1e-4)
    rests = truth["rests"][kind]
    assert len(rests) == {"six_position": 6}.get(kind, 23 if folder.name == "phone" else 25)
    sample = 0.08 if folder.name == "phone" else 0.015  # m/s², white
    for rest in rests:
        mean = run.between(rest["start"] + 0.01, rest["end"] - 0.01).values.mean(axis=0)
        expected = np.array(known["matrix"]) @ (truth["gravity"] * np.array(rest["up"]))
        # Four standard errors of 400 samples, and as much again for flicker.
        np.testing.assert_allclose(mean, expected + known["bias"], rtol=0, atol=8 * sample / 20)
    if kind == "six_position":
        order = [np.array(r["up"]) @ f for r, f in zip(rests, FACES, strict=True)]
        assert min(order) > np.cos(np.radians(6))
    assert device.truth["calibration"]["gyroscope"].keys() >= {"matrix", "bias", "g_sensitivity"}


def test_truth_is_plain_json(made):
    truth = json.loads(json.dumps(truth_of({"positions": made}), allow_nan=False))
    assert truth["calibration"]["accelerometer"]["g_sensitivity"] is None
    np.testing.assert_array_equal(
        truth["calibration"]["gyroscope"]["matrix"], made["errors"]["gyroscope"]["matrix"]
    )


# ---- the phone ----


def test_the_phone_is_work_b(tmp_path):
    device = sensorbook.load(simulate(tmp_path / "phone", "phone", seed=7))
    known = device.truth["calibration"]["accelerometer"]
    np.testing.assert_array_equal(np.diag(known["matrix"]), [0.98, 0.97, 0.99])
    assert known["bias"] == [0.05, 0.36, 0.67]
    run = next(r for r in device.runs("accelerometer", "positions") if r.declaration.get("check"))
    rests = device.truth["rests"]["check"]
    values = np.concatenate([run.between(r["start"], r["end"]).values for r in rests])
    true = np.linalg.solve(np.array(known["matrix"]), (values - known["bias"]).T).T
    error = np.linalg.norm(true, axis=1) - device.truth["gravity"]
    # B: 0.08 m/s² on samples. 15 000 of them know it to 1 %; scales near 0.98 add 2 %.
    assert np.sqrt((error**2).mean()) == pytest.approx(0.08, rel=0.05)
    files = [d.file for d in device.declared if d.table.get("check")]
    assert files == ["check.db", "check.db"]
    # The site is what the receiver gave, to its metres.
    assert device.site["latitude"] == pytest.approx(39.89, abs=1e-4)
    assert device.site["height"] == pytest.approx(900, abs=5)


def test_a_database_left_by_an_interrupted_run_is_replaced(tmp_path):
    (tmp_path / "phone").mkdir()
    (tmp_path / "phone" / "check.db").write_bytes(b"half")
    assert check(simulate(tmp_path / "phone", "phone", seed=5)) == ([], [])
    (tmp_path / "other" / "check.db").mkdir(parents=True)
    with pytest.raises(sensorbook.InputError, match=r"cannot be written: .* — choose another"):
        simulate(tmp_path / "other", "phone", seed=5)
