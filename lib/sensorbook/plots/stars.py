"""Figures of the star camera. Images are drawn as negatives: dark stars on a light sky."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from scipy.stats import chi2

from sensorbook.camera.model import Camera
from sensorbook.camera.star_blobs import Blobs
from sensorbook.camera.star_identify import StarTable
from sensorbook.camera.stars import StarAttitude
from sensorbook.plots.style import COLOURS, GREY, SECOND, WIDTH, grid, labelled, new_axes, new_row

ARCSEC = 3600 * 180 / np.pi
MATCHED, FALSE, MISSED, REJECTED = COLOURS["z"], COLOURS["y"], COLOURS["x"], GREY
_MOST_NAMED = 12


def plot_spots(image: np.ndarray, blobs: Blobs, axes: Axes | None = None) -> Axes:
    """An image (height, width) with the spots that were found: circles for stars, crosses for the rest."""
    axes = _image(image, axes)
    for chosen, mark, colour, name in (
        (blobs.usable, "o", COLOURS["x"], "may be stars"),
        (~blobs.usable, "x", COLOURS["y"], "rejected"),
    ):
        if chosen.any():
            fill = {} if mark == "x" else {"mfc": "none"}
            label = f"{name}: {chosen.sum()}"
            axes.plot(
                *blobs.pixels[chosen].T, mark, ms=8, color=colour, mew=1.2, label=label, **fill
            )
    return _legend(axes)


def plot_spot(
    image: np.ndarray, blobs: Blobs, spot: int, true: np.ndarray, axes: Axes | None = None
) -> Axes:
    """The pixels about one spot, its middle and the star's true place (2,), in pixels."""
    axes = new_axes(axes, height=3.6)
    column, row = np.rint(blobs.pixels[spot]).astype(int)
    reach = 6
    left, top = max(column - reach, 0), max(row - reach, 0)
    patch = image[top : row + reach + 1, left : column + reach + 1]
    extent = (left - 0.5, left + patch.shape[1] - 0.5, top + patch.shape[0] - 0.5, top - 0.5)
    drawn = axes.imshow(patch, cmap="gray_r", extent=extent, vmin=0)
    axes.figure.colorbar(drawn, ax=axes, label="brightness [DN]")
    axes.plot(*true, "o", ms=13, mfc="none", mew=1.5, color=COLOURS["x"], label="true place")
    axes.plot(*blobs.pixels[spot], "+", ms=11, mew=1.8, color=COLOURS["y"], label="middle found")
    axes.set_xlabel("x [pixels]")
    axes.set_ylabel("y [pixels]")
    axes.legend(loc="upper right", fontsize=8)
    return axes


