"""Multi-position calibration: at rest the specific force has the length of gravity (B 17, 18)."""

from __future__ import annotations

import numpy as np

from sensorbook.calibration.adjustment import outliers, paule_mandel, rms
from sensorbook.calibration.coverage import Coverage, coverage, positions_to_add
from sensorbook.calibration.model import FREE, ErrorModel, parameter_names
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.result import Calibration
from sensorbook.errors import Refusal

ITERATIONS = 50
FOLDS = 5
# 18 directions anywhere stay below 15 in 99 % of sets; a cone of 60° has 42, a great circle hundreds.
MAX_CONDITION = 30.0
WEAK_PRIOR = (
    0.1  # standard deviation of each entry that keeps twelve parameters' normal matrix regular
)


def enough(parameters: int = 9):
    """The test that a set of directions must pass: a function of its `Coverage`."""
    return lambda found: found.distinct >= parameters and found.condition <= MAX_CONDITION


def multi_position(
    positions: Positions,
    gravity: float,
    parameters: int = 9,
    data: str = "means",
    check: bool = True,
) -> Calibration:
    """Calibrates from rests in many attitudes; no attitude needs to be known.

    Combined (Gauss–Helmert) adjustment of ``f = ‖M⁻¹(l − b)‖ − g = 0`` in the parameters and the
    observations, iterated; M lower triangular with 9 parameters (B 3), diagonal with 6. Twelve are
    not separable: see `twelve_parameter_correlation`.

    Parameters
    ----------
    positions : P rests, m/s²
    gravity : local, m/s²
    parameters : 6 or 9
    data : "means" (weighted by their covariance), or "raw" and "denoised" samples (unit weights)
    check : hold out positions for `rms_check`, by recording where there are several

    Raises
    ------
    Refusal : the directions do not determine the parameters; says which positions to add

    The covariance is scaled by the residuals; with means a standard deviation common to all positions
    is added first (`paule_mandel`), and positions that do not belong are set aside by name.
    """
    free = FREE[parameters]
    require_coverage(positions, gravity, free)
    keep = np.ones(len(positions), dtype=bool)
    while True:
        fit = _Fit(positions[keep], gravity, free, data)
        # At most a fifth is set aside: more is no outlier but a model that does not fit.
        left = len(keep) // 5 - int((~keep).sum())
        bad = fit.outliers(left) if data == "means" and left > 0 else ()
        if not bad:
            break
        trial = keep.copy()
        trial[np.flatnonzero(keep)[list(bad)]] = False
        if not enough(parameters)(coverage(directions_of_rests(positions[trial], gravity), free)):
            break
        keep = trial
    used = positions[keep]
    return Calibration(
        method="multi_position",
        sensor="accelerometer",
        data=data,
        model=fit.model,
        free=free,
        covariance=fit.covariance,
        dof=fit.dof,
        chi_square=fit.chi_square,
        excess=fit.excess,
        residuals=norm_errors(fit.model, used, gravity),
        kept=keep,
        rejected=tuple(name for name, k in zip(positions.labels, keep, strict=True) if not k),
        gravity=gravity,
        rms_before=rms(np.linalg.norm(used.means, axis=1) - gravity),
        rms_after=rms(norm_errors(fit.model, used, gravity)),
        rms_check=rms(held_out(used, gravity, free, data)) if check else np.nan,
    )


def norm_errors(model: ErrorModel, positions: Positions, gravity: float) -> np.ndarray:
    """(P,) ``‖corrected mean‖ − g``, m/s²."""
    return np.linalg.norm(model.correct(positions.means), axis=1) - gravity


def folds(positions: Positions) -> np.ndarray:
    """(P,) which fold each position belongs to: its recording, or one of five where there is one.

    Of fewer than fifteen positions each is a fold of its own, or too few would remain.
    """
    if len(np.unique(positions.runs)) > 1:
        return np.unique(positions.runs, return_inverse=True)[1]
    return np.arange(len(positions)) % (FOLDS if len(positions) >= 3 * FOLDS else len(positions))


