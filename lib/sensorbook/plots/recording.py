"""A recording over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from sensorbook import units
from sensorbook.plots.style import COLOURS, GREY, grid, new_axes

POINTS = 1200  # columns drawn; each shows the smallest and the largest of its samples


def plot_recording(recording, axes: Axes | None = None) -> Axes:
    """Each axis about its own median, in field units, as the envelope of its samples.

    A recording of an hour holds more samples than a screen has pixels: the envelope keeps every
    extreme that thinning would lose.
    """
    axes = new_axes(axes)
    label, si = units.field_unit(recording.sensor, "signal")
    time, unit = _time_axis(recording.time)
    median = np.nanmedian(recording.values, axis=0)
    shown = (recording.values - median) / si
    bands = [envelope(time, column) for column in shown.T]
    # The widest band first, so that it hides none of the others.
    for i in np.argsort([-np.nanmean(high - low) for _, low, high in bands]):
        name, (t, low, high) = "xyz"[i], bands[i]
        text = f"{name} (median {median[i] / si:.4g} {label})"
        axes.fill_between(t, low, high, color=COLOURS[name], alpha=0.7, linewidth=0.6, label=text)
    axes.set_xlabel(f"time [{unit}]")
    axes.set_ylabel(f"{recording.sensor} less median [{label}]")
    _keep_spikes_out(axes, shown)
    handles, labels = axes.get_legend_handles_labels()
    order = np.argsort(labels)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.12 * (high - low))  # room for the legend
    axes.legend(
        [handles[i] for i in order], [labels[i] for i in order],
        loc="upper right", fontsize=8, ncols=3,
    )  # fmt: skip
    axes.margins(x=0.01)
    grid(axes)
    return axes


def _keep_spikes_out(axes: Axes, values: np.ndarray) -> None:
    """Limits the axis to what the bulk of the samples needs, and says how far the rest reaches."""
    low, high = np.nanpercentile(values, [0.05, 99.95])
    margin = 0.3 * (high - low)
    least, largest = np.nanmin(values), np.nanmax(values)
    if largest - least > 4 * (high - low) > 0:
        axes.set_ylim(low - margin, high + 2 * margin)
        text = f"spikes beyond reach {least:.3g} … {largest:.3g}"
        axes.text(0.01, 0.02, text, transform=axes.transAxes, fontsize=8)


def plot_temperature(recordings, axes: Axes | None = None) -> Axes:
    """Temperature over time of one or several recordings."""
    axes = new_axes(axes, height=2.4)
    longest = max((r.time[-1] for r in recordings), default=0.0)
    _, unit = _time_axis(np.array([longest]))
    divide = {"s": 1.0, "min": 60.0, "h": 3600.0}[unit]
    colours = [GREY, *COLOURS.values()]
    for i, r in enumerate(recordings):
        t, low, high = envelope(r.time / divide, r.temperature)
        axes.plot(t, (low + high) / 2, color=colours[i % 4], label=f"run {i + 1}", linewidth=1.4)
    axes.set_xlabel(f"time [{unit}]")
    axes.set_ylabel("temperature [°C]")
    if len(recordings) > 1:
        axes.legend(fontsize=8)
    grid(axes)
    return axes


def envelope(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, smallest and largest y in up to `POINTS` stretches of equal count."""
    if len(x) <= POINTS:
        return x, y, y
    start = np.linspace(0, len(x), POINTS, endpoint=False).astype(int)
    return x[start], np.fmin.reduceat(y, start), np.fmax.reduceat(y, start)


def _time_axis(seconds: np.ndarray) -> tuple[np.ndarray, str]:
    longest = float(np.nanmax(seconds)) if len(seconds) else 0.0
    if longest > 7200:
        return seconds / 3600, "h"
    return (seconds / 60, "min") if longest > 300 else (seconds, "s")
