"""TRIAD and the solvers of Wahba's problem: against scipy, against closed forms, and on bad epochs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from attitude.epochs import aligned, angle, epochs, unit
from sensorbook import Refusal
from sensorbook.attitude import davenport, davenport_power, quest, svd, triad, two_vector
from sensorbook.attitude.rotations import error_vector, matrix_from_quaternion
from sensorbook.attitude.vectors import SOLVERS

WAHBA = {name: solver for name, solver in SOLVERS.items() if solver is not two_vector}
BOTH = pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
ANY = pytest.mark.parametrize("solver", WAHBA.values(), ids=WAHBA)
ALL = pytest.mark.parametrize("solver", [*SOLVERS.values(), triad], ids=[*SOLVERS, "TRIAD"])


@BOTH
@pytest.mark.parametrize(("apart", "tolerance"), [(None, 1e-9), (0.01, 1e-9), (3e-4, 1e-6)])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_two_vectors_as_scipy(solver, apart, tolerance, noise):
    rng = np.random.default_rng(101)
    noise *= 1.0 if apart is None else apart
    measured, reference, _ = epochs(rng, 3000, apart=apart, noise=noise)
    weights = rng.uniform(0.1, 1.0, (3000, 2))
    if apart is None:
        well = np.linalg.norm(np.cross(reference[:, 0], reference[:, 1]), axis=-1) >= 0.01
        well &= np.linalg.norm(np.cross(measured[:, 0], measured[:, 1]), axis=-1) >= 0.01
        measured, reference, weights = measured[well], reference[well], weights[well]
    found = solver(measured, reference, weights)
    assert found.determined.all()
    # scipy's own rounding is in it: both err by rounding over the gap of the eigenvalues.
    assert angle(found.matrix, aligned(measured, reference, weights)).max() < tolerance


@ANY
@pytest.mark.parametrize("count", [3, 6])
def test_many_vectors_as_scipy(solver, count):
    rng = np.random.default_rng(102)
    measured, reference, _ = epochs(rng, 2000, count, noise=0.2)
    weights = rng.uniform(0.1, 1.0, (2000, count))
    found = solver(measured, reference, weights)
    assert angle(found.matrix, aligned(measured, reference, weights)).max() < 1e-9


@ALL
def test_half_turns_about_every_axis(solver):
    rng = np.random.default_rng(103)
    axes = np.vstack([np.eye(3), -np.eye(3), unit(rng.normal(size=(500, 3)))])
    for off in (0.0, 1e-12, 1e-7, -1e-3):
        turn = Rotation.from_rotvec((np.pi + off) * axes)
        measured, reference, true = epochs(rng, len(axes), apart=1.0, rotation=turn)
        assert angle(solver(measured, reference).matrix, true).max() < 1e-14 * 10


@BOTH
def test_a_half_turn_with_noise_as_scipy(solver):
    rng = np.random.default_rng(104)
    turn = Rotation.from_rotvec(np.pi * np.vstack([np.eye(3)] * 200))
    measured, reference, _ = epochs(rng, 600, apart=1.3, noise=0.05, rotation=turn)
    weights = rng.uniform(0.1, 1.0, (600, 2))
    found = solver(measured, reference, weights)
    assert angle(found.matrix, aligned(measured, reference, weights)).max() < 1e-12


@ANY
def test_mirrored_vectors_as_scipy(solver):
    """The most negative eigenvalue is the largest in modulus: plain power iteration finds that one."""
    rng = np.random.default_rng(105)
    _, reference, _ = epochs(rng, 300, 3)
    reference[:] = np.eye(3)
    measured = unit(-reference + 0.02 * rng.normal(size=reference.shape))
    weights = np.tile([3.0, 2.0, 1.0], (300, 1))
    found = solver(measured, reference, weights)
    assert found.determined.all()
    assert angle(found.matrix, aligned(measured, reference, weights)).max() < 1e-10


def test_triad_as_scipy_at_infinite_first_weight():
    rng = np.random.default_rng(106)
    measured, reference, _ = epochs(rng, 2000, apart=1.0, noise=0.1)
    weights = np.tile([np.inf, 1.0], (2000, 1))
    found = triad(measured, reference)
    assert angle(found.matrix, aligned(measured, reference, weights)).max() < 1e-12
    # The trusted vector is met exactly, the normal of both as well.
    met = (found.matrix @ reference[:, 0, :, None])[..., 0]
    assert np.abs(met - measured[:, 0]).max() < 1e-14


def test_two_vectors_is_triad_at_one_end_and_the_other():
    rng = np.random.default_rng(107)
    measured, reference, _ = epochs(rng, 500, apart=1.0, noise=0.1)
    first = two_vector(measured, reference, [1e12, 1.0]).matrix
    assert angle(first, triad(measured, reference).matrix).max() < 1e-12
    last = two_vector(measured, reference, [1.0, 1e12]).matrix
    assert angle(last, triad(measured[:, ::-1], reference[:, ::-1]).matrix).max() < 1e-12


def test_two_vectors_by_markleys_quaternion():
    """Markley (2002), equations 17 and 18, as printed for μ ≥ 0 and μ < 0."""
    rng = np.random.default_rng(108)
    b, r, _ = epochs(rng, 400, apart=0.8, noise=0.05)
    a = rng.uniform(0.1, 1.0, (400, 2))
    found = two_vector(b, r, a).matrix
    for k in range(400):
        b3, r3 = (unit(np.cross(*v[k])) for v in (b, r))
        weighed = sum(a[k, i] * np.cross(b[k, i], r[k, i]) for i in range(2))
        mu = (1 + b3 @ r3) * sum(a[k, i] * b[k, i] @ r[k, i] for i in range(2))
        mu += np.cross(b3, r3) @ weighed
        nu = (b3 + r3) @ weighed
        rho = np.hypot(mu, nu)
        if mu >= 0:
            q = [*((rho + mu) * np.cross(b3, r3) + nu * (b3 + r3)), (rho + mu) * (1 + b3 @ r3)]
        else:
            q = [*(nu * np.cross(b3, r3) + (rho - mu) * (b3 + r3)), nu * (1 + b3 @ r3)]
        printed = matrix_from_quaternion(unit(np.array(q)))
        assert angle(printed, found[k]) < 1e-9  # the printed form divides by 1 + b₃·r₃


def test_triad_by_work_c():
    """(3.19) to (3.23) with the vectors as columns, one epoch by hand."""
    g1, g2 = np.array([0.0, 0.0, 2.0]), np.array([0.0, -3.0, 4.0])
    r1, r2 = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])
    frames = []
    for one, two in ((g1, g2), (r1, r2)):
        u = one / np.linalg.norm(one)
        v = np.cross(u, two) / np.linalg.norm(np.cross(u, two))
        frames.append(np.column_stack([u, v, np.cross(u, v)]))
    expected = frames[0] @ frames[1].T
    assert triad([g1, g2], [r1, r2]).matrix == pytest.approx(expected, abs=1e-15)
    assert expected @ r1 == pytest.approx(g1 / 2, abs=1e-15)


def test_davenports_matrix_has_the_loss():
    """Wahba's loss at the optimum is Σw − λ, here by numpy's eigenvalues of K as C prints it."""
    rng = np.random.default_rng(109)
    g, r, _ = epochs(rng, 50, 4, noise=0.1)
    w = rng.uniform(0.1, 2.0, (50, 4))
    found = davenport(g, r, w)
    for k in range(50):
        b = sum(w[k, i] * np.outer(g[k, i], r[k, i]) for i in range(4))
        s, sigma = b + b.T, np.trace(b)
        z = np.array([b[1, 2] - b[2, 1], b[2, 0] - b[0, 2], b[0, 1] - b[1, 0]])
        big = np.block([[s - sigma * np.eye(3), z[:, None]], [z[None, :], np.array([[sigma]])]])
        values, vectors = np.linalg.eigh(big)
        assert found.loss[k] == pytest.approx(w[k].sum() - values[3], abs=1e-13)
        assert abs(vectors[:, 3] @ found.quaternion[k]) == pytest.approx(1, abs=1e-13)


# --- covariance ---


def nees(found, true):
    error = error_vector(found.matrix, true)
    solved = np.linalg.solve(found.covariance, error[..., None])[..., 0]
    return (error * solved).sum(axis=-1)


def noisy(rng, size, sigma):
    """Directions with independent errors `sigma` (k,) in the two axes across each."""
    measured, reference, true = epochs(rng, size, len(sigma))
    for i, s in enumerate(sigma):
        off = s * rng.normal(size=(size, 3))
        off -= (off * measured[:, i]).sum(axis=-1, keepdims=True) * measured[:, i]
        measured[:, i] = unit(measured[:, i] + off)
    well = np.linalg.norm(np.cross(reference[:, 0], reference[:, 1]), axis=-1) > 0.2
    return measured[well], reference[well], true[well]


@pytest.mark.parametrize(
    ("solver", "sigma", "weights"),
    [
        (triad, [2e-4, 1e-3], None),
        (triad, [1e-3, 2e-4], None),
        (two_vector, [1e-3, 3e-4], None),
        (davenport, [1e-3, 3e-4], [1.0, 1.0]),
        (davenport, [1e-3, 3e-4, 2e-3], None),
        (davenport_power, [1e-3, 3e-4, 2e-3], [2.0, 1.0, 0.5]),
        (quest, [1e-3, 3e-4, 2e-3], None),
        (svd, [1e-3, 3e-4, 2e-3], [1.0, 1.0, 1.0]),
    ],
)
def test_covariance_is_the_errors_own(solver, sigma, weights):
    rng = np.random.default_rng(110)
    measured, reference, true = noisy(rng, 10_400, np.array(sigma))
    assert len(true) > 9_900
    found = solver(measured, reference, weights=weights, sigma=sigma)
    # χ² with 3 degrees of freedom: its mean over 10⁴ scatters by 0.025; 0.1 is the bound.
    assert nees(found, true).mean() == pytest.approx(3, abs=0.1)


def test_covariance_by_shuster_and_oh():
    """Equation 93 of Shuster and Oh (1981) for QUEST, and 86 for TRIAD, at one geometry."""
    one, two = np.array([0.0, 0.0, 1.0]), np.array([np.sin(0.7), 0.0, np.cos(0.7)])
    s1, s2 = 1e-3, 4e-3
    q = quest([one, two], [one, two], sigma=[s1, s2]).covariance
    information = sum((np.eye(3) - np.outer(v, v)) / s**2 for v, s in ((one, s1), (two, s2)))
    assert q == pytest.approx(np.linalg.inv(information), rel=1e-12)
    # Along the normal both vectors tell; in TRIAD the first alone.
    assert q[1, 1] == pytest.approx(1 / (s1**-2 + s2**-2), rel=1e-12)
    t = triad([one, two], [one, two], sigma=[s1, s2]).covariance
    c, s = np.cos(0.7), np.sin(0.7)
    about = s2**2 / s**2 + (c / s) ** 2 * s1**2
    expected = [[s1**2, 0, s1**2 * c / s], [0, s1**2, 0], [s1**2 * c / s, 0, about]]
    assert t == pytest.approx(np.array(expected), rel=1e-12, abs=1e-20)


def test_optimal_weights_have_the_least_covariance():
    rng = np.random.default_rng(111)
    measured, reference, _ = epochs(rng, 200, 3)
    sigma = np.array([1e-3, 3e-3, 1e-2])
    best = davenport(measured, reference, sigma=sigma).covariance
    for weights in ([1, 1, 1], [9, 1, 1], [1, 0.5, 0.01]):
        other = davenport(measured, reference, weights=weights, sigma=sigma).covariance
        assert np.linalg.eigvalsh(other - best).min() > -1e-18


def test_no_sigma_no_covariance():
    measured, reference, _ = epochs(np.random.default_rng(1), 5)
    assert davenport(measured, reference, [1.0, 2.0]).covariance is None
    assert triad(measured, reference).covariance is None


@pytest.mark.parametrize("count", [2, 5])
def test_twice_the_loss_is_chi_squared(count):
    rng = np.random.default_rng(112)
    sigma = np.full(count, 1e-3)
    measured, reference, _ = noisy(rng, 10_000, sigma)
    chi2 = 2 * quest(measured, reference, sigma=sigma).loss
    degrees = 2 * count - 3
    # The mean of 10⁴ scatters by √(2ν/10⁴).
    assert chi2.mean() == pytest.approx(degrees, abs=5 * np.sqrt(2 * degrees / 9_900))


# --- epochs that determine nothing ---


@ALL
def test_bad_epochs_are_told_and_the_others_stand(solver):
    rng = np.random.default_rng(113)
    measured, reference, _ = epochs(rng, 5000, apart=1.0, noise=0.01)
    good = solver(measured, reference, sigma=[1e-3, 1e-3])
    bad = {
        7: "a vector has no length",
        2000: "a vector or its weight holds no finite number",
        2001: "a vector or its weight holds no finite number",
        4095: "the measured vectors are parallel: the rotation about them is not determined",
        4096: "the measured vectors are parallel: the rotation about them is not determined",
        4999: "the reference vectors are parallel: the rotation about them is not determined",
    }
    measured[7, 1] = 0
    measured[2000, 0, 2] = np.nan
    reference[2001, 1, 0] = np.inf
    measured[4095, 1] = 3 * measured[4095, 0]
    measured[4096, 1] = -measured[4096, 0]
    reference[4999, 1] = reference[4999, 0]
    found = solver(measured, reference, sigma=[1e-3, 1e-3])
    assert {k: str(found.reasons[k]) for k in np.flatnonzero(~found.determined)} == bad
    for name in ("matrix", "quaternion", "covariance"):
        one, other = getattr(found, name), getattr(good, name)
        assert np.isnan(one[list(bad)]).all()
        # The iterations of an epoch may be those that its neighbours need.
        assert one[found.determined] == pytest.approx(other[found.determined], abs=1e-13)
    assert (found.reasons[found.determined] == "").all()


@BOTH
def test_contradiction(solver):
    """Two vectors a right angle apart, measured opposite in the plane: every sharing fits as well."""
    reference = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    measured = np.array([[[1.0, 0, 0], [0, 1.0, 0]], [[1.0, 0, 0], [0, -1.0, 0]]])
    found = solver(measured, reference)
    # The second is the first turned by 180° about x: no contradiction, as two vectors never mirror.
    assert found.determined.all()
    apart = np.array([[[np.cos(a), np.sin(a), 0], [1.0, 0, 0]] for a in (np.pi - 1e-3, 1e-3)])
    found = solver(apart[:1], apart[1:])
    assert found.determined.all()


@ANY
def test_mirrored_axes_of_one_weight_contradict(solver):
    measured = np.stack([np.eye(3), -np.eye(3)])
    found = solver(measured, np.eye(3))
    assert found.determined.tolist() == [True, False]
    assert "contradict each other" in found.reasons[1]


@ANY
def test_zero_weights(solver):
    measured, reference, true = epochs(np.random.default_rng(114), 3, 3)
    measured[:, 2] = [1.0, 0, 0]  # wrong, and without weight
    found = solver(measured, reference, [[1, 1, 0], [1, 0, 0], [1, 1, 0]])
    assert found.determined.tolist() == [True, False, True]
    assert found.reasons[1] == (
        "fewer than two vectors have a weight: the rotation about one is not determined"
    )
    assert angle(found.matrix[[0, 2]], true[[0, 2]]).max() < 1e-12


def test_a_weight_that_is_none_refuses_its_epoch_alone():
    measured, reference, _ = epochs(np.random.default_rng(117), 4, apart=1.0)
    found = davenport(measured, reference, [[1, 1], [0, 0], [1, np.nan], [1, 1]])
    assert found.determined.tolist() == [True, False, False, True]
    assert found.reasons[1].startswith("fewer than two vectors have a weight")
    assert found.reasons[2] == "a vector or its weight holds no finite number"
    sigma = np.full((4, 2), 1e-3)
    sigma[3, 0] = np.nan
    assert triad(measured, reference, sigma=sigma).determined.tolist() == [True, True, True, False]


@ANY
def test_a_vector_without_weight_is_not_there(solver):
    measured, reference, true = epochs(np.random.default_rng(118), 3, 3)
    measured[0, 1], reference[1, 1] = np.nan, 0
    found = solver(measured, reference, [1, 0, 1], [1e-3, 1e-3, 1e-3])
    assert angle(found.matrix, true).max() < 1e-12
    assert np.isfinite(found.loss).all()
    assert found.covariance == pytest.approx(
        solver(measured[:, ::2], reference[:, ::2], sigma=[1e-3, 1e-3]).covariance, rel=1e-9
    )


def test_masked_values_are_no_numbers():
    measured, reference, _ = epochs(np.random.default_rng(119), 3, apart=1.0)
    masked = np.ma.masked_array(measured, np.zeros_like(measured, dtype=bool))
    masked[1, 0, 2] = np.ma.masked
    assert davenport(masked, reference).determined.tolist() == [True, False, True]


@ANY
@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("scatter", [0.0, 1e-9])
def test_parallel_vectors_of_every_direction_are_refused(solver, count, scatter):
    """QUEST's formula has four ways to land on another eigenvector: many directions find them."""
    rng = np.random.default_rng(120)
    one = rng.integers(-9, 10, (4000, 1, 3)) + 0.5
    vectors = one * rng.uniform(0.5, 2, (4000, count, 1))
    vectors = vectors + scatter * rng.normal(size=vectors.shape)
    assert not solver(vectors, vectors).determined.any()


