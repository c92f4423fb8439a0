"""The star camera: rendered stars, spots with their standard errors, and attitudes that are right or none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.model import Camera
from sensorbook.camera.star_blobs import REASONS, find_blobs
from sensorbook.camera.star_identify import CROWDED, NONE
from sensorbook.camera.star_scene import OPTICS, Optics, Sky, made_up_sky, render_stars, stars_to
from sensorbook.camera.star_study import accuracy, share_solved, shifted, study
from sensorbook.camera.stars import MISFIT, StarTable, attitude_from_stars

CAMERA = Camera(512, 512, 1450.0)  # 20° across
GAIN = OPTICS.gain
QUIET = Optics(electrons=1e3, background=0.0, read_noise=0.0, gain=1.0)


def one_star(pixel, magnitude):
    return Sky(CAMERA.rays([pixel]), np.array([float(magnitude)]))


@pytest.fixture(scope="module")
def sky():
    return made_up_sky(7.0, np.random.default_rng(1720))


@pytest.fixture(scope="module")
def table(sky):
    return StarTable.of(sky.brighter(5.5).directions, CAMERA)


# --- the sky and its images ---


def test_as_many_stars_as_the_real_sky():
    # Counted in the Bright Star Catalogue: about 170 to magnitude 3, 1 600 to 5 and 5 000 to 6.
    for limit, real in ((3, 170), (5, 1600), (6, 5000)):
        assert stars_to(limit) == pytest.approx(real, rel=0.2)
    sky = made_up_sky(6.0, np.random.default_rng(1721))
    assert len(sky.magnitudes) == round(stars_to(6.0))
    for limit in (4.0, 5.0):
        count = (sky.magnitudes <= limit).sum()
        assert abs(count - stars_to(limit)) < 4 * np.sqrt(stars_to(limit))
    np.testing.assert_allclose(np.linalg.norm(sky.directions, axis=-1), 1, rtol=0, atol=1e-12)
    # The mean of N even directions scatters by 1/√(3 N) in each axis.
    assert np.abs(sky.directions.mean(axis=0)).max() < 4 / np.sqrt(3 * len(sky.magnitudes))


def test_a_star_s_light_is_all_there_and_around_its_place():
    pixel, rng = np.array([200.3, 150.7]), np.random.default_rng(1722)
    optics = Optics(electrons=5e8, background=0.0, read_noise=0.0, gain=1e6)
    image = render_stars(CAMERA, one_star(pixel, 0.0), np.eye(3), rng, optics).astype(float)
    # 500 DN; rounding loses what is below half a DN, a percent of the spot.
    assert image.sum() == pytest.approx(500, rel=0.02)
    rows, columns = np.indices(image.shape)
    middle = np.array([(image * columns).sum(), (image * rows).sum()]) / image.sum()
    np.testing.assert_allclose(middle, pixel, rtol=0, atol=0.02)
    spread = np.sqrt((image * (columns - pixel[0]) ** 2).sum() / image.sum())
    assert spread == pytest.approx(np.hypot(1, 12**-0.5), abs=0.05)  # a pixel's width added


def test_magnitudes_background_and_shot_noise():
    rng = np.random.default_rng(1723)
    sky = one_star([50, 50], 0.0)
    image = render_stars(CAMERA, sky, np.eye(3), rng, Optics(1e-9, 1.0, 100.0, 0.0, 1.0))
    assert image.mean() == pytest.approx(100, abs=4 * 10 / 512)
    assert image.std() == pytest.approx(10, rel=0.01)
    flux = []
    for magnitude in (0.0, 2.5):
        image = render_stars(
            CAMERA, one_star([50, 50], magnitude), np.eye(3), rng, Optics(1e6, 3, 0, 0, 100)
        )
        flux.append(image.astype(float).sum())
    assert flux[0] / flux[1] == pytest.approx(10, rel=0.05)


def test_mounting_and_attitude_are_the_house_s():
    turn = Rotation.from_euler("zyx", [40, -20, 10], degrees=True).as_matrix()
    camera = Camera(512, 512, 1450.0, to_body=turn)
    attitude = Rotation.random(rng=np.random.default_rng(1724)).as_matrix()
    direction = attitude.T @ turn @ camera.rays([300, 100])
    image = render_stars(
        camera, Sky(direction[None], np.zeros(1)), attitude, np.random.default_rng(1), QUIET
    )
    row, column = np.unravel_index(np.argmax(image), image.shape)
    assert abs(row - 100) <= 1
    assert abs(column - 300) <= 1


def test_saturation_moon_hot_pixels_and_trails():
    rng = np.random.default_rng(1725)
    none = Sky(np.array([[0, 0, -1.0]]), np.zeros(1))
    assert render_stars(CAMERA, one_star([50, 50], -5), np.eye(3), rng, QUIET).max() == 255
    assert render_stars(CAMERA, none, np.eye(3), rng, QUIET).max() == 0
    moon = render_stars(CAMERA, none, np.eye(3), rng, QUIET, moon=CAMERA.rays([255.5, 255.5]))
    radius = 0.004521 * CAMERA.focal_px
    assert (moon == 255).sum() == pytest.approx(np.pi * radius**2, rel=0.05)
    assert (render_stars(CAMERA, none, np.eye(3), rng, QUIET, hot=7) > 0).sum() == 7
    # About the camera's y axis by 20 pixels: a trail as long along x.
    trail = render_stars(
        CAMERA,
        one_star([255.5, 255.5], 0),
        np.eye(3),
        rng,
        QUIET,
        turn=[0, 20 / CAMERA.focal_px, 0],
    )
    rows, columns = np.nonzero(trail > 0.3 * trail.max())
    assert np.ptp(columns) == pytest.approx(20, abs=2)
    assert np.ptp(rows) <= 3
    assert (columns.min() + columns.max()) / 2 == pytest.approx(255.5, abs=1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Optics(electrons=0), "electrons is 0: give a positive number"),
        (lambda: Optics(gain=-1), "gain is -1: give a positive number"),
        (lambda: Optics(read_noise=np.nan), "read_noise is nan: give electrons, 0 or more"),
        (lambda: draw(turn=[0, 0]), "turn is .*: give a rotation vector of three numbers"),
        (lambda: draw(turn=[0, 3.0, 0]), "the trails would leave the image"),
    ],
)
def test_nonsense_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def draw(**scene):
    return render_stars(CAMERA, one_star([9, 9], 1), np.eye(3), np.random.default_rng(1), **scene)


# --- spots ---


def why(blobs):
    return [REASONS[r] for r in blobs.reason]


def test_middles_are_as_good_as_they_say(sky):
    rng = np.random.default_rng(1726)
    off, missing, seen = [], 0, 0
    for _ in range(15):
        attitude = Rotation.random(rng=rng).as_matrix()
        blobs = find_blobs(render_stars(CAMERA, sky.brighter(5.5), attitude, rng), CAMERA, GAIN)
        directions = sky.directions[sky.magnitudes <= 5.5] @ attitude.T
        places = CAMERA.project(directions[CAMERA.sees(directions, 8)])
        apart = np.linalg.norm(blobs.pixels[:, None] - places, axis=-1)
        near = blobs.usable & (apart.min(axis=1) < 1)
        off.append(
            (blobs.pixels[near] - places[apart[near].argmin(axis=1)]) / blobs.std[near, None]
        )
        missing += (apart.min(axis=0) > 1).sum()
        seen += len(places)
    off = np.concatenate(off)
    # 2 × 300 normal numbers: their rms is known to 3 %; faint stars are not quite normal.
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1, abs=0.12)
    assert np.abs(off.mean(axis=0)).max() < 4 / np.sqrt(len(off))
    # Spots of magnitude 5.5 are thirty times the threshold's noise; close pairs are one.
    assert missing <= 0.02 * seen


def test_middle_has_no_bias_on_the_pixel_grid():
    """One bright star at many parts of a pixel, without noise but rounding."""
    rng = np.random.default_rng(1727)
    optics = Optics(electrons=1500 * 1e6, background=0.0, read_noise=0.0, gain=1e6)
    for part in rng.uniform(0, 1, (20, 2)):
        image = render_stars(CAMERA, one_star(100 + part, 0), np.eye(3), rng, optics)
        blobs = find_blobs(image, CAMERA, 1e6)
        np.testing.assert_allclose(blobs.pixels[0], 100 + part, rtol=0, atol=0.01)


def test_noise_alone_has_no_spots():
    rng = np.random.default_rng(1728)
    none = Sky(np.array([[0, 0, -1.0]]), np.zeros(1))
    for background, noise in ((0, 0), (40, 20), (4000, 20), (40, 200)):
        image = render_stars(
            CAMERA, none, np.eye(3), rng, Optics(background=background, read_noise=noise)
        )
        # Next to the edge smoothing has fewer pixels: a spot there is cut, and no star.
        assert find_blobs(image, CAMERA, GAIN).usable.sum() == 0, (background, noise)


def test_background_that_slopes():
    """Stray light across the image: no spots of its own, and the star's middle stays."""
    rng = np.random.default_rng(1729)
    slope = np.linspace(0, 60, 512)[None, :] * np.ones((512, 1))
    star = render_stars(CAMERA, one_star([300.2, 200.6], 3.0), np.eye(3), rng).astype(float)
    image = np.clip(np.rint(star + slope + rng.normal(0, 1, star.shape)), 0, 255).astype(np.uint8)
    blobs = find_blobs(image, CAMERA, GAIN)
    assert why(blobs) == [""]
    np.testing.assert_allclose(blobs.pixels[0], [300.2, 200.6], rtol=0, atol=5 * blobs.std[0])
    assert blobs.background == pytest.approx(31, abs=2)


