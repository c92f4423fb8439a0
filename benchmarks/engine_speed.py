"""Time of a whole report beside one papermill and one nbconvert command a chapter.

    python benchmarks/engine_speed.py [--seed 1] [--runs 3] [--only psd …]

The device is the simulated AHRS with all its chapters, two sensors one after the other. Goals: at least
5 times faster than the peers with one job; at most 3 s where nothing has changed; at least 1.6 times
faster with two jobs than with one (on two cores). The peers run the same notebooks with the same
parameters in the same order and read the thermal records of a report made before: as they are shipped,
which is what somebody would type, and, to see the engines alone, without the cells that only teach,
which reports leave out. All have one thread of BLAS. Reports are rendered `--runs` times, one and two
jobs in turn, with the peers' commands spread evenly between, so that all meet the same machine, and
their mean is told; the engine "kernel", for information, once. CPU is that of all processes together:
where a machine is busy with something else, only that can be compared.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import nbformat

from sensorbook.reporting.chapters import CHAPTERS, Chapter

BIN = Path(sys.executable).parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
PEERS, UNCHANGED, TWO_JOBS = 5.0, 3.0, 1.6  # goals: times, s, times
SENSORS = ("accelerometer", "gyroscope")  # of the device, in the order of reports
KINDS = ("thermal", "static")  # of the device's recordings


class Took(NamedTuple):
    """Wall and CPU time of a command, s, and what it said."""

    wall: float
    cpu: float
    said: str = ""

    def __add__(self, other: Took) -> Took:
        return Took(self.wall + other.wall, self.cpu + other.cpu)

    def over(self, other: Took) -> str:
        return f"{self.wall / other.wall:5.2f} times, CPU {self.cpu / other.cpu:5.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", nargs="+", metavar="CHAPTER", help="for a quick trial")
    options = parser.parse_args()
    chosen = [c for c in CHAPTERS if c.kind in KINDS and c.slug in (options.only or [c.slug])]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        device, reports = folder / "device", folder / "reports"
        timed("sensorbook", "simulate", device, "--preset", "ahrs", "--seed", options.seed)
        command = ["sensorbook", "report", device, "--only", *(c.slug for c in chosen)]
        command = command if options.only else command[:3]
        print(
            f"simulated AHRS, {len(chosen) * len(SENSORS)} chapters,"
            f" {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before",
            flush=True,
        )
        chapters = [(sensor, chapter) for chapter in chosen for sensor in SENSORS]
        jobs: dict[int, list[Took]] = {1: [], 2: []}
        peers = {taught: (Took(0.0, 0.0), Took(0.0, 0.0)) for taught in (True, False)}
        for number in range(options.runs):
            for count, times in jobs.items():
                times.append(timed(*command, "--out", reports, "--jobs", count, "--force"))
            for sensor, chapter in chapters[number :: options.runs]:
                for taught, so_far in peers.items():
                    took = peer(sensor, chapter, device, reports, folder, taught)
                    peers[taught] = so_far[0] + took[0], so_far[1] + took[1]
        one, two = mean(jobs[1]), mean(jobs[2])
        tell("report, 1 job", one)
        tell("report, 2 jobs", two, f"{one.over(two)}   goal {TWO_JOBS:g} times")
        again = mean([timed(*command, "--out", reports, "--jobs", 1) for _ in range(options.runs)])
        same = again.said.count(": unchanged")
        tell("nothing changed", again, f"goal {UNCHANGED:g} s   {same} chapters unchanged")
        for taught, (papermill, nbconvert) in peers.items():
            cells = "as shipped" if taught else "not taught"
            both = papermill + nbconvert
            tell(f"papermill, {cells}", papermill)
            tell(f"nbconvert, {cells}", nbconvert)
            tell("  both, to 1 job", both, f"{both.over(one)}   goal {PEERS:g} times")
        kernel = timed(*command, "--out", folder / "kernel", "--jobs", 1, "--engine", "kernel")
        tell("kernel, 1 job", kernel, kernel.over(one))


def peer(
    sensor: str, chapter: Chapter, device: Path, reports: Path, folder: Path, taught: bool
) -> tuple[Took, Took]:
    """Times of papermill and of nbconvert; `taught` is whether cells are run that only teach."""
    made = reports / next(reports.glob("*/results.json")).parent.name
    source, output = (folder / f"{name}.ipynb" for name in ("shipped", "executed"))
    notebook = nbformat.read(chapter.notebook, as_version=4)
    notebook.cells = [
        cell for cell in notebook.cells if taught or "teaching" not in cell.metadata.get("tags", ())
    ]
    nbformat.write(notebook, source)
    given = {"device": device, "sensor": sensor}
    for need in chapter.needs:
        record = made / sensor / f"{need}.json"
        given[f"{need}_record"] = record if record.is_file() else ""
    parameters = [part for key, value in given.items() for part in ("-r", key, value)]
    return (
        timed("papermill", source, output, *parameters, "--cwd", folder),
        timed("jupyter", "nbconvert", "--to", "html", output),
    )


def timed(command: str, *arguments: object) -> Took:
    """Times of a command of this environment, which must end well."""
    before, began = cpu(), time.monotonic()
    done = subprocess.run(
        [BIN / command, *map(str, arguments)], env=os.environ | ONE_THREAD, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    took = Took(time.monotonic() - began, cpu() - before, done.stdout)
    if done.returncode:
        raise SystemExit(f"{command} {' '.join(map(str, arguments))}:\n{done.stdout}")
    return took


def cpu() -> float:
    """CPU time of all that this process started and that has ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def mean(times: list[Took]) -> Took:
    walls, cpus, said = zip(*times, strict=True)
    return Took(statistics.mean(walls), statistics.mean(cpus), said[-1])


def tell(what: str, took: Took, more: str = "") -> None:
    line = f"  {what:<22}{took.wall:7.1f} s, CPU {took.cpu:7.1f} s   {more}"
    print(line.rstrip(), flush=True)


if __name__ == "__main__":
    main()
