"""Ellipses: exact points, the authors' own fits, noise, distances by brute force, and what is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize, minimize_scalar

from sensorbook import Refusal
from sensorbook.camera.ellipse import Ellipse, direct_ellipse, guaranteed_ellipse

FITS = {"direct": direct_ellipse, "guaranteed": guaranteed_ellipse}
BOTH = pytest.mark.parametrize("fit", FITS.values(), ids=FITS)


def on_ellipse(turns, centre, semi_axes, angle):
    """(N, 2) points at eccentric angles (N,)."""
    c, s = np.cos(angle), np.sin(angle)
    local = np.stack([np.cos(turns), np.sin(turns)], axis=1) * semi_axes
    return local @ [[c, s], [-s, c]] + centre


def value(coefficients, points):
    a, b, c, d, e, f = coefficients
    x, y = points.T
    return a * x * x + b * x * y + c * y * y + d * x + e * y + f


def sampson(parameters, points):
    """Sum of squared Sampson distances, written out: F / |∇F|."""
    x, y, major, minor, angle = parameters
    c, s = np.cos(angle), np.sin(angle)
    u, v = (
        (points - [x, y]) @ np.array([[c, -s], [s, c]]) @ np.diag([1 / major, 1 / minor]).T * 1.0,
        0,
    )
    squares = (u**2).sum(axis=1) - 1
    slope = 2 * np.hypot(u[:, 0] / major, u[:, 1] / minor)
    return ((squares / slope) ** 2).sum() + v


def parameters_of(ellipse):
    return np.r_[ellipse.centre, ellipse.semi_axes, ellipse.angle]


def apart(angle, other):
    """Between two undirected lines, rad."""
    return abs((angle - other + np.pi / 2) % np.pi - np.pi / 2)


# ---- exact points ----


@pytest.mark.parametrize(
    ("fit", "arc", "tolerance"),
    [(direct_ellipse, arc, 1e-9) for arc in (20, 40, 60, 180, 360)]
    # The barrier's α² = 1e-6 pulls, the more the less the arc tells.
    + [(guaranteed_ellipse, 180, 1e-4), (guaranteed_ellipse, 360, 1e-6)],
)
@pytest.mark.parametrize("off", [0.0, 1e4])
def test_exact_points_give_the_ellipse(fit, arc, tolerance, off):
    rng = np.random.default_rng([201, arc])
    for _ in range(40):
        major = rng.uniform(100, 500)
        semi_axes = np.array([major, major * rng.uniform(0.5, 0.95)])
        centre, angle = off * rng.uniform(-1, 1, 2), rng.uniform(-1.5, 1.5)
        turns = rng.uniform(0, 7) + np.radians(np.linspace(0, arc, 200, endpoint=False))
        found = fit(rng.permutation(on_ellipse(turns, centre, semi_axes, angle)))
        # Of the ellipse's size; coordinates of 1e4 are rounded to 1e-12, which 20° dilute 1e4 times.
        np.testing.assert_allclose(found.centre, centre, rtol=0, atol=tolerance * major)
        np.testing.assert_allclose(found.semi_axes, semi_axes, rtol=0, atol=tolerance * major)
        assert apart(found.angle, angle) < 20 * tolerance  # axes 5 % apart dilute it 20 times


def test_the_published_barrier_moves_short_arcs():
    """Exact points of 40° of an ellipse: the direct fit finds it, the guaranteed one a rounder one."""
    turns = np.radians(np.linspace(0, 40, 200))
    points = on_ellipse(turns, [0, 0], [300, 200], 0.4)
    np.testing.assert_allclose(direct_ellipse(points).centre, 0, atol=1e-6)
    found = guaranteed_ellipse(points)
    assert np.linalg.norm(found.centre) > 5
    assert found.distance(points).max() < 0.2  # and hardly off the points for all that


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    ratio=st.one_of(st.just(1.0), st.floats(0.05, 1.0), st.floats(0.999999, 1.0)),
    angle=st.floats(-1.5, 1.5),
    size=st.floats(1e-3, 1e5),
    place=st.floats(-10, 10),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_ellipse_is_recovered(ratio, angle, size, place, seed):
    rng = np.random.default_rng(seed)
    centre = size * np.array([place, -place / 2])
    semi_axes = size * np.array([1.0, ratio])
    # Six or more all round: gaps up to 1 rad.
    turns = np.arange(0, 2 * np.pi, 0.6) + rng.uniform(0, 0.4, 11)
    found = direct_ellipse(on_ellipse(turns, centre, semi_axes, angle))
    # Places ten sizes off cost one digit, axes 1 : 20 three.
    np.testing.assert_allclose(found.centre, centre, rtol=0, atol=1e-11 * size)
    np.testing.assert_allclose(found.semi_axes, semi_axes, rtol=0, atol=1e-11 * size)
    if ratio < 0.99:
        assert apart(found.angle, angle) < 1e-9


@pytest.mark.parametrize(
    ("fit", "tolerance"), [(direct_ellipse, 1e-13), (guaranteed_ellipse, 1e-7)]
)
def test_a_circle(fit, tolerance):
    turns = np.linspace(0, 6, 50)
    found = fit(on_ellipse(turns, [640, 360], [200, 200], 0))
    np.testing.assert_allclose(found.semi_axes, 200, rtol=tolerance)
    np.testing.assert_allclose(found.centre, [640, 360], rtol=tolerance)
    assert np.isfinite(found.angle)


@pytest.mark.parametrize(
    ("fit", "tolerance"), [(direct_ellipse, 1e-10), (guaranteed_ellipse, 1e-5)]
)
def test_six_points_are_enough(fit, tolerance):
    points = on_ellipse(np.arange(6.0), [3, 4], [5, 2], 0.3)
    found = fit(points)
    np.testing.assert_allclose(parameters_of(found), [3, 4, 5, 2, 0.3], rtol=tolerance)
    # A point named twice counts twice, and changes nothing of an exact ellipse.
    np.testing.assert_allclose(
        parameters_of(fit(np.r_[points, points])), [3, 4, 5, 2, 0.3], rtol=tolerance
    )


@BOTH
def test_coefficients_vanish_on_the_ellipse_and_are_minus_one_at_its_centre(fit):
    points = on_ellipse(np.linspace(0, 5, 40), [600, 300], [200, 150], -0.7)
    found = fit(points)
    # Terms of 600² / 150² = 16, each rounded.
    own = found.points(40)
    np.testing.assert_allclose(value(found.coefficients, own), 0, atol=1e-12)
    np.testing.assert_allclose(value(found.coefficients, points), 0, atol=1e-6)
    np.testing.assert_allclose(value(found.coefficients, found.centre), -1, rtol=1e-12)
    a, b, c, *_ = found.coefficients
    assert 4 * a * c - b * b > 0


def test_angle_of_upright_and_lying_ellipses():
    turns = np.arange(0, 6, 0.5)
    assert direct_ellipse(on_ellipse(turns, [0, 0], [5, 2], 0)).angle == pytest.approx(0, abs=1e-12)
    upright = direct_ellipse(on_ellipse(turns, [0, 0], [5, 2], np.pi / 2)).angle
    assert abs(upright) == pytest.approx(np.pi / 2, abs=1e-12)


@BOTH
def test_the_order_of_points_does_not_matter(fit):
    rng = np.random.default_rng(202)
    points = on_ellipse(np.linspace(0, 4, 300), [600, 300], [250, 200], 0.4)
    points += rng.normal(size=points.shape)
    first = parameters_of(fit(points))
    # Sums in another order: rounding, diluted by an arc of 230°.
    np.testing.assert_allclose(parameters_of(fit(rng.permutation(points))), first, rtol=1e-9)


# ---- the authors' fits ----


def table(folder, name):
    return np.loadtxt(folder / "ellipse-szpak" / name, delimiter=",", skiprows=1)


@pytest.mark.parametrize(
    ("figure", "count", "kind", "tolerance", "semi_axes", "centre", "angle"),
    [
        ("fig1_all", 50, "direct", 0.02, (313.680, 146.689), (246.6325, 250.2287), -3.1369),
        ("fig1_all", 50, "guaranteed", 0.02, (314.344, 144.208), (246.2644, 250.6108), -3.1247),
        ("fig2_half", 25, "direct", 0.02, (307.985, 123.390), (243.8646, 271.5388), -3.1289),
        ("fig2_half", 25, "guaranteed", 0.02, (323.936, 164.086), (235.0049, 231.5677), -3.0793),
    ],
)
def test_points_of_szpak(real_data, figure, count, kind, tolerance, semi_axes, centre, angle):
    """Curves of the authors, traced between the pixels of a drawing to some 0.002 px."""
    points = table(real_data, "szpak_points.csv")[:count]
    found = FITS[kind](points)
    assert found.distance(table(real_data, f"szpak_{figure}_{kind}.csv")).max() < tolerance
    np.testing.assert_allclose(found.semi_axes, semi_axes, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.centre, centre, rtol=0, atol=tolerance)
    assert apart(found.angle, angle) < 1e-4


def published_cost(parameters, points):
    """Σ Sampson distances² and (α ‖a‖²/(4ac − b²))², α = 1e-3, in coordinates scaled as Hartley's."""
    mean = points.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(points - mean, axis=1).mean()
    x, y, major, minor, angle = parameters
    even = np.array([*(scale * ([x, y] - mean)), scale * major, scale * minor, angle])
    outline = on_ellipse(np.arange(6.0), even[:2], even[2:4], angle)
    a = np.linalg.svd(np.stack([outline[:, 0] ** 2, outline[:, 0] * outline[:, 1], outline[:, 1] ** 2,
                                *outline.T, np.ones(6)], axis=1))[2][-1]  # fmt: skip
    barrier = 1e-3 * (a @ a) / (4 * a[0] * a[2] - a[1] ** 2)
    return sampson(even, scale * (points - mean)) + barrier**2


