"""A magnetometer's calibration in results.csv, limits, index, group page and schema."""

import copy
import csv
import io
import json

import pytest
from jsonschema import Draft202012Validator

from sensorbook.reporting import group, index, results
from sensorbook.reporting.calibration_table import calibration_table
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml

SOFTWARE = dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1")
REASON = "The directions are too few: the field stays within ±3° of one plane.\nTip it by 90°."
CALIBRATION = {
    "method": "ellipsoid", "hard_iron": [8e-6, -30e-6, 1e-6],
    "soft_iron": [[1.02, -0.012, 0.003], [-0.012, 0.98, 0.07], [0.003, 0.07, 1.0]],
    "field": 48e-6, "field_measured": 49e-6, "field_known": True, "field_source": "WMM",
    "residual_percent": 0.5, "residual_percent_check": 0.8, "residual_percent_before": 12.0,
    "coverage_percent": 97.0, "dilution": 1.2, "interval_factor": 2.0, "degrees_of_freedom": 39, "blocks": 40,
    "readings": 5990, "set_aside": 10, "unit": "T",
    "std": {"hard_iron": [1e-8, 2e-8, 1e-8], "field": 1e-7, "field_measured": 2e-7,
            "soft_iron": [[1e-3, 2e-4, 2e-4], [2e-4, 1e-3, 2e-4], [2e-4, 2e-4, 1e-3]]},
    "alignment": {"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "turn_deg": [0, 0, 0],
                  "turn_std_deg": [0.1, 0.1, 0.1], "degrees_of_freedom": 39, "dip_deg": 58.0,
                  "dip_spread_before_deg": 7.5, "dip_spread_calibrated_deg": 2.6,
                  "dip_spread_after_deg": 0.7, "accelerometer": "as read"},
    "heading_error_before_deg": 23.0, "heading_error_after_deg": 0.16,
    "heading_error_aligned_deg": 0.14, "repeatability": {"hard_iron": [1e-8, 2e-8, 3e-8]},
    "runs": [{"file": "b.csv", "method": "ellipsoid"},
             {"file": "c.csv", "method": None, "reason": REASON}],
}  # fmt: skip
SPEC = {
    "hard_iron": {"max": 20, "unit": "uT"},
    "soft_iron": {"max": 0.05, "unit": "1"},
    "residual_percent": {"max": 0.6},
    "coverage_percent": {"min": 95},
    "field": {"min": 45, "max": 50, "unit": "uT"},
    "heading_error_after_deg": {"max": 0.5},
}


def assembled(calibration=None, spec=SPEC, **changed):
    """results.json of a device whose magnetometer has this calibration, or was refused one."""
    calibration = calibration and copy.deepcopy(calibration) | changed
    record = {
        "sensor": "magnetometer", "chapter": "magnetometer", "title": "Magnetometer calibration",
        "status": "complete" if calibration else "refused", "reason": None if calibration else REASON,
        "results": {"calibration": calibration,
                    "calibration_methods": {"magnetometer": calibration}} if calibration else {},
    }  # fmt: skip
    device = {"id": "imu", "name": "IMU", "model": None, "serial": None}
    device["spec"] = {"magnetometer": spec} if spec else {}
    moment = "2026-01-01T00:00:00+00:00"
    found = results.assemble(device, SOFTWARE, moment, [record] if calibration != {} else [])
    return json.loads(results.dumps(found))


def verdicts(found):
    return {(c["quantity"], c["axis"], c["bound"]): c["verdict"] for c in found["checks"]}


def table(found):
    return calibration_table(
        "magnetometer", found["sensors"].get("magnetometer", {}), found["checks"]
    )


def cells(found):
    """(row, axis): value, interval, verdict."""
    return {
        (row["name"], cell["axis"]): (cell["value"], cell["interval"], cell["verdict"])
        for row in table(found)["rows"]
        for cell in row["cells"]
        if cell
    }


# ---- limits ----


