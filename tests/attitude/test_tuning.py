"""What gyroscope and reference show of each other, on motions whose errors are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Motion, References, accuracy
from sensorbook.attitude.kalman import mekf
from sensorbook.attitude.tuning import assumed, disagreement, noise_terms, tuned
from sensorbook.errors import Refusal

STEP, COUNT = 0.02, 15_000  # five minutes
BIAS = np.array([0.02, -0.01, 0.005])


def moved(seed, sigma=0.002, white=0.001, scale=0.0, walk=0.0, every=5):
    """Readings with bias, white noise, a scale-factor error that changes, a walking bias; references."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * STEP
    angles = [
        0.9 * np.sin(0.9 * time),
        0.5 * np.sin(0.61 * time + 1),
        0.8 * np.sin(0.43 * time + 2),
    ]
    true = Rotation.from_euler("ZYX", np.stack(angles, axis=1))
    turned = (true[:-1].inv() * true[1:]).as_rotvec()
    # A scale factor that forgets itself in a second, as one that hangs on what the body does.
    changing = np.repeat(rng.normal(scale=scale, size=(COUNT // 50 + 1, 3)), 50, axis=0)
    bias = BIAS + walk * np.sqrt(STEP) * np.cumsum(rng.normal(size=turned.shape), axis=0)
    read = turned * (1 + changing[: COUNT - 1]) + bias * STEP
    read += white * np.sqrt(STEP) * rng.normal(size=turned.shape)
    at = np.arange(0, COUNT, every)
    seen = true[at] * Rotation.from_rotvec(sigma * rng.normal(size=(len(at), 3)))
    covariance = np.full((len(at), 3, 3), np.nan)
    return Motion.of(time, read), References(at, seen.as_quat(), covariance), true.as_quat()


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_both_sides_white_noise_is_found(seed):
    found = disagreement(*moved(seed)[:2])
    # 3000 references: their error is known to 2 %; N from what is left, in part told as motion's.
    assert found.reference_std == pytest.approx(0.002, rel=0.05)
    whole = np.sqrt(found.random_walk**2 + found.motion_share)
    assert whole == pytest.approx(0.001, rel=0.25)
    assert found.bias == pytest.approx(BIAS, abs=4e-4)  # 0.001/√38 s, the longest window
    assert found.reference_shown
    assert found.duration == pytest.approx(time_of(), abs=0.2)


def time_of() -> float:
    return (COUNT - 1) * STEP


def test_what_motion_adds_is_told_apart_where_the_noise_at_rest_is_known():
    motion, references, _ = moved(24, scale=0.02)
    still = disagreement(*moved(24)[:2], random_walk=0.001)
    found = disagreement(motion, references, random_walk=0.001)
    assert found.random_walk == 0.001
    assert found.std[1] == 0
    # A scale error s for τ = 1 s at a time adds s² τ/2 |ω|² to the variance a second, an axis of three:
    # 0.02 √(½ … 1) √(⅓) of the rate.
    assert 0.005 < found.in_motion < 0.02
    assert still.in_motion < 0.3 * found.in_motion


def test_a_bias_that_walks_is_seen():
    found = disagreement(*moved(25, sigma=0.0005, walk=0.001)[:2], random_walk=0.001)
    assert found.rate_random_walk == pytest.approx(0.001, rel=0.4)  # few windows are long


def test_the_reference_that_hides_is_not_called_perfect():
    motion, references, _ = moved(26, sigma=0.0001, white=0.02)
    found = disagreement(motion, references)
    if not found.reference_shown:
        assert found.reference_at_most > 0.0001
    assert found.reference_at_most < 0.02


def test_outliers_move_little():
    motion, references, _ = moved(27)
    rng = np.random.default_rng(1)
    wild = rng.choice(len(references), 30, replace=False)
    quaternion = references.quaternion.copy()
    quaternion[wild] = Rotation.random(30, rng=rng).as_quat()
    with_them = disagreement(motion, References(references.at, quaternion, references.covariance))
    assert with_them.reference_std == pytest.approx(0.002, rel=0.1)
    assert with_them.bias == pytest.approx(BIAS, abs=5e-4)


def test_a_filter_tuned_by_it_is_consistent():
    nees = []
    for seed in range(30, 34):
        motion, references, true = moved(seed)
        found = disagreement(motion, references)
        covariance = np.tile(np.eye(3) * found.reference_std**2, (len(references), 1, 1))
        given = References(references.at, references.quaternion, covariance)
        attitudes = mekf(motion, given.at_rate(motion.time, 0.5), tuned(found))
        nees.append(accuracy(attitudes, true).nees)
    assert 2.0 < np.mean(nees) < 4.0  # 3 is right; 150 references in each of four runs


def test_noise_of_the_noise_chapters_goes_before():
    found = disagreement(*moved(28)[:2])
    noise = tuned(found, (1e-4, 2e-4, 3e-4), (1e-6, 1e-6, 2e-6), 0.1)
    assert noise.random_walk == (1e-4, 2e-4, 3e-4)
    assert noise.rate_random_walk == (1e-6, 1e-6, 2e-6)
    assert noise.bias_std == 0.1
    assert noise.in_motion == found.in_motion


def test_a_bias_is_never_held_for_ever():
    found = disagreement(*moved(28)[:2])
    walk = tuned(found).rate_random_walk
    # N/T of a record of five minutes, which could not be told from none.
    assert walk == pytest.approx(0.001 / time_of(), rel=0.5)


def test_where_nothing_shows_it_a_consumers_gyroscope_is_assumed():
    plain = assumed(100.0)
    assert plain.random_walk == pytest.approx(np.radians(0.01))
    assert plain.rate_random_walk == pytest.approx(np.radians(0.01) / 100)
    known = assumed(100.0, (1e-3, 1e-3, 1e-3), (1e-5, 1e-5, 1e-5), 0.2)
    assert known.random_walk == (1e-3, 1e-3, 1e-3)
    assert known.rate_random_walk == (1e-5, 1e-5, 1e-5)
    assert known.bias_std == 0.2


def test_windows_do_not_reach_across_a_gap():
    motion, references, _ = moved(29)
    lost = np.zeros(len(motion.increments))
    broken = motion.increments.copy()
    lost[7000] = 3.0
    broken[7000] = [1.0, -2.0, 0.5]
    found = disagreement(Motion(motion.time, broken, lost), references)
    assert found.reference_std == pytest.approx(0.002, rel=0.05)
    assert np.degrees(found.rms).max() < 1


def test_few_references_are_refused():
    motion, references, _ = moved(29)
    with pytest.raises(
        Refusal, match="12 references do not tell how good they and the gyroscope are"
    ):
        disagreement(motion, references.where(np.arange(12)))
    # Enough of them, but no two follow one another as most do.
    apart = references.where(np.unique((1.5 ** np.arange(31)).astype(int) % 3000))
    with pytest.raises(Refusal, match="references"):
        disagreement(motion, apart.where(np.arange(len(apart))[:29]))


def test_terms_of_a_noise_record():
    def axis(n, k):
        return {"random_walk": {"value": n}, "rate_random_walk": k and {"value": k}}

    noise = {"x": axis(1.0, 0.1), "y": axis(2.0, 0.2), "z": axis(3.0, 0.3)}
    assert noise_terms(noise) == ((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    noise["z"] = axis(3.0, None)
    assert noise_terms(noise) == ((1.0, 2.0, 3.0), None)
    assert noise_terms(None) == (None, None)
    assert noise_terms({"reason": "too short"}) == (None, None)
