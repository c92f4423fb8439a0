"""Figures of a magnetometer's calibration: what they draw, with labels and units."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.alignment import align, heading_error
from sensorbook.magnetometer.coverage import even_directions
from sensorbook.plots import magnetometer as plots
from sensorbook.simulate import rotation

FIELD = 48e-6 * np.array([0, np.cos(1.0), -np.sin(1.0)])


@pytest.fixture(scope="module")
def turned():
    rng = np.random.default_rng(11)
    true = rotation.turned(rng, 3000, 50.0, FIELD, 9.8)
    iron = rotation.draw_iron(rng, 48e-6)
    m = rotation.noisy(
        rng, rotation.read_field(true["field"], iron), 50.0, rotation.NOISE["magnetometer"]
    )
    m[100] += 30e-6
    fit = calibrate(m)
    return m, true["force"], fit


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_axis_pairs(turned):
    m, _, fit = turned
    axes = plots.plot_axis_pairs({"as read": m, "corrected": fit.correct(m)}, fit.field)
    assert axes.shape == (2, 3)
    assert [(a.get_xlabel(), a.get_ylabel()) for a in axes[0]] == [
        ("y [µT]", "z [µT]"),
        ("z [µT]", "x [µT]"),
        ("x [µT]", "y [µT]"),
    ]
    points, circle, origin = axes[1, 0].get_lines()
    assert np.hypot(*circle.get_xydata().T) == pytest.approx(1e6 * fit.field)
    # Corrected readings lie within the circle, but for noise of 1 %.
    assert np.quantile(np.hypot(*points.get_xydata().T), 0.99) < 1.03e6 * fit.field
    assert origin.get_xydata().tolist() == [[0, 0]]
    assert axes[0, 1].get_title() == "as read"


def test_cloud_has_readings_what_was_set_aside_and_the_hard_iron(turned):
    m, _, fit = turned
    axes = plots.plot_cloud(fit, m)
    assert axes.get_zlabel() == "z [µT]"
    names = [t.get_text() for t in axes.get_legend().get_texts()]
    assert names == ["reading", "set aside", "hard iron"]
    centre = axes.collections[-1]._offsets3d
    assert np.ravel(centre) == pytest.approx(1e6 * fit.hard_iron)


def test_coverage_marks_what_was_not_seen():
    u = even_directions(5000)
    upper, lower = plots.plot_coverage(u[u[:, 2] > 0])
    names = {t.get_text() for t in upper.figure.legends[0].get_texts()}
    assert names == {"not seen", "reading"}
    labels = lower.get_legend_handles_labels()[1]
    assert labels == ["not seen"]
    # Of the half sphere below, all but the 15° next to the edge: 1 − sin 15° of 500 directions.
    count = len(lower.collections[0].get_offsets())
    assert count == pytest.approx(
        500 * (1 - np.sin(np.radians(15))), rel=0.05
    )  # the readings begin a degree above the edge


def test_residuals_over_time_and_by_direction(turned):
    m, _, fit = turned
    corrected = fit.correct(m)
    length = np.linalg.norm(corrected, axis=1)
    residual = length / fit.field - 1
    over, histogram = plots.plot_residuals(np.arange(len(m)) / 50, "time [s]", residual, fit.used)
    assert over.get_xlabel() == "time [s]"
    assert over.get_ylabel() == "‖true‖ / field − 1 [%]"
    assert over.get_legend().get_texts()[0].get_text().startswith("set aside")
    assert sum(p.get_width() for p in histogram.patches) == fit.used.sum()
    maps = plots.plot_residual_map(corrected / length[:, None], residual)
    drawn = sum(len(a.collections[0].get_offsets()) for a in maps)
    assert 300 < drawn <= 400
    assert maps[0].figure.axes[-1].get_ylabel() == "residual [%]"


def test_dip_and_heading(turned):
    m, force, fit = turned
    beside = align(fit, m[fit.used], force[fit.used], 9.8)
    both, fine = plots.plot_dip(beside)
    assert both.get_xlabel() == fine.get_xlabel() == "dip angle [°]"
    assert len(both.get_legend().get_texts()) == 3
    assert [t.get_text().split(":")[0] for t in fine.get_legend().get_texts()] == [
        "each calibrated",
        "and aligned",
    ]
    heading = heading_error(fit, beside.dip, beside)
    before, after = plots.plot_heading(heading, 2.0)
    assert before.get_ylabel() == "heading error [°]"
    band = after.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(2 * np.degrees(heading.std.max()))
