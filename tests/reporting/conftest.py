import pytest

from sensorbook.reporting import chapters


@pytest.fixture(scope="module")
def table():
    """Sets the table of chapters for the tests of a module."""
    patch = pytest.MonkeyPatch()
    yield lambda *rows: patch.setattr(chapters, "CHAPTERS", rows)
    patch.undo()
