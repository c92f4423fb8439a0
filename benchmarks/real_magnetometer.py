"""Magnetometer calibration of real recordings: every figure beside its goal and beside peers.

    SENSORBOOK_REAL_DATA=… python benchmarks/real_magnetometer.py

Peers in the same run: (max + min) / 2, as most hobby tools do; work A's factors as printed; a sphere;
and the quadric alone by linear least squares, as MATLAB's magcal solves it.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np

import sensorbook
from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate
from sensorbook.magnetometer.alignment import align, heading_error, paired
from sensorbook.magnetometer.ellipsoid import sphere, unpacked
from sensorbook.magnetometer.min_max import min_max

ROOT = Path(__file__).resolve().parents[1]


def line(what: str, value: float, goal: str = "", good: bool = True) -> None:
    print(f"  {what:44s} {value:10.5g}   {goal}{'' if good else '   GOAL MISSED'}")


def lengths(folder: Path, fitted: float, held_out: float) -> None:
    """How much the corrected field's length scatters, over all readings."""
    m = sensorbook.load(folder).magnetometer.rotation.values
    m = m[np.isfinite(m).all(axis=1)]
    began = time.perf_counter()
    fit = calibrate(m)
    seconds = time.perf_counter() - began
    print(f"{folder.name}: {len(m)} readings, {fit.coverage.percent:.0f} % of the sphere")
    steps = min_max(m)
    line("‖m‖, standard deviation over mean, %: as read", scatter(m))
    line("  (max + min) / 2", scatter(m - steps.hard_iron))
    line("  work A's factors as printed", scatter(
        (m - steps.hard_iron) @ steps.soft_iron(steps.printed_factors)))  # fmt: skip
    line("  a sphere", scatter(m - unpacked(sphere(m))[0]))
    h, s = quadric(m)
    line("  quadric alone", scatter((m - h) @ s))
    ours = scatter(fit.correct(m))
    line(f"  {fit.method}", ours, f"goal ≤ {fitted}", ours <= fitted)
    check = 100 * fit.residual_check
    line(f"  {fit.method}, held out, rms", check, f"goal ≤ {held_out}", check <= held_out)
    line("readings set aside, %", 100 * np.mean(~fit.used))
    line("hard iron, standard error, µT", 1e6 * fit.std[:3].max())
    line("seconds", seconds, "goal < 2", seconds < 2)


def dip(folder: Path) -> None:
    """How much the angle between field and gravity scatters."""
    device = sensorbook.load(folder)
    run, beside = device.magnetometer.rotation, device.accelerometer.rotation
    fit = calibrate(run.values)
    found = align(fit, *paired(run, beside), STANDARD_GRAVITY)
    spreads = {stage: np.degrees(value) for stage, value in found.spreads.items()}
    line("dip, ° standard deviation: as read", spreads["raw"])
    line("  calibrated", spreads["calibrated"])
    line("  and aligned", spreads["aligned"], "goal ≤ 3.0", spreads["aligned"] <= 3.0)
    heading = heading_error(fit, found.dip, found)
    line("heading in a level turn, ° at most: as read", np.degrees(np.abs(heading.before).max()))
    line("  corrected, standard error", np.degrees(heading.std.max()))


def not_turned(folder: Path) -> None:
    """Two long rests: no calibration, and why."""
    print(folder.name)
    for run in sensorbook.load(folder).runs("magnetometer", "thermal"):
        began = time.perf_counter()
        try:
            calibrate(run.values)
            print("  NOT REFUSED   GOAL MISSED")
        except Refusal as refusal:
            print(f"  refused: {refusal.reason}")
        line(f"seconds, {len(run)} readings", time.perf_counter() - began)


def scatter(m: np.ndarray) -> float:
    length = np.linalg.norm(m, axis=1)
    return 100 * float(length.std() / length.mean())


def quadric(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and square root of the quadric ``x'Ax + b'x = 1`` by linear least squares."""
    centre, size = m.mean(axis=0), m.std()
    x, y, z = ((m - centre) / size).T
    design = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z], axis=1)
    a, b, c, d, e, f, *linear = np.linalg.lstsq(design, np.ones(len(m)), rcond=None)[0]
    matrix = np.array([[a, d, e], [d, b, f], [e, f, c]])
    squares, turn = np.linalg.eigh(matrix)
    h = centre - size / 2 * np.linalg.solve(matrix, linear)
    return h, turn @ np.diag(np.sqrt(np.abs(squares))) @ turn.T


def main() -> None:
    folder = Path(os.environ.get("SENSORBOOK_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        print(f"no real recordings in {folder}: set SENSORBOOK_REAL_DATA to their folder")
        return
    lengths(folder / "ck-mag-acc", 1.26, 1.45)
    dip(folder / "ck-mag-acc")
    lengths(folder / "sunsided-tilt-sphere", 0.84, 1.1)
    not_turned(folder / "cats-tag")


if __name__ == "__main__":
    main()
