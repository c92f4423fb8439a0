"""Every number as CSV and as MATLAB's variables; the list of formats, and what all say of their origin."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from scipy.io import loadmat
from test_calibration_exports import results as calibrated
from test_export import results as noisy

from sensorbook import InputError, Recording, cli
from sensorbook.apply import correct
from sensorbook.export import FORMATS, export
from sensorbook.reporting.results import csv_text

AGAIN = "render it again with: sensorbook report"


def results():
    """With everything that some format needs."""
    found, more = calibrated(), noisy()
    for sensor, result in more["sensors"].items():
        found["sensors"][sensor] |= result
    magnetometer = found["sensors"]["magnetometer"]["calibration"]
    magnetometer["std"] = {"hard_iron": [1e-8] * 3, "soft_iron": [[1e-4] * 3] * 3, "field": 1e-8}
    found["inputs"] = more["inputs"]
    for sensor in ("gyroscope", "accelerometer"):
        calibration = found["sensors"][sensor]["calibration"]
        calibration["bias"] = [0.01, -0.02, 0.03]
    # All nine entries of the gyroscope's matrix were free.
    found["sensors"]["gyroscope"]["calibration"]["std"]["matrix"] = [[1e-4] * 3] * 3
    return found


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "results.json"
    path.write_text(json.dumps(results()))
    return path


def changed(file, change):
    found = results()
    change(found)
    file.write_text(json.dumps(found))
    return file


def said(file, name, change):
    with pytest.raises(InputError) as caught:
        export(changed(file, change), name)
    return [line.split("results.json: ", 1)[1] for line in str(caught.value).splitlines()]


RNG = np.random.default_rng(20240501)
RAW = {"accelerometer": RNG.normal(0, 10, (200, 3)), "gyroscope": RNG.normal(0, 1, (200, 3)),
       "magnetometer": RNG.normal(0, 5e-5, (200, 3))}  # fmt: skip


def applied(sensor, raw, acceleration=None):
    """What sensorbook itself makes of raw readings, without a temperature."""
    found = {k: v for k, v in results()["sensors"][sensor].items() if k != "thermal"}
    time = np.arange(len(raw)) / 100
    run = Recording(sensor, "static", "a.csv", time, raw, rate=100.0)
    return correct(run, found, acceleration)[0].values


# ---- CSV ----


def table(file):
    return list(csv.DictReader(io.StringIO(export(file, "csv"))))


def test_the_table_has_the_columns_of_the_reports_and_the_provenance(file):
    rows = list(csv.reader(io.StringIO(export(file, "csv"))))
    assert [row[:13] for row in rows] == list(csv.reader(io.StringIO(csv_text(results()))))
    assert rows[0][13:] == ["convention", "created", "sensorbook", "results_sha256"]
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert {tuple(row[14:]) for row in rows[1:]} == {("2024-05-01T12:00:00+00:00", "0.1.0", digest)}


def test_the_table_corrects_as_the_library(file):
    """raw = matrix · true + bias, of the table's scale factor errors, misalignments and biases."""
    rows = table(file)
    for sensor in ("accelerometer", "gyroscope"):
        value = {
            (row["quantity"], row["axis"]): float(row["value"])
            for row in rows
            if row["sensor"] == sensor
            and row["convention"].startswith("raw = matrix * true + bias")
        }
        matrix = np.eye(3)
        for (quantity, axes), number in value.items():
            i, j = "xyz".index(axes[0]), "xyz".index(axes[-1])
            if quantity in ("scale_factor_error", "misalignment"):
                matrix[i, j] += number
        bias = [value["bias", axis] for axis in "xyz"]
        got = np.linalg.inv(matrix) @ (RAW[sensor] - bias).T
        np.testing.assert_allclose(got.T, applied(sensor, RAW[sensor]), rtol=0, atol=1e-9)


def test_conventions_of_noise_stand_in_the_table(file):
    found = {
        row["quantity"]: row for row in table(file) if row["sensor"] == "gyroscope" and row["axis"] == "x"
    }  # fmt: skip
    n, density = found["random_walk"], found["noise_density"]
    assert n["convention"] == "of the two-sided spectrum"
    assert density["convention"] == "of the one-sided spectrum"
    assert float(density["value"]) / float(n["value"]) == pytest.approx(2**0.5, rel=1e-12)


