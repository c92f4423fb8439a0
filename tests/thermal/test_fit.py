"""Thermal fits of made and of real sweeps."""

import json
from functools import cache

import numpy as np
import pytest

import sensorbook
from sensorbook.thermal import Sweep, ThermalModel, fit_thermal, reduce_sweep

LOW, HIGH, REFERENCE = 20.0, 44.0, 32.0
BLOCKS = 240


def up_and_down(blocks=BLOCKS):
    return LOW + (HIGH - LOW) * (1 - np.abs(np.linspace(-1, 1, blocks)))


def sweep_of(*runs, directions=None, files=None) -> Sweep:
    """A sweep of (temperature, values) block means, as `reduce_sweep` gives it."""
    temperature = np.concatenate([t for t, _ in runs])
    values = np.concatenate([np.reshape(v, (len(t), -1)) for t, v in runs])
    count = [len(t) for t, _ in runs]
    return Sweep(
        time=np.concatenate([10.0 * np.arange(n) for n in count]),
        temperature=temperature,
        values=values,
        weight=np.ones(len(temperature)),
        run=np.repeat(np.arange(len(runs)), count),
        direction=np.concatenate([np.sign(np.gradient(t)) for t, _ in runs]),
        files=files or tuple(f"run {i + 1}" for i in range(len(runs))),
        block_seconds=10.0,
        disturbed=0,
    )


def noise(seed, shape=BLOCKS, size=1.0):
    return size * np.random.default_rng([91, seed]).standard_normal(shape)


def logistic(t, size, centre=24.5, width=0.17):
    return size / (1 + np.exp(-(t - centre) / width))


def best_polynomial(axis):
    return min(c.rms_check for c in axis.candidates if "jump" not in c.name)


# ---- polynomials ----

POWERS = (3.0, -0.4, 0.03, 0.002, -3e-4, 4e-5)  # of T − 32, each visible over ±12 °C


@pytest.mark.parametrize(
    ("degree", "blocks"), [(1, 300), (1, 240), (2, 240), (3, 240), (4, 300), (5, 240)]
)
def test_exact_polynomial(degree, blocks):
    t = up_and_down(blocks)
    true = np.array(POWERS[: degree + 1])
    y = np.polynomial.polynomial.polyval(t - REFERENCE, true)
    axis = fit_thermal(sweep_of((t, y))).axes[0]
    assert axis.model.reference == REFERENCE
    assert axis.jump is None
    ((low, high, found),) = axis.model.segments
    assert (low, high) == (t.min(), t.max())
    # Chosen right: nothing beyond the true degree but rounding.
    assert len(found) == degree + 1
    # Each power counts by what it makes of 12 °C; the largest is some 10.
    scale = 12.0 ** np.arange(degree + 1)
    np.testing.assert_allclose(found * scale, true * scale, atol=1e-9 * np.abs(true * scale).max())
    assert axis.offsets == pytest.approx([POWERS[0]], abs=1e-9)
    assert axis.rms_after < 1e-9
    assert axis.rms_check < 1e-9


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_noisy_polynomial(degree):
    t = up_and_down()
    true = np.array(POWERS[: degree + 1])
    y = np.polynomial.polynomial.polyval(t - REFERENCE, true)
    axis = fit_thermal(sweep_of((t, y + noise(degree, size=0.05)))).axes[0]
    assert axis.jump is None
    assert axis.model.to_results()["degree"] == degree
    grid = np.linspace(*axis.model.range, 51)
    error = (
        axis.model.change(grid) - np.polynomial.polynomial.polyval(grid - REFERENCE, true) + true[0]
    )
    # Four coefficients from 240 blocks: 0.05·√(4/240) = 0.006, at the ends some twice that.
    assert np.abs(error).max() < 0.04
    # The 95 % band is pointwise: most of the grid lies inside.
    assert np.mean(np.abs(error) <= axis.half_width) > 0.5
    assert axis.rms_after == pytest.approx(0.05, rel=0.15)
    assert axis.change.low < axis.change.value < axis.change.high
    assert len(axis.std[0]) == degree + 1


