"""Preset `phone`: work B's sensor, as a phone's recorder writes it (layout: data/README.md).

The errors have B's magnitudes (B6): scales near 0.98, 0.97 and 0.99, biases near 0.05, 0.36 and
0.67 m/s². The noise leaves an error of 0.08 m/s² on ‖a‖ of single samples, as B found.
"""

from __future__ import annotations

import numpy as np

from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.simulate.folder import SimulatedDevice
from sensorbook.simulate.positions import (
    CORNERS,
    DEVICE,
    EDGES,
    FACES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    RATE,
    hand_moved,
    truth_of,
)

ERRORS = {
    "accelerometer": {
        "matrix": np.array([[0.98, 0, 0], [0.006, 0.97, 0], [-0.004, 0.009, 0.99]]),
        "bias": np.array([0.05, 0.36, 0.67]),
        "g_sensitivity": None,
    },
    "gyroscope": {
        "matrix": np.array(
            [[1.012, 0.008, -0.006], [-0.011, 0.991, 0.005], [0.004, -0.007, 1.009]]
        ),
        "bias": np.array([0.004, -0.007, 0.002]),
        "g_sensitivity": None,
    },
}
NOISE = {
    "accelerometer": {
        "random_walk": 0.008,  # m/s²/√Hz: 0.08 m/s² a sample at 100 Hz
        "bias_instability": 0.001,
        "full_scale": 8 * STANDARD_GRAVITY,
    },
    "gyroscope": {
        "random_walk": np.radians(0.02),
        "bias_instability": np.radians(15 / 3600),
        "full_scale": np.radians(1000),
    },
}
HAND, TABLE = 5.0, 1.0  # deg rms about each axis: a phone leans on books, and its edges are round
JITTER = 0.4  # ms rms, of a stamp
BEGAN = 1_714_550_400_000  # ms since 1970: 2024-05-01 08:00 UTC
_RECORDING = """
[[recording]]
sensor = "{sensor}"
kind = "{kind}"
file = "{file}.db"
table = "{sensor}"
unit = "{unit}"
columns = {{ time = "timestamp", x = "x", y = "y", z = "z" }}
time_unit = "ms"
"""
_CHECK = "check = true                     # kept out of the fit, used to check it\n"


def recorder(
    rng: np.random.Generator, made: dict, began: int = BEGAN
) -> dict[str, dict[str, np.ndarray]]:
    """The tables of one recording: accelerometer (m/s²) and gyroscope (rad/s) at 100 Hz, gnss at 1 Hz.

    Each has stamps of its own, in ms since 1970, that jitter by less than half an interval.
    """
    samples = len(made["t"])
    tables = {}
    for sensor in ("accelerometer", "gyroscope"):
        late = np.clip(rng.normal(scale=JITTER, size=samples), -3, 3)
        stamps = began + np.rint(1000 * made["t"] + late).astype(np.int64)
        columns = {axis: made[sensor][:, k].round(6) for k, axis in enumerate("xyz")}
        tables[sensor] = {"timestamp": stamps} | columns
    fixes = samples // int(RATE)
    wander = rng.normal(scale=[2e-5, 2e-5, 3.0], size=(fixes, 3))  # deg, deg, m
    place = np.array([LATITUDE, LONGITUDE, HEIGHT]) + wander
    tables["gnss"] = {
        "timestamp": began + 1000 * np.arange(fixes) + rng.integers(0, 60, fixes),
        "latitude": place[:, 0].round(7),
        "longitude": place[:, 1].round(7),
        "height": place[:, 2].round(1),
        "accuracy": rng.uniform(3, 8, fixes).round(1),
    }
    return tables


def build(rng: np.random.Generator, identifier: str) -> SimulatedDevice:
    """Draws the phone's recordings; its errors are the same with every seed."""
    known = {"errors": ERRORS, "noise": NOISE}

    def positions() -> dict:
        corners = rng.permutation(np.array(CORNERS))[:4]  # with the initial rest, B's 23 positions
        return hand_moved(rng, rng.permutation([*FACES, *EDGES, *corners]), HAND, **known)

    made = {
        "six_position": hand_moved(rng, FACES, TABLE, seconds=(15.0, 15.0), initial=0.0, **known),
        "positions": positions(),
        "check": positions(),
    }
    databases = {
        f"{name}.db": recorder(rng, one, BEGAN + 600_000 * k)
        for k, (name, one) in enumerate(made.items())
    }
    fixes = np.stack(
        [databases["positions.db"]["gnss"][k] for k in ("latitude", "longitude", "height")]
    )
    latitude, longitude, height = np.median(fixes, axis=1)
    toml = DEVICE.format(
        id=identifier,
        name="Phone (work B)",
        latitude=round(latitude, 5),
        longitude=round(longitude, 5),
        height=round(height, 1),
    )
    for sensor, kind, file, unit in (
        ("accelerometer", "six_position", "six_position", "m/s^2"),
        ("accelerometer", "positions", "positions", "m/s^2"),
        ("gyroscope", "positions", "positions", "rad/s"),
        ("accelerometer", "positions", "check", "m/s^2"),
        ("gyroscope", "positions", "check", "rad/s"),
    ):
        toml += _RECORDING.format(sensor=sensor, kind=kind, file=file, unit=unit)
        toml += _CHECK if file == "check" else ""
    return SimulatedDevice(toml, databases, truth_of(made))
