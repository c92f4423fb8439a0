"""Rest positions of an accelerometer or gyroscope: the observations of every static calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

FACES = {  # the axis that is up: direction of the specific force, work B's table 2 in its order
    "z up": (0, 0, 1),
    "z down": (0, 0, -1),
    "y up": (0, 1, 0),
    "y down": (0, -1, 0),
    "x up": (1, 0, 0),
    "x down": (-1, 0, 0),
}


@dataclass(frozen=True, eq=False)
class Positions:
    """Rests of one sensor, P of them.

    Attributes
    ----------
    samples : for each rest its (n, 3) readings
    spans : (P, 2) s, first and last sample
    labels : such as "3 (12.4–17.9 s)" or the label given by hand
    runs : (P,) index of the recording each belongs to
    temperature : (P,) °C, mean of each rest; None where not recorded
    """

    samples: tuple[np.ndarray, ...]
    spans: np.ndarray
    labels: tuple[str, ...]
    runs: np.ndarray
    temperature: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.samples)

    @cached_property
    def counts(self) -> np.ndarray:
        """(P,) samples in each rest."""
        return np.array([len(s) for s in self.samples])

    @cached_property
    def means(self) -> np.ndarray:
        """(P, 3) mean reading of each rest."""
        return np.array([s.mean(axis=0) for s in self.samples]).reshape(-1, 3)

    @cached_property
    def covariances(self) -> np.ndarray:
        """(P, 3, 3) covariance of each mean: the samples' own over their number (white noise).

        A rest whose samples are all alike has the rounding of the mean of others: their median.
        """
        each = np.array([np.cov(s.T) / len(s) for s in self.samples]).reshape(-1, 3, 3)
        each = each + self.rounding[:, None, :] * np.eye(3)
        size = np.trace(each, axis1=1, axis2=2)
        typical = np.median(size[size > 0]) if (size > 0).any() else 1.0
        floor = 1e-2 * typical / 3  # no axis of any rest is taken for a hundred times better
        return each + floor * np.eye(3)

    @cached_property
    def steps(self) -> np.ndarray:
        """(3,) smallest difference of two readings of an axis: the converter's step, or less."""
        found = np.zeros(3)
        for axis in range(3):
            levels = np.unique(np.concatenate([s[:, axis] for s in self.samples]))
            gaps = np.diff(levels)
            # Below a hundredth of the typical one, rounding of decimals made two of one level.
            gaps = gaps[gaps > 1e-2 * np.median(gaps)] if len(gaps) else gaps
            found[axis] = gaps.min() if len(gaps) else 0.0
        return found

    @cached_property
    def rounding(self) -> np.ndarray:
        """(P, 3) variance of a mean by rounding, which more samples do not lower.

        ``q²/12 · exp(−4π²σ²/q²)`` for noise σ and step q: nothing above half a step of noise (Widrow &
        Kollár 2008, chapter 4), all of the step without any.
        """
        step = np.where(self.steps > 0, self.steps, np.inf)
        seen = np.array([s.var(axis=0) for s in self.samples]).reshape(-1, 3)
        noise = np.maximum(seen / step**2 - 1 / 12, 0)
        return self.steps**2 / 12 * np.exp(-4 * np.pi**2 * noise)

    @property
    def coarse(self) -> np.ndarray:
        """(P, 3) where rounding outweighs the white noise of a mean."""
        white = np.array([s.var(axis=0) / len(s) for s in self.samples]).reshape(-1, 3)
        return self.rounding > white

    @cached_property
    def slow_noise(self) -> float:
        """Variance of the means over what white noise gives, at least 1, pooled over rests and axes.

        By batch means: quarters of a rest scatter more than their samples' white noise where the
        noise is not white.
        """
        ratios = []
        for s in self.samples:
            n = len(s) // 4
            white = s.var(axis=0, ddof=1) if n > 2 else np.zeros(3)
            if (white > 0).all():
                quarters = s[: 4 * n].reshape(4, n, 3).mean(axis=1)
                ratios.append(n * quarters.var(axis=0, ddof=1) / white)
        return max(1.0, float(np.mean(ratios))) if ratios else 1.0

    def __getitem__(self, rows) -> Positions:
        """The rests selected by a mask or indices."""
        at = np.arange(len(self))[rows]
        return replace(
            self,
            samples=tuple(self.samples[i] for i in at),
            spans=self.spans[at],
            labels=tuple(self.labels[i] for i in at),
            runs=self.runs[at],
            temperature=None if self.temperature is None else self.temperature[at],
        )


def cut(
    runs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray | None]],
    spans: Sequence[Sequence[tuple[float, float]]],
    labels: Sequence[Sequence[str]] | None = None,
) -> Positions:
    """Cuts rests out of recordings.

    Parameters
    ----------
    runs : for each recording its time (N,), readings (N, 3) and temperature (N,) or None
    spans : for each recording the start and end (s, inclusive) of its rests
    labels : for each recording the names of its rests; numbers where None
    """
    samples, where, names, of_run, warmth = [], [], [], [], []
    for r, ((time, values, temperature), stretches) in enumerate(zip(runs, spans, strict=True)):
        for k, (start, end) in enumerate(stretches):
            inside = (time >= start) & (time <= end) & np.isfinite(values).all(axis=1)
            if not inside.any():
                continue
            samples.append(values[inside])
            where.append((start, end))
            number = f"{len(names) + 1}"
            names.append(f"{labels[r][k] if labels else number} ({start:.1f}–{end:.1f} s)")
            of_run.append(r)
            warmth.append(np.nan if temperature is None else np.nanmean(temperature[inside]))
    known = bool(warmth) and bool(np.isfinite(warmth).all())
    return Positions(
        tuple(samples),
        np.array(where).reshape(-1, 2),
        tuple(names),
        np.array(of_run, dtype=int),
        np.array(warmth) if known else None,
    )
