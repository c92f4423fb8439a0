"""Drawings of sensor principles: that they show the numbers given, the right way round."""

import re

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from sensorbook.plots import principles as plots
from sensorbook.plots import principles_curves as curves
from sensorbook.plots import principles_instruments as instruments
from sensorbook.plots.style import COLOURS

mpl.use("Agg")


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def words(axes):
    return " | ".join(t.get_text() for t in axes.texts)


def line(axes, label):
    return next(one for one in axes.get_lines() if one.get_label() == label)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (-1.55e-8, "m", "−15.5 nm"),
        (2e-6, "m", "2 µm"),
        (9.16e-14, "N", "91.6 fN"),
        (1.0, "V", "1 V"),
        (1000.0, "Hz", "1 kHz"),
        (2.068e-15, "T", "2.07 fT"),
        (0.0, "m", "0 m"),
        (3e-28, "m", "0.0003 ym"),
    ],
)
def test_engineering(value, unit, expected):
    assert plots.engineering(value, unit) == expected


@pytest.mark.parametrize("sign", [-1, 1])
def test_accelerometer_moves_the_mass_the_way_it_is_told(sign):
    axes = plots.plot_accelerometer(sign * 15.5e-9, 2e-6)
    finger = next(
        p for p in axes.patches
        if isinstance(p, Rectangle) and mpl.colors.to_hex(p.get_facecolor()).upper() == COLOURS["x"]
    )  # fmt: skip
    assert np.sign(finger.get_y() + finger.get_height() / 2 - 3.3) == sign  # of the middle, 3.3
    shown = words(axes)
    assert f"$x$ = {'−' if sign < 0 else ''}15.5 nm" in shown
    assert "$d$ = 2 µm" in shown
    assert f"{'−' if sign < 0 else ''}0.775 %" in shown
    # A gap of 1 in the drawing, a displacement of 0.45: 0.45 · 2000 / 15.5.
    assert "drawn 58 times larger" in shown


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_accelerometer_beyond_its_gap_lies_against_the_plate(sign):
    axes = plots.plot_accelerometer(sign * 99.4e-6, 2e-6)
    blue, red = (
        [
            p for p in axes.patches
            if isinstance(p, Rectangle)
            and mpl.colors.to_hex(p.get_facecolor()).upper() == COLOURS[axis]
        ]
        for axis in "xy"
    )  # fmt: skip
    (finger,), plate = blue, red[0 if sign > 0 else 1]
    edges = finger.get_y() + (finger.get_height() if sign > 0 else 0)
    inner = plate.get_y() + (0 if sign > 0 else plate.get_height())
    assert edges == pytest.approx(inner)
    shown = words(axes)
    assert f"$x$ = {'−' if sign < 0 else ''}99.4 µm" in shown
    assert "against the stop" in shown
    assert "no reading" in shown
    assert "%" not in shown
    assert "times larger" not in shown


def test_an_accelerometer_that_does_not_move_is_in_the_middle():
    shown = words(plots.plot_accelerometer(0.0, 2e-6))
    assert "$x$ = 0 m" in shown
    assert "times larger" not in shown


@pytest.mark.parametrize(
    ("rate", "one", "other"), [(1e-4, "longer", "shorter"), (-1e-4, "shorter", "longer")]
)
def test_sagnac_light_that_runs_along_has_farther_to_go(rate, one, other):
    axes = plots.plot_sagnac(rate, 1e-4)
    shown = words(axes)
    assert f"counter-clockwise: {one} way" in shown
    assert f"| clockwise: {other} way" in shown
    assert "100 µrad" in shown
    assert f"{np.degrees(rate) * 3600:.4g} °/h" in shown
    ways = [np.hypot(*np.diff(each.get_xydata(), axis=0).T).sum() for each in axes.get_lines()[:2]]
    # Over the radii 2.25 and 1.95 at which the two are drawn, 340° and 380°.
    assert (ways[0] / 2.25 > ways[1] / 1.95) == (rate > 0)


def test_resonator_s_vibration_lags():
    axes = plots.plot_resonator(np.radians(60), 0.3)
    assert "body: 60°" in words(axes)
    assert "vibration: 42°" in words(axes)
    ring = axes.get_lines()[-4].get_xydata() - [1.9, 0]  # solid, after the turn
    longest = ring[np.argmax(np.hypot(*ring.T))]
    assert np.degrees(np.arctan2(*longest[::-1])) % 180 == pytest.approx(42, abs=1)  # points: 0.9°


