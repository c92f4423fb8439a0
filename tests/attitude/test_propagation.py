"""Attitude from rates: closed forms, scipy's Rotation one step after another, and the study's motions."""

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from sensorbook.attitude import propagation_study as study
from sensorbook.attitude.propagation import (
    FEW,
    euler_rates,
    orthogonalise,
    orthogonality_error,
    propagate,
    propagate_euler,
    propagate_matrix,
    rotation_increments,
    turn_matrix,
)
from sensorbook.attitude.rotations import compose_quaternions

START = Rotation.from_rotvec([0.4, -1.1, 0.7])


def between(one, other):
    """Largest angle between attitudes, rad."""
    return (Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude().max()


def one_by_one(increments, start=START):
    """scipy's Rotation, a step at a time."""
    at, found = start, [start.as_quat()]
    for turned in increments:
        at = at * Rotation.from_rotvec(turned)
        found.append(at.as_quat())
    return np.array(found)


# Increments


@pytest.mark.parametrize("coning", [True, False])
def test_a_constant_rate_turns_about_its_axis(coning):
    time = np.arange(501) / 50
    rate = np.tile([0.3, -0.5, 0.8], (501, 1))
    found = propagate(rotation_increments(time, rate, coning=coning), START.as_quat())
    expected = START * Rotation.from_rotvec(time[:, None] * rate)
    assert between(found, expected.as_quat()) < 1e-13  # 500 roundings of 1e-16, and some


@pytest.mark.parametrize(("delay", "ends"), [(0, (0, 0)), (0.5, (-1, 0)), (-0.5, (0, 1))])
def test_linear_rates_are_exact_whatever_a_reading_stands_for(delay, ends):
    """Readings are the means from `ends[0]` to `ends[1]` intervals about the stamp; the line's middle."""
    interval, a, b = 0.035, np.array([0.3, -0.2, 0.5]), np.array([-0.4, 0.7, 0.1])
    time = 2.0 + interval * np.arange(20)
    middle = time + interval * sum(ends) / 2
    found = rotation_increments(time, a + np.multiply.outer(middle, b), delay * interval, False)
    exact = interval * (a + np.multiply.outer((time[1:] + time[:-1]) / 2, b))
    assert np.abs(found - exact).max() < 1e-15


def test_the_coning_correction_of_linear_rates_on_uneven_stamps():
    rng = np.random.default_rng(41)
    step = rng.uniform(0.8, 1.2, 30) * 0.02
    time = np.append(0, np.cumsum(step))
    a, b = np.array([0.3, -0.2, 0.5]), np.array([-0.4, 0.7, 0.1])
    rate = a + np.multiply.outer(time, b)
    added = rotation_increments(time, rate) - rotation_increments(time, rate, coning=False)
    at_middle = a + np.multiply.outer((time[1:] + time[:-1]) / 2, b)
    # Of numbers of 1e-2, whose differences round at 1e-18.
    assert np.abs(added - (step**3 / 12)[:, None] * np.cross(at_middle, b)).max() < 1e-17
    assert np.abs(added).max() > 1e-7


def test_the_correction_leaves_an_error_of_fifth_order():
    a, b = np.array([0.6, -0.4, 1.0]), np.array([-0.8, 1.4, 0.2])
    errors = []
    for interval in (0.2, 0.1):
        time = interval * (np.arange(4) - 1.5)
        turned = rotation_increments(time, a + np.multiply.outer(time, b))[1]
        nodes = np.linspace(-interval / 2, interval / 2, 20001)
        fine = rotation_increments(nodes, a + np.multiply.outer(nodes, b), coning=False)
        exact = Rotation.from_quat(propagate(fine, [0, 0, 0, 1])[-1])
        errors.append((exact.inv() * Rotation.from_rotvec(turned)).magnitude())
    assert errors[0] / errors[1] == pytest.approx(32, rel=0.1)


def test_no_correction_across_a_gap():
    time = np.arange(40) * 0.02
    time[20:] += 5.0
    rate = np.stack([np.cos(3 * time), np.sin(3 * time), np.ones(40)], axis=1)
    added = rotation_increments(time, rate) - rotation_increments(time, rate, coning=False)
    assert (added[19] == 0).all()
    assert (np.abs(added[[5, 30]]).max(axis=1) > 0).all()


def test_two_readings_make_one_step_and_three_have_a_slope():
    assert rotation_increments([0, 2], [[1, 0, 0], [3, 0, 0]]).tolist() == [[4, 0, 0]]
    found = rotation_increments([0, 1, 2], [[1, 0, 0], [1, 1, 0], [1, 2, 0]])
    assert found[:, 2] == pytest.approx([1 / 12, 1 / 12])  # a × b = (1, …, 0) × (0, 1, 0)


@pytest.mark.parametrize(
    ("time", "rate", "said"),
    [
        ([0.0, 1.0, 1.0], np.zeros((3, 3)), "time does not ascend"),
        ([0.0, 2.0, 1.0], np.zeros((3, 3)), "time does not ascend"),
        ([0.0, np.nan, 1.0], np.zeros((3, 3)), "time does not ascend"),
        ([0.0, 1.0], np.zeros((3, 3)), "needed are"),
        ([0.0, 1.0, 2.0], np.zeros((3, 2)), "needed are"),
    ],
)
def test_increments_of_what_is_no_record(time, rate, said):
    with pytest.raises(ValueError, match=said):
        rotation_increments(time, rate)


# Quaternions and matrices


@pytest.mark.parametrize("count", [0, 1, 2, 3, 100, 1000, FEW, FEW + 1, 6000])
def test_both_ways_equal_a_plain_loop(count):
    increments = np.random.default_rng(42).normal(size=(count, 3))
    found = propagate(increments, START.as_quat())
    assert found.shape == (count + 1, 4)
    expected = Rotation.from_quat(one_by_one(increments)).as_matrix()
    assert np.abs(Rotation.from_quat(found).as_matrix() - expected).max() < 1e-13
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-15


@pytest.mark.parametrize("orthogonal", [True, False])
def test_matrices_equal_quaternions(orthogonal):
    increments = np.random.default_rng(43).normal(size=(1000, 3))
    found = propagate_matrix(turn_matrix(increments), START.as_matrix(), orthogonal)
    expected = Rotation.from_quat(propagate(increments, START.as_quat())).as_matrix()
    assert np.abs(found - expected).max() < 1e-12


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-9, 1e-4, 0.1, 3.0, np.pi, 7.0])
def test_turn_matrix_is_scipys(size):
    vectors = size * np.random.default_rng(44).normal(size=(2, 50, 3)) / np.sqrt(3)
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(2, 50, 3, 3)
    assert np.abs(turn_matrix(vectors) - expected).max() < 3e-15


