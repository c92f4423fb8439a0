"""Noise terms from an Allan curve by a weighted fit, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import linalg, optimize, stats

from sensorbook.estimate import Estimate
from sensorbook.noise.agreement import MISFIT_SIZE, worst_departure
from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.covariance import variance_covariance
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise, Misfit, NoiseEstimate

# A term is stated where its estimate exceeds this many standard errors of what chance shows without it.
# Estimates at long cluster times are skewed: of 4900 simulated records without K, 21 state it; ramps and
# quantisation none.
PRESENT = 4.0
STRETCHES = 4  # of departures that are kept from the terms
# Neighbouring cluster times are so alike that their correlation, a quadrature, is close to singular:
# eigenvalues below this are raised to it. It costs efficiency, not validity: intervals are a sandwich.
SMALLEST = 0.02
LEAST_ERROR = 1e-4  # relative, of σ
FIT_REACH = 2.0  # shortest cluster time, in units of the low-pass's 1/f_c
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

    def __init__(self, curve: AllanCurve, variance: np.ndarray, low_pass: LowPass | None):
        self.curve, self.low_pass = curve, low_pass
        self.used = np.flatnonzero(usable(curve, low_pass))
        self.tau, observed = curve.tau[self.used], variance[self.used]
        self.observed = observed
        self.missed = np.zeros(len(observed))  # relative, of σ: what the terms miss beyond chance
        self.columns = {name: TERMS[name].variance(self.tau) for name in NAMES}
        # A first weight that needs no model: edf falls as 1/τ.
        spread = observed * np.sqrt(self.tau)
        if low_pass:
            row = {"quantization": 3.0, "random_walk": low_pass.correlation_time}
            self.columns = {n: np.append(c, row.get(n, 0.0)) for n, c in self.columns.items()}
            self.observed = np.append(observed, 0.0)
            self.floor = float(np.median(observed * self.tau))
            spread = np.append(spread, self.floor * low_pass.std)
        self.whiten = np.diag(1 / spread)

    def covariance(self, squares: dict[str, float], missed: bool = True) -> np.ndarray:
        c = self.curve
        result = variance_covariance(c.clusters, c.samples, c.rate, squares)
        result = result[np.ix_(self.used, self.used)]
        # Without random terms there is no spread at all: no formula is better than LEAST_ERROR.
        error = 2 * np.maximum(self.missed if missed else 0.0, LEAST_ERROR)
        result[np.diag_indices_from(result)] += (error * self.observed[: len(result)]) ** 2
        if self.low_pass:
            # Where N is absent its floor stands in: the row must not become exact.
            floor = squares.get("random_walk") or self.floor
            result = linalg.block_diag(result, (floor * self.low_pass.std) ** 2)
        return result

    def spread(self, gain: np.ndarray, squares: dict[str, float]) -> float:
        """Variance of ``gain @ observed`` under the given terms.

        Not below a thousandth of what independent errors give: the covariance is a quadrature, and
        what cancels in it may come out negative.
        """
        c = self.covariance(squares)
        return max(gain @ c @ gain, 1e-3 * gain**2 @ np.diag(c))

    def reweight(self, squares: dict[str, float]) -> None:
        c = self.covariance(squares)
        sd = np.sqrt(np.diag(c))
        # numpy's driver (divide and conquer) fails to converge on some of these.
        values, vectors = linalg.eigh(c / np.outer(sd, sd))
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


def _fit_axis(curve: AllanCurve, variance: np.ndarray, low_pass: LowPass | None) -> AxisNoise:
    fit = _Fit(curve, variance, low_pass)
    names, squares = _choose_terms(fit)
    misfit, _ = _misfit(fit, names, squares)
    if misfit:
        # What the terms miss is no noise of the curve: it enters as an error of the model. First
        # everywhere, to find the terms in spite of it; then stretch by stretch, the worst first.
        fit.missed[:] = 2 * MISFIT_SIZE
        names, squares = _choose_terms(fit)
        again, missed = _misfit(fit, names, squares)
        if again:
            misfit, fit.missed = again, np.zeros_like(fit.missed)
        for _ in range(STRETCHES):
            if not again:
                break
            fit.missed = np.maximum(fit.missed, missed)
            names, squares = _choose_terms(fit)
            again, missed = _misfit(fit, names, squares)
        # A curve that is known to hold something else is not known to the last digit elsewhere.
        fit.missed = np.maximum(fit.missed, MISFIT_SIZE / 2)
        squares = _settle(fit, names)
    settled = [(names, squares), *_neighbours(fit, names, squares)]
    terms, bounds = {}, {}
    for name in NAMES:
        if name in names and squares[name] > 0:
            limits = np.array([_interval(fit, n, s, name) for n, s in settled])
            low, high = limits[:, 0].min(), limits[:, 1].max()
            terms[name] = Estimate(*map(float, np.sqrt([squares[name], low, high])))
        else:
            terms[name] = None
            bounds[name] = float(np.sqrt(_bound(fit, names, squares, name)))
    edf, band = _limits(curve, variance, squares, fit.used)
    used = (float(fit.tau[0]), float(fit.tau[-1]))
    total = sum(v * TERMS[n].variance(curve.tau) for n, v in squares.items())
    total = np.where((curve.tau >= used[0]) & (total > 0), total, np.nan)
    return AxisNoise(terms, bounds, used, misfit, squares, edf, band, total)


def _choose_terms(fit: _Fit) -> tuple[tuple[str, ...], dict[str, float]]:
    """The terms that are visible and their squared coefficients.

    Forward, the strongest first; then backward, for what later terms have made redundant; then terms
    are exchanged for ones that explain the same rise better (K for B, R for K).
    """
    names = _prune(fit, _grow(fit, ("random_walk",)))
    exchanged = _exchange(fit, names)
    if exchanged != names:
        names = _prune(fit, _grow(fit, exchanged))
    return names, _settle(fit, names)


def _grow(fit: _Fit, names: tuple[str, ...]) -> tuple[str, ...]:
    while len(names) < len(NAMES):
        squares = _settle(fit, names)
        strength = {n: _strength(fit, (*names, n), n, squares) for n in NAMES if n not in names}
        strongest = max(strength, key=strength.get)
        if strength[strongest] < 1:
            break
        names = (*names, strongest)
    return names


def _prune(fit: _Fit, names: tuple[str, ...]) -> tuple[str, ...]:
    """A term is judged with the weights of the model that lacks it."""
    while len(names) > 1:
        strength = {}
        for n in names:
            squares = _settle(fit, tuple(m for m in names if m != n))
            strength[n] = _strength(fit, names, n, squares)
        weakest = min(strength, key=strength.get)
        if strength[weakest] >= 1:
            break
        names = tuple(n for n in names if n != weakest)
    return names


def _exchange(fit: _Fit, names: tuple[str, ...]) -> tuple[str, ...]:
    """The likeliest set of as many terms that differs in one of B, K and R."""
    slow = ("bias_instability", "rate_random_walk", "rate_ramp")
    sets = [names] + [
        tuple(new if n == old else n for n in names)
        for old in slow
        for new in slow
        if old in names and new not in names
    ]
    return min(sets, key=lambda s: _unlikelihood(fit, s))


def _neighbours(fit: _Fit, names, squares) -> list[tuple[tuple[str, ...], dict[str, float]]]:
    """The chosen model with one more term each, where that is too weak to state but not absent.

    What such a term would take from the others belongs into their intervals.
    """
    found = []
    for name in ("bias_instability", "rate_random_walk"):
        more = (*names, name)
        if name not in names and PRESENT * _strength(fit, more, name, squares) > 1:
            found.append((more, fit.solve(more)))
    return found


def _unlikelihood(fit: _Fit, names: tuple[str, ...]) -> float:
    """−2 log L of the curve, taken as normal, up to a constant.

    A ramp leaves no scatter, which tells it from a walk that happens to look like one; it is the
    stronger claim and must win by e¹⁰ (walks reached e⁸ in simulation).
    """
    squares = _settle(fit, names)
    fit.reweight(squares)
    model = sum(squares[n] * fit.columns[n] for n in names)
    residual = fit.whiten @ (fit.observed - model)
    claim = 20.0 if "rate_ramp" in names else 0.0
    return float(residual @ residual - 2 * np.linalg.slogdet(fit.whiten)[1]) + claim


def _settle(fit: _Fit, names: tuple[str, ...]) -> dict[str, float]:
    """Squared coefficients of these terms with the weights that they imply."""
    for _ in range(3):
        squares = fit.solve(names)
        fit.reweight(squares)
    return fit.solve(names)


def _strength(fit: _Fit, names: tuple[str, ...], name: str, without: dict[str, float]) -> float:
    """A term's estimate among `names` over what chance gives without it, in units of `PRESENT`."""
    gain = fit.gain(names)[names.index(name)]
    found = gain @ fit.observed
    chance = np.sqrt(fit.spread(gain, without))
    size = abs(found) if name == "quantization" else found
    return size / chance / PRESENT


