"""Calibrations as YAML and C: the numbers of results.json bit for bit, and comments that stay comments."""

import json
import math
import re
import shutil
import subprocess

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook import InputError, cli
from sensorbook.calibration.model import ErrorModel
from sensorbook.export import export
from sensorbook.export.calibration import inert
from sensorbook.reporting.results import SCHEMA
from sensorbook.thermal import ThermalModel

FLAGS = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
COMPILERS = {"c": ["gcc", "-std=c99", *FLAGS], "cpp": ["g++", "-std=c++11", *FLAGS]}
AGAIN = "render it again with: sensorbook report"
POSITIONS = 'record rests in many attitudes (kind = "positions") and render the report'

# Chosen without a pattern, of both signs, with exponents that YAML 1.1 is known to take for text.
BIAS = [1e-05, -0.06635361888319467, 2e-300]
MATRIX = [[1.0009, -0.009, -1e-07], [-0.0054, 0.9975, 0.0317], [-0.0158, 0.0226, 0.9976]]
LOWER = [[0.99976, 0.0, 0.0], [0.0035386, 0.99415, 0.0], [0.009233, 0.021336, 0.99991]]
G = [[1e-05, 6e-05, 1.4e-4], [-2.8e-4, 1.1e-05, 1.7e-4], [-1.5e-4, -1.7e-4, 4.9e-05]]
STD = [[1e-4, 0, 0], [2e-4, 3e-4, 0], [4e-4, 5e-4, 6e-4]]
CHANGE = {  # with temperature
    "degree": 2,
    "range": [10.0, 45.5],
    "temperature_unit": "degC",
    "matrix_coefficients": [np.diag([1e-05, -2e-05, 3e-05]).tolist(), [[1e-07] * 3] * 3],
    "bias_coefficients": [[1e-3, -2e-3, 3e-3], [-1e-05, 2e-05, 0]],
}
PLAIN = ThermalModel(21.5, ((5.0, 60.0, (-3.0, 1e-05, -2e-07)),))
JUMP = ThermalModel(  # three powers, then four, then two
    30.0, ((10.0, 20.0, (7.0, 0.1, 0.02)), (20.0, 25.0, (9.0, 1.0, 0.3, 0.04)), (25.0, 40, (5, -1)))
)


def thermal(model):
    return {**model.to_results(), "rms_before": 1.0, "rms_after": 0.1}


def results():
    """A results.json such as a report writes."""
    gyroscope = {
        "method": "rest_to_rest",
        "matrix": MATRIX,
        "bias": BIAS,
        "g_sensitivity": G,
        "std": {"matrix": STD, "bias": [1e-05, 2e-05, 3e-05], "g_sensitivity": STD},
        "interval_factor": 2.0261924630291097,
        "covariance": [],
        "gravity": 9.798822170410721,
        "unit": "rad/s",
        "reference_temperature": None,
        "temperature_unit": "degC",
        "temperature": None,
    }
    accelerometer = gyroscope | {
        "method": "multi_position",
        "matrix": LOWER,
        "g_sensitivity": None,
        "std": {"matrix": STD, "bias": [0.0, 1e-3, 1e-3]},
        "gravity_source": "normal gravity (WGS 84) at 39.89° N, 900 m",
        "unit": "m/s^2",
        "reference_temperature": 22.1,
        "temperature": CHANGE,
    }
    magnetometer = {
        "method": "ellipsoid",
        "hard_iron": [1.2e-05, -3e-06, 4e-05],
        "soft_iron": [[1.1, 0.01, 0], [0.01, 0.9, 0], [0, 0, 1]],
        "field": 4.8e-05,
        "unit": "T",
    }
    jump, plain = thermal(JUMP), thermal(PLAIN)
    return {
        "schema": 1,
        "device": {"id": "imu-7.b", "name": "An IMU", "model": None, "serial": None},
        "software": {"sensorbook": "0.1.0", "python": "3.11.7", "numpy": "2.0", "scipy": "1.13"},
        "created": "2024-05-01T12:00:00+00:00",
        "inputs": [],
        "sensors": {
            "gyroscope": {"calibration": gyroscope, "thermal": {"x": plain, "y": jump, "z": None}},
            "accelerometer": {"calibration": accelerometer},
            "magnetometer": {"calibration": magnetometer},
        },
        "checks": [],
        "warnings": [],
        "chapters": [],
        "problems": [],
    }


