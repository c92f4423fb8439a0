"""The chapter on representations and frames: its numbers, and sentences that follow its parameters."""

import contextlib
import io

import erfa
import nbformat
import numpy as np
import pytest
from devices import executed, read_chapter
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import matrix_from_euler, quaternion_from_matrix
from sensorbook.attitude.round_trips import printed_quaternion
from sensorbook.reporting.chapters import NOTEBOOKS

NOTEBOOK = NOTEBOOKS / "11_representations_and_frames.ipynb"


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
    assert "The attitude given is 70.0° from the lock of Z-Y-X: its margin is 0.940." in text
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
    assert "0.1° of error in the attitude become **5.7°** in φ and ψ" in text
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


def test_no_error_and_no_turn(tmp_path):
    record, text = read_chapter(
        "representations",
        tmp_path,
        angles_deg=[0.0, 0.0, 0.0],
        attitude_error_deg=0.0,
        time="2040-05-01T12:00:00Z",
        orbit_height_km=35786.0,
    )
    assert "**The attitude has no error**, nor have its angles" in text
    assert "The attitude given is 90.0° from the lock of Z-Y-X: its margin is 1.000." in text
    assert "At 2040-05-01T12:00:00 UTC the sidereal angle" in text
    assert "UT1 − UTC, below 0.9 s until the bound is raised, in or before 2035 (CGPM 2022" in text
    assert "Warning" not in text
    found = record["results"]["representations"]
    assert found["time"] == "2040-05-01T12:00:00"
    assert found["angle_error_deg"] == 0


def test_an_error_too_large_for_the_law_of_small_ones(read, tmp_path):
    record, text = read_chapter(
        "representations", tmp_path, attitude_error_deg=50.0, time="2030-01-01T00:00:00"
    )
    assert "the law of small errors, no longer holds: the figure's simulation does." in text
    assert "53" not in text[text.index("from the lock of Z-Y-X") :][:300]  # 50°/cos 20°
    assert "UT1 − UTC, kept below 0.9 s by leap seconds, up to" in text
    assert record["results"]["representations"]["angle_error_deg"] is None
    assert "no longer holds" not in read[1]


def shown(outcome):
    """Everything that a run's outputs hold, errors and warnings too."""
    return "".join(str(cell.get("outputs", "")) for cell in outcome.notebook.cells)


def test_z_of_a_time_makes_no_warning(tmp_path):
    given = {"time": "2026-05-01T12:00:00Z"}
    outcome = executed(NOTEBOOK, given, tmp_path)
    assert outcome.status == "complete"
    assert "UserWarning" not in shown(outcome)
    assert "&#42;&#42;" not in shown(outcome), "emphasis inside a value is shown as asterisks"
    assert "Z UTC" not in shown(outcome)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"station_deg": [100.0, 32.78]}, "station_deg: latitude is 100° — give -90 to 90°"),
        ({"attitude_error_deg": -1.0}, "attitude_error_deg: error of the attitude is -1°"),
        ({"vector": [0.0, 0.0, 0.0]}, "vector: length is 0 — give more than 0"),
        ({"sequence": "ZZX"}, "sequence: is 'ZZX' — give one of XYX, XYZ,"),
        ({"time": "noon"}, "time: 'noon' is no time"),
        ({"orbit_height_km": -6378.137}, "orbit_height_km: height of the orbit is -6378.14 km"),
    ],
)
def test_nonsense_is_named(given, said, tmp_path):
    outcome = executed(NOTEBOOK, given, tmp_path)
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert "radians" not in outcome.reason


@pytest.mark.parametrize(("angles", "alike"), [((30, 20, -40), False), ((0, 0, 0), True)])
def test_the_teaching_cell_tells_column_from_row(angles, alike):
    book = nbformat.read(NOTEBOOK, as_version=4)
    source = next(c.source for c in book.cells if "reference_x_in_body" in c.source)
    names = {"np": np, "A": matrix_from_euler("ZYX", np.radians(angles))}
    names |= {"matrix_from_euler": matrix_from_euler, "printed_quaternion": printed_quaternion}
    names["quaternion_from_matrix"] = quaternion_from_matrix
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(source, names)
    assert f"A's first column: True A's first row: {alike}" in printed.getvalue()
    assert ("try another one" in printed.getvalue()) == alike
