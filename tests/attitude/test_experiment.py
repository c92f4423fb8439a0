"""Work C's experiment: what is drawn, what the methods make of it, and the study's own arithmetic."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from sensorbook.attitude import experiment as e
from sensorbook.attitude.aiding import GyroscopeNoise, accuracy
from sensorbook.attitude.propagation import propagate
from sensorbook.simulate import trajectory

STEP, N = trajectory.C_STEP, trajectory.C_RANDOM_WALK
BIAS = np.array(trajectory.C_BIAS)
OWN = np.radians(0.05)
NOISE = GyroscopeNoise(N, 0.0, 0.03)


def motion(seconds=60.0):
    path = trajectory.experiment(0, seconds)
    return path.time, path.true_rate[1:] * STEP, path.true


def draw(seed, seconds=60.0, bias=BIAS, random_walk=N, own=OWN):
    return e.c_experiment(*motion(seconds), seed, bias, random_walk, own)


@pytest.fixture(scope="module")
def runs():
    return [draw(seed) for seed in range(1900, 1906)]


@pytest.fixture(scope="module")
def found(runs):
    return e.study(runs, NOISE)


def test_what_is_added_to_the_true_rates():
    time, turns, true = motion(300.0)
    std = np.radians([0.05, 0.2, 1.0])
    run = e.c_experiment(time, turns, true, 1907, BIAS, N, std)
    added = (run.motion.increments - turns) / STEP
    count = len(added)
    # Four standard errors of a mean and of a standard deviation.
    np.testing.assert_allclose(added.mean(axis=0), BIAS, atol=4 * 0.169 / np.sqrt(count))
    np.testing.assert_allclose(added.std(axis=0), 0.169, rtol=4 / np.sqrt(2 * count))
    off = (
        Rotation.from_quat(true).inv() * Rotation.from_quat(run.references.quaternion)
    ).as_rotvec()
    np.testing.assert_allclose(off.std(axis=0), std, rtol=4 / np.sqrt(2 * count))
    np.testing.assert_allclose(run.references.covariance[7], np.diag(std**2))
    # The increments are those of the truth: what they integrate to is the reference (C 5.2.1).
    np.testing.assert_allclose(
        np.abs(np.sum(propagate(turns, true[0]) * true, axis=1)), 1, rtol=0, atol=1e-9
    )


def test_a_seed_is_a_run():
    one, same, other = draw(1), draw(np.random.default_rng(1)), draw(2)
    np.testing.assert_array_equal(one.motion.increments, same.motion.increments)
    np.testing.assert_array_equal(one.references.quaternion, same.references.quaternion)
    assert (one.motion.increments != other.motion.increments).all()


def test_uneven_steps_of_a_record():
    time = np.cumsum(np.r_[0, np.tile([0.01, 0.03], 4000)])
    still = np.tile([0, 0, 0, 1.0], (len(time), 1))
    run = e.c_experiment(time, np.zeros((8000, 3)), still, 1908, [0.1, 0, 0], 0.01, OWN)
    short, long = run.motion.increments[::2], run.motion.increments[1::2]
    # N √h and b h in each step, within four standard errors of 4000.
    for turns, step in ((short, 0.01), (long, 0.03)):
        sigma = 0.01 * np.sqrt(step)
        assert turns[:, 1:].std() == pytest.approx(sigma, rel=4 / np.sqrt(16000))
        assert turns[:, 0].mean() == pytest.approx(0.1 * step, abs=4 * sigma / np.sqrt(4000))


def test_references_by_rate_and_outage(runs):
    run = runs[0]
    assert list(run.at(e.NEVER).at) == [0]
    stamps = run.motion.time[run.at(1.0).at]
    np.testing.assert_allclose(stamps, np.arange(len(stamps)), atol=STEP / 2 + 1e-9)
    kept = run.motion.time[run.at(1.0, (12, 20)).at]
    assert not ((kept >= 12) & (kept < 20)).any()
    # The ticks at 12 s and 20 s take the nearest stamps outside, where 12.005 s and 19.985 s are nearer.
    np.testing.assert_allclose(kept[11:14], [10.99, 11.97, 20.02], atol=1e-9)
    np.testing.assert_array_equal(kept[:12], stamps[:12])
    np.testing.assert_array_equal(kept[14:], stamps[21:])


def test_work_c_s_table(found):
    """The issue's bound: C's own method within 40 % of C's, averaged over the three angles."""
    for rate in e.RATES:
        ours = np.degrees(found["reset", rate].euler).mean()
        assert ours == pytest.approx(np.mean(e.PRINTED[rate]), rel=0.4), rate


