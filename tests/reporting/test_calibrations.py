"""Calibrations in results.json, results.csv, limits, index, group page and comparison."""

import csv
import io
import json

import pytest

from sensorbook.compare import compare, table
from sensorbook.export.source import read_results
from sensorbook.reporting import group, index, results
from sensorbook.reporting.calibration_table import calibration_table

STD = {"matrix": [[1e-4, 0, 0], [2e-4, 1e-4, 0], [2e-4, 2e-4, 1e-4]], "bias": [1e-3, 1e-3, 2e-3]}
CALIBRATION = {
    "method": "multi_position", "model": 9, "input": "means",
    "matrix": [[1.01, 0, 0], [0.002, 0.98, 0], [0, -0.005, 1.0]], "bias": [0.1, -0.4, 0.0],
    "g_sensitivity": None, "std": STD, "interval_factor": 2.0, "rms_before": 0.3, "rms_after": 1e-3,
    "rms_check": 2e-3, "positions": 20, "unit": "m/s^2",
}  # fmt: skip
REFUSED = {"method": None, "reason": "Six faces are not enough."}


def record(chapter, status="complete", reason=None, calibration=None):
    found = {"calibration": calibration, "calibration_methods": {chapter: calibration}}
    return {
        "chapter": chapter, "title": chapter, "sensor": "accelerometer", "status": status,
        "reason": reason, "inputs": [], "warnings": [], "results": found if calibration else {},
    }  # fmt: skip


def assembled(*records, spec=None):
    device = {"id": "imu", "name": "IMU", "model": None, "serial": None, "spec": spec or {}}
    return results.assemble(device, {}, "2026-01-01T00:00:00+00:00", list(records))


S, M = "six_position", "multi_position"
SIX = CALIBRATION | {"method": "six_position"}


@pytest.mark.parametrize(
    ("six", "many", "stands"),
    [
        (record(S, calibration=SIX), record(M, calibration=CALIBRATION), M),
        (record(S, calibration=SIX), record(M, "refused", "too few"), S),
        (record(S, "refused", "too few"), record(M, calibration=CALIBRATION), M),
        (record(S, "refused", "one"), record(M, "refused", "two"), None),
    ],
)  # fmt: skip
def test_what_one_chapter_determines_stands_whatever_the_other_refuses(six, many, stands):
    found = assembled(six, many)["sensors"]["accelerometer"]["calibration"]
    assert found["method"] == stands
    assert ("reason" in found) == (stands is None)
    assert ("matrix" in found) == (stands is not None)


def test_limits_are_about_the_size_of_an_error():
    spec = {
        "accelerometer": {
            "bias": {"max": 0.3, "unit": "m/s^2"},
            "scale_factor_error": {"max": 15000, "unit": "ppm"},
            "misalignment": {"max": 4.8, "unit": "mrad"},
        }
    }
    found = assembled(record("multi_position", calibration=CALIBRATION), spec=spec)["checks"]
    verdicts = {(c["quantity"], c["axis"]): c["verdict"] for c in found}
    assert [verdicts["bias", a] for a in "xyz"] == ["pass", "fail", "pass"]
    assert [verdicts["scale_factor_error", a] for a in "xyz"] == ["pass", "fail", "pass"]
    # zy is 5.0 ± 0.4 mrad; x has no misalignment of its own.
    assert [verdicts.get(("misalignment", a)) for a in "xyz"] == [None, "pass", "undecided"]
    bias = next(c for c in found if (c["quantity"], c["axis"]) == ("bias", "y"))
    assert (bias["value"], bias["low"], bias["high"]) == pytest.approx((0.4, 0.398, 0.402))


def test_csv_has_every_number_with_its_interval():
    found = assembled(record("multi_position", calibration=CALIBRATION))
    rows = list(csv.DictReader(io.StringIO(results.csv_text(found))))
    one = next(r for r in rows if (r["quantity"], r["axis"]) == ("misalignment", "zy"))
    assert one["method"] == "multi_position"
    assert float(one["value"]) == -0.005
    assert float(one["low"]) == pytest.approx(-0.0054)
    assert (one["field_unit"], float(one["field_value"])) == ("mrad", -5.0)
    with_interval = {r["quantity"] for r in rows if r["low"]}
    assert with_interval == {"bias", "scale_factor_error", "misalignment"}
    others = {
        r["quantity"]: (r["axis"], float(r["value"]), r["unit"]) for r in rows if not r["low"]
    }
    assert others == {
        "rms_before": ("", 0.3, "m/s^2"),
        "rms_after": ("", 1e-3, "m/s^2"),
        "rms_check": ("", 2e-3, "m/s^2"),
    }


def test_index_shows_it(tmp_path):
    found = assembled(record("multi_position", calibration=CALIBRATION))
    page = index.device_page(
        found | {"software": dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1")},
        tmp_path,
    )
    text = " ".join(page.split())
    assert (
        "many positions, 20 rests; length of gravity errs by 300 mm/s² rms as recorded, 1 fitted, 2 held out"
        in text
    )
    assert "10000<span" in text  # ppm
    assert "9800 … 10200" in text


def test_group_page_reads_it(tmp_path):
    found = assembled(record("multi_position", calibration=CALIBRATION))
    row = group._read("imu", json.loads(json.dumps(found)))
    assert row.values["accelerometer", "scale_factor_error"].number == pytest.approx(20000)
    assert row.values["accelerometer", "scale_factor_error"].axis == "y"
    assert row.values["accelerometer", "bias"].number == pytest.approx(0.4 / 9.80665e-3)


def test_compare_in_standard_errors(tmp_path):
    files = []
    for k, scale in enumerate((0.98, 0.9805)):
        changed = CALIBRATION | {"matrix": [[1.01, 0, 0], [0.002, scale, 0], [0, -0.005, 1.0]]}
        found = assembled(record("multi_position", calibration=changed))
        files.append(tmp_path / f"{k}.json")
        files[-1].write_text(json.dumps(found))
    (comparison,) = compare([read_results(file) for file in files])
    line = next(t for t in table(comparison) if "scale factor error" in t.lower() and " y " in t)
    assert "3.5" in line  # 5e-4 over √2 · 1e-4


def test_index_judges_each_misalignment_by_itself(tmp_path):
    spec = {"accelerometer": {"misalignment": {"max": 4.0, "unit": "mrad"}}}
    whole = CALIBRATION | {
        "matrix": [[1.01, 0, 0], [0.002, 0.98, 0], [0.001, -0.005, 1.0]],
    }
    found = assembled(record("multi_position", calibration=whole), spec=spec)
    result = found["sensors"]["accelerometer"]
    shown = calibration_table("accelerometer", result, found["checks"])
    cells = [c for row in shown["rows"] if row["name"] == "Misalignment" for c in row["cells"]]
    assert [(c["axis"], c["verdict"]) for c in cells] == [
        ("yx", "pass"),
        ("zx", "pass"),
        ("zy", "fail"),
    ]
    assert [c["verdict"] for c in found["checks"]] == ["pass", "fail"]
