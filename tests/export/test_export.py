"""Exports: numbers equal those of results.json, and whatever is wrong with it is said in one line."""

import copy
import hashlib
import io
import json
import math
import os

import jsonschema
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook import InputError, cli
from sensorbook.export import export, write
from sensorbook.export.source import yaml_number
from sensorbook.reporting.results import SCHEMA

UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
RANDOM_WALK = {  # x, y, z
    "accelerometer": (1.25e-3, 1.24e-3, 1.96e-3),
    "gyroscope": (7.1e-5, 7.9e-5, 1e-5),
}
WALK = {"accelerometer": (5e-5, None, 3e-5), "gyroscope": (None, None, None)}
WALK_BOUND = {"accelerometer": 4e-6, "gyroscope": 3.25e-6}
TAU = [0.01, 0.1, 1.0, 12.345678901234567]
CURVE = [0.1 / 3, 1e-2, 1.1e-3, 9.876543210987654e-05]


def entry(value, unit):
    return value and {"value": value, "low": 0.9 * value, "high": 1.25 * value, "unit": unit}


def axis_noise(sensor, i):
    signal = UNITS[sensor]
    slow = {"gyroscope": "rad/s^2/sqrt(Hz)", "accelerometer": "m/s^3/sqrt(Hz)"}[sensor]
    n, k = RANDOM_WALK[sensor][i], WALK[sensor][i]
    return {
        "quantization": None,
        "random_walk": entry(n, f"{signal}/sqrt(Hz)"),
        "noise_density": entry(math.sqrt(2) * n, f"{signal}/sqrt(Hz)"),
        "bias_instability": entry(4e-5, signal),
        "rate_random_walk": entry(k, slow),
        "rate_ramp": None,
        "upper_bounds": {} if k else {"rate_random_walk": (i + 1) * WALK_BOUND[sensor]},
    }


def recording(sensor, kind, rate, duration=7200.0):
    return {
        "file": f"{kind}.csv",
        "sha256": "0" * 64,
        "sensor": sensor,
        "kind": kind,
        "samples": int(rate * duration),
        "rate_hz": rate,
        "duration_s": duration,
        "gaps": 0,
    }


def results():
    """A results.json such as a report writes."""
    return {
        "schema": 1,
        "device": {"id": "imu-7", "name": "An IMU", "model": None, "serial": None},
        "software": {"sensorbook": "0.1.0", "python": "3.11", "numpy": "2.0", "scipy": "1.13"},
        "created": "2024-05-01T12:00:00+00:00",
        "inputs": [recording(s, "thermal", 10.0) for s in UNITS]
        + [recording(s, "static", 100.0) for s in UNITS],
        "sensors": {
            sensor: {
                "noise": {axis: axis_noise(sensor, i) for i, axis in enumerate("xyz")},
                "allan": {"tau": TAU, "x": CURVE, "y": [2 * s for s in CURVE], "z": CURVE},
            }
            for sensor in UNITS
        },
        "checks": [],
        "warnings": [],
        "chapters": [],
        "problems": [],
    }


@pytest.fixture
def problems(exported, tmp_path):
    """The lines said of changed results, without the folder before the file's name."""

    def run(name, change):
        with pytest.raises(InputError) as caught:
            exported(name, change)
        return [line.removeprefix(f"{tmp_path}/") for line in str(caught.value).splitlines()]

    return run


def test_these_results_are_valid():
    jsonschema.validate(results(), json.loads(SCHEMA.read_text()))


# ---- Kalibr ----


# The largest of three axes; of the gyroscope's K, nowhere visible, the largest upper bound.
PLAIN = {
    "rostopic": "/imu0",
    "update_rate": 100.0,
    "accelerometer_noise_density": 1.96e-3,
    "accelerometer_random_walk": 5e-5,
    "gyroscope_noise_density": 7.9e-5,
    "gyroscope_random_walk": 3 * 3.25e-6,
}


