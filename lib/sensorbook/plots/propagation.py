"""Figures of attitude from rates: what each way of integrating them loses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial.transform import Rotation

from sensorbook.attitude.propagation_study import RoundingDrift
from sensorbook.plots.attitude import VIEW
from sensorbook.plots.style import (
    ACCENT,
    COLOURS,
    GREY,
    LINES,
    SECOND,
    THIRD,
    WIDTH,
    labelled,
    log_log,
    new_axes,
    new_row,
)

PALETTE = (COLOURS["y"], SECOND, COLOURS["x"], COLOURS["z"], ACCENT, THIRD)
MARKS = "os^Dvx"
_SLAB = np.array([1.0, 0.65, 0.3])  # a book's half sizes along x, y, z
_LEAST = 1e-17  # what is 0 has no place on a logarithmic axis


def plot_tours(
    tours: Mapping[str, tuple[np.ndarray, np.ndarray]], axes: np.ndarray | None = None
) -> np.ndarray:
    """A body at each stop of some tours, one a row, and the integral of each of its rates there.

    `tours` are by name the integrals (K, 3), rad, and the attitudes (K, 4), reference → body.
    """
    stops = max(len(integral) for integral, _ in tours.values())
    if axes is None:
        shape = {"figsize": (WIDTH, 1.95 * len(tours)), "layout": "constrained"}
        axes = plt.subplots(len(tours), stops, squeeze=False, **shape)[1]
    for row, (name, (integrals, attitudes)) in zip(axes, tours.items(), strict=True):
        for one, integral, attitude in zip(row, integrals, attitudes, strict=False):
            _slab(one, Rotation.from_quat(attitude).as_matrix())
            sums = ", ".join(f"{v:.0f}°".replace("-", "−") for v in np.degrees(integral) + 0.0)
            one.set_title(sums, fontsize=8.5)
        row[0].text(-1.45, -1.75, name, fontsize=8.5, color=GREY)
    return axes


def plot_motion(
    time: np.ndarray, rate: np.ndarray, off: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Body rates (N, 3), rad/s, and under them an attitude's error (N,), rad, against time, s."""
    if axes is None:
        shape = {"figsize": (WIDTH, 4.6), "layout": "constrained", "sharex": True}
        axes = plt.subplots(2, 1, **shape)[1]
    for k, name in enumerate("xyz"):
        axes[0].plot(time, np.degrees(rate[:, k]), LINES[name], color=COLOURS[name], label=name)
    labelled(axes[0], "", "body rate [°/s]").legend(frameon=False, ncols=3, loc="upper right")
    axes[1].plot(time, np.degrees(off), color=GREY)
    labelled(axes[1], "time [s]", "error of the attitude [°]").set_ylim(bottom=0)
    return axes


