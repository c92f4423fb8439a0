"""What directions determine; refusal measured both ways."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensorbook.calibration.coverage import STANDARD, coverage, distinct, positions_to_add
from sensorbook.calibration.model import FREE
from sensorbook.calibration.multi_position import enough

from .sets import EIGHTEEN, FACES, by_hand

NINE = FREE[9]


def test_the_cube_has_26_directions():
    assert len(STANDARD) == 26
    assert STANDARD["x up"] == pytest.approx([1, 0, 0])
    assert STANDARD["x up/z down"] == pytest.approx([0.5**0.5, 0, -(0.5**0.5)])


def test_condition_of_the_18_positions():
    """By hand: in the basis of matrix entries and biases the columns are orthogonal but for the three
    squares; the figure is that of numpy's SVD of the written-out design."""
    x, y, z = EIGHTEEN.T
    design = np.c_[x * x, y * x, y * y, z * x, z * y, z * z, x, y, z]
    assert coverage(EIGHTEEN, NINE).condition == pytest.approx(np.linalg.cond(design), rel=1e-9)


def test_distinct_directions():
    near = np.array([[0, 0, 1.0], [0, np.sin(0.1), np.cos(0.1)], [0, 1, 0]])
    assert distinct(near) == 2  # 5.7° apart is one
    assert distinct(FACES) == 6


ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)
ILL = {
    "six faces": FACES,
    "six faces, one twice": np.vstack([FACES, FACES[:1]]),
    "six faces four times": np.tile(FACES, (4, 1)),
    "three": FACES[[0, 2, 4]],
    "one, often": np.tile([[0, 0, 1.0]], (20, 1)),
    "a ring": np.c_[np.cos(ring), np.sin(ring), 0 * ring],
    "a cone of 40°": np.c_[np.cos(ring) * np.sin(0.7), np.sin(ring) * np.sin(0.7), np.cos(0.7) + 0 * ring],
    "all upward": EIGHTEEN[EIGHTEEN[:, 2] > 0.1],
    "eight": EIGHTEEN[:8],
}  # fmt: skip


@pytest.mark.parametrize("name", ILL)
@pytest.mark.parametrize("seed", range(5))
def test_ill_posed_sets_are_refused_also_when_placed_by_hand(name, seed):
    directions = by_hand(ILL[name], 3.0, np.random.default_rng([seed, 1]))
    assert not enough()(coverage(directions, NINE))


def test_well_posed_sets_are_not():
    """18 faces and edges missed by 5°, and 18 directions anywhere on the sphere: at most 1 % refused."""
    rng = np.random.default_rng(2)
    refused = 0
    for k in range(200):
        placed = by_hand(EIGHTEEN, 5.0, rng)
        anywhere = Rotation.random(18, rng=np.random.default_rng([k, 3])).apply([0, 0, 1.0])
        refused += sum(not enough()(coverage(u, NINE)) for u in (placed, anywhere))
    assert refused <= 4


@pytest.mark.parametrize("name", ILL)
def test_the_positions_to_add_make_it_enough(name):
    add = positions_to_add(ILL[name], NINE, enough())
    assert 0 < len(add) <= 15
    whole = np.vstack([ILL[name], *(STANDARD[n] for n in add)])
    assert enough()(coverage(whole, NINE))


def test_what_is_enough_needs_nothing():
    assert positions_to_add(EIGHTEEN, NINE, enough()) == []
