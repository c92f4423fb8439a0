"""Horizon sensor without moving parts: four detectors that look at the limb (work C, 3.2.2).

Their circular fields, of radius a, lie every 90° on the circle where the limb is at the design height,
towards x, y, −x and −y of the body; each signal is the share of its field inside the Earth's disc. The
simulation counts rays; the inversion knows the area in which two spherical caps overlap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.sensors.conical import (
    EQUIVALENT_HEIGHT,
    RADIUS,
    angular_radius,
    check_attitude,
)
from sensorbook.attitude.sensors.horizon import (
    AGREE,
    UNOBSERVABLE,
    Nadir,
    blank,
    check_sigma,
    closed,
)

REASONS = (
    "",
    "all detectors see only space: the height is above the sensor's range, or the Earth is elsewhere",
    "all detectors see only the Earth: the height is below the sensor's range",
    "a detector sees only space or only the Earth: the tilt, or the height, is outside the range",
    "the four signals fit no disc; look for the Sun or the Moon in a field, or a dead detector",
    "a signal is no finite number",
)
_OK, _SPACE, _EARTH, _SATURATED, _NO_FIT, _NOT_FINITE = range(len(REASONS))
LEAST_SHARE = 1e-3  # a signal nearer to 0 or 1 is saturated: it no longer says how far the limb is
MOST_MISFIT = 0.06  # of the four signals without `sigma`; sampling and noise stay far below
_RAYS = 2000
SAMPLING = 0.3 * _RAYS**-0.75  # rms error of a share from so many rays


@dataclass(frozen=True)
class StaticSensor:
    """Four detectors.

    Attributes
    ----------
    design_height : m, where the limb passes through the fields' centres
    field : a, rad, radius of each field
    """

    design_height: float
    field: float
    radius: float = RADIUS
    equivalent_height: float = EQUIVALENT_HEIGHT

    def __post_init__(self):
        circle = self.circle
        if not 0 < self.field < min(circle, np.pi / 2 - circle):
            raise ValueError(
                f"field is {self.field:g} rad: give a radius above 0 and below "
                f"{min(circle, np.pi / 2 - circle):.4g}, with which no field reaches nadir or horizontal"
            )

    @property
    def circle(self) -> float:
        """Angle of the fields' centres from the axis z, rad: ρ at the design height."""
        return float(angular_radius(self.design_height, self.radius, self.equivalent_height))

    @property
    def directions(self) -> np.ndarray:
        """(4, 3) centres of the fields, towards x, y, −x, −y."""
        around = np.arange(4) * np.pi / 2
        s = np.sin(self.circle)
        return np.stack(
            [s * np.cos(around), s * np.sin(around), np.full(4, np.cos(self.circle))], axis=-1
        ).round(15)

    @property
    def heights(self) -> tuple[float, float]:
        """Least and greatest height, m, at which a level sensor is not saturated."""
        most = (self.radius + self.equivalent_height) / np.sin(self.circle - self.field)
        least = (self.radius + self.equivalent_height) / np.sin(self.circle + self.field)
        return float(least - self.radius), float(most - self.radius)

    def rays(self, count: int = _RAYS) -> np.ndarray:
        """(4, count, 3) lines of sight that fill the fields evenly, on Fibonacci's spiral."""
        k = np.arange(count) + 0.5
        along = 1 - (1 - np.cos(self.field)) * k / count
        turn = k * np.pi * (3 - np.sqrt(5))
        across = np.sqrt(1 - along**2)
        local = np.stack([across * np.cos(turn), across * np.sin(turn), along], axis=-1)
        centre = self.directions[:, None]
        side = np.cross([0.0, 0.0, 1.0], centre)
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        return local[:, :1] * side + local[:, 1:2] * np.cross(centre, side) + local[:, 2:] * centre


