"""Estimates beside a simulated device's truth."""

from __future__ import annotations

import pandas as pd

from sensorbook import units
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import NoiseEstimate


def against_truth(truth: dict, *estimates: NoiseEstimate) -> pd.DataFrame:
    """One row an axis and term: the truth and each method's estimate, in field units.

    Parameters
    ----------
    truth : `truth.json`; its `noise` holds SI coefficients by sensor, axis and term, null for none.
        `published`, where it is there, holds the values as the source work prints them.
    estimates : of one sensor; the last one's interval is compared with the truth
    """
    last = estimates[-1]
    noise, published = truth["noise"][last.sensor], truth.get("published", {}).get(last.sensor)
    rows = []
    for axis in noise:
        for i, (term, true) in enumerate(noise[axis].items()):
            label, si = units.field_unit(last.sensor, term)
            row = {"axis": axis, "term": f"{TERMS[term].symbol} [{label}]"}
            if published:
                row[f"printed ({published['table']})"] = _shown(published[axis][i] or None)
            row["truth"] = _shown(true and true / si)
            for estimate in estimates:
                found = estimate[axis].terms[term]
                unread = not found and term not in estimate[axis].upper_bounds
                shown = "no range" if unread else _shown(found and found.value / si)
                row[estimate.method.replace("_", " ")] = shown
            found, bound = last[axis].terms[term], last[axis].upper_bounds.get(term)
            if found:
                low, high = found.low / si, found.high / si
                row["95 % interval"] = f"{low:.3g} … {high:.3g}"
                row["holds the truth"] = _yes(bool(true) and found.low <= true <= found.high)
            else:
                row["95 % interval"] = f"0 … {bound / si:.2g}"
                row["holds the truth"] = _yes((true or 0.0) <= bound)
            rows.append(row)
    return pd.DataFrame(rows).set_index(["axis", "term"])


def _shown(value: float | None) -> str:
    return f"{value:.4g}" if value else "none"


def _yes(value: bool) -> str:
    return "yes" if value else "no"
