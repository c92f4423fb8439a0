"""Frames of a camera device: one camera, a pair, and every way in which an image gives nothing."""

from functools import cache

import cv2
import numpy as np
import pytest
from cameras import DISTANCE, EARTH, ONE, SUN, pair, png, recording, shot, write

import sensorbook
from sensorbook.attitude.rotations import matrix_from_quaternion
from sensorbook.camera.frames import NO_PAIR, image_names, read_frames
from sensorbook.camera.picture import COLOURED
from sensorbook.camera.scene import EARTH_RADIUS

# Of seeds 0 to 39, one camera and pairs, the largest error was 0.031°. In a quarter of them the Sun, 1.7
# pixels wide here, fills no pixel and is not found; not in those used below.
LARGEST = np.radians(0.1)


def frames_of(folder):
    return list(read_frames(sensorbook.load(folder).runs("camera", "images")))


def one_image(tmp_path, image, poses=(), camera=ONE, sees="both", name="a.png"):
    """The frame of a device with one image."""
    text = recording(name, camera, sees, poses=bool(poses))
    (frame,) = frames_of(write(tmp_path / "device", [text], {name: image}, poses))
    return frame


@cache
def taken(seed):
    """A moment that one camera sees both bodies at, and its image."""
    return shot(seed), shot(seed).image()


# ---- one camera ----


@pytest.mark.parametrize("seed", range(4))
def test_one_camera(tmp_path, seed):
    moment, image = taken(seed)
    frame = one_image(tmp_path, image, [moment.row("a.png")])
    assert frame.status == "ok"
    assert np.linalg.norm(frame.error) < LARGEST
    assert np.arccos(frame.earth_direction @ moment.down(ONE)) < LARGEST
    record = frame.record()
    assert record["image"] == "a.png"
    assert record["error_deg"] == pytest.approx(np.degrees(np.linalg.norm(frame.error)))
    assert matrix_from_quaternion(record["quaternion"]) == pytest.approx(frame.matrix, abs=1e-12)
    radius = np.degrees(np.arcsin(EARTH_RADIUS / DISTANCE))
    found, std = record["earth_angular_radius_deg"], record["earth_angular_radius_std_deg"]
    assert abs(found - radius) < 6 * std + 0.05  # haze is free: it may come out as some km
    assert record["sun_direction"] @ moment.attitude @ moment.sun == pytest.approx(1, abs=1e-6)
    assert (record["partner"], record["note"]) == (None, None)
    assert record["time"] == moment.time.replace("Z", ".000000Z")
    assert np.array_equal(record["attitude_covariance"], frame.covariance)
    std = np.degrees(np.sqrt(np.diag(record["attitude_covariance"])))
    assert record["attitude_std_deg"] == pytest.approx(std)


@pytest.mark.parametrize("known", [("time",), ("place",), ("time", "truth")])
def test_without_time_or_place_directions_alone(tmp_path, known):
    moment, image = taken(0)
    frame = one_image(tmp_path, image, [moment.row("a.png", known)])
    record = frame.record()
    assert frame.status == "ok"
    for name in ("quaternion", "attitude_std_deg", "attitude_covariance", "error_deg"):
        assert record[name] is None
    assert (record["time"] is None) == ("time" not in known)
    off = np.arccos(frame.earth_direction @ moment.down(ONE))
    assert off < 6 * frame.earth_std
    assert record["earth_direction_std_deg"] == pytest.approx(np.degrees(frame.earth_std))


def test_no_poses_at_all(tmp_path):
    frame = one_image(tmp_path, taken(1)[1])
    assert (frame.status, frame.matrix, frame.error) == ("ok", None, None)
    assert frame.pose.time is None


def test_a_true_attitude_is_not_needed(tmp_path):
    moment, image = taken(1)
    frame = one_image(tmp_path, image, [moment.row("a.png", ("time", "place"))])
    assert frame.status == "ok"
    assert frame.matrix is not None
    assert frame.record()["error_deg"] is None


