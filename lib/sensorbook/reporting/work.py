"""What reports and the book share: sources opened, chapters run and put in place, words told."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import tempfile
import time
import traceback
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import tomli

import sensorbook
from sensorbook.errors import InputError
from sensorbook.guessing import device_id, guess_rows, told
from sensorbook.recordings.bags import storage_file
from sensorbook.recordings.checks import RESERVED_IDS
from sensorbook.reporting import chapters, keys, results
from sensorbook.reporting.chapters import ATTITUDE, Chapter
from sensorbook.reporting.forks import Ended, Forks, Slots
from sensorbook.reporting.tree import Tree

if TYPE_CHECKING:
    from sensorbook.reporting.execute import Outcome

# papermill, nbconvert and what they bring are imported where a chapter is rendered: a run that finds
# everything up to date needs none of it.

KINDS = ("html", "json", "ipynb")  # a chapter's page, record and executed notebook
LEFT_FROM = 15.0  # s; for less nobody needs to know how long
FULL = (errno.ENOSPC, errno.EDQUOT)


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

    def __init__(self, stdout: TextIO, stderr: TextIO):
        self.stdout, self.stderr = stdout, stderr
        self.problems: list[str] = []
        self.total = self.done = 0
        self._began: float | None = None
        self._rendered = 0

    def line(self, text: str) -> None:
        print(text, file=self.stdout, flush=True)

    def problem(self, text: str) -> None:
        if text not in self.problems:
            self.problems.append(text)
            print(text, file=self.stderr, flush=True)

    def trace(self, text: str) -> None:
        print(text, file=self.stderr, end="", flush=True)

    def more(self, number: int) -> None:
        """That so many more steps are to be done than was known."""
        self.total += number

    def step(self, name: str, status: str, seconds: float | None) -> None:
        """How a step ended, and where it is known how long the others may take."""
        self.done += 1
        text = f"[{self.done}/{self.total}] {name}: {status}"
        if seconds is not None:
            text += f", {seconds:.1f} s"
            self._began = self._began or time.monotonic() - seconds
            self._rendered += 1
            left = (time.monotonic() - self._began) / self._rendered * (self.total - self.done)
            if self._rendered > 1 and left > LEFT_FROM:
                text += f", about {_duration(left)} left"
        self.line(text)


def told_of(error: OSError) -> str:
    """A line for what could not be read or written."""
    name = error.filename2 or error.filename  # what is moved is named after where it goes
    line = f"{name}: {error.strerror}" if error.strerror else str(error)
    if error.errno in FULL:
        line += " — free some and run it again: what is finished is not rendered anew"
    return line


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{max(10, round(seconds, -1)):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def open_source(path: Path, said: Said) -> Source | None:
    """The device in a folder; None, said why, where there is none that could have a report."""
    try:
        if not (path / "device.toml").is_file():
            path = storage_file(path) or path
    except InputError as error:
        said.problem(str(error))
        return None
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
    name, table = _declared(declaration)
    return name, table is not None


def _declared(declaration: Path) -> tuple[str, dict[str, Any] | None]:
    """A device's id, "" for none, and its declaration as it stands; None where that is no TOML."""
    data, table = b"", None
    with contextlib.suppress(OSError):
        data = declaration.read_bytes()
    try:
        table = tomli.loads(data.decode("utf-8-sig"))
        name = table.get("id")
    except (ValueError, RecursionError):  # UnicodeDecodeError is one, too
        text = data.decode("utf-8-sig", "replace")
        head = re.split(r"^\s*\[", text, maxsplit=1, flags=re.MULTILINE)[0]
        line = re.search(r"""^\s*id\s*=\s*(["'])(.*?)\1""", head, re.MULTILINE)
        name = line and line[2]
    if isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
        return ("" if name in RESERVED_IDS else name), table
    return "", table


