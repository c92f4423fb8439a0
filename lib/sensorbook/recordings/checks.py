"""Checks of single values of `device.toml`: each returns what is wrong and how to mend it, or None."""

from __future__ import annotations

import math
import re
from datetime import date, datetime
from difflib import get_close_matches
from pathlib import PurePosixPath, PureWindowsPath

import numpy as np

from sensorbook.units import UnitError, factor

RESERVED_IDS = ("index.html", "book")
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")

Fault = tuple[str, str]  # what was found, how to mend it


def file_name(name: object, pattern: bool = False) -> Fault | None:
    """What is wrong with a file name as declared: only a relative path inside the folder passes."""
    inside = "name a file inside the device folder, such as data/static.csv"
    if not isinstance(name, str) or not name.strip():
        return f"{shown(name)} is not a file name", inside
    if not name.isprintable() or len(name) > 500:
        return f"{shown(name)} is not a file name", inside
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).anchor:
        return f"{shown(name)} is an absolute path", inside
    if ".." in (*PurePosixPath(name).parts, *PureWindowsPath(name).parts):
        return f"{shown(name)} leads out of the device folder", inside
    if not pattern and any(c in name for c in "*?"):
        return f"{shown(name)} is a pattern", "name one file a recording"
    return None


def shown(value: object) -> str:
    """A value for a message: its repr, cut where it is long."""
    full = repr(value)
    return full if len(full) <= 80 else full[:78] + "…" + full[-1]


def suggest(name: object, known) -> str:
    """ "did you mean …?" where a known name is close; otherwise the names there are."""
    close = get_close_matches(str(name), list(known), n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(known)}"


def text(value: object) -> Fault | None:
    """A text."""
    return None if isinstance(value, str) else (f"{shown(value)} is not text", 'write "…"')


def text_or_number(value: object) -> Fault | None:
    """A text, or a whole number as serial numbers are."""
    plain = isinstance(value, (str, int)) and not isinstance(value, bool)
    return None if plain else (f"{shown(value)} is not text", 'write "…"')


