"""What the name of a column says: sensor, axis, unit, or that it is a time, a temperature, a counter.

>>> read_name("gyro_x [deg/s]")
Named(role='axis', sensor='gyroscope', axis='x', unit='deg/s', group='gyro')
>>> read_name("linear_acceleration.y").sensor
'accelerometer'
"""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass

from sensorbook.units import SENSOR_UNITS, UnitError, factor


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_SENSOR_WORDS = {
    "accelerometer": "acc accel accelerometer acceleration accelerations specificforce sf fb "
    "linearacceleration linacc",
    "gyroscope": "gyr gyro gyroscope gyroscopes gyros omega angularvelocity angularrate angvel "
    "rotationrate turnrate rateofturn wib angrate",
    "magnetometer": "mag magn magnet magnetometer magnetic magneticfield compass magfield bfield "
    "hmc5883l",
}
_SENSORS = {word: sensor for sensor, words in _SENSOR_WORDS.items() for word in words.split()}
# One letter before the axis: gx, wx, ax, mx, bx.
_LETTERS = {"a": "accelerometer", "g": "gyroscope", "w": "gyroscope", "m": "magnetometer",
            "b": "magnetometer"}  # fmt: skip
_TIME = _words(
    "t ts time times timestamp timestamps stamp sec secs second seconds ms millis msec us "
    "usec ns nsec nanoseconds microseconds milliseconds epoch date datetime elapsed clock tow "
    "unixtime utc"
)
_TEMPERATURE = _words("temp temps temperature temperatures tmp degc celsius thermistor")
_COUNTER = _words(
    "n nr no index idx count counter sample samples packet packetcounter seq sequence row id "
    "frame nsamples samplenumber"
)
_QUATERNION = _words("q quat quaternion orientation attitude rotationvector")
# Derived quantities and other instruments, which share words or axes with what is looked for.
_OTHER = _words(
    "roll pitch yaw heading euler vel velocity pos position lat latitude lon longitude alt "
    "altitude height pressure baro speed gps gnss humidity light lux battery volt voltage "
    "current cov covariance std sigma variance label activity movement user gravity offset "
    "bias raw_adc status accuracy ref reference tau dev adev delta integral"
)
_G_FORCE = re.compile(r"gF([xyz])")  # Physics Toolbox, and beside it the totals of three axes:
_TOTALS = ("TgF", "gFTotal", "aT", "wT", "BT")
_AXES = {"x": "x", "y": "y", "z": "z"}
_NUMBERED = {"0": "x", "1": "y", "2": "z"}
_UNIT_TAILS = {  # tokens at the end of a name
    "m s2": "m/s^2", "m s 2": "m/s^2", "mps2": "m/s^2", "ms2": "m/s^2", "mss": "m/s^2",
    "m s s": "m/s^2", "mg": "mg", "g": "g", "rad s": "rad/s", "rads": "rad/s", "radps": "rad/s",
    "rad sec": "rad/s", "deg s": "deg/s", "degs": "deg/s", "degps": "deg/s", "dps": "deg/s",
    "deg sec": "deg/s", "mdps": "mdps", "deg h": "deg/h", "dph": "deg/h", "mrad s": "mrad/s",
    "u t": "uT", "ut": "uT", "n t": "nT", "nt": "nT", "gauss": "gauss", "gs": "gauss",
    "mgauss": "mgauss", "microtesla": "uT", "tesla": "T", "s": "s", "sec": "s", "secs": "s",
    "seconds": "s", "ms": "ms", "msec": "ms", "millis": "ms", "us": "us", "usec": "us",
    "micros": "us", "ns": "ns", "nsec": "ns", "nanoseconds": "ns", "microseconds": "us",
    "milliseconds": "ms", "deg c": "degC", "degc": "degC", "c": "degC", "celsius": "degC",
    "k": "K", "f": "degF", "degf": "degF", "deg f": "degF", "h": "h", "hours": "h", "min": "min",
    "minutes": "min", "lsb": "counts", "counts": "counts", "adc": "counts", "raw": "counts",
}  # fmt: skip


