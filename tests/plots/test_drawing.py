"""Figures drawn for a page look as matplotlib itself draws them."""

import io

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from sensorbook.plots.drawing import drawn, encoded, lighten
from sensorbook.plots.style import log_log, new_axes, new_row

DPI = 96


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def decades():
    axes = new_axes()
    axes.plot([2e-3, 0.1, 30.0], [1e-7, 3e-2, 0.5], label="measured")
    log_log(axes)
    axes.legend()
    return axes


def pixels(figure) -> np.ndarray:
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)


def test_lightened_ticks_and_grid_are_where_they_were():
    axes = decades()
    axes.figure.set_layout_engine("none")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(plt.NullFormatter())  # the numbers alone may look different
    before = pixels(axes.figure)
    lighten(axes.figure)
    assert not len(axes.get_xticks(minor=True))
    change = np.abs(pixels(axes.figure) - before).max(axis=2)
    # Where lines of the grid cross, another one lies on top.
    assert change.max() < 30
    assert np.mean(change > 2) < 0.002


def test_small_ticks_with_numbers_keep_them():
    axes = new_axes()
    axes.plot([1.0, 3.0, 12.0], [1.0, 20.0, 4.0])
    log_log(axes)
    lighten(axes.figure)
    axes.figure.canvas.draw()
    assert "3" in [text.get_text() for text in axes.get_xticklabels(minor=True)]


def test_powers_of_ten_are_text():
    axes = decades()
    lighten(axes.figure)
    axes.figure.canvas.draw()
    shown = {text.get_text() for text in axes.get_yticklabels()}
    assert {"10⁻⁷", "10⁻¹"} <= shown
    assert not any("$" in text for text in shown)


@pytest.mark.parametrize("layout", ["constrained", None])
def test_nothing_is_cut_off(layout):
    figure, axes = plt.subplots(figsize=(4, 3), layout=layout)
    axes.plot([0, 1e6], [0, -1e6])
    axes.set_ylabel("far\nto\nthe\nleft")
    axes.text(1.02, 0.5, "and to the right", transform=axes.transAxes)
    image = np.asarray(drawn(figure, DPI)).astype(int)
    edges = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert (edges == 255).all()
    assert (image.min(axis=2) < 100).any()


def test_what_the_layout_leaves_outside_is_not_cut_off():
    figure = plt.figure(figsize=(4, 3), layout="constrained")
    figure.text(0.98, 0.5, "half outside of the figure")  # no part of the layout
    image = np.asarray(drawn(figure, DPI)).astype(int)
    edges = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert (edges == 255).all()
    assert (image < 100).any(axis=(0, 2)).sum() > DPI  # the whole width of the text


def test_axes_alone_are_about_as_large_as_the_constrained_layout_makes_them():
    image = drawn(decades().figure, DPI)
    figure = decades().figure
    lighten(figure)
    figure.set_dpi(DPI)
    expected = np.flatnonzero((pixels(figure) < 50).all(axis=2).mean(axis=0) > 0.8)  # the spines
    got = np.flatnonzero((np.asarray(image) < 50).all(axis=2).mean(axis=0) > 0.8)
    assert np.ptp(got) == pytest.approx(np.ptp(expected), rel=0.1)
    rows = np.flatnonzero((np.asarray(image) < 250).any(axis=(1, 2)))
    assert rows[0] > 5, "nothing meets the edge"
    assert rows[-1] < image.height - 6


def test_shared_axes_keep_the_ticks_of_each():
    row = new_row(2)
    for axes in row:
        axes.plot([1e-3, 1e3], [1e-3, 1e3])
        log_log(axes)
    lighten(row[0].figure)
    assert [len(axes.artists) for axes in row] == [2, 2]


def test_encoded_image_is_the_drawn_one():
    figure = decades().figure
    image = drawn(figure, DPI)
    back = Image.open(io.BytesIO(encoded(figure, image))).convert("RGB")
    assert back.getpixel((0, 0)) == (255, 255, 255)
    assert np.abs(np.asarray(back).astype(int) - np.asarray(image)).mean() < 4
