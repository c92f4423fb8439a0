"""Results side by side: one device over time, or several; changes in units of their standard error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist

from sensorbook.export.source import Entry
from sensorbook.recordings.checks import finite
from sensorbook.reporting.calibrations import calibration_estimates
from sensorbook.reporting.words import interval, quantity_name
from sensorbook.units import SENSOR_UNITS, UnitError, field_unit, quantities

AXES = ("x", "y", "z")
FALSE_ALARMS = 0.05  # probability that any of all comparisons is marked though nothing changed
_SCALED = ("soft_iron", "field")  # relative where the field's strength is not known
_HALF_WIDTH = NormalDist().inv_cdf(0.975)  # standard errors to either side of a 95 % interval


@dataclass(frozen=True)
class Measured:
    """One number of a result in SI units; `value` is None where the term has no visible effect."""

    value: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Change:
    """How a number differs from the reference.

    Attributes
    ----------
    z : difference over the combined standard error; None where one of them bounds nothing
    """

    sensor: str
    quantity: str
    axis: str
    reference: Measured
    other: Measured
    z: float | None


@dataclass(frozen=True)
class Comparison:
    """The changes of one results.json against the reference, and what makes them hard to compare."""

    reference: Entry
    other: Entry
    changes: tuple[Change, ...]
    cautions: tuple[str, ...]
    threshold: float  # |z| beyond which a change is marked


def compare(results: Sequence[Entry]) -> list[Comparison]:
    """Each results.json against the first, which is the earliest where all are of one device.

    A change is marked beyond the two-sided normal quantile at which a single false mark among all
    comparisons has a probability of `FALSE_ALARMS` (Bonferroni). Raises `InputError` where a result
    is not as results.json has it.
    """
    ordered = list(results)
    if len({_name(r) for r in ordered}) == 1:
        ordered.sort(key=_created)
    reference, *others = ordered
    first = _numbers(reference)
    found = []
    for other in others:
        both = first, _numbers(other)
        left_out = {"field_measured"}  # that of the place
        if _fields_known(reference, other) != {True}:
            left_out.add("field")
        if _differently_scaled(reference, other):
            left_out.update(_SCALED)
        both = ({k: m for k, m in n.items() if k[1] not in left_out} for n in both)
        found.append((other, _changes(*both)))
    count = sum(change.z is not None for _, changes in found for change in changes)
    threshold = NormalDist().inv_cdf(1 - FALSE_ALARMS / (2 * max(count, 1)))
    return [
        Comparison(reference, other, tuple(changes), tuple(_cautions(reference, other)), threshold)
        for other, changes in found
    ]


def standard_errors(reference: Measured, other: Measured) -> float | None:
    """Difference over the combined standard error.

    Intervals of noise terms are skew: each number counts with the side that faces the other one. A
    term without visible effect lies between zero and its bound, which counts as two standard errors.
    """
    if Measured(None, None, None) in (reference, other):
        return None
    a, b = (m.value if m.value is not None else 0.0 for m in (reference, other))
    if a == b:
        return 0.0
    lower, upper = (reference, other) if a < b else (other, reference)
    if lower.high is None or upper.low is None:
        return None
    low = lower.value if lower.value is not None else 0.0
    high = upper.value if upper.value is not None else 0.0
    spread = math.hypot(max(lower.high - low, 0.0), max(high - upper.low, 0.0)) / _HALF_WIDTH
    if not spread:
        return None
    return math.copysign((high - low) / spread, b - a)


def table(comparison: Comparison) -> Iterator[str]:
    """The comparison as lines of text, in field units."""
    reference, other = comparison.reference, comparison.other
    yield f"{_title(other)}, against {_title(reference)}"
    rows = [("", "", "reference", "now", "unit", "change", "")]
    for change in comparison.changes:
        unit, scale = field_unit(change.sensor, change.quantity)
        name = quantity_name(change.sensor, change.quantity)
        z = "–" if change.z is None else f"{change.z:+.1f} σ"
        rows.append((f"{change.sensor} {name[0].lower()}{name[1:]}", change.axis,
                     _shown(change.reference, scale), _shown(change.other, scale), unit, z,
                     _word(change, comparison.threshold)))  # fmt: skip
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        yield "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
    yield from (f"  Note: {caution}" for caution in comparison.cautions)
    yield f"  {_conclusion(comparison)}"


def _conclusion(comparison: Comparison) -> str:
    judged = [c for c in comparison.changes if c.z is not None]
    marked = [c for c in judged if abs(c.z or 0) > comparison.threshold]
    if not judged:
        return "Nothing to compare: the two have no number with an interval in common."
    beyond = (
        f"{len(marked)} of {len(judged)} numbers" if marked else f"None of {len(judged)} numbers"
    )
    verb = "have" if len(marked) > 1 else "has"
    missing = sum(c.other == Measured(None, None, None) for c in comparison.changes)
    lost = f" {missing} of the reference have no counterpart now." if missing else ""
    return (
        f"{beyond} {verb} changed by more than {comparison.threshold:.1f} standard errors: where "
        f"nothing changes, chance marks any in one comparison in twenty.{lost}"
    )


def _word(change: Change, threshold: float) -> str:
    a, b = change.reference.value, change.other.value
    if change.other == Measured(None, None, None):
        return "no result now"
    if change.z is None or abs(change.z) <= threshold:
        return "" if (a is None) == (b is None) else "within the bound"
    if a is None:
        return "▲ appeared"
    if b is None:
        return "▼ vanished"
    return "▲ rose" if change.z > 0 else "▼ fell"


def _shown(measured: Measured, scale: float) -> str:
    if measured == Measured(None, None, None):
        return "–"
    if measured.value is None:
        return "none seen" if measured.high is None else f"< {measured.high / scale:.2g}"
    if measured.low is None or measured.high is None:
        return f"{measured.value / scale:.4g}"
    value, low, high = interval(measured.value / scale, measured.low / scale, measured.high / scale)
    return f"{value} ({low} … {high})"


# ---- from results.json ----


def _numbers(results: Entry) -> dict[tuple[str, str, str], Measured]:
    """Every number with an interval, by sensor, quantity and axis."""
    found: dict[tuple[str, str, str], Measured] = {}
    sensors = results.at("sensors")
    for sensor in sensors.value or {}:
        try:
            known = quantities(sensor)
        except UnitError:
            continue  # the camera's results are images
        noise = sensors.get(sensor).get("noise")
        for axis in AXES if "reason" not in (noise.value or {}) else ():
            entries = noise.get(axis)
            bounds = entries.get("upper_bounds")
            for quantity in entries.value or {}:
                if quantity in known and quantity != "noise_density":  # √2 times the random walk
                    measured = _measured(entries.get(quantity), bounds.get(quantity))
                    found[sensor, quantity, axis] = measured
        found |= {(sensor, q, a): m for (q, a), m in _calibration(sensors.get(sensor))}
    return found


def _differently_scaled(reference: Entry, other: Entry) -> bool:
    """Whether one soft iron is scaled to the Earth's field and the other to determinant 1."""
    return len(_fields_known(reference, other)) == 2