@dataclass(frozen=True)
class Named:
    """What a name says; "" for what it does not say.

    Attributes
    ----------
    role : "time", "temperature", "counter", "axis", "quaternion", "other" (something else) or ""
    sensor : where it is an axis of one
    axis : "x", "y", "z" or "w"
    unit : as units.py spells it, or "counts"
    group : what is left of the name without axis and unit: columns of one sensor share it
    """

    role: str = ""
    sensor: str = ""
    axis: str = ""
    unit: str = ""
    group: str = ""


def read_name(name: str) -> Named:
    """What a column's name says."""
    if force := _G_FORCE.fullmatch(name):
        return Named("axis", "accelerometer", force[1], "g", "gF")
    if name in _TOTALS:
        return Named("other")
    name, bracketed = _without_bracket(name)
    tokens = _tokens(name)
    unit = bracketed or ""
    while not unit and len(tokens) > 1:  # at the end, but never all there is
        tail = next((n for n in (3, 2, 1) if n < len(tokens) and _tail(tokens, n)), 0)
        if not tail or _tail_is_name(tokens, tail):
            break
        unit, tokens = _UNIT_TAILS[_tail(tokens, tail)], tokens[:-tail]
    words = set(tokens)
    joined = "".join(tokens)
    axis, rest = _axis(tokens)
    sensor = sensor_in(rest) if axis else sensor_in(tokens)
    if axis and not sensor and rest and (stem := re.sub(r"\d+$", "", rest[-1])) in _LETTERS:
        sensor = _LETTERS[stem]  # gx, imu0_gx, gx2
    if axis and not sensor and rest and rest[0] in ("a", "w") and len(rest) > 1:
        sensor = _LETTERS[rest[0]]  # EuRoC: w_RS_S_x
    group = "_".join(rest)
    if axis and (words & _QUATERNION or rest[:1] == ["q"]):
        return Named("quaternion", "", axis, "", group)
    own = {a for a, b in itertools.pairwise(rest) if a + b in _SENSORS}
    own |= {b for a, b in itertools.pairwise(rest) if a + b in _SENSORS}
    if axis in ("x", "y", "z") and sensor and not (words - own) & _OTHER:
        return Named("axis", sensor, axis, unit, group)
    if words & _TEMPERATURE or unit in ("degC", "K", "degF"):
        return Named("temperature", sensor, "", unit)
    if axis and axis != "w" and not words & _OTHER:
        guessed = sensor_of_unit(unit)
        if guessed or not rest:
            return Named("axis", guessed, axis, unit, group)
    if words & _OTHER:
        return Named("other", "", axis, unit, group)
    if joined == "sampletimefine":  # Xsens: counts 0.1 ms, which no unit of time spells
        return Named("counter")
    if words & _TIME or joined in _TIME:
        return Named("time", "", "", unit if _is(unit, "s") else _time_word(tokens))
    if joined in _COUNTER or (words & _COUNTER and not sensor):
        return Named("counter")
    return Named("", sensor, axis, unit, group)


def sensor_in(words) -> str:
    """The sensor that some words (of a name, in order) speak of; "" for none or several."""
    words = [re.sub(r"\d+$", "", w) for w in words]
    pairs = [a + b for a, b in itertools.pairwise(words)] + ["".join(words)]
    found = {_SENSORS[w] for w in (*words, *pairs) if w in _SENSORS}
    if len(found) != 1:
        glued = {s for w in words for word, s in _SENSORS.items() if len(word) > 3 and word in w}
        found = found or glued
    return found.pop() if len(found) == 1 else ""


def sensor_of(text: str) -> str:
    """The sensor that a file's or a table's name speaks of; "" for none or several."""
    return sensor_in(_tokens(text))


