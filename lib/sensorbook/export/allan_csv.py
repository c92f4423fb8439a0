"""Allan curves as a plain table: one row a sensor and cluster time, SI units."""

from __future__ import annotations

import csv
import io

from sensorbook.export.csv_table import COLUMNS, cell, provenance
from sensorbook.export.source import Entry
from sensorbook.units import SENSOR_UNITS

AXES = ("x", "y", "z")
CONVENTION = "overlapping Allan deviation; low and high bound its 95 % interval"
LIMITS = tuple(f"{axis}_{end}" for axis in AXES for end in ("low", "high"))


def render(results: Entry) -> str:
    """CSV with `sensor,tau_s,x,y,z,unit`, and the 95 % limits of each axis where they are recorded.

    To the right stand what the curves are, the device and the provenance of `COLUMNS`. Only the recorded
    curves are written; a sensor without one is left out.
    """
    sensors = results.at("sensors")
    curves = {s: c for s in SENSOR_UNITS if (c := sensors.get(s).get("allan")).value is not None}
    if not curves:
        raise sensors.wrong(
            "no sensor has an Allan curve", "record a rest and render the chapter allan"
        )
    device = results.at("device", "id").text()
    about = [cell(text) for text in (CONVENTION, device, *provenance(results))]
    limits = [n for n in LIMITS if any(c.get(n).value is not None for c in curves.values())]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["sensor", "tau_s", *AXES, "unit", *limits, COLUMNS[0], "device", *COLUMNS[1:]])
    for sensor, curve in curves.items():
        tau = [t.magnitude() for t in curve.at("tau").items()]
        columns = [_column(curve.at(axis), len(tau)) for axis in AXES]
        for name in limits:
            known = curve.get(name).value is not None
            columns.append(_column(curve.at(name), len(tau)) if known else [""] * len(tau))
        for row in zip(tau, *columns, strict=True):
            writer.writerow([sensor, *row[:4], SENSOR_UNITS[sensor], *row[4:], *about])
    return text.getvalue()


def _column(entry: Entry, length: int) -> list[float]:
    values = [value.magnitude() for value in entry.items()]
    if len(values) != length:
        raise entry.wrong(f"has {len(values)} values for {length} cluster times")
    return values