@pytest.mark.parametrize(
    ("reason", "magnitude", "pixel", "scene"),
    [
        ("saturated", -1.0, (200, 200), {}),
        ("cut by the edge", 3.0, (1.0, 200), {}),
        ("too wide", 2.0, (200, 200), {"turn": [0, 10 / 1450, 0]}),
        ("", 3.0, (200.4, 200.1), {}),
    ],
)
def test_reasons(reason, magnitude, pixel, scene):
    rng = np.random.default_rng(1730)
    image = render_stars(CAMERA, one_star(pixel, magnitude), np.eye(3), rng, **scene)
    assert why(find_blobs(image, CAMERA, GAIN)) == [reason]


def test_moon_and_hot_pixels_are_rejected():
    rng = np.random.default_rng(1731)
    sky = one_star([100.0, 400.0], 3.0)
    image = render_stars(CAMERA, sky, np.eye(3), rng, moon=CAMERA.rays([300, 200]))
    image[400, 300] = image[50, 60] = 120
    blobs = find_blobs(image, CAMERA, GAIN)
    found = dict(zip(map(tuple, np.rint(blobs.pixels).astype(int)), why(blobs), strict=True))
    assert found.pop((300, 400)) == "too narrow"
    assert found.pop((60, 50)) == "too narrow"
    hot = blobs.flux[[tuple(p) == (300, 400) for p in np.rint(blobs.pixels).astype(int)]]
    assert hot[0] == pytest.approx(119, abs=3), "one pixel's, above a background of 1 DN"
    assert found.pop((100, 400)) == ""
    assert list(found.values()) in (["too large"], ["saturated"])


