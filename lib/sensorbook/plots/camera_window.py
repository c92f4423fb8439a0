"""Work C's simulator as drawings: its blocks (figure 4.15) and its window (figure 4.14) at one setting."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

from sensorbook.camera.explorer import CAMERAS, LOOKS, Exploration
from sensorbook.camera.scene import HEIGHTS
from sensorbook.plots.camera import plot_baseline, plot_view
from sensorbook.plots.style import COLOURS, GREY

INK, PALE = "#222222", "#EEF1F4"
_C, _OURS = COLOURS["y"], COLOURS["x"]
_SHARED = GREY

# Blocks by name: middle (x, y), half width, words, and whose they are.
_BLOCKS = {
    "set": (
        1.1,
        3.0,
        1.0,
        "buttons and sliders:\norbit, place,\nyaw, pitch, roll,\ncameras",
        _SHARED,
    ),
    "sun view": (3.7, 4.0, 0.95, "picture of the\nSun camera", _SHARED),
    "earth view": (3.7, 2.3, 0.95, "picture of the\nEarth camera", _SHARED),
    "reference": (3.7, 0.6, 0.95, "reference vectors\nto Sun and Earth", _SHARED),
    "blob": (6.5, 4.75, 1.3, "brightest spot,\nvector, 1st matrix", _C),
    "chain": (
        6.5,
        3.32,
        1.3,
        "median, Canny, longest\nedge, ellipse, centre,\nvector, 2nd matrix",
        _C,
    ),
    "cone": (6.5, 1.7, 1.3, "edges, lines of sight,\ncone; disc of the Sun", _OURS),
    "triad": (9.2, 4.0, 0.8, "TRIAD", _C),
    "joint": (9.2, 1.7, 0.8, "limb and\nSun together", _OURS),
    "computed": (11.5, 3.0, 0.95, "computed angles\n(Hes)", _SHARED),
    "true": (11.5, 0.6, 0.95, "true angles\n(Ref)", _SHARED),
}
_ARROWS = (
    ("set", "sun view"), ("set", "earth view"), ("set", "reference"), ("sun view", "blob"),
    ("sun view", "cone"), ("earth view", "chain"), ("earth view", "cone"), ("blob", "triad"),
    ("chain", "triad"), ("cone", "joint"), ("triad", "computed"), ("joint", "computed"),
)  # fmt: skip


def plot_blocks(axes: Axes | None = None) -> Axes:
    """What follows from what in the simulator; C's own blocks orange, this house's blue."""
    if axes is None:
        axes = plt.subplots(figsize=(9.6, 4.2), layout="constrained")[1]
    axes.set(xlim=(0, 12.6), ylim=(-0.35, 5.4))
    axes.axis("off")
    for x, y, half, words, colour in _BLOCKS.values():
        tall = 0.22 + 0.17 * (words.count("\n") + 1)
        axes.add_patch(
            FancyBboxPatch(
                (x - half, y - tall), 2 * half, 2 * tall, boxstyle="round,pad=0,rounding_size=0.1",
                fc=PALE, ec=colour, lw=1.6,
            )
        )  # fmt: skip
        axes.text(x, y, words, ha="center", va="center", fontsize=8.5, color=INK)
    for start, end in _ARROWS:
        _to(axes, start, end)
    # The reference vectors go to both solvers, below the blocks between.
    x = 8.15
    for solver in ("triad", "joint"):
        y = _BLOCKS[solver][1]
        axes.plot([4.65, x, x], [0.6, 0.6, y - 0.12], color=GREY, lw=1.2)
        _arrow(axes, (x, y - 0.12), (8.4, y - 0.12))
    axes.plot([1.1, 1.1, 10.0, 10.0], [2.1, -0.2, -0.2, 0.6], color=GREY, lw=1.2)
    _arrow(axes, (10.0, 0.6), (10.55, 0.6))
    axes.annotate(
        "", xy=(11.5, 2.44), xytext=(11.5, 1.16),
        arrowprops={"arrowstyle": "<|-|>", "color": GREY, "lw": 1.2},
    )  # fmt: skip
    axes.text(11.6, 1.8, "errors", fontsize=8.5, va="center", color=INK)
    return axes


def _to(axes: Axes, start: str, end: str) -> None:
    (x, y, half, *_), (to_x, to_y, to_half, *_) = _BLOCKS[start], _BLOCKS[end]
    _arrow(axes, (x + half, y), (to_x - to_half, to_y))


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate(
        "", xy=end, xytext=start,
        arrowprops={"arrowstyle": "-|>", "color": GREY, "lw": 1.2, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


def plot_window(seen: Exploration) -> np.ndarray:
    """The window's controls at one setting, its numbers and its pictures: Axes (2, 2).

    Pictures are the Earth camera's, by C's chain and by limb and Sun together.
    """
    made = seen.settings
    _, grid = plt.subplots(2, 2, figsize=(9.6, 5.4), layout="constrained", height_ratios=(1, 1.25))
    _controls(seen, grid[0, 0])
    _numbers(seen, grid[0, 1])
    camera, image = made.earth_camera, seen.images[0]
    chain = seen.chain[0] if made.cameras == 1 else replace(seen.chain[0], sun_direction=None)
    sun = seen.found.sun if made.cameras == 1 else None
    plot_baseline(image, camera, chain, legend=False, axes=grid[1, 0])
    plot_view(image, camera, seen.found.limb, sun, legend=False, axes=grid[1, 1])
    for axes, way in zip(grid[1], ("work C's chain", "limb and Sun together"), strict=True):
        axes.set_title(way, fontsize=9)
        axes.tick_params(labelsize=7)
        axes.set(xlabel="", ylabel="")
    return grid


def _controls(seen: Exploration, axes: Axes) -> None:
    """Buttons, the pressed ones dark, and sliders at what is set."""
    made = seen.settings
    axes.set(xlim=(0, 10), ylim=(-0.6, 7.6))
    axes.axis("off")
    cameras = tuple(zip(CAMERAS, ("one", "two"), strict=True))
    rows = (
        ("orbit", [(o, o) for o in HEIGHTS], made.orbit),
        ("cameras", cameras, made.cameras),
        ("look", [(k, k) for k in LOOKS], made.look),
    )
    for y, (name, choices, chosen) in zip((7, 6, 5), rows, strict=True):
        axes.text(1.9, y, name, ha="right", va="center", fontsize=9)
        for k, (value, word) in enumerate(choices):
            on = value == chosen
            box = {"boxstyle": "round,pad=0.35", "fc": INK if on else PALE, "ec": GREY}
            axes.text(
                3.3 + 2.4 * k, y, f"{word:^8}", ha="center", va="center", fontsize=8,
                color="white" if on else INK, bbox=box,
            )  # fmt: skip
    values = np.degrees([made.place, *made.angles])
    sliders = zip(("place", "yaw", "pitch", "roll"), (180, 180, 90, 180), values, strict=True)
    for y, (name, most, value) in zip((4, 3, 2, 1), sliders, strict=True):
        turned = value if most == 90 else (value + 180) % 360 - 180
        axes.text(1.9, y, name, ha="right", va="center", fontsize=9)
        axes.plot([2.3, 8.3], [y, y], color=GREY, lw=2, solid_capstyle="round")
        axes.plot(5.3 + 3 * turned / most, y, "o", ms=8, color=_OURS, mec="white")
        axes.text(8.7, y, f"{turned:.1f}°".replace("-", "−"), va="center", fontsize=9)
    axes.text(
        5.3, 0, "Another attitude", ha="center", va="center", fontsize=8,
        bbox={"boxstyle": "round,pad=0.35", "fc": PALE, "ec": GREY},
    )  # fmt: skip


def _numbers(seen: Exploration, axes: Axes) -> None:
    axes.axis("off")
    frame = seen.to_frame()
    words = frame.map(lambda v: "–" if np.isnan(v) else f"{v:.3f}".replace("-", "−"))
    heads = ["true (Ref)", "C's chain (Hes)", "limb and Sun"]
    table = axes.table(
        words.to_numpy(), rowLabels=list(frame.index), colLabels=heads, loc="center",
        bbox=(0.3, 0.02, 0.7, 0.96),
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(8.5)
    for cell in table.get_celld().values():
        cell.set(edgecolor="#D0D0D0", linewidth=0.6)
