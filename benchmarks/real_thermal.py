"""Thermal dependence across cycles: a real tag beside its goals, and a seeded study of the verdict.

SENSORBOOK_REAL_DATA=folder python benchmarks/real_thermal.py
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

import sensorbook
from sensorbook.thermal import Sweep, fit_thermal, reduce_sweep

GOALS = {"y": 0.66, "z": 0.61}  # mrad/s, held out by whole cycles
SEEDS = range(50)
BLOCKS = 240
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def tag(folder: Path) -> None:
    """Figures of the tag's gyroscope."""
    runs = sensorbook.load(folder).runs("gyroscope", "thermal")
    sweep = reduce_sweep([(r.time, r.temperature, r.values) for r in runs], [r.file for r in runs])
    fit = fit_thermal(sweep, "gyroscope")
    for axis in "xyz":
        a, r = fit[axis], fit[axis].repeatability
        slopes = ", ".join(
            f"{1e3 * s:.3f} ± {1e3 * e:.3f}" for s, e in zip(r.slopes, r.std, strict=True)
        )
        goal = f"goal {GOALS[axis]}" if axis in GOALS else "goal: not repeatable"
        print(
            f"cats-tag {axis}: degree {a.model.to_results().get('degree')}, across cycles "
            f"{1e3 * a.rms_check:.3f} mrad/s ({goal}); slopes {slopes} mrad/s/°C; "
            f"repeatable: {r.repeatable}"
        )


def cycles(slopes: tuple[float, ...], seed: int) -> Sweep:
    """Cycles over 20 … 44 °C with a loop of 0.6 and correlated noise of 0.23 (first order, 0.9)."""
    generator = np.random.default_rng([18, seed])
    t = 20 + 24 * (1 - np.abs(np.linspace(-1, 1, BLOCKS)))
    direction = np.sign(np.gradient(t))
    values = []
    for slope in slopes:
        e = 0.1 * generator.standard_normal(BLOCKS)
        for i in range(1, BLOCKS):
            e[i] += 0.9 * e[i - 1]
        values.append(slope * t + 0.3 * direction * np.sin(np.pi * (t - 20) / 24) + e)
    n = len(slopes)
    return Sweep(
        time=np.tile(10.0 * np.arange(BLOCKS), n),
        temperature=np.tile(t, n),
        values=np.concatenate(values)[:, None],
        weight=np.ones(n * BLOCKS),
        run=np.repeat(np.arange(n), BLOCKS),
        direction=np.tile(direction, n),
        files=tuple(f"cycle {i + 1}" for i in range(n)),
        block_seconds=10.0,
        disturbed=0,
    )


def study() -> None:
    """How often the verdict is wrong."""
    for slopes, truth in (
        ((0.2, 0.2), True),
        ((0.02, 0.02), True),
        ((0.0, 0.0), True),
        ((0.2, 0.05), False),
        ((0.1, -0.1), False),
    ):
        fits = (fit_thermal(cycles(slopes, seed)).axes[0].repeatability for seed in SEEDS)
        wrong = np.mean([r.repeatable != truth for r in fits])
        word = "false 'not repeatable' (goal 5 % or less)" if truth else "missed 'not repeatable'"
        print(f"slopes {slopes}: {word}: {100 * wrong:.0f} % of {len(SEEDS)}")


if __name__ == "__main__":
    given = Path(os.environ.get("SENSORBOOK_REAL_DATA", SHARED)) / "cats-tag"
    if given.is_dir():
        tag(given)
    else:
        print(f"cats-tag: skipped, {given} is not there")
    study()
