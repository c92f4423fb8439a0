"""How many attitudes, and how long in each, for a static calibration of a wanted accuracy.

First-order propagation of the noise of the rests' means, exact in N, B and K (`means`), through the
chapters' own linearised adjustments: the length of gravity (B 17, 18; `calibration.coverage.design`) for
"positions", levelled faces (B 5–8) for "six_position", gravity carried from rest to rest (Tedaldi et al.
2014, section IV) for a gyroscope.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from sensorbook.calibration.coverage import STANDARD, coverage, design
from sensorbook.calibration.model import FREE
from sensorbook.calibration.motions import Motions, predicted
from sensorbook.calibration.multi_position import enough
from sensorbook.calibration.positions import FACES
from sensorbook.earth import EARTH_RATE, STANDARD_GRAVITY
from sensorbook.noise.model import NoiseTerms
from sensorbook.plan.means import about_the_whole, covariance_of_means

MOTION = 2.5  # s, of a hand from rest to rest
LOST = 0.5  # s of a rest that are not free of its motions: the window of `calibration.rests`
SECONDS = (4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)  # of a rest
LEVELLED = 10.0  # s of a levelled rest at least: setting it up takes longer
LEVELLING = 0.2  # deg rms about each axis, on a levelled plate
LATITUDE = 45.0  # deg, where nothing tells it
STEPS = 40  # of a motion
SEED, HEADINGS = 1, 4  # of the headings, which a hand leaves to chance; the mean of so many draws
QUANTITIES = ("bias", "scale_factor_error", "misalignment")

_ALL = tuple(STANDARD)
EIGHTEEN = tuple(n for n in _ALL if n.count("/") < 2)  # faces and edges
SIX = tuple(FACES)


@dataclass(frozen=True)
class Positions:
    """Rests by name of the side that is up, `seconds` each, and what they tell.

    Attributes
    ----------
    every : expected standard error by quantity of each of its parameters, SI
    dof : degrees of freedom of the residuals, which scale the chapter's own errors
    """

    attitudes: tuple[str, ...]
    seconds: float
    every: dict[str, np.ndarray]
    dof: int

    @property
    def std(self) -> dict[str, float]:
        """That of the worst parameter, by quantity."""
        return {quantity: float(each.max()) for quantity, each in self.every.items()}

    @property
    def half(self) -> dict[str, float]:
        """Half of the worst parameter's 95 % interval, by Student's t as the chapters have it."""
        t = float(stats.t.ppf(0.975, self.dof))
        return {quantity: t * std for quantity, std in self.std.items()}

    @property
    def duration(self) -> float:
        """s, with the motions between."""
        return len(self.attitudes) * (self.seconds + MOTION) - MOTION


def multi_position(
    terms: dict[str, NoiseTerms], attitudes: tuple[str, ...], seconds: float
) -> Positions:
    """An accelerometer's nine parameters from rests in many attitudes.

    `terms` by axis, SI. Raises `ValueError` for attitudes that the chapter would refuse.
    """
    u = _directions(attitudes)
    covariance = _of_lengths(terms, u, seconds)
    return Positions(attitudes, seconds, _grouped(covariance, FREE[9]), len(u) - 9)


def six_position(
    terms: dict[str, NoiseTerms],
    attitudes: tuple[str, ...],
    seconds: float,
    levelling: float = LEVELLING,
) -> Positions:
    """The same from levelled faces, all of them; `levelling` deg rms about each axis."""
    u = _directions(attitudes)
    noise = _noise(terms, len(u), seconds)
    tilt = np.radians(levelling)
    along = u[:, :, None] * u[:, None, :]
    tilted = STANDARD_GRAVITY**2 * (tilt**2 * (np.eye(3) - along) + tilt**4 * along)
    rows, columns = np.nonzero(FREE[9])
    a = np.zeros((len(u), 3, 9))
    a[:, rows, np.arange(6)] = STANDARD_GRAVITY * u[:, columns]
    a[:, :, 6:] = np.eye(3)
    each = np.array([np.diag([noise[k][p, p] for k in range(3)]) for p in range(len(u))]) + tilted
    weighted = np.linalg.solve(each, a)
    normal = np.linalg.inv(np.einsum("pik,pil->kl", a, weighted))
    gain = np.einsum("kl,pil->kpi", normal, weighted)
    covariance = sum(gain[:, :, k] @ noise[k] @ gain[:, :, k].T for k in range(3))
    covariance = covariance + np.einsum("kpi,pij,lpj->kl", gain, tilted, gain)
    return Positions(attitudes, seconds, _grouped(covariance, FREE[9]), 3 * len(u) - 9)


def gyroscope(
    terms: dict[str, NoiseTerms],
    accelerometer: dict[str, NoiseTerms],
    attitudes: tuple[str, ...],
    seconds: float,
    latitude: float = LATITUDE,
) -> Positions:
    """A gyroscope's bias from the rests, and its nine scale factors and misalignments from the motions
    between them; the `accelerometer` recorded beside it gives the directions.

    The Earth's rate about the horizontal, whose heading is not known, scatters the rests' readings.
    """
    u = _directions(attitudes)
    noise = _noise(terms, len(u), seconds)
    level = np.radians(latitude)
    bias = []
    for k in range(3):
        pinv = np.linalg.pinv(np.c_[np.ones(len(u)), u[:, k]])[0]
        earth = (EARTH_RATE * np.cos(level)) ** 2 * (1 - u[:, k] ** 2) / 2
        bias.append(np.sqrt(pinv @ (noise[k] + np.diag(earth)) @ pinv))
    rng = np.random.default_rng(SEED)
    variance = np.zeros(9)
    for _ in range(HEADINGS):
        motions, own, by_frame = _motions(u, seconds, terms, accelerometer, rng)
        across = _tangents(motions.after)
        rows = np.einsum("rij,rjk->rik", across, predicted(motions, np.eye(3))[1]).reshape(-1, 9)
        gain = np.linalg.pinv(rows)
        left = gain @ np.einsum("rij,rjk->rik", across, by_frame).reshape(len(rows), -1)
        variance += np.diag((gain * np.repeat(own, 2)) @ gain.T + left @ left.T) / HEADINGS
    std = np.sqrt(variance).reshape(3, 3)
    values = np.array(bias), np.diag(std), std[~np.eye(3, dtype=bool)]
    every = dict(zip(QUANTITIES, values, strict=True))
    return Positions(attitudes, seconds, every, 2 * (len(u) - 1) - 9)


def planned(kind: str, quantity: str, within: float, **given) -> tuple[Positions, bool]:
    """The shortest recording with a 95 % interval of ± `within` or less, and whether there is one.

    Where there is none, the one that comes nearest. `given` goes to the method: `terms` and what it takes
    besides.
    """
    if kind == "six_position":
        tried = [(SIX * r, s) for r in (1, 2, 3, 4, 6) for s in SECONDS if s >= LEVELLED]
        method = six_position
    else:
        method = gyroscope if "accelerometer" in given else multi_position
        sets = (EIGHTEEN, _ALL, EIGHTEEN * 2, _ALL * 2, _ALL * 3)
        tried = [(a, s) for a in sets for s in SECONDS]
    found = []
    for attitudes, seconds in sorted(tried, key=lambda t: len(t[0]) * (t[1] + MOTION)):
        found.append(method(attitudes=attitudes, seconds=seconds, **given))
        if found[-1].half[quantity] <= within:
            return found[-1], True
    # What is hardly better is not worth the time.
    best = min(p.half[quantity] for p in found)
    return next(p for p in found if p.half[quantity] <= 1.05 * best), False


def _directions(attitudes: tuple[str, ...]) -> np.ndarray:
    """(P, 3) unit vectors that point up."""
    u = np.array([STANDARD[name] for name in attitudes])
    if set(attitudes) != set(SIX):
        found = coverage(u, FREE[9])
        if not enough(9)(found) or len(u) <= 9:
            raise ValueError(f"{len(u)} attitudes with a condition number of {found.condition:.3g}")
    return u


def _starts(count: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """When each rest begins, free of motion, and for how long it lasts."""
    start = np.arange(count) * (seconds + MOTION) + LOST / 2
    return start, np.full(count, seconds - LOST)


def _noise(terms: dict[str, NoiseTerms], count: int, seconds: float) -> list[np.ndarray]:
    """(P, P) covariance of the rests' means about the recording's, of each axis."""
    return [about_the_whole(*_starts(count, seconds), terms[a]) for a in "xyz"]


def _of_lengths(terms, u: np.ndarray, seconds: float) -> np.ndarray:
    """(9, 9) covariance of matrix entries and biases (m/s²) by gravity's length."""
    noise = _noise(terms, len(u), seconds)
    scatter = sum(np.outer(u[:, k], u[:, k]) * noise[k] for k in range(3))
    gain = np.linalg.pinv(design(u, FREE[9])) / STANDARD_GRAVITY
    gain[-3:] *= STANDARD_GRAVITY
    return gain @ scatter @ gain.T


