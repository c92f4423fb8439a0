"""Preset `ahrs`: work A's robotics-grade AHRS, at rest and through a temperature sweep.

The noise terms are those of A's tables 7.1 and 7.3 (Allan columns), the bandwidth its 20 Hz; the
thermal curves are smooth, with the jump that A found at 24–25 °C on accelerometer Z and gyroscope X
and Y. A prints no thermal figures: their sizes are typical of the class.
"""

from __future__ import annotations

import numpy as np

from sensorbook.simulate.folder import SimulatedDevice
from sensorbook.simulate.noise import coloured_noise

RATE, HOURS, BANDWIDTH = 100.0, 2.0, 20.0
SWEEP_RATE, SWEEP_SECONDS = 10.0, 6000.0
REST_TEMPERATURE = 31.0  # °C, settled
STANDARD_GRAVITY = 9.80665

DEGREE = np.pi / 180
# A's tables as printed: N, B, K per axis, then the factor of each to SI.
PUBLISHED = {
    "gyroscope": {
        "table": "A 7.3",
        "units": ["deg/sqrt(h)", "deg/h", "deg/h/sqrt(s)"],
        "factors": [DEGREE / 60, DEGREE / 3600, DEGREE / 3600],
        "x": [0.245, 7.56, 1.8],
        "y": [0.272, 7.92, 0.0],
        "z": [0.344, 3.06, 0.0],
    },
    "accelerometer": {
        "table": "A 7.1",
        "units": ["mg/sqrt(Hz)", "mg", "m/s/h^(3/2)"],
        "factors": [STANDARD_GRAVITY / 1000, STANDARD_GRAVITY / 1000, 3600**-1.5],
        "x": [0.128, 0.03, 9.07],
        "y": [0.128, 0.03, 0.0],
        "z": [0.2, 0.044, 0.0],
    },
}
TERMS = ("random_walk", "bias_instability", "rate_random_walk")

# Change of bias from 20 °C, per sensor and axis: linear (per °C), bend (at the hot end) and jump, in
# deg/s and g; the jump is a logistic step at 24.5 °C, nine tenths of it between 24 and 25 °C.
THERMAL = {
    "gyroscope": {"x": (0.006, 0.10, 0.55), "y": (-0.018, -0.12, 0.12), "z": (0.012, 0.16, 0.0)},
    "accelerometer": {
        "x": (0.0006, 0.004, 0.0),
        "y": (-0.0004, 0.006, 0.0),
        "z": (0.0011, -0.006, 0.009),
    },
}
JUMP_CENTRE, JUMP_WIDTH = 24.5, 0.17
UNITS = {"gyroscope": ("deg/s", DEGREE), "accelerometer": ("g", STANDARD_GRAVITY)}
# What the sensors read at rest at 20 °C: bias, Earth rate and gravity together.
AT_REST = {"gyroscope": (0.21, -0.34, 0.12), "accelerometer": (0.012, -0.021, 1.004)}

DEVICE = """\
schema = 1
id = "{id}"
name = "Robotics-grade AHRS (work A), simulated"

[site]
latitude = 39.89    # deg
longitude = 32.78   # deg
height = 900.0      # m
date = 2024-05-01
"""
RECORDING = """
[[recording]]
sensor = "{sensor}"
kind = "{kind}"
file = "{file}"
{rate}unit = "{unit}"
columns = {{ {time}x = "{p}x", y = "{p}y", z = "{p}z", temperature = "temperature" }}
"""
SPEC = """
[spec.gyroscope]
random_walk = { max = 0.30, unit = "deg/sqrt(h)" }
bias_instability = { max = 10.0, unit = "deg/h" }
"""


def thermal_change(temperature: np.ndarray, linear: float, bend: float, jump: float) -> np.ndarray:
    """Bias against 20 °C: a line, an exponential bend and a logistic step (no polynomial)."""
    t = np.asarray(temperature, dtype=float)
    bent = np.expm1((t - 20) / 12) / np.expm1(2)
    step = 1 / (1 + np.exp(-(t - JUMP_CENTRE) / JUMP_WIDTH))
    return linear * (t - 20) + bend * bent + jump * step


