"""Figures of representations of attitude and of frames: drawings in parallel projection, and curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from sensorbook.attitude.rotations import axis_rotation, lock_margin, matrix_from_axis_angle
from sensorbook.attitude.round_trips import RoundTrip
from sensorbook.plots.style import ACCENT, COLOURS, GREY, LINES, SECOND, grid, new_axes

BLUE, RED, GREEN = COLOURS.values()
IDENTITY = np.eye(3)
NAMES = ("x", "y", "z")


@dataclass(frozen=True)
class View:
    """A parallel projection: where the viewer stands, rad."""

    azimuth: float = np.radians(35)
    elevation: float = np.radians(22)

    @property
    def basis(self) -> np.ndarray:
        """Right, up and towards the viewer, as rows."""
        (sa, se), (ca, ce) = (
            np.sin([self.azimuth, self.elevation]),
            np.cos([self.azimuth, self.elevation]),
        )
        return np.array([[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points (…, 3) on the paper, and their depth: (…, 3)."""
        return np.asarray(points, dtype=float) @ self.basis.T


VIEW = View()


def plot_two_frames(matrix: np.ndarray, vector: np.ndarray, axes: Axes | None = None) -> Axes:
    """Reference and body frame of a direction-cosine matrix (3, 3), and one vector (3,), reference axes."""
    axes = _drawing(axes, 4.6)
    _frame(axes, IDENTITY, GREY, "reference ")
    _frame(axes, matrix, BLUE, "body ")
    tip = vector / np.linalg.norm(vector)
    _arrow(axes, np.zeros(3), 1.3 * tip, RED, "v", width=2.4)
    _names_apart(axes)
    return _framed(axes)


def plot_axis_and_angle(
    axis: np.ndarray, angle: float, matrix: np.ndarray, axes: Axes | None = None
) -> Axes:
    """Reference and body frame, the Euler axis (3,), and the circles on which it carries the axes."""
    axes = _drawing(axes, 4.6)
    _frame(axes, IDENTITY, GREY, "")
    _frame(axes, matrix, BLUE, "body ")
    turns = matrix_from_axis_angle(np.broadcast_to(axis, (60, 3)), np.linspace(0, angle, 60))
    for k in range(3):
        _curve(axes, turns[:, k], SECOND, "--", 1.2)  # rows are the turning frame's axes
    _arrow(axes, -0.4 * axis, 1.35 * axis, RED, "e", width=2.2)
    axes.set_title(f"Φ = {np.degrees(angle):.1f}° about e", fontsize=10)
    _names_apart(axes)
    return _framed(axes)


