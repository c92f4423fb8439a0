"""Noise terms of the demo device over many seeds: errors, coverage and false terms, beside the goals.

    python benchmarks/demo_noise.py [--seed 1] [--runs 20]

Peers in the same run: the weighted fit of the Allan curve, and work A's read-off, as today's tools
practise it.
"""

from __future__ import annotations

import argparse

import numpy as np

from sensorbook.noise import identify_noise, read_off
from sensorbook.simulate.ahrs import BANDWIDTH, HOURS, PUBLISHED, RATE, TERMS
from sensorbook.simulate.noise import coloured_noise


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="first of the seeds")
    parser.add_argument("--runs", type=int, default=20)
    options = parser.parse_args()
    samples = int(RATE * HOURS * 3600)
    error = {t: [] for t in TERMS}
    weighted = {t: [] for t in TERMS}
    ruler = {t: [] for t in TERMS}
    covered = {t: [] for t in TERMS}
    false_terms = absent = 0
    for seed in range(options.seed, options.seed + options.runs):
        rng = np.random.default_rng([seed, 0xBE])
        for sensor, table in PUBLISHED.items():
            truth = {
                axis: dict(
                    zip(TERMS, np.multiply(table[axis], table["factors"]).tolist(), strict=True)
                )
                for axis in "xyz"
            }
            values = np.column_stack(
                [coloured_noise(samples, RATE, rng, **truth[a], bandwidth=BANDWIDTH) for a in "xyz"]
            )
            identified = identify_noise(values, RATE, sensor)
            fit, read = identified.fit, read_off(identified.curve, identified.low_passes)
            for axis in "xyz":
                for term, true in truth[axis].items():
                    found, bound = fit[axis].terms[term], fit[axis].upper_bounds.get(term)
                    if not true:
                        absent += 1
                        false_terms += found is not None
                        continue
                    low, high = (found.low, found.high) if found else (0.0, bound)
                    covered[term].append(low <= true <= high)
                    error[term].append(found.value / true - 1 if found else np.nan)
                    for peer, errors in ((identified.allan_fit, weighted), (read, ruler)):
                        other = peer[axis].terms[term]
                        errors[term].append(other.value / true - 1 if other else np.nan)
    print(
        f"demo device, {options.runs} seeds from {options.seed}, six axes of {HOURS:g} h at {RATE:g} Hz"
    )
    print(
        f"{'term':20s}{'likelihood: rms':>16s}{'largest':>9s}{'none':>6s}{'covers':>9s}"
        f"{'Allan fit: rms':>16s}{'read-off: rms':>16s}"
    )
    for term in TERMS:
        e = np.array(error[term])
        print(
            f"{term:20s}{rms(e):15.2f}%{100 * np.nanmax(np.abs(e)):8.2f}%{np.isnan(e).sum():6d}"
            f"{100 * np.mean(covered[term]):8.1f}%{rms(np.array(weighted[term])):15.2f}%"
            f"{rms(np.array(ruler[term])):15.2f}%"
        )
    pooled = 100 * np.mean(np.concatenate(list(covered.values())))
    print(f"intervals of N, B and K cover the truth: {pooled:.1f} %    goal 90 … 99 %")
    print(f"K stated where there is none: {false_terms} of {absent} axes    goal: rare")


def rms(relative: np.ndarray) -> float:
    """Root mean square in per cent, of the runs that state a value."""
    return 100 * float(np.sqrt(np.nanmean(relative**2)))


if __name__ == "__main__":
    main()
