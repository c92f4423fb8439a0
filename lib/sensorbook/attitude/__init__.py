"""Attitude: representations, frames, sensors, and attitude from vectors (work C, chapters 2 and 3)."""

from sensorbook.attitude.observations import Solution
from sensorbook.attitude.vectors import davenport, davenport_power, quest, svd, triad, two_vector

__all__ = ["Solution", "davenport", "davenport_power", "quest", "svd", "triad", "two_vector"]
