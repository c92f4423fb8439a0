"""Magnetometers of real devices, turned by hand and not."""

import numpy as np
import pytest

import sensorbook
from sensorbook.earth import STANDARD_GRAVITY
from sensorbook.errors import Refusal
from sensorbook.magnetometer import calibrate, calibrate_rotation
from sensorbook.magnetometer.alignment import align, paired


def scatter(fit, m):
    """Standard deviation over mean of the corrected length of all readings, %."""
    length = np.linalg.norm(fit.correct(m), axis=1)
    return 100 * length.std() / length.mean()


@pytest.mark.parametrize(
    ("name", "fitted", "held_out"),
    [("ck-mag-acc", 1.26, 1.45), ("sunsided-tilt-sphere", 0.84, 1.1)],
)
def test_scatter_of_the_length(real_data, name, fitted, held_out):
    """Of readings that scatter by 32 and 20 % as they come."""
    run = sensorbook.load(real_data / name).magnetometer.rotation
    fit = calibrate_rotation(run)
    assert fit.method == "ellipsoid"
    assert not fit.field_known
    assert scatter(fit, run.values) <= fitted
    assert 100 * fit.residual_check <= held_out
    assert fit.residual <= fit.residual_check
    assert fit.used.mean() > 0.95


def test_dip_of_ck_mag_acc(real_data):
    device = sensorbook.load(real_data / "ck-mag-acc")
    run = device.magnetometer.rotation
    found = align(
        calibrate_rotation(run), *paired(run, device.accelerometer.rotation), STANDARD_GRAVITY
    )
    spreads = {stage: np.degrees(v) for stage, v in found.spreads.items()}
    assert found.determined
    assert spreads["aligned"] <= 3.0
    assert spreads["aligned"] <= spreads["calibrated"] < spreads["raw"]


@pytest.mark.parametrize("run", [0, 1])
def test_an_animal_tag_at_rest_is_refused(real_data, run):
    """Two thermal cycles, each in one attitude."""
    at_rest = sensorbook.load(real_data / "cats-tag").runs("magnetometer", "thermal")[run]
    with pytest.raises(Refusal) as caught:
        calibrate(at_rest.values[::50])
    assert "the device lay still" in caught.value.reason
    assert caught.value.remedy


def test_a_slow_turn_through_most_attitudes(real_data):
    """An experiment for attitude filters, its magnetometer calibrated before, in a dip of 70°."""
    device = sensorbook.load(real_data / "broad-slow")
    run = device.magnetometer.trajectory
    fit = calibrate(run.values)
    assert np.linalg.norm(fit.hard_iron) < 0.1 * fit.field
    assert scatter(fit, run.values) < 2.5
    found = align(fit, *paired(run, device.accelerometer.trajectory), STANDARD_GRAVITY)
    assert found.determined
    # A sensor whose triads its maker aligned; a fit of the dip's sine ends at 20° and a dip of 88°.
    assert np.degrees(np.linalg.norm(found.turn)) < 2
    assert np.degrees(found.dip) == pytest.approx(70, abs=1)
    assert found.spreads["aligned"] <= found.spreads["calibrated"]
