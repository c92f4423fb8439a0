"""The chapter on attitude sensors: its numbers, and sentences that follow its parameters."""

import numpy as np
import pytest
from devices import executed, read_chapter

from sensorbook.attitude.sensors.sun import cell_currents, four_cell_direction, four_normals
from sensorbook.reporting.chapters import NOTEBOOKS

RADIUS, INFRARED = 6371e3, 6411e3  # m


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("attitude_sensors", tmp_path_factory.mktemp("chapter"))


def test_numbers(read):
    found = read[0]["results"]["attitude_sensors"]
    rho = np.arcsin(INFRARED / (RADIUS + 700e3))
    assert found["earth_radius_rad"] == pytest.approx(rho, rel=1e-12)
    roll, pitch, cone = np.radians([6.0, 4.0, 45.0])
    for angle in found["crossings_rad"]:
        # Work C's equation 3.9.
        left = np.cos(pitch) * np.sin(roll) * np.cos(cone) + np.sin(cone) * (
            np.cos(pitch) * np.cos(roll) * np.cos(angle) - np.sin(pitch) * np.sin(angle)
        )
        assert left == pytest.approx(np.cos(rho), abs=1e-12)
    one = found["one_cone"]
    assert (one["roll_rad"], one["pitch_rad"]) == pytest.approx((roll, pitch), abs=1e-9)
    ways = found["two_cones_rms"]
    # 5000 samples: an rms is known to 1 %.
    assert ways["one cone, height known"]["roll [°]"] == pytest.approx(
        np.degrees(one["roll_std_rad"]), rel=0.04
    )
    # The source says that the fourth crossing does not help.
    assert found["fourth_crossing_gain"] > 0.2
    assert found["greatest_height_m"] == pytest.approx(
        INFRARED / np.sin(np.pi / 4 - np.arcsin(np.cos(pitch) * np.sin(roll))) - RADIUS, rel=1e-9
    )
    # From 20 000 rays a field: 2e-4 rad.
    assert found["static"]["roll_rad"] == pytest.approx(roll / 4, abs=2e-4)
    assert found["static"]["pitch_rad"] == pytest.approx(pitch / 4, abs=2e-4)
    star = found["star"]
    assert star["catalogue"] == pytest.approx(10313.25)
    assert star["mean_for_99_percent"] == pytest.approx(10.045, abs=0.001)
    pixel = 3600 * np.degrees(2 * np.tan(np.radians(4)) / 1024)
    assert star["across_arcsec"] == pytest.approx(0.1 * pixel / np.sqrt(star["in_view"]), rel=0.15)
    assert star["roll_arcsec"] > 8 * star["across_arcsec"]
    assert all(0.3 < ratio < 3 for ratio in found["ratio_to_work_c"].values())


def test_sentences(read):
    text = read[1]
    assert "**20.0° or -20.0°**" in text
    assert "From 700 km the Earth's radius is **65.05°**" in text
    assert "Chosen is the only one of the two with the Earth between the crossings" in text
    assert "Yaw, the rotation about the line to the Earth's centre, is not observable" in text
    assert "the claim does not hold under noise" in text
    assert "it fills **29 %** of the sky" in text
    assert "Simulated were 6° and 4°: off by" in text
    assert "All four are lit from 17 % of the sky" in text
    assert "the largest parts are centroid noise, 0.000274°, and alignment" in text
    assert "95 of 100 others would end within ±0.20°" in text
    assert "stays below a tenth of the field" in text
    assert "**10,313** for 3° × 4°" in text
    assert "only **35 %** of the time" in text
    assert "Warning" not in text


