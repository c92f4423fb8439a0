"""Figures of curve fits and slopes: what they return, label, scale and leave open."""

import re
import warnings
from functools import cache

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

from sensorbook.noise.allan import allan_deviation
from sensorbook.noise.curves import compare_fits
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.slopes import find_slopes
from sensorbook.plots.curves import (
    SLOPE_NAMES,
    plot_fit_residuals,
    plot_fits,
    plot_local_slopes,
    plot_slopes,
)

mpl.use("Agg")
UNIT = re.compile(r"\[[^\[\]]+\]$")


@pytest.fixture(autouse=True)
def _figures():
    plt.close("all")
    yield
    plt.close("all")


@cache
def noise():
    """White noise with a walk: slopes −½ and +½, and polynomials of σ that fall below zero."""
    rng = np.random.default_rng(431)
    values = 1e-3 * rng.normal(size=(50_000, 2))
    values += 3e-5 * np.cumsum(rng.normal(size=(50_000, 2)), axis=0)
    curve = allan_deviation(values, 100.0, sensor="gyroscope")
    estimate = fit_terms(curve)
    return curve, estimate, compare_fits(curve, "x", estimate["x"])


def slopes(axis="x"):
    curve, estimate, _ = noise()
    return find_slopes(curve, axis, estimate[axis])


def polynomials():
    return [r.fit for r in noise()[2].rows if r.fit.variables == "raw"][:3]


def smooth():
    compared = noise()[2]
    return [compared.row(name, "log").fit for name in ("AAA", "smoothing spline")]


# name: function of the Axes to draw into, or of None
SINGLE = {
    "fits": lambda axes=None: plot_fits(noise()[2], polynomials(), "gyroscope", axes),
    "fits of no sensor": lambda axes=None: plot_fits(noise()[2], smooth(), "", axes),
    "residuals": lambda axes=None: plot_fit_residuals(noise()[2], smooth(), axes),
    "slopes": lambda axes=None: plot_slopes(noise()[0], slopes(), axes),
    "local slopes": lambda axes=None: plot_local_slopes([slopes("x"), slopes("y")], axes),
}


@pytest.mark.parametrize("name", SINGLE)
def test_a_figure_of_its_own(name):
    axes = SINGLE[name]()
    assert isinstance(axes, Axes)
    assert plt.get_fignums() == [axes.figure.number]
    assert axes.has_data()
    assert axes.get_xscale() == "log"
    assert UNIT.search(axes.get_xlabel())
    assert UNIT.search(axes.get_ylabel())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a missing glyph or a layout that collapses
        axes.figure.canvas.draw()


@pytest.mark.parametrize("name", SINGLE)
def test_drawn_into_given_axes(name):
    figure, (given, other) = plt.subplots(1, 2)
    assert SINGLE[name](given) is given
    assert plt.get_fignums() == [figure.number]
    assert given.has_data()
    assert not other.has_data()


def test_fits_that_fail_leave_the_scale_to_the_curve():
    compared = noise()[2]
    axes = plot_fits(compared, polynomials(), "gyroscope")
    label = np.pi / 180 / 3600  # shown in °/h
    low, high = np.array(axes.get_ylim()) * label
    assert low == pytest.approx(0.25 * compared.sigma.min())
    assert high == pytest.approx(2.5 * compared.sigma.max())
    # Below zero a logarithmic axis shows nothing: bars stand for it and the legend says so.
    failing = sum(row.not_positive > 0 for row in compared.rows[:3])
    assert failing > 0
    assert len(axes.collections) == failing
    assert axes.get_legend().get_title().get_text() == "bars below: fit ≤ 0"
    sound = plot_fits(compared, smooth(), "gyroscope")
    assert sound.get_legend().get_title().get_text() == ""


def test_legend_tells_raw_from_logarithmic_fits():
    compared = noise()[2]
    both = [compared.row("rational 4/2", way).fit for way in ("raw", "log")]
    names = [t.get_text() for t in plot_fits(compared, both, "gyroscope").get_legend().texts]
    assert names == ["rational 4/2, σ in τ", "rational 4/2, in logarithms", "Allan deviation"]


def test_residuals_are_drawn_in_decades():
    compared, fits = noise()[2], smooth()
    axes = plot_fit_residuals(compared, fits)
    for fit, line in zip(fits, axes.lines, strict=False):
        np.testing.assert_allclose(line.get_ydata(), fit.residual(compared.tau, compared.sigma))


def test_each_range_is_shaded_named_and_has_its_line():
    found = slopes()
    assert {r.slope for r in found.ranges} == {-0.5, 0.5}
    axes = plot_slopes(noise()[0], found)
    assert [t.get_text() for t in axes.texts] == [SLOPE_NAMES[r.slope] for r in found.ranges]
    curve, *lines = axes.lines
    assert len(lines) == len(found.ranges)
    np.testing.assert_array_equal(curve.get_xdata(), noise()[0].tau)
    for line, r in zip(lines, found.ranges, strict=True):
        rise = np.diff(np.log(line.get_ydata()))[0] / np.diff(np.log(line.get_xdata()))[0]
        assert rise == pytest.approx(r.slope)
        shade = axes.patches[lines.index(line)]
        assert shade.get_x() == pytest.approx(r.tau_low)
        assert shade.get_x() + shade.get_width() == pytest.approx(r.tau_high)


def test_local_slopes_are_labelled_by_the_nominal_ones():
    axes = plot_local_slopes([slopes()])
    assert [t.get_text() for t in axes.get_yticklabels()] == ["−1", "−½", "0", "+½", "+1"]
