"""Smooth curves through the Allan curve (A 5.33, 5.34, 7.3), compared.

Work A fits polynomials and a rational function to σ(τ), to find its slopes on them. Here these fits stand
beside fits of log σ(log τ), AAA, the spline of `slopes` and the sum of noise terms.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.polynomial import Chebyshev, chebyshev
from scipy import interpolate, optimize

from sensorbook.errors import Refusal
from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.estimate import confidence, usable
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise, GaussMarkov
from sensorbook.noise.slopes import smooth_curve

DEGREES = (5, 10, 20)  # work A's polynomials
RATIONAL = 7  # free coefficients of its rational function, 4 over 2
FINE = 2000  # cluster times at which a fit is looked at between the points
ITERATIONS = 20  # of Sanathanan and Koerner; they settle in about ten


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A smooth curve σ(τ).

    Attributes
    ----------
    name : of the method
    variables : what is fitted against what: "raw" σ against τ, "log" log σ against log τ, "variance" σ²
        against τ
    deviation : function of τ (s) that gives σ; not positive, or not finite, where the fit fails
    poles : cluster times inside the data where the fit goes to infinity, or so near to it that it
        spoils the curve between two points, s
    """

    name: str
    variables: str
    deviation: Callable[[np.ndarray], np.ndarray]
    poles: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        """As figures and tables call it."""
        return self.name + {"raw": ", σ in τ", "log": ", in logarithms"}.get(self.variables, "")

    def slope(self, tau: np.ndarray) -> np.ndarray:
        """d log σ / d log τ, by a central difference; NaN where σ is not positive."""
        step = 1e-4
        return np.diff([self._log(tau * np.exp(h)) for h in (-step, step)], axis=0)[0] / (2 * step)

    def residual(self, tau: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """log₁₀ of fit over curve, decades; NaN where the fit is not positive."""
        return (self._log(tau) - np.log(sigma)) / np.log(10)

    def _log(self, tau: np.ndarray) -> np.ndarray:
        sigma = self.deviation(tau)
        return np.log(np.where(sigma > 0, sigma, np.nan))


def fit_polynomial(
    tau: np.ndarray, sigma: np.ndarray, degree: int, logarithmic: bool = False
) -> CurveFit:
    """Least-squares polynomial (A 5.33) of σ in τ, or of log σ in log τ.

    Raises
    ------
    ValueError
        no more cluster times than coefficients
    """
    _enough(tau, degree + 1)
    x, y, back, variables = _variables(tau, sigma, logarithmic)
    with warnings.catch_warnings():
        # Raw τ crowds at one end: of twenty powers not all can be told apart, which is the lesson.
        warnings.simplefilter("ignore", np.exceptions.RankWarning)
        polynomial = Chebyshev.fit(x, y, degree)
    return CurveFit(f"polynomial, degree {degree}", variables, lambda t: back(polynomial, t))


def fit_rational(
    tau: np.ndarray,
    sigma: np.ndarray,
    numerator: int = 4,
    denominator: int = 2,
    logarithmic: bool = False,
) -> CurveFit:
    """Least-squares rational function P/Q (A 5.34) of σ in τ, or of log σ in log τ.

    Levy's linear problem P − yQ = 0, reweighted by 1/Q as Sanathanan and Koerner do (IEEE Trans. Autom.
    Control 8, 1963), then least squares of the true residual P/Q − y. P is linear at given Q and is
    solved for throughout, so that only Q is sought.

    Raises
    ------
    ValueError
        no more cluster times than coefficients
    """
    _enough(tau, numerator + denominator + 1)
    x, y, back, variables = _variables(tau, sigma, logarithmic)
    middle, half = (x[-1] + x[0]) / 2, (x[-1] - x[0]) / 2
    above = chebyshev.chebvander((x - middle) / half, numerator)
    below = chebyshev.chebvander((x - middle) / half, denominator)
    size = np.abs(y).max()
    y = y / size

    def solve(q):
        columns = above / (below @ q)[:, None]
        p = np.linalg.lstsq(columns, y, rcond=None)[0]
        return p, columns @ p - y

    q = np.eye(denominator + 1)[0]
    for _ in range(ITERATIONS):
        weight = 1 / (below @ q)
        basis = np.linalg.qr(above * weight[:, None])[0]
        rest = below * (y * weight)[:, None]
        q = np.linalg.svd(rest - basis @ (basis.T @ rest))[2][-1]
    q = optimize.least_squares(lambda q: solve(q)[1], q, xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    p = solve(q)[0] * size

    def ratio(x):
        u = (x - middle) / half
        return chebyshev.chebval(u, p) / chebyshev.chebval(u, q)

    poles = _inside(chebyshev.chebroots(q) * half + middle, tau, logarithmic)
    name = f"rational {numerator}/{denominator}"
    return CurveFit(name, variables, lambda t: back(ratio, t), poles)


def fit_aaa(tau: np.ndarray, sigma: np.ndarray, tolerance: float) -> CurveFit:
    """Rational function of log τ by the AAA algorithm (Nakatsukasa, Sète and Trefethen, 2018).

    It passes through a growing choice of the points until it is within `tolerance` (of log σ) of all.
    That suits exact functions; where the points scatter, it passes through chance as well.
    """
    x, y, back, variables = _variables(tau, sigma, True)
    with warnings.catch_warnings():
        # that the tolerance is not reached: the residual tells it
        warnings.simplefilter("ignore", RuntimeWarning)
        rational = interpolate.AAA(
            x, y, rtol=tolerance / np.abs(y).max(), max_terms=len(x) // 2, clean_up_tol=tolerance
        )
    poles = _inside(rational.poles(), tau, True)
    return CurveFit("AAA", variables, lambda t: back(rational, t), poles)


def fit_physical(squares: dict[str, float], process: GaussMarkov | None = None) -> CurveFit:
    """The sum of noise terms as a curve; `squares` are their squared coefficients (SI) by name."""

    def deviation(tau):
        variance = sum(v * TERMS[name].variance(tau) for name, v in squares.items())
        if process:
            variance = variance + process.allan_variance(tau)
        return np.sqrt(np.maximum(variance, 0.0))

    return CurveFit("sum of noise terms", "variance", deviation)


@dataclass(frozen=True, eq=False)
class Measured:
    """A fit and how well it does.

    Attributes
    ----------
    rms, largest : residual at the cluster times where the fit is positive, decades
    not_positive : share of the range of log τ in which it is not
    held_out : rms on every other cluster time of the fit to those between, decades; None where that
        fit is somewhere not positive
    slope_error : rms difference of the slope from the reference, where the fit is positive; None for
        the reference itself
    """

    fit: CurveFit
    rms: float
    largest: float
    not_positive: float
    held_out: float | None
    slope_error: float | None

    @property
    def sound(self) -> bool:
        """Whether it has no pole among the data and is positive everywhere."""
        return not self.fit.poles and not self.not_positive


@dataclass(frozen=True, eq=False)
class Comparison:
    """All fits of one axis's curve.

    Attributes
    ----------
    axis : x, y or z
    tau, sigma : (T,) the curve outside the low-pass's reach, s and SI
    band : (T, 2) its 95 % confidence limits
    rows : fits with their measures
    reference : what the slope errors refer to, "truth" or "fitted terms"
    """

    axis: str
    tau: np.ndarray
    sigma: np.ndarray
    band: np.ndarray
    rows: tuple[Measured, ...]
    reference: str

    def row(self, name: str, variables: str) -> Measured | None:
        """The row of this name, None where the curve has too few points for it."""
        found = [r for r in self.rows if (r.fit.name, r.fit.variables) == (name, variables)]
        return found[0] if found else None

    def table(self) -> pd.DataFrame:
        """One row a fit, as text."""
        rows = {
            r.fit.label: {
                "residual, rms [decades]": f"{r.rms:.2g}",
                "largest": f"{r.largest:.2g}",
                "held out": _shown(r.held_out),
                "slope error": _shown(r.slope_error),
                "poles inside at τ [s]": ", ".join(f"{p:.3g}" for p in r.fit.poles) or "none",
                "σ ≤ 0 [% of log τ]": f"{100 * r.not_positive:.2g}" if r.not_positive else "none",
            }
            for r in self.rows
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def to_results(self) -> list[dict]:
        """As results.json states it."""
        return [
            {
                "name": r.fit.name,
                "variables": r.fit.variables,
                "residual_rms_decades": r.rms,
                "residual_largest_decades": r.largest,
                "held_out_rms_decades": r.held_out,
                "slope_error": r.slope_error,
                "poles": list(r.fit.poles),
                "not_positive": r.not_positive,
            }
            for r in self.rows
        ]

    def _repr_html_(self) -> str:
        return self.table().to_html()


def compare_fits(
    curve: AllanCurve,
    axis: str,
    noise: AxisNoise,
    low_pass: LowPass | None = None,
    truth: dict[str, float | None] | None = None,
) -> Comparison:
    """Work A's fits, the same in logarithms, AAA, the spline and the sum of terms on one axis's curve.

    Cluster times within the low-pass's reach are left out for all of them. So are fits that have not
    more than two points for each coefficient: they would pass through the points and swing between.

    Parameters
    ----------
    noise : the axis's terms as the spectrum gives them, without a trace of the low-pass
    truth : SI coefficients by term of a simulated device, None for an absent one; the slopes are then
        compared with theirs (and the low-pass's trace), else with those of the fitted terms

    Raises
    ------
    Refusal
        not more than two cluster times for each coefficient of the rational function
    """
    i, used = "xyz".index(axis), np.flatnonzero(usable(curve, low_pass))
    if len(used) <= 2 * RATIONAL:
        raise Refusal(
            f"Axis {axis}: the Allan curve has {len(used)} cluster times outside the low-pass's reach; "
            f"curve fits need at least {2 * RATIONAL + 1}.",
            "Record a longer rest.",
        )
    tau, sigma = curve.tau, curve.deviation[:, i]
    _, band = confidence(sigma**2, 2 / noise.edf)
    width = np.log(band[:, 1] / band[:, 0]) / 2

    def of(method, *settings):
        return lambda points: method(tau[points], sigma[points], *settings)

    def smooth(points):
        spline = smooth_curve(curve, axis, noise, points)
        return CurveFit("smoothing spline", "log", spline.deviation)

    terms = fit_physical(_with_low_pass(noise.squares, low_pass), noise.gauss_markov)
    ways = []  # coefficients, and the fit to some points
    for log in (False, True):
        ways += [(degree + 1, of(fit_polynomial, degree, log)) for degree in DEGREES]
        ways += [(RATIONAL, of(fit_rational, 4, 2, log))]
    ways += [
        # What the curve scatters by: below that there is nothing to approximate.
        (4, lambda points: of(fit_aaa, float(np.median(width[points])))(points)),
        (4, smooth),
        (0, lambda _: terms),
    ]
    if truth is not None:
        true = fit_physical(_with_low_pass({n: v**2 for n, v in truth.items() if v}, low_pass))
    reference = (terms if truth is None else true).slope(tau[used])
    rows = [
        _measure(make, tau, sigma, used, reference)
        for coefficients, make in ways
        if len(used) > 2 * coefficients
    ]
    if truth is None:  # the terms' own slope is the reference
        rows[-1] = replace(rows[-1], slope_error=None)
    return Comparison(
        axis,
        tau[used],
        sigma[used],
        band[used],
        tuple(rows),
        "fitted terms" if truth is None else "truth",
    )


def _with_low_pass(squares: dict[str, float], low_pass: LowPass | None) -> dict[str, float]:
    """Squared coefficients with what the low-pass adds to σ²: −t_c N²/τ²."""
    if not low_pass:
        return squares
    trace = -low_pass.correlation_time * squares.get("random_walk", 0.0) / 3
    return squares | {"quantization": squares.get("quantization", 0.0) + trace}


def _measure(make, tau, sigma, used, reference) -> Measured:
    fit = make(used)
    residual = fit.residual(tau[used], sigma[used])
    fine = np.geomspace(*tau[used[[0, -1]]], FINE)
    left = used[1 : len(used) - 1 : 2]
    outside = make(used[::2]).residual(tau[left], sigma[left])
    return Measured(
        fit,
        _rms(residual),
        float(np.nanmax(np.abs(residual))),
        float(np.mean(~(fit.deviation(fine) > 0))),
        _rms(outside) if np.isfinite(outside).all() else None,
        _rms(fit.slope(tau[used]) - reference),
    )


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def _enough(tau: np.ndarray, coefficients: int) -> None:
    if len(tau) <= coefficients:
        raise ValueError(
            f"{coefficients} coefficients need more than {coefficients} cluster times; "
            f"the curve has {len(tau)}"
        )


def _variables(tau, sigma, logarithmic):
    """x, y, the way back from a function of x to σ(τ), and the variables' name."""
    if not logarithmic:
        return tau, sigma, lambda f, t: f(t), "raw"
    y = np.log(sigma)
    middle = y.mean()  # so that a fit is relative to the curve's own range, not to its unit

    def back(f, t):
        with np.errstate(over="ignore"):  # a fit may swing to e⁷⁰⁰ between two points
            return np.exp(f(np.log(t)) + middle)

    return np.log(tau), y - middle, back, "log"


def _inside(poles: np.ndarray, tau: np.ndarray, logarithmic: bool) -> tuple[float, ...]:
    """Cluster times of the poles among the data that lie nearer to the axis than the points to each other."""
    poles = np.asarray(poles, dtype=complex)
    u = poles if logarithmic else np.log(np.where(poles == 0, 1e-300, poles))
    x = np.log(tau)
    near = np.abs(u.imag) < np.median(np.diff(x)) / 2
    return tuple(
        sorted({float(np.exp(p)) for p in u.real[near & (u.real > x[0]) & (u.real < x[-1])]})
    )
