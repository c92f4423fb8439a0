"""results.json of a device: assembled from the chapters' records on disk, and nothing else."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from sensorbook import units
from sensorbook.reporting import chapters
from sensorbook.reporting.attitudes import QUANTITY, mean_errors, spreadsheet_words
from sensorbook.reporting.calibrations import (
    AXES,
    CALIBRATED,
    Estimate,
    axes_of,
    calibration_estimates,
    judged,
    size,
    without_interval,
)
from sensorbook.reporting.cameras import camera_numbers

SCHEMA = Path(__file__).with_name("results.schema.json")


def dumps(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def sensors() -> tuple[str, ...]:
    """Every sensor that some chapter is for, `chapters.ATTITUDE` among them."""
    return tuple(dict.fromkeys(s for chapter in chapters.CHAPTERS for s in chapter.sensors))


def read_records(folder: Path) -> list[dict[str, Any]]:
    """The chapters found in a device's report folder, by sensor in reading order.

    A failed chapter has no record; what is known of it stands in its notebook's metadata.
    """
    found = []
    for sensor in sensors():
        if (folder / sensor).is_symlink():
            continue
        for chapter in chapters.CHAPTERS:
            record_file = folder / sensor / f"{chapter.slug}.json"
            notebook = record_file.with_suffix(".ipynb")
            named = {"chapter": chapter.slug, "title": chapter.title, "sensor": sensor}
            if record_file.is_file():
                found.append({**json.loads(record_file.read_text(encoding="utf-8")), **named})
            elif notebook.is_file():
                about = json.loads(notebook.read_text(encoding="utf-8"))["metadata"]
                reason = about.get("sensorbook", {}).get("reason") or "it did not end"
                found.append({**named, "status": "failed", "reason": reason})
    return found


def outdated(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The records of files that a later record found changed: numbers of what is no longer there."""
    latest: dict[str, tuple[str, str]] = {}  # file: when read, and its hash then
    for record in records:
        for entry in record.get("inputs", ()):
            read = (str(record.get("created", "")), entry["sha256"])
            latest[entry["file"]] = max(latest.get(entry["file"], ("", "")), read)
    return [
        record
        for record in records
        if any(entry["sha256"] != latest[entry["file"]][1] for entry in record.get("inputs", ()))
    ]


def assemble(
    device: dict[str, Any],
    software: dict[str, str],
    created: str,
    records: list[dict[str, Any]],
    problems: tuple[str, ...] = (),
) -> dict[str, Any]:
    """results.json.

    Parameters
    ----------
    device : id, name, model, serial and spec (limits by sensor)
    software, created : of this report
    records : as `read_records` gives them
    problems : what keeps the device as a whole from being read
    """
    result_of = {chapter.slug: chapter.result for chapter in chapters.CHAPTERS}
    found: dict[str, dict] = {}
    attitude: dict[str, Any] = {}
    inputs: list[dict] = []
    warnings: list[dict] = []
    listed = []
    for record in records:
        sensor, slug, status = record["sensor"], record["chapter"], record["status"]
        if sensor == chapters.ATTITUDE:
            if status == "complete":
                attitude = record["results"]
            elif status == "refused":
                attitude = {"reason": record["reason"]}
        elif status == "complete":
            merge(found.setdefault(sensor, {}), record["results"])
        elif status == "refused":
            reason = {"reason": record["reason"]}
            if result_of[slug] == "calibration":
                reason = {"method": None} | reason
            # What another chapter could determine stands.
            found.setdefault(sensor, {}).setdefault(result_of[slug], reason)
        inputs += [i for i in record.get("inputs", ()) if i not in inputs]
        about = {"sensor": sensor, "chapter": slug}
        told = [(w["file"], w["message"]) for w in warnings]
        for warning in record.get("warnings", ()):
            # What a recording shows is told once, whichever chapter read it.
            if not warning["file"] or (warning["file"], warning["message"]) not in told:
                warnings.append({**warning, **about})
        listed.append(
            {
                "sensor": sensor,
                "chapter": slug,
                "title": record["title"],
                "status": status,
                "reason": record["reason"],
                "page": None if status == "failed" else f"{sensor}/{slug}.html",
                "notebook": f"{sensor}/{slug}.ipynb",
                "parameters": record.get("parameters", {}),
            }
        )
    return {
        "schema": 1,
        "device": {key: device[key] for key in ("id", "name", "model", "serial")},
        "software": software,
        "created": created,
        "inputs": inputs,
        "sensors": found,
        **({"attitude": attitude} if attitude else {}),
        "checks": [
            _doubted(check, inputs)
            for sensor, limits in device["spec"].items()
            for check in checks(sensor, limits, found.get(sensor, {}))
        ],
        "warnings": warnings,
        "chapters": listed,
        "problems": list(problems),
        "guesses": device.get("guesses", []),
    }


