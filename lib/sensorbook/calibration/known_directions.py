"""Calibration from levelled positions whose direction is known: six-position and recursive (B 5–16)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

from sensorbook.calibration.adjustment import paule_mandel, rms
from sensorbook.calibration.model import FREE, IDEAL, ErrorModel
from sensorbook.calibration.multi_position import folds, norm_errors
from sensorbook.calibration.positions import FACES, Positions
from sensorbook.calibration.result import Calibration
from sensorbook.errors import Refusal

TURNED = 0.01  # significance at which the sensor counts as turned in its housing
START = 1e6  # variance of the recursive solution's start: nothing is known
BLOCK = 20  # samples a step


def six_position(
    positions: Positions,
    directions: np.ndarray,
    gravity: float,
    parameters: int = 9,
    data: str = "means",
) -> Calibration:
    """Six-position static calibration, SPS: ``L = A X`` by weighted least squares (B 5–8).

    Parameters
    ----------
    positions : P rests, m/s², each axis up and down at least once
    directions : (P, 3) unit direction of the specific force in each, known by levelling
    gravity : local, m/s²
    parameters : 6, 9 (M lower triangular) or 12; all are separable where directions are known
    data : "means", weighted by the inverse of their covariance; or "raw" and "denoised" samples with
        unit weights, as B has it

    Raises
    ------
    Refusal : a face is missing

    A levelling error θ tilts the specific force by gθ across its direction and shortens it by gθ²/2
    along it only. With means both stand in the weights, θ as the residuals show it, so that bias and
    scale factor come from the axis that is up or down (as in Ferraris' method) and the misalignments
    from the other two.
    """
    return _calibrate(
        "six_position", _least_squares, positions, directions, gravity, parameters, data
    )


def recursive(
    positions: Positions,
    directions: np.ndarray,
    gravity: float,
    parameters: int = 9,
    data: str = "means",
) -> Calibration:
    """Recursive least squares, RLS, on the inverse model ``a = Q l − b′`` (B 9–16).

    Arguments as for `six_position`. The solution is carried back to M = Q⁻¹ and b = M b′.
    """
    return _calibrate("recursive", _recursion, positions, directions, gravity, parameters, data)


def turned_in_housing(positions: Positions, directions: np.ndarray, gravity: float) -> float:
    """p-value of the F test of nine parameters against twelve.

    Levelled faces are the housing's. A sensor turned in it needs all six off-diagonals; nine take
    its x axis for the housing's.
    """
    directions = np.asarray(directions, dtype=float)
    observed, true, covariances, size = _observations(positions, directions, gravity, "means")
    model, _, tilt, *_ = _fit(_least_squares, positions, directions, gravity, FREE[12], "means")
    weights = _weights(_least_squares, covariances, directions, tilt, gravity, model)
    nine, twelve = (_least_squares(observed, true, weights, FREE[n], size)[2] for n in (9, 12))
    dof = 3 * len(positions) - 12
    return float(stats.f.sf((nine - twelve) / 3 / (twelve / dof), 3, dof))


def face(label: str) -> str:
    """The key of `FACES` that a label names; raises `KeyError` where it names none."""
    text = label.split("(")[0].strip().lower().replace("_", " ").replace("-up", " up")
    text = text.replace("-down", " down")
    if text and text[0] in "+-" and len(text) == 2:
        text = f"{text[1]} {'up' if text[0] == '+' else 'down'}"
    words = text.split()
    if len(words) == 2 and words[1] in ("p", "a"):
        words[1] = {"p": "up", "a": "down"}[words[1]]
    name = " ".join(words)
    if name not in FACES:
        raise KeyError(label)
    return name


def recursion_history(
    positions: Positions, directions: np.ndarray, gravity: float, parameters: int = 9
) -> np.ndarray:
    """(P, K) the recursive solution of the means after each position, as matrix entries and biases."""
    free = FREE[parameters]
    history: list[np.ndarray] = []

    def keep(q: np.ndarray) -> None:
        model = _inverted(q, free)[0]
        history.append(np.r_[model.matrix[free], model.bias])

    observed, true, covariances, size = _observations(positions, directions, gravity, "means")
    model, _, tilt, *_ = _fit(_recursion, positions, directions, gravity, free, "means")
    weights = _weights(_recursion, covariances, directions, tilt, gravity, model)
    _recursion(observed, true * (1 - (tilt / gravity) ** 2), weights, free, size, each=keep)
    return np.array(history)


def _calibrate(method, solve, positions, directions, gravity, parameters, data) -> Calibration:
    directions = np.asarray(directions, dtype=float)
    require_faces(directions)
    free = FREE[parameters]
    model, covariance, excess, dof, white = _fit(solve, positions, directions, gravity, free, data)
    errors = np.full(len(positions), np.nan)
    fold = folds(positions) if len(np.unique(positions.runs)) > 1 else np.arange(len(positions))
    for k in np.unique(fold):
        out = fold == k
        if np.linalg.cond(np.c_[directions[~out], np.ones((~out).sum())]) < 1e3:
            partial = _fit(solve, positions[~out], directions[~out], gravity, free, data)[0]
            errors[out] = norm_errors(partial, positions[out], gravity)
    before = np.linalg.norm(positions.means, axis=1) - gravity
    after = norm_errors(model, positions, gravity)
    return Calibration(
        method=method,
        sensor="accelerometer",
        data=data,
        model=model,
        free=free,
        covariance=covariance,
        dof=dof,
        chi_square=white / max(dof, 1),
        excess=excess,
        residuals=after,
        kept=np.ones(len(positions), dtype=bool),
        rejected=(),
        gravity=gravity,
        rms_before=rms(before),
        rms_after=rms(after),
        rms_check=rms(errors),
    )


def require_faces(directions: np.ndarray) -> None:
    """Raises `Refusal` where an axis was not held both up and down."""
    missing = [
        name for name, d in FACES.items() if not len(directions) or (directions @ d).max() < 0.9
    ]
    if missing:
        raise Refusal(
            f"Of the six positions {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing: without both signs of an axis its bias "
            "cannot be told from its scale factor.",
            f"Record a rest with {', with '.join(missing)}, levelled, on the same table.",
        )


def _observations(positions, directions, gravity, data):
    """Readings (N, 3), true values (N, 3), covariances (N, 3, 3), and rows a step."""
    true = gravity * directions
    if data == "means":
        return positions.means, true, positions.covariances * positions.slow_noise, 1
    observed = np.vstack(positions.samples)
    unit = np.broadcast_to(np.eye(3), (len(observed), 3, 3))
    return observed, np.repeat(true, positions.counts, axis=0), unit, BLOCK


def _fit(solve: Callable, positions, directions, gravity, free, data):
    """Model, scaled covariance, g·θ (m/s²), degrees of freedom and χ² of the samples' noise alone."""
    observed, true, covariances, size = _observations(positions, directions, gravity, data)
    dof = 3 * len(observed) - int(free.sum()) - 3

    def attempt(tilt: float, model: ErrorModel):
        weights = covariances
        if data == "means":
            weights = _weights(solve, covariances, directions, tilt, gravity, model)
        # Tilts shorten the specific force along the axis that is up: by θ² on average.
        return solve(observed, true * (1 - (tilt / gravity) ** 2), weights, free, size)

    model, covariance, white = attempt(0.0, IDEAL)
    chi, tilt = white, 0.0
    for _ in range(2 if data == "means" else 0):  # the weights hang on the model, but weakly
        start = model
        left = rms(observed - start.distort(true))
        tilt = paule_mandel(lambda s, start=start: attempt(s, start)[2], dof, left)
        model, covariance, chi = attempt(tilt, start)
    return model, covariance * chi / max(dof, 1), tilt, dof, white


def _weights(solve, covariances, directions, tilt, gravity, model: ErrorModel) -> np.ndarray:
    """(P, 3, 3) covariance of what a solver leaves: the noise of the means, and the specific force
    where levelling errs by tilt/gravity radians. Least squares has readings, the recursion true
    values on its left-hand side."""
    along = directions[:, :, None] * directions[:, None, :]
    force = tilt**2 * (np.eye(3) - along) + (tilt**2 / gravity) ** 2 * along
    if solve is _least_squares:
        return covariances + model.matrix @ force @ model.matrix.T
    inverse = np.linalg.inv(model.matrix)
    return inverse @ covariances @ inverse.T + force


def _rows(values: np.ndarray, free: np.ndarray, sign: float) -> np.ndarray:
    """(N, 3, K) derivatives of ``X v ± b`` by the free entries of X and b."""
    rows, columns = np.nonzero(free)
    a = np.zeros((len(values), 3, len(rows) + 3))
    a[:, rows, np.arange(len(rows))] = values[:, columns]
    a[:, :, len(rows) :] = sign * np.eye(3)
    return a


def _least_squares(observed, true, covariances, free, size):
    """Weighted least squares of ``l = M a + b`` by QR."""
    a = _rows(true, free, 1.0)
    root = np.linalg.cholesky(covariances)
    weighted = np.linalg.solve(root, a).reshape(-1, a.shape[2])
    right = np.linalg.solve(root, observed[..., None]).reshape(-1)
    q, r = np.linalg.qr(weighted)
    solution = np.linalg.solve(r, q.T @ right)
    inverse = np.linalg.inv(r)
    matrix = np.zeros((3, 3))
    matrix[free] = solution[:-3]
    left = right - weighted @ solution
    return ErrorModel(matrix, solution[-3:]), inverse @ inverse.T, float(left @ left)


def _recursion(observed, true, covariances, free, size, each=None):
    """``K = P Hᵀ(H P Hᵀ + R)⁻¹``, ``Φ += K (z − H Φ)``, ``P −= K H P``; `each` sees every Φ."""
    count = int(free.sum())
    rows, columns = np.nonzero(free)
    phi = np.r_[(rows == columns).astype(float), np.zeros(3)]
    p = START * np.eye(count + 3)
    h_all = _rows(observed, free, -1.0)
    # One unit of weight for all, so that the start's variance means the same whatever the noise.
    unit = float(np.mean(np.trace(covariances, axis1=1, axis2=2)) / 3)
    for k in range(0, len(observed), size):
        h = h_all[k : k + size].reshape(-1, count + 3)
        noise = np.zeros((len(h), len(h)))
        for j, c in enumerate(covariances[k : k + size]):
            noise[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = c / unit
        gain = np.linalg.solve(h @ p @ h.T + noise, h @ p).T
        phi = phi + gain @ (true[k : k + size].reshape(-1) - h @ phi)
        keep = np.eye(count + 3) - gain @ h
        p = keep @ p @ keep.T + gain @ noise @ gain.T  # Joseph's form stays positive
        if each:
            each(phi)
    model, jacobian = _inverted(phi, free)
    left = true - np.einsum("nij,j->ni", h_all, phi)
    chi = float(np.einsum("ni,nij,nj->", left, np.linalg.inv(covariances), left))
    return model, jacobian @ (p * unit) @ jacobian.T, chi


def _inverted(phi: np.ndarray, free: np.ndarray):
    """The model of ``a = Q l − b′``, and the derivatives of its parameters by those of Q and b′."""
    q = np.zeros((3, 3))
    q[free] = phi[:-3]
    m = np.linalg.inv(q)
    b = m @ phi[-3:]
    rows, columns = np.nonzero(free)
    count = len(rows)
    jacobian = np.zeros((count + 3, count + 3))
    for k, (r, c) in enumerate(zip(rows, columns, strict=True)):
        change = -np.outer(m[:, r], m[c])
        jacobian[:count, k] = change[free]
        jacobian[count:, k] = change @ phi[-3:]
    jacobian[count:, count:] = m
    return ErrorModel(m * free, b), jacobian
