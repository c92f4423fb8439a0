"""The chapter on attitude sensors: its numbers, and sentences that follow its parameters."""

import numpy as np
import pytest
from devices import read_chapter

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
    assert "**10,313** for 3° × 4°" in text
    assert "only **35 %** of the time" in text
    assert "Warning" not in text


def test_a_scan_beside_the_earth_is_said_not_failed(tmp_path):
    record, text = read_chapter(
        "attitude_sensors", tmp_path, height_km=5000.0, sun_deg=[80.0, 0.0], stars_in_view=0.2
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


def test_from_far_the_choice_is_a_guess(tmp_path):
    record, text = read_chapter(
        "attitude_sensors", tmp_path, height_km=35786.0, cone_deg=85.0, roll_deg=8.0
    )
    found = record["results"]["attitude_sensors"]["one_cone"]
    assert "nearer to the nadir of two" in found["choice"]
    assert abs(found["roll_rad"] - np.radians(8)) > 0.01
    assert "The choice is wrong here" in text
    assert "two cones, four crossings: fewer than three crossings" in text


def test_a_cone_of_90_degrees_decides_nothing(tmp_path):
    record, text = read_chapter("attitude_sensors", tmp_path, cone_deg=90.0)
    found = record["results"]["attitude_sensors"]["one_cone"]
    assert (found["roll_rad"], found["pitch_rad"], found["choice"]) == (None, None, "")
    assert (
        "One cone gives no attitude: both solutions fit and neither is nearer to the nadir" in text
    )
    assert "choose a narrower cone, or add a second one" in text
    assert "The choice is wrong" not in text
    assert "nan" not in text
