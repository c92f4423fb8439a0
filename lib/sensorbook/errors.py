"""What may go wrong, in the user's terms.

Three outcomes are told apart everywhere: a result, a `Refusal` (readable data that cannot determine
the answer) and an `InputError` (data or declarations that are wrong and can be mended).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One thing wrong with an input: where it is, what was found, how to mend it.

    Parameters
    ----------
    file : name of the file, relative to the device folder
    where : row, key or column; empty where the whole file is meant
    message : what was found, with the offending value
    mend : what to do about it
    """

    file: str
    where: str
    message: str
    mend: str = ""

    def __str__(self) -> str:
        place = f"{self.file}: {self.where}" if self.where else self.file
        text = f"{place}: {self.message}" + (f" — {self.mend}" if self.mend else "")
        # One line a problem, whatever control characters the input holds.
        return "".join(c if c.isprintable() else " " for c in text)


class _Plain(Exception):
    """Shows its message alone in a notebook: no stack trace for what is not a fault."""

    def _render_traceback_(self) -> list[str]:
        return [f"{type(self).__name__}: {self}"]


class InputError(_Plain, ValueError):
    """Invalid input; `problems` holds every `Problem` found, the message one line for each."""

    def __init__(self, *problems: Problem):
        self.problems = problems
        super().__init__("\n".join(map(str, problems)))


class Refusal(_Plain):
    """The data are readable but cannot determine the answer.

    Parameters
    ----------
    reason : what the data lack, with the figure that shows it
    remedy : what to record instead
    """

    def __init__(self, reason: str, remedy: str = ""):
        self.reason, self.remedy = reason, remedy
        super().__init__(f"{reason} {remedy}".strip())
