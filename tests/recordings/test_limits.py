"""[spec] of a magnetometer's calibration, and its recordings kept for checking."""

import tomllib

import pytest

from sensorbook.recordings.schema import check_declaration

ROTATION = """
[[recording]]
sensor = "magnetometer"
kind = "rotation"
file = "a.csv"
unit = "uT"
columns = { x = 0, y = 1, z = 2 }
"""


def problems(text):
    found, recordings = check_declaration(tomllib.loads('schema = 1\nid = "a"\n' + text))
    return [f"{p.where}: {p.message} — {p.mend}" for p in (*found, *recordings[0].problems)]


@pytest.mark.parametrize("limit", [
    "residual_percent = { max = 1 }",
    "residual_percent_check = { max = 1 }",
    'residual_percent = { max = 0.01, unit = "1" }',
    "coverage_percent = { min = 90 }",
    "heading_error_after_deg = { max = 0.5 }",
    'heading_error_after_deg = { max = 0.01, unit = "rad" }',
    'hard_iron = { max = 300, unit = "mG" }',
    'soft_iron = { max = 5, unit = "percent" }',
    'field = { min = 45, max = 50, unit = "uT" }',
])  # fmt: skip
def test_limits_of_a_magnetometer(limit):
    assert problems(f"[spec.magnetometer]\n{limit}\n{ROTATION}") == []


@pytest.mark.parametrize(("limit", "words"), [
    ("hard_iron = { max = 300 }",
     'spec.magnetometer.hard_iron.unit: is missing — write unit = "T" or another unit of it'),
    ("soft_iron = { max = 0.1 }",
     'spec.magnetometer.soft_iron.unit: is missing — write unit = "1" or another unit of it'),
    ('coverage_percent = { min = 90, unit = "deg" }',
     "spec.magnetometer.coverage_percent.unit: 'deg' is an angle, not a ratio — "
     "write a ratio such as percent, ppm or 1"),
    ("covrage_percent = { min = 90 }",
     "spec.magnetometer.covrage_percent: is not a quantity with a limit — did you mean 'coverage_percent'?"),
])  # fmt: skip
def test_limits_that_are_none(limit, words):
    assert problems(f"[spec.magnetometer]\n{limit}\n{ROTATION}") == [words]


def test_a_magnetometers_limits_are_no_gyroscopes():
    (line,) = problems(f"[spec.gyroscope]\ncoverage_percent = {{ min = 90 }}\n{ROTATION}")
    assert line.startswith("spec.gyroscope.coverage_percent: is not a quantity with a limit")


def test_a_rotation_may_be_kept_for_checking():
    assert problems(ROTATION + "check = true\n") == []
