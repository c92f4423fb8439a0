"""Whether a gyroscope and a reference attitude tell of the same motion: delay, bias, scale and axes.

The reference's frame plays no part: within a window of a second or two only how the attitude changes
is compared. The readings r become the body's rate by ω(t) = M (r(t + τ) − b), and M, b and τ are
fitted so that the attitudes integrated from ω leave, in each window, a constant difference from the
reference. Of M, what the motion tells: a body that turned about one axis shows scale and axes about
that one alone. What is found is judged in `verdicts`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.agreement_fit import Fit, Start, fit_motion, orthogonal_part, turns
from sensorbook.attitude.windows import LEAST, Windows

_MOVING = 0.1  # rad a window: more is no reference's noise
_KEPT = 0.95  # share of references that a start is taken from
_SURE = 4.0  # standard errors from which on a delay longer than a reading's interval is kept
_OPEN = 0.05  # component of the only axis turned about, from which on a turn about it shows


@dataclass(frozen=True, eq=False)
class Agreement:
    """How a gyroscope's readings become the reference's motion: true rate = M (reading − bias).

    Attributes
    ----------
    delay : τ, s, by which the readings are late, as `rotation_increments` takes it; 0 where it is not told
    delay_std : s, infinite where it is not told
    bias, bias_std : (3,) rad/s, in the gyroscope's axes
    directions : (K, 3) unit vectors in the gyroscope's axes, strongest first: what M does to them the
        motion tells. With three, M is free; with two or one it is a scale and the smallest turn
    one_axis : the body turned less than a tenth as far about any other axis than the first of these
    matrix : (3, 3), M
    scale, scale_std : ∛|det M|, the reference's turn for one of the gyroscope
    misalignment, misalignment_std : (3,) rad, rotation vector of the rotation nearest to M, which
        turns components in the gyroscope's axes into those in the reference's body axes; the standard
        error is infinite for a component that is not told
    angle_std : rad, standard error of its angle
    mirrored : M turns right-handed axes into left-handed ones; never where fewer than three are told
    residual : rad, rms angle between the reference and the fit, in a window
    turn : rad, rms angle of the reference about its mean, in a window
    own_turn : rad, rms angle of the readings' integral in the same way, without its steady part
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
    directions: np.ndarray
    one_axis: bool
    matrix: np.ndarray
    scale: float
    scale_std: float
    misalignment: np.ndarray
    misalignment_std: np.ndarray
    angle_std: float
    mirrored: bool
    residual: float
    turn: float
    own_turn: float
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


def agreement(
    time: ArrayLike,
    rate: ArrayLike,
    at: ArrayLike,
    quaternion: ArrayLike,
    lost: ArrayLike | None = None,
    trial: bool = False,
) -> Agreement:
    """Delay, bias, scale and axes of a gyroscope against a reference, with standard errors.

    Gauss–Newton steps with Huber's weights; standard errors are the jackknife's over windows (Cameron
    & Miller 2015), so that the errors of references within a window, and the gyroscope's, may be
    correlated. Where the readings do not fit as they are, a clock up to 2 s off, turned axes and
    another unit are tried as well. What was turned about is told by the readings less what their
    noise would turn, and by the standard errors.

    Parameters
    ----------
    time : (N,) s, ascending
    rate : (N, 3) rad/s
    at : (M,) numbers of the stamps that have a reference, ascending
    quaternion : (M, 4), reference → body
    lost : (N − 1,) true for a step that no reading tells; no window reaches across it
    trial : the attitudes are a guess, which is given up early where hardly any of it agrees
    """
    time, rate = np.asarray(time, dtype=float), np.asarray(rate, dtype=float)
    at, quaternion = np.asarray(at), np.asarray(quaternion, dtype=float)
    if len(at) != len(quaternion):
        raise ValueError(f"{len(at)} stamps and {len(quaternion)} references: they go in pairs")
    windows = Windows.of(time, at, quaternion, lost)
    interval = float(np.median(np.diff(time)))
    if windows.count < LEAST:
        nothing = Fit(*[np.nan] * 6, residual=np.nan, turn=np.nan, unit=1.0, weight=np.nan)
        return _untold(nothing, windows, interval, np.nan)
    fit = fit_motion(time, rate, windows, Start(np.eye(3)), trial)
    if fit.turn > 1e-9 and not fit.as_declared and fit.explained < 0.9:
        for start in _starts(time, rate, windows):
            other = fit_motion(time, rate, windows, start, trial=True)
            # Only where it explains much more: noise always prefers one of several.
            better = 1 - other.explained < 0.7 * (1 - fit.explained) or not fit.moved
            if other.explained > 0.5 and other.moved and better:
                fit = other
            if fit.explained > 0.97 and fit.moved:
                break
    own = _own_turn(time, rate, windows)
    still = fit.explained <= 0.5 and fit.turn <= _MOVING and own * fit.unit < 0.5 * fit.residual
    if not fit.moved or still:
        return _untold(fit, windows, interval, own)
    return _told(fit, windows, interval, own)


