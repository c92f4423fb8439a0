"""What an agreement of a gyroscope and a reference says: notes, warnings, or why it cannot be used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.agreement import Agreement, agreement
from sensorbook.attitude.agreement_fit import orthogonal_part
from sensorbook.attitude.propagation import propagate, rotation_increments
from sensorbook.attitude.windows import breaks
from sensorbook.errors import InputError, Problem, Refusal

_AXES = "xyz"
_ALIKE = np.radians(5)  # misalignment up to which axes are taken for the same
_MENTIONED = np.radians(0.5)
_ORDER = np.radians(20)  # the same, where the numbers of a quaternion are in another order
_SURE = 4.0  # standard errors: over some 30 windows, 3 are passed by chance too often
_UNIT = 1.5  # factor from which on a scale is a wrong unit
_DEGREE = 180 / np.pi
_TURNS = np.radians(1)  # of the readings in a window, from which on they turn
_MUCH = 10.0  # times the reference's turn, from which on that does not move
_APART = 0.1  # rad a window, which noise alone is not
_SHOWN = 3  # breaks that are told one by one
_VECTORS = (
    "See the axes and signs that accelerometer and magnetometer are declared with, and their "
    'calibration: for the magnetometer a recording of kind = "rotation".'
)
# What was read as x, y, z, w → what it is, for a file whose columns were declared in the other order.
_ORDERS = {"x, y, z, w": [3, 0, 1, 2], "w, x, y, z": [1, 2, 3, 0]}


def judge(
    found: Agreement,
    time: ArrayLike,
    rate: ArrayLike,
    at: ArrayLike,
    quaternion: ArrayLike,
    lost: ArrayLike | None = None,
    file: str = "device.toml",
    name: str = "reference",
) -> tuple[str, ...]:
    """Sentences on what was found, for a page's warnings; empty where all is well.

    Parameters
    ----------
    found : what `agreement` made of the other parameters
    file : name of the file whose declarations are to be mended
    name : what tells the attitude: reference, camera, or gravity and field

    Raises
    ------
    InputError
        the quaternions turn the other way or are in another order, the gyroscope's unit is wrong, an
        axis has the wrong sign
    Refusal
        the two do not tell of the same motion, or in axes that differ by more than 5°; and whatever
        gravity and field may have wrong themselves
    """
    source = _Source(name)
    if np.isnan(found.turn):
        return (
            f"There are too few {source.attitudes} to tell the readings' delay; it is taken as 0.",
        )
    if found.explained < 0.5 and found.own_turn > max(_TURNS, _MUCH * found.turn):
        raise Refusal(
            f"{source.The} {source.do} not move while the gyroscope turns: by "
            f"{np.degrees(found.turn):.2g}° rms in windows of {found.span:.2g} s, the gyroscope by "
            f"{np.degrees(found.own_turn):.2g}°.",
            source.remedy(f"See whether {source.the} was tracking."),
        )
    if not found.moved:
        if found.explained >= 0.5:
            return (
                "The body turns, but its rates hardly change: that tells neither the readings' delay "
                "nor scale and axes; the delay is taken as 0.",
            )
        if found.turn < _APART or found.own_turn < _TURNS:
            return ("There is too little motion to tell the readings' delay; it is taken as 0.",)
    if name == "reference":
        _check_quaternions(found, time, rate, at, quaternion, lost, file)
    if not agrees(found):
        raise Refusal(
            (
                "Gravity and field do not tell of the same motion as the gyroscope: "
                if source.vectors
                else f"The gyroscope and {source.the} do not tell of the same motion: "
            )
            + f"only {max(found.explained, 0.0):.0%} of how {source.the} {source.turn} follows from "
            "the rates.",
            source.remedy("Give recordings of one body with one clock (within 2 s)."),
        )
    _check_unit(found, file, source)
    _check_axes(found, file, source)
    return _notes(found, source) + _breaks(found, time, rate, at, quaternion, lost, source)


@dataclass(frozen=True)
class _Source:
    """Words for what tells the attitude; gravity and field are two."""

    name: str

    @property
    def vectors(self) -> bool:
        return self.name == "gravity and field"

    @property
    def the(self) -> str:
        return self.name if self.vectors else f"the {self.name}"

    @property
    def The(self) -> str:
        return self.the[0].upper() + self.the[1:]

    @property
    def attitudes(self) -> str:
        return "references" if self.name == "reference" else f"attitudes from {self.the}"

    @property
    def do(self) -> str:
        return "do" if self.vectors else "does"

    def verb(self, word: str) -> str:
        return word if self.vectors else word + "s"

    @property
    def turn(self) -> str:
        return self.verb("turn")

    def remedy(self, other: str) -> str:
        """`other`, but of accelerometer and magnetometer where these tell the attitude."""
        return _VECTORS if self.vectors else other


def agrees(found: Agreement) -> bool:
    """Whether the reference turns as the gyroscope says, be it in other axes or another unit.

    A noisy reference leaves little of itself explained: then a fit near M = I will do, which chance
    does not give.
    """
    near = abs(found.scale - 1) < 0.3 and found.angle < np.radians(15) and not found.mirrored
    return found.explained >= 0.5 or (near and found.scale_std < 0.15 and found.explained > 0.1)


def _check_quaternions(found: Agreement, time, rate, at, quaternion, lost, file: str) -> None:
    """Raise where the inverse rotation, or another order of the four, fits and this does not."""
    # An inverse rotation between such motions turns M into −R, which is never near I.
    near = abs(found.scale - 1) < 0.1 and found.scale_std < 0.05
    if _straight(found, _ALIKE) and (near or found.explained > 0.99):
        return
    quaternion = np.asarray(quaternion, dtype=float)
    inverse = agreement(time, rate, at, quaternion * [-1, -1, -1, 1], lost, trial=True)
    if not _rather(inverse, found, _ALIKE):
        return
    if not _straight(inverse, _ORDER):
        # Cyclic shifts of the four numbers are an inverse rotation between other axes.
        for order, columns in _ORDERS.items():
            for sign in ([1, 1, 1, 1], [-1, -1, -1, 1]):
                shifted = agreement(
                    time, rate, at, (quaternion * sign)[:, columns], lost, trial=True
                )
                if shifted.explained > 0.9 and _straight(shifted, _ORDER):
                    raise InputError(
                        Problem(
                            file,
                            "[[recording]] reference: columns",
                            "the quaternion's four numbers are not in the order declared: "
                            f"{shifted.explained:.1%} of the motion agrees with the gyroscope when "
                            f"they are read as {order}",
                            f"name the columns of w, x, y and z: the file holds them as {order}",
                        )
                    )
    raise InputError(
        Problem(
            file,
            "[[recording]] reference: quaternion",
            f"the reference turns the other way: {max(found.explained, 0.0):.1%} of its motion agrees "
            f"with the gyroscope as declared, {inverse.explained:.1%} as the inverse rotation",
            'write quaternion = "reference_to_body" where it says "body_to_reference", or the reverse'
            + (
                "; or, as the body turned about one axis only, the gyroscope has the wrong sign there"
                if len(found.directions) == 1
                else ""
            ),
        )
    )


def _straight(found: Agreement, angle: float) -> bool:
    return not found.mirrored and found.angle < angle + _SURE * found.angle_std


def _rather(other: Agreement, found: Agreement, angle: float) -> bool:
    """Whether the other leaves less than half as much, or as much between axes that agree better."""
    if other.explained < 0.5 or not other.moved:
        return False
    if 1 - other.explained < 0.5 * (1 - found.explained):
        return True
    as_good = 1 - other.explained < 1.2 * (1 - found.explained)
    return as_good and _straight(other, angle) and not _straight(found, angle)


def _check_unit(found: Agreement, file: str, source: _Source) -> None:
    factor = 1 / found.scale
    if 1 / _UNIT < factor < _UNIT or abs(found.scale - 1) < _SURE * found.scale_std:
        return
    near = max(0.03, _SURE * found.scale_std / found.scale)
    mend = ""
    for unit, size in (("deg/s", _DEGREE), ("rad/s", 1 / _DEGREE)):
        if abs(factor / size - 1) < (0.03 if source.vectors else near):
            other = "rad/s" if unit == "deg/s" else "deg/s"
            mend = f'write unit = "{unit}": the rates are declared as {other} and are in {unit}'
    for part, size in (("thousandths", 1000.0), ("a thousand", 1 / 1000)):
        if abs(factor / size - 1) < (0.03 if source.vectors else near):
            mend = f"mend the unit or the scale of the gyroscope: it is {part} of what is declared"
    if source.vectors and not mend:
        raise Refusal(
            f"The rates are {factor:.4g} times those that gravity and field turn with.", _VECTORS
        )
    raise InputError(
        Problem(
            file,
            "[[recording]] gyroscope: unit",
            f"the rates are {factor:.4g} times those that {source.the} {source.turn} with",
            mend or "mend the unit or the scale of the gyroscope",
        )
    )


def _check_axes(found: Agreement, file: str, source: _Source) -> None:
    matrix = found.matrix / found.scale
    axes = _nearest_axes(matrix)
    named = ", ".join(_signed(axes[i]) for i in range(3))
    if found.mirrored:
        _mirrored(axes, named, file, source)
    if found.angle <= max(_ALIKE + 2 * found.angle_std, _SURE * found.angle_std):
        return
    if len(found.directions) == 1:
        own, other = found.directions[0], matrix @ found.directions[0]
        raise Refusal(
            f"The axis that the body turned about most is {_vector(own)} in the gyroscope's axes and "
            f"{_vector(other)} in those of {source.the}, {np.degrees(found.angle):.1f}° apart.",
            source.remedy(
                f"Give {source.the} in the gyroscope's axes, turned by how it is mounted."
            ),
        )
    axis = found.misalignment / found.angle
    left = np.arccos(np.clip((np.trace(axes.T @ orthogonal_part(matrix)) - 1) / 2, -1, 1))
    near = not np.array_equal(axes, np.eye(3)) and left < np.radians(10)
    remedy = (
        f"The {source.name}'s x, y, z are nearly the gyroscope's {named}: give columns and signs so."
        if near
        else f"Give {source.the} in the gyroscope's axes, turned by how it is mounted."
    )
    if source.name == "reference" and near and named in ("z, y, −x", "z, −y, x"):
        # So do inverse rotations look whose x, y, z, w is read as w, x, y, z, and the reverse.
        remedy += (
            " Or its four numbers are in another order than declared: see whether w is the first."
        )
    raise Refusal(
        f"The body axes of {source.the} are turned by {np.degrees(found.angle):.1f}° about "
        f"{_vector(axis)} against the gyroscope's.",
        (f"Their x, y, z are nearly the gyroscope's {named}. " if near else "") + _VECTORS
        if source.vectors
        else remedy,
    )


def _mirrored(axes: np.ndarray, named: str, file: str, source: _Source) -> None:
    """Raise what M's nearest axes, left-handed ones, say of the gyroscope's columns."""
    order = [_AXES[i] for i in np.abs(axes).argmax(axis=1)]
    factor = [int(row.sum()) for row in axes]
    turned = [axis for axis, sign in zip(order, factor, strict=True) if sign < 0]
    exchanged = order != list(_AXES)
    if source.vectors:
        raise Refusal(
            "A mirrored axis: the x, y, z of gravity and field are nearly the gyroscope's "
            f"{named}, which no turn brings about.",
            _VECTORS,
        )
    if exchanged:
        what = f"the {source.name}'s x, y, z are its {named}"
    elif len(turned) == 1:
        what = f"against {source.the} its {turned[0]} has the wrong sign"
    else:
        what = f"against {source.the} its x, y and z all have the wrong sign"
    mends = [f"name the columns in the order {', '.join(order)}"] if exchanged else []
    if turned:
        mends.append(
            f"negate the column{'s' * (len(turned) > 1)} {', '.join(turned)}, or declare unit = "
            f'"counts" with scale = {{ factor = {factor}, unit = "<the file\'s unit>" }}'
        )
    raise InputError(
        Problem(
            file,
            "[[recording]] gyroscope: columns",
            f"a mirrored axis: {what}",
            " and ".join(mends),
        )
    )


def _nearest_axes(matrix: np.ndarray) -> np.ndarray:
    """The matrix of signed axes with the same handedness that is nearest to M (3, 3)."""
    best, most = np.eye(3), -np.inf
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in np.ndindex(2, 2, 2):
            axes = np.eye(3)[list(order)] * (1 - 2 * np.array(signs))[:, None]
            if np.linalg.det(axes) * np.linalg.det(matrix) > 0 and (axes * matrix).sum() > most:
                best, most = axes, (axes * matrix).sum()
    return best


def _signed(row: np.ndarray) -> str:
    return ("−" if row.sum() < 0 else "") + _AXES[int(np.abs(row).argmax())]


def _vector(axis: np.ndarray) -> str:
    """With two decimals, none of them −0.00."""
    return "(" + ", ".join(f"{round(float(a), 2) + 0.0:.2f}" for a in axis).replace("-", "−") + ")"


def _rough(value: float) -> str:
    """One digit, no power of ten."""
    return f"{float(f'{value:.1g}'):f}".rstrip("0").rstrip(".")


def _notes(found: Agreement, source: _Source) -> tuple[str, ...]:
    notes = []
    if not np.isfinite(found.delay_std):
        notes.append(
            f"The rates' change, against the noise of {source.the} and their own, is too little to tell "
            "the readings' delay; it is taken as 0."
        )
    elif abs(found.delay) > max(1.5 * found.interval, _SURE * found.delay_std):
        late = "later" if found.delay > 0 else "earlier"
        notes.append(
            f"The clocks of gyroscope and {source.name} differ: the readings are stamped "
            f"{abs(found.delay) * 1e3:.0f} ± {_rough(1.96 * found.delay_std * 1e3)} ms {late} than "
            f"{source.the}; this is taken into account."
        )
    if found.one_axis:
        notes.append(
            f"The body turned about one axis only, {_vector(found.directions[0])}: scale and axes are "
            "known about it alone."
        )
    if found.angle > max(_MENTIONED, _SURE * found.angle_std):
        notes.append(
            f"The body axes of {source.the} are turned by {np.degrees(found.angle):.2f}° against the "
            "gyroscope's, which stays in the errors."
        )
    if abs(found.scale - 1) > max(0.02, _SURE * found.scale_std):
        notes.append(
            f"{source.The} {source.turn} {found.scale:.3f} times as far as the gyroscope says "
            f"(± {_rough(1.96 * found.scale_std)}): a scale factor that stays in the errors."
        )
    return tuple(notes)


def _breaks(found, time, rate, at, quaternion, lost, source: _Source) -> tuple[str, ...]:
    """Where what tells the attitude jumps or is frozen, by seconds after the first reading."""
    body = (np.asarray(rate, dtype=float) - found.bias) @ found.matrix.T
    turned = propagate(rotation_increments(time, body, found.delay), [0, 0, 0, 1])[at]
    notes = []
    every = breaks(time, at, quaternion, turned, lost)
    for each in every[:_SHOWN]:
        start, end = (f"{at - time[0]:.1f} s" for at in (each.start, each.end))
        when = start if start == end else f"{start} to {end}"
        notes.append(
            f"{source.The} {source.verb('jump')} by {np.degrees(each.angle):.1f}° against the "
            f"gyroscope, {when} after the start."
            if each.angle
            else f"{source.The} {'are' if source.vectors else 'is'} frozen from {start} to {end} "
            "after the start, while the gyroscope turns."
        )
    if len(every) > _SHOWN:
        notes.append(f"So it is {len(every) - _SHOWN} times more.")
    return tuple(notes)
