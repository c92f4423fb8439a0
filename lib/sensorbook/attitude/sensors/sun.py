"""Sun sensors: solar cells, whose current follows the cosine of the incidence, and slits (work C, 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

REASONS = (
    "",
    "the current is above the full current: check the unit, or for light besides the Sun's",
    "the cell is dark: the Sun is behind it, or hidden",
    "a cell is dark: the Sun is outside the range where all are lit",
    "the pairs' sums disagree: a cell is in shadow, or there is light besides the Sun's",
    "a reading is no finite number",
    "the Sun is outside the field of view: no line of light falls on the detector",
)
_OK, _ABOVE, _BEHIND, _DARK, _DISAGREE, _NOT_FINITE, _OUTSIDE = range(len(REASONS))
CONE = (
    "One cell gives the angle from its normal without a sign: the Sun is anywhere on a cone, and even in a "
    "known plane both +θ and −θ fit."
)
_DETECTED = 3.0  # a current below so many standard errors is taken for dark
_AGREE = (
    5.0  # standard errors of the difference of the pairs' sums, and of a current above the full one
)
_ALIKE = 0.01  # most difference of the pairs' sums without `sigma`, of their mean
_ROUNDING = 1e-6  # of the full current, above which a current in single precision may lie


@dataclass(frozen=True)
class CellAngle:
    """Angle of the Sun from one cell's normal.

    Attributes
    ----------
    angle : (…) rad, 0 to π/2; NaN where refused
    both : (…, 2) +angle and −angle, which fit equally
    std : (…) its standard error, rad; None without `sigma`. It grows as 1/sin θ towards the normal
    reasons : (…)
    ambiguity : in words
    """

    angle: np.ndarray
    both: np.ndarray
    std: np.ndarray | None
    reasons: np.ndarray
    ambiguity: str = CONE


@dataclass(frozen=True)
class SunAngle:
    """Angle of the Sun in the plane of a pair.

    Attributes
    ----------
    angle : (…) rad, positive towards the first cell; NaN where refused
    std : (…) rad; None without `sigma`
    reasons : (…)
    """

    angle: np.ndarray
    std: np.ndarray | None
    reasons: np.ndarray


@dataclass(frozen=True)
class SunDirection:
    """Direction to the Sun in the sensor's axes.

    Attributes
    ----------
    direction : (…, 3) unit vector; NaN where refused
    covariance : (…, 3, 3) of it, rank 2; None without `sigma`
    std : (…) rms error an axis across the direction, rad; None without `sigma`
    reasons : (…)
    """

    direction: np.ndarray
    covariance: np.ndarray | None
    std: np.ndarray | None
    reasons: np.ndarray


def cell_currents(sun: ArrayLike, normals: ArrayLike, full: ArrayLike = 1.0) -> np.ndarray:
    """I = I₀ cos θ (3.1), 0 with the Sun behind: currents (…, k) for the Sun (…, 3) and normals (k, 3).

    `sun` may have any length; `full` is I₀, the current under perpendicular light, (…, k) or one.
    """
    sun, normals = np.asarray(sun, dtype=float), np.asarray(normals, dtype=float)
    sun = sun / np.linalg.norm(sun, axis=-1, keepdims=True)
    return full * np.maximum(np.einsum("...i,ki->...k", sun, normals), 0.0)


def pair_normals(tilt: float) -> np.ndarray:
    """(2, 3) normals (±sin θ₀, 0, cos θ₀) of two cells tilted by θ₀ (rad) about y."""
    s, c = np.sin(_check_tilt(tilt)), np.cos(tilt)
    return np.array([[s, 0, c], [-s, 0, c]])


def four_normals(tilt: float) -> np.ndarray:
    """(4, 3) normals (±sin θ₀, 0, cos θ₀), (0, ±sin θ₀, cos θ₀)."""
    s, c = np.sin(_check_tilt(tilt)), np.cos(tilt)
    return np.array([[s, 0, c], [-s, 0, c], [0, s, c], [0, -s, c]])


def cell_angle(current: ArrayLike, full: float, sigma: float | None = None) -> CellAngle:
    """θ = ±acos(I/I₀) from one cell's current (…)."""
    current, full, sigma = np.asarray(current, dtype=float), _check_full(full), _check_sigma(sigma)
    share = current / full
    noise = 0.0 if sigma is None else sigma / full
    code = np.full(current.shape, _OK)
    code[share > 1 + max(_ROUNDING, _AGREE * noise)] = _ABOVE
    code[share <= _DETECTED * noise] = _BEHIND
    code[~np.isfinite(share)] = _NOT_FINITE
    good = code == _OK
    angle = np.where(good, np.arccos(np.clip(np.where(good, share, 1.0), 0, 1)), np.nan)
    std = None if sigma is None else noise / np.maximum(np.sin(angle), np.sqrt(noise))
    return CellAngle(angle, np.stack([angle, -angle], axis=-1), std, np.array(REASONS)[code])


