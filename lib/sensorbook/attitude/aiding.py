"""What a gyroscope and a reference give together: the input and the result of every method.

A reference is an attitude with a covariance, whatever it was measured with: a camera, an optical
tracker, the directions of gravity and of the Earth's field.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.rotations import error_vector, euler_from_matrix, matrix_from_quaternion


@dataclass(frozen=True, eq=False)
class References:
    """Attitudes that were measured at some of a motion's stamps.

    Attributes
    ----------
    at : (M,) numbers of the stamps, ascending
    quaternion : (M, 4), reference → body
    covariance : (M, 3, 3), rad², of the error vector in body axes
    """

    at: np.ndarray
    quaternion: np.ndarray
    covariance: np.ndarray

    def __len__(self) -> int:
        return len(self.at)

    def where(self, chosen: np.ndarray) -> References:
        """Those of a mask (M,) or of some numbers."""
        return References(self.at[chosen], self.quaternion[chosen], self.covariance[chosen])

    def at_rate(self, time: np.ndarray, rate: float) -> References:
        """One every 1/`rate` seconds from the first on: the nearest to each tick, where there is one.

        `time` (N,) s are the motion's stamps. A tick without any reference within half a period
        goes without.
        """
        if not len(self):
            return self
        stamps = time[self.at]
        tick = np.rint((stamps - stamps[0]) * rate)
        off = np.abs(stamps - stamps[0] - tick / rate)
        order = np.lexsort((off, tick))
        first = np.unique(tick[order], return_index=True)[1]
        return self.where(np.sort(order[first]))

    def outside(self, time: np.ndarray, start: float, end: float) -> References:
        """Those not in an outage from `start` to `end` (s)."""
        stamps = time[self.at]
        return self.where((stamps < start) | (stamps >= end))


@dataclass(frozen=True, eq=False)
class Motion:
    """A gyroscope's record made ready: N stamps and the rotation in each step.

    Attributes
    ----------
    time : (N,) s
    increments : (N − 1, 3) rad, rotation vectors in body axes, as `rotation_increments` gives them
    lost : (N − 1,) rad², variance an axis of a step that no reading tells (a gap); 0 for all others
    """

    time: np.ndarray
    increments: np.ndarray
    lost: np.ndarray

    @classmethod
    def of(cls, time: ArrayLike, increments: ArrayLike) -> Motion:
        """A motion without gaps."""
        time, increments = np.asarray(time, dtype=float), np.asarray(increments, dtype=float)
        return cls(time, increments, np.zeros(len(increments)))

    @property
    def steps(self) -> np.ndarray:
        """(N − 1,) s."""
        return np.diff(self.time)


@dataclass(frozen=True)
class GyroscopeNoise:
    """What a filter needs to know of a gyroscope, per axis or one number for all.

    Attributes
    ----------
    random_walk : N, rad/s/√Hz, two-sided: the attitude's variance grows by N² a second
    rate_random_walk : K, rad/s/√s: the bias's variance grows by K² a second
    bias_std : rad/s, standard error of the bias before any reference; 0 for a bias that is known
    in_motion : √s; at a rate ω the attitude's variance grows by (in_motion · |ω|)² a second more on
        each axis: what scale factors, misalignments and the reference's timing err by, as noise
    """

    random_walk: float | tuple[float, float, float]
    rate_random_walk: float | tuple[float, float, float] = 0.0
    bias_std: float | tuple[float, float, float] = 0.03
    in_motion: float = 0.0

    def growth(self, motion: Motion) -> np.ndarray:
        """(N − 1, 3) rad²/s: by how much the attitude's variance grows a second, in each step."""
        still = np.broadcast_to(self.random_walk, 3) ** 2
        speed = (motion.increments**2).sum(axis=1) / motion.steps**2
        return still + self.in_motion**2 * speed[:, None]


@dataclass(frozen=True, eq=False)
class Attitudes:
    """The attitude at each stamp, as one method has it; NaN before the first reference.

    Attributes
    ----------
    quaternion : (N, 4), reference → body
    bias : (N, 3) rad/s, or None where the method has none
    covariance : (N, 6, 6) of the attitude's error vector (rad, body axes) and of the bias (rad/s),
        after each step's update, or None
    """

    quaternion: np.ndarray
    bias: np.ndarray | None = None
    covariance: np.ndarray | None = None

    def errors(self, true: ArrayLike) -> np.ndarray:
        """(N, 3) rad: the error vectors in body axes; NaN where either attitude (N, 4) is unknown."""
        return error_vector(matrix_from_quaternion(self.quaternion), matrix_from_quaternion(true))

    def euler_errors(self, true: ArrayLike) -> np.ndarray:
        """(N, 3) rad: differences of roll, pitch and yaw (Z-Y-X), each in [−π, π]."""
        mine, theirs = (
            euler_from_matrix("ZYX", matrix_from_quaternion(q))[:, ::-1]
            for q in (self.quaternion, true)
        )
        return (mine - theirs + np.pi) % (2 * np.pi) - np.pi

    def nees(self, true: ArrayLike, true_covariance: ArrayLike = 0.0) -> np.ndarray:
        """(N,) normalised error squared, δᵀ P⁻¹ δ of the attitude: 3 on average where P is right.

        Where the attitudes that are taken for true err themselves, by `true_covariance` (N, 3, 3), rad²,
        body axes, and independently of these, that is added to P.
        """
        error = self.errors(true)
        known = np.isfinite(error).all(axis=1)
        found = np.full(len(error), np.nan)
        block = (self.covariance[:, :3, :3] + true_covariance)[known]
        found[known] = (error[known] * np.linalg.solve(block, error[known][..., None])[..., 0]).sum(
            1
        )
        return found


@dataclass(frozen=True)
class Accuracy:
    """A method's errors over a record, in rad; those of the axes are of the error vector.

    Attributes
    ----------
    mean : of the total angle
    rms : of the total angle
    axes : (3,) mean absolute error about x, y, z
    euler : (3,) mean absolute error of roll, pitch, yaw (Z-Y-X)
    nees : mean, or NaN where the method has no covariance
    samples : number of stamps compared
    """

    mean: float
    rms: float
    axes: np.ndarray
    euler: np.ndarray
    nees: float
    samples: int


def accuracy(found: Attitudes, true: ArrayLike, true_covariance: ArrayLike = 0.0) -> Accuracy:
    """Errors of the attitudes against the true ones (N, 4), where both are known.

    `true_covariance` (N, 3, 3) rad² is that of the latter, which `nees` counts.
    """
    error = found.errors(true)
    known = np.isfinite(error).all(axis=1)
    if not known.any():
        raise ValueError("no stamp has both an attitude and a true one")
    total = np.linalg.norm(error[known], axis=1)
    return Accuracy(
        mean=float(total.mean()),
        rms=float(np.sqrt(np.mean(total**2))),
        axes=np.abs(error[known]).mean(axis=0),
        euler=np.abs(found.euler_errors(true)[known]).mean(axis=0),
        nees=np.nan
        if found.covariance is None
        else float(np.nanmean(found.nees(true, true_covariance))),
        samples=int(known.sum()),
    )
