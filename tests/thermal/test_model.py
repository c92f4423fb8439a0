"""The thermal model: its convention, its pieces, its form in results.json."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.polynomial import polyval

from sensorbook.thermal import ThermalModel
from sensorbook.thermal.model import Form

SPAN, REFERENCE = (10.0, 50.0), 30.0
sizes = st.floats(-100, 100, allow_subnormal=False)


@st.composite
def solutions(draw):
    """A form, with or without a jump, and a solution for it."""
    degree = draw(st.integers(0, 5))
    jump = None
    if draw(st.booleans()):
        low = draw(st.floats(15, 40))
        jump = (low, low + draw(st.floats(0.2, 5)))
    form = Form(degree, jump)
    solution = draw(st.lists(sizes, min_size=len_of(form), max_size=len_of(form)))
    return form, draw(sizes), np.array(solution)


def len_of(form):
    return form.columns(np.array([20.0]), SPAN).shape[1]


def model_of(case) -> ThermalModel:
    form, offset, solution = case
    return form.model(offset, solution, SPAN, REFERENCE)


def test_coefficients_are_powers_of_the_distance_to_the_reference():
    model = ThermalModel(25.0, ((20.0, 44.0, (0.5, 0.1, -0.02)),))
    assert model.bias(25.0) == 0.5  # [0] is the reading there
    assert model.bias(np.array([27.0]))[0] == pytest.approx(0.5 + 0.1 * 2 - 0.02 * 4)
    assert model.change(np.array([25.0, 27.0])) == pytest.approx([0.0, 0.12])


def test_the_edge_is_held_outside_the_range():
    model = ThermalModel(25.0, ((20.0, 44.0, (0.5, 0.1)),))
    np.testing.assert_allclose(
        model.bias(np.array([-40.0, 20.0, 44.0, 90.0])), [0.0, 0.0, 2.4, 2.4], atol=1e-15
    )
    np.testing.assert_allclose(model.change([0.0, 90.0]), [-0.5, 1.9])


@settings(max_examples=60, deadline=None)
@given(solutions())
def test_model_is_the_fitted_form(case):
    form, offset, solution = case
    t = np.linspace(*SPAN, 301)
    expected = offset + form.columns(t, SPAN) @ solution
    model = model_of(case)
    # A jump of 0.2 °C has coefficients of 1e8 about the reference, and loses what they are rounded by.
    rounding = 1e-15 * max(abs(c) for segment in model.segments for c in segment[2])
    np.testing.assert_allclose(model.bias(t), expected, atol=1e-8 + rounding)


@settings(max_examples=60, deadline=None)
@given(solutions())
def test_segments_meet(case):
    model = model_of(case)
    assert model.range == SPAN
    pieces = zip(model.segments, model.segments[1:], strict=False)
    for (_, border, left), (low, _, right) in pieces:
        assert border == low
        at = border - model.reference
        assert polyval(at, left) == pytest.approx(polyval(at, right), rel=1e-9, abs=1e-7)


@settings(max_examples=60, deadline=None)
@given(solutions(), st.floats(0.1, 1000))
def test_the_value_is_held_beyond_either_end(case, beyond):
    model = model_of(case)
    low, high = SPAN
    np.testing.assert_array_equal(
        model.bias(np.array([low - beyond, high + beyond])), model.bias(np.array([low, high]))
    )


@settings(max_examples=60, deadline=None)
@given(solutions())
def test_results_round_trip(case):
    model = model_of(case)
    text = json.dumps(model.to_results(), allow_nan=False)
    assert ThermalModel.from_results(json.loads(text)) == model


def test_results_of_a_polynomial():
    assert ThermalModel(25.0, ((20.0, 44.0, (0.5, 0.1, 0.0)),)).to_results() == {
        "model": "polynomial",
        "degree": 2,
        "coefficients": [0.5, 0.1, 0.0],
        "reference_temperature": 25.0,
        "temperature_unit": "degC",
        "range": [20.0, 44.0],
    }


def test_results_of_a_jump():
    model = Form(0, (24.0, 25.0)).model(1.0, np.array([2.0]), SPAN, REFERENCE)
    results = model.to_results()
    assert results["model"] == "piecewise"
    assert results["range"] == list(SPAN)
    assert [s["range"] for s in results["segments"]] == [[10.0, 24.0], [24.0, 25.0], [25.0, 50.0]]
    assert "coefficients" not in results
    assert results["segments"][0]["coefficients"] == [1.0]
    assert results["segments"][2]["coefficients"] == [3.0]


def test_no_change_at_the_reference():
    for form, solution in ((Form(2), [1.0, 2.0]), (Form(1, (29.0, 31.0)), [1.0, 2.0, 3.0])):
        model = form.model(5.0, np.array(solution), SPAN, REFERENCE)
        assert model.change(np.array([REFERENCE]))[0] == 0.0


@settings(max_examples=30, deadline=None)
@given(left=sizes, step=sizes, slope=sizes)
def test_size_of_a_jump(left, step, slope):
    # The same slope on both sides of 24 … 25 °C: the jump is what is left when both are extended.
    low, high = 24.0, 25.0
    model = ThermalModel(
        REFERENCE,
        (
            (10.0, low, (left, slope)),
            (low, high, (0.0,)),
            (high, 50.0, (left + step, slope)),
        ),
    )
    assert model.jump() == pytest.approx(step, abs=1e-9)


def test_the_join_is_level_at_both_ends():
    model = Form(0, (24.0, 26.0)).model(0.0, np.array([1.0]), SPAN, REFERENCE)
    t = np.array([24.0, 24.0 + 1e-5, 25.0, 26.0 - 1e-5, 26.0])
    np.testing.assert_allclose(model.bias(t), [0, 0, 0.5, 1, 1], atol=1e-9)
