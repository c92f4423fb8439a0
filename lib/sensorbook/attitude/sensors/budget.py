"""What makes up a sensor's accuracy: named errors, each simulated alone and all together (C, table 3.1).

The sizes are computed where that is possible, else assumptions of the usual order, declared here with
their reason; they were not adjusted to C's figures. An error is counted in each of the two axes across
the measured direction: √(mean angle² / 2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sensorbook.attitude.rotations import axis_rotation
from sensorbook.attitude.sensors import conical, horizon, magnetic, star, sun
from sensorbook.earth import SPACE_FIELD

ARCSECOND, ARCMINUTE, DEGREE = np.pi / 648000, np.pi / 10800, np.pi / 180
SEMI_AXES = (6378137.0, 6378137.0, 6356752.314)  # m, WGS 84


@dataclass(frozen=True)
class Contribution:
    """One source of error.

    Attributes
    ----------
    sensor, name : as in `TABLE`
    size : one standard deviation an axis, in `unit`; 1 switches on what has no size
    origin : where the size comes from, and whether it is assumed
    """

    sensor: str
    name: str
    size: float
    unit: str
    origin: str


@dataclass(frozen=True)
class Accuracy:
    """A sensor's accuracy.

    Attributes
    ----------
    sensor : in words
    alone : rms error, rad, of each contribution by name
    together : rms error, rad, of all
    printed : work C's figure, rad
    refused : share of samples without a result, with all contributions
    """

    sensor: str
    alone: Mapping[str, float]
    together: float
    printed: float
    refused: float

    @property
    def ratio(self) -> float:
        """Together over printed."""
        return self.together / self.printed


# Work C, table 3.1.
TABLE = {
    "star sensor": ARCSECOND,
    "Sun sensor": ARCMINUTE,
    "horizon sensor": 0.1 * DEGREE,
    "magnetometer": 0.5 * DEGREE,
}

CONTRIBUTIONS = (
    Contribution(
        "star sensor",
        "centroid noise",
        0.1,
        "pixel",
        "assumed: plain centres of mass, uncalibrated",
    ),
    Contribution(
        "star sensor", "focal length", 10.0, "ppm", "assumed: thermal growth after calibration"
    ),
    Contribution("star sensor", "alignment", 1.0, "″", "assumed: thermal bending of the mounting"),
    Contribution(
        "Sun sensor", "pixel quantisation", 1.0, "", "computed: 7 µm pixels 10 mm under the slit"
    ),
    Contribution("Sun sensor", "alignment", 0.5, "′", "assumed: accuracy of the survey"),
    Contribution(
        "horizon sensor",
        "infrared horizon",
        3.0,
        "km",
        "assumed: weather and season in the CO₂ band",
    ),
    Contribution(
        "horizon sensor",
        "oblateness neglected",
        1.0,
        "",
        "computed: WGS 84 read as a sphere (C 3.5)",
    ),
    Contribution(
        "horizon sensor",
        "crossing noise",
        0.02,
        "°",
        "assumed: detector noise over the limb's slope",
    ),
    Contribution(
        "magnetometer",
        "field model",
        1e6 * SPACE_FIELD,
        "µT",
        "bound of the IGRF in low orbit, without storms",
    ),
    Contribution("magnetometer", "bias", 0.2, "µT", "assumed: the satellite's own magnets"),
    Contribution("magnetometer", "noise", 0.02, "µT", "assumed: a magnetoresistive sensor"),
    Contribution("magnetometer", "alignment", 0.1, "°", "assumed: axes of sensor and body"),
)


def accuracies(
    seed: int = 0,
    samples: int = 1000,
    height: float = 700e3,
    contributions: tuple[Contribution, ...] = CONTRIBUTIONS,
) -> tuple[Accuracy, ...]:
    """Accuracy of the sensors of table 3.1 that have contributions, over random attitudes and places.

    `height` is that of the orbit, m, which horizon sensor and magnetometer depend on.
    """
    if samples < 10:
        raise ValueError(f"samples is {samples}: give ten or more")
    found = []
    for sensor, printed in TABLE.items():
        own = {c.name: c.size for c in contributions if c.sensor == sensor}
        if not own:
            continue
        sizes = {c.name: 0.0 for c in CONTRIBUTIONS if c.sensor == sensor} | own
        alone = {}
        for name in own:
            only = {n: size if n == name else 0.0 for n, size in sizes.items()}
            alone[name] = _rms(
                _SIMULATIONS[sensor](only, samples, height, np.random.default_rng(seed))
            )
        all_ = _SIMULATIONS[sensor](sizes, samples, height, np.random.default_rng(seed))
        refused = float(np.isnan(all_).mean())
        found.append(Accuracy(sensor, alone, _rms(all_), printed, refused))
    return tuple(found)


def _rms(angles: np.ndarray) -> float:
    """Of total angles (N,), an axis; refused samples are left out."""
    known = angles[np.isfinite(angles)]
    return float(np.sqrt((known**2).mean() / 2)) if known.size else float("nan")


def _between(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.arcsin(np.clip(np.linalg.norm(np.cross(found, true), axis=-1), 0, 1))


def _attitudes(rng: np.random.Generator, count: int, most: float) -> np.ndarray:
    """Body from the nadir frame with tilts up to `most`, rad, and any yaw."""
    roll, pitch = rng.uniform(-most, most, (2, count))
    return horizon.tilted(roll, pitch, rng.uniform(-np.pi, np.pi, count))


def _turned(vectors: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """Vectors (N, 3) with an alignment error of `size`, rad an axis."""
    return vectors + np.cross(vectors, size * rng.standard_normal(vectors.shape))


def _star(sizes, samples, height, rng):
    count = min(samples, 400)  # an image is a hundred times as dear as a vector
    camera = star.StarSensor.of_field(np.radians(8), np.radians(8), 1024)
    sky = star.reference_vectors(
        *star.random_sky(round(star.catalogue_size(10, *(np.radians(8),) * 2)), rng)
    )
    angles = np.full(count, np.nan)
    for i in range(count):
        body = horizon.tilted(*rng.uniform(-np.pi, np.pi, 3))
        offset = ARCSECOND * sizes["alignment"] * rng.standard_normal(3)
        stretch = 1 + 1e-6 * sizes["focal length"] * rng.standard_normal()
        seen = star.take_image(camera, body, sky)
        noise = rng.standard_normal(seen.places.shape)
        places = camera.centre + stretch * (seen.places - camera.centre)
        image = star.Image(seen.stars, places + sizes["centroid noise"] * noise)
        fix = star.attitude(camera, image, sky)
        mounted = np.eye(3) - np.cross(np.eye(3), offset)
        if fix.solution is not None:
            angles[i] = _between((mounted @ fix.matrix)[2], body[2])  # of the boresight
    return angles


def _sun(sizes, samples, height, rng):
    sensor = sun.SlitSensor(10e-3, 7e-6, 2048)
    across = np.tan(rng.uniform(-0.8, 0.8, (samples, 2)) * sensor.half_field)
    true = np.concatenate([np.ones((samples, 1)), across], axis=1)
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    seen = _turned(true, ARCMINUTE * sizes["alignment"], rng)
    if sizes["pixel quantisation"]:
        seen = sensor.direction(sensor.read(seen)).direction
    return _between(seen / np.linalg.norm(seen, axis=1, keepdims=True), true)


def _horizon(sizes, samples, height, rng):
    cone = np.radians(45)
    body = _attitudes(rng, samples, np.radians(10))
    distance = conical.RADIUS + height
    # Places on a sphere, where the satellite is anywhere above the ellipsoid.
    longitude, sine = rng.uniform(-np.pi, np.pi, samples), rng.uniform(-1, 1, samples)
    nadir_from_earth = axis_rotation("Y", -np.arcsin(sine) - np.pi / 2) @ axis_rotation(
        "Z", longitude
    )
    attitude = body @ nadir_from_earth
    position = -distance * nadir_from_earth[:, 2]
    shape = np.asarray(SEMI_AXES if sizes["oblateness neglected"] else (conical.RADIUS,) * 3)
    heights = conical.EQUIVALENT_HEIGHT + 1e3 * sizes["infrared horizon"] * rng.standard_normal(
        (2, samples)
    )
    at_enter, at_leave = (
        conical.scan_ellipsoid(attitude, position, shape + h[:, None], cone) for h in heights
    )
    noise = DEGREE * sizes["crossing noise"] * rng.standard_normal((2, samples))
    crossings = conical.Scan(at_enter.enter + noise[0], at_leave.leave + noise[1], at_enter.reasons)
    return _between(horizon.one_cone(crossings, height, cone).nadir, body[:, :, 2])


def _magnetometer(sizes, samples, height, rng):
    orbit = magnetic.field_along_orbit(height, np.radians(98), "2026-01-01T00:00", 200, 15.0)
    field = orbit.ned[rng.integers(0, len(orbit.ned), samples)]
    body = horizon.tilted(*rng.uniform(-np.pi, np.pi, (3, samples)))
    true = np.einsum("nij,nj->ni", body, field)
    wrong = 1e-6 * sizes["field model"] * rng.standard_normal((samples, 3))
    bias = 1e-6 * sizes["bias"] * rng.standard_normal((samples, 3))
    noise = 1e-6 * sizes["noise"] * rng.standard_normal((samples, 3))
    raw = _turned(magnetic.readings(body, field + wrong), DEGREE * sizes["alignment"], rng)
    seen = magnetic.field_direction(raw + bias + noise).direction
    return _between(seen, true / np.linalg.norm(true, axis=1, keepdims=True))


_SIMULATIONS = {
    "star sensor": _star,
    "Sun sensor": _sun,
    "horizon sensor": _horizon,
    "magnetometer": _magnetometer,
}
