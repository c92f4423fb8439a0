"""Shaping filters against exact densities, scipy's frequency response and what they simulate."""

import numpy as np
import pytest
from scipy import optimize, signal

from sensorbook.noise.psd import average_frequencies, periodogram
from sensorbook.noise.shaping import ShapingFilter, shaping_filter

RATE = 20.0
FREQUENCY = np.geomspace(1e-4, 2.0, 160)  # four decades and more, up to a fifth of Nyquist

DENSITIES = {
    "white": np.full_like(FREQUENCY, 3e-6),
    "flicker": 1 / FREQUENCY,
    "random walk": 1 / FREQUENCY**2,
    "all three": 1 + 0.1 / FREQUENCY + 1e-4 / FREQUENCY**2,
    "first-order Gauss–Markov": 1e-12 / (1 + (FREQUENCY / 0.01) ** 2),
}


@pytest.mark.parametrize("name", DENSITIES)
def test_density_is_followed(name):
    density = DENSITIES[name]
    found = shaping_filter(FREQUENCY, density, RATE)
    # The poles stand on a grid: a process between two of its six a decade is followed to 3.3 %. Of slope −2
    # ω² differs from the sampled u by (πf/rate)²/3 = 3.3 % at the highest frequency.
    tolerance = {"white": 1e-9, "flicker": 0.001, "all three": 0.001}.get(name, 0.034)
    np.testing.assert_allclose(found.density(FREQUENCY), density, rtol=tolerance)
    assert found.scatter < 0.03


def test_measured_flicker_over_four_decades_needs_few_poles():
    dof = np.full(160, 50.0)
    measured = np.random.default_rng(30).chisquare(50, 160) / 50 / FREQUENCY
    found = shaping_filter(FREQUENCY, measured, RATE, dof)
    # Points are known to 20 %, some 15 of them to a pole: 5 %.
    np.testing.assert_allclose(found.density(FREQUENCY) * FREQUENCY, 1, rtol=3 * 0.05)
    assert np.mean(found.density(FREQUENCY) * FREQUENCY) == pytest.approx(1, abs=4 * 0.2 / 160**0.5)
    assert len(found.poles) <= 12


def test_white_noise_needs_no_pole():
    found = shaping_filter(FREQUENCY, DENSITIES["white"], RATE)
    assert (len(found.poles), len(found.zeros)) == (0, 0)
    assert found.std == pytest.approx(np.sqrt(3e-6 * RATE), rel=1e-9)
    np.testing.assert_allclose(found.density([1e-9, 1.0, RATE / 2]), 3e-6, rtol=1e-9)
    made = found.simulate(100_000, np.random.default_rng(31))
    assert made.std() == pytest.approx(found.std, rel=4 / np.sqrt(200_000))


def test_a_sum_of_first_order_processes_comes_back():
    """Two Gauss–Markov processes with white noise, each exactly as sampled."""
    u = 4 * np.sin(np.pi * FREQUENCY / RATE) ** 2
    a = np.array([0.999, 0.9])
    density = 1.0 + (np.array([4e-4, 0.5]) / ((1 - a) ** 2 + a * u[:, None])).sum(axis=1)
    found = shaping_filter(FREQUENCY, density, RATE)
    # Poles stand on a grid of their own, but neighbours share out what lies between: 1.3 %.
    np.testing.assert_allclose(found.density(FREQUENCY), density, rtol=0.02)


@pytest.mark.parametrize("name", DENSITIES)
def test_minimum_phase_and_interlaced(name):
    found = shaping_filter(FREQUENCY, DENSITIES[name], RATE)
    assert ((found.poles > 0) & (found.poles < 1)).all()
    assert ((found.zeros > 0) & (found.zeros < 1)).all()
    assert len(found.zeros) in (len(found.poles), len(found.poles) - 1)
    together = np.sort(np.concatenate([found.poles, found.zeros]))[::-1]
    assert set(together[::2]) == set(found.poles), "from the slowest on, poles and zeros take turns"
    time = found.time_constants
    np.testing.assert_allclose(np.exp(-1 / (RATE * time)), found.poles, rtol=1e-12)


def test_six_decades():
    f = np.geomspace(1e-6, 10.0, 300)
    density = 1 + 1e-2 / f + 1e-7 / f**2
    found = shaping_filter(f, density, 100.0)
    np.testing.assert_allclose(found.density(f), density, rtol=0.01)
    # 1 − pole is 6e-9 for the slowest: the sections keep it.
    h = signal.sosfreqz(found.sections, 2 * np.pi * f / 100.0)[1]
    np.testing.assert_allclose(found.std**2 / 100 * abs(h) ** 2, found.density(f), rtol=1e-5)


@pytest.mark.parametrize("name", DENSITIES)
def test_sections_have_the_density(name):
    found = shaping_filter(FREQUENCY, DENSITIES[name], RATE)
    f = np.geomspace(1e-4, RATE / 2, 50)
    h = signal.sosfreqz(found.sections, 2 * np.pi * f / RATE)[1]
    np.testing.assert_allclose(found.std**2 / RATE * abs(h) ** 2, found.density(f), rtol=1e-6)


# ---- what it simulates ----


