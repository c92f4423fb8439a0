"""Whether a gyroscope and a reference tell of the same motion, and what is said where they do not."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook.attitude.agreement import agreement
from sensorbook.attitude.propagation import propagate, rotation_increments
from sensorbook.attitude.verdicts import agrees, judge
from sensorbook.attitude.windows import Windows
from sensorbook.errors import InputError, Refusal

INTERVAL = 0.035  # s, work C's
BIAS = np.array([0.03, 0.04, -0.01])  # rad/s, work C's
TILT = Rotation.from_rotvec(np.radians([0.6, -0.9, 0.4]))


def attitude(time, size=1.0):
    """Yaw, pitch and roll of some sines each, in closed form: about 20 °/s rms in all at size 1."""
    yaw = 60 * np.sin(2 * np.pi * time / 23) + 20 * np.sin(2 * np.pi * time / 7 + 1)
    pitch = 30 * np.sin(2 * np.pi * time / 17 + 0.5) + 12 * np.sin(2 * np.pi * time / 5)
    roll = 35 * np.sin(2 * np.pi * time / 13 + 2) + 15 * np.sin(2 * np.pi * time / 6)
    return Rotation.from_euler("ZYX", np.radians(size * np.stack([yaw, pitch, roll], axis=1)))


def body_rate(time, size=1.0):
    """(N, 3) rad/s by a central difference of 0.2 ms, exact to 1e-8."""
    return (attitude(time - 1e-4, size).inv() * attitude(time + 1e-4, size)).as_rotvec() / 2e-4


def record(
    seed,
    seconds=60.0,
    matrix=None,
    delay=0.0,
    means=False,
    noise=1e-3,
    error_deg=0.5,
    every=1,
    missing=0.03,
    size=1.0,
):
    """Stamps, readings, stamps with references, references: reading = M⁻¹ rate(t − delay) + b + noise.

    `means`: the readings are means over the interval that ends half of one before t − delay + half.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, INTERVAL)
    if means:
        parts = (np.arange(8) + 0.5) / 8 - 0.5  # of the interval; its midpoint rule errs by 1e-5
        rate = np.mean([body_rate(time - delay + p * INTERVAL, size) for p in parts], axis=0)
    else:
        rate = body_rate(time - delay, size)
    matrix = np.eye(3) if matrix is None else matrix
    rate = rate @ np.linalg.inv(matrix).T + BIAS
    rate += rng.normal(size=rate.shape) * noise / np.sqrt(INTERVAL)
    at = np.arange(0, len(time), every)
    at = at[rng.random(len(at)) >= missing]
    error = Rotation.from_rotvec(rng.normal(size=(len(at), 3)) * np.radians(error_deg))
    return time, rate, at, (attitude(time[at], size) * error).as_quat()


