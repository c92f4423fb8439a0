"""A camera's image with what was found in it, in work C's colours (figs 4.16 to 4.19)."""

from __future__ import annotations

import io
from dataclasses import replace

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from sensorbook.camera.baseline import Baseline
from sensorbook.camera.explorer import Exploration
from sensorbook.camera.limb import Limb
from sensorbook.camera.model import Camera, grey
from sensorbook.camera.sun import Sun
from sensorbook.plots.style import WIDTH, new_axes

# C's yellow, red, blue and green, so that they differ in brightness too; the marks differ in shape.
SUN, EDGE, CURVE, EARTH, TRUE = "#F0E442", "#E8442E", "#4FA8FF", "#00C281", "#FFFFFF"
# A grey that both the white and the dark marks stand out from.
_LEGEND = {"fontsize": 8, "facecolor": "#B0B0B0", "framealpha": 1, "edgecolor": "none"}
MOST_COLUMNS = 1600  # of the image as drawn: finer than the page shows
MOST_POINTS = 200  # apart, so that the fitted line shows between them


def limb_curve(direction: np.ndarray, angular_radius: float, camera: Camera) -> np.ndarray:
    """Pixels (N, 2) of the limb with `angular_radius` (rad) about `direction` (3,), in camera axes.

    In turn about the direction; NaN where they are out of the image, so that a line through them shows
    what is inside and no more.

    >>> camera = Camera(1280, 720, 369.5)
    >>> limb_curve([0, 0, 1], np.arctan(100 / 369.5), camera)[0].round(6)
    array([639.5, 459.5])
    """
    direction = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    second = np.cross(direction, first)
    # A point every two pixels or so, in the middle of the image.
    count = int(np.clip(np.pi * camera.focal_px * np.sin(angular_radius), 720, 50_000))
    turn = np.linspace(0, 2 * np.pi, count)[:, None]
    rays = np.cos(angular_radius) * direction + np.sin(angular_radius) * (
        np.cos(turn) * first + np.sin(turn) * second
    )
    return np.where(camera.sees(rays)[:, None], camera.project(rays), np.nan)


def plot_view(
    image: np.ndarray,
    camera: Camera,
    limb: Limb | None = None,
    sun: Sun | None = None,
    true_limb: np.ndarray | None = None,
    legend: bool = True,
    axes: Axes | None = None,
) -> Axes:
    """An image (height, width), uint8, with the limb and the Sun that were found in it.

    The edge points that the limb's fit kept are red, the fitted limb blue, the Earth's centre green (an
    arrow at the border where it is out of the image) and the Sun's centre yellow. What has no solution
    is not drawn. `true_limb`, pixels (N, 2) as `limb_curve` gives them, is a dotted white line.
    """
    axes = _image(image, camera, axes)
    if true_limb is not None:
        _true(true_limb, axes)
    if limb is not None and limb.direction is not None:
        _edges(limb.pixels[limb.used], axes)
        curve = limb_curve(limb.direction, limb.angular_radius, camera)
        axes.plot(*curve.T, color=CURVE, linewidth=1.2, label="fitted limb")
        _earth(limb.direction, camera, "Earth's centre", axes)
    if sun is not None and sun.pixel is not None:
        _sun(sun.pixel, axes)
    return _finished(axes, legend)


def plot_baseline(
    image: np.ndarray,
    camera: Camera,
    found: Baseline,
    true_limb: np.ndarray | None = None,
    legend: bool = True,
    axes: Axes | None = None,
) -> Axes:
    """The same of work C's chain: its edges, its ellipse, the ellipse's centre and the Sun's."""
    axes = _image(image, camera, axes)
    if true_limb is not None:
        _true(true_limb, axes)
    if found.ellipse is not None:
        _edges(found.chain, axes)
        curve = found.ellipse.points(720)
        inside = ((curve >= -0.5) & (curve <= [camera.width - 0.5, camera.height - 0.5])).all(1)
        curve = np.where(inside[:, None], curve, np.nan)
        axes.plot(*curve.T, color=CURVE, linewidth=1.4, linestyle="--", label="fitted ellipse")
        _earth(found.earth_direction, camera, "ellipse's centre", axes, "D")
    if found.sun_direction is not None:
        _sun(camera.project(found.sun_direction), axes)
    return _finished(axes, legend)


