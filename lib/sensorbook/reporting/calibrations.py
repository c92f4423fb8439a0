"""The numbers of a calibration as results.json states them: with intervals, and as limits judge them."""

from __future__ import annotations

from typing import Any

AXES = ("x", "y", "z")
ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")  # of a symmetric matrix
# Numbers without an interval, of a magnetometer's calibration as a whole.
WHOLE = (
    "residual_percent",
    "residual_percent_check",
    "coverage_percent",
    "heading_error_after_deg",
)
# What stands in a calibration's table; the rest is noise or thermal.
CALIBRATED = (
    "bias",
    "scale_factor_error",
    "misalignment",
    "hard_iron",
    "soft_iron",
    "field",
    "field_measured",
    *WHOLE,
)
# `field` is the Earth model's own value, or what the soft iron's scale makes of the readings: a limit on
# it is about the readings as they come.
JUDGED_BY = {"field": "field_measured"}

Estimate = tuple[float, float, float]  # value and the bounds of its 95 % interval


def axes_of(quantity: str) -> tuple[str, ...]:
    """The axes that a limit of this quantity is judged on; ("",) where it has none."""
    return ("",) if quantity in ("field", "field_measured", *WHOLE) else AXES


def calibration_estimates(result: dict[str, Any]) -> dict[tuple[str, str], Estimate]:
    """Value and 95 % interval of a calibration's numbers by quantity and axis, SI.

    `bias`, `scale_factor_error` and `hard_iron` have the axes x, y and z, `misalignment` the pairs that
    were free, `soft_iron` its six `ENTRIES`, `field` and `field_measured` the axis "".
    """
    calibration = result.get("calibration") or {}
    if calibration.get("method") is None or "std" not in calibration:
        return {}
    std, factor = calibration["std"], calibration.get("interval_factor", 1.96)
    found = {}

    def take(quantity: str, axis: str, value: float, error: float) -> None:
        half = factor * error
        found[quantity, axis] = (value, value - half, value + half)

    for quantity in ("bias", "hard_iron"):
        if quantity in calibration:
            for axis, value, error in zip(AXES, calibration[quantity], std[quantity], strict=True):
                take(quantity, axis, value, error)
    if "matrix" in calibration:
        for i, row in enumerate(AXES):
            for j, column in enumerate(AXES):
                value, error = calibration["matrix"][i][j] - (i == j), std["matrix"][i][j]
                if i == j:
                    take("scale_factor_error", row, value, error)
                elif error:
                    take("misalignment", row + column, value, error)
    if "soft_iron" in calibration:
        for entry in ENTRIES:
            i, j = map(AXES.index, entry)
            take("soft_iron", entry, calibration["soft_iron"][i][j], std["soft_iron"][i][j])
        take("field", "", calibration["field"], std["field"])
    if "field_measured" in calibration and "field_measured" in std:
        take("field_measured", "", calibration["field_measured"], std["field_measured"])
    return found


def without_interval(result: dict[str, Any]) -> dict[str, float]:
    """A calibration's numbers that have no interval, of the sensor as a whole: residuals, angles, shares.

    Those of a magnetometer's `alignment` are among them.
    """
    calibration = result.get("calibration") or {}
    named = calibration | (calibration.get("alignment") or {})
    return {
        quantity: value
        for quantity, value in named.items()
        if quantity.startswith(("rms_", "residual_percent"))
        or quantity.endswith(("_percent", "_deg"))
        if isinstance(value, int | float)
    }


def whole(result: dict[str, Any], quantity: str) -> float | None:
    """A number of `WHOLE`; None where the calibration does not state it.

    A fit flatters itself: the residual is that of readings held out, where there are any.
    """
    calibration = result.get("calibration") or {}
    held_out = calibration.get("residual_percent_check")
    if quantity == "residual_percent" and held_out is not None:
        return held_out
    return calibration.get(quantity)


def size(quantity: str, axes: str, estimate: Estimate) -> Estimate:
    """What a limit is about: the absolute value and its interval; of soft iron, from the identity."""
    ideal = float(quantity == "soft_iron" and axes[0] == axes[1])
    value, low, high = (number - ideal for number in estimate)
    nearest = 0.0 if low <= 0 <= high else min(abs(low), abs(high))
    return abs(value), nearest, max(abs(low), abs(high))


def judged(result: dict[str, Any], axis: str, quantity: str) -> tuple[float | None, ...]:
    """Value and interval by which a limit of a calibration's quantity is judged; None where unknown.

    Of several numbers of an axis the largest, which lies between the largest of their lower and of
    their upper bounds: one that is hardly known may be the largest, too.
    """
    if quantity in WHOLE:
        return (whole(result, quantity),) * 3
    quantity = JUDGED_BY.get(quantity, quantity)
    mine = [
        size(name, axes, estimate)
        for (name, axes), estimate in calibration_estimates(result).items()
        if name == quantity and concerns(quantity, axes, axis)
    ]
    return tuple(max(numbers) for numbers in zip(*mine, strict=True)) or (None,) * 3


def concerns(quantity: str, axes: str, axis: str) -> bool:
    """Whether a number of these axes belongs to the limit of one axis: soft iron is symmetric."""
    return axis in axes if quantity == "soft_iron" else axes[:1] == axis