def test_orthogonalise_finds_the_nearest():
    rng = np.random.default_rng(45)
    turned = Rotation.random(40, rng=rng).as_matrix()
    near = turned + 0.1 * rng.normal(size=turned.shape)
    found = orthogonalise(near)
    assert orthogonality_error(found).max() < 2e-15
    assert np.abs(found - [polar(a)[0] for a in near]).max() < 1e-14
    aside = found @ Rotation.from_rotvec(0.01 * rng.normal(size=(40, 3))).as_matrix()
    distance = [np.linalg.norm(near - a, axis=(1, 2)) for a in (found, aside, turned)]
    assert (distance[0] < distance[1]).all()
    assert (distance[0] < distance[2]).all()


def test_orthogonality_error_of_a_stretched_matrix():
    assert orthogonality_error(np.diag([1.0, 1.1, 1.0])) == pytest.approx(0.21)
    assert orthogonality_error(np.stack([np.eye(3), 2 * np.eye(3)])).tolist() == [0, 3]


# Euler angles


def test_euler_rates_are_the_angles_derivatives():
    rng = np.random.default_rng(46)
    angles = rng.uniform(-1.3, 1.3, (200, 3))
    rate = rng.normal(size=(200, 3))
    at, step = Rotation.from_euler("ZYX", angles[:, ::-1]), 1e-5
    ends = [(at * Rotation.from_rotvec(s * rate)).as_euler("ZYX")[:, ::-1] for s in (-step, step)]
    difference = (ends[1] - ends[0] + np.pi) % (2 * np.pi) - np.pi
    # Truncation of step²/6 times a third derivative of up to 1/cos³(1.3), and rounding over the step.
    assert euler_rates(angles, rate) == pytest.approx(difference / (2 * step), abs=1e-6)


