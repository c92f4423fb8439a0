"""The gate of a production line: what keeps a device from passing, in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sensorbook.reporting.index import interval, quantity_name, quantity_unit


def gate(found: dict[str, Any]) -> Iterator[str]:
    """A line for each limit of a results.json that is failed or cannot be decided; none to pass.

    A device without limits does not pass: a gate that checks nothing would let everything through.
    """
    name = found["device"]["id"]
    if not found["checks"]:
        yield f"{name}: cannot be decided: no limits given — add a [spec] table to its device.toml"
    for check in found["checks"]:
        if check["verdict"] != "pass":
            yield f"{name}: {check_words(check, found)}"


def check_words(check: dict[str, Any], found: dict[str, Any]) -> str:
    """A check in words, in field units: what was measured, the limit, the verdict and what follows."""
    sensor, quantity, axis = check["sensor"], check["quantity"], check["axis"]
    unit, scale = quantity_unit(sensor, quantity)
    name = quantity_name(sensor, quantity)
    sign = "≤" if check["bound"] == "max" else "≥"
    limit = f"limit {sign} {check['limit'] / scale:.4g} {unit}"
    what = f"{sensor} {name[0].lower()}{name[1:]} {axis}"
    low, high = check["low"], check["high"]
    if check["value"] is not None and low is not None and high is not None:
        value, below, above = interval(check["value"] / scale, low / scale, high / scale)
        measured = value if low == high else f"{value} ({below} … {above})"
    elif high is not None:
        measured = f"no visible effect, below {high / scale:.2g}"
    else:
        measured = "no result"
    words = f"{what}: {measured}, {limit}: {check['verdict']}"
    if check["verdict"] != "undecided":
        return words
    if high is None:
        return f"{words} — {_why_none(sensor, found)}"
    return f"{words}, as its 95 % interval straddles the limit — record longer, which narrows it"


def _why_none(sensor: str, found: dict[str, Any]) -> str:
    """Why there is no result of a sensor."""
    for chapter in found["chapters"]:
        if (
            chapter["sensor"] == sensor
            and chapter["status"] in ("refused", "failed")
            and chapter["reason"]
        ):
            reason = chapter["reason"].splitlines()[0]
            return f"{chapter['title'].lower()} {chapter['status']}: {reason}"
    return "no recording gives it: add one, or take the limit out of [spec]"
