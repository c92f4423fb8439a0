"""The calibration chapters: numbers against simulated truth and real data, and sentences by the facts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from browser import CHROMIUM, examine
from devices import render

from sensorbook.reporting import chapters
from sensorbook.simulate.positions import EDGES, FACES, RATE, hand_moved

SCHEMA = Path(chapters.__file__).with_name("results.schema.json")
DEVICE = """\
schema = 1
id = "{id}"
name = "{id}"
{site}"""
RECORDING = """
[[recording]]
sensor = "{sensor}"
kind = "{kind}"
file = "{file}"
rate = {rate}
unit = "{unit}"
columns = {{ x = "{p}x", y = "{p}y", z = "{p}z"{more} }}
{keys}"""


def write(
    folder: Path, kind: str, tables: dict[str, dict], site="", unit="m/s^2", keys="", gyro=True
):
    """A device of one kind, a file a table; columns ax … gz and, where there, temperature."""
    folder.mkdir(parents=True)
    text = DEVICE.format(id=folder.name, site=site)
    for file, table in tables.items():
        head = ",".join(table)
        np.savetxt(
            folder / file,
            np.column_stack(list(table.values())),
            "%.9g",
            ",",
            header=head,
            comments="",
        )
        more = ', temperature = "temperature"' if "temperature" in table else ""
        for sensor, u in (("accelerometer", unit), ("gyroscope", "rad/s"))[: 1 + gyro]:
            text += RECORDING.format(
                sensor=sensor,
                kind=kind,
                file=file,
                rate=RATE,
                unit=u,
                p=sensor[0],
                more=more,
                keys=keys,
            )
    (folder / "device.toml").write_text(text)
    return folder


def table_of(made: dict) -> dict:
    return {
        f"{s[0]}{axis}": made[s][:, k]
        for s in ("accelerometer", "gyroscope")
        for k, axis in enumerate("xyz")
    }


def holds(calibration: dict, truth: dict) -> list[bool]:
    """For each parameter whether its 95 % interval, doubled, holds the truth: 1 in 10 000 does not."""
    m, s = np.array(calibration["matrix"]), np.array(calibration["std"]["matrix"])
    free = s > 0
    errors = np.r_[(m - truth["matrix"])[free], np.subtract(calibration["bias"], truth["bias"])]
    std = np.r_[s[free], calibration["std"]["bias"]]
    return list(np.abs(errors) < 2 * calibration["interval_factor"] * std)


# --- the demos ---


@pytest.mark.parametrize("name", ["moved", "phone"])
def test_demo_is_complete_and_valid(name, request):
    report = request.getfixturevalue(name)
    assert report.code == 0, report.said
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(report.results)
    assert [c["status"] for c in report.results["chapters"]] == ["complete"] * 3
    accelerometer = report.results["sensors"]["accelerometer"]
    assert accelerometer["calibration"]["method"] == "multi_position"
    assert set(accelerometer["calibration_methods"]) == {
        "six_position",
        "recursive",
        "multi_position",
    }


@pytest.mark.parametrize("name", ["moved", "phone"])
def test_demo_against_truth(name, request):
    report = request.getfixturevalue(name)
    folder = request.getfixturevalue(f"{name}_folder")
    truth = json.loads((folder / "truth.json").read_text())["calibration"]
    sensors = report.results["sensors"]
    assert all(holds(sensors["accelerometer"]["calibration"], truth["accelerometer"]))
    assert all(holds(sensors["gyroscope"]["calibration"], truth["gyroscope"]))
    for method in ("six_position", "recursive"):
        assert all(
            holds(sensors["accelerometer"]["calibration_methods"][method], truth["accelerometer"])
        )
    page = report.page("gyroscope_calibration")
    assert "holds the truth" in page


def test_demo_g_sensitivity_is_found_on_its_axis(moved, moved_folder):
    truth = json.loads((moved_folder / "truth.json").read_text())["calibration"]["gyroscope"]
    found = moved.results["sensors"]["gyroscope"]["calibration"]
    g, std = found["g_sensitivity"], found["std"]["g_sensitivity"]
    assert np.abs(np.subtract(g, truth["g_sensitivity"]) / std).max() < 4
    assert g[1] > 10 * std[1]
    assert "The diagonal is visible" in moved.page("gyroscope_calibration")


def test_demo_pages_tell_the_demo_s_facts(moved, phone):
    page = moved.page("multi_position", "accelerometer")
    assert "normal gravity (WGS 84) at 39.89° N, 900 m" in page
    assert "25 rests" in page
    assert "nine parameters can be told" in page
    assert "On the recording kept for checking" not in page
    assert "take the levelling for granted" in page
    phone_page = phone.page("multi_position", "accelerometer")
    assert "23 rests" in phone_page
    assert "on the recording kept for checking" in phone_page
    assert re.search(r"Error of means, mm/s²: MP [\d.]+ < (SPS|RLS)", phone_page)
    assert "here the white noise of the samples is so large" in phone_page
    six = moved.page("six_position", "accelerometer")
    assert "nine parameters serve" in six
    # 2 · 10⁻² m/s² and more before, some tenths of mm/s² after.
    calibration = moved.results["sensors"]["accelerometer"]["calibration"]
    assert calibration["rms_check"] < calibration["rms_before"] / 100


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
def test_demo_pages_fit_a_telephone(moved, tmp_path):
    pages = [moved.folder / "index.html", *moved.folder.glob("*/*.html")]
    assert len(pages) == 4
    for page in pages:
        seen = examine(page, tmp_path, [(390, "light")])["390 light"]
        assert (seen["scroll"], seen["wide"]) == (seen["client"], []), page
        assert [v for v in seen["violations"] if v["impact"] in ("serious", "critical")] == [], page


# --- what is refused, and what is wrong ---


def made(seed, directions=(*FACES, *EDGES), levelling=4.0, **more):
    return hand_moved(np.random.default_rng([seed, 7]), directions, levelling, **more)


def test_six_faces_are_refused_with_what_to_add(tmp_path):
    folder = write(
        tmp_path / "faces", "positions", {"log.csv": table_of(made(1, FACES, 1.0, initial=0.0))}
    )
    report = render(folder, tmp_path / "reports")
    assert report.code == 0
    for sensor, chapter in (
        ("accelerometer", "multi_position"),
        ("gyroscope", "gyroscope_calibration"),
    ):
        status, reason = report.status(sensor, chapter)
        assert status == "refused"
        assert "6 rests in 6 distinct directions do not determine 9 parameters" in reason
        assert "Record them again with these positions added" in reason
        assert report.results["sensors"][sensor]["calibration"] == {
            "method": None,
            "reason": reason,
        }


def test_three_positions(tmp_path):
    folder = write(
        tmp_path / "three", "positions", {"log.csv": table_of(made(2, FACES[::2], initial=0.0))}
    )
    assert (
        "3 rests in 3 distinct directions"
        in render(folder, tmp_path / "r").status("accelerometer", "multi_position")[1]
    )


def test_all_positions_alike(tmp_path):
    folder = write(
        tmp_path / "alike",
        "positions",
        {"log.csv": table_of(made(3, FACES[:1] * 12, 1.0, initial=0.0))},
    )
    reason = render(folder, tmp_path / "r").status("accelerometer", "multi_position")[1]
    assert "in 1 distinct direction" in reason
    assert "alike within 15°" in reason


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [
        (1 / 9.80665, "m/s^2", 'that is 1 g: declare unit = "g"'),
        (1.0, "g", 'gravity was multiplied twice: declare unit = "m/s^2"'),
    ],
)
def test_wrong_unit_by_gravity(tmp_path, factor, unit, words):
    table = table_of(made(4))
    table |= {a: table[a] * factor for a in ("ax", "ay", "az")}
    report = render(
        write(tmp_path / "unit", "positions", {"log.csv": table}, unit=unit), tmp_path / "r"
    )
    assert report.code == 1
    assert "log.csv: unit: at rest the accelerometer reads" in report.said
    assert words in report.said
    assert "Traceback" not in report.said


def test_saturated_at_one_g(tmp_path):
    table = table_of(made(5))
    table |= {a: np.clip(table[a], -9.6, 9.6) for a in ("ax", "ay", "az")}
    report = render(write(tmp_path / "clipped", "positions", {"log.csv": table}), tmp_path / "r")
    assert report.code == 0
    messages = [w["message"] for w in report.results["warnings"]]
    assert any("is saturated" in m and "choose a wider range" in m for m in messages), messages


def labelled(folder, spans, names):
    lines = [f"{n},{a},{b}" for n, (a, b) in zip(names, spans, strict=True)]
    (folder / "labels.csv").write_text("label,start,end\n" + "\n".join(lines) + "\n")


def test_a_position_lost_in_motion_is_named(tmp_path):
    one = made(6)
    rests = [(r["start"] + 0.3, r["end"] - 0.3) for r in one["rests"]]
    rests[4] = (rests[4][0], rests[5][0] - 0.5)  # reaches over the motion that follows
    folder = write(
        tmp_path / "lost", "positions", {"log.csv": table_of(one)}, keys='segments = "labels.csv"'
    )
    labelled(folder, rests, [f"p{k}" for k in range(len(rests))])
    report = render(folder, tmp_path / "r")
    messages = [w["message"] for w in report.results["warnings"]]
    assert any(re.match(r"(Position|Rest) p4 .*the device was in motion", m) for m in messages), (
        messages
    )
    assert report.status("accelerometer", "multi_position")[0] == "complete"


def test_a_label_that_contradicts_the_reading(tmp_path):
    one = made(7, FACES, 0.2, initial=0.0)
    folder = write(
        tmp_path / "label",
        "six_position",
        {"log.csv": table_of(one)},
        keys='segments = "labels.csv"',
        gyro=False,
    )
    rests = [(r["start"] + 0.3, r["end"] - 0.3) for r in one["rests"]]
    labelled(folder, rests, ["z up", "y up", "z down", "y down", "x up", "x down"])
    report = render(folder, tmp_path / "r")
    assert report.code == 1
    assert "is labelled 'y up', but by its readings" in report.said
    assert "mend the label, or the columns' order and signs" in report.said


def test_a_face_that_is_missing_is_named(tmp_path):
    one = made(8, FACES[:5], 0.2, initial=0.0)
    folder = write(tmp_path / "five", "six_position", {"log.csv": table_of(one)}, gyro=False)
    status, reason = render(folder, tmp_path / "r").status("accelerometer", "six_position")
    assert status == "refused"
    assert "Of the six positions x down is missing" in reason


def test_six_positions_stand_where_many_were_refused(tmp_path):
    one = table_of(made(9, FACES, 0.2, initial=0.0))
    folder = write(tmp_path / "both", "six_position", {"log.csv": one}, gyro=False)
    text = (folder / "device.toml").read_text()
    (folder / "device.toml").write_text(
        text + text[text.index("\n[[") :].replace("six_position", "positions")
    )
    report = render(folder, tmp_path / "r")
    assert report.status("accelerometer", "multi_position")[0] == "refused"
    assert report.results["sensors"]["accelerometer"]["calibration"]["method"] == "six_position"


def test_a_badly_levelled_table_is_warned_of(tmp_path):
    one = table_of(made(10, FACES, 1.5, initial=0.0))
    report = render(
        write(tmp_path / "tilted", "six_position", {"log.csv": one}, gyro=False), tmp_path / "r"
    )
    assert any("misalignments are worth little" in w["message"] for w in report.results["warnings"])


def test_several_temperatures(tmp_path):
    rng = np.random.default_rng(11)
    errors = made(11)["errors"]
    tables = {}
    for k, warmth in enumerate((10.0, 25.0, 40.0, 17.0, 33.0)):
        bias = errors["accelerometer"]["bias"] + np.array([0.004, 0, -0.002]) * (warmth - 25)
        here = errors | {"accelerometer": errors["accelerometer"] | {"bias": bias}}
        one = table_of(made(100 + k, errors=here, initial=5.0))
        tables[f"at{k}.csv"] = one | {
            "temperature": warmth + 0.05 * rng.standard_normal(len(one["ax"]))
        }
    report = render(write(tmp_path / "warm", "positions", tables, gyro=False), tmp_path / "r")
    assert report.code == 0, report.said
    found = report.results["sensors"]["accelerometer"]["calibration"]
    assert found["temperature"]["degree"] == 1
    np.testing.assert_allclose(
        found["temperature"]["bias_coefficients"][0], [0.004, 0, -0.002], atol=2e-4
    )
    assert "degree 1 is used, from" in report.page("multi_position", "accelerometer")


def test_without_an_accelerometer_the_gyroscope_is_refused(tmp_path):
    folder = write(tmp_path / "alone", "positions", {"log.csv": table_of(made(12))})
    text = (folder / "device.toml").read_text()
    head, _, gyroscope = text.split("\n[[recording]]")
    (folder / "device.toml").write_text(head + "\n[[recording]]" + gyroscope)
    status, reason = render(folder, tmp_path / "r").status("gyroscope", "gyroscope_calibration")
    assert status == "refused"
    assert "no accelerometer in the same time base" in reason


# --- real recordings ---


def test_xsens(real_data, tmp_path):
    """Figures of the recordings' README; the goals are those of the chapters."""
    report = render(real_data / "xsens-mti", tmp_path / "reports")
    assert report.code == 0, report.said
    found = report.results["sensors"]["accelerometer"]["calibration"]
    assert found["rms_after"] <= 0.0011
    assert found["rms_check"] <= 0.0015
    np.testing.assert_allclose(415 * np.diag(found["matrix"]), [415, 413, 415], rtol=2e-3)
    assert found["chi_square"] == pytest.approx(15, rel=0.3)
    turned = report.results["sensors"]["gyroscope"]["calibration"]
    assert turned["direction_error_after_deg"] <= 0.55
    assert turned["direction_error_check_deg"] <= 0.65
    # Factory 4778, 4758, 4766; nominal 4778 for all.
    np.testing.assert_allclose(4778 * np.diag(turned["matrix"]), [4778, 4758, 4766], rtol=5e-3)
    assert "The entries off the diagonal are visible" in report.page("gyroscope_calibration")
    assert "The white noise of the means does not explain the residuals" in report.page(
        "multi_position", "accelerometer"
    )
