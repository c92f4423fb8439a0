"""What is odd about readable data: gaps, stamps, missing values, saturation, shocks, units, resolution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.recordings.clock import duration_words, lost_samples, shuffled
from sensorbook.recordings.corruption import IMPLAUSIBLE, frozen, implausible
from sensorbook.recordings.merging import merged
from sensorbook.recordings.recording import Finding, Recording
from sensorbook.units import SENSOR_UNITS

SPIKE_SIGMAS = 10.0
RATE_TOLERANCE = 0.01
SATURATED_SHARE = 1e-3
# Full scales of converters of 8 to 32 bits, signed and unsigned; 0 is no sign of saturation.
_FULL_SCALES = {s for b in (8, 12, 14, 16, 20, 24, 32) for s in (-(2 ** (b - 1)), 2 ** (b - 1) - 1)}
_FULL_SCALES |= {2**b - 1 for b in (8, 12, 14, 16, 20, 24, 32)}
# Magnitude at rest, or typically in motion, that a right unit and scale can give, SI.
_PLAUSIBLE = {
    "accelerometer": (5.0, 15.0, "gravity is 9.8 m/s²"),
    "gyroscope": (0.0, 1.0, "at rest it turns with the Earth, 7.3e-05 rad/s, plus its bias"),
    "magnetometer": (2e-6, 2e-3, "the Earth's field is 2.2e-05 to 6.7e-05 T"),
}


def examine(
    recording: Recording, raw: Sequence[np.ndarray], names: Sequence[str | int]
) -> tuple[Finding, ...]:
    """Everything odd about a recording; `raw` and `names` are its columns as in the file."""
    found: list[Finding] = []
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values are reported, not warned of
        _examine(recording, raw, names, found)
    return tuple(found)


def _examine(recording: Recording, raw, names, found: list[Finding]) -> None:
    def say(kind: str, message: str, where: str = recording.sensor, remedy: str = ""):
        found.append(Finding(recording.file, where, kind, message, remedy))

    _clock(recording, say)
    if recording.sensor in SENSOR_UNITS and recording.rate is not None:
        if message := merged(recording.values, recording.time):
            say("merged", message)
        else:
            _corrupt(recording, say)
    for column, name in zip(raw, names, strict=True):
        where = f"{recording.sensor}, column {name!r}"
        missing = int(np.count_nonzero(~np.isfinite(column)))
        if missing:
            share = 100 * missing / len(column)
            say("nan", f"{missing} of {len(column)} values missing ({share:.2g} %)", where)
        if recording.sensor in SENSOR_UNITS and (message := saturation(column, recording.kind)):
            say("saturated", message, where)
    if recording.kind in ("static", "thermal") and recording.sensor in SENSOR_UNITS:
        _magnitude(
            recording, np.linalg.norm(np.nanmedian(recording.values, axis=0)), "at rest", say
        )
    elif recording.kind == "trajectory" and recording.sensor == "accelerometer":
        force = np.linalg.norm(recording.values, axis=1)
        if np.isfinite(force).any():
            _magnitude(recording, np.nanmedian(force), "typically", say)
    if recording.kind == "static" and recording.sensor in SENSOR_UNITS:
        rows = shocks(recording.values)
        if len(rows):
            say("spike", f"{_samples(len(rows))} beyond {SPIKE_SIGMAS:g} robust standard deviations, "
                         f"{span(recording.time[rows])}")  # fmt: skip
        for axis, column in zip("xyz", recording.values.T, strict=False):
            if step := too_coarse(column):
                size = f"{step:.3g} {recording.unit} on {axis}"
                say("resolution", f"its resolution of {size} is coarser than its noise: what is "
                                  "reported as white noise is that of rounding")  # fmt: skip
    if recording.temperature is not None:
        _temperature(recording.temperature, say)


def _magnitude(recording: Recording, magnitude: float, when: str, say) -> None:
    low, high, why = _PLAUSIBLE[recording.sensor]
    if not low <= magnitude <= high:
        unit = recording.declaration.get("unit", "")
        say("unit", f"reads {magnitude:.3g} {recording.unit} {when}, but {why}: "
                    f"check the unit {unit!r} and the scale")  # fmt: skip


def _corrupt(recording: Recording, say) -> None:
    time = recording.time
    if stretches := frozen(recording.values, recording.rate):
        first, last = max(stretches, key=lambda pair: pair[1] - pair[0])
        longest = ", the longest" if len(stretches) > 1 else ""
        say("corrupt", f"repeats one and the same reading at {_places(len(stretches))}{longest} "
                       f"{span(time[first : last + 1])}: frozen")  # fmt: skip
    rows = implausible(recording.values, recording.sensor)
    if len(rows):
        say("corrupt", f"{_samples(len(rows))} beyond {IMPLAUSIBLE[recording.sensor]:g} "
                       f"{recording.unit}, which it cannot have met, {span(time[rows])}")  # fmt: skip


def _temperature(temperature: np.ndarray, say) -> None:
    missing = int(np.count_nonzero(np.isnan(temperature)))
    if missing == len(temperature):
        say("temperature", "its temperature column holds no number: used without temperature")
    elif missing:
        say("temperature", f"{missing} of {len(temperature)} temperatures missing")
    if missing < len(temperature):
        typical = float(np.nanmedian(temperature))
        if not -100 <= typical <= 200:
            say("temperature", f"reads {typical:.4g} °C: check temperature_unit")


def _clock(recording: Recording, say) -> None:
    if recording.rate is None or "time" not in recording.declaration.get("columns", {}):
        return
    time, declared = recording.time, recording.declaration.get("rate")
    mixed = shuffled(time)  # then what advances by chance tells neither rate nor gaps
    if not mixed and declared is not None and abs(recording.rate / declared - 1) > RATE_TOLERANCE:
        say("rate", f"the time column gives {recording.rate:g} Hz, not the {declared:g} Hz "
                    "declared: the time column is used")  # fmt: skip
    missing = int(np.count_nonzero(~np.isfinite(time)))
    if missing:
        say("nan", f"{_samples(missing)} without a time stamp")
    steps = np.diff(time)
    duplicates = int(np.count_nonzero(steps == 0))
    if duplicates:
        say("duplicate", f"{_samples(duplicates)} with the same time stamp as the one before")
    backward = np.flatnonzero(steps < 0)
    if len(backward):
        say("backward", f"the time goes back at {_places(len(backward))}, first at "
                        f"{time[backward[0]]:.6g} s by {duration_words(-steps[backward[0]])}",
            remedy="sort the rows by time" if mixed else "")  # fmt: skip
    if mixed:
        return
    good, missing = lost_samples(time, recording.rate)
    if missing.any():
        longest = int(np.argmax(missing))
        length = duration_words(time[good[longest + 1]] - time[good[longest]])
        say("gap", f"samples missing at {_places(np.count_nonzero(missing))}, {missing.sum()} in all;"
                   f" the longest gap is {length} at {time[good[longest]]:.6g} s")  # fmt: skip


def saturation(column: np.ndarray, kind: str) -> str:
    """Says that a channel is stuck at its extreme; "" where nothing points to it."""
    finite = column[np.isfinite(column)]
    for name, extreme in (("lowest", finite.min()), ("highest", finite.max())):
        stuck = int(np.count_nonzero(finite == extreme))
        extreme = extreme.item()  # the absolute value of −32768 does not fit 16 bits
        if stuck < max(3, SATURATED_SHARE * len(finite)):
            continue
        limit = float(extreme).is_integer() and int(extreme) in _FULL_SCALES and abs(extreme) > 2000
        # Rests at the end of the range pile up where an instrument is moved between positions.
        if limit or (kind not in ("positions", "six_position") and _piled_up(finite, extreme)):
            share = 100 * stuck / len(finite)
            return f"{stuck} samples ({share:.2g} %) at its {name} value {extreme:g}: saturated"
    return ""


def _piled_up(column: np.ndarray, extreme: float) -> bool:
    """True where the extreme value is far more frequent than the values next to it.

    A wide range is needed to tell: coarse counts pile up on few levels by nature.
    """
    levels, counts = np.unique(column, return_counts=True)
    if len(levels) < 50:
        return False
    if extreme == levels[0]:
        return bool(counts[0] > 10 * counts[1:11].mean())
    return bool(counts[-1] > 10 * counts[-11:-1].mean())


def too_coarse(column: np.ndarray) -> float:
    """Smallest step between the values where the noise is below half of it, else 0.

    The noise is that of neighbouring samples, so that no drift counts, as the median over blocks of
    about a hundred, so that no shock does. Rounding adds step²/12 to its variance.
    """
    step, change = _resolution(column), np.diff(column[np.isfinite(column)])
    if not step:
        return 0.0
    first = np.linspace(0, len(change), max(1, len(change) // 100), endpoint=False).astype(np.intp)
    squares = np.add.reduceat(change**2, first) / np.diff(first, append=len(change))
    variance = float(np.median(squares)) / 2
    return step if variance < step**2 * (1 / 4 + 1 / 12) else 0.0


def shocks(values: np.ndarray) -> np.ndarray:
    """Rows of (N, k) values farther than `SPIKE_SIGMAS` robust deviations from the median."""
    rows = np.zeros(len(values), dtype=bool)
    for column in values.T:
        deviation = np.abs(column - np.nanmedian(column))
        scale = 1.4826 * np.nanmedian(deviation)
        floor = _resolution(column)  # coarse counts: most samples may equal the median
        with np.errstate(invalid="ignore"):
            rows |= deviation > SPIKE_SIGMAS * max(scale, floor)
    return np.flatnonzero(rows)


def _resolution(column: np.ndarray) -> float:
    """Smallest difference between values of the first 10 000 samples."""
    steps = np.diff(np.unique(column[:10_000][np.isfinite(column[:10_000])]))
    steps = steps[steps > 1e-9 * np.nanmax(np.abs(column))]  # not the rounding of a conversion
    return float(steps.min()) if len(steps) else 0.0


def _samples(count: int) -> str:
    return "1 sample" if count == 1 else f"{count} samples"


def _places(count: int) -> str:
    return "1 place" if count == 1 else f"{count} places"


def span(times: np.ndarray) -> str:
    """Words for the stretch from the first to the last of these times (s)."""
    first, last = np.nanmin(times), np.nanmax(times)
    return f"at {first:.6g} s" if first == last else f"from {first:.6g} s to {last:.6g} s"
