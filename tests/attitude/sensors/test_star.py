"""Star sensor: pinhole, catalogue, attitude and its errors."""

import numpy as np
import pytest

from sensorbook.attitude.rotations import axis_rotation, error_vector
from sensorbook.attitude.sensors.horizon import tilted
from sensorbook.attitude.sensors.star import (
    Image,
    StarSensor,
    attitude,
    catalogue_size,
    chance_in_view,
    mean_for,
    random_sky,
    reference_vectors,
    take_image,
)

MOUNTED = axis_rotation("X", 0.4) @ axis_rotation("Z", -1.0)
SENSOR = StarSensor.of_field(np.radians(8), np.radians(8), 1024, sensor_from_body=MOUNTED)


def sky(mean=12, seed=1):
    count = round(catalogue_size(mean, np.radians(8), np.radians(8)))
    return reference_vectors(*random_sky(count, np.random.default_rng(seed)))


def test_catalogue_and_chances():
    assert catalogue_size(3, np.radians(3), np.radians(4)) == pytest.approx(10313.25)
    # 1 − e⁻³ (1 + 3 + 9/2 + 27/6)
    assert chance_in_view(3) == pytest.approx(1 - np.exp(-3) * 13, abs=1e-12)
    assert mean_for(0.99) == pytest.approx(10.045, abs=1e-3)
    assert chance_in_view(mean_for(0.99)) == pytest.approx(0.99)


def test_simulated_numbers_in_view_are_poisson():
    stars, rng = sky(3, 2), np.random.default_rng(3)
    seen = [
        len(take_image(SENSOR, tilted(*rng.uniform(-3, 3, 3)), stars).stars) for _ in range(1500)
    ]
    assert np.mean(seen) == pytest.approx(3, rel=0.06)
    # One sky, whose patches are seen again: a few per cent.
    assert np.mean(np.array(seen) >= 4) == pytest.approx(chance_in_view(3), abs=0.05)


def test_pinhole_round_trip():
    places = np.random.default_rng(4).uniform(0, 1024, (500, 2))
    assert SENSOR.project(SENSOR.direction(places)) == pytest.approx(places, abs=1e-9)
    assert SENSOR.direction(SENSOR.centre) == pytest.approx([0, 0, 1])
    corner = SENSOR.direction([1024.0, 512.0])
    assert np.arctan2(corner[0], corner[2]) == pytest.approx(np.radians(4))
    assert np.isnan(SENSOR.project([[0, 0, -1.0], [1, 0, 1.0]])).all()


def test_reference_vectors():
    assert reference_vectors(np.pi / 2, 0.0) == pytest.approx([0, 1, 0], abs=1e-15)
    assert reference_vectors(1.0, np.pi / 2) == pytest.approx([0, 0, 1], abs=1e-15)
    stars = reference_vectors(*random_sky(20_000, np.random.default_rng(5)))
    # Even over the sphere: zero mean, a third of the square on each axis.
    assert np.abs(stars.mean(axis=0)).max() < 0.02
    assert (stars**2).mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=0.01)


def test_attitude_is_exact_without_noise():
    stars, rng = sky(), np.random.default_rng(6)
    for _ in range(30):
        body = tilted(*rng.uniform(-3, 3, 3))
        image = take_image(SENSOR, body, stars)
        fix = attitude(SENSOR, image, stars)
        assert fix.reason == ""
        assert np.linalg.norm(error_vector(fix.matrix, body)) < 1e-9


def test_errors_across_and_about_the_boresight():
    stars, body, noise = sky(), tilted(0.3, -0.4, 1.2), 0.1
    errors, nees, rng = [], [], np.random.default_rng(7)
    for _ in range(2000):
        fix = attitude(SENSOR, take_image(SENSOR, body, stars, noise, rng), stars, noise)
        off = error_vector(fix.matrix, body)
        nees.append(off @ np.linalg.solve(fix.covariance, off))
        errors.append(MOUNTED @ off)
    # χ² of three; the mean of 2000 has a standard error of 1.8 % of 3.
    assert np.mean(nees) == pytest.approx(3, rel=0.06)
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert np.sqrt((rms[:2] ** 2).mean()) == pytest.approx(fix.across_std, rel=0.05)
    assert rms[2] == pytest.approx(fix.roll_std, rel=0.05)
    assert rms[2] > 10 * rms[0], "a narrow field sees roll badly"


