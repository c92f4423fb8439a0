"""Figures of a camera's image: what is drawn lies where it was found."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.camera.baseline import baseline
from sensorbook.camera.explorer import Settings, explore
from sensorbook.camera.limb import find_limb
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS, Scene, render
from sensorbook.camera.sun import find_sun
from sensorbook.camera.visibility import looking_at_both
from sensorbook.plots import camera as plots

WIDE = Camera(1280, 720, 369.5)  # C, table 4.2
LARGE = Camera(5000, 3000, 2500.0, distortion=(-0.2, 0.05, 0.001, -0.001))
RADIUS = {name: np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + h)) for name, h in HEIGHTS.items()}


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


SUN = unit([-0.75, -0.45, 1])


def seen(orbit, down, camera=WIDE):
    place = -unit(down) * (EARTH_RADIUS + HEIGHTS[orbit])
    return render(camera, Scene(place, SUN), np.eye(3), np.random.default_rng(901))


def line(axes, label):
    return next(one for one in axes.lines if one.get_label() == label)


def labels(axes):
    return {text.get_text() for text in axes.get_legend().get_texts()}


def inside(pixels, camera):
    return ((pixels >= -0.5) & (pixels <= [camera.width - 0.5, camera.height - 0.5])).all(axis=-1)


@pytest.mark.parametrize("camera", [WIDE, LARGE], ids=["wide", "distorted"])
@pytest.mark.parametrize("down", [[0, 0, 1], [0.5, 0.3, 1], [1, 0.6, 0.2]])
def test_limb_curve_is_the_cone_inside_the_image(camera, down):
    curve = plots.limb_curve(down, RADIUS["leo"], camera)
    drawn = curve[np.isfinite(curve).all(axis=-1)]
    assert len(drawn) > 100
    assert inside(drawn, camera).all()
    # Undistorting is iterated to 1e-14; pixels are of order 1000.
    assert camera.rays(drawn) @ unit(down) == pytest.approx(np.cos(RADIUS["leo"]), abs=1e-9)
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=-1)
    # Off the axis the tangent stretches a step of two pixels.
    assert np.nanmax(steps) < 15
    assert np.isnan(curve).any() or down == [0, 0, 1]


def test_limb_curve_behind_the_camera_is_nowhere():
    assert np.isnan(plots.limb_curve([0, 0, -1], 0.5, WIDE)).all()


def test_view_of_what_was_found():
    image = seen("leo", [0.34, 0.25, 0.9])
    sun = find_sun(image, WIDE)
    limb = find_limb(image, WIDE, sun.direction)
    true = plots.limb_curve([0.34, 0.25, 0.9], RADIUS["leo"], WIDE)
    axes = plots.plot_view(image, WIDE, limb, sun, true)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [px]", "y [px]")
    assert axes.images[0].get_extent() == [-0.5, 1279.5, 719.5, -0.5]
    expected = {"true limb", "edge points used", "fitted limb", "Earth's centre", "Sun's centre"}
    assert labels(axes) == expected
    centre = np.ravel(line(axes, "Earth's centre").get_data())
    # The limb's direction is within 0.05° of the true one: 0.4 px here.
    assert centre == pytest.approx(WIDE.project([0.34, 0.25, 0.9]), abs=0.5)
    assert np.ravel(line(axes, "Sun's centre").get_data()) == pytest.approx(
        WIDE.project(SUN), abs=0.1
    )
    shown = np.transpose(line(axes, "edge points used").get_data())
    assert 100 < len(shown) <= plots.MOST_POINTS
    assert {tuple(p) for p in shown} <= {tuple(p) for p in limb.pixels[limb.used]}
    colours = [line(axes, name).get_color() for name in ("edge points used", "fitted limb")]
    assert colours == [plots.EDGE, plots.CURVE]


@pytest.mark.parametrize("down", [[1, 0.6, 0.5], [1, 0.6, -0.1]], ids=["ahead", "behind"])
def test_centre_out_of_the_image_is_an_arrow(down):
    image = seen("leo", down)
    limb = find_limb(image, WIDE)
    axes = plots.plot_view(image, WIDE, limb)
    assert "Earth's centre, out of the image" in labels(axes)
    (arrow,) = axes.texts
    tip, tail = np.array(arrow.xy), np.array(arrow.xyann)
    assert inside(tip, WIDE)
    assert tip[0] == pytest.approx(1279) or tip[1] == pytest.approx(719), "at the border"
    assert unit(tip - tail) == pytest.approx(unit(down[:2]), abs=0.01)


def test_nothing_found_is_nothing_drawn():
    image = np.zeros((720, 1280), np.uint8)
    axes = plots.plot_view(image, WIDE, find_limb(image, WIDE), find_sun(image, WIDE))
    assert not axes.lines
    assert axes.get_legend() is None
    axes = plots.plot_baseline(image, WIDE, baseline(image, WIDE))
    assert not axes.lines


def test_a_large_image_is_drawn_smaller_in_its_own_pixels():
    image = np.zeros((LARGE.height, LARGE.width), np.uint8)
    axes = plots.plot_view(image, LARGE)
    assert axes.images[0].get_array().shape == (960, plots.MOST_COLUMNS)
    assert axes.images[0].get_extent() == [-0.5, 4999.5, 2999.5, -0.5]


def test_baseline_and_its_centre():
    image = seen("leo", [0.34, 0.25, 0.9])
    found = baseline(image, WIDE)
    axes = plots.plot_baseline(image, WIDE, found, legend=False)
    assert axes.get_legend() is None
    centre = np.ravel(line(axes, "ellipse's centre").get_data())
    assert centre == pytest.approx(found.ellipse.centre)
    ellipse = np.transpose(line(axes, "fitted ellipse").get_data())
    drawn = ellipse[np.isfinite(ellipse).all(axis=-1)]
    assert inside(drawn, WIDE).all()
    assert found.ellipse.distance(drawn).max() < 1e-6


def test_another_cameras_image_is_named():
    with pytest.raises(ValueError, match="image is 100 × 50 pixels, its camera 1280 × 720"):
        plots.plot_view(np.zeros((50, 100), np.uint8), WIDE)


# --- a scene ---


def scene(**chosen):
    made = Settings(**chosen)
    return explore(replace(made, angles=looking_at_both(made)))


def test_scene_of_one_camera():
    seen = scene(orbit="meo")
    ((chain, ours),) = plots.plot_scene(seen)
    assert [a.get_title() for a in (chain, ours)] == [
        "camera, work C's chain",
        "camera, limb and Sun together",
    ]
    true = WIDE.project(seen.settings.attitude @ -seen.settings.position)
    for axes in (chain, ours):
        assert np.ravel(line(axes, "Earth's true centre").get_data()) == pytest.approx(true)
    off = [
        np.linalg.norm(np.ravel(line(axes, name).get_data()) - true)
        for axes, name in ((chain, "ellipse's centre"), (ours, "Earth's centre"))
    ]
    # Pixels: the ellipse's centre is degrees off, the cone's hundredths.
    assert off[0] > 5
    assert off[1] < 0.3


def test_scene_of_two_cameras_has_earth_above_and_sun_below():
    seen = scene(cameras=2)
    grid = plots.plot_scene(seen)
    assert grid.shape == (2, 2)
    for axes in grid[0]:
        assert "Sun's centre" not in axes.get_legend_handles_labels()[1]
    for axes in grid[1]:
        assert axes.get_legend_handles_labels()[1] == ["Sun's centre"]
    assert (grid[0, 0].images[0].get_array() == seen.images[0]).all()
    assert (grid[1, 1].images[0].get_array() == seen.images[1]).all()
    (legend,) = grid[0, 0].figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == len(set(names)) == 7


def test_scene_in_which_nothing_is_found_is_drawn():
    grid = plots.plot_scene(explore(Settings(orbit="geo")))
    assert not grid[0, 0].figure.legends


def test_scene_as_a_picture_leaves_no_figure_open():
    assert plots.scene_png(scene(orbit="geo")).startswith(b"\x89PNG")
    assert not plt.get_fignums()
