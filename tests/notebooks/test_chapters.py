"""Every chapter: its form, its numbers on the demo, and its sentences on good, bad and refused data."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import nbformat
import numpy as np
import pytest
from browser import CHROMIUM, Opened, examine, sheets
from devices import render, rest, sweep, write

from sensorbook.reporting import chapters

NOTEBOOKS = sorted(chapters.NOTEBOOKS.glob("*.ipynb"))
SCHEMA = Path(chapters.__file__).with_name("results.schema.json")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_form(path):
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    first, *rest_of_cells = book.cells
    assert re.match(r"# .+\n\n\*\*[^*]+\?\*\*", first.source), "starts with its title and question"
    tagged = [c for c in rest_of_cells if "parameters" in c.metadata.get("tags", [])]
    assert len(tagged) == 1
    for line in tagged[0].source.splitlines():
        assert re.fullmatch(r"\w+ = (\"[^\"]*\"|\d+(\.\d+)?|\[.*\])", line), line
    for cell in book.cells:
        assert cell.source.strip(), "an empty cell"
        if cell.cell_type == "code":
            assert not cell.outputs
            assert cell.execution_count is None
            assert len(cell.source.splitlines()) <= 14, cell.source
    assert any("teaching" in c.metadata.get("tags", []) for c in book.cells), "exercises"
    assert "## In two lines" in "\n".join(c.source for c in book.cells)


def test_every_notebook_is_a_chapter_and_every_chapter_a_notebook():
    assert {c.notebook for c in chapters.CHAPTERS} == set(NOTEBOOKS)


# --- the demo: work A's sensor, tables 7.1 and 7.3 ---


def test_demo_is_complete_and_valid(demo):
    assert demo.code == 0, demo.said
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(demo.results)
    assert {c["status"] for c in demo.results["chapters"]} == {"complete"}
    at_rest = [c for c in chapters.CHAPTERS if c.kind in ("static", "thermal")]
    assert len(demo.results["chapters"]) == 2 * len(at_rest)


def test_demo_noise_against_truth(demo, demo_folder):
    truth = json.loads((demo_folder / "truth.json").read_text())["noise"]
    for sensor, axes in truth.items():
        noise = demo.results["sensors"][sensor]["noise"]
        for axis, terms in axes.items():
            found = noise[axis]
            # The figure: N within 0.6 % on all six axes.
            assert found["random_walk"]["value"] == pytest.approx(terms["random_walk"], rel=0.006)
            # Intervals are 95 %; three times their half-width is a bound no sound run exceeds.
            for name in ("bias_instability", "rate_random_walk"):
                if terms[name] is None:
                    assert found[name] is None
                    assert found["upper_bounds"][name] > 0
                else:
                    half = (found[name]["high"] - found[name]["low"]) / 2
                    assert abs(found[name]["value"] - terms[name]) < 3 * half
            assert found["noise_density"]["value"] == pytest.approx(
                np.sqrt(2) * found["random_walk"]["value"], rel=1e-12
            )
            assert found["rate_ramp"] is None
            assert found["quantization"] is None


def test_demo_read_off_shows_its_fault_on_x(demo, demo_folder):
    """Methods A6: read off, B comes out about 1.5× too large on the X axes; the fits do not."""
    truth = json.loads((demo_folder / "truth.json").read_text())["noise"]
    for sensor in ("gyroscope", "accelerometer"):
        methods = demo.results["sensors"][sensor]["noise_methods"]
        true = truth[sensor]["x"]["bias_instability"]
        assert 1.3 < methods["read_off"]["x"]["bias_instability"]["value"] / true < 1.8
        for fit in ("allan_fit", "whittle"):
            assert 0.7 < methods[fit]["x"]["bias_instability"]["value"] / true < 1.3


def test_demo_methods_stand_side_by_side_and_the_fits_agree(demo):
    for found in demo.results["sensors"].values():
        methods = found["noise_methods"]
        assert {"read_off", "psd_read_off", "allan_fit", "whittle"} <= set(methods)
        for axis in "xyz":
            assert found["noise"][axis]["random_walk"] == methods["whittle"][axis]["random_walk"]
            for term in ("random_walk", "bias_instability"):
                one, other = methods["whittle"][axis][term], methods["allan_fit"][axis][term]
                # Spectrum and Allan curve of one record: within their 95 % intervals.
                assert one["low"] <= other["high"]
                assert other["low"] <= one["high"]


def test_demo_holds_no_disturbance(demo):
    for found in demo.results["sensors"].values():
        none = {"x": [], "y": [], "z": []}
        assert found["disturbances"] == {"periodic": none, "shocks": [], "steps": none}


def test_demo_thermal_against_truth(demo):
    jumped = {"gyroscope": "xy", "accelerometer": "z"}
    size = {"gyroscope": {"x": 0.55, "y": 0.12}, "accelerometer": {"z": 0.009}}
    unit = {"gyroscope": np.pi / 180, "accelerometer": 9.80665}
    for sensor, axes in jumped.items():
        thermal = demo.results["sensors"][sensor]["thermal"]
        for axis in "xyz":
            found = thermal[axis]
            best = min(
                c["rms_check"] for c in found["candidates"]
                if c["name"] in ("degree 1", "degree 3", "degree 5")
            )  # fmt: skip
            if axis in axes:
                assert found["model"] == "piecewise"
                # nine tenths of the true jump lie between 24 and 25 °C
                assert found["jump"]["range"] == pytest.approx([24, 25], abs=0.35)
                true = size[sensor][axis] * unit[sensor]
                assert found["jump"]["value"] == pytest.approx(true, rel=0.12)
                assert found["rms_check"] < best / 3, "work A's polynomials are beaten"
            else:
                assert found["model"] == "polynomial"
                assert found["jump"] is None
                assert found["rms_check"] <= 1.1 * best
            assert found["rms_after"] < 0.1 * found["rms_before"]


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
def test_demo_pages_fit_telephone_and_paper(demo, tmp_path):
    pages = [demo.folder / "index.html", *demo.folder.glob("gyroscope/*.html")]
    assert len(pages) == 6
    for page in pages:
        seen = examine(page, tmp_path, [(390, "light")])["390 light"]
        assert (seen["scroll"], seen["wide"]) == (seen["client"], []), page
        assert [v for v in seen["violations"] if v["impact"] in ("serious", "critical")] == [], page
    assert sheets(pages[0], tmp_path) == 1


def test_demo_pages_tell_the_demo_s_facts(demo):
    allan, thermal, noise = demo.page("allan"), demo.page("thermal"), demo.page("noise")
    assert "The bias's change with temperature is subtracted, relative to 32 °C" in allan
    assert "printed (A 7.3)" in allan
    assert "printed (A 7.1)" in demo.page("allan", "accelerometer")
    assert "no rate random walk is visible" in allan
    assert "Axis x: N, B, K visible" in noise
    assert "Axis y: N, B visible; not visible: Q below" in noise
    assert "No shocks are found" in noise
    assert "no periodic component stands out" in noise
    assert "the spectrum scatters about the terms as chance would have it" in noise
    assert "jumps by" in thermal
    assert "On none of the three axes does a jump" not in thermal
    assert "heating only" not in thermal
    for page in demo.folder.rglob("*.html"):
        text = page.read_text()
        assert page.stat().st_size < 3_000_000
        assert not re.search(r"https?://|src=\"//|url\(", text), page
        assert all('alt="' in tag for tag in re.findall(r"<img[^>]*>", text))


# --- other devices: the sentences change with the facts ---


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """No jump, heating only, white noise alone: everything the demo is not."""
    root = tmp_path_factory.mktemp("plain")
    device = write(root / "plain", static=rest(), thermal=sweep(15, 35, both_ways=False))
    return render(device, root / "reports")


def test_plain_device(plain):
    assert plain.code == 0, plain.said
    noise = plain.results["sensors"]["gyroscope"]["noise"]
    for axis in "xyz":
        # 6000 samples of white noise: N to about 1 %, five times that is certain.
        assert noise[axis]["random_walk"]["value"] == pytest.approx(np.radians(0.005), rel=0.06)
        assert noise[axis]["bias_instability"] is None
    thermal, allan = plain.page("thermal"), plain.page("allan")
    assert "The sweep holds heating only" in thermal
    assert "On none of the three axes does a jump predict better" in thermal
    assert "jumps by" not in thermal
    assert "heating and cooling share too little" in thermal
    assert "was not simulated: there is no truth" in thermal
    assert "was not simulated: there is no truth" in allan
    assert "the floor is white up to half the sampling rate" in allan
    noise_page = plain.page("noise")
    assert "the floor is level up to half the sampling rate; every line outside" in noise_page
    assert "was not simulated: there is no truth" in noise_page
    assert "no random walk K is visible" in noise_page
    assert any("heating only" in w["message"] for w in plain.results["warnings"])
    slopes = [plain.results["sensors"]["gyroscope"]["thermal"][a] for a in "xyz"]
    for entry, true in zip(slopes, (0.01, -0.02, 0.005), strict=True):
        assert entry["runs"][0]["temperature_coefficient"] == pytest.approx(
            np.radians(true), rel=0.01
        )


@pytest.fixture(scope="module")
def refused(tmp_path_factory):
    """A sweep over two degrees, and a rest with a missing stretch and a sinusoid."""
    root = tmp_path_factory.mktemp("refused")
    static = rest(seconds=600)
    static["x"] += 0.02 * np.sin(2 * np.pi * 0.2 * static["t"])
    static = {k: np.delete(v, [500, 501, 7000]) for k, v in static.items()}
    device = write(root / "refused", static=static, thermal=sweep(24, 26))
    return render(device, root / "reports")


def test_refused_thermal_and_its_consequences(refused):
    assert refused.code == 0, refused.said
    status, reason = refused.status("gyroscope", "thermal")
    assert status == "refused"
    assert reason.startswith("The temperature moves by 2.0 °C in all")
    assert "Record a sweep over the range of use" in reason
    page = refused.page("thermal")
    assert "The temperature moves by 2.0" in page
    assert "Traceback" not in page
    assert "What it means for this device" not in page, "nothing is said after the refusal"
    allan = refused.page("allan")
    assert "No thermal model of this sensor is at hand (The temperature moves by 2.0" in allan
    assert refused.status("gyroscope", "allan") == ("complete", None)


def test_gaps_are_bridged_and_said(refused):
    messages = [w["message"] for w in refused.results["warnings"]]
    assert any("bridged" in m for m in messages), messages
    assert "bridged" in refused.page("allan")


def test_a_sinusoid_is_told_and_kept_from_the_terms(refused):
    periodic = refused.results["sensors"]["gyroscope"]["disturbances"]["periodic"]
    assert len(periodic["x"]) == 1
    assert periodic["y"] == periodic["z"] == []
    line = periodic["x"][0]
    # A frequency is known to √6 σ/(π A T √n) = 0.00001 Hz, an amplitude to σ √(2/n) = 0.0003 deg/s.
    assert line["frequency"] == pytest.approx(0.2, abs=5e-5)
    assert np.degrees(line["amplitude"]) == pytest.approx(0.02, abs=0.0015)
    noise = refused.results["sensors"]["gyroscope"]["noise"]
    assert noise["x"]["random_walk"]["value"] == pytest.approx(np.radians(0.005), rel=0.06)
    assert noise["x"]["bias_instability"] is None
    page = refused.page("noise")
    assert "gyroscope, axis x: periodic components, kept out of the noise terms: 0.2 Hz" in page
    assert "Axis y: no periodic component stands out" in page
    messages = [w["message"] for w in refused.results["warnings"]]
    assert any(m.startswith("gyroscope, axis x: periodic components") for m in messages)


def test_a_shock_and_a_step_are_told_and_kept_from_the_terms(tmp_path):
    static = rest(seconds=600)
    static["z"][5000:5004] += 3.0  # at 250 s; 130 standard deviations of a sample
    static["y"][8000:] += 0.1  # at 400 s
    report = render(write(tmp_path / "knocked", static=static), tmp_path / "reports")
    found = report.results["sensors"]["gyroscope"]
    shock = found["disturbances"]["shocks"][0]
    assert len(found["disturbances"]["shocks"]) == 1
    assert shock["start"] == pytest.approx(250.0)
    assert shock["end"] == pytest.approx(250.15)
    assert "gyroscope: a shock from 250 s to 250.2 s" in report.page("noise")
    assert found["noise"]["z"]["random_walk"]["value"] == pytest.approx(np.radians(0.005), rel=0.06)


def test_a_floor_that_bends_but_keeps_half_its_power(tmp_path):
    static = rest()
    # |1 + 0.15 e^{−iω}|² falls to 0.55 of its floor at half the sampling rate.
    static["x"][1:] += 0.15 * static["x"][:-1]
    report = render(write(tmp_path / "bent", static=static), tmp_path / "reports", "psd")
    assert report.code == 0, report.said
    page = report.page("psd")
    assert (
        "Axis x: the floor falls towards half the sampling rate, 10 Hz. Nothing above 2 Hz" in page
    )
    assert "half its power at" not in page
    assert re.search(
        r"Axis y: the reading's noise density \(one-sided\) is 0\.\d+ °/s/√Hz \(.+ … .+, the 95 %",
        page,
    )
    assert "What the report states is the likelihood of the chapter on noise identification" in page


def test_a_short_curve_carries_no_polynomial_of_degree_20(tmp_path):
    device = write(tmp_path / "brief", static=rest(seconds=50))  # 1000 samples
    report = render(device, tmp_path / "reports", "curve_fits")
    assert report.code == 0, report.said
    page = report.page("curve_fits")
    assert "Axis x: degree 20 is left out, here and in logarithms: 26 cluster times" in page
    assert "polynomial, degree 10, in logarithms" in page
    assert "polynomial, degree 20" not in page
    assert not re.search(r"\de\+\d", page), "numbers in sentences are plain"


def test_two_rests_stand_beside_each_other(tmp_path):
    device = write(tmp_path / "twice", static=rest(seconds=200))
    columns = np.column_stack(list(rest(seconds=100, seed=8).values()))
    np.savetxt(device / "again.csv", columns, "%.9g", ",", header="t,x,y,z,temp", comments="")
    text = (device / "device.toml").read_text()
    recording = text[text.index("[[recording]]") :]
    (device / "device.toml").write_text(text + recording.replace("static.csv", "again.csv"))
    report = render(device, tmp_path / "reports")
    assert report.code == 0, report.said
    runs = report.results["sensors"]["gyroscope"]["noise"]["x"]["runs"]
    assert [r["file"] for r in runs] == ["static.csv", "again.csv"]
    for run in runs:  # 2000 samples know N to 1.6 %
        assert run["random_walk"]["value"] == pytest.approx(np.radians(0.005), rel=0.08)
    page = report.page("noise")
    assert "N by rest" in page
    assert "whether the noise repeats is not known" not in page


def test_bad_recording_leaves_the_other_chapter_whole(tmp_path):
    static = rest()
    static["y"] = np.full_like(static["y"], 0.25)
    device = write(tmp_path / "bad", static=static, thermal=sweep(10, 40))
    report = render(device, tmp_path / "reports")
    assert report.code == 1
    lines = [line for line in report.said.splitlines() if "constant" in line]
    assert len(lines) == 1
    assert "static.csv" in lines[0]
    assert "column 'y'" in lines[0] or "y" in lines[0]
    assert "Traceback" not in report.said
    assert report.status("gyroscope", "thermal") == ("complete", None)
    assert report.status("gyroscope", "allan")[0] == "failed"
    assert not (report.folder / "gyroscope" / "allan.html").exists()
    assert not (report.folder / "gyroscope" / "allan.json").exists()
    assert (report.folder / "gyroscope" / "allan.ipynb").exists()
    index = (report.folder / "index.html").read_text()
    assert "constant" in index
    assert "gyroscope/allan.ipynb" in index


def test_short_rest_is_refused(tmp_path):
    device = write(tmp_path / "short", static=rest(seconds=25))  # 500 samples
    report = render(device, tmp_path / "reports")
    assert report.code == 0, report.said
    status, reason = report.status("gyroscope", "allan")
    assert status == "refused"
    assert reason == (
        "The record has 500 samples; the Allan deviation needs at least 1000. "
        "Record a rest of one hour or more."
    )


# --- real recordings ---


@pytest.mark.parametrize("name", ["adis16405-1", "cats-tag", "xsens-mti"])
def test_real_device_goes_through(name, real_data, tmp_path):
    report = render(real_data / name, tmp_path / "reports")
    assert report.code == 0, report.said
    pages = [*tmp_path.joinpath("reports").rglob("*.html")]
    assert len(pages) == 2 + len(report.results["chapters"])
    for page in pages if CHROMIUM else ():  # tests/test_browser.py says where there is none
        opened = Opened(page, tmp_path)
        assert (opened.console, opened.requests) == ([], set()), page
    assert {c["status"] for c in report.results["chapters"]} == {"complete"}
    if name == "xsens-mti":
        return  # its numbers: test_calibration.py
    if name == "adis16405-1":
        allan = report.results["sensors"]["gyroscope"]["allan"]
        at = allan["tau"].index(1.0)
        # What is known of this recording, to within 2 %.
        for axis, known in zip("xyz", (0.041, 0.043, 0.039), strict=True):
            assert np.degrees(allan[axis][at]) == pytest.approx(known, rel=0.02)
        disturbances = report.results["sensors"]["accelerometer"]["disturbances"]
        starts = [s["start"] for s in disturbances["shocks"]]
        assert starts[:2] == pytest.approx([3.3, 6.8], abs=0.1)
        for axis in "xyz":
            periodic = disturbances["periodic"][axis]
            assert any(p["frequency"] == pytest.approx(0.56, abs=0.01) for p in periodic)
        page = report.page("noise", "accelerometer")
        assert "accelerometer, axis x: periodic components" in page
        assert "accelerometer: a shock from 3.3" in page
    else:
        thermal = report.results["sensors"]["gyroscope"]["thermal"]
        assert thermal["y"]["degree"] == 1
        assert [r["temperature_coefficient"] * 1e3 for r in thermal["y"]["runs"]] == pytest.approx(
            [0.45, 0.45], abs=0.02
        )
        page = report.page("thermal")
        assert re.search(r"Axis x: straight-line coefficient by run .*it does not repeat", page)
        assert re.search(r"Axis y: straight-line coefficient by run .*it repeats", page)