def test_imu_yaml_has_the_numbers_of_the_results(exported):
    assert yaml.safe_load(exported("kalibr")) == PLAIN


def test_comments_state_axes_intervals_and_values_per_sample(exported):
    text = exported("kalibr")
    assert "x 0.00125 (0.001125 ... 0.001563), y 0.00124 (0.001116 ... 0.00155), z 0.00196" in text
    assert "x 5e-05 (4.5e-05 ... 6.25e-05), y not visible (below 8e-06), z 3e-05" in text
    # 1.96e-3·√100 and 9.75e-6/√100
    assert "# Per sample at 100 Hz: sigma_d = sigma/sqrt(dt) = 0.0196 m/s^2\n" in text
    assert "# Per sample at 100 Hz: sigma_bd = sigma_b*sqrt(dt) = 9.75e-07 rad/s\n" in text
    assert "N of the two-sided spectrum" in text
    assert "not the one-sided noise density, sqrt(2) N" in text
    lines = {line.split(":")[0]: line for line in text.splitlines()}
    assert lines["accelerometer_noise_density"].endswith("# m/s^2/sqrt(Hz); axis z")
    assert lines["gyroscope_random_walk"].endswith(
        "# rad/s^2/sqrt(Hz); not visible: 95 % upper bound, axis z"
    )
    assert lines["rostopic"].endswith("change it to your topic")
    assert text.isascii()


def test_a_visible_axis_goes_before_a_larger_bound(exported):
    def change(r):
        r["sensors"]["accelerometer"]["noise"]["y"]["upper_bounds"]["rate_random_walk"] = 1.0

    assert yaml.safe_load(exported("kalibr", change))["accelerometer_random_walk"] == 5e-5


def test_update_rate_is_the_higher_of_the_longest_rests(exported):
    def change(r):
        r["inputs"][2:] = [
            recording("accelerometer", "static", 50.0),
            recording("gyroscope", "static", 1000.0, duration=60.0),
            recording("gyroscope", "static", 200.0),
        ]

    text = exported("kalibr", change)
    assert yaml.safe_load(text)["update_rate"] == 200.0
    assert "# Static recordings: accelerometer 50 Hz, gyroscope 200 Hz. The highest" in text
    # 7.9e-5·√200
    assert "# Per sample at 200 Hz: sigma_d = sigma/sqrt(dt) = 0.001117 rad/s\n" in text


@settings(max_examples=200, deadline=None)
@given(value=st.floats(min_value=1e-300, max_value=1e300))
def test_every_number_is_a_number_in_yaml(value):
    assert yaml.safe_load(f"key: {yaml_number(value)}  # comment") == {"key": value}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("export") / "results.json"


# characters() gives lone surrogates, too, as JSON may.
@settings(max_examples=100, deadline=None)
@given(name=st.text(st.characters()), id=st.text(st.characters()))
def test_no_name_breaks_out_of_its_comment(name, id, file):
    found = results()
    found["device"].update(name=name, id=id)
    file.write_text(json.dumps(found))
    assert yaml.safe_load(export(file, "kalibr")) == PLAIN


@pytest.mark.parametrize(
    "name",
    ["a\nupdate_rate: 1", "a\r\nupdate_rate: 1", "a\x85b: 1", "a\u2028b: 1", "\x00\x1b", "{rate}"],
)
def test_no_nasty_name_does(name, exported):
    text = exported("kalibr", lambda r: r["device"].update(name=name))
    assert yaml.safe_load(text) == PLAIN
    assert text.splitlines()[0].endswith(f"Device: 'imu-7' ({name!a})")


# ---- what Kalibr cannot be given ----

AGAIN = "render it again with: sensorbook report"
BOTH = "Kalibr needs both sensors: record a rest of the {0} and render its report"