def pair_angle(
    currents: ArrayLike, tilt: float, full: float, sigma: float | None = None
) -> SunAngle:
    """θ from a pair's currents (…, 2): ΔI = 2 I₀ sin θ₀ sin θ (3.3), while |θ| < π/2 − θ₀.

    With the Sun out of the pair's plane sin θ is its component along the pair. `full` is I₀ of both cells;
    a current above it is refused. `sigma` is the standard error of each current.
    """
    currents, full, sigma = _pairs(currents, 2), _check_full(full), _check_sigma(sigma)
    slope = 2 * full * np.sin(_check_tilt(tilt))
    code = _lit(currents, sigma)
    sine = (currents[..., 0] - currents[..., 1]) / slope
    most = full * (1 + _ROUNDING) if sigma is None else full + max(full * _ROUNDING, _AGREE * sigma)
    code[(code == _OK) & ((np.abs(sine) > 1) | (currents > most).any(axis=-1))] = _ABOVE
    good = code == _OK
    angle = np.where(good, np.arcsin(np.where(good, sine, 0.0)), np.nan)
    std = None if sigma is None else np.sqrt(2) * sigma / (slope * np.maximum(np.cos(angle), 1e-6))
    return SunAngle(angle, std, np.array(REASONS)[code])


def four_cell_direction(
    currents: ArrayLike, tilt: float, sigma: float | None = None
) -> SunDirection:
    """s ∝ [(I₁−I₂)/(I₁+I₂), (I₃−I₄)/(I₃+I₄), tan θ₀] from four currents (…, 4), whatever I₀ is.

    Exact while all four are lit: I₁ − I₂ = 2 I₀ s_x sin θ₀ and I₁ + I₂ = 2 I₀ s_z cos θ₀. Both sums are the
    same, which is checked: to 5 standard errors or, without `sigma`, to 1 % of their mean, which turns
    the direction by some 0.01/tan θ₀ rad. A cell in the dark reads 0, not the negative current which the
    formula needs: such a sample is refused. `sigma` is the standard error of each current.
    """
    currents, sigma = _pairs(currents, 4), _check_sigma(sigma)
    tangent = np.tan(_check_tilt(tilt))
    code = _lit(currents, sigma)
    safe = np.where((code == _OK)[..., None], currents, 1.0)
    first, second = safe[..., 0] + safe[..., 1], safe[..., 2] + safe[..., 3]
    limit = _ALIKE * (first + second) / 2 if sigma is None else _AGREE * 2 * sigma
    code[(code == _OK) & (np.abs(first - second) > limit)] = _DISAGREE
    x = (safe[..., 0] - safe[..., 1]) / first
    y = (safe[..., 2] - safe[..., 3]) / second
    vector = np.stack([x, y, tangent * np.ones_like(x)], axis=-1)
    by = np.zeros((*x.shape, 3, 4))  # of the vector by the currents
    by[..., 0, 0], by[..., 0, 1] = 2 * safe[..., 1] / first**2, -2 * safe[..., 0] / first**2
    by[..., 1, 2], by[..., 1, 3] = 2 * safe[..., 3] / second**2, -2 * safe[..., 2] / second**2
    spread = None if sigma is None else sigma**2 * by @ np.swapaxes(by, -1, -2)
    return _direction(vector, spread, code)