def _spread(fit: _Fit, names, squares, name):
    """Variance of a coefficient's estimate as a function (a, b, c) of its true value: a + bθ + cθ²."""
    gain = fit.gain(names)[names.index(name)]
    step = max(abs(squares.get(name, 0.0)), 1e-3 * float(np.max(np.abs(fit.observed * gain))))
    at = np.array([0.0, step, 2 * step])
    v = [fit.spread(gain, {**squares, name: t}) for t in at]
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


def _misfit(fit: _Fit, names, squares) -> tuple[Misfit | None, np.ndarray]:
    """The worst stretch in which the curve departs from the terms; |σ/model − 1| there, else zero."""
    points = slice(len(fit.tau))
    model = sum(squares[n] * fit.columns[n] for n in names)[points]
    # A model that a negative 1/τ² drives to zero or below is a departure of its own.
    model = np.maximum(model, 1e-3 * fit.observed[points])
    share = np.diag(fit.covariance(squares, missed=False))[points] / model**2
    return worst_departure(fit.tau, fit.observed[points], model, share, told=fit.missed > 0)


def _limits(curve: AllanCurve, variance, squares, used) -> tuple[np.ndarray, np.ndarray]:
    """Equivalent degrees of freedom (T,) and 95 % limits (T, 2) of the whole curve."""
    covariance = variance_covariance(curve.clusters, curve.samples, curve.rate, squares)
    model = sum(v * TERMS[n].variance(curve.tau) for n, v in squares.items())
    # Within the low-pass's reach the terms say nothing: the measured variance stands in.
    stated = np.isin(np.arange(len(model)), used) & (model > 0)
    return confidence(variance, np.diag(covariance) / np.where(stated, model, variance) ** 2)


def confidence(variance: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equivalent degrees of freedom (T,) and 95 % limits (T, 2) of the deviation.

    Parameters
    ----------
    variance : (T,) Allan variance
    share : (T,) variance of its estimate over its square
    """
    edf = 2 / np.maximum(share, 1e-12)  # a million million: nothing is known better
    limits = [np.sqrt(variance * edf / stats.chi2.ppf(q, edf)) for q in (0.975, 0.025)]
    return edf, np.stack(limits, axis=1)