def test_each_limit_is_judged_by_what_it_is_about():
    found = verdicts(assembled(CALIBRATION))
    assert [found["hard_iron", a, "max"] for a in "xyz"] == ["pass", "fail", "pass"]
    # Off the identity: x by 0.020 of xx, y and z by 0.07 of the yz that they share.
    assert [found["soft_iron", a, "max"] for a in "xyz"] == ["pass", "fail", "fail"]
    # 0.5 % is of the readings fitted; 0.8 % of those held out counts.
    assert found["residual_percent", "", "max"] == "fail"
    assert found["coverage_percent", "", "min"] == "pass"
    assert found["field", "", "max"] == found["field", "", "min"] == "pass"
    assert found["heading_error_after_deg", "", "max"] == "pass"
    assert len(found) == 11


def test_an_interval_across_a_limit_is_undecided():
    spec = {"hard_iron": {"max": 30.01, "unit": "uT"}}  # y is −30 ± 0.04 µT
    (x, y, z) = assembled(CALIBRATION, spec)["checks"]
    assert [c["verdict"] for c in (x, y, z)] == ["pass", "undecided", "pass"]
    assert (y["value"], y["low"], y["high"]) == pytest.approx((30e-6, 29.96e-6, 30.04e-6))


def test_an_entry_that_is_hardly_known_keeps_its_axis_undecided():
    """As of a reduced model: the largest entry is within the limit, and another may not be."""
    std = CALIBRATION["std"] | {"soft_iron": [[1e-3, 0.05, 2e-4], [0.05, 1e-3, 2e-4], [2e-4] * 3]}
    spec = {"soft_iron": {"max": 0.08, "unit": "1"}}
    found = assembled(CALIBRATION, spec, std=std)
    assert [c["verdict"] for c in found["checks"]] == ["undecided", "undecided", "pass"]
    x = found["checks"][0]  # xx is 0.020 ± 0.002, xy −0.012 ± 0.1
    assert (x["value"], x["low"], x["high"]) == pytest.approx((0.02, 0.018, 0.112))
    assert next(gate(found)) == (
        "imu: magnetometer soft iron off identity x: 0.020 (0.018 … 0.112), limit ≤ 0.08: undecided, as "
        "its 95 % interval straddles the limit — record it in more attitudes, which narrows it"
    )
    assert cells(found)["Soft iron", "xx"][2] == "pass"
    assert cells(found)["Soft iron", "xy"][2] == "undecided"


def test_without_held_out_readings_the_fit_is_judged():
    found = assembled(CALIBRATION, residual_percent_check=None)
    assert verdicts(found)["residual_percent", "", "max"] == "pass"


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("limited", ["field", "field_measured"])
@pytest.mark.parametrize(
    ("limit", "verdict"), [(48.5, "fail"), (49.3, "undecided"), (49.5, "pass")]
)
def test_a_limit_on_the_field_is_about_the_readings(limited, known, limit, verdict):
    """As read it is 49.0 ± 0.4 µT; the 48.0 ± 0.2 µT of `field` are the Earth model's."""
    spec = {limited: {"max": limit, "unit": "uT"}}
    found = assembled(CALIBRATION, spec, field_known=known)
    assert verdicts(found) == {(limited, "", "max"): verdict}
    (check,) = found["checks"]
    assert (check["value"], check["low"], check["high"]) == pytest.approx((49e-6, 48.6e-6, 49.4e-6))
    assert cells(found)["Field strength as read", ""] == ("49.00", "48.60 … 49.40", verdict)


def test_without_the_strength_of_the_readings_the_field_is_not_judged():
    without = {k: v for k, v in CALIBRATION.items() if k != "field_measured"}
    found = assembled(without, {"field": {"max": 50, "unit": "uT"}})
    assert verdicts(found) == {("field", "", "max"): "undecided"}
    assert list(gate(found)) == [
        "imu: magnetometer field strength as read: no result, limit ≤ 50 µT: undecided — these results do "
        "not hold the strength of the readings: render the report again"
    ]
    assert cells(found)["Field strength as read", ""] == ("–", "", "undecided")


def test_gate_and_junit_name_a_quantity_without_axes():
    found = assembled(CALIBRATION, {"residual_percent": {"max": 0.6}})
    assert list(gate(found)) == [
        "imu: magnetometer residual of field strength: 0.8, limit ≤ 0.6 %: fail"
    ]
    assert 'name="residual_percent max"' in junit_xml([found], {})
    soft = assembled(CALIBRATION, {"soft_iron": {"max": 0.05, "unit": "1"}})
    assert next(iter(gate(soft))) == (
        "imu: magnetometer soft iron off identity y: 0.07000 (0.06960 … 0.07040), limit ≤ 0.05: fail"
    )