@pytest.mark.parametrize("name", ["flicker", "all three", "first-order Gauss–Markov"])
def test_simulated_noise_has_the_density(name):
    found = shaping_filter(FREQUENCY, DENSITIES[name], RATE)
    rng = np.random.default_rng(32)
    made = np.column_stack([found.simulate(20_000, rng) for _ in range(30)])
    spectrum = average_frequencies(periodogram(made, RATE, taper=True))
    # The lowest lines of slope −2 keep some percent of what leaks from the ends (test_psd).
    part = slice(8, None)
    mean = spectrum.density[part].mean(axis=1) / 2 / found.density(spectrum.frequency[part])
    z = (mean - 1) * np.sqrt(30 * spectrum.dof[part] / 2)
    # Some 150 points: |z| beyond 4 has a chance of 1 %; the rms of z is 1 to within 4/√300.
    assert abs(z).max() < 4.2
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.23)


def test_simulated_noise_is_stationary_from_its_first_sample_on():
    """A process of 1000 s, seen for 5 s: its variance is there at once."""
    density = 1 / (1 + (2 * np.pi * FREQUENCY * 1000.0) ** 2)
    found = shaping_filter(FREQUENCY, density, RATE)
    rng = np.random.default_rng(33)
    made = np.array([found.simulate(100, rng) for _ in range(2000)])
    # Over both sides; 2000 draws know a variance to √(2/2000) = 3.2 %.
    f = np.geomspace(1e-8, RATE / 2, 20_000)
    variance = 2 * np.trapezoid(found.density(f), f)
    assert variance == pytest.approx(1 / 2000, rel=0.1), "∫S df = 1/(2·1000 s)"
    for at in (0, 99):
        assert made[:, at].var() == pytest.approx(variance, rel=4 * 0.032)


def test_the_same_seed_gives_the_same_noise():
    found = shaping_filter(FREQUENCY, DENSITIES["all three"], RATE)
    one, two = (found.simulate(500, np.random.default_rng(34)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


# ---- measured densities ----


def test_scattered_points_do_not_bias_the_fit():
    f = np.arange(1, 4001) / 4000 * RATE / 2
    rng = np.random.default_rng(35)
    levels, scatters = [], []
    for _ in range(20):
        found = shaping_filter(f, 2.0 * rng.exponential(size=4000), RATE)
        levels.append(found.density(f[1000:]).mean())
        scatters.append(found.scatter)
    # The level m of exponential x solves E[ψ(x/m − 1)] = 0 with ψ(r) = r up to 3 and 9/r beyond.
    x = np.linspace(0, 60, 600_001)
    influence = lambda r: np.where(r < 3, r, 9 / np.maximum(r, 3))  # noqa: E731
    level = optimize.brentq(lambda m: np.trapezoid(influence(x / m - 1) * np.exp(-x), x), 0.5, 1.5)
    assert 0.95 < level < 1, "what the guard against lines costs for single lines"
    # 20·4000 lines that scatter by 100 %: 0.35 %.
    assert np.mean(levels) == pytest.approx(2.0 * level, rel=4 * 0.0035)
    # Median m of |x − 1|: 2 sinh(m)/e = 1/2, m = 0.634; over the 0.6745 of a normal one.
    assert np.mean(scatters) == pytest.approx(0.634 / 0.6745, abs=0.03)


def test_a_spectral_line_is_no_part_of_the_noise():
    dof = np.full(160, 200.0)
    rng = np.random.default_rng(36)
    density = DENSITIES["all three"] * rng.chisquare(200, 160) / 200
    plain = shaping_filter(FREQUENCY, density, RATE, dof)
    density[100:103] *= 1000
    found = shaping_filter(FREQUENCY, density, RATE, dof)
    np.testing.assert_allclose(found.density(FREQUENCY), plain.density(FREQUENCY), rtol=0.05)
    assert found.scatter == pytest.approx(1, abs=0.35)  # a median of 160 draws, 12 %
    # Where the shape is another one, that is told: noise that rises with frequency.
    rising = shaping_filter(FREQUENCY, FREQUENCY, RATE, dof)
    assert rising.scatter > 2


# ---- errors and the result ----


@pytest.mark.parametrize("bad", [0.0, -1.0, 10.1])
def test_frequencies_outside_the_band(bad):
    f = FREQUENCY.copy()
    f[3] = bad
    with pytest.raises(
        ValueError, match=r"^frequencies must lie above 0 and up to 10 Hz, half the rate$"
    ):
        shaping_filter(f, 1 / FREQUENCY, RATE)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_density_that_is_not_positive(bad):
    density = DENSITIES["flicker"].copy()
    density[3] = bad
    with pytest.raises(ValueError, match=r"^a density must be positive at every frequency$"):
        shaping_filter(FREQUENCY, density, RATE)


def test_a_filter_given_by_hand():
    made = ShapingFilter(np.array([0.5]), np.array([0.2]), 3.0, 1.0, 0.0)
    np.testing.assert_allclose(made.sections, [[1, -0.2, 0, 1, -0.5, 0]])
    z = np.exp(2j * np.pi * 0.1)
    expected = 9 * abs((1 - 0.2 / z) / (1 - 0.5 / z)) ** 2
    assert made.density(0.1) == pytest.approx(expected, rel=1e-12)
