"""Kalibr's imu.yaml (Kalibr wiki, "IMU Noise Model" and "Yaml formats").

The file is ASCII throughout: Kalibr opens it in the encoding of its container, often the C locale's.
"""

from __future__ import annotations

from sensorbook.export.noise import (
    SENSORS,
    named,
    noise_of,
    provenance,
    rate_of,
    strength,
)
from sensorbook.export.source import Attempts, Entry, yaml_number
from sensorbook.noise.discrete import discrete_values
from sensorbook.noise.model import NoiseTerms
from sensorbook.units import si_unit

KEYS = {  # key of imu.yaml: our term, its discrete formula
    "noise_density": ("random_walk", "sigma_d = sigma/sqrt(dt)"),
    "random_walk": ("rate_random_walk", "sigma_bd = sigma_b*sqrt(dt)"),
}
HEAD = """\
# imu.yaml of {target}, written by sensorbook. Device: {device}
{provenance}
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
{about}
rostopic: {topic}  # not known here: change it to your topic
# Static recordings: {rates}. The highest stands here: change it to your topic's rate.
update_rate: {rate}  # Hz
"""
PART = """
# {axes}
# Per sample at {rate} Hz: {formula} = {discrete:.4g} {unit_d}
{key}: {value}  # {unit}; {what}
"""


def render(results: Entry) -> str:
    """imu.yaml; raises `InputError` with everything it needs and the results do not give."""
    return imu_yaml(results, "Kalibr", "/imu0")


def imu_yaml(results: Entry, target: str, topic: str, about: str = "") -> str:
    """The file as `target` writes or reads it, with lines of comment of its own, `about`."""
    attempt, rates, found = Attempts(), {}, {}
    device, origin = attempt(named, results), attempt(provenance, results)
    for sensor in SENSORS:
        mend = f"{target} needs both sensors: record a rest of the {sensor} and render its report"
        if noise := attempt(noise_of, results, sensor, mend):
            rates[sensor] = attempt(rate_of, results, sensor)
            for key, (term, _) in KEYS.items():
                found[sensor, key] = attempt(strength, noise, sensor, term, target)
    attempt.end()
    rate = max(rates.values())
    text = HEAD.format(
        target=target,
        device=device,
        provenance=origin,
        about=about,
        topic=topic,
        rates=", ".join(f"{sensor} {value:.10g} Hz" for sensor, value in rates.items()),
        rate=yaml_number(rate),
    )
    for (sensor, key), one in found.items():
        term, formula = KEYS[key]
        text += PART.format(
            axes=one.axes,
            rate=f"{rate:.10g}",
            formula=formula,
            discrete=discrete_values(NoiseTerms(**{term: one.value}), rate)[term],
            unit_d=si_unit(sensor),
            key=f"{sensor}_{key}",
            value=yaml_number(one.value),
            unit=si_unit(sensor, term),
            what=one.what,
        )
    return text