def test_two_stars_in_one_are_too_wide():
    rng = np.random.default_rng(1732)
    pair = Sky(CAMERA.rays([[200.0, 200.0], [203.2, 200.0]]), np.array([3.0, 3.1]))
    assert why(find_blobs(render_stars(CAMERA, pair, np.eye(3), rng), CAMERA, GAIN)) == ["too wide"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image": np.zeros((512, 512))}, "image is of float64: give 8-bit values"),
        ({"image": np.zeros((100, 512), np.uint8)}, "image is 512 × 100 pixels, its camera"),
        ({"gain": 0.0}, "gain is 0.0: give a positive number"),
        ({"spread": np.nan}, "spread is nan: give a positive number"),
        ({"threshold": -1.0}, "threshold is -1.0: give a positive number"),
    ],
)
def test_what_is_no_image_or_no_number(change, message):
    given = {"image": np.zeros((512, 512), np.uint8), "camera": CAMERA, "gain": GAIN} | change
    with pytest.raises(ValueError, match=message):
        find_blobs(**given)


# --- attitude ---


@pytest.mark.parametrize("false", [0, 8])
def test_small_study(sky, table, false):
    """A small version of benchmarks/star_study.py."""
    found = study(CAMERA, sky, table, 40, 1733, false=false, hot=5)
    assert found.solved.sum() >= 39
    assert found.wrong == 0
    # The mean of 40 values of χ² with three degrees scatters by √(6/40) = 0.39.
    assert found.normalised.mean() == pytest.approx(3, abs=1.6)
    assert found.misfit.mean() == pytest.approx(1, abs=0.25)
    arcsec = 3600 * np.degrees(np.sqrt(np.mean(found.errors**2, axis=0)))
    assert arcsec[:2].max() < 2
    assert arcsec[2] < 20


