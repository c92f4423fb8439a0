"""A gyroscope's motions between rests, and where they carry the direction of gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.calibration.find import Found, beside
from sensorbook.calibration.model import ErrorModel
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.rest_fit import RestFit
from sensorbook.calibration.result import Calibration
from sensorbook.recordings.clock import advancing
from sensorbook.recordings.recording import Recording

LONGEST = 60.0  # s of motion; longer, and the integral tells of noise and drift alone


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of the specific force in P rests, by a calibrated accelerometer.

    Attributes
    ----------
    unit : (P, 3)
    acceleration : (P, 3) m/s²
    frame : (P, 3, K) what `unit` changes by for one standard error of each of K independent
        combinations of the accelerometer's parameters, the same in all rests
    """

    unit: np.ndarray
    acceleration: np.ndarray
    frame: np.ndarray

    @classmethod
    def by(cls, level: Calibration, positions: Positions) -> Directions:
        """From the accelerometer's calibration and its rests."""
        true = level.model.correct(positions.means)
        length = np.linalg.norm(true, axis=1)[:, None]
        unit = true / length
        inverse = np.linalg.inv(level.model.matrix)
        rows, columns = np.nonzero(level.free)
        # true = M⁻¹(l − b): d true = −M⁻¹(dM true + db)
        change = (
            np.concatenate(
                [
                    -inverse[None, :, rows] * true[:, None, columns],
                    np.broadcast_to(-inverse, (len(true), 3, 3)),
                ],
                axis=2,
            )
            / length[:, :, None]
        )
        change -= unit[:, :, None] * np.einsum("pi,pik->pk", unit, change)[:, None, :]
        return cls(unit, true, change @ np.linalg.cholesky(level.covariance))


@dataclass(frozen=True, eq=False)
class Motions:
    """The stretches between neighbouring rests, R of them, padded to one length.

    Attributes
    ----------
    turns : (R, L, 3) rad, turned in each step by the sensor's own scale, less the bias
    seconds : (R,) duration
    before, after : (R, 3) directions of the specific force in the rests on both sides
    frame_before, frame_after : (R, 3, K) what one standard error each of the accelerometer's
        parameters does to them
    labels : such as "4 → 5"
    """

    turns: np.ndarray
    seconds: np.ndarray
    before: np.ndarray
    after: np.ndarray
    frame_before: np.ndarray
    frame_after: np.ndarray
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.turns)

    def __getitem__(self, rows) -> Motions:
        at = np.arange(len(self))[rows]
        return Motions(
            self.turns[at],
            self.seconds[at],
            self.before[at],
            self.after[at],
            self.frame_before[at],
            self.frame_after[at],
            tuple(self.labels[i] for i in at),
        )


def motions_between(
    time: np.ndarray,
    values: np.ndarray,
    positions: Positions,
    directions: Directions,
    run: int = 0,
    offset: np.ndarray | None = None,
) -> Motions:
    """The motions of one recording.

    Parameters
    ----------
    time, values : (N,) s and (N, 3) rad/s of the gyroscope
    positions : its rests in order of time, with the gyroscope's own samples
    directions : of the specific force in each, from the calibrated accelerometer
    run : the recording's index among the positions' runs
    offset : (N, 3) rad/s, what acceleration adds to each sample; taken out

    The bias follows the rests' means from one to the next, so that its drift does no harm. A step's
    turn is the mean rate times its length, with the coning term ``Δt²/12 ω_k × ω_{k+1}`` (Bortz 1971;
    Savage 1998, eq. 47 for two samples).
    """
    free = values if offset is None else values - offset
    known = np.isfinite(free).all(axis=1)
    parts, at = [], []
    step = float(np.median(np.diff(time)))
    for i in range(len(positions) - 1):
        if not positions.runs[i] == positions.runs[i + 1] == run:
            continue
        start, end = positions.spans[i, 1], positions.spans[i + 1, 0]
        inside = np.flatnonzero((time >= start) & (time <= end))
        if not 0 < end - start <= LONGEST or len(inside) < 3 or not known[inside].all():
            continue
        if np.diff(time[inside]).max() > 5 * step:
            continue  # samples are missing: what was turned meanwhile is not known
        levels = []
        for k in (i, i + 1):
            rest = (time >= positions.spans[k, 0]) & (time <= positions.spans[k, 1]) & known
            levels.append(free[rest].mean(axis=0))
        t, w = time[inside], free[inside]
        share = ((t - t[0]) / (t[-1] - t[0]))[:, None]
        w = w - (1 - share) * levels[0] - share * levels[1]
        dt = np.diff(t)[:, None]
        parts.append((w[1:] + w[:-1]) / 2 * dt + dt**2 / 12 * np.cross(w[:-1], w[1:]))
        at.append(i)
    turns = np.zeros((len(parts), max(map(len, parts), default=0), 3))
    for k, part in enumerate(parts):
        turns[k, : len(part)] = part
    rows = np.array(at, dtype=int)
    names = [label.split(" (")[0] for label in positions.labels]
    return Motions(
        turns,
        positions.spans[rows + 1, 0] - positions.spans[rows, 1],
        directions.unit[rows],
        directions.unit[rows + 1],
        directions.frame[rows],
        directions.frame[rows + 1],
        tuple(f"{names[i]} → {names[i + 1]}" for i in at),
    )


