"""What a user asks for, and the units that it is asked and answered in."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sensorbook.plan.levels import Levels
from sensorbook.plan.words import HALF, number
from sensorbook.units import UnitError, factor, field_unit, si_unit


class Usage(ValueError):
    """Arguments that make no plan; the message says what is possible."""


@dataclass(frozen=True)
class Asked:
    """What is wanted.

    Attributes
    ----------
    within : half width of the 95 % interval, SI; of a share of the level negative
    levels : of the sensor; None for a camera
    """

    kind: str
    sensor: str
    quantity: str
    within: float
    levels: Levels | None
    given: Callable[[str], Levels]
    levelling: float
    span: float
    reference: float

    @property
    def std(self) -> float:
        """The standard error that it asks for, SI."""
        return self.within / HALF


def unit_of(sensor: str, quantity: str) -> tuple[str, float]:
    """Label and size of the unit that a quantity is shown in."""
    if quantity in ("attitude", "direction"):
        return "°", float(np.radians(1))
    return field_unit(sensor, "bias" if quantity == "change" else quantity)


def within_of(text: str, sensor: str, quantity: str, relative: bool) -> float:
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*", text)
    label, size = unit_of(sensor, quantity)
    example = "10% or " if relative else ""
    try:
        value = float(match.group(1)) if match else 0.0
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise Usage(
            f"--within: {text!r} is no number above 0 and its unit, such as {example}1 {label}"
        )
    unit = match.group(2)
    if relative and unit in ("", "%", "percent"):
        return -value / 100
    if not unit:
        return value * size
    try:
        return value * factor(unit, si_of(sensor, quantity))
    except UnitError as error:
        raise Usage(f"--within: {error}") from None


def si_of(sensor: str, quantity: str) -> str:
    if quantity in ("attitude", "direction"):
        return "rad"
    return si_unit(sensor, "bias" if quantity == "change" else quantity)


def shown(value: float, sensor: str, quantity: str) -> str:
    label, size = unit_of(sensor, quantity)
    return number(value / size) + ("" if label == "1" else f" {label}")


def title(asked: Asked) -> str:
    named = asked.quantity.replace("_", " ")
    if asked.within < 0:
        wanted = f"{number(-100 * asked.within)} %"
    else:
        wanted = shown(asked.within, asked.sensor, asked.quantity)
    return f"{asked.kind}, {asked.sensor}: {named} within ± {wanted} (95 %)"


def row(
    asked: Asked, quantity: str, std: float, half: float, axes: str = "worst", level: str = ""
) -> tuple[str, ...]:
    """A row of a plan's table: standard error and half of the 95 % interval, SI."""
    return (
        quantity.replace("_", " "),
        axes,
        level,
        shown(std, asked.sensor, quantity),
        f"± {shown(half, asked.sensor, quantity)}",
    )


def noise_in_words(levels: Levels) -> str:
    label, size = unit_of(levels.sensor, "random_walk")
    white = max(t.random_walk for t in levels.axes.values()) / size
    slow, unit = unit_of(levels.sensor, "bias_instability")
    flicker = max(t.bias_instability for t in levels.axes.values()) / unit
    terms = f"N {number(white)} {label}, B {number(flicker)} {slow}"
    return f"the {levels.sensor}'s noise: {terms} ({levels.source})"
