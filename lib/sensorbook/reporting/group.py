"""The page of all devices of a report folder: what needs attention, how they spread, and a table.

It derives from the results.json files alone. Ten thousand devices are to fit into 5 MB, so that a row
holds as little markup as HTML allows.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from sensorbook import units
from sensorbook.reporting import attitudes
from sensorbook.reporting.calibrations import (
    AXES,
    axes_of,
    calibration_estimates,
    size,
    whole,
)
from sensorbook.reporting.cameras import STATISTICS, camera_numbers
from sensorbook.reporting.chapters import ATTITUDE
from sensorbook.reporting.render import TEMPLATES, page
from sensorbook.reporting.results import overall
from sensorbook.reporting.spread import spread_of
from sensorbook.reporting.words import SYMBOLS, judged_name

LARGEST = 64 << 20  # bytes of a results.json that is read
USUAL = (
    "random_walk",
    "bias_instability",
    "rate_random_walk",
)  # always shown; others where they are judged
WHOLE = ("residual_percent", "coverage_percent", "heading_error_after_deg")  # of a magnetometer
LISTED = 50  # devices named above the table

Column = tuple[str, str]  # sensor, quantity


@dataclass
class Value:
    """A device's worst axis of one quantity, in the field's unit; `error` is of its logarithm."""

    number: float
    axis: str = ""  # or, of an attitude, the rate of its reference
    error: float = 0.0
    verdict: str | None = None
    bound: str = ""  # "≤ 0.3" where it is judged


@dataclass
class Row:
    """One device."""

    folder: str
    id: str
    name: str
    model: str = ""
    status: str = "failed"
    verdict: str | None = None
    created: str = ""
    unsolved: bool = False  # a camera of which no image is
    relative: bool = False  # soft iron of determinant 1, as the field's strength is not known
    values: dict[Column, Value] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)
    outlying: list[str] = field(default_factory=list)

    @property
    def order(self) -> tuple:
        """Failures first."""
        status = {"failed": 0, "refused": 1, "empty": 2, "complete": 2}[self.status]
        verdict = {"fail": 0, "undecided": 1, "pass": 2, None: 2}[self.verdict]
        if self.unsolved:
            status = min(status, 1)
        return (min(status * 2, verdict * 2 + 1), status, self.folder)

    @property
    def attention(self) -> bool:
        bad = self.status in ("failed", "refused") or self.verdict in ("fail", "undecided")
        return bad or self.unsolved


def group_page(root: Path) -> str:
    """The page of all devices found below a report folder; those with a failure first."""
    rows = [_row(file) for file in root.glob("*/results.json") if file.resolve() == file]
    rows.sort(key=lambda row: row.order)
    columns = _columns(rows)
    # Rows are in order of need: models come as their worst device does.
    names = dict.fromkeys(row.model for row in rows)
    models = [(model, [row for row in rows if row.model == model]) for model in names]
    spreads = [
        (model, found)
        for model, members in models
        # An attitude's error hangs on the motion and the references, which devices do not share.
        if (found := [s for c in columns if c[0] != ATTITUDE and (s := spread_of(members, c))])
    ]
    script = (TEMPLATES / "group.js").read_text(encoding="utf-8")
    attention = [row for row in rows if row.attention]
    outliers = [row for row in rows if row.outlying]
    return page(
        "group",
        summary=_summary(rows),
        attention=attention[:LISTED],
        more=len(attention) - LISTED,
        outliers=outliers[:LISTED],
        more_outliers=len(outliers) - LISTED,
        spreads=spreads,
        models=[(model, _summary(members), Markup("").join(_table_row(r, columns) for r in members))
                for model, members in models],
        kinds={sensor if sensor in ("camera", ATTITUDE) else "axes" for sensor, _ in columns},
        several=len(models) > 1 or bool(models and models[0][0]),
        columns=[(*c, _title(c), _unit(c)) for c in columns],
        count=len(rows),
        book=(root / "book" / "index.html").is_file(),
        script=Markup(script),
        hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        group_style=Markup((TEMPLATES / "group.css").read_text(encoding="utf-8")),
    )  # fmt: skip


# ---- from a results.json to a row ----


def _row(file: Path) -> Row:
    folder = file.parent.name
    try:
        if file.stat().st_size > LARGEST:
            raise ValueError
        found = json.loads(file.read_bytes())
        return _read(folder, found)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        row = Row(folder, folder, "")
        row.reasons = ["its results.json cannot be read: render it again"]
        return row


def _read(folder: str, found: dict[str, Any]) -> Row:
    device = found["device"]
    statuses = {str(chapter["status"]) for chapter in found["chapters"]}
    failed = "failed" in statuses or bool(found["problems"])
    status = "failed" if failed else "refused" if "refused" in statuses else "complete"
    row = Row(
        folder,
        str(device["id"]),
        str(device["name"] or ""),
        str(device.get("model") or ""),
        status if found["chapters"] or failed else "empty",
        overall(found["checks"]),
        str(found["created"])[:10],
    )
    if row.verdict not in SYMBOLS:
        raise ValueError
    for sensor, result in found["sensors"].items():
        for quantity in USUAL:
            _take_noise(row, str(sensor), quantity, result.get("noise", {}))
        _take_calibration(row, str(sensor), result)
        calibration = result.get("calibration")
        if isinstance(calibration, dict):
            row.relative |= calibration.get("field_known") is False
            if _finite(calibration.get("rms_check")):
                held_out = calibration["rms_check"] / _scale(str(sensor), "rms_check")
                row.values[str(sensor), "rms_check"] = Value(held_out)
        for quantity, value in camera_numbers(result).items():
            if sensor == "camera" and _finite(value):
                row.values["camera", quantity] = Value(value)
        for quantity in WHOLE:
            if _finite(value := whole(result, quantity)):
                row.values[str(sensor), quantity] = Value(value / _scale(str(sensor), quantity))
    if (error := attitudes.real_time_error(found)) is not None:
        row.values[ATTITUDE, attitudes.QUANTITY] = Value(*error)
    if row.values.get(("camera", "solved_percent"), Value(100)).number == 0:
        row.unsolved = True
        row.reasons.append("camera: none of its images is solved")
    for check in found["checks"]:
        _take_check(row, check)
    row.reasons += _reasons(row, found)
    return row


def _take_noise(row: Row, sensor: str, quantity: str, noise: dict[str, Any]) -> None:
    """The largest of the axes."""
    entries = [
        (axis, noise[axis].get(quantity)) for axis in AXES if isinstance(noise.get(axis), dict)
    ]
    known = [
        (e["value"], axis, e) for axis, e in entries if isinstance(e, dict) and _finite(e["value"])
    ]
    if known:
        value, axis, entry = max(known, key=lambda k: k[0])
        error = _error(entry["low"], entry["high"])
        row.values[sensor, quantity] = Value(value / _scale(sensor, quantity), axis, error)


def _take_calibration(row: Row, sensor: str, result: dict[str, Any]) -> None:
    """Of each quantity the largest of the axes, by size; misalignments and field only where judged."""
    for (quantity, axes), estimate in calibration_estimates(result).items():
        if quantity in ("misalignment", "field", "field_measured") or not all(
            map(_finite, estimate)
        ):
            continue
        scale = _scale(sensor, quantity)
        value, low, high = size(quantity, axes, estimate)
        known = row.values.get((sensor, quantity))
        if known is None or value / scale > known.number:
            row.values[sensor, quantity] = Value(value / scale, axes, _error(low, high))


def _take_check(row: Row, check: dict[str, Any]) -> None:
    """Of the axes' checks the one that comes out worst stands for the device."""
    sensor, quantity = str(check["sensor"]), str(check["quantity"])
    scale = _scale(sensor, quantity)
    key = (sensor, quantity)
    sign = "≤" if check["bound"] == "max" else "≥"
    bound = f"{sign} {check['limit'] / scale:.4g}"
    value = check["value"] if _finite(check["value"]) else None
    rank = {"fail": 2, "undecided": 1, "pass": 0}
    there = row.values.get(key)
    excess = -math.inf if value is None else (value if sign == "≤" else -value)
    if there is not None and there.verdict is not None:
        mine = there.number if sign == "≤" else -there.number
        if (rank[there.verdict], mine) >= (rank[check["verdict"]], excess / scale):
            return
    number = math.nan if value is None else value / scale
    axis = "" if value is None else str(check["axis"])  # no axis has a result: none is worst
    error = _error(check["low"], check["high"]) if value else 0.0
    row.values[key] = Value(number, axis, error, str(check["verdict"]), bound)


