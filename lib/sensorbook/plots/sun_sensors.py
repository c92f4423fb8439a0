"""Figures of Sun sensors: cells, pairs, pyramids and slits (work C, figures 3.1 to 3.7)."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sensorbook.attitude.sensors.sun import (
    SlitSensor,
    cell_currents,
    four_normals,
    pair_angle,
    pair_normals,
)
from sensorbook.plots.style import GREY, SECOND, labelled, new_axes, new_row

BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"


def plot_cell_geometry(angle: float, tilt: float, axes: Sequence[Axes] | None = None):
    """A cell and a pair tilted by ±`tilt` in section, the Sun at `angle` from z, rad (C 3.1 and 3.3)."""
    axes = new_row(2, 2.6) if axes is None else axes
    sun = np.array([np.sin(angle), np.cos(angle)])
    for a, turns, names in zip(axes, ((0.0,), (tilt, -tilt)), (("n",), ("n₁", "n₂")), strict=True):
        for turn, name, side in zip(turns, names, (1, -1), strict=False):
            normal = np.array([np.sin(turn), np.cos(turn)])
            along = np.array([normal[1], -normal[0]])
            centre = (
                np.zeros(2)
                if len(turns) == 1
                else side * (0.05 + 0.45 * np.cos(turn)) * np.array([1, 0])
            )
            ends = centre + 0.45 * np.outer([-1, 1], along)
            a.plot(*ends.T, color=BLUE, lw=5, solid_capstyle="butt")
            _arrow(a, centre, centre + 0.8 * normal, GREY)
            a.text(
                *(centre + 0.88 * normal - 0.1 * along), name, color=GREY, ha="center", va="center"
            )
            for start in (ends[0], centre, ends[1]):
                if sun @ normal > 0:
                    a.plot(*np.array([start, start + 1.25 * sun]).T, color=SECOND, lw=0.8, zorder=0)
        a.plot([0, 0], [0, 1.2], ":", color=GREY, lw=1)
        _arrow(a, 1.6 * sun, 1.3 * sun, RED)
        a.text(*(1.72 * sun), "Sun", color=RED, ha="center", va="center")
        radius = 0.55
        turn = np.linspace(0, angle, 40)
        a.plot(radius * np.sin(turn), radius * np.cos(turn), color=RED, lw=1)
        a.text(0.68 * np.sin(angle / 2), 0.68 * np.cos(angle / 2), "θ", color=RED, ha="center")
        a.set_aspect("equal")
        a.set_xlim(-max(1.5, 1.9 * abs(sun[0])), max(1.5, 1.9 * abs(sun[0])))
        a.set_ylim(min(-0.5, 1.9 * sun[1]), 1.9)
        a.set_axis_off()
    axes[0].set_title("one cell")
    axes[1].set_title(f"a pair, tilted by ±{np.degrees(tilt):.0f}°")
    return axes


def _arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6})


def plot_cell(angle: float, axes: Axes | None = None) -> Axes:
    """Current of one cell against the Sun's angle (C 3.2); both angles that fit that at `angle`, rad."""
    axes = new_axes(axes, 2.9)
    around = np.linspace(-np.pi, np.pi, 721)
    axes.plot(np.degrees(around), _currents(around, np.array([[0.0, 0.0, 1.0]]))[:, 0], color=BLUE)
    current = max(np.cos(angle), 0.0)
    axes.axhline(current, color=GREY, lw=0.8, ls=":")
    if current > 0:
        both = np.degrees([-angle, angle])
        axes.plot(both, [current, current], "o", color=RED, label="angles that fit one reading")
        axes.legend(fontsize=8)
    return labelled(
        axes, "angle of the Sun from the normal [°]", "current, share of the full one [1]", 45
    )


