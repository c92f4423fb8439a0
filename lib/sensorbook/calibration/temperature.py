"""Bias and scale factors against temperature, where positions were repeated at several (A 5.2, 5.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sensorbook.calibration.adjustment import paule_mandel, rms
from sensorbook.calibration.coverage import design
from sensorbook.calibration.model import FREE, ErrorModel
from sensorbook.calibration.multi_position import (
    MAX_CONDITION,
    directions_of_rests,
    multi_position,
)
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.result import Calibration
from sensorbook.errors import Refusal

DEGREES = (0, 1, 2, 3)
SMALLEST_SPAN = 5.0  # °C; less hardly moves anything
SAME = 2.0  # °C: recordings nearer than this are at one temperature
CLEAR = 2.0  # standard errors by which a higher degree must predict better
ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class TemperatureFit:
    """A calibration with bias and scale factors as polynomials of temperature.

    Attributes
    ----------
    calibration : at the reference temperature, its `temperature` filled where `degree` > 0
    degree : chosen by leaving out whole recordings
    errors : by degree, rms of ``‖a‖ − g`` of recordings left out, m/s²
    by_run : (temperature, three scale factor errors and three biases) of each recording by itself,
        where it can be calibrated alone
    changes : (6,) change of three scale factors and three biases across the range, and its standard
        errors; zero for degree 0
    """

    calibration: Calibration
    degree: int
    errors: dict[int, float]
    range: tuple[float, float]
    by_run: tuple[tuple[float, np.ndarray], ...]
    changes: np.ndarray
    changes_std: np.ndarray


def several_temperatures(positions: Positions) -> bool:
    """Whether the recordings are at three temperatures or more, at least 5 °C apart in all."""
    if positions.temperature is None or not len(positions):
        return False
    cycles = by_temperature(positions).runs
    means = np.sort([positions.temperature[cycles == r].mean() for r in np.unique(cycles)])
    levels = 1 + int((np.diff(means) > SAME).sum())
    return levels >= 3 and np.ptp(positions.temperature) >= SMALLEST_SPAN


def by_temperature(positions: Positions) -> Positions:
    """The positions with their recordings for runs, or, of one recording, its levels of temperature."""
    if len(np.unique(positions.runs)) > 1:
        return positions
    order = np.argsort(positions.temperature)
    level = np.empty(len(positions), dtype=int)
    level[order] = np.cumsum(np.r_[0, np.diff(positions.temperature[order]) > SAME])
    return replace(positions, runs=level)


def fit_temperature(calibration: Calibration, positions: Positions) -> TemperatureFit:
    """Fits all recordings jointly, misalignments in common.

    Parameters
    ----------
    calibration : of the same positions without temperature, the start
    positions : with temperatures, at several of them (`several_temperatures`)

    No position is set aside: what does not fit one temperature may fit another. The degree is the
    simplest whose error on whole recordings left out is within two standard errors of the best, among
    those that the directions at each temperature determine.
    """
    positions = by_temperature(positions)
    warmth = positions.temperature
    low, high = float(warmth.min()), float(warmth.max())
    reference = round(float(warmth.mean()), 1)
    half = max(high - reference, reference - low)
    scaled = (warmth - reference) / half
    levels = len(np.unique(np.round(warmth / SAME)))
    usable = [
        d
        for d in DEGREES[: max(1, levels - 1)]
        if _condition(positions, scaled, d, calibration.gravity) <= MAX_CONDITION
    ]
    errors: dict[int, np.ndarray] = {}
    while usable and not errors:
        errors = _left_out(positions, scaled, usable, calibration)
        usable = usable[:-1]
    degree = _choose(errors)
    held = {d: float(np.sqrt(e.mean())) for d, e in errors.items()}
    alone = _by_run(positions, calibration.gravity)
    changes, spread = np.zeros(6), np.zeros(6)
    if not degree:
        return TemperatureFit(calibration, 0, held, (low, high), alone, changes, spread)
    everything = np.ones(len(positions), dtype=bool)
    base, coefficients, covariance, residual, excess, chi = _fit(
        positions, scaled, degree, calibration, everything
    )
    ends = (np.array([high, low]) - reference) / half
    powers = np.array([ends[0] ** k - ends[1] ** k for k in range(1, degree + 1)])
    changes = powers @ coefficients
    for j in range(6):
        at = 9 + 6 * np.arange(degree) + j
        spread[j] = np.sqrt(powers @ covariance[np.ix_(at, at)] @ powers)
    per_degree = coefficients / half ** np.arange(1, degree + 1)[:, None]
    done = replace(
        calibration,
        model=base,
        covariance=covariance[:9, :9],
        dof=max(len(positions) - len(covariance), 1),
        chi_square=chi,
        excess=excess,
        residuals=residual,
        rms_after=rms(residual),
        rms_check=held[degree],
        kept=everything,
        rejected=(),
        reference_temperature=reference,
        temperature={
            "degree": degree,
            "range": [low, high],
            "temperature_unit": "degC",
            "matrix_coefficients": [np.diag(c[:3]) for c in per_degree],
            "bias_coefficients": [c[3:] for c in per_degree],
        },
    )
    return TemperatureFit(done, degree, held, (low, high), alone, changes, spread)


def _by_run(positions: Positions, gravity: float) -> tuple[tuple[float, np.ndarray], ...]:
    found = []
    for r in np.unique(positions.runs):
        own = positions[positions.runs == r]
        try:
            model = multi_position(own, gravity, check=False).model
        except Refusal:
            continue
        found.append((float(own.temperature.mean()), np.r_[model.scale_factor_errors, model.bias]))
    return tuple(found)


def _condition(positions: Positions, scaled: np.ndarray, degree: int, gravity: float) -> float:
    """Condition number of the joint design: what no position shows away from the reference is not known."""
    u = directions_of_rests(positions, gravity)
    terms = [design(u, FREE[9])]
    terms += [np.hstack([u**2, u]) * scaled[:, None] ** k for k in range(1, degree + 1)]
    singular = np.linalg.svd(np.hstack(terms), compute_uv=False)
    full = len(singular) == sum(t.shape[1] for t in terms) and singular[-1] > 0
    return float(singular[0] / singular[-1]) if full else np.inf


def _left_out(positions, scaled, degrees, start) -> dict[int, np.ndarray]:
    """By degree, squares of ``‖a‖ − g`` of each position by a fit without its recording.

    The recordings at the ends count, too: of three temperatures the middle alone would not tell a
    straight line from none. Where the rest does not determine the highest degree, none is scored by it.
    """
    errors: dict[int, list[np.ndarray]] = {d: [] for d in degrees}
    for r in np.unique(positions.runs):
        out = positions.runs == r
        if (
            _condition(positions[~out], scaled[~out], degrees[-1], start.gravity)
            > 2 * MAX_CONDITION
        ):
            continue
        for degree in degrees:
            base, coefficients, *_ = _fit(positions, scaled, degree, start, ~out)
            left = _errors(base, coefficients, positions.means[out], scaled[out], start.gravity)
            errors[degree].append(left**2)
    return {d: np.concatenate(e) for d, e in errors.items() if e}


def _choose(errors: dict[int, np.ndarray]) -> int:
    """The lowest degree that is within `CLEAR` standard errors of the best, paired over positions."""
    best = min(errors, key=lambda d: errors[d].mean(), default=0)
    for degree in sorted(errors):
        gap = errors[degree] - errors[best]
        if gap.mean() <= CLEAR * gap.std(ddof=1) / np.sqrt(len(gap)):
            return degree
    return best


def _corrected(base: ErrorModel, coefficients, means, scaled):
    """(P, 3) true values, and (P, 3, 3) inverse matrices, each at its own temperature."""
    matrix = np.broadcast_to(base.matrix, (len(means), 3, 3)).copy()
    bias = np.broadcast_to(base.bias, (len(means), 3)).copy()
    for k, c in enumerate(coefficients, start=1):
        power = scaled[:, None] ** k
        matrix[:, range(3), range(3)] += power * c[:3]
        bias += power * c[3:]
    inverse = np.linalg.inv(matrix)
    return np.einsum("pij,pj->pi", inverse, means - bias), inverse


def _errors(base, coefficients, means, scaled, gravity) -> np.ndarray:
    return np.linalg.norm(_corrected(base, coefficients, means, scaled)[0], axis=1) - gravity


def _fit(positions, scaled, degree, start, use):
    """Base model, coefficients (degree, 6), scaled covariance, residuals, excess and white χ²/dof."""
    means, covariances, t = positions.means[use], positions.covariances[use], scaled[use]
    free = FREE[9]
    rows, columns = np.nonzero(free)
    count = 9 + 6 * degree
    dof = max(len(means) - count, 1)
    state = {}

    def solve(excess: float) -> float:
        base, coefficients = start.model, np.zeros((degree, 6))
        for _ in range(ITERATIONS):
            true, inverse = _corrected(base, coefficients, means, t)
            length = np.linalg.norm(true, axis=1)
            b = np.einsum("pi,pij->pj", true / length[:, None], inverse)
            variance = np.einsum("pi,pij,pj->p", b, covariances, b) + excess**2
            design = [-b[:, rows] * true[:, columns], -b]
            for k in range(1, degree + 1):
                design += [-b * true * t[:, None] ** k, -b * t[:, None] ** k]
            design = np.hstack(design) / np.sqrt(variance)[:, None]
            left = (length - start.gravity) / np.sqrt(variance)
            step = np.linalg.lstsq(design, -left, rcond=None)[0]
            matrix = np.array(base.matrix)
            matrix[free] += step[:6]
            base = ErrorModel(matrix, base.bias + step[6:9])
            coefficients = coefficients + step[9:].reshape(degree, 6)
            if np.abs(step).max() < 1e-10:
                break
        left = left + design @ step
        state.update(base=base, coefficients=coefficients, normal=design.T @ design)
        state["squares"] = float(left @ left)
        state["residual"] = left * np.sqrt(variance)
        return state["squares"]

    white = solve(0.0) / dof
    excess = paule_mandel(solve, dof, rms(state["residual"]))
    solve(excess)
    covariance = np.linalg.pinv(state["normal"]) * state["squares"] / dof
    return state["base"], state["coefficients"], covariance, state["residual"], excess, white
