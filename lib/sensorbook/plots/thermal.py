"""Figures of the thermal calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from sensorbook import units
from sensorbook.plots.style import ACCENT, COLOURS, GREY, SECOND, THIRD, grid, new_axes, new_row
from sensorbook.thermal import Sweep, ThermalFit

HEATING, COOLING = "#D55E00", "#0072B2"
DEGREE_STYLES = {1: (SECOND, ":"), 3: (THIRD, "--"), 5: (ACCENT, "-.")}


def plot_bias(
    sweep: Sweep, fit: ThermalFit, axis: str, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Bias against temperature with work A's polynomials and the chosen model; what each leaves.

    Left the change since the reference temperature, right the residuals after compensation.
    """
    axes = new_row(2, width=8.6, sharey=False) if axes is None else axes
    result, column = fit[axis], sweep.values[:, "xyz".index(axis)]
    label, si = units.field_unit(fit.sensor, "signal")
    t, model = sweep.temperature, result.model
    change = (column - np.array(result.offsets)[sweep.run]) / si
    order = np.linspace(*sweep.span, 400)
    left, right = axes
    for sign, colour, name in (
        (1, HEATING, "heating"),
        (-1, COOLING, "cooling"),
        (0, GREY, "soak"),
    ):
        here = sweep.direction == sign
        if here.any():
            left.plot(t[here], change[here], ".", color=colour, markersize=3, alpha=0.5, label=name)
    for degree, polynomial in result.polynomials.items():
        colour, style = DEGREE_STYLES[degree]
        # Placed to leave no mean residual against the chosen model's offsets.
        shift = np.average(change - polynomial.change(t) / si, weights=sweep.weight)
        left.plot(
            order,
            polynomial.change(order) / si + shift,
            style,
            color=colour,
            label=f"degree {degree}",
        )
        right.plot(
            *_smoothed(t, change - polynomial.change(t) / si - shift),
            style,
            color=colour,
            label=f"degree {degree}",
        )
    left.plot(order, model.change(order) / si, color="black", linewidth=1.2, label="chosen")
    right.plot(t, result.residual / si, ".", color=GREY, markersize=2, alpha=0.35)
    right.plot(*_smoothed(t, result.residual / si), color="black", linewidth=1.2, label="chosen")
    right.axhline(0, color="black", linewidth=0.6)
    left.set_ylabel(f"{axis}: change since {model.reference:g} °C [{label}]")
    right.set_ylabel(f"{axis}: after compensation [{label}]")
    for a in axes:
        a.set_xlabel("temperature [°C]")
        grid(a)
        a.legend(fontsize=7.5, ncols=2, markerscale=3)
    return axes


def plot_candidates(fit: ThermalFit, axes: Axes | None = None) -> Axes:
    """Held-out error of every candidate; the chosen one is filled."""
    axes = new_axes(axes, height=3.2)
    label, si = units.field_unit(fit.sensor, "signal")
    for axis, result in zip("xyz", fit.axes, strict=False):
        names = [c.name for c in result.candidates]
        error = np.array([c.rms_check for c in result.candidates]) / si
        axes.plot(names, error, "o-", color=COLOURS[axis], label=axis, markerfacecolor="white")
        i = next(i for i, c in enumerate(result.candidates) if c.rms_check == result.rms_check)
        axes.plot(names[i], error[i], "o", color=COLOURS[axis], markersize=9)
    axes.set_yscale("log")
    axes.set_ylabel(f"held-out rms [{label}]")
    axes.tick_params(axis="x", rotation=30)
    axes.legend(title="axis", fontsize=8)
    grid(axes)
    return axes


def plot_against_truth(fit: ThermalFit, truth: dict, axes: Sequence[Axes] | None = None):
    """Estimated minus true change of bias over the range, with the 95 % band, per axis."""
    axes = new_row(len(fit.axes), height=2.8, width=8.6, sharey=False) if axes is None else axes
    label, si = units.field_unit(fit.sensor, "signal")
    grid_t = np.array(truth["temperature"])
    for axis, a in zip("xyz", axes, strict=False):
        result = fit[axis]
        low, high = result.model.range
        t = np.linspace(low, high, len(result.half_width))
        bias = np.array(truth[fit.sensor][axis]["bias"])
        true = np.interp(t, grid_t, bias) - np.interp(result.model.reference, grid_t, bias)
        error = (result.model.change(t) - true) / si
        half = result.half_width / si
        a.fill_between(t, error - half, error + half, color=COLOURS[axis], alpha=0.25, linewidth=0)
        a.plot(t, error, color=COLOURS[axis])
        a.axhline(0, color="black", linewidth=0.6)
        a.set_title(axis, fontsize=9)
        a.set_xlabel("temperature [°C]")
        grid(a)
    axes[0].set_ylabel(f"estimate − truth [{label}]")
    return axes


def _smoothed(t: np.ndarray, y: np.ndarray, bins: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Means over bins of temperature, so that a residual's shape shows through its noise."""
    edges = np.linspace(t.min(), t.max(), bins + 1)
    at = np.clip(np.digitize(t, edges) - 1, 0, bins - 1)
    count = np.bincount(at, minlength=bins)
    full = count > 0
    mean = np.bincount(at, y, minlength=bins)[full] / count[full]
    return ((edges[1:] + edges[:-1]) / 2)[full], mean
