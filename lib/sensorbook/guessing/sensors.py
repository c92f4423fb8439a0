"""Which sensor three columns are of: by name, else by how the triples of a file explain each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sensorbook.guessing import scales
from sensorbook.guessing.certainty import HIGH, LOW, MEDIUM, UNKNOWN
from sensorbook.guessing.clock import Clock
from sensorbook.guessing.columns import Column
from sensorbook.guessing.names import sensor_of_unit
from sensorbook.guessing.physics import Rotation, Sphere, rotation_scale, rotation_scale_between
from sensorbook.recordings.assemble import ABSURD
from sensorbook.recordings.motion import Blocks, Motion, of_field, of_rate

_GRAVITY_MEANT = {"G": "g", "mG": "mg", "Gs": "g", "gs": "g"}
_EXPLAINED = 0.4  # share of a field's change that makes the other one its gyroscope


@dataclass(eq=False)
class Triple:
    """Three columns that belong together, and what is found out about them.

    Attributes
    ----------
    values : (N, 3) readings less `offset`, NaN where one is missing
    sensor : "" where it cannot be told
    rotation : how this gyroscope explains the turn of a field of the same file
    recorder : the program whose layout the table has, "" where it is not known
    """

    columns: Sequence[Column]
    clock: Clock
    values: np.ndarray
    offset: float
    sensor: str = ""
    certainty: str = UNKNOWN
    reason: str = ""
    rotation: Rotation | None = None
    recorder: str = ""
    _cache: dict = field(default_factory=dict)

    @classmethod
    def of(cls, columns: Sequence[Column], clock: Clock) -> Triple:
        raw = np.stack([c.values for c in columns], axis=1)
        with np.errstate(invalid="ignore"):
            raw[~(np.abs(raw) <= ABSURD).all(axis=1)] = np.nan  # squares of more would overflow
        finite = _finite(raw)
        plain = {c.named.unit for c in columns} <= {"", "counts"}
        offset = scales.converter_offset(finite) if len(finite) and plain else 0.0
        return cls(columns, clock, raw - offset if offset else raw, offset)

    @property
    def finite(self) -> np.ndarray:
        return self._kept("finite", lambda: _finite(self.values))

    @property
    def as_field(self) -> Motion:
        return self._kept("field", lambda: of_field(self.finite))

    @property
    def as_rate(self) -> Motion:
        return self._kept("rate", lambda: of_rate(self.finite))

    @property
    def sphere(self) -> Sphere:
        return self._kept("sphere", lambda: scales.sphere_of(self.finite))

    @property
    def unit(self) -> str:
        """As the file declares it; "" where it does not, or where that is a unit of something else."""
        declared = next((c.named.unit for c in self.columns if c.named.unit), "")
        if self.sensor == "accelerometer":  # G is gauss; of an acceleration it is meant as g
            declared = _GRAVITY_MEANT.get(declared, declared)
        if not self.sensor or declared == "counts":
            return declared
        return declared if sensor_of_unit(declared) == self.sensor else ""

    @property
    def shown(self) -> str:
        return ", ".join(c.shown for c in self.columns)

    def settle(self, sensor: str, certainty: str, reason: str) -> None:
        self.sensor, self.certainty, self.reason = sensor, certainty, reason

    def _kept(self, key: str, make):
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]


def _finite(values: np.ndarray) -> np.ndarray:
    """The rows that are numbers; all of a long record need no copy."""
    good = np.isfinite(values[:, 0])
    return values if good.all() else values[good]


def find_sensors(triples: Sequence[Triple], told: str) -> None:
    """Settles the sensor of every triple of one table, where it can be told.

    `told` is the sensor that the file's or the table's name speaks of, "" for none.
    """
    for triple in triples:
        _by_name(triple, told if len(triples) == 1 else "")
    rotations = _rotations(triples)
    for (rate, turned), rotation in rotations.items():
        if rate.sensor == "gyroscope" or (not rate.sensor and turned.sensor != "gyroscope"):
            share = f"its turns explain {100 * rotation.share:.0f} % of how {turned.shown} change"
            if not rate.sensor:
                rate.settle("gyroscope", HIGH if rotation.convincing else MEDIUM, share)
            if rate.rotation is None or rotation.share > rate.rotation.share:
                rate.rotation = rotation
    fields = {turned for (rate, turned) in rotations if rate.sensor == "gyroscope"}
    for triple in triples:
        if not triple.sensor:
            _by_length(triple, certain_field=triple in fields)
    _by_elimination(triples)


def _by_name(triple: Triple, told: str) -> None:
    names = {c.named.sensor for c in triple.columns if c.named.sensor}
    in_unit = sensor_of_unit(triple.unit)
    given = next((c.named.unit for c in triple.columns if c.named.unit), "")
    if len(names) == 1:
        sensor = names.pop()
        letter = all(len(c.named.group) == 1 for c in triple.columns)
        if sensor == "gyroscope" and letter and _gravity(triple):
            triple.settle("accelerometer", LOW,
                          f"named like a gyroscope, but of constant length: {_gravity(triple)}")  # fmt: skip
        elif (
            in_unit
            and in_unit != sensor
            and not (sensor == "accelerometer" and given in _GRAVITY_MEANT)
        ):
            triple.settle(sensor, LOW, f"its names say so, but its unit is {given}")
        else:
            triple.settle(sensor, HIGH, "its columns are named so")
    elif in_unit:
        triple.settle(in_unit, HIGH, f"it is measured in {triple.unit}")
    elif told:
        triple.settle(told, MEDIUM, "the file is named so")


def _gravity(triple: Triple) -> str:
    """Words for a triple that reads 1 g, in m/s² or g, in several attitudes or long at rest; else ""."""
    length, where = scales.field_length(triple.finite, triple.as_field, triple.sphere)
    tight = triple.sphere.convincing or triple.as_field.still
    near = any(abs(length / one - 1) < 0.03 for one in (scales.GRAVITY, 1.0))
    return f"it reads {length:.4g} {where}" if tight and near else ""


def _rotations(triples: Sequence[Triple]) -> dict[tuple[Triple, Triple], Rotation]:
    """Pairs of a rate and the field that it turns, where one explains the other."""
    found = {}
    for rate in triples:
        if rate.sensor not in ("", "gyroscope"):
            continue
        for turned in triples:
            if turned is rate or turned.sensor == "gyroscope":
                continue
            if len(rate.values) != len(turned.values) or turned.as_field.still:
                continue
            both = np.isfinite(rate.values[:, 0]) & np.isfinite(turned.values[:, 0])
            if both.sum() < 200:
                continue
            omega, vector = rate.values[both], turned.values[both]
            blocks, other = Blocks.of(omega), Blocks.of(vector)
            quiet = blocks.quiet & other.quiet
            bias = np.median(blocks.means[quiet], axis=0) if quiet.sum() > 2 else 0.0
            vector = vector - turned.sphere.centre if turned.sphere.convincing else vector
            rotation = rotation_scale(omega - bias, vector)
            if rotation.share > _EXPLAINED and 0 < rotation.error < 0.2 * rotation.scale:
                rests = of_field(vector, blocks.quiet).rests
                finer = rotation_scale_between(omega - bias, vector, rests, rotation.scale)
                rotation = finer or rotation
                found[rate, turned] = rotation
    # Of two that each seem to turn the other, the one that explains more is the gyroscope.
    return {
        pair: rotation
        for pair, rotation in found.items()
        if rotation.share >= found.get(pair[::-1], rotation).share
    }


def _by_length(triple: Triple, certain_field: bool) -> None:
    """Accelerometer or magnetometer by the length of what it reads, where that can be only one."""
    motion, sphere = triple.as_field, triple.sphere
    if not (motion.still or sphere.convincing or certain_field):
        return
    length, where = scales.field_length(triple.finite, motion, sphere)
    for one, name in ((scales.GRAVITY, "m/s²"), (1.0, "g"), (1000.0, "mg")):
        if abs(length / one - 1) < 0.1:
            sure = HIGH if sphere.convincing and certain_field else MEDIUM
            sure = sure if abs(length / one - 1) < 0.05 else LOW
            triple.settle("accelerometer", sure, f"it reads {length:.4g} {where}: 1 g in {name}")
            return
    earth = [u for u in ("gauss", "uT", "mG", "nT")
             if 22e-6 <= length * scales.factor(u, "T") <= 67e-6]  # fmt: skip
    if earth and (certain_field or sphere.convincing):
        sure = HIGH if certain_field and sphere.convincing else MEDIUM
        triple.settle("magnetometer", sure,
                      f"it reads {length:.4g} {where}: the Earth's field in {earth[0]}")  # fmt: skip
    elif certain_field:
        triple.settle("accelerometer", LOW, f"it reads {length:.4g} {where}, whatever its attitude")


def _by_elimination(triples: Sequence[Triple]) -> None:
    """What is left beside an accelerometer; at rest a constant vector beside noise is gravity."""
    left = [t for t in triples if not t.sensor]
    there = {t.sensor for t in triples}
    if not left:
        return
    if "accelerometer" not in there and len(left) > 1:
        steady = {t: _steadiness(t) for t in left}
        best, second, *_ = sorted(left, key=steady.get, reverse=True)
        if best.as_field.still and steady[best] > 5 * steady[second]:
            best.settle("accelerometer", LOW,
                        "at rest its reading is long against its noise, as gravity is")  # fmt: skip
            left.remove(best)
            there.add("accelerometer")
    if "accelerometer" in there and "gyroscope" not in there and left:
        # Loggers write the gyroscope next to the accelerometer and the magnetometer last.
        left[0].settle("gyroscope", LOW, "it stands beside an accelerometer and reads no gravity")
        left = left[1:]
        there.add("gyroscope")
    if {"accelerometer", "gyroscope"} <= there and "magnetometer" not in there and len(left) == 1:
        left[0].settle("magnetometer", LOW, "it stands beside accelerometer and gyroscope")


def _steadiness(triple: Triple) -> float:
    blocks = Blocks.of(triple.finite)
    return float(np.linalg.norm(np.median(blocks.means, axis=0)) / (blocks.noise or 1e-300))
