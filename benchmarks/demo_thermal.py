"""Thermal models of the demo device over many seeds: jumps found, intervals, and work A's polynomials.

    python benchmarks/demo_thermal.py [--seed 1] [--runs 10]

The peer in the same run is the best of work A's polynomials (degrees 1, 3, 5) on the same held-out data.
"""

from __future__ import annotations

import argparse

import numpy as np

from sensorbook.simulate.ahrs import THERMAL, UNITS, swept, thermal_change
from sensorbook.thermal import fit_thermal, reduce_sweep


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="first of the seeds")
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    found, invented, size, change, ratio = [], [], [], [], []
    for seed in range(options.seed, options.seed + options.runs):
        table = swept(np.random.default_rng([seed, 0x7E]))
        for sensor, (_, si) in UNITS.items():
            values = np.column_stack([table[sensor[0] + axis] for axis in "xyz"]) * si
            sweep = reduce_sweep([(table["t"], table["temperature"], values)])
            fit = fit_thermal(sweep, sensor)
            ends = np.array(sweep.span)
            for axis, curve in THERMAL[sensor].items():
                a, jump = fit[axis], curve[2] * si
                true = np.subtract(*thermal_change(ends, *curve)[::-1]) * si
                change.append(a.change.low <= true <= a.change.high)
                if not jump:
                    invented.append(a.jump is not None)
                    continue
                found.append(a.jump is not None)
                if a.jump:
                    size.append(a.jump.low <= jump <= a.jump.high)
                    best = min(a.rms_of(f"degree {d}").rms_check for d in (1, 3, 5))
                    ratio.append(best / a.rms_check)
    print(f"demo device, {options.runs} seeds from {options.seed}, six axes swept 20 … 44 … 20 °C")
    print(f"jumps found: {sum(found)} of {len(found)}    goal: all")
    print(f"jumps invented: {sum(invented)} of {len(invented)}    goal: none")
    print(
        f"the jump's 95 % interval holds the truth: {100 * np.mean(size):.0f} %    goal 90 … 99 %"
    )
    print(
        f"the change's 95 % interval holds the truth: {100 * np.mean(change):.0f} %    goal 90 … 99 %"
    )
    print(
        "held-out rms of work A's best polynomial over ours, where the curve jumps: median "
        f"{np.median(ratio):.1f}, least {np.min(ratio):.1f}    goal: above 1"
    )


if __name__ == "__main__":
    main()
