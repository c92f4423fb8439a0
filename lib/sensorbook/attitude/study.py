"""Simulated studies of attitude from vectors: accuracy, convergence and speed.

The truth is drawn by scipy's `Rotation` and the noise is put on the directions themselves, independently
of the solvers' formulas.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sensorbook import earth
from sensorbook.attitude import wahba
from sensorbook.attitude.frames import ecef_from_eci, ecef_from_geodetic, ned_from_ecef
from sensorbook.attitude.observations import Observations, Solution
from sensorbook.attitude.rotations import error_vector
from sensorbook.errors import Refusal


@dataclass(frozen=True)
class Scene:
    """What a satellite sees: unit vectors (3,) to the Sun and along the field, inertial, and the field, T.

    `shadow` is whether the Earth hides the Sun, `model_error` the angle, rad, that the field's direction
    may be off its model by.
    """

    sun: np.ndarray
    field: np.ndarray
    strength: float
    shadow: bool
    model_error: float


def scene(time: str, latitude: float, longitude: float, height_km: float) -> Scene:
    """Sun and field at a UTC time and a geodetic place, deg and km; a Refusal beyond the IGRF's years."""
    place = np.radians(latitude), np.radians(longitude), 1000 * height_km
    to_inertial = ecef_from_eci(time).T
    try:
        local = earth.field_in_ned(*place, time)
    except ValueError as error:
        raise Refusal(f"The field is not known: {error}.", "Give a time in these years.") from None
    position = to_inertial @ ecef_from_geodetic(*place)
    sun = earth.sun_direction(time, position)
    field = to_inertial @ ned_from_ecef(*place[:2]).T @ local
    strength = float(np.linalg.norm(field))
    beside = np.linalg.norm(np.cross(position, sun))
    shadow = bool(position @ sun < 0 and beside < earth.EQUATOR_RADIUS)
    return Scene(
        sun, field / strength, strength, shadow, float(np.arctan(earth.SPACE_FIELD / strength))
    )


@dataclass(frozen=True)
class Epochs:
    """Simulated: `measured` (N, k, 3), `reference` (k, 3), `true` matrices (N, 3, 3), `sigma` (k,), rad."""

    measured: np.ndarray
    reference: np.ndarray
    true: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class Accuracy:
    """Errors of N solved epochs against the truth.

    Attributes
    ----------
    errors : (N, 3), rotation vectors in body axes, rad
    rms : of the whole angle, rad
    predicted : what the solutions' own covariances say it is, rad
    nees : mean of the normalised error squared, 3 where the covariances are right
    """

    errors: np.ndarray
    rms: float
    predicted: float
    nees: float


def simulate_epochs(reference: ArrayLike, sigma: ArrayLike, size: int, seed: int) -> Epochs:
    """Random attitudes that see `reference` vectors (k, 3) with errors of `sigma` (k,), rad.

    Each direction errs by independent normal angles about the two axes across it.
    """
    rng = np.random.default_rng(seed)
    reference, sigma = _unit(np.asarray(reference, dtype=float)), np.asarray(sigma, dtype=float)
    true = np.swapaxes(Rotation.random(size, rng=rng).as_matrix(), -1, -2)
    exact = reference @ np.swapaxes(true, -1, -2)
    turn = sigma[:, None] * rng.normal(size=exact.shape)
    turn -= (turn * exact).sum(axis=-1, keepdims=True) * exact
    turned = Rotation.from_rotvec(turn.reshape(-1, 3)).apply(exact.reshape(-1, 3))
    return Epochs(turned.reshape(exact.shape), reference, true, sigma)


def accuracy(solver: Callable[..., Solution], seen: Epochs, weights=None) -> Accuracy:
    """How far a solver errs on simulated epochs, and how far it says it does."""
    found = solver(seen.measured, seen.reference, weights=weights, sigma=seen.sigma)
    errors = error_vector(found.matrix, seen.true)
    variance = np.trace(found.covariance, axis1=-2, axis2=-1)
    solved = np.linalg.solve(found.covariance, errors[..., None])[..., 0]
    return Accuracy(
        errors,
        float(np.sqrt((errors**2).sum(axis=-1).mean())),
        float(np.sqrt(variance.mean())),
        float((errors * solved).sum(axis=-1).mean()),
    )


