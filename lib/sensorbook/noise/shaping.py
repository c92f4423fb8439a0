"""Shaping filter: the filter that makes noise of a measured density out of white noise (A 5.12)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, signal

POLES_PER_DECADE = 6  # follows any one first-order process to 3 %; the fit keeps few of them
ROUNDS = 50  # of reweighting; a dozen do
FAR = 3.0  # standard errors, beyond which a point counts ever less: spectral lines are no part of the noise
LEAST_PART = 1e-6  # of the density: a term that nowhere reaches it is no term


@dataclass(frozen=True, eq=False)
class ShapingFilter:
    """A minimum-phase filter and the white noise that drives it.

    ``y_k = H(z) w_k`` with ``H = Π (1 − b_i/z)/(1 − a_i/z)``: the driving noise w is the part of the
    signal that its past does not predict, of variance `std`² a sample.

    Attributes
    ----------
    poles, zeros : (M,) and (≤ M,) of H, real, in 0 ≤ … < 1
    std : of the driving white noise per sample, unit of the signal
    rate : sampling rate, Hz
    scatter : of the measured density about the filter's, in standard errors, from the median so that
        single spectral lines do not tell; about 1 where the filter follows the density
    """

    poles: np.ndarray
    zeros: np.ndarray
    std: float
    rate: float
    scatter: float

    @property
    def time_constants(self) -> np.ndarray:
        """(M,) of the poles, s; `poles` = exp(−1/(rate · time constant))."""
        return -1 / (self.rate * np.log(self.poles))

    @property
    def sections(self) -> np.ndarray:
        """(M, 6) first-order sections for `scipy.signal.sosfilt`.

        Pairs of poles near 1 in one section of second order would lose their digits.
        """
        rows = np.zeros((max(len(self.poles), 1), 6))
        rows[:, [0, 3]] = 1
        rows[: len(self.zeros), 1] = -self.zeros
        rows[: len(self.poles), 4] = -self.poles
        return rows

    def density(self, frequency: np.ndarray) -> np.ndarray:
        """Two-sided density of the filter's output, H S_in H* with S_in = std²/rate; 0 < f ≤ rate/2."""
        u = 4 * np.sin(np.pi * np.asarray(frequency, dtype=float)[..., None] / self.rate) ** 2

        def squared(roots):  # |1 − r e^{−iωδt}|², written so that roots near 1 keep their digits
            return np.prod((1 - roots) ** 2 + roots * u, axis=-1)

        return self.std**2 / self.rate * squared(self.zeros) / squared(self.poles)

    def simulate(self, samples: int, rng: np.random.Generator) -> np.ndarray:
        """(samples,) noise of this density, stationary from its first sample on."""
        sections = self.sections
        # States of the cascade in scipy's form: y = x + s, s' = b x − a y.
        count = len(sections)
        transition, drive, passed = np.zeros((count, count)), np.zeros(count), np.zeros(count)
        for i, (b, a) in enumerate(sections[:, [1, 4]]):
            transition[i] = (b - a) * passed  # `passed`: how the states so far make up the input
            transition[i, i] = -a
            drive[i] = b - a
            passed[i] = 1
        covariance = linalg.solve_discrete_lyapunov(
            transition, self.std**2 * np.outer(drive, drive), method="direct"
        )
        variances, directions = linalg.eigh(covariance)
        start = directions @ (np.sqrt(variances.clip(0)) * rng.standard_normal(count))
        states = np.column_stack([start, np.zeros(count)])
        white = self.std * rng.standard_normal(samples)
        return signal.sosfilt(sections, white, zi=states)[0]


