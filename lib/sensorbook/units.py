"""One table of unit spellings → SI, and the field units in which results are shown.

Spellings come from users' files, so they are never evaluated: a tokeniser that knows only the names
below builds the unit, and pint converts it and checks its dimension. `g` is standard gravity
(9.80665 m/s²), `G` is gauss (10⁻⁴ T).

>>> factor("deg/h", "angular_rate") == math.radians(1) / 3600
True
>>> round(factor("m/s/√h", "m/s^2/sqrt(Hz)") * 60, 12)
1.0
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache

import numpy as np

SENSOR_UNITS = {"gyroscope": "rad/s", "accelerometer": "m/s^2", "magnetometer": "T"}

QUANTITIES = {
    "angular_rate": "rad/s",
    "acceleration": "m/s^2",
    "magnetic_flux_density": "T",
    "temperature": "degC",
    "time": "s",
}

# name: (definition for pint, further spellings). Names are matched as they stand: mg is not mG.
_DEFINITIONS = {
    "radian": ("[angle]", "rad rads radians"),
    "mrad": ("1e-3 radian", "millirad"),
    "urad": ("1e-6 radian", "microrad"),
    "degree": (f"{math.pi / 180!r} radian", "deg degs degrees"),
    "mdeg": ("1e-3 degree", "millideg"),
    "arcmin": ("degree / 60", ""),
    "arcsec": ("degree / 3600", "as"),
    "revolution": (f"{2 * math.pi!r} radian", "rev revolutions"),
    "second": ("[time]", "s S sec secs seconds"),
    "millisecond": ("1e-3 second", "ms msec milliseconds"),
    "microsecond": ("1e-6 second", "us usec microseconds"),
    "nanosecond": ("1e-9 second", "ns nsec nanoseconds"),
    "minute": ("60 second", "min minutes"),
    "hour": ("3600 second", "h H hr hrs hours"),
    "day": ("86400 second", "d days"),
    "hertz": ("1 / second", "Hz HZ hz"),
    "kilohertz": ("1000 / second", "kHz"),
    "dps": ("degree / second", ""),
    "mdps": ("1e-3 degree / second", ""),
    "dph": ("degree / hour", ""),
    "rpm": ("revolution / minute", ""),
    "meter": ("[length]", "m metre meters metres"),
    "centimeter": ("1e-2 meter", "cm"),
    "millimeter": ("1e-3 meter", "mm"),
    "gravity": ("9.80665 meter / second ** 2", "g gn g0 gee gees"),
    "milligravity": ("1e-3 gravity", "mg mgee"),
    "microgravity": ("1e-6 gravity", "ug ugee"),
    "gal": ("1e-2 meter / second ** 2", "Gal"),
    "milligal": ("1e-5 meter / second ** 2", "mGal mgal"),
    "tesla": ("[magnetic_flux_density]", "T"),
    "millitesla": ("1e-3 tesla", "mT"),
    "microtesla": ("1e-6 tesla", "uT"),
    "nanotesla": ("1e-9 tesla", "nT"),
    "gauss": ("1e-4 tesla", "G Gs Gauss"),
    "milligauss": ("1e-7 tesla", "mG mGs mgauss"),
    "microgauss": ("1e-10 tesla", "uG"),
    "kelvin": ("[temperature]", "K degC celsius Celsius C"),  # differences; offsets are below
    "degF": ("5 / 9 kelvin", "fahrenheit Fahrenheit F"),
    "percent": ("1e-2", "%"),
    "ppm": ("1e-6", ""),
    "dimensionless_one": ("1", ""),
}
_NAMES = {
    spelling: name
    for name, (_, spellings) in _DEFINITIONS.items()
    for spelling in (name, *spellings.split())
}
# Long names are also taken in any case (DEG/S); short ones never: mg is not mG.
_ANY_CASE = {s.lower(): n for s, n in _NAMES.items() if len(s) > 2 and s.islower()}

# Kelvin and Fahrenheit readings → °C: value · factor + offset.
_OFFSETS = {"K": -273.15, "kelvin": -273.15} | dict.fromkeys(
    ("degF", "fahrenheit", "Fahrenheit", "F"), -160 / 9
)

_DESCRIPTIONS = {
    "rad/s": ("an angular rate", "deg/s, rad/s or deg/h"),
    "m/s^2": ("an acceleration", "m/s^2, g or mg"),
    "T": ("a magnetic flux density", "uT, nT, mG or gauss"),
    "degC": ("a temperature", "degC, K or degF"),
    "s": ("a time", "s, ms, us, ns, min or h"),
    "Hz": ("a frequency", "Hz or kHz"),
    "rad": ("an angle", "deg, rad or arcsec"),
    "m/s": ("a velocity", "m/s or mm/s"),
    "T*s": ("a flux density times time", "uT*s or nT*s"),
    "rad/s/sqrt(Hz)": ("an angular random walk", "deg/sqrt(h), deg/s/sqrt(Hz) or rad/s/sqrt(Hz)"),
    "m/s^2/sqrt(Hz)": ("a velocity random walk", "m/s/sqrt(h), mg/sqrt(Hz) or m/s^2/sqrt(Hz)"),
    "T/sqrt(Hz)": ("a flux-density random walk", "nT/sqrt(Hz) or uT/sqrt(Hz)"),
    "rad/s^2/sqrt(Hz)": ("a rate random walk", "deg/h/sqrt(s), deg/h^(3/2) or rad/s^2/sqrt(Hz)"),
    "m/s^3/sqrt(Hz)": ("an acceleration random walk", "m/s/h^(3/2) or m/s^3/sqrt(Hz)"),
    "T/s/sqrt(Hz)": ("a flux-density rate random walk", "nT/s/sqrt(Hz) or nT/sqrt(s)"),
    "rad/s^2": ("an angular acceleration", "deg/h/s, deg/s^2 or rad/s^2"),
    "m/s^3": ("a jerk", "mg/s or m/s^3"),
    "T/s": ("a rate of flux density", "nT/s or uT/s"),
    "1": ("a ratio", "percent, ppm or 1"),
    "percent": ("a ratio", "percent, ppm or 1"),
    "deg": ("an angle", "deg, rad or arcsec"),
}

# quantity: SI unit and field unit of the gyroscope, the accelerometer and the magnetometer
_SENSORS = ("gyroscope", "accelerometer", "magnetometer")
_QUANTITY_UNITS = {
    "signal": (("rad/s", "°/s"), ("m/s^2", "m/s²"), ("T", "µT")),
    "quantization": (("rad", "°"), ("m/s", "m/s"), ("T*s", "µT·s")),
    "random_walk": (
        ("rad/s/sqrt(Hz)", "°/√h"),
        ("m/s^2/sqrt(Hz)", "mg/√Hz"),
        ("T/sqrt(Hz)", "nT/√Hz"),
    ),
    "noise_density": (
        ("rad/s/sqrt(Hz)", "°/s/√Hz"),
        ("m/s^2/sqrt(Hz)", "mg/√Hz"),
        ("T/sqrt(Hz)", "nT/√Hz"),
    ),
    "bias_instability": (("rad/s", "°/h"), ("m/s^2", "mg"), ("T", "nT")),
    "rate_random_walk": (
        ("rad/s^2/sqrt(Hz)", "°/h/√s"),
        ("m/s^3/sqrt(Hz)", "m/s/h³ᐟ²"),
        ("T/s/sqrt(Hz)", "nT/√s"),
    ),
    "rate_ramp": (("rad/s^2", "°/h/s"), ("m/s^3", "mg/s"), ("T/s", "nT/s")),
    "bias": (("rad/s", "°/s"), ("m/s^2", "mg"), ("T", "µT")),
    "scale_factor_error": (("1", "ppm"), ("1", "ppm"), None),
    "misalignment": (("rad", "mrad"), ("rad", "mrad"), None),
    "hard_iron": (None, None, ("T", "µT")),
    "soft_iron": (None, None, ("1", "1")),
    "field": (None, None, ("T", "µT")),
    "field_measured": (None, None, ("T", "µT")),
    "rms_before": (("rad/s", "°/s"), ("m/s^2", "mg"), ("T", "µT")),
    "rms_after": (("rad/s", "°/s"), ("m/s^2", "mg"), ("T", "µT")),
    "rms_check": (("rad/s", "°/s"), ("m/s^2", "mg"), ("T", "µT")),
    "rms_check_recording": (("rad/s", "°/s"), ("m/s^2", "mg"), ("T", "µT")),
    "residual_percent": (None, None, ("percent", "%")),
    "residual_percent_check": (None, None, ("percent", "%")),
    "coverage_percent": (None, None, ("percent", "%")),
    "heading_error_after_deg": (None, None, ("deg", "°")),
}
_CAMERA_UNITS = {  # no limits are set on these
    "solved_percent": ("percent", "%"),
    "earth_direction_std_deg": ("deg", "°"),
    "attitude_std_deg": ("deg", "°"),
    "attitude_error_deg": ("deg", "°"),
}


class UnitError(ValueError):
    """A spelling that is no unit, or a unit of something else; `message` and `mend` say which."""

    def __init__(self, message: str, mend: str):
        self.message, self.mend = message, mend
        super().__init__(f"{message} — {mend}")


@lru_cache(maxsize=1024)
def factor(spelling: str, quantity: str) -> float:
    """Number by which a value in `spelling` is multiplied to give SI.

    Parameters
    ----------
    spelling : unit as users write it, such as "deg/s", "µT", "m/s²" or "deg/√h"
    quantity : "angular_rate", "acceleration", "magnetic_flux_density", "temperature" (a difference,
        in °C; `to_si` knows the offsets), "time", or the SI unit wanted, such as "rad/s/sqrt(Hz)"

    Raises
    ------
    UnitError : the spelling is unknown, or is a unit of another dimension
    """
    target = QUANTITIES.get(quantity, quantity)
    unit = _parse(spelling, target)
    wanted = _parse(target, target)
    if unit.dimensionality != wanted.dimensionality:
        raise _wrong_dimension(spelling, unit, target)
    return float((1 * unit).to(wanted).magnitude)


def to_si(values, spelling: str, si_unit: str) -> np.ndarray:
    """Values in `spelling` as float64 in `si_unit`; for "degC", K and °F are shifted too."""
    scaled = np.asarray(values, dtype=np.float64) * factor(spelling, si_unit)
    if QUANTITIES.get(si_unit, si_unit) == "degC":
        scaled += _OFFSETS.get(_normalise(spelling), 0.0)
    return scaled


def si_unit(sensor: str, quantity: str = "signal") -> str:
    """SI unit of a sensor's quantity, spelled as in results.json.

    >>> si_unit("gyroscope", "quantization")
    'rad'
    """
    return _entry(sensor, quantity)[0]


def field_unit(sensor: str, quantity: str = "signal") -> tuple[str, float]:
    """Label of the unit in which the field states a quantity, and how much SI one such unit is.

    >>> field_unit("accelerometer", "bias_instability")
    ('mg', 0.00980665)
    """
    si, label = _entry(sensor, quantity)
    return label, factor(label, si)


def quantities(sensor: str) -> tuple[str, ...]:
    """Names of the quantities that have a unit for this sensor, one of `SENSOR_UNITS`."""
    if sensor not in _SENSORS:
        raise UnitError(f"{_shown(sensor)} has no units here", f"use one of {', '.join(_SENSORS)}")
    column = _SENSORS.index(sensor)
    return tuple(name for name, units in _QUANTITY_UNITS.items() if units[column])


def _entry(sensor: str, quantity: str) -> tuple[str, str]:
    if sensor == "camera" and quantity in _CAMERA_UNITS:
        return _CAMERA_UNITS[quantity]
    if sensor not in _SENSORS:
        raise UnitError(f"{_shown(sensor)} has no units here", f"use one of {', '.join(_SENSORS)}")
    entry = _QUANTITY_UNITS.get(quantity, (None, None, None))[_SENSORS.index(sensor)]
    if entry is None:
        raise UnitError(
            f"{_shown(quantity)} is not a quantity of the {sensor}",
            f"use one of {', '.join(quantities(sensor))}",
        )
    return entry


@lru_cache(maxsize=1)
def _registry():
    import pint  # 0.1 s: only where a unit is parsed

    # Empty: pint's own table reads g as gram and does not take gauss to tesla.
    registry = pint.UnitRegistry(None)
    for name, (definition, _) in _DEFINITIONS.items():
        registry.define(f"{name} = {definition}")
    return registry


def _shown(value) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…" + text[-1]


def _wrong_dimension(spelling: str, unit, target: str) -> UnitError:
    kind, examples = _DESCRIPTIONS.get(target, (f"a unit of {target}", target))
    what = next(
        (
            d[0]
            for si, d in _DESCRIPTIONS.items()
            if _parse(si, si).dimensionality == unit.dimensionality
        ),
        "a unit of something else",
    )
    mend = f"write {kind} such as {examples}"
    if target == "m/s^2" and (letter := {"G": "g", "mG": "mg", "uG": "ug"}.get(spelling.strip())):
        name = {"g": "gauss", "mg": "milligauss", "ug": "microgauss"}[letter]
        return UnitError(f"{_shown(spelling)} is {name}, {what}", f"write {letter} for gravity")
    return UnitError(f"{_shown(spelling)} is {what}, not {kind}", mend)


# ---- from a spelling to a unit ----

_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᐟ", "0123456789-/")
_REPLACEMENTS = (
    ("°C", "degC"), ("℃", "degC"), ("°F", "degF"), ("℉", "degF"), ("°K", "K"),
    ("º", "°"), ("°", " deg "), ("µ", "u"), ("μ", "u"), ("milli-", "m"), ("micro-", "u"),
    ("−", "-"), ("·", "*"), ("⋅", "*"), ("×", "*"), ("**", "^"), ("{", "("), ("}", ")"),
)  # fmt: skip
_TOKEN = re.compile(r"\s*(?:(\d{1,2}(?:\.\d{1,2})?)|([A-Za-z%]+)|([-*/^()√]))")


def _normalise(spelling: str) -> str:
    text = re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᐟ]+", lambda m: f"^({m[0].translate(_SUPERSCRIPTS)})", spelling)
    for old, new in _REPLACEMENTS:
        text = text.replace(old, new)
    text = re.sub(r"\brt[- ]?(?=[A-Za-z(])", "√", text)  # datasheets: ug/rtHz, deg/rt-hr
    text = text.replace("sqrt", "√").strip()
    return text[1:-1].strip() if text[:1] == "[" and text[-1:] == "]" else text


def _parse(spelling: str, target: str):
    """The pint unit of a spelling; `target` chooses the examples of the error."""
    kind, examples = _DESCRIPTIONS.get(target, (f"a unit of {target}", target))

    def unknown() -> UnitError:  # made when raised: kept, it would keep its callers' arrays
        return UnitError(
            f"{_shown(spelling)} is not a unit sensorbook knows", f"write {kind} such as {examples}"
        )

    if not isinstance(spelling, str) or len(spelling) > 40:
        raise unknown()
    text, tokens, position = _normalise(spelling), [], 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if not match:
            raise unknown()
        tokens.append(match.group().strip())
        position = match.end()
    try:
        parser = _Parser(tokens)
        unit = parser.product()
        parser.finish()
    except (ValueError, ZeroDivisionError):
        raise unknown() from None
    return unit


class _Parser:
    """Recursive descent over: product = power {[*] power | / power}; power = atom [^ exponent]."""

    def __init__(self, tokens: list[str]):
        self.tokens, self.at = tokens, 0

    def peek(self, ahead: int = 0) -> str:
        return self.tokens[self.at + ahead] if self.at + ahead < len(self.tokens) else ""

    def take(self, expected: str = "") -> str:
        token = self.peek()
        if not token or (expected and token != expected):
            raise ValueError(token)
        self.at += 1
        return token

    def finish(self) -> None:
        if self.peek():
            raise ValueError(self.peek())

    def product(self):
        unit = self.power()
        while self.peek() not in ("", ")"):
            if self.peek() == "/":
                self.take()
                unit = unit / self.power()
            else:
                if self.peek() == "*":
                    self.take()
                unit = unit * self.power()
        return unit

    def power(self):
        if self.peek() == "√":
            self.take()
            return self.power() ** 0.5
        unit = self.atom()
        if self.peek() == "^":
            self.take()
            return unit ** float(self.exponent())
        if self.peek()[:1].isdigit() or (self.peek() == "-" and self.peek(1)[:1].isdigit()):
            return unit ** float(self.number())  # s2, s-1
        return unit

    def atom(self):
        token = self.take()
        if token == "(":
            unit = self.product()
            self.take(")")
            return unit
        if token == "1":
            return _registry().parse_units("dimensionless_one")
        name = _NAMES.get(token) or _ANY_CASE.get(token.lower() if len(token) > 2 else "")
        if name is None:
            raise ValueError(token)
        return _registry().parse_units(name)

    def exponent(self) -> Fraction:
        bracket = self.peek() == "("
        if bracket:
            self.take()
        value = self.number()
        if self.peek() == "/" and self.peek(1).isdigit():
            self.take()
            value /= self.number()
        if bracket:
            self.take(")")
        if abs(value) > 4 or value.denominator > 2:
            raise ValueError(value)
        return value

    def number(self) -> Fraction:
        sign = -1 if self.peek() == "-" and self.take() else 1
        value = sign * Fraction(self.take())
        if abs(value) > 4:
            raise ValueError(value)
        return value
