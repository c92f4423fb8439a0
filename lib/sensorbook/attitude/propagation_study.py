"""What each way of integrating rates loses, on motions whose attitude is known (work C, 5.1).

The motions are written as formulas, and their attitudes come from no method that is measured on them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.propagation import (
    orthogonalise,
    orthogonality_error,
    propagate,
    propagate_euler,
    propagate_matrix,
    rotation_increments,
    turn_matrix,
)
from sensorbook.attitude.rotations import compose_quaternions

# The stated motion: each angle is a (1 − cos(2π t/T)), at rest at t = 0; a (deg) and T (s).
ROLL, PITCH, YAW = (20.0, 5.3), (15.0, 7.3), (60.0, 23.0)
START = (0.0, 0.0, 0.0, 1.0)  # body and reference axes are the same
READINGS = ("sample", "mean before", "mean after")
_DELAYS = {"sample": 0.0, "mean before": 0.5, "mean after": -0.5}  # intervals
_PHASES = 6  # passes by the lock, whose steps fall differently about the closest point
_STEPS_ASIDE = 40  # steps before and after the closest point; the lock is not felt farther away


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """A body's motion at N stamps, one a fixed interval, and what a perfect gyroscope reads of it.

    Attributes
    ----------
    time : (N,) s
    true : (N, 4) attitude, reference → body, scalar last
    sample : (N, 3) rad/s, the rate at the stamp, in body axes as all rates
    before, after : (N, 3) rad/s, its mean over the interval before the stamp and after it
    """

    time: np.ndarray
    true: np.ndarray
    sample: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @property
    def step(self) -> float:
        """The interval, s."""
        return float(self.time[1] - self.time[0])

    def increments(
        self, reading: str = "mean before", taken_as: str = "", coning: bool = True
    ) -> np.ndarray:
        """Rotation vectors (N − 1, 3), rad, of one of the `READINGS`, taken for itself or for another."""
        rate = {"sample": self.sample, "mean before": self.before, "mean after": self.after}
        delay = _DELAYS[taken_as or reading] * self.step
        return rotation_increments(self.time, rate[reading], delay, coning)

    def errors(self, found: ArrayLike) -> np.ndarray:
        """How far attitudes (N, 4) are from the truth, as angles (N,), rad."""
        return angle_between(found, self.true)


def angle_between(one: ArrayLike, other: ArrayLike) -> np.ndarray:
    """The angle (…), rad, between attitudes (…, 4), right down to rounding."""
    return (Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude()


def stated_motion(rate_hz: float, seconds: float) -> KnownMotion:
    """A body that starts at rest and swings about all its axes at once (`ROLL`, `PITCH`, `YAW`)."""
    interval = 1 / rate_hz
    time = np.arange(round(seconds * rate_hz) + 1) * interval
    node, weight = np.polynomial.legendre.leggauss(8)
    # The mean rate of each interval, of the one before the first stamp too: exact to rounding.
    within = np.append(-interval, time)[:, None] + (node + 1) / 2 * interval
    mean = np.einsum("nki,k->ni", _rates(within), weight) / 2
    true = euler_attitudes(_angles(time)[0])
    return KnownMotion(time, true, _rates(time), mean[:-1], mean[1:])


def coning_motion(
    half_angle: float, frequency: float, rate_hz: float, seconds: float
) -> KnownMotion:
    """A body whose z axis goes round a cone, `half_angle` (rad) wide, `frequency` (Hz) times a second.

    The attitude is a turn by the half-angle about (cos Ωt, sin Ωt, 0), and comes back after each
    round. Its rate in body axes is Ω (−sinθ sin Ωt, sinθ cos Ωt, −(1 − cosθ)): the third is constant.
    """
    time = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    circular = 2 * np.pi * frequency
    phase = circular * time
    axis = np.stack([np.cos(phase), np.sin(phase), np.zeros_like(phase)], axis=-1)
    true = Rotation.from_rotvec(half_angle * axis).as_quat()

    def mean(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        turned = [np.cos(end) - np.cos(start), np.sin(end) - np.sin(start)]
        across = np.sin(half_angle) * rate_hz * np.stack(turned, axis=-1)
        return np.column_stack([across, _along(start, half_angle, circular)])

    sample = circular * np.sin(half_angle) * np.stack([-np.sin(phase), np.cos(phase)], axis=-1)
    sample = np.column_stack([sample, _along(phase, half_angle, circular)])
    ahead = circular / rate_hz
    return KnownMotion(time, true, sample, mean(phase - ahead, phase), mean(phase, phase + ahead))


def coning_drift(motion: KnownMotion) -> dict[str, float]:
    """Drift about the cone's axis, rad/s: of the sum of each axis's increments, and of the attitudes
    without and with the coning correction."""
    whole = motion.time[-1] - motion.time[0]
    plain = motion.increments(coning=False)
    drift = {"sum of each axis": float(plain[:, 2].sum() / whole)}
    for name, turned in (("no correction", plain), ("coning correction", motion.increments())):
        found = Rotation.from_quat(propagate(turned, motion.true[0]))
        about = (found * Rotation.from_quat(motion.true).inv()).as_rotvec()[:, 2]
        drift[name] = float(np.unwrap(about)[-1] / whole)
    return drift


def coning_drift_rate(
    half_angle: float, frequency: float, rate_hz: ArrayLike
) -> dict[str, np.ndarray]:
    """The same in closed form, for small half-angles θ and mean readings, with x = Ω h.

    The sum's is exact: −Ω (1 − cosθ), the solid angle that the axis goes round (Goodman and Robinson
    1958). The others are the usual measure of coning algorithms (Ignagni 1990, Savage 1998):
    −½ sin²θ Ω times 1 − sin x/x, and times 1 − sin x/x − (1 − cos x) sin x/(3 x) where the cross
    product of neighbouring increments is added.
    """
    circular = 2 * np.pi * frequency
    x = circular / np.asarray(rate_hz, dtype=float)
    left = 1 - np.sin(x) / x
    scale = -(np.sin(half_angle) ** 2) / 2 * circular
    return {
        "sum of each axis": np.full_like(x, -circular * (1 - np.cos(half_angle))),
        "no correction": scale * left,
        "coning correction": scale * (left - (1 - np.cos(x)) * np.sin(x) / (3 * x)),
    }


def series_turn(increment: ArrayLike, order: int) -> np.ndarray:
    """C of (5.2) cut off: the sum of [σ×]ᵏ/k! up to k = `order`, (…, 3, 3), for σ (…, 3), rad."""
    cross = np.cross(np.eye(3), np.asarray(increment, dtype=float)[..., None, :])
    term = total = np.broadcast_to(np.eye(3), cross.shape)
    for k in range(1, order + 1):
        term = term @ cross / k
        total = total + term
    return total


@dataclass(frozen=True)
class SeriesLoss:
    """What (5.2) cut off loses: the `orthogonality` error at the end, and the `angle`, rad, that the
    attitude is then off by; `mended` is that angle where each step was made orthogonal."""

    orthogonality: float
    angle: float
    mended: float


def series_loss(increments: np.ndarray, order: int | None) -> SeriesLoss:
    """Loss after all increments (N, 3), rad, against turns by the whole; `order` None is the whole."""
    turns = turn_matrix(increments) if order is None else series_turn(increments, order)
    right = propagate(increments, START)[-1]
    plain, mended = (propagate_matrix(turns, np.eye(3), each)[-1] for each in (False, True))
    off = (float(angle_between(attitudes_of(a), right)) for a in (plain, mended))
    return SeriesLoss(float(orthogonality_error(plain)), *off)


def errors_by_rate(rates_hz: ArrayLike, seconds: float) -> dict[str, np.ndarray]:
    """Largest error, rad, over the stated motion, by the rate of the readings: a row a way."""
    found: dict[str, list[float]] = {}
    for rate_hz in np.asarray(rates_hz):
        motion = stated_motion(rate_hz, seconds)
        means = motion.increments(coning=False)
        first_order = propagate_matrix(series_turn(means, 1), np.eye(3), orthogonal=False)
        ways = {
            "samples, held for the next step": motion.increments("sample", "mean after", False),
            "samples, interpolated": motion.increments("sample", coning=False),
            "means": means,
            "means, coning correction": motion.increments(),
        }
        attitudes = {name: propagate(turned, motion.true[0]) for name, turned in ways.items()}
        attitudes["means, matrix of first order"] = attitudes_of(first_order)
        for name, attitude in attitudes.items():
            found.setdefault(name, []).append(float(motion.errors(attitude).max()))
    return {name: np.array(errors) for name, errors in found.items()}


def attitudes_of(matrices: ArrayLike) -> np.ndarray:
    """The attitudes (N, 4) nearest to matrices body → reference (N, 3, 3) that may not be orthogonal."""
    return Rotation.from_matrix(orthogonalise(np.asarray(matrices, dtype=float))).as_quat()


def euler_attitudes(angles: ArrayLike) -> np.ndarray:
    """The attitudes (N, 4) of roll, pitch and yaw (N, 3), rad, whatever their size."""
    return Rotation.from_euler("ZYX", np.asarray(angles)[:, ::-1]).as_quat()


def propagate_quaternion(increments: ArrayLike, start: ArrayLike) -> np.ndarray:
    """Attitudes (N, 4), by q ← δq ⊗ q one step after another; δq stands as the matrix of (2.12).

    It is what `propagate` does, made as the matrices are, so that the times of both can be compared.
    """
    turns = Rotation.from_rotvec(increments).as_quat()
    products = np.swapaxes(compose_quaternions(turns[:, None], np.eye(4)), -1, -2)
    attitudes = np.empty((len(products) + 1, 4))
    attitudes[0] = start
    for k, product in enumerate(products):
        attitudes[k + 1] = product @ attitudes[k]
    return attitudes


def tour(axes: str, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """A body turned by `turn` (rad) about one of its own axes after another, "xy−x−z" with its signs.

    Returns the integral (K + 1, 3) of each body rate and the attitude (K + 1, 4), after each turn.
    """
    integral, attitude = [np.zeros(3)], [Rotation.identity()]
    for letter, sign in _turns(axes):
        one = sign * turn * np.eye(3)["xyz".index(letter)]
        integral.append(integral[-1] + one)
        attitude.append(attitude[-1] * Rotation.from_rotvec(one))
    return np.array(integral), np.array([a.as_quat() for a in attitude])


@dataclass(frozen=True, eq=False)
class RoundingDrift:
    """What rounding does to a matrix over N steps: its `orthogonality` error (N,), and its `angle` (N,),
    rad, from the attitude that the same increments give in 64 bit."""

    orthogonality: np.ndarray
    angle: np.ndarray


def rounding_drift(increments: np.ndarray, dtype: type, orthogonal: bool) -> RoundingDrift:
    """Drift of the matrices by (5.2) with arithmetic in `dtype`, made orthogonal each step or never."""
    found = propagate_matrix(turn_matrix(increments), np.eye(3), orthogonal, dtype)
    off = angle_between(attitudes_of(found), propagate(increments, START))
    return RoundingDrift(orthogonality_error(found.astype(float)), off)


@dataclass(frozen=True, eq=False)
class LockPass:
    """A body that turns about its y axis alone and whose x axis passes by the vertical, in K stamps.

    Attributes
    ----------
    along : (K,) rad, turned since the closest point
    increments : (K − 1, 3) rad
    angles : (K, 3) rad, true roll, pitch and yaw; pitch comes as near to 90° as the vertical is passed
    true : (K, 4) attitude
    """

    along: np.ndarray
    increments: np.ndarray
    angles: np.ndarray
    true: np.ndarray


def lock_pass(
    closest: float, turn: float, aside: int = _STEPS_ASIDE, phase: float = 0.0
) -> LockPass:
    """A pass by the lock of the Euler angles Z-Y-X, at a distance `closest`, by `turn` a step, rad.

    It has `aside` steps before and after the closest point, over 80° at most; `phase`, 0 to 1, is where
    in a step that point falls.
    """
    aside = min(aside, int(np.radians(80) / turn))
    along = (np.arange(-aside, aside + 1) + phase) * turn
    y = np.array([0.0, 1.0, 0.0])
    start = Rotation.from_rotvec([closest, 0.0, 0.0])  # y is off the horizontal by the distance
    true = start * Rotation.from_rotvec((np.pi / 2 + along)[:, None] * y)
    increments = np.tile(turn * y, (len(along) - 1, 1))
    return LockPass(along, increments, true.as_euler("ZYX")[:, ::-1], true.as_quat())


def lock_loss(closest: float, turn: float) -> float:
    """The attitude's error, rad, after (5.1) has passed the lock: the worst of some phases."""
    worst = 0.0
    for phase in np.arange(_PHASES) / _PHASES:
        by = lock_pass(closest, turn, phase=phase)
        found = euler_attitudes(propagate_euler(by.increments, by.angles[0])[-1:])[0]
        worst = max(worst, float(angle_between(found, by.true[-1])))
    return worst