@ANY
def test_mislabelled_axes_are_refused_where_nothing_is_best(solver):
    rng = np.random.default_rng(121)
    swapped = np.eye(3)[[1, 0, 2]] @ Rotation.random(4000, rng=rng).as_matrix()
    found = solver(swapped, np.eye(3))
    assert not found.determined.any()
    assert (np.char.find(found.reasons, "contradict each other") >= 0).all()


@ANY
@pytest.mark.parametrize("noise", [1e-8, 1e-6, 1e-5, 1e-3])
def test_mislabelled_axes_with_noise_as_davenport(solver, noise):
    """Two eigenvalues near the largest: the answer hangs on the noise, and is the same for all."""
    rng = np.random.default_rng(122)
    swapped = np.eye(3)[[1, 0, 2]] @ Rotation.random(4000, rng=rng).as_matrix()
    swapped = swapped + noise * rng.normal(size=swapped.shape)
    found, expected = solver(swapped, np.eye(3)), davenport(swapped, np.eye(3))
    both = found.determined & expected.determined
    assert both.mean() > 0.999
    # Rounding over the gap, which is of the noise's size; the least of 4000 is a thousandth of it.
    assert angle(found.matrix[both], expected.matrix[both]).max() < 1e-11 / noise + 1e-12


def test_near_contradiction_is_solved_where_a_best_attitude_is():
    mirrored, weights = np.diag([1.0, 1, -1]), [1.00001, 1.000005, 1]
    found = [s(np.eye(3)[None], mirrored, weights) for s in WAHBA.values()]
    assert all(f.determined.all() for f in found)
    # The gap is 1e-5 of the weights: rounding over it.
    assert max(angle(f.matrix, found[0].matrix).max() for f in found) < 1e-9