@pytest.mark.parametrize(("figure", "count"), [("fig1_all", 50), ("fig2_half", 25)])
def test_the_guaranteed_fit_of_szpak_is_at_the_minimum(real_data, figure, count):
    points = table(real_data, "szpak_points.csv")[:count]
    found = parameters_of(guaranteed_ellipse(points))
    theirs = parameters_of(direct_ellipse(table(real_data, f"szpak_{figure}_guaranteed.csv")))
    assert published_cost(found, points) < published_cost(theirs, points)
    # A search without derivatives finds nothing lower.
    lowest = minimize(published_cost, found, args=(points,), method="Nelder-Mead",
                      options={"xatol": 1e-8, "fatol": 1e-14, "maxiter": 5000})  # fmt: skip
    assert published_cost(found, points) <= lowest.fun * (1 + 1e-9)
    np.testing.assert_allclose(found, lowest.x, rtol=0, atol=1e-3)


@pytest.mark.parametrize("arc", [25, 40])
def test_short_arcs_come_to_the_minimum(arc):
    """Where the barrier holds, as much of the cost's curvature is its own."""
    rng = np.random.default_rng([210, arc])
    points = on_ellipse(np.radians(np.linspace(0, arc, 100)), [600, 300], [300, 200], 0.4)
    points += 0.3 * rng.normal(size=points.shape)
    found = parameters_of(guaranteed_ellipse(points))
    lowest = minimize(published_cost, found, args=(points,), method="Nelder-Mead",
                      options={"xatol": 1e-8, "fatol": 1e-16, "maxiter": 5000})  # fmt: skip
    assert published_cost(found, points) <= lowest.fun * (1 + 1e-9)
    np.testing.assert_allclose(found, lowest.x, rtol=0, atol=0.01)


