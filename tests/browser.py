"""Opens a page in headless Chromium and tells what it complained of, asked for and looks like."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
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

# tests/package.json names its version; .ci/run installs it.
AXE = Path(__file__).with_name("node_modules") / "axe-core" / "axe.min.js"
DARK = "@media (prefers-color-scheme: dark)"
PANES = [(width, light) for width in (390, 1280) for light in ("light", "dark")]
EXAMINE = """
addEventListener("load", async () => {
  const found = {};
  for (const pane of document.querySelectorAll("iframe")) {
    const inner = pane.contentWindow, root = inner.document.documentElement;
    const scrolls = (e) =>
      e && (inner.getComputedStyle(e).overflowX != "visible" || scrolls(e.parentElement));
    const wide = [...inner.document.body.querySelectorAll("*")].filter(
      (e) => e.getBoundingClientRect().right > root.clientWidth + 1 && !scrolls(e.parentElement));
    const seen = {scroll: root.scrollWidth, client: root.clientWidth, violations: [],
      wide: wide.slice(0, 5).map((e) => e.outerHTML.slice(0, 100))};
    if (inner.axe) {
      const {violations} = await inner.axe.run(inner.document, {resultTypes: ["violations"]});
      seen.violations = violations.map(
        (v) => ({impact: v.impact, id: v.id, places: v.nodes.map((n) => n.html.slice(0, 200))}));
    }
    found[pane.title] = seen;
  }
  const shown = document.createElement("pre");
  shown.id = "found";
  shown.textContent = JSON.stringify(found);
  document.body.replaceChildren(shown);
});
"""


def examine(page: Path, folder: Path, panes=PANES) -> dict[str, dict]:
    """How a page stands in a telephone's and a desk's width, light and dark: its own width beside the
    window's (CSS pixels), what reaches beyond it, and what axe-core finds where it is installed.

    A window is never narrower than 500 pixels, hence the frames. The copy in them goes without the
    page's policy, which would keep axe-core out.
    """
    text = page.read_text(encoding="utf-8")
    text, found = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    assert found <= 1
    if AXE.exists():
        text = f"<script>{AXE.read_text(encoding='utf-8')}</script>".join(text.rsplit("</body>", 1))
    frames = []
    for width, light in panes:
        shown = text.replace(DARK, "@media all") if light == "dark" else text
        frames.append(
            f'<iframe title="{width} {light}" width="{width}" height="900" style="border: 0" '
            f'srcdoc="{html.escape(shown)}"></iframe>'
        )
    around = folder / "examine.html"
    around.write_text(
        f'<!DOCTYPE html><meta charset="utf-8"><body><script>{EXAMINE}</script>{"".join(frames)}',
        encoding="utf-8",
    )
    dom = Opened(around, folder).dom
    return json.loads(html.unescape(re.search(r'<pre id="found">(.*?)</pre>', dom, re.DOTALL)[1]))


def sheets(page: Path, folder: Path) -> int:
    """On how many sheets of paper the browser prints a page; leaves `printed.pdf` in the folder."""
    pdf = folder / "printed.pdf"
    flags = [
        f"--user-data-dir={folder / 'profile'}",
        "--no-pdf-header-footer",
        f"--print-to-pdf={pdf}",
    ]
    subprocess.run(
        [CHROMIUM, *FLAGS, *flags, page.as_uri()], capture_output=True, timeout=120, check=True
    )
    return len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))


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
