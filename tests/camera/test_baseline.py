"""Work C's chain on discs drawn here, and on images that show none."""

import numpy as np
import pytest
from scipy.ndimage import label, median_filter

from sensorbook.camera.baseline import baseline
from sensorbook.camera.model import Camera

CAMERA = Camera(width=400, height=300, focal_px=200.0)
X, Y = np.meshgrid(np.arange(400.0), np.arange(300.0))


def disc(x, y, radius, level=200.0):
    """(300, 400) grey levels of a disc, a pixel at its edge by the part covered."""
    return level * np.clip(radius - np.hypot(X - x, Y - y) + 0.5, 0, 1)


def image_of(*parts, noise=0.0, seed=301):
    """uint8 of the brightest of the parts at each pixel, with `noise`, grey levels."""
    grey = np.max(parts, axis=0) + noise * np.random.default_rng(seed).normal(size=X.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def pinhole(x, y):
    """(4.4), from C."""
    v = np.array([x - 199.5, y - 149.5, 200.0])
    return v / np.linalg.norm(v)


def degrees_between(u, v):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize(
    ("x", "y", "radius", "tolerance"),
    [(200, 150, 100, 0.3), (230.3, 140.7, 80, 0.3), (60, 80, 150, 2.0), (350, 400, 220, 20.0)],
)
def test_a_disc_and_the_sun(x, y, radius, tolerance, noise):
    """Whole, cut by the image's edge, and a fifth of the outline in view."""
    found = baseline(image_of(disc(x, y, radius), disc(390.4, 5.2, 2, 255), noise=noise), CAMERA)
    assert found.status == "ok"
    # Edges are whole pixels, ±0.3 px each, and the median bends the limb at the image's edge. 75° of
    # outline dilute both some fifty times as much as all of it.
    np.testing.assert_allclose(found.ellipse.centre, [x, y], rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.ellipse.semi_axes, radius, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.earth_direction, pinhole(*found.ellipse.centre), atol=1e-14)
    assert degrees_between(found.sun_direction, pinhole(390.4, 5.2)) < 0.1  # a third of a pixel


def test_the_suns_blob_is_that_of_the_raw_image():
    """A Sun three pixels wide, which the median takes away."""
    found = baseline(image_of(disc(150, 150, 80), disc(300, 40, 1.5, 255)), CAMERA)
    assert found.filtered[30:50, 290:310].max() == 0
    np.testing.assert_allclose(found.sun_direction, pinhole(300, 40), atol=1e-14)
    assert found.filtered[150, 150] == 200


def test_each_step_is_what_it_says():
    image = image_of(disc(180, 140, 90), noise=8)
    found = baseline(image, CAMERA)
    np.testing.assert_array_equal(found.filtered, median_filter(image, 7, mode="nearest"))
    assert found.edges.shape == image.shape
    assert found.edges.dtype == bool
    sets, count = label(found.edges, np.ones((3, 3)))
    sizes = np.bincount(sets.ravel())[1:]
    assert len(found.chain) == sizes.max()
    x, y = found.chain.astype(int).T
    assert found.edges[y, x].all()
    assert len(np.unique(sets[y, x])) == 1
    assert count >= 1
    # A circle's outline takes 4√2 r pixels where steps are diagonal, 8 r where none are.
    assert 4 * np.sqrt(2) * 90 < len(found.chain) < 8 * 90


def test_the_largest_set_of_edges_is_kept():
    found = baseline(image_of(disc(120, 150, 70), disc(320, 150, 40, 240)), CAMERA)
    np.testing.assert_allclose(found.ellipse.centre, [120, 150], atol=0.3)
    assert (found.edges.sum() - len(found.chain)) > 150
    assert found.sun_direction is None
    assert found.status == "No Sun: the brightest pixel has 240 of 255, below 250."


def test_the_ellipses_centre_is_not_the_earths():
    """A sphere 25° in radius, 20° off the axis: its outline's middle is at half the sum of the tangents."""
    axis, radius = np.radians(20), np.radians(25)
    earth = np.array([np.sin(axis), 0, np.cos(axis)])
    parts = (np.arange(4) + 0.5) / 4 - 0.5
    covered = np.zeros_like(X)
    for dx in parts:
        for dy in parts:
            v = np.stack([X + dx - 199.5, Y + dy - 149.5, np.full_like(X, 200.0)], axis=-1)
            covered += v @ earth > np.cos(radius) * np.linalg.norm(v, axis=-1)
    found = baseline(image_of(200 * covered / 16), CAMERA)
    tangent = (np.tan(axis + radius) + np.tan(axis - radius)) / 2
    middle = np.array([tangent, 0, 1]) / np.hypot(tangent, 1)
    # Pixels of 0.3°, hundreds of them; a part of the outline is out of the image.
    assert degrees_between(found.earth_direction, middle) < 0.3
    assert degrees_between(found.earth_direction, earth) == pytest.approx(4.5, abs=0.3)


def test_of_a_hyperbola_it_makes_an_ellipse_all_the_same():
    """A low orbit's limb, seen far to the side, is open: C's chain has an answer, and it is nothing."""
    # (x − 100)² / 60² − (y − 150)² / 60² = 1, its right branch; ground on the right.
    inside = 200 * np.clip(X - 100 - np.hypot(60, Y - 150) + 0.5, 0, 1)
    found = baseline(image_of(inside), CAMERA)
    assert len(found.chain) > 250
    assert found.ellipse.centre[0] > 1000  # of an image 400 pixels wide
    assert found.status == "No Sun: the brightest pixel has 200 of 255, below 250."


@pytest.mark.parametrize(
    ("image", "status"),
    [
        (np.zeros((300, 400), np.uint8), "No Earth: The image has no edge. No Sun: the brightest pixel "
         "has 0 of 255, below 250."),
        (np.full((300, 400), 255, np.uint8), "No Earth: The image has no edge."),
        (image_of(np.where(X < 200, 180.0, 0)), "No Earth: The 300 points lie on a straight line: they "
         "spread by 86.6 along and by 0 across. No Sun: the brightest pixel has 180 of 255, below 250."),
        (image_of(disc(300, 40, 1.5, 255)), "No Earth: The image has no edge."),
    ],
    ids=["black", "white", "straight edge", "Sun alone"],
)  # fmt: skip
def test_images_without_an_earth(image, status):
    found = baseline(image, CAMERA)
    assert found.status == status
    assert found.ellipse is None
    assert found.earth_direction is None
    assert (found.sun_direction is None) == ("No Sun" in status)
    assert found.chain.shape[1] == 2


@pytest.mark.parametrize("seed", range(20))
def test_noise_gives_words_or_directions(seed):
    rng = np.random.default_rng([302, seed])
    grey = rng.normal(128, rng.choice([5, 40, 200]), (300, 400))
    found = baseline(np.clip(grey, 0, 255).astype(np.uint8), CAMERA)
    assert (found.status == "ok") == (
        found.earth_direction is not None and found.sun_direction is not None
    )
    assert (found.earth_direction is None) == ("No Earth: " in found.status)
    for direction in (found.earth_direction, found.sun_direction):
        if direction is not None:
            assert np.linalg.norm(direction) == pytest.approx(1)


def test_a_view_of_an_array_will_do():
    image = image_of(disc(150, 150, 80))
    flipped = baseline(image[:, ::-1], CAMERA)
    np.testing.assert_allclose(flipped.ellipse.centre, [249, 150], atol=0.3)


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.zeros((300, 400)), r"not float64 of shape \(300, 400\)"),
        (np.zeros((300, 400, 3), np.uint8), r"not uint8 of shape \(300, 400, 3\)"),
        (np.zeros((400, 300), np.uint8), r"not uint8 of shape \(400, 300\)"),
    ],
)
def test_other_images_are_errors(image, said):
    with pytest.raises(ValueError, match=r"image must be uint8 of shape \(300, 400\), " + said):
        baseline(image, CAMERA)
