"""Figures of what the accuracy of an attitude from Earth and Sun hangs on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, ScalarFormatter

from sensorbook.camera.accuracy import Varied, angular_radius, arc, binned, by_formula
from sensorbook.camera.limb import Limb
from sensorbook.camera.model import Camera
from sensorbook.camera.steps import around, best_edge, centre_bias, edge_profile
from sensorbook.camera.study import Trial
from sensorbook.plots.style import (
    ACCENT,
    COLOURS,
    GREY,
    LINES,
    SECOND,
    grid,
    labelled,
    log_log,
    new_axes,
    new_row,
)

OURS, CHAIN = COLOURS["x"], COLOURS["y"]
ORBITS = dict(zip(("leo", "meo", "geo"), "xyz", strict=True))  # colours and lines by orbit
_BINS = np.radians(np.arange(0, 120, 10))
_LOOKS = (COLOURS["x"], COLOURS["y"], COLOURS["z"], ACCENT)


def plot_centre_errors(fitted: Mapping[str, np.ndarray], axes: Axes | None = None) -> Axes:
    """How far the centre of the limb's ellipse lies from the Earth's, by orbit, against the angle off axis.

    Lines are the formula's, marks those of ellipses through exact limbs: `fitted` (N, 2), rad, angle off
    the axis and error.
    """
    axes = new_axes(axes)
    for orbit, points in fitted.items():
        rho, colour = angular_radius(orbit), COLOURS[ORBITS[orbit]]
        off = np.linspace(np.radians(0.1), np.pi / 2 - rho - 1e-6, 400)
        bias = np.degrees([centre_bias(o, rho) for o in off])
        name = f"{orbit.upper()}, ρ = {np.degrees(rho):.1f}°"
        axes.plot(np.degrees(off), bias, LINES[ORBITS[orbit]], color=colour, label=name)
        axes.plot(*np.degrees(points).T, "o", ms=5, color=colour)
        axes.axvline(90 - np.degrees(rho), color=colour, linewidth=0.9, linestyle=":")
    axes.set_yscale("log")
    axes.set_ylim(3e-3, 120)
    axes.set_xlim(0, 90)
    axes.legend(loc="lower right", fontsize=8)
    return labelled(axes, "Earth's centre off the axis, θ [°]", "centre's error Δ [°]", 10)


def plot_by_angle(
    tried: Mapping[str, Sequence[Trial]], axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Whole errors of both ways against the angle off the axis, a panel an orbit.

    Dots are pictures; marks with bars the median and the whole spread in ten degrees; the grey line is
    the formula's error of the centre times the median factor by which that turns TRIAD's attitude.
    """
    axes = new_row(len(tried), height=4.2, width=9.2) if axes is None else axes
    entries = {}
    for a, (orbit, trials) in zip(axes, tried.items(), strict=True):
        rho = angular_radius(orbit)
        a.set_title(orbit.upper(), fontsize=10)
        for colour, mark, name, errors in (
            (CHAIN, "s", "C's chain", [t.chain_error for t in trials]),
            (OURS, "o", "limb and Sun together", [t.error for t in trials]),
        ):
            pairs = [
                (t.off_axis, np.linalg.norm(e))
                for t, e in zip(trials, errors, strict=True)
                if e is not None
            ]
            if not pairs:
                continue
            off, size = np.array(pairs).T
            a.plot(np.degrees(off), np.degrees(size), ".", ms=4, color=colour, alpha=0.5)
            middle, median, low, high = np.degrees(binned(off, size, _BINS)).T
            bars = [median - low, high - median]
            a.errorbar(
                middle, median, bars, fmt=mark, ms=6, color=colour, capsize=3, lw=1.2, label=name
            )
        found = [f for f in (by_formula(t, rho) for t in trials) if f is not None and f[0] > 0]
        if found:
            factor = np.median([turned / bias for bias, turned in found])
            angles = np.linspace(0.01, np.pi / 2 - rho - 1e-4, 200)
            guide = factor * np.degrees([centre_bias(o, rho) for o in angles])
            a.plot(np.degrees(angles), guide, color=GREY, lw=1.5, ls="--", label="factor · Δ(θ)")
            a.set_title(f"{orbit.upper()}, factor {factor:.2g}", fontsize=10)
        a.axvline(90 - np.degrees(rho), color=GREY, lw=0.9, ls=":")
        a.set_yscale("log")
        a.set_xlim(0, max(75, *(np.degrees(t.off_axis) + 3 for t in trials)))
        entries |= dict(zip(*a.get_legend_handles_labels()[::-1], strict=True))
        labelled(a, "Earth's centre off the axis [°]", "")
    axes[0].set_ylabel("error of the attitude [°]")
    axes[0].set_ylim(bottom=1e-4)
    axes[0].figure.legend(
        entries.values(), entries, loc="outside lower center", ncols=3, fontsize=8
    )
    return axes


