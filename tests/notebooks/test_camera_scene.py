"""The chapter with work C's simulator: its numbers, its sentences, and the window's controls."""

import json
from itertools import pairwise

import nbclient
import nbformat
import numpy as np
import pytest
from devices import ended, read_chapter

from sensorbook.camera.scene import EARTH_RADIUS, HEIGHTS
from sensorbook.camera.steps import centre_bias
from sensorbook.reporting import chapters


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    return read_chapter("camera_scene", tmp_path_factory.mktemp("chapter"))


def degrees(vector):
    return np.degrees(np.linalg.norm(vector))


def test_numbers(read):
    found = read[0]["results"]["camera_scene"]
    assert found["status"] == {"limb_and_sun": "ok", "chain": "ok"}
    assert degrees(found["error"]["limb_and_sun"]) < 0.05
    assert degrees(found["error"]["chain"]) > 5
    for name, example in found["examples"].items():
        # The goals of the study: means over random attitudes; C's chain is a hundred times worse.
        assert degrees(example["limb_and_sun"]) < 0.05, name
        assert degrees(example["chain"]) > 100 * degrees(example["limb_and_sun"]), name
    assert degrees(found["examples"]["LEO, two cameras"]["chain"]) > 5
    assert degrees(found["examples"]["GEO, one camera"]["chain"]) < 0.5


def test_sentences(read):
    record, text = read
    off = record["results"]["camera_scene"]["off_axis"]["value"]
    radius = np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + HEIGHTS["leo"]))
    error = np.degrees(centre_bias(off, radius))
    assert f"the Earth's disc is **{2 * np.degrees(radius):.1f}°** wide" in text
    assert f"has its middle **{error:.2f}°** too far out" in text
    assert "found so that both are in view" in text
    assert record["warnings"] == []


def test_given_angles_and_an_open_limb(tmp_path):
    # One camera at LEO, 101° between the Sun and the nadir: the limb's image is a hyperbola.
    record, text = read_chapter(
        "camera_scene", tmp_path, cameras="one", look="full", angles=[153.0, -5.0, -119.0]
    )
    assert "Yaw, pitch and roll are 153.0°, −5.0° and −119.0°, as given" in text
    assert "together they are beyond 90°, and the limb's image is a branch of a hyperbola" in text
    found = record["results"]["camera_scene"]
    assert degrees(found["error"]["chain"]) > 1  # of an ellipse that it makes up
    assert degrees(found["error"]["limb_and_sun"]) < 0.05


def test_no_solution_is_a_warning(tmp_path):
    record, text = read_chapter("camera_scene", tmp_path, place=135.0)
    (warning,) = record["warnings"]
    assert warning["message"].startswith("The Earth hides the Sun: the satellite is in its shadow.")
    assert "zero, for want of any that show both" in text
    assert record["results"]["camera_scene"]["error"]["limb_and_sun"] is None
    assert "By limb and Sun together the attitude is" not in text


def test_a_wrong_sun_and_a_limb_out_of_view_are_said(tmp_path):
    # The camera looks away from both; in the three examples some pixel is as white as the Sun.
    record, text = read_chapter(
        "camera_scene", tmp_path, orbit="geo", cameras="one", noise=50.0, angles=[0.0, 0.0, 0.0]
    )
    assert "Look for: what is in view, as neither way finds the Earth's edge." in text
    assert "nothing of it is in this picture" in text
    assert "the large error of C's chain is none of the ellipse's: the brightest spot" in text
    assert "What C's chain takes for the Sun is" in text
    assert record["results"]["camera_scene"]["status"]["chain"] == (
        "No Earth: The image has no edge."
    )


def test_nonsense_is_named(tmp_path):
    status, reason = ended(
        "camera_scene", tmp_path, orbit="heo", place=400.0, angles=[0.0, 95.0, 0.0],
        cameras="three", look="night", noise=-1.0, seed=-1,
    )  # fmt: skip
    assert status == "failed"
    for line in (
        "orbit: is 'heo' — give one of leo, meo, geo",
        "place: place is 400° — give -360 to 360°",
        "angles: pitch is 95° — give -90 to 90°",
        "cameras: is 'three' — give one of one, two",
        "look: is 'night' — give one of full, lambert, textured",
        "noise: noise is -1 grey levels — give 0 to 50 grey levels",
        "seed: seed is -1 — give a whole number, 0 to 4.29497e+09",
    ):
        assert line in reason


