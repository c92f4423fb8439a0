"""An image file as the grey picture that the camera's methods read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from sensorbook.camera.model import Camera, grey
from sensorbook.errors import Refusal

COLOURED = "its luminance is used (ITU-R BT.601)"


def read_picture(path: Path, camera: Camera) -> tuple[np.ndarray, str]:
    """A grey picture (height, width), uint8, of an image file, and what was done to make it, or "".

    Colour becomes luminance. Sixteen bits become eight: white is the largest value of the least number
    of bits, 8 or more, that hold the image's own largest.

    Raises
    ------
    Refusal
        the file is no whole image, or not one of this camera
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # sizes are judged where images are listed
            with Image.open(path) as image:
                if image.size != (camera.width, camera.height):
                    raise Refusal(
                        f"image is {image.width} × {image.height} pixels, its camera "
                        f"{camera.width} × {camera.height}"
                    )
                pixels, done = _grey(image)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise Refusal(f"file cannot be read as an image ({_short(error)})") from None
    return grey(pixels, camera), done


def _grey(image: Image.Image) -> tuple[np.ndarray, str]:
    if image.mode in ("L", "1"):
        return np.asarray(image.convert("L")), ""
    if image.mode.startswith("I"):
        deep = np.asarray(image).astype(np.int64)
        bits = max(int(deep.max()).bit_length(), 8)
        if deep.min() < 0 or bits > 16:
            raise Refusal(f"image has values from {deep.min()} to {deep.max()}, not 8 or 16 bits")
        white = 2**bits - 1
        return np.rint(deep * (255 / white)).astype(np.uint8), f"its {bits} bits are read as 8"
    if image.mode == "F":
        raise Refusal("image holds fractions, not 8 or 16 bits")
    return np.asarray(image.convert("RGB").convert("L")), COLOURED


def _short(error: Exception) -> str:
    """The first line of what a reader said, without the file's path."""
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return "not one that is known" if "cannot identify" in text else text[:80]
