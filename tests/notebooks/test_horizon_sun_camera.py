"""The chapter on the horizon and Sun camera: good devices, bad ones, one body, no poses, a photograph."""

from __future__ import annotations

import html
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest
from browser import CHROMIUM, examine
from cameras import EARTH, ONE, SUN, pair, png, recording, shot, write
from devices import Report, executed, render

from sensorbook.camera.scene import EARTH_RADIUS
from sensorbook.reporting import chapters

SCHEMA = Path(chapters.__file__).with_name("results.schema.json")
CHAPTER = "horizon_sun_camera"


def reported(folder, images, recordings=None, poses=()):
    """The report of a device with these images."""
    recordings = recordings or [recording("*.png", poses=bool(poses))]
    report = render(write(folder, recordings, images, poses), folder.parent / "reports")
    assert report.code == 0, report.said
    validate(report)
    return report


def validate(report: Report) -> None:
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(report.results)
    assert report.status("camera", CHAPTER) == ("complete", None)


def images_of(report: Report) -> dict[str, dict]:
    return {image["image"]: image for image in report.results["sensors"]["camera"]["images"]}


def figures(report: Report) -> list[str]:
    """Captions of the page's figures."""
    page = (report.folder / "camera" / f"{CHAPTER}.html").read_text()
    return [html.unescape(alt) for alt in re.findall(r'<img[^>]*alt="([^"]*)"', page)]


# ---- the demo ----


@pytest.fixture(scope="module")
def demo(orbiting_folder):
    report = render(orbiting_folder, orbiting_folder.parents[1] / "reports")
    assert report.code == 0, report.said
    validate(report)
    return report


def test_demo_against_truth(demo, orbiting_folder):
    truth = json.loads((orbiting_folder / "truth.json").read_text())["images"]
    found = images_of(demo)
    assert set(found) == set(truth)
    solved = [name for name, image in found.items() if image["status"] == "ok"]
    assert len(solved) == 14
    for name in solved:
        # Within 0.1° of the truth, which C's chain misses by ten degrees and more.
        assert found[name]["error_deg"] < 0.1
        expected = np.array(truth[name]["quaternion"])
        assert abs(expected @ found[name]["quaternion"]) > np.cos(np.radians(0.05))
    for name, image in found.items():
        for body in ("earth", "sun"):
            direction = image[f"{body}_direction"]
            assert direction is None or truth[name][f"{body}_in_view"]
            if direction is not None:
                off = np.degrees(
                    np.arccos(
                        np.clip(direction @ np.array(truth[name][f"{body}_direction"]), -1, 1)
                    )
                )
                assert off < max(0.1, 5 * image[f"{body}_direction_std_deg"])


def test_demo_says_what_it_found(demo):
    page = demo.page(CHAPTER, "camera")
    assert "one/*.png81280 × 720 px369.5 pxEarth and Sun" in page
    assert "sees 120.0° × 88.5° and looks for the Earth and the Sun" in page
    assert "A camera for both bodies needs both in view at once." in page
    assert "The Earth's camera and the Sun's go together" in page
    assert "Time and place are known of 18 of 18 images, the true attitude of 18." in page
    assert "14 of 18 images give what their camera looks for." in page
    assert "The steps below are those of one/0001.png, the first that is solved." in page
    assert "10 attitudes are found, known to" in page
    known, seen = (
        float(n)
        for n in re.search(r"\), ([\d.]+)° apart.*?measured are ([\d.]+)° apart", page).groups()
    )
    assert seen == pytest.approx(known, abs=0.1)
    assert "but for very precise attitude: here it would be off by" in page
    assert (
        "3 of 18 images have no solution: Sun not in view (one/0007.png, earth/0005.png, sun/0005.png)."
        in page
    )
    assert "1 of 18 images has no solution: Earth not in view." in page
    assert "C's chain gives a direction in" in page
    assert re.search(r"Pixel \(\d+, \d+\) has \d+ and becomes \d+, as 24 of the 49 values", page)
    assert re.search(r"Of the 81 pixels here \d+ stand out .* exceed 100 and start an edge", page)
    assert re.search(r"\d+ % of these lie within three pixels of the limb", page)
    assert re.search(r"From half of the edges the centre comes out \d+ px away", page)
    assert "The Sun is half a degree wide: 3.4 px in the middle of this camera's image" in page
    assert not re.search(r"\de[+-]\d", page), "no powers of ten"
    assert re.search(
        r"The cone's axis errs by [\d.]+° in the median over 12 images, limb and Sun together by",
        page,
    )
    warnings = [w["message"] for w in demo.results["warnings"]]
    assert len(warnings) == 2
    alone = float(re.search(r"Against the true attitude their error is ([\d.]+)°", page)[1])
    errors = [
        i["error_deg"] for i in images_of(demo).values() if i["error_deg"] and i["sees"] != "sun"
    ]
    assert alone == pytest.approx(np.mean(errors), rel=0.01)


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open the pages with")
def test_demo_pages_fit_a_telephone(demo, tmp_path):
    for page in (demo.folder / "index.html", demo.folder / "camera" / f"{CHAPTER}.html"):
        seen = examine(page, tmp_path, [(390, "light")])["390 light"]
        assert (seen["scroll"], seen["wide"]) == (seen["client"], []), page
        assert [v for v in seen["violations"] if v["impact"] in ("serious", "critical")] == [], page


