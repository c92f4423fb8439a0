"""Noise terms from an Allan curve: A's read-off and a weighted fit, both with 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg, optimize, stats

from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.covariance import variance_covariance
from sensorbook.noise.model import FLAT, TERMS
from sensorbook.noise.result import AxisNoise, Estimate, Misfit, NoiseEstimate
from sensorbook.noise.spectrum import LowPass

# A term is stated where its estimate exceeds this many standard errors of what chance shows without it.
# Of 40 000 simulated records without K (estimates are skewed) one in 1800 does; a device's report makes
# some 24 such decisions and shall rarely hold a false one.
PRESENT = 4.0
MISFIT_SIGMA, MISFIT_SIZE = (
    4.0,
    0.05,
)  # a departure is told where it is both significant and visible
# Neighbouring cluster times are so alike that their correlation, a quadrature, is close to singular:
# eigenvalues below this are raised to it. It costs efficiency, not validity: intervals are a sandwich.
SMALLEST = 0.02
FIT_REACH, READ_REACH = 2.0, 10.0  # shortest cluster time, in units of the low-pass's 1/f_c
NAMES = tuple(TERMS)


def usable(curve: AllanCurve, low_pass: LowPass | None, reach: float = FIT_REACH) -> np.ndarray:
    """(T,) mask of the cluster times above `reach` times the inverse of the low-pass's cut-off.

    At twice a low-pass of second order has forgotten the past to 1e-4 and acts on the curve through a
    term in 1/τ² alone, which the fit holds.
    """
    shortest = 0.0 if low_pass is None else reach / low_pass.cutoff
    mask = curve.tau >= shortest
    # Fewer than eight points (two octaves) cannot tell five terms apart.
    return mask if mask.sum() >= 8 else np.ones_like(mask)


def fit_terms(curve: AllanCurve, low_passes: Sequence[LowPass | None] = ()) -> NoiseEstimate:
    """Noise terms by a fit of ``σ²(τ) = 3Q²/τ² + N²/τ + 0.441B² + K²τ/3 + R²τ²/2``.

    Generalised least squares: the weights and the intervals use the full covariance between cluster
    times under the fitted terms (`covariance`). Terms are dropped one by one, the weakest first,
    until each of those left exceeds what chance shows without it (`PRESENT`); a dropped term is None
    with a 95 % upper bound. The term in 1/τ² may be negative: that is the trace of a low-pass,
    not of quantisation.

    Parameters
    ----------
    curve : overlapping Allan curve
    low_passes : one for each axis (`find_low_pass`), empty for none. Cluster times below twice the
        inverse of the cut-off are left out, and the low-pass's correlation time enters as a
        measurement with its standard error.
    """
    low_passes = low_passes or (None,) * curve.deviation.shape[1]
    axes = tuple(
        _fit_axis(curve, y**2, low_pass)
        for y, low_pass in zip(curve.deviation.T, low_passes, strict=True)
    )
    return NoiseEstimate("allan_fit", curve.sensor, axes)


class _Fit:
    """Generalised least squares of σ² on the columns of the chosen terms.

    With a low-pass a last row says that the coefficient of 1/τ² is −t_c N², to within t_c's error.
    """

    def __init__(self, curve: AllanCurve, observed: np.ndarray, low_pass: LowPass | None):
        self.curve, self.observed, self.low_pass = curve, observed, low_pass
        self.model_error = 0.0  # relative, of σ: what the terms miss beyond chance
        self.columns = {name: TERMS[name].variance(curve.tau) for name in NAMES}
        # A first weight that needs no model: edf falls as 1/τ.
        spread = observed * np.sqrt(curve.tau)
        if low_pass:
            row = {"quantization": 3.0, "random_walk": low_pass.correlation_time}
            self.columns = {n: np.append(c, row.get(n, 0.0)) for n, c in self.columns.items()}
            self.observed = np.append(observed, 0.0)
            self.floor = float(np.median(observed * curve.tau))
            spread = np.append(spread, self.floor * low_pass.std)
        self.whiten = np.diag(1 / spread)

    def covariance(self, squares: dict[str, float], model_error: bool = True) -> np.ndarray:
        c = self.curve
        result = variance_covariance(c.clusters, c.samples, c.rate, squares)
        if model_error:
            missed = 2 * self.model_error * self.observed[: len(result)]
            result[np.diag_indices_from(result)] += missed**2
        if self.low_pass:
            # Where N is absent its floor stands in: the row must not become exact.
            floor = squares.get("random_walk") or self.floor
            result = linalg.block_diag(result, (floor * self.low_pass.std) ** 2)
        return result

    def reweight(self, squares: dict[str, float]) -> None:
        c = self.covariance(squares)
        sd = np.sqrt(np.diag(c))
        values, vectors = np.linalg.eigh(c / np.outer(sd, sd))
        self.whiten = (vectors / np.sqrt(np.maximum(values, SMALLEST))).T / sd

    def _design(self, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        a = self.whiten @ np.stack([self.columns[n] for n in names], axis=1)
        norm = np.linalg.norm(a, axis=0)
        return a / norm, norm

    def solve(self, names: tuple[str, ...]) -> dict[str, float]:
        """Squared coefficients, non-negative except for 1/τ²."""
        a, norm = self._design(names)
        if "quantization" in names:
            a = np.column_stack([a, -a[:, names.index("quantization")]])
        x, _ = optimize.nnls(a, self.whiten @ self.observed, maxiter=200)
        if "quantization" in names:
            x[names.index("quantization")] -= x[-1]
        return {name: float(v) for name, v in zip(names, x[: len(names)] / norm, strict=True)}

    def gain(self, names: tuple[str, ...]) -> np.ndarray:
        """(P, T) matrix that takes σ² to unconstrained coefficients."""
        a, norm = self._design(names)
        return np.linalg.pinv(a) / norm[:, None] @ self.whiten


def _fit_axis(whole: AllanCurve, variance: np.ndarray, low_pass: LowPass | None) -> AxisNoise:
    mask = usable(whole, low_pass)
    curve = replace(whole, tau=whole.tau[mask], clusters=whole.clusters[mask])
    fit = _Fit(curve, variance[mask], low_pass)
    names, squares = _choose_terms(fit)
    misfit = _misfit(fit, names, squares)
    for _ in range(3 if misfit else 0):
        # What the terms miss is no noise of the curve: it enters as an error of the model, so that
        # the best-known cluster times do not decide alone and the intervals tell.
        fit.model_error = misfit.rms
        names, squares = _choose_terms(fit)
        misfit = _misfit(fit, names, squares) or misfit
    terms, bounds = {}, {}
    for name in NAMES:
        if name in names and squares[name] > 0:
            low, high = _interval(fit, names, squares, name)
            terms[name] = Estimate(*map(float, np.sqrt([squares[name], low, high])))
        else:
            terms[name] = None
            bounds[name] = float(np.sqrt(_bound(fit, names, squares, name)))
    edf, band = _confidence(whole, variance, squares, mask)
    used = (float(curve.tau[0]), float(curve.tau[-1]))
    return AxisNoise(terms, bounds, used, misfit, squares, edf, band)


def _choose_terms(fit: _Fit) -> tuple[tuple[str, ...], dict[str, float]]:
    """The terms that are visible and their squared coefficients, by backward elimination."""
    names = NAMES
    for _ in range(3):
        fit.reweight(fit.solve(names))
    while True:
        squares = fit.solve(names)
        for _ in range(2):
            fit.reweight(squares)
            squares = fit.solve(names)
        strength = _strengths(fit, names, squares)
        weakest = min(strength, key=strength.get)
        if strength[weakest] >= 1 or len(names) == 1:
            return names, squares
        names = tuple(n for n in names if n != weakest)


def _strengths(fit: _Fit, names, squares) -> dict[str, float]:
    """Each term's estimate over what chance gives without it, in units of the threshold."""
    gain = fit.gain(names)
    found = gain @ fit.observed
    result = {}
    for k, name in enumerate(names):
        without = {n: v for n, v in squares.items() if n != name}
        if not any(v > 0 for v in without.values()):
            result[name] = np.inf
            continue
        chance = np.sqrt(gain[k] @ fit.covariance(without) @ gain[k])
        size = abs(found[k]) if name == "quantization" else found[k]
        result[name] = size / chance / PRESENT
    return result


