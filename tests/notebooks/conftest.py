"""The demo devices, simulated and rendered once."""

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
def moved_folder(demo_folder) -> Path:
    """The hand-moved demo, beside the other."""
    return simulate(demo_folder.with_name("positions-demo"), "positions")


@pytest.fixture(scope="session")
def moved(moved_folder) -> Report:
    return render(moved_folder, moved_folder.parents[1] / "reports")


@pytest.fixture(scope="session")
def turned_folder(demo_folder) -> Path:
    """The hand-turned compass."""
    return simulate(demo_folder.with_name("rotation-demo"), "rotation")


@pytest.fixture(scope="session")
def turned(turned_folder) -> Report:
    return render(turned_folder, turned_folder.parents[1] / "reports")


@pytest.fixture(scope="session")
def orbiting_folder(demo_folder) -> Path:
    """Work C's cameras in low orbit."""
    return simulate(demo_folder.with_name("leo-demo"), "leo")


@pytest.fixture(scope="session")
def phone_folder(demo_folder) -> Path:
    """Work B's phone."""
    return simulate(demo_folder.with_name("phone-demo"), "phone")


@pytest.fixture(scope="session")
def phone(phone_folder) -> Report:
    return render(phone_folder, phone_folder.parents[1] / "reports")


@pytest.fixture(scope="session")
def demo(demo_folder) -> Report:
    return render(demo_folder, demo_folder.parents[1] / "reports")


@pytest.fixture(scope="session")
def flown_folder(demo_folder) -> Path:
    """Work C's gyroscope beside its reference."""
    return simulate(demo_folder.with_name("trajectory-demo"), "trajectory")


@pytest.fixture(scope="session")
def flown(flown_folder) -> Report:
    """With the noise chapter, whose record it takes."""
    return render(flown_folder, flown_folder.parents[1] / "reports", "noise", "integrated_attitude")
