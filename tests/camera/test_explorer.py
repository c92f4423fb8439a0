"""Work C's simulator as a function: what is set is found again, and what cannot be is said."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook.attitude.rotations import error_vector, matrix_from_euler
from sensorbook.camera.explorer import (
    CAMERAS,
    LOOKS,
    SUN,
    Settings,
    explore,
)
from sensorbook.camera.scene import EARTH_CAMERA, EARTH_RADIUS, HEIGHTS, SUN_DISTANCE
from sensorbook.camera.study import LEAST_ARC, lit_limb_in_view
from sensorbook.camera.visibility import looking_at_both, why_none


def proposed(seed=None, **chosen):
    made = Settings(**chosen)
    return replace(made, angles=looking_at_both(made, seed))


def degrees(vector):
    return float(np.degrees(np.linalg.norm(vector)))


# --- what is set ---


@pytest.mark.parametrize("orbit", list(HEIGHTS))
def test_places_are_those_of_table_4_1(orbit):
    made = Settings(orbit=orbit, place=np.radians(30))
    assert np.linalg.norm(made.position) == pytest.approx(EARTH_RADIUS + HEIGHTS[orbit], rel=1e-12)
    assert np.arctan2(made.position[1], made.position[0]) == pytest.approx(np.radians(30))
    # The Sun as the satellite sees it, not as the Earth does.
    turn = np.linalg.norm(np.cross(made.sun, SUN))
    across = np.linalg.norm(np.cross(made.position, SUN))
    assert turn == pytest.approx(across / SUN_DISTANCE, rel=1e-3)


def test_angles_are_yaw_pitch_and_roll_in_this_order():
    made = Settings(angles=(0.3, -0.2, 0.1))
    assert made.attitude == pytest.approx(matrix_from_euler("ZYX", [0.3, -0.2, 0.1]))


def test_cameras_are_those_of_tables_4_2_and_4_3():
    one, two = Settings(), Settings(cameras=2)
    assert one.earth_camera is one.sun_camera
    assert one.sun_camera.to_body == pytest.approx(np.eye(3))
    assert two.sun_camera.to_body == pytest.approx(np.eye(3))
    # Printed to four digits: the nearest rotation is within their last.
    assert two.earth_camera.to_body == pytest.approx(EARTH_CAMERA, abs=1e-4)
    assert two.earth_camera.to_body @ two.earth_camera.to_body.T == pytest.approx(np.eye(3))
    for camera in (two.earth_camera, two.sun_camera):
        assert (camera.width, camera.height, camera.focal_px) == (1280, 720, 369.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"orbit": "heo"}, "orbit is 'heo': give one of leo, meo, geo"),
        ({"cameras": 3}, "cameras is 3: give one of 1, 2"),
        ({"look": "night"}, "look is 'night': give one of full, lambert, textured"),
        ({"angles": (0, 0)}, "place and the three angles must be finite numbers, rad"),
        ({"place": np.nan}, "place and the three angles must be finite numbers, rad"),
        ({"noise": -1.0}, "noise is -1.0: give 0 DN or more"),
    ],
)
def test_settings_that_make_no_sense(wrong, message):
    with pytest.raises(ValueError, match=message):
        Settings(**wrong)


# --- what is found ---


@pytest.mark.parametrize("orbit", list(HEIGHTS))
@pytest.mark.parametrize("cameras", CAMERAS)
@pytest.mark.parametrize("look", LOOKS)
def test_every_preset_starts_with_both_in_view(orbit, cameras, look):
    seen = explore(proposed(orbit=orbit, cameras=cameras, look=look))
    assert seen.status == "ok"
    # The goal for low orbits; higher ones are better still.
    assert degrees(seen.error) < 0.05
    difference = np.degrees(np.angle(np.exp(1j * (seen.computed - seen.true))))
    assert np.abs(difference).max() < 0.05 / np.cos(seen.true[1])
    if (orbit, cameras) == ("leo", 1):
        # 101° from the Sun the nadir is so far off the axis that the limb is a hyperbola.
        assert np.isnan(seen.ellipse_bias)
        if look == "full":  # C's chain makes an ellipse of it all the same
            assert seen.chain_status == "ok"
            assert degrees(seen.chain_error) > 1
    elif look != "textured":
        assert seen.chain_status == "ok"
        assert degrees(seen.chain_error) > 10 * degrees(seen.error)


@pytest.mark.parametrize("cameras", CAMERAS)
def test_angles_and_errors_are_those_of_the_attitude(cameras):
    seen = explore(proposed(orbit="meo", cameras=cameras))
    true = matrix_from_euler("ZYX", seen.settings.angles)
    assert seen.error == pytest.approx(error_vector(seen.found.matrix, true))
    assert seen.chain_error == pytest.approx(error_vector(seen.chain_matrix, true))
    assert matrix_from_euler("ZYX", seen.true) == pytest.approx(true)
    assert matrix_from_euler("ZYX", seen.computed) == pytest.approx(seen.found.matrix)
    assert matrix_from_euler("ZYX", seen.chain_computed) == pytest.approx(seen.chain_matrix)
    table = seen.to_frame()
    assert list(table.columns) == ["true", "work C's chain", "limb and Sun together"]
    assert table["true"].iloc[:3].to_numpy() == pytest.approx(np.degrees(seen.true), abs=5e-4)
    assert table["limb and Sun together"].iloc[6] == pytest.approx(degrees(seen.error), abs=5e-4)
    assert table["work C's chain"].iloc[3:6].to_numpy() == pytest.approx(
        np.degrees(seen.chain_error), abs=5e-4
    )


def test_two_cameras_take_two_pictures_and_one_takes_one():
    one, two = explore(proposed()), explore(proposed(cameras=2))
    assert one.images[0] is one.images[1]
    assert (two.images[0] != two.images[1]).any()
    assert one.chain[0] is one.chain[1]


def test_the_same_settings_give_the_same_pictures():
    made = proposed(orbit="geo")
    first, again = explore(made), explore(made)
    assert (first.images[0] == again.images[0]).all()
    assert (first.found.matrix == again.found.matrix).all()
    other = explore(replace(made, seed=2))
    assert (first.images[0] != other.images[0]).any()


# --- the centre of the ellipse ---


def test_chain_errs_by_the_ellipses_centre():
    # The limb from Sun to night: where most of it is in view the fit is the true ellipse.
    seen = explore(proposed(orbit="leo", cameras=2))
    assert np.degrees(seen.ellipse_bias) > 5
    assert seen.chain_centre_error == pytest.approx(seen.ellipse_bias, rel=0.03)
    assert np.degrees(seen.centre_error) < 0.1


# --- angles that show both ---


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(list(HEIGHTS)),
    st.floats(0, 2 * np.pi),
    st.sampled_from(CAMERAS),
    st.integers(0, 2**32 - 1),
)
def test_proposed_angles_show_both(orbit, place, cameras, seed):
    made = Settings(orbit=orbit, place=place, cameras=cameras, look="lambert")
    angles = looking_at_both(made, seed)
    if angles is None:
        return
    made = replace(made, angles=angles)
    assert np.degrees(angles) == pytest.approx(np.round(np.degrees(angles)), abs=1e-9)
    assert made.sun_camera.sees(made.sun_camera.to_body.T @ made.attitude @ made.sun, 10)
    to_camera = made.earth_camera.to_body.T @ made.attitude
    # Judged by points 4° apart here and 1° apart there.
    assert lit_limb_in_view(made.position, made.sun, to_camera, made.earth_camera) >= LEAST_ARC


@pytest.mark.parametrize(("place", "goal"), [(90, 0.05), (95, 0.05), (100, 0.5), (102, 0.5)])
def test_a_bright_earth_with_the_sun_near_its_limb_has_attitudes(place, goal):
    # The Sun is 9° to 2° above the limb: under Lambert's shading a crescent too thin to be seen. The arc
    # that faces the Sun shrinks to 40°, and tells less.
    seen = explore(proposed(place=np.radians(place), cameras=2))
    assert seen.status == "ok"
    assert degrees(seen.error) < goal
    # 3 degrees of freedom: one in ten thousand is above 21.
    assert seen.error @ np.linalg.solve(seen.found.covariance, seen.error) < 21
    assert looking_at_both(Settings(place=np.radians(place), cameras=2, look="lambert")) is None


def test_both_found_and_no_attitude_is_told_why():
    made = proposed(cameras=2)
    found = replace(explore(made).found, matrix=None, status="no solution: both lie in one line")
    assert why_none(made, found) == f"Both lie in one line. {TURN}"


def test_proposals_by_seed_are_many():
    made = Settings(orbit="meo")
    assert len({looking_at_both(made, seed) for seed in range(8)}) == 8
    assert looking_at_both(made, 3) == looking_at_both(made, 3)


# --- what has no solution ---


def sunward(turn):
    """A low orbit, the camera's axis `turn` (degrees) from the Sun about the direction across it."""
    made = Settings()
    down = -made.position / np.linalg.norm(made.position)
    side = np.cross(made.sun, down)
    side /= np.linalg.norm(side)
    away = np.cross(side, made.sun)
    axis = np.cos(np.radians(turn)) * made.sun + np.sin(np.radians(turn)) * away
    matrix = np.array([np.cross(side, axis), side, axis])
    yaw = np.arctan2(matrix[0, 1], matrix[0, 0])
    pitch = -np.arcsin(matrix[0, 2])
    roll = np.arctan2(matrix[1, 2], matrix[2, 2])
    return replace(made, angles=(yaw, pitch, roll))


