"""Attitude from images: a small version of the study in benchmarks/camera_study.py, and what has none."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.attitude import attitude_from_image
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import (
    EARTH_CAMERA,
    EARTH_RADIUS,
    HEIGHTS,
    WGS84,
    Scene,
    render,
    texture,
)
from sensorbook.camera.study import draw

CAMERA = Camera(1280, 720, 369.5)  # C, table 4.2
SPHERE = (EARTH_RADIUS,) * 3
LOOKS = {
    "full": {},
    "lambert": {"lit": "lambert"},
    "texture": {"lit": "lambert", "texture": texture(3, rows=256)},
    "oblate with haze": {"lit": "lambert", "semi_axes": WGS84, "haze": 20e3},
}


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


def study(height, look, frames, seed, camera=CAMERA):
    """Errors (frames, 3), rad, and normalised errors squared (frames,) of three numbers."""
    rng = np.random.default_rng(seed)
    errors, squares = [], []
    for _ in range(frames):
        position, sun, attitude = draw(rng, height, camera)
        image = render(camera, Scene(position, sun, **look), attitude, rng)
        found = attitude_from_image(image, camera, position, sun, look.get("semi_axes", SPHERE))
        assert found.status == "ok"
        errors.append(error_vector(found.matrix, attitude))
        squares.append(errors[-1] @ np.linalg.solve(found.covariance, errors[-1]))
    return np.array(errors), np.array(squares)


@pytest.mark.parametrize("look", list(LOOKS))
def test_low_orbit(look):
    errors, squares = study(HEIGHTS["leo"], LOOKS[look], 12, 801)
    limit = 0.06 if look == "oblate with haze" else 0.05  # degrees, the goals of 200 frames
    assert np.degrees(np.linalg.norm(errors, axis=-1)).mean() <= limit
    if look in ("full", "lambert"):
        # Standard errors within a factor of three, from three numbers a frame.
        assert 1 / 9 < np.mean(squares) / 3 < 9


@pytest.mark.parametrize("look", ["full", "lambert"])
def test_geostationary_orbit(look):
    errors, squares = study(HEIGHTS["geo"], LOOKS[look], 8, 802)
    assert np.degrees(np.linalg.norm(errors, axis=-1)).mean() <= 0.04
    assert 1 / 9 < np.mean(squares) / 3 < 9


def test_camera_mounted_as_in_the_two_camera_design():
    """C's matrix, printed to four digits, made a rotation."""
    left, _, right = np.linalg.svd(EARTH_CAMERA)
    camera = Camera(1280, 720, 369.5, to_body=left @ right)
    errors, _ = study(HEIGHTS["meo"], {}, 4, 803, camera)
    assert np.degrees(np.linalg.norm(errors, axis=-1)).max() < 0.05


def test_no_sun():
    place = np.array([EARTH_RADIUS + 2000e3, 0, 0])
    attitude = np.array([[0, 1.0, 0], [0, 0, -1], [-1, 0, 0]])  # looks at the nadir
    sun = np.array([1.0, 0, 0])  # behind the camera
    image = render(CAMERA, Scene(place, sun), attitude, np.random.default_rng(804))
    found = attitude_from_image(image, CAMERA, place, sun)
    assert found.status == "no solution: Sun not in view"
    assert found.matrix is None
    assert found.covariance is None
    assert found.limb.status == "ok"


def test_no_earth():
    place = np.array([EARTH_RADIUS + 2000e3, 0, 0])
    attitude = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])  # looks away from the Earth
    sun = unit([1.0, 0.2, 0.1])
    image = render(CAMERA, Scene(place, sun), attitude, np.random.default_rng(805))
    found = attitude_from_image(image, CAMERA, place, sun)
    assert found.status == "no solution: Earth not in view"
    assert found.sun.status == "ok"


NOISE = np.random.default_rng(806).integers(0, 256, (720, 1280), dtype=np.uint8)


