"""Figures of attitude sensors: what they draw, with labels and units."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sensorbook.attitude.sensors import budget, conical, horizon, magnetic, star, static, sun
from sensorbook.plots import attitude_sensors as plots
from sensorbook.plots import sun_sensors

HEIGHT, CONE, TILT = 700e3, np.radians(45), np.radians(45)
BODY = horizon.tilted(0.1, -0.07)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def line(axes, label):
    return next(a.get_xydata() for a in axes.get_lines() if a.get_label() == label)


def test_cell_and_pair():
    axes = sun_sensors.plot_cell(np.radians(35))
    assert axes.get_xlabel() == "angle of the Sun from the normal [°]"
    assert line(axes, "angles that fit one reading") == pytest.approx(
        np.array([[-35, np.cos(np.radians(35))], [35, np.cos(np.radians(35))]])
    )
    axes = sun_sensors.plot_pair(TILT)
    difference = line(axes, "I₁ − I₂")
    at = np.argmin(np.abs(difference[:, 0] - 30))
    assert difference[at, 1] == pytest.approx(2 * np.sin(TILT) * np.sin(np.radians(30)))


def test_cell_geometry():
    one, pair = sun_sensors.plot_cell_geometry(np.radians(30), TILT)
    cell = one.get_lines()[0].get_xydata()
    assert cell[:, 1] == pytest.approx(0), "level: its normal is up"
    slopes = [np.diff(a.get_xydata(), axis=0)[0] for a in pair.get_lines() if a.get_lw() == 5]
    assert [s[1] / s[0] for s in slopes] == pytest.approx([-1, 1])  # 45° either way
    assert {"n₁", "n₂", "Sun", "θ"} <= {t.get_text() for t in pair.texts}
    rays = [np.diff(a.get_xydata(), axis=0)[0] for a in pair.get_lines() if a.get_lw() == 0.8]
    assert np.arctan2(*np.array(rays).T) == pytest.approx(np.radians(30))
    behind = sun_sensors.plot_cell_geometry(np.radians(60), TILT)[1]
    assert sum(a.get_lw() == 0.8 for a in behind.get_lines()) == 3, "one cell is dark"


def test_slit():
    sensor = sun.SlitSensor(10e-3, 7e-6, 2048)
    axes = sun_sensors.plot_slit(sensor, np.radians(20))
    ray = axes.get_lines()[0].get_xydata()
    assert ray[1] == pytest.approx([10 * np.tan(np.radians(20)), 0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("along the detector [mm]", "above it [mm]")
    teeth = sun_sensors.plot_slit_errors(sensor).get_lines()[0].get_ydata()
    assert np.abs(teeth).max() == pytest.approx(3600 * np.degrees(7e-4) / 2, rel=0.01)


def test_slit_s_names_stand_clear_of_the_ray_and_no_ray_comes_from_behind():
    sensor = sun.SlitSensor(10e-3, 7e-6, 2048)
    for turn in (20, -14, 35):
        axes = sun_sensors.plot_slit(sensor, np.radians(turn))
        axes.figure.canvas.draw()
        angle = next(t for t in axes.texts if t.get_text() == f"α = {turn}°")
        box = angle.get_window_extent().transformed(axes.transData.inverted())
        assert (box.x0 > 0) if turn < 0 else (box.x1 < 0), "the side without the ray"
        pixels = next(t for t in axes.texts if "pixels" in t.get_text())
        box = pixels.get_window_extent().transformed(axes.transData.inverted())
        assert box.y1 < -0.8, "below the row, where neither the ray nor the dotted line goes"
    axes = sun_sensors.plot_slit(sensor, np.radians(95))
    assert "the Sun is behind" in [t.get_text() for t in axes.texts]
    assert len(axes.get_lines()) == 1, "the dotted line alone"
    assert sun_sensors.plot_cell(np.radians(95)).get_legend() is None, "a dark cell fits any angle"


@pytest.mark.parametrize("degrees", [5, 45, 85])
def test_four_cells_do_not_meet(degrees):
    axes = sun_sensors.plot_four_cells(np.radians(degrees), np.array([0.3, -0.2, 0.93]))
    corners = [np.array(c._faces[0]) for c in axes.collections if isinstance(c, Poly3DCollection)]
    assert len(corners) == 4
    # The first cell lies right of the lines |y| = x, which part it from its neighbours.
    for cell, axis, sign in zip(corners, (0, 0, 1, 1), (1, -1, 1, -1), strict=True):
        assert (sign * cell[:, axis] > np.abs(cell[:, 1 - axis])).all()


@pytest.mark.parametrize("draw", [
    lambda: sun_sensors.plot_four_cells(TILT, np.array([0.3, -0.2, 0.93])),
    lambda: sun_sensors.plot_sun_vector(0.5, -0.3),
])  # fmt: skip
def test_space_figures_name_the_sun_and_the_axes(draw):
    assert {"Sun", "x", "y", "z"} <= {t.get_text() for t in draw().texts}


def test_scans_draw_the_limb_the_path_and_the_crossings():
    first, second = conical.scan(BODY, HEIGHT, CONE), conical.scan(BODY, HEIGHT, CONE, -1)
    axes = plots.plot_scans({"Earth": BODY[:, 2]}, HEIGHT, CONE, {1: first, -1: second})
    dots = [a for a in axes.get_lines() if a.get_marker() == "o"]
    assert len(dots) == 4
    for dot in dots:
        for name in ("Earth", "scan about y", "scan about −y"):
            gap = np.linalg.norm(line(axes, name) - dot.get_xydata(), axis=1).min()
            if name == "Earth":
                assert gap < 1, "on the limb"
    assert axes.get_xlabel() == "towards y [°]"
    gone = conical.scan(BODY, 8000e3, np.radians(20))
    axes = plots.plot_scans({"Earth": BODY[:, 2]}, 8000e3, np.radians(20), {1: gone})
    assert not [a for a in axes.get_lines() if a.get_marker() == "o"]


def shaded(axes, direction):
    """Whether the last patch over a direction's place on the map is the Earth's."""
    place = axes.transData.transform(np.degrees(plots._map(direction)))
    over = [p for p in axes.patches if p.contains_point(place)]
    return bool(over) and over[-1].get_facecolor() == to_rgba(plots.EARTH)


@pytest.mark.parametrize(("roll", "pitch"), [(6, 4), (120, 0), (180, 4), (-175, 10), (0, 118)])
def test_the_disc_is_shaded_on_the_nadir_s_side(roll, pitch):
    body = horizon.tilted(*np.radians([roll, pitch]))
    nadir, rho = body[:, 2], float(conical.angular_radius(HEIGHT))
    axes = plots.plot_scans({"Earth": nadir}, HEIGHT, CONE, {1: conical.scan(body, HEIGHT, CONE)})
    axes.figure.canvas.draw()
    some = np.random.default_rng(4).normal(size=(200, 3))
    some /= np.linalg.norm(some, axis=1, keepdims=True)
    away = np.arccos(some @ nadir)
    for direction in some[(np.abs(away - rho) > 0.05) & (some[:, 2] > -0.99)]:
        assert shaded(axes, direction) == (direction @ nadir > np.cos(rho))


def test_a_scan_through_minus_z_is_broken_there_and_places_that_agree_share_a_label():
    cone = np.pi / 2
    both = {side: conical.scan(BODY, HEIGHT, cone, side) for side in (1, -1)}
    axes = plots.plot_scans({"Earth": BODY[:, 2]}, HEIGHT, cone, both)
    assert [t.get_text() for t in axes.texts if t.get_text() != "z"] == ["1, 3", "2, 4"]
    for name in ("scan about y", "scan about −y"):
        steps = np.linalg.norm(np.diff(line(axes, name), axis=0), axis=1)
        assert np.nanmax(steps) < 2
    assert np.hypot(*plots._map(np.array([0.0, 0.0, -1.0]))) == pytest.approx(np.pi)


@pytest.mark.parametrize("height", [100e3, 700e3, 35786e3])
def test_section_keeps_its_names_inside(height):
    axes = plots.plot_section(height, conical.RADIUS, conical.EQUIVALENT_HEIGHT)
    axes.figure.canvas.draw()
    frame = axes.get_window_extent()
    for text in axes.texts:
        box = text.get_window_extent()
        assert frame.x0 < box.x0, text.get_text()
        assert box.x1 < frame.x1, text.get_text()
        assert box.y1 < frame.y1, text.get_text()


def test_section_and_signal():
    axes = plots.plot_section(HEIGHT, conical.RADIUS, conical.EQUIVALENT_HEIGHT)
    limb = [a.get_xydata()[0] for a in axes.get_lines() if a.get_marker() == "o"]
    assert np.linalg.norm(limb, axis=1) == pytest.approx(6.411)
    first = conical.scan(BODY, HEIGHT, CONE)
    angle = np.linspace(-np.pi, np.pi, 9)
    axes = plots.plot_signal(angle, np.zeros(9), first)
    assert f"δ₁ = {np.degrees(first.enter):.1f}°" in [t.get_text() for t in axes.texts]


def test_static_shows_its_signals():
    sensor = static.StaticSensor(HEIGHT, np.radians(5))
    axes = plots.plot_static(sensor, BODY[:, 2], HEIGHT, np.array([0.1, 0.2, 0.3, 0.4]))
    assert {"1: 0.10", "4: 0.40"} <= {t.get_text() for t in axes.texts}
    far = static.StaticSensor(35786e3, np.radians(5))
    axes = plots.plot_static(far, BODY[:, 2], 35786e3, np.array([0.1, 0.2, 0.3, 0.4]))
    low, high = axes.get_xlim()
    assert sum(low < tick < high for tick in axes.get_xticks()) >= 3, "ticks also for a small disc"


def test_field_stars_and_gyroscope():
    vectors = np.eye(3) * 1e-5
    orbit = magnetic.OrbitField(np.arange(3.0), vectors[0], vectors[0], vectors, vectors, vectors)
    axes = plots.plot_field(orbit)
    assert line(axes[0], "north")[:, 1] == pytest.approx([10, 0, 0])
    assert axes[0].get_ylabel() == "field [µT]"
    axes[0].figure.canvas.draw()
    for a in axes:
        assert not a.get_legend().get_window_extent().overlaps(a.get_window_extent())
    camera = star.StarSensor(7000, 1024, 1024)
    places = np.array([[100.0, 200], [300, 50]])
    assert line(plots.plot_stars(camera, places, places + 1, 10), "star") == pytest.approx(places)
    axes = plots.plot_pinhole(camera, 0.05)
    assert axes.get_lines()[-1].get_xydata()[0] == pytest.approx([7000, 7000 * np.tan(0.05)])
    axes = plots.plot_gyroscope(np.array([0, 60.0]), np.array([0, 0.1]), np.zeros(2), np.ones(2))
    assert line(axes, "as read")[1] == pytest.approx([1, np.degrees(0.1)])


def test_budget_bars_are_degrees():
    found = (budget.Accuracy("a sensor", {"one": 0.01, "two": 0.02}, 0.03, 0.04, 0.0),) * 2
    axes = plots.plot_budget(found)
    assert [p.get_width() for p in axes[0].patches] == pytest.approx(
        np.degrees([0.01, 0.02, 0.03, 0.04])
    )
    assert axes[-1].get_xlabel() == "rms error, each axis [°]"
