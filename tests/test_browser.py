"""A browser opens the pages from a file share: it complains of nothing and asks the network nothing."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sensorbook.reporting import chapters

sys.path.insert(0, str(Path(__file__).parent / "reporting"))
from throwaway import FIGURE, LOAD, NASTY, NOISE, chapter, run, write_device, write_notebook

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-component-update",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-dev-shm-usage",
    "--enable-logging=stderr",
    "--v=0",
    "--virtual-time-budget=2000",
]


class Opened:
    """What a browser made of a page: its DOM, its console, and the addresses it asked for."""

    def __init__(self, page: Path, folder: Path):
        log = folder / "net.json"
        done = subprocess.run(
            [
                CHROMIUM,
                *FLAGS,
                f"--user-data-dir={folder / 'profile'}",
                f"--log-net-log={log}",
                "--dump-dom",
                page.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        self.dom = done.stdout
        self.console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
        addresses = re.findall(
            r'"url":"([^"]*)"', log.read_text(encoding="utf-8", errors="replace")
        )
        self.requests = {
            address
            for address in addresses
            if re.match(r"(https?|wss?|ftp)://", address) and not ours(address)
        }


def ours(address: str) -> bool:
    """Chromium's own calls home, which no flag turns off in every version."""
    return bool(
        re.match(r"https?://([a-z0-9-]+\.)*(google|googleapis|gvt1|gstatic)\.com[/:]", address)
    )


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
