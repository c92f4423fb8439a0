"""The command line: exit codes, one line a problem, examples in every help."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sensorbook import cli
from sensorbook.export import FORMATS
from sensorbook.reporting import chapters, execute, run
from sensorbook.simulate import PRESETS

sys.path.insert(0, str(Path(__file__).parent / "reporting"))
from throwaway import chapter, write_device, write_notebook


@pytest.mark.parametrize(
    "command", [(), ("report",), ("check",), ("new",), ("simulate",), ("export",), ("compare",)]
)
def test_every_help_has_an_example(command, capsys):
    assert cli.main([*command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "example:\n  sensorbook " in shown


def test_the_version_is_told(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("sensorbook ")


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("report",),
        ("paint", "x"),
        ("report", "x", "--jobs", "0"),
        ("report", "x", "--jobs", "two"),
        ("simulate", "x", "--seed", "one"),
        ("export",),
        ("export", "results.json"),
    ],
)
def test_wrong_usage_is_2(arguments, capsys):
    assert cli.main(list(arguments)) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_an_unknown_chapter_is_a_usage_error_that_lists_them(capsys, tmp_path):
    assert cli.main(["report", str(tmp_path), "--only", "alan", "thermal"]) == 2
    error = capsys.readouterr().err
    assert "'alan'" in error
    assert "thermal, psd, allan" in error
    assert "'thermal'" not in error


def test_an_unknown_preset_is_a_usage_error_that_lists_them(capsys, tmp_path):
    assert cli.main(["simulate", str(tmp_path / "d"), "--preset", "nope"]) == 2
    assert "ahrs" in capsys.readouterr().err


def test_an_unknown_format_is_a_usage_error_that_lists_them(capsys, tmp_path):
    assert cli.main(["export", str(tmp_path / "none.json"), "--format", "ros"]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"sensorbook export: --format: no format 'ros'; choose from {', '.join(FORMATS)}\n"
    )


def test_the_help_of_export_names_every_format(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.main(["export", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert all(f"{name}: {one.what} ({one.suffix})" in shown for name, one in FORMATS.items())


def test_the_list_of_formats_needs_no_results(capsys):
    assert cli.main(["export", "--list"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[:2] == ["format", "file"]
    assert [row.split()[:2] for row in rows] == [[f.name, f.suffix] for f in FORMATS.values()]
    for row, one in zip(rows, FORMATS.values(), strict=True):
        assert one.what in row
        assert row.endswith(one.needs)


def test_the_help_of_simulate_tells_every_preset(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.main(["simulate", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert {"ahrs", "rotation"} <= set(PRESETS)
    assert all(f"{name}: {what}" in shown for name, what in PRESETS.items())


def test_check_tells_every_problem_and_warnings_do_not_fail(tmp_path, capsys):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    assert cli.main(["check", str(device)]) == 0
    assert capsys.readouterr().err == ""
    file = device / "device.toml"
    file.write_text(file.read_text().replace('"deg/s"', '"deg/x"').replace('"x"', '"no_such"'))
    assert cli.main(["check", str(device)]) == 1
    error = capsys.readouterr().err
    assert "deg/x" in error
    assert "Traceback" not in error
    assert cli.main(["check", str(tmp_path / "missing")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_report_ends_with_0_and_tells_where_it_is(tmp_path, capsys, monkeypatch):
    notebook = write_notebook(tmp_path / "n.ipynb", "# N", "1")
    monkeypatch.setattr(chapters, "CHAPTERS", (chapter("allan", notebook),))
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    out = tmp_path / "out"
    assert cli.main(["report", str(device), "--out", str(out), "--force", "--only", "allan"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert f"{out}/dev-1/index.html\n{out}/index.html\n" in shown.out


@pytest.mark.parametrize("path", ["data.csv", "none", "."])
def test_what_is_no_device_folder_is_one_line(path, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data.csv").write_text("x\n1\n")
    assert cli.main(["report", path]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_traceback_is_for_debug_only(monkeypatch, capsys, tmp_path):
    def broken(*_, **__):
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(run, "report", broken)
    assert cli.main(["report", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.splitlines() == [
        "ZeroDivisionError: division by zero (a fault; --debug shows where)"
    ]
    assert cli.main(["report", str(tmp_path), "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_the_help_is_there_at_once():
    began = time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "sensorbook.cli", "--help"], check=True, stdout=subprocess.DEVNULL
    )
    # Alone it takes a fifth of this; the machine may be busy.
    assert time.monotonic() - began < 2.5


INTERRUPTED = """
import sys
from pathlib import Path
sys.path.insert(0, {helpers!r})
from throwaway import chapter
from sensorbook import cli
from sensorbook.export import FORMATS
from sensorbook.reporting import chapters
chapters.CHAPTERS = (chapter("allan", Path({notebook!r})),)
sys.exit(cli.main(["report", {device!r}, "--out", {out!r}]))
"""


def test_an_interrupt_ends_kernels_and_leaves_the_earlier_report(tmp_path):
    started = tmp_path / "pid"
    notebook = write_notebook(
        tmp_path / "n.ipynb",
        "# N",
        f"import os, time\nopen({str(started)!r}, 'w').write(str(os.getpid()) + ' ')\ntime.sleep(300)",
    )
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    page = tmp_path / "out" / "dev-1" / "gyroscope" / "allan.html"
    page.parent.mkdir(parents=True)
    page.write_text("earlier")
    code = INTERRUPTED.format(
        helpers=str(Path(__file__).parent / "reporting"),
        notebook=str(notebook),
        device=str(device),
        out=str(tmp_path / "out"),
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (started.exists() and started.read_text().endswith(" ")):
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    interrupted = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error == "stopped\n"
    assert time.monotonic() - interrupted < 10
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.read_text()), 0)
    assert page.read_text() == "earlier"
    assert not list((tmp_path / "out").glob(".partial*"))


def test_a_slow_cell_is_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(execute, "CELL_LIMIT", 1)
    notebook = write_notebook(tmp_path / "n.ipynb", "# N", "import time; time.sleep(60)")
    monkeypatch.setattr(chapters, "CHAPTERS", (chapter("allan", notebook),))
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    assert cli.main(["report", str(device), "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert "a cell took longer than 1 s" in error
    assert len(error.splitlines()) == 1
