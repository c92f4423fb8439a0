"""Which star is which, without any idea of the attitude: the pyramid of Mortari and others (2004).

Angles between stars are all there is to go by. Three spots whose three angles, and whose sense of rotation,
are those of three catalogue stars are a guess at the attitude; what else it puts on a spot confirms it. How
many confirmations are enough is reckoned from chance (Mortari, Samaan, Bruccoleri and Junkins 2004,
Navigation 51, 171, for even skies): a guess is believed where chance would make one as good in fewer than one
image in a million.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree
from scipy.stats import poisson

from sensorbook.attitude import davenport
from sensorbook.camera.model import Camera
from sensorbook.errors import Refusal

LEAST = 4  # stars: three make a guess, and one confirms it
LIMIT = 1e-6  # expected false solutions an image
CATALOGUE_ARCSEC = (
    0.1  # of a star's place; catalogues from space are better, motions since add to it
)
REACH = 4.0  # standard errors that angles and places may be off
_TRIED = 20  # the brightest spots of which triangles are made
_MOST_PAIRS = 8_000_000
_LEAST_SINE = 0.1  # of a triangle's angles: in a flatter one the sense of rotation is not certain
_MOST_FALSE = (
    100  # spots beyond the stars expected; stars fainter than the catalogue's are seldom so many
)
FEW, AMBIGUOUS = "fewer than 4 stars", "ambiguous"
NONE = (
    "no match: the brightest spots are no catalogue stars, or focal length or distortion is wrong"
)
SHORT = "no match: fewer than 4 catalogue stars can be expected in view"
CROWDED = f"no match: more than {_MOST_FALSE} spots that are no catalogue stars"


@dataclass(frozen=True, eq=False)
class StarTable:
    """A catalogue made ready for one camera: all pairs of stars that fit into its field, by their angle.

    Attributes
    ----------
    directions : (N, 3), unit vectors, inertial
    angles : (P,), rad, ascending
    pairs : (P, 2), their stars
    tree : of the directions
    std : rad, standard error of a star's direction in each of the two axes across it
    mean : stars that a field holds on average, in an even sky
    """

    directions: np.ndarray
    angles: np.ndarray
    pairs: np.ndarray
    tree: cKDTree
    std: float
    mean: float

    @classmethod
    def of(
        cls, directions: ArrayLike, camera: Camera, error_arcsec: float = CATALOGUE_ARCSEC
    ) -> StarTable:
        """From unit vectors (N, 3) of a catalogue's stars, as they are seen, and the camera.

        `error_arcsec` is the standard error of their places, in each of the two axes, arcseconds.
        """
        directions = np.asarray(directions, dtype=float)
        if directions.ndim != 2 or directions.shape[1:] != (3,) or len(directions) < LEAST:
            raise ValueError(
                f"directions of shape {directions.shape}: give (N, 3), 4 stars or more"
            )
        if not (np.abs(np.linalg.norm(directions, axis=-1) - 1) < 1e-6).all():
            raise ValueError("directions: one is no unit vector; divide each by its length")
        if not 0 <= error_arcsec < np.inf:
            raise ValueError(f"error_arcsec is {error_arcsec}: give arcseconds, 0 or more")
        right, bottom = camera.width - 1, camera.height - 1
        corners = camera.rays([[0, 0], [right, 0], [0, bottom], [right, bottom]])
        widest = np.sqrt(((corners[:, None] - corners) ** 2).sum(axis=-1)).max()
        tree = cKDTree(directions)
        count = (tree.count_neighbors(tree, widest) - len(directions)) // 2
        if count > _MOST_PAIRS:
            raise Refusal(
                f"{len(directions)} stars make {count} pairs in the field, more than a table holds.",
                "Shorten the catalogue: a wide field sees enough bright stars.",
            )
        pairs = tree.query_pairs(widest, output_type="ndarray")
        angles = _angle(directions[pairs[:, 0]], directions[pairs[:, 1]])
        order = np.argsort(angles)
        std = np.radians(error_arcsec / 3600)
        mean = len(directions) * share_of_sky(camera)
        return cls(directions, angles[order], pairs[order], tree, std, mean)

    def alike(self, angle: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of stars, in both orders, as far apart as `angle` within `tolerance`, rad; by the first."""
        low, high = np.searchsorted(self.angles, [angle - tolerance, angle + tolerance])
        found = self.pairs[low:high]
        first, second = np.concatenate([found, found[:, ::-1]]).T
        order = np.argsort(first, kind="stable")
        return first[order], second[order]