# ---- pages ----


def test_the_table_of_the_device_page():
    found = cells(assembled(CALIBRATION))
    assert found["Hard iron", "y"] == ("-30.000", "-30.040 … -29.960", "fail")
    assert found["Soft iron", "xx"] == ("1.0200", "1.0180 … 1.0220", "pass")
    assert found["Soft iron", "yz"] == ("0.07000", "0.06960 … 0.07040", "fail")
    assert found["Soft iron", "xz"] == ("0.00300", "0.00260 … 0.00340", "pass")
    assert found["Field strength as read", ""] == ("49.00", "48.60 … 49.40", "pass")
    assert found["Residual of field strength", ""] == ("0.8", "12 as recorded", "fail")
    assert found["Coverage of directions", ""] == ("97", "", "pass")
    assert found["Heading error, corrected", ""] == ("0.16", "23 as recorded, 0.14 aligned", "pass")
    limits = {
        row["name"]: (row["limit"], row["unit"]) for row in table(assembled(CALIBRATION))["rows"]
    }
    assert limits["Soft iron"] == ("≤ 0.05 off identity", "1")
    assert limits["Field strength as read"] == ("≤ 50, ≥ 45", "µT")


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("ellipsoid", "full ellipsoid"),
        ("diagonal", "hard iron and one scale factor an axis"),
        ("hard_iron", "hard iron only"),
    ],
)
def test_the_caption_says_how_and_what_is_left(method, words):
    caption = table(assembled(CALIBRATION, method=method))["caption"]
    assert caption == (
        f"Calibration, with 95 % intervals: {words}, 5990 readings; field strength errs by 12 % rms as "
        "recorded, 0.5 fitted, 0.8 held out; dip angle scatters by 7.5° as recorded, 2.6 calibrated, "
        "0.7 aligned"
    )


def test_the_caption_without_accelerometer_and_field():
    caption = table(assembled(CALIBRATION, alignment=None, field_known=False))["caption"]
    assert "dip" not in caption
    assert caption.endswith("is not known, so that the soft iron has determinant 1")


def test_a_refusal_is_told_once_with_its_reason(tmp_path):
    found = assembled()
    assert table(found)["caption"] == (
        "Calibration refused: The directions are too few: the field stays within ±3° of one plane."
    )
    assert cells(found)["Hard iron", "x"] == ("–", "", "undecided")
    assert cells(found)["Coverage of directions", ""] == ("–", "", "undecided")
    page = " ".join(index.device_page(found, tmp_path).split())
    line = (
        "Magnetometer hard iron, soft iron off identity, residual of field strength, coverage of "
        "directions, field strength as read, heading error, corrected: no result: undecided — magnetometer "
        "calibration refused: The directions are too few"
    )
    assert page.count(line) == 1
    assert page.count("no result") == 1
    without = assembled(spec=None)
    assert table(without)["rows"] == []
    assert "<p>Calibration refused: The directions" in index.device_page(without, tmp_path)


def test_limits_without_any_recording_for_them():
    found = assembled({})
    found["sensors"]["magnetometer"] = {}
    assert table(found)["caption"] == "No calibration: no recording gives one."
    found = assembled({}, spec=None)
    assert table(found) is None


def test_the_page_is_inert(tmp_path):
    nasty = "<script>alert(1)</script>"
    page = index.device_page(assembled(CALIBRATION, method=nasty), tmp_path)
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_group_page():
    row = group._read("imu", assembled(CALIBRATION))
    values = {quantity: (v.number, v.axis, v.verdict) for (_, quantity), v in row.values.items()}
    assert values["hard_iron"] == (pytest.approx(30), "y", "fail")
    assert values["soft_iron"] == (pytest.approx(0.07), "y", "fail")
    assert values["residual_percent"] == (0.8, "", "fail")
    assert values["coverage_percent"] == (97.0, "", "pass")
    assert values["heading_error_after_deg"] == (0.16, "", "pass")
    assert values["field"] == (pytest.approx(49), "", "pass")
    assert "magnetometer residual of field strength 0.800, limit ≤ 0.6 %" in row.reasons
    assert "magnetometer soft iron off identity y 0.0700, limit ≤ 0.05" in row.reasons


