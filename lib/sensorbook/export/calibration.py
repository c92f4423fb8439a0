"""What the exports of calibrations have in common: checked values, and comments that stay comments."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from sensorbook.errors import InputError
from sensorbook.export.source import Entry
from sensorbook.units import SENSOR_UNITS

AXES = ("x", "y", "z")
POSITIONS = 'record rests in many attitudes (kind = "positions") and render the report'
MENDS = {
    "gyroscope": POSITIONS,
    "accelerometer": POSITIONS,
    "magnetometer": 'record it turned freely (kind = "rotation") and render the report',
}
SWEEP = 'record a rest through a sweep of temperature (kind = "thermal") and render the report'

THERMAL = (
    "Thermal model of axis x, others alike: B(T) = sum over k = 0, 1 ... of",
    "thermal_x_coefficients[i][k] * (T - thermal_x_reference_temperature)^k in the range i that T",
    "lies in; outside the ranges the value at their edge holds. Before anything else, subtract",
    "B(T) - B(thermal_x_reference_temperature) from a raw reading, never B(T) itself.",
)

IRON = "true = soft_iron * (raw - hard_iron)"

_PLAIN = str.maketrans(
    {"²": "^2", "°": " deg ", "·": " ", "√": "sqrt", "µ": "u", "±": "+-", "−": "-", "–": "-"}
    | {"—": "-", "…": "...", "≥": ">=", "≤": "<=", "σ": "sigma", "\u202f": " ", "×": "x"}
)
# What ends a C comment or opens one in it, and what trigraphs begin with.
_MEANS_MORE = re.compile(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)")


@dataclass(frozen=True)
class Value:
    """A number, or nested lists of them, with the unit and the meaning in words."""

    name: str
    numbers: Any
    comment: str


@dataclass(frozen=True)
class SensorCalibration:
    """What is known of a sensor: `notes` are lines of comment, `values` empty where it was refused."""

    sensor: str
    notes: tuple[str, ...]
    values: tuple[Value, ...]


@dataclass(frozen=True)
class DeviceCalibration:
    """`device` is its identifier, `head` lines of comment about the whole."""

    device: str
    head: tuple[str, ...]
    sensors: tuple[SensorCalibration, ...]


def inert(text: str) -> str:
    r"""One line of printable ASCII that ends no comment, whatever the text holds.

    >>> inert("a */ b\n#define ² ??/")
    'a * / b #define ^2 ? ?/'
    """
    line = " ".join(text.translate(_PLAIN).split())
    line = "".join(c if " " <= c <= "~" else ascii(c)[1:-1] for c in line)
    return _MEANS_MORE.sub(" ", line)


class Absent(InputError):
    """A part that the results do not have: others may serve without it."""


class Refused(Absent):
    """A part that was refused."""


def part_of(results: Entry, sensor: str, part: str, mend: str) -> Entry:
    """A part of a sensor's results; raises `Absent` or `Refused`, with `mend`, where there is none."""
    path = ("sensors", sensor, part)
    entry = results
    for name in path:
        entry = entry.get(name)
    if entry.value is None:
        try:
            results.at(*path, mend=mend)  # names the first of the path that is missing
        except InputError as error:
            raise Absent(*error.problems) from None
        raise Absent(*entry.wrong("is missing", mend).problems)
    if (reason := entry.get("reason")).value is not None:
        raise Refused(*entry.wrong(f"was refused: {reason.text()}", mend).problems)
    return entry


def read_calibration(results: Entry) -> DeviceCalibration:
    """Every sensor's calibration and thermal model.

    Raises
    ------
    InputError : with what is wrong in each part; or where no sensor has numbers, with what to record
    """
    problems, refusals, found, head = [], [], [], ()
    try:
        head = _head(results)
    except InputError as error:
        problems += error.problems
    sensors = results.at("sensors")
    for sensor, unit in SENSOR_UNITS.items():
        notes, values = [], []
        for part, read, mend in (
            ("calibration", _calibration, MENDS[sensor]),
            ("thermal", _thermal, SWEEP),
        ):
            try:
                entry = sensors.get(sensor).get(part)
                if entry.value is None:
                    continue
                if (reason := entry.get("reason")).value is not None:
                    notes.append(f"{part.capitalize()} refused: {reason.text()}")
                    refusals += entry.wrong(f"was refused: {reason.text()}", mend).problems
                    continue
                more_notes, more_values = read(entry, unit)
                notes += more_notes
                values += more_values
            except InputError as error:
                problems += error.problems
        if notes:
            found.append(SensorCalibration(sensor, tuple(notes), tuple(values)))
    if problems:
        raise InputError(*dict.fromkeys(problems))
    if not any(one.values for one in found):
        none = sensors.wrong("no sensor has a calibration or a thermal model", POSITIONS)
        raise InputError(*refusals) if refusals else none
    return DeviceCalibration(inert(results.at("device", "id").text()), head, tuple(found))


