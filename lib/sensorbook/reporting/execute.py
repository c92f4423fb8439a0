"""Executes one chapter for one sensor and says how it ended."""

from __future__ import annotations

import ast
import logging
import os
import signal
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import nbformat
import papermill
from jupyter_client.manager import AsyncKernelManager
from nbclient.exceptions import CellTimeoutError, DeadKernelError
from papermill.exceptions import PapermillExecutionError
from papermill.execute import ERROR_MARKER_TAG

import sensorbook
from sensorbook.notebook import MIME
from sensorbook.reporting import warm
from sensorbook.reporting.chapters import Chapter
from sensorbook.reporting.forks import Ended

CELL_LIMIT = 600  # seconds a cell may take
START_LIMIT = 120  # seconds a kernel may take to start, on a machine that is busy with others

COPY = "executed.ipynb"
DIED = "the chapter's kernel died, often for want of memory"

# Threads of BLAS on small arrays cost ten times what they gain, and kernels run side by side.
KERNEL_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "MPLBACKEND": "agg",
}

# Every failure is told in a sentence of ours; the libraries' log lines would tell it twice.
logging.getLogger("papermill").setLevel(logging.CRITICAL + 1)


@dataclass(frozen=True)
class Outcome:
    """How a chapter ended: `complete`, `refused` or `failed`, the latter two with a reason.

    `problems` holds the lines of an `InputError`, which are about the input and not the chapter.
    """

    status: str
    reason: str | None
    notebook: nbformat.NotebookNode
    problems: tuple[str, ...] = ()


# papermill's names of the engines to choose from; None is its own, a kernel for each notebook.
ENGINES = {"warm": warm.NAME, "kernel": None}


def execute(
    notebook: Path,
    parameters: dict[str, Any],
    folder: Path,
    aside: Path,
    shown_as: str,
    engine: str = "warm",
) -> Outcome:
    """Runs a notebook with `folder` as working folder.

    The warm engine runs it in this process and leaves its traces there: to be called in a fork.

    Parameters
    ----------
    notebook, parameters : the file, and what takes the place of its parameters
    folder : where it works
    aside : folder for papermill's own copy
    shown_as : where the executed notebook will lie, for the sentence about a fault
    engine : a key of `ENGINES`
    """
    source = _without_teaching(notebook)
    _check_parameters(source, parameters, notebook.name)
    copy = aside / COPY
    see = f"executed notebook: {shown_as}"
    status, reason, problems = "failed", None, ()
    try:
        _run(source, copy, parameters, folder, engine)
        status = "complete"
    except PapermillExecutionError as error:
        if error.ename == "Refusal":
            status, reason = "refused", _line(error.evalue)
        elif error.ename == "InputError":
            problems = tuple(error.evalue.splitlines())
            reason = error.evalue
        else:
            kind = _named(error.ename, error.evalue)
            reason = f"the chapter stopped with {kind} (a fault in sensorbook; {see})"
    except DeadKernelError:
        reason = f"{DIED} ({see})"
    except CellTimeoutError:
        reason = f"{_too_long()} ({see})"
    return _outcome(source, copy, status, reason, problems)


def ended(notebook: Path, aside: Path, shown_as: str, how: Ended) -> Outcome:
    """The outcome of a chapter whose process ended before it did."""
    told = _too_long() if how.signal == signal.SIGALRM else DIED
    return _outcome(
        _without_teaching(notebook),
        aside / COPY,
        "failed",
        f"{told} (executed notebook: {shown_as})",
    )


def _too_long() -> str:
    return f"a cell took longer than {CELL_LIMIT} s and was stopped"


def _without_teaching(notebook: Path) -> nbformat.NotebookNode:
    source = nbformat.read(notebook, as_version=4)
    source.cells = [c for c in source.cells if "teaching" not in c.metadata.get("tags", [])]
    return source


def _outcome(
    source: nbformat.NotebookNode,
    copy: Path,
    status: str,
    reason: str | None,
    problems: tuple[str, ...] = (),
) -> Outcome:
    """The outcome with the notebook as far as it was executed."""
    executed = nbformat.read(copy, as_version=4) if copy.exists() else source
    executed.cells = [
        c for c in executed.cells if ERROR_MARKER_TAG not in c.metadata.get("tags", [])
    ]
    # papermill notes absolute paths of this machine, which mean nothing where a report is read.
    for key in ("input_path", "output_path"):
        executed.metadata.get("papermill", {}).pop(key, None)
    executed.metadata["sensorbook"] = {"status": status, "reason": reason}
    return Outcome(status, reason, executed, problems)


