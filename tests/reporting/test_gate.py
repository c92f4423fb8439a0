"""The gate of a production line and its JUnit file: what stops a line, and nothing else."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sensorbook.cli import main
from sensorbook.reporting import chapters
from sensorbook.reporting.junit import junit_xml

sys.path.insert(0, str(Path(__file__).parent))
from throwaway import LOAD, NASTY, NOISE, chapter, write_device, write_notebook


@pytest.fixture
def line(tmp_path, monkeypatch):
    """Runs `sensorbook report` on a device whose one chapter is the code given."""

    def run(code=NOISE, *options, name="A device", spec=None):
        notebook = write_notebook(
            tmp_path / "n.ipynb", "# Noise", LOAD.replace("KIND", '"static"'), code
        )
        folder = tmp_path / "device"
        if not folder.exists():
            write_device(folder, "dev-1", [("gyroscope", "static")], name)
        if spec is not None:
            text = (folder / "device.toml").read_text().split("[spec.gyroscope]")[0]
            (folder / "device.toml").write_text(text + spec)
        monkeypatch.setattr(chapters, "CHAPTERS", (chapter("noise", notebook, result="noise"),))
        return main(["report", str(folder), "--out", str(tmp_path / "out"), *options])

    return run


GOOD = '[spec.gyroscope]\nrandom_walk = { max = 0.5, unit = "deg/sqrt(h)" }\n'


def test_a_limit_failed_or_not_decided_is_3(line, capsys):
    assert line(NOISE) == 0
    assert capsys.readouterr().err == ""
    assert line(NOISE, "--gate") == 3
    said = capsys.readouterr().err.splitlines()
    # N of y is 8.73e-5 rad/s/√Hz = 0.3001 °/√h with 5 % to either side; z 1e-4 = 0.344.
    assert said[0] == (
        "dev-1: gyroscope angle random walk N y: 0.300 (0.285 … 0.315), limit ≤ 0.3 °/√h: undecided, "
        "as its 95 % interval straddles the limit — record longer, which narrows it"
    )
    assert (
        said[1]
        == "dev-1: gyroscope angle random walk N z: 0.344 (0.327 … 0.361), limit ≤ 0.3 °/√h: fail"
    )
    assert len(said) == 5  # and B of three axes


def test_what_passes_is_0(line, capsys):
    assert line(NOISE, "--gate", spec=GOOD) == 0
    assert capsys.readouterr().err == ""


def test_a_gate_without_limits_lets_nothing_through(line, capsys):
    assert line(NOISE, "--gate", spec="") == 3
    assert capsys.readouterr().err == (
        "dev-1: cannot be decided: no limits given — add a [spec] table to its device.toml\n"
    )


def test_a_refused_chapter_cannot_be_decided(line, capsys):
    refuse = "from sensorbook import Refusal\nraise Refusal('Too short.', 'Record an hour.')"
    assert line(refuse, "--gate", spec=GOOD) == 3
    assert capsys.readouterr().err.splitlines()[0] == (
        "dev-1: gyroscope angle random walk N x: no result, limit ≤ 0.5 °/√h: undecided — "
        "noise refused: Too short. Record an hour."
    )


def test_failure_comes_before_the_gate(line):
    assert line("1 / 0", "--gate") == 1


def test_junit_counts_what_the_gate_stops(line, tmp_path):
    assert line(NOISE, "--gate", "--junit", str(tmp_path / "junit.xml")) == 3
    root = ElementTree.parse(tmp_path / "junit.xml").getroot()
    counts = {key: root.get(key) for key in ("tests", "failures", "errors", "skipped")}
    # One chapter and three limits on three axes: N of y and z, B of all.
    assert counts == {"tests": "10", "failures": "5", "errors": "0", "skipped": "0"}
    (suite,) = root
    assert suite.get("name") == "dev-1"
    kinds = [failure.get("type") for failure in root.iter("failure")]
    assert kinds == ["undecided", "fail", "undecided", "undecided", "undecided"]
    first = suite.find("testcase")
    assert (first.get("classname"), first.get("name")) == ("dev-1.gyroscope", "noise")
    assert float(first.get("time")) > 0


def test_junit_tells_refused_failed_and_unreadable(line, tmp_path, capsys):
    path = tmp_path / "junit.xml"
    refuse = "from sensorbook import Refusal\nraise Refusal('Too <short>.', 'Record.')"
    assert line(refuse, "--junit", str(path), spec="") == 0
    (skipped,) = ElementTree.parse(path).getroot().iter("skipped")
    assert skipped.get("message") == "Too <short>. Record."
    assert line("1 / 0", "--junit", str(path)) == 1
    (error,) = ElementTree.parse(path).getroot().iter("error")
    assert "ZeroDivisionError" in error.get("message")
    capsys.readouterr()
    assert main(["report", str(tmp_path / "nothere"), "--junit", str(path),
                 "--out", str(tmp_path / "none")]) == 1  # fmt: skip
    (error,) = ElementTree.parse(path).getroot().iter("error")
    assert "nothere: there is no such file or folder" in error.text
    assert not (tmp_path / "none").exists()


def test_junit_holds_whatever_names_hold():
    found = {
        "device": {"id": "a"}, "created": "2026-01-01T00:00:00+00:00", "checks": [], "chapters": [],
        "problems": [NASTY + "\x00\x1b[31m\ud800]]>"], "sensors": {},
    }  # fmt: skip
    (error,) = ElementTree.fromstring(junit_xml([found], {})).iter("error")
    assert NASTY in error.text
    assert error.text.endswith("\ufffd\ufffd[31m\ufffd]]>")


def test_a_junit_file_that_cannot_be_is_said_before_the_work(line, tmp_path, capsys):
    assert line(NOISE, "--junit", str(tmp_path / "nowhere" / "junit.xml")) == 1
    assert (
        "junit.xml: cannot be written — name a file in a folder that is there"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "out").exists()


def test_the_verdicts_of_an_earlier_run_count_with_only(line, tmp_path):
    assert line(NOISE) == 0
    before = json.loads((tmp_path / "out" / "dev-1" / "results.json").read_text())["checks"]
    assert line(NOISE, "--gate", "--only", "noise") == 3
    assert json.loads((tmp_path / "out" / "dev-1" / "results.json").read_text())["checks"] == before


def test_a_verdict_that_hangs_on_a_guess_is_undecided(line, tmp_path, capsys):
    assert line(NOISE, "--gate", spec=GOOD) == 0
    text = (tmp_path / "device" / "device.toml").read_text()
    (tmp_path / "device" / "device.toml").write_text(
        text.replace('unit = "deg/s"\n', 'unit = "deg/s"\nguessed = { unit = "low" }\n', 1)
    )
    capsys.readouterr()
    assert line(NOISE, "--gate") == 3
    assert capsys.readouterr().err.splitlines()[0] == (
        "dev-1: gyroscope angle random walk N x: 0.206 (0.196 … 0.217), limit ≤ 0.5 °/√h: undecided, "
        "as the unit of the gyroscope is a guess — give it in device.toml"
    )
    page = (tmp_path / "out" / "dev-1" / "index.html").read_text(encoding="utf-8")
    assert "? Not decided: 3 of 3 checks cannot be decided." in page


def test_results_of_a_recording_that_changed_do_not_stand(tmp_path, monkeypatch, capsys):
    notebook = write_notebook(
        tmp_path / "n.ipynb", "# Noise", LOAD.replace("KIND", '"static"'), NOISE
    )
    folder = write_device(tmp_path / "device", "dev-1", [("gyroscope", "static")])
    text = (folder / "device.toml").read_text().split("[spec.gyroscope]")[0]
    (folder / "device.toml").write_text(text + GOOD)
    monkeypatch.setattr(
        chapters, "CHAPTERS", (chapter("noise", notebook), chapter("psd", notebook))
    )
    out = ["--out", str(tmp_path / "out")]
    assert main(["report", str(folder), "--gate", *out]) == 0
    rows = (folder / "data.csv").read_text().splitlines()
    (folder / "data.csv").write_text("\n".join([*rows[:-1], "9,9,9,40"]) + "\n")
    capsys.readouterr()
    assert main(["report", str(folder), "--gate", "--only", "psd", *out]) == 0
    said = capsys.readouterr().out
    assert "dev-1 gyroscope/noise: of an earlier recording, removed: render it again" in said
    found = json.loads((tmp_path / "out" / "dev-1" / "results.json").read_text())
    assert [c["chapter"] for c in found["chapters"]] == ["psd"]
    assert len({i["sha256"] for i in found["inputs"]}) == 1
    assert not (tmp_path / "out" / "dev-1" / "gyroscope" / "noise.html").exists()
