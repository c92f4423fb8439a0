"""Preset `rotation` and work A's sensor: reproducible, physical, and true to what truth.json says."""

import hashlib
import json

import numpy as np
import pytest

import sensorbook
from sensorbook.earth import field_at
from sensorbook.magnetometer import calibrate_rotation
from sensorbook.magnetometer.alignment import align, paired
from sensorbook.magnetometer.coverage import coverage
from sensorbook.recordings import check
from sensorbook.simulate import simulate
from sensorbook.simulate.rotation import (
    A_FIELD,
    CARRIED,
    MILLIGAUSS,
    PACE,
    attitudes,
    draw_iron,
    noisy,
    read_field,
    smooth,
    turned,
    work_a,
)

FIELD = 48e-6 * np.array([0, 0.5, -np.sqrt(0.75)])


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "compass", "rotation", seed=5)


@pytest.fixture(scope="module")
def device(folder):
    return sensorbook.load(folder)


# ---- the folder ----


def test_same_seed_same_bytes(folder, tmp_path):
    one = digests(folder)
    assert digests(simulate(tmp_path / "compass", "rotation", seed=5)) == one
    other = digests(simulate(tmp_path / "other" / "compass", "rotation", seed=6))
    assert set(other) == set(one) == {"device.toml", "truth.json", "rotation.csv"}
    assert {name for name in one if one[name] == other[name]} == {"device.toml"}


def test_nothing_to_mend(folder):
    assert check(folder) == ([], [])


def test_recordings(device):
    magnetometer, accelerometer = device.magnetometer.rotation, device.accelerometer.rotation
    assert (len(magnetometer), magnetometer.rate) == (6000, 50.0)
    assert len(accelerometer) == 6000
    assert device.site["date"].year == 2024
    field = np.linalg.norm(magnetometer.values, axis=1)
    assert 1e-6 < field.min() < field.max() < 150e-6  # T
    force = np.linalg.norm(accelerometer.values, axis=1)
    assert np.median(force) == pytest.approx(9.8, rel=0.1)


# ---- truth ----


def test_truth_is_within_what_is_said(folder, device):
    truth = json.loads((folder / "truth.json").read_text())["calibration"]["magnetometer"]
    assert device.truth["calibration"]["magnetometer"] == truth
    s, alignment = np.array(truth["soft_iron"]), np.array(truth["alignment"])
    np.testing.assert_array_equal(s, s.T)
    assert np.abs(np.diag(s) - 1).max() <= 0.08
    assert np.abs(s - np.diag(np.diag(s))).max() <= 0.05
    np.testing.assert_allclose(alignment @ alignment.T, np.eye(3), atol=1e-12)
    known = field_at(device.site)
    assert np.abs(truth["hard_iron"]).max() <= 0.6 * truth["field"]
    assert abs(truth["field"] - known.strength) < 4 * known.std
    assert truth["dip"] == known.dip


def test_readings_by_the_truth_have_the_field_s_length_and_dip(device):
    truth = device.truth["calibration"]["magnetometer"]
    field, force = paired(device.magnetometer.rotation, device.accelerometer.rotation)
    true = (field - truth["hard_iron"]) @ np.transpose(truth["soft_iron"])
    length = np.linalg.norm(true, axis=1) / truth["field"]
    assert length.mean() == pytest.approx(1, abs=2e-3)
    assert length.std() < 0.012  # 0.42 µT of white noise in 47 µT, and the room's gradient
    # In the accelerometer's axes, whose bias and hand's motion leave a degree or two.
    own = true @ np.array(truth["alignment"])
    up = force / np.linalg.norm(force, axis=1)[:, None]
    dip = np.arcsin(-(own * up).sum(axis=1) / np.linalg.norm(own, axis=1))
    assert np.median(dip) == pytest.approx(truth["dip"], abs=np.radians(2))


def test_intervals_of_simulated_devices_hold_the_truth(tmp_path):
    """15 devices through files and back: ten parameters each and a turn of the triads."""
    held = []
    for seed in range(15):
        device = sensorbook.load(simulate(tmp_path / f"d{seed}", "rotation", seed=seed))
        run, truth = device.magnetometer.rotation, device.truth["calibration"]["magnetometer"]
        fit = calibrate_rotation(run, device.site)
        assert (fit.method, fit.field_known) == ("ellipsoid", True)
        held.append(fit.against(truth)["holds the truth"] == "yes")
        found = align(fit, *paired(run, device.accelerometer.rotation), 9.8)
        assert found.determined
        np.testing.assert_allclose(found.rotation, truth["alignment"], atol=np.radians(1))
    # 150 intervals, correlated within a device: the soft iron shares the field's error.
    assert np.mean(held) >= 0.86


