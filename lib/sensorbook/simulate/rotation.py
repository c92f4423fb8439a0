"""Preset `rotation`: a magnetometer and an accelerometer turned by hand through all attitudes.

The path is a smooth random one; the field is the Earth's at the preset's site with the gradient of a
room; the noise is that of a consumer magneto-resistive triad. Also work A's sensor as it is printed.
Nothing here comes from the solvers.
"""

from __future__ import annotations

from datetime import date

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from sensorbook.earth import STANDARD_GRAVITY, field_at, normal_gravity
from sensorbook.simulate.folder import SimulatedDevice
from sensorbook.simulate.noise import coloured_noise
from sensorbook.simulate.positions import DEVICE, HEIGHT, LATITUDE, LONGITUDE

RATE, SECONDS = 50.0, 120.0
TURN = 1.6  # rad rms a component, of each of the path's two turns
PACE = 1.2  # s, correlation of the turns: a hand turns a device by a radian or two a second
CARRIED = 0.04  # m rms a component
LEVER = (0.03, -0.02, 0.01)  # m, from the hand's centre of rotation to the accelerometer
GRADIENT = 2e-6  # T/m rms a component, of a room some metres from steel
# N and B, of a consumer triad: 60 nT/√Hz and 40 nT; 150 µg/√Hz and 40 µg.
NOISE = {
    "magnetometer": {"random_walk": 60e-9, "bias_instability": 40e-9},
    "accelerometer": {
        "random_walk": 150e-6 * STANDARD_GRAVITY,
        "bias_instability": 40e-6 * STANDARD_GRAVITY,
    },
}
SITE = {
    "latitude": LATITUDE,
    "longitude": LONGITUDE,
    "height": HEIGHT,
    "date": date(2024, 5, 1),  # as the template's
}

MILLIGAUSS = 1e-7
# Work A, 7.4.1 and 7.4.2: its sensor's offsets (mG), rotation (deg about x) and factors.
A_HARD_IRON = (158.50, -37.49, 191.96)
A_ROTATION = (11.3, 0.0, 0.0)
A_FACTORS = (1.0150, 0.9393, 1.0455)
A_FIELD = 400.0  # mG; A does not print it, its figures' circles have about this radius

_RECORDINGS = """
[[recording]]
sensor = "magnetometer"
kind = "rotation"
file = "rotation.csv"
unit = "uT"
columns = { time = "t", x = "mx", y = "my", z = "mz" }

[[recording]]
sensor = "accelerometer"
kind = "rotation"
file = "rotation.csv"
unit = "m/s^2"
columns = { time = "t", x = "ax", y = "ay", z = "az" }
"""


def smooth(rng: np.random.Generator, samples: int, rate: float, pace: float) -> np.ndarray:
    """(samples, 3) random paths of unit variance, correlated over `pace` seconds."""
    width = pace * rate
    margin = int(4 * width)
    white = rng.standard_normal((samples + 2 * margin, 3))
    path = ndimage.gaussian_filter1d(white, width, axis=0)[margin : margin + samples]
    return path * np.sqrt(2 * width * np.sqrt(np.pi))


def attitudes(rng: np.random.Generator, samples: int, rate: float) -> Rotation:
    """Body → local level at each sample, as a hand turns a device through all of them."""
    first, second = (TURN * smooth(rng, samples, rate, PACE) for _ in range(2))
    return Rotation.from_rotvec(first) * Rotation.from_rotvec(second)


def draw_iron(rng: np.random.Generator, strength: float) -> dict:
    """Errors of a magnetometer: hard_iron (3,) T, symmetric soft_iron (3, 3), alignment (3, 3)."""
    scale = np.diag(1 + rng.uniform(-0.08, 0.08, 3))
    cross = rng.uniform(-0.05, 0.05, (3, 3))
    return {
        "hard_iron": rng.uniform(-0.6, 0.6, 3) * strength,
        "soft_iron": scale + (cross + cross.T) / 2 * (1 - np.eye(3)),
        "alignment": Rotation.from_rotvec(np.radians(rng.normal(scale=1.5, size=3))).as_matrix(),
    }