TURN = "Turn the satellite: other attitudes show both from here."


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (sunward(70), f"The Sun is out of the camera's view, 70° from its axis. {TURN}"),
        (sunward(-60), f"No part of the Earth is in the camera's view. {TURN}"),
        (
            Settings(place=np.radians(135)),
            "The Earth hides the Sun: the satellite is in its shadow. "
            "Move the satellite along its orbit: no attitude shows both from here, as the Sun is "
            "behind the Earth or at its limb.",
        ),
        (
            Settings(place=np.radians(100), look="lambert"),
            "as the Sun is 3° above the limb and lights but a thin crescent.",
        ),
        (
            Settings(orbit="geo", place=np.radians(315)),
            "as the Sun is 129° from the limb, more than the cameras' views span.",
        ),
    ],
)
def test_what_has_no_solution_is_said(made, expected):
    seen = explore(made)
    assert expected in seen.status
    assert np.isnan(seen.error).all()
    assert np.isnan(seen.computed).all()
    assert "<th>limb and Sun together</th>" in seen._repr_html_()
    assert expected.replace("'", "&#x27;") in seen._repr_html_()


def test_what_drowns_in_noise_is_said():
    seen = explore(replace(proposed(cameras=2), noise=60.0))
    assert seen.status == (
        "The Sun is in the Sun camera's view, but not told from the rest of the picture. "
        "Lower the noise, or turn the satellite."
    )


