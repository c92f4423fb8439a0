"""Simulated devices: reproducible, readable, and true to what truth.json says."""

import hashlib
import json

import numpy as np
import pytest
from scipy import signal

import sensorbook
from sensorbook import InputError
from sensorbook.recordings import check
from sensorbook.simulate import PRESETS, simulate
from sensorbook.simulate.noise import coloured_noise


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "imu-7", seed=3)


@pytest.fixture(scope="module")
def device(demo):
    return sensorbook.load(demo)


# ---- the folder ----


def test_same_seed_same_bytes(demo, tmp_path):
    again = simulate(tmp_path / "imu-7", seed=3)
    assert digests(again) == digests(demo)
    assert {"device.toml", "truth.json", "static.npz", "sweep.csv"} <= set(digests(demo))


def test_another_seed_differs(demo, tmp_path):
    one, other = digests(demo), digests(simulate(tmp_path / "imu-7", seed=4))
    assert one["static.npz"] != other["static.npz"]
    assert one["sweep.csv"] != other["sweep.csv"]
    assert one["truth.json"] == other["truth.json"]


def test_device_is_without_problems(demo):
    problems, _ = check(demo)
    assert problems == []


def test_device_is_named_after_its_folder(device):
    assert device.id == "imu-7"
    assert set(device.sensors) >= {"gyroscope", "accelerometer"}


def test_a_folder_name_that_is_no_id(tmp_path):
    folder = simulate(tmp_path / "not an id", seed=0)
    assert sensorbook.load(folder).id == "ahrs-demo"


def test_unknown_preset(tmp_path):
    with pytest.raises(InputError) as error:
        simulate(tmp_path / "d", preset="nope")
    assert str(error.value) == (
        f"simulate: preset: 'nope' is not known — one of {', '.join(PRESETS)}"
    )
    assert not (tmp_path / "d").exists()


def test_negative_seed(tmp_path):
    with pytest.raises(InputError) as error:
        simulate(tmp_path / "d", seed=-1)
    assert str(error.value) == "simulate: seed: -1 is negative — give 0 or more"
    assert not (tmp_path / "d").exists()


def test_an_existing_device_is_left_alone(tmp_path):
    (tmp_path / "device.toml").write_text("schema = 1\n", encoding="utf-8")
    (tmp_path / "static.npz").write_bytes(b"recorded")
    before = digests(tmp_path)
    with pytest.raises(InputError, match="holds a device already — name another folder or remove"):
        simulate(tmp_path, seed=1)
    assert digests(tmp_path) == before


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot be written: .* — choose another folder"):
        simulate(tmp_path / "file" / "d")


# ---- truth ----

# Work A, tables 7.1 and 7.3 (Allan columns), converted by hand: °/√h × π/10800, °/h × π/648000,
# mg × 9.80665e-3, m/s/h^(3/2) / 216000.
BY_HAND = {
    "gyroscope": {
        "x": (7.126761e-5, 3.665191e-5, 8.726646e-6),
        "y": (7.912167e-5, 3.839724e-5, None),
        "z": (1.000655e-4, 1.483530e-5, None),
    },
    "accelerometer": {
        "x": (1.255251e-3, 2.941995e-4, 4.199074e-5),
        "y": (1.255251e-3, 2.941995e-4, None),
        "z": (1.961330e-3, 4.314926e-4, None),
    },
}


@pytest.mark.parametrize("sensor", BY_HAND)
def test_truth_is_work_a_in_si(demo, sensor):
    truth = json.loads((demo / "truth.json").read_text())["noise"][sensor]
    for axis, expected in BY_HAND[sensor].items():
        found = truth[axis]
        names = ("random_walk", "bias_instability", "rate_random_walk")
        for name, value in zip(names, expected, strict=True):
            # Seven digits were written down.
            assert found[name] == (value and pytest.approx(value, rel=1e-6)), (axis, name)


def test_published_values_are_as_printed(demo):
    published = json.loads((demo / "truth.json").read_text())["published"]
    assert published["gyroscope"]["x"] == [0.245, 7.56, 1.8]
    assert published["gyroscope"]["y"] == [0.272, 7.92, 0.0]
    assert published["gyroscope"]["z"] == [0.344, 3.06, 0.0]
    assert published["accelerometer"]["x"] == [0.128, 0.03, 9.07]
    assert published["accelerometer"]["y"] == [0.128, 0.03, 0.0]
    assert published["accelerometer"]["z"] == [0.2, 0.044, 0.0]
    assert published["gyroscope"]["units"] == ["deg/sqrt(h)", "deg/h", "deg/h/sqrt(s)"]
    assert published["accelerometer"]["units"] == ["mg/sqrt(Hz)", "mg", "m/s/h^(3/2)"]


def test_jumps_are_where_work_a_found_them(demo):
    thermal = json.loads((demo / "truth.json").read_text())["thermal"]
    jumps = {(s, a) for s in BY_HAND for a in "xyz" if thermal[s][a]["jump"] is not None}
    assert jumps == {("gyroscope", "x"), ("gyroscope", "y"), ("accelerometer", "z")}
    assert thermal["jump_range"] == [24.0, 25.0]
    grid = np.array(thermal["temperature"])
    for sensor, axis in jumps:
        bias, size = np.array(thermal[sensor][axis]["bias"]), thermal[sensor][axis]["jump"]
        # Nine tenths of a step between 24 and 25 °C, besides the smooth change of one degree.
        rise = np.interp(25, grid, bias) - np.interp(24, grid, bias)
        smooth = np.interp(26.5, grid, bias) - np.interp(25.5, grid, bias)
        assert (rise - smooth) / size == pytest.approx(0.9, abs=0.03)


