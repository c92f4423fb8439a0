"""A camera's images in short, for the pages and files that list devices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from statistics import fmean, median
from typing import Any

from sensorbook.recordings.checks import finite
from sensorbook.reporting.words import quantity_name
from sensorbook.units import field_unit

QUANTITIES = ("solved_percent", "earth_direction_std_deg", "attitude_std_deg", "attitude_error_deg")
STATISTICS = {
    "earth_direction_std_deg": "median",
    "attitude_std_deg": "median",
    "attitude_error_deg": "mean",
}
_REASONS = 8  # told on a page


def camera_numbers(result: Mapping[str, Any]) -> dict[str, float]:
    """Of a camera's entry in results.json, by `QUANTITIES`: how many images are solved, and how well.

    Standard errors are medians, that of an attitude being that of its error vector's size; errors are
    means. An attitude that two images make together counts once. Only what is known is there.
    """
    images = _images(result)
    if not images:
        return {}
    solved = sum(image["status"] == "ok" for image in images)
    seen: set[str] = set()
    stds, errors = [], []
    for image in images:
        std = image.get("attitude_std_deg")
        if std is None or image.get("partner") in seen:
            continue
        seen.add(image["image"])
        stds.append(sum(s**2 for s in std) ** 0.5)
        if finite(image.get("error_deg")):
            errors.append(image["error_deg"])
    earth = [s for image in images if finite(s := image.get("earth_direction_std_deg"))]
    numbers = {
        "solved_percent": 100 * solved / len(images),
        "earth_direction_std_deg": median(earth) if earth else None,
        "attitude_std_deg": median(stds) if stds else None,
        "attitude_error_deg": fmean(errors) if errors else None,
    }
    return {quantity: number for quantity, number in numbers.items() if number is not None}


def cameras_alone(found: Mapping[str, Any]) -> bool:
    """Whether a results.json is of cameras alone, on which no limits can be set."""
    return {chapter["sensor"] for chapter in found["chapters"]} == {"camera"}


def camera_table(result: Mapping[str, Any]) -> dict[str, Any] | None:
    """The same as rows of text for a device's page, and its images without solution by reason."""
    images, numbers = _images(result), camera_numbers(result)
    if not images:
        return None
    solved = sum(image["status"] == "ok" for image in images)
    rows = [
        {
            "name": quantity_name("camera", quantity),
            "value": f"{number:.3g}",
            "unit": field_unit("camera", quantity)[0],
        }
        for quantity, number in numbers.items()
        if quantity != "solved_percent"
    ]
    caption = "Medians of the standard errors"
    if "attitude_std_deg" in numbers:
        caption += ": of a direction for each axis across it, of an attitude for its axes together"
    if "attitude_error_deg" in numbers:
        caption += "; mean of the errors against the true attitude"
    reasons = Counter(
        image["status"].replace(f" ({image.get('partner')})", "").removeprefix("no solution: ")
        for image in images
        if image["status"] != "ok"
    ).most_common()
    return {
        "solved": f"{solved} of {len(images)} image{'' if len(images) == 1 else 's'}",
        "caption": caption,
        "rows": rows,
        "reasons": reasons[:_REASONS],
        "more": len(reasons) - _REASONS,
    }


def _images(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    images = result.get("images")
    return images if isinstance(images, list) else []