def plot_lock_rates(
    time: np.ndarray, pitch: np.ndarray, rates: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Pitch (N,), rad, and the rates (N, 3) of roll, pitch and yaw, rad/s, as a body passes the lock."""
    axes = new_row(2, height=3.4, sharey=False) if axes is None else axes
    axes[0].plot(time, np.degrees(pitch), color=COLOURS["y"])
    axes[0].axhline(90, color=GREY, linestyle="--", linewidth=1)
    axes[0].text(time[0], 90.6, "lock", color=GREY, fontsize=8, va="bottom")
    labelled(axes[0], "time from the closest point [s]", "pitch [°]").set_ylim(top=97)
    for k, (name, axis) in enumerate(zip(("roll", "pitch", "yaw"), "xyz", strict=True)):
        style = {"color": COLOURS[axis], "linestyle": LINES[axis], "label": name}
        axes[1].plot(time, np.degrees(rates[:, k]), **style)
    labelled(axes[1], "time from the closest point [s]", "rate of the angle [°/s]")
    axes[1].legend(frameon=False)
    return axes


def plot_lock_loss(
    closest: np.ndarray,
    losses: Mapping[str, np.ndarray],
    at: float,
    axes: Axes | None = None,
) -> Axes:
    """What a pass by the lock costs (rad) against its closest approach (rad); `at` is the chapter's."""
    axes = new_axes(axes)
    for (name, loss), colour, mark in zip(losses.items(), PALETTE[::2], MARKS, strict=False):
        shown = np.degrees(np.maximum(loss, _LEAST))
        axes.plot(np.degrees(closest), shown, marker=mark, ms=4, color=colour, label=name)
    log_log(axes)
    axes.yaxis.set_minor_locator(plt.NullLocator())  # many decades
    axes.axvline(np.degrees(at), color=GREY, linestyle="--", linewidth=1.2, label="this chapter's")
    axes.axhline(1, color=GREY, linestyle=":", linewidth=1.2)
    axes.set_xlabel("closest approach to the lock [°]")
    axes.set_ylabel("error of the attitude after it [°]")
    axes.legend(frameon=False, fontsize=8.5)
    return axes


def plot_rounding(
    drifts: Mapping[str, RoundingDrift], axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """How far matrices are from orthogonal, and from the right attitude, against the steps made."""
    axes = new_row(2, height=3.9, sharey=False) if axes is None else axes
    for (name, drift), colour, line in zip(
        drifts.items(), PALETTE, ("-", "--", "-", "--"), strict=False
    ):
        steps = np.unique(np.geomspace(1, len(drift.angle) - 1, 200).astype(int))
        style = {"color": colour, "linestyle": line, "linewidth": 1.4}
        axes[0].plot(steps, np.maximum(drift.orthogonality[steps], _LEAST), label=name, **style)
        axes[1].plot(steps, np.degrees(np.maximum(drift.angle[steps], _LEAST)), **style)
    for one, what in zip(axes, ("largest element of A Aᵀ − I", "angle lost [°]"), strict=True):
        log_log(one)
        one.minorticks_off()  # fifteen decades
        one.set_xlabel("steps")
        one.set_ylabel(what)
    axes[0].figure.legend(frameon=False, fontsize=8.5, ncols=2, loc="outside upper center")
    return axes


def plot_error_by_rate(
    rate_hz: np.ndarray, errors: Mapping[str, np.ndarray], at: float, axes: Axes | None = None
) -> Axes:
    """Largest error of the attitude (rad) by the rate of the readings, a curve a way of integrating."""
    axes = new_axes(axes, height=4.6)
    for (name, error), colour, mark in zip(errors.items(), PALETTE, MARKS, strict=False):
        shown = np.degrees(np.maximum(error, _LEAST))
        axes.plot(rate_hz, shown, marker=mark, ms=4, color=colour, label=name)
    log_log(axes)
    axes.axvline(at, color=GREY, linestyle="--", linewidth=1.2)
    axes.yaxis.set_minor_locator(plt.NullLocator())  # many decades
    axes.set_xlabel("readings a second [Hz]")
    axes.set_ylabel("largest error of the attitude [°]")
    axes.figure.legend(frameon=False, fontsize=8.5, ncols=2, loc="outside upper center")
    return axes


def plot_cone(
    time: np.ndarray, integral: np.ndarray, about: np.ndarray, axes: Axes | None = None
) -> Axes:
    """Turn about the cone's axis (rad) against time, s: the integral of that rate, and the true one."""
    axes = new_axes(axes, height=3.0)
    axes.plot(
        time, np.degrees(integral), "--", color=PALETTE[0], label="integral of the body rate z"
    )
    axes.plot(time, np.degrees(about), color=PALETTE[2], label="the body")
    labelled(axes, "time [s]", "turned about the cone's axis [°]")
    axes.legend(frameon=False)
    return axes


def plot_coning(
    per_cycle: np.ndarray,
    measured: Mapping[str, np.ndarray],
    formula: Mapping[str, np.ndarray],
    at: float,
    axes: Axes | None = None,
) -> Axes:
    """Coning drift as a share of ½ sin²θ Ω, by readings a cycle: measured as marks, formulas as lines.

    `at` is the chapter's number of readings a cycle, marked where the curves reach it.
    """
    axes = new_axes(axes)
    for name, colour, mark in zip(measured, PALETTE[::2], MARKS, strict=False):
        axes.plot(per_cycle, np.maximum(formula[name], _LEAST), color=colour, linewidth=1.4)
        points = np.maximum(measured[name], _LEAST)
        axes.plot(per_cycle, points, mark, color=colour, ms=5, mfc="none", label=name)
    log_log(axes)
    if per_cycle[0] <= at <= per_cycle[-1]:
        axes.axvline(at, color=GREY, linestyle="--", linewidth=1.2)
    axes.set_xlabel("readings a round of the cone")
    axes.set_ylabel("drift / (½ sin²θ Ω)")
    axes.legend(frameon=False)
    return axes


def plot_delay(
    time: np.ndarray, error: np.ndarray, predicted: np.ndarray, axes: Axes | None = None
) -> Axes:
    """Error of the attitude (N,), rad, where readings are taken for late ones, and what is predicted."""
    axes = new_axes(axes, height=3.2)
    axes.plot(time, np.degrees(error), color=COLOURS["x"], linewidth=2, label="error")
    style = {"color": "black", "linestyle": ":", "linewidth": 1.6}
    axes.plot(time, np.degrees(predicted), label="half an interval × rate", **style)
    labelled(axes, "time [s]", "error of the attitude [°]").set_ylim(bottom=0)
    axes.legend(frameon=False)
    return axes


def _slab(axes: Axes, matrix: np.ndarray) -> None:
    """A book-shaped body whose faces +x, +y, +z are strong in colour; `matrix` is body → reference."""
    for k, name in enumerate("xyz"):
        for sign in (1.0, -1.0):
            if sign * VIEW(matrix[:, k])[2] <= 0:
                continue  # turned away
            corners = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1.0]])
            corners = np.roll(corners, k + 1, axis=1)
            corners[:, k] = sign
            points = VIEW((corners * _SLAB) @ matrix.T)[:, :2]
            alpha = 0.85 if sign > 0 else 0.3
            face = {"facecolor": COLOURS[name], "edgecolor": "white", "alpha": alpha}
            axes.add_patch(Polygon(points, linewidth=0.8, **face))
            style = {"color": "white" if sign > 0 else "black", "fontsize": 8}
            label = name if sign > 0 else f"−{name}"
            axes.text(*points.mean(axis=0), label, ha="center", va="center", **style)
    axes.set(xlim=(-1.45, 1.45), ylim=(-1.45, 1.45), aspect="equal")
    axes.set_axis_off()