def expected():
    """What both formats hold of `results()`, by sensor and name."""
    ranges = [[10.0, 20.0], [20.0, 25.0], [25.0, 40.0]]
    return {
        "gyroscope": {
            "bias": BIAS,
            "matrix": MATRIX,
            "inverse_matrix": np.linalg.inv(MATRIX).tolist(),
            "g_sensitivity": G,
            "bias_std": [1e-05, 2e-05, 3e-05],
            "matrix_std": STD,
            "g_sensitivity_std": STD,
            "thermal_x_reference_temperature": 21.5,
            "thermal_x_ranges": [[5.0, 60.0]],
            "thermal_x_coefficients": [[-3.0, 1e-05, -2e-07]],
            "thermal_y_reference_temperature": 30.0,
            "thermal_y_ranges": ranges,
            "thermal_y_coefficients": [[7, 0.1, 0.02, 0], [9, 1, 0.3, 0.04], [5, -1, 0, 0]],
        },
        "accelerometer": {
            "bias": BIAS,
            "matrix": LOWER,
            "inverse_matrix": np.linalg.inv(LOWER).tolist(),
            "bias_std": [0.0, 1e-3, 1e-3],
            "matrix_std": STD,
            "reference_temperature": 22.1,
            "temperature_range": [10.0, 45.5],
            "bias_coefficients": CHANGE["bias_coefficients"],
            "matrix_coefficients": CHANGE["matrix_coefficients"],
        },
        "magnetometer": {
            "hard_iron": [1.2e-05, -3e-06, 4e-05],
            "soft_iron": [[1.1, 0.01, 0], [0.01, 0.9, 0], [0, 0, 1]],
            "field": 4.8e-05,
        },
    }


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("export") / "results.json"


@pytest.fixture(scope="module")
def exported(file):
    """Writes results, which a function may change first, and exports them."""

    def run(name, change=lambda r: None):
        found = results()
        change(found)
        file.write_text(json.dumps(found))
        return export(file, name)

    return run


def program(tmp_path, header, language, body):
    """The numbers that a C or C++ program prints; `header` is included twice, as headers may be."""
    command = COMPILERS[language]
    if shutil.which(command[0]) is None:
        pytest.skip(f"no {command[0]} here: the header is not compiled")
    (tmp_path / "device.h").write_text(header)
    include = '#include "device.h"\n'
    source = tmp_path / f"main.{language}"
    source.write_text(
        f"#include <stdio.h>\n{include}{include}int main(void)\n{{\n{body}    return 0;\n}}\n"
    )
    built = subprocess.run(
        [*command, str(source), "-o", str(tmp_path / "main")], capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    run = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, check=True)
    return [float(line) for line in run.stdout.split()]


def printed(name, numbers):
    """C statements that print every number of an array, row by row."""
    shape = np.shape(numbers)
    return "".join(
        f'    printf("%.17g\\n", {name}{"".join(f"[{i}]" for i in index)});\n'
        for index in np.ndindex(*shape)
    )


def test_these_results_are_valid():
    jsonschema.validate(results(), json.loads(SCHEMA.read_text()))


# ---- the numbers ----


def test_yaml_has_the_numbers_of_the_results(exported):
    assert yaml.safe_load(exported("yaml")) == {"device": "imu-7.b"} | expected()


@pytest.mark.parametrize("language", ["c", "cpp"])
def test_the_header_has_the_numbers_of_the_results(language, exported, tmp_path):
    header = exported("c-header")
    body, numbers = "", []
    for sensor, values in expected().items():
        for name, value in values.items():
            body += printed(f"sensorbook_imu_7_b_{sensor}_{name}", value)
            numbers += np.ravel(value).tolist()
    assert program(tmp_path, header, language, body) == numbers
    count = sum(map(len, expected().values()))
    assert len(re.findall(r"^static const double ", header, re.M)) == count


