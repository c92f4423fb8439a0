"""Readers: what loggers write, and what only looks like it."""

import contextlib
import gzip
import io
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook import InputError
from sensorbook.recordings import open_table
from sensorbook.recordings.assemble import numbers, stamps

NAMES = ("t", "gx", "gy", "gz")
ROWS = np.array([[k / 8, k * 0.25, -k * 1.5, 1e-3 * k] for k in range(30)])


def read(tmp_path, content, references=NAMES, name="log.csv", **options):
    """(N, k) the columns of a file of this content."""
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    table = open_table(path, **options)
    return np.stack([numbers(table, reference) for reference in references], axis=1)


def text(rows=ROWS, delimiter=",", header="t,gx,gy,gz", decimal=".", end="\n"):
    body = [delimiter.join(f"{v!r}".replace(".", decimal) for v in row) for row in rows.tolist()]
    head = [header.replace(",", delimiter)] if header else []
    return end.join([*head, *body]) + end


JUNK = ["", "Logger v1.2\n", "# made by a logger\n\n", "Device: IMU 7\nDate: 2024-05-01\n\n",
        "% comment\n", "serial,1234\nfirmware,1.0.3\n"]  # fmt: skip


@given(
    delimiter=st.sampled_from([",", ";", "\t", "|", " ", "   ", " , "]),
    junk=st.sampled_from(JUNK),
    header=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
    decimal=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    compress=st.booleans(),
    rows=st.integers(min_value=5, max_value=40),
    seed=st.integers(min_value=0, max_value=99),
)
@settings(deadline=None)
def test_any_layout_gives_the_same_numbers(
    tmp_path_factory, delimiter, junk, header, end, decimal, encoding, compress, rows, seed
):
    decimal = "." if delimiter.strip() == "," else decimal
    values = np.random.default_rng(seed).normal(size=(rows, 4)).round(4)
    content = junk + text(values, delimiter, ",".join(NAMES) if header else "", decimal, end)
    raw = content.encode(encoding)
    raw = gzip.compress(raw) if compress else raw
    references = NAMES if header else range(4)
    got = read(tmp_path_factory.mktemp("t"), raw, references, wanted=NAMES)
    # pandas' parser is exact to 1 ulp.
    np.testing.assert_allclose(got, values, rtol=3e-16)


@pytest.mark.parametrize(
    "content",
    [
        text(header='"t","gx","gy","gz"'),
        text(header="# t,gx,gy,gz"),
        text(header="t,gx,gy,gz\n# a comment"),
        text(header="t,gx,gy,gz\ns,deg/s,deg/s,deg/s"),
        text(header="t,gx,gy,gz\n[s],[deg/s],[deg/s],[deg/s]"),
        text(header=" t , gx , gy , gz "),
        text().replace("\n0.125", "\n\n# lost the link\n0.125", 1),
        text().replace("\n", ",\n"),
        text().replace("\n", ",\n").replace("gz,", "gz", 1),
        text(header="t,gx,gy,gz,note").replace("\n", ",ok\n").replace("note,ok", "note"),
    ],
)
def test_headers_comments_and_trailing_delimiters(tmp_path, content):
    got = read(tmp_path, content)
    np.testing.assert_allclose(got[: len(ROWS)], ROWS, rtol=3e-16)
    assert len(got) == len(ROWS)


def test_western_single_byte_header(tmp_path):
    content = text(header="t,gx °/s,gy,gz").encode("cp1252")
    np.testing.assert_allclose(read(tmp_path, content, ["t", "gx °/s"]), ROWS[:, :2], rtol=3e-16)


def test_only_the_columns_named_are_parsed(tmp_path):
    content = text().replace("0.25", "abc", 1)
    np.testing.assert_allclose(read(tmp_path, content, ["t", "gy"]), ROWS[:, [0, 2]], rtol=3e-16)


def test_integers_stay_integers(tmp_path):
    path = tmp_path / "counts.csv"
    path.write_text("gx,gy\n" + "3,-4\n" * 5)
    assert open_table(path).column("gx").dtype == np.int64


def test_missing_cells_are_nan(tmp_path):
    got = read(tmp_path, "t,gx\n0,1\n1,\n2,nan\n3,NA\n4,5\n", ["t", "gx"])
    np.testing.assert_array_equal(np.isnan(got[:, 1]), [False, True, True, True, False])


BAD = [
    (b"", "log.csv: is empty"),
    (b"\n\n  \n", "log.csv: is empty"),
    (b"t,gx,gy,gz\n", "log.csv: holds no rows of numbers — write one sample a line"),
    (b"\x00\x01\x02\x03" * 100, "log.csv: is a binary file, not text — save the columns as"),
    (bytes(range(128, 256)) * 10, "log.csv: is a binary file, not text"),
    (text().encode().replace(b"\n0.25,", b"\n0.25,oops", 1),
     "log.csv: column 'gx', row 3: 'oops0.5' is not a number — mend the row or leave the cell empty"),
    (text().encode() + b"1,2,3,4,5,6\n", "log.csv: line 32: holds 6 cells, the table has 4 columns"),
    (text().encode() + b"t,gx,gy,gz\n", "log.csv: column 't', row 31: 't' is not a number"),
    (b"\x1f\x8b" + b"not gzip", "log.csv: is a damaged gzip file"),
    (gzip.compress(text().encode())[:-20], "log.csv: is a gzip file that is cut off — copy it again"),
    (b"FEA1\0\0\0", "log.csv: is a Feather v1 file: format not supported yet — save its columns as .csv"),
    (b"\xff\xd8\xff\xe0....", "log.csv: is a JPEG image, not a table — name a file that holds"),
    (text()[:-9].encode(), "log.csv: line 31: is cut off: its last line breaks off — copy it again"),
    (text(ROWS[:20]).encode() + b"3.0,1.5,-9.0,1.2e", "log.csv: line 22: is cut off"),
    (text().encode().replace(b"\n0.25,", b"\n0.25,\0\0\0", 1), "log.csv: line 4: holds NUL bytes, as"),
    (b"PK\x03\x04 rubbish", "log.csv: is a damaged ZIP archive, or one that is cut off — copy it again"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), BAD)
