"""The summary page of a device, which derives from files on disk alone."""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sensorbook import units
from sensorbook.notebook import duration_words
from sensorbook.reporting.attitudes import attitude_table
from sensorbook.reporting.calibration_table import calibration_table
from sensorbook.reporting.calibrations import AXES, CALIBRATED
from sensorbook.reporting.cameras import camera_table, cameras_alone
from sensorbook.reporting.chapters import CHAPTERS
from sensorbook.reporting.render import page
from sensorbook.reporting.results import overall
from sensorbook.reporting.words import (
    NAMES,
    SYMBOLS,
    bounds,
    check_words,
    interval,
    judged_name,
    quantity_name,
    why_none,
)

_LINES = 6  # checks told in the banner
THUMBNAIL_WIDTH = 560  # pixels; shown at half of it

ALWAYS = ("random_walk", "noise_density", "bias_instability", "rate_random_walk")


def device_page(
    found: dict[str, Any],
    folder: Path,
    left_out: Sequence[str] = (),
    earlier: bool = False,
    lacking: str = "",
) -> str:
    """The index of one device, from its results.json; `folder` holds its chapters' notebooks.

    `left_out` names the chapters that its recordings feed, where `--only` left all of them out.
    `earlier` is true where the results are of an earlier run, as the device cannot be read now.
    `lacking` is what a recording lacks to feed a chapter.
    """
    judged = {check["sensor"] for check in found["checks"]}
    # What is judged comes first.
    ordered = sorted(found["sensors"].items(), key=lambda item: item[0] not in judged)
    sensors = [
        {
            "name": sensor,
            "noise": _noise_rows(sensor, result, found["checks"]),
            "thermal": _thermal_rows(sensor, result.get("thermal", {})),
            "calibration": calibration_table(sensor, result, found["checks"]),
            "camera": camera_table(result),
        }
        for sensor, result in ordered
    ]
    names = dict.fromkeys(
        (*(s for s, _ in ordered), *(chapter["sensor"] for chapter in found["chapters"]))
    )
    other = [check for check in found["checks"] if check["sensor"] not in found["sensors"]]
    return page(
        "device",
        found=found,
        banner=_banner(found) if found["chapters"] or found["checks"] else None,
        left_out=left_out,
        lacking=lacking,
        earlier=earlier,
        doubtful=_doubtful(found.get("guesses", [])),
        chapters=[
            (
                sensor,
                [_chapter_card(c, folder) for c in found["chapters"] if c["sensor"] == sensor],
            )
            for sensor in names
        ],
        warnings=[
            (sensor, listed)
            for sensor in names
            if (listed := [_warning(w) for w in found["warnings"] if w["sensor"] == sensor])
        ],
        sensors=sensors,
        attitude=attitude_table(found),
        unjudged=sorted(
            {(check["sensor"], judged_name(check["sensor"], check["quantity"])) for check in other}
        ),
        inputs=[_input_row(recording) for recording in found["inputs"]],
    )


def _warning(warning: dict[str, str]) -> dict[str, str]:
    """A warning without the sensor's name at its head, under which it is listed."""
    message = warning["message"].removeprefix(warning["sensor"]).lstrip(":, ")
    return {"file": warning["file"], "message": _capital(message)}


