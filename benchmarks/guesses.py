"""How often the guesses on a bare log are right, over random motions, units and columns.

    python benchmarks/guesses.py [--seed 1] [--logs 300]

Goal: nothing wrong is stated with high certainty. No peer guesses at all: allantools, MATLAB's
allanvar and magcal take arrays, imu_utils and allan_variance_ros take topics, and each of them takes
the unit for granted, which is printed as what taking the first unit of each sensor's list would get.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from guessing.test_guess import KINDS, SETS, UNITS, written, wrong

from sensorbook import InputError
from sensorbook.guessing import guess_files


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--logs", type=int, default=300)
    options = parser.parse_args()
    rng = np.random.default_rng([options.seed, 0x6E55])
    faults: Counter[tuple[bool, str]] = Counter()
    count: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        for _ in range(options.logs):
            kind, sensors = str(rng.choice(list(KINDS))), SETS[rng.integers(len(SETS))]
            units = {s: str(rng.choice(u)) for s, u in UNITS.items()}
            named, stamps = bool(rng.random() < 0.5), bool(rng.random() < 0.7)
            rate = float(rng.choice([25.0, 50.0, 100.0, 200.0]))
            written(path, kind, sensors, units, int(rng.integers(2**31)), named, stamps, rate)
            count["named" if named else "unnamed"] += len(sensors)
            count["first"] += sum(units[s] == UNITS[s][0] for s in sensors)
            try:
                guessed = guess_files([path])
            except InputError:
                count["untold"] += len(sensors)
                continue
            count["untold"] += len(sensors) - len(guessed.recordings)
            for certainty, sensor, key, value in wrong(
                guessed, kind, sensors, units, named, stamps
            ):
                faults[named, certainty] += 1
                if certainty in ("high", "medium"):
                    print(
                        f"    {certainty}: {kind} {sensor} {key} = {value}, {sensors} {units} named {named}"
                    )
    total = count["named"] + count["unnamed"]
    print(f"{options.logs} logs, {total} recordings, seed {options.seed}")
    for named in (True, False):
        label = "named" if named else "unnamed"
        text = ", ".join(f"{c} {faults[named, c]}" for c in ("high", "medium", "low"))
        print(f"  {label:<8} {count[label]:4d} recordings, wrong: {text}   goal: high 0")
    print(f"  left out, and said so: {count['untold']}")
    print(f"  unit taken for granted: {total - count['first']} of {total} wrong")


if __name__ == "__main__":
    main()
