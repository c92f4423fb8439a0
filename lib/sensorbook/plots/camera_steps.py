"""Figures of an image's steps to an attitude (work C, figs 4.4 to 4.13), and of many images."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from sensorbook.camera.baseline import Baseline
from sensorbook.camera.frames import Frame
from sensorbook.camera.limb import Limb
from sensorbook.camera.model import Camera
from sensorbook.camera.picture import read_picture
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS
from sensorbook.camera.steps import around, centre_bias, edge_profile
from sensorbook.camera.sun import Sun
from sensorbook.errors import Refusal
from sensorbook.plots.camera import CURVE, EARTH, EDGE, MOST_COLUMNS, SUN, limb_curve
from sensorbook.plots.style import COLOURS, GREY, SECOND, WIDTH, grid, new_axes, new_row

REJECTED = "#E69F00"
_LEVELS = 4  # grey levels that are drawn as one: noise that no eye sees makes pages large
_COLUMNS = 4  # pictures side by side
_SMALL = 400  # columns of a picture as drawn there
_TINY = 0.2  # of a picture's width: a limb that is drawn enlarged besides


def few_levels(image: np.ndarray) -> np.ndarray:
    """The image in 64 grey levels, as figures have it."""
    return (image // _LEVELS) * _LEVELS


def plot_pictures(pictures: Mapping[str, np.ndarray], camera: Camera) -> np.ndarray:
    """Pictures (H, W), uint8 or bool, side by side under their titles."""
    height = 0.55 + 0.96 * WIDTH / len(pictures) * camera.height / camera.width
    row = new_row(len(pictures), height=height)
    for axes, (title, picture) in zip(row, pictures.items(), strict=True):
        grey = picture if picture.dtype == np.uint8 else picture.astype(np.uint8) * 255
        draw_picture(axes, grey, camera)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("x [px]")
        axes.tick_params(labelsize=7)
    row[0].set_ylabel("y [px]")
    return row


def plot_median(image: np.ndarray, filtered: np.ndarray, pixel: np.ndarray, reach: int = 9):
    """What a median leaves of a Sun at `pixel`: both pictures `reach` pixels around it, with grey levels."""
    row = new_row(2, height=0.5 * WIDTH + 0.3)
    for axes, picture, title in zip(
        row, (image, filtered), ("as taken", "after the median"), strict=True
    ):
        _close_up(axes, picture, pixel, reach)
        axes.set_title(title, fontsize=10)
    row[0].set_ylabel("y [px]")
    return row


def plot_sun(image: np.ndarray, sun: Sun, axes: Axes | None = None) -> Axes:
    """The Sun's blob, pixel by pixel, and the middle that was found."""
    axes = axes or plt.subplots(figsize=(4.2, 4.2), layout="constrained")[1]
    _close_up(axes, image, sun.pixel, 7)
    axes.plot(*sun.pixel, "+", color="#C00000", ms=18, mew=2, label="middle of the disc")
    axes.set_ylabel("y [px]")
    axes.legend(loc="upper right", fontsize=8)
    return axes


def plot_chain(found: Baseline, camera: Camera) -> np.ndarray:
    """Canny's edges, and the largest set of them that eight neighbours connect."""
    chosen = np.zeros(found.edges.shape, dtype=bool)
    x, y = found.chain.astype(int).T
    chosen[y, x] = True
    return plot_pictures(
        {"Canny's edges": _thick(found.edges), "their largest set": _thick(chosen)}, camera
    )


