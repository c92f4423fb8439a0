"""Figures of the static calibrations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from sensorbook import units
from sensorbook.calibration.coverage import COVERED, STANDARD
from sensorbook.calibration.find import Found
from sensorbook.calibration.positions import Positions
from sensorbook.calibration.rest_fit import RestFit
from sensorbook.calibration.result import Calibration
from sensorbook.calibration.temperature import TemperatureFit
from sensorbook.plots.style import COLOURS, GREY, SECOND, THIRD, grid, new_axes, new_row
from sensorbook.recordings.recording import Recording

METHODS = {
    "six_position": ("SPS", SECOND, "s"),
    "recursive": ("RLS", THIRD, "D"),
    "multi_position": ("MP", "#0072B2", "o"),
    "rest_to_rest": ("rest to rest", "#0072B2", "o"),
}
MOST_POINTS = 6000  # of a line; more only fill pixels again


def plot_rests(
    found: Found, recording: Recording, run: int = 0, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """The signal with the rests shaded, and below it the scatter against the threshold.

    Parameters
    ----------
    recording : that the rests were found in, number `run` of `found`
    """
    if axes is None:
        _, axes = plt.subplots(2, 1, figsize=(8.6, 4.6), layout="constrained", sharex=True)
    signal, quiet = axes
    label, si = units.field_unit(recording.sensor, "signal")
    every = max(1, len(recording) // MOST_POINTS)
    for k, axis in enumerate("xyz"):
        values = recording.values[::every, k] / si
        signal.plot(recording.time[::every], values, color=COLOURS[axis], lw=0.7, label=axis)
    signal.set_ylabel(f"{recording.sensor} [{label}]")
    for scatter, colour in zip(found.scatters[run], ("#0072B2", SECOND), strict=False):
        every = max(1, len(scatter.time) // MOST_POINTS)
        # The largest of what is left out, so that no peak is lost.
        count = len(scatter.ratio) // every * every
        peaks = scatter.ratio[:count].reshape(-1, every).max(axis=1)
        quiet.plot(scatter.time[:count:every], peaks, color=colour, lw=0.7, label=scatter.sensor)
    if found.threshold is not None:
        quiet.axhline(found.threshold, color="black", ls="--", lw=0.9, label="threshold")
    for a in axes:
        for k, (start, end) in enumerate(found.positions.spans[found.positions.runs == run]):
            a.axvspan(start, end, color="#009E73", alpha=0.22, lw=0, label=None if k else "rest")
        grid(a)
        a.legend(fontsize=8, ncols=4, loc="upper right")
    quiet.set_yscale("log")
    quiet.set_xlabel("time [s]")
    quiet.set_ylabel("scatter over 0.5 s,\ntimes the initial rest's")
    return axes


def plot_sweep(found: Found, axes: Axes | None = None) -> Axes:
    """Residual of the calibration against the threshold, with the number of rests at each point."""
    axes = new_axes(axes, height=2.9)
    known = [(t, n, r) for t, n, r in found.sweep if r is not None]
    axes.plot([t for t, _, _ in known], [1000 * r for _, _, r in known], "o-", mfc="white")
    for t, n, r in known:
        chosen = t == found.threshold
        axes.annotate(f"{n}", (t, 1000 * r), xytext=(0, 7), textcoords="offset points", ha="center")
        if chosen:
            axes.plot(t, 1000 * r, "o", color="black", ms=8, label="chosen")
    axes.margins(y=0.25)
    axes.set_xlabel("threshold, times the scatter of the initial rest")
    axes.set_ylabel("rms of ‖a‖ − g [mm/s²]")
    axes.legend(fontsize=8)
    grid(axes)
    return axes


def plot_directions(directions: np.ndarray, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Directions of the specific force on two hemispheres (Lambert's equal-area projection).

    Crosses mark the faces, edges and corners of a cube that no position is near.
    """
    axes = new_row(2, height=3.9, width=7.2) if axes is None else axes
    standard = np.array([*STANDARD.values()])
    near = (standard @ directions.T).max(axis=1) > np.cos(np.radians(COVERED))
    for a, sign, title in zip(axes, (1, -1), ("z up", "z down"), strict=True):
        circle = np.linspace(0, 2 * np.pi, 200)
        a.plot(np.cos(circle), np.sin(circle), color=GREY, lw=0.8)
        for points, style in (
            (standard[~near], {"marker": "x", "color": "#D55E00", "s": 45, "label": "not covered"}),
            (standard[near], {"marker": ".", "color": "#BBBBBB", "s": 12, "label": "covered"}),
            (directions, {"marker": "o", "color": "#0072B2", "s": 26, "label": "position"}),
        ):
            here = points[points[:, 2] * sign >= -1e-9]
            if len(here):
                xy = here[:, :2] / np.sqrt(1 + np.abs(here[:, 2:]))
                a.scatter(xy[:, 0], xy[:, 1], zorder=3, linewidths=1.5, **style)
        a.set_aspect("equal")
        a.set_title(title, fontsize=9)
        a.set_xlabel("x")
        a.set_xlim(-1.12, 1.12)
        a.set_ylim(-1.12, 1.12)
        a.set_xticks([])
        a.set_yticks([])
        for spine in a.spines.values():
            spine.set_visible(False)
    axes[0].set_ylabel("y")
    handles, labels = axes[0].get_legend_handles_labels()
    more = dict(
        zip(
            axes[1].get_legend_handles_labels()[1],
            axes[1].get_legend_handles_labels()[0],
            strict=True,
        )
    )
    merged = dict(zip(labels, handles, strict=True)) | more
    axes[0].figure.legend(
        merged.values(), merged.keys(), loc="outside lower center", ncols=3, fontsize=8
    )
    return axes


