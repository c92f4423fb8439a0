"""How a gyroscope and a reference part over time: what a filter must know of both, from themselves.

Between two references the gyroscope's rotation and theirs differ by e. Over windows of length T

    E[e²] = 2 σ² + N² T + c² ∫|ω|² dt + K² T² (D − T)²/(6 D)     on each axis,

σ being the reference's error, N and K the gyroscope's noise, and c what scale factors, misalignments
and timing err by while the body turns (`GyroscopeNoise`). Short windows show σ, long ones the rest. The
last term is that of a bias that walks, less its mean over the record of length D, in windows that begin
anywhere: the mean square of a Wiener process's window means about its mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import GyroscopeNoise, Motion, References
from sensorbook.attitude.propagation import propagate
from sensorbook.errors import Refusal

LONGEST = 1 / 8  # of the record: longer windows are too few
BINS = 4  # of each window's length, by how much the body turned
BLOCKS = 8  # of the record, left out one at a time for the standard errors (jackknife)
WILD = 6.0  # robust standard deviations: beyond, a reference is an outlier
ALIKE = 3.0  # the root of so many independent windows is the most that one length counts
# Of a calibrated consumer gyroscope: 0.01 °/s/√Hz (data sheets have 0.004 to 0.02), and a scale factor
# off by 0.2 % for a second at a time.
TYPICAL_RANDOM_WALK, TYPICAL_IN_MOTION = np.radians(0.01), 2e-3
# Of the rms over the shortest windows: interpolating the readings, where they are late by a part of an
# interval, takes up to half of their variance out of one step, and hides a reference's error of this size.
UNSEEN = 0.3
FEWEST = 30  # windows of the shortest length that are needed


@dataclass(frozen=True, eq=False)
class Disagreement:
    """By how much gyroscope and reference part, and the terms that explain it.

    Attributes
    ----------
    window : (L,) s
    rms : (L,) rad, of e an axis over the windows of each length, the bias taken out
    explained : (L,) rad, the same from the terms below
    reference_std : σ, rad an axis
    random_walk : N, rad/s/√Hz
    in_motion : c, √s
    rate_random_walk : K, rad/s/√s
    std : standard errors of the four, in this order, by the jackknife
    bias : (3,) rad/s, of the gyroscope over the record
    duration : s, from the first reference to the last
    motion_share : c² times the mean square rate, rad²/s: beside N², what the motion adds
    """

    window: np.ndarray
    rms: np.ndarray
    explained: np.ndarray
    reference_std: float
    random_walk: float
    in_motion: float
    rate_random_walk: float
    std: tuple[float, float, float, float]
    bias: np.ndarray
    duration: float
    motion_share: float

    @property
    def reference_shown(self) -> bool:
        """Whether the reference's error shows beside the gyroscope's, by two standard errors."""
        return self.reference_std > 2 * self.std[0]

    @property
    def reference_at_most(self) -> float:
        """rad an axis: the reference's error, or what it may be at most where it does not show.

        One that is said to be perfect would be followed wherever it errs.
        """
        if self.reference_shown:
            return self.reference_std
        if not self.noise_shown:
            return float(self.rms[0]) / np.sqrt(2)
        return max(self.reference_std + 2 * self.std[0], UNSEEN * float(self.rms[0]))

    @property
    def noise_shown(self) -> bool:
        """Whether the gyroscope's N shows, by two standard errors."""
        return self.random_walk > 2 * self.std[1]

    @property
    def motion_shown(self) -> bool:
        """Whether what the motion adds shows, by two standard errors."""
        return self.in_motion > 2 * self.std[2]

    @property
    def noise_at_most(self) -> float:
        """rad/s/√Hz: what N may be at most: a third of what grows over the longest windows, which their
        own scatter hides."""
        return float(
            np.sqrt(
                (self.random_walk + 2 * self.std[1]) ** 2
                + self.rms[-1] ** 2 / (3 * self.window[-1])
            )
        )


