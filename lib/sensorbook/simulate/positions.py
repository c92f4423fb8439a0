"""Preset `positions`: an IMU laid down by hand in many attitudes, then levelled on its six faces.

The noise is that of consumer MEMS sensors, the errors follow work B's convention,
``raw = matrix · true + bias (+ g_sensitivity · acceleration)``. Nothing here comes from the solvers.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.earth import EARTH_RATE, STANDARD_GRAVITY, normal_gravity
from sensorbook.simulate.folder import SimulatedDevice
from sensorbook.simulate.motion import attitude, moved
from sensorbook.simulate.noise import coloured_noise

RATE = 100.0
LATITUDE, LONGITUDE, HEIGHT = 39.89, 32.78, 900.0
HAND, LEVELLED = 4.0, 0.2  # deg rms about each axis: laid down by hand, and on a levelled plate
FACES = ((0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0))  # B's table 2
EDGES = tuple(d for d in itertools.product((1, 0, -1), repeat=3) if d.count(0) == 1)
CORNERS = tuple(itertools.product((1, -1), repeat=3))
# Typical of consumer MEMS: N, B in SI (150 µg/√Hz, 40 µg; 0.01 °/s/√Hz, 8 °/h), full scale.
NOISE = {
    "accelerometer": {
        "random_walk": 150e-6 * STANDARD_GRAVITY,
        "bias_instability": 40e-6 * STANDARD_GRAVITY,
        "full_scale": 4 * STANDARD_GRAVITY,
    },
    "gyroscope": {
        "random_walk": np.radians(0.01),
        "bias_instability": np.radians(8 / 3600),
        "full_scale": np.radians(1000),
    },
}

DEVICE = """\
schema = 1
id = "{id}"
name = "{name}, simulated"

