"""Figures of attitude sensors: the Sun, the horizon, the field and the stars as sensors see them."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Polygon, Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sensorbook.attitude.sensors.budget import DEGREE, Accuracy
from sensorbook.attitude.sensors.conical import Scan, angular_radius, scan_vectors
from sensorbook.attitude.sensors.magnetic import OrbitField
from sensorbook.attitude.sensors.star import StarSensor
from sensorbook.attitude.sensors.static import StaticSensor
from sensorbook.attitude.sensors.sun import (
    SlitSensor,
    cell_currents,
    four_normals,
    pair_angle,
    pair_normals,
)
from sensorbook.plots.style import COLOURS, GREY, LINES, SECOND, THIRD, grid, new_axes, new_row

BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
EARTH = "#BFD7EA"


def plot_cell(angle: float, axes: Axes | None = None) -> Axes:
    """Current of one cell against the Sun's angle (C 3.2); both angles that fit that at `angle`, rad."""
    axes = new_axes(axes, 2.9)
    around = np.linspace(-np.pi, np.pi, 721)
    axes.plot(np.degrees(around), _currents(around, np.array([[0.0, 0.0, 1.0]]))[:, 0], color=BLUE)
    current = max(np.cos(angle), 0.0)
    axes.axhline(current, color=GREY, lw=0.8, ls=":")
    both = np.degrees([-angle, angle])
    axes.plot(both, [current, current], "o", color=RED, label="angles that fit one reading")
    axes.legend(fontsize=8)
    return _labels(
        axes, "angle of the Sun from the normal [°]", "current, share of the full one [1]", 45
    )


def plot_pair(tilt: float, axes: Axes | None = None) -> Axes:
    """Currents of a pair tilted by `tilt`, rad, their difference (C 3.4), and where both are lit."""
    axes = new_axes(axes, 3.3)
    around = np.linspace(-np.pi, np.pi, 721)
    currents = _currents(around, pair_normals(tilt))
    lit = np.degrees(around[pair_angle(currents, tilt, 1.0).reasons == ""])
    axes.axvspan(lit.min(), lit.max(), color="#EEEEEE", label="both lit")
    for k, style in enumerate(("--", "-.")):
        axes.plot(np.degrees(around), currents[:, k], style, color=GREY, lw=1, label=f"I{'₁₂'[k]}")
    axes.plot(np.degrees(around), currents[:, 0] - currents[:, 1], color=BLUE, label="I₁ − I₂")
    inside = np.linspace(lit.min(), lit.max(), 50)
    axes.plot(inside, 2 * np.sin(tilt) * np.radians(inside), ":", color=RED, label="tangent at 0")
    axes.legend(fontsize=8, ncols=2)
    return _labels(axes, "angle of the Sun θ [°]", "current, share of the full one [1]", 45)


def plot_four_cells(tilt: float, sun: np.ndarray, axes: Axes | None = None) -> Axes:
    """Four cells on a pyramid, their normals, and the Sun's direction (3,) (C 3.5)."""
    axes = _space(axes)
    centres = 0.62 * four_normals(tilt) * [1, 1, 0]
    for k, (normal, centre) in enumerate(zip(four_normals(tilt), centres, strict=True)):
        side = np.cross([0, 0, 1.0], normal) / np.sin(tilt)
        up = np.cross(normal, side)
        corners = centre + 0.24 * np.array([side + up, side - up, -side - up, -side + up])
        lit = max(float(normal @ sun), 0.0)
        colour = plt.cm.Oranges(0.1 + 0.5 * lit)
        axes.add_collection3d(Poly3DCollection([corners], facecolors=[colour], edgecolors=[GREY]))
        axes.quiver(*centre, *(0.5 * normal), color=GREY, lw=1, arrow_length_ratio=0.15)
        axes.text(*(centre + 0.62 * normal), f"n{'₁₂₃₄'[k]}", ha="center")
    axes.quiver(0, 0, 0, *(1.25 * sun), color=RED, lw=2, arrow_length_ratio=0.08)
    axes.text(*(1.35 * sun), "Sun", color=RED)
    _triad(axes, 0.9)
    _cube(axes, [-0.9, 0.9], [-0.9, 0.9], [-0.3, 1.3], zoom=1.35)
    return axes


