"""Allan deviation of records that do not fit into memory, in one pass over their chunks.

Up to cluster sizes of 2¹⁸ samples the running integral is held at the full rate, as long as two
clusters reach; beyond, every 64th sample of the whole integral is kept: 125 MB an axis for 10⁹ samples.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from sensorbook.noise.allan import (
    AllanCurve,
    as_columns,
    check_finite,
    check_rate,
    chosen_clusters,
    cluster_sizes,
    curve_from_sums,
    integrate,
    squared_differences,
    thinned,
    whole_clusters,
)

LONGEST = 2**18  # cluster size up to which every sample of the integral is at hand
ROWS = 2**20  # samples, and start points, taken at once; a multiple of every stride up to LONGEST
DECIMATION = 64  # of the integral for longer clusters; their strides are multiples of it


def in_chunks(values: np.ndarray) -> Iterator[np.ndarray]:
    """The rows of an array in pieces; pages of a memory map are handed back after use."""
    root = values
    while isinstance(root, np.ndarray):
        root = root.base
    mapped = isinstance(root, mmap.mmap) and not values.flags.writeable
    for i in range(0, len(values), ROWS):
        yield values[i : i + ROWS]
        if mapped and hasattr(root, "madvise"):
            root.madvise(mmap.MADV_DONTNEED)


def parquet_chunks(path: str | Path, columns: Sequence[str]) -> Iterator[np.ndarray]:
    """(n, A) pieces of a Parquet file, one column an axis. Needs pyarrow."""
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        for batch in file.iter_batches(ROWS, columns=list(columns)):
            yield np.column_stack([batch.column(name).to_numpy(False) for name in columns])


def allan_deviation_of_chunks(
    chunks: Iterable[np.ndarray],
    rate: float,
    clusters: np.ndarray | None = None,
    *,
    sensor: str = "",
) -> AllanCurve:
    """Overlapping Allan deviation of a record given piece by piece, with thinned start points.

    The same as ``allan_deviation(values, rate, clusters, exact=False)``, but for cluster sizes above 2¹⁸
    samples, which are rounded down to multiples of 64: by at most 1/4096 of themselves. The curve
    holds the sizes used. How the record is cut into chunks does not matter.

    Parameters
    ----------
    chunks : arrays (n,) or (n, A) of any real type: `in_chunks` of a memory map, `parquet_chunks`
    rate : Hz
    clusters : cluster sizes m in samples; `cluster_sizes` where None

    Raises
    ------
    Refusal, ValueError
        as `allan_deviation`; of cluster sizes beyond N/2 once N is known, at the end
    """
    check_rate(rate)
    wanted = cluster_sizes(5 * LONGEST, rate) if clusters is None else whole_clusters(clusters)
    near = np.unique(wanted[(wanted >= 1) & (wanted <= LONGEST)])
    strides = thinned(near)
    samples = 0
    for block in _blocks(chunks):
        rows, axes = block.shape
        if samples == 0:
            # θ from sample `samples` + 1 − `held` on; the first block's mean stands for the record's.
            mean = block.mean(axis=0)
            theta, held = np.zeros((axes, 2 * (LONGEST + ROWS))), 1
            sums = np.zeros((len(near), axes))
            coarse = [np.zeros((axes, 1))]
        for axis in range(axes):
            integrate(block[:, axis], mean[axis], theta[axis, held - 1 :])
        if not np.isfinite(theta[:, held + rows - 1]).all():
            check_finite(block, samples)
        samples, held = samples + rows, held + rows
        first = held - rows + -(samples - rows + 1) % DECIMATION
        coarse.append(theta[:, first:held:DECIMATION].copy())
        if held >= ROWS + 2 * LONGEST:
            for axis in range(axes):
                sums[:, axis] += squared_differences(theta[axis, :held], near, strides, ROWS)
            held -= ROWS
            theta[:, :held] = theta[:, ROWS : ROWS + held]
    clusters = chosen_clusters(clusters, samples, rate)
    long = clusters > LONGEST
    clusters = np.where(long, clusters // DECIMATION * DECIMATION, clusters)
    far = np.unique(clusters[long])
    coarse = np.concatenate(coarse, axis=1)
    below = np.zeros((len(far), axes))
    for axis in range(axes):
        sums[:, axis] += squared_differences(theta[axis, :held], near, strides)
        below[:, axis] = squared_differences(
            coarse[axis], far // DECIMATION, thinned(far) // DECIMATION
        )
    # `near` and `far` are sorted, and so are both together (LONGEST may be in both).
    sums = np.concatenate([sums, below])[np.searchsorted(np.append(near, far), clusters)]
    terms = (samples - 2 * clusters) // thinned(clusters) + 1
    return curve_from_sums(sums, terms, clusters, samples, rate, sensor)


def _blocks(chunks: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """The same rows (ROWS, A) at a time, the last block shorter, however they come."""
    block, filled = np.empty((0, 0)), 0
    for chunk in chunks:
        chunk = as_columns(chunk)
        if not block.size:
            block = np.empty((chunk.shape[1], ROWS)).T
        if chunk.shape[1] != block.shape[1]:
            raise ValueError(
                f"a chunk of {chunk.shape[1]} axes follows chunks of {block.shape[1]}: all must "
                "have the same"
            )
        while len(chunk):
            part = chunk[: ROWS - filled]
            block[filled : filled + len(part)] = part
            filled, chunk = filled + len(part), chunk[len(part) :]
            if filled == ROWS:
                yield block
                filled = 0
    if filled:
        yield block[:filled]
