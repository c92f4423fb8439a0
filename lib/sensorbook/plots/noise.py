"""Figures of the noise identification: spectrum, Allan curve and methods side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from scipy import stats

from sensorbook import units
from sensorbook.noise import Identified, NoiseEstimate
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.noise.whittle import REACH
from sensorbook.plots.allan import TERM_COLOURS, deviation_unit
from sensorbook.plots.style import (
    ACCENT,
    COLOURS,
    GREY,
    SECOND,
    THIRD,
    grid,
    log_log,
    new_axes,
    new_row,
)

LINES, WIDTH = 8, 0.08  # least lines in a point that is drawn, least width over its frequency
METHODS = {
    "read_off": "Allan curve, read off",
    "psd_read_off": "spectrum, read off",
    "allan_fit": "Allan curve, fitted",
    "whittle": "spectrum, likelihood",
}


def plot_spectrum_terms(identified: Identified, axis: str, axes: Axes | None = None) -> Axes:
    """The one-sided density of one axis with the terms found, their sum and what was left out."""
    axes = new_axes(axes)
    i, s = "xyz".index(axis), identified.spectrum
    found = identified.fit.axes[i]
    low_pass = found.low_pass
    sensor = identified.fit.sensor
    label, si = units.field_unit(sensor, "signal") if sensor else ("SI", 1.0)
    label, si = f"({label})²/Hz", si**2
    first = _points(s.frequency, s.lines)
    lines = np.add.reduceat(s.lines, first)
    f = np.add.reduceat(s.lines * s.frequency, first) / lines
    density = 2 * np.add.reduceat(s.lines * s.density[:, i], first) / lines / si
    limits = [density * lines / stats.chi2.ppf(q, lines) for q in (0.975, 0.025)]
    axes.fill_between(f, *limits, color=GREY, alpha=0.25, linewidth=0, label="95 % of the density")
    axes.plot(f, density, ".", color=GREY, markersize=4, label="measured")
    used = (s.frequency >= found.frequency_range[0]) & (s.frequency <= found.frequency_range[1])
    at = s.frequency[used]
    gain = low_pass.power(at) if low_pass else 1.0
    for name, term in TERMS.items():
        if found.terms[name] and name != "rate_ramp":
            alone = NoiseTerms(**{name: found.terms[name].value}).spectrum(at, 1 / s.rate)
            text = f"{term.symbol}: {name.replace('_', ' ')}"
            axes.plot(at, 2 * alone / si, "--", color=TERM_COLOURS[name], linewidth=1.2, label=text)
    if process := found.gauss_markov:
        alone = 2 * process.spectrum(at) / si
        axes.plot(at, alone, "-.", color=ACCENT, linewidth=1.2, label="Gauss–Markov process")
    total = 2 * gain * found.spectrum(at, 1 / s.rate) / si
    axes.plot(at, total, color="black", linewidth=1.5, label="sum of terms")
    for k, p in enumerate(q for q in identified.periodic[i] if not q.steady):
        text = "periodic, left out" if k == 0 else None
        axes.axvspan(*p.band, color=SECOND, alpha=0.3, linewidth=0, label=text)
    if low_pass:
        top = REACH * low_pass.cutoff
        axes.axvspan(
            top, s.rate / 2, color=THIRD, alpha=0.15, linewidth=0, label="low-pass, left out"
        )
    log_log(axes)
    axes.set_xlim(f[0] / 1.3, s.rate / 2)
    axes.set_ylim(0.3 * min(density.min(), total.min()), 6 * density.max())
    axes.set_xlabel("frequency f [Hz]")
    axes.set_ylabel(f"{axis}: one-sided density [{label}]")
    axes.legend(fontsize=7.5, ncols=2, loc="upper right")
    return axes


def _points(frequency: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """First bins of groups that are wide enough, and hold enough lines, to be a point of a figure."""
    first, count = [0], 0
    for k in range(len(lines)):
        wide = frequency[k] > (1 + WIDTH) * frequency[first[-1]]
        if wide and count >= LINES and k < len(lines) - 1:
            first.append(k)
            count = 0
        count += lines[k]
    return np.array(first)


def plot_agreement(identified: Identified, axis: str, axes: Axes | None = None) -> Axes:
    """The Allan curve of one axis with its band, and what the spectrum's terms make of it."""
    axes = new_axes(axes)
    i, curve = "xyz".index(axis), identified.curve
    found, tau = identified.fit.axes[i], curve.tau
    label, si = deviation_unit(curve.sensor)
    low, high = found.band.T / si
    axes.fill_between(
        tau, low, high, color=GREY, alpha=0.25, linewidth=0, label="95 % of the curve"
    )
    axes.plot(tau, curve.deviation[:, i] / si, "o", color=GREY, markersize=3, label="measured")
    alone = np.sqrt(found.allan_variance(tau)) / si
    axes.plot(tau, alone, ":", color=COLOURS[axis], linewidth=1.4, label="terms alone")
    explained = np.sqrt(found.variance) / si
    text = "terms, low-pass and periodic components"
    axes.plot(tau, explained, color="black", linewidth=1.5, label=text)
    log_log(axes)
    axes.set_xlim(tau[0] * 0.9, tau[-1] * 1.15)
    axes.set_ylim(0.5 * curve.deviation[:, i].min() / si, 2.5 * curve.deviation[:, i].max() / si)
    axes.set_xlabel("cluster time τ [s]")
    axes.set_ylabel(f"{axis}: Allan deviation σ [{label}]")
    axes.legend(fontsize=7.5)
    return axes


