"""The chapter on a device's integrated attitude: truth, real data, and recordings with something wrong."""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path

import flights
import jsonschema
import numpy as np
import pandas as pd
import pytest
from devices import Report, ended, read_chapter, render
from flights import BIAS, flight

import sensorbook
from sensorbook.attitude.kalman import mekf
from sensorbook.attitude.sources import of_device
from sensorbook.cli import main
from sensorbook.reporting.results import SCHEMA

SLUG = "integrated_attitude"
RATES = ("0.1", "0.2", "1.0", "2.0", "10.0")
# Mean length of an error of 0.1° an axis, √(8/π): what the made-up references err by themselves.
REFERENCE_MEAN = 0.16


def page(report: Report) -> str:
    return report.page(SLUG, "attitude")


def warnings(report: Report) -> list[str]:
    return [w["message"] for w in report.results["warnings"]]


def methods(report: Report) -> dict:
    return report.results["attitude"]["methods"]


def errors(report: Report, method: str, key: str = "mean_error_deg") -> list[float]:
    """By rising reference rate."""
    found = methods(report)[method]
    return [found[rate][key] for rate in sorted(found, key=float)]


def complete(report: Report) -> None:
    assert report.status("attitude", SLUG) == ("complete", None)
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(report.results)


def bias_off(found: dict, true) -> np.ndarray:
    """(3,) of a recorded bias from the true one, in its standard errors."""
    return np.abs(np.subtract(found["value"], true)) / found["std"]


# ---- the demo ----


def test_demo_is_complete_and_has_every_method(flown):
    assert flown.code == 0, flown.said
    complete(flown)
    found = methods(flown)
    assert set(found["integration"]) == {"never"}
    of_reference = {"reset", "reset_and_rate", "complementary", "mekf", "smoother"}
    of_vectors = {"complementary_vectors", "mekf_vectors", "smoother_vectors"}
    assert set(found) == {"integration"} | of_reference | of_vectors
    for method in of_reference | of_vectors:
        assert set(found[method]) == set(RATES), method


def test_demo_is_tuned_by_the_noise_chapter(flown):
    tuning = flown.results["attitude"]["tuning"]
    assert tuning["reference"] == "reference"
    noise = flown.results["sensors"]["gyroscope"]["noise"]
    for axis, value in zip("xyz", tuning["random_walk"], strict=True):
        assert value == pytest.approx(noise[axis]["random_walk"]["value"], rel=1e-6)
    assert "At rest, the noise chapter found N" in page(flown)


def test_demo_holds_its_truth(flown, flown_folder):
    truth = json.loads((flown_folder / "truth.json").read_text())
    found = flown.results["attitude"]
    # Of three numbers of one seed one is beyond 3.5 standard errors in a thousand.
    assert (bias_off(found["bias"], truth["bias"]) < 3.5).all()
    # At N = 0.0316 rad/s/√Hz over 180 s, N/√T = 0.0024 rad/s is what white noise leaves of it.
    assert max(found["bias"]["std"]) < 0.004
    # 15 ms are over three standard errors: 0.22° about each axis, of 0.65° a step by noise.
    assert found["delay_s"] == pytest.approx(truth["delay"], abs=0.015)
    # The reference's error does not show beside this gyroscope's noise; it is bounded from above.
    assert truth["reference_error"] < found["tuning"]["reference_std"] < np.radians(0.3)


def test_demo_errs_less_with_more_references_and_least_by_the_smoother(flown):
    for method in ("reset", "mekf", "smoother"):
        assert (np.diff(errors(flown, method)) < 0).all(), method
    mekf_errors = np.array(errors(flown, "mekf"))
    assert (mekf_errors < errors(flown, "reset")).all()
    assert (np.array(errors(flown, "smoother")) < mekf_errors).all()
    nees = np.array(errors(flown, "mekf", "nees"))
    # 3 where all is white. At 0.1 Hz 18 independent updates scatter it by √(2/54) of itself; the
    # reference's error is taken too large, which makes it smaller at high rates.
    assert ((nees > 1) & (nees < 4.5)).all()
    alone = methods(flown)["integration"]["never"]["mean_error_deg"]
    assert alone > 5 * max(errors(flown, "reset"))


