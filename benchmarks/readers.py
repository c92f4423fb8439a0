"""Time and memory of the readers beside their goals and their peers.

    python benchmarks/readers.py [--rows 10000000] [--seed 1]

The log is a rest: time, gyroscope, accelerometer and temperature. Each file is read in a process of
its own that has read a small file of the format before; memory is how far its peak then rises, as a
multiple of the columns read (float64). One thread. Peers read the same columns in the same way;
numpy.loadtxt reads a hundredth and is scaled.
"""

from __future__ import annotations

import argparse
import gzip
import resource
import sqlite3
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

NAMES = ("t", "gx", "gy", "gz", "ax", "ay", "az", "temp")
THREE, SEVEN = NAMES[1:4], NAMES[:7]
TIME, MEMORY = 15.0, 3.0  # goals for 1e7 rows of .csv, s, and of the columns read
FORMATS = (".csv.gz", ".parquet", ".feather", ".h5", ".mat", ".nc", ".db", ".npz")
_STEP = 10**6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=10**7)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows, share = options.rows, options.rows / 10**7
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        fresh(write_csv, folder / "log.csv", rows, options.seed)
        fresh(write_others, folder, "log", rows // 10, options.seed)
        fresh(write_csv, folder / "small.csv", 1000, options.seed)
        fresh(write_others, folder, "small", 1000, options.seed)
        size = (folder / "log.csv").stat().st_size / 1e6
        print(f"{rows:.0e} rows × {len(NAMES)} columns, {size:.0f} MB of .csv")
        csv = folder / "log.csv"
        for columns in (THREE, SEVEN):
            told(f".csv, {len(columns)} columns", fresh(measure, read, csv, columns), rows,
                 columns, TIME * share)  # fmt: skip
            told(
                "    pandas.read_csv", fresh(measure, read_with_pandas, csv, columns), rows, columns
            )
        few = fresh(write_csv, folder / "few.csv", rows // 100, options.seed)
        seconds, _ = fresh(measure, read_with_loadtxt, folder / "few.csv", THREE)
        print(f"{'    numpy.loadtxt, 3 columns':<31}{seconds * rows / few:7.1f} s")
        told("load, guessed", fresh(measure, load, csv, NAMES), rows, NAMES, 40 * share)
        told("check", fresh(measure, check, csv, NAMES), rows, NAMES, 40 * share)
        csv.unlink()
        print(f"{rows // 10:.0e} rows, 3 columns of {len(NAMES)}")
        for ending in FORMATS:
            told(ending, fresh(measure, read, folder / f"log{ending}", THREE), rows // 10, THREE)


def told(what: str, figures: tuple[float, float], rows: int, columns, goal: float = 0.0) -> None:
    """Prints a time in s and a peak in bytes beside their goals."""
    seconds, peak = figures
    multiple = peak / (8 * rows * len(columns))
    is_peer = what.startswith(" ")
    limit = "" if is_peer else f"   goal {MEMORY:g}"
    limit = f"   goal {goal:g} s and {MEMORY:g}" if goal else limit
    print(f"{what:<31}{seconds:7.1f} s {multiple:7.2f} of the columns in memory{limit}", flush=True)


def fresh(function, *arguments):
    """What a function returns in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def measure(function, path: Path, columns) -> tuple[float, float]:
    """Seconds, and bytes by which the peak memory rises, after a first run on a small file."""
    function(path.with_name("small" + path.name[path.name.index(".") :]), columns)
    before, start = _peak(), time.perf_counter()
    held = function(path, columns)
    seconds = time.perf_counter() - start
    del held
    return seconds, _peak() - before


def _peak() -> float:
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


# ---- what is measured ----


def read(path: Path, columns):
    from sensorbook.recordings import open_table

    table = open_table(path)
    table.parse(columns)
    return table, [table.column(name) for name in columns]


def read_with_pandas(path: Path, columns):
    import pandas

    return pandas.read_csv(path, usecols=list(columns))


def read_with_loadtxt(path: Path, columns):
    import numpy as np

    places = [NAMES.index(name) for name in columns]
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=places)


def load(path: Path, columns):
    import sensorbook

    device = sensorbook.load(path)
    return device, device.gyroscope.static, device.accelerometer.static


def check(path: Path, columns):
    from sensorbook.recordings import check_device

    device, problems, findings = check_device(path)
    if problems:
        raise AssertionError(problems)
    return device, findings, device.advice()


# ---- the files ----


def table(first: int, count: int, seed: int):
    """Rows of a rest at 100 Hz: s, deg/s, m/s², °C, with the digits that loggers print."""
    import numpy as np
    import pyarrow

    rng = np.random.default_rng([seed, first])
    steps = np.arange(first, first + count)
    gyroscope = (0.2 + 0.05 * rng.standard_normal((3, count))).round(5)
    accelerometer = (0.01 * rng.standard_normal((3, count))).round(4)
    accelerometer[2] = (accelerometer[2] + 9.8).round(4)
    temperature = (25 + np.sin(steps / 1e6) + 0.05 * rng.standard_normal(count)).round(2)
    columns = (steps / 100, *gyroscope, *accelerometer, temperature)
    return pyarrow.table(dict(zip(NAMES, columns, strict=True)))


def write_csv(path: Path, rows: int, seed: int) -> int:
    from pyarrow import csv

    first = table(0, min(rows, _STEP), seed)
    with csv.CSVWriter(path, first.schema) as writer:
        writer.write_table(first)
        for start in range(_STEP, rows, _STEP):
            writer.write_table(table(start, min(_STEP, rows - start), seed))
    return rows


def write_others(folder: Path, stem: str, rows: int, seed: int) -> None:
    import h5py
    import numpy as np
    from pyarrow import csv, feather, parquet
    from scipy.io import netcdf_file, savemat

    log = table(0, rows, seed)
    arrays = {name: log[name].to_numpy() for name in NAMES}
    path = str(folder / stem)
    with gzip.open(f"{path}.csv.gz", "wb", compresslevel=1) as stream:
        csv.write_csv(log, stream)
    parquet.write_table(log, f"{path}.parquet")
    feather.write_feather(log, f"{path}.feather", compression="lz4")
    with h5py.File(f"{path}.h5", "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values, chunks=True, compression="gzip")
    savemat(f"{path}.mat", arrays, do_compression=True, oned_as="column")
    with netcdf_file(f"{path}.nc", "w") as file:
        file.createDimension("time", rows)
        for name, values in arrays.items():
            file.createVariable(name, "d", ("time",))[:] = values
    with sqlite3.connect(f"{path}.db") as database:
        database.execute(f"CREATE TABLE log ({', '.join(NAMES)})")
        marks = ", ".join("?" * len(NAMES))
        rows_of = zip(*(values.tolist() for values in arrays.values()), strict=True)
        database.executemany(f"INSERT INTO log VALUES ({marks})", rows_of)
    np.savez(f"{path}.npz", **arrays)


if __name__ == "__main__":
    main()
