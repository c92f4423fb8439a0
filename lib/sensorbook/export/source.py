"""results.json as a source of exports: each value knows its place, so that an error can name it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.checks import finite, shown

AGAIN = "render it again with: sensorbook report"


@dataclass(frozen=True)
class Entry:
    """A value of a results.json.

    Attributes
    ----------
    file : the file, as the user named it
    key : path to the value, such as "sensors.gyroscope.noise"; empty for the whole
    value : as JSON gives it; None where a result says null
    sha256 : of the file; of the whole alone
    """

    file: str
    key: str
    value: Any
    sha256: str = ""

    def at(self, *names: str, mend: str = AGAIN) -> Entry:
        """The entry below; raises `InputError` where one of the names is missing, with `mend`."""
        found = self
        for name in names:
            below = found.get(name)
            if not found.value or name not in found.value:
                raise below.wrong("is missing", mend)
            found = below
        return found

    def get(self, name: str) -> Entry:
        """The entry of this name, null where it is missing."""
        if not isinstance(self.value, dict | None):
            raise self.wrong(f"{shown(self.value)} is not an object")
        key = f"{self.key}.{name}" if self.key else name
        return Entry(self.file, key, (self.value or {}).get(name))

    def items(self) -> list[Entry]:
        """The entries of a list."""
        if not isinstance(self.value, list):
            raise self.wrong(f"{shown(self.value)} is not a list")
        return [Entry(self.file, f"{self.key}[{i}]", v) for i, v in enumerate(self.value)]

    def number(self) -> float:
        """A finite number of either sign."""
        if not finite(self.value):
            raise self.wrong(f"{shown(self.value)} is not a finite number")
        return float(self.value)

    def array(self, *shape: int) -> list[Any]:
        """Nested lists of finite numbers; each list has the length that `shape` gives it."""
        items = self.items()
        if len(items) != shape[0]:
            raise self.wrong(f"has {len(items)} entries, not {shape[0]}")
        return [item.array(*shape[1:]) if shape[1:] else item.number() for item in items]

    def magnitude(self) -> float:
        """A finite number that is not negative, as all of a noise analysis are."""
        if not finite(self.value) or self.value < 0:
            raise self.wrong(f"{shown(self.value)} is not a finite number from 0")
        return float(self.value)

    def text(self) -> str:
        if not isinstance(self.value, str):
            raise self.wrong(f"{shown(self.value)} is not text")
        return self.value

    def wrong(self, message: str, mend: str = AGAIN) -> InputError:
        """What to raise where this entry cannot serve."""
        return InputError(Problem(self.file, self.key, message, mend))


class Attempts:
    """Collects what is wrong, so that all of it can be said at once."""

    def __init__(self):
        self.problems = []

    def __call__(self, make, *arguments):
        """What `make` gives; None where it raised `InputError`."""
        try:
            return make(*arguments)
        except InputError as error:
            self.problems.extend(error.problems)
            return None

    def end(self) -> None:
        """Raises `InputError` with every problem once."""
        if self.problems:
            raise InputError(*dict.fromkeys(self.problems))


def yaml_number(value: float) -> str:
    """A float that YAML reads as the same float: 1e-05 without a point would be text."""
    mantissa, e, exponent = repr(value).partition("e")
    return mantissa + (".0" if "." not in mantissa else "") + e + exponent


def read_results(path: str | Path) -> Entry:
    """The results in a file; raises `InputError` where it is not a results.json of this version."""
    whole = Entry(str(path), "", None)
    named = "name the results.json of a device's report"
    try:
        content = Path(path).read_bytes()
        value = json.loads(content)
    except OSError as error:
        raise whole.wrong(f"cannot be read: {error.strerror}", named) from None
    except (ValueError, RecursionError) as error:  # JSONDecodeError and UnicodeDecodeError, too
        reason = str(error) if isinstance(error, ValueError) else "nested too deep"
        raise whole.wrong(f"is not valid JSON: {reason}", named) from None
    if not isinstance(value, dict):
        raise whole.wrong("holds no object", named)
    results = Entry(str(path), "", value, hashlib.sha256(content).hexdigest())
    schema = results.at("schema", mend=named)
    if type(schema.value) is not int or schema.value != 1:
        raise schema.wrong(f"{shown(schema.value)} is not a version this sensorbook reads")
    return results