def _fields_known(reference: Entry, other: Entry) -> set[bool]:
    """Whether the strength of the field is known, of the magnetometers that are calibrated."""
    both = [r.at("sensors").get("magnetometer").get("calibration") for r in (reference, other)]
    return {bool(c.get("field_known").value) for c in both if c.get("method").value is not None}


def _calibration(sensor: Entry) -> Iterator[tuple[tuple[str, str], Measured]]:
    """Numbers of a calibration with their intervals; what is fixed has none."""
    try:
        found = calibration_estimates(sensor.value)
        if not all(finite(number) for numbers in found.values() for number in numbers):
            raise ValueError
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise sensor.get("calibration").wrong("is not as results.json has it") from None
    for key, (value, low, high) in found.items():
        if low < high:
            yield key, Measured(value, low, high)


def _measured(entry: Entry, bound: Entry) -> Measured:
    if entry.value is None:
        return Measured(None, 0.0, None if bound.value is None else bound.magnitude())
    return Measured(*(entry.at(key).magnitude() for key in ("value", "low", "high")))


def _changes(first, now) -> list[Change]:
    changes = []
    order = {q: k for k, q in enumerate(q for s in SENSOR_UNITS for q in quantities(s))}
    for key, reference in sorted(first.items(), key=lambda i: (i[0][0], order[i[0][1]], i[0][2])):
        other = now.get(key, Measured(None, None, None))
        if reference.value is None and other.value is None:
            continue
        changes.append(Change(*key, reference, other, standard_errors(reference, other)))
    return changes


def _cautions(reference: Entry, other: Entry) -> Iterator[str]:
    """What differs between two results besides the device."""
    a, b = ({(i["sensor"], i["kind"]): i for i in _inputs(r)} for r in (reference, other))
    for (sensor, kind), mine in b.items():
        theirs = a.get((sensor, kind))
        if theirs is None:
            continue
        rates = theirs.get("rate_hz"), mine.get("rate_hz")
        if all(map(finite, rates)) and abs(rates[0] / rates[1] - 1) > 0.01:
            yield (f"the {sensor}'s {kind} recording was sampled at {rates[0]:g} Hz, now at "
                   f"{rates[1]:g} Hz: quantization and what a low-pass hides differ")  # fmt: skip
    if any("camera" in (r.at("sensors").value or {}) for r in (reference, other)):
        yield "a camera's results are its images: they are not compared"
    if any(r.get("attitude").get("methods").value for r in (reference, other)):
        yield ("an integrated attitude hangs on the motion and the references of its recording: it is not "
               "compared")  # fmt: skip
    for sensor in reference.at("sensors").value or {}:
        was, now = (
            r.at("sensors").get(sensor).get("thermal").value or {} for r in (reference, other)
        )
        temperatures = [t.get("x", {}).get("reference_temperature") if isinstance(t.get("x"), dict)
                        else None for t in (was, now)]  # fmt: skip
        if all(map(finite, temperatures)) and abs(temperatures[0] - temperatures[1]) > 1:
            yield (f"the {sensor}'s thermal model is relative to {temperatures[0]:.1f} °C, now to "
                   f"{temperatures[1]:.1f} °C")  # fmt: skip
    if _differently_scaled(reference, other):
        yield ("the magnetometer's soft iron is scaled to the Earth's field in one of the two only: it "
               "is not compared")  # fmt: skip
    if _name(reference) != _name(other):
        return
    versions = [r.get("software").get("sensorbook").value for r in (reference, other)]
    if versions[0] != versions[1]:
        yield f"computed by sensorbook {versions[0]}, now by {versions[1]}"


def _inputs(results: Entry) -> list[dict]:
    entries = results.get("inputs").value
    return [i for i in entries or [] if isinstance(i, dict) and {"sensor", "kind"} <= i.keys()]


def _name(results: Entry) -> str:
    return results.at("device").at("id").text()


def _created(results: Entry) -> str:
    created = results.get("created").value
    return created if isinstance(created, str) else ""


def _title(results: Entry) -> str:
    day = _created(results)[:10]
    return f"{_name(results)} ({day})" if day else _name(results)