def read_field(true: np.ndarray, iron: dict) -> np.ndarray:
    """(N, 3) noise-free readings of a true field (N, 3) in the accelerometer's axes, T."""
    seen = true @ np.transpose(iron["alignment"])
    return np.linalg.solve(iron["soft_iron"], seen.T).T + iron["hard_iron"]


def noisy(rng: np.random.Generator, values: np.ndarray, rate: float, noise: dict) -> np.ndarray:
    """(N, 3) with white and flicker noise added, the flicker's mean taken out."""
    result = np.array(values)
    for column in result.T:
        slow = coloured_noise(len(column), rate, rng, **noise)
        column += slow - slow.mean()
    return result


def turned(
    rng: np.random.Generator, samples: int, rate: float, field: np.ndarray, gravity: float
) -> dict:
    """True field and specific force in body axes, and the attitudes they were seen in.

    `field` (3,) T in the local level frame, east, north, up, at the middle of the path.
    """
    path = attitudes(rng, samples, rate)
    place = CARRIED * smooth(rng, samples, rate, PACE)
    g = rng.normal(scale=GRADIENT, size=(3, 3))
    g = (g + g.T) / 2
    g -= np.trace(g) / 3 * np.eye(3)  # neither sources nor currents where the device is
    arm = place + path.apply(LEVER)
    moved = np.gradient(np.gradient(arm, 1 / rate, axis=0), 1 / rate, axis=0)
    back = path.inv()
    return {
        "field": back.apply(field + place @ g),
        "force": back.apply(moved + np.array([0, 0, gravity])),
        "attitudes": path,
    }


def work_a(rng: np.random.Generator, samples: int = 6000, noise: float = 1.0) -> np.ndarray:
    """(samples, 3) readings of work A's sensor, T, evenly over the sphere, with white noise (mG)."""
    directions = rng.standard_normal((samples, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    angle = np.radians(A_ROTATION[0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])  # A 6.5
    soft_iron = turn.T @ np.diag(A_FACTORS) @ turn
    readings = A_FIELD * np.linalg.solve(soft_iron, directions.T).T + A_HARD_IRON
    return (readings + noise * rng.standard_normal(readings.shape)) * MILLIGAUSS


def build(rng: np.random.Generator, identifier: str) -> SimulatedDevice:
    """Draws the device's recording and its truth."""
    samples = round(SECONDS * RATE)
    known = field_at(SITE)
    strength = known.strength + rng.normal(scale=known.std)  # the crust's share is not in the model
    field = strength * np.array([0, np.cos(known.dip), -np.sin(known.dip)])
    gravity = normal_gravity(LATITUDE, HEIGHT)
    true = turned(rng, samples, RATE, field, gravity)
    iron = draw_iron(rng, strength)
    magnetometer = noisy(rng, read_field(true["field"], iron), RATE, NOISE["magnetometer"])
    matrix = np.eye(3) + np.diag(rng.uniform(-0.02, 0.02, 3))
    bias = rng.uniform(-0.4, 0.4, 3)
    force = noisy(rng, true["force"] @ matrix.T + bias, RATE, NOISE["accelerometer"])
    time = np.arange(samples) / RATE
    table = (
        {"t": time.round(2)}
        | {f"m{axis}": (1e6 * magnetometer[:, k]).round(3) for k, axis in enumerate("xyz")}
        | {f"a{axis}": force[:, k].round(5) for k, axis in enumerate("xyz")}
    )
    toml = DEVICE.format(
        id=identifier,
        name="Hand-turned compass",
        latitude=LATITUDE,
        longitude=LONGITUDE,
        height=HEIGHT,
    )
    truth = {
        "calibration": {
            "magnetometer": {
                "hard_iron": iron["hard_iron"].tolist(),
                "soft_iron": iron["soft_iron"].tolist(),
                "field": float(strength),
                "alignment": iron["alignment"].tolist(),
                "dip": float(known.dip),
            }
        }
    }
    return SimulatedDevice(toml + _RECORDINGS, {"rotation.csv": table}, truth)