def test_a_missing_and_a_refused_sensor_are_a_line_each(problems):
    def change(r):
        del r["sensors"]["accelerometer"]
        r["sensors"]["gyroscope"]["noise"] = {"reason": "The record has\n17 samples."}

    assert problems("kalibr", change) == [
        "results.json: sensors.accelerometer: is missing — " + BOTH.format("accelerometer"),
        "results.json: sensors.gyroscope.noise: was refused: The record has 17 samples. — "
        + BOTH.format("gyroscope"),
    ]


def test_a_sensor_without_noise(problems):
    assert problems("kalibr", lambda r: r["sensors"]["gyroscope"].pop("noise")) == [
        "results.json: sensors.gyroscope.noise: is missing — " + BOTH.format("gyroscope")
    ]


NOISE = "sensors.gyroscope.noise"


@pytest.mark.parametrize("value", ["1e-5", None, True, [1], -1e-5, math.nan, math.inf, 10**400])
@pytest.mark.parametrize("part", ["value", "low", "high"])
def test_what_is_no_number(value, part, problems):
    def change(r):
        r["sensors"]["gyroscope"]["noise"]["y"]["random_walk"][part] = value

    shown = repr(value)
    shown = shown if len(shown) <= 80 else shown[:78] + "…0"
    assert problems("kalibr", change) == [
        f"results.json: {NOISE}.y.random_walk.{part}: {shown} is not a finite number from 0 — {AGAIN}"
    ]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda r: r["sensors"]["gyroscope"]["noise"]["x"]["random_walk"].update(unit="deg/s"),
            f"{NOISE}.x.random_walk.unit: 'deg/s' is not 'rad/s/sqrt(Hz)' — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["noise"]["x"].update(random_walk=7e-5),
            f"{NOISE}.x.random_walk: 7e-05 is not an object — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["noise"].pop("z"),
            f"{NOISE}.z: is missing — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["noise"]["x"].update(upper_bounds="none"),
            f"{NOISE}.x.upper_bounds: 'none' is not an object — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["noise"]["x"]["upper_bounds"].update(
                rate_random_walk="low"
            ),
            f"{NOISE}.x.upper_bounds.rate_random_walk: 'low' is not a finite number from 0 — {AGAIN}",
        ),
        (
            lambda r: [a.pop("upper_bounds") for a in r["sensors"]["gyroscope"]["noise"].values()],
            f"{NOISE}: rate_random_walk is neither visible nor bounded on any axis, and Kalibr needs a "
            "number above 0 — record a longer rest of the gyroscope and render its report",
        ),
        (
            lambda r: [
                a["upper_bounds"].update(rate_random_walk=0)
                for a in r["sensors"]["gyroscope"]["noise"].values()
            ],
            f"{NOISE}: rate_random_walk is neither visible nor bounded on any axis, and Kalibr needs a "
            "number above 0 — record a longer rest of the gyroscope and render its report",
        ),
        (
            lambda r: r.update(inputs=r["inputs"][:3]),
            f"inputs: no static recording of the gyroscope — {AGAIN}",
        ),
        (lambda r: r.pop("inputs"), f"inputs: is missing — {AGAIN}"),
        (lambda r: r.update(inputs={}), f"inputs: {{}} is not a list — {AGAIN}"),
        (
            lambda r: r["inputs"][3].update(rate_hz=None),
            f"inputs[3].rate_hz: None is not a finite number from 0 — {AGAIN}",
        ),
        (
            lambda r: r["inputs"][3].update(rate_hz=0),
            f"inputs[3].rate_hz: 0 is not a rate — {AGAIN}",
        ),
        (lambda r: r["inputs"].append("a.csv"), f"inputs[4]: 'a.csv' is not an object — {AGAIN}"),
        (lambda r: r["device"].update(name=7), f"device.name: 7 is not text — {AGAIN}"),
        (lambda r: r.pop("device"), f"device: is missing — {AGAIN}"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_key(change, said, problems):
    assert problems("kalibr", change) == [f"results.json: {said}"]


def test_every_problem_is_said(problems):
    def change(r):
        r["sensors"]["gyroscope"]["noise"]["y"]["random_walk"]["value"] = "x"
        r["sensors"]["gyroscope"]["noise"]["x"]["upper_bounds"]["rate_random_walk"] = "y"
        r["inputs"][2]["rate_hz"] = "z"

    assert [line.split(": ")[1] for line in problems("kalibr", change)] == [
        "inputs[2].rate_hz",
        f"{NOISE}.y.random_walk.value",
        f"{NOISE}.x.upper_bounds.rate_random_walk",
    ]


# ---- Allan curves ----


def read(text):
    return pd.read_csv(io.StringIO(text))


ABOUT = ["convention", "device", "created", "sensorbook", "results_sha256"]


def test_allan_csv_has_the_curves_of_the_results(exported, tmp_path):
    table = read(exported("allan-csv"))
    assert list(table.columns) == ["sensor", "tau_s", "x", "y", "z", "unit", *ABOUT]
    found = hashlib.sha256((tmp_path / "results.json").read_bytes()).hexdigest()
    told = ["overlapping Allan deviation; low and high bound its 95 % interval", "imu-7",
            "2024-05-01T12:00:00+00:00", "0.1.0", found]  # fmt: skip
    assert all(row == told for row in table[ABOUT].values.tolist())
    for sensor, unit in UNITS.items():
        mine = table[table["sensor"] == sensor]
        assert set(mine["unit"]) == {unit}
        assert list(mine["tau_s"]) == TAU
        assert list(mine["x"]) == CURVE
        assert list(mine["y"]) == [2 * s for s in CURVE]
        assert list(mine["z"]) == CURVE
    assert len(table) == 2 * len(TAU)


def test_limits_stand_where_they_are_recorded_and_other_keys_nowhere(exported):
    def change(r):
        r["sensors"]["gyroscope"]["allan"] |= {"x_low": TAU, "x_high": CURVE, "edf": {"x": 3}}

    table = read(exported("allan-csv", change))
    assert list(table.columns)[:-5] == [
        "sensor", "tau_s", "x", "y", "z", "unit", "x_low", "x_high"
    ]  # fmt: skip
    gyroscope = table["sensor"] == "gyroscope"
    assert list(table["x_low"][gyroscope]) == TAU
    assert list(table["x_high"][gyroscope]) == CURVE
    assert table["x_low"][~gyroscope].isna().all()


def test_a_sensor_without_a_curve_is_left_out(exported):
    def change(r):
        r["sensors"]["gyroscope"] = {"noise": {"reason": "too short"}}
        r["sensors"]["camera"] = {"images": []}

    assert set(read(exported("allan-csv", change))["sensor"]) == {"accelerometer"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda r: r.update(sensors={}),
            "sensors: no sensor has an Allan curve — record a rest and render the chapter allan",
        ),
        (lambda r: r.pop("sensors"), f"sensors: is missing — {AGAIN}"),
        (lambda r: r.update(sensors=[]), f"sensors: [] is not an object — {AGAIN}"),
        (
            lambda r: r["sensors"]["gyroscope"].update(allan=5),
            f"sensors.gyroscope.allan: 5 is not an object — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["allan"].pop("tau"),
            f"sensors.gyroscope.allan.tau: is missing — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["allan"].update(x=CURVE[1:]),
            f"sensors.gyroscope.allan.x: has 3 values for 4 cluster times — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["allan"].update(z=[1, 2, "3", 4]),
            f"sensors.gyroscope.allan.z[2]: '3' is not a finite number from 0 — {AGAIN}",
        ),
        (
            lambda r: r["sensors"]["gyroscope"]["allan"].update(tau=[1, 2, math.nan, 4]),
            f"sensors.gyroscope.allan.tau[2]: nan is not a finite number from 0 — {AGAIN}",
        ),
    ],
)
def test_curves_that_are_none_are_one_line(change, said, problems):
    assert problems("allan-csv", change) == [f"results.json: {said}"]


