"""Representations of attitude: work C's equations coded once more, and their singularities.

The convention is passive: v_body = A v_ref.
"""

import re
import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sensorbook.attitude.rotations import (
    SEQUENCES,
    axis_angle_from_matrix,
    axis_angle_from_quaternion,
    axis_rotation,
    compose_quaternions,
    error_vector,
    euler_from_matrix,
    lock_margin,
    matrix_from_axis_angle,
    matrix_from_euler,
    matrix_from_quaternion,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    transform,
)

# A few roundings of numbers near 1.
ROUNDING = 1e-14
SYMMETRIC = [s for s in SEQUENCES if s[0] == s[2]]
LOCKS = [(s, lock) for s in SEQUENCES for lock in ((0, np.pi) if s in SYMMETRIC else (1, -1))]
LOCKS = [(s, lock if s in SYMMETRIC else lock * np.pi / 2) for s, lock in LOCKS]
SIZE = 500


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def random_quaternions(rng, size=SIZE):
    q = rng.normal(size=(size, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def random_axes(rng, size=SIZE):
    e = rng.normal(size=(size, 3))
    return e / np.linalg.norm(e, axis=1, keepdims=True)


def same(one, other, tolerance=ROUNDING):
    assert np.shape(one) == np.shape(other)
    assert np.abs(np.asarray(one) - other).max() <= tolerance


# --- work C's equations ---


def test_2_1_rows_are_the_body_axes_in_the_reference(rng):
    """A_ij is the cosine between body axis i and reference axis j."""
    turn = Rotation.random(SIZE, rng=rng)
    body_axes = (
        turn.as_matrix()
    )  # as columns: an active turn carries the reference's axes to the body's
    matrix = matrix_from_quaternion(turn.as_quat())
    for i in range(3):
        for j in range(3):
            same(matrix[:, i, j], body_axes[:, :, i] @ np.eye(3)[j])


def test_2_2_to_2_4_inverse_is_the_transpose_and_products_compose(rng):
    first, second = (matrix_from_quaternion(random_quaternions(rng)) for _ in range(2))
    same(first @ np.swapaxes(first, 1, 2), np.broadcast_to(np.eye(3), (SIZE, 3, 3)))
    v = rng.normal(size=(SIZE, 3, 1))
    same(second @ (first @ v), (second @ first) @ v)
    same(np.linalg.det(first), np.ones(SIZE))


def test_2_5_the_axis_is_the_same_in_both_frames(rng):
    e, angle = random_axes(rng), rng.uniform(-np.pi, np.pi, SIZE)
    same((matrix_from_axis_angle(e, angle) @ e[..., None])[..., 0], e)


def test_2_6_element_by_element(rng):
    e, angle = random_axes(rng), rng.uniform(-np.pi, np.pi, SIZE)
    (x, y, z), c, s = e.T, np.cos(angle), np.sin(angle)
    v = 1 - c
    printed = [
        [c + v * x * x, v * x * y + s * z, v * x * z - s * y],
        [v * x * y - s * z, c + v * y * y, v * y * z + s * x],
        [v * x * z + s * y, v * y * z - s * x, c + v * z * z],
    ]
    same(matrix_from_axis_angle(e, angle), np.moveaxis(np.array(printed), -1, 0))


def test_2_7_and_2_8_where_they_are_sound(rng):
    e, angle = random_axes(rng), rng.uniform(0.5, np.pi - 0.5, SIZE)
    a = matrix_from_axis_angle(e, angle)
    found_axis, found_angle = axis_angle_from_matrix(a)
    same(found_angle, np.arccos((np.trace(a, axis1=1, axis2=2) - 1) / 2))
    off = [a[:, 1, 2] - a[:, 2, 1], a[:, 2, 0] - a[:, 0, 2], a[:, 0, 1] - a[:, 1, 0]]
    same(found_axis, (np.array(off) / (2 * np.sin(found_angle))).T)
    same(found_angle, angle)
    same(found_axis, e)


def test_2_9_to_2_11(rng):
    e, angle = random_axes(rng), rng.uniform(0, 2.5, SIZE)
    q = np.column_stack([e * np.sin(angle / 2)[:, None], np.cos(angle / 2)])
    same(quaternion_from_axis_angle(e, angle), q)
    q1, q2, q3, q4 = q.T
    printed = [
        [q1**2 - q2**2 - q3**2 + q4**2, 2 * (q1 * q2 + q3 * q4), 2 * (q1 * q3 - q2 * q4)],
        [2 * (q1 * q2 - q3 * q4), -(q1**2) + q2**2 - q3**2 + q4**2, 2 * (q2 * q3 + q1 * q4)],
        [2 * (q1 * q3 + q2 * q4), 2 * (q2 * q3 - q1 * q4), -(q1**2) - q2**2 + q3**2 + q4**2],
    ]
    a = np.moveaxis(np.array(printed), -1, 0)
    same(matrix_from_quaternion(q), a)
    four = 0.5 * np.sqrt(1 + np.trace(a, axis1=1, axis2=2))
    off = [a[:, 1, 2] - a[:, 2, 1], a[:, 2, 0] - a[:, 0, 2], a[:, 0, 1] - a[:, 1, 0]]
    same(quaternion_from_matrix(a), np.column_stack([(np.array(off) / (4 * four)).T, four]))


def test_2_12_and_2_13(rng):
    first, second = random_quaternions(rng), random_quaternions(rng)

    def product(p, q):
        """C's 4 × 4 matrix of p times q."""
        p1, p2, p3, p4 = p
        matrix = [[p4, p3, -p2, p1], [-p3, p4, p1, p2], [p2, -p1, p4, p3], [-p1, -p2, -p3, p4]]
        return np.array(matrix) @ q

    both = np.array([product(p, q) for p, q in zip(second, first, strict=True)])
    same(compose_quaternions(second, first), both)
    same(
        matrix_from_quaternion(both),
        matrix_from_quaternion(second) @ matrix_from_quaternion(first),
    )
    v = rng.normal(size=(SIZE, 3))
    turned = [
        product(product(q, [*u, 0.0]), [*-q[:3], q[3]]) for q, u in zip(first, v, strict=True)
    ]
    same(transform(first, v), np.array(turned)[:, :3], 4 * ROUNDING)  # vectors are longer than 1
    same(np.array(turned)[:, 3], np.zeros(SIZE), 4 * ROUNDING)


@pytest.mark.parametrize("angle", [0.0, 0.3, -2.0, np.pi])
def test_2_15_and_2_16_literally(angle):
    c, s = np.cos(angle), np.sin(angle)
    assert axis_rotation("X", angle).tolist() == [[1, 0, 0], [0, c, s], [0, -s, c]]
    assert axis_rotation("Y", angle).tolist() == [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    assert axis_rotation("Z", angle).tolist() == [[c, s, 0], [-s, c, 0], [0, 0, 1]]


def angles_and_functions(rng):
    angles = rng.uniform(-np.pi, np.pi, (SIZE, 3))
    return angles, np.cos(angles).T, np.sin(angles).T


def test_2_18_is_x_minus_y_z(rng):
    """C's second rotation is about −y, that is by the negative angle about y."""
    angles, (cf, ct, cp), (sf, st_, sp) = angles_and_functions(rng)
    printed = [
        [cp * ct, sp * cf - cp * st_ * sf, sp * sf + cp * st_ * cf],
        [-sp * ct, cp * cf + sp * st_ * sf, cp * sf - sp * st_ * cf],
        [-st_, -ct * sf, ct * cf],
    ]
    same(matrix_from_euler("XYZ", angles * [1, -1, 1]), np.moveaxis(np.array(printed), -1, 0))


def test_2_19_and_2_20_z_x_z(rng):
    angles, (cf, ct, cp), (sf, st_, sp) = angles_and_functions(rng)
    printed = [
        [cp * cf - sp * ct * sf, cp * sf + sp * ct * cf, sp * st_],
        [-sp * cf - cp * ct * sf, -sp * sf + cp * ct * cf, cp * st_],
        [st_ * sf, -st_ * cf, ct],
    ]
    a = np.moveaxis(np.array(printed), -1, 0)
    same(matrix_from_euler("ZXZ", angles), a)
    extracted = [
        np.arctan2(a[:, 2, 0], -a[:, 2, 1]),
        np.arccos(a[:, 2, 2]),
        np.arctan2(a[:, 0, 2], a[:, 1, 2]),
    ]
    margin = lock_margin("ZXZ", angles)
    clear = margin > 0.05  # C's arccosine and quotients lose 1/margin of the digits
    assert clear.sum() > 0.9 * SIZE
    same(euler_from_matrix("ZXZ", a[clear]), np.array(extracted).T[clear], 1e-13)


def test_2_21_at_the_lock_only_the_sum_is_left(rng):
    one, other = rng.uniform(-1.5, 1.5, (2, SIZE))
    zero = np.zeros(SIZE)
    a = matrix_from_euler("ZXZ", np.column_stack([one, zero, other]))
    c, s = np.cos(one + other), np.sin(one + other)
    printed = [[c, s, zero], [-s, c, zero], [zero, zero, zero + 1]]
    same(a, np.moveaxis(np.array(printed), -1, 0))
    same(euler_from_matrix("ZXZ", a), np.column_stack([zero, zero, one + other]))


def test_2_25_is_z_y_x(rng):
    """C labels it Z-X-Y."""
    angles, (cp, ct, cf), (sp, st_, sf) = angles_and_functions(rng)
    printed = [
        [ct * cp, ct * sp, -st_],
        [sf * st_ * cp - cf * sp, sf * st_ * sp + cf * cp, sf * ct],
        [cf * st_ * cp + sf * sp, cf * st_ * sp - sf * cp, cf * ct],
    ]
    a = np.moveaxis(np.array(printed), -1, 0)
    same(matrix_from_euler("ZYX", angles), a)
    clear = lock_margin("ZYX", angles) > 0.05
    yaw, pitch, roll = euler_from_matrix("ZYX", a[clear]).T
    same(yaw, np.arctan2(a[clear, 0, 1], a[clear, 0, 0]), 1e-13)
    same(pitch, -np.arcsin(a[clear, 0, 2]), 1e-13)
    same(roll, np.arctan2(a[clear, 1, 2], a[clear, 2, 2]), 1e-13)


# --- all 12 sequences ---


def test_twelve_sequences():
    assert len(SEQUENCES) == len(set(SEQUENCES)) == 12
    assert len(SYMMETRIC) == 6


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_against_scipy(sequence, rng):
    """scipy's upper-case sequences are turns about the moving axes; its matrices are active."""
    angles = rng.uniform(-np.pi, np.pi, (SIZE, 3))
    theirs = np.swapaxes(Rotation.from_euler(sequence, angles).as_matrix(), 1, 2)
    same(matrix_from_euler(sequence, angles), theirs)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_angles_given_come_back(sequence, rng):
    second = (0.01, np.pi - 0.01) if sequence in SYMMETRIC else (0.01 - np.pi / 2, np.pi / 2 - 0.01)
    angles = rng.uniform(-np.pi, np.pi, (SIZE, 3))
    angles[:, 1] = rng.uniform(*second, SIZE)
    found = euler_from_matrix(sequence, matrix_from_euler(sequence, angles))
    # Rounding of the matrix, over a margin of 0.01 at least.
    same(found, angles, 2e-13)


@pytest.mark.parametrize(("sequence", "lock"), LOCKS)
def test_near_the_lock_the_matrix_comes_back(sequence, lock, rng):
    limit = (0, np.pi) if sequence in SYMMETRIC else (-np.pi / 2, np.pi / 2)
    for distance in (0.0, *10.0 ** np.arange(-16, -2)):
        for side in (-1, 1):
            angles = rng.uniform(-np.pi, np.pi, (200, 3))
            angles[:, 1] = lock + side * distance
            a = matrix_from_euler(sequence, angles)
            found = euler_from_matrix(sequence, a)
            same(matrix_from_euler(sequence, found), a)
            assert (np.abs(found[:, [0, 2]]) <= np.pi).all()
            assert ((limit[0] <= found[:, 1]) & (found[:, 1] <= limit[1])).all()
            if distance > 1e-8:
                off = np.abs(lock_margin(sequence, found) / np.sin(distance) - 1)
                assert off.max() < 1e-15 / distance


def test_scipy_errs_near_the_lock(rng):
    """Within 1e-7 of the lock it takes the angles as locked: the reason for a way of our own."""
    angles = rng.uniform(-np.pi, np.pi, (200, 3))
    angles[:, 1] = np.pi / 2 - 9e-8
    a = matrix_from_euler("ZYX", angles)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scipy's own: "Gimbal lock detected"
        theirs = Rotation.from_matrix(np.swapaxes(a, 1, 2)).as_euler("ZYX")
    assert 5e-8 < np.abs(matrix_from_euler("ZYX", theirs) - a).max() < 3e-7
    same(matrix_from_euler("ZYX", euler_from_matrix("ZYX", a)), a)


@pytest.mark.parametrize(("sequence", "lock"), LOCKS)
def test_at_the_lock_the_first_angle_is_zero(sequence, lock):
    exact = np.round(matrix_from_euler(sequence, [0.0, lock, 0.0]))
    found = euler_from_matrix(sequence, exact)
    assert found[0] == 0
    assert found[1] == lock
    assert abs(found[2]) in (0, np.pi)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_lock_margin(sequence):
    angles = np.array([[0.4, 0.0, 0.1], [0.4, 0.5, 0.1], [0.4, -0.5, 0.1], [0.4, np.pi / 2, 0.1]])
    expected = np.abs((np.sin if sequence in SYMMETRIC else np.cos)(angles[:, 1]))
    same(lock_margin(sequence, angles), expected)


@pytest.mark.parametrize("sequence", ["ZYX", "ZXZ"])
def test_an_error_is_divided_by_the_margin(sequence):
    """1e-9 rad about the axis in between moves the first angle by 1e-9/margin, the second not at all."""
    margin = 1e-3
    second = np.arcsin(margin) if sequence == "ZXZ" else np.arccos(margin)
    true = np.array([0.4, second, 0.3])
    a = matrix_from_euler(sequence, true)
    # Across the second axis and the third: the third rotation turns y (ZXZ) or z (ZYX) into the body.
    across = axis_rotation(sequence[2], 0.3) @ ([0, 1, 0] if sequence == "ZXZ" else [0, 0, 1])
    found = euler_from_matrix(sequence, matrix_from_axis_angle(across, 1e-9) @ a)
    off = np.abs(found - true)
    assert off[0] == pytest.approx(1e-9 / margin, rel=1e-3)
    assert off[1] < 1e-12
    assert off[2] == pytest.approx(1e-9 / margin, rel=1e-3)


# --- round trips ---

components = st.floats(-1, 1, allow_nan=False)
angle = st.floats(-np.pi, np.pi)


@given(st.tuples(components, components, components, components), st.sampled_from(SEQUENCES))
def test_any_quaternion_round_every_way(q, sequence):
    assume(np.linalg.norm(q) > 1e-3)
    q = np.array(q) / np.linalg.norm(q)
    a = matrix_from_quaternion(q)
    same(matrix_from_quaternion(quaternion_from_matrix(a)), a)
    same(matrix_from_axis_angle(*axis_angle_from_matrix(a)), a)
    same(matrix_from_axis_angle(*axis_angle_from_quaternion(q)), a)
    same(matrix_from_euler(sequence, euler_from_matrix(sequence, a)), a)
    found = quaternion_from_matrix(a)
    assert found[3] >= 0
    assert min(np.abs(found - q).max(), np.abs(found + q).max()) <= ROUNDING


@given(st.tuples(angle, angle, angle), st.sampled_from(SEQUENCES))
def test_any_angles_round_every_way(angles, sequence):
    a = matrix_from_euler(sequence, angles)
    found = euler_from_matrix(sequence, a)
    same(matrix_from_euler(sequence, found), a)
    low, high = (0, np.pi) if sequence in SYMMETRIC else (-np.pi / 2, np.pi / 2)
    assert low <= found[1] <= high
    same(matrix_from_quaternion(quaternion_from_matrix(a)), a)


# --- quaternions and axes at their own singularities ---


@pytest.mark.parametrize("k", range(3))
def test_half_turns_about_the_axes(k):
    a = -np.eye(3)
    a[k, k] = 1
    q = quaternion_from_matrix(a)
    assert np.abs(q).tolist() == np.eye(4)[k].tolist()
    axis, found = axis_angle_from_matrix(a)
    assert np.abs(axis).tolist() == np.eye(3)[k].tolist()
    assert found == np.pi


def test_near_half_turns_about_any_axis(rng):
    """The trace is near −1 and q₄ near 0, where C's branch divides by it."""
    e = random_axes(rng)
    for short in (0.0, *10.0 ** np.arange(-16, -2)):
        turn = np.full(SIZE, np.pi - short)
        a = matrix_from_axis_angle(e, turn)
        q = quaternion_from_matrix(a)
        same(matrix_from_quaternion(q), a)
        assert (q[:, 3] >= 0).all()
        axis, found = axis_angle_from_matrix(a)
        same(np.abs((axis * e).sum(axis=1)), np.ones(SIZE))
        same(found, turn)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6, 1e-3])
def test_tiny_angles_keep_their_digits(size, rng):
    e = random_axes(rng)
    axis, found = axis_angle_from_matrix(matrix_from_axis_angle(e, np.full(SIZE, size)))
    # The matrix holds sin Φ to 1e-16 of itself; an arccosine would lose all of 1e-12.
    same(found / size, np.ones(SIZE), 1e-9)
    same(axis, e, 1e-9)


def test_no_rotation_has_the_axis_x():
    axis, angle = axis_angle_from_matrix(np.eye(3))
    assert (axis.tolist(), angle) == ([1, 0, 0], 0)


def test_q_and_minus_q_are_one_attitude(rng):
    q = random_quaternions(rng)
    same(matrix_from_quaternion(-q), matrix_from_quaternion(q))
    for one, other in zip(
        axis_angle_from_quaternion(-q), axis_angle_from_quaternion(q), strict=True
    ):
        same(one, other)
    assert (axis_angle_from_quaternion(q)[1] <= np.pi).all()


def test_composition_order():
    """A quarter turn about x, then one about the new z: the body's x is the reference's z."""
    x, z = (quaternion_from_axis_angle(axis, np.pi / 2) for axis in np.eye(3)[[0, 2]])
    both = matrix_from_quaternion(compose_quaternions(z, x))
    same(both, axis_rotation("Z", np.pi / 2) @ axis_rotation("X", np.pi / 2))
    same(both[0], np.array([0.0, 0.0, 1.0]))
    assert np.abs(both - matrix_from_quaternion(compose_quaternions(x, z))).max() > 0.9


# --- the error vector ---


@pytest.mark.parametrize("size", [1e-12, 1e-6, 0.1, 3.0, np.pi - 1e-6])
def test_error_vector_is_what_was_turned(size, rng):
    true = matrix_from_quaternion(random_quaternions(rng))
    delta = size * random_axes(rng)
    estimated = matrix_from_axis_angle(delta / size, np.full(SIZE, size)) @ true
    # 2e-16 of rounding in each of the two factors' elements, whatever the size.
    same(error_vector(estimated, true), delta, 3e-15)


def test_error_vector_has_the_sign_of_the_linear_form(rng):
    true = matrix_from_quaternion(random_quaternions(rng, 1)[0])
    x, y, z = delta = np.array([1e-8, -2e-8, 3e-8])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    same(error_vector((np.eye(3) - cross) @ true, true), delta, 2e-15)  # 1e-15 is δ²


# --- batches and bad input ---


@pytest.mark.parametrize("batch", [(), (1,), (0,), (3, 2), (2, 1, 4)])
def test_batches_of_any_shape(batch, rng):
    q = rng.normal(size=(*batch, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    a = matrix_from_quaternion(q)
    assert a.shape == (*batch, 3, 3)
    assert quaternion_from_matrix(a).shape == (*batch, 4)
    axis, angle = axis_angle_from_matrix(a)
    assert (axis.shape, np.shape(angle)) == ((*batch, 3), batch)
    assert matrix_from_axis_angle(axis, angle).shape == (*batch, 3, 3)
    angles = euler_from_matrix("YXY", a)
    assert angles.shape == (*batch, 3)
    assert matrix_from_euler("YXY", angles).shape == (*batch, 3, 3)
    assert np.shape(lock_margin("YXY", angles)) == batch
    assert compose_quaternions(q, q).shape == (*batch, 4)
    assert transform(q, np.ones((*batch, 3))).shape == (*batch, 3)
    assert error_vector(a, a).shape == (*batch, 3)
    assert axis_rotation("X", np.ones(batch)).shape == (*batch, 3, 3)


def test_one_goes_with_many(rng):
    q = random_quaternions(rng, 5)
    same(compose_quaternions(q, q[0])[3], compose_quaternions(q[3], q[0]))
    same(transform(q, [1.0, 2.0, 3.0])[2], transform(q[2], [1.0, 2.0, 3.0]))
    same(matrix_from_axis_angle([0, 0, 1], np.ones(5))[4], axis_rotation("Z", 1.0))
    same(error_vector(matrix_from_quaternion(q), np.eye(3)).shape, (5, 3))


def test_nearly_orthogonal_is_set_right(rng):
    a = matrix_from_quaternion(random_quaternions(rng))
    rounded = quaternion_from_matrix(a.round(4))
    same(matrix_from_quaternion(rounded), a, 1e-4)
    same(np.linalg.norm(rounded, axis=1), np.ones(SIZE))


MATRIX = "direction-cosine matrix: "
BAD = [
    (quaternion_from_matrix, (2 * np.eye(3),), MATRIX + "A Aᵀ differs from the identity by 3;"),
    (quaternion_from_matrix, (np.zeros((3, 3)),), MATRIX + "A Aᵀ differs from the identity by 1;"),
    (axis_angle_from_matrix, (np.diag([1, 1, -1]),), MATRIX + "its determinant is −1; it mirrors"),
    (euler_from_matrix, ("ZYX", np.eye(4)), MATRIX + r"shape is (4, 4), needed is (…, 3, 3)"),
    (
        quaternion_from_matrix,
        (np.diag([1, 1, np.inf]),),
        MATRIX + "A Aᵀ differs from the identity by",
    ),
    (euler_from_matrix, ("ZZX", np.eye(3)), "Euler sequence is 'ZZX': give one of XYX, XYZ,"),
    (matrix_from_euler, ("zyx", np.zeros(3)), "Euler sequence is 'zyx': give one of XYX, XYZ,"),
    (lock_margin, ("", np.zeros(3)), "Euler sequence is '': give one of XYX, XYZ,"),
    (matrix_from_euler, ("ZYX", np.zeros(4)), "Euler angles: shape is (4,), needed is (…, 3)"),
    (matrix_from_euler, ("ZYX", 1.0), "Euler angles: shape is (), needed is (…, 3)"),
    (matrix_from_quaternion, (np.zeros(4),), "quaternion: its length is 0, needed is 1"),
    (
        matrix_from_quaternion,
        ([[0, 0, 0, 1], [0, 0, 0, 2]],),
        "quaternion: its length is 2, needed",
    ),
    (matrix_from_quaternion, ([0, 0, 1],), "quaternion: shape is (3,), needed is (…, 4)"),
    (matrix_from_axis_angle, ([1, 1, 0], 0.1), "Euler axis: its length is 1.41421, needed is 1"),
    (transform, ([0, 0, 0, 1], [1, 2]), "vector: shape is (2,), needed is (…, 3)"),
    (axis_rotation, ("x", 0.1), 'axis is \'x\': give "X", "Y" or "Z"'),
    (error_vector, (np.eye(3), np.zeros((3, 3))), MATRIX + "A Aᵀ differs from the identity by 1;"),
]


def test_what_is_not_determined_stays_so_and_the_others_stand():
    """A refused epoch of attitude from vectors is NaN; whatever follows goes on with the rest."""
    matrix = matrix_from_euler("ZYX", np.array([[0.1, 0.2, 0.3], [0, 0, 0], [-1, 0.5, 2]]))
    good, bad = [0, 2], 1
    gap = matrix.copy()
    gap[bad] = np.nan
    quaternion = quaternion_from_matrix(gap)
    for found, expected in (
        (quaternion, quaternion_from_matrix(matrix)),
        (matrix_from_quaternion(quaternion), matrix),
        (euler_from_matrix("ZYX", gap), euler_from_matrix("ZYX", matrix)),
        (axis_angle_from_matrix(gap)[0], axis_angle_from_matrix(matrix)[0]),
        (axis_angle_from_matrix(gap)[1], axis_angle_from_matrix(matrix)[1]),
        (error_vector(gap, matrix[[0]]), error_vector(matrix, matrix[[0]])),
        (compose_quaternions(quaternion, quaternion[0]), compose_quaternions(
            quaternion_from_matrix(matrix), quaternion[0])),
    ):  # fmt: skip
        assert np.isnan(found[bad]).all()
        assert found[good] == pytest.approx(expected[good], abs=1e-14)
    assert np.isnan(matrix_from_axis_angle([0, 0, 1.0], np.nan)).all()


@pytest.mark.parametrize(("function", "arguments", "message"), BAD)
def test_bad_input_is_named(function, arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        function(*arguments)
