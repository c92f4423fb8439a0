"""Magnetometer as an attitude sensor: one direction, from the Earth's field (work C, 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook import earth
from sensorbook.attitude import frames
from sensorbook.attitude.sensors.conical import check_attitude

UNOBSERVABLE = (
    "The rotation about the field's direction is not observable: one vector gives two of three angles. "
    "A second direction (Sun, nadir, star) has to give it."
)
REASONS = (
    "",
    "the reading is no finite number",
    "no field is left after the bias: it has no direction",
)
DIPOLE = (
    29.4e-6  # T, of the Earth's dipole at the equator's surface (IGRF-14, 2025: −g₁⁰ is 29.35 µT)
)
_RADIUS = 6371.2e3  # m, the IGRF's reference sphere


def greatest_height() -> float:
    """Height, m, up to which currents in space, `earth.SPACE_FIELD`, stay below a tenth of the dipole's
    field at the equator: above it the IGRF is no reference."""
    return _RADIUS * float((DIPOLE / (10 * earth.SPACE_FIELD)) ** (1 / 3) - 1)


@dataclass(frozen=True)
class FieldDirection:
    """Direction of the field in body axes.

    Attributes
    ----------
    direction : (…, 3) unit vector; NaN where refused
    strength : (…) T
    std : (…) standard error of the direction in each axis across it, rad; None without `sigma`
    information : (…, 3, 3), rad⁻², of the attitude's error vector in body axes; zero about the field
    reasons : (…)
    unobservable : in words
    """

    direction: np.ndarray
    strength: np.ndarray
    std: np.ndarray | None
    information: np.ndarray | None
    reasons: np.ndarray
    unobservable: str = UNOBSERVABLE


@dataclass(frozen=True)
class OrbitField:
    """The field along a circular orbit.

    Attributes
    ----------
    time : (N,) s from the start
    latitude, longitude : (N,) geodetic, rad
    position : (N, 3) m, inertial
    ned : (N, 3) T, north, east, down
    eci : (N, 3) T, inertial axes
    """

    time: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    position: np.ndarray
    ned: np.ndarray
    eci: np.ndarray


def readings(
    attitude: ArrayLike,
    field: ArrayLike,
    bias: ArrayLike = (0.0, 0.0, 0.0),
    soft_iron: ArrayLike | None = None,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> np.ndarray:
    """B_body = A B_ref + b + η (3.10), (…, 3), T; with soft iron S⁻¹ A B_ref + b + η.

    Parameters
    ----------
    attitude : (…, 3, 3), body from the field's frame
    field : (…, 3), T
    bias : (3,), T
    soft_iron : (3, 3), of the house's convention true = soft_iron · (raw − bias)
    noise : standard deviation of each axis, T; needs `rng`
    """
    body = np.einsum("...ij,...j->...i", check_attitude(attitude), field)
    if soft_iron is not None:
        body = np.einsum("ij,...j->...i", np.linalg.inv(_soft_iron(soft_iron)), body)
    body = body + np.asarray(bias, dtype=float)
    if noise:
        if rng is None:
            raise ValueError(f"noise is {noise:g} T and there is no rng: give a seeded generator")
        body = body + rng.normal(0.0, noise, body.shape)
    return body


def field_direction(
    raw: ArrayLike,
    bias: ArrayLike = (0.0, 0.0, 0.0),
    soft_iron: ArrayLike | None = None,
    sigma: float | None = None,
) -> FieldDirection:
    """The field's direction from readings (…, 3), T: true = soft_iron · (raw − bias), made unit.

    `sigma` is the standard error of each axis of the true field, T.
    """
    raw = np.asarray(raw, dtype=float)
    if raw.ndim < 1 or raw.shape[-1] != 3:
        raise ValueError(f"readings: shape is {raw.shape}, needed is (…, 3)")
    if sigma is not None and not (np.isfinite(sigma) and sigma > 0):
        raise ValueError(f"sigma is {sigma}: give a positive standard error in T, or None")
    true = raw - np.asarray(bias, dtype=float)
    if soft_iron is not None:
        true = np.einsum("ij,...j->...i", _soft_iron(soft_iron), true)
    strength = np.linalg.norm(true, axis=-1)
    code = np.where(strength > 0, 0, 2)
    code = np.where(np.isfinite(strength), code, 1)
    good = code == 0
    size = np.where(good, strength, 1.0)
    direction = np.where(good[..., None], true / size[..., None], np.nan)
    std = information = None
    if sigma is not None:
        std = np.where(good, sigma / size, np.nan)
        across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
        information = across / std[..., None, None] ** 2
    strength = np.where(good, strength, np.nan)
    return FieldDirection(direction, strength, std, information, np.array(REASONS)[code])


def field_along_orbit(
    height: float, inclination: float, start: str, samples: int = 200, turns: float = 1.0
) -> OrbitField:
    """The IGRF along a circular orbit about a spherical Earth's mass, from its ascending node.

    Parameters
    ----------
    height : m above the equator's radius
    inclination : rad
    start : UTC, as 2026-06-01T00:00
    samples : over `turns` orbits
    """
    if not height > 0:
        raise ValueError(f"height is {height:g} m: give a height above the Earth's surface")
    rate = np.sqrt(earth.GRAVITATION / (earth.EQUATOR_RADIUS + height) ** 3)
    time = np.linspace(0, 2 * np.pi * turns / rate, samples)
    u = rate * time
    position, _ = frames.circular_orbit(height, inclination, 0.0, u)
    when = np.datetime64(start, "us") + (time * 1e6).astype("timedelta64[us]")
    ecef_from_eci = frames.ecef_from_eci(when)
    ecef = np.einsum("nij,nj->ni", ecef_from_eci, position)
    latitude, longitude, above = frames.geodetic_from_ecef(ecef)
    ned = earth.field_in_ned(latitude, longitude, above, start)
    to_ned = frames.ned_from_ecef(latitude, longitude) @ ecef_from_eci
    return OrbitField(
        time, latitude, longitude, position, ned, np.einsum("nji,nj->ni", to_ned, ned)
    )


def _soft_iron(matrix: ArrayLike) -> np.ndarray:
    matrix = np.asarray(matrix, dtype=float)
    if matrix.shape != (3, 3) or not abs(np.linalg.det(matrix)) > 1e-6:
        raise ValueError("soft_iron is no invertible (3, 3) matrix: near the identity it should be")
    return matrix
