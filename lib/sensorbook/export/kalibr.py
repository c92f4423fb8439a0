"""Kalibr's imu.yaml (Kalibr wiki, "IMU Noise Model" and "Yaml formats").

The file is ASCII throughout: Kalibr opens it in the encoding of its container, often the C locale's.
"""

from __future__ import annotations

from dataclasses import dataclass

from sensorbook.errors import InputError
from sensorbook.export.source import Entry, yaml_number
from sensorbook.noise.discrete import discrete_values
from sensorbook.noise.model import NoiseTerms
from sensorbook.units import si_unit

SENSORS = ("accelerometer", "gyroscope")
KEYS = {  # key of imu.yaml: our term, its discrete formula
    "noise_density": ("random_walk", "sigma_d = sigma/sqrt(dt)"),
    "random_walk": ("rate_random_walk", "sigma_bd = sigma_b*sqrt(dt)"),
}
HEAD = """\
# imu.yaml of Kalibr, written by sensorbook. Device: {device}
#
# noise_density, sigma: N of the two-sided spectrum (random_walk in results.json), as Kalibr's model
#   E[n(t1) n(t2)] = sigma^2 delta(t1 - t2) has it. It is not the one-sided noise density, sqrt(2) N,
#   of datasheets and spectrum analysers.
# random_walk, sigma_b: K of the two-sided spectrum (rate_random_walk in results.json).
# Both are continuous-time values, which belong to the sensor. Discrete ones, with dt = 1/update_rate:
#   sigma_d = sigma/sqrt(dt), the noise of a sample, which Kalibr derives itself. It holds for noise
#   filtered at half the rate: a sensor of lower bandwidth scatters less.
#   sigma_bd = sigma_b*sqrt(dt), a step of the bias.
# Kalibr takes one number for three axes: the largest. Intervals are 95 %.
# The values are those of a rest: Kalibr's wiki advises larger ones for low-cost sensors in motion.

rostopic: /imu0  # not known here: change it to your topic
# Static recordings: {rates}. The highest stands here: change it to your topic's rate.
update_rate: {rate}  # Hz
"""
PART = """
# {axes}
# Per sample at {rate} Hz: {formula} = {discrete:.4g} {unit_d}
{key}: {value}  # {unit}; {what}
"""


@dataclass(frozen=True)
class _Strength:
    """One number for three axes: `what` it is, and what `axes` have."""

    value: float
    what: str
    axes: str


def render(results: Entry) -> str:
    """imu.yaml; raises `InputError` with everything it needs and the results do not give."""
    problems, rates, found = [], {}, {}

    def attempt(make, *arguments):
        try:
            return make(*arguments)
        except InputError as error:
            problems.extend(error.problems)

    device = attempt(_device, results)
    for sensor in SENSORS:
        if noise := attempt(_noise, results, sensor):
            rates[sensor] = attempt(_rate, results, sensor)
            for key, (term, _) in KEYS.items():
                found[sensor, key] = attempt(_strength, noise, sensor, term)
    if problems:
        raise InputError(*dict.fromkeys(problems))
    rate = max(rates.values())
    text = HEAD.format(
        device=device,
        rates=", ".join(f"{sensor} {value:.10g} Hz" for sensor, value in rates.items()),
        rate=yaml_number(rate),
    )
    for (sensor, key), strength in found.items():
        term, formula = KEYS[key]
        text += PART.format(
            axes=strength.axes,
            rate=f"{rate:.10g}",
            formula=formula,
            discrete=discrete_values(NoiseTerms(**{term: strength.value}), rate)[term],
            unit_d=si_unit(sensor),
            key=f"{sensor}_{key}",
            value=yaml_number(strength.value),
            unit=si_unit(sensor, term),
            what=strength.what,
        )
    return text


def _device(results: Entry) -> str:
    """Identifier and name, inert: a name may hold line breaks and anything else."""
    device = results.at("device")
    return f"{device.at('id').text()!a} ({device.at('name').text()!a})"


def _noise(results: Entry, sensor: str) -> Entry:
    mend = f"Kalibr needs both sensors: record a rest of the {sensor} and render its report"
    noise = results.at("sensors", sensor, "noise", mend=mend)
    if (reason := noise.get("reason")).value is not None:
        raise noise.wrong(f"was refused: {reason.text()}", mend)
    return noise


def _rate(results: Entry, sensor: str) -> float:
    """Rate of the sensor's longest static recording, the one whose noise is stated, Hz."""
    recordings = results.at("inputs").items()
    here = (sensor, "static")
    rests = [r for r in recordings if (r.at("sensor").value, r.at("kind").value) == here]
    if not rests:
        raise results.at("inputs").wrong(f"no static recording of the {sensor}")
    longest = max(rests, key=lambda rest: rest.at("duration_s").magnitude())
    rate = longest.at("rate_hz")
    if rate.magnitude() == 0:
        raise rate.wrong("0 is not a rate")
    return rate.magnitude()


def _strength(noise: Entry, sensor: str, term: str) -> _Strength:
    """The largest of the axes where the term is visible, or else of its upper bounds."""
    values, bounds, axes = {}, {}, []
    for axis in "xyz":
        estimate = noise.at(axis, term)
        bound = noise.at(axis).get("upper_bounds").get(term)
        if estimate.value is not None:
            unit = estimate.at("unit")
            if unit.text() != si_unit(sensor, term):
                raise unit.wrong(f"{unit.value!r} is not {si_unit(sensor, term)!r}")
            values[axis] = estimate.at("value").magnitude()
            low, high = (estimate.at(end).magnitude() for end in ("low", "high"))
            axes.append(f"{axis} {values[axis]:.4g} ({low:.4g} ... {high:.4g})")
        elif bound.value is not None:
            bounds[axis] = bound.magnitude()
            axes.append(f"{axis} not visible (below {bounds[axis]:.4g})")
        else:
            axes.append(f"{axis} not visible")
    known = values or bounds
    if not any(known.values()):
        raise noise.wrong(
            f"{term} is neither visible nor bounded on any axis, and Kalibr needs a number above 0",
            f"record a longer rest of the {sensor} and render its report",
        )
    axis = max(known, key=known.get)
    what = f"axis {axis}" if values else f"not visible: 95 % upper bound, axis {axis}"
    return _Strength(known[axis], what, ", ".join(axes))