def plot_euler_steps(
    sequence: str, angles: np.ndarray, axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """The three rotations of Euler angles (3,), rad, one after the other."""
    if axes is None:
        _, axes = plt.subplots(1, 3, figsize=(9.0, 3.3), layout="constrained")
    kept = ["XYZ".index(letter) for letter in sequence]
    stages = [IDENTITY]
    for letter, angle in zip(sequence, angles, strict=True):
        stages.append(axis_rotation(letter, angle) @ stages[-1])
    view = _clearest([stage[k] for stage, k in zip(stages, kept, strict=False)])
    marks = ("", "′", "″", "‴")
    for n, (a, k, angle) in enumerate(zip(axes, kept, angles, strict=True)):
        _drawing(a, 0)
        now, after, name = stages[n], stages[n + 1], NAMES[k] + marks[n]
        _frame(a, now, GREY, "", marks[n], skip=k, view=view)
        _frame(a, after, BLUE, "", marks[n + 1], skip=k, view=view)
        _arrow(a, np.zeros(3), 1.06 * after[k], RED, name, view, 2.4)
        part = axis_rotation(sequence[n], np.linspace(0, angle, 30)) @ now
        for j in {0, 1, 2} - {k}:
            _curve(a, 0.8 * part[:, j], SECOND, "-", 1.4, view)
        title = f"{'φθψ'[n]} = {np.degrees(angle):.1f}° about {name}".replace("-", "−")
        a.set_title(title, fontsize=10, pad=12)
        _framed(a)
    return axes


def plot_one_rotation(angle: float, axes: Axes | None = None) -> Axes:
    """A turn about x by `angle` (rad), along x: the axes before and after (2.14)."""
    axes = _drawing(axes, 3.6)
    c, s = np.cos(angle), np.sin(angle)
    before, after = [((1, 0), "y"), ((0, 1), "z")], [((c, s), "y′"), ((-s, c), "z′")]
    for pairs, colour in ((before, GREY), (after, BLUE)):
        for tip, name in pairs:
            _arrow2(axes, (0, 0), tip, colour)
            axes.text(*(1.1 * np.array(tip)), name, color=colour, ha="center", va="center")
    arc = np.linspace(0, angle, 40)
    for start in (0, np.pi / 2):
        axes.plot(0.45 * np.cos(start + arc), 0.45 * np.sin(start + arc), color=SECOND, lw=1.4)
        at = start + angle / 2
        axes.text(
            0.56 * np.cos(at), 0.56 * np.sin(at), "α", color="black", ha="center", va="center"
        )
    axes.plot([c, c], [0, s], ":", color=GREY, lw=1)
    axes.plot([0, c], [s, s], ":", color=GREY, lw=1)
    axes.text(c / 2, -0.09 if s >= 0 else 0.05, "cos α", fontsize=8, color=GREY, ha="center")
    axes.text(c + 0.04, s / 2, "sin α", fontsize=8, color=GREY, va="center")
    axes.plot(0, 0, "o", mfc="white", mec="black", ms=9)
    axes.plot(0, 0, "o", color="black", ms=3)
    axes.text(-0.08, -0.04, "x, towards you", fontsize=8, ha="right", va="center")
    return _framed(axes)


def plot_round_trips(
    trips: Mapping[str, RoundTrip], axes: Sequence[Axes] | None = None
) -> Sequence[Axes]:
    """Error against distance from the singularity, a panel a representation named by its x label."""
    if axes is None:
        _, axes = plt.subplots(1, len(trips), figsize=(9.6, 3.5), layout="constrained", sharey=True)
    for a, (label, trip) in zip(axes, trips.items(), strict=True):
        for values, colour, line, name in (
            (trip.printed, RED, "--", "as C prints it"),
            (trip.ours, BLUE, "-", "sensorbook"),
        ):
            a.plot(trip.distance, np.maximum(values, 1e-18), line, color=colour, lw=1.8, label=name)
        a.set_xscale("log")
        a.set_yscale("log")
        a.set_ylim(1e-18, 30)
        a.set_xticks([1e-16, 1e-12, 1e-8, 1e-4, 1])
        a.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1])
        a.minorticks_off()
        grid(a)
        a.set_xlabel(label)
    axes[0].set_ylabel("largest error [rad]")
    axes[0].legend(frameon=False, fontsize=8, loc="upper right")
    return axes


def plot_amplification(
    sequence: str,
    second: np.ndarray,
    errors: np.ndarray,
    error: float,
    given: float,
    axes: Axes | None = None,
) -> Axes:
    """Rms errors (N, 3) of Euler angles over the second angle (N,) where the attitude errs by `error`; rad.

    `given` is the second angle of the attitude at hand.
    """
    axes = new_axes(axes)
    fine = np.linspace(second.min(), second.max(), 2000)
    margin = lock_margin(sequence, np.column_stack([fine, fine, fine]))
    with np.errstate(divide="ignore"):
        curve = np.degrees(error) / margin
    axes.plot(np.degrees(fine), curve, color=GREY, lw=1, label="attitude error / lock margin")
    for k, (name, mark) in enumerate(
        (("first angle, φ", "o"), ("second, θ", "s"), ("third, ψ", "^"))
    ):
        colour = list(COLOURS.values())[k]
        axes.plot(
            np.degrees(second), np.degrees(errors[:, k]), mark, color=colour, ms=4.5, label=name
        )
    axes.axvline(np.degrees(given), color=ACCENT, ls=LINES["z"], lw=1.5, label="attitude at hand")
    axes.set_yscale("log")
    axes.set_ylim(0.5 * np.degrees(error), 200)
    axes.set_xlim(np.degrees(second.min()), np.degrees(second.max()))
    axes.set_xlabel("second angle θ [°]")
    axes.set_ylabel("rms error [°]")
    grid(axes)
    axes.legend(
        frameon=True, framealpha=0.9, edgecolor="none", fontsize=8, loc="upper center", ncols=2
    )
    return axes