def largest_with(loss: float, closest: ArrayLike, losses: ArrayLike) -> float | None:
    """The largest of distances `closest`, ascending, at which `losses` still reach `loss`; interpolated.

    None where they reach it nowhere, or still at the last.
    """
    reached = np.flatnonzero(np.asarray(losses) >= loss)
    if not len(reached) or reached[-1] + 1 == len(losses):
        return None
    ends = slice(reached[-1], reached[-1] + 2)
    falling = np.log(np.asarray(losses)[ends][::-1]), np.log(np.asarray(closest)[ends][::-1])
    return float(np.exp(np.interp(np.log(loss), *falling)))


@dataclass(frozen=True)
class Method:
    """What one method carries from step to step, by the increments (N, 3), and how attitudes (N + 1, 4)
    are had from that."""

    carry: Callable[[np.ndarray], np.ndarray]
    attitudes: Callable[[np.ndarray], np.ndarray]


METHODS = {
    "matrix of first order, SVD each step": Method(
        lambda turned: propagate_matrix(series_turn(turned, 1), np.eye(3)), attitudes_of
    ),
    "matrix (5.2)": Method(
        lambda turned: propagate_matrix(turn_matrix(turned), np.eye(3), orthogonal=False),
        attitudes_of,
    ),
    "matrix (5.2), SVD each step": Method(
        lambda turned: propagate_matrix(turn_matrix(turned), np.eye(3)), attitudes_of
    ),
    "Euler angles (5.1), Runge–Kutta": Method(
        lambda turned: propagate_euler(turned, np.zeros(3)), euler_attitudes
    ),
    "quaternion": Method(lambda turned: propagate_quaternion(turned, START), np.asarray),
}