# ---- recordings ----


def test_static_recording(device):
    run = device.gyroscope.static
    assert (len(run), run.rate, run.gaps) == (720_000, 100.0, 0)
    # White noise at 100 Hz would have 10·N a sample; the 20 Hz low-pass (second order) passes the
    # noise bandwidth π/4·√2·20 Hz = 22.2 Hz of 50.
    n = BY_HAND["gyroscope"]["z"][0]
    fast = np.diff(run.z.reshape(-1, 100), axis=1).std()
    assert fast < 0.8 * np.sqrt(2) * n * 10
    # Means of whole seconds have N/√1 s of the floor; slow noise is less than that.
    seconds = run.z.reshape(-1, 100).mean(axis=1)
    assert np.diff(seconds).std() / np.sqrt(2) == pytest.approx(n, rel=0.06)
    norm = np.linalg.norm(device.accelerometer.static.values.mean(axis=0))
    assert norm == pytest.approx(9.80665, rel=0.03)


def test_static_temperature_is_settled(device):
    t = device.gyroscope.static.temperature
    minutes = t.reshape(-1, 6000).mean(axis=1)
    assert np.ptp(minutes) < 0.1
    assert abs(minutes[:30].mean() - minutes[-30:].mean()) < 0.05
    assert t.mean() == pytest.approx(31.0, abs=0.05)


def test_sweep_covers_the_jump(device):
    for sensor in ("gyroscope", "accelerometer"):
        run = getattr(device, sensor).thermal
        t = run.temperature
        assert t.min() < 20.5
        assert t.max() > 43.5
        top = int(np.argmax(t))
        for part in (t[:top], t[top:]):  # heating, cooling
            assert ((part > 24) & (part < 25)).sum() > 500
        # Slow enough: 1 °C a minute at most, over any minute.
        assert np.abs(t[600:] - t[:-600]).max() < 1.1


def test_sweep_follows_the_true_curve(device, demo):
    thermal = json.loads((demo / "truth.json").read_text())["thermal"]
    grid = np.array(thermal["temperature"])
    run = device.gyroscope.thermal
    inside = (run.temperature > grid[0]) & (run.temperature < grid[-1])
    for i, axis in enumerate("xyz"):
        true = np.interp(run.temperature[inside], grid, thermal["gyroscope"][axis]["bias"])
        rest = run.values[inside, i] - true
        blocks = rest[: len(rest) // 600 * 600].reshape(-1, 600).mean(axis=1)
        # What is left are the rest's reading, slow noise (some 1e-4 rad/s, and on x a random walk of
        # K·√6000 s) and at the jump the thermometer's 0.01 °C.
        walk = (BY_HAND["gyroscope"][axis][2] or 0.0) * np.sqrt(6000)
        assert np.ptp(blocks) < 0.03 * np.ptp(thermal["gyroscope"][axis]["bias"]) + 2e-4 + 4 * walk


# ---- noise ----


@pytest.mark.parametrize(
    ("terms", "bandwidth"),
    [
        ({"random_walk": 2e-3}, None),
        ({"random_walk": 0.0, "bias_instability": 3e-3}, None),
        ({"random_walk": 0.0, "rate_random_walk": 4e-3}, None),
        ({"random_walk": 2e-3, "bias_instability": 3e-3, "rate_random_walk": 4e-3}, 20.0),
        ({"random_walk": 2e-3}, 5.0),
    ],
)
def test_periodogram_follows_the_density(terms, bandwidth):
    rate, seed = 100.0, [101, round(bandwidth or 0), len(terms)]
    values = coloured_noise(
        1_000_000, rate, np.random.default_rng(seed), bandwidth=bandwidth, **terms
    )
    # Hann windows: the lines of a steep spectrum would leak through a rectangular one.
    f, one_sided = signal.welch(values, rate, nperseg=4096, detrend="linear")
    w = 2 * np.pi * f[4:-4]
    n, b, k = (terms.get(x, 0.0) for x in ("random_walk", "bias_instability", "rate_random_walk"))
    density = n**2 + b**2 / w + k**2 / w**2
    if bandwidth:
        density /= 1 + (f[4:-4] / bandwidth) ** 4
    ratio = one_sided[4:-4] / 2 / density
    # 487 windows, half overlapping, are worth 250: a line to 6 %, a mean of 16 or more to 1.6 %.
    edges = [0, 16, 48, 112, 240, 496, 1008, 2041]
    means = np.add.reduceat(ratio, edges[:-1]) / np.diff(edges)
    np.testing.assert_allclose(means, 1, atol=0.05)


def test_noise_length_and_generator():
    rng = np.random.default_rng(5)
    one, two = (coloured_noise(1001, 10.0, rng, random_walk=1.0) for _ in range(2))
    assert one.shape == (1001,)
    assert not np.array_equal(one, two)
    again = coloured_noise(1001, 10.0, np.random.default_rng(5), random_walk=1.0)
    np.testing.assert_array_equal(one, again)


def test_a_random_walk_begins_at_zero():
    values = coloured_noise(
        100, 1.0, np.random.default_rng(6), random_walk=1.0, rate_random_walk=1.0
    )
    assert values[0] == 0.0
