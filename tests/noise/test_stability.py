"""Modified, Hadamard and total deviation against published tables and an independent implementation."""

import allantools
import numpy as np
import pytest

from sensorbook import Refusal
from sensorbook.noise.stability import (
    hadamard_deviation,
    modified_allan_deviation,
    total_deviation,
)

from .test_allan import nbs14

ALL = [modified_allan_deviation, hadamard_deviation, total_deviation]


@pytest.mark.parametrize(
    ("function", "printed"),
    [
        (modified_allan_deviation, ["2.922319e-01", "6.172376e-02", "2.170921e-02"]),
        (hadamard_deviation, ["2.943883e-01", "9.581083e-02", "3.237638e-02"]),
        (total_deviation, ["2.922319e-01", "9.134743e-02", "3.406530e-02"]),
    ],
)
def test_nbs14_as_nist_sp_1065_prints_it(function, printed):
    curve = function(nbs14(), 1.0, [1, 10, 100])
    assert [f"{s:.6e}" for s in curve.deviation[:, 0]] == printed


@pytest.mark.parametrize("octave", ["", "_octave"])
def test_phase_dat_as_stable32_prints_it(real_data, octave):
    folder = real_data / "stable32"
    phase = np.loadtxt(folder / "PHASE.DAT")
    table = (folder / f"phase_dat_mdev{octave}.txt").read_text().splitlines()
    rows = [line.split() for line in table if line.strip() and not line.startswith("#")]
    assert len(rows) >= 8
    curve = modified_allan_deviation(phase, 1.0, [int(row[0]) for row in rows], phase=True)
    assert curve.terms.tolist() == [int(row[2]) for row in rows]
    assert [f"{s:.4e}" for s in curve.deviation[:, 0]] == [row[5] for row in rows]


@pytest.mark.parametrize("phase", [False, True])
@pytest.mark.parametrize(
    ("function", "reference"),
    [
        (modified_allan_deviation, allantools.mdev),
        (hadamard_deviation, allantools.ohdev),
        (total_deviation, allantools.totdev),
    ],
)
def test_agrees_with_allantools(function, reference, phase):
    rate, clusters = 25.0, np.array([1, 2, 3, 7, 10, 64, 250, 900])
    values = np.random.default_rng(67).normal(0.3, 2.0, 3000)
    if phase:
        values = np.cumsum(values) / rate
    kind = "phase" if phase else "freq"
    taus, expected, _, terms = reference(values, rate, kind, clusters / rate)
    curve = function(values, rate, clusters, phase=phase)
    np.testing.assert_allclose(curve.tau, taus, rtol=1e-12)
    # allantools integrates with the mean left in, and loses more digits than the tolerance has.
    np.testing.assert_allclose(curve.deviation[:, 0], expected, rtol=1e-9)
    np.testing.assert_array_equal(curve.terms, terms)


@pytest.mark.parametrize("function", ALL)
def test_axes_at_once_and_single_precision(function):
    values = np.random.default_rng(71).normal(size=(2000, 3)).astype(np.float32)
    curve = function(values, 10.0, sensor="gyroscope")
    assert (curve.sensor, curve.samples, curve.rate) == ("gyroscope", 2000, 10.0)
    for i, column in enumerate(values.T):
        alone = function(column.astype(float), 10.0).deviation[:, 0]
        # The mean over rows and that over a column round differently.
        np.testing.assert_allclose(curve.deviation[:, i], alone, rtol=1e-12)


def test_a_ramp_has_no_hadamard_deviation():
    ramp = 0.02 * np.arange(3000.0)
    # The integral reaches 2·10⁴, which leaves its third differences 10⁻¹¹.
    assert hadamard_deviation(ramp, 1.0).deviation.max() < 1e-10


def test_modified_deviation_of_quantisation_falls_as_the_power_of_3_2():
    rng = np.random.default_rng(73)
    values = np.diff(rng.standard_normal((20_001, 20)), axis=0)
    curve = modified_allan_deviation(values, 1.0, [4, 16, 64])
    mean = np.sqrt(np.mean(curve.deviation**2, axis=1))
    # σ² = 3 Q²/(τ³ δt) (SP 1065, white phase noise); of 20 axes with 20 000/64 degrees of freedom
    # each σ errs by 0.9 %, threefold.
    np.testing.assert_allclose(mean, np.sqrt(3 / curve.tau**3), rtol=0.03)


def test_bias_of_the_total_deviation():
    samples, records = 512, 4000
    white = np.random.default_rng(79).standard_normal((samples, records))
    for values, expected, bias in (
        (white, lambda m: 1 / m, 0.0),
        (np.cumsum(white, axis=0), lambda m: m / 3, 0.75),
    ):
        curve = total_deviation(values, 1.0, [64, 128, 256])
        found = np.mean(curve.deviation**2, axis=1) / expected(curve.tau)
        # At N/2 a single degree of freedom: 4000 records tell the mean to √(2/4000) = 2.2 %.
        np.testing.assert_allclose(found, 1 - bias * curve.clusters / samples, atol=3 * 0.022)


@pytest.mark.parametrize("function", [modified_allan_deviation, hadamard_deviation])
def test_three_clusters_must_fit(function):
    message = (
        "^cluster size 334 is outside 1 … 333: three clusters must fit into the record of 1000"
    )
    with pytest.raises(ValueError, match=message):
        function(np.zeros(1000), 1.0, [333, 334])


def test_two_clusters_must_fit():
    with pytest.raises(ValueError, match=r"^cluster size 501 is outside 1 … 500: two clusters"):
        total_deviation(np.zeros(1000), 1.0, [500, 501])


@pytest.mark.parametrize("function", ALL)
def test_bad_records(function):
    with pytest.raises(Refusal, match="has 999 samples"):
        function(np.zeros(999), 1.0)
    with pytest.raises(ValueError, match=r"^rate -1 Hz: give the sampling rate, above zero"):
        function(np.zeros(2000), -1.0)
    values = np.zeros(2000)
    values[3] = np.nan
    with pytest.raises(ValueError, match=r"not finite; .* \(the first is sample 3\)"):
        function(values, 1.0)
