"""One image's steps: geometry of the ellipse's centre, profiles, attitudes by each way."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from cameras import EARTH, ONE, SUN, pair, recording, shot, write
from hypothesis import given
from hypothesis import strategies as st

import sensorbook
from sensorbook.attitude.rotations import error_vector
from sensorbook.camera.baseline import HIGH, LOW, baseline
from sensorbook.camera.ellipse import Ellipse, direct_ellipse
from sensorbook.camera.model import Camera
from sensorbook.camera.steps import (
    CHAIN,
    FIRST,
    JOINT,
    PATCH,
    around,
    best_edge,
    centre_bias,
    edge_profile,
    field_of_view,
    gradient,
    half_ellipse,
    patch,
    share_on_limb,
    shared_residual,
    take_steps,
    telling_pixel,
)
from sensorbook.camera.survey import survey

WIDE = Camera(4001, 3001, 300.0)  # C's focal length and more of the plane


def limb_pixels(off, radius, camera=WIDE, count=400):
    """Pixels of a limb whose centre is `off` the axis, to the right."""
    axis = np.array([np.sin(off), 0, np.cos(off)])
    right, down = np.array([np.cos(off), 0, -np.sin(off)]), np.array([0, 1.0, 0])
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    rays = np.cos(radius) * axis + np.sin(radius) * (np.cos(turn) * right + np.sin(turn) * down)
    return camera.project(rays)


@pytest.mark.parametrize(
    ("off", "radius"), [(5, 8.7), (20, 13.9), (10, 49.6), (30, 49.6), (60, 20)]
)
def test_the_centre_s_bias_is_that_of_a_fitted_ellipse(off, radius):
    off, radius = np.radians([off, radius])
    ellipse = direct_ellipse(limb_pixels(off, radius))
    ray = WIDE.rays(ellipse.centre)
    assert np.arctan2(ray[0], ray[2]) - off == pytest.approx(centre_bias(off, radius), abs=1e-6)


def test_no_bias_on_the_axis_and_none_of_a_hyperbola():
    assert centre_bias(0.0, 0.8) == 0.0
    assert centre_bias(np.radians(50), np.radians(40)) is None
    assert centre_bias(np.radians(50), np.radians(39.9)) is not None
    assert centre_bias(np.radians(120), np.radians(50)) is None


@given(st.floats(0.01, 1.5), st.floats(0.01, 1.5))
def test_the_bias_is_outward(off, radius):
    bias = centre_bias(off, radius)
    assert (bias is None) == (off + radius >= np.pi / 2) or abs(off + radius - np.pi / 2) < 1e-6
    if bias is not None:
        assert 0 < bias < np.pi / 2 - off + 1e-9


def test_field_of_view():
    assert np.degrees(field_of_view(Camera(1280, 720, 369.5))) == pytest.approx(
        [120.0, 88.5], abs=0.02
    )
    off = Camera(100, 100, 50.0, principal_point=(-0.5, 49.5))  # all of it on one side of the axis
    assert np.degrees(field_of_view(off)) == pytest.approx([np.degrees(np.arctan(2)), 90])


def thresholded(found):
    """Canny's edges from what is largest along the gradient: all above LOW that touch one above HIGH."""
    weak, strong = (found.thin & (found.size > level) for level in (LOW, HIGH))
    _, sets = cv2.connectedComponents(weak.astype(np.uint8), connectivity=8)
    return weak & np.isin(sets, sets[strong])


@pytest.mark.parametrize("seed", [0, 1])
def test_the_gradient_is_canny_s(seed):
    chain = baseline(shot(seed).image(), ONE)
    assert chain.edges.sum() > 100
    np.testing.assert_array_equal(thresholded(gradient(chain.filtered)), chain.edges)
    # Edges in every direction, to the border.
    noise = np.random.default_rng(seed).integers(0, 256, (90, 120)).astype(np.uint8)
    rough = cv2.medianBlur(noise, 7)
    chain = baseline(cv2.resize(rough, (640, 360)), ONE)
    np.testing.assert_array_equal(thresholded(gradient(chain.filtered)), chain.edges)


