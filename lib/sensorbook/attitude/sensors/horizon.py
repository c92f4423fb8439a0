"""Roll and pitch from the crossings of a conical scan with the limb (work C, 3.5 to 3.9).

The nadir direction in body axes, n = (−sin θ, cos θ sin φ, cos θ cos φ) for roll φ and pitch θ (3.9),
makes the angle ρ with every line of sight S to the limb: S·n = cos ρ. Yaw, the rotation about n, is in no
such equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.rotations import axis_rotation
from sensorbook.attitude.sensors.conical import (
    EQUIVALENT_HEIGHT,
    RADIUS,
    Scan,
    angular_radius,
    scan_vectors,
)

UNOBSERVABLE = (
    "Yaw, the rotation about the line to the Earth's centre, is not observable: the disc looks the same "
    "after it. Its variance is infinite, and a second direction (Sun, star, field) has to give it."
)
REASONS = (
    "",
    "a crossing is missing; see what the scan says",
    "the crossings are too near each other, where the scan grazes the limb; choose another cone",
    "the crossings lie in one plane with the nadir, where a tilt towards the scan axis does not move "
    "them; choose another cone",
    "no attitude has such crossings at this height; check height, cone and the order of the crossings",
    "fewer than three crossings: the height is not determined; give it and use one cone",
    "the crossings lie together, as those of two cones that meet there; choose other cones",
    "both solutions fit and neither is nearer to the nadir; choose a narrower cone, or add a second one",
    "the crossings lie on no one circle: the Sun or the Moon in the scan, a detector's fault, or a "
    "standard error without the Earth's oblateness and weather",
    "the noise hides a tilt towards the scan axis and the height, most where both cones are nearly one "
    "plane; choose narrower cones, or less noise",
)
_OK, _MISSING, _NEAR, _PLANE, _NO_FIT, _FEW, _TOGETHER, _TIE, _NO_CIRCLE, _HIDDEN = range(
    len(REASONS)
)
ONLY = "the only one of the two with the Earth between the crossings"
NEARER = "the nearer to the nadir of two that fit equally"
LEAST_WIDTH = 1e-3  # rad, half the arc over the Earth
LINEAR = 0.1  # rad, largest standard error to which a linearised one of nadir and cos ρ is trusted
LEAST_PLANE = 1e-3  # of the determinant of both crossings and the nadir; errors grow by its inverse
AGREE = 5.0  # standard errors of a misfit; noise alone is beyond once in two million samples
MOST_MISFIT = np.radians(1.0)  # without `sigma`; oblateness and weather make 0.1° to 0.3°
_TIED = 1e-9  # of the solutions' z components; what is less is rounding


class Nadir:
    """Roll and pitch of what has a `nadir` (…, 3) in body axes (3.9)."""

    nadir: np.ndarray

    @property
    def roll(self) -> np.ndarray:
        """φ, rad, −π to π."""
        return np.arctan2(self.nadir[..., 1], self.nadir[..., 2])

    @property
    def pitch(self) -> np.ndarray:
        """θ, rad, −π/2 to π/2."""
        return -np.arctan2(self.nadir[..., 0], np.hypot(self.nadir[..., 1], self.nadir[..., 2]))


@dataclass(frozen=True)
class HorizonFix(Nadir):
    """What a horizon sensor determines.

    Attributes
    ----------
    nadir : (…, 3) unit vector to the Earth's centre in body axes; NaN where refused
    height : (…) m, given or, with two cones, found
    solutions : (…, 2, 3) of one cone: both directions that fulfil its equations, also where neither
        could be chosen; None with two cones
    fits : (…, 2) whether each has the Earth, not space, between the crossings
    chosen : (…) which of them is `nadir`, 0 or 1; −1 where refused
    choice : (…) why that one, in words; "" where none is chosen
    covariance : (…, 3, 3) of `nadir`, rank 2: it has no error along itself; None without `sigma`
    information : (…, 3, 3), rad⁻², of the attitude's error vector in body axes; zero about the nadir,
        so that it adds to other sensors' and has no inverse of its own
    roll_std, pitch_std : (…) standard errors, rad; None without `sigma`
    height_std : (…) m; None where the height was given, and without `sigma`
    reasons : (…) why a sample has no result, "" where it has
    unobservable : what the sensor cannot see, in words
    """

    nadir: np.ndarray
    height: np.ndarray
    solutions: np.ndarray | None
    fits: np.ndarray | None
    chosen: np.ndarray | None
    choice: np.ndarray | None
    covariance: np.ndarray | None
    information: np.ndarray | None
    roll_std: np.ndarray | None
    pitch_std: np.ndarray | None
    height_std: np.ndarray | None
    reasons: np.ndarray
    unobservable: str = UNOBSERVABLE


def tilted(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike = 0.0) -> np.ndarray:
    """Body from the nadir frame, A(x, φ) A(y, θ) A(z, ψ), (…, 3, 3); its z column is n of (3.9)."""
    return axis_rotation("X", roll) @ axis_rotation("Y", pitch) @ axis_rotation("Z", yaw)


def one_cone(
    crossings: Scan,
    height: ArrayLike,
    cone: float,
    side: int = 1,
    sigma: float | None = None,
    radius: float = RADIUS,
    equivalent_height: float = EQUIVALENT_HEIGHT,
) -> HorizonFix:
    """Roll and pitch from one cone's two crossings and the height.

    With γ the angle from the scan axis to the nadir and w half the arc between the crossings, both
    equations are cos η cos γ + sin η cos w sin γ = cos ρ, and the nadir lies over the arc's middle.
    Two γ solve it. That with sin γ < 0 has space between the crossings, so that their order excludes
    it; where both are positive, as for a small Earth, the one nearer the nadir is chosen. With η = π/2, or
    the body pitched by 90°, neither is nearer: both are in `solutions`, and none is chosen.

    Parameters
    ----------
    crossings : (…), of `scan`, or measured
    height : (…), m
    cone, side : as scanned
    sigma : standard error of each crossing, rad
    """
    enter, leave, rho = np.broadcast_arrays(
        np.asarray(crossings.enter, dtype=float),
        np.asarray(crossings.leave, dtype=float),
        angular_radius(height, radius, equivalent_height),
    )
    sigma = check_sigma(sigma)
    code = np.full(enter.shape, _OK)
    missing = ~(np.isfinite(enter) & np.isfinite(leave))
    width = np.where(missing, 1.0, np.mod(leave - enter, 2 * np.pi) / 2)
    middle = np.where(missing, 0.0, enter) + width
    towards, along = np.sin(cone) * np.cos(width), np.cos(cone) * np.ones_like(width)
    size, lean = np.hypot(towards, along), np.arctan2(towards, along)
    # The determinant of both crossings and the nadir is its root times 2 sin η sin w.
    plane = size**2 - np.cos(rho) ** 2
    code[plane < LEAST_PLANE**2] = _PLANE
    code[plane < -(LEAST_PLANE**2)] = _NO_FIT
    code[(width < LEAST_WIDTH) | (width > np.pi - LEAST_WIDTH)] = _NEAR
    code[missing] = _MISSING
    open_ = np.arctan2(np.sqrt(np.maximum(plane, 0.0)), np.cos(rho))
    gamma = np.stack([lean + open_, lean - open_], axis=-1)
    down = np.stack([np.sin(middle), 0 * middle, np.cos(middle)], axis=-1)
    axis = side * np.array([0.0, 1.0, 0.0])
    solutions = np.cos(gamma)[..., None] * axis + np.sin(gamma)[..., None] * down[..., None, :]
    fits = np.sin(gamma) > 0
    code[(code == _OK) & ~fits.any(axis=-1)] = _NO_FIT
    tied = fits.all(axis=-1) & (np.abs(np.diff(solutions[..., 2])[..., 0]) < _TIED)
    code[(code == _OK) & tied] = _TIE
    chosen = np.argmax(np.where(fits, solutions[..., 2], -2.0), axis=-1)
    nadir = np.take_along_axis(solutions, chosen[..., None, None], axis=-2)[..., 0, :]
    good = code == _OK
    sights = np.stack([scan_vectors(cone, middle + sign * width, side) for sign in (-1, 1)], -2)
    slopes = _slopes(sights, nadir)
    errors = _errors(sights, slopes, nadir, sigma, good, None)
    choice = np.where(good, np.where(fits.all(axis=-1), NEARER, ONLY), "")
    solved = good | (code == _TIE)
    return HorizonFix(
        blank(nadir, good),
        np.where(good, np.broadcast_to(height, good.shape), np.nan),
        np.where(solved[..., None, None], solutions, np.nan),
        fits & solved[..., None],
        np.where(good, chosen, -1),
        choice,
        *errors,
        None,
        np.array(REASONS)[code],
    )


def two_cones(
    first: Scan,
    second: Scan,
    cone: float,
    sigma: float | None = None,
    radius: float = RADIUS,
    equivalent_height: float = EQUIVALENT_HEIGHT,
) -> HorizonFix:
    """Roll, pitch and height from the crossings of cones about y and −y; three are enough.

    [S, −1] [n; cos ρ] = 0 (3.9) for all crossings is solved as it is by the smallest singular vector,
    then, where there are four, for the least squares of the scan angles themselves (Gauss–Newton). A
    NaN leaves a crossing out. Four that lie on no one circle are refused: where the root of the sum of
    their squared misfits is beyond `AGREE` standard errors or, without `sigma`, beyond `MOST_MISFIT`.
    It has one degree of freedom; three crossings leave none.

    Refused is also what the crossings do not determine: with cones near η = π/2 every crossing lies near the
    plane across the scan axis, and a tilt towards that axis does to them what another height does. The
    solution moves by `sigma` over the least singular value but one, which is refused beyond `LINEAR`.

    Parameters
    ----------
    first, second : crossings (…) of the cone about y and of the one about −y
    cone : η of both, rad
    sigma : standard error of each crossing, rad, with all that moves it: noise, oblateness, weather
    """
    sigma = check_sigma(sigma)
    angles = np.stack(
        np.broadcast_arrays(
            *(np.asarray(a, dtype=float) for s in (first, second) for a in (s.enter, s.leave))
        ),
        axis=-1,
    )
    seen = np.isfinite(angles)
    at = np.where(seen, angles, 0.0)
    sights = np.concatenate(
        [scan_vectors(cone, at[..., :2], 1), scan_vectors(cone, at[..., 2:], -1)], -2
    )
    along = np.concatenate(
        [
            scan_vectors(cone, at[..., :2] + np.pi / 2, 1),
            scan_vectors(cone, at[..., 2:] + np.pi / 2, -1),
        ],
        axis=-2,
    )
    along[..., 1] = 0.0  # dS/dδ
    rows = np.concatenate([sights, -np.ones((*sights.shape[:-1], 1))], -1) * seen[..., None]
    _, size, vectors = np.linalg.svd(rows)
    nadir, cosine = vectors[..., 3, :3], vectors[..., 3, 3]
    length = np.linalg.norm(nadir, axis=-1)
    code = np.full(length.shape, _OK)
    # Of unit vectors a length of zero is a plane through none of them.
    code[(size[..., 2] < LEAST_PLANE) | (length < 1e-6)] = _TOGETHER
    if sigma is not None:
        code[(length >= 1e-6) & (size[..., 2] * length * LINEAR < sigma)] = _HIDDEN
    code[seen.sum(axis=-1) < 3] = _FEW
    length = np.where(length > 0, length, 1.0)
    order = np.array([1, -1, 1, -1])
    rising = (np.einsum("...ki,...i->...k", along, nadir) * order * seen).sum(axis=-1)
    sign = np.where(rising < 0, -1.0, 1.0) / length
    nadir, cosine = nadir * sign[..., None], cosine * sign
    good = code == _OK
    nadir, cosine = np.where(good[..., None], nadir, [0.0, 0.0, 1.0]), np.where(good, cosine, 0.5)
    for _ in range(6):
        slopes = np.einsum("...ki,...i->...k", along, nadir)
        nadir, cosine = _step(sights, slopes, seen & good[..., None], nadir, cosine)
    slopes = np.einsum("...ki,...i->...k", along, nadir)
    left = cosine[..., None] - np.einsum("...ki,...i->...k", sights, nadir)
    misfit = np.linalg.norm(seen * left / np.maximum(np.abs(slopes), 1e-6), axis=-1)
    code[good & ~(misfit <= (MOST_MISFIT if sigma is None else AGREE * sigma))] = _NO_CIRCLE
    code[good & ~((cosine > 0) & (cosine < 1))] = _NO_FIT
    # Where a scan runs along the limb its angle says nothing: nadir along the scan axis, cos ρ 0.
    code[good & (seen & (np.abs(slopes) < LEAST_PLANE)).any(axis=-1)] = _HIDDEN
    good = code == _OK
    cosine = np.where(good, cosine, 0.5)
    sine = np.sqrt(1 - cosine**2)
    height = (radius + equivalent_height) / sine - radius
    errors = _errors(sights, slopes, nadir, sigma, good, seen)
    height_std = None
    if sigma is not None:
        height_std = errors[-1] * (radius + equivalent_height) * cosine / sine**3
    return HorizonFix(
        blank(nadir, good),
        np.where(good, height, np.nan),
        None,
        None,
        None,
        None,
        *errors[:4],
        height_std,
        np.array(REASONS)[code],
    )


def _step(sights, slopes, used, nadir, cosine):
    """One Gauss–Newton step of the nadir and cos ρ on the scan angles of the crossings `used`."""
    weight = used / np.where(used, np.maximum(slopes**2, 1e-12), 1.0)
    rows = np.concatenate(
        [np.cross(sights, nadir[..., None, :]), -np.ones((*sights.shape[:-1], 1))], axis=-1
    )
    left = cosine[..., None] - np.einsum("...ki,...i->...k", sights, nadir)
    normal = np.einsum("...ki,...k,...kj->...ij", rows, weight, rows)
    normal = closed(normal, nadir)
    none = ~used.any(axis=-1)
    normal = np.where(none[..., None, None], np.eye(4), normal)
    right = np.einsum("...ki,...k,...k->...i", rows, weight, left)
    step = np.linalg.solve(normal, right[..., None])[..., 0]
    nadir = nadir + np.cross(nadir, step[..., :3])
    return nadir / np.linalg.norm(nadir, axis=-1, keepdims=True), cosine + step[..., 3]


def _slopes(sights, nadir):
    """d(S·n)/dδ of crossings (…, k)."""
    return sights[..., 2] * nadir[..., None, 0] - sights[..., 0] * nadir[..., None, 2]


def closed(normal, nadir):
    """The normal matrix made invertible about the nadir, which changes nothing else."""
    about = np.trace(normal[..., :3, :3], axis1=-2, axis2=-1) / 2
    normal = normal.copy()
    normal[..., :3, :3] += about[..., None, None] * nadir[..., :, None] * nadir[..., None, :]
    return normal


def _errors(sights, slopes, nadir, sigma, good, seen):
    """Covariance, information, standard errors of roll and pitch, and that of cos ρ where it is unknown.

    `seen` (…, k) is None where ρ is known.
    """
    if sigma is None:
        return (None,) * (4 if seen is None else 5)
    used = good[..., None] if seen is None else seen & good[..., None]
    weight = np.where(used, 1 / np.where(used, np.maximum(slopes**2, 1e-12), 1.0), 0.0) / sigma**2
    rows = np.cross(sights, nadir[..., None, :])  # S·(n × δ) = (S × n)·δ
    if seen is not None:
        rows = np.concatenate([rows, -np.ones((*sights.shape[:-1], 1))], axis=-1)
    full = np.einsum("...ki,...k,...kj->...ij", rows, weight, rows)
    information = full[..., :3, :3]
    normal = np.where(good[..., None, None], closed(full, nadir), np.eye(full.shape[-1]))
    inverse = np.linalg.inv(normal)
    cosine_std = ()
    if seen is not None:
        last = np.where(good, full[..., 3, 3], 1.0)[..., None, None]
        information = information - full[..., :3, 3:] * full[..., 3:, :3] / last
        cosine_std = (np.where(good, np.sqrt(inverse[..., 3, 3]), np.nan),)
    turn = np.cross(nadir[..., None, :], np.eye(3))  # rows n × e: dn = turnᵀ δ
    covariance = np.einsum("...ki,...kl,...lj->...ij", turn, inverse[..., :3, :3], turn)
    level = np.maximum(nadir[..., 1] ** 2 + nadir[..., 2] ** 2, 1e-300)
    roll = np.stack([0 * level, nadir[..., 2] / level, -nadir[..., 1] / level], axis=-1)
    roll_std = np.sqrt(np.einsum("...i,...ij,...j->...", roll, covariance, roll))
    pitch_std = np.sqrt(covariance[..., 0, 0] / level)
    covariance, information = (
        np.where(good[..., None, None], m, np.nan) for m in (covariance, information)
    )
    roll_std, pitch_std = (np.where(good, s, np.nan) for s in (roll_std, pitch_std))
    return covariance, information, roll_std, pitch_std, *cosine_std


def blank(vectors, good):
    return np.where(good[..., None], vectors, np.nan)


def check_sigma(sigma: float | None) -> float | None:
    if sigma is not None and not (np.ndim(sigma) == 0 and np.isfinite(sigma) and sigma > 0):
        raise ValueError(f"sigma is {sigma}: give one positive standard error in rad, or None")
    return sigma
