"""Recordings of real sensors, with the oddities their authors published."""

import numpy as np
import pytest

import sensorbook
from sensorbook.recordings import check

FOLDERS = ("adis16405-1", "adis16405-2", "adis16405-3", "broad-slow", "cats-tag", "ck-mag-acc",
           "sunsided-tilt-sphere", "xsens-mti")  # fmt: skip


@pytest.mark.parametrize("name", FOLDERS)
def test_every_folder_is_readable(real_data, name):
    problems, _ = check(real_data / name)
    assert problems == []


def test_shocks_of_the_adis_are_named_for_both_sensors(real_data):
    _, found = check(real_data / "adis16405-1")
    assert [(f.kind, f.where) for f in found] == [
        ("spike", "gyroscope"),
        ("spike", "accelerometer"),
    ]
    assert all("from 3.32 s to 6.78 s" in f.message for f in found)


@pytest.mark.parametrize("name", ["adis16405-2", "adis16405-3"])
def test_coarse_counts_raise_no_false_alarm(real_data, name):
    assert check(real_data / name) == ([], [])


def test_adis_units(real_data):
    device = sensorbook.load(real_data / "adis16405-1")
    assert len(device.gyroscope.static) == 1_000_000
    assert np.linalg.norm(device.accelerometer.static.values.mean(axis=0)) == pytest.approx(
        9.965, abs=1e-3
    )
    run, done = device.gyroscope.static.evenly_sampled()
    assert (run, done) == (device.gyroscope.static, ())


def test_text_despite_its_name_with_a_jittering_clock(real_data):
    run = sensorbook.load(real_data / "xsens-mti").accelerometer.positions
    assert (len(run), run.gaps) == (51175, 0)
    assert run.rate == pytest.approx(100.01, abs=0.01)
    # The first rest, after the factory's nominal scale: within 5 % of gravity.
    assert np.linalg.norm(run.between(0, 20).values.mean(axis=0)) == pytest.approx(9.8, rel=0.2)


def test_thermal_runs(real_data):
    device = sensorbook.load(real_data / "cats-tag")
    runs = device.runs("gyroscope", "thermal")
    assert [len(run) for run in runs] == [92000, 91000]
    assert 4 < np.nanmin(runs[0].temperature) < np.nanmax(runs[0].temperature) < 17
    assert device.site["date"].year == 2021


def test_no_rate(real_data):
    device = sensorbook.load(real_data / "ck-mag-acc")
    field = np.linalg.norm(device.magnetometer.rotation.values, axis=1)
    assert field.std() / field.mean() == pytest.approx(0.3195, abs=1e-4)
    assert device.accelerometer.rotation.rate is None


def test_reference_attitude(real_data):
    reference = sensorbook.load(real_data / "broad-slow").reference.trajectory
    norm = np.linalg.norm(reference.values, axis=1)
    assert reference.values.shape == (5324, 4)
    np.testing.assert_allclose(norm[np.isfinite(norm)], 1, atol=1e-2)
    assert reference.declaration["quaternion"] == "body_to_reference"


def test_matlab_v73(real_data):
    run = sensorbook.load(real_data / "sunsided-tilt-sphere").magnetometer.rotation
    length = np.linalg.norm(run.values, axis=1)
    assert length.std() / length.mean() == pytest.approx(0.205, abs=5e-4)
