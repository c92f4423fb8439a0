"""A chapter over several sensors: when it runs, which records it is given, and what it leaves behind."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import time
from pathlib import Path

import nbformat
import pytest
from jsonschema import Draft202012Validator
from throwaway import LOAD, NOISE, Run, chapter, run, write_device, write_notebook

from sensorbook.notebook import MIME
from sensorbook.reporting import chapters, execute
from sensorbook.reporting.book import book
from sensorbook.reporting.chapters import ATTITUDE, Chapter
from sensorbook.reporting.results import SCHEMA

REAL = chapters.CHAPTERS  # before a test sets others
NEEDS = ("gyroscope/noise", "accelerometer/multi_position", "magnetometer/magnetometer")
PARAMETERS = 'device = ""\nnoise_record = ""\nmulti_position_record = ""\nmagnetometer_record = ""'
FILES = {f"attitude/integrated_attitude.{kind}" for kind in ("html", "json", "ipynb")}
TRAJECTORY = ("gyroscope", "trajectory")
ALL = [
    TRAJECTORY,
    ("gyroscope", "static"),
    ("accelerometer", "static"),
    ("accelerometer", "positions"),
]
ENDINGS = """
from sensorbook import Refusal
if book.id == "failed":
    1 / 0
if book.id == "refused":
    raise Refusal("It is too short.", "Record more.")
"""
ATTITUDE_LOAD = """
from sensorbook import Refusal
from sensorbook.notebook import *
book, runs = load(device, "gyroscope", "trajectory")
if book.id == "mute":
    raise Refusal("It does not move.", "Turn it.")
if book.id == "broken":
    1 / 0
"""
ATTITUDE_RECORD = """
names = ("noise_record", "multi_position_record", "magnetometer_record")
paths = {name: globals()[name] for name in names}
found = {key: read_record(path) for key, path in paths.items()}
told = {key: f and [f["sensor"], f["status"], f["device"]["id"]] for key, f in found.items()}
error = {"mean_error_deg": 0.25, "mean_euler_error_deg": [0.1, 0.2, 0.3]}
record({"methods": {"mekf": {"2.0": error}}, "tuning": {"told": told}})
"""


def attitude_row(notebook: Path) -> Chapter:
    return Chapter(
        "integrated_attitude", notebook, "Integrated attitude", "trajectory", (ATTITUDE,), NEEDS,
        "methods", "gyroscope",
    )  # fmt: skip


def table_of(noise: Path, positions: Path, attitude: Path) -> tuple[Chapter, ...]:
    """The attitude's row stands first, so that it is not the order of rows that has it come last."""
    return (
        attitude_row(attitude),
        chapter("noise", noise),
        Chapter("multi_position", positions, "Positions", "positions", ("accelerometer",), (),
                "calibration"),
    )  # fmt: skip


# ---- from end to end ----


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("attitudes")


@pytest.fixture(scope="module")
def rows(folder):
    load = LOAD.replace("KIND", '"static"')
    return table_of(
        write_notebook(folder / "noise.ipynb", "# Noise", load, ENDINGS, NOISE),
        write_notebook(
            folder / "positions.ipynb",
            "# Positions",
            LOAD.replace("KIND", '"positions"'),
            'record({"calibration_methods": {"multi_position": {}}})',
        ),
        write_notebook(
            folder / "attitude.ipynb",
            "# Attitude",
            ATTITUDE_LOAD,
            ATTITUDE_RECORD,
            parameters=PARAMETERS,
        ),
    )


@pytest.fixture(scope="module")
def done(folder, rows, table):
    table(*rows)
    recorded = {
        "whole": ALL,
        "alone": [TRAJECTORY],
        "failed": [TRAJECTORY, ("gyroscope", "static")],
        "refused": [TRAJECTORY, ("gyroscope", "static")],
        "mute": [TRAJECTORY],
        "broken": [TRAJECTORY],
        "still": [("gyroscope", "static")],
    }
    devices = [write_device(folder / "data" / id, id, kinds) for id, kinds in recorded.items()]
    return run(devices, folder / "out", jobs=2)


def results(done, id):
    found = json.loads(done.text(id, "results.json"))
    Draft202012Validator(json.loads(SCHEMA.read_text())).validate(found)
    return found


def told(done, id):
    return results(done, id)["attitude"]["tuning"]["told"]


def test_it_lies_in_a_folder_of_its_own(done):
    files = {str(p.relative_to(done.out / "whole")) for p in (done.out / "whole").rglob("*.*")}
    assert {name for name in files if name.startswith("attitude")} == FILES
    record = json.loads(done.text("whole", "attitude", "integrated_attitude.json"))
    assert (record["sensor"], record["status"]) == ("attitude", "complete")
    assert [(i["sensor"], i["kind"]) for i in record["inputs"]] == [TRAJECTORY]
    assert not (done.out / "still" / "attitude").exists()
    assert "attitude" not in results(done, "still")


