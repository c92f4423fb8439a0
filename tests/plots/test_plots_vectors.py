"""Figures of attitude from vectors: what is drawn is what was given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.plots import vectors as plots


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_what_one_leaves_is_a_circle_at_the_angle():
    sun, field = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    axes = plots.plot_what_one_leaves(sun, field, 1.2, ("Sun", "field"))
    circle = np.array(axes.lines[0].get_data_3d())
    assert circle[2] == pytest.approx(np.cos(1.2))
    assert np.linalg.norm(circle, axis=0) == pytest.approx(1)
    labels = [t.get_text() for t in axes.get_legend().get_texts()]
    assert labels == ["where the Sun alone lets the field be", "Sun, measured", "field, measured"]


def test_iterations_in_degrees():
    axes = plots.plot_iterations({"one": np.array([1.0, 0.1, 0.0]), "two": np.array([0.5])})
    assert axes.lines[0].get_ydata()[:2] == pytest.approx(np.degrees([1.0, 0.1]))
    assert axes.lines[0].get_ydata()[2] > 0, "0 has no place on a logarithmic axis"
    assert axes.get_ylabel() == "angle to the best attitude [°]"
    assert axes.get_yscale() == "log"


def test_near_half_turn():
    axes = plots.plot_near_half_turn(np.array([1e-6, 1e-3]), {"a": np.array([1e-8, 1e-12])})
    assert axes.lines[0].get_ydata() == pytest.approx([1e-8, 1e-12])
    assert axes.get_xlabel().endswith("[rad]")
    assert axes.get_ylabel().endswith("[rad]")


@pytest.mark.parametrize(("logarithmic", "scale"), [(True, "log"), (False, "linear")])
def test_accuracy_has_marks_and_lines(logarithmic, scale):
    x = np.array([1.0, 10.0])
    curves = {"TRIAD": (np.radians([2.0, 3.0]), np.radians([2.1, 3.1]))}
    axes = plots.plot_accuracy(x, curves, "angle [°]", logarithmic)
    line, marks = axes.lines
    assert line.get_ydata() == pytest.approx([2.1, 3.1])
    assert marks.get_ydata() == pytest.approx([2.0, 3.0])
    assert marks.get_linestyle() == "None"
    assert (axes.get_xscale(), axes.get_yscale()) == (scale, "log")
    assert axes.get_xlabel() == "angle [°]"


def test_errors_and_their_ellipse():
    covariance = np.diag(np.radians([1.0, 2.0, 3.0]) ** 2)
    errors = np.random.default_rng(1).normal(size=(5000, 3)) * np.radians([1.0, 2.0, 3.0])
    axes = plots.plot_errors(errors, covariance)
    assert [a.get_xlabel() for a in axes] == [f"error about {k} [°]" for k in "xyz"]
    points, ellipse = axes[0].lines
    assert len(points.get_xdata()) == plots.MOST_POINTS + 500  # every second of 5000
    # χ² with two degrees of freedom: half axes of √5.991 standard errors.
    assert np.abs(ellipse.get_xdata()).max() == pytest.approx(np.sqrt(5.991), rel=1e-3)
    assert np.abs(ellipse.get_ydata()).max() == pytest.approx(2 * np.sqrt(5.991), rel=1e-3)


def test_misfits_are_densities():
    values = np.random.default_rng(2).chisquare(1, 50_000)
    axes = plots.plot_misfits({"as stated": values})
    expected = axes.lines[-1].get_ydata()
    counts = np.histogram(np.minimum(values, 11.99), np.linspace(0, 12, 49), density=True)[0]
    assert counts[:8] == pytest.approx(expected[:8], rel=0.1)
    assert axes.get_legend().get_texts()[-1].get_text() == "χ², 1 degree of freedom"


def test_speed_in_microseconds():
    axes = plots.plot_speed({"fast": 1e-7, "slow": 3e-5})
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([0.1, 30])
    assert [t.get_text() for t in axes.get_yticklabels()] == ["fast", "slow"]
    assert axes.get_xlabel() == "time an epoch [µs]"
