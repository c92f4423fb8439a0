"""Noise terms: their Allan variance, their two-sided spectrum and the relation of the two (A 5.14–5.32).

Every coefficient is defined by the two-sided spectrum S, as in IEEE Std 952-1997.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

FLAT = (
    2 * np.log(2) / np.pi
)  # σ²/B² on the flat of the bias instability; its root is the 0.664 of A 5.26


@dataclass(frozen=True)
class Term:
    """One noise term.

    Attributes
    ----------
    name, symbol : as results and figures call it
    variance : Allan variance at tau (s) of a unit coefficient
    slope : of log σ against log τ
    read_at : cluster time at which σ equals the coefficient, s (None: on the flat, over 0.664)
    """

    name: str
    symbol: str
    variance: Callable[[np.ndarray], np.ndarray]
    slope: float
    read_at: float | None


TERMS = {
    term.name: term
    for term in (
        Term("quantization", "Q", lambda tau: 3 / tau**2, -1, np.sqrt(3)),
        Term("random_walk", "N", lambda tau: 1 / tau, -0.5, 1.0),
        Term("bias_instability", "B", lambda tau: FLAT * np.ones_like(tau), 0, None),
        Term("rate_random_walk", "K", lambda tau: tau / 3, 0.5, 3.0),
        Term("rate_ramp", "R", lambda tau: tau**2 / 2, 1, np.sqrt(2)),
    )
}


@dataclass(frozen=True)
class NoiseTerms:
    """Coefficients of the five terms, SI; zero where a term is absent."""

    quantization: float = 0.0
    random_walk: float = 0.0
    bias_instability: float = 0.0
    rate_random_walk: float = 0.0
    rate_ramp: float = 0.0

    def allan_variance(self, tau: np.ndarray) -> np.ndarray:
        """σ²(τ), the sum of the terms (table A6); `tau` in s, any shape."""
        tau = np.asarray(tau, dtype=float)
        return sum(getattr(self, name) ** 2 * term.variance(tau) for name, term in TERMS.items())

    def integral_growth(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """What each term adds to the signal's integral after `time` (s) from a zero bias.

        Standard deviations: white noise grows as N√t, the random walk as K√(t³/3) (both exact). Flicker
        noise has no such law; 0.664 B t, a bias of the size of the flat, stands for it. The rate ramp is
        no scatter: it adds R t²/2.
        """
        t = np.asarray(time, dtype=float)
        return {
            "random_walk": self.random_walk * np.sqrt(t),
            "bias_instability": np.sqrt(FLAT) * self.bias_instability * t,
            "rate_random_walk": self.rate_random_walk * np.sqrt(t**3 / 3),
            "rate_ramp": self.rate_ramp * t**2 / 2,
        }

    def spectrum(self, f: np.ndarray, sample_time: float) -> np.ndarray:
        """Two-sided power spectral density S(f) of the random terms; `f` in Hz, 0 < f < 1/2δt.

        The rate ramp is deterministic and has no density.
        """
        f = np.asarray(f, dtype=float)
        w = 2 * np.pi * f
        exact = 4 / sample_time * np.sin(np.pi * f * sample_time) ** 2
        return (
            self.quantization**2 * exact
            + self.random_walk**2
            + self.bias_instability**2 / w
            + self.rate_random_walk**2 / w**2
        )


def variance_from_spectrum(
    spectrum: Callable[[np.ndarray], np.ndarray],
    tau: float,
    sample_time: float | None = None,
    points: int = 200_000,
) -> float:
    """Allan variance by quadrature of the two-sided spectrum (A 5.14).

    Continuous time ``σ² = 4∫S sin⁴(πfτ)/(πfτ)² df``; with `sample_time` the exact sampled pair, whose
    kernel has ``n sin(πfδt)`` for ``πfτ`` and which ends at the Nyquist frequency.
    """
    # Logarithmic below 1/τ, where the kernel is smooth, and linear above, where it oscillates.
    top = 1 / (2 * sample_time) if sample_time else 2000 / tau
    low = np.geomspace(1e-7 / tau, min(0.1 / tau, top), 2000)
    f = np.concatenate([low, np.linspace(low[-1], top, points)[1:]])
    s2 = np.sin(np.pi * f * tau) ** 2
    if sample_time:
        below = (tau / sample_time * np.sin(np.pi * f * sample_time)) ** 2
    else:
        below = (np.pi * f * tau) ** 2
    return float(4 * np.trapezoid(spectrum(f) * s2 * s2 / below, f))
