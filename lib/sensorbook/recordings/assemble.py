"""From a declaration and the table it names to a `Recording`: numbers, clock, units, segments."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.checks import shown
from sensorbook.recordings.clock import advancing, measured_rate
from sensorbook.recordings.even import MINIMUM_SAMPLES
from sensorbook.recordings.findings import examine
from sensorbook.recordings.recording import Finding, Recording, Segment
from sensorbook.recordings.schema import FILE, Declared
from sensorbook.recordings.tables import Table
from sensorbook.units import SENSOR_UNITS, factor, to_si

_COLUMNS = {"reference": ("x", "y", "z", "w"), "temperature": ("temperature",)}

ABSURD = 1e30  # in any unit: no reading of a sensor; squares of more overflow


def read_recording(declared: Declared, table: Table, labels: Table | None = None) -> Recording:
    """The recording as declared; raises `InputError` with all its problems.

    Parameters
    ----------
    declared : a declaration without problems
    table : the file it names
    labels : the table of its `segments` file, if it names one
    """
    sensor, declaration = declared.sensor, declared.table
    columns = declaration["columns"]
    problems: list[Problem] = []

    def attempt(read, *arguments):
        try:
            return read(*arguments)
        except InputError as error:
            problems.extend(p for p in error.problems if p not in problems)
            return None

    attempt(table.parse, list(columns.values()))
    if problems:
        raise InputError(*problems)
    named = _COLUMNS.get(sensor, ("x", "y", "z"))
    raw = [attempt(numbers, table, columns[axis]) for axis in named]
    clock = temperature = None
    if "time" in columns:
        clock = attempt(stamps, table, columns["time"], declaration.get("time_unit", "s"))
    if "temperature" in columns and sensor != "temperature":
        temperature = attempt(numbers, table, columns["temperature"])
    if problems:
        raise InputError(*problems)
    for axis, column in zip(named, raw, strict=True):
        if fault := _column_fault(column, sensor):
            where = f"column {columns[axis]!r}"
            problems.append(Problem(table.file, where, *fault))
    labels_column = table.column(columns["segment"]) if "segment" in columns else None
    together = [*raw, temperature, clock and clock[0], labels_column]
    if len(lengths := {len(column) for column in together if column is not None}) > 1:
        lengths = ", ".join(map(str, sorted(lengths)))
        problems.append(Problem(table.file, "", f"its columns differ in length ({lengths})",
                                "save columns of one length"))  # fmt: skip
    if problems:
        raise InputError(*problems)

    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is no number, either
        values = np.stack(
            [in_si(column, k, sensor, declaration) for k, column in enumerate(raw)], axis=1
        )
    values[~np.isfinite(values)] = np.nan
    time, start, rate = _time_base(clock, declaration.get("rate"), len(values))
    if clock is not None and rate is None:
        where = f"column {columns['time']!r}"
        mend = "name the column that holds the time, or give the rate"
        if "received" in table.names and columns["time"] != "received":  # ROS, its stamps not set
            mend = 'take the time of receipt, time = "received", or give the rate'
        raise InputError(Problem(table.file, where, "the time does not advance", mend))
    if temperature is not None:
        temperature = to_si(temperature, declaration.get("temperature_unit", "degC"), "degC")
        temperature[~np.isfinite(temperature)] = np.nan
    segments = ()
    if labels_column is not None:
        segments = _runs_of_labels(labels_column, time, rate)
    elif labels is not None:
        segments = _labelled(labels, declaration.get("time_unit", "s"), start)
    recording = Recording(
        sensor=sensor,
        kind=declared.kind,
        file=table.file,
        time=time,
        values=values,
        temperature=temperature,
        rate=rate,
        unit=SENSOR_UNITS.get(sensor, "degC" if sensor == "temperature" else ""),
        sha256=table.sha256,
        declaration=declaration,
        start=start,
        segments=segments,
    )
    findings = examine(recording, raw, [columns[axis] for axis in named])
    lost = [Finding(table.file, sensor, "gap", text) for text in table.losses]
    findings = (*_guesses(recording), *lost, *(_by_receipt(f, table, columns) for f in findings))
    if temperature is not None and declared.kind != "thermal" and np.isnan(temperature).all():
        temperature = None  # said among the findings; a thermal recording is refused for it
    return replace(recording, findings=findings, temperature=temperature)


def _by_receipt(finding: Finding, table: Table, columns: dict) -> Finding:
    """Of stamps that go back in messages whose times of receipt do not: those mend it."""
    if finding.kind != "backward" or finding.remedy or columns["time"] == "received":
        return finding
    if "received" not in table.names or not advancing(table.column("received")).all():
        return finding
    return replace(finding, remedy='take the time of receipt, time = "received"')


def _guesses(recording: Recording) -> tuple[Finding, ...]:
    """What the declaration itself says is a guess."""
    said = {
        "low": "is a guess of low certainty",
        "not known": "is not known, and no result follows without it",
    }
    remedy = f"give it in {FILE}, and take it out of guessed there"
    return tuple(
        Finding(recording.file, recording.sensor, "guessed",
                f"its {key.replace('_', ' ')} {said[sure]}", remedy)
        for key, sure in recording.declaration.get("guessed", {}).items()
    )  # fmt: skip


def numbers(table: Table, reference: str | int) -> np.ndarray:
    """(N,) a column's numbers, integers kept; raises `InputError` naming the first row of text."""
    column = table.column(reference)
    if column.dtype.kind in "iuf":
        return column
    import pandas

    series = pandas.Series(column.astype(object))
    parsed = pandas.to_numeric(series.astype(str).where(series.notna()), errors="coerce")
    bad = np.flatnonzero((parsed.isna() & series.notna()).to_numpy())
    if len(bad):
        raise _no_number(table.file, reference, bad, series, "is not a number")
    return parsed.to_numpy(dtype=np.float64)


