"""A browser opens the pages from a file share: it complains of nothing and asks the network nothing."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Opened

from sensorbook.cli import main
from sensorbook.reporting import chapters

sys.path.insert(0, str(Path(__file__).parent / "reporting"))
from throwaway import FIGURE, LOAD, NASTY, NOISE, chapter, run, write_device, write_notebook

REVERSED = " \u202egnp.exe\u2066"  # reads backwards from here on
FILE = '"><img src=1.png onerror=alert(1)><script>alert(1)<script> {{7-7}} $a$.csv'
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
    device = write_device(folder / "d", "dev-1", [("gyroscope", "static")], NASTY + REVERSED)
    declaration = device / "device.toml"
    text = declaration.read_text(encoding="utf-8")
    more = f"model = '''{NASTY}'''\nserial = '''{NASTY + REVERSED}'''\n"
    text = text.replace("\n[[recording]]", more + "\n[[recording]]", 1)
    text = text.replace("data.csv", FILE).replace('file = "', "file = '").replace('.csv"', ".csv'")
    declaration.write_text(text, encoding="utf-8")
    (device / "data.csv").rename(device / FILE)
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
    assert_inert(opened.dom)


def assert_inert(dom: str) -> None:
    """What the input's words would become if they were taken for HTML, for a template or for order."""
    assert re.search(r"{{7[*-]7}}", dom)
    assert not re.search(r"<img [^>]*(1\.png|onerror)|<script>alert|<a [^>]*evil", dom)
    assert not re.search("[\u202a-\u202e\u2066-\u2069]", dom)


def test_a_bare_log_with_nasty_columns(tmp_path):
    """The index shows the guesses, hence the columns' names; the noise chapters the file's."""
    nasty = f"{FILE[:-4]} ]]> [l](http:evil){REVERSED}"
    values = np.random.default_rng(4).normal(size=(1200, 3))  # 1000 are the least for a chapter
    table = np.column_stack([np.arange(1200) / 20, 0.02 * values])
    header = ",".join(["time <b>", *(f"gyro_{axis} {nasty}" for axis in "xyz")])
    log = tmp_path / FILE
    np.savetxt(log, table, "%.6g", ",", header=header, comments="", encoding="utf-8")
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(["report", str(log), "--out", str(tmp_path / "out"), "--only", "allan"])
    assert code == 0, said.getvalue()
    pages = sorted(tmp_path.glob("out/**/*.html"))
    assert [p.name for p in pages] == ["allan.html", "index.html", "index.html"]
    for page in pages:
        opened = Opened(page, tmp_path)
        assert (opened.console, opened.requests) == ([], set()), page
        assert_inert(opened.dom)
    shown = pages[1].read_text(encoding="utf-8")
    assert "gyro_x" in shown
    assert "\ufffdgnp.exe\ufffd" in shown


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
