"""Frames about the Earth: against work C's equations, published matrices, and the way back."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensorbook.attitude.frames import (
    circular_orbit,
    ecef_from_eci,
    ecef_from_geodetic,
    geodetic_from_ecef,
    lvlh_from_eci,
    ned_from_ecef,
    orbital_from_eci,
    sidereal_rotation,
)
from sensorbook.attitude.rotations import axis_rotation, error_vector

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84, C's table 2.1
E2 = FLATTENING * (2 - FLATTENING)


def c_2_23(latitude, longitude, height):
    n = SEMI_MAJOR / np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    return np.stack(
        [
            (n + height) * np.cos(latitude) * np.cos(longitude),
            (n + height) * np.cos(latitude) * np.sin(longitude),
            (n * (1 - E2) + height) * np.sin(latitude),
        ],
        axis=-1,
    )


def c_2_24(latitude, longitude):
    (sf, sl), (cf, cl) = np.sin([latitude, longitude]), np.cos([latitude, longitude])
    return [[-sf * cl, -sf * sl, cf], [-sl, cl, 0], [-cf * cl, -cf * sl, -sf]]


# --- geodetic ---


def places(rng, size, highest):
    """Latitudes, longitudes, heights; poles, equator and ±180° are among them."""
    latitude = np.arcsin(rng.uniform(-1, 1, size))
    longitude = rng.uniform(-np.pi, np.pi, size)
    latitude[:4] = [np.pi / 2, -np.pi / 2, 0, 0]
    longitude[4:6] = [np.pi, -np.pi]
    latitude[6:40] = np.pi / 2 - 10.0 ** -np.linspace(0, 16, 34)
    return latitude, longitude, rng.uniform(-10e3, highest, size)


@pytest.mark.parametrize(("highest", "tolerance"), [(2000e3, 1e-8), (50_000e3, 5e-8)])
def test_geodetic_and_back(highest, tolerance):
    latitude, longitude, height = places(np.random.default_rng(21), 100_000, highest)
    position = ecef_from_geodetic(latitude, longitude, height)
    lat, lon, up = geodetic_from_ecef(position)
    assert np.abs(lat - latitude).max() <= 2e-15
    assert np.abs(up - height).max() <= tolerance
    assert np.linalg.norm(ecef_from_geodetic(lat, lon, up) - position, axis=1).max() <= tolerance
    clear = np.cos(latitude) > 1e-3  # longitude has no meaning at a pole
    turned = np.angle(np.exp(1j * (lon - longitude)))  # +180° is −180°
    assert np.abs(turned[clear]).max() <= 2e-15


@given(st.floats(-np.pi / 2, np.pi / 2), st.floats(-np.pi, np.pi), st.floats(-10e3, 50_000e3))
def test_any_place_and_back(latitude, longitude, height):
    position = ecef_from_geodetic(latitude, longitude, height)
    lat, lon, up = geodetic_from_ecef(position)
    assert abs(lat - latitude) <= 2e-15
    assert abs(up - height) <= 5e-8
    assert np.linalg.norm(ecef_from_geodetic(lat, lon, up) - position) <= 5e-8


def test_against_2_23():
    place = places(np.random.default_rng(22), 10_000, 50_000e3)
    # 1 part in 1e16 of 5e7 m, some operations.
    assert np.abs(ecef_from_geodetic(*place) - c_2_23(*place)).max() < 5e-8


def test_known_places():
    """The axes of the ellipsoid; b = 6 356 752.3142 m (NIMA TR8350.2, table 3.3)."""
    assert ecef_from_geodetic(0.0, 0.0, 0.0) == pytest.approx([SEMI_MAJOR, 0, 0], abs=1e-9)
    pole = ecef_from_geodetic(np.pi / 2, 0.0, 0.0)
    assert pole == pytest.approx([0, 0, 6356752.3142], abs=5e-5)
    for z in (6400e3, -6400e3):
        lat, lon, up = geodetic_from_ecef([0.0, 0.0, z])
        assert (lat, lon) == (np.copysign(np.pi / 2, z), 0.0)
        assert up == pytest.approx(6400e3 - 6356752.3142, abs=5e-5)


@pytest.mark.parametrize("batch", [(), (3,), (2, 1, 4)])
def test_batches_of_any_shape(batch):
    zeros = np.zeros(batch)
    position = ecef_from_geodetic(zeros, 0.5, 400e3)
    assert position.shape == (*batch, 3)
    assert all(np.shape(part) == batch for part in geodetic_from_ecef(position))
    assert ned_from_ecef(zeros, 0.5 + zeros).shape == (*batch, 3, 3)
    times = np.full(batch, np.datetime64("2024-05-01T12:00"))
    assert ecef_from_eci(times).shape == sidereal_rotation(times).shape == (*batch, 3, 3)
    assert lvlh_from_eci(position, [0, 1e3, 7e3]).shape == (*batch, 3, 3)
    assert orbital_from_eci([7e6, 0, 0], np.broadcast_to([0, 1e3, 7e3], (*batch, 3))).shape == (
        *batch,
        3,
        3,
    )


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (ecef_from_geodetic, (1.6, 0, 0), "latitude is beyond ±π/2 rad or no number"),
        (ecef_from_geodetic, ([0, np.nan], 0, 0), "latitude is beyond ±π/2 rad or no number"),
        (geodetic_from_ecef, ([0, 0, 6378.0],), "position: nearer than 150 km to the Earth's centre"),
        (geodetic_from_ecef, ([np.nan, 0, 7e6],), "position: nearer than 150 km"),
        (geodetic_from_ecef, ([7e6, 0],), "position: shape is (2,), needed is (…, 3)"),
        (geodetic_from_ecef, (7e6,), "position: shape is (), needed is (…, 3)"),
        (lvlh_from_eci, ([7e6, 0, 0], [-3.0, 0, 0]), "zero, parallel or no numbers: they span no"),
        (orbital_from_eci, ([7e6, 0, 0], [0.0, 0, 0]), "zero, parallel or no numbers: they span no"),
        (orbital_from_eci, ([7e6, 0, 0], [np.nan, 1, 0]), "zero, parallel or no numbers: they span"),
        (ecef_from_eci, ("1971-12-31T23:59",), "time is missing, before 1972, when UTC began"),
        (ecef_from_eci, (["2024-05-01", "NaT"],), "time is missing, before 1972, when UTC began"),
        (sidereal_rotation, ("1969-07-20",), "time is missing, before 1972, when UTC began"),
    ],
)  # fmt: skip
def test_bad_input_is_named(function, arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        function(*arguments)


# --- north, east, down ---


def test_against_2_24():
    latitude, longitude, _ = places(np.random.default_rng(23), 500, 0.0)
    found = ned_from_ecef(latitude, longitude)
    for one, *place in zip(found, latitude, longitude, strict=True):
        assert np.abs(one - c_2_24(*place)).max() < 1e-15


def test_ned_points_north_east_and_down():
    """The derivatives of position by latitude, longitude and height, at 39.89° N 32.78° E."""
    lat, lon, up, step = np.radians(39.89), np.radians(32.78), 900.0, 1e-6
    north = ecef_from_geodetic(lat + step, lon, up) - ecef_from_geodetic(lat - step, lon, up)
    east = ecef_from_geodetic(lat, lon + step, up) - ecef_from_geodetic(lat, lon - step, up)
    down = ecef_from_geodetic(lat, lon, up - 1) - ecef_from_geodetic(lat, lon, up + 1)
    axes = np.array([v / np.linalg.norm(v) for v in (north, east, down)])
    assert ned_from_ecef(lat, lon) == pytest.approx(axes, abs=2e-9)  # 1e-9 m over some metres


# --- inertial to Earth-fixed ---

# "SOFA Tools for Earth Attitude", section 5.5 (IAU 2006/2000A, with polar motion and UT1).
SOFA = [
    [0.973104317697535, 0.230363826239128, -0.000703163482198],
    [-0.230363800456037, 0.973104570632801, 0.000118545366625],
    [0.000711560162668, 0.000046626403995, 0.999999745754024],
]


def test_against_the_sofa_cookbook():
    """What is left out there: UT1 − UTC = −0.072073685 s and the pole's 0.0349282″ and 0.4833163″."""
    off = error_vector(ecef_from_eci("2007-04-05T12:00"), SOFA)
    assert off[2] == pytest.approx(0.072073685 * 7.292115e-5, abs=2e-9)
    arcsecond = np.radians(1 / 3600)
    assert np.hypot(*off[:2]) == pytest.approx(np.hypot(0.0349282, 0.4833163) * arcsecond, rel=1e-3)