def plot_earth_frames(sidereal: float, axes: Axes | None = None) -> Axes:
    """Inertial and Earth-fixed frames, turned by the sidereal angle, rad."""
    axes = _drawing(axes, 4.6)
    # Both x axes on the viewer's side.
    turn = sidereal % (2 * np.pi)
    view = View(turn / 2 + (np.pi if turn > np.pi else 0) + np.radians(8), np.radians(22))
    _globe(axes, turn, view)
    names = ("X, to the equinox", "Y", "Z = z")
    _frame(axes, 1.75 * IDENTITY, GREY, "", names=names, view=view, globe=True)
    fixed = 1.75 * axis_rotation("Z", turn)
    _frame(axes, fixed, BLUE, "", names=("x, Greenwich", "y", "z"), skip=2, view=view, globe=True)
    arc = np.linspace(0, turn, 200)
    ring = view(1.25 * np.column_stack([np.cos(arc), np.sin(arc), 0 * arc]))
    _in_front(axes, ring, 1.8, SECOND)
    shown = ring[_unhidden(ring)]
    at = 1.13 * shown[len(shown) // 3, :2] + [0, -0.03]
    axes.text(*at, "θ", color="black", ha="center", va="center", fontsize=11)
    return _framed(axes)


def plot_tangent_frames(
    orbit: np.ndarray,
    position: np.ndarray,
    frames: Mapping[str, np.ndarray],
    sidereal: float,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """Frames at a satellite: one panel each; `orbit` (N, 3) and `position` (3,) in any one length.

    `frames` are direction-cosine matrices from the inertial frame, whose axes are drawn.
    """
    if axes is None:
        _, axes = plt.subplots(1, len(frames), figsize=(9.6, 3.7), layout="constrained")
    radius = np.linalg.norm(position)
    # Seen from the satellite's side, so that neither it nor its axes hide behind the Earth.
    where = np.arctan2(position[1], position[0])
    view = View(where - np.radians(50), np.radians(20))
    circle, here = 1.25 * orbit / radius, 1.25 * position / radius
    for a, (name, matrix) in zip(axes, frames.items(), strict=True):
        _drawing(a, 0)
        _globe(a, sidereal, view)
        _in_front(a, view(circle), 1.4, SECOND)
        names = ("N", "E", "D") if name.startswith("north") else NAMES
        _frame(a, 0.72 * matrix, BLUE, "", origin=here, names=names, view=view)
        a.plot(*view(here)[:2], "s", color="black", ms=6, zorder=6)
        a.set_title(name, fontsize=10)
        _framed(a)
    return axes


def plot_geodetic(latitude: float, flattening: float = 0.35, axes: Axes | None = None) -> Axes:
    """The meridian's section through a point: geodetic and geocentric latitude, on a flattened ellipse.

    `latitude` is geodetic, rad; the ellipse is drawn far flatter than the Earth, for the eye.
    """
    axes = _drawing(axes, 4.2)
    b = 1 - flattening
    turn = np.linspace(0, 2 * np.pi, 300)
    axes.plot(np.cos(turn), b * np.sin(turn), color=GREY, lw=1.2)
    n = 1 / np.sqrt(np.cos(latitude) ** 2 + b**2 * np.sin(latitude) ** 2)
    foot = n * np.array([np.cos(latitude), b**2 * np.sin(latitude)])
    normal = np.array([np.cos(latitude), np.sin(latitude)])
    point, crossing = foot + 0.4 * normal, np.array([n * (1 - b**2) * np.cos(latitude), 0.0])
    axes.plot([-1.1, 1.45], [0, 0], color=GREY, lw=0.8)
    axes.plot([0, 0], [-b - 0.1, b + 0.2], color=GREY, lw=0.8)
    axes.plot(*np.transpose([crossing, foot]), "--", color=BLUE, lw=1.2)
    _arrow2(axes, foot, point, BLUE)
    axes.plot(*np.transpose([(0, 0), point]), "--", color=RED, lw=1.2)
    tangent = 0.45 * np.array([-normal[1], normal[0]])
    axes.plot(*np.transpose([foot - tangent, foot + tangent]), color=GREY, lw=1)
    centric = np.arctan2(point[1], point[0])
    for start, angle, colour, size in (
        (crossing, latitude, BLUE, 0.26),
        (np.zeros(2), centric, RED, 0.34),
    ):
        arc = np.linspace(0, angle, 40)
        axes.plot(start[0] + size * np.cos(arc), size * np.sin(arc), color=colour, lw=1.6)
    axes.plot(*point, "o", color="black", ms=6)
    axes.plot(0, 0, "o", color="black", ms=3)
    side = 1 if latitude >= 0 else -1
    beside = foot + 0.24 * normal + 0.08 * side * np.array([normal[1], -normal[0]])
    axes.text(*beside, "h", color=BLUE, ha="center", va="center")
    notes = [("φ, geodetic: to the ellipsoid's normal", BLUE), ("to the centre: geocentric", RED)]
    for k, (text, colour) in enumerate(notes):
        axes.text(-1.62, 1.08 - 0.13 * k, text, color=colour, fontsize=9)
    axes.text(
        -1.62, -1.1, f"flattening drawn {flattening * 298.257:.0f} times too large", fontsize=8
    )
    return _framed(axes)


def plot_latitude_difference(
    latitude: np.ndarray, difference: Mapping[str, np.ndarray], axes: Axes | None = None
) -> Axes:
    """Geodetic less geocentric latitude (N,), rad, over geodetic latitude, one curve a height."""
    axes = new_axes(axes, height=3.4)
    for (name, values), colour, line in zip(
        difference.items(), COLOURS.values(), LINES.values(), strict=False
    ):
        axes.plot(np.degrees(latitude), np.degrees(values), line, color=colour, lw=1.8, label=name)
    axes.set_xlabel("geodetic latitude [°]")
    axes.set_ylabel("geodetic − geocentric [°]")
    axes.set_xlim(-90, 90)
    axes.set_xticks(np.arange(-90, 91, 30))
    grid(axes)
    axes.legend(frameon=False, fontsize=9)
    return axes


def plot_missed(
    years: np.ndarray, missed: np.ndarray, here: tuple[float, float], axes: Axes | None = None
) -> Axes:
    """The angle (N,), rad, that the sidereal angle alone misses from J2000's axes, over years (N,).

    `here` is a year and its angle.
    """
    axes = new_axes(axes, height=3.4)
    axes.plot(years, np.degrees(missed), color=BLUE, lw=1.8)
    axes.plot(here[0], np.degrees(here[1]), "o", color=RED, ms=8, label="the time at hand")
    axes.set_xlabel("year")
    axes.set_ylabel("angle missed [°]")
    axes.set_ylim(bottom=0)
    grid(axes)
    axes.legend(frameon=False, fontsize=9)
    return axes


# --- drawing ---


def _clearest(turning: Sequence[np.ndarray]) -> View:
    """The view that sees no turn about these axes edge-on."""
    views = [View(np.radians(azimuth), np.radians(26)) for azimuth in range(5, 90, 5)]
    return max(views, key=lambda view: min(abs(view.basis[2] @ axis) for axis in turning))


def _drawing(axes: Axes | None, height: float) -> Axes:
    if axes is None:
        _, axes = plt.subplots(figsize=(5.6, height), layout="constrained")
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    return axes


def _framed(axes: Axes) -> Axes:
    axes.margins(0.1)
    axes.autoscale_view()
    return axes


def _arrow2(axes: Axes, start: Sequence[float], tip: Sequence[float], colour, width=1.8) -> None:
    style = {"arrowstyle": "-|>,head_length=0.5,head_width=0.22", "color": colour, "lw": width}
    axes.update_datalim([start, tip])  # annotations do not count
    axes.annotate("", xy=tip, xytext=start, arrowprops=style | {"shrinkA": 0, "shrinkB": 0})


def _arrow(axes: Axes, start, tip, colour, name, view: View = VIEW, width: float = 1.8) -> None:
    """An arrow in space, its name beyond its tip."""
    from_, to = view(start)[:2], view(tip)[:2]
    _arrow2(axes, from_, to, colour, width)
    along = to - from_
    length = np.linalg.norm(along)
    out = along / length if length > 0.15 else np.array([0.7, -0.7])  # towards the viewer: aside
    beyond = to + 0.1 * out
    axes.update_datalim([beyond])
    side = "left" if out[0] > 0.4 else "right" if out[0] < -0.4 else "center"
    axes.text(*beyond, name, color=colour, ha=side, va="center", fontsize=10)


def _names_apart(axes: Axes) -> None:
    """Names that would stand on each other, as those of two frames in one, one beyond the other."""
    standing: list[np.ndarray] = []
    for text in axes.texts:
        if not text.get_text():
            continue
        at = np.array(text.get_position(), dtype=float)
        while any(abs(at - other)[0] < 0.35 and abs(at - other)[1] < 0.12 for other in standing):
            at[1] += 0.13 if at[1] > 0 else -0.13
        standing.append(at)
        text.set_position(at)
        text.set_path_effects([withStroke(linewidth=3, foreground="white")])
        axes.update_datalim([at])


def _frame(
    axes: Axes,
    matrix: np.ndarray,
    colour: str,
    prefix: str,
    suffix: str = "",
    *,
    origin=(0.0, 0.0, 0.0),
    names: Sequence[str] = NAMES,
    skip: int | None = None,
    view: View = VIEW,
    globe: bool = False,
) -> None:
    """The axes of a frame, rows of `matrix`; with a `globe` only what is outside it and not behind."""
    for k, name in enumerate(names):
        if k == skip:
            continue
        start, tip = np.asarray(origin), np.asarray(origin) + matrix[k]
        if globe:
            way = np.linspace(0.0, 1.0, 400)[:, None] * tip
            outside = np.linalg.norm(way, axis=1) >= 1
            shown = way[outside & _unhidden(view(way))]
            if not len(shown):
                continue
            start = shown[0]
        _arrow(axes, start, tip, colour, f"{prefix}{name}{suffix}", view)


def _curve(axes: Axes, points: np.ndarray, colour, line, width, view: View = VIEW) -> None:
    axes.plot(*view(points)[:, :2].T, line, color=colour, lw=width)


def _globe(axes: Axes, sidereal: float, view: View = VIEW) -> None:
    """The unit sphere with equator, parallels and meridians; Greenwich's stronger."""
    turn = np.linspace(0, 2 * np.pi, 361)
    axes.fill(np.cos(turn), np.sin(turn), facecolor="#E4EDF5", edgecolor=GREY, lw=1.1, zorder=0)
    for degrees in (-60, -30, 0, 30, 60):
        f = np.radians(degrees)
        ring = np.column_stack(
            [np.cos(f) * np.cos(turn), np.cos(f) * np.sin(turn), 0 * turn + np.sin(f)]
        )
        _in_front(axes, view(ring), 1.2 if degrees == 0 else 0.4)
    up = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for k in range(12):
        e = sidereal + k * np.pi / 6
        ring = np.column_stack([np.cos(up) * np.cos(e), np.cos(up) * np.sin(e), np.sin(up)])
        _in_front(axes, view(ring), 1.6 if k == 0 else 0.4, BLUE if k == 0 else GREY)


def _in_front(axes: Axes, seen: np.ndarray, width: float, colour: str = GREY) -> None:
    shown = np.where(_unhidden(seen)[:, None], seen[:, :2], np.nan)
    axes.plot(*shown.T, color=colour, lw=width, alpha=0.8, zorder=1)


def _unhidden(seen: np.ndarray) -> np.ndarray:
    """Which projected points (N, 3) the unit sphere does not hide."""
    return (seen[:, 2] >= -1e-9) | (np.hypot(seen[:, 0], seen[:, 1]) > 1 + 1e-9)
