"""Figures of a gyroscope aided by a reference: angles, errors, the filter's own covariance, outages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from sensorbook.attitude.experiment import KNOWN, Consistency, Growth
from sensorbook.plots.style import (
    ACCENT,
    COLOURS,
    GREY,
    LINES,
    SECOND,
    THIRD,
    WIDTH,
    grid,
    labelled,
    log_log,
    new_axes,
)

# What a reader calls a method, its colour, line and mark.
STYLES = {
    "integration": ("gyroscope alone", GREY, ":", "v"),
    "reset": ("work C: reset", COLOURS["y"], "-", "s"),
    "reset_and_rate": ("work C: reset and rate kept", SECOND, "--", "D"),
    "complementary": ("complementary filter", COLOURS["z"], "-.", "^"),
    "mekf": ("Kalman filter (MEKF)", COLOURS["x"], "-", "o"),
    KNOWN: ("Kalman filter that knows the bias", "black", ":", "x"),
    "smoother": ("smoother (RTS)", ACCENT, "--", "P"),
}
SHADE = 1.96  # standard errors: 95 %
_ANGLES = ("angle 1, roll", "angle 2, pitch", "angle 3, yaw")
_ABOVE = {"fontsize": 8, "loc": "lower right", "bbox_to_anchor": (1, 1), "borderaxespad": 0.3}
_TUNINGS = (COLOURS["x"], SECOND, ACCENT, COLOURS["z"])


def label(method: str) -> str:
    """What a reader calls a method."""
    return STYLES[method][0]


def _stack(axes: Sequence[Axes] | None, height: float) -> Sequence[Axes]:
    """Three Axes above each other, in a new figure where none are given."""
    if axes is not None:
        return axes
    kwargs = {"figsize": (WIDTH, height), "sharex": True, "layout": "constrained"}
    return plt.subplots(3, 1, **kwargs)[1]


def _draw(axes: Axes, time: np.ndarray, values: np.ndarray, *style: str, turn=np.inf, **looks):
    """A line through the known values of (N,), however seldom they are among NaN.

    It breaks where more than three of their usual spacings go without one, and where an angle passes
    half a `turn`; a point that stands alone between breaks is marked.
    """
    known = np.isfinite(values)
    time, values = time[known], values[known]
    step = np.diff(time)
    far = step > 3 * np.median(step) if len(step) else np.zeros(0, dtype=bool)
    breaks = np.flatnonzero(far | (np.abs(np.diff(values)) > turn / 2)) + 1
    (line,) = axes.plot(
        np.insert(time, breaks, time[breaks]), np.insert(values, breaks, np.nan), *style, **looks
    )
    ends = np.concatenate([[0], breaks, [len(time)]])
    alone = ends[:-1][np.diff(ends) == 1]
    axes.plot(time[alone], values[alone], ".", color=line.get_color(), ms=4)


def plot_angles(
    time: np.ndarray,
    true: np.ndarray,
    found: np.ndarray,
    names: tuple[str, str] = ("reference", "integrated"),
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Roll, pitch and yaw (N, 3), rad, true and found, against time (N,), s: C's figures 5.5 and 5.6.

    `names` are what the legend calls the two.
    """
    axes = _stack(axes, 5.0)
    for k, (a, name) in enumerate(zip(axes, _ANGLES, strict=True)):
        wide, thin = {"color": GREY, "lw": 2.6, "alpha": 0.55}, {"color": COLOURS["y"], "lw": 1.1}
        for angle, looks, called in zip((true, found), (wide, thin), names, strict=True):
            _draw(a, time, np.degrees(angle[:, k]), turn=360, label=called, **looks)
        a.set_ylabel(f"{name} [°]")
        grid(a)
    axes[0].legend(ncols=2, **_ABOVE)
    axes[-1].set_xlabel("time [s]")
    return axes


