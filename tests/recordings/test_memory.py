"""Readers hold what was asked for and little more: peaks as multiples of the columns read."""

import gc
import sqlite3
import tracemalloc
import weakref

import numpy as np
import pytest
from scipy.io import netcdf_file, savemat

from sensorbook.recordings import open_table
from sensorbook.units import UnitError, factor

COUNT = 100_000
NAMES = tuple("tabcdefgh")


@pytest.fixture(scope="module")
def columns():
    values = np.random.default_rng(21).normal(size=(len(NAMES), COUNT)).round(5)
    return dict(zip(NAMES, values, strict=True))


def csv(path, columns):
    np.savetxt(path, np.stack(list(columns.values()), axis=1), "%.5f", ",",
               header=",".join(columns), comments="")  # fmt: skip


def matlab(path, columns):
    savemat(path, columns, do_compression=True)


def matlab_beside_a_struct(path, columns):
    savemat(path, {**columns, "settings": {"rate": 100.0, "gains": np.arange(3.0)}})


def netcdf(path, columns):
    with netcdf_file(path, "w") as file:
        file.createDimension("time", COUNT)
        for name, values in columns.items():
            file.createVariable(name, "d", ("time",))[:] = values


def npz(path, columns):
    np.savez_compressed(path, **columns)


def sqlite(path, columns):
    with sqlite3.connect(path) as database:
        database.execute(f"CREATE TABLE log ({', '.join(columns)})")
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        database.executemany(f"INSERT INTO log VALUES ({', '.join('?' * len(columns))})", rows)


@pytest.mark.parametrize("write", [csv, matlab, matlab_beside_a_struct, netcdf, npz, sqlite])
def test_two_columns_of_nine_take_less_than_all(tmp_path, columns, write):
    path = tmp_path / ("log.npz" if write is npz else "log.dat")
    write(path, columns)
    there = "" if write is matlab_beside_a_struct else None
    open_table(path, table=there).parse(["t"])  # imports
    gc.disable()  # what goes round in circles is not let go, and counts
    tracemalloc.start()
    try:
        table = open_table(path, table=there)
        table.parse(["a", "h"])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        gc.enable()
    for name in ("a", "h"):
        np.testing.assert_allclose(table.column(name), columns[name], rtol=3e-16)
    # 3 is the goal; all nine columns would be 4.5.
    assert peak < 3 * 2 * 8 * COUNT


def test_an_unknown_unit_keeps_nothing_of_its_caller_alive():
    class Held:
        pass

    def attempt():
        held = Held()
        with pytest.raises(UnitError):
            factor("parsecs an hour", "m/s^2")
        return weakref.ref(held)

    gc.disable()
    try:
        assert attempt()() is None
    finally:
        gc.enable()
