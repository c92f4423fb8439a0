"""Preset `trajectory`: work C's experiment (5.2.1) as a device, a poor gyroscope beside a reference.

C takes the rates of a recording as if they were exact, and does not print them; here the motion is stated
(`attitude`, `place`) and no draw changes it. The tangent frame at the preset's site counts as inertial:
the Earth's rate, 0.004 °/s, is left out, which is nothing beside a bias of 3 °/s. Nothing here comes from
the estimators.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook.earth import STANDARD_GRAVITY, field_in_ned, normal_gravity
from sensorbook.simulate.folder import SimulatedDevice
from sensorbook.simulate.noise import coloured_noise
from sensorbook.simulate.positions import DEVICE
from sensorbook.simulate.rotation import SITE

# Work C: the sampling interval (5.2.2), and what is added to the gyroscope's true rates (table 5.1).
C_STEP = 0.035  # s
C_RANDOM_WALK = 0.001**0.5  # rad/s/√Hz: 0.001 (rad/s)²/Hz, two-sided; 0.169 rad/s a sample
C_BIAS = (0.03, 0.04, -0.01)  # rad/s
C_OUTAGE = (12.0, 20.0)  # s without a reference, as in C's figure 5.8
REFERENCE_ERROR = np.radians(0.05)  # rad rms an axis, white

FINER = 10  # fine points an interval
# Each angle is a sum of a sin(2π t/T + p) over its rows: a (deg), T (s), p (deg).
YAW = ((60.0, 23.0, 0.0), (25.0, 7.3, 40.0))
PITCH = ((30.0, 13.0, 70.0), (18.0, 6.1, 200.0))
ROLL = ((40.0, 17.0, 130.0), (22.0, 5.3, 310.0))
# So is each coordinate of the sensor's place, north, east, down: a (m), T (s), p (deg).
PLACE = (
    ((0.04, 3.1, 0.0), (0.02, 1.7, 90.0)),
    ((0.05, 3.7, 50.0), (0.02, 1.9, 20.0)),
    ((0.03, 2.9, 110.0), (0.01, 1.3, 60.0)),
)

SECONDS, REST_SECONDS = 180.0, 1200.0
MISSING, LONGEST_RUN = 0.03, 6  # share of the reference's samples, and the most in one run
# N of the other two: a consumer's, 150 µg/√Hz and 60 nT/√Hz. The gyroscope's K moves its bias by
# 0.015 °/s rms in the trajectory's 180 s, a ninth of what its N lets anyone see of it: it is there at
# rest, and the trajectory's bias is constant, as C's.
NOISE = {
    "gyroscope": {"random_walk": C_RANDOM_WALK, "rate_random_walk": 2e-5},
    "accelerometer": {"random_walk": 150e-6 * STANDARD_GRAVITY, "rate_random_walk": None},
    "magnetometer": {"random_walk": 60e-9, "rate_random_walk": None},
}

_RECORDINGS = """
[[recording]]
sensor = "gyroscope"
kind = "static"
file = "rest.npz"
rate = {rate!r}
unit = "rad/s"
columns = {{ x = "gx", y = "gy", z = "gz" }}

[[recording]]
sensor = "gyroscope"
kind = "trajectory"
file = "trajectory.csv"
unit = "deg/s"
columns = {{ time = "t", x = "gx", y = "gy", z = "gz" }}

[[recording]]
sensor = "accelerometer"
kind = "trajectory"
file = "trajectory.csv"
unit = "m/s^2"
columns = {{ time = "t", x = "ax", y = "ay", z = "az" }}

[[recording]]
sensor = "magnetometer"
kind = "trajectory"
file = "trajectory.csv"
unit = "uT"
columns = {{ time = "t", x = "mx", y = "my", z = "mz" }}

