"""Figures: what they return, label, grid and leave open."""

import re
import warnings
from functools import cache

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes

from sensorbook import Recording
from sensorbook.noise import allan_deviation, fit_terms, read_off
from sensorbook.plots.allan import plot_curves, plot_read_off, plot_terms
from sensorbook.plots.recording import POINTS, envelope, plot_recording, plot_temperature
from sensorbook.plots.style import COLOURS, log_log, new_row
from sensorbook.plots.thermal import plot_against_truth, plot_bias, plot_candidates
from sensorbook.thermal import fit_thermal, reduce_sweep

mpl.use("Agg")
UNIT = re.compile(r"\[[^\[\]]+\]$")


@pytest.fixture(autouse=True)
def _figures():
    plt.close("all")
    yield
    plt.close("all")


def run(samples=4000, hours=0.0, seed=121):
    rng = np.random.default_rng(seed)
    time = np.linspace(0, hours * 3600, samples) if hours else np.arange(samples) / 100.0
    return Recording(
        "gyroscope",
        "static",
        "a.csv",
        time,
        np.pi / 180 * rng.normal(size=(samples, 3)),
        temperature=25 + rng.normal(size=samples),
        rate=100.0,
        unit="rad/s",
    )


@cache
def noise(sensor="gyroscope"):
    values = np.random.default_rng(122).normal(size=(5000, 3)) * 1e-3
    values += np.cumsum(np.random.default_rng(126).normal(size=(5000, 3)), axis=0) * 1e-4
    curve = allan_deviation(values, 100.0, sensor=sensor)
    return curve, fit_terms(curve), read_off(curve)


@cache
def thermal():
    rng = np.random.default_rng(123)
    time = np.arange(240.0)
    temperature = 20 + 20 * (1 - np.abs(time / 120 - 1))
    values = np.outer(temperature, [0.1, -0.2, 0.0]) * np.pi / 180
    values += 1e-4 * rng.normal(size=values.shape)
    sweep = reduce_sweep([(time, temperature, values)])
    grid = np.linspace(20, 40, 41)
    truth = {"temperature": list(grid), "gyroscope": {}}
    for axis, slope in zip("xyz", (0.1, -0.2, 0.0), strict=True):
        truth["gyroscope"][axis] = {"bias": list(slope * np.pi / 180 * (grid - 20))}
    return sweep, fit_thermal(sweep, "gyroscope"), truth


# name: function of the Axes to draw into, or of None
SINGLE = {
    "curves": lambda axes=None: plot_curves(noise()[0], noise()[1], axes),
    "curves alone": lambda axes=None: plot_curves(noise()[0], axes=axes),
    "terms": lambda axes=None: plot_terms(noise()[0], noise()[1], "y", axes),
    "read-off": lambda axes=None: plot_read_off(noise()[0], noise()[2], "z", axes),
    "recording": lambda axes=None: plot_recording(run(), axes),
    "temperature": lambda axes=None: plot_temperature([run(), run(seed=124)], axes),
    "candidates": lambda axes=None: plot_candidates(thermal()[1], axes),
}
ROWS = {
    "bias": (2, lambda axes=None: plot_bias(thermal()[0], thermal()[1], "x", axes)),
    "truth": (3, lambda axes=None: plot_against_truth(thermal()[1], thermal()[2], axes)),
}


