"""The deterministic error model and its inverse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sensorbook.calibration import ErrorModel

small = st.floats(-0.1, 0.1)
values = hnp.arrays(float, (7, 3), elements=st.floats(-200, 200))


@given(
    hnp.arrays(float, (3, 3), elements=small),
    hnp.arrays(float, 3, elements=small),
    hnp.arrays(float, (3, 3), elements=small),
    values,
    values,
)
def test_correct_inverts_distort_exactly(off, bias, g, true, acceleration):
    model = ErrorModel(np.eye(3) + off, bias, g)
    raw = model.distort(true, acceleration)
    # Rounding of numbers up to 200, through a matrix of condition below 2.
    np.testing.assert_allclose(model.correct(raw, acceleration), true, rtol=0, atol=1e-12)


def test_a_reading_by_hand():
    """A 5.2 with numbers that can be checked on paper; three sensitivities are a diagonal."""
    model = ErrorModel([[1.1, 0.2, 0], [0, 0.9, 0], [0, 0, 1]], [1, 2, 3], [0.1, 0, 0])
    raw = model.distort(np.array([[1.0, 1.0, 1.0]]), np.array([[10.0, 10.0, 10.0]]))
    np.testing.assert_allclose(raw, [[1.1 + 0.2 + 1 + 1, 2.9, 4]], rtol=1e-15)
    np.testing.assert_allclose(model.scale_factor_errors, [0.1, -0.1, 0], atol=1e-15)


def test_without_acceleration_its_term_is_left_out():
    model = ErrorModel(np.eye(3), np.zeros(3), [1, 1, 1])
    np.testing.assert_array_equal(model.correct(np.ones((2, 3))), np.ones((2, 3)))


@pytest.mark.parametrize(
    ("matrix", "bias"), [(np.eye(2), np.zeros(3)), (np.eye(3), [0, np.nan, 0])]
)
def test_what_is_no_model_is_refused(matrix, bias):
    with pytest.raises(ValueError, match="is not a finite array of shape"):
        ErrorModel(matrix, bias)


def test_from_results():
    entry = {"matrix": np.diag([2.0, 1, 1]).tolist(), "bias": [1, 0, 0], "g_sensitivity": None}
    model = ErrorModel.from_results(entry)
    np.testing.assert_array_equal(model.correct(np.array([[5.0, 0, 0]])), [[2.0, 0, 0]])
