"""What an agreement of a gyroscope and a reference says: notes, warnings, or why it cannot be used."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sensorbook.attitude.agreement import Agreement, agreement, orthogonal_part
from sensorbook.errors import InputError, Problem, Refusal

_AXES = "xyz"
_ALIKE = np.radians(5)  # misalignment up to which axes are taken for the same
_MENTIONED = np.radians(0.5)
_ORDER = np.radians(20)  # the same, where the numbers of a quaternion are in another order
_SURE = 4.0  # standard errors: over some 30 windows, 3 are passed by chance too often
_UNIT = 1.5  # factor from which on a scale is a wrong unit
_DEGREE = 180 / np.pi
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
) -> tuple[str, ...]:
    """Sentences on what was found, for a page's warnings; empty where all is well.

    Parameters
    ----------
    found : what `agreement` made of the other parameters
    file : name of the file whose declarations are to be mended

    Raises
    ------
    InputError
        the quaternions turn the other way or are in another order, the gyroscope's unit is wrong, an
        axis has the wrong sign
    Refusal
        the two do not tell of the same motion, or in axes that differ by more than 5°
    """
    if np.isnan(found.turn):
        return ("There are too few references to tell the readings' delay; it is taken as 0.",)
    if not found.moved:
        return ("There is too little motion to tell the readings' delay; it is taken as 0.",)
    _check_quaternions(found, time, rate, at, quaternion, lost, file)
    if not agrees(found):
        raise Refusal(
            "The gyroscope and the reference do not tell of the same motion: only "
            f"{max(found.explained, 0.0):.0%} of how the reference turns follows from the rates.",
            "Give recordings of one body with one clock (within 2 s).",
        )
    _check_unit(found, file)
    _check_axes(found, file)
    return _notes(found)


def agrees(found: Agreement) -> bool:
    """Whether the reference turns as the gyroscope says, be it in other axes or another unit.

    A noisy reference leaves little of itself explained: then a fit near M = I will do, which chance
    does not give.
    """
    near = abs(found.scale - 1) < 0.3 and found.angle < np.radians(15) and not found.mirrored
    return found.explained >= 0.5 or (near and found.scale_std < 0.15 and found.explained > 0.1)


def _check_quaternions(found: Agreement, time, rate, at, quaternion, lost, file: str) -> None:
    """Raise where the inverse rotation, or another order of the four, fits and this does not."""
    if found.explained > 0.99 and _straight(found, _ALIKE):
        return
    quaternion = np.asarray(quaternion, dtype=float)
    inverse = agreement(time, rate, at, quaternion * [-1, -1, -1, 1], lost)
    if not _rather(inverse, found, _ALIKE):
        return
    if not _straight(inverse, _ORDER):
        # Cyclic shifts of the four numbers are an inverse rotation between other axes.
        for order, columns in _ORDERS.items():
            for sign in ([1, 1, 1, 1], [-1, -1, -1, 1]):
                shifted = agreement(time, rate, at, (quaternion * sign)[:, columns], lost)
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
            'write quaternion = "reference_to_body" where it says "body_to_reference", or the reverse',
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


def _check_unit(found: Agreement, file: str) -> None:
    factor = 1 / found.scale
    if 1 / _UNIT < factor < _UNIT or abs(found.scale - 1) < _SURE * found.scale_std:
        return
    mend = "mend the unit or the scale of the gyroscope"
    for unit, size in (("deg/s", _DEGREE), ("rad/s", 1 / _DEGREE)):
        if abs(factor / size - 1) < max(0.03, _SURE * found.scale_std / found.scale):
            other = "rad/s" if unit == "deg/s" else "deg/s"
            mend = f'write unit = "{unit}": the rates are declared as {other} and are in {unit}'
    for unit, size in (("m", 1000.0), ("", 1 / 1000)):
        if abs(factor / size - 1) < max(0.03, _SURE * found.scale_std / found.scale):
            mend += f": it is {'thousandths' if unit else 'a thousand'} of what is declared"
    raise InputError(
        Problem(
            file,
            "[[recording]] gyroscope: unit",
            f"the rates are {factor:.4g} times those that the reference turns with",
            mend,
        )
    )


def _check_axes(found: Agreement, file: str) -> None:
    matrix = found.matrix / found.scale
    axes = _nearest_axes(matrix)
    named = ", ".join(_signed(axes[i]) for i in range(3))
    exchanged = np.abs(axes).argmax(axis=1).tolist() != [0, 1, 2]
    if found.mirrored:
        flipped = [_AXES[i] for i in range(3) if axes[i].sum() < 0]
        if np.linalg.det(axes) > 0:
            what = "its axes are a mirror image of the reference's"
        elif exchanged:
            what = f"the reference's x, y, z are its {named}"
        elif len(flipped) == 1:
            what = f"its {flipped[0]} has the wrong sign"
        else:
            what = "x, y and z all have the wrong sign"
        raise InputError(
            Problem(
                file,
                "[[recording]] gyroscope: columns",
                f"a mirrored axis: against the reference {what}",
                "name the columns in the right order, or turn a sign by scale = { factor = "
                '[1, 1, −1], unit = "rad/s" } with unit = "counts"'.replace("−", "-"),
            )
        )
    if found.angle <= max(_ALIKE + 2 * found.angle_std, _SURE * found.angle_std):
        return
    axis = found.misalignment / found.angle
    left = np.arccos(np.clip((np.trace(axes.T @ orthogonal_part(matrix)) - 1) / 2, -1, 1))
    near = not np.array_equal(axes, np.eye(3)) and left < np.radians(10)
    remedy = (
        f"The reference's x, y, z are nearly the gyroscope's {named}: give columns and signs so."
        if near
        else "Give the reference in the gyroscope's axes, turned by how it is mounted."
    )
    if near and named in ("z, y, −x", "z, −y, x"):
        # So do inverse rotations look whose x, y, z, w is read as w, x, y, z, and the reverse.
        remedy += (
            " Or its four numbers are in another order than declared: see whether w is the first."
        )
    raise Refusal(
        f"The reference's body axes are turned by {np.degrees(found.angle):.1f}° about "
        f"({', '.join(f'{a:.2f}' for a in axis)}) against the gyroscope's.",
        remedy,
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


def _notes(found: Agreement) -> tuple[str, ...]:
    notes = []
    if not np.isfinite(found.delay_std):
        notes.append("The rates change too little to tell the readings' delay; it is taken as 0.")
    elif abs(found.delay) > max(1.5 * found.interval, _SURE * found.delay_std):
        late = "later" if found.delay > 0 else "earlier"
        notes.append(
            f"The clocks of gyroscope and reference differ: the readings are stamped "
            f"{abs(found.delay) * 1e3:.0f} ± {1.96 * found.delay_std * 1e3:.1g} ms {late} than the "
            "reference's; this is taken into account."
        )
    if found.angle > max(_MENTIONED, _SURE * found.angle_std):
        notes.append(
            f"The reference's body axes are turned by {np.degrees(found.angle):.2f}° against the "
            "gyroscope's, which stays in the errors."
        )
    if abs(found.scale - 1) > max(0.02, _SURE * found.scale_std):
        notes.append(
            f"The reference turns {found.scale:.3f} times as far as the gyroscope says "
            f"(± {1.96 * found.scale_std:.1g}): a scale factor that stays in the errors."
        )
    return tuple(notes)
