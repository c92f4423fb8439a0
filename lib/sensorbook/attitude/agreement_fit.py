"""The fit behind `agreement`: M, bias and delay from windows, with as many freedoms as the motion tells.

A direction about which the body did not turn shows only the readings' noise. A column of M fitted
to that would be noise over noise; so M has nine freedoms where three directions are told, a turn and
one scale where two are, one scale and the two turns that move the axis where only one is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.propagation import propagate, rotation_increments
from sensorbook.attitude.windows import Windows

_HUBER = 3.0  # times the usual residual, from which on a reference counts less
_SURE = 0.1  # relative standard error above which a direction of M is not told
_SEEN = 0.25  # the same, of the last direction: above it nothing is told
_STEPS = 10  # of Gauss and Newton, at most
_KEPT = 0.95  # share of references that rms and share of motion are taken from
_ABOVE = 3.0  # times what noise alone would turn, squared, from which on a direction may be told
_WEAK = 0.01  # squared turn against the strongest direction's
_HOPE = 0.3  # share of the motion that three steps must explain, for a trial to go on
_SLOPES = (0.5, 2.0)  # of a weak direction's scale against the whole: else drift passes for motion


@dataclass(frozen=True, eq=False)
class Start:
    """Where a fit starts: M is that of the rates times `unit`."""

    matrix: np.ndarray
    delay: float = 0.0
    unit: float = 1.0


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found, with the rates times `unit`.

    Attributes
    ----------
    covariance : (P, P) of the elements of M by rows where three directions are told; else of the
        relative scale and the turns about `axes`; then of bias and delay
    directions : (K, 3) unit vectors in the gyroscope's axes, strongest first, about which the turn
        tells M
    axes : (R, 3) in the reference's body axes; empty where three directions are told
    weight : (M,) of each reference, by Huber
    one_axis : the body turned less than a tenth as far about any other axis
    """

    matrix: np.ndarray
    bias: np.ndarray
    delay: float
    covariance: np.ndarray
    directions: np.ndarray
    axes: np.ndarray
    residual: float
    turn: float
    unit: float
    weight: np.ndarray
    one_axis: bool = False

    @property
    def moved(self) -> bool:
        return len(self.directions) > 0

    @property
    def explained(self) -> float:
        return 1 - (self.residual / self.turn) ** 2 if self.turn else 0.0

    @property
    def told(self) -> np.ndarray:
        """Standard errors of M along what is free, ascending."""
        of_matrix = self.covariance[:-4, :-4]
        size = np.linalg.norm(self.matrix) / np.sqrt(3)
        if len(self.directions) == 3:
            by_column = np.einsum("ijil->jl", of_matrix.reshape(3, 3, 3, 3)) / 3
            std = np.sqrt(np.clip(np.linalg.eigvalsh(by_column), 0, None))
        else:
            std = size * np.sort(np.sqrt(np.clip(np.diag(of_matrix), 0, None)))
        return std / max(1.0, size)

    @property
    def as_declared(self) -> bool:
        """M near I and hardly any delay: what is not explained is the reference's noise."""
        near = np.abs(self.matrix - np.eye(3)).max() < 0.1 and abs(self.delay) < 0.1
        return bool(self.moved and near and self.told[0] < _SURE and self.explained > 0.1)


def fit_motion(time, rate, windows: Windows, start: Start, trial: bool = False) -> Fit:
    """With as many directions as the readings turn about and the reference tells, three at most.

    A `trial` is given up early where it leads nowhere.
    """
    directions, squares = _directions(time, rate * start.unit, windows)
    one_axis = len(squares) == 1 or (len(squares) > 1 and squares[1] < _WEAK * squares[0])
    matrix = start.matrix
    while len(directions):
        if len(directions) < 3:
            matrix = _similar(matrix, directions)
            if matrix is None:
                break
        at = Start(matrix, start.delay, start.unit)
        fit = _iterate(time, rate, windows, at, directions, trial)
        if trial and fit.explained < _HOPE:
            return fit
        last = len(directions) == 1
        if fit.told[-1] <= (_SEEN if last else _SURE) and (
            last
            or squares[-1] > _WEAK * squares[0]
            or _confirmed(time, rate, windows, fit, squares)
        ):
            return replace(fit, one_axis=bool(one_axis))
        matrix = fit.matrix
        directions, squares = directions[:-1], squares[:-1]
    plain = Start(np.eye(3), 0.0, start.unit)
    return _iterate(time, rate, windows, plain, np.zeros((0, 3)))


def turns(time, rate, windows: Windows, delay: float = 0.0) -> np.ndarray:
    """(M, 3) rad, the integrated rates at the references, read late by `delay`."""
    steps = np.diff(time)[:, None] * (rate[1:] + rate[:-1]) / 2
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    at = time[windows.at] + delay
    return np.stack([np.interp(at, time, axis) for axis in turned.T], axis=1)


def _off_bias(time, windows: Windows, values: np.ndarray, weight=None) -> np.ndarray:
    """Less the window's mean and one rate for all: a steady rate cannot be told from a bias."""
    values = windows.off_mean(values, weight)
    passed = windows.off_mean(time[windows.at], weight)
    weighed = passed if weight is None else passed * weight
    return values - np.outer(passed, weighed @ values / (weighed @ passed))


