"""A calibration as a table of the device page, with a line on how it was found and what it leaves."""

from __future__ import annotations

from typing import Any

from sensorbook import units
from sensorbook.reporting.calibrations import (
    CALIBRATED,
    JUDGED_BY,
    WHOLE,
    calibration_estimates,
    concerns,
    whole,
)
from sensorbook.reporting.results import overall, own_verdict
from sensorbook.reporting.words import SYMBOLS, bounds, interval, quantity_name

METHODS = {
    "six_position": "six positions",
    "recursive": "six positions, recursive",
    "multi_position": "many positions",
    "rest_to_rest": "turned from rest to rest",
    "ellipsoid": "full ellipsoid",
    "diagonal": "hard iron and one scale factor an axis",
    "hard_iron": "hard iron only",
}
_BEFORE = {  # what a number was before the calibration
    "residual_percent": "residual_percent_before",
    "heading_error_after_deg": "heading_error_before_deg",
}


def calibration_table(
    sensor: str, result: dict[str, Any], checks: list[dict[str, Any]]
) -> dict[str, Any] | None:
    """Caption and rows; None where there is neither a calibration nor a limit for one.

    A quantity has a row of three cells, more rows for more than three numbers, or one cell for the
    sensor as a whole (axis ""). Refused, only what has a limit has a row.
    """
    calibration = result.get("calibration")
    mine = [c for c in checks if c["sensor"] == sensor and c["quantity"] in CALIBRATED]
    if not calibration and not mine:
        return None
    rows = []
    for quantity in CALIBRATED:
        if quantity in JUDGED_BY:
            continue
        own = [c for c in mine if JUDGED_BY.get(c["quantity"], c["quantity"]) == quantity]
        cells = _cells(sensor, quantity, result, own)
        if not cells:
            continue
        unit, scale = units.field_unit(sensor, quantity)
        limit = bounds(own, scale, 6)
        if limit and quantity == "soft_iron":
            limit += " off identity"
        for k in range(0, len(cells), 3):
            part = cells[k : k + 3]
            part += [None] * (3 - len(part) if part[0]["axis"] else 0)
            rows.append({"name": quantity_name(sensor, quantity), "unit": unit, "cells": part,
                         "limit": limit})  # fmt: skip
    return {"rows": rows, "caption": _caption(sensor, calibration)}


def _cells(
    sensor: str, quantity: str, result: dict[str, Any], checks: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """The numbers of one quantity as text, in field units; "–" where only a limit is known."""
    if not checks and quantity not in units.quantities(sensor):
        return []
    scale = units.field_unit(sensor, quantity)[1]
    cells = []
    for (name, axes), numbers in calibration_estimates(result).items():
        if name == quantity:
            value, low, high = interval(*(n / scale for n in numbers))
            # Of several numbers of an axis a check judges the worst.
            own = [
                c | {"verdict": own_verdict(axes, numbers, c)} if axes else c
                for c in checks
                if concerns(quantity, axes, c["axis"])
            ]
            cells.append(_cell(axes, value, f"{low} … {high}", own))
    # The residual is the one held out, which has no other row unless it has its own limit.
    if quantity in WHOLE and (quantity != "residual_percent_check" or checks):
        value = whole(result, quantity)
        before = result.get("calibration", {}).get(_BEFORE.get(quantity, ""))
        if value is not None:
            note = "" if before is None else f"{before / scale:.3g} as recorded"
            aligned = result["calibration"].get("heading_error_aligned_deg")
            if quantity == "heading_error_after_deg" and aligned is not None:
                note += f", {aligned:.2g} aligned"
            cells.append(_cell("", f"{value / scale:.3g}", note, checks))
    if not cells:
        for axis in dict.fromkeys(c["axis"] for c in checks):
            cells.append(_cell(axis, "–", "", [c for c in checks if c["axis"] == axis]))
    return cells


def _cell(axis: str, value: str, note: str, checks: list[dict[str, Any]]) -> dict[str, Any]:
    verdict = overall(checks)
    return {"axis": axis, "value": value, "interval": note, "verdict": verdict,
            "symbol": SYMBOLS[verdict]}  # fmt: skip


def _caption(sensor: str, calibration: dict[str, Any] | None) -> str:
    if not calibration:
        return "No calibration: no recording gives one."
    if calibration["method"] is None:
        return f"Calibration refused: {calibration['reason'].splitlines()[0]}"
    method = METHODS.get(calibration["method"], calibration["method"])
    left = _magnetometer if sensor == "magnetometer" else _inertial
    return f"Calibration, with 95 % intervals: {method}, {left(sensor, calibration)}"


def _inertial(sensor: str, calibration: dict[str, Any]) -> str:
    """What it rests on, and the error before, after and held out."""
    c = calibration
    count = f"{c['motions']} motions" if "motions" in c else f"{c.get('positions', 0)} rests"
    scale, unit, what = 1e-3, "mm/s²", "length of gravity"
    keys = ("rms_before", "rms_after", "rms_check")
    if sensor == "gyroscope":
        scale, unit, what = 1.0, "°", "direction after a turn"
        keys = tuple(f"direction_error_{k}_deg" for k in ("before", "after", "check"))
    before, after, held = (_number(c.get(key), scale) for key in keys)
    return (
        f"{count}; {what} errs by {before} {unit} rms as recorded, {after} fitted, {held} held out"
    )


def _magnetometer(sensor: str, calibration: dict[str, Any]) -> str:
    c = calibration
    before, after, held = (
        _number(c.get(f"residual_percent{part}")) for part in ("_before", "", "_check")
    )
    words = (f"{c.get('readings', 0)} readings; field strength errs by {before} % rms as recorded, "
             f"{after} fitted, {held} held out")  # fmt: skip
    if alignment := c.get("alignment"):
        stages = (
            _number(alignment.get(f"dip_spread_{stage}_deg"))
            for stage in ("before", "calibrated", "after")
        )
        words += "; dip angle scatters by {}° as recorded, {} calibrated, {} aligned".format(
            *stages
        )
    if c.get("field_known") is False:
        words += (
            "; the field's strength there is not known, so that the soft iron has determinant 1"
        )
    return words


def _number(value: float | None, scale: float = 1.0) -> str:
    return "–" if value is None else f"{value / scale:.3g}"