def test_the_share_of_the_sky_that_lights_four_cells():
    rng = np.random.default_rng(12)
    for degrees in (30, 45, 70):
        tilt = np.radians(degrees)
        some = four_cell_direction(
            cell_currents(rng.normal(size=(20000, 3)), four_normals(tilt)), tilt
        )
        # 20 000 directions: the share is known to 0.0035; three times that.
        share = np.arcsin(np.cos(tilt) ** 2) / np.pi
        assert np.mean(some.reasons == "") == pytest.approx(share, abs=0.011)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"roll_deg": 180.0}, "roll **180.0000°** and pitch **4.0000°**. Simulated were 180° and 4°:"),
        ({"pitch_deg": 120.0}, "Simulated were -174° and 60° (the same nadir as of roll 6° and pitch 120°):"),
        ({"roll_deg": -180.0, "pitch_deg": -100.0}, "(the same nadir as of roll -180° and pitch -100°)"),
    ],
)  # fmt: skip
def test_errors_are_rotations_also_beyond_a_quarter_turn(given, said, tmp_path):
    record, text = read_chapter("attitude_sensors", tmp_path, **given)
    found = record["results"]["attitude_sensors"]
    assert said in text
    assert found["one_cone"]["error_rad"] < 1e-9
    assert len(found["two_cones_rms"]) == 3
    for errors in found["two_cones_rms"].values():
        # 0.05° on every crossing; the geometry carries it about one to one.
        assert 0.01 < errors["nadir [°]"] < 0.1
        # What is left is about z, and small where the nadir is along it.
        assert np.hypot(errors["roll [°]"], errors["pitch [°]"]) <= errors["nadir [°]"] * (1 + 1e-9)
    assert "nan" not in text


def test_a_scan_beside_the_earth_is_said_not_failed(tmp_path):
    record, text = read_chapter(
        "attitude_sensors", tmp_path, height_km=5000.0, sun_deg=[80.0, 0.0], stars_in_view=0.02
    )
    found = record["results"]["attitude_sensors"]
    assert found["crossings_rad"] == [None, None]
    assert found["accuracy_rad"]["horizon sensor"] is None
    assert (
        "From 5000 km, where the Earth's radius is 34.32°, the scan passes beside the Earth" in text
    )
    assert "One cone gives no attitude: a crossing is missing" in text
    assert "This Sun is refused: a cell is dark" in text
    assert "This Sun is not seen" in text
    assert "No attitude from this image: fewer than two stars" in text
    assert "nan" not in text


def test_from_far_nothing_is_said_of_crossings_and_the_igrf_is_no_reference(tmp_path):
    record, text = read_chapter("attitude_sensors", tmp_path, height_km=35786.0)
    assert record["results"]["attitude_sensors"]["crossings_rad"] == [None, None]
    assert "it fills **0.58 %** of the sky" in text
    assert "At this tilt the cone crosses the limb up to 3,813 km" in text
    assert "the threshold, which is nowhere crossed" in text
    assert "neither scan meets the limb" in text
    for claim in ("1 where the Earth begins", "the threshold crossed", "crossings on both sides"):
        assert claim not in text
    assert "Up to some **13,300 km** the model's error, 0.1 µT" in text
    assert "35786 km is above: there the field is largely that of magnetospheric currents" in text
    assert "The magnetometer's figures hold to 13,2" in text
    assert "nan" not in text


def test_a_scan_that_the_earth_fills(tmp_path):
    given = {"roll_deg": 80.0, "pitch_deg": 0.0, "cone_deg": 30.0}
    _, text = read_chapter("attitude_sensors", tmp_path, **given)
    # The axis is 10° from the nadir: the scan is cut by a limb of 20° to 40°.
    low, high = (INFRARED / np.sin(np.radians(rho)) - RADIUS for rho in (40, 20))
    assert "the Earth fills the scan" in text
    assert f"the cone crosses the limb from {low / 1e3:,.0f} to {high / 1e3:,.0f} km" in text


def test_no_noise_and_no_drift_work(tmp_path):
    none = ("cell_noise", "crossing_noise_deg", "centroid_noise_px", "drift_deg_per_hour",
            "angle_random_walk")  # fmt: skip
    record, text = read_chapter("attitude_sensors", tmp_path, **dict.fromkeys(none, 0.0))
    found = record["results"]["attitude_sensors"]
    assert found["fourth_crossing_gain"] is None
    assert found["one_cone"]["roll_std_rad"] is None
    assert all(way["nadir [°]"] < 1e-9 for way in found["two_cones_rms"].values())
    assert "stars without noise: the attitude comes back to" in text
    assert "every centroid exact" in text
    assert "this is one walk" not in text
    assert "The fourth crossing takes" not in text
    assert "nan" not in text


