"""Noise terms of a rest by maximum likelihood on its spectrum, with intervals and a choice of terms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from sensorbook.estimate import Estimate
from sensorbook.noise.cosine import CosineSpectrum
from sensorbook.noise.likelihood import Likelihood
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise, GaussMarkov, NoiseEstimate

BASE = ("random_walk", "bias_instability", "rate_random_walk")  # always in the model
INTERVAL = 3.841  # χ² of one degree of freedom, 95 %
# What a term must save to be stated. A term that is not there saves nothing in half of all records and
# χ² of one degree of freedom in the other half (Chernoff 1954): 0.5 % exceed this.
PRESENT = 6.63
# A walk of few visible turns looks like a ramp: in 300 records with and without K none saved 7 by it.
RAMP = 10.0
# A Gauss–Markov process has two parameters and is searched for: 1 in 150 records without it saves 11.
GAUSS_MARKOV = 14.0
TIMES = 24  # correlation times tried
SHAPINGS = 2  # first-order corrections of the low-pass's shape to the lines that are used
REACH = 0.8  # of the low-pass's cut-off: highest frequency used


def fit_spectrum(
    spectrum: CosineSpectrum,
    sensor: str = "",
    kept_out: Sequence[np.ndarray] = (),
    low_passes: Sequence[LowPass | None] = (),
    gauss_markov: bool = False,
) -> NoiseEstimate:
    """Noise terms of each axis by maximum likelihood, with intervals from the profile of the likelihood.

    N, B and K are always in the model, Q and R where the likelihood asks for them (Q never behind a
    low-pass, which hides it). A term is stated where leaving it out costs more than `PRESENT`; otherwise
    it is None and its upper bound is the upper end of its 95 % interval, which begins at zero. Values and
    intervals are those of the whole model either way, so that the choice of terms does not narrow them.

    Parameters
    ----------
    spectrum : of the rest (`cosine_spectrum`)
    kept_out : for each axis a mask (F,) of bins that hold periodic components
    low_passes : one for each axis, None where there is none
    gauss_markov : offers each axis a first-order Gauss–Markov process besides; where the likelihood takes
        it, the terms are those beside it and the axis's `gauss_markov` is not None
    """
    count = spectrum.density.shape[1]
    kept_out = kept_out or (np.zeros(len(spectrum.lines), dtype=bool),) * count
    low_passes = low_passes or (None,) * count
    axes = [
        _fit_axis(spectrum, i, ~mask, low_pass, gauss_markov)
        for i, (mask, low_pass) in enumerate(zip(kept_out, low_passes, strict=True))
    ]
    return NoiseEstimate("whittle", sensor, tuple(axes))


def _fit_axis(
    spectrum, axis: int, used: np.ndarray, low_pass: LowPass | None, gauss_markov: bool
) -> AxisNoise:
    if low_pass:
        used = used & (spectrum.frequency <= REACH * low_pass.cutoff)
    likelihood = Likelihood(spectrum, axis, used, low_pass)
    for _ in range(SHAPINGS if low_pass else 0):
        low_pass = low_pass.shifted(likelihood.shift(BASE))
        likelihood = Likelihood(spectrum, axis, used, low_pass)

    def choose():
        names, squares, deviance = _choose(likelihood, low_pass)
        process = _gauss_markov(likelihood, names, deviance, spectrum) if gauss_markov else None
        if process:
            names = (*names, "gauss_markov")
            squares, _ = likelihood.fit(names)
        return names, squares, process

    names, squares, process = choose()
    error = 0.0
    for _ in range(3):  # what the terms miss changes the weights, these the terms
        more = likelihood.model_error(squares)
        if abs(more - error) < 0.1 * error or not more:
            break
        error = more
        likelihood.allow(error)
        names, squares, process = choose()
    deviance = likelihood.fit(names)[1]
    terms: dict[str, Estimate | None] = {}
    bounds = {}
    for name in TERMS:
        more = names if name in names else (*names, name)
        at, least = (squares, deviance) if name in names else likelihood.fit(more)
        low, high = likelihood.profile(more, name, at, least, INTERVAL)
        root = abs if name == "rate_ramp" else np.sqrt
        needed = RAMP if name == "rate_ramp" else PRESENT
        if name in names and likelihood.fit(more, {name: 0.0})[1] - least > needed:
            terms[name] = Estimate(*(float(root(v)) for v in (at[name], low, high)))
        else:
            terms[name], bounds[name] = None, float(root(high))
    frequency = spectrum.frequency[used]
    if "rate_ramp" in squares:
        squares["rate_ramp"] **= 2
    squares.pop("gauss_markov", None)
    return AxisNoise(
        terms,
        bounds,
        tau_range=None,
        misfit=None,
        squares=squares,
        frequency_range=(float(frequency[0]), float(frequency[-1])),
        model_error=error,
        gauss_markov=process,
        # With the shape that belongs to these terms and weights.
        low_pass=low_pass and low_pass.shifted(likelihood.shift(names)),
    )


def _choose(likelihood: Likelihood, low_pass) -> tuple[tuple[str, ...], dict[str, float], float]:
    names, (squares, deviance) = BASE, likelihood.fit(BASE)
    for name, needed in (("rate_ramp", RAMP), ("quantization", PRESENT)):
        if name == "quantization" and low_pass:
            continue
        more, less = likelihood.fit((*names, name))
        if deviance - less > needed:
            names, squares, deviance = (*names, name), more, less
    return names, squares, deviance


def _gauss_markov(
    likelihood: Likelihood, names: tuple[str, ...], deviance: float, spectrum: CosineSpectrum
) -> GaussMarkov | None:
    """The Gauss–Markov process that the likelihood takes beside `names`, None where it takes none.

    Leaves the likelihood at its correlation time.
    """
    names = (*names, "gauss_markov")

    def fitted(log_time: float) -> tuple[dict[str, float], float]:
        likelihood.set_correlation_time(np.exp(log_time))
        return likelihood.fit(names)

    # From some samples to where a turn of it would still be seen in the record.
    tried = np.linspace(*np.log([5 / spectrum.rate, spectrum.samples / spectrum.rate / 5]), TIMES)
    found = [fitted(t)[1] for t in tried]
    near = tried[max(0, np.argmin(found) - 1)], tried[min(TIMES - 1, np.argmin(found) + 1)]
    best = optimize.minimize_scalar(lambda t: fitted(t)[1], bounds=near, options={"xatol": 1e-3})
    if deviance - best.fun < GAUSS_MARKOV:
        return None

    def excess(t: float) -> float:
        return fitted(t)[1] - best.fun - INTERVAL

    ends = [
        float(optimize.brentq(excess, end, best.x, xtol=1e-3) if excess(end) > 0 else end)
        for end in (tried[0], tried[-1])
    ]

    def spread(log_time: float, squared: float) -> float:
        # S(0) = (qT)², and the variance of the process is q²T/2.
        return float(np.sqrt(squared * np.exp(log_time) / 2))

    # The two parameters err together: the interval of one spans that of the other.
    stds = [spread(end, fitted(end)[0]["gauss_markov"]) for end in ends]
    squares, least = fitted(best.x)
    interval = likelihood.profile(names, "gauss_markov", squares, least, INTERVAL)
    stds += [spread(best.x, q2) for q2 in interval]
    std = Estimate(spread(best.x, squares["gauss_markov"]), min(stds), max(stds))
    time = Estimate(*(float(np.exp(t)) for t in (best.x, *ends)))
    return GaussMarkov(time, std, float(deviance - least))