def turning_record(seed, angles, error_deg=0.3, noise=1e-4, seconds=60.0, bias=BIAS, every=1):
    """As `record`, of a body whose yaw, pitch and roll (…, 3), rad, are given as a function of time."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, INTERVAL)

    def at(stamps):
        return Rotation.from_euler("ZYX", angles(stamps))

    rate = (at(time - 1e-4).inv() * at(time + 1e-4)).as_rotvec() / 2e-4 + bias
    rate += rng.normal(size=rate.shape) * noise / np.sqrt(INTERVAL)
    known = np.arange(0, len(time), every)
    error = Rotation.from_rotvec(rng.normal(size=(len(known), 3)) * np.radians(error_deg))
    return time, rate, known, (at(time[known]) * error).as_quat()


def judged(*arrays, name="reference"):
    return judge(agreement(*arrays), *arrays, name=name)


def test_exact_data_give_delay_bias_and_matrix():
    matrix = 1.02 * TILT.as_matrix() @ np.array([[1, 0.01, 0], [0, 0.99, 0], [0, 0, 1.01]])
    found = agreement(*record(0, matrix=matrix, delay=0.012, noise=0, error_deg=0))
    # The rate between readings is interpolated: (h²/12) ω̈ of it is lost, of 1e-4 of the rate.
    np.testing.assert_allclose(found.matrix, matrix, atol=5e-4)
    np.testing.assert_allclose(found.bias, BIAS, atol=5e-5)
    assert found.delay == pytest.approx(0.012, abs=2e-4)
    assert found.scale == pytest.approx(np.cbrt(np.linalg.det(matrix)), abs=5e-4)
    assert found.explained > 0.99999
    assert found.moved
    assert not found.mirrored


@pytest.mark.parametrize("delay", [-0.0175, 0.0175])
def test_the_delay_is_what_undoes_it_in_rotation_increments(delay):
    time, rate, at, quaternion = record(1, delay=delay, noise=0, error_deg=0, missing=0)
    found = agreement(time, rate, at, quaternion)
    turned = rotation_increments(time, rate - found.bias, found.delay)
    end = Rotation.from_quat(propagate(turned, quaternion[0])[-2])
    # A minute's drift of a bias that is wrong by 1e-5 rad/s, and the interpolation's, is below 1e-3.
    assert (end.inv() * Rotation.from_quat(quaternion[-2])).magnitude() < 2e-3


CASES = {
    "samples, 0.5° references": {},
    "means, rare references": {"means": True, "every": 28, "seconds": 90.0},
    "poor gyroscope, fine references": {"noise": 0.03, "error_deg": 0.05},
    "poor gyroscope, references at 2 Hz": {"noise": 0.03, "error_deg": 0.05, "every": 14},
    "accelerometer and magnetometer": {"error_deg": 2.0, "size": 0.5},
}


@pytest.mark.parametrize("case", CASES)
def test_standard_errors_are_honest(case):
    delay = 0.02
    off = []
    for seed in range(16):
        found = agreement(*record(seed, matrix=1.01 * TILT.as_matrix(), delay=delay, **CASES[case]))
        off.append(
            [
                (found.delay - delay) / found.delay_std,
                np.sqrt(np.mean(((found.bias - BIAS) / found.bias_std) ** 2)),
                (found.scale - 1.01) / found.scale_std,
                np.sqrt(
                    np.mean(((found.misalignment - TILT.as_rotvec()) / found.misalignment_std) ** 2)
                ),
            ]
        )
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    # 16 normal deviates have an rms of 1 ± 0.18, and the jackknife over 30 windows adds 0.1: three
    # times both, for 20 figures. The benchmark prints the same over more seeds.
    assert ((rms > 0.5) & (rms < 1.6)).all(), rms


def wobble(degrees):
    return lambda t: np.stack(
        [2 * np.sin(0.7 * t), *(np.radians(degrees) * np.sin(f * t) for f in (3, 4.1))], axis=-1
    )


ONE_AXIS = {
    "turntable": lambda t: np.stack([0.8 * np.sin(0.5 * t), 0 * t, 0 * t], axis=-1),
    "full turns": lambda t: np.stack([0.35 * t + 0.7 * np.sin(0.7 * t), 0 * t, 0 * t], axis=-1),
    "tilted turntable": lambda t: np.stack([2 * np.sin(t), 0 * t + 0.3, 0 * t + 0.5], axis=-1),
    "turntable that wobbles by 0.01°": wobble(0.01),
}
MORE_AXES = {
    "two axes": lambda t: (
        np.stack([0 * t, 0 * t, 0.8 * np.sin(0.5 * t)], axis=-1)
        + np.stack([0 * t, 0.6 * np.sin(0.8 * t), 0 * t], axis=-1)
    ),
    "car": wobble(1.0),
}
SLANT = Rotation.from_rotvec([0.5, -0.3, 0.2])


@pytest.mark.parametrize("noise", [1e-4, 2e-3])
@pytest.mark.parametrize("case", ONE_AXIS)
def test_a_turntable_tells_scale_and_axis_of_its_own_axis_alone(case, noise):
    """With odd seeds the table's axis is none of the body's."""
    off = []
    for seed in range(4):
        time, rate, at, quaternion = turning_record(seed, ONE_AXIS[case], noise=noise)
        axis = np.array([0.0, 0.0, 1.0])
        if case == "tilted turntable":
            # Yaw about the vertical, seen in the body.
            axis = Rotation.from_euler("ZYX", [0, 0.3, 0.5]).inv().apply(axis)
        if seed % 2:
            rate, axis = SLANT.inv().apply(rate), SLANT.inv().apply(axis)
            quaternion = (Rotation.from_quat(quaternion) * SLANT).as_quat()
        found = agreement(time, rate, at, quaternion)
        (note,) = judge(found, time, rate, at, quaternion)
        assert note.startswith("The body turned about one axis only")
        assert abs(found.directions[0] @ axis) > 0.999
        assert len(found.directions) == 1
        assert found.scale == pytest.approx(1, abs=0.005)
        assert found.angle < np.radians(0.5)
        assert np.isinf(found.misalignment_std[np.abs(axis) > 0.1]).all()
        off.append([(found.scale - 1) / found.scale_std, found.angle / found.angle_std])
    # Rms of 4 normal deviates below 2; the angle, of two across the axis, is √2 times as large.
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < [2, 2 * np.sqrt(2)]).all()


@pytest.mark.parametrize("case", MORE_AXES)
def test_two_axes_and_a_car_tell_the_axes(case):
    off = []
    for seed in range(6):
        arrays = turning_record(seed, MORE_AXES[case], noise=1e-4)
        found = agreement(*arrays)
        assert judge(found, *arrays) == ()
        assert len(found.directions) >= 2
        assert np.isfinite(found.misalignment_std).all()
        off.append(
            [
                (found.scale - 1) / found.scale_std,
                np.sqrt(np.mean((found.misalignment / found.misalignment_std) ** 2)),
            ]
        )
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert (rms < 2).all(), rms


@pytest.mark.parametrize("seed", range(5))
def test_a_bias_that_drifts_is_no_motion(seed):
    """About the axes that stand still the readings drift by far more than their white noise."""
    time, rate, at, quaternion = turning_record(
        seed, ONE_AXIS["turntable"], noise=1e-4, error_deg=0.02
    )
    rng = np.random.default_rng(seed + 50)
    rate += np.cumsum(rng.normal(size=rate.shape), axis=0) * 2e-3 * np.sqrt(INTERVAL)
    found = agreement(time, rate, at, quaternion)
    assert len(found.directions) == 1
    assert found.scale == pytest.approx(1, abs=0.01)


def test_a_wrong_unit_and_a_turned_axis_on_a_turntable_are_named():
    time, rate, at, quaternion = turning_record(1, ONE_AXIS["turntable"])
    with pytest.raises(InputError, match="unit") as raised:
        judged(time, rate * 180 / np.pi, at, quaternion)
    assert 'write unit = "deg/s"' in raised.value.problems[0].mend
    with pytest.raises(Refusal, match=r"turned about most is .*20\.\d° apart"):
        judged(time, Rotation.from_rotvec([np.radians(20.4), 0, 0]).apply(rate), at, quaternion)
    with pytest.raises(InputError, match="the gyroscope has the wrong sign there"):
        judged(time, -rate, at, quaternion)


def test_outliers_among_the_references_hardly_matter():
    time, rate, at, quaternion = record(3)
    rng = np.random.default_rng(4)
    wild = rng.choice(len(at), len(at) // 33, replace=False)
    quaternion[wild] = Rotation.random(len(wild), rng).as_quat()
    clean, found = agreement(*record(3)), agreement(time, rate, at, quaternion)
    # Huber's weights let 3 % of outliers pull by a fraction of a standard error of the clean record's.
    assert abs(found.delay - clean.delay) < 2 * clean.delay_std
    assert (np.abs(found.bias - clean.bias) < 2 * clean.bias_std).all()
    assert abs(found.scale - 1) < 0.01
    assert judged(time, rate, at, quaternion) == ()


def test_windows_do_not_reach_across_a_lost_step():
    time, rate, at, quaternion = record(5, missing=0)
    lost = np.zeros(len(time) - 1, dtype=bool)
    lost[800] = True
    windows = Windows.of(time, at, quaternion, lost)
    for window in range(windows.count):
        stamps = windows.at[windows.number == window]
        assert stamps[-1] <= 800 or stamps[0] > 800
    # The body turned by a right angle while nothing was read.
    jump = Rotation.from_euler("x", 90, degrees=True)
    turned = quaternion.copy()
    turned[801:] = (jump * Rotation.from_quat(quaternion[801:])).as_quat()
    with_gap = agreement(time, rate, at, turned, lost)
    without = agreement(time, rate, at, quaternion, lost)
    np.testing.assert_allclose(with_gap.bias, without.bias, atol=1e-9)


def test_stamps_and_references_go_in_pairs():
    time, rate, at, quaternion = record(0, seconds=2)
    with pytest.raises(ValueError, match="pairs"):
        agreement(time, rate, at[:-1], quaternion)


@pytest.mark.parametrize(
    "case",
    [
        {},
        {"size": 0.2, "every": 28, "seconds": 120.0},  # slow, references at 1 Hz
        {"error_deg": 2.0},
        {"error_deg": 2.0, "size": 0.2, "seconds": 120.0},
        {"noise": 0.03},
        {"delay": 0.0175, "means": True},
        {"delay": -0.0175},
    ],
)
def test_a_good_record_has_no_remarks(case):
    arrays = record(7, **case)
    assert agrees(agreement(*arrays))
    assert judged(*arrays) == ()


@pytest.mark.parametrize("seed", range(100, 104))
def test_too_little_motion_judges_nothing(seed):
    arrays = record(seed, size=1e-6)
    found = agreement(*arrays)
    assert (found.moved, found.delay) == (False, 0.0)
    assert "too little motion" in judge(found, *arrays)[0]
    few = record(seed, seconds=9.0, every=28)
    assert "too few references" in judge(agreement(*few), *few)[0]


def test_a_delay_that_is_not_told_is_taken_as_none():
    # Slow motion, a reading's delay of 10 ms moves the rare, poor references by 1/1000 of their noise.
    arrays = record(3, size=0.2, every=28, error_deg=2.0, seconds=120.0)
    found = agreement(*arrays)
    assert found.moved
    assert (found.delay, found.delay_std) == (0.0, np.inf)
    (note,) = judge(found, *arrays)
    assert "too little to tell the readings' delay" in note


def test_a_steady_turn_does_not_tell_scale_from_bias():
    time = np.arange(0, 60, INTERVAL)
    rng = np.random.default_rng(9)
    rate = np.tile([0, 0, 0.3], (len(time), 1)) + rng.normal(size=(len(time), 3)) * 0.005
    true = Rotation.from_rotvec(np.outer(time, [0, 0, 0.3]))
    quaternion = (true * Rotation.from_rotvec(rng.normal(size=(len(time), 3)) * 0.01)).as_quat()
    arrays = time, rate, np.arange(len(time)), quaternion
    found = agreement(*arrays)
    assert not found.moved
    (note,) = judge(found, *arrays)
    assert "its rates hardly change" in note


def test_the_inverse_rotation_is_named():
    time, rate, at, quaternion = record(10)
    with pytest.raises(InputError, match=r"turns the other way.*reference_to_body") as raised:
        judged(time, rate, at, quaternion * [-1, -1, -1, 1])
    assert raised.value.problems[0].where == "[[recording]] reference: quaternion"


def test_the_inverse_rotation_about_one_axis_is_named():
    time = np.arange(0, 60, INTERVAL)
    angle = np.sin(time / 2)
    rate = np.outer(np.cos(time / 2) / 2, [0, 0, 1])
    rng = np.random.default_rng(11)
    true = Rotation.from_rotvec(np.outer(angle, [0, 0, 1]))
    quaternion = (true * Rotation.from_rotvec(rng.normal(size=(len(time), 3)) * 0.005)).as_quat()
    rate += rng.normal(size=rate.shape) * 0.005
    (note,) = judged(time, rate, np.arange(len(time)), quaternion)
    assert "one axis only, (0.00, 0.00, 1.00)" in note
    with pytest.raises(InputError, match="turns the other way"):
        judged(time, rate, np.arange(len(time)), quaternion * [-1, -1, -1, 1])


SHIFTS = [([1, 2, 3, 0], "x, y, z, w"), ([3, 0, 1, 2], "w, x, y, z")]


@pytest.mark.parametrize(("read", "order"), SHIFTS)
def test_four_numbers_in_another_order_are_named(read, order):
    """`read` is what stands for x, y, z, w when the file's order is taken for the other."""
    time, rate, at, quaternion = record(12)
    with pytest.raises(InputError, match=f"in the order declared.*read as {order}") as raised:
        judged(time, rate, at, quaternion[:, read])
    assert raised.value.problems[0].where == "[[recording]] reference: columns"