def _spread(fit: _Fit, names, squares, name):
    """Variance of a coefficient's estimate as a function (a, b, c) of its true value: a + bθ + cθ²."""
    gain = fit.gain(names)[names.index(name)]
    step = max(abs(squares.get(name, 0.0)), 1e-3 * float(np.max(np.abs(fit.observed * gain))))
    at = np.array([0.0, step, 2 * step])
    v = [gain @ fit.covariance({**squares, name: t}) @ gain for t in at]
    c = (v[2] - 2 * v[1] + v[0]) / (2 * step**2)
    b = (v[1] - v[0]) / step - c * step
    return np.array([v[0], b, c])


def _chance_below(observed: float, theta: float, spread: np.ndarray) -> float:
    """P(estimate ≤ observed) for a true value `theta`.

    The part of the spread that the term itself causes is that of a χ² (skewed); the part that the
    others cause is an average over many samples (normal). Pearson's type III joins the two.
    """
    a, b, c = spread
    v = a + b * theta + c * theta**2
    if v <= 0:  # nothing but the term itself varies, and it is zero
        return float(observed >= theta)
    skew = 2 * c**2 * theta**3 / v**1.5 if theta > 0 else 0.0
    return float(stats.pearson3.cdf((observed - theta) / np.sqrt(v), max(skew, 1e-6)))


