"""The limb: the cone exactly, edges and fit on renders, and images that show no limb."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.camera.edges import find_edges
from sensorbook.camera.limb import cone, find_limb, fit_limb
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import EARTH_RADIUS, Scene, render, texture

CAMERA = Camera(640, 480, 250.0)  # 104° × 88°
DISTANCE = EARTH_RADIUS + 8000e3
RHO = np.arcsin(EARTH_RADIUS / DISTANCE)  # 26.3°
BLACK = np.zeros((480, 640), np.uint8)


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


def shot(down, sun, seed, distance=DISTANCE, **look):
    """An image whose camera has the nadir at `down` and the Sun at `sun`, both in its own axes."""
    scene = Scene(-distance * unit(down), unit(sun), **look)
    return render(CAMERA, scene, np.eye(3), np.random.default_rng(seed))


@cache
def frames(lit):
    """Twelve of (nadir, Sun, image): the limb whole or cut by the image's edge, the Sun to the side."""
    rng = np.random.default_rng(61)
    made = []
    for k in range(12):
        down = unit(CAMERA.rays(rng.uniform([160, 120], [480, 360])))
        side = unit(np.cross(down, rng.normal(size=3)))
        angle = rng.uniform(np.radians(70), np.radians(110))
        sun = np.cos(angle) * down + np.sin(angle) * side
        made.append((down, sun, shot(down, sun, 62 + k, lit=lit)))
    return made


def moon(image, x, y, radius, level=180.0):
    """The image with a bright disc, its rim covered in part."""
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    part = np.clip(radius - np.hypot(columns - x, rows - y) + 0.5, 0, 1)
    return np.rint(image * (1 - part) + level * part).astype(np.uint8)


@pytest.mark.parametrize("arc", [5, 10, 40, 120, 360])
@pytest.mark.parametrize("radius", [8.6, 30, 60, 80])
def test_cone_of_a_partial_arc(arc, radius):
    """From GEO's Earth to one that fills the view."""
    turn = Rotation.random(rng=np.random.default_rng(63)).as_matrix()
    around = np.radians(np.linspace(0, arc, 400))
    rho = np.radians(radius)
    rays = np.stack(
        [
            np.sin(rho) * np.cos(around),
            np.sin(rho) * np.sin(around),
            np.full(400, np.cos(rho)),
        ],
        axis=-1,
    )
    direction, found = cone(rays @ turn.T)
    # Rounding grows with the arc's flatness, 1/(sin ρ · (1 − cos half arc)): 1e4 at the worst.
    tolerance = 1e-12 if arc * radius > 100 else 1e-11
    np.testing.assert_allclose(direction, turn[:, 2], rtol=0, atol=tolerance)
    assert found == pytest.approx(rho, abs=tolerance)


@pytest.mark.parametrize("lit", ["full", "lambert"])
def test_direction_and_radius_within_their_standard_errors(lit):
    """Errors squared over variances: medians of 1.4 for two numbers and 0.5 for one, were they normal."""
    directions, radii = [], []
    for down, sun, image in frames(lit):
        edges = find_edges(image, CAMERA, CAMERA.project(sun))
        limb = fit_limb(edges, CAMERA, sun if lit == "lambert" else None)
        assert limb.status == "ok"
        assert limb.scale == 1
        off = limb.residuals[limb.used]
        assert np.sqrt((off**2).mean()) < 0.25  # noise of 2 in 200 DN, and dark limb
        assert np.degrees(limb.std) < 0.2
        error = limb.basis @ down
        directions.append(error @ np.linalg.solve(limb.covariance[:2, :2], error))
        radii.append((limb.angular_radius - RHO) ** 2 / limb.covariance[2, 2])
    assert np.median(directions) < 3
    assert np.median(radii) < 3
    assert max(*directions, *radii) < 25


def test_off_the_axis_the_cone_has_no_bias():
    """The imaged ellipse's centre lies 2.9° off here; the cone is as good as on the axis."""
    down = unit([np.sin(np.radians(30)), 0, np.cos(np.radians(30))])
    limb = find_limb(shot(down, -down, 64), CAMERA)
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.01
    assert limb.angular_radius == pytest.approx(RHO, abs=np.radians(0.01))


