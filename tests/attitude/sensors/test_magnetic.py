"""Magnetometer: model and inversion, one vector's limits, the field along an orbit."""

import numpy as np
import pytest

from sensorbook.attitude.sensors.horizon import tilted
from sensorbook.attitude.sensors.magnetic import field_along_orbit, field_direction, readings

FIELD = np.array([20e-6, -3e-6, 40e-6])
SOFT = np.array([[1.02, 0.01, 0], [0.01, 0.97, -0.02], [0, -0.02, 1.01]])
BIAS = np.array([5e-6, -8e-6, 2e-6])


def test_round_trip():
    body = tilted(*np.random.default_rng(1).uniform(-3, 3, (3, 500)))
    for soft in (None, SOFT):
        raw = readings(body, FIELD, BIAS, soft)
        found = field_direction(raw, BIAS, soft)
        expected = body @ (FIELD / np.linalg.norm(FIELD))
        assert np.abs(found.direction - expected).max() < 1e-12
        assert found.strength == pytest.approx(np.linalg.norm(FIELD))
    assert readings(np.eye(3), FIELD, BIAS) == pytest.approx(FIELD + BIAS), "C 3.10"


def test_one_vector_leaves_the_rotation_about_it():
    found = field_direction(FIELD, sigma=1e-7)
    assert "not observable" in found.unobservable
    assert np.abs(found.information @ found.direction).max() < 1e-6
    raw = FIELD + np.random.default_rng(2).normal(0, 1e-7, (10_000, 3))
    seen = field_direction(raw, sigma=1e-7)
    error = np.cross(seen.direction, found.direction)
    nees = np.einsum("ni,nij,nj->n", error, seen.information, error).mean()
    assert nees == pytest.approx(2, rel=0.03)


def test_refusals():
    found = field_direction([BIAS, [np.nan, 0, 0], FIELD], BIAS)
    assert "no field is left" in found.reasons[0]
    assert "no finite number" in found.reasons[1]
    assert np.isnan(found.direction[:2]).all()
    assert found.reasons[2] == ""
    with pytest.raises(ValueError, match="soft_iron"):
        field_direction(FIELD, soft_iron=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="give a seeded generator"):
        readings(np.eye(3), FIELD, noise=1e-8)
    with pytest.raises(ValueError, match="it mirrors"):
        readings(-np.eye(3), FIELD)


def test_orbit():
    orbit = field_along_orbit(700e3, np.radians(98), "2026-01-01T00:00", 60)
    assert orbit.time[-1] == pytest.approx(5926, abs=2)  # s; 2π √(a³/GM)
    assert np.linalg.norm(orbit.ned, axis=1) == pytest.approx(np.linalg.norm(orbit.eci, axis=1))
    strength = 1e6 * np.linalg.norm(orbit.ned, axis=1)
    assert 14 < strength.min() < 25
    assert 38 < strength.max() < 52
    assert np.degrees(orbit.latitude).max() == pytest.approx(82, abs=0.5)
    # Down is against the position, to the 0.2° between geodetic and geocentric.
    north_pole = np.argmax(orbit.latitude)
    up = orbit.position[north_pole] / np.linalg.norm(orbit.position[north_pole])
    assert orbit.ned[north_pole, 2] > 3e-5
    assert orbit.eci[north_pole] @ up == pytest.approx(-orbit.ned[north_pole, 2], rel=1e-3)
    with pytest.raises(ValueError, match="height is -1"):
        field_along_orbit(-1, 1.0, "2026-01-01")