def glance(path: Path, only: Collection[str] = ()) -> tuple[str, tuple[Path, ...]]:
    """What can be told of a device without opening it.

    The id that it will have, "" where that is not known, and the notebook of each chapter that its
    declaration promises, of `only` where any are named; none of a bare recording.
    """
    with contextlib.suppress(InputError):  # opening tells
        if not (path / "device.toml").is_file():
            path = storage_file(path) or path
    if path.is_file() and path.name != "device.toml":
        return device_id(path.name.split(".")[0]), ()
    name, table = _declared(path if path.name == "device.toml" else path / "device.toml")
    listed = (table or {}).get("recording")
    recorded = frozenset(
        (str(recording.get("sensor")), str(recording.get("kind")))
        for recording in (listed if isinstance(listed, list) else ())
        if isinstance(recording, dict)
    )
    source = Source(path, name, {}, recorded, ())
    return name, tuple(
        chapter.notebook
        for sensor in results.sensors()
        for chapter in chapters.CHAPTERS
        if source.feeds(chapter, sensor) and (not only or chapter.slug in only)
    )


def same_ids(named: Sequence[tuple[str, Path]], said: Said) -> bool:
    """Whether two devices, each an id and where it is, have one id, which is told."""
    first: dict[str, Path] = {}
    for name, path in named:
        if name and first.setdefault(name, path) is not path:
            same = " and ".join(str(p.resolve()) for n, p in named if n == name)
            said.problem(f'{same} have the same id "{name}": give each its own')
            return True
    return False


@dataclass(frozen=True, eq=False)
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
    key_of_device : hash of what the device's files hold; "" where that is not known
    book : its place in the book, as `render.chapter_page` takes it; None in a device's report
    """

    chapter: Chapter
    source: Source | None
    sensor: str | None
    needs: dict[str, str]
    folder: Path
    shown_in: Path
    name: str
    key_of_device: str = ""
    book: dict[str, Any] | None = None

    def file(self, kind: str) -> Path:
        """Where one of the chapter's files goes, of `KINDS`."""
        return self.folder / f"{self.chapter.slug}.{kind}"

    def reads(self) -> list[Path]:
        """Where the records are, or would be, that it reads."""
        return [Path(os.path.normpath(self.folder / path)) for path in self.needs.values()]

    def parameters(self) -> dict[str, str]:
        """What the notebook is given; nothing where it needs no device."""
        if self.source is None:
            return {}
        # Relative to the notebook's own folder, so that it runs again from there.
        given = {"device": os.path.relpath(self.source.path, self.folder)}
        if self.sensor != ATTITUDE:
            given["sensor"] = self.sensor or ""
        for _, slug in self.chapter.needed(self.sensor or ""):
            # A refused chapter's record, too: this one says why it goes on without.
            path = self.needs.get(slug, "")
            given[f"{slug}_record"] = path if path and (self.folder / path).is_file() else ""
        return given

    def key(self, parameters: dict[str, str]) -> str:
        """Hash of all that its files hang on."""
        return keys.of(
            keys.of_software(),
            keys.of_file(self.chapter.notebook),
            self.key_of_device,
            parameters,
            [keys.in_record(path) for path in self.reads()],
            self.sensor,
            self.chapter.title,
            self.source and self.source.about,
            self.book,
        )

    def is_as_opened(self) -> bool:
        """Whether the device's files still hold what they did when it was opened."""
        if self.source is None or not self.key_of_device:
            return True
        return keys.of_device(sensorbook.load(self.source.path)) == self.key_of_device

    def is_current(self, parameters: dict[str, str]) -> bool:
        """Whether its files are there, of an earlier run that would give the same now."""
        there = all(is_whole(self.file(kind)) for kind in KINDS)
        known = self.source is None or bool(self.key_of_device)
        return there and known and keys.in_record(self.file("json")) == self.key(parameters)


def is_whole(path: Path) -> bool:
    """Whether a page, record or notebook is there to its end, which copies and full disks cut off."""
    end = b"</html>" if path.suffix == ".html" else b"}"
    try:
        with path.open("rb") as stream:
            stream.seek(-min(16, path.stat().st_size), os.SEEK_END)
            return stream.read().rstrip().endswith(end)
    except OSError:
        return False