def test_euler_angles_agree_with_quaternions_away_from_the_lock():
    motion = study.stated_motion(50, 20)
    increments = motion.increments(coning=False)
    found = study.euler_attitudes(propagate_euler(increments, np.zeros(3)))
    # Runge–Kutta of fourth order: 1000 steps of up to 0.012 rad, each to its fifth power over 120.
    assert between(found, propagate(increments, study.START)) < 1000 * 0.0124**5 / 120 * 5


@pytest.mark.parametrize("sign", [1, -1])
def test_at_the_lock_roll_and_yaw_rates_are_infinite(sign):
    rates = euler_rates([0.3, sign * np.pi / 2, 0.0], [0.0, 1.0, 0.0])
    assert (np.abs(rates[[0, 2]]) > 1e15).all()  # what a cosine of π/2 rounds to divides
    assert rates[1] == pytest.approx(np.cos(0.3))


def test_a_pass_by_the_lock():
    by = study.lock_pass(np.radians(2), np.radians(0.5))
    assert np.degrees(by.angles[:, 1].max()) == pytest.approx(88)
    assert between(propagate(by.increments, by.true[0]), by.true) < 1e-14
    rates = euler_rates(by.angles, [0.0, 1.0, 0.0])
    assert rates[:, 2].max() == pytest.approx(1 / np.sin(np.radians(2)))
    assert rates[:, 0].max() == pytest.approx(1 / np.tan(np.radians(2)))
    # The yaw rate falls to half of its peak where the body has turned by arcsin(tan d).
    turn = np.arcsin(np.tan(np.radians(30))) / 10
    half = euler_rates(study.lock_pass(np.radians(30), turn, 10).angles, [0.0, 1.0, 0.0])[:, 2]
    assert half[[0, 10, 20]] == pytest.approx([1, 2, 1])
    assert len(study.lock_pass(0.1, np.radians(20)).along) == 9  # 80° aside, not more


def test_the_lock_costs_where_the_distance_is_a_steps_turn():
    turn = np.radians(0.9)
    near, far = (study.lock_loss(k * turn, turn) for k in (0.1, 10))
    assert np.degrees(near) > 1
    assert np.degrees(far) < 1e-4
    # The turn in a step times a function of the distance in such turns, as long as both are small.
    quarter = study.lock_loss(turn / 4, turn / 4)
    assert study.lock_loss(turn, turn) == pytest.approx(4 * quarter, rel=0.01)


# Rounding


def test_rounding_in_32_and_64_bit():
    increments = study.stated_motion(50, 60).increments()
    single, mended = (study.rounding_drift(increments, np.float32, k) for k in (False, True))
    # 3000 steps: between √3000 and 3000 half units in the last place, 6e-8.
    assert np.sqrt(3000) * 6e-8 / 5 < single.orthogonality[-1] < 3000 * 6e-8
    assert mended.orthogonality.max() < 1e-6
    assert mended.orthogonality[-1] < single.orthogonality[-1] / 5
    # The SVD brings no angle back: both are lost by roundings of each step, and of one size.
    assert 1e-7 < mended.angle[-1] < 3000 * 1.2e-7
    assert 1e-7 < single.angle[-1] < 3000 * 1.2e-7
    double = study.rounding_drift(increments, np.float64, False)
    assert double.orthogonality[-1] < 3000 * 2.2e-16
    assert double.angle[-1] < 3000 * 2.2e-16


def test_arithmetic_is_of_the_type_asked_for():
    turns = turn_matrix(np.random.default_rng(48).normal(size=(50, 3)))
    found = propagate_matrix(turns, np.eye(3), orthogonal=False, dtype=np.float32)
    assert found.dtype == np.float32
    at = np.eye(3, dtype=np.float32)
    for turn in turns.astype(np.float32):
        at = at @ turn
    assert (found[-1] == at).all()
    assert propagate_matrix(turns, np.eye(3)).dtype == np.float64


@pytest.mark.parametrize("turned", [[0.3, 0.2, -0.5], [0.0, 0.0, 0.0]])
def test_a_step_stands_on_the_left_of_the_house_product(turned):
    """q ← δq ⊗ q with ⊗ of (2.12), as the chapter prints it; the other order is Hamilton's."""
    size = np.linalg.norm(turned)
    delta = np.append(np.sinc(size / 2 / np.pi) / 2 * np.array(turned), np.cos(size / 2))
    right = one_by_one([turned])[1:]
    found = compose_quaternions(delta, START.as_quat())[None]
    assert between(found, right) < 1e-14
    assert between(study.propagate_quaternion([turned], START.as_quat())[1:], right) < 1e-14
    other = compose_quaternions(START.as_quat(), delta)[None]
    assert (between(other, right) > 0.1) == (size > 0)