def held_out(positions: Positions, gravity: float, free: np.ndarray, data: str) -> np.ndarray:
    """(P,) ``‖a‖ − g`` of each position by a fit without its fold; NaN where the rest cannot tell."""
    errors = np.full(len(positions), np.nan)
    fold = folds(positions)
    for k in np.unique(fold):
        out = fold == k
        found = coverage(directions_of_rests(positions[~out], gravity), free)
        if found.condition <= 2 * MAX_CONDITION:
            model = _Fit(positions[~out], gravity, free, data).model
            errors[out] = norm_errors(model, positions[out], gravity)
    return errors


def require_coverage(positions: Positions, gravity: float, free: np.ndarray) -> Coverage:
    """The coverage; raises `Refusal` where the directions do not determine the parameters."""
    count = int(free.sum()) + 3
    directions = directions_of_rests(positions, gravity)
    if len(positions):
        found = coverage(directions, free)
        if enough(count)(found) and len(positions) > count:
            return found
        if enough(count)(found):
            raise Refusal(
                f"{count} positions give {count} parameters exactly, and nothing to judge them by.",
                "Record three positions more, or better eighteen in all.",
            )
        add = positions_to_add(directions, free, enough(count))
        alike = len(positions) - found.distinct
        reason = (
            f"{_count(len(positions), 'rest')} in {_count(found.distinct, 'distinct direction')}"
            + (f" ({alike} alike within 15°)" if alike else "")
            + f" do not determine {count} parameters from the length of gravity alone: "
            + (
                "the condition number is beyond 10⁸"
                if found.condition > 1e8
                else f"the condition number is {found.condition:.3g}"
            )
            + f" (at most {MAX_CONDITION:g}), and {count} distinct directions are needed."
        )
        remedy = f"Record them again with these positions added: {', '.join(add)}."
        raise Refusal(reason, remedy)
    raise Refusal(
        "No rest was found in the recording.",
        "Hold the device still for at least 2 s in each of 18 positions or more.",
    )


