"""The camera: rays and projection are inverse, the field of view is C's, nonsense is said."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
    # The inversion stops at 1e-14 of the plane or after 60 rounds.
    np.testing.assert_allclose(camera.project(camera.rays([x, y])), [x, y], rtol=0, atol=1e-6)


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
    np.testing.assert_allclose(camera.to_body @ camera.to_body.T, np.eye(3), rtol=0, atol=1e-15)
    assert "sees" in table  # left as it was


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"focal_px": -369.5}, "focal_px is -369.5: give pixels, above 0"),
        ({"focal_px": float("nan")}, "focal_px is nan"),
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
