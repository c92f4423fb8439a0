"""The low-pass that a rest has been through, found in its spectrum (A 5.12, A3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import ndimage, optimize

from sensorbook.noise.cosine import CosineSpectrum, cosine_spectrum
from sensorbook.noise.disturbances import find_bands
from sensorbook.noise.model import variance_from_spectrum

SMOOTH = 15  # bins of a hundredth of their frequency: the floor is looked for over some 15 %
FEWEST = 4  # lines in a bin whose mean tells where the floor ends
LINE = 1.5  # times its neighbours' median is a periodic component
EXPONENTS = (1, 2, 3, 4, 6, 8)  # of u in the shape; steep filters need the high ones
# Coefficients that the noise fit frees in any case: what is too small to earn its keep here still bends
# the floor. Without them the intervals of N held the truth in 58 to 88 % behind averages and RC filters.
ALWAYS = {1: 0.0, 2: 0.0}
COEFFICIENT = 8.0  # deviance that a further coefficient of the shape must save
FALLS = 0.9  # of the floor's power is left at its edge, or less
CLAIM = 25.0  # deviance that a low-pass must save against none: e¹² in likelihood


@dataclass(frozen=True)
class LowPass:
    """The low-pass a record has been through: ``|H(f)|² = 1/(1 + Σ a uᵏ)``, u = (f/scale)².

    Attributes
    ----------
    cutoff : frequency at which the white floor has fallen to half its power, at most the Nyquist
        frequency, Hz
    correlation_time : t_c of ``σ²(τ) = N²/τ · (1 − t_c/τ)``, valid for τ well above 1/cutoff, s
    std : its standard error, s
    scale : of u, Hz
    coefficients : a by exponent k, those that the spectrum asks for
    """

    cutoff: float
    correlation_time: float
    std: float
    scale: float
    coefficients: dict[int, float]

    def power(self, f: np.ndarray) -> np.ndarray:
        """|H(f)|²; `f` in Hz, up to the cut-off and a little beyond."""
        return _shape(self.coefficients, self.coefficients.values(), f, self.scale)

    def derivatives(self, f: np.ndarray) -> np.ndarray:
        """(F, k) derivatives of |H|² by the coefficients."""
        u, power = (np.asarray(f) / self.scale) ** 2, self.power(f)
        return np.stack([-(power**2) * u**k for k in self.coefficients], axis=-1)

    def shifted(self, change: np.ndarray) -> LowPass:
        """The same with coefficients changed by so much; cut-off and t_c stay those of the first look."""
        shape = {
            k: a + float(d) for (k, a), d in zip(self.coefficients.items(), change, strict=True)
        }
        return replace(self, coefficients=shape)


def find_low_pass(values: np.ndarray, rate: float) -> LowPass | None:
    """The low-pass that shapes the white floor, None where the floor is level up to the Nyquist frequency.

    Periodic components are left out.

    Parameters
    ----------
    values : (N,) evenly sampled signal at rest
    rate : Hz
    """
    spectrum = cosine_spectrum(values, rate)
    return low_pass_of(spectrum, 0, ~find_bands(spectrum, 0)[0])


def low_pass_of(spectrum: CosineSpectrum, axis: int, used: np.ndarray) -> LowPass | None:
    """See `find_low_pass`; `used` (F,) leaves bins with periodic components out.

    The spectrum up to a little beyond its edge is fitted by maximum likelihood with
    ``N²|H|² + b/f + k/f²`` for every choice of the shape's coefficients; each of these must earn its
    keep. t_c follows by quadrature (A 5.14).
    """
    nyquist = spectrum.rate / 2
    used = used & (spectrum.lines >= FEWEST) & (spectrum.frequency < 0.98 * nyquist)
    f, p, lines = spectrum.frequency[used], spectrum.density[used, axis], spectrum.lines[used]
    if len(f) < 4 * SMOOTH:
        return None
    smooth = np.exp(ndimage.median_filter(np.log(p), SMOOTH, mode="nearest"))
    edge = _edge(f, smooth, nyquist)
    if edge is None:
        return None
    # Further up a digital filter bends away from any all-pole shape, towards its zero at Nyquist.
    inside = (f > edge / 30) & (f < 1.3 * edge) & (p < LINE * smooth)
    f, p, lines = f[inside], p[inside], lines[inside]
    floor = float(np.median(smooth[inside][: len(f) // 2]))
    _, none = _fit(f, p, lines, floor, edge, ())
    choices = [c for count in (1, 2) for c in combinations(EXPONENTS, count)]
    fits = {c: _fit(f, p, lines, floor, edge, c) for c in choices}
    chosen = min(fits, key=lambda c: fits[c][1] + COEFFICIENT * len(c))
    fit, deviance = fits[chosen]
    if none - deviance < CLAIM or _shape(chosen, fit.x[3:], edge, edge) > FALLS:
        return None

    found = fit.x[3:]
    fine = np.linspace(0, min(2 * edge, nyquist), 2001)
    below = _shape(chosen, found, fine, edge) < 0.5
    cutoff = float(fine[np.argmax(below)] if below.any() else edge)
    tau = 40 / cutoff

    def correlation_time(a):
        shape = lambda at: _shape(chosen, a, np.minimum(at, nyquist), edge)  # noqa: E731
        return tau * (
            1 - tau * variance_from_spectrum(shape, tau, 1 / spectrum.rate, points=20_000)
        )

    t_c, step = correlation_time(found), 1e-4
    slope = [(correlation_time(found + step * e) - t_c) / step for e in np.eye(len(found))]
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[3:, 3:]
    std = float(np.sqrt(np.array(slope) @ covariance @ slope))
    shape = ALWAYS | dict(zip(chosen, map(float, found), strict=True))
    return LowPass(cutoff, float(t_c), std, edge, shape)


def _edge(f: np.ndarray, smooth: np.ndarray, nyquist: float) -> float | None:
    """Where the floor has fallen to half, at most `nyquist`; None where there are too few bins below.

    The floor is looked for below the edge.
    """
    low, high, edge = 0.02 * nyquist, 0.1 * nyquist, None
    for _ in range(8):
        level = smooth[(f >= low) & (f <= high)]
        if len(level) < 5:
            return None
        found = float(f[np.flatnonzero(smooth > 0.5 * np.median(level))[-1]])
        if found > 0.9 * nyquist:
            return nyquist
        if found == edge:
            break
        edge = found
        low, high = edge / 10, edge / 3
    return edge


def _shape(exponents, coefficients, f, scale: float) -> np.ndarray:
    u = (np.asarray(f) / scale) ** 2
    return 1 / (1 + sum(a * u**k for k, a in zip(exponents, coefficients, strict=True)))


def _fit(f, p, lines, floor: float, edge: float, chosen: tuple[int, ...]):
    """Maximum likelihood: its squared residuals add up to the deviance."""
    u = (f / edge) ** 2
    powers = np.stack([u**k for k in chosen]) if chosen else np.zeros((1, len(f)))

    measured, slopes = p / floor, np.stack([edge / f, 1 / u])

    def model(x):
        gain = 1 / np.maximum(1 + x[3:] @ powers if chosen else np.ones_like(f), 1e-3)
        return gain, x[0] * gain + x[1:3] @ slopes

    def residual(x):
        ratio = measured / model(x)[1]
        return np.sign(ratio - 1) * np.sqrt(lines * np.maximum(ratio - 1 - np.log(ratio), 0))

    def jacobian(x):
        gain, total = model(x)
        above, r = measured / total - 1, np.abs(residual(x))
        near = np.abs(above) < 1e-5  # r is √(ν/2) of it there, and both are small
        factor = np.where(
            near, np.sqrt(lines / 2), lines * np.abs(above) / np.where(near, 2, 2 * r)
        )
        bent = np.where(gain < 1e3, -x[0] * gain**2, 0) * powers[: len(chosen)]
        return -(factor / total * np.vstack([gain, slopes, bent])).T

    first = np.zeros(len(chosen))
    first[-1:] = 1.0
    fit = optimize.least_squares(
        residual,
        [1.0, 1e-6, 1e-9, *first],
        jacobian,
        bounds=([0.05, 0, 0, *[-1] * len(chosen)], [20, 10, 1, *[10] * len(chosen)]),
        x_scale=[1, 0.01, 1e-3, *[0.1] * len(chosen)],
    )
    return fit, 2 * fit.cost
