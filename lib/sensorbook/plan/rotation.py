"""How long to turn a magnetometer through all attitudes for a hard and soft iron of a wanted accuracy.

Fisher's information of the ellipsoid ``‖S (m − h)‖ = F`` (A 6.1–6.4; `magnetometer.ellipsoid.design`) from
directions spread evenly over the sphere, with the readings' white noise and what the field itself changes
along the hand's path, which is alike for seconds and lowers the number of readings that count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sensorbook.magnetometer.coverage import IDEAL, effects, even_directions
from sensorbook.magnetometer.ellipsoid import design
from sensorbook.magnetometer.uncertainty import MOST_BLOCKS
from sensorbook.noise.model import NoiseTerms

FIELD = 48e-6  # T, of middle latitudes
# A hand moves by some 4 cm, in a room with a gradient of 2 µT/m: 0.2 % of the field, and alike for about as
# long as it turns one way, s.
SURROUNDINGS, ALIKE = 0.002, 1.2
LOOK = 1.0  # s, after which a hand has turned to a new direction
SECONDS = (60.0, 90.0, 120.0, 180.0, 240.0, 300.0, 420.0, 600.0, 900.0, 1200.0, 1800.0)
QUANTITIES = ("hard_iron", "soft_iron", "direction")


@dataclass(frozen=True)
class Rotation:
    """A turn through all attitudes, and what it tells.

    Attributes
    ----------
    seconds : s
    std : expected standard error by quantity: hard iron (T) and soft iron (relative, for a determinant of
        1) of the worst axis, direction of a corrected reading (rad, the whole angle, rms of all directions)
    """

    seconds: float
    std: dict[str, float]

    @property
    def half(self) -> dict[str, float]:
        """Half of each 95 % interval, by Student's t of the chapter's jackknife."""
        t = float(stats.t.ppf(0.975, MOST_BLOCKS - 1))
        return {quantity: t * std for quantity, std in self.std.items()}


def rotation(
    terms: dict[str, NoiseTerms],
    seconds: float,
    field: float = FIELD,
    surroundings: float = SURROUNDINGS,
) -> Rotation:
    """What `seconds` of turning tell; `field` T, `surroundings` rms of the field's strength over it."""
    white = max(t.random_walk for t in terms.values()) / field
    density = (
        white**2 + surroundings**2 * ALIKE
    )  # two-sided, of one reading's length over the field
    u = even_directions()
    a = design(u, u, IDEAL)
    # Of n directions at random the inverse information of nine parameters is n/(n − 10) times that of even
    # ones, as that of a Wishart matrix is.
    looks = seconds / LOOK
    uneven = looks / (looks - 10)
    covariance = np.linalg.inv(a.T @ a / len(u)) * density / seconds * uneven
    unit = np.eye(9)
    unit[3:6, 3:6] -= 1 / 3  # a common factor is none of the soft iron
    relative = np.sqrt(np.diag(unit @ covariance @ unit.T))
    effect = effects(u)
    across = effect - u[:, :, None] * np.einsum("ni,nik->nk", u, effect)[:, None, :]
    angle = np.sqrt(np.einsum("nij,jk,nik->", across, covariance, across) / len(u))
    values = (relative[:3].max() * field, relative[3:].max(), angle)
    return Rotation(seconds, dict(zip(QUANTITIES, map(float, values), strict=True)))


def planned(quantity: str, within: float, terms: dict[str, NoiseTerms]) -> tuple[Rotation, bool]:
    """The shortest turn with a 95 % interval of ± `within` or less; else the longest, and False."""
    for seconds in SECONDS:
        found = rotation(terms, seconds)
        if found.half[quantity] <= within:
            return found, True
    return found, False
