"""What the accuracy of an attitude from Earth and Sun hangs on, and work C's reference vector of the Sun."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from sensorbook.attitude import triad
from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.attitude import attitude_from_image, expected_radius
from sensorbook.camera.ellipse import direct_ellipse
from sensorbook.camera.limb import Limb, across_of, cone, find_limb
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS, SUN_DISTANCE, Scene, render
from sensorbook.camera.steps import centre_bias
from sensorbook.camera.study import CAMERA, Trial, draw

# C, table 4.5: the Sun's reference vector at three places on each orbit, and its standard deviation.
SUN_VECTORS = {
    "leo": (
        (0.523176, -0.523227, -0.672696),
        (0.523183, -0.523198, -0.672714),
        (0.523189, -0.523213, -0.672696),
    ),
    "meo": (
        (0.523116, -0.523276, -0.672705),
        (0.523109, -0.523215, -0.672758),
        (0.523156, -0.523239, -0.672702),
    ),
    "geo": (
        (0.523063, -0.523320, -0.672711),
        (0.523057, -0.523207, -0.672805),
        (0.523122, -0.523279, -0.672698),
    ),
}
SUN_VECTORS_STD = (4.9499e-05, 4.1189e-05, 3.7027e-05)


def distance(orbit: str) -> float:
    """Of an orbit of C's from the Earth's centre, m."""
    return EARTH_RADIUS + HEIGHTS[orbit]


def angular_radius(orbit: str) -> float:
    """Of C's Earth, seen from one of its orbits, rad."""
    return float(np.arcsin(EARTH_RADIUS / distance(orbit)))


# --- the ellipse's centre ---


def exact_errors(off: float, radius: float) -> tuple[float | None, float]:
    """How far ellipse and cone through an exact limb are from the Earth's direction, rad.

    The limb of angular `radius` about a direction `off` the camera's axis, both rad; of it the half that
    is nearest to the axis, so that it is before the camera. None where it is no ellipse.

    >>> ellipse, by_cone = exact_errors(np.radians(10), np.radians(49.56))
    >>> round(float(np.degrees(ellipse)), 1), by_cone < 1e-12
    (13.6, True)
    """
    down = np.array([np.sin(off), 0, np.cos(off)])
    toward, side = np.array([-np.cos(off), 0, np.sin(off)]), np.array([0, 1.0, 0])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 200)[:, None]
    rays = np.cos(radius) * down + np.sin(radius) * (np.cos(turn) * toward + np.sin(turn) * side)
    rays = rays[rays[:, 2] > 0.05]
    by_cone = _angle(cone(rays)[0], down)
    if off + radius >= np.pi / 2:
        return None, by_cone
    middle = direct_ellipse(CAMERA.project(rays)).centre
    return _angle(CAMERA.rays(middle), down), by_cone


def by_formula(trial: Trial, radius: float) -> tuple[float, float] | None:
    """What the ellipse's centre alone would cost: of the Earth's direction, and of TRIAD's attitude, rad.

    None where the limb of angular `radius`, rad, is no ellipse.
    """
    bias = centre_bias(trial.off_axis, radius)
    if bias is None:
        return None
    outward = trial.to_earth[2] * trial.to_earth - [0, 0, 1.0]
    outward /= max(np.linalg.norm(outward), 1e-12)
    wrong = np.cos(bias) * trial.to_earth + np.sin(bias) * outward
    # As if the body stood along the inertial axes: only the difference counts.
    matrix = triad([trial.to_sun, wrong], [trial.to_sun, trial.to_earth]).matrix
    return bias, float(np.linalg.norm(error_vector(matrix, np.eye(3))))


# --- many trials ---


@dataclass(frozen=True)
class Summary:
    """Of many trials: how many, how many solved, whole errors (rad) and the error over its covariance.

    `statuses` counts the reasons of those that were not solved. Errors are None where none was.
    """

    count: int
    solved: int
    mean: float | None
    median: float | None
    largest: float | None
    squared: float | None
    statuses: dict[str, int]


def summarise(trials: Sequence[Trial]) -> Summary:
    """The errors of this house's way over trials."""
    errors = [float(np.linalg.norm(t.error)) for t in trials if t.error is not None]
    squares = [t.squared for t in trials if t.squared is not None]
    reasons = Counter(t.found.status for t in trials if t.error is None)
    found = (np.mean, np.median, np.max) if errors else ()
    values = [float(of(errors)) for of in found] or [None] * 3
    squared = float(np.mean(squares)) if squares else None
    return Summary(len(trials), len(errors), *values, squared, dict(reasons))


