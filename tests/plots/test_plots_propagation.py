"""Figures of propagation: what is drawn is what was given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.attitude.propagation_study import RoundingDrift, tour
from sensorbook.plots import propagation as plots


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_tours_show_the_faces_towards_the_viewer():
    both = {name: tour(name, np.pi / 2) for name in ("xy−x−y", "xy−x−z")}
    axes = plots.plot_tours(both)
    assert axes.shape == (2, 5)
    labels = [sorted(t.get_text() for t in one.texts if len(t.get_text()) < 3) for one in axes[0]]
    # By hand: x is drawn to the lower left, y to the right, z up.
    assert labels == [
        ["x", "y", "z"],
        ["x", "y", "−z"],
        ["x", "y", "z"],
        ["x", "z", "−y"],
        ["x", "−y", "−z"],
    ]
    assert axes[1, 4].get_title() == "0°, 90°, −90°"
    assert [t.get_text() for t in axes[1, 4].texts] == ["x", "y", "z"]


def test_motion_in_degrees():
    rates, error = plots.plot_motion(np.arange(3), np.ones((3, 3)), np.array([0, 0.1, 0.2]))
    assert rates.lines[2].get_ydata() == pytest.approx(np.degrees([1, 1, 1]))
    assert error.lines[0].get_ydata() == pytest.approx(np.degrees([0, 0.1, 0.2]))
    assert error.get_ylabel() == "error of the attitude [°]"


def test_lock_rates():
    rates = np.arange(9.0).reshape(3, 3)
    pitch, curves = plots.plot_lock_rates(np.arange(3), np.array([1.0, 1.5, 1.0]), rates)
    assert pitch.lines[0].get_ydata() == pytest.approx(np.degrees([1, 1.5, 1]))
    assert curves.lines[2].get_ydata() == pytest.approx(np.degrees([2, 5, 8]))
    assert [t.get_text() for t in curves.get_legend().get_texts()] == ["roll", "pitch", "yaw"]


def test_lock_loss_keeps_what_is_zero_on_the_axis():
    axes = plots.plot_lock_loss(np.array([0.01, 0.1]), {"a": np.array([0.1, 0.0])}, 0.05)
    assert axes.lines[0].get_xdata() == pytest.approx(np.degrees([0.01, 0.1]))
    assert axes.lines[0].get_ydata()[0] == pytest.approx(np.degrees(0.1))
    assert axes.lines[0].get_ydata()[1] > 0
    assert axes.lines[1].get_xdata() == pytest.approx(np.degrees([0.05, 0.05]))


def test_rounding_has_both_errors():
    drift = RoundingDrift(np.arange(5.0), np.arange(5.0) / 10)
    length, angle = plots.plot_rounding({"32 bit": drift})
    assert length.lines[0].get_xdata().tolist() == [1, 2, 3, 4]
    assert length.lines[0].get_ydata().tolist() == [1, 2, 3, 4]
    assert angle.lines[0].get_ydata() == pytest.approx(np.degrees([0.1, 0.2, 0.3, 0.4]))
    assert angle.get_ylabel() == "angle lost [°]"


def test_error_by_rate():
    axes = plots.plot_error_by_rate(np.array([10, 20]), {"means": np.array([0.1, 0.01])}, 15)
    assert axes.lines[0].get_ydata() == pytest.approx(np.degrees([0.1, 0.01]))
    assert axes.get_xlabel() == "readings a second [Hz]"
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


def test_cone_and_delay_in_degrees():
    for plot in (plots.plot_cone, plots.plot_delay):
        axes = plot(np.arange(2), np.array([0, 1.0]), np.array([0, 0.5]))
        one, other = (line.get_ydata() for line in axes.lines)
        assert one == pytest.approx(np.degrees([0, 1]))
        assert other == pytest.approx(np.degrees([0, 0.5]))
        assert axes.get_xlabel() == "time [s]"


def test_coning_has_lines_of_the_formula_and_marks_of_the_measurement():
    measured, formula = {"a": np.array([0.5, 0.1])}, {"a": np.array([0.4, 0.2])}
    axes = plots.plot_coning(np.array([5, 10]), measured, formula, 7)
    line, marks, _ = axes.lines
    assert line.get_ydata() == pytest.approx([0.4, 0.2])
    assert marks.get_ydata() == pytest.approx([0.5, 0.1])
    assert marks.get_linestyle() == "None"


@pytest.mark.parametrize(("at", "lines"), [(4.9, 2), (5, 3), (10, 3), (4000, 2)])
def test_coning_marks_the_chapters_readings_where_the_curves_reach_them(at, lines):
    curve = {"a": np.array([0.5, 0.1])}
    axes = plots.plot_coning(np.array([5, 10]), curve, curve, at)
    assert len(axes.lines) == lines
    assert axes.get_xlim()[1] < 20
