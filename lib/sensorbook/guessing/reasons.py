"""Why a table holds no recording, in words, and what to do about it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sensorbook.errors import Problem
from sensorbook.guessing.names import words_of
from sensorbook.guessing.opened import FEWEST, FREE, Opened
from sensorbook.guessing.sensors import Triple

# PX4's topics that stand beside those of the sensors themselves.
_FILTERED = {"vehicle_angular_velocity", "vehicle_acceleration", "vehicle_magnetometer"}

_NAME = "name its columns in a header, such as t, gx, gy, gz, ax, ay, az, or write device.toml"
_ON = "record again with that sensor on"
_OWN = "record the sensor's own readings, or write device.toml where these are"


def derived(one: Opened) -> str:
    """What a phone or an autopilot computes of its sensors, by the name of a table; "" for readings."""
    if "gravity" in words_of(one.told or Path(one.file).stem):
        return "gravity as it is computed, not a reading"
    if one.told.partition(":")[0] in _FILTERED:
        return "what PX4 has corrected and filtered in flight, not a reading"
    return ""


def problem(one: Opened) -> Problem:
    """The one line on a table that holds no recording."""
    return Problem(one.file, one.name or "", *_why_and_mend(one))


def why_none(one: Opened) -> str:
    """Why a table holds no recording: "holds …"."""
    return _why_and_mend(one)[0]


def muted(one: Opened) -> list[str]:
    """Sentences on the triples of a table that hold no readings."""
    return [
        f"{one.place}: {triple.shown}: {what}{_because(one, triple)}: left out."
        for triple, what in one.mute
    ]


def _because(one: Opened, triple: Triple) -> str:
    """What the format says of values that are missing throughout."""
    absent = any(np.isnan(column.values).all() for column in triple.columns)
    return f" – {one.table.missing}" if absent and one.table.missing else ""


def _why_and_mend(one: Opened) -> tuple[str, str]:
    if what := derived(one):
        return f"holds {what}", _OWN
    rows = len(one.table.column(0)) if one.table.names else 0
    if rows < FEWEST:
        return (
            f"holds {rows} row{'s' * (rows != 1)}, too few for a recording",
            f"record {FEWEST} or more",
        )
    if one.mute and not one.triples:
        what = one.mute[0][1]
        shown = ", ".join(triple.shown for triple, other in one.mute if other == what)
        return (
            f"holds {what} ({shown}){_because(one, one.mute[0][0])}",
            _OWN if what == FREE else _ON,
        )
    words = {w for c in (*one.idle, *one.quaternion) for w in words_of(c.name)}
    if "delta" in words and words & {"angle", "velocity"} and not one.triples:
        what = "increments of angle and velocity, which are no rates, and no sensor's readings"
        return f"holds {what}", _OWN
    if words & {"latitude", "lat"} and words & {"longitude", "lon", "lng"}:
        what = "a satellite receiver's places, which may stand under [site], and no sensor"
        return f"holds {what}", "name a recording of a sensor"
    if not one.triples:
        columns = f"{len(one.table.names)} columns in all"
        return f"holds no three columns of a sensor ({columns})", _NAME
    return "holds readings of which neither names nor values tell the sensor", _NAME
