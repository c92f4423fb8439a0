"""The book: every chapter once, in reading order, each on the first device that feeds it."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import nbformat

import sensorbook
from sensorbook.reporting import chapters, execute, group, index, keys, render, warm
from sensorbook.reporting.chapters import Chapter
from sensorbook.reporting.forks import Slots
from sensorbook.reporting.tree import Tree
from sensorbook.reporting.work import (
    KINDS,
    Said,
    Source,
    Task,
    Worker,
    open_source,
    same_ids,
    told_of,
)

FOLDER = "book"


def book(
    paths: Iterable[str],
    out: str,
    jobs: int | None = None,
    debug: bool = False,
    force: bool = False,
    stdout: TextIO | None = None,
    stderr: TextIO | None = None,
) -> int:
    """Renders the book into `out`/book; returns the exit code: 0 done, 1 that something failed.

    A chapter is shown on the first device that has recordings for it, there on the gyroscope or else
    on the first of the chapter's sensors. One that no device feeds is listed with the reason, and loses
    what an earlier book had of it. A device with a problem has nothing rendered: an earlier book stands,
    rather than one without the chapters that the device would have fed.
    """
    said = Said(stdout or sys.stdout, stderr or sys.stderr)
    paths = list(paths)
    if _lies_in_device(out, paths, said):
        return 1
    opened = [open_source(Path(path), said) for path in paths]
    devices = [device for device in opened if device is not None]
    if same_ids([(device.id, device.path) for device in devices], said) or said.problems:
        return 1
    try:
        with Tree(out) as tree:
            if any(tree.root / FOLDER == device.path for device in devices):
                raise OSError(f"{tree.root / FOLDER} holds recordings: choose another --out")
            tree.tidy()
            tree.folder(FOLDER)
            with tree.locked(FOLDER, lambda: said.line("another run is writing the book: waiting")):
                slots = Slots(jobs or os.cpu_count() or 1)
                worker = Worker(tree, slots, 0, said, "warm", force, debug)
                _render(devices, tree, Path(out), worker, said)
    except OSError as error:
        said.problem(told_of(error))
    return int(bool(said.problems))


def _lies_in_device(out: str, paths: Iterable[str], said: Said) -> bool:
    """Whether what is written would lie among a device's recordings, which is told."""
    for path in map(Path, paths):
        folder = path.parent if path.name == "device.toml" else path
        inside = Path(out).resolve().is_relative_to(folder.resolve())
        if inside and (folder / "device.toml").is_file():
            said.problem(
                f"--out {out}: {folder} holds a device's recordings: choose a folder outside of it"
            )
            return True
    return False


def _render(devices: list[Source], tree: Tree, out: Path, worker: Worker, said: Said) -> None:
    """Renders every chapter, then what hangs on which of them have a page, also when stopped."""
    folder = tree.folder(FOLDER)
    tasks, unfed = [], {}
    hashes = {device.id: keys.of_device(sensorbook.load(device.path)) for device in devices}
    earlier = _pages(folder)
    for number, chapter in enumerate(chapters.CHAPTERS, 1):
        place = {
            "number": number,
            "previous": None,
            "next": None,
            "teaching": _teaching(chapter.notebook),
        }
        source, sensor = _shown_on(chapter, devices)
        if chapter.needs_device and source is None:
            unfed[chapter.slug] = _why_unfed(chapter)
            said.line(f"{FOLDER}/{chapter.slug}: not rendered: {unfed[chapter.slug]}")
            for kind in KINDS:
                (folder / f"{chapter.slug}.{kind}").unlink(missing_ok=True)
            continue
        name = f"{FOLDER}/{chapter.slug}" + (f" on {source.id}" if source else "")
        name += f" {sensor}" if source and sensor != chapters.ATTITUDE else ""
        key = hashes[source.id] if source else ""
        tasks.append(Task(chapter, source, sensor, {}, folder, out / FOLDER, name, key, place))
    tasks = _with_needs(tasks)
    said.more(len(tasks))
    notebooks = [task.chapter.notebook for task in tasks]
    warm.warm_up(notebooks)
    render.warm_up(notebooks)
    try:
        worker.work_off(tasks)
    finally:
        for name in sorted(earlier - _pages(folder)):
            said.line(f"{out / FOLDER / name}: removed: it was of an earlier book")
        _bind(tasks, unfed, folder, tree)
    said.line(f"{out / FOLDER / 'index.html'}")


def _pages(folder: Path) -> set[str]:
    """Names of the chapters' pages that are there."""
    names = {f"{chapter.slug}.html" for chapter in chapters.CHAPTERS}
    return {name for name in names if (folder / name).is_file()}