@dataclass(frozen=True)
class StaticFix(Nadir):
    """What four signals determine.

    Attributes
    ----------
    nadir : (…, 3) unit vector to the Earth's centre in body axes; NaN where refused
    height : (…) m, found beside it
    roll_linear, pitch_linear : (…) rad, from opposite differences alone, good near level and design height
    roll_std, pitch_std, height_std : (…) standard errors, rad and m; None without `sigma`
    information : (…, 3, 3), rad⁻², of the attitude's error vector in body axes; zero about the nadir
    reasons : (…) why a sample has no result, "" where it has
    unobservable : what the sensor cannot see, in words
    """

    nadir: np.ndarray
    height: np.ndarray
    roll_linear: np.ndarray
    pitch_linear: np.ndarray
    roll_std: np.ndarray | None
    pitch_std: np.ndarray | None
    height_std: np.ndarray | None
    information: np.ndarray | None
    reasons: np.ndarray
    unobservable: str = UNOBSERVABLE


def signals(
    sensor: StaticSensor, attitude: ArrayLike, height: ArrayLike, count: int = _RAYS
) -> np.ndarray:
    """Share (…, 4) of each field's rays that meet the Earth, 0 to 1.

    `attitude` is (…, 3, 3), body from a frame with z to the Earth's centre, `height` (…), m. The limb
    cuts about √count rays, so that a share errs by about 0.3 count^(−3/4).
    """
    attitude, height = check_attitude(attitude), np.asarray(height, dtype=float)
    angular_radius(height, sensor.radius, sensor.equivalent_height)
    distance, sphere = sensor.radius + height, sensor.radius + sensor.equivalent_height
    nadir = attitude[..., :, 2]
    along = np.einsum("dki,...i->...dk", sensor.rays(count), nadir) * distance[..., None, None]
    passing = distance[..., None, None] ** 2 - along**2  # squared, of the line past the centre
    return ((along > 0) & (passing < sphere**2)).mean(axis=-1)


def overlap(field: float, radius: ArrayLike, apart: ArrayLike) -> np.ndarray:
    """Share of a cap of radius `field` inside one of `radius`, centres `apart` (rad), (…).

    The area common to two spherical caps (Tovchigrechko and Vakser 2001), over the smaller one's.
    """
    radius, apart = np.broadcast_arrays(
        np.asarray(radius, dtype=float), np.asarray(apart, dtype=float)
    )
    partial = (apart < radius + field) & (apart > np.abs(radius - field))
    s = np.where(partial, apart, radius)
    ca, cr, cs = np.cos(field), np.cos(radius), np.cos(s)
    sa, sr, ss = np.sin(field), np.sin(radius), np.sin(s)
    corner = _arccos((cs - ca * cr) / (sa * sr))
    at_field = _arccos((cr - cs * ca) / (ss * sa))
    at_earth = _arccos((ca - cs * cr) / (ss * sr))
    area = 2 * (np.pi - corner - at_field * ca - at_earth * cr)
    return np.where(partial, area / (2 * np.pi * (1 - ca)), np.where(apart < radius, 1.0, 0.0))


