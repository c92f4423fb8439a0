"""How long a rest must last for a noise term of a wanted accuracy.

The Cramér–Rao bound of the likelihood that the noise chapters maximise (`noise.whittle`): with the lines
of the cosine spectrum independent, of variance S(f), Fisher's information of the squared coefficients
c², S = Σ c² s(f), is ``½ Σ s_a s_b / S²`` over the lines, and that of a ramp's slope ``Σ r²/S``. N, B and K
are always free, as the chapters have them; Q and R where they are there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sensorbook.noise.cosine import BIN, CosineSpectrum, flicker_lines
from sensorbook.noise.likelihood import Likelihood
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.noise.whittle import BASE, PRESENT, RAMP

LONGEST = 7 * 86400.0  # s
FEWEST = 1000  # samples that the noise chapters need
SURE = 1.645  # standard deviations: a term is stated in 95 % of such records
# Lengths that a person would choose, s.
LENGTHS = np.array(
    [60.0 * m for m in (1, 2, 3, 5, 10, 15, 20, 30, 45)]
    + [3600.0 * h for h in (1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 36, 48, 72, 96, 120, 144, 168)]
)  # fmt: skip


@dataclass(frozen=True)
class Rest:
    """What a rest of `seconds` would tell of one term of one axis.

    Attributes
    ----------
    level : of the term, SI
    std : expected standard error over the level
    stated : whether 95 % of such records state the term and do not only bound it
    """

    seconds: float
    level: float
    std: float
    stated: bool


def expected_spectrum(terms: NoiseTerms, samples: int, rate: float) -> CosineSpectrum:
    """The spectrum that records of these terms have on average, in the chapters' bins."""
    first = np.unique(
        np.round(np.exp(np.arange(0, np.log(samples), np.log1p(BIN)))).astype(np.int64)
    )
    first = first[first < samples]
    lines = np.diff(np.append(first, samples))
    middle = first + (lines - 1) / 2
    frequency = middle * (rate / (2 * samples))
    w = 2 * np.pi * frequency
    flicker = flicker_lines(middle)
    density = terms.spectrum(frequency, 1 / rate)
    density = density + terms.bias_instability**2 / w * (flicker - 1)
    odd = ((first + lines) // 2 - first // 2) / lines  # a ramp has no others
    half = np.pi * middle / (2 * samples)
    ramp = 2 / samples / rate**3 * (np.cos(half) / (2 * np.sin(half) ** 2)) ** 2
    ramp = ramp * odd
    return CosineSpectrum(
        frequency=frequency,
        density=(density + terms.rate_ramp**2 * ramp)[:, None],
        lines=lines,
        flicker=flicker,
        ramp=(terms.rate_ramp * ramp)[:, None],
        ramp_square=ramp,
        samples=samples,
        rate=rate,
    )


def rest(terms: NoiseTerms, name: str, seconds: float, rate: float) -> Rest:
    """What a rest of `seconds` at `rate` (Hz) tells of the term `name`, whose level is not 0."""
    spectrum = expected_spectrum(terms, max(3, round(seconds * rate)), rate)
    likelihood = Likelihood(spectrum, 0, np.ones(len(spectrum.lines), dtype=bool))
    names = tuple(n for n in TERMS if n in BASE or getattr(terms, n))
    level = getattr(terms, name)
    noise = spectrum.density[:, 0] - terms.rate_ramp**2 * spectrum.ramp_square
    if name == "rate_ramp":
        std = np.sum(spectrum.lines * spectrum.ramp_square / noise) ** -0.5 / level
    else:
        varied = [n for n in names if n != "rate_ramp"]
        a = np.column_stack([likelihood.columns[n] for n in varied]) / noise[:, None]
        scale = np.linalg.norm(a, axis=0)  # the columns span many decades
        a = a / scale
        inverse = np.linalg.inv((spectrum.lines[:, None] * a).T @ a / 2)
        at = varied.index(name)
        std = np.sqrt(inverse[at, at]) / scale[at] / (2 * level**2)
    return Rest(seconds, level, float(std), _is_stated(likelihood, names, name, spectrum))


def _is_stated(likelihood: Likelihood, names, name: str, spectrum: CosineSpectrum) -> bool:
    """Whether leaving the term out costs what `noise.whittle` asks for, in 95 % of such records."""
    if spectrum.samples < FEWEST:
        return False
    left_out = max(0.0, likelihood.fit(names, {name: 0.0})[1] - likelihood.fit(names)[1])
    needed = RAMP if name == "rate_ramp" else PRESENT
    return bool(np.sqrt(left_out) > np.sqrt(needed) + SURE)


def shortest(terms: NoiseTerms, name: str, std: float, rate: float) -> Rest | None:
    """The shortest of `LENGTHS` that states the term with a relative standard error of `std` or less.

    None where a week does not.
    """
    longest = rest(terms, name, LONGEST, rate)
    if longest.std > std or not longest.stated:
        return None
    low, high = -1, len(LENGTHS) - 1  # both needs only grow easier with the length
    found = longest
    while high - low > 1:
        middle = (low + high) // 2
        tried = rest(terms, name, float(LENGTHS[middle]), rate)
        if tried.std <= std and tried.stated:
            high, found = middle, tried
        else:
            low = middle
    return found


def hidden(terms: NoiseTerms, name: str, rate: float) -> str:
    """Why a term is known so badly: what hides it where it stands out most, or how few lines show it."""
    if LONGEST * rate < FEWEST:
        return f"at {rate:g} Hz a week gives {LONGEST * rate:.0f} samples, and {FEWEST} are needed"
    spectrum = expected_spectrum(terms, round(LONGEST * rate), rate)
    likelihood = Likelihood(spectrum, 0, np.ones(len(spectrum.lines), dtype=bool))
    parts = {n: getattr(terms, n) ** 2 * c for n, c in likelihood.columns.items()}
    parts["rate_ramp"] = terms.rate_ramp**2 * spectrum.ramp_square
    total = np.maximum(sum(parts.values()), 1e-300)
    at = int(np.argmax(parts[name] / total))
    share, symbol = parts[name][at] / total[at], TERMS[name].symbol
    if share > 0.5:
        return (
            f"{symbol} shows below {spectrum.frequency[parts[name] > total / 2].max():.2g} Hz alone, where a "
            "rest has few independent lines: four times as long halves the error"
        )
    others = sorted((n for n in parts if n != name), key=lambda n: -parts[n][at])
    seen = [(n, 100 * parts[n][at] / total[at]) for n in others]
    seen = ", ".join(f"{TERMS[n].symbol} {p:.0f} %" for n, p in seen if p >= 0.5)
    return (
        f"{symbol} is {100 * share:.2g} % of the noise's power where it stands out most, at "
        f"{spectrum.frequency[at]:.2g} Hz; {seen} of it hide {symbol} there"
    )