def finite(value: object) -> bool:
    """True for a number that is neither NaN nor infinite."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and -1e300 < value < 1e300
    )


def number(low: float = -math.inf, high: float = math.inf, example: str = "1.0", open_low=False):
    """A finite number between limits."""

    def check(value: object) -> Fault | None:
        if not finite(value):
            return f"{shown(value)} is not a finite number", f"write a number such as {example}"
        if not low <= value <= high or (open_low and value == low):
            limits = f"above {low:g} and at most" if open_low else f"between {low:g} and"
            limits = f"{limits} {high:g}" if high < math.inf else f"of {low:g} or more"
            return f"{shown(value)} is out of range", f"write a number {limits}, such as {example}"
        return None

    return check


def one_of(*allowed: str):
    """One of these texts."""

    def check(value: object) -> Fault | None:
        if value in allowed and isinstance(value, str):
            return None
        return f"{shown(value)} is not allowed here", suggest(value, allowed)

    return check


def table(value: object) -> Fault | None:
    """A table."""
    return None if isinstance(value, dict) else (f"{shown(value)} is not a table", "write { … }")


def version(value: object) -> Fault | None:
    """The version of the declaration."""
    if type(value) is int and value == 1:
        return None
    return f"{shown(value)} is not a version this sensorbook reads", "write schema = 1"


def device_id(value: object) -> Fault | None:
    """What may name the report folder."""
    if not isinstance(value, str) or not _ID.fullmatch(value):
        return (
            f"{shown(value)} cannot name the report folder",
            "use 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit",
        )
    if value in RESERVED_IDS:
        return f"{value!r} is reserved for the report tree", "choose another id"
    return None


def day(value: object) -> Fault | None:
    """A date, a time stamp or ISO text."""
    if as_date(value) is None:
        return f"{shown(value)} is not a date", "write a date such as 2024-05-01"
    return None


def as_date(value: object) -> date | None:
    """The day of a date, a time stamp or ISO text; None where it is none of them."""
    if isinstance(value, datetime):
        return value.date()
    if isinstance(value, date):
        return value
    try:
        return date.fromisoformat(value[:10])
    except (TypeError, ValueError):
        return None


def unit_fault(spelling: object, si: str) -> Fault | None:
    """What is wrong with a unit that should measure the same as `si`."""
    if not isinstance(spelling, str):
        return f"{shown(spelling)} is not text", 'write "…"'
    try:
        factor(spelling, si)
    except UnitError as error:
        return error.message, error.mend
    return None


def flag(value: object) -> Fault | None:
    """true or false."""
    return (
        None if isinstance(value, bool) else (f"{shown(value)} is not true or false", "write true")
    )


def guessed(value: object) -> Fault | None:
    """Which values of a recording are guesses: reports warn of low ones and refuse unknown ones."""
    if isinstance(value, dict) and all(sure in ("low", "not known") for sure in value.values()):
        return None
    return (
        f"{shown(value)} does not say how sure a guess is",
        'write { unit = "low" } or "not known"',
    )


def time_unit(value: object) -> Fault | None:
    """A unit of time."""
    return unit_fault(value, "s")


def number_or_three(value: object) -> Fault | None:
    """A number, or one for each axis."""
    if finite(value) or (isinstance(value, list) and len(value) == 3 and all(map(finite, value))):
        return None
    return f"{shown(value)} is neither a number nor three", "write a number, or one for each axis"


def numbers(count: tuple[int, ...], what: str):
    """A list of so many numbers."""

    def check(value: object) -> Fault | None:
        if isinstance(value, list) and len(value) in count and all(map(finite, value)):
            return None
        return f"{shown(value)} is not {what}", f"write {what}"

    return check


def rotation(value: object) -> Fault | None:
    """A proper rotation matrix, by rows."""
    rows = isinstance(value, list) and len(value) == 3
    rows = rows and all(isinstance(r, list) and len(r) == 3 and all(map(finite, r)) for r in value)
    mend = "write a rotation of three rows, such as [[1,0,0],[0,1,0],[0,0,1]]"
    if not rows:
        return f"{shown(value)} is not a 3×3 matrix", mend
    matrix = np.array(value, dtype=np.float64)
    # 1e-3: matrices typed in with four digits are meant as rotations.
    if np.abs(matrix).max() > 2 or np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3:
        return f"{shown(value)} is not a rotation: its rows are not orthonormal", mend
    if np.linalg.det(matrix) < 0:
        return f"{shown(value)} is a reflection, not a rotation", mend
    return None


def pixels(value: object) -> Fault | None:
    """A number of pixels."""
    if type(value) is int and 1 <= value <= 100_000:
        return None
    return f"{shown(value)} is not a number of pixels", "write a whole number such as 1280"


def principal_point(point: list[float], width: int, height: int) -> Fault | None:
    """A point [x, y] in pixels that an image's optical axis can meet."""
    middle = (width - 1) / 2, (height - 1) / 2

    def off(x: float, y: float) -> float:
        """How far from the middle, in sizes of the image: 0.5 is its edge."""
        return max(abs(x - middle[0]) / width, abs(y - middle[1]) / height)

    there, swapped = off(*point), off(*reversed(point))
    x, y = point
    mend = f"did you mean [{y:g}, {x:g}]? x comes first"
    if there > 0.2 and swapped < 0.02:
        return f"[{x:g}, {y:g}] would be the image's middle the other way round", mend
    if there > 0.5 and swapped <= 0.5:
        return f"[{x:g}, {y:g}] is outside the image of {width} × {height} pixels", mend
    if there > 1.5:  # an image cut from a larger one may have it outside, but not as far
        mend = f"write [x, y] in pixels, such as [{middle[0]:g}, {middle[1]:g}]"
        return f"[{x:g}, {y:g}] is far outside the image of {width} × {height} pixels", mend
    return None
