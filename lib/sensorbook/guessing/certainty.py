"""A guess: what was taken for granted, how sure that is, and why."""

from __future__ import annotations

from dataclasses import dataclass

HIGH, MEDIUM, LOW, UNKNOWN = "high", "medium", "low", "not known"
CERTAINTIES = (HIGH, MEDIUM, LOW, UNKNOWN)


@dataclass(frozen=True)
class Guess:
    """One value of a declaration that nobody has declared.

    Parameters
    ----------
    key : key of the `[[recording]]` table, such as "unit"
    value : what is declared for now
    certainty : "high", "medium", "low", or "not known" where the file does not tell: the value then
        only holds the place, and a report refuses what hangs on it
    reason : what in the file speaks for it, with the figure
    """

    key: str
    value: object
    certainty: str
    reason: str


def weakest(*certainties: str) -> str:
    """The least sure of these."""
    return max(certainties, key=CERTAINTIES.index)