def disagreement(
    motion: Motion, references: References, random_walk: float | None = None
) -> Disagreement:
    """The terms from a record with references; `random_walk` N where it is known from a rest.

    Raises
    ------
    Refusal
        the references are too few
    """
    pairs = _pairs(motion, references)
    bias = _bias(pairs)
    stamps = motion.time[references.at]
    duration = float(stamps[-1] - stamps[0])
    terms, window, rms, explained = _fit(pairs, bias, duration, random_walk)
    blocks = np.quantile(pairs.start, np.linspace(0, 1, BLOCKS + 1)[1:-1])
    block = np.searchsorted(blocks, pairs.start, side="right")
    parts = (pairs.where(block != left) for left in range(BLOCKS))
    without = [_fit(part, bias, duration, random_walk)[0] for part in parts]
    # Of variances, turned into standard errors of their roots; a root near 0 has its own size.
    scatter = np.sqrt(
        (BLOCKS - 1) / BLOCKS * ((without - np.mean(without, axis=0)) ** 2).sum(axis=0)
    )
    root = np.sqrt(terms)
    std = np.where(
        root > 0, scatter / (2 * np.maximum(root, np.sqrt(scatter) / 2 + 1e-300)), np.sqrt(scatter)
    )
    return Disagreement(
        window, rms, explained, *map(float, root), tuple(map(float, std)), bias,
        duration,
        float(terms[2] * np.mean((motion.increments**2).sum(axis=1) / motion.steps**2)),
    )  # fmt: skip


def tuned(
    found: Disagreement,
    random_walk: float | tuple[float, float, float] | None = None,
    rate_random_walk: float | tuple[float, float, float] | None = None,
    bias_std: float = 0.05,
) -> GyroscopeNoise:
    """What a filter is given: N and K from the noise chapters where known, the rest as found here.

    An N that does not show is that of a consumer's gyroscope, or as large as it may be where that is
    less; none at all would let the filter follow no reference.

    A bias that a filter holds constant for ever is one that it stops to follow: where nothing shows K
    by three standard errors, it is as large as a record of this length could not tell from none,
    K = N/T, with all that makes the attitude part over the longest windows for N.
    """
    white = random_walk
    if white is None:
        unshown = min(max(found.random_walk, TYPICAL_RANDOM_WALK), found.noise_at_most)
        white = found.random_walk if found.noise_shown else unshown
    if rate_random_walk is None:
        grown = max(found.explained[-1] ** 2 - 2 * found.reference_std**2, 0.0) / found.window[-1]
        unseen = max(float(np.sqrt(grown)), float(np.mean(white))) / found.duration
        shown = found.rate_random_walk > 3 * found.std[3]
        rate_random_walk = max(found.rate_random_walk if shown else 0.0, unseen)
    return GyroscopeNoise(white, rate_random_walk, bias_std, found.in_motion)