def test_one_step_after_another_is_what_blocks_give():
    increments = study.stated_motion(50, 20).increments()
    start = START.as_quat()
    # 1000 steps, a rounding of 1e-16 or some each.
    found = study.propagate_quaternion(increments, start)
    assert between(found, propagate(increments, start)) < 1e-12


# The study's motions

CONE = np.radians(4), 3.0, 60.0, 5.0  # half-angle, frequency, rate, seconds
MOTIONS = {"stated": study.stated_motion(200, 5), "cone": study.coning_motion(*CONE)}


@pytest.fixture(params=MOTIONS)
def motion(request):
    return MOTIONS[request.param]


def test_readings_belong_to_the_attitude(motion):
    """Means and samples against the attitudes, by Simpson's rule on halved steps and by differences."""
    fine = study.stated_motion(20000, 0.1) if motion is MOTIONS["stated"] else None
    fine = fine or study.coning_motion(CONE[0], CONE[1], 20000, 0.1)
    at = Rotation.from_quat(fine.true)
    difference = (at[:-2].inv() * at[2:]).as_rotvec() * 20000 / 2
    # step²/6 of the third derivative: (2π · 3 /s)² (20 kHz)⁻² / 6 of rates up to 1.3 rad/s.
    assert np.abs(fine.sample[1:-1] - difference).max() < 5e-7
    simpson = (fine.sample[:-2:2] + 4 * fine.sample[1:-1:2] + fine.sample[2::2]) / 6
    pairs = (fine.before[1:-1:2] + fine.before[2::2]) / 2
    assert np.abs(simpson - pairs).max() < 1e-12
    assert np.abs(motion.after[:-1] - motion.before[1:]).max() < 1e-12


def test_the_stated_motion_starts_at_rest():
    motion = MOTIONS["stated"]
    assert motion.true[0] == pytest.approx(study.START, abs=1e-16)
    assert np.abs(motion.sample[0]).max() == 0
    assert motion.step == pytest.approx(1 / 200)


def test_a_body_comes_back_after_each_round_of_the_cone():
    motion = MOTIONS["cone"]
    assert between(motion.true[20:21], motion.true[:1]) < 1e-14  # 60 readings in 3 rounds
    assert motion.errors(motion.true[::-1])[0] == pytest.approx(0, abs=1e-7)
    z = Rotation.from_quat(motion.true).apply([0, 0, 1])
    assert np.degrees(np.arccos(z[:, 2])) == pytest.approx(4)


def net_turn(increment, phase):
    """Drift a step, rad, of increments that are one turned by `phase` about z from step to step.

    The product of n of them is (E Z)ⁿ Z⁻ⁿ, with E the first and Z the turn about z.
    """
    whole = Rotation.from_rotvec(increment) * Rotation.from_rotvec([0, 0, phase])
    return whole.magnitude() - phase


@pytest.mark.parametrize(("half_angle", "frequency"), [(0.5, 5.0), (3.0, 10.0), (20.0, 2.0)])
def test_coning_drift_is_that_of_the_product(half_angle, frequency):
    half, rate = np.radians(half_angle), 100.0
    motion = study.coning_motion(half, frequency, rate, 10.0)
    found = study.coning_drift(motion)
    phase = 2 * np.pi * frequency / rate
    # The mean rate's increment: a chord of the circle of sinθ across, (1 − cosθ) of the phase along.
    one = np.array([2 * np.sin(half) * np.sin(phase / 2), 0, -(1 - np.cos(half)) * phase])
    turned = Rotation.from_rotvec([[0, 0, phase], [0, 0, -phase]]).apply(one)
    corrected = one + np.cross(one, turned[0] - turned[1]) / 24
    # The product's axis is not quite the cone's: a wobble of that size over ten seconds.
    for name, increment in (("no correction", one), ("coning correction", corrected)):
        expected = net_turn(increment, phase) * rate
        assert found[name] == pytest.approx(expected, rel=5e-3 * half, abs=1e-13)


