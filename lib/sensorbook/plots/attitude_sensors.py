"""Figures of attitude sensors: the horizon, the field and the stars as sensors see them."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Polygon

from sensorbook.attitude.sensors.budget import DEGREE, Accuracy
from sensorbook.attitude.sensors.conical import Scan, angular_radius, scan_vectors
from sensorbook.attitude.sensors.magnetic import OrbitField
from sensorbook.attitude.sensors.star import StarSensor
from sensorbook.attitude.sensors.static import StaticSensor
from sensorbook.plots.style import (
    COLOURS,
    GREY,
    LINES,
    SECOND,
    THIRD,
    grid,
    labelled,
    new_axes,
    new_row,
)

BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
EARTH = "#BFD7EA"


def plot_scans(
    nadirs: dict[str, np.ndarray],
    height: float,
    cone: float,
    scans: dict[int, Scan],
    axes: Axes | None = None,
) -> Axes:
    """The sky of the body: the Earth about its nadirs (3,), scans by side (1, −1), their crossings.

    The map keeps angles from the body's z axis, which is in the middle; y is to the right and x up, and
    the rim is −z. The first of `nadirs` is drawn as a disc, the others as outlines (C 3.8, 3.11, 3.12);
    a disc that holds −z is what lies outside its outline.
    """
    axes = new_axes(axes, 4.6)
    rho = float(angular_radius(height))
    for k, (name, nadir) in enumerate(nadirs.items()):
        outline = np.degrees(_map(_circle(nadir, rho)))
        colour = BLUE if k == 0 else RED
        if k == 0:
            inside_out = -nadir[2] > np.cos(rho)
            if inside_out:
                axes.add_patch(Circle((0, 0), 180, fc=EARTH, ec="none"))
            axes.add_patch(Polygon(outline, fc="white" if inside_out else EARTH, ec="none"))
        path = _broken(outline)
        axes.plot(*path.T, color=colour, ls="-" if k == 0 else "--", lw=1.5, label=name)
        axes.plot(*np.degrees(_map(nadir)), "+", color=colour, ms=9)
    number, marks = 1, []
    for side, scan in scans.items():
        around = np.linspace(-np.pi, np.pi, 361)
        name = "scan" if len(scans) == 1 else f"scan about {'y' if side == 1 else '−y'}"
        path = _broken(np.degrees(_map(scan_vectors(cone, around, side))))
        axes.plot(*path.T, color=GREY, ls="-" if side == 1 else "-.", lw=1, label=name)
        for angle in (float(scan.enter), float(scan.leave)):
            if np.isfinite(angle):
                place = np.degrees(_map(scan_vectors(cone, angle, side)))
                axes.plot(*place, "o", color=SECOND, mec="black", ms=8, zorder=4)
                near = [m for m in marks if np.linalg.norm(m[0] - place) < 8]
                if near:
                    near[0][1].append(number)
                else:
                    marks.append((place, [number]))
            number += 1
    for place, numbers in marks:
        text = ", ".join(map(str, numbers))
        axes.annotate(text, place, (7, 5), textcoords="offset points", weight="bold")
    axes.plot(0, 0, ".", color="black")
    axes.annotate("z", (0, 0), (-12, 5), textcoords="offset points")
    axes.set_aspect("equal")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)
    return labelled(axes, "towards y [°]", "towards x [°]", 45)


def plot_section(height: float, radius: float, equivalent: float, axes: Axes | None = None) -> Axes:
    """The plane through satellite and Earth, to scale: ρ, H_eq and the limb (C 3.9); lengths in m."""
    axes = new_axes(axes, 4.0)
    rho = float(angular_radius(height, radius, equivalent))
    infrared, far = (radius + equivalent) / 1e6, (radius + height) / 1e6
    axes.add_patch(Circle((0, 0), infrared, fc="none", ec=RED, ls="--", lw=1))
    axes.add_patch(Circle((0, 0), radius / 1e6, fc=EARTH, ec=BLUE))
    along = far * np.cos(rho)
    for sign, name in ((-1, "1"), (1, "2")):
        limb = np.array([sign * along * np.sin(rho), far - along * np.cos(rho)])
        axes.plot([0, limb[0]], [far, limb[1]], color=GREY, lw=1)
        axes.plot(*limb, "o", color=SECOND, mec="black", ms=7)
        axes.annotate(name, limb, (8 * sign - 3, 4), textcoords="offset points", weight="bold")
    axes.plot([0, 0], [0, far], ":", color=GREY)
    axes.plot(0, far, "s", color="black", ms=6)
    axes.annotate("satellite", (0, far), (0, 8), textcoords="offset points", ha="center")
    half = max(1.35 * infrared, 0.45 * far)  # room for the names, however far the satellite is
    narrow = rho < np.radians(25)
    opening = 0.6 * (along if narrow else min(along, infrared))
    middle = 270 + np.degrees(rho)
    axes.add_patch(Arc((0, far), opening, opening, theta1=270, theta2=middle, color=RED))
    place = (0.04 * infrared, far - 0.5 * opening - 0.1 * infrared)
    if narrow:  # no room between the axis and the line to the limb
        place = (0.5 * opening * np.tan(rho) + 0.06 * half, far - 0.5 * opening)
    axes.annotate(f"ρ = {np.degrees(rho):.1f}°", place, color=RED)
    axes.set_aspect("equal")
    axes.set_xlim(-half, half)
    axes.set_ylim(-0.1 * infrared, far + max(0.18 * infrared, 0.12 * far))
    axes.set_xlabel("across [thousand km]")
    axes.set_ylabel("from the Earth's centre [thousand km]")
    return axes


def plot_signal(
    angle: np.ndarray, signal: np.ndarray, scan: Scan, axes: Axes | None = None
) -> Axes:
    """Signal (N,), full Earth = 1, along the scan angle (N,), rad, and its threshold (C 3.10)."""
    axes = new_axes(axes, 2.9)
    axes.plot(np.degrees(angle), signal, color=BLUE, label="signal")
    axes.axhline(0.5, color=GREY, ls=":", lw=1, label="threshold")
    for name, at in (("δ₁", float(scan.enter)), ("δ₂", float(scan.leave))):
        if np.isfinite(at):
            at = np.degrees((at + np.pi) % (2 * np.pi) - np.pi)
            axes.axvline(at, color=RED, ls="--", lw=1)
            axes.annotate(
                f"{name} = {at:.1f}°", (at, 1.08), ha="center", fontsize=9, color=RED,
                bbox={"fc": "white", "ec": "none", "pad": 1.5},
            )  # fmt: skip
    axes.set_ylim(-0.08, 1.2)
    axes.legend(fontsize=8, loc="center right")
    return labelled(axes, "scan angle δ [°]", "signal, share of the Earth's [1]", 45)


def plot_static(
    sensor: StaticSensor,
    nadir: np.ndarray,
    height: float,
    shares: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """Four fields on the limb and the share (4,) of each that is the Earth (C 3.13)."""
    axes = new_axes(axes, 4.4)
    outline = np.degrees(_map(_circle(nadir, float(angular_radius(height)))))
    axes.add_patch(Polygon(outline, fc=EARTH, ec=BLUE))
    design = np.degrees(_map(_circle(np.array([0.0, 0.0, 1.0]), sensor.circle)))
    axes.plot(*design.T, ":", color=GREY, lw=1, label="limb at the design height, level")
    for k, (centre, share) in enumerate(zip(sensor.directions, shares, strict=True)):
        field = np.degrees(_map(_circle(centre, sensor.field)))
        axes.add_patch(Polygon(field, fc=SECOND, ec="black", alpha=0.75))
        place = np.degrees(_map(0.62 * centre / np.sin(sensor.circle) + [0, 0, 0.9]))
        axes.annotate(f"{k + 1}: {share:.2f}", place, ha="center", va="center", fontsize=10)
    axes.plot(0, 0, ".", color="black")
    axes.plot(*np.degrees(_map(nadir)), "+", color=BLUE, ms=10, label="nadir")
    axes.set_aspect("equal")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)
    wide = sensor.circle > np.radians(40)
    return labelled(axes, "towards y [°]", "towards x [°]", 45 if wide else None)


def plot_field(orbit: OrbitField, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """The field along an orbit in local (north, east, down) and in inertial axes (C 3.16, 3.17)."""
    axes = new_row(2, height=3.2) if axes is None else axes
    for a, field, names, title in (
        (axes[0], orbit.ned, ("north", "east", "down"), "local axes"),
        (axes[1], orbit.eci, ("x", "y", "z"), "inertial axes"),
    ):
        for k, (axis, name) in enumerate(zip("xyz", names, strict=True)):
            a.plot(orbit.time / 60, 1e6 * field[:, k], LINES[axis], color=COLOURS[axis], label=name)
        a.plot(
            orbit.time / 60, 1e6 * np.linalg.norm(field, axis=1), color=GREY, lw=1, label="strength"
        )
        a.set_title(title, fontsize=10)
        a.set_xlabel("time from the node [min]")
        grid(a)
        a.legend(fontsize=7, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.18))
    axes[0].set_ylabel("field [µT]")
    return axes


def plot_pinhole(sensor: StarSensor, angle: float, axes: Axes | None = None) -> Axes:
    """A pinhole camera in section: a star `angle`, rad, off the boresight, and its image (C 3.19)."""
    axes = new_axes(axes, 3.0)
    place = sensor.focal * np.tan(angle)
    half = sensor.width / 2
    axes.plot([sensor.focal] * 2, [-half, half], color=BLUE, lw=3, label="image plane")
    axes.plot(
        [0, 1.35 * sensor.focal], [0, 1.35 * place], color=SECOND, lw=1.5, label="line to the star"
    )
    axes.plot([0, 1.35 * sensor.focal], [0, 0], ":", color=GREY, label="boresight z")
    axes.plot(0, 0, "o", color="black")
    axes.plot(sensor.focal, place, "*", color=RED, ms=13)
    axes.annotate(
        "x − x₀", (sensor.focal, place / 2), (6, -3), textcoords="offset points", color=RED
    )
    axes.annotate("f", (sensor.focal / 2, 0), (0, -14), textcoords="offset points", color=GREY)
    axes.set_xlabel("along the boresight [pixels]")
    axes.set_ylabel("in the image [pixels]")
    axes.legend(fontsize=8, loc="upper left")
    grid(axes)
    return axes


def plot_stars(
    sensor: StarSensor,
    true: np.ndarray,
    measured: np.ndarray,
    stretch: float,
    axes: Axes | None = None,
) -> Axes:
    """An image: places of the stars (k, 2), pixels, and errors of the centroids `stretch` times."""
    axes = new_axes(axes, 4.6)
    axes.plot(*true.T, "*", color=BLUE, ms=10, label="star")
    error = stretch * (measured - true)
    axes.quiver(
        *true.T, *error.T, angles="xy", scale_units="xy", scale=1, color=RED, width=0.004,
        label=f"centroid error × {stretch:g}",
    )  # fmt: skip
    axes.plot(*sensor.centre, "+", color=GREY, ms=12, label="boresight")
    axes.set_xlim(0, sensor.width)
    axes.set_ylim(0, sensor.height)
    axes.set_aspect("equal")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)
    return labelled(axes, "x in the image [pixels]", "y in the image [pixels]")


def plot_gyroscope(
    time: np.ndarray,
    raw: np.ndarray,
    corrected: np.ndarray,
    walk: np.ndarray,
    axes: Axes | None = None,
) -> Axes:
    """Error of the integrated angle (N,), rad, as read and corrected; the noise's band, one std."""
    axes = new_axes(axes, 3.2)
    minutes = time / 60
    axes.fill_between(
        minutes,
        -np.degrees(walk),
        np.degrees(walk),
        color="#DDDDDD",
        label="random walk, ± one std",
    )
    axes.plot(minutes, np.degrees(raw), color=RED, label="as read")
    axes.plot(minutes, np.degrees(corrected), "--", color=BLUE, label="corrected")
    axes.legend(fontsize=8)
    return labelled(axes, "time [min]", "error of the angle [°]")


