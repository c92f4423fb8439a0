"""Figures of the power spectral density; every density drawn is one-sided."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from sensorbook import Recording, units
from sensorbook.noise.model import TERMS
from sensorbook.noise.psd import SLOPES, PowerSpectrum
from sensorbook.noise.result import NoiseEstimate
from sensorbook.noise.shaping import ShapingFilter
from sensorbook.plots.allan import TERM_COLOURS
from sensorbook.plots.style import ACCENT, COLOURS, GREY, LINES, SECOND, grid, log_log, new_axes

POINTS = 1000  # columns in which the lines of a periodogram are drawn
PERIODS = 40  # of the cut-off frequency that a stretch in time shows


def plot_spectra(spectrum: PowerSpectrum, axes: Axes | None = None) -> Axes:
    """Averaged density of every axis with its 95 % band."""
    axes = new_axes(axes)
    si = _signal(spectrum.sensor)[1] ** 2
    limits = spectrum.limits() / si
    for i, (name, y) in enumerate(zip("xyz", spectrum.density.T, strict=False)):
        band = limits[:, i].T
        axes.fill_between(spectrum.frequency, *band, color=COLOURS[name], alpha=0.15, linewidth=0)
        axes.plot(
            spectrum.frequency, y / si, LINES[name], color=COLOURS[name], label=name, linewidth=1.3
        )
    _finish(axes, spectrum, spectrum.density)
    axes.legend(title="axis", fontsize=8, title_fontsize=8)
    return axes


def plot_periodogram(
    raw: PowerSpectrum,
    averaged: PowerSpectrum,
    welch: PowerSpectrum,
    axis: str,
    axes: Axes | None = None,
) -> Axes:
    """The lines of one axis, and what the two ways of averaging make of them."""
    axes = new_axes(axes)
    i, si = "xyz".index(axis), _signal(raw.sensor)[1] ** 2
    f, low, high = _extremes(raw.frequency, raw.density[:, i] / si)
    axes.fill_between(f, low, high, color="#BBBBBB", linewidth=0.7, label="single lines")
    axes.plot(
        averaged.frequency, averaged.density[:, i] / si, color=COLOURS["x"], linewidth=1.5,
        label="averaged over frequency",
    )  # fmt: skip
    f, low, high = _extremes(welch.frequency, welch.density[:, i] / si)
    axes.plot(f, np.sqrt(low * high), "--", color=COLOURS["y"], linewidth=1.3, label="Welch")
    _finish(axes, averaged, averaged.density[:, i], axis, room=(30, 30))
    axes.legend(fontsize=8)
    return axes


def plot_spectrum_read_off(
    spectrum: PowerSpectrum,
    estimate: NoiseEstimate,
    ranges: Mapping[str, slice],
    axis: str,
    axes: Axes | None = None,
) -> Axes:
    """One axis with work A's lines of slope 0, −1 and −2 and the middles of the ranges they are read in."""
    axes = new_axes(axes)
    i, si = "xyz".index(axis), _signal(spectrum.sensor)[1] ** 2
    f, y = spectrum.frequency, spectrum.density[:, i]
    band = spectrum.limits()[:, i].T / si
    axes.fill_between(f, *band, color=GREY, alpha=0.2, linewidth=0)
    axes.plot(f, y / si, color=GREY, linewidth=1.1, label="measured")
    for term, points in ranges.items():
        value, slope, colour = estimate.axes[i].terms[term].value, SLOPES[term], TERM_COLOURS[term]
        line = 2 * value**2 * (2 * np.pi * f) ** slope / si
        axes.plot(f, line, "--", color=colour, linewidth=1.0)
        shape = f"slope −{-slope}" if slope else "flat"
        label = f"{TERMS[term].symbol}, {shape}"
        axes.plot(f[points], line[points], color=colour, linewidth=2.6, alpha=0.75)
        middle = np.sqrt(f[points][0] * f[points][-1])
        level = 2 * value**2 * (2 * np.pi * middle) ** slope / si
        axes.plot(
            middle, level, "D", color=colour, markersize=7, markeredgecolor="white", label=label
        )
    _finish(axes, spectrum, y, axis)
    axes.legend(fontsize=8)
    return axes