def _temperature(seconds: np.ndarray) -> np.ndarray:
    """A chamber's sweep: 20 → 44 → 20 °C with rounded turns, and a soak at each end."""
    knots = np.array([0, 240, 2760, 3240, 5760, 6000]) / 6000 * SWEEP_SECONDS
    ramp = np.interp(seconds, knots, [20.0, 20.0, 44.0, 44.0, 20.0, 20.0])
    width = int(200 * SWEEP_RATE)
    kernel = np.hanning(width) / np.hanning(width).sum()
    padded = np.pad(ramp, width, mode="edge")
    return np.convolve(padded, kernel, mode="same")[width:-width]


def swept(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The sweep's table: t (s), gx … az in deg/s and g, temperature (°C)."""
    samples = int(SWEEP_RATE * SWEEP_SECONDS)
    seconds = np.arange(samples) / SWEEP_RATE
    return {"t": seconds} | _table(rng, _temperature(seconds), SWEEP_RATE, None)


def settled(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The rest's table, the same columns without t."""
    seconds = np.arange(int(RATE * HOURS * 3600)) / RATE
    # A settled chamber still breathes by some hundredths of a degree.
    temperature = REST_TEMPERATURE + 0.02 * np.sin(2 * np.pi * seconds / 2900 + 1.0)
    return _table(rng, temperature, RATE, BANDWIDTH)


def _table(rng, temperature, rate, bandwidth) -> dict[str, np.ndarray]:
    table = {}
    for sensor in PUBLISHED:
        si = UNITS[sensor][1]
        for axis, rest in zip("xyz", AT_REST[sensor], strict=True):
            noise = coloured_noise(
                len(temperature), rate, rng, **_terms(sensor, axis), bandwidth=bandwidth
            )
            bias = rest + thermal_change(temperature, *THERMAL[sensor][axis])
            table[sensor[0] + axis] = bias + noise / si
    # The thermometer's own noise, 0.01 °C.
    table["temperature"] = temperature + 0.01 * rng.standard_normal(len(temperature))
    return table


def _terms(sensor: str, axis: str) -> dict[str, float]:
    """N, B and K of an axis in SI."""
    published = PUBLISHED[sensor]
    values = [p * f for p, f in zip(published[axis], published["factors"], strict=True)]
    return dict(zip(TERMS, values, strict=True))


def build(rng: np.random.Generator, identifier: str) -> SimulatedDevice:
    """Draws the device's recordings and its truth."""
    static = {name: column.astype(np.float32) for name, column in settled(rng).items()}
    sweep = {name: np.round(column, 7) for name, column in swept(rng).items()}
    grid = np.round(np.arange(20.0, 44.05, 0.1), 1)
    truth: dict = {"noise": {}, "thermal": {}, "published": {}, "bandwidth": BANDWIDTH}
    for sensor, published in PUBLISHED.items():
        si = UNITS[sensor][1]
        truth["published"][sensor] = {k: published[k] for k in ("table", "units", *"xyz")}
        truth["noise"][sensor] = {
            axis: {term: value or None for term, value in _terms(sensor, axis).items()}
            for axis in "xyz"
        }
        truth["thermal"][sensor] = {
            axis: {"bias": list(thermal_change(grid, *curve) * si), "jump": curve[2] * si or None}
            for axis, curve in THERMAL[sensor].items()
        }
    truth["thermal"] |= {"temperature": list(grid), "jump_range": [24.0, 25.0]}
    toml = DEVICE.format(id=identifier)
    for sensor in PUBLISHED:
        for kind, file, rate, time in (
            ("static", "static.npz", f"rate = {RATE}\n", ""),
            ("thermal", "sweep.csv", "", 'time = "t", '),
        ):
            toml += RECORDING.format(
                sensor=sensor, kind=kind, file=file, rate=rate, time=time,
                unit=UNITS[sensor][0], p=sensor[0],
            )  # fmt: skip
    return SimulatedDevice(toml + SPEC, {"static.npz": static, "sweep.csv": sweep}, truth)
