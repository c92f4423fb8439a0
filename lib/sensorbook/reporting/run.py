"""Runs every chapter that the devices' recordings feed, and writes the report tree."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

from sensorbook.recordings.advice import lacks_gyroscope
from sensorbook.reporting import chapters, execute, group, index, results
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml
from sensorbook.reporting.tree import Tree
from sensorbook.reporting.work import (
    KINDS,
    Said,
    Source,
    Task,
    open_source,
    same_ids,
    work_off,
)


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
    said = Said(stdout or sys.stdout, stderr or sys.stderr, debug)
    if junit_file and (
        Path(junit_file).is_dir() or not Path(junit_file).absolute().parent.is_dir()
    ):
        said.problem(f"{junit_file}: cannot be written — name a file in a folder that is there")
        return 1
    paths = list(paths)
    devices: list[Source] = []
    unread: list[str] = []
    for path in paths:
        before = len(said.problems)
        if (device := open_source(Path(path), said)) is None:
            unread += said.problems[before:]
        else:
            devices.append(device)
    if same_ids(devices, said):
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


def _run(
    devices: list[Source], tree: Tree, out: Path, jobs: int, only: set[str], said: Said
) -> list[dict[str, Any]]:
    """Renders everything; returns the results of each device that has a place for its report."""
    ready = [device for device in devices if _has_place(device, tree, said)]
    planned = []
    for device in ready:
        for sensor in results.sensors():
            fed = [c for c in chapters.CHAPTERS if device.feeds(c, sensor)]
            folder, shown_in = tree.root / device.id / sensor, out / device.id / sensor
            name = f"{device.id} {sensor}/"
            planned.append(
                [
                    Task(
                        c,
                        device,
                        sensor,
                        _needs(c, device, sensor),
                        folder,
                        shown_in,
                        name + c.slug,
                    )
                    for c in fed
                    if not only or c.slug in only
                ]
            )
    said.total = sum(map(len, planned))
    work_off(planned, tree, jobs, said)
    found = []
    for device in ready:
        fed = [c for c in chapters.CHAPTERS if any(device.feeds(c, s) for s in c.sensors)]
        nothing = bool(only and fed) and not any(c.slug in only for c in fed)
        if nothing:
            listed = ", ".join(c.slug for c in fed)
            said.line(f"{device.id}: --only leaves nothing to do; its recordings feed {listed}")
        if lacking := lacks_gyroscope(device.recorded):
            said.line(f"{device.id}: warning: {lacking}")
        found.append(_finish(device, tree, said, [c.title for c in fed] if nothing else []))
        said.line(f"{out / device.id / 'index.html'}")
    tree.write(tree.root / "index.html", group.group_page(tree.root))
    said.line(f"{out / 'index.html'}")
    return found


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


def _has_place(device: Source, tree: Tree, said: Said) -> bool:
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


def _finish(device: Source, tree: Tree, said: Said, left_out: list[str]) -> dict[str, Any]:
    """Writes what derives from the chapters' files: results.json and the device's index.

    `left_out` are the titles of what the recordings feed, where `--only` left nothing of it.
    """
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
    try:
        found = json.loads((folder / "results.json").read_bytes())
        if found["device"]["id"] != device.id or not found["chapters"]:
            return None
        found |= {"problems": list(device.problems)}
        return found, index.device_page(found, folder, earlier=True)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