def plot_edges(image: np.ndarray, limb: Limb, camera: Camera, axes: Axes | None = None) -> Axes:
    """Edge points with dark space outside: those that the fit kept, and those it rejected."""
    axes = new_axes(axes, height=0.9 + 0.93 * WIDTH * camera.height / camera.width)
    draw_picture(axes, image, camera)
    for points, colour, mark, name in (
        (limb.pixels[limb.used], EDGE, "o", "kept"),
        (limb.pixels[~limb.used], REJECTED, "x", "rejected"),
    ):
        label = f"{len(points)} {name}"
        axes.plot(*points.T, mark, color=colour, ms=3.2 if mark == "o" else 5, mew=1, label=label)
    axes.set_xlabel("x [px]")
    axes.set_ylabel("y [px]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=9, frameon=False)
    return axes


def plot_profile(
    image: np.ndarray, limb: Limb, camera: Camera, edge: int, axes: Axes | None = None
) -> Axes:
    """Grey levels across one edge, and where it was put, to a fraction of a pixel."""
    axes = new_axes(axes, height=3.2)
    along, values = edge_profile(image, limb, camera, edge)
    axes.plot(along, values, color=COLOURS["x"], linewidth=1.6, label="between pixels (bilinear)")
    whole = along % limb.scale == 0
    axes.plot(along[whole], values[whole], "o", color=COLOURS["x"], ms=4)
    sigma = limb.sigma[edge]
    axes.axvspan(
        -2 * sigma, 2 * sigma, color=SECOND, alpha=0.6, linewidth=0, label="± 2 standard errors"
    )
    axes.axvline(0, color=EDGE, linewidth=0.8, label="the edge's place")
    if sigma < 0.3 * limb.scale:  # near enough that the band is seen
        axes.set_xlim(-4 * limb.scale, 4 * limb.scale)
    axes.set_xlabel("from the edge's place inward [px]")
    axes.set_ylabel("grey level")
    axes.legend(fontsize=8, loc="upper left")
    grid(axes)
    return axes


def plot_cone(limb: Limb, chain: Baseline | None, camera: Camera) -> np.ndarray:
    """Of each edge point, the angle of its line of sight from the axis, and its distance from the fit.

    The angle from the ellipse's centre of work C's chain is drawn beside it, where there is one.
    """
    _, rows = plt.subplots(
        2, 1, figsize=(WIDTH, 5.2), sharex=True, layout="constrained", height_ratios=(1, 1)
    )
    turn = np.degrees(around(limb, limb.rays))
    used, thrown = limb.used, ~limb.used
    from_axis = np.degrees(np.arccos(np.clip(limb.rays @ limb.direction, -1, 1)))
    centre = None if chain is None else chain.earth_direction
    if centre is not None:
        other = np.degrees(np.arccos(np.clip(limb.rays @ centre, -1, 1)))
        rows[0].plot(
            turn[used], other[used], ".", color=GREY, ms=4, label="from C's ellipse centre"
        )
    rows[0].plot(turn[used], from_axis[used], ".", color=EDGE, ms=4, label="from the cone's axis n")
    rho = np.degrees(limb.angular_radius)
    rows[0].axhline(rho, color=CURVE, linewidth=1.2, label=f"ρ = {rho:.2f}°")
    if centre is None:
        reach = max(3 * float(np.abs(from_axis[used] - rho).max()), 0.1)
        rows[0].set_ylim(rho - reach, rho + reach)
    rows[0].set_ylabel("angle of edge points [°]")
    rows[0].legend(fontsize=8, loc="best")
    off = limb.residuals
    reach = max(3.0 * float(np.abs(off[used]).max()), 0.5)
    rows[1].axhline(0, color=CURVE, linewidth=1.2)
    near = thrown & (np.abs(off) < reach)
    rows[1].plot(turn[near], off[near], "x", color=REJECTED, ms=5, label="rejected, near")
    rows[1].plot(turn[used], off[used], ".", color=EDGE, ms=4, label="kept")
    rows[1].set_ylim(-reach, reach)
    rows[1].set_ylabel("inside the fit [px]")
    rows[1].set_xlabel("around the limb, from right towards down [°]")
    if near.any():
        rows[1].legend(fontsize=8, loc="best")
    for axes in rows:
        grid(axes)
    return rows


def plot_centre_bias(off: float, radius: float, axes: Axes | None = None) -> Axes:
    """How far the centre of an imaged limb lies from the Earth's, against the Earth's angle off the axis.

    For the limb's angular `radius`, with a line at the image's own angle `off`, both rad, and for work
    C's three orbits.
    """
    axes = new_axes(axes, height=3.4)
    # Wide and pale, so that one of C's orbits shows on it.
    name = f"this image, ρ = {np.degrees(radius):.1f}°"
    axes.plot(*_biases(radius), color=COLOURS["x"], linewidth=6, alpha=0.4, label=name)
    for colour, (orbit, height) in zip((GREY, COLOURS["z"], SECOND), HEIGHTS.items(), strict=True):
        rho = np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + height))
        axes.plot(
            *_biases(rho), color=colour, linestyle="--", linewidth=1.4, label=f"C's {orbit.upper()}"
        )
    label = f"its θ = {np.degrees(off):.1f}°"
    axes.axvline(np.degrees(off), color=COLOURS["y"], linewidth=1.4, label=label)
    axes.set_yscale("log")
    axes.set_ylim(3e-3, 90)
    axes.set_xlim(0, max(90, np.degrees(off) + 2))
    axes.set_xlabel("angle θ of the Earth's centre off the axis [°]")
    axes.set_ylabel("centre's error Δ [°]")
    axes.legend(fontsize=8, loc="lower right")
    grid(axes)
    return axes


