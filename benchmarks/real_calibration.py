"""Static calibration of real recordings: every figure beside its goal and beside peers.

    SENSORBOOK_REAL_DATA=… python benchmarks/real_calibration.py

Peers in the same run: the nominal and the factory's scale, six parameters, and imu_tk's cost,
Σ(g² − ‖a‖²)² (Tedaldi et al. 2014), on the same rests.
"""

from __future__ import annotations

import csv
import json
import os
import time
from pathlib import Path

import numpy as np
from scipy import optimize

import sensorbook
from sensorbook.calibration import find_positions, multi_position, recursive, six_position
from sensorbook.calibration.model import ErrorModel
from sensorbook.calibration.motions import Directions, all_motions
from sensorbook.calibration.multi_position import norm_errors
from sensorbook.calibration.positions import cut
from sensorbook.calibration.rest_fit import fit_rests
from sensorbook.calibration.rest_to_rest import direction_errors, rest_to_rest
from sensorbook.earth import STANDARD_GRAVITY as G
from sensorbook.errors import Refusal

ROOT = Path(__file__).resolve().parents[1]
FREE = np.tri(3, dtype=bool)


def line(what: str, value: float, goal: str = "", good: bool = True) -> None:
    print(f"  {what:44s} {value:10.5g}   {goal}{'' if good else '   GOAL MISSED'}")


def xsens(folder: Path) -> None:
    device = sensorbook.load(folder)
    runs, beside = (device.runs(s, "positions") for s in ("accelerometer", "gyroscope"))
    began = time.perf_counter()
    found = find_positions(runs, beside, G)
    fit = multi_position(found.positions, G)
    directions = Directions.by(fit, found.positions)
    rests = fit_rests(found.gyroscope, directions.acceleration)
    motions = all_motions(beside, runs, found, directions, fit.model, rests)
    turned = rest_to_rest(motions, rests, G)
    seconds = time.perf_counter() - began
    means = found.positions.means
    # Counts of 1/415 m/s² from 32768 as declared: the factory's scale and offset in those units.
    factory = ErrorModel(
        np.diag(np.array([415, 413, 415]) / 415), (np.array([33123, 33276, 32360]) - 32768) / 415
    )
    print(f"xsens-mti: {len(means)} rests, {len(motions)} motions")
    line("‖a‖ − g, m/s² rms: nominal", fit.rms_before)
    line("  factory's scale and offset", _rms(norm_errors(factory, found.positions, G)),
         "known 0.0195 with its misalignments")  # fmt: skip
    line(
        "  six parameters",
        multi_position(found.positions, G, 6, check=False).rms_after,
        "known 0.0337",
    )
    line("  imu_tk's cost", _rms(_imu_tk_errors(means)))
    line("  nine parameters", fit.rms_after, "goal ≤ 0.0011", fit.rms_after <= 0.0011)
    line("  nine parameters, held out", fit.rms_check, "goal ≤ 0.0015", fit.rms_check <= 0.0015)
    for axis, inverse, known in zip(
        "xyz", 415 * np.diag(fit.model.matrix), (415, 413, 415), strict=True
    ):
        off = 100 * (inverse / known - 1)
        goal = f"{off:+.2f} % off the factory's {known}; goal 0.2"
        line(f"inverse scale {axis}, counts/(m/s²)", inverse, goal, abs(off) <= 0.2)
    before, after, check = np.degrees(turned.direction_errors)
    line("direction after a motion, ° rms: nominal", before, "known 3.39")
    scale = ErrorModel(np.diag(np.array([4778, 4758, 4766]) / 4778), np.zeros(3))
    line(
        "  factory's scale",
        np.degrees(_rms(direction_errors(motions, np.linalg.inv(scale.matrix)))),
    )
    line("  fitted", after, "goal ≤ 0.55", after <= 0.55)
    line("  held out", check, "goal ≤ 0.65", check <= 0.65)
    line("seconds", seconds, "goal < 10 with the pages", seconds < 10)


def ferraris(folder: Path) -> None:
    with open(folder / "example_ferraris_session.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    values = np.array([[float(row[f"acc_{axis}"]) for axis in "xyz"] for row in rows])
    marks = json.loads((folder / "example_ferraris_session_list.json").read_text(encoding="utf-8"))
    faces = [name for name in marks if "rot" not in name]
    spans = [(marks[f]["start"] / 102.4, marks[f]["end"] / 102.4) for f in faces]
    positions = cut([(np.arange(len(values)) / 102.4, values, None)], [spans], [faces])
    up = np.array([(1 if f[2] == "p" else -1) * np.eye(3)["xyz".index(f[0])] for f in faces])
    print("imucal-ferraris: six faces")
    try:
        multi_position(positions, G)
        print("  norms alone: NOT REFUSED   GOAL MISSED")
    except Refusal as refusal:
        print(f"  norms alone, refused: {refusal.reason}")
    known = np.r_[0.99675, 1.00244, 1.02340, 0.537, -0.616, 0.399]
    for solve in (six_position, recursive):
        model = solve(positions, up, G, 12).model
        got = np.r_[np.diag(model.matrix), model.bias]
        scale, bias = np.abs(got[:3] / known[:3] - 1).max(), np.abs(got[3:] - known[3:]).max()
        line(f"{solve.__name__}: scale off, %", 100 * scale, "goal ≤ 0.2", scale <= 2e-3)
        line(f"{solve.__name__}: bias off, m/s²", bias, "goal ≤ 0.005", bias <= 5e-3)


def _imu_tk_errors(means: np.ndarray) -> np.ndarray:
    def corrected(p):
        matrix = np.zeros((3, 3))
        matrix[FREE] = p[:6]
        return np.linalg.norm(np.linalg.solve(matrix, (means - p[6:]).T), axis=0)

    start = np.r_[np.eye(3)[FREE], np.zeros(3)]
    found = optimize.least_squares(lambda p: G**2 - corrected(p) ** 2, start, x_scale="jac").x
    return corrected(found) - G


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    folder = Path(os.environ.get("SENSORBOOK_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        print(f"no real recordings in {folder}: set SENSORBOOK_REAL_DATA to their folder")
        return
    xsens(folder / "xsens-mti")
    ferraris(folder / "imucal-ferraris")


if __name__ == "__main__":
    main()
