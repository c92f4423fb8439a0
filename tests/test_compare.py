"""Results compared: changes in combined standard errors, and what chance alone would mark."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from sensorbook.cli import main
from sensorbook.compare import Measured, compare, standard_errors, table
from sensorbook.export.source import read_results
from sensorbook.magnetometer import calibrate
from sensorbook.simulate import rotation

ENTRY = {"value": 6e-5, "low": 5.8e-5, "high": 6.2e-5, "unit": "rad/s/sqrt(Hz)"}


def results(path, device="imu-7", created="2026-01-01T00:00:00+00:00", **values):
    """A results.json whose gyroscope has these terms on each axis; None: no visible effect."""
    axis = {q: None if v is None else ENTRY | {"value": v, "low": 0.97 * v, "high": 1.03 * v}
            for q, v in values.items()}  # fmt: skip
    axis["upper_bounds"] = {q: 2e-6 for q, v in values.items() if v is None}
    found = {
        "schema": 1,
        "device": {"id": device, "name": device},
        "software": {"sensorbook": "0.1.0"},
        "created": created,
        "inputs": [{"sensor": "gyroscope", "kind": "static", "rate_hz": 100.0}],
        "sensors": {"gyroscope": {"noise": {a: copy.deepcopy(axis) for a in "xyz"}}},
    }
    path.write_text(json.dumps(found))
    return path


def test_a_change_counts_in_combined_standard_errors():
    a, b = Measured(1.0, 0.9, 1.1), Measured(1.3, 1.2, 1.4)
    # Two standard errors of 0.1/1.96 each, in quadrature: 0.3 / (0.1/1.96·√2).
    assert standard_errors(a, b) == pytest.approx(0.3 / (0.1 / 1.959964 * 2**0.5), rel=1e-6)
    assert standard_errors(b, a) == -standard_errors(a, b)
    assert standard_errors(a, a) == 0


def test_the_sides_that_face_each_other_count():
    skew = Measured(1.0, 0.99, 1.5)  # loose upwards, where the other one lies
    assert standard_errors(skew, Measured(1.3, 1.29, 1.31)) < 2
    assert standard_errors(skew, Measured(0.7, 0.69, 0.71)) < -20


def test_a_term_that_was_not_seen_lies_below_its_bound():
    unseen = Measured(None, 0.0, 1.0)
    assert abs(standard_errors(unseen, Measured(0.8, 0.7, 0.9))) < 2
    assert standard_errors(unseen, Measured(8.0, 7.0, 9.0)) > 7
    assert standard_errors(Measured(None, 0.0, None), Measured(8.0, 7.0, 9.0)) is None


def test_chance_alone_marks_one_comparison_in_twenty():
    """300 comparisons of 30 numbers that did not change, at a seed fixed beforehand."""
    from sensorbook.compare import FALSE_ALARMS, NormalDist

    rng = np.random.default_rng(31)
    threshold = NormalDist().inv_cdf(1 - FALSE_ALARMS / 60)
    marked = 0
    for _ in range(300):
        pairs = rng.normal(1, 0.01, (30, 2))
        z = [
            standard_errors(*(Measured(v, v - 0.0196, v + 0.0196) for v in pair)) for pair in pairs
        ]
        marked += any(abs(value) > threshold for value in z)
    # 15 expected; Poisson, five standard deviations to either side would be 0 and 34.
    assert 3 <= marked <= 30


def test_of_one_device_the_earliest_is_the_reference(tmp_path):
    late = results(tmp_path / "b.json", created="2026-06-01T00:00:00+00:00", random_walk=9e-5)
    early = results(tmp_path / "a.json", random_walk=6e-5)
    (comparison,) = compare([read_results(late), read_results(early)])
    lines = list(table(comparison))
    assert lines[0] == "imu-7 (2026-06-01), against imu-7 (2026-01-01)"
    # 6e-5 rad/s/√Hz is 0.2063 °/√h.
    assert "gyroscope angle random walk N  x  0.2063 (0.2001 … 0.2125)" in lines[2]
    assert lines[2].endswith("▲ rose")
    assert lines[-1] == (
        "  3 of 3 numbers have changed by more than 2.4 standard errors: where nothing changes, chance "
        "marks any in one comparison in twenty."
    )


def test_of_several_devices_the_first_is(tmp_path, capsys):
    paths = [results(tmp_path / f"{n}.json", device=n, random_walk=6e-5, created=f"202{k}-01-01")
             for k, n in enumerate("cba")]  # fmt: skip
    assert main(["compare", *map(str, paths)]) == 0
    said = capsys.readouterr().out
    assert [line for line in said.splitlines() if "against" in line] == [
        "b (2021-01-01), against c (2020-01-01)", "a (2022-01-01), against c (2020-01-01)"
    ]  # fmt: skip
    assert said.count("None of 3 numbers has changed") == 2


def test_what_appears_and_vanishes(tmp_path):
    a = results(tmp_path / "a.json", device="a", rate_random_walk=None, bias_instability=5e-5)
    b = results(tmp_path / "b.json", device="b", rate_random_walk=9e-6, bias_instability=None)
    (comparison,) = compare([read_results(a), read_results(b)])
    words = {(c.quantity, c.axis): line for c, line in
             zip(comparison.changes, list(table(comparison))[2:], strict=False)}  # fmt: skip
    assert "< 0.41" in words["rate_random_walk", "x"]  # 2e-6 rad/s/√s in °/h/√s
    assert words["rate_random_walk", "x"].endswith("▲ appeared")
    assert words["bias_instability", "y"].endswith("▼ vanished")


def test_what_makes_numbers_hard_to_compare_is_said(tmp_path):
    a, b = (results(tmp_path / f"{n}.json", random_walk=6e-5) for n in "ab")
    found = json.loads(b.read_text())
    found["inputs"][0]["rate_hz"] = 50.0
    found["software"]["sensorbook"] = "0.2.0"
    b.write_text(json.dumps(found))
    (comparison,) = compare([read_results(a), read_results(b)])
    assert comparison.cautions == (
        "the gyroscope's static recording was sampled at 100 Hz, now at 50 Hz: quantization and what "
        "a low-pass hides differ",
        "computed by sensorbook 0.1.0, now by 0.2.0",
    )


def test_one_file_is_a_usage_error_and_bad_ones_are_named(tmp_path, capsys):
    good = results(tmp_path / "a.json", random_walk=6e-5)
    assert main(["compare", str(good)]) == 2
    (tmp_path / "b.json").write_text("{")
    assert main(["compare", str(good), str(tmp_path / "b.json"), str(tmp_path / "c.json")]) == 1
    error = capsys.readouterr().err.splitlines()[-2:]
    assert "b.json: is not valid JSON" in error[0]
    assert "c.json: cannot be read: No such file or directory" in error[1]
    found = json.loads(good.read_text())
    found["sensors"]["gyroscope"]["noise"]["y"]["random_walk"]["low"] = "x"
    (tmp_path / "b.json").write_text(json.dumps(found))
    assert main(["compare", str(good), str(tmp_path / "b.json")]) == 1
    assert (
        "sensors.gyroscope.noise.y.random_walk.low: 'x' is not a finite number"
        in capsys.readouterr().err
    )


def test_what_is_missing_now_is_said(tmp_path):
    a = results(tmp_path / "a.json", device="a", random_walk=6e-5, bias_instability=5e-5)
    b = results(tmp_path / "b.json", device="b", random_walk=6e-5)
    (comparison,) = compare([read_results(a), read_results(b)])
    lines = list(table(comparison))
    assert sum(line.endswith("no result now") for line in lines) == 3
    assert lines[-1].endswith("3 of the reference have no counterpart now.")


# ---- a magnetometer ----


def compass(path, calibration, device="compass"):
    found = {
        "schema": 1,
        "device": {"id": device, "name": device},
        "software": {"sensorbook": "0.1.0"},
        "created": "2026-01-01T00:00:00+00:00",
        "inputs": [],
        "sensors": {"magnetometer": {"calibration": calibration}},
    }
    path.write_text(json.dumps(found, default=lambda numbers: numbers.tolist()))
    return read_results(path)


IRON = {
    "method": "ellipsoid", "hard_iron": [8e-6, -30e-6, 1e-6], "soft_iron": np.eye(3).tolist(),
    "field": 48e-6, "field_known": True, "interval_factor": 1.96,
    "std": {"hard_iron": [1e-8] * 3, "soft_iron": [[1e-3] * 3] * 3, "field": 1e-7},
}  # fmt: skip


def test_a_magnetometers_numbers(tmp_path):
    bent = np.eye(3) + 4e-3 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, -2]])
    later = IRON | {
        "hard_iron": [8e-6, -30.1e-6, 1e-6],
        "soft_iron": bent.tolist(),
        "field": 47.9e-6,
    }
    a, b = (compass(tmp_path / f"{n}.json", c, n) for n, c in (("a", IRON), ("b", later)))
    (comparison,) = compare([a, b])
    z = {(c.quantity, c.axis): c.z for c in comparison.changes}
    assert len(z) == 10
    assert z["hard_iron", "y"] == pytest.approx(-0.1e-6 / (1e-8 * 2**0.5), rel=1e-4)
    assert z["soft_iron", "xy"] == pytest.approx(4 / 2**0.5, rel=1e-4)
    assert z["soft_iron", "zz"] == pytest.approx(-8 / 2**0.5, rel=1e-4)
    assert z["field", ""] == pytest.approx(-1 / 2**0.5, rel=1e-4)
    lines = list(table(comparison))
    assert any(
        "magnetometer hard iron" in line and "▼ fell" in line and "µT" in line for line in lines
    )
    assert lines[-1].startswith("  3 of 10 numbers have changed by more than 2.8 standard errors")


@pytest.mark.parametrize("known", [True, False])
def test_the_field_is_compared_where_it_is_known_only(tmp_path, known):
    """A device turned here and elsewhere has not changed."""
    std = IRON["std"] | {"field_measured": 1e-7}
    here = IRON | {"field_known": known, "field_measured": 49e-6, "std": std}
    elsewhere = here | {"field": 52e-6, "field_measured": 53e-6}
    a, b = (compass(tmp_path / f"{n}.json", c, n) for n, c in (("a", here), ("b", elsewhere)))
    (comparison,) = compare([a, b])
    changed = {c.quantity for c in comparison.changes if c.z}
    assert changed == ({"field"} if known else set())
    assert {c.quantity for c in comparison.changes} == {"hard_iron", "soft_iron"} | changed
    assert comparison.cautions == ()


def test_soft_irons_of_different_scale_are_not_compared(tmp_path):
    relative = IRON | {"field_known": False, "field": 46e-6}
    a, b = (compass(tmp_path / f"{n}.json", c, n) for n, c in (("a", IRON), ("b", relative)))
    (comparison,) = compare([a, b])
    assert {c.quantity for c in comparison.changes} == {"hard_iron"}
    assert comparison.cautions == (
        "the magnetometer's soft iron is scaled to the Earth's field in one of the two only: it is not "
        "compared",
    )


def test_a_refused_calibration_has_no_numbers(tmp_path):
    refused = {"method": None, "reason": "too few directions"}
    a, b = (compass(tmp_path / f"{n}.json", c, n) for n, c in (("a", IRON), ("b", refused)))
    (comparison,) = compare([a, b])
    assert comparison.cautions == ()
    assert list(table(comparison))[-1].startswith("  Nothing to compare")


@pytest.mark.parametrize(
    "damage",
    [
        {"hard_iron": [1, 2]},
        {"hard_iron": "x"},
        {"soft_iron": [[1, 2, 3]]},
        {"field": None},
        {"std": {"hard_iron": [1e-8] * 3}},
        {"interval_factor": "1.96"},
    ],
)
def test_a_damaged_calibration_is_one_line(tmp_path, damage, capsys):
    compass(tmp_path / "a.json", IRON)
    compass(tmp_path / "b.json", IRON | damage)
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "b.json: sensors.magnetometer.calibration: is not as results.json has it" in line


def test_repeats_of_one_magnetometer_do_not_differ_and_a_shift_does(tmp_path):
    """25 devices, each turned twice, 60 s at 25 Hz; the seed was fixed beforehand."""
    rng = np.random.default_rng(20261)
    field, marked, shifted = np.array([0, 24e-6, -41e-6]), 0, 0
    for _ in range(25):
        iron = rotation.draw_iron(rng, 47.5e-6)
        runs = []
        for _ in range(2):
            true = rotation.turned(rng, 1500, 25.0, field, 9.8)["field"]
            read = rotation.read_field(true, iron)
            runs.append(rotation.noisy(rng, read, 25.0, rotation.NOISE["magnetometer"]))
        first, again = (calibrate(run).to_results() for run in runs)
        moved = calibrate(runs[1] + [0.5e-6, 0, 0]).to_results()
        a, b, c = (compass(tmp_path / f"{n}.json", f, n)
                   for n, f in (("a", first), ("b", again), ("c", moved)))  # fmt: skip
        (same,), (other,) = compare([a, b]), compare([a, c])
        marked += any(abs(change.z) > same.threshold for change in same.changes)
        x = next(k for k in other.changes if (k.quantity, k.axis) == ("hard_iron", "x"))
        shifted += x.z > other.threshold
    # 1.25 expected; more than 4 has a probability of 1 % (Poisson).
    assert marked <= 4
    # Half a microtesla is five of a hard iron's standard errors and more.
    assert shifted >= 23