def fault(notebook: Path, error: Exception) -> Outcome:
    """The outcome of a chapter that could not be executed or rendered at all."""
    reason = f"the chapter stopped with {_named(type(error).__name__, str(error))} (a fault in sensorbook)"
    about = {"status": "failed", "reason": reason}
    try:
        made = nbformat.read(notebook, as_version=4)
        made.metadata["sensorbook"] = about
    except Exception:  # missing or damaged, which nbformat tells in many ways
        made = nbformat.v4.new_notebook(metadata={"sensorbook": about})
    return Outcome("failed", reason, made)


def record_of(
    outcome: Outcome, chapter: Chapter, sensor: str | None, about: dict[str, Any] | None
) -> dict[str, Any]:
    """The chapter's record: what its notebook recorded, with where it belongs and how it ended.

    `sensor` and the device that `about` describes are None for a chapter that needs no device.
    """
    device = about and {key: about[key] for key in ("id", "name", "model", "serial")}
    inputs: list[dict] = []
    warnings: list[dict] = []
    found: dict[str, Any] = {}
    for cell in outcome.notebook.cells:
        for output in cell.get("outputs", ()):
            part = output.get("data", {}).get(MIME, {})
            inputs += [i for i in part.get("inputs", ()) if i not in inputs]
            warnings += [w for w in part.get("warnings", ()) if w not in warnings]
            found.update(part.get("results", {}))
    return {
        "schema": 1,
        "chapter": chapter.slug,
        "title": chapter.title,
        "sensor": sensor,
        "status": outcome.status,
        "reason": outcome.reason,
        "device": device,
        "software": software(),
        "parameters": _read_records(outcome.notebook),
        "inputs": inputs,
        "warnings": warnings,
        "results": found if outcome.status == "complete" else {},
        "created": now(),
    }


def _read_records(notebook: nbformat.NotebookNode) -> dict[str, str]:
    """The records of other chapters that a notebook was given: what its numbers hang on."""
    given = notebook.metadata.get("papermill", {}).get("parameters", {})
    return {key: value for key, value in given.items() if key.endswith("_record")}


@cache
def software() -> dict[str, str]:
    """Versions of what computed the results."""
    import platform

    return {
        "sensorbook": sensorbook.__version__,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
    }


def now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


class _Kernel(AsyncKernelManager):
    """The stock kernel with an environment of ours."""

    async def start_kernel(self, **arguments: Any) -> None:
        arguments["env"] = {**os.environ, **KERNEL_ENVIRONMENT}
        # Not what cells print, which goes into the notebook: the kernel's own log.
        arguments["stderr"] = subprocess.DEVNULL
        await super().start_kernel(**arguments)


def _run(
    source: nbformat.NotebookNode,
    copy: Path,
    parameters: dict[str, Any],
    folder: Path,
    engine: str,
) -> None:
    output = str(copy).replace("{", "{{").replace("}", "}}")  # papermill fills it as a format
    kernel = {"start_timeout": START_LIMIT, "kernel_manager_class": _Kernel}
    for attempts_left in (2, 1, 0):
        try:
            papermill.execute_notebook(
                source,
                output,
                parameters=parameters,
                engine_name=ENGINES[engine],
                kernel_name="python3",
                language="python",
                progress_bar=False,
                execution_timeout=CELL_LIMIT,
                cwd=str(folder),
                **({"checkpoint": copy, "request_save_on_cell_execute": False}
                   if engine == "warm" else kernel),
            )  # fmt: skip
            return
        except RuntimeError as error:
            # A port that was free a moment ago may be taken when the kernel binds it.
            if "before replying" not in str(error) or not attempts_left:
                raise


def _check_parameters(source: nbformat.NotebookNode, parameters: dict[str, Any], name: str) -> None:
    """papermill only warns about a parameter the notebook does not have."""
    declared: dict[str, Any] = {}
    for cell in source.cells:
        if "parameters" in cell.metadata.get("tags", []):
            for node in ast.parse(cell.source).body:
                if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                    declared[node.targets[0].id] = ast.literal_eval(node.value)
    for key, value in parameters.items():
        if key not in declared:
            raise ValueError(f"{name} has no parameter {key!r}")
        if type(declared[key]) is not type(value):
            kinds = type(declared[key]).__name__, type(value).__name__
            raise TypeError(f"{name}: parameter {key!r} is {kinds[0]}, not {kinds[1]}")


def _named(kind: str, message: str) -> str:
    return f"{kind}: {_line(message)}".removesuffix(": ")


def _line(text: str) -> str:
    """The text's first line, printable and not too long for one."""
    first = (text or "").strip().splitlines() or [""]
    line = "".join(c if c.isprintable() else " " for c in first[0])
    return line if len(line) <= 300 else line[:299] + "…"
