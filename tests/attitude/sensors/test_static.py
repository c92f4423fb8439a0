"""Static horizon sensor: rays against caps, both inversions, range."""

import numpy as np
import pytest

from sensorbook.attitude.sensors.conical import angular_radius
from sensorbook.attitude.sensors.horizon import tilted
from sensorbook.attitude.sensors.static import SAMPLING, StaticSensor, overlap, signals, tilt

SENSOR = StaticSensor(700e3, np.radians(5))


def exact(nadir, height):
    apart = np.arccos(nadir @ SENSOR.directions.T)
    return overlap(SENSOR.field, angular_radius(height)[..., None], apart)


def random(count, seed):
    rng = np.random.default_rng(seed)
    roll, pitch = rng.uniform(-0.05, 0.05, (2, count))
    return (
        roll,
        pitch,
        rng.uniform(690e3, 710e3, count),
        tilted(roll, pitch, rng.uniform(-3, 3, count)),
    )


def test_level_at_the_design_height_every_field_is_nearly_half_full():
    level = signals(SENSOR, np.eye(3), 700e3)
    # The limb curves: a little less than half. Four fields that are turned copies of one.
    assert np.ptp(level) < 3e-3
    assert level.mean() == pytest.approx(
        exact(np.array([0.0, 0.0, 1.0]), np.array(700e3))[0], abs=1e-3
    )
    assert 0.48 < level.mean() < 0.5


def test_rays_agree_with_the_overlap_of_caps():
    _, _, height, body = random(200, 1)
    difference = signals(SENSOR, body, height, 8000) - exact(body[:, :, 2], height)
    # 0.3 · 8000^(−3/4) = 3.5e-4 rms
    assert np.sqrt((difference**2).mean()) < 7e-4


def test_overlap_at_its_ends():
    assert overlap(0.1, 1.0, 0.5) == 1
    assert overlap(0.1, 1.0, 1.2) == 0
    assert overlap(0.01, np.pi / 2, np.pi / 2) == pytest.approx(0.5, abs=1e-9)


def test_exact_round_trip():
    roll, pitch, height, body = random(500, 2)
    fix = tilt(SENSOR, exact(body[:, :, 2], height))
    assert (fix.reasons == "").all()
    assert np.abs(fix.roll - roll).max() < 1e-9
    assert np.abs(fix.pitch - pitch).max() < 1e-9
    assert np.abs(fix.height - height).max() < 0.01  # m


def test_from_rays_as_well_as_they_are_counted():
    roll, pitch, height, body = random(100, 3)
    fix = tilt(SENSOR, signals(SENSOR, body, height, 20_000))
    # A share errs by 3e-4, an angle by πa/4 of it times √2 and the curvature.
    assert np.abs(fix.roll - roll).max() < 2e-4
    assert np.abs(fix.pitch - pitch).max() < 2e-4


def test_opposite_differences_are_right_to_first_order_only():
    small, large = 1e-3, 0.05
    for angle, most in ((small, 0.02), (large, 0.2)):
        body = tilted(angle, -angle)
        fix = tilt(SENSOR, exact(body[:, 2], np.array(700e3)))
        assert fix.roll_linear == pytest.approx(angle, rel=most)
        assert fix.pitch_linear == pytest.approx(-angle, rel=most)
    assert abs(fix.roll_linear - large) > 1e-4


def test_standard_errors_by_nees():
    body, sigma = tilted(0.02, -0.03), 1e-3
    level = exact(body[:, 2], np.array(705e3))
    fix = tilt(SENSOR, level + np.random.default_rng(4).normal(0, sigma, (10_000, 4)), sigma)
    error = np.cross(fix.nadir, body[:, 2])
    nees = np.einsum("ni,nij,nj->n", error, fix.information, error).mean()
    assert nees == pytest.approx(2, rel=0.03)
    assert ((fix.height - 705e3) ** 2 / fix.height_std**2).mean() == pytest.approx(1, abs=0.05)
    assert "Yaw" in fix.unobservable


@pytest.mark.parametrize(
    ("shares", "reason"),
    [
        ([0.0, 0, 0, 0], "only space: the height"),
        ([1.0, 1, 1, 1], "only the Earth: the height"),
        ([1.0, 0.5, 0.0, 0.5], "the tilt, or the height"),
        ([0.9, 0.2, 0.9, 0.2], "fit no disc"),
        ([np.nan, 0.5, 0.5, 0.5], "no finite number"),
    ],
)
def test_refusals(shares, reason):
    fix = tilt(SENSOR, [shares, [0.5, 0.5, 0.5, 0.5]], 1e-3)
    assert reason in fix.reasons[0]
    assert np.isnan(fix.nadir[0]).all()
    assert fix.reasons[1] == ""
    assert fix.roll[1] == pytest.approx(0, abs=1e-9)


def test_range_of_heights():
    least, most = SENSOR.heights
    assert least < 700e3 < most
    for height, reason in ((0.98 * least, "below"), (1.02 * most, "above")):
        assert reason in tilt(SENSOR, signals(SENSOR, np.eye(3), height)).reasons.item()
    for height in (1.05 * least, 0.95 * most):
        assert tilt(SENSOR, signals(SENSOR, np.eye(3), height)).reasons.item() == ""


def test_a_field_too_large():
    with pytest.raises(ValueError, match="field is 1 rad"):
        StaticSensor(700e3, 1.0)
    with pytest.raises(ValueError, match="signals: shape"):
        tilt(SENSOR, [0.5, 0.5])


def test_signals_that_fit_no_disc_to_5_standard_errors():
    """A misfit of hundreds of standard errors, though below what is taken without them."""
    sensor = StaticSensor(500e3, np.radians(5))
    shares = 0.49767 + np.array([0, 0.12, 0, 0])
    fix = tilt(sensor, shares, sigma=1e-4)
    assert "fit no disc" in fix.reasons.item()
    assert np.isnan([fix.roll, fix.roll_std, fix.height]).all()
    # Half of the change by one signal is misfit, and 5 √(10⁻⁸ + SAMPLING²) is the limit.
    limit = 5 * np.hypot(1e-4, SAMPLING)
    for part, reason in ((0.9, False), (1.1, True)):
        shares = 0.49767 + np.array([0, 2 * part * limit, 0, 0])
        assert ("fit no disc" in tilt(sensor, shares, sigma=1e-4).reasons.item()) is reason


@pytest.mark.parametrize("sigma", [1e-4, 5e-3, 0.03])
def test_noise_alone_fits_a_disc(sigma):
    body = tilted(0.01, -0.02)
    shares = signals(SENSOR, body, 700e3)
    noise = np.random.default_rng(34).normal(0, sigma, (10_000, 4))
    # Of 10⁴ samples 0.006 are beyond 5 standard errors.
    assert (tilt(SENSOR, shares + noise, sigma).reasons == "").all()


def test_rays_fit_a_disc_whatever_the_standard_error():
    _, _, height, body = random(1000, 35)
    assert (tilt(SENSOR, signals(SENSOR, body, height), 1e-6).reasons == "").all()


def test_a_mirrored_attitude():
    with pytest.raises(ValueError, match="it mirrors"):
        signals(SENSOR, -np.eye(3), 700e3)
