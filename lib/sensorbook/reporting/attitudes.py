"""Integrated attitude in short, for the pages and files that list devices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from sensorbook.notebook import signed
from sensorbook.recordings.checks import finite
from sensorbook.reporting.chapters import ATTITUDE

QUANTITY = "mean_error_deg"
EXPECTED = "expected_rms_deg"  # what a method expects of itself, by its covariance
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
# What else tells the device's attitude: a method that was aided by it has its key after its own.
SOURCES = {"camera": "camera", "vectors": "gravity and field"}
NAMES = METHODS | {
    f"{method}_{source}": f"{name}, {words}"
    for source, words in SOURCES.items()
    for method, name in METHODS.items()
}
REAL_TIME = "mekf"  # the best of those that need no later sample
TITLE = f"Mean error, {METHODS[REAL_TIME]}"

_AXES = ("x", "y", "z")
_TO_95_PERCENT = 1.96  # standard errors to either side


def mean_errors(found: Mapping[str, Any]) -> Iterator[tuple[str, str, float | None]]:
    """Method, rate of the reference and mean error in degrees, of a results.json, as its keys are.

    The error is None where it is not known. Methods come in the order of `NAMES`, others last;
    rates from none upwards.
    """
    return _numbers(found, QUANTITY)


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
    """The errors as rows of text for a device's page, the gyroscope's bias, and the chapters' pages.

    Where no error is known they are those that the filters expect of themselves, and `judged` is
    false. Methods and rates without any number are left out.
    """
    errors = _known(found, QUANTITY)
    judged = bool(errors)
    if not judged:
        errors = _known(found, EXPECTED)
    bias = _bias_cells((found.get("attitude") or {}).get("bias"))
    if not errors and not bias:
        return None
    rates = sorted(dict.fromkeys(rate for _, rate in errors), key=_hertz)
    return {
        "judged": judged,
        "rates": [_rate_words(rate) for rate in rates],
        "rows": [
            {
                "name": NAMES.get(method, method),
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


def _numbers(found: Mapping[str, Any], quantity: str) -> Iterator[tuple[str, str, float | None]]:
    methods = (found.get("attitude") or {}).get("methods") or {}
    known = list(NAMES)
    for method in sorted(methods, key=lambda m: known.index(m) if m in NAMES else len(known)):
        for rate in sorted(methods[method], key=_hertz):
            number = methods[method][rate].get(quantity)
            yield method, rate, number if finite(number) else None


def _known(found: Mapping[str, Any], quantity: str) -> dict[tuple[str, str], float]:
    """Its numbers by method and rate."""
    return {
        (m, rate): number for m, rate, number in _numbers(found, quantity) if number is not None
    }


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
    """Each axis's bias in °/s, ± half of its 95 % interval; none where there is no bias."""
    if not isinstance(bias, Mapping):
        return []
    return [
        {"axis": axis, "value": signed(math.degrees(value), _TO_95_PERCENT * math.degrees(std))}
        for axis, value, std in zip(_AXES, bias["value"], bias["std"], strict=True)
    ]
