"""Star sensor: a pinhole camera, a catalogue and Wahba's problem (work C, 3.4).

Which star is which is taken as known here; `sensorbook.camera.stars` finds it out, from an image.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import poisson

from sensorbook.attitude.observations import Solution
from sensorbook.attitude.sensors.conical import check_attitude
from sensorbook.attitude.vectors import davenport
from sensorbook.errors import Refusal

SKY = 41253.0  # square degrees in the sphere, 4π (180/π)²
REASONS = (
    "",
    "fewer than two stars are in view: the rotation about one is not determined; widen the field or "
    "lengthen the catalogue",
)


@dataclass(frozen=True)
class StarSensor:
    """A camera along its own z axis.

    Attributes
    ----------
    focal : focal length, pixels
    width, height : of the image, pixels
    sensor_from_body : (3, 3), passive
    """

    focal: float
    width: int
    height: int
    sensor_from_body: np.ndarray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self):
        for name in ("focal", "width", "height"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} is {getattr(self, name)}: give a positive number of pixels"
                )

    @classmethod
    def of_field(cls, alpha: float, beta: float, width: int, **kwargs) -> StarSensor:
        """The sensor with a field of α × β (rad) that is `width` pixels wide."""
        focal = width / (2 * np.tan(alpha / 2))
        return cls(focal, width, round(2 * focal * np.tan(beta / 2)), **kwargs)

    @property
    def centre(self) -> np.ndarray:
        """(2,) principal point x₀, y₀, pixels."""
        return np.array([self.width, self.height]) / 2

    @property
    def pixel_angle(self) -> float:
        """rad, in the middle of the image."""
        return 1 / self.focal

    def pixel_angles(self, direction: ArrayLike) -> np.ndarray:
        """Angles (…, 2), rad, that a pixel spans at directions (…, 3) in sensor axes, θ off the boresight.

        Radially r = f tan θ has dθ/dr = cos²θ/f; across that the pixel lies f/cos θ away: cos θ/f.
        """
        cosine = np.asarray(direction, dtype=float)[..., 2]
        return np.stack([cosine**2, cosine], axis=-1) / self.focal

    def project(self, direction: ArrayLike) -> np.ndarray:
        """Image places (…, 2), pixels, of directions (…, 3) in sensor axes; NaN outside the image."""
        direction = np.asarray(direction, dtype=float)
        front = direction[..., 2] > 0
        scale = self.focal / np.where(front, direction[..., 2], 1.0)
        place = direction[..., :2] * scale[..., None] + self.centre
        seen = front & ((place >= 0) & (place <= [self.width, self.height])).all(axis=-1)
        return np.where(seen[..., None], place, np.nan)

    def direction(self, place: ArrayLike) -> np.ndarray:
        """[(x − x₀), (y − y₀), f] made unit (3.12), (…, 3), in sensor axes."""
        across = np.asarray(place, dtype=float) - self.centre
        vector = np.concatenate([across, np.full((*across.shape[:-1], 1), self.focal)], axis=-1)
        return vector / np.linalg.norm(vector, axis=-1, keepdims=True)

    def body_direction(self, place: ArrayLike) -> np.ndarray:
        """The same in body axes (3.13)."""
        return self.direction(place) @ self.sensor_from_body


@dataclass(frozen=True)
class Image:
    """Stars in an image: their rows in the catalogue (k,) and places (k, 2), pixels."""

    stars: np.ndarray
    places: np.ndarray


@dataclass(frozen=True)
class StarFix:
    """Attitude from an image.

    Attributes
    ----------
    matrix : (3, 3) body from inertial; NaN where refused
    solution : of the Wahba solver; None where refused
    covariance : (3, 3), rad², of the error vector in body axes; None where refused and without `noise`
    across_std, roll_std : standard errors across and about the boresight, rad; NaN where refused
    reason : "" where all is well
    """

    matrix: np.ndarray
    solution: Solution | None
    covariance: np.ndarray | None
    across_std: float
    roll_std: float
    reason: str


def catalogue_size(mean: float, alpha: float, beta: float) -> float:
    """Stars N = G · 41253/(α° β°) that put G in a field of α × β (rad) on average (3.11).

    For fields to some 20°: a pinhole's square field of side α has the solid angle 4 asin(sin²(α/2)), less
    than α² by 1 % at 20°, by 8 % at 60° and by 28 % at 140°, and so many fewer stars.

    >>> round(catalogue_size(3, np.radians(3), np.radians(4)))  # work C prints 2064
    10313
    """
    for name, value in (("mean", mean), ("alpha", alpha), ("beta", beta)):
        if not value > 0:
            raise ValueError(f"{name} is {value}: give a positive number")
    return mean * SKY / (np.degrees(alpha) * np.degrees(beta))


def chance_in_view(mean: float, least: int = 4) -> float:
    """Chance that a field holds `least` stars or more where it holds `mean` on average (Poisson).

    >>> round(chance_in_view(3), 3)
    0.353
    """
    if not 0 <= mean < np.inf:
        raise ValueError(f"mean is {mean}: give the mean number of stars in a field, 0 or more")
    return float(poisson.sf(least - 1, mean))


def mean_for(chance: float, least: int = 4) -> float:
    """The mean number in a field that puts `least` or more there with this chance."""
    if not 0 < chance < 1:
        raise ValueError(f"chance is {chance}: give one between 0 and 1")
    if not 1 <= least < np.inf:
        raise ValueError(f"least is {least}: give 1 or more; a field holds 0 or more with any mean")
    return float(brentq(lambda mean: chance_in_view(mean, least) - chance, 0.0, 1e4 + 2 * least))


def random_sky(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Right ascension and declination (count,), rad, of stars spread evenly over the sphere."""
    return rng.uniform(0, 2 * np.pi, count), np.arcsin(rng.uniform(-1, 1, count))


