"""One plan a kind of recording: from what a user asks for to what to do."""

from __future__ import annotations

import numpy as np

from sensorbook.attitude.tuning import TYPICAL_IN_MOTION
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.plan import images, rests, rotation, static, thermal, trajectory
from sensorbook.plan.asked import Asked, noise_in_words, row, shown, title
from sensorbook.plan.words import HALF, Plan, duration, number, rate

NOISE_ASSUMED = (
    "that noise alone, Gaussian: no steps, shocks or periodic lines, and no drift with temperature"
)
WANDERS = (
    "the bias is the recording's own mean; it wanders on afterwards, and with each switching on"
)


# --- static ---


def static_plan(asked: Asked) -> Plan:
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
            level = shown(found.level, asked.sensor, term)
            if (axes[0], term) in levels.bounds:
                level = f"≤ {level}"
            std = found.std * found.level
            cells = list(row(asked, term, std, HALF * std, axes, level))
            cells[0] += f" {TERMS[term].symbol}"
            cells[4] += f" ({number(100 * HALF * found.std, 2)} %)"
            if not found.stated:
                cells[3:] = ["may not be told apart", "may be bounded only"]
            rows.append(tuple(cells))
            numbers[axes[0], term] = found
    worst = max(alike, key=lambda t: numbers[alike[t][0], name].std)
    hours = [h * 3600.0 for h in (1, 8, 24, 168)]
    grows = [static.rest(worst, name, s, levels.rate) for s in hours]
    notes = [
        f"{TERMS[name].symbol} on {alike[worst]} by length of the rest, 95 %: "
        + ", ".join(
            f"{duration(r.seconds)} "
            + (f"± {number(100 * HALF * r.std, 2)} %" if r.stated else "may be bounded only")
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
        title(asked),
        (f"{long}.", "Let it warm up for an hour first; declare it as kind static."),
        tuple(rows),
        tuple(notes),
        (
            noise_in_words(levels),
            NOISE_ASSUMED,
            f"white to half the rate of {rate(levels.rate)}; behind a low-pass N is known less well",
        ),
        "Cramér–Rao bound of the cosine lines' likelihood (methods A6; Whittle 1953); stated "
        "where 95 % of "
        "such records show the term, as chapter 4 asks",
        reached,
        {"seconds": seconds, "found": numbers},
    )


# --- positions ---


def positions_plan(asked: Asked) -> Plan:
    terms = asked.levels.axes
    given = {"terms": terms}
    if asked.kind == "six_position":
        given["levelling"] = asked.levelling
    elif asked.sensor == "gyroscope":
        given["accelerometer"] = asked.given("accelerometer").axes
    found, reached = rests.planned(asked.kind, asked.quantity, asked.within, **given)
    count, names = len(found.attitudes), tuple(dict.fromkeys(found.attitudes))
    rounds = count // len(names)
    turns = "" if rounds == 1 else f", all of them {rounds} times"
    do = [
        f"rest it for {duration(found.seconds)} in each of {len(names)} attitudes{turns}: "
        f"{duration(found.duration)} in all, with a motion of {rests.MOTION:g} s between."
    ]
    assumes = [noise_in_words(asked.levels), NOISE_ASSUMED]
    if asked.kind == "six_position":
        do.append(f"Levelled to {number(asked.levelling)}°, up is in turn: {'; '.join(names)}.")
        assumes.append(
            f"levelling off by {number(asked.levelling)}° rms about each axis, for each rest anew"
        )
        source = (
            "least squares of levelled faces (methods B3; B 5–8), weights as chapter 6 has them"
        )
    else:
        do.append(
            "Up is in turn (faces and edges of the housing, within some degrees; any heading): "
            f"{'; '.join(names)}."
        )
        source = "gravity's length in many attitudes (methods B4; B 17, 18), nine parameters"
    if asked.sensor == "gyroscope":
        do.append(
            "Record the accelerometer beside it in one file; turn by 90° and more between "
            "rests, about all axes."
        )
        assumes += [
            noise_in_words(asked.given("accelerometer")),
            f"the Earth's rate at {rests.LATITUDE:g}° latitude, of unknown heading",
        ]
        source = (
            "bias from the rests (A 5.2), scale and axes from gravity carried between them "
            "(Tedaldi et al. 2014, "
            "section IV)"
        )
    else:
        assumes.append("local gravity: 1e-3 m/s² off moves all three scale factors by 100 ppm")
    assumes.append(WANDERS)
    notes = []
    if not reached:
        stands = shown(found.half[asked.quantity], asked.sensor, asked.quantity)
        why = {
            "six_position": "levelling errors and the bias's wander do not average out",
            "positions": "the bias wanders while more attitudes are recorded",
        }[asked.kind]
        notes.append(f"out of reach: ± {stands} is the best of the plans tried; {why}")
    rate_needed = max(asked.levels.rate, 20.0)
    do.append(f"Sample at {rate(rate_needed)} or so; 20 Hz at least, or motions are hardly seen.")
    return Plan(
        title(asked),
        tuple(do),
        tuple(row(asked, q, found.std[q], found.half[q]) for q in rests.QUANTITIES),
        tuple(notes),
        tuple(assumes),
        source,
        reached,
        {"found": found},
    )


# --- rotation, thermal, trajectory, images ---


def rotation_plan(asked: Asked) -> Plan:
    found, reached = rotation.planned(asked.quantity, asked.within, asked.levels.axes)
    stands = shown(found.half[asked.quantity], asked.sensor, asked.quantity)
    return Plan(
        title(asked),
        (
            f"turn it by hand for {duration(found.seconds)} at 10 Hz or more, a radian or two a "
            "second, until "
            "every side of it has pointed along the field (90 % of the sphere within 15° of a "
            "reading).",
            "In one place, a metre from iron, cables and loudspeakers; declare it as kind "
            "rotation.",
        ),
        tuple(row(asked, q, found.std[q], found.half[q]) for q in rotation.QUANTITIES),
        ()
        if reached
        else (
            f"out of reach: half an hour still leaves ± {stands}, by what the field changes "
            "along the path",
        ),
        (
            noise_in_words(asked.levels),
            f"a field of {number(rotation.FIELD * 1e6)} µT that changes by "
            f"{number(100 * rotation.SURROUNDINGS)} % "
            f"rms along the hand's path, for {rotation.ALIKE:g} s at a time (2 µT/m, 4 cm)",
        ),
        "Fisher's information of the full ellipsoid (methods A8; A 6.1–6.4) from directions "
        "all over the sphere",
        reached,
        {"found": found},
    )


def thermal_plan(asked: Asked) -> Plan:
    found, reached = thermal.planned(asked.within, asked.levels.axes, asked.span)
    stands = shown(found.half, asked.sensor, "change")
    cycles = "once" if found.cycles == 1 else f"{found.cycles} times"
    notes = [] if reached else [
        f"out of reach: ± {stands} is the best of the plans tried; slower sweeps let the bias "
        "wander farther"
    ]  # fmt: skip
    return Plan(
        title(asked),
        (
            f"rest it through a sweep of {number(found.span)} °C, up and down {cycles} at "
            f"{found.pace:g} °C/min: "
            f"{duration(found.duration)} in all.",
            "Record the temperature beside it, sweep over the range of use and hold for some "
            "minutes at either "
            "end; declare it as kind thermal.",
        ),
        (row(asked, "change", found.std, found.half),),
        (*notes, "the change from the lowest to the highest temperature; in between it is known better"),
        (
            noise_in_words(asked.levels),
            f"a smooth curve of degree {thermal.DEGREE}, the die no more than a degree behind "
            "its sensor",
        ),
        f"least squares of degree {thermal.DEGREE} on block means (methods A2; A 5.3), their "
        "noise's covariance exact in "
        "N, B and K",
        reached,
        {"found": found},
    )  # fmt: skip


def trajectory_plan(asked: Asked) -> Plan:
    turning, reference = np.radians(trajectory.TURNING), np.radians(asked.reference)
    found, reached = trajectory.planned(
        asked.std, asked.levels.axes, TYPICAL_IN_MOTION, turning, reference
    )
    stands = shown(HALF * found.before, asked.sensor, "attitude")
    rows = [row(asked, "attitude", s, HALF * s) for s in (found.before, found.after)]
    rows = [(f"attitude just {w} a reference", "each", *r[2:]) for w, r in
            zip(("before", "after"), rows, strict=True)]  # fmt: skip
    return Plan(
        title(asked),
        (
            f"give it a reference of {number(asked.reference)}° at {rate(found.rate)} or more, for "
            f"{duration(found.seconds)} at least.",
            f"Sample the gyroscope at {rate(float(np.ceil(trajectory.sampling(turning))))} or "
            "more (2° rms a sample "
            "at most); one clock for both; rest for some seconds at the start.",
        ),
        tuple(rows),
        () if reached else (f"out of reach: a reference at 100 Hz still leaves ± {stands}",),
        (
            noise_in_words(asked.levels),
            f"turning at {trajectory.TURNING:g}°/s rms, with a calibrated gyroscope (0.2 % of "
            "scale for a second at "
            "a time)",
            f"references whose errors of {number(asked.reference)}° about each axis (1 sigma) "
            "are new each time",
        ),
        "steady state of the Kalman filter with a bias (methods C6; chapter 19)",
        reached,
        {"found": found},
    )


def images_plan(asked: Asked) -> Plan:
    own, needed = images.planned(asked.std)
    enlarge = needed.focal_px > own.focal_px
    return Plan(
        title(asked),
        (
            f"take images with a focal length of {needed.focal_px:.0f} pixels or more, one an "
            "attitude that is "
            "wanted: each is measured by itself.",
            "Each shows the Sun, 2° or more clear of the Earth, and 20° or more of lit limb; "
            "not with the Sun "
            "in line with the Earth's centre. Give position and time of each in poses.csv.",
        ),
        (row(asked, "attitude", needed.std, HALF * needed.std, "whole"),),
        ("another lens or more pixels: the view must still hold both bodies",) if enlarge else (),
        (
            f"work C's camera ({own.focal_px:g} pixels), 2 DN of noise, the Earth fully lit, "
            "2000 km up",
            "a calibrated lens, and errors that are a share of a pixel whatever the focal length",
        ),
        f"no formula: {images.SCENES} rendered scenes, their own covariance (chapters 14 and 15)",
        True,
        {"found": needed},
    )
