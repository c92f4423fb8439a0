"""Writes a simulated device: the recordings and `truth.json` first, `device.toml` last."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from sensorbook.errors import InputError, Problem


@dataclass(frozen=True)
class SimulatedDevice:
    """`device.toml` as text, tables by file name (`.npz` or `.csv`), and the truth, SI."""

    toml: str
    tables: dict[str, dict[str, np.ndarray]]
    truth: dict


def write(device: SimulatedDevice, folder: Path) -> None:
    """Writes into `folder`; a folder that holds a device already is left alone.

    Raises
    ------
    InputError
        the folder has a `device.toml`, or cannot be written
    """
    if (folder / "device.toml").exists():
        raise InputError(
            Problem(
                str(folder), "", "holds a device already", "name another folder or remove this one"
            )
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in device.tables.items():
            if name.endswith(".npz"):
                np.savez(folder / name, **table)
            else:
                pd.DataFrame(table).to_csv(folder / name, index=False)
        (folder / "truth.json").write_text(
            json.dumps(device.truth, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
        # Last, so that an interrupted simulation is not taken for a device.
        (folder / "device.toml").write_text(device.toml, encoding="utf-8")
    except OSError as error:
        raise InputError(
            Problem(
                str(folder), "", f"cannot be written: {error.strerror}", "choose another folder"
            )
        ) from None
