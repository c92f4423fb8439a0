"""The camera: rays and projection are inverse, the field of view is C's, nonsense is said."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from sensorbook.camera.model import Camera, grey
from sensorbook.camera.scene import EARTH_CAMERA

WIDE = Camera(1280, 720, 369.5)  # C, table 4.2
MILD = st.floats(-0.01, 0.01)


def angle(u, v):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


def test_field_of_view_of_work_c():
    """From edge to edge of the image, half a pixel beyond the outermost pixels' centres."""
    across = angle(*WIDE.rays([[-0.5, 359.5], [1279.5, 359.5]]))
    high = angle(*WIDE.rays([[639.5, -0.5], [639.5, 719.5]]))
    assert across == pytest.approx(120.0, abs=0.02)  # printed without decimals; 120.004
    assert high == pytest.approx(88.5, abs=0.05)  # printed to 0.1


def test_axes():
    """x right, y down, z forward."""
    np.testing.assert_allclose(WIDE.rays([639.5, 359.5]), [0, 0, 1], atol=1e-15)
    right, down = WIDE.rays([[700, 359.5], [639.5, 400]])
    assert right[0] > 0
    assert abs(right[1]) < 1e-15
    assert down[1] > 0
    assert abs(down[0]) < 1e-15


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-0.5, 1279.5),
    y=st.floats(-0.5, 719.5),
    focal=st.floats(100, 5000),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    scale=st.floats(1e-3, 1e12),
)
def test_project_takes_rays_back(x, y, focal, shift, scale):
    camera = Camera(1280, 720, focal, (639.5 + shift[0], 359.5 + shift[1]))
    ray = camera.rays([x, y])
    assert np.linalg.norm(ray) == pytest.approx(1, abs=1e-15)
    # Rounding of pixels of 1e3 at slopes of up to 7.
    np.testing.assert_allclose(camera.project(scale * ray), [x, y], rtol=0, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    x=st.sampled_from([-0.5, 0.0, 639.5, 1279.5]) | st.floats(-0.5, 1279.5),
    y=st.sampled_from([-0.5, 719.5]) | st.floats(-0.5, 719.5),
    given_=st.tuples(MILD, MILD)
    | st.tuples(MILD, MILD, *[st.floats(-1e-3, 1e-3)] * 2, MILD, MILD, MILD, MILD),
)
def test_distortion_is_taken_out(x, y, given_):
    """A lens of 65° across: two coefficients, and all eight."""
    camera = Camera(1280, 720, 1000.0, distortion=given_)
    np.testing.assert_allclose(camera.project(camera.rays([x, y])), [x, y], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "distortion", [(-0.3, 0.1), (-0.28, 0.07), (-0.25, 0.05, 0.02, -0.02), (0.3, 0.2, -0.1, 0.05)]
)
def test_every_pixel_of_a_strong_lens_goes_there_and_back(distortion):
    """All of these lenses are invertible as far as C's camera sees, 63° off the axis."""
    camera = Camera(1280, 720, 369.5, distortion=distortion)
    x, y = np.meshgrid(np.arange(-0.5, 1280, 8), np.arange(-0.5, 720, 8))
    pixels = np.stack([x, y], axis=-1)
    back = camera.project(camera.rays(pixels))
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-9)


RADIAL = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.2, 0.3), st.floats(-0.05, 0.1))
BENT = st.tuples(*[st.floats(-0.02, 0.02)] * 2)
RATIONAL = st.just((0.0, 0.0, 0.0)) | st.tuples(*[st.floats(0, 0.3)] * 3)


