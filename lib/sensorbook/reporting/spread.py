"""How one quantity is distributed over the devices of a model, and which of them lie far out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from sensorbook import units
from sensorbook.reporting.words import judged_name

if TYPE_CHECKING:
    from sensorbook.reporting.group import Column, Row

FEWEST = 8  # devices of one model whose spread means something
OUTLYING = 5.0  # robust standard deviations
ALIKE = 1e-6  # robust standard deviation of the logarithm below which only rounding differs
BINS = 24
# Of these less is better, however far from the others.
ERRORS = (
    "residual_percent",
    "residual_percent_check",
    "rms_check",
    "heading_error_after_deg",
    "attitude_error_deg",
)


@dataclass(frozen=True)
class Spread:
    """How one quantity is distributed over the devices of a model."""

    title: str
    text: str
    svg: Markup


def spread_of(members: Sequence[Row], column: Column) -> Spread | None:
    """The distribution of a quantity; names what lies far out. None for too few devices.

    A quantity that most devices have alike has no spread to judge an outlier by.
    """
    known = [(row, row.values[column]) for row in members if column in row.values]
    known = [(row, v) for row, v in known if v.number > 0 and math.isfinite(v.number)]
    left_out = 0
    if column[1] == "soft_iron":
        # Of determinant 1 it says nothing of the scale, which is in the others.
        relative = [pair for pair in known if pair[0].relative]
        scaled = [pair for pair in known if not pair[0].relative]
        left_out = min(len(relative), len(scaled))
        known = max(scaled, relative, key=len)
    if len(known) < FEWEST:
        return None
    logs = np.log([v.number for _, v in known])
    middle = float(np.median(logs))
    robust = 1.4826 * float(np.median(np.abs(logs - middle)))
    name, unit = judged_name(*column), f" {units.field_unit(*column)[0]}".removesuffix(" 1")
    far = []
    for (row, value), log in zip(known, logs, strict=True):
        scale = math.hypot(robust, value.error)
        off = log - middle if column[1] in ERRORS else abs(log - middle)
        if robust > ALIKE and off > OUTLYING * scale:
            far.append(log)
            side = "above" if log > middle else "below"
            row.outlying.append(
                f"{column[0]} {name[0].lower()}{name[1:]} {value.number:.3g}{unit}, "
                f"{abs(log - middle) / scale:.0f} robust standard deviations {side} the median "
                f"{math.exp(middle):.3g}"
            )
    bounds = sorted({v.bound for _, v in known if v.bound})
    limits = [float(bound.split()[1]) for bound in bounds]
    low, high = np.exp([logs.min(), logs.max()])
    title = f"{column[0].capitalize()}: {name[0].lower()}{name[1:]}"
    text = (
        f"{len(known)} devices, median {math.exp(middle):.3g}{unit}, from {low:.3g} to {high:.3g}"
        + (f"; limit {', '.join(bounds)}" if bounds else "")
        + (f"; {len(far)} outlying" if far else "")
        + (f"; {left_out} of another scale left out" if left_out else "")
    )
    return Spread(
        title,
        text,
        _histogram(logs, far, [math.log(x) for x in limits if x > 0], f"{title}. {text}"),
    )


def _histogram(
    logs: np.ndarray, far: Sequence[float], limits: Sequence[float], text: str
) -> Markup:
    """Counts on a logarithmic axis as SVG: bars, limits as dashed lines, outliers as triangles."""
    low, high = (float(f((*logs, *limits))) for f in (min, max))
    span = (high - low) or 0.1
    low, high = low - 0.04 * span, high + 0.04 * span
    counts, _ = np.histogram(logs, BINS, (low, high))
    width, height = 320, 74

    def across(x: float) -> float:
        return round(width * (x - low) / (high - low), 1)

    step = width / BINS
    bars = "".join(
        f"M{k * step + 0.5:.1f} {height - 10}v-{max(1.0, 52 * n / counts.max()):.1f}h{step - 1:.1f}"
        f"v{max(1.0, 52 * n / counts.max()):.1f}z"
        for k, n in enumerate(counts) if n
    )  # fmt: skip
    marks = "".join(f"M{across(x)} 2v{height - 12}" for x in limits)
    tips = "".join(f"M{across(x) - 3} {height - 1}h6l-3 -6z" for x in far[:500])
    return Markup(
        '<svg viewBox="0 0 {w} {h}" role="img" aria-label="{text}"><path class="bars" d="{bars}"/>'
        '<path class="axis" d="M0 {base}h{w}"/><path class="limit" d="{marks}"/>'
        '<path class="far" d="{tips}"/></svg>'
    ).format(w=width, h=height, base=height - 10, text=text, bars=bars, marks=marks, tips=tips)
