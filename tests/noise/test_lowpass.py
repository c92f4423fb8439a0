"""The low-pass found in a record, against filters designed by scipy."""

import numpy as np
import pytest
from scipy import signal

from sensorbook.noise import NoiseTerms, allan_deviation, find_low_pass

RATE, SAMPLES = 100.0, 360_000  # an hour


def white(seed, samples=SAMPLES):
    return np.random.default_rng([31, seed]).standard_normal(samples)


def filtered(order, cutoff, seed, rate=RATE, samples=SAMPLES):
    sos = signal.butter(order, cutoff, fs=rate, output="sos")
    warm_up = 2000  # the filter has forgotten its start
    return signal.sosfilt(sos, white(seed, samples + warm_up))[warm_up:]


def correlation_time(order, cutoff, rate=RATE):
    """t_c of σ²(τ) = N²/τ (1 − t_c/τ) by quadrature of |H|².

    The mean of m samples has the variance (m Σr_k − Σ|k|r_k)/m², two neighbouring means the covariance
    Σ k r_k/m²; half the mean square of their difference is S/m (1 − 3 δt Σ k r_k/(S m δt)), the sums
    over k ≥ 1 and S the density at zero, 1. The autocovariance r is the transform of |H|².
    """
    sos = signal.butter(order, cutoff, fs=rate, output="sos")
    n = 1 << 14
    _, h = signal.freqz_sos(sos, worN=n, whole=True)
    r = np.fft.ifft(np.abs(h) ** 2).real
    k = np.arange(1, n // 2)
    return 3 / rate * np.sum(k * r[1 : n // 2])


FILTERS = [(order, cutoff) for order in (1, 2, 4) for cutoff in (8.0, 20.0)]


@pytest.mark.parametrize(("order", "cutoff"), FILTERS)
def test_cut_off_of_a_butterworth(order, cutoff):
    found = find_low_pass(filtered(order, cutoff, seed=order), RATE)
    assert found.cutoff == pytest.approx(cutoff, rel=0.05)


@pytest.mark.parametrize(("order", "cutoff"), FILTERS)
def test_correlation_time_of_a_butterworth(order, cutoff):
    found = find_low_pass(filtered(order, cutoff, seed=order), RATE)
    # The floor: a digital filter falls to zero at the Nyquist frequency, which three terms of an
    # all-pole shape follow to some per cent of the correlation time.
    true = correlation_time(order, cutoff)
    assert abs(found.correlation_time - true) < 4 * found.std + 0.03 * true
    # An interval that holds everything would pass too.
    assert found.std < 0.25 * true


def test_correlation_time_is_what_the_allan_deviation_feels():
    # The definition itself, on the mean of many records: σ²τ/N² = 1 − t_c/τ well above 1/cutoff.
    cutoff, m = 20.0, np.array([20, 40, 80])
    rows = np.stack([filtered(2, cutoff, 100 + i, samples=100_000) for i in range(40)], axis=1)
    curve = allan_deviation(rows, RATE, m)
    shortfall = 1 - np.mean(curve.deviation**2, axis=1) * curve.tau * RATE
    expected = correlation_time(2, cutoff) / curve.tau
    # edf ≈ 1.5·N/m each, 40 records: σ² is known to √(2/(40·1.5·N/m)).
    spread = np.sqrt(2 / (40 * 1.5 * 100_000 / m))
    assert (np.abs(shortfall - expected) < 4 * spread).all()
    assert expected[0] > 10 * spread[0]  # so that the comparison says something


@pytest.mark.parametrize("seed", range(6))
def test_none_on_white_noise(seed):
    assert find_low_pass(white(200 + seed), RATE) is None


def test_none_where_slow_noise_rises_above_the_floor():
    walk = np.cumsum(white(300)) * 0.003
    assert find_low_pass(white(301) + walk, RATE) is None


def test_slow_noise_does_not_move_the_cut_off():
    walk = np.cumsum(white(302)) * 0.003
    found = find_low_pass(filtered(2, 20.0, 303) + walk, RATE)
    true = correlation_time(2, 20.0)
    assert found.cutoff == pytest.approx(20.0, rel=0.05)
    assert abs(found.correlation_time - true) < 4 * found.std + 0.03 * true


def test_a_periodic_component_does_not_move_the_cut_off():
    line = 0.5 * np.sin(2 * np.pi * 7.3 * np.arange(SAMPLES) / RATE)
    found = find_low_pass(filtered(2, 20.0, 304) + line, RATE)
    true = correlation_time(2, 20.0)
    assert found.cutoff == pytest.approx(20.0, rel=0.05)
    assert abs(found.correlation_time - true) < 4 * found.std + 0.03 * true


def test_size_offset_and_rate():
    values = filtered(2, 20.0, 305)
    one, other = find_low_pass(values, RATE), find_low_pass(7e-6 * values + 12.0, 10 * RATE)
    assert other.cutoff == pytest.approx(10 * one.cutoff, rel=1e-6)
    assert other.correlation_time == pytest.approx(one.correlation_time / 10, rel=1e-3)
    assert other.std == pytest.approx(one.std / 10, rel=1e-2)


def test_none_where_the_record_is_too_short_to_average():
    # A shape must be e¹² likelier than none, which takes some thousand lines below the cut-off.
    assert find_low_pass(filtered(2, 20.0, 306, samples=500), RATE) is None
    assert find_low_pass(filtered(2, 20.0, 306, samples=12_000), RATE) is not None


@pytest.mark.parametrize("cutoff", [0.5, 2.0, 30.0])
def test_cut_offs_far_below_and_near_the_nyquist_frequency(cutoff):
    found = find_low_pass(filtered(2, cutoff, 309), RATE)
    # 3600 lines below 0.5 Hz tell the floor to 2.4 %, a cut-off to some 3 %.
    assert found.cutoff == pytest.approx(cutoff, rel=0.1 if cutoff < 1 else 0.05)


@pytest.mark.parametrize("seed", range(4))
def test_none_on_a_walk_or_flicker_without_a_floor(seed):
    # Their spectrum falls to half, too, and goes on falling as no low-pass of a floor does.
    assert find_low_pass(np.cumsum(white(310 + seed)), RATE) is None
    f = np.fft.rfftfreq(SAMPLES, 1 / RATE)
    lines = np.fft.rfft(white(320 + seed)) / np.sqrt(np.maximum(f, f[1]))
    assert find_low_pass(np.fft.irfft(lines), RATE) is None


@pytest.mark.parametrize(("order", "cutoff"), FILTERS)
def test_shape_of_a_butterworth(order, cutoff):
    found = find_low_pass(filtered(order, cutoff, seed=330 + order), RATE)
    f = np.linspace(0, 0.8 * cutoff, 50)  # what the noise fit uses
    sos = signal.butter(order, cutoff, fs=RATE, output="sos")
    true = np.abs(signal.freqz_sos(sos, worN=f, fs=RATE)[1]) ** 2
    # 58 000 lines and more below the cut-off tell the level to 0.6 %; a shape that saves coefficients errs
    # by some times that, and the noise fit estimates its error along with the terms.
    assert np.abs(found.power(f) / true - 1).max() < 0.05


def test_quantised_rate_is_no_low_pass():
    # Its spectrum rises towards the Nyquist frequency.
    angle = white(307, SAMPLES + 1)
    values = np.diff(angle) * RATE + white(308) * 10 * NoiseTerms(random_walk=1.0).random_walk
    assert find_low_pass(values, RATE) is None