def test_the_two_lines_give_the_true_attitude(flown_folder):
    """What the page ends with, against the truth that no chapter reads."""
    found = mekf(*of_device(sensorbook.load(str(flown_folder))))
    table = pd.read_csv(flown_folder / "truth.csv")
    total = np.degrees(
        np.linalg.norm(found.errors(table[["qx", "qy", "qz", "qw"]].to_numpy()), axis=1)
    )
    outage = (table["t"] >= 12) & (table["t"] < 20)
    # The references' 0.05° an axis is 0.08° in all; in their short gaps white noise adds to it.
    assert total[~outage].mean() < 0.15
    # White noise over 8 s: 0.0316 √8 rad = 5° about each axis at its end.
    assert total[outage].max() < 15


def test_demo_page_says_what_was_found(flown):
    text = page(flown)
    assert "378 of the reference's 5144 rows (7.3 %) hold no attitude: left out." in text
    assert "as means over the interval before the stamp are." in text
    # All but the last, which the delay takes beyond the end.
    assert "Gravity and field told an attitude 5143 times" in text
    # Eight seconds without references, on the recording and in work C's experiment on its rates.
    for words in (
        r"the reset errs by ([\d.]+)°, at its end by ([\d.]+)°",
        r"angle 1 errs by ([\d.]+)° before the outage, ([\d.]+)° at its end",
    ):
        before, end = map(float, re.search(words, text).groups())
        assert end > 3 * before, words
    assert re.search(r"Over work C's table the reset is (\d\.\d\d, ){4}\d\.\d\d", text)
    assert "{" not in text.split("In two lines")[1].split("import")[0]
    assert "nan" not in text.lower().split()
    index = (flown.folder / "index.html").read_text()
    assert "Mean error of the attitude along the trajectory in degrees" in index
    assert "Kalman filter (MEKF)" in index


# ---- a real recording ----


def test_real_recording(real_data, tmp_path):
    """Goals on BROAD's trial 2: mean errors in degrees at 0.1, 0.2, 1 and 2 references a second."""
    report = render(real_data / "broad-slow", tmp_path)
    assert report.code == 0, report.said
    complete(report)
    found = report.results["attitude"]
    for rate, goal in {"0.1": 0.58, "0.2": 0.50, "1.0": 0.37, "2.0": 0.25}.items():
        assert found["methods"]["mekf"][rate]["mean_error_deg"] <= goal, rate
    expected = np.radians([0.20, 0.12, -0.23])
    assert found["bias"]["value"] == pytest.approx(expected, abs=np.radians(0.03))
    assert 0.015 < found["delay_s"] < 0.025
    assert any(
        m.startswith("171 of the reference's 5324 rows (3.2 %) hold") for m in warnings(report)
    )
    assert "There is no noise chapter's record of this gyroscope's noise at rest." in page(report)


# ---- made-up devices: what is complete or refused ----


def made() -> dict[str, dict]:
    """Tables and settings of small devices, by name."""
    whole = flight(40, 1)
    gyroscope, reference = whole.tables["gyroscope"], whole.tables["reference"]

    broken = whole.only("gyroscope", "reference")
    rows = broken["gyroscope"]
    rows[[300, 301]] = rows[[301, 300]]
    rows[400, 0] = rows[399, 0]
    rows[600:625, 1:] = np.nan
    shorter = flight(25, 2).tables["gyroscope"] + np.array([100.0, 0, 0, 0])

    gaps = flight(50, 3).only("gyroscope", "reference")
    for sensor, table in gaps.items():
        time = table[:, 0]
        lost = (time >= 12) & (time < 17)
        if sensor == "gyroscope":
            lost |= (time >= 30) & (time < 35)
        gaps[sensor] = table[~lost]

    rare = flight(60, 4).only("gyroscope", "reference")
    rare["reference"] = rare["reference"][7::25]
    rarest = flight(800, 5, rate=2, slower=8).only("gyroscope", "reference")
    rarest["reference"] = rarest["reference"][::40]
    return {
        "alone": {"tables": whole.only("gyroscope")},
        "level": {"tables": whole.only("gyroscope", "accelerometer")},
        "vectors": {"tables": whole.only("gyroscope", "accelerometer", "magnetometer")},
        "another": {"tables": {"gyroscope": gyroscope}
                    | flight(40, 6, slower=1.37).only("reference")},
        "three": {"tables": {"gyroscope": gyroscope, "reference": reference[::400]}},
        "broken": {"tables": broken, "runs": [shorter]},
        "gaps": {"tables": gaps},
        "rare": {"tables": rare},
        "rarest": {"tables": rarest},
    }  # fmt: skip