# ---- files ----

NAMED = "name the results.json of a device's report"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is not valid JSON: Expecting value: line 1 column 1 (char 0) — " + NAMED),
        (b"x,y\n1,2\n", "is not valid JSON: Expecting value: line 1 column 1 (char 0) — " + NAMED),
        (b"\xff\xfe\xff", "is not valid JSON: "),
        (b"[" * 100_000, "is not valid JSON: nested too deep — " + NAMED),
        (b'{"schema": ' + b"9" * 5000 + b"}", "is not valid JSON: Exceeds the limit"),
        (b"[]", "holds no object — " + NAMED),
        (b"{}", "schema: is missing — " + NAMED),
        (b'{"schema": 2}', "schema: 2 is not a version this sensorbook reads — " + AGAIN),
        (b'{"schema": true}', "schema: True is not a version this sensorbook reads — " + AGAIN),
        (b'{"schema": "1"}', "schema: '1' is not a version this sensorbook reads — " + AGAIN),
    ],
)
@pytest.mark.parametrize("name", ["kalibr", "allan-csv"])
def test_what_is_no_results_file(name, content, said, tmp_path, capsys):
    file = tmp_path / "r.json"
    file.write_bytes(content)
    assert cli.main(["export", str(file), "--format", name]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"{file}: {said}")
    assert len(shown.err.splitlines()) == 1


