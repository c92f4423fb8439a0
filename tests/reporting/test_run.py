"""Reports from end to end, on throw-away chapters: how they end and what they leave behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import nbformat
import pytest
from jsonschema import Draft202012Validator
from throwaway import (
    FIGURE,
    LOAD,
    NASTY,
    NOISE,
    PARAMETERS,
    chapter,
    run,
    write_device,
    write_notebook,
)

from sensorbook.reporting.results import SCHEMA

SENSORS = ("gyroscope", "accelerometer", "magnetometer")
THERMAL = """
model = {"model": "polynomial", "degree": 1, "coefficients": [0.0, 1e-5], "reference_temperature": 25.0,
    "temperature_unit": "degC", "range": [20.0, 40.0], "rms_before": 2e-4, "rms_after": 1e-4}
record({"thermal": dict.fromkeys("xyz", model)})
"""
ENDINGS = """
from sensorbook import InputError, Problem, Refusal
if sensor == "accelerometer":
    raise Refusal("20 s are too short.", "Record two hours.")
if sensor == "magnetometer":
    raise InputError(Problem("data.csv", "row 7", "bad <b>"), Problem("data.csv", "row 9", "worse", "mend"))
"""
FAULTS = """
import os
if sensor == "gyroscope":
    1 / 0
if sensor == "accelerometer":
    os._exit(9)
