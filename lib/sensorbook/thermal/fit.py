"""Choice and fit of a thermal model.

Candidates are polynomials of degree 0 to 5 and pairs of polynomials (degree 0 to 3) joined by a jump.
Thermal residuals are autocorrelated, so that ordinary cross-validation and AIC over-fit; each candidate
is judged on whole stretches of time, or whole runs where there are several, that its fit has not seen.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from sensorbook.estimate import Estimate
from sensorbook.thermal.model import Form, ThermalModel
from sensorbook.thermal.repeat import compare_cycles
from sensorbook.thermal.result import Candidate, ThermalAxis, ThermalFit
from sensorbook.thermal.sweep import Sweep

DEGREES = range(6)
JUMP_DEGREES = range(4)
STRETCHES = 12  # of time a sweep is cut into for held-out errors and the jackknife
PUBLISHED_DEGREES = (1, 3, 5)  # work A's
EDGE = 0.1  # of the range at either end where a jump is not looked for


def fit_thermal(sweep: Sweep, sensor: str = "") -> ThermalFit:
    """Thermal calibration of each axis.

    Polynomials and models with a jump are compared by their held-out errors (`_choose`). Standard
    errors come from a jackknife over stretches of time.

    Parameters
    ----------
    sweep : block means of one or several runs; runs have offsets of their own
    sensor : its name, for units
    """
    reference = float(np.round(np.mean(sweep.span)))  # where the model is best known
    costs = _Costs(sweep)
    axes = tuple(_fit_axis(sweep, costs, axis, reference) for axis in range(sweep.values.shape[1]))
    return ThermalFit(sensor, sweep.files, axes)


class _Costs:
    """What the fits of all axes share: the blocks they use, and what each form leaves of each axis.

    Attributes
    ----------
    uses : (U, M) which blocks a fit uses: all, all but one fold each, all but one stretch each
    folds, stretches : rows of `uses`, in the order of their fold and of their stretch
    """

    def __init__(self, sweep: Sweep):
        self.t, self.y, self.span = sweep.temperature, sweep.values, sweep.span
        self.root = np.sqrt(sweep.weight)
        self.offsets = (sweep.run[:, None] == np.arange(len(sweep.files))).astype(float)
        self.stretch = _stretches(sweep)
        self.fold = sweep.run if _overlap(sweep) else self.stretch
        out = [self.fold == k for k in np.unique(self.fold)]
        self.folds = self.stretches = range(1, 1 + len(out))
        if self.fold is not self.stretch:
            out += [self.stretch == k for k in np.unique(self.stretch)]
            self.stretches = range(self.folds.stop, 1 + len(out))
        self.uses = ~np.array([np.zeros(len(self.t), dtype=bool), *out])
        self._used = self.uses.astype(float)
        self._columns: dict[Form, np.ndarray] = {}
        self._costs: dict[Form, np.ndarray] = {}

    def columns(self, form: Form) -> np.ndarray:
        """(M, R + P) design matrix: offsets of the runs and the form's columns."""
        if form not in self._columns:
            self._columns[form] = np.hstack([self.offsets, form.columns(self.t, self.span)])
        return self._columns[form]

    def of(self, form: Form) -> np.ndarray:
        """(U, A) weighted sums of squared residuals of a form with a jump, by the normal equations.

        Infinite where a side of the jump has too few blocks.
        """
        if form not in self._costs:
            self._costs[form] = self._of(form)
        return self._costs[form]

    def _of(self, form: Form) -> np.ndarray:
        low, high = form.jump
        sides = self._used @ np.column_stack([self.t < low, self.t > high])
        cost = np.full((len(self.uses), self.y.shape[1]), np.inf)
        fits = sides.min(axis=1) >= 4 * (form.degree + 2)
        if not fits.any():
            return cost
        used = self._used[fits]
        a, y = self.columns(form) * self.root[:, None], self.y * self.root[:, None]
        size = a.shape[1]
        normal = (used @ (a[:, :, None] * a[:, None, :]).reshape(len(a), -1)).reshape(
            -1, size, size
        )
        right = (used @ (a[:, :, None] * y[:, None, :]).reshape(len(a), -1)).reshape(
            -1, size, y.shape[1]
        )
        absent = np.einsum("ukk->uk", normal)  # a run that is left out has no offset
        absent[absent == 0] = 1.0
        try:
            x = np.linalg.solve(normal, right)
        except np.linalg.LinAlgError:
            x = np.linalg.pinv(normal, rcond=1e-14, hermitian=True) @ right
        cost[fits] = np.einsum("um,uma->ua", used, (y - a @ x) ** 2)
        return cost


