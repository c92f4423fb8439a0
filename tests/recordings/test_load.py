"""`load` and `check`: what passes, and every problem with its file, key, value and mend."""

import tomllib
from datetime import date

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import sensorbook
from sensorbook import InputError
from sensorbook.earth import field_at
from sensorbook.recordings import check, from_declaration
from sensorbook.units import factor

from .conftest import STATIC

LABEL = "device.toml: recording 1 (gyroscope, static)"


def lines(path) -> list[str]:
    """Every problem of a folder, as lines."""
    return [str(problem) for problem in check(path)[0]]


def test_two_lines_give_a_recording_in_si(folder, samples):
    device = sensorbook.load(folder())
    recording = device.gyroscope.static
    np.testing.assert_array_equal(recording.values, samples * factor("deg/s", "rad/s"))
    np.testing.assert_allclose(recording.time, np.arange(500) / 100, rtol=1e-15)
    assert (recording.rate, recording.duration, len(recording)) == (100.0, 5.0, 500)
    assert (device.id, device.name, device.sensors) == ("imu-1", "imu-1", ("gyroscope",))
    assert check(device.path) == ([], [])


def test_the_device_toml_itself_may_be_named(folder):
    assert sensorbook.load(folder() / "device.toml").id == "imu-1"


def test_free_text_is_kept_and_escaped_where_shown(folder):
    name = "<script>alert(\"x\")</script> 'quoted'\nsecond line"
    device = sensorbook.load(
        folder(head=f"schema = 1\nid = 'a'\nserial = 12\nname = '''{name}'''\n")
    )
    assert (device.name, device.serial) == (name, "12")
    assert "<script>" not in device._repr_html_()
    assert "&lt;script&gt;" in device._repr_html_()


def test_attributes_say_what_there_is(folder):
    device = sensorbook.load(folder())
    with pytest.raises(AttributeError, match="no recording of 'camera'; sensors: gyroscope"):
        _ = device.camera
    with pytest.raises(
        AttributeError, match="no 'thermal' recording of the gyroscope; kinds: static"
    ):
        _ = device.gyroscope.thermal
    assert "gyroscope" in dir(device)
    assert "static" in dir(device.gyroscope)
    assert device.runs("gyroscope", "thermal") == ()


def test_runs_come_longest_first(folder, samples):
    path = folder(STATIC.replace("static.csv", "short.csv") + STATIC)
    (path / "short.csv").write_text(
        "gx gy gz\n" + "\n".join(" ".join(map(str, row)) for row in samples[:200])
    )
    device = sensorbook.load(path)
    assert [len(run) for run in device.gyroscope.runs("static")] == [500, 200]
    assert device.gyroscope.static is device.runs("gyroscope", "static")[0]


def test_truth_stands_beside_the_declaration(folder):
    path = folder()
    assert sensorbook.load(path).truth is None
    (path / "truth.json").write_text('{"a": 1}')
    assert sensorbook.load(path).truth == {"a": 1}
    (path / "truth.json").write_text("{")
    with pytest.raises(InputError, match=r"truth\.json: is not valid JSON"):
        sensorbook.load(path)


@pytest.mark.parametrize(
    "written",
    [
        "2024-05-01",
        '"2024-05-01"',
        '"2024-05-01T12:00:00Z"',
        "2024-05-01T12:00:00",
        "2024-05-01T12:00:00Z",
    ],
)
def test_the_sites_date_is_a_date_however_it_is_written(folder, written):
    head = f'schema = 1\nid = "a"\n[site]\nlatitude = 48.0\nlongitude = 11.0\ndate = {written}\n'
    path = folder(head=head)
    assert check(path) == ([], [])
    site = sensorbook.load(path).site
    assert type(site["date"]) is date
    assert site == {"latitude": 48.0, "longitude": 11.0, "date": date(2024, 5, 1)}
    assert "on 2024-05-01" in field_at(site).source


# ---- the device as a whole: load raises ----