def assumed(
    duration: float,
    random_walk: float | tuple[float, float, float] | None = None,
    rate_random_walk: float | tuple[float, float, float] | None = None,
    bias_std: float = 0.05,
) -> GyroscopeNoise:
    """What a filter is given where no reference is good enough to show it: N and K of the noise
    chapters where known, those of a consumer's gyroscope else. `duration` s, of the record."""
    white = TYPICAL_RANDOM_WALK if random_walk is None else random_walk
    if rate_random_walk is None:
        rate_random_walk = float(np.mean(white)) / duration
    return GyroscopeNoise(white, rate_random_walk, bias_std, TYPICAL_IN_MOTION)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Windows between two references: which length (n,), start (n,) s, length (n,) s, e (n, 3) rad,
    S (n, 3, 3) s, which a bias is multiplied with, and ∫|ω|² dt (n,) rad²/s."""

    which: np.ndarray
    start: np.ndarray
    length: np.ndarray
    apart: np.ndarray
    carried: np.ndarray
    turned: np.ndarray

    def where(self, chosen: np.ndarray) -> _Pairs:
        return _Pairs(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


def _pairs(motion: Motion, references: References) -> _Pairs:
    time, at = motion.time, references.at
    stamps = time[at]
    if len(at) < FEWEST:
        raise Refusal(
            f"{len(at)} references do not tell how good they and the gyroscope are.",
            f"Record {FEWEST} or more.",
        )
    gyro = Rotation.from_quat(propagate(motion.increments, [0.0, 0.0, 0.0, 1.0]))
    matrix, steps = gyro.as_matrix(), motion.steps
    zero = np.zeros((1, 3, 3))
    carried = np.concatenate(
        [zero, np.cumsum((matrix[1:] + matrix[:-1]) * (steps / 2)[:, None, None], axis=0)]
    )
    speed = np.concatenate([[0.0], np.cumsum((motion.increments**2).sum(axis=1) / steps)])
    gaps = np.concatenate([[0.0], np.cumsum(motion.lost > 0)])
    reference = Rotation.from_quat(references.quaternion)
    found = []
    shortest = float(np.median(np.diff(stamps)))
    lengths = shortest * 2.0 ** np.arange(0, 40)
    for which, length in enumerate(lengths[lengths <= LONGEST * (stamps[-1] - stamps[0])]):
        end = np.searchsorted(stamps, stamps + length - shortest / 2)
        first = np.flatnonzero(end < len(at))
        last = end[first]
        near = np.abs(stamps[last] - stamps[first] - length) <= 0.25 * length
        near &= (gaps[at[last]] == gaps[at[first]]) & (last > first)
        first, last = first[near], last[near]
        if len(first) < (FEWEST if not which else 2 * BINS):
            continue
        i, j = at[first], at[last]
        theirs, mine = (r[a].inv() * r[b] for r, a, b in ((reference, first, last), (gyro, i, j)))
        back = np.swapaxes(matrix[j], -1, -2)
        found.append(
            (np.full(len(i), which), stamps[first], stamps[last] - stamps[first],
             (theirs.inv() * mine).as_rotvec(), back @ (carried[j] - carried[i]), speed[j] - speed[i])
        )  # fmt: skip
    if not found:
        raise Refusal(
            "Too few references follow one another to tell how good they and the gyroscope are.",
            "Record them at an even rate, over more than eight times their interval.",
        )
    return _Pairs(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _bias(pairs: _Pairs) -> np.ndarray:
    """(3,) rad/s, by least squares over the longest windows, twice: without outliers then."""
    mine = pairs.which >= pairs.which.max() - 2
    apart, carried = pairs.apart[mine], pairs.carried[mine]
    bias, good = np.zeros(3), np.ones(len(apart), dtype=bool)
    for _ in range(2):
        bias = np.linalg.lstsq(carried[good].reshape(-1, 3), apart[good].reshape(-1), rcond=None)[0]
        size = np.linalg.norm(apart - carried @ bias, axis=1)
        good = size <= WILD * np.median(size)
    return bias


def _fit(pairs: _Pairs, bias: np.ndarray, duration: float, random_walk: float | None):
    """Variances of the four terms, and by window: length, rms and what the terms explain of it."""
    apart = ((pairs.apart - pairs.carried @ bias) ** 2).mean(axis=1)

    def means(chosen: np.ndarray) -> tuple[float, ...]:
        """Of some windows: length, what was seen, and what each term has for a factor."""
        length = pairs.length[chosen]
        walk = (length**2 * (duration - length) ** 2 / (6 * duration)).mean()
        return (
            length.mean(),
            apart[chosen].mean(),
            2.0,
            length.mean(),
            pairs.turned[chosen].mean(),
            walk,
        )

    rows, weights, windows = [], [], []
    for which in np.unique(pairs.which):
        mine = np.flatnonzero(pairs.which == which)
        mine = mine[apart[mine] <= WILD**2 * np.median(apart[mine])]
        if len(mine) < BINS:
            continue
        windows.append(means(mine))
        for part in np.array_split(mine[np.argsort(pairs.turned[mine])], BINS):
            rows.append(means(part))
            # Errors that come back as the body turns back are no random walk: every length counts
            # about the same, or the many short windows would overstate the long ones.
            weights.append(min(np.sqrt(duration / rows[-1][0] / BINS), ALIKE))
    rows, weights, windows = np.array(rows), np.array(weights), np.array(windows)
    seen, factors = np.maximum(rows[:, 1], 1e-24), rows[:, 2:]
    known = np.array([0.0, 0.0 if random_walk is None else random_walk**2, 0.0, 0.0])
    free = np.array([True, random_walk is None, True, True])
    scale = np.maximum(factors.max(axis=0), 1e-24)
    size = seen
    for _ in range(3):  # a mean square scatters in proportion to itself
        weight = (weights / size)[:, None]
        left = seen - factors @ known
        solved, _ = nnls((factors / scale)[:, free] * weight, left * weight[:, 0])
        terms = known.copy()
        terms[free] = solved / scale[free]
        size = np.maximum(factors @ terms, 1e-3 * seen)
    explained = windows[:, 2:] @ terms
    return terms, windows[:, 0], np.sqrt(windows[:, 1]), np.sqrt(explained)


def noise_terms(noise: Mapping | None) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """N and K by axis, SI, of `noise` in the record of a noise chapter; None where an axis lacks one."""
    found = []
    for term in ("random_walk", "rate_random_walk"):
        entries = [(noise or {}).get(axis, {}).get(term) for axis in "xyz"]
        found.append(tuple(e["value"] for e in entries) if all(entries) else None)
    return tuple(found)