def plot_formula(tried: Mapping[str, Sequence[Trial]], axes: Axes | None = None) -> Axes:
    """The error of C's chain, picture by picture, against what the ellipse's centre alone makes of it."""
    axes = new_axes(axes, height=4.6)
    ends = []
    for mark, (orbit, trials) in zip("os^", tried.items(), strict=False):
        pairs = [
            (found[1], np.linalg.norm(t.chain_error))
            for t in trials
            if t.chain_error is not None and (found := by_formula(t, angular_radius(orbit)))
        ]
        if pairs:
            expected, measured = np.degrees(pairs).T
            colour = COLOURS[ORBITS[orbit]]
            axes.plot(expected, measured, mark, ms=5, color=colour, label=orbit.upper())
            ends += [expected.min(), expected.max(), measured.min(), measured.max()]
    log_log(axes)
    if ends:
        line = [0.7 * min(ends), 1.4 * max(ends)]
        axes.plot(line, line, color=GREY, lw=1, ls="--", label="equal")
        axes.legend(fontsize=8)
    axes.set_xlabel("attitude's error by formula and TRIAD [°]")
    axes.set_ylabel("attitude's error of C's chain [°]")
    return axes


def plot_looks(
    seen: Mapping[str, tuple[np.ndarray, Limb]],
    camera: Camera,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Pictures of one scene with several looks of the Earth: brightness across the edge, and residuals.

    `seen` holds image and fitted limb by look.
    """
    axes = new_row(2, height=3.8, width=9.2, sharey=False) if axes is None else axes
    for colour, (name, (image, limb)) in zip(_LOOKS, seen.items(), strict=False):
        edge = best_edge(limb, camera)
        axes[0].plot(*edge_profile(image, limb, camera, edge), color=colour, lw=1.6, label=name)
        used = limb.used
        turn = np.degrees(around(limb, limb.rays[used]))
        axes[1].plot(turn, limb.residuals[used], ".", ms=2.5, color=colour)
    axes[0].axvline(0, color=GREY, lw=0.9, ls=":")
    axes[0].legend(fontsize=8)
    labelled(axes[0], "way inward from the edge found [px]", "brightness [DN]")
    labelled(axes[1], "around the Earth's centre [°]", "edge off the fitted limb [px]")
    return axes


def plot_varied(
    by_size: Mapping[float, Varied],
    by_noise: Mapping[float, Varied],
    trials: Sequence[Trial],
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Rms error, as measured and predicted, by pixels across and by noise; each trial's by arc of limb."""
    axes = new_row(3, height=4.0, width=9.6) if axes is None else axes
    for a, found, name in (
        (axes[0], by_size, "pixels across the image"),
        (axes[1], by_noise, "noise of a pixel [DN]"),
    ):
        x = [k for k, v in found.items() if v.solved]
        for what, mark, colour, label in (
            ("error", "o-", OURS, "measured"),
            ("predicted", "s--", CHAIN, "predicted"),
            ("sun", "^:", SECOND, "the Sun's direction alone"),
        ):
            y = [np.degrees(getattr(v, what)) for v in found.values() if v.solved]
            a.plot(x, y, mark, color=colour, ms=5, label=label)
        a.set_xlabel(name)
    solved = [t for t in trials if t.error is not None]
    if solved:
        turn = np.degrees([arc(t) for t in solved])
        error = np.degrees([np.linalg.norm(t.error) for t in solved])
        stated = np.degrees([np.sqrt(np.trace(t.found.covariance)) for t in solved])
        axes[2].plot(turn, error, "o", ms=4, color=OURS)
        axes[2].plot(turn, stated, "s", ms=4, mfc="none", color=CHAIN)
    axes[2].set_xlabel("arc of limb used [°]")
    for a in axes:
        log_log(a)
    axes[2].set_xscale("linear")
    for a, values in ((axes[0], list(by_size)), (axes[1], list(by_noise))):
        a.set_xticks(values)
        a.xaxis.set_major_formatter(ScalarFormatter())
        a.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("error [°]")
    axes[0].legend(fontsize=8)
    return axes


def plot_sun_vectors(
    changes: Mapping[str, np.ndarray],
    printed: Mapping[str, np.ndarray],
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """How far the Sun's direction is from that seen from the Earth's centre, rad.

    `changes` (N,) around each orbit, `printed` (3,) those of C's printed vectors.
    """
    axes = new_row(2, height=3.7, width=9.2) if axes is None else axes
    for place, (orbit, change) in enumerate(changes.items()):
        colour = COLOURS[ORBITS[orbit]]
        turn = np.linspace(0, 360, len(change), endpoint=False)
        line = LINES[ORBITS[orbit]]
        axes[0].plot(turn, np.degrees(change), line, color=colour, label=orbit.upper())
        axes[1].plot(3 * [place], np.degrees(printed[orbit]), "o", ms=6, color=colour)
        most = np.degrees(change.max())
        axes[1].plot([place - 0.3, place + 0.3], [most, most], color=colour, lw=2)
    axes[0].legend(fontsize=8, loc="upper right")
    axes[0].set_ylim(bottom=0)
    labelled(axes[0], "place on the orbit [°]", "off the Earth–Sun direction [°]", 90)
    axes[1].set_xticks(range(len(changes)), [o.upper() for o in changes])
    axes[1].set_xlabel("C's printed vectors, and the most possible")
    grid(axes[1])
    return axes