HEADS = [
    ("schema = 1\n", 'device.toml: id: is missing — write id = "…", such as "imu-7"'),
    ('id = "a"\n', "device.toml: schema: is missing — write schema = 1"),
    ('schema = 2\nid = "a"\n', "device.toml: schema: 2 is not a version this sensorbook reads"
     " — write schema = 1"),
    ('schema = true\nid = "a"\n', "device.toml: schema: True is not a version"),
    ('schema = 1\nid = "a/b"\n', "device.toml: id: 'a/b' cannot name the report folder — use 1 to 64"),
    ('schema = 1\nid = ".."\n', "device.toml: id: '..' cannot name"),
    ('schema = 1\nid = "a\\n"\n', "device.toml: id: 'a\\n' cannot name"),
    (f'schema = 1\nid = "{"a" * 65}"\n', "cannot name the report folder"),
    ('schema = 1\nid = "book"\n', "device.toml: id: 'book' is reserved for the report tree"),
    ('schema = 1\nid = "index.html"\n', "device.toml: id: 'index.html' is reserved"),
    ('schema = 1\nid = "a"\nnmae = "x"\n', "device.toml: nmae: is not a key of this table"
     " — did you mean 'name'?"),
    ('schema = 1\nid = "a"\nname = 3\n', 'device.toml: name: 3 is not text — write "…"'),
    ('schema = 1\nid = "a"\n[site]\nlatitude = 91\n', "device.toml: site: latitude: 91 is out of range"
     " — write a number between -90 and 90, such as 39.89"),
    ('schema = 1\nid = "a"\n[site]\nheight = nan\n', "device.toml: site: height: nan is not a finite"),
    ('schema = 1\nid = "a"\n[site]\ndate = "soon"\n', "device.toml: site: date: 'soon' is not a date"),
    ('schema = 1\nid = "a"\n[site]\nlattitude = 1\n', "did you mean 'latitude'?"),
    ('schema = 1\nid = "a"\n[spec.gyro]\nx = 1\n', "device.toml: spec.gyro: is not a sensor with limits"),
    ('schema = 1\nid = "a"\n[spec.gyroscope]\nrandom_walk = 1\n',
     "device.toml: spec.gyroscope.random_walk: 1 is not a table"),
    ('schema = 1\nid = "a"\n[spec.gyroscope]\nrandom_walk = { max = 1, unit = "g" }\n',
     "device.toml: spec.gyroscope.random_walk.unit: 'g' is an acceleration, not an angular random walk"),
    ('schema = 1\nid = "a"\n[spec.gyroscope]\nrandom_walks = { max = 1, unit = "g" }\n',
     "did you mean 'random_walk'?"),
    ('schema = 1\nid = "a"\n[spec.gyroscope]\nrandom_walk = { max = "1", unit = "deg/sqrt(h)" }\n',
     "device.toml: spec.gyroscope.random_walk.max: '1' is not a finite number"),
    ('schema = 1\nid = "a"\n[spec.magnetometer]\nresidual_percent = { max = -1 }\n',
     "device.toml: spec.magnetometer.residual_percent.max: -1 is out of range"
     " — write a number of 0 or more, such as 1.0"),
    ('schema = 1\nid = "a"\n[spec.magnetometer]\ncoverage_percent = { min = 101 }\n',
     "device.toml: spec.magnetometer.coverage_percent.min: 101 is out of range"
     " — write a number between 0 and 100, such as 1.0"),
    ('schema = 1\nid = "a"\n[spec.magnetometer]\nfield = { min = 60, max = 40, unit = "uT" }\n',
     "device.toml: spec.magnetometer.field.min: 60 is above max, which is 40 — mend one of them"),
    ('schema = 1\nid = "a\n', "device.toml: is not valid TOML: "),
    ("schema = 1\nid = " + "[" * 5000 + "\n", "device.toml: is not valid TOML: "),
]  # fmt: skip


@pytest.mark.parametrize(("head", "expected"), HEADS)
def test_a_problem_of_the_device_stops_load(folder, head, expected):
    with pytest.raises(InputError) as caught:
        sensorbook.load(folder(head=head))
    assert str(caught.value).startswith(expected) or expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_problem_comes_in_one_go(folder):
    path = folder(
        STATIC.replace("deg/s", "furlong").replace("rate = 100.0", "rate = -1"),
        head='schema = 3\nid = "/"\ncolour = "red"\n',
    )
    with pytest.raises(InputError) as caught:
        sensorbook.load(path)
    assert [p.where for p in caught.value.problems] == [
        "schema",
        "id",
        "colour",
        "recording 1 (gyroscope, static): rate",
        "recording 1 (gyroscope, static): unit",
    ]