def origin(results: Entry, what: str = "Calibration") -> tuple[str, ...]:
    """Lines of comment: the device, the date of its results, the software and the files they are of."""
    device, software = results.at("device"), results.at("software")
    names = ("sensorbook", "python", "numpy", "scipy")
    versions = ", ".join(f"{name} {software.at(name).text()}" for name in names)
    unit = [
        f"{name} {about.text()}"
        for name in ("model", "serial")
        if (about := device.get(name)).value is not None
    ]
    files = results.get("inputs").items() if results.get("inputs").value is not None else []
    made_of = dict.fromkeys(
        f"Made of {file.at('file').text()}, sha256 {file.at('sha256').text()}." for file in files
    )
    return (
        f"{what} of the device {device.at('id').text()} ({device.at('name').text()}).",
        *([f"Device: {', '.join(unit)}."] if unit else []),
        f"Results of {results.at('created').text()}; {versions}.",
        *made_of,
        f"results.json: sha256 {results.sha256}.",
    )


def _head(results: Entry) -> tuple[str, ...]:
    return (
        *origin(results),
        "Units are SI, temperatures in degC. Axes are those of the recordings, in the order x, y, z.",
        "Rows of a matrix are axes of the reading, columns axes of the true vector.",
        "std are standard errors of one sigma, 0 where a parameter is fixed.",
    )


def _calibration(entry: Entry, unit: str) -> tuple[list[str], list[Value]]:
    """Notes and values of a calibration; its bias and matrix are always there."""
    notes = [f"Method: {entry.at('method').text()}."]
    same_unit(entry.at("unit"), unit)
    if entry.get("soft_iron").value is not None:
        return _magnetometer(entry, unit, notes)
    if entry.get("gravity").value is not None:
        source = entry.get("gravity_source")
        what = f" ({source.text()})" if source.value is not None else ""
        notes.append(f"Gravity: {entry.get('gravity').number()!r} m/s^2{what}.")
    matrix = entry.at("matrix").array(3, 3)
    values = [
        Value("bias", entry.at("bias").array(3), f"{unit}, reading where the true vector is zero"),
        Value("matrix", matrix, "1, scale factors on the diagonal, misalignments in rad off it"),
        Value("inverse_matrix", inverse(entry.at("matrix"), matrix), "1, inverse of matrix"),
    ]
    sensitivity, minus = entry.get("g_sensitivity"), ""
    if sensitivity.value is not None:
        minus = " - g_sensitivity * acceleration"
        unit_g = f"{unit} per m/s^2"
        values.append(Value("g_sensitivity", square(sensitivity), f"{unit_g}, added to a reading"))
    elif unit == "rad/s":
        notes.append("Sensitivity to acceleration: not visible.")
    plus = minus.replace("-", "+")
    notes += [f"raw = matrix * true + bias{plus}", f"true = inverse_matrix * (raw - bias{minus})"]
    if minus:
        notes.append("acceleration: the accelerometer's corrected reading in the same axes, m/s^2.")
    values += _standard_errors(entry, unit)
    values += _temperature(entry, unit, notes)
    return notes, values


def _magnetometer(entry: Entry, unit: str, notes: list[str]) -> tuple[list[str], list[Value]]:
    hard_iron, soft_iron = entry.at("hard_iron").array(3), entry.at("soft_iron").array(3, 3)
    values = [
        Value("hard_iron", hard_iron, f"{unit}, subtracted from a reading"),
        Value("soft_iron", soft_iron, "1, multiplies a reading less hard_iron"),
    ]
    if (field := entry.get("field")).value is not None:
        values.append(Value("field", field.number(), f"{unit}, length of a corrected reading"))
    values += _standard_errors(entry, unit)
    notes += [*field_notes(entry), IRON]
    if turn_deg(entry) is not None:
        matrix = entry.at("alignment").at("matrix").array(3, 3)
        values.append(Value("alignment", matrix, "1, v_magnetometer = alignment * v_accelerometer"))
        notes += [
            "A corrected reading is in the magnetometer's own axes:",
            "transpose(alignment) * corrected is in the accelerometer's.",
        ]
    return notes, values


def turn_deg(entry: Entry) -> list[float] | None:
    """The rotation vector of a magnetometer's axes from the accelerometer's; None where not known."""
    turn = entry.get("alignment").get("turn_deg")
    return None if turn.value is None else turn.array(3)


def field_notes(entry: Entry) -> list[str]:
    """What is known of the field's strength, of which a magnetometer's calibration takes its scale."""
    notes = []
    if (source := entry.get("field_source")).value not in (None, ""):
        notes.append(f"Field: {source.text()}.")
    if entry.get("field_known").value is False:
        notes.append("The field's strength is not known: soft_iron is relative, of determinant 1.")
    return notes


