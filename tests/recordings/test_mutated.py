"""Damaged files: 300 of them at random, and the damage that once passed unseen, one by one."""

import struct

import h5py
import numpy as np
import pytest

from recordings.mutants import FORMATS, ROWS, Mutant, columns, fault, outcome, run
from sensorbook import InputError
from sensorbook.recordings import open_table
from sensorbook.recordings.mat5 import check_elements
from sensorbook.recordings.tables import MAX_BYTES, Source

SEED, COUNT = 20240501, 300


def test_no_damage_passes_unseen():
    told = run(SEED, COUNT)
    assert [t for t in told if t.is_fault] == []
    assert {t.form for t in told} == set(FORMATS)
    assert len(told) == COUNT
    # A test of readers that refuse all, or of damage that does none, would show nothing.
    kinds = [t.kind for t in told]
    assert 0.5 * COUNT < kinds.count("refused") < 0.95 * COUNT
    assert kinds.count("other") > 0.05 * COUNT


def test_what_is_silently_wrong_is_found():
    written = list(columns().items())
    shorter = [(name, values[:-1]) for name, values in written]
    other = [(name, np.where(np.arange(ROWS) < 50, 0.125, values)) for name, values in written]
    cut, flipped = Mutant(b"", "cut", 100, 200), Mutant(b"", "flip", 100, 101)
    for form in ("hdf5", "sqlite", "npz", "parquet"):
        expected = f"[{ROWS - 1}] rows of {ROWS}"
        assert fault(FORMATS[form], b"", written, cut, shorter) == expected
        assert fault(FORMATS[form], b"", written, cut, written[1:]) == "4 columns of 5"
        assert fault(FORMATS[form], b"", written, cut, other) == "250 values differ"
    assert fault(FORMATS["npz"], b"", written, flipped, other) == "250 values differ"
    assert fault(FORMATS["hdf5"], b"", written, flipped, other).startswith("250 values differ")


@pytest.fixture
def damaged(tmp_path):
    """What the readers say of a file of this format whose bytes a function has changed."""

    def read(form, change):
        path = tmp_path / "log.dat"
        FORMATS[form].write(path, columns())
        assert outcome(path)[0] == "read"
        whole = path.read_bytes()
        content = change(bytearray(whole))
        assert content != whole
        path.write_bytes(content)
        return outcome(path)

    return read


def _is_damaged(kind):
    return f"log.dat: is a damaged {kind} file, or one that is cut off — save or copy it again"


@pytest.mark.parametrize(("form", "message"), [
    ("hdf5", _is_damaged("HDF5")),
    ("hdf5-gzip", _is_damaged("HDF5")),
    ("netcdf4", _is_damaged("HDF5")),
    ("matlab7.3", _is_damaged("MATLAB v7.3")),
    ("netcdf3", _is_damaged("netCDF")),
    ("sqlite", "log.dat: is a damaged SQLite file, or one that is cut off — copy it again"),
])  # fmt: skip
def test_eight_bytes_too_many_among_the_values(damaged, form, message):
    def insert(content):
        at = len(content) * 9 // 10
        return content[:at] + bytes(8) + content[at:]

    assert damaged(form, insert) == ("refused", message)


ARCHIVE = ("refused", "log.dat: is a damaged .npz archive — save or copy it again")


def test_an_archive_whose_directory_skips_a_member(damaged):
    def skip(content):
        at = content.rindex(b"PK\x01\x02", 0, content.rindex(b"PK\x01\x02"))
        length = struct.unpack_from("<HHH", content, at + 28)
        after = len(content) - content.rindex(b"PK\x01\x02")
        # The last entry but one takes all that follows for its comment.
        struct.pack_into("<H", content, at + 32, length[2] + after - 22)
        return content

    assert damaged("npz", skip) == ARCHIVE


@pytest.mark.parametrize(("old", "new"), [
    (f"({ROWS},)".encode(), b"(1000,)"),  # the check sum stands for the whole member
    (f"({ROWS},)".encode(), b"(40,50)"),
    (b"\x93NUMPY", b"\x93NUMPX"),
])  # fmt: skip
def test_an_array_that_is_not_what_it_declares(damaged, old, new):
    assert damaged("npz", lambda content: content.replace(old, new, 1)) == ARCHIVE