def test_what_is_no_table_is_one_clear_problem(tmp_path, content, expected):
    with pytest.raises(InputError) as caught:
        read(tmp_path, content)
    assert str(caught.value).startswith(expected)
    assert len(caught.value.problems) == 1


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_any_bytes_are_a_table_or_an_input_error(tmp_path_factory, content):
    for prefix in (b"", b"PK\x03\x04", b"\x1f\x8b\x08\x00", b"a,b\n1,2\n3,4\n"):
        with contextlib.suppress(InputError):
            read(tmp_path_factory.mktemp("t"), prefix + content, [0])


def test_ambiguous_names_ask_for_an_index(tmp_path):
    with pytest.raises(
        InputError, match="column 'a': is ambiguous — several columns have this name"
    ):
        read(tmp_path, "a,a\n1,2\n3,4\n", ["a"])


# ---- stamps ----


def stamped(tmp_path, cells, unit="s"):
    path = tmp_path / "log.csv"
    path.write_text("t,x\n" + "".join(f"{cell},1\n" for cell in cells))
    return stamps(open_table(path), "t", unit)


def test_nanoseconds_since_1970_keep_their_digits(tmp_path):
    first = 1_700_000_000_123_456_789
    seconds, start = stamped(tmp_path, [first + k * 1_000_000 for k in range(5)], "ns")
    np.testing.assert_allclose(seconds, np.arange(5) * 1e-3, rtol=1e-15)
    assert start == pytest.approx(first * 1e-9)


def test_iso_stamps(tmp_path):
    cells = [f"2024-05-01T12:00:0{k}.25" for k in range(5)]
    seconds, start = stamped(tmp_path, cells)
    np.testing.assert_allclose(seconds, np.arange(5), rtol=1e-15)
    assert start == 1714564800.25
    assert stamped(tmp_path, [cell.replace("T", " ") + "Z" for cell in cells])[1] == start


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e-3), ("us", 1e-6), ("min", 60), ("h", 3600)])
def test_time_units(tmp_path, unit, size):
    seconds, _ = stamped(tmp_path, [10, 11, 13], unit)
    np.testing.assert_allclose(seconds, np.array([0, 1, 3]) * size, rtol=1e-15)


def test_a_stamp_that_is_no_time(tmp_path):
    with pytest.raises(InputError, match="column 't', row 2: 'soon' is not a time"):
        stamped(tmp_path, ["2024-05-01", "soon", "2024-05-03"])
    with pytest.raises(InputError, match="column 't', row 2: 'soon' is not a number"):
        stamped(tmp_path, ["1.0", "soon", "3.0"])


# ---- NumPy archives ----


def archive(**arrays) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def test_npz_columns_by_name_and_index(tmp_path):
    content = archive(t=np.arange(5), g=np.arange(15, dtype=np.int16).reshape(5, 3))
    got = read(tmp_path, content, ["t", "g:0", "g:2", 1])
    np.testing.assert_array_equal(got[:, 1:], np.arange(15).reshape(5, 3)[:, [0, 2, 0]])
    got = read(tmp_path, content, [2, 0], table="g")
    np.testing.assert_array_equal(got, np.arange(15).reshape(5, 3)[:, [2, 0]])
    with pytest.raises(InputError, match="table 'h': there is no such array — arrays: g, t"):
        read(tmp_path, content, [0], table="h")
    with pytest.raises(
        InputError, match=r"column 'gx': there is no such column — .*columns: 't', 'g:0'"
    ):
        read(tmp_path, content, ["gx"])


def test_npz_pickles_are_never_loaded(tmp_path):
    content = archive(t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="array 't': holds object values — save plain numbers"):
        read(tmp_path, content, ["t"])


def test_npz_that_declares_more_than_it_holds_is_not_allocated(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    header += b" " * (118 - len(header) - 1) + b"\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(80)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as out:
        out.writestr("t.npy", member)
    with pytest.raises(InputError, match="array 't': holds more than 4 GiB"):
        read(tmp_path, stream.getvalue(), ["t"])


def test_a_gzip_bomb_stops_at_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("sensorbook.recordings.tables.MAX_BYTES", 1 << 20)
    with pytest.raises(InputError, match=r"log\.csv: holds more than"):
        read(tmp_path, gzip.compress(bytes(2 << 20)), [0])


def test_what_inflates_beyond_reason_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sensorbook.recordings.tables._BOMB", 1 << 20)
    bomb = gzip.compress(b"t,gx\n" + b"0.000000,0.000000\n" * 200_000)
    with pytest.raises(
        InputError, match=r"log\.csv\.gz: inflates more than 150 times, as no recording does"
    ):
        read(tmp_path, bomb, ["t"], name="log.csv.gz")
    good = gzip.compress(text(np.random.default_rng(5).normal(size=(20_000, 4))).encode())
    assert len(read(tmp_path, good, name="log.csv.gz")) == 20_000