# ---- noise ----


def test_the_direct_fit_is_the_constrained_minimum():
    """Against a search over all conics with 4ac − b² = 1, from the fit and from elsewhere."""
    rng = np.random.default_rng(203)
    points = on_ellipse(np.linspace(0, 3, 60), [1, 2], [3, 2], 0.5)
    points += 0.1 * rng.normal(size=points.shape)

    def cost(k):  # a, b, c, d, e, f scaled to the constraint
        a, b, c, *_ = k
        discriminant = 4 * a * c - b * b
        return np.inf if discriminant <= 0 else (value(k, points) ** 2).sum() / discriminant

    found = direct_ellipse(points).coefficients
    for start in (found, found + 0.02 * rng.normal(size=6)):
        lowest = minimize(cost, start, method="Nelder-Mead",
                          options={"xatol": 1e-10, "fatol": 1e-14, "maxiter": 20_000,
                                   "maxfev": 20_000})  # fmt: skip
        assert cost(found) <= lowest.fun * (1 + 1e-9)


def test_covariance_is_that_of_draws():
    rng = np.random.default_rng(204)
    truth = np.array([640, 360, 300, 220, 0.3])
    clean = on_ellipse(np.linspace(0, 4, 400), truth[:2], truth[2:4], truth[4])
    fits = [guaranteed_ellipse(clean + 0.3 * rng.normal(size=clean.shape)) for _ in range(400)]
    drawn = np.cov(np.array([parameters_of(f) for f in fits]).T)
    said = np.mean([f.covariance for f in fits], axis=0)
    # 400 draws tell a standard error to 3.5 %, and a correlation to 0.05.
    scale = np.sqrt(np.diag(drawn))
    np.testing.assert_allclose(np.sqrt(np.diag(said)), scale, rtol=0.15)
    np.testing.assert_allclose(
        said / np.outer(scale, scale), drawn / np.outer(scale, scale), atol=0.25
    )


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_a_covariance_is_honest_or_none(noise):
    """Errors squared over it average 5, ± √(10/n); of 250 draws or more 5.0 ± 0.2."""
    rng = np.random.default_rng([211, int(10 * noise)])
    squares, given_of = [], {}
    for arc in (360, 180, 120, 90, 70, 50, 30):
        for _ in range(80):
            truth = np.r_[640, 360, 300, 300 * rng.uniform(0.6, 0.9), rng.uniform(-1, 1)]
            turns = rng.uniform(0, 7) + np.radians(np.linspace(0, arc, 200))
            points = on_ellipse(turns, truth[:2], truth[2:4], truth[4])
            try:
                found = guaranteed_ellipse(points + noise * rng.normal(size=points.shape))
            except Refusal:
                continue
            given_of.setdefault(arc, []).append(found.covariance is not None)
            if found.covariance is not None:
                error = parameters_of(found) - truth
                error[4] = (error[4] + np.pi / 2) % np.pi - np.pi / 2
                squares.append(error @ np.linalg.solve(found.covariance, error))
    assert len(squares) > 150
    # To first order, on arcs that are just long enough: up to a sixth more than √(10/150) allows.
    assert np.mean(squares) == pytest.approx(5, abs=1.2)
    assert np.mean(given_of[360]) == 1
    assert np.mean(given_of[180]) > 0.95
    assert np.mean(given_of[50]) < 0.05
    assert np.mean(given_of[30]) < 0.05


