"""Figures of the star camera: what is drawn lies where it was found, in the units of its axes."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.camera.model import Camera
from sensorbook.camera.star_scene import OPTICS, made_up_sky, render_stars
from sensorbook.camera.stars import StarTable, attitude_from_stars
from sensorbook.plots import stars as plots

CAMERA = Camera(512, 512, 1450.0)
ARCSEC = np.radians(1 / 3600)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def seen():
    rng = np.random.default_rng(1750)
    sky = made_up_sky(6.0, rng)
    table = StarTable.of(sky.brighter(5.5).directions, CAMERA)
    image = render_stars(CAMERA, sky, np.eye(3), rng, false=3, hot=3)
    return image, attitude_from_stars(image, CAMERA, table, OPTICS.gain), table


def line(axes, label):
    return next(one for one in axes.lines if one.get_label().startswith(label))


def test_spots(seen):
    image, found, _ = seen
    axes = plots.plot_spots(image, found.blobs)
    usable = found.blobs.usable
    np.testing.assert_array_equal(
        line(axes, "may be stars").get_xydata(), found.blobs.pixels[usable]
    )
    np.testing.assert_array_equal(line(axes, "rejected").get_xydata(), found.blobs.pixels[~usable])
    assert axes.get_ylim() == (511.5, -0.5), "y runs down, as in the image"


def test_one_spot(seen):
    image, found, _ = seen
    axes = plots.plot_spot(image, found.blobs, 2, found.blobs.pixels[2] + 0.1)
    np.testing.assert_allclose(line(axes, "middle").get_xydata()[0], found.blobs.pixels[2])
    drawn = axes.images[0]
    column, row = np.rint(found.blobs.pixels[2]).astype(int)
    left, _, _, top = drawn.get_extent()
    data = drawn.get_array()
    assert data[int(row - top - 0.5), int(column - left - 0.5)] == image[row, column]


def test_ambiguity_counts_the_catalogue_s_pairs(seen):
    table = seen[2]
    left, right = plots.plot_ambiguity(table, 5 * ARCSEC, {"2 stars": 40.0, "3 stars": 1e-4})
    values, edges, _ = left.patches[0].get_data()
    # Pairs in the tolerance, at the middle of the histogram: the table itself.
    middle = len(edges) // 2
    inside = (np.degrees(table.angles) >= edges[middle]) & (
        np.degrees(table.angles) < edges[middle + 1]
    )
    expected = inside.sum() * 10 / 3600 / (edges[middle + 1] - edges[middle])
    assert values[middle] == pytest.approx(expected, rel=1e-6)
    assert [bar.get_height() for bar in right.patches] == [40.0, 1e-4]
    assert {"40", r"$1.0\times10^{-4}$"} <= {text.get_text() for text in right.texts}
    assert right.get_yscale() == "log"


def test_identified(seen):
    image, found, table = seen
    axes = plots.plot_identified(image, found, CAMERA, table, np.eye(3))
    named = found.matched >= 0
    places = line(axes, "named").get_xydata()
    np.testing.assert_array_equal(places, found.blobs.pixels[named])
    in_view = np.flatnonzero(CAMERA.sees(table.directions))
    missed = [one for one in axes.lines if one.get_label().startswith("in the catalogue")]
    assert sum(len(one.get_xydata()) for one in missed) == len(in_view) - named.sum()
    assert axes.texts[0].get_text() == str(found.matched[named][0])


def test_errors_in_arcseconds():
    rng = np.random.default_rng(1751)
    size = ARCSEC * np.array([1.0, 2.0, 10.0])
    errors, covariance = rng.normal(size=(300, 3)) * size, np.diag(size**2)[None].repeat(300, 0)
    axes = plots.plot_star_errors(errors, covariance)
    np.testing.assert_allclose(axes[0].lines[0].get_xydata(), errors[:, :2] / ARCSEC)
    # 2.448 σ holds 95 % in the plane.
    assert sorted([axes[1].patches[0].width, axes[1].patches[0].height]) == pytest.approx(
        [2 * 2.448, 20 * 2.448], rel=1e-3
    )
    steps = axes[2].lines[0].get_xydata()
    assert np.interp(2.366, *steps.T) == pytest.approx(0.5, abs=0.12)  # the median of χ² with three


def test_accuracy_and_share():
    x, both = np.array([4, 8, 16]), ARCSEC * np.array([[1.0, 10], [2, 20], [3, 30]])
    axes = plots.plot_star_accuracy({"stars": (x, both, 2 * both)})
    predicted, simulated = axes[0].lines[:2]
    assert simulated.get_ydata() == pytest.approx([1, 2, 3])
    assert predicted.get_ydata() == pytest.approx([2, 4, 6])
    axes = plots.plot_share(x, np.array([0.1, 0.5, 1]), np.array([0.2, 0.5, 1]), np.zeros(3))
    assert [list(one.get_ydata()) for one in axes.lines] == [[10, 50, 100], [20, 50, 100], [0] * 3]
