"""Units against exact values, and every way to get them wrong."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensorbook.units import (
    SENSOR_UNITS,
    UnitError,
    factor,
    field_unit,
    quantities,
    si_unit,
    to_si,
)

DEG = math.pi / 180
G = 9.80665

EXACT = [
    ("rad/s", "angular_rate", 1.0),
    ("deg/s", "angular_rate", DEG),
    ("°/s", "angular_rate", DEG),
    ("degrees/second", "angular_rate", DEG),
    ("dps", "angular_rate", DEG),
    ("DEG/S", "angular_rate", DEG),
    ("deg s-1", "angular_rate", DEG),
    ("rpm", "angular_rate", 2 * math.pi / 60),
    ("deg/h", "angular_rate", DEG / 3600),
    ("°/hr", "angular_rate", DEG / 3600),
    ("mrad/s", "angular_rate", 1e-3),
    ("m/s2", "acceleration", 1.0),
    ("m/s^2", "acceleration", 1.0),
    ("m/s**2", "acceleration", 1.0),
    ("m/s²", "acceleration", 1.0),
    ("m·s⁻²", "acceleration", 1.0),
    ("m/s/s", "acceleration", 1.0),
    ("[m/s^2]", "acceleration", 1.0),
    ("g", "acceleration", G),
    ("mg", "acceleration", G * 1e-3),
    ("milli-g", "acceleration", G * 1e-3),
    ("ug", "acceleration", G * 1e-6),
    ("µg", "acceleration", G * 1e-6),  # micro sign
    ("μg", "acceleration", G * 1e-6),  # Greek mu
    ("T", "magnetic_flux_density", 1.0),
    ("uT", "magnetic_flux_density", 1e-6),
    ("µT", "magnetic_flux_density", 1e-6),
    ("nT", "magnetic_flux_density", 1e-9),
    ("gauss", "magnetic_flux_density", 1e-4),
    ("G", "magnetic_flux_density", 1e-4),
    ("mG", "magnetic_flux_density", 1e-7),
    ("s", "time", 1.0),
    ("ms", "time", 1e-3),
    ("us", "time", 1e-6),
    ("µs", "time", 1e-6),
    ("ns", "time", 1e-9),
    ("min", "time", 60.0),
    ("h", "time", 3600.0),
    ("degC", "temperature", 1.0),
    ("°C", "temperature", 1.0),
    ("K", "temperature", 1.0),
    ("°F", "temperature", 5 / 9),
    ("deg/sqrt(h)", "rad/s/sqrt(Hz)", DEG / 60),
    ("°/√h", "rad/s/sqrt(Hz)", DEG / 60),
    ("deg/rt-hr", "rad/s/sqrt(Hz)", DEG / 60),
    ("deg/h^0.5", "rad/s/sqrt(Hz)", DEG / 60),
    ("deg h^-1/2", "rad/s/sqrt(Hz)", DEG / 60),
    ("deg/s/sqrt(Hz)", "rad/s/sqrt(Hz)", DEG),
    ("(°/s)/√Hz", "rad/s/sqrt(Hz)", DEG),
    ("deg/h/sqrt(Hz)", "rad/s/sqrt(Hz)", DEG / 3600),
    ("mg/sqrt(Hz)", "m/s^2/sqrt(Hz)", G * 1e-3),
    ("µg/√Hz", "m/s^2/sqrt(Hz)", G * 1e-6),
    ("ug/rtHz", "m/s^2/sqrt(Hz)", G * 1e-6),
    ("m/s/sqrt(h)", "m/s^2/sqrt(Hz)", 1 / 60),
    ("deg/h/sqrt(s)", "rad/s^2/sqrt(Hz)", DEG / 3600),
    ("deg/h^(3/2)", "rad/s^2/sqrt(Hz)", DEG / 3600**1.5),
    ("m/s/h^(3/2)", "m/s^3/sqrt(Hz)", 1 / 3600**1.5),
    ("m/s/h³ᐟ²", "m/s^3/sqrt(Hz)", 1 / 3600**1.5),
    ("m/s/h^{3/2}", "m/s^3/sqrt(Hz)", 1 / 3600**1.5),
    ("deg/h/s", "rad/s^2", DEG / 3600),
    ("%", "1", 0.01),
]


@pytest.mark.parametrize(("spelling", "quantity", "expected"), EXACT)
def test_factor_is_exact(spelling, quantity, expected):
    # 4 ulp: pint multiplies a handful of factors, each rounded once.
    assert factor(spelling, quantity) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(("spelling", "quantity", "expected"), EXACT)
def test_blanks_around_a_unit_change_nothing(spelling, quantity, expected):
    assert factor(f"  {spelling} ", quantity) == factor(spelling, quantity)


@given(
    st.sampled_from([e for e in EXACT if e[1] != "temperature"]),
    st.floats(min_value=-1e6, max_value=1e6),
)
def test_round_trip(entry, value):
    spelling, quantity, _ = entry
    there = to_si([value], spelling, quantity)
    assert there / factor(spelling, quantity) == pytest.approx(value, rel=1e-14, abs=1e-300)


def test_temperature_offsets():
    np.testing.assert_allclose(to_si([32.0, 212.0], "°F", "degC"), [0, 100], atol=1e-13)
    np.testing.assert_allclose(to_si([273.15, 300], "K", "temperature"), [0, 26.85], atol=1e-13)
    np.testing.assert_array_equal(to_si([-40.0, 25.0], "°C", "degC"), [-40, 25])


def test_gauss_for_an_acceleration_suggests_g():
    with pytest.raises(UnitError) as caught:
        factor("G", "acceleration")
    assert str(caught.value) == "'G' is gauss, a magnetic flux density — write g for gravity"
    with pytest.raises(UnitError, match="'mG' is milligauss, a magnetic flux density — write mg"):
        factor("mG", "acceleration")


def test_an_unknown_unit_gets_examples_that_fit():
    with pytest.raises(UnitError) as caught:
        factor("furlong", "angular_rate")
    assert str(caught.value) == (
        "'furlong' is not a unit sensorbook knows — write an angular rate such as deg/s, rad/s or deg/h"
    )


def test_a_unit_of_something_else_is_told_apart():
    with pytest.raises(UnitError, match="'g' is an acceleration, not an angular rate"):
        factor("g", "angular_rate")
    with pytest.raises(UnitError, match="'deg' is an angle, not an angular rate"):
        factor("deg", "angular_rate")
    with pytest.raises(UnitError, match="'1/s' is a frequency, not an angular rate"):
        factor("1/s", "angular_rate")  # an angle is no pure number here


@pytest.mark.parametrize(
    "hostile",
    ["10**10**10", "g**9**9**9", "", " ", "()", "((((", "m/s)", "s^^2", "s^99", "m" * 10_000, "√",
     "__import__('os')", "m;s", "m\ns\n;", "1/0", "s^(1/0)", "s^1/0", "²", "m/²", None, 3, "0.5"],
)  # fmt: skip
def test_hostile_spellings_are_refused_in_one_line(hostile):
    with pytest.raises(UnitError) as caught:
        factor(hostile, "acceleration")
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


@given(st.text(max_size=50))
def test_any_text_is_a_unit_or_a_unit_error(text):
    with contextlib.suppress(UnitError):
        assert math.isfinite(factor(text, "acceleration"))


@given(st.text(alphabet="mgsGTh°√/*^()-123 .²³⁻", max_size=12))
def test_any_mixture_of_known_signs_is_a_unit_or_a_unit_error(text):
    with contextlib.suppress(UnitError):
        assert factor(text, "m/s^2") > 0


@pytest.mark.parametrize("sensor", SENSOR_UNITS)
def test_every_field_unit_measures_what_its_si_unit_measures(sensor):
    for quantity in quantities(sensor):
        label, size = field_unit(sensor, quantity)
        assert size == factor(label, si_unit(sensor, quantity)) > 0


def test_field_units_as_the_field_writes_them():
    assert field_unit("gyroscope", "random_walk") == ("°/√h", pytest.approx(DEG / 60, rel=1e-15))
    assert field_unit("accelerometer", "rate_random_walk")[0] == "m/s/h³ᐟ²"
    assert si_unit("gyroscope", "quantization") == "rad"
    assert si_unit("magnetometer", "rate_ramp") == "T/s"
    assert field_unit("magnetometer", "hard_iron") == ("µT", 1e-6)
    assert field_unit("magnetometer", "soft_iron") == ("1", 1.0)
    assert field_unit("magnetometer", "coverage_percent") == ("%", 1.0)
    assert field_unit("magnetometer", "heading_error_after_deg") == ("°", 1.0)


def test_an_unknown_sensor_or_quantity_lists_the_known_ones():
    with pytest.raises(UnitError, match="use one of gyroscope, accelerometer, magnetometer"):
        si_unit("barometer")
    with pytest.raises(UnitError, match="'noise' is not a quantity of the gyroscope — use one of"):
        field_unit("gyroscope", "noise")