[site]
latitude = {latitude}    # deg
longitude = {longitude}   # deg
height = {height}      # m
date = 2024-05-01
"""
_RECORDING = """
[[recording]]
sensor = "{sensor}"
kind = "{kind}"
file = "{kind}.csv"
unit = "{unit}"
columns = {{ time = "t", x = "{p}x", y = "{p}y", z = "{p}z" }}
"""


def draw_errors(rng: np.random.Generator) -> dict[str, dict]:
    """Errors of a device: by sensor `matrix` (3, 3), `bias` (3,) and `g_sensitivity` (3,) or None, SI.

    The accelerometer's matrix is lower triangular: its frame is the device's.
    """

    def either(low: float, high: float, count: int) -> np.ndarray:
        return rng.choice([-1, 1], count) * rng.uniform(low, high, count)

    accelerometer = np.eye(3) + np.diag(either(0.005, 0.025, 3))
    accelerometer[np.tril_indices(3, -1)] = rng.uniform(-0.015, 0.015, 3)
    gyroscope = np.eye(3) + np.diag(either(0.01, 0.02, 3))
    gyroscope[~np.eye(3, dtype=bool)] = rng.uniform(-0.02, 0.02, 6)
    return {
        "accelerometer": {
            "matrix": accelerometer,
            "bias": either(0.05, 0.7, 3),
            "g_sensitivity": None,
        },
        "gyroscope": {
            "matrix": gyroscope,
            "bias": either(np.radians(0.1), np.radians(1.0), 3),
            "g_sensitivity": np.array([0, np.radians(0.05) / STANDARD_GRAVITY, 0]),
        },
    }


def hand_moved(
    rng: np.random.Generator,
    directions: Sequence[Sequence[float]] | None = None,
    levelling: float = HAND,
    *,
    seconds: tuple[float, float] = (4.0, 8.0),
    initial: float = 30.0,
    errors: Mapping[str, dict] | None = None,
    noise: Mapping[str, dict] | None = None,
    gravity: float | None = None,
) -> dict:
    """A recording of a device moved by hand from rest to rest, and its truth.

    Parameters
    ----------
    rng : draws everything that is not given
    directions : (P, 3) body directions that point up, one a rest, in this order; default: the faces,
        the edges and six corners of a cube, shuffled
    levelling : deg, rms error about each axis of a rest's direction; its heading is any
    seconds : shortest and longest rest
    initial : s of rest with z up at the start, 0 for none
    errors : as `draw_errors` gives; default: drawn
    noise : as `NOISE`
    gravity : m/s²; default: normal gravity at the preset's site

    Returns
    -------
    t (N,) s; accelerometer (N, 3) m/s² and gyroscope (N, 3) rad/s as read; true_acceleration and
    true_rate (N, 3); rests, a list of start, end (s) and up (3,), the initial rest first; errors;
    gravity
    """
    if directions is None:
        some = rng.permutation(np.array(CORNERS))[:6]
        directions = rng.permutation(np.concatenate([FACES, EDGES, some]))
    if initial:
        directions = [(0, 0, 1), *directions]
    gravity = normal_gravity(LATITUDE, HEIGHT) if gravity is None else gravity
    errors = draw_errors(rng) if errors is None else errors
    attitudes = []
    for direction in directions:
        tilt = Rotation.from_rotvec(rng.normal(scale=np.radians(levelling), size=3))
        attitudes.append(attitude(tilt.apply(direction), rng.uniform(0, 2 * np.pi)))
    lengths = rng.uniform(*seconds, len(attitudes))
    if initial:
        lengths[0] = initial
    north, up = np.cos(np.radians(LATITUDE)), np.sin(np.radians(LATITUDE))
    motion = moved(rng, attitudes, lengths, RATE, gravity, EARTH_RATE * np.array([0, north, up]))
    true = {"accelerometer": motion.force, "gyroscope": motion.rate}
    read = {
        sensor: _read(rng, true[sensor], motion.force, errors[sensor], (noise or NOISE)[sensor])
        for sensor in true
    }
    rests = [
        {"start": start, "end": end, "up": a.inv().apply([0, 0, 1])}
        for (start, end), a in zip(motion.rests, attitudes, strict=True)
    ]
    return {
        "t": motion.time,
        **read,
        "true_acceleration": motion.force,
        "true_rate": motion.rate,
        "rests": rests,
        "errors": errors,
        "gravity": gravity,
    }


def _read(rng, true: np.ndarray, force: np.ndarray, errors: dict, noise: Mapping) -> np.ndarray:
    """(N, 3) what a sensor with these errors reads: noise added, rounded to 16 bits."""
    raw = true @ np.transpose(errors["matrix"]) + errors["bias"]
    if errors["g_sensitivity"] is not None:
        raw += force * errors["g_sensitivity"]
    white, flicker = noise["random_walk"], noise["bias_instability"]
    raw += white * np.sqrt(RATE) * rng.standard_normal(raw.shape)
    for column in raw.T:
        slow = coloured_noise(len(raw), RATE, rng, random_walk=0.0, bias_instability=flicker)
        column += slow - slow.mean()  # the bias is what the sensor has on the recording's average
    step = noise["full_scale"] / 2**15
    return np.clip(np.rint(raw / step), -(2**15), 2**15 - 1) * step


def truth_of(made: Mapping[str, dict]) -> dict:
    """What truth.json holds, of recordings by name from one device: SI, raw = matrix · true + bias."""
    first = next(iter(made.values()))
    return {
        "calibration": {
            sensor: {k: None if v is None else np.asarray(v).tolist() for k, v in known.items()}
            | {"gravity": first["gravity"]}
            for sensor, known in first["errors"].items()
        },
        "gravity": first["gravity"],
        "rests": {
            name: [rest | {"up": rest["up"].tolist()} for rest in one["rests"]]
            for name, one in made.items()
        },
    }


def build(rng: np.random.Generator, identifier: str) -> SimulatedDevice:
    """Draws the device's recordings and its truth."""
    errors = draw_errors(rng)
    made = {
        "positions": hand_moved(rng, errors=errors),
        "six_position": hand_moved(
            rng, FACES, LEVELLED, seconds=(15.0, 15.0), initial=0.0, errors=errors
        ),
    }
    # Six digits after the point are less than a hundredth of a count.
    tables = {
        f"{kind}.csv": {"t": np.round(one["t"], 2)}
        | {f"a{axis}": one["accelerometer"][:, k].round(6) for k, axis in enumerate("xyz")}
        | {f"g{axis}": np.degrees(one["gyroscope"][:, k]).round(5) for k, axis in enumerate("xyz")}
        for kind, one in made.items()
    }
    toml = DEVICE.format(
        id=identifier, name="Hand-moved IMU", latitude=LATITUDE, longitude=LONGITUDE, height=HEIGHT
    )
    for sensor, kind, unit in (
        ("accelerometer", "positions", "m/s^2"),
        ("gyroscope", "positions", "deg/s"),
        ("accelerometer", "six_position", "m/s^2"),
    ):
        toml += _RECORDING.format(sensor=sensor, kind=kind, unit=unit, p=sensor[0])
    return SimulatedDevice(toml, tables, truth_of(made))
