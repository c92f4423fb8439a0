"""What is measured of round trips: C's formulas as printed, and how their errors grow."""

import numpy as np
import pytest

from sensorbook.attitude import round_trips
from sensorbook.attitude.rotations import SEQUENCES, lock_margin, matrix_from_euler


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_printed_euler_is_right_far_from_the_lock(sequence):
    rng = np.random.default_rng(30)
    angles = rng.uniform(-np.pi, np.pi, (200, 3))
    middle = np.pi / 2 if sequence[0] == sequence[2] else 0.0
    angles[:, 1] = middle + rng.uniform(-1, 1, 200)
    found = round_trips.printed_euler(sequence, matrix_from_euler(sequence, angles))
    assert np.abs(found - angles).max() < 2e-15


def test_printed_euler_is_2_20():
    a = matrix_from_euler("ZXZ", [0.3, 0.7, -1.1])
    expected = [np.arctan2(a[2, 0], -a[2, 1]), np.arccos(a[2, 2]), np.arctan2(a[0, 2], a[1, 2])]
    assert round_trips.printed_euler("ZXZ", a).tolist() == expected


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_printed_euler_errs_as_rounding_over_the_distance(sequence):
    trip = round_trips.euler_round_trip(sequence, seed=31)
    growing = (trip.distance < 0.02) & (trip.distance > 1e-14)
    product = trip.printed[growing] * trip.distance[growing]
    assert ((product > 1e-17) & (product < 4e-15)).all()
    assert trip.printed[-1] > 1  # nothing is left at 1e-16
    assert trip.ours.max() < 5e-15  # within 8 ε, 1.8e-15, of the lock it counts as locked
    assert 1e-9 < trip.half_lost < 3e-7


def test_printed_quaternion_divides_by_nothing():
    trip = round_trips.quaternion_round_trip(seed=32)
    assert trip.printed[0] < 3e-15
    assert (trip.printed[trip.distance < 1e-8] == np.pi).all()
    assert trip.ours.max() < 3e-15


def test_arccosine_loses_half_the_digits():
    trip = round_trips.angle_round_trip(seed=33)
    small = trip.distance < 1e-9
    # √(2 ε) = 2e-8 is the least step of an arccosine next to 1.
    assert ((trip.printed[small] > 1e-8) & (trip.printed[small] < 1e-7)).all()
    assert trip.ours.max() < 2e-15


def test_half_lost_is_none_where_nothing_is():
    flat = round_trips.RoundTrip(np.array([1.0, 0.1]), np.array([1e-16, 1e-9]), np.zeros(2))
    assert flat.half_lost is None


@pytest.mark.parametrize("sequence", ["ZYX", "ZXZ", "XZY"])
def test_amplification_is_one_over_the_margin(sequence):
    second = np.radians([20, 45, 70, 80])
    error = round_trips.amplification(sequence, second, 1e-4, seed=34)
    angles = np.zeros((4, 3))
    angles[:, 1] = second
    expected = 1e-4 / lock_margin(sequence, angles)
    # 400 attitudes know a standard deviation to 3.5 %; three times that.
    assert error[:, 0] == pytest.approx(expected, rel=0.11)
    assert error[:, 2] == pytest.approx(expected, rel=0.11)
    assert error[:, 1] == pytest.approx(1e-4, rel=0.11)