def test_no_cell_is_a_formula(file):
    def change(r):
        r["device"]["id"] = "=1+1"
        r["created"] = "@x"
        r["sensors"]["gyroscope"]["calibration"]["method"] = "+a"

    rows = table(changed(file, change))
    assert {row["device"] for row in rows} == {"'=1+1"}
    assert {row["created"] for row in rows} == {"'@x"}
    for row in rows:
        for text in row.values():
            assert text[:1] not in ("=", "+", "@", "\t", "\r")
            if text.startswith("-"):
                float(text)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda r: r.update(sensors={}), "sensors: holds no numbers — render the report of a recording"),
        (lambda r: r.pop("software"), f"software: is missing — {AGAIN}"),
        (lambda r: r["sensors"]["gyroscope"]["noise"]["y"]["random_walk"].update(value=math.nan),
         f"sensors: gyroscope y random_walk: nan is not a finite number — {AGAIN}"),
    ],
)  # fmt: skip
def test_what_is_no_table(change, line, file):
    assert said(file, "csv", change) == [line]


DAMAGED = [
    5,
    [1],
    {"method": "x", "std": {}, "bias": 3},
    {"method": "x", "std": {"matrix": []}, "matrix": [[]]},
    {"method": "x", "std": {"bias": [10**400]}, "bias": [1]},
]


@pytest.mark.parametrize("damage", DAMAGED)
def test_damaged_results_are_one_line(damage, file):
    (line,) = said(file, "csv", lambda r: r["sensors"]["gyroscope"].update(calibration=damage))
    assert line.startswith("cannot be made a table: ")
    assert line.endswith(AGAIN)


# ---- MATLAB ----


def test_variables_are_the_results(file):
    found = loadmat(io.BytesIO(export(file, "mat")), simplify_cells=True)
    expected = results()["sensors"]

    def same(got, wanted, where):
        if isinstance(wanted, dict):
            assert set(got) == set(wanted) if wanted else got.size == 0, where
            for key, below in wanted.items():
                same(got[key], below, f"{where}.{key}")
        elif wanted and isinstance(wanted, list) and isinstance(wanted[0], dict):
            for i, (mine, below) in enumerate(zip(got, wanted, strict=True)):
                same(mine, below, f"{where}[{i}]")
        elif isinstance(wanted, str):
            assert got == wanted.replace("°", " deg ").replace("  ", " "), where
        elif wanted is None or wanted == []:
            assert np.size(got) == 0, where
        else:
            np.testing.assert_array_equal(got, np.array(wanted, dtype=float), where)

    same(found["sensors"], expected, "sensors")
    assert [entry["file"] for entry in found["inputs"]] == [e["file"] for e in results()["inputs"]]


def test_vectors_are_columns(file):
    found = loadmat(io.BytesIO(export(file, "mat")))
    calibration = found["sensors"]["gyroscope"][0, 0]["calibration"][0, 0]
    assert calibration["bias"][0, 0].shape == (3, 1)
    assert (
        calibration["matrix"][0, 0].tolist()
        == results()["sensors"]["gyroscope"]["calibration"]["matrix"]
    )


def test_the_convention_of_the_variables_corrects_as_the_library(file):
    """As written in `convention`, matrix \\ (raw - bias - g_sensitivity * acceleration)."""
    found = loadmat(io.BytesIO(export(file, "mat")), simplify_cells=True)
    assert (
        "true = matrix \\ (raw - bias - g_sensitivity * acceleration)"
        in found["convention"]["calibration"]
    )
    a = found["sensors"]["accelerometer"]["calibration"]
    acceleration = np.linalg.solve(a["matrix"], RAW["accelerometer"].T - a["bias"][:, None])
    expected = applied("accelerometer", RAW["accelerometer"])
    np.testing.assert_allclose(acceleration.T, expected, rtol=0, atol=1e-9)
    g = found["sensors"]["gyroscope"]["calibration"]
    rest = RAW["gyroscope"].T - g["bias"][:, None] - g["g_sensitivity"] @ acceleration
    expected = applied("gyroscope", RAW["gyroscope"], expected)
    np.testing.assert_allclose(np.linalg.solve(g["matrix"], rest).T, expected, rtol=0, atol=1e-9)
    m = found["sensors"]["magnetometer"]["calibration"]
    field = m["soft_iron"] @ (RAW["magnetometer"].T - m["hard_iron"][:, None])
    np.testing.assert_allclose(field.T, applied("magnetometer", RAW["magnetometer"]), rtol=1e-9)


OCTAVE = """
load('results.mat');
c = sensors.accelerometer.calibration;
true = c.matrix \\ ([1; 2; 3] - c.bias);
printf('%.17g\\n', true);
printf('%s\\n', provenance);
"""


