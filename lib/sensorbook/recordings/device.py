"""A device folder: `load` reads its declaration, recordings are read when asked for."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.advice import advise, lacks_gyroscope, of_trajectory, with_remedies
from sensorbook.recordings.assemble import read_recording
from sensorbook.recordings.bags import storage_file
from sensorbook.recordings.checks import as_date, file_name
from sensorbook.recordings.companions import with_shared_shocks, with_temperature
from sensorbook.recordings.images import Images, listed_twice, read_images, shared_rows
from sensorbook.recordings.paths import resolve
from sensorbook.recordings.recording import Finding, Recording, html_table
from sensorbook.recordings.schema import FILE, Declared, check_declaration
from sensorbook.recordings.tables import Table, open_table
from sensorbook.units import SENSOR_UNITS

if TYPE_CHECKING:
    from sensorbook.guessing import Guessed

_LARGEST_DECLARATION = 1 << 20


_held: dict[Path, Device] = {}


def read_whole(path: str | Path) -> Device | None:
    """A device with all its recordings read, but for images; None where it has a problem as a whole."""
    with contextlib.suppress(InputError):
        device = load(path)
        for declared in device.declared:
            if declared.sensor != "camera":
                device._get(declared)
        return device
    return None


def hold(device: Device) -> None:
    """Has `load` give a device that is read already, from now on.

    For processes that are about to be forked into several that read it: none of them need to.
    """
    _held[_place(device.path)] = device


def _place(path: str | Path) -> Path:
    path = Path(path)
    return (path.parent if path.name == FILE else path).resolve()


def load(path: str | Path) -> Device:
    """The device in a folder (or of a `device.toml`), or what a bare recording file is guessed to hold.

    Raises `InputError` with every problem of the device as a whole. What is wrong with one recording
    is raised when that recording is read, so that the others remain usable; `check` gathers all.
    """
    if held := _held and _held.get(_place(path)):
        return held
    device, problems = _open(Path(path))
    if device is None or problems:
        raise InputError(*problems, *(device.problems if device else ()))
    return device


def check(path: str | Path) -> tuple[list[Problem], list[Finding]]:
    """Every problem and every finding of a device folder or bare recording; computes no result."""
    return check_device(path)[1:]


def check_device(path: str | Path) -> tuple[Device | None, list[Problem], list[Finding]]:
    """The device, where there is one, with every problem and finding."""
    device, problems = _open(Path(path))
    if device is None:
        return None, problems, []
    found, findings = device.check()
    return device, problems + found, findings


def _open(path: Path) -> tuple[Device | None, list[Problem]]:
    if path.is_file() and path.name != FILE:
        return _of_file(path)
    folder = path.parent if path.name == FILE else path
    source = folder / FILE

    def wrong(message: str, mend: str, where: str = "") -> tuple[None, list[Problem]]:
        return None, [Problem(FILE if folder.is_dir() else str(path), where, message, mend)]

    if not folder.is_dir():
        what = "is no folder" if folder.exists() else "there is no such file or folder"
        return wrong(what, f"name a folder that holds a {FILE}, or a recording")
    if not source.is_file():
        try:
            bag = storage_file(folder)
        except InputError as error:
            return None, list(error.problems)
        if bag:
            return _of_file(bag)
        return wrong(f"is missing in {folder.name or folder}", "write one with: sensorbook new")
    try:
        data = source.read_bytes()
        if len(data) > _LARGEST_DECLARATION:
            return wrong("is larger than 1 MiB", "recordings belong into files of their own")
        table = tomli.loads(data.decode("utf-8-sig"))
    except OSError as error:
        return wrong(f"cannot be read: {error.strerror}", "check the file and its rights")
    except UnicodeDecodeError:
        return wrong("is not UTF-8 text", "save it as UTF-8")
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        return wrong(f"is not valid TOML: {str(error) or 'nested too deep'}", "mend the syntax")
    return from_declaration(folder, table)


def _of_file(path: Path) -> tuple[Device | None, list[Problem]]:
    """The device that a bare recording file is guessed to hold."""
    from sensorbook.guessing import device_id, guess_files

    if fault := file_name(path.name):
        return None, [Problem(path.name, "", fault[0], "rename it")]
    try:
        guessed = guess_files([path])
    except InputError as error:
        return None, list(error.problems)
    name = device_id(path.name.split(".")[0])
    table = {"schema": 1, "id": name, "name": path.name}
    table["recording"] = [recording.table for recording in guessed.recordings]
    device, problems = from_declaration(path.parent, table)
    device.path, device.guessed, device.truth = path, guessed, None
    device.take_tables(guessed.tables)
    return device, problems


def from_declaration(folder: str | Path, table: dict) -> tuple[Device, list[Problem]]:
    """A device from a declaration that stands in no file, and the problems of it as a whole."""
    problems, declared = check_declaration(table)
    truth, source = None, Path(folder) / "truth.json"
    if source.is_file():
        try:
            truth = json.loads(source.read_bytes())
        except (OSError, ValueError, RecursionError) as error:
            problems.append(Problem("truth.json", "", f"is not valid JSON: {error}", "mend it"))
    return Device(Path(folder), table, declared, truth), problems


class Device:
    """A device and its recordings.

    Attributes
    ----------
    path : the folder, or the bare recording file
    id, name : as declared; `name` is free text, to be escaped where it is shown
    model, serial : text, or None
    site, spec : the tables of device.toml, {} where absent; `site["date"]` is a `datetime.date`
    declared : one `Declared` per recording, in order
    truth : what truth.json beside device.toml holds, or None
    guessed : what was guessed where the device is a bare recording file, else None

    `device.gyroscope.static` is the longest static run, `device.runs("gyroscope", "static")` all.
    """

    def __init__(self, path: Path, table: dict, declared: Iterable[Declared], truth=None):
        self.path = path
        self.id: str = table.get("id", "")
        self.name: str = table.get("name", self.id)
        self.model, self.serial = (
            None if table.get(key) is None else str(table[key]) for key in ("model", "serial")
        )
        self.site: dict = _with_date(table.get("site", {}))
        self.spec: dict = table.get("spec", {})
        self.declared = tuple(declared)
        self.truth = truth
        self.guessed: Guessed | None = None
        self._folder = path
        self._tables: dict[tuple[str, str | None], Table] = {}
        # As read from the files, and completed with what recordings take from one another.
        self._files: dict[int, Recording | Images | InputError] = {}
        self._read: dict[int, Recording | Images | InputError] = {}

    # ---- what there is ----

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors declared."""
        return tuple(dict.fromkeys(d.sensor for d in self.declared if d.sensor))

    def kinds(self, sensor: str) -> tuple[str, ...]:
        """Kinds of recording declared for a sensor."""
        mine = (d.kind for d in self.declared if d.sensor == sensor and d.kind)
        return tuple(dict.fromkeys(mine))

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Problems of the recordings' declarations; those of their files come with reading."""
        return tuple(problem for d in self.declared for problem in d.problems)

    def runs(self, sensor: str, kind: str) -> tuple[Recording, ...]:
        """All recordings of one kind for one sensor, longest first; () where none is declared.

        Raises `InputError` with the problems of all of them when any is bad.
        """
        runs = self._in_order(sensor, kind)
        return tuple(sorted(runs, key=_length, reverse=True))

    def _in_order(self, sensor: str, kind: str) -> list[Recording]:
        read = [self._get(d) for d in self.declared if (d.sensor, d.kind) == (sensor, kind)]
        problems = [p for r in read if isinstance(r, InputError) for p in r.problems]
        if problems:
            raise InputError(*dict.fromkeys(problems))
        return read

    def check(self) -> tuple[list[Problem], list[Finding]]:
        """Every problem and finding of the recordings."""
        read = [self._get(d) for d in self.declared]
        problems = [p for r in read if isinstance(r, InputError) for p in r.problems]
        findings = [
            finding
            for r in read
            if not isinstance(r, InputError)
            for finding in with_remedies(r.findings)
        ]
        cameras = [r for r in read if isinstance(r, Images)]
        findings += [f for camera in cameras for f in camera.unusable()]
        findings += listed_twice(cameras) + shared_rows(cameras)
        more = self._check_trajectory()
        problems, findings = problems + more[0], findings + more[1]
        return list(dict.fromkeys(problems)), list(dict.fromkeys(findings))

    def _check_trajectory(self) -> tuple[list[Problem], list[Finding]]:
        """Problems and findings of the recordings of a trajectory beside one another."""
        if lacking := lacks_gyroscope((d.sensor, d.kind) for d in self.declared):
            return [], [Finding(FILE, "", "coverage", lacking, "add the gyroscope's recording")]
        read = [self._get(d) for d in self.declared if d.kind == "trajectory"]
        runs = [r for r in read if isinstance(r, Recording)]
        if not runs:
            return [], []
        runs.sort(key=_length, reverse=True)
        declared = {d.sensor for d in self.declared if d.kind in ("trajectory", "images")}
        return of_trajectory(runs, declared, "positions" in self.kinds("gyroscope"))

    def advice(self) -> list[Finding]:
        """What could be recorded better, of every recording that is readable."""
        read = [self._get(d) for d in self.declared]
        return [
            finding
            for recording in read
            if isinstance(recording, Recording)
            for finding in advise(recording, "thermal" in self.kinds(recording.sensor))
        ]

    def __getattr__(self, name: str) -> Sensor:
        if name.startswith("_") or "declared" not in self.__dict__:
            raise AttributeError(name)
        if name not in self.sensors:
            there = ", ".join(self.sensors) or "none"
            raise AttributeError(f"{self.id} has no recording of {name!r}; sensors: {there}")
        return Sensor(self, name)

    def __dir__(self):
        return [*super().__dir__(), *self.sensors]

    def __repr__(self) -> str:
        return f"<Device {self.id!r}: {', '.join(self.sensors)}>"

    def _repr_html_(self) -> str:
        rows = [
            (d.sensor or "?", d.kind or "?", d.file or "?", "; ".join(map(str, d.problems)))
            for d in self.declared
        ]
        title = html_table([(self.name, self.model or "", self.serial or "")])
        return title + html_table(rows, ("sensor", "kind", "file", "problems"))

    # ---- reading ----

    def take_tables(self, tables: dict[tuple[str, str | None], Table]) -> None:
        """Tables that are open already, by file and table name; each is taken out once it is read."""
        self._tables = tables

    def _get(self, declared: Declared) -> Recording | Images | InputError:
        if declared.number not in self._read:
            if declared.number not in self._files:
                self._files |= self._read_file(declared)
            self._read[declared.number] = _attempt(self._completed, declared)
        return self._read[declared.number]

    def _read_file(self, declared: Declared) -> dict[int, Recording | Images | InputError]:
        """Reads all recordings of one file at one go: it is opened and parsed once."""
        if declared.problems:
            return {declared.number: InputError(*declared.problems, *self._in_its_file(declared))}
        if declared.sensor == "camera":
            return {declared.number: _attempt(read_images, declared, self._folder)}

        def source(d: Declared) -> tuple:
            return d.sensor == "camera", d.file, d.table.get("table")

        together = [d for d in self.declared if not d.problems and source(d) == source(declared)]
        wanted = [column for d in together for column in d.table["columns"].values()]
        table = _attempt(self._open_table, declared, wanted)
        if isinstance(table, InputError):
            return dict.fromkeys((d.number for d in together), table)
        return {d.number: _attempt(self._recording, d, table) for d in together}

    def _in_its_file(self, declared: Declared) -> tuple[Problem, ...]:
        """What is wrong with the file, too, where a recording's unit or scale is all that hides it."""
        said = {
            p.where.removeprefix(f"{declared.label}: ").split(".")[0] for p in declared.problems
        }
        if declared.sensor not in SENSOR_UNITS or not said <= {"unit", "scale"}:
            return ()
        table = {k: v for k, v in declared.table.items() if k != "scale"}
        table["unit"] = SENSOR_UNITS[declared.sensor]
        stand_in = dataclasses.replace(declared, table=table, problems=())
        read = _attempt(self._open_table, stand_in, list(table["columns"].values()))
        if not isinstance(read, InputError):
            read = _attempt(self._recording, stand_in, read)
        return read.problems if isinstance(read, InputError) else ()

    def _open_table(self, declared: Declared, wanted) -> Table:
        name = declared.table.get("table")
        # All recordings of a table are read together: it need not stay in memory with them.
        table = self._tables.pop((declared.file, name), None)
        if table is None:
            path = resolve(self._folder, declared.file, f"{declared.label}: file")
            table = open_table(path, declared.file, name, wanted)
        table.parse(wanted)
        return table

    def _recording(self, declared: Declared, table: Table) -> Recording:
        labels = None
        if name := declared.table.get("segments"):
            labels = open_table(resolve(self._folder, name, f"{declared.label}: segments"), name)
        return read_recording(declared, table, labels)

    def _completed(self, declared: Declared) -> Recording | Images:
        """The recording with what it takes from others; raises where it was not readable."""
        recording = self._files[declared.number]
        if isinstance(recording, InputError):
            raise recording
        if declared.kind == "static":
            beside = [r for r in self._files.values() if _static(r) and r.file == recording.file]
            recording = with_shared_shocks(recording, beside)
        if declared.sensor not in SENSOR_UNITS:
            return recording
        if "temperature" not in declared.table["columns"]:
            same = (declared.sensor, declared.kind)
            mine = [d.number for d in self.declared if (d.sensor, d.kind) == same]
            if sources := self._in_order("temperature", declared.kind):
                run = mine.index(declared.number)
                recording = with_temperature(recording, sources, run, len(mine))
        temperature = recording.temperature
        if declared.kind == "thermal" and (
            temperature is None or not np.isfinite(temperature).any()
        ):
            what = "is missing" if temperature is None else "holds no temperature"
            raise InputError(
                Problem(FILE, f"{declared.label}: columns.temperature", what,
                        "name the temperature's column, or add a recording of the temperature")
            )  # fmt: skip
        return recording


