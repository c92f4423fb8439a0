"""What is up to date stays; interrupted, crowded and full runs leave whole files, and are gone on with."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from throwaway import LOAD, NOISE, PARAMETERS, chapter, run, write_device, write_notebook

from sensorbook.reporting import execute, keys
from sensorbook.reporting.tree import Tree
from sensorbook.reporting.work import Said

WITH_RECORD = f'{PARAMETERS}\nthermal_record = ""'
THERMAL = """
model = {"model": "polynomial", "degree": 1, "coefficients": [0.0, 1e-5], "reference_temperature": 25.0,
    "temperature_unit": "degC", "range": [20.0, 40.0], "rms_before": 2e-4, "rms_after": 1e-4}
record({"thermal": dict.fromkeys("xyz", model)})
"""


@pytest.fixture
def two(tmp_path, table):
    """A device with two chapters, of which the second reads the record of the first."""
    rows = (
        chapter(
            "thermal",
            write_notebook(tmp_path / "t.ipynb", "# T", LOAD.replace("KIND", '"thermal"'), THERMAL),
            "thermal",
            result="thermal",
        ),
        chapter(
            "allan",
            write_notebook(
                tmp_path / "a.ipynb",
                "# A",
                LOAD.replace("KIND", '"static"'),
                NOISE,
                parameters=WITH_RECORD,
            ),
            needs=("thermal",),
        ),
    )
    table(*rows)
    return write_device(
        tmp_path / "d", "dev-1", [("gyroscope", "static"), ("gyroscope", "thermal")]
    )


def statuses(done) -> dict[str, str]:
    return dict(re.findall(r"^\[\d+/\d+\] dev-1 gyroscope/(\w+): (\w+)", done.stdout, re.MULTILINE))


BOTH = {"thermal": "complete", "allan": "complete"}
NEITHER = {"thermal": "unchanged", "allan": "unchanged"}


def test_a_second_run_leaves_every_file_as_it_is(two, tmp_path):
    out = tmp_path / "out"
    first = run([two], out)
    assert statuses(first) == BOTH
    times = {name: (out / name).stat().st_mtime_ns for name in first.files()}
    again = run([two], out)
    assert (again.code, statuses(again)) == (0, NEITHER)
    assert {name: (out / name).stat().st_mtime_ns for name in again.files()} == times
    assert str(out / "dev-1" / "index.html") in again.stdout
    assert statuses(run([two], out, force=True)) == BOTH


def test_what_a_chapter_hangs_on_renews_it(two, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run([two], out)

    (two / "data.csv").write_text((two / "data.csv").read_text() + "0.1,0.2,0.3,40.0\n")
    assert statuses(run([two], out)) == BOTH, "a recording"

    toml = two / "device.toml"
    toml.write_text(toml.read_text().replace("max = 0.3,", "max = 0.4,"))
    assert statuses(run([two], out)) == BOTH, "the declaration"

    notebook = tmp_path / "a.ipynb"
    notebook.write_text(notebook.read_text().replace("# A", "# B"))
    assert statuses(run([two], out)) == {"thermal": "unchanged", "allan": "complete"}, "a notebook"
    assert "<title>B" in (out / "dev-1" / "gyroscope" / "allan.html").read_text()

    notebook = tmp_path / "t.ipynb"
    notebook.write_text(notebook.read_text().replace("# T", "# U"))
    assert statuses(run([two], out)) == BOTH, "the record of a chapter that it reads"

    monkeypatch.setattr(keys, "of_software", lambda: "another version")
    assert statuses(run([two], out)) == BOTH, "the library"
    assert statuses(run([two], out)) == NEITHER


@pytest.mark.parametrize("kind", ["html", "json", "ipynb"])
def test_a_file_that_is_missing_is_made_again(two, tmp_path, kind):
    out = tmp_path / "out"
    run([two], out)
    lost = out / "dev-1" / "gyroscope" / f"allan.{kind}"
    whole = lost.read_bytes()
    for damage in (
        lost.unlink,
        lambda: lost.write_bytes(whole[: len(whole) // 2]),
        lambda: lost.write_bytes(b""),
    ):
        damage()
        assert statuses(run([two], out)) == {"thermal": "unchanged", "allan": "complete"}
        assert len(lost.read_bytes()) > 0.9 * len(whole)


@pytest.mark.parametrize("page", ["index.html", "dev-1/index.html"])
def test_a_damaged_index_is_written_again(two, tmp_path, page):
    out = tmp_path / "out"
    run([two], out)
    whole = (out / page).read_bytes()
    (out / page).write_bytes(whole[:4000])
    done = run([two], out)
    assert statuses(done) == NEITHER
    assert (out / page).read_bytes().endswith(b"</html>")


def test_pages_of_a_device_follow_chapters_rendered_apart(two, tmp_path):
    out = tmp_path / "out"
    run([two], out, only=("thermal",))
    run([two], tmp_path / "other")
    # As a run leaves it that is ended after the chapters and before what is made of them.
    for kind in ("ipynb", "html", "json"):
        (out / "dev-1" / "gyroscope" / f"allan.{kind}").write_bytes(
            (tmp_path / "other" / "dev-1" / "gyroscope" / f"allan.{kind}").read_bytes()
        )
    done = run([two], out)
    assert "noise" in json.loads(done.text("dev-1", "results.json"))["sensors"]["gyroscope"]


def test_what_changes_while_it_is_read_is_told_and_rendered_again(two, tmp_path, monkeypatch):
    out = tmp_path / "out"
    executes, toml = execute.execute, two / "device.toml"
    before = toml.read_text()

    def changes(*given, **named):
        toml.write_text(before.replace("A device", "Another"))
        return executes(*given, **named)

    monkeypatch.setattr(execute, "execute", changes)
    done = run([two], out)
    assert done.code == 1
    assert done.stderr == "dev-1: its files changed while they were read — run it again\n"
    monkeypatch.undo()
    toml.write_text(before)
    assert statuses(run([two], out)) == BOTH


def test_a_failed_chapter_is_tried_again(two, tmp_path):
    out = tmp_path / "out"
    good = (two / "data.csv").read_text()
    (two / "data.csv").write_text(good + "1,2,oops,4\n")
    assert run([two], out).code == 1
    again = run([two], out)
    assert again.code == 1
    assert "oops" in again.stderr
    (two / "data.csv").write_text(good)
    assert statuses(run([two], out)) == BOTH


def test_a_hanging_chapter_is_ended_and_its_earlier_cells_stand(tmp_path, table, monkeypatch):
    monkeypatch.setattr(execute, "CELL_LIMIT", 2)
    # A loop in C, which no exception of Python's ends.
    hangs = "import itertools\nany(itertools.repeat(False))"
    notebook = write_notebook(
        tmp_path / "n.ipynb", "# N", "import time\n1", "2", "time.sleep(1.2)", hangs
    )
    good = write_notebook(tmp_path / "g.ipynb", "# G", "1")
    table(chapter("psd", notebook), chapter("allan", good))
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    done = run([device], tmp_path / "out")
    assert done.code == 1
    assert done.stderr.count("\n") == 1
    assert "gyroscope/psd: a cell took longer than 2 s and was stopped" in done.stderr
    cells = json.loads(done.text("dev-1", "gyroscope", "psd.ipynb"))["cells"]
    shown = [bool(cell["outputs"]) for cell in cells if cell["cell_type"] == "code"]
    assert shown[-4:] == [True, True, False, False]
    assert (done.out / "dev-1" / "gyroscope" / "allan.html").is_file()


def test_a_dead_device_leaves_the_others(tmp_path, table, monkeypatch):
    """A crash while a device is opened, as of a library that reads its files."""
    from sensorbook.reporting import device as module

    opens = module.open_source

    def dies(path, said):
        if path.name == "a":
            os.kill(os.getpid(), 9)
        return opens(path, said)

    monkeypatch.setattr(module, "open_source", dies)
    table(chapter("allan", write_notebook(tmp_path / "n.ipynb", "# N", "1")))
    paths = [write_device(tmp_path / n, f"dev-{n}", [("gyroscope", "static")]) for n in "abc"]
    done = run(paths, tmp_path / "out")
    assert done.code == 1
    assert done.stderr == f"{paths[0]}: its process died, often for want of memory\n"
    assert all((done.out / f"dev-{n}" / "index.html").is_file() for n in "bc")


HOLDS = """
import fcntl, os, sys, time
fcntl.flock(os.open(sys.argv[1], os.O_RDONLY), fcntl.LOCK_EX)
print("held", flush=True)
time.sleep(120)
"""


def test_two_runs_into_one_folder_wait_for_one_another(two, tmp_path):
    out = tmp_path / "out"
    (out / "dev-1").mkdir(parents=True)
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(out / "dev-1")],
        stdout=subprocess.PIPE,
    )
    assert holder.stdout.readline() == b"held\n"
    found = []
    second = threading.Thread(target=lambda: found.append(run([two], out)))
    second.start()
    time.sleep(3)
    assert not found
    assert not list(out.glob("*/*/*.html"))
    holder.kill()  # its pipes are open in forks, too
    second.join(60)
    assert found[0].code == 0
    assert (
        "dev-1: another run is writing its report: waiting for it" in found[0].stdout.splitlines()
    )
    assert statuses(found[0]) == BOTH


def test_a_full_disk_is_one_line_and_what_was_there_stays(two, tmp_path, monkeypatch):
    out = tmp_path / "out"
    earlier = run([two], out)
    kept = {name: (out / name).read_bytes() for name in earlier.files()}
    writes = Tree.write

    def full(self, path: Path, text: str):
        if path.name == "allan.ipynb":
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        writes(self, path, text)

    monkeypatch.setattr(Tree, "write", full)
    done = run([two], out, force=True)
    assert done.code == 1
    assert done.stderr == (
        f"{out}/dev-1/gyroscope/allan.ipynb: No space left on device — free some and run it again: "
        "what is finished is not rendered anew\n"
    )
    assert not list(out.glob(".partial*"))
    record = "dev-1/gyroscope/allan.json"  # of which it is known that its page may not be its own
    assert done.files() == set(kept) - {record}
    monkeypatch.undo()
    assert statuses(run([two], out)) == {"thermal": "unchanged", "allan": "complete"}


def test_what_is_in_the_way_of_a_page_is_named_and_the_others_are_rendered(two, tmp_path):
    out = tmp_path / "out"
    page = out / "dev-1" / "gyroscope" / "thermal.html"
    page.mkdir(parents=True)
    done = run([two], out)
    assert done.code == 1
    assert done.stderr == f"dev-1 gyroscope/thermal: {page}: Is a directory\n"
    assert statuses(done) == {"thermal": "failed", "allan": "complete"}
    assert (out / "index.html").is_file()


def test_time_left_is_told_once_it_is_known_and_worth_it(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    stdout = io.StringIO()
    said = Said(stdout, io.StringIO())
    said.more(100)
    for status, seconds in (("unchanged", None), ("complete", 10.0), ("complete", 10.0)):
        now[0] += seconds or 0.0
        said.step("a", status, seconds)
    assert stdout.getvalue().splitlines() == [
        "[1/100] a: unchanged",
        "[2/100] a: complete, 10.0 s",
        "[3/100] a: complete, 10.0 s, about 16 min left",  # 97 at 10 s each
    ]
