"""The unit of a sensor's readings: as declared where that can be true, else as their size tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sensorbook.guessing.certainty import HIGH, LOW, MEDIUM, UNKNOWN
from sensorbook.guessing.physics import Rotation, Sphere, converter_step, fit_sphere
from sensorbook.recordings.motion import Blocks, Motion
from sensorbook.units import SENSOR_UNITS, factor

GRAVITY = 9.80665  # m/s², standard gravity (CGPM 1901)
# What the length of a field's reading can be, SI. Gravity on the ground is 9.76 to 9.83 m/s², a MEMS
# accelerometer's scale and bias add some per cent; the Earth's field is 22 to 67 µT, hard iron adds.
_ACCELERATION = (0.9 * GRAVITY, 1.1 * GRAVITY)
_EARTH_FIELD = (22e-6, 67e-6)
_NEAR_IRON = (10e-6, 200e-6)
# At rest a gyroscope reads its bias and noise: industrial MEMS a few deg/s and below a few tenths
# rms, the best fibre optic ones some 1e-6 deg/s.
_BIAS = np.radians(8.0)
_NOISE = (np.radians(1e-5), np.radians(2.0))
_IMPLAUSIBLE = np.radians(60.0)  # as a bias or noise, whatever the file says
_FASTEST = np.radians(6000.0)  # rad/s, beyond the range of the fastest gyroscopes on the market

_UNITS = {
    "accelerometer": ("m/s^2", "g", "mg"),
    "gyroscope": ("deg/s", "rad/s", "mrad/s", "mdps", "deg/h"),
    "magnetometer": ("uT", "gauss", "mG", "nT", "mT", "T"),
}
# Full scales over 2^15 and the sensitivities of common datasheets, deg/s a count: TDK InvenSense
# (131, 65.5, 32.8, 16.4 counts a deg/s), ST (4.375 to 140 mdps), Bosch and others (full scale / 2^15).
_GYROSCOPE_STEPS = (
    *(f / 2**15 for f in (125, 245, 250, 500, 1000, 2000, 4000)),
    *(1 / c for c in (131, 65.5, 32.8, 16.4, 262.4, 131.2, 65.6)),
    *(m * 1e-3 for m in (4.375, 8.75, 17.5, 35, 140)),
)


@dataclass(frozen=True)
class Unit:
    """A unit as `device.toml` has it: `scale` goes with counts."""

    unit: str
    certainty: str
    reason: str
    scale: dict | None = None

    @property
    def si(self) -> float:
        """SI value of one unit of the reading; NaN where it is not known."""
        if self.certainty == UNKNOWN:
            return np.nan
        if self.scale:
            return self.scale["factor"] * factor(self.scale["unit"], _si_of(self.scale["unit"]))
        return factor(self.unit, _si_of(self.unit))


def accelerometer(values: np.ndarray, declared: str, motion: Motion, sphere: Sphere) -> Unit:
    """Unit of accelerometer readings (N, 3), their offset removed; `declared` is "" for none."""
    length, where = field_length(values, motion, sphere)

    def fits(unit: str) -> bool:
        low, high = _ACCELERATION
        return low <= length * factor(unit, "m/s^2") <= high

    measured = f"gravity reads {length:.4g} {where}"
    if declared and declared != "counts":
        if fits(declared):
            return Unit(declared, HIGH, f"the file says so, and {measured}")
        other = next((u for u in _UNITS["accelerometer"] if fits(u)), None)
        if other:
            return Unit(other, MEDIUM, f"the file says {declared}, but {measured}: that is {other}")
        return Unit(declared, LOW, f"the file says so, but {measured}, which is not 1 g: "
                                   "scaled, or without gravity?")  # fmt: skip
    if found := next((u for u in _UNITS["accelerometer"] if fits(u)), None):
        if found == "mg" and _whole(values):
            return Unit(found, LOW, f"{measured}: whole numbers, this may be mg or counts")
        return Unit(found, HIGH, f"{measured}: that is {'' if found == 'g' else '1 g in '}{found}")
    if _whole(values) and length > 20:
        scale = {"factor": float(f"{GRAVITY / length:.4g}"), "unit": "m/s^2"}
        reason = (
            f"whole numbers, and {measured}, taken as 1 g: right to the few per cent by which a raw "
            "sensor errs; the datasheet knows better"
        )
        return Unit("counts", MEDIUM, reason, scale)
    return Unit("m/s^2", UNKNOWN, f"{measured}, which is 1 g in no common unit")


def magnetometer(values: np.ndarray, declared: str, motion: Motion, sphere: Sphere) -> Unit:
    """Unit of magnetometer readings (N, 3), their offset removed."""
    length, where = field_length(values, motion, sphere)

    def fits(unit: str, limits=_EARTH_FIELD) -> bool:
        return limits[0] <= length * factor(unit, "T") <= limits[1]

    measured = f"the field reads {length:.4g} {where}"
    if declared and declared != "counts":
        if fits(declared, _NEAR_IRON):
            return Unit(
                declared, HIGH, f"the file says so, and {measured}; the Earth's is 22 to 67 µT"
            )
        if other := next((u for u in _UNITS["magnetometer"] if fits(u)), None):
            return Unit(other, MEDIUM, f"the file says {declared}, but {measured}: as the Earth's "
                                       f"does in {other}")  # fmt: skip
        return Unit(
            declared, LOW, f"the file says so, but {measured}, and the Earth's is 22 to 67 µT"
        )
    if declared == "counts" or (_whole(values) and length > 20):
        return Unit("counts", UNKNOWN, f"whole numbers, and {measured}: the value of a count is "
                    "on the datasheet", {"factor": 1e-7, "unit": "T"})  # fmt: skip
    sure = MEDIUM if not np.isnan(sphere.radius) and sphere.convincing else LOW
    if found := next((u for u in _UNITS["magnetometer"] if fits(u)), None):
        return Unit(found, sure, f"{measured}: as the Earth's, 22 to 67 µT, does in {found}")
    if found := next((u for u in _UNITS["magnetometer"] if fits(u, _NEAR_IRON)), None):
        return Unit(found, LOW, f"{measured}, the Earth's field and some hard iron in {found}")
    return Unit("uT", UNKNOWN, f"{measured}, the Earth's field in no common unit")


def gyroscope(
    values: np.ndarray,
    declared: str,
    motion: Motion,
    rotation: Rotation | None,
    step: float | None,
    beside_si: bool = False,
) -> Unit:
    """Unit of gyroscope readings (N, 3), their offset removed.

    Parameters
    ----------
    rotation : how they explain the turn of a field, where they do
    step : s from sample to sample, None where it is not known
    beside_si : True where an accelerometer beside it reads m/s²: who logs that logs rad/s, too
    """
    if rotation is not None and rotation.convincing and step:
        return _by_rotation(values, declared, rotation, step)
    blocks = Blocks.of(values)
    bias = float(np.linalg.norm(np.median(blocks.means[blocks.quiet], axis=0)))
    noise = blocks.noise / np.sqrt(3)
    fastest = float(np.abs(values).max())
    rest = f"it reads {bias:.3g} at rest, scattering by {noise:.2g}"
    if not motion.still:
        rest = f"it reads up to {fastest:.3g} in motion"
        rest += f", and scatters by {noise:.2g} at rest" if motion.attitudes else ""

    def fits(unit: str) -> bool:
        si = factor(unit, "rad/s")
        if not motion.still and not np.radians(5) < fastest * si < _FASTEST:
            return False
        if not motion.still and not motion.attitudes:  # no rest that could show bias and noise
            return True
        return bias * si < _BIAS and _NOISE[0] < noise * si < _NOISE[1]

    if declared and declared != "counts":
        if fits(declared):
            return Unit(declared, HIGH, f"the file says so, and {rest}")
        si = factor(declared, "rad/s")
        if max(bias, noise) * si < _IMPLAUSIBLE and fastest * si < _FASTEST:
            return Unit(declared, MEDIUM, f"the file says so, though {rest}")
        others = [u for u in _UNITS["gyroscope"] if fits(u) and u != declared]
        by_step = _by_step(values)
        if by_step and fits(by_step[0]):
            return Unit(by_step[0], MEDIUM, f"the file says {declared}, but {rest}; {by_step[1]}")
        what = f"the file says {declared}, but {rest}, which no gyroscope in {declared} does"
        if others:
            rest_of = f"; it may be {_either(others)}"
            return Unit(others[0], LOW, what + rest_of)
        return Unit(declared, LOW, what)
    if declared == "counts" or (_whole(values) and fastest > 20):
        return Unit("counts", UNKNOWN, "whole numbers: the value of a count is on the datasheet, and "
                    "no motion shows it", {"factor": 1.0, "unit": "deg/s"})  # fmt: skip
    if (by_step := _by_step(values)) and fits(by_step[0]):
        return Unit(by_step[0], MEDIUM, f"{by_step[1]}, and {rest}")
    possible = [u for u in _UNITS["gyroscope"] if fits(u)]
    if beside_si and "rad/s" in possible:
        possible = ["rad/s", *(u for u in possible if u != "rad/s")]
        rest += ", beside an accelerometer in m/s²"
    if not possible:
        return Unit("deg/s", UNKNOWN, f"{rest}, as a gyroscope does in no common unit")
    if len(possible) == 1:
        return Unit(possible[0], MEDIUM, f"{rest}, as a gyroscope does in {possible[0]} alone")
    return Unit(possible[0], LOW, f"{rest}: this may be {_either(possible)}")


def _by_rotation(values, declared: str, rotation: Rotation, step: float) -> Unit:
    one = rotation.scale / step  # rad/s
    seen = f"turning, it explains how the field turns where one unit is {np.degrees(one):.3g} deg/s"
    whole = _whole(values)  # counts, unless the file says otherwise
    near = [
        u for u in _UNITS["gyroscope"]
        if abs(np.log(one / factor(u, "rad/s"))) < 0.25 and not whole
    ]  # fmt: skip
    if declared and declared != "counts":
        if abs(np.log(one / factor(declared, "rad/s"))) < 0.25:
            return Unit(declared, HIGH, f"the file says so, and {seen}")
        other = near[0] if near else declared
        return Unit(other, MEDIUM if near else LOW, f"the file says {declared}, but {seen}")
    if near and declared != "counts":
        return Unit(near[0], HIGH, seen)
    known = min(_GYROSCOPE_STEPS, key=lambda s: abs(np.log(s / np.degrees(one))))
    if whole and abs(known / np.degrees(one) - 1) < max(0.01, 2 * rotation.error / rotation.scale):
        scale = {"factor": float(f"{known:.6g}"), "unit": "deg/s"}
        return Unit(
            "counts", MEDIUM, f"{seen}; {known:.4g} is a count of a common converter", scale
        )
    scale = {"factor": float(f"{one:.4g}"), "unit": "rad/s"}
    return Unit("counts", MEDIUM, f"{seen}, ± {100 * rotation.error / rotation.scale:.1g} %; "
                "the datasheet knows better", scale)  # fmt: skip


def _by_step(values: np.ndarray) -> tuple[str, str] | None:
    """The unit in which the readings' step is that of a common converter, and what to say of it."""
    found = converter_step(values)
    if not found or np.isclose(np.log10(found) % 1, [0, 1], atol=1e-6).any():
        return None  # none, or that of printing with so many digits
    for unit in ("deg/s", "rad/s", "mrad/s", "mdps"):
        in_degrees = found * factor(unit, "deg/s")
        for known in _GYROSCOPE_STEPS:
            # Converters are read twice as finely (averages of two) in some loggers.
            for part in (1, 2):
                if abs(in_degrees * part / known - 1) < 5e-4:
                    return (
                        unit,
                        f"its step of {found:.6g} is {known:.6g} deg/s of a common converter",
                    )
    return None