def share_of_sky(camera: Camera) -> float:
    """The part of the sphere in a camera's field: two spherical triangles (Van Oosterom and Strackee 1983).

    >>> round(41253 * share_of_sky(Camera(1024, 1024, 4170.0)), 1)  # square degrees, of 14° × 14°
    195.0
    """
    right, bottom = camera.width - 0.5, camera.height - 0.5
    a, b, c, d = camera.rays([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    angle = 0.0
    for u, v, w in ((a, b, c), (a, c, d)):
        volume = abs(np.linalg.det([u, v, w]))
        angle += 2 * np.arctan2(volume, 1 + u @ v + v @ w + w @ u)
    return float(angle / (4 * np.pi))


@dataclass(frozen=True, eq=False)
class Identity:
    """Which stars the spots are.

    Attributes
    ----------
    stars : (K,), row in the catalogue, −1 for none
    status : "ok", or why there is no solution
    chance : expected number of false solutions as good as this one, in one image; NaN for none
    triangles : how many were tried
    """

    stars: np.ndarray
    status: str
    chance: float
    triangles: int


def identify(rays: np.ndarray, std: np.ndarray, table: StarTable) -> Identity:
    """Names spots by the catalogue.

    Parameters
    ----------
    rays : (K, 3), unit vectors to the spots, in any axes, the surest or brightest first
    std : (K,), rad, standard error of each across itself
    """
    rays, std = np.asarray(rays, dtype=float), np.asarray(std, dtype=float)
    none = np.full(len(rays), -1)
    if len(rays) < LEAST:
        return Identity(none, FEW, np.nan, 0)
    tried = min(len(rays), _TRIED)
    angle = _angle(rays[:tried, None], rays[None, :tried])
    tolerance = REACH * np.hypot(std[:tried, None], std[None, :tried])
    known: dict[tuple[int, int], tuple] = {}
    expected, triangles = 0.0, 0
    for triple in _triples(tried):
        sine = _sines(rays[list(triple)])
        if sine.min() < _LEAST_SINE:
            continue
        triangles += 1
        i, j, k = triple
        reach = tolerance[i, j], tolerance[i, k], tolerance[j, k]
        expected += expected_false_triangles(len(table.directions), angle[i, j], sine[2], reach)
        for pair in ((i, j), (i, k)):
            if pair not in known:
                known[pair] = table.alike(angle[pair], tolerance[pair])
        guesses = _guesses(rays, triple, angle, tolerance, known, table)
        if not len(guesses):
            continue
        trials = [_confirmed(rays, std, triple, guess, table) for guess in guesses]
        good = sorted((expected * tail, g) for g, (_, tail) in enumerate(trials))
        good = [(chance, trials[g][0]) for chance, g in good if chance < LIMIT]
        if any(_differ(good[0][1], stars) for _, stars in good[1:]):
            return Identity(none, AMBIGUOUS, np.nan, triangles)
        if good:
            return Identity(good[0][1], "ok", good[0][0], triangles)
    return Identity(none, _why_none(len(rays), table.mean), np.nan, triangles)


def _why_none(spots: int, mean: float) -> str:
    """What the counts tell: too few stars in the catalogue, too many spots for its stars, or nothing."""
    if mean < LEAST:
        return SHORT
    # Stars in a field are Poisson's: hardly ever more than four standard deviations above the mean.
    return CROWDED if spots - (mean + 4 * np.sqrt(mean)) > _MOST_FALSE else NONE


def nearest(
    rays: np.ndarray, matrix: np.ndarray, reach: np.ndarray, table: StarTable
) -> np.ndarray:
    """The catalogue's star (K,) within `reach` (K,), rad, of each spot at an attitude; −1 for none.

    Where two spots have the same nearest star, the nearer one has it.
    """
    distance, star = table.tree.query(rays @ matrix)
    star = np.where(distance < reach, star, -1)
    near_first = np.argsort(distance, kind="stable")
    near_first = near_first[star[near_first] >= 0]
    _, first = np.unique(star[near_first], return_index=True)
    kept = near_first[first]
    named = np.full(len(star), -1)
    named[kept] = star[kept]
    return named


def expected_false_triangles(stars: int, side: float, sine: float, tolerance: ArrayLike) -> float:
    """How many triples of an even sky's stars have the angles of three spots, and their sense, by chance.

    N choices for the first star; N sin θ τ₁₂ in a ring around it for the second; for the third N/4π times
    the area where two rings cross, 4 τ₁₃ τ₂₃/sin γ.

    Parameters
    ----------
    side : rad, θ from the first spot to the second
    sine : of the triangle's angle γ at the third
    tolerance : (3,), rad, τ₁₂, τ₁₃, τ₂₃ that the angles may be off
    """
    return float(stars**3 * np.sin(side) * np.prod(tolerance) / (np.pi * sine))


def expected_false_names(stars: int, rays: np.ndarray, std: np.ndarray) -> dict[int, float]:
    """How many ways chance leaves to name the first 2, 3 and 4 of spots (K, 3), known to `std` (K,), rad."""
    side, sine = _angle(rays[0], rays[1]), _sines(rays[:3])[2]
    reach = REACH * np.hypot(std[[0, 0, 1]], std[[1, 2, 2]])
    pairs = stars**2 * np.sin(side) * reach[0]
    triangles = expected_false_triangles(stars, side, sine, reach)
    fourth = stars * (REACH * std[3]) ** 2 / 4
    return {2: float(pairs), 3: triangles, 4: float(triangles * fourth)}


def _triples(count: int) -> Iterator[tuple[int, int, int]]:
    """All triples, in an order that does not stay with one spot for long, as it may be false."""
    for first in range(1, count - 1):
        for second in range(1, count - first):
            for i in range(count - first - second):
                yield i, i + first, i + first + second


def _guesses(rays, triple, angle, tolerance, known, table) -> np.ndarray:
    """Triples of stars (G, 3) with the three angles and the sense of rotation of a triple of spots."""
    i, j, k = triple
    first, second = known[i, j]
    same, third = known[i, k]
    start, stop = np.searchsorted(same, first), np.searchsorted(same, first, side="right")
    count = stop - start
    # Every pair of the first list with every pair of the second that begins with the same star.
    one = np.repeat(np.arange(len(first)), count)
    other = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + start[one]
    a, b, c = first[one], second[one], third[other]
    d = table.directions
    fits = (b != c) & (np.abs(_angle(d[b], d[c]) - angle[j, k]) < tolerance[j, k])
    a, b, c = a[fits], b[fits], c[fits]
    sense = np.linalg.det(np.stack([d[a], d[b], d[c]], axis=1)) if len(a) else np.zeros(0)
    return np.stack([a, b, c], axis=-1)[sense * np.linalg.det(rays[list(triple)]) > 0]


def _confirmed(rays, std, triple, guess, table) -> tuple[np.ndarray, float]:
    """The spots' stars (K,) by a guess, and how likely chance confirms as many; 1 where it does not hold."""
    three = list(triple)
    found = davenport(rays[three], table.directions[guess], sigma=std[three])
    # A spot errs by itself and by the guess, at most as the worst axis of it.
    guess_std = np.sqrt(np.linalg.eigvalsh(found.covariance)[-1])
    away = np.sin(_angle(rays[:, None], rays[None, three])).max(axis=1)  # from the triangle
    best = np.sqrt(np.median(np.linalg.eigvalsh(found.covariance)))
    reach = REACH * np.sqrt(std**2 + best**2 + (guess_std * away) ** 2)
    stars = nearest(rays, found.matrix, reach, table)
    if (stars[three] != guess).any():
        return stars, 1.0
    rest = np.delete(np.arange(len(rays)), three)
    more = int((stars[rest] >= 0).sum())
    mean = len(table.directions) * (1 - np.cos(reach[rest])).sum() / 2
    return stars, float(poisson.sf(more - 1, mean)) if more else 1.0


def _differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two sets of names (K,) are different places in the sky, not one with a neighbour mixed up."""
    both = (one >= 0) & (other >= 0)
    return bool((one == other)[both].sum() < LEAST - 1)


def _angle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angle, rad, between unit vectors (…, 3), right for small ones too."""
    return 2 * np.arcsin(np.minimum(np.sqrt(((one - other) ** 2).sum(axis=-1)) / 2, 1.0))


def _sines(three: np.ndarray) -> np.ndarray:
    """Sines (3,) of a triangle's angles at its corners (3, 3), unit vectors."""
    volume = abs(np.linalg.det(three))
    side = [np.sin(_angle(three[m], three[n])) for m, n in ((1, 2), (0, 2), (0, 1))]
    across = np.array([side[1] * side[2], side[0] * side[2], side[0] * side[1]])
    return volume / np.maximum(across, 1e-30)
