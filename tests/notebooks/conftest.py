"""The demo device, simulated and rendered once."""

from __future__ import annotations

from pathlib import Path

import pytest
from devices import Report, render

from sensorbook.simulate import simulate


@pytest.fixture(scope="session")
def demo_folder(tmp_path_factory) -> Path:
    """The demo as `make report` has it, beside a folder of notebooks."""
    return simulate(tmp_path_factory.mktemp("workbook") / "data" / "ahrs-demo")


@pytest.fixture(scope="session")
def demo(demo_folder) -> Report:
    return render(demo_folder, demo_folder.parents[1] / "reports")
