"""Work C's correction, its other reading and the complementary filter, on motions with known truth."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Attitudes, Motion, References, accuracy
from sensorbook.attitude.correction import (
    complementary,
    integrate,
    reset,
    reset_and_rate,
    steady_gain,
)

STEP = 0.035


def turning(count=600, bias=(0.0, 0.0, 0.0), noise=0.0, seed=1, every=1, axis=None):
    """Motion, exact references every so many steps, and the true attitudes."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) * STEP
    if axis is None:
        true = Rotation.from_euler(
            "ZYX", np.stack([np.sin(time), 0.4 * np.sin(0.7 * time), 0.5 * time], 1)
        )
    else:
        true = Rotation.from_rotvec(np.outer(np.sin(time), np.eye(3)[axis]))
    turned = (true[:-1].inv() * true[1:]).as_rotvec()
    read = turned + np.multiply(bias, STEP) + noise * rng.normal(size=turned.shape)
    at = np.arange(0, count, every)
    references = References(at, true.as_quat()[at], np.zeros((len(at), 3, 3)))
    return Motion.of(time, read), references, true.as_quat()


@pytest.mark.parametrize(
    "method", [integrate, reset, reset_and_rate, lambda m, r: complementary(m, r, 0.5, 5.0)]
)
def test_exact_rates_give_the_exact_attitude(method):
    motion, references, true = turning(every=20)
    assert np.abs(method(motion, references).errors(true)).max() < 1e-12


def test_the_gyroscope_alone_drifts_by_its_bias():
    motion, references, true = turning(bias=(0.01, 0, 0), axis=0)
    found = integrate(motion, references).errors(true)
    assert found[:, 0] == pytest.approx(0.01 * motion.time, abs=1e-12)
    assert np.abs(integrate(motion, references, np.array([0.01, 0, 0])).errors(true)).max() < 1e-12


def test_the_correction_comes_one_step_late():
    """With a reference at each stamp, the error is that of the last step and no other."""
    motion, references, true = turning(noise=0.005)
    clean, _, _ = turning()
    found = reset(motion, references).errors(true)[1:]
    # Of second order: the error, up to 0.02, times the rotation of a step, 0.05.
    assert found == pytest.approx(motion.increments - clean.increments, abs=1e-3)


def test_between_references_the_reset_drifts_and_comes_back():
    motion, references, true = turning(bias=(0.02, 0, 0), axis=0, every=50)
    error = reset(motion, references).errors(true)[:, 0]
    assert error[50] == pytest.approx(0.02 * 50 * STEP)
    assert error[51] == pytest.approx(0.02 * STEP)
    assert error[100] == pytest.approx(error[50])


def test_kept_in_the_rates_the_correction_takes_the_bias_out():
    motion, references, true = turning(bias=(0.02, -0.01, 0.03), every=50)
    found = reset_and_rate(motion, references)
    # The bias turns with the body while it integrates: after some references it is found.
    assert found.bias[-1] == pytest.approx([0.02, -0.01, 0.03], abs=1e-5)
    assert np.abs(found.errors(true)[400:]).max() < 1e-4
    assert found.bias[49] == pytest.approx(0)


def test_the_order_of_the_matrices_matters():
    """C's A_i A_aᵀ is of reference → body matrices; of body → reference ones it turns about wrong axes."""
    motion, references, true = turning(bias=(0.05, 0, 0), every=30)
    at = integrate(motion, references).quaternion[30]
    right = (Rotation.from_quat(true[30]).inv() * Rotation.from_quat(at)).as_rotvec()
    wrong = (Rotation.from_quat(at) * Rotation.from_quat(true[30]).inv()).as_rotvec()
    assert np.linalg.norm(right) == pytest.approx(np.linalg.norm(wrong))
    assert np.linalg.norm(right - wrong) > 0.3 * np.linalg.norm(right)
    assert reset(motion, references).errors(true)[30] == pytest.approx(right)


def test_a_complementary_filter_finds_the_bias():
    motion, references, true = turning(count=3000, bias=(0.02, -0.01, 0.03), every=10)
    found = complementary(motion, references, 0.3, 5.0)
    assert found.bias[-1] == pytest.approx([0.02, -0.01, 0.03], abs=1e-4)
    assert np.abs(found.errors(true)[-100:]).max() < 1e-4


