"""An integrated attitude in results.json, its schema, csv, index, group page, comparison and exports."""

import copy
import csv
import io
import json
import math
import re

import pytest
from bs4 import BeautifulSoup
from jsonschema import Draft202012Validator, ValidationError

from sensorbook.cli import main
from sensorbook.reporting import group, index, results
from sensorbook.reporting.attitudes import attitude_table, mean_errors, real_time_error
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml

SOFTWARE = dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1")
NASTY = "<script>alert(1)</script>"
NOT_COMPARED = (
    "an integrated attitude hangs on the motion and the references of its recording: "
    "it is not compared"
)


def error(mean, **more):
    euler = None if mean is None else [mean, mean, mean]
    return {"mean_error_deg": mean, "mean_euler_error_deg": euler} | more


# Keys are not in the order in which a reader wants them.
METHODS = {
    "smoother": {"1.0": error(0.2)},
    "mekf": {
        "10.0": error(0.123456, nees=2.9, nees_low=2.8, nees_high=3.2, updates=600, samples=1715),
        "2.0": error(0.25),
        "never": error(None, rms_error_deg=None),
        "0.1": error(0.58),
    },
    "integration": {"never": error(47.81)},
}
BIAS = {"value": [math.radians(b) for b in (0.2, 0.12, -0.23)],
        "std": [math.radians(0.0123)] * 3, "unit": "rad/s"}  # fmt: skip
TUNING = {"random_walk": [2e-4] * 3, "rate_random_walk": [1e-6] * 3, "bias_std": [0.05] * 3,
          "in_motion": 2e-3, "reference_std": 1e-3, "prior_bias_std": 0.05,
          "reference": "reference"}  # fmt: skip
FULL = {"methods": METHODS, "bias": BIAS, "delay_s": 0.0175, "tuning": TUNING}
# A device that gravity and field alone tell the attitude of: filters have a covariance, others none.
UNJUDGED = {
    "integration": {"never": error(None, expected_rms_deg=None)},
    "smoother": {"1.0": error(None, expected_rms_deg=0.25234)},
    "complementary": {"1.0": error(None, expected_rms_deg=None)},
    "mekf": {
        "10.0": error(None, expected_rms_deg=0.465),
        "0.1": error(None, expected_rms_deg=12.369),
        "1.0": error(None, expected_rms_deg=0.671),
    },
}


def assembled(found, reason=None, folder="imu", status=None, noise=None):
    """results.json of a device with this attitude; with `reason` a chapter that refused or failed."""
    status = status or ("refused" if reason else "complete")
    record = {
        "sensor": "attitude", "chapter": "integrated_attitude", "title": "Integrated attitude",
        "status": status, "reason": reason, "results": {} if reason else found,
        "parameters": {"noise_record": "../gyroscope/noise.json", "thermal_record": ""},
        "inputs": [{"file": "t.csv", "sha256": 64 * "0", "sensor": "gyroscope", "kind": "trajectory",
                    "samples": 600, "rate_hz": 10.0, "duration_s": 60.0, "gaps": 0}],
    }  # fmt: skip
    records = [record]
    if noise:
        about = {"sensor": "gyroscope", "chapter": "noise", "title": "Noise identification"}
        done = {"status": "complete", "reason": None, "results": {"noise": noise}}
        records.insert(0, about | done)
    device = {"id": folder, "name": "IMU", "model": None, "serial": None, "spec": {}}
    made = results.assemble(device, SOFTWARE, "2026-01-01T00:00:00+00:00", records)
    return json.loads(results.dumps(made))


def validate(found):
    Draft202012Validator(json.loads(results.SCHEMA.read_text())).validate(found)


def table_rows(page, caption):
    """Texts of the cells of the table whose caption begins so."""
    soup = BeautifulSoup(page, "html.parser")
    (table,) = [c.parent for c in soup.find_all("caption") if c.get_text().startswith(caption)]
    return [[cell.get_text() for cell in row.find_all(["th", "td"])] for row in table("tr")]


