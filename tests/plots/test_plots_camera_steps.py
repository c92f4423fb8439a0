"""Figures of an image's steps: what is drawn is what was found."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from cameras import ONE, recording, shot, write

import sensorbook
from sensorbook.camera.model import Camera
from sensorbook.camera.steps import centre_bias, take_steps
from sensorbook.camera.survey import survey
from sensorbook.plots import camera_steps as plots

BLACK = np.zeros((360, 640), np.uint8)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    images = {"a.png": shot(0).image(), "b.png": BLACK, "c$x_1$.png": b"broken"}
    folder = write(
        tmp_path_factory.mktemp("plots") / "one",
        [recording("*.png")],
        images,
        [shot(0).row("a.png")],
    )
    return survey(sensorbook.load(folder).runs("camera", "images"))


@pytest.fixture(scope="module")
def steps(found):
    return take_steps(found.earth, found.sun)


def drawn(axes, label):
    return next(line for line in axes.lines if line.get_label() == label).get_xydata()


def labels(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_pictures_side_by_side(steps):
    row = plots.plot_pictures({"one": steps.earth_image, "edges": steps.chain.edges}, ONE)
    assert [axes.get_title() for axes in row] == ["one", "edges"]
    shown = row[0].images[0].get_array()
    assert shown.shape == (360, 640)
    assert 0 <= (steps.earth_image - shown).min() <= (steps.earth_image - shown).max() < 4
    assert set(np.unique(row[1].images[0].get_array())) <= {0, 252}
    row[0].figure.canvas.draw()


def test_large_pictures_are_drawn_no_finer_than_the_page():
    camera = Camera(5000, 3000, 2500.0)
    (axes,) = plots.plot_pictures({"large": np.zeros((3000, 5000), np.uint8)}, camera)
    assert axes.images[0].get_array().shape == (960, 1600)
    assert axes.images[0].get_extent() == [-0.5, 4999.5, 2999.5, -0.5]


def test_edges_kept_and_rejected(steps):
    limb = steps.limb
    axes = plots.plot_edges(steps.earth_image, limb, ONE)
    kept, rejected = int(limb.used.sum()), int((~limb.used).sum())
    assert labels(axes) == [f"{kept} kept", f"{rejected} rejected"]
    np.testing.assert_array_equal(drawn(axes, f"{kept} kept"), limb.pixels[limb.used])
    axes.figure.canvas.draw()


def test_the_chain_s_edges(steps):
    row = plots.plot_chain(steps.chain, ONE)
    largest = row[1].images[0].get_array() > 0
    x, y = steps.chain.chain.astype(int).T
    assert largest[y, x].all()
    assert largest.sum() == len(x)


def test_profile(steps):
    axes = plots.plot_profile(
        steps.earth_image, steps.limb, ONE, int(np.flatnonzero(steps.limb.used)[0])
    )
    assert labels(axes) == ["between pixels (bilinear)", "± 2 standard errors", "the edge's place"]
    points = axes.lines[1].get_xydata()
    np.testing.assert_array_equal(points[:, 0], np.arange(-14, 9))


def test_cone(steps):
    above, below = plots.plot_cone(steps.limb, None, ONE)
    rho = np.degrees(steps.limb.angular_radius)
    angles = drawn(above, "from the cone's axis n")[:, 1]
    assert len(angles) == steps.limb.used.sum()
    assert np.abs(angles - rho).max() < 1
    np.testing.assert_allclose(drawn(below, "kept")[:, 1], steps.limb.residuals[steps.limb.used])
    above.figure.canvas.draw()


def test_cone_beside_an_ellipse_s_centre(steps):
    class Chain:
        earth_direction = np.array([0, 0, 1.0])

    above, _ = plots.plot_cone(steps.limb, Chain(), ONE)
    off = drawn(above, "from C's ellipse centre")[:, 1]
    assert off == pytest.approx(np.degrees(np.arccos(steps.limb.rays[steps.limb.used][:, 2])))


def test_the_sun_and_its_median(steps):
    axes = plots.plot_sun(steps.sun_image, steps.sun.sun)
    np.testing.assert_array_equal(drawn(axes, "middle of the disc"), [steps.sun.sun.pixel])
    for axes in plots.plot_median(
        steps.sun_image, steps.sun_filtered, steps.sun.sun.pixel, reach=9
    ):
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert (right - left, low - high) == (19, 19)
        assert left < steps.sun.sun.pixel[0] < right


def test_the_bias_of_the_centre():
    off, radius = np.radians([20, 30])
    axes = plots.plot_centre_bias(off, radius)
    assert labels(axes) == [
        "this image, ρ = 30.0°",
        "C's LEO",
        "C's MEO",
        "C's GEO",
        "its θ = 20.0°",
    ]
    curve = drawn(axes, "this image, ρ = 30.0°")
    at = np.degrees(centre_bias(off, radius))
    assert np.interp(20, *curve.T) == pytest.approx(at, rel=1e-3)
    assert curve[-1, 0] == pytest.approx(60, abs=0.01)


def test_gallery(found):
    axes = plots.plot_gallery(found.gallery()).flat
    titles = [one.get_title() for one in axes]
    assert titles[:2] == ["a.png\nok", "b.png\nSun not in view, Earth not in view"]
    axes[0].figure.canvas.draw()
    # A name that looks like mathematics is none, and a picture that cannot be read is black.
    (only,) = plots.plot_gallery([found.frames[2]]).flat
    assert only.get_title().startswith("c$x_1$.png\nfile cannot be read as an image")
    assert only.images[0].get_array().max() == 0
    only.figure.canvas.draw()


def test_a_small_earth_is_shown_enlarged(found):
    frame = found.frames[0]
    (axes,) = plots.plot_gallery([frame]).flat
    assert axes.child_axes == []
    to_earth = np.array([0.1, 0.05, 1.0]) / np.linalg.norm([0.1, 0.05, 1.0])
    far = replace(frame.limb, direction=to_earth, angular_radius=np.radians(5.0))
    (axes,) = plots.plot_gallery([replace(frame, limb=far)]).flat
    (inset,) = axes.child_axes
    assert not any(line.get_marker() == "X" for line in axes.lines), "it would hide the disc"
    assert any(line.get_marker() == "X" for line in inset.lines)
    x, y = frame.camera.project(to_earth)
    radius = 184.75 * np.tan(np.radians(5.0))
    assert inset.get_xlim() == pytest.approx((x - 1.3 * radius, x + 1.3 * radius), abs=2)
    assert inset.get_ylim() == pytest.approx((y + 1.3 * radius, y - 1.3 * radius), abs=2)
    axes.figure.canvas.draw()


def test_reasons_take_two_lines(found):
    status = "no solution: Sun not told from other bright spots, Earth not in view"
    (axes,) = plots.plot_gallery([replace(found.frames[1], status=status)]).flat
    assert axes.get_title() == "b.png\nSun not told from other bright\nspots, Earth not in view"


def test_long_names_and_reasons_are_cut():
    assert plots._cut("a" * 40, 10) == "a" * 9 + "…"
    assert plots._cut("folder/" + "a" * 20 + "1.png", 10) == "…aaaa1.png"
    assert plots._cut("a\nb\x1b", 10) == "a b "


def test_off_axis():
    errors = {"off_axis": np.radians([10.0, 20, 30]), "cone": np.radians([0.01, 0, 0.02]),
              "together": np.radians([0.001, np.nan, np.nan]),
              "chain": np.radians([np.nan, 1, 2])}  # fmt: skip
    axes = plots.plot_off_axis(errors)
    assert axes.get_yscale() == "log"
    assert drawn(axes, "C's chain: centre of the ellipse") == pytest.approx(
        np.array([[20, 1], [30, 2]])
    )
    assert drawn(axes, "the cone's axis")[1] == pytest.approx([20, 1e-5]), (
        "drawn, though without error"
    )
    assert drawn(axes, "limb and Sun together") == pytest.approx(np.array([[10, 1e-3]]))
    errors["chain"][:] = errors["together"][:] = np.nan
    assert labels(plots.plot_off_axis(errors)) == ["the cone's axis"]