def test_body_axes_and_distortion(sky):
    turn = Rotation.from_euler("xyz", [20, 30, 100], degrees=True).as_matrix()
    camera = Camera(512, 512, 1450.0, distortion=(-0.2, 0.05), to_body=turn)
    table = StarTable.of(sky.brighter(5.5).directions, camera)
    found = study(camera, sky, table, 20, 1734)
    assert found.solved.all()
    assert found.normalised.mean() == pytest.approx(3, abs=2.2)  # four times its scatter, 0.55
    # The worst axis is the camera's own, wherever it points in the body.
    _, axes = np.linalg.eigh(found.covariance)
    assert (np.abs(axes[:, :, 2] @ turn[:, 2]) > 0.98).all()


def test_table_of_one_image(sky, table):
    rng = np.random.default_rng(1735)
    attitude = Rotation.random(rng=rng).as_matrix()
    image = render_stars(CAMERA, sky, attitude, rng, false=3, hot=3)
    found = attitude_from_stars(image, CAMERA, table, GAIN)
    assert found.status == "ok"
    frame = found.to_frame()
    assert len(frame) == len(found.blobs) == len(found.matched)
    named = found.matched >= 0
    assert named.sum() >= 4
    assert found.blobs.usable[named].all()
    assert np.isnan(found.off[~named]).all()
    assert (found.off[named] < 1).all()
    seen = table.directions[found.matched[named]] @ attitude.T
    np.testing.assert_allclose(CAMERA.project(seen), found.blobs.pixels[named], rtol=0, atol=1)
    assert (frame["rejected"] == "too narrow").sum() >= 2
    assert found.roll_std > 3 * found.across_std


def test_a_star_that_has_moved_loses_its_name(sky, table):
    """One entry of the catalogue is wrong by half a pixel: a planet beside it, or a misprint."""
    rng = np.random.default_rng(1736)
    attitude = Rotation.random(rng=rng).as_matrix()
    image = render_stars(CAMERA, sky, attitude, rng)
    before = attitude_from_stars(image, CAMERA, table, GAIN)
    victim = before.matched[before.matched >= 0][2]
    moved = table.directions.copy()
    axis = attitude.T @ [1.0, 0, 0]
    moved[victim] = Rotation.from_rotvec(0.5 / CAMERA.focal_px * axis).apply(moved[victim])
    after = attitude_from_stars(image, CAMERA, StarTable.of(moved, CAMERA), GAIN)
    assert after.status == "ok"
    assert victim not in after.matched
    error = error_vector(after.matrix, attitude)
    assert error @ np.linalg.solve(after.covariance, error) < 21  # χ² of 3: one in ten thousand