class _Problem:
    """One axis of a sweep: weighted least squares with one offset a run."""

    def __init__(self, sweep: Sweep, costs: _Costs, axis: int):
        self.t, self.y, self.run, self.span = (
            sweep.temperature,
            costs.y[:, axis],
            sweep.run,
            sweep.span,
        )
        self.root, self.offsets = costs.root, costs.offsets
        self.stretch, self.fold = costs.stretch, costs.fold
        self.costs, self.axis = costs, axis

    def solve(self, form: Form, use: int = 0) -> np.ndarray:
        """(R + P,) offsets and coefficients, by the blocks of one row of `costs.uses`."""
        used = self.costs.uses[use]
        a = self.costs.columns(form)[used]
        root = self.root[used]
        return np.linalg.lstsq(a * root[:, None], self.y[used] * root, rcond=1e-10)[0]

    def residual(self, form: Form, use: int = 0) -> np.ndarray:
        """(M,) what a fit leaves of every block."""
        return self.y - self.costs.columns(form) @ self.solve(form, use)

    def place_jump(self, degree: int, use: int = 0, near: Form | None = None) -> Form | None:
        """The jump that fits best: a coarse search over place and width, then two finer ones.

        With `near` only the finer ones, around its place.
        """
        low, high = self.span
        span = high - low
        best, form = np.inf, near
        step = (1 - 2 * EDGE) * span / 32
        centres = np.linspace(low + EDGE * span, high - EDGE * span, 33)
        widths = np.array([0.01, 0.03, 0.08]) * span
        if near:
            step /= 3
            centres, widths = np.mean(near.jump) + step * np.arange(-2, 3), [np.ptp(near.jump)]
        for _ in range(2 if near else 3):
            for c in centres:
                for w in widths:
                    trial = Form(degree, (c - w / 2, c + w / 2))
                    cost = self.costs.of(trial)[use, self.axis]
                    if cost < best:
                        best, form = cost, trial
            if form is None:
                return None
            middle, width = np.mean(form.jump), np.ptp(form.jump)
            step /= 3
            centres, widths = middle + step * np.arange(-2, 3), width * np.array([0.6, 1, 1.6])
            widths = widths[widths >= 0.004 * span]
        return form

    def held_out(self, make) -> np.ndarray:
        """(S,) mean squared error in each stretch of time, by fits without its fold.

        Held-out data outside the temperatures of the fit do not count: there a model is not used.
        """
        squared = np.full(len(self.y), np.nan)
        for use in self.costs.folds:
            out = ~self.costs.uses[use]
            form = make(use)
            if form is None:
                return np.full(self.stretch.max() + 1, np.inf)
            r = self.residual(form, use)
            if len(np.unique(self.run)) > 1:
                # A run has its own offset; the one left out gets its own, by its mean.
                r -= np.average(r[out], weights=self.root[out] ** 2)
            fitted = self.t[~out]
            known = out & (self.t >= fitted.min()) & (self.t <= fitted.max())
            squared[known] = r[known] ** 2 * self.root[known] ** 2
        return np.array(
            [
                np.nanmean(squared[s]) if np.isfinite(squared[s]).any() else np.nan
                for s in (self.stretch == k for k in range(self.stretch.max() + 1))
            ]
        )


