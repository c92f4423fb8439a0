"""Several recordings of one magnetometer: made ready, fitted together, and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensorbook.earth import Field
from sensorbook.errors import Refusal
from sensorbook.magnetometer.alignment import paired
from sensorbook.magnetometer.coverage import coverage
from sensorbook.magnetometer.fit import calibrate
from sensorbook.magnetometer.result import MagnetometerCalibration
from sensorbook.recordings.findings import saturation
from sensorbook.recordings.recording import Recording

DISAGREE = 4.0  # standard errors between two recordings' hard irons


@dataclass(frozen=True, eq=False)
class Together:
    """The calibration of all recordings, and of each.

    Attributes
    ----------
    fit : of all; where they disagree the mean of each one's own, with their scatter in its covariance
    own : by file, or why that recording alone is refused; empty where there is one
    agree : False where two hard irons differ by more than `DISAGREE` of their standard errors
    """

    fit: MagnetometerCalibration
    own: dict[str, MagnetometerCalibration | Refusal]
    agree: bool

    @property
    def repeatability(self) -> np.ndarray | None:
        """(3,) T, standard deviation of the recordings' hard irons; None for fewer than two."""
        found = [o.hard_iron for o in self.own.values() if not isinstance(o, Refusal)]
        return np.std(found, axis=0, ddof=1) if len(found) > 1 else None

    def to_results(self) -> dict:
        """`runs` and `repeatability` of results.json."""
        if not self.own:
            return {}
        each = (
            {"file": file}
            | ({"method": None, "reason": str(o)} if isinstance(o, Refusal) else o.to_results())
            for file, o in self.own.items()
        )
        spread = self.repeatability
        return {
            "runs": list(each),
            "repeatability": None if spread is None else {"hard_iron": spread},
        }


def prepared(run: Recording) -> tuple[Recording, int]:
    """The recording in the order of its stamps, and how many readings that tell nothing are NaN in it.

    These are the saturated ones, and lost ones that a logger writes as zero on all axes.

    Blocks of neighbours are what the intervals rest on: rows out of order would make them too narrow.
    """
    if run.rate is not None and (np.diff(run.time) < 0).any():
        order = np.argsort(run.time, kind="stable")
        run = replace(
            run,
            time=run.time[order],
            values=run.values[order],
            temperature=None if run.temperature is None else run.temperature[order],
        )
    ends = (run.values == 0).all(axis=1)
    for column in run.values.T:
        if np.isfinite(column).any() and saturation(column, run.kind):
            ends |= (column == np.nanmax(column)) | (column == np.nanmin(column))
    return replace(run, values=np.where(ends[:, None], np.nan, run.values)), int(ends.sum())


def calibrate_runs(runs: Sequence[Recording], earth: Field) -> Together:
    """One calibration of recordings that are `prepared`; raises `Refusal` where none determines it."""
    known = (earth.strength, earth.std, earth.source)
    values = np.vstack([run.values for run in runs])
    if len(runs) == 1:
        return Together(calibrate(values, *known), {}, True)
    own: dict[str, MagnetometerCalibration | Refusal] = {}
    for run in runs:
        try:
            own[run.file] = calibrate(run.values, *known)
        except Refusal as refusal:
            own[run.file] = refusal
    found = {file: o for file, o in own.items() if not isinstance(o, Refusal)}
    fullest = [o for o in found.values() if o.method == "ellipsoid"] or list(found.values())
    apart = [
        np.abs(a.hard_iron - b.hard_iron) / np.hypot(a.std[:3], b.std[:3])
        for k, a in enumerate(fullest)
        for b in fullest[:k]
    ]
    if np.max(apart, initial=0) <= DISAGREE:
        edges = np.cumsum([len(run.values) for run in runs])[:-1]
        parts = np.split(np.arange(len(values)), edges)
        return Together(calibrate(values, *known, parts=parts), own, True)
    return Together(_mean(fullest, list(own.values()), runs), own, False)


def _mean(
    fits: Sequence[MagnetometerCalibration],
    own: Sequence[MagnetometerCalibration | Refusal],
    runs: Sequence[Recording],
) -> MagnetometerCalibration:
    """The mean of calibrations that disagree: their scatter is its uncertainty."""
    count = len(fits)
    all_values = np.array([f.values for f in fits])
    scatter = np.cov(all_values.T)
    mean = _of(fits[0], all_values.mean(axis=0))
    lengths, held = [], []
    for k, (one, run) in enumerate(zip(own, runs, strict=True)):
        if isinstance(one, Refusal):
            continue
        others = [f.values for f in fits if f is not own[k]]
        judge = _of(fits[0], np.mean(others, axis=0)) if len(others) < count else mean
        for residuals, by in ((lengths, mean), (held, judge)):
            size = np.linalg.norm(by.correct(run.values[one.used]), axis=1)
            residuals.append(size / by.field - 1)
    used = [np.zeros(len(r), bool) if isinstance(o, Refusal) else o.used
            for o, r in zip(own, (run.values for run in runs), strict=True)]  # fmt: skip
    used = np.concatenate(used)
    corrected = mean.correct(np.vstack([run.values for run in runs])[used])
    return replace(
        mean,
        covariance=np.mean([f.covariance for f in fits], axis=0) + scatter / count,
        dof=count - 1,
        residual=float(np.sqrt(np.mean(np.concatenate(lengths) ** 2))),
        residual_check=float(np.sqrt(np.mean(np.concatenate(held) ** 2))),
        coverage=coverage(corrected / np.linalg.norm(corrected, axis=1)[:, None]),
        used=used,
    )


def _of(fit: MagnetometerCalibration, values: np.ndarray) -> MagnetometerCalibration:
    """A calibration with the parameters (10,)."""
    h, (xx, yy, zz, xy, xz, yz), field = values[:3], values[3:9], values[9]
    soft_iron = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return replace(fit, hard_iron=h, soft_iron=soft_iron, field=float(field))


def accelerometers_of(device, runs: Sequence[Recording]) -> dict[str, Recording]:
    """By the magnetometer's file, the accelerometer's recording beside it.

    That of the same file, whatever its kind; else, where there are as many rotations of both sensors,
    the one in the same place of `device.toml`.
    """
    kinds = device.kinds("accelerometer")
    every = [r for kind in kinds for r in device.runs("accelerometer", kind)]
    turned = [r for r in every if r.kind == "rotation"]
    found = {}
    for k, run in enumerate(runs):
        same = [r for r in every if r.file == run.file]
        if same:
            found[run.file] = same[0]
        elif len(turned) == len(runs):
            found[run.file] = turned[k]
    return found


def pairs(runs: Sequence[Recording], beside: dict[str, Recording], used: np.ndarray):
    """Rows of both sensors, (N, 3) T and (N, 3) m/s², of all recordings; `used` as the fit's."""
    edges = np.cumsum([len(run.values) for run in runs])[:-1]
    rows = [
        paired(run, beside[run.file], kept)
        for run, kept in zip(runs, np.split(used, edges), strict=True)
        if run.file in beside
    ]
    return tuple(np.vstack(part) for part in zip(*rows, strict=True))
