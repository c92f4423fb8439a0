"""What a set of rest positions can determine: condition number, coverage, and what to add."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

ALIKE = 15.0  # degrees: directions nearer than this count as one position
COVERED = 36.0  # degrees: faces and edges of a cube cover its corners, 35.3° away

# The 26 faces, edges and corners of a cube (B's figure shows 18 of them).
STANDARD = {
    "/".join(
        f"{axis} {'up' if s > 0 else 'down'}" for axis, s in zip("xyz", signs, strict=True) if s
    ): (np.array(signs) / np.linalg.norm(signs))
    for signs in sorted(
        (s for s in itertools.product((1, 0, -1), repeat=3) if any(s)),
        key=lambda s: (sum(map(abs, s)), tuple(-x for x in s)),
    )
}


@dataclass(frozen=True, eq=False)
class Coverage:
    """How well directions of gravity determine a calibration from norms alone.

    Attributes
    ----------
    distinct : number of directions that differ by more than `ALIKE`
    condition : condition number of the design, each parameter in its natural size (bias in g)
    covered : share of the 26 faces, edges and corners of a cube that have a position within `COVERED`
    inflation : by parameter, its standard error over that of as many positions spread evenly
    """

    distinct: int
    condition: float
    covered: float
    inflation: np.ndarray


def design(directions: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P, K) derivatives of ``‖true‖`` (in g) by matrix entries and biases (in g), sign reversed.

    ``∂‖Q(l − b)‖/∂M_jk = −u_j u_k`` and ``∂/∂b = −u`` for the ideal matrix, u the unit direction.
    """
    rows, columns = np.nonzero(free)
    return np.hstack([directions[:, rows] * directions[:, columns], directions])


def coverage(directions: np.ndarray, free: np.ndarray) -> Coverage:
    """The coverage of (P, 3) unit directions for the parameters `free` (3, 3) and three biases."""
    a = design(directions, free)
    k = a.shape[1]
    singular = np.linalg.svd(a, compute_uv=False)
    condition = singular[0] / singular[-1] if len(singular) == k and singular[-1] > 0 else np.inf
    angle = np.degrees(np.arccos(np.clip(directions @ np.array([*STANDARD.values()]).T, -1, 1)))
    inflation = np.full(k, np.inf)
    if condition < 1e8:
        even = design(np.array([*STANDARD.values()]), free)
        ideal = np.diag(np.linalg.inv(even.T @ even)) * len(even)
        inflation = np.sqrt(np.diag(np.linalg.inv(a.T @ a)) * len(a) / ideal)
    return Coverage(
        distinct(directions),
        float(condition),
        float((angle.min(axis=0) < COVERED).mean()),
        inflation,
    )


def distinct(directions: np.ndarray) -> int:
    """How many of (P, 3) unit directions differ from all counted before by more than `ALIKE`."""
    kept: list[np.ndarray] = []
    for u in directions:
        if all(u @ other < np.cos(np.radians(ALIKE)) for other in kept):
            kept.append(u)
    return len(kept)


def positions_to_add(directions: np.ndarray, free: np.ndarray, enough) -> list[str]:
    """Names of the standard positions that, added one by one, make `enough(coverage)` true.

    Each is the one that raises the determinant of the normal matrix most (D-optimal, greedy), a
    weak prior keeping it away from zero.
    """
    added: list[str] = []
    current = directions
    while not enough(coverage(current, free)) and len(added) < len(STANDARD):
        a = design(current, free)
        inverse = np.linalg.inv(a.T @ a + 1e-6 * np.eye(a.shape[1]))
        left = {n: design(d[None], free)[0] for n, d in STANDARD.items() if n not in added}
        best = max(left, key=lambda n: round(float(left[n] @ inverse @ left[n]), 6))
        added.append(best)
        current = np.vstack([current, STANDARD[best]])
    return added
