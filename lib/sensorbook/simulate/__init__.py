"""Simulated devices with known truth; each chapter's kind of recording has a preset here."""

from __future__ import annotations

import re
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from sensorbook.errors import InputError, Problem

PRESETS = {  # each a module here, but for those of `_ORBITS`
    "ahrs": "work A's robotics-grade AHRS: two hours at rest at 100 Hz and a temperature sweep",
    "positions": "an IMU laid down by hand in 25 attitudes, and levelled on its six faces",
    "phone": "work B's phone: six faces, 23 attitudes and a check, as a recorder's SQLite files",
    "rotation": "a magnetometer and an accelerometer turned by hand through all attitudes",
    "trajectory": "work C's poor gyroscope turned for three minutes beside a reference, and at rest",
    "leo": "work C's Earth and Sun cameras, one for both and a pair, 2000 km above the ground",
    "meo": "the same at 20 000 km",
    "geo": "the same at 35 786 km",
}
_ORBITS = ("leo", "meo", "geo")  # presets of the module `camera`


def simulate(folder: str | Path, preset: str = "ahrs", seed: int = 1) -> Path:
    """Writes a simulated device folder with `truth.json`; the same seed gives the same files.

    The device's id is the folder's name, where that is a valid one.

    Raises
    ------
    InputError
        an unknown preset, a negative seed, or a folder that holds a device already
    """
    folder = Path(folder)
    if preset not in PRESETS:
        raise InputError(
            Problem(
                "simulate", "preset", f"{preset!r} is not known", f"one of {', '.join(PRESETS)}"
            )
        )
    if seed < 0:
        raise InputError(Problem("simulate", "seed", f"{seed} is negative", "give 0 or more"))
    name = folder.resolve().name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name) or name in ("index.html", "book"):
        name = f"{preset}-demo"
    from sensorbook.simulate.folder import (
        write,
    )  # here, as a command's help needs the presets alone

    module = "camera" if preset in _ORBITS else preset
    build = import_module(f"sensorbook.simulate.{module}").build
    if preset in _ORBITS:
        build = partial(build, orbit=preset)
    write(build(np.random.default_rng([seed, 0xA]), name), folder)
    return folder