# ---- results.json ----


def test_it_stands_at_the_top_and_not_among_the_sensors():
    found = assembled(FULL)
    assert found["attitude"] == FULL
    assert found["sensors"] == {}
    (chapter,) = found["chapters"]
    assert (chapter["sensor"], chapter["page"], chapter["notebook"]) == (
        "attitude", "attitude/integrated_attitude.html", "attitude/integrated_attitude.ipynb",
    )  # fmt: skip
    validate(found)


def test_a_refusal_leaves_its_reason_and_a_fault_nothing():
    found = assembled(None, "The rates are none.")
    assert found["attitude"] == {"reason": "The rates are none."}
    validate(found)
    found = assembled(None, "a fault", status="failed")
    assert "attitude" not in found
    validate(found)


def test_the_contract_s_example():
    errors = {"mean_error_deg": 0, "mean_euler_error_deg": [0, 0, 0]}
    validate(assembled({"methods": {"mekf": {"1.0": errors}}}))


def test_the_schema_takes_none_and_what_is_not_known():
    validate(assembled({"methods": {}}))
    validate(assembled(FULL | {"bias": None, "delay_s": None, "more": [1]}))
    validate(assembled({"methods": {"mekf": {"1e-05": error(1.0), "2": error(0, more=1)}}}))
    validate(assembled({"methods": UNJUDGED, "tuning": {"random_walk": [1, 2, 3], "more": "1"}}))


def test_the_schema_says_what_each_number_is():
    told = json.loads(results.SCHEMA.read_text())["$defs"]
    assert told["attitude_error"]["properties"].keys() >= error(1, expected_rms_deg=1).keys()
    assert told["attitude"]["properties"]["tuning"]["properties"].keys() == TUNING.keys()
    errors, properties = told["attitude_error"]["properties"], told["attitude"]["properties"]
    assert "not given to the method" in errors["mean_error_deg"]["description"]
    assert "own covariance" in errors["expected_rms_deg"]["description"]
    assert "stamped later than the motion" in properties["delay_s"]["description"]
    assert all(entry["description"] for entry in properties["tuning"]["properties"].values())


@pytest.mark.parametrize(
    "wrong",
    [
        {"bias": BIAS},
        {"methods": None},
        {"methods": {}, "reason": "numbers beside a reason"},
        {"methods": {"mekf": {"often": error(1.0)}}},
        {"methods": {"mekf": {"-1.0": error(1.0)}}},
        {"methods": {"mekf": {"1.0": {"mean_error_deg": 1.0}}}},
        {"methods": {"mekf": {"1.0": error(-1.0)}}},
        {"methods": {"mekf": {"1.0": error(1.0) | {"mean_euler_error_deg": [1, 2]}}}},
        {"methods": {"mekf": {"1.0": error(1.0, nees="3")}}},
        {"methods": {"mekf": {"1.0": error(1.0, updates=1.5)}}},
        {"methods": {}, "bias": BIAS | {"unit": "deg/s"}},
        {"methods": {}, "bias": BIAS | {"std": [0, 0, -1]}},
        {"methods": {}, "bias": {"value": [0, 0, 0], "unit": "rad/s"}},
        {"methods": {}, "delay_s": "late"},
        {"methods": {}, "tuning": 3},
        {"methods": {"mekf": {"1.0": error(1.0, expected_rms_deg="1")}}},
        {"methods": {"mekf": {"1.0": error(1.0, expected_rms_deg=-1.0)}}},
        *(
            {"methods": {}, "tuning": TUNING | {key: "none"}}
            for key in TUNING
            if key != "reference"
        ),
        *({"methods": {}, "tuning": TUNING | {key: [1.0, 1.0]}} for key in TUNING),
        {"methods": {}, "tuning": TUNING | {"in_motion": -1.0}},
    ],
)
def test_the_schema_refuses(wrong):
    with pytest.raises(ValidationError):
        validate(assembled(wrong))


# ---- numbers in short ----


