"""The warm engine: papermill runs a notebook in this process, which has every import already.

It stands behind papermill's own engine interface, so that parameters, metadata and errors are
papermill's as ever; only the kernel is replaced, by IPython's shell. What a notebook changes stays
changed (settings of matplotlib, random state, working folder), hence each runs in a fork of its own:
`forks`.
"""

from __future__ import annotations

import ast
import asyncio
import builtins
import contextlib
import gc
import importlib
import io
import json
import os
import random
import signal
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
from ipykernel.compiler import XCachingCompiler
from IPython.core.displayhook import DisplayHook
from IPython.core.displaypub import DisplayPublisher
from IPython.core.error import StdinNotImplementedError
from IPython.core.interactiveshell import InteractiveShell
from nbformat.v4 import new_output
from papermill.engines import Engine, papermill_engines
from traitlets import List, Type
from traitlets.config import Config

from sensorbook import units

NAME = "warm"


class WarmEngine(Engine):
    """papermill's engine of the name `NAME`."""

    @classmethod
    def execute_managed_notebook(
        cls,
        nb_man: Any,
        kernel_name: str,
        execution_timeout: int = 0,
        checkpoint: Path | None = None,
        **_: Any,
    ) -> None:
        """Runs the cells up to the first that raises.

        A cell that takes longer than `execution_timeout` seconds ends this process with SIGALRM,
        whatever it does: nothing in Python can stop a loop in C. What was shown up to then stands in
        `checkpoint`, but for the last second.
        """
        _as_a_kernel_starts()
        if InteractiveShell.initialized():  # where a report is made from within a notebook
            type(InteractiveShell.instance()).clear_instance()
        shell = _ZMQLikeShell.instance(config=_CONFIG)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        saved = 0.0
        for index, cell in enumerate(nb_man.nb.cells):
            nb_man.cell_start(cell, index)
            if checkpoint and time.monotonic() - saved > 1:  # writing takes long beside most cells
                checkpoint.write_text(json.dumps(nb_man.nb), encoding="utf-8")
                saved = time.monotonic()
            if cell.cell_type == "code" and cell.source.strip():
                signal.alarm(execution_timeout)
                completed = shell.run(cell)
                signal.alarm(0)
            else:
                completed = True
            if not completed:
                nb_man.cell_exception(cell, index)
            nb_man.cell_complete(cell, index)
            if not completed:
                break
        nb_man.nb.metadata["language_info"] = _LANGUAGE


papermill_engines.register(NAME, WarmEngine)

_CONFIG = Config()
_CONFIG.HistoryManager.enabled = False  # neither a file nor a thread for it

# As the kernel tells it (ipykernel.ipkernel.IPythonKernel.language_info).
_LANGUAGE = {
    "name": "python",
    "version": sys.version.split()[0],
    "mimetype": "text/x-python",
    "codemirror_mode": {"name": "ipython", "version": sys.version_info[0]},
    "pygments_lexer": f"ipython{sys.version_info[0]}",
    "nbconvert_exporter": "python",
    "file_extension": ".py",
}


class _Publisher(DisplayPublisher):
    """What `display` shows goes into the cell's outputs."""

    outputs = List()

    def publish(
        self, data: dict, metadata: dict | None = None, *, update: bool = False, **_: Any
    ) -> None:
        self.outputs.append(new_output("display_data", data=data, metadata=metadata or {}))

    def clear_output(self, wait: bool = False) -> None:
        self.outputs.clear()


class _Displayhook(DisplayHook):
    """The value of a cell's last expression goes into its outputs."""

    def __call__(self, result: Any = None) -> None:
        self.check_for_underscore()
        if result is None or self.quiet():
            return
        data, metadata = self.compute_format_data(result)
        self.update_user_ns(result)
        self.fill_exec_result(result)
        if data:
            self.shell.display_pub.outputs.append(
                new_output(
                    "execute_result",
                    data=data,
                    metadata=metadata,
                    execution_count=self.prompt_count,
                )
            )