@settings(max_examples=100, deadline=None)
@given(
    bias=st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    off=st.lists(st.floats(-0.1, 0.1), min_size=9, max_size=9),
)
def test_every_float_reads_back(bias, off, exported):
    matrix = (np.eye(3) + np.reshape(off, (3, 3))).tolist()

    def change(r):
        r["sensors"]["gyroscope"]["calibration"].update(bias=bias, matrix=matrix)

    read = yaml.safe_load(exported("yaml", change))["gyroscope"]
    assert (read["bias"], read["matrix"]) == (bias, matrix)
    # rows of |off| <= 0.3 in sum: condition below 2, so that rounding stays near 1e-16
    np.testing.assert_allclose(np.array(read["inverse_matrix"]) @ matrix, np.eye(3), atol=1e-14)


def test_a_diagonal_sensitivity_becomes_a_matrix(exported):
    def change(r):
        found = r["sensors"]["gyroscope"]["calibration"]
        found["g_sensitivity"] = [1e-05, -2e-05, 3e-05]
        found["std"]["g_sensitivity"] = [1e-06, 2e-06, 3e-06]

    read = yaml.safe_load(exported("yaml", change))["gyroscope"]
    assert read["g_sensitivity"] == np.diag([1e-05, -2e-05, 3e-05]).tolist()
    assert read["g_sensitivity_std"] == np.diag([1e-06, 2e-06, 3e-06]).tolist()


def test_a_sensitivity_that_is_not_visible_is_said(exported, tmp_path):
    def change(r):
        r["sensors"]["gyroscope"]["calibration"]["g_sensitivity"] = None

    text = exported("yaml", change)
    assert not [k for k in yaml.safe_load(text)["gyroscope"] if k.startswith("g_sensitivity")]
    assert "# Sensitivity to acceleration: not visible.\n" in text
    header = exported("c-header", change)
    assert "gyroscope_correct(const double raw[3], double out[3])" in header
    assert program(tmp_path, header, "c", "") == []


def test_a_calibration_without_errors_and_extras(exported):
    def change(r):
        r["sensors"] = {
            "accelerometer": {
                "calibration": {
                    "method": "six_position", "matrix": MATRIX, "bias": BIAS, "unit": "m/s^2"
                }
            }
        }  # fmt: skip

    read = yaml.safe_load(exported("yaml", change))
    assert list(read) == ["device", "accelerometer"]
    assert list(read["accelerometer"]) == ["bias", "matrix", "inverse_matrix"]


# ---- what the comments say holds ----


@pytest.mark.parametrize("language", ["c", "cpp"])
def test_the_functions_correct_as_the_library_does(language, exported, tmp_path):
    rng = np.random.default_rng(20240501)
    a, w, m = rng.normal(0, 10, 3), rng.normal(0, 1, 3), rng.normal(0, 5e-05, 3)
    found = {s: v["calibration"] for s, v in results()["sensors"].items()}
    prefix = "    sensorbook_imu_7_b"

    def array(name, values):
        return f"    double {name}[3] = {{{', '.join(repr(float(v)) for v in values)}}};\n"

    body = array("a", a) + array("w", w) + array("m", m)
    body += f"{prefix}_accelerometer_correct(a, a);\n"  # in place
    body += f"{prefix}_gyroscope_correct(w, a, w);\n{prefix}_magnetometer_correct(m, m);\n"
    body += printed("a", a) + printed("w", w) + printed("m", m)
    got = np.reshape(program(tmp_path, exported("c-header"), language, body), (3, 3))
    acceleration = ErrorModel.from_results(found["accelerometer"]).correct(a[None])
    rate = ErrorModel.from_results(found["gyroscope"]).correct(w[None], acceleration)
    iron = found["magnetometer"]
    field = np.array(iron["soft_iron"]) @ (m - iron["hard_iron"])
    # An inverse and a solution of well-conditioned equations differ in the last digits alone.
    np.testing.assert_allclose(got[0], acceleration[0], rtol=1e-13)
    np.testing.assert_allclose(got[1], rate[0], rtol=1e-13)
    np.testing.assert_allclose(got[2], field, rtol=1e-13)