def binned(x: np.ndarray, y: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Rows (middle of x, median, least and largest y) for each bin of x that holds something."""
    x, y = np.asarray(x), np.asarray(y)
    place = np.digitize(x, edges)
    return np.array([
        [np.median(x[place == k]), np.median(y[place == k]), y[place == k].min(), y[place == k].max()]
        for k in np.unique(place)
    ]).reshape(-1, 4)  # fmt: skip


def arc(trial: Trial) -> float:
    """How much of the circle about the Earth's centre the limb in the picture spans, rad."""
    limb = trial.found.limb
    first, second = across_of(limb.direction)
    rays = limb.rays[limb.used]
    turn = np.sort(np.arctan2(rays @ second, rays @ first))
    return float(2 * np.pi - np.diff(turn, append=turn[0] + 2 * np.pi).max())


def alike(orbit: str, shown: Mapping[str, dict], seed: int) -> dict[str, tuple[np.ndarray, Limb]]:
    """One scene with several looks of the Earth: image and limb by look; {} where none of 20 suits all."""
    rng = np.random.default_rng(seed)
    for position, sun, attitude in scenes(orbit, 20, rng):
        found = {}
        for name, look in shown.items():
            image = render(CAMERA, Scene(position, sun, **look), attitude, rng)
            axes = look.get("semi_axes", (EARTH_RADIUS,) * 3)
            found[name] = image, attitude_from_image(image, CAMERA, position, sun, axes)
        if all(one.status == "ok" and one.limb.scale == 1 for _, one in found.values()):
            return {name: (image, one.limb) for name, (image, one) in found.items()}
    return {}


# --- one thing at a time ---


@dataclass(frozen=True)
class Varied:
    """Rms over the same scenes: whole error, that predicted, and the Sun's direction alone, rad.

    `statuses` counts the reasons of scenes that were not solved, which are left out of the rms.
    """

    statuses: dict[str, int]
    solved: int
    error: float | None
    predicted: float | None
    sun: float | None


def scenes(orbit: str, count: int, rng: np.random.Generator) -> list[tuple]:
    """Places, Suns and attitudes as `draw` gives them, to be looked at in several ways."""
    return [draw(rng, distance(orbit) - EARTH_RADIUS, CAMERA) for _ in range(count)]


def looked_at(drawn: Sequence[tuple], camera: Camera, noise: float, seed: int) -> Varied:
    """The errors of this house's way over scenes of a fully lit Earth; `noise` in DN."""
    rng = np.random.default_rng(seed)
    rows, reasons = [], Counter()
    for position, sun, attitude in drawn:
        image = render(camera, Scene(position, sun, noise=noise), attitude, rng)
        found = attitude_from_image(image, camera, position, sun)
        if found.matrix is not None:
            error = error_vector(found.matrix, attitude)
            off = _angle(found.sun.direction, attitude @ sun)
            rows.append([error @ error, np.trace(found.covariance), off**2])
        else:
            reasons[found.status] += 1
    if not rows:
        return Varied(dict(reasons), 0, None, None, None)
    return Varied(dict(reasons), len(rows), *map(float, np.sqrt(np.mean(rows, axis=0))))


def scaled(camera: Camera, factor: float) -> Camera:
    """A camera with as wide a view and `factor` times as many pixels across."""
    width, height = round(camera.width * factor), round(camera.height * factor)
    return Camera(width, height, camera.focal_px * width / camera.width)


HAZE_WAYS = ("fixed to the ground", "free", "with a prior")


def haze_errors(
    orbit: str, haze: float, count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Errors (n,), rad, of the direction to an Earth with air, by how its angular radius is treated."""
    size = distance(orbit)
    radii = (angular_radius(orbit), 1e-7), None, expected_radius(size, EARTH_RADIUS)
    ways = dict(zip(HAZE_WAYS, radii, strict=True))
    errors = {way: [] for way in ways}
    for position, sun, attitude in scenes(orbit, count, rng):
        image = render(CAMERA, Scene(position, sun, lit="lambert", haze=haze), attitude, rng)
        for way, radius in ways.items():
            limb = find_limb(image, CAMERA, attitude @ sun, radius)
            if limb.direction is not None:
                errors[way].append(_angle(limb.direction, attitude @ -position / size))
    return {way: np.array(found) for way, found in errors.items()}


def crescent_statuses(
    orbit: str, gap: float, look: dict, count: int, rng: np.random.Generator
) -> list[str]:
    """What came of pictures with the Sun `gap`, rad, above the limb, and the limb below it in view."""
    statuses = []
    while len(statuses) < count:
        down = rng.normal(size=3)
        down /= np.linalg.norm(down)
        side = across_of(down)[0]
        beside, to_sun = angular_radius(orbit), angular_radius(orbit) + gap
        limb, sun = (np.cos(a) * down + np.sin(a) * side for a in (beside, to_sun))
        attitude = Rotation.random(rng=rng).as_matrix()
        if not CAMERA.sees(np.array([limb, sun, down]) @ attitude.T, 20).all():
            continue
        position = -down * distance(orbit)
        image = render(CAMERA, Scene(position, sun, **look), attitude, rng)
        statuses.append(attitude_from_image(image, CAMERA, position, sun).status)
    return statuses


# --- the Sun's reference vector ---


def sun_vectors(orbit: str, sun: np.ndarray, count: int = 360) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (count, 3) to the Sun around an orbit, and how far each is from `sun`, rad.

    `sun` (3,) is the direction from the Earth's centre, to a Sun at C's 149.6 million km. C prints no
    orbital plane; this one is that of x and y, as in the scene's chapter.
    """
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = distance(orbit) * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    to_sun = SUN_DISTANCE * np.asarray(sun) - places
    to_sun /= np.linalg.norm(to_sun, axis=-1, keepdims=True)
    return to_sun, np.arcsin(np.linalg.norm(np.cross(to_sun, sun), axis=-1))


def from_earth(vectors: dict[str, Sequence] = SUN_VECTORS) -> tuple[np.ndarray, float]:
    """The direction (3,) from the Earth that printed vectors may belong to, and how well it suits them.

    Seen from a satellite the Sun is off it by no more than the orbit's radius over the Sun's distance.
    The largest share of that which any vector takes is made least: above 1 no direction suits all.
    """
    printed = np.array([v for rows in vectors.values() for v in rows])
    most = np.array([distance(o) / SUN_DISTANCE for o, rows in vectors.items() for _ in rows])
    middle = printed.mean(axis=0) / np.linalg.norm(printed.mean(axis=0))
    across = across_of(middle)

    def worst(move):
        return (np.linalg.norm(printed - middle - 1e-4 * move @ across, axis=-1) / most).max()

    best = minimize(worst, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-6})
    found = middle + 1e-4 * best.x @ across
    return found / np.linalg.norm(found), float(best.fun)


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