def _reasons(row: Row, found: dict[str, Any]) -> Iterable[str]:
    """Why a device needs attention, in words."""
    yield from (str(problem) for problem in found["problems"][:3])
    for (sensor, quantity), value in row.values.items():
        if value.verdict in ("fail", "undecided"):
            name, unit = judged_name(sensor, quantity), units.field_unit(sensor, quantity)[0]
            where = f" {value.axis or 'of all axes'}" if all(axes_of(quantity)) else ""
            word = "" if value.verdict == "fail" else "undecided: "
            number = "no result" if math.isnan(value.number) else digits(value.number)
            yield (f"{word}{sensor} {name[0].lower()}{name[1:]}{where} {number}, "
                   f"limit {value.bound} {unit}".removesuffix(" 1"))  # fmt: skip
    for status in ("failed", "refused"):
        for chapter in [c for c in found["chapters"] if c["status"] == status][:2]:
            reason = (str(chapter.get("reason") or "").splitlines() or [""])[0]
            yield f"{chapter['sensor']}, {chapter['title']}: {status}" + (
                f" ({reason})" if reason else ""
            )


def digits(number: float) -> str:
    """Three digits, trailing zeros kept: 0.300 is not 0.3."""
    text = f"{number:#.3g}"
    return text.rstrip(".") if "e" not in text else f"{number:.3g}"


