"""What reports and the book share: sources opened, chapters run and put in place, words told."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import nbformat
import tomli

import sensorbook
from sensorbook.errors import InputError
from sensorbook.guessing import guess_rows, told
from sensorbook.recordings.checks import RESERVED_IDS
from sensorbook.reporting import execute, render, results
from sensorbook.reporting.chapters import ATTITUDE, Chapter
from sensorbook.reporting.tree import Tree

KINDS = ("html", "json", "ipynb")  # a chapter's page, record and executed notebook


@dataclass(frozen=True)
class Source:
    """A device folder as the reports need it; `problems` are those of its declaration.

    `parsed` is false where device.toml is no TOML, which tells nothing about the recordings.
    """

    path: Path
    id: str
    about: dict[str, Any]
    recorded: frozenset[tuple[str, str]]
    problems: tuple[str, ...]
    parsed: bool = True

    def feeds(self, chapter: Chapter, sensor: str) -> bool:
        read = (chapter.reads or sensor, chapter.kind)
        return sensor in chapter.sensors and read in self.recorded


class Said:
    """What the user is told: progress on one stream, each problem once on the other."""

    def __init__(self, stdout: TextIO, stderr: TextIO, debug: bool):
        self.stdout, self.stderr, self.debug = stdout, stderr, debug
        self.problems: list[str] = []
        self.total = self.done = 0
        self.seconds: dict[tuple[str, str, str], float] = {}  # by device, sensor, chapter
        self._lock = threading.Lock()

    def line(self, text: str) -> None:
        print(text, file=self.stdout, flush=True)

    def problem(self, text: str) -> None:
        with self._lock:
            if text not in self.problems:
                self.problems.append(text)
                print(text, file=self.stderr, flush=True)

    def chapter(self, task: Task, status: str, seconds: float) -> None:
        with self._lock:
            if task.source is not None:
                self.seconds[task.source.id, task.sensor or "", task.chapter.slug] = seconds
            self.done += 1
            self.line(f"[{self.done}/{self.total}] {task.name}: {status}, {seconds:.1f} s")


def open_source(path: Path, said: Said) -> Source | None:
    """The device in a folder; None, said why, where there is none that could have a report."""
    bare = path.is_file() and path.name != "device.toml"
    declaration = path if path.name == "device.toml" else path / "device.toml"
    if not bare and not declaration.is_file():
        what = "has no device.toml" if path.exists() else "there is no such file or folder"
        said.problem(f"{path}: {what} — give a folder that holds a device.toml, or a recording")
        return None
    parsed = True
    try:
        device = sensorbook.load(str(path))
    except InputError as error:
        problems = tuple(map(str, error.problems))
        name, parsed = ("", True) if bare else _declared_id(declaration)
        about = {"id": name, "name": name, "model": None, "serial": None, "spec": {}}
        recorded = frozenset()
    else:
        problems = tuple(map(str, device.problems))
        about = {key: getattr(device, key) for key in ("id", "name", "model", "serial", "spec")}
        recorded = frozenset((entry.sensor, entry.kind) for entry in device.declared)
        if device.guessed is not None:
            about["guesses"] = guess_rows(device.guessed)
            for line in told(device.guessed):
                said.line(line)
    for problem in problems:
        said.problem(f"{about['id'] or path}: {problem}")
    if not about["id"]:
        return None
    place = path if bare else declaration.parent
    return Source(place.resolve(), about["id"], about, recorded, problems, parsed)


def _declared_id(declaration: Path) -> tuple[str, bool]:
    """The id of a device that cannot be read otherwise, "" for none, and whether its file is TOML."""
    data = b""
    with contextlib.suppress(OSError):
        data = declaration.read_bytes()
    try:
        name, parsed = tomli.loads(data.decode("utf-8-sig")).get("id"), True
    except (ValueError, RecursionError):  # UnicodeDecodeError is one, too
        text = data.decode("utf-8-sig", "replace")
        head = re.split(r"^\s*\[", text, maxsplit=1, flags=re.MULTILINE)[0]
        line = re.search(r"""^\s*id\s*=\s*(["'])(.*?)\1""", head, re.MULTILINE)
        name, parsed = line and line[2], False
    if isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
        return ("" if name in RESERVED_IDS else name), parsed
    return "", parsed


def same_ids(sources: list[Source], said: Said) -> bool:
    """Whether two sources have one id, which is told."""
    for source in sources:
        same = [str(other.path) for other in sources if other.id == source.id]
        if len(same) > 1:
            said.problem(f'{" and ".join(same)} have the same id "{source.id}": give each its own')
            return True
    return False


def _side_by_side(calls: Iterable[Callable[[], None]], jobs: int) -> None:
    """Makes all calls, `jobs` at a time; when one raises, or on an interrupt, every kernel ends."""
    execute.allow_kernels()
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            for done in [pool.submit(call) for call in calls]:
                done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            execute.stop_kernels()
            raise


@dataclass(frozen=True)
class Task:
    """One chapter to execute and render.

    Parameters
    ----------
    chapter : which
    source, sensor : what it is run on; None for a chapter that needs no device
    needs : where, seen from `folder`, the records lie that it may read: those of this device, if
        there, by the slug of their chapter
    folder : where its files go, and its kernel works
    shown_in : the same folder as the user named it
    name : what it is called in messages
    book : its place in the book, as `render.chapter_page` takes it; None in a device's report
    """

    chapter: Chapter
    source: Source | None
    sensor: str | None
    needs: dict[str, str]
    folder: Path
    shown_in: Path
    name: str
    book: dict[str, Any] | None = None


def work_off(lines: Sequence[Sequence[Task]], tree: Tree, jobs: int, said: Said) -> None:
    """Works off lines of tasks side by side, `jobs` at a time; a line is of one sensor of one device.

    Those over several sensors come after all the others, whose records they read.
    """
    for over_several in (False, True):
        now = [
            partial(_work_off, line, tree, said)
            for line in lines
            if any(task.sensor == ATTITUDE for task in line) is over_several
        ]
        _side_by_side(now, jobs)


def _work_off(tasks: Iterable[Task], tree: Tree, said: Said) -> None:
    """Works off chapters in order: later ones read the records of earlier."""
    for task in tasks:
        began = time.monotonic()
        status = _run_chapter(task, tree, said)
        if execute.stopped():
            return
        said.chapter(task, status, time.monotonic() - began)


def _parameters(task: Task) -> dict[str, str]:
    """What the notebook is given; nothing where it needs no device."""
    if task.source is None:
        return {}
    # Relative to the notebook's own folder, so that it runs again from there.
    device = os.path.relpath(task.source.path, task.folder)
    given = {"device": device}
    if task.sensor != ATTITUDE:
        given["sensor"] = task.sensor or ""
    for _, slug in task.chapter.needed(task.sensor or ""):
        # A refused chapter's record, too: this one says why it goes on without.
        path = task.needs.get(slug, "")
        given[f"{slug}_record"] = path if path and (task.folder / path).is_file() else ""
    return given


def _run_chapter(task: Task, tree: Tree, said: Said) -> str:
    """Executes and renders one chapter and puts its files in place; returns its status."""
    chapter, source = task.chapter, task.source
    page, record_file, notebook = (task.folder / f"{chapter.slug}.{kind}" for kind in KINDS)
    html = text = ""
    try:
        with tempfile.TemporaryDirectory(dir=tree.aside) as aside:
            shown_as = str(task.shown_in / notebook.name)
            outcome = execute.execute(
                chapter.notebook, _parameters(task), task.folder, Path(aside), shown_as
            )
        if outcome.status != "failed":
            about = source and source.about
            record = execute.record_of(outcome, chapter, task.sensor, about)
            text = results.dumps(record)
            html = render.chapter_page(outcome.notebook, record, task.book)
    except Exception as error:
        if said.debug:
            traceback.print_exc(file=said.stderr)
        outcome = execute.fault(chapter.notebook, error)
    if execute.stopped():
        return "stopped"  # what ended it says nothing about the recordings
    if outcome.status == "failed":
        page.unlink(missing_ok=True)
        record_file.unlink(missing_ok=True)
        for problem in outcome.problems:
            said.problem(f"{source.id if source else task.name}: {problem}")
        if not outcome.problems:
            said.problem(f"{task.name}: {outcome.reason}")
    tree.write(notebook, nbformat.writes(outcome.notebook))
    if outcome.status != "failed":
        tree.write(page, html)
        tree.write(record_file, text)
    return outcome.status