def test_covariance_of_a_circle_knows_no_angle():
    turns = np.arange(0, 2 * np.pi, 0.1)
    ring = np.r_[on_ellipse(turns, [0, 0], [100, 100], 0), on_ellipse(turns, [0, 0], [101, 101], 0)]
    found = guaranteed_ellipse(ring)
    assert found.covariance[4, 4] > 1e6
    # Of n directions a centre's coordinate has variance 2σ²/n; residuals are ±0.5.
    assert found.covariance[0, 0] == pytest.approx(2 * 0.25 / len(ring), rel=0.1)
    assert direct_ellipse(ring).covariance is None


@pytest.mark.parametrize(("arc", "noise"), [(120, 0.5), (180, 0.5), (360, 2.0)])
def test_noisy_arcs_are_fitted_as_well_as_from_the_truth(arc, noise):
    rng = np.random.default_rng([205, arc, int(10 * noise)])
    for _ in range(30):
        major = rng.uniform(150, 500)
        truth = np.r_[
            rng.uniform(0, 1000, 2), major, major * rng.uniform(0.6, 1), rng.uniform(-1, 1)
        ]
        turns = rng.uniform(0, 7) + np.radians(np.linspace(0, arc, 200))
        points = on_ellipse(turns, truth[:2], truth[2:4], truth[4])
        points += noise * rng.normal(size=points.shape)
        found = guaranteed_ellipse(points)
        assert sampson(parameters_of(found), points) < sampson(truth, points)
        # The truth has the noise's scatter, √200 ± 1 times it; a fit takes five of the 200 away.
        rms = np.sqrt(np.mean(found.distance(points) ** 2))
        assert 0.8 * noise < rms < 1.2 * noise


def test_short_noisy_arcs_give_no_sliver():
    """The direct fit of such an arc is far too small, and the Sampson distance's nearest minimum too."""
    rng = np.random.default_rng(206)
    small = fitted = 0
    for _ in range(60):
        major = rng.uniform(200, 500)
        semi_axes = np.array([major, major * rng.uniform(0.6, 1)])
        turns = rng.uniform(0, 7) + np.radians(np.linspace(0, 30, 200))
        points = on_ellipse(turns, [600, 300], semi_axes, rng.uniform(-1, 1))
        points += 0.5 * rng.normal(size=points.shape)
        small += direct_ellipse(points).semi_axes[1] < 0.2 * semi_axes[1]
        try:
            found = guaranteed_ellipse(points)
        except Refusal:  # most others: their best conic is a parabola
            continue
        fitted += 1
        # Of 200 points, to 5 %; four times that.
        assert np.sqrt(np.mean(found.distance(points) ** 2)) == pytest.approx(0.5, rel=0.2)
    assert small > 40
    assert fitted > 20


