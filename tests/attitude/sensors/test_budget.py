"""Table 3.1 of work C, measured."""

import numpy as np
import pytest

from sensorbook.attitude.sensors.budget import CONTRIBUTIONS, TABLE, accuracies


@pytest.fixture(scope="module")
def found():
    return {a.sensor: a for a in accuracies(seed=11, samples=600)}


def test_every_sensor_of_the_table_is_of_its_order(found):
    assert set(found) == set(TABLE)
    for accuracy in found.values():
        assert 0.3 < accuracy.ratio < 3, accuracy
        assert accuracy.refused < 0.05


def test_contributions_add_in_squares(found):
    """They are independent and small; what is systematic adds otherwise, hence the width."""
    for accuracy in found.values():
        squares = np.sqrt(sum(v**2 for v in accuracy.alone.values()))
        assert accuracy.together == pytest.approx(squares, rel=0.15)
        assert accuracy.together > max(accuracy.alone.values())


def test_sizes_are_what_they_say(found):
    sun, field = found["Sun sensor"].alone, found["magnetometer"].alone
    assert sun["alignment"] == pytest.approx(0.5 / 60 * np.pi / 180, rel=0.1)
    assert field["alignment"] == pytest.approx(np.radians(0.1), rel=0.1)
    # Every error of the field is a size over the same strengths.
    assert field["bias"] / field["noise"] == pytest.approx(10, rel=0.15)


def test_same_seed_same_figures():
    few = tuple(c for c in CONTRIBUTIONS if c.sensor != "magnetometer")
    one, other = accuracies(5, 50, contributions=few), accuracies(5, 50, contributions=few)
    assert [a.together for a in one] == [a.together for a in other]
    assert len(one) == 3


def test_too_few_samples():
    with pytest.raises(ValueError, match="samples is 3"):
        accuracies(samples=3)
