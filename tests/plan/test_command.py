"""`sensorbook plan`: what it prints, and what it says of arguments and files that will not do."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from sensorbook import InputError, cli
from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.plan import KINDS, Usage, plan
from sensorbook.plan.levels import GRADES, of_grade, of_results

DEGREE = np.pi / 180


def results(tmp_path, change=None):
    """A results.json with a gyroscope's noise; `change` (object) → None mends it."""

    def axis(n, b, k=None):
        found = {"random_walk": {"value": n}, "bias_instability": {"value": b}}
        found["rate_random_walk"] = None if k is None else {"value": k}
        return found | {"quantization": None, "rate_ramp": None,
                        "upper_bounds": {"rate_random_walk": 2e-7, "rate_ramp": 1e-9}}  # fmt: skip

    noise = {a: axis(5e-5, 4e-5, 1e-6 if a == "x" else None) for a in "xyz"}
    whole = {
        "schema": 1,
        "device": {"id": "imu-7"},
        "inputs": [{"sensor": "gyroscope", "kind": "static", "rate_hz": 50.0}],
        "sensors": {"gyroscope": {"noise": noise}},
    }
    if change:
        change(whole)
    file = tmp_path / "results.json"
    file.write_text(json.dumps(whole))
    return str(file)


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "images"])
def test_every_kind_says_what_to_do_what_comes_of_it_and_whence(kind, capsys):
    for sensor in KINDS[kind].quantities:
        assert cli.main(["plan", kind, "--sensor", sensor]) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"{kind}, {sensor}: ")
        for label in ("do", "assumes", "source"):
            assert re.search(rf"^  {label}  +- \w", shown, re.M), label
        # Every row of the table has a standard error with a unit or a ratio, and its interval.
        table = [line for line in shown.splitlines() if "±" in line and line.startswith("    ")]
        assert table
        assert "1 sigma" in shown
        assert max(map(len, shown.splitlines())) <= 110


def test_the_overview_holds_each_kind_but_images(capsys):
    assert cli.main(["plan"]) == 0
    shown = capsys.readouterr().out
    for kind in KINDS:
        assert (f"\n{kind}, " in f"\n{shown}") == (kind != "images")


