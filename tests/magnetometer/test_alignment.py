"""The turn between the triads, what belongs together in time, and the heading's error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.alignment import FEWEST, align, heading_error, paired
from sensorbook.magnetometer.ellipsoid import unpacked
from sensorbook.recordings import Recording
from sensorbook.simulate.rotation import draw_iron, noisy, read_field, turned

from .turns import DOWN, FIELD, RATE, read

G = 9.81
TURN = np.radians([2.0, -1.5, 3.0])
FIELD_NOISE = {"random_walk": 60e-9, "bias_instability": 40e-9}
FORCE_NOISE = {"random_walk": 150e-6 * G, "bias_instability": 40e-6 * G}


def both(seed, turn=TURN, seconds=60.0):
    """Raw readings of a magnetometer and an accelerometer turned by hand, and the iron."""
    rng = np.random.default_rng(seed)
    true = turned(rng, round(seconds * RATE), RATE, FIELD * DOWN, G)
    iron = draw_iron(rng, FIELD) | {"alignment": Rotation.from_rotvec(turn).as_matrix()}
    field = noisy(rng, read_field(true["field"], iron), RATE, FIELD_NOISE)
    matrix, bias = np.diag([1.01, 0.985, 1.0]), np.array([0.2, -0.3, 0.1])
    return field, noisy(rng, true["force"] @ matrix + bias, RATE, FORCE_NOISE), iron


@pytest.fixture(scope="module")
def one():
    field, force, iron = both([1, 1])
    calibration = calibrate(field)
    return calibration, align(calibration, field, force, G), iron


# ---- the turn ----


def test_the_turn_is_recovered(one):
    _, found, _ = one
    assert found.determined
    half = stats.t.ppf(0.975, found.dof) * np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.turn - TURN) < 1.5 * half[:3]).all()
    assert half[:3].max() < np.radians(0.5)
    np.testing.assert_allclose(found.rotation, Rotation.from_rotvec(found.turn).as_matrix())
    # Down is positive: the field of the tests dips by 1 rad.
    assert found.dip == pytest.approx(1.0, abs=np.radians(0.3))
    assert found.accelerometer == "corrected by its own ellipsoid"


def test_the_dip_scatters_less_with_every_stage(one):
    spreads = one[1].spreads
    assert spreads["raw"] > 2 * spreads["calibrated"]
    assert spreads["calibrated"] > 1.3 * spreads["aligned"]
    # Of the magnetometer's noise, 0.42 µT in 48, and the hand's accelerations.
    assert np.degrees(spreads["aligned"]) < 3.0


def test_intervals_of_the_turn_cover():
    """40 devices, each with a turn of its own."""
    inside = []
    for seed in range(40):
        turn = np.radians(np.random.default_rng([seed, 2]).normal(scale=2, size=3))
        field, force, _ = both([seed, 3], turn)
        found = align(calibrate(field), field, force, G)
        half = stats.t.ppf(0.975, found.dof) * np.sqrt(np.diag(found.covariance))[:3]
        inside.append(np.abs(found.turn - turn) <= half)
    # 120 intervals: 95 % ± 2 % at one sd.
    assert 0.86 <= np.mean(inside) <= 0.995


def test_without_noise_the_turn_is_exact():
    rng = np.random.default_rng(4)
    u = Rotation.random(500, rng=rng)
    iron = draw_iron(rng, FIELD) | {"alignment": Rotation.from_rotvec(TURN).as_matrix()}
    field, force = read_field(u.apply(FIELD * DOWN), iron), u.apply([0, 0, G])
    found = align(calibrate(field), field, force, G)
    np.testing.assert_allclose(found.turn, TURN, rtol=0, atol=1e-7)
    assert found.dip == pytest.approx(1.0, abs=1e-7)
    assert found.spreads["aligned"] < 1e-6


@pytest.mark.parametrize("dip", [-80.0, 0.0, 70.0, 80.0])
def test_a_dip_however_steep(dip):
    """Noise of 1.5° in each direction."""
    rng = np.random.default_rng(8)
    u = Rotation.random(3000, rng=rng)
    down = np.array([0, np.cos(np.radians(dip)), -np.sin(np.radians(dip))])
    field = Rotation.from_rotvec(TURN).apply(u.apply(FIELD * down))
    field += 0.026 * FIELD * rng.standard_normal(field.shape)
    calibration = calibrate(read_field(FIELD * Rotation.random(500, rng=rng).apply(down), IDEAL))
    found = align(calibration, field, u.apply([0, 0, G]), G)
    assert found.determined
    # 1.5° · √(3 / 3000) = 0.05° at one standard error; steep ones are folded at the vertical.
    np.testing.assert_allclose(np.degrees(found.turn), np.degrees(TURN), rtol=0, atol=0.25)
    assert np.degrees(found.dip) == pytest.approx(dip, abs=0.4)


def test_results(one):
    results = one[1].to_results()
    np.testing.assert_allclose(results["turn_deg"], np.degrees(one[1].turn))
    assert results["dip_deg"] == pytest.approx(57.3, abs=0.3)
    assert (
        results["dip_spread_before_deg"]
        > results["dip_spread_calibrated_deg"]
        > results["dip_spread_after_deg"]
    )
    assert np.shape(results["turn_std_deg"]) == (3,)


def test_a_turn_about_one_axis_does_not_determine_it():
    """Both triads see cones about z: a turn about z changes no angle between field and gravity."""
    rng = np.random.default_rng(5)
    about = Rotation.from_euler("z", 2 * np.pi * np.arange(2000)[:, None] / 300)
    field = about.apply(FIELD * DOWN) + 1e-7 * rng.standard_normal((2000, 3))
    force = about.apply([0, 0, G]) + 0.01 * rng.standard_normal((2000, 3))
    all_round = calibrate(read(rng, Rotation.random(2000, rng=rng).apply(DOWN), IDEAL))
    found = align(all_round, field, force, G)
    assert not found.determined
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    assert np.isnan(found.covariance).all()
    results = found.to_results()
    assert (results["matrix"], results["turn_deg"], results["turn_std_deg"]) == (None, None, None)
    assert np.isfinite(results["dip_deg"])
    assert found.accelerometer.startswith("as read (")


IDEAL = {"hard_iron": np.zeros(3), "soft_iron": np.eye(3), "alignment": np.eye(3)}


# ---- what belongs together ----


def recording(sensor, time, values, rate=RATE, start=0.0, file="a.csv"):
    return Recording(sensor, "rotation", file, time, values, rate=rate, start=start)


def path(t):
    """(N, 3) something smooth at the times `t`, s on one clock."""
    return np.stack([np.sin(t), np.cos(0.7 * t), 0.1 * t], axis=1)


@pytest.mark.parametrize("rate", [25.0, 100.0, 333.0])
def test_other_rates_and_starts_are_brought_to_one_clock(rate):
    """The magnetometer's file begins 3.21 s after the accelerometer's and ends after it."""
    t = np.arange(500) / 50
    own = np.arange(int(10 * rate)) / rate
    field, force = paired(
        recording("magnetometer", t, path(t + 103.21), start=103.21),
        recording("accelerometer", own, path(own + 100), rate=rate, start=100.0, file="b.csv"),
    )
    expected = path(t + 103.21)
    assert len(field) == len(force)
    assert abs(len(field) - 50 * (10 - 3.21)) <= 3
    np.testing.assert_array_equal(field, expected[: len(field)])
    # Linear between stamps 1 / rate apart: h² / 8 times a curvature of 1.
    np.testing.assert_allclose(force, expected[: len(field)], rtol=0, atol=1.1 / rate**2 / 8)


def test_rows_that_are_not_finite_are_left_out():
    t = np.arange(300) / 50
    field, force = path(t), path(t)
    field[[3, 50]] = np.nan
    a, b = paired(recording("magnetometer", t, field), recording("accelerometer", t, force))
    assert len(a) == 298
    np.testing.assert_array_equal(a, b)
    force[[7, 8]] = np.nan  # bridged by its neighbours
    a, b = paired(recording("magnetometer", t, field), recording("accelerometer", t, force))
    assert len(a) == 298
    np.testing.assert_allclose(a, b, rtol=0, atol=2 * 0.06**2 / 8)


def test_rows_that_are_not_used_are_left_out():
    """With stamps and without."""
    t = np.arange(300) / 50
    used = np.arange(300) >= 120
    for rate in (RATE, None):
        magnetometer = recording("magnetometer", t, path(t), rate=rate)
        accelerometer = recording("accelerometer", t, 2 * path(t), rate=rate)
        field, force = paired(magnetometer, accelerometer, used)
        np.testing.assert_array_equal(field, path(t)[120:])
        np.testing.assert_allclose(force, 2 * field, rtol=1e-12)


def test_without_time_rows_of_one_file_belong_together():
    t, values = np.arange(200.0), path(np.arange(200.0))
    magnetometer = recording("magnetometer", t, values, rate=None)
    a, b = paired(magnetometer, recording("accelerometer", t, 2 * values, rate=None))
    np.testing.assert_array_equal(b, 2 * a)


@pytest.mark.parametrize(("file", "rows"), [("b.csv", 200), ("a.csv", 199)])
def test_without_time_two_files_are_refused(file, rows):
    t, values = np.arange(200.0), path(np.arange(200.0))
    with pytest.raises(Refusal) as caught:
        paired(
            recording("magnetometer", t, values, rate=None),
            recording("accelerometer", t[:rows], values[:rows], rate=None, file=file),
        )
    assert caught.value.reason == (
        "Nothing says which readings of the two sensors belong together: they have no time."
    )
    assert caught.value.remedy == "Record both in one file, or with time stamps."


@pytest.mark.parametrize(("start", "left"), [(1000.0, 0), (8.9, 55)])
def test_too_few_at_the_same_time_are_refused(start, left):
    t = np.arange(500) / 50
    with pytest.raises(Refusal) as caught:
        paired(
            recording("magnetometer", t, path(t), start=start),
            recording("accelerometer", t, path(t)),
        )
    assert left < FEWEST
    assert caught.value.reason == (
        f"Only {left} readings of the two sensors were taken at the same time."
    )
    assert caught.value.remedy == "Record both at once."


def test_an_accelerometer_without_a_finite_row_is_refused():
    t = np.arange(500) / 50
    with pytest.raises(Refusal, match=r"^Only 0 readings"):
        paired(
            recording("magnetometer", t, path(t)),
            recording("accelerometer", t, np.full((500, 3), np.nan)),
        )


# ---- heading ----


def with_hard_iron(h):
    """The calibration of exact readings with hard iron alone, field known."""
    u = Rotation.random(400, rng=np.random.default_rng(6)).apply(DOWN)
    return calibrate(FIELD * u + h, FIELD)


@pytest.mark.parametrize("dip", [0.0, 1.0, -0.7])
@pytest.mark.parametrize("h", [[4e-6, 0, 0], [0, -5e-6, 0], [3e-6, 2e-6, 9e-6]])
def test_heading_error_of_hard_iron_alone(dip, h):
    """In a level turn: the angle of a circle of radius H moved by h."""
    found = heading_error(with_hard_iron(np.array(h)), dip, None)
    psi, level = found.heading, FIELD * np.cos(dip)
    moved = np.arctan2(level * np.sin(psi) + h[1], level * np.cos(psi) + h[0])
    expected = (moved - psi + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(found.before, expected, rtol=0, atol=1e-8)
    if h[1] == 0:
        # By hand: at heading 90° the error is −atan(hx / H).
        at = np.argmin(np.abs(psi - np.pi / 2))
        assert found.before[at] == pytest.approx(-np.arctan(h[0] / level), abs=1e-8)


def test_vertical_hard_iron_does_not_turn_a_level_heading():
    found = heading_error(with_hard_iron(np.array([0, 0, 2e-5])), 1.0, None)
    assert np.abs(found.before).max() < 1e-8


def test_a_turn_about_the_vertical_turns_every_heading(one):
    """Its rotation is from the accelerometer's axes to the magnetometer's."""
    about = Rotation.from_rotvec([0, 0, 0.1]).as_matrix()
    turned_by = replace(one[1], rotation=about, turn=np.array([0, 0, 0.1]))
    found = heading_error(with_hard_iron(np.zeros(3)), 1.0, turned_by)
    np.testing.assert_allclose(found.before, 0.1, rtol=0, atol=1e-8)


@pytest.mark.parametrize("aligned", [False, True])
def test_the_heading_s_standard_error_is_that_of_draws(one, aligned):
    """2000 calibrations drawn from the covariance, each applied to the same level turn."""
    calibration, alignment, _ = one
    # Known to 2 mrad about the vertical and better about the level axes, which turn no heading.
    alignment = replace(alignment, covariance=np.diag([1e-8, 1e-8, 4e-6, 1e-8]))
    found = heading_error(calibration, 1.0, alignment if aligned else None)
    rng, psi = np.random.default_rng(7), found.heading
    level = np.stack([np.cos(psi), np.sin(psi), np.full_like(psi, -np.tan(1.0))], axis=1)
    level *= np.cos(1.0)
    turn = alignment.rotation if aligned else np.eye(3)
    raw = np.linalg.solve(calibration.soft_iron, calibration.field * (level @ turn.T).T).T
    raw += calibration.hard_iron
    p = rng.multivariate_normal(calibration.values[:9], calibration.covariance[:9, :9], 2000,
                                method="svd")  # fmt: skip
    errors = []
    for one_p in p:
        h, s = unpacked(one_p)
        t = turn
        if aligned:
            z = np.sqrt(alignment.covariance[2, 2]) * rng.standard_normal()
            t = Rotation.from_rotvec([0, 0, z]).as_matrix() @ turn
        seen = (raw - h) @ s @ t
        heading = np.arctan2(seen[:, 1], seen[:, 0])
        errors.append((heading - psi + np.pi) % (2 * np.pi) - np.pi)
    # 2000 draws: 1.6 % at one sd, the largest of 180 headings.
    np.testing.assert_allclose(found.std, np.std(errors, axis=0), rtol=0.08)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.15 * found.std.max()
