"""The chapter on representations and frames: its numbers, and sentences that follow its parameters."""

import erfa
import numpy as np
import pytest
from devices import read_chapter
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("representations", tmp_path_factory.mktemp("chapter"))


def test_attitude(read):
    """Against scipy, whose matrices are active."""
    found = read[0]["results"]["representations"]
    turn = Rotation.from_euler("ZYX", [30, 20, -40], degrees=True)
    assert np.array(found["matrix"]) == pytest.approx(turn.as_matrix().T, abs=1e-15)
    assert found["quaternion"] == pytest.approx(turn.as_quat(canonical=True), abs=1e-15)
    vector = turn.as_rotvec()
    assert found["euler_angle_deg"] == pytest.approx(np.degrees(np.linalg.norm(vector)))
    assert found["euler_axis"] == pytest.approx(vector / np.linalg.norm(vector))
    assert found["angles_deg"] == pytest.approx([30, 20, -40])
    assert found["lock_margin"] == pytest.approx(np.cos(np.radians(20)))
    assert found["angle_error_deg"] == pytest.approx(0.1 / np.cos(np.radians(20)))
    # The quotient of rounding, some 1e-15, and 1.5e-8: where half of the digits are gone.
    assert all(1e-8 < distance < 1e-6 for distance in found["half_lost_rad"].values())
    assert found["worst_error_rad"] < 5e-15


def test_satellite_and_station(read):
    found = read[0]["results"]["representations"]
    # The orbit, by three rotations of scipy's from its plane.
    turn = Rotation.from_euler("ZXZ", [80.0, 97.6, 35.0], degrees=True)
    eci = turn.apply([6378137.0 + 550e3, 0, 0])
    forward = turn.apply([0, 1.0, 0])
    satellite, station = found["satellite"], found["station"]
    assert satellite["eci_m"] == pytest.approx(eci, abs=1e-3)

    # The Earth's rotation by ERFA's own steps, 2026-05-01T12:00 UTC: 69.184 s from TT.
    utc, tt = (2461162.0, 0.0), (2461162.0, 69.184 / 86400)
    angle = erfa.gst06a(*utc, *tt)
    assert found["sidereal_angle_deg"] == pytest.approx(np.degrees(angle))
    cs, sn = np.cos(angle), np.sin(angle)
    spin = np.array([[cs, sn, 0], [-sn, cs, 0], [0, 0, 1]])
    rotation = spin @ erfa.pnm06a(*tt)
    ecef = rotation @ eci
    # The equinox's and the origin-based way differ by 1e-9 rad at most.
    assert satellite["ecef_m"] == pytest.approx(ecef, abs=0.02)
    missed = Rotation.from_matrix(rotation @ spin.T).magnitude()
    assert found["sidereal_rotation_misses_deg"] == pytest.approx(np.degrees(missed), rel=1e-6)

    def surface(latitude, longitude, height):
        n = 6378137.0 / np.sqrt(1 - 6.69437999014e-3 * np.sin(latitude) ** 2)
        across = (n + height) * np.cos(latitude)
        up = (n * (1 - 6.69437999014e-3) + height) * np.sin(latitude)
        return np.array([across * np.cos(longitude), across * np.sin(longitude), up])

    place = np.radians([satellite["latitude_deg"], satellite["longitude_deg"]])
    assert surface(*place, satellite["height_m"]) == pytest.approx(satellite["ecef_m"], abs=1e-6)
    lat, lon = np.radians([39.89, 32.78])
    ground = surface(lat, lon, 900.0)
    assert station["ecef_m"] == pytest.approx(ground, abs=1e-6)
    away = ecef - ground
    east = np.array([-np.sin(lon), np.cos(lon), 0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    north = np.cross(up, east)
    assert station["distance_m"] == pytest.approx(np.linalg.norm(away), abs=0.02)
    elevation = np.degrees(np.arcsin(up @ away / np.linalg.norm(away)))
    assert station["elevation_deg"] == pytest.approx(elevation, abs=1e-5)
    azimuth = np.degrees(np.arctan2(east @ away, north @ away)) % 360
    assert station["azimuth_deg"] == pytest.approx(azimuth, abs=1e-5)

    # In the body: LVLH has x forward and z down; then the attitude.
    down = -eci / np.linalg.norm(eci)
    lvlh = np.array([forward, np.cross(down, forward), down])
    look = rotation.T @ -away / np.linalg.norm(away)
    expected = np.array(found["matrix"]) @ lvlh @ look
    assert found["station_in_body"] == pytest.approx(expected, abs=1e-7)
    body_sun = np.array(found["matrix"]) @ lvlh @ np.array(found["sun_eci"])
    assert found["sun_body"] == pytest.approx(body_sun, abs=1e-12)
    # The Sun on 1 May: right ascension 2 h 33 min, declination +15.1° (almanac), of 2000 a bit less.
    x, y, z = found["sun_eci"]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(38.3, abs=0.5)
    assert np.degrees(np.arcsin(z)) == pytest.approx(15.1, abs=0.2)


def test_sentences(read):
    text = read[1]
    assert "This attitude is one turn by **57.0732°** about (-0.7694, 0.1474, 0.6215)" in text
    assert "(2.11) divides by 0.88, which is sound here." in text
    assert "In Z-Y-X it is (30.000, 20.000, -40.000)°, as given." in text
    assert "The attitude given is 70.0° from the lock of Z-Y-X: its margin is 0.940" in text
    assert "0.1° of error in the attitude become **0.11°** in φ and ψ" in text
    assert "At the time given it misses **0.369°**, 45 km at the satellite" in text
    assert "at most it is 0.192° on the ground; at the station **0.1892°**" in text.lower()
    assert "850 km away: in sight." in text
    assert "the satellite is **in sunlight**" in text


def test_near_the_lock_at_half_a_turn_and_behind_the_earth(tmp_path):
    record, text = read_chapter(
        "representations",
        tmp_path,
        angles_deg=[180.0, 89.0, 0.0],
        along_orbit_deg=250.0,
        time="2010-01-01T00:00:00",
    )
    assert "**The attitude given is near the lock of Z-Y-X**: its margin is 0.017" in text
    assert "0.1° of error in the attitude become about 5.7° in φ and ψ" in text
    assert "Another sequence is better: " in text
    assert "Its turn is 0° short of 180°: (2.11) divides by" in text
    assert "below the horizon, with the Earth between them" in text
    assert "At the time given it misses **0.14" in text
    found = record["results"]["representations"]
    assert found["angle_error_deg"] == pytest.approx(0.1 / np.cos(np.radians(89)))
    assert found["station"]["elevation_deg"] < 0


def test_at_the_lock_and_beyond_the_range(tmp_path):
    record, text = read_chapter(
        "representations", tmp_path, sequence="ZXZ", angles_deg=[30.0, 0.0, 20.0]
    )
    assert "**The attitude given is locked**: φ and ψ are not determined one by one" in text
    assert "In Z-X-Z it is (0.000, 0.000, 50.000)°: another triple than the one given" in text
    assert "the angles of this attitude are locked" in text
    found = record["results"]["representations"]
    assert found["angle_error_deg"] is None
    assert found["angles_deg"] == pytest.approx([0, 0, 50], abs=1e-12)