class _Stream(io.TextIOBase):
    """Standard output or error: text that follows on text of the same stream is one output."""

    encoding = "utf-8"

    def __init__(self, name: str, outputs: list):
        self.name, self.outputs = name, outputs

    def write(self, text: str) -> int:
        last = self.outputs[-1] if self.outputs else None
        if last is not None and last.output_type == "stream" and last.name == self.name:
            last.text += text
        elif text:
            self.outputs.append(new_output("stream", name=self.name, text=text))
        return len(text)

    def writable(self) -> bool:
        return True


class _ZMQLikeShell(InteractiveShell):
    """IPython's shell, with what cells show kept as a notebook's outputs.

    pandas lays its tables out for a notebook where the class of the shell has "zmq" in its name.
    """

    display_pub_class = Type(_Publisher)
    displayhook_class = Type(_Displayhook)
    compiler_class = Type(XCachingCompiler)  # the kernel's, which names cells in tracebacks

    def run(self, cell: nbformat.NotebookNode) -> bool:
        """Runs a cell and fills in its outputs; returns whether it completed."""
        outputs = self.display_pub.outputs = []
        streams = _Stream("stdout", outputs), _Stream("stderr", outputs)
        with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
            done = self.run_cell(cell.source, store_history=True)
        cell.execution_count = done.execution_count
        cell.outputs = outputs
        return done.success

    def _showtraceback(self, etype: type, evalue: BaseException, stb: list[str]) -> None:
        self.display_pub.outputs.append(
            new_output("error", ename=etype.__name__, evalue=str(evalue), traceback=list(stb))
        )

    def enable_gui(self, gui: str | None = None) -> None:
        pass


def _as_a_kernel_starts() -> None:
    """Takes back what a fresh process would not have: settings, random state and a running loop."""
    builtins.input = _no_input
    vars(builtins).pop("_", None)  # Python's own prompt, and doctests, leave what they showed there
    random.seed()
    np.random.seed()  # noqa: NPY002, the state that notebooks could share
    asyncio.set_event_loop(asyncio.new_event_loop())
    if (matplotlib := sys.modules.get("matplotlib")) is not None:
        matplotlib.rcParams.update(matplotlib.rcParamsOrig)
        matplotlib.use("agg")  # figures are shown by `notebook.show`, and by nothing else
    os.environ["MPLBACKEND"] = "agg"
    if (pandas := sys.modules.get("pandas")) is not None:
        pandas.set_option("display.max_columns", 20)  # as it sets when it is imported in a kernel


def _no_input(*_: Any) -> str:
    raise StdinNotImplementedError(
        "raw_input was called, but this frontend does not support input requests."
    )


# What is imported only where it is first used, and nearly every chapter uses it.
_LATE = (
    "IPython.core.completer",
    "IPython.core.magics",
    "IPython.core.oinspect",
    "matplotlib.pyplot",
    "pandas.io.formats.html",
    "sensorbook.apply",
)


def warm_up(notebooks: Iterable[Path]) -> None:
    """Makes here what all forks would: imports of some notebooks, the fonts and the table of units."""
    used = {name for notebook in notebooks for name in _imported(notebook)}
    for name in sorted(used | set(_LATE)):
        with contextlib.suppress(ImportError):  # theirs to tell
            importlib.import_module(name)
    from matplotlib.figure import Figure

    from sensorbook.plots.drawing import drawn, encoded

    units.factor("deg/s", "rad/s")
    figure = Figure()
    figure.subplots().set_title("$N$")
    encoded(figure, drawn(figure, 50))
    gc.freeze()  # what is here stays: forks that looked through it again would copy its memory, too


def _imported(notebook: Path) -> set[str]:
    """Names of the modules that a notebook's cells import."""
    found = set()
    with contextlib.suppress(Exception):  # damaged, or no plain Python: its execution tells
        for cell in nbformat.read(notebook, as_version=4).cells:
            for node in ast.walk(ast.parse(cell.source)) if cell.cell_type == "code" else ():
                if isinstance(node, ast.Import):
                    found |= {alias.name for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module:
                    found.add(node.module)
    return found
