"""Fixtures all tests share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings by others, which the repository never holds."""
    folder = Path(os.environ.get("SENSORBOOK_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real recordings in {folder}: set SENSORBOOK_REAL_DATA to their folder")
    return folder
