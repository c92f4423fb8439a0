"""Calibrates a magnetometer as far as its motion allows, and no farther."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.errors import Refusal
from sensorbook.magnetometer.coverage import (
    MOST_DILUTION,
    MOST_ERROR,
    MOST_HARD_IRON,
    Coverage,
    coverage,
    dilution,
    errors_by_direction,
    motion_in_words,
    neglected,
)
from sensorbook.magnetometer.ellipsoid import (
    BASES,
    design,
    noise_slopes,
    refine,
    residuals,
    sphere,
    unpacked,
    without_noise_bias,
)
from sensorbook.magnetometer.result import MagnetometerCalibration, scaled
from sensorbook.magnetometer.robust import robust_ellipsoid, thinned
from sensorbook.magnetometer.uncertainty import (
    HELD_OUT,
    held_out,
    jackknife,
    longest_correlation,
    number_of_blocks,
)

FEWEST = 50  # readings
FLAT_READINGS = 0.1  # thinnest over widest direction: below, readings count as those of a flat turn
MOST_ROUGHLY = 6.0  # dilution about a plain sphere; an ellipsoid of 1 : 3, seen all over, has 4.5
MOST_LEFT = (
    0.06  # of the field: residual of a reduced model; more, and its neglected terms are large
)
ROUNDING = 1e-9  # of the field: residuals below are those of readings without noise
HELD_OUT_LARGER = 1.5  # times the residual; above, the parts of a recording contradict each other
STILL = 0.1  # change of the readings over their mean; of a turn with a hard iron of ten fields it is more
NOT_ONE_FIELD = 0.15  # of the field: residuals beyond are no ellipsoid of any sensor
MODELS = ("ellipsoid", "diagonal", "hard_iron")
NAMES = {
    "ellipsoid": "the full ellipsoid",
    "diagonal": "hard iron and three scale factors",
    "hard_iron": "hard iron alone",
}


@dataclass(frozen=True, eq=False)
class Trial:
    """One model fitted to a recording, and why it is refused; empty where it is determined.

    Attributes
    ----------
    parameters : (9,) in the unit of the readings, field 1
    covariance : (9, 9) with what the model neglects
    dilution : error in the worst direction over that of readings all over the sphere
    error : of the corrected unit vector in the worst direction, standard error
    inflation : of the hard iron's standard error over the formal one, which counts every reading as new
    hard_iron : of the field, worst standard error of the hard iron, with what is neglected
    """

    model: str
    parameters: np.ndarray
    covariance: np.ndarray
    freedom: int
    blocks: int
    correlation: float
    inflation: float
    dilution: float
    error: float
    hard_iron: float
    coverage: Coverage
    reason: str


def calibrate(
    values: np.ndarray,
    field: float | None = None,
    field_std: float = 0.0,
    field_source: str = "",
    parts: Sequence[np.ndarray] | None = None,
) -> MagnetometerCalibration:
    """Hard iron, soft iron and their uncertainty from readings in many attitudes.

    Parameters
    ----------
    values : (N, 3) readings in the order of time, T; rows that are not finite are left out
    field, field_std : T, strength of the field there and its standard error; None where it is not
        known, and the soft iron is relative: its determinant is 1
    field_source : where `field` comes from, in words
    parts : rows of `values` that are held out together; default: five stretches of the same length

    Returns
    -------
    The fullest of three models that the readings determine: ellipsoid, diagonal, hard iron.

    Raises
    ------
    Refusal
        too few readings, readings on no ellipsoid, or a motion that determines none of the models
    """
    made = _attempted(values)
    x, kept, best = made.x, made.kept, made.trials[-1]
    if best.reason:
        raise Refusal(*_refused(made))
    finite, fitted, covariance = made.finite, made.fitted, best.covariance
    r, u = residuals(x, best.parameters)
    number = np.cumsum(finite) - 1  # of a row among the finite ones
    if parts is None:
        # Of a long rest few readings count: as many that do in each part.
        edges = [part[-1] + 1 for part in np.array_split(np.flatnonzero(fitted), HELD_OUT)[:-1]]
        parts = np.split(np.arange(len(x)), edges)
    else:
        parts = [number[part[finite[part]]] for part in parts]
    check = held_out(x, best.parameters, BASES[best.model], kept, parts,
                     lambda rows: dilution(u[rows & fitted], best.model) < 2 * MOST_DILUTION)  # fmt: skip
    judged = kept & np.isfinite(check)
    residual = float(np.sqrt(np.mean(r[kept] ** 2)))
    unseen = float(np.sqrt(np.mean(check[judged] ** 2))) if judged.any() else np.nan
    if unseen > HELD_OUT_LARGER * max(residual, ROUNDING):
        # Parts of the recording contradict each other more than its blocks tell.
        covariance = covariance * (unseen / residual) ** 2
    used = np.zeros(len(values), dtype=bool)
    used[np.flatnonzero(finite)[kept]] = True
    return MagnetometerCalibration(
        method=best.model,
        **scaled(best.parameters, covariance, made.centre, made.size, field, field_std),
        field_source=field_source,
        dof=best.freedom,
        residual=residual,
        residual_check=unseen,
        residual_before=_residual_before(x[kept] * made.size + made.centre),
        coverage=best.coverage,
        used=used,
        dilution=best.dilution,
        blocks=best.blocks,
        correlation=best.correlation,
        inflation=best.inflation,
        reduced=tuple(t.reason for t in made.trials[:-1]),
    )


def directions(values: np.ndarray) -> np.ndarray:
    """(N, 3) directions of the corrected field as far as the readings tell, determined or not.

    Of the finite rows of `values` (N, 3), by the model that `calibrate` ends with; raises its `Refusal`
    for too few.
    """
    made = _attempted(values)
    if made.trials[-1].reason:
        return _roughly(made.x)
    return residuals(made.x, made.trials[-1].parameters)[1]


def _roughly(x: np.ndarray) -> np.ndarray:
    """(N, 3) directions about a plain sphere, for words and pictures where no model is determined.

    The models' own fits are then of any size.
    """
    return residuals(x, sphere(x, FLAT_READINGS))[1]


@dataclass(frozen=True, eq=False)
class _Attempt:
    """The models tried on a recording.

    Attributes
    ----------
    finite : (N,) rows that are
    centre, size : (3,), T, of the readings
    x : (M, 3) the finite rows less `centre` over `size`
    fitted, kept : (M,) which rows stand for all (`thinned`), and which are not set aside
    trials : from the fullest model to the last that was needed
    """

    finite: np.ndarray
    centre: np.ndarray
    size: float
    x: np.ndarray
    fitted: np.ndarray
    kept: np.ndarray
    trials: list[Trial]


def _attempted(values: np.ndarray) -> _Attempt:
    finite = np.isfinite(values).all(axis=1)
    m = np.asarray(values, dtype=float)[finite]
    different = len(np.unique(m, axis=0))
    if different < FEWEST:
        raise Refusal(
            f"{different} different readings are too few; {FEWEST} are needed.",
            "Turn the device slowly through all attitudes for a minute.",
        )
    fitted = thinned(m)
    centre = np.median(m[fitted], axis=0)
    distance = np.linalg.norm(m[fitted] - centre, axis=1)
    size = float(np.median(distance)) or float(distance.mean())  # of a sensor that sticks it is 0
    x = (m - centre) / size
    full, near = robust_ellipsoid(x[fitted])
    r = np.abs(residuals(x, full)[0])
    kept = r <= r[fitted][near].max()
    kept[fitted] = near
    trials = []
    for model in MODELS:
        trials.append(_tried(model, x[fitted & kept], full))
        if not trials[-1].reason:
            break
    return _Attempt(finite, centre, size, x, fitted, kept, trials)


def _residual_before(m: np.ndarray) -> float:
    length = np.linalg.norm(m, axis=1)
    return float(length.std() / length.mean())


def _tried(model: str, x: np.ndarray, full: np.ndarray) -> Trial:
    basis = BASES[model]
    parameters = full if model == "ellipsoid" else refine(x, sphere(x), basis)
    parameters = without_noise_bias(x, parameters, basis)
    r, u = residuals(x, parameters)
    seen, spread_out = coverage(u), dilution(u, model)
    if model == "ellipsoid":
        # Of a flat turn noise makes a flat ellipsoid, on which the directions seem to be everywhere.
        roughly = dilution(_roughly(x), model)
        spread_out = max(spread_out, roughly) if roughly > MOST_ROUGHLY else spread_out
    jacobian = design(u, x, parameters)
    scores = jacobian * r[:, None] - noise_slopes(x, parameters)
    time = longest_correlation(jacobian @ basis, scores @ basis)
    blocks = number_of_blocks(len(x), time)
    covariance, freedom = jackknife(jacobian @ basis, scores @ basis, blocks)
    formal = np.mean(r**2) * np.linalg.pinv((jacobian @ basis).T @ (jacobian @ basis))
    inflation = float(np.sqrt(np.mean(np.diag(covariance)[:3] / np.diag(formal)[:3])))
    with np.errstate(invalid="ignore"):  # infinite where one block alone determines a parameter
        covariance = basis @ covariance @ basis.T + _in_place(neglected(u, model), parameters)
    error = hard_iron = np.inf
    if np.isfinite(covariance).all():
        error = float(errors_by_direction(covariance, parameters).max())
        s = unpacked(parameters)[1]
        hard_iron = float(np.sqrt(np.linalg.eigvalsh(s @ covariance[:3, :3] @ s)[-1].clip(0)))
    reason = _reason(model, r, spread_out, error, hard_iron)
    return Trial(model, parameters, covariance, freedom, blocks, time, inflation, spread_out, error,
                 hard_iron, seen, reason)  # fmt: skip


def _in_place(covariance: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """A covariance stated at h = 0, S = 1, at these parameters (S diagonal)."""
    s = np.abs(np.diag(unpacked(parameters)[1]))  # of a fit that failed they may be negative
    factor = np.r_[1 / s, s, np.sqrt(s[[0, 0, 1]] * s[[1, 2, 2]])]
    return covariance * np.outer(factor, factor)


def _reason(model: str, r: np.ndarray, spread_out: float, error: float, hard_iron: float) -> str:
    name = NAMES[model]
    if spread_out > MOST_DILUTION:
        many = f"{spread_out:.2g}" if spread_out < 100 else "over a hundred"
        return (
            f"The directions are too few for {name} (worst error {many} times that after a full turn, "
            f"{MOST_DILUTION:g} at most)"
        )
    residual = float(np.sqrt(np.mean(r**2)))
    if model != "ellipsoid" and residual > MOST_LEFT:
        return (
            f"With {name} the readings miss the field by {100 * residual:.0f} % rms: what it leaves out is "
            "not small"
        )
    if residual > NOT_ONE_FIELD:
        return (
            "The readings lie on no ellipsoid: their distance from the nearest is "
            f"{100 * residual:.0f} % of the field rms"
        )
    if hard_iron > MOST_HARD_IRON:
        return (
            f"With {name} the hard iron is uncertain by {100 * hard_iron:.0f} % of the field (standard "
            f"error, {100 * MOST_HARD_IRON:.0f} % at most)"
        )
    # What a reduced model leaves out it does not claim to correct.
    if model == "ellipsoid" and 2 * error > MOST_ERROR:
        return (
            f"With {name} a corrected reading is uncertain by {200 * error:.0f} % of the field in the worst "
            f"direction ({100 * MOST_ERROR:.0f} % at most)"
        )
    return ""


def _refused(made: _Attempt) -> tuple[str, str]:
    """Reason and remedy where no model is determined."""
    change = made.size / max(float(np.linalg.norm(made.centre)), np.finfo(float).tiny)
    if change < STILL:
        return (
            f"The readings hardly change, by {100 * change:.2g} % of their mean: the device lay still.",
            "Turn it slowly through all attitudes, for a minute or two.",
        )
    for trial in made.trials:
        if trial.reason.startswith("The readings lie on no"):
            return (
                trial.reason + ".",
                "Turn it in one place, a metre from iron, cables and loudspeakers, with nothing magnetic "
                "beside it that is not always part of the device.",
            )
    what, remedy = motion_in_words(coverage(_roughly(made.x[made.kept])))
    reason = f"{made.trials[0].reason}; less is not determined either" + (
        f": {what}." if what else "."
    )
    return reason, remedy or "Turn it more slowly and longer, through all attitudes."
