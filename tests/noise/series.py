"""Simulated rests, sample by sample: a second generator beside the spectral one of the library."""

import numpy as np
from scipy import signal


def in_time(samples, rate, rng, *, n=0.0, b=0.0, k=0.0, q=0.0, ramp=0.0):
    """(samples,) white noise, flicker by h_k = h_{k−1}(k − ½)/k, a cumulated walk, differences and a ramp."""
    values = n * np.sqrt(rate) * rng.standard_normal(samples)
    if b:
        # Four times as long, as flicker noise has no beginning.
        step = np.arange(1, 4 * samples)
        h = np.concatenate([[1.0], np.cumprod((step - 0.5) / step)])
        values += signal.fftconvolve(b * rng.standard_normal(len(h)), h)[len(h) - samples : len(h)]
    values += np.cumsum(k / np.sqrt(rate) * rng.standard_normal(samples))
    values += rate * np.diff(q * rng.standard_normal(samples + 1))
    return values + ramp * np.arange(samples) / rate


def gauss_markov(samples, rate, rng, seconds, std):
    """(samples,) first-order process that is stationary from its first sample on."""
    a = np.exp(-1 / (rate * seconds))
    steps = std * np.sqrt(1 - a**2) * rng.standard_normal(samples)
    steps[0] = std * rng.standard_normal()
    return signal.lfilter([1.0], [1.0, -a], steps)


def low_passed(values, order, cutoff, rate):
    """White noise through a digital Butterworth, less the 2000 samples in which this settles."""
    return signal.sosfilt(signal.butter(order, cutoff, fs=rate, output="sos"), values)[2000:]