@pytest.mark.parametrize(("read", "order"), SHIFTS)
def test_another_order_of_inverse_rotations_is_thought_of(read, order):
    """It cannot be told from a reference that is mounted so, with x and z exchanged."""
    time, rate, at, quaternion = record(12)
    with pytest.raises(Refusal, match=r"turned by (90\.\d|89\.9|180\.0|179\.\d)°") as raised:
        judged(time, rate, at, quaternion[:, read] * [-1, -1, -1, 1])
    assert "Or its four numbers are in another order" in raised.value.remedy


@pytest.mark.parametrize(
    ("factor", "mend"),
    [
        (180 / np.pi, 'write unit = "deg/s"'),
        (np.pi / 180, 'write unit = "rad/s"'),
        (1e3, "thousandths"),
        (1e-3, "a thousand of"),
        (2.0, "mend the unit or the scale"),
    ],
)
@pytest.mark.parametrize("every", [1, 28])
def test_a_wrong_unit_is_named(factor, mend, every):
    time, rate, at, quaternion = record(13, every=every, seconds=120.0)
    with pytest.raises(InputError) as raised:
        judged(time, rate * factor, at, quaternion)
    (problem,) = raised.value.problems
    assert problem.where == "[[recording]] gyroscope: unit"
    assert mend in problem.mend


