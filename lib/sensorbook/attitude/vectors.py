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
from sensorbook.attitude.wahba import (
    LEAST_GAP,
    certified,
    cross,
    davenport_matrix,
    dot,
    eigenvector,
    largest_root,
    matrix_of,
    profile,
    quadratic,
    quest_vector,
    squared,
    stacked,
)

# Two vectors nearer than this, rad, are parallel: what is left of their difference is rounding.
LEAST_ANGLE = 1e-7

_RAYLEIGH, _SQUARINGS = 12, 48  # steps, at most


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
    seen = Observations.of(measured, reference, weights, sigma, exactly=2, every=True)

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
        s, c = _sine(g), dot(g[0], g[1])
        s0, c0 = _sine(r), dot(r[0], r[1])
        sine, cosine = w[1] * (s * c0 - c * s0), w[0] + w[1] * (c * c0 + s * s0)
        size = np.sqrt(sine**2 + cosine**2)
        sine, cosine = sine / size, cosine / size
        u, n, v = seen_frame  # v is −90° from u about n
        u, v = (
            [cosine * u[i] - sine * v[i] for i in range(3)],
            [sine * u[i] + cosine * v[i] for i in range(3)],
        )
        none = w.min(axis=0) <= 0
        return _product((u, n, v), true_frame), parallel | also | none | ~(size >= LEAST_GAP)

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
        quaternion, gap = eigenvector(davenport_matrix(profile(g, r, w)))
        return matrix_of(quaternion), ~(gap >= LEAST_GAP)

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
    larger. K + (Σw) I has none below zero, and squaring it n times makes 2ⁿ of C's steps: vectors a
    hundredth of a degree apart need 32 squarings, not five thousand million steps.

    Parameters, result and errors are those of `davenport`.
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        k = davenport_matrix(profile(g, r, w))
        m = {(i, j): k[i][j] / 4 + (0.25 if i == j else 0.0) for i in range(4) for j in range(i, 4)}
        for _ in range(_SQUARINGS):
            m, rest = squared(m)
            if not np.any(rest > 4e-16):
                break
        m, _ = squared(m)  # what is left of the other eigenvectors is squared once more
        full = np.stack([np.stack([m[min(i, j), max(i, j)] for j in range(4)]) for i in range(4)])
        best = np.argmax(full[range(4), range(4)], axis=0)
        quaternion = np.take_along_axis(full, best[None, None], axis=0)[0]
        quaternion = quaternion / np.sqrt((quaternion**2).sum(axis=0))
        quaternion, undetermined = certified(k, quaternion)
        return matrix_of(quaternion), undetermined

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
    quaternion found is not certain to be that of the largest eigenvalue, the epoch is solved as by
    `davenport`: vectors within a hundredth of a degree of each other, and sets that contradict each other
    as mirror images do.

    Parameters, result and errors are those of `davenport`.
    """
    seen = Observations.of(measured, reference, weights, sigma)

    def solve(g, r, w):
        b = profile(g, r, w)
        k = davenport_matrix(b)
        largest = largest_root(b)
        for _ in range(_RAYLEIGH):
            quaternion = np.stack(quest_vector(b, largest))
            before, largest = largest, quadratic(k, quaternion)
            # Cubic: where the quotient moves by less, the quaternion is good to rounding.
            if not np.any(np.abs(largest - before) > 1e-15):
                break
        quaternion, undetermined = certified(k, quaternion)
        return matrix_of(quaternion), undetermined

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
        u, s, vt = np.linalg.svd(stacked(profile(g, r, w)))
        sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
        u[:, :, 2] *= sign[:, None]
        return np.moveaxis(u @ vt, 0, -1), ~(2 * (s[:, 1] + sign * s[:, 2]) >= LEAST_GAP)

    return seen.solved(solve_by_chunks(seen, solve))


SOLVERS = {
    "Davenport": davenport,
    "power iteration": davenport_power,
    "QUEST": quest,
    "SVD": svd,
    "two vectors": two_vector,
}  # those of Wahba's problem; the last for two vectors an epoch


def _sine(vectors):
    normal = cross(vectors[0], vectors[1])
    return np.sqrt(dot(normal, normal))


def _frame(vectors):
    """C's triad u, v = u × second, w = u × v of two vectors (3.19 to 3.21), and whether they are parallel."""
    u = vectors[0]
    normal = cross(u, vectors[1])
    size = np.sqrt(dot(normal, normal))
    v = [component / size for component in normal]
    return (u, v, cross(u, v)), ~(size >= LEAST_ANGLE)


def _product(seen, true):
    """A = [u v w]_g [u v w]_rᵀ, the vectors as columns."""
    return [
        [sum(s[i] * t[j] for s, t in zip(seen, true, strict=True)) for j in range(3)]
        for i in range(3)
    ]
