"""Simulated studies of the star camera: errors, standard errors and the share of the sky it works in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude import davenport
from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.model import Camera
from sensorbook.camera.star_identify import LEAST, StarTable, identify
from sensorbook.camera.star_scene import OPTICS, Optics, Sky, made_up_sky, render_stars
from sensorbook.camera.stars import attitude_from_stars, pixel_angle

WRONG = np.radians(
    0.1
)  # an error so large is a wrong solution: twenty times what few stars leave in roll


@dataclass(frozen=True, eq=False)
class StarStudy:
    """What images at random attitudes gave.

    Attributes
    ----------
    statuses : (N,), of every image
    stars : (N,), how many of the catalogue's stars are in view
    errors : (S, 3), rad, rotation vectors in body axes, of the solved ones
    covariance : (S, 3, 3), rad², what they were said to be
    misfit : (S,)
    """

    statuses: np.ndarray
    stars: np.ndarray
    errors: np.ndarray
    covariance: np.ndarray
    misfit: np.ndarray

    @property
    def solved(self) -> np.ndarray:
        """(N,), which images have an attitude."""
        return self.statuses == "ok"

    @property
    def wrong(self) -> int:
        """How many attitudes are wrong, by far more than their errors."""
        return int((np.linalg.norm(self.errors, axis=-1) > WRONG).sum())

    @property
    def normalised(self) -> np.ndarray:
        """(S,), errors squared over their covariance: χ² of three degrees of freedom where it is right."""
        turned = np.linalg.solve(self.covariance, self.errors[..., None])[..., 0]
        return (self.errors * turned).sum(axis=-1)


def study(
    camera: Camera,
    sky: Sky,
    table: StarTable,
    images: int,
    seed: int,
    optics: Optics = OPTICS,
    taken_by: Camera | None = None,
    **scene,
) -> StarStudy:
    """Renders and reads images at random attitudes; `scene` is as for `render_stars`.

    `taken_by` is the true camera, where it is not the one that the images are read with.
    """
    rng = np.random.default_rng(seed)
    statuses, stars, solved = [], [], []
    for _ in range(images):
        true = Rotation.random(rng=rng).as_matrix()
        image = render_stars(taken_by or camera, sky, true, rng, optics, **scene)
        found = attitude_from_stars(image, camera, table, optics.gain, optics.spread)
        statuses.append(found.status)
        stars.append(camera.sees(table.directions @ (camera.to_body.T @ true).T).sum())
        if found.matrix is not None:
            solved.append((error_vector(found.matrix, true), found.covariance, found.misfit))
    errors, covariance, misfit = zip(*solved, strict=True) if solved else ([], [], [])
    return StarStudy(
        np.array(statuses),
        np.array(stars),
        np.reshape(errors, (-1, 3)),
        np.reshape(covariance, (-1, 3, 3)),
        np.array(misfit),
    )


def shifted(directions: np.ndarray, arcsec: float, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors (N, 3) with an error of `arcsec` rms in each of the two axes across them."""
    moved = directions + np.radians(arcsec / 3600) * rng.normal(size=directions.shape)
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


def share_solved(
    camera: Camera, limits: np.ndarray, std: float, runs: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of random attitudes at which catalogues up to magnitudes `limits` (M,) are long enough.

    Stars are taken as seen, with middles known to `std` pixels. Returns the share (M,) with four stars in
    view, the share solved, and the mean number of stars in view.
    """
    rng = np.random.default_rng(seed)
    sky = made_up_sky(max(limits), rng)
    enough, solved, mean = np.zeros((3, len(limits)))
    for m, limit in enumerate(limits):
        own = sky.brighter(limit)
        if len(own.magnitudes) < LEAST:
            continue
        table = StarTable.of(own.directions, camera)
        for _ in range(runs):
            true = Rotation.random(rng=rng).as_matrix()
            seen = own.directions @ true.T
            inside = np.flatnonzero(camera.sees(seen))
            pixels = camera.project(seen[inside[np.argsort(own.magnitudes[inside])]])
            pixels = pixels + rng.normal(0, std, pixels.shape)
            mean[m] += len(inside) / runs
            enough[m] += (len(inside) >= LEAST) / runs
            named = identify(
                camera.rays(pixels), np.full(len(pixels), std / camera.focal_px), table
            )
            solved[m] += (named.status == "ok") / runs
    return enough, solved, mean


def accuracy(
    camera: Camera, count: int, std: float, runs: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rms errors across and about the axis (2,), rad, simulated and predicted, with `count` stars in view.

    The stars are anywhere in the image, named, and their middles known to `std` pixels.
    """
    rng = np.random.default_rng(seed)
    corner = [camera.width - 0.5, camera.height - 0.5]
    true = camera.rays(rng.uniform([-0.5, -0.5], corner, (runs, count, 2)))
    pixels = camera.project(true)
    seen = camera.rays(pixels + rng.normal(0, std, pixels.shape))
    found = davenport(seen, true, sigma=std * pixel_angle(seen, camera))
    errors = error_vector(found.matrix, np.eye(3)) ** 2
    variance = np.diagonal(found.covariance, axis1=-2, axis2=-1)
    both = [
        np.sqrt([np.nanmean(v[:, :2]), np.nanmean(v[:, 2])]) for v in (errors, variance)
    ]  # roots of means over the images
    return both[0], both[1]