def test_turned_axes_are_refused_with_what_they_are():
    time, rate, at, quaternion = record(14)
    turned = rate[:, [1, 2, 0]]
    with pytest.raises(Refusal, match=r"turned by 120\.\d°|turned by 119\.\d°") as raised:
        judged(time, turned, at, quaternion)
    # The reference's x is the gyroscope's third column now, y its first, z its second.
    assert "are nearly the gyroscope's z, x, y" in raised.value.remedy
    slant = Rotation.from_euler("y", 30, degrees=True)
    with pytest.raises(Refusal, match=r"turned by (29|30)\.\d° about") as raised:
        judged(time, slant.apply(rate), at, quaternion)
    assert "how it is mounted" in raised.value.remedy


@pytest.mark.parametrize(
    ("change", "named", "mend"),
    [
        (lambda r: r * [1, -1, 1], "its y has the wrong sign", "factor = [1, -1, 1]"),
        (lambda r: -r, "all have the wrong sign", "negate the columns x, y, z"),
        (lambda r: r[:, [1, 0, 2]], "x, y, z are its y, x, z", "in the order y, x, z"),
        (lambda r: r[:, [1, 0, 2]] * [-1, -1, 1], "its −y, −x, z", "negate the columns y, x"),
    ],
)
def test_a_mirrored_axis_is_named(change, named, mend):
    time, rate, at, quaternion = record(15)
    with pytest.raises(InputError, match="mirrored axis") as raised:
        judged(time, change(rate), at, quaternion)
    (problem,) = raised.value.problems
    assert named in problem.message
    assert mend in problem.mend
    assert "rad/s" not in problem.mend