def test_it_reads_the_records_of_the_same_run_of_several_sensors(done):
    assert told(done, "whole") == {
        "noise_record": ["gyroscope", "complete", "whole"],
        "multi_position_record": ["accelerometer", "complete", "whole"],
        "magnetometer_record": None,
    }
    (listed,) = [c for c in results(done, "whole")["chapters"] if c["sensor"] == "attitude"]
    assert listed["parameters"] == {
        "noise_record": "../gyroscope/noise.json",
        "multi_position_record": "../accelerometer/multi_position.json",
        "magnetometer_record": "",
    }


def test_a_device_with_a_trajectory_alone_has_no_records_to_give(done):
    assert set(told(done, "alone").values()) == {None}
    page = done.text("alone", "index.html")
    assert "Kalman filter (MEKF)" in page
    assert "attitude/integrated_attitude.html" in page


def test_of_a_failed_chapter_nothing_is_given_and_of_a_refused_one_its_record(done):
    assert told(done, "failed")["noise_record"] is None
    assert told(done, "refused")["noise_record"] == ["gyroscope", "refused", "refused"]
    assert "failed attitude/integrated_attitude: complete," in done.stdout


def test_a_refusal_and_a_fault_of_its_own(done):
    mute, broken = results(done, "mute"), results(done, "broken")
    assert mute["attitude"] == {"reason": "It does not move. Turn it."}
    assert "attitude" not in broken
    assert broken["chapters"][0]["status"] == "failed"
    names = {p.name for p in (done.out / "broken" / "attitude").iterdir()}
    assert names == {"integrated_attitude.ipynb"}
    assert "It does not move. Turn it." in done.text("mute", "index.html")
    assert "ZeroDivisionError" in done.text("broken", "index.html")
    assert done.code == 1
    lines = [line.split(": ")[0] for line in done.stderr.splitlines()]
    assert sorted(lines) == ["broken attitude/integrated_attitude", "failed gyroscope/noise"]


def test_it_comes_after_all_others_and_is_counted(done):
    lines = [line for line in done.stdout.splitlines() if line.startswith("[")]
    assert [line.split()[0] for line in lines] == [f"[{k}/12]" for k in range(1, 13)]
    of_device: dict[str, list[bool]] = {}
    for line in lines:
        of_device.setdefault(line.split()[1], []).append("attitude/" in line)
    assert all(late == sorted(late) for late in of_device.values())
    assert sum(map(sum, of_device.values())) == 6


def test_its_page_is_of_the_device(done):
    page = done.text("whole", "attitude", "integrated_attitude.html")
    assert "<title>Attitude – attitude – A device</title>" in page
    assert '<a href="../index.html">← A device</a>' in page
    assert "0.250 at 2 Hz" in done.text("index.html")


def test_the_notebook_runs_again_from_its_own_folder(done):
    place = done.out / "whole" / "attitude"
    notebook = nbformat.read(place / "integrated_attitude.ipynb", as_version=4)
    (given,) = [c.source for c in notebook.cells if "injected" in str(c.metadata)]
    paths = dict(re.findall(r'(\w+) = "(.*)"', given))
    assert "sensor" not in paths
    assert (place / paths["device"] / "device.toml").is_file()
    assert (place / paths["noise_record"]).is_file()


# ---- without kernels: what is run with which parameters ----


class Executed:
    """Stands in for the execution of notebooks and keeps what it was asked for."""

    def __init__(self, log: Path):
        self.log = log  # what is asked for is asked for in forks
        self.process = os.getpid()
        self.sha256 = "a" * 64
        self.stops_at = ""

    @property
    def calls(self) -> list[tuple[str, dict]]:
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return [tuple(json.loads(line)) for line in lines]

    def __call__(self, notebook, parameters, folder, aside, shown_as, engine="warm"):
        if notebook.stem == self.stops_at:
            os.kill(self.process, signal.SIGINT)
            time.sleep(60)
        with self.log.open("a") as log:
            log.write(json.dumps((notebook.stem, parameters)) + "\n")
        entry = {"file": "data.csv", "sha256": self.sha256, "sensor": "gyroscope", "kind": "static",
                 "samples": 1, "rate_hz": 1.0, "duration_s": 1.0, "gaps": 0}  # fmt: skip
        results = {"methods": {}} if notebook.stem == "attitude" else {"calibration_methods": {}}
        shown = nbformat.v4.new_output(
            "display_data", {MIME: {"inputs": [entry], "results": results}}
        )
        made = nbformat.v4.new_notebook(
            cells=[nbformat.v4.new_code_cell("1", outputs=[shown])],
            metadata={
                "papermill": {"parameters": parameters},
                "sensorbook": {"status": "complete", "reason": None},
            },
        )
        return execute.Outcome("complete", None, made)

    def records(self, stem="attitude") -> list[dict]:
        """The records that each execution of a notebook was given."""
        return [
            {key: value for key, value in parameters.items() if key.endswith("_record")}
            for name, parameters in self.calls
            if name == stem
        ]