def test_pages_are_small_and_keep_to_themselves(demo):
    for page in demo.folder.rglob("*.html"):
        text = page.read_text()
        assert page.stat().st_size < 1_500_000
        assert not re.search(r"https?://|src=\"//|url\(", text), page
        assert all('alt="' in tag for tag in re.findall(r"<img[^>]*>", text))
    assert len(figures(demo)) == 16
    assert all("Look for: " in caption for caption in figures(demo))


def test_the_index_has_a_card_with_a_picture(demo):
    index = (demo.folder / "index.html").read_text()
    assert "<strong>14 of 18 images solved.</strong>" in index
    assert re.search(
        r'<img src="data:image/png;base64,[^"]*" alt="one/0001.png with the fitted limb and the Sun',
        index,
    )


# ---- bad images among good ones ----


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    moments = [shot(0), shot(1)]
    good = moments[0].image()
    moon = np.zeros((360, 640), np.uint8)
    cv2.circle(moon, (200, 150), 12, 190, -1, cv2.LINE_AA)
    images = {
        "black.png": np.zeros((360, 640), np.uint8),
        "colour.png": cv2.cvtColor(good, cv2.COLOR_GRAY2BGR),
        "deep.png": good.astype(np.uint16) * 16,
        "good.png": good,
        "moon.png": moon,
        "noise.png": np.random.default_rng(1).integers(0, 256, (360, 640)).astype(np.uint8),
        "small.png": np.zeros((100, 100), np.uint8),
        "truncated.png": png(good)[:4000],
        "white.png": np.full((360, 640), 255, np.uint8),
        "<b>&x.png": good,
    }
    poses = [moments[0].row(name, ("time", "place")) for name in images if name != "moon.png"]
    return reported(tmp_path_factory.mktemp("bad") / "bad", images, poses=poses)


def test_every_bad_image_has_its_reason(bad):
    status = {name: image["status"] for name, image in images_of(bad).items()}
    both = "no solution: Sun not in view, Earth not in view"
    assert status == {
        "<b>&x.png": "ok", "black.png": both, "colour.png": "ok", "deep.png": "ok", "good.png": "ok",
        "moon.png": "no solution: Sun not in view, disc of 2.9° radius, too small for the Earth "
        "(5° or more where no position is given)",
        "noise.png": both,
        "small.png": "no solution: image is 100 × 100 pixels, its camera 640 × 360",
        "truncated.png": "no solution: file cannot be read as an image (image file is truncated)",
        "white.png": both,
    }  # fmt: skip
    page = bad.page(CHAPTER, "camera")
    assert "4 of 10 images give what their camera looks for." in page
    assert "Of 1 image: 12 bits are read as 8 (deep.png)." in page
    assert "Of 1 image: colour is read as luminance (ITU-R BT.601) (colour.png)." in page
    assert (
        "3 of 10 images have no solution: Sun not in view, Earth not in view "
        "(black.png, noise.png, white.png)." in page
    )
    assert (
        "1 of 10 images has no solution: image is 100 × 100 pixels, its camera 640 × 360." in page
    )
    assert "No true attitude is known, so that the standard errors are all there is." in page


def test_names_stay_inert(bad):
    for page in bad.folder.rglob("*.html"):
        assert "<b>&x" not in page.read_text()
    assert "The steps below are those of <b>&x.png, the first that is solved." in bad.page(
        CHAPTER, "camera"
    )


# ---- nothing solved ----


