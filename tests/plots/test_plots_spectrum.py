"""Figures of the spectrum: what they return, label, grid and show."""

import re
import warnings
from functools import cache

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

from sensorbook import Recording
from sensorbook.noise.psd import (
    average_frequencies,
    low_pass_filter,
    periodogram,
    read_off_spectrum,
    read_ranges,
    welch,
)
from sensorbook.noise.shaping import shaping_filter
from sensorbook.plots import spectrum as figures
from sensorbook.plots.style import COLOURS

mpl.use("Agg")
UNIT = re.compile(r"\[[^\[\]]+\]$")
RATE = 100.0


@pytest.fixture(autouse=True)
def _figures():
    plt.close("all")
    yield
    plt.close("all")


@cache
def case(sensor="gyroscope"):
    rng = np.random.default_rng(41)
    values = 1e-3 * rng.normal(size=(60_000, 3)) + np.cumsum(1e-5 * rng.normal(size=(60_000, 3)), 0)
    raw = periodogram(values, RATE, sensor, taper=True)
    averaged = average_frequencies(raw)
    filtered = low_pass_filter(values, RATE, 20.0)
    after = average_frequencies(periodogram(filtered, RATE, sensor, taper=True))
    shaping = shaping_filter(averaged.frequency, averaged.density[:, 1] / 2, RATE, averaged.dof)
    made = average_frequencies(periodogram(shaping.simulate(60_000, rng), RATE))
    time = np.arange(60_000) / RATE
    rest = Recording(sensor, "static", "a.csv", time, values, rate=RATE)
    return {
        "raw": raw, "averaged": averaged, "welch": welch(values, RATE, sensor=sensor), "rest": rest,
        "filtered": filtered, "after": after, "shaping": shaping, "made": made,
        "read": read_off_spectrum(averaged), "ranges": read_ranges(averaged)[1],
    }  # fmt: skip


FIGURES = {
    "spectra": lambda c, a=None: figures.plot_spectra(c["averaged"], a),
    "periodogram": lambda c, a=None: figures.plot_periodogram(
        c["raw"], c["averaged"], c["welch"], "y", a
    ),
    "read-off": lambda c, a=None: figures.plot_spectrum_read_off(
        c["averaged"], c["read"], c["ranges"], "y", a
    ),
    "filtered": lambda c, a=None: figures.plot_filtered(c["rest"], c["filtered"], "y", 20.0, a),
    "filtered spectrum": lambda c, a=None: figures.plot_filtered_spectrum(
        c["averaged"], c["after"], "y", 20.0, a
    ),
    "shaping": lambda c, a=None: figures.plot_shaping(
        c["averaged"], c["shaping"], c["made"], "y", a
    ),
}
SPECTRA = [name for name in FIGURES if name != "filtered"]


def legend(axes):
    return [t.get_text() for t in axes.get_legend().get_texts()]


def line(axes, label):
    return next(drawn for drawn in axes.get_lines() if drawn.get_label() == label)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_its_own(name):
    axes = FIGURES[name](case())
    assert isinstance(axes, Axes)
    assert plt.get_fignums() == [axes.figure.number]
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a missing glyph or a layout that collapses
        axes.figure.canvas.draw()
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())
    assert any(t.gridline.get_visible() for t in axes.xaxis.get_major_ticks())
    assert all(len(drawn.get_xdata()) <= 2000 for drawn in axes.get_lines())


@pytest.mark.parametrize("name", FIGURES)
def test_drawn_into_given_axes(name):
    figure, (given, other) = plt.subplots(1, 2)
    assert FIGURES[name](case(), given) is given
    assert plt.get_fignums() == [figure.number]
    assert given.has_data()
    assert not other.has_data()


@pytest.mark.parametrize("name", SPECTRA)
def test_spectra_are_log_log_with_fine_grids(name):
    axes = FIGURES[name](case())
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert any(t.gridline.get_visible() for t in axes.xaxis.get_minor_ticks())
    assert axes.get_xlabel() == "frequency [Hz]"


