"""From a rest to its noise terms in one call, and what the curve says about averaging."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sensorbook.errors import Refusal
from sensorbook.estimate import Estimate
from sensorbook.noise.agreement import binned_variance, worst_departure
from sensorbook.noise.allan import AllanCurve, allan_deviation, as_columns, check_finite
from sensorbook.noise.cosine import CosineSpectrum, cosine_spectrum
from sensorbook.noise.covariance import variance_covariance
from sensorbook.noise.disturbances import (
    Calm,
    Periodic,
    Shock,
    Step,
    calmed,
    find_bands,
    take_out_lines,
)
from sensorbook.noise.estimate import confidence, fit_terms
from sensorbook.noise.lowpass import LowPass, low_pass_of
from sensorbook.noise.model import TERMS
from sensorbook.noise.result import AxisNoise, NoiseEstimate
from sensorbook.noise.whittle import REACH, fit_spectrum
from sensorbook.shared import shared

LEAST_EDF = 10.0  # a deviation with fewer degrees of freedom is uncertain by more than a quarter
LEAST_LEFT = 0.1  # share of the Allan variance that is left where periodic components are taken off


@dataclass(frozen=True, eq=False)
class Identified:
    """What a rest consists of.

    Attributes
    ----------
    fit : noise terms from the spectrum, by maximum likelihood, beside a Gauss–Markov process where the
        likelihood takes one; what a report states
    allan_fit : the same from a weighted fit of the Allan curve
    curve : Allan curve, shocks and steady lines taken out of the record first
    quiet : the same less what periodic bands add to it: what the Allan curve's fit sees
    spectrum : cosine spectrum of that record
    kept_out : for each axis (F,) mask of the spectrum's bins that are left out of the terms
    low_passes : for each axis, None where its floor is level
    calm : the record less its shocks and steps, and these
    periodic : for each axis, the strongest first
    """

    fit: NoiseEstimate
    allan_fit: NoiseEstimate
    curve: AllanCurve
    quiet: AllanCurve
    spectrum: CosineSpectrum
    kept_out: tuple[np.ndarray, ...]
    low_passes: tuple[LowPass | None, ...]
    calm: Calm
    periodic: tuple[tuple[Periodic, ...], ...]

    @property
    def shocks(self) -> tuple[Shock, ...]:
        """Stretches bridged, of all axes."""
        return self.calm.shocks

    @property
    def steps(self) -> tuple[tuple[Step, ...], ...]:
        """For each axis, sudden changes of its level."""
        return self.calm.steps

    def _repr_html_(self) -> str:
        return self.fit._repr_html_()


@shared
def identify_noise(values: np.ndarray, rate: float, sensor: str = "") -> Identified:
    """Noise terms of a rest; shocks, periodic components and the low-pass are kept from them.

    Parameters
    ----------
    values : (N, A) evenly sampled, SI
    rate : Hz
    sensor : its name, for units

    Raises
    ------
    Refusal
        fewer than 1000 samples, a constant axis, or a record that is no rest
    ValueError
        samples that are not finite
    """
    values = as_columns(values)
    # Too short, or not finite: said before the work begins.
    allan_deviation(values[:1000], rate)
    check_finite(values)
    for name, column in zip("xyz", values.T, strict=False):
        if np.ptp(column) == 0:
            raise Refusal(
                f"Axis {name} is constant: every sample is {column[0]:g}.",
                "Record again with the sensor running, at a finer resolution.",
            )
    rest = calmed(values, rate)
    calm = [take_out_lines(column, rate) for column in rest.values.T]
    record = np.stack([column for column, _ in calm], axis=1)
    spectrum, curve = cosine_spectrum(record, rate), allan_deviation(record, rate, sensor=sensor)
    if not curve.deviation.all():
        tau = curve.tau[np.flatnonzero((curve.deviation == 0).any(axis=1))[0]]
        raise Refusal(
            f"The record repeats itself: its Allan deviation is zero at τ = {tau:g} s. "
            "No sensor's noise does.",
            "Record the sensor itself, at a finer resolution.",
        )
    bands = [find_bands(spectrum, i) for i in range(record.shape[1])]
    kept_out = tuple(mask for mask, _ in bands)
    low_passes = tuple(low_pass_of(spectrum, i, ~mask) for i, mask in enumerate(kept_out))
    fit = fit_spectrum(spectrum, sensor, kept_out, low_passes, gauss_markov=True)
    parts = [
        _against_curve(curve, spectrum, i, axis, mask)
        for i, (axis, mask) in enumerate(zip(fit.axes, kept_out, strict=True))
    ]
    added = np.stack([part for _, part in parts], axis=1)
    least = LEAST_LEFT * curve.deviation**2
    quiet = replace(curve, deviation=np.sqrt(np.maximum(curve.deviation**2 - added, least)))
    return Identified(
        fit=replace(fit, axes=tuple(axis for axis, _ in parts)),
        allan_fit=fit_terms(quiet, low_passes),
        curve=curve,
        quiet=quiet,
        spectrum=spectrum,
        kept_out=kept_out,
        low_passes=low_passes,
        calm=rest,
        periodic=tuple(
            tuple(
                sorted([*lines, *_no_lobes(found, spectrum, i, axis)], key=lambda p: -p.amplitude)
            )
            for i, ((_, lines), (_, found), axis) in enumerate(
                zip(calm, bands, fit.axes, strict=True)
            )
        ),
    )


def _no_lobes(bands: list[Periodic], spectrum: CosineSpectrum, i: int, axis: AxisNoise):
    """The bands less those beyond the low-pass that lie below the floor: side lobes of a digital filter."""
    if not axis.low_pass:
        return bands
    f, floor = spectrum.frequency, axis.squares["random_walk"]
    top = REACH * axis.low_pass.cutoff

    def stands_out(p: Periodic) -> bool:
        inside = (f >= p.band[0]) & (f <= p.band[1])
        return p.band[0] < top or spectrum.density[inside, i].max(initial=0.0) > floor

    return [p for p in bands if stands_out(p)]


def _against_curve(
    curve: AllanCurve, spectrum: CosineSpectrum, i: int, axis: AxisNoise, mask: np.ndarray
) -> tuple[AxisNoise, np.ndarray]:
    """The axis's terms held against its Allan curve, and (T,) what its periodic bands add to that.

    Where the spectrum was not used, above the low-pass's reach and in the bands, it stands for itself.
    """
    f, power = spectrum.frequency, spectrum.density[:, i]
    step = 1 / spectrum.rate
    level = axis.spectrum(f, step)
    below = f <= REACH * axis.low_pass.cutoff if axis.low_pass else np.ones_like(mask)
    shaped = level * (axis.low_pass.power(f) if axis.low_pass else 1.0)
    excess = np.where(mask, power - shaped, 0.0)
    change = np.where(below, shaped, power) - level
    width = spectrum.lines * spectrum.rate / (2 * spectrum.samples)
    added = binned_variance(f, width, np.where(below, excess, 0.0), curve.clusters, spectrum.rate)
    terms = sum(v * TERMS[n].variance(curve.tau) for n, v in axis.squares.items())
    variance = axis.allan_variance(curve.tau) + added
    variance += binned_variance(f, width, change, curve.clusters, spectrum.rate)
    variance = np.maximum(variance, 1e-6 * curve.deviation[:, i] ** 2)
    covariance = variance_covariance(curve.clusters, curve.samples, curve.rate, axis.squares)
    share = np.diag(covariance) / terms**2
    misfit, _ = worst_departure(curve.tau, curve.deviation[:, i] ** 2, variance, share)
    edf, band = confidence(curve.deviation[:, i] ** 2, share)
    return replace(axis, misfit=misfit, edf=edf, band=band, variance=variance), added


def best_averaging(curve: AllanCurve, axis: AxisNoise, deviation: np.ndarray):
    """Where averaging has done what it can: cluster time (s), deviation there and what follows.

    What follows is "rises" where the curve climbs clear of it later, "falls" where the lowest point is
    the last one known well, else "level".

    Parameters
    ----------
    deviation : (T,) the axis's column of the curve
    """
    known = np.flatnonzero(axis.edf >= LEAST_EDF)
    at = int(known[np.argmin(deviation[known])])
    found = Estimate(float(deviation[at]), *map(float, axis.band[at]))
    rises = (axis.band[at:, 0] > found.high).any()
    follows = "rises" if rises else "falls" if at == known[-1] else "level"
    return float(curve.tau[at]), found, follows
