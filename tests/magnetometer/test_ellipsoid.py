"""The ellipsoid: exact readings, derivatives, and what noise does to it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sensorbook.magnetometer.ellipsoid import (
    BASES,
    ENTRIES,
    PARAMETERS,
    algebraic,
    design,
    noise_slopes,
    packed,
    refine,
    residuals,
    sphere,
    spread,
    unpacked,
    without_noise_bias,
)

from .turns import anywhere, soft_iron_of

FULL = BASES["ellipsoid"]


def fitted(m):
    start = algebraic(m)
    return refine(m, sphere(m) if start is None else start, FULL)


def on_ellipsoid(u, h, s):
    """(N, 3) readings whose corrected directions are `u`, field 1."""
    return np.linalg.solve(s, u.T).T + h


# ---- parameters ----


def test_parameters_are_named_in_their_order():
    s = np.array([[1.0, 4, 5], [4, 2, 6], [5, 6, 3]])
    p = packed(np.array([7.0, 8, 9]), s)
    np.testing.assert_array_equal(p, [7, 8, 9, 1, 2, 3, 4, 5, 6])
    assert PARAMETERS[3:] == tuple(f"soft_iron.{a}" for a in ("xx", "yy", "zz", "xy", "xz", "yz"))
    h, back = unpacked(p)
    np.testing.assert_array_equal(h, [7, 8, 9])
    np.testing.assert_array_equal(back, s)


def test_reduced_models_leave_these_alone():
    d = BASES["diagonal"] @ np.arange(1.0, 7)
    np.testing.assert_array_equal(d, [1, 2, 3, 4, 5, 6, 0, 0, 0])
    np.testing.assert_array_equal(BASES["hard_iron"] @ [1, 2, 3, 4.0], [1, 2, 3, 4, 4, 4, 0, 0, 0])


# ---- exact readings ----


@pytest.mark.parametrize("ratio", [1.0, 1.3, 1.7, 2.2])
@pytest.mark.parametrize("seed", range(5))
def test_exact_readings_give_the_exact_parameters(ratio, seed):
    rng = np.random.default_rng([seed, 1])
    s = soft_iron_of(rng, [1, rng.uniform(1, ratio), ratio])
    h = rng.uniform(-2, 2, 3)
    found = fitted(on_ellipsoid(anywhere(rng, 400), h, s))
    np.testing.assert_allclose(found, packed(h, s), rtol=0, atol=1e-9)


@pytest.mark.parametrize("factors", [(1, 1, 3), (1, 3, 3), (1, 2, 3), (1, 1, 5), (1, 5, 5)])
@pytest.mark.parametrize("seed", range(5))
def test_flat_and_long_ellipsoids_are_reached_by_refining(factors, seed):
    """Beyond what `algebraic` admits (axes of more than 1 : 2)."""
    rng = np.random.default_rng([seed, 2])
    s, h = soft_iron_of(rng, factors), rng.uniform(-1, 1, 3)
    found = fitted(on_ellipsoid(anywhere(rng, 400), h, s))
    np.testing.assert_allclose(found, packed(h, s), rtol=0, atol=1e-9)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    hnp.arrays(float, 3, elements=st.floats(-5, 5)),
    st.tuples(*[st.floats(0.7, 1.5)] * 3),
    st.integers(0, 2**32 - 1),
    st.floats(1e-6, 1e6),
)
def test_any_well_posed_ellipsoid_is_recovered_in_any_unit(h, factors, seed, unit):
    rng = np.random.default_rng(seed)
    s = soft_iron_of(rng, factors)
    m = on_ellipsoid(anywhere(rng, 200), h, s) * unit
    found = fitted(m)
    # Readings up to 10 in size, h some of it: rounding of 1e-15 × (size) × dilution of 200 directions.
    np.testing.assert_allclose(found[:3] / unit, h, rtol=0, atol=1e-9)
    np.testing.assert_allclose(unpacked(found)[1] * unit, s, rtol=0, atol=1e-9)


def test_reduced_models_of_exact_readings():
    rng = np.random.default_rng(3)
    u, h = anywhere(rng, 300), np.array([0.3, -0.2, 0.5])
    factors = np.diag([1.1, 0.9, 1.04])
    m = on_ellipsoid(u, h, factors)
    found = refine(m, sphere(m), BASES["diagonal"])
    np.testing.assert_allclose(found, packed(h, factors), rtol=0, atol=1e-9)
    m = on_ellipsoid(u, h, 1.3 * np.eye(3))
    found = refine(m, sphere(m), BASES["hard_iron"])
    np.testing.assert_allclose(found, packed(h, 1.3 * np.eye(3)), rtol=0, atol=1e-9)


# ---- derivatives ----


@pytest.mark.parametrize("seed", range(5))
def test_design_by_finite_differences(seed):
    rng = np.random.default_rng([seed, 4])
    p = packed(rng.uniform(-0.5, 0.5, 3), soft_iron_of(rng, [0.8, 1.1, 1.5]))
    m = rng.standard_normal((50, 3))
    m += 2 * m / np.linalg.norm(m, axis=1)[:, None]  # none near the centre
    step = 1e-5
    numeric = np.stack(
        [
            (residuals(m, p + step * e)[0] - residuals(m, p - step * e)[0]) / (2 * step)
            for e in np.eye(9)
        ],
        axis=1,
    )
    # Central differences: step² times third derivatives, and rounding of 1e-16 / step.
    np.testing.assert_allclose(design(residuals(m, p)[1], m, p), numeric, rtol=0, atol=1e-9)


# ---- noise ----


def product(m, p):
    """(N, 9) design · residual, whose sum a least-squares fit makes zero."""
    r, u = residuals(m, p)
    return design(u, m, p) * r[:, None]


def test_noise_slopes_are_half_the_laplacian():
    """To second order, noise of variance v adds ½ v ∇² to the mean of a function of the reading."""
    rng = np.random.default_rng(5)
    p = packed(np.array([0.2, -0.1, 0.3]), soft_iron_of(rng, [0.8, 1.0, 1.4]))
    h, s = unpacked(p)
    u = anywhere(rng, 40)
    m = on_ellipsoid(u, h, s)
    step = 1e-3
    laplacian = sum(
        product(m + step * e, p) + product(m - step * e, p) - 2 * product(m, p) for e in np.eye(3)
    )
    # Residuals that are tiny, and as noise of one variance on every axis would make them.
    gradient = u @ s
    size = np.linalg.norm(gradient, axis=1)[:, None]
    off = 1e-5 * np.where(rng.random(40) < 0.5, 1, -1)[:, None] * size
    near = m + off * gradient / size**2
    found = noise_slopes(near, p) / 1e-10
    # 1e-5 off the ellipsoid; the difference quotient is good to step².
    np.testing.assert_allclose(found, laplacian / step**2 / 2, rtol=0, atol=1e-3)


def test_noise_slopes_are_the_mean_of_draws():
    rng = np.random.default_rng(6)
    p = packed(np.array([0.2, -0.1, 0.3]), soft_iron_of(rng, [0.8, 1.0, 1.4]))
    h, s = unpacked(p)
    m = on_ellipsoid(anywhere(rng, 200_000), h, s)
    e = 0.03 * rng.standard_normal(m.shape)
    # Noise and its mirror image: what is of first order cancels exactly.
    drawn = (product(m + e, p) + product(m - e, p)).mean(axis=0) / 2
    said = noise_slopes(m + e, p).mean(axis=0)
    # Of 5e-4 to 1e-3; terms of fourth order are 0.03² of them, the draws' scatter below 1 %.
    np.testing.assert_allclose(said, drawn, rtol=0, atol=2e-5)
    assert np.abs(drawn).max() > 5e-4


def test_the_bias_of_nine_per_cent_noise_is_taken_out():
    """30 sets of 4000 readings: the mean error is the bias, known to 0.01 %."""
    rng = np.random.default_rng(7)
    s, h = soft_iron_of(rng, [0.9, 1.0, 1.2]), np.array([0.4, -0.3, 0.1])
    before, after = [], []
    for _ in range(30):
        m = on_ellipsoid(anywhere(rng, 4000), h, s) + 0.09 * rng.standard_normal((4000, 3))
        plain = fitted(m)
        before.append(plain - packed(h, s))
        after.append(without_noise_bias(m, plain, FULL) - packed(h, s))
    before, after = np.mean(before, axis=0), np.mean(after, axis=0)
    # By hand: to second order the length grows by σ² (trace S² − |Su|²) / 2 ≈ σ², 0.8 %.
    assert np.abs(before[3:6]).min() > 5e-3
    # A standard error of the mean is 0.09 · √(10 / 4000 / 30) ≈ 8e-4 at most; the remainder is of
    # fourth order, 0.09⁴ ≈ 7e-5 times some.
    assert np.abs(after).max() < 2e-3


def test_what_is_not_determined_is_left_as_it_is():
    rng = np.random.default_rng(8)
    m = np.c_[anywhere(rng, 100)[:, :2], np.zeros(100)]
    p = packed(np.zeros(3), np.eye(3))
    np.testing.assert_array_equal(without_noise_bias(m, p, FULL), p)


# ---- starts ----


@settings(deadline=None, max_examples=300, derandomize=True)
@given(
    hnp.arrays(
        float,
        st.tuples(st.integers(1, 40), st.just(3)),
        elements=st.floats(-1e3, 1e3, allow_subnormal=False),
    )
)
def test_algebraic_is_an_ellipsoid_or_none(m):
    found = algebraic(m)
    if found is not None:
        assert np.isfinite(found).all()
        assert np.linalg.eigvalsh(unpacked(found)[1]).min() > 0


@pytest.mark.parametrize("factors", [(1, 1, 1), (1, 2, 2), (1, 1, 2), (1, 1.5, 2)])
def test_algebraic_of_exact_readings_is_exact_up_to_twice_the_shortest_axis(factors):
    rng = np.random.default_rng(9)
    s, h = soft_iron_of(rng, factors), np.array([1.0, -2, 3])
    found = algebraic(on_ellipsoid(anywhere(rng, 300), h, s))
    # Squared readings: half the digits.
    np.testing.assert_allclose(found, packed(h, s), rtol=0, atol=1e-6)


def test_readings_at_one_place_are_no_ellipsoid():
    assert algebraic(np.tile([[1.0, 2, 3]], (50, 1))) is None


@pytest.mark.parametrize("seed", range(3))
def test_sphere_is_exact(seed):
    rng = np.random.default_rng([seed, 10])
    h = rng.uniform(-3, 3, 3)
    found = sphere(on_ellipsoid(anywhere(rng, 100), h, np.eye(3) / 0.7))
    np.testing.assert_allclose(found, packed(h, np.eye(3) / 0.7), rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_sphere_of_a_circle_is_centred_in_its_plane(seed):
    rng = np.random.default_rng([seed, 11])
    frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn = 2 * np.pi * rng.random(100)
    h = np.array([1.0, -2, 0.5])
    m = 0.6 * np.c_[np.cos(turn), np.sin(turn)] @ frame[:2] + h
    found = sphere(m)
    np.testing.assert_allclose(found, packed(h, np.eye(3) / 0.6), rtol=0, atol=1e-9)


def test_sphere_of_nearly_flat_readings_is_centred_in_their_plane():
    """Noise across the plane would place the centre anywhere along its normal."""
    rng = np.random.default_rng(13)
    turn = 2 * np.pi * rng.random(500)
    m = np.c_[np.cos(turn), np.sin(turn), 0.02 * rng.standard_normal(500)] + [1, 2, 3]
    found = sphere(m, 0.1)
    # Means of 500: 0.02 / √500 ≈ 1e-3 along the normal.
    np.testing.assert_allclose(found, packed(np.array([1.0, 2, 3]), np.eye(3)), rtol=0, atol=5e-3)


def test_spread_is_the_standard_deviation_of_normal_residuals():
    r = 0.3 * np.random.default_rng(12).standard_normal(100_000)
    assert spread(r) == pytest.approx(0.3, rel=0.02)  # sd of a median's estimate: 0.4 %


def test_entries_are_those_of_a_symmetric_matrix():
    assert sorted(ENTRIES) == sorted((i, j) for i in range(3) for j in range(i, 3))
