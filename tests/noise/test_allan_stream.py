"""Allan deviation chunk by chunk against the same record in memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook import Refusal
from sensorbook.noise import allan_stream
from sensorbook.noise.allan import allan_deviation, cluster_sizes
from sensorbook.noise.allan_stream import (
    LONGEST,
    allan_deviation_of_chunks,
    in_chunks,
    parquet_chunks,
)


@pytest.fixture
def small(monkeypatch):
    """Sizes that a short record exceeds many times over."""
    monkeypatch.setattr(allan_stream, "LONGEST", 1024)
    monkeypatch.setattr(allan_stream, "ROWS", 2048)


def assert_same(found, expected, rtol=1e-9):
    np.testing.assert_array_equal(found.clusters, expected.clusters)
    np.testing.assert_array_equal(found.tau, expected.tau)
    np.testing.assert_array_equal(found.terms, expected.terms)
    np.testing.assert_allclose(found.deviation, expected.deviation, rtol=rtol)
    assert (found.samples, found.rate, found.overlapping) == (
        expected.samples,
        expected.rate,
        expected.overlapping,
    )


# ---- the same curve as in memory ----


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int16])
def test_equals_the_record_in_memory(dtype):
    walk = np.cumsum(np.random.default_rng(41).normal(size=(3_000_001, 2)), axis=0)
    values = (walk + np.array([500.0, -3.0])).astype(dtype)
    found = allan_deviation_of_chunks(in_chunks(values), 100.0, sensor="gyroscope")
    assert found.sensor == "gyroscope"
    # The same start points and digits, but for those the mean of another stretch costs.
    assert_same(found, allan_deviation(values, 100.0, found.clusters))
    asked = cluster_sizes(len(values), 100.0)
    assert (asked > LONGEST).sum() >= 4
    np.testing.assert_array_equal(found.clusters[asked <= LONGEST], asked[asked <= LONGEST])
    coarse = asked[asked > LONGEST]
    np.testing.assert_array_equal(found.clusters[asked > LONGEST], coarse - coarse % 64)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), samples=st.integers(1000, 12_000))
def test_how_the_record_is_cut_does_not_matter(data, samples):
    values = np.random.default_rng(43).normal(5.0, 1.0, size=(samples, 2))
    cuts = sorted(data.draw(st.lists(st.integers(0, samples), max_size=12)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(allan_stream, "LONGEST", 1024)
        patch.setattr(allan_stream, "ROWS", 2048)
        found = allan_deviation_of_chunks(np.split(values, cuts), 10.0)
        whole = allan_deviation_of_chunks([values], 10.0)
    np.testing.assert_array_equal(found.deviation, whole.deviation)
    assert_same(found, allan_deviation(values, 10.0, found.clusters, exact=False))


def test_clusters_keep_the_order_asked_for(small):
    values = np.random.default_rng(47).normal(size=20_000)
    clusters = [5000, 3, 1000, 3, 1088, 1024]
    found = allan_deviation_of_chunks(np.split(values, [7, 9000]), 1.0, clusters)
    assert found.clusters.tolist() == [5000 - 5000 % 64, 3, 1000, 3, 1088, 1024]
    assert_same(found, allan_deviation(values, 1.0, found.clusters, exact=False))


@pytest.mark.parametrize("samples", [5119, 5120, 5121, 4096 + 64, 10_000])
def test_whole_and_broken_numbers_of_blocks(small, samples):
    values = np.random.default_rng(53).normal(size=samples)
    clusters = [1, 100, 1030, samples // 2]
    found = allan_deviation_of_chunks([values], 1.0, clusters)
    assert_same(found, allan_deviation(values, 1.0, found.clusters, exact=False))


# ---- where the chunks come from ----


def test_memory_map(tmp_path, small):
    values = np.random.default_rng(59).integers(-3000, 3000, (10_000, 4)).astype(np.int16)
    np.save(tmp_path / "record.npy", values)
    mapped = np.load(tmp_path / "record.npy", mmap_mode="r")
    for part, whole in ((mapped, values), (mapped[100:, 1:], values[100:, 1:])):
        pieces = list(in_chunks(part))
        assert [len(p) for p in pieces] == [2048] * 4 + [len(whole) - 8192]
        np.testing.assert_array_equal(np.concatenate(pieces), whole)
        found = allan_deviation_of_chunks(in_chunks(part), 1.0)
        assert_same(found, allan_deviation(whole, 1.0, found.clusters, exact=False))


def test_writable_memory_map_keeps_what_was_written(tmp_path, small):
    np.save(tmp_path / "record.npy", np.zeros(5000))
    mapped = np.load(tmp_path / "record.npy", mmap_mode="c")
    mapped[:] = 1.0
    assert sum(piece.sum() for piece in in_chunks(mapped)) == 5000
    assert mapped.sum() == 5000


def test_parquet(tmp_path, small):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    values = np.random.default_rng(61).normal(size=(10_000, 3)).astype(np.float32)
    names = ["time", "gx", "gy"]
    parquet.write_table(
        pyarrow.table(dict(zip(names, values.T, strict=True))),
        tmp_path / "record.parquet",
        row_group_size=3333,
    )
    chunks = parquet_chunks(tmp_path / "record.parquet", ["gy", "gx"])
    found = allan_deviation_of_chunks(chunks, 1.0)
    assert_same(found, allan_deviation(values[:, [2, 1]], 1.0, found.clusters, exact=False))


def test_memory_does_not_grow_with_the_record(small):
    def peak(samples: int) -> int:
        tracemalloc.start()
        chunk = np.zeros((1000, 3), np.float32)
        allan_deviation_of_chunks((chunk for _ in range(samples // 1000)), 1.0, [1, 10, 1000])
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    # Of three axes every 64th sample in double precision, twice when they are joined.
    grown = peak(400_000) - peak(100_000)
    assert grown < 1.5 * 2 * 300_000 * 3 * 8 / 64


# ---- errors ----


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_sample_that_is_not_finite_is_named(small, bad):
    values = np.zeros((9000, 3), np.float32)
    values[7654, 2] = bad
    with pytest.raises(ValueError, match=r"not finite; .* \(the first is sample 7654\)"):
        allan_deviation_of_chunks(np.split(values, [10, 7000]), 1.0)


def test_too_short_and_empty_records():
    for chunks, count in (([np.zeros(400), np.zeros(599)], 999), ([], 0)):
        with pytest.raises(Refusal, match=f"^The record has {count} samples; the Allan"):
            allan_deviation_of_chunks(chunks, 1.0)


@pytest.mark.parametrize("cluster", [0, 501, 10**6])
def test_cluster_outside_the_record(cluster):
    with pytest.raises(ValueError, match=rf"^cluster size {cluster} is outside 1 … 500"):
        allan_deviation_of_chunks([np.zeros(1000)], 1.0, [1, cluster])


def test_bad_arguments_are_told_before_the_record_is_read():
    unread = iter([np.zeros(1000)])
    with pytest.raises(ValueError, match=r"^rate 0 Hz: give the sampling rate, above zero"):
        allan_deviation_of_chunks(unread, 0)
    with pytest.raises(ValueError, match=r"^cluster size 2\.7 is not a whole number of samples"):
        allan_deviation_of_chunks(unread, 1.0, [1, 2.7])
    assert len(next(unread)) == 1000


def test_chunks_of_different_axes():
    chunks = [np.zeros((500, 3)), np.zeros((500, 1))]
    with pytest.raises(ValueError, match="a chunk of 1 axes follows chunks of 3"):
        allan_deviation_of_chunks(chunks, 1.0)
