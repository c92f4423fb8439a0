"""The kinds of recordings that can be planned, and what each is planned for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from sensorbook.errors import InputError
from sensorbook.noise.model import TERMS
from sensorbook.plan import makers, rests, rotation, thermal, trajectory
from sensorbook.plan.asked import Asked, Usage, within_of
from sensorbook.plan.levels import GRADES, Levels, of_grade, of_results
from sensorbook.plan.words import Plan
from sensorbook.units import SENSOR_UNITS

DEFAULT_GRADE = "consumer"
LIMITS = (  # of what the chapters refuse, or no device meets: option, what is good, and why
    ("rate", lambda v: 1e-3 <= v <= 1e6, "0.001 to 1e+06 Hz: no sensor is sampled otherwise"),
    ("levelling", lambda v: v <= 5, "5 degrees at most, or some rests are none of the six faces"),
    ("span", lambda v: v >= 6, "6 °C at least, or a change cannot be told from a drift with time"),
    ("span", lambda v: v <= 300, "300 °C at most, more than any sensor bears"),
    ("reference", lambda v: v <= 30, "30 degrees at most, or its errors are no small angles"),
)


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

    for option, good, why in LIMITS:
        if (value := {"rate": rate, **options}.get(option)) is not None and not good(value):
            raise Usage(f"--{option}: {value:g}: {why}")
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
            within_of(default if within is None else within, sensor, quantity, kind == "static"),
            found,
            levels,
            options.get("levelling") or rests.LEVELLING,
            options.get("span") or thermal.SPAN,
            options.get("reference") or trajectory.REFERENCE,
        )
    )


def overview(
    grade: str | None = None, results: str | Path | None = None, rate: float | None = None
) -> Iterator[str]:
    """Each kind with its default accuracy, and what to do for it; why not, where `results` lacks it.

    Raises `InputError` where they are enough for none.
    """
    lines, problems = [], []
    for kind, sensor in OVERVIEW:
        try:
            made = plan(kind, sensor, results=results, grade=grade, rate=rate)
        except InputError as error:
            problems.append(error)
            lines.append(f"{kind}, {sensor}:")
            lines += [f"  not planned: {problem}" for problem in error.problems]
        else:
            lines += [made.title, f"  {made.do[0]}"]
            if not made.reached:
                lines.append(f"  {made.notes[0]}")
    if len(problems) == len(OVERVIEW):
        raise problems[0]
    yield from lines
    yield "More of one kind, and for other accuracies: sensorbook plan KIND --help"


def _require(good: bool, what: str, value: str, known) -> None:
    if not good:
        raise Usage(f"{what}: no {value!r}; choose from {', '.join(known)}")


_CALIBRATED = rests.QUANTITIES
KINDS = {
    "static": Kind(
        makers.static_plan,
        {
            sensor: ("bias_instability", *(t for t in TERMS if t != "bias_instability"))
            for sensor in ("gyroscope", "accelerometer", "magnetometer")
        },
        dict.fromkeys(TERMS, "10%"),
    ),
    "positions": Kind(
        makers.positions_plan,
        {"accelerometer": _CALIBRATED, "gyroscope": _CALIBRATED},
        {
            ("accelerometer", "bias"): "0.1 mg",
            ("gyroscope", "bias"): "0.005 deg/s",
            "scale_factor_error": "300 ppm",
            "misalignment": "0.5 mrad",
        },
    ),
    "six_position": Kind(
        makers.positions_plan,
        {"accelerometer": _CALIBRATED},
        {"bias": "0.1 mg", "scale_factor_error": "200 ppm", "misalignment": "5 mrad"},
        ("levelling",),
    ),
    "rotation": Kind(
        makers.rotation_plan,
        {"magnetometer": rotation.QUANTITIES},
        {"hard_iron": "0.1 uT", "soft_iron": "0.002", "direction": "0.2 deg"},
    ),
    "thermal": Kind(
        makers.thermal_plan,
        dict.fromkeys(SENSOR_UNITS, ("change",)),
        {
            ("gyroscope", "change"): "0.01 deg/s",
            ("accelerometer", "change"): "0.3 mg",
            ("magnetometer", "change"): "0.5 uT",
        },
        ("span",),
    ),
    "trajectory": Kind(
        makers.trajectory_plan,
        {"gyroscope": ("attitude",)},
        {"attitude": "0.5 deg"},
        ("reference",),
    ),
    "images": Kind(makers.images_plan, {"camera": ("attitude",)}, {"attitude": "0.02 deg"}),
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
