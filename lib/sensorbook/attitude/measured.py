"""Reference attitudes with a covariance from what a device measures: gravity and field, or a camera.

Gravity gives roll and pitch, the Earth's field the heading. Both are only as good as their direction
is: an accelerometer reads the body's own acceleration with gravity, a compass reads the iron around it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import References
from sensorbook.attitude.vectors import triad
from sensorbook.errors import Refusal

# A vector's length tells its error along it. The two across it turn the direction and are not seen; they
# are as large on average. Of the body's acceleration the length is squared and averaged over `WINDOW`;
# of the field, whose errors last as long as the body stays where it is, half of it is the whole record's.
# A few independent errors in a window are at times far too small by chance: hence factors above 1. All
# were set on simulated motions, where δᵀP⁻¹δ/3 is 0.7 to 1.5 on average; a body that is shaken by 1 to
# 3 m/s² throughout hides from them what rest would show, and has 1.5 to 2.8.
WINDOW = 2.0  # s
GRAVITY_FACTOR, FIELD_FACTOR = 1.2, 1.3
HOPELESS = 0.3  # share of its length by which a vector may be off
LEAST_DIP_GAP = np.radians(2.0)  # between gravity and field: nearer, no heading follows
LEAST_STD = 1e-4  # rad: nobody mounts such a sensor better
QUIETEST = 0.2  # share of the record's blocks, those whose length scatters least
BLOCK, LEAST_BLOCK = 0.5, 5  # s, and readings
MENTIONED = 0.005  # share of the stamps without an attitude, below which nobody needs to know
UNEVEN = 0.1  # share by which an uncalibrated compass's field varies, least to greatest
EXPLAINED = 0.7  # share of its variance that the attitude explains where iron on board makes it
CORRELATION = 0.5  # s, that accelerations of a body last
_ROUNDS, _SETTLED = 20, 1e-7  # of reweighting, at most; rad that the mean moves in the last
_HUBER = 1.5  # times the median angle
_STRETCHES, _LEAST_STRETCHES = 20, 4  # whose means tell the error of a mean


@dataclass(frozen=True, eq=False)
class Measured:
    """Attitudes from gravity and field.

    Attributes
    ----------
    references : those that could be had, north, east, down → body
    left_out : stamps without one, by reason
    gravity : m/s², strength that the accelerometer reads at rest
    field : T, median strength
    dip : rad, of the field below the horizon
    notes : sentences about what was found
    """

    references: References
    left_out: Mapping[str, int]
    gravity: float
    field: float
    dip: float
    notes: tuple[str, ...]


def from_gravity_and_field(
    time: ArrayLike,
    force: ArrayLike,
    field: ArrayLike,
    declination: float = 0.0,
    gravity: float | None = None,
    force_std: float | None = None,
    field_std: float | None = None,
) -> Measured:
    """Attitudes from an accelerometer and a magnetometer, by TRIAD with gravity as the trusted vector.

    Gravity settles roll and pitch; only the field's horizontal part turns the attitude, about the
    vertical. The field's dip is the record's own median, and takes part in the covariance alone: where
    gravity errs, what it takes for horizontal holds some of the field's vertical part.

    Errors last as long as the accelerations that make them, some tenths of a second, and those of the
    compass as long as the body stays where it is: neighbouring references do not err independently.
    Thin them by `References.at_rate`, to 1 Hz or so, or `widen` them before a filter takes them all. What
    stays in the body's axes (a bias of the accelerometer, iron on board) averages out in no filter: there
    its covariance stays too small.

    Parameters
    ----------
    time : (N,) s, ascending, the motion's stamps
    force : (N, 3) m/s², specific force in body axes, upwards at rest; NaN where missing
    field : (N, 3) T, in body axes; NaN where missing
    declination : rad, of magnetic north east of true north; 0 leaves north magnetic
    gravity : m/s²; left out, the median strength over the record's quietest stretches
    force_std, field_std : m/s² and T, noise of a reading an axis; left out, from the same stretches

    Raises
    ------
    Refusal
        no stamp gives an attitude
    ValueError
        shapes that do not belong together
    """
    time = np.asarray(time, dtype=float)
    force, field = np.asarray(force, dtype=float), np.asarray(field, dtype=float)
    if time.ndim != 1 or not force.shape == field.shape == (len(time), 3):
        raise ValueError(
            f"time {time.shape}, force {force.shape} and field {field.shape}: "
            "needed are (N,), (N, 3) and (N, 3)"
        )
    there = np.isfinite(force).all(axis=1) & np.isfinite(field).all(axis=1)
    if not there.any():
        raise Refusal(
            f"None of {len(time)} stamps has readings of both accelerometer and magnetometer.",
            "Record both while the gyroscope records.",
        )
    size, strength = np.linalg.norm(force, axis=1), np.linalg.norm(field, axis=1)
    usual = float(np.median(strength[there]))
    level, scatter = _at_rest(time[there], size[there])
    gravity = level if gravity is None else gravity
    if not (gravity > 0 and usual > 0):
        raise Refusal("The accelerometer or the magnetometer reads nothing but 0.", "Record both.")
    pulled, bent = size / gravity - 1, strength / usual - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = -(force * field).sum(axis=1) / (size * strength)
    dips = np.arcsin(np.clip(sine, -1.0, 1.0))
    reasons = {
        "no reading": ~there,
        "acceleration": np.abs(pulled) > HOPELESS,
        "disturbed field": np.abs(bent) > HOPELESS,
        "field near the vertical": ~(np.abs(dips) < np.pi / 2 - LEAST_DIP_GAP),
    }
    good = np.ones(len(time), dtype=bool)
    left_out = {}
    for reason, wrong in reasons.items():
        left_out[reason] = int((wrong & good).sum())
        good &= ~wrong
    if not good.any():
        said = ", ".join(f"{reason} at {count}" for reason, count in left_out.items() if count)
        raise Refusal(
            f"None of {len(time)} stamps gives an attitude from gravity and field: {said}.",
            "Move less fast, away from iron, with a calibrated magnetometer.",
        )
    dip = float(np.median(dips[good]))
    if force_std is None:
        force_std = scatter
    if field_std is None:
        field_std = _at_rest(time[there], strength[there])[1]
    seen = _mean_square(time, pulled, there)
    usable = there & ~reasons["disturbed field"]
    everywhere = (np.mean(bent[usable] ** 2) + _mean_square(time, bent, usable)) / 2
    down_std = _std(force_std / gravity, seen, GRAVITY_FACTOR)
    north_std = _std(field_std / usual, everywhere, FIELD_FACTOR)
    # What two tilts make of the heading together, which the covariance, to first order, does not hold.
    north_std = np.hypot(north_std, down_std**2 * np.hypot(1, np.sin(dip) ** 2 / np.cos(dip)))
    north = [np.cos(dip) * np.cos(declination), np.cos(dip) * np.sin(declination), np.sin(dip)]
    found = triad(
        np.stack([-force[good], field[good]], axis=1),
        [[0.0, 0.0, 1.0], north],
        sigma=np.stack([down_std[good], north_std[good]], axis=1),
    )
    return Measured(
        References(np.flatnonzero(good), found.quaternion, found.covariance),
        left_out,
        gravity,
        usual,
        dip,
        _notes(time[there], field[there] / usual, dip, left_out, len(time)),
    )


def widen(
    references: References, time: ArrayLike, correlation_time: float = CORRELATION
) -> References:
    """The same references for a filter that takes each for independent: covariances times Σ ρ.

    Errors that correlate by ρ = exp(−|Δt|/`correlation_time`) average as slowly as independent ones
    whose variance is Σ ρ times as large, the sum over all references around. At 30 a second and 0.5 s
    that is 30; at one a second 1.3. `time` (N,) s are the motion's stamps.
    """
    if not len(references):
        return references
    fade = np.exp(-np.diff(np.asarray(time, dtype=float)[references.at]) / correlation_time)
    total = 1 + _faded(fade) + _faded(fade[::-1])[::-1]
    return References(
        references.at, references.quaternion, references.covariance * total[:, None, None]
    )


def _faded(fade: np.ndarray) -> np.ndarray:
    """(M,) Σ ρ over those before each, from ρ (M − 1,) between neighbours."""
    sums = np.zeros(len(fade) + 1)
    for k, factor in enumerate(fade.tolist()):
        sums[k + 1] = factor * (1 + sums[k])
    return sums


@dataclass(frozen=True, eq=False)
class Alignment:
    """The constant rotation from one reference frame to another.

    Attributes
    ----------
    quaternion : (4,), scalar last; as scipy's Rotation it turns a vector's components in the first
        frame into those in the second
    covariance : (3, 3), rad², of its error's rotation vector in the second frame's axes; NaN from
        fewer than 8 pairs
    rms : rad, of the angle that is left in a pair
    pairs : number of them
    """

    quaternion: np.ndarray
    covariance: np.ndarray
    rms: float
    pairs: int

    def applied(self, quaternion: ArrayLike) -> np.ndarray:
        """Attitudes (N, 4) against the first frame made such against the second; NaN stays."""
        quaternion = np.asarray(quaternion, dtype=float)
        known = np.isfinite(quaternion).all(axis=-1)
        turned = np.full(quaternion.shape, np.nan)
        turned[known] = (
            Rotation.from_quat(self.quaternion) * Rotation.from_quat(quaternion[known])
        ).as_quat()
        return turned


def align_frames(found: ArrayLike, reference: ArrayLike) -> Alignment:
    """The constant rotation from the frame of `found` to that of `reference`, from pairs (N, 4) of attitudes.

    The chordal mean with Huber's weights, so that some wrong pairs move it little. Its covariance is from the
    scatter of the means of up to 20 stretches of pairs in their order, which holds where neighbours
    err alike. Pairs with NaN are left out.

    Raises
    ------
    Refusal
        no pair
    """
    found, reference = np.asarray(found, dtype=float), np.asarray(reference, dtype=float)
    if found.shape != reference.shape or found.ndim != 2 or found.shape[1] != 4:
        raise ValueError(f"attitudes {found.shape} and {reference.shape}: needed is (N, 4) of both")
    known = np.isfinite(found).all(axis=1) & np.isfinite(reference).all(axis=1)
    if not known.any():
        raise Refusal(
            "No two attitudes belong together: the turn between their frames is not known.",
            "Record both over the same time.",
        )
    turns = Rotation.from_quat(reference[known]) * Rotation.from_quat(found[known]).inv()
    weights = np.ones(len(turns))
    before = Rotation.identity()
    for _ in range(_ROUNDS):
        mean = turns.mean(weights)
        moved, before = (mean * before.inv()).magnitude(), mean
        off = (turns * mean.inv()).as_rotvec()
        angle = np.linalg.norm(off, axis=1)
        limit = max(_HUBER * np.median(angle), np.finfo(float).eps)
        weights = limit / np.maximum(angle, limit)
        if moved < _SETTLED:
            break
    stretches = min(_STRETCHES, len(turns) // 2)
    covariance = np.full((3, 3), np.nan)
    if stretches >= _LEAST_STRETCHES:
        pull = weights[:, None] * off / weights.mean()
        means = [part.mean(axis=0) for part in np.array_split(pull, stretches)]
        covariance = np.cov(means, rowvar=False) / stretches
    return Alignment(mean.as_quat(), covariance, float(np.sqrt(np.mean(angle**2))), len(turns))


def from_camera(
    images: Iterable[Mapping],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitudes from the camera chapter's record, `camera.images` of results.json, in order of time.

    Those images that were solved and have a time; what two images tell together counts once. The
    covariance is `attitude_covariance`, and in records without one the squares of `attitude_std_deg`,
    which is about the body's axes.

    Returns
    -------
    time : (M,) s since 1970 (UTC), as the clock of a recording with ISO time stamps counts
    quaternion : (M, 4), inertial → body
    covariance : (M, 3, 3) rad², of the error vector in body axes

    Raises
    ------
    Refusal
        no image has both an attitude and a time
    """
    solved, seen = [], set()
    for image in images:
        pair = frozenset((image["image"], image.get("partner") or image["image"]))
        std = image.get("attitude_std_deg")
        if image["quaternion"] is None or not image.get("time") or std is None or pair in seen:
            continue
        covariance = image.get("attitude_covariance")
        if covariance is None:
            covariance = np.diag(np.radians(std) ** 2)
        if not (np.diag(covariance) > 0).all():
            continue
        seen.add(pair)
        moment = np.datetime64(image["time"].removesuffix("Z"), "us") - np.datetime64(0, "us")
        solved.append((moment / np.timedelta64(1, "s"), image["quaternion"], covariance))
    if not solved:
        raise Refusal(
            "No image of the camera has both an attitude and a time.",
            "Give the images' times and places in a poses file.",
        )
    solved.sort(key=lambda row: row[0])
    time, quaternion, covariance = (
        np.array(column, dtype=float) for column in zip(*solved, strict=True)
    )
    return time, quaternion, covariance


