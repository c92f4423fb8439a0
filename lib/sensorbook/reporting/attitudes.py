"""Integrated attitude in short, for the pages and files that list devices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from sensorbook.recordings.checks import finite
from sensorbook.reporting.chapters import ATTITUDE
from sensorbook.reporting.words import interval

QUANTITY = "mean_error_deg"
UNIT = "°"
NEVER = "never"  # the key that stands for no reference, in a rate's place
METHODS = {
    "integration": "gyroscope alone",
    "reset": "work C: reset",
    "reset_and_rate": "work C: reset and rate kept",
    "complementary": "complementary filter",
    "mekf": "Kalman filter (MEKF)",
    "smoother": "smoother (RTS)",
}
REAL_TIME = "mekf"  # the best of those that need no later sample
TITLE = f"Mean error, {METHODS[REAL_TIME]}"

_AXES = ("x", "y", "z")


def mean_errors(found: Mapping[str, Any]) -> Iterator[tuple[str, str, float | None]]:
    """Method, rate of the reference and mean error in degrees, of a results.json, as its keys are.

    The error is None where it is not known. Methods come in the order of `METHODS`, others last;
    rates from none upwards.
    """
    methods = (found.get("attitude") or {}).get("methods") or {}
    known = list(METHODS)
    for method in sorted(methods, key=lambda m: known.index(m) if m in METHODS else len(known)):
        for rate in sorted(methods[method], key=_hertz):
            error = methods[method][rate].get(QUANTITY)
            yield method, rate, error if finite(error) else None


def real_time_error(found: Mapping[str, Any]) -> tuple[float, str] | None:
    """Mean error in degrees of the Kalman filter with the most frequent reference, and that rate.

    None where no error against a reference is known.
    """
    errors = [
        (_hertz(rate), error)
        for method, rate, error in mean_errors(found)
        if method == REAL_TIME and error is not None and 0 < _hertz(rate) < math.inf
    ]
    if not errors:
        return None
    rate, error = max(errors)
    return error, f"at {rate:g} Hz"


def attitude_table(found: Mapping[str, Any]) -> dict[str, Any] | None:
    """The errors as rows of text for a device's page, the gyroscope's bias, and the chapters' pages."""
    errors = {(method, rate): error for method, rate, error in mean_errors(found)}
    bias = _bias_cells((found.get("attitude") or {}).get("bias"))
    if not errors and not bias:
        return None
    rates = sorted(dict.fromkeys(rate for _, rate in errors), key=_hertz)
    return {
        "rates": [_rate_words(rate) for rate in rates],
        "rows": [
            {
                "name": METHODS.get(method, method),
                "cells": [_error_words(errors.get((method, rate))) for rate in rates],
            }
            for method in dict.fromkeys(method for method, _ in errors)
        ],
        "bias": bias,
        "chapters": [c for c in found["chapters"] if c["sensor"] == ATTITUDE and c["page"]],
    }


def spreadsheet_words(method: str, rate: str) -> str:
    """A method and the rate of its reference as a cell that no spreadsheet takes for a formula.

    "" where they are none that could be one.
    """
    hertz = _hertz(rate)
    if not method.isidentifier() or hertz == math.inf:
        return ""
    return f"{method} at {hertz:g} Hz" if hertz else f"{method} without reference"


def _hertz(rate: str) -> float:
    """A rate from its key; 0 for `NEVER`, infinite for what is no rate."""
    if rate == NEVER:
        return 0.0
    try:
        hertz = float(rate)
    except ValueError:
        return math.inf
    return hertz if hertz > 0 else math.inf


def _rate_words(rate: str) -> str:
    hertz = _hertz(rate)
    if hertz == math.inf:
        return rate
    return f"{hertz:g} Hz" if hertz else "no reference"


def _error_words(error: float | None) -> str:
    return "–" if error is None else f"{error:.3g}"


def _bias_cells(bias: Any) -> list[dict[str, str]]:
    """Each axis's bias in °/s, with its standard error; none where there is no bias."""
    if not isinstance(bias, Mapping):
        return []
    cells = []
    for axis, value, std in zip(_AXES, bias["value"], bias["std"], strict=True):
        value, std = math.degrees(value), math.degrees(std)
        text, _, _ = interval(value, value - std, value + std)
        cells.append({"axis": axis, "value": text, "std": f"{std:.2g}"})
    return cells