def test_too_few_angles_are_named(tmp_path):
    status, reason = ended("camera_scene", tmp_path, angles=[1.0])
    assert status == "failed"
    assert "angles: is [1.0] — give a list of 3: yaw [°], pitch [°], roll [°]" in reason


# --- the window ---

DRIVEN = """
import json

def shown():
    angles = [slider.value for slider in sliders.values()]
    return {"angles": angles, "picture": hash(picture.value), "numbers": numbers.value}

states = {"start": shown()}
sliders["yaw"].value += 8
states["yaw"] = shown()
choices["look"].value = "full"
states["look"] = shown()
another.click()
states["another"] = shown()
choices["orbit"].value = "geo"
states["orbit"] = shown()
choices["cameras"].value = 1
states["cameras"] = shown()
sliders["place"].value = -45
states["wide"] = shown()
another.click()
states["none"] = shown()
choices["orbit"].value = "leo"
sliders["place"].value = 135
states["shadow"] = shown()
print(json.dumps(states))
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """What the window shows after each turn of its controls, in a kernel without a browser."""
    chapter = next(c for c in chapters.CHAPTERS if c.slug == "camera_scene")
    book = nbformat.read(chapter.notebook, as_version=4)
    last = max(i for i, cell in enumerate(book.cells) if "widgets.VBox" in cell.source)
    assert "teaching" in book.cells[last].metadata["tags"]
    # Without the pages between, which the window does not need.
    head, tail = (
        next(i for i, cell in enumerate(book.cells) if cell.source.startswith(title))
        for title in ("## Why the ellipse misleads", "## The window")
    )
    needed = book.cells[:head] + book.cells[tail : last + 1]
    book.cells = [*needed, nbformat.v4.new_code_cell(DRIVEN)]
    folder = str(tmp_path_factory.mktemp("window"))
    nbclient.NotebookClient(book, timeout=120, resources={"metadata": {"path": folder}}).execute()
    (output,) = book.cells[-1].outputs
    window = next(o for o in book.cells[-2].outputs if o.output_type == "execute_result")
    assert "application/vnd.jupyter.widget-view+json" in window.data
    assert "VBox" in window.data["text/plain"], "what shows where widgets do not"
    return json.loads(output.text)


def test_every_control_changes_picture_and_table(driven):
    names = ["start", "yaw", "look", "another", "orbit", "cameras", "wide"]
    for before, after in pairwise(names):
        assert driven[before]["picture"] != driven[after]["picture"], after
        assert driven[before]["numbers"] != driven[after]["numbers"], after


def test_a_slider_turns_the_satellite(driven):
    assert driven["yaw"]["angles"][1] == driven["start"]["angles"][1] + 8
    assert f"<td>{driven['yaw']['angles'][1]:.3f}</td>" in padded(driven["yaw"]["numbers"])


def test_another_attitude_and_a_new_orbit_show_both(driven):
    for name in ("another", "orbit", "cameras"):
        assert "<p>Turn" not in driven[name]["numbers"], name
        assert "view" not in driven[name]["numbers"], name
    assert driven["another"]["angles"][1:] != driven["yaw"]["angles"][1:]


def test_what_the_window_cannot_show_is_said(driven):
    assert "more than the cameras&#x27; views span" in driven["wide"]["numbers"]
    # No attitude is found, so none is set.
    assert driven["none"]["angles"] == driven["wide"]["angles"]
    assert "the angles stay as they were" in driven["none"]["numbers"]
    assert "the angles stay" not in driven["another"]["numbers"]
    assert "The Earth hides the Sun: the satellite is in its shadow." in driven["shadow"]["numbers"]


def padded(table):
    """Numbers of one decimal with three."""
    return table.replace(".0</td>", ".000</td>")