def test_an_image_without_a_row_among_others(tmp_path):
    moment, image = taken(0)
    folder = write(
        tmp_path / "device",
        [recording("*.png")],
        {"a.png": image, "b.png": image},
        [moment.row("b.png")],
    )
    (run,) = sensorbook.load(folder).runs("camera", "images")
    assert [finding.message for finding in run.findings] == [
        "1 of 2 images have no row here, a.png first"
    ]
    first, second = read_frames([run])
    assert (first.status, first.matrix) == ("ok", None)
    assert second.matrix is not None


# ---- images that give nothing ----


def moon():
    """A small lit disc, half a degree wide as the Moon is, and brighter than the Earth's night."""
    image = np.zeros((360, 640), np.uint8)
    cv2.circle(image, (200, 150), 12, 190, -1, cv2.LINE_AA)
    return image


BAD = {
    "truncated": (
        lambda: png(taken(0)[1])[:5000],
        "file cannot be read as an image (image file is truncated)",
    ),
    "no image": (lambda: b"nothing of the kind", "file cannot be read as an image (not one that is known)"),
    "empty": (lambda: b"", "file cannot be read as an image (not one that is known)"),
    "too small": (
        lambda: np.zeros((240, 320), np.uint8),
        "image is 320 × 240 pixels, its camera 640 × 360",
    ),
    "on its side": (
        lambda: np.zeros((640, 360), np.uint8),
        "image is 360 × 640 pixels, its camera 640 × 360",
    ),
    "black": (lambda: np.zeros((360, 640), np.uint8), "Sun not in view, Earth not in view"),
    "white": (lambda: np.full((360, 640), 255, np.uint8), "Sun not in view, Earth not in view"),
    "noise": (
        lambda: np.random.default_rng(1).integers(0, 256, (360, 640)).astype(np.uint8),
        "Sun not in view, Earth not in view",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("posed", [False, True])
def test_a_bad_image_has_its_reason(tmp_path, kind, posed):
    make, reason = BAD[kind]
    frame = one_image(tmp_path, make(), [taken(0)[0].row("a.png")] if posed else ())
    assert frame.status == f"no solution: {reason}"
    record = frame.record()
    told = ["image", "time", "status", "sees"] if posed else ["image", "status", "sees"]
    assert [k for k, v in record.items() if v is not None] == told


def test_a_small_disc_is_no_earth_where_the_place_is_known(tmp_path):
    frame = one_image(tmp_path, moon(), [taken(0)[0].row("a.png")])
    assert frame.status == (
        "no solution: Sun not in view, disc of 2.9° radius, not the Earth's of 49.7° that the position gives"
    )
    assert frame.earth_direction is None


def test_a_small_disc_is_no_earth_where_no_place_is_known(tmp_path):
    frame = one_image(tmp_path, moon(), ())
    assert frame.status == (
        "no solution: Sun not in view, disc of 2.9° radius, too small for the Earth (5° or more where no "
        "position is given)"
    )
    assert frame.record()["earth_angular_radius_deg"] is None


def test_sixteen_bits_and_colour_give_what_eight_grey_bits_give(tmp_path):
    moment, image = taken(2)
    poses = [moment.row(name) for name in ("grey.png", "deep.png", "colour.png")]
    files = {
        "grey.png": image,
        "deep.png": image.astype(np.uint16) * 16,
        "colour.png": cv2.cvtColor(image, cv2.COLOR_GRAY2BGR),
    }
    colour, deep, plain = frames_of(write(tmp_path / "device", [recording("*.png")], files, poses))
    assert plain.note == ""
    assert deep.note == "12 bits are read as 8"
    assert colour.note == COLOURED
    assert colour.record()["note"] == COLOURED
    assert colour.matrix == pytest.approx(plain.matrix, abs=1e-12)
    # 255 · 16 is not quite 4095: a level in some hundred differs by one.
    assert deep.matrix == pytest.approx(plain.matrix, abs=1e-3)


# ---- two cameras ----


def two(tmp_path, moments, later=(), lacking=(), unplaced=()):
    """Frames by name of a pair's images; `later` Sun images are a second late, `lacking` are not there."""
    images, poses = {}, []
    for k, moment in enumerate(moments):
        known = ("time",) if k in unplaced else ("time", "place", "truth")
        images[f"earth/{k}.png"] = moment.image(EARTH)
        poses.append(moment.row(f"earth/{k}.png", known))
        if k in lacking:
            continue
        images[f"sun/{k}.png"] = moment.image(SUN)
        row = moment.row(f"sun/{k}.png", known)
        poses.append(row | {"time": row["time"].replace(":00Z", ":01Z")} if k in later else row)
    texts = [recording("earth/*.png", EARTH, "earth"), recording("sun/*.png", SUN, "sun")]
    found = frames_of(write(tmp_path / "device", texts, images, poses))
    assert [frame.image for frame in found] == sorted(images)
    return {frame.image: frame for frame in found}


@pytest.fixture(scope="module")
def moments():
    return [pair(seed) for seed in range(2)]


def test_a_pair_makes_one_attitude(tmp_path, moments):
    found = two(tmp_path, moments)
    for k in range(2):
        earth, sun = found[f"earth/{k}.png"], found[f"sun/{k}.png"]
        assert (earth.status, sun.status) == ("ok", "ok")
        assert (earth.partner, sun.partner) == (sun.image, earth.image)
        assert earth.matrix is sun.matrix
        assert np.linalg.norm(earth.error) < LARGEST
        assert earth.sun is None
        assert sun.limb is None
        assert np.arccos(earth.earth_direction @ moments[k].down(EARTH)) < LARGEST
        assert sun.earth_direction is None


def test_a_pair_at_two_times_is_none(tmp_path, moments):
    found = two(tmp_path, moments, later=(1,))
    assert found["earth/0.png"].status == "ok"
    for frame in (found["earth/1.png"], found["sun/1.png"]):
        assert (frame.status, frame.matrix, frame.partner) == (NO_PAIR, None, "")
    assert found["earth/1.png"].earth_direction is not None
    assert found["sun/1.png"].sun.direction is not None


def test_an_image_whose_partner_is_missing(tmp_path, moments):
    found = two(tmp_path, moments, lacking=(1,))
    assert found["earth/1.png"].status == NO_PAIR
    assert found["earth/0.png"].matrix is not None


def test_a_pair_without_its_place_gives_directions(tmp_path, moments):
    found = two(tmp_path, moments, unplaced=(0, 1))
    assert {frame.status for frame in found.values()} == {"ok"}
    assert {frame.matrix for frame in found.values()} == {None}
    assert found["earth/0.png"].partner == "sun/0.png"


def test_a_pair_of_which_one_is_broken(tmp_path, moments):
    moment = moments[0]
    folder = write(
        tmp_path / "device",
        [recording("e.png", EARTH, "earth"), recording("s.png", SUN, "sun")],
        {"e.png": moment.image(EARTH), "s.png": b""},
        [moment.row("e.png"), moment.row("s.png")],
    )
    earth, sun = frames_of(folder)
    reason = "no solution: file cannot be read as an image (not one that is known)"
    assert (sun.status, earth.status) == (reason, f"{reason} (s.png)")
    assert earth.earth_direction is not None


def test_one_camera_of_a_pair_alone_needs_no_partner(tmp_path, moments):
    frame = one_image(tmp_path, moments[0].image(EARTH), [moments[0].row("a.png")], EARTH, "earth")
    assert (frame.status, frame.matrix, frame.sun) == ("ok", None, None)
    assert np.arccos(frame.earth_direction @ moments[0].down(EARTH)) < 6 * frame.earth_std


# ---- names ----


def test_names_are_as_short_as_tells_them_apart(tmp_path):
    nothing = np.zeros((360, 640), np.uint8)
    for name, files in (("short", ("a/1.png", "b/2.png")), ("long", ("a/1.png", "b/1.png"))):
        text = [recording("a/*.png", poses=False), recording("b/*.png", poses=False)]
        folder = write(tmp_path / name, text, dict.fromkeys(files, nothing))
        runs = sensorbook.load(folder).runs("camera", "images")
        short = [file.split("/")[1] if name == "short" else file for file in files]
        assert image_names(runs) == dict(zip(files, short, strict=True))
        assert [frame.image for frame in read_frames(runs)] == short