class Worker:
    """Works off chapters side by side, each as soon as those are done whose records it reads.

    Parameters
    ----------
    tree, slots, said : where they are written, how many at once, and who is told
    engine : "warm" or "kernel"
    force : render what is up to date, too
    debug : tell where a fault is
    """

    def __init__(
        self, tree: Tree, slots: Slots, own: int, said: Any, engine: str, force: bool, debug: bool
    ):
        self._tree, self._slots, self._own, self._said = tree, slots, own, said
        self._engine, self._force, self._debug = engine, force, debug
        self.seconds: dict[tuple[str | None, str], float] = {}  # by sensor and chapter

    def work_off(self, tasks: Sequence[Task]) -> None:
        """Works off all tasks, the earlier first where there is a choice."""
        self._forks = Forks(self._slots, self._own)
        makers = {task.file("json"): task for task in tasks}
        self._lacking = {
            task: {makers[need] for need in task.reads() if need in makers} for task in tasks
        }
        self._order = {task: number for number, task in enumerate(tasks)}
        self._start_ready()
        self._forks.run()

    def _start_ready(self) -> None:
        ready = [task for task, lacking in self._lacking.items() if not lacking]
        for task in ready:
            del self._lacking[task]
        for task in ready:
            self._start(task)

    def _start(self, task: Task) -> None:
        parameters = task.parameters()
        if not self._force and task.is_current(parameters):
            self._said.step(task.name, "unchanged", None)
            self._done(task)
            return
        # Made here: where the fork dies, what it left there tells how far it came.
        aside = Path(tempfile.mkdtemp(dir=self._tree.aside))
        began: list[float] = []

        def ended(given: _Done | Ended) -> None:
            done = given
            if isinstance(given, Ended):
                from sensorbook.reporting import execute

                seen = str(task.shown_in / task.file("ipynb").name)
                outcome = execute.ended(task.chapter.notebook, aside, seen, given)
                done = _put(task, self._tree, outcome)
            took = time.monotonic() - began[0] if began else 0.0
            self.seconds[task.sensor, task.chapter.slug] = took
            for text in done.traces:
                self._said.trace(text)
            for text in done.problems:
                self._said.problem(text)
            self._said.step(task.name, done.status, took)
            self._done(task)

        call = partial(_run_chapter, task, parameters, self._tree, aside, self._engine, self._debug)
        self._forks.add(self._order[task], call, ended, lambda told: began.append(time.monotonic()))

    def _done(self, task: Task) -> None:
        for lacking in self._lacking.values():
            lacking.discard(task)
        self._start_ready()


@dataclass(frozen=True)
class _Done:
    """How a chapter ended, and what is to be told of it."""

    status: str
    problems: tuple[str, ...] = ()
    traces: tuple[str, ...] = ()


def _run_chapter(
    task: Task,
    parameters: dict[str, str],
    tree: Tree,
    aside: Path,
    engine: str,
    debug: bool,
    tell: Any,
) -> _Done:
    """Executes and renders one chapter and puts its files in place."""
    from sensorbook.reporting import execute, render

    tell("began")
    chapter, source = task.chapter, task.source
    record, html, traces = None, "", []
    try:
        shown_as = str(task.shown_in / task.file("ipynb").name)
        outcome = execute.execute(
            chapter.notebook, parameters, task.folder, aside, shown_as, engine=engine
        )
        if outcome.status != "failed":
            about = source and source.about
            record = execute.record_of(outcome, chapter, task.sensor, about)
            # Without a key it is rendered again: what was read meanwhile may be of either state.
            record["key"] = task.key(parameters) if task.is_as_opened() else None
            html = render.chapter_page(outcome.notebook, record, task.book)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            raise  # no fault of the chapter, and the next would find the same
        if debug:
            traces.append(traceback.format_exc())
        outcome, record = execute.fault(chapter.notebook, error), None
    try:
        done = _put(task, tree, outcome, record, html)
    except OSError as error:
        if error.errno in FULL:
            raise
        done = _Done("failed", (f"{task.name}: {told_of(error)}",))
    return _Done(done.status, done.problems, tuple(traces))


def _put(
    task: Task,
    tree: Tree,
    outcome: Outcome,
    record: dict[str, Any] | None = None,
    html: str = "",
) -> _Done:
    """Puts a chapter's files in place, the record last: while it is missing the others do not count."""
    import nbformat

    text = record and results.dumps(record)
    notebook = nbformat.writes(outcome.notebook)
    task.file("json").unlink(missing_ok=True)
    if record is None:
        task.file("html").unlink(missing_ok=True)
    tree.write(task.file("ipynb"), notebook)
    if text is not None:
        tree.write(task.file("html"), html)
        tree.write(task.file("json"), text)
        return _Done(outcome.status)
    named = task.source.id if task.source else task.name
    told = [f"{named}: {problem}" for problem in outcome.problems]
    return _Done(outcome.status, tuple(told or [f"{task.name}: {outcome.reason}"]))
