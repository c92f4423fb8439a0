"""The chapter on the star camera: its numbers, and sentences that follow its parameters."""

from pathlib import Path

import nbformat
import numpy as np
import pytest
from devices import ended, read_chapter

from sensorbook.camera.star_identify import CROWDED, NONE, SHORT
from sensorbook.camera.stars import MISFIT
from sensorbook.errors import InputError

BOOK = Path(__file__).parents[2] / "notebooks" / "17_star_camera.ipynb"

SMALL = {"pixels": 512, "images": 20}


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("star_camera", tmp_path_factory.mktemp("chapter"))


def test_numbers(read):
    found = read[0]["results"]["star_camera"]
    assert found["image"]["status"] == "ok"
    assert found["image"]["named"] >= 4
    assert found["image"]["false_solutions_expected"] < 1e-6
    runs = found["study"]
    assert runs["solved"] == runs["images"] == 40
    assert runs["wrong"] == 0
    # 49″ a pixel and some 0.1 pixels a star, twenty stars; the roll as the field's half-width is narrow.
    assert 0.1 < 3600 * np.degrees(runs["across_rms"]) < 1
    assert 1 < 3600 * np.degrees(runs["roll_rms"]) < 12
    assert runs["normalised_error_squared"] == pytest.approx(3, abs=1.6)  # four times √(6/40)
    assert found["stars_in_view"]["mean"] == pytest.approx(20.3, abs=0.5)
    # Twelve images of clouds and night: anywhere from a thousandth to some hundredths of a degree.
    assert 0.001 < np.degrees(found["horizon_camera_rms"]["value"]) < 0.2
    assert found["horizon_camera_rms"]["value"] > 10 * runs["across_rms"]
    failed = found["what_fails"]
    assert found["horizon_camera_rms"]["images"] == 12
    assert failed["nothing changed"] == failed["10 false stars"] == "ok"
    assert failed["a catalogue known to 20″"] == "ok"
    assert failed["200 false stars"] == f"no solution: {CROWDED}"
    assert failed["a catalogue of 2 stars a field"] == f"no solution: {SHORT}"
    # Four false stars do not turn with the sky: four spots, and none in the catalogue.
    assert failed["a turn of 30 pixels"] == f"no solution: {NONE}"
    assert failed["a focal length wrong by 0.1 %"] == f"no solution: {MISFIT}"


def test_sentences(read):
    record, text = read
    assert "with **49.5″** a pixel; work C's camera, 120° across at 369.5 pixels, has 558″" in text
    assert "**40** are solved and none of the solutions is wrong" in text
    assert "the covariance is honest" in text
    assert "None of the solutions is wrong" in text
    assert "all stars are within 9.9° of the axis" in text
    assert "from magnitude **5.4** on, 2,125 stars" in text
    assert "14 49.5 2,125 5.4" in " ".join(text.split())
    assert "no more than chance makes of one" in text
    assert record["warnings"] == []


def test_a_short_catalogue_says_so(tmp_path):
    record, text = read_chapter("star_camera", tmp_path, catalogue_magnitude=2.0, **SMALL)
    assert f"This image has no solution: {SHORT}" in text
    assert "Without names there is no attitude" in text
    assert "**0** are solved" in text
    assert f"20 × no solution: {SHORT}" in text
    found = record["results"]["star_camera"]
    assert found["study"] == {"images": 20, "solved": 0, "wrong": 0}
    assert found["image"]["false_solutions_expected"] is None
    assert len(record["warnings"]) == 1


def test_a_fast_turn_says_so(tmp_path):
    _, text = read_chapter("star_camera", tmp_path, turn_pixels=40.0, false_stars=0, **SMALL)
    assert "Fewer than four spots may be stars: there is nothing to compare" in text
    assert "This image has no solution: fewer than 4 stars" in text


def test_moon_in_view(tmp_path):
    record, text = read_chapter(
        "star_camera", tmp_path, moon="yes", false_stars=0, hot_pixels=0, **SMALL
    )
    assert "1 too large" in text
    assert record["results"]["star_camera"]["image"]["status"] == "ok"


def test_an_empty_image(tmp_path):
    """A narrow field and a sky of a few bright stars: no spot at all in most images."""
    record, text = read_chapter(
        "star_camera", tmp_path, field_deg=2.0, sky_magnitude=0.0, catalogue_magnitude=0.0,
        false_stars=0, hot_pixels=0, **SMALL,
    )  # fmt: skip
    assert "Of 0 spots **0** may be stars; rejected: none" in text
    assert "there is nothing to measure" in text
    assert record["results"]["star_camera"]["study"]["solved"] == 0


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"field_deg": 90.0}, "field_deg: field is 90° — give 1 to 40°"),
        ({"moon": "maybe"}, "moon: is 'maybe' — give one of no, yes"),
        ({"images": 3}, "images: number of images is 3 — give a whole number, 20 to 1000"),
        (
            {"sky_magnitude": 5.0},
            "catalogue_magnitude: magnitude is 6, fainter than the sky's faintest star, 5 — "
            "give sky_magnitude or less",
        ),
        ({"turn_pixels": -1.0}, "turn_pixels: turn is -1 pixels — give 0 to 200 pixels"),
    ],
)
def test_nonsense_is_named(tmp_path, parameters, reason):
    status, found = ended("star_camera", tmp_path, **parameters)
    assert status == "failed"
    assert reason in found


@pytest.mark.parametrize("name", ["pixels", "false_stars", "hot_pixels", "images", "seed"])
def test_counts_are_whole_numbers_in_jupyter_too(name):
    """Where a report is made, a number with decimals is refused before."""
    cells = nbformat.read(BOOK, as_version=4).cells
    given = {}
    exec(next(c.source for c in cells if "parameters" in c.metadata.get("tags", [])), given)
    checks = next(c.source for c in cells if "check((" in c.source)
    exec(checks, dict(given))
    with pytest.raises(InputError, match=f"{name}: .* is {given[name]}.5 — give a whole number"):
        exec(checks, given | {name: given[name] + 0.5})


def test_a_catalogue_too_long_is_refused(tmp_path):
    status, reason = ended(
        "star_camera", tmp_path, field_deg=40.0, sky_magnitude=8.0, catalogue_magnitude=8.0
    )
    assert status == "refused"
    assert "pairs in the field, more than a table holds" in reason
