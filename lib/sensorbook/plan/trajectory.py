"""How often a reference must come for an integrated attitude of a wanted accuracy.

The steady state of the Kalman filter that the chapter runs (`attitude.kalman`): of one axis, with N and K
of the gyroscope and a reference of a given standard error. Without K it is that of
`attitude.correction.steady_gain`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_are

from sensorbook.attitude.correction import steady_gain
from sensorbook.attitude.tuning import FEWEST
from sensorbook.noise.model import NoiseTerms
from sensorbook.recordings.advice import COARSE_TURN

REFERENCE = 0.5  # deg, standard error of a reference about each axis
TURNING = 30.0  # deg/s rms, of a device moved by hand
RATES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # Hz
SHORTEST = 120.0  # s: errors in motion come and go with it


@dataclass(frozen=True)
class Aided:
    """A reference at `rate` Hz, and the attitude it gives, of the worst axis.

    Attributes
    ----------
    before, after : rad, standard error about each axis just before and just after a reference
    """

    rate: float
    before: float
    after: float

    @property
    def seconds(self) -> float:
        """s, the shortest recording whose windows tell what a filter must know."""
        return max(SHORTEST, 2 * FEWEST / self.rate)


def aided(white: float, walk: float, reference: float, rate: float) -> Aided:
    """The settled filter: `white` rad/s/√Hz, `walk` rad/s/√s, `reference` rad, `rate` Hz.

    >>> found = aided(0.01, 0.0, 0.02, 1.0)
    >>> bool(np.isclose(found.after**2 / 0.02**2, steady_gain(0.01, 0.02, 1.0)))
    True
    """
    period = 1 / rate
    if walk == 0:
        after = np.sqrt(steady_gain(white, reference, period)) * reference
        return Aided(rate, float(np.hypot(after, white * np.sqrt(period))), float(after))
    # In units of the reference's error and of the bias that makes as much in a period.
    n, k = white * np.sqrt(period) / reference, walk * period**1.5 / reference
    forward = np.array([[1.0, -1.0], [0.0, 1.0]])
    noise = np.array([[n**2 + k**2 / 3, -(k**2) / 2], [-(k**2) / 2, k**2]])
    p = solve_discrete_are(forward.T, np.array([[1.0], [0.0]]), noise, np.eye(1))
    before = p[0, 0]
    return Aided(
        rate, float(np.sqrt(before) * reference), float(np.sqrt(before / (1 + before)) * reference)
    )


def density(terms: NoiseTerms, in_motion: float, turning: float) -> float:
    """N with what scale factors and timing err by at `turning` rad/s rms; rad/s/√Hz."""
    return float(np.hypot(terms.random_walk, in_motion * turning / np.sqrt(3)))


def sampling(turning: float) -> float:
    """Hz of the gyroscope at which coning stays small, by the advice on recordings."""
    return turning / COARSE_TURN


def planned(
    std: float, terms: dict[str, NoiseTerms], in_motion: float, turning: float, reference: float
) -> tuple[Aided, bool]:
    """The rarest reference with an error of `std` (rad) or less just before the next; else the most
    frequent, and False."""
    for rate in RATES:
        each = [
            aided(density(t, in_motion, turning), t.rate_random_walk, reference, rate)
            for t in set(terms.values())
        ]
        found = max(each, key=lambda a: a.before)
        if found.before <= std:
            return found, True
    return found, False
