"""Horizon sensor that scans a cone: where its line of sight meets the limb (work C, 3.2.1).

The reference frame has its z axis to the Earth's centre. The simulation follows the line of sight and
asks how near it passes to that centre; it knows nothing of the angles which the inversion
(`horizon.py`) reasons with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

RADIUS = 6371e3  # m, the Earth as a sphere (C 4)
EQUIVALENT_HEIGHT = 40e3  # m, H_eq: where the infrared horizon lies above the surface (C 3.2.1)

REASONS = (
    "",
    "the scan passes beside the Earth: there is no crossing; tilt towards the Earth or widen the cone",
    "the Earth fills the scan: there is no crossing; widen the cone or fly higher",
    "the attitude or the place holds no finite number",
    "the scan runs along the limb and meets it four times, which two angles do not describe; choose "
    "another cone",
)
_OK, _MISSED, _FILLED, _NOT_FINITE, _FOUR = range(len(REASONS))

_STEPS = 72  # of the first look around the cone
_GOLDEN = (np.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Scan:
    """Where a scan crosses the limb.

    Attributes
    ----------
    enter : (…) scan angle δ₁ from space to Earth, rad, −π to π; NaN without a crossing
    leave : (…) scan angle δ₂ from Earth to space, rad, the next after `enter`
    reasons : (…) why there is no crossing, "" where there is
    """

    enter: np.ndarray
    leave: np.ndarray
    reasons: np.ndarray


def angular_radius(
    height: ArrayLike, radius: float = RADIUS, equivalent_height: ArrayLike = EQUIVALENT_HEIGHT
) -> np.ndarray:
    """ρ = asin((R + H_eq)/(R + h)) of the infrared Earth, rad, from heights (…), m (3.5).

    >>> round(float(np.degrees(angular_radius(500e3))), 1)
    68.9
    """
    height = np.asarray(height, dtype=float)
    above = height - equivalent_height
    if not (above > 0).all():
        worst = height.ravel()[np.argmin(np.nan_to_num(above, nan=-np.inf))]
        raise ValueError(
            f"height is {worst:g} m: the satellite must be above the infrared horizon, "
            f"{np.max(equivalent_height):g} m (is the height in metres?)"
        )
    return np.arcsin((radius + np.asarray(equivalent_height)) / (radius + height))


def greatest_height(
    attitude: ArrayLike,
    cone: float,
    side: int = 1,
    radius: float = RADIUS,
    equivalent_height: float = EQUIVALENT_HEIGHT,
) -> np.ndarray:
    """The height (…), m, above which the scan passes beside the Earth at attitudes (…, 3, 3).

    Beside it means ρ below |γ − η|, with γ the angle from the scan axis to the nadir; infinite where
    the scan goes through the nadir.
    """
    _check_side(side)
    nadir = check_attitude(attitude)[..., :, 2]
    apart = np.abs(np.arccos(np.clip(side * nadir[..., 1], -1, 1)) - _check_cone(cone))
    sine = np.sin(np.minimum(apart, np.pi / 2))
    far = (radius + equivalent_height) / np.maximum(sine, 1e-300) - radius
    return np.where(sine > 0, far, np.inf)


def scan_vectors(cone: ArrayLike, angle: ArrayLike, side: int = 1) -> np.ndarray:
    """Lines of sight S = [sin η sin δ, ±cos η, sin η cos δ] in body axes (3.7), (…, 3).

    `cone` is η (…), rad, from the scan axis, which is y for `side` 1 and −y for −1; `angle` is δ (…).
    """
    _check_side(side)
    cone, angle = np.broadcast_arrays(_check_cone(cone), np.asarray(angle, dtype=float))
    across = np.sin(cone)
    return np.stack([across * np.sin(angle), side * np.cos(cone), across * np.cos(angle)], axis=-1)


def scan(
    attitude: ArrayLike,
    height: ArrayLike,
    cone: ArrayLike,
    side: int = 1,
    radius: float = RADIUS,
    equivalent_height: ArrayLike = EQUIVALENT_HEIGHT,
) -> Scan:
    """Scans a spherical Earth.

    Parameters
    ----------
    attitude : (…, 3, 3), body from a frame with z to the Earth's centre
    height : (…), m above the sphere of `radius`
    cone : (…), η, rad, half the cone's opening, between 0 and π/2
    side : 1 for a cone about y, −1 for one about −y
    equivalent_height : (…), m, of the infrared horizon above the sphere

    Raises
    ------
    ValueError : a height inside the infrared Earth, a cone out of range, an attitude that is no
        rotation, shapes that do not agree
    """
    angular_radius(height, radius, equivalent_height)  # refuses heights inside the Earth
    distance = radius + np.asarray(height, dtype=float)
    position = np.stack([0 * distance, 0 * distance, -distance], axis=-1)
    sphere = np.asarray(radius + np.asarray(equivalent_height, dtype=float))[..., None]
    return scan_ellipsoid(attitude, position, sphere * np.ones(3), cone, side)


def scan_ellipsoid(
    attitude: ArrayLike,
    position: ArrayLike,
    semi_axes: ArrayLike,
    cone: ArrayLike,
    side: int = 1,
) -> Scan:
    """Scans an ellipsoid about the origin, the Earth's true shape with the horizon's height added.

    Parameters
    ----------
    attitude : (…, 3, 3), body from the frame of the ellipsoid's axes
    position : (…, 3), m, of the satellite in that frame
    semi_axes : (…, 3) or (3,), m

    Crossings are bracketed between the scan's nearest and farthest points and halved to rounding,
    below 1e-13 rad; only where the scan grazes the limb are they worse, by the inverse of how steeply
    it crosses. The limb is no circle: a scan nearly along it can meet it four times, and is refused.
    """
    attitude, position = check_attitude(attitude), np.asarray(position, dtype=float)
    semi_axes, cone = np.asarray(semi_axes, dtype=float), _check_cone(cone)
    if not (semi_axes > 0).all():
        raise ValueError(f"semi_axes: the least is {semi_axes.min():g} m, needed is more than 0")
    batch = np.broadcast_shapes(
        attitude.shape[:-2], position.shape[:-1], semi_axes.shape[:-1], cone.shape
    )
    size = int(np.prod(batch))
    matrix = np.broadcast_to(attitude, (*batch, 3, 3)).reshape(size, 3, 3)
    # In units of the semi-axes the ellipsoid is a sphere of radius 1, and lines stay lines.
    place = np.broadcast_to(position / semi_axes, (*batch, 3)).reshape(size, 3)
    scale = np.broadcast_to(semi_axes, (*batch, 3)).reshape(size, 3)
    cone = np.broadcast_to(cone, batch).reshape(size)
    known = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(place).all(axis=1)
    matrix = np.where(known[:, None, None], matrix, np.eye(3))
    place = np.where(known[:, None], place, [0.0, 0.0, -2.0])

    def depth(angle: np.ndarray) -> np.ndarray:
        """How deep below the limb the line of sight passes, in radii; (N, k) for angles (N, k)."""
        sight = np.einsum("nji,nkj->nki", matrix, scan_vectors(cone[:, None], angle, side))
        sight = sight / scale[:, None]
        length = np.linalg.norm(sight, axis=-1)
        passing = np.linalg.norm(np.cross(place[:, None], sight), axis=-1) / length
        ahead = -np.einsum("ni,nki->nk", place, sight) > 0
        return 1 - np.where(ahead, passing, np.linalg.norm(place, axis=-1)[:, None])

    around = np.linspace(-np.pi, np.pi, _STEPS, endpoint=False)
    first = depth(np.broadcast_to(around, (size, _STEPS)))
    deepest = _extreme(depth, around[np.argmax(first, axis=1)], 1)
    highest = _extreme(depth, around[np.argmin(first, axis=1)], -1)
    code = np.full(size, _OK)
    code[depth(deepest[:, None])[:, 0] <= 0] = _MISSED
    code[depth(highest[:, None])[:, 0] >= 0] = _FILLED
    code[_twice(depth, around, first, 1) & _twice(depth, around, first, -1)] = _FOUR
    code[~known] = _NOT_FINITE
    before = deepest - np.mod(deepest - highest, 2 * np.pi)
    enter = _halved(depth, before, deepest)
    leave = _halved(depth, before + 2 * np.pi, deepest)
    turns = 2 * np.pi * np.floor((enter + np.pi) / (2 * np.pi))
    none = code != _OK
    enter, leave = (np.where(none, np.nan, x - turns).reshape(batch) for x in (enter, leave))
    return Scan(enter, leave, np.array(REASONS)[code].reshape(batch))


def _twice(function, around: np.ndarray, values: np.ndarray, sign: int) -> np.ndarray:
    """Whether `sign` times the function, `values` (N, k) at `around` (k,), has two maxima above 0: (N,)."""
    values = sign * values
    maxima = (values > np.roll(values, 1, axis=1)) & (values >= np.roll(values, -1, axis=1))
    several = maxima.sum(axis=1) > 1
    if not several.any():
        return several
    second = np.argsort(np.where(maxima, values, -np.inf), axis=1)[:, -2]
    at = _extreme(function, around[second], sign)
    return several & (sign * function(at[:, None])[:, 0] > 1e-12)  # above rounding


def _extreme(function, start: np.ndarray, sign: int) -> np.ndarray:
    """Where `sign` times the function is largest within a step of `start` (N,): golden section."""
    step = 2 * np.pi / _STEPS
    low, high = start - step, start + step
    for _ in range(40):  # to 4e-9 of the step, where the function is level to rounding
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        value = sign * function(np.stack([a, b], axis=1))
        left = value[:, 0] > value[:, 1]
        low, high = np.where(left, low, a), np.where(left, b, high)
    return (low + high) / 2


def _halved(function, outside: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The root between angles (N,) where the function is negative and where it is positive."""
    for _ in range(54):  # 2π / 2⁵⁴ is below rounding
        middle = (outside + inside) / 2
        deep = function(middle[:, None])[:, 0] > 0
        outside, inside = np.where(deep, outside, middle), np.where(deep, middle, inside)
    return (outside + inside) / 2


