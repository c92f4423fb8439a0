"""Figures of work C's chain from the inside: its flow, a patch in numbers, an ellipse from half (C 4.1)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from sensorbook.camera.baseline import HIGH, LOW, Baseline
from sensorbook.camera.ellipse import Ellipse
from sensorbook.camera.model import Camera
from sensorbook.camera.steps import Gradient, patch, patch_corner
from sensorbook.plots.camera import CURVE, EDGE
from sensorbook.plots.camera_steps import draw_picture
from sensorbook.plots.style import COLOURS, GREY, SECOND, WIDTH, grid, new_axes, new_row

# Columns and rows of C's figures 4.4 and 4.13, and what both feed.
_BOXES = {
    "Earth's\nimage": (0, 0),
    "7 × 7\nmedian": (1, 0),
    "Canny's\nedges": (2, 0),
    "largest\nset": (3, 0),
    "ellipse,\ncentre": (4, 0),
    "direction\n(4.4), (4.5)": (5, 0),
    "Sun's\nimage": (0, 1),
    "brightest\npixels": (1, 1),
    "their\nmiddle": (4, 1),
    "direction\n(4.6), (4.7)": (5, 1),
    "time,\nplace": (0, 2),
    "ephemeris": (1, 2),
    "reference\nvectors (4.8)": (5, 2),
    "TRIAD:\nattitude": (6, 1),
}
_ROWS = (
    ("Earth's\nimage", "7 × 7\nmedian", "Canny's\nedges", "largest\nset", "ellipse,\ncentre"),
    ("Sun's\nimage", "brightest\npixels", "their\nmiddle"),
    ("time,\nplace", "ephemeris"),
)
_ENDS = ("direction\n(4.4), (4.5)", "direction\n(4.6), (4.7)", "reference\nvectors (4.8)")
_HALF = 0.41, 0.3  # of a box


def plot_flow(axes: Axes | None = None) -> Axes:
    """Work C's steps from image, time and place to an attitude, as boxes and arrows."""
    axes = new_axes(axes, height=2.3)
    for text, (x, y) in _BOXES.items():
        last = text.startswith("TRIAD")
        style = {"boxstyle": "square,pad=0", "alpha": 0}
        axes.add_patch(
            plt.Rectangle(
                (x - _HALF[0], y - _HALF[1]),
                2 * _HALF[0],
                2 * _HALF[1],
                facecolor="#E3EEF6" if last else "white",
                edgecolor=COLOURS["x"] if last else GREY,
                linewidth=1.2,
            )
        )
        axes.text(x, y, text, ha="center", va="center", fontsize=8, bbox=style)
    for steps, end in zip(_ROWS, _ENDS, strict=True):
        for first, second in zip(steps, (*steps[1:], end), strict=True):
            (x, y), (ahead, _) = _BOXES[first], _BOXES[second]
            _arrow(axes, (x + _HALF[0], y), (ahead - _HALF[0], y))
        x, y = _BOXES[end]
        _arrow(axes, (x + _HALF[0], y), (6 - _HALF[0], 1 + 0.5 * _HALF[1] * (y - 1)))
    axes.set(xlim=(-0.5, 6.5), ylim=(2.45, -0.45))
    axes.set_axis_off()
    return axes