def test_the_pixel_shown_has_edges_of_both_kinds():
    chain = baseline(shot(0).image(), ONE)
    found = gradient(chain.filtered)
    pixel = telling_pixel(chain, found)
    assert chain.edges[pixel[::-1]]
    thin, size = patch(found.thin, pixel), patch(found.size, pixel)
    assert thin.shape == (PATCH, PATCH)
    assert size[PATCH // 2, PATCH // 2] == found.size[pixel[::-1]]
    assert (thin & (size > HIGH)).any()
    assert (thin & (size > LOW) & (size <= HIGH)).any()


def test_a_patch_stays_inside():
    image = np.arange(20 * 30).reshape(20, 30)
    np.testing.assert_array_equal(patch(image, (0, 19), 7), image[13:, :7])
    np.testing.assert_array_equal(patch(image, (10, 8), 7), image[5:12, 7:14])
    assert patch(image[:5], (29, 0), 7).shape == (5, 7)


class Chain:
    """Edges of an ellipse whose part from 0° to 240° is seen."""

    turn = np.radians(np.arange(0.0, 240.0))
    chain = np.stack([300 + 120 * np.cos(turn), 200 + 80 * np.sin(turn)], axis=1)[::-1]
    ellipse = Ellipse(np.array([300.0, 200]), np.array([120.0, 80]), 0.0, np.zeros(6))


def test_half_of_an_ellipse_s_edges():
    points, ellipse = half_ellipse(Chain)
    # The half after the gap, in its order, whatever that of the chain was.
    np.testing.assert_allclose(points, Chain.chain[::-1][:120])
    # Exact points, but for the barrier, which pulls on an arc of 120° by a fraction of a pixel.
    assert ellipse.centre == pytest.approx(Chain.ellipse.centre, abs=1.0)


def test_the_part_of_a_chain_that_is_limb(steps):
    limb, camera = steps.limb, steps.earth.camera
    assert share_on_limb(steps.chain, limb, camera) > 0.5

    class Both:
        on = limb.pixels[limb.used]
        chain = np.concatenate([on, on + np.array([0, 40.0])])

    assert 0.45 < share_on_limb(Both, limb, camera) < 0.6


@pytest.mark.parametrize(("wave", "least", "most"), [(0.0, 0.05, 0.12), (1.0, 0.6, 0.75)])
def test_what_neighbours_share(steps, wave, least, most):
    limb, rng = steps.limb, np.random.default_rng(2)
    turn = around(limb, limb.rays)
    used = np.ones(len(turn), dtype=bool)
    # Noise of 0.3 px has 0.08 in means of fifteen; waves of 1 px, 0.71 rms.
    noisy = 0.3 * rng.standard_normal(len(turn)) + wave * np.sin(10 * turn)
    assert least < shared_residual(replace(limb, used=used, residuals=noisy)) < most


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    return stepped(tmp_path_factory.mktemp("steps") / "one", shot(0))


def stepped(folder, moment, known=("time", "place", "truth")):
    text, image = recording("a.png"), {"a.png": moment.image()}
    runs = sensorbook.load(write(folder, [text], image, [moment.row("a.png", known)])).runs(
        "camera", "images"
    )
    found = survey(runs)
    return take_steps(found.earth, found.sun)


def test_attitudes_by_each_way(steps):
    moment = shot(0)
    assert {FIRST, JOINT} <= set(steps.matrices) <= {CHAIN, FIRST, JOINT}
    assert steps.matrices[JOINT] == pytest.approx(steps.earth.matrix, abs=1e-12)
    for name, error in steps.errors().items():
        true = np.linalg.norm(error_vector(steps.matrices[name], moment.attitude))
        assert error == pytest.approx(true)
    assert steps.errors()[JOINT] < np.radians(0.1)
    assert steps.apart(JOINT) == 0
    assert steps.apart(FIRST) < np.radians(1)
    haze, std = steps.found.haze
    assert abs(haze) < 6 * std, "the ground that was rendered has no air"


def test_without_the_truth_there_are_no_errors(tmp_path):
    steps = stepped(tmp_path / "one", shot(0), ("time", "place"))
    assert steps.errors() == {}
    assert JOINT in steps.matrices


def test_without_a_pose_there_is_no_attitude(tmp_path):
    steps = stepped(tmp_path / "one", shot(0), ("time",))
    assert (steps.matrices, steps.found) == ({}, None)
    assert steps.limb.direction is not None


def test_a_pair(tmp_path):
    moment = pair(0)
    folder = write(
        tmp_path / "pair",
        [recording("e.png", EARTH, "earth"), recording("s.png", SUN, "sun")],
        {"e.png": moment.image(EARTH), "s.png": moment.image(SUN)},
        [moment.row("e.png"), moment.row("s.png")],
    )
    found = survey(sensorbook.load(folder).runs("camera", "images"))
    steps = take_steps(found.earth, found.sun)
    assert steps.earth_image is not steps.sun_image
    assert steps.matrices[JOINT] == pytest.approx(found.chosen.matrix, abs=1e-12)
    assert steps.errors()[JOINT] < np.radians(0.1)


def test_nothing_readable():
    steps = take_steps(None, None)
    assert (steps.limb, steps.errors(), steps.matrices) == (None, {}, {})


def test_the_profile_rises_where_the_edge_is(steps):
    limb = steps.limb
    edge = best_edge(limb, ONE)
    assert limb.used[edge]
    along, values = edge_profile(steps.earth_image, limb, ONE, edge)
    assert (along[0], along[-1]) == (-14, 8)
    dark, bright = values[along < -2], values[(along > 1) & (along < 3)]
    assert dark.max() < bright.min()
    half = (np.median(dark) + np.median(bright)) / 2
    assert abs(along[np.argmax(values > half)]) <= 1.0, "within a pixel of where it was put"


def test_azimuths_turn_from_right_towards_down(steps):
    limb = steps.limb
    turn = around(limb, limb.rays[limb.used])
    n = limb.direction
    right = np.array([1.0, 0, 0]) - n[0] * n
    right /= np.linalg.norm(right)
    down = np.cross(n, right)
    rays = limb.rays[limb.used] - (limb.rays[limb.used] @ n)[:, None] * n
    assert np.cos(turn) * np.linalg.norm(rays, axis=1) == pytest.approx(rays @ right, abs=1e-12)
    assert np.sin(turn) * np.linalg.norm(rays, axis=1) == pytest.approx(rays @ down, abs=1e-12)
    ahead = around(
        type("Ahead", (), {"direction": np.array([0, 0, 1.0])})(),
        np.array([[0.1, 0, 1], [0, 0.1, 1]]),
    )
    assert np.degrees(ahead) == pytest.approx([0, 90])
