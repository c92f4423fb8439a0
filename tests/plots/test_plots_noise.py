"""Figures of the noise identification: what they return, label, grid and show."""

import re
import warnings
from functools import cache

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

from sensorbook.noise import NoiseTerms, identify_noise, read_off
from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.psd import average_frequencies, periodogram, read_off_spectrum
from sensorbook.noise.whittle import REACH, fit_spectrum
from sensorbook.plots.noise import LINES, plot_agreement, plot_methods, plot_spectrum_terms
from sensorbook.plots.style import COLOURS
from sensorbook.simulate.noise import coloured_noise

mpl.use("Agg")
UNIT = re.compile(r"\[[^\[\]]+\]$")
RATE, SAMPLES = 100.0, 40_000
DEGREE = np.pi / 180
TRUTH = {"random_walk": 1e-4, "bias_instability": 2e-5, "rate_random_walk": 4e-5}


@pytest.fixture(autouse=True)
def _figures():
    plt.close("all")
    yield
    plt.close("all")


@cache
def values():
    """x plain, y with a drifting line, z behind a low-pass and without a walk."""
    rng = np.random.default_rng(131)
    time = np.arange(SAMPLES) / RATE
    x, y = (coloured_noise(SAMPLES, RATE, rng, **TRUTH) for _ in range(2))
    y += 5e-4 * np.sin(2 * np.pi * (12 * time + 0.3 * time**2 / time[-1]))
    z = coloured_noise(SAMPLES, RATE, rng, random_walk=1e-4, bandwidth=15.0)
    return np.stack([x, y, z], axis=1)


@cache
def identified(sensor="gyroscope"):
    return identify_noise(values(), RATE, sensor)


@cache
def methods(sensor="gyroscope"):
    found = identified(sensor)
    averaged = average_frequencies(periodogram(values(), RATE, sensor, taper=True))
    return (
        read_off(found.curve, found.low_passes),
        read_off_spectrum(averaged),
        found.allan_fit,
        found.fit,
    )


FIGURES = {
    "spectrum": lambda axis, axes=None, sensor="gyroscope": plot_spectrum_terms(
        identified(sensor), axis, axes
    ),
    "agreement": lambda axis, axes=None, sensor="gyroscope": plot_agreement(
        identified(sensor), axis, axes
    ),
}


