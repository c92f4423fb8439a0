"""Whether a gyroscope and a reference attitude tell of the same motion: delay, bias, scale and axes.

The reference's frame plays no part: within a window of a second or two only how the attitude changes
is compared. The readings r become the body's rate by ω(t) = M (r(t + τ) − b), and M, b and τ are
fitted so that the attitudes integrated from ω leave, in each window, a constant difference from the
reference. What is found is judged in `verdicts`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.propagation import propagate, rotation_increments
from sensorbook.attitude.windows import LEAST, Windows

_HUBER = 3.0  # times the usual residual, from which on a reference counts less
_SURE = 0.1  # relative standard error above which a direction of M is not told
_SEEN = 0.25  # the same, of the best direction: above it nothing is told
_MOVING = 0.1  # rad a window: more is no reference's noise
_STEPS = 10  # of Gauss and Newton, at most
_KEPT = 0.95  # share of references that rms and share of motion are taken from


@dataclass(frozen=True, eq=False)
class Agreement:
    """How a gyroscope's readings become the reference's motion: true rate = M (reading − bias).

    Attributes
    ----------
    delay : τ, s, by which the readings are late, as `rotation_increments` takes it; 0 where it is not told
    delay_std : s, infinite where it is not told
    bias, bias_std : (3,) rad/s, in the gyroscope's axes
    matrix : (3, 3), M
    scale, scale_std : ∛|det M|, the reference's turn for one of the gyroscope
    misalignment, misalignment_std : (3,) rad, rotation vector of the rotation nearest to M, which
        turns components in the gyroscope's axes into those in the reference's body axes
    mirrored : M turns right-handed axes into left-handed ones
    residual : rad, rms angle between the reference and the fit, in a window
    turn : rad, rms angle of the reference about its mean, in a window
    explained : 1 − residual²/turn², the share of the motion that the fit explains
    windows : number of windows, which are disjoint and share no reference
    span : s, length of a window
    interval : s, usual interval of the readings
    moved : there was motion enough to tell anything
    """

    delay: float
    delay_std: float
    bias: np.ndarray
    bias_std: np.ndarray
    matrix: np.ndarray
    scale: float
    scale_std: float
    misalignment: np.ndarray
    misalignment_std: np.ndarray
    mirrored: bool
    residual: float
    turn: float
    explained: float
    windows: int
    span: float
    interval: float
    moved: bool

    @property
    def delay_taken(self) -> float:
        """s, the delay where it differs from none by 1.96 standard errors, else 0."""
        return self.delay if abs(self.delay) > 1.96 * self.delay_std else 0.0

    @property
    def angle(self) -> float:
        """rad, of the misalignment."""
        return float(np.linalg.norm(self.misalignment))

    @property
    def angle_std(self) -> float:
        """rad, standard error of the angle along the misalignment's axis."""
        if not self.angle:
            return float(np.linalg.norm(self.misalignment_std))
        return float(np.linalg.norm(self.misalignment / self.angle * self.misalignment_std))


def agreement(
    time: ArrayLike,
    rate: ArrayLike,
    at: ArrayLike,
    quaternion: ArrayLike,
    lost: ArrayLike | None = None,
) -> Agreement:
    """Delay, bias, scale and axes of a gyroscope against a reference, with standard errors.

    Gauss–Newton steps with Huber's weights; standard errors are the jackknife's over windows (Cameron
    & Miller 2015), so that the errors of references within a window, and the gyroscope's, may be
    correlated. Where the readings do not fit as they are, a clock up to 2 s off, turned axes and
    another unit are tried as well. A direction about which the body hardly turned leaves M a
    rotation and one scale.

    Parameters
    ----------
    time : (N,) s, ascending
    rate : (N, 3) rad/s
    at : (M,) numbers of the stamps that have a reference, ascending
    quaternion : (M, 4), reference → body
    lost : (N − 1,) true for a step that no reading tells; no window reaches across it
    """
    time, rate = np.asarray(time, dtype=float), np.asarray(rate, dtype=float)
    at, quaternion = np.asarray(at), np.asarray(quaternion, dtype=float)
    if len(at) != len(quaternion):
        raise ValueError(f"{len(at)} stamps and {len(quaternion)} references: they go in pairs")
    windows = Windows.of(time, at, quaternion, lost)
    interval = float(np.median(np.diff(time)))
    if windows.count < LEAST:
        return _untold(windows, interval, np.nan, np.nan, np.nan)
    fit = _fit(time, rate, windows, _Start(np.eye(3)))
    if not fit.as_declared and (fit.explained < 0.9 or fit.told[0] > _SEEN):
        for start in _starts(time, rate, windows):
            other = _fit(time, rate, windows, start)
            # Only where it explains much more: noise always prefers one of several.
            better = 1 - other.explained < 0.7 * (1 - fit.explained) or fit.told[0] > _SEEN
            if other.explained > 0.5 and other.told[0] <= _SEEN and better:
                fit = other
            if fit.explained > 0.97 and fit.told[0] <= _SEEN:
                break
    if fit.told[0] > _SEEN or _still(time, rate * fit.unit, windows, fit):
        return _untold(windows, interval, fit.residual, fit.turn, fit.explained)
    return _told(fit, windows, interval)