def tilt(sensor: StaticSensor, signals: ArrayLike, sigma: float | None = None) -> StaticFix:
    """Roll, pitch and height from four signals (…, 4).

    First by opposite differences: near the limb a signal changes by 2/(πa) a radian, so that
    n_x = πa/4 (I₁ − I₃) and n_y = πa/4 (I₂ − I₄). Then by Gauss–Newton on the overlap of the caps,
    for the nadir and ρ, which holds wherever all four fields are cut by the limb. `sigma` is the
    standard error of each signal.

    Four signals that fit no disc are refused: where the root of the sum of their squared misfits, which
    has one degree of freedom, is beyond `AGREE` standard errors (`sigma` and `SAMPLING`, what `signals` is
    good to, together) or, without `sigma`, beyond `MOST_MISFIT`.
    """
    signals, sigma = np.asarray(signals, dtype=float), check_sigma(sigma)
    if signals.ndim < 1 or signals.shape[-1] != 4:
        raise ValueError(f"signals: shape is {signals.shape}, needed is (…, 4)")
    finite = np.isfinite(signals).all(axis=-1)
    given = np.where(finite[..., None], signals, 0.5)
    dark, full = given < LEAST_SHARE, given > 1 - LEAST_SHARE
    code = np.full(finite.shape, _OK)
    code[(dark | full).any(axis=-1)] = _SATURATED
    code[dark.all(axis=-1)] = _SPACE
    code[full.all(axis=-1)] = _EARTH
    code[~finite] = _NOT_FINITE
    slope = np.pi * sensor.field / 4
    across = slope * np.stack(
        [given[..., 0] - given[..., 2], given[..., 1] - given[..., 3]], axis=-1
    )
    nadir = np.concatenate([across, np.sqrt(1 - (across**2).sum(axis=-1, keepdims=True))], axis=-1)
    rho = sensor.circle + 2 * slope * (given.mean(axis=-1) - 0.5)
    centres = sensor.directions
    for _ in range(40):
        rows, left = _linear(sensor.field, centres, nadir, rho, given)
        normal = closed(np.einsum("...ki,...kj->...ij", rows, rows), nadir)
        normal = normal + 1e-12 * np.eye(4)  # where a step leaves a field uncut
        step = np.linalg.solve(normal, np.einsum("...ki,...k->...i", rows, left)[..., None])[..., 0]
        most = np.abs(step).max(axis=-1, keepdims=True)
        step = step * np.minimum(1, 0.3 * sensor.field / np.maximum(most, 1e-300))
        nadir = nadir + np.cross(nadir, step[..., :3])
        nadir = nadir / np.linalg.norm(nadir, axis=-1, keepdims=True)
        rho = np.clip(rho + step[..., 3], 1.05 * sensor.field, np.pi / 2)
    rows, left = _linear(sensor.field, centres, nadir, rho, given)
    most = MOST_MISFIT if sigma is None else AGREE * np.hypot(sigma, SAMPLING)
    code[(code == _OK) & (np.linalg.norm(left, axis=-1) > most)] = _NO_FIT
    good = code == _OK
    sphere = sensor.radius + sensor.equivalent_height
    height = sphere / np.sin(rho) - sensor.radius
    errors = (None,) * 4
    if sigma is not None:
        errors = _errors(rows, nadir, rho, sphere, sigma, good)
    return StaticFix(
        blank(nadir, good),
        np.where(good, height, np.nan),
        np.where(good, across[..., 1], np.nan),
        np.where(good, -across[..., 0], np.nan),
        *errors,
        np.array(REASONS)[code],
    )


def _linear(field, centres, nadir, rho, given):
    """Derivatives (…, 4, 4) of the signals by the nadir's turn and ρ, and what is left of the signals."""
    cosine = np.einsum("di,...i->...d", centres, nadir)
    apart = np.arccos(np.clip(cosine, -1, 1))
    radius = rho[..., None]
    edge = _arccos(
        (np.cos(field) - cosine * np.cos(radius)) / (np.sin(apart) * np.sin(radius))
    )  # half the limb's arc in the field, about the nadir
    unit = np.sin(radius) / (np.pi * (1 - np.cos(field)))
    by_apart, by_rho = -unit * np.sin(edge), unit * edge
    turn = -np.cross(centres, nadir[..., None, :]) / np.sin(apart)[..., None]
    rows = np.concatenate([by_apart[..., None] * turn, by_rho[..., None]], axis=-1)
    return rows, given - overlap(field, radius, apart)


def _errors(rows, nadir, rho, sphere, sigma, good):
    """Standard errors of roll, pitch and height, and the information on the attitude."""
    full = np.einsum("...ki,...kj->...ij", rows, rows) / sigma**2
    full = np.where(good[..., None, None], full, np.eye(4))
    inverse = np.linalg.inv(closed(full, nadir))
    information = full[..., :3, :3] - full[..., :3, 3:] * full[..., 3:, :3] / full[..., 3:, 3:]
    turn = np.cross(nadir[..., None, :], np.eye(3))
    covariance = np.einsum("...ki,...kl,...lj->...ij", turn, inverse[..., :3, :3], turn)
    level = nadir[..., 1] ** 2 + nadir[..., 2] ** 2
    roll = np.stack([0 * level, nadir[..., 2] / level, -nadir[..., 1] / level], axis=-1)
    variances = (
        np.einsum("...i,...ij,...j->...", roll, covariance, roll),
        covariance[..., 0, 0] / level,
        inverse[..., 3, 3] * (sphere * np.cos(rho) / np.sin(rho) ** 2) ** 2,
    )
    stds = (np.where(good, np.sqrt(v), np.nan) for v in variances)
    return (*stds, np.where(good[..., None, None], information, np.nan))


def _arccos(value):
    return np.arccos(np.clip(value, -1.0, 1.0))
