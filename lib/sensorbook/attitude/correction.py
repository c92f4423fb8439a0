"""Attitude by the gyroscope alone, by work C's correction (5.3, 5.4) and by a complementary filter.

The methods without a covariance: what they take from a reference does not hang on how good it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Attitudes, Motion, References
from sensorbook.attitude.propagation import propagate


def integrate(motion: Motion, references: References, bias: np.ndarray | float = 0.0) -> Attitudes:
    """The gyroscope alone, from the first reference on; `bias` (3,) rad/s is taken out of it."""
    first = int(references.at[0])
    turned = motion.increments - np.multiply.outer(motion.steps, np.broadcast_to(bias, 3))
    quaternion = np.full((len(motion.time), 4), np.nan)
    quaternion[first:] = propagate(turned[first:], references.quaternion[0])
    return Attitudes(quaternion)


def reset(motion: Motion, references: References) -> Attitudes:
    """Work C's correction: the attitude's difference over Δt is taken for an error of the next rate.

    With A_i the reference's matrix (the image's) and A_a the integrated one, body → reference,
    A_iᵀ A_a ≈ I + [Ω×] (5.3, corrected), and w_ε = Ω/Δt (5.4) is subtracted from the next reading
    alone: a reset, one step late. Ω is the whole rotation vector, which (5.3) gives for small differences.
    """
    return corrected(motion, references, lambda meeting: (NOTHING, -meeting.off, NOTHING), False)


def reset_and_rate(motion: Motion, references: References) -> Attitudes:
    """The other reading of work C: the correction also stays in the rates, spread over its cause.

    What the attitude was off by grew since the reference before: Ω over the time between the two is
    kept as the gyroscope's bias. Kept as Ω/Δt, as (5.4) has it, it would turn the body by Ω in every
    step. What a gap makes of it is no bias.
    """

    def kept(meeting: Meeting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        off = meeting.off
        return NOTHING, -off, NOTHING if meeting.broken else off / meeting.period

    return corrected(motion, references, kept, True)


def complementary(
    motion: Motion, references: References, attitude_gain: float, time_constant: float
) -> Attitudes:
    """A complementary filter with a bias: high frequencies from the gyroscope, low from the reference.

    At each reference the attitude goes `attitude_gain` of the way, and the bias learns the rest over
    `time_constant`: b ← b + β δ/T with β = α (1 − exp(−T/τ)), never more than damps critically,
    2 − α − 2 √(1 − α) (the α-β filter; Mahony, Hamel & Pflimlin 2008 in continuous time). From the start
    the gains are those of a straight line through all references so far, α = 2 (2k − 1)/(k (k + 1)) and
    β = 6/(k (k + 1)) at the k-th (Morrison 1969), until these are the smaller: a bias would take long
    to be learnt by small gains. After a gap the reference is taken as it is, and tells nothing of the bias.

    Parameters
    ----------
    attitude_gain : α, above 0 and up to 1, at which the reference is taken as it is
    time_constant : τ, s
    """
    if not 0 < attitude_gain <= 1:
        raise ValueError(f"attitude_gain is {attitude_gain}: give more than 0 and up to 1")
    if not time_constant > 0:
        raise ValueError(f"time_constant is {time_constant}: give more than 0 s")

    def blended(meeting: Meeting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        off = meeting.off
        if meeting.broken:
            return -off, NOTHING, NOTHING
        k = meeting.number + 1
        gain = attitude_gain
        share = gain * -np.expm1(-meeting.period / time_constant)
        share = min(share, 2 - gain - 2 * np.sqrt(1 - gain))
        gain = max(gain, 2 * (2 * k - 1) / (k * (k + 1)))
        share = max(share, 6 / (k * (k + 1)))
        return -gain * off, NOTHING, share * off / meeting.period

    return corrected(motion, references, blended, True)


def steady_gain(random_walk: float, reference_std: float, period: float) -> float:
    """α of a Kalman filter that has settled, for one axis without bias.

    `random_walk` N, rad/s/√Hz; `reference_std` rad; `period` between references, s. With
    λ = N² T/σ²: α = (√(λ² + 4 λ) − λ)/2.
    """
    if reference_std <= 0:
        return 1.0
    ratio = random_walk**2 * period / reference_std**2
    if not ratio:
        return 0.0
    # Written so that it goes to 1, and not to inf − inf, for large ratios.
    return 2 * ratio / (np.sqrt(ratio**2 + 4 * ratio) + ratio)


@dataclass(frozen=True, eq=False)
class Meeting:
    """A reference after the first: its number (from 1), its attitude and the integrated one, (4,), s since
    the one before, and whether a step was lost since."""

    number: int
    reference: np.ndarray
    integrated: np.ndarray
    period: float
    broken: bool

    @property
    def off(self) -> np.ndarray:
        """(3,) rad, the integrated attitude's error vector against the reference, in body axes."""
        return (
            Rotation.from_quat(self.reference).inv() * Rotation.from_quat(self.integrated)
        ).as_rotvec()


NOTHING = np.zeros(3)


def corrected(
    motion: Motion,
    references: References,
    correct: Callable[[Meeting], tuple[np.ndarray, np.ndarray, np.ndarray]],
    with_bias: bool,
) -> Attitudes:
    """Integrated from the first reference, and corrected at each: `correct` gives the turn (3,) there, the
    turn that comes with the next step, and the change of the bias (3,), rad/s."""
    count, steps = len(motion.time), motion.steps
    quaternion, biases = np.full((count, 4), np.nan), np.full((count, 3), np.nan)
    lost = np.concatenate([[0], np.cumsum(motion.lost > 0)])
    at, bias, ends = references.quaternion[0], np.zeros(3), [*references.at[1:], count - 1]
    for k, (here, now, end) in enumerate(
        zip(references.at, references.quaternion, ends, strict=True)
    ):
        later = NOTHING
        if k:
            before = references.at[k - 1]
            period = motion.time[here] - motion.time[before]
            broken = bool(lost[here] > lost[before])
            turn, later, change = correct(Meeting(k, now, at, period, broken))
            at = (Rotation.from_quat(at) * Rotation.from_rotvec(turn)).as_quat()
            bias = bias + change
        turned = motion.increments[here:end] - np.multiply.outer(steps[here:end], bias)
        turned[:1] += later
        quaternion[here : end + 1] = propagate(turned, at)
        biases[here : end + 1] = bias
        at = quaternion[end]
    return Attitudes(quaternion, biases if with_bias else None)
