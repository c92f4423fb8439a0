"""Throw-away chapters and a small device, so that reports are tested apart from the real ones."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import nbformat
import numpy as np

from sensorbook.reporting import chapters
from sensorbook.reporting.chapters import Chapter
from sensorbook.reporting.run import report

PARAMETERS = 'device = "../data/device"\nsensor = "gyroscope"'
NASTY = (
    'A "<script>alert(1)</script>"><img src="http://127.0.0.1:9/1.png" onerror="alert(1)"> & '
    "[link](http://evil.example) `{braces}` {{7*7}} ]]> $x$ **b**"
)

DEVICE = """schema = 1
id = "{id}"
name = {name}
{recordings}
[spec.gyroscope]
random_walk = {{ max = 0.3, unit = "deg/sqrt(h)" }}
bias_instability = {{ max = 10.0, unit = "deg/h" }}
rate_random_walk = {{ max = 1.0, unit = "deg/h/sqrt(s)" }}
"""
RECORDING = """
[[recording]]
sensor = "{sensor}"
kind = "{kind}"
file = "{file}"
rate = 10.0
unit = "{unit}"
columns = {{ x = "x", y = "y", z = "z", temperature = "t" }}
"""
UNITS = {"gyroscope": "deg/s", "accelerometer": "m/s^2", "magnetometer": "uT"}

LOAD = "from sensorbook.notebook import *\nbook, runs = load(device, sensor, KIND)"
NOISE = """
def entry(value):
    return {"value": value, "low": value * 0.95, "high": value * 1.05, "unit": "rad/s/sqrt(Hz)"}
axis = {
    "quantization": None,
    "random_walk": entry(6e-5),
    "noise_density": entry(6e-5 * 2**0.5),
    "bias_instability": entry(5e-5),
    "rate_random_walk": None,
    "rate_ramp": None,
    "upper_bounds": {"rate_random_walk": 1e-7},
}
record({"noise": {a: dict(axis, random_walk=entry(v)) for a, v in zip("xyz", (6e-5, 8.73e-5, 1e-4))}})
"""
FIGURE = """
from matplotlib.figure import Figure
figure = Figure(figsize=(6, 3.5))
axes = figure.subplots()
axes.plot([1, 2, 3], [1, 4, 9])
show(figure, caption="A parabola <b>", alt='A "parabola" <b>', thumbnail=True)
"""


def write_device(folder: Path, id: str, recordings, name: str = "A device") -> Path:
    """A device folder; `recordings` is (sensor, kind) pairs, all in one small file."""
    folder.mkdir(parents=True)
    values = np.random.default_rng(1).normal(size=(200, 3))
    text = io.StringIO()
    columns = np.column_stack([values, np.linspace(20, 40, 200)])
    np.savetxt(text, columns, delimiter=",", header="x,y,z,t", comments="")
    (folder / "data.csv").write_text(text.getvalue())
    tables = "".join(
        RECORDING.format(sensor=s, kind=k, file="data.csv", unit=UNITS[s]) for s, k in recordings
    )
    quoted = "'''" + name + "'''"
    (folder / "device.toml").write_text(DEVICE.format(id=id, name=quoted, recordings=tables))
    return folder


def write_notebook(path: Path, *cells, parameters: str = PARAMETERS) -> Path:
    """A notebook with a parameters cell; text cells begin with #."""
    notebook = nbformat.v4.new_notebook()
    notebook.metadata["kernelspec"] = {
        "name": "python3", "display_name": "Python 3", "language": "python",
    }  # fmt: skip
    first = nbformat.v4.new_code_cell(parameters)
    first.metadata["tags"] = ["parameters"]
    made = []
    for cell in cells:
        tags = []
        if isinstance(cell, tuple):
            cell, tags = cell
        kind = nbformat.v4.new_markdown_cell if cell.startswith("#") else nbformat.v4.new_code_cell
        made.append(kind(cell))
        made[-1].metadata["tags"] = list(tags)
    notebook.cells = [made[0], first, *made[1:]]
    nbformat.write(notebook, path)
    return path


def chapter(slug: str, notebook: Path, kind: str = "static", needs=(), result="noise") -> Chapter:
    sensors = chapters.INERTIAL_AND_MAGNETIC
    return Chapter(slug, notebook, slug.capitalize(), kind, sensors, tuple(needs), result)


@dataclass
class Run:
    """What one run of `report` did."""

    out: Path
    code: int
    stdout: str
    stderr: str

    def text(self, *parts: str) -> str:
        return self.out.joinpath(*parts).read_text(encoding="utf-8")

    def files(self) -> set[str]:
        return {str(p.relative_to(self.out)) for p in self.out.rglob("*") if p.is_file()}


def run(paths, out: Path, **options) -> Run:
    stdout, stderr = io.StringIO(), io.StringIO()
    code = report([str(p) for p in paths], str(out), stdout=stdout, stderr=stderr, **options)
    return Run(out, code, stdout.getvalue(), stderr.getvalue())