def test_no_recordings(folder):
    with pytest.raises(InputError, match="recording: there is none — add a"):
        sensorbook.load(folder(""))
    with pytest.raises(InputError, match="recording: is not a list of tables — begin each"):
        sensorbook.load(folder("recording = 3\n"))


def test_no_device_folder(tmp_path):
    with pytest.raises(
        InputError, match=r"nowhere: there is no such file or folder — name a folder that holds"
    ):
        sensorbook.load(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"device\.toml: is missing in .* — write one with"):
        sensorbook.load(tmp_path)
    (tmp_path / "device.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"device\.toml: is not UTF-8 text"):
        sensorbook.load(tmp_path)


# ---- one recording: load passes, the others remain usable ----

DECLARATIONS = [
    ('unit = "deg/s"', 'unit = "furlong"', f"{LABEL}: unit: 'furlong' is not a unit sensorbook knows "
     "— write an angular rate such as deg/s, rad/s or deg/h"),
    ('unit = "deg/s"', 'unit = "G"', f"{LABEL}: unit: 'G' is a magnetic flux density, not an angular"),
    ('unit = "deg/s"', "", f"{LABEL}: unit: is missing — write an angular rate such as"),
    ('unit = "deg/s"', 'unit = "counts"', f"{LABEL}: scale: is missing, and counts have no unit"),
    ('unit = "deg/s"', 'unit = "deg/s"\nscale = { factor = 1, unit = "deg/s" }',
     f"{LABEL}: scale: goes with counts only"),
    ('unit = "deg/s"', 'unit = "counts"\nscale = { factor = 0, unit = "g" }',
     f"{LABEL}: scale.unit: 'g' is an acceleration, not an angular rate"),
    ('unit = "deg/s"', 'unit = "counts"\nscale = { factor = 0, unit = "deg/s" }',
     f"{LABEL}: scale.factor: is zero"),
    ("rate = 100.0", "", f"{LABEL}: rate: there is neither a rate nor a time column"),
    ("rate = 100.0", "rate = 0", f"{LABEL}: rate: 0 is out of range — write a number above 0 and at most"),
    ("rate = 100.0", "rate = inf", f"{LABEL}: rate: inf is not a finite number"),
    ("rate = 100.0", "rate = 100.0\nhertz = 1", f"{LABEL}: hertz: is not a key of this table"),
    ("rate = 100.0", 'rate = 100.0\ntime_unit = "deg"', f"{LABEL}: time_unit: 'deg' is an angle, not"),
    ('x = "gx"', "x = -1", f"{LABEL}: columns.x: -1 is neither a name nor a 0-based index"),
    ('x = "gx", ', "", f"{LABEL}: columns.x: is missing — give the column's name or 0-based index"),
    ('x = "gx"', 'x = "gy"', f"{LABEL}: columns: 'gy' stands for two axes"),
    ('x = "gx"', 'x = "gx", tmp = 3', f"{LABEL}: columns.tmp: is not a column that is used"),
    ('x = "gx"', 'x = "gxx"', "static.csv: column 'gxx': there is no such column — did you mean 'gx'? "
     "columns: 'gx', 'gy', 'gz'"),
    ('x = "gx"', "x = 7", "static.csv: column 7: there is no such column — the file has 3 columns, 0 to 2"),
    ('"static"', '"statics"', "device.toml: recording 1 (gyroscope): kind: 'statics' is not allowed here"
     " — did you mean 'static'?"),
    ('"static"', '"images"', "device.toml: recording 1 (gyroscope, images): kind: 'images' is not "
     "recorded with the gyroscope — use it with camera"),
    ('"gyroscope"', '"gyro"', "device.toml: recording 1 (static): sensor: 'gyro' is not allowed here"),
    ('"gyroscope"', "3", "device.toml: recording 1 (static): sensor: 3 is not allowed here"),
    ('file = "static.csv"', "", f"{LABEL}: file: is missing"),
    ("static.csv", "statik.csv", f"{LABEL}: file: 'statik.csv' does not exist — did you mean 'static.csv'?"),
    ("static.csv", "/etc/passwd", f"{LABEL}: file: '/etc/passwd' is an absolute path — name a file"),
    ("static.csv", "C:/x.csv", f"{LABEL}: file: 'C:/x.csv' is an absolute path"),
    ("static.csv", "../static.csv", f"{LABEL}: file: '../static.csv' leads out of the device folder"),
    ('"static.csv"', "'..\\static.csv'", f"{LABEL}: file: '..\\\\static.csv' leads out of the device"),
    ("static.csv", "a\\u0000b", f"{LABEL}: file: 'a\\x00b' is not a file name"),
    ("static.csv", "*.csv", f"{LABEL}: file: '*.csv' is a pattern — name one file a recording"),
    ("static.csv", ".", f"{LABEL}: file: '.' is not a file"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), DECLARATIONS)
def test_a_problem_of_one_recording_leaves_the_others(folder, old, new, expected):
    assert old in STATIC
    good = STATIC.replace("gyroscope", "accelerometer").replace("deg/s", "m/s^2")
    path = folder(STATIC.replace(old, new, 1) + good)
    found = lines(path)
    assert any(line.startswith(expected) for line in found), found
    assert not any("\n" in line for line in found)
    device = sensorbook.load(path)
    assert len(device.accelerometer.static) == 500
    if device.kinds("gyroscope") == ("static",):
        with pytest.raises(InputError) as caught:
            _ = device.gyroscope.static
        assert any(line.startswith(expected) for line in str(caught.value).splitlines())


def test_a_link_inside_the_folder_passes_and_one_outside_does_not(folder, tmp_path):
    path = folder(STATIC.replace("static.csv", "link.csv"))
    (path / "link.csv").symlink_to("static.csv")
    assert lines(path) == []
    (path / "link.csv").unlink()
    (tmp_path / "secret.csv").write_text((path / "static.csv").read_text())
    (path / "link.csv").symlink_to(tmp_path / "secret.csv")
    assert lines(path) == [
        f"{LABEL}: file: 'link.csv' is a link that leads out of the device folder"
        " — copy the file into the folder"
    ]
    (path / "link.csv").unlink()
    (path / "link.csv").symlink_to("link.csv")
    (line,) = lines(path)
    assert line.startswith(f"{LABEL}: file: 'link.csv' does not exist")


def test_counts_are_scaled(folder, samples):
    scale = 'unit = "counts"\nscale = { factor = [1, 2, 3], offset = 5, unit = "rad/s" }'
    recording = sensorbook.load(folder(STATIC.replace('unit = "deg/s"', scale))).gyroscope.static
    np.testing.assert_allclose(recording.values, (samples - 5) * [1, 2, 3], rtol=1e-15)


# ---- whatever stands in device.toml, load raises InputError or nothing ----

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.dates() | st.datetimes() | st.just(10**400),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=5,
)  # fmt: skip
DECLARATION = tomllib.loads(
    'schema = 1\nid = "a"\nname = "n"\nmodel = "m"\n[site]\nlatitude = 1.0\nheight = 1.0\n'
    'date = 2024-05-01\n[spec.gyroscope]\nrandom_walk = { max = 1, min = 0, unit = "deg/sqrt(h)" }\n'
    + STATIC + 'time_unit = "s"\ntable = "t"\nsegments = "s.csv"\nquaternion = "body_to_reference"\n'
    + 'poses = "p.csv"\nscale = { factor = 1.0, offset = 0, unit = "deg/s" }\n'
    + "[[recording]]\nsensor = 'camera'\nkind = 'images'\nfile = '*.png'\ncamera = { width = 1, "
    + "height = 1, focal_px = 1.0, principal_point = [1, 1], distortion = [0], sees = 'both', "
    + "to_body = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] }\n"
)  # fmt: skip


def places(table, path=()):
    """Paths of every value in a declaration."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*path, key))


@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.sampled_from(list(places(DECLARATION))), value=values, data=st.data())
def test_no_value_breaks_the_check(tmp_path, place, value, data):
    import copy

    table = copy.deepcopy(DECLARATION)
    target = table
    for key in place[:-1]:
        target = target[key]
    target[place[-1]] = value
    if isinstance(target, dict) and data.draw(st.booleans()):
        target[data.draw(st.text(max_size=8))] = value
    device, problems = from_declaration(tmp_path, table)
    found, _ = device.check()
    assert all("\n" not in str(problem) for problem in [*problems, *found])


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=60) | st.binary(max_size=60))
def test_no_text_breaks_load(tmp_path, content):
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    (tmp_path / "device.toml").write_bytes(raw)
    with pytest.raises(InputError):
        sensorbook.load(tmp_path)
