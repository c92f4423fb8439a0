"""ROS messages of sensors as columns: what their bytes hold, in ROS 1's serialization and in CDR.

Each type is a header (stamp, name of a frame) followed by numbers alone, so that messages are decoded
many at a time. Definitions: sensor_msgs 1.13 (ROS 1) and 4.2 (ROS 2), which agree; CDR: OMG DDS-XTypes
1.3, 7.4.3, with the alignment of version 1, as ROS 2 writes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """A field of a message: where its numbers stand among the doubles that follow the header.

    Attributes
    ----------
    name : as in the definition
    axes : of its columns, "" for a single number
    first : index of its first double
    unit : SI, "" for none
    covariance : index of the first double of its covariance, −1 there where it is not given (REP 145)
    """

    name: str
    axes: str
    first: int
    unit: str
    covariance: int | None = None

    @property
    def columns(self) -> tuple[tuple[str, int], ...]:
        """Name and index of the double, of each of its columns."""
        if not self.axes:
            return ((self.name, self.first),)
        return tuple((f"{self.name}.{axis}", self.first + k) for k, axis in enumerate(self.axes))


@dataclass(frozen=True)
class Layout:
    """A type of message: the number of doubles after the header, and its fields."""

    doubles: int
    fields: tuple[Field, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns; those of time last."""
        return (*(name for field in self.fields for name, _ in field.columns), "stamp", "received")

    @property
    def units(self) -> tuple[str, ...]:
        """Of the columns; times count from where the clock does, mostly 1970."""
        return (*(field.unit for field in self.fields for _ in field.columns), "ns", "ns")


LAYOUTS = {
    "sensor_msgs/Imu": Layout(37, (
        Field("orientation", "xyzw", 0, "", 4),
        Field("angular_velocity", "xyz", 13, "rad/s", 16),
        Field("linear_acceleration", "xyz", 25, "m/s^2", 28),
    )),
    "sensor_msgs/MagneticField": Layout(12, (Field("magnetic_field", "xyz", 0, "T"),)),
    "sensor_msgs/Temperature": Layout(2, (Field("temperature", "", 0, "degC"),)),
}  # fmt: skip

ENCODINGS = ("ros1", "cdr")
# bytes: sequence number (ROS 1) or encapsulation (CDR), seconds, nanoseconds, length of the frame's name
_HEADER = 16


class LayoutError(ValueError):
    """A message that is not of its type's layout; `row` is the 0-based index of the first."""

    def __init__(self, row: int):
        self.row = row
        super().__init__(f"message {row + 1}")


def decode(layout: Layout, encoding: str, payloads: Sequence[bytes]) -> list[np.ndarray]:
    """The columns of `layout` but for the last, each (N,), of N messages.

    Numbers are float64 to the bit, NaN where the message says that their field is not given; the
    stamp is int64, ns. Raises `LayoutError` where a message is not as its type and encoding say.
    """
    lengths = np.fromiter(map(len, payloads), np.int64, len(payloads))
    stamp = np.empty(len(payloads), np.int64)
    numbers = np.empty((len(payloads), layout.doubles))
    wrong = lengths < _HEADER + 8 * layout.doubles
    # The name of the frame may change, and the length of the message with it.
    for length in np.unique(lengths[~wrong]):
        rows = np.flatnonzero(lengths == length)
        raw = np.frombuffer(b"".join([payloads[row] for row in rows]), np.uint8)
        raw = raw.reshape(len(rows), length)
        order, known = "<", np.ones(len(rows), dtype=bool)
        if encoding == "cdr":  # the second byte tells the order of all others
            order = "<" if raw[0, 1] else ">"
            known = (raw[:, 0] == 0) & (raw[:, 1] == (order == "<"))
        head = raw[:, :_HEADER].copy().view(order + "u4").astype(np.int64)
        size = _HEADER + head[:, 3]
        if encoding == "cdr":  # doubles are aligned, counted from after its own four bytes
            size = 4 + (size + 3) // 8 * 8
        known &= size + 8 * layout.doubles == length
        wrong[rows] = ~known
        seconds = head[:, 1]
        if encoding == "cdr":  # signed there
            seconds = seconds.astype(np.int32).astype(np.int64)
        stamp[rows] = seconds * 1_000_000_000 + head[:, 2]
        numbers[rows] = raw[:, length - 8 * layout.doubles :].copy().view(order + "f8")
    if wrong.any():
        raise LayoutError(int(np.argmax(wrong)))
    for field in layout.fields:
        if field.covariance is not None:
            absent = numbers[:, field.covariance] == -1
            numbers[np.ix_(absent, [k for _, k in field.columns])] = np.nan
    return [*(numbers[:, k] for field in layout.fields for _, k in field.columns), stamp]