def test_edges_are_as_good_as_they_say():
    down = unit([0.1, 0.2, 1])
    edges = find_edges(shot(down, -down, 65), CAMERA)
    assert len(edges.pixels) > 300
    np.testing.assert_allclose(np.linalg.norm(edges.inward, axis=-1), 1, atol=1e-6)
    middle = CAMERA.project(down)
    assert (((middle - edges.pixels) * edges.inward).sum(axis=-1) > 0).all()
    rays = CAMERA.rays(edges.pixels)
    off = (np.arccos(rays @ down) - RHO) * 250 / rays[:, 2]  # across the limb, pixels, nearly
    assert np.sqrt((off**2).mean()) < 0.2
    assert 0.01 < np.median(edges.sigma) < 0.2
    assert edges.some(40).pixels.shape == (40, 2)


def test_the_terminator_is_rejected():
    """A half-lit Earth: its terminator is as long as its limb."""
    down, sun = unit([0.05, -0.1, 1]), unit([1, 0.3, -0.1])
    image = shot(down, sun, 66, lit="lambert")
    limb = fit_limb(find_edges(image, CAMERA), CAMERA, sun)
    assert limb.status == "ok"
    apart = np.degrees(np.abs(np.arccos(limb.rays @ down) - RHO))
    assert (apart > 3).sum() > 10  # edges of the terminator there are
    assert apart[limb.used].max() < 0.5
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.05


def test_limb_on_the_dark_side_is_none():
    """With the Sun on the other side, what is bright cannot be ground in its light."""
    _, sun, image = frames("lambert")[0]
    edges = find_edges(image, CAMERA)
    assert fit_limb(edges, CAMERA, sun).status == "ok"
    assert fit_limb(edges, CAMERA, -sun).status == "no limb among the edges"


def test_a_thin_crescent():
    """The Sun 25° from the nadir: four pixels are lit, of an Earth 80 wide."""
    camera = Camera(640, 480, 369.5)
    down = unit([0.1, -0.2, 1])
    sun = Rotation.from_rotvec(np.radians(25) * unit(np.cross(down, [1, 0, 0.2]))).apply(down)
    scene = Scene(-(EARTH_RADIUS + 35_786e3) * down, sun, lit="lambert")
    image = render(camera, scene, np.eye(3), np.random.default_rng(72))
    rho = np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + 35_786e3))
    limb = find_limb(image, camera, sun, (rho, 1e-4))
    assert limb.status == "ok"
    assert limb.scale == 1
    # A fifth of a pixel; with the profile's dark end taken for ground it is 0.035°.
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.03


def test_edges_of_clouds_are_rejected():
    down, sun = unit([0.1, 0.1, 1]), unit([0.6, 0.2, -0.6])
    image = shot(down, sun, 67, lit="lambert", texture=texture(5, rows=256))
    limb = fit_limb(find_edges(image, CAMERA), CAMERA, sun)
    assert limb.status == "ok"
    apart = np.degrees(np.abs(np.arccos(limb.rays @ down) - RHO))
    assert apart[limb.used].max() < 0.7
    # Ground dark at the limb moves the edge: a sixth of a pixel, 0.04°.
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.1


def test_a_second_bright_disc_is_rejected():
    down = unit([-0.3, 0.1, 1])
    image = moon(shot(down, -down, 68), 560, 90, 30)
    limb = fit_limb(find_edges(image, CAMERA), CAMERA)
    on_moon = np.hypot(*(limb.pixels - [560, 90]).T) < 40
    assert on_moon.sum() > 50
    assert not (limb.used & on_moon).any()
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.01


def test_a_disc_of_the_wrong_size_is_no_earth():
    """Alone, a disc like the Moon's is told by the radius expected."""
    image = moon(BLACK, 300, 200, 40)
    free = find_limb(image, CAMERA)
    assert free.status == "ok"
    assert np.tan(free.angular_radius) * 250 == pytest.approx(40, rel=0.05)
    limb = find_limb(image, CAMERA, radius=(RHO, 0.001))
    assert limb.status == "no limb among the edges"
    assert limb.direction is None
    assert limb.std is None


