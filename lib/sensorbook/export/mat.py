"""The results as variables of MATLAB and Octave (.mat, version 5)."""

from __future__ import annotations

import io
import math
import re
from typing import Any

import numpy as np
from scipy.io import savemat

from sensorbook.export.calibration import IRON, inert, origin
from sensorbook.export.source import Entry

CONVENTION = {
    "units": "SI; the fields named unit and temperature_unit say it of each result; degC; Hz; s",
    "axes": "those of the recordings, in the order x, y, z; vectors are columns",
    "intervals": "low and high bound the 95 % interval; an empty array is a term without visible effect",
    "calibration": "raw = matrix * true + bias + g_sensitivity * acceleration;"
    " true = matrix \\ (raw - bias - g_sensitivity * acceleration), raw (3, N)",
    "magnetometer": f"{IRON}, raw (3, N)",
    "noise": "quantization, random_walk, bias_instability, rate_random_walk and rate_ramp are Q, N, B, K"
    " and R of the two-sided spectrum; noise_density is of the one-sided, sqrt(2) N",
    "thermal": "B(T) = sum over k of coefficients(k+1) * (T - reference_temperature)^k; subtract"
    " B(T) - B(reference_temperature) from a raw reading before anything else",
    "quaternions": "x, y, z, w (scalar last), reference to body",
}
NAME = 63  # characters of a field's name in MATLAB
HEADER = 116  # bytes of text at a file's start


def render(results: Entry) -> bytes:
    """`sensors` as results.json has them, with `convention` and `provenance` in words.

    Raises
    ------
    InputError : where the results hold what no variable can
    """
    head = origin(results, "Results")
    if not results.at("sensors").value and not results.get("attitude").value:
        raise results.at("sensors").wrong("holds no results", "render the report of a recording")
    try:
        variables = {
            "sensors": _variable(results.at("sensors").value),
            "attitude": _variable(results.get("attitude").value),
            "inputs": _variable(results.get("inputs").value),
            "convention": CONVENTION,
            "provenance": "\n".join(map(inert, head)),
        }
        file = io.BytesIO()
        savemat(file, variables, long_field_names=True, do_compression=True, oned_as="column")
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise results.wrong(f"cannot be made variables: {type(error).__name__}: {error}") from None
    # scipy writes the hour there: the same results give the same bytes.
    text = f"MATLAB 5.0 MAT-file, {inert(head[-1])}".encode("ascii")
    return text[:HEADER].ljust(HEADER) + file.getvalue()[HEADER:]


def _variable(value: Any) -> Any:
    """What savemat makes an array, text, a struct or a cell of."""
    if value is None:
        return np.zeros((0, 0))
    if isinstance(value, bool):
        return np.bool_(value)
    if isinstance(value, int | float):
        return _finite(value)
    if isinstance(value, str):
        return inert(value)
    if isinstance(value, dict):
        names = _names(value)
        return {names[key]: _variable(below) for key, below in value.items()} or np.zeros((0, 0))
    if not value:
        return np.zeros((0, 0))
    if _is_numeric(value):
        try:
            return np.array(value, dtype=float)  # None becomes NaN
        except ValueError:  # rows of different lengths
            pass
    cells = np.empty(len(value), dtype=object)
    cells[:] = [_variable(item) for item in value]
    return cells


def _is_numeric(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(map(_is_numeric, value))
    if isinstance(value, bool) or not isinstance(value, int | float | None):
        return False
    return value is None or _finite(value) is not None


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{value} is not a finite number")
    return float(value)


def _names(fields: dict[str, Any]) -> dict[str, str]:
    """A name of MATLAB's for each, such as x1_0 for "1.0"."""
    names: dict[str, str] = {}
    for key in fields:
        name = re.sub(r"[^A-Za-z0-9_]", "_", key)
        name = (name if name[:1].isalpha() else f"x{name}")[:NAME]
        if name in names.values():
            raise ValueError(f"two fields are {name} to MATLAB")
        names[key] = name
    return names
