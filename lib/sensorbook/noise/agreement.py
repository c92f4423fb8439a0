"""Does an Allan curve agree with a model of it? The curve of a binned spectrum, and departures."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from sensorbook.noise.result import Misfit

# A departure is told where it is both significant and visible.
MISFIT_SIGMA, MISFIT_SIZE = 4.0, 0.05


def binned_variance(
    frequency: np.ndarray, width: np.ndarray, density: np.ndarray, clusters: np.ndarray, rate: float
) -> np.ndarray:
    """(T,) Allan variance of a two-sided density given in bins, by the sampled kernel of A 5.14.

    ``σ²(nδt) = 4 Σ S ⟨sin⁴ πfnδt⟩/(n sin πfδt)² Δf``, the mean over each bin exact: bins may be wider than a
    turn of the kernel.

    Parameters
    ----------
    frequency, width, density : (F,) centre and width in Hz, and two-sided density
    clusters : (T,) cluster sizes n, samples
    rate : Hz
    """
    tau = np.asarray(clusters)[:, None] / rate

    def integral(x):  # of sin⁴
        return 3 * x / 8 - np.sin(2 * x) / 4 + np.sin(4 * x) / 32

    low, high = (np.pi * (frequency + side * width / 2) * tau for side in (-1, 1))
    mean = (integral(high) - integral(low)) / (high - low)
    # Above sin⁴'s own smallness at low frequencies the difference of the integrals has no digits.
    small = high < 1e-2
    mean[small] = ((low + high)[small] / 2) ** 4
    below = (np.asarray(clusters)[:, None] * np.sin(np.pi * frequency / rate)) ** 2
    return 4 * np.sum(density * width * mean / below, axis=1)


def worst_departure(
    tau: np.ndarray,
    observed: np.ndarray,
    model: np.ndarray,
    share: np.ndarray,
    told: np.ndarray | None = None,
) -> tuple[Misfit | None, np.ndarray]:
    """The worst stretch in which a curve departs from its model, and |σ/model − 1| there, else zero.

    Parameters
    ----------
    tau : (T,) cluster times
    observed, model : (T,) Allan variances
    share : (T,) variance of the observed ones, relative to the model's square
    told : (T,) mask of departures known already
    """
    ratio = observed / model
    size = np.sqrt(ratio) - 1
    # Variances are χ², skewed where the degrees of freedom are few: Wilson and Hilferty's cube root.
    z = (np.cbrt(ratio) - (1 - share / 9)) / np.sqrt(share / 9)
    away = (np.abs(z) > MISFIT_SIGMA) & (np.abs(size) > MISFIT_SIZE)
    if told is not None and not told.all():
        away &= ~told
    if not away.any():
        return None, np.zeros(len(size))
    # What is added to the noise lifts the curve; the fit, drawn up by it, lies above the rest.
    lifted = away & (z > 0) if (away & (z > 0)).any() else away
    worst = int(np.argmax(np.where(lifted, np.abs(z), 0)))
    stretch = ndimage.label(lifted)[0]
    here = stretch == stretch[worst]
    found = Misfit(
        (float(tau[here][0]), float(tau[here][-1])), float(tau[worst]), float(size[worst])
    )
    return found, np.where(here, np.abs(size), 0.0)


def departures(
    tau: np.ndarray, band: np.ndarray, deviation: np.ndarray, model: np.ndarray
) -> tuple[Misfit, ...]:
    """Stretches of an octave or more over which a model lies three standard errors off a curve.

    Neighbouring cluster times err together, so that a right model leaves the 95 % band over an octave on
    one axis in twenty and more, this wider one on none of 240.

    Parameters
    ----------
    tau, deviation, model : (T,) cluster times, s, and Allan deviations measured and explained
    band : (T, 2) 95 % confidence limits of the measured one
    """
    wider = 3 / 1.96  # in logarithms, in which the band is all but normal
    low, high = (deviation * (limit / deviation) ** wider for limit in band.T)
    outside = (model < low) | (model > high)
    labels, count = ndimage.label(outside)
    found = []
    for k in range(1, count + 1):
        here = np.flatnonzero(labels == k)
        if tau[here[-1]] < 2 * tau[here[0]]:
            continue
        size = deviation[here] / model[here] - 1
        worst = int(np.argmax(np.abs(size)))
        ends = float(tau[here[0]]), float(tau[here[-1]])
        found.append(Misfit(ends, float(tau[here[worst]]), float(size[worst])))
    return tuple(found)