def test_filter_against_the_yardstick(found):
    """The issue's bounds, which are for 24 runs and more; six scatter by a few per cent."""
    for rate, most in zip(e.RATES, (1.5, 1.35, 1.15, 1.15, 1.2), strict=True):
        ratio = found["mekf", rate].axes.mean() / found[e.KNOWN, rate].axes.mean()
        assert 0.95 < ratio < most * 1.05, rate
        assert found["smoother", rate].mean < 0.8 * found["mekf", rate].mean


def test_order_of_the_methods(found):
    for rate in e.RATES:
        assert found["mekf", rate].mean < found["complementary", rate].mean * 1.01
        assert found["complementary", rate].mean < found["reset", rate].mean
    assert found["integration", e.NEVER].mean > 4 * found["reset", 0.1].mean
    assert found[e.KNOWN, e.NEVER].mean < found["integration", e.NEVER].mean / 2


def test_summary_of_the_study(runs, found):
    """One pair computed again by hand."""
    each = [accuracy(e.estimate(run, "mekf", 2.0, NOISE), run.true) for run in runs]
    summary = found["mekf", 2.0]
    assert summary.mean == pytest.approx(np.mean([a.mean for a in each]))
    assert summary.nees == pytest.approx(np.mean([a.nees for a in each]))
    np.testing.assert_allclose(summary.euler, np.mean([a.euler for a in each], axis=0))
    assert summary.scatter == pytest.approx(np.std([a.euler.mean() for a in each], ddof=1))
    ends = [e.estimate(run, "mekf", 2.0, NOISE).bias[-1] - run.bias for run in runs]
    assert summary.bias_rms == pytest.approx(np.sqrt(np.mean(np.square(ends))))
    # What 60 s of white noise leave of a bias, N/√T = 0.0041 rad/s; 18 numbers scatter by a sixth.
    assert summary.bias_rms == pytest.approx(N / np.sqrt(60), rel=0.5)
    assert found[e.KNOWN, 2.0].bias_rms == 0
    assert np.isnan(found["reset", 2.0].bias_rms)


def test_a_study_of_some_pairs(runs):
    some = e.study(runs[:1], NOISE, [1.0], ("reset", "integration"))
    assert set(some) == {("integration", e.NEVER), ("reset", 1.0)}
    assert np.isnan(some["reset", 1.0].scatter), "one run has none"


def test_methods_without_references_integrate(runs):
    run = runs[0]
    alone = e.estimate(run, "integration", e.NEVER, NOISE).quaternion
    for method in ("reset", "reset_and_rate", "complementary", "mekf", "smoother"):
        other = e.estimate(run, method, e.NEVER, NOISE).quaternion
        same = np.abs(np.sum(alone * other, axis=1))
        np.testing.assert_allclose(same, 1, rtol=0, atol=1e-9, err_msg=method)
    np.testing.assert_array_equal(e.estimate(run, "integration", 1.0, NOISE).quaternion, alone)