def _limit(observed: float, spread: np.ndarray, chance: float) -> float:
    """True value θ ≥ 0 at which the chance of an estimate below the observed one equals `chance`."""
    if _chance_below(observed, 0.0, spread) <= chance:
        return 0.0
    top = max(observed, 0.0) + 4 * np.sqrt(spread[0])
    while _chance_below(observed, top, spread) > chance:
        top *= 2
        if top > 1e6 * (max(observed, 0.0) + np.sqrt(spread[0])):
            return top  # the record does not bound the term
    return optimize.brentq(
        lambda t: _chance_below(observed, t, spread) - chance, 0.0, top, xtol=1e-9 * top
    )


def _interval(fit, names, squares, name) -> tuple[float, float]:
    spread = _spread(fit, names, squares, name)
    return _limit(squares[name], spread, 0.975), _limit(squares[name], spread, 0.025)


def _bound(fit, names, squares, name) -> float:
    names = names if name in names else (*names, name)
    found = float(fit.gain(names)[names.index(name)] @ fit.observed)
    spread = _spread(fit, names, squares, name)
    return _limit(max(found, 0.0), spread, 0.05)


def _misfit(fit: _Fit, names, squares) -> Misfit | None:
    """Where the measured curve departs from the fitted terms."""
    columns = np.stack([fit.columns[n] for n in names], axis=1)
    model = columns @ [squares[n] for n in names]
    covariance = fit.covariance(squares, model_error=False)
    keep = np.eye(len(model)) - columns @ fit.gain(names)
    spread = np.sqrt(np.maximum(np.diag(keep @ covariance @ keep.T), 1e-6 * np.diag(covariance)))
    points = slice(len(fit.curve.tau))
    # A model that a negative 1/τ² drives to zero or below is a departure of its own.
    ratio = fit.observed[points] / np.maximum(model[points], 1e-3 * fit.observed[points])
    size = np.sqrt(ratio) - 1
    # Variances are χ², skewed where the degrees of freedom are few: Wilson and Hilferty's cube root.
    share = (spread[points] / np.maximum(model[points], 1e-3 * fit.observed[points])) ** 2 / 9
    z = (np.cbrt(ratio) - (1 - share)) / np.sqrt(share)
    away = (np.abs(z) > MISFIT_SIGMA) & (np.abs(size) > MISFIT_SIZE)
    if not away.any():
        return None
    tau = fit.curve.tau
    worst = np.flatnonzero(away)[np.argmax(np.abs(size[away]))]
    return Misfit(
        (float(tau[away][0]), float(tau[away][-1])),
        float(tau[worst]),
        float(size[worst]),
        float(np.sqrt(np.mean(size**2))),
    )


