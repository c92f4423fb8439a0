"""All images of a device: what is chosen, counted and drawn, and that no picture is kept."""

import gc
import sys
import weakref

import cv2
import numpy as np
import pytest
from cameras import EARTH, SUN, pair, recording, shot, write

import sensorbook
from sensorbook.camera.steps import take_chain
from sensorbook.camera.survey import (
    angle,
    attitude_std,
    earth_errors,
    normalised_errors,
    off_axis,
    printed,
    shortened,
    survey,
    true_earth,
)
from sensorbook.errors import InputError

BLACK = np.zeros((360, 640), np.uint8)


def runs_of(folder):
    return sensorbook.load(folder).runs("camera", "images")


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """Two solved images, one of night, one broken, and a pair."""
    one, both = [shot(seed) for seed in (0, 1)], pair(0)
    images = {
        "one/a.png": b"broken",
        "one/b.png": BLACK,
        "one/c.png": one[0].image(),
        "one/d.png": one[1].image(),
        "earth/c.png": both.image(EARTH),
        "sun/c.png": both.image(SUN),
    }
    rows = [one[0].row("one/c.png"), one[1].row("one/d.png", ("time", "place"))]
    rows += [both.row("earth/c.png"), both.row("sun/c.png")]
    texts = [
        recording("sun/*.png", SUN, "sun"),
        recording("one/*.png"),
        recording("earth/*.png", EARTH, "earth"),
    ]
    return runs_of(write(tmp_path_factory.mktemp("survey") / "mixed", texts, images, rows))


@pytest.fixture(scope="module")
def found(mixed):
    return survey(mixed)


def test_counts_and_reasons(found):
    assert [frame.image for frame in found.solved] == [
        "one/c.png",
        "one/d.png",
        "earth/c.png",
        "sun/c.png",
    ]
    assert found.reasons == {
        "file cannot be read as an image (not one that is known)": ["one/a.png"],
        "Sun not in view, Earth not in view": ["one/b.png"],
    }
    assert [record["image"] for record in found.records] == [frame.image for frame in found.frames]
    assert found.notes == {}


def test_a_pair_s_attitude_counts_once(found):
    assert [frame.image for frame in found.attitudes] == ["one/c.png", "one/d.png", "earth/c.png"]
    # Of one/d.png the true attitude is not known.
    squares = normalised_errors(found.attitudes)
    assert squares.shape == (2,)
    frame = found.attitudes[0]
    assert squares[0] == pytest.approx(frame.error @ np.linalg.inv(frame.covariance) @ frame.error)
    assert attitude_std(frame) ** 2 == pytest.approx(np.trace(frame.covariance))


def test_the_first_solved_is_chosen(found):
    assert found.chosen.image == "one/c.png"
    assert found.earth is found.chosen is found.sun
    assert found.chosen.limb.rays is not None, "with all its points"


@pytest.mark.parametrize("name", ["earth/c.png", "sun/c.png"])
def test_an_image_asked_for_comes_with_its_partner(mixed, name):
    found = survey(mixed, name)
    assert found.chosen.image == name
    assert (found.earth.image, found.sun.image) == ("earth/c.png", "sun/c.png")
    assert found.earth.limb.rays is not None
    assert found.sun.sun.direction is not None


def test_one_image_for_both_of_a_pair(tmp_path):
    moment = shot(0)
    texts = [recording("*.png", sees="earth"), recording("a*.png", sees="sun")]
    runs = runs_of(
        write(tmp_path / "device", texts, {"a.png": moment.image()}, [moment.row("a.png")])
    )
    for name in ("", "a.png"):
        found = survey(runs, name)
        assert [(f.image, f.sees, f.partner) for f in (found.earth, found.sun)] == [
            ("a.png", "earth", "a.png"),
            ("a.png", "sun", "a.png"),
        ]
        assert np.linalg.norm(found.chosen.error) < np.radians(0.1)


def test_a_broken_image_asked_for(mixed):
    found = survey(mixed, "one/a.png")
    assert (found.chosen.image, found.earth, found.sun) == ("one/a.png", None, None)


def test_a_name_that_is_not_there(mixed):
    with pytest.raises(InputError) as wrong:
        survey(mixed, "c.png")
    assert str(wrong.value) == (
        "parameters: image: there is no 'c.png' — give one of "
        "one/a.png, one/b.png, one/c.png, one/d.png, sun/c.png (and 1 more)"
    )
    with pytest.raises(InputError, match="parameters: image: is 3 — give an image's name"):
        survey(mixed, 3)


def test_short_and_long_names_are_understood(tmp_path):
    folder = write(
        tmp_path / "device",
        [recording("i/*.png", poses=False)],
        {"i/a.png": BLACK, "i/b.png": BLACK},
    )
    for name in ("b.png", "i/b.png"):
        assert survey(runs_of(folder), name).chosen.image == "b.png"


def test_where_none_is_solved_the_one_that_shows_most_is_chosen(tmp_path):
    moment = shot(0)
    limb_alone = moment.image()
    sun = cv2.dilate((limb_alone > 230).astype(np.uint8), np.ones((7, 7)))
    limb_alone[sun > 0] = 0
    images = {"a.png": b"", "b.png": BLACK, "c.png": limb_alone, "d.png": BLACK}
    found = survey(runs_of(write(tmp_path / "device", [recording("*.png", poses=False)], images)))
    assert found.solved == []
    assert found.chosen.image == "c.png"
    assert found.chosen.status == "no solution: Sun not in view"
    assert found.attitudes == []
    assert normalised_errors(found.attitudes).shape == (0,)
    assert {key: len(values) for key, values in earth_errors(found).items()} == dict.fromkeys(
        ("off_axis", "cone", "together", "chain"), 0
    )