COLUMNS = ("device", "sensor", "axis", "quantity", "method", "value", "low", "high", "unit",
           "field_value", "field_low", "field_high", "field_unit")  # fmt: skip


def csv_text(found: dict[str, Any]) -> str:
    """The numbers of a results.json as a table, one a row, in SI units and in the field's.

    Every cell is a number or a word of ours, so that no spreadsheet takes one for a formula.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for sensor, result in found["sensors"].items():
        stated = {"": result.get("noise", {}), **result.get("noise_methods", {})}
        stated["thermal"] = result.get("thermal", {})
        for (quantity, axis), (value, low, high) in calibration_estimates(result).items():
            entry = {"value": value, "low": low, "high": high}
            method = result["calibration"]["method"]
            row = (found["device"]["id"], sensor, axis, quantity, method)
            writer.writerow((*row, *_csv_row(sensor, quantity, entry)))
        for quantity, value in without_interval(result).items():
            row = (found["device"]["id"], sensor, "", quantity, result["calibration"]["method"])
            writer.writerow((*row, *_csv_row(sensor, quantity, value)))
        for quantity, value in camera_numbers(result).items():
            unit = (units.si_unit(sensor, quantity), units.field_unit(sensor, quantity)[0])
            row = (found["device"]["id"], sensor, "", quantity, "", value, "", "", unit[0])
            writer.writerow((*row, f"{value:.7g}", "", "", unit[1]))
        for method, by_axis in stated.items():
            for axis in AXES:
                entries = by_axis.get(axis) if isinstance(by_axis, dict) else None
                for quantity, entry in _with_bounds(entries or {}):
                    if quantity in units.quantities(sensor) and (
                        row := _csv_row(sensor, quantity, entry)
                    ):
                        writer.writerow(
                            (found["device"]["id"], sensor, axis, quantity, method, *row)
                        )
    for method, rate, error in mean_errors(found):
        if error is not None and (words := spreadsheet_words(method, rate)):
            row = (found["device"]["id"], chapters.ATTITUDE, "", QUANTITY, words)
            writer.writerow((*row, *_csv_row(chapters.ATTITUDE, QUANTITY, error)))
    return text.getvalue()


def _with_bounds(entries: dict[str, Any]):
    """The numbers of an axis; a term without visible effect as the interval up to its bound."""
    bounds = entries.get("upper_bounds") or {}
    for quantity, entry in entries.items():
        if entry is None and bounds.get(quantity) is not None:
            entry = {"value": None, "low": 0.0, "high": bounds[quantity]}
        yield quantity, entry


def _csv_row(sensor: str, quantity: str, entry: Any) -> tuple | None:
    """Value, low, high and unit of one number, twice; None for what is none."""
    if isinstance(entry, dict):
        numbers = tuple(entry.get(key) for key in ("value", "low", "high"))
    else:
        numbers = (entry, None, None)
    stated = numbers[0] if numbers[0] is not None else numbers[2]
    if isinstance(stated, bool) or not isinstance(stated, int | float):
        return None
    if quantity.endswith("_deg"):
        si, label, scale = "deg", "°", 1.0
    elif "_percent" in quantity:
        si, label, scale = "percent", "%", 1.0
    else:
        si, (label, scale) = units.si_unit(sensor, quantity), units.field_unit(sensor, quantity)
    in_field = ("" if n is None else f"{n / scale:.7g}" for n in numbers)
    return (
        *("" if n is None else n for n in numbers),
        si,
        *in_field,
        label,
    )


def _doubted(check: dict[str, Any], inputs: list[dict[str, Any]]) -> dict[str, Any]:
    """A check, undecided where it hangs on a declaration that is a guess."""
    guessed = [
        key.replace("_", " ")
        for entry in inputs
        if entry["sensor"] == check["sensor"]
        for key in entry.get("guessed", {})
    ]
    if not guessed or check["verdict"] == "undecided":
        return check
    doubt = f"the {' and the '.join(dict.fromkeys(guessed))} of the {check['sensor']} is a guess"
    return check | {"verdict": "undecided", "doubt": doubt}


def merge(into: dict[str, Any], results: dict[str, Any]) -> None:
    """Adds a chapter's results; what several chapters state by method stands side by side."""
    for key, value in results.items():
        if key.endswith("_methods"):
            into.setdefault(key, {}).update(value)
        else:
            into[key] = value


