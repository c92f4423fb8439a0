"""What `device.toml` may say, checked as a whole: every problem in one go, each with its mend.

Nothing here reads a recording. Problems of the device stop `load`; problems of one recording stay
with it, so that the others remain usable.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from pathlib import PurePosixPath, PureWindowsPath

import numpy as np

from sensorbook.errors import Problem
from sensorbook.units import SENSOR_UNITS, UnitError, factor, quantities, si_unit

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
RESERVED_IDS = ("index.html", "book")
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_RATIOS = ("residual_percent", "residual_percent_check", "coverage_percent")

Fault = tuple[str, str]  # what was found, how to mend it


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
    return problems, [_check_recording(k, r) for k, r in enumerate(recordings, start=1)]


def check_file_name(name: object, pattern: bool = False) -> Fault | None:
    """What is wrong with a file name as declared: only a relative path inside the folder passes."""
    inside = "name a file inside the device folder, such as data/static.csv"
    if not isinstance(name, str) or not name.strip():
        return f"{shown(name)} is not a file name", inside
    if not name.isprintable() or len(name) > 500:
        return f"{shown(name)} is not a file name", inside
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).anchor:
        return f"{shown(name)} is an absolute path", inside
    if ".." in (*PurePosixPath(name).parts, *PureWindowsPath(name).parts):
        return f"{shown(name)} leads out of the device folder", inside
    if not pattern and any(c in name for c in "*?"):
        return f"{shown(name)} is a pattern", "name one file a recording"
    return None


def shown(value: object) -> str:
    """A value for a message: its repr, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 80 else text[:78] + "…" + text[-1]


def suggest(name: object, known) -> str:
    """ "did you mean …?" where a known name is close; otherwise the names there are."""
    close = get_close_matches(str(name), list(known), n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(known)}"


# ---- single values: each returns what is wrong, or None ----


def _text(value: object) -> Fault | None:
    return None if isinstance(value, str) else (f"{shown(value)} is not text", 'write "…"')


def _text_or_number(value: object) -> Fault | None:
    plain = isinstance(value, (str, int)) and not isinstance(value, bool)
    return None if plain else (f"{shown(value)} is not text", 'write "…"')


def _finite(value: object) -> bool:
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and -1e300 < value < 1e300
    )


def _number(low: float = -math.inf, high: float = math.inf, example: str = "1.0", open_low=False):
    def check(value: object) -> Fault | None:
        if not _finite(value):
            return f"{shown(value)} is not a finite number", f"write a number such as {example}"
        if not low <= value <= high or (open_low and value == low):
            limits = f"above {low:g}" if high == math.inf else f"between {low:g} and {high:g}"
            return f"{shown(value)} is out of range", f"write a number {limits}, such as {example}"
        return None

    return check


def _one_of(*allowed: str):
    def check(value: object) -> Fault | None:
        if value in allowed and isinstance(value, str):
            return None
        return f"{shown(value)} is not allowed here", suggest(value, allowed)

    return check


def _table(value: object) -> Fault | None:
    return None if isinstance(value, dict) else (f"{shown(value)} is not a table", "write { … }")


def _schema(value: object) -> Fault | None:
    if type(value) is int and value == 1:
        return None
    return f"{shown(value)} is not a version this sensorbook reads", "write schema = 1"


def _id(value: object) -> Fault | None:
    if not isinstance(value, str) or not _ID.fullmatch(value):
        return (
            f"{shown(value)} cannot name the report folder",
            "use 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit",
        )
    if value in RESERVED_IDS:
        return f"{value!r} is reserved for the report tree", "choose another id"
    return None


def _date(value: object) -> Fault | None:
    if isinstance(value, date):  # datetime is one, too
        return None
    try:
        date.fromisoformat(value[:10])
    except (TypeError, ValueError):
        return f"{shown(value)} is not a date", "write a date such as 2024-05-01"
    return None


def unit_fault(spelling: object, si: str) -> Fault | None:
    """What is wrong with a unit that should measure the same as `si`."""
    if not isinstance(spelling, str):
        return f"{shown(spelling)} is not text", 'write "…"'
    try:
        factor(spelling, si)
    except UnitError as error:
        return error.message, error.mend
    return None


def _time_unit(value: object) -> Fault | None:
    return unit_fault(value, "s")


def _number_or_three(value: object) -> Fault | None:
    if _finite(value) or (isinstance(value, list) and len(value) == 3 and all(map(_finite, value))):
        return None
    return f"{shown(value)} is neither a number nor three", "write a number, or one for each axis"


def _numbers(count: tuple[int, ...], what: str):
    def check(value: object) -> Fault | None:
        if isinstance(value, list) and len(value) in count and all(map(_finite, value)):
            return None
        return f"{shown(value)} is not {what}", f"write {what}"

    return check