def _confidence(curve: AllanCurve, variance, squares, used) -> tuple[np.ndarray, np.ndarray]:
    """Equivalent degrees of freedom (T,) and 95 % limits (T, 2) of the whole curve."""
    covariance = variance_covariance(curve.clusters, curve.samples, curve.rate, squares)
    model = sum(v * TERMS[n].variance(curve.tau) for n, v in squares.items())
    # Within the low-pass's reach the terms say nothing: the measured variance stands in.
    edf = 2 * np.where(used & (model > 0), model, variance) ** 2 / np.diag(covariance)
    limits = [np.sqrt(variance * edf / stats.chi2.ppf(q, edf)) for q in (0.975, 0.025)]
    return edf, np.stack(limits, axis=1)


def local_slopes(curve: AllanCurve, reach: int = 2) -> np.ndarray:
    """(T, A) slope d log σ / d log τ, by a straight line over ±`reach` points."""
    x, y = np.log(curve.tau), np.log(curve.deviation)
    slopes = np.empty_like(y)
    for i in range(len(x)):
        s = slice(max(0, i - reach), i + reach + 1)
        centred = x[s] - x[s].mean()
        slopes[i] = centred @ y[s] / (centred @ centred)
    return slopes


def read_off(curve: AllanCurve, low_passes: Sequence[LowPass | None] = ()) -> NoiseEstimate:
    """Noise terms as work A reads them off the curve: the baseline the fit is compared with.

    A line of the term's slope is laid through the points whose local slope lies within 0.1 of it,
    weighted by their degrees of freedom, and read at the term's cluster time (N at 1 s, K at 3 s); B
    is the minimum over 0.664. Cluster times below ten times the inverse of the cut-off are masked
    (A3). Where terms
    overlap, each reading holds a share of its neighbours. Intervals hold the statistical error alone.
    """
    low_passes = low_passes or (None,) * curve.deviation.shape[1]
    axes = []
    columns = zip(curve.deviation.T, local_slopes(curve).T, low_passes, strict=True)
    for y, slope, low_pass in columns:
        mask = usable(curve, low_pass, READ_REACH)
        terms = {}
        lowest = int(np.argmin(np.where(mask, y, np.inf)))
        for name, term in TERMS.items():
            if term.read_at is None:
                inside = 0 < lowest < len(y) - 1
                points = np.array([lowest]) if inside else np.array([], dtype=int)
                level = y / np.sqrt(FLAT)
            else:
                side = np.arange(len(y)) < lowest if term.slope < 0 else np.arange(len(y)) > lowest
                points = np.flatnonzero(mask & side & (np.abs(slope - term.slope) < 0.1))
                level = y * (curve.tau / term.read_at) ** -term.slope
            enough = len(points) >= (1 if term.read_at is None else 3)
            terms[name] = _read(curve, y, level, points) if enough else None
        axes.append(AxisNoise(terms, {}, (float(curve.tau[mask][0]), float(curve.tau[-1])), None))
    return NoiseEstimate("read_off", curve.sensor, tuple(axes))


def _read(curve: AllanCurve, y, level, points) -> Estimate:
    tau = curve.tau[points]
    weight = (1 / tau) / np.sum(1 / tau)  # degrees of freedom fall as 1/τ
    # The covariance needs a noise type: the curve's own value as white noise at each cluster time.
    squares = {"random_walk": float(np.median(y[points] ** 2 * tau))}
    c = variance_covariance(curve.clusters[points], curve.samples, curve.rate, squares)
    s2 = squares["random_walk"] / tau
    spread = np.sqrt(weight @ (c / np.outer(s2, s2)) @ weight / 4)
    value = float(np.exp(weight @ np.log(level[points])))
    return Estimate(value, value * np.exp(-1.96 * spread), value * np.exp(1.96 * spread))
