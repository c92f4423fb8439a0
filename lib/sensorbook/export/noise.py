"""What the exports of noise have in common: the rate of a rest, and one number for three axes."""

from __future__ import annotations

from dataclasses import dataclass

from sensorbook.export.calibration import inert, origin, part_of
from sensorbook.export.source import Entry
from sensorbook.units import si_unit

SENSORS = ("accelerometer", "gyroscope")


@dataclass(frozen=True)
class Strength:
    """One number for three axes: `what` it is, and what `axes` have."""

    value: float
    what: str
    axes: str


def named(results: Entry) -> str:
    """Identifier and name, inert: a name may hold line breaks and anything else."""
    device = results.at("device")
    return f"{device.at('id').text()!a} ({device.at('name').text()!a})"


def provenance(results: Entry) -> str:
    """Lines of comment that follow one with the device: date, software, files."""
    return "\n".join(f"# {inert(line)}" for line in origin(results)[1:])


def noise_of(results: Entry, sensor: str, mend: str) -> Entry:
    """The noise of a sensor; raises `Absent`, with `mend`, where there is none."""
    return part_of(results, sensor, "noise", mend)


def rate_of(results: Entry, sensor: str) -> float:
    """Rate of the sensor's longest static recording, the one whose noise is stated, Hz."""
    recordings = results.at("inputs").items()
    here = (sensor, "static")
    rests = [r for r in recordings if (r.at("sensor").value, r.at("kind").value) == here]
    if not rests:
        raise results.at("inputs").wrong(f"no static recording of the {sensor}")
    longest = max(rests, key=lambda rest: rest.at("duration_s").magnitude())
    rate = longest.at("rate_hz")
    if rate.magnitude() == 0:
        raise rate.wrong("0 is not a rate")
    return rate.magnitude()


def visible(noise: Entry, sensor: str, term: str, axis: str) -> float | None:
    """The strength of a term on an axis, SI; None where it is not visible."""
    estimate = noise.at(axis, term)
    if estimate.value is None:
        return None
    unit = estimate.at("unit")
    if unit.text() != si_unit(sensor, term):
        raise unit.wrong(f"{unit.value!r} is not {si_unit(sensor, term)!r}")
    return estimate.at("value").magnitude()


def strength(noise: Entry, sensor: str, term: str, target: str) -> Strength:
    """The largest of the axes where the term is visible, or else of its upper bounds."""
    values, bounds, axes = {}, {}, []
    for axis in "xyz":
        value = visible(noise, sensor, term, axis)
        bound = noise.at(axis).get("upper_bounds").get(term)
        if value is not None:
            values[axis] = value
            low, high = (noise.at(axis, term, end).magnitude() for end in ("low", "high"))
            axes.append(f"{axis} {value:.4g} ({low:.4g} ... {high:.4g})")
        elif bound.value is not None:
            bounds[axis] = bound.magnitude()
            axes.append(f"{axis} not visible (below {bounds[axis]:.4g})")
        else:
            axes.append(f"{axis} not visible")
    known = values or bounds
    if not any(known.values()):
        raise noise.wrong(
            f"{term} is neither visible nor bounded on any axis, and {target} needs a number above 0",
            f"record a longer rest of the {sensor} and render its report",
        )
    axis = max(known, key=known.get)
    what = f"axis {axis}" if values else f"not visible: 95 % upper bound, axis {axis}"
    return Strength(known[axis], what, ", ".join(axes))