def test_errors_in_the_order_of_methods_and_rates():
    aided = {f"mekf_{source}": {"1": error(0.3)} for source in ("vectors", "camera", "other")}
    more = {**aided, **METHODS, "own": {"1": error(1)}}
    assert list(mean_errors({"attitude": {"methods": more}})) == [
        ("integration", "never", 47.81),
        ("mekf", "never", None),
        ("mekf", "0.1", 0.58),
        ("mekf", "2.0", 0.25),
        ("mekf", "10.0", 0.123456),
        ("smoother", "1.0", 0.2),
        ("mekf_camera", "1", 0.3),
        ("mekf_vectors", "1", 0.3),
        ("mekf_other", "1", 0.3),
        ("own", "1", 1),
    ]
    nothing = {"methods": {"integration": {"never": error(None)}}}
    for none in ({}, {"attitude": {"reason": "none"}}, {"attitude": {"methods": {}}}):
        assert list(mean_errors(none)) == []
        assert real_time_error(none) is None
        assert attitude_table({"chapters": []} | none) is None
    assert attitude_table({"chapters": [], "attitude": nothing}) is None, "no table of dashes"


def test_the_real_time_error_is_that_of_the_most_frequent_reference_that_has_one():
    assert real_time_error(assembled(FULL)) == (0.123456, "at 10 Hz")
    unknown = {"mekf": METHODS["mekf"] | {"10.0": error(None)}, "smoother": {"50.0": error(0.01)}}
    assert real_time_error({"attitude": {"methods": unknown}}) == (0.25, "at 2 Hz")
    others = {"mekf": {"1.0": error(0.5)}, "mekf_vectors": {"10.0": error(0.1)}}
    assert real_time_error({"attitude": {"methods": others}}) == (0.5, "at 1 Hz")
    for rates in ({"never": error(3.0)}, {"often": error(3.0)}, {"nan": error(3.0)}):
        assert real_time_error({"attitude": {"methods": {"mekf": rates}}}) is None


def test_csv():
    rows = list(csv.DictReader(io.StringIO(results.csv_text(assembled(FULL)))))
    assert {(r["device"], r["sensor"], r["axis"], r["quantity"], r["unit"]) for r in rows} == {
        ("imu", "attitude", "", "mean_error_deg", "deg")
    }
    assert [(r["method"], float(r["value"]), r["field_unit"]) for r in rows] == [
        ("integration without reference", 47.81, "°"),
        ("mekf at 0.1 Hz", 0.58, "°"),
        ("mekf at 2 Hz", 0.25, "°"),
        ("mekf at 10 Hz", 0.123456, "°"),
        ("smoother at 1 Hz", 0.2, "°"),
    ]
    for none in (assembled(None, "nothing"), assembled({"methods": {}})):
        assert results.csv_text(none).splitlines() == [",".join(results.COLUMNS)]


def test_csv_holds_no_cell_that_a_spreadsheet_computes():
    methods = {"=1+1": {"1": error(1)}, "mekf": {"=2": error(1), "1": error(2)}}
    text = results.csv_text(assembled({"methods": methods}))
    assert "=" not in text
    assert "mekf at 1 Hz" in text


# ---- pages ----


def test_index(tmp_path):
    page = index.device_page(assembled(FULL), tmp_path)
    assert table_rows(page, "Mean error of the attitude") == [
        ["Method", "no reference", "0.1 Hz", "1 Hz", "2 Hz", "10 Hz"],
        ["gyroscope alone", "47.8", "–", "–", "–", "–"],
        ["Kalman filter (MEKF)", "–", "0.58", "–", "0.25", "0.123"],
        ["smoother (RTS)", "–", "–", "0.2", "–", "–"],
    ]
    assert table_rows(page, "The gyroscope's bias") == [
        ["Quantity", "x", "y", "z", "Unit"],
        ["Bias", "0.200 ± 0.024", "0.120 ± 0.024", "−0.230 ± 0.024", "°/s"],  # 1.96 · 0.0123
    ]
    assert "of themselves" not in page
    soup = BeautifulSoup(page, "html.parser")
    assert soup.find(id="attitude").get_text() == "Integrated attitude"
    links = [a.get_text() for a in soup.find_all("a", href="attitude/integrated_attitude.html")]
    assert links == ["Integrated attitude"] * 2, "below the tables, and in its card"
    card = " ".join(soup.select_one(".chapters li").get_text().split())
    assert "complete, after noise identification · notebook" in card
    assert "mekf" not in soup.get_text()


