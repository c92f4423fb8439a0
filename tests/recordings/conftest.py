"""A device folder as a test wants it."""

import numpy as np
import pytest

from sensorbook import Recording

RATE = 100.0
STATIC = """
[[recording]]
sensor = "gyroscope"
kind = "static"
file = "static.csv"
rate = 100.0
unit = "deg/s"
columns = { x = "gx", y = "gy", z = "gz" }
"""


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def samples(rng):
    """(500, 3) noise in deg/s, printed with six digits."""
    return rng.normal(size=(500, 3)).round(6)


@pytest.fixture
def folder(tmp_path, samples):
    """Writes device.toml; `folder(static, head=…)` gives the folder, with static.csv in it."""
    (tmp_path / "device").mkdir()

    def write(recordings: str = STATIC, head: str = 'schema = 1\nid = "imu-1"\n'):
        path = tmp_path / "device"
        (path / "device.toml").write_text(head + recordings, encoding="utf-8")
        if not (path / "static.csv").exists():
            rows = "\n".join(",".join(map(repr, row)) for row in samples.tolist())
            (path / "static.csv").write_text(f"gx,gy,gz\n{rows}\n", encoding="utf-8")
        return path

    return write


def recording(time, values=None, rate=100.0, **more):
    """A static recording; by default each axis reads the time."""
    time = np.asarray(time, dtype=float)
    values = np.column_stack([time] * 3) if values is None else values
    return Recording("gyroscope", "static", "a.csv", time, values, rate=rate, unit="rad/s", **more)