@pytest.mark.parametrize(("rate", "force"), [(1e-4, -1e-13), (-1e-4, 1e-13)])
def test_coriolis_force_points_where_minus_two_m_omega_cross_v_does(rate, force):
    axes = plots.plot_coriolis(0.6, rate, force)
    expected = -np.cross([0, 0, rate], [0.6, 0, 0])[1]
    drawn = next(
        p for p in axes.patches
        if isinstance(p, FancyArrowPatch) and abs(p._posA_posB[0][0] - 4.45) < 1e-9
    )  # fmt: skip
    assert np.sign(drawn._posA_posB[1][1] - drawn._posA_posB[0][1]) == np.sign(expected)
    assert plots.engineering(force, "N") in words(axes)
    assert ("out of" if rate > 0 else "into") + " the page" in words(axes)


@pytest.mark.parametrize("field", [48e-6, -48e-6])
def test_hall_electrons_go_to_the_edge_that_the_force_names(field):
    axes = plots.plot_hall(1e-3, field, 30e-6)
    # j × B drives carriers of either sign: x × z = −y.
    start, *_, end = axes.get_lines()[4].get_xydata()
    assert np.sign(end[1] - start[1]) == -np.sign(field)
    assert end[0] < start[0], "electrons run against the current"
    signs = {t.get_text(): t.get_position()[1] for t in axes.texts if t.get_text() in "+−"}
    assert (signs["−"] < signs["+"]) == (field > 0)
    assert "$V_H$ = 30 µV" in words(axes)
    assert "$I$ = 1 mA" in words(axes)


@pytest.mark.parametrize("field", [[25.0, 3.0, 41.0], [20.0, -4.0, -50.0], [-5.0, 2.0, 60.0]])
def test_field_vector_is_drawn_as_given(field):
    above, side = curves.plot_field_vector(1e-6 * np.array(field))
    north, east, down = field
    assert above.get_lines()[2].get_xydata()[1] == pytest.approx([east, north])
    assert side.get_lines()[2].get_xydata()[1] == pytest.approx([np.hypot(north, east), down])
    for axes in (above, side):
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert re.search(r"\[µT\]$", label)
        x, y = axes.get_lines()[2].get_xydata().T
        for values, limits in ((x, axes.get_xlim()), (y, axes.get_ylim())):
            assert min(limits) < values.min() <= values.max() < max(limits), "within the axes"
    assert side.get_ylim()[0] > side.get_ylim()[1], "down is down"
    assert f"{np.degrees(np.arctan2(east, north)):+.1f}°" in words(above)
    assert f"{np.degrees(np.arctan2(down, np.hypot(north, east))):+.1f}°" in words(side)


def test_platform_and_strapdown_differ_in_who_turns():
    platform, strapdown = plots.plot_platform_and_strapdown()
    assert "gimbal motors" in words(platform)
    assert "turn axes" in words(strapdown)
    for axes in (platform, strapdown):
        assert {"gyroscopes", "accelerometers"} <= {t.get_text() for t in axes.texts}
        assert "add $g$" in words(axes)


def test_two_frames_tell_both_sets_of_coordinates():
    axes = plots.plot_two_frames(np.radians(90), [1.0, 0.25])
    # A turn by 90° brings the body's x to the reference's y.
    assert "in ref: (1.000, 0.250)" in words(axes)
    assert "in body: (0.250, −1.000)" in words(axes)


def test_limb_scan_has_two_crossings_at_the_limb():
    radius, cone, tilt = np.radians([68.9, 45, 60])
    axes = curves.plot_limb_scan(radius, cone, tilt)
    disc = next(p for p in axes.patches if isinstance(p, Circle))
    assert disc.get_radius() == pytest.approx(68.9)
    crossings = line(axes, "limb crossing").get_xydata()
    assert len(crossings) == 2
    # A point of the scan every 0.25°.
    assert np.hypot(*crossings.T) == pytest.approx(68.9, abs=0.3)
    over = line(axes, "scan over the Earth").get_xydata()
    over = over[np.isfinite(over[:, 0])]
    assert np.hypot(*over.T).max() < 68.9
    assert np.hypot(*over.T).min() == pytest.approx(15)  # 60° − 45°
    # Beside the cone's axis the azimuth of a crossing follows from the spherical law of cosines.
    azimuth = np.arccos(
        (np.cos(cone) - np.cos(radius) * np.cos(tilt)) / np.sin(radius) / np.sin(tilt)
    )
    assert np.abs(np.arctan2(crossings[:, 1], crossings[:, 0])) == pytest.approx(azimuth, abs=0.01)
    assert axes.get_xlabel().endswith("[°]")


def test_a_scan_that_misses_has_no_crossing():
    axes = curves.plot_limb_scan(np.radians(8.7), np.radians(45), np.radians(90))
    assert len(line(axes, "limb crossing").get_xydata()) == 0


def test_response_marks_the_gyroscope():
    axes = curves.plot_response([1, 10, 100], [1e-12, 1e-13, 1e-14], (10, 1e-13))
    assert axes.get_lines()[0].get_ydata() == pytest.approx([1, 0.1, 0.01])
    assert line(axes, "this gyroscope").get_xydata()[0] == pytest.approx([10, 0.1])
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert (axes.get_xlabel()[-4:], axes.get_ylabel()[-4:]) == ("[Hz]", "[pm]")


