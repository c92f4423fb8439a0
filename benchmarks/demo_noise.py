"""Noise terms of the demo device over many seeds: errors, coverage and false terms, beside the goals.

    python benchmarks/demo_noise.py [--seed 1] [--runs 20]

Peers in the same run: work A's read-off, as today's tools practise it, and `allantools.oadev`.
"""

from __future__ import annotations

import argparse
import time

import allantools
import numpy as np

from sensorbook.noise import allan_deviation, find_low_pass, fit_terms, read_off
from sensorbook.simulate.ahrs import BANDWIDTH, HOURS, PUBLISHED, RATE, TERMS
from sensorbook.simulate.noise import coloured_noise


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="first of the seeds")
    parser.add_argument("--runs", type=int, default=20)
    options = parser.parse_args()
    samples = int(RATE * HOURS * 3600)
    error = {t: [] for t in TERMS}
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
            low_passes = [find_low_pass(v, RATE) for v in values.T]
            curve = allan_deviation(values, RATE, sensor=sensor)
            fit, read = fit_terms(curve, low_passes), read_off(curve, low_passes)
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
                    rough = read[axis].terms[term]
                    ruler[term].append(rough.value / true - 1 if rough else np.nan)
    print(
        f"demo device, {options.runs} seeds from {options.seed}, six axes of {HOURS:g} h at {RATE:g} Hz"
    )
    print(
        f"{'term':20s}{'fit: rms error':>16s}{'largest':>9s}{'none':>6s}{'covers':>9s}{'read-off: rms':>16s}"
    )
    for term in TERMS:
        e, r = np.array(error[term]), np.array(ruler[term])
        print(
            f"{term:20s}{rms(e):15.2f}%{100 * np.nanmax(np.abs(e)):8.2f}%{np.isnan(e).sum():6d}"
            f"{100 * np.mean(covered[term]):8.1f}%{rms(r):15.2f}%"
        )
    pooled = 100 * np.mean(np.concatenate(list(covered.values())))
    print(f"intervals of N, B and K cover the truth: {pooled:.1f} %    goal 90 … 99 %")
    print(f"K stated where there is none: {false_terms} of {absent} axes    goal: rare")
    compare_with_allantools(values, curve)


def rms(relative: np.ndarray) -> float:
    """Root mean square in per cent, of the runs that state a value."""
    return 100 * float(np.sqrt(np.nanmean(relative**2)))


def compare_with_allantools(values: np.ndarray, curve) -> None:
    start = time.perf_counter()
    allan_deviation(values, RATE, curve.clusters)
    own = time.perf_counter() - start
    start = time.perf_counter()
    peer = [
        allantools.oadev(v - v.mean(), rate=RATE, data_type="freq", taus=curve.tau)[1]
        for v in values.T
    ]
    theirs = time.perf_counter() - start
    difference = np.max(np.abs(np.column_stack(peer) / curve.deviation - 1))
    print(
        f"Allan deviation of three axes at {len(curve.tau)} cluster times: {own:.2f} s, allantools "
        f"{theirs:.2f} s; largest relative difference {difference:.1e}    goal: below 1e-9"
    )


if __name__ == "__main__":
    main()
