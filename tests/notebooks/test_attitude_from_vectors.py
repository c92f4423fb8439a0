"""The chapter on attitude from vectors: its numbers, and sentences that follow its parameters."""

import numpy as np
import pytest
from devices import ended, read_chapter

from sensorbook.attitude.vectors import SOLVERS


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("attitude_from_vectors", tmp_path_factory.mktemp("chapter"))


def test_numbers(read):
    found = read[0]["results"]["attitude_from_vectors"]
    between = found["angle_between"]["value"]
    assert np.degrees(between) == pytest.approx(103.4, abs=0.1)
    # In closed form for independent errors: the Sun's two axes and, about it, the field's.
    sun, field = np.radians([0.017, 0.5])
    about = (field**2 + (np.cos(between) * sun) ** 2) / np.sin(between) ** 2
    expected = np.sqrt(2 * sun**2 + about)
    assert found["predicted_error"]["value"] == pytest.approx(expected, rel=0.002)
    rms = found["rms_error"]
    # Nearly one normal error: the rms of 20 000 scatters by 1/√(2 · 20 000), 0.5 %.
    assert rms["triad_sun_first"] == pytest.approx(expected, rel=0.02)
    swapped = np.sqrt(
        2 * field**2 + (sun**2 + (np.cos(between) * field) ** 2) / np.sin(between) ** 2
    )
    assert rms["triad_field_first"] == pytest.approx(swapped, rel=0.02)
    for name in SOLVERS:
        assert rms[name] == pytest.approx(rms["Davenport"], rel=1e-9)
    for value in found["normalised_error_squared"].values():
        assert value == pytest.approx(3, abs=0.1)
    assert found["largest_difference"]["value"] < 1e-9
    beyond = found["chi_squared_beyond_95_percent"]
    assert beyond["as_stated"] == pytest.approx(0.05, abs=0.006)
    # χ² of nine times the variance: P(9 χ² > 3.84) with one degree of freedom.
    assert beyond["three_times_worse"] == pytest.approx(0.514, abs=0.02)


def test_sentences(read):
    text = read[1]
    assert "makes an angle of **103.4°** with the direction to the Sun" in text
    assert "Trust the Sun: the wrong order costs a factor of 1.39." in text
    assert "gives way by **0.115 %** of the misfit" in text
    assert "comes so near the optimum" in text
    assert "Warning" not in text


def test_sentences_change_with_the_facts(tmp_path):
    record, text = read_chapter(
        "attitude_from_vectors",
        tmp_path,
        time="2026-03-21T22:00",
        sun_error=0.5,
        epochs=1000,
    )
    assert "The satellite is in the Earth's shadow then" in text
    assert "The order hardly matters here: both sensors are as good." in text
    assert "are within" in text
    assert "about the three axes of its error" in text
    assert "is no longer near the optimum" in text
    assert record["results"]["attitude_from_vectors"]["normalised_error_squared"]["optimal"] > 2
    assert [w["message"][:13] for w in record["warnings"]] == ["The satellite", "The two direc"]


def test_sensors_that_change_places(tmp_path):
    record, text = read_chapter(
        "attitude_from_vectors", tmp_path, sun_error=0.5, field_error=0.0, epochs=2000
    )
    assert "Trust the field" in text
    assert "about the field's direction only the Sun tells" in text
    beyond = record["results"]["attitude_from_vectors"]["chi_squared_beyond_95_percent"]
    assert beyond["three_times_worse"] == pytest.approx(0.514, abs=0.06)


def test_where_the_field_is_no_reference_and_errors_are_large(tmp_path):
    record, _ = read_chapter(
        "attitude_from_vectors", tmp_path, height_km=35786.0, field_error=20.0, epochs=200
    )
    assert [w["message"][:18] for w in record["warnings"]] == [
        "Currents in space ",
        "Errors so large ar",
    ]


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"height_km": -7000.0}, "height_km: height is -7000 km — give 0 to 100000 km"),
        ({"latitude": 91.0}, "latitude: latitude is 91° — give -90 to 90°"),
        ({"time": "noon"}, "time: 'noon' is no time"),
        ({"epochs": 3}, "epochs: number of attitudes is 3 — give 100 to 1e+06"),
        ({"sun_error": -1.0}, "sun_error: standard error is -1° — give 0 to 60°"),
    ],
)
def test_nonsense_is_named(tmp_path, parameters, reason):
    status, found = ended("attitude_from_vectors", tmp_path, **parameters)
    assert status == "failed"
    assert reason in found


def test_beyond_the_fields_years(tmp_path):
    status, reason = ended("attitude_from_vectors", tmp_path, time="2040-01-01T00:00")
    assert status == "refused"
    assert "the IGRF holds from 1900 to 2030" in reason
