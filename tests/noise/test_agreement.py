"""Spectrum to Allan variance in bins, and where a curve departs from a model."""

import numpy as np
import pytest

from sensorbook.noise import variance_from_spectrum
from sensorbook.noise.agreement import binned_variance, departures, worst_departure
from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.model import TERMS, NoiseTerms

RATE, SAMPLES = 100.0, 100_000
BINS = cosine_spectrum(np.random.default_rng([85, 0]).standard_normal(SAMPLES), RATE)
WIDTH = BINS.lines * RATE / (2 * SAMPLES)
CLUSTERS = np.array([1, 2, 3, 10, 77, 1000])


def binned(density, clusters=CLUSTERS):
    return binned_variance(BINS.frequency, WIDTH, density, clusters, RATE)


# ---- the curve of a binned spectrum ----


def test_against_closed_forms():
    # Q² and N² have theirs in the sampled kernel: 3Q²/τ² and N²/τ.
    tau = CLUSTERS / RATE
    for name in ("quantization", "random_walk"):
        model = NoiseTerms(**{name: 0.7})
        found = binned(model.spectrum(BINS.frequency, 1 / RATE))
        np.testing.assert_allclose(found, 0.49 * TERMS[name].variance(tau), rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("quantization", 1e-4), ("random_walk", 1e-4), ("bias_instability", 1e-3), ("rate_random_walk", 5e-3)],
)  # fmt: skip
def test_against_quadrature(name, tolerance):
    # The mean of sin⁴ over a bin is exact, the fall of the density within it is not taken: as (1/2j)²
    # for the line j = T/τ that governs. The walk lacks what lies below half a line, too.
    model = NoiseTerms(**{name: 1.0})
    density = model.spectrum(BINS.frequency, 1 / RATE)
    for clusters, allowed in ((CLUSTERS, tolerance), (np.array([5000, 20_000]), 0.08)):
        expected = [
            variance_from_spectrum(lambda f: model.spectrum(f, 1 / RATE), n / RATE, 1 / RATE)
            for n in clusters
        ]
        np.testing.assert_allclose(binned(density, clusters), expected, rtol=allowed)


def test_a_line_has_its_own_allan_variance():
    # A sinusoid of amplitude A at f: A² sin⁴(πfnδt)/(n sin πfδt)², whatever its phase on average.
    k, amplitude = 437, 0.3
    f = BINS.frequency[k]
    density = np.zeros(len(WIDTH))
    density[k] = amplitude**2 / (4 * WIDTH[k])
    clusters = np.array([1, 2, 5, 11])
    expected = amplitude**2 * np.sin(np.pi * f * clusters / RATE) ** 4
    expected /= (clusters * np.sin(np.pi * f / RATE)) ** 2
    # Within a bin of a hundredth of f the phase πfnδt changes by a hundredth of itself.
    np.testing.assert_allclose(binned(density, clusters), expected, rtol=2e-3)


def test_bins_wider_than_a_turn_of_the_kernel():
    # Five bins to Nyquist, clusters of 5000 samples: hundreds of turns in each.
    edges = np.linspace(0, RATE / 2, 6)
    centre, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    found = binned_variance(centre, width, np.ones(5), np.array([5000]), RATE)
    f = (np.arange(2_000_000) + 0.5) * RATE / 4e6
    at = centre[np.minimum((f / width[0]).astype(int), 4)]
    kernel = np.sin(np.pi * f * 50) ** 4 / (5000 * np.sin(np.pi * at / RATE)) ** 2
    assert found[0] == pytest.approx(4 * kernel.sum() * RATE / 4e6, rel=1e-6)


def test_low_frequencies_keep_their_digits():
    # πfτ = 1e-6: sin⁴ is the fourth power, of which the difference of integrals has no digits.
    f, width = np.array([1e-6 / np.pi]), np.array([1e-9])
    found = binned_variance(f, width, np.ones(1), np.array([100]), RATE)
    expected = 4 * 1e-9 * 1e-24 / (100 * np.sin(1e-6 / 100)) ** 2
    assert found[0] == pytest.approx(expected, rel=1e-9)