def _directions(time, rate, windows: Windows):
    """Directions (K, 3) in which the readings turn by more than their noise, and Σ of turn², (K,)."""
    turned = turns(time, rate, windows)
    own = _off_bias(time, windows, turned)
    noise = _white_noise(time, rate) * windows.walk(time).sum()
    missed = _scale(windows.off_mean(windows.vectors(windows.rotation)) - windows.off_mean(turned))
    noise = min(noise, missed**2 * len(own))
    squares, vectors = np.linalg.eigh(own.T @ own)
    told = squares > max(_ABOVE * noise, 1e-18 * len(own))
    vectors = vectors.T[told][::-1]
    largest = np.abs(vectors).argmax(axis=1)
    vectors = vectors * np.sign(vectors[np.arange(len(vectors)), largest])[:, None]
    return vectors, (squares - noise)[told][::-1]


def _confirmed(time, rate, windows: Windows, fit: Fit, squares: np.ndarray) -> bool:
    """Whether the reference turns with the readings in the weakest direction too, not only in the others.

    A bias that drifts turns by more than white noise; the reference has none of that.
    """
    own = _off_bias(time, windows, turns(time, rate * fit.unit, windows, fit.delay), fit.weight)
    other = windows.off_mean(windows.vectors(windows.rotation), fit.weight)
    weak, strong = own @ fit.directions[-1], own @ fit.directions[:-1].T
    # Less what goes with the stronger directions, in the readings and in the reference.
    weak = weak - strong @ np.linalg.lstsq(strong, weak, rcond=None)[0]
    across = np.linalg.qr(fit.matrix @ fit.directions.T)[0][:, -1]
    slope = abs((weak * fit.weight) @ (other @ across)) / ((weak * fit.weight) @ weak)
    size = np.linalg.norm(fit.matrix @ fit.directions[0])
    return _SLOPES[0] * size < slope < _SLOPES[1] * size


def _similar(matrix: np.ndarray, directions: np.ndarray) -> np.ndarray | None:
    """The scale and turn nearest to M for one or two directions; None where M has no size there."""
    seen = matrix @ directions.T
    size = np.linalg.norm(seen) / np.sqrt(len(directions))
    if size < 1e-6:
        return None
    if len(directions) == 2:
        return size * orthogonal_part(seen @ directions)
    # The smallest turn: none about the axis itself, of which nothing is known.
    return size * Rotation.align_vectors(seen.T / size, directions)[0].as_matrix()


def _freedoms(matrix: np.ndarray, directions: np.ndarray):
    """How what is told of M changes (9, P − 4) by scale and turns, and the turns' axes (R, 3)."""
    if len(directions) == 3:
        return np.eye(9), np.zeros((0, 3))
    if not len(directions):
        return np.zeros((9, 0)), np.zeros((0, 3))
    axes = np.eye(3)
    if len(directions) == 1:
        axes = np.linalg.svd((matrix @ directions[0])[None])[2][1:]
    seen = matrix @ directions.T @ directions
    changes = [seen, *(np.cross(axis, seen, axisb=0, axisc=0) for axis in axes)]
    return np.stack([change.ravel() for change in changes], axis=1), axes


def _changed(matrix, directions, axes, change) -> np.ndarray:
    if len(directions) == 3:
        return matrix + change.reshape(3, 3)
    if not len(directions):
        return matrix
    turn = Rotation.from_rotvec(np.clip(change[1:], -0.5, 0.5) @ axes)
    return _similar((1 + np.clip(change[0], -0.5, 1.0)) * turn.as_matrix() @ matrix, directions)


