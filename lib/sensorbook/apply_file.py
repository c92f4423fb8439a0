"""Corrects a file's raw readings with a results.json and writes the same table again."""

from __future__ import annotations

import gzip
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sensorbook.apply import correct
from sensorbook.errors import InputError, Problem
from sensorbook.export.source import Entry, read_results
from sensorbook.recordings import Recording
from sensorbook.recordings.assemble import as_recorded, in_si, numbers, stamps
from sensorbook.recordings.checks import shown
from sensorbook.recordings.tables import READERS, Table, open_table, source_of, table_names
from sensorbook.units import SENSOR_UNITS, to_si

AXES = ("x", "y", "z")
ORDER = ("accelerometer", "gyroscope", "magnetometer")  # a gyroscope may need the acceleration
WRITTEN = (".csv", ".csv.gz", ".txt", ".parquet", ".feather", ".npz")


@dataclass(frozen=True)
class Applied:
    """What was done, a line a sensor, and what to know about it."""

    done: tuple[str, ...]
    warnings: tuple[str, ...]


def apply_file(
    results: str | Path,
    file: str | Path,
    output: str | Path,
    sensor: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> Applied:
    """Writes `file` to `output` with its sensors' columns corrected, in their unit; the rest as it was.

    Parameters
    ----------
    results : results.json of the device
    file : a raw recording, with columns and unit as one of the device's own recordings
    sensor : correct this sensor alone
    columns : its columns, x, y, z and optionally temperature and time, where they have other names

    Raises
    ------
    InputError : with what is wrong; nothing is written then
    """
    found = read_results(results)
    path, target = Path(file), Path(output)
    _check_target(path, target, Path(results))
    declarations = _declarations(found, sensor)
    name = _table_name(path, declarations)
    if name is not None:
        declarations = [d for d in declarations if d.get("table") in (None, name)]
    table = open_table(
        path, path.name, name, [c for d in declarations for c in d["columns"].values()]
    )
    chosen = {
        name: _fitting(name, mine, table, path, columns)
        for name in ORDER
        if (mine := [d for d in declarations if d["sensor"] == name])
    }
    chosen = {name: d for name, d in chosen.items() if d is not None}
    warnings: list[str] = []
    if not chosen:
        raise InputError(_nothing_fits(path, table, declarations))
    for name, reason in _left_raw(found, declarations, chosen, table):
        warnings.append(f"{name}: left as it is, {reason}")
    chosen = _apart(chosen, table, path)
    replaced: dict[int, np.ndarray] = {}
    done, refused = [], []
    acceleration = None
    for name, declaration in chosen.items():
        entry = found.at("sensors").get(name)
        recording = _read(table, name, declaration)
        corrected, steps, notes, reasons = correct(recording, entry.value or {}, acceleration)
        if name == "accelerometer" and steps:
            acceleration = corrected.values
        refused += [f"{name}: {reason}" for reason in reasons]
        if not steps:
            continue
        done.append(f"{name}: {', '.join(steps)}, in {declaration.get('unit')}")
        warnings += [f"{name}: {note}" for note in notes]
        for axis, key in enumerate(AXES):
            index = table.index(declaration["columns"][key])
            replaced[index] = as_recorded(corrected.values[:, axis], axis, name, declaration)
    if not replaced:
        where = Path(results).name
        problems = [Problem(where, *_split(reason)) for reason in refused]
        raise InputError(*problems)
    _write(path, table, declarations, replaced, target)
    return Applied(tuple(done), tuple(warnings + refused))


def _left_raw(found: Entry, declarations, chosen, table: Table):
    """The sensors with a correction whose columns the file does not have, and why."""
    for name in dict.fromkeys(d["sensor"] for d in declarations):
        result = found.at("sensors").get(name).value or {}
        calibrated = (result.get("calibration") or {}).get("method") or result.get("thermal")
        if name in chosen or not calibrated:
            continue
        columns = next(d["columns"] for d in declarations if d["sensor"] == name)
        try:
            for axis in AXES:
                table.index(columns[axis])
        except (InputError, KeyError) as error:
            problem = error.problems[0] if isinstance(error, InputError) else None
            yield (
                name,
                f"{problem.where} {problem.message}" if problem else "an axis is not declared",
            )


def _split(reason: str) -> tuple[str, str, str]:
    sensor, _, text = reason.partition(": ")
    return f"sensors.{sensor}", text, "nothing was written"


def _check_target(path: Path, target: Path, results: Path) -> None:
    """Raises where the output would overwrite an input or is of no kind that can be written."""

    def wrong(message: str, mend: str) -> InputError:
        return InputError(Problem(str(target), "", message, mend))

    for other, what in ((path, "recording"), (results, "results.json")):
        if target.exists() and other.exists() and target.samefile(other):
            raise wrong(f"is the {what} itself", "name another file with -o")
    if target.is_dir():
        raise wrong("is a folder", "name a file with -o")
    if not target.name.lower().endswith(WRITTEN):
        listed = ", ".join(WRITTEN)
        raise wrong(
            "has an ending that tells no table that can be written", f"end it with {listed}"
        )
    if not target.parent.is_dir():
        raise wrong("its folder does not exist", "make it first, or name another")


def _declarations(found: Entry, sensor: str | None) -> list[dict[str, Any]]:
    """The device's recordings of vectors, each once."""
    listed = []
    for entry in found.at("inputs").items():
        value = entry.value
        usable = isinstance(value, dict) and value.get("sensor") in ORDER
        if not usable or not isinstance(value.get("columns"), dict):
            continue
        if sensor in (None, value["sensor"]):
            listed.append(value)
    there = {e.value.get("sensor") for e in found.at("inputs").items() if isinstance(e.value, dict)}
    if there == {"camera"}:
        raise found.at("inputs").wrong(
            "are a camera's images: a camera has no calibration that could be applied",
            "name the results.json of an inertial sensor or a magnetometer",
        )
    if not listed:
        what = f"of the {sensor} " if sensor else ""
        raise found.at("inputs").wrong(f"lists no recording {what}that a file could be like")
    return listed


def _table_name(path: Path, declarations: Sequence[dict]) -> str | None:
    """The file's table, named as in the recordings' declarations; None where it is a single one."""
    there = table_names(path, path.name)
    if not there and source_of(path, path.name)[1].__name__ == READERS_TEXT:
        return None  # a text is one table, whatever the device was recorded in
    names = [n for n in dict.fromkeys(d.get("table") for d in declarations) if n in there]
    if len(names) > 1:
        sensors = dict.fromkeys(d["sensor"] for d in declarations if d.get("table") in names)
        raise InputError(
            Problem(
                path.name,
                "",
                f"holds a table each for {', '.join(sensors)}",
                "say which with --sensor",
            )
        )
    # A file without names of tables may still have had one named, such as an array of an archive.
    return names[0] if names else next((d["table"] for d in declarations if d.get("table")), None)


def _apart(chosen: dict[str, dict], table: Table, path: Path) -> dict[str, dict]:
    """The sensors whose columns are their own; those of one set belong to the file of that name."""
    by_columns: dict[tuple, list[str]] = {}
    for name, d in chosen.items():
        by_columns.setdefault(tuple(table.index(d["columns"][a]) for a in AXES), []).append(name)
    kept = {}
    for names in by_columns.values():
        mine = [n for n in names if Path(str(chosen[n].get("file", ""))).name == path.name]
        if len(names) > 1 and len(mine) != 1:
            columns = ", ".join(str(chosen[names[0]]["columns"][a]) for a in AXES)
            raise InputError(
                Problem(path.name, f"columns {columns}", f"are those of {' and '.join(names)} alike",
                        "say which with --sensor")
            )  # fmt: skip
        name = mine[0] if len(names) > 1 else names[0]
        kept[name] = chosen[name]
    return {name: kept[name] for name in ORDER if name in kept}


def _fitting(
    sensor: str,
    declared: Sequence[dict],
    table: Table,
    path: Path,
    columns: Mapping[str, str] | None,
) -> dict | None:
    """The declaration that the file's columns fit; None where none does."""
    if columns:
        declared = [d | {"columns": _given(columns, table)} for d in declared]
    fitting = [d for d in declared if all(_has(table, d["columns"].get(a)) for a in AXES)]
    if same := [d for d in fitting if Path(str(d.get("file", ""))).name == path.name]:
        fitting = same
    ways = {
        repr((d.get("unit"), d.get("scale"), [d["columns"][a] for a in AXES])): d for d in fitting
    }
    if len(ways) > 1:
        told = "; ".join(
            f"unit {d.get('unit')!r}, columns {[d['columns'][a] for a in AXES]} in {d.get('file')}"
            for d in ways.values()
        )
        raise InputError(
            Problem(path.name, sensor, f"could be read in {len(ways)} ways, as the device's recordings "
                    f"were declared differently ({told})",
                    "give the file the name of the recording it is like, or --sensor and --columns")
        )  # fmt: skip
    return next(iter(ways.values()), None)


def _given(columns: Mapping[str, str], table: Table) -> dict[str, str | int]:
    """Columns as the user names them; digits are 0-based indices unless a column has that name."""
    return {
        key: int(name) if re.fullmatch("[0-9]{1,5}", name) and name not in table.names else name
        for key, name in columns.items()
    }


def _has(table: Table, reference: Any) -> bool:
    try:
        table.index(reference)
    except (InputError, TypeError):
        return False
    return isinstance(reference, str | int)


def _nothing_fits(path: Path, table: Table, declarations: Sequence[dict]) -> Problem:
    wanted = dict.fromkeys(str(d["columns"].get(a)) for d in declarations for a in AXES)
    there = ", ".join(repr(n) for n in table.names[:12] if n) or f"{len(table.names)} without names"
    return Problem(
        path.name,
        "",
        f"has none of the columns of the device's recordings ({', '.join(wanted)}); columns: {there}",
        "name them with --sensor and --columns x=…,y=…,z=…",
    )


def _read(table: Table, sensor: str, declaration: dict) -> Recording:
    """The sensor's readings in SI, with clock and temperature where the file has them."""
    columns = declaration["columns"]
    table.parse([columns[key] for key in columns if _has(table, columns[key])])
    raw = [numbers(table, columns[axis]) for axis in AXES]
    values = np.stack([in_si(c, k, sensor, declaration) for k, c in enumerate(raw)], axis=1)
    values[~np.isfinite(values)] = np.nan
    rate = declaration.get("rate") or declaration.get("rate_hz")
    time = np.arange(len(values)) / (rate or 1.0)
    if "time" in columns and _has(table, columns["time"]):
        time, _ = stamps(table, columns["time"], declaration.get("time_unit", "s"))
    temperature = None
    if "temperature" in columns and _has(table, columns["temperature"]):
        unit = declaration.get("temperature_unit", "degC")
        temperature = to_si(numbers(table, columns["temperature"]), unit, "degC")
        temperature[~np.isfinite(temperature)] = np.nan
    return Recording(
        sensor, "static", table.file, time, values, temperature, rate, SENSOR_UNITS[sensor],
        declaration=declaration,
    )  # fmt: skip


# ---- the corrected table ----


def _write(
    path: Path, table: Table, declarations, replaced: dict[int, np.ndarray], target: Path
) -> None:
    """Writes the table aside, then moves it to its place."""
    source, reader = source_of(path, path.name)
    ending = "".join(target.suffixes[-2:]).lower()
    text_out = not ending.endswith((".parquet", ".feather", ".npz"))
    try:
        handle, aside = tempfile.mkstemp(dir=target.parent, prefix=".applied-")
    except OSError as error:
        raise InputError(
            Problem(str(target), "", f"cannot be written: {error.strerror}", "name another file")
        ) from None
    try:
        with os.fdopen(handle, "wb") as stream:
            if reader.__name__ == READERS_TEXT and text_out:
                wanted = [c for d in declarations for c in d["columns"].values()]
                with gzip.open(stream, "wb") if ending.endswith(".gz") else _open(stream) as out:
                    reader.rewrite(source, wanted, replaced, out)
            else:
                _write_frame(table, replaced, ending, stream)
        os.chmod(aside, 0o666 & ~_umask())
        os.replace(aside, target)
    except OSError as error:
        raise InputError(
            Problem(str(target), "", f"cannot be written: {error.strerror}", "name another file")
        ) from None
    finally:
        Path(aside).unlink(missing_ok=True)


READERS_TEXT = f"sensorbook.recordings.{READERS[b'']}"


def _open(stream):
    """The stream itself as a context that leaves it open."""
    from contextlib import nullcontext

    return nullcontext(stream)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _write_frame(table: Table, replaced: Mapping[int, np.ndarray], ending: str, stream) -> None:
    """All columns of the table, by name, in the format that the ending asks for."""
    import pandas

    everything = range(len(table.names))
    table.parse(list(everything))
    names = [name or f"column_{k}" for k, name in enumerate(table.names)]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise InputError(
            Problem(
                table.file,
                f"column {shown(twice)}",
                "is there twice",
                "write it to a .csv of its own",
            )
        )
    data = {n: replaced.get(k, None) for k, n in enumerate(names)}
    data = {n: table.column(k) if data[n] is None else data[n] for k, n in enumerate(names)}
    if ending.endswith(".npz"):
        texts = [n for n, c in data.items() if c.dtype.kind == "O"]
        np.savez(stream, **{n: c.astype(str) if n in texts else c for n, c in data.items()})
        return
    frame = pandas.DataFrame(data)
    if ending.endswith(".parquet"):
        frame.to_parquet(stream, index=False)
    elif ending.endswith(".feather"):
        frame.to_feather(stream)
    else:
        compression = "gzip" if ending.endswith(".gz") else None
        frame.to_csv(stream, index=False, float_format="%.9g", compression=compression)