@pytest.mark.parametrize(
    "image", [np.zeros((720, 1280), np.uint8), np.full((720, 1280), 255, np.uint8), NOISE]
)
def test_images_that_show_nothing(image):
    found = attitude_from_image(image, CAMERA, [8371e3, 0, 0], [0, 1, 0])
    assert found.status.startswith("no solution: ")
    assert found.matrix is None


def test_a_small_bright_disc_is_no_earth():
    """The Moon beside the Sun: the Earth's angular radius is known."""
    columns, rows = np.meshgrid(np.arange(1280), np.arange(720))
    image = np.rint(200 * np.clip(30.5 - np.hypot(columns - 500, rows - 300), 0, 1))
    image[np.hypot(columns - 800, rows - 400) < 1.7] = 255
    found = attitude_from_image(image.astype(np.uint8), CAMERA, [8371e3, 0, 0], [0, 1, 0])
    assert found.sun.status == "ok"
    assert re.fullmatch(
        r"no solution: disc of 4\.\d° radius, not the Earth's of 49\.\d° that the position gives",
        found.status,
    )


def turned(vector, towards, angle):
    """A vector turned by an angle, rad, away from another."""
    axis = unit(np.cross(towards, vector))
    return Rotation.from_rotvec(-angle * axis).apply(vector)


def contradicted(change):
    """The status of a good image of a low orbit with another place or Sun than it was taken with."""
    rng = np.random.default_rng(812)
    place, sun, attitude = draw(rng, HEIGHTS["leo"], CAMERA)
    image = render(CAMERA, Scene(place, sun), attitude, rng)
    assert attitude_from_image(image, CAMERA, place, sun).status == "ok"
    found = attitude_from_image(image, CAMERA, *change(place, sun))
    assert found.matrix is None
    return found.status


def test_a_place_or_time_that_the_image_contradicts():
    said = "Earth and Sun are .* apart in the image, .* by time and position: check both"
    assert re.search(said, contradicted(lambda place, sun: (place, turned(sun, place, 0.1))))
    assert re.search(said, contradicted(lambda place, sun: (turned(place, sun, -0.1), sun)))


def test_a_sun_that_cannot_be_seen_from_there():
    behind = contradicted(lambda place, sun: (place, -unit(place)))
    assert behind == "no solution: Sun behind the Earth by time and position"
    down = np.array([0, 0, 1.0])
    rho = np.arcsin(EARTH_RADIUS / 8371e3)
    sun = np.array([np.sin(rho + 0.008), 0, np.cos(rho + 0.008)])  # 0.46° above the ground
    image = render(CAMERA, Scene(-8371e3 * down, sun), np.eye(3), np.random.default_rng(813))
    low = attitude_from_image(image, CAMERA, -8371e3 * down, sun)
    assert low.status == "no solution: Sun too near the Earth's edge"


def test_a_distance_that_the_image_contradicts():
    # ρ = asin(6371/8371) = 49.6°, and asin(6381/12557) = 30.5° for the usual height of haze.
    said = r"disc of 49\.\d° radius, not the Earth's of 30.5° that the position gives"
    assert re.search(said, contradicted(lambda place, sun: (1.5 * place, sun)))


def test_an_array_that_is_no_image():
    with pytest.raises(ValueError, match="image is of uint16: give 8-bit values"):
        attitude_from_image(np.zeros((720, 1280), np.uint16), CAMERA, [8371e3, 0, 0], [0, 1, 0])


@pytest.mark.parametrize(
    ("position", "sun", "message"),
    [
        ([1e6, 0, 0], [0, 1, 0], "position is inside the Earth: give metres from its centre"),
        ([np.nan, 0, 0], [0, 1, 0], "position is inside the Earth"),
        ([8371e3, 0, 0], [0, 2, 0], "sun is no unit vector"),
        ([8371e3, 0, 0], [0, np.nan, 0], "sun is no unit vector"),
    ],
)
def test_places_that_make_no_sense(position, sun, message):
    with pytest.raises(ValueError, match=message):
        attitude_from_image(NOISE, CAMERA, position, sun)