def test_index_names_the_methods_and_shows_others_as_inert_text(tmp_path):
    names = ("reset", "reset_and_rate", "complementary", NASTY)
    methods = {name: {"1": error(1)} for name in names}
    methods["reset"] = {NASTY: error(2)}
    page = index.device_page(assembled({"methods": methods}), tmp_path)
    assert table_rows(page, "Mean error of the attitude") == [
        ["Method", "1 Hz", NASTY],
        ["work C: reset", "–", "2"],
        ["work C: reset and rate kept", "1", "–"],
        ["complementary filter", "1", "–"],
        [NASTY, "1", "–"],
    ]
    assert NASTY not in page
    assert "The gyroscope's bias" not in page


def test_index_names_the_methods_of_the_device_s_other_sources(tmp_path):
    methods = {
        "smoother_vectors": {"1.0": error(0.7)},
        "mekf_camera": {"1.0": error(0.4)},
        "mekf": {"0.1": error(0.3), "1.0": error(None)},
        "complementary_vectors": {"1.0": error(0.9)},
        "mekf_vectors": {"1.0": error(0.8)},
        "mekf_": {"1.0": error(2)},
    }
    page = index.device_page(assembled({"methods": methods}), tmp_path)
    assert table_rows(page, "Mean error of the attitude") == [
        ["Method", "0.1 Hz", "1 Hz"],
        ["Kalman filter (MEKF)", "0.3", "–"],
        ["Kalman filter (MEKF), camera", "–", "0.4"],
        ["complementary filter, gravity and field", "–", "0.9"],
        ["Kalman filter (MEKF), gravity and field", "–", "0.8"],
        ["smoother (RTS), gravity and field", "–", "0.7"],
        ["mekf_", "–", "2"],
    ]


def test_index_of_a_device_without_a_reference_shows_what_the_filters_expect(tmp_path):
    found = assembled({"methods": UNJUDGED, "bias": BIAS})
    validate(found)
    page = index.device_page(found, tmp_path)
    assert table_rows(page, "What the filters expect of themselves: error (rms)") == [
        ["Method", "0.1 Hz", "1 Hz", "10 Hz"],
        ["Kalman filter (MEKF)", "12.4", "0.671", "0.465"],
        ["smoother (RTS)", "–", "0.252", "–"],
    ]
    assert "no reference judges them" in page
    assert "Mean error" not in page
    assert real_time_error(found) is None
    assert results.csv_text(found).splitlines() == [",".join(results.COLUMNS)]


def test_index_leaves_out_what_has_no_number_where_something_judges(tmp_path):
    rare = {"mekf": {"0.1": error(0.3, expected_rms_deg=0.2), "0.2": error(None, expected_rms_deg=0.1)},
            "smoother": {"0.2": error(None, expected_rms_deg=0.1)}}  # fmt: skip
    page = index.device_page(assembled({"methods": rare}), tmp_path)
    assert table_rows(page, "Mean error of the attitude") == [
        ["Method", "0.1 Hz"],
        ["Kalman filter (MEKF)", "0.3"],
    ]


def test_index_of_a_bias_alone_and_of_one_without_error(tmp_path):
    exact = {
        "value": [0.0, math.radians(-0.5), math.radians(2.0)],
        "std": [0, 0, 0],
        "unit": "rad/s",
    }
    page = index.device_page(assembled({"methods": {}, "bias": exact}), tmp_path)
    assert table_rows(page, "The gyroscope's bias")[1] == ["Bias", "0", "−0.5", "2", "°/s"]
    assert "expect of themselves" not in page
    assert "Mean error" not in page