def _rotation(value: object) -> Fault | None:
    rows = isinstance(value, list) and len(value) == 3
    rows = rows and all(isinstance(r, list) and len(r) == 3 and all(map(_finite, r)) for r in value)
    mend = "write a rotation of three rows, such as [[1,0,0],[0,1,0],[0,0,1]]"
    if not rows:
        return f"{shown(value)} is not a 3×3 matrix", mend
    matrix = np.array(value, dtype=np.float64)
    # 1e-3: matrices typed in with four digits are meant as rotations.
    if np.abs(matrix).max() > 2 or np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3:
        return f"{shown(value)} is not a rotation: its rows are not orthonormal", mend
    if np.linalg.det(matrix) < 0:
        return f"{shown(value)} is a reflection, not a rotation", mend
    return None


def _pixels(value: object) -> Fault | None:
    if type(value) is int and 1 <= value <= 100_000:
        return None
    return f"{shown(value)} is not a number of pixels", "write a whole number such as 1280"


# ---- tables of keys ----

Checks = dict[str, Callable[[object], Fault | None]]

_DEVICE: Checks = {
    "schema": _schema,
    "id": _id,
    "name": _text,
    "model": _text_or_number,
    "serial": _text_or_number,
    "site": _table,
    "recording": lambda value: None,  # checked one by one
    "spec": _table,
}
_SITE: Checks = {
    "latitude": _number(-90, 90, "39.89"),
    "longitude": _number(-180, 360, "32.78"),
    "height": _number(-12_000, 1e6, "900.0"),
    "date": _date,
}
_RECORDING: Checks = {
    "sensor": _one_of(*SENSORS),
    "kind": _one_of(*KINDS),
    "file": lambda value: None,  # a pattern for the camera only
    "rate": _number(0, 1e9, "100.0", open_low=True),
    "unit": _text,
    "columns": _table,
    "time_unit": _time_unit,
    "temperature_unit": lambda value: unit_fault(value, "degC"),
    "scale": _table,
    "table": _text,
    "segments": check_file_name,
    "quaternion": _one_of("body_to_reference", "reference_to_body"),
    "camera": _table,
    "poses": check_file_name,
}
_SCALE: Checks = {"factor": _number_or_three, "offset": _number_or_three, "unit": _text}
_CAMERA: Checks = {
    "width": _pixels,
    "height": _pixels,
    "focal_px": _number(0, 1e7, "369.5", open_low=True),
    "principal_point": _numbers((2,), "two numbers [x, y] in pixels"),
    "distortion": _numbers(tuple(range(9)), "a list of up to eight numbers"),
    "sees": _one_of("earth", "sun", "both"),
    "to_body": _rotation,
}
_CAMERA_NEEDS = ("width", "height", "focal_px")
_COLUMNS = ("time", "x", "y", "z", "w", "temperature", "segment")


def _check_keys(table: dict, checks: Checks, where: str) -> list[Problem]:
    problems = []
    for key, value in table.items():
        place = f"{where}: {key}" if where else key
        if key not in checks:
            problems.append(
                Problem(FILE, place, "is not a key of this table", suggest(key, checks))
            )
        elif fault := checks[key](value):
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
        elif fault := _table(limits):
            wrong(where, fault)
        else:
            for quantity, limit in limits.items():
                for key, fault in _limit_faults(sensor, quantity, limit):
                    wrong(f"{where}.{quantity}{key}", fault)
    return problems


def _limit_faults(sensor: str, quantity: str, limit: object):
    known = (*quantities(sensor), *(_RATIOS if sensor == "magnetometer" else ()))
    if quantity not in known:
        yield "", ("is not a quantity with a limit", suggest(quantity, known))
        return
    if not isinstance(limit, dict):
        yield "", (f"{shown(limit)} is not a table", 'write { max = …, unit = "…" }')
        return
    si = "1" if quantity in _RATIOS else si_unit(sensor, quantity)
    for key, value in limit.items():
        if key in ("min", "max"):
            yield f".{key}", _number()(value)
        elif key == "unit":
            yield ".unit", unit_fault(value, si)
        else:
            yield f".{key}", ("is not a key of a limit", suggest(key, ("min", "max", "unit")))
    if not {"min", "max"} & limit.keys():
        yield "", ("sets no limit", 'write { max = …, unit = "…" }')
    if "unit" not in limit and quantity not in _RATIOS:
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
    file_fault = check_file_name(table["file"], sensor == "camera") if "file" in table else None
    wrong("file", file_fault)
    if sensor and kind and sensor != "temperature" and sensor not in KINDS[kind]:
        wrong("kind", (f"{kind!r} is not recorded with the {sensor}",
                       f"use it with {' or '.join(KINDS[kind])}"))  # fmt: skip
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
    if _number_or_three(scale.get("factor", 1)) is None and not np.all(scale.get("factor", 1)):
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
