"""Runs every chapter that the devices' recordings feed, and writes the report tree."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import tempfile
import threading
import time
import tomllib
import traceback
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import nbformat

import sensorbook
from sensorbook.errors import InputError
from sensorbook.guessing import guess_rows, told
from sensorbook.reporting import chapters, execute, group, index, render, results
from sensorbook.reporting.chapters import Chapter
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml
from sensorbook.reporting.tree import Tree


def report(
    paths: Iterable[str],
    out: str,
    jobs: int | None = None,
    only: Iterable[str] = (),
    debug: bool = False,
    gated: bool = False,
    junit_file: str | None = None,
    stdout: TextIO | None = None,
    stderr: TextIO | None = None,
) -> int:
    """Renders the reports of device folders and bare recordings into `out`; returns the exit code.

    0 is done, 1 that something failed, 3 that `gated` devices fail a limit or cannot be judged.
    `junit_file` is written at the end, whatever the outcome.
    """
    said = _Said(stdout or sys.stdout, stderr or sys.stderr, debug)
    if junit_file and (
        Path(junit_file).is_dir() or not Path(junit_file).absolute().parent.is_dir()
    ):
        said.problem(f"{junit_file}: cannot be written — name a file in a folder that is there")
        return 1
    devices: list[_Device] = []
    unread: list[str] = []
    for path in paths:
        before = len(said.problems)
        if (device := _open(Path(path), said)) is None:
            unread += said.problems[before:]
        else:
            devices.append(device)
    for device in devices:
        same = [str(other.path) for other in devices if other.id == device.id]
        if len(same) > 1:
            said.problem(f'{" and ".join(same)} have the same id "{device.id}": give each its own')
            return 1
    found: list[dict[str, Any]] = []
    try:
        if devices:
            with Tree(out) as tree:
                found = _run(devices, tree, Path(out), jobs or os.cpu_count() or 1, set(only), said)
        if junit_file:
            _write(Path(junit_file), junit_xml(found, said.seconds, unread))
    except OSError as error:
        said.problem(f"{error.filename}: {error.strerror}" if error.strerror else str(error))
    stopped = [line for device in found for line in gate(device)] if gated else []
    for line in stopped:
        print(line, file=said.stderr, flush=True)
    return 1 if said.problems else 3 if stopped else 0


def _write(path: Path, text: str) -> None:
    """Writes a file aside, then moves it to its place."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Device:
    """A device folder as the reports need it; `problems` are those of its declaration."""

    path: Path
    id: str
    about: dict[str, Any]
    recorded: frozenset[tuple[str, str]]
    problems: tuple[str, ...]

    def feeds(self, chapter: Chapter, sensor: str) -> bool:
        return sensor in chapter.sensors and (sensor, chapter.kind) in self.recorded


class _Said:
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

    def chapter(self, name: str, status: str, seconds: float) -> None:
        with self._lock:
            self.done += 1
            self.line(f"[{self.done}/{self.total}] {name}: {status}, {seconds:.1f} s")


def _open(path: Path, said: _Said) -> _Device | None:
    """The device in a folder; None, said why, where there is none that could have a report."""
    bare = path.is_file() and path.name != "device.toml"
    declaration = path if path.name == "device.toml" else path / "device.toml"
    if not bare and not declaration.is_file():
        what = "has no device.toml" if path.exists() else "there is no such file or folder"
        said.problem(f"{path}: {what} — give a folder that holds a device.toml, or a recording")
        return None
    try:
        device = sensorbook.load(str(path))
    except InputError as error:
        problems = tuple(map(str, error.problems))
        name = "" if bare else _declared_id(declaration)
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
    return _Device(place.resolve(), about["id"], about, recorded, problems)