"""


def results(run_):
    found = json.loads(run_.text("dev-1", "results.json"))
    errors = list(Draft202012Validator(json.loads(SCHEMA.read_text())).iter_errors(found))
    assert not errors, errors
    return found


@pytest.fixture(scope="module")
def runs(tmp_path_factory, table):
    """Two runs into one folder: the second, `--only allan`, finds other chapters and faults."""
    folder = tmp_path_factory.mktemp("runs {with} braces")
    with_record = f'{PARAMETERS}\nthermal_record = ""'
    thermal = write_notebook(
        folder / "t.ipynb", "# Thermal", LOAD.replace("KIND", '"thermal"'), THERMAL, FIGURE
    )
    allan = write_notebook(
        folder / "a.ipynb",
        "# Noise of $N$\n\n<p>own <em>HTML</em></p>",
        LOAD.replace("KIND", '"static"'),
        "needed = read_record(thermal_record)\n"
        "say('Needed {title}; {name}', title=needed and needed['title'], name=book.name)",
        ("raise RuntimeError('a teaching cell ran')", ["teaching"]),
        "import sys; print('to ' + 'nobody', file=sys.stderr)",
        ENDINGS,
        NOISE,
        "warn('odd <b>', 'data.csv')",
        parameters=with_record,
    )
    faults = write_notebook(
        folder / "f.ipynb",
        "# Noise",
        LOAD.replace("KIND", '"static"'),
        FAULTS,
        NOISE,
        parameters=with_record,
    )
    recordings = [*((sensor, "static") for sensor in SENSORS), ("gyroscope", "thermal")]
    device = write_device(folder / "data" / "device", "dev-1", recordings, NASTY)
    rows = (chapter("thermal", thermal, "thermal", result="thermal"),)
    table(*rows, chapter("allan", allan, needs=("thermal",)))
    out = folder / "out"
    first = run([device], out)
    kept = {name: first.text("dev-1", *name.split("/")) for name in first_files(first)}
    first.kept = kept
    table(*rows, chapter("allan", faults, needs=("thermal",)))
    second = run([device], out, only=("allan",), jobs=1)
    return first, second


def first_files(first):
    return {name.removeprefix("dev-1/") for name in first.files() if name.startswith("dev-1/")}


def test_each_ending_leaves_what_it_should(runs):
    first, _ = runs
    assert set(first.kept) == {
        "index.html",
        "results.csv",
        "results.json",
        *(f"gyroscope/{c}.{k}" for c in ("thermal", "allan") for k in ("html", "json", "ipynb")),
        *(f"accelerometer/allan.{k}" for k in ("html", "json", "ipynb")),
        "magnetometer/allan.ipynb",
    }
    assert first.code == 1
    assert "gyroscope/allan: complete," in first.stdout
    assert "accelerometer/allan: refused," in first.stdout
    assert "magnetometer/allan: failed," in first.stdout
    assert str(first.out / "dev-1" / "index.html") in first.stdout
    assert str(first.out / "index.html") in first.stdout


def test_problems_are_told_one_a_line(runs):
    first, _ = runs
    assert first.stderr.splitlines() == [
        "dev-1: data.csv: row 7: bad <b>",
        "dev-1: data.csv: row 9: worse — mend",
    ]


def test_a_record_holds_everything_a_reader_needs(runs):
    record = json.loads(runs[0].kept["gyroscope/allan.json"])
    assert record["schema"] == 1
    assert (record["chapter"], record["title"], record["sensor"]) == ("allan", "Allan", "gyroscope")
    assert (record["status"], record["reason"]) == ("complete", None)
    assert record["device"] == {"id": "dev-1", "name": NASTY, "model": None, "serial": None}
    assert set(record["software"]) == {"sensorbook", "python", "numpy", "scipy"}
    assert [i["samples"] for i in record["inputs"]] == [200]
    assert {"file": "data.csv", "message": "odd <b>"} in record["warnings"]
    assert set(record["results"]) == {"noise"}


def test_a_refused_chapter_gives_its_reason_and_no_numbers(runs):
    first, _ = runs
    record = json.loads(first.kept["accelerometer/allan.json"])
    assert record["status"] == "refused"
    assert record["reason"] == "20 s are too short. Record two hours."
    assert record["results"] == {}
    page = first.kept["accelerometer/allan.html"]
    assert "20 s are too short. Record two hours." in page
    assert "Traceback" not in page
    assert "to nobody" not in page
    found = json.loads(first.kept["results.json"])
    assert found["sensors"]["accelerometer"] == {"noise": {"reason": record["reason"]}}


def test_a_later_chapter_reads_the_record_of_an_earlier(runs):
    assert "Needed Thermal;" in runs[0].kept["gyroscope/allan.html"]
    assert "Needed None;" in runs[0].kept["accelerometer/allan.html"]


def test_failed_chapters_lose_their_page_and_record_and_the_others_stand(runs):
    first, second = runs
    left = first_files(second)
    assert left == {
        "index.html",
        "results.csv",
        "results.json",
        *(f"gyroscope/thermal.{k}" for k in ("html", "json", "ipynb")),
        "gyroscope/allan.ipynb",
        "accelerometer/allan.ipynb",
        *(f"magnetometer/allan.{k}" for k in ("html", "json", "ipynb")),
    }
    assert second.code == 1
    assert second.text("dev-1", "gyroscope", "thermal.html") == first.kept["gyroscope/thermal.html"]
    found = results(second)
    assert "thermal" in found["sensors"]["gyroscope"]
    assert "noise" not in found["sensors"]["gyroscope"]
    assert "noise" in found["sensors"]["magnetometer"]


def test_a_fault_and_a_dead_kernel_are_one_sentence_each(runs):
    _, second = runs
    gyroscope, accelerometer = sorted(second.stderr.splitlines(), reverse=True)
    assert gyroscope.startswith(
        "dev-1 gyroscope/allan: the chapter stopped with ZeroDivisionError: division by zero"
        " (a fault in sensorbook; executed notebook: "
    )
    assert accelerometer.startswith("dev-1 accelerometer/allan: the chapter's kernel died")
    for sensor, reason in (("gyroscope", gyroscope), ("accelerometer", accelerometer)):
        notebook = nbformat.reads(second.text("dev-1", sensor, "allan.ipynb"), as_version=4)
        assert notebook.metadata["sensorbook"]["status"] == "failed"
        assert notebook.metadata["sensorbook"]["reason"] in reason
        assert not [c for c in notebook.cells if "papermill-error" in str(c.metadata)]
        assert str(second.out.parent) not in json.dumps(notebook.metadata.get("papermill"))


def test_results_follow_the_schema_and_list_the_chapters(runs):
    found = results(runs[1])
    ended = {(c["sensor"], c["chapter"]): c["status"] for c in found["chapters"]}
    assert ended == {
        ("gyroscope", "thermal"): "complete",
        ("gyroscope", "allan"): "failed",
        ("accelerometer", "allan"): "failed",
        ("magnetometer", "allan"): "complete",
    }
    assert {c["verdict"] for c in found["checks"]} == {"undecided"}  # no noise of the gyroscope


def test_nothing_half_written_remains(runs):
    assert not [p for p in runs[1].out.rglob("*") if ".partial" in p.name]


def test_pages_say_how_the_chapters_ended(runs):
    _, second = runs
    page = second.text("dev-1", "index.html")
    assert "2 of 4 chapters failed" in page
    assert "ZeroDivisionError" in page
    group = second.text("index.html")
    assert "✗ failed" in group


def test_a_delivered_notebook_runs_again_from_its_own_folder(runs):
    folder = runs[1].out / "dev-1" / "gyroscope"
    notebook = nbformat.read(folder / "thermal.ipynb", as_version=4)
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert str(runs[1].out.parent) not in code
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def quick(tmp_path_factory, table):
    """A chapter of one cell that records nothing, for runs that are about something else."""
    folder = tmp_path_factory.mktemp("quick")
    table(chapter("allan", write_notebook(folder / "q.ipynb", "# Quick", "device, sensor")))
    return folder


def test_parameters_cannot_inject_code(quick, tmp_path):
    injected = tmp_path / 'a";import os;os._exit(3);"\\' / "d'\n"
    device = write_device(injected, "dev-1", [("gyroscope", "static")])
    done = run([device], tmp_path / "out")
    assert done.code == 0, done.stderr
    notebook = nbformat.reads(done.text("dev-1", "gyroscope", "allan.ipynb"), as_version=4)
    shown = notebook.cells[-1].outputs[0]["data"]["text/plain"]
    assert shown == repr((os.path.relpath(device, done.out / "dev-1" / "gyroscope"), "gyroscope"))


def test_a_device_whose_recordings_feed_no_chapter_says_so(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "thermal")])
    done = run([device], tmp_path / "out")
    assert done.code == 0
    assert "nothing to report" in done.text("dev-1", "index.html")
    results(done)


def test_chapters_that_no_recording_feeds_any_more_are_removed(quick, tmp_path):
    out = tmp_path / "out"
    run([write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])], out)
    assert (out / "dev-1" / "gyroscope" / "allan.html").exists()
    done = run([write_device(tmp_path / "e", "dev-1", [("gyroscope", "thermal")])], out)
    assert first_files(done) == {"index.html", "results.csv", "results.json"}


def test_an_unreadable_device_loses_its_earlier_report(quick, tmp_path):
    out = tmp_path / "out"
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    assert run([device], out).code == 0
    file = device / "device.toml"
    file.write_text(file.read_text() + '\n[spec.gyroscope.no_such]\nmax = 1\nunit = "deg"\n')
    done = run([device], out)
    assert done.code == 1
    assert "no_such" in done.stderr
    assert done.text("dev-1", "index.html").count("no_such") == 1
    assert first_files(done) == {"index.html", "results.csv", "results.json"}
    results(done)


def test_a_declaration_that_is_no_toml_keeps_the_earlier_report_and_says_so(quick, tmp_path):
    out = tmp_path / "out"
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    assert run([device], out).code == 0
    before = results(run([device], out))
    file = device / "device.toml"
    file.write_text("name = = 3\n" + file.read_text())
    done = run([device], out)
    assert done.code == 1
    told = "device.toml: is not valid TOML: Invalid value (at line 1, column 8) — mend the syntax"
    assert done.stderr == f"dev-1: {told}\n"
    after = results(done)
    assert after == before | {"problems": [told]}
    assert (out / "dev-1" / "gyroscope" / "allan.html").exists()
    page = done.text("dev-1", "index.html")
    assert told in page
    assert "It could not be read now: what stands below is of an earlier run, on " in page
    row = done.text("index.html")
    assert "✗ failed" in row
    assert f"dev-1</a>: {told}" in row
    file.write_text(file.read_text().removeprefix("name = = 3\n"))
    done = run([device], out)
    assert results(done)["problems"] == []
    assert "what stands below" not in done.text("dev-1", "index.html")


def test_a_declaration_that_is_no_toml_and_has_no_earlier_report(quick, tmp_path):
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "device.toml").write_bytes(b"id = 'dev-1' # \xff\n[[recording]\n")
    done = run([tmp_path / "d"], tmp_path / "out")
    assert done.code == 1
    assert "is not UTF-8 text" in done.text("dev-1", "index.html")
    (tmp_path / "d" / "device.toml").write_text("[[recording]\nid = 'x'\n")
    assert not (tmp_path / "out" / "x").exists(), "the id of a table is not the device's"


def test_only_what_a_device_does_not_feed_is_told(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    other = write_device(tmp_path / "e", "dev-2", [("gyroscope", "thermal")])
    done = run([device, other], tmp_path / "out", only=["thermal"])
    assert done.code == 0
    page = done.text("dev-1", "index.html")
    assert (
        "The chapters asked for with <code>--only</code> do not read these recordings, so that"
        in page
    )
    assert "No chapter reads these" not in page
    assert "No limits given" not in page, "nothing was measured that could be judged"
    assert "dev-1: --only leaves nothing to do; its recordings feed allan" in done.stdout
    assert "No chapter reads these recordings yet" in done.text("dev-2", "index.html")


def test_a_recording_of_no_sensor_fails_and_the_others_stand(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    file = device / "device.toml"
    extra = '[[recording]]\nsensor = "gyro"\nkind = "static"\nfile = "data.csv"\n'
    file.write_text(file.read_text() + extra)
    done = run([device], tmp_path / "out")
    assert done.code == 1
    assert "did you mean 'gyroscope'?" in done.stderr
    assert (done.out / "dev-1" / "gyroscope" / "allan.html").exists()
    assert "gyroscope" in done.text("dev-1", "index.html")


def test_two_folders_with_one_id_are_refused_before_any_work(quick, tmp_path):
    paths = [
        write_device(tmp_path / name, "same", [("gyroscope", "static")]) for name in ("a", "b")
    ]
    done = run(paths, tmp_path / "out")
    assert done.code == 1
    assert len(done.stderr.splitlines()) == 1
    assert '"same"' in done.stderr
    assert not done.out.exists()


def test_what_is_no_device_folder_gets_a_line_and_the_others_a_report(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    (tmp_path / "empty").mkdir()
    paths = [device / "data.csv", tmp_path / "empty", tmp_path / "missing", device]
    done = run(paths, tmp_path / "out")
    assert done.code == 1
    assert sorted(line.count("device.toml") for line in done.stderr.splitlines()) == [1, 1, 2]
    assert (done.out / "dev-1" / "index.html").exists()


def test_links_out_of_the_report_folder_are_not_followed(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    out = tmp_path / "out"
    out.mkdir()
    (out / "dev-1").symlink_to(elsewhere)
    done = run([device], out)
    assert done.code == 1
    assert "symbolic link" in done.stderr
    assert not list(elsewhere.iterdir())


def test_the_device_folder_is_not_taken_for_the_report_folder(quick, tmp_path):
    device = write_device(tmp_path / "dev-1", "dev-1", [("gyroscope", "static")])
    done = run([device], tmp_path)
    assert done.code == 1
    assert "--out" in done.stderr
    assert sorted(p.name for p in device.iterdir()) == ["data.csv", "device.toml"]


def test_a_report_folder_that_is_a_file_is_a_line(quick, tmp_path):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    (tmp_path / "out").write_text("")
    done = run([device], tmp_path / "out")
    assert done.code == 1
    assert len(done.stderr.splitlines()) == 1


def test_stale_asides_go_and_those_of_running_processes_stay(tmp_path):
    import socket

    from sensorbook.reporting.tree import Tree

    ended = subprocess.Popen(["true"])
    ended.wait()
    name = f".partial-{socket.gethostname()}-{{}}-x"
    stale, mine = tmp_path / name.format(ended.pid), tmp_path / name.format(os.getpid())
    stale.mkdir()
    mine.mkdir()
    with Tree(tmp_path) as tree:
        tree.tidy()
        assert tree.aside.is_dir()
        assert not stale.exists()
        assert mine.exists()
    assert [p.name for p in tmp_path.iterdir()] == [mine.name]


def test_parameters_a_notebook_does_not_have_are_a_fault(tmp_path, table):
    notebook = write_notebook(
        tmp_path / "n.ipynb", "# N", "1", parameters='device = ""\nsensor = 1'
    )
    table(chapter("allan", notebook))
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    done = run([device], tmp_path / "out")
    assert done.code == 1
    assert "parameter 'sensor' is int, not str" in done.stderr


def test_four_kernels_at_once(tmp_path, table):
    """One process hands out the kernels' ports, so that they do not race for them."""
    notebook = write_notebook(
        tmp_path / "n.ipynb", "# N", "import os\nos.environ['OMP_NUM_THREADS']"
    )
    table(chapter("allan", notebook))
    devices = [
        write_device(tmp_path / f"d{k}", f"dev-{k}", [("gyroscope", "static")]) for k in range(4)
    ]
    done = run(devices, tmp_path / "out", jobs=4, engine="kernel")
    assert done.code == 0, done.stderr
    assert "[4/4]" in done.stdout
    text = done.text("dev-3", "gyroscope", "allan.ipynb")
    assert nbformat.reads(text, as_version=4).cells[-1].outputs[0]["data"]["text/plain"] == "'1'"