def reference_vectors(right_ascension: ArrayLike, declination: ArrayLike) -> np.ndarray:
    """(…, 3) inertial unit vectors; stars are so far that the satellite's place (3.14) changes nothing."""
    a, d = np.asarray(right_ascension, dtype=float), np.asarray(declination, dtype=float)
    return np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)], axis=-1)


def take_image(
    sensor: StarSensor,
    attitude: ArrayLike,
    references: np.ndarray,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Image:
    """Stars of the catalogue (n, 3) in view at one attitude (3, 3); `noise` is a centroid's, pixels."""
    seen = references @ (sensor.sensor_from_body @ check_attitude(attitude)).T
    places = sensor.project(seen)
    stars = np.flatnonzero(np.isfinite(places[:, 0]))
    places = places[stars]
    if not 0 <= noise < np.inf:
        raise ValueError(f"noise is {noise}: give a centroid's standard error in pixels, 0 or more")
    if noise:
        if rng is None:
            raise ValueError(
                f"noise is {noise:g} pixels and there is no rng: give a seeded generator"
            )
        places = places + rng.normal(0.0, noise, places.shape)
    return Image(stars, places)


def attitude(
    sensor: StarSensor, image: Image, references: np.ndarray, noise: float | None = None
) -> StarFix:
    """The attitude from two stars or more, by Davenport's q-method.

    Each star counts by the angles that a pixel spans at its place. `noise` is a centroid's standard
    error, pixels, for the standard errors.
    """
    if noise is not None and not 0 < noise < np.inf:
        raise ValueError(f"noise is {noise}: give a centroid's standard error in pixels, or None")
    if len(image.stars) < 2:
        return _refused(REASONS[1])
    places = np.asarray(image.places, dtype=float)
    known = np.isfinite(places).all(axis=-1, keepdims=True)  # what is not, the solver refuses
    seen = sensor.direction(np.where(known, places, sensor.centre))
    spread = sensor.pixel_angles(seen)
    variance = (spread**2).mean(axis=-1)
    given = {"weights": 1 / variance} if noise is None else {"sigma": noise * np.sqrt(variance)}
    pairs = sensor.body_direction(places), references[image.stars]
    try:
        found = davenport(*pairs, **given)
    except Refusal:  # a batch of one has the bare reason
        return _refused(davenport(pairs[0][None], pairs[1], **given).reasons.item())
    if noise is None:
        return StarFix(found.matrix, found, None, np.nan, np.nan, "")
    own = noise**2 * _covariance(seen, spread**2, 1 / variance)
    across, roll = np.sqrt([np.diag(own)[:2].mean(), own[2, 2]])
    turn = sensor.sensor_from_body
    return StarFix(found.matrix, found, turn.T @ own @ turn, float(across), float(roll), "")


def _refused(reason: str) -> StarFix:
    return StarFix(np.full((3, 3), np.nan), None, None, np.nan, np.nan, reason)


def _covariance(seen: np.ndarray, variance: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Of the error vector in sensor axes, for unit noise: H⁻¹ Σ w² [b×] C [b×]ᵀ H⁻¹, H = Σ w (I − b bᵀ).

    `seen` (k, 3) are b; `variance` (k, 2) of C is radial and tangential. [b×] turns one into the other.
    """
    tangent = np.stack([-seen[:, 1], seen[:, 0], 0 * seen[:, 0]], axis=-1)
    size = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent = np.where(size > 0, tangent / np.where(size > 0, size, 1.0), [0.0, 1.0, 0.0])
    radial = np.cross(tangent, seen)
    bend = np.einsum("k,kij->ij", weights, np.eye(3) - seen[:, :, None] * seen[:, None, :])
    inner = sum(
        np.einsum("k,ki,kj->ij", weights**2 * variance[:, n], axis, axis)
        for n, axis in enumerate((tangent, radial))
    )
    return np.linalg.solve(bend, np.linalg.solve(bend, inner).T)