def _bind(tasks: list[Task], unfed: dict[str, str], folder: Path, tree: Tree) -> None:
    """Links the pages that are there, in order, and writes the contents and what links those."""
    turned = [task for task in tasks if all(task.file(kind).is_file() for kind in KINDS)]
    for at, task in enumerate(turned):
        _turn(task, turned[at - 1] if at else None, turned[at + 1 :], tree)
    shown = {task.chapter.slug: task for task in tasks}
    cards = [
        _card(number, chapter, shown.get(chapter.slug), unfed.get(chapter.slug, ""), folder)
        for number, chapter in enumerate(chapters.CHAPTERS, 1)
    ]
    devices_page = tree.root / "index.html"
    tree.write(
        folder / "index.html",
        render.page(
            "book",
            chapters=cards,
            teaching=any(_teaching(chapter.notebook) for chapter in chapters.CHAPTERS),
            software=execute.software(),
            created=execute.now(),
            group=devices_page.is_file(),
        ),
    )
    if devices_page.is_file():  # which links the book where there is one
        tree.write(devices_page, group.group_page(tree.root))


def _shown_on(chapter: Chapter, devices: list[Source]) -> tuple[Source | None, str | None]:
    """The first device that feeds a chapter, and which of its sensors: the gyroscope if it can be."""
    for device in devices:
        # Of all sensors it shows the most: every noise term, and a thermal model to take out.
        for sensor in sorted(chapter.sensors, key=lambda name: name != "gyroscope"):
            if device.feeds(chapter, sensor):
                return device, sensor
    return None, None


def _why_unfed(chapter: Chapter) -> str:
    *others, last = (chapter.reads,) if chapter.reads else chapter.sensors
    listed = f"{', '.join(others)} or {last}" if others else last
    return f'no device given has a recording of kind "{chapter.kind}" of the {listed}: name one that has'


def _with_needs(tasks: list[Task]) -> list[Task]:
    """The tasks with where the records lie that each may read.

    Those are of the chapters that are shown on the same device and the sensor it needs them of, and
    no others.
    """
    shown = {(task.source.id, task.sensor, task.chapter.slug) for task in tasks if task.source}
    return [
        replace(
            task,
            needs={
                slug: f"{slug}.json"
                for sensor, slug in task.chapter.needed(task.sensor or "")
                if task.source and (task.source.id, sensor, slug) in shown
            },
        )
        for task in tasks
    ]


def _turn(task: Task, previous: Task | None, following: list[Task], tree: Tree) -> None:
    """Renders a page again, with links to the chapters before and after that have one."""
    page, record, notebook = map(task.file, KINDS)
    neighbours = {
        "previous": previous and (previous.chapter.slug, previous.chapter.title),
        "next": (following[0].chapter.slug, following[0].chapter.title) if following else None,
    }
    html = render.chapter_page(
        nbformat.read(notebook, as_version=4),
        json.loads(record.read_text(encoding="utf-8")),
        {**(task.book or {}), **neighbours},
    )
    tree.write(page, html)


def _card(
    number: int, chapter: Chapter, task: Task | None, unfed: str, folder: Path
) -> dict[str, Any]:
    """A chapter's entry in the table of contents, from its files."""
    page, record, notebook = (folder / f"{chapter.slug}.{kind}" for kind in KINDS)
    status, reason = "not rendered", unfed or "the run was stopped before"
    sensor = task and task.sensor
    device = task and task.source and task.source.about["name"]
    if notebook.is_file():
        about = nbformat.read(notebook, as_version=4).metadata["sensorbook"]
        status, reason = about["status"], about["reason"]
    if record.is_file():  # of an earlier book, it may be of another device
        told = json.loads(record.read_text(encoding="utf-8"))
        sensor, device = told["sensor"], told["device"] and told["device"]["name"]
    return {
        "number": number,
        "title": chapter.title,
        "question": _question(chapter.notebook),
        "page": page.name if page.is_file() else "",
        "notebook": notebook.name if notebook.is_file() else "",
        "status": status,
        "reason": reason or "",
        "sensor": sensor,
        "device": device,
        "thumbnail": index.thumbnail(notebook) if page.is_file() else None,
    }


def _question(notebook: Path) -> str:
    """The bold line of a notebook's first cell; "" where there is none."""
    first = "".join(cell.source for cell in _cells(notebook)[:1])
    found = re.search(r"\*\*(.+?)\*\*", first, flags=re.DOTALL)
    return " ".join(found[1].split()) if found else ""


def _teaching(notebook: Path) -> str:
    """Where a notebook's teaching cells, which no page shows, are to be found; "" where it has none."""
    taught = any("teaching" in cell.metadata.get("tags", ()) for cell in _cells(notebook))
    return f"{notebook.parent.name}/{notebook.name}" if taught else ""


def _cells(notebook: Path) -> list[nbformat.NotebookNode]:
    """A notebook's cells; none where it cannot be read, which its execution tells."""
    try:
        return nbformat.read(notebook, as_version=4).cells
    except Exception:  # nbformat tells damage in many ways
        return []