def _grouped(covariance: np.ndarray, free: np.ndarray) -> dict[str, np.ndarray]:
    std = np.sqrt(np.diag(covariance))
    rows, columns = np.nonzero(free)
    scale = rows == columns
    matrix = std[:-3]
    return dict(zip(QUANTITIES, (std[-3:], matrix[scale], matrix[~scale]), strict=True))


def _motions(u: np.ndarray, seconds: float, terms, accelerometer, rng):
    """Nominal motions, the variance (R,) of a carried direction, rad² an axis, and what the
    accelerometer's parameters add to it (R, 3, K), one standard error each."""
    to_level = [_attitude(up, rng.uniform(0, 2 * np.pi)) for up in u]
    turns = np.array([_vector(a.T @ b) for a, b in itertools.pairwise(to_level)])
    start, rest = _starts(len(u), seconds)
    moved = MOTION + LOST
    drift = 0.0
    for a in "xyz":
        # The turn less the bias of the rests on both sides.
        when = np.array([start[0], start[0] + rest[0], start[1]])
        three = covariance_of_means(when, np.array([rest[0], moved, rest[1]]), terms[a])
        less = np.array([-0.5, 1, -0.5])
        drift += moved**2 * (less @ three @ less) / 3
    tilt = np.mean([_noise(dict.fromkeys("xyz", accelerometer[k]), len(u), seconds)[0].diagonal().mean()
                    for k in "xyz"]) / STANDARD_GRAVITY**2  # fmt: skip
    own = np.full(len(turns), drift + 2 * tilt)
    root = np.linalg.cholesky(_of_lengths(accelerometer, u, seconds))
    rows, columns = np.nonzero(FREE[9])
    eye = np.broadcast_to(np.eye(3), (len(u), 3, 3))
    change = -np.concatenate(
        [np.eye(3)[None, :, rows] * u[:, None, columns], eye / STANDARD_GRAVITY], axis=2
    )
    change = change - u[:, :, None] * np.einsum("pi,pik->pk", u, change)[:, None, :]
    frame = change @ root
    motions = Motions(
        turns=np.repeat(turns[:, None, :] / STEPS, STEPS, axis=1),
        seconds=np.full(len(turns), moved),
        before=u[:-1],
        after=u[1:],
        frame_before=frame[:-1],
        frame_after=frame[1:],
        labels=("",) * len(turns),
    )
    carried = predicted(motions, np.eye(3))[2]
    return motions, own, carried @ frame[:-1] - frame[1:]


def _attitude(up: np.ndarray, heading: float) -> np.ndarray:
    """(3, 3) body → level with body direction `up` up."""
    first = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    c, s = np.cos(heading), np.sin(heading)
    return np.array([c * first + s * second, c * second - s * first, up])


def _vector(matrix: np.ndarray) -> np.ndarray:
    """(3,) rotation vector of a rotation matrix, rad."""
    return Rotation.from_matrix(matrix).as_rotvec()


def _tangents(directions: np.ndarray) -> np.ndarray:
    """(R, 2, 3) two unit vectors across each direction."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(directions, first)], axis=1)