def plot_slit(sensor: SlitSensor, angle: float, axes: Axes | None = None) -> Axes:
    """Section of a slit sensor: the line of light at `angle`, rad, on the row of pixels (C 3.6)."""
    axes = new_axes(axes, 4.2)
    half, height = 1e3 * sensor.pixels * sensor.pitch / 2, 1e3 * sensor.height
    gap = 0.02 * half
    for low, high in ((-half, -gap), (gap, half)):
        axes.add_patch(Rectangle((low, height), high - low, 0.04 * height, color=GREY))
    shown = 32  # drawn coarser than they are
    for k in range(shown):
        edge = -half + 2 * half * k / shown
        lit = edge <= height * np.tan(angle) < edge + 2 * half / shown
        colour = SECOND if lit else "white"
        axes.add_patch(
            Rectangle(
                (edge, -0.08 * height), 2 * half / shown, 0.08 * height, fc=colour, ec=GREY, lw=0.6
            )
        )
    reach = 0.45 * height
    axes.plot(
        [-reach * np.tan(angle), height * np.tan(angle)], [height + reach, 0], color=SECOND, lw=2
    )
    axes.plot([0, 0], [0, height + reach], ":", color=GREY, lw=1)
    size = 0.9 * height
    turn = np.degrees(angle)
    arc = Arc(
        (0, height), size, size, angle=270, theta1=min(0, turn), theta2=max(0, turn), color=RED
    )
    axes.add_patch(arc)
    middle = angle / 2
    axes.annotate(
        f"α = {turn:.0f}°",
        (0.45 * height * np.sin(middle), height - 0.45 * height * np.cos(middle)),
        (8, -14),
        textcoords="offset points",
        color=RED,
    )
    axes.text(-half, 1.07 * height, "slit", color=GREY)
    axes.text(-half, 0.03 * height, f"{sensor.pixels} pixels (drawn as {shown})", color=GREY)
    axes.set_aspect("equal")
    axes.set_xlim(-1.05 * half, 1.05 * half)
    axes.set_ylim(-0.15 * height, 1.5 * height)
    axes.set_xlabel("along the detector [mm]")
    axes.set_ylabel("above it [mm]")
    return axes


def plot_slit_errors(sensor: SlitSensor, axes: Axes | None = None) -> Axes:
    """Error of a slit's angle over a few pixels: half a pixel at most, a saw's teeth."""
    axes = new_axes(axes, 2.6)
    angle = np.linspace(0, 4 * sensor.pitch / sensor.height, 2000)
    sun = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    error = sensor.angles(sensor.read(sun))[:, 0] - angle
    axes.plot(3600 * np.degrees(angle), 3600 * np.degrees(error), color=BLUE)
    for sign in (-1, 1):
        axes.axhline(sign * 3600 * np.degrees(sensor.quantisation), color=RED, ls="--", lw=1)
    return _labels(axes, "angle of the Sun [″]", "error [″]")


def plot_sun_vector(alpha: float, beta: float, axes: Axes | None = None) -> Axes:
    """The Sun's vector in the slit sensor's frame and its two angles, rad (C 3.7)."""
    axes = _space(axes)
    point = np.array([1, np.tan(alpha), np.tan(beta)])
    axes.quiver(0, 0, 0, *point, color=RED, lw=2, arrow_length_ratio=0.06)
    axes.text(*(1.06 * point), "Sun", color=RED)
    for part, name, colour, lift in (
        (point * [1, 1, 0], f"α = {np.degrees(alpha):.0f}°", BLUE, -0.05),
        (point * [1, 0, 1], f"β = {np.degrees(beta):.0f}°", GREEN, -0.04),
    ):
        axes.plot(*np.stack([0 * part, part, point]).T, "--", color=colour, lw=1)
        turn = np.linspace(0, 1, 30)[:, None]
        arc = (1 - turn) * np.array([1.0, 0, 0]) + turn * part
        arc *= 0.5 / np.linalg.norm(arc, axis=1, keepdims=True)
        axes.plot(*arc.T, color=colour)
        axes.text(*(1.04 * part + [0, 0, lift]), name, color=colour)
    _triad(axes, 0.8)
    lows, highs = np.minimum(point, 0) - 0.05, np.maximum(point, 0.85)
    _cube(axes, *zip(lows, highs, strict=True))
    return axes


