"""Stochastic errors: Allan deviation, power spectra, noise terms and their estimation."""

from sensorbook.noise.allan import AllanCurve, allan_deviation, cluster_sizes
from sensorbook.noise.allan_stream import allan_deviation_of_chunks, in_chunks, parquet_chunks
from sensorbook.noise.confidence import confidence_limits
from sensorbook.noise.discrete import discrete_values, per_sample
from sensorbook.noise.estimate import fit_terms
from sensorbook.noise.identify import Identified, best_averaging, identify_noise
from sensorbook.noise.lowpass import LowPass, find_low_pass
from sensorbook.noise.model import TERMS, NoiseTerms, variance_from_spectrum
from sensorbook.noise.psd import PowerSpectrum, average_frequencies, periodogram, welch
from sensorbook.noise.result import NoiseEstimate
from sensorbook.noise.ruler import read_off
from sensorbook.noise.stability import (
    hadamard_deviation,
    modified_allan_deviation,
    total_deviation,
)
from sensorbook.noise.truth import against_truth

__all__ = [
    "TERMS",
    "AllanCurve",
    "Identified",
    "LowPass",
    "NoiseEstimate",
    "NoiseTerms",
    "PowerSpectrum",
    "against_truth",
    "allan_deviation",
    "allan_deviation_of_chunks",
    "average_frequencies",
    "best_averaging",
    "cluster_sizes",
    "confidence_limits",
    "discrete_values",
    "find_low_pass",
    "fit_terms",
    "hadamard_deviation",
    "identify_noise",
    "in_chunks",
    "modified_allan_deviation",
    "parquet_chunks",
    "per_sample",
    "periodogram",
    "read_off",
    "total_deviation",
    "variance_from_spectrum",
    "welch",
]
