"""Readings of a magnetometer with known iron, turned in ways that see all or some of the sphere."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.simulate.rotation import NOISE, attitudes, draw_iron, noisy, read_field

RATE = 50.0  # Hz
FIELD = 48e-6  # T
DOWN = np.array([0, np.cos(1.0), -np.sin(1.0)])  # direction of the field, east, north, up


def anywhere(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3) unit directions, each drawn by itself from all of them."""
    u = rng.standard_normal((count, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


def turned_by_hand(rng: np.random.Generator, seconds: float = 60.0) -> np.ndarray:
    """(N, 3) unit directions of the field along a smooth path through all attitudes."""
    return attitudes(rng, round(seconds * RATE), RATE).inv().apply(DOWN)


def belt(rng: np.random.Generator, degrees: float, seconds: float = 60.0) -> np.ndarray:
    """(N, 3) unit directions within ± degrees of a plane, gone round every 6 s, in any orientation."""
    t = np.arange(round(seconds * RATE)) / RATE
    z = np.sin(np.radians(degrees)) * np.sin(2 * np.pi * t / 3.7 + rng.uniform(0, 6))
    return _laid(rng, z, 2 * np.pi * t / 6)


def cap(rng: np.random.Generator, degrees: float, seconds: float = 60.0) -> np.ndarray:
    """(N, 3) unit directions within degrees of one direction, in any orientation."""
    t = np.arange(round(seconds * RATE)) / RATE
    share = (1 + np.sin(2 * np.pi * t / 3.7 + rng.uniform(0, 6))) / 2
    return _laid(rng, 1 - (1 - np.cos(np.radians(degrees))) * share, 2 * np.pi * t / 6)


def _laid(rng: np.random.Generator, z: np.ndarray, turn: np.ndarray) -> np.ndarray:
    level = np.sqrt(1 - z**2)
    u = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    return Rotation.random(rng=rng).apply(u)


def soft_iron_of(rng: np.random.Generator, factors) -> np.ndarray:
    """(3, 3) symmetric soft iron with these factors along axes in any orientation."""
    turn = Rotation.random(rng=rng).as_matrix()
    return turn @ np.diag(factors) @ turn.T


def iron_of(rng: np.random.Generator) -> dict:
    """Errors of a sensor on a board as `draw_iron` has them, its axes those of the field."""
    return draw_iron(rng, FIELD) | {"alignment": np.eye(3)}


def read(rng: np.random.Generator, u: np.ndarray, iron: dict, louder: float = 1.0) -> np.ndarray:
    """(N, 3) T, readings along `u` with a consumer triad's white and flicker noise."""
    noise = {k: louder * v for k, v in NOISE["magnetometer"].items()}
    return noisy(rng, read_field(FIELD * u, iron), RATE, noise)
