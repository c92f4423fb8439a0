"""Vector observations made ready for the solvers, and what they determine: the attitude or why not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.rotations import quaternion_from_matrix
from sensorbook.errors import Refusal

# Epochs worked on at a time: their arrays stay in the processor's cache.
CHUNK = 4096

REASONS = (
    "",
    "a vector has no length",
    "a vector or its weight holds no finite number",
    "the measured vectors are parallel: the rotation about them is not determined",
    "the reference vectors are parallel: the rotation about them is not determined",
    "fewer than two vectors have a weight: the rotation about one is not determined",
    "the vectors contradict each other, or one outweighs all others: more than one attitude fits them",
)
OK, ZERO, NOT_FINITE, MEASURED_PARALLEL, REFERENCE_PARALLEL, UNWEIGHTED, CONTRADICTORY = range(
    len(REASONS)
)
_REMEDY = "Observe two directions that are well apart; check that both sets are in the same order."


@dataclass(frozen=True)
class Observations:
    """Unit vectors by component: `measured` and `reference` are (k, 3, N or 1), `weights` (k, N or 1).

    `weights` sum to 1; `roots` (k, N or 1) are their square roots as they were given, 1/σ where only σ
    was. `batch` is the shape of the epochs, N their number; `sigma` is (k, N or 1) or None; `refused` is
    (N,), an index into `REASONS`.
    """

    measured: np.ndarray
    reference: np.ndarray
    weights: np.ndarray
    roots: np.ndarray
    sigma: np.ndarray | None
    refused: np.ndarray
    batch: tuple[int, ...]

    @classmethod
    def of(
        cls,
        measured: ArrayLike,
        reference: ArrayLike,
        weights: ArrayLike | None,
        sigma: ArrayLike | None,
        exactly: int | None = None,
        every: bool = False,
    ) -> Observations:
        """Checks and normalises; a ValueError where the arrays do not belong together.

        `exactly` is the number of vectors that the method takes. A vector of weight 0 is as if it were
        not there, whatever it holds, unless the method uses `every` one.
        """
        measured, reference = _vectors(measured, "measured"), _vectors(reference, "reference")
        count = measured.shape[-2]
        if reference.shape[-2] != count:
            raise ValueError(
                f"measured has {count} vectors an epoch and reference {reference.shape[-2]}: "
                "each needs its partner"
            )
        if count < 2:
            raise ValueError(
                "one vector leaves the rotation about it undetermined: give two or more an epoch"
            )
        if exactly and count != exactly:
            raise ValueError(
                f"this method takes {exactly} vectors an epoch, not {count}: choose two"
            )
        roots = np.ones(count)
        if sigma is not None:
            sigma = _numbers(sigma, count, "sigma")
            if (sigma <= 0).any():
                raise ValueError(f"sigma: the least is {np.nanmin(sigma):g}; it must be positive")
            roots = 1 / sigma
        if weights is not None:
            weights = _numbers(weights, count, "weights")
            if (weights < 0).any():
                raise ValueError(
                    f"weights: the least is {np.nanmin(weights):g}; none may be negative"
                )
            roots = np.sqrt(weights)
        try:
            batch = np.broadcast_shapes(
                measured.shape[:-2],
                reference.shape[:-2],
                roots.shape[:-1],
                () if sigma is None else sigma.shape[:-1],
            )
        except ValueError:
            raise ValueError(
                f"measured {measured.shape}, reference {reference.shape} and weights {roots.shape} "
                "have different numbers of epochs"
            ) from None
        size = int(np.prod(batch))
        refused = np.zeros(size, dtype=np.uint8)
        roots = _columns(roots, batch, size, 1)
        sigma = None if sigma is None else _columns(sigma, batch, size, 1)
        there = np.ones_like(roots, dtype=bool) if every else roots != 0
        ready = [_unit(_columns(a, batch, size, 2), there, refused) for a in (measured, reference)]
        with np.errstate(all="ignore"):
            share = (roots / roots.max(axis=0)) ** 2  # in range whatever the roots are
            share = share / share.sum(axis=0)
        if not every:
            refused[np.broadcast_to((roots == 0).all(axis=0), size)] = UNWEIGHTED
        known = np.isfinite(roots).all(axis=0) & (sigma is None or np.isfinite(sigma).all(axis=0))
        refused[np.broadcast_to(~known, size)] = NOT_FINITE
        return cls(*ready, share, roots, sigma, refused, batch)

    def chunks(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
        """Slices of epochs with their measured and reference vectors and weights."""
        for start in range(0, len(self.refused), CHUNK):
            part = slice(start, start + CHUNK)
            arrays = (self.measured, self.reference, self.weights)
            yield part, *(a if a.shape[-1] == 1 else a[..., part] for a in arrays)

    def solved(self, matrix: np.ndarray, weights: np.ndarray | None = None) -> Solution:
        """The solution with matrices (3, 3, N), once `refused` is filled; a Refusal for a lone epoch."""
        for code in np.unique(self.refused[self.refused > 0]) if not self.batch else ():
            raise Refusal(f"The attitude is not determined: {REASONS[code]}.", _REMEDY)
        matrix[..., self.refused > 0] = np.nan
        return Solution(self, np.moveaxis(matrix, -1, 0), weights)

    def refuse(self, part: slice, undetermined: np.ndarray) -> None:
        """Marks the epochs of a slice that have no single best attitude, and finds out why."""
        for epoch in np.flatnonzero(undetermined) + part.start:
            if self.refused[epoch]:
                continue
            weighed = self.roots[:, epoch if self.roots.shape[-1] > 1 else 0] > 0
            code = CONTRADICTORY if weighed.sum() > 1 else UNWEIGHTED
            for vectors, parallel in (
                (self.measured, MEASURED_PARALLEL),
                (self.reference, REFERENCE_PARALLEL),
            ):
                index = epoch if vectors.shape[-1] > 1 else 0
                spread = np.linalg.svd(vectors[weighed, :, index], compute_uv=False)[1:2]
                if code == CONTRADICTORY and spread < 1e-4:
                    code = parallel
            self.refused[epoch] = code


@dataclass(frozen=True)
class Solution:
    """Attitudes from vector observations.

    Attributes
    ----------
    matrix : (…, 3, 3), v_body = A v_ref; NaN where the epoch's vectors do not determine it
    """

    _observations: Observations
    _matrix: np.ndarray
    _limit_weights: np.ndarray | None  # of TRIAD: the first infinite

    @property
    def matrix(self) -> np.ndarray:
        return self._matrix.reshape(*self._observations.batch, 3, 3)

    @property
    def determined(self) -> np.ndarray:
        """Whether an epoch's vectors determine its attitude, (…)."""
        return (self._observations.refused == OK).reshape(self._observations.batch)

    @property
    def reasons(self) -> np.ndarray:
        """Why an epoch has no attitude, in words, (…); "" where it has one."""
        return np.array(REASONS)[self._observations.refused].reshape(self._observations.batch)

    @cached_property
    def quaternion(self) -> np.ndarray:
        """(…, 4), scalar last, q₄ ≥ 0; NaN as `matrix`."""
        found = np.full((len(self._matrix), 4), np.nan)
        good = self._observations.refused == OK
        found[good] = quaternion_from_matrix(self._matrix[good])
        return found.reshape(*self._observations.batch, 4)

    @cached_property
    def loss(self) -> np.ndarray:
        """Wahba's loss ½ Σ w ‖g − A r‖², (…), with the weights given (1/σ² where only `sigma` was).

        With weights 1/σ² twice the loss follows χ² with 2k − 3 degrees of freedom, where the vectors
        belong together. With TRIAD's infinite weight it is that of both vectors with weights given.
        """
        seen = self._observations
        off = seen.measured - self._predicted()
        loss = 0.5 * ((seen.roots[:, None] * off) ** 2).sum(axis=(0, 1))
        return loss.reshape(seen.batch)

    @cached_property
    def covariance(self) -> np.ndarray | None:
        """Covariance (…, 3, 3), rad², of the error vector in body axes; None without `sigma`.

        `sigma` is the standard error of each direction, rad, the same in both its components. For
        weights 1/σ² it is the inverse of Σ (I − b bᵀ)/σ² (Shuster and Oh 1981, equation 93); for others
        H⁻¹ Σ w²σ² (I − b bᵀ) H⁻¹ with H = Σ w (I − b bᵀ), and for TRIAD the limit of a first weight
        that grows without bound.
        """
        seen = self._observations
        if seen.sigma is None:
            return None
        directions = np.moveaxis(self._predicted(), -1, 0)  # (N, k, 3)
        directions[seen.refused > 0] = np.eye(3)[np.arange(directions.shape[1]) % 3]
        sigma = np.broadcast_to(seen.sigma.T, directions.shape[:2])
        if self._limit_weights is not None:
            found = _triad_covariance(directions, sigma**2)
        else:
            found = _covariance(directions, np.sqrt(seen.weights.T), sigma)
        found[seen.refused > 0] = np.nan
        return found.reshape(*seen.batch, 3, 3)

    def _predicted(self) -> np.ndarray:
        """The reference vectors in the body's axes, (k, 3, N)."""
        reference = np.moveaxis(self._observations.reference, -1, 0)  # (N or 1, k, 3)
        return np.moveaxis(reference @ np.swapaxes(self._matrix, -1, -2), 0, -1)