def _error(low: Any, high: Any) -> float:
    """Standard error of the logarithm from a 95 % interval."""
    if not (_finite(low) and _finite(high)) or low <= 0 or high <= low:
        return 0.0
    return math.log(high / low) / (2 * 1.96)


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _scale(sensor: str, quantity: str) -> float:
    try:
        return units.field_unit(sensor, quantity)[1]
    except units.UnitError:
        raise ValueError from None


def _title(column: Column) -> str:
    """What stands over a column; of a camera's, which number of all its images it is."""
    if column[0] == ATTITUDE:
        return attitudes.TITLE
    statistic = STATISTICS.get(column[1], "") if column[0] == "camera" else ""
    return f"{judged_name(*column)}, {statistic}" if statistic else judged_name(*column)


def _unit(column: Column) -> str:
    if column[0] == ATTITUDE:
        return attitudes.UNIT
    return units.field_unit(*column)[0].removesuffix("1")


def _columns(rows: Sequence[Row]) -> list[Column]:
    """Every quantity that some device has, sensors and quantities in their usual order."""
    there = {key for row in rows for key in row.values}
    return [
        (sensor, quantity)
        for sensor in (*units.SENSOR_UNITS, "camera", ATTITUDE)
        for quantity in dict.fromkeys((*USUAL, *sorted(q for s, q in there if s == sensor)))
        if (sensor, quantity) in there
    ]


# ---- words and cells ----


def _summary(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Counts in words, each with the class of its colour; only what there is."""
    counted = [
        ("pass", "✓ {} pass", sum(r.verdict == "pass" for r in rows)),
        ("fail", "✗ {} fail", sum(r.verdict == "fail" for r in rows)),
        ("undecided", "? {} undecided", sum(r.verdict == "undecided" for r in rows)),
        (
            "soft",
            "{} without limits",
            sum(r.verdict is None and r.status != "failed" for r in rows),
        ),
        ("fail", "✗ {} with a failed chapter", sum(r.status == "failed" for r in rows)),
        ("undecided", "{} with refusals", sum(r.status == "refused" for r in rows)),
    ]
    return [(kind, words.format(count)) for kind, words, count in counted if count]


def _table_row(row: Row, columns: Sequence[Column]) -> Markup:
    """One row; end tags that HTML lets out are left out."""
    report = {
        "failed": "✗ failed",
        "refused": "with refusals",
        "complete": "complete",
        "empty": "–",
    }
    kind = {"failed": " class=fail", "refused": " class=undecided"}.get(row.status, "")
    verdict = "–"
    if row.verdict:
        verdict = Markup("<b class={0}>{1} {0}</b>").format(row.verdict, SYMBOLS[row.verdict])
    name = Markup(" <i>{}</i>").format(row.name) if row.name and row.name != row.id else ""
    return Markup("<tr><th scope=row><a href='{}/index.html'>{}</a>{}<td{}>{}<td>{}{}<td>{}\n").format(
        quote(row.folder), row.id, name, Markup(kind), report[row.status], verdict,
        Markup("").join(_cell(row.values.get(column)) for column in columns), row.created,
    )  # fmt: skip


def _cell(value: Value | None) -> Markup:
    if value is None:
        return Markup("<td>–")
    number = "–" if math.isnan(value.number) else digits(value.number)
    mark = f" {SYMBOLS[value.verdict]}" if value.verdict in ("fail", "undecided") else ""
    kind = Markup(f" class={value.verdict}") if mark else ""
    return Markup("<td{}>{} {}{}").format(kind, number, value.axis, mark)