# ---- points and distances ----


def test_points_lie_on_the_ellipse_and_start_at_its_larger_axis():
    ellipse = direct_ellipse(on_ellipse(np.arange(0, 6, 0.3), [6, 3], [5, 2], 0.4))
    points = ellipse.points(8)
    assert points.shape == (8, 2)
    np.testing.assert_allclose(ellipse.distance(points), 0, atol=1e-13)
    end = np.array([6, 3]) + 5 * np.array([np.cos(0.4), np.sin(0.4)])
    np.testing.assert_allclose(points[0], end, rtol=1e-12)


@pytest.mark.parametrize("ratio", [1.0, 1 - 1e-12, 0.9, 0.3, 0.01])
def test_distance_by_search(ratio):
    rng = np.random.default_rng([207, int(100 * ratio)])
    ellipse = Ellipse(np.array([3.0, -2]), np.array([10, 10 * ratio]), 0.6, np.zeros(6))
    axis, across = np.array([np.cos(0.6), np.sin(0.6)]), np.array([-np.sin(0.6), np.cos(0.6)])
    points = np.array([3.0, -2]) + np.r_[
        rng.uniform(-15, 15, (40, 2)),
        [[0, 0], 1e-9 * axis, 4 * axis, -9.99 * axis, 12 * axis],
        [3 * across, -0.01 * across, 20 * across, 1e4 * axis + across],
    ]  # fmt: skip

    def off(turn, p):
        return np.linalg.norm(on_ellipse(np.array([turn]), [3, -2], [10, 10 * ratio], 0.6) - p)

    grid = np.linspace(0, 2 * np.pi, 4001)
    outline = on_ellipse(grid, [3, -2], [10, 10 * ratio], 0.6)
    for p, found in zip(points, ellipse.distance(points), strict=True):
        near = grid[np.argmin(np.linalg.norm(outline - p, axis=1))]
        span = near - 2e-3, near + 2e-3
        best = minimize_scalar(
            off, bounds=span, args=(p,), method="bounded", options={"xatol": 1e-10}
        ).fun
        # The search's own end; a flat minimum gives the distance to rounding of the coordinates.
        assert found == pytest.approx(best, rel=1e-9, abs=1e-7)


def test_distance_takes_any_batch_and_one_point():
    ellipse = Ellipse(np.zeros(2), np.array([2.0, 1]), 0.0, np.zeros(6))
    assert ellipse.distance([5.0, 0]) == pytest.approx(3)
    assert ellipse.distance(np.zeros((3, 4, 2))) == pytest.approx(np.ones((3, 4)))
    assert ellipse.distance(np.empty((0, 2))).shape == (0,)
    with pytest.raises(ValueError, match=r"points must have shape \(…, 2\), not \(3,\)"):
        ellipse.distance([1.0, 2, 3])


# ---- what is no ellipse ----

LINE = np.linspace(-2, 2, 60)


@BOTH
@pytest.mark.parametrize("shape", [(5,), (5, 3), (2, 6, 2), ()])
def test_other_shapes_are_errors(fit, shape):
    with pytest.raises(ValueError, match=r"points must have shape \(N, 2\), not \("):
        fit(np.zeros(shape))


@BOTH
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_an_error(fit, bad):
    points = on_ellipse(np.arange(10.0), [0, 0], [2, 1], 0)
    points[3, 1] = bad
    with pytest.raises(ValueError, match="points must be finite"):
        fit(points)


@BOTH
def test_complex_points_are_an_error(fit):
    x, y = on_ellipse(np.arange(10.0), [0, 0], [2, 1], 0).T
    with pytest.raises(ValueError, match="points are complex: give x and y in two columns"):
        fit(np.stack([x + 1j * y, y], axis=1))


@BOTH
@pytest.mark.parametrize("scale", [1e200, 1e-200, 1e61, 1e-61, 1e307])
def test_units_out_of_all_bounds_are_an_error(fit, scale):
    points = on_ellipse(np.arange(10.0), [3, 4], [2, 1], 0.3) * scale
    with pytest.raises(ValueError, match=r"give them in another unit, between 1e-60 and 1e\+60"):
        fit(points)