def plot_median_patch(image: np.ndarray, pixel: tuple[int, int], side: int = 7) -> np.ndarray:
    """A median's window (side × side) on an image around column and row `pixel`, and its values in order.

    The pixel in the middle is framed red, and the values equal to the median are yellow.
    """
    row = new_row(2, height=3.5, sharey=False)
    values = patch(image, pixel, side)
    middle = np.sort(values, axis=None)[values.size // 2]
    _numbers(row[0], image, pixel, side)
    x, y = patch_corner(image, pixel, side)
    for down, right in np.argwhere(values == middle):
        _frame(row[0], x + right, y + down, SECOND)
    _frame(row[0], *pixel, EDGE, width=2.4)
    order = np.arange(1, values.size + 1)
    row[1].plot(order, np.sort(values, axis=None), "o", color=COLOURS["x"], ms=4)
    row[1].plot(
        values.size // 2 + 1, middle, "s", color=SECOND, mec="black", ms=8,
        label=f"the {values.size // 2 + 1}th of {values.size}: {middle}",
    )  # fmt: skip
    now = int(image[pixel[1], pixel[0]])
    row[1].axhline(now, color=EDGE, linewidth=1.2, label=f"the pixel's own: {now}")
    row[1].set_xlabel("place in the order")
    row[1].set_ylabel("grey level")
    row[1].legend(fontsize=8, loc="best")
    grid(row[1])
    return row


def plot_gradient_patch(found: Gradient, chain: Baseline, pixel: tuple[int, int]) -> np.ndarray:
    """A patch of the gradient's sizes: where these are largest along the gradient, and what is kept.

    Left, framed: no smaller than both neighbours along the gradient. Right, of those alone: above the
    high threshold red, between the two and kept yellow, not kept grey.
    """
    row = new_row(2, height=4.3)
    kept = chain.edges
    for axes, title in zip(row, ("largest along the gradient", "two thresholds"), strict=True):
        _numbers(axes, found.size, pixel, top=max(float(patch(found.size, pixel).max()), HIGH))
        axes.set_title(title, fontsize=10)
    x, y = patch_corner(found.size, pixel)
    for down, right in np.argwhere(patch(found.thin, pixel)):
        at = y + down, x + right
        strong, between = found.size[at] > HIGH, kept[at]
        _frame(row[0], x + right, y + down, CURVE)
        _frame(row[1], x + right, y + down, EDGE if strong else SECOND if between else GREY)
    marks = ((EDGE, f"above {HIGH}"), (SECOND, f"above {LOW}, kept"), (GREY, "not kept"))
    for colour, name in marks:
        row[1].plot([], [], "s", color="none", mec=colour, mew=2, ms=8, label=name)
    row[0].plot([], [], "s", color="none", mec=CURVE, mew=2, ms=8, label="stays an edge")
    for axes in row:
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=3,
                    frameon=False, handletextpad=0.2, columnspacing=1.0)  # fmt: skip
    return row


def plot_half(
    image: np.ndarray, camera: Camera, whole: Ellipse, points: np.ndarray, half: Ellipse,
    axes: Axes | None = None,
) -> Axes:  # fmt: skip
    """An ellipse through all of a chain's edges, and the one through the half `points` (N, 2) alone."""
    axes = new_axes(axes, height=0.9 + 0.93 * WIDTH * camera.height / camera.width)
    draw_picture(axes, image, camera)
    axes.plot(*points[:: max(1, len(points) // 200)].T, "o", color=EDGE, ms=2.5, label="the half")
    for ellipse, colour, line, mark, name in (
        (whole, CURVE, "-", "o", "from all edges"),
        (half, SECOND, "--", "D", "from the half"),
    ):
        axes.plot(*ellipse.points(720).T, color=colour, linestyle=line, linewidth=1.5, label=name)
        axes.plot(*ellipse.centre, mark, color=colour, mec="black", ms=8, label="its centre")
    size = np.array([camera.width, camera.height])
    drawn = np.concatenate([whole.points(90), half.points(90), points])
    middle, wide = (drawn.max(axis=0) + drawn.min(axis=0)) / 2, np.ptp(drawn, axis=0).max()
    if wide < 0.25 * camera.width:  # small: closer
        reach = 0.6 * wide * np.array([1, camera.height / camera.width]).clip(0.75)
        low, high = middle - reach, middle + reach
    else:
        # A centre out of the image is shown, if it is not too far.
        centres = np.stack([whole.centre, half.centre])
        low = np.clip(np.minimum(centres.min(axis=0) - 40, -0.5), -size, -0.5)
        high = np.clip(np.maximum(centres.max(axis=0) + 40, size - 0.5), size - 0.5, 2 * size)
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="x [px]", ylabel="y [px]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=5, fontsize=8, frameon=False)
    return axes


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    style = {"arrowstyle": "-|>", "color": GREY, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style)


def _numbers(
    axes: Axes, image: np.ndarray, pixel: tuple[int, int], side: int = 9, top: float = 255
) -> None:
    """A patch of an image with its values, at its place in the image."""
    values = patch(image, pixel, side)
    x, y = patch_corner(image, pixel, side)
    high, wide = values.shape
    border = x - 0.5, x + wide - 0.5, y + high - 0.5, y - 0.5
    axes.imshow(values, cmap="gray", vmin=0, vmax=top, extent=border, interpolation="nearest")
    for (down, right), value in np.ndenumerate(values):
        colour = "white" if value < 0.55 * top else "black"
        axes.text(
            x + right, y + down, f"{value:.0f}", ha="center", va="center", fontsize=7, color=colour
        )
    axes.set_xticks(np.arange(x, x + wide, 2))
    axes.set_yticks(np.arange(y, y + high, 2))
    axes.set_xlabel("x [px]")
    axes.set_ylabel("y [px]" if axes.get_subplotspec().is_first_col() else "")


def _frame(axes: Axes, x: float, y: float, colour: str, width: float = 1.8) -> None:
    box = plt.Rectangle((x - 0.43, y - 0.43), 0.86, 0.86, fill=False, ec=colour, lw=width)
    axes.add_patch(box)
