"""Attitude from vectors (work C, 3.6): TRIAD and five solvers of Wahba's problem, with one signature.

Each finds the direction-cosine matrix A with measured ≈ A reference, over a batch of epochs with k
vectors each. All but TRIAD minimise Wahba's loss ½ Σ w ‖g − A r‖² and agree to rounding; they
differ in speed, in how they teach, and in what they need.

>>> import numpy as np
>>> reference = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
>>> turned = davenport([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]], reference, sigma=[1e-3, 1e-3])
>>> turned.quaternion.round(6)  # by 90° about z
array([0.      , 0.      , 0.707107, 0.707107])
>>> np.degrees(np.sqrt(np.diag(turned.covariance))).round(3)  # both see a turn about x
array([0.041, 0.057, 0.057])
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.observations import Observations, Solution, solve_by_chunks

# Two vectors nearer than this, rad, are parallel: what is left of their difference is rounding.
LEAST_ANGLE = 1e-7
# The least gap between the two largest eigenvalues of K, of the sum of weights. The attitude errs by
# rounding divided by it; two vectors of equal weight θ apart have θ²/2.
LEAST_GAP = 1e-11

_NEWTON, _RAYLEIGH, _SQUARINGS = 40, 12, 48  # at most


def triad(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """TRIAD (3.19 to 3.23; Black 1964): the first vector is met exactly, the second as well as it can be.

    Parameters
    ----------
    measured : (…, 2, 3), vectors in the body's axes, of any length, the trusted one first
    reference : (…, 2, 3) or (2, 3), the same in the reference frame
    weights : (…, 2); no part of TRIAD, they only weigh `loss`
    sigma : (…, 2), standard error of each direction, rad, for `covariance`

    Returns
    -------
    Solution; an epoch whose vectors are parallel, zero or not finite has NaN and its reason. A lone
    epoch (no batch) raises a Refusal instead.

    Raises
    ------
    ValueError : shapes that do not belong together
    """
    seen = Observations.of(measured, reference, weights, sigma, exactly=2)

    def solve(g, r, w):
        seen_frame, parallel = _frame(g)
        true_frame, also = _frame(r)
        return _product(seen_frame, true_frame), parallel | also

    return seen.solved(solve_by_chunks(seen, solve), np.array([np.inf, 1.0]))


def two_vector(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """The closed-form optimum for two vectors (Markley 2002): TRIAD turned about the vectors' normal.

    The best attitude meets the normal of both vectors exactly. What is left is an angle in their
    plane: TRIAD leaves the whole misfit of the angle between them to the second, and the optimum
    shares it by weight. In this form, which has no singular attitude, α = atan2(w₂ sin ε, w₁ + w₂ cos ε)
    for the misfit ε.

    Parameters, result and errors are those of `davenport`, with k = 2.
    """
    seen = Observations.of(measured, reference, weights, sigma, exactly=2)

    def solve(g, r, w):
        seen_frame, parallel = _frame(g)
        true_frame, also = _frame(r)
        # The sine and cosine of (measured less reference angle) between the vectors.
        s, c = _sine(g), _dot(g[0], g[1])
        s0, c0 = _sine(r), _dot(r[0], r[1])
        sine, cosine = w[1] * (s * c0 - c * s0), w[0] + w[1] * (c * c0 + s * s0)
        size = np.sqrt(sine**2 + cosine**2)
        sine, cosine = sine / size, cosine / size
        u, n, v = seen_frame  # v is −90° from u about n
        u, v = (
            [cosine * u[i] - sine * v[i] for i in range(3)],
            [sine * u[i] + cosine * v[i] for i in range(3)],
        )
        none = w.min(axis=0) <= 0
        return _product((u, n, v), true_frame), parallel | also | none | (size < LEAST_GAP)

    return seen.solved(solve_by_chunks(seen, solve))


def davenport(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """Davenport's q-method: the eigenvector of K's largest eigenvalue (C 3.6.2; Davenport 1968).

    Parameters
    ----------
    measured : (…, k, 3), vectors in the body's axes, k ≥ 2, of any length
    reference : (…, k, 3) or (k, 3), the same in the reference frame
    weights : (…, k) or (k,), not negative; 1/σ² where left out and `sigma` is given, else equal
    sigma : (…, k) or (k,), standard error of each direction, rad, for `covariance`

    Returns
    -------
    Solution; an epoch whose vectors are parallel, zero, not finite or contradictory has NaN and its
    reason, and the others stand. A lone epoch (no batch) raises a Refusal instead.

    Raises
    ------
    ValueError : fewer than two vectors, shapes that do not belong together, negative weights
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        full = _stacked(_davenport_matrix(_profile(g, r, w)))
        values, vectors = np.linalg.eigh(full)
        return _matrix(np.moveaxis(vectors[..., 3], -1, 0)), values[:, 3] - values[:, 2] < LEAST_GAP

    return seen.solved(solve_by_chunks(seen, solve))


