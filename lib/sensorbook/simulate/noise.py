"""Noise with a prescribed spectrum, by spectral synthesis: independent of every estimator here.

Gaussian spectral lines are drawn with the two-sided density
``S(f) = N² + B²/(2πf) + K²/(2πf)²`` (IEEE Std 952-1997) and transformed to time. The series is eight
times as long as what is kept, so that it holds components far slower than the record. Its periodicity
shows in the slowest: the change of a rate random walk over a time t of many samples, of a record of
length T, scatters by K √(t (1 − t/(8T))), which is √(7/8), 6.5 % too small, from end to end and 0.6 % over
a tenth of it.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

LENGTHENING = 8


def coloured_noise(
    samples: int,
    rate: float,
    rng: np.random.Generator,
    *,
    random_walk: float,
    bias_instability: float = 0.0,
    rate_random_walk: float = 0.0,
    bandwidth: float | None = None,
) -> np.ndarray:
    """(samples,) noise with coefficients N, B, K (SI, two-sided), zero at its start.

    `bandwidth` (Hz) passes it through a second-order Butterworth low-pass, |H|² = 1/(1+(f/f_c)⁴).
    """
    n = fft.next_fast_len(LENGTHENING * samples, real=True)
    f = fft.rfftfreq(n, 1 / rate)
    w = 2 * np.pi * f[1:]
    density = np.zeros_like(f)
    density[1:] = random_walk**2 + bias_instability**2 / w + rate_random_walk**2 / w**2
    if bandwidth:
        density /= 1 + (f / bandwidth) ** 4
    lines = rng.standard_normal(2 * len(f)).view(complex)
    # E|X|² = S·n/δt for the unnormalised transform; real and imaginary parts share it.
    series = fft.irfft(lines * np.sqrt(density * n * rate / 2), n)[:samples]
    if rate_random_walk:
        series -= series[0]  # a random walk has no mean of its own: begin at zero
    return series