def _declared_id(declaration: Path) -> str:
    """The id of a device that cannot be read otherwise: its earlier report must not stand."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        name = tomllib.loads(declaration.read_text(encoding="utf-8")).get("id")
        if isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
            return "" if name in ("index.html", "book") else name
    return ""


def _run(
    devices: list[_Device], tree: Tree, out: Path, jobs: int, only: set[str], said: _Said
) -> list[dict[str, Any]]:
    """Renders everything; returns the results of each device that has a place for its report."""
    ready = [device for device in devices if _has_place(device, tree, said)]
    planned = []
    for device in ready:
        for sensor in results.sensors():
            fed = [c for c in chapters.CHAPTERS if device.feeds(c, sensor)]
            if wanted := [c for c in fed if not only or c.slug in only]:
                planned.append((device, sensor, wanted))
    execute.allow_kernels()
    said.total = sum(len(wanted) for _, _, wanted in planned)
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            work = [pool.submit(_work, *unit, tree, out, said) for unit in planned]
            for done in work:
                done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            execute.stop_kernels()
            raise
    found = []
    for device in ready:
        found.append(_finish(device, tree, said))
        said.line(f"{out / device.id / 'index.html'}")
    tree.write(tree.root / "index.html", group.group_page(tree.root))
    said.line(f"{out / 'index.html'}")
    return found


def _has_place(device: _Device, tree: Tree, said: _Said) -> bool:
    """Makes the folders of a device's report, where nothing else is in their place."""
    try:
        if tree.root / device.id == device.path:
            raise OSError(f"{device.path} holds the recordings: choose another folder with --out")
        tree.folder(device.id)
        for sensor in results.sensors():
            if any(device.feeds(chapter, sensor) for chapter in chapters.CHAPTERS):
                tree.folder(device.id, sensor)
    except OSError as error:
        said.problem(f"{device.id}: {error.filename or error}: {error.strerror or ''}".rstrip(": "))
        return False
    return True


def _work(
    device: _Device, sensor: str, wanted: list[Chapter], tree: Tree, out: Path, said: _Said
) -> None:
    """Works off the chapters of one sensor, in order: later ones read the records of earlier."""
    for chapter in wanted:
        began = time.monotonic()
        status = _chapter(device, sensor, chapter, tree, out, said)
        if execute.stopped():
            return
        took = said.seconds[device.id, sensor, chapter.slug] = time.monotonic() - began
        said.chapter(f"{device.id} {sensor}/{chapter.slug}", status, took)


def _chapter(
    device: _Device, sensor: str, chapter: Chapter, tree: Tree, out: Path, said: _Said
) -> str:
    """Executes and renders one chapter and puts its files in place; returns its status."""
    folder = tree.root / device.id / sensor
    page, record_file, notebook = (
        folder / f"{chapter.slug}.{kind}" for kind in ("html", "json", "ipynb")
    )
    # Relative to the notebook's own folder, so that it runs again from there.
    parameters = {"device": os.path.relpath(device.path, folder), "sensor": sensor}
    for need in chapter.needs:
        # A refused chapter's record, too: this one says why it goes on without.
        there = (folder / f"{need}.json").is_file()
        parameters[f"{need}_record"] = f"{need}.json" if there else ""
    shown_as = str(out / device.id / sensor / notebook.name)
    html = text = ""
    try:
        with tempfile.TemporaryDirectory(dir=tree.aside) as aside:
            outcome = execute.execute(chapter.notebook, parameters, folder, Path(aside), shown_as)
        if outcome.status != "failed":
            record = execute.record_of(outcome, chapter, sensor, device.about)
            text, html = results.dumps(record), render.chapter_page(outcome.notebook, record)
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
            said.problem(f"{device.id}: {problem}")
        if not outcome.problems:
            said.problem(f"{device.id} {sensor}/{chapter.slug}: {outcome.reason}")
    tree.write(notebook, nbformat.writes(outcome.notebook))
    if outcome.status != "failed":
        tree.write(page, html)
        tree.write(record_file, text)
    return outcome.status


def _finish(device: _Device, tree: Tree, said: _Said) -> dict[str, Any]:
    """Writes what derives from the chapters' files: results.json and the device's index."""
    folder = tree.root / device.id
    for sensor in results.sensors():
        for chapter in chapters.CHAPTERS:
            if not device.feeds(chapter, sensor) and (folder / sensor).resolve() == folder / sensor:
                for kind in ("html", "json", "ipynb"):
                    (folder / sensor / f"{chapter.slug}.{kind}").unlink(missing_ok=True)
    records = results.read_records(folder)
    for record in results.outdated(records):
        sensor, slug = record["sensor"], record["chapter"]
        said.line(f"{device.id} {sensor}/{slug}: of an earlier recording, removed: render it again")
        for kind in ("html", "json", "ipynb"):
            (folder / sensor / f"{slug}.{kind}").unlink(missing_ok=True)
        records.remove(record)
    found = results.assemble(
        device.about, execute.software(), execute.now(), records, device.problems
    )
    tree.write(folder / "results.json", results.dumps(found))
    tree.write(folder / "results.csv", results.csv_text(found))
    tree.write(folder / "index.html", index.device_page(found, folder))
    return found
