"""Power spectral density of a rate signal and what work A reads off it (A 5.6–5.11, table 5.1, 7.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import fft, signal, special, stats

from sensorbook.errors import Refusal
from sensorbook.estimate import Estimate
from sensorbook.noise.allan import MINIMUM_SAMPLES, check_rate
from sensorbook.noise.lowpass import LowPass
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise, NoiseEstimate

STAND = 32  # lines that table 5.1 leaves as they are; each octave above becomes half as many points
# |Σh² e^{2πikn/N}|²/(Σh²)² of a window h: what two lines k = 1, 2 … apart have of their scatter in common.
SINE_LINES, HANN_LINES = (1 / 4,), (4 / 9, 1 / 36)
HANN_SEGMENTS = 1 / 36  # (Σ h_n h_{n+L/2})²/(Σh²)², the same for two segments that overlap by half
SLOPE_ERROR = 0.2  # standard error to which a local slope must be known: half the tolerance
SLOPES = {"random_walk": 0, "bias_instability": -1, "rate_random_walk": -2}  # of log S
TOLERANCE = 0.4  # of a slope: nearer to this term than to its neighbours, which lie 1 away
LEAST_OCTAVES = 1.5  # white noise and a random walk alone pass −1 ± 0.4 within 1.2 octaves
LEAST_LINES = 8  # of a range: fewer would give its coefficient to no better than 40 %
CLEAR = 0.2  # of the cut-off: below it even a low-pass of first order takes less than 2 % of N


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """One-sided power spectral density, without the line at zero frequency.

    Attributes
    ----------
    frequency : (F,) Hz
    density : (F, A) P₁ = 2·S, (unit of the signal)²/Hz
    dof : (F,) degrees of freedom ν of each point: it scatters as ``P₁ χ²_ν/ν``
    lines : (F,) number of spectral lines that each point is the mean of
    samples : length N of the record
    rate : sampling rate, Hz
    sensor : name of the sensor, for field units; may be empty
    correlation : of the scatter of lines 1, 2, … apart; empty where lines are independent
    """

    frequency: np.ndarray
    density: np.ndarray
    dof: np.ndarray
    lines: np.ndarray
    samples: int
    rate: float
    sensor: str = ""
    correlation: tuple[float, ...] = ()

    def limits(self, level: float = 0.95) -> np.ndarray:
        """(F, A, 2) confidence limits of the density, from χ² with `dof` degrees of freedom."""
        tails = np.array([(1 + level) / 2, (1 - level) / 2])
        return self.density[..., None] * (self.dof[:, None] / _quantiles(self.dof, tails))[:, None]

    def pooled_dof(self, points: slice | np.ndarray) -> float:
        """Degrees of freedom of the mean over all lines of some points."""
        independent = self.dof[points] * _inflation(self.lines[points], self.correlation)
        return float(independent.sum() / _inflation(self.lines[points].sum(), self.correlation))

    def to_frame(self) -> pd.DataFrame:
        """One row a frequency, one column an axis, SI units."""
        index = pd.Index(self.frequency, name="frequency [Hz]")
        return pd.DataFrame(self.density, index=index, columns=list("xyz")[: self.density.shape[1]])

    def _repr_html_(self) -> str:
        return self.to_frame().to_html(max_rows=12)


def _quantiles(dof: np.ndarray, tails: np.ndarray) -> np.ndarray:
    """(F, 2) χ² quantiles; most points share their degrees of freedom with many others."""
    distinct, which = np.unique(dof, return_inverse=True)
    return stats.chi2.ppf(tails, distinct[:, None])[which]


def _inflation(lines: np.ndarray, correlation: Sequence[float]) -> np.ndarray:
    """Variance of a mean of `lines` neighbouring lines over that of as many independent ones."""
    return 1 + 2 * sum(
        np.maximum(1 - k / np.asarray(lines), 0) * r for k, r in enumerate(correlation, start=1)
    )


def _columns(values: np.ndarray) -> np.ndarray:
    """(A, N) finite samples less their mean."""
    values = np.asarray(values, dtype=float)
    values = values[:, None] if values.ndim == 1 else values
    if len(values) < 4:
        raise ValueError(f"{len(values)} samples have no spectrum; at least 4 are needed")
    if not np.isfinite(values).all():
        raise ValueError("the signal holds samples that are not finite; bridge or cut them first")
    return np.ascontiguousarray((values - values.mean(axis=0)).T)


def periodogram(
    values: np.ndarray, rate: float, sensor: str = "", *, taper: bool = False
) -> PowerSpectrum:
    """One-sided periodogram ``P₁(f_j) = 2 δt/N |X_j|²`` (A 5.10 and 5.11, set right).

    The line at zero is left out and, for even N, the one at Nyquist is not doubled, so that
    ``Σ P₁ Δf`` is the variance of the samples (Parseval).

    Parameters
    ----------
    values : (N,) or (N, A) evenly sampled signal
    rate : Hz
    taper : weigh the samples with half a sine of unit mean square (Riedel and Sidorenko 1995). Without
        it a random walk leaks from the ends of the record: where slope −2 rules, every line is expected
        at exactly twice its density, and K read from it is √2 too large. A taper costs a third of the
        degrees of freedom.

    Raises
    ------
    ValueError
        a rate that is not above zero, fewer than 4 samples, or samples that are not finite
    """
    check_rate(rate)
    columns = _columns(values)
    samples = columns.shape[1]
    window = np.sqrt(2) * signal.windows.cosine(samples) if taper else 1.0
    density = np.empty((samples // 2, len(columns)))
    for i, column in enumerate(columns):  # one at a time: the transform is as large as all of these
        lines = fft.rfft(window * column)[1:]
        density[:, i] = 2 / (rate * samples) * (lines.real**2 + lines.imag**2)
    dof = np.full(len(density), 2.0)
    if samples % 2 == 0:
        density[-1] /= 2
        dof[-1] = 1.0
    frequency = np.arange(1, len(density) + 1) * (rate / samples)
    return PowerSpectrum(
        frequency, density, dof, np.ones(len(density), dtype=np.int64), samples, rate, sensor,
        SINE_LINES if taper else (),
    )  # fmt: skip


def welch(
    values: np.ndarray, rate: float, segment: int | None = None, sensor: str = ""
) -> PowerSpectrum:
    """Welch's estimate: mean over Hann-weighted segments that overlap by half, each less its mean.

    Parameters
    ----------
    values : (N,) or (N, A) evenly sampled signal
    rate : Hz
    segment : samples; where None, the power of two nearest to an eighth of the record, 256 at least

    The degrees of freedom are ``2K/(1 + 2(1 − 1/K)/36)`` for K segments (Welch 1967; Percival and
    Walden 1993, 292b).

    Raises
    ------
    Refusal
        fewer than 1000 samples where the segment is left to the function
    ValueError
        a rate that is not above zero, a segment shorter than 4 samples or longer than the record, or
        samples that are not finite

    Examples
    --------
    White noise of two-sided density S = 2e-4 has a standard deviation of √(S·rate) and is seen at 2·S:

    >>> rng = np.random.default_rng(0)
    >>> spectrum = welch(np.sqrt(2e-4 * 100.0) * rng.standard_normal(200_000), 100.0, 1024)
    >>> abs(spectrum.density.mean() / 4e-4 - 1) < 0.01
    np.True_
    """
    check_rate(rate)
    columns = _columns(values)
    samples = columns.shape[1]
    if segment is None:
        if samples < MINIMUM_SAMPLES:
            raise Refusal(
                f"The record has {samples} samples; a spectrum needs at least {MINIMUM_SAMPLES}.",
                "Record a rest of one hour or more.",
            )
        segment = max(256, 2 ** round(np.log2(samples / 8)))
    if not 4 <= segment <= samples:
        raise ValueError(f"a segment of {segment} samples is outside 4 … {samples}, the record")
    frequency, density = signal.welch(
        columns, rate, "hann", segment, noverlap=segment // 2, detrend="constant"
    )
    count = (samples - segment // 2) // (segment - segment // 2)
    dof = np.full(len(frequency), 2 * count / (1 + 2 * (1 - 1 / count) * HANN_SEGMENTS))
    if segment % 2 == 0:
        dof[-1] /= 2
    return PowerSpectrum(
        frequency[1:], density.T[1:], dof[1:], np.ones(len(frequency) - 1, dtype=np.int64), samples,
        rate, sensor, HANN_LINES,
    )  # fmt: skip


def average_frequencies(spectrum: PowerSpectrum) -> PowerSpectrum:
    """A's table 5.1: 32 lines stand, then 16 points an octave.

    Lines 33–64 are averaged in groups of 2, 65–128 of 4, 129–256 of 8 and so on. A spectrum that ends
    within an octave ends with a group of the lines that are left. Lines count by their degrees of
    freedom (the one at Nyquist for half), which add up as far as lines are independent. A group stands
    at the mean of its frequencies: over a sixteenth of an octave the density there and the mean
    density differ by less than 1e-3 even for slope −2.
    """
    count = len(spectrum.frequency)
    starts = [np.arange(min(STAND, count))]
    first, size = STAND, 2
    while first < count:
        starts.append(np.arange(first, min(2 * first, count), size))
        first, size = 2 * first, 2 * size
    starts = np.concatenate(starts)

    def mean(column):
        weighted = (column.T * spectrum.dof).T
        return np.add.reduceat(weighted, starts, axis=0)

    lines = np.add.reduceat(spectrum.lines, starts)
    total = np.add.reduceat(spectrum.dof, starts)
    return PowerSpectrum(
        mean(spectrum.frequency) / total,
        mean(spectrum.density) / total[:, None],
        total / _inflation(lines, spectrum.correlation),
        lines, spectrum.samples, spectrum.rate, spectrum.sensor, spectrum.correlation,
    )  # fmt: skip


def spectral_slopes(spectrum: PowerSpectrum) -> np.ndarray:
    """(F, A) local slope d log P / d log f of an averaged spectrum; NaN where it cannot be known.

    A straight line through the points within half an octave either side, each weighted by the inverse
    variance of its logarithm, ψ'(ν/2), and less that logarithm's bias, ψ(ν/2) − ln(ν/2). Where so few
    lines give the slope to no better than 0.2, as all low frequencies do, the reach is widened until
    they do.
    """
    x, half = np.log(spectrum.frequency), spectrum.dof / 2
    # Points that share their scatter with the next count for less.
    shared = _inflation(spectrum.lines, spectrum.correlation) / (1 + 2 * sum(spectrum.correlation))
    weight = shared / special.polygamma(1, half)
    y = np.log(spectrum.density) - (special.digamma(half) - np.log(half))[:, None]
    moments = np.column_stack([weight, weight * x, weight * x**2])
    moments = np.column_stack([moments, weight[:, None] * y, (weight * x)[:, None] * y])
    sums = np.vstack([np.zeros(moments.shape[1]), np.cumsum(moments, axis=0)])
    slopes = np.full(spectrum.density.shape, np.nan)
    axes = spectrum.density.shape[1]
    for reach in np.geomspace(np.log(2) / 2, x[-1] - x[0] + np.log(2), 60):
        missing = np.flatnonzero(np.isnan(slopes[:, 0]))
        low = np.searchsorted(x, x[missing] - reach - 1e-9)
        high = np.searchsorted(x, x[missing] + reach + 1e-9)
        part = sums[high] - sums[low]
        w, wx, wxx = part[:, :3].T
        spread = wxx - wx**2 / w
        known = spread > 1 / SLOPE_ERROR**2
        wy, wxy = part[:, 3 : 3 + axes], part[:, 3 + axes :]
        found = (wxy - (wx / w)[:, None] * wy)[known] / spread[known, None]
        slopes[missing[known]] = found
    return slopes


def read_ranges(
    spectrum: PowerSpectrum, low_passes: Sequence[LowPass | None] = ()
) -> tuple[dict[str, slice], ...]:
    """For each axis the points from which each term is read, by term; absent where there are none.

    The run with the most lines, one and a half octaves and eight lines at least, of points whose local
    slope is within 0.4 of the term's; above a fifth of a low-pass's cut-off nothing is read.
    """
    low_passes = low_passes or (None,) * spectrum.density.shape[1]
    f, ranges = spectrum.frequency, []
    for slopes, low_pass in zip(spectral_slopes(spectrum).T, low_passes, strict=True):
        found = {}
        for term, slope in SLOPES.items():
            fits = (np.abs(slopes - slope) < TOLERANCE) & _clear(spectrum, low_pass)
            steps = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]])))
            runs = [slice(a, b) for a, b in steps.reshape(-1, 2)]
            runs = [r for r in runs if f[r][-1] >= 2**LEAST_OCTAVES * f[r][0]]
            longest = max(runs, key=lambda r: spectrum.lines[r].sum(), default=slice(0))
            if spectrum.lines[longest].sum() >= LEAST_LINES:
                found[term] = longest
        ranges.append(found)
    return tuple(ranges)


def read_off_spectrum(
    spectrum: PowerSpectrum,
    low_passes: Sequence[LowPass | None] = (),
    ranges: Sequence[dict[str, slice]] | None = None,
) -> NoiseEstimate:
    """Noise terms as A reads them off its spectra for tables 7.2 and 7.4.

    From the two-sided S = P₁/2: N = √S on the flat, B = √(2πf S) where the slope is −1, K = 2πf √S
    where it is −2, each as the mean over all lines of its range. Where terms overlap each reading holds
    a share of its neighbours, and a bend from −2 to 0 may pass for a stretch of −1: of thirty simulated
    hours of white noise and random walk alone, half show a B. Intervals hold the statistical error alone.

    A term without a range is None, with a 95 % upper bound: nowhere can it exceed the whole density.

    Parameters
    ----------
    spectrum : averaged; of a tapered periodogram where K is to be right
    low_passes : one for each axis (`find_low_pass`), empty for none
    ranges : where to read, `read_ranges` where None
    """
    low_passes = low_passes or (None,) * spectrum.density.shape[1]
    ranges = read_ranges(spectrum, low_passes) if ranges is None else ranges
    w = 2 * np.pi * spectrum.frequency
    axes = []
    for density, found, low_pass in zip(spectrum.density.T, ranges, low_passes, strict=True):
        clear = _clear(spectrum, low_pass)
        terms: dict[str, Estimate | None] = dict.fromkeys(TERMS)
        bounds = {}
        for term, slope in SLOPES.items():
            level = density / 2 * w**-slope
            if term in found:
                terms[term] = _read(spectrum, level, found[term])
            else:
                bounds[term] = _bound(spectrum, level, clear)
        used = spectrum.frequency[clear]
        axes.append(AxisNoise(terms, bounds, (float(1 / used[-1]), float(1 / used[0])), None))
    return NoiseEstimate("psd_read_off", spectrum.sensor, tuple(axes))


def _clear(spectrum: PowerSpectrum, low_pass: LowPass | None) -> np.ndarray:
    """(F,) mask of the frequencies that the low-pass leaves alone."""
    return spectrum.frequency <= (CLEAR * low_pass.cutoff if low_pass else np.inf)


def _read(spectrum: PowerSpectrum, level: np.ndarray, points: slice) -> Estimate:
    square = np.average(level[points], weights=spectrum.lines[points])
    dof = spectrum.pooled_dof(points)
    limits = square * dof / stats.chi2.ppf([0.975, 0.025], dof)
    return Estimate(*map(float, np.sqrt([square, *limits])))


def _bound(spectrum: PowerSpectrum, level: np.ndarray, clear: np.ndarray) -> float:
    """The least upper limit of any octave; 95 % hold for all octaves together."""
    octave = np.floor(np.log2(spectrum.frequency / spectrum.frequency[0]) + 1e-9)
    octaves = np.unique(octave[clear])
    tail = 0.05 / len(octaves)
    upper = []
    for points in (np.flatnonzero(clear & (octave == o)) for o in octaves):
        dof = spectrum.pooled_dof(points)
        square = np.average(level[points], weights=spectrum.lines[points])
        upper.append(square * dof / stats.chi2.ppf(tail, dof))
    return float(np.sqrt(min(upper)))


def low_pass_filter(values: np.ndarray, rate: float, cutoff: float, order: int = 2) -> np.ndarray:
    """The signal through a Butterworth low-pass, forwards and backwards: no phase, no delay (A 7.2).

    The two passes together halve the power at `cutoff`, so each is tuned somewhat above it.

    Parameters
    ----------
    values : (N,) or (N, A) evenly sampled signal
    rate, cutoff : Hz
    order : of one pass

    Raises
    ------
    ValueError
        the cut-off is not between zero and half the sampling rate
    """
    if not 0 < cutoff < rate / 2:
        raise ValueError(
            f"a cut-off of {cutoff:g} Hz is outside 0 … {rate / 2:g} Hz, half the sampling rate"
        )
    edge = np.tan(np.pi * cutoff / rate) / (np.sqrt(2) - 1) ** (0.5 / order)
    sections = signal.butter(order, 2 / np.pi * np.arctan(edge), output="sos")
    return signal.sosfiltfilt(sections, values, axis=0)
