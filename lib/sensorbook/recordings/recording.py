"""A recording: immutable arrays in SI units, with what was found odd about them."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date, datetime, time

import numpy as np

from sensorbook.recordings.clock import advancing, missing_samples

AXES = ("x", "y", "z")
QUATERNION = ("x", "y", "z", "w")


@dataclass(frozen=True)
class Finding:
    """A warning about readable data.

    Parameters
    ----------
    file : name of the file, relative to the device folder
    where : sensor, column or time range
    kind : 'gap', 'duplicate', 'backward', 'nan', 'saturated', 'spike', 'resolution', 'rate', 'unit',
        'temperature', 'guessed', 'merged', 'corrupt', 'pose'; of `check` alone: 'short', 'moved',
        'coverage', 'image'
    message : what was found, with its figures
    remedy : the better recording to make, or what to mend
    """

    file: str
    where: str
    kind: str
    message: str
    remedy: str = ""

    def __str__(self) -> str:
        place = f"{self.file}: {self.where}" if self.where else self.file
        remedy = f" — {self.remedy}" if self.remedy else ""
        return "".join(c if c.isprintable() else " " for c in f"{place}: {self.message}{remedy}")


@dataclass(frozen=True)
class Segment:
    """A labelled stretch, such as one rest; `start` and `end` in s on the recording's `time`."""

    label: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Recording:
    """One sensor's samples over time, as recorded, in SI units.

    Parameters
    ----------
    sensor : "gyroscope", "accelerometer", "magnetometer", "temperature" or "reference"
    kind : "static", "thermal", "positions", "six_position", "rotation" or "trajectory"
    file : name of the file, relative to the device folder
    time : (N,) s from the file's first sample, oddities included; the number of the sample where
        neither a rate nor a time column is declared
    values : (N, 3) in `unit`; read-only. A reference attitude is (N, 4): x, y, z, w as recorded,
        its sense stands in `declaration["quaternion"]`; a temperature is (N, 1)
    temperature : (N,) °C, or None
    rate : Hz, or None where it is not known
    unit : SI unit of `values`
    findings : what was found odd
    sha256 : of the file
    declaration : the table of `device.toml` as declared
    start : time of the first sample on the file's own clock, s
    segments : labelled stretches, from a `segment` column or a `segments` file
    """

    sensor: str
    kind: str
    file: str
    time: np.ndarray
    values: np.ndarray
    temperature: np.ndarray | None = None
    rate: float | None = None
    unit: str = ""
    findings: tuple[Finding, ...] = ()
    sha256: str = ""
    declaration: Mapping = field(default_factory=dict)
    start: float = 0.0
    segments: tuple[Segment, ...] = ()

    def __post_init__(self):
        for name in ("time", "values", "temperature"):
            array = getattr(self, name)
            if array is not None:
                array = np.asarray(array, dtype=np.float64).view()
                array.flags.writeable = False
                object.__setattr__(self, name, array)
            if array is not None and len(array) != len(self.time):
                raise ValueError(f"{name} has {len(array)} rows, time has {len(self.time)}")

    def __len__(self) -> int:
        return len(self.values)

    @property
    def x(self) -> np.ndarray:
        """(N,) first axis."""
        return self.values[:, 0]

    @property
    def y(self) -> np.ndarray:
        """(N,) second axis."""
        return self.values[:, 1]

    @property
    def z(self) -> np.ndarray:
        """(N,) third axis."""
        return self.values[:, 2]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of `values`."""
        if self.values.shape[1] == 1:
            return (self.sensor,)
        return QUATERNION if self.values.shape[1] == 4 else AXES

    @property
    def duration(self) -> float:
        """Seconds from the first sample to one interval after the last; NaN where not known."""
        if self.rate is None or not len(self):
            return math.nan
        return float(np.nanmax(self.time) - np.nanmin(self.time)) + 1 / self.rate

    @property
    def gaps(self) -> int:
        """Number of places where at least one sample is missing from the time base."""
        if self.rate is None:
            return 0
        stamps = self.time[advancing(self.time)]
        return int(np.count_nonzero(missing_samples(stamps, self.rate)))

    def between(self, start: float, end: float) -> Recording:
        """The samples with start ≤ time < end (s); `time` stays on the whole recording's clock."""
        return self._rows((self.time >= start) & (self.time < end))

    def _rows(self, rows) -> Recording:
        temperature = None if self.temperature is None else self.temperature[rows]
        return replace(
            self, time=self.time[rows], values=self.values[rows], temperature=temperature
        )

    def to_frame(self):
        """A pandas DataFrame: index time [s], columns x, y, z and, where known, temperature."""
        import pandas

        index = pandas.Index(self.time, name="time")
        frame = pandas.DataFrame(self.values, index=index, columns=list(self.columns))
        if self.temperature is not None:
            frame["temperature"] = self.temperature
        return frame

    def plot(self, axes=None):
        """Draws the recording over time in field units; returns the Axes."""
        from sensorbook.plots.recording import plot_recording

        return plot_recording(self, axes)

    def evenly_sampled(self) -> tuple[Recording, tuple[str, ...]]:
        """The recording on an even time base, and a sentence for everything done to get there.

        Rows whose stamp does not advance are set aside; short gaps and missing values are bridged
        linearly; otherwise the longest stretch without a gap is used. Raises `Refusal` where less
        than half of the record or fewer than 100 samples would remain.
        """
        from sensorbook.recordings.even import evenly_sampled

        return evenly_sampled(self)

    def provenance(self) -> dict:
        """This recording's entry under `inputs` of results.json, in plain JSON types."""
        finite = math.isfinite(self.duration)
        return plain(self.declaration) | {
            "file": self.file,
            "sha256": self.sha256,
            "sensor": self.sensor,
            "kind": self.kind,
            "samples": len(self),
            "rate_hz": self.rate,
            "duration_s": round(self.duration, 9) if finite else None,
            "gaps": self.gaps,
        }

    def __repr__(self) -> str:
        rate = "no rate" if self.rate is None else f"{self.rate:g} Hz, {self.duration:g} s"
        return (
            f"<Recording {self.sensor} {self.kind} of {self.file!r}: {len(self)} samples, {rate}>"
        )

    def _repr_html_(self) -> str:
        known = self.rate is not None
        rows = [
            ("sensor", self.sensor),
            ("kind", self.kind),
            ("file", self.file),
            ("samples", f"{len(self)}"),
            ("rate", f"{self.rate:g} Hz" if known else "not known"),
            ("duration", f"{self.duration:g} s" if known else "not known"),
            ("unit", self.unit),
            *((f"found: {f.kind}", f.message) for f in self.findings),
        ]
        return html_table(rows)


def html_table(rows, header=()) -> str:
    """A small HTML table; every cell is escaped."""

    def row(cells, tag):
        cells = "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells)
        return f"<tr>{cells}</tr>"

    head = f"<thead>{row(header, 'th')}</thead>" if header else ""
    return f"<table>{head}<tbody>{''.join(row(r, 'td') for r in rows)}</tbody></table>"


def plain(value):
    """A TOML value in plain JSON types: dates as ISO text, no NaN or infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (date, datetime, time)):
        return value.isoformat()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
