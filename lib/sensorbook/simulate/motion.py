"""A rigid body moved by hand from rest to rest: true body rates and specific forces.

The path is computed ten times as finely as it is sampled. A sample is the mean over the sampling
interval centred on its stamp, as a sensor that filters before it samples gives: of the body rate, by
the exact rotation between fine points, and of the specific force, by second differences of the
sensor's position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

FINER = 10  # fine points an interval
SWIFTEST = 2.0  # rad/s, mean over a motion: half a turn takes 1.6 s
MOTION = (1.0, 3.0)  # s, unless the turn needs longer
DETOUR = np.radians(10.0)  # rms a component, off the shortest turn
CARRIED = 0.15  # m, rms a component, between the places of two rests
LEVER = (0.03, -0.02, 0.04)  # m, from the hand's centre of rotation to the sensor, body axes
TREMOR = (np.radians(0.2), 0.3e-3)  # rms of turn (rad) and place (m), at 4 to 12 Hz


@dataclass(frozen=True, eq=False)
class Motion:
    """True motion at N stamps.

    Attributes
    ----------
    time : (N,) s
    rate : (N, 3) rad/s, of the body against inertial space, in body axes
    force : (N, 3) m/s², specific force in body axes: gravity upwards at rest
    rests : (start, end) s of each rest, which holds the samples with start ≤ time < end
    """

    time: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    rests: tuple[tuple[float, float], ...]


def attitude(up: np.ndarray, heading: float) -> Rotation:
    """Body → local level (z up) where body direction `up` (3,) points up, turned by `heading` (rad)."""
    up = np.asarray(up, dtype=float) / np.linalg.norm(up)
    level = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    level /= np.linalg.norm(level)
    first = np.cos(heading) * level + np.sin(heading) * np.cross(up, level)
    return Rotation.from_matrix(np.array([first, np.cross(up, first), up]))


def moved(
    rng: np.random.Generator,
    attitudes: Sequence[Rotation],
    seconds: Sequence[float],
    rate: float,
    gravity: float,
    earth: np.ndarray,
) -> Motion:
    """Rests in `attitudes` (body → local level) for `seconds` each, and natural motions between.

    Parameters
    ----------
    rate : Hz
    gravity : m/s²
    earth : (3,) rad/s, rotation of the Earth in the local level frame
    """
    rates, forces, rests, now = [], [], [], 0
    for k, (rest, length) in enumerate(zip(attitudes, seconds, strict=True)):
        if k:
            turn, force = _carried(rng, attitudes[k - 1], rest, rate, gravity, earth)
            rates.append(turn)
            forces.append(force)
            now += len(turn)
        samples = round(length * rate)
        rates.append(np.tile(rest.inv().apply(earth), (samples, 1)))
        forces.append(np.tile(rest.inv().apply([0, 0, gravity]), (samples, 1)))
        rests.append((now / rate, (now + samples) / rate))
        now += samples
    return Motion(
        np.arange(now) / rate, np.concatenate(rates), np.concatenate(forces), tuple(rests)
    )


def _carried(rng, start: Rotation, end: Rotation, rate: float, gravity: float, earth: np.ndarray):
    """(n, 3) rates and specific forces of one motion from rest to rest."""
    turn = (start.inv() * end).as_rotvec()
    length = max(rng.uniform(*MOTION), np.linalg.norm(turn) / SWIFTEST)
    samples = round(length * rate)
    fine, step = samples * FINER, 1 / (rate * FINER)
    # One point more at each end, at rest, for the second differences.
    s = np.clip(np.arange(-1, fine + 2) / fine, 0, 1)[:, None]
    way = s**3 * (10 - 15 * s + 6 * s**2)  # least jerk (Flash & Hogan 1985)
    aside = (4 * s * (1 - s)) ** 3
    tremor, shake = (size * _tremor(rng, s * length) for size in TREMOR)
    path = start * Rotation.from_rotvec(turn * way)
    path = path * Rotation.from_rotvec((rng.normal(scale=DETOUR, size=3) + tremor) * aside)
    place = rng.normal(scale=CARRIED, size=3) * way
    place += (np.abs(rng.normal(scale=CARRIED, size=3)) + shake) * aside + path.apply(LEVER)
    acceleration = (place[2:] - 2 * place[1:-1] + place[:-2]) / step**2
    path = path[1:-1]
    turned = (path[:-1].inv() * path[1:]).as_rotvec() / step
    rates = turned + path[:-1].inv().apply(earth)
    forces = path.inv().apply(acceleration + np.array([0, 0, gravity]))
    forces = (forces[1:] + forces[:-1]) / 2
    return tuple(v.reshape(samples, FINER, 3).mean(axis=1) for v in (rates, forces))


def _tremor(rng, time: np.ndarray) -> np.ndarray:
    """(N, 3) of unit rms: three sinusoids of 4 to 12 Hz an axis."""
    frequency, phase = rng.uniform(4, 12, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * frequency * time[:, :, None] + phase)
    return waves.sum(axis=2) * np.sqrt(2 / 3)
