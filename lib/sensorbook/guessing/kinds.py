"""The kind of a recording, by what its sensors saw; and the sense of a reference attitude."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.errors import Refusal
from sensorbook.guessing.certainty import HIGH, LOW, MEDIUM, Guess
from sensorbook.guessing.columns import Column
from sensorbook.guessing.names import words_of
from sensorbook.guessing.sensors import Triple
from sensorbook.recordings.motion import Blocks, Motion, of_field

SWEEP = 5.0  # °C: less does not determine a thermal model
THINNED = 3000  # readings that tell whether a motion suits a magnetometer's calibration
MOST = 60.0  # % of the sphere


def kind_of(
    sensor: str,
    triples: Mapping[str, Triple],
    temperature: Column | None,
    swept: float,
    attitude: bool,
) -> Guess:
    """Kind of the recording of one sensor.

    Parameters
    ----------
    triples : all sensors of its table
    temperature : the table's, or None
    swept : °C that a temperature of a table of its own runs through
    attitude : True where the table holds a reference attitude
    """
    motion, by = _motion(triples)
    told = f"the {by} stays at rest throughout"
    if np.isfinite(motion.turn):
        told = f"the {by} keeps its direction within {motion.turn:.1f}°"
    if motion.still:
        if temperature is not None:
            values = temperature.values
            swept = float(np.nanquantile(values, 0.99) - np.nanquantile(values, 0.01))
        if swept >= SWEEP:
            return Guess(
                "kind",
                "thermal",
                MEDIUM,
                f"{told}, and the temperature runs through {swept:.1f} °C",
            )
        return Guess("kind", "static", HIGH if np.isfinite(motion.turn) else MEDIUM, told)
    if attitude:
        return Guess("kind", "trajectory", HIGH, "it moves, and an attitude stands beside it")
    if motion.positions and sensor != "magnetometer":
        share = 100 * motion.rest_share
        rests = f"{motion.attitudes} rests in different attitudes, {share:.0f} % of the time"
        if by == "gyroscope":
            return Guess("kind", "positions", LOW, f"{motion.attitudes} rests between motions; the "
                         "gyroscope alone does not show whether the attitude differs")  # fmt: skip
        if set(triples) == {"accelerometer"} and _six_faces(triples["accelerometer"]):
            return Guess("kind", "six_position", MEDIUM, "six rests, each axis up and down once")
        return Guess("kind", "positions", MEDIUM, rests)
    if "gyroscope" in triples and not (sensor == "magnetometer" and motion.positions):
        seen = _seen_all_round(triples[sensor]) if sensor == "magnetometer" else 0.0
        if seen > MOST:
            return Guess("kind", "rotation", MEDIUM, f"it turns, and sees its field in {seen:.0f} % of "
                         "all directions, which calibrates it")  # fmt: skip
        return Guess("kind", "trajectory", MEDIUM, "it moves, with few rests or none")
    return Guess("kind", "rotation", MEDIUM, f"it turns, and no gyroscope goes with it: {motion.turn:.0f}° "
                 "about its middle direction" if sensor != "magnetometer" or "gyroscope" not in triples
                 else "a magnetometer moved between rests")  # fmt: skip


def _seen_all_round(magnetometer: Triple) -> float:
    """% of the sphere in which its field lies by turns; 0 where the readings do not determine that."""
    from sensorbook.magnetometer import calibrate  # only here: most logs hold no moved magnetometer

    values = magnetometer.finite
    try:
        found = calibrate(values[:: -(-len(values) // THINNED)])
    except Refusal:
        return 0.0
    return found.coverage.percent if found.method == "ellipsoid" else 0.0


def _motion(triples: Mapping[str, Triple]) -> tuple[Motion, str]:
    """What the sensors of one table saw together, and which of them told it."""
    rate = triples.get("gyroscope")
    for sensor in ("accelerometer", "magnetometer"):
        triple = triples.get(sensor)
        if triple is None:
            continue
        motion = triple.as_field
        if not motion.still and rate is not None and len(rate.finite) == len(triple.finite):
            motion = of_field(triple.finite, Blocks.of(rate.finite).quiet)
        if motion.still and rate is not None and _turns_about_the_field(rate):
            return rate.as_rate, "gyroscope"
        return motion, sensor
    return rate.as_rate, "gyroscope"


def _turns_about_the_field(rate: Triple) -> bool:
    """True where a gyroscope turns though gravity does not: about the vertical."""
    return not rate.as_rate.still


def _six_faces(triple: Triple) -> bool:
    """True for six rests with each axis up and down once, within 15°."""
    motion = triple.as_field
    if motion.attitudes != 6:
        return False
    blocks = Blocks.of(triple.finite)
    means = blocks.means[blocks.quiet]
    directions = means / np.linalg.norm(means, axis=1)[:, None]
    level = directions[np.abs(directions).max(axis=1) > np.cos(np.radians(15))]
    axis = np.abs(level).argmax(axis=1)
    sign = np.sign(level[np.arange(len(level)), axis])
    return len(set(zip(axis.tolist(), sign.tolist(), strict=True))) == 6


def quaternion_of(
    columns: Sequence[Column], gyroscope: Triple | None
) -> tuple[dict, str, Guess] | None:
    """Columns, sense and how sure, of an attitude; None where neither names nor a gyroscope tell.

    The gyroscope decides among scalar first or last and the two senses: its turns in the body's axes
    must equal those between attitudes.
    """
    names = [c.named.axis for c in columns]
    orders = [tuple(names)] if sorted(names) == ["w", "x", "y", "z"] else [
        ("w", "x", "y", "z"), ("x", "y", "z", "w")]  # fmt: skip
    sense = _named_sense(columns)
    if gyroscope is not None and len(gyroscope.values) == len(columns[0].values):
        fits = [
            (_agreement(columns, order, s, gyroscope.values), order, s)
            for order, s in itertools.product(orders, ("body_to_reference", "reference_to_body"))
        ]
        fits.sort(reverse=True)
        best, order, found = fits[0]
        if best > 0.5 and best > fits[1][0] + 0.2:
            sure = HIGH if best > 0.8 else MEDIUM
            reason = f"it turns as the gyroscope does (correlation {best:.2f}) only so read"
            if sense and sense != found:
                sure, reason = LOW, f"{reason}, though its name says {sense}"
            columns = {axis: c.reference for axis, c in zip(order, columns, strict=True)}
            return columns, found, Guess("quaternion", found, sure, reason)
    if sense and len(orders) == 1:
        columns = {axis: c.reference for axis, c in zip(orders[0], columns, strict=True)}
        return columns, sense, Guess("quaternion", sense, MEDIUM, "its name says so")
    return None


def _named_sense(columns: Sequence[Column]) -> str:
    """`sensor_to_ENU` and the like in a column's name."""
    body = {"sensor", "body", "imu", "b", "s"}
    for column in columns:
        words = words_of(column.name)
        if "to" in words[1:-1]:
            at = words.index("to", 1)
            if words[at - 1] in body:
                return "body_to_reference"
            if words[at + 1] in body:
                return "reference_to_body"
    return ""


def _agreement(columns, order, sense: str, rate: np.ndarray) -> float:
    """Correlation of the gyroscope's turns with those of the attitude so read."""
    by_axis = dict(zip(order, columns, strict=True))
    q = np.stack([by_axis[axis].values for axis in "xyzw"], axis=1)
    good = np.isfinite(q).all(axis=1) & np.isfinite(rate).all(axis=1)
    good &= np.linalg.norm(np.nan_to_num(q), axis=1) > 0.5
    both = np.flatnonzero(good[1:] & good[:-1])
    if len(both) < 50:
        return 0.0
    q = np.where(good[:, None], q, [0, 0, 0, 1.0])
    attitude = Rotation.from_quat(q)
    if sense == "reference_to_body":
        attitude = attitude.inv()
    turned = (attitude[both].inv() * attitude[both + 1]).as_rotvec()
    omega = rate[both] - np.median(rate[both], axis=0)
    lag = 5  # smoothed alike: attitudes of cameras are noisy from frame to frame
    kernel = np.ones(lag) / lag
    smooth = [np.apply_along_axis(np.convolve, 0, v, kernel, "same") for v in (turned, omega)]
    return float(np.corrcoef(smooth[0].ravel(), smooth[1].ravel())[0, 1])