def test_index_of_a_refusal_of_a_fault_and_of_no_such_chapter(tmp_path):
    page = index.device_page(assembled(None, "The rates <i> are none."), tmp_path)
    assert "1 of 1 chapters refused" in page
    assert page.count("The rates &lt;i&gt; are none.") == 2, "in the banner and in its card"
    assert "Mean error" not in page
    failed = index.device_page(assembled(None, "a fault", status="failed"), tmp_path)
    assert "1 of 1 chapters failed" in failed
    assert 'href="attitude/integrated_attitude.html"' not in failed
    for shown in (page, failed, index.device_page(assembled({"methods": {}}), tmp_path)):
        assert 'id="attitude"' not in shown


def test_group_page(tmp_path):
    devices = {
        "good": assembled(FULL, folder="good"),
        "unknown": assembled({"methods": {"mekf": {"1.0": error(None)}}}, folder="unknown"),
        "refused": assembled(None, "The rates are none.", folder="refused"),
    }
    for name, found in devices.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(json.dumps(found))
    page = group.group_page(tmp_path)
    soup = BeautifulSoup(page, "html.parser")
    heads = " ".join(soup.select_one("thead").get_text(" ").split())
    assert heads == "Device Report Verdict Attitude Mean error, Kalman filter (MEKF) ° Date"
    rows = {line.split("index.html'>")[1].split("<")[0]: line
            for line in page.splitlines() if "<tr><th scope=row>" in line}  # fmt: skip
    assert "<td>–<td>0.123 at 10 Hz<td>2026" in rows["good"]
    assert "<td>–<td>–<td>2026" in rows["unknown"]
    assert next(iter(rows)) == "refused", "those that need attention first"
    assert "attitude, Integrated attitude: refused (The rates are none.)" in page
    assert "An attitude's number is the Kalman filter's mean error" in page
    assert "worst axis" not in page


def test_group_page_judges_no_attitude_by_those_of_others(tmp_path):
    """Devices that did not move alike have no common spread, which ten would be enough for."""
    for k in range(10):
        found = assembled({"methods": {"mekf": {"1": error(100.0 if k == 0 else 0.1 + k / 1e3)}}})
        (tmp_path / f"{k}").mkdir()
        (tmp_path / f"{k}" / "results.json").write_text(json.dumps(found))
    page = group.group_page(tmp_path)
    assert "<td>100 at 1 Hz" in page
    assert "Distributions" not in page
    assert "Unlike others" not in page


@pytest.mark.parametrize(
    "wrong", [3, [1], {"methods": 3}, {"methods": {"mekf": 3}}, {"methods": {"mekf": {"1": 3}}}]
)
def test_group_page_of_a_results_json_by_others(tmp_path, wrong):
    (tmp_path / "wrong").mkdir()
    found = assembled(FULL, folder="wrong") | {"attitude": wrong}
    (tmp_path / "wrong" / "results.json").write_text(json.dumps(found))
    assert "its results.json cannot be read" in group.group_page(tmp_path)


# ---- gate, junit, comparison, exports ----


def test_gate_and_junit():
    found = assembled(FULL)
    (line,) = gate(found)
    assert line.startswith("imu: cannot be decided: no limits given")
    text = junit_xml([found], {("imu", "attitude", "integrated_attitude"): 1.25})
    assert 'classname="imu.attitude" name="integrated_attitude" time="1.250"' in text