def test_coning_drift_in_closed_form():
    half, frequency, rate = np.radians(0.5), 8.0, 100.0
    found = study.coning_drift(study.coning_motion(half, frequency, rate, 10.0))
    formula = study.coning_drift_rate(half, frequency, rate)
    for name, value in found.items():
        assert value == pytest.approx(formula[name], rel=3 * half**2)  # the next power of θ
    x = 2 * np.pi * frequency / rate
    leading = -(half**2) / 2 * 2 * np.pi * frequency * np.array([1, x**2 / 6, x**4 / 30])
    small = [float(v) for v in study.coning_drift_rate(half, frequency, 100 * rate).values()]
    assert small == pytest.approx(leading * [1, 1e-4, 1e-8], rel=1e-4)


def test_tours():
    integral, attitude = study.tour("xy−x−y", np.pi / 2)
    assert integral[-1].tolist() == [0, 0, 0]
    assert np.degrees(study.angle_between(attitude[0], attitude[-1])) == pytest.approx(120)
    integral, attitude = study.tour("xy−x−z", np.pi / 2)
    assert np.degrees(integral[-1]) == pytest.approx([0, 90, -90])
    assert study.angle_between(attitude[0], attitude[-1]) < 1e-15


@pytest.mark.parametrize("angle", [0.02, 0.3])
def test_what_the_first_orders_lose_about_a_fixed_axis(angle):
    turned = np.tile([0.0, angle, 0.0], (50, 1))
    first, second = (study.series_loss(turned, k) for k in (1, 2))
    # Each step: a turn by arctan σ and a length of √(1 + σ²); by arctan(σ/(1 − σ²/2)) and √(1 + σ⁴/4).
    assert first.angle == pytest.approx(50 * (angle - np.arctan(angle)), rel=1e-9)
    assert first.orthogonality == pytest.approx((1 + angle**2) ** 50 - 1, rel=1e-9)
    off = 50 * (np.arctan(angle / (1 - angle**2 / 2)) - angle)
    assert second.angle == pytest.approx(off, rel=1e-8)
    assert second.orthogonality == pytest.approx((1 + angle**4 / 4) ** 50 - 1, rel=1e-6)
    assert first.mended == pytest.approx(
        first.angle, rel=1e-9
    )  # one axis: length and angle are apart


def test_the_whole_series_is_the_closed_form():
    turned = np.random.default_rng(47).normal(size=(20, 3))
    assert np.abs(study.series_turn(turned, 30) - turn_matrix(turned)).max() < 1e-13
    assert study.series_loss(turned, None).angle < 1e-13


def test_powers_of_the_rate():
    errors = study.errors_by_rate([20.0, 40.0], 10.0)
    power = {name: np.log2(e[0] / e[1]) for name, e in errors.items()}
    assert power == pytest.approx(
        {
            "samples, held for the next step": 1,
            "samples, interpolated": 2,
            "means": 2,
            "means, coning correction": 4,
            "means, matrix of first order": 2,
        },
        abs=0.05,
    )


def test_methods_agree_where_nothing_is_in_the_way():
    motion = study.stated_motion(50, 10)
    plain = motion.increments(coning=False)
    right = propagate(plain, study.START)
    off = {name: between(m.attitudes(m.carry(plain)), right) for name, m in study.METHODS.items()}
    assert off.pop("matrix of first order, SVD each step") > 1e-6
    assert max(off.values()) < 1e-8


def test_readings_taken_for_others_are_half_an_interval_off():
    motion = study.stated_motion(50, 20)
    held = motion.errors(propagate(motion.increments("sample", "mean after"), motion.true[0]))
    speed = np.linalg.norm(motion.sample, axis=1)
    assert np.abs(held - motion.step / 2 * speed).max() < 0.01 * held.max()
    late = motion.errors(propagate(motion.increments("mean after", "mean before"), motion.true[0]))
    assert late.max() == pytest.approx(motion.step * speed.max(), rel=0.01)


@pytest.mark.parametrize(
    ("losses", "expected"),
    [
        ([100, 100, 1, 0.01], 10.0),
        ([100, 0.01, 100, 0.01], np.sqrt(1000)),
        ([0.1, 0.1, 0.1, 0.1], None),
    ],
)
def test_the_largest_distance_with_a_loss(losses, expected):
    found = study.largest_with(1.0, [0.1, 1, 10, 100], losses)
    assert found == (None if expected is None else pytest.approx(expected))
    assert study.largest_with(1.0, [1.0, 2.0], [0.1, 3.0]) is None
