"""A device's report: the step that pools and clusters hand out, `Job` → `Record`."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import sensorbook
from sensorbook import shared
from sensorbook.errors import InputError
from sensorbook.recordings.advice import lacks_gyroscope
from sensorbook.recordings.device import Device, hold, read_whole
from sensorbook.reporting import chapters, keys, results
from sensorbook.reporting.forks import Slots, Tell
from sensorbook.reporting.tree import Tree
from sensorbook.reporting.work import KINDS, Source, Task, Worker, is_whole, open_source

HELD = 128 << 20  # bytes of recordings up to which all chapters share what was read once


@dataclass(frozen=True)
class Job:
    """What makes one device's report; plain data, so that it can go to another machine.

    Parameters
    ----------
    path : device folder or bare recording, as the user named it
    out : the report tree, as the user named it
    only : slugs of chapters; () for all
    force : whether to render what is up to date, too
    engine : "warm" or "kernel"
    debug : whether to tell where a fault is
    steps : chapters that it is likely to have, by its declaration, for progress
    """

    path: str
    out: str
    only: tuple[str, ...] = ()
    force: bool = False
    engine: str = "warm"
    debug: bool = False
    steps: int = 0


@dataclass(frozen=True)
class Record:
    """How a device's report ended.

    Attributes
    ----------
    found : its results.json; None where it has none
    seconds : that each chapter took, by (sensor, slug)
    problems : lines, where the path gave no device at all
    changed : whether anything was rendered, or may have been
    """

    found: dict[str, Any] | None
    seconds: dict[tuple[str | None, str], float] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    changed: bool = True


@dataclass(frozen=True)
class Opened:
    """A device that has something to render: chapters with these notebooks.

    `read` is the device with its recordings, for all chapters; None where each is to read its own.
    """

    job: Job
    source: Source
    key: str
    notebooks: tuple[Path, ...] = ()
    read: Device | None = None


class Telling:
    """Stands for `work.Said` in another process: tells which of its methods to call."""

    def __init__(self, tell: Tell):
        self._tell = tell
        self.problems: list[str] = []

    def problem(self, text: str) -> None:
        self.problems.append(text)
        self._tell(("problem", text))

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self._tell((name, *arguments))


def open_device(job: Job, tell: Tell) -> Opened | Record:
    """Opens a device; the record at once where there is nothing to render."""
    said = Telling(tell)
    tree = Tree(job.out)
    source = open_source(Path(job.path), said)
    if source is None or not _has_place(source, tree, said):
        said.more(-job.steps)
        return Record(None, problems=tuple(said.problems) if source is None else ())
    try:
        key = keys.of_device(sensorbook.load(source.path))
    except InputError:
        key = ""
    opened = Opened(job, source, key)
    tasks = _tasks(opened, tree)
    said.more(len(tasks) - job.steps)
    if not job.force and (current := _current(opened, tasks, tree)):
        for task in tasks:
            said.step(task.name, "unchanged", None)
        said.line(str(Path(job.out) / source.id / "index.html"))
        return Record(current, changed=False)
    return replace(
        opened,
        notebooks=tuple(sorted({task.chapter.notebook for task in tasks})),
        # Read while another process imports what chapters need.
        read=read_whole(source.path) if _is_shared(opened, tasks) else None,
    )


def render_device(opened: Opened, tell: Tell, slots: Slots) -> Record:
    """Renders what is not up to date of a device's report.

    Chapters are at work side by side: one at a time in the slot of this process, more as `slots` has
    free ones.
    """
    job, source, said = opened.job, opened.source, Telling(tell)

    def waits() -> None:
        said.line(f"{source.id}: another run is writing its report: waiting for it")

    if opened.read is not None:
        hold(opened.read)
    with Tree(job.out) as tree, tree.locked(source.id, waits):
        tasks = _tasks(opened, tree)
        if _is_shared(opened, tasks):
            shared.folder = Path(tempfile.mkdtemp(dir=tree.aside))
        worker = Worker(tree, slots, 1, said, job.engine, job.force, job.debug)
        worker.work_off(tasks)
        fed = [c for c in chapters.CHAPTERS if any(source.feeds(c, s) for s in c.sensors)]
        nothing = bool(job.only and fed) and not any(c.slug in job.only for c in fed)
        if nothing:
            listed = ", ".join(c.slug for c in fed)
            said.line(f"{source.id}: --only leaves nothing to do; its recordings feed {listed}")
        if lacking := lacks_gyroscope(source.recorded):
            said.line(f"{source.id}: warning: {lacking}")
        if not all(task.is_as_opened() for task in tasks[:1]):
            said.problem(f"{source.id}: its files changed while they were read — run it again")
        found = _finish(opened, tree, said, [c.title for c in fed] if nothing else [])
        said.line(str(Path(job.out) / source.id / "index.html"))
        return Record(found, worker.seconds)


def _tasks(opened: Opened, tree: Tree) -> list[Task]:
    """Every chapter that the device feeds and that is asked for, in reading order, each by sensor.

    Side by side are then chapters of different sensors, which compute nothing twice.
    """
    job, source = opened.job, opened.source
    return [
        Task(
            chapter,
            source,
            sensor,
            _needs(chapter, source, sensor),
            tree.root / source.id / sensor,
            Path(job.out) / source.id / sensor,
            f"{source.id} {sensor}/{chapter.slug}",
            opened.key,
        )
        for chapter in chapters.CHAPTERS
        for sensor in results.sensors()
        if source.feeds(chapter, sensor) and (not job.only or chapter.slug in job.only)
    ]


def _key(opened: Opened, tree: Tree) -> str:
    """Hash of all that a device's results.json hangs on; "" where that is not known."""
    source, folder = opened.source, tree.root / opened.source.id
    if not opened.key or source.problems:
        return ""
    made_of = [
        (sensor, chapter.slug, keys.in_record(folder / sensor / f"{chapter.slug}.json"))
        for sensor in results.sensors()
        for chapter in chapters.CHAPTERS
    ]
    return keys.of(keys.of_software(), opened.key, source.about, made_of)


