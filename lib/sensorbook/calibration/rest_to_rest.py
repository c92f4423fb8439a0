"""A gyroscope without a rate table: turned between rests, it must carry one gravity direction into the
next.

Scale factors and misalignments come from the calibrated accelerometer's directions before and after
each motion (Tedaldi, Pretto & Menegatti 2014, section IV), the bias and the sensitivity to acceleration
from the rests themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sensorbook.calibration.adjustment import outlier, paule_mandel, rms
from sensorbook.calibration.find import Found, beside
from sensorbook.calibration.model import FREE, ErrorModel
from sensorbook.calibration.multi_position import FOLDS
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.result import Calibration
from sensorbook.earth import EARTH_RATE
from sensorbook.errors import Refusal
from sensorbook.recordings.clock import advancing
from sensorbook.recordings.recording import Recording

ITERATIONS = 30
LONGEST = 60.0  # s of motion; longer, and the integral tells of noise and drift alone
FEWEST = 9
MAX_CONDITION = 20.0
VISIBLE = 0.003  # significance at which a sensitivity to acceleration is stated
SMALLEST_TURN = 5.0  # degrees; less tells nothing of a scale factor


@dataclass(frozen=True, eq=False)
class RestFit:
    """What the rests say: ``reading = bias + g_sensitivity · acceleration`` (A 5.2 at rest).

    Attributes
    ----------
    bias, g_sensitivity : (3,) rad/s, and (3, 3) rad/s per m/s²
    g_free : (3, 3) the diagonal, as A has it, or all of it where the rests ask for it
    covariance : of the biases and the free sensitivities, scaled by the residuals
    p_value, p_cross : that so large a diagonal, and so large entries off it, come by chance (F tests)
    excess : (3,) rad/s, standard deviation of a rest's mean beyond its white noise
    rms_before, rms_after, rms_check : rms of the readings at rest, rad/s: as they are, less what was
        fitted, and by fits without the rests judged
    """

    bias: np.ndarray
    g_sensitivity: np.ndarray
    g_free: np.ndarray
    covariance: np.ndarray
    p_value: float
    p_cross: float
    excess: np.ndarray
    rms_before: float = np.nan
    rms_after: float = np.nan
    rms_check: float = np.nan

    @property
    def visible(self) -> bool:
        """Whether a sensitivity to acceleration shows."""
        return min(self.p_value, self.p_cross) < VISIBLE


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


def fit_rests(
    positions: Positions, acceleration: np.ndarray, latitude: float | None = None
) -> RestFit:
    """Bias and sensitivity to acceleration from the gyroscope's rests.

    The sensitivity is diagonal, as A has it, unless the six entries off it lower the residuals by more
    than chance would (F test, 0.3 %).

    Parameters
    ----------
    positions : P rests of the gyroscope, rad/s
    acceleration : (P, 3) calibrated specific force in each, m/s²
    latitude : deg; the Earth's rate about the vertical, ω_e sin φ, is then taken out, else it counts
        as an uncertainty. Its horizontal part depends on the unknown heading and scatters the rests.

    Raises
    ------
    Refusal : fewer than six rests
    """
    count = len(positions)
    if count < FEWEST:
        raise Refusal(
            f"The gyroscope has {count} rests, too few to tell its bias from what acceleration adds.",
            f"Record at least {FEWEST} rests in different attitudes.",
        )
    length = np.linalg.norm(acceleration, axis=1)
    means = positions.means
    if latitude is not None:
        vertical = EARTH_RATE * np.sin(np.radians(latitude))
        means = means - vertical * acceleration / length[:, None]
    noise = np.diagonal(positions.covariances, axis1=1, axis2=2)
    diagonal, whole = (
        [_line(means[:, j], noise[:, j], acceleration[:, a]) for j, a in enumerate(columns)]
        for columns in (([0], [1], [2]), ([0, 1, 2],) * 3)
    )
    # Both with the weights of the larger model, or the excess would hide what it explains.
    gain = sum(
        _line(means[:, j], noise[:, j], acceleration[:, [j]], whole[j].excess).squares
        - whole[j].squares
        for j in range(3)
    )
    dof = 3 * (count - 4)
    p_cross = float(stats.f.sf(gain / 6 / (sum(w.squares for w in whole) / dof), 6, dof))
    lines = whole if p_cross < VISIBLE else diagonal
    g_free = np.ones((3, 3), dtype=bool) if p_cross < VISIBLE else np.eye(3, dtype=bool)
    bias = np.array([line.x[0] for line in lines])
    sensitivity = np.zeros((3, 3))
    sensitivity[g_free] = np.concatenate([line.x[1:] for line in lines])
    free = np.concatenate([line.x[1:] for line in lines])
    total = len(free) // 3
    covariance = np.zeros((3 + len(free), 3 + len(free)))
    for j, line in enumerate(lines):
        at = np.r_[j, 3 + total * j + np.arange(total)]
        covariance[np.ix_(at, at)] = line.covariance
    if latitude is None:
        # ω_e sin φ along the specific force looks like a sensitivity of all three axes alike.
        own = 3 + np.flatnonzero(np.eye(3, dtype=bool)[g_free])
        covariance[np.ix_(own, own)] += (EARTH_RATE / length.mean()) ** 2 / 3
    variances = np.array([line.covariance[1, 1] for line in diagonal])
    if latitude is None:
        variances = variances + (EARTH_RATE / length.mean()) ** 2 / 3
    statistic = np.mean([line.x[1] ** 2 for line in diagonal] / variances)
    p_value = float(stats.f.sf(statistic, 3, 3 * (count - 2)))
    excess = np.array([line.excess for line in lines])
    after, held = (np.empty_like(means) for _ in range(2))
    fold = np.arange(count) % FOLDS
    for j in range(3):
        columns = acceleration[:, g_free[j]]
        design = np.c_[np.ones(count), columns]
        after[:, j] = means[:, j] - design @ lines[j].x
        for k in range(FOLDS):
            out = fold == k
            part = _line(means[~out, j], noise[~out, j], columns[~out])
            held[out, j] = means[out, j] - design[out] @ part.x
    return RestFit(
        bias,
        sensitivity,
        g_free,
        covariance,
        p_value,
        p_cross,
        excess,
        rms(positions.means),
        rms(after),
        rms(held),
    )


@dataclass(frozen=True, eq=False)
class _Line:
    """A weighted straight line: intercept and slopes, their covariance, the weighted squares left."""

    x: np.ndarray
    covariance: np.ndarray
    squares: float
    excess: float


def _line(y, variance, columns, excess: float | None = None) -> _Line:
    """Fits (P,) readings of known white variance; `excess` by Paule and Mandel where not given."""
    design = np.c_[np.ones(len(y)), columns]
    dof = len(y) - design.shape[1]

    def solve(e: float):
        root = np.sqrt(variance + e**2)
        a, b = design / root[:, None], y / root
        x = np.linalg.lstsq(a, b, rcond=None)[0]
        return x, a, float(np.sum((b - a @ x) ** 2))

    if excess is None:
        excess = paule_mandel(lambda e: solve(e)[2], dof, float(np.std(y)))
    x, a, squares = solve(excess)
    return _Line(x, np.linalg.inv(a.T @ a) * squares / dof, squares, excess)


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
    return Motions(
        turns,
        positions.spans[rows + 1, 0] - positions.spans[rows, 1],
        directions.unit[rows],
        directions.unit[rows + 1],
        directions.frame[rows],
        directions.frame[rows + 1],
        tuple(f"{i + 1} → {i + 2}" for i in at),
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


def rest_to_rest(motions: Motions, fit: RestFit, gravity: float, check: bool = True) -> Calibration:
    """Scale factors and misalignments of a gyroscope, all nine, in the accelerometer's frame.

    Least squares of the angles between carried and measured directions; each motion gives two. The
    covariance is scaled by the residuals, and what the accelerometer's own parameters are uncertain by
    is carried into it. Motions that do not belong are set aside by name.

    Raises
    ------
    Refusal : fewer than nine motions, or turned about too few axes
    """
    _require_turns(motions)
    keep = np.ones(len(motions), dtype=bool)
    while True:
        used = motions[keep]
        inverse, rows, left = _solve(used)
        worst = _outlier(rows, left) if (~keep).sum() < len(keep) // 5 else None
        if worst is None:
            break
        keep[np.flatnonzero(keep)[worst]] = False
    dof = rows.shape[0] - 9
    scale = float(left @ left) / max(dof, 1)
    matrix = np.linalg.inv(inverse)
    # M = K⁻¹: dM = −M dK M
    jacobian = -np.kron(matrix, matrix.T)
    by_frame = -np.linalg.lstsq(rows, _by_frame(used, inverse), rcond=None)[0]
    own = np.linalg.inv(rows.T @ rows) * scale + by_frame @ by_frame.T
    covariance = np.zeros((9 + len(fit.covariance),) * 2)
    covariance[:9, :9] = jacobian @ own @ jacobian.T
    covariance[9:, 9:] = fit.covariance
    errors = direction_errors(used, inverse)
    return Calibration(
        method="rest_to_rest",
        sensor="gyroscope",
        data="means",
        model=ErrorModel(matrix, fit.bias, fit.g_sensitivity * fit.visible),
        free=FREE[12],
        g_free=fit.g_free,
        covariance=covariance,
        dof=dof,
        chi_square=np.nan,
        excess=np.sqrt(scale),
        residuals=errors,
        kept=keep,
        rejected=tuple(n for n, k in zip(motions.labels, keep, strict=True) if not k),
        gravity=gravity,
        rms_before=fit.rms_before,
        rms_after=fit.rms_after,
        rms_check=fit.rms_check,
        direction_errors=(
            rms(direction_errors(used, np.eye(3))),
            rms(errors),
            rms(held_out_turns(used)) if check else np.nan,
        ),
    )


def held_out_turns(motions: Motions) -> np.ndarray:
    """(R,) direction error of each motion by a fit without its fold, one in five, rad."""
    held = np.full(len(motions), np.nan)
    fold = np.arange(len(motions)) % FOLDS
    for k in range(FOLDS):
        out = fold == k
        held[out] = direction_errors(motions[out], _solve(motions[~out])[0])
    return held


def direction_errors(motions: Motions, inverse: np.ndarray) -> np.ndarray:
    """(R,) angle between carried and measured direction after each motion, rad."""
    end = predicted(motions, inverse)[0]
    cross = np.linalg.norm(np.cross(end, motions.after), axis=1)
    return np.arctan2(cross, (end * motions.after).sum(axis=1))


def turned_angles(motions: Motions) -> np.ndarray:
    """(R,) how far each motion turned the device as a whole, rad."""
    total = np.broadcast_to(np.eye(3), (len(motions), 3, 3))
    steps = rotation_matrices(motions.turns)
    for k in range(steps.shape[1]):
        total = total @ steps[:, k]
    return np.arccos(np.clip((np.trace(total, axis1=1, axis2=2) - 1) / 2, -1, 1))


def _tangents(directions: np.ndarray) -> np.ndarray:
    """(R, 2, 3) two unit vectors across each direction."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(directions, first)], axis=1)