@settings(max_examples=200, deadline=None)
@given(RADIAL, RATIONAL, st.floats(0, 1280), st.floats(0, 2 * np.pi))
def test_a_radial_distortion_against_a_search(numerator, denominator, off, turn):
    """r (1 + k₁r² + k₂r⁴ + k₃r⁶)/(1 + k₄r² + k₅r⁴ + k₆r⁶), its first rise searched with no formula."""
    (k1, k2, k3), (k4, k5, k6) = numerator, denominator

    def goes_to(r):
        s = r * r
        return r * (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))

    camera = Camera(1280, 720, 369.5, distortion=(k1, k2, 0, 0, k3, k4, k5, k6))
    way = np.array([np.cos(turn), np.sin(turn)])
    target = off / camera.focal_px
    steps = np.arange(0, 50, 1e-3)
    reached = goes_to(steps)
    falls = np.flatnonzero(np.diff(reached) <= 0)
    end = falls[0] if len(falls) else len(steps) - 1
    # Where the top is within a step, or far beyond any lens, the search does not tell.
    assume(abs(target - reached[end]) > 1e-5 and (len(falls) or target < reached[end]))
    ray = camera.rays(camera.centre + off * way)
    if target > reached[end]:
        assert np.isnan(ray).all()
        return
    first = np.argmax(reached > target)
    true = brentq(lambda r: goes_to(r) - target, steps[first - 1], steps[first], xtol=1e-15)
    # By the pixel's 1e-10 over a slope that this far from the top is 1e-4 or more.
    np.testing.assert_allclose(ray[:2] / ray[2], true * way, rtol=0, atol=1e-8)
    np.testing.assert_allclose(camera.project(ray), camera.centre + off * way, rtol=0, atol=1e-9)


@settings(max_examples=200, deadline=None)
@given(RADIAL, BENT, RATIONAL, st.floats(0, 1.5), st.floats(0, 2 * np.pi))
def test_all_coefficients_against_opencv(radial, bent, rational, r, turn):
    """A direction that OpenCV projects into a pixel is found from there, as long as the image grows."""
    k1, k2, k3 = radial
    camera = Camera(1280, 720, 369.5, distortion=(k1, k2, *bent, k3, *rational))
    matrix = np.array([[369.5, 0, 639.5], [0, 369.5, 359.5], [0, 0, 1]])

    def opencv(points):
        flat = np.c_[points, np.ones(len(points))].reshape(-1, 1, 3)
        return cv2.projectPoints(
            flat, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion)
        )[0][:, 0]

    plane = r * np.array([np.cos(turn), np.sin(turn)])
    # From the axis to there, and all around as far off, the image grows by at least a tenth.
    turns = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    disc = (np.linspace(0, 1.1 * r, 60)[:, None, None] * ring).reshape(-1, 2)
    steps = 1e-5 * np.eye(2)
    slopes = np.stack([opencv(disc + h) - opencv(disc - h) for h in steps], axis=-1)
    slopes /= 2e-5 * camera.focal_px
    assume((np.linalg.eigvalsh((slopes + np.swapaxes(slopes, -1, -2)) / 2) > 0.1).all())
    pixel = opencv(plane[None])[0]
    np.testing.assert_allclose(camera.project([*plane, 1.0]), pixel, rtol=0, atol=1e-9)
    ray = camera.rays(pixel)
    np.testing.assert_allclose(ray[:2] / ray[2], plane, rtol=0, atol=1e-10)


@pytest.mark.parametrize("small", [-1e-38, 5e-324, -1e-16])
def test_next_to_no_distortion(small):
    camera = Camera(1280, 720, 369.5, distortion=(0, 0, 0, 0, small))
    pixels = [[0, 0], [639.5, 359.5], [1000, 100]]
    # 1e-16 of the distance, at most 63° off.
    np.testing.assert_allclose(camera.rays(pixels), WIDE.rays(pixels), rtol=0, atol=1e-13)