@pytest.mark.parametrize("level", [40.0, 255.0])
def test_a_disc_without_noise(level):
    """Its rim is all that differs in such an image, and is not taken for noise."""
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    clean = level * np.clip(100.5 - np.hypot(columns - 300, rows - 200), 0, 1)
    clean[100:104, 500:504] = 255  # the Sun
    limb = find_limb(np.rint(clean).astype(np.uint8), CAMERA)
    assert limb.status == "ok"
    assert limb.used.sum() > 500
    assert limb.angular_radius == pytest.approx(np.arctan(100 / 250), abs=0.03)


def test_a_radius_known_helps_a_short_arc():
    """27° of limb: direction and radius trade against each other unless one is known."""
    down = unit([0, -2.2, 1.0])
    distance = EARTH_RADIUS + 2000e3
    rho = np.arcsin(EARTH_RADIUS / distance)
    image = shot(down, -down, 69, distance=distance)
    edges = find_edges(image, CAMERA)
    free, known = fit_limb(edges, CAMERA), fit_limb(edges, CAMERA, radius=(rho, 1e-5))
    assert free.status == known.status == "ok"
    assert known.std < 0.7 * free.std
    assert known.angular_radius == pytest.approx(rho, abs=5e-5)
    for limb in (free, known):
        error = limb.basis @ down
        assert (
            error @ np.linalg.solve(limb.covariance[:2, :2], error) < 14
        )  # 1 in 1000, two numbers


def test_deep_air_is_found_in_a_smaller_image():
    """Air that falls by e over 10 pixels: no edge is sharp at the image's own size."""
    down = unit([0.1, 0.3, 1])
    image = shot(down, -down, 70, haze=500e3)
    limb = find_limb(image, CAMERA)
    assert limb.status == "ok"
    assert limb.scale > 1
    # Where in such air the limb is, is a matter of definition; its centre is not.
    assert RHO - 0.05 < limb.angular_radius < RHO + 0.15
    assert np.degrees(np.arccos(limb.direction @ down)) < 0.3
    inside = (limb.pixels >= -1).all(axis=-1) & (limb.pixels <= [641, 481]).all(axis=-1)
    assert inside.all()


NOISE = np.random.default_rng(71).integers(0, 256, (480, 640), dtype=np.uint8)


@pytest.mark.parametrize(
    ("image", "statuses"),
    [
        (BLACK, ["Earth not in view"]),
        (np.full_like(BLACK, 255), ["Earth not in view"]),
        (NOISE, ["Earth not in view", "no limb among the edges"]),
        (np.rint(5 + 2 * (NOISE / 128 - 1)).astype(np.uint8), ["Earth not in view"]),
        (np.tile([[0, 255], [255, 0]], (240, 320)).astype(np.uint8), ["Earth not in view"]),
    ],
)
def test_images_without_a_limb(image, statuses):
    limb = find_limb(image, CAMERA)
    assert limb.status in statuses
    assert limb.direction is None
    assert not limb.used.any()
    assert len(limb.used) == len(limb.pixels)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (BLACK.astype(np.uint16), "image is of uint16: give 8-bit values"),
        (np.zeros((480, 640, 3), np.uint8), "give one grey channel"),
        (BLACK[:100], "image is 640 × 100 pixels, its camera 640 × 480"),
    ],
)
def test_arrays_that_are_no_image(image, message):
    with pytest.raises(ValueError, match=message):
        find_limb(image, CAMERA)


def test_more_edges_than_opencv_takes_at_once():
    """38 000 of them: stripes of eight pixels."""
    stripes = np.tile(np.repeat([0, 200], 8), (480, 40)) + NOISE // 64
    edges = find_edges(stripes.astype(np.uint8), CAMERA)
    assert (edges.pixels[:, 0] < 8).all()  # beyond the first stripe nothing is seen to be bright


def test_the_same_image_gives_the_same_limb():
    down, _, image = frames("full")[0]
    first, second = find_limb(image, CAMERA), find_limb(image, CAMERA)
    np.testing.assert_array_equal(first.direction, second.direction)
    assert first.direction @ down > 0.999
