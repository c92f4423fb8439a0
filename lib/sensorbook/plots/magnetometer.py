"""Figures of a magnetometer's calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import cKDTree

from sensorbook.magnetometer.alignment import Alignment, Heading
from sensorbook.magnetometer.coverage import NEAR, even_directions
from sensorbook.magnetometer.min_max import PLANES
from sensorbook.magnetometer.result import MICROTESLA, MagnetometerCalibration
from sensorbook.plots.style import GREY, SECOND, THIRD, grid, new_row

BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
MOST_POINTS = 3000  # of a scatter; more only cover each other


def plot_axis_pairs(
    stages: Mapping[str, np.ndarray], field: float, axes: np.ndarray | None = None
) -> np.ndarray:
    """Readings (N, 3), T, in A's three plots y–z, z–x and x–y; one row of them for each stage.

    Each stage's cross marks the origin, its circle a sphere of radius `field` (T) about it.
    """
    if axes is None:
        _, axes = plt.subplots(
            len(stages), 3, figsize=(8.6, 2.9 * len(stages)), layout="constrained", squeeze=False
        )
    circle = np.linspace(0, 2 * np.pi, 200)
    radius = field / MICROTESLA
    for row, (name, values) in zip(axes, stages.items(), strict=True):
        v = values[:: max(1, len(values) // MOST_POINTS)] / MICROTESLA
        low, high = np.minimum(v.min(axis=0), -radius), np.maximum(v.max(axis=0), radius)
        middle, half = (low + high) / 2, 0.54 * (high - low).max()
        for a, (plane, (i, j)) in zip(row, PLANES.items(), strict=True):
            a.plot(v[:, i], v[:, j], ".", color=BLUE, ms=2.5, alpha=0.7, mew=0, rasterized=True)
            a.plot(radius * np.cos(circle), radius * np.sin(circle), color=RED, lw=1)
            a.plot(0, 0, "+", color=RED, ms=10)
            a.set_aspect("equal")
            a.set_xlim(middle[i] - half, middle[i] + half)
            a.set_ylim(middle[j] - half, middle[j] + half)
            a.set_xlabel(f"{plane[0]} [µT]")
            a.set_ylabel(f"{plane[1]} [µT]")
            grid(a)
        row[1].set_title(name, fontsize=9)
    return axes


def plot_cloud(fit: MagnetometerCalibration, values: np.ndarray, axes: Axes | None = None) -> Axes:
    """Raw readings (N, 3), T, on the fitted ellipsoid; what was set aside in another colour."""
    if axes is None:
        figure = plt.figure(figsize=(6.4, 5.6), layout="constrained")
        axes = figure.add_subplot(projection="3d", computed_zorder=False)
    every = max(1, len(values) // MOST_POINTS)
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    ball = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    shape = np.tensordot(np.linalg.inv(fit.soft_iron), ball * fit.field, 1)
    shape = (shape + fit.hard_iron[:, None, None]) / MICROTESLA
    axes.plot_wireframe(*shape, color=GREY, lw=0.4, alpha=0.6, zorder=1)
    kept = fit.used[::every]
    v = values[::every] / MICROTESLA
    axes.scatter(*v[kept].T, s=5, color=BLUE, alpha=0.8, linewidths=0, zorder=2, label="reading")
    aside = values[~fit.used] / MICROTESLA
    aside = aside[np.isfinite(aside).all(axis=1)]
    # A reading far out would shrink the ellipsoid to a dot.
    limit = np.stack([shape.min(axis=(1, 2)), shape.max(axis=(1, 2))])
    reach = np.ptp(limit, axis=0).max()
    near = (np.abs(aside - limit.mean(axis=0)) < 0.8 * reach).all(axis=1)
    if near.any():
        axes.scatter(*aside[near].T, s=12, color=RED, marker="x", zorder=3, label="set aside")
    axes.scatter(
        *(fit.hard_iron / MICROTESLA), s=60, color=RED, marker="+", zorder=4, label="hard iron"
    )
    axes.set_box_aspect(np.ptp(limit, axis=0))
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"{name} [µT]")
    axes.legend(fontsize=8, loc="upper left")
    return axes


def plot_coverage(u: np.ndarray, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Where the corrected field (N, 3, unit vectors) pointed, and what of the sphere it never saw."""
    axes = new_row(2, height=3.9) if axes is None else axes
    distance, _ = cKDTree(u).query(even_directions())
    seen = distance < 2 * np.sin(NEAR / 2)
    some = u[:: max(1, len(u) // MOST_POINTS)]
    for a, sign in zip(axes, (1, -1), strict=True):
        for points, style in (
            (
                even_directions()[~seen],
                {"marker": "s", "color": SECOND, "s": 16, "label": "not seen"},
            ),
            (some, {"marker": ".", "color": BLUE, "s": 8, "label": "reading"}),
        ):
            here = points[points[:, 2] * sign >= 0]
            if len(here):
                a.scatter(*_flat(here), linewidths=0, zorder=3, **style)
        _hemisphere(a, sign)
    handles = {
        label: handle
        for a in axes
        for handle, label in zip(*a.get_legend_handles_labels(), strict=True)
    }
    axes[0].figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=2, fontsize=8
    )
    return axes


def plot_residual_map(
    u: np.ndarray, residual: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Mean of the residual (N,), ‖true‖ / field − 1, by the direction (N, 3) of the field."""
    axes = new_row(2, height=3.7) if axes is None else axes
    centres = even_directions(400)
    cell = cKDTree(centres).query(u)[1]
    count = np.bincount(cell, minlength=len(centres))
    mean = 100 * np.bincount(cell, residual, len(centres)) / np.maximum(count, 1)
    reach = max(1e-9, float(np.quantile(np.abs(mean[count > 0]), 0.98)))
    for a, sign in zip(axes, (1, -1), strict=True):
        here = (centres[:, 2] * sign >= 0) & (count > 0)
        drawn = a.scatter(
            *_flat(centres[here]),
            c=mean[here],
            cmap="PuOr",
            vmin=-reach,
            vmax=reach,
            s=75,
            linewidths=0,
        )
        _hemisphere(a, sign)
    axes[0].figure.colorbar(drawn, ax=list(axes), shrink=0.8, label="residual [%]", extend="both")
    return axes


def plot_residuals(
    time: np.ndarray,
    label: str,
    residual: np.ndarray,
    used: np.ndarray,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Residuals (N,), ‖true‖ / field − 1, over time and as a histogram; red what was set aside.

    `label` is the time axis's.
    """
    axes = new_row(2, height=3.1, width=8.6, width_ratios=(3, 1)) if axes is None else axes
    percent = 100 * residual
    half = 1.15 * max(np.abs(percent[used]).max(), 1e-9)
    every = max(1, len(percent) // (3 * MOST_POINTS))
    axes[0].plot(
        time[used][::every],
        percent[used][::every],
        ".",
        color=BLUE,
        ms=2,
        mew=0,
        alpha=0.7,
        rasterized=True,
    )
    if (~used).any():
        shown = np.clip(percent[~used], -half, half)
        axes[0].plot(
            time[~used], shown, "x", color=RED, ms=4, label="set aside (at the edge: beyond)"
        )
        axes[0].legend(fontsize=8, loc="upper right")
    axes[1].hist(percent[used], bins=60, orientation="horizontal", color=BLUE, alpha=0.8)
    axes[0].set_ylim(-half, half)
    axes[0].set_xlabel(label)
    axes[0].set_ylabel("‖true‖ / field − 1 [%]")
    axes[1].set_xlabel("readings")
    for a in axes:
        a.axhline(0, color="black", lw=0.6)
        grid(a)
    return axes


def plot_dip(alignment: Alignment, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Dip angle as read and after: the left panel all of it, the right one the corrected alone."""
    axes = new_row(2, height=3.1, width=8.6, sharey=False) if axes is None else axes
    styles = {
        "raw": ("as read", GREY),
        "calibrated": ("each calibrated", SECOND),
        "aligned": ("and aligned", BLUE),
    }
    degrees = {stage: np.degrees(dip) for stage, dip in alignment.dips.items()}
    for a, stages in zip(axes, (tuple(styles), ("calibrated", "aligned")), strict=True):
        inner = np.concatenate([degrees[s] for s in stages])
        low, high = np.quantile(inner, [0.002, 0.998])
        bins = np.linspace(low, high, 70)
        for stage in stages:
            if stage == "aligned" and not alignment.determined:
                continue
            name, colour = styles[stage]
            text = f"{name}: ± {np.degrees(alignment.spreads[stage]):.2g}°"
            a.hist(degrees[stage], bins=bins, histtype="step", color=colour, lw=1.4, label=text)
        a.set_xlabel("dip angle [°]")
        a.legend(fontsize=8, loc="upper left")
        a.margins(y=0.25)
        grid(a)
    axes[0].set_ylabel("readings")
    return axes


def plot_heading(
    heading: Heading, factor: float, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Heading error in a level turn: as read, and, on its own scale, the 95 % band after.

    `factor` is the half width of the interval in standard errors.
    """
    axes = new_row(2, height=3.1, width=8.6, sharey=False) if axes is None else axes
    psi = np.degrees(heading.heading)
    before = np.degrees(heading.before)
    jump = np.abs(np.diff(before, prepend=before[0])) > 180
    axes[0].plot(psi, np.where(jump, np.nan, before), color=GREY, lw=1.6)
    half = factor * np.degrees(heading.std)
    axes[1].fill_between(psi, -half, half, color=THIRD, alpha=0.6, lw=0, label="95 % band")
    if heading.turned.any():
        turned = np.degrees(heading.turned)
        jump = np.abs(np.diff(turned, prepend=turned[0])) > 180
        axes[1].plot(
            psi,
            np.where(jump, np.nan, turned),
            color=RED,
            lw=1.4,
            label="turn of the triads left in",
        )
    axes[1].legend(fontsize=8)
    axes[1].margins(y=0.3)
    for a, title in zip(axes, ("as read", "corrected"), strict=True):
        a.axhline(0, color="black", lw=0.6)
        a.set_title(title, fontsize=9)
        a.set_xlabel("heading [°]")
        a.set_xticks(range(0, 361, 90))
        a.set_xlim(0, 360)
        grid(a)
    axes[0].set_ylabel("heading error [°]")
    return axes


def _flat(directions: np.ndarray) -> np.ndarray:
    """(2, N) Lambert's equal-area projection of directions (N, 3) of one half sphere."""
    return (directions[:, :2] / np.sqrt(1 + np.abs(directions[:, 2:]))).T


def _hemisphere(axes: Axes, sign: int) -> None:
    circle = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(circle), np.sin(circle), color=GREY, lw=0.8)
    axes.set_aspect("equal")
    axes.set_title(f"field along {'+' if sign > 0 else '−'}z of the sensor", fontsize=9)
    axes.set_xlabel("x")
    axes.set_ylabel("y")
    axes.set_xlim(-1.1, 1.1)
    axes.set_ylim(-1.1, 1.1)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