def apart(angle: float) -> np.ndarray:
    """Two unit vectors `angle` (rad) apart, (2, 3)."""
    return np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])


def davenport_matrix(measured: ArrayLike, reference: ArrayLike, weights: ArrayLike) -> np.ndarray:
    """Davenport's K (4, 4) of one epoch's vectors (k, 3), with weights (k,) made to sum to 1."""
    seen = Observations.of(measured, reference, weights, None)
    k = wahba.davenport_matrix(wahba.profile(seen.measured, seen.reference, seen.weights))
    return wahba.stacked(k)[0]


def power_iteration(k: ArrayLike, steps: int) -> np.ndarray:
    """q ← K q/‖K q‖ (3.37) from [0, 0, 0, 1]: the angle to the best attitude, rad, after 0, 1, … steps."""
    k = np.asarray(k, dtype=float)
    best = np.linalg.eigh(k)[1][:, -1]
    q = np.array([0.0, 0.0, 0.0, 1.0])
    angles = []
    for _ in range(steps + 1):
        across = q - (q @ best) * best
        angles.append(2 * np.arctan2(np.linalg.norm(across), abs(q @ best)))
        q = k @ q
        q /= np.linalg.norm(q)
    return np.array(angles)


def squared_iteration(k: ArrayLike, steps: int) -> np.ndarray:
    """The same for M ← M²/tr M² from M = K + I, whose columns become the vector: angles, rad."""
    m = np.asarray(k, dtype=float) + np.eye(4)
    best = np.linalg.eigh(m)[1][:, -1]
    angles = []
    for _ in range(steps + 1):
        q = m[:, np.argmax(np.diag(m))]
        angles.append(2 * np.arctan2(np.linalg.norm(q - (q @ best) * best), abs(q @ best)))
        m = m @ m
        m /= np.trace(m)
    return np.array(angles)


def quest_as_printed(k: ArrayLike) -> np.ndarray:
    """QUEST's quaternion from one K by Rodrigues' vector alone, y = [(λ + σ) I − S]⁻¹ z (C 3.6.3).

    In Shuster and Oh's form y = X/γ, X = (α I + β S + S²) z. Without sequential rotations both vanish
    towards rotations of 180°, and what is left is rounding; where nothing is, no rotation is returned.
    """
    k = np.asarray(k, dtype=float)
    s, z, sigma = k[:3, :3] + k[3, 3] * np.eye(3), k[:3, 3], k[3, 3]
    largest = np.linalg.eigvalsh(k)[-1]
    alpha = largest**2 - sigma**2 + (np.trace(s) ** 2 - np.trace(s @ s)) / 2
    gamma = (largest + sigma) * alpha - np.linalg.det(s)
    x = alpha * z + (largest - sigma) * s @ z + s @ s @ z
    length = np.sqrt(x @ x + gamma**2)
    return np.append(x, gamma) / length if length else np.array([0.0, 0.0, 0.0, 1.0])


def seconds_an_epoch(solver: Callable[..., Solution], seen: Epochs, times: int = 3) -> float:
    """Best of some runs over the whole batch, divided by its size."""
    took = []
    for _ in range(times):
        began = clock.perf_counter()
        solver(seen.measured, seen.reference).matrix  # noqa: B018, computed here
        took.append(clock.perf_counter() - began)
    return min(took) / len(seen.measured)


def seconds_by_scipy(seen: Epochs, times: int = 3) -> float:
    """The same for scipy's `align_vectors`, which solves one epoch a call, on the first 300."""
    took = []
    for _ in range(times):
        began = clock.perf_counter()
        for measured in seen.measured[:300]:
            Rotation.align_vectors(measured, seen.reference)
        took.append(clock.perf_counter() - began)
    return min(took) / len(seen.measured[:300])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