def test_it_is_a_rotation_that_turns_once_a_day():
    times = np.datetime64("2024-05-01T00:00") + np.arange(0, 1440, 10).astype("timedelta64[m]")
    a = ecef_from_eci(times)
    assert np.abs(a @ np.swapaxes(a, 1, 2) - np.eye(3)).max() < 1e-15
    turn = error_vector(a[1:], a[:-1])
    assert turn[:, 2] == pytest.approx(600 * 7.292115e-5, rel=1e-6)
    assert np.abs(turn[:, :2]).max() < 1e-7  # precession and nutation in ten minutes


def test_sidereal_rotation_is_2_22_and_misses_precession():
    angles = {}
    for year in (2000, 2013, 2026, 2050):
        time = f"{year}-01-01T12:00"
        off = error_vector(sidereal_rotation(time), ecef_from_eci(time))
        angles[year] = np.degrees(np.linalg.norm(off))
        # General precession, 50.29″ a year, and nutation, up to 20″.
        expected = (year - 2000) * 50.29 / 3600
        assert angles[year] == pytest.approx(expected, abs=25 / 3600)
    assert angles[2026] == pytest.approx(0.36, abs=0.006)
    z = sidereal_rotation("2026-01-01T12:00")
    assert z[2].tolist() == [0, 0, 1]
    assert z[0, 0] == z[1, 1]