def _joined(parts: Sequence[Motions]) -> Motions:
    """The motions of several recordings as one."""
    length = max(p.turns.shape[1] for p in parts)
    padded = [np.pad(p.turns, ((0, 0), (0, length - p.turns.shape[1]), (0, 0))) for p in parts]
    return Motions(
        np.vstack(padded),
        np.concatenate([p.seconds for p in parts]),
        np.vstack([p.before for p in parts]),
        np.vstack([p.after for p in parts]),
        np.concatenate([p.frame_before for p in parts]),
        np.concatenate([p.frame_after for p in parts]),
        tuple(label for p in parts for label in p.labels),
    )


def all_motions(
    gyroscopes: Sequence[Recording],
    accelerometers: Sequence[Recording],
    found: Found,
    directions: Directions,
    model: ErrorModel,
    fit: RestFit,
) -> Motions:
    """The motions of all recordings; what acceleration adds to the gyroscope is taken out sample by
    sample, where it shows.

    Parameters
    ----------
    gyroscopes, accelerometers : the recordings; those of the accelerometer in the order of `found`
    directions : of the specific force in each rest
    model : of the accelerometer
    """
    parts = []
    for run, a in enumerate(accelerometers):
        g = beside(a, gyroscopes)
        good = advancing(g.time) & np.isfinite(g.values).all(axis=1)
        time, values = g.time[good] + g.start - a.start, g.values[good]
        offset = None
        if fit.visible:
            known = advancing(a.time) & np.isfinite(a.values).all(axis=1)
            true = model.correct(a.values[known])
            felt = np.array([np.interp(time, a.time[known], column) for column in true.T]).T
            offset = felt @ fit.g_sensitivity.T
        parts.append(motions_between(time, values, found.gyroscope, directions, run, offset))
    return _joined(parts)


def predicted(motions: Motions, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions carried through each motion by the gyroscope, and their derivatives.

    Parameters
    ----------
    inverse : (3, 3) K = M⁻¹, which corrects a reading less its bias

    Returns (R, 3) unit directions, (R, 3, 9) derivatives by the entries of K, row by row, and the
    (R, 3, 3) rotations.
    """
    steps = rotation_matrices(-(motions.turns @ inverse.T))
    r, length = motions.turns.shape[:2]
    rest = np.broadcast_to(np.eye(3), (r, 3, 3))
    # Backwards: what is turned in a step is carried by all that follow.
    tilt = np.zeros((r, 3, 9))
    for k in range(length - 1, -1, -1):
        tilt += (rest[:, :, :, None] * motions.turns[:, k][:, None, None, :]).reshape(r, 3, 9)
        rest = rest @ steps[:, k]
    end = np.einsum("rij,rj->ri", rest, motions.before)
    # du = u × (Σ T dφ)
    return end, np.cross(end[:, None, :], tilt.transpose(0, 2, 1)).transpose(0, 2, 1), rest


def rotation_matrices(vectors: np.ndarray) -> np.ndarray:
    """(…, 3) rotation vectors → (…, 3, 3) matrices, by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    zero = np.zeros(vectors.shape[:-1])
    x, y, z = np.moveaxis(vectors, -1, 0)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*zero.shape, 3, 3)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(angle) / safe)
    second = np.where(small, 0.5, (1 - np.cos(angle)) / safe**2)
    return np.eye(3) + first * k + second * (k @ k)
