"""Star camera: share solved, wrong solutions, and errors beside their standard errors.

    python benchmarks/star_study.py [--seed 1] [--images 100]

Every image has its own made-up sky and a random attitude; 0 to 8 spots are no stars and 5 pixels are
hot. The sky goes a magnitude deeper than the catalogue. One thread.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # before numpy is imported

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.model import Camera
from sensorbook.camera.star_identify import LEAST, identify
from sensorbook.camera.star_scene import OPTICS, Optics, made_up_sky, render_stars
from sensorbook.camera.star_study import WRONG, shifted, study
from sensorbook.camera.stars import StarTable, attitude_from_stars

ARCSEC = 3600 * 180 / np.pi
# Field, pixels across, faintest magnitude of the catalogue, photoelectrons of magnitude 0.
CAMERAS = {
    "20°": (20, 512, 5.5, OPTICS.electrons),
    "14°": (14, 1024, 6.0, OPTICS.electrons),
    "6°": (6, 1024, 7.0, 1.5e6),
}
FOCAL = 4170.0  # pixels: 14° across 1024
# What is wrong, by how much the catalogue is off and is said to be, arcseconds.
FAULTS = {
    "nothing": (Camera(1024, 1024, FOCAL), 0, 0.1),
    "focal length 0.02 % long": (Camera(1024, 1024, FOCAL / 1.0002), 0, 0.1),
    "focal length 0.1 % long": (Camera(1024, 1024, FOCAL / 1.001), 0, 0.1),
    "distortion k1 = −0.05 left out": (Camera(1024, 1024, FOCAL, distortion=(-0.05, 0)), 0, 0.1),
    "catalogue errors 2″ left out": (Camera(1024, 1024, FOCAL), 2, 0.1),
    "catalogue errors 20″ left out": (Camera(1024, 1024, FOCAL), 20, 0.1),
    "catalogue errors 2″ stated": (Camera(1024, 1024, FOCAL), 2, 2),
    "catalogue errors 20″ stated": (Camera(1024, 1024, FOCAL), 20, 20),
}
STARS = 6  # from which on nearly every image should be solved


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--images", type=int, default=100)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for name, camera in CAMERAS.items():
        images(name, *camera, options.images, np.random.default_rng(options.seed))
    false_alone(10 * options.images, np.random.default_rng(options.seed))
    for fault, (lens, off, stated) in FAULTS.items():
        faults(fault, lens, off, stated, max(options.images * 2 // 5, 1), options.seed)


def images(name, field, pixels, limit, electrons, count, rng) -> None:
    camera = Camera(pixels, pixels, pixels / (2 * np.tan(np.radians(field) / 2)))
    optics = Optics(electrons=electrons)
    enough, solved, errors, said, squares, took, reasons = 0, 0, [], [], [], [], {}
    for _ in range(count):
        sky = made_up_sky(limit + 1, rng)
        table = StarTable.of(sky.brighter(limit).directions, camera)
        true = Rotation.random(rng=rng).as_matrix()
        false = int(rng.integers(0, 9))
        image = render_stars(camera, sky, true, rng, optics, false=false, hot=5)
        began = time.perf_counter()
        found = attitude_from_stars(image, camera, table, optics.gain)
        took.append(time.perf_counter() - began)
        many = camera.sees(table.directions @ true.T).sum() >= STARS
        enough += many
        reasons[found.status] = reasons.get(found.status, 0) + 1
        if found.matrix is not None:
            solved += many
            errors.append(error_vector(found.matrix, true))
            said.append([found.across_std, found.across_std, found.roll_std])
            squares.append(errors[-1] @ np.linalg.solve(found.covariance, errors[-1]))
    errors, said = np.array(errors), np.array(said)
    wrong = int((np.linalg.norm(errors, axis=-1) > WRONG).sum())
    rms, predicted = (ARCSEC * np.sqrt((e**2).mean(axis=0)) for e in (errors, said))
    ratio = rms / predicted
    largest = ARCSEC * np.linalg.norm(errors, axis=-1).max()
    print(
        f"{name}, {pixels} pixels, magnitude {limit}: solved {100 * solved / enough:.1f} % of {enough} "
        f"images with {STARS} stars or more (goal 99), wrong {wrong} of {len(errors)} (goal 0)"
    )
    print(
        f"  across {rms[0]:.2f}″ and {rms[1]:.2f}″ (goal {ARCSEC / camera.focal_px / 50:.1f}, a fiftieth "
        f"of a pixel), roll {rms[2]:.1f}″, largest {largest:.0f}″"
    )
    print(
        f"  error over predicted {ratio[0]:.2f}, {ratio[1]:.2f}, {ratio[2]:.2f} (goal 0.8 to 1.25), "
        f"squared over covariance {np.mean(squares):.2f} (goal 2.5 to 3.6)"
    )
    print(f"  {1e3 * np.median(took):.0f} ms an image (goal 100); {reasons}")


def false_alone(count, rng) -> None:
    """Spots that are no stars: none may be solved."""
    camera = Camera(1024, 1024, 4170.0)
    std, accepted, took = 0.1 / camera.focal_px, 0, []
    for k in range(count):
        if k % 50 == 0:
            table = StarTable.of(made_up_sky(6.0, rng).directions, camera)
        rays = camera.rays(rng.uniform(0, 1023, (rng.integers(LEAST, 25), 2)))
        began = time.perf_counter()
        accepted += identify(rays, np.full(len(rays), std), table).status == "ok"
        took.append(time.perf_counter() - began)
    print(
        f"false stars alone: {accepted} of {count} fields solved (goal 0), "
        f"{1e3 * np.median(took):.0f} ms a field"
    )


def faults(name, lens, off, stated, count, seed) -> None:
    """What the stars show of a lens or a catalogue that is wrong goes into the covariance, or stops it."""
    rng = np.random.default_rng(seed)
    sky, camera = made_up_sky(7.0, rng), Camera(1024, 1024, FOCAL)
    catalogue = shifted(sky.brighter(6.0).directions, off, rng)
    found = study(camera, sky, StarTable.of(catalogue, camera, stated), count, seed, taken_by=lens)
    solved = found.solved.sum()
    figures = (
        f", squared error over covariance {found.normalised.mean():.1f} (goal below 10), "
        f"misfit {found.misfit.mean():.1f}"
        if solved
        else ""
    )
    print(f"{name}: solved {solved} of {count}, wrong {found.wrong} (goal 0){figures}")


if __name__ == "__main__":
    main()
