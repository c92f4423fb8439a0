"""Runs killed at random moments and run again: what they leave, beside the goal that nothing is lost.

    python benchmarks/killed_runs.py [--runs 50] [--seed 1] [--jobs 2] [--only psd …]

A device with a rest and a temperature sweep has five chapters. Half of the runs are killed (SIGKILL),
half are interrupted (SIGINT), each at a moment drawn uniformly over the time that an undisturbed run
takes; half begin in an empty folder, half make a finished report anew (--force). What is looked at:

whole     at once after the signal, every page there ends and its figures decode, every record and
          notebook is JSON, and no other file lies outside of the folders that are marked as partial
ended     2 s after the signal none of its processes runs
resumed   the run again ends with exit code 0 and leaves no partial folder
equal     then the files are those of the undisturbed run, with the same results, records and pages
          but for dates and the keys that tell what is up to date

Goal: every run in all four. No peer resumes.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fleet import COMMAND, ONE_THREAD, members, rest, write_device
from PIL import Image

PATIENCE = 2.0  # s after the signal, in which all processes must end
LONGEST = 600.0  # s; a run that takes longer hangs
FIGURE = re.compile(r"data:image/\w+;base64,([A-Za-z0-9+/=\s]*)")
DATE = re.compile(
    r"\d{1,2} (January|February|March|April|May|June|July|August|September|October|November|December)"
    r" \d{4}|\d{4}-\d\d-\d\d"
)
PASSING = ("created", "key")  # of records and results: when they were made, and by which software
LOOKED_AT = ("whole", "ended", "resumed", "equal")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", nargs="+", metavar="CHAPTER", help="for a quick trial")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
    rng = np.random.default_rng(options.seed)
    count: Counter[str] = Counter()
    faults = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        write_device(folder / "device", static=rest(rng), thermal=sweep(rng))
        command = [COMMAND, "report", str(folder / "device"), "--jobs", str(options.jobs)]
        command += ["--only", *options.only] if options.only else []
        undisturbed, seconds, code = folder / "undisturbed", *run(command, folder / "undisturbed")
        files = listed(undisturbed)
        print(
            f"undisturbed: {seconds:.1f} s, {len(files)} files, exit code {code}; --jobs"
            f" {options.jobs}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
        numbers = rng.permutation(options.runs)  # quarters of them are of each kind
        for number in numbers:
            sent = (signal.SIGKILL, signal.SIGINT)[number % 2]
            forced = bool(number // 2 % 2)
            moment = rng.uniform(0, seconds)
            out = folder / "out"
            if forced:
                shutil.copytree(undisturbed, out)
            found, late = killed(
                [*command, "--out", str(out), *(["--force"] if forced else [])], sent, moment, out
            )
            found["whole"] += [f"a file of none: {name}" for name in sorted(listed(out) - files)]
            _, code = run(command, out)
            partial = [path.name for path in out.glob(".partial-*")]
            found["resumed"] = [f"exit code {code}"] * (code != 0) + partial
            found["equal"] = list(differences(undisturbed, out))
            count.update(what for what in LOOKED_AT if not found[what])
            count["late"] += late
            kind = f"{sent.name} after {moment:.1f} s{', --force' * forced}"
            faults += [f"{kind}: {what}: {t}" for what in LOOKED_AT for t in found[what]]
            shutil.rmtree(out)
    for what in LOOKED_AT:
        print(f"  {what:<9}{count[what]:4} of {options.runs}   goal {options.runs}")
    print(f"  {count['late']} had ended before the signal")
    for line in faults:
        print(line)


def run(command: list[str], out: Path) -> tuple[float, int | None]:
    """Seconds that a run takes, and its exit code; None where it hangs."""
    began = time.monotonic()
    try:
        code = subprocess.run(
            [*command, "--out", str(out)], stdout=subprocess.DEVNULL, env=os.environ | ONE_THREAD,
            timeout=LONGEST,
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        code = None
    return time.monotonic() - began, code


def killed(
    command: list[str], sent: signal.Signals, moment: float, out: Path
) -> tuple[dict[str, list[str]], bool]:
    """What is wrong after a run that is sent a signal some s after its start, and whether that was late."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | ONE_THREAD,
        start_new_session=True,
    )  # fmt: skip
    time.sleep(moment)
    late = process.poll() is not None
    process.send_signal(sent)
    at_once = list(broken(out))
    deadline = time.monotonic() + PATIENCE
    while process.poll() is None or any(members(process.pid)):
        if time.monotonic() > deadline:
            break
        time.sleep(0.02)
    left = []
    for member in members(process.pid):
        left.append(f"process {member} is left: {told_of(member)}")
        os.kill(member, signal.SIGKILL)
    process.wait()
    return {"whole": [*at_once, *broken(out)], "ended": left}, late


