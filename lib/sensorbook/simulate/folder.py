"""Writes a simulated device: the recordings and `truth.json` first, `device.toml` last."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from sensorbook.errors import InputError, Problem


@dataclass(frozen=True)
class SimulatedDevice:
    """`device.toml` as text, tables by file name, and the truth, SI.

    A table is its columns by name, in a `.npz` or `.csv` file; a `.db` file (SQLite) holds several
    tables by name. A `.png` file holds a grey image (height, width), uint8. Names may have folders.
    """

    toml: str
    tables: dict[str, dict | np.ndarray]
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
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if name.endswith(".npz"):
                np.savez(folder / name, **table)
            elif name.endswith(".db"):
                _write_database(folder / name, table)
            elif name.endswith(".png"):
                _write_png(folder / name, table)
            else:
                pd.DataFrame(table).to_csv(folder / name, index=False)
        (folder / "truth.json").write_text(
            json.dumps(device.truth, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
        # Last, so that an interrupted simulation is not taken for a device.
        (folder / "device.toml").write_text(device.toml, encoding="utf-8")
    except (OSError, sqlite3.OperationalError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(
            Problem(str(folder), "", f"cannot be written: {why}", "choose another folder")
        ) from None


def _write_png(path: Path, image: np.ndarray) -> None:
    import cv2  # here, as most presets have no images

    # Level 3 takes a quarter of the time of level 6 for a tenth more bytes; noise hardly compresses.
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    path.write_bytes(data.tobytes())


def _write_database(path: Path, tables: dict[str, dict[str, np.ndarray]]) -> None:
    path.unlink(missing_ok=True)  # what an interrupted simulation left
    with closing(sqlite3.connect(path)) as database, database:
        for name, columns in tables.items():
            types = ", ".join(
                f'"{c}" {"INTEGER" if v.dtype.kind in "iu" else "REAL"}' for c, v in columns.items()
            )
            database.execute(f'CREATE TABLE "{name}" ({types})')
            rows = zip(*(v.tolist() for v in columns.values()), strict=True)
            marks = ", ".join("?" * len(columns))
            database.executemany(f'INSERT INTO "{name}" VALUES ({marks})', rows)