def _standard_errors(entry: Entry, unit: str) -> list[Value]:
    std, factor = entry.get("std"), entry.get("interval_factor")
    interval = ""
    if factor.value is not None:
        interval = f"; the 95 % interval is value +- {factor.magnitude():.4g} std"
    values = []
    for name, of, read in (
        ("bias", unit, _vector),
        ("matrix", "1", square),
        ("g_sensitivity", f"{unit} per m/s^2", square),
        ("hard_iron", unit, _vector),
        ("soft_iron", "1", square),
        ("field", unit, Entry.number),
    ):
        error = std.get(name)
        if error.value is None or entry.get(name).value is None:
            continue
        numbers = read(error)
        if np.min(numbers) < 0:
            raise error.wrong("holds a standard error below 0")
        values.append(Value(f"{name}_std", numbers, of + interval))
    return values


def _temperature(entry: Entry, unit: str, notes: list[str]) -> list[Value]:
    """The calibration's temperature, and how matrix and bias change with it."""
    change, reference = entry.get("temperature"), entry.get("reference_temperature")
    if change.value is None and reference.value is None:
        return []
    if (spelling := entry.get("temperature_unit")).value is not None:
        same_unit(spelling, "degC")
    values = [
        Value("reference_temperature", reference.number(), "degC, at which matrix and bias hold")
    ]
    if change.value is None:
        return values
    notes += [
        "matrix(T) = matrix + sum over k = 1, 2 ... of matrix_coefficients[k-1]"
        " * (T - reference_temperature)^k,",
        "bias(T) alike; outside temperature_range the values at its edge hold.",
    ]
    values.append(Value("temperature_range", _range(change.at("range")), "degC"))
    biases, matrices = change.at("bias_coefficients"), change.at("matrix_coefficients")
    degree = _length(biases)
    values.append(Value("bias_coefficients", biases.array(degree, 3), f"{unit} per degC^k"))
    values.append(Value("matrix_coefficients", matrices.array(degree, 3, 3), "1 per degC^k"))
    return values


def _thermal(entry: Entry, unit: str) -> tuple[list[str], list[Value]]:
    """The change of a reading at rest with temperature, an axis at a time."""
    notes, values = [], []
    for axis in AXES:
        model = entry.at(axis)
        if model.value is None:
            notes.append(f"Thermal model of axis {axis}: none.")
            continue
        same_unit(model.at("temperature_unit"), "degC")
        several = model.get("segments").value is not None
        parts = model.at("segments").items() if several else [model]
        ranges = [_range(part.at("range")) for part in parts]
        ends = [end for pair in ranges for end in pair]
        if not ends or ends != sorted(ends):
            raise model.at("segments").wrong("holds no ranges in ascending order")
        lists = [part.at("coefficients").array(_length(part.at("coefficients"))) for part in parts]
        longest = max(map(len, lists))
        padded = [numbers + [0.0] * (longest - len(numbers)) for numbers in lists]
        reference = model.at("reference_temperature").number()
        values += [
            Value(f"thermal_{axis}_reference_temperature", reference, "degC"),
            Value(f"thermal_{axis}_ranges", ranges, "degC"),
            Value(f"thermal_{axis}_coefficients", padded, f"{unit} per degC^k"),
        ]
    if values:
        notes = [*THERMAL, *notes]
    return notes, values


def same_unit(entry: Entry, unit: str) -> None:
    """Raises `InputError` where the entry is not this spelling of a unit."""
    if entry.text() != unit:
        raise entry.wrong(f"{entry.value!r} is not {unit!r}")


def inverse(entry: Entry, matrix: list[list[float]]) -> list[list[float]]:
    """The inverse of a matrix (3, 3), which `entry` is."""
    try:
        found = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        found = np.full((3, 3), np.inf)
    if not np.isfinite(found).all():
        raise entry.wrong("has no inverse")
    return found.tolist()


def _vector(entry: Entry) -> list[float]:
    return entry.array(3)


def square(entry: Entry) -> list[list[float]]:
    """(3, 3), of which three numbers are the diagonal."""
    diagonal = not any(isinstance(item.value, list) for item in entry.items())
    return np.diag(entry.array(3)).tolist() if diagonal else entry.array(3, 3)


def _range(entry: Entry) -> list[float]:
    low, high = entry.array(2)
    if low > high:
        raise entry.wrong("ends below its start")
    return [low, high]


def _length(entry: Entry) -> int:
    """The number of entries of a list, which is not empty."""
    if not entry.items():
        raise entry.wrong("is empty")
    return len(entry.items())