def test_error_lines_are_readings_less_truth():
    true = np.radians([-10.0, 0.0, 10.0])
    axes = curves.plot_error_lines(true, {"bias": true + np.radians(0.5), "scale": 1.02 * true})
    assert line(axes, "bias").get_ydata() == pytest.approx([0.5] * 3)
    assert line(axes, "scale").get_ydata() == pytest.approx([-0.2, 0, 0.2])
    assert axes.get_xlabel() == "true rate [°/s]"
    assert axes.get_ylabel().endswith("[°/s]")


def test_growth_begins_where_the_errors_do():
    axes = curves.plot_growth([60, 600], {"one": [10.0, 1e3], "other": [4.0, 1e-9]})
    assert line(axes, "one").get_xydata().tolist() == [[1, 0.01], [10, 1]]
    assert axes.get_ylim()[0] == pytest.approx(0.002)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [min]", "position error [km]")


def test_radiance_shades_the_band():
    axes = curves.plot_radiance([10e-6, 20e-6], {"300 K": [9e6, 4e6]}, (14e-6, 16e-6))
    assert line(axes, "300 K").get_xydata() == pytest.approx(np.array([[10, 9], [20, 4]]))
    band = axes.patches[0]
    assert (band.get_x(), band.get_width()) == pytest.approx((14, 2))
    assert band.get_label() == "14 to 16 µm"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("wavelength [µm]", "radiance [W/m²/sr/µm]")


@pytest.mark.parametrize(("rate", "low"), [(1e-4, "lower"), (-1e-4, "higher"), (0.0, "same")])
def test_ring_laser_the_longer_way_is_the_lower_frequency(rate, low):
    axes = instruments.plot_ring_laser(rate, rate * 1e5)
    shown = words(axes)
    assert f"counter-clockwise: {low} frequency" in shown
    assert ("$\\Delta f$ = 10 Hz" if rate else "$\\Delta f$ = 0 Hz") in shown
    assert f"{np.degrees(rate) * 3600:.4g} °/h" in shown
    for path, sign in zip(axes.get_lines()[:2], (1, -1), strict=True):
        x, y = path.get_xydata().T
        assert np.sign(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) == sign  # its area, by its sense


def test_rotor_drifts_towards_the_torque():
    axes = instruments.plot_rotor(np.radians(0.019) / 3600)
    assert "drift $M/H$ = 0.019 °/h per g" in words(axes)
    # H to the right, z up: δ x̂ × (−g ẑ) = +ŷ, away from the viewer. The near side of the turn about
    # the vertical then goes to the right.
    spin, weight = np.array([1.0, 0, 0]), np.array([0, 0, -1.0])
    assert np.cross(spin, weight)[1] > 0
    drift = next(
        p for p in axes.patches
        if isinstance(p, FancyArrowPatch) and p._posA_posB[0][1] > 2
    )  # fmt: skip
    assert drift._posA_posB[1][0] > drift._posA_posB[0][0]


def test_resonant_accelerometer_has_two_beams():
    shown = words(instruments.plot_resonant_accelerometer())
    assert "$f_1$ falls" in shown
    assert "beam 2 is pulled, $f_2$ rises" in shown


def test_magnetoresistive_bridge_is_unbalanced_across():
    axes = instruments.plot_magnetoresistive_bridge()
    at = [(t.get_text(), np.sign(np.array(t.get_position()) - [3.6, 2.5]).tolist())
          for t in axes.texts if "Delta R$" in t.get_text() and "U" not in t.get_text()]  # fmt: skip
    # Opposite strips are alike: only then does the bridge's middle tell the change.
    more = [place for name, place in at if "+" in name]
    less = [place for name, place in at if "-" in name]
    assert more == [[-1, 1], [1, -1]]
    assert less == [[1, 1], [-1, -1]]


def test_every_drawing_goes_into_given_axes():
    given = plt.subplots()[1]
    for drawn in (
        plots.plot_accelerometer(1e-9, 2e-6, given),
        plots.plot_sagnac(0.0, 0.0, given),
        plots.plot_resonator(0.0, 0.3, given),
        plots.plot_coriolis(0.5, 0.0, 0.0, given),
        plots.plot_hall(1e-3, 0.0, 0.0, given),
        plots.plot_two_frames(-1.0, [1, 1], given),
        instruments.plot_ring_laser(0.0, 0.0, given),
        instruments.plot_rotor(0.0, given),
        instruments.plot_resonant_accelerometer(given),
        instruments.plot_magnetoresistive_bridge(given),
        curves.plot_response([1, 2], [1, 2], (1, 1), given),
    ):
        assert drawn is given
