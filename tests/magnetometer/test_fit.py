"""Calibration as far as the motion allows: what is given, reduced and refused; what it does not depend on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.ellipsoid import ENTRIES, PARAMETERS
from sensorbook.magnetometer.result import relative
from sensorbook.simulate import rotation
from sensorbook.simulate.rotation import read_field

from .turns import FIELD, anywhere, belt, cap, iron_of, read, soft_iron_of, turned_by_hand


@pytest.fixture(scope="module")
def made():
    """Readings (3000, 3) of one device turned by hand, and its iron."""
    rng = np.random.default_rng(1)
    iron = iron_of(rng)
    return read(rng, turned_by_hand(rng), iron), iron


@pytest.fixture(scope="module")
def fit(made):
    return calibrate(made[0])


def exact(rng, iron, count=1000):
    return read_field(FIELD * anywhere(rng, count), iron)


# ---- what is given ----


def test_a_device_turned_by_hand(made, fit):
    m, iron = made
    assert (fit.method, fit.reduced) == ("ellipsoid", ())
    assert fit.used.shape == (3000,)
    assert fit.used.mean() > 0.995
    s, field = relative(iron["soft_iron"], FIELD)
    truth = np.r_[iron["hard_iron"], [s[e] for e in ENTRIES], field]
    assert (np.abs(fit.values - truth) < 2 * fit.interval_factor * fit.std).all()
    # White noise of 0.42 µT and flicker in 48 µT.
    assert 0.8e-2 < fit.residual < 1.0e-2
    assert fit.residual_before > 20 * fit.residual
    assert fit.parameters == (*PARAMETERS, "field")
    length = np.linalg.norm(fit.correct(m), axis=1) / fit.field
    assert np.sqrt(np.mean((length[fit.used] - 1) ** 2)) == pytest.approx(fit.residual, rel=1e-6)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(*[st.floats(0.75, 1.4)] * 3),
    st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_exact_readings_give_the_truth(seed, factors, hard_iron):
    rng = np.random.default_rng(seed)
    s, h = soft_iron_of(rng, factors), FIELD * np.array(hard_iron)
    fit = calibrate(FIELD * np.linalg.solve(s, anywhere(rng, 300).T).T + h, FIELD)
    assert fit.method == "ellipsoid"
    np.testing.assert_allclose(fit.hard_iron / FIELD, hard_iron, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.soft_iron, s, rtol=0, atol=1e-9)


def test_an_axis_ratio_of_two_point_two_is_fitted_in_40_of_40():
    for seed in range(40):
        rng = np.random.default_rng([seed, 2])
        factors = np.array([1, rng.uniform(1, 2.2), 2.2]) / np.sqrt(2.2)
        iron = iron_of(rng) | {"soft_iron": soft_iron_of(rng, factors)}
        fit = calibrate(read(rng, turned_by_hand(rng), iron))
        assert fit.method == "ellipsoid"
        s = relative(iron["soft_iron"], FIELD)[0]
        # Eight standard errors, for what 40 devices of nine parameters and flicker noise may do.
        assert (np.abs(fit.hard_iron - iron["hard_iron"]) < 8 * fit.std[:3]).all()
        assert np.abs(fit.soft_iron - s).max() < 0.02


@pytest.mark.parametrize("louder", [1.0, 10.0])
def test_a_minute_in_all_attitudes_is_not_refused(louder):
    """Of 40 devices none, and none is reduced either."""
    methods = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        methods.append(calibrate(read(rng, turned_by_hand(rng), iron_of(rng), louder)).method)
    assert methods == ["ellipsoid"] * 40


# ---- what the result does not depend on ----


def test_unit_of_the_readings(made, fit):
    other = calibrate(1000 * made[0])
    np.testing.assert_allclose(other.hard_iron, 1000 * fit.hard_iron, rtol=1e-9)
    np.testing.assert_allclose(other.soft_iron, fit.soft_iron, rtol=0, atol=1e-9)
    assert other.field == pytest.approx(1000 * fit.field, rel=1e-9)
    factor = np.r_[[1000] * 3, [1] * 6, 1000]
    np.testing.assert_allclose(other.std, factor * fit.std, rtol=1e-6)


@pytest.mark.parametrize("order", [[1, 2, 0], [2, 1, 0]])
def test_order_of_the_axes(made, fit, order):
    other = calibrate(made[0][:, order])
    # The search for a start is the same, so the minimum is, to where its steps end.
    np.testing.assert_allclose(other.hard_iron / FIELD, fit.hard_iron[order] / FIELD, atol=1e-8)
    np.testing.assert_allclose(
        other.soft_iron, fit.soft_iron[np.ix_(order, order)], rtol=0, atol=1e-8
    )


def test_a_turn_of_the_axes(made, fit):
    turn = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    other = calibrate(made[0] @ turn.T)
    # Slow stretches and the noise are told by axis, which are others now: a small part of the error.
    error = fit.std.max()
    np.testing.assert_allclose(
        other.hard_iron, turn @ fit.hard_iron, rtol=0, atol=0.3 * fit.std[:3].max()
    )
    np.testing.assert_allclose(
        other.soft_iron, turn @ fit.soft_iron @ turn.T, rtol=0, atol=0.3 * error
    )


def test_an_offset(made, fit):
    other = calibrate(made[0] + [1e-3, 0, -2e-4])
    np.testing.assert_allclose(
        (other.hard_iron - fit.hard_iron) / FIELD, np.array([1e-3, 0, -2e-4]) / FIELD, atol=1e-8
    )
    np.testing.assert_allclose(other.soft_iron, fit.soft_iron, rtol=0, atol=1e-8)


def test_time_backward(made, fit):
    other = calibrate(made[0][::-1])
    # Blocks begin at the other end: slow stretches and errors are told a little differently.
    assert np.mean(other.used != fit.used[::-1]) < 0.01
    assert (np.abs(other.values - fit.values) <= 0.5 * fit.std).all()
    np.testing.assert_allclose(other.std, fit.std, rtol=0.3)
    assert other.residual_check == pytest.approx(fit.residual_check, rel=0.02)


def test_the_same_twice(made, fit):
    np.testing.assert_array_equal(calibrate(made[0]).values, fit.values)


# ---- rows that are left out ----


def test_rows_that_are_not_finite_are_left_out(made, fit):
    m = made[0]
    gone = np.zeros(len(m) + 4, dtype=bool)
    gone[[0, 17, 2000, len(m) + 3]] = True
    with_gaps = np.empty((len(gone), 3))
    with_gaps[~gone] = m
    with_gaps[gone] = [[np.nan] * 3, [0, np.inf, 0], [np.nan, 0, 0], [0, 0, -np.inf]]
    other = calibrate(with_gaps)
    np.testing.assert_array_equal(other.values, fit.values)
    assert not other.used[gone].any()
    np.testing.assert_array_equal(other.used[~gone], fit.used)


def test_used_names_the_rows_that_are_set_aside(made):
    m = made[0].copy()
    m[[5, 500, 2500]] += 3 * FIELD
    m[[6, 501]] = np.nan
    fit = calibrate(m)
    assert not fit.used[[5, 6, 500, 501, 2500]].any()
    assert fit.to_results()["set_aside"] == (~fit.used).sum()


# ---- strength ----


def test_without_a_known_field_the_soft_iron_is_relative(fit):
    assert not fit.field_known
    assert np.linalg.det(fit.soft_iron) == pytest.approx(1, rel=1e-12)
    assert fit.semi_axes.prod() == pytest.approx(fit.field**3, rel=1e-9)
    # The determinant is fixed: its gradient, det · S⁻¹, has no variance.
    inverse = np.linalg.inv(fit.soft_iron)
    by = np.r_[0, 0, 0, [inverse[e] * (1 if e[0] == e[1] else 2) for e in ENTRIES], 0]
    assert by @ fit.covariance @ by < 1e-6 * np.trace(fit.covariance[3:9, 3:9])


def test_a_known_field_scales_the_soft_iron(made, fit):
    known = calibrate(made[0], FIELD, 0.0, "a calibrated coil")
    assert known.field_known
    assert (known.field, known.field_source) == (FIELD, "a calibrated coil")
    assert known.std[9] == 0
    np.testing.assert_allclose(known.hard_iron, fit.hard_iron, rtol=1e-12)
    np.testing.assert_allclose(known.soft_iron, fit.soft_iron * FIELD / fit.field, rtol=1e-12)
    np.testing.assert_allclose(
        known.correct(made[0]) / FIELD, fit.correct(made[0]) / fit.field, rtol=1e-9, atol=1e-12
    )
    assert np.abs(known.soft_iron - made[1]["soft_iron"]).max() < 5e-3


def test_the_field_s_uncertainty_is_in_the_soft_iron(made):
    sure, doubtful = calibrate(made[0], FIELD), calibrate(made[0], FIELD, 0.02 * FIELD)
    added = doubtful.covariance - sure.covariance
    entries = np.array([sure.soft_iron[e] for e in ENTRIES])
    # S is proportional to the field: 2 % of it.
    own = 0.02 * np.r_[0, 0, 0, entries, FIELD]
    np.testing.assert_allclose(added, np.outer(own, own), rtol=1e-9, atol=1e-20)
    np.testing.assert_array_equal(doubtful.values, sure.values)


@pytest.mark.parametrize("field", [None, FIELD])
def test_covariance_is_that_of_repeated_recordings(field):
    """100 recordings of one sensor in the same motion: scatter of the parameters that are stated."""
    rng = np.random.default_rng(5)
    iron, u = iron_of(rng), anywhere(rng, 600)
    clean = read_field(FIELD * u, iron)
    found, stated = [], []
    for _ in range(100):
        fit = calibrate(clean + 0.01 * FIELD * rng.standard_normal(clean.shape), field)
        found.append(fit.values)
        stated.append(fit.std)
    free = slice(None) if field is None else slice(9)
    ratio = np.std(found, axis=0)[free] / np.sqrt(np.mean(np.square(stated), axis=0))[free]
    # Each scatter known to 7 %, the jackknife's mean to 2 %; the largest of ten.
    assert np.abs(ratio - 1).max() < 0.25
    if field is not None:
        assert {v[9] for v in found} == {FIELD}


# ---- what is refused and reduced ----


@pytest.mark.parametrize("louder", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_flat_turn_is_refused(seed, louder):
    rng = np.random.default_rng([seed, 6])
    m = read(rng, belt(rng, 5), iron_of(rng), louder)
    with pytest.raises(Refusal) as caught:
        calibrate(m)
    assert "plane" in caught.value.reason
    assert caught.value.remedy.startswith("Tip it by 90° and over, until its ")
    assert "points along the field, too" in caught.value.remedy


@pytest.mark.parametrize("louder", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_cap_is_refused(seed, louder):
    rng = np.random.default_rng([seed, 7])
    m = read(rng, cap(rng, 60), iron_of(rng), louder)
    with pytest.raises(Refusal) as caught:
        calibrate(m)
    assert "less is not determined either" in caught.value.reason
    assert caught.value.remedy.startswith("T")
    assert "points along the field, too" in caught.value.remedy


@pytest.mark.parametrize("seed", range(6))
def test_a_belt_is_reduced(seed):
    rng = np.random.default_rng([seed, 8])
    iron = iron_of(rng)
    fit = calibrate(read(rng, belt(rng, 20), iron))
    assert fit.method in ("diagonal", "hard_iron")
    assert "for the full ellipsoid" in fit.reduced[0]
    assert len(fit.reduced) == ("ellipsoid", "diagonal", "hard_iron").index(fit.method)
    # What it leaves out is in its intervals.
    error = np.abs(fit.hard_iron - iron["hard_iron"])
    assert (error < 1.5 * fit.interval_factor * fit.std[:3]).all()
    off = fit.soft_iron - np.diag(np.diag(fit.soft_iron))
    assert not off.any()


@pytest.mark.parametrize("degrees", [1.0, 5.0])
def test_a_turn_about_one_axis(degrees):
    """A device spun on a table: a cone about the vertical."""
    for seed in range(6):
        rng = np.random.default_rng([seed, 9])
        turn = 2 * np.pi * np.arange(3000) / 300
        tilt = np.radians(degrees) * np.sin(turn / 3.7)
        turns = Rotation.from_euler("zx", np.c_[turn, tilt])
        u = turns.inv().apply([0, np.cos(1.0), -np.sin(1.0)])
        with pytest.raises(Refusal, match=r"plane or cone|one side"):
            calibrate(read(rng, u, iron_of(rng)))


@pytest.mark.parametrize("count", [0, 1, 49])
def test_too_few_readings(count):
    m = exact(np.random.default_rng(10), iron_of(np.random.default_rng(11)), count)
    with pytest.raises(Refusal) as caught:
        calibrate(m)
    assert caught.value.reason == f"{count} different readings are too few; 50 are needed."
    assert caught.value.remedy == "Turn the device slowly through all attitudes for a minute."


def test_the_same_few_readings_again_and_again():
    m = exact(np.random.default_rng(12), iron_of(np.random.default_rng(13)), 20)
    with pytest.raises(Refusal, match=r"^20 different readings are too few; 50 are needed\."):
        calibrate(np.tile(m, (100, 1)))


def test_no_finite_reading():
    with pytest.raises(Refusal, match=r"^0 different readings are too few"):
        calibrate(np.full((100, 3), np.nan))


@pytest.mark.parametrize("seed", range(4))
def test_readings_on_no_ellipsoid(seed):
    """Beside a motor: the strength changes by a third from one reading to the next."""
    rng = np.random.default_rng([seed, 14])
    u = turned_by_hand(rng)
    strength = 1 + 0.3 * rng.uniform(-1, 1, (len(u), 1))
    with pytest.raises(Refusal) as caught:
        calibrate(read(rng, u * strength, iron_of(rng)))
    assert caught.value.reason.startswith(
        "The readings lie on no ellipsoid: their distance from the nearest is 1"
    )
    assert caught.value.reason.endswith(" % of the field rms.")
    assert caught.value.remedy.startswith("Turn it in one place, a metre from iron")


@pytest.mark.parametrize("seed", range(4))
def test_a_field_that_changes_by_half_is_refused(seed):
    """Somebody walks past a car, for a minute."""
    rng = np.random.default_rng([seed, 17])
    u = turned_by_hand(rng)
    strength = 1 + 0.5 * np.sin(2 * np.pi * np.arange(len(u)) / 700)[:, None]
    with pytest.raises(Refusal):
        calibrate(read(rng, u * strength, iron_of(rng)))


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_is_refused(seed):
    rng = np.random.default_rng([seed, 15])
    with pytest.raises(Refusal):
        calibrate(FIELD * rng.standard_normal((2000, 3)))


@pytest.mark.parametrize("seed", range(3))
def test_a_device_at_rest_is_refused(seed):
    rng = np.random.default_rng([seed, 16])
    u = np.tile(anywhere(rng, 1), (3000, 1))
    with pytest.raises(Refusal):
        calibrate(read(rng, u, iron_of(rng)))


# ---- the recording ----


def test_calibrate_rotation_takes_the_field_of_the_site(tmp_path):
    import sensorbook
    from sensorbook.earth import field_at
    from sensorbook.magnetometer import calibrate_rotation
    from sensorbook.simulate import simulate

    device = sensorbook.load(simulate(tmp_path / "compass", "rotation", seed=1))
    run = device.magnetometer.rotation
    known, earth = calibrate_rotation(run, device.site), field_at(device.site)
    assert (known.field, known.field_known) == (earth.strength, True)
    assert known.field_source == earth.source
    bare = calibrate_rotation(run)
    assert not bare.field_known
    np.testing.assert_allclose(bare.hard_iron, known.hard_iron, rtol=1e-12)


@pytest.mark.parametrize("equal", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_long_rest_before_the_turn_does_not_decide(seed, equal):
    """Twice as long at rest as turned, in a field that differs by 1 % along the hand's path."""
    rng = np.random.default_rng([seed, 21])
    gradient = rng.normal(scale=2e-5, size=(3, 3))
    place = 0.03 * rotation.smooth(rng, 3000, 50.0, 1.2)
    truth = rotation.draw_iron(rng, FIELD) | {"alignment": np.eye(3)}
    path = rotation.attitudes(rng, 3000, 50.0)
    level = FIELD * np.array([0, np.cos(1.0), -np.sin(1.0)])
    field = path.inv().apply(level + place @ (gradient + gradient.T) / 2)
    field = np.vstack([np.tile(field[:1], (6000, 1)), field])
    noise = {"random_walk": 10e-9, "bias_instability": 10e-9}
    m = rotation.noisy(rng, rotation.read_field(field, truth), 50.0, noise)
    if equal:
        m[:6000] = m[0]
    found = calibrate(m)
    assert found.method == "ellipsoid"
    # 4 standard errors on each of 18 numbers; and little of the turn is taken for disturbed.
    assert (np.abs(found.hard_iron - truth["hard_iron"]) < 4 * found.std[:3]).all()
    assert (~found.used[6000:]).mean() < 0.2


def test_a_device_that_lay_still():
    rng = np.random.default_rng(22)
    m = np.array([1e-5, 2e-5, -4e-5]) + rng.normal(scale=3e-7, size=(3000, 3))
    with pytest.raises(
        Refusal, match=r"The readings hardly change, by 1 % of their mean"
    ) as caught:
        calibrate(m)
    assert caught.value.remedy == "Turn it slowly through all attitudes, for a minute or two."
