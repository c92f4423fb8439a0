"""Drawings of more instruments (chapter on sensor principles); they give directions, not sizes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Ellipse, Rectangle

from sensorbook.plots.principles import (
    BLUE,
    GREEN,
    INK,
    PALE,
    RED,
    _arrow,
    _canvas,
    engineering,
)
from sensorbook.plots.style import GREY, THIRD


def plot_ring_laser(rate: float, beat: float, axes: Axes | None = None) -> Axes:
    """A triangular ring laser (work C, figure 3.20): two beams, three mirrors, and their beat behind one.

    `rate` in rad/s, counter-clockwise; `beat` in Hz, whose sign is the rate's.
    """
    axes = _canvas(axes, (-5.2, 6.4), (-3.3, 2.7), 3.7)
    corners = 2.3 * np.array([[0, 1], [-np.sqrt(3) / 2, -0.5], [np.sqrt(3) / 2, -0.5]])
    axes.fill(*(1.16 * corners).T, fc=PALE, ec="none", zorder=0)
    for size, colour, way in ((1.0, BLUE, 1), (0.86, RED, -1)):
        path = (size * corners)[::way]
        axes.plot(*np.vstack([path, path[:1]]).T, color=colour, lw=1.8)
        for start, end in zip(path, np.roll(path, -1, axis=0), strict=True):
            _arrow(axes, start, start + 0.3 * (end - start), colour)
    for k, corner in enumerate(corners):
        along = np.array([-corner[1], corner[0]]) / 2.3  # a mirror stands across the radius
        ends = 1.04 * corner + 0.55 * np.outer([-1, 1], along)
        axes.plot(*ends.T, color=INK, lw=4, ls="-" if k != 2 else (0, (1.2, 0.6)))
    axes.text(-2.5, -1.75, "mirror", ha="center", fontsize=9)
    axes.text(0.75, 2.35, "mirror", ha="left", va="center", fontsize=9)
    # Behind the half-silvered mirror each beam goes straight on; two mirrors and a splitter join them.
    behind, join = 1.04 * corners[2], np.array([3.5, -2.6])
    for colour, corner in (
        (BLUE, np.array([join[0], behind[1]])),
        (RED, np.array([behind[0] + (behind[1] - join[1]) / np.sqrt(3), join[1]])),
    ):
        axes.plot(*np.transpose([behind, corner, join]), color=colour, lw=1.6)
        tilt = np.radians(-45 if colour == BLUE else -30)
        ends = corner + 0.3 * np.outer([-1, 1], [np.cos(tilt), np.sin(tilt)])
        axes.plot(*ends.T, color=INK, lw=3)
    axes.plot(*(join[:, None] + [[-0.3, 0.3], [0.3, -0.3]]), color=INK, lw=2, ls=(0, (1.2, 0.6)))
    for colour, at in ((BLUE, 0.07), (RED, -0.07)):
        y = join[1] + at
        _arrow(axes, (join[0], y), (join[0] + 0.9, y), colour)
    axes.add_patch(Rectangle((4.4, -2.95), 1.5, 0.7, fc="white", ec=INK, lw=1.4))
    axes.text(5.15, -2.6, "detector", ha="center", va="center", fontsize=9)
    axes.text(5.15, -1.95, "both beams beat", ha="center", va="center", fontsize=8.5)
    axes.text(2.6, -0.72, "half-silvered mirror", va="center", fontsize=8.5)
    if rate:
        turn = np.radians(np.linspace(-60, 60, 40))[:: int(np.sign(rate))] + np.pi / 2
        axes.plot(0.55 * np.cos(turn), 0.55 * np.sin(turn), color=GREEN, lw=2)
        _arrow(axes, *(0.55 * np.array([np.cos(a), np.sin(a)]) for a in turn[[-2, -1]]), GREEN)
    axes.text(0, -0.15, "$\\Omega$", color=GREEN, ha="center", va="center", fontsize=12)
    low, high = ("lower", "higher") if rate > 0 else ("higher", "lower")
    if not rate:
        low = high = "same"
    for line, (words, colour) in enumerate(
        (
            (f"counter-clockwise: {low} frequency", BLUE),
            (f"clockwise: {high} frequency", RED),
            (f"$\\Omega$ = {np.degrees(rate) * 3600:.4g} °/h", GREEN),
            (f"$\\Delta f$ = {engineering(abs(beat), 'Hz')}", INK),
        )
    ):
        axes.text(2.0, 2.2 - 0.7 * line, words, color=colour, fontsize=9.5, va="center")
    return axes


def plot_rotor(drift: float, axes: Axes | None = None) -> Axes:
    """A fast rotor in two gimbals, its centre of mass beside the bearing; `drift` in rad/s per g.

    The spin points to the right, gravity down. The centre of mass lies along the spin, so that its
    torque is level and turns the spin about the vertical.
    """
    axes = _canvas(axes, (-5.4, 7.2), (-3.1, 3.1), 3.7)
    axes.add_patch(Circle((0, 0), 2.5, fill=False, ec=GREY, lw=2.4))
    axes.add_patch(Ellipse((0, 0), 3.4, 3.8, fill=False, ec=INK, lw=2.4))
    axes.plot([0, 0], [1.9, 2.5], color=INK, lw=3)
    axes.plot([0, 0], [-2.5, -1.9], color=INK, lw=3)
    axes.text(
        -2.5,
        1.9,
        "outer gimbal:\nturns in the page",
        color=GREY,
        ha="right",
        va="center",
        fontsize=9,
    )
    axes.text(
        -2.5,
        -1.9,
        "inner gimbal:\nturns about\nthe vertical",
        color=INK,
        ha="right",
        va="center",
        fontsize=9,
    )
    axes.plot([-2.45, -1.55], [-1.8, -0.95], color=INK, lw=0.8)
    axes.plot([-1.7, 1.7], [0, 0], color=INK, lw=2)
    axes.add_patch(Rectangle((-0.28, -1.3), 0.56, 2.6, fc=THIRD, ec=INK, lw=1.3, zorder=2))
    axes.text(-0.75, 0.55, "rotor", ha="center", va="center", fontsize=9)
    _arrow(axes, (1.7, 0), (3.2, 0), BLUE)
    axes.text(3.35, 0, "$H$", color=BLUE, va="center", fontsize=11)
    axes.plot(0.75, 0, "o", color=RED, ms=8, zorder=3)
    _arrow(axes, (0.75, 0), (0.75, -1.15), RED)
    axes.text(0.9, -0.9, "$m\\,g$", color=RED, va="center", fontsize=10)
    axes.text(0.55, 0.3, "$\\delta$", color=RED, ha="center", va="center", fontsize=11)
    # H turns towards the torque, level, about the vertical.
    turn = np.radians(np.linspace(200, 340, 40))
    axes.plot(0.9 * np.cos(turn), 2.75 + 0.25 * np.sin(turn), color=GREEN, lw=1.8)
    _arrow(axes, *((0.9 * np.cos(a), 2.75 + 0.25 * np.sin(a)) for a in turn[[-3, -1]]), GREEN)
    axes.text(1.1, 2.85, "drift", color=GREEN, va="center", fontsize=9)
    _per_line(
        axes,
        (3.9, 1.9),
        ("the spin keeps its direction", BLUE),
        ("torque $M = m\\,g\\,\\delta$", RED),
        (f"drift $M/H$ = {np.degrees(drift) * 3600:.2g} °/h per g", GREEN),
    )
    return axes


def plot_resonant_accelerometer(axes: Axes | None = None) -> Axes:
    """A proof mass between two vibrating beams; acceleration to the right pulls one, pushes the other."""
    axes = _canvas(axes, (0, 12), (0, 4.0), 2.5)
    axes.add_patch(Rectangle((0.4, 0.5), 7.2, 3.0, fill=False, ec=INK, lw=2))
    axes.add_patch(Rectangle((3.2, 1.1), 1.6, 1.8, fc=THIRD, ec=INK, lw=1.2))
    axes.text(4.0, 2.0, "$m$", ha="center", va="center", fontsize=11)
    along = np.linspace(0, 1, 60)
    for start, end, colour, name in ((0.4, 3.2, RED, "$f_1$"), (7.6, 4.8, BLUE, "$f_2$")):
        x = start + (end - start) * along
        axes.plot(x, 2.0 + 0.0 * x, color=colour, lw=1.0, ls=":")
        for side in (-1, 1):
            axes.plot(x, 2.0 + 0.3 * side * np.sin(np.pi * along), color=colour, lw=1.8)
        axes.text((start + end) / 2, 2.65, name, color=colour, ha="center", fontsize=11)
    _arrow(axes, (3.2, 3.0), (4.8, 3.0), GREEN)
    axes.text(4.0, 3.22, "acceleration", color=GREEN, ha="center", va="center", fontsize=8)
    _per_line(
        axes,
        (8.0, 3.2),
        ("mass lags: beam 1 is pushed,", RED),
        ("$f_1$ falls", RED),
        ("beam 2 is pulled, $f_2$ rises", BLUE),
        ("reading: $f_2 - f_1$", INK),
    )
    return axes


def plot_magnetoresistive_bridge(axes: Axes | None = None) -> Axes:
    """Four strips of nickel–iron as a bridge; a field upwards turns their magnetisation.

    The circuit, not the layout: the strips lie side by side. The current is led across them at ±45°
    (barber poles): in two the magnetisation turns towards the current and the resistance grows, in two
    away from it.
    """
    axes = _canvas(axes, (0, 12), (0, 5.0), 3.0)
    nodes = {"top": (3.6, 4.6), "left": (1.0, 2.5), "right": (6.2, 2.5), "bottom": (3.6, 0.4)}
    for start, end, grows in (
        ("left", "top", True),
        ("top", "right", False),
        ("right", "bottom", True),
        ("bottom", "left", False),
    ):
        one, other = np.array(nodes[start]), np.array(nodes[end])
        axes.plot(*np.transpose([one, other]), color=INK, lw=1)
        middle, way = (one + other) / 2, (other - one) / np.hypot(*(other - one))
        strip = middle + np.outer([-0.8, 0.8], way)
        colour = RED if grows else BLUE
        axes.plot(*strip.T, color=colour, lw=9, solid_capstyle="butt")
        away = (middle - [3.6, 2.5]) / np.hypot(*(middle - [3.6, 2.5]))
        axes.text(*(middle + 0.7 * away), "$R + \\Delta R$" if grows else "$R - \\Delta R$",
                  color=colour, ha="left" if away[0] > 0 else "right", va="center", fontsize=9)  # fmt: skip
    for name in nodes:
        axes.plot(*nodes[name], "o", color=INK, ms=5)
    axes.text(3.9, 4.75, "supply $U$", fontsize=9, va="center")
    axes.text(3.9, 0.25, "ground", fontsize=9, va="center")
    axes.plot([1.0, 3.1], [2.5, 2.5], color=INK, lw=0.9)
    axes.plot([4.1, 6.2], [2.5, 2.5], color=INK, lw=0.9)
    axes.add_patch(Circle((3.6, 2.5), 0.5, fc="white", ec=INK, lw=1.3))
    axes.text(3.6, 2.5, "$V$", ha="center", va="center", fontsize=10)
    _arrow(axes, (7.5, 1.2), (7.5, 3.4), GREEN)
    axes.text(7.5, 3.7, "$B$", color=GREEN, ha="center", va="center", fontsize=11)
    _per_line(
        axes,
        (8.0, 3.8),
        ("magnetisation turns towards", RED),
        ("the current: resistance grows", RED),
        ("and away from it: falls", BLUE),
        ("$V = U\\,\\Delta R/R \\propto B$", INK),
    )
    return axes


def _per_line(axes: Axes, corner: tuple[float, float], *lines: tuple[str, str]) -> None:
    """Coloured words, one line below the other."""
    for k, (words, colour) in enumerate(lines):
        axes.text(corner[0], corner[1] - 0.62 * k, words, color=colour, fontsize=9, va="center")