def davenport_power(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """Davenport's q-method by normalised power iteration (3.37), shifted and squared.

    C iterates q ← K q / ‖K q‖, which finds the eigenvalue of largest modulus. With two vectors the most
    negative one is as large, and the iteration never settles; with more and much noise it can be
    larger. K + (Σw) I has none below zero, and squaring it n times makes
    2ⁿ of C's steps: vectors a hundredth of a degree apart need 32 squarings, not five thousand
    million steps.

    Parameters, result and errors are those of `davenport`.
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        k = _davenport_matrix(_profile(g, r, w))
        m = {(i, j): k[i][j] / 4 + (0.25 if i == j else 0.0) for i in range(4) for j in range(i, 4)}
        for _ in range(_SQUARINGS):
            m, rest = _squared(m)
            if not np.any(rest > 4e-16):
                break
        m, _ = _squared(m)  # what is left of the other eigenvectors is squared once more
        full = np.stack([np.stack([m[min(i, j), max(i, j)] for j in range(4)]) for i in range(4)])
        best = np.argmax(full[range(4), range(4)], axis=0)
        quaternion = np.take_along_axis(full, best[None, None], axis=0)[0]
        quaternion = quaternion / np.sqrt((quaternion**2).sum(axis=0))
        # After n squarings the second eigenvalue's share is (1 − gap/2)^(2ⁿ), nothing above the gap.
        return _matrix(quaternion), (~(_gaps(k, quaternion) >= LEAST_GAP))

    return seen.solved(solve_by_chunks(seen, solve))


def quest(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """QUEST (C 3.6.3; Shuster and Oh 1981): Newton's method for the eigenvalue, a formula for its vector.

    The formula divides by q₄, which is 0 at rotations of 180°. The method of sequential rotations
    solves the problem with the references turned by 180° about x, y or z, where another component
    takes its place; of the four the best is taken for each epoch. Newton's root of the characteristic
    polynomial is only good to rounding over the gap of the eigenvalues, which vectors 0.01 rad apart
    feel at 4e-8 rad; Rayleigh's quotient of the quaternion found makes it good to rounding. Where the
    gap is so small (below 1e-7 or so) that this ends at the second root, the epoch is solved as by
    `davenport`.

    Parameters, result and errors are those of `davenport`.
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        profile = _profile(g, r, w)
        k = _davenport_matrix(profile)
        largest = _largest_root(profile)
        for _ in range(_RAYLEIGH):
            quaternion = np.stack(_quest_vector(profile, largest))
            before, largest = largest, _quadratic(k, quaternion)
            # Cubic: where the quotient moves by less, the quaternion is good to rounding.
            if not np.any(np.abs(largest - before) > 1e-15):
                break
        gaps = _gaps(k, quaternion)
        if (second := gaps < 0).any():
            values, vectors = np.linalg.eigh(_stacked(k)[second])
            quaternion[:, second] = vectors[..., 3].T
            gaps[second] = values[:, 3] - values[:, 2]
        return _matrix(quaternion), ~(gaps >= LEAST_GAP)

    return seen.solved(solve_by_chunks(seen, solve))


def svd(
    measured: ArrayLike,
    reference: ArrayLike,
    weights: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> Solution:
    """Singular values of B = Σ w g rᵀ = U S Vᵀ: A = U diag(1, 1, det U det V) Vᵀ (Markley 1988).

    Parameters, result and errors are those of `davenport`.
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        profile = _profile(g, r, w)
        b = _stacked(profile)
        u, s, vt = np.linalg.svd(b)
        sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
        u[:, :, 2] *= sign[:, None]
        return np.moveaxis(u @ vt, 0, -1), 2 * (s[:, 1] + sign * s[:, 2]) < LEAST_GAP

    return seen.solved(solve_by_chunks(seen, solve))


SOLVERS = {
    "Davenport": davenport,
    "power iteration": davenport_power,
    "QUEST": quest,
    "SVD": svd,
    "two vectors": two_vector,
}  # those of Wahba's problem; the last for two vectors an epoch


def _cross(one, other):
    return [
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    ]


def _dot(one, other):
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _sine(vectors):
    normal = _cross(vectors[0], vectors[1])
    return np.sqrt(_dot(normal, normal))


def _frame(vectors):
    """C's triad u, v = u × second, w = u × v of two vectors (3.19 to 3.21), and whether they are parallel."""
    u = vectors[0]
    normal = _cross(u, vectors[1])
    size = np.sqrt(_dot(normal, normal))
    v = [component / size for component in normal]
    return (u, v, _cross(u, v)), ~(size >= LEAST_ANGLE)


def _product(seen, true):
    """A = [u v w]_g [u v w]_rᵀ, the vectors as columns."""
    return [
        [sum(s[i] * t[j] for s, t in zip(seen, true, strict=True)) for j in range(3)]
        for i in range(3)
    ]


def _profile(g, r, w):
    """B = Σ w g rᵀ, by component."""
    scaled = [[w[n] * r[n][j] for j in range(3)] for n in range(len(r))]
    return [
        [sum(g[n][i] * scaled[n][j] for n in range(len(r))) for j in range(3)] for i in range(3)
    ]


def _davenport_matrix(b):
    """K = [[S − σI, z], [zᵀ, σ]] with S = B + Bᵀ, σ = tr B, by component."""
    trace = b[0][0] + b[1][1] + b[2][2]
    z = [b[1][2] - b[2][1], b[2][0] - b[0][2], b[0][1] - b[1][0]]
    k = [
        [b[i][j] + b[j][i] - (trace if i == j else 0.0) for j in range(3)] + [z[i]]
        for i in range(3)
    ]
    return [*k, [*z, trace]]


def _stacked(rows):
    """(N, n, n) from arrays by component; what is not finite, which is refused already, is made 0."""
    rows = np.stack([np.stack(np.broadcast_arrays(*row)) for row in rows])
    rows[:, :, ~np.isfinite(rows).all(axis=(0, 1))] = 0.0
    return np.moveaxis(rows, -1, 0)


def _quadratic(k, q):
    """qᵀ K q."""
    return sum(q[i] * k[i][j] * q[j] for i in range(4) for j in range(4))


def _squared(m):
    """M²/tr M² of symmetric M with trace 1, and 1 − tr M², which is 0 once a single eigenvector is left."""
    full = [[m[min(i, j), max(i, j)] for j in range(4)] for i in range(4)]
    square = {
        (i, j): sum(full[i][n] * full[n][j] for n in range(4))
        for i in range(4)
        for j in range(i, 4)
    }
    trace = square[0, 0] + square[1, 1] + square[2, 2] + square[3, 3]
    return {key: value / trace for key, value in square.items()}, 1 - trace


def _gaps(k, q):
    """A lower bound of the gap between the two largest eigenvalues of K, from the largest's vector q.

    The gaps are the eigenvalues of λI − K in the space across q. None is above 2 for weights that sum
    to 1, so that the least is at least a quarter of their product.
    """
    largest = _quadratic(k, q)
    # Columns of q's quaternion matrix span that space.
    x, y, z, w = q
    across = [[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]]
    turned = [[sum(k[i][j] * a[j] for j in range(4)) for i in range(4)] for a in across]
    c = [[-sum(a[i] * t[i] for i in range(4)) for t in turned] for a in across]
    for i in range(3):
        c[i][i] = largest + c[i][i]
    determinant = (
        c[0][0] * (c[1][1] * c[2][2] - c[1][2] ** 2)
        - c[0][1] * (c[0][1] * c[2][2] - c[1][2] * c[0][2])
        + c[0][2] * (c[0][1] * c[1][2] - c[1][1] * c[0][2])
    )
    return determinant / 4


def _largest_root(b):
    """The largest root of K's characteristic polynomial, by Newton's method from the sum of weights, 1.

    λ⁴ − (a + b) λ² − c λ + (a b + c σ − d), with a = σ² − tr adj S, b = σ² + zᵀz, c = det S + zᵀS z and
    d = zᵀS²z (Shuster and Oh 1981, equation 70). No root is larger than the start, so that every step
    goes down to it.
    """
    s, z, trace, adjoint, determinant = _quest_terms(b)
    sz = [_dot(s[i], z) for i in range(3)]
    one, two = trace**2 - adjoint, trace**2 + _dot(z, z)
    three, four = determinant + _dot(z, sz), _dot(sz, sz)
    root = np.ones_like(one)
    for _ in range(_NEWTON):
        value = root**4 - (one + two) * root**2 - three * root + one * two + three * trace - four
        slope = 4 * root**3 - 2 * (one + two) * root - three
        step = np.where(slope > 0, value / np.where(slope > 0, slope, 1.0), 0.0)
        root = root - step
        if not np.any(np.abs(step) > 1e-15):
            break
    return root


def _quest_terms(b):
    """S, z, σ, tr adj S and det S."""
    k = _davenport_matrix(b)
    trace = k[3][3]
    s = [[k[i][j] + (trace if i == j else 0.0) for j in range(3)] for i in range(3)]
    minors = [s[1][1] * s[2][2] - s[1][2] ** 2, s[0][0] * s[2][2] - s[0][2] ** 2]
    minors.append(s[0][0] * s[1][1] - s[0][1] ** 2)
    determinant = _dot(s[0], _cross(s[1], s[2]))
    return s, k[3][:3], trace, sum(minors), determinant


# q′ ⊗ (a half turn about x, y or z), as component and sign, and q′ itself (2.12).
_TURNED_BACK = (
    ((3, 1), (2, -1), (1, 1), (0, -1)),
    ((2, 1), (3, 1), (0, -1), (1, -1)),
    ((1, -1), (0, 1), (3, 1), (2, -1)),
    ((0, 1), (1, 1), (2, 1), (3, 1)),
)


def _quest_vector(b, largest):
    """The eigenvector of K: [X, γ] of the sequential rotation whose γ, c q₄², is the largest."""
    found, size = None, None
    for turn, back in enumerate(_TURNED_BACK):
        sign = [1.0 if turn in (j, 3) else -1.0 for j in range(3)]
        s, z, trace, adjoint, determinant = _quest_terms(
            [[b[i][j] * sign[j] for j in range(3)] for i in range(3)]
        )
        alpha, beta = largest**2 - trace**2 + adjoint, largest - trace
        gamma = (largest + trace) * alpha - determinant
        sz = [_dot(s[i], z) for i in range(3)]
        x = [alpha * z[i] + beta * sz[i] + _dot(s[i], sz) for i in range(3)]
        turned = [*x, gamma]
        quaternion = [turned[index] * sign for index, sign in back]
        if found is None:
            found, size = quaternion, np.abs(gamma)
            continue
        better = np.abs(gamma) > size
        size = np.where(better, np.abs(gamma), size)
        found = [np.where(better, q, f) for q, f in zip(quaternion, found, strict=True)]
    length = np.sqrt(sum(q**2 for q in found))
    return [q / length for q in found]


def _matrix(q):
    """A(q) (2.10), by component."""
    x, y, z, w = q
    return [
        [x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), y * y - x * x - z * z + w * w, 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), z * z - x * x - y * y + w * w],
    ]