def field_length(values: np.ndarray, motion: Motion, sphere: Sphere) -> tuple[float, str]:
    """How long a field reads, and where that was measured."""
    if sphere.convincing:
        return sphere.radius, "in all attitudes"
    blocks = Blocks.of(values)
    means = blocks.means[blocks.quiet] if blocks.quiet.any() else blocks.means
    length = float(np.median(np.linalg.norm(means, axis=1)))
    return length, "at rest" if motion.still or motion.positions else "in the median"


def sphere_of(values: np.ndarray) -> Sphere:
    """The sphere through block means, free of noise."""
    return fit_sphere(Blocks.of(values).means)


def converter_offset(values: np.ndarray) -> float:
    """The middle of an unsigned converter's range that whole readings (N, 3) lie about; 0 for none."""
    if not _whole(values) or values.min() < 0:
        return 0.0
    middle = np.median(values)
    for bits in (16, 12, 14, 10):
        half = 2.0 ** (bits - 1)
        if not 0.5 < middle / half < 1.5 or values.max() >= 2 * half:
            continue
        # Tilted, three axes may all read positive: what is not 16 bits must turn about its middle.
        sphere = sphere_of(values)
        turns = sphere.convincing and np.abs(sphere.centre - half).max() < 0.15 * half
        if turns or (bits == 16 and np.abs(np.median(values, axis=0) / half - 1).max() < 0.4):
            return half
    return 0.0


def _whole(values: np.ndarray) -> bool:
    some = values[:5000]
    return bool((some == np.round(some)).all())


def _either(units) -> str:
    return units[0] if len(units) == 1 else f"{', '.join(units[:-1])} or {units[-1]}"


def _si_of(unit: str) -> str:
    from sensorbook.guessing.names import sensor_of_unit

    return SENSOR_UNITS[sensor_of_unit(unit)]


BY_SENSOR: dict[str, Callable] = {"accelerometer": accelerometer, "magnetometer": magnetometer}
