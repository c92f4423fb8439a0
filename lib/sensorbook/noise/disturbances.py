"""What a rest holds besides noise: shocks, steps of the bias, and periodic components (A 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage, stats

from sensorbook.errors import Refusal
from sensorbook.noise.cosine import CosineSpectrum, cosine_spectrum
from sensorbook.shared import shared

SHOCK_SIGMAS = 10.0  # no normal variable gets there; sensors with heavy tails reach 9
TREND = 1001  # samples of the running median that shocks stand out from
JOINED, PADDED = 2.0, 0.5  # s: shocks closer than this are one; what rings on around them
MOST_SHOCKED = 0.1  # share of a record that is no longer a rest

STEP_SIGMAS = 8.0  # of differences of neighbouring means, which are normal for every noise term
SHARP = 0.6  # least share of a step's size that stands in a quarter of the window
MOST_STEPS = 6  # taken out of an axis

PERIODS = 16  # fewest in a record that make a component periodic
CHANCE = 1e-7  # of a false component in a bin
EXCESS = 1.1  # least power over its surroundings that is worth telling
NEIGHBOURS = 61  # bins of a hundredth of their frequency: what a component stands out from
MOST_LINES = 40  # lines subtracted from an axis
SIDE, LONE = 30, 20.0  # a line is that many times higher than the lines on either side of it


@dataclass(frozen=True)
class Shock:
    """A stretch that was knocked or moved.

    Attributes
    ----------
    start, stop : the samples that stand out, `stop` excluded; what rings on around them is not in it
    size : largest departure, robust standard deviations
    """

    start: int
    stop: int
    size: float


@dataclass(frozen=True)
class Step:
    """A sudden change of an axis's level.

    Attributes
    ----------
    start : first sample after it
    size : SI
    lasting : False where the level does not stay; it is then left in the signal
    """

    start: int
    size: float
    lasting: bool = True


@dataclass(frozen=True)
class Periodic:
    """A periodic component of one axis.

    Attributes
    ----------
    frequency : of a line; the centre of a band, Hz
    amplitude : of a sinusoid of the same power, SI
    band : frequencies kept out of the noise terms, Hz
    steady : a sinusoid of constant frequency and phase, which can be subtracted
    """

    frequency: float
    amplitude: float
    band: tuple[float, float]
    steady: bool


@dataclass(frozen=True, eq=False)
class Calm:
    """A rest without what happened to it.

    Attributes
    ----------
    values : (N, A) with shocks bridged and lasting steps taken out
    shocks : of all axes
    bridged : share of the record that the bridges make
    steps : for each axis, those left in included
    """

    values: np.ndarray
    shocks: tuple[Shock, ...]
    bridged: float
    steps: tuple[tuple[Step, ...], ...]


@shared
def calmed(values: np.ndarray, rate: float) -> Calm:
    """A rest with its shocks bridged and its steps taken out; see `bridge` and `take_out_steps`.

    Parameters
    ----------
    values : (N, A) evenly sampled
    rate : Hz
    """
    shocks = find_shocks(values, rate)
    bridged = bridge(values, shocks, rate)
    share = float(np.mean((bridged != values).any(axis=1))) if shocks else 0.0
    levels = [take_out_steps(column) for column in bridged.T]
    level = np.stack([column for column, _ in levels], axis=1)
    return Calm(level, shocks, share, tuple(tuple(steps) for _, steps in levels))


def find_shocks(values: np.ndarray, rate: float) -> tuple[Shock, ...]:
    """Stretches in which any axis departs from its running median by ten robust standard deviations.

    Parameters
    ----------
    values : (N, A) evenly sampled
    rate : Hz
    """
    size = np.zeros(len(values))
    for column in np.asarray(values, dtype=float).T:
        if np.ptp(column) == 0:
            continue
        # A shock of less than half of the window does not move its median.
        departure = np.abs(column - ndimage.median_filter(column, TREND, mode="mirror"))
        # In coarse counts most samples may be alike.
        least = np.median(np.diff(np.unique(column))) / 2
        scale = max(1.4826 * np.median(departure), least)
        scale = max(scale, float(np.sqrt(np.mean(np.minimum(departure, 5 * scale) ** 2))))
        size = np.maximum(size, departure / scale)
    rows = np.flatnonzero(size > SHOCK_SIGMAS)
    if not len(rows):
        return ()
    breaks = np.flatnonzero(np.diff(rows) > max(2 * _padding(rate), round(JOINED * rate))) + 1
    return tuple(
        Shock(int(g[0]), int(g[-1]) + 1, float(size[g].max())) for g in np.split(rows, breaks)
    )


def _padding(rate: float) -> int:
    return max(5, round(PADDED * rate))


def bridge(values: np.ndarray, shocks: tuple[Shock, ...], rate: float) -> np.ndarray:
    """(N, A) the signal with straight lines in place of its shocks and half a second around them.

    The lines carry the noise of the stretch before them (or behind), mirrored: without any, white noise
    would come out weaker by the share of the record that is bridged.

    Raises
    ------
    Refusal
        more than a tenth of the record is shocked
    """
    pad = _padding(rate)
    spans = [(max(0, s.start - pad), min(len(values), s.stop + pad)) for s in shocks]
    shocked = sum(stop - start for start, stop in spans)
    if shocked > MOST_SHOCKED * len(values):
        raise Refusal(
            f"{100 * shocked / len(values):.0f} % of the record is knocked or moved, in {len(shocks)} "
            "stretches: it is not a rest.",
            "Record with the sensor clamped to something heavy, far from people and machines.",
        )
    if not shocks:
        return values
    bridged = np.array(values, dtype=float)
    for start, stop in spans:
        before = bridged[max(0, start - pad) : start]
        after = np.asarray(values[stop : stop + pad], dtype=float)
        ends = [np.mean(side, axis=0) for side in (before, after) if len(side)]
        share = np.linspace(0, 1, stop - start)[:, None]
        length = stop - start
        noise = (
            bridged[start - length : start] if start >= length else bridged[stop : stop + length]
        )
        noise = noise[::-1] - np.mean(noise, axis=0) if len(noise) == length else 0.0
        bridged[start:stop] = ends[0] * (1 - share) + ends[-1] * share + noise
    return bridged


def take_out_steps(column: np.ndarray) -> tuple[np.ndarray, list[Step]]:
    """The signal without sudden lasting changes of its level, and all sudden ones in order of time.

    Means of neighbouring windows differ by normal amounts whatever noise terms there are, a random walk
    included; where two differ by eight robust standard deviations of all such differences, and the change
    is as large in a quarter of the window, the level has stepped. A slow change is none. A step that does
    not last, such as an edge of a bump whose other edge is not sudden, is told but left in.
    """
    column = np.asarray(column, dtype=float)
    jumps: list[tuple[int, float, int]] = []
    while len(jumps) < MOST_STEPS and (jump := _largest_jump(_without(column, jumps))):
        jumps.append(jump)
    lasting = list(jumps)
    while lasting and not all(stay := [_lasts(column, j, lasting) for j in lasting]):
        lasting = [j for j, stays in zip(lasting, stay, strict=True) if stays]
    left = [Step(start, size, False) for start, size, w in jumps if (start, size, w) not in lasting]
    for _ in range(2):  # each beside the others, whose sizes have changed
        for k, (start, _, width) in enumerate(lasting):
            others = _without(column, lasting[:k] + lasting[k + 1 :])
            lasting[k] = (start, _size(others, start), width)
    steps = [Step(start, size) for start, size, _ in lasting] + left
    return _without(column, lasting), sorted(steps, key=lambda s: s.start)


def _size(column: np.ndarray, start: int) -> float:
    """Change of level at `start` from the windows whose means, elsewhere, differ the least."""
    change, width, best = _change(column), 32, (np.inf, 0.0)
    while width <= min(start, len(column) - start, len(column) // 8):
        at = np.arange(width, len(column) - width + 1, width // 8)
        size = change(at, width)
        spread = float(np.median(np.abs(size - np.median(size))))
        best = min(best, (spread, float(change(start, width))))
        width *= 2
    return best[1]


def _without(column: np.ndarray, jumps: list[tuple[int, float, int]]) -> np.ndarray:
    level = column.copy() if jumps else column
    for start, size, _ in jumps:
        level[start:] -= size
    return level


def _lasts(column: np.ndarray, jump: tuple[int, float, int], jumps: list) -> bool:
    """Whether the signal is more even without this jump, too, in windows far longer than its own."""
    start, _, width = jump
    clean = _change(_without(column, jumps))
    with_it = _change(_without(column, [j for j in jumps if j != jump]))
    most = min(start, len(column) - start)
    return all(
        abs(clean(start, min(k * width, most))) < abs(with_it(start, min(k * width, most)))
        for k in (16, 64, 256)
    )


def _change(column: np.ndarray):
    """Difference of the means of `width` samples after and before `at`, as a function of both."""
    total = np.concatenate([[0.0], np.cumsum(column - np.mean(column))])
    return lambda at, width: (total[at + width] - 2 * total[at] + total[at - width]) / width


def _largest_jump(column: np.ndarray) -> tuple[int, float, int] | None:
    """Start, size and window of the jump seen in the shortest windows that show one, or None."""
    change, width = _change(column), 32
    while 16 * width <= len(column):
        at = np.arange(4 * width, len(column) - 4 * width + 1, max(1, width // 8))
        size = change(at, width)
        departure = np.abs(size - np.median(size))
        spread = 1.4826 * np.median(departure)
        i = int(np.argmax(departure))
        if spread > 0 and departure[i] > STEP_SIGMAS * spread:
            around = np.arange(max(at[i] - width, at[0]), min(at[i] + width, at[-1]) + 1)
            # Two levels within these windows: the corner of their running sum.
            start = int(around[np.argmax(np.abs(change(around, width)))])
            whole = float(change(start, 4 * width))
            if abs(change(start, width)) > SHARP * abs(whole):
                return start, whole, width
        width *= 2
    return None


def take_out_lines(column: np.ndarray, rate: float) -> tuple[np.ndarray, list[Periodic]]:
    """The signal without its steady sinusoids, and these, the strongest first.

    A line is sought in the spectrum under a Hann window, whose leakage is low, and fitted by least squares
    with its frequency free. One that drifts is a band of several lines and cannot be taken out this way.
    """
    n = len(column)
    rest = column - np.mean(column)
    window = np.hanning(n + 1)[:n]
    power = np.abs(fft.rfft(rest * window)) ** 2 / (0.375 * n * rate)
    candidates = _lone_peaks(power, n, rate, _background(cosine_spectrum(column, rate), 0))
    found: list[Periodic] = []
    for peak in candidates[:MOST_LINES]:
        f, wave = _sinusoid(rest, window, power, peak, rate)
        amplitude = float(np.sqrt(2 * np.mean(wave**2)))
        # A sinusoid leaves A²n/4 over the rate in the lines around its own.
        if amplitude**2 * n / (4 * rate) > 0.9 * power[peak - 3 : peak + 4].sum():
            rest = rest - wave
            found.append(Periodic(f, amplitude, (f - 4 * rate / n, f + 4 * rate / n), True))
    return (rest + np.mean(column) if found else column), found


def _lone_peaks(power: np.ndarray, n: int, rate: float, background) -> np.ndarray:
    """Lines far above the spectrum around them and above their own neighbours; the highest first."""
    line = np.arange(PERIODS, len(power) - SIDE)
    # e^−x is the chance of a line of x times the mean, at each of n/2 frequencies.
    ratio = power[line] / background(line * rate / n)
    high = (power[line] >= power[line - 1]) & (power[line] >= power[line + 1])
    line = line[high & (ratio > np.log(n / CHANCE))]
    line = line[np.argsort(-power[line])][: 20 * MOST_LINES]
    side = np.concatenate([np.arange(-SIDE, -4), np.arange(5, SIDE + 1)])
    around = np.median(power[np.abs(line[:, None] + side)], axis=1) / np.log(2)
    return line[power[line] > LONE * around]


def find_bands(spectrum: CosineSpectrum, axis: int) -> tuple[np.ndarray, list[Periodic]]:
    """(F,) mask of the bins that stand out of their surroundings, and the components they make.

    Surroundings are the median of 61 bins, which follows every spectrum that falls or rises steadily; a
    bin, or seven together, stands out where chance would do the same once in ten million bins.
    """
    p, lines, f = spectrum.density[:, axis], spectrum.lines, spectrum.frequency
    background = _background(spectrum, axis)(f)
    early = f < PERIODS * spectrum.rate / spectrum.samples
    away = np.zeros(len(p), dtype=bool)
    for width in (1, 7):
        window = np.ones(width)
        expected = np.convolve(lines * background, window, "same")
        together = np.convolve(lines, window, "same")
        ratio = np.convolve(lines * p, window, "same") / expected
        out = (stats.chi2.sf(together * ratio, together) < CHANCE) & (ratio > EXCESS) & ~early
        away |= ndimage.binary_dilation(out, iterations=width // 2 + 1)
    away &= p > background
    away |= ndimage.binary_closing(away, iterations=2)  # which loses bins at the spectrum's ends
    away = ndimage.binary_dilation(away) & ~early
    found, (labels, count) = [], ndimage.label(away)
    width = lines * spectrum.rate / (2 * spectrum.samples)
    for k in range(1, count + 1):
        here = labels == k
        power = np.maximum((p - background) * width, 0)[here]
        if not power.sum():
            continue
        edges = float((f - width / 2)[here][0]), float((f + width / 2)[here][-1])
        centre = float(power @ f[here] / power.sum())
        # Two-sided: half of the power; a sinusoid's is half of its amplitude squared.
        found.append(Periodic(centre, float(np.sqrt(4 * power.sum())), edges, False))
    return away, found


def _background(spectrum: CosineSpectrum, axis: int):
    """Two-sided density around each frequency, by the median of neighbouring bins, as a function."""
    level = np.log(spectrum.density[:, axis])
    # The median of few lines' mean lies below the density.
    level -= np.log(stats.chi2.median(spectrum.lines) / spectrum.lines)
    # Beyond the Nyquist frequency a spectrum goes on as its mirror image.
    smooth = ndimage.median_filter(level, NEIGHBOURS, mode="mirror")
    at = np.log(spectrum.frequency)
    return lambda f: np.exp(np.interp(np.log(f), at, smooth))


def _sinusoid(x, window, power, peak: int, rate: float) -> tuple[float, np.ndarray]:
    """Frequency and wave of the sinusoid nearest to a peak, by least squares under the window."""
    n = len(x)
    left, centre, right = np.log(power[[peak - 1, peak, min(peak + 1, len(power) - 1)]])
    bend = left - 2 * centre + right
    f = (peak + (0.5 * (left - right) / bend if bend else 0.0)) * rate / n
    t = (np.arange(n) - n / 2) / rate
    for _ in range(4):
        angle = 2 * np.pi * f * t
        c, s = np.cos(angle), np.sin(angle)
        # Gauss–Newton: amplitude of cosine and sine, and a change of frequency
        basis = np.stack([c, s]) * window
        a, b = np.linalg.solve(basis @ np.stack([c, s]).T, basis @ x)
        slope = 2 * np.pi * t * (b * c - a * s)
        change = (window * slope) @ (x - a * c - b * s) / ((window * slope) @ slope)
        if abs(change) > rate / n:
            break
        f += float(change)
    angle = 2 * np.pi * f * t
    return float(f), a * np.cos(angle) + b * np.sin(angle)