def test_across_the_change_of_formula():
    # Below and above the argument at which the power series takes over.
    for x in (0.0098, 0.0102):
        f = np.array([x / np.pi])
        found = binned_variance(f, 0.01 * f, np.ones(1), np.array([100]), RATE)
        expected = 4 * 0.01 * f * np.sin(x) ** 4 / (100 * np.sin(x / 100)) ** 2
        # The mean of x⁴ over one per cent lies 2e-5·… above that of its centre; (2/3)x² is the series.
        assert found[0] == pytest.approx(expected[0], rel=2e-4)


# ---- departures ----

TAU = 2.0 ** np.arange(0, 12, 0.5)
MODEL = 1 / TAU


def test_no_departure():
    assert worst_departure(TAU, MODEL, MODEL, np.full(len(TAU), 0.01))[0] is None


def test_departures_are_significant_and_visible():
    share = np.full(len(TAU), 1e-6)
    for size, told in ((0.04, False), (0.06, True)):
        observed = MODEL * np.where(np.arange(len(TAU)) == 9, (1 + size) ** 2, 1.0)
        found, missed = worst_departure(TAU, observed, MODEL, share)
        assert (found is not None) == told
        assert (missed > 0).sum() == told
    # The same of a deviation that is known to 5 %: one standard error.
    assert worst_departure(TAU, observed, MODEL, np.full(len(TAU), 0.01))[0] is None


def test_the_worst_departure_is_told_with_its_stretch():
    factor = np.ones(len(TAU))
    factor[4:9] = 1.2, 1.3, 1.5, 1.3, 1.2
    factor[15] = 1.3
    found, missed = worst_departure(TAU, MODEL * factor**2, MODEL, np.full(len(TAU), 1e-3))
    assert found.tau_range == (TAU[4], TAU[8])
    assert found.tau == TAU[6]
    assert found.size == pytest.approx(0.5)
    np.testing.assert_allclose(missed[4:9], factor[4:9] - 1)
    assert missed[:4].sum() + missed[9:].sum() == 0


def test_what_is_told_is_not_told_again():
    factor = np.ones(len(TAU))
    factor[4:6], factor[15] = 1.5, 1.3
    told = np.zeros(len(TAU), dtype=bool)
    told[4:6] = True
    found, _ = worst_departure(TAU, MODEL * factor**2, MODEL, np.full(len(TAU), 1e-3), told)
    assert found.tau_range == (TAU[15], TAU[15])


def test_what_lifts_the_curve_comes_before_what_lies_below():
    factor = np.ones(len(TAU))
    factor[2:5], factor[15] = 0.5, 1.3
    share = np.full(len(TAU), 1e-3)
    assert worst_departure(TAU, MODEL * factor**2, MODEL, share)[0].tau == TAU[15]
    factor[15] = 1.0
    below, _ = worst_departure(TAU, MODEL * factor**2, MODEL, share)
    assert below.tau_range == (TAU[2], TAU[4])
    assert below.size == pytest.approx(-0.5)


# ---- outside the band ----


def band_of(deviation, reach=0.1):
    return np.stack([(1 - reach) * deviation, (1 + reach) * deviation], axis=1)


def test_nothing_outside():
    deviation = np.sqrt(MODEL)
    assert departures(TAU, band_of(deviation), deviation, 1.09 * deviation) == ()


def test_stretches_of_an_octave_and_more_are_told():
    deviation = np.sqrt(MODEL)
    model = deviation.copy()
    model[3:5] *= 1.5  # half an octave
    model[8:11] *= 0.8, 0.5, 0.8  # an octave
    model[15:20] *= 1.25
    found = departures(TAU, band_of(deviation), deviation, model)
    assert [m.tau_range for m in found] == [(TAU[8], TAU[10]), (TAU[15], TAU[19])]
    assert [m.size for m in found] == pytest.approx([1.0, -0.2])
    assert found[0].tau == TAU[9]


def test_a_band_that_is_not_known_tells_nothing():
    deviation = np.sqrt(MODEL)
    band = np.full((len(TAU), 2), np.nan)
    assert departures(TAU, band, deviation, 5 * deviation) == ()