@pytest.mark.parametrize("seed", range(3))
def test_pure_noise_is_left_alone(seed):
    t = up_and_down()
    axis = fit_thermal(sweep_of((t, 5.0 + noise(10 + seed)))).axes[0]
    assert axis.model.to_results()["degree"] == 0
    assert axis.jump is None
    np.testing.assert_array_equal(axis.model.change(np.linspace(0, 60, 30)), 0)
    assert axis.rms_after == axis.rms_before
    assert axis.offsets[0] == pytest.approx(5, abs=4 / np.sqrt(BLOCKS))
    assert axis.change is None


# ---- jumps ----


@cache
def jump_fit(size=0.55, seed=20):
    """A's gyroscope X: a line, a bend and a logistic step of nine tenths in 24 … 25 °C."""
    t = up_and_down(600)
    y = 0.006 * (t - 20) + 0.1 * np.expm1((t - 20) / 12) / np.expm1(2) + logistic(t, size)
    return fit_thermal(sweep_of((t, y + noise(seed, 600, 0.004))), "gyroscope")


def test_a_jump_is_found():
    axis = jump_fit().axes[0]
    assert axis.jump.value == pytest.approx(0.55, rel=0.05) or (
        axis.jump.low <= 0.55 <= axis.jump.high
    )
    low, high = axis.jump_range
    # The middle is known to about a block (0.08 °C) and the width covers the step's nine tenths.
    assert (low + high) / 2 == pytest.approx(24.5, abs=0.15)
    assert 0.5 < high - low < 2.0
    assert axis.model.to_results()["model"] == "piecewise"
    assert axis.rms_check < best_polynomial(axis) / 3
    # Work A's degrees are there to be compared, and none follows.
    assert set(axis.polynomials) == {1, 3, 5}
    assert axis.rms_of("degree 5").rms > 3 * axis.rms_after


def test_a_downward_jump_is_the_mirror_image():
    t = up_and_down()
    y = logistic(t, 0.5) + noise(21, size=0.01)
    up, down = (fit_thermal(sweep_of((t, s * y))).axes[0] for s in (1, -1))
    assert down.jump.value == pytest.approx(-up.jump.value, rel=1e-6)
    assert down.jump_range == pytest.approx(up.jump_range)


@pytest.mark.parametrize("seed", range(3))
def test_no_jump_is_invented_on_a_smooth_curve(seed):
    t = up_and_down()
    y = -0.018 * (t - 20) - 0.12 * np.expm1((t - 20) / 12) / np.expm1(2)
    axis = fit_thermal(sweep_of((t, y + noise(30 + seed, size=0.004)))).axes[0]
    assert axis.jump is None
    assert axis.jump_range is None
    assert axis.model.to_results()["model"] == "polynomial"
    assert 1 <= axis.model.to_results()["degree"] <= 5


# ---- several runs ----


def test_runs_share_a_curve_and_keep_their_offsets():
    t = up_and_down()
    curve = 0.2 * (t - REFERENCE) + 0.01 * (t - REFERENCE) ** 2
    runs = [(t, o + curve + noise(40 + i, size=0.02)) for i, o in enumerate((1.0, -7.0, 30.0))]
    fit = fit_thermal(sweep_of(*runs, files=("a", "b", "c")))
    axis = fit.axes[0]
    assert axis.model.to_results()["degree"] == 2
    # A mean over 240 blocks: 0.02/√240 = 0.0013.
    assert axis.offsets == pytest.approx([1.0, -7.0, 30.0], abs=0.006)
    assert axis.model.change([40.0])[0] == pytest.approx(0.2 * 8 + 0.01 * 64, abs=0.006)
    # The offsets are no error of the model: neither before nor after.
    assert axis.rms_before == pytest.approx(np.std(curve), rel=0.01)
    assert axis.rms_after == pytest.approx(0.02, rel=0.1)
    assert axis.rms_check == pytest.approx(0.02, rel=0.1)
    assert axis.coefficients_per_run == pytest.approx([0.2] * 3, abs=0.002)
    runs = fit.to_results()["x"]["runs"]
    assert [r["file"] for r in runs] == ["a", "b", "c"]
    assert [r["offset"] for r in runs] == list(axis.offsets)


def test_model_carries_the_first_runs_offset():
    t = up_and_down()
    runs = [(t, o + 0.2 * (t - REFERENCE)) for o in (1.0, -7.0)]
    model = fit_thermal(sweep_of(*runs)).axes[0].model
    assert model.bias([REFERENCE])[0] == pytest.approx(1.0, abs=1e-9)
    assert model.change([REFERENCE])[0] == 0