def _solve(motions: Motions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, and the design (2R, 9) and residuals (2R,) there: Gauss–Newton from the nominal scale."""
    inverse = np.eye(3)
    across = _tangents(motions.after)
    for _ in range(ITERATIONS):
        end, derivative, _ = predicted(motions, inverse)
        left = np.einsum("rij,rj->ri", across, end).reshape(-1)
        rows = np.einsum("rij,rjk->rik", across, derivative).reshape(-1, 9)
        step = np.linalg.lstsq(rows, -left, rcond=None)[0].reshape(3, 3)
        inverse = inverse + step
        if np.abs(step).max() < 1e-9:
            break
    return inverse, rows, left


def _by_frame(motions: Motions, inverse: np.ndarray) -> np.ndarray:
    """(2R, K) what one standard error of each of the accelerometer's parameters does to the residuals."""
    carried = predicted(motions, inverse)[2] @ motions.frame_before
    across = _tangents(motions.after)
    return (across @ (carried - motions.frame_after)).reshape(2 * len(motions), -1)


def _outlier(rows: np.ndarray, left: np.ndarray) -> int | None:
    """Index of the motion that does not belong, by the worse of its two angles."""
    found = outlier(left / max(rms(left), 1e-300), rows)
    return None if found is None else found // 2


def _require_turns(motions: Motions) -> None:
    """Raises `Refusal` where the motions cannot determine nine parameters."""
    useful = int((turned_angles(motions) > np.radians(SMALLEST_TURN)).sum()) if len(motions) else 0
    if useful < FEWEST:
        raise Refusal(
            f"There are {useful} motions of at most {LONGEST:g} s between two rests that turn the "
            f"device by more than {SMALLEST_TURN:g}°, and {FEWEST} are needed for the nine scale factors "
            "and misalignments of a gyroscope.",
            "Go from rest to rest through 18 positions or more, turning by 90° about x, y and z.",
        )
    derivative = predicted(motions, np.eye(3))[1]
    across = _tangents(motions.after)
    rows = np.einsum("rij,rjk->rik", across, derivative).reshape(-1, 9)
    _, singular, vectors = np.linalg.svd(rows, full_matrices=False)
    condition = singular[0] / singular[-1] if singular[-1] > 0 else np.inf
    if condition > MAX_CONDITION:
        # Of K's columns the weakest tells about which sensed axis too little was turned.
        weak = "xyz"[int(np.argmax(np.linalg.norm(vectors[-1].reshape(3, 3), axis=0)))]
        raise Refusal(
            f"The motions turn the device too little about {weak}: the condition number of the nine "
            f"scale factors and misalignments is {condition:.3g} (at most {MAX_CONDITION:g}).",
            f"Add motions of 90° and more about {weak}, held level, so that gravity is turned along.",
        )