def _still(time, rate, windows: Windows, fit: _Fit) -> bool:
    """Neither turns by more than the reference's noise, and nothing of it agrees."""
    if fit.explained > 0.5 or fit.turn > _MOVING:
        return False
    steps = np.diff(time)[:, None] * (rate[1:] - np.median(rate, axis=0))
    own = windows.off_mean(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])[windows.at])
    return bool(np.sqrt(np.mean((own**2).sum(axis=1))) < 0.5 * fit.residual)


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a fit starts: M is that of the rates times `unit`."""

    matrix: np.ndarray
    delay: float = 0.0
    unit: float = 1.0


@dataclass(frozen=True, eq=False)
class _Fit:
    matrix: np.ndarray
    bias: np.ndarray
    delay: float
    covariance: np.ndarray  # (13, 13) of M by rows, bias and delay
    residual: float
    turn: float
    unit: float

    @property
    def explained(self) -> float:
        return 1 - (self.residual / self.turn) ** 2 if self.turn else 0.0

    @property
    def told(self) -> np.ndarray:
        """(3,) standard errors of M along the directions of turning, ascending."""
        by_column = np.einsum("ijil->jl", self.covariance[:9, :9].reshape(3, 3, 3, 3)) / 3
        return np.sqrt(np.clip(np.linalg.eigvalsh(by_column), 0, None))

    @property
    def as_declared(self) -> bool:
        """M near I and hardly any delay: what is not explained is the reference's noise."""
        near = np.abs(self.matrix - np.eye(3)).max() < 0.1 and abs(self.delay) < 0.1
        return bool(near and self.told[0] < _SURE and self.explained > 0.1)


def _fit(time, rate, windows: Windows, start: _Start) -> _Fit:
    fit = _iterate(time, rate, windows, start, similar=False)
    if fit.told[2] > _SURE:
        matrix = fit.matrix if fit.told[2] < 2 * _SURE else start.matrix
        rotation = orthogonal_part(matrix)
        size = np.trace(rotation.T @ matrix) / 3
        similar = _Start(size * rotation, start.delay, start.unit)
        return _iterate(time, rate, windows, similar, similar=True)
    return fit


