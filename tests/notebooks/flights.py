"""Small devices that move as stated, each with what a test makes of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

RATE = 25.0
BIAS = np.radians([0.2, -0.1, 0.3])  # rad/s
RANDOM_WALK = np.radians(0.005)  # rad/s/√Hz: a good consumer's gyroscope
REFERENCE_ERROR = np.radians(0.1)  # rad an axis, white
UNITS = {"gyroscope": "rad/s", "accelerometer": "m/s^2", "magnetometer": "uT"}
COLUMNS = {"reference": ("t", "w", "x", "y", "z")}
SENSE = 'quaternion = "body_to_reference"'
# Of yaw, pitch and roll: amplitude (deg), period (s), phase (rad), twice. Pitch stays within ±52°.
SUMS = (
    ((70.0, 19.0, 0.3), (20.0, 6.1, 1.0)),
    ((35.0, 11.0, 2.0), (17.0, 5.3, 0.2)),
    ((40.0, 14.0, 4.0), (20.0, 4.7, 3.0)),
)


def path(time: np.ndarray, slower: float = 1.0) -> Rotation:
    """Body → reference at times (N,), s; `slower` stretches time: yaw, pitch, roll as sums of sines."""
    angles = [
        sum(a * np.sin(2 * np.pi * time / slower / period + phase) for a, period, phase in rows)
        for rows in SUMS
    ]
    return Rotation.from_euler("ZYX", np.stack(angles, axis=1), degrees=True)


@dataclass(frozen=True, eq=False)
class Flight:
    """What sensors that sample at the stamps read: (N, 1 + …) tables, the stamp (s) first."""

    true: Rotation
    tables: dict[str, np.ndarray]

    def only(self, *sensors: str) -> dict[str, np.ndarray]:
        return {sensor: self.tables[sensor].copy() for sensor in sensors}


def flight(seconds: float, seed: int, rate: float = RATE, slower: float = 1.0) -> Flight:
    """A body that turns about one place: SI, but µT."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    true, step = path(time, slower), 1e-3
    turn = path(time - step / 2, slower).inv() * path(time + step / 2, slower)
    read = turn.as_rotvec() / step + BIAS
    read += RANDOM_WALK * np.sqrt(rate) * rng.standard_normal((len(time), 3))
    force = true.inv().apply([0.0, 0.0, -9.8]) + 0.02 * rng.standard_normal((len(time), 3))
    field = true.inv().apply([22.0, 1.0, 42.0]) + 0.3 * rng.standard_normal((len(time), 3))
    reference = measured(rng, true)[:, [3, 0, 1, 2]]
    values = {
        "gyroscope": read, "accelerometer": force, "magnetometer": field, "reference": reference
    }  # fmt: skip
    return Flight(true, {s: np.column_stack([time, v]) for s, v in values.items()})


def measured(rng: np.random.Generator, true: Rotation) -> np.ndarray:
    """(N, 4), scalar last: the true attitude turned by a white error about each body axis."""
    error = REFERENCE_ERROR * rng.standard_normal((len(true), 3))
    return (true * Rotation.from_rotvec(error)).as_quat()


def write(
    folder: Path,
    tables: dict[str, np.ndarray],
    start: str = "",
    sense: str = SENSE,
    runs: Iterable[np.ndarray] = (),
) -> Path:
    """A device with a file a sensor, and one for each of the gyroscope's other `runs`.

    With `start`, a date, stamps are written in ISO 8601 from it on.
    """
    folder.mkdir(parents=True)
    text = f'schema = 1\nid = "{folder.name}"\nname = "{folder.name}"\n'
    files = [(sensor, f"{sensor}.csv", table) for sensor, table in tables.items()]
    files += [("gyroscope", f"run{k}.csv", table) for k, table in enumerate(runs, start=2)]
    for sensor, file, table in files:
        names = COLUMNS.get(sensor, ("t", "x", "y", "z"))
        frame = pd.DataFrame(table, columns=names)
        if start:
            moments = pd.Timestamp(start) + pd.to_timedelta((frame["t"] * 1e6).round(), unit="us")
            frame["t"] = moments.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        frame.to_csv(folder / file, index=False, float_format="%.9g")
        named = ", ".join(f'{"time" if n == "t" else n} = "{n}"' for n in names)
        own = f'unit = "{UNITS[sensor]}"' if sensor in UNITS else sense
        text += (
            f'\n[[recording]]\nsensor = "{sensor}"\nkind = "trajectory"\nfile = "{file}"\n'
            f"columns = {{ {named} }}\n{own}\n"
        )
    (folder / "device.toml").write_text(text)
    return folder
