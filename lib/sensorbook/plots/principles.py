"""Drawings of how sensors work (chapter on sensor principles).

They are to scale where their docstring says so; numbers in them are those given.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from numpy.typing import ArrayLike

from sensorbook.plots.style import COLOURS, GREY, THIRD, new_axes

BLUE, RED, GREEN = COLOURS["x"], COLOURS["y"], COLOURS["z"]
INK, PALE = "#222222", "#EDEDED"


def plot_accelerometer(displacement: float, gap: float, axes: Axes | None = None) -> Axes:
    """A proof mass on springs, its finger between two fixed plates, sensitive axis up.

    `displacement` of the mass against its frame and `gap` of the plates in m. The displacement is
    drawn larger, by the factor that is written beside it; what is up in the drawing is positive. One
    that the gap does not allow leaves the finger at the plate, and no reading.
    """
    axes = _canvas(axes, (0, 12), (0, 6.6), 3.7)
    stopped = abs(displacement) >= gap
    # The plates are 1 from the middle; they and the finger are 0.16 thick.
    drawn = float(np.sign(displacement)) * (0.84 if stopped else 0.45)
    axes.add_patch(Rectangle((1, 0.4), 6.6, 5.8, fill=False, ec=INK, lw=2))
    middle = 3.3 + drawn
    _spring(axes, (3, 6.2), (3, middle + 0.9))
    _spring(axes, (3, 0.4), (3, middle - 0.9))
    axes.add_patch(Rectangle((2.1, middle - 0.9), 1.8, 1.8, fc=THIRD, ec=INK, lw=1.2))
    axes.text(3, middle, "proof\nmass $m$", ha="center", va="center", fontsize=9)
    axes.add_patch(Rectangle((3.9, middle - 0.08), 2.7, 0.16, fc=BLUE, ec="none"))
    for place, name, side in ((4.3, "$C_1$", 1), (2.3, "$C_2$", -1)):
        axes.add_patch(Rectangle((4.6, place - 0.08), 3.0, 0.16, fc=RED, ec="none"))
        axes.text(5.2, place + 0.35 * side, name, ha="center", va="center", color=RED, fontsize=10)
    axes.plot([4.2, 7.4], [3.3, 3.3], color=GREY, lw=0.9, ls=(0, (4, 3)))
    _arrow(axes, (7.0, 3.3), (7.0, 4.22), GREY, style="<|-|>")
    axes.text(7.15, 3.78, "$d$", color=GREY, fontsize=10, va="center")
    _arrow(axes, (0.45, 2.2), (0.45, 4.4), GREEN)
    axes.text(0.45, 4.65, "+", color=GREEN, ha="center", fontsize=12)
    axes.text(0.45, 1.75, "axis", color=GREEN, ha="center", va="center", fontsize=9)
    moved = f"$x$ = {engineering(displacement, 'm')}"
    reading = f"$= x\\,/\\,d$ = {100 * displacement / gap:.3g} %".replace("-", "−")
    if stopped:
        moved = f"the force asks for\n{moved}:\nagainst the stop"
        reading = "no reading"
    elif displacement:
        moved += f"\n(drawn {0.45 * gap / abs(displacement):.2g} times larger)"
    for line, (words, colour) in enumerate(
        (
            (moved, BLUE),
            (f"$d$ = {engineering(gap, 'm')}", GREY),
            (f"$(C_1 - C_2)\\,/\\,(C_1 + C_2)$\n{reading}", RED),
        )
    ):
        axes.text(8.0, 5.2 - 1.7 * line, words, color=colour, fontsize=10, va="center")
    return axes


def plot_sagnac(rate: float, phase: float, axes: Axes | None = None) -> Axes:
    """Light both ways round a fibre coil that turns; `rate` in rad/s (counter-clockwise), `phase` in rad.

    Where the coupler is when the light is back is drawn far off where it was.
    """
    axes = _canvas(axes, (-5.2, 6.4), (-3.6, 2.7), 3.8)
    axes.add_patch(Circle((0, 0), 2.1, fill=False, ec=PALE, lw=16))
    moved = -90 + 20 * float(np.sign(rate))
    for radius, colour, first, last in ((2.25, BLUE, -90, moved + 360), (1.95, RED, 270, moved)):
        angle = np.radians(np.linspace(first, last, 200))
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=colour, lw=1.8)
        for at in (60, 130):
            _arrow(
                axes,
                *(radius * np.array([np.cos(a), np.sin(a)]) for a in angle[[at, at + 3]]),
                colour,
            )
    for where, edge, style in ((moved, GREY, "--"), (-90, INK, "-")):
        x, y = 2.1 * np.cos(np.radians(where)), 2.1 * np.sin(np.radians(where))
        axes.add_patch(
            Rectangle(
                (x - 0.35, y - 0.28), 0.7, 0.56, angle=where + 90, rotation_point="center",
                fc="white" if style == "-" else "none", ec=edge, ls=style, lw=1.6, zorder=3,
            )
        )  # fmt: skip
    _arrow(axes, (-1.7, -3.0), (-0.36, -2.3), INK)
    axes.text(-1.8, -3.05, "light source", ha="right", va="center", fontsize=9)
    _arrow(axes, (0, -2.4), (0, -3.05), INK)
    axes.text(0.15, -3.15, "detector", ha="left", va="center", fontsize=9)
    axes.text(0.6 if rate < 0 else -0.6, -1.55, "coupler", ha="center", va="center", fontsize=9)
    if rate:
        axes.text(
            1.6 * np.sign(rate),
            -2.35,
            "where it has got to",
            ha="left" if rate > 0 else "right",
            va="center",
            color=GREY,
            fontsize=9,
        )
        turn = np.radians(np.linspace(-60, 60, 40))[:: int(np.sign(rate))] + np.pi / 2
        axes.plot(1.1 * np.cos(turn), 1.1 * np.sin(turn), color=GREEN, lw=2)
        _arrow(axes, *(1.1 * np.array([np.cos(a), np.sin(a)]) for a in turn[[-2, -1]]), GREEN)
    axes.text(0, 0.2, "$\\Omega$", color=GREEN, ha="center", va="center", fontsize=13)
    one, other = ("longer", "shorter") if rate > 0 else ("shorter", "longer")
    if not rate:
        one = other = "same"
    for line, (words, colour) in enumerate(
        (
            (f"counter-clockwise: {one} way", BLUE),
            (f"clockwise: {other} way", RED),
            (f"$\\Omega$ = {np.degrees(rate) * 3600:.4g} °/h", GREEN),
            (f"$\\Delta\\varphi$ = {engineering(phase, 'rad')}", INK),
        )
    ):
        axes.text(3.0, 1.9 - 0.75 * line, words, color=colour, fontsize=10, va="center")
    return axes


def plot_resonator(turn: float, gain: float, axes: Axes | None = None) -> Axes:
    """Rim of a hemispherical resonator before and after a turn, rad: its vibration lags by `gain`·turn.

    Angles are to scale, seen from outside; the vibration is drawn large.
    """
    axes = _canvas(axes, (-4.6, 4.6), (-1.75, 1.75), 3.0)
    angle = np.linspace(0, 2 * np.pi, 400)
    for centre, body, wave, title in (
        (-2.5, 0.0, 0.0, "before"),
        (1.9, turn, (1 - gain) * turn, "after"),
    ):
        axes.add_patch(Circle((centre, 0), 1.1, fill=False, ec=GREY, lw=1, ls="--"))
        for sign, style in ((1, "-"), (-1, ":")):
            radius = 1.1 + 0.22 * sign * np.cos(2 * (angle - wave))
            axes.plot(
                centre + radius * np.cos(angle), radius * np.sin(angle), style, color=BLUE, lw=1.6
            )
        for at, colour, reach, style in ((body, RED, 1.5, "-"), (wave, BLUE, 1.5, "-.")):
            axes.plot(
                [centre, centre + reach * np.cos(at)],
                [0, reach * np.sin(at)],
                style,
                color=colour,
                lw=1.4,
            )
        axes.text(centre, -1.6, title, ha="center", va="center", fontsize=9)
    for at, colour, words in (
        (turn, RED, f"body: {np.degrees(turn):.3g}°"),
        ((1 - gain) * turn, BLUE, f"vibration: {np.degrees((1 - gain) * turn):.3g}°"),
    ):
        axes.text(
            1.9 + 1.58 * np.cos(at), 1.58 * np.sin(at), words, color=colour, va="center", fontsize=9
        )
    return axes


def plot_coriolis(velocity: float, rate: float, force: float, axes: Axes | None = None) -> Axes:
    """The vibrating mass of a MEMS gyroscope, as it moves to the right (+x); rate about z, out of the page.

    `velocity` in m/s, `rate` in rad/s, `force` along y in N, which −2m ω×v makes negative for a positive
    rate. Arrows give directions, not sizes.
    """
    axes = _canvas(axes, (0, 12), (0, 6.4), 3.7)
    axes.add_patch(Rectangle((0.5, 0.3), 6.6, 5.8, fill=False, ec=INK, lw=2))
    for one, other, colour in (
        ((0.5, 3.2), (2.8, 3.2), BLUE),
        ((7.1, 3.2), (4.8, 3.2), BLUE),
        ((3.8, 6.1), (3.8, 4.1), RED),
        ((3.8, 0.3), (3.8, 2.3), RED),
    ):
        _spring(axes, one, other, colour)
    axes.add_patch(Rectangle((2.8, 2.3), 2, 1.8, fc=PALE, ec=INK, lw=1.2))
    axes.text(3.35, 3.2, "$m$", ha="center", va="center", fontsize=11)
    _arrow(axes, (4.9, 3.85), (6.7, 3.85), BLUE)
    axes.text(5.8, 4.2, "$v$", color=BLUE, ha="center", fontsize=11)
    if force:
        down = force < 0
        _arrow(axes, (4.45, 2.2 if down else 4.2), (4.45, 0.7 if down else 5.7), RED)
        axes.text(4.7, 1.3 if down else 5.0, "$F_c$", color=RED, va="center", fontsize=11)
    axes.add_patch(Circle((4.3, 3.2), 0.24, fc="white", ec=GREEN, lw=1.6))
    if rate >= 0:
        axes.plot(4.3, 3.2, ".", color=GREEN, ms=5)
    else:
        axes.plot(4.3, 3.2, "x", color=GREEN, ms=7)
    axes.text(1.65, 2.45, "drive", color=BLUE, ha="center", fontsize=9)
    axes.text(3.35, 5.2, "sense", color=RED, ha="right", fontsize=9)
    for start, end, name, colour in (
        ((7.7, 0.6), (8.7, 0.6), "$x$", BLUE),
        ((7.7, 0.6), (7.7, 1.6), "$y$", RED),
    ):
        _arrow(axes, start, end, colour)
        axes.text(*(np.array(end) + 0.2), name, color=colour, va="center", fontsize=10)
    for line, (words, colour) in enumerate(
        (
            (f"$v$ = {engineering(velocity, 'm/s')}, at most", BLUE),
            (
                f"$\\Omega$ = {np.degrees(rate) * 3600:.4g} °/h, "
                + ("out of the page" if rate >= 0 else "into the page"),
                GREEN,
            ),
            (r"$F_c = -2m\,\omega\times v$", RED),
            (f"      = {engineering(force, 'N')}", RED),
        )
    ):
        axes.text(7.5, 5.5 - 0.9 * line, words, color=colour, fontsize=10, va="center")
    return axes


def plot_hall(current: float, field: float, voltage: float, axes: Axes | None = None) -> Axes:
    """A Hall plate from above: current (A) to the right, field (T) out of the page, voltage (V) across."""
    axes = _canvas(axes, (0, 12), (0, 5.0), 2.9)
    axes.add_patch(Rectangle((2.4, 1.2), 4.4, 2.4, fc=PALE, ec=INK, lw=1.4))
    for x in np.linspace(3.0, 6.2, 4):
        axes.add_patch(Circle((x, 3.05), 0.15, fc="white", ec=GREEN, lw=1.3))
        axes.plot(x, 3.05, "." if field >= 0 else "x", color=GREEN, ms=4)
    _arrow(axes, (0.6, 2.4), (2.3, 2.4), BLUE)
    _arrow(axes, (6.9, 2.4), (8.3, 2.4), BLUE)
    axes.text(1.4, 2.7, "$I$", color=BLUE, ha="center", fontsize=11)
    way = -1 if field < 0 else 1
    # Electrons run against the current; q v × B drives either sign of carrier to the same edge.
    path = np.linspace(0, 1, 40)
    axes.plot(6.5 - 3.6 * path, 2.35 - 0.85 * way * path**2, color=RED, lw=1.5)
    _arrow(axes, (3.1, 2.35 - 0.77 * way), (2.85, 2.35 - 0.88 * way), RED)
    axes.text(4.6, 2.4 - 0.45 * way, "electrons", color=RED, fontsize=9, ha="left", va="center")
    for y in (1.2, 3.6):
        axes.plot(4.6, y, "o", color=INK, ms=5)
    axes.plot([4.6, 4.6, 7.4], [3.6, 4.4, 4.4], color=INK, lw=1)
    axes.plot([4.6, 4.6, 7.4], [1.2, 0.5, 0.5], color=INK, lw=1)
    above = "+" if way > 0 else "−"
    axes.text(4.2, 3.95, above, ha="center", va="center", fontsize=13)
    axes.text(4.2, 0.8, "−" if way > 0 else "+", ha="center", va="center", fontsize=13)
    for y, name, value, unit, colour in (
        (4.4, "I", current, "A", BLUE),
        (3.5, "B", field, "T", GREEN),
        (1.3, "V_H", voltage, "V", INK),
    ):
        axes.text(
            8.5, y, f"${name}$ = {engineering(value, unit)}", color=colour, fontsize=10, va="center"
        )
    axes.text(7.55, 0.5, "voltmeter", fontsize=9, va="center")
    return axes


def plot_platform_and_strapdown(axes: np.ndarray | None = None) -> np.ndarray:
    """Two block diagrams: sensors on a gimballed platform, and sensors on the vehicle itself."""
    if axes is None:
        _, axes = plt.subplots(2, 1, figsize=(7.2, 4.6), layout="constrained")
    for a in axes:
        _canvas(a, (0, 14.4), (0, 4.2))
    top, bottom = axes
    top.set_title("stable platform: the gimbals do the turning", fontsize=10, loc="left")
    top.add_patch(Rectangle((0.2, 0.2), 3.3, 3.8, fc="white", ec=GREEN, lw=1.2, ls="--"))
    top.text(0.4, 3.62, "platform in gimbals", color=GREEN, fontsize=8.5, va="center")
    _box(top, (0.5, 2.0), 2.6, "gyroscopes", BLUE)
    _box(top, (4.5, 2.0), 2.4, "gimbal motors", GREEN)
    _box(top, (0.5, 0.45), 2.6, "accelerometers", RED)
    _box(top, (8.5, 0.45), 2.6, r"add $g$, $\int\!\!\int$", INK)
    _arrow(top, (3.1, 2.6), (4.5, 2.6), INK)
    top.plot([5.7, 5.7], [3.2, 3.7], color=INK, lw=1.6)
    _arrow(top, (5.7, 3.7), (3.5, 3.7), INK)
    top.text(5.9, 3.7, "turn it back", va="center", fontsize=8.5)
    _arrow(top, (3.1, 1.05), (8.5, 1.05), INK)
    top.text(5.9, 1.3, "already along north, east, down", ha="center", fontsize=8.5)
    _arrow(top, (11.1, 1.05), (11.9, 1.05), INK)
    top.text(12.0, 1.05, "velocity,\nposition", va="center", fontsize=9)
    _arrow(top, (6.9, 2.6), (11.9, 2.6), INK)
    top.text(12.0, 2.6, "attitude: the\ngimbals' angles", va="center", fontsize=9)
    bottom.set_title("strapdown: arithmetic does the turning", fontsize=10, loc="left")
    bottom.add_patch(Rectangle((0.2, 0.2), 3.3, 3.8, fc="white", ec=GREEN, lw=1.2, ls="--"))
    bottom.text(0.4, 3.62, "fixed to the vehicle", color=GREEN, fontsize=8.5, va="center")
    _box(bottom, (0.5, 2.0), 2.6, "gyroscopes", BLUE)
    _box(bottom, (4.5, 2.0), 2.4, r"$\int$ attitude", GREEN)
    _box(bottom, (0.5, 0.45), 2.6, "accelerometers", RED)
    _box(bottom, (4.5, 0.45), 2.4, "turn axes", GREEN)
    _box(bottom, (8.5, 0.45), 2.6, r"add $g$, $\int\!\!\int$", INK)
    _arrow(bottom, (3.1, 2.6), (4.5, 2.6), INK)
    _arrow(bottom, (3.1, 1.05), (4.5, 1.05), INK)
    _arrow(bottom, (5.7, 2.0), (5.7, 1.65), INK)
    _arrow(bottom, (6.9, 1.05), (8.5, 1.05), INK)
    _arrow(bottom, (11.1, 1.05), (11.9, 1.05), INK)
    bottom.text(12.0, 1.05, "velocity,\nposition", va="center", fontsize=9)
    _arrow(bottom, (6.9, 2.6), (11.9, 2.6), INK)
    bottom.text(12.0, 2.6, "attitude", va="center", fontsize=9)
    return axes


def plot_two_frames(angle: float, vector: ArrayLike, axes: Axes | None = None) -> Axes:
    """One vector (2,) of the reference frame, and a body frame turned by `angle`, rad, about z; to scale."""
    vector = np.asarray(vector, dtype=float)
    tips = [0.0, np.sin(angle), np.cos(angle), vector[1]]
    axes = _canvas(axes, (-1.6, 3.6), (1.4 * min(tips) - 0.2, 1.55), 3.1)
    for turn, colour, name in ((0.0, GREY, "ref"), (angle, BLUE, "body")):
        for axis, at in (("x", turn), ("y", turn + np.pi / 2)):
            way = np.array([np.cos(at), np.sin(at)])
            _arrow(axes, (0, 0), 1.15 * way, colour)
            axes.text(*(1.3 * way), f"${axis}_{{{name}}}$", color=colour, ha="center", va="center")
            foot = (vector @ way) * way
            axes.plot(*np.transpose([vector, foot]), color=colour, lw=0.9, ls=":")
    turn = np.linspace(0, angle, 40)
    axes.plot(0.4 * np.cos(turn), 0.4 * np.sin(turn), color=GREEN, lw=1.6)
    axes.plot([0, vector[0]], [0, vector[1]], color=RED, lw=2.2)
    axes.plot(*vector, "o", color=RED, ms=5)
    body = np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    ) @ vector  # fmt: skip
    for line, (words, colour) in enumerate(
        (
            (f"turn {np.degrees(angle):.4g}°", GREEN),
            (f"in ref: ({vector[0]:.3f}, {vector[1]:.3f})", GREY),
            (f"in body: ({body[0]:.3f}, {body[1]:.3f})", BLUE),
        )
    ):
        axes.text(
            1.75, 1.2 - 0.35 * line, words.replace("-", "−"), color=colour, fontsize=10, va="center"
        )
    return axes


def engineering(value: float, unit: str) -> str:
    """A number to three digits, with a prefix to the unit.

    >>> engineering(-1.55e-8, "m")
    '−15.5 nm'
    """
    if value == 0:
        return f"0 {unit}"
    power = int(np.clip(np.floor(np.log10(abs(value)) / 3 + 1e-9), -8, 3))
    number = f"{value / 1000.0**power:.3g}".replace("-", "−")
    return f"{number} {('yzafpnµm' + ' kMG')[power + 8].strip()}{unit}"


def _canvas(
    axes: Axes | None, across: tuple[float, float], up: tuple[float, float], height: float = 3.0
) -> Axes:
    """Axes without frame and ticks on which both directions have one scale."""
    axes = new_axes(axes, height)
    axes.set_aspect("equal")
    axes.set_xlim(*across)
    axes.set_ylim(*up)
    axes.set_axis_off()
    return axes


def _arrow(axes: Axes, start: ArrayLike, end: ArrayLike, colour: str, style: str = "-|>") -> None:
    axes.add_patch(
        FancyArrowPatch(
            tuple(start), tuple(end), arrowstyle=style, mutation_scale=12, color=colour, lw=1.6,
            shrinkA=0, shrinkB=0,
        )
    )  # fmt: skip


def _spring(axes: Axes, start: tuple, end: tuple, colour: str = GREY, turns: int = 5) -> None:
    """A zigzag from start to end, with straight ends."""
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    across = np.array([-(end - start)[1], (end - start)[0]]) / np.hypot(*(end - start))
    along = np.concatenate([[0], np.linspace(0.12, 0.88, 2 * turns + 1), [1]])
    side = np.concatenate([[0, 0], 0.22 * (-1.0) ** np.arange(2 * turns - 1), [0, 0]])
    points = start + np.outer(along, end - start) + np.outer(side, across)
    axes.plot(*points.T, color=colour, lw=1.3)


def _box(axes: Axes, corner: tuple[float, float], width: float, words: str, colour: str) -> None:
    axes.add_patch(Rectangle(corner, width, 1.2, fc=PALE, ec=colour, lw=1.5))
    axes.text(corner[0] + width / 2, corner[1] + 0.6, words, ha="center", va="center", fontsize=9)