def _current(opened: Opened, tasks: list[Task], tree: Tree) -> dict[str, Any] | None:
    """The results.json of an earlier run where this one would make the same of everything."""
    folder = tree.root / opened.source.id
    try:
        found = json.loads((folder / "results.json").read_bytes())
        same = bool(key := _key(opened, tree)) and found["key"] == key and not found["problems"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    there = is_whole(folder / "index.html") and (folder / "results.csv").is_file()
    whole = same and there and all(task.is_current(task.parameters()) for task in tasks)
    return found if whole else None


def _is_shared(opened: Opened, tasks: list[Task]) -> bool:
    """Whether a device's chapters share what is read and computed once."""
    return opened.job.engine == "warm" and bool(tasks) and _size(opened.source) < HELD


def _size(source: Source) -> int:
    """Bytes of all files beside a device's declaration, or of a bare recording."""
    if source.path.is_file():
        return source.path.stat().st_size
    return sum(file.stat().st_size for file in source.path.rglob("*") if file.is_file())


def _needs(chapter: chapters.Chapter, device: Source, sensor: str) -> dict[str, str]:
    """Where the records lie that a chapter reads, as `Task.needs`: those that the device feeds now.

    What lies there of a recording that it has no more is removed at the end.
    """
    table = {c.slug: c for c in chapters.CHAPTERS}
    return {
        slug: f"{slug}.json" if other == sensor else f"../{other}/{slug}.json"
        for other, slug in chapter.needed(sensor)
        if slug in table and device.feeds(table[slug], other)
    }


def _has_place(device: Source, tree: Tree, said: Telling) -> bool:
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


def _finish(opened: Opened, tree: Tree, said: Telling, left_out: list[str]) -> dict[str, Any]:
    """Writes what derives from the chapters' files: results.json and the device's index.

    `left_out` are the titles of what the recordings feed, where `--only` left nothing of it.
    """
    from sensorbook.reporting import execute, index

    device = opened.source
    folder = tree.root / device.id
    if not device.parsed and (kept := _kept(device, folder)):
        found, page = kept
        tree.write(folder / "results.json", results.dumps(found))
        tree.write(folder / "index.html", page)
        return found
    for sensor in results.sensors():
        for chapter in chapters.CHAPTERS:
            if not device.feeds(chapter, sensor) and (folder / sensor).resolve() == folder / sensor:
                for kind in KINDS:
                    (folder / sensor / f"{chapter.slug}.{kind}").unlink(missing_ok=True)
    records = results.read_records(folder)
    for record in results.outdated(records):
        sensor, slug = record["sensor"], record["chapter"]
        said.line(f"{device.id} {sensor}/{slug}: of an earlier recording, removed: render it again")
        for kind in KINDS:
            (folder / sensor / f"{slug}.{kind}").unlink(missing_ok=True)
        records.remove(record)
    found = results.assemble(
        device.about, execute.software(), execute.now(), records, device.problems
    )
    found["key"] = _key(opened, tree)
    tree.write(folder / "results.json", results.dumps(found))
    tree.write(folder / "results.csv", results.csv_text(found))
    tree.write(
        folder / "index.html",
        index.device_page(
            found,
            folder,
            [] if found["chapters"] else left_out,
            lacking=lacks_gyroscope(device.recorded),
        ),
    )
    return found


def _kept(device: Source, folder: Path) -> tuple[dict[str, Any], str] | None:
    """An earlier results.json with the problem that a device has now, and its page; None for none."""
    from sensorbook.reporting import index

    try:
        found = json.loads((folder / "results.json").read_bytes())
        if found["device"]["id"] != device.id or not found["chapters"]:
            return None
        found |= {"problems": list(device.problems)}
        return found, index.device_page(found, folder, earlier=True)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