def _blocks(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(B, L, …): `values` (N, …) in blocks of `BLOCK` s, without what is left over."""
    step = np.median(np.diff(time)) if len(time) > 1 else BLOCK
    length = min(max(LEAST_BLOCK, round(BLOCK / step)), len(time))
    return values[: len(time) // length * length].reshape(-1, length, *values.shape[1:])


def _at_rest(time: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """Level of a vector's length (N,) over the quietest stretches, and its scatter about it.

    The length and not the vector: a body that turns slowly is at rest, too.
    """
    blocks = _blocks(time, size)
    scatter = blocks.std(axis=1)
    quiet = blocks[scatter <= np.quantile(scatter, QUIETEST)]
    level = float(np.median(quiet))
    return level, float(np.sqrt(np.mean((quiet - level) ** 2)))


def _mean_square(time: np.ndarray, values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(N,) mean of the squares of `values` (N,) that are there, over `WINDOW` around each stamp."""
    sums = np.r_[0.0, np.cumsum(np.where(there, values, 0.0) ** 2)]
    count = np.r_[0, np.cumsum(there)]
    first, last = np.searchsorted(time, time - WINDOW / 2), np.searchsorted(time, time + WINDOW / 2)
    return (sums[last] - sums[first]) / np.maximum(count[last] - count[first], 1)


def _std(noise: float, seen: np.ndarray, factor: float) -> np.ndarray:
    """(N,) rad, of a direction: noise, and what the length shows beyond it (mean squares, (N,))."""
    return np.sqrt(max(noise, LEAST_STD) ** 2 + factor * np.maximum(seen - noise**2, 0.0))


def _notes(
    time: np.ndarray, field: np.ndarray, dip: float, left_out: Mapping[str, int], count: int
) -> tuple[str, ...]:
    """What is to be said of stamps without an attitude, and of the field (N, 3), as shares of its median."""
    notes = []
    lost = {reason: k for reason, k in left_out.items() if k}
    if sum(lost.values()) > MENTIONED * count:
        said = ", ".join(f"{reason} {k}" for reason, k in lost.items())
        notes.append(
            f"{sum(lost.values())} of {count} stamps have no attitude from gravity and field: {said}."
        )
    # Means over blocks: a sensor's noise is no uneven field.
    strength = _blocks(time, np.linalg.norm(field, axis=1)).mean(axis=1)
    means = _blocks(time, field).mean(axis=1)
    x, y, z = means.T / np.maximum(np.linalg.norm(means, axis=1), np.finfo(float).tiny)
    # What hard and soft iron make of a field's strength, to first order.
    terms = np.stack([np.ones_like(x), x, y, z, x * y, x * z, y * z, x * x - z * z, y * y - z * z])
    by_attitude = terms.T @ np.linalg.lstsq(terms.T, strength, rcond=None)[0]
    explained = np.var(by_attitude) / max(np.var(strength), np.finfo(float).tiny)
    spread, whole = (
        float(np.diff(np.quantile(v, [0.025, 0.975]))[0]) for v in (by_attitude, strength)
    )
    if spread > UNEVEN and explained > EXPLAINED:
        off = np.degrees(np.arcsin(min(1.0, spread / 2 / np.cos(dip))))
        notes.append(
            f"The strength of the magnetic field varies by {100 * spread:.0f} % with the attitude: the "
            f"compass needs calibration, and the heading may be off by about {off:.0f}°."
        )
    elif whole > UNEVEN:
        notes.append(
            f"The strength of the magnetic field varies by {100 * whole:.0f} %, and not with the attitude: "
            "iron or currents nearby disturb the heading."
        )
    return tuple(notes)