def test_a_dimension_of_netcdf_made_shorter(damaged):
    def shorten(content):
        at = content.index(struct.pack(">I", ROWS))
        return content[:at] + struct.pack(">I", ROWS - 2) + content[at + 4 :]

    assert damaged("netcdf3", shorten) == ("refused", _is_damaged("netCDF"))


def test_a_page_of_a_database_that_loses_a_row(damaged):
    def lose(content):
        page = struct.unpack_from(">H", content, 16)[0]
        leaf = next(at for at in range(2 * page, len(content), page) if content[at] == 13)
        cells = struct.unpack_from(">H", content, leaf + 3)[0]
        struct.pack_into(">H", content, leaf + 3, cells - 1)
        return content

    message = "log.dat: is a damaged SQLite file, or one that is cut off — copy it again"
    assert damaged("sqlite", lose) == ("refused", message)


@pytest.mark.parametrize("lines", [3, 9, 1500])
@pytest.mark.parametrize("form", ["csv", "fixed-width"])
def test_text_cut_within_a_row(damaged, form, lines):
    def cut(content):
        ends = [k for k, byte in enumerate(content) if byte == 10]
        return content[: ends[lines - 1] + 17]

    kind, message = damaged(form, cut)
    where = f"log.dat: line {lines + 1}: is cut off: its last line breaks off"
    assert (kind, message) == ("refused", f"{where} — copy it again, or remove the line")


def test_a_file_cut_in_its_first_bytes_is_no_text(damaged):
    message = "log.dat: is cut off — copy it again"
    assert damaged("matlab7.3", lambda content: content[:11]) == ("refused", message)


@pytest.mark.parametrize("kind", [0, 8, 255])
def test_an_element_of_no_known_type_does_not_reach_scipy(tmp_path, kind):
    # scipy would end the process: what is asked is the check before it.
    path = tmp_path / "log.mat"
    FORMATS["matlab5"].write(path, columns())
    content = bytearray(path.read_bytes())
    source = Source(path, path.name, bytes(content), gzip=False)
    check_elements(source, MAX_BYTES)
    at = content.index(struct.pack("<II", 9, 8 * ROWS))  # the values' tag: type 9 is double
    struct.pack_into("<I", content, at, kind)
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        check_elements(source, MAX_BYTES)
    assert str(caught.value) == _is_damaged("MATLAB").replace("log.dat", "log.mat")


@pytest.mark.parametrize("options", [
    {}, {"chunks": (100, 4)}, {"chunks": (100, 4), "maxshape": (None, 4), "compression": "gzip"},
])  # fmt: skip
@pytest.mark.parametrize("rows", [1200, 2800])
def test_a_matrix_of_another_shape_than_is_stored(tmp_path, options, rows):
    path = tmp_path / "log.h5"
    values = np.random.default_rng(12).normal(size=(2000, 4))
    with h5py.File(path, "w") as file:
        file.create_dataset("log", data=values, **options)
    np.testing.assert_array_equal(open_table(path).column(2), values[:, 2])
    content = path.read_bytes()
    assert struct.pack("<Q", 2000) in content
    path.write_bytes(content.replace(struct.pack("<Q", 2000), struct.pack("<Q", rows), 1))
    with pytest.raises(InputError) as caught:
        open_table(path).column(2)
    assert str(caught.value) == _is_damaged("HDF5").replace("log.dat", "log.h5")


def test_rows_never_written_show_where_they_are_filled_with_nan(tmp_path):
    path = tmp_path / "log.h5"
    for fill in (np.nan, 0.0):
        with h5py.File(path, "w") as file:
            data = file.create_dataset("x", shape=(300,), chunks=(100,), fillvalue=fill, dtype="f8")
            data[:100] = 1.0
        if fill == 0.0:
            with pytest.raises(
                InputError, match=r"log\.h5: is a damaged HDF5 file, or one that is"
            ):
                open_table(path).column("x")
        else:
            assert np.isnan(open_table(path).column("x")[100:]).all()
