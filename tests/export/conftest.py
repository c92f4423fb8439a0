"""What the tests of several targets need."""

import json

import pytest

from sensorbook.export import export


@pytest.fixture
def exported(request, tmp_path):
    """Writes the test file's own `results()`, which a function may change first, and exports them."""

    def run(name, change=lambda r: None):
        found = request.module.results()
        change(found)
        (tmp_path / "results.json").write_text(json.dumps(found))
        return export(tmp_path / "results.json", name)

    return run