def twelve_parameter_correlation(
    calibration: Calibration, positions: Positions
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and (12, 12) correlations of the model with all six off-diagonals (B 3.1).

    ``‖a‖`` does not change when the sensor's frame turns, so that three directions of the twelve are
    not observed at all; a prior of `WEAK_PRIOR` on each entry makes their variance finite.
    """
    used = positions[calibration.kept]
    true = calibration.model.correct(used.means)
    a, _ = _derivatives(calibration.model, true, FREE[12])
    variance = _variances(calibration.model, true, used.covariances) + calibration.excess**2
    normal = (a / variance[:, None]).T @ a + np.diag(np.r_[np.full(9, WEAK_PRIOR**-2), np.zeros(3)])
    c = np.linalg.inv(normal)
    s = np.sqrt(np.diag(c))
    return (*parameter_names(FREE[12]), "bias.x", "bias.y", "bias.z"), c / np.outer(s, s)


class _Fit:
    """One adjustment: iterates in parameters and observations, scales the covariance."""

    def __init__(self, positions: Positions, gravity: float, free: np.ndarray, data: str):
        self.gravity, self.free = gravity, free
        if data == "means":
            self.l, self.c = positions.means, positions.covariances
        else:
            self.l = np.vstack(positions.samples)
            self.c = np.broadcast_to(np.eye(3), (len(self.l), 3, 3))
        self.dof = len(self.l) - int(free.sum()) - 3
        self.excess = 0.0
        self.model = self._start()
        self._solve(0.0)
        if data == "means":
            self.excess = self._excess()
        self.chi_square = self.white / max(self.dof, 1)
        # What rounding hides does not show in the residuals either.
        scale = self.squares / max(self.dof, 1)
        self.covariance = np.linalg.inv(self.normal) * (
            max(scale, 1.0) if positions.coarse.any() else scale
        )

    def _start(self) -> ErrorModel:
        """The ellipsoid through the observations, by linear least squares, where it is one."""
        scale = np.abs(self.l).max()
        x = self.l / scale
        if self.free.sum() == 3:
            quadratic = x**2
        else:
            quadratic = np.c_[
                x**2, 2 * x[:, 0] * x[:, 1], 2 * x[:, 0] * x[:, 2], 2 * x[:, 1] * x[:, 2]
            ]
        solution = np.linalg.lstsq(np.c_[quadratic, 2 * x], np.ones(len(x)), rcond=None)[0]
        q = np.diag(solution[:3])
        if self.free.sum() > 3:
            q[0, 1] = q[1, 0] = solution[3]
            q[0, 2] = q[2, 0] = solution[4]
            q[1, 2] = q[2, 1] = solution[5]
        linear = solution[-3:]
        try:
            centre = -np.linalg.solve(q, linear)
            shape = q / (1 + centre @ q @ centre)  # (x − c)ᵀ shape (x − c) = 1
            # shape = Qᵀ Q / (g/scale)² with Q = M⁻¹ lower triangular: its reversed Cholesky factor.
            flip = np.eye(3)[::-1]
            lower = flip @ np.linalg.cholesky(flip @ shape @ flip).T @ flip
            matrix = np.linalg.inv(lower) * scale / self.gravity
            return ErrorModel(matrix * self.free, centre * scale)
        except np.linalg.LinAlgError:
            return ErrorModel(np.eye(3), np.zeros(3))

    def _solve(self, excess: float) -> float:
        """Adjusts with that much excess; returns the weighted sum of squares."""
        adjusted = self.l
        model = self.model
        for _ in range(ITERATIONS):
            true = model.correct(adjusted)
            a, b = _derivatives(model, true, self.free)
            cb = np.einsum("pij,pj->pi", self.c, b)
            variance = np.einsum("pi,pi->p", b, cb) + excess**2
            # f(x, l) seen from the adjusted observations: f + B (l − l_adjusted).
            misclosure = (
                np.linalg.norm(true, axis=1)
                - self.gravity
                + np.einsum("pi,pi->p", b, self.l - adjusted)
            )
            root = np.sqrt(variance)[:, None]
            step = np.linalg.lstsq(a / root, -misclosure / root[:, 0], rcond=None)[0]
            model = self._moved(model, step)
            left = misclosure + a @ step
            new = self.l - cb * (left / variance)[:, None]
            moved = np.abs(new - adjusted).max()
            adjusted = new
            if np.abs(step).max() < 1e-10 * self.gravity and moved < 1e-9 * self.gravity:
                break
        self.model, self.adjusted = model, adjusted
        self.rows, self.left = a / root, left / root[:, 0]
        self.normal = self.rows.T @ self.rows
        self.squares = float(self.left @ self.left)
        if not excess:
            self.white = self.squares
        return self.squares

    def _excess(self) -> float:
        residuals = np.linalg.norm(self.model.correct(self.l), axis=1) - self.gravity
        found = paule_mandel(self._solve, self.dof, rms(residuals))
        self._solve(found)
        return found

    def _moved(self, model: ErrorModel, step: np.ndarray) -> ErrorModel:
        matrix = np.array(model.matrix)
        matrix[self.free] += step[:-3]
        return ErrorModel(matrix, model.bias + step[-3:])

    def outliers(self, most: int) -> tuple[int, ...]:
        """Indices of positions that do not belong."""
        return outliers(self.left, self.rows, most)


def _derivatives(model: ErrorModel, true: np.ndarray, free: np.ndarray):
    """∂f/∂(parameters) (P, K) and ∂f/∂(observations) (P, 3) at true values (P, 3)."""
    inverse = np.linalg.inv(model.matrix)
    b = (true / np.linalg.norm(true, axis=1)[:, None]) @ inverse
    rows, columns = np.nonzero(free)
    return np.hstack([-b[:, rows] * true[:, columns], -b]), b


def _variances(model: ErrorModel, true: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    b = _derivatives(model, true, FREE[6])[1]
    return np.einsum("pi,pij,pj->p", b, covariances, b)


def directions_of_rests(positions: Positions, gravity: float) -> np.ndarray:
    """(P, 3) unit directions of the specific force, as well as they can be told before any fit.

    The readings' own, each axis that was held up and down less its bias and in its own scale: what
    is left turns directions by a degree or two in anything that calls itself an accelerometer.
    """
    means = positions.means
    if len(means) > 3:
        centre = (means.max(axis=0) + means.min(axis=0)) / 2
        half = (means.max(axis=0) - means.min(axis=0)) / 2
        seen = half > 0.8 * gravity
        means = np.where(seen, (means - centre) / np.where(seen, half, 1) * gravity, means)
    length = np.linalg.norm(means, axis=1)
    return means / np.where(length, length, 1)[:, None]


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
