"""Likelihood of a cosine spectrum under noise terms (Whittle 1953), and its maximum.

The lines of the cosine spectrum (`cosine`) are independent normal variables whose variance is the density
``S(f) = Q²·4/δt sin²πfδt + N² + B²/2πf + K²/(2πf)²`` (A6): what has to be fitted is linear in the squared
coefficients, none of which can be negative. Minus twice the log-likelihood of bins of ν lines with mean
power p is ``Σ ν (p/S − 1 − ln p/S)`` up to a constant. A rate ramp is a known shape of the
lines themselves, not of their variance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize, stats

from sensorbook.noise.cosine import CosineSpectrum
from sensorbook.noise.lowpass import LowPass

STEPS, SETTLED = 60, 1e-7
WINDOW = 20  # bins over which a spectrum is held against its model
DISPERSED = 0.999  # a model fits unless its windows scatter more than so many of a right one's


class Likelihood:
    """One axis's spectrum under any choice of terms.

    `deviance` is minus twice the log-likelihood, less that of a model that follows every bin.

    Parameters
    ----------
    spectrum, axis : which column of it
    used : (F,) mask of the bins to use
    low_pass : what the noise has been through; its shape is estimated along with the terms
    """

    def __init__(
        self,
        spectrum: CosineSpectrum,
        axis: int,
        used: np.ndarray,
        low_pass: LowPass | None = None,
    ):
        f = spectrum.frequency[used]
        w, dt = 2 * np.pi * f, 1 / spectrum.rate
        self.power, self.counted = spectrum.density[used, axis], spectrum.lines[used]
        self.lines = self.counted.astype(float)
        self.ramp, self.ramp_square = spectrum.ramp[used, axis], spectrum.ramp_square[used]
        self.angular = w
        gain = low_pass.power(f) if low_pass else np.ones_like(f)
        self.columns = {
            "quantization": gain * 4 / dt * np.sin(w * dt / 2) ** 2,
            "random_walk": gain,
            "bias_instability": gain * spectrum.flicker[used] / w,
            "rate_random_walk": gain / w**2,
        }
        # To first order what an error of the shape makes of the white floor; of either sign.
        self.shape = low_pass.derivatives(f) if low_pass else np.empty((len(f), 0))
        smooth = np.exp(
            np.convolve(np.pad(np.log(self.power), 10, "edge"), np.ones(21) / 21, "valid")
        )
        self.start = (
            1.8 * smooth
        )  # the mean of log χ²₁ is −1.27, of many lines 0; weights need no more

    def set_correlation_time(self, seconds: float) -> None:
        """Defines the term "gauss_markov": ``T²/(1 + (2πfT)²)`` times its squared driving density."""
        t = seconds * self.angular
        self.columns["gauss_markov"] = self.columns["random_walk"] * seconds**2 / (1 + t**2)

    def fit(
        self, names: Sequence[str], fixed: dict[str, float] | None = None
    ) -> tuple[dict[str, float], float]:
        """Maximum likelihood: squared coefficients (R itself for the ramp, signed) and the deviance.

        Iteratively reweighted non-negative least squares, which is Fisher scoring under the constraint.

        Parameters
        ----------
        names : terms to estimate
        fixed : terms held at a squared coefficient (the ramp at R)
        """
        squares, deviance, _ = self._solve(names, fixed or {})
        return squares, deviance

    def shift(self, names: Sequence[str]) -> np.ndarray:
        """(k,) what the white floor asks the low-pass's coefficients to change by, for these terms."""
        squares, _, shift = self._solve(names, {})
        floor = squares["random_walk"]
        return shift / floor if floor > 0 else 0 * shift

    def _solve(self, names: Sequence[str], fixed: dict[str, float]):
        varied = [n for n in names if n not in fixed and n != "rate_ramp"]
        a = np.column_stack([*(self.columns[n] for n in varied), self.shape, -self.shape])
        offset = sum((v * self.columns[n] for n, v in fixed.items() if n != "rate_ramp"), 0.0)
        slope = fixed.get("rate_ramp", 0.0)
        free = "rate_ramp" in names and "rate_ramp" not in fixed
        model, x, previous = None, None, np.inf
        for _ in range(STEPS):
            weight = self.start if model is None else model
            if free:
                slope = np.sum(self.lines * self.ramp / weight)
                slope /= np.sum(self.lines * self.ramp_square / weight)
            power = self.power - 2 * slope * self.ramp + slope**2 * self.ramp_square
            found = _weighted_nnls(a, power - offset, np.sqrt(self.lines) / weight)
            x, model, deviance = self._advance(a, offset, power, x, found, model)
            if previous - deviance < SETTLED * max(1.0, abs(deviance)):
                break
            previous = deviance
        squares = dict(zip(varied, x[: len(varied)], strict=True))
        if "rate_ramp" in names:
            squares["rate_ramp"] = slope
        plus, minus = x[len(varied) :].reshape(2, -1)
        squares = {n: float(v) for n, v in (fixed | squares).items()}
        return squares, float(deviance), plus - minus

    def _advance(self, a, offset, power, x, found, model):
        """To `found` at first; then a step towards it, halved until it lowers the deviance."""
        least = 1e-6 * self.start  # where the terms vanish the likelihood would, too
        if model is None:
            new = np.maximum(a @ found + offset, least)
            return found, new, self._deviance(power, new)
        before = self._deviance(power, model)
        for half in range(12):
            t = 0.5**half
            trial = x + t * (found - x)
            new = np.maximum(a @ trial + offset, least)
            deviance = self._deviance(power, new)
            if deviance <= before:
                return trial, new, deviance
        return x, model, before

    def _deviance(self, power: np.ndarray, model: np.ndarray) -> float:
        # `self.power` in the logarithm: the ramp changes what is explained, not what was measured.
        return float(np.sum(self.lines * (power / model - 1 - np.log(self.power / model))))

    def model(self, squares: dict[str, float]) -> np.ndarray:
        """(F,) density of these squared coefficients, the shape's error left out."""
        return sum(v * self.columns[n] for n, v in squares.items() if n in self.columns)

    def profile(
        self,
        names: Sequence[str],
        name: str,
        squares: dict[str, float],
        deviance: float,
        rise: float,
    ) -> tuple[float, float]:
        """Where the deviance, the other terms fitted anew, has risen by `rise`: low ≥ 0 and high.

        For the ramp, of |R|.
        """
        best = abs(squares[name])
        sign = -1.0 if name == "rate_ramp" and squares[name] < 0 else 1.0
        # Where the model is poor a fit that holds the term may stop elsewhere.
        deviance = max(deviance, self.fit(names, {name: sign * best})[1])

        def excess(value: float) -> float:
            return self.fit(names, {name: sign * value})[1] - deviance - rise

        error = self._scale(name, squares)
        low = 0.0
        if best > 0 and excess(0.0) > 0:
            low = optimize.brentq(excess, 0.0, best, xtol=0.01 * error)
        top = 1.3 * best or error
        while excess(top) < 0:
            best, top = top, 2 * top
            if top > 1e12 * error:
                return low, top  # the record does not bound the term
        return low, optimize.brentq(excess, best, top, xtol=0.01 * error)

    def windows(self, squares: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Power over model in windows of `WINDOW` bins: ratio, its lines, and each window's first bin."""
        slope = squares.get("rate_ramp", 0.0)
        power = self.power - 2 * slope * self.ramp + slope**2 * self.ramp_square
        first = np.arange(0, len(power) - WINDOW + 1, WINDOW)
        lines = np.add.reduceat(self.counted, first)
        ratio = np.add.reduceat(self.counted * power / self.model(squares), first) / lines
        return ratio, lines, first

    def model_error(self, squares: dict[str, float]) -> float:
        """Relative error of the model beyond chance, rms over windows; 0 for a model that fits."""
        ratio, lines, _ = self.windows(squares)

        def scatter(error: float) -> float:
            # Wilson and Hilferty: the cube root of χ²/ν is all but normal.
            share = 2 / (9 * lines)
            return float(np.sum((np.cbrt(ratio) - 1 + share) ** 2 / (share + error**2 / 9)))

        if scatter(0.0) < stats.chi2.ppf(DISPERSED, len(ratio)):
            return 0.0
        return optimize.brentq(lambda e: scatter(e) - len(ratio), 0.0, 1e3)

    def allow(self, error: float) -> None:
        """Lets a window's power err by this share, whatever the number of its lines."""
        window = np.arange(len(self.counted)) // WINDOW
        window = np.minimum(window, max(window[-1] - 1, 0))
        together = np.bincount(window, self.counted)[window]
        self.lines = self.counted / (1 + together * error**2 / 2)

    def _scale(self, name: str, squares: dict[str, float]) -> float:
        """A coefficient's standard error with all others known, from Fisher's information."""
        model = np.maximum(self.model(squares), 1e-6 * self.start)
        if name == "rate_ramp":
            return float(np.sum(self.lines * self.ramp_square / model) ** -0.5)
        return float(np.sum(self.lines * (self.columns[name] / model) ** 2 / 2) ** -0.5)


def _weighted_nnls(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> np.ndarray:
    scaled = a * weight[:, None]
    norm = np.sqrt(np.einsum("fk,fk->k", scaled, scaled))
    r = np.linalg.qr(np.column_stack([scaled / norm, weight * b]), mode="r")
    return optimize.nnls(r[:, :-1], r[:, -1], maxiter=200)[0] / norm