@pytest.mark.parametrize(("axis", "model"), [("x", PLAIN), ("y", JUMP)])
@pytest.mark.parametrize("t", [-20.0, 5.0, 12.0, 22.0, 24.99, 30.0, 39.0, 80.0])
def test_the_thermal_model_is_as_said(t, axis, model, exported):
    read = yaml.safe_load(exported("yaml"))["gyroscope"]
    reference, ranges, coefficients = (
        read[f"thermal_{axis}_{name}"] for name in ("reference_temperature", "ranges", "coefficients")
    )  # fmt: skip

    def b(t):
        t = min(max(t, ranges[0][0]), ranges[-1][1])
        i = next(i for i, (low, high) in enumerate(ranges) if low <= t <= high)
        return sum(c * (t - reference) ** k for k, c in enumerate(coefficients[i]))

    change = model.change(np.array([t]))[0]
    # Values of up to some hundreds are summed in another order.
    assert b(t) - b(reference) == pytest.approx(change, rel=0, abs=1e-12)


TOLD = [
    "Calibration of the device imu-7.b (An IMU).",
    "Results of 2024-05-01T12:00:00+00:00; sensorbook 0.1.0, python 3.11.7, numpy 2.0, scipy 1.13.",
    "Units are SI, temperatures in degC. Axes are those of the recordings, in the order x, y, z.",
    "Method: rest_to_rest.",
    "Gravity: 9.798822170410721 m/s^2.",
    "Gravity: 9.798822170410721 m/s^2 (normal gravity (WGS 84) at 39.89 deg N, 900 m).",
    "raw = matrix * true + bias + g_sensitivity * acceleration",
    "true = inverse_matrix * (raw - bias - g_sensitivity * acceleration)",
    "true = inverse_matrix * (raw - bias)",
    "true = soft_iron * (raw - hard_iron)",
    "Thermal model of axis z: none.",
    "bias(T) alike; outside temperature_range the values at its edge hold.",
]
UNITS = [
    "rad/s, reading where the true vector is zero",
    "m/s^2, reading where the true vector is zero",
    "rad/s per m/s^2, added to a reading",
    "rad/s; the 95 % interval is value +- 2.026 std",
    "T, subtracted from a reading",
    "degC, at which matrix and bias hold",
]


@pytest.mark.parametrize(("name", "opens"), [("yaml", "# "), ("c-header", " * ")])
def test_conventions_and_units_stand_in_comments(name, opens, exported):
    text = exported(name)
    lines = text.splitlines()
    for line in TOLD:
        assert f"{opens}{line}" in lines
    for unit in UNITS:
        assert (f"  # {unit}" if name == "yaml" else f"/* {unit} */") in text
    assert text.isascii()


# ---- names that try to leave their comment ----

NASTY = ["a */ int evil; /*", "*//*", "a\n#error b", "??/", "b\\", "\x85c: 1", "a\u2028b: 1",
         "{device}", "\x00\x1b", "%n°²", "\ud800"]  # fmt: skip


@settings(max_examples=500, deadline=None)
@given(text=st.text(st.one_of(st.characters(), st.sampled_from("*/?\\\n#"))))
def test_what_is_inert(text):
    line = inert(text)
    assert all(" " <= c <= "~" for c in line)
    assert not {"*/", "/*", "??"} & {line[i : i + 2] for i in range(len(line))}


def named(nasty):
    def change(r):
        r["device"]["name"] = nasty
        r["created"] = nasty
        r["software"]["numpy"] = nasty
        r["sensors"]["accelerometer"]["calibration"].update(method=nasty, gravity_source=nasty)
        r["sensors"]["gyroscope"]["thermal"] = {"reason": nasty}
        r["sensors"]["magnetometer"]["calibration"] = {"method": None, "reason": nasty}

    return change


def plain():
    values = expected()
    del values["magnetometer"]
    values["gyroscope"] = {
        k: v for k, v in values["gyroscope"].items() if not k.startswith("thermal")
    }
    return {"device": "imu-7.b"} | values


@settings(max_examples=100, deadline=None)
@given(nasty=st.one_of(st.text(st.characters()), st.sampled_from(NASTY)))
def test_no_text_breaks_out_of_yaml(nasty, exported):
    assert yaml.safe_load(exported("yaml", named(nasty))) == plain()


@pytest.mark.parametrize("language", ["c", "cpp"])
def test_no_text_breaks_out_of_the_header(language, exported, tmp_path):
    header = exported("c-header", named("".join(NASTY)))
    body = printed("sensorbook_imu_7_b_gyroscope_bias", BIAS)
    assert program(tmp_path, header, language, body) == BIAS
    for nasty in NASTY:  # each by itself, with what stands before and after it in its line
        other = exported("c-header", named(nasty))
        assert code(other) == code(header)


