"""Small devices for the chapters, and how to render them."""

from __future__ import annotations

import contextlib
import html
import io
import json
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sensorbook.cli import main
from sensorbook.reporting import chapters, execute, forks, warm
from sensorbook.simulate.noise import coloured_noise

DEVICE = 'schema = 1\nid = "{id}"\nname = "{id}"\n'
RECORDING = """
[[recording]]
sensor = "gyroscope"
kind = "{kind}"
file = "{file}"
unit = "deg/s"
columns = {{ time = "t", x = "x", y = "y", z = "z", temperature = "temp" }}
"""


@dataclass(frozen=True)
class Report:
    """What a run left: its exit code, what it said and its tree."""

    code: int
    said: str
    folder: Path

    @property
    def results(self) -> dict:
        return json.loads((self.folder / "results.json").read_text())

    def page(self, chapter: str, sensor: str = "gyroscope") -> str:
        """What a reader sees: without the folded code and without tags, in one line."""
        text = (self.folder / sensor / f"{chapter}.html").read_text()
        text = re.sub(r"<details.*?</details>|<style.*?</style>", "", text, flags=re.DOTALL)
        return " ".join(html.unescape(re.sub(r"<[^>]+>", "", text)).split())

    def status(self, sensor: str, chapter: str) -> tuple[str, str | None]:
        for row in self.results["chapters"]:
            if (row["sensor"], row["chapter"]) == (sensor, chapter):
                return row["status"], row["reason"]
        raise KeyError((sensor, chapter))


def render(device: Path, out: Path, *only: str) -> Report:
    """Renders a device, or `only` some chapters, through the command line; its words are in `said`."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        chosen = ["--only", *only] if only else []
        code = main(["report", str(device), "--out", str(out), *chosen])
    return Report(code, said.getvalue(), out / device.name)


def rest(seconds: float = 300.0, rate: float = 20.0, seed: int = 5, **terms) -> dict:
    """A gyroscope at rest, deg/s, by spectral synthesis."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate)
    terms = {"random_walk": 0.005} | terms
    table = {"t": np.arange(n) / rate}
    table |= {axis: coloured_noise(n, rate, rng, **terms) for axis in "xyz"}
    return table | {"temp": 25 + 0.01 * rng.standard_normal(n)}


def sweep(low: float, high: float, both_ways: bool = True, seed: int = 6) -> dict:
    """A sweep at 1 Hz with straight-line bias, deg/s."""
    rng = np.random.default_rng(seed)
    n = 2400
    ends = [low, high, low] if both_ways else [low, (low + high) / 2, high]
    t = np.interp(np.arange(n), [0, n / 2, n], ends)
    table = {"t": np.arange(n, dtype=float)}
    for axis, slope in zip("xyz", (0.01, -0.02, 0.005), strict=True):
        table[axis] = 0.3 + slope * (t - 25) + 0.002 * rng.standard_normal(n)
    return table | {"temp": t + 0.01 * rng.standard_normal(n)}


def write(folder: Path, **tables: dict) -> Path:
    """A device folder with one recording a keyword, named by its kind."""
    folder.mkdir(parents=True)
    text = DEVICE.format(id=folder.name)
    for kind, table in tables.items():
        columns = np.column_stack(list(table.values()))
        head = ",".join(table)
        np.savetxt(folder / f"{kind}.csv", columns, "%.9g", ",", header=head, comments="")
        text += RECORDING.format(kind=kind, file=f"{kind}.csv")
    (folder / "device.toml").write_text(text)
    return folder


def executed(
    notebook: Path, parameters: dict, folder: Path, engine: str = "warm"
) -> execute.Outcome:
    """A notebook executed as a report does it, in a fork."""
    warm.warm_up([notebook])
    call = partial(execute.execute, notebook, parameters, folder, folder, "", engine=engine)
    return forks.apart(call)


def read_chapter(slug: str, folder: Path, **parameters) -> tuple[dict, str]:
    """Executes a chapter that needs no device; returns what it recorded and what a reader sees of it."""
    chapter = next(c for c in chapters.CHAPTERS if c.slug == slug)
    outcome = executed(chapter.notebook, parameters, folder)
    assert outcome.status == "complete", outcome.reason
    about = dict.fromkeys(("id", "name", "model", "serial"))
    record = execute.record_of(outcome, chapter, "", about)
    shown = [
        output.get("data", {}).get("text/plain", "")
        for cell in outcome.notebook.cells
        for output in cell.get("outputs", ())
    ]
    return record, " ".join(" ".join(shown).split())


def ended(slug: str, folder: Path, **parameters) -> tuple[str, str | None]:
    """How a chapter that needs no device ends, and why."""
    chapter = next(c for c in chapters.CHAPTERS if c.slug == slug)
    outcome = executed(chapter.notebook, parameters, folder)
    return outcome.status, outcome.reason
