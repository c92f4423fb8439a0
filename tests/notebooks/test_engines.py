"""Both engines give the same of every chapter: the warm one, and the reference, a kernel each."""

from __future__ import annotations

import builtins
import json
import re
from functools import partial
from pathlib import Path

import nbformat
import papermill
import pytest
from devices import executed

from sensorbook.notebook import MIME
from sensorbook.reporting import chapters, forks, warm

TIMED = ("seconds_an_epoch", "seconds_a_step")  # what chapters measure of themselves


def plain(text: str) -> str:
    """Text without what no two runs share: addresses in memory, times of day, and times measured."""
    timed = ("time a step", "time an epoch", "µs", "times as fast", "a step takes")
    if any(words in text for words in timed):
        return "times, measured"
    return re.sub(r"0x[0-9a-f]+|\d\d:\d\d:\d\d", "…", text)


def shape(notebook: nbformat.NotebookNode) -> list:
    """Every output of every cell, in order: its kind, its forms, and all of its texts."""
    found = []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            found.append((cell.source, cell.execution_count))
        for output in cell.get("outputs", ()):
            if output.output_type == "stream":
                text = "" if "UserWarning: To exit" in output.text else plain(output.text)
                # A kernel sends what is printed in pieces, by the clock.
                if found and found[-1][:2] == ("stream", output.name):
                    text = found.pop()[2] + text
                found += [("stream", output.name, text)] if text else []
            elif output.output_type == "error":
                found.append(("error", output.ename, output.evalue))
            else:
                texts = {
                    form: plain(text) if form.startswith("text/") else None
                    for form, text in output.data.items()
                }
                found.append((output.output_type, texts, dict(output.metadata)))
    return found


def numbers(notebook: nbformat.NotebookNode) -> list:
    """What was recorded, without times that were measured."""
    return [
        timeless(output.data[MIME])
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if MIME in output.get("data", {})
    ]


@pytest.mark.parametrize("chapter", chapters.CHAPTERS, ids=lambda c: c.slug)
def test_a_chapter_as_it_is_in_jupyter_is_the_same_in_both(
    chapter, demo_folder, moved_folder, turned_folder, orbiting_folder, flown_folder, monkeypatch
):
    """Defaults, teaching cells included, in a folder beside `data/`."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # as in a fork: else the last digits differ
    folder = demo_folder.parents[1] / "notebooks"
    folder.mkdir(exist_ok=True)
    warm.warm_up([chapter.notebook])
    warmly, kernel = (
        forks.apart(partial(_as_it_is, chapter.notebook, folder, engine))
        for engine in (warm.NAME, None)
    )
    assert not list(folder.iterdir()), "writes nothing"
    assert shape(warmly) == shape(kernel)
    # To the last digit: the same code, libraries and number of threads.
    assert json.dumps(numbers(warmly)) == json.dumps(numbers(kernel))
    timed = any(key in json.dumps(kernel) for key in TIMED)
    drawn = [pictures(warmly), pictures(kernel)]
    assert len(drawn[0]) == len(drawn[1])
    assert timed or drawn[0] == drawn[1]
    for key in ("kernelspec", "language_info"):
        assert warmly.metadata[key] == kernel.metadata[key]


def _as_it_is(notebook: Path, folder: Path, engine: str | None) -> nbformat.NotebookNode:
    return papermill.execute_notebook(
        str(notebook), None, engine_name=engine, kernel_name="python3", progress_bar=False,
        execution_timeout=300, cwd=str(folder),
    )  # fmt: skip


def timeless(value):
    if isinstance(value, list):
        return [timeless(part) for part in value]
    if isinstance(value, dict):
        return {k: timeless(part) for k, part in value.items() if not k.startswith(TIMED)}
    return value


def pictures(notebook: nbformat.NotebookNode) -> list[str]:
    return [
        "".join(output.data["image/png"].split())
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "image/png" in output.get("data", {})
    ]


CELLS = {
    "a fault": "1 / 0",
    "a refusal": "import sensorbook\nraise sensorbook.Refusal('Too short.', 'Record more.')",
    "bad input": "import sensorbook\nraise sensorbook.InputError(sensorbook.Problem('a', 'b', 'c', 'd'))",
    "a syntax error": "for",
    "an exit": "import sys\nsys.exit(3)",
    "an interrupt": "raise KeyboardInterrupt",
    "a value and text": "print('a')\nprint('b')\n1 + 1",
    "an error and text": "import sys\nprint('a', file=sys.stderr)\n[][1]",
    "a value that is not shown": "3;",
    "a table": "import pandas\npandas.DataFrame({'a': [1, 2]})",
    "an inline figure": "import matplotlib.pyplot as plt\n_ = plt.plot([1, 2])",
    "displays": "from IPython.display import HTML, display\ndisplay(HTML('<b>x</b>'), 3)",
    "raw displays": "display({'text/plain': 'x'}, raw=True, metadata={'a': 1})",
    "a magic": "%precision 3\n3.14159",
    "a wait": "import asyncio\nawait asyncio.sleep(0.01)\n'waited'",
    "a loop of its own": "import asyncio\nasyncio.iscoroutinefunction(print)",
    "where it is": "import os\nos.path.basename(os.getcwd()), __name__",
    "what was shown before": "4\n_",
    "cleared": "from IPython.display import clear_output\nprint('a')\nclear_output()\nprint('b')",
    "input": "input('?')",
}


@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
def test_a_cell_is_the_same_in_both(cell, tmp_path, monkeypatch):
    monkeypatch.setattr(builtins, "_", "of this process", raising=False)  # as doctests leave it
    notebook = nbformat.v4.new_notebook()
    notebook.metadata["kernelspec"] = {
        "name": "python3", "display_name": "Python 3", "language": "python",
    }  # fmt: skip
    notebook.cells = [nbformat.v4.new_code_cell(text) for text in ("5", cell, "'after'")]
    nbformat.write(notebook, tmp_path / "n.ipynb")
    warm, kernel = (
        executed(tmp_path / "n.ipynb", {}, tmp_path, engine) for engine in ("warm", "kernel")
    )
    assert (warm.status, plain(warm.reason or "")) == (kernel.status, plain(kernel.reason or ""))
    assert shape(warm.notebook) == shape(kernel.notebook)
