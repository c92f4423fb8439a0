"""References in windows of a second or two, within which attitudes are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

_SPANS = (0.5, 2.0)  # s, shortest and longest window, unless references are rarer
_WANTED = 30  # windows, for which they are shortened
LEAST = 10  # windows: fewer have no scatter to take standard errors from
_TURN = 1.0  # rad a window, above which the first, linear step is no start
_MOST = 50_000  # references used, evenly chosen: more would only cost time
_KEPT = 0.95  # share of the turns that the usual speed is taken from; the worst may be outliers


@dataclass(frozen=True, eq=False)
class Windows:
    """Disjoint windows: M references, `first` (G,) where each begins, `number` (M,) of its window."""

    at: np.ndarray
    rotation: Rotation
    first: np.ndarray
    number: np.ndarray
    span: float

    @classmethod
    def of(cls, time, at, quaternion, lost) -> Windows:
        every = -(-len(at) // _MOST) or 1
        at, quaternion = at[::every], quaternion[::every]
        if len(at) < 2 * LEAST:
            return cls(at, Rotation.identity(), np.zeros(0, int), np.zeros(0, int), np.nan)
        stamps, rotation = time[at], Rotation.from_quat(quaternion)
        usual = float(np.median(np.diff(stamps)))
        span = np.clip((stamps[-1] - stamps[0]) / _WANTED, *_SPANS)
        speed = _usual_speed(stamps, rotation, usual)
        if speed > 0:
            span = min(span, max(_SPANS[0], _TURN / speed))
        # Two references at least, and two steps between the outermost.
        span = max(span, 2 * usual, 3 * float(np.median(np.diff(time))))
        tick = np.floor((stamps - stamps[0] + usual / 2) / span)
        gaps = np.zeros(len(at))
        if lost is not None:
            gaps = np.concatenate([[0], np.cumsum(np.asarray(lost, dtype=float) > 0)])[at]
        begins = np.concatenate([[True], (np.diff(tick) != 0) | (np.diff(gaps) != 0)])
        number = np.cumsum(begins) - 1
        several = np.bincount(number)[number] > 1
        number, first = np.unique(number[several], return_index=True, return_inverse=True)[1:][::-1]
        return cls(at[several], rotation[several], first, number, float(span))

    @property
    def count(self) -> int:
        return len(self.first)

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(G, …) from (M, …)."""
        return np.add.reduceat(values, self.first, axis=0)

    def off_mean(self, values: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """(M, …) less the window's weighted mean."""
        weight = np.ones(len(values)) if weight is None else weight
        shape = (-1,) + (1,) * (values.ndim - 1)
        mean = self.sums(values * weight.reshape(shape)) / self.sums(weight).reshape(shape)
        return values - mean[self.number]

    def walk(self, time: np.ndarray) -> np.ndarray:
        """(G,) s: the sum of squares about the window's mean that a random walk of 1/√s would have."""
        size = np.bincount(self.number)
        rank = np.arange(len(self.at)) - self.first[self.number]
        # Σ |t_l − t_m| over the pairs, over their number of references.
        return self.sums((2 * rank + 1 - size[self.number]) * time[self.at]) / size

    def medians(self, values: np.ndarray) -> np.ndarray:
        """(G, 3) of each component."""
        size = np.bincount(self.number)
        table = np.full((self.count, size.max(), 3), np.nan)
        table[self.number, np.arange(len(values)) - self.first[self.number]] = values
        return np.nanmedian(table, axis=1)

    def vectors(self, rotation: Rotation) -> np.ndarray:
        """(M, 3) rotation vectors from the window's middle reference, its median made the origin."""
        middle = rotation[self.first + np.bincount(self.number) // 2]
        for _ in range(2):  # the middle one may be the outlier
            found = (middle.inv()[self.number] * rotation).as_rotvec()
            middle = middle * Rotation.from_rotvec(self.medians(found))
        return (middle.inv()[self.number] * rotation).as_rotvec()


def _usual_speed(stamps: np.ndarray, rotation: Rotation, usual: float) -> float:
    """rad/s, rms over a quarter of a second, less the worst twentieth."""
    apart = min(len(stamps) - 1, max(1, round(0.25 / usual)))
    turned = (rotation[:-apart].inv() * rotation[apart:]).magnitude()
    speed = np.sort(turned / (stamps[apart:] - stamps[:-apart]))
    return float(np.sqrt(np.mean(speed[: max(1, int(_KEPT * len(speed)))] ** 2)))
