"""What a recording's samples did: at rest, rests in several attitudes, or motion throughout.

Works on raw readings of unknown unit, so that everything is relative: to the length of a field
vector (gravity, the Earth's field), or to the quietest stretches of the record itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

STILL_ANGLE = 3.0  # degrees: a field's direction that stays within does not turn
NEW_ATTITUDE = 15.0  # degrees between rests that are rests of their own
QUIET = 3.0  # times the scatter of the quietest stretches still is rest
CLEAR_REST = 30.0  # times the noise that motion makes: less, and what looks quiet is a slow hand
FEWEST_RESTS = 3
REST_SHARE = 0.25  # of the time, in a record of positions


@dataclass(frozen=True)
class Blocks:
    """Means (M, 3) and scatters (M,) of consecutive blocks of `length` samples of (N, 3) readings."""

    means: np.ndarray
    scatter: np.ndarray
    length: int

    @classmethod
    def of(cls, values: np.ndarray) -> Blocks:
        """Blocks of (N, 3) finite readings, 10 to 100 samples long."""
        length = int(np.clip(len(values) // 400, 10, 100))
        count = max(1, len(values) // length)
        cut = values[: count * length].reshape(count, -1, values.shape[1])
        return cls(cut.mean(axis=1), np.sqrt(cut.var(axis=1).sum(axis=1)), length)

    @cached_property
    def noise(self) -> float:
        """Scatter of the quietest stretches."""
        return float(np.quantile(self.scatter, 0.05))

    @cached_property
    def quiet(self) -> np.ndarray:
        """(M,) true where a block scatters no more than the quietest stretches do."""
        return self.scatter <= QUIET * self.noise

    @cached_property
    def steadiness(self) -> float:
        """Scatter of restless blocks over that of quiet ones: near 1 at rest, far above in motion."""
        typical = float(np.quantile(self.scatter, 0.95))
        return typical / self.noise if self.noise else (np.inf if typical else 1.0)


@dataclass(frozen=True)
class Motion:
    """What a sensor saw.

    Attributes
    ----------
    still : at rest throughout, but for a shock
    attitudes : number of rests in attitudes that differ from the one before
    rest_share : share of the time spent at rest
    rests : first and last sample (exclusive) of each rest
    turn : degrees within which a field's direction stays for 95 % of the time; NaN for a gyroscope
    """

    still: bool
    attitudes: int
    rest_share: float
    turn: float = np.nan
    rests: tuple[tuple[int, int], ...] = ()

    @property
    def positions(self) -> bool:
        """Rests in several attitudes, and motion between them."""
        return not self.still and self.attitudes >= FEWEST_RESTS and self.rest_share >= REST_SHARE


def of_field(values: np.ndarray, quiet: np.ndarray | None = None) -> Motion:
    """What a sensor of a field (gravity, the Earth's magnetic field) saw.

    Parameters
    ----------
    values : (N, 3) finite readings, in any unit, their offset removed
    quiet : (M,) blocks that another sensor of the same samples saw at rest, too
    """
    blocks = Blocks.of(values)
    length = np.linalg.norm(blocks.means, axis=1)
    directions = blocks.means / np.where(length, length, 1)[:, None]
    middle = np.median(directions, axis=0)
    turn = float(np.quantile(_angles(directions, middle), 0.95))
    if turn < STILL_ANGLE:
        return Motion(True, 1, 1.0, turn)
    at_rest = blocks.quiet if quiet is None else blocks.quiet & quiet
    # A slow, smooth turn is quiet, too; at rest neighbouring blocks point the same way.
    step = np.r_[_angles(directions[1:], directions[:-1]), 180.0]
    steady = (step < STILL_ANGLE / 2) | (np.r_[180.0, step[:-1]] < STILL_ANGLE / 2)
    at_rest &= steady
    attitudes, last, rests = 0, None, []
    for start, end in _runs(at_rest):
        mean = directions[start:end].mean(axis=0)
        if _angles(directions[start:end], mean).max() > STILL_ANGLE:
            continue
        rests.append((start * blocks.length, end * blocks.length))
        if last is None or _angles(mean[None], last)[0] > NEW_ATTITUDE:
            attitudes, last = attitudes + 1, mean
    return Motion(False, attitudes, float(at_rest.mean()), turn, tuple(rests))


def of_rate(values: np.ndarray) -> Motion:
    """What a gyroscope alone saw; (N, 3) finite readings in any unit."""
    blocks = Blocks.of(values)
    if blocks.steadiness < 4 and not _steps(blocks):
        return Motion(True, 1, 1.0)
    if blocks.steadiness < CLEAR_REST:
        return Motion(False, 0, 0.0)
    return Motion(False, len(_runs(blocks.quiet)), float(blocks.quiet.mean()))


def _steps(blocks: Blocks) -> bool:
    """True where the reading changes level faster than a bias drifts as it warms up."""
    width = min(9, len(blocks.means))
    level = ndimage.median_filter(blocks.means, size=(width, 1), mode="nearest")
    change = np.linalg.norm(level[width:] - level[:-width], axis=1)
    if not len(change):
        return False
    # A handling or two is no motion; a level that changes holds for the width of the filter.
    return float(np.quantile(change, 0.985)) > 5 * float(np.median(blocks.scatter))


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Starts and ends of runs of at least two true flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flags, False].astype(int)))
    return [(a, b) for a, b in edges.reshape(-1, 2) if b - a >= 2]


def _angles(directions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Degrees between directions (M, 3) and another or others."""
    cross = np.linalg.norm(np.cross(directions, others), axis=-1)
    return np.degrees(np.arctan2(cross, (directions * others).sum(axis=-1)))