def told_of(process: int) -> str:
    """State and place in the kernel of a process."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
        return " ".join(re.search(r"^State:\s+(.*)", status, re.MULTILINE)[1].split())
    except OSError:
        return "it ended meanwhile"


# ---- what is there ----


def listed(out: Path) -> set[str]:
    """The files of a report, but for those in partial folders."""
    names = (path.relative_to(out) for path in out.rglob("*") if path.is_file())
    return {name.as_posix() for name in names if not name.parts[0].startswith(".partial-")}


def broken(out: Path) -> Iterator[str]:
    """What is not whole of a report's files; those that go while they are looked at are passed over."""
    for name in sorted(listed(out)):
        try:
            text = (out / name).read_text(encoding="utf-8")
        except FileNotFoundError:
            continue
        except UnicodeDecodeError as error:
            yield f"{name}: {error}"
            continue
        try:
            if name.endswith((".json", ".ipynb")):
                json.loads(text)
            elif name.endswith(".html"):
                if not text.rstrip().endswith("</html>"):
                    yield f"{name}: has no end"
                for figure in FIGURE.findall(text):
                    Image.open(io.BytesIO(base64.b64decode(figure, validate=True))).load()
            elif not text.endswith("\n"):
                yield f"{name}: has no end"
        except (ValueError, OSError, SyntaxError) as error:  # as Pillow tells a damaged image
            yield f"{name}: {error}"


def differences(undisturbed: Path, out: Path) -> Iterator[str]:
    """In what a report is not the undisturbed one."""
    names, others = listed(undisturbed), listed(out)
    yield from (f"missing: {name}" for name in sorted(names - others))
    yield from (f"not to be there: {name}" for name in sorted(others - names))
    for name in sorted(names & others):
        if lasting(undisturbed / name) != lasting(out / name):
            yield f"differs: {name}"


def lasting(path: Path) -> Any:
    """What a file holds but for dates, and of a notebook the outputs of its cells alone."""
    data = path.read_bytes()
    try:
        if path.suffix == ".ipynb":  # the rest is how long each cell took
            return [cell.get("outputs") for cell in json.loads(data)["cells"]]
        if path.suffix == ".json":
            return without(json.loads(data))
        return DATE.sub("", data.decode()) if path.suffix == ".html" else data
    except ValueError:  # not whole
        return data


def without(value: Any) -> Any:
    """A value of JSON without what passes."""
    if isinstance(value, dict):
        return {key: without(part) for key, part in value.items() if key not in PASSING}
    return [without(part) for part in value] if isinstance(value, list) else value


def sweep(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A sweep from 20 °C to 40 °C and back at 1 Hz, with a bias that follows it: s, deg/s and °C."""
    samples = 2400
    temperature = np.interp(np.arange(samples), [0, samples / 2, samples], [20.0, 40.0, 20.0])
    values = np.outer(temperature - 25, rng.uniform(-0.02, 0.02, 3))
    values += 0.3 + 0.002 * rng.standard_normal((samples, 3))
    table = {"t": np.arange(float(samples))} | dict(zip("xyz", values.T, strict=True))
    return table | {"temp": temperature + 0.01 * rng.standard_normal(samples)}


if __name__ == "__main__":
    main()
