"""The camera's studies: what is drawn keeps its promises, and what is called well chosen is so."""

import numpy as np
import pytest

from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS
from sensorbook.camera.study import CAMERA, both_in_view, draw, looks, trials

LEO = EARTH_RADIUS + HEIGHTS["leo"]


def ring(position, count=720):
    """Directions to the limb of the sphere, by points of the ground whose normal is across the sight."""
    distance = np.linalg.norm(position)
    up = position / distance
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first /= np.linalg.norm(first)
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    around = np.cos(turn) * first + np.sin(turn) * np.cross(up, first)
    sine = EARTH_RADIUS / distance
    normals = sine * up + np.sqrt(1 - sine**2) * around
    sights = EARTH_RADIUS * normals - position
    return sights / np.linalg.norm(sights, axis=1, keepdims=True), normals


@pytest.mark.parametrize("orbit", HEIGHTS)
def test_what_is_drawn_shows_both(orbit):
    rng = np.random.default_rng(1501)
    for _ in range(20):
        position, sun, attitude = draw(rng, HEIGHTS[orbit], CAMERA)
        distance = np.linalg.norm(position)
        assert distance == pytest.approx(EARTH_RADIUS + HEIGHTS[orbit])
        assert np.linalg.norm(sun) == pytest.approx(1)
        np.testing.assert_allclose(attitude @ attitude.T, np.eye(3), atol=1e-12)
        assert CAMERA.sees(attitude @ sun)
        apart = np.arccos(-position @ sun / distance)
        assert apart > np.arcsin(EARTH_RADIUS / distance) + np.radians(1.99)
        limb, normals = ring(position)
        lit = CAMERA.sees(limb @ attitude.T) & (normals @ sun > 0.15)
        # 20 of 360 by whole degrees; counted here by halves of one.
        assert lit.sum() >= 38


def test_both_in_view():
    position = np.array([0, 0, -LEO])
    turned = np.radians(50)  # the Earth's centre 50° to the left of the axis
    to_camera = np.array([
        [np.cos(turned), 0, -np.sin(turned)], [0, 1, 0], [np.sin(turned), 0, np.cos(turned)]
    ])  # fmt: skip

    def sun(away):
        """`away` degrees from the Earth's centre, on the camera's side."""
        return np.array([np.sin(np.radians(away)), 0, np.cos(np.radians(away))])

    assert both_in_view(position, sun(85), to_camera, CAMERA)
    assert not both_in_view(position, sun(51), to_camera, CAMERA), "hardly clear of the limb"
    assert not both_in_view(position, sun(115), to_camera, CAMERA), "out of the image"
    assert not both_in_view(position, sun(55), to_camera, CAMERA), "a crescent that is too faint"
    behind = np.diag([-1.0, 1, -1])
    assert not both_in_view(position, sun(85), behind @ to_camera, CAMERA)


@pytest.mark.parametrize("orbit", HEIGHTS)
def test_chosen_pictures(orbit):
    tried = list(trials(orbit, {}, 3, np.random.default_rng(1502), chosen=True))
    assert len(tried) == 3
    radius = np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + HEIGHTS[orbit]))
    for trial in tried:
        assert trial.as_chosen
        assert trial.radius == pytest.approx(radius)
        assert np.radians(20) <= trial.lit_arc < np.pi
        assert trial.off_axis == pytest.approx(np.arccos(trial.to_earth[2]))
        assert trial.chain is None
        assert CAMERA.sees(trial.to_earth), "its centre at least"
        assert trial.larger == (np.tan(radius) > CAMERA.height / 2 / CAMERA.focal_px)
        assert trial.larger == (orbit == "leo")
        if not trial.larger:
            assert trial.whole
        assert np.linalg.norm(trial.error) < np.radians(0.05)


def test_not_every_picture_is_chosen():
    tried = list(trials("meo", {}, 6, np.random.default_rng(1503)))
    assert {t.as_chosen for t in tried} == {True, False}
    assert all(t.as_chosen == t.whole for t in tried), "from MEO the disc fits into the picture"


def test_both_ways_of_one_picture():
    (trial,) = trials("geo", {}, 1, np.random.default_rng(1504), chain=True, chosen=True)
    assert trial.chain.status == trial.found.status == "ok"
    assert np.linalg.norm(trial.error) < np.linalg.norm(trial.chain_error)
    # The Sun's pixel is known to 0.1 px at least.
    np.testing.assert_allclose(trial.found.sun.direction, trial.to_sun, atol=0.1 / CAMERA.focal_px)


def test_looks_are_scenes():
    assert list(looks()) == ["full", "lambert", "textured", "oblate, 20 km of haze"]
