"""A magnetometer's calibration in four formats: each target's own formula gives the corrected field."""

import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
import yaml
from consumers import read_param, read_params
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sensorbook import InputError, cli
from sensorbook.export import export

FORMATS = ["yaml", "c-header", "ardupilot", "px4"]
AUTOPILOTS = {"ardupilot": "ArduPilot", "px4": "PX4"}
AGAIN = "render it again with: sensorbook report"
TURN = 'record it turned freely (kind = "rotation") and render the report'
C = "sensors.magnetometer.calibration"

HARD_IRON = [1.23456789012345e-05, -3.3e-06, 4.4e-05]
SOFT_IRON = [[1.1, 0.0123, -0.02], [0.0123, 0.93, 1e-05], [-0.02, 1e-05, 1.0 / 3]]
STD = {
    "hard_iron": [1e-08, 2e-08, 3e-08],
    "soft_iron": [[1e-4, 2e-4, 3e-4], [2e-4, 4e-4, 5e-4], [3e-4, 5e-4, 6e-4]],
    "field": 2.5e-08,
}


def results():
    return {
        "schema": 1,
        "device": {"id": "mag-7.b", "name": "A compass", "model": None, "serial": None},
        "software": {"sensorbook": "0.1.0", "python": "3.11.7", "numpy": "2.0", "scipy": "1.13"},
        "created": "2024-05-01T12:00:00+00:00",
        "sensors": {
            "magnetometer": {
                "calibration": {
                    "method": "ellipsoid",
                    "hard_iron": HARD_IRON,
                    "soft_iron": SOFT_IRON,
                    "field": 4.8e-05,
                    "field_source": "IGRF-14 at 39.89° N, 900 m",
                    "residual_percent": 0.4,
                    "residual_percent_check": 0.5,
                    "coverage_percent": 93.0,
                    "unit": "T",
                    "std": STD,
                    "interval_factor": 2.0261924630291097,
                }
            }
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


def calibrated(**changes):
    return lambda r: r["sensors"]["magnetometer"]["calibration"].update(changes)


def said(exported, name, change):
    with pytest.raises(InputError) as caught:
        exported(name, change)
    return [line.split("results.json: ", 1)[1] for line in str(caught.value).splitlines()]


# ---- what the targets do with a file, written anew from their sources ----


def correct_field(text, raw):
    """AP_Compass_Backend::correct_field; raw and result (N, 3) in T, computed in milligauss."""
    p = read_param(text)
    ofs, dia, odi = (
        [p.pop(f"COMPASS_{k}_{axis}") for axis in "XYZ"] for k in ("OFS", "DIA", "ODI")
    )
    scale = p.pop("COMPASS_SCALE")
    assert not p
    mag = raw / 1e-7 + ofs
    if 0.85 <= scale <= 1.3:
        mag = mag * scale
    x, y, z = mag.T
    return 1e-7 * np.stack(
        [
            dia[0] * x + odi[0] * y + odi[1] * z,
            odi[0] * x + dia[1] * y + odi[2] * z,
            odi[1] * x + odi[2] * y + dia[2] * z,
        ],
        axis=1,
    )


def correct_px4(text, raw):
    """calibration::Magnetometer::Correct without rotation; raw and result (N, 3) in T."""
    p = read_params(text)
    off, scale, odiag = (
        [p.pop(f"CAL_MAG0_{axis}{k}") for axis in "XYZ"] for k in ("OFF", "SCALE", "ODIAG")
    )
    assert not p
    matrix = np.diag(scale)
    matrix[0, 1] = matrix[1, 0] = odiag[0]
    matrix[0, 2] = matrix[2, 0] = odiag[1]
    matrix[1, 2] = matrix[2, 1] = odiag[2]
    return 1e-4 * ((raw / 1e-4 - off) @ matrix.T)


def correct_yaml(text, raw):
    found = yaml.safe_load(text)["magnetometer"]
    return (raw - found["hard_iron"]) @ np.transpose(found["soft_iron"])


def correct_c(text, raw, folder):
    """The readings through the header's own function."""
    if shutil.which("gcc") is None:
        pytest.skip("no gcc here: the header is not compiled")
    (folder / "device.h").write_text(text)
    (folder / "main.c").write_text(
        '#include <stdio.h>\n#include "device.h"\n'
        "int main(void)\n{\n    double m[3];\n"
        '    while (scanf("%lf %lf %lf", &m[0], &m[1], &m[2]) == 3) {\n'
        "        sensorbook_mag_7_b_magnetometer_correct(m, m);\n"
        '        printf("%.17g %.17g %.17g\\n", m[0], m[1], m[2]);\n    }\n    return 0;\n}\n'
    )
    program = str(folder / "main")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    built = subprocess.run(
        ["gcc", *flags, str(folder / "main.c"), "-o", program], capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    readings = "\n".join(" ".join(map(repr, row)) for row in raw.tolist())
    run = subprocess.run([program], input=readings, capture_output=True, text=True, check=True)
    return np.array([line.split() for line in run.stdout.splitlines()], dtype=float)


CORRECT = {"yaml": correct_yaml, "ardupilot": correct_field, "px4": correct_px4}
RAW = 5e-5 * np.random.default_rng(20240501).standard_normal((1000, 3))  # T


def assert_corrects(got, hard_iron, soft_iron, raw=RAW):
    """Each reading's corrected field, element by element, relative to the longer of field and offset."""
    expected = np.array([np.array(soft_iron) @ (reading - hard_iron) for reading in raw])
    scale = np.linalg.norm(expected, axis=1, keepdims=True) + np.linalg.norm(hard_iron)
    assert got.shape == expected.shape
    # Some 1e-16 in rounding, of offsets up to a few times the field; wrong digits would be far above.
    assert np.max(np.abs(got - expected) / scale) < 1e-9


@pytest.mark.parametrize("name", sorted(CORRECT))
def test_the_targets_formula_gives_the_corrected_field(name, exported):
    assert_corrects(CORRECT[name](exported(name), RAW), HARD_IRON, SOFT_IRON)


def test_the_headers_function_gives_the_corrected_field(exported, tmp_path):
    assert_corrects(correct_c(exported("c-header"), RAW, tmp_path), HARD_IRON, SOFT_IRON)


@settings(max_examples=200, deadline=None)
@given(
    hard_iron=st.lists(st.floats(-9e-5, 9e-5), min_size=3, max_size=3).filter(
        lambda h: math.hypot(*h) > 1e-13  # ArduPilot takes less for none
    ),
    diagonal=st.lists(st.floats(0.2, 3.0), min_size=3, max_size=3),
    off=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
)
@example(hard_iron=[2e-13, 5e-324, 0], diagonal=[0.2, 3.0, 1.0], off=[-1.0, 1.0, 5e-324])
@pytest.mark.parametrize("name", sorted(CORRECT))
def test_any_calibration(name, hard_iron, diagonal, off, exported):
    soft_iron = np.diag(diagonal)
    soft_iron[np.triu_indices(3, 1)] = off
    soft_iron[np.tril_indices(3, -1)] = soft_iron.T[np.tril_indices(3, -1)]
    change = calibrated(hard_iron=hard_iron, soft_iron=soft_iron.tolist())
    got = CORRECT[name](exported(name, change), RAW[:20])
    assert_corrects(got, hard_iron, soft_iron, RAW[:20])


def test_the_parameters_by_name(exported):
    """Worked by hand: 12 µT is 120 mG and 0.12 G, added with the other sign or subtracted."""
    change = calibrated(
        hard_iron=[1.2e-05, -3e-06, 0.0], soft_iron=[[1.1, 0.12, 0.13], [0.12, 0.9, 0.23], [0.13, 0.23, 1]]
    )  # fmt: skip
    soft = [1.1, 0.9, 1.0, 0.12, 0.13, 0.23]
    found = read_param(exported("ardupilot", change))
    assert list(found) == [
        *(f"COMPASS_{kind}_{axis}" for kind in ("OFS", "DIA", "ODI") for axis in "XYZ"),
        "COMPASS_SCALE",
    ]
    # Of the last digit.
    assert list(found.values()) == pytest.approx([-120.0, 30.0, 0.0, *soft, 1.0], rel=1e-15)
    assert "COMPASS_OFS_Z,0.0\n" in exported("ardupilot", change)  # no negative zero
    found = read_params(exported("px4", change))
    assert list(found) == [
        f"CAL_MAG0_{axis}{kind}" for kind in ("OFF", "SCALE", "ODIAG") for axis in "XYZ"
    ]
    assert list(found.values()) == pytest.approx([0.12, -0.03, 0.0, *soft], rel=1e-15)


def test_rounding_is_no_asymmetry(exported):
    soft_iron = np.array(SOFT_IRON)
    soft_iron[1, 0] += 1e-15
    change = calibrated(soft_iron=soft_iron.tolist())
    for name in AUTOPILOTS:
        assert_corrects(CORRECT[name](exported(name, change), RAW), HARD_IRON, soft_iron)


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_a_calibration_without_field_and_errors(name, exported):
    def change(r):
        r["sensors"]["magnetometer"]["calibration"] = {
            "method": "hard_iron", "hard_iron": HARD_IRON, "soft_iron": np.eye(3).tolist(), "unit": "T"
        }  # fmt: skip

    text = exported(name, change)
    assert "# Magnetometer, method: hard_iron.\n" in text
    assert "Length of a corrected reading" not in text
    assert_corrects(CORRECT[name](text, RAW), HARD_IRON, np.eye(3))


def test_a_field_of_unknown_strength(exported):
    change = calibrated(field_known=False, field_source="")
    relative = "The field's strength is not known: soft_iron is relative, of determinant 1.\n"
    for name in FORMATS:
        assert relative in exported(name, change)
        assert "Field: " not in exported(name, change)
        assert relative not in exported(name, calibrated(field_known=True))
    for known, scale in ((False, 0.0), (True, 1.0)):
        text = exported("ardupilot", calibrated(field_known=known))
        assert read_param(text)["COMPASS_SCALE"] == scale
        assert_corrects(correct_field(text, RAW), HARD_IRON, SOFT_IRON)


def test_standard_errors_and_the_fields_source(exported):
    found = yaml.safe_load(exported("yaml"))["magnetometer"]
    assert found == {
        "hard_iron": HARD_IRON,
        "soft_iron": SOFT_IRON,
        "field": 4.8e-05,
        "hard_iron_std": STD["hard_iron"],
        "soft_iron_std": STD["soft_iron"],
        "field_std": 2.5e-08,
    }
    interval = "; the 95 % interval is value +- 2.026 std"
    for name, opens in (("yaml", "# "), ("c-header", " * ")):
        text = exported(name)
        assert f"{opens}Field: IGRF-14 at 39.89 deg N, 900 m.\n" in text
        assert f"{opens}true = soft_iron * (raw - hard_iron)\n" in text
        assert text.count(f"T{interval}") == 2  # of hard_iron and of field
        assert text.count(f"1{interval}") == 1
    prefix = "static const double sensorbook_mag_7_b_magnetometer"
    assert f"{prefix}_field_std = 2.5e-08;\n" in exported("c-header")
    assert f"{prefix}_hard_iron_std[3] = {{1e-08, 2e-08, 3e-08}};\n" in exported("c-header")
    without = yaml.safe_load(exported("yaml", calibrated(std=None, field=None)))["magnetometer"]
    assert list(without) == ["hard_iron", "soft_iron"]


ANGLE = math.radians(2.0)  # about z
ALIGNMENT = {
    "matrix": [[math.cos(ANGLE), -math.sin(ANGLE), 0.0], [math.sin(ANGLE), math.cos(ANGLE), 0.0],
               [0.0, 0.0, 1.0]],
    "turn_deg": [0.0, 0.0, 2.0], "turn_std_deg": [0.1, 0.1, 0.1],
}  # fmt: skip
TURNED = "transpose(alignment) * corrected is in the accelerometer's."


def test_the_turn_between_the_triads(exported):
    change = calibrated(alignment=ALIGNMENT)
    text = exported("yaml", change)
    assert f"# {TURNED}\n" in text
    assert "  alignment:  # 1, v_magnetometer = alignment * v_accelerometer\n" in text
    matrix = np.array(yaml.safe_load(text)["magnetometer"]["alignment"])
    assert matrix.tolist() == ALIGNMENT["matrix"]
    # x of the accelerometer, as the magnetometer sees it turned, and back as the comment says.
    seen = np.array([math.cos(ANGLE), math.sin(ANGLE), 0.0])
    assert matrix.T @ seen == pytest.approx([1, 0, 0], abs=1e-15)
    header = exported("c-header", change)
    assert f" * {TURNED}\n" in header
    assert "static const double sensorbook_mag_7_b_magnetometer_alignment[3][3] = {" in header
    for name in AUTOPILOTS:
        text = exported(name, change)
        said = " ".join(text.replace("\n# ", " ").split())
        assert (
            "Corrected readings are in the magnetometer's own axes, turned by the rotation vector "
            "(0.00, 0.00, 2.00) degrees from the accelerometer's, which these parameters do not take out."
        ) in said
        assert_corrects(CORRECT[name](text, RAW), HARD_IRON, SOFT_IRON)


@pytest.mark.parametrize("alignment", [None, {"matrix": None, "turn_deg": None}])
@pytest.mark.parametrize("name", FORMATS)
def test_a_turn_that_is_not_known(name, alignment, exported):
    texts = exported(name, calibrated(alignment=alignment)), exported(name)
    one, other = (re.sub(r"sha256\W+\w+", "", text) for text in texts)  # of two results.json
    assert one == other


@pytest.mark.parametrize("name", ["yaml", "c-header"])
def test_an_alignment_that_is_damaged(name, exported):
    lines = said(exported, name, calibrated(alignment=ALIGNMENT | {"matrix": [[1, 0], [0, 1]]}))
    assert len(lines) == 1
    assert lines[0].startswith(f"{C}.alignment.matrix: ")


TOLD = [
    "Calibration of the device mag-7.b (A compass).",
    "Results of 2024-05-01T12:00:00+00:00; sensorbook 0.1.0, python 3.11.7, numpy 2.0, scipy 1.13.",
    "Magnetometer, method: ellipsoid.",
    "Length of a corrected reading: 4.8e-05 T.",
    "Field: IGRF-14 at 39.89 deg N, 900 m.",
    "Of the results: true = soft_iron * (raw - hard_iron).",
    "The offset is subtracted first, then the matrix multiplies the difference; this is not soft_iron * "
    "raw - hard_iron.",
    "Axes are those of the recording, in the order x, y, z",
]
FORMULAS = {
    "ardupilot": [
        "Parameters of ArduPilot's first compass: of the second they are COMPASS_OFS2_X",
        "in milligauss, 1 mG = 1e-7 T: field = M * (COMPASS_SCALE * (raw + COMPASS_OFS))",
        "M = [[DIA_X, ODI_X, ODI_Y], [ODI_X, DIA_Y, ODI_Z], [ODI_Y, ODI_Z, DIA_Z]]",
        "COMPASS_OFS = -hard_iron in milligauss, as ArduPilot adds it; M = soft_iron;",
        "COMPASS_ORIENT (external compass) or AHRS_ORIENTATION (internal) must be 0, none",
    ],
    "px4": [
        "Calibration of PX4's magnetometer 0, CAL_MAG0.",
        "in gauss, 1 G = 1e-4 T: field = rotation * (M * (raw - OFF)), OFF = [XOFF, YOFF, ZOFF]",
        "M = [[XSCALE, XODIAG, YODIAG], [XODIAG, YSCALE, ZODIAG], [YODIAG, ZODIAG, ZSCALE]]",
        "OFF = hard_iron in gauss, as PX4 subtracts it; M = soft_iron.",
        "PX4 corrects first and rotates then",
    ],
}


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_head_says_what_the_numbers_mean(name, exported):
    text = exported(name)
    head = " ".join(line[2:] for line in text.splitlines() if line.startswith("#"))
    for told in (*TOLD, *FORMULAS[name]):
        assert told in head
    assert text.isascii()
    if name == "px4":
        assert text.startswith("# Onboard parameters for Vehicle 1\n")
        assert "# Vehicle-Id Component-Id Name Value Type\n1\t1\tCAL_MAG0_XOFF" in text


def test_a_thermal_model_left_out_is_said(exported):
    def change(r):
        r["sensors"]["magnetometer"]["thermal"] = {"x": None, "y": None, "z": None}

    for name in AUTOPILOTS:
        assert "# The thermal model is not in this file.\n" in exported(name, change)
        assert "thermal" not in exported(name)


# ---- names that try to leave their comment ----

EVIL = {"ardupilot": "COMPASS_OFS_X,9", "px4": "1\t1\tCAL_MAG0_XOFF\t9\t9"}
BREAKS = [
    "\n",
    "\r",
    "\r\n",
    "\v",
    "\f",
    "\x1c",
    "\x85",
    "\u2028",
    "\x00",
    " " * 98,
    "x" * 98,
    "- " * 60,
]


def named(nasty):
    def change(r):
        r["device"].update(id=nasty, name=nasty)
        r["created"] = nasty
        r["software"]["numpy"] = nasty
        r["sensors"]["magnetometer"]["calibration"].update(method=nasty, field_source=nasty)

    return change


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize("before", BREAKS)
def test_no_text_becomes_a_parameter(name, before, exported):
    read = {"ardupilot": read_param, "px4": read_params}[name]
    for shift in range(12 if len(before) > 2 else 1):  # whatever stands before it in its line
        nasty = "a" * 8 * shift + before + EVIL[name] + before + EVIL[name] + "\n" + EVIL[name]
        text = exported(name, named(nasty))
        assert read(text) == read(exported(name))
        lines = text.split("\n")[:-1]
        assert all(line.startswith("#") for line in lines[: -len(read(text))])


@settings(max_examples=200, deadline=None)
@given(nasty=st.text(st.one_of(st.characters(), st.sampled_from("\n\r\t #,=")), max_size=300))
@pytest.mark.parametrize("name", AUTOPILOTS)
def test_any_text_stays_a_comment(name, nasty, exported):
    read = {"ardupilot": read_param, "px4": read_params}[name]
    text = exported(name, named(nasty))
    assert read(text) == read(exported(name))
    assert all(c == "\n" or c == "\t" or " " <= c <= "~" for c in text)
    assert max(map(len, text.split("\n"))) < 98


# ---- what was refused, and what is wrong ----


@pytest.mark.parametrize("name", FORMATS)
def test_a_refused_calibration_is_not_exported(name, exported):
    def change(r):
        refused = {"method": None, "reason": "Only a tenth of\nthe sphere.", "hard_iron": HARD_IRON}
        r["sensors"]["magnetometer"]["calibration"] = refused

    assert said(exported, name, change) == [
        f"{C}: was refused: Only a tenth of the sphere. — {TURN}"
    ]


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize(
    ("sensors", "key"),
    [
        ({}, "sensors.magnetometer"),
        ({"magnetometer": {"noise": {}}}, C),
        ({"magnetometer": {"calibration": None}}, C),
    ],
)
def test_no_calibration(name, sensors, key, exported):
    rests = 'record rests in many attitudes (kind = "positions") and render the report'
    assert said(exported, name, lambda r: r.update(sensors=sensors)) == [
        f"{key}: is missing — {TURN}",
        f"sensors.accelerometer: is missing — {rests}",
        f"sensors.gyroscope: is missing — {rests}",
    ]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("key", ["method", "hard_iron", "soft_iron", "unit"])
def test_a_missing_key(name, key, exported):
    def change(r):
        del r["sensors"]["magnetometer"]["calibration"][key]

    if (
        name in AUTOPILOTS or key != "soft_iron"
    ):  # without it, a calibration is one by bias and matrix
        assert said(exported, name, change) == [f"{C}.{key}: is missing — {AGAIN}"]
    else:
        assert said(exported, name, change) == [f"{C}.matrix: is missing — {AGAIN}"]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ({"hard_iron": [0, 1]}, f"{C}.hard_iron: has 2 entries, not 3"),
        ({"hard_iron": [0, math.nan, 0]}, f"{C}.hard_iron[1]: nan is not a finite number"),
        ({"hard_iron": [0, "1\n2", 0]}, f"{C}.hard_iron[1]: '1\\n2' is not a finite number"),
        ({"soft_iron": [[1, 0], [0, 1]]}, f"{C}.soft_iron: has 2 entries, not 3"),
        (
            {"soft_iron": [[1, 0, 0], [0, 1, 0], [0, 0, math.inf]]},
            f"{C}.soft_iron[2][2]: inf is not a finite number",
        ),
        ({"unit": "uT"}, f"{C}.unit: 'uT' is not 'T'"),
        ({"field": "much"}, f"{C}.field: 'much' is not a finite number"),
        ({"field_source": 7}, f"{C}.field_source: 7 is not text"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_key(name, entry, line, exported):
    assert said(exported, name, calibrated(**entry)) == [f"{line} — {AGAIN}"]


@pytest.mark.parametrize(
    ("std", "line"),
    [
        ({"hard_iron": [1e-8, -1e-8, 0]}, "hard_iron: holds a standard error below 0"),
        ({"soft_iron": [[1, 2, 3]]}, "soft_iron: has 1 entries, not 3"),
        ({"field": -1e-8}, "field: holds a standard error below 0"),
        ({"field": [1e-8]}, "field: [1e-08] is not a finite number"),
    ],
)
def test_standard_errors_that_are_none(std, line, exported):
    assert said(exported, "yaml", calibrated(std=std)) == [f"{C}.std.{line} — {AGAIN}"]


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_a_matrix_that_is_not_symmetric(name, exported):
    soft_iron = [[1.1, 0.01, -0.02], [0.01, 0.9, 0.0], [0.03, 0.0, 1.0]]
    assert said(exported, name, calibrated(soft_iron=soft_iron)) == [
        f"{C}.soft_iron: is not symmetric ([0][2] is -0.02, [2][0] is 0.03), and {AUTOPILOTS[name]} "
        "holds no other — export it as yaml or c-header"
    ]


CHECK = "check unit and scale of the recording and its [site], and render the report again"


@pytest.mark.parametrize(
    ("name", "low", "high", "parameter"),
    [("ardupilot", 0.2, 5, "COMPASS_DIA_Y"), ("px4", 0.1, 3, "CAL_MAG0_YSCALE")],
)
def test_scales_out_of_range(name, low, high, parameter, exported):
    for value in (np.nextafter(low, 0), -1.0, 0.0, np.nextafter(high, 9), 1e30):
        change = calibrated(soft_iron=np.diag([1.0, value, 1.0]).tolist())
        assert said(exported, name, change) == [
            f"{C}.soft_iron[1][1]: {parameter} would be {float(value)!r}, and {AUTOPILOTS[name]} accepts "
            f"{low} to {high} — {CHECK}"
        ]
    for value in (low, high):
        change = calibrated(soft_iron=np.diag([1.0, value, 1.0]).tolist())
        assert f"{parameter}{',' if name == 'ardupilot' else chr(9)}{float(value)!r}" in exported(
            name, change
        )


def test_off_diagonals_out_of_range(exported):
    soft_iron = [[1.0, 0.0, 1.5], [0.0, 1.0, 0.0], [1.5, 0.0, 1.0]]
    assert said(exported, "ardupilot", calibrated(soft_iron=soft_iron)) == [
        f"{C}.soft_iron[0][2]: COMPASS_ODI_Y would be 1.5, and ArduPilot accepts -1 to 1 — {CHECK}"
    ]
    assert read_params(exported("px4", calibrated(soft_iron=soft_iron)))["CAL_MAG0_YODIAG"] == 1.5


def test_offsets_out_of_range(exported):
    away = "move the magnetometer away from magnets and iron, and record it again"
    assert said(exported, "ardupilot", calibrated(hard_iron=[1.2e-4, 1.2e-4, 8e-5])) == [
        f"{C}.hard_iron: is 1876.17 mG long, and ArduPilot does not arm above 1800 mG "
        f"(COMPASS_OFFS_MAX) — {away}"
    ]
    assert read_param(exported("ardupilot", calibrated(hard_iron=[0, 1.79e-4, 0])))
    for length, nothing in (("0", -0.0), ("1.1e-07", -1.1e-14)):
        assert said(exported, "ardupilot", calibrated(hard_iron=[0, 0.0, nothing])) == [
            f"{C}.hard_iron: is {length} mG long, which ArduPilot takes for a compass that is not "
            f"calibrated — {AGAIN}"
        ]
        assert read_params(exported("px4", calibrated(hard_iron=[0, 0.0, nothing])))
    assert said(exported, "px4", calibrated(hard_iron=[0, 0, 1e35])) == [
        f"{C}.hard_iron[2]: CAL_MAG0_ZOFF would be 1e+39, and PX4 accepts -3.40282e+38 to "
        f"3.40282e+38 — {CHECK}"
    ]


def test_every_problem_is_said(exported):
    def change(r):
        del r["software"]
        r["sensors"]["magnetometer"]["calibration"]["unit"] = 7

    for name in AUTOPILOTS:
        assert said(exported, name, change) == [
            f"software: is missing — {AGAIN}",
            f"{C}.unit: 7 is not text — {AGAIN}",
        ]
    soft_iron = np.diag([0.01, 9.0, 1.0]).tolist()
    lines = said(exported, "ardupilot", calibrated(hard_iron=[1, 0, 0], soft_iron=soft_iron))
    keys = ("hard_iron", "soft_iron[0][0]", "soft_iron[1][1]")
    assert [line.split(": ")[0] for line in lines] == [f"{C}.{key}" for key in keys]


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_command(name, tmp_path, capsys):
    source, target = tmp_path / "results.json", tmp_path / "mag.params"
    source.write_text(json.dumps(results()))
    assert cli.main(["export", str(source), "--format", name, "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: written\n"
    assert target.read_text() == export(source, name)
    refused = results()
    refused["sensors"]["magnetometer"]["calibration"] = {"method": None, "reason": "Too few."}
    source.write_text(json.dumps(refused))
    assert cli.main(["export", str(source), "--format", name, "-o", str(target)]) == 1
    assert capsys.readouterr().err == f"{source}: {C}: was refused: Too few. — {TURN}\n"
