"""A rest to its noise terms in one call, and what the curve says about averaging."""

import numpy as np
import pytest
from scipy import signal

from sensorbook.noise import best_averaging, identify_noise
from sensorbook.simulate.noise import coloured_noise


def test_the_low_pass_is_taken_into_account():
    # A digital filter on white noise; without its correlation time N would come out 2 % too small.
    rng = np.random.default_rng([91, 1])
    sos = signal.butter(2, 20.0, fs=100.0, output="sos")
    values = signal.sosfilt(sos, rng.standard_normal(360_000 + 2000))[2000:]
    found = identify_noise(values, 100.0, "gyroscope")
    assert found.low_passes[0].cutoff == pytest.approx(20.0, rel=0.05)
    n = found.fit["x"].terms["random_walk"]
    # Density of unit white noise at 100 Hz; known to some 0.5 % in an hour.
    assert n.value == pytest.approx(0.1, rel=0.015)
    assert n.low < 0.1 < n.high


@pytest.mark.parametrize(
    ("terms", "follows"),
    [
        ({"random_walk": 1.0, "rate_random_walk": 0.2}, {"rises"}),
        ({"random_walk": 1.0}, {"falls", "level"}),
        ({"random_walk": 1.0, "bias_instability": 1.0}, {"level", "falls"}),
    ],
)
def test_best_averaging(terms, follows):
    rng = np.random.default_rng([91, 2])
    found = identify_noise(coloured_noise(100_000, 10.0, rng, **terms), 10.0)
    tau, best, then = best_averaging(found.curve, found.fit["x"], found.curve.deviation[:, 0])
    assert then in follows
    assert best.low < best.value < best.high
    assert best.value == pytest.approx(found.curve.at(tau)[0], rel=1e-9)
    if then == "rises":
        # σ² = N²/τ + K²τ/3 is lowest at τ = √3 N/K = 8.7 s; the bottom is flat to an octave.
        assert 4 < tau < 18