def code(header):
    """The header without its comments, which end at the first */ as in C."""
    return re.sub(r"/\*.*?\*/", "", header, flags=re.S)


@pytest.mark.parametrize(
    ("id", "identifier"),
    [
        ("imu-7", "imu_7"),
        ("7.b--c_", "7_b_c"),
        ("int", "int"),
        ("a\n#error", "a_error"),
        ("*/ é", "xe9"),
        ("*/", "device"),
        ("", "device"),
    ],
)
def test_identifiers(id, identifier, exported, tmp_path):
    header = exported("c-header", lambda r: r["device"].update(id=id))
    guard = f"SENSORBOOK_{identifier.upper()}_H"
    assert f"#ifndef {guard}\n#define {guard}\n" in header
    body = printed(f"sensorbook_{identifier}_gyroscope_bias", BIAS)
    assert program(tmp_path, header, "c", body) == BIAS
    assert program(tmp_path, header, "cpp", body) == BIAS
    read = yaml.safe_load(exported("yaml", lambda r: r["device"].update(id=id)))
    assert read["device"] == inert(id)


# ---- what was refused, and what is wrong ----


@pytest.mark.parametrize("name", ["yaml", "c-header"])
def test_a_refused_calibration_is_a_comment_without_numbers(name, exported):
    def change(r):
        refused = {
            "method": None,
            "reason": "Five attitudes\ncannot tell.",
            "bias": [7.5, 7.5, 7.5],
        }
        r["sensors"]["gyroscope"] = {"calibration": refused}

    text = exported(name, change)
    assert "Calibration refused: Five attitudes cannot tell.\n" in text
    assert "7.5" not in text
    assert "gyroscope_" not in text
    if name == "yaml":
        assert list(yaml.safe_load(text)) == ["device", "accelerometer", "magnetometer"]


@pytest.mark.parametrize("name", ["yaml", "c-header"])
def test_a_thermal_model_alone(name, exported, tmp_path):
    def change(r):
        r["sensors"] = {"gyroscope": {"thermal": r["sensors"]["gyroscope"]["thermal"]}}

    text = exported(name, change)
    if name == "yaml":
        keys = yaml.safe_load(text)["gyroscope"]
        assert len(keys) == 6
        assert all(key.startswith("thermal_") for key in keys)
    else:
        assert "_correct" not in text
        assert program(tmp_path, text, "c", "") == []


def said(exported, change, name="yaml"):
    with pytest.raises(InputError) as caught:
        exported(name, change)
    return [line.split("results.json: ", 1)[1] for line in str(caught.value).splitlines()]


@pytest.mark.parametrize("name", ["yaml", "c-header"])
@pytest.mark.parametrize("sensors", [{}, {"gyroscope": {"noise": {"reason": "too short"}}}])
def test_nothing_to_export_says_what_to_record(name, sensors, exported):
    assert said(exported, lambda r: r.update(sensors=sensors), name) == [
        f"sensors: no sensor has a calibration or a thermal model — {POSITIONS}"
    ]


def test_nothing_but_refusals(exported):
    refused = {"method": None, "reason": "Five\nattitudes."}

    def change(r):
        r["sensors"] = {
            "gyroscope": {"thermal": {"reason": "Only 1 degC."}},
            "accelerometer": {"calibration": refused},
            "magnetometer": {"calibration": refused},
        }

    assert said(exported, change) == [
        "sensors.gyroscope.thermal: was refused: Only 1 degC. — record a rest through a sweep of "
        'temperature (kind = "thermal") and render the report',
        f"sensors.accelerometer.calibration: was refused: Five attitudes. — {POSITIONS}",
        "sensors.magnetometer.calibration: was refused: Five attitudes. — record it turned freely "
        '(kind = "rotation") and render the report',
    ]


