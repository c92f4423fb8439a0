"""From bare recordings to a declaration: every value guessed, with how sure that is and why.

Files → tables → columns → triples → sensors → units, clock, kind → `[[recording]]` tables. What
cannot be told is either left out and said, or declared to hold the place and marked "not known".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.guessing import scales
from sensorbook.guessing.beside import kind_beside, together
from sensorbook.guessing.certainty import CERTAINTIES, HIGH, LOW, MEDIUM, UNKNOWN, Guess, weakest
from sensorbook.guessing.clock import NO_CLOCK
from sensorbook.guessing.columns import Column
from sensorbook.guessing.kinds import kind_of, quaternion_of
from sensorbook.guessing.names import words_of
from sensorbook.guessing.opened import Opened, open_one, swing, unit_of
from sensorbook.guessing.reasons import derived, muted, problem, why_none
from sensorbook.guessing.sensors import Triple
from sensorbook.recordings.tables import Table, table_names


@dataclass(frozen=True)
class GuessedRecording:
    """A `[[recording]]` table and how each of its values came about."""

    table: dict
    guesses: tuple[Guess, ...]


@dataclass(frozen=True)
class Guessed:
    """What files hold: recordings, and sentences on what was left out."""

    recordings: tuple[GuessedRecording, ...]
    left_out: tuple[str, ...]
    tables: dict[tuple[str, str | None], Table]


def guess_files(paths: Sequence[Path], names: Sequence[str] | None = None) -> Guessed:
    """Guesses what recordings hold.

    Parameters
    ----------
    paths : the files, of one device
    names : how the declaration names them; default, their own names

    Raises
    ------
    InputError : a file cannot be read, or none of them holds a sensor that can be told
    """
    opened: list[Opened] = []
    problems: list[Problem] = []
    for path, name in zip(paths, names or [p.name for p in paths], strict=True):
        try:
            tables = table_names(path, name)
            # The only one need not be named to be found, but its name may tell the sensor.
            alone = len(tables) == 1
            for table in tables or (None,):
                opened.append(open_one(path, name, None if alone else table, table or ""))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(*problems)
    recordings, left_out = [], []
    swept = _sweep(opened)
    accelerometers = [t for o in opened for t in o.triples if t.sensor == "accelerometer"]
    beside_si = any(unit_of(t, NO_CLOCK).unit == "m/s^2" for t in accelerometers)
    made: list[tuple[Opened, GuessedRecording]] = []
    for one in opened:
        if what := derived(one):
            left_out.append(f"{one.place}: {what}: left out.")
            continue
        found, left = _recordings(one, swept, beside_si)
        made += [(one, recording) for recording in found]
        left_out += left
        if not found and one.temperature is None:
            left_out.append(f"{one.place}: {why_none(one)}: left out.")
    made = [(one, _beside(one, recording, made)) for one, recording in made]
    for one, recording in made:
        if better := _better(one, recording, made):
            sensor = recording.table["sensor"]
            left_out.append(
                f"{one.place}: another {sensor} at the same time as {better}: left out."
            )
        else:
            recordings.append(recording)
    temperatures = _temperatures(opened, recordings)
    recordings += temperatures
    known = {(t.table["file"], t.table.get("table")) for t in temperatures}
    left_out += [
        f"{o.place}: a temperature, which no rest goes with: left out."
        for o in opened
        if o.temperature is not None and not o.triples and (o.file, o.name) not in known
    ]
    if not recordings:
        raise InputError(*map(problem, opened))
    return Guessed(tuple(recordings), tuple(left_out), {(o.file, o.name): o.table for o in opened})


def _better(
    one: Opened, recording: GuessedRecording, made: Sequence[tuple[Opened, GuessedRecording]]
) -> str:
    """Another recording of the same sensor at the same time that is better known; "" for none."""

    def rank(pair: tuple[Opened, GuessedRecording]) -> tuple:
        sure = {g.key: CERTAINTIES.index(g.certainty) for g in pair[1].guesses}
        raw = bool(set(words_of(pair[0].name or pair[0].file)) & {"uncalibrated", "uncal"})
        at = next(k for k, other in enumerate(made) if other[1] is pair[1])
        return (sure.get("unit", 0), raw, sure.get("sensor", 0), at)

    mine = rank((one, recording))
    for other, rival in made:
        same = rival is not recording and rival.table["sensor"] == recording.table["sensor"]
        if same and other is not one and _together(one, other) and rank((other, rival)) < mine:
            return other.place
    return ""


def _together(one: Opened, other: Opened) -> bool:
    return together(one.clock, other.clock, one.file == other.file)


def _beside(
    one: Opened, recording: GuessedRecording, made: Sequence[tuple[Opened, GuessedRecording]]
) -> GuessedRecording:
    """The recording with what tables of the same time tell of it."""
    others = [r.table for other, r in made if other is not one and _together(one, other)]
    guesses = [
        kind_beside(g, recording.table["sensor"], others) if g.key == "kind" else g
        for g in recording.guesses
    ]
    return _marked({k: v for k, v in recording.table.items() if k != "guessed"}, guesses)


def _recordings(
    one: Opened, swept: float, beside_si: bool
) -> tuple[list[GuessedRecording], list[str]]:
    """The recordings of one table, and what of it is left out."""
    where = one.place
    by_sensor: dict[str, list[Triple]] = {}
    left = []
    for triple in one.triples:
        if triple.sensor:
            by_sensor.setdefault(triple.sensor, []).append(triple)
        else:
            left.append(f"{where}: {triple.shown}: which sensor this is cannot be told: left out.")
    chosen: dict[str, Triple] = {}
    units = {}
    for sensor, triples in by_sensor.items():
        rated = [(t, unit_of(t, one.clock, beside_si)) for t in triples]
        rated.sort(key=lambda pair: CERTAINTIES.index(pair[1].certainty))
        chosen[sensor], units[sensor] = rated[0]
        left += [
            f"{where}: {t.shown}: another {sensor}: left out, as a device has one of each."
            for t, _ in rated[1:]
        ]
    attitude = bool(one.quaternion)
    made = []
    for sensor in sorted(chosen, key=lambda s: chosen[s].columns[0].index):
        triple = chosen[sensor]
        kind = kind_of(sensor, chosen, one.temperature, swept, attitude)
        made.append(_declare(one, triple, kind, units[sensor]))
    if one.quaternion:
        shown = ", ".join(c.shown for c in one.quaternion)
        trajectory = any(m.table["kind"] == "trajectory" for m in made)
        found = quaternion_of(one.quaternion, chosen.get("gyroscope")) if trajectory else None
        if found:
            made.append(_reference(one, found))
        else:
            left.append(f"{where}: {shown}: an attitude, but whether its scalar stands first and "
                        "which way it turns cannot be told: left out.")  # fmt: skip
    if made or one.temperature is not None:
        left += muted(one)
    idle = [c.shown for c in one.idle]
    if idle and made:
        more = f" and {len(idle) - 12} more" if len(idle) > 12 else ""
        left.append(f"{where}: not used: {', '.join(idle[:12])}{more}.")
    return made, left


def _declare(one: Opened, triple: Triple, kind: Guess, unit: scales.Unit) -> GuessedRecording:
    columns = {axis: c.reference for axis, c in zip("xyz", triple.columns, strict=True)}
    table: dict = {"sensor": triple.sensor, "kind": kind.value, "file": one.file}
    guesses = [Guess("sensor", triple.sensor, triple.certainty, triple.reason), kind]
    named = all(c.named.axis for c in triple.columns)
    if one.name is not None:
        table["table"] = one.name
    guesses.append(Guess("columns", columns, HIGH if named else MEDIUM,
                         "by their names" if named else "three side by side, in this order"))  # fmt: skip
    if one.temperature is not None and kind.value in ("static", "thermal"):
        columns["temperature"] = one.temperature.reference
        guess, declared = _temperature_unit(one.temperature)
        guesses.append(guess)
        if declared != "degC":
            table["temperature_unit"] = declared
    table["unit"] = unit.unit
    sure = weakest(unit.certainty, triple.certainty)  # a unit hangs on the sensor
    guesses.append(Guess("unit", unit.unit, sure, unit.reason))
    if unit.scale:
        table["scale"] = dict(unit.scale)
        if triple.offset:
            table["scale"]["offset"] = triple.offset
    clock = one.clock
    if clock.column is not None:
        columns["time"] = clock.column.reference
        if clock.unit:
            table["time_unit"] = clock.unit
        guesses.append(Guess("time_unit", clock.unit or "dates", clock.certainty, clock.reason))
    elif clock.step:
        table["rate"] = clock.rate
        guesses.append(Guess("rate", clock.rate, clock.certainty, clock.reason))
    elif kind.value != "rotation":  # a free rotation needs none
        table["rate"] = 1.0
        guesses.append(Guess("rate", 1.0, UNKNOWN, clock.reason))
    table["columns"] = {
        k: columns[k] for k in ("time", "x", "y", "z", "temperature") if k in columns
    }
    return _marked(table, guesses)


def _marked(table: dict, guesses: Sequence[Guess]) -> GuessedRecording:
    doubtful = {g.key: g.certainty for g in guesses if g.certainty in (LOW, UNKNOWN)}
    if doubtful:
        table["guessed"] = doubtful
    return GuessedRecording(table, tuple(guesses))


def _reference(one: Opened, found: tuple[dict, str, Guess]) -> GuessedRecording:
    columns, sense, guess = found
    table: dict = {"sensor": "reference", "kind": "trajectory", "file": one.file}
    if one.name is not None:
        table["table"] = one.name
    if one.clock.column is not None:
        columns = {"time": one.clock.column.reference, **columns}
        if one.clock.unit:
            table["time_unit"] = one.clock.unit
    else:
        table["rate"] = one.clock.rate or 1.0
    table |= {"quaternion": sense, "columns": columns}
    return _marked(table, [guess])


# ---- temperature ----


def _sweep(opened: Sequence[Opened]) -> float:
    """Largest swing of a temperature that has a table of its own, °C."""
    alone = [o.temperature for o in opened if o.temperature is not None and not o.triples]
    return max((swing(c.values) for c in alone), default=0.0)


def _temperatures(opened: Sequence[Opened], made: Sequence[GuessedRecording]):
    """Temperature recordings in a time base of their own, for the rests they go with."""
    kinds = {m.table["kind"] for m in made} & {"static", "thermal"}
    out = []
    for one in opened:
        if one.temperature is None or one.triples or one.clock.column is None or len(kinds) != 1:
            continue
        guess, unit = _temperature_unit(one.temperature)
        table = {"sensor": "temperature", "kind": next(iter(kinds)), "file": one.file}
        if one.name is not None:
            table["table"] = one.name
        table["unit"] = unit
        if one.clock.unit:
            table["time_unit"] = one.clock.unit
        table["columns"] = {
            "time": one.clock.column.reference, "temperature": one.temperature.reference
        }  # fmt: skip
        sure = Guess("sensor", "temperature", MEDIUM, "it is named so, or drifts as one does")
        out.append(_marked(table, [sure, guess]))
    return out


def _temperature_unit(column: Column) -> tuple[Guess, str]:
    middle = float(np.nanmedian(column.values))
    if unit := column.named.unit:
        return Guess("temperature_unit", unit, HIGH, "its name gives the unit"), unit
    unit = "K" if 200 < middle < 400 else "degC"
    sure = MEDIUM if -40 < middle < 60 or unit == "K" else LOW
    return Guess("temperature_unit", unit, sure, f"it reads {middle:.4g} in the median"), unit


def device_id(text: str) -> str:
    """An id made of a file's or folder's name."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._")[:64].rstrip("-._")
    return plain if plain and plain not in ("index.html", "book") else "device"