def plot_scene(seen: Exploration) -> np.ndarray:
    """What the cameras of a scene see: Axes (cameras, 2), by work C's chain and by limb and Sun together."""
    made, found = seen.settings, seen.found
    earth, sun = seen.chain
    views = [("camera", made.earth_camera, seen.images[0], earth, found.limb, found.sun)]
    if made.cameras == 2:
        views = [
            ("Earth camera", *views[0][1:3], replace(earth, sun_direction=None), found.limb, None),
            ("Sun camera", made.sun_camera, seen.images[1], replace(sun, ellipse=None), None, found.sun),
        ]  # fmt: skip
    figure, grid = plt.subplots(
        len(views), 2, figsize=(9.6, 0.7 + 3.0 * len(views)), layout="constrained", squeeze=False
    )
    for row, (name, camera, image, chain, limb, disc) in zip(grid, views, strict=True):
        plot_baseline(image, camera, chain, legend=False, axes=row[0])
        plot_view(image, camera, limb, disc, legend=False, axes=row[1])
        down = camera.to_body.T @ made.attitude @ -made.position
        for axes, way in zip(row, ("work C's chain", "limb and Sun together"), strict=True):
            axes.set_title(f"{name}, {way}", fontsize=10)
            if name != "Sun camera" and camera.sees(down):
                axes.plot(
                    *camera.project(down), "+", color="white", ms=12, mew=1.6,
                    path_effects=[withStroke(linewidth=3.5, foreground="black")],
                    label="Earth's true centre",
                )  # fmt: skip
    entries = {}
    for axes in grid.flat:
        entries |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    if entries:
        figure.legend(entries.values(), entries, loc="outside lower center", ncols=4, **_LEGEND)
    return grid


def scene_png(seen: Exploration) -> bytes:
    """The same as a picture, for a widget."""
    figure = plot_scene(seen)[0, 0].figure
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=96)
    plt.close(figure)
    return buffer.getvalue()


def _image(image: np.ndarray, camera: Camera, axes: Axes | None) -> Axes:
    image = grey(image, camera)
    axes = new_axes(axes, height=0.9 + 0.93 * WIDTH * camera.height / camera.width)
    step = camera.width / MOST_COLUMNS
    if step > 1:
        size = MOST_COLUMNS, max(1, round(camera.height / step))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    border = (-0.5, camera.width - 0.5, camera.height - 0.5, -0.5)
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=border)
    axes.set_xlabel("x [px]")
    axes.set_ylabel("y [px]")
    return axes


def _true(curve: np.ndarray, axes: Axes) -> None:
    axes.plot(*curve.T, color=TRUE, linewidth=1.2, linestyle=":", label="true limb")


def _edges(pixels: np.ndarray, axes: Axes) -> None:
    shown = pixels[:: max(1, -(-len(pixels) // MOST_POINTS))]
    axes.plot(*shown.T, "o", color=EDGE, ms=3.2, mew=0, label="edge points used")


def _sun(pixel: np.ndarray, axes: Axes) -> None:
    axes.plot(*pixel, "o", color=SUN, ms=7, mec="black", mew=0.8, label="Sun's centre")


def _earth(direction: np.ndarray, camera: Camera, name: str, axes: Axes, mark: str = "X") -> None:
    """A mark at a direction (3,), or at the border an arrow that points there."""
    if camera.sees(direction):
        pixel = camera.project(direction)
        axes.plot(
            *pixel, mark, color=EARTH, ms=9 if mark == "X" else 7, mec="black", mew=0.8, label=name
        )
        return
    # The way there from the middle of the image, also to what is behind the camera.
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    way = np.asarray(direction)[:2] / max(np.linalg.norm(direction[:2]), 1e-12)
    if not way.any():
        return
    tip = middle + way * np.min(middle / np.maximum(np.abs(way), 1e-12))
    tail = tip - 0.1 * camera.height * way
    axes.annotate(
        "", xy=tip, xytext=tail,
        arrowprops={"arrowstyle": "-|>", "color": EARTH, "linewidth": 2.2, "mutation_scale": 16},
    )  # fmt: skip
    axes.plot([], [], ">", color=EARTH, ms=8, label=f"{name}, out of the image")


def _finished(axes: Axes, legend: bool) -> Axes:
    if legend and axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, **_LEGEND,
        )  # fmt: skip
    return axes