VECTORS = "gravity and field"


@pytest.mark.parametrize(
    "wrong",
    [
        lambda q: q * [1, 1, -1, 1],  # mirrored: both y are of the wrong sign
        lambda q: q * [-1, -1, -1, 1],
        lambda q: (Rotation.from_quat(q) * Rotation.from_euler("z", 90, degrees=True)).as_quat(),
        lambda q: np.random.default_rng(2).permutation(q),
        lambda q: np.tile(q[0], (len(q), 1)),
    ],
)
def test_gravity_and_field_that_do_not_fit_are_not_the_gyroscopes_fault(wrong):
    time, rate, at, quaternion = record(15, seconds=30.0)
    with pytest.raises(Refusal) as raised:
        judged(time, rate, at, wrong(quaternion), name=VECTORS)
    assert "ravity and field" in raised.value.reason
    assert "accelerometer and magnetometer" in raised.value.remedy
    assert "reference" not in str(raised.value)


def test_gravity_and_field_accuse_no_unit_but_a_common_one():
    time, rate, at, quaternion = record(13)
    with pytest.raises(InputError, match='write unit = "deg/s"'):
        judged(time, rate * 180 / np.pi, at, quaternion, name=VECTORS)
    with pytest.raises(Refusal, match="accelerometer and magnetometer"):
        judged(time, rate * 1.8, at, quaternion, name=VECTORS)


@pytest.mark.parametrize("error_deg", [0.0, 0.3])
def test_a_reference_that_does_not_move_is_refused(error_deg):
    time, rate, at, quaternion = record(20, seconds=30.0)
    error = np.random.default_rng(5).normal(size=(len(at), 3)) * np.radians(error_deg)
    still = (Rotation.from_quat(quaternion[:1]) * Rotation.from_rotvec(error)).as_quat()
    with pytest.raises(Refusal, match="The reference does not move while the gyroscope turns"):
        judged(time, rate, at, still)


def test_a_reference_that_jumps_is_told():
    time, rate, at, quaternion = record(21)
    half = len(at) // 2
    jump = Rotation.from_euler("z", 30, degrees=True)
    quaternion[half:] = (jump * Rotation.from_quat(quaternion[half:])).as_quat()
    (note,) = judged(time, rate, at, quaternion)
    # 30° within the references' errors of 0.5° an axis.
    assert re.search(r"The reference jumps by (29|30)\.\d° against the gyroscope", note)
    assert f"{time[at[half]]:.1f} s after the start" in note