def test_earth_errors(found):
    errors = earth_errors(found)
    # one/c.png and earth/c.png: the Sun's camera sees no Earth, the others' truth is not known.
    frames = [
        found.frames[k]
        for k, f in enumerate(found.frames)
        if f.image in ("one/c.png", "earth/c.png")
    ]
    assert len(errors["cone"]) == len(frames) == 2
    for k, frame in enumerate(frames):
        true = true_earth(frame)
        assert errors["off_axis"][k] == pytest.approx(np.arccos(true[2]))
        together = np.arccos(np.clip(frame.earth_direction @ true, -1, 1))
        assert errors["together"][k] == pytest.approx(together, abs=1e-7)
        assert errors["together"][k] < np.radians(0.1)
        alone = np.arccos(np.clip(frame.limb.direction @ true, -1, 1))
        assert errors["cone"][k] == pytest.approx(alone, abs=1e-7)
        assert errors["cone"][k] != errors["together"][k]


def test_an_image_with_an_ellipse(found):
    first = next((k for k, d in enumerate(found.chain) if d is not None), None)
    assert found.with_ellipse is (None if first is None else found.frames[first])
    for frame, direction in zip(found.frames, found.chain, strict=True):
        if (
            direction is None
            and frame.earth_direction is not None
            and true_earth(frame) is not None
        ):
            assert take_chain(frame)[1].earth_direction is None


def test_the_table(found):
    table = found.table(4)
    assert list(table.index) == ["one/a.png", "one/b.png", "one/c.png", "one/d.png"]
    assert list(table.columns) == [
        "status",
        "Earth [°]",
        "radius [°]",
        "Sun [°]",
        "attitude x, y, z, w",
        "± [°]",
        "error [°]",
    ]
    assert table.loc["one/b.png"].tolist() == [
        "Sun not in view, Earth not in view",
        "",
        "",
        "",
        "",
        "",
        "",
    ]
    off, azimuth = np.degrees(off_axis(found.frames[2].earth_direction))
    assert table.loc["one/c.png", "Earth [°]"].startswith(
        f"{off:.3f},\u00a0{printed(azimuth, '.1f')} ±"
    )
    assert table.loc["one/d.png", "error [°]"] == ""
    assert "error [°]" not in found.table(2).columns, "columns of nothing are left out"


def test_long_names_keep_both_ends():
    assert shortened("images/0001.png") == "images/0001.png"
    name = shortened("a" * 200 + "/0001.png")
    assert len(name) == 40
    assert name.startswith("aaa")
    assert name.endswith("a/0001.png")
    assert "…" in name


def test_numbers_as_printed():
    assert printed(-12.345, ".1f") == "−12.3"
    assert [printed(v, ".2g") for v in (0.0123, 12.3, 180.0, -1234.0)] == [
        "0.012",
        "12",
        "180",
        "−1234",
    ]


def test_gallery_has_every_reason_once_and_the_solved_evenly(tmp_path):
    moment = shot(0)
    image = moment.image()
    nothing = [BLACK, np.full_like(BLACK, 255)]
    images = {f"{k:02d}.png": image if k % 2 else nothing[k % 4 // 2] for k in range(40)}
    images["99.png"] = b""
    found = survey(runs_of(write(tmp_path / "device", [recording("*.png", poses=False)], images)))
    drawn = [frame.image for frame in found.gallery()]
    assert len(drawn) == 12
    assert drawn == sorted(drawn)
    assert "99.png" not in drawn, "it cannot be drawn"
    assert drawn.count("00.png") == 1
    solved = [int(name[:2]) for name in drawn if name != "00.png"]
    assert (solved[0], solved[-1]) == (1, 39)
    assert set(np.diff(solved)) <= {2, 4}
    assert [frame.image for frame in found.gallery(2)] == ["00.png", "01.png"]


def test_angles():
    assert np.degrees(off_axis(np.array([0.0, 1, 1]) / np.sqrt(2))) == pytest.approx([45, 90])
    assert np.degrees(off_axis(np.array([-1.0, 0, 0]))) == pytest.approx([90, 180])
    assert angle(np.array([0, 0, 1.0]), np.array([1e-9, 0, 1.0])) == pytest.approx(1e-9, rel=1e-12)


def _arrays(item, seen):
    """Bytes of all arrays that an object holds on to."""
    if id(item) in seen or isinstance(item, type | type(sys)) or callable(item):
        return 0
    seen.add(id(item))
    own = item.nbytes if isinstance(item, np.ndarray) else 0
    return own + sum(_arrays(other, seen) for other in gc.get_referents(item))


def test_no_picture_and_few_points_are_kept(found):
    for frame in found.frames:
        # 60 edge points with what is known of them; a picture has 230 kB.
        assert 0 < _arrays(frame, set()) < 8000


def test_no_more_is_held_while_reading(tmp_path, monkeypatch):
    """Of the frames read before, few still have all their points."""
    image = shot(0).image()
    images = {f"{k}.png": image for k in range(8)}
    runs = runs_of(write(tmp_path / "device", [recording("*.png", poses=False)], images))
    module = sys.modules[survey.__module__]
    read, held = module.read_frames, []

    def watched(runs):
        alive = []
        for frame in read(runs):
            alive.append(weakref.ref(frame.limb))
            yield frame
            held.append(sum(limb() is not None for limb in alive))

    monkeypatch.setattr(module, "read_frames", watched)
    survey(runs)
    # The chosen one, that in hand, and one that a name is still bound to.
    assert max(held) <= 3