def test_too_few_stars():
    stars = sky()[:1]
    fix = attitude(SENSOR, take_image(SENSOR, np.eye(3), stars), stars)
    assert "fewer than two stars" in fix.reason
    assert np.isnan(fix.matrix).all()
    assert fix.solution is None


def test_settings_out_of_range():
    with pytest.raises(ValueError, match="focal is 0"):
        StarSensor(0, 10, 10)
    with pytest.raises(ValueError, match="alpha is -1"):
        catalogue_size(3, -1, 1)
    with pytest.raises(ValueError, match="chance is 1"):
        mean_for(1)
    with pytest.raises(ValueError, match="mean is -1"):
        chance_in_view(-1)
    with pytest.raises(ValueError, match="least is 0: give 1 or more"):
        mean_for(0.5, 0)
    with pytest.raises(ValueError, match="noise is -1"):
        take_image(SENSOR, np.eye(3), sky(), -1)
    with pytest.raises(ValueError, match="noise is 0"):
        attitude(SENSOR, take_image(SENSOR, np.eye(3), sky()), sky(), 0)
    with pytest.raises(ValueError, match="it mirrors"):
        take_image(SENSOR, -np.eye(3), sky())
    with pytest.raises(ValueError, match="seeded generator"):
        take_image(SENSOR, np.eye(3), sky(), 0.1)


def test_any_number_of_stars_has_its_mean():
    assert chance_in_view(mean_for(0.5, 30_000), 30_000) == pytest.approx(0.5)
    # 1 − exp(−m) = 10⁻⁶
    assert mean_for(1e-6, 1) == pytest.approx(1e-6, rel=1e-4)


def test_a_pixel_spans_less_off_the_boresight():
    place = np.array([900.0, 700.0])
    outward = (place - SENSOR.centre) / np.linalg.norm(place - SENSOR.centre)
    spans = [
        np.linalg.norm(SENSOR.direction(place + 1e-3 * step) - SENSOR.direction(place)) / 1e-3
        for step in (outward, outward[::-1] * [-1, 1])
    ]
    assert SENSOR.pixel_angles(SENSOR.direction(place)) == pytest.approx(spans, rel=1e-5)


@pytest.mark.parametrize("field", np.radians([60, 140]))
def test_standard_errors_of_wide_fields(field):
    wide = StarSensor.of_field(field, field, 1024, sensor_from_body=MOUNTED)
    stars = reference_vectors(*random_sky(300, np.random.default_rng(37)))
    body, noise, rng = tilted(0.3, -0.4, 1.2), 0.1, np.random.default_rng(38)
    errors, nees = [], []
    for _ in range(2000):
        fix = attitude(wide, take_image(wide, body, stars, noise, rng), stars, noise)
        off = error_vector(fix.matrix, body)
        nees.append(off @ np.linalg.solve(fix.covariance, off))
        errors.append(MOUNTED @ off)
    # Known to 1.8 % of 3, 1.1 % and 1.6 %.
    assert np.mean(nees) == pytest.approx(3, rel=0.06)
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert np.sqrt((rms[:2] ** 2).mean()) == pytest.approx(fix.across_std, rel=0.04)
    assert rms[2] == pytest.approx(fix.roll_std, rel=0.05)


def test_stars_in_one_direction_are_refused_not_raised():
    for place, words in (([500.0, 500.0], "parallel"), ([np.nan, 500.0], "no finite number")):
        image = Image(np.array([0, 1]), np.array([[500.0, 500.0], place]))
        for noise in (None, 0.1):
            fix = attitude(SENSOR, image, sky(), noise)
            assert words in fix.reason
            assert np.isnan(fix.matrix).all()
            assert np.isnan([fix.across_std, fix.roll_std]).all()
            assert fix.solution is None
