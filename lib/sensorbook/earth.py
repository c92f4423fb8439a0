"""The Earth at a place: gravity and rotation (WGS 84), its magnetic field (IGRF), time and the Sun.

Thin over ppigrf (the IGRF) and ERFA (the IAU's Standards of Fundamental Astronomy), which need no network.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from datetime import datetime, time

import numpy as np
from numpy.typing import ArrayLike

STANDARD_GRAVITY = 9.80665  # m/s², exact (CGPM 1901)
LOWEST_GRAVITY, HIGHEST_GRAVITY = (
    9.764,
    9.834,
)  # m/s², Huascarán and the Arctic Ocean (GGMplus 2013)
EARTH_RATE = 7.292115e-5  # rad/s, WGS 84 (NIMA TR8350.2, table 3.1)

FIELD_STD = 0.14e-6  # T, WMM2025's error model for the strength; mostly the crust's own field
LEAST_FIELD, LARGEST_FIELD = 22e-6, 67e-6  # T, on the Earth's surface (WMM2025 report, F)
FIELD_YEARS = (1900, 2030)  # of IGRF-14
SPACE_FIELD = (
    0.1e-6  # T, of currents in the ionosphere and beyond, without storms: at most, in orbit
)

EQUATOR_RADIUS = 6378137.0  # m, WGS 84
GRAVITATION = 3.986004418e14  # m³/s², WGS 84 with the atmosphere (NIMA TR8350.2, table 3.1)

# WGS 84 ellipsoid (NIMA TR8350.2, tables 3.1, 3.3 and 3.4).
_FLATTENING = 1 / 298.257223563
POLE_RADIUS = EQUATOR_RADIUS * (1 - _FLATTENING)  # m
_ECCENTRICITY_SQUARED = 6.69437999014e-3
_EQUATOR_GRAVITY = 9.7803253359  # m/s²
_SOMIGLIANA = 1.931852652458e-3
_M = 3.449786506841e-3  # ω²a²b/GM


def normal_gravity(latitude: float, height: float = 0.0) -> float:
    """Normal gravity, m/s², at a geodetic latitude (deg) and height above the ellipsoid (m).

    Somigliana's formula and its second-order upward continuation (NIMA TR8350.2, equations 4-1 and
    4-3), which holds to some 100 km. Real gravity differs by local anomalies, seldom more than
    0.001 m/s².

    >>> round(normal_gravity(45.0), 5)
    9.8062
    """
    s = np.sin(np.radians(latitude)) ** 2
    on_ellipsoid = _EQUATOR_GRAVITY * (1 + _SOMIGLIANA * s) / np.sqrt(1 - _ECCENTRICITY_SQUARED * s)
    h = height / EQUATOR_RADIUS
    linear = 2 * (1 + _FLATTENING + _M - 2 * _FLATTENING * s) * h
    return float(on_ellipsoid * (1 - linear + 3 * h**2))


def gravity_at(site) -> tuple[float, str, float]:
    """Gravity (m/s²) for a device's `[site]`, in words where it comes from, and its uncertainty.

    The uncertainty is a standard error: half the range that occurs on land where the latitude is not
    known, 0.0005 m/s² (gravity anomalies) and 0.003 (1000 m of height) where it is.
    """
    latitude, height = (site or {}).get("latitude"), (site or {}).get("height")
    if latitude is None:
        return (
            STANDARD_GRAVITY,
            "standard gravity, as the recording does not say where it was made",
            (HIGHEST_GRAVITY - LOWEST_GRAVITY) / np.sqrt(12),
        )
    words = f"normal gravity (WGS 84) at {abs(latitude):.4g}° {'N' if latitude >= 0 else 'S'}"
    if height is None:
        return normal_gravity(latitude), words + ", height not given, taken as 0 m", 3e-3
    return normal_gravity(latitude, height), f"{words}, {height:.0f} m", 5e-4


@dataclass(frozen=True)
class Field:
    """The Earth's magnetic field at a place.

    Attributes
    ----------
    strength : T; None where place or date is not known
    std : T, its standard error outdoors; steel in a building changes it by more
    dip : rad, positive where it points down; None where not known
    source : in words
    """

    strength: float | None
    std: float
    dip: float | None
    source: str


def field_at(site) -> Field:
    """The Earth's field for a device's `[site]`, by the IGRF (14th generation, Alken et al. 2021)."""
    site = site or {}
    missing = [key for key in ("latitude", "longitude", "date") if site.get(key) is None]
    if missing:
        return Field(None, 0.0, None, f"not known: [site] has no {' and no '.join(missing)}")
    date = datetime.combine(site["date"], time())
    if not FIELD_YEARS[0] <= date.year < FIELD_YEARS[1]:
        first, end = FIELD_YEARS
        return Field(
            None, 0.0, None, f"not known: the IGRF holds from {first} to {end}, not in {date.year}"
        )
    latitude, longitude = site["latitude"], site["longitude"]
    place = np.radians(latitude), np.radians(longitude), site.get("height", 0.0)
    north, east, down = field_in_ned(*place, date)
    level = np.hypot(east, north)
    place = ", ".join(
        f"{abs(angle):.4g}° {'NE'[k] if angle >= 0 else 'SW'[k]}"
        for k, angle in enumerate((latitude, longitude))
    )
    return Field(
        float(np.hypot(level, down)),
        FIELD_STD,
        float(np.arctan2(down, level)),
        f"the Earth's field (IGRF-14) at {place} on {date:%Y-%m-%d}",
    )


def field_in_ned(
    latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike, date: ArrayLike
) -> np.ndarray:
    """The Earth's field (…, 3), T, north, east, down, by the IGRF at geodetic places and one date.

    Latitude and longitude in rad, height in m above WGS 84, to thousands of km; `date` is anything
    `datetime64` takes. It is the core's field: the crust adds 0.14 µT on the ground, and currents in
    the ionosphere and beyond add 0.02 to 0.1 µT in orbit, more in magnetic storms.
    """
    import ppigrf  # only here: a quarter of a second, and most commands need no field

    date = np.datetime64(date, "us")
    year = date.astype("datetime64[Y]").astype(int) + 1970
    if not FIELD_YEARS[0] <= year < FIELD_YEARS[1]:
        first, end = FIELD_YEARS
        raise ValueError(f"date is {date}: the IGRF holds from {first} to {end}")
    # At a pole east has no direction; 10 cm away the field is the same.
    degrees = np.clip(np.degrees(checked_latitude(latitude)), -90 + 1e-6, 90 - 1e-6)
    places = np.broadcast_arrays(np.degrees(longitude), degrees, np.asarray(height) / 1000)
    east, north, up = ppigrf.igrf(*(place.ravel() for place in places), date.item())
    field = 1e-9 * np.stack([north, east, -up], axis=-1)
    return field.reshape(*places[0].shape, 3)


def likely_dip(site) -> tuple[float, str]:
    """The dip angle (rad) for a device's `[site]`, and where it comes from: as well as it is known."""
    dip = field_at(site).dip
    if dip is not None:
        return dip, "of the Earth's field there"
    latitude = (site or {}).get("latitude")
    if latitude is None:
        return float(np.radians(60)), "assumed, of middle latitudes"
    return float(np.arctan(2 * np.tan(np.radians(latitude)))), "of a dipole at this latitude"