def own_verdict(axes: str, estimate: Estimate, check: dict[str, Any]) -> str:
    """The verdict on one number of a calibration, where a check is of the worst of its axis."""
    if check.get("doubt"):
        return "undecided"
    _, low, high = size(check["quantity"], axes, estimate)
    return _verdict(low, high, check["bound"], check["limit"])


def checks(sensor: str, limits: dict[str, dict], result: dict[str, Any]) -> list[dict[str, Any]]:
    """Every limit of [spec.<sensor>] beside the result it is for, an axis a row, in SI units.

    A quantity of the sensor as a whole has one row, of the axis "".
    """
    rows = []
    for quantity, limit in limits.items():
        si_unit = units.si_unit(sensor, quantity)
        factor = units.factor(limit.get("unit", si_unit), si_unit)
        for bound in ("max", "min"):
            if bound not in limit:
                continue
            si_limit = limit[bound] * factor
            for axis in axes_of(quantity):
                value, low, high = _estimate(result, axis, quantity)
                if quantity == "misalignment" and high is None and calibration_estimates(result):
                    continue  # of a triangular matrix the first axis has none
                rows.append(
                    {
                        "sensor": sensor,
                        "axis": axis,
                        "quantity": quantity,
                        "value": value,
                        "low": low,
                        "high": high,
                        "bound": bound,
                        "limit": si_limit,
                        "unit": si_unit,
                        "verdict": _verdict(low, high, bound, si_limit),
                    }
                )
    return rows


def overall(found_checks: list[dict[str, Any]]) -> str | None:
    """The verdict on a device: `fail` before `undecided` before `pass`; None without limits."""
    verdicts = {check["verdict"] for check in found_checks}
    return next((v for v in ("fail", "undecided", "pass") if v in verdicts), None)


def _estimate(
    result: dict[str, Any], axis: str, quantity: str
) -> tuple[float | None, float | None, float | None]:
    """Value and 95 % interval of one quantity; None where unknown.

    A term without visible effect lies between zero and its upper bound.
    """
    for part in ("noise", "thermal"):
        entry = result.get(part, {}).get(axis, {})
        found = entry.get(quantity)
        if isinstance(found, dict):
            return found["value"], found["low"], found["high"]
        if isinstance(found, int | float):
            return found, found, found
        upper = entry.get("upper_bounds", {}).get(quantity)
        if upper is not None:
            return None, 0.0, upper
    return judged(result, axis, quantity) if quantity in CALIBRATED else (None, None, None)


def _verdict(low: float | None, high: float | None, bound: str, limit: float) -> str:
    """Decided only where the whole interval lies on one side of the limit."""
    below = high is not None and high <= limit
    above = low is not None and low >= limit
    if bound == "max":
        good, bad = below, above and low > limit
    else:
        good, bad = above, below and high < limit
    return "pass" if good else "fail" if bad else "undecided"
