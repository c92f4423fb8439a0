"""Attitude from vectors: agreement with scipy, covariance and speed beside their goals and peers.

    python benchmarks/attitude.py [--seed 1] [--epochs 100000]

One thread; peers are scipy's `align_vectors` and `ahrs`' TRIAD and Davenport, timed on fewer epochs in
the same process, best of five.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # before numpy is imported

import numpy as np
from ahrs.filters import TRIAD, Davenport
from scipy.spatial.transform import Rotation

from sensorbook.attitude import davenport, triad
from sensorbook.attitude.frames import ecef_from_geodetic, geodetic_from_ecef
from sensorbook.attitude.rotations import error_vector
from sensorbook.attitude.vectors import SOLVERS

FEW = 3000  # epochs of the peers that work one at a time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--epochs", type=int, default=100_000)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    agreement(rng, options.epochs)
    covariance(rng)
    geodetic(rng, options.epochs)
    speed(rng, options.epochs)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def epochs(rng, size, apart=None, noise=0.0, rotation=None, least=0.0):
    """Measured and reference vectors (size, 2, 3), true matrices; `apart` and `least` in rad."""
    reference = unit(rng.normal(size=(size, 2, 3)))
    if apart is not None:
        across = unit(np.cross(reference[:, 0], rng.normal(size=(size, 3))))
        reference[:, 1] = np.cos(apart) * reference[:, 0] + np.sin(apart) * across
    true = np.swapaxes((rotation or Rotation.random(size, rng=rng)).as_matrix(), -1, -2)
    measured = reference @ np.swapaxes(true, -1, -2)
    measured = unit(measured + noise * rng.normal(size=measured.shape))
    well = np.ones(size, dtype=bool)
    for vectors in (measured, reference):
        well &= np.linalg.norm(np.cross(vectors[:, 0], vectors[:, 1]), axis=-1) >= least
    return measured[well], reference[well], true[well]


def worst(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(error_vector(found, expected), axis=-1).max())


def agreement(rng: np.random.Generator, size: int) -> None:
    print("largest difference from scipy's align_vectors, rad")
    half = Rotation.from_rotvec(
        np.pi * np.vstack([np.eye(3), unit(rng.normal(size=(size // 10, 3)))])
    )
    cases = (
        (f"{size} random, ≥ 0.01 rad apart, noise 0.01", 1e-9, {"noise": 0.01, "least": 0.01}),
        ("0.01 rad apart, no noise", 1e-9, {"apart": 0.01}),
        ("0.01 rad apart, noise 0.001", 1e-9, {"apart": 0.01, "noise": 1e-3, "least": 0.007}),
        ("3e-4 rad apart, no noise", 1e-6, {"apart": 3e-4}),
        ("3e-4 rad apart, noise 3e-5", 1e-6, {"apart": 3e-4, "noise": 3e-5, "least": 2e-4}),
        ("half turns about x, y, z and others", 1e-9, {"rotation": half, "apart": 1.0}),
    )
    for name, goal, how in cases:
        many = len(half) if "rotation" in how else size if "random" in name else size // 5
        g, r, _ = epochs(rng, many, **how)
        w = rng.uniform(0.1, 1.0, (len(g), 2))
        rotations = [
            Rotation.align_vectors(*vectors)[0].as_matrix() for vectors in zip(g, r, w, strict=True)
        ]
        by_solver = {s: worst(f(g, r, w).matrix, np.array(rotations)) for s, f in SOLVERS.items()}
        largest = ", ".join(f"{solver} {value:.1e}" for solver, value in by_solver.items())
        print(f"  {name} ({len(g)} epochs; goal {goal:g}): {largest}")
    g, r, _ = epochs(rng, size // 5, noise=0.01, least=0.01)
    exact = [
        Rotation.align_vectors(a, b, [np.inf, 1])[0].as_matrix() for a, b in zip(g, r, strict=True)
    ]
    off = worst(triad(g, r).matrix, np.array(exact))
    print(f"  TRIAD, scipy's first weight infinite ({len(g)} epochs): {off:.1e}")


def covariance(rng: np.random.Generator) -> None:
    print("normalised error squared, mean over 10⁴ (goal 3 ± 0.1)")
    sigma = np.array([1e-3, 4e-3])
    for name, solver in {**SOLVERS, "TRIAD": triad}.items():
        g, r, true = epochs(rng, 10_500, least=0.2)
        g, r, true = g[:10_000], r[:10_000], true[:10_000]
        off = sigma[:, None] * rng.normal(size=g.shape)
        off -= (off * g).sum(axis=-1, keepdims=True) * g
        found = solver(unit(g + off), r, sigma=sigma)
        error = error_vector(found.matrix, true)
        nees = (error * np.linalg.solve(found.covariance, error[..., None])[..., 0]).sum(axis=-1)
        print(f"  {name}: {nees.mean():.3f} over {len(nees)}")


def geodetic(rng: np.random.Generator, size: int) -> None:
    print("geodetic round trip")
    for low, high, goal in ((-1e4, 2e6, 1e-8), (2e6, 5e7, 5e-8)):
        latitude = np.arcsin(rng.uniform(-1, 1, size))
        latitude[: size // 10] = np.pi / 2 - 10 ** rng.uniform(-16, -2, size // 10)
        latitude[0], latitude[1] = np.pi / 2, -np.pi / 2
        longitude, height = rng.uniform(-np.pi, np.pi, size), rng.uniform(low, high, size)
        found = geodetic_from_ecef(ecef_from_geodetic(latitude, longitude, height))
        off = [
            np.abs(f - t).max() for f, t in zip(found, (latitude, longitude, height), strict=True)
        ]
        print(
            f"  {low / 1e3:g} to {high / 1e3:g} km: height {off[2]:.1e} m (goal {goal:g}), latitude "
            f"{off[0]:.1e} rad (goal 2e-15), longitude {np.abs(found[1] - longitude)[2:].max():.1e} rad"
        )


def speed(rng: np.random.Generator, size: int) -> None:
    print(f"seconds a solve, {size} epochs in a batch")
    g, r, _ = epochs(rng, size, noise=0.01, least=0.01)
    shared = r[0]  # the peers of ahrs take one pair of references

    def one_by_one() -> None:
        for measured, reference in zip(g[:FEW], r[:FEW], strict=True):
            Rotation.align_vectors(measured, reference)

    peers = {
        "ahrs TRIAD": best(lambda: TRIAD(g[:FEW, 0], g[:FEW, 1], *shared)) / FEW,
        "ahrs Davenport": best(lambda: Davenport(g[:FEW, 0], g[:FEW, 1])) / FEW,
        "scipy align_vectors": best(one_by_one) / FEW,
    }
    for name, took in peers.items():
        print(f"  {name}: {took * 1e6:.2f} µs")
    for name, solver in {"TRIAD": triad, **SOLVERS}.items():
        took = best(lambda solver=solver: solver(g, r).matrix) / len(g)
        beside = {peer: peers[peer] / took for peer in peers}
        told = ", ".join(f"{ratio:.0f} × {peer}" for peer, ratio in beside.items())
        print(f"  {name}: {took * 1e6:.3f} µs: {told}")
    took = best(lambda: triad(g, r).matrix) / len(g)
    print(f"  TRIAD {peers['ahrs TRIAD'] / took:.0f} × ahrs TRIAD (goal 200)")
    took = best(lambda: davenport(g, r).matrix) / len(g)
    print(
        f"  Davenport {peers['ahrs Davenport'] / took:.1f} × ahrs Davenport (goal 10), "
        f"{peers['scipy align_vectors'] / took:.1f} × scipy align_vectors (goal 15)"
    )


def best(work, times: int = 5) -> float:
    took = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        took.append(time.perf_counter() - began)
    return min(took)


if __name__ == "__main__":
    main()
