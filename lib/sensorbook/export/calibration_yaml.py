"""Calibrations as YAML 1.1: a mapping a sensor, ASCII, floats that read back bit for bit."""

from __future__ import annotations

import json

from sensorbook.export.calibration import Value, inert, read_calibration
from sensorbook.export.source import Entry, yaml_number


def render(results: Entry) -> str:
    """`device` and a mapping a sensor; raises `InputError` as `read_calibration` does."""
    device = read_calibration(results)
    lines = [*map(_comment, device.head), f"device: {json.dumps(device.device)}"]
    for one in device.sensors:
        lines += ["", *map(_comment, (f"{one.sensor}:", *one.notes))]
        if one.values:
            lines.append(f"{one.sensor}:")
        for value in one.values:
            lines += _entry(value)
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    return f"# {inert(text)}"


def _entry(value: Value) -> list[str]:
    """A row of a matrix a line."""
    key, comment = f"  {value.name}:", f"  {_comment(value.comment)}"
    numbers = value.numbers
    if isinstance(numbers, list) and isinstance(numbers[0], list):
        return [key + comment, *(f"    - {_flow(row)}" for row in numbers)]
    return [f"{key} {_flow(numbers)}{comment}"]


def _flow(numbers: float | list) -> str:
    if isinstance(numbers, list):
        return f"[{', '.join(map(_flow, numbers))}]"
    return yaml_number(numbers)