@dataclass(frozen=True)
class SlitSensor:
    """Two crossed slits, each over a row of pixels; the sensor looks along x (C 3.4).

    Attributes
    ----------
    height : m, of the slit above the detector
    pitch : m, of the pixels
    pixels : in a row; the middle of the row is under the slit
    """

    height: float
    pitch: float
    pixels: int

    def __post_init__(self):
        for name in ("height", "pitch", "pixels"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}: give a positive number")
        if self.pixels % 1:
            raise ValueError(f"pixels is {self.pixels}: give a whole number")

    @property
    def half_field(self) -> float:
        """Largest angle to either side, rad, whose line falls on the row."""
        return float(np.arctan(self.pixels * self.pitch / (2 * self.height)))

    @property
    def quantisation(self) -> float:
        """Standard error of an angle at the middle of the field, rad: a pixel's width over √12."""
        return self.pitch / self.height / np.sqrt(12)

    def read(self, sun: ArrayLike) -> np.ndarray:
        """Pixel numbers (…, 2), 0 to pixels − 1, for the Sun (…, 3) in sensor axes; NaN outside the field."""
        sun = np.asarray(sun, dtype=float)
        front = sun[..., 0] > 0
        place = self.height * sun[..., 1:] / np.where(front, sun[..., 0], 1.0)[..., None]
        number = np.floor(place / self.pitch + self.pixels / 2)
        seen = front & ((number >= 0) & (number < self.pixels)).all(axis=-1)
        return np.where(seen[..., None], number, np.nan)

    def angles(self, numbers: ArrayLike) -> np.ndarray:
        """α and β (…, 2), rad, of pixel numbers or, for a centroid, of fractions of them."""
        numbers = np.asarray(numbers, dtype=float)
        return np.arctan((numbers + 0.5 - self.pixels / 2) * self.pitch / self.height)

    def direction(self, numbers: ArrayLike, noise: float = 0.0) -> SunDirection:
        """s ∝ [1, tan α, tan β] (3.4) from pixel numbers (…, 2).

        Its covariance is that of the quantisation, a pixel over √12, and of `noise`, a standard error
        in pixels, together.
        """
        numbers = _pairs(numbers, 2)
        if np.ndim(noise) or not 0 <= noise < np.inf:
            raise ValueError(f"noise is {noise}: give one standard error in pixels, 0 or more")
        code = np.full(numbers.shape[:-1], _OK)
        code[~np.isfinite(numbers).all(axis=-1)] = _OUTSIDE
        beyond = (numbers < -0.5) | (numbers > self.pixels - 0.5)
        code[beyond.any(axis=-1)] = _OUTSIDE
        tangents = np.tan(self.angles(np.where((code == _OK)[..., None], numbers, 0.0)))
        vector = np.concatenate([np.ones((*code.shape, 1)), tangents], axis=-1)
        variance = (1 / 12 + noise**2) * (self.pitch / self.height) ** 2
        spread = variance * np.diag([0.0, 1.0, 1.0]) * np.ones((*code.shape, 1, 1))
        return _direction(vector, spread, code)


def _direction(vector, spread, code) -> SunDirection:
    """The unit vector of `vector` (…, 3), whose covariance is `spread`."""
    good = code == _OK
    size = np.linalg.norm(vector, axis=-1, keepdims=True)
    unit = vector / size
    covariance = std = None
    if spread is not None:
        across = (np.eye(3) - unit[..., :, None] * unit[..., None, :]) / size[..., None]
        covariance = np.where(good[..., None, None], across @ spread @ across, np.nan)
        std = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1) / 2)
    unit = np.where(good[..., None], unit, np.nan)
    return SunDirection(unit, covariance, std, np.array(REASONS)[code])


def _lit(currents, sigma) -> np.ndarray:
    code = np.full(currents.shape[:-1], _OK)
    code[(currents <= (0.0 if sigma is None else _DETECTED * sigma)).any(axis=-1)] = _DARK
    code[~np.isfinite(currents).all(axis=-1)] = _NOT_FINITE
    return code


def _pairs(values: ArrayLike, count: int) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim < 1 or values.shape[-1] != count:
        raise ValueError(f"readings: shape is {values.shape}, needed is (…, {count})")
    return values


def _check_tilt(tilt: float) -> float:
    if np.ndim(tilt) or not 0 < tilt < np.pi / 2:
        raise ValueError(f"tilt is {tilt} rad: give the cells' tilt θ₀, between 0 and π/2")
    return float(tilt)


def _check_full(full: float) -> float:
    if np.ndim(full) or not (np.isfinite(full) and full > 0):
        raise ValueError(f"full is {full}: give the one current under perpendicular light, above 0")
    return float(full)


def _check_sigma(sigma: float | None) -> float | None:
    if sigma is not None and (np.ndim(sigma) or not (np.isfinite(sigma) and sigma > 0)):
        raise ValueError(
            f"sigma is {sigma}: give one positive standard error of a current, or None"
        )
    return sigma
