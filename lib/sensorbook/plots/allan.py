"""Figures of the Allan deviation."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from sensorbook import units
from sensorbook.noise import TERMS, AllanCurve, NoiseEstimate
from sensorbook.plots.style import ACCENT, COLOURS, GREY, LINES, SECOND, THIRD, log_log, new_axes

TERM_COLOURS = {
    "quantization": GREY,
    "random_walk": "#0072B2",
    "bias_instability": SECOND,
    "rate_random_walk": "#D55E00",
    "rate_ramp": ACCENT,
}


def plot_curves(
    curve: AllanCurve, estimate: NoiseEstimate | None = None, axes: Axes | None = None
) -> Axes:
    """Allan deviation of every axis, with its 95 % band where an estimate gives it."""
    axes = new_axes(axes)
    label, si = deviation_unit(curve.sensor)
    for i, (name, y) in enumerate(zip("xyz", curve.deviation.T, strict=False)):
        axes.plot(curve.tau, y / si, LINES[name], color=COLOURS[name], label=name)
        if estimate:
            low, high = estimate.axes[i].band.T / si
            axes.fill_between(curve.tau, low, high, color=COLOURS[name], alpha=0.18, linewidth=0)
    log_log(axes)
    axes.set_ylim(0.4 * curve.deviation.min() / si, 3 * curve.deviation.max() / si)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"Allan deviation σ [{label}]")
    axes.legend(title="axis", fontsize=8)
    return axes


def plot_terms(
    curve: AllanCurve, estimate: NoiseEstimate, axis: str, axes: Axes | None = None
) -> Axes:
    """The curve of one axis with the fitted sum and the terms it consists of."""
    axes = new_axes(axes)
    label, si = deviation_unit(curve.sensor)
    i = "xyz".index(axis)
    found, tau, y = estimate.axes[i], curve.tau, curve.deviation[:, i]
    low, high = found.band.T / si
    axes.fill_between(
        tau, low, high, color=GREY, alpha=0.25, linewidth=0, label="95 % of the curve"
    )
    axes.plot(tau, y / si, "o", color=GREY, markersize=3, label="measured")
    for name, term in TERMS.items():
        if found.terms[name]:
            part = found.terms[name].value * np.sqrt(term.variance(tau))
            text = f"{term.symbol}: {name.replace('_', ' ')}"
            axes.plot(tau, part / si, "--", color=TERM_COLOURS[name], linewidth=1.2, label=text)
    axes.plot(tau, np.sqrt(found.variance) / si, color="black", linewidth=1.5, label="sum of terms")
    if found.tau_range[0] > tau[0]:
        axes.axvspan(tau[0] * 0.9, found.tau_range[0], color=THIRD, alpha=0.15, linewidth=0)
    log_log(axes)
    axes.set_xlim(tau[0] * 0.9, tau[-1] * 1.15)
    axes.set_ylim(0.5 * y.min() / si, 2 * y.max() / si)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{axis}: Allan deviation σ [{label}]")
    axes.legend(fontsize=7.5, ncols=2)
    return axes


def plot_read_off(
    curve: AllanCurve, estimate: NoiseEstimate, axis: str, axes: Axes | None = None
) -> Axes:
    """The curve of one axis with work A's lines and the points at which they are read."""
    axes = new_axes(axes)
    label, si = deviation_unit(curve.sensor)
    i = "xyz".index(axis)
    tau, y = curve.tau, curve.deviation[:, i]
    axes.plot(tau, y / si, color=COLOURS[axis], linewidth=1.6, label="measured")
    for name, term in TERMS.items():
        found = estimate.axes[i].terms[name]
        if not found:
            continue
        line = found.value * np.sqrt(term.variance(tau))
        text = f"{term.symbol}, slope {term.slope:+g}"
        axes.plot(tau, line / si, "--", color=TERM_COLOURS[name], linewidth=1.1, label=text)
        at = term.read_at or tau[np.argmin(y)]
        value = found.value if term.read_at else y.min()
        axes.plot(at, value / si, "D", color=TERM_COLOURS[name], markersize=6)
    log_log(axes)
    axes.set_ylim(0.5 * y.min() / si, 2 * y.max() / si)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{axis}: Allan deviation σ [{label}]")
    axes.legend(fontsize=8)
    return axes


def deviation_unit(sensor: str) -> tuple[str, float]:
    return units.field_unit(sensor, "bias_instability") if sensor else ("SI", 1.0)
