"""Stochastic errors: Allan deviation, noise terms and their estimation."""

from sensorbook.noise.allan import AllanCurve, allan_deviation, cluster_sizes
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.identify import Identified, best_averaging, identify_noise
from sensorbook.noise.lowpass import LowPass, find_low_pass
from sensorbook.noise.model import TERMS, NoiseTerms, variance_from_spectrum
from sensorbook.noise.result import NoiseEstimate
from sensorbook.noise.ruler import read_off
from sensorbook.noise.truth import against_truth

__all__ = [
    "TERMS",
    "AllanCurve",
    "Identified",
    "LowPass",
    "NoiseEstimate",
    "NoiseTerms",
    "against_truth",
    "allan_deviation",
    "best_averaging",
    "cluster_sizes",
    "find_low_pass",
    "fit_terms",
    "identify_noise",
    "read_off",
    "variance_from_spectrum",
]
