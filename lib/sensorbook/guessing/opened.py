"""One table of a file, opened: its clock, its triples and their sensors, and which of them read nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sensorbook.guessing import scales
from sensorbook.guessing.certainty import HIGH, LOW, MEDIUM, UNKNOWN
from sensorbook.guessing.clock import Clock, find_clock
from sensorbook.guessing.columns import Column, read_columns, sort_columns
from sensorbook.guessing.names import sensor_of, words_of
from sensorbook.guessing.sensors import Triple, find_sensors
from sensorbook.recordings.tables import Table, open_table

FEWEST = 100  # samples of a recording
FREE = "an acceleration without gravity, not a reading"
NO_VALUE = "three axes without a value that a sensor can read"
# Columns that tell a phone's recorder, which documents its gyroscope as rad/s without writing so.
_RECORDERS = (
    ({"gFx", "gFy", "gFz"}, "Physics Toolbox"),
    ({"time", "seconds_elapsed"}, "Sensor Logger"),
)


@dataclass
class Opened:
    """One table of one file and what its columns are.

    `told` is its name even where it is the only one; `mute` are triples that hold no readings, and
    what they hold in place of them.
    """

    file: str
    name: str | None
    told: str
    table: Table
    clock: Clock
    triples: list[Triple]
    temperature: Column | None
    quaternion: list[Column]
    idle: list[Column]
    mute: list[tuple[Triple, str]]

    @property
    def place(self) -> str:
        return self.file if self.name is None else f"{self.file}, {self.name}"


def open_one(path: Path, file: str, name: str | None, told: str) -> Opened:
    """Opens a table and finds its clock and sensors; `name` as the declaration has it."""
    table = open_table(path, file, name)
    roles = sort_columns(read_columns(table))
    clock = find_clock(roles.time, roles.counter, table.notes)
    if clock.step is None:
        unread = [c.shown for c in roles.idle if c.named.role == "time"]
        if unread:
            reason = f"{', '.join(unread)}: named like a time, but not to be read as one"
            clock = Clock(None, "", None, UNKNOWN, reason)
    if roles.temperature is not None and clock.column is not None:
        clock = _by_temperature(clock, roles.temperature)
    triples = [Triple.of(columns, clock) for columns in roles.triples]
    nothing = [(t, _nothing(t)) for t in triples]
    mute = [(t, what) for t, what in nothing if what]
    triples = [t for t, what in nothing if not what and len(t.finite) >= FEWEST]
    recorder = next((name for names, name in _RECORDERS if names <= set(table.names)), "")
    for triple in triples:
        triple.recorder = recorder
    find_sensors(triples, _sensor_told(told) or sensor_of(Path(file).stem))
    clock = _by_rotation(clock, triples)
    free = [t for t in triples if _is_free(t, clock, told or Path(file).stem)]
    mute += [(t, FREE) for t in free]
    triples = [t for t in triples if t not in free]
    used = {clock.column} if clock.column else set()
    spare = [c for c in (*roles.time, *roles.counter) if c not in used]
    idle = roles.idle + spare
    return Opened(
        file, name, told, table, clock, triples, roles.temperature, roles.quaternion, idle, mute
    )


def _nothing(triple: Triple) -> str:
    """What three axes hold that a sensor never reads throughout; "" for readings."""
    if not len(triple.finite):
        return NO_VALUE
    if len(triple.finite) < FEWEST < len(triple.values):
        return f"three axes of which {len(triple.finite)} rows are whole"
    return "" if triple.finite.any() else "three axes that read 0 throughout"


def _is_free(triple: Triple, clock: Clock, told: str) -> bool:
    """True for a specific force less gravity, as phones compute it, by the names of file and columns."""
    words = {*words_of(told), *(w for c in triple.columns for w in words_of(c.name))}
    if not (
        words & {"linear", "user"} and words & {"acceleration", "accelerometer", "acc", "accel"}
    ):
        return False
    if triple.sensor == "accelerometer":
        return unit_of(triple, clock).certainty in (LOW, UNKNOWN)
    return not triple.sensor


def swing(values: np.ndarray) -> float:
    """Between the hundredth parts at either end, which single values do not move."""
    return float(np.nanquantile(values, 0.99) - np.nanquantile(values, 0.01))


def _sensor_told(table: str) -> str:
    """The sensor that a table's name speaks of; a folder before it may speak of another."""
    return sensor_of(table) or sensor_of(table.rpartition("/")[2])


def _by_temperature(clock: Clock, temperature: Column) -> Clock:
    """Rules out a unit of time in which the temperature would race."""
    change = swing(temperature.values)
    if clock.certainty != LOW or change < 2:
        return clock
    minutes = len(temperature.values) * clock.step / 60 / 1000  # if it were 1000 times as fast
    if change / minutes < 10:
        return clock
    reason = f"{clock.reason}, where the temperature would race by {change / minutes:.0f} °C/min"
    return Clock(clock.column, clock.unit, clock.step, MEDIUM, reason)


def _by_rotation(clock: Clock, triples: Sequence[Triple]) -> Clock:
    """The rate from a gyroscope of known unit and the field it turns, where no time tells it."""
    for triple in triples:
        if clock.step or triple.sensor != "gyroscope" or triple.rotation is None:
            continue
        unit = scales.gyroscope(triple.finite, triple.unit, triple.as_rate, None, None)
        if unit.certainty not in (HIGH, MEDIUM):
            continue
        step = triple.rotation.scale / unit.si
        percent = max(1.0, 100 * triple.rotation.error / triple.rotation.scale)
        reason = (
            f"{clock.reason}; where the gyroscope reads {unit.unit}, gravity turns as it does at "
            f"{1 / step:.3g} Hz ± {percent:.0f} %"
        )
        return Clock(None, "", 1 / float(f"{1 / step:.3g}"), LOW, reason)
    return clock


def unit_of(triple: Triple, clock: Clock, beside_si: bool = False) -> scales.Unit:
    """The unit of its readings; `beside_si` as `scales.gyroscope` has it."""
    if triple.sensor == "gyroscope":
        known = clock.step if clock.certainty in (HIGH, MEDIUM) or clock.column else None
        more = triple.as_rate, triple.rotation, known
        unit = scales.gyroscope(triple.finite, triple.unit, *more, beside_si)
        if triple.recorder and not triple.unit and unit.certainty == LOW:
            told = scales.gyroscope(triple.finite, "rad/s", *more)
            if told.unit == "rad/s" and told.certainty != LOW:
                reason = told.reason.replace("the file says so", f"{triple.recorder} writes rad/s")
                return replace(told, certainty=MEDIUM, reason=reason)
        return unit
    find = scales.BY_SENSOR[triple.sensor]
    return find(triple.finite, triple.unit, triple.as_field, triple.sphere)