def _length(recording: Recording) -> tuple[float, int]:
    """Its duration in s, 0 where that is not known, and its number of samples."""
    return (recording.duration if recording.rate else 0, len(recording))


def _attempt(read, *arguments):
    """What `read` returns, or the `InputError` it raises: one bad recording leaves the others."""
    try:
        return read(*arguments)
    except InputError as error:
        return error


def _with_date(site: dict) -> dict:
    """`[site]` with its date as one, however it is written; what is none stays, and is a problem."""
    if not isinstance(site, dict) or (day := as_date(site.get("date"))) is None:
        return site
    return site | {"date": day}


def _static(read) -> bool:
    return isinstance(read, Recording) and read.kind == "static" and read.sensor in SENSOR_UNITS


class Sensor:
    """A sensor's recordings: `sensor.static` is the longest static run."""

    def __init__(self, device: Device, name: str):
        self._device, self.name = device, name

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of recording declared for this sensor."""
        return self._device.kinds(self.name)

    def runs(self, kind: str) -> tuple[Recording, ...]:
        """All recordings of this kind, longest first."""
        return self._device.runs(self.name, kind)

    def __getattr__(self, kind: str) -> Recording:
        if kind.startswith("_"):
            raise AttributeError(kind)
        if kind not in self.kinds:
            there = ", ".join(self.kinds) or "none"
            raise AttributeError(
                f"{self._device.id} has no {kind!r} recording of the {self.name}; kinds: {there}"
            )
        return self.runs(kind)[0]

    def __dir__(self):
        return [*super().__dir__(), *self.kinds]

    def __repr__(self) -> str:
        return f"<{self.name} of {self._device.id!r}: {', '.join(self.kinds)}>"
