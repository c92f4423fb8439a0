"""Pages serve everyone: no serious finding of axe-core, nothing wider than a telephone, paper that fits."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path

import pytest
from browser import AXE, CHROMIUM, PANES, examine, sheets

from sensorbook.cli import main

sys.path.insert(0, str(Path(__file__).parent / "notebooks"))
from devices import rest, sweep, write

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
PAGES = {
    "device": "good/index.html",
    "chapter": "good/gyroscope/thermal.html",
    "refused": "short/gyroscope/allan.html",
    "group": "index.html",
}


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> Path:
    """Two devices: one with a thermal chapter, one whose rest of 500 samples tells nothing."""
    folder = tmp_path_factory.mktemp("accessibility")
    devices = [
        write(folder / "good", thermal=sweep(20, 40)),
        write(folder / "short", static=rest(seconds=25.0)),
    ]
    with (folder / "good" / "device.toml").open("a") as declaration:
        declaration.write('[spec.gyroscope]\nrandom_walk = { max = 0.3, unit = "deg/sqrt(h)" }\n')
    with contextlib.redirect_stdout(io.StringIO()):
        main(
            [
                "report",
                *map(str, devices),
                "--out",
                str(folder / "out"),
                "--only",
                "thermal",
                "allan",
            ]
        )
    return folder / "out"


@pytest.fixture(scope="module", params=PAGES)
def examined(request, reports, tmp_path_factory) -> dict[str, dict]:
    page = reports / PAGES[request.param]
    if request.param == "refused":
        assert "No result: the recording cannot determine it." in page.read_text(encoding="utf-8")
    return examine(page, tmp_path_factory.mktemp(request.param))


@pytest.mark.skipif(not AXE.exists(), reason="no axe-core: npm install --prefix tests")
def test_no_serious_violation(examined):
    assert len(examined) == len(PANES)
    for pane, seen in examined.items():
        assert [v for v in seen["violations"] if v["impact"] in ("serious", "critical")] == [], pane


def test_nothing_is_wider_than_the_page(examined):
    for pane, seen in examined.items():
        assert seen["scroll"] <= seen["client"], (pane, seen["wide"])
        assert seen["wide"] == [], pane


def test_the_index_is_one_sheet(reports, tmp_path):
    assert sheets(reports / PAGES["device"], tmp_path) == 1
    assert sheets(reports / PAGES["chapter"], tmp_path) > 1  # or the count shows nothing


def test_what_is_planted_is_found(tmp_path):
    """Faint text, faint in the dark only, an image without words, and a wide box."""
    page = tmp_path / "page.html"
    page.write_text(
        '<!DOCTYPE html><html lang="en"><title>t</title><style>b { color: #eee; background: #fff; }'
        "@media (prefers-color-scheme: dark) { i { color: #111; background: #000; } }</style><body>"
        '<main><h1>t</h1><b>faint</b> <i>dark</i> <img src="data:,">'
        '<p style="width: 1500px">wide</p></main></body></html>'
    )
    found = examine(page, tmp_path)
    assert found["390 light"]["client"] <= 390 < 1500 <= found["390 light"]["scroll"]
    assert len(found["1280 light"]["wide"]) == 1
    if AXE.exists():
        for pane, seen in found.items():
            places = {v["id"]: v["places"] for v in seen["violations"]}
            assert places["image-alt"] == ['<img src="data:,">'], pane
            faint = ["<b>faint</b>", "<i>dark</i>"] if pane.endswith("dark") else ["<b>faint</b>"]
            assert places["color-contrast"] == faint, pane