def rendered(folder: Path, devices: dict[str, dict]) -> dict[str, Report]:
    """The reports of devices, two at a time, by name; `said` and the exit code are of all."""
    paths = [str(flights.write(folder / "data" / name, **about)) for name, about in devices.items()]
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(["report", *paths, "--out", str(folder / "out"), "--jobs", "2"])
    return {name: Report(code, said.getvalue(), folder / "out" / name) for name in devices}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    reports = rendered(tmp_path_factory.mktemp("small"), made())
    for report in reports.values():
        assert report.code == 0, report.said
        jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(report.results)
    return reports


@pytest.mark.parametrize(
    ("name", "reason", "remedy"),
    [
        (
            "alone",
            "Nothing beside the gyroscope tells the attitude.",
            "Record accelerometer and magnetometer with it",
        ),
        ("level", "one of accelerometer and magnetometer alone leaves a turn open", "Record"),
        (
            "another",
            "The gyroscope and the reference do not tell of the same motion",
            "Give recordings of one body with one clock",
        ),
        ("three", "3 references do not tell how good they and the gyroscope are.", "Record 30"),
    ],
)
def test_what_cannot_be_told_is_refused(small, name, reason, remedy):
    status, told = small[name].status("attitude", SLUG)
    assert status == "refused"
    assert reason in told
    assert remedy in told
    assert small[name].results["attitude"] == {"reason": told}
    assert reason in page(small[name])
    if name == "three":
        (warning,) = warnings(small[name])
        assert warning.startswith("There are too few references to tell the readings' delay")


def test_gravity_and_field_show_no_error(small):
    report = small["vectors"]
    complete(report)
    found = report.results["attitude"]
    entries = [(m, r, e) for m, by_rate in found["methods"].items() for r, e in by_rate.items()]
    assert {rate for _, rate, _ in entries} == {"never", *RATES}
    for method, rate, entry in entries:
        for key in ("mean_error_deg", "mean_euler_error_deg", "rms_error_deg", "nees", "samples"):
            assert entry[key] is None, (method, rate, key)
        assert (entry["expected_rms_deg"] is not None) == (method in ("mekf", "smoother"))
    assert (np.diff(errors(report, "mekf", "expected_rms_deg")) < 0).all()
    assert found["tuning"]["reference"] == "gravity and field"
    assert found["delay_s"] == 0
    assert (bias_off(found["bias"], BIAS) < 3.5).all()
    text = page(report)
    assert "nothing here shows the true one" in text
    assert "Nothing here shows the error in an outage." in text
    assert "magnetic north for north" in text
    assert "off on average" not in text
    assert "none is left to judge" not in text


def test_broken_stamps_and_rates_are_told_and_passed_over(small):
    report = small["broken"]
    complete(report)
    told = warnings(report)
    assert "2 rows of the gyroscope whose time stamp does not advance: set aside." in told
    assert "25 of the gyroscope's 1000 rows (2.5 %) hold no rate: left out." in told
    (gap,) = [m for m in told if "cannot be bridged" in m]
    assert gap.startswith("A gap in the gyroscope's readings, of 1.04 s at 23.96 s,")
    assert "Of 2 runs this page is about the longest." in told
    entry = methods(report)["mekf"]["10.0"]
    # One of 2.5 references is given, the others judge; 27 rows have no rate or no order.
    assert entry["samples"] + entry["updates"] == pytest.approx(973, abs=5)
    assert min(errors(report, "mekf")) < 1.3 * REFERENCE_MEAN
    assert (bias_off(report.results["attitude"]["bias"], BIAS) < 3.5).all()
    (run,) = {i["file"] for i in report.results["inputs"] if i["samples"] == 625}
    assert run == "run2.csv"