def stamps(table: Table, reference: str | int, unit: str) -> tuple[np.ndarray, float]:
    """(N,) s from the first finite stamp of a time column, and that stamp in s on its own clock.

    Text is taken as ISO 8601 (UTC where no zone is given), then counted from 1970.
    """
    column = table.column(reference)
    if column.dtype.kind == "M":
        column = column.astype("datetime64[ns]")
    elif column.dtype.kind not in "iuf":
        import pandas

        series = pandas.Series(column.astype(object))
        parsed = pandas.to_datetime(series, utc=True, format="ISO8601", errors="coerce")
        bad = np.flatnonzero((parsed.isna() & series.notna()).to_numpy())
        if len(bad) == len(series):
            column = numbers(table, reference)
        elif len(bad):
            raise _no_number(table.file, reference, bad, series, "is not a time")
        else:
            column = parsed.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")
    scale = factor(unit, "s")
    missing = ~np.isfinite(column)
    if missing.all():
        raise InputError(
            Problem(table.file, f"column {reference!r}", "holds no time at all", "name the time")
        )
    if column.dtype.kind == "M":
        column, scale = column.astype(np.int64), 1e-9
    # A narrow type would overflow in the difference.
    whole = column.dtype.kind in "iu" and column.dtype != np.uint64
    column = column.astype(np.int64 if whole else np.float64)
    first = column[np.argmin(missing)]
    # Subtracted before scaling: nanoseconds since 1970 do not fit a float64.
    with np.errstate(over="ignore", invalid="ignore"):
        seconds = (column - first) * scale
    seconds[missing] = np.nan
    if np.nanmax(np.abs(seconds)) > 1e12:
        raise InputError(
            Problem(table.file, f"column {reference!r}", "spans more than 30 000 years",
                    "name the column that holds the time, and check time_unit")
        )  # fmt: skip
    return seconds, float(first) * scale


