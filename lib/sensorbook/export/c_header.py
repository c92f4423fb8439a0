"""Calibrations as a header for C99 and C++: constant arrays, and a function that corrects a reading."""

from __future__ import annotations

import re

from sensorbook.export.calibration import (
    SensorCalibration,
    Value,
    inert,
    read_calibration,
)
from sensorbook.export.source import Entry

CORRECT = """\
/* {what}; out may be raw. */
static inline void {name}_correct(const double raw[3],{argument} double out[3])
{{
    const double *offset = {name}_{offset};
    const double (*matrix)[3] = {name}_{matrix};
{sensitive}    double d[3];
    int i;
    for (i = 0; i < 3; i++)
        d[i] = raw[i] - offset[i]{minus};
    for (i = 0; i < 3; i++)
        out[i] = {product};
}}
"""


def render(results: Entry) -> str:
    """Arrays `sensorbook_<device>_<sensor>_<value>`; raises `InputError` as `read_calibration` does."""
    device = read_calibration(results)
    prefix = f"sensorbook_{_identifier(device.device)}"
    guard = f"{prefix.upper()}_H"
    parts = [_comment(device.head), f"#ifndef {guard}\n#define {guard}\n"]
    for one in device.sensors:
        name = f"{prefix}_{one.sensor}"
        parts.append(_comment((f"{one.sensor}:", *one.notes)))
        parts += [_constant(name, value) for value in one.values]
        parts.append(_correct(name, one))
    return "\n".join([*filter(None, parts), f"#endif /* {guard} */\n"])


def _identifier(text: str) -> str:
    """Letters, digits and single underscores, as C++ reserves double ones.

    >>> _identifier("IMU--7.b_")
    'IMU_7_b'
    """
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") or "device"


def _comment(lines: tuple[str, ...]) -> str:
    return "/*\n" + "".join(f" * {inert(line)}\n" for line in lines) + " */\n"


def _constant(name: str, value: Value) -> str:
    shape, inner = "", value.numbers
    while isinstance(inner, list):
        shape, inner = f"{shape}[{len(inner)}]", inner[0]
    comment = f"/* {inert(value.comment)} */"
    return (
        f"{comment}\nstatic const double {name}_{value.name}{shape} = {_braces(value.numbers)};\n"
    )


def _braces(numbers: float | list, indent: str = "") -> str:
    """Initialiser, a row of a matrix a line."""
    if not isinstance(numbers, list):
        return repr(numbers)
    if not isinstance(numbers[0], list):
        return "{" + ", ".join(map(repr, numbers)) + "}"
    deeper = indent + "    "
    rows = ",\n".join(deeper + _braces(row, deeper) for row in numbers)
    return "{\n" + rows + "\n" + indent + "}"


def _correct(name: str, one: SensorCalibration) -> str:
    """The inverse of the error model; empty where there is no calibration."""
    names = {value.name for value in one.values}
    if "soft_iron" in names:
        offset, matrix = "hard_iron", "soft_iron"
    elif "bias" in names:
        offset, matrix = "bias", "inverse_matrix"
    else:
        return ""

    def product(matrix: str, vector: str) -> str:
        return " + ".join(f"{matrix}[i][{j}] * {vector}[{j}]" for j in range(3))

    what = "Corrects a reading"
    if any(n.startswith("thermal") for n in names):
        what += " less its thermal change"
    if "reference_temperature" in names:
        what += " at reference_temperature"
    g, minus, argument = "", "", ""
    if "g_sensitivity" in names:
        g = f"    const double (*g)[3] = {name}_g_sensitivity;\n"
        minus = f"\n            - ({product('g', 'acceleration')})"
        argument = " const double acceleration[3],"
    return CORRECT.format(
        what=what,
        name=name,
        argument=argument,
        offset=offset,
        matrix=matrix,
        sensitive=g,
        minus=minus,
        product=product("matrix", "d"),
    )