def test_none_solved(tmp_path):
    limb = shot(0).image()
    limb[cv2.dilate((limb > 230).astype(np.uint8), np.ones((7, 7))) > 0] = 0  # without the Sun
    images = {"a.png": np.zeros((360, 640), np.uint8), "b.png": b"none", "c.png": limb}
    report = reported(tmp_path / "unsolved", images)
    page = report.page(CHAPTER, "camera")
    assert "0 of 3 images give what their camera looks for." in page
    assert (
        "The steps below are those of c.png, which shows most: no solution: Sun not in view."
        in page
    )
    assert (
        "No image is solved. What was seen stands in the table, and each image has its reason."
        in page
    )
    assert "No attitude is made of this image: Sun not in view." in page
    assert "No attitude was made, so that none can be judged." in page
    assert "No Sun is found in this image: Sun not in view." in page
    found = images_of(report)["c.png"]
    assert found["earth_direction"] is not None
    assert "0 of 3 images solved." in (report.folder / "index.html").read_text()


def test_nothing_readable(tmp_path):
    report = reported(tmp_path / "broken", {"a.png": b"", "b.png": b"none"})
    page = report.page(CHAPTER, "camera")
    assert "The steps below are those of a.png, the first: no solution: file cannot be read" in page
    assert "It cannot be read, so that no step can be drawn." in page
    assert [caption.split(",")[0] for caption in figures(report)] == ["Work C's steps"]
    assert [w["message"] for w in report.results["warnings"]] == [
        "2 of 2 images have no solution: "
        "file cannot be read as an image (not one that is known) (a.png, b.png)."
    ]


# ---- one body, two cameras, no poses ----


def test_true_attitudes_turned_the_other_way_are_told(tmp_path):
    moments = [shot(k) for k in range(3)]
    poses = [moment.row(f"{k}.png") for k, moment in enumerate(moments)]
    for row in poses:
        row["qw"] = -row["qw"]
    images = {f"{k}.png": moment.image() for k, moment in enumerate(moments)}
    report = reported(tmp_path / "turned", images, poses=poses)
    (warning,) = [w for w in report.results["warnings"] if w["file"] == "poses.csv"]
    assert "are the quaternions scalar last, and inertial → body?" in warning["message"]


def test_an_earth_camera_alone(tmp_path):
    moments = [pair(0), pair(1)]
    images = {f"{k}.png": moment.image(EARTH) for k, moment in enumerate(moments)}
    poses = [moment.row(f"{k}.png") for k, moment in enumerate(moments)]
    report = reported(tmp_path / "earth", images, [recording("*.png", EARTH, "earth")], poses)
    page = report.page(CHAPTER, "camera")
    assert (
        "One body alone leaves the rotation about its direction open: no attitude comes of it."
        in page
    )
    assert (
        "This image's camera does not look for the Sun, and no other camera's image was taken at its time."
        in page
    )
    assert "No attitude is made of this image: its camera looks for one body alone." in page
    assert "No attitude was made, so that none can be judged." in page
    assert "The cone's axis errs by" in page
    assert "limb and Sun together by" not in page
    for k, moment in enumerate(moments):
        found = images_of(report)[f"{k}.png"]
        assert found["quaternion"] is None
        off = np.degrees(np.arccos(np.clip(found["earth_direction"] @ moment.down(EARTH), -1, 1)))
        assert off < 5 * found["earth_direction_std_deg"]
        radius = np.degrees(np.arcsin(EARTH_RADIUS / np.linalg.norm(moment.position)))
        assert found["earth_angular_radius_deg"] == pytest.approx(radius, abs=0.5)


def test_a_sun_camera_alone(tmp_path):
    report = reported(
        tmp_path / "sun",
        {"a.png": pair(0).image(SUN)},
        [recording("*.png", SUN, "sun", poses=False)],
    )
    page = report.page(CHAPTER, "camera")
    assert "1 of 1 image gives what its camera looks for." in page
    assert "It is of a camera that does not look for the Earth" in page
    assert "Its middle is at pixel" in page
    found = images_of(report)["a.png"]
    assert found["sun_direction"] @ pair(0).attitude @ pair(0).sun == pytest.approx(1, abs=1e-6)


def test_a_pair_whose_image_of_the_sun_is_broken(tmp_path):
    texts = [recording("e.png", EARTH, "earth"), recording("s.png", SUN, "sun")]
    images = {"e.png": pair(0).image(EARTH), "s.png": b""}
    report = reported(
        tmp_path / "pair", images, texts, [pair(0).row("e.png"), pair(0).row("s.png")]
    )
    page = report.page(CHAPTER, "camera")
    assert (
        "The steps below are those of e.png, which shows most: no solution: file cannot be read"
        in page
    )
    assert "The image of the Sun taken at its time, s.png, cannot be read." in page
    assert "2 of 2 images have no solution: file cannot be read as an image" in page
    assert images_of(report)["e.png"]["earth_direction"] is not None