def plot_methods(
    estimates: Sequence[NoiseEstimate],
    truth: dict | None = None,
    axes: Sequence[Axes] | None = None,
) -> Sequence[Axes]:
    """N, B and K of every axis by each method with 95 % intervals; an arrow for an upper bound.

    `truth` : true SI coefficients by axis and term, where they are known.
    """
    terms = ("random_walk", "bias_instability", "rate_random_walk")
    axes = new_row(len(terms), width=9.0, height=4.2) if axes is None else axes
    names = [name for name, _ in zip("xyz", estimates[0].axes, strict=False)]
    colours = (SECOND, THIRD, "#009E73", "black")
    step = 0.8 / len(estimates)
    for term, a in zip(terms, axes, strict=True):
        label, si = units.field_unit(estimates[0].sensor, term)
        for k, (estimate, colour) in enumerate(zip(estimates, colours, strict=False)):
            for row, name in enumerate(names):
                y, e = row + step * (k - (len(estimates) - 1) / 2), estimate[name].terms[term]
                text = METHODS[estimate.method] if row == 0 else None
                if e:
                    x = np.array([e.value, e.low, e.high]) / si
                    a.plot(x[1:], [y, y], color=colour, linewidth=1.6)
                    a.plot(x[0], y, "o", color=colour, markersize=4, label=text)
                elif bound := estimate[name].upper_bounds.get(term):
                    a.plot([0, bound / si], [y, y], ":", color=colour, linewidth=1.2)
                    a.plot(bound / si, y, "<", color=colour, markersize=4, label=text)
        for row, name in enumerate(names if truth else ()):
            true = (truth[name][term] or 0.0) / si
            a.plot([true, true], [row - 0.45, row + 0.45], color="#D55E00", linewidth=1.2,
                   label="truth" if row == 0 else None)  # fmt: skip
        a.set_yticks(range(len(names)), names)
        a.set_ylim(len(names) - 0.5, -0.5)
        a.set_xlim(left=0)
        a.set_xlabel(f"{TERMS[term].symbol} [{label}]")
        grid(a)
    axes[0].set_ylabel("axis")
    handles = {}
    for a in axes:  # a method may state a value in one panel and a bound in another
        for handle, text in zip(*a.get_legend_handles_labels(), strict=True):
            handles.setdefault(text, handle)
    axes[0].figure.legend(
        handles.values(), handles.keys(), loc="outside upper center", ncols=5, fontsize=7.5
    )
    return axes