def test_noise_that_leaves_no_reading(tmp_path):
    given = {"cell_noise": 0.5, "cell_tilt_deg": 70.0, "sun_deg": [10.0, 5.0]}
    record, text = read_chapter("attitude_sensors", tmp_path, **given)
    assert record["results"]["attitude_sensors"]["four_cells_rms_deg"] is None
    assert "the current stays below three times its noise" in text
    assert "of 1000 readings none is accepted: a cell is dark" in text
    assert "nan" not in text


def test_steep_cells_need_no_arcsine(tmp_path):
    given = {"cell_tilt_deg": 85.0, "date": "2040-01-01"}
    record, text = read_chapter("attitude_sensors", tmp_path, **given)
    found = record["results"]["attitude_sensors"]
    assert "the tangent through zero is off by 0.13 %, and would do" in text
    assert "All four are lit from 0.24 % of the sky" in text
    assert "The IGRF holds to 2030, not in 2040: the field along the orbit is left out" in text
    assert found["field_T"] is None
    assert found["star"]["across_arcsec"] > 0
    assert found["accuracy_rad"]["magnetometer"] > 0


def test_the_sun_behind_is_seen_by_none(tmp_path):
    _, text = read_chapter("attitude_sensors", tmp_path, sun_deg=[95.0, -14.0])
    assert "With the Sun 95° from the normal the cell is dark" in text
    assert "This Sun is refused" in text
    assert "This Sun is not seen" in text
    assert "a cell that the light does not reach" in text
    assert "The Sun in the sensor's frame" not in text


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"height_km": 45.0}, "height_km: height is 45 km — give 100 to 400000 km"),
        ({"cone_deg": 0.0}, "cone_deg: half the cone's opening is 0° — give 1 to 90°"),
        ({"sun_deg": [1.0]}, "sun_deg: is [1.0] — give a list of 2"),
        ({"sun_deg": [1.0, 90.0]}, "sun_deg: angle β of the Sun is 90° — give -89 to 89°"),
        ({"cell_noise": -1.0}, "cell_noise: noise of a cell"),
        ({"stars_in_view": 0.0}, "stars_in_view: mean number of stars"),
        ({"date": "soon"}, "date: 'soon' is no time"),
    ],
)
def test_nonsense_is_named(given, said, tmp_path):
    notebook = NOTEBOOKS / "12_attitude_sensors.ipynb"
    outcome = executed(notebook, given, tmp_path)
    assert outcome.status == "failed"
    assert outcome.reason.startswith(f"parameters: {said}")
    assert len(outcome.problems) == 1


def test_from_far_the_choice_is_a_guess(tmp_path):
    record, text = read_chapter(
        "attitude_sensors", tmp_path, height_km=35786.0, cone_deg=85.0, roll_deg=8.0
    )
    found = record["results"]["attitude_sensors"]["one_cone"]
    assert "nearer to the nadir of two" in found["choice"]
    assert abs(found["roll_rad"] - np.radians(8)) > 0.01
    assert "The choice is wrong here" in text
    assert "two cones, four crossings: fewer than three crossings" in text
    assert "the order of the crossings fits both, and nothing in the scan tells which" in text
    assert "crossings of one cone alone, which leave the circle's radius open" in text
    assert "only the scan's order tells" not in text


def test_a_cone_of_90_degrees_decides_nothing(tmp_path):
    record, text = read_chapter("attitude_sensors", tmp_path, cone_deg=90.0)
    assert record["results"]["attitude_sensors"]["two_cones_rms"] == {}
    assert record["results"]["attitude_sensors"]["fourth_crossing_gain"] is None
    assert "two cones, four crossings: the noise hides a tilt towards the scan axis" in text
    assert "both cones are (nearly) the same plane" in text
    assert "fourth crossing makes no difference" not in text
    found = record["results"]["attitude_sensors"]["one_cone"]
    assert (found["roll_rad"], found["pitch_rad"], found["choice"]) == (None, None, "")
    assert (
        "One cone gives no attitude: both solutions fit and neither is nearer to the nadir" in text
    )
    assert "choose a narrower cone, or add a second one" in text
    assert "The choice is wrong" not in text
    assert "nan" not in text
