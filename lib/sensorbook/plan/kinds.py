"""One plan a kind of recording: from what a user asks for to what to do."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.plan import images, rests, rotation, static, thermal, trajectory
from sensorbook.plan.levels import GRADES, Levels, of_grade, of_results
from sensorbook.plan.words import HALF, Plan, duration, number, rate
from sensorbook.units import SENSOR_UNITS, UnitError, factor, field_unit

DEFAULT_GRADE = "consumer"
NOISE_ASSUMED = (
    "that noise alone, Gaussian: no steps, shocks or periodic lines, and no drift with temperature"
)


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


@dataclass(frozen=True)
class Kind:
    """What can be planned of one kind.

    Attributes
    ----------
    quantities : by sensor, the first of either is the default
    within : default by (sensor, quantity); by quantity where a sensor has none of its own
    options : those that go with it
    """

    make: Callable[[Asked], Plan]
    quantities: dict[str, tuple[str, ...]]
    within: dict[str | tuple[str, str], str]
    options: tuple[str, ...] = ()


def plan(
    kind: str,
    sensor: str | None = None,
    quantity: str | None = None,
    within: str | None = None,
    results: str | Path | None = None,
    grade: str | None = None,
    rate: float | None = None,
    **options: float | None,
) -> Plan:
    """How to record `kind` so that `quantity` is known to `within`, half its 95 % interval.

    Parameters
    ----------
    kind : one of `KINDS`
    sensor, quantity : of those of the kind; default: its first
    within : such as "10%", "0.5 mg" or "200 ppm"; default: the kind's
    results : results.json of a device whose noise was measured; or
    grade : one of `GRADES`
    rate : Hz
    options : levelling (deg), span (°C), reference (deg); default where None

    Raises
    ------
    Usage : something that is not there to choose from
    InputError : `results` lacks what is needed
    """
    _require(kind in KINDS, "KIND", kind, KINDS)
    chosen = KINDS[kind]
    if given := [n for n, v in options.items() if v is not None and n not in chosen.options]:
        goes = [k for k, one in KINDS.items() if given[0] in one.options]
        raise Usage(f"--{given[0]} goes with {', '.join(goes)}, not with {kind}")
    # A quantity tells the sensor where only one has it.
    of = [s for s, all_of in chosen.quantities.items() if quantity in all_of]
    sensor = sensor or (of or list(chosen.quantities))[0]
    _require(sensor in chosen.quantities, f"{kind}: --sensor", sensor, chosen.quantities)
    possible = chosen.quantities[sensor]
    quantity = quantity or possible[0]
    _require(quantity in possible, f"{kind}, {sensor}: --quantity", quantity, possible)
    if results is not None and grade is not None:
        raise Usage("give --from or --grade, not both")
    if sensor == "camera" and (results is not None or grade is not None):
        raise Usage("images: no noise levels are needed, neither --from nor --grade")
    grade = grade or DEFAULT_GRADE
    _require(grade in GRADES, "--grade", grade, GRADES)

    def levels(of_sensor: str, wanted: str = "") -> Levels:
        if results is None:
            return of_grade(of_sensor, grade, rate)
        return of_results(results, of_sensor, rate, wanted)

    wanted = quantity if kind == "static" else ""
    default = chosen.within.get((sensor, quantity)) or chosen.within[quantity]
    found = None if sensor == "camera" else levels(sensor, wanted)
    if kind == "static" and results is None and not getattr(found.axes["x"], quantity):
        shown = quantity.replace("_", " ")
        raise Usage(f"no grade has a typical {shown}: give --from with a device that shows it")
    return chosen.make(
        Asked(
            kind,
            sensor,
            quantity,
            _within(within or default, sensor, quantity, kind == "static"),
            found,
            levels,
            options.get("levelling") or rests.LEVELLING,
            options.get("span") or thermal.SPAN,
            options.get("reference") or trajectory.REFERENCE,
        )
    )


def overview(grade: str | None = None, results: str | Path | None = None) -> Iterator[str]:
    """A short table: each kind with its default accuracy, and what to do for it."""
    for kind, sensor in OVERVIEW:
        made = plan(kind, sensor, grade=grade, results=results)
        yield made.title
        yield from (f"  {text}" for text in made.do[:1])


def _require(good: bool, what: str, value: str, known) -> None:
    if not good:
        raise Usage(f"{what}: no {value!r}; choose from {', '.join(known)}")


def unit_of(sensor: str, quantity: str) -> tuple[str, float]:
    """Label and size of the unit that a quantity is shown in."""
    if quantity in ("attitude", "direction"):
        return "°", float(np.radians(1))
    return field_unit(sensor, "bias" if quantity == "change" else quantity)


def _within(text: str, sensor: str, quantity: str, relative: bool) -> float:
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*", text)
    label, size = unit_of(sensor, quantity)
    example = "10% or " if relative else ""
    try:
        value = float(match.group(1)) if match else 0.0
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise Usage(f"--within: {text!r} is no number above 0 and its unit, such as {example}1 {label}")
    unit = match.group(2)
    if relative and unit in ("", "%", "percent"):
        return -value / 100
    if not unit:
        return value * size
    try:
        return value * factor(unit, _si(sensor, quantity))
    except UnitError as error:
        raise Usage(f"--within: {error}") from None


def _si(sensor: str, quantity: str) -> str:
    from sensorbook.units import si_unit

    if quantity in ("attitude", "direction"):
        return "rad"
    return si_unit(sensor, "bias" if quantity == "change" else quantity)


def _shown(value: float, sensor: str, quantity: str) -> str:
    label, size = unit_of(sensor, quantity)
    return number(value / size) + ("" if label == "1" else f" {label}")


def _title(asked: Asked) -> str:
    named = asked.quantity.replace("_", " ")
    if asked.within < 0:
        wanted = f"{number(-100 * asked.within)} %"
    else:
        wanted = _shown(asked.within, asked.sensor, asked.quantity)
    return f"{asked.kind}, {asked.sensor}: {named} within ± {wanted} (95 %)"


def _row(asked: Asked, quantity: str, std: float, axes: str = "worst", level: str = "") -> tuple:
    return (
        quantity.replace("_", " "),
        axes,
        level,
        _shown(std, asked.sensor, quantity),
        f"± {_shown(HALF * std, asked.sensor, quantity)}",
    )


def _noise(levels: Levels) -> str:
    label, size = unit_of(levels.sensor, "random_walk")
    white = max(t.random_walk for t in levels.axes.values()) / size
    slow, unit = unit_of(levels.sensor, "bias_instability")
    flicker = max(t.bias_instability for t in levels.axes.values()) / unit
    return (
        f"the {levels.sensor}'s noise: N {number(white)} {label}, B {number(flicker)} {slow} ({levels.source})"
    )


# --- static ---


def _static(asked: Asked) -> Plan:
    levels, name = asked.levels, asked.quantity
    alike: dict[NoiseTerms, str] = {}
    for axis, terms in levels.axes.items():
        alike[terms] = f"{alike[terms]}, {axis}" if terms in alike else axis
    lengths = {}
    for terms in alike:
        share = -asked.within if asked.within < 0 else asked.within / getattr(terms, name)
        lengths[terms] = static.shortest(terms, name, share / HALF, levels.rate)
    reached = all(lengths.values())
    seconds = max(r.seconds for r in lengths.values()) if reached else static.LONGEST
    rows, numbers = [], {}
    for terms, axes in alike.items():
        for term in (name, *(t for t in TERMS if t != name and getattr(terms, t))):
            found = static.rest(terms, term, seconds, levels.rate)
            level = _shown(found.level, asked.sensor, term)
            if (axes[0], term) in levels.bounds:
                level = f"≤ {level}"
            std = found.std * found.level
            row = list(_row(asked, term, std, axes, level))
            row[0] += f" {TERMS[term].symbol}"
            row[4] += f" ({number(100 * HALF * found.std, 2)} %)"
            if not found.stated:
                row[3:] = ["not told apart", "bounded only"]
            rows.append(tuple(row))
            numbers[axes[0], term] = found
    worst = max(alike, key=lambda t: numbers[alike[t][0], name].std)
    hours = [h * 3600.0 for h in (1, 8, 24, 168)]
    grows = [static.rest(worst, name, s, levels.rate) for s in hours]
    notes = [
        f"{TERMS[name].symbol} by length of the rest, 95 %: "
        + ", ".join(
            f"{duration(r.seconds)} "
            + (f"± {number(100 * HALF * r.std, 2)} %" if r.stated else "bounded only")
            for r in grows
        )
    ]
    if not reached:
        notes.insert(0, f"out of reach within a week: {static.hidden(worst, name, levels.rate)}")
    if levels.bounds:
        axes = ", ".join(sorted(a for a, _ in levels.bounds))
        notes.append(f"{levels.source} does not show it on {axes}: its upper bound stands for it")
    long = f"rest it for {duration(seconds)} at {rate(levels.rate)}, untouched and at a steady temperature"
    if not reached:
        long = f"a week's rest does not tell it; {long} for what stands below"
    return Plan(
        _title(asked),
        (f"{long}.", "Let it warm up for an hour first; declare it as kind static."),
        tuple(rows),
        tuple(notes),
        (_noise(levels), NOISE_ASSUMED, f"white to half the rate of {rate(levels.rate)}"),
        "Cramér–Rao bound of the cosine lines' likelihood (methods A6; Whittle 1953); stated where 95 % of "
        "such records show the term, as chapter 4 asks",
        reached,
        {"seconds": seconds, "found": numbers},
    )


# --- positions ---


def _positions(asked: Asked) -> Plan:
    terms = asked.levels.axes
    given = {"terms": terms}
    if asked.kind == "six_position":
        given["levelling"] = asked.levelling
    elif asked.sensor == "gyroscope":
        given["accelerometer"] = asked.given("accelerometer").axes
    found, reached = rests.planned(asked.kind, asked.quantity, asked.std, **given)
    count, names = len(found.attitudes), tuple(dict.fromkeys(found.attitudes))
    rounds = count // len(names)
    turns = "" if rounds == 1 else f", all of them {rounds} times"
    do = [
        f"rest it for {duration(found.seconds)} in each of {len(names)} attitudes{turns}: "
        f"{duration(found.duration)} in all, with a motion of {rests.MOTION:g} s between."
    ]
    assumes = [_noise(asked.levels), NOISE_ASSUMED]
    if asked.kind == "six_position":
        do.append(f"Levelled to {number(asked.levelling)}°, up is in turn: {'; '.join(names)}.")
        assumes.append(
            f"levelling off by {number(asked.levelling)}° rms about each axis, for each rest anew"
        )
        source = "least squares of levelled faces (methods B3; B 5–8), weights as chapter 6 has them"
    else:
        do.append(
            "Up is in turn (faces and edges of the housing, within some degrees; any heading): "
            f"{'; '.join(names)}."
        )
        source = "gravity's length in many attitudes (methods B4; B 17, 18), nine parameters"
    if asked.sensor == "gyroscope":
        do.append(
            "Record the accelerometer beside it in one file; turn by 90° and more between rests, about all axes."
        )
        assumes += [
            _noise(asked.given("accelerometer")),
            f"the Earth's rate at {rests.LATITUDE:g}° latitude, of unknown heading",
        ]
        source = (
            "bias from the rests (A 5.2), scale and axes from gravity carried between them (Tedaldi et al. 2014, "
            "section IV)"
        )
    else:
        assumes.append("local gravity: 1e-3 m/s² off moves all three scale factors by 100 ppm")
    assumes.append("the bias is the recording's own mean; it wanders on afterwards, and with each switching on")
    notes = []
    if not reached:
        stands = _shown(HALF * found.std[asked.quantity], asked.sensor, asked.quantity)
        why = {
            "six_position": "levelling errors and the bias's wander do not average out",
            "positions": "the bias wanders while more attitudes are recorded",
        }[asked.kind]
        notes.append(f"out of reach: ± {stands} is the best of the plans tried; {why}")
    rate_needed = max(asked.levels.rate, 20.0)
    do.append(f"Sample at {rate(rate_needed)} or so; 20 Hz at least, or motions are hardly seen.")
    return Plan(
        _title(asked),
        tuple(do),
        tuple(_row(asked, q, found.std[q]) for q in rests.QUANTITIES),
        tuple(notes),
        tuple(assumes),
        source,
        reached,
        {"found": found},
    )


# --- rotation, thermal, trajectory, images ---


def _rotation(asked: Asked) -> Plan:
    found, reached = rotation.planned(asked.quantity, asked.std, asked.levels.axes)
    stands = _shown(HALF * found.std[asked.quantity], asked.sensor, asked.quantity)
    return Plan(
        _title(asked),
        (
            f"turn it by hand for {duration(found.seconds)} at 10 Hz or more, a radian or two a second, until "
            "every side of it has pointed along the field (90 % of the sphere within 15° of a reading).",
            "In one place, a metre from iron, cables and loudspeakers; declare it as kind rotation.",
        ),
        tuple(_row(asked, q, found.std[q]) for q in rotation.QUANTITIES),
        ()
        if reached
        else (f"out of reach: half an hour still leaves ± {stands}, by what the field changes along the path",),
        (
            _noise(asked.levels),
            f"a field of {number(rotation.FIELD * 1e6)} µT that changes by {number(100 * rotation.SURROUNDINGS)} % "
            f"rms along the hand's path, for {rotation.ALIKE:g} s at a time (2 µT/m, 4 cm)",
        ),
        "Fisher's information of the full ellipsoid (methods A8; A 6.1–6.4) from directions all over the sphere",
        reached,
        {"found": found},
    )


def _thermal(asked: Asked) -> Plan:
    found, reached = thermal.planned(asked.std, asked.levels.axes, asked.span)
    stands = _shown(HALF * found.std, asked.sensor, "change")
    cycles = "once" if found.cycles == 1 else f"{found.cycles} times"
    notes = [] if reached else [
        f"out of reach: ± {stands} is the best of the plans tried; slower sweeps let the bias wander farther"
    ]  # fmt: skip
    return Plan(
        _title(asked),
        (
            f"rest it through a sweep of {number(found.span)} °C, up and down {cycles} at {found.pace:g} °C/min: "
            f"{duration(found.duration)} in all.",
            "Record the temperature beside it, sweep over the range of use and hold for some minutes at either "
            "end; declare it as kind thermal.",
        ),
        (_row(asked, "change", found.std),),
        (*notes, "the change from the lowest to the highest temperature; in between it is known better"),
        (
            _noise(asked.levels),
            f"a smooth curve of degree {thermal.DEGREE}, the die no more than a degree behind its sensor",
        ),
        f"least squares of degree {thermal.DEGREE} on block means (methods A2; A 5.3), their noise's covariance exact in "
        "N, B and K",
        reached,
        {"found": found},
    )  # fmt: skip


def _trajectory(asked: Asked) -> Plan:
    from sensorbook.attitude.tuning import TYPICAL_IN_MOTION

    turning, reference = np.radians(trajectory.TURNING), np.radians(asked.reference)
    found, reached = trajectory.planned(
        asked.std, asked.levels.axes, TYPICAL_IN_MOTION, turning, reference
    )
    stands = _shown(HALF * found.before, asked.sensor, "attitude")
    rows = [_row(asked, "attitude", s) for s in (found.before, found.after)]
    rows = [(f"attitude just {w} a reference", "each", *r[2:]) for w, r in
            zip(("before", "after"), rows, strict=True)]  # fmt: skip
    return Plan(
        _title(asked),
        (
            f"give it a reference of {number(asked.reference)}° at {rate(found.rate)} or more, for "
            f"{duration(found.seconds)} at least.",
            f"Sample the gyroscope at {rate(float(np.ceil(trajectory.sampling(turning))))} or more (2° rms a sample "
            "at most); one clock for both; rest for some seconds at the start.",
        ),
        tuple(rows),
        () if reached else (f"out of reach: a reference at 100 Hz still leaves ± {stands}",),
        (
            _noise(asked.levels),
            f"turning at {trajectory.TURNING:g}°/s rms, with a calibrated gyroscope (0.2 % of scale for a second at "
            "a time)",
            f"references whose errors of {number(asked.reference)}° about each axis (1 sigma) are new each time",
        ),
        "steady state of the Kalman filter with a bias (methods C6; chapter 19)",
        reached,
        {"found": found},
    )


def _images(asked: Asked) -> Plan:
    own, needed = images.planned(asked.std)
    enlarge = needed.focal_px > own.focal_px
    return Plan(
        _title(asked),
        (
            f"take images with a focal length of {needed.focal_px:.0f} pixels or more, one an attitude that is "
            "wanted: each is measured by itself.",
            "Each shows the Sun, 2° or more clear of the Earth, and 20° or more of lit limb; not with the Sun "
            "in line with the Earth's centre. Give position and time of each in poses.csv.",
        ),
        (_row(asked, "attitude", needed.std, "whole"),),
        ("another lens or more pixels: the view must still hold both bodies",) if enlarge else (),
        (
            f"work C's camera ({own.focal_px:g} pixels), 2 DN of noise, the Earth fully lit, 2000 km up",
            "a calibrated lens, and errors that are a share of a pixel whatever the focal length",
        ),
        f"no formula: {images.SCENES} rendered scenes, their own covariance (chapters 14 and 15)",
        True,
        {"found": needed},
    )


_CALIBRATED = rests.QUANTITIES
KINDS = {
    "static": Kind(
        _static,
        {
            sensor: ("bias_instability", *(t for t in TERMS if t != "bias_instability"))
            for sensor in ("gyroscope", "accelerometer", "magnetometer")
        },
        dict.fromkeys(TERMS, "10%"),
    ),
    "positions": Kind(
        _positions,
        {"accelerometer": _CALIBRATED, "gyroscope": _CALIBRATED},
        {
            ("accelerometer", "bias"): "0.1 mg",
            ("gyroscope", "bias"): "0.005 deg/s",
            "scale_factor_error": "300 ppm",
            "misalignment": "0.5 mrad",
        },
    ),
    "six_position": Kind(
        _positions,
        {"accelerometer": _CALIBRATED},
        {"bias": "0.1 mg", "scale_factor_error": "200 ppm", "misalignment": "5 mrad"},
        ("levelling",),
    ),
    "rotation": Kind(
        _rotation,
        {"magnetometer": rotation.QUANTITIES},
        {"hard_iron": "0.1 uT", "soft_iron": "0.002", "direction": "0.2 deg"},
    ),
    "thermal": Kind(
        _thermal,
        {sensor: ("change",) for sensor in SENSOR_UNITS},
        {
            ("gyroscope", "change"): "0.01 deg/s",
            ("accelerometer", "change"): "0.3 mg",
            ("magnetometer", "change"): "0.5 uT",
        },
        ("span",),
    ),
    "trajectory": Kind(
        _trajectory, {"gyroscope": ("attitude",)}, {"attitude": "0.5 deg"}, ("reference",)
    ),
    "images": Kind(_images, {"camera": ("attitude",)}, {"attitude": "0.02 deg"}),
}
OVERVIEW = (
    ("static", "gyroscope"),
    ("static", "accelerometer"),
    ("thermal", "gyroscope"),
    ("positions", "accelerometer"),
    ("positions", "gyroscope"),
    ("six_position", "accelerometer"),
    ("rotation", "magnetometer"),
    ("trajectory", "gyroscope"),
)