def test_chain_without_a_sun_says_so():
    seen = explore(sunward(70))
    assert seen.chain_matrix is None
    assert "No Sun: the brightest pixel has" in seen.chain_status
    assert np.isnan(seen.chain_error).all()


def test_what_the_chain_takes_for_the_sun():
    seen = explore(proposed(cameras=2))
    # The centre of gravity of a disc of three pixels, 0.16° each.
    assert np.degrees(seen.chain_sun_error) < 0.1
    assert seen.chain_doubt == ""
    # Any pixel that is white by chance, in this noise.
    loud = explore(replace(proposed(cameras=2), noise=60.0))
    away = loud.settings.sun_camera.to_body.T @ loud.settings.attitude @ loud.settings.sun
    taken = loud.chain[1].sun_direction
    assert loud.chain_sun_error == pytest.approx(np.arccos(taken @ away))
    assert loud.chain_sun_error > np.radians(2)
    said = f"takes for the Sun is {np.degrees(loud.chain_sun_error):.0f}° from it"
    assert (said in loud.chain_doubt) == (loud.chain_status == "ok")
    assert loud.chain_doubt.replace("'", "&#x27;") in loud._repr_html_()


def test_near_the_lock_the_angles_are_said_to_be_weak():
    assert explore(Settings(angles=(0.1, np.radians(89), 0.2))).locked
    seen = explore(Settings(angles=(0.1, np.radians(60), 0.2)))
    assert not seen.locked
    assert "pitch" not in seen._repr_html_().replace("<th>pitch [°]</th>", "")


def test_the_shown_table_has_three_places_and_true_minus_signs():
    shown = explore(Settings(angles=(-0.1, 0.2, 0.3)))._repr_html_()
    assert "<td>−5.730</td>" in shown
    assert ">-" not in shown
