"""The Earth at a place: gravity and rotation (WGS 84), and its magnetic field (IGRF)."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, time

import numpy as np

STANDARD_GRAVITY = 9.80665  # m/s², exact (CGPM 1901)
LOWEST_GRAVITY, HIGHEST_GRAVITY = (
    9.764,
    9.834,
)  # m/s², Huascarán and the Arctic Ocean (GGMplus 2013)
EARTH_RATE = 7.292115e-5  # rad/s, WGS 84 (NIMA TR8350.2, table 3.1)

FIELD_STD = 0.14e-6  # T, WMM2025's error model for the strength; mostly the crust's own field
LEAST_FIELD, LARGEST_FIELD = 22e-6, 67e-6  # T, on the Earth's surface (WMM2025 report, F)
FIELD_YEARS = (1900, 2030)  # of IGRF-14

# WGS 84 ellipsoid (NIMA TR8350.2, tables 3.1, 3.3 and 3.4).
_SEMI_MAJOR = 6378137.0  # m
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY_SQUARED = 6.69437999014e-3
_EQUATOR_GRAVITY = 9.7803253359  # m/s²
_SOMIGLIANA = 1.931852652458e-3
_M = 3.449786506841e-3  # ω²a²b/GM


def normal_gravity(latitude: float, height: float = 0.0) -> float:
    """Normal gravity, m/s², at a geodetic latitude (deg) and height above the ellipsoid (m).

    Somigliana's formula and its second-order upward continuation (NIMA TR8350.2, equations 4-1 and
    4-3). Real gravity differs by local anomalies, seldom more than 0.001 m/s².

    >>> round(normal_gravity(45.0), 5)
    9.8062
    """
    s = np.sin(np.radians(latitude)) ** 2
    on_ellipsoid = _EQUATOR_GRAVITY * (1 + _SOMIGLIANA * s) / np.sqrt(1 - _ECCENTRICITY_SQUARED * s)
    h = height / _SEMI_MAJOR
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
    import ppigrf  # only here: a quarter of a second, and most commands need no field

    latitude, longitude = site["latitude"], site["longitude"]
    # At a pole east has no direction; 10 cm away the field is the same.
    latitude = min(max(latitude, -90 + 1e-6), 90 - 1e-6)
    parts = ppigrf.igrf(longitude, latitude, site.get("height", 0.0) / 1000, date)
    east, north, up = (1e-9 * float(np.ravel(part)[0]) for part in parts)
    level = np.hypot(east, north)
    place = ", ".join(
        f"{abs(angle):.4g}° {'NE'[k] if angle >= 0 else 'SW'[k]}"
        for k, angle in enumerate((latitude, longitude))
    )
    return Field(
        float(np.hypot(level, up)),
        FIELD_STD,
        float(np.arctan2(-up, level)),
        f"the Earth's field (IGRF-14) at {place} on {date:%Y-%m-%d}",
    )


def likely_dip(site) -> tuple[float, str]:
    """The dip angle (rad) for a device's `[site]`, and where it comes from: as well as it is known."""
    dip = field_at(site).dip
    if dip is not None:
        return dip, "of the Earth's field there"
    latitude = (site or {}).get("latitude")
    if latitude is None:
        return float(np.radians(60)), "assumed, of middle latitudes"
    return float(np.arctan(2 * np.tan(np.radians(latitude)))), "of a dipole at this latitude"
