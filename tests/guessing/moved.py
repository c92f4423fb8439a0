"""Recordings of a simulated IMU with magnetometer, by rigid-body kinematics alone."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0, 0, 9.80665])  # m/s², specific force at rest, east-north-up
FIELD = np.array([1.0, 22.0, -41.0]) * 1e-6  # T, about 47 µT dipping north


@dataclass
class Moved:
    """(N, 3) true readings in SI units at `rate` (Hz), and the attitude body → reference."""

    rate: float
    gyroscope: np.ndarray
    accelerometer: np.ndarray
    magnetometer: np.ndarray
    attitude: Rotation


def moved(kind: str, seconds: float, rate: float, rng) -> Moved:
    """A sensor at rest ("static"), between rests ("positions"), or in free motion ("trajectory")."""
    time = np.arange(round(seconds * rate)) / rate
    if kind == "static":
        attitude = Rotation.from_rotvec(np.tile(rng.uniform(-0.3, 0.3, 3), (len(time), 1)))
    elif kind == "positions":
        attitude = _between_rests(time, rng)
    else:
        knots = np.arange(0, seconds + 2, 1.5)
        angles = CubicSpline(knots, rng.uniform(-np.pi, np.pi, (len(knots), 3)) * [1, 0.45, 1])
        attitude = Rotation.from_euler("ZYX", angles(time))
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * rate
    down = attitude.inv()
    return Moved(
        rate,
        np.vstack([turn, turn[-1:]]) + rng.normal(scale=1e-3, size=(len(time), 3))
        + np.radians(rng.uniform(-0.5, 0.5, 3)),
        down.apply(GRAVITY) + rng.normal(scale=0.02, size=(len(time), 3)) + 0.02,
        down.apply(FIELD) + rng.normal(scale=1e-7, size=(len(time), 3)),
        attitude,
    )  # fmt: skip


def _between_rests(time, rng):
    """Rests of 3 s and turns of 1 s, from one attitude to another at random."""
    count = int(time[-1] // 4) + 2
    stations = Rotation.random(count, random_state=np.random.RandomState(rng.integers(2**31)))
    station = np.minimum((time // 4).astype(int), count - 2)
    part = np.clip(time % 4 - 3, 0, 1)
    part = part**2 * (3 - 2 * part)  # starts and ends at rest
    step = (stations[:-1].inv() * stations[1:]).as_rotvec()
    return stations[station] * Rotation.from_rotvec(step[station] * part[:, None])