def draw(axes):
    """Renders the figure; a missing glyph or a layout that collapses is a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes.figure.canvas.draw()


def legend(axes):
    return [t.get_text() for t in axes.get_legend().get_texts()]


def line(axes, label):
    return next(drawn for drawn in axes.get_lines() if drawn.get_label() == label)


def test_what_the_figures_are_to_show_is_there():
    found = identified()
    assert found.fit["x"].terms["rate_random_walk"]
    assert [p.steady for p in found.periodic[1]] == [False]
    assert [low_pass is not None for low_pass in found.low_passes] == [False, False, True]


# ---- both single figures ----


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_its_own(name, axis):
    axes = FIGURES[name](axis)
    assert isinstance(axes, Axes)
    assert plt.get_fignums() == [axes.figure.number]
    draw(axes)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    for scale in (axes.xaxis, axes.yaxis):
        assert any(t.gridline.get_visible() for t in scale.get_major_ticks())
        assert any(t.gridline.get_visible() for t in scale.get_minor_ticks())
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())
    assert axes.get_ylabel().startswith(f"{axis}: ")


@pytest.mark.parametrize("name", FIGURES)
def test_drawn_into_given_axes(name):
    figure, (given, other) = plt.subplots(1, 2)
    assert FIGURES[name]("y", given) is given
    assert plt.get_fignums() == [figure.number]
    assert given.has_data()
    assert not other.has_data()


@pytest.mark.parametrize(
    ("sensor", "density", "deviation"),
    [
        ("gyroscope", "(°/s)²/Hz", "°/h"),
        ("accelerometer", "(m/s²)²/Hz", "mg"),
        ("magnetometer", "(µT)²/Hz", "nT"),
    ],
)
def test_units_follow_the_sensor(sensor, density, deviation):
    axes = FIGURES["spectrum"]("x", sensor=sensor)
    assert axes.get_xlabel() == "frequency f [Hz]"
    assert axes.get_ylabel() == f"x: one-sided density [{density}]"
    axes = FIGURES["agreement"]("x", sensor=sensor)
    assert axes.get_xlabel() == "cluster time τ [s]"
    assert axes.get_ylabel() == f"x: Allan deviation σ [{deviation}]"


def test_a_rest_without_a_sensor():
    axes = FIGURES["agreement"]("x", sensor="")
    assert axes.get_ylabel() == "x: Allan deviation σ [SI]"
    axes = FIGURES["spectrum"]("x", sensor="")
    assert axes.get_ylabel() == "x: one-sided density [(SI)²/Hz]"


# ---- the spectrum ----


def test_terms_drawn_are_those_stated():
    for axis in "xyz":
        axes = FIGURES["spectrum"](axis)
        stated = {n.replace("_", " ") for n, e in identified().fit[axis].terms.items() if e}
        drawn = {text.split(": ")[1] for text in legend(axes) if ": " in text}
        assert "random walk" in stated
        assert drawn == stated


def test_densities_are_one_sided_in_field_units():
    axes = FIGURES["spectrum"]("x")
    found = identified().fit["x"]
    total = line(axes, "sum of terms")
    f = total.get_xdata()
    expected = 2 * found.model.spectrum(f, 1 / RATE) / DEGREE**2
    np.testing.assert_allclose(total.get_ydata(), expected, rtol=1e-12)
    floor = line(axes, "N: random walk").get_ydata()
    np.testing.assert_allclose(floor, 2 * (found.terms["random_walk"].value / DEGREE) ** 2)
    walk = line(axes, "K: rate random walk").get_ydata()
    alone = NoiseTerms(rate_random_walk=found.terms["rate_random_walk"].value)
    np.testing.assert_allclose(walk, 2 * alone.spectrum(f, 1 / RATE) / DEGREE**2)


def test_points_hold_all_lines():
    axes = FIGURES["spectrum"]("x")
    points = line(axes, "measured")
    s = identified().spectrum
    f, density = points.get_data()
    assert (np.diff(f) > 0).all()
    # No more than a point each 8 %, of eight lines and more.
    assert len(f) < np.log(SAMPLES) / np.log(1.08)
    assert f[0] == pytest.approx((1 + LINES) / 2 * RATE / (2 * SAMPLES), rel=0.3)
    # Their mean, weighted by lines, is the variance of the record.
    edges = np.sqrt(f[1:] * f[:-1])
    counts = np.add.reduceat(s.lines, np.concatenate([[0], np.searchsorted(s.frequency, edges)]))
    power = np.sum(density * counts) * RATE / 2 / SAMPLES
    # Points are cut near the edges, not at them.
    assert power == pytest.approx(np.var(values()[:, 0]) / DEGREE**2, rel=0.1)
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert band.min() < density.min()
    assert band.max() > density.max()


def test_what_was_left_out_is_marked():
    left, low = "periodic, left out", "low-pass, left out"
    assert left not in legend(FIGURES["spectrum"]("x"))
    assert low not in legend(FIGURES["spectrum"]("x"))
    axes = FIGURES["spectrum"]("y")
    (patch,) = (p for p in axes.patches if p.get_label() == left)
    (band,) = (p.band for p in identified().periodic[1])
    assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx(band)
    axes = FIGURES["spectrum"]("z")
    (patch,) = (p for p in axes.patches if p.get_label() == low)
    top = REACH * identified().low_passes[2].cutoff
    assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx((top, RATE / 2))
    assert line(axes, "sum of terms").get_xdata().max() <= top
    # The sum bends with the low-pass, the floor does not.
    assert (
        line(axes, "sum of terms").get_ydata()[-1]
        < 0.9 * line(axes, "N: random walk").get_ydata()[-1]
    )


# ---- the agreement ----


def test_agreement_shows_curve_band_and_explanation():
    found = identified()
    axes = FIGURES["agreement"]("y")
    per_hour = DEGREE / 3600
    curve = line(axes, "measured")
    np.testing.assert_allclose(curve.get_xdata(), found.curve.tau)
    np.testing.assert_allclose(curve.get_ydata(), found.curve.deviation[:, 1] / per_hour)
    explained = line(axes, "terms, low-pass and periodic components").get_ydata()
    np.testing.assert_allclose(explained, np.sqrt(found.fit["y"].variance) / per_hour)
    alone = line(axes, "terms alone")
    assert alone.get_color() == COLOURS["y"]
    expected = np.sqrt(found.fit["y"].model.allan_variance(found.curve.tau)) / per_hour
    np.testing.assert_allclose(alone.get_ydata(), expected)
    # The line of 12 Hz lifts what is explained, not the terms.
    assert (explained / alone.get_ydata()).max() > 1.05
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert band.min() == pytest.approx(found.fit["y"].band.min() / per_hour)
    assert band.max() == pytest.approx(found.fit["y"].band.max() / per_hour)


# ---- the methods ----

TEXTS = [
    "Allan curve, read off",
    "spectrum, read off",
    "Allan curve, fitted",
    "spectrum, likelihood",
]


def truth():
    true = {axis: dict(TRUTH) for axis in "xy"}
    return true | {"z": {"random_walk": 1e-4, "bias_instability": None, "rate_random_walk": None}}


def test_methods_in_a_row():
    axes = plot_methods(methods())
    assert len(axes) == 3
    assert plt.get_fignums() == [axes[0].figure.number]
    draw(axes[0])
    assert [a.get_xlabel() for a in axes] == ["N [°/√h]", "B [°/h]", "K [°/h/√s]"]
    assert axes[0].get_ylabel() == "axis"
    assert [t.get_text() for t in axes[0].get_yticklabels()] == ["x", "y", "z"]
    for a in axes:
        assert a.has_data()
        # x on top, and the whole of the range from zero.
        assert a.get_ylim()[0] > a.get_ylim()[1]
        assert a.get_xlim()[0] == 0
        assert any(t.gridline.get_visible() for t in a.xaxis.get_major_ticks())
    (named,) = axes[0].figure.legends
    assert {t.get_text() for t in named.get_texts()} == set(TEXTS)


def test_methods_drawn_into_given_axes():
    figure, given = plt.subplots(1, 3, layout="constrained")
    assert plot_methods(methods(), truth(), given) is given
    assert plt.get_fignums() == [figure.number]
    draw(given[0])


def test_values_intervals_and_bounds_of_each_method():
    axes = plot_methods(methods())
    per_root_hour = DEGREE / 60
    fit = identified().fit
    n = fit["x"].terms["random_walk"]
    points = [drawn for drawn in axes[0].get_lines() if drawn.get_label() == TEXTS[3]]
    assert points[0].get_marker() == "o"
    assert points[0].get_xdata()[0] == pytest.approx(n.value / per_root_hour)
    ends = [drawn.get_xdata() for drawn in axes[0].get_lines() if len(drawn.get_xdata()) == 2]
    assert any(np.allclose(e, np.array([n.low, n.high]) / per_root_hour) for e in ends)
    # z has no walk: an arrow at its bound.
    bound = fit["z"].upper_bounds["rate_random_walk"] / (DEGREE / 3600)
    arrows = [drawn for drawn in axes[2].get_lines() if drawn.get_marker() == "<"]
    assert any(drawn.get_xdata()[0] == pytest.approx(bound) for drawn in arrows)


def test_methods_do_not_cover_each_other():
    for a in plot_methods(methods()):
        heights = [
            y for drawn in a.get_lines() if drawn.get_marker() in "o<" for y in drawn.get_ydata()
        ]
        assert len(set(np.round(heights, 6))) == len(heights)


def test_truth_is_drawn_for_every_axis():
    axes = plot_methods(methods(), truth())
    draw(axes[0])
    assert "truth" in {t.get_text() for t in axes[0].figure.legends[0].get_texts()}
    per_root_hour = DEGREE / 60
    at = [drawn.get_xdata() for drawn in axes[0].get_lines() if drawn.get_color() == "#D55E00"]
    np.testing.assert_allclose(at, np.full((3, 2), 1e-4 / per_root_hour))
    absent = [
        drawn.get_xdata()[0] for drawn in axes[2].get_lines() if drawn.get_color() == "#D55E00"
    ]
    assert absent[2] == 0


def test_every_estimator_has_a_name():
    # The spectrum's fit with a Gauss–Markov process, too.
    more = fit_spectrum(cosine_spectrum(values(), RATE), "gyroscope", gauss_markov=True)
    axes = plot_methods([more])
    assert len(axes[0].figure.legends[0].get_texts()) == 1
