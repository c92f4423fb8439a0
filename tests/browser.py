"""Opens a page in headless Chromium and tells what it complained of and asked for."""

from __future__ import annotations

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