def _own_turn(time, rate, windows: Windows) -> float:
    """rad, rms of the readings' turn about the window's mean, without a steady part."""
    own = windows.off_mean(turns(time, rate - np.median(rate, axis=0), windows))
    return float(np.sqrt(np.mean((own**2).sum(axis=1))))


def _starts(time, rate, windows: Windows):
    """Other starts: with the clock that the speeds agree best with, the unit and the axes."""
    stamps, v = time[windows.at], windows.vectors(windows.rotation)
    # Lengths of turns hang on neither axes nor sense.
    ends = np.append(windows.first[1:], len(stamps)) - 1
    long = np.linalg.norm(v[ends] - v[windows.first], axis=1)
    delays = np.arange(-2, 2.001, max(0.02, float(np.median(np.diff(time)))))
    alike = []
    for delay in delays:
        u = turns(time, rate, windows, delay)
        alike.append(_correlation(long, np.linalg.norm(u[ends] - u[windows.first], axis=1)))
    for delay in {0.0, float(delays[int(np.argmax(alike))])}:
        u = windows.off_mean(turns(time, rate, windows, delay))
        unit = float(np.sqrt(np.median((v**2).sum(1)) / max(np.median((u**2).sum(1)), 1e-300)))
        for factor in {1.0, unit if not 2 / 3 < unit < 3 / 2 and unit < 1e6 else 1.0}:
            yield Start(np.eye(3), delay, factor)
            yield Start(_linear(factor * u, windows.off_mean(v), stamps, windows), delay, factor)


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


def _told(fit: Fit, windows: Windows, interval: float, own: float) -> Agreement:
    std = np.sqrt(np.diag(fit.covariance))
    matrix = fit.matrix * fit.unit
    scale = float(np.cbrt(abs(np.linalg.det(matrix))))
    misalignment = Rotation.from_matrix(orthogonal_part(matrix)).as_rotvec()
    relative, turning = _scale_and_turn(fit)
    along = misalignment / max(np.linalg.norm(misalignment), 1e-300)
    angle_var = along @ turning @ along if along.any() else np.trace(turning)
    misalignment_std = np.sqrt(np.diag(turning))
    if len(fit.directions) == 1:
        axis = fit.matrix @ fit.directions[0] / (scale / fit.unit)
        misalignment_std[np.abs(axis) > _OPEN] = np.inf
    # A delay of many standard errors is one, be they longer than an interval.
    known = std[-1] < interval or abs(fit.delay) > _SURE * std[-1]
    return Agreement(
        delay=fit.delay if known else 0.0,
        delay_std=float(std[-1]) if known else np.inf,
        bias=fit.bias / fit.unit,
        bias_std=std[-4:-1] / fit.unit,
        directions=fit.directions,
        one_axis=fit.one_axis and len(fit.directions) == 1,
        matrix=matrix,
        scale=scale,
        scale_std=scale * relative,
        misalignment=misalignment,
        misalignment_std=misalignment_std,
        angle_std=float(np.sqrt(angle_var)),
        mirrored=bool(np.linalg.det(matrix) < 0),
        residual=fit.residual,
        turn=fit.turn,
        own_turn=own,
        explained=fit.explained,
        windows=windows.count,
        span=windows.span,
        interval=interval,
        moved=True,
    )


def _scale_and_turn(fit: Fit) -> tuple[float, np.ndarray]:
    """Relative standard error of the scale, and covariance (3, 3) of the turn, of what is told."""
    covariance = fit.covariance[:-4, :-4]
    if len(fit.directions) < 3:
        return float(np.sqrt(covariance[0, 0])), fit.axes.T @ covariance[1:, 1:] @ fit.axes
    # dM M⁻¹ = ds/s I + [θ×] and a rest that is neither.
    relative = np.kron(np.eye(3), np.linalg.pinv(fit.matrix).T)
    covariance = relative @ covariance @ relative.T
    parts = np.zeros((4, 9))
    parts[0, [0, 4, 8]] = 1 / 3
    for axis, (one, other) in enumerate(((7, 5), (2, 6), (3, 1))):
        parts[1 + axis, one], parts[1 + axis, other] = 0.5, -0.5
    covariance = parts @ covariance @ parts.T
    return float(np.sqrt(covariance[0, 0])), covariance[1:, 1:]


def _untold(fit: Fit, windows: Windows, interval: float, own: float) -> Agreement:
    unknown = np.full(3, np.inf)
    return Agreement(
        delay=0.0,
        delay_std=np.inf,
        bias=np.zeros(3),
        bias_std=unknown,
        directions=np.zeros((0, 3)),
        one_axis=False,
        matrix=np.eye(3),
        scale=1.0,
        scale_std=np.inf,
        misalignment=np.zeros(3),
        misalignment_std=unknown,
        angle_std=np.inf,
        mirrored=False,
        residual=fit.residual,
        turn=fit.turn,
        own_turn=own,
        explained=fit.explained,
        windows=windows.count,
        span=windows.span,
        interval=interval,
        moved=False,
    )