def plot_budget(found: Sequence[Accuracy], axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Errors of each contribution, all together, and work C's figure (table 3.1)."""
    if axes is None:
        sizes = [len(a.alone) + 2 for a in found]
        _, axes = plt.subplots(
            len(found), 1, figsize=(7.2, 0.33 * sum(sizes) + 0.9), height_ratios=sizes, sharex=True,
            layout="constrained",
        )  # fmt: skip
    for a, accuracy in zip(np.atleast_1d(axes), found, strict=True):
        names = [*accuracy.alone, "together", "work C"]
        values = [*accuracy.alone.values(), accuracy.together, accuracy.printed]
        colours = [THIRD] * len(accuracy.alone) + [BLUE, GREY]
        a.barh(names, np.array(values) / DEGREE, color=colours)
        a.invert_yaxis()
        a.set_xscale("log")
        a.set_title(accuracy.sensor, fontsize=9, loc="left")
        a.tick_params(labelsize=8)
        a.grid(axis="x", color="#DDDDDD", lw=0.6)
        a.set_axisbelow(True)
    a.set_xlabel("rms error, each axis [°]")
    return axes


def _circle(centre: np.ndarray, radius: float) -> np.ndarray:
    """(361, 3) directions `radius` (rad) from `centre` (3,)."""
    side = np.cross(centre, np.eye(3)[np.argmin(np.abs(centre))])
    side /= np.linalg.norm(side)
    around = np.linspace(0, 2 * np.pi, 361)[:, None]
    across = np.cos(around) * side + np.sin(around) * np.cross(centre, side)
    return np.cos(radius) * centre + np.sin(radius) * across


def _map(direction: np.ndarray) -> np.ndarray:
    """Directions (…, 3) on a map (…, 2), rad, that keeps angle and azimuth about z; y to the right, x up.

    −z, which is the whole rim, is put at its top.
    """
    across = np.hypot(direction[..., 0], direction[..., 1])
    angle = np.arctan2(across, direction[..., 2])
    scale = angle / np.where(across > 0, across, 1.0)
    x = np.where((across == 0) & (direction[..., 2] < 0), 1.0, direction[..., 0])
    return scale[..., None] * np.stack([direction[..., 1], x], axis=-1)


def _broken(path: np.ndarray) -> np.ndarray:
    """A path (N, 2) on the map, degrees, with a gap where it passes −z and goes on at the other side."""
    jumps = np.flatnonzero(np.linalg.norm(np.diff(path, axis=0), axis=1) > 60) + 1
    return np.insert(path, jumps, np.nan, axis=0)