def estimates(value, unit="rad/s"):
    entry = {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": f"{unit}/sqrt(Hz)"}
    terms = ("quantization", "bias_instability", "rate_random_walk", "rate_ramp")
    axis = dict.fromkeys(terms) | {"random_walk": entry, "noise_density": entry}
    axis["upper_bounds"] = {"rate_random_walk": 1e-7}
    return {name: copy.deepcopy(axis) for name in "xyz"}


def test_comparison_is_that_without_an_attitude_but_for_a_note(tmp_path, capsys):
    said = []
    for attitude in ({"attitude": FULL}, {"attitude": {"reason": "none"}}, {}):
        paths = []
        for name, value in (("a", 6e-5), ("b", 9e-5)):
            found = assembled(FULL, noise=estimates(value))
            del found["attitude"]
            paths.append(tmp_path / f"{name}.json")
            paths[-1].write_text(json.dumps(found | attitude))
        assert main(["compare", *map(str, paths)]) == 0
        said.append(capsys.readouterr())
    assert said[1] == said[2]
    note = f"  Note: {NOT_COMPARED}\n"
    assert said[0].out.count(note) == 1
    assert said[0].out.replace(note, "") == said[2].out
    assert "gyroscope angle random walk N" in said[0].out


def test_comparison_of_devices_with_an_attitude_alone(tmp_path, capsys):
    paths = [tmp_path / f"{name}.json" for name in "ab"]
    for path in paths:
        path.write_text(json.dumps(assembled(FULL, folder=path.stem)))
    assert main(["compare", *map(str, paths)]) == 0
    title, _, *lines = capsys.readouterr().out.splitlines()
    assert title == "b (2026-01-01), against a (2026-01-01)"
    nothing = "Nothing to compare: the two have no number with an interval in common."
    assert lines == [f"  Note: {NOT_COMPARED}", f"  {nothing}"]


@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        ("yaml", ["no sensor has a calibration or a thermal model"]),
        ("c-header", ["no sensor has a calibration or a thermal model"]),
        ("allan-csv", ["no sensor has an Allan curve"]),
        ("kalibr", ["Kalibr needs both sensors"] * 2),
        (
            "ardupilot",
            [
                "sensors.magnetometer: is missing",
                "sensors.accelerometer: is missing",
                "sensors.gyroscope: is missing",
            ],
        ),
        (
            "px4",
            [
                "sensors.magnetometer: is missing",
                "sensors.accelerometer: is missing",
                "sensors.gyroscope: is missing",
            ],
        ),
    ],
)
def test_exports_of_a_device_with_an_attitude_alone(tmp_path, capsys, form, wanted):
    file = tmp_path / "results.json"
    file.write_text(json.dumps(assembled(FULL)))
    assert main(["export", str(file), "--format", form]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    lines = said.err.splitlines()
    assert len(lines) == len(wanted)
    for line, words in zip(lines, wanted, strict=True):
        assert words in line
        assert " — " in line, "how to mend it"
        assert "record" in line.split(" — ")[1]


def test_exports_are_those_without_an_attitude(tmp_path, capsys):
    found = assembled(FULL, noise=estimates(6e-5))
    # Both, and their rates, are what Kalibr wants.
    for sensor, unit in (("gyroscope", "rad/s"), ("accelerometer", "m/s^2")):
        found["sensors"][sensor] = {"noise": estimates(6e-5, unit)}
        found["inputs"].append(found["inputs"][0] | {"sensor": sensor, "kind": "static"})
    ended = {}
    for form in ("yaml", "kalibr", "c-header", "allan-csv"):
        for name in ("with", "without"):
            file, out = tmp_path / "results.json", tmp_path / "out"
            out.unlink(missing_ok=True)
            shown = found if name == "with" else {k: v for k, v in found.items() if k != "attitude"}
            file.write_text(json.dumps(shown))
            code = main(["export", str(file), "--format", form, "-o", str(out)])
            text = out.read_text() if out.exists() else None
            text = text and re.sub("results.json: sha256 [0-9a-f]{64}", "", text)
            ended[form, name] = (code, text, capsys.readouterr())
        assert ended[form, "with"] == ended[form, "without"]
        assert "Traceback" not in ended[form, "with"][2].err
    assert ended["kalibr", "with"][0] == 0, ended["kalibr", "with"][2].err


def test_records_are_not_changed_by_what_reads_them():
    found = assembled(FULL)
    before = copy.deepcopy(found)
    attitude_table(found)
    real_time_error(found)
    results.csv_text(found)
    assert found == before
