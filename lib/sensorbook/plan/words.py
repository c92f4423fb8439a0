"""A plan in words: what to do, what it will tell, what that assumes and where the formula is from."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

HALF = 1.96  # half width of a 95 % interval, in standard errors
WIDTH = 100
HEAD = ("quantity", "axes", "level", "1 sigma", "95 %")


@dataclass(frozen=True)
class Plan:
    """How to record one kind, and what comes of it.

    Attributes
    ----------
    title : kind, sensor and what is wanted
    do : what to do, a sentence each
    rows : of `HEAD`
    notes : what else follows
    assumes : a sentence each
    source : of the formula
    reached : whether the wanted accuracy is
    numbers : what the rows state, SI, for other code
    """

    title: str
    do: tuple[str, ...]
    rows: tuple[tuple[str, str, str, str, str], ...]
    notes: tuple[str, ...]
    assumes: tuple[str, ...]
    source: str
    reached: bool
    numbers: dict

    def lines(self) -> Iterator[str]:
        """As a person reads it."""
        yield self.title
        yield from _listed("do", self.do)
        yield from _table(self.rows)
        yield from _listed("note", self.notes)
        yield from _listed("assumes", self.assumes)
        yield from _listed("source", [self.source])


def _listed(label: str, texts: Sequence[str]) -> Iterator[str]:
    for n, text in enumerate(texts):
        first = f"  {'' if n else label:7s}  - "
        yield from textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=" " * 13)


def _table(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """The columns that say something, with their heads."""
    columns = [c for c in zip(HEAD, *rows, strict=True) if any(c[1:])]
    widths = [max(map(len, column)) for column in columns]
    for row in zip(*columns, strict=True):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield ("    " + "  ".join(cells)).rstrip()


def number(value: float, digits: int = 3) -> str:
    """Three digits, without an exponent where that is readable.

    >>> number(0.012345), number(1234.5), number(2.0), number(1.2e-7)
    ('0.0123', '1230', '2', '1.2e-07')
    """
    if value == 0 or not 1e-4 <= abs(value) < 1e5:
        return f"{value:.{digits}g}"
    return f"{float(f'{value:.{digits}g}'):.10f}".rstrip("0").rstrip(".")


def duration(seconds: float) -> str:
    """
    >>> duration(45), duration(90), duration(3600), duration(5400), duration(86400 * 2)
    ('45 s', '90 s', '1 h', '1.5 h', '2 days')
    """
    if seconds <= 90:
        return f"{number(seconds, 2)} s"
    if seconds < 3600:
        return f"{number(seconds / 60, 2)} min"
    if seconds < 86400 or seconds % 43200:
        return f"{number(seconds / 3600, 2)} h"
    return f"{number(seconds / 86400, 2)} day{'' if seconds == 86400 else 's'}"


def rate(hertz: float) -> str:
    """
    >>> rate(10), rate(0.05)
    ('10 Hz', '0.05 Hz (every 20 s)')
    """
    every = f" (every {number(1 / hertz)} s)" if hertz < 1 else ""
    return f"{number(hertz)} Hz{every}"
