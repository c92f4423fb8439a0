"""Figures of attitude from vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.stats import chi2

from sensorbook.plots.style import (
    ACCENT,
    COLOURS,
    GREY,
    SECOND,
    THIRD,
    grid,
    log_log,
    new_axes,
    new_row,
)

PALETTE = (COLOURS["x"], COLOURS["y"], COLOURS["z"], SECOND, ACCENT, THIRD)
MOST_POINTS = 2000


def plot_what_one_leaves(
    first: np.ndarray,
    second: np.ndarray,
    angle: float,
    names: Sequence[str],
    axes: Axes | None = None,
) -> Axes:
    """The measured unit vectors (3,) in body axes, and where the first lets the second be.

    That is a circle `angle` (rad) about the first, the angle between the reference vectors.
    """
    if axes is None:
        figure = plt.figure(figsize=(5.6, 4.8), layout="constrained")
        axes = figure.add_subplot(projection="3d", computed_zorder=False)
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    ball = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    axes.plot_wireframe(*ball, color="#DDDDDD", linewidth=0.4)
    across = np.cross(first, second)
    across /= np.linalg.norm(across)
    round_it = np.linspace(0, 2 * np.pi, 200)[:, None]
    circle = np.cos(angle) * first + np.sin(angle) * (
        np.cos(round_it) * across + np.sin(round_it) * np.cross(first, across)
    )
    label = f"where the {names[0]} alone lets the {names[1]} be"
    axes.plot(*circle.T, color=GREY, linestyle="--", linewidth=1.4, label=label)
    for vector, colour, name in zip((first, second), PALETTE, names, strict=False):
        axes.quiver(0, 0, 0, *vector, color=colour, linewidth=2.2, arrow_length_ratio=0.12)
        axes.plot(*vector, "o", color=colour, ms=6, label=f"{name}, measured")
    for k, axis in enumerate("xyz"):
        axes.quiver(
            0, 0, 0, *(1.25 * np.eye(3)[k]), color="black", linewidth=0.8, arrow_length_ratio=0.06
        )
        axes.text(*(1.38 * np.eye(3)[k]), axis, fontsize=9)
    axes.set_aspect("equal")
    axes.set_box_aspect(None, zoom=1.25)
    axes.set_axis_off()
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    return axes


def plot_iterations(angles: Mapping[str, np.ndarray], axes: Axes | None = None) -> Axes:
    """Angle to the best attitude (rad) after each step, one curve a way of iterating."""
    axes = new_axes(axes)
    for (name, values), colour, mark in zip(angles.items(), PALETTE, "os^D", strict=False):
        axes.semilogy(
            np.degrees(np.maximum(values, 1e-16)), marker=mark, ms=4, color=colour, label=name
        )
    axes.set_xlabel("step")
    axes.set_ylabel("angle to the best attitude [°]")
    grid(axes)
    axes.legend(frameon=False)
    return axes


def plot_near_half_turn(
    off: np.ndarray, errors: Mapping[str, np.ndarray], axes: Axes | None = None
) -> Axes:
    """Error of the attitude (rad) against how far (rad) its rotation angle is from 180°."""
    axes = new_axes(axes)
    for (name, values), colour, mark in zip(errors.items(), PALETTE[::-2], "os^", strict=False):
        axes.plot(off, np.maximum(values, 1e-17), marker=mark, ms=4, color=colour, label=name)
    log_log(axes)
    axes.set_xlabel("rotation angle's distance from 180° [rad]")
    axes.set_ylabel("error of the attitude [rad]")
    axes.legend(frameon=False)
    return axes


def plot_accuracy(
    x: np.ndarray,
    curves: Mapping[str, tuple[np.ndarray, np.ndarray]],
    xlabel: str,
    logarithmic: bool,
    axes: Axes | None = None,
) -> Axes:
    """Rms angle errors (rad) against `x`: simulated as marks, predicted by the covariance as lines."""
    axes = new_axes(axes)
    for (name, (simulated, predicted)), colour, mark in zip(
        curves.items(), PALETTE, "os^Dv", strict=False
    ):
        axes.plot(x, np.degrees(predicted), color=colour, linewidth=1.4)
        axes.plot(x, np.degrees(simulated), mark, color=colour, ms=5, mfc="none", label=name)
    axes.set_yscale("log")
    if logarithmic:
        log_log(axes)
    grid(axes)
    axes.set_xlabel(xlabel)
    axes.set_ylabel("rms error of the attitude [°]")
    axes.legend(frameon=False, title="marks simulated, lines predicted", title_fontsize=8)
    return axes


def plot_errors(errors: np.ndarray, covariance: np.ndarray, axes: Sequence[Axes] | None = None):
    """Error vectors (N, 3), rad, in the planes of the body's axes, with the ellipse that holds 95 %."""
    axes = new_row(3, height=2.9, width=8.6, sharey=False) if axes is None else axes
    shown = np.degrees(errors[:: max(1, len(errors) // MOST_POINTS)])
    limit = 1.1 * np.abs(shown).max()
    turn = np.linspace(0, 2 * np.pi, 200)
    for a, (i, j) in zip(axes, ((0, 1), (1, 2), (2, 0)), strict=True):
        a.plot(
            shown[:, i], shown[:, j], ".", ms=2, color=PALETTE[0], alpha=0.5, mew=0, rasterized=True
        )
        root = np.linalg.cholesky(covariance[np.ix_((i, j), (i, j))])
        ellipse = np.sqrt(chi2.ppf(0.95, 2)) * root @ np.array([np.cos(turn), np.sin(turn)])
        a.plot(*np.degrees(ellipse), color=PALETTE[1], linewidth=1.5)
        a.set_aspect("equal")
        a.set_xlim(-limit, limit)
        a.set_ylim(-limit, limit)
        a.set_xlabel(f"error about {'xyz'[i]} [°]")
        a.set_ylabel(f"error about {'xyz'[j]} [°]")
        grid(a)
    return axes


def plot_misfits(chi_squared: Mapping[str, np.ndarray], axes: Axes | None = None) -> Axes:
    """How twice the loss is spread where σ is right (χ² with one degree of freedom), and where it is not."""
    axes = new_axes(axes)
    edges = np.linspace(0, 12, 49)
    for (name, values), colour in zip(chi_squared.items(), PALETTE, strict=False):
        axes.hist(
            np.minimum(values, 11.99), edges, density=True, histtype="step", color=colour, linewidth=1.6,
            label=name,
        )  # fmt: skip
    middle = (edges[1:] + edges[:-1]) / 2
    inside = np.diff(chi2.cdf(edges, 1)) / np.diff(edges)
    axes.plot(middle, inside, color=GREY, linestyle="--", label="χ², 1 degree of freedom")
    axes.set_yscale("log")
    axes.set_xlabel("twice the loss (12 and more in the last)")
    axes.set_ylabel("density")
    grid(axes)
    axes.legend(frameon=False)
    return axes


def plot_speed(seconds: Mapping[str, float], axes: Axes | None = None) -> Axes:
    """Time an epoch (s) of each method, as bars on a logarithmic axis."""
    axes = new_axes(axes, height=0.5 + 0.36 * len(seconds))
    names = list(seconds)
    axes.barh(names, [1e6 * seconds[name] for name in names], color=PALETTE[0])
    axes.set_xscale("log")
    axes.invert_yaxis()
    axes.set_xlabel("time an epoch [µs]")
    axes.grid(axis="x", color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    return axes