def test_after_a_gap_the_errors_are_small_again(small):
    report = small["gaps"]
    complete(report)
    (told,) = [m for m in warnings(report) if "cannot be bridged" in m]
    assert told.startswith("2 gaps in the gyroscope's readings, the longest of 5.04 s at")
    # The path turns by more than 90° in either gap. One reference after it, that is forgotten.
    assert errors(report, "mekf")[-1] < 1.3 * REFERENCE_MEAN
    assert errors(report, "smoother")[-1] < 1.3 * REFERENCE_MEAN
    for method in ("reset", "reset_and_rate", "complementary"):
        assert errors(report, method)[-1] < 0.5, method
    # Without a reference nothing is known after the first gap, at 12 s: that judges no method.
    assert methods(report)["integration"]["never"]["samples"] == 299
    assert methods(report)["reset"]["0.1"]["mean_error_deg"] < 5
    assert (bias_off(report.results["attitude"]["bias"], BIAS) < 3.5).all()


def test_rare_references_allow_few_rates(small):
    complete(small["rare"])
    assert set(methods(small["rare"])["mekf"]) == {"0.1", "0.2", "1.0"}
    complete(small["rarest"])
    assert set(methods(small["rarest"])["mekf"]) == {"0.05"}
    for name in ("rare", "rarest"):
        found = small[name].results["attitude"]["bias"]
        # Within 0.02 °/s: 60 s and 800 s of a gyroscope of 0.005 °/s/√Hz beside 0.1°.
        assert found["value"] == pytest.approx(BIAS, abs=np.radians(0.02)), name
        assert "Where all references are given none is left to judge" in page(small[name]), name
    # 40 references do not tell their error from the gyroscope's; what is taken is no smaller than it.
    assert small["rarest"].results["attitude"]["tuning"]["reference_std"] > flights.REFERENCE_ERROR
    assert "too few references to tell one from the other" in page(small["rarest"])
    given = errors(small["rare"], "mekf")
    assert given[2] is None
    assert given[0] > given[1] > 0
    assert errors(small["rarest"], "smoother") == [None]
    assert "off on average" in page(small["rarest"])
    assert "told by the reference, 60 times" in page(small["rare"])
    assert "told by the reference, 40 times" in page(small["rarest"])


def test_the_filter_s_errors_are_as_large_as_it_says(small):
    """White noise on both sides, and what judges has its own error: 3 on average at any rate."""
    for name in ("broken", "gaps"):
        nees = methods(small[name])["mekf"]["10.0"]["nees"]
        # Two thirds of it is the judge's white error, of 500 stamps: ± 0.2 by chance.
        assert 2.2 < nees < 4.0, name
        assert "trusts itself too much" not in page(small[name])


@pytest.mark.parametrize("name", ["vectors", "three", "broken", "gaps", "rare", "rarest"])
def test_numbers_read_as_numbers(small, name):
    text = page(small[name]).split("In two lines import")[0]
    assert not re.search(r"[ (]-\d", text), "a hyphen for a minus"
    assert not re.search(r"−0(\.0+)?\b(?!\.)", text), "minus zero"
    assert not re.search(r"\b(nan|inf|None)\b", text)
    assert "the gravity" not in text


# ---- made-up devices: what is wrong in the declaration ----


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    whole = flight(40, 7).only("gyroscope", "reference")
    # 2 °/s rms: read as rad/s, a rate that gyroscopes do reach.
    slow = flight(60, 8, slower=20).only("gyroscope", "reference")
    slow["gyroscope"][:, 1:] *= 180 / np.pi
    long = {sensor: table.copy() for sensor, table in whole.items()}
    long["reference"][:, 1:] *= 2
    return rendered(
        tmp_path_factory.mktemp("wrong"),
        {
            "sense": {"tables": whole, "sense": 'quaternion = "reference_to_body"'},
            "unit": {"tables": slow},
            "length": {"tables": long},
        },
    )


@pytest.mark.parametrize(
    ("name", "message", "mend"),
    [
        (
            "sense",
            "reference: quaternion: the reference turns the other way",
            'write quaternion = "reference_to_body" where it says "body_to_reference", or the reverse',
        ),
        (
            "unit",
            "gyroscope: unit: the rates are",
            'write unit = "deg/s": the rates are declared as rad/s and are in deg/s',
        ),
        (
            "length",
            "row 1 has the length 2, where a quaternion has 1",
            "name the columns that hold w, x, y and z of unit quaternions",
        ),
    ],
)
def test_wrong_declarations_fail_with_their_mend(wrong, name, message, mend):
    report = wrong[name]
    assert report.code == 1
    (line,) = [line for line in report.said.splitlines() if line.startswith(f"{name}: ")]
    assert message in line
    assert mend in line
    assert "Traceback" not in report.said
    assert "a fault in sensorbook" not in report.said
    assert report.status("attitude", SLUG)[0] == "failed"
    assert not (report.folder / "attitude" / f"{SLUG}.html").exists()
    assert "attitude" not in report.results


