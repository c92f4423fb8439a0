"""What all figures share: size, colours that colour-blind readers can tell apart, grids."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogFormatter, LogLocator

# Okabe and Ito (2008): distinct for every common kind of colour vision, and in grey.
COLOURS = {"x": "#0072B2", "y": "#D55E00", "z": "#009E73"}
GREY, ACCENT, SECOND, THIRD = "#5A5A5A", "#CC79A7", "#E69F00", "#56B4E9"
LINES = {"x": "-", "y": "--", "z": "-."}
WIDTH, HEIGHT = 7.2, 3.9  # inches; a page's text is as wide


def new_axes(axes: Axes | None = None, height: float = HEIGHT) -> Axes:
    """The given Axes, or those of a new figure."""
    if axes is not None:
        return axes
    return plt.subplots(figsize=(WIDTH, height), layout="constrained")[1]


def new_row(count: int, height: float = HEIGHT, width: float = WIDTH, **kwargs) -> Sequence[Axes]:
    """Axes side by side in a new figure."""
    kwargs = {"sharey": True} | kwargs
    _, axes = plt.subplots(1, count, figsize=(width, height), layout="constrained", **kwargs)
    return np.atleast_1d(axes)


class _Plain(LogFormatter):
    """0.6 where matplotlib writes 6e-01."""

    def __call__(self, x, pos=None):
        return f"{x:g}" if super().__call__(x, pos) else ""


def log_log(axes: Axes) -> None:
    """Logarithmic axes with every decade and its parts gridded."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(LogLocator(subs=np.arange(2, 10), numticks=60))
        # Numbers between the decades where there are few of these.
        axis.set_minor_formatter(_Plain(labelOnlyBase=False, minor_thresholds=(2, 0.4)))
        axis.set_tick_params(which="minor", labelsize=7)
    axes.grid(which="major", color="#B8B8B8", linewidth=0.7)
    axes.grid(which="minor", color="#E6E6E6", linewidth=0.4)


def grid(axes: Axes) -> None:
    """A light grid on linear axes."""
    axes.grid(color="#DDDDDD", linewidth=0.6)


def labelled(axes: Axes, x: str, y: str, step: float | None = None) -> Axes:
    """Axes with their names and a grid; every `step` in x, and in y where the scales are equal."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if step:
        axes.xaxis.set_major_locator(plt.MultipleLocator(step))
        if axes.get_aspect() == 1.0:
            axes.yaxis.set_major_locator(plt.MultipleLocator(step))
    grid(axes)
    return axes
