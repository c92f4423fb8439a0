"""Curves of what follows from how sensors work (chapter on sensor principles)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from sensorbook.plots.style import COLOURS, GREY, SECOND, THIRD, grid, log_log, new_axes

BLUE, RED, GREEN = COLOURS["x"], COLOURS["y"], COLOURS["z"]
CURVES = ((BLUE, "-"), (RED, "--"), (GREEN, "-."), (SECOND, (0, (1, 1))), (GREY, (0, (5, 1, 1, 1))))


def plot_response(
    split: ArrayLike, displacement: ArrayLike, chosen: tuple[float, float], axes: Axes | None = None
) -> Axes:
    """Sense displacement (m) of a MEMS gyroscope over the split (Hz) of its resonances."""
    axes = _log_log(axes)
    axes.plot(split, 1e12 * np.asarray(displacement), color=BLUE, lw=1.8)
    axes.plot(chosen[0], 1e12 * chosen[1], "o", color=RED, ms=7, label="this gyroscope")
    axes.set_xlabel("sense resonance above drive resonance [Hz]")
    axes.set_ylabel("sense displacement [pm]")
    axes.legend(fontsize=8)
    return axes


def plot_error_lines(
    true: ArrayLike, readings: Mapping[str, ArrayLike], axes: Axes | None = None
) -> Axes:
    """What each error adds: reading minus truth over the true rate, all in rad/s, drawn in °/s."""
    axes = new_axes(axes)
    true = np.asarray(true)
    for (name, reading), (colour, style) in zip(readings.items(), CURVES, strict=False):
        error = np.degrees(np.asarray(reading) - true)
        axes.plot(np.degrees(true), error, color=colour, ls=style, lw=1.8, label=name)
    axes.set_xlabel("true rate [°/s]")
    axes.set_ylabel("reading less true rate [°/s]")
    grid(axes)
    axes.legend(fontsize=8)
    return axes


def plot_growth(time: ArrayLike, errors: Mapping[str, ArrayLike], axes: Axes | None = None) -> Axes:
    """Position errors (m) over time (s), drawn in km over minutes."""
    axes = _log_log(axes)
    for (name, error), (colour, style) in zip(errors.items(), CURVES, strict=False):
        axes.plot(
            np.asarray(time) / 60,
            np.asarray(error) / 1000,
            color=colour,
            ls=style,
            lw=1.8,
            label=name,
        )
    # A Schuler oscillation comes back to zero: the axis begins where the errors do.
    axes.set_ylim(bottom=min(np.asarray(error)[0] for error in errors.values()) / 2000)
    axes.set_xlabel("time [min]")
    axes.set_ylabel("position error [km]")
    axes.legend(fontsize=8)
    return axes


def plot_radiance(
    wavelength: ArrayLike,
    radiances: Mapping[str, ArrayLike],
    band: tuple[float, float],
    axes: Axes | None = None,
) -> Axes:
    """Spectral radiances, W/m²/sr/m over the wavelength (m), drawn by the µm; a band (m) shaded."""
    axes = new_axes(axes)
    low, high = (1e6 * edge for edge in band)
    axes.axvspan(low, high, color=THIRD, alpha=0.3, lw=0, label=f"{low:.3g} to {high:.3g} µm")
    for (name, radiance), (colour, style) in zip(radiances.items(), CURVES, strict=False):
        axes.plot(
            1e6 * np.asarray(wavelength),
            1e-6 * np.asarray(radiance),
            color=colour,
            ls=style,
            lw=1.8,
            label=name,
        )
    axes.set_xlabel("wavelength [µm]")
    axes.set_ylabel("radiance [W/m²/sr/µm]")
    axes.set_ylim(bottom=0)
    grid(axes)
    axes.legend(fontsize=8)
    return axes


def _log_log(axes: Axes | None) -> Axes:
    """New or given axes, both logarithmic."""
    axes = new_axes(axes)
    log_log(axes)
    return axes