def _iterate(time, rate, windows: Windows, start: _Start, similar: bool) -> _Fit:
    """Gauss–Newton. Standard errors before any data are 1 for M, 1 rad/s and 1 s: they stand where
    the motion does not tell."""
    rate = rate * start.unit
    matrix, bias, delay = start.matrix, np.zeros(3), start.delay
    weight = np.ones(len(windows.at))
    turned = windows.vectors(windows.rotation)
    noise, walk = _white_noise(time, rate), windows.walk(time)
    mean_walk = walk.sum() / len(weight)
    for step in range(_STEPS):
        off, design = _linearised(time, rate, windows, matrix, bias, delay)
        basis = _similarity(matrix) if similar else np.eye(13)
        design = design @ basis
        x, y = windows.off_mean(design, weight), windows.off_mean(off, weight)
        variance = max(_scale(y) ** 2, 1e-18)
        normal = windows.sums(np.einsum("m,mip,miq->mpq", weight, x, x))
        right = windows.sums(np.einsum("m,mip,mi->mp", weight, x, y))
        # The readings' noise is in the design and in what is missed: it would draw M to zero.
        right += np.multiply.outer(
            walk * min(noise, variance / mean_walk), basis[:9].T @ matrix.ravel()
        )
        prior = variance * np.eye(x.shape[2])
        change = np.linalg.solve(normal.sum(axis=0) + prior, right.sum(axis=0))
        left = y - x @ change
        full = basis @ change
        matrix, bias = matrix + full[:9].reshape(3, 3), bias + full[9:12]
        delay += float(np.clip(full[12], -0.25, 0.25))
        usual = _scale(left)
        size = np.linalg.norm(left, axis=1)
        weight = np.minimum(1.0, _HUBER * usual / np.maximum(size, 1e-300))
        if step > 1 and np.abs(full).max() < 1e-6:
            break
    covariance = basis @ _jackknife(normal, right, prior, variance) @ basis.T
    kept = size <= np.quantile(size, _KEPT)
    whole = windows.off_mean(turned)[kept]
    return _Fit(
        matrix,
        bias,
        delay,
        covariance,
        residual=float(np.sqrt(np.mean(size[kept] ** 2))),
        turn=float(np.sqrt(np.mean((whole**2).sum(axis=1)))),
        unit=start.unit,
    )


def _linearised(time, rate, windows: Windows, matrix, bias, delay):
    """What the integrated attitudes miss (M, 3), and its derivatives (M, 3, 13), in axes that do not
    turn with the body; both up to a constant a window."""
    step = np.diff(time)[:, None]
    attitude = propagate(rotation_increments(time, (rate - bias) @ matrix.T, delay), [0, 0, 0, 1])
    turn = Rotation.from_quat(attitude).as_matrix()
    middle = (turn[1:] + turn[:-1]) / 2
    plain = rotation_increments(time, rate - bias, delay, coning=False)
    # Over 0.2 s, so that white noise of the readings does not pass for a change of the rate.
    ahead = max(0.1, float(np.median(step)) / 2)
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


def _similarity(matrix: np.ndarray) -> np.ndarray:
    """(13, 8): M changes by its scale and a turn alone."""
    basis = np.zeros((13, 8))
    rotation = orthogonal_part(matrix)
    basis[:9, 0] = rotation.ravel()
    for i, across in enumerate(np.eye(3)):
        basis[:9, 1 + i] = np.cross(across, matrix, axisb=0, axisc=0).ravel()
    basis[9:, 4:] = np.eye(4)
    return basis


def _scale(left: np.ndarray) -> float:
    """Standard deviation an axis from the median length; 1.538 is the χ distribution's, of 3 axes."""
    return float(np.median(np.linalg.norm(left, axis=1))) / 1.538


def _white_noise(time: np.ndarray, rate: np.ndarray) -> float:
    """N², (rad/s)²/Hz an axis, from second differences, whose variance is 6 N²/h; motion adds to it."""
    return _scale(np.diff(rate, 2, axis=0)) ** 2 / 6 * float(np.median(np.diff(time)))


def _jackknife(normal, right, prior, variance: float) -> np.ndarray:
    """Covariance from the change of the solution as each window is left out, and the prior's part."""
    whole, count = normal.sum(axis=0) + prior, len(normal)
    both = np.linalg.solve(whole, right.sum(axis=0))
    without = np.linalg.solve(whole - normal, (right.sum(axis=0) - right)[..., None])[..., 0]
    spread = without - both
    kept = np.linalg.solve(whole, prior)
    return (count - 1) / count * spread.T @ spread + kept @ kept.T