def test_octave_reads_it(file, tmp_path):
    if shutil.which("octave") is None:
        pytest.skip("no octave here: the file is read by scipy alone")
    (tmp_path / "results.mat").write_bytes(export(file, "mat"))
    run = subprocess.run(
        ["octave", "--no-gui", "--quiet", "--eval", OCTAVE],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    lines = run.stdout.splitlines()
    expected = applied("accelerometer", np.array([[1.0, 2.0, 3.0]]))[0]
    assert [float(line) for line in lines[:3]] == pytest.approx(expected.tolist(), rel=1e-9)
    assert lines[3] == "Results of the device imu-7.b (An IMU)."


def test_the_same_results_give_the_same_bytes(file):
    content = export(file, "mat")
    assert content == export(file, "mat")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert content[:116].decode().rstrip() == f"MATLAB 5.0 MAT-file, results.json: sha256 {digest}."


def test_names_that_are_none_to_matlab(file):
    def change(r):
        r["attitude"] = {
            "methods": {"mekf": {"1.0": {"error": 2.5, "ok": True, "odd": [[1], [2, 3]]}}}
        }

    found = loadmat(io.BytesIO(export(changed(file, change), "mat")), simplify_cells=True)
    at = found["attitude"]["methods"]["mekf"]["x1_0"]
    assert at["error"] == 2.5
    assert at["ok"] == 1
    assert [np.ravel(row).tolist() for row in at["odd"]] == [[1], [2, 3]]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda r: r.update(sensors={}), "sensors: holds no results — render the report of a recording"),
        (lambda r: r.pop("sensors"), f"sensors: is missing — {AGAIN}"),
        (lambda r: r["sensors"].update({"a b": {"x": 1}, "a_b": {"x": 2}}),
         f"cannot be made variables: ValueError: two fields are a_b to MATLAB — {AGAIN}"),
        (lambda r: r["sensors"].update(a=10**400),
         f"cannot be made variables: OverflowError: int too large to convert to float — {AGAIN}"),
        (lambda r: r["sensors"]["gyroscope"]["allan"].update(x=[1.0, math.inf]),
         f"cannot be made variables: ValueError: inf is not a finite number — {AGAIN}"),
        (lambda r: r["sensors"]["magnetometer"]["calibration"].update(field=math.nan),
         f"cannot be made variables: ValueError: nan is not a finite number — {AGAIN}"),
    ],
)  # fmt: skip
def test_what_are_no_variables(change, line, file):
    assert said(file, "mat", change) == [line]


def test_the_command_wants_a_file_for_what_is_binary(file, tmp_path, capsys):
    assert cli.main(["export", str(file), "--format", "mat"]) == 2
    assert capsys.readouterr().err == (
        "sensorbook export: --format mat is binary: name the file to write with -o FILE\n"
    )
    out = tmp_path / "out" / "results.mat"
    assert cli.main(["export", str(file), "--format", "mat", "-o", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: written\n"
    assert out.read_bytes() == export(file, "mat")
    assert [path.name for path in out.parent.iterdir()] == ["results.mat"]


# ---- all formats ----


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_names_the_results_that_it_is_of(name, file):
    content = export(file, name)
    assert isinstance(content, bytes) == FORMATS[name].binary
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    text = content
    if name == "mat":
        text = loadmat(io.BytesIO(content), simplify_cells=True)["provenance"]
    for told in (digest, "2024-05-01T12:00:00+00:00", "imu-7.b", "0.1.0"):
        assert told in text
    if not name.endswith("csv"):
        assert "static.csv, sha256" in " ".join(text.replace("\n#", " ").split())


def test_the_list_says_which_formats_these_results_suffice_for(file, capsys):
    def change(r):
        del r["sensors"]["accelerometer"], r["sensors"]["magnetometer"]
        r["sensors"]["gyroscope"]["calibration"] = {"method": None, "reason": "Too few."}

    assert cli.main(["export", str(file), "--list"]) == 0
    assert capsys.readouterr().out == "".join(f"{n:10}  ready\n" for n in FORMATS)
    changed(file, change)
    assert cli.main(["export", str(file), "--list"]) == 0
    states = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert list(states) == list(FORMATS)
    ready = {name for name, state in states.items() if state == "ready"}
    assert ready == {"yaml", "c-header", "ros-params", "csv", "allan-csv", "mat"}
    positions = 'record rests in many attitudes (kind = "positions") and render the report'
    assert states["imu-calib"] == f"sensors.accelerometer: is missing — {positions}"
    assert states["px4"] == f"sensors.gyroscope.calibration: was refused: Too few. — {positions}"
    for name in set(FORMATS) - ready:
        with pytest.raises(InputError):
            export(file, name)


def test_the_list_tells_which_of_several_sensors_would_do(file, capsys):
    def change(r):
        for results in r["sensors"].values():
            results.pop("calibration", None)

    changed(file, change)
    assert cli.main(["export", str(file), "--list"]) == 0
    states = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    mend = 'record it turned freely (kind = "rotation") and render the report'
    told = f"sensors.magnetometer.calibration: is missing — {mend}"
    for name in ("ardupilot", "px4"):
        assert states[name] == f"needs calibration of any sensor; {told}"


def test_the_list_of_a_file_that_is_none(tmp_path, capsys):
    assert cli.main(["export", str(tmp_path / "no.json"), "--list"]) == 1
    assert "cannot be read: No such file" in capsys.readouterr().err
