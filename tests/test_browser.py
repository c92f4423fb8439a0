"""A browser opens the pages from a file share: it complains of nothing and asks the network nothing."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from browser import CHROMIUM, Opened

from sensorbook.reporting import chapters

sys.path.insert(0, str(Path(__file__).parent / "reporting"))
from throwaway import FIGURE, LOAD, NASTY, NOISE, chapter, run, write_device, write_notebook

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    notebook = write_notebook(
        folder / "n.ipynb",
        "# Noise\n\nIt is $\\sigma^2(\\tau) = \\frac{N^2}{\\tau}$.",
        LOAD.replace("KIND", '"static"'),
        "say('Of {name}', name=book.name)",
        NOISE,
        FIGURE,
    )
    device = write_device(folder / "d", "dev-1", [("gyroscope", "static")], NASTY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chapters, "CHAPTERS", (chapter("allan", notebook),))
        done = run([device], folder / "out")
    assert done.code == 0, done.stderr
    return done.out


@pytest.mark.parametrize("page", ["index.html", "dev-1/index.html", "dev-1/gyroscope/allan.html"])
def test_a_page_opens_silently_and_alone(reports, tmp_path, page):
    opened = Opened(reports / page, tmp_path)
    assert "dev-1" in opened.dom
    assert opened.console == []
    assert opened.requests == set()


def test_the_detector_can_fail(tmp_path):
    """A page with a fault and an outside reference shows both, or the tests above prove nothing."""
    page = tmp_path / "page.html"
    page.write_text('<img src="http://127.0.0.1:9/x.png"><script>console.error("oh")</script>')
    opened = Opened(page, tmp_path)
    assert any("oh" in line for line in opened.console)
    assert "http://127.0.0.1:9/x.png" in opened.requests


def test_the_policy_stops_what_would_slip_through(reports, tmp_path):
    """The pages' own policy, with a script and an image put in: neither runs nor loads."""
    html = (reports / "dev-1" / "gyroscope" / "allan.html").read_text(encoding="utf-8")
    spoilt = '<img src="http://127.0.0.1:9/x.png"><script>document.title = "ran"</script></body>'
    page = tmp_path / "page.html"
    page.write_text(html.replace("</body>", spoilt), encoding="utf-8")
    opened = Opened(page, tmp_path)
    assert "<title>ran" not in opened.dom
    assert opened.requests == set()
    assert json.dumps(opened.console).count("Content Security Policy") >= 1