def test_the_help_has_an_example(capsys):
    assert cli.main(["plan", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "example:\n  sensorbook plan\n  sensorbook plan static " in shown
    for name in (*KINDS, *GRADES):
        assert name in shown


def test_a_term_that_not_every_record_shows():
    made = plan("static", sensor="gyroscope", rate=10.0)
    (walk,) = (row for row in made.rows if row[0].endswith(" K"))
    assert not made.numbers["found"]["x", "rate_random_walk"].stated
    assert walk[3:] == ("may not be told apart", "may be bounded only")


def test_a_rate_too_low_for_any_rest_is_told():
    made = plan("static", rate=1e-3)
    assert not made.reached
    assert made.notes[0].endswith("a week gives 605 samples, and 1000 are needed")
    assert plan("static", rate=1e6).reached


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nap"], "no 'nap'; choose from static, positions, six_position, rotation, thermal"),
        (["static", "--sensor", "camera"], "choose from gyroscope, accelerometer, magnetometer"),
        (["static", "--quantity", "bias"], "choose from bias_instability, quantization, random_walk"),
        (["rotation", "--quantity", "bias"], "choose from hard_iron, soft_iron, direction"),
        (["static", "--grade", "toy"], "no 'toy'; choose from consumer, industrial, tactical"),
        (["static", "--within", "well"], "no number above 0 and its unit, such as 10% or 1 °/h"),
        (["static", "--within", "0"], "'0' is no number above 0"),
        (["static", "--within", "1..2"], "'1..2' is no number above 0"),
        (["static", "--within", "5 uT"], "'uT' is a magnetic flux density"),
        (["positions", "--within", "10%"], "'%' is a ratio"),
        (["static", "--span", "20"], "--span goes with thermal, not with static"),
        (["thermal", "--levelling", "1"], "--levelling goes with six_position, not with thermal"),
        (["--within", "10%"], "--within goes with a KIND"),
        (["static", "--quantity", "rate_ramp"], "no grade has a typical rate ramp: give --from"),
        (["static", "--from", "x", "--grade", "consumer"], "--from or --grade, not both"),
        (["static", "--rate", "-1"], "'-1' is not a number above 0"),
        (["images", "--grade", "tactical"], "neither --from nor --grade"),
        (["thermal", "--span", "4"], "--span: 4: 6 °C at least"),
        (["six_position", "--levelling", "10"], "--levelling: 10: 5 degrees at most"),
        (["static", "--within", ""], "--within: '' is no number above 0"),
        (["thermal", "--span", "1e6"], "--span: 1e+06: 300 °C at most"),
        (["trajectory", "--reference", "180"], "--reference: 180: 30 degrees at most"),
        (["static", "--rate", "1e-6"], "--rate: 1e-06: 0.001 to 1e+06 Hz"),
        (["--rate", "1e7"], "--rate: 1e+07: 0.001 to 1e+06 Hz"),
    ],
)  # fmt: skip
def test_wrong_usage_is_2_and_says_what_is_possible(arguments, told, capsys):
    assert cli.main(["plan", *arguments]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert told in " ".join(shown.err.split())
    assert "Traceback" not in shown.err


def test_a_measured_device_gives_its_levels_rate_and_bounds(tmp_path):
    file = results(tmp_path)
    found = of_results(file, "gyroscope")
    assert found.rate == 50
    assert found.axes["x"].rate_random_walk == 1e-6
    assert found.axes["y"].rate_random_walk == 0
    assert not found.bounds
    found = of_results(file, "gyroscope", 20.0, "rate_random_walk")
    assert found.rate == 20
    assert found.axes["y"].rate_random_walk == 2e-7
    assert found.bounds == {("y", "rate_random_walk"), ("z", "rate_random_walk")}
    shown = "\n".join(plan("static", quantity="rate_random_walk", results=file).lines())
    assert "does not show it on y, z: its upper bound stands for it" in " ".join(shown.split())
    assert "≤ 0.0413 °/h/√s" in shown


def test_the_worst_axis_decides(tmp_path):
    def louder(whole):
        whole["sensors"]["gyroscope"]["noise"]["z"]["random_walk"]["value"] = 4e-4

    own = plan("static", within="10%", results=results(tmp_path))
    worse = plan("static", within="10%", results=results(tmp_path, louder))
    assert worse.numbers["seconds"] > own.numbers["seconds"]
    assert any("B on z by length of the rest" in note for note in worse.notes)


@pytest.mark.parametrize(
    ("change", "arguments", "told"),
    [
        (lambda w: w["sensors"].clear(), ["static"],
         "sensors.gyroscope.noise: is missing — record a rest of the gyroscope (kind static)"),
        (lambda w: w["sensors"]["gyroscope"]["noise"].pop("y"), ["static"],
         "sensors.gyroscope.noise.y: is missing"),
        (lambda w: w["sensors"]["gyroscope"]["noise"]["x"].update(random_walk=None), ["thermal"],
         "sensors.gyroscope.noise.x.random_walk: is missing or 0"),
        (lambda w: w["sensors"]["gyroscope"]["noise"]["x"]["random_walk"].update(value=1e200), ["static"],
         "noise.x.random_walk.value: 1e+200 is no noise level of a sensor"),
        (lambda w: w["sensors"].update(gyroscope=[1]), ["static"],
         "sensors.gyroscope: [1] is not an object"),
        (lambda w: w["sensors"]["gyroscope"]["noise"]["x"]["random_walk"].update(value=-1), ["static"],
         "noise.x.random_walk.value: -1 is not a finite number from 0"),
        (lambda w: None, ["static", "--quantity", "quantization"],
         "no axis shows a quantization or bounds it"),
        (lambda w: None, ["rotation"], "sensors.magnetometer.noise: is missing"),
        (lambda w: None, ["positions", "--sensor", "gyroscope"],
         "sensors.accelerometer.noise: is missing"),
        (lambda w: w["inputs"][0].update(rate_hz="fast"), ["static"],
         "inputs[0].rate_hz: 'fast' is no rate — give --rate"),
        (lambda w: w.update(schema=7), ["static"], "schema: 7 is not a version"),
    ],
)  # fmt: skip
def test_results_that_lack_what_is_needed_are_told_by_line(
    change, arguments, told, tmp_path, capsys
):
    file = results(tmp_path, change)
    assert cli.main(["plan", *arguments, "--from", file]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"{file}: ")
    assert told in shown.err
    assert len(shown.err.splitlines()) == 1


def test_the_overview_of_a_device_says_what_its_results_lack(tmp_path, capsys):
    assert cli.main(["plan", "--from", results(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "static, gyroscope: bias instability" in shown
    assert "rotation, magnetometer:\n  not planned: " in shown
    assert cli.main(["plan", "--from", str(tmp_path / "none.json")]) == 1
    assert "none.json: cannot be read" in capsys.readouterr().err


def test_units_and_shares_ask_for_the_same():
    level = of_grade("gyroscope", "consumer").axes["x"].bias_instability
    assert level == pytest.approx(8 * DEGREE / 3600)
    share = plan("static", "gyroscope", within="10 %")
    absolute = plan("static", "gyroscope", within="0.8 deg/h")
    assert share.numbers["seconds"] == absolute.numbers["seconds"]
    assert share.rows == absolute.rows
    assert (
        plan("positions", within="1 mg").rows == plan("positions", within="0.00980665 m/s^2").rows
    )


def test_a_tighter_wish_takes_longer_and_says_where_it_ends():
    times = [plan("static", within=w).numbers["seconds"] for w in ("50%", "20%", "10%", "5%")]
    assert times == sorted(set(times))
    far = plan("static", within="0.1%")
    assert not far.reached
    assert far.notes[0].startswith("out of reach within a week: B ")
    for kind, within in (("positions", "1e-4 mg"), ("six_position", "1e-4 mg"), ("rotation", "1 nT"),
                         ("thermal", "1e-6 deg/s"), ("trajectory", "1e-4 deg")):  # fmt: skip
        made = plan(kind, within=within)
        assert not made.reached
        assert made.notes[0].startswith("out of reach: "), kind


def test_the_quantity_tells_the_sensor():
    assert plan("static", quantity="random_walk").title.startswith("static, gyroscope")
    with pytest.raises(Usage):
        plan("six_position", "gyroscope")


def test_grades_are_si():
    for grade, sensors in GRADES.items():
        found = of_grade("accelerometer", grade).axes["x"]
        mg = STANDARD_GRAVITY / 1000
        assert (found.random_walk / mg, found.bias_instability / mg) == pytest.approx(
            sensors["accelerometer"]
        )
        # K ends the flat of B where it says.
        flat = found.allan_variance(1000.0) - found.random_walk**2 / 1000
        assert flat == pytest.approx(2 * 2 * np.log(2) / np.pi * found.bias_instability**2)


def test_no_results_of_another_kind_of_file(tmp_path):
    file = tmp_path / "a.json"
    file.write_text("[]")
    with pytest.raises(InputError, match="holds no object"):
        of_results(file, "gyroscope")
