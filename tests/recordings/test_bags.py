"""ROS bags and MCAP: what independent libraries wrote comes back, and what cannot be read is said."""

import numpy as np
import pytest
from mcap.writer import CompressionType

from recordings import bag_writers
from recordings.bag_writers import BEGIN, SECOND, WRITERS, field, imu, temperature
from sensorbook.recordings import open_table
from sensorbook.recordings.tables import table_names

COUNT = 300
STEP = 5_000_000  # ns
VECTORS = [f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
QUATERNION = [f"orientation.{axis}" for axis in "xyzw"]


@pytest.fixture
def numbers():
    """(COUNT, 10) doubles of all sizes, with a NaN, and the stamps: ns since 1970, of odd digits."""
    rng = np.random.default_rng(5)
    numbers = rng.normal(size=(COUNT, 10)) * 10.0 ** rng.integers(-300, 300, (COUNT, 10))
    numbers[7, 2] = np.nan
    return numbers, BEGIN + STEP * np.arange(COUNT) + rng.integers(0, 1000, COUNT)


def sent(numbers, attitude=True):
    values, stamps = numbers
    return [
        imu(tuple(v[:3]), tuple(v[3:6]), stamp=int(t), attitude=tuple(v[6:]) if attitude else None)
        for v, t in zip(values.tolist(), stamps, strict=True)
    ]


def columns(table, names):
    return np.stack([table.column(name) for name in names], axis=1)


@pytest.mark.parametrize("form", WRITERS)
def test_what_was_written_comes_back_to_the_bit(tmp_path, numbers, form):
    path = tmp_path / "log.dat"
    WRITERS[form](path, sent(numbers))
    assert table_names(path) == ("/imu/data",)
    table = open_table(path)
    values, stamps = numbers
    np.testing.assert_array_equal(columns(table, VECTORS + QUATERNION), values)
    np.testing.assert_array_equal(table.column("stamp"), stamps)
    np.testing.assert_array_equal(table.column("received"), stamps + 2_000_000)
    units = dict(zip(table.names, table.units, strict=True))
    assert [units[name] for name in VECTORS] == ["rad/s"] * 3 + ["m/s^2"] * 3
    assert (units["stamp"], units["received"]) == ("ns", "ns")