def _overlap(sweep: Sweep) -> bool:
    """Whether each of several runs can be held out: the others cover a fifth of it."""
    runs = range(len(sweep.files))
    if len(runs) < 2:
        return False
    for r in runs:
        own, others = (sweep.temperature[m] for m in (sweep.run == r, sweep.run != r))
        if np.mean((own >= others.min()) & (own <= others.max())) < 0.2:
            return False
    return True


def _stretches(sweep: Sweep) -> np.ndarray:
    """(M,) index of the stretch of time each block belongs to, none across two runs."""
    runs = len(sweep.files)
    each = max(3, STRETCHES // runs)
    result = np.zeros(len(sweep.time), dtype=int)
    for r in range(runs):
        at = np.flatnonzero(sweep.run == r)
        result[at] = r * each + np.arange(len(at)) * each // max(len(at), 1)
    return result


def _fit_axis(sweep: Sweep, costs: _Costs, axis: int, reference: float) -> ThermalAxis:
    problem = _Problem(sweep, costs, axis)
    y = problem.y
    makers = {f"degree {d}": (lambda use, d=d: Form(d)) for d in DEGREES}
    makers |= {
        f"degree {d}, jump": (lambda use, d=d: problem.place_jump(d, use)) for d in JUMP_DEGREES
    }
    forms = {name: make(0) for name, make in makers.items()}
    errors = {name: problem.held_out(makers[name]) for name, form in forms.items() if form}
    chosen = _choose(errors, forms)
    form = forms[chosen]
    runs = len(sweep.files)
    offsets, x = np.split(problem.solve(form), [runs])
    model = form.model(offsets[0], x, sweep.span, reference)
    residual = problem.residual(form)
    refits = _jackknife(problem, form, sweep.span, reference)
    t = float(stats.t.ppf(0.975, len(refits) - 1))
    grid = np.linspace(*sweep.span, 51)
    low, high = sweep.span

    def interval(quantity) -> Estimate:
        value = float(quantity(model))
        half = t * float(_spread([quantity(m) for m in refits]))
        return Estimate(value, value - half, value + half)

    jump = form.jump and interval(ThermalModel.jump)
    if jump:
        # How far a jump reaches into its sides is a matter of shape, which no residual decides.
        wider = Form(
            form.degree,
            tuple(np.mean(form.jump) + 1.6 * np.subtract(form.jump, np.mean(form.jump))),
        )
        shape = abs(_model(problem, wider, sweep.span, reference).jump() - jump.value)
        half = float(np.hypot(jump.high - jump.value, shape))
        jump = Estimate(jump.value, jump.value - half, jump.value + half)
    return ThermalAxis(
        model=model,
        offsets=tuple(
            float(o + model.bias(np.array([reference]))[0] - offsets[0]) for o in offsets
        ),
        std=tuple(
            tuple(float(s) for s in np.atleast_1d(_spread([m.segments[i][2] for m in refits])))
            for i in range(len(model.segments))
        ),
        rms_before=_rms(problem, problem.residual(Form(0))),
        rms_after=_rms(problem, residual),
        rms_check=float(np.sqrt(np.nanmean(errors[chosen]))),
        change=interval(lambda m: np.subtract(*m.bias(np.array([high, low]))))
        if form.size
        else None,
        jump=jump,
        jump_range=form.jump and tuple(float(j) for j in form.jump),
        candidates=tuple(
            Candidate(
                n,
                forms[n].size,
                _rms(problem, problem.residual(forms[n])),
                float(np.sqrt(np.nanmean(e))),
            )
            for n, e in errors.items()
            if np.isfinite(np.nanmean(e))
        ),
        polynomials={d: _model(problem, Form(d), sweep.span, reference) for d in PUBLISHED_DEGREES},
        coefficients_per_run=tuple(
            float(np.polyfit(problem.t[at], y[at], 1, w=problem.root[at])[0])
            for at in (sweep.run == r for r in range(len(sweep.files)))
        ),
        repeatability=compare_cycles(sweep, y, form.size > 0 or _better(errors, "degree 1")),
        hysteresis=_hysteresis(sweep, residual),
        residual=residual,
        half_width=t * _spread([m.change(grid) for m in refits]),
    )


def _better(errors: dict[str, np.ndarray], name: str) -> bool:
    """Whether a candidate's held-out error is smaller than that of a constant."""
    return bool(np.nanmean(errors[name]) < np.nanmean(errors["degree 0"]))


def _choose(errors: dict[str, np.ndarray], forms: dict[str, Form]) -> str:
    """Simplest candidate within one standard error (paired over stretches) of the best of its kind.

    A jump is a claim: it is taken only where it beats the polynomials by twice that standard error.
    """

    # Differences this small beside the error of a constant are rounding.
    rounding = 1e-14 * float(np.nanmean(errors["degree 0"]))

    def simplest(names: list[str]) -> str:
        names = sorted(names, key=lambda n: forms[n].size)
        best = min(names, key=lambda n: np.nanmean(errors[n]))
        return next(n for n in names if _excess(errors[n], errors[best], rounding) <= 1)

    smooth = simplest([n for n in errors if not forms[n].jump])
    broken = [n for n in errors if forms[n].jump and np.isfinite(np.nanmean(errors[n]))]
    if not broken:
        return smooth
    jump = simplest(broken)
    return jump if _excess(errors[smooth], errors[jump], rounding) > 2 else smooth


def _excess(error: np.ndarray, other: np.ndarray, rounding: float) -> float:
    """How much larger one error is than another, in standard errors of the paired difference."""
    difference = error - other
    difference = difference[np.isfinite(difference)]
    if not len(difference) or np.abs(difference).max() <= rounding:
        return 0.0
    return difference.mean() / (difference.std(ddof=1) / np.sqrt(len(difference)))


def _model(problem: _Problem, form: Form, span, reference, use: int = 0) -> ThermalModel:
    found = problem.solve(form, use)
    return form.model(found[0], found[problem.offsets.shape[1] :], span, reference)


def _rms(problem: _Problem, residual: np.ndarray) -> float:
    return float(np.sqrt(np.average(residual**2, weights=problem.root**2)))


def _jackknife(problem: _Problem, form: Form, span, reference) -> list[ThermalModel]:
    """Refits with one stretch of time left out each; a jump is placed anew."""
    result = []
    for use in problem.costs.stretches:
        again = problem.place_jump(form.degree, use, near=form) if form.jump else form
        result.append(_model(problem, again, span, reference, use))
    return result


def _spread(refits) -> np.ndarray:
    """Jackknife standard error, ``√((K−1)/K Σ(θ_k − θ̄)²)``."""
    x = np.asarray(refits, dtype=float)
    return np.sqrt((len(x) - 1) * np.var(x, axis=0))


def _hysteresis(sweep: Sweep, residual: np.ndarray) -> tuple[float, float, float] | None:
    """Largest heating − cooling difference of the residuals over ten bins of temperature."""
    low, high = sweep.span
    bins = ((sweep.temperature - low) / (high - low) * 10).astype(int).clip(0, 9)
    found = []
    for b in range(10):
        up, down = (residual[(bins == b) & (sweep.direction == s)] for s in (1, -1))
        if min(len(up), len(down)) >= 4:
            # Neighbouring blocks are alike: a quarter of them count as independent.
            error = np.sqrt(4 * (up.var() / len(up) + down.var() / len(down)))
            centre = low + (b + 0.5) * (high - low) / 10
            found.append((float(up.mean() - down.mean()), float(centre), float(error)))
    # One shared bin would be a comparison of two moments, not of two directions.
    return max(found, key=lambda d: abs(d[0])) if len(found) >= 3 else None