def test_pixels_without_a_direction_have_none():
    """r(1 − 0.2 r²) goes no further than √(1/0.6)·2/3 = 0.861, 258 px here."""
    camera = Camera(1000, 800, 300.0, distortion=(-0.2,))
    top = 300 * np.sqrt(1 / 0.6) * 2 / 3
    rays = camera.rays(camera.centre + np.array([[top - 1e-6, 0], [top + 1e-6, 0], [0, -400]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1:]).all()
    assert np.isnan(camera.project(rays[1:])).all()
    assert camera.sees(rays).tolist() == [True, False, False]
    known = np.isfinite(camera.grid).all(axis=-1)
    x, y = np.meshgrid(np.arange(1000) - 499.5, np.arange(800) - 399.5)
    np.testing.assert_array_equal(known, np.hypot(x, y) < top)
    assert (np.isnan(camera.grid).any(axis=-1) == ~known).all()


@pytest.mark.parametrize("distortion", [(), (-0.3, 0.1), (-0.2, 0.0, 0.01)])
def test_no_points_and_far_points(distortion):
    camera = Camera(1280, 720, 369.5, distortion=distortion)
    assert camera.rays(np.zeros((0, 2))).shape == (0, 3)
    assert camera.rays(np.zeros((4, 0, 2))).shape == (4, 0, 3)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.sees(np.zeros((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match=r"a pixel 1e\+300 away: give places in or near the image"):
        camera.rays([1e300, 0])


@pytest.mark.parametrize("distortion", [(), (-0.3, 0.1)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_directions_that_are_not_finite(distortion, bad, place):
    direction = np.array([0.1, 0.2, 1.0])
    direction[place] = bad
    camera = Camera(1280, 720, 369.5, distortion=distortion)
    pixels = camera.project([direction, [0, 0, 1]])
    assert np.isnan(pixels[0]).all()
    np.testing.assert_allclose(pixels[1], [639.5, 359.5])
    assert not camera.sees(direction)


def test_distortion_is_the_formulas():
    """x' = x (1 + k₁r² + k₂r⁴) of Brown."""
    camera = Camera(1000, 800, 500.0, distortion=(-0.1, 0.02))
    r2 = 0.3**2 + 0.2**2
    factor = 1 - 0.1 * r2 + 0.02 * r2**2
    expected = 500 * factor * np.array([0.3, -0.2]) + [499.5, 399.5]
    np.testing.assert_allclose(camera.project([0.3, -0.2, 1]), expected, rtol=0, atol=1e-10)


def test_no_pixel_where_the_distortion_turns_back():
    """r(1 − 0.2 r²) is largest at r = √(1/0.6): a direction at r = √5 would land on the axis."""
    camera = Camera(1000, 800, 300.0, distortion=(-0.2,))
    edge = np.sqrt(1 / 0.6)
    assert np.isfinite(camera.project([edge - 1e-6, 0, 1])).all()
    assert np.isnan(camera.project([[edge + 1e-6, 0, 1], [np.sqrt(5), 0, 1]])).all()
    assert not camera.sees([np.sqrt(5), 0, 1])


@pytest.mark.parametrize("distortion", [(), (0.01, -0.01)])
def test_behind_the_camera(distortion):
    camera = Camera(1280, 720, 369.5, distortion=distortion)
    pixels = camera.project([[0.1, 0.1, -1], [1, 0, 0], [0, 0, 1]])
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_allclose(pixels[2], [639.5, 359.5])
    assert camera.sees([[0.1, 0.1, -1], [1, 0, 0], [0, 0, 1]]).tolist() == [False, False, True]


def test_sees_with_a_margin():
    edge, inner = WIDE.rays([[-0.4, 359.5], [9.6, 359.5]])
    assert WIDE.sees([edge, inner]).tolist() == [True, True]
    assert WIDE.sees([edge, inner], 10).tolist() == [False, True]
    assert WIDE.sees([edge, inner], 10.2).tolist() == [False, False]
    assert not WIDE.sees(WIDE.rays([-0.6, 359.5]))


def test_grid_holds_all_pixels():
    camera = Camera(7, 5, 10.0, distortion=(0.1,))
    assert camera.grid.shape == (5, 7, 3)
    np.testing.assert_allclose(camera.grid[3, 6], camera.rays([6, 3]), atol=1e-15)


@pytest.mark.parametrize("distortion", [[-0.3, 0.0], [-0.1], [-1.0], [-0.28, 0.1, 0, 0, -0.02]])
def test_a_distortion_that_folds_the_image_is_refused(distortion):
    """r + k₁ r³ of C's camera, whose corner is 63° off the axis, has a top inside the image."""
    table = {"width": 1280, "height": 720, "focal_px": 369.5, "distortion": distortion}
    with pytest.raises(
        ValueError, match=r"has no direction for pixel \(0, 0\): it turns back before"
    ):
        Camera.of(table)
    Camera.of(table | {"focal_px": 7665.8})  # 4.8° off: it holds there


def test_of_a_table():
    table = {
        "width": 640,
        "height": 480,
        "focal_px": 500.5,
        "principal_point": [320, 241],
        "distortion": [-0.1, 0.01],
        "to_body": EARTH_CAMERA.tolist(),
        "sees": ["sun"],
    }
    camera = Camera.of(table)
    assert (camera.width, camera.height, camera.focal_px) == (640, 480, 500.5)
    assert camera.centre.tolist() == [320.0, 241.0]
    assert camera.distortion == (-0.1, 0.01)
    # Printed to four digits, and made a rotation.
    np.testing.assert_allclose(camera.to_body, EARTH_CAMERA, rtol=0, atol=1e-4)
    # Rounding of three products, which differs from processor to processor.
    np.testing.assert_allclose(camera.to_body @ camera.to_body.T, np.eye(3), rtol=0, atol=4e-15)
    assert "sees" in table  # left as it was


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"focal_px": -369.5}, "focal_px is -369.5: give pixels, above 0"),
        ({"focal_px": float("nan")}, "focal_px is nan"),
        ({"focal_px": None}, "focal_px is None: give pixels, above 0"),
        ({"focal_px": "400"}, "focal_px is '400': give pixels, above 0"),
        ({"width": "640"}, "width is '640': give pixels, a whole number"),
        ({"width": 640.5}, "width is 640.5: give pixels, a whole number"),
        ({"height": True}, "height is True: give pixels, a whole number"),
        ({"height": None}, "height is None"),
        ({"principal_point": "middle"}, "principal_point is middle: give x and y in pixels"),
        ({"principal_point": 3.0}, "principal_point is 3.0"),
        ({"distortion": 0.1}, "distortion is 0.1: give up to 8 numbers"),
        ({"distortion": None}, "distortion is None: give up to 8 numbers"),
        ({"distortion": ((0.1, 0.01),)}, r"distortion is \(\(0.1, 0.01\),\): give up to 8 numbers"),
        ({"distortion": ("0.1",)}, "give up to 8 numbers"),
        ({"distortion": ((0.1,), 0.1)}, "give up to 8 numbers"),
        ({"distortion": (0.1j,)}, "give up to 8 numbers"),
        ({"to_body": None}, "to_body is no rotation"),
        ({"to_body": np.full((3, 3), np.nan)}, "to_body is no rotation"),
        (
            {"to_body": [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "1"]]},
            "to_body is no rotation",
        ),
        ({"width": 0}, "image of 0 × 720"),
        ({"principal_point": (1.0, float("inf"))}, "principal_point is"),
        ({"principal_point": (1.0, 2.0, 3.0)}, "principal_point is"),
        ({"distortion": (0.0,) * 9}, "give up to 8 numbers"),
        ({"distortion": (float("nan"),)}, "give up to 8 numbers"),
        ({"to_body": 2 * np.eye(3)}, "to_body is no rotation"),
        ({"to_body": np.eye(2)}, "to_body is no rotation"),
        ({"to_body": np.diag([1.0, 1, -1])}, "to_body mirrors"),
    ],
)
def test_parameters_that_make_no_sense(changed, message):
    with pytest.raises(ValueError, match=message):
        Camera(**({"width": 1280, "height": 720, "focal_px": 369.5} | changed))


@pytest.mark.parametrize("pixels", [[np.nan, 1], [1, np.inf], [1, 2, 3], 5.0])
def test_pixels_that_are_none(pixels):
    with pytest.raises(ValueError, match="give finite x and y"):
        WIDE.rays(pixels)


def test_directions_that_are_none():
    with pytest.raises(ValueError, match=r"directions of shape \(2,\)"):
        WIDE.project([1, 2])
    assert np.isnan(WIDE.project([0.1, 0.1, np.nan])).all()


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((720, 1280, 3), np.uint8), r"shape \(720, 1280, 3\): give one grey channel"),
        (np.zeros((720, 1280), np.uint16), "image is of uint16: give 8-bit values"),
        (np.zeros((720, 1280)), "image is of float64"),
        (np.zeros((480, 640), np.uint8), "image is 640 × 480 pixels, its camera 1280 × 720"),
        (np.zeros((0, 0), np.uint8), "image is 0 × 0 pixels"),
    ],
)
def test_arrays_that_are_no_image(image, message):
    with pytest.raises(ValueError, match=message):
        grey(image, WIDE)