def _no_number(file: str, reference, bad: np.ndarray, series, what: str) -> InputError:
    more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
    return InputError(
        Problem(file, f"column {reference!r}, row {bad[0] + 1}",
                f"{shown(str(series[bad[0]]))} {what}{more}", "mend the row or leave the cell empty")
    )  # fmt: skip


def _column_fault(column: np.ndarray, sensor: str) -> tuple[str, str] | None:
    minimum = 2 if sensor in ("temperature", "reference") else MINIMUM_SAMPLES
    if len(column) < minimum:
        return f"holds {len(column)} samples", f"record at least {minimum}"
    finite = column[np.isfinite(column)]
    if not len(finite):
        return "holds no number at all", "name the column that holds the samples"
    if sensor in SENSOR_UNITS and finite.min() == finite.max():
        return (
            f"is constant: every sample is {finite[0]:g}",
            "name the column that holds the samples, or record again with the sensor running",
        )
    largest = finite[np.argmax(np.abs(finite))]
    if abs(largest) > ABSURD:
        return f"reads {largest:g}, which no sensor does", "mend or remove such samples"
    return None


def in_si(column: np.ndarray, axis: int, sensor: str, declaration: dict) -> np.ndarray:
    """(N,) a column as recorded → SI, by the declaration's unit and scale."""
    if sensor == "reference":
        return column.astype(np.float64)
    unit = declaration.get("unit", "degC" if sensor == "temperature" else "")
    si = SENSOR_UNITS.get(sensor, "degC")
    values = column.astype(np.float64)
    if unit == "counts":
        scale = declaration["scale"]
        values = (values - _of_axis(scale.get("offset", 0), axis)) * _of_axis(scale["factor"], axis)
        unit = scale["unit"]
    return to_si(values, unit, si)


def as_recorded(values: np.ndarray, axis: int, sensor: str, declaration: dict) -> np.ndarray:
    """The inverse of `in_si`: (N,) SI → the declaration's unit; counts keep their fractions."""
    unit, scale = declaration.get("unit", ""), declaration.get("scale", {})
    if unit != "counts":
        return values / factor(unit, SENSOR_UNITS[sensor])
    steps = values / factor(scale["unit"], SENSOR_UNITS[sensor]) / _of_axis(scale["factor"], axis)
    return steps + _of_axis(scale.get("offset", 0), axis)


def _of_axis(value, axis: int) -> float:
    return float(value[axis] if isinstance(value, list) else value)


def _time_base(clock, declared_rate, count: int) -> tuple[np.ndarray, float, float | None]:
    """Time (N,), start and rate: from the stamps where there are any, else from the rate."""
    if clock is None:
        rate = None if declared_rate is None else float(declared_rate)
        return np.arange(count) / (rate or 1.0), 0.0, rate
    time, start = clock
    return time, start, measured_rate(time, declared_rate)


def _runs_of_labels(labels: np.ndarray, time: np.ndarray, rate: float | None):
    """Segments of equal neighbouring labels; rows without a label belong to none."""
    import pandas

    missing = pandas.isna(labels)
    text = np.where(missing, "", [f"{v:g}" if isinstance(v, float) else str(v) for v in labels])
    breaks = np.flatnonzero(text[1:] != text[:-1]) + 1
    bounds = np.concatenate(([0], breaks, [len(text)]))
    step = 1 / rate if rate else 1.0
    return tuple(
        Segment(str(text[a]), float(time[a]), float(time[b - 1]) + step)
        for a, b in itertools.pairwise(bounds)
        if text[a].strip()
    )


def _labelled(table: Table, unit: str, start: float) -> tuple[Segment, ...]:
    names = ("label", "start", "end")
    references = names if set(names) <= set(table.names) else (0, 1, 2)
    table.parse(references)
    texts = table.column(references[0])
    (starts, first), (ends, last) = (stamps(table, r, unit) for r in references[1:])
    return tuple(
        Segment(str(label), float(a), float(b))
        for label, a, b in zip(texts, starts + first - start, ends + last - start, strict=True)
    )
