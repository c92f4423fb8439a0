"""A sweep reduced to means over short stretches of time, which is all a thermal fit needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensorbook.errors import Refusal

BLOCKS = (
    600  # a run: enough to follow a jump one twentieth of the range wide, few enough to be fast
)
LEAST_SPAN = 5.0  # °C; below, drift with time cannot be told from temperature
KNOCK = 5.0  # times the usual scatter within a block
BINS = 20  # temperature bins that share the weight evenly


@dataclass(frozen=True, eq=False)
class Sweep:
    """Block means of one or several runs, one after the other.

    Attributes
    ----------
    time : (M,) middle of each block, s
    temperature : (M,) °C
    values : (M, A) sensor signal, SI
    weight : (M,) so that each part of the temperature range counts alike
    run : (M,) index of the run
    direction : (M,) +1 heating, −1 cooling, 0 neither
    files : name of each run's file
    block_seconds : length of a block, s
    disturbed : blocks left out because the sensor was knocked or moved
    """

    time: np.ndarray
    temperature: np.ndarray
    values: np.ndarray
    weight: np.ndarray
    run: np.ndarray
    direction: np.ndarray
    files: tuple[str, ...]
    block_seconds: float
    disturbed: int

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest temperature, °C."""
        return float(self.temperature.min()), float(self.temperature.max())


def reduce_sweep(
    runs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], files: Sequence[str] = ()
) -> Sweep:
    """Means over blocks of equal duration, about 600 a run.

    Parameters
    ----------
    runs : (time (N,) s, temperature (N,) °C, values (N, A) SI) of each run; rows that are not finite
        are left out
    files : their names

    Raises
    ------
    Refusal
        the temperature moves by less than 5 °C, or fewer than 60 undisturbed blocks remain
    """
    parts, disturbed = [], 0
    for time, temperature, values in runs:
        good = np.isfinite(temperature) & np.isfinite(values).all(axis=1) & np.isfinite(time)
        part, knocked = _blocks(time[good], temperature[good], values[good])
        parts.append(part)
        disturbed += knocked
    run = np.repeat(np.arange(len(parts)), [len(p[0]) for p in parts])
    time, temperature, values, direction = (np.concatenate([p[i] for p in parts]) for i in range(4))
    if len(time) < 60:
        raise Refusal(
            f"The sweep leaves {len(time)} undisturbed stretches; a thermal fit needs 60 or more.",
            "Record a sweep of an hour or more with the sensor fixed.",
        )
    span = np.ptp(temperature)
    if span < LEAST_SPAN:
        raise Refusal(
            f"The temperature moves by {span:.1f} °C in all; below {LEAST_SPAN:.0f} °C a change with "
            "temperature cannot be told from a drift with time.",
            "Record a sweep over the range of use, up and down, at 0.5 °C a minute or slower.",
        )
    bins = ((temperature - temperature.min()) / span * BINS).astype(int).clip(0, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    weight = 1.0 / np.maximum(count[bins], 0.1 * count.max())
    names = tuple(files) or tuple(f"run {i + 1}" for i in range(len(parts)))
    length = float(np.median(np.concatenate([np.diff(p[0]) for p in parts])))
    return Sweep(
        time, temperature, values, weight / weight.mean(), run, direction, names, length, disturbed
    )


def _blocks(time, temperature, values):
    if len(time) < 2:
        empty = np.empty(0)
        return (empty, empty, np.empty((0, values.shape[1])), empty), 0
    edges = np.linspace(time[0], time[-1], BLOCKS + 1)
    start = np.unique(np.searchsorted(time, edges[:-1]))
    start = start[start < len(time)]
    count = np.diff(np.append(start, len(time)))

    def mean(x):
        return np.add.reduceat(x, start, axis=0) / (count if x.ndim == 1 else count[:, None])

    centre = mean(values)
    scatter = np.sqrt(np.maximum(mean((values - np.repeat(centre, count, axis=0)) ** 2), 0))
    usual = np.median(scatter, axis=0)
    calm = ((scatter <= KNOCK * usual) | (usual == 0)).all(axis=1) & (
        count >= 0.5 * np.median(count)
    )
    t, kelvin = mean(time), mean(temperature)
    # Heating and cooling from a straight line over ±4 blocks, so that thermometer noise does not count.
    rate = np.gradient(np.convolve(np.pad(kelvin, 4, mode="edge"), np.ones(9) / 9, "valid"), t)
    moving = np.abs(rate) * (t[-1] - t[0]) > 0.1 * np.ptp(kelvin)
    direction = np.where(moving, np.sign(rate), 0)
    return tuple(x[calm] for x in (t, kelvin, centre, direction)), int((~calm).sum())
