"""Work C's correction with its (5.3) taken as it is printed, and how an attitude recovers from an outage."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from sensorbook.attitude.aiding import Attitudes, References
from sensorbook.attitude.correction import NOTHING, Meeting, corrected
from sensorbook.attitude.experiment import Run


def mixed_up(run: Run, references: References) -> Attitudes:
    """Work C's correction with the product (5.3) as printed, A_i A_aᵀ, on matrices body → reference.

    The difference is then in reference axes, and is taken out of the body's rates all the same. Its sign
    is set right here, so that the axes alone are mixed up.
    """
    return _corrected(run, references, lambda image, at: (at * image.inv()).as_rotvec())


def small_angles(run: Run, references: References) -> Attitudes:
    """Work C's correction with the elements of A_iᵀ A_a that (5.3) makes the angles, however large these are.

    With I + [Ω×] the elements (3, 2), (1, 3) and (2, 1) are Ω. Of a rotation by θ about the unit vector n
    they are n sin θ and, of each pair of axes, (1 − cos θ) n_i n_j more.
    """

    def elements(image: Rotation, at: Rotation) -> np.ndarray:
        matrix = (image.inv() * at).as_matrix()
        return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])

    return _corrected(run, references, elements)


def recovery(
    runs: Sequence[Run],
    method: Callable[[Run, References], Attitudes],
    rate: float,
    outage: Sequence[float],
    count: int = 4,
) -> np.ndarray:
    """(1 + count,) rad: the whole angle's error at an outage's end and after each reference that follows.

    Means over the runs, of a method that is given a run and references at `rate` (Hz); *after* is one
    step after a reference, when work C's correction has been made.
    """
    time, used = runs[0].motion.time, runs[0].at(rate, outage).at
    following = used[time[used] >= outage[1]][:count]
    told = np.r_[np.searchsorted(time, outage[1]) - 1, following + 1]
    each = [method(run, run.at(rate, outage)).errors(run.true)[told] for run in runs]
    return np.linalg.norm(each, axis=-1).mean(axis=0)


def _corrected(
    run: Run, references: References, difference: Callable[[Rotation, Rotation], np.ndarray]
) -> Attitudes:
    """The reset one step late, by Ω (3,) from the reference's rotation and the integrated one."""

    def late(meeting: Meeting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rotations = map(Rotation.from_quat, (meeting.reference, meeting.integrated))
        return NOTHING, -difference(*rotations), NOTHING

    return corrected(run.motion, references, late, False)