WIDE = Camera(1024, 1024, 4170.0)  # 14° across, where 0.02 % of the focal length are 0.1 pixels


@pytest.mark.parametrize(
    ("fault", "solved"),
    [
        ({"focal": 1.0002}, 4),
        ({"distortion": (-0.05, 0.0)}, 0),
        ({"arcsec": 2.0}, 8),
        ({"arcsec": 20.0}, 0),
        ({"arcsec": 20.0, "stated": 20.0}, 11),
    ],
)
def test_faults_widen_the_covariance_or_have_no_solution(sky, fault, solved):
    """Left out of the account, they made error² over covariance 30 to 680. A dozen images each."""
    rng = np.random.default_rng(1745)
    lens = Camera(1024, 1024, 4170 / fault.get("focal", 1), distortion=fault.get("distortion", ()))
    catalogue = shifted(sky.brighter(6.0).directions, fault.get("arcsec", 0), rng)
    own = StarTable.of(catalogue, WIDE, fault.get("stated", 0.1))
    found = study(WIDE, sky, own, 12, 1746, taken_by=lens)
    assert found.wrong == 0
    assert set(found.statuses) <= {"ok", f"no solution: {MISFIT}", f"no solution: {NONE}"}
    if solved:
        assert found.solved.sum() >= solved
        # Three where all is known, and four times the scatter of a dozen, √(6/12); a lens's errors are
        # no noise.
        assert found.normalised.mean() < (5.8 if "stated" in fault else 7)
    else:
        assert found.solved.sum() == 0


def test_what_a_misfit_that_is_refused_leaves(sky, table):
    rng = np.random.default_rng(1747)
    attitude = Rotation.random(rng=rng).as_matrix()
    image = render_stars(Camera(512, 512, 1450 * 1.002), sky, attitude, rng)
    found = attitude_from_stars(image, CAMERA, table, GAIN)
    assert found.status == f"no solution: {MISFIT}"
    assert found.misfit > 5
    assert found.matrix is None
    assert (found.matched == -1).all()


def test_a_misfit_within_chance_changes_nothing(sky, table):
    """Then the covariance is that of the stars' standard errors: 1/σ² summed across the axis."""
    rng = np.random.default_rng(1748)
    image = render_stars(CAMERA, sky, np.eye(3), rng)
    found = attitude_from_stars(image, CAMERA, table, GAIN)
    assert found.misfit < 1.3  # 95 % of what chance gives some 20 stars
    named = found.matched >= 0
    std = np.hypot(found.blobs.std[named] / CAMERA.focal_px, table.std)
    # But for the field's 10° half-width and stars not even around its middle.
    assert found.across_std == pytest.approx(1 / np.sqrt((1 / std**2).sum()), rel=0.15)


def test_a_wrong_focal_length_shows_or_fits_nothing(sky, table):
    rng = np.random.default_rng(1737)
    attitude = Rotation.random(rng=rng).as_matrix()
    image = render_stars(Camera(512, 512, 1450 * 1.0005), sky, attitude, rng)
    assert attitude_from_stars(image, CAMERA, table, GAIN).misfit > 2
    image = render_stars(Camera(512, 512, 1450 * 1.02), sky, attitude, rng)
    assert attitude_from_stars(image, CAMERA, table, GAIN).status == f"no solution: {NONE}"