# ---- motion ----


def test_a_smooth_path_has_unit_variance_and_its_pace():
    path = smooth(np.random.default_rng([1, 1]), 200_000, 50.0, PACE)
    # 4000 s of 1.2 s: some 1300 independent values, of three paths.
    assert path.var() == pytest.approx(1, rel=0.1)
    lag = round(2 * PACE * 50)
    correlation = np.mean(path[:-lag] * path[lag:])
    # White noise through a Gaussian of width w correlates by exp(−lag² / 4 w²).
    assert correlation == pytest.approx(np.exp(-1), abs=0.08)


@pytest.mark.parametrize("seed", range(10))
def test_a_minute_goes_through_all_attitudes(seed):
    path = attitudes(np.random.default_rng([seed, 2]), 3000, 50.0)
    assert coverage(path.inv().apply([0, 0.6, -0.8])).percent > 80
    rate = np.linalg.norm((path[:-1].inv() * path[1:]).as_rotvec(), axis=1) * 50
    assert 1 < np.sqrt(np.mean(rate**2)) < 4  # rad/s, a hand's


@pytest.mark.parametrize("seed", range(5))
def test_the_room_has_neither_sources_nor_currents(seed):
    """The field along the path is that of a constant gradient, symmetric and without a trace."""
    made = turned(np.random.default_rng([seed, 3]), 3000, 50.0, FIELD, 9.8)
    # The same draws again: attitudes, then the place of the hand.
    rng = np.random.default_rng([seed, 3])
    attitudes(rng, 3000, 50.0)
    place = CARRIED * smooth(rng, 3000, 50.0, PACE)
    level = made["attitudes"].apply(made["field"])
    gradient, left, *_ = np.linalg.lstsq(place, level - FIELD, rcond=None)
    assert np.sqrt(left.max() / 3000) < 1e-15  # T: rounding
    size = np.abs(gradient).max()
    assert 5e-7 < size < 1e-5  # T/m
    assert abs(np.trace(gradient)) < 1e-8 * size
    np.testing.assert_allclose(gradient, gradient.T, rtol=0, atol=1e-8 * size)


def test_force_is_gravity_and_the_hand():
    made = turned(np.random.default_rng([1, 4]), 20_000, 50.0, FIELD, 9.8)
    level = made["attitudes"].apply(made["force"])
    np.testing.assert_allclose(level.mean(axis=0), [0, 0, 9.8], atol=0.02)
    assert 0.01 < level.std(axis=0).min() < level.std(axis=0).max() < 1.0


# ---- readings ----


def test_readings_undo_the_calibration():
    rng = np.random.default_rng([1, 5])
    iron = draw_iron(rng, 48e-6)
    true = 48e-6 * rng.standard_normal((50, 3))
    raw = read_field(true, iron)
    seen = (raw - iron["hard_iron"]) @ iron["soft_iron"]
    np.testing.assert_allclose(seen @ iron["alignment"], true, rtol=0, atol=1e-18)


def test_noise_is_as_loud_as_said_and_without_a_mean():
    rng = np.random.default_rng([1, 6])
    values = np.full((20_000, 3), 1e-5)
    noise = noisy(rng, values, 50.0, {"random_walk": 60e-9}) - values
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=1e-19)
    # N √rate; of 20 000 samples known to 0.5 %.
    np.testing.assert_allclose(noise.std(axis=0), 60e-9 * np.sqrt(50), rtol=0.03)
    assert (values == 1e-5).all()


def test_work_a_s_sensor_is_as_printed():
    """Extremes of an ellipsoid with centre h along axis i: h ± field · √((S⁻²)_ii), by hand."""
    readings = work_a(np.random.default_rng([1, 7]), 100_000, noise=0.0) / MILLIGAUSS
    c, s = np.cos(np.radians(11.3)), np.sin(np.radians(11.3))
    inverse = 1 / np.array([1.0150, 0.9393, 1.0455]) ** 2
    squares = [
        inverse[0],
        c**2 * inverse[1] + s**2 * inverse[2],
        s**2 * inverse[1] + c**2 * inverse[2],
    ]
    half = A_FIELD * np.sqrt(squares)
    centre = np.array([158.50, -37.49, 191.96])
    np.testing.assert_allclose(readings.max(axis=0), centre + half, atol=0.5)
    np.testing.assert_allclose(readings.min(axis=0), centre - half, atol=0.5)
    noisier = work_a(np.random.default_rng([1, 7]), 100_000, noise=2.0) / MILLIGAUSS
    np.testing.assert_allclose((noisier - readings).std(axis=0), 2.0, rtol=0.02)
