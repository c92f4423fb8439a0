"""Parameters that make no sense are named with their units, all at once."""

import math

import pytest

from sensorbook.errors import InputError
from sensorbook.parameters import Choice, Range, check, day, not_negative, positive, utc, whole


def refused(call, *given):
    with pytest.raises(InputError) as caught:
        call(*given)
    return str(caught.value).splitlines()


def test_what_makes_sense_passes():
    check(
        ("area", 1, positive("area", "mm²")),
        ("noise", [0.0, 2], [not_negative("N", "°/√h"), not_negative("B", "°/h")]),
        ("latitude", -90.0, Range("latitude", "°", -90, 90)),
        ("rate", -3.0, Range("rate", "°/s")),
    )


@pytest.mark.parametrize(
    ("value", "rule", "said"),
    [
        (0, positive("area", "mm²"), "area is 0 mm² — give more than 0 mm²"),
        (-1.5, not_negative("N", "°/√h"), "N is -1.5 °/√h — give 0 °/√h or more"),
        (91.0, Range("latitude", "°", -90, 90), "latitude is 91° — give -90 to 90°"),
        (90.0, Range("cone", "°", 0, 90, open=True), "cone is 90° — give more than 0 and less than 90°"),
        (math.nan, Range("rate", "°/s"), "rate is nan °/s — give a finite number in °/s"),
        (math.inf, positive("gap"), "gap is inf — give more than 0"),
        ("3", positive("gap", "µm"), "gap is '3' — give more than 0 µm"),
        (True, positive("gap", "µm"), "gap is True — give more than 0 µm"),
        (5.0, Range("x", high=4.0), "x is 5 — give 4 or less"),
    ],
)  # fmt: skip
def test_each_fault_is_one_line(value, rule, said):
    assert refused(check, ("it", value, rule)) == [f"parameters: it: {said}"]
    assert refused(check, ("it", [1.0, value], [Range("one"), rule])) == [f"parameters: it: {said}"]


def test_all_faults_at_once_and_wrong_lengths():
    two = [positive("speed", "rev/min"), positive("ratio")]
    assert refused(check, ("a", [0.0, -1.0], two), ("b", [1.0], two), ("c", 2.0, two)) == [
        "parameters: a: speed is 0 rev/min — give more than 0 rev/min",
        "parameters: a: ratio is -1 — give more than 0",
        "parameters: b: is [1.0] — give a list of 2: speed [rev/min], ratio",
        "parameters: c: is 2.0 — give a list of 2: speed [rev/min], ratio",
    ]


def test_whole_numbers():
    check(("seed", 3, whole("seed", 0, 10)), ("images", 20.0, whole("number", 20, 30)))
    said = "parameters: seed: seed is 1.5 — give a whole number, 0 to 10"
    assert refused(check, ("seed", 1.5, whole("seed", 0, 10))) == [said]
    for wrong in (11, -1, float("nan"), "3", True):
        assert (
            "give a whole number, 0 to 10" in refused(check, ("seed", wrong, whole("s", 0, 10)))[0]
        )


def test_choice():
    check(("sequence", "ZYX", Choice(("ZYX", "ZXZ"))))
    said = "parameters: sequence: is 'ZZX' — give one of ZYX, ZXZ"
    assert refused(check, ("sequence", "ZZX", Choice(("ZYX", "ZXZ")))) == [said]


def test_day():
    assert day("date", "2040-02-29").year == 2040
    for wrong in ("2026-02-30", "now", "", 3):
        assert refused(day, "date", wrong)[0].startswith(f"parameters: date: {wrong!r} is no day")


def test_utc_with_and_without_z():
    for given in ("2026-05-01T12:00:00", "2026-05-01T12:00:00Z", " 2026-05-01T12:00:00z "):
        assert utc("time", given) == "2026-05-01T12:00:00"
    assert utc("time", "2026-05-01") == "2026-05-01"
    for wrong in ("now", "2026-05-01T12:00+02:00", "2026-05-01T12:00-02:00", "2026-13-01", ""):
        assert refused(utc, "time", wrong)[0].startswith(f"parameters: time: {wrong!r} is no time")
    for wrong in ("1971-12-31T00:00", "2200-01-01"):
        assert "before UTC began or too late" in refused(utc, "time", wrong)[0]