def checked_latitude(latitude: ArrayLike) -> np.ndarray:
    """Latitudes, rad, as floats; a ValueError beyond the poles, but for single precision's rounding."""
    latitude = np.asarray(latitude, dtype=float)
    if not (np.abs(latitude) <= np.pi / 2 + 1e-7).all():
        raise ValueError(
            "latitude is beyond ±π/2 rad or no number: give geodetic latitude in radians"
        )
    return np.clip(latitude, -np.pi / 2, np.pi / 2)


def meridian_radius(latitude: ArrayLike) -> np.ndarray:
    """Radius of curvature of WGS 84 along the meridian, m, at a geodetic latitude, rad."""
    sine = np.sin(latitude)
    return (
        EQUATOR_RADIUS * (1 - _ECCENTRICITY_SQUARED) / (1 - _ECCENTRICITY_SQUARED * sine**2) ** 1.5
    )


def terrestrial_time(time: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Terrestrial time of UTC times, as ERFA's Julian date in two parts.

    The last leap second known is that of 2017; one to come would make the time a second more.
    """
    import erfa  # only here: most commands need no sky

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # "dubious year": said above
        day, fraction = universal_time(time)
        # From midnight on: ERFA would stretch the days that end with a leap second.
        midnight, offset = erfa.utctai(day, 0.0)
        return erfa.taitt(midnight, offset + fraction)


def universal_time(time: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """UTC times as ERFA's Julian date in two parts, which is UT1 as well to 0.9 s."""
    time = np.asarray(time)
    if time.dtype.kind in "iuf":
        raise ValueError(
            f"time is a bare number, {time.ravel()[0]:g}: give UTC, as 2024-05-01T12:00"
        )
    time = time.astype("datetime64[us]")
    first, end = np.datetime64("1972-01-01"), np.datetime64("2200-01-01")
    if not ((time >= first) & (time < end)).all():
        raise ValueError(
            "time is missing, before 1972, when UTC began, or after 2200: give UTC, as 2024-05-01T12:00"
        )
    day = time.astype("datetime64[D]")
    fraction = (time - day).astype(float) / 86400e6
    return 2440587.5 + day.astype(float), fraction


def sidereal_angle(time: ArrayLike) -> np.ndarray:
    """Greenwich's apparent sidereal angle, rad, of UTC times (IAU 2006/2000A), to 0.9 s of UT1 − UTC.

    >>> round(float(np.degrees(sidereal_angle("2000-01-01T12:00"))), 2)  # the Sun's mean longitude there
    280.46
    """
    import erfa

    return erfa.gst06a(*universal_time(time), *terrestrial_time(time))


def sun_direction(time: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Unit vector (…, 3) to the Sun as it is seen, inertial (GCRS), at UTC times (…).

    From an inertial `position` (…, 3), m, of the satellite: at GEO it is 0.016° off that from the
    Earth's centre. ERFA's Earth (`epv00`, within 14 km of JPL's DE405 from 1900 to 2100: 0.02″; later
    it is less and less exact) with the aberration by the Earth's motion, 20.5″; that by the satellite's
    own, up to 5″, is left out.
    """
    import erfa

    tt = terrestrial_time(time)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # after 2100: said above
        heliocentric, barycentric = erfa.epv00(*tt)
    to_sun = -heliocentric["p"] - np.asarray(position, dtype=float) / erfa.DAU
    distance = np.linalg.norm(to_sun, axis=-1)
    velocity = barycentric["v"] * erfa.DAU / erfa.DAYSEC / erfa.CMPS
    slowed = np.sqrt(1 - (velocity**2).sum(axis=-1))
    return erfa.ab(to_sun / distance[..., None], velocity, distance, slowed)
