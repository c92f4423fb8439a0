"""The renderer against geometry worked out another way."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation

from sensorbook.camera.baseline import baseline
from sensorbook.camera.limb import find_limb
from sensorbook.camera.model import Camera
from sensorbook.camera.scene import (
    EARTH_RADIUS,
    GROUND,
    SUN_DISTANCE,
    SUN_RADIUS,
    WGS84,
    Scene,
    render,
    texture,
)
from sensorbook.camera.star_scene import made_up_sky, render_stars
from sensorbook.camera.sun import find_sun

CAMERA = Camera(400, 300, 200.0)
WIDE = Camera(1280, 720, 369.5)
PLACE = np.array([9.0e6, -8.0e6, 7.5e6])  # 14 200 km from the centre: the limb is 90 px from it
AWAY = PLACE / np.linalg.norm(PLACE)  # a Sun behind the camera
SQUASHED = (6371e3, 6371e3, 5600e3)  # more than the Earth, for a test that tells


def looking(target, seed=0, off=(0.0, 0.0)):
    """An attitude (3, 3) whose camera has `target` at `off` degrees from its axis, rolled at random."""
    z = np.asarray(target) / np.linalg.norm(target)
    x = np.cross(z, [0.3, 0.5, -0.8])
    x /= np.linalg.norm(x)
    roll = np.random.default_rng(seed).uniform(0, 360)
    turn = Rotation.from_euler("zyx", [roll, off[0], off[1]], degrees=True).as_matrix()
    return turn @ np.stack([x, np.cross(z, x), z])


def shot(scene, attitude, camera=CAMERA, seed=1):
    return render(camera, scene, attitude, np.random.default_rng(seed)).astype(float)


def below_limb_of_sphere(direction):
    """Rad by which a direction, inertial, is nearer to the nadir than asin(R/(R + h))."""
    return np.arcsin(EARTH_RADIUS / np.linalg.norm(PLACE)) - np.arccos(
        -direction @ PLACE / np.linalg.norm(PLACE)
    )


def below_limb_of_ellipsoid(axes):
    """How deep a sight dips, by the smallest value of (x/a)² + (y/b)² + (z/c)² − 1 along it."""

    def dip(direction):
        def level(far):
            return (((PLACE + far * direction) / axes) ** 2).sum() - 1

        return -minimize_scalar(level, bounds=(1e6, 4e7), method="bounded").fun

    return dip


@pytest.mark.parametrize(
    ("axes", "below"),
    [
        ((EARTH_RADIUS,) * 3, below_limb_of_sphere),
        (WGS84, below_limb_of_ellipsoid(np.array(WGS84))),
        (SQUASHED, below_limb_of_ellipsoid(np.array(SQUASHED))),
    ],
)
def test_the_limb_lies_where_geometry_puts_it(axes, below):
    """The bright part of each row and column ends where a line of sight grazes the Earth."""
    attitude = looking(-PLACE, 4, (6.0, -4.0))
    image = shot(Scene(PLACE, AWAY, axes, noise=0), attitude) / GROUND
    middle = np.rint(CAMERA.project(attitude @ -AWAY)).astype(int)
    off = []
    for along in (0, 1):
        lines = image if along == 0 else image.T
        for line in range(middle[1 - along] - 55, middle[1 - along] + 56, 3):
            for way in (1, -1):

                def depth(far, line=line, along=along, way=way):
                    pixel = np.empty(2)
                    pixel[along], pixel[1 - along] = middle[along] + way * far, line
                    return below(attitude.T @ CAMERA.rays(pixel))

                part = lines[line, middle[along] :: way]
                true = brentq(depth, 20, 140, xtol=1e-6)
                # Covered parts of the pixels from the middle's own left half on; across the limb.
                slant = true / np.hypot(true, line - middle[1 - along])
                off.append((part.sum() - 0.5 - true) * slant)
    off = np.array(off)
    assert len(off) == 148
    assert abs(off.mean()) < 0.01
    # Six samples across a pixel: an edge along the rows may be off by half of one, and is by 1/√432 rms.
    assert np.sqrt((off**2).mean()) < 0.03
    assert np.abs(off).max() < 1 / 12


def test_lambert_is_the_suns_height():
    sun = np.cross(AWAY, [0, 0, 1]) + 0.1 * AWAY
    sun /= np.linalg.norm(sun)
    attitude = looking(-PLACE, 5)
    image = shot(Scene(PLACE, sun, lit="lambert", noise=0), attitude)
    rng = np.random.default_rng(6)
    pixels = np.rint(rng.uniform(-60, 60, (200, 2)) + CAMERA.project(attitude @ -AWAY)).astype(int)
    rays = CAMERA.rays(pixels) @ attitude
    along = rays @ PLACE
    far = -along - np.sqrt(along**2 - (PLACE @ PLACE - EARTH_RADIUS**2))
    normal = (PLACE + far[:, None] * rays) / EARTH_RADIUS
    expected = GROUND * np.clip(normal @ sun, 0, None)
    assert (expected == 0).sum() > 20
    assert (expected > 50).sum() > 20
    # Rounding to whole DN.
    np.testing.assert_allclose(image[pixels[:, 1], pixels[:, 0]], expected, rtol=0, atol=0.501)


def test_haze_falls_by_e_over_its_height():
    attitude = looking(-PLACE, 7)
    image = shot(Scene(PLACE, AWAY, haze=300e3, noise=0), attitude)
    rays = CAMERA.grid @ attitude
    height = np.linalg.norm(np.cross(PLACE, rays), axis=-1) - EARTH_RADIUS
    air = (height > 250e3) & (height < 1200e3)  # two pixels from the limb on
    assert air.sum() > 2000
    np.testing.assert_allclose(
        image[air], GROUND * np.exp(-height[air] / 300e3), rtol=0, atol=0.501
    )
    assert (image[height < -250e3] == GROUND).all()


@pytest.mark.parametrize("off", [(0.0, 0.0), (40.0, 0.0), (30.0, 20.0), (-50.0, 10.0)])
def test_the_suns_disc(off):
    """Its solid angle, seen under an angle θ to the axis, covers f²Ω/cos³θ of the image."""
    attitude = looking(AWAY, 8, off)
    image = shot(Scene(PLACE, AWAY, noise=0), attitude, WIDE)
    direction = attitude @ AWAY
    place = WIDE.project(direction)
    rows, columns = np.indices(image.shape)
    solid = 2 * np.pi * (1 - np.cos(np.arctan(SUN_RADIUS / SUN_DISTANCE)))
    # 36 samples a pixel, some 15 pixels of rim.
    assert image.sum() / 255 == pytest.approx(369.5**2 * solid / direction[2] ** 3, rel=0.03)
    found = np.array([(image * columns).sum(), (image * rows).sum()]) / image.sum()
    np.testing.assert_allclose(found, place, rtol=0, atol=0.04)


def test_the_earth_hides_the_sun():
    behind = Rotation.from_rotvec([0.02, 0.01, 0]).as_matrix() @ -AWAY
    image = shot(Scene(PLACE, behind, noise=0), looking(-PLACE))
    assert image.max() == GROUND
    beside = np.array([1, -1, 0]) / np.sqrt(2)
    image = shot(Scene(PLACE, beside, noise=0), looking(beside), WIDE)
    assert image.max() == 255


def test_a_texture_goes_round():
    """A bright meridian at ±180°, half in its first column and half in its last."""
    painting = np.full((90, 180), 0.5)
    painting[:, :6] = painting[:, -6:] = 1.0
    painting[:30] = 0.0  # 30° to 90° north
    place = np.array([-14e6, 0, 0])
    attitude = np.array([[0, -1.0, 0], [0, 0, -1], [1, 0, 0]])  # east to the left, north up
    image = shot(Scene(place, -place / 14e6, texture=painting, noise=0), attitude)
    row = image[150]
    stripe = np.flatnonzero(row > 0.75 * GROUND)  # half-way down its sides
    assert (np.diff(stripe) == 1).all()
    # ±12° at 6371 km from 14 000 km: R sin 12°/(14 000 km − R cos 12°) · f.
    half = 200 * 6371 * np.sin(np.radians(12)) / (14000 - 6371 * np.cos(np.radians(12)))
    assert len(stripe) == pytest.approx(2 * half, abs=1.5)
    assert stripe.mean() == pytest.approx(199.5, abs=0.6)
    assert image[150 - 90, 200] == 0
    assert image[150 + 90, 200] == GROUND


def test_a_made_up_earth():
    painting = texture(3, rows=64)
    assert painting.shape == (64, 128)
    assert painting.min() >= 0.15
    assert painting.max() <= 1
    np.testing.assert_array_equal(painting, texture(3, rows=64))
    assert (painting != texture(4, rows=64)).any()
    seam = np.abs(painting[:, 0] - painting[:, -1]).mean()
    assert seam < 2 * np.abs(np.diff(painting, axis=1)).mean()


def test_noise_is_as_large_as_said_and_repeats():
    scene, attitude = Scene(PLACE, AWAY, noise=3.0), looking(-PLACE)
    image = shot(scene, attitude, seed=11)
    np.testing.assert_array_equal(image, shot(scene, attitude, seed=11))
    assert (image != shot(scene, attitude, seed=12)).any()
    ground = image[120:180, 170:230]
    # 3600 pixels: 1.2 % standard error; rounding adds 1/12 DN².
    assert ground.std() == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.06)


def test_the_mounting_turns_the_camera():
    turn = Rotation.from_euler("xyz", [20, -30, 50], degrees=True).as_matrix()
    scene, attitude = Scene(PLACE, AWAY, noise=0), looking(-PLACE, 2, (5, 3))
    mounted = Camera(400, 300, 200.0, to_body=turn)
    np.testing.assert_array_equal(
        shot(scene, turn @ attitude, mounted), shot(scene, attitude, CAMERA)
    )


def test_the_image_is_dark_where_the_camera_has_no_direction():
    """r(1 − 0.2 r²) goes to 0.861 and turns back: 103 of 120 px. The Earth fills what is left."""
    camera = Camera(301, 241, 120.0, distortion=(-0.2,))
    top = 120 * np.sqrt(1 / 0.6) * 2 / 3
    x, y = np.meshgrid(np.arange(301) - 150, np.arange(241) - 120)
    near = np.array([0, 0, EARTH_RADIUS + 100e3])  # 80° to the limb
    for scene in (
        Scene(near, AWAY, noise=0),
        Scene(near, AWAY, haze=8e3, texture=np.ones((4, 8)), noise=0),
    ):
        image = shot(scene, looking(-near), camera)
        known = np.hypot(x, y) < top
        np.testing.assert_array_equal(image, np.where(known, GROUND, 0))
    half = shot(Scene(PLACE, AWAY, noise=0, blur=1.5), looking(-PLACE, off=(50, 0)), camera)
    assert half.max() == pytest.approx(GROUND, abs=1)
    assert half[0, 0] == 0


def test_what_reads_images_bears_pixels_without_a_direction():
    """The same fold, the Sun and a limb within it, spots and edges painted outside."""
    camera = Camera(640, 480, 250.0, distortion=(-0.2,))  # up to 215 px from the middle
    sun = camera.rays([480.0, 240])
    attitude = looking(-PLACE, 2)
    # The lens shrinks the Sun by a third along its radius: brighter, its rim saturates too.
    scene = Scene(PLACE, sun @ attitude, noise=0, sun_level=2550.0)
    image = render(camera, scene, attitude, np.random.default_rng(1))
    image[3:6, 3:6] = 255
    image[430:470, 10:60] = 200
    limb = find_limb(image, camera)
    assert limb.status == "ok"
    np.testing.assert_allclose(limb.direction, attitude @ -AWAY, atol=2e-4)
    chain = baseline(image, camera)
    assert chain.status == "No Sun: the camera has no direction for the brightest blob."
    assert np.isfinite(chain.earth_direction).all()
    seen = find_sun(image, camera)
    assert seen.status == "ok"
    np.testing.assert_allclose(seen.direction, sun, atol=1e-3)
    # Nothing but what has no direction.
    image[:] = 0
    image[430:470, 10:60] = 200
    image[3:6, 3:6] = 255
    assert find_limb(image, camera).status == "Earth not in view"
    assert find_sun(image, camera).status == "Sun not in view"
    assert baseline(image, camera).status == (
        "No Earth: the camera has no direction for the ellipse's centre. "
        "No Sun: the camera has no direction for the brightest blob."
    )


def test_stars_are_drawn_where_the_camera_has_directions():
    camera = Camera(512, 512, 1450.0, distortion=(-12.0,))
    known = np.isfinite(camera.grid).all(axis=-1)
    assert 0.2 < known.mean() < 0.5
    rng = np.random.default_rng(9)
    image = render_stars(camera, made_up_sky(7.0, rng), np.eye(3), rng)
    bright = image > 8  # background and noise have 1 and 0.6 DN
    assert bright.sum() > 10
    rows, columns = np.nonzero(bright)
    # Spots are some pixels wide.
    off = np.hypot(columns - 255.5, rows - 255.5) - np.sqrt(known.sum() / np.pi)
    assert off.max() < 4


def test_a_blurred_limb_is_its_sharp_one_smoothed():
    """Across a straight enough edge a Gaussian leaves its own integral: 16 and 84 % one σ to each side."""
    attitude = looking(-PLACE, 3)
    sharp, soft = (
        shot(Scene(PLACE, AWAY, noise=0, blur=blur), attitude, WIDE) for blur in (0.0, 3.0)
    )
    middle = WIDE.project(attitude @ -AWAY)
    x, y = np.meshgrid(np.arange(1280), np.arange(720))
    far = np.hypot(x - middle[0], y - middle[1])
    limb = np.sqrt((sharp > GROUND / 2).sum() / np.pi)  # on the axis its image is a circle
    for off, part in ((-3.0, 0.841), (0.0, 0.5), (3.0, 0.159), (9.0, 0.001)):
        there = np.abs(far - limb - off) < 0.5
        # A ring of a pixel's width; the edge is bent by σ/r = 2 %, and DN are whole.
        assert soft[there].mean() / GROUND == pytest.approx(part, abs=0.02)
    assert soft.sum() == pytest.approx(sharp.sum(), rel=1e-3)


def test_light_from_beside_the_image_comes_in():
    """A ground that goes on beyond the edge is not darker there; a Sun just outside shines in."""
    near = np.array([0, 0, EARTH_RADIUS + 100e3])
    image = shot(Scene(near, AWAY, noise=0, blur=4.0), looking(-near))
    assert (image == GROUND).all()
    attitude = looking(AWAY, 5)
    outside = CAMERA.rays([-6.0, 150.0])
    scene = {"noise": 0, "sun_level": 5 * 255.0}
    dark, glow = (
        shot(Scene(PLACE, outside @ attitude, blur=blur, **scene), attitude) for blur in (0.0, 4.0)
    )
    assert dark[150, 0] == 0
    area = np.pi * (200 * SUN_RADIUS / SUN_DISTANCE) ** 2 / outside[2] ** 3
    expected = 5 * 255 * area / (2 * np.pi * 4.0**2) * np.exp(-(6**2) / (2 * 4.0**2))
    assert glow[150, 0] == pytest.approx(expected, rel=0.05)  # 33 DN, whole ones


def test_a_real_sun_blooms():
    """Light of a point: level · area/(2πσ²) · exp(−r²/2σ²) reaches 255 where r² = 2σ² ln(level·…/255)."""
    attitude = looking(AWAY, 8)
    level, blur = 1e5 * GROUND, 1.5
    image = shot(Scene(PLACE, AWAY, noise=0, blur=blur, sun_level=level), attitude, WIDE)
    area = np.pi * (369.5 * SUN_RADIUS / SUN_DISTANCE) ** 2
    reach = blur * np.sqrt(2 * np.log(level * area / (2 * np.pi * blur**2) / 254.5))
    saturated = np.sqrt((image == 255).sum() / np.pi)
    # The disc's own radius, 1.7 px, adds its variance of r²/4 to σ² on the way: 15 % of the reach.
    wider = reach * np.sqrt(1 + area / np.pi / 4 / blur**2)
    assert saturated == pytest.approx(wider, abs=0.3)
    assert saturated > 4 * np.sqrt(area / np.pi)
    plain = shot(Scene(PLACE, AWAY, noise=0, blur=blur), attitude, WIDE)
    assert 0 < plain.max() < 255


@pytest.mark.parametrize("part", [0.0, 0.5, 0.999])
def test_a_place_inside_the_earth(part):
    with pytest.raises(ValueError, match="position is inside the Earth: give metres"):
        Scene(np.array([0, 0, part * WGS84[2]]), AWAY, WGS84)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"position": [np.nan, 0, 0]}, r"position is \[nan, 0, 0\]: give x, y and z in metres"),
        ({"position": [9e6, 9e6]}, r"position is \[9000000.0, 9000000.0\]: give x, y and z"),
        ({"position": "geo"}, "position is geo: give x, y and z"),
        ({"sun": [np.nan, 0, 1]}, r"sun is \[nan, 0, 1\]: give a unit vector"),
        ({"sun": None}, "sun is None: give a unit vector"),
        ({"sun": [0, 0, 0]}, "sun is no unit vector, its length 0: divide by it"),
        ({"sun": 5 * AWAY}, "sun is no unit vector, its length 5: divide by it"),
        ({"semi_axes": (6.4e6, 6.4e6, -6.4e6)}, r"semi_axes are \(.*-6400000.0\): give three lengths"),
        ({"semi_axes": (6.4e6, 0, 6.4e6)}, "semi_axes are .*: give three lengths in metres, above 0"),
        ({"semi_axes": 6.4e6}, "semi_axes are 6400000.0: give three lengths"),
        ({"semi_axes": (6.4e6, 6.4e6, np.nan)}, "semi_axes are .*nan"),
        ({"haze": -1.0}, "haze is -1.0: give metres, 0 or more"),
        ({"haze": np.nan}, "haze is nan: give metres, 0 or more"),
        ({"noise": -2.0}, "noise is -2.0: give DN, 0 or more"),
        ({"noise": np.inf}, "noise is inf: give DN, 0 or more"),
        ({"blur": -0.1}, "blur is -0.1: give pixels, 0 or more"),
        ({"blur": "2"}, "blur is 2: give pixels, 0 or more"),
        ({"sun_level": np.nan}, "sun_level is nan: give DN, 0 or more"),
        ({"texture": np.full((4, 8), np.nan)}, r"texture of shape \(4, 8\): give rows and columns"),
        ({"texture": np.ones((4, 8, 3))}, r"texture of shape \(4, 8, 3\): .* brightness, 0 to 1"),
        ({"texture": np.full((4, 8), 255)}, r"texture of shape \(4, 8\)"),
        ({"texture": np.ones((0, 8))}, r"texture of shape \(0, 8\)"),
    ],
)  # fmt: skip
def test_scenes_that_make_no_sense(changed, message):
    with pytest.raises(ValueError, match=message):
        Scene(**({"position": PLACE, "sun": AWAY} | changed))


@pytest.mark.parametrize(
    "attitude", [2 * np.eye(3), np.diag([1.0, 1, -1]), np.eye(2), np.full((3, 3), np.nan), None]
)
def test_attitudes_that_are_none(attitude):
    with pytest.raises(ValueError, match="attitude is no rotation: give 3 × 3 numbers, its rows"):
        render(CAMERA, Scene(PLACE, AWAY), attitude, np.random.default_rng(1))


def test_light_that_is_none():
    with pytest.raises(ValueError, match='lit is \'phong\': give "full" or "lambert"'):
        Scene(PLACE, AWAY, lit="phong")
