"""Davenport's matrix of many epochs and its eigenvector, by component.

Vectors and matrices are lists of arrays (N,), one an element, so that every operation runs over all
epochs at once; what a single epoch would do with numpy's small matrices takes a hundred times as long.
"""

from __future__ import annotations

import numpy as np

# The least gap between the two largest eigenvalues of K, of the sum of weights. The attitude errs by
# rounding divided by it; two vectors of equal weight θ apart have θ²/2.
LEAST_GAP = 1e-11

# Where a quaternion is trusted without the eigen-decomposition: the least gap, and the least sum of the
# gaps' products in pairs, which is small where two gaps are.
_SURE_GAP, _SURE_PAIR = 1e-9, 0.05
_NEWTON = 40  # steps, at most


def cross(one, other):
    """one × other."""
    return [
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    ]


def dot(one, other):
    """one · other."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def profile(g, r, w):
    """B = Σ w g rᵀ, by component."""
    scaled = [[w[n] * r[n][j] for j in range(3)] for n in range(len(r))]
    return [
        [sum(g[n][i] * scaled[n][j] for n in range(len(r))) for j in range(3)] for i in range(3)
    ]


def davenport_matrix(b):
    """K = [[S − σI, z], [zᵀ, σ]] with S = B + Bᵀ, σ = tr B, by component."""
    trace = b[0][0] + b[1][1] + b[2][2]
    z = [b[1][2] - b[2][1], b[2][0] - b[0][2], b[0][1] - b[1][0]]
    k = [
        [b[i][j] + b[j][i] - (trace if i == j else 0.0) for j in range(3)] + [z[i]]
        for i in range(3)
    ]
    return [*k, [*z, trace]]


def stacked(rows):
    """(N, n, n) from arrays by component; what is not finite, which is refused already, is made 0."""
    rows = np.stack([np.stack(np.broadcast_arrays(*row)) for row in rows])
    rows[:, :, ~np.isfinite(rows).all(axis=(0, 1))] = 0.0
    return np.moveaxis(rows, -1, 0)


def quadratic(k, q):
    """qᵀ K q."""
    return sum(q[i] * k[i][j] * q[j] for i in range(4) for j in range(4))


def matrix_of(q):
    """A(q) (2.10), by component."""
    x, y, z, w = q
    return [
        [x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), y * y - x * x - z * z + w * w, 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), z * z - x * x - y * y + w * w],
    ]


def squared(m):
    """M²/tr M² of symmetric M with trace 1, and 1 − tr M², which is 0 once a single eigenvector is left."""
    full = [[m[min(i, j), max(i, j)] for j in range(4)] for i in range(4)]
    square = {
        (i, j): sum(full[i][n] * full[n][j] for n in range(4))
        for i in range(4)
        for j in range(i, 4)
    }
    trace = square[0, 0] + square[1, 1] + square[2, 2] + square[3, 3]
    return {key: value / trace for key, value in square.items()}, 1 - trace


def eigenvector(k):
    """K's eigenvector of the largest eigenvalue, (4, N), and its gap to the second, (N,)."""
    values, vectors = np.linalg.eigh(stacked(k))
    return np.moveaxis(vectors[..., 3], -1, 0), values[:, 3] - values[:, 2]


def certified(k, q):
    """Quaternions (4, N) sure to belong to K's largest eigenvalue, and which epochs determine none.

    The gaps from q's eigenvalue to the three others are the eigenvalues of λI − K in the space across
    q. q is right where all are positive, its formula good to rounding where no two are small; other
    epochs, few unless the vectors are bad, go through the eigen-decomposition.
    """
    largest = quadratic(k, q)
    # Columns of q's quaternion matrix span that space.
    x, y, z, w = q
    across = [[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]]
    turned = [[sum(k[i][j] * a[j] for j in range(4)) for i in range(4)] for a in across]
    c = [[-sum(a[i] * t[i] for i in range(4)) for t in turned] for a in across]
    for i in range(3):
        c[i][i] = largest + c[i][i]
    minors = [
        c[1][1] * c[2][2] - c[1][2] ** 2,
        c[0][0] * c[2][2] - c[0][2] ** 2,
        c[0][0] * c[1][1] - c[0][1] ** 2,
    ]
    determinant = (
        c[0][0] * minors[0]
        - c[0][1] * (c[0][1] * c[2][2] - c[1][2] * c[0][2])
        + c[0][2] * (c[0][1] * c[1][2] - c[1][1] * c[0][2])
    )
    # None of the gaps is above 2: the least is at least a quarter of their product.
    sure = (c[0][0] > 0) & (minors[2] > 0) & (determinant > 4 * _SURE_GAP)
    sure &= sum(minors) > _SURE_PAIR
    quaternion, undetermined = np.stack(q), np.zeros(sure.shape, dtype=bool)
    if not sure.all():
        found, gap = eigenvector(
            [[np.broadcast_to(e, sure.shape)[~sure] for e in row] for row in k]
        )
        quaternion[:, ~sure] = found
        undetermined[~sure] = ~(gap >= LEAST_GAP)
    return quaternion, undetermined


def largest_root(b):
    """The largest root of K's characteristic polynomial, by Newton's method from the sum of weights, 1.

    λ⁴ − (a + b) λ² − c λ + (a b + c σ − d), with a = σ² − tr adj S, b = σ² + zᵀz, c = det S + zᵀS z and
    d = zᵀS²z (Shuster and Oh 1981, equation 70). No root is larger than the start, so that every step
    goes down to it.
    """
    s, z, trace, adjoint, determinant = _quest_terms(b)
    sz = [dot(s[i], z) for i in range(3)]
    one, two = trace**2 - adjoint, trace**2 + dot(z, z)
    three, four = determinant + dot(z, sz), dot(sz, sz)
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
    k = davenport_matrix(b)
    trace = k[3][3]
    s = [[k[i][j] + (trace if i == j else 0.0) for j in range(3)] for i in range(3)]
    minors = [s[1][1] * s[2][2] - s[1][2] ** 2, s[0][0] * s[2][2] - s[0][2] ** 2]
    minors.append(s[0][0] * s[1][1] - s[0][1] ** 2)
    determinant = dot(s[0], cross(s[1], s[2]))
    return s, k[3][:3], trace, sum(minors), determinant


# q′ ⊗ (a half turn about x, y or z), as component and sign, and q′ itself (2.12).
_TURNED_BACK = (
    ((3, 1), (2, -1), (1, 1), (0, -1)),
    ((2, 1), (3, 1), (0, -1), (1, -1)),
    ((1, -1), (0, 1), (3, 1), (2, -1)),
    ((0, 1), (1, 1), (2, 1), (3, 1)),
)


def quest_vector(b, largest):
    """The eigenvector of K: [X, γ] of the sequential rotation whose γ, c q₄², is the largest."""
    found, size = None, None
    for turn, back in enumerate(_TURNED_BACK):
        sign = [1.0 if turn in (j, 3) else -1.0 for j in range(3)]
        s, z, trace, adjoint, determinant = _quest_terms(
            [[b[i][j] * sign[j] for j in range(3)] for i in range(3)]
        )
        alpha, beta = largest**2 - trace**2 + adjoint, largest - trace
        gamma = (largest + trace) * alpha - determinant
        sz = [dot(s[i], z) for i in range(3)]
        x = [alpha * z[i] + beta * sz[i] + dot(s[i], sz) for i in range(3)]
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