def check_attitude(attitude: ArrayLike) -> np.ndarray:
    """Attitudes (…, 3, 3), of which those with finite numbers are rotations to 1e-3; else a ValueError."""
    attitude = np.asarray(attitude, dtype=float)
    if attitude.shape[-2:] != (3, 3):
        raise ValueError(f"attitude: shape is {attitude.shape}, needed is (…, 3, 3)")
    known = attitude[np.isfinite(attitude).all(axis=(-2, -1))]
    off = np.abs(known @ np.swapaxes(known, -1, -2) - np.eye(3)).max(initial=0.0)
    if off > 1e-3:
        raise ValueError(
            f"attitude: A Aᵀ differs from the identity by {off:.2g}; give a direction-cosine matrix"
        )
    if (np.linalg.det(known) < 0).any():
        raise ValueError("attitude: its determinant is −1; it mirrors, give right-handed frames")
    return attitude


def _check_cone(cone: ArrayLike) -> np.ndarray:
    cone = np.asarray(cone, dtype=float)
    if not ((cone > 0) & (cone <= np.pi / 2)).all():
        raise ValueError(
            f"cone is {cone.ravel()[0]:g} rad: give half the opening, above 0 and at most π/2"
        )
    return cone


def _check_side(side: int) -> None:
    if side not in (1, -1):
        raise ValueError(f"side is {side!r}: give 1 for a cone about y, −1 for one about −y")
