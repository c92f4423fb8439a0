"""The page of all devices over many results: time and size, beside the goals.

    python benchmarks/group_page.py [--devices 10000] [--seed 1]

Goals: 10 000 devices in 60 s and 5 MB. No peer makes such a page; reading the files alone, with the
standard library, is printed as the least that any could take.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "reporting"))
from trees import write_tree

from sensorbook.reporting.group import group_page

NUMBERS = 1000  # of curves a sensor: files as large as those of a real report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--devices", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve()
        write_tree(root, options.devices, np.random.default_rng(options.seed), padding=NUMBERS)
        size = sum(f.stat().st_size for f in root.glob("*/results.json")) / options.devices
        start = time.perf_counter()
        for file in root.glob("*/results.json"):
            json.loads(file.read_bytes())
        least = time.perf_counter() - start
        start = time.perf_counter()
        page = group_page(root)
        seconds = time.perf_counter() - start
    share = options.devices / 10_000
    print(f"{options.devices} devices, {size / 1e3:.0f} kB each")
    print(f"  time   {seconds:6.1f} s   goal {60 * share:g} s   reading alone {least:.1f} s")
    print(f"  size   {len(page.encode()) / 1e6:6.2f} MB  goal {5 * share:g} MB")


if __name__ == "__main__":
    main()
