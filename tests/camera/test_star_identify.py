"""Lost-in-space identification: right names, no false ones, and the chance of these as it is stated."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.camera.model import Camera
from sensorbook.camera.star_identify import (
    CROWDED,
    LIMIT,
    NONE,
    SHORT,
    StarTable,
    _guesses,
    _sines,
    expected_false_names,
    expected_false_triangles,
    identify,
    share_of_sky,
)
from sensorbook.camera.star_scene import made_up_sky
from sensorbook.errors import Refusal

CAMERA = Camera(1024, 1024, 4170.0)  # 14° across
NOISE = 0.05  # pixels
STD = NOISE / CAMERA.focal_px


def spots(sky, attitude, rng, noise=NOISE):
    """Stars in view, brightest first: rows and pixels with noise."""
    seen = sky.directions @ attitude.T
    stars = np.flatnonzero(CAMERA.sees(seen))
    stars = stars[np.argsort(sky.magnitudes[stars])]
    pixels = CAMERA.project(seen[stars])
    return stars, pixels + rng.normal(0, noise, pixels.shape)


@pytest.fixture(scope="module")
def sky():
    return made_up_sky(6.0, np.random.default_rng(1701))


@pytest.fixture(scope="module")
def table(sky):
    return StarTable.of(sky.directions, CAMERA)


def test_table_holds_all_pairs_of_the_field():
    few = made_up_sky(3.0, np.random.default_rng(1702))
    table = StarTable.of(few.directions, CAMERA)
    cosine = np.clip(few.directions @ few.directions.T, -1, 1)
    first, second = np.triu_indices(len(cosine), 1)
    angle = np.arccos(cosine[first, second])
    corner = CAMERA.rays([[-0.5, -0.5], [1023.5, 1023.5]])
    across = np.arccos(corner[0] @ corner[1])
    # Pixels' middles are half a pixel inside the corners.
    inside = np.sort(angle[angle < across - 1.5 / CAMERA.focal_px])
    np.testing.assert_allclose(table.angles[: len(inside)], inside, rtol=0, atol=1e-9)
    assert len(table.angles) <= (angle < across).sum()
    one, other = table.alike(inside[10], 1e-8)
    assert len(one) == 2
    assert (one[0], other[0]) == (other[1], one[1])


def test_every_star_gets_its_name(sky, table):
    rng = np.random.default_rng(1703)
    for _ in range(20):
        stars, pixels = spots(sky, Rotation.random(rng=rng).as_matrix(), rng)
        found = identify(CAMERA.rays(pixels), np.full(len(stars), STD), table)
        assert found.status == "ok"
        assert found.chance < LIMIT
        # A star lies beyond its reach of 4 σ or more in three of ten thousand cases at most.
        assert (found.stars == stars).sum() >= len(stars) - 1
        assert ((found.stars == stars) | (found.stars == -1)).all()


@pytest.mark.parametrize("limit", [4.5, 5.0, 6.0])
def test_false_and_missing_stars_never_mislead(limit):
    """A tenth of the stars is missing and 0 to 8 spots are false; what has four stars is solved."""
    rng = np.random.default_rng(1704)
    sky = made_up_sky(limit, rng)
    table = StarTable.of(sky.directions, CAMERA)
    enough = solved = 0
    for _ in range(120):
        stars, pixels = spots(sky, Rotation.random(rng=rng).as_matrix(), rng)
        there = rng.uniform(size=len(stars)) > 0.1
        false = rng.integers(0, 9)
        true = np.concatenate([stars[there], np.full(false, -1)])
        pixels = np.concatenate([pixels[there], rng.uniform(0, 1023, (false, 2))])
        order = rng.permutation(len(true))
        true, pixels = true[order], pixels[order]
        found = identify(CAMERA.rays(pixels), np.full(len(true), STD), table)
        enough += there.sum() >= 4
        if found.status == "ok":
            solved += 1
            # A false star may lie on a catalogue's by chance, one in a hundred images; never two.
            assert ((found.stars >= 0) & (found.stars != true)).sum() <= 1
            assert (found.stars == true)[true >= 0].sum() >= 4
        else:
            assert (found.stars == -1).all()
            assert np.isnan(found.chance)
    # Flat triangles and stars beyond their reach cost some of the fields with just four.
    assert 0.95 * enough <= solved <= enough


def test_nothing_but_false_stars(table):
    rng = np.random.default_rng(1705)
    for _ in range(60):
        rays = CAMERA.rays(rng.uniform(0, 1023, (rng.integers(4, 25), 2)))
        assert identify(rays, np.full(len(rays), STD), table).status == NONE


def test_false_triangles_are_as_many_as_stated(sky, table):
    """Counted over random triples of spots that are no stars."""
    rng = np.random.default_rng(1706)
    counted = expected = 0.0
    std = 4 * STD  # so that some are met
    reach = 4.0 * np.sqrt(2) * std
    for _ in range(1500):
        rays = CAMERA.rays(rng.uniform(0, 1023, (3, 2)))
        if _sines(rays).min() < 0.2:
            continue
        angle = np.arccos(np.clip(rays @ rays.T, -1, 1))
        known = {(0, k): table.alike(angle[0, k], reach) for k in (1, 2)}
        tolerance = np.full((3, 3), reach)
        counted += len(_guesses(rays, (0, 1, 2), angle, tolerance, known, table))
        each = expected_false_triangles(
            len(sky.magnitudes), angle[0, 1], _sines(rays)[2], (reach,) * 3
        )
        assert expected_false_names(len(sky.magnitudes), rays[[0, 1, 2, 2]], np.full(4, std))[
            3
        ] == pytest.approx(each, rel=1e-6)
        expected += each
    assert expected > 30
    assert abs(counted - expected) < 4 * np.sqrt(expected)  # Poisson


def test_counts_say_why_there_is_no_match(table):
    """A catalogue of 80 stars puts 0.4 in view; 200 spots are more than the 20 that a field holds."""
    rng = np.random.default_rng(1711)
    short = StarTable.of(made_up_sky(2.3, rng).directions, CAMERA)
    for own, count, status in ((short, 12, SHORT), (table, 200, CROWDED), (table, 50, NONE)):
        rays = CAMERA.rays(rng.uniform(0, 1023, (count, 2)))
        assert identify(rays, np.full(count, STD), own).status == status


def test_share_of_sky_and_stars_in_view():
    """Against directions counted, and a sixth of the sphere for a field of 90°."""
    assert share_of_sky(Camera(512, 512, 256.0)) == pytest.approx(1 / 6, abs=1e-9)
    rng = np.random.default_rng(1712)
    sky = made_up_sky(9.0, rng)
    camera = Camera(900, 300, 700.0, principal_point=(300.0, 170.0))
    counted = camera.sees(sky.directions).sum()
    # Poisson's scatter of some 2 800.
    assert abs(
        counted
        - StarTable.of(sky.brighter(3).directions, camera).mean
        * len(sky.magnitudes)
        / len(sky.brighter(3).magnitudes)
    ) < 4 * np.sqrt(counted)


def test_a_catalogue_s_error_is_a_number():
    with pytest.raises(ValueError, match="error_arcsec is -1: give arcseconds, 0 or more"):
        StarTable.of(np.eye(3)[[0, 1, 2, 0]], CAMERA, -1)


def test_mirror_image_fits_nothing(sky, table):
    rng = np.random.default_rng(1707)
    _, pixels = spots(sky, Rotation.random(rng=rng).as_matrix(), rng)
    rays = CAMERA.rays(pixels)
    std = np.full(len(rays), STD)
    assert identify(rays, std, table).status == "ok"
    assert identify(rays * [-1, 1, 1], std, table).status == NONE


def test_two_places_alike_are_ambiguous(sky):
    """A catalogue that holds one stretch of the sky twice."""
    rng = np.random.default_rng(1708)
    attitude = Rotation.random(rng=rng).as_matrix()
    stars, pixels = spots(sky, attitude, rng)
    stretch = sky.directions[stars]
    elsewhere = Rotation.from_rotvec([0, 2.0, 0]).apply(stretch)
    table = StarTable.of(np.concatenate([stretch, elsewhere]), CAMERA)
    found = identify(CAMERA.rays(pixels), np.full(len(stars), STD), table)
    assert found.status == "ambiguous"
    assert (found.stars == -1).all()


def test_a_close_pair_in_the_catalogue_is_no_second_place(sky):
    """Every star has a neighbour within the tolerance: whichever is named, the attitude is the same."""
    rng = np.random.default_rng(1709)
    stars, pixels = spots(sky, Rotation.random(rng=rng).as_matrix(), rng)
    stretch = sky.directions[stars]
    beside = Rotation.from_rotvec([0, 0, STD]).apply(stretch)
    table = StarTable.of(np.concatenate([stretch, beside]), CAMERA)
    assert identify(CAMERA.rays(pixels), np.full(len(stars), STD), table).status == "ok"


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few(table, count):
    rays = CAMERA.rays(np.array([[100.0, 100], [500, 900], [800, 300]])[:count].reshape(-1, 2))
    found = identify(rays, np.full(count, STD), table)
    assert found.status == "fewer than 4 stars"
    assert found.stars.shape == (count,)


def test_spots_in_one_line_make_no_triangle(table):
    rays = CAMERA.rays(np.column_stack([np.linspace(10, 1000, 8), np.full(8, 500.0)]))
    found = identify(rays, np.full(8, STD), table)
    assert (found.status, found.triangles) == (NONE, 0)


@pytest.mark.parametrize(
    ("directions", "message"),
    [
        (np.eye(3), r"directions of shape \(3, 3\): give \(N, 3\), 4 stars or more"),
        (np.ones((5, 3)), "one is no unit vector"),
        (np.full((5, 3), np.nan), "one is no unit vector"),
        (np.ones((5, 2)), r"shape \(5, 2\)"),
    ],
)
def test_catalogues_that_are_none(directions, message):
    with pytest.raises(ValueError, match=message):
        StarTable.of(directions, CAMERA)


def test_a_catalogue_too_long_for_the_field():
    sky = made_up_sky(7.5, np.random.default_rng(1710))
    with pytest.raises(Refusal, match="pairs in the field, more than a table holds"):
        StarTable.of(sky.directions, Camera(512, 512, 300.0))
