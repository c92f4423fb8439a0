"""A gyroscope without a rate table: turned between rests, it must carry one gravity direction into the
next.

Scale factors and misalignments come from the calibrated accelerometer's directions before and after
each motion (Tedaldi, Pretto & Menegatti 2014, section IV), the bias and the sensitivity to acceleration
from the rests themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.calibration.adjustment import outliers, rms
from sensorbook.calibration.find import beside, find_positions
from sensorbook.calibration.model import FREE, ErrorModel
from sensorbook.calibration.motions import (
    LONGEST,
    Directions,
    Motions,
    all_motions,
    predicted,
    rotation_matrices,
)
from sensorbook.calibration.multi_position import FOLDS
from sensorbook.calibration.rest_fit import RestFit
from sensorbook.calibration.result import Calibration
from sensorbook.errors import Refusal
from sensorbook.recordings.recording import Recording

ITERATIONS = 30
FEWEST = 9
MAX_CONDITION = 20.0
AMISS = np.radians(5.0)  # after the fit: a clock, a sign or an order of axes is wrong
FOREIGN = 0.5  # of any entry of the matrix off the unit one
SPUN = 20.0  # rad, typical of a motion: nobody turns a device three times between rests
SMALLEST_TURN = 5.0  # degrees; less tells nothing of a scale factor


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
        more = len(keep) // 5 - int((~keep).sum())
        bad = (
            {k // 2 for k in outliers(left / max(rms(left), 1e-300), rows, 2)}
            if more > 0
            else set()
        )
        if not bad or len(bad) > more:
            break
        keep[np.flatnonzero(keep)[list(bad)]] = False
    errors = direction_errors(used, inverse)
    if rms(errors) > AMISS:
        raise Refusal(
            "The gyroscope does not carry the direction of gravity from one rest to the next: it errs by "
            f"{np.degrees(rms(errors)):.0f}° even with the best nine parameters.",
            "Check that both sensors share one clock, the signs and order of their axes (right-handed), "
            "and that the gyroscope's range was not exceeded.",
        )
    matrix = np.linalg.inv(inverse)
    if np.linalg.det(matrix) <= 0 or np.abs(matrix - np.eye(3)).max() > FOREIGN:
        listed = "; ".join(", ".join(f"{v:.2f}" for v in row) for row in matrix)
        raise Refusal(
            f"The gyroscope's axes are not the accelerometer's: the matrix that fits is [{listed}].",
            "Check the order and the signs of the columns, and the unit.",
        )
    dof = rows.shape[0] - 9
    scale = float(left @ left) / max(dof, 1)
    # M = K⁻¹: dM = −M dK M
    jacobian = -np.kron(matrix, matrix.T)
    by_frame = -np.linalg.lstsq(rows, _by_frame(used, inverse), rcond=None)[0]
    own = np.linalg.inv(rows.T @ rows) * scale + by_frame @ by_frame.T
    covariance = np.zeros((9 + len(fit.covariance),) * 2)
    covariance[:9, :9] = jacobian @ own @ jacobian.T
    covariance[9:, 9:] = fit.covariance
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


def _require_turns(motions: Motions) -> None:
    """Raises `Refusal` where the motions cannot determine nine parameters."""
    useful = int((turned_angles(motions) > np.radians(SMALLEST_TURN)).sum()) if len(motions) else 0
    if useful < FEWEST:
        raise Refusal(
            f"There are {useful} motions of at most {LONGEST:g} s between two rests that turn the "
            f"device by more than {SMALLEST_TURN:g}° and have all their samples, and {FEWEST} are needed for "
            "the nine scale factors and misalignments of a gyroscope.",
            "Go from rest to rest through 18 positions or more, turning by 90° about x, y and z, and "
            "record without losses.",
        )
    spun = float(np.median(np.linalg.norm(motions.turns, axis=2).sum(axis=1)))
    if spun > SPUN:
        raise Refusal(
            f"By its unit the gyroscope turns by {np.degrees(spun):.0f}° in a typical motion.",
            "Check the unit: degrees a second are declared as radians, or counts without their scale.",
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


def judged_turns(
    gyroscopes: Sequence[Recording],
    device,
    gravity: float,
    level: ErrorModel,
    fit: RestFit,
    calibration,
) -> tuple[float, int] | None:
    """rms direction error (rad) and number of motions of recordings that were kept out of the fit.

    None where the accelerometer was not recorded beside them, or they hold no motion between rests.
    """
    runs = (
        device.runs("accelerometer", "positions")
        if "positions" in device.kinds("accelerometer")
        else ()
    )
    accelerometers = [a for a in runs if a.declaration.get("check") and beside(a, gyroscopes)]
    if not accelerometers:
        return None
    found = find_positions(accelerometers, gyroscopes, gravity)
    if found.gyroscope is None:
        return None
    true = level.correct(found.positions.means)
    unit = true / np.linalg.norm(true, axis=1)[:, None]
    directions = Directions(unit, true, np.zeros((len(unit), 3, 0)))
    motions = all_motions(gyroscopes, accelerometers, found, directions, level, fit)
    if not len(motions):
        return None
    errors = direction_errors(motions, np.linalg.inv(calibration.model.matrix))
    return rms(errors), len(motions)