# ---- heating and cooling ----


def test_heating_alone_has_no_hysteresis():
    t = np.linspace(LOW, HIGH, BLOCKS)
    axis = fit_thermal(sweep_of((t, 0.1 * t + noise(50, size=0.01)))).axes[0]
    assert axis.hysteresis is None
    assert axis.change.value == pytest.approx(0.1 * (HIGH - LOW), rel=0.01)


@pytest.mark.parametrize("size", [0.3, -0.3])
def test_hysteresis_of_a_known_size(size):
    t = up_and_down(600)
    heating = np.sign(np.gradient(t))
    # A loop: closed at both ends, widest in the middle.
    loop = size / 2 * heating * np.sin(np.pi * (t - LOW) / (HIGH - LOW))
    axis = fit_thermal(sweep_of((t, 0.1 * t + loop + noise(51, 600, 0.02)))).axes[0]
    value, where, error = axis.hysteresis
    assert value == pytest.approx(size, abs=max(4 * error, 0.015))
    assert where == pytest.approx(REFERENCE, abs=4)
    # 30 blocks each way in a bin, of which a quarter counts: 0.02·√(2·4/30) = 0.010.
    assert 0.003 < error < 0.03


def test_no_hysteresis_where_there_is_none():
    t = up_and_down(600)
    axis = fit_thermal(sweep_of((t, 0.1 * t + noise(52, 600, 0.02)))).axes[0]
    value, _, error = axis.hysteresis
    assert abs(value) < 4 * error


# ---- the result ----


def test_results_are_plain_json():
    t = up_and_down()
    smooth = 0.01 * t + noise(60, size=0.01)
    jump = logistic(t, 0.5) + noise(61, size=0.01)
    fit = fit_thermal(sweep_of((t, np.column_stack([smooth, jump, noise(62)]))), "gyroscope")
    results = json.loads(json.dumps(fit.to_results(), allow_nan=False))
    assert list(results) == ["x", "y", "z"]
    assert [results[a]["model"] for a in "xyz"] == ["polynomial", "piecewise", "polynomial"]
    assert results["x"]["unit"] == "rad/s"
    assert len(results["x"]["std"]) == len(results["x"]["coefficients"]) == 2
    for segment in results["y"]["segments"]:
        assert len(segment["std"]) == len(segment["coefficients"])
    assert results["y"]["jump"]["range"] == list(fit["y"].jump_range)
    assert results["x"]["jump"] is None
    names = {c["name"] for c in results["x"]["candidates"]}
    assert {f"degree {d}" for d in range(6)} <= names
    assert {f"degree {d}, jump" for d in range(4)} <= names
    grid = np.linspace(LOW, HIGH, 20)
    for i, axis in enumerate("xyz"):
        again = ThermalModel.from_results(results[axis])
        np.testing.assert_array_equal(again.change(grid), fit.axes[i].model.change(grid))


def test_frame():
    fit = jump_fit()
    frame = fit.to_frame()
    assert list(frame.index) == ["x"]
    low, high = fit["x"].jump_range
    assert frame.loc["x", "model"] == f"jump at {low:.1f} … {high:.1f} °C"
    size = fit["x"].jump.value / (np.pi / 180)
    assert frame.loc["x", "jump [°/s]"].startswith(f"{size:.3g} (")
    assert "jump at 2" in fit._repr_html_()


def test_candidate_by_name():
    axis = jump_fit().axes[0]
    assert axis.rms_of("degree 3").parameters == 3
    assert axis.rms_of("degree 1, jump").parameters == 5


# ---- real recordings ----


@pytest.fixture(scope="module")
def tag(real_data):
    runs = sensorbook.load(real_data / "cats-tag").runs("gyroscope", "thermal")
    sweep = reduce_sweep([(r.time, r.temperature, r.values) for r in runs], [r.file for r in runs])
    return sweep, fit_thermal(sweep, "gyroscope")


def test_tag_y_repeats(tag):
    _, fit = tag
    assert np.array(fit["y"].coefficients_per_run) * 1e3 == pytest.approx([0.45, 0.45], abs=0.02)


def test_tag_x_does_not_repeat(tag):
    one, two = np.array(tag[1]["x"].coefficients_per_run) * 1e3
    # −0.12 and −0.05 mrad/s/°C: more than half of the larger.
    assert abs(one - two) > 0.5 * max(abs(one), abs(two))