C = "sensors.gyroscope.calibration"


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ({"matrix": None}, f"{C}.matrix: None is not a list"),
        ({"matrix": MATRIX[:2]}, f"{C}.matrix: has 2 entries, not 3"),
        ({"matrix": [[1, 0], [0, 1], [0, 0]]}, f"{C}.matrix[0]: has 2 entries, not 3"),
        ({"matrix": np.ones((3, 3)).tolist()}, f"{C}.matrix: has no inverse"),
        ({"bias": [0, "1; system()", 0]}, f"{C}.bias[1]: '1; system()' is not a finite number"),
        ({"bias": [0, math.nan, 0]}, f"{C}.bias[1]: nan is not a finite number"),
        ({"bias": [0, 0, -math.inf]}, f"{C}.bias[2]: -inf is not a finite number"),
        ({"bias": [True, 0, 0]}, f"{C}.bias[0]: True is not a finite number"),
        ({"unit": "deg/s"}, f"{C}.unit: 'deg/s' is not 'rad/s'"),
        ({"method": None}, f"{C}.method: None is not text"),
        ({"gravity": "g"}, f"{C}.gravity: 'g' is not a finite number"),
        ({"g_sensitivity": [[1, 2, 3]]}, f"{C}.g_sensitivity: has 1 entries, not 3"),
        ({"g_sensitivity": "none"}, f"{C}.g_sensitivity: 'none' is not a list"),
        ({"std": {"bias": [0, -1, 0]}}, f"{C}.std.bias: holds a standard error below 0"),
        ({"std": []}, f"{C}.std: [] is not an object"),
        ({"interval_factor": -2}, f"{C}.interval_factor: -2 is not a finite number from 0"),
        ({"temperature": CHANGE}, f"{C}.reference_temperature: None is not a finite number"),
        (
            {"reference_temperature": 20, "temperature_unit": "degF"},
            f"{C}.temperature_unit: 'degF' is not 'degC'",
        ),
        (
            {"reference_temperature": 20, "temperature": CHANGE | {"range": [40, 10]}},
            f"{C}.temperature.range: ends below its start",
        ),
        (
            {"reference_temperature": 20, "temperature": CHANGE | {"bias_coefficients": []}},
            f"{C}.temperature.bias_coefficients: is empty",
        ),
        (
            {
                "reference_temperature": 20,
                "temperature": CHANGE | {"matrix_coefficients": [MATRIX]},
            },
            f"{C}.temperature.matrix_coefficients: has 1 entries, not 2",
        ),
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["yaml", "c-header"])
def test_what_is_wrong_is_one_line_with_its_key(name, entry, line, exported):
    def change(r):
        r["sensors"]["gyroscope"]["calibration"].update(entry)

    assert said(exported, change, name) == [f"{line} — {AGAIN}"]


T = "sensors.gyroscope.thermal"


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ({"coefficients": []}, f"{T}.x.coefficients: is empty"),
        ({"coefficients": [1, None]}, f"{T}.x.coefficients[1]: None is not a finite number"),
        ({"temperature_unit": "K"}, f"{T}.x.temperature_unit: 'K' is not 'degC'"),
        ({"segments": []}, f"{T}.x.segments: holds no ranges in ascending order"),
        (
            {"segments": [{"range": [20, 30], "coefficients": [1]}] * 2},
            f"{T}.x.segments: holds no ranges in ascending order",
        ),
    ],
)
def test_a_thermal_model_that_is_none(entry, line, exported):
    def change(r):
        r["sensors"]["gyroscope"]["thermal"]["x"].update(entry)

    assert said(exported, change) == [f"{line} — {AGAIN}"]


def test_the_problems_of_every_sensor_are_said(exported):
    def change(r):
        del r["software"]
        r["sensors"]["gyroscope"]["calibration"]["unit"] = 7
        del r["sensors"]["gyroscope"]["thermal"]["y"]
        del r["sensors"]["magnetometer"]["calibration"]["hard_iron"]

    assert said(exported, change) == [
        f"software: is missing — {AGAIN}",
        f"{C}.unit: 7 is not text — {AGAIN}",
        f"{T}.y: is missing — {AGAIN}",
        f"sensors.magnetometer.calibration.hard_iron: is missing — {AGAIN}",
    ]


def test_the_command(tmp_path, capsys):
    source, target = tmp_path / "results.json", tmp_path / "imu.h"
    source.write_text(json.dumps(results()))
    assert cli.main(["export", str(source), "--format", "c-header", "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: written\n"
    assert target.read_text() == export(source, "c-header")
    assert cli.main(["export", str(source), "--format", "yaml"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["device"] == "imu-7.b"
