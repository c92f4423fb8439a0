"""The noise levels that a plan rests on: of a device already measured, or typical of a grade."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.errors import InputError, Problem
from sensorbook.export.source import Entry, read_results
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.recordings.checks import finite

SMALLEST, LARGEST = 1e-20, 1e6  # SI, of a level of any sensor
RATE = 100.0  # Hz, where nothing tells it
# A data sheet has no K: taken so that the flat of B ends after so long, K √(τ/3) = 0.664 B there.
FLAT_ENDS = 1000.0  # s
# N and B, typical of data sheets of the class: in °/√h and °/h, mg/√Hz and mg, nT/√Hz and nT. Consumer:
# phones' triads; industrial: between ADIS16470 and its successors, PNI RM3100; tactical: ADIS16495-1, a
# laboratory's fluxgate.
GRADES = {
    "consumer": {"gyroscope": (0.6, 8.0), "accelerometer": (0.15, 0.04), "magnetometer": (60, 40)},
    "industrial": {"gyroscope": (0.2, 4.0), "accelerometer": (0.06, 0.013), "magnetometer": (1, 1)},
    "tactical": {
        "gyroscope": (0.09, 0.8),
        "accelerometer": (0.015, 0.0032),
        "magnetometer": (0.02, 0.02),
    },
}
_SI = {
    "gyroscope": (np.radians(1) / 60, np.radians(1) / 3600),
    "accelerometer": (STANDARD_GRAVITY / 1000, STANDARD_GRAVITY / 1000),
    "magnetometer": (1e-9, 1e-9),
}


@dataclass(frozen=True)
class Levels:
    """Noise of one sensor, SI.

    Attributes
    ----------
    axes : terms by axis
    rate : Hz
    source : where they come from, in words
    bounds : (axis, term) of levels that are upper bounds: the record they come from did not show them
    """

    sensor: str
    axes: dict[str, NoiseTerms]
    rate: float
    source: str
    bounds: frozenset[tuple[str, str]] = field(default_factory=frozenset)


def of_grade(sensor: str, grade: str, rate: float | None = None) -> Levels:
    """Typical levels of a grade, the same on three axes."""
    white, flicker = (v * si for v, si in zip(GRADES[grade][sensor], _SI[sensor], strict=True))
    walk = np.sqrt(2 * np.log(2) / np.pi) * flicker * np.sqrt(3 / FLAT_ENDS)
    terms = NoiseTerms(random_walk=white, bias_instability=flicker, rate_random_walk=walk)
    source = (
        f"typical of {grade} grade; K, on no data sheet, where the flat of B ends after "
        f"{FLAT_ENDS:g} s"
    )
    return Levels(sensor, dict.fromkeys("xyz", terms), rate or RATE, source)


def of_results(
    path: str | Path, sensor: str, rate: float | None = None, wanted: str = ""
) -> Levels:
    """Levels of a device's results.json.

    `wanted` is the term that is planned for: where an axis does not show it, its upper bound stands for
    it. Other terms that are not shown are taken as absent.

    Raises
    ------
    InputError
        the file is no results.json, or holds no noise of this sensor, or nothing of `wanted`
    """
    results = read_results(path)
    noise = results.at("sensors").get(sensor).get("noise")
    mend = f"record a rest of the {sensor} (kind static) and report it, or plan by --grade"
    if not noise.value:
        raise noise.wrong("is missing", mend)
    axes, bounds = {}, set()
    for axis in "xyz":
        found = {}
        for term in TERMS:
            entry = noise.at(axis, mend=mend).get(term)
            if entry.value is not None:
                found[term] = _level(entry.at("value"))
            elif term == wanted:
                bound = noise.at(axis, mend=mend).get("upper_bounds").get(term)
                if bound.value is not None:
                    found[term] = _level(bound)
                    bounds.add((axis, term))
        if wanted and not found.get(wanted):
            continue
        if not found.get("random_walk"):
            raise noise.at(axis, mend=mend).get("random_walk").wrong("is missing or 0", mend)
        axes[axis] = NoiseTerms(**found)
    if not axes:
        shown = wanted.replace("_", " ")
        raise noise.wrong(f"no axis shows a {shown} or bounds it", mend)
    return Levels(sensor, axes, rate or _rate(results, sensor), str(path), frozenset(bounds))


def _level(entry: Entry) -> float:
    """A level that a sensor may have, or 0."""
    value = entry.magnitude()
    if value and not SMALLEST < value < LARGEST:
        raise entry.wrong(f"{value:g} is no noise level of a sensor")
    return value


def _rate(results: Entry, sensor: str) -> float:
    inputs = results.get("inputs")
    for entry in inputs.items() if inputs.value is not None else ():
        of = entry.get("sensor").value, entry.get("kind").value
        rate = entry.get("rate_hz").value
        if of == (sensor, "static") and rate is not None:
            if not finite(rate) or rate <= 0:
                raise InputError(
                    Problem(
                        entry.file, f"{entry.key}.rate_hz", f"{rate!r} is no rate", "give --rate"
                    )
                )
            return float(rate)
    return RATE