@pytest.mark.parametrize(
    ("scene", "status"),
    [
        ({"moon": True}, "ok"),
        ({"turn": [30 / 1450, 0, 0]}, "no solution: fewer than 4 stars"),
        ({"optics": Optics(background=20000)}, "no solution: fewer than 4 stars"),
    ],
)
def test_what_fails_says_so(sky, table, scene, status):
    rng = np.random.default_rng(1738)
    attitude = Rotation.random(rng=rng).as_matrix()
    if "moon" in scene:
        scene = {"moon": attitude.T @ CAMERA.rays([350, 150])}
    found = attitude_from_stars(
        render_stars(CAMERA, sky, attitude, rng, **scene), CAMERA, table, GAIN
    )
    assert found.status == status
    if status != "ok":
        assert found.matrix is None
        assert found.covariance is None
        assert (found.matched == -1).all()
        assert np.isnan([found.across_std, found.roll_std, found.misfit, found.chance]).all()


def test_false_stars_that_crowd_the_real_ones_out(sky, table):
    """Some images are solved and some are not, none of them wrong."""
    found = study(CAMERA, sky, table, 30, 1744, false=200)
    assert set(found.statuses) == {"ok", f"no solution: {CROWDED}"}
    assert found.wrong == 0


def test_another_sky_has_no_solution(table):
    """Images of stars that the catalogue does not hold."""
    rng = np.random.default_rng(1739)
    found = study(CAMERA, made_up_sky(6.0, rng), table, 25, 1740)
    assert set(found.statuses) == {f"no solution: {NONE}"}
    assert found.wrong == 0


@pytest.mark.parametrize("kind", ["black", "white", "random", "stripes"])
def test_images_of_no_sky(table, kind):
    rng = np.random.default_rng(1741)
    image = {
        "black": np.zeros((512, 512), np.uint8),
        "white": np.full((512, 512), 255, np.uint8),
        "random": rng.integers(0, 256, (512, 512), dtype=np.uint8),
        "stripes": np.tile(np.array([0, 0, 0, 0, 255, 0, 0, 0], np.uint8), (512, 64)),
    }[kind]
    assert attitude_from_stars(image, CAMERA, table, GAIN).status.startswith("no solution: ")


@pytest.mark.parametrize("size", [(1, 1), (5, 70), (130, 40)])
def test_small_images(table, size):
    camera = Camera(*size, 300.0)
    image = np.zeros(size[::-1], np.uint8)
    assert (
        attitude_from_stars(image, camera, table, GAIN).status == "no solution: fewer than 4 stars"
    )


# --- studies ---


def test_accuracy_follows_stars_and_focal_length():
    simulated, predicted = np.array(
        [accuracy(CAMERA, n, 0.05, 2000, 1742) for n in (8, 32)]
    ).swapaxes(0, 1)
    np.testing.assert_allclose(
        simulated, predicted, rtol=0.06
    )  # 2000 runs, and small fields of stars
    # σ/√n across the axis, but for 1 − 1/n of the stars' own plane: a few percent with eight.
    assert predicted[1, 0] == pytest.approx(0.05 / 1450 / np.sqrt(32), rel=0.06)
    assert predicted[0, 0] / predicted[1, 0] == pytest.approx(2, rel=0.1)
    longer, _ = accuracy(Camera(512, 512, 2900.0), 8, 0.05, 2000, 1742)
    assert simulated[0, 0] / longer[0] == pytest.approx(2, rel=0.05)
    assert simulated[0, 1] / longer[1] == pytest.approx(1, rel=0.05)


def test_four_stars_in_view_are_enough():
    enough, solved, mean = share_solved(CAMERA, np.array([-1.0, 3.5, 4.5, 5.5]), 0.05, 60, 1743)
    assert enough[0] == solved[0] == 0
    assert (solved <= enough + 1e-9).all()
    assert (solved >= enough - 0.06).all()  # a flat triangle in three of sixty
    assert enough[-1] > 0.98
    share = 4 * np.arcsin(np.sin(np.arctan(256 / 1450)) ** 2) / (4 * np.pi)
    assert mean[-1] == pytest.approx(share * stars_to(5.5), rel=0.1)