def test_group_page_without_limits_and_of_a_refusal():
    row = group._read("imu", assembled(CALIBRATION, spec=None))
    assert row.values["magnetometer", "hard_iron"].axis == "y"
    assert row.values["magnetometer", "soft_iron"].axis == "yz"
    assert not {q for _, q in row.values if "field" in q}  # of the place, not of the device
    refused = group._read("imu", assembled(spec=None))
    assert refused.values == {}
    assert refused.reasons == [
        "magnetometer, Magnetometer calibration: refused (The directions are too few: the field stays "
        "within ±3° of one plane.)"
    ]
    missing = group._read("imu", assembled(spec={"coverage_percent": {"min": 95}}))
    assert missing.reasons[0] == (
        "undecided: magnetometer coverage of directions no result, limit ≥ 95 %"
    )


# ---- results.csv and the schema ----


ALONE = {  # numbers without an interval
    "residual_percent": (0.5, "%"), "residual_percent_check": (0.8, "%"),
    "residual_percent_before": (12.0, "%"), "coverage_percent": (97.0, "%"),
    "heading_error_before_deg": (23.0, "°"), "heading_error_after_deg": (0.16, "°"),
    "heading_error_aligned_deg": (0.14, "°"), "dip_deg": (58.0, "°"),
    "dip_spread_before_deg": (7.5, "°"), "dip_spread_calibrated_deg": (2.6, "°"),
    "dip_spread_after_deg": (0.7, "°"),
}  # fmt: skip


def test_csv_has_every_number_with_its_interval():
    rows = list(csv.DictReader(io.StringIO(results.csv_text(assembled(CALIBRATION)))))
    by = {(r["quantity"], r["axis"]): r for r in rows}
    assert list(by) == [
        *(("hard_iron", a) for a in "xyz"),
        *(("soft_iron", e) for e in ("xx", "yy", "zz", "xy", "xz", "yz")),
        ("field", ""),
        ("field_measured", ""),
        *((quantity, "") for quantity in ALONE),
    ]
    for quantity, (value, label) in ALONE.items():
        row = by[quantity, ""]
        assert (float(row["field_value"]), row["field_unit"], row["low"]) == (value, label, "")
        assert (float(row["value"]), row["unit"]) == (value, {"%": "percent", "°": "deg"}[label])
    y = by["hard_iron", "y"]
    assert (float(y["field_value"]), y["field_unit"], y["method"]) == (-30.0, "µT", "ellipsoid")
    assert float(by["soft_iron", "yz"]["low"]) == pytest.approx(0.0696)
    assert float(by["field", ""]["field_high"]) == pytest.approx(48.2)
    nothing = assembled(CALIBRATION, heading_error_aligned_deg=None, alignment=None)
    rows = list(csv.DictReader(io.StringIO(results.csv_text(nothing))))
    assert not [r for r in rows if "dip" in r["quantity"] or "aligned" in r["quantity"]]
    assert results.csv_text(assembled()).splitlines() == [",".join(results.COLUMNS)]


def test_the_schema_takes_it():
    schema = Draft202012Validator(json.loads(results.SCHEMA.read_text()))
    for found in (assembled(CALIBRATION), assembled(CALIBRATION, alignment=None), assembled()):
        schema.validate(found)


@pytest.mark.parametrize("changed", [
    {"field": -1e-6}, {"field_known": "yes"}, {"coverage_percent": 101.0}, {"residual_percent": "1"},
    {"std": CALIBRATION["std"] | {"hard_iron": [1e-8]}}, {"blocks": 0}, {"set_aside": 1.5},
    {"alignment": {}}, {"heading_error_after_deg": "0.1"}, {"runs": [{}]},
    {"runs": [{"file": "b.csv", "method": None}]},
    {"field_measured": 0.0}, {"repeatability": {}}, {"heading_error_aligned_deg": "0.1"},
    {"method": "spheroid"},
])  # fmt: skip
def test_the_schema_refuses_what_is_wrong(changed):
    schema = Draft202012Validator(json.loads(results.SCHEMA.read_text()))
    assert not schema.is_valid(assembled(CALIBRATION, spec=None, **changed))