def _biases(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles off the axis, degrees, up to where the limb is no ellipse, and `centre_bias` there."""
    off = np.linspace(1e-4, np.pi / 2 - radius - 1e-6, 400)
    return np.degrees(off), np.degrees([centre_bias(o, radius) or np.nan for o in off])


def plot_gallery(frames: Sequence[Frame]) -> np.ndarray:
    """Small pictures of images with what was found: limb blue, its points red, the Sun yellow."""
    columns = min(_COLUMNS, max(len(frames), 1))
    rows = -(-len(frames) // columns)
    ratio = max(frame.camera.height / frame.camera.width for frame in frames)
    wide = WIDTH / _COLUMNS
    height = rows * (wide * ratio + 0.54) + 0.35
    figure, grid_of = plt.subplots(
        rows, columns, figsize=(wide * columns, height), squeeze=False, layout="constrained"
    )
    for axes, frame in zip(grid_of.flat, frames, strict=False):
        _small(axes, frame)
    for axes in grid_of.flat[len(frames) :]:
        axes.set_axis_off()
    marks = [
        Line2D([], [], color=CURVE, label="fitted limb"),
        Line2D([], [], color=EDGE, marker="o", linestyle="", ms=4, label="edge points"),
        Line2D([], [], color=EARTH, marker="X", linestyle="", ms=6, label="Earth's centre"),
        Line2D([], [], color=SUN, marker="o", mec="black", linestyle="", ms=6, label="Sun"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return grid_of


def plot_off_axis(errors: Mapping[str, np.ndarray], axes: Axes | None = None) -> Axes:
    """Errors of the Earth's direction against its true angle off the axis; those of `earth_errors`."""
    axes = new_axes(axes)
    off = np.degrees(errors["off_axis"])
    for key, colour, mark, name in (
        ("chain", COLOURS["y"], "s", "C's chain: centre of the ellipse"),
        ("cone", COLOURS["z"], "^", "the cone's axis"),
        ("together", COLOURS["x"], "o", "limb and Sun together"),
    ):
        shown = np.isfinite(errors[key])
        if shown.any():
            least = np.maximum(np.degrees(errors[key][shown]), 1e-5)
            axes.plot(off[shown], least, mark, color=colour, ms=6, label=name)
    axes.set_yscale("log")
    axes.set_xlabel("true angle of the Earth's centre off the axis [°]")
    axes.set_ylabel("error of its direction [°]")
    axes.legend(fontsize=8, loc="best")
    grid(axes)
    return axes


def _small(axes: Axes, frame: Frame) -> None:
    """One picture of the gallery, under its name and status."""
    camera = frame.camera
    try:
        image = read_picture(frame.path, camera)[0]
    except Refusal:  # it was readable a moment ago
        image = np.zeros((camera.height, camera.width), dtype=np.uint8)
    draw_picture(axes, image, camera, _SMALL)
    limb, sun = frame.limb, frame.sun
    if limb is not None and limb.direction is not None:
        curve = limb_curve(limb.direction, limb.angular_radius, camera)
        low, high = (np.nan_to_num(end(curve, axis=0)) for end in (np.nanmin, np.nanmax)) if (
            np.isfinite(curve).any()
        ) else (np.zeros(2), np.zeros(2))  # fmt: skip
        _marked(axes, frame, curve)
        if 0 < (high - low).max() < _TINY * camera.width:
            _enlarged(axes, image, frame, curve, (low + high) / 2, 0.65 * (high - low).max())
    if sun is not None and sun.pixel is not None:
        axes.plot(*sun.pixel, "o", color=SUN, ms=5, mec="black", mew=0.6)
    axes.set(xticks=[], yticks=[])
    solved = frame.status == "ok"
    reason = textwrap.wrap(_cut(frame.status.removeprefix("no solution: "), 72), 36)
    axes.set_title(
        "\n".join([_cut(frame.image, 30), *(["ok"] if solved else reason[:2])]),
        fontsize=7, color="black" if solved else "#A03000", parse_math=False,
    )  # fmt: skip


def _marked(axes: Axes, frame: Frame, curve: np.ndarray, small: bool = True) -> None:
    """The limb, its edge points, and the Earth's centre where it would not hide them."""
    limb, camera = frame.limb, frame.camera
    axes.plot(*limb.pixels[::2].T, "o", color=EDGE, ms=1.8, mew=0)
    axes.plot(*curve.T, color=CURVE, linewidth=0.9)
    wide = np.nanmax(np.ptp(curve[np.isfinite(curve[:, 0])], axis=0), initial=0.0)
    if camera.sees(limb.direction) and (not small or wide > _TINY * camera.width):
        axes.plot(*camera.project(limb.direction), "X", color=EARTH, ms=6, mec="black", mew=0.5)


def _enlarged(
    axes: Axes, image: np.ndarray, frame: Frame, curve: np.ndarray, middle: np.ndarray, reach: float
) -> None:
    """A small Earth in the corner that is farthest from it, its grey levels spread."""
    camera = frame.camera
    right, low = middle < np.array([camera.width, camera.height]) / 2
    share = 0.62 * camera.height / camera.width, 0.62
    inset = axes.inset_axes(
        (0.99 - share[0] if right else 0.01, 0.01 if low else 0.99 - share[1], *share)
    )
    first = np.clip(np.floor(middle - reach).astype(int), 0, None)
    x, y = np.clip(np.ceil(middle + reach).astype(int) + 1, None, [camera.width, camera.height])
    part = image[first[1] : y, first[0] : x]
    border = first[0] - 0.5, x - 0.5, y - 0.5, first[1] - 0.5
    inset.imshow(few_levels(part), cmap="gray", vmin=0, vmax=max(int(part.max()), 1), extent=border)
    _marked(inset, frame, curve, small=False)
    inset.set_facecolor("#D8D8D8")  # beyond the image
    inset.set(xlim=middle[0] + reach * np.array([-1, 1]), xticks=[], yticks=[])
    inset.set_ylim(middle[1] + reach * np.array([1, -1]))
    for side in inset.spines.values():
        side.set_color("#B0B0B0")


def draw_picture(axes: Axes, image: np.ndarray, camera: Camera, most: int = MOST_COLUMNS) -> None:
    """The image as it is on the page, no finer."""
    if camera.width > most:
        size = most, max(1, round(camera.height * most / camera.width))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    axes.imshow(few_levels(image), cmap="gray", vmin=0, vmax=255, extent=_border(camera))


def _close_up(axes: Axes, picture: np.ndarray, pixel: np.ndarray, reach: int) -> None:
    axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    x, y = np.round(pixel)
    axes.set_xlim(x - reach - 0.5, x + reach + 0.5)
    axes.set_ylim(y + reach + 0.5, y - reach - 0.5)
    axes.set_xlabel("x [px]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, integer=True))


def _thick(edges: np.ndarray) -> np.ndarray:
    """Edges a pixel wide, made wide enough to be seen where the image is larger than the page."""
    width = max(1, round(edges.shape[1] / 600))
    return cv2.dilate(edges.astype(np.uint8), np.ones((width, width), np.uint8)).astype(bool)


def _border(camera: Camera) -> tuple[float, float, float, float]:
    return -0.5, camera.width - 0.5, camera.height - 0.5, -0.5


def _cut(text: str, most: int) -> str:
    """At most so many characters, the name's end kept."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return (
        text
        if len(text) <= most
        else "…" + text[-most + 1 :]
        if "/" in text
        else text[: most - 1] + "…"
    )
