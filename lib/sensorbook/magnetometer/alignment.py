"""A magnetometer beside an accelerometer: the dip angle, the triads' misalignment, the heading.

Where both are right, the field makes the same angle with gravity in every attitude. What that angle
scatters by is therefore a check that needs no reference, and a turn between the two triads shows in
it, which the length of the field cannot show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.errors import Refusal
from sensorbook.magnetometer.coverage import effects
from sensorbook.magnetometer.ellipsoid import bisquare, packed
from sensorbook.magnetometer.fit import calibrate
from sensorbook.magnetometer.result import MagnetometerCalibration
from sensorbook.magnetometer.uncertainty import correlation_time, jackknife, number_of_blocks

FEWEST = 100  # pairs of readings
OWN = {  # models of a triad in words that fit an accelerometer
    "ellipsoid": "its own ellipsoid",
    "diagonal": "its own bias and scale factors",
    "hard_iron": "its own bias",
}
MOST_SPREAD = np.radians(5.0)  # of the dip; beyond, the two sensors do not belong together
MOST_DILUTION = 4.0  # of the turn's error over that of attitudes all round


@dataclass(frozen=True, eq=False)
class Alignment:
    """Dip angle and the turn from the accelerometer's axes to the magnetometer's.

    Attributes
    ----------
    rotation : (3, 3) ``v_magnetometer = rotation · v_accelerometer``; the identity where the
        attitudes do not determine it
    turn : (3,) rad, its rotation vector; NaN where not determined
    covariance : (4, 4) of the turn and the dip, rad²; the calibrations' own errors are in it
    dof : degrees of freedom of the covariance
    dip : rad, positive where the field points down
    dips : by stage (N,) rad: "raw", both as read; "calibrated", hard and soft iron and the
        accelerometer's own ellipsoid taken out; "aligned", turned as well
    spreads : by stage, rad: standard deviation of the dip
    accelerometer : what was done to the accelerometer, in words
    """

    rotation: np.ndarray
    turn: np.ndarray
    covariance: np.ndarray
    dof: int
    dip: float
    dips: dict[str, np.ndarray]
    accelerometer: str

    @property
    def determined(self) -> bool:
        """Whether the turn between the triads is known."""
        return bool(np.isfinite(self.turn).all())

    @property
    def agrees(self) -> bool:
        """Whether the dip scatters so little that both sensors saw the same attitudes."""
        return self.spreads["aligned"] < MOST_SPREAD

    @property
    def spreads(self) -> dict[str, float]:
        return {stage: float(np.std(dip)) for stage, dip in self.dips.items()}

    def to_results(self) -> dict:
        """As results.json states it."""
        std = np.degrees(np.sqrt(np.diag(self.covariance))) if self.determined else None
        spreads = self.spreads
        return {
            "matrix": self.rotation if self.determined else None,
            "turn_deg": np.degrees(self.turn) if self.determined else None,
            "turn_std_deg": std[:3] if self.determined else None,
            "degrees_of_freedom": self.dof,
            "dip_deg": float(np.degrees(self.dip)),
            "dip_spread_before_deg": float(np.degrees(spreads["raw"])),
            "dip_spread_calibrated_deg": float(np.degrees(spreads["calibrated"])),
            "dip_spread_after_deg": float(np.degrees(spreads["aligned"])),
            "accelerometer": self.accelerometer,
        }


def paired(magnetometer, accelerometer, used=True) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two recordings that belong together: (N, 3) T and (N, 3) m/s².

    `used` (N,) leaves rows of the magnetometer out.

    The accelerometer is interpolated at the magnetometer's stamps. Without stamps the two must be
    rows of one file.

    Raises
    ------
    Refusal
        the two do not overlap, or nothing says which rows belong together
    """
    if magnetometer.rate is None or accelerometer.rate is None:
        if magnetometer.file != accelerometer.file or len(magnetometer) != len(accelerometer):
            raise Refusal(
                "Nothing says which readings of the two sensors belong together: they have no time.",
                "Record both in one file, or with time stamps.",
            )
        force, field, used = accelerometer.values, magnetometer.values, np.asarray(used)
    else:
        # Stamps count from each file's first sample; `start` brings them to one clock.
        at = magnetometer.time + magnetometer.start
        own = accelerometer.time + accelerometer.start
        good = np.isfinite(accelerometer.values).all(axis=1) & np.isfinite(own)
        order = np.argsort(own[good], kind="stable")
        stamps, known = own[good][order], accelerometer.values[good][order]
        if not len(stamps):
            stamps, known = np.array([np.inf]), np.full((1, 3), np.nan)  # at no time
        inside = (at >= stamps[0]) & (at <= stamps[-1])
        field, used = magnetometer.values[inside], np.broadcast_to(used, len(at))[inside]
        force = np.stack([np.interp(at[inside], stamps, column) for column in known.T], axis=1)
    rows = used & np.isfinite(field).all(axis=1) & np.isfinite(force).all(axis=1)
    if rows.sum() < FEWEST:
        raise Refusal(
            f"Only {rows.sum()} readings of the two sensors were taken at the same time.",
            "Record both at once.",
        )
    return field[rows], force[rows]


