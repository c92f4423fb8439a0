"""What a recording takes from others: a temperature of its own time base, shocks seen beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.clock import advancing
from sensorbook.recordings.findings import shocks, span
from sensorbook.recordings.recording import Finding, Recording


def with_temperature(
    recording: Recording, sources: Sequence[Recording], run: int, runs: int
) -> Recording:
    """The recording with the temperature interpolated onto its stamps.

    Parameters
    ----------
    recording : one without a temperature column
    sources : the temperature recordings of its kind
    run, runs : which of the sensor's runs it is (from 0) and how many there are: as many sources as
        runs belong to them in order, otherwise the source that covers most of the run is taken
    """
    clock = recording.start + recording.time
    first, last = np.nanmin(clock), np.nanmax(clock)

    def covered(source: Recording) -> float:
        stamps = source.start + source.time
        overlap = min(last, np.nanmax(stamps)) - max(first, np.nanmin(stamps))
        return overlap / max(last - first, 1e-12)

    source = sources[run] if len(sources) == runs else max(sources, key=covered)
    share = covered(source)
    if share <= 0:
        raise InputError(
            Problem(source.file, "temperature", f"does not overlap {recording.file} in time",
                    "record both on one clock")
        )  # fmt: skip
    findings = recording.findings
    if share < 0.99:
        message = f"{source.file} covers {100 * share:.3g} % of the run; its end values are held"
        finding = Finding(recording.file, recording.sensor, "temperature", message)
        findings = (*findings, finding)
    known = advancing(source.time) & np.isfinite(source.x)
    temperature = np.interp(clock, source.start + source.time[known], source.x[known])
    return replace(recording, temperature=temperature, findings=findings)


def with_shared_shocks(recording: Recording, others: Sequence[Recording]) -> Recording:
    """The recording with the shocks that others of its file saw: they shook this sensor, too.

    A low-pass in one sensor can hide a shock that its neighbour shows.
    """
    if any(finding.kind == "spike" for finding in recording.findings):
        return recording
    found = []
    for other in others:
        same = len(other) == len(recording) and other.rate == recording.rate
        if same and any(finding.kind == "spike" for finding in other.findings):
            rows = shocks(other.values)
            message = (
                f"the {other.sensor} in the same file saw a shock, {span(other.time[rows])}, "
                "which shook this sensor, too"
            )
            found.append(Finding(recording.file, recording.sensor, "spike", message))
    return replace(recording, findings=(*recording.findings, *found)) if found else recording
