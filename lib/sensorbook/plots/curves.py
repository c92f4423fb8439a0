"""Figures of curves fitted to the Allan deviation and of the slopes found on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from sensorbook import units
from sensorbook.noise.allan import AllanCurve
from sensorbook.noise.curves import FINE, Comparison, CurveFit
from sensorbook.noise.model import TERMS
from sensorbook.noise.slopes import Slopes
from sensorbook.plots.allan import TERM_COLOURS
from sensorbook.plots.style import ACCENT, COLOURS, GREY, LINES, SECOND, log_log, new_axes

SLOPE_NAMES = {-1.0: "−1", -0.5: "−½", 0.0: "0", 0.5: "+½", 1.0: "+1"}
# One way of drawing for each of the fits in a figure, distinct without colour as well.
STYLES = (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", "-."), (ACCENT, ":"), (SECOND, "-"))


def plot_fits(
    compared: Comparison, fits: Sequence[CurveFit], sensor: str, axes: Axes | None = None
) -> Axes:
    """The curve of one axis and some fits, evaluated between the points as well.

    The scale is the curve's. Where a fit is not positive, a bar at the lower edge stands for it.
    """
    axes = new_axes(axes)
    label, si = units.field_unit(sensor, "bias_instability") if sensor else ("SI", 1.0)
    tau = np.geomspace(compared.tau[0], compared.tau[-1], FINE)
    missing = False
    for row, (fit, (colour, line)) in enumerate(zip(fits, STYLES, strict=False)):
        sigma = fit.deviation(tau)
        inside = np.isfinite(sigma) & (sigma > 0)
        axes.plot(
            tau,
            np.where(inside, sigma, np.nan) / si,
            line,
            color=colour,
            linewidth=1.4,
            label=fit.label,
        )
        if not inside.all():
            missing = True
            axes.fill_between(
                tau,
                0.025 * row,
                0.025 * row + 0.018,
                where=~inside,
                color=colour,
                linewidth=0,
                transform=axes.get_xaxis_transform(),
            )
    axes.plot(
        compared.tau, compared.sigma / si, "o", color="black", markersize=3, label="Allan deviation"
    )
    log_log(axes)
    axes.set_ylim(0.25 * compared.sigma.min() / si, 2.5 * compared.sigma.max() / si)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{compared.axis}: Allan deviation σ [{label}]")
    title = "bars below: fit ≤ 0" if missing else None
    axes.legend(fontsize=8, title=title, title_fontsize=8, loc="lower left")
    return axes


def plot_fit_residuals(
    compared: Comparison, fits: Sequence[CurveFit], axes: Axes | None = None
) -> Axes:
    """What fits of one axis miss, in decades, beside the 95 % band of the curve itself."""
    axes = new_axes(axes)
    tau, sigma = compared.tau, compared.sigma
    low, high = np.log10(compared.band.T / sigma)
    label = "95 % of the curve"
    axes.fill_between(tau, low, high, color=GREY, alpha=0.22, linewidth=0, label=label)
    residuals = [fit.residual(tau, sigma) for fit in fits]
    for fit, residual, (colour, line) in zip(fits, residuals, STYLES, strict=False):
        axes.plot(tau, residual, line, color=colour, linewidth=1.3, label=fit.label)
    axes.axhline(0, color="black", linewidth=0.7)
    axes.set_xscale("log")
    # A fit that misses by more than this is shown to leave, not to set the scale.
    reach = np.nanmax(np.abs(np.concatenate(residuals)))
    axes.set_ylim(*(np.array([-1.2, 1.2]) * min(reach, 0.25)))
    axes.grid(which="major", color="#B8B8B8", linewidth=0.7)
    axes.grid(which="minor", axis="x", color="#E6E6E6", linewidth=0.4)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{compared.axis}: fit over curve [decades]")
    # above the data: the fits may be anywhere
    axes.legend(fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return axes


def plot_slopes(curve: AllanCurve, slopes: Slopes, axes: Axes | None = None) -> Axes:
    """The curve of one axis, the ranges found on it and the line of each range's slope."""
    axes = new_axes(axes)
    label, si = units.field_unit(curve.sensor, "bias_instability") if curve.sensor else ("SI", 1.0)
    y = curve.deviation[:, "xyz".index(slopes.axis)] / si
    axes.plot(curve.tau, y, color=COLOURS[slopes.axis], linewidth=1.6, label="Allan deviation")
    for found in slopes.ranges:
        colour = TERM_COLOURS[found.term]
        axes.axvspan(found.tau_low, found.tau_high, color=colour, alpha=0.13, linewidth=0)
        ends = np.array([found.tau_low / 2, found.tau_high * 2])
        name = f"{SLOPE_NAMES[found.slope]}: {found.term.replace('_', ' ')}"
        axes.plot(ends, found.line(ends) / si, "--", color=colour, linewidth=1.3, label=name)
        axes.text(
            np.sqrt(found.tau_low * found.tau_high),
            0.96,
            SLOPE_NAMES[found.slope],
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=13,
            color="#333333",
        )
    log_log(axes)
    axes.set_xlim(curve.tau[0] * 0.9, curve.tau[-1] * 1.15)
    axes.set_ylim(0.5 * y.min(), 4 * y.max())
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{slopes.axis}: Allan deviation σ [{label}]")
    axes.legend(fontsize=8, loc="lower left")
    return axes


def plot_local_slopes(found: Sequence[Slopes], axes: Axes | None = None) -> Axes:
    """Slope of each axis's smooth curve with its 95 % band; the nominal slopes are labelled."""
    axes = new_axes(axes)
    for one in found:
        slope, reach = one.smooth.slope(one.tau), 1.96 * one.smooth.slope_std(one.tau)
        colour = COLOURS[one.axis]
        axes.plot(one.tau, slope, LINES[one.axis], color=colour, label=one.axis)
        axes.fill_between(
            one.tau, slope - reach, slope + reach, color=colour, alpha=0.15, linewidth=0
        )
    axes.set_xscale("log")
    axes.set_yticks(
        [t.slope for t in TERMS.values()], [SLOPE_NAMES[t.slope] for t in TERMS.values()]
    )
    axes.set_ylim(-1.2, 1.2)
    axes.grid(which="major", color="#B8B8B8", linewidth=0.7)
    axes.grid(which="minor", axis="x", color="#E6E6E6", linewidth=0.4)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel("slope d log σ / d log τ [1]")
    axes.legend(title="axis", fontsize=8, loc="upper left")
    return axes