@pytest.mark.parametrize("axis", ["y", "z"])
def test_tag_is_a_straight_line(tag, axis):
    result = tag[1][axis]
    assert result.model.to_results()["degree"] == 1
    assert result.jump is None


def test_tag_high_degrees_do_not_predict(tag):
    z = tag[1]["z"]
    assert z.rms_of("degree 5").rms < z.rms_of("degree 1").rms
    assert z.rms_of("degree 5").rms_check > 1.5 * z.rms_of("degree 1").rms_check


def test_tag_knocks_are_left_out(tag):
    sweep, fit = tag
    assert sweep.disturbed > 0
    assert sweep.files == ("cycle1.csv.gz", "cycle2.csv.gz")
    assert sweep.span[0] == pytest.approx(4.8, abs=0.3)
    json.dumps(fit.to_results(), allow_nan=False)


def test_runs_of_disjoint_temperatures_are_held_out_by_stretches():
    # A cold run and a hot run: neither can be predicted from the other's temperatures.
    half = BLOCKS // 2
    cold = np.concatenate([np.linspace(20, 30, half), np.linspace(30, 20, half)])
    runs = [(cold + d, 0.02 * (cold + d) + noise([8, d], len(cold), 1e-3)) for d in (0, 15)]
    axis = fit_thermal(sweep_of(*runs)).axes[0]
    assert np.isfinite(axis.rms_check)
    assert axis.model.range == (20.0, 45.0)
    # 600 blocks of 1e-3 each know the slope over 10 °C to 1.5e-5; ten times that is certain.
    assert axis.change.value == pytest.approx(0.02 * 25, abs=25 * 1.5e-4)


# ---- cycle against cycle ----


def cycles_of(*slopes, seed, loop=0.3):
    """Cycles with a common hysteresis loop and correlated noise (first order, 0.9)."""
    t = up_and_down()
    runs = []
    for k, slope in enumerate(slopes):
        e = noise([seed, k], size=0.1)
        for i in range(1, len(e)):
            e[i] += 0.9 * e[i - 1]
        width = np.sin(np.pi * (t - LOW) / (HIGH - LOW))
        runs.append((t, slope * t + loop * np.sign(np.gradient(t)) * width + e))
    return sweep_of(*runs)


@pytest.mark.parametrize("seed", range(70, 73))
def test_cycles_with_one_slope_repeat(seed):
    axis = fit_thermal(cycles_of(0.2, 0.2, seed=seed)).axes[0]
    found = axis.repeatability
    assert found.repeatable
    assert found.predicted
    # Correlated noise of 0.23 over some 12 independent stretches and ±7 °C: 0.01.
    assert found.slopes == pytest.approx([0.2, 0.2], abs=0.04)
    assert axis.model.to_results()["degree"] == 1


@pytest.mark.parametrize("slopes", [(0.2, -0.2), (0.2, 0.05), (-0.2, 0.02, 0.1)])
def test_cycles_with_different_slopes_do_not_repeat(slopes):
    fit = fit_thermal(cycles_of(*slopes, seed=74), "gyroscope")
    entry = json.loads(json.dumps(fit.to_results(), allow_nan=False))["x"]
    assert entry["repeatable"] is False
    assert (
        len(entry["repeatability"]["slopes"]) == len(entry["repeatability"]["std"]) == len(slopes)
    )


def test_cycles_of_opposite_slopes_leave_a_constant():
    axis = fit_thermal(cycles_of(0.2, -0.2, seed=75)).axes[0]
    assert axis.model.to_results()["degree"] == 0
    assert not axis.repeatability.predicted


def test_one_cycle_says_nothing_about_repeating():
    fit = fit_thermal(cycles_of(0.2, seed=76), "gyroscope")
    assert fit.axes[0].repeatability is None
    assert fit.to_results()["x"]["repeatable"] is None


def test_tag_repeats_on_y_and_z_only(tag):
    _, fit = tag
    assert [fit[a].repeatability.repeatable for a in "xyz"] == [False, True, True]
    assert fit["x"].model.to_results()["degree"] == 0
    # Goals in rad/s, held out by whole cycles.
    assert fit["y"].rms_check <= 0.66e-3
    assert fit["z"].rms_check <= 0.61e-3