def plot_filtered(
    recording: Recording, filtered: np.ndarray, axis: str, cutoff: float, axes: Axes | None = None
) -> Axes:
    """A short stretch from the middle of a recording, before and after a low-pass."""
    axes = new_axes(axes, height=2.9)
    label, si = _signal(recording.sensor)
    i, middle = "xyz".index(axis), len(recording) // 2
    half = int(np.clip(PERIODS / cutoff * recording.rate / 2, 20, 500))
    part = slice(max(middle - half, 0), middle + half)
    time = recording.time[part] - recording.time[part][0]
    level = np.mean(recording.values[part, i])
    axes.plot(
        time,
        (recording.values[part, i] - level) / si,
        color=GREY,
        linewidth=0.9,
        label="as recorded",
    )
    axes.plot(
        time, (filtered[part, i] - level) / si, color=COLOURS["y"], linewidth=1.8,
        label=f"below {cutoff:.3g} Hz",
    )  # fmt: skip
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{axis} less mean [{label}]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.18 * (high - low))  # room for the legend
    axes.legend(fontsize=8, loc="upper right", ncols=2)
    axes.margins(x=0.01)
    grid(axes)
    return axes


def plot_filtered_spectrum(
    before: PowerSpectrum, after: PowerSpectrum, axis: str, cutoff: float, axes: Axes | None = None
) -> Axes:
    """Density of one axis before and after a low-pass, over the three decades that it changes."""
    axes = new_axes(axes)
    i, si = "xyz".index(axis), _signal(before.sensor)[1] ** 2
    axes.plot(
        before.frequency, before.density[:, i] / si, color=GREY, linewidth=1.4, label="as recorded"
    )
    axes.plot(
        after.frequency, after.density[:, i] / si, "--", color=COLOURS["y"], linewidth=1.6,
        label=f"below {cutoff:.3g} Hz",
    )  # fmt: skip
    axes.axvline(cutoff, color=ACCENT, linewidth=1.2, linestyle=":", label="cut-off")
    _finish(axes, before, before.density[:, i], axis)
    shown = before.frequency > cutoff / 300
    level = np.median(before.density[shown & (before.frequency < cutoff), i]) / si
    axes.set_xlim(max(before.frequency[0], cutoff / 300), 1.1 * before.frequency[-1])
    axes.set_ylim(1e-4 * level, 30 * level)
    axes.legend(fontsize=8, loc="lower left")
    return axes


def plot_shaping(
    spectrum: PowerSpectrum,
    shaping: ShapingFilter,
    simulated: PowerSpectrum,
    axis: str,
    axes: Axes | None = None,
) -> Axes:
    """Measured density of one axis, that of its shaping filter, and that of what the filter simulates.

    `simulated` has one axis.
    """
    axes = new_axes(axes)
    i, si = "xyz".index(axis), _signal(spectrum.sensor)[1] ** 2
    f, y = spectrum.frequency, spectrum.density[:, i]
    axes.plot(f, y / si, color=GREY, linewidth=1.3, label="measured")
    axes.plot(
        simulated.frequency, simulated.density[:, 0] / si, color=SECOND, linewidth=1.1,
        label="simulated by the filter",
    )  # fmt: skip
    axes.plot(f, 2 * shaping.density(f) / si, color="black", linewidth=1.6, label="filter, |H|²")
    _finish(axes, spectrum, y, axis)
    axes.legend(fontsize=8)
    return axes


def _finish(axes: Axes, spectrum: PowerSpectrum, density, axis: str = "", room=(4, 4)) -> None:
    """Scales, labels, and limits that leave room for the bands but not for all their tails."""
    label, si = _signal(spectrum.sensor)
    log_log(axes)
    axes.set_xlim(spectrum.frequency[0] / 1.1, spectrum.frequency[-1] * 1.1)
    axes.set_ylim(density.min() / si**2 / room[0], density.max() / si**2 * room[1])
    axes.set_xlabel("frequency [Hz]")
    prefix = f"{axis}: " if axis else ""
    axes.set_ylabel(f"{prefix}density, one-sided [({label})²/Hz]")


def _signal(sensor: str) -> tuple[str, float]:
    return units.field_unit(sensor, "signal") if sensor else ("SI", 1.0)


def _extremes(f: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f, smallest and largest y in up to `POINTS` stretches of equal width in log f."""
    starts = np.unique(np.searchsorted(f, np.geomspace(f[0], f[-1], POINTS + 1)[:-1]))
    return f[starts], np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