def seconds_a_step(methods: Mapping[str, Callable[[], object]], steps: int) -> dict[str, float]:
    """Time a step of each method: the best of three runs over so many steps."""
    best = {}
    for name, method in methods.items():
        took = []
        for _ in range(3):
            began = clock.perf_counter()
            method()
            took.append(clock.perf_counter() - began)
        best[name] = min(took) / steps
    return best


def _turns(axes: str) -> list[tuple[str, float]]:
    """ "xy−x" as [("x", 1), ("y", 1), ("x", −1)]."""
    signed = [axes[k - 1 : k] == "−" for k in range(len(axes))]
    return [(a, -1.0 if s else 1.0) for a, s in zip(axes, signed, strict=True) if a != "−"]


def _along(phase: np.ndarray, half_angle: float, circular: float) -> np.ndarray:
    return np.full_like(phase, -circular * (1 - np.cos(half_angle)))


def _angles(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roll, pitch and yaw of the stated motion, (…, 3) rad, and their rates, rad/s."""
    size, period = np.array([ROLL, PITCH, YAW]).T
    size, circular = np.radians(size), 2 * np.pi / period
    phase = circular * np.asarray(time)[..., None]
    return size * (1 - np.cos(phase)), size * circular * np.sin(phase)


def _rates(time: np.ndarray) -> np.ndarray:
    """Body rates (…, 3), rad/s, of the stated motion: (5.1) solved for them."""
    (roll, pitch, _), (roll_rate, pitch_rate, yaw_rate) = (
        np.moveaxis(part, -1, 0) for part in _angles(time)
    )
    across = yaw_rate * np.cos(pitch)
    return np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + across * np.sin(roll),
            across * np.cos(roll) - pitch_rate * np.sin(roll),
        ],
        axis=-1,
    )