@pytest.mark.parametrize("apart", [1e-2, 1e-4, 1e-5])
def test_covariance_of_nearly_parallel_vectors(apart):
    """Small in two axes, 1/apart² larger about the vectors: none is lost in the other."""
    rng = np.random.default_rng(123)
    turn = Rotation.random(20, rng=rng).as_matrix()
    vectors = np.array([[1, 0, 0], [np.cos(apart), np.sin(apart), 0]]) @ turn
    found = np.linalg.eigvalsh(davenport(vectors, vectors, sigma=[1e-9, 1e-9]).covariance)
    # Across: σ²/2 each, and about the middle line 2σ²/apart².
    assert found[:, 0] == pytest.approx(0.5e-18, rel=1e-3)
    assert found[:, 2] == pytest.approx(2e-18 / apart**2, rel=1e-3)


@pytest.mark.parametrize("ratio", [1e3, 1e7, 1e9])
def test_covariance_of_very_unequal_vectors(ratio):
    g = [[1, 0, 0], [0.3, 0.6, 0.9]]
    sigma = [1e-2 / ratio, 1e-2]
    expected = triad(g, g, sigma=sigma).covariance  # its limit
    assert two_vector(g, g, sigma=sigma).covariance == pytest.approx(expected, rel=1e-5, abs=1e-14)