def plot_pair(tilt: float, axes: Axes | None = None) -> Axes:
    """Currents of a pair tilted by `tilt`, rad, their difference (C 3.4), and where both are lit."""
    axes = new_axes(axes, 3.3)
    around = np.linspace(-np.pi, np.pi, 721)
    currents = _currents(around, pair_normals(tilt))
    lit = np.degrees(around[pair_angle(currents, tilt, 1.0).reasons == ""])
    axes.axvspan(lit.min(), lit.max(), color="#EEEEEE", label="both lit")
    for k, style in enumerate(("--", "-.")):
        axes.plot(np.degrees(around), currents[:, k], style, color=GREY, lw=1, label=f"I{'₁₂'[k]}")
    axes.plot(np.degrees(around), currents[:, 0] - currents[:, 1], color=BLUE, label="I₁ − I₂")
    inside = np.linspace(lit.min(), lit.max(), 50)
    axes.plot(inside, 2 * np.sin(tilt) * np.radians(inside), ":", color=RED, label="tangent at 0")
    axes.legend(fontsize=8, ncols=2)
    return labelled(axes, "angle of the Sun θ [°]", "current, share of the full one [1]", 45)


def plot_four_cells(tilt: float, sun: np.ndarray, axes: Axes | None = None) -> Axes:
    """Four cells on a pyramid, their normals, and the Sun's direction (3,) (C 3.5)."""
    axes = _space(axes, 4.8, 3.9)
    # Far enough out that the corners of neighbours stay apart, at any tilt.
    out = 0.24 * (1 + np.cos(tilt)) + 0.05
    centres = out * four_normals(tilt) * [1, 1, 0] / np.sin(tilt)
    for k, (normal, centre) in enumerate(zip(four_normals(tilt), centres, strict=True)):
        side = np.cross([0, 0, 1.0], normal) / np.sin(tilt)
        up = np.cross(normal, side)
        corners = centre + 0.24 * np.array([side + up, side - up, -side - up, -side + up])
        lit = max(float(normal @ sun), 0.0)
        colour = plt.cm.Oranges(0.1 + 0.5 * lit)
        axes.add_collection3d(Poly3DCollection([corners], facecolors=[colour], edgecolors=[GREY]))
        axes.quiver(*centre, *(0.5 * normal), color=GREY, lw=1, arrow_length_ratio=0.15)
        axes.text(*(centre + 0.62 * normal), f"n{'₁₂₃₄'[k]}", ha="center")
    length = min(1.05, 0.85 / np.abs(sun[:2]).max()) if sun[:2].any() else 1.05  # stays inside
    axes.quiver(0, 0, 0, *(length * sun), color=RED, lw=2, arrow_length_ratio=0.08)
    axes.text(*(1.05 * length * sun), "Sun", color=RED)
    _triad(axes, 0.9)
    _cube(axes, [-0.9, 0.9], [-0.9, 0.9], [min(-0.35, 1.2 * sun[2]), 1.0], zoom=1.5)
    return axes


def plot_slit(sensor: SlitSensor, angle: float, axes: Axes | None = None) -> Axes:
    """Section of a slit sensor: the line of light at `angle`, rad, on the row of pixels (C 3.6)."""
    axes = new_axes(axes, 4.2)
    half, height = 1e3 * sensor.pixels * sensor.pitch / 2, 1e3 * sensor.height
    gap = 0.02 * half
    for low, high in ((-half, -gap), (gap, half)):
        axes.add_patch(Rectangle((low, height), high - low, 0.04 * height, color=GREY))
    shown = 32  # drawn coarser than they are
    for k in range(shown):
        edge = -half + 2 * half * k / shown
        lit = np.cos(angle) > 0 and edge <= height * np.tan(angle) < edge + 2 * half / shown
        colour = SECOND if lit else "white"
        axes.add_patch(
            Rectangle(
                (edge, -0.08 * height), 2 * half / shown, 0.08 * height, fc=colour, ec=GREY, lw=0.6
            )
        )
    reach = 0.45 * height
    turn, away = (
        np.degrees(angle),
        -1 if angle > 0 else 1,
    )  # the name stands on the side without the ray
    if np.cos(angle) > 0:
        ray = [-reach * np.tan(angle), height * np.tan(angle)]
        axes.plot(ray, [height + reach, 0], color=SECOND, lw=2)
        size = 0.9 * height
        arc = Arc(
            (0, height), size, size, angle=270, theta1=min(0, turn), theta2=max(0, turn), color=RED
        )
        axes.add_patch(arc)
        axes.text(
            0.06 * half * away, 0.6 * height, f"α = {turn:.0f}°", color=RED,
            ha="right" if away < 0 else "left", va="center",
        )  # fmt: skip
    else:
        axes.text(
            0, 1.25 * height, "the Sun is behind", color=RED, ha="center", backgroundcolor="white"
        )
    axes.plot([0, 0], [0, height + reach], ":", color=GREY, lw=1)
    axes.text(half, 1.07 * height, "slit", color=GREY, ha="right")
    pixels = f"{sensor.pixels} pixels (drawn as {shown})"
    axes.text(0, -0.17 * height, pixels, color=GREY, ha="center", va="center")
    axes.set_aspect("equal")
    axes.set_xlim(-1.05 * half, 1.05 * half)
    axes.set_ylim(-0.26 * height, 1.5 * height)
    axes.set_xlabel("along the detector [mm]")
    axes.set_ylabel("above it [mm]")
    return axes