def test_a_complementary_filter_smooths_a_poor_reference():
    motion, references, true = turning(count=3000, noise=1e-4)
    rng = np.random.default_rng(4)
    wrong = Rotation.from_quat(true) * Rotation.from_rotvec(0.02 * rng.normal(size=(len(true), 3)))
    poor = References(references.at, wrong.as_quat(), references.covariance)
    smooth = accuracy(complementary(motion, poor, 0.05, 20.0), true).rms
    # White errors of σ come through a gain α as σ √(α/(2 − α)): 0.16 here; with some transient.
    assert smooth < 0.3 * accuracy(reset(motion, poor), true).rms


@pytest.mark.parametrize("ratio", [1e-6, 0.01, 1.0, 100.0, 1e12])
def test_the_steady_gain_is_that_of_riccati(ratio):
    variance = 1.0
    for _ in range(20_000):
        predicted = variance + ratio
        variance = predicted / (predicted + 1)
    gain = (variance + ratio) / (variance + ratio + 1)
    assert steady_gain(np.sqrt(ratio), 1.0, 1.0) == pytest.approx(gain, rel=1e-6)


def test_a_perfect_reference_is_taken_as_it_is():
    assert steady_gain(0.01, 0.0, 1.0) == 1.0


def test_a_perfect_gyroscope_takes_nothing_of_a_reference_with_errors():
    assert steady_gain(0.0, 0.01, 1.0) == 0.0


@pytest.mark.parametrize(("gain", "constant", "message"), [
    (0.0, 5.0, "attitude_gain is 0.0: give more than 0 and up to 1"),
    (1.1, 5.0, "attitude_gain is 1.1"),
    (0.5, 0.0, "time_constant is 0.0: give more than 0 s"),
    (0.5, np.nan, "time_constant is nan"),
])  # fmt: skip
def test_gains_that_make_no_sense_are_refused(gain, constant, message):
    motion, references, _ = turning(count=50)
    with pytest.raises(ValueError, match=message):
        complementary(motion, references, gain, constant)


def test_references_at_a_rate_are_the_nearest_to_each_tick():
    time = np.arange(2000) * STEP
    references = References(
        np.arange(2000), np.tile([0, 0, 0, 1.0], (2000, 1)), np.zeros((2000, 3, 3))
    )
    chosen = references.at_rate(time, 10.0)
    ticks = np.arange(len(chosen)) / 10
    # The last tick lies beyond the record's end, and takes what is there.
    assert np.abs(time[chosen.at] - ticks)[:-1].max() <= STEP / 2 + 1e-9
    assert len(chosen) == 701
    # Where references are missing around a tick, the nearest within half a period stands in.
    holes = references.where((references.at < 300) | (references.at > 340))
    sparse = holes.at_rate(time, 1.0)
    assert not ((sparse.at >= 300) & (sparse.at <= 340)).any()
    assert len(sparse) in (69, 70)
    assert len(references.at_rate(time, 100.0)) == 2000


def test_an_outage_takes_its_references_out():
    time = np.arange(100.0)
    references = References(
        np.arange(100), np.tile([0, 0, 0, 1.0], (100, 1)), np.zeros((100, 3, 3))
    )
    assert list(references.outside(time, 12, 20).at[10:14]) == [10, 11, 20, 21]


def test_euler_errors_do_not_jump_by_a_turn():
    true = Rotation.from_euler("ZYX", [[179.5, 0, 0]], degrees=True).as_quat()
    found = Rotation.from_euler("ZYX", [[-179.5, 1, 2]], degrees=True).as_quat()
    roll, pitch, yaw = np.degrees(Attitudes(found).euler_errors(true)[0])
    assert (roll, pitch, yaw) == pytest.approx((2, 1, 1))


def test_nothing_in_common_is_told():
    nothing = np.full((5, 4), np.nan)
    with pytest.raises(ValueError, match="no stamp has both an attitude and a true one"):
        accuracy(Attitudes(nothing), nothing)
