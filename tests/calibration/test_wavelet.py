"""Denoising by wavelets."""

import numpy as np

from sensorbook.calibration.wavelet import denoise


def test_white_noise_goes_and_what_is_slow_stays():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 1024)[:, None]
    slow = np.sin(2 * np.pi * t * [1, 2, 3])
    left = denoise(slow + 0.1 * rng.standard_normal(slow.shape)) - slow
    # Three levels keep an eighth of the band: of white noise a share of √(1/8) = 0.35 remains.
    assert 0.03 < left.std() < 0.045


def test_a_clean_signal_is_returned():
    t = np.linspace(0, 1, 500)[:, None]
    np.testing.assert_allclose(denoise(1 + 0 * t), 1 + 0 * t, atol=1e-12)


def test_too_short_for_a_level():
    short = np.arange(9.0)[:, None]
    np.testing.assert_array_equal(denoise(short), short)
    assert len(denoise(np.arange(31.0)[:, None])) == 31
