"""References in windows of a second or two, within which attitudes are compared, and where they break."""

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
_FAR = 6.0  # robust standard deviations of a step, beyond which the reference turns too far in it
_JUMP = np.radians(5)  # from which on a single step is a jump
_ROW = 4  # steps in a row for which less than that will do
_BESIDE = 5  # references before and after that must agree, so that outliers are no jump
_FROZEN = np.radians(2)  # the gyroscope's turn, from which on a reference that stays is frozen


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


@dataclass(frozen=True)
class Break:
    """A stretch, s, in which a reference jumps by `angle`, rad, or (`angle` 0) stays the very same."""

    start: float
    end: float
    angle: float = 0.0


def breaks(time, at, quaternion, turned, lost=None) -> tuple[Break, ...]:
    """Where a reference jumps, by far more than the gyroscope turns and for good, or is frozen.

    Parameters
    ----------
    time : (N,) s
    at : (M,) numbers of the stamps that have a reference, ascending
    quaternion : (M, 4), the references
    turned : (M, 4), attitudes integrated from the readings, in the reference's body axes
    lost : (N − 1,) true for a step that no reading tells; what lies across it is not judged
    """
    stamps = np.asarray(time)[at]
    reference, own = Rotation.from_quat(quaternion), Rotation.from_quat(turned)
    if len(stamps) < 4 * _BESIDE:
        return ()
    step = own[:-1].inv() * own[1:]
    apart = ((reference[:-1].inv() * reference[1:]).inv() * step).magnitude()
    if lost is not None:
        gaps = np.concatenate([[0], np.cumsum(np.asarray(lost, dtype=float) > 0)])[at]
        apart = np.where(np.diff(gaps) != 0, 0.0, apart)
    far = _FAR * float(np.median(apart)) / 1.538  # the χ distribution's of 3 axes
    q = reference.as_quat()
    same = np.abs(np.abs((q[1:] * q[:-1]).sum(axis=1)) - 1) < 1e-13
    held = _runs(same)
    usual = np.median([end - begin for begin, end in held]) if held else 0
    frozen = [
        (begin, end)
        for begin, end in held
        if end - begin >= max(3, 3 * usual if len(held) > 2 else 0)
        and (own[begin].inv() * own[begin : end + 1]).magnitude().max() > max(_FROZEN, far)
    ]
    found = [Break(float(stamps[begin]), float(stamps[end])) for begin, end in frozen]
    constant = reference * own.inv()
    # Where a reference wakes it catches up: that is no jump of its own.
    for begin, end in _runs(apart > max(far, 1e-6)):
        if any(begin <= last + 1 and end >= first - 1 for first, last in frozen):
            continue
        before = _middle(constant[max(0, begin + 1 - _BESIDE) : begin + 1])
        after = _middle(constant[end : end + _BESIDE])
        angle = float((before.inv() * after).magnitude())
        passed = float(step[begin:end].magnitude().sum())
        if angle > max(far, passed / 2, 0.0 if end - begin >= _ROW else _JUMP):
            found.append(Break(float(stamps[begin]), float(stamps[end]), angle))
    return tuple(found)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end, the end not included, of each stretch of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _middle(rotation: Rotation) -> Rotation:
    """The one that is nearest to the others: an outlier is not."""
    far = [(one.inv() * rotation).magnitude().sum() for one in rotation]
    return rotation[int(np.argmin(far))]
