"""Image files as grey pictures: formats, depths, colours, and files that are none."""

import io

import numpy as np
import pytest
from PIL import Image

from sensorbook.camera.model import Camera
from sensorbook.camera.picture import COLOURED, read_picture
from sensorbook.errors import Refusal

CAMERA = Camera(40, 30, 50.0)
GREY = (np.arange(1200).reshape(30, 40) % 251).astype(np.uint8)


def saved(tmp_path, image, name="a.png", **kwargs):
    path = tmp_path / name
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path, **kwargs)
    return path


@pytest.mark.parametrize("name", ["a.png", "a.bmp", "a.tif", "a.pgm", "a.PNG"])
def test_grey_images_are_read_as_they_are(tmp_path, name):
    picture, note = read_picture(saved(tmp_path, GREY, name), CAMERA)
    assert (picture.dtype, note) == (np.uint8, "")
    np.testing.assert_array_equal(picture, GREY)


def test_jpeg(tmp_path):
    picture, note = read_picture(saved(tmp_path, GREY // 4, "a.jpg", quality=95), CAMERA)
    assert note == ""
    assert np.abs(picture.astype(int) - GREY // 4).mean() < 3  # it loses some


def test_the_content_counts_not_the_name(tmp_path):
    path = saved(tmp_path, GREY, "a.bmp").rename(tmp_path / "a.png")
    np.testing.assert_array_equal(read_picture(path, CAMERA)[0], GREY)


def test_black_and_white(tmp_path):
    picture, note = read_picture(saved(tmp_path, Image.fromarray(GREY > 100)), CAMERA)
    assert note == ""
    np.testing.assert_array_equal(picture, np.where(GREY > 100, 255, 0))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "LA"])
def test_colour_becomes_luminance(tmp_path, mode):
    rng = np.random.default_rng(3)
    colours = Image.fromarray(rng.integers(0, 256, (30, 40, 3)).astype(np.uint8)).convert(mode)
    picture, note = read_picture(saved(tmp_path, colours), CAMERA)
    assert note == COLOURED == "colour is read as luminance (ITU-R BT.601)"
    red, green, blue = np.moveaxis(np.asarray(colours.convert("RGB")).astype(float), -1, 0)
    # Whole levels.
    assert np.abs(picture - (0.299 * red + 0.587 * green + 0.114 * blue)).max() <= 1


@pytest.mark.parametrize("bits", [9, 10, 12, 14, 16])
def test_deep_images_are_scaled_by_the_bits_that_hold_them(tmp_path, bits):
    white = 2**bits - 1
    deep = np.linspace(0, white, 1200).round().astype(np.uint16).reshape(30, 40)
    picture, note = read_picture(saved(tmp_path, deep), CAMERA)
    assert note == f"{bits} bits are read as 8"
    np.testing.assert_array_equal(picture, np.rint(deep * 255.0 / white))
    assert (picture.min(), picture.max()) == (0, 255)


def test_a_dark_deep_image_keeps_its_levels(tmp_path):
    picture, note = read_picture(saved(tmp_path, GREY.astype(np.uint16)), CAMERA)
    assert note == "8 bits are read as 8"
    np.testing.assert_array_equal(picture, GREY)


def _reason(path, camera=CAMERA):
    with pytest.raises(Refusal) as refused:
        read_picture(path, camera)
    return refused.value.reason


def test_another_size(tmp_path):
    path = saved(tmp_path, GREY)
    assert _reason(path, Camera(30, 40, 50.0)) == "image is 40 × 30 pixels, its camera 30 × 40"


def test_fractions(tmp_path):
    path = saved(tmp_path, GREY.astype(np.float32), "a.tif")
    assert _reason(path) == "image holds fractions, not 8 or 16 bits"


@pytest.mark.parametrize(("low", "high"), [(-5, 100), (0, 70_000)])
def test_values_that_sixteen_bits_do_not_hold(tmp_path, low, high):
    deep = np.full((30, 40), low, dtype=np.int32)
    deep[0, 0] = high
    reason = _reason(saved(tmp_path, deep, "a.tif"))
    assert reason == f"image has values from {low} to {high}, not 8 or 16 bits"


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n", b"P5 40 30 255\n"])
def test_no_image(tmp_path, content):
    path = tmp_path / "a.png"
    path.write_bytes(content)
    assert _reason(path).startswith("file cannot be read as an image (")


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.bmp"])
def test_a_file_cut_anywhere_is_refused_or_whole(tmp_path, name):
    buffer = io.BytesIO()
    Image.fromarray(GREY).save(
        buffer, format={"jpg": "jpeg", "tif": "tiff"}.get(name[2:], name[2:])
    )
    whole = buffer.getvalue()
    reasons = []
    for length in range(0, len(whole), max(1, len(whole) // 60)):
        (tmp_path / name).write_bytes(whole[:length])
        try:
            picture, _ = read_picture(tmp_path / name, CAMERA)
        except Refusal as refusal:
            reasons.append(refusal.reason)
        else:
            assert picture.shape == (30, 40)
    assert len(reasons) > 30
    assert not [r for r in reasons if "\n" in r or str(tmp_path) in r]


def test_a_missing_file(tmp_path):
    reason = _reason(tmp_path / "none.png")
    assert reason.startswith("file cannot be read as an image (")
    assert str(tmp_path) not in reason


def test_what_a_file_holds_besides_is_said(tmp_path):
    grey = Image.fromarray(GREY)
    more = saved(
        tmp_path, grey, "a.gif", save_all=True, append_images=[Image.fromarray(255 - GREY)]
    )
    picture, note = read_picture(more, CAMERA)
    assert note.endswith("only the first of its pictures is read")
    assert np.abs(picture.astype(int) - GREY).max() <= 2  # a palette's levels
    turned = Image.Exif()
    turned[274] = 6
    picture, note = read_picture(saved(tmp_path, grey, "turned.png", exif=turned), CAMERA)
    assert note == "it is not turned as its Exif tells viewers to"
    np.testing.assert_array_equal(picture, GREY)
    glass = Image.merge("LA", [grey, Image.fromarray(np.zeros_like(GREY))])
    picture, note = read_picture(saved(tmp_path, glass, "glass.png"), CAMERA)
    assert note == f"{COLOURED}; its transparency is left out"
    np.testing.assert_array_equal(picture, GREY)
