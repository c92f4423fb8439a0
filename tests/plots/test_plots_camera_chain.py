"""Figures of work C's chain from the inside: what is written in them is what the image has."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from cameras import ONE, shot
from matplotlib.colors import to_hex

from sensorbook.camera.baseline import HIGH, baseline
from sensorbook.camera.ellipse import Ellipse
from sensorbook.camera.steps import gradient, patch, patch_corner, telling_pixel
from sensorbook.plots import camera_chain as plots
from sensorbook.plots.camera import EDGE
from sensorbook.plots.style import SECOND


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def seen():
    image = shot(0).image()
    chain = baseline(image, ONE)
    found = gradient(chain.filtered)
    return image, chain, found, telling_pixel(chain, found)


def framed(axes, colour):
    """Columns and rows of the pixels framed in a colour."""
    return {
        (round(box.get_x() + 0.43), round(box.get_y() + 0.43))
        for box in axes.patches
        if to_hex(box.get_edgecolor()) == colour.lower()
    }


def test_the_flow_ends_in_an_attitude():
    axes = plots.plot_flow()
    texts = {text.get_text().replace("\n", " ") for text in axes.texts}
    assert {"7 × 7 median", "direction (4.4), (4.5)", "TRIAD: attitude"} <= texts
    axes.figure.canvas.draw()


def test_the_median_s_window(seen):
    image, chain, _, pixel = seen
    left, right = plots.plot_median_patch(image, pixel)
    numbers = [int(text.get_text()) for text in left.texts]
    assert numbers == patch(image, pixel, 7).ravel().tolist()
    median = int(np.median(numbers))
    assert median == chain.filtered[pixel[::-1]]
    assert framed(left, EDGE) == {pixel}
    assert all(image[y, x] == median for x, y in framed(left, SECOND))
    labels = [text.get_text() for text in right.get_legend().get_texts()]
    assert labels == [f"the 25th of 49: {median}", f"the pixel's own: {image[pixel[::-1]]}"]
    left.figure.canvas.draw()


def test_the_gradient_s_patch(seen):
    _, chain, found, pixel = seen
    _, right = plots.plot_gradient_patch(found, chain, pixel)
    corner = np.array(patch_corner(found.size, pixel))
    thin, size = patch(found.thin, pixel), patch(found.size, pixel)
    strong = {tuple(int(i) for i in corner + at[::-1]) for at in np.argwhere(thin & (size > HIGH))}
    assert framed(right, EDGE) == strong
    kept = framed(right, EDGE) | framed(right, SECOND)
    edges = np.argwhere(patch(chain.edges, pixel))
    assert kept == {tuple(int(i) for i in corner + at[::-1]) for at in edges}
    right.figure.canvas.draw()


def test_two_ellipses():
    whole = Ellipse(np.array([300.0, 200]), np.array([120.0, 80]), 0.0, np.zeros(6))
    half = Ellipse(np.array([-9000.0, 200]), np.array([9400.0, 80]), 0.0, np.zeros(6))
    axes = plots.plot_half(np.zeros((360, 640), np.uint8), ONE, whole, whole.points(50), half)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    # A centre far out of the image is not gone after.
    assert (left, right, bottom, top) == (-640, 639.5, 359.5, -0.5)
    axes.figure.canvas.draw()


def test_small_ellipses_are_shown_from_near():
    whole = Ellipse(np.array([300.0, 200]), np.array([40.0, 30]), 0.0, np.zeros(6))
    axes = plots.plot_half(np.zeros((360, 640), np.uint8), ONE, whole, whole.points(50), whole)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert 210 < left < 260 < 340 < right < 390
    assert 110 < top < 170 < 230 < bottom < 290
