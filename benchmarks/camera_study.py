"""Attitude from images of Earth and Sun: error, share of frames solved and time, beside work C's chain.

    python benchmarks/camera_study.py [--seed 1] [--frames 200] [--orbits leo meo geo]

Random places, Suns and attitudes with the Sun and 20° of well-lit limb in view of C's camera (table
4.2), noise 2 DN; one thread.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # before numpy is imported

import cv2
import numpy as np

from sensorbook.attitude import triad
from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.attitude import attitude_from_image
from sensorbook.camera.baseline import baseline
from sensorbook.camera.blue_marble import blue_marble
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS, WGS84, Scene, render, texture
from sensorbook.camera.study import draw
from sensorbook.errors import InputError

CAMERA = Camera(1280, 720, 369.5)
GOALS = {"leo": 0.05, "meo": 0.04, "geo": 0.04}  # degrees, mean of the whole angle
PRINTED = {"leo": (11.56, 9.18, 14.12), "meo": (0.586, 0.539, 0.549), "geo": (0.327, 0.440, 0.432)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--orbits", nargs="+", default=list(HEIGHTS), choices=list(HEIGHTS))
    options = parser.parse_args()
    cv2.setNumThreads(1)
    painted = texture(3)
    looks = {
        "full": {},
        "lambert": {"lit": "lambert"},
        "texture": {"lit": "lambert", "texture": painted},
        "oblate, haze 20 km": {"lit": "lambert", "semi_axes": WGS84, "haze": 20e3},
    }
    try:
        looks["Blue Marble"] = {"lit": "lambert", "texture": blue_marble()}
    except InputError as error:
        print(error)
    for orbit in options.orbits:
        for name, look in looks.items():
            study(orbit, name, look, options.frames, np.random.default_rng(options.seed))


def study(orbit: str, name: str, look: dict, frames: int, rng: np.random.Generator) -> None:
    ours, theirs, took = [], [], []
    for _ in range(frames):
        position, sun, attitude = draw(rng, HEIGHTS[orbit], CAMERA)
        image = render(CAMERA, Scene(position, sun, **look), attitude, rng)
        began = time.perf_counter()
        found = attitude_from_image(
            image, CAMERA, position, sun, look.get("semi_axes", (EARTH_RADIUS,) * 3)
        )
        took.append(time.perf_counter() - began)
        if found.matrix is not None:
            ours.append(np.degrees(np.linalg.norm(error_vector(found.matrix, attitude))))
        if name == "full":
            chain = baseline(image, CAMERA)
            if chain.earth_direction is not None and chain.sun_direction is not None:
                down = -position / np.linalg.norm(position)
                solved = triad([chain.sun_direction, chain.earth_direction], [sun, down])
                theirs.append(np.degrees(np.abs(error_vector(solved.matrix, attitude))))
    goal = 0.06 if "oblate" in name else GOALS[orbit]
    print(
        f"{orbit} {name}: mean {np.mean(ours):.4f}° (goal {goal}), median {np.median(ours):.4f}, "
        f"largest {np.max(ours):.3f}, solved {100 * len(ours) / frames:.1f} % (goal 97), "
        f"{1e3 * np.median(took):.0f} ms a frame (goal 80)"
    )
    if theirs:
        means = ", ".join(f"{x:.2f}" for x in np.mean(theirs, axis=0))
        printed = ", ".join(f"{x:g}" for x in PRINTED[orbit])
        print(
            f"  work C's chain: mean about the axes {means}° ({len(theirs)} frames; C prints {printed})"
        )


if __name__ == "__main__":
    main()