def test_consistency(runs):
    good = e.consistency(runs, 1.0, NOISE)
    count = len(runs)
    assert stats.chi2.cdf(count * good.low, 3 * count) == pytest.approx(0.025)
    assert stats.chi2.cdf(count * good.high, 3 * count) == pytest.approx(0.975)
    # The runs' own scatter; six of them, so that t of 5 degrees of freedom is 2.57 and not 1.96.
    assert good.mean_low <= 3 <= good.mean_high
    assert good.mean == pytest.approx(good.nees.mean())
    # Stamps of one second hang together: 60 s of six runs leave the share a scatter of some 0.02.
    assert 0.88 < good.inside <= 1
    trusting = e.consistency(runs, 1.0, GyroscopeNoise(N / 10, 0.0, 0.03))
    timid = e.consistency(runs, 1.0, GyroscopeNoise(N * 10, 0.0, 0.03))
    assert trusting.mean_low > 30
    assert timid.mean_high < 0.5
    assert good.error < 1.05 * min(trusting.error, timid.error)


@pytest.mark.parametrize("known", [True, False])
def test_growth(known):
    rng = np.random.default_rng(1910)
    runs = [
        e.c_experiment(*motion(20.0), rng, 0.03 * rng.normal(size=3), N, OWN) for _ in range(150)
    ]
    grown = e.growth(runs, NOISE, known)
    # 150 runs of three axes: 3.3 % an epoch, and the epochs hang together; four of it.
    assert grown.ratio(np.radians(45)) == pytest.approx(1, rel=0.13)
    assert np.isnan(grown.ratio(1e-9))
    time = runs[0].motion.time
    if known:
        expected = np.sqrt(3 * (OWN**2 + N**2 * time))
        # S is the mean of two attitudes, which is shorter than the step by φ²/8 of a step's turn φ.
        np.testing.assert_allclose(grown.predicted, expected, rtol=3e-4)
    else:
        # No rotation carries a constant bias farther than b t.
        assert (grown.predicted**2 <= 3 * (OWN**2 + N**2 * time + (0.03 * time) ** 2) * 1.001).all()


def test_through_an_outage(runs):
    lost = {m: e.through_outage(runs, m, 2.0, NOISE, (12, 20)) for m in ("reset", "mekf")}
    before, end, after = np.degrees(lost["reset"].angle_1)
    # C: 0.84°, 18.0°, 1.05° for one draw on another motion; the bias alone makes 8 s × 2.9 °/s in all,
    # of which less than half is angle 1 on this one.
    assert 0.5 < before < 1.5
    assert 6 < end < 25
    assert 0.5 < after < 1.5
    assert lost["mekf"].whole[1] < 0.75 * lost["reset"].whole[1]
    time = runs[0].motion.time
    assert lost["reset"].total.shape == time.shape
    # The largest error is at the first reference, 20.02 s, before it is made use of; 19.985 s is the end.
    assert 19.9 < time[np.argmax(lost["reset"].total)] < 20.03
    by_hand = [
        np.linalg.norm(e.estimate(run, "reset", 2.0, NOISE, (12, 20)).errors(run.true), axis=1)
        for run in runs
    ]
    assert lost["reset"].whole[1] == pytest.approx(np.mean(by_hand, axis=0)[571])
    assert lost["reset"].whole[2] == pytest.approx(np.mean(by_hand, axis=0)[573:687].mean())
    assert time[686] < 24.02 <= time[687] + 1e-9


def test_an_outage_to_the_end(runs):
    with pytest.raises(ValueError, match="no reference comes after the outage"):
        e.through_outage(runs[:1], "mekf", 2.0, NOISE, (55, 61))


def test_rate_needed():
    rates, errors = [0.1, 1.0, 10.0], [8.0, 2.0, 0.5]
    assert e.rate_needed(rates, errors, 2.0) == pytest.approx(1.0)
    assert e.rate_needed(rates, errors, 1.0) == pytest.approx(np.sqrt(10))
    assert e.rate_needed(rates, errors, 9.0) == 0.1
    assert e.rate_needed(rates, errors, 0.4) is None
