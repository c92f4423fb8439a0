"""Verdicts against [spec], and results.json against its schema."""

from __future__ import annotations

import json
import math

import pytest
from jsonschema import Draft202012Validator

from sensorbook.reporting import results

DEG_PER_SQRT_HOUR = math.radians(1) / 60


def noise(value, low, high):
    return {"noise": {"x": {"random_walk": {"value": value, "low": low, "high": high}}}}


def null(**upper_bounds):
    return {"noise": {"x": {"random_walk": None, "upper_bounds": upper_bounds}}}


@pytest.mark.parametrize(
    ("limit", "result", "verdict"),
    [
        ({"max": 3}, noise(2, 1, 2.9), "pass"),
        ({"max": 3}, noise(2, 1, 3), "pass"),
        ({"max": 3}, noise(2, 1, 3.1), "undecided"),
        ({"max": 3}, noise(4, 2.9, 5), "undecided"),
        ({"max": 3}, noise(4, 3.1, 5), "fail"),
        ({"max": 3}, noise(3, 3, 3), "pass"),
        ({"min": 3}, noise(4, 3, 5), "pass"),
        ({"min": 3}, noise(4, 2, 5), "undecided"),
        ({"min": 3}, noise(2, 1, 2.9), "fail"),
        ({"max": 3}, null(random_walk=2.9), "pass"),
        ({"max": 3}, null(random_walk=3.1), "undecided"),
        ({"min": 3}, null(random_walk=2.9), "fail"),
        ({"max": 3}, null(), "undecided"),
        ({"max": 3}, {"noise": {"reason": "too short"}}, "undecided"),
        ({"max": 3}, {}, "undecided"),
    ],
)
def test_a_verdict_needs_the_whole_interval_on_one_side(limit, result, verdict):
    (check,) = (
        row
        for row in results.checks(
            "gyroscope", {"random_walk": {**limit, "unit": "rad/s/sqrt(Hz)"}}, result
        )
        if row["axis"] == "x"
    )
    assert check["verdict"] == verdict


def test_limits_are_compared_in_si_and_both_bounds_are_checked():
    limit = {"min": 0.1, "max": 0.3, "unit": "deg/sqrt(h)"}
    value = 0.2 * DEG_PER_SQRT_HOUR
    rows = results.checks("gyroscope", {"random_walk": limit}, noise(value, value, value))
    assert [(r["axis"], r["bound"]) for r in rows] == [
        (axis, bound) for bound in ("max", "min") for axis in "xyz"
    ]
    assert rows[0]["limit"] == pytest.approx(0.3 * DEG_PER_SQRT_HOUR)
    assert rows[0]["unit"] == "rad/s/sqrt(Hz)"
    assert [r["verdict"] for r in rows if r["axis"] == "x"] == ["pass", "pass"]


def test_a_thermal_residual_may_have_a_limit():
    limit = {"rms_after": {"max": 1.0, "unit": "deg/s"}}
    rows = results.checks("gyroscope", limit, {"thermal": {"x": {"rms_after": 0.01}}})
    assert [r["verdict"] for r in rows] == ["pass", "undecided", "undecided"]


def test_the_worst_verdict_stands_for_the_device():
    def overall(*verdicts):
        return results.overall([{"verdict": v} for v in verdicts])

    assert overall() is None
    assert overall("pass", "pass") == "pass"
    assert overall("pass", "undecided") == "undecided"
    assert overall("undecided", "fail", "pass") == "fail"


def test_numbers_that_are_none_never_leave():
    with pytest.raises(ValueError, match="JSON"):
        results.dumps({"a": math.nan})


def example():
    estimate = {"value": 1.0, "low": 0.5, "high": 2.0, "unit": "rad"}
    axis = dict.fromkeys(
        ("quantization", "random_walk", "noise_density"), estimate
    ) | dict.fromkeys(("bias_instability", "rate_random_walk", "rate_ramp"))
    device = {"id": "d", "name": "D", "model": None, "serial": "7", "spec": {}}
    record = {
        "sensor": "gyroscope",
        "chapter": "allan",
        "title": "Allan",
        "status": "complete",
        "reason": None,
        "results": {"noise": dict.fromkeys("xyz", axis | {"upper_bounds": {"rate_ramp": 1e-9}})},
    }
    software = dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1")
    return results.assemble(device, software, "2026-05-01T00:00:00+00:00", [record])


def test_the_schema_takes_what_is_assembled():
    schema = json.loads(results.SCHEMA.read_text())
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema).validate(example())


@pytest.mark.parametrize(
    "spoil",
    [
        lambda r: r.pop("schema"),
        lambda r: r["device"].pop("id"),
        lambda r: r["device"].update(id="../up"),
        lambda r: r["sensors"].update(barometer={}),
        lambda r: r["sensors"]["gyroscope"]["noise"].pop("y"),
        lambda r: r["sensors"]["gyroscope"]["noise"]["x"].pop("rate_ramp"),
        lambda r: r["sensors"]["gyroscope"]["noise"]["x"]["random_walk"].pop("low"),
        lambda r: r["sensors"]["gyroscope"].update(calibration={"method": None}),
        lambda r: r["sensors"]["gyroscope"].update(thermal={"reason": "x", "coefficients": [1]}),
        lambda r: r["chapters"][0].update(status="refused"),
        lambda r: r["chapters"][0].update(status="failed", reason="why"),
        lambda r: r["checks"].append({"verdict": "maybe"}),
    ],
)
def test_the_schema_refuses_what_is_wrong(spoil):
    found = json.loads(json.dumps(example()))
    spoil(found)
    assert not Draft202012Validator(json.loads(results.SCHEMA.read_text())).is_valid(found)


def test_methods_of_several_chapters_stand_side_by_side():
    into = {}
    results.merge(into, {"noise_methods": {"read_off": 1}, "allan": {"tau": [1]}})
    results.merge(into, {"noise_methods": {"whittle": 2}, "noise": {"x": 3}})
    results.merge(into, {"noise": {"y": 4}})
    assert into == {
        "noise_methods": {"read_off": 1, "whittle": 2},
        "allan": {"tau": [1]},
        "noise": {"y": 4},
    }