def draw(axes):
    """Renders the figure; a missing glyph or a layout that collapses is a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes.figure.canvas.draw()


@pytest.mark.parametrize("name", SINGLE)
def test_a_figure_of_its_own(name):
    axes = SINGLE[name]()
    assert isinstance(axes, Axes)
    assert plt.get_fignums() == [axes.figure.number]
    assert axes.has_data()
    draw(axes)


@pytest.mark.parametrize("name", SINGLE)
def test_drawn_into_given_axes(name):
    figure, (given, other) = plt.subplots(1, 2)
    assert SINGLE[name](given) is given
    assert plt.get_fignums() == [figure.number]
    assert given.has_data()
    assert not other.has_data()


@pytest.mark.parametrize("name", ROWS)
def test_a_row_of_its_own(name):
    count, make = ROWS[name]
    axes = make()
    assert len(axes) == count
    assert all(isinstance(a, Axes) and a.has_data() for a in axes)
    assert plt.get_fignums() == [axes[0].figure.number]
    draw(axes[0])


@pytest.mark.parametrize("name", ROWS)
def test_a_row_drawn_into_given_axes(name):
    count, make = ROWS[name]
    figure, given = plt.subplots(1, count)
    assert make(given) is given
    assert plt.get_fignums() == [figure.number]
    assert all(a.has_data() for a in given)


@pytest.mark.parametrize("name", [n for n in SINGLE if n != "candidates"])
def test_units_on_both_axes(name):
    axes = SINGLE[name]()
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())


def test_units_of_rows():
    for axes in (ROWS["bias"][1](), ROWS["truth"][1]()):
        assert all(UNIT.search(a.get_xlabel()) for a in axes)
        assert UNIT.search(axes[0].get_ylabel())
    assert all(UNIT.search(a.get_ylabel()) for a in ROWS["bias"][1]())


def test_candidates_are_named_and_their_error_has_a_unit():
    axes = plot_candidates(thermal()[1])
    draw(axes)
    assert axes.get_ylabel() == "held-out rms [°/s]"
    labels = [t.get_text() for t in axes.get_xticklabels()]
    assert {c.name for c in thermal()[1]["x"].candidates} <= set(labels)


@pytest.mark.parametrize(
    ("sensor", "unit"), [("gyroscope", "°/h"), ("accelerometer", "mg"), ("magnetometer", "nT")]
)
def test_units_follow_the_sensor(sensor, unit):
    curve, estimate, _ = noise(sensor)
    axes = plot_terms(curve, estimate, "x")
    assert axes.get_xlabel() == "cluster time τ [s]"
    assert axes.get_ylabel() == f"x: Allan deviation σ [{unit}]"


def test_a_curve_without_a_sensor():
    values = np.random.default_rng(125).normal(size=2000)
    axes = plot_curves(allan_deviation(values, 10.0))
    assert axes.get_ylabel() == "Allan deviation σ [SI]"


def test_values_are_in_field_units():
    curve, estimate, _ = noise()
    axes = plot_curves(curve, estimate)
    line = axes.get_lines()[0]
    np.testing.assert_allclose(line.get_xdata(), curve.tau)
    per_hour = np.pi / 180 / 3600
    np.testing.assert_allclose(line.get_ydata(), curve.deviation[:, 0] / per_hour)
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["x", "y", "z"]
    assert [line.get_color() for line in axes.get_lines()] == list(COLOURS.values())


def test_terms_drawn_are_those_found():
    curve, estimate, _ = noise()
    axes = plot_terms(curve, estimate, "x")
    found = {n for n, e in estimate["x"].terms.items() if e}
    names = {t.get_text().split(": ")[-1].replace(" ", "_") for t in axes.get_legend().get_texts()}
    assert "random_walk" in found
    assert names & set(estimate["x"].terms) == found


# ---- scales and grids ----


def gridded(axis, which):
    return any(t.gridline.get_visible() for t in getattr(axis, f"get_{which}_ticks")())


@pytest.mark.parametrize("name", ["curves", "terms", "read-off"])
def test_allan_figures_are_log_log_with_fine_grids(name):
    axes = SINGLE[name]()
    draw(axes)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    for axis in (axes.xaxis, axes.yaxis):
        assert gridded(axis, "major")
        assert gridded(axis, "minor")


@pytest.mark.parametrize("name", ["recording", "temperature", "candidates"])
def test_other_figures_have_a_grid(name):
    axes = SINGLE[name]()
    draw(axes)
    assert axes.get_xscale() == "linear"
    assert axes.get_yscale() == ("log" if name == "candidates" else "linear")
    assert gridded(axes.xaxis, "major")
    assert gridded(axes.yaxis, "major")


def test_rows_have_a_grid():
    for _, make in ROWS.values():
        for axes in make():
            assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")
            assert gridded(axes.xaxis, "major")
            assert gridded(axes.yaxis, "major")


def test_log_log_labels_decades_only():
    _, axes = plt.subplots()
    axes.plot([1e-3, 1e3], [1e-6, 1.0])
    log_log(axes)
    draw(axes)
    assert all(t.label1.get_text() == "" for t in axes.xaxis.get_minor_ticks())
    assert len(axes.xaxis.get_minor_ticks()) >= 6 * 8


def test_a_row_of_one():
    assert len(new_row(1)) == 1


# ---- recordings ----


@pytest.mark.parametrize(("hours", "unit"), [(0.05, "s"), (1.0, "min"), (5.0, "h")])
def test_time_axis(hours, unit):
    assert plot_recording(run(hours=hours)).get_xlabel() == f"time [{unit}]"
    assert plot_temperature([run(hours=hours)]).get_xlabel() == f"time [{unit}]"


def test_recording_is_drawn_about_its_median():
    recording = run()
    axes = plot_recording(recording)
    assert axes.get_ylabel() == "gyroscope less median [°/s]"
    texts = [t.get_text() for t in axes.get_legend().get_texts()]
    medians = np.median(recording.values, axis=0) * 180 / np.pi
    expected = [f"{n} (median {m:.4g} °/s)" for n, m in zip("xyz", medians, strict=True)]
    assert texts == expected


def test_recording_plots_itself():
    _, axes = plt.subplots()
    assert run().plot(axes) is axes


@settings(max_examples=40, deadline=None)
@given(samples=st.integers(1, 5 * POINTS), seed=st.integers(0, 2**32 - 1))
def test_envelope_keeps_every_extreme(samples, seed):
    y = np.random.default_rng(seed).normal(size=samples)
    t, low, high = envelope(np.arange(float(samples)), y)
    assert len(t) == len(low) == len(high) <= POINTS
    assert (low <= high).all()
    assert (low.min(), high.max()) == (y.min(), y.max())
    assert (np.diff(t) > 0).all()
    if samples <= POINTS:
        np.testing.assert_array_equal(low, y)


def test_envelope_skips_missing_values():
    y = np.zeros(10 * POINTS)
    y[5], y[6] = np.nan, 3.0
    _, low, high = envelope(np.arange(len(y)), y)
    assert (low[0], high[0]) == (0.0, 3.0)


# ---- thermal ----


def test_bias_figure_shows_each_degree_and_the_choice():
    left, right = plot_bias(thermal()[0], thermal()[1], "y")
    shown = {t.get_text() for t in left.get_legend().get_texts()}
    assert {"heating", "cooling", "degree 1", "degree 3", "degree 5", "chosen"} <= shown
    reference = thermal()[1]["y"].model.reference
    assert left.get_ylabel() == f"y: change since {reference:g} °C [°/s]"
    assert right.get_ylabel() == "y: after compensation [°/s]"


def test_error_against_truth_is_drawn_with_its_band():
    sweep, fit, truth = thermal()
    axes = plot_against_truth(fit, truth)
    assert [a.get_title() for a in axes] == ["x", "y", "z"]
    error = axes[1].get_lines()[0].get_ydata()
    # 240 blocks of 1e-4 rad/s: the straight line is known to some 1e-5, 6e-4 °/s.
    assert np.abs(error).max() < 0.003
    assert axes[0].get_ylabel() == "estimate − truth [°/s]"
    assert sweep.span[0] == pytest.approx(20, abs=0.5)