def sensor_of_unit(unit: str) -> str:
    """The sensor that measures in this unit; "" where none does."""
    return next((s for s, si in SENSOR_UNITS.items() if _is(unit, si)), "")


def words_of(name: str) -> list[str]:
    """The words of a name, in lower case."""
    return _tokens(name)


def _is(unit: str, si: str) -> bool:
    try:
        return bool(unit) and bool(factor(unit, si))
    except UnitError:
        return False


def unit_of(text: str) -> str:
    """A unit as a file spells it, if it is one of a sensor, a time or a temperature; else ""."""
    text = text.strip().strip("()[]").strip()
    text = re.sub(r"\s+s\^?-(\d)", lambda m: "/s^" + m[1] if m[1] != "1" else "/s", text)
    if text.lower() in ("counts", "lsb", "adc", "raw"):
        return "counts"
    for si in (*SENSOR_UNITS.values(), "s", "degC"):
        if _is(text, si):
            return text
    return ""


def _without_bracket(name: str) -> tuple[str, str]:
    """The name without a unit in brackets or after a slash or comma, and that unit."""
    for pattern in (r"[\[(]([^\])]*)[\])]\s*$", r"[\[(]([^\])]*)[\])]"):
        if (found := re.search(pattern, name)) and (unit := unit_of(found[1])):
            return (name[: found.start()] + name[found.end() :]).strip(), unit
    return name, ""


def _tokens(name: str) -> list[str]:
    name = name.replace("µ", "u").replace("μ", "u").replace("²", "2").replace("°", "deg")
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)  # accX, GyroX
    name = re.sub(r"([A-Z]{2,})([XYZ])\b", r"\1 \2", name)  # ACCX
    return [t.lower() for t in re.split(r"[^A-Za-z0-9]+", name) if t]


def _tail(tokens: list[str], count: int) -> str:
    tail = " ".join(tokens[-count:])
    return tail if tail in _UNIT_TAILS else ""


def _tail_is_name(tokens: list[str], count: int) -> bool:
    """True where the last words name the thing itself: `raw_g`, `time_s` have units, `mag_c` …"""
    return not any(len(t) > 1 or t in "xyztw" for t in tokens[:-count])


def _axis(tokens: list[str]) -> tuple[str, list[str]]:
    """The axis, and the words without it; "" where there is none."""
    for at in (len(tokens) - 1, 0, *range(1, len(tokens) - 1)):
        if 0 <= at < len(tokens) and tokens[at] in ("x", "y", "z", "w"):
            alone = len(tokens) == 1
            if tokens[at] == "w" and (alone or at == 0):
                continue
            return tokens[at], tokens[:at] + tokens[at + 1 :]
    for at in (len(tokens) - 1, 0):  # gyrox, ax, xacc
        if at < 0 or not tokens:
            break
        token = re.sub(r"\d+$", "", tokens[at]) or tokens[at]
        digits = tokens[at][len(token) :]  # of a second sensor: gx2
        others = tokens[:at] + tokens[at + 1 :]
        if (end := token[-1:]) in ("x", "y", "z", "w") and len(token) > 1:
            stem = token[:-1]
            if stem in _SENSORS or stem in _LETTERS or stem in _QUATERNION:
                return end, [*tokens[:at], stem + digits, *tokens[at + 1 :]]
        if token[:1] in _AXES and token[1:] in _SENSORS:
            return token[0], [token[1:] + digits, *others]
    last = tokens[-1] if tokens else ""
    if len(tokens) > 1 and last in _NUMBERED and (sensor_in(tokens[:-1])):
        return _NUMBERED[last], tokens[:-1]
    return "", tokens


def _time_word(tokens: list[str]) -> str:
    """The unit that a time's name is itself, such as `millis`."""
    return next((_UNIT_TAILS[t] for t in tokens if t in _UNIT_TAILS and _is(_UNIT_TAILS[t], "s")
                 and t != "s"), "")  # fmt: skip