def plot_ambiguity(
    table: StarTable,
    tolerance: float,
    expected: Mapping[str, float],
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """How many pairs of the catalogue an angle fits within `tolerance` (rad), and what chance leaves of it.

    `expected` is the number of false matches by pattern: what would be met in an even sky.
    """
    axes = new_row(2, height=3.4, sharey=False) if axes is None else axes
    angle = np.degrees(table.angles)
    edges = np.linspace(0, angle[-1], 61)
    count, _ = np.histogram(angle, edges)
    share = 2 * np.degrees(tolerance) / np.diff(edges)
    axes[0].stairs(count * share, edges, fill=True, color=COLOURS["x"], alpha=0.75)
    labelled(axes[0], "angle between two stars [°]", "pairs that fit it")
    values = list(expected.values())
    bars = axes[1].bar(
        list(expected), values, color=[COLOURS["x"], SECOND, COLOURS["z"]], width=0.6
    )
    axes[1].bar_label(bars, [_number(v) for v in values], fontsize=8, padding=2)
    axes[1].set_yscale("log")
    axes[1].set_ylim(min(values) / 5, max(values) * 20)
    axes[1].axhline(1, color=GREY, linestyle="--", linewidth=1)
    axes[1].set_ylabel("false matches expected")
    axes[1].grid(axis="y", color="#DDDDDD", linewidth=0.6)
    axes[1].set_axisbelow(True)
    return axes


def plot_identified(
    image: np.ndarray,
    found: StarAttitude,
    camera: Camera,
    table: StarTable,
    to_camera: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """The spots that got a name, those that got none, and the catalogue's stars that no spot shows.

    `to_camera` (3, 3) is the true attitude of the camera, from inertial.
    """
    axes = _image(image, axes)
    named = found.matched >= 0
    seen = table.directions @ to_camera.T
    missed = np.setdiff1d(np.flatnonzero(camera.sees(seen)), found.matched[named])
    groups = (
        (found.blobs.pixels[named], "o", MATCHED, "named"),
        (found.blobs.pixels[found.blobs.usable & ~named], "s", FALSE, "not in the catalogue"),
        (found.blobs.pixels[~found.blobs.usable], "x", REJECTED, "rejected"),
        (camera.project(seen[missed]), "D", MISSED, "in the catalogue, not named"),
    )
    for pixels, mark, colour, name in groups:
        if len(pixels):
            fill = {} if mark == "x" else {"mfc": "none"}
            label = f"{name}: {len(pixels)}"
            axes.plot(*pixels.T, mark, ms=8, color=colour, mew=1.2, label=label, **fill)
    for pixel, star in zip(
        found.blobs.pixels[named][:_MOST_NAMED], found.matched[named], strict=False
    ):
        late = pixel[0] > 0.9 * camera.width
        axes.annotate(
            str(star),
            pixel,
            (-5 if late else 5, 5),
            textcoords="offset points",
            ha="right" if late else "left",
            fontsize=7,
            color=MATCHED,
        )
    return _legend(axes)


def plot_star_errors(
    errors: np.ndarray, covariance: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Error vectors (N, 3), rad, across and about the axis, and squared over their covariance (N, 3, 3)."""
    axes = new_row(3, height=3.0, width=9.0, sharey=False) if axes is None else axes
    shown, spread = ARCSEC * errors, ARCSEC**2 * covariance.mean(axis=0)
    for a, (i, j) in zip(axes, ((0, 1), (0, 2)), strict=False):
        own = spread[np.ix_((i, j), (i, j))]
        values, turned = np.linalg.eigh(own)
        width, height = 2 * np.sqrt(chi2.ppf(0.95, 2) * values)
        tilt = np.degrees(np.arctan2(turned[1, 0], turned[0, 0]))
        a.add_patch(
            Ellipse((0, 0), width, height, angle=tilt, fill=False, color=COLOURS["y"], lw=1.4)
        )
        a.plot(shown[:, i], shown[:, j], ".", ms=4, color=COLOURS["x"])
        limit = 1.15 * max(np.abs(shown[:, [i, j]]).max(), max(width, height) / 2)
        a.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
        labelled(a, f"error about {'xyz'[i]} [″]", f"error about {'xyz'[j]} [″]")
    solved = np.linalg.solve(covariance, errors[..., None])[..., 0]
    normalised = np.sort((errors * solved).sum(axis=-1))
    share = (np.arange(len(normalised)) + 0.5) / len(normalised)
    axes[2].step(normalised, share, where="mid", color=COLOURS["x"], label="images")
    at = np.linspace(0, max(12.0, normalised[-1]), 200)
    axes[2].plot(at, chi2.cdf(at, 3), "--", color=COLOURS["y"], label="χ², 3 degrees")
    axes[2].legend(frameon=False, fontsize=8, loc="lower right")
    labelled(axes[2], "error² over covariance", "share of images below")
    return axes


def plot_star_accuracy(
    panels: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]],
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Errors across and about the axis against one setting a panel: its name → values (M,), simulated and
    predicted rms (M, 2), rad."""
    axes = new_row(len(panels), height=3.4) if axes is None else axes
    for a, (name, (values, simulated, predicted)) in zip(axes, panels.items(), strict=True):
        for k, (label, colour, mark) in enumerate(
            (("across the axis", COLOURS["x"], "o"), ("about it (roll)", COLOURS["y"], "s"))
        ):
            a.plot(values, ARCSEC * predicted[:, k], color=colour, linewidth=1.4)
            a.plot(
                values, ARCSEC * simulated[:, k], mark, color=colour, ms=5, mfc="none", label=label
            )
        a.set_xscale("log")
        a.set_yscale("log")
        a.set_xlabel(name)
        a.xaxis.set_major_formatter("{x:g}")
        a.xaxis.set_minor_formatter("")
        a.set_xticks(values[::2], minor=False)
        a.yaxis.set_major_formatter("{x:g}")
        grid(a)
    axes[0].set_ylabel("rms error [″]")
    axes[0].legend(
        frameon=False, fontsize=8, title="marks simulated, lines predicted", title_fontsize=7
    )
    return axes


def plot_share(
    limits: np.ndarray,
    poisson: np.ndarray,
    simulated: np.ndarray,
    solved: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """Share of the sky with four stars in view, by Poisson and counted, and solved, against the catalogue."""
    axes = new_axes(axes, height=3.3)
    axes.plot(limits, 100 * poisson, color=GREY, label="four or more in view, Poisson")
    axes.plot(limits, 100 * simulated, "o", ms=7, mfc="none", color=COLOURS["x"], label="counted")
    axes.plot(limits, 100 * solved, "x", ms=6, color=COLOURS["y"], label="solved")
    labelled(axes, "faintest magnitude in the catalogue", "share of attitudes [%]")
    axes.legend(frameon=False)
    return axes


def _number(value: float) -> str:
    """A count, or what is far below one in powers of ten."""
    if value >= 0.1:
        return f"{value:,.0f}" if value >= 1 else f"{value:.1f}"
    digits, power = f"{value:.1e}".split("e")
    return rf"${digits}\times10^{{{int(power)}}}$"


def _image(image: np.ndarray, axes: Axes | None) -> Axes:
    """The image as a negative, its background white; in a large one spots are drawn wider, to be seen."""
    axes = new_axes(axes, height=WIDTH * min(image.shape[0] / image.shape[1], 1.2))
    low, wider = float(np.median(image)), 1 + 2 * (image.shape[1] // 500)
    shown = cv2.dilate(image, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wider, wider)))
    axes.imshow(shown, cmap="gray_r", vmin=low + 2, vmax=low + 8, interpolation="nearest")
    axes.set(xlabel="x [pixels]", ylabel="y [pixels]")
    axes.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(image.shape[0] - 0.5, -0.5))
    return axes


def _legend(axes: Axes) -> Axes:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)
    return axes
