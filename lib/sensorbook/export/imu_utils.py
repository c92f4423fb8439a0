"""The parameters that imu_utils writes, <name>_imu_param.yaml, as OpenCV's FileStorage has them.

Source: gaowenliang/imu_utils, src/imu_an.cpp (`writeYAML`), src/gyr_lib/fitallan_gyr.cpp and
src/acc_lib/fitallan_acc.cpp (`getWhiteNoise`, `getBiasInstability`).
"""

from __future__ import annotations

import json
import math

import numpy as np

from sensorbook.export.calibration import inert, part_of
from sensorbook.export.noise import (
    named,
    noise_of,
    provenance,
    rate_of,
    visible,
)
from sensorbook.export.source import Attempts, Entry, yaml_number
from sensorbook.noise.discrete import discrete_values
from sensorbook.noise.model import TERMS, NoiseTerms
from sensorbook.units import si_unit

TARGET = "imu_utils"
PARTS = {"gyroscope": ("Gyr", "gyr"), "accelerometer": ("Acc", "acc")}
HEAD = """\
%YAML:1.0
---
# Parameters as imu_utils writes them, written by sensorbook. Device: {device}
{provenance}
#
# gyr_n, acc_n: standard deviation of the white noise of one sample, N sqrt(rate), in rad/s and m/s^2,
#   with N of the two-sided spectrum (random_walk in results.json) and the rate of the rest. They are
#   not per sqrt(Hz), whatever imu_utils' own README says: what wants a continuous-time noise density
#   (Kalibr, VINS) is to be given N, which stands in the comments, or gyr_n/sqrt(rate).
#   imu_utils computes sqrt(rate) times the whole Allan deviation at 1 s: the same number where white
#   noise alone is there at 1 s, and more where other noise is.
# gyr_w, acc_w: smallest Allan deviation, in rad/s and m/s^2, of the noise terms found, among the cluster
#   times of the Allan curve. It is the level of the bias instability (0.664 B where its flat is seen),
#   not a random walk of the bias, as which it is often used: that is K, in the comments, in rad/s^2/sqrt(Hz)
#   and m/s^3/sqrt(Hz). imu_utils takes the smallest of the curve that it has fitted.
# avg-axis: mean of the three axes, as in imu_utils.
type: IMU
name: {name}
"""


def render(results: Entry) -> str:
    """The file; raises `InputError` with everything it needs and the results do not give."""
    attempt = Attempts()
    device, origin = attempt(named, results), attempt(provenance, results)
    lines = []
    for sensor in PARTS:
        lines += attempt(_part, results, sensor) or []
    attempt.end()
    name = json.dumps(inert(results.at("device", "id").text()))
    return HEAD.format(device=device, provenance=origin, name=name) + "\n".join(lines) + "\n"


def _part(results: Entry, sensor: str) -> list[str]:
    attempt, (title, key) = Attempts(), PARTS[sensor]
    mend = f"{TARGET} needs both sensors: record a rest of the {sensor} and render its report"
    noise = attempt(noise_of, results, sensor, mend)
    tau = attempt(_cluster_times, results, sensor, mend)
    rate = attempt(rate_of, results, sensor) if noise else None
    attempt.end()
    numbers = {axis: attempt(_axis, noise, sensor, axis, rate, tau) for axis in "xyz"}
    attempt.end()
    lines = [f"{title}:", f'   unit: " {si_unit(sensor)}"']
    mean = [math.fsum(pair[i] for pair, _ in numbers.values()) / 3 for i in (0, 1)]
    for axis, (pair, comment) in {"avg": (mean, f"rate {rate:.10g} Hz"), **numbers}.items():
        lines += [f"   {axis}-axis:", f"      # {comment}"]
        lines += [
            f"      {key}_{letter}: {yaml_number(value)}"
            for letter, value in zip("nw", pair, strict=True)
        ]
    return lines


def _cluster_times(results: Entry, sensor: str, mend: str) -> np.ndarray:
    curve = part_of(results, sensor, "allan", mend)
    tau = np.array([entry.magnitude() for entry in curve.at("tau").items()])
    if len(tau) == 0 or tau.min() == 0:
        raise curve.at("tau").wrong("holds no cluster times above 0")
    return tau


def _axis(noise: Entry, sensor: str, axis: str, rate: float, tau: np.ndarray):
    """The two numbers of an axis, and what they are made of."""
    found = {
        term: value
        for term in TERMS
        if (value := visible(noise, sensor, term, axis)) is not None and value > 0
    }
    if "random_walk" not in found:
        raise noise.at(axis).wrong(
            f"random_walk is not visible, and {TARGET} needs a number above 0",
            f"record a longer rest of the {sensor} and render its report",
        )
    deviation = np.sqrt(NoiseTerms(**found).allan_variance(tau))
    at = int(np.argmin(deviation))
    told = [
        f"{TERMS[term].symbol} {value:.6g} {si_unit(sensor, term)}" for term, value in found.items()
    ]
    last = "" if at < len(tau) - 1 else ", the longest: the level itself may be lower"
    comment = f"{', '.join(told)}; smallest at {tau[at]:.4g} s{last}"
    sample = discrete_values(NoiseTerms(**found), rate)["random_walk"]
    return (sample, float(deviation[at])), comment