def plot_norms(
    before: np.ndarray, after: np.ndarray, held: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """``‖a‖ − g`` of each position: as recorded, and (on its own scale) fitted and held out, m/s²."""
    axes = new_row(2, width=8.6, height=3.1, sharey=False) if axes is None else axes
    number = np.arange(1, len(before) + 1)
    axes[0].plot(number, 1000 * before, "o", color=GREY, ms=4, label="as recorded")
    axes[1].plot(number, 1000 * held, "o", color="#D55E00", mfc="white", ms=5, label="held out")
    axes[1].plot(number, 1000 * after, "o", color="#0072B2", ms=4, label="fitted")
    for a in axes:
        a.axhline(0, color="black", lw=0.6)
        a.set_xlabel("position")
        a.set_ylabel("‖a‖ − g [mm/s²]")
        a.legend(fontsize=8)
        grid(a)
    return axes


def plot_histograms(
    errors: Mapping[str, np.ndarray], axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """``‖a‖ − g`` of single samples by method (B, figure 9), m/s²; one scale for all."""
    axes = new_row(len(errors), width=8.6, height=2.7) if axes is None else axes
    everything = np.concatenate(list(errors.values()))
    edges = np.linspace(*np.quantile(everything, [0.001, 0.999]), 60)
    for a, (name, values) in zip(axes, errors.items(), strict=True):
        a.hist(
            values * 1000,
            edges * 1000,
            density=True,
            color=METHODS.get(name, ("", GREY))[1],
            alpha=0.8,
        )
        rms = np.sqrt(np.mean(values**2)) * 1000
        a.set_title(f"{METHODS.get(name, (name,))[0]}: rms {rms:.3g} mm/s²", fontsize=9)
        a.axvline(0, color="black", lw=0.8)
        a.set_xlabel("‖a‖ − g [mm/s²]")
        grid(a)
    axes[0].set_ylabel("density [1/mm/s²]")
    return axes


def plot_parameters(
    calibrations: Sequence[Calibration],
    truth: dict | None = None,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Bias, scale factor and misalignment by method with 95 % intervals (B, figures 10–12).

    Several calibrations of one method are told apart by what was fed in. A line marks the truth.
    """
    free = np.any([c.free for c in calibrations], axis=0)
    off = [(r, c) for r in range(3) for c in range(3) if r != c and free[r, c]]
    axes = new_row(3, width=9.6, height=3.6, sharey=False) if axes is None else axes
    label, si = units.field_unit(calibrations[0].sensor, "signal")
    panels = (
        (f"bias [{label}]", 1 / si, [("bias", i) for i in range(3)], list("xyz")),
        ("scale factor error [%]", 100, [("matrix", (i, i)) for i in range(3)], list("xyz")),
        (
            "misalignment [mrad]",
            1000,
            [("matrix", p) for p in off],
            ["xyz"[r] + "xyz"[c] for r, c in off],
        ),
    )
    for a, (title, scale, entries, ticks) in zip(axes, panels, strict=True):
        for k, c in enumerate(calibrations):
            name, colour, marker = METHODS[c.method]
            shift = (k - (len(calibrations) - 1) / 2) * 0.7 / max(len(calibrations), 1)
            for j, (part, at) in enumerate(entries):
                if part == "matrix" and not c.free[at]:
                    continue
                value = getattr(c.model, part)[at] - (part == "matrix" and at[0] == at[1])
                half = c.interval_factor * c.std_of(part)[at]
                a.errorbar(
                    j + shift, value * scale, half * scale, fmt=marker, color=colour, ms=4.5, capsize=2,
                    mfc=colour if c.data == "means" else "white",
                    label=f"{name}, {c.data}" if j == 0 else None,
                )  # fmt: skip
        for j, (part, at) in enumerate(entries):
            if truth:
                true = np.array(truth[part])[at] - (part == "matrix" and at[0] == at[1])
                a.plot([j - 0.42, j + 0.42], [true * scale] * 2, color="black", lw=1.2,
                       label="truth" if j == 0 else None)  # fmt: skip
        a.set_xticks(range(len(entries)), ticks)
        a.set_ylabel(title)
        grid(a)
    if len(calibrations) > 1 or truth:
        handles, labels = axes[0].get_legend_handles_labels()
        axes[0].figure.legend(handles, labels, loc="outside upper center", ncols=5, fontsize=8)
    return axes


def plot_correlation(
    names: Sequence[str], correlation: np.ndarray, axes: Axes | None = None
) -> Axes:
    """The correlations of the parameters as a table of colours and numbers (B, figure 8)."""
    axes = new_axes(axes, height=5.4)
    shown = [n.replace("matrix.", "M ").replace("bias.", "b ") for n in names]
    image = axes.imshow(correlation, vmin=-1, vmax=1, cmap="RdBu_r")
    for (i, j), value in np.ndenumerate(correlation):
        if abs(value) > 0.3:
            dark = abs(value) > 0.6
            text = f"{value:.3f}" if 0.9995 > abs(value) > 0.99 else f"{value:.1f}"
            axes.text(
                j, i, text, ha="center", va="center", fontsize=6, color="white" if dark else "black"
            )
    axes.set_xticks(range(len(shown)), shown, rotation=60, fontsize=7)
    axes.set_yticks(range(len(shown)), shown, fontsize=7)
    axes.figure.colorbar(image, ax=axes, label="correlation [–]", shrink=0.8)
    return axes


def plot_turns(
    nominal: np.ndarray,
    fitted: np.ndarray,
    held: np.ndarray,
    turned: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """Direction error after each motion (rad) against the angle turned (rad)."""
    axes = new_axes(axes)
    for values, name, style in (
        (nominal, "nominal scale", {"color": GREY, "marker": "o", "ms": 4}),
        (held, "held out", {"color": "#D55E00", "marker": "o", "mfc": "white", "ms": 6}),
        (fitted, "fitted", {"color": "#0072B2", "marker": "o", "ms": 4}),
    ):
        axes.plot(np.degrees(turned), np.degrees(values), ls="", label=name, **style)
    axes.set_yscale("log")
    axes.set_xlabel("angle turned [°]")
    axes.set_ylabel("direction error [°]")
    axes.legend(fontsize=8)
    grid(axes)
    return axes


def plot_rest_readings(
    readings: np.ndarray, acceleration: np.ndarray, fit: RestFit, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Each gyroscope axis' mean in the rests, less its bias, against what the specific force explains.

    A sensor without sensitivity to acceleration has all points in one heap; one whose sensitivity is
    understood has them on the line.
    """
    axes = new_row(3, width=8.6, height=3.0, sharey=False) if axes is None else axes
    label, si = units.field_unit("gyroscope", "signal")
    explained = acceleration @ fit.g_sensitivity.T / si
    for i, a in enumerate(axes):
        a.plot(
            explained[:, i], (readings[:, i] - fit.bias[i]) / si, "o", color=COLOURS["xyz"[i]], ms=4
        )
        ends = np.array([explained[:, i].min(), explained[:, i].max()])
        a.plot(ends, ends, color="black", lw=1)
        a.set_title("xyz"[i], fontsize=9)
        a.set_xlabel(f"by acceleration [{label}]")
        a.locator_params(axis="x", nbins=2)
        grid(a)
    axes[0].set_ylabel(f"reading at rest − bias [{label}]")
    return axes


def plot_temperature_model(
    fit: TemperatureFit, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Bias and scale factor error against temperature; points are single recordings by themselves."""
    axes = new_row(2, width=8.6, height=3.2, sharey=False) if axes is None else axes
    c = fit.calibration
    t = np.linspace(*fit.range, 60)
    for i, axis in enumerate("xyz"):
        scale, bias = np.full_like(t, c.model.matrix[i, i] - 1), np.full_like(t, c.model.bias[i])
        entry = c.temperature or {"matrix_coefficients": [], "bias_coefficients": []}
        for k, (m, b) in enumerate(
            zip(entry["matrix_coefficients"], entry["bias_coefficients"], strict=True), start=1
        ):
            scale = scale + m[i][i] * (t - c.reference_temperature) ** k
            bias = bias + b[i] * (t - c.reference_temperature) ** k
        axes[0].plot(t, bias * 1000, color=COLOURS[axis], label=axis)
        axes[1].plot(t, scale * 1e6, color=COLOURS[axis], label=axis)
        for warmth, values in fit.by_run:
            axes[0].plot(warmth, values[3 + i] * 1000, "o", color=COLOURS[axis], ms=4)
            axes[1].plot(warmth, values[i] * 1e6, "o", color=COLOURS[axis], ms=4)
    axes[0].set_ylabel("bias [mm/s²]")
    axes[1].set_ylabel("scale factor error [ppm]")
    for a in axes:
        a.set_xlabel("temperature [°C]")
        a.legend(title="axis", fontsize=8)
        grid(a)
    return axes


def plot_recursion(history: np.ndarray, names: Sequence[str], axes: Sequence[Axes] | None = None):
    """The recursive solution after each position; what is absurd, as nothing is known, is left out."""
    axes = new_row(2, width=8.6, height=2.9, sharey=False) if axes is None else axes
    number = np.arange(1, len(history) + 1)
    for axis in "xyz":
        bias = np.array(history[:, list(names).index(f"bias.{axis}")])
        scale = np.array(history[:, list(names).index(f"matrix.{axis}{axis}")])
        # Before both signs of an axis were seen its numbers are anything: they would set the scale.
        bias[np.abs(bias - bias[-1]) > 1.0] = np.nan
        scale[np.abs(scale - scale[-1]) > 0.1] = np.nan
        axes[0].plot(number, 1000 * bias, "o-", color=COLOURS[axis], label=axis, ms=4)
        axes[1].plot(number, 100 * (scale - 1), "o-", color=COLOURS[axis], label=axis, ms=4)
    axes[0].set_ylabel("bias [mm/s²]")
    axes[1].set_ylabel("scale factor error [%]")
    for a in axes:
        a.set_xlabel("positions taken in")
        a.legend(title="axis", fontsize=8)
        grid(a)
    return axes


def plot_levelling(
    faces: Positions, directions: np.ndarray, fit: Calibration, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Residual of each position across gravity and along it, m/s², by a fit with known directions."""
    axes = new_row(2, width=8.6, height=3.2, sharey=False) if axes is None else axes
    left = fit.model.correct(faces.means) - fit.gravity * directions
    along = (left * directions).sum(axis=1)
    across = left - along[:, None] * directions
    number = np.arange(len(faces))
    for i, axis in enumerate("xyz"):
        idle = np.abs(directions[:, i]) < 0.5
        axes[0].plot(number[idle], 1000 * across[idle, i], "o", color=COLOURS[axis], label=axis)
        axes[1].plot(number[~idle], 1000 * along[~idle], "o", color=COLOURS[axis], label=axis)
    axes[0].set_ylabel("across gravity [mm/s²]")
    axes[1].set_ylabel("along gravity [mm/s²]")
    for a in axes:
        a.axhline(0, color="black", lw=0.6)
        a.set_xticks(
            number, [label.split(" (")[0] for label in faces.labels], rotation=45, fontsize=8
        )
        a.legend(title="axis", fontsize=8)
        grid(a)
    return axes