def test_parameters_that_make_no_sense(tmp_path):
    folder = flights.write(tmp_path / "device", flight(40, 9).only("gyroscope", "reference"))
    status, reason = ended(SLUG, tmp_path, device=str(folder), bias_std_deg_s=0.0, most=5)
    assert status == "failed"
    first, second = reason.splitlines()
    assert "bias_std_deg_s: standard error is 0 °/s — give more than 0" in first
    assert "most: number of readings is 5 — give a whole number, 1000 to 2e+06" in second


# ---- records of other chapters ----


def test_calibration_is_applied_and_the_record_cut(tmp_path):
    matrix = np.eye(3) + np.array([[0.06, 0.02, 0.0], [0.0, -0.05, 0.01], [0.03, 0.0, 0.04]])
    bias = np.radians([1.0, -2.0, 0.5])
    tables = flight(50, 10).only("gyroscope", "reference")
    rates = tables["gyroscope"]
    rates[:, 1:] = rates[:, 1:] @ matrix.T + bias
    folder = flights.write(tmp_path / "device", tables)
    calibration = {
        "method": "multi_position",
        "matrix": matrix.tolist(),
        "bias": bias.tolist(),
        "unit": "rad/s",
    }
    record = tmp_path / "gyroscope_calibration.json"
    record.write_text(
        json.dumps({"status": "complete", "results": {"calibration": calibration}}),
    )
    found, text = read_chapter(
        SLUG, tmp_path, device=str(folder), most=1000, gyroscope_calibration_record=str(record)
    )
    assert (
        "The gyroscope is corrected with the calibration (multi position) of this device." in text
    )
    assert ", after the calibration." in text
    # Left uncorrected, scale factors and axes would be warned of.
    assert [w["message"] for w in found["warnings"]] == [
        "The first 1000 of 1250 readings are taken."
    ]
    assert (bias_off(found["results"]["bias"], BIAS) < 3.5).all()
    assert found["results"]["methods"]["mekf"]["10.0"]["mean_error_deg"] < 1.3 * REFERENCE_MEAN
    assert found["results"]["methods"]["mekf"]["10.0"]["samples"] <= 1000


def test_a_camera_s_record_aids(tmp_path):
    whole = flight(70, 11)
    folder = flights.write(
        tmp_path / "device", whole.only("gyroscope"), start="2026-03-01T12:00:00"
    )
    taken = np.arange(20, len(whole.true), 50)
    seen = flights.measured(np.random.default_rng(12), whole.true[taken])
    stamps = np.datetime64("2026-03-01T12:00:00", "ms") + (taken * 40).astype("timedelta64[ms]")
    covariance = (flights.REFERENCE_ERROR**2 * np.eye(3)).tolist()
    images = [
        {
            "image": f"{k:03d}.png",
            "status": "ok",
            "partner": None,
            "time": f"{stamp}Z",
            "quaternion": quaternion.tolist(),
            "attitude_std_deg": [0.1, 0.1, 0.1],
            "attitude_covariance": covariance,
        }
        for k, (stamp, quaternion) in enumerate(zip(stamps, seen, strict=True))
    ]
    images.append({"image": "dark.png", "status": "no solution", "time": None, "quaternion": None})
    record = tmp_path / "horizon_sun_camera.json"
    record.write_text(json.dumps({"status": "complete", "results": {"images": images}}))
    found, text = read_chapter(
        SLUG, tmp_path, device=str(folder), horizon_sun_camera_record=str(record)
    )
    assert f"The attitude is told by the camera, {len(taken)} times." in text
    results = found["results"]
    assert results["tuning"]["reference"] == "camera"
    assert set(results["methods"]["mekf"]) == {"0.1", "0.2"}
    for entry in results["methods"]["mekf"].values():
        assert entry["mean_error_deg"] is None
        assert entry["expected_rms_deg"] > 0
    assert (bias_off(results["bias"], BIAS) < 3.5).all()
    assert "Nothing here shows the error in an outage." in text
