"""A photograph of the Earth's limb from the space station: 56 mm lens, 36 mm sensor, 418 km high."""

import numpy as np
import pytest
from PIL import Image

from sensorbook.camera.limb import find_limb
from sensorbook.camera.model import Camera

CAMERA = Camera(4928, 2768, 56 / 36 * 4928)
EXPECTED = np.arcsin(6371 / (6371 + 418))  # 69.8°


@pytest.fixture(scope="module")
def photo(real_data):
    path = real_data / "iss-limb" / "clear_limb.jpg"
    if not path.is_file():
        pytest.skip(f"no {path}")
    return np.asarray(Image.open(path).convert("L"))


@pytest.fixture(scope="module")
def limb(photo):
    return find_limb(photo, CAMERA)


def test_angular_radius_and_residual(limb):
    assert limb.status == "ok"
    # 7.9 pixels of sagitta a degree, and a lens of unknown distortion.
    assert np.degrees(limb.angular_radius) == pytest.approx(np.degrees(EXPECTED), abs=1.0)
    # The air's edge is 60 pixels deep: it is found in an image made smaller, whose pixels these are.
    assert limb.scale == 6
    residuals = limb.residuals[limb.used]
    assert np.sqrt((residuals**2).mean()) < 1.0  # pixels of the photograph as it is
    assert limb.used.sum() > 500


def test_the_limb_lies_along_the_air(photo, limb):
    """Above it, 80 pixels on, is space; below it, air."""
    turn = np.linspace(0, 2 * np.pi, 20_000)[:, None]
    across = np.cos(turn) * limb.basis[0] + np.sin(turn) * limb.basis[1]
    rho = limb.angular_radius
    drawn = np.cos(rho) * limb.direction + np.sin(rho) * across
    x, y = np.rint(CAMERA.project(drawn[CAMERA.sees(drawn, 100)])).astype(int).T
    assert x.max() - x.min() > 4500  # from side to side
    assert np.median(photo[y - 80, x]) < 3
    assert np.percentile(photo[y - 80, x], 95) < 10
    assert np.percentile(photo[y + 60, x], 5) > 30


def test_with_the_radius_expected(photo):
    limb = find_limb(photo, CAMERA, radius=(EXPECTED, np.radians(0.5)))
    assert limb.status == "ok"
    assert np.degrees(limb.angular_radius) == pytest.approx(np.degrees(EXPECTED), abs=1.0)
