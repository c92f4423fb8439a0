"""What images of Earth and Sun must show, and how well one then tells the attitude.

An image's covariance comes from its own edge points; there is no formula before it is taken. Scenes of work
C's camera are rendered instead and measured by the chapter's way. The error is a share of a pixel, so that it
goes as the inverse of the focal length in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SCENES = 4
SEED = 1
NOISE = 2.0  # DN of a pixel


@dataclass(frozen=True)
class Image:
    """A focal length (pixels) and the standard error of the whole attitude angle there, rad."""

    focal_px: float
    std: float


def planned(std: float, orbit: str = "leo") -> tuple[Image, Image]:
    """Work C's camera, and the focal length that an error of `std` (rad) needs."""
    from sensorbook.camera.accuracy import looked_at, scenes
    from sensorbook.camera.study import CAMERA

    found = looked_at(scenes(orbit, SCENES, np.random.default_rng(SEED)), CAMERA, NOISE, SEED)
    if found.predicted is None:  # no such scene of these seeds
        raise ValueError(f"no scene was solved: {found.statuses}")
    own = Image(CAMERA.focal_px, found.predicted)
    needed = max(1.0, own.std / std) * own.focal_px
    return own, Image(needed, own.std * own.focal_px / needed)
