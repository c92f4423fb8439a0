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


def test_rate_random_walk_keeps_its_size_to_the_end():
    """std(y(T) − y(0)) = K√T, and at every tenth of the way; 0.935 of it would be a periodic noise."""
    walk, rate, rng = 1e-4, 20.0, np.random.default_rng(39)
    noise = np.stack(
        [
            rates(gyroscope(), np.zeros((201, 3)), rate, rng, rate_random_walk=walk)
            for _ in range(2000)
        ]
    )
    assert (noise[:, 0] == 0).all()
    change = noise[:, 20::20] - noise[:, :1]
    time = np.arange(20, 201, 20) / rate
    ratio = np.sqrt((change**2).mean(axis=(0, 2))) / (walk * np.sqrt(time))
    # 6000 walks: 0.9 %; four of that.
    assert ratio == pytest.approx(np.ones(10), abs=0.037)
    apart = np.corrcoef(change[:, -1].T)  # of 2000: 0.022
    assert np.abs(apart - np.eye(3)).max() < 0.09
    assert rates(gyroscope(), np.zeros((1, 3)), rate, rng, rate_random_walk=walk).shape == (1, 3)


def test_settings_out_of_range():
    with pytest.raises(ValueError, match="diagonal of zeros"):
        gyroscope(misalignment=np.eye(3))
    with pytest.raises(ValueError, match=r"needed is \(N, 3\)"):
        rates(MODEL, np.zeros(3), 100.0, np.random.default_rng(0))