def _iterate(time, rate, windows: Windows, start: Start, directions, trial=False) -> Fit:
    """Gauss–Newton. Standard errors before any data are 1 for M, 1 rad/s and 1 s: they stand where
    the motion does not tell."""
    rate = rate * start.unit
    matrix, bias, delay = start.matrix, np.zeros(3), start.delay
    weight = np.ones(len(windows.at))
    whole = np.linalg.norm(windows.off_mean(windows.vectors(windows.rotation)), axis=1)
    noise, walk = _white_noise(time, rate), windows.walk(time)
    smooth = max(0.0, 1 - 2 * _ahead(time) / windows.span) / (2 * _ahead(time))
    mean_walk, size = walk.sum() / len(weight), windows.sums(weight)
    for step in range(_STEPS):
        off, design = _linearised(time, rate, windows, matrix, bias, delay)
        free, axes = _freedoms(matrix, directions)
        count = free.shape[1]
        design = np.concatenate([design[..., :9] @ free, design[..., 9:]], axis=2)
        if not count:
            design[..., -1] = 0.0  # the delay stays where it was
        x, y = windows.off_mean(design, weight), windows.off_mean(off, weight)
        variance = max(_scale(y) ** 2, 1e-18)
        weighed = x * weight[:, None, None]
        normal = windows.sums(np.swapaxes(weighed, 1, 2) @ x)
        right = windows.sums(np.einsum("mip,mi->mp", weighed, y))
        # The readings' noise is in the design and in what is missed: it would draw M to zero, and
        # what it adds to the design tells nothing.
        own = walk * windows.sums(weight) / size * min(noise, variance / mean_walk)
        right[:, :count] += np.multiply.outer(own, free.T @ matrix.ravel())
        normal[:, :count, :count] -= np.multiply.outer(own, free.T @ free)
        # The change of the rate is noisy as well.
        own = (
            3
            * np.cbrt(np.linalg.det(matrix)) ** 2
            * min(noise, variance / mean_walk)
            * smooth
            * windows.sums(weight)
        )
        if normal[:, -1, -1].sum() > _ABOVE * own.sum():
            normal[:, -1, -1] -= own
        else:  # the delay stays where it was
            normal[:, -1], normal[:, :, -1], right[:, -1] = 0.0, 0.0, 0.0
        prior = variance * np.eye(x.shape[2])
        change = np.linalg.solve(normal.sum(axis=0) + prior, right.sum(axis=0))
        left = y - x @ change
        matrix = _changed(matrix, directions, axes, change[:count])
        bias = bias + change[-4:-1]
        delay += float(np.clip(change[-1], -0.25, 0.25))
        usual = _scale(left)
        length = np.linalg.norm(left, axis=1)
        weight = np.minimum(1.0, np.maximum(_HUBER * usual, 1e-12) / np.maximum(length, 1e-12))
        nowhere = trial and step == 2 and _rms(length) ** 2 > (1 - _HOPE) * _rms(whole) ** 2
        if nowhere or matrix is None or (step > 1 and np.abs(change).max() < 1e-6):
            break
    return Fit(
        np.zeros((3, 3)) if matrix is None else matrix,
        bias,
        delay,
        _jackknife(normal, right, prior),
        directions,
        axes,
        residual=_rms(length),
        turn=float(np.sqrt(np.mean(whole[length <= np.quantile(length, _KEPT)] ** 2))),
        unit=start.unit,
        weight=weight,
    )


def _ahead(time) -> float:
    """s before and after, by which the rate's change is told: white noise is less of it than at once."""
    return max(0.1, float(np.median(np.diff(time))) / 2)


def _linearised(time, rate, windows: Windows, matrix, bias, delay):
    """What the integrated attitudes miss (M, 3), and its derivatives (M, 3, 13), in axes that do not
    turn with the body; both up to a constant a window."""
    step = np.diff(time)[:, None]
    attitude = propagate(rotation_increments(time, (rate - bias) @ matrix.T, delay), [0, 0, 0, 1])
    turn = Rotation.from_quat(attitude).as_matrix()
    middle = (turn[1:] + turn[:-1]) / 2
    plain = rotation_increments(time, rate - bias, delay, coning=False)
    ahead = _ahead(time)
    late, early = (
        rotation_increments(time, rate, delay + s * ahead, coning=False) for s in (1, -1)
    )
    slope = (late - early) / (2 * ahead)

    def at_references(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])[windows.at]

    design = np.empty((len(windows.at), 3, 13))
    for i in range(3):
        for j in range(3):
            design[:, :, 3 * i + j] = at_references(middle[:, :, i] * plain[:, j : j + 1])
        design[:, :, 9 + i] = at_references(-(middle @ matrix[:, i]) * step)
    design[:, :, 12] = at_references(np.einsum("nij,nj->ni", middle, slope @ matrix.T))
    # R_reference = C R_integrated within a window, C constant; what C changes by is the error.
    return windows.vectors(
        windows.rotation * Rotation.from_quat(attitude[windows.at]).inv()
    ), design


def _scale(left: np.ndarray) -> float:
    """Standard deviation an axis from the median length; 1.538 is the χ distribution's, of 3 axes."""
    return float(np.median(np.linalg.norm(left, axis=1))) / 1.538


def _rms(length: np.ndarray) -> float:
    """Without the longest twentieth, which outliers may be."""
    return float(np.sqrt(np.mean(length[length <= np.quantile(length, _KEPT)] ** 2)))


def _white_noise(time: np.ndarray, rate: np.ndarray) -> float:
    """N², (rad/s)²/Hz an axis, from second differences, whose variance is 6 N²/h; motion adds to it."""
    return _scale(np.diff(rate, 2, axis=0)) ** 2 / 6 * float(np.median(np.diff(time)))


def _jackknife(normal, right, prior) -> np.ndarray:
    """Covariance from the change of the solution as each window is left out, and the prior's part."""
    whole, count = normal.sum(axis=0) + prior, len(normal)
    both = np.linalg.solve(whole, right.sum(axis=0))
    without = np.linalg.solve(whole - normal, (right.sum(axis=0) - right)[..., None])[..., 0]
    spread = without - both
    kept = np.linalg.solve(whole, prior)
    return (count - 1) / count * spread.T @ spread + kept @ kept.T


def orthogonal_part(matrix: np.ndarray) -> np.ndarray:
    """The rotation nearest to M (3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
