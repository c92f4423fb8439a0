"""The chapters that need no device, as the book renders them."""

from __future__ import annotations

import io
import json
import re

import pytest

from sensorbook.reporting import chapters
from sensorbook.reporting.book import book

ALONE = tuple(chapter for chapter in chapters.CHAPTERS if not chapter.needs_device)


@pytest.fixture(scope="module")
def bound(tmp_path_factory):
    """The folder of a book of these chapters alone."""
    out = tmp_path_factory.mktemp("book")
    stdout, stderr = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chapters, "CHAPTERS", ALONE)
        code = book([], str(out), jobs=2, stdout=stdout, stderr=stderr)
    assert (code, stderr.getvalue()) == (0, "")
    return out / "book"


def test_no_device_feeds_them():
    assert [chapter.slug for chapter in ALONE] == [
        "sensor_principles",
        "representations",
        "attitude_sensors",
        "attitude_from_vectors",
        "camera_accuracy",
        "camera_scene",
        "star_camera",
        "propagation",
        "aided_attitude",
    ]
    assert {(chapter.sensors, chapter.needs, chapter.result) for chapter in ALONE} == {((), (), "")}


@pytest.mark.parametrize("chapter", ALONE, ids=lambda c: c.slug)
def test_each_is_complete_and_records_something(bound, chapter):
    record = json.loads((bound / f"{chapter.slug}.json").read_text(encoding="utf-8"))
    assert (record["status"], record["reason"]) == ("complete", None)
    assert record["results"]
    assert (record["device"], record["sensor"]) == (None, None)
    page = (bound / f"{chapter.slug}.html").read_text(encoding="utf-8")
    assert f"<h1>{chapter.title}</h1>" in page
    assert len(page) < 3_000_000
    assert set(re.findall('mathvariant="(.*?)"', page)) <= {"normal"}, "browsers know no other"
    assert f"<code>notebooks/{chapter.notebook.name}</code>, which <code>make lab</code>" in page
    assert not re.search(r"https?://|src=\"//|url\(|<script", page)
    assert all('alt="' in tag for tag in re.findall(r"<img[^>]*>", page))
