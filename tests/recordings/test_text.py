"""Text as loggers leave it: fixed widths, units, preambles, cut ends, and what changes half way."""

import gzip

import numpy as np
import pytest

from sensorbook import InputError
from sensorbook.recordings import open_table, text
from sensorbook.recordings.assemble import numbers

ROWS = np.array([[k / 8, -1.25 * k, 1000.5 - 123 * k] for k in range(40)])
HEADER = "t,gx,gy\n"


def opened(tmp_path, content, name="log.csv"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return open_table(path)


def values(table, references=None):
    """(N, k) the columns of a table, all by default."""
    references = range(len(table.names)) if references is None else references
    return np.stack([numbers(table, reference) for reference in references], axis=1)


def refused(tmp_path, content) -> str:
    """What is said of a file when all its columns are read: one problem."""
    with pytest.raises(InputError) as caught:
        values(opened(tmp_path, content))
    assert len(caught.value.problems) == 1
    return str(caught.value)


def lines(rows=ROWS, delimiter=","):
    return [delimiter.join(map(repr, row)) for row in rows.tolist()]


def csv(rows=ROWS, delimiter=",", header=HEADER):
    return header.replace(",", delimiter) + "".join(f"{line}\n" for line in lines(rows, delimiter))


@pytest.fixture
def small_pieces(monkeypatch):
    """The parser takes a hundred rows at a time."""
    monkeypatch.setattr(text, "_ROWS", 100)


# ---- fixed widths ----

GAPS, TOUCH = (8, 9, 9), (5, 8, 9)  # the widest of each column: 4.875, -48.75, -3796.5


def fixed(widths, rows=ROWS):
    a, b, c = widths
    return [f"{x:{a}.3f}{y:+{b}.3f}{z:+{c}.2f}" for x, y, z in rows]


@pytest.mark.parametrize("widths", [GAPS, TOUCH])
@pytest.mark.parametrize("align", ["<", ">"])
@pytest.mark.parametrize("preamble", ["", "Logger 5\nSampling rate: 100 Hz\n"])
def test_fixed_widths(tmp_path, widths, align, preamble):
    header = "".join(
        f"{name:{align}{w}}" for name, w in zip(("t", "gx", "gy"), widths, strict=True)
    )
    table = opened(tmp_path, preamble + "\n".join([header, *fixed(widths)]) + "\n")
    assert table.names == ("t", "gx", "gy")
    np.testing.assert_array_equal(values(table), ROWS)  # three decimals and two hold them exactly


def touching(rows=400):
    """Columns that touch where a number fills its own."""
    more = np.array([[k / 8, (-1) ** k * 100.25, 1000.5 + k] for k in range(rows)])
    return more, [f"{x:7.3f}{y:8.3f}{z:7.1f}" for x, y, z in more]


def test_columns_that_touch_on_some_lines_only(tmp_path):
    rows, text_lines = touching()
    assert len({len(line.split()) for line in text_lines}) > 1  # blanks do not part them
    np.testing.assert_array_equal(values(opened(tmp_path, "\n".join(text_lines) + "\n")), rows)


def test_a_blank_between_fixed_columns_is_missing(tmp_path):
    rows, text_lines = touching()
    text_lines[200] = text_lines[200][:7] + " " * 8 + text_lines[200][15:]
    got = values(opened(tmp_path, "\n".join(text_lines) + "\n"))
    assert np.isnan(got[200, 1])
    rows[200, 1] = got[200, 1] = 0
    np.testing.assert_array_equal(got, rows)


def test_text_in_a_fixed_column_names_its_row(tmp_path):
    _, text_lines = touching()
    text_lines[200] = text_lines[200][:7] + "    oops" + text_lines[200][15:]
    assert refused(tmp_path, "\n".join(text_lines) + "\n") == (
        "log.csv: column 1, row 201: 'oops' is not a number — mend the row or leave the cell empty"
    )


def test_a_last_fixed_line_that_breaks_off(tmp_path):
    _, text_lines = touching()
    whole = "\n".join(text_lines)
    assert len(values(opened(tmp_path, whole))) == len(text_lines)
    assert refused(tmp_path, whole[:-3]).startswith("log.csv: line 400: is cut off: its last line")


# ---- what stands before the data ----


@pytest.mark.parametrize("units", ["s,deg/s,deg/s", "[s],[°/s],[°/s]", "(s),(deg/s),(deg/s)",
                                   "# s,deg/s,deg/s"])  # fmt: skip
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_the_line_of_units(tmp_path, units, delimiter):
    table = opened(tmp_path, csv(delimiter=delimiter, header=HEADER + units + "\n"))
    assert table.names == ("t", "gx", "gy")
    assert table.units == tuple(units.removeprefix("# ").split(","))
    np.testing.assert_array_equal(values(table), ROWS)


def test_a_file_without_units_declares_none(tmp_path):
    assert opened(tmp_path, csv()).units == ()
    assert opened(tmp_path, csv(header=HEADER + "left,right,both\n")).units == ()


@pytest.mark.parametrize("sign", ["", "# ", "% "])
def test_notes_are_the_lines_before_the_table(tmp_path, sign):
    preamble = [f"{sign}Logger 5", f"{sign}Sampling rate: 100 Hz", "", f"{sign}range: 250, full"]
    table = opened(tmp_path, "\n".join(preamble) + "\n" + csv())
    assert table.notes[:3] == tuple(line for line in preamble if line)
    assert table.names == ("t", "gx", "gy")
    np.testing.assert_array_equal(values(table), ROWS)


# ---- ends ----


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_complete_last_row_needs_no_end_of_line(tmp_path, end):
    whole = csv().replace("\n", end)
    np.testing.assert_array_equal(values(opened(tmp_path, whole.removesuffix(end))), ROWS)
    np.testing.assert_array_equal(values(opened(tmp_path, whole + end + end)), ROWS)


@pytest.mark.parametrize("last", ["5.0", "5.0,", "5.0,-50.0", "5.0,-50.0,", "5.0,-50.0,-", "5.0,-50.0,1.",
                                  "5.0,-50.0,1.5e", "5.0,-50.0,1.5e-"])  # fmt: skip
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_last_row_that_breaks_off_is_said(tmp_path, last, end):
    assert refused(tmp_path, (csv() + last).replace("\n", end)) == (
        "log.csv: line 42: is cut off: its last line breaks off — copy it again, or remove the line"
    )


def test_a_compressed_file_that_breaks_off_is_said(tmp_path):
    content = gzip.compress((csv() + "5.0,-5").encode())
    assert refused(tmp_path, content).startswith("log.csv: line 42: is cut off")


@pytest.mark.parametrize("rows", [40, 9000])  # within the first 64 KiB, and beyond
@pytest.mark.parametrize("count", [1, 4096])
@pytest.mark.parametrize("where", ["middle", "end"])
def test_runs_of_nul_are_said(tmp_path, rows, count, where):
    body = csv(np.array([[k / 8, -1.25 * k, k] for k in range(rows)]))
    cut = len(body) if where == "end" else body.index("\n", int(0.9 * len(body))) + 1
    line = body[:cut].count("\n") + 1
    content = body[:cut].encode() + bytes(count) + body[cut:].encode()
    assert refused(tmp_path, content) == (
        f"log.csv: line {line}: holds NUL bytes, as a logger leaves them that loses power — remove them"
    )


# ---- what stands among the data ----


def test_a_header_again_in_the_middle_names_its_row(tmp_path):
    expected = (
        "log.csv: column 't', row 41: 't' is not a number — mend the row or leave the cell empty"
    )
    table = opened(tmp_path, csv() + csv())
    with pytest.raises(InputError) as caught:
        values(table, ["t"])
    assert str(caught.value) == expected


def test_columns_of_text_stay_beside_the_numbers(tmp_path):
    rows = "".join(f"{k},run {k % 3},{k / 4}\n" for k in range(30))
    table = opened(tmp_path, "t,mode,gx\n" + rows)
    assert table.column("mode").tolist() == [f"run {k % 3}" for k in range(30)]
    np.testing.assert_array_equal(table.column("gx"), np.arange(30) / 4)


@pytest.mark.parametrize("note", ["55%", "#3", "a # b"])
@pytest.mark.parametrize("comment", ["", "# lost the link\n", "  % back\n"])
def test_a_comment_sign_within_a_row_does_not_end_it(tmp_path, note, comment):
    rows = [f"{k},{note if k % 7 == 5 else 'ok'},{k / 4}\n" for k in range(30)]
    table = opened(tmp_path, "t,note,gx\n" + "".join([*rows[:20], comment, *rows[20:]]))
    assert table.column("note").tolist() == [note if k % 7 == 5 else "ok" for k in range(30)]
    np.testing.assert_array_equal(table.column("gx"), np.arange(30) / 4)


def test_a_comment_at_the_end_of_a_row_is_text(tmp_path):
    rows = lines()
    rows[8] += " # bump"
    assert refused(tmp_path, HEADER + "\n".join(rows) + "\n") == (
        "log.csv: column 2, row 9: '16.5 # bump' is not a number — mend the row or leave the cell empty"
    )


def test_comments_far_into_a_file(tmp_path):
    """Beyond the chunks of 1 MiB in which a file is looked through."""
    rows = [f"{k},{k / 4}\n" for k in range(120_000)]
    got = values(
        opened(tmp_path, "t,gx\n" + "".join([*rows[:-5], "# lost, the link\n", *rows[-5:]]))
    )
    np.testing.assert_array_equal(got[:, 1], np.arange(120_000) / 4)


# ---- what changes half way, beyond the parser's first piece ----


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_integers_then_floats(tmp_path, small_pieces, end):
    rows = "".join(f"{k},{k if k < 250 else k + 0.5}{end}" for k in range(430))
    table = opened(tmp_path, f"n,x{end}{rows}")
    assert table.column("n").dtype == np.int64
    np.testing.assert_array_equal(table.column("n"), np.arange(430))
    expected = np.arange(430) + 0.5 * (np.arange(430) >= 250)
    np.testing.assert_array_equal(table.column("x"), expected)


def test_floats_then_integers_then_nothing(tmp_path, small_pieces):
    cells = [f"{k / 4}" if k < 150 else f"{k}" if k < 300 else "" for k in range(430)]
    table = opened(tmp_path, "n,x\n" + "".join(f"{k},{c}\n" for k, c in enumerate(cells)))
    expected = [float(c) if c else np.nan for c in cells]
    np.testing.assert_array_equal(table.column("x"), expected)


@pytest.mark.parametrize("row", [0, 99, 100, 357, 429])
def test_a_word_among_numbers_names_its_row(tmp_path, small_pieces, row):
    rows = "".join(f"{k},{'oops' if k == row else k / 4}\n" for k in range(430))
    table = opened(tmp_path, "n,x\n" + rows)
    with pytest.raises(InputError) as caught:
        numbers(table, "x")
    assert str(caught.value) == (
        f"log.csv: column 'x', row {row + 1}: 'oops' is not a number — mend the row or leave the "
        "cell empty"
    )
    np.testing.assert_array_equal(numbers(table, "n"), np.arange(430))


def test_numbers_then_words(tmp_path, small_pieces):
    rows = "".join(f"{k},{k if k < 250 else 'off'}\n" for k in range(430))
    table = opened(tmp_path, "n,x\n" + rows)
    assert table.column("x")[[199, 250]].tolist() == [199, "off"]
    with pytest.raises(
        InputError, match=r"column 'x', row 251: 'off' is not a number \(and 179 more\)"
    ):
        numbers(table, "x")


def test_a_line_with_too_many_cells_is_named(tmp_path, small_pieces):
    rows = "".join(f"{k},{k}{',7' if k == 333 else ''}\n" for k in range(430))
    assert refused(tmp_path, "n,x\n" + rows) == (
        "log.csv: line 335: holds 3 cells, the table has 2 columns — mend or remove the line"
    )
