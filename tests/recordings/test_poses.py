"""The poses of a camera's images: what is read back, and every message."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook.errors import InputError
from sensorbook.recordings.poses import LEAST_DISTANCE, MOST_DISTANCE, read_poses
from sensorbook.recordings.tables import open_table

PLACE, TRUTH = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
GOOD = {"image": "a.png", "time": "2026-03-01T12:00:00Z", "x": "7e6", "y": "0", "z": "-1e6",
        "qx": "0", "qy": "0.6", "qz": "0", "qw": "0.8"}  # fmt: skip


def poses_of(*arguments):
    """What is read, where no column is left out."""
    found, findings = read_poses(*arguments)
    assert findings == []
    return found


def table_of(rows, columns=None):
    """A table of text cells, as readers give them."""
    names = columns or list(dict.fromkeys(column for row in rows for column in row))
    cells = {
        name: np.array([str(row.get(name, "")) for row in rows], dtype=object) for name in names
    }
    return SimpleNamespace(file="poses.csv", names=tuple(names), column=cells.__getitem__)


def problems_of(*rows, names=("a.png",), columns=None):
    with pytest.raises(InputError) as wrong:
        read_poses(table_of(rows, columns), list(names))
    return [str(problem) for problem in wrong.value.problems]


# ---- what is read ----

finite = st.floats(-1, 1, allow_nan=False, allow_subnormal=False)
directions = st.tuples(finite, finite, finite).filter(lambda v: np.linalg.norm(v) > 0.1)
quaternions = st.tuples(finite, finite, finite, finite).filter(lambda q: np.linalg.norm(q) > 0.1)
# Microseconds of UTC, from 1972 to 2199.
moments = st.integers(63_072_000_000_000, 7_258_118_399_999_999)
distances = st.floats(LEAST_DISTANCE * 1.01, MOST_DISTANCE * 0.99)


@st.composite
def poses(draw):
    pose = {}
    if draw(st.booleans()):
        pose["time"] = str(np.datetime64(draw(moments), "us")) + draw(st.sampled_from(["", "Z"]))
    if draw(st.booleans()):
        way = np.array(draw(directions))
        pose |= dict(zip(PLACE, way / np.linalg.norm(way) * draw(distances), strict=True))
    if draw(st.booleans()):
        quaternion = np.array(draw(quaternions))
        pose |= dict(zip(TRUTH, quaternion / np.linalg.norm(quaternion), strict=True))
    return pose


@settings(max_examples=100, deadline=None)
@given(st.lists(poses(), min_size=1, max_size=5), st.booleans())
def test_what_is_known_is_read_back(rows, by_path):
    names = [f"images/{k}.png" for k in range(len(rows))]
    told = names if by_path else [f"{k}.png" for k in range(len(rows))]
    columns = ["image", "time", *PLACE, *TRUTH]
    table = table_of([{"image": t} | row for t, row in zip(told, rows, strict=True)], columns)
    read = poses_of(table, names)
    assert list(read) == names
    for name, row in zip(names, rows, strict=True):
        pose = read[name]
        for what, group in ((pose.position, PLACE), (pose.quaternion, TRUTH)):
            if group[0] not in row:
                assert what is None
            else:
                np.testing.assert_allclose(what, [row[c] for c in group], rtol=1e-12, atol=1e-12)
        known = row.get("time")
        assert pose.time == (None if known is None else np.datetime64(known.rstrip("Z"), "us"))


def test_from_a_file(tmp_path):
    (tmp_path / "poses.csv").write_text(",".join(GOOD) + "\n" + ",".join(GOOD.values()) + "\n")
    pose = poses_of(open_table(tmp_path / "poses.csv", "poses.csv"), ["images/a.png"])[
        "images/a.png"
    ]
    assert pose.time == np.datetime64("2026-03-01T12:00:00")
    np.testing.assert_array_equal(pose.position, [7e6, 0, -1e6])
    np.testing.assert_array_equal(pose.quaternion, [0, 0.6, 0, 0.8])


def test_numbers_need_no_text():
    table = table_of([GOOD])
    cells = {name: table.column(name) for name in table.names}
    cells |= {name: cells[name].astype(float) for name in (*PLACE, *TRUTH)}
    cells["time"] = np.array(["2026-03-01T12:00:00"], dtype="datetime64[ns]")
    table.column = cells.__getitem__
    pose = poses_of(table, ["a.png"])["a.png"]
    assert pose.time == np.datetime64("2026-03-01T12:00:00")
    np.testing.assert_array_equal(pose.position, [7e6, 0, -1e6])


def test_images_without_a_row_are_left_out_and_other_rows_ignored():
    other = GOOD | {"image": "elsewhere.png", "x": "nonsense of another camera"}
    assert list(poses_of(table_of([GOOD | {"x": "7e6"}]), ["a.png", "b.png"])) == ["a.png"]
    # A cell that is no number is one of the table's, whichever image it is of.
    assert problems_of(GOOD, other) == [
        "poses.csv: row 2, x: 'nonsense of another camera' is no number — mend the cell"
    ]


def test_a_printed_quaternion_is_made_unit():
    pose = poses_of(table_of([GOOD | {"qy": "0.6004"}]), ["a.png"])["a.png"]
    assert np.linalg.norm(pose.quaternion) == pytest.approx(1, abs=1e-15)


def test_columns_that_are_not_there_are_not_known():
    pose = poses_of(table_of([{"image": "a.png"}]), ["a.png"])["a.png"]
    assert (pose.time, pose.position, pose.quaternion) == (None, None, None)


# ---- what is wrong ----


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"x": "east"},
            ", x: 'east' is no number — mend the cell",
        ),
        (
            {"y": ""},
            " (a.png): its position is not complete — fill all of its cells, or leave all empty",
        ),
        (
            {"qw": ""},
            " (a.png): its quaternion is not complete — fill all of its cells, or leave all empty",
        ),
        (
            {"qw": "inf"},
            " (a.png): its quaternion is infinite — give finite numbers, or leave all of its cells empty",
        ),
        (
            {"x": "-inf"},
            " (a.png): its position is infinite — give finite numbers, or leave all of its cells empty",
        ),
        (
            {"qw": "0.9"},
            " (a.png): its quaternion has the length 1.082, not 1 — give qx qy qz qw, qw last",
        ),
        (
            {"x": "7000", "z": "1000"},
            " (a.png): x y z are 7071.07 m from the Earth's centre, inside the Earth — give metres, ECI",
        ),
        (
            {"x": "7e12"},
            " (a.png): x y z are 7e+12 m from the Earth's centre, beyond any orbit — give metres, ECI",
        ),
        (
            {"time": "noon"},
            " (a.png): time: 'noon' is no time — "
            'give UTC from 1972 to 2199, as "2026-05-01T12:00:00"',
        ),
        (
            {"time": "2026-03-01T12:00:00+02:00"},
            " (a.png): time: '2026-03-01T12:00:00+02:00' is local time — "
            'give UTC, as "2026-05-01T12:00:00"',
        ),
        (
            {"time": "2026-03-01 12:00:00.5-0330"},
            " (a.png): time: '2026-03-01 12:00:00.5-0330' is local time — "
            'give UTC, as "2026-05-01T12:00:00"',
        ),
        (
            {"time": "1970-01-01T00:00:00"},
            " (a.png): time: '1970-01-01T00:00:00' is before UTC began or too late — "
            'give UTC from 1972 to 2199, as "2026-05-01T12:00:00"',
        ),
    ],
)  # fmt: skip
def test_a_wrong_cell_is_named(change, message):
    assert f"poses.csv: row 1{message}" in problems_of(GOOD | change)


@pytest.mark.parametrize(
    ("gone", "message"),
    [
        (("z",), "poses.csv: z: is missing, and x, y is there — a position is x y z"),
        (("x", "z"), "poses.csv: x, z: is missing, and y is there — a position is x y z"),
        (("qw",), "poses.csv: qw: is missing, and qx, qy, qz is there — a quaternion is qx qy qz qw"),
    ],
)  # fmt: skip
def test_a_column_that_is_missing(gone, message):
    row = {column: cell for column, cell in GOOD.items() if column not in gone}
    assert problems_of(row) == [message]


def test_an_image_that_is_there_twice():
    assert problems_of(GOOD, GOOD) == [
        "poses.csv: row 2 (a.png): is there twice — leave one row for each image"
    ]


def test_every_problem_in_one_go_but_no_flood():
    rows = [GOOD | {"image": f"{k}.png", "qw": "0.9", "time": "noon"} for k in range(50)]
    names = [f"{k}.png" for k in range(50)]
    assert len(problems_of(*rows[:2], names=names)) == 4
    said = problems_of(*rows, names=names)
    assert len(said) == 21
    assert said[-1] == "poses.csv: and 80 more problems — mend those above first"


def test_columns_cells_and_rows_are_told_in_one_go():
    row = {column: cell for column, cell in GOOD.items() if column != "qw"} | {"x": "east"}
    assert problems_of(row, row | {"time": "noon"}) == [
        "poses.csv: row 1, x: 'east' is no number — mend the cell",
        "poses.csv: row 2, x: 'east' is no number — mend the cell",
        "poses.csv: qw: is missing, and qx, qy, qz is there — a quaternion is qx qy qz qw",
        "poses.csv: row 2 (a.png): is there twice — leave one row for each image",
        "poses.csv: row 2 (a.png): time: 'noon' is no time — "
        'give UTC from 1972 to 2199, as "2026-05-01T12:00:00"',
    ]


def test_a_place_inside_the_earth_that_the_camera_sees():
    row = GOOD | {"x": "6375000", "z": "0"}
    assert list(poses_of(table_of([row]), ["a.png"])) == ["a.png"]
    with pytest.raises(
        InputError, match="x y z are 6\\.375e\\+06 m from the Earth's centre, inside"
    ):
        read_poses(table_of([row]), ["a.png"], np.array([6378137.0, 6378137.0, 6356752.0]))
    moon = row | {"x": "1800000"}
    assert list(poses_of(table_of([moon]), ["a.png"], np.full(3, 1737400.0))) == ["a.png"]


# ---- names of columns ----


@pytest.mark.parametrize(
    "names",
    [
        {"time": "time (UTC)", "x": "x [m]", "y": "y (m)", "z": "z[ metre ]"},
        {"image": "Image", "time": "TIME[utc]", "x": " X", "qx": "Q X", "qw": "qw [-]"},
    ],
)  # fmt: skip
def test_case_blanks_and_the_right_unit_make_no_difference(names):
    plain = poses_of(table_of([GOOD]), ["a.png"])["a.png"]
    row = {names.get(column, column): cell for column, cell in GOOD.items()}
    pose = poses_of(table_of([row]), ["a.png"])["a.png"]
    assert pose.time == plain.time
    np.testing.assert_array_equal(pose.position, plain.position)
    np.testing.assert_array_equal(pose.quaternion, plain.quaternion)


@pytest.mark.parametrize(
    ("column", "name", "message"),
    [
        ("x", "x [km]", "'x [km]': is declared in 'km' — give metres, ECI, and name it x [m]"),
        ("time", "time (TAI)", "'time (TAI)': is declared in 'TAI' — give UTC, and name it time (UTC)"),
        ("qx", "qx [deg]", "'qx [deg]': is declared in 'deg' — it has no unit: name it qx"),
    ],
)  # fmt: skip
def test_another_unit_is_told(column, name, message):
    row = {name if c == column else c: cell for c, cell in GOOD.items()}
    assert problems_of(row) == [f"poses.csv: column {message}"]


def test_two_columns_of_one_name():
    assert problems_of(GOOD | {"X [m]": "1"}) == [
        "poses.csv: column 'X [m]': x is 'x' already — rename one of the two"
    ]


def test_without_image_there_is_nothing_to_read():
    row = {column: cell for column, cell in GOOD.items() if column != "image"}
    assert problems_of(row | {"file": "a.png"}) == [
        "poses.csv: image: there is no such column — columns are image, time, x, y, z, qx, qy, qz, qw"
    ]


def test_columns_that_are_not_read_are_told():
    row = {"image": "a.png", "posx": "1", "q1": "0"}
    poses, (finding,) = read_poses(table_of([row]), ["a.png"])
    assert str(finding) == (
        "poses.csv: columns: 'posx', 'q1' are not read"
        " — those read are image, time, x, y, z, qx, qy, qz, qw"
    )
    assert poses["a.png"].position is None
    row = {"image": "a.png"} | {f"c{k}": "" for k in range(9)}
    _, (finding,) = read_poses(table_of([row]), ["a.png"])
    assert "'c4', 'c5' and 3 more are not read" in str(finding)