@pytest.fixture
def executed(monkeypatch, tmp_path_factory):
    stub = Executed(tmp_path_factory.mktemp("executed") / "log")
    # As where the tests themselves are run in the background, and were told to ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(execute, "execute", stub)
    rows = table_of(*(Path(f"{name}.ipynb") for name in ("noise", "positions", "attitude")))
    monkeypatch.setattr(chapters, "CHAPTERS", rows)
    return stub


NONE = {"noise_record": "", "multi_position_record": "", "magnetometer_record": ""}
THERE = NONE | {
    "noise_record": "../gyroscope/noise.json",
    "multi_position_record": "../accelerometer/multi_position.json",
}


def test_parameters(executed, tmp_path):
    device = write_device(tmp_path / "d", "dev", ALL)
    assert run([device], tmp_path / "out").code == 0
    (given,) = [parameters for name, parameters in executed.calls if name == "attitude"]
    assert given == THERE | {"device": os.path.relpath(device, tmp_path / "out/dev/attitude")}


def test_only_it_reads_the_records_on_disk(executed, tmp_path):
    device, out = write_device(tmp_path / "d", "dev", ALL), tmp_path / "out"
    only = {"only": ("integrated_attitude",)}
    assert "[1/1] dev attitude/integrated_attitude: complete" in run([device], out, **only).stdout
    run([device], out, only=("noise",))
    run([device], out, **only)
    run([device], out)
    run([device], out, force=True, **only)
    noise = {"noise_record": THERE["noise_record"]}
    assert executed.records() == [NONE, NONE | noise, THERE, THERE]


def test_only_others_leaves_it_as_it_was(executed, tmp_path):
    device, out = write_device(tmp_path / "d", "dev", ALL), tmp_path / "out"
    run([device], out)
    before = (out / "dev" / "attitude" / "integrated_attitude.json").read_text()
    done = run([device], out, only=("noise",))
    assert len(executed.records()) == 1
    assert done.text("dev", "attitude", "integrated_attitude.json") == before
    assert results(done, "dev")["attitude"] == {"methods": {}}


def test_a_record_of_a_recording_that_is_there_no_more_is_not_given(executed, tmp_path):
    out = tmp_path / "out"
    run([write_device(tmp_path / "d", "dev", ALL)], out)
    fewer = [TRAJECTORY, ("accelerometer", "static"), ("accelerometer", "positions")]
    done = run([write_device(tmp_path / "e", "dev", fewer)], out)
    assert executed.records() == [THERE, THERE | {"noise_record": ""}]
    assert "dev/gyroscope/noise.json" not in done.files()
    assert "dev/accelerometer/noise.json" in done.files()


def test_it_is_removed_when_the_trajectory_is_there_no_more(executed, tmp_path):
    out = tmp_path / "out"
    run([write_device(tmp_path / "d", "dev", ALL)], out)
    done = run([write_device(tmp_path / "e", "dev", ALL[1:])], out)
    assert not [name for name in done.files() if "attitude" in name]
    assert "attitude" not in results(done, "dev")


def test_it_is_removed_when_it_is_of_an_earlier_recording(executed, tmp_path):
    device, out = write_device(tmp_path / "d", "dev", ALL), tmp_path / "out"
    run([device], out)
    executed.sha256 = "b" * 64
    done = run([device], out, only=("noise", "multi_position"), force=True)
    line = "dev attitude/integrated_attitude: of an earlier recording, removed: render it again"
    assert line in done.stdout.splitlines()
    assert not [name for name in done.files() if "integrated" in name]


def test_only_what_the_device_feeds_is_told(executed, tmp_path):
    done = run([write_device(tmp_path / "d", "dev", [TRAJECTORY])], tmp_path, only=("noise",))
    line = "dev: --only leaves nothing to do; its recordings feed integrated_attitude"
    assert line in done.stdout.splitlines()
    assert executed.calls == []
    other = write_device(tmp_path / "o", "other", [("accelerometer", "trajectory")])
    done = run([other], tmp_path)
    lacking = (
        "a trajectory needs a gyroscope of kind trajectory, and this one holds accelerometer alone"
    )
    assert f"other: warning: {lacking}" in done.stdout.splitlines()
    assert done.code == 0
    page = done.text("other", "index.html")
    assert "No chapter reads these" in page
    assert f"A{lacking[1:]}." in page


