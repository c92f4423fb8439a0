"""A hundred small devices in one command: what is told on the way, time and memory beside the goals.

    python benchmarks/fleet.py [--devices 100] [--seed 1] [--jobs 2] [--only psd …]

Goals: every line tells how far the run is, with the time left; memory stays at or below 1.5 GB, and in
the last quarter of the run at or below 1.1 times the peak of the first. Memory is what the command and
all its processes hold, shared pages counted once (PSS; Linux alone tells it), every 0.2 s. Each device
is a gyroscope at rest, 120 s at 20 Hz: white noise and a walk of the bias, summed up sample by sample.
No peer runs many devices.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

COMMAND = str(Path(sys.executable).with_name("sensorbook"))
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SECONDS, RATE = 120.0, 20.0  # s, Hz
MEMORY, FLAT = 1.5e9, 1.1  # goals: bytes, and the last quarter's peak over the first's
EVERY = 0.2  # s
STEP = re.compile(r"\[(\d+)/(\d+)\] .*?: (\w+)(?:, [\d.]+ s)?(?:, about ([\d.]+) (s|min|h) left)?$")
UNIT = {"s": 1.0, "min": 60.0, "h": 3600.0}  # s

DEVICE = """\
schema = 1
id = "{id}"
name = "{id}"
"""
RECORDING = """
[[recording]]
sensor = "gyroscope"
kind = "{kind}"
file = "{kind}.csv"
unit = "deg/s"
columns = {{ time = "t", x = "x", y = "y", z = "z", temperature = "temp" }}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--devices", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", nargs="+", metavar="CHAPTER", help="for a quick trial")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for number in range(options.devices):
            rng = np.random.default_rng([options.seed, number])
            write_device(folder / f"device-{number:05d}", static=rest(rng))
        command = [COMMAND, "report", *map(str, sorted(folder.glob("device-*")))]
        command += ["--out", str(folder / "reports"), "--jobs", str(options.jobs)]
        command += ["--only", *options.only] if options.only else []
        print(
            f"{options.devices} devices of {SECONDS:g} s at {RATE:g} Hz, --jobs {options.jobs},"
            f" {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before"
        )
        first = Run(command)
        pages = len(list((folder / "reports").glob("device-*/index.html")))
        second = Run(command)
    minutes = first.seconds / 60
    print(f"  reports      {pages} of {options.devices}, exit code {first.code}   goal all and 0")
    tell_progress(first)
    print(
        f"  time         {first.seconds:6.1f} s, {options.devices / minutes:.1f} devices a minute"
    )
    tell_memory(first)
    ends = ", ".join(f"{count} {end}" for end, count in Counter(s[3] for s in second.steps).items())
    print(f"  second run   {second.seconds:6.1f} s ({ends}), exit code {second.code}")


class Run:
    """A command from start to end, in a session of its own.

    Attributes
    ----------
    code, seconds : how it ended, and after how long
    steps : (s from the start, step, of so many, how it ended, s said to be left or None) of each line
    held : (s from the start, bytes that all its processes hold together)
    """

    def __init__(self, command: list[str]):
        self.steps: list[tuple[float, int, int, str, float | None]] = []
        self.held: list[tuple[float, float]] = []
        began = time.monotonic()
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, env=os.environ | ONE_THREAD,
            start_new_session=True,
        )  # fmt: skip
        ended = threading.Event()

        def sample() -> None:
            while not ended.wait(EVERY):
                self.held.append((time.monotonic() - began, sum(map(held, members(process.pid)))))

        sampling = threading.Thread(target=sample)
        sampling.start()
        for line in process.stdout:
            if found := STEP.match(line.rstrip()):
                done, total, end, left, unit = found.groups()
                left = float(left) * UNIT[unit] if left else None
                self.steps.append((time.monotonic() - began, int(done), int(total), end, left))
        self.code = process.wait()
        self.seconds = time.monotonic() - began
        ended.set()
        sampling.join()


def members(session: int) -> Iterator[int]:
    """Processes of a session that run; not those that ended and are still to be reaped."""
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if int(fields[3]) == session and fields[0] not in "ZX":
            yield int(place.name)


def held(process: int) -> float:
    """Bytes of memory that a process holds, its share of what it shares; 0 where it has ended."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return 0.0
    found = re.search(r"^Pss:\s+(\d+) kB", text, re.MULTILINE)
    return float(found[1]) * 1024 if found else 0.0


def tell_progress(run: Run) -> None:
    """Prints what was told on the way: of how many steps from the first line on, and the time left."""
    count = len(run.steps)
    right = sum(total == count for _, _, total, _, _ in run.steps)
    print(f"  progress     {count} lines, {right} with the right number of all   goal all")
    estimates = [(at, left) for at, _, _, _, left in run.steps if left is not None]
    print(f"  time left    told {len(estimates)} times   goal most lines", end="")
    if estimates:
        at, left = min(estimates, key=lambda told: abs(told[0] - run.seconds / 2))
        print(
            f"; after {at:.0f} s about {left:.0f} s, and it took {run.seconds - at:.0f} s", end=""
        )
    print()


def tell_memory(run: Run) -> None:
    """Prints the peak of the memory, and how much of it is left of the first quarter in the last."""
    quarter = run.seconds / 4
    peak = max(bytes_ for _, bytes_ in run.held)
    first = max(bytes_ for at, bytes_ in run.held if at <= quarter)
    last = max(bytes_ for at, bytes_ in run.held if at >= 3 * quarter)
    print(
        f"  memory       {peak / 1e9:6.2f} GB at most   goal {MEMORY / 1e9:g} GB\n"
        f"               {first / 1e9:6.2f} GB in the first quarter, {last / 1e9:.2f} GB in the last:"
        f" {last / first:.2f} times   goal {FLAT:g}"
    )


# ---- the devices ----


def rest(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A gyroscope at rest: s, deg/s and °C."""
    samples = round(SECONDS * RATE)
    white = rng.uniform(0.003, 0.01) * np.sqrt(RATE)  # deg/s, of 0.003 … 0.01 deg/√s
    walk = rng.uniform(1e-4, 3e-4) / np.sqrt(RATE)  # deg/s a sample
    bias = rng.uniform(-0.5, 0.5, 3)  # deg/s
    values = bias + np.cumsum(walk * rng.standard_normal((samples, 3)), axis=0)
    values += white * rng.standard_normal((samples, 3))
    table = {"t": np.arange(samples) / RATE} | dict(zip("xyz", values.T, strict=True))
    return table | {"temp": 25 + 0.01 * rng.standard_normal(samples)}


def write_device(folder: Path, **tables: dict[str, np.ndarray]) -> None:
    """A device's folder, with a recording a keyword, which is its kind."""
    folder.mkdir()
    text = DEVICE.format(id=folder.name)
    for kind, table in tables.items():
        columns = np.column_stack(list(table.values()))
        np.savetxt(
            folder / f"{kind}.csv", columns, "%.9g", ",", header=",".join(table), comments=""
        )
        text += RECORDING.format(kind=kind)
    (folder / "device.toml").write_text(text)


if __name__ == "__main__":
    main()
