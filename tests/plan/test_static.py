"""Length of a rest: the bound against its definition, and against records that are fitted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve

from sensorbook.noise.cosine import cosine_spectrum
from sensorbook.noise.model import NoiseTerms
from sensorbook.noise.whittle import fit_spectrum
from sensorbook.plan.static import LENGTHS, LONGEST, expected_spectrum, hidden, rest, shortest

TERMS = ("random_walk", "bias_instability", "rate_random_walk")
VISIBLE = NoiseTerms(random_walk=0.003, bias_instability=0.002, rate_random_walk=3e-4)


def in_time(rng, samples: int, rate: float, terms: NoiseTerms) -> np.ndarray:
    """Noise sample by sample, nothing of it by a spectrum: the plan knows spectra alone."""
    step = np.arange(1, samples)
    h = np.concatenate([[1.0], np.cumprod((step - 0.5) / step)])
    white = terms.random_walk * np.sqrt(rate) * rng.standard_normal(samples)
    flicker = fftconvolve(terms.bias_instability * rng.standard_normal(samples), h)[:samples]
    walk = np.cumsum(terms.rate_random_walk / np.sqrt(rate) * rng.standard_normal(samples))
    return white + flicker + walk + terms.rate_ramp * np.arange(samples) / rate


def test_the_bound_is_that_of_every_single_line():
    samples, rate = 40_000, 20.0
    w = 2 * np.pi * np.arange(1, samples) * rate / (2 * samples)
    a = np.stack([np.ones_like(w), 1 / w, 1 / w**2], axis=1)
    squares = np.square([getattr(VISIBLE, t) for t in TERMS])
    share = a / (a @ squares)[:, None]
    expected = np.sqrt(np.diag(np.linalg.inv(share.T @ share / 2))) / 2 / squares
    found = [rest(VISIBLE, t, samples / rate, rate).std for t in TERMS]
    # The chapters know flicker noise's slowest lines better than their density does.
    assert found == pytest.approx(expected, rel=0.03)


def test_the_expected_spectrum_is_the_mean_of_many():
    rng = np.random.default_rng(1)
    terms = NoiseTerms(0.0, 0.01, 0.004, 1e-3, 2e-4)
    records = (in_time(rng, 2000, 10.0, terms) for _ in range(400))
    mean = np.mean([cosine_spectrum(r, 10.0).density[:, 0] for r in records], axis=0)
    expected = expected_spectrum(terms, 2000, 10.0)
    reached = cosine_spectrum(np.zeros(2000) + np.arange(2000) % 3, 10.0)
    assert expected.frequency == pytest.approx(reached.frequency, rel=1e-9)
    assert np.array_equal(expected.lines, reached.lines)
    assert expected.ramp_square == pytest.approx(reached.ramp_square, rel=0.2)
    scatter = np.sqrt(2 / expected.lines / 400)
    assert np.abs(mean / expected.density[:, 0] - 1).max() < 5 * scatter.max()
    assert np.sqrt(np.mean(((mean / expected.density[:, 0] - 1) / scatter) ** 2)) < 1.3


def test_estimates_scatter_as_predicted():
    seconds, rate = 2000.0, 10.0
    rng = np.random.default_rng(2)
    found = []
    for _ in range(30):
        values = in_time(rng, round(seconds * rate), rate, VISIBLE)
        squares = fit_spectrum(cosine_spectrum(values, rate)).axes[0].squares
        found.append([np.sqrt(squares[t]) / getattr(VISIBLE, t) for t in TERMS])
    error = np.sqrt(np.mean((np.array(found) - 1) ** 2, axis=0))
    predicted = np.array([rest(VISIBLE, t, seconds, rate).std for t in TERMS])
    ratio = error / predicted
    assert (ratio > 1 / 1.5).all(), ratio
    assert (ratio < 1.5).all(), ratio


def test_a_ramp_is_known_as_well_as_predicted():
    terms = NoiseTerms(random_walk=0.01, rate_ramp=2e-5)
    seconds, rate = 1000.0, 10.0
    rng = np.random.default_rng(3)
    slopes = [
        np.polyfit(np.arange(10_000) / rate, in_time(rng, 10_000, rate, terms), 1)[0]
        for _ in range(200)
    ]
    planned = rest(terms, "rate_ramp", seconds, rate)
    assert planned.std * planned.level == pytest.approx(np.std(slopes), rel=0.15)


def test_the_planned_rest_states_the_term_and_a_short_one_does_not():
    rate = 10.0
    planned = shortest(VISIBLE, "bias_instability", 0.15, rate)
    assert planned.seconds in LENGTHS
    assert planned.std <= 0.15
    assert planned.stated
    stated = {}
    for seconds in (planned.seconds, planned.seconds / 16):
        rng = np.random.default_rng(4)
        spectra = (
            cosine_spectrum(in_time(rng, round(seconds * rate), rate, VISIBLE), rate)
            for _ in range(12)
        )
        terms = [fit_spectrum(s).axes[0].terms["bias_instability"] for s in spectra]
        stated[seconds] = np.mean([t is not None for t in terms])
    assert stated[planned.seconds] >= 0.9
    assert stated[planned.seconds / 16] <= 0.6
    assert not rest(VISIBLE, "bias_instability", planned.seconds / 16, rate).stated


def test_the_shortest_length_is_the_first_that_serves():
    planned = shortest(VISIBLE, "bias_instability", 0.05, 100.0)
    before = LENGTHS[list(LENGTHS).index(planned.seconds) - 1]
    assert rest(VISIBLE, "bias_instability", float(before), 100.0).std > 0.05


def test_what_a_week_does_not_show_is_said_to_be_hidden():
    terms = NoiseTerms(random_walk=1e-3, bias_instability=1e-5, rate_random_walk=1e-5)
    assert shortest(terms, "bias_instability", 0.05, 100.0) is None
    # At its best B² of B² + 2 N K: half of the rest is N, half K.
    share = 100 * 1e-10 / (1e-10 + 2 * 1e-8)
    text = hidden(terms, "bias_instability", 100.0)
    assert text.startswith(f"B is {share:.2g} % of the noise's power")
    assert "N 50 %, K 50 %" in text or "K 50 %, N 50 %" in text
    slow = NoiseTerms(random_walk=1e-3, rate_random_walk=1e-6)
    assert shortest(slow, "rate_random_walk", 0.01, 100.0) is None
    assert "four times as long halves the error" in hidden(slow, "rate_random_walk", 100.0)
    halved = [rest(slow, "rate_random_walk", LONGEST / n, 100.0).std for n in (1, 4)]
    assert halved[1] / halved[0] == pytest.approx(2, rel=0.1)


def test_too_few_samples_state_nothing():
    loud = NoiseTerms(random_walk=1.0, bias_instability=1.0)
    assert not rest(loud, "random_walk", 900.0, 1.0).stated
    assert rest(loud, "random_walk", 1100.0, 1.0).stated