def plot_scans(
    nadirs: dict[str, np.ndarray],
    height: float,
    cone: float,
    scans: dict[int, Scan],
    axes: Axes | None = None,
) -> Axes:
    """The sky of the body: the Earth about its nadirs (3,), scans by side (1, −1), their crossings.

    The map keeps angles from the body's z axis, which is in the middle; y is to the right and x up. The
    first of `nadirs` is drawn as a disc, the others as outlines (C 3.8, 3.11, 3.12).
    """
    axes = new_axes(axes, 4.6)
    rho = float(angular_radius(height))
    for k, (name, nadir) in enumerate(nadirs.items()):
        outline = np.degrees(_map(_circle(nadir, rho)))
        colour = BLUE if k == 0 else RED
        if k == 0:
            axes.add_patch(Polygon(outline, fc=EARTH, ec="none"))
        axes.plot(*outline.T, color=colour, ls="-" if k == 0 else "--", lw=1.5, label=name)
        axes.plot(*np.degrees(_map(nadir)), "+", color=colour, ms=9)
    number = 1
    for side, scan in scans.items():
        around = np.linspace(-np.pi, np.pi, 361)
        name = "scan" if len(scans) == 1 else f"scan about {'y' if side == 1 else '−y'}"
        path = np.degrees(_map(scan_vectors(cone, around, side)))
        axes.plot(*path.T, color=GREY, ls="-" if side == 1 else "-.", lw=1, label=name)
        for angle in (float(scan.enter), float(scan.leave)):
            if np.isfinite(angle):
                place = np.degrees(_map(scan_vectors(cone, angle, side)))
                axes.plot(*place, "o", color=SECOND, mec="black", ms=8, zorder=4)
                axes.annotate(str(number), place, (7, 5), textcoords="offset points", weight="bold")
            number += 1
    axes.plot(0, 0, ".", color="black")
    axes.annotate("z", (0, 0), (-12, 5), textcoords="offset points")
    axes.set_aspect("equal")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)
    return _labels(axes, "towards y [°]", "towards x [°]", 45)


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
    axes.annotate("satellite", (0, far), (8, 5), textcoords="offset points")
    opening = 0.6 * min(along, infrared)
    middle = 270 + np.degrees(rho)
    axes.add_patch(Arc((0, far), opening, opening, theta1=270, theta2=middle, color=RED))
    axes.annotate(
        f"ρ = {np.degrees(rho):.1f}°",
        (0.04 * infrared, far - 0.5 * opening - 0.1 * infrared),
        color=RED,
    )
    axes.set_aspect("equal")
    axes.set_xlim(-1.35 * infrared, 1.35 * infrared)
    axes.set_ylim(-0.1 * infrared, far + 0.18 * infrared)
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
    return _labels(axes, "scan angle δ [°]", "signal, share of the Earth's [1]", 45)


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
    return _labels(axes, "towards y [°]", "towards x [°]", 45)


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
        a.legend(fontsize=7, ncols=2)
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
    return _labels(axes, "x in the image [pixels]", "y in the image [pixels]")


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
    return _labels(axes, "time [min]", "error of the angle [°]")


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


def _currents(angles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Currents (N, k) with the Sun at `angles` (N,) from z towards x."""
    return cell_currents(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1), normals)


def _circle(centre: np.ndarray, radius: float) -> np.ndarray:
    """(361, 3) directions `radius` (rad) from `centre` (3,)."""
    side = np.cross(centre, np.eye(3)[np.argmin(np.abs(centre))])
    side /= np.linalg.norm(side)
    around = np.linspace(0, 2 * np.pi, 361)[:, None]
    across = np.cos(around) * side + np.sin(around) * np.cross(centre, side)
    return np.cos(radius) * centre + np.sin(radius) * across


def _map(direction: np.ndarray) -> np.ndarray:
    """Directions (…, 3) on a map (…, 2), rad, that keeps angle and azimuth about z; y to the right, x up."""
    across = np.hypot(direction[..., 0], direction[..., 1])
    angle = np.arctan2(across, direction[..., 2])
    scale = angle / np.where(across > 0, across, 1.0)
    return scale[..., None] * np.stack([direction[..., 1], direction[..., 0]], axis=-1)


def _space(axes: Axes | None) -> Axes:
    if axes is None:
        figure = plt.figure(figsize=(4.8, 4.2), layout="constrained")
        axes = figure.add_subplot(projection="3d")
    axes.view_init(22, -55)
    return axes


def _triad(axes: Axes, length: float) -> None:
    for k, name in enumerate("xyz"):
        end = length * np.eye(3)[k]
        axes.plot(*np.stack([0 * end, end]).T, color="black", lw=1)
        axes.text(*(1.08 * end), name)


def _cube(axes: Axes, x, y, z, zoom: float = 1.0) -> None:
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_zlim(*z)
    axes.set_box_aspect([np.ptp(x), np.ptp(y), np.ptp(z)], zoom=zoom)
    axes.set_axis_off()


def _labels(axes: Axes, x: str, y: str, step: float | None = None) -> Axes:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if step:
        axes.xaxis.set_major_locator(plt.MultipleLocator(step))
        if axes.get_aspect() == 1.0:
            axes.yaxis.set_major_locator(plt.MultipleLocator(step))
    grid(axes)
    return axes
