"""Numbers, limits and verdicts in words, for every page and file that tells them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from sensorbook import units
from sensorbook.reporting.calibrations import CALIBRATED, JUDGED_BY
from sensorbook.reporting.chapters import CHAPTERS

# As the field calls them; the random walk's name depends on what is integrated.
NAMES = {
    "quantization": "Quantization Q",
    "random_walk": "Random walk N",
    "noise_density": "Noise density √2·N",
    "bias_instability": "Bias instability B",
    "rate_random_walk": "Rate random walk K",
    "rate_ramp": "Rate ramp R",
    "rms_before": "Residual before the thermal model",
    "rms_after": "Residual after the thermal model",
    "rms_check": "Residual held out",
    "field": "Field strength",
    "field_measured": "Field strength as read",
    "residual_percent": "Residual of field strength",
    "residual_percent_check": "Residual held out",
    "coverage_percent": "Coverage of directions",
    "heading_error_after_deg": "Heading error, corrected",
    "solved_percent": "Images solved",
    "earth_direction_std_deg": "Earth's direction, standard error per axis",
    "attitude_std_deg": "Attitude, standard error of all axes",
    "attitude_error_deg": "Attitude, error",
}
SENSOR_NAMES = {
    ("gyroscope", "random_walk"): "Angle random walk N",
    ("accelerometer", "random_walk"): "Velocity random walk N",
    ("accelerometer", "rate_random_walk"): "Acceleration random walk K",
}
SYMBOLS = {"pass": "✓", "fail": "✗", "undecided": "?", None: ""}


def quantity_name(sensor: str, quantity: str) -> str:
    """As the field calls it, such as "Angle random walk N"."""
    plain = quantity.replace("_", " ").capitalize()
    return SENSOR_NAMES.get((sensor, quantity)) or NAMES.get(quantity, plain)


def judged_name(sensor: str, quantity: str) -> str:
    """The name of what a limit is about, in which soft iron counts by how far it is from none."""
    if quantity == "soft_iron":
        return "Soft iron off identity"
    return quantity_name(sensor, JUDGED_BY.get(quantity, quantity))


def interval(value: float, low: float, high: float) -> tuple[str, str, str]:
    """Three numbers with as many digits as the interval deserves: two of its half-width."""
    width = abs(high - low) / 2
    if not width or not value:
        return f"{value:.4g}", f"{low:.4g}", f"{high:.4g}"
    digits = 1 - math.floor(math.log10(width))
    if -4 < digits < 7:
        texts = (f"{round(number, digits):.{max(digits, 0)}f}" for number in (value, low, high))
    else:
        precise = max(2, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(width)))
        texts = (f"{number:.{precise}g}" for number in (value, low, high))
    return tuple(texts)


def bounds(checks: Iterable[dict[str, Any]], scale: float, digits: int = 4) -> str:
    """The limits of checks of one quantity, such as "≤ 0.3", in units of `scale`."""
    signs = {"max": "≤", "min": "≥"}
    return ", ".join(
        dict.fromkeys(f"{signs[c['bound']]} {c['limit'] / scale:.{digits}g}" for c in checks)
    )


def check_words(check: dict[str, Any], found: dict[str, Any]) -> str:
    """A check in words, in field units: what was measured, the limit, the verdict and what follows."""
    sensor, quantity, axis = check["sensor"], check["quantity"], check["axis"]
    unit, scale = units.field_unit(sensor, quantity)
    name = judged_name(sensor, quantity)
    limit = f"limit {bounds([check], scale)} {unit}".removesuffix(" 1")
    what = f"{sensor} {name[0].lower()}{name[1:]} {axis}".rstrip()
    low, high = check["low"], check["high"]
    if check["value"] is not None and low is not None and high is not None:
        value, below, above = interval(check["value"] / scale, low / scale, high / scale)
        measured = value if low == high else f"{value} ({below} … {above})"
    elif high is not None:
        measured = f"no visible effect, below {high / scale:.2g}"
    else:
        measured = "no result"
    words = f"{what}: {measured}, {limit}: {check['verdict']}"
    if check.get("doubt"):
        return f"{words}, as {check['doubt']} — give it in device.toml"
    if check["verdict"] != "undecided":
        return words
    if high is None:
        return f"{words} — {why_none(check, found)}"
    more = "record it in more attitudes" if quantity in CALIBRATED else "record longer"
    return f"{words}, as its 95 % interval straddles the limit — {more}, which narrows it"


def why_none(check: dict[str, Any], found: dict[str, Any]) -> str:
    """Why there is no result to judge."""
    calibrated = check["quantity"] in CALIBRATED
    calibrating = [c.slug for c in CHAPTERS if c.result == "calibration"]
    # The chapter that would have given it before any other of this sensor.
    ordered = sorted(
        found["chapters"], key=lambda c: (c["chapter"] in calibrating) is not calibrated
    )
    for chapter in ordered:
        unfinished = chapter["status"] in ("refused", "failed") and chapter["reason"]
        if chapter["sensor"] == check["sensor"] and unfinished:
            reason = chapter["reason"].splitlines()[0]
            return f"{chapter['title'].lower()} {chapter['status']}: {reason}"
    calibration = found["sensors"].get(check["sensor"], {}).get("calibration", {})
    if check["quantity"] in ("field", "field_measured") and calibration.get("method"):
        return "these results do not hold the strength of the readings: render the report again"
    return "no recording gives it: add one, or take the limit out of [spec]"
