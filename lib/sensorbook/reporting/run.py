"""Runs every chapter that the devices' recordings feed, and writes the report tree."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, TextIO

from sensorbook.reporting.device import Job, Opened, Record, open_device, render_device
from sensorbook.reporting.forks import Ended, Forks, Slots
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml, needed
from sensorbook.reporting.tree import Tree
from sensorbook.reporting.work import Said, glance, is_whole, same_ids, told_of

Done = Callable[[int, Record], None]


def report(
    paths: Iterable[str],
    out: str,
    jobs: int | None = None,
    only: Iterable[str] = (),
    debug: bool = False,
    gated: bool = False,
    junit_file: str | None = None,
    force: bool = False,
    engine: str = "warm",
    cluster: str | None = None,
    stdout: TextIO | None = None,
    stderr: TextIO | None = None,
) -> int:
    """Renders the reports of device folders and bare recordings into `out`; returns the exit code.

    0 is done, 1 that something failed, 3 that `gated` devices fail a limit or cannot be judged. What
    is there and up to date is not rendered again, but with `force`. `engine` is "warm", or "kernel"
    for a kernel of Jupyter's a chapter. `cluster` is the address of a Dask scheduler, whose workers
    then render the devices. `junit_file` is written at the end, whatever the outcome.
    """
    said = Said(stdout or sys.stdout, stderr or sys.stderr)
    if junit_file and (
        Path(junit_file).is_dir() or not Path(junit_file).absolute().parent.is_dir()
    ):
        said.problem(f"{junit_file}: cannot be written — name a file in a folder that is there")
        return 1
    paths = [Path(path) for path in paths]
    only = tuple(only)
    seen = [glance(path, only) for path in paths]
    if same_ids([(name, path) for (name, _), path in zip(seen, paths, strict=True)], said):
        return 1
    given = [
        Job(str(path), out, only, force, engine, debug, len(notebooks))
        for (_, notebooks), path in zip(seen, paths, strict=True)
    ]
    sure = {
        notebook
        for name, notebooks in seen
        if force or not (Path(out) / name / "results.json").is_file()
        for notebook in notebooks
    }
    stopped: dict[int, list[str]] = {}
    suites: dict[int, Any] = {}
    records = _Records()

    def done(number: int, record: Record) -> None:
        records.add(number, record)
        if record.found and gated:
            stopped[number] = list(gate(record.found))
        if record.found and junit_file:
            suites[number] = needed(record.found)

    try:
        with Tree(out) as tree:
            tree.tidy()
            if cluster is not None:
                from sensorbook.reporting.cluster import on_cluster

                on_cluster(cluster, given, said, done)
            else:
                here(given, jobs or os.cpu_count() or 1, said, done, sure)
            if records.any and (records.changed or not is_whole(tree.root / "index.html")):
                from sensorbook.reporting.group import group_page

                with tree.locked("."):
                    tree.write(tree.root / "index.html", group_page(tree.root))
            if records.any:
                said.line(f"{Path(out) / 'index.html'}")
        if junit_file:
            found = [suites[number] for number in sorted(suites)]
            _write(Path(junit_file), junit_xml(found, records.seconds, records.unread))
    except OSError as error:
        said.problem(told_of(error))
    for number in sorted(stopped):
        for line in stopped[number]:
            print(line, file=said.stderr, flush=True)
    return 1 if said.problems else 3 if any(stopped.values()) else 0


class _Records:
    """What the records of all devices come to."""

    def __init__(self) -> None:
        self.any = self.changed = False
        self.seconds: dict[tuple[str, str, str], float] = {}  # by device, sensor, chapter
        self._unread: dict[int, tuple[str, ...]] = {}

    def add(self, number: int, record: Record) -> None:
        self._unread[number] = record.problems
        self.any |= record.found is not None
        self.changed |= record.changed
        for (sensor, slug), took in record.seconds.items():
            self.seconds[record.found["device"]["id"], sensor or "", slug] = took

    @property
    def unread(self) -> list[str]:
        """Problems of paths that gave no device at all."""
        return [line for _, lines in sorted(self._unread.items()) for line in lines]


def _write(path: Path, text: str) -> None:
    """Writes a file aside, then moves it to its place."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def here(
    given: Sequence[Job], jobs: int, said: Said, done: Done, sure: Collection[Path] = ()
) -> None:
    """Renders devices on this machine, `jobs` chapters at a time, those of one device first.

    Each device is opened in a fork and, where something is to be rendered, rendered in another, made
    once all that chapters import is imported: of notebooks that are `sure` to be executed, while the
    first devices are opened.
    """
    slots = Slots(jobs)
    forks = Forks(slots, nested=True)

    def heard(told: tuple) -> None:
        getattr(said, told[0])(*told[1:])

    def ended(number: int, what: Opened | Record | Ended) -> None:
        if isinstance(what, Opened):
            if what.job.engine == "warm":
                _warm_up(frozenset(what.notebooks))
            call = partial(render_device, what, slots=slots)
            forks.add((number, 1), call, partial(ended, number), heard)
        elif isinstance(what, Ended):
            problem = f"{given[number].path}: its process died, often for want of memory"
            said.problem(problem)
            done(number, Record(None, problems=(problem,)))
        else:
            done(number, what)

    said.more(sum(job.steps for job in given))
    for number, job in enumerate(given):
        forks.add((number, 0), partial(open_device, job), partial(ended, number), heard)

    def meanwhile() -> None:
        if sure and given[0].engine == "warm":
            _warm_up(frozenset(sure))

    try:
        forks.run(meanwhile)
    finally:
        slots.close()


@cache
def _warm_up(notebooks: frozenset[Path]) -> None:
    """Imports all that chapters and pages need, once."""
    gc.disable()  # looking for garbage takes an eighth of the imports, and they leave none
    try:
        from sensorbook.reporting import render, warm

        render.warm_up(notebooks)
        warm.warm_up(notebooks)
    finally:
        gc.enable()
