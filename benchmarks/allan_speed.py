"""Speed, memory and accuracy of the Allan deviation beside their goals and `allantools.oadev`.

    python benchmarks/allan_speed.py [--seed 1] [--samples 10000000] [--from-disk 1000000000]

One thread, both in the same process, best of five. The record on disk is written to the folder for
temporary files, 2 bytes a sample, and deleted.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

# Before numpy is imported: one thread, and the kernels that OpenBLAS finds for this processor.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
for name in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    os.environ.pop(name, None)

import allantools  # noqa: E402
import numpy as np  # noqa: E402

from sensorbook.noise.allan import allan_deviation  # noqa: E402
from sensorbook.noise.confidence import confidence_limits  # noqa: E402

FROM_DISK = """
import resource, sys
import numpy as np
from sensorbook.noise.allan_stream import allan_deviation_of_chunks, in_chunks
curve = allan_deviation_of_chunks(in_chunks(np.memmap(sys.argv[1], np.int16, "r")), 1000.0)
print(len(curve.tau), curve.at(1.0)[0], curve.deviation[-1, 0] * curve.tau[-1] ** 0.5,
      resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--samples", type=int, default=10**7)
    parser.add_argument(
        "--from-disk", type=int, default=10**9, help="samples of the record on disk"
    )
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    # First, while this process is small: a child's peak memory begins at its parent's.
    for samples in (options.from_disk // 10, options.from_disk):
        from_disk(samples, rng)
    in_memory(options.samples, rng)


def from_disk(samples: int, rng: np.random.Generator) -> None:
    """White counts from −400 to 600 at 1 kHz, from a memory map."""
    with tempfile.TemporaryDirectory() as folder:
        if shutil.disk_usage(folder).free < 1.5 * 2 * samples:
            print(f"{samples:.0e} samples from disk: left out, {folder} has no room")
            return
        path = Path(folder) / "record.int16"
        with path.open("wb") as file:
            for start in range(0, samples, 2**22):
                count = min(2**22, samples - start)
                rng.integers(-400, 600, count, np.int16, endpoint=True).tofile(file)
        start = time.perf_counter()
        child = subprocess.run(
            [sys.executable, "-c", FROM_DISK, str(path)], check=True, capture_output=True, text=True
        )
        elapsed = time.perf_counter() - start
    count, second, longest, peak = map(float, child.stdout.split())
    print(
        f"{samples:.0e} int16 samples from disk, {count:.0f} cluster times: {elapsed:.1f} s, peak memory "
        f"of the process {peak:.2f} GB    goal for 1e9: 2 GB"
    )
    true = np.sqrt((1001**2 - 1) / 12 / 1000)
    print(
        f"    σ√τ over the truth: {second / true:.4f} at 1 s, {longest / true:.2f} at the longest"
    )


def in_memory(samples: int, rng: np.random.Generator) -> None:
    values = rng.standard_normal(samples)
    clusters = np.unique(np.round(np.geomspace(1, samples // 5, 109)).astype(np.int64))
    theirs, peer = best_of(
        lambda: allantools.oadev(values, rate=1.0, data_type="freq", taus=clusters)[1]
    )
    print(
        f"{samples:.0e} samples, {len(clusters)} cluster times up to T/5: allantools.oadev "
        f"{theirs:.2f} s"
    )
    for name, exact, goal in (("exact", True, 3.5), ("default", None, 12)):
        own, curve = best_of(
            lambda exact=exact: allan_deviation(values, 1.0, clusters, exact=exact)
        )
        tracemalloc.start()
        allan_deviation(values, 1.0, clusters, exact=exact)
        peak = tracemalloc.get_traced_memory()[1] / values.nbytes
        tracemalloc.stop()
        print(f"{name}: {own:.3f} s, {theirs / own:.1f} times as fast    goal: {goal} times")
        print(f"    peak memory beyond the input: {peak:.2f} of it    goal: 1.3")
        difference = np.abs(curve.deviation[:, 0] / peer - 1)
        if exact:
            print(f"    largest relative difference: {difference.max():.1e}    goal: below 1e-9")
            continue
        edf, _ = confidence_limits(curve)
        worst = np.argmax(difference * np.sqrt(2 * edf[:, 0]))
        print(
            f"    largest difference in standard errors: {100 * difference[worst]:.4f} % at "
            f"m = {clusters[worst]}, where the standard error is {100 / np.sqrt(2 * edf[worst, 0]):.4f} %"
        )
    for axes, dtype in ((1, np.float32), (1, np.int16), (3, np.float32)):
        other = (1000 * values[: samples // axes * axes].reshape(-1, axes)).astype(dtype)
        some = clusters[clusters <= len(other) // 5]
        own, _ = best_of(lambda other=other, some=some: allan_deviation(other, 1.0, some))
        tracemalloc.start()
        allan_deviation(other, 1.0, some)
        peak = tracemalloc.get_traced_memory()[1] / (8 * len(other))
        tracemalloc.stop()
        print(
            f"default, {other.dtype} {other.shape}: {own:.3f} s; peak memory beyond the input: {peak:.2f} "
            "of one axis in float64"
        )


def best_of(function):
    """Shortest time of five runs, s, and the result."""
    times = []
    for _ in range(5):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


if __name__ == "__main__":
    main()