def test_a_file_that_is_not_there_and_a_folder(tmp_path, capsys):
    for path, reason in ((tmp_path / "none.json", "No such file"), (tmp_path, "Is a directory")):
        assert cli.main(["export", str(path), "--format", "kalibr"]) == 1
        error = capsys.readouterr().err
        assert error.startswith(f"{path}: cannot be read: {reason}")
        assert len(error.splitlines()) == 1


def test_a_file_appears_whole_or_not_at_all(tmp_path, capsys):
    good, bad, out = (tmp_path / name for name in ("results.json", "bad.json", "imu.yaml"))
    good.write_text(json.dumps(results()))
    refused = copy.deepcopy(results())
    refused["sensors"]["gyroscope"]["noise"] = {"reason": "too short"}
    bad.write_text(json.dumps(refused))

    def run(file):
        return cli.main(["export", str(file), "--format", "kalibr", "-o", str(out)])

    assert run(bad) == 1
    assert not out.exists()
    capsys.readouterr()
    assert run(good) == 0
    assert capsys.readouterr().out == f"{out}: written\n"
    assert out.read_text() == export(good, "kalibr")
    assert run(bad) == 1
    assert out.read_text() == export(good, "kalibr")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.json", "imu.yaml", "results.json"]


def test_a_link_stays_one_and_its_file_is_written(tmp_path):
    (tmp_path / "link.yaml").symlink_to("imu.yaml")
    write(tmp_path / "link.yaml", "text\n", tmp_path / "results.json")
    assert (tmp_path / "link.yaml").is_symlink()
    assert (tmp_path / "imu.yaml").read_text() == "text\n"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("results.json", "is the results.json itself — name another file"),
        (".", "is not a file — name one, or leave -o out for standard output"),
        ("results.json/x", "cannot be written: "),
        (
            "n" * 300,
            "cannot be written: File name too long — name a file in a folder you may write to",
        ),
    ],
)
def test_where_nothing_can_be_written(name, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results.json").write_text("{}")
    with pytest.raises(InputError) as caught:
        write(name, "text", "results.json")
    assert str(caught.value).startswith(f"{name}: {said}")
    assert (tmp_path / "results.json").read_text() == "{}"
    assert [p.name for p in tmp_path.iterdir()] == ["results.json"]


def test_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: is not a file"):
        write(tmp_path / "pipe", "text", tmp_path / "results.json")
    assert (tmp_path / "pipe").is_fifo()