def test_far_future_says_nothing_a_hundred_times(recwarn):
    ecef_from_eci(np.full(100, np.datetime64("2090-01-01")))
    assert not recwarn.list


# --- orbital frames ---

GEOSTATIONARY = [42_164e3, 0, 0], [0, 3074.7, 0]


def test_axes_as_documented():
    """A satellite over the equator that goes east: the orbit's normal is the pole."""
    x, y, z = lvlh_from_eci(*GEOSTATIONARY)
    assert (x.tolist(), y.tolist(), z.tolist()) == ([0, 1, 0], [0, 0, -1], [-1, 0, 0])
    x, y, z = orbital_from_eci(*GEOSTATIONARY)
    assert (x.tolist(), y.tolist(), z.tolist()) == ([0, 0, -1], [0, -1, 0], [-1, 0, 0])


def test_orbital_frames_on_any_orbit():
    rng = np.random.default_rng(24)
    position, velocity = 7e6 * rng.normal(size=(500, 3)), 7e3 * rng.normal(size=(500, 3))
    lvlh, own = lvlh_from_eci(position, velocity), orbital_from_eci(position, velocity)
    for frame in (lvlh, own):
        assert np.abs(frame @ np.swapaxes(frame, 1, 2) - np.eye(3)).max() < 1e-14
        assert np.linalg.det(frame) == pytest.approx(1)
        nadir = -position / np.linalg.norm(position, axis=1, keepdims=True)
        assert frame[:, 2] == pytest.approx(nadir, abs=1e-15)
    normal = np.cross(position, velocity)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert lvlh[:, 1] == pytest.approx(-normal, abs=1e-14)
    assert own[:, 0] == pytest.approx(-normal, abs=1e-14)
    assert ((lvlh[:, 0] * velocity).sum(axis=1) > 0).all()
    assert ((own[:, 1] * velocity).sum(axis=1) < 0).all()
    assert own @ np.swapaxes(lvlh, 1, 2) == pytest.approx(
        np.broadcast_to(axis_rotation("Z", np.pi / 2), own.shape), abs=1e-14
    )


def test_circular_orbit():
    """Height, inclination and node as given; the speed makes it a circle: v² = GM/r."""
    argument = np.linspace(0, 2 * np.pi, 9)
    position, velocity = circular_orbit(550e3, np.radians(97.6), 0.3, argument)
    radius, speed = np.linalg.norm(position, axis=1), np.linalg.norm(velocity, axis=1)
    assert radius == pytest.approx(SEMI_MAJOR + 550e3)
    assert speed**2 * radius == pytest.approx(3.986004418e14)
    assert (position * velocity).sum(axis=1) == pytest.approx(0, abs=1)
    normal = np.cross(position, velocity) / (radius * speed)[:, None]
    assert np.degrees(np.arccos(normal[:, 2])) == pytest.approx(97.6)
    assert position[0] == pytest.approx(radius[0] * np.array([np.cos(0.3), np.sin(0.3), 0]))
    assert velocity[0, 2] > 0  # the node is the ascending one
    ahead = circular_orbit(550e3, np.radians(97.6), 0.3, 1e-6)[0] - position[0]
    assert ahead @ velocity[0] > 0
    assert position[2, 2] == pytest.approx(radius[0] * np.sin(np.radians(97.6)))


def test_geodetic_as_deep_as_it_goes_and_in_single_precision_at_the_pole():
    rng = np.random.default_rng(17)
    direction = rng.normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    position = direction * rng.uniform(150.1e3, 400e3, (20_000, 1))
    # Rounding of metres on millions of them, as at the surface: its claim of 1e-8 m.
    assert np.abs(ecef_from_geodetic(*geodetic_from_ecef(position)) - position).max() < 1e-8
    pole = ecef_from_geodetic(np.float32(np.pi / 2), 0.0, 0.0)
    assert pole == pytest.approx([0, 0, 6356752.3142], abs=1e-3)
