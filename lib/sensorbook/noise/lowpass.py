"""The low-pass that a rest has been through, found in its spectrum (A 5.12, A3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage, optimize

from sensorbook.noise.model import variance_from_spectrum

BIN_LINES = (
    400  # lines averaged into one point: their mean is normal to better than a tenth of its spread
)


LINE = 1.5  # times its neighbours' median; chance reaches 1.25


@dataclass(frozen=True)
class LowPass:
    """The low-pass a record has been through, as far as the Allan deviation feels it.

    Attributes
    ----------
    cutoff : frequency at which the white floor has fallen to half its power, Hz
    correlation_time : t_c of ``σ²(τ) = N²/τ · (1 − t_c/τ)``, valid for τ well above 1/cutoff, s
    std : its standard error, s
    """

    cutoff: float
    correlation_time: float
    std: float


def find_low_pass(values: np.ndarray, rate: float) -> LowPass | None:
    """The low-pass that shapes the white floor, None where the floor reaches the Nyquist frequency.

    The averaged periodogram is fitted with an all-pole shape (A 5.12)
    ``N²/(1 + a₁u + a₂u² + a₃u³ + a₄u⁴) + b/f``, u = (f/f_c)², whose half-power point is the cut-off and
    from which t_c follows by quadrature (A 5.14). Spectral lines are left out.

    Parameters
    ----------
    values : (N,) evenly sampled signal at rest
    rate : Hz

    The floor is first taken between 2 % and 10 % of the Nyquist frequency: a cut-off below that is
    not found.
    """
    power = np.abs(fft.rfft(values - np.mean(values))[1:]) ** 2 / (len(values) * rate)
    lines = min(BIN_LINES, len(power) // 64)
    if lines < 8:
        return None
    bins = len(power) // lines
    p = power[: bins * lines].reshape(bins, lines).mean(axis=1)
    f = (np.arange(bins) + 0.5) * lines * rate / len(values)
    nyquist = rate / 2
    floor = np.median(p[(f >= 0.02 * nyquist) & (f <= 0.1 * nyquist)])
    smooth = ndimage.median_filter(p, 9, mode="nearest")
    edge = f[np.flatnonzero(smooth > 0.5 * floor)[-1]]
    if edge > 0.9 * nyquist:
        return None
    # Further up a digital filter bends away from any all-pole shape, towards its zero at Nyquist.
    inside = (f > edge / 20) & (f < min(1.3 * edge, 0.98 * nyquist)) & (p < LINE * smooth)

    def floor_shape(a, at):
        u = (at / edge) ** 2
        return 1 / (1 + u * (a[0] + u * (a[1] + u * (a[2] + u * a[3]))))

    def residual(x):
        model = x[0] * floor * floor_shape(x[2:], f[inside]) + x[1] * floor * edge / f[inside]
        return (p[inside] / model - 1) * np.sqrt(lines)

    fit = optimize.least_squares(
        residual,
        [1.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        bounds=([0.1, 0, -1, -1, -1, -1], [10, 1, 10, 10, 10, 10]),
    )
    fine = np.linspace(0, 2 * edge, 2001)
    below = floor_shape(fit.x[2:], fine) < 0.5
    cutoff = fine[np.argmax(below)] if below.any() else edge
    tau = 40 / cutoff

    def correlation_time(a):
        shape = lambda at: floor_shape(a, np.minimum(at, nyquist))  # noqa: E731
        return tau * (1 - tau * variance_from_spectrum(shape, tau, 1 / rate, points=20_000))

    found = correlation_time(fit.x[2:])
    step = 1e-4
    slope = np.array([correlation_time(fit.x[2:] + step * e) - found for e in np.eye(4)]) / step
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[2:, 2:]
    return LowPass(float(cutoff), float(found), float(np.sqrt(slope @ covariance @ slope)))