@BOTH
@pytest.mark.parametrize("scale", [1e57, 1e-57])
def test_units_far_from_one(fit, scale):
    points = on_ellipse(np.linspace(0, 6, 50), [3, 4], [5, 2], 0.3)
    points += 0.01 * np.random.default_rng(209).normal(size=points.shape)
    one, other = fit(points), fit(points * scale)
    # A decimal scale rounds the points themselves.
    expected = parameters_of(one) * [scale, scale, scale, scale, 1]
    np.testing.assert_allclose(parameters_of(other), expected, rtol=1e-9)
    np.testing.assert_allclose(
        other.distance(points * scale), one.distance(points) * scale, rtol=1e-6
    )
    if fit is guaranteed_ellipse:
        errors = [np.sqrt(np.diag(f.covariance)) for f in (one, other)]
        np.testing.assert_allclose(
            errors[1] / [scale, scale, scale, scale, 1], errors[0], rtol=1e-6
        )


@BOTH
@pytest.mark.parametrize("count", [0, 1, 5])
def test_fewer_than_six_distinct_points_are_refused(fit, count):
    points = np.repeat(on_ellipse(np.arange(count), [0, 0], [2, 1], 0), 4, axis=0)
    with pytest.raises(Refusal, match=f"6 distinct points, and these are {count}\\. Give more"):
        fit(points)


@BOTH
@pytest.mark.parametrize("off", [0, 1e4])
@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (1, 2), (1, -0.3)])
def test_points_on_a_line_are_refused(fit, off, direction):
    with pytest.raises(Refusal, match="The 60 points lie on a straight line"):
        fit(off + LINE[:, None] * direction)


@pytest.mark.parametrize("off", [0, 500])
def test_of_a_hyperbola_the_guaranteed_fit_makes_an_ellipse(off):
    """It is what the method is made for: the points lie a hundredth of their extent, 840, off it."""
    points = 100 * np.c_[np.cosh(LINE), np.sinh(LINE)] + off
    found = guaranteed_ellipse(points)
    assert np.sqrt(np.mean(found.distance(points) ** 2)) < 15
    assert found.centre[0] - off > 1000  # on the branch's side; the hyperbola's own is at `off`


@pytest.mark.parametrize(
    "points",
    [np.c_[LINE, LINE**2], np.r_[np.c_[LINE, LINE], np.c_[LINE, LINE + 1]]],
    ids=["parabola", "parallels"],
)
@pytest.mark.parametrize("off", [0, 500])
def test_exact_parabolas_have_no_ellipse_to_start_from(points, off):
    with pytest.raises(Refusal, match="no ellipse: a parabola, a hyperbola or a pair of lines"):
        guaranteed_ellipse(100 * points + off)


def test_a_parabola_is_refused_by_the_direct_fit():
    """Of other conics it finds an ellipse, far off."""
    with pytest.raises(Refusal, match="no ellipse: a parabola, a hyperbola or a pair of lines"):
        direct_ellipse(np.c_[LINE, LINE**2])
    # An exact hyperbola would leave it to rounding whether there is one.
    branch = np.c_[np.cosh(LINE), np.sinh(LINE)]
    branch += 1e-6 * np.random.default_rng(207).normal(size=branch.shape)
    assert direct_ellipse(branch).distance(branch).max() > 0.4


def test_a_cloud_of_points_is_refused():
    rng = np.random.default_rng(208)
    with pytest.raises(Refusal, match="The points tell no ellipse: the best is"):
        guaranteed_ellipse(np.stack(np.meshgrid(LINE, LINE), axis=-1).reshape(-1, 2))
    refused = 0
    for _ in range(50):
        try:
            guaranteed_ellipse(rng.uniform(0, 100, (40, 2)))
        except Refusal:
            refused += 1
    assert refused > 40


@settings(deadline=None, max_examples=200, derandomize=True)
@given(
    st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), max_size=40),
    st.sampled_from([1e-3, 1.0, 1e4]),
)
def test_any_points_give_an_ellipse_or_a_refusal(points, scale):
    points = np.array(points, dtype=float).reshape(-1, 2) * scale
    for fit in FITS.values():
        try:
            found = fit(points)
        except Refusal:
            continue
        assert np.isfinite(parameters_of(found)).all()
        assert found.semi_axes[0] >= found.semi_axes[1] > 0
        assert np.isfinite(found.distance(points)).all()
