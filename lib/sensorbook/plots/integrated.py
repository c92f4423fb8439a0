"""Figures of a device's trajectory: its rates, and how gyroscope and reference part."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from sensorbook.attitude.tuning import Disagreement
from sensorbook.plots.style import ACCENT, COLOURS, GREY, LINES, labelled, log_log, new_axes

MOST = 20_000  # points drawn of each line


def plot_rates(
    time: np.ndarray, rate: np.ndarray, at: np.ndarray, axes: Axes | None = None
) -> Axes:
    """Rates (N, 3), rad/s, over time (N,), s, and below them where references `at` (M,) are."""
    axes = new_axes(axes)
    every = slice(None, None, max(1, len(time) // MOST))
    degrees = np.degrees(rate)
    for k, axis in enumerate("xyz"):
        axes.plot(time[every], degrees[every, k], color=COLOURS[axis], lw=0.7, label=axis)
    low, high = np.quantile(degrees, [0.0005, 0.9995])
    room = 0.12 * (high - low)
    axes.set_ylim(low - 2 * room, high + room)
    there = np.full(len(time), np.nan)
    there[at] = low - 1.4 * room
    axes.plot(time, there, "|", color=GREY, ms=5, mew=0.6, label="references")
    axes.legend(ncols=4, fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.3)
    return labelled(axes, "time [s]", "rate [°/s]")


def plot_disagreement(found: Disagreement, axes: Axes | None = None) -> Axes:
    """By how much gyroscope and reference part over windows, and what the terms make of it."""
    axes = new_axes(axes)
    x = found.window
    axes.plot(x, np.degrees(found.rms), "o", color=COLOURS["x"], label="measured")
    axes.plot(x, np.degrees(found.explained), color="black", lw=1.6, label="all terms")
    parts = (
        (np.full(len(x), np.sqrt(2) * found.reference_std), "the reference's error", GREY, "--"),
        (found.random_walk * np.sqrt(x), "angle random walk", COLOURS["z"], LINES["z"]),
        (np.sqrt(found.motion_share) * np.sqrt(x), "while turning", COLOURS["y"], LINES["y"]),
        (
            found.rate_random_walk * x * (found.duration - x) / np.sqrt(6 * found.duration),
            "rate random walk",
            ACCENT,
            ":",
        ),
    )
    shown = np.degrees(found.rms).min() / 30
    for y, name, colour, line in parts:
        if np.degrees(y).max() > shown:
            axes.plot(x, np.degrees(y), line, color=colour, lw=1.3, label=name)
    log_log(axes)
    axes.set_ylim(bottom=shown)
    axes.legend(fontsize=8)
    axes.set_xlabel("window [s]")
    axes.set_ylabel("difference an axis, rms [°]")
    return axes


def plot_own_bias(
    time: np.ndarray, bias: np.ndarray, std: np.ndarray, axes: Axes | None = None
) -> Axes:
    """The bias (N, 3) that a filter found with ±1.96 of its `std` (N, 3), rad/s, over time (N,), s."""
    axes = new_axes(axes)
    every = slice(None, None, max(1, len(time) // MOST))
    time, bias, half = time[every], np.degrees(bias[every]), np.degrees(1.96 * std[every])
    for k, axis in enumerate("xyz"):
        axes.fill_between(
            time, bias[:, k] - half[:, k], bias[:, k] + half[:, k],
            color=COLOURS[axis], alpha=0.15, lw=0,
        )  # fmt: skip
        for edge in (bias[:, k] - half[:, k], bias[:, k] + half[:, k]):
            axes.plot(time, edge, ":", color=COLOURS[axis], lw=0.7)
        axes.plot(time, bias[:, k], LINES[axis], color=COLOURS[axis], lw=1.4, label=axis)
    # The band of the first seconds would hide all others.
    late = slice(len(time) // 8, None)
    low, high = np.nanmin((bias - half)[late]), np.nanmax((bias + half)[late])
    axes.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    axes.legend(ncols=3, fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.3)
    return labelled(axes, "time [s]", "bias [°/s]")