def test_a_reference_that_slides_away_in_a_few_steps_is_told():
    time, rate, at, quaternion = record(22, error_deg=0.1)
    slide = np.radians(np.clip(np.arange(len(at)) - 800, 0, 6) * 1.5)
    turned = Rotation.from_rotvec(np.outer(slide, [0, 0, 1]))
    notes = judged(time, rate, at, (turned * Rotation.from_quat(quaternion)).as_quat())
    # 9° within the references' and the gyroscope's errors of 0.1° to 0.2°.
    assert any(re.search(r"jumps by (8\.[5-9]|9\.[0-4])° against", note) for note in notes)


def test_a_frozen_reference_is_told():
    time, rate, at, quaternion = record(23, missing=0)
    quaternion[600:900] = quaternion[600]
    notes = judged(time, rate, at, quaternion)
    frozen = [note for note in notes if "frozen" in note]
    assert frozen == [
        f"The reference is frozen from {time[600]:.1f} s to {time[899]:.1f} s after the start, "
        "while the gyroscope turns."
    ]
    assert not any("jumps" in note for note in notes)


def test_a_reference_read_less_often_than_it_is_written_is_not_frozen():
    time, rate, at, quaternion = record(24, missing=0, error_deg=0.1)
    held = quaternion[np.arange(len(at)) // 3 * 3]
    assert not any("frozen" in note or "jumps" in note for note in judged(time, rate, at, held))


def test_a_noisy_gyroscope_does_not_tell_the_delay_by_its_noise():
    off = []
    for seed in range(12):
        arrays = turning_record(seed, ONE_AXIS["turntable"], noise=0.02, error_deg=0.05)
        found = agreement(*arrays)
        off.append(found.delay / found.delay_std)
    # Samples, so none is late; 12 normal deviates have an rms of 1 ± 0.2, untold ones count 0.
    assert np.sqrt(np.mean(np.square(off))) < 1.6


@pytest.mark.parametrize("late", [0.3, -0.3])
def test_a_delay_of_many_standard_errors_is_kept_however_short_the_interval(late):
    """A camera's references, at 1 Hz and poor, tell the delay to a few readings' intervals."""
    time, rate, at, quaternion = record(25, seconds=90.0, delay=late, every=28, error_deg=2.0)
    found = agreement(time, rate, at, quaternion)
    assert abs(found.delay - late) < 4 * found.delay_std
    assert 0.005 < found.delay_std < 0.1
    assert found.delay_taken == found.delay


def test_another_motion_is_refused():
    time, rate, at, quaternion = record(16)
    other = attitude(200 - 1.3 * time[at]).as_quat()
    with pytest.raises(Refusal, match="do not tell of the same motion"):
        judged(time, rate, at, other)
    with pytest.raises(Refusal, match="do not tell of the same motion"):
        judged(time, rate, at, np.random.default_rng(0).permutation(quaternion))


def test_small_deviations_are_mentioned_and_not_refused():
    (note,) = judged(*record(17, matrix=Rotation.from_euler("x", 2, degrees=True).as_matrix()))
    assert "turned by 2.0" in note or "turned by 1.9" in note
    (note,) = judged(*record(18, matrix=1.05 * np.eye(3)))
    assert "1.05" in note
    assert "scale factor" in note
    for delay, word in ((0.08, "later"), (-0.08, "earlier"), (0.7, "later")):
        arrays = record(19, delay=delay)
        assert agreement(*arrays).delay == pytest.approx(delay, abs=0.005)
        (note,) = judged(*arrays)
        assert word in note
        assert "taken into account" in note


def test_a_real_record_with_an_optical_reference(real_data):
    device = sensorbook.load(real_data / "broad-slow")
    readings, values = device.gyroscope.trajectory, device.reference.trajectory.values
    known = np.isfinite(values).all(axis=1)
    arrays = readings.time, readings.values, np.flatnonzero(known), values[known]
    found = agreement(*arrays)
    # Its readings are means over the interval of 35 ms before the stamp; 2.5 ms are between the clocks.
    assert found.delay == pytest.approx(0.0175, abs=0.003)
    assert found.delay_std < 5e-4
    assert found.scale == pytest.approx(1, abs=0.005)
    assert found.angle < np.radians(0.5)
    np.testing.assert_allclose(np.degrees(found.bias), [0.20, 0.12, -0.23], atol=0.05)
    assert judge(found, *arrays) == ()