def plot_errors(
    time: np.ndarray,
    errors: np.ndarray,
    std: np.ndarray | None = None,
    names: Sequence[str] = _ANGLES,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Three errors (N, 3), rad, against time (N,), s, each within ±1.96 of its `std` (N, 3) where given."""
    axes = _stack(axes, 4.6)
    for k, (a, name) in enumerate(zip(axes, names, strict=True)):
        if std is not None:
            half = np.degrees(SHADE * std[:, k])
            a.fill_between(time, -half, half, color=THIRD, alpha=0.35, lw=0, label="±1.96 σ")
            a.set_ylim(*(1.6 * np.array([-1, 1]) * np.nanquantile(half[len(half) // 10 :], 0.98)))
        _draw(a, time, np.degrees(errors[:, k]), color=COLOURS["xyz"[k]], lw=0.9)
        a.axhline(0, color=GREY, lw=0.6)
        a.set_ylabel(f"{name} [°]")
        grid(a)
    if std is not None:
        axes[0].legend(**_ABOVE)
    axes[-1].set_xlabel("time [s]")
    return axes


def plot_outage(
    time: np.ndarray,
    totals: Mapping[str, np.ndarray],
    outage: Sequence[float],
    quantity: str = "rms error",
    axes: Axes | None = None,
) -> Axes:
    """Errors (N,), rad, by method through an outage, s; logarithmic, as they differ so.

    `quantity` names them on the axis: "error" where they are those of a single recording.
    """
    axes = new_axes(axes)
    axes.axvspan(*outage, color="#EEEEEE", label="no reference")
    shown = (time >= outage[0] - 6) & (time <= outage[1] + 6)
    for method, total in totals.items():
        name, colour, line, _ = STYLES[method]
        degrees = np.degrees(total[shown])
        _draw(axes, time[shown], degrees, line, color=colour, lw=1.5, label=name)
    axes.set_yscale("log")
    # At a reference an error is next to nothing for one sample.
    usual = np.degrees(np.nanmedian([total[shown] for total in totals.values()]))
    axes.set_ylim(bottom=usual / 30)
    axes.legend(fontsize=8)
    labelled(axes, "time [s]", f"{quantity} [°]")
    axes.grid(which="minor", color="#EEEEEE", linewidth=0.4)
    return axes


def plot_bias(
    time: np.ndarray,
    bias: np.ndarray,
    std: np.ndarray,
    true: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """A filter's bias (N, 3) with ±1.96 of its `std` (N, 3), and the true one (3,), rad/s."""
    axes = new_axes(axes)
    bias, half, true = (np.degrees(v) for v in (bias, SHADE * std, true))
    for k, axis in enumerate("xyz"):
        colour = COLOURS[axis]
        low, high = bias[:, k] - half[:, k], bias[:, k] + half[:, k]
        axes.fill_between(time, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(time, bias[:, k], LINES[axis], color=colour, lw=1.5, label=f"{axis}, found")
        axes.axhline(true[k], color=colour, lw=0.9, ls=":")
    late = slice(len(time) // 15, None)  # the first second's band would hide the rest
    axes.set_ylim((bias - half)[late].min(), (bias + half)[late].max())
    axes.legend(ncols=3, **_ABOVE)
    return labelled(axes, "time [s]", "bias [°/s]")


def plot_consistency(
    time: np.ndarray, found: Mapping[str, Consistency], axes: Axes | None = None
) -> Axes:
    """Normalised error squared (N,), mean over runs, of filters by name, and its 95 % bounds."""
    axes = new_axes(axes)
    one = next(iter(found.values()))
    axes.axhspan(one.low, one.high, color="#E4E4E4", label="95 % bounds")
    axes.axhline(3, color=GREY, lw=0.8)
    for colour, (name, each) in zip(_TUNINGS, found.items(), strict=False):
        axes.plot(time, each.nees, color=colour, lw=0.9, label=name)
    axes.set_yscale("log")
    axes.legend(ncols=4, **_ABOVE)
    labelled(axes, "time [s]", "normalised error squared")
    return axes


def plot_growth(time: np.ndarray, found: Mapping[str, Growth], axes: Axes | None = None) -> Axes:
    """Rms errors and their predictions (N,), rad, without references, by what is known of the bias."""
    axes = new_axes(axes)
    for colour, (name, each) in zip(_TUNINGS, found.items(), strict=False):
        axes.plot(time[1:], np.degrees(each.rms[1:]), color=colour, lw=1.8, label=name)
        predicted = np.degrees(each.predicted[1:])
        axes.plot(time[1:], predicted, "--", color="black", lw=1.0)
    axes.plot([], [], "--", color="black", lw=1.0, label="predicted by the covariance")
    log_log(axes)
    axes.legend(fontsize=8)
    axes.set_xlabel("time since the only reference [s]")
    axes.set_ylabel("rms error [°]")
    return axes


def plot_by_rate(
    rates: Sequence[float],
    errors: Mapping[str, Sequence[float]],
    printed: Sequence[float] | None = None,
    angle: str = "mean error of the three angles",
    axes: Axes | None = None,
) -> Axes:
    """Mean errors, rad, by reference rate, Hz, of each method; `printed` are work C's own, deg."""
    axes = new_axes(axes, 4.4)
    for method, error in errors.items():
        name, colour, line, mark = STYLES[method]
        y = np.degrees(error)
        axes.plot(rates, y, line, color=colour, marker=mark, ms=5, lw=1.4, label=name)
    if printed is not None:
        style = {"ms": 11, "mfc": "none", "mec": "black", "mew": 1.2}
        axes.plot(rates, printed, "o", label="printed by work C", **style)
    log_log(axes)
    axes.legend(fontsize=8)
    axes.set_xlabel("references a second [Hz]")
    axes.set_ylabel(f"{angle} [°]")
    return axes


def plot_by_reference(
    sizes: Sequence[float], errors: Mapping[str, Sequence[float]], axes: Axes | None = None
) -> Axes:
    """Mean errors of the whole angle by a reference's own standard error an axis, all in rad."""
    axes = new_axes(axes)
    x = np.degrees(sizes)
    for method, error in errors.items():
        name, colour, line, mark = STYLES[method]
        axes.plot(x, np.degrees(error), line, color=colour, marker=mark, ms=5, lw=1.4, label=name)
    # The mean length of a vector of three normal components is √(8/π) of one's deviation.
    axes.plot(x, np.sqrt(8 / np.pi) * x, color=GREY, lw=0.9, ls="--", label="the reference itself")
    log_log(axes)
    axes.legend(fontsize=8)
    axes.set_xlabel("a reference's standard error about each axis [°]")
    axes.set_ylabel("mean error [°]")
    return axes