@pytest.mark.parametrize("size", [1e-160, 1e160, 1e300])
@BOTH
def test_weights_of_any_size(solver, size):
    measured, reference, true = epochs(np.random.default_rng(124), 5, apart=1.0)
    assert angle(solver(measured, reference, sigma=[size, 2 * size]).matrix, true).max() < 1e-12
    assert angle(solver(measured, reference, [size, 2 * size]).matrix, true).max() < 1e-12


@ALL
def test_a_lone_epoch_refuses(solver):
    with pytest.raises(Refusal, match=r"measured vectors are parallel.* well apart"):
        solver([[1, 0, 0], [2, 0, 0]], [[1, 0, 0], [0, 1, 0]])
    with pytest.raises(Refusal, match="a vector has no length"):
        solver([[1, 0, 0], [0, 0, 0]], [[1, 0, 0], [0, 1, 0]])


@ALL
def test_arguments(solver):
    two = np.eye(3)[:2]
    for arguments, message in (
        ((two[:1], two[:1]), "one vector leaves the rotation about it undetermined"),
        ((two, np.eye(3)), "measured has 2 vectors an epoch and reference 3"),
        ((two[:, :2], two), r"measured: shape is \(2, 2\), needed is \(…, k, 3\)"),
        ((two[0], two), r"measured: shape is \(3,\)"),
        ((np.stack([two] * 3), np.stack([two] * 4)), "different numbers of epochs"),
        ((two, two, [1, 2, 3]), r"weights: shape is \(3,\), needed is \(…, 2\)"),
        ((two, two, [1, -1]), "weights: the least is -1; none may be negative"),
        ((two, two, [1, np.inf]), "weights: one is infinite"),
        ((two, two, None, [1, 0]), "sigma: the least is 0; it must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            solver(*arguments)


@pytest.mark.parametrize("solver", [triad, two_vector])
def test_two_vectors_only(solver):
    with pytest.raises(ValueError, match="takes 2 vectors an epoch, not 3"):
        solver(np.eye(3), np.eye(3))


# --- shapes and invariances ---


@ALL
def test_batches(solver):
    rng = np.random.default_rng(115)
    measured, reference, _ = epochs(rng, 12, apart=1.0, noise=0.1)
    flat = solver(measured, reference, sigma=[1e-3, 2e-3])
    shaped = solver(measured.reshape(3, 4, 2, 3), reference.reshape(3, 4, 2, 3), sigma=[1e-3, 2e-3])
    for name, own in (
        ("matrix", (3, 3)),
        ("quaternion", (4,)),
        ("covariance", (3, 3)),
        ("loss", ()),
        ("determined", ()),
        ("reasons", ()),
    ):
        assert getattr(shaped, name).shape == (3, 4, *own)
        assert (getattr(shaped, name).reshape(12, *own) == getattr(flat, name)).all()
    lone = solver(measured[5], reference[5], sigma=[1e-3, 2e-3])
    assert lone.matrix == pytest.approx(flat.matrix[5], abs=1e-14)
    assert lone.matrix.shape == (3, 3)
    assert lone.covariance.shape == (3, 3)
    shared = solver(measured, reference[0])
    again = solver(measured, np.stack([reference[0]] * 12))
    assert shared.matrix == pytest.approx(again.matrix, abs=1e-14)
    none = solver(measured[:0], reference[:0], sigma=[1e-3, 2e-3])
    assert none.matrix.shape == (0, 3, 3)
    assert none.covariance.shape == (0, 3, 3)


@ALL
@pytest.mark.parametrize("length", [1e-300, 1e-160, 1e160, 1e300])
def test_lengths_beyond_the_range_of_squares(solver, length):
    measured, reference, true = epochs(np.random.default_rng(116), 4, apart=1.0)
    measured[1] *= length
    measured[2, 0] = 0
    found = solver(measured, reference)
    assert found.determined.tolist() == [True, True, False, True]
    assert found.reasons[2] == "a vector has no length"
    assert angle(found.matrix[[0, 1, 3]], true[[0, 1, 3]]).max() < 1e-12


vectors = st.lists(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: sum(c * c for c in v) > 1e-2),
    min_size=2,
    max_size=5,
)


@ANY
@settings(max_examples=60, deadline=None)
@given(vectors, st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.floats(1e-9, 1e9))
def test_exact_vectors_of_any_length_give_the_attitude(solver, listed, turn, scale):
    reference = np.array(listed)
    if np.linalg.svd(unit(reference), compute_uv=False)[1] < 0.05:
        return
    true = Rotation.from_rotvec(turn).as_matrix().T
    found = solver(scale * reference @ true.T, reference)
    assert angle(found.matrix, true) < 1e-11
    again = solver(reference[::-1] @ true.T, reference[::-1])
    assert angle(again.matrix, found.matrix) < 1e-11
