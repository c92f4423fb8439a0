"""Figures with axes of what follows from how sensors work (chapter on sensor principles)."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import ArrayLike

from sensorbook.plots.style import COLOURS, GREY, SECOND, THIRD, grid, log_log, new_axes

INK = "#222222"
BLUE, RED, GREEN = COLOURS["x"], COLOURS["y"], COLOURS["z"]
CURVES = ((BLUE, "-"), (RED, "--"), (GREEN, "-."), (SECOND, (0, (1, 1))), (GREY, (0, (5, 1, 1, 1))))


def plot_field_vector(field: ArrayLike, axes: np.ndarray | None = None) -> np.ndarray:
    """The Earth's field (3,), T, north, east, down: from above with declination, from the side with dip.

    Both views are to scale, each with axes in µT.
    """
    north, east, down = 1e6 * np.asarray(field, dtype=float)
    level = np.hypot(north, east)
    if axes is None:
        _, axes = plt.subplots(1, 2, figsize=(7.2, 3.7), layout="constrained")
    reach = 1.25 * max(level, abs(down))
    for a, (right, up), x, y, title in (
        (axes[0], (east, north), "east [µT]", "north [µT]", "from above"),
        (axes[1], (level, down), "towards magnetic north [µT]", "down [µT]", "from the side"),
    ):
        a.set_title(title, fontsize=9)
        a.set_xlabel(x)
        a.set_ylabel(y)
        a.set_aspect("equal")
        a.set_xlim(-0.55 * reach, reach)
        a.set_ylim(-0.55 * reach, reach)
        grid(a)
        a.axhline(0, color=GREY, lw=0.8)
        a.axvline(0, color=GREY, lw=0.8)
        a.plot([0, right], [0, up], color=BLUE, lw=2.2)
        a.plot(right, up, "o", color=BLUE, ms=5)
    axes[0].set_xlim(-0.775 * reach, 0.775 * reach)
    if north < 0:
        axes[0].set_ylim(-reach, 0.55 * reach)
    low, high = (-0.55 * reach, reach) if down >= 0 else (-reach, 0.55 * reach)
    axes[1].set_ylim(high, low)  # down is down
    declination, dip = np.arctan2(east, north), np.arctan2(down, level)
    turn = np.linspace(0, declination, 50)
    axes[0].plot(0.6 * level * np.sin(turn), 0.6 * level * np.cos(turn), color=RED, lw=1.8)
    turn = np.linspace(0, dip, 50)
    axes[1].plot(0.5 * level * np.cos(turn), 0.5 * level * np.sin(turn), color=RED, lw=1.8)
    for a, name, value in ((axes[0], "declination", declination), (axes[1], "dip", dip)):
        a.text(
            0.03,
            0.04,
            f"{name} {np.degrees(value):+.1f}°",
            transform=a.transAxes,
            color=RED,
            fontsize=10,
        )
    return axes


def plot_limb_scan(
    angular_radius: float, cone: float, tilt: float, axes: Axes | None = None
) -> Axes:
    """The Earth's disc as a satellite sees it, and the circle that a conical scan draws over it.

    All in rad: the disc's angular radius, the cone's half angle, the scan axis' angle from the nadir.
    The distance from the middle is the angle from the nadir, to scale.
    """
    axes = new_axes(axes, 4.4)
    reach = np.degrees(max(angular_radius, tilt + cone)) * 1.15
    axes.add_patch(
        Circle((0, 0), np.degrees(angular_radius), fc="#DCEBF5", ec=BLUE, lw=1.6, label="Earth")
    )
    turn = np.linspace(0, 2 * np.pi, 1441)
    about = np.array([np.sin(tilt), 0, np.cos(tilt)])
    first, second = np.array([-np.cos(tilt), 0, np.sin(tilt)]), np.array([0, 1, 0])
    lines = np.cos(cone) * about + np.sin(cone) * (
        np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
    )
    away = np.degrees(np.arccos(np.clip(lines[:, 2], -1, 1)))
    azimuth = np.arctan2(lines[:, 1], lines[:, 0])
    x, y = away * np.cos(azimuth), away * np.sin(azimuth)
    inside = away < np.degrees(angular_radius)
    for part, colour, style, label in (
        (inside, RED, "-", "scan over the Earth"),
        (~inside, GREY, "--", "scan over space"),
    ):
        axes.plot(
            np.where(part, x, np.nan), np.where(part, y, np.nan), style, color=colour, lw=2, label=label
        )  # fmt: skip
    ends = np.nonzero(np.diff(inside.astype(int)))[0]
    axes.plot(x[ends], y[ends], "o", color=INK, ms=7, label="limb crossing")
    axes.plot(0, 0, "+", color=BLUE, ms=10, label="nadir")
    axes.plot(np.degrees(tilt), 0, "x", color=GREY, ms=8, label="scan axis")
    axes.set_aspect("equal")
    axes.set_ylim(-reach, reach)
    axes.set_xlim(-np.degrees(angular_radius) * 1.15, reach)
    axes.set_xlabel("angle from the nadir, towards the scan axis [°]")
    axes.set_ylabel("angle from the nadir, across [°]")
    grid(axes)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5))
    return axes


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
