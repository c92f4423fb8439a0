"""The numbers of a results.json as a table, as results.csv of a report has them, with their convention."""

from __future__ import annotations

import csv
import io

from sensorbook.export.calibration import IRON, origin
from sensorbook.export.source import Entry
from sensorbook.reporting.results import csv_text

TWO_SIDED = "of the two-sided spectrum"
MODEL = "raw = matrix * true + bias"
CONVENTIONS = {  # of quantities that are not the same everywhere
    **dict.fromkeys(("quantization", "random_walk", "bias_instability"), TWO_SIDED),
    **dict.fromkeys(("rate_random_walk", "rate_ramp"), TWO_SIDED),
    "noise_density": "of the one-sided spectrum",
    "bias": MODEL,
    "scale_factor_error": f"{MODEL}; diagonal of matrix less 1",
    "misalignment": f"{MODEL}; off the diagonal",
    "g_sensitivity": f"{MODEL} + g_sensitivity * acceleration",
    "hard_iron": IRON,
    "soft_iron": IRON,
}
COLUMNS = ("convention", "created", "sensorbook", "results_sha256")


def render(results: Entry) -> str:
    """The columns of results.csv and those of `COLUMNS`; low and high bound the 95 % interval.

    Raises `InputError` where the results cannot be read as such.
    """
    origin(results)  # raises where something of it is missing
    try:
        head, *rows = csv.reader(io.StringIO(csv_text(results.value)))
    except (LookupError, ArithmeticError, TypeError, ValueError, AttributeError) as error:
        raise results.wrong(f"cannot be made a table: {type(error).__name__}: {error}") from None
    if not rows:
        raise results.at("sensors").wrong("holds no numbers", "render the report of a recording")
    quantity = head.index("quantity")
    about = provenance(results)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*head, *COLUMNS))
    for row in rows:
        if bad := {"nan", "inf", "-inf"}.intersection(row):
            what = " ".join(filter(None, row[1 : quantity + 1]))
            raise results.at("sensors").wrong(f"{what}: {bad.pop()} is not a finite number")
        writer.writerow(map(cell, (*row, CONVENTIONS.get(row[quantity], ""), *about)))
    return text.getvalue()


def provenance(results: Entry) -> tuple[str, str, str]:
    """What `COLUMNS` name after the convention."""
    return (
        results.at("created").text(),
        results.at("software", "sensorbook").text(),
        results.sha256,
    )


def cell(text: str) -> str:
    """A cell that no spreadsheet takes for a formula.

    >>> cell("=1+1"), cell("-1e-05")
    ("'=1+1", '-1e-05')
    """
    try:
        float(text)
    except ValueError:
        return f"'{text}" if text[:1] in tuple("=+-@\t\r") else text
    return text
