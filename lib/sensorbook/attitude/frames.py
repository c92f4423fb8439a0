"""Coordinate frames about the Earth and the ways between them (work C, 2.6 to 2.11), over arrays.

`b_from_a` is a direction-cosine matrix (…, 3, 3) with v_b = b_from_a @ v_a. Angles are in radians,
lengths in metres, times in UTC (anything NumPy's `datetime64` takes).

- **ECI**: Earth-centred inertial, axes of the celestial reference system GCRS, those of J2000 to 0.02″.
- **ECEF**: Earth-centred, fixed to the Earth: z to the pole, x to Greenwich's meridian (WGS 84, ITRS).
- **Geodetic**: latitude and height are those of the ellipsoid's normal, not of the line to the centre.
- **NED**: tangent to the ellipsoid at a place: x north, y east, z down.
- **Orbital**: moving with the satellite, twice: C's (`orbital_from_eci`) and the usual local vertical,
  local horizontal one (`lvlh_from_eci`). The body's frame is what attitude determination finds.
"""

from __future__ import annotations

import erfa
import numpy as np
from numpy.typing import ArrayLike

from sensorbook import earth
from sensorbook.attitude.rotations import axis_rotation

_WGS84 = 1  # ERFA's number of it
# m from the centre: within e²a, 43 km, several normals meet, and rounding grows before that.
_DEEPEST = 150e3


def ecef_from_geodetic(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> np.ndarray:
    """Position (…, 3), m, of geodetic latitude and longitude (rad) and height (m) on WGS 84 (2.23)."""
    latitude = np.asarray(latitude, dtype=float)
    return erfa.gd2gc(_WGS84, longitude, earth.checked_latitude(latitude), height)


def geodetic_from_ecef(position: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Geodetic latitude and longitude (rad) and height (m) on WGS 84 of positions (…, 3), m.

    ERFA's closed form (Fukushima 2006), whose latitude errs by up to 3e-11 rad in high orbits, and
    two of Newton's steps after it, which leave rounding: 1e-8 m below 2000 km and 2e-15 rad. On the
    axis the longitude is 0.
    """
    position = np.asarray(position, dtype=float)
    if position.ndim < 1 or position.shape[-1] != 3:
        raise ValueError(f"position: shape is {position.shape}, needed is (…, 3)")
    if not (np.linalg.norm(position, axis=-1) > _DEEPEST).all():
        raise ValueError(
            f"position: nearer than {_DEEPEST / 1e3:g} km to the Earth's centre, or no number; "
            "it has no single latitude there (are the positions in metres?)"
        )
    longitude, latitude, height = erfa.gc2gd(_WGS84, position)
    across = np.hypot(position[..., 0], position[..., 1])
    for _ in range(2):
        now = erfa.gd2gc(_WGS84, 0.0, latitude, height)
        outward, up = across - now[..., 0], position[..., 2] - now[..., 2]
        sine, cosine = np.sin(latitude), np.cos(latitude)
        height = height + cosine * outward + sine * up
        bend = earth.meridian_radius(latitude) + height
        latitude = np.clip(latitude + (cosine * up - sine * outward) / bend, -np.pi / 2, np.pi / 2)
    return latitude, longitude, height


def ned_from_ecef(latitude: ArrayLike, longitude: ArrayLike) -> np.ndarray:
    """Earth-fixed to north, east, down at a geodetic latitude and longitude, rad (2.24)."""
    down = axis_rotation("Y", -np.asarray(latitude, dtype=float) - np.pi / 2)
    return down @ axis_rotation("Z", longitude)


def ecef_from_eci(time: ArrayLike) -> np.ndarray:
    """Inertial to Earth-fixed: precession and nutation (IAU 2006/2000A), then the Earth's rotation.

    C turns about z by the sidereal angle alone (2.22), which is right only from the equator and
    equinox *of date*: from the axes of J2000 it misses precession, 0.36° by 2026 (`sidereal_rotation`).

    Left out are UT1 − UTC (below 0.9 s: 0.0038° about the pole) and polar motion (0.3″), which are
    measured and published, not computed.
    """
    tt, ut1 = earth.terrestrial_time(time), earth.universal_time(time)
    return erfa.c2t06a(*tt, *ut1, 0.0, 0.0)


def sidereal_rotation(time: ArrayLike) -> np.ndarray:
    """C's (2.22): the rotation about z by Greenwich's apparent sidereal angle, from the equator of date."""
    return axis_rotation("Z", earth.sidereal_angle(time))


def lvlh_from_eci(position: ArrayLike, velocity: ArrayLike) -> np.ndarray:
    """Inertial to local vertical, local horizontal: z to the Earth's centre, y against the orbit's
    normal, x forward (along the velocity in a circular orbit).

    `position` and `velocity` are (…, 3), inertial, m and m/s.
    """
    normal, nadir = _orbit(position, velocity)
    return np.stack([np.cross(-normal, nadir), -normal, nadir], axis=-2)


def orbital_from_eci(position: ArrayLike, velocity: ArrayLike) -> np.ndarray:
    """Inertial to C's orbital frame: z to the Earth's centre, x against the orbit's normal, y backward.

    The local vertical, local horizontal frame turned by 90° about the nadir.
    """
    normal, nadir = _orbit(position, velocity)
    return np.stack([-normal, np.cross(nadir, -normal), nadir], axis=-2)


def circular_orbit(
    height: float, inclination: float, node: float, argument: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Inertial position (…, 3), m, and velocity (…, 3), m/s, on a circular orbit.

    `height` is above the equator's radius, m; inclination, right ascension of the ascending node and
    the angle from it along the orbit (…) are in rad. The Earth's oblateness is left out.
    """
    radius = earth.EQUATOR_RADIUS + height
    plane = axis_rotation("X", inclination) @ axis_rotation(
        "Z", node
    )  # its rows: node, ahead, normal
    argument = np.asarray(argument, dtype=float)[..., None]
    along, across = plane[0], plane[1]
    position = radius * (np.cos(argument) * along + np.sin(argument) * across)
    speed = np.sqrt(earth.GRAVITATION / radius)
    return position, speed * (np.cos(argument) * across - np.sin(argument) * along)


def _orbit(position: ArrayLike, velocity: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal of the orbit and unit vector to the Earth's centre."""
    position, velocity = np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
    normal = np.cross(position, velocity)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    least = 1e-9 * np.linalg.norm(position, axis=-1) * np.linalg.norm(velocity, axis=-1)
    if not (size[..., 0] > least).all():
        raise ValueError(
            "position and velocity: zero, parallel or no numbers: they span no orbital plane"
        )
    nadir = -position / np.linalg.norm(position, axis=-1, keepdims=True)
    normal, nadir = np.broadcast_arrays(normal / size, nadir)
    return normal, nadir