def _chapter_card(chapter: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A chapter with its first figure, and the titles of the chapters whose records it read."""
    titles = {c.slug: c.title for c in CHAPTERS}
    read = [
        titles[key.removesuffix("_record")].lower()
        for key, value in chapter.get("parameters", {}).items()
        if value and key.removesuffix("_record") in titles
    ]
    return chapter | {"thumbnail": thumbnail(folder / chapter["notebook"]), "after": read}


def _doubtful(guesses: list[dict[str, str]]) -> list[str]:
    """What of a bare recording was guessed with little certainty or not at all, in words."""
    words = {"low": "of low certainty", "not known": "not known"}
    listed: dict[str, list[str]] = {}
    for guess in guesses:
        if guess["confidence"] in words:
            what = f"{guess['sensor']} {guess['key'].replace('_', ' ')}"
            listed.setdefault(words[guess["confidence"]], []).append(what)
    return [f"{certainty}: {', '.join(dict.fromkeys(what))}" for certainty, what in listed.items()]


def _banner(found: dict[str, Any]) -> dict[str, Any]:
    """The verdict in words, with the checks that kept it from being a pass, or the closest one."""
    checks = found["checks"]
    verdict = overall(checks)
    count = {kind: sum(c["verdict"] == kind for c in checks) for kind in ("fail", "undecided")}
    lines = [
        _capital(check_words(check, found))
        for kind in ("fail", "undecided")
        for check in checks
        if check["verdict"] == kind and (check["high"] is not None or check.get("doubt"))
    ] + _without_result(found)
    more = len(lines) - _LINES
    lines = lines[:_LINES] + ([f"And {more} more, in the tables below."] if more > 0 else [])
    if verdict == "pass":
        lines = [f"Closest to its limit: {check_words(max(checks, key=_nearness), found)}"]
    words = {
        None: "A camera is judged against no limits"
        + (": what its images gave stands below." if found["sensors"] else ".")
        if cameras_alone(found)
        else "No limits given: a [spec] table in device.toml has the device judged against it.",
        "pass": f"✓ Within its limits: all {len(checks)} checks passed.",
        "fail": f"✗ Outside its limits: {count['fail']} of {len(checks)} checks failed.",
        "undecided": f"? Not decided: {count['undecided']} of {len(checks)} checks"
        " cannot be decided.",
    }[verdict]
    return {"kind": verdict or "", "words": words, "lines": lines}


def _without_result(found: dict[str, Any]) -> list[str]:
    """A line for all limits of a sensor that have no result for the same reason."""
    names: dict[tuple[str, str], list[str]] = {}
    for check in found["checks"]:
        if check["high"] is None and not check.get("doubt"):
            name = judged_name(check["sensor"], check["quantity"])
            reason = why_none(check, found)
            names.setdefault((check["sensor"], reason), []).append(f"{name[0].lower()}{name[1:]}")
    return [
        f"{_capital(sensor)} {', '.join(dict.fromkeys(listed))}: no result: undecided — {reason}"
        for (sensor, reason), listed in names.items()
    ]


def _nearness(check: dict[str, Any]) -> float:
    """How much of a limit is used up, 1 at the limit."""
    value, limit = check["value"] or 0.0, check["limit"]
    if check["bound"] == "min":
        value, limit = limit, value
    return value / limit if limit > 0 else -math.inf


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _noise_rows(
    sensor: str, result: dict[str, Any], checks: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """A row a quantity: those always shown, those that are visible, and those with a limit."""
    noise = result.get("noise", {})
    mine = [check for check in checks if check["sensor"] == sensor]
    # Those of a calibration stand in its own table.
    limited = dict.fromkeys(c["quantity"] for c in mine if c["quantity"] not in CALIBRATED)
    axes = [noise.get(axis, {}) for axis in AXES] if "x" in noise else []
    shown = [q for q in NAMES if axes and (q in ALWAYS or any(axis.get(q) for axis in axes))]
    wanted = (*shown, *(quantity for quantity in limited if quantity not in shown))
    rows = []
    for quantity in wanted:
        label, scale = units.field_unit(sensor, quantity)
        cells = []
        for axis in AXES:
            verdicts = [c for c in mine if c["quantity"] == quantity and c["axis"] == axis]
            cell = _cell(
                noise.get(axis, {}), result.get("thermal", {}).get(axis, {}), quantity, scale
            )
            cell["verdict"] = overall(verdicts)
            cell["symbol"] = SYMBOLS[cell["verdict"]]
            cells.append(cell)
        rows.append(
            {
                "name": quantity_name(sensor, quantity),
                "unit": label,
                "cells": cells,
                "limit": bounds((c for c in mine if c["quantity"] == quantity), scale),
            }
        )
    return rows + _gauss_markov_rows(sensor, axes)


def _gauss_markov_rows(sensor: str, axes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Two rows where an axis has such a process beside its terms; no limit applies to them."""
    found = [axis.get("gauss_markov", {}) for axis in axes]
    if not any(found):
        return []
    parts = (
        ("std", "std", *units.field_unit(sensor, "bias_instability")),
        ("correlation_time", "correlation time", "s", 1.0),
    )
    return [
        {
            "name": f"Gauss–Markov {name}",
            "unit": label,
            "cells": [_cell(of, {}, part, scale) | {"verdict": None, "symbol": ""} for of in found],
            "limit": "",
        }
        for part, name, label, scale in parts
    ]


def _cell(noise: dict, thermal: dict, quantity: str, scale: float) -> dict[str, Any]:
    """One axis of one quantity in field units, as text."""
    entry = noise.get(quantity, thermal.get(quantity))
    if isinstance(entry, dict):
        value, low, high = interval(
            entry["value"] / scale, entry["low"] / scale, entry["high"] / scale
        )
        return {"value": value, "interval": f"{low} … {high}"}
    if isinstance(entry, int | float):
        return {"value": f"{entry / scale:.3g}", "interval": ""}
    bound = noise.get("upper_bounds", {}).get(quantity)
    if quantity in noise:
        note = "" if bound is None else f"below {bound / scale:.2g}"
        return {"value": "no visible effect", "interval": note}
    return {"value": "–", "interval": ""}


def _thermal_rows(sensor: str, thermal: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for axis in AXES:
        if not isinstance(found := thermal.get(axis), dict):
            continue
        label, scale = units.field_unit(sensor, "rms_before")
        low, high = found["range"]
        if jump := found.get("jump"):
            model = f"jump at {jump['range'][0]:.1f} … {jump['range'][1]:.1f} °C"
        elif found.get("degree") == 0:
            model = "none that predicts"
        else:
            model = found["model"] + (f", degree {found['degree']}" if "degree" in found else "")
        check = found.get("rms_check")
        rows.append(
            {
                "axis": axis,
                "model": model,
                "range": f"{low:.1f} … {high:.1f} °C",
                "before": f"{found['rms_before'] / scale:.3g}",
                "after": f"{found['rms_after'] / scale:.3g}",
                "check": "–" if check is None else f"{check / scale:.3g}",
                "unit": label,
            }
        )
    return rows


def _input_row(recording: dict[str, Any]) -> dict[str, str]:
    duration, rate = recording["duration_s"], recording["rate_hz"]
    samples = f"{recording['samples']:,}".replace(",", "\u202f")
    images = recording["kind"] == "images"
    unknown = "–" if images else "unknown"
    return {
        "file": f"{recording['file']}, {recording['table']}"
        if "table" in recording
        else recording["file"],
        "sensor": recording["sensor"],
        "kind": recording["kind"],
        "duration": unknown if duration is None else duration_words(duration),
        "rate": unknown if rate is None else f"{rate:.6g} Hz",
        "samples": f"{samples} image{'' if samples == '1' else 's'}" if images else samples,
        "gaps": str(recording["gaps"]),
        "sha256": recording["sha256"],
        "unit": str(recording.get("unit", "")),
    }


def thumbnail(notebook: Path) -> dict[str, str] | None:
    """The first figure meant for the index, scaled down: `source` and `alt` of an image."""
    try:
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    except (OSError, ValueError, KeyError):
        return None
    for cell in cells:
        for output in cell.get("outputs", ()):
            about = output.get("metadata", {}).get("image/png", {})
            if about.get("thumbnail"):
                from PIL import Image

                png = output["data"]["image/png"]
                image = Image.open(io.BytesIO(base64.b64decode("".join(png)))).convert("RGB")
                image.thumbnail((THUMBNAIL_WIDTH, THUMBNAIL_WIDTH), Image.Resampling.LANCZOS)
                buffer = io.BytesIO()
                image = image.quantize(128, Image.Quantize.FASTOCTREE)
                image.save(buffer, format="png")
                coded = base64.b64encode(buffer.getvalue()).decode()
                return {"source": f"data:image/png;base64,{coded}", "alt": about.get("alt", "")}
    return None
