"""Gyroscope: model, inversion, and what integration makes of its errors."""

import numpy as np
import pytest

from sensorbook.attitude.sensors.gyroscope import angle_error, gyroscope, rates

MODEL = gyroscope(
    [0.01, -0.02, 0.005], [[0, 1e-3, 2e-3], [3e-3, 0, -1e-3], [0, 2e-3, 0]], [0.1, 0, -0.2]
)


def test_model_of_c_3_17_and_its_inversion():
    true = np.random.default_rng(1).normal(size=(200, 3))
    raw = rates(MODEL, true, 100.0, np.random.default_rng(2))
    matrix = np.eye(3) + np.array([[0.01, 1e-3, 2e-3], [3e-3, -0.02, -1e-3], [0, 2e-3, 0.005]])
    assert raw == pytest.approx(true @ matrix.T + [0.1, 0, -0.2], abs=1e-12)
    assert np.abs(MODEL.correct(raw) - true).max() < 1e-9


def test_angle_random_walk():
    """A sample scatters by N√rate, the angle after t by N√t."""
    walk, rate = 1e-3, 50.0
    noise = rates(
        gyroscope(), np.zeros((60_000, 3)), rate, np.random.default_rng(3), angle_random_walk=walk
    )
    assert noise.std() == pytest.approx(walk * np.sqrt(rate), rel=0.02)
    angle = noise.reshape(600, 100, 3).sum(axis=1) / rate  # after 2 s, 1800 times
    expected = angle_error(2.0, 0.0, walk)[1]
    assert angle.std() == pytest.approx(expected, rel=0.07)
    assert angle_error(10.0, 0.1, 0.0)[0] == pytest.approx(1.0)


def test_settings_out_of_range():
    with pytest.raises(ValueError, match="diagonal of zeros"):
        gyroscope(misalignment=np.eye(3))
    with pytest.raises(ValueError, match=r"needed is \(N, 3\)"):
        rates(MODEL, np.zeros(3), 100.0, np.random.default_rng(0))
