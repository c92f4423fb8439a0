"""What nature says of readings of unknown unit: rigid rotation, the sphere, the converter's step.

A field that stands still in space turns in the sensor's axes as dv/dt = −ω × v: from it follow which
of two sensors is the gyroscope, and its scale where the time is known, or the time where the scale is.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation as Turn

_LAGS = (1, 2, 4, 8, 16, 32)  # samples
_PARTS = 8
_MOST_TURNS = 20
_LONGEST_TURN = 3000  # samples: a gyroscope's bias turns longer ones astray


@dataclass(frozen=True)
class Rotation:
    """How a rate of turn explains the turn of a field.

    Attributes
    ----------
    scale : radians that one unit of the rate turns in one sample
    error : standard error of `scale`, from the scatter between eighths of the record
    share : of the field's change that is explained (R²)
    """

    scale: float
    error: float
    share: float

    @property
    def convincing(self) -> bool:
        """True where the two belong together and the scale is known to a few per cent."""
        return self.share > 0.6 and self.scale > 0 and self.error < 0.06 * self.scale


def rotation_scale(rate: np.ndarray, field: np.ndarray) -> Rotation:
    """Scale of a rate of turn by the field it turns.

    Parameters
    ----------
    rate : (N, 3) readings in any unit, less their bias
    field : (N, 3) readings at the same instants, offset removed

    Returns
    -------
    Rotation : of the shortest lag at which nearly as much is explained as at any: the chord of a
        long turn is shorter than its arc
    """
    angle = np.vstack([np.zeros(3), np.cumsum((rate[1:] + rate[:-1]) / 2, axis=0)])
    found = [Rotation(0.0, np.inf, 0.0)]
    for lag in _LAGS:
        if len(rate) < 20 * lag:
            break
        turned = angle[lag:] - angle[:-lag]
        middle = (field[lag:] + field[:-lag]) / 2
        change = field[lag:] - field[:-lag]
        expected = -np.cross(turned, middle)
        parts = [
            (float((c * e).sum()), float((e * e).sum()), float((c * c).sum()))
            for c, e in zip(np.array_split(change, _PARTS), np.array_split(expected, _PARTS),
                            strict=True)
        ]  # fmt: skip
        both, mine, its = np.array(parts).T
        if not mine.sum() or not its.sum():
            continue
        scale = both.sum() / mine.sum()
        share = both.sum() ** 2 / (mine.sum() * its.sum())
        # Jackknife over the parts, most of which may hold little motion.
        without = (both.sum() - both) / np.maximum(mine.sum() - mine, 1e-300)
        error = np.sqrt((_PARTS - 1) / _PARTS * ((without - without.mean()) ** 2).sum())
        found.append(Rotation(float(scale), float(error), float(share)))
    most = max(rotation.share for rotation in found)
    return next(rotation for rotation in found if rotation.share >= 0.98 * most)


def rotation_scale_between(
    rate: np.ndarray, field: np.ndarray, rests: Sequence[tuple[int, int]], near: float
) -> Rotation | None:
    """Scale of a rate of turn by what lies between rests, where only gravity pulls.

    In motion an accelerometer feels the hand, too; from rest to rest its directions must differ by
    what the gyroscope turned in between (as in Tedaldi, Pretto & Menegatti, ICRA 2014).

    Parameters
    ----------
    rests : first and last sample (exclusive) of each rest, in order
    near : a scale found otherwise, right to 30 %
    """
    turns = []
    for (start, end), (following, until) in itertools.pairwise(rests):
        before, after = field[start:end].mean(axis=0), field[following:until].mean(axis=0)
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        # From the middle of one rest to that of the next: nothing turns in a rest.
        middle, late = (start + end) // 2, (following + until) // 2
        if late - middle <= _LONGEST_TURN and before @ after < 0.97:
            turns.append((before, after, rate[middle:late]))
    if len(turns) < 4:
        return None
    turns = turns[:: -(-len(turns) // _MOST_TURNS)]
    coarse = near * np.exp(np.linspace(-0.3, 0.3, 16))
    near = coarse[
        np.median([[_miss(*turn, scale) for scale in coarse] for turn in turns], axis=0).argmin()
    ]
    scales = near * np.exp(np.linspace(-0.05, 0.05, 11))
    misses = np.array([[_miss(*turn, scale) for scale in scales] for turn in turns])
    still = np.array([((after - before) ** 2).sum() for before, after, _ in turns])
    # A turn that never fits was no turn in one piece: the median shields from it.
    good = misses.min(axis=1) < 0.1 * still
    if good.sum() < 4:
        return None
    misses = misses[good]

    def best(of: np.ndarray) -> float:
        total = of.sum(axis=0)
        at = int(np.clip(total.argmin(), 1, len(scales) - 2))
        left, mid, right = total[at - 1 : at + 2]
        shift = (left - right) / (2 * (left - 2 * mid + right) or 1.0)
        return float(scales[at] * np.exp(0.01 * np.clip(shift, -1, 1)))

    scale = best(misses)
    without = np.array([best(np.delete(misses, k, axis=0)) for k in range(len(misses))])
    count = len(without)
    error = np.sqrt((count - 1) / count * ((without - without.mean()) ** 2).sum())
    share = 1 - float(misses.sum(axis=0).min() / still[good].sum())
    return Rotation(scale, float(error), share)


def _miss(before: np.ndarray, after: np.ndarray, rate: np.ndarray, scale: float) -> float:
    """Squared distance between a direction after the turns, as turned and as read."""
    turns = Turn.from_rotvec(rate * scale)
    while len(turns) > 1:  # products of neighbours, again and again
        odd = turns[-1:] if len(turns) % 2 else None
        turns = turns[: len(turns) // 2 * 2 : 2] * turns[1::2]
        turns = turns if odd is None else Turn.concatenate([turns, odd])
    return float(((turns[0].inv().apply(before) - after) ** 2).sum())


@dataclass(frozen=True)
class Sphere:
    """The sphere on which readings lie: centre (3,), radius, and their scatter over the radius.

    `thickness` is the smallest extent of the readings over the radius: where it is small, they lie
    near a plane or in a corner, and the sphere is not determined.
    """

    centre: np.ndarray
    radius: float
    scatter: float
    thickness: float

    @property
    def convincing(self) -> bool:
        """True where the readings surround the centre and keep their distance from it."""
        return self.thickness > 0.3 and self.scatter < 0.15


def fit_sphere(values: np.ndarray) -> Sphere:
    """Least-squares sphere through (N, 3) readings (linear in centre and r² − c²)."""
    middle = values.mean(axis=0)
    extent = float(np.abs(values - middle).max()) or 1.0
    v = (values - middle) / extent
    design = np.column_stack([2 * v, np.ones(len(v))])
    solution, *_ = np.linalg.lstsq(design, (v**2).sum(axis=1), rcond=None)
    centre = solution[:3]
    radius = float(np.sqrt(max(solution[3] + centre @ centre, 0.0)))
    if not radius:
        return Sphere(middle, 0.0, np.inf, 0.0)
    distance = np.linalg.norm(v - centre, axis=1)
    thickness = float(np.sqrt(np.linalg.eigvalsh(np.cov(v.T))[0])) / radius
    return Sphere(
        middle + centre * extent, radius * extent, float(distance.std()) / radius, thickness
    )


def converter_step(values: np.ndarray) -> float:
    """The step between the readings (N, 3) of a converter; 0 where they lie on no lattice."""
    steps = [step for column in values.T if (step := _lattice(column[:50_000]))]
    if len(steps) < values.shape[1]:
        return 0.0
    return float(np.median(steps)) if max(steps) < 1.01 * min(steps) else 0.0


def _lattice(column: np.ndarray) -> float:
    levels = np.unique(column)
    if len(levels) < 8:
        return 0.0
    gaps = np.diff(levels)
    tiny = 1e-9 * np.abs(levels).max()
    gaps = gaps[gaps > tiny]
    step = float(np.quantile(gaps, 0.02))
    for _ in range(3):  # refined over wider and wider spans
        multiples = np.round(gaps / step)
        good = multiples >= 1
        if not good.any():
            return 0.0
        step = float((gaps[good] * multiples[good]).sum() / (multiples[good] ** 2).sum())
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if np.quantile(off, 0.9) < 0.05 else 0.0