def test_an_interrupt_of_others_keeps_it_from_starting(executed, tmp_path):
    device = write_device(tmp_path / "d", "dev", ALL)
    executed.stops_at = "positions"
    with pytest.raises(KeyboardInterrupt):
        run([device], tmp_path / "out", jobs=1)
    assert "noise" in [name for name, _ in executed.calls]
    assert executed.records() == []


def test_an_interrupt_of_it_leaves_the_others(executed, tmp_path):
    device = write_device(tmp_path / "d", "dev", ALL)
    executed.stops_at = "attitude"
    with pytest.raises(KeyboardInterrupt):
        run([device], tmp_path / "out", jobs=2)
    assert (tmp_path / "out" / "dev" / "gyroscope" / "noise.html").is_file()
    assert list((tmp_path / "out" / "dev" / "attitude").iterdir()) == []


def test_a_folder_that_leads_elsewhere_is_refused(executed, tmp_path):
    device = write_device(tmp_path / "d", "dev", ALL)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out" / "dev").mkdir(parents=True)
    (tmp_path / "out" / "dev" / "attitude").symlink_to(tmp_path / "elsewhere")
    done = run([device], tmp_path / "out")
    assert done.code == 1
    assert "attitude is a symbolic link that leads elsewhere" in done.stderr
    assert executed.calls == []
    assert list((tmp_path / "elsewhere").iterdir()) == []


# ---- the book ----


def bind(paths, out, **options) -> Run:
    stdout, stderr = io.StringIO(), io.StringIO()
    code = book([str(p) for p in paths], str(out), stdout=stdout, stderr=stderr, **options)
    return Run(out, code, stdout.getvalue(), stderr.getvalue())


def test_the_book_shows_it_after_those_it_reads(executed, tmp_path):
    done = bind([write_device(tmp_path / "d", "dev", ALL)], tmp_path / "out", jobs=2)
    assert (done.code, done.stderr) == (0, "")
    lines = [re.sub(r", [\d.]+ s$", "", line) for line in done.stdout.splitlines()]
    assert lines[2] == "[3/3] book/integrated_attitude on dev: complete"
    flat = {"noise_record": "noise.json", "multi_position_record": "multi_position.json"}
    assert executed.records() == [NONE | flat]
    page = done.text("book", "integrated_attitude.html")
    assert "On A device ·" in page
    assert "On the gyroscope of A device ·" in done.text("book", "noise.html")
    contents = done.text("book", "index.html")
    assert "On A device ·" in contents
    assert "the attitude of" not in contents + page


def test_the_book_gives_it_no_record_of_another_device(executed, tmp_path):
    still = write_device(tmp_path / "s", "still", [("gyroscope", "static")])
    done = bind([still, write_device(tmp_path / "d", "dev", ALL)], tmp_path / "out")
    assert "book/noise on still gyroscope: complete" in done.stdout
    assert executed.records() == [NONE | {"multi_position_record": "multi_position.json"}]


def test_the_book_gives_it_no_record_of_another_sensor(executed, tmp_path):
    kinds = [TRAJECTORY, ("accelerometer", "static")]
    done = bind([write_device(tmp_path / "d", "dev", kinds)], tmp_path / "out")
    assert "book/noise on dev accelerometer: complete" in done.stdout
    assert executed.records() == [NONE]


def test_the_book_says_what_would_feed_it(executed, tmp_path):
    done = bind([write_device(tmp_path / "d", "dev", ALL[1:])], tmp_path / "out")
    why = 'no device given has a recording of kind "trajectory" of the gyroscope: name one that has'
    assert f"book/integrated_attitude: not rendered: {why}" in done.stdout.splitlines()


# ---- the real row ----


def test_what_the_chapter_needs_are_chapters_before_it_and_its_notebook_s_parameters():
    (row,) = [c for c in REAL if ATTITUDE in c.sensors]
    before = REAL[: REAL.index(row)]
    needed = set(row.needed(ATTITUDE))
    assert needed <= {(sensor, c.slug) for c in before for sensor in c.sensors}
    cells = nbformat.read(row.notebook, as_version=4).cells
    (cell,) = [c for c in cells if "parameters" in c.metadata.get("tags", [])]
    names = {line.split(" = ")[0] for line in cell.source.splitlines()}
    assert {"device", *(f"{slug}_record" for _, slug in needed)} <= names
    assert "sensor" not in names
