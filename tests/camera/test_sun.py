"""The Sun in rendered images: found to a tenth of a pixel, and told from what is not the Sun."""

import cv2
import numpy as np
import pytest

from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, Scene, render
from sensorbook.camera.sun import find_sun

CAMERA = Camera(640, 480, 369.5)  # the middle of C's camera: its pixels, fewer of them
DISTANCE = EARTH_RADIUS + 2000e3


def image_of(pixel, noise, rng, nadir=(0, 0, -1.0)):
    """An image with the Sun at a pixel; the Earth, fully lit, at a direction, behind where left out."""
    scene = Scene(-DISTANCE * np.asarray(nadir), CAMERA.rays(pixel), noise=noise)
    return render(CAMERA, scene, np.eye(3), rng)


def places(count, seed, kind):
    """Pixels (count, 2) and nadirs (count, 3): anywhere, next to the image's edge, above the limb."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([20, 20], [620, 460], (count, 2))
    nadirs = np.tile([0, 0, -1.0], (count, 1))
    if kind == "edge":
        side = rng.integers(0, 4, count)
        pixels[side == 0, 0], pixels[side == 1, 0] = 6.3, 632.8
        pixels[side == 2, 1], pixels[side == 3, 1] = 6.3, 472.8
    if kind == "ground":  # the limb 12 pixels away
        pixels = rng.uniform([200, 150], [440, 330], (count, 2))
        suns = CAMERA.rays(pixels)
        sides = np.cross(suns, rng.normal(size=(count, 3)))
        sides /= np.linalg.norm(sides, axis=-1, keepdims=True)
        away = np.arcsin(EARTH_RADIUS / DISTANCE) + 12 / 369.5
        nadirs = np.cos(away) * suns + np.sin(away) * sides
    return pixels, nadirs


@pytest.mark.parametrize("noise", [2.0, 6.0])
@pytest.mark.parametrize("kind", ["anywhere", "edge", "ground"])
def test_found_to_a_tenth_of_a_pixel(kind, noise):
    rng = np.random.default_rng(42)
    off, squares = [], []
    for pixel, nadir in zip(*places(30, 43, kind), strict=True):
        found = find_sun(image_of(pixel, noise, rng, nadir), CAMERA)
        assert found.status == "ok"
        off.append(found.pixel - pixel)
        error = found.direction - CAMERA.rays(pixel)
        squares.append(error @ error / found.std**2 / 2)
    assert np.abs(off).max() < 0.1
    # The standard error is stated for the whole image, for Suns of one to five pixels: a factor of four.
    assert 1 / 16 < np.mean(squares) < 4


def test_no_sun():
    rng = np.random.default_rng(44)
    scene = Scene(DISTANCE * np.array([0, 0, -1.0]), np.array([0, 0, -1.0]))
    image = render(CAMERA, scene, np.eye(3), rng)  # the Earth fills the image, the Sun is behind
    assert image.min() > 150
    for grey in (image, np.zeros_like(image), np.full_like(image, 255)):
        found = find_sun(grey, CAMERA)
        assert found.status == "Sun not in view"
        assert found.pixel is None
        assert found.direction is None
        assert found.std is None


def test_hidden_by_the_earth():
    image = image_of([320, 240], 2.0, np.random.default_rng(45), nadir=CAMERA.rays([300, 200]))
    assert find_sun(image, CAMERA).status == "Sun not in view"


@pytest.mark.parametrize("pixel", [(-0.4, 200), (639.6, 100), (300, -0.2), (300, 479.3)])
def test_cut_by_the_edge(pixel):
    """Its middle would be pulled inward."""
    found = find_sun(image_of(pixel, 2.0, np.random.default_rng(46)), CAMERA)
    assert found.status == "Sun cut by the edge of the image"
    assert found.pixel is None


def test_hot_pixels_are_not_the_sun():
    """A cosmic ray or a defect lights one pixel; the Sun lights all that its disc covers."""
    rng = np.random.default_rng(47)
    image = image_of([-500, 240], 2.0, rng)
    rows, columns = rng.integers(10, 470, 20), rng.integers(10, 630, 20)
    image[rows, columns] = 255
    assert find_sun(image, CAMERA).status == "Sun not in view"
    image = image_of([412.3, 99.8], 2.0, rng)
    image[rows, columns] = 255
    np.testing.assert_allclose(find_sun(image, CAMERA).pixel, [412.3, 99.8], rtol=0, atol=0.1)


def test_a_bright_disc_larger_than_the_sun():
    """The overexposed Moon is as large as the Sun: only what is clearly larger can be told."""
    x, y = np.meshgrid(np.arange(640), np.arange(480))
    image = np.where(np.hypot(x - 300, y - 200) < 12, 255, 0).astype(np.uint8)
    assert find_sun(image, CAMERA).status == "Sun not in view"


@pytest.mark.parametrize("seed", range(48, 56))
def test_white_noise_holds_no_sun(seed):
    image = np.random.default_rng(seed).integers(0, 256, (480, 640), dtype=np.uint8)
    assert find_sun(image, CAMERA).status in (
        "Sun not in view",
        "Sun not told from other bright spots",
    )


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((480, 640), np.uint16), "image is of uint16: give 8-bit values"),
        (np.zeros((480, 640, 3), np.uint8), "give one grey channel"),
        (np.zeros((48, 64), np.uint8), "image is 64 × 48 pixels, its camera 640 × 480"),
    ],
)
def test_arrays_that_are_no_image(image, message):
    with pytest.raises(ValueError, match=message):
        find_sun(image, CAMERA)


@pytest.mark.parametrize("brightness", [2e4, 1e6])
@pytest.mark.parametrize("blur", [0.7, 1.0, 1.5])
def test_a_sun_that_overfills_its_pixels(brightness, blur):
    """A real Sun is some 10⁵ times as bright as lit ground: its halo saturates too, and is round."""
    rng = np.random.default_rng(49)
    columns, rows = np.meshgrid(np.arange(640 * 4), np.arange(480 * 4))
    disc = np.hypot(columns / 4 - 401.3, rows / 4 - 200.6) < 1.7
    light = cv2.resize(disc.astype(float), (640, 480), interpolation=cv2.INTER_AREA)
    light = cv2.GaussianBlur(brightness * light, (25, 25), blur) + 2 * rng.normal(size=(480, 640))
    found = find_sun(np.clip(np.rint(light), 0, 255).astype(np.uint8), CAMERA)
    # Cells of a quarter of a pixel: centres are 3/8 of a cell back.
    np.testing.assert_allclose(found.pixel, [401.3 - 0.375, 200.6 - 0.375], rtol=0, atol=0.3)
    assert found.std == pytest.approx(0.1 / 369.5)