def test_without_poses(tmp_path):
    report = reported(tmp_path / "noposes", {"a.png": shot(0).image(), "b.png": shot(1).image()})
    page = report.page(CHAPTER, "camera")
    assert (
        "No time and place are known: directions in the camera's axes are all that the images can give."
        in page
    )
    assert "No attitude is made of this image: its time and place are not known." in page
    assert (
        "Time and place of this image are not known: the directions stay in the camera's axes."
        in page
    )
    assert re.search(r"An Earth of 6371 km with such a half-angle is \d+ km away", page)
    assert {image["quaternion"] for image in images_of(report).values()} == {None}


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (
            0.994,
            "inside it, .*Dark ground at the limb, or cloud that ends before it, moves edges inward, "
            "as does a place given too near",
        ),
        (
            1.006,
            "outside it, .*Air and clouds' tops stand above the ground and move the limb outward, "
            "as does a place given too far away",
        ),
    ],
)
def test_a_limb_that_is_not_the_ground_s(tmp_path, scale, words):
    # A place 50 km off moves the ground's edge by 0.4°, several standard errors of the limb's.
    moment = shot(0)
    moved = replace(moment, position=moment.position * scale)
    report = reported(tmp_path / "moved", {"a.png": moment.image()}, poses=[moved.row("a.png")])
    page = report.page(CHAPTER, "camera")
    assert re.search(words + ": the standard error knows only what the residuals show", page)


# ---- parameters, and many images ----


def test_the_image_asked_for(tmp_path):

    folder = write(
        tmp_path / "one",
        [recording("i/*.png", poses=False)],
        {"i/a.png": b"", "i/b.png": shot(0).image()},
    )
    chapter = next(c for c in chapters.CHAPTERS if c.slug == CHAPTER)

    def run(image):
        given = {"device": str(folder), "sensor": "camera", "image": image}
        outcome = executed(chapter.notebook, given, tmp_path)
        text = json.dumps(outcome.notebook, ensure_ascii=False)
        return outcome, text

    outcome, text = run("a.png")
    assert outcome.status == "complete"
    assert "as asked for: no solution" in text
    outcome, _ = run("c.png")
    assert outcome.status == "failed"
    assert [str(problem) for problem in outcome.problems] == [
        "parameters: image: there is no 'c.png' — give one of a.png, b.png"
    ]


def test_many_images_make_no_large_page(tmp_path):
    small = cv2.resize(shot(0).image(), (160, 90), interpolation=cv2.INTER_AREA)
    camera = type(ONE)(160, 90, ONE.focal_px / 4)
    rows = {f"{k:03d}.png": small if k % 3 else b"" for k in range(230)}
    report = reported(tmp_path / "many", rows, [recording("*.png", camera, "earth", poses=False)])
    page = (report.folder / "camera" / f"{CHAPTER}.html").read_text()
    assert "The table ends after 200 of 230 images; results.json has all of them." in page
    assert page.count(".png</th>") == 200
    assert len(page) < 1_500_000
    assert len(images_of(report)) == 230
    assert len(report.results["warnings"]) <= 2
    assert "77 of 230 images have no solution: file cannot be read" in page


# ---- a photograph ----


def test_a_photograph_from_the_space_station(tmp_path, real_data):
    photo = real_data / "iss-limb" / "clear_limb.jpg"
    if not photo.is_file():
        pytest.skip(f"no {photo}")
    text = recording("*.jpg", type(ONE)(4928, 2768, 56 / 36 * 4928), "earth", poses=False)
    report = reported(tmp_path / "station", {"limb.jpg": photo.read_bytes()}, [text])
    found = images_of(report)["limb.jpg"]
    assert found["status"] == "ok"
    # From 418 km up; a lens of unknown distortion.
    assert found["earth_angular_radius_deg"] == pytest.approx(69.8, abs=1.0)
    assert found["earth_angular_radius_std_deg"] < 1.0
    page = report.page(CHAPTER, "camera")
    assert "Before anything else: colour is read as luminance (ITU-R BT.601)" in page
    assert "Air many pixels deep has no sharp edge" in page
    assert any(caption.startswith("limb.jpg with the fitted limb.") for caption in figures(report))
    assert (report.folder / "camera" / f"{CHAPTER}.html").stat().st_size < 3_000_000
    shutil.rmtree(report.folder)  # a photograph by others is not kept