def _starts(time, rate, windows: Windows):
    """Other starts: with the clock that the speeds agree best with, the unit and the axes."""
    step = np.diff(time)
    turned = np.concatenate(
        [np.zeros((1, 3)), np.cumsum((rate[1:] + rate[:-1]) / 2 * step[:, None], 0)]
    )
    stamps, v = time[windows.at], windows.vectors(windows.rotation)

    def gyroscope(delay: float) -> np.ndarray:
        return np.stack([np.interp(stamps + delay, time, axis) for axis in turned.T], axis=1)

    # Lengths of turns hang on neither axes nor sense.
    ends = np.append(windows.first[1:], len(stamps)) - 1
    long = np.linalg.norm(v[ends] - v[windows.first], axis=1)
    delays = np.arange(-2, 2.001, max(0.02, float(np.median(step))))
    alike = []
    for delay in delays:
        u = gyroscope(delay)
        alike.append(_correlation(long, np.linalg.norm(u[ends] - u[windows.first], axis=1)))
    for delay in {0.0, float(delays[int(np.argmax(alike))])}:
        u = windows.off_mean(gyroscope(delay))
        unit = float(np.sqrt(np.median((v**2).sum(1)) / max(np.median((u**2).sum(1)), 1e-300)))
        for factor in {1.0, unit if not 2 / 3 < unit < 3 / 2 and unit < 1e6 else 1.0}:
            yield _Start(np.eye(3), delay, factor)
            yield _Start(_linear(factor * u, windows.off_mean(v), stamps, windows), delay, factor)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = np.sqrt((one @ one) * (other @ other))
    return float(one @ other / size) if size > 0 else 0.0


def _linear(u, v, stamps, windows: Windows) -> np.ndarray:
    """M of v = M u − c T for turns that are small; where u has no third direction, a turn and a scale."""
    steps = windows.off_mean(stamps)[:, None]
    kept = np.linalg.norm(v, axis=1) <= np.quantile(np.linalg.norm(v, axis=1), _KEPT)
    left, sizes, right = np.linalg.svd(v[kept].T @ u[kept])
    spread = np.linalg.svd(u[kept], compute_uv=False)
    if spread[2] > 0.05 * spread[0]:
        found = np.linalg.lstsq(np.hstack([u, steps])[kept], v[kept], rcond=None)[0]
        return found[:3].T
    size = sizes.sum() / max((u[kept] ** 2).sum(), 1e-300)
    if sizes[1] > 0.05 * sizes[0]:
        return size * orthogonal_part(v[kept].T @ u[kept])
    return size * Rotation.align_vectors(left[:, :1].T, right[:1])[0].as_matrix()


def orthogonal_part(matrix: np.ndarray) -> np.ndarray:
    """The rotation nearest to M (3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt


def _told(fit: _Fit, windows: Windows, interval: float) -> Agreement:
    std = np.sqrt(np.diag(fit.covariance))
    # dM M⁻¹ = ds/s I + [θ×] and a rest that is neither.
    relative = np.kron(np.eye(3), np.linalg.pinv(fit.matrix).T)
    covariance = relative @ fit.covariance[:9, :9] @ relative.T
    parts = np.zeros((4, 9))
    parts[0, [0, 4, 8]] = 1 / 3
    for axis, (one, other) in enumerate(((7, 5), (2, 6), (3, 1))):
        parts[1 + axis, one], parts[1 + axis, other] = 0.5, -0.5
    part_std = np.sqrt(np.diag(parts @ covariance @ parts.T))
    matrix = fit.matrix * fit.unit
    scale = float(np.cbrt(abs(np.linalg.det(matrix))))
    known = std[12] < interval
    return Agreement(
        delay=fit.delay if known else 0.0,
        delay_std=float(std[12]) if known else np.inf,
        bias=fit.bias / fit.unit,
        bias_std=std[9:12] / fit.unit,
        matrix=matrix,
        scale=scale,
        scale_std=float(scale * part_std[0]),
        misalignment=Rotation.from_matrix(orthogonal_part(matrix)).as_rotvec(),
        misalignment_std=part_std[1:],
        mirrored=bool(np.linalg.det(matrix) < 0),
        residual=fit.residual,
        turn=fit.turn,
        explained=fit.explained,
        windows=windows.count,
        span=windows.span,
        interval=interval,
        moved=True,
    )


def _untold(windows: Windows, interval, residual, turn, explained) -> Agreement:
    unknown = np.full(3, np.inf)
    return Agreement(
        delay=0.0,
        delay_std=np.inf,
        bias=np.zeros(3),
        bias_std=unknown,
        matrix=np.eye(3),
        scale=1.0,
        scale_std=np.inf,
        misalignment=np.zeros(3),
        misalignment_std=unknown,
        mirrored=False,
        residual=residual,
        turn=turn,
        explained=explained,
        windows=windows.count,
        span=windows.span,
        interval=interval,
        moved=False,
    )
