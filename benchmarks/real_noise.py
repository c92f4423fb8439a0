"""Noise terms of real recordings: do they repeat, and does the fit give the Allan curve within its band?

    SENSORBOOK_REAL_DATA=folder python benchmarks/real_noise.py

Three recordings of one ADIS16405 at rest. Where an axis leaves its band the report says so.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy import signal

import sensorbook
from sensorbook.noise import identify_noise
from sensorbook.noise.agreement import departures
from sensorbook.units import field_unit

RECORDINGS = ("adis16405-1", "adis16405-2", "adis16405-3")
FLOOR = (
    4.2,
    8.0,
)  # Hz, between the lines and below the roll-off: what no estimator can make repeat
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def main() -> None:
    folder = Path(os.environ.get("SENSORBOOK_REAL_DATA", SHARED))
    if not folder.is_dir():
        print(f"skipped: no real recordings in {folder} (SENSORBOOK_REAL_DATA)")
        return
    for sensor in ("gyroscope", "accelerometer"):
        found, floors = [], []
        for name in RECORDINGS:
            rest = sensorbook.load(str(folder / name)).runs(sensor, "static")[0]
            rest, _ = rest.evenly_sampled()
            found.append(identify_noise(rest.values, rest.rate, sensor))
            f, density = signal.welch(rest.values, rest.rate, nperseg=4096, axis=0)
            floors.append(np.sqrt(np.median(density[(f > FLOOR[0]) & (f < FLOOR[1])], axis=0) / 2))
        label, si = field_unit(sensor, "random_walk")
        print(
            f"{sensor}, N [{label}] over {len(RECORDINGS)} recordings    goal: within 5 % of the mean"
        )
        for i, axis in enumerate("xyz"):
            n = np.array([f.fit.axes[i].terms["random_walk"].value for f in found]) / si
            allan = np.array([f.allan_fit.axes[i].terms["random_walk"].value for f in found]) / si
            spread = 100 * np.abs(n / n.mean() - 1).max()
            floor = np.array([f[i] for f in floors]) / si
            own = 100 * np.abs(floor / floor.mean() - 1).max()
            listed = ", ".join(f"{v:.4g}" for v in n)
            print(f"  {axis}: {listed}    {spread:.1f} % from the mean; from the Allan curve "
                  f"{', '.join(f'{v:.4g}' for v in allan)}; Welch's floor itself {own:.1f} %")  # fmt: skip
        print(f"{sensor}, cluster times at which the fit lies in the Allan curve's 95 % band")
        for name, f in zip(RECORDINGS, found, strict=True):
            for i, axis in enumerate("xyz"):
                a, deviation = f.fit.axes[i], f.curve.deviation[:, i]
                model = np.sqrt(a.variance)
                inside = np.mean((model >= a.band[:, 0]) & (model <= a.band[:, 1]))
                left = [
                    f"{m.tau_range[0]:.3g}–{m.tau_range[1]:.3g} s by {100 * m.size:+.2g} %"
                    for m in departures(f.curve.tau, a.band, deviation, model)
                ]
                print(
                    f"  {name} {axis}: {100 * inside:3.0f} %{'; told: ' if left else ''}{', '.join(left)}"
                )


if __name__ == "__main__":
    main()
