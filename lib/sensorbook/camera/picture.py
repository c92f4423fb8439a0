"""An image file as the grey picture that the camera's methods read."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from sensorbook.camera.model import Camera, grey
from sensorbook.errors import Refusal

COLOURED = "colour is read as luminance (ITU-R BT.601)"
_ORIENTATION = 274  # of Exif: how a viewer is to turn the picture


def read_picture(path: Path, camera: Camera) -> tuple[np.ndarray, str]:
    """A grey picture (height, width), uint8, of an image file, and what was done to make it, or "".

    Colour becomes luminance. Sixteen bits become eight: white is the largest value of the least number
    of bits, 8 or more, that hold the image's own largest. Of several pictures in a file the first is read;
    it is not turned, whatever a viewer is told to do, and is not transparent.

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
                left = _left(image)
    except Image.DecompressionBombError as error:
        count = re.search(r"\((\d+) pixels\)", str(error))
        declared = f"{int(count[1]) / 1e6:.0f} million" if count else "too many"
        raise Refusal(f"image declares {declared} pixels: none that large is read") from None
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise Refusal(f"file cannot be read as an image ({_short(error)})") from None
    return grey(pixels, camera), "; ".join(note for note in (done, *left) if note)


def _left(image: Image.Image) -> list[str]:
    """What else the file holds, which is left out."""
    notes = []
    if getattr(image, "is_animated", False):
        notes.append("only the first of its pictures is read")
    try:
        turned = int(image.getexif().get(_ORIENTATION, 1))
    except (OSError, ValueError, SyntaxError, TypeError):  # broken, of a whole picture
        turned = 1
    if turned != 1:
        notes.append("it is not turned as its Exif tells viewers to")
    if image.has_transparency_data:
        alpha = np.asarray(image.convert("RGBA").getchannel("A"))
        if alpha.min() < 255:
            notes.append("its transparency is left out")
    return notes


def _grey(image: Image.Image) -> tuple[np.ndarray, str]:
    if image.mode in ("L", "1"):
        return np.asarray(image.convert("L")), ""
    if image.mode.startswith("I"):
        deep = np.asarray(image).astype(np.int64)
        bits = max(int(deep.max()).bit_length(), 8)
        if deep.min() < 0 or bits > 16:
            raise Refusal(f"image has values from {deep.min()} to {deep.max()}, not 8 or 16 bits")
        white = 2**bits - 1
        return np.rint(deep * (255 / white)).astype(np.uint8), f"{bits} bits are read as 8"
    if image.mode == "F":
        raise Refusal("image holds fractions, not 8 or 16 bits")
    return np.asarray(image.convert("RGB").convert("L")), COLOURED


def _short(error: Exception) -> str:
    """The first line of what a reader said, without the file's path."""
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return "not one that is known" if "cannot identify" in text else text[:80]
