"""What `device.toml` may say, checked as a whole: every problem in one go, each with its mend.

Nothing here reads a recording. Problems of the device stop `load`; problems of one recording stay
with it, so that the others remain usable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

import numpy as np

from sensorbook.errors import Problem
from sensorbook.recordings import checks
from sensorbook.recordings.checks import Fault, shown, suggest, unit_fault
from sensorbook.units import SENSOR_UNITS, quantities, si_unit

FILE = "device.toml"
SENSORS = (*SENSOR_UNITS, "camera", "reference", "temperature")
KINDS = {  # kind: sensors it is recorded with, besides a temperature of its own time base
    "static": tuple(SENSOR_UNITS),
    "thermal": tuple(SENSOR_UNITS),
    "positions": ("accelerometer", "gyroscope"),
    "six_position": ("accelerometer",),
    "rotation": ("magnetometer", "accelerometer"),
    "images": ("camera",),
    "trajectory": (*SENSOR_UNITS, "reference"),
}
_CHECKED = ("positions", "six_position", "rotation")  # kinds that may be kept for checking


@dataclass(frozen=True)
class Declared:
    """One `[[recording]]` table: `sensor`, `kind` and `file` are None where they are not valid."""

    number: int
    sensor: str | None
    kind: str | None
    file: str | None
    table: dict
    problems: tuple[Problem, ...]

    @property
    def label(self) -> str:
        """Such as "recording 2 (gyroscope, static)"."""
        return _label(self.number, self.sensor, self.kind)


def _label(number: int, sensor: str | None, kind: str | None) -> str:
    named = ", ".join(name for name in (sensor, kind) if name)
    return f"recording {number} ({named})" if named else f"recording {number}"


def check_declaration(table: dict) -> tuple[list[Problem], list[Declared]]:
    """Problems of the device as a whole, and the recordings declared with their own problems."""
    problems = _check_keys(table, _DEVICE, "")
    for key in ("schema", "id"):
        if key not in table:
            mend = "write schema = 1" if key == "schema" else 'write id = "…", such as "imu-7"'
            problems.append(Problem(FILE, key, "is missing", mend))
    if isinstance(table.get("site"), dict):
        problems += _check_keys(table["site"], _SITE, "site")
    if isinstance(table.get("spec"), dict):
        problems += _check_spec(table["spec"])
    recordings = table.get("recording", [])
    if not isinstance(recordings, list) or not all(isinstance(r, dict) for r in recordings):
        mend = "begin each recording with a line [[recording]]"
        return [*problems, Problem(FILE, "recording", "is not a list of tables", mend)], []
    if not recordings:
        mend = "add a [[recording]] table with sensor, kind and file"
        problems.append(Problem(FILE, "recording", "there is none", mend))
    declared = [_check_recording(k, r) for k, r in enumerate(recordings, start=1)]
    return problems, _each_once(declared)


# ---- tables of keys ----

Checks = dict[str, Callable[[object], Fault | None]]

_DEVICE: Checks = {
    "schema": checks.version,
    "id": checks.device_id,
    "name": checks.text,
    "model": checks.text_or_number,
    "serial": checks.text_or_number,
    "site": checks.table,
    "recording": lambda value: None,  # checked one by one
    "spec": checks.table,
}
_SITE: Checks = {
    "latitude": checks.number(-90, 90, "39.89"),
    "longitude": checks.number(-180, 360, "32.78"),
    "height": checks.number(-12_000, 1e6, "900.0"),
    "date": checks.day,
}
_RECORDING: Checks = {
    "sensor": checks.one_of(*SENSORS),
    "kind": checks.one_of(*KINDS),
    "file": lambda value: None,  # a pattern for the camera only
    "rate": checks.number(0, 1e9, "100.0", open_low=True),
    "unit": checks.text,
    "columns": checks.table,
    "time_unit": checks.time_unit,
    "temperature_unit": lambda value: unit_fault(value, "degC"),
    "scale": checks.table,
    "table": checks.text,
    "segments": checks.file_name,
    "quaternion": checks.one_of("body_to_reference", "reference_to_body"),
    "guessed": checks.guessed,
    "check": checks.flag,  # kept out of a calibration, and used to judge it
    "camera": checks.table,
    "poses": checks.file_name,
}
_SCALE: Checks = {
    "factor": checks.number_or_three,
    "offset": checks.number_or_three,
    "unit": checks.text,
}
_CAMERA: Checks = {
    "width": checks.pixels,
    "height": checks.pixels,
    "focal_px": checks.number(0, 1e7, "369.5", open_low=True),
    "principal_point": checks.numbers((2,), "two numbers [x, y] in pixels"),
    "distortion": checks.numbers(tuple(range(9)), "a list of up to eight numbers"),
    "sees": checks.one_of("earth", "sun", "both"),
    "to_body": checks.rotation,
    # m, of a spherical Earth, as simulators have it; WGS 84 where it is left out.
    "earth_radius": checks.number(1e6, 1e8, "6371000.0"),
}
MAX_PIXELS = 100_000_000  # of an image: twice the largest sensor that flies
_CAMERA_NEEDS = ("width", "height", "focal_px")
_COLUMNS = ("time", "x", "y", "z", "w", "temperature", "segment")


def _check_keys(table: dict, known: Checks, where: str) -> list[Problem]:
    problems = []
    for key, value in table.items():
        place = f"{where}: {key}" if where else key
        if key not in known:
            problems.append(Problem(FILE, place, "is not a key of this table", suggest(key, known)))
        elif fault := known[key](value):
            problems.append(Problem(FILE, place, *fault))
    return problems


def _check_spec(spec: dict) -> list[Problem]:
    problems = []

    def wrong(where: str, fault: Fault | None):
        if fault:
            problems.append(Problem(FILE, where, *fault))

    for sensor, limits in spec.items():
        where = f"spec.{sensor}"
        if sensor not in SENSOR_UNITS:
            wrong(where, ("is not a sensor with limits", suggest(sensor, SENSOR_UNITS)))
        elif fault := checks.table(limits):
            wrong(where, fault)
        else:
            for quantity, limit in limits.items():
                for key, fault in _limit_faults(sensor, quantity, limit):
                    wrong(f"{where}.{quantity}{key}", fault)
    return problems


def _limit_faults(sensor: str, quantity: str, limit: object):
    known = quantities(sensor)
    if quantity not in known:
        yield "", ("is not a quantity with a limit", suggest(quantity, known))
        return
    if not isinstance(limit, dict):
        yield "", (f"{shown(limit)} is not a table", 'write { max = …, unit = "…" }')
        return
    si = si_unit(sensor, quantity)
    most = 100 if quantity == "coverage_percent" and "unit" not in limit else math.inf
    for key, value in limit.items():
        if key in ("min", "max"):
            yield f".{key}", checks.number(0, most)(value)  # a limit is about a size
        elif key == "unit":
            yield ".unit", unit_fault(value, si)
        else:
            yield f".{key}", ("is not a key of a limit", suggest(key, ("min", "max", "unit")))
    both = [limit.get("min"), limit.get("max")]
    if all(map(checks.finite, both)) and both[0] > both[1]:
        yield (
            ".min",
            (f"{shown(both[0])} is above max, which is {shown(both[1])}", "mend one of them"),
        )
    if not {"min", "max"} & limit.keys():
        yield "", ("sets no limit", 'write { max = …, unit = "…" }')
    named = quantity.endswith(("_percent", "_percent_check", "_deg"))  # its name says its unit
    if "unit" not in limit and not named:
        yield ".unit", ("is missing", f'write unit = "{si}" or another unit of it')


def _check_recording(number: int, table: dict) -> Declared:
    sensor, kind = table.get("sensor"), table.get("kind")
    sensor = sensor if isinstance(sensor, str) and sensor in SENSORS else None
    kind = kind if isinstance(kind, str) and kind in KINDS else None
    where = _label(number, sensor, kind)
    problems = _check_keys(table, _RECORDING, where)

    def wrong(key: str, fault: Fault | None):
        if fault:
            problems.append(Problem(FILE, f"{where}: {key}", *fault))

    for key, example in (("sensor", "gyroscope"), ("kind", "static"), ("file", "static.csv")):
        if key not in table:
            wrong(key, ("is missing", f'write {key} = "{example}" or what it is'))
    file_fault = checks.file_name(table["file"], sensor == "camera") if "file" in table else None
    wrong("file", file_fault)
    if sensor and kind and sensor != "temperature" and sensor not in KINDS[kind]:
        wrong("kind", (f"{kind!r} is not recorded with the {sensor}",
                       f"use it with {' or '.join(KINDS[kind])}"))  # fmt: skip
    if "check" in table and kind and kind not in _CHECKED:
        wrong("check", (f"a recording of kind {kind!r} is not used to check a calibration",
                        f"leave it out; it goes with {' and '.join(_CHECKED)}"))  # fmt: skip
    if sensor == "camera":
        _check_camera(table, wrong)
    elif sensor:
        _check_columns(table, sensor, wrong)
        _check_unit(table, sensor, wrong)
        if kind and kind != "rotation" and "rate" not in table and not _has_time(table):
            wrong("rate", ("there is neither a rate nor a time column",
                           "write rate = … in Hz, or columns.time"))  # fmt: skip
    file = table["file"] if "file" in table and not file_fault else None
    return Declared(number, sensor, kind, file, table, tuple(problems))


def _each_once(declared: list[Declared]) -> list[Declared]:
    """The recordings, with a problem where one lists the images of another: each would count twice."""
    first: dict[str, Declared] = {}
    checked = []
    for d in declared:
        if d.sensor == "camera" and d.file:
            other = first.setdefault(PurePosixPath(d.file).as_posix(), d)
            if other is not d:
                message = f"{shown(d.file)} is that of {other.label} already"
                mend = "give each camera a folder of its own, or leave one recording out"
                problem = Problem(FILE, f"{d.label}: file", message, mend)
                d = replace(d, problems=(*d.problems, problem))
        checked.append(d)
    return checked


def _has_time(table: dict) -> bool:
    return isinstance(table.get("columns"), dict) and "time" in table["columns"]


def _check_columns(table: dict, sensor: str, wrong) -> None:
    columns = table.get("columns")
    needed = {"reference": ("w", "x", "y", "z"), "temperature": ("temperature",)}.get(
        sensor, ("x", "y", "z")
    )
    if columns is None:
        example = ", ".join(f'{axis} = "…"' for axis in needed)
        wrong("columns", ("is missing", f"write columns = {{ {example} }}"))
    if not isinstance(columns, dict):
        return
    for key, value in columns.items():
        if key not in _COLUMNS:
            wrong(f"columns.{key}", ("is not a column that is used", suggest(key, _COLUMNS)))
        elif not isinstance(value, str) and (type(value) is not int or not 0 <= value < 100_000):
            wrong(f"columns.{key}", (f"{shown(value)} is neither a name nor a 0-based index",
                                     "give the column's name or index"))  # fmt: skip
    for axis in needed:
        if axis not in columns:
            wrong(f"columns.{axis}", ("is missing", "give the column's name or 0-based index"))
    given = [shown(columns[axis]) for axis in needed if axis in columns]
    for twice in sorted({name for name in given if given.count(name) > 1}):
        wrong("columns", (f"{twice} stands for two axes", "give each axis its own column"))
    if sensor == "reference" and "quaternion" not in table:
        wrong("quaternion", ("is missing", 'write "body_to_reference" or "reference_to_body"'))


def _check_unit(table: dict, sensor: str, wrong) -> None:
    unit, scale = table.get("unit"), table.get("scale")
    si = SENSOR_UNITS.get(sensor, "degC" if sensor == "temperature" else None)
    if si is None:
        return  # a quaternion has none
    if unit is None and sensor != "temperature":
        _, mend = unit_fault("", si)
        wrong("unit", ("is missing", mend))
    elif isinstance(unit, str) and unit != "counts":
        wrong("unit", unit_fault(unit, si))
    if unit == "counts" and scale is None:
        wrong("scale", ("is missing, and counts have no unit of their own",
                        f'write scale = {{ factor = …, offset = 0, unit = "{si}" }}'))  # fmt: skip
    if not isinstance(scale, dict):
        return
    if unit != "counts":
        wrong("scale", ("goes with counts only", 'write unit = "counts", or leave scale out'))
    for problem in _check_keys(scale, _SCALE, "scale"):
        wrong(problem.where.replace(": ", "."), (problem.message, problem.mend))
    for key in ("factor", "unit"):
        if key not in scale:
            wrong(f"scale.{key}", ("is missing", "value = (count − offset) · factor, in unit"))
    if isinstance(scale.get("unit"), str):
        wrong("scale.unit", unit_fault(scale["unit"], si))
    if checks.number_or_three(scale.get("factor", 1)) is None and not np.all(
        scale.get("factor", 1)
    ):
        wrong("scale.factor", ("is zero", "write the value of one count"))


def _check_camera(table: dict, wrong) -> None:
    camera = table.get("camera")
    if camera is None:
        wrong("camera", ("is missing", "write camera = { width = …, height = …, focal_px = … }"))
    if not isinstance(camera, dict):
        return
    for problem in _check_keys(camera, _CAMERA, "camera"):
        wrong(problem.where.replace(": ", "."), (problem.message, problem.mend))
    for key in _CAMERA_NEEDS:
        if key not in camera:
            wrong(f"camera.{key}", ("is missing", "a camera needs width, height and focal_px"))
    width, height = camera.get("width"), camera.get("height")
    if checks.pixels(width) or checks.pixels(height):
        return
    if width * height > MAX_PIXELS:
        wrong("camera", (f"has {width} × {height} pixels, {width * height / 1e6:.0f} million",
                         f"at most {MAX_PIXELS / 1e6:.0f} million are read: scale the images"))  # fmt: skip
    if "principal_point" in camera and not _CAMERA["principal_point"](camera["principal_point"]):
        fault = checks.principal_point(camera["principal_point"], width, height)
        wrong("camera.principal_point", fault)