def _covariance(directions: np.ndarray, roots: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """H⁻¹ Σ w²σ² (I − b bᵀ) H⁻¹ from directions (N, k, 3), √w and σ (N, k): (N, 3, 3).

    H is JᵀJ, J the rows √w [b×]. From J's singular values, so that what two nearly parallel vectors or very
    unequal weights leave small is not lost in the rest.
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*x.shape, 3, 3)
    roots = np.broadcast_to(roots, x.shape)
    rows = (roots[..., None, None] * cross).reshape(len(x), 3 * x.shape[1], 3)
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    spread = np.repeat(roots * sigma, 3, axis=-1)[..., None] * u / s[:, None]
    return np.swapaxes(vt, -1, -2) @ (np.swapaxes(spread, -1, -2) @ spread) @ vt


def _triad_covariance(directions: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """The first vector's error turns about the axes across it; about itself, the second's and c/s of it."""
    first, second = directions[:, 0], directions[:, 1]
    cosine = (first * second).sum(axis=-1)
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    across = (second - cosine[:, None] * first) / sine[:, None]
    lean = (cosine / sine)[:, None, None]
    own, mixed = (_outer(first, first), _outer(across, first))
    about = variance[:, 1, None, None] / sine[:, None, None] ** 2
    trusted = variance[:, 0, None, None]
    return (
        trusted * (np.eye(3) - own + lean * (mixed + np.swapaxes(mixed, -1, -2)) + lean**2 * own)
        + about * own
    )


def _outer(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one[:, :, None] * other[:, None, :]


def solve_by_chunks(seen: Observations, solve: Callable[..., tuple]) -> np.ndarray:
    """Matrices (3, 3, N) from `solve(measured, reference, weights)` → matrix by rows, undetermined."""
    matrix = np.empty((3, 3, len(seen.refused)))
    with np.errstate(all="ignore"):  # refused epochs may hold anything
        for part, measured, reference, weights in seen.chunks():
            rows, undetermined = solve(measured, reference, weights)
            for i in range(3):
                for j in range(3):
                    matrix[i, j, part] = rows[i][j]
            if np.any(undetermined):
                size = matrix[0, 0, part].size
                seen.refuse(part, np.broadcast_to(undetermined, size))
    return matrix


def _vectors(array: ArrayLike, name: str) -> np.ndarray:
    array = _plain(array)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise ValueError(f"{name}: shape is {array.shape}, needed is (…, k, 3)")
    return array


def _numbers(values: ArrayLike, count: int, name: str) -> np.ndarray:
    values = _plain(values)
    if values.ndim < 1 or values.shape[-1] != count:
        raise ValueError(f"{name}: shape is {values.shape}, needed is (…, {count}), one a vector")
    if np.isinf(values).any():
        raise ValueError(f"{name}: one is infinite; TRIAD trusts its first vector wholly")
    return values


def _plain(array: ArrayLike) -> np.ndarray:
    """An array of floats; what is masked is no number."""
    if isinstance(array, np.ma.MaskedArray):
        return np.ma.filled(array.astype(float), np.nan)
    return np.asarray(array, dtype=float)


def _columns(array: np.ndarray, batch: tuple[int, ...], size: int, own: int) -> np.ndarray:
    """The last `own` dimensions first and the epochs last, N of them, or 1 where all have the same."""
    if array.ndim == own or size == 1:
        return np.ascontiguousarray(array.reshape(array.shape[-own:])[..., None])
    array = np.broadcast_to(array, (*batch, *array.shape[-own:]))
    flat = array.reshape(size, int(np.prod(array.shape[-own:]))).T
    return np.ascontiguousarray(flat).reshape(*array.shape[-own:], size)


def _unit(vectors: np.ndarray, there: np.ndarray, refused: np.ndarray) -> np.ndarray:
    """(k, 3, N) vectors made unit, 0 where they are not `there`; marks the epochs where that cannot be."""
    unit = np.empty_like(vectors)
    every = vectors.shape[-1] == 1
    with np.errstate(all="ignore"):
        for start in range(0, vectors.shape[-1], CHUNK):
            part = slice(start, start + CHUNK)
            own = vectors[..., part]
            length = _length(own)
            if not ((length > 1e-150) & (length < 1e150)).all():
                own = own / np.abs(own).max(axis=1, keepdims=True)  # whose squares are in range
                own[np.isnan(own) & (vectors[..., part] == 0)] = 0.0
                length = _length(own)
            for i in range(3):
                unit[:, i, part] = own[:, i] / length
            _mark(refused, length == 0, ZERO, there, part, every)
            _mark(refused, ~np.isfinite(length), NOT_FINITE, there, part, every)
    if not there.all():
        unit = np.where(there[:, None], unit, 0.0)
    return unit


def _mark(
    refused, wrong: np.ndarray, code: int, there: np.ndarray, part: slice, every: bool
) -> None:
    """Marks the epochs (of a slice, or all where they share the vectors) with a wrong vector that counts."""
    if wrong.any():
        of = slice(None) if every else part
        counts = there if there.shape[-1] == 1 else there[:, of]
        refused[of][(wrong & counts).any(axis=0) & np.ones(len(refused[of]), dtype=bool)] = code


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