def plot_slit_errors(sensor: SlitSensor, axes: Axes | None = None) -> Axes:
    """Error of a slit's angle over a few pixels: half a pixel at most, a saw's teeth."""
    axes = new_axes(axes, 2.6)
    angle = np.linspace(0, 4 * sensor.pitch / sensor.height, 2000)
    sun = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    error = sensor.angles(sensor.read(sun))[:, 0] - angle
    axes.plot(3600 * np.degrees(angle), 3600 * np.degrees(error), color=BLUE)
    for sign in (-1, 1):
        axes.axhline(sign * 3600 * np.degrees(sensor.quantisation), color=RED, ls="--", lw=1)
    return labelled(axes, "angle of the Sun [″]", "error [″]")


def plot_sun_vector(alpha: float, beta: float, axes: Axes | None = None) -> Axes:
    """The Sun's vector in the slit sensor's frame and its two angles, rad (C 3.7)."""
    axes = _space(axes)
    point = np.array([1, np.tan(alpha), np.tan(beta)])
    axes.quiver(0, 0, 0, *point, color=RED, lw=2, arrow_length_ratio=0.06)
    axes.text(*(1.06 * point), "Sun", color=RED)
    for part, name, colour, lift in (
        (point * [1, 1, 0], f"α = {np.degrees(alpha):.0f}°", BLUE, -0.05),
        (point * [1, 0, 1], f"β = {np.degrees(beta):.0f}°", GREEN, -0.04),
    ):
        axes.plot(*np.stack([0 * part, part, point]).T, "--", color=colour, lw=1)
        turn = np.linspace(0, 1, 30)[:, None]
        arc = (1 - turn) * np.array([1.0, 0, 0]) + turn * part
        arc *= 0.5 / np.linalg.norm(arc, axis=1, keepdims=True)
        axes.plot(*arc.T, color=colour)
        axes.text(*(1.04 * part + [0, 0, lift]), name, color=colour)
    _triad(axes, 0.8)
    lows, highs = np.minimum(point, 0) - 0.05, np.maximum(point, 0.85)
    _cube(axes, *zip(lows, highs, strict=True))
    return axes


def _currents(angles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Currents (N, k) with the Sun at `angles` (N,) from z towards x."""
    return cell_currents(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1), normals)


def _space(axes: Axes | None, width: float = 4.8, height: float = 4.2) -> Axes:
    if axes is None:
        figure = plt.figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot(projection="3d")
    axes.view_init(22, -55)
    return axes


def _triad(axes: Axes, length: float) -> None:
    for k, name in enumerate("xyz"):
        end = length * np.eye(3)[k]
        axes.plot(*np.stack([0 * end, end]).T, color="black", lw=1)
        axes.text(*(1.08 * end), name)


def _cube(axes: Axes, x, y, z, zoom: float = 1.0) -> None:
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_zlim(*z)
    axes.set_box_aspect([np.ptp(x), np.ptp(y), np.ptp(z)], zoom=zoom)
    axes.set_axis_off()