def align(
    calibration: MagnetometerCalibration, field: np.ndarray, force: np.ndarray, gravity: float
) -> Alignment:
    """The alignment from readings of both sensors at the same times.

    Parameters
    ----------
    calibration : of the magnetometer
    field, force : (N, 3) raw readings, T and m/s²
    gravity : m/s²
    """
    level = None
    try:
        level = calibrate(force, gravity)
        done = f"corrected by {OWN[level.method]}"
        up = _unit(level.correct(force))
    except Refusal as refusal:
        done, up = f"as read ({refusal.reason.rstrip('.')})", _unit(force)
    north = _unit(calibration.correct(field))
    turn, dip = np.zeros(3), _dips(north, up).mean()
    before = _dips(north, up)
    for _ in range(20):
        turned = Rotation.from_rotvec(turn).apply(up)
        # In angles: of sines the scatter is less the steeper the dip, and a turn could make it so.
        r = dip - _dips(north, turned)
        across = np.cross(turned, north)
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-3)[:, None]
        jacobian = np.hstack([across, np.ones((len(r), 1))])
        w = bisquare(r)
        normal = jacobian.T @ (w[:, None] * jacobian)
        if np.linalg.cond(normal) > 1e10:
            break
        step = -np.linalg.solve(normal, jacobian.T @ (w * r))
        turn = (Rotation.from_rotvec(step[:3]) * Rotation.from_rotvec(turn)).as_rotvec()
        dip += step[3]
        if np.abs(step).max() < 1e-10:
            break
    dips = {"raw": _dips(_unit(field), _unit(force)), "calibrated": before}
    # An accelerometer as it reads errs by more than any turn: nothing could be said of one.
    poor = (
        level is None
        or np.linalg.cond(normal) > 1e10
        or (
            # All round, each component of the unit vectors across has a third of their mean square.
            np.linalg.inv(normal / w.sum())[:3, :3].diagonal().max() > MOST_DILUTION**2 * 3
        )
    )
    if poor:
        return Alignment(np.eye(3), np.full(3, np.nan), np.full((4, 4), np.nan), 1, float(before.mean()),
                         dips | {"aligned": before}, done)  # fmt: skip
    root = np.sqrt(w)[:, None]
    blocks = number_of_blocks(len(r), correlation_time(r))
    covariance, dof = jackknife(root * jacobian, (w * r)[:, None] * jacobian, blocks)
    matrix = Rotation.from_rotvec(turn).as_matrix()
    gain = np.linalg.solve(normal, jacobian.T * w)
    for fit, raw, seen in ((calibration, field, lambda v: (v, up @ matrix.T)),
                           (level, force, lambda v: (north, v @ matrix.T))):  # fmt: skip
        by = np.stack([gain @ change for change in _changes(fit, raw, seen)], axis=1)
        covariance = covariance + by @ fit.covariance[:9, :9] @ by.T
    dips["aligned"] = _dips(north, up @ matrix.T)
    return Alignment(matrix, turn, covariance, dof, float(dip), dips, done)


