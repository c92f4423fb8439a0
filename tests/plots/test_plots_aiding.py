"""Figures of a gyroscope aided by a reference: what is drawn is what was found, in degrees."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.attitude.experiment import METHODS, Consistency, Growth
from sensorbook.plots import aiding as plots
from sensorbook.reporting import attitudes

TIME = np.arange(0, 10, 0.5)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def line(axes, label):
    return next(a.get_xydata() for a in axes.lines if a.get_label() == label)


def test_names_are_those_of_the_pages():
    assert set(plots.STYLES) == set(METHODS)
    assert {m: plots.label(m) for m in attitudes.METHODS} == attitudes.METHODS
    looks = [(colour, line_) for _, colour, line_, _ in plots.STYLES.values()]
    assert len(set(looks)) == len(looks)


def test_angles_break_where_they_pass_half_a_turn():
    found = np.stack([(0.5 * TIME + np.pi) % (2 * np.pi) - np.pi] * 3, axis=1)
    axes = plots.plot_angles(TIME, np.zeros((20, 3)), found)
    drawn = line(axes[0], "integrated")[:, 1]
    jump = np.flatnonzero(np.diff(found[:, 0]) < -np.pi) + 1
    broken = np.flatnonzero(np.isnan(drawn))
    assert list(broken) == list(jump + np.arange(len(jump))) != []
    np.testing.assert_allclose(np.delete(drawn, broken), np.degrees(found[:, 0]))
    assert line(axes[2], "reference")[:, 1].max() == 0


def test_a_reference_that_comes_seldom_is_drawn():
    """One stamp in five, then none for ten seconds but a single one."""
    time = np.arange(0, 40, 0.2)
    seldom = np.tile(np.radians(time)[:, None], 3)
    seldom[(np.arange(200) % 5 != 0) | ((time > 10.1) & (time < 19.9))] = np.nan
    seldom[75] = np.radians(15)
    axes = plots.plot_angles(time, seldom, np.zeros((200, 3)), names=("camera", "filter"))
    drawn = line(axes[1], "camera")
    known = np.isfinite(drawn[:, 1])
    np.testing.assert_allclose(drawn[known, 1], np.r_[0:11, 15, 20:40])
    np.testing.assert_allclose(drawn[known, 0], drawn[known, 1])
    assert list(np.flatnonzero(~known)) == [11, 13], "a break on either side of the single one"
    (mark,) = [a for a in axes[1].lines if a.get_marker() == "." and len(a.get_xdata())]
    np.testing.assert_allclose(mark.get_xydata(), [[15, 15]])
    assert {a.get_text() for a in axes[0].get_legend().get_texts()} == {"camera", "filter"}
    errors = plots.plot_errors(time, seldom, np.full((200, 3), 0.1))
    np.testing.assert_allclose(errors[2].lines[0].get_xydata(), drawn)
    lost = plots.plot_outage(time, {"mekf": seldom[:, 0]}, (12, 20), "error")
    assert len(line(lost, "Kalman filter (MEKF)")) == 13 + 2, (
        "6 to 10, 15, and 20 to 26 s, broken twice"
    )
    assert lost.get_ylabel() == "error [°]"


def test_nothing_known_draws_nothing():
    nothing = np.full((20, 3), np.nan)
    axes = plots.plot_angles(TIME, nothing, np.zeros((20, 3)))
    assert not len(line(axes[0], "reference"))


def test_errors_within_their_band():
    errors, std = np.radians(np.ones((20, 3))), np.radians(np.full((20, 3), 2.0))
    axes = plots.plot_errors(TIME, errors, std)
    (band,) = axes[1].collections
    assert np.ptp(band.get_paths()[0].vertices[:, 1]) == pytest.approx(2 * 1.96 * 2)
    assert axes[1].lines[0].get_ydata()[0] == pytest.approx(1)
    assert not plots.plot_errors(TIME, errors)[0].collections, "no band without standard errors"


def test_bias():
    bias, std = np.radians(np.tile([1.0, 2.0, 3.0], (20, 1))), np.radians(np.full((20, 3), 0.1))
    axes = plots.plot_bias(TIME, bias, std, np.radians([1, 2, 3]))
    assert line(axes, "z, found")[0, 1] == pytest.approx(3)
    assert axes.get_ylim() == pytest.approx((1 - 0.196, 3 + 0.196))


def test_outage_shows_what_is_about_it():
    time = np.arange(0, 60, 0.5)
    axes = plots.plot_outage(time, {"mekf": np.radians(1 + time)}, (12, 20))
    drawn = line(axes, "Kalman filter (MEKF)")
    np.testing.assert_allclose(drawn[:, 1], 1 + drawn[:, 0])
    assert (drawn[0, 0], drawn[-1, 0]) == (6, 26)
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel() == "rms error [°]"


def test_consistency_and_growth():
    found = Consistency(np.full(20, 3.0), 1.4, 5.2, 0.95, 3.0, 2.8, 3.2, 0.01)
    axes = plots.plot_consistency(TIME, {"N as it is": found})
    assert line(axes, "N as it is")[:, 1].mean() == 3
    band = axes.patches[0].get_extents().transformed(axes.transData.inverted())
    assert (band.y0, band.y1) == pytest.approx((1.4, 5.2))
    grown = Growth(np.radians(1 + TIME), np.radians(2 + TIME))
    axes = plots.plot_growth(TIME, {"bias known": grown})
    np.testing.assert_allclose(line(axes, "bias known"), np.stack([TIME, 1 + TIME], 1)[1:])


def test_by_rate_and_by_reference():
    axes = plots.plot_by_rate([0.1, 1], {"reset": np.radians([7, 1])}, [7.1, 1.3])
    np.testing.assert_allclose(line(axes, "work C: reset"), [[0.1, 7], [1, 1]])
    np.testing.assert_allclose(line(axes, "printed by work C"), [[0.1, 7.1], [1, 1.3]])
    without = plots.plot_by_rate([0.1, 1], {"reset": np.radians([7, 1])})
    assert "printed by work C" not in [a.get_label() for a in without.lines]
    axes = plots.plot_by_reference(np.radians([0.1, 1]), {"mekf": np.radians([2, 3])})
    # The mean length of a normal vector with unit deviations: 1.596.
    np.testing.assert_allclose(line(axes, "the reference itself")[1], [1, 1.5958], rtol=1e-4)
