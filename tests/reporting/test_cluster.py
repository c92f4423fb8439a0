"""Devices on a Dask cluster of two workers on this machine, of which one is killed."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from throwaway import LOAD, NOISE, run, write_device, write_notebook

from sensorbook import InputError, cli

pytest.importorskip("distributed", reason="the extra sensorbook[cluster] is not installed")

# What a worker's processes run: the throw-away chapter in place of the real ones.
CUSTOMISE = """
import sys
from pathlib import Path
sys.path.insert(0, {helpers!r})
try:
    from throwaway import chapter
    from sensorbook.reporting import chapters
    chapters.CHAPTERS = (chapter("allan", Path({notebook!r})),)
except ImportError:
    pass
"""
SLOW = "import time\ntime.sleep(2)"


@pytest.fixture
def cluster(tmp_path, table):
    """The scheduler's address, and its two workers; all end with the test."""
    from throwaway import chapter

    notebook = write_notebook(
        tmp_path / "n.ipynb", "# N", LOAD.replace("KIND", '"static"'), SLOW, NOISE
    )
    table(chapter("allan", notebook))
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(
        CUSTOMISE.format(helpers=str(Path(__file__).parent), notebook=str(notebook))
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    dask = [sys.executable, "-m", "dask"]
    log = tmp_path / "scheduler.log"
    started = []

    def start(*arguments):
        started.append(
            subprocess.Popen(
                [*dask, *arguments],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=log.open("a"),
                cwd=tmp_path,
                start_new_session=True,
            )
        )
        return started[-1]

    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        found = None
        deadline = time.monotonic() + 60
        while found is None:
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.1)
            found = re.search(r"tcp://127\.0\.0\.1:\d+", log.read_text())
        workers = [
            start("worker", found[0], "--nthreads", "1", "--no-dashboard", "--no-nanny",
                  "--local-directory", str(tmp_path / f"worker{k}"))
            for k in range(2)
        ]  # fmt: skip
        yield found[0], workers
    finally:
        for process in started:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_every_report_is_there_though_a_worker_is_killed(cluster, tmp_path):
    address, workers = cluster
    devices = [
        write_device(tmp_path / f"d{k}", f"dev-{k}", [("gyroscope", "static")]) for k in range(6)
    ]
    (devices[5] / "data.csv").write_text("x,y,z,t\n1,2,oops,4\n")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "sensorbook.cli", "report", *map(str, devices)]
    process = subprocess.Popen(
        [*command, "--out", str(out), "--cluster", address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 120
    while not list(out.glob("dev-*/index.html")):
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    os.killpg(workers[0].pid, signal.SIGKILL)
    stdout, stderr = process.communicate(timeout=180)
    assert process.returncode == 1
    assert stderr.count("\n") == 1
    assert stderr.startswith("dev-5: data.csv: ")
    assert "oops" in stderr
    for k in range(6):
        found = json.loads((out / f"dev-{k}" / "results.json").read_text())
        assert [c["status"] for c in found["chapters"]] == ["failed" if k == 5 else "complete"]
        page = out / f"dev-{k}" / "gyroscope" / "allan.html"
        assert page.is_file() is (k != 5)
    assert {line.split()[1] for line in stdout.splitlines() if line.startswith("[")} == {
        f"dev-{k}:" for k in range(6)
    }
    assert "[6/6]" in stdout
    again = run(devices[:5], out, cluster=address)
    assert again.code == 0, again.stderr
    assert again.stdout.count("1 unchanged") == 5


def test_no_scheduler_is_one_line(tmp_path, capsys):
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    for address, code in (("tcp://127.0.0.1:9", 1), ("http://a:1", 2), ("foo", 2), ("", 2)):
        given = ["report", str(device), "--out", str(tmp_path), "--cluster", address]
        assert cli.main(given) == code
        error = capsys.readouterr().err
        assert "--cluster" in error
        assert len(error.splitlines()) == 1 or code == 2


def test_without_the_extra_the_command_to_install_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    device = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    with pytest.raises(InputError, match=r"pip install 'sensorbook\[cluster\]'"):
        run([device], tmp_path / "out", cluster="tcp://127.0.0.1:1")