# v_body = q v_ned q*, in Hamilton's product: what the file holds turns components in north, east, down
# into those in the body's axes. truth.csv holds the conjugates, with A(q) v_ned = v_body (C 2.10).
[[recording]]
sensor = "reference"
kind = "trajectory"
file = "trajectory.csv"
columns = {{ time = "t", w = "qw", x = "qx", y = "qy", z = "qz" }}
quaternion = "reference_to_body"
"""


@dataclass(frozen=True, eq=False)
class Motion:
    """What ideal sensors read at N stamps: each reading is the mean of the interval before its stamp.

    Attributes
    ----------
    time : (N,) s
    true : (N, 4) attitude at the stamps, reference (north, east, down) → body, scalar last
    rate : (N, 3) rad/s, in body axes
    force : (N, 3) m/s², specific force in body axes: gravity upwards at rest
    field : (N, 3) T, the Earth's, in body axes
    """

    time: np.ndarray
    true: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    field: np.ndarray


@dataclass(frozen=True, eq=False)
class Experiment:
    """One run of work C's experiment: N stamps, of which the first is at 0 s.

    Attributes
    ----------
    time : (N,) s
    rate : (N, 3) rad/s as read: the true rate, the bias and white noise
    true_rate : (N, 3) rad/s, mean rotation over the interval that ends at the stamp: A at one stamp
        and the rate at the next give A there by (5.2), exactly
    true : (N, 4) attitude, reference → body, scalar last
    reference : (N, 4) the true attitude turned by a white error about each body axis
    bias : (3,) rad/s
    """

    time: np.ndarray
    rate: np.ndarray
    true_rate: np.ndarray
    true: np.ndarray
    reference: np.ndarray
    bias: np.ndarray


def angles(time: ArrayLike) -> np.ndarray:
    """(…, 3) yaw, pitch and roll, rad, at times (…), s.

    In degrees, with s(T, p) = sin(2π t/T + p):

    - yaw = 60 s(23, 0) + 25 s(7.3, 40°)
    - pitch = 30 s(13, 70°) + 18 s(6.1, 200°), within ±48°: nowhere near the angles' lock
    - roll = 40 s(17, 130°) + 22 s(5.3, 310°)

    Over a minute or more the body turns at 15 to 23 °/s rms about each axis. In the first three minutes
    it turns at 63 °/s at most, and at 51 °/s about one axis.
    """
    return np.radians(np.stack([_sum(time, rows) for rows in (YAW, PITCH, ROLL)], axis=-1))


def attitude(time: ArrayLike) -> Rotation:
    """Body → north, east, down at times (N,), s: yaw, pitch, roll in the sequence Z-Y-X.

    As scipy's `Rotation`, whose quaternion is the same four numbers as the house's reference → body.
    """
    return Rotation.from_euler("ZYX", angles(time))


def place(time: ArrayLike) -> np.ndarray:
    """(…, 3) m, the sensor's place in north, east, down at times (…), s: the sums of `PLACE`."""
    return np.stack([_sum(time, rows) for rows in PLACE], axis=-1)


def motion(seconds: float = SECONDS, step: float = C_STEP, finer: int = FINER) -> Motion:
    """The stated motion as ideal sensors read it every `step` s, from `finer` points an interval.

    A reading is the mean over the interval that ends at its stamp, as a sensor gives that averages
    between samples; the first, at 0 s, is that of the interval before.
    """
    time = _stamps(seconds, step)
    fine = (np.arange(len(time) * finer + 1) / finer - 1) * step
    path = attitude(fine)
    rate = (path[:-1].inv() * path[1:]).as_rotvec() / (step / finer)
    acceleration = np.stack(
        [_sum(fine, [(-a * (2 * np.pi / t) ** 2, t, p) for a, t, p in rows]) for rows in PLACE],
        axis=-1,
    )
    gravity = normal_gravity(SITE["latitude"], SITE["height"])
    where = np.radians(SITE["latitude"]), np.radians(SITE["longitude"]), SITE["height"]
    field = field_in_ned(*where, SITE["date"])
    back = path.inv()

    def means(values: np.ndarray) -> np.ndarray:
        return values.reshape(len(time), finer, 3).mean(axis=1)

    def between(values: np.ndarray) -> np.ndarray:
        return (values[1:] + values[:-1]) / 2

    return Motion(
        time=time,
        true=attitude(time).as_quat(),
        rate=means(rate),
        force=means(between(back.apply(acceleration - [0, 0, gravity]))),  # down is the third
        field=means(between(back.apply(field))),
    )


def experiment(
    rng: int | np.random.Generator,
    seconds: float = 60.0,
    step: float = C_STEP,
    bias: ArrayLike = C_BIAS,
    random_walk: float = C_RANDOM_WALK,
    reference_error: float = REFERENCE_ERROR,
) -> Experiment:
    """Work C's experiment (5.2.1) on the stated motion.

    Parameters
    ----------
    rng : a seed or a generator
    seconds, step : s, of the run and of an interval
    bias : (3,) rad/s
    random_walk : rad/s/√Hz, N of the gyroscope: a reading scatters by N/√step
    reference_error : rad rms about each body axis, 0 for an exact reference

    >>> run = experiment(1)
    >>> run.rate.shape, float((run.rate - run.true_rate).std().round(2))
    ((1715, 3), 0.17)
    """
    rng = np.random.default_rng(rng)
    time, bias = _stamps(seconds, step), np.array(bias, dtype=float)
    path = attitude(np.r_[-step, time])
    true_rate = (path[:-1].inv() * path[1:]).as_rotvec() / step
    white = random_walk / np.sqrt(step) * rng.standard_normal((len(time), 3))
    return Experiment(
        time=time,
        rate=true_rate + bias + white,
        true_rate=true_rate,
        true=path[1:].as_quat(),
        reference=_measured(rng, path[1:], reference_error).as_quat(),
        bias=bias,
    )