def shaping_filter(
    frequency: np.ndarray, density: np.ndarray, rate: float, dof: np.ndarray | float = 2.0
) -> ShapingFilter:
    """Filter whose output has a measured density, ``S_out = H S_in Hᵀ*`` with white S_in (A 5.12).

    The density is fitted with ``n² + Σ g_i² ω_i²/(u + ω_i²)``, poles ω_i six a decade, all parts
    positive, and ``u = (2 rate sin(πf/rate))²``: ω² as a sampled signal knows it, so that the digital
    filter has this density exactly and needs no further transform. One filter of that density follows by
    spectral factorisation. It is the noise model that a Kalman filter carries as additional states. It
    holds what falls with frequency, no faster than 1/f²: neither a low-pass of higher order nor lines.

    Parameters
    ----------
    frequency : (F,) Hz, 0 < f ≤ rate/2
    density : (F,) two-sided, (unit of the signal)²/Hz
    rate : of the filter, Hz
    dof : (F,) degrees of freedom of each point, by which it counts

    Raises
    ------
    ValueError
        a frequency outside 0 … rate/2 or a density that is not positive
    """
    f, s = np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)
    if not ((f > 0) & (f <= rate / 2 * (1 + 1e-12))).all():
        raise ValueError(f"frequencies must lie above 0 and up to {rate / 2:g} Hz, half the rate")
    if not (s > 0).all():
        raise ValueError("a density must be positive at every frequency")
    # In units of the sampling interval from here on; one pole is slow enough for slope −2 throughout.
    u = 4 * np.sin(np.pi * f / rate) ** 2
    lowest, highest = np.sqrt(u.min()) / 10, np.sqrt(u.max())
    corners = np.geomspace(
        lowest, highest, 1 + int(np.ceil(POLES_PER_DECADE * np.log10(highest / lowest)))
    )
    parts = np.column_stack([np.ones_like(u), corners**2 / (u[:, None] + corners**2)])
    certainty = np.sqrt(np.broadcast_to(dof, f.shape) / 2)
    model, weight = s, certainty
    for _ in range(ROUNDS):
        # Weights from the model, not from the scattered data: low points must not count for more.
        scaled = parts * (weight / model)[:, None]
        size = np.linalg.norm(scaled, axis=0)
        gains = optimize.nnls(scaled / size, s * weight / model)[0] / size
        before, model = model, parts @ gains
        departure = np.abs(certainty * (s / model - 1))
        weight = certainty * FAR / np.maximum(departure, FAR)
        if np.abs(model / before - 1).max() < 1e-6:
            break
    gains[(parts * gains / model[:, None]).max(axis=0) < LEAST_PART] = 0
    scatter = float(np.median(departure) / 0.6745)
    poles, zeros, leading = _factorise(gains[0], gains[1:], corners)
    return ShapingFilter(poles, zeros, float(np.sqrt(leading * rate)), rate, scatter)


def _factorise(white: float, gains: np.ndarray, corners: np.ndarray):
    """Poles and zeros in z of ``white + Σ g p/(u + p)``, p = corner², and the density driving them.

    With positive parts the sum falls through zero once between any two of its poles −p, and once beyond
    the last where `white` is not zero: each zero is bracketed, however many decades they span.
    """
    p = corners[gains > 0] ** 2
    residues = gains[gains > 0] * p

    def multiplied_out(log_z):  # by all the poles, so that it is finite at the ends of the brackets
        gaps = 1 - np.exp(log_z) / p
        others = np.prod(np.where(np.eye(len(p)), 1.0, gaps), axis=1)
        return white * np.prod(gaps) + residues / p @ others

    edges = np.log(p)
    if white > 0 and len(p):
        edges = np.append(edges, np.log(p[-1] + 2 * residues.sum() / white))
    z = np.exp(
        [optimize.brentq(multiplied_out, a, b, xtol=1e-14) for a, b in itertools.pairwise(edges)]
    )
    poles, zeros = _inside(p), _inside(z)
    leading = white if white > 0 else residues.sum()
    return poles, zeros, leading * np.exp(np.log(poles).sum() - np.log(zeros).sum())


def _inside(square: np.ndarray) -> np.ndarray:
    """r < 1 with ``u + square = |1 − r e^{−iωδt}|²/r``."""
    return 1 / (1 + square / 2 + np.sqrt(square + square**2 / 4))