def _changes(fit: MagnetometerCalibration, raw: np.ndarray, seen):
    """Nine (N,) derivatives of the dips by hard and soft iron of one sensor, by differences.

    `seen` gives field and up (N, 3) from that sensor's corrected unit vectors.
    """
    s = fit.soft_iron / fit.field
    corrected = (raw - fit.hard_iron) @ s
    effect = effects(_unit(corrected), packed(fit.hard_iron, s))
    effect[:, :, 3:] /= fit.field
    length = np.linalg.norm(corrected, axis=1)[:, None]
    effect[:, :, 3:] *= length[:, :, None]
    for k, error in enumerate(np.sqrt(np.diag(fit.covariance)[:9].clip(0))):
        step = 1e-3 * error or 1e-12  # far below what is known, where dips are straight in it
        ahead, behind = (_unit(corrected + sign * step * effect[:, :, k]) for sign in (1, -1))
        yield (_dips(*seen(ahead)) - _dips(*seen(behind))) / (2 * step)


@dataclass(frozen=True, eq=False)
class Heading:
    """Error of the heading in a level turn, at each of `heading` (N,), rad.

    Attributes
    ----------
    before : (N,) rad, of the readings as they come
    turned : (N,) rad, what the turn between the triads leaves after hard and soft iron; zero where
        it is not known
    std : (N,) rad, standard error after correction, by the calibration's and the turn's uncertainty
    """

    heading: np.ndarray
    before: np.ndarray
    turned: np.ndarray
    std: np.ndarray


def heading_error(
    calibration: MagnetometerCalibration, dip: float, alignment: Alignment | None
) -> Heading:
    """Heading error in a level turn about z, up, from x to the north, clockwise positive.

    Where the triads' misalignment is known it is among the errors before, and its uncertainty among
    those after; else the heading is that of the magnetometer's own axes.
    """
    psi = np.radians(np.arange(0, 360, 2.0))
    level = np.stack([np.cos(psi), np.sin(psi), np.full_like(psi, -np.tan(dip))], axis=1) * np.cos(
        dip
    )
    turn = alignment.rotation if alignment else np.eye(3)
    u = level @ turn.T
    s, h = calibration.soft_iron, calibration.hard_iron
    raw = np.linalg.solve(s, calibration.field * u.T).T + h
    before = np.angle(np.exp(1j * (np.arctan2(raw[:, 1], raw[:, 0]) - psi)))
    # Level, a corrected vector's error across the horizontal field turns the heading.
    effect = effects(u, packed(h, s / calibration.field))
    effect[:, :, 3:] /= calibration.field
    across = np.stack([-np.sin(psi), np.cos(psi), np.zeros_like(psi)], axis=1) @ turn.T
    # A parameter's share is its effect on the unit vector: per T of hard iron, per 1 of soft iron.
    by = np.einsum("ni,nij->nj", across, effect) / np.cos(dip)
    variance = np.einsum("nj,jk,nk->n", by, calibration.covariance[:9, :9], by)
    if alignment and alignment.determined:
        # About the vertical it turns the needle; about the level axes it tips the steep field into it.
        turned_by = np.cross(u, across) / np.cos(dip)
        variance = variance + np.einsum(
            "ni,ij,nj->n", turned_by, alignment.covariance[:3, :3], turned_by
        )
    left = np.angle(np.exp(1j * (np.arctan2(u[:, 1], u[:, 0]) - psi)))
    return Heading(psi, before, left, np.sqrt(variance.clip(0)))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=1), np.finfo(float).tiny)[:, None]


def _dips(field: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(N,) rad, how far the field (N, 3) points below the plane across `up` (N, 3), unit vectors."""
    return np.arcsin(np.clip(-(field * up).sum(axis=1), -1, 1))