@pytest.mark.parametrize(
    ("sensor", "unit"),
    [("gyroscope", "°/s"), ("accelerometer", "m/s²"), ("magnetometer", "µT")],
)
def test_units_follow_the_sensor(sensor, unit):
    axes = FIGURES["spectra"](case(sensor))
    assert axes.get_ylabel() == f"density, one-sided [({unit})²/Hz]"
    assert FIGURES["shaping"](case(sensor)).get_ylabel().startswith("y: density, one-sided [(")
    assert FIGURES["filtered"](case(sensor)).get_ylabel() == f"y less mean [{unit}]"


def test_a_spectrum_without_a_sensor():
    values = np.random.default_rng(42).normal(size=2000)
    axes = figures.plot_spectra(average_frequencies(periodogram(values, 1.0)))
    assert axes.get_ylabel() == "density, one-sided [(SI)²/Hz]"


def test_spectra_are_in_field_units_with_their_bands():
    c = case()
    axes = FIGURES["spectra"](c)
    assert legend(axes) == ["x", "y", "z"]
    assert [drawn.get_color() for drawn in axes.get_lines()] == list(COLOURS.values())
    np.testing.assert_allclose(
        line(axes, "y").get_ydata(), np.degrees(np.degrees(c["averaged"].density[:, 1]))
    )
    band = axes.collections[1].get_paths()[0].vertices[:, 1]
    limits = np.degrees(np.degrees(c["averaged"].limits()[:, 1]))
    assert band.min() == pytest.approx(limits.min())
    assert band.max() == pytest.approx(limits.max())


def test_single_lines_keep_their_extremes():
    c = case()
    axes = FIGURES["periodogram"](c)
    drawn = axes.collections[0].get_paths()[0].vertices
    assert len(drawn) <= 2 * figures.POINTS + 10
    y = np.degrees(np.degrees(c["raw"].density[:, 1]))
    assert (drawn[:, 1].min(), drawn[:, 1].max()) == pytest.approx((y.min(), y.max()))
    assert legend(axes) == ["single lines", "averaged over frequency", "Welch"]


def test_read_off_draws_what_was_read_where_it_was_read():
    c = case()
    axes = FIGURES["read-off"](c)
    names = {
        "random_walk": "N, flat",
        "bias_instability": "B, slope −1",
        "rate_random_walk": "K, slope −2",
    }
    assert {"random_walk", "rate_random_walk"} <= set(c["ranges"])
    assert set(legend(axes)) == {"measured"} | {names[term] for term in c["ranges"]}
    for term, points in c["ranges"].items():
        f = c["averaged"].frequency[points]
        x, y = (d[0] for d in line(axes, names[term]).get_data())
        assert f[0] < x < f[-1]
        found = c["read"]["y"].terms[term].value
        power = {"random_walk": 0, "bias_instability": 1, "rate_random_walk": 2}[term]
        expected = 2 * found**2 / (2 * np.pi * x) ** power
        assert y == pytest.approx(np.degrees(np.degrees(expected)), rel=1e-9)


def test_filter_in_time_shows_a_short_stretch_of_both():
    c = case()
    axes = FIGURES["filtered"](c)
    before, after = line(axes, "as recorded"), line(axes, "below 20 Hz")
    assert len(before.get_xdata()) == len(after.get_xdata()) == 200  # 40 periods of 20 Hz
    assert np.std(after.get_ydata()) < np.std(before.get_ydata())
    assert axes.get_xlabel() == "time [s]"


def test_filtered_spectrum_marks_the_cut_off():
    axes = FIGURES["filtered spectrum"](case())
    assert line(axes, "cut-off").get_xdata()[0] == 20.0
    assert legend(axes) == ["as recorded", "below 20 Hz", "cut-off"]


def test_shaping_draws_the_one_sided_density():
    c = case()
    axes = FIGURES["shaping"](c)
    drawn = line(axes, "filter, |H|²")
    expected = 2 * c["shaping"].density(drawn.get_xdata())
    np.testing.assert_allclose(drawn.get_ydata(), np.degrees(np.degrees(expected)), rtol=1e-12)
    assert legend(axes) == ["measured", "simulated by the filter", "filter, |H|²"]
