"""Figures of representations and frames: what they draw, with labels and units."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.attitude.frames import circular_orbit, lvlh_from_eci, orbital_from_eci
from sensorbook.attitude.rotations import axis_angle_from_matrix, matrix_from_euler
from sensorbook.attitude.round_trips import RoundTrip
from sensorbook.plots import attitude as plots

ANGLES = np.radians([30.0, 20.0, -40.0])
A = matrix_from_euler("ZYX", ANGLES)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def texts(axes):
    return [t.get_text() for t in axes.texts if t.get_text()]


def tips(axes):
    """Where arrows end, by their order."""
    return np.array([t.xy for t in axes.texts if getattr(t, "arrow_patch", None)])


def test_view_is_a_rotation_that_keeps_up_up():
    basis = plots.VIEW.basis
    assert basis @ basis.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(basis) == pytest.approx(1)
    x, y, _ = plots.VIEW([0, 0, 1.0])
    assert x == pytest.approx(0, abs=1e-15)
    assert y > 0.9


def test_two_frames_and_the_vector():
    axes = plots.plot_two_frames(A, np.array([0.9, 1.4, -0.5]))
    assert texts(axes) == [f"{f} {k}" for f in ("reference", "body") for k in "xyz"] + ["v"]
    found = tips(axes)
    assert found[:3] == pytest.approx(plots.VIEW(np.eye(3))[:, :2])
    assert found[3:6] == pytest.approx(plots.VIEW(A)[:, :2])
    v = plots.VIEW([0.9, 1.4, -0.5])[:2]
    assert np.cross([*found[6], 0], [*v, 0])[2] == pytest.approx(0, abs=1e-12)
    assert not axes.axison


def test_axis_and_angle_carries_the_axes_over():
    axis, angle = axis_angle_from_matrix(A)
    axes = plots.plot_axis_and_angle(axis, angle, A)
    assert axes.get_title() == "Φ = 57.1° about e"
    for k, line in enumerate(axes.get_lines()):
        ends = line.get_xydata()[[0, -1]]
        assert ends[0] == pytest.approx(plots.VIEW(np.eye(3)[k])[:2])
        assert ends[1] == pytest.approx(plots.VIEW(A[k])[:2])


@pytest.mark.parametrize("matrix", [np.eye(3), np.diag([1.0, -1, -1]), A])
def test_names_of_frames_do_not_stand_on_each_other(matrix):
    axis, angle = axis_angle_from_matrix(matrix)
    for axes in (
        plots.plot_two_frames(matrix, np.array([0.9, 1.4, -0.5])),
        plots.plot_axis_and_angle(axis, angle, matrix),
    ):
        axes.figure.canvas.draw()
        boxes = [t.get_window_extent() for t in axes.texts if t.get_text()]
        assert len(boxes) == 7
        for k, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_euler_steps_end_at_the_attitude():
    axes = plots.plot_euler_steps("ZYX", ANGLES)
    assert [a.get_title() for a in axes] == [
        "φ = 30.0° about z",
        "θ = 20.0° about y′",
        "ψ = −40.0° about x″",
    ]
    assert texts(axes[0]) == ["x", "y", "x′", "y′", "z"]
    # y‴ and z‴, then x″, which the last turn leaves where it is.
    view = plots._clearest([[0, 0, 1], matrix_from_euler("ZYX", [ANGLES[0], 0, 0])[1], A[0]])
    last = tips(axes[2])[2:]
    assert last == pytest.approx(view(A[[1, 2, 0]] * [[1], [1], [1.06]])[:, :2])


def test_one_rotation_turns_y_towards_z():
    axes = plots.plot_one_rotation(np.radians(30))
    c, s = np.cos(np.radians(30)), 0.5
    assert tips(axes) == pytest.approx(np.array([[1, 0], [0, 1], [c, s], [-s, c]]))
    assert {"y", "z", "y′", "z′", "cos α", "sin α"} <= set(texts(axes))


def test_round_trips():
    distance = 10.0 ** np.arange(-16, 1)
    trip = RoundTrip(distance, 1e-16 / distance, np.zeros(17))
    axes = plots.plot_round_trips({"one [rad]": trip, "two [rad]": trip})
    assert [a.get_xlabel() for a in axes] == ["one [rad]", "two [rad]"]
    assert axes[0].get_ylabel() == "largest error [rad]"
    assert axes[0].get_xscale() == axes[0].get_yscale() == "log"
    printed, ours = axes[0].get_lines()
    assert printed.get_ydata() == pytest.approx(1e-16 / distance)
    assert (ours.get_ydata() == 1e-18).all()  # nothing lost, at the axis
    names = [t.get_text() for t in axes[0].get_legend().get_texts()]
    assert names == ["as C prints it", "sensorbook"]


def test_amplification():
    second = np.radians([-60.0, 0.0, 60.0])
    errors = np.radians([[0.2, 0.1, 0.2], [0.1, 0.1, 0.1], [0.2, 0.1, 0.2]])
    axes = plots.plot_amplification("ZYX", second, errors, np.radians(0.1), ANGLES[1])
    assert axes.get_xlabel() == "second angle θ [°]"
    assert axes.get_ylabel() == "rms error [°]"
    curve, *measured, here = axes.get_lines()
    assert curve.get_ydata()[0] == pytest.approx(0.2)  # 0.1° / cos 60°
    for line, column in zip(measured, errors.T, strict=True):
        assert line.get_ydata() == pytest.approx(np.degrees(column))
    assert here.get_xdata() == pytest.approx([20, 20])


@pytest.mark.parametrize("sidereal", [0.7, 3.0, 5.5, -1.0, 100.0])
def test_earth_frames_show_both_x_axes(sidereal):
    axes = plots.plot_earth_frames(sidereal)
    assert {"X, to the equinox", "x, Greenwich", "Z = z", "θ"} <= set(texts(axes))


def test_tangent_frames():
    position, velocity = circular_orbit(550e3, 1.7, 0.4, 0.6)
    orbit, _ = circular_orbit(550e3, 1.7, 0.4, np.linspace(0, 2 * np.pi, 50))
    orbital, lvlh = orbital_from_eci(position, velocity), lvlh_from_eci(position, velocity)
    axes = plots.plot_tangent_frames(orbit, position, {"C's": orbital, "LVLH": lvlh}, 0.3)
    assert [a.get_title() for a in axes] == ["C's", "LVLH"]
    assert texts(axes[0]) == ["x", "y", "z"]
    # x of the one is y of the other, z the same.
    assert tips(axes[0])[0] == pytest.approx(tips(axes[1])[1])
    assert tips(axes[0])[2] == pytest.approx(tips(axes[1])[2])


@pytest.mark.parametrize("latitude", [0.7, -0.5, 0.0, np.pi / 2])
def test_geodetic_normal_is_across_the_ellipse(latitude):
    axes = plots.plot_geodetic(latitude)
    lines = axes.get_lines()
    ellipse = lines[0].get_xydata()
    assert np.ptp(ellipse[:, 1]) / np.ptp(ellipse[:, 0]) == pytest.approx(1 - 0.35, rel=1e-3)
    (x, y), *_ = tips(axes)
    foot = np.array([x, y]) - 0.4 * np.array([np.cos(latitude), np.sin(latitude)])
    assert foot[0] ** 2 + (foot[1] / 0.65) ** 2 == pytest.approx(1)
    # The ellipse's normal there, the gradient of that.
    assert np.arctan2(foot[1] / 0.65**2, foot[0]) == pytest.approx(latitude, abs=1e-12)
    assert "flattening drawn 104 times too large" in texts(axes)


def test_curves_have_units_and_the_data_given():
    latitude = np.radians([-90.0, 0.0, 90.0])
    axes = plots.plot_latitude_difference(latitude, {"on the ground": 0.003 * latitude})
    assert axes.get_xlabel() == "geodetic latitude [°]"
    assert axes.get_ylabel() == "geodetic − geocentric [°]"
    assert axes.get_lines()[0].get_ydata() == pytest.approx([-0.27, 0, 0.27])
    axes = plots.plot_missed(np.array([2000.0, 2050.0]), np.radians([0, 0.7]), (2026, 0.0064))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("year", "angle missed [°]")
    curve, here = axes.get_lines()
    assert curve.get_ydata() == pytest.approx([0, 0.7])
    assert here.get_xydata().ravel() == pytest.approx([2026, np.degrees(0.0064)])


def test_what_the_globe_hides():
    view = plots.View(0.0, 0.0)
    seen = view([[1, 0, 0], [-1.5, 0, 0], [-1.5, 1.2, 0], [0, 0, 1]])
    assert plots._unhidden(seen).tolist() == [True, False, True, True]
