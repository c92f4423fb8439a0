"""Work C's (5.3) taken as printed: what each way leaves of an error that is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.attitude import literal
from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References
from sensorbook.attitude.experiment import METHODS, Run, c_experiment
from sensorbook.simulate import trajectory

STEP, N = trajectory.C_STEP, trajectory.C_RANDOM_WALK


def still(error, attitude=(0.0, 0.0, 0.0)):
    """A body that stays at an attitude (rotation vector, body → reference), a gyroscope that errs by
    `error` (3,) rad in its first step only, and exact references at every fourth stamp."""
    time = np.arange(13) * STEP
    increments = np.zeros((12, 3))
    increments[0] = error
    true = np.tile(Rotation.from_rotvec(attitude).as_quat(), (13, 1))
    references = References(np.arange(13), true, np.tile(1e-12 * np.eye(3), (13, 1, 1)))
    run = Run(Motion.of(time, increments), references, true, np.zeros(3))
    return run, references.where(np.arange(0, 13, 4))


def left(way, error, attitude=(0.0, 0.0, 0.0)):
    """Error vectors before the first correction and after each of three."""
    run, references = still(error, attitude)
    return way(run, references).errors(run.true)[[4, 5, 9, 12]]


def test_small_errors_are_taken_out_by_the_elements():
    error = 1e-3 * np.array([3.0, -1.0, 2.0])
    before, after, *_ = left(literal.small_angles, error, (0.4, -0.9, 1.2))
    np.testing.assert_allclose(before, error, atol=1e-12)
    assert np.linalg.norm(after) < np.linalg.norm(error) ** 2, "of second order"


def test_elements_of_a_large_error():
    """n sin θ and (1 − cos θ) n_i n_j, of which the body is then turned back."""
    axis, angle = np.array([2.0, -1.0, 2.0]) / 3, 0.6
    x, y, z = axis
    omega = np.sin(angle) * axis + (1 - np.cos(angle)) * np.array([y * z, x * z, x * y])
    expected = Rotation.from_rotvec(angle * axis) * Rotation.from_rotvec(-omega)
    for attitude in ((0.0, 0.0, 0.0), (0.4, -0.9, 1.2)):
        after = left(literal.small_angles, angle * axis, attitude)[1]
        np.testing.assert_allclose(after, expected.as_rotvec(), atol=1e-9)
    # About one axis alone the second part is none: what is left is θ − sin θ.
    alone = left(literal.small_angles, [0, 0, angle])
    assert alone[1][2] == pytest.approx(angle - np.sin(angle))
    assert alone[2][2] == pytest.approx(alone[1][2] - np.sin(alone[1][2]), rel=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0, 2.0])
def test_the_product_as_printed(tilt):
    """Of a small error: nothing along the axis by which the body is turned, 2 sin(θ/2) across it."""
    size = 1e-4
    along = left(literal.mixed_up, [0, 0, size], (0, 0, tilt))
    across = left(literal.mixed_up, [size, 0, 0], (0, 0, tilt))
    np.testing.assert_allclose(along[1:], 0, atol=1e-10)
    shrinks = 2 * np.sin(tilt / 2)
    sizes = np.linalg.norm(across, axis=1)
    np.testing.assert_allclose(sizes[:3], size * shrinks ** np.arange(3), atol=1e-8)


def test_recovery():
    path = trajectory.experiment(0, 30.0)
    turns = path.true_rate[1:] * STEP
    runs = [
        c_experiment(path.time, turns, path.true, seed, trajectory.C_BIAS, N, np.radians(0.05))
        for seed in range(2100, 2104)
    ]
    noise = GyroscopeNoise(N, 0.0, 0.03)

    def reset(run, references):
        return METHODS["reset"](run, references, noise)

    found = np.degrees(literal.recovery(runs, reset, 2.0, (12, 20)))
    whole = [np.linalg.norm(reset(r, r.at(2.0, (12, 20))).errors(r.true), axis=1) for r in runs]
    mean = np.degrees(np.mean(whole, axis=0))
    # 19.985 s is stamp 571, the first reference 572, and what it changes shows at the next.
    assert found[:2] == pytest.approx(mean[[571, 573]])
    assert len(found) == 5
    # One step of noise is 0.34° about each axis, 0.54° in all; four runs scatter by a fifth.
    assert (found[1:] < 1.1).all()
    assert (found[1:] > 0.25).all()
    elements = np.degrees(literal.recovery(runs, literal.small_angles, 2.0, (12, 20), 2))
    assert len(elements) == 3
    # The same noise in both: what differs is what a large angle's elements leave.
    assert elements[1] > 1.2 * found[1]
    assert elements[2] < 1.1
