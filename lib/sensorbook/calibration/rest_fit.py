"""What a gyroscope reads at rest: its bias, and what acceleration adds (A 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sensorbook.calibration.adjustment import paule_mandel, rms
from sensorbook.calibration.multi_position import FOLDS
from sensorbook.calibration.positions import Positions
from sensorbook.earth import EARTH_RATE
from sensorbook.errors import Refusal

FEWEST = 9  # rests
VISIBLE = 0.003  # significance at which a sensitivity to acceleration is stated


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
    left = max(sum(w.squares for w in whole), 1e-300)
    p_cross = float(stats.f.sf(gain / 6 / (left / dof), 6, dof))
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
    # Rests that read the same counts share their rounding, which no average takes away.
    covariance[:3, :3] += np.diag(positions.rounding.mean(axis=0))
    if latitude is None:
        # ω_e sin φ along the specific force looks like a sensitivity of all three axes alike.
        own = 3 + np.flatnonzero(np.eye(3, dtype=bool)[g_free])
        covariance[np.ix_(own, own)] += (EARTH_RATE / length.mean()) ** 2 / 3
    variances = np.array([line.covariance[1, 1] for line in diagonal])
    if latitude is None:
        variances = variances + (EARTH_RATE / length.mean()) ** 2 / 3
    statistic = np.mean([line.x[1] ** 2 for line in diagonal] / np.maximum(variances, 1e-300))
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


def scale_by_earth_rate(positions: Positions, fit: RestFit) -> tuple[float, float]:
    """Scatter of a rest's mean (rad/s), and the relative standard error of a scale factor from rests.

    The Earth's rate is all that a resting gyroscope is turned by; it lies along an axis in a third of
    the rests' mean square.
    """
    white = np.trace(positions.covariances, axis1=1, axis2=2).mean() / 3
    scatter = float(np.sqrt(white + np.mean(fit.excess**2)))
    return scatter, scatter / EARTH_RATE / float(np.sqrt(len(positions) / 3))


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