def _stamps(seconds: float, step: float) -> np.ndarray:
    return step * np.arange(round(seconds / step) + 1)


def _sum(time: ArrayLike, rows) -> np.ndarray:
    """(…) Σ a sin(2π t/T + p) over rows of a, T (s), p (deg)."""
    time = np.asarray(time, dtype=float)
    return sum(a * np.sin(2 * np.pi * time / period + np.radians(p)) for a, period, p in rows)


def _measured(rng: np.random.Generator, path: Rotation, error: float) -> Rotation:
    """Attitudes (N,) turned about each body axis by a white error (rad rms)."""
    return path * Rotation.from_rotvec(error * rng.standard_normal((len(path), 3)))


def _lost(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """(N,) true where the reference has no sample: in the outage, and in short runs besides."""
    outage = (time >= C_OUTAGE[0]) & (time < C_OUTAGE[1])
    lost = outage.copy()
    while lost[~outage].mean() < MISSING:
        first = rng.integers(len(time))
        lost[first : first + rng.integers(1, LONGEST_RUN + 1)] = True
    return lost


def _read(rng: np.random.Generator, values: np.ndarray, sensor: str) -> np.ndarray:
    """(N, 3) true readings with the sensor's white noise."""
    scatter = NOISE[sensor]["random_walk"] / np.sqrt(C_STEP)
    return values + scatter * rng.standard_normal(values.shape)


def build(rng: np.random.Generator, identifier: str) -> SimulatedDevice:
    """Draws the device's recordings and its truth."""
    made = motion()
    gyroscope = np.degrees(_read(rng, made.rate + C_BIAS, "gyroscope"))
    accelerometer = _read(rng, made.force, "accelerometer")
    magnetometer = 1e6 * _read(rng, made.field, "magnetometer")
    path = Rotation.from_quat(made.true)
    # What a file declares is what its quaternion does to components, q v q*. The house's numbers,
    # A(q) v_ref = v_body, are therefore a file's body_to_reference; here it holds the inverse.
    reference = _measured(rng, path, REFERENCE_ERROR).inv().as_quat()
    reference[_lost(rng, made.time)] = np.nan
    stamps = made.time.round(3)
    table = (
        {"t": stamps}
        | {f"g{axis}": gyroscope[:, k].round(5) for k, axis in enumerate("xyz")}
        | {f"a{axis}": accelerometer[:, k].round(5) for k, axis in enumerate("xyz")}
        | {f"m{axis}": magnetometer[:, k].round(3) for k, axis in enumerate("xyz")}
        | {f"q{axis}": reference[:, k].round(7) for k, axis in enumerate("xyzw")}
    )
    truth_table = {"t": stamps} | {
        f"q{axis}": made.true[:, k].round(9) for k, axis in enumerate("xyzw")
    }
    rate, walk = 1 / C_STEP, NOISE["gyroscope"]["rate_random_walk"]
    samples = round(REST_SECONDS * rate)
    level = [
        start + coloured_noise(samples, rate, rng, random_walk=0.0, rate_random_walk=walk)
        for start in C_BIAS
    ]
    still = _read(rng, np.stack(level, axis=1), "gyroscope").astype(np.float32)
    rest = {f"g{axis}": still[:, k] for k, axis in enumerate("xyz")}
    toml = DEVICE.format(id=identifier, name="Work C's gyroscope and reference", **SITE)
    truth = {
        "noise": {
            sensor: {axis: {"bias_instability": None} | terms for axis in "xyz"}
            for sensor, terms in NOISE.items()
        },
        "bias": list(C_BIAS),
        "reference_error": float(REFERENCE_ERROR),
        "delay": C_STEP / 2,
        "attitude": "truth.csv",
    }
    return SimulatedDevice(
        toml + _RECORDINGS.format(rate=rate),
        {"trajectory.csv": table, "truth.csv": truth_table, "rest.npz": rest},
        truth,
    )
