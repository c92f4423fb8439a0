"""Allan deviation against published tables, exact values and an independent implementation."""

import tracemalloc

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensorbook import Refusal
from sensorbook.noise import allan_deviation, cluster_sizes
from sensorbook.noise.allan import BLOCK, EXACT_UP_TO, SHORT, thinned


def nbs14() -> np.ndarray:
    """The 1000-point frequency set of NIST SP 1065: a prime-modulus generator over its modulus."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


# ---- published reference data ----


@pytest.mark.parametrize(
    ("overlapping", "printed"),
    [
        (False, ["2.922319e-01", "9.965736e-02", "3.897804e-02"]),
        (True, ["2.922319e-01", "9.159953e-02", "3.241343e-02"]),
    ],
)
def test_nbs14_as_nist_sp_1065_prints_it(overlapping, printed):
    curve = allan_deviation(nbs14(), 1.0, [1, 10, 100], overlapping=overlapping)
    assert [f"{s:.6e}" for s in curve.deviation[:, 0]] == printed


@pytest.mark.parametrize("octave", ["", "_octave"])
@pytest.mark.parametrize(("name", "overlapping"), [("adev", False), ("oadev", True)])
def test_phase_dat_as_stable32_prints_it(real_data, name, overlapping, octave):
    folder = real_data / "stable32"
    phase = np.loadtxt(folder / "PHASE.DAT")
    table = (folder / f"phase_dat_{name}{octave}.txt").read_text().splitlines()
    rows = [line.split() for line in table if line.strip() and not line.startswith("#")]
    assert len(rows) >= 8
    clusters = [int(row[0]) for row in rows]
    curve = allan_deviation(phase, 1.0, clusters, overlapping=overlapping, phase=True)
    assert curve.samples == 1000
    assert [f"{t:.4e}" for t in curve.tau] == [row[1] for row in rows]
    assert curve.terms.tolist() == [int(row[2]) for row in rows]
    assert [f"{s:.4e}" for s in curve.deviation[:, 0]] == [row[5] for row in rows]


@pytest.mark.parametrize("rate", [1.0, 100.0])
@pytest.mark.parametrize(
    ("overlapping", "reference"), [(False, allantools.adev), (True, allantools.oadev)]
)
def test_agrees_with_allantools(overlapping, reference, rate):
    values = np.random.default_rng(20240501).normal(0.3, 2.0, 3000)
    clusters = np.array([1, 2, 3, 7, 10, 64, 250, 600])
    taus, expected, _, terms = reference(values, rate, "freq", clusters / rate)
    curve = allan_deviation(values, rate, clusters, overlapping=overlapping)
    np.testing.assert_allclose(curve.tau, taus, rtol=1e-12)
    # allantools integrates with the mean left in: its sums lose some digits, ours fewer.
    np.testing.assert_allclose(curve.deviation[:, 0], expected, rtol=1e-10)
    np.testing.assert_array_equal(curve.terms, terms)


# ---- exact deviations ----


@pytest.mark.parametrize("overlapping", [False, True])
def test_ramp(overlapping):
    rate, slope = 50.0, 0.02
    values = 5.0 + slope * np.arange(4000) / rate
    curve = allan_deviation(values, rate, overlapping=overlapping)
    # Every second difference is the same; the running sum of 4000 doubles keeps ten digits of it.
    np.testing.assert_allclose(curve.deviation[:, 0], slope * curve.tau / np.sqrt(2), rtol=1e-9)


@pytest.mark.parametrize("overlapping", [False, True])
def test_alternating_sign(overlapping):
    values = np.tile([1.0, -1.0], 600)
    odd, even = [1, 3, 5, 55, 301], [2, 4, 100, 600]
    found = allan_deviation(values, 1.0, odd + even, overlapping=overlapping).deviation[:, 0]
    # An odd cluster has one sample left over: ±1/m against ∓1/m. An even one has none.
    np.testing.assert_allclose(found[: len(odd)], np.sqrt(2) / np.array(odd), rtol=1e-12)
    np.testing.assert_allclose(found[len(odd) :], 0, atol=1e-12)


@pytest.mark.parametrize("cluster", [1, 3, 10, 16, 20, 33, 47])
def test_sinusoid_of_sampled_data(cluster):
    amplitude, rate, period = 0.7, 10.0, 20  # samples a period
    # As many start samples as whole periods hold, so that the mean over the phase is exact.
    samples = 2 * cluster - 1 + 60 * period
    values = amplitude * np.sin(2 * np.pi * np.arange(samples) / period + 0.4)
    curve = allan_deviation(values, rate, [cluster])
    # A6 with the sampled kernel of A5: n·sin(πfδt) for πfτ.
    x = np.pi * cluster / period
    expected = amplitude * np.sin(x) ** 2 / (cluster * np.sin(np.pi / period))
    assert curve.terms[0] == 60 * period
    assert curve.deviation[0, 0] == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("cluster", [1, 3, 10, 16, 33, 47])
def test_sinusoid_integrated_in_continuous_time(cluster):
    amplitude, rate, frequency = 0.7, 10.0, 0.5
    period = round(rate / frequency)
    time = np.arange(2 * cluster + 60 * period) / rate
    angle = -amplitude / (2 * np.pi * frequency) * np.cos(2 * np.pi * frequency * time + 0.4)
    curve = allan_deviation(angle, rate, [cluster], phase=True)
    x = np.pi * frequency * curve.tau[0]
    # A6 as printed: Ω₀² (sin²(πf₀τ)/(πf₀τ))².
    assert curve.deviation[0, 0] == pytest.approx(amplitude * np.sin(x) ** 2 / x, rel=1e-10)


@pytest.mark.parametrize("overlapping", [False, True])
def test_white_noise_expectation(overlapping):
    # σ²(τ) = N²/τ, its estimate χ² with edf ≈ 1.5·N/m (Howe, Allan, Barnes 1981): over 40 axes of
    # 20 000 samples at m = 100 the relative error of σ² is √(2/(40·200)) = 1.6 %, of σ half of it.
    values = np.random.default_rng(7).standard_normal((20_000, 40)) * 0.01 * np.sqrt(100.0)
    curve = allan_deviation(values, 100.0, [1, 10, 100], overlapping=overlapping)
    mean = np.sqrt(np.mean(curve.deviation**2, axis=1))
    np.testing.assert_allclose(mean, 0.01 / np.sqrt(curve.tau), rtol=4 * 0.008)


# ---- blocks and thinned start points ----


@pytest.mark.parametrize("overlapping", [False, True])
@pytest.mark.parametrize("starts", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
@pytest.mark.parametrize("cluster", [1, 2, 7, SHORT, SHORT + 1, BLOCK + 3])
def test_blocks_join(cluster, starts, overlapping):
    samples = 2 * cluster - 1 + starts
    theta = np.random.default_rng(23).normal(size=samples + 1)
    curve = allan_deviation(theta, 1.0, [cluster], phase=True, overlapping=overlapping, exact=True)
    second = theta[2 * cluster :] - 2 * theta[cluster:-cluster] + theta[: -2 * cluster]
    second = second[:: 1 if overlapping else cluster]
    assert curve.terms.tolist() == [len(second)]
    expected = np.sqrt(np.mean(second**2) / 2) / cluster
    assert curve.deviation[0, 0] == pytest.approx(expected, rel=1e-12)


def test_strides():
    clusters = np.array([1, 31, 32, 63, 64, 1000, 1024, 10**7])
    assert thinned(clusters).tolist() == [1, 1, 2, 2, 4, 32, 64, 2**19]


def test_long_records_are_thinned_unless_asked_otherwise():
    values = np.random.default_rng(29).normal(size=EXACT_UP_TO + 1)
    clusters = np.array([1, 31, 32, 1000, 20_000])
    every = [allan_deviation(values[:-1], 1.0, clusters, exact=e) for e in (None, True)]
    np.testing.assert_array_equal(every[0].deviation, every[1].deviation)
    assert every[0].terms.tolist() == (EXACT_UP_TO - 2 * clusters + 1).tolist()
    some = [allan_deviation(values, 1.0, clusters, exact=e) for e in (None, False)]
    np.testing.assert_array_equal(some[0].deviation, some[1].deviation)
    np.testing.assert_array_equal(some[0].clusters, clusters)
    theta = np.concatenate([[0.0], np.cumsum(values)])
    for m, stride, terms, found in zip(
        clusters, [1, 1, 2, 32, 1024], some[0].terms, some[0].deviation[:, 0], strict=True
    ):
        first = np.arange(0, len(theta) - 2 * m, stride)
        second = theta[first + 2 * m] - 2 * theta[first + m] + theta[first]
        assert terms == len(first)
        # The sum of 131 073 doubles with their mean left in keeps eleven digits.
        assert found == pytest.approx(np.sqrt(np.mean(second**2) / 2) / m, rel=1e-10)


def relative_variance(r: np.ndarray, terms: int) -> float:
    """Of the mean of `terms` squares whose correlation at lag j is ``r[j]`` (Isserlis)."""
    return 2 * (2 * ((terms - np.arange(terms)) * r[:terms] ** 2).sum() - terms) / terms**2


@pytest.mark.parametrize("cluster", [32, 63, 64, 500, 1024, 2000, 3000, 4000])
@pytest.mark.parametrize(
    "covariance",
    [
        lambda s: -s,
        lambda s: s**2 * np.log(np.maximum(s, 1)),
        lambda s: s**3,
    ],
    ids=["white", "flicker", "random walk"],
)
def test_what_thinning_costs(covariance, cluster):
    # By the exact correlation of the second differences of θ, up to N/5: no chance in it.
    samples, stride = 20_000, int(thinned(np.array(cluster)))
    lag = np.arange(samples - 2 * cluster + 1)
    r = sum(
        c * covariance(np.abs(lag + k * cluster).astype(float))
        for k, c in zip(range(-2, 3), [1, -4, 6, -4, 1], strict=True)
    )
    every = relative_variance(r / r[0], len(lag))
    some = relative_variance(r[::stride] / r[0], len(lag[::stride]))
    assert some <= 1.005 * every


@pytest.mark.parametrize("kind", ["white", "flicker", "random walk"])
def test_thinned_estimates_scatter_as_exact_ones(kind):
    samples, records = 4096, 400
    white = np.random.default_rng(31).standard_normal((2 * samples, records))
    if kind == "flicker":
        k = np.arange(1, len(white))
        response = np.cumprod(np.append(1.0, (k - 0.5) / k))
        values = np.fft.irfft(
            np.fft.rfft(response, 4 * samples)[:, None] * np.fft.rfft(white, 4 * samples, axis=0),
            axis=0,
        )[samples : 2 * samples]
    else:
        values = (np.cumsum(white, axis=0) if kind == "random walk" else white)[:samples]
    clusters = np.array([32, 64, 256, 800])
    every, some = (
        allan_deviation(values, 1.0, clusters, exact=e).deviation ** 2 for e in (True, False)
    )
    # Both see the same records. What thinning adds is uncorrelated with the exact estimate, so that it
    # has 0.5 % of its variance, and the ratio of variances scatters by 2√(0.005/400) = 0.7 %. The
    # skewness of few degrees of freedom and the ends of the record may double that.
    ratio = some.var(axis=1) / every.var(axis=1)
    np.testing.assert_allclose(ratio, 1.0, atol=0.005 + 3 * 0.014)
    np.testing.assert_allclose(some.mean(axis=1), every.mean(axis=1), rtol=0.01)


# ---- forms of input ----


@pytest.mark.parametrize("overlapping", [False, True])
def test_phase_input_is_rate_input_integrated(overlapping):
    rate = 25.0
    values = np.random.default_rng(11).normal(0.1, 1.0, (2000, 2))
    angle = np.vstack([np.zeros(2), np.cumsum(values, axis=0)]) / rate
    by_rate = allan_deviation(values, rate, overlapping=overlapping)
    by_phase = allan_deviation(angle, rate, overlapping=overlapping, phase=True)
    assert by_phase.samples == by_rate.samples == 2000
    np.testing.assert_array_equal(by_phase.clusters, by_rate.clusters)
    np.testing.assert_allclose(by_phase.deviation, by_rate.deviation, rtol=1e-10)


def test_axes_at_once_equal_one_at_a_time():
    values = np.random.default_rng(3).normal(size=(5000, 3)) * [1.0, 1e-3, 50.0]
    together = allan_deviation(values, 10.0, sensor="gyroscope")
    assert together.deviation.shape == (len(together.tau), 3)
    for i in range(3):
        alone = allan_deviation(values[:, i], 10.0)
        assert alone.deviation.shape == (len(together.tau), 1)
        np.testing.assert_allclose(together.deviation[:, i], alone.deviation[:, 0], rtol=1e-13)


def test_single_precision_and_counts_are_taken_as_they_are():
    rng = np.random.default_rng(17)
    # Near the end of the range of int16: a sum in the type of the input would overflow at once.
    counts = (32000 + rng.integers(-700, 700, 4000)).astype(np.int16)
    single = (1000 + rng.normal(size=4000)).astype(np.float32)
    for values in (counts, single):
        found = allan_deviation(values, 100.0).deviation
        assert found.dtype == np.float64
        np.testing.assert_array_equal(
            found, allan_deviation(values.astype(np.float64), 100.0).deviation
        )


@pytest.mark.parametrize("exact", [True, False])
def test_memory_beyond_the_input(exact):
    samples = 500_000
    single = np.zeros((samples, 3), np.float32)
    for values, phase in ((single[:, 0].astype(float), False), (single, False), (single, True)):
        tracemalloc.start()
        allan_deviation(values, 100.0, phase=phase, exact=exact)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        # One running integral in double precision, and a block.
        assert peak < 1.3 * 8 * samples


def test_large_offset_costs_no_digits():
    values = np.random.default_rng(19).normal(size=4000)
    plain = allan_deviation(values, 1.0).deviation
    # 1e6 leaves each sample ten digits, which the deviation must keep.
    shifted = allan_deviation(values + 1e6, 1.0).deviation
    np.testing.assert_allclose(shifted, plain, rtol=1e-8)


@settings(max_examples=25, deadline=None)
@given(
    scale=st.floats(1e-9, 1e9),
    offset=st.floats(-10, 10),
    rate=st.floats(0.1, 1e4),
    seed=st.integers(0, 2**32 - 1),
)
def test_scale_offset_and_rate(scale, offset, rate, seed):
    values = np.random.default_rng(seed).normal(size=300)
    clusters = [1, 2, 5, 40, 150]
    plain = allan_deviation(values, 1.0, clusters)
    changed = allan_deviation(-scale * (values + offset), rate, clusters)
    np.testing.assert_allclose(changed.deviation, scale * plain.deviation, rtol=1e-9)
    np.testing.assert_allclose(changed.tau, plain.tau / rate, rtol=1e-15)


# ---- cluster sizes ----


@settings(max_examples=60, deadline=None)
@given(
    samples=st.integers(0, 3_000_000),
    rate=st.one_of(st.integers(1, 4000).map(float), st.floats(0.05, 4000)),
    per_octave=st.integers(1, 12),
)
def test_cluster_sizes(samples, rate, per_octave):
    m = cluster_sizes(samples, rate, per_octave)
    assert (np.diff(m) > 0).all()
    assert ((m >= 1) & (m <= samples / 5)).all()
    second = round(rate)
    if 1 <= second <= samples // 5:
        assert second in m
    if samples >= 5 and rate >= 1:
        assert m[0] == 1
        # No gap wider than asked for, rounding apart, and the last step reaches N/5.
        step = 2 ** (1 / per_octave)
        assert (m[1:] <= step * (m[:-1] + 0.5) + 0.5 + 1e-9).all()
        assert (m[-1] + 0.5) * step >= samples // 5 - 0.5


def test_one_second_is_a_cluster_time():
    for rate in (1.0, 10.0, 100.0, 125.0, 819.0):
        assert 1.0 in allan_deviation(np.zeros(5000), rate).tau


# ---- errors ----


def test_too_short_a_record_is_refused():
    with pytest.raises(Refusal) as refused:
        allan_deviation(np.zeros(999), 100.0)
    assert refused.value.reason == (
        "The record has 999 samples; the Allan deviation needs at least 1000."
    )
    assert refused.value.remedy == "Record a rest of one hour or more."
    assert allan_deviation(np.zeros(1000), 100.0).samples == 1000
    # With the cluster sizes given, the caller knows what is asked for.
    assert allan_deviation(np.arange(10.0), 1.0, [5]).terms.tolist() == [1]


def test_phase_samples_count_one_more():
    with pytest.raises(Refusal, match="has 999 samples"):
        allan_deviation(np.zeros(1000), 100.0, phase=True)
    assert allan_deviation(np.zeros(1001), 100.0, phase=True).samples == 1000


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite(bad):
    values = np.zeros((2000, 3))
    values[1234, 1] = bad
    message = r"holds samples that are not finite; bridge or cut them first \(.* sample 1234\)"
    for phase in (False, True):
        with pytest.raises(ValueError, match=message):
            allan_deviation(values, 100.0, phase=phase)


def test_constant_data():
    assert (allan_deviation(np.full(2000, 9.81), 100.0).deviation < 1e-14).all()


@pytest.mark.parametrize("cluster", [0, -3, 501, 10**6])
def test_cluster_outside_the_record(cluster):
    with pytest.raises(
        ValueError, match=rf"^cluster size {cluster} is outside 1 … 500: two clusters"
    ):
        allan_deviation(np.zeros(1000), 100.0, [1, 500, cluster])


@pytest.mark.parametrize("rate", [0, -100.0, np.inf, np.nan])
def test_what_is_no_rate(rate):
    for clusters in (None, [1, 2]):
        with pytest.raises(ValueError, match=f"^rate {rate:g} Hz: give the sampling rate, above"):
            allan_deviation(np.zeros(2000), rate, clusters)


@pytest.mark.parametrize("cluster", [2.7, "a", np.nan])
def test_clusters_that_are_not_whole(cluster):
    with pytest.raises(ValueError, match=f"^cluster size {cluster} is not a whole number of samp"):
        allan_deviation(np.zeros(2000), 1.0, [1, cluster, 3.5])
    whole = allan_deviation(np.zeros(2000), 1.0, [1.0, np.int32(4)])
    assert whole.clusters.tolist() == [1, 4]


# ---- the result ----


def test_at_interpolates_in_the_logarithm():
    values = np.column_stack([np.arange(2000.0), 3 * np.arange(2000.0)])
    curve = allan_deviation(values, 1.0, [1, 2, 4, 256])
    # A ramp is a straight line in log–log: interpolation between 4 and 256 is exact.
    np.testing.assert_allclose(curve.at(37.0), np.array([1, 3]) * 37 / np.sqrt(2), rtol=1e-9)


def test_frame():
    curve = allan_deviation(np.random.default_rng(2).normal(size=(2000, 3)), 4.0)
    frame = curve.to_frame()
    assert list(frame.columns) == ["x", "y", "z"]
    assert frame.index.name == "tau [s]"
    np.testing.assert_array_equal(frame.index, curve.tau)
    np.testing.assert_array_equal(frame.to_numpy(), curve.deviation)
    html = curve._repr_html_()
    assert "<table" in html
    assert "tau [s]" in html
