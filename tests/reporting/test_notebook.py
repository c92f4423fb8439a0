"""What chapters show and record, caught as the displays that Jupyter would get."""

from __future__ import annotations

import base64
import json
import math

import cameras
import numpy as np
import pandas
import pytest
from matplotlib import pyplot
from throwaway import NASTY, write_device

from sensorbook import InputError, Recording, notebook


@pytest.fixture
def shown(monkeypatch):
    """The (data, metadata) of every display."""
    caught = []

    def display(data, raw, metadata):
        assert raw
        json.dumps([data, metadata], allow_nan=False)
        caught.append((data, metadata))

    monkeypatch.setattr(notebook, "display", display)
    return caught


def test_a_sentence_formats_numbers_and_makes_text_inert(shown):
    notebook.say("**{name}** has {n:.2f} of {k}", name="a*b<i>\n", n=np.float64(3.14159), k=2)
    ((data, _),) = shown
    assert data["text/markdown"] == "**a&#42;b&#60;i&#62;** has 3.14 of 2"


def test_a_sentence_without_values_is_shown_as_it_is(shown):
    notebook.say("Braces {stay} and *so* does $x$")
    assert shown[0][0]["text/markdown"] == "Braces {stay} and *so* does $x$"


def test_a_missing_value_is_an_error(shown):
    with pytest.raises(KeyError, match="other"):
        notebook.say("{one} {other}", one=1)


def test_a_figure_is_shown_once_with_its_description(shown):
    figure, axes = pyplot.subplots(figsize=(4, 3))
    axes.plot([1, 2])
    notebook.show(axes, caption="A *line*", alt="A line", thumbnail=True)
    (data, metadata), (caption, about) = shown
    assert base64.b64decode(data["image/png"]).startswith(b"\x89PNG")
    png = metadata["image/png"]
    assert (png["alt"], png["caption"], png["thumbnail"]) == ("A line", "A *line*", True)
    assert 300 < png["width"] < 450
    assert caption["text/markdown"] == "*A &#42;line&#42;*"
    assert about == {"sensorbook": "caption"}
    assert figure.number not in pyplot.get_fignums()


def test_a_figure_needs_words(shown):
    with pytest.raises(ValueError, match="caption"):
        notebook.show(pyplot.figure())
    pyplot.close("all")


def test_tables_have_a_caption_and_escape_their_cells(shown):
    notebook.show(pandas.DataFrame({"<b>": ["<i>"]}), caption="The <table>")
    html = shown[0][0]["text/html"]
    assert "<caption>The &lt;table&gt;</caption>" in html
    assert "&lt;b&gt;" in html
    assert "&lt;i&gt;" in html


def test_anything_with_html_is_a_table(shown):
    class Result:
        def _repr_html_(self):
            return "<p>1</p>"

    notebook.show(Result(), caption="c")
    assert shown[0][0]["text/html"] == "<p>1</p><p>c</p>"


def test_a_record_holds_plain_numbers(shown):
    notebook.record(
        {"a": np.float32(1.5), "b": np.arange(3), "c": (1, None, "x"), "d": {"e": np.bool_(True)}},
        warnings=[{"message": "odd"}],
    )
    data = shown[0][0]
    assert data[notebook.MIME] == {
        "results": {"a": 1.5, "b": [0, 1, 2], "c": [1, None, "x"], "d": {"e": True}},
        "warnings": [{"file": "", "message": "odd"}],
    }


@pytest.mark.parametrize("value", [math.nan, math.inf, np.float64("nan"), np.array([0, -np.inf])])
def test_a_record_never_holds_nan(shown, value):
    with pytest.raises(ValueError, match=r"results\.noise\.x"):
        notebook.record({"noise": {"x": value}})
    assert not shown


def test_a_record_of_something_else_is_an_error(shown):
    with pytest.raises(TypeError, match=r"results\.a is a object"):
        notebook.record({"a": object()})


def test_a_warning_is_shown_and_recorded(shown):
    notebook.warn("odd <b>", "data.csv")
    data = shown[0][0]
    assert data[notebook.MIME] == {"warnings": [{"file": "data.csv", "message": "odd <b>"}]}
    assert "odd &lt;b&gt;" in data["text/html"]


def test_load_shows_the_recordings_and_records_where_they_come_from(shown, tmp_path):
    folder = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")], NASTY)
    device, runs = notebook.load(str(folder), "gyroscope", "static")
    assert device.id == "dev-1"
    assert len(runs) == 1
    data = shown[0][0]
    assert "<td>data.csv</td><td>20 s</td><td>10 Hz</td>" in data["text/html"]
    record = data[notebook.MIME]
    assert record["device"]["name"] == NASTY
    assert set(record["device"]["spec"]) == {"random_walk", "bias_instability", "rate_random_walk"}
    assert record["inputs"][0]["columns"]["x"] == "x"


def test_load_of_images_shows_their_camera(shown, tmp_path):
    night = {"a.png": np.zeros((360, 640), np.uint8), "b.png": np.zeros((360, 640), np.uint8)}
    recordings = [cameras.recording("*.png", sees="earth", poses=False)]
    folder = cameras.write(tmp_path / "cam", recordings, night)
    _, runs = notebook.load(str(folder), "camera", "images")
    ((data, _),) = shown
    assert [len(run) for run in runs] == [2]
    assert data["text/plain"] == "*.png, 2, 640 × 360 px, 184.75 px, Earth"
    head = "<th>Recording</th><th>Images</th><th>Size</th><th>Focal length</th><th>Looks for</th>"
    assert head in data["text/html"]
    (about,) = data[notebook.MIME]["inputs"]
    assert (about["samples"], about["camera"]["sees"]) == (2, "earth")


def test_load_says_what_to_add_where_there_is_no_recording(tmp_path):
    folder = write_device(tmp_path / "d", "dev-1", [("gyroscope", "static")])
    with pytest.raises(InputError, match="no magnetometer recording of kind 'static'"):
        notebook.load(str(folder), "magnetometer", "static")


def test_a_needed_record_may_be_missing_on_purpose_only(tmp_path):
    assert notebook.read_record("") is None
    (tmp_path / "r.json").write_text('{"a": 1}')
    assert notebook.read_record(str(tmp_path / "r.json")) == {"a": 1}
    with pytest.raises(InputError, match="cannot be read"):
        notebook.read_record(str(tmp_path / "none.json"))


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.5, "0.5 s"),
        (119, "119 s"),
        (300, "5 min"),
        (7200, "2 h"),
        (86400, "24 h"),
        (2e5, "2.31 d"),
    ],
)
def test_durations_are_in_the_unit_a_reader_would_choose(seconds, words):
    assert notebook.duration_words(seconds) == words


@pytest.mark.parametrize(("value", "half", "text"), [
    (-0.5873, 0.3142, "−0.59 ± 0.31"),
    (-0.001, 0.02, "−0.001 ± 0.020"),
    (-0.0001, 0.02, "0.000 ± 0.020"),  # no minus zero
    (19.826, 0.2, "19.83 ± 0.20"),
    (1234.5, 87.6, "1234 ± 88"),
    (1.5, 0.0, "1.5"),
    (-1.5, math.inf, "−1.5"),
    (-1.5, math.nan, "−1.5"),
])  # fmt: skip
def test_a_number_with_the_half_of_its_interval(value, half, text):
    assert notebook.signed(value, half) == text


def test_a_recording_is_calibrated_by_the_first_record_that_can(shown, tmp_path):
    matrix, bias = np.diag([1.01, 0.99, 1.0]), [0.1, -0.2, 0.3]
    result = {
        "method": "multi_position", "matrix": matrix.tolist(), "bias": bias, "g_sensitivity": None,
        "std": {"matrix": np.zeros((3, 3)).tolist(), "bias": [0, 0, 0]}, "unit": "m/s^2",
    }  # fmt: skip
    refused, complete = tmp_path / "refused.json", tmp_path / "complete.json"
    refused.write_text(json.dumps({"status": "refused", "reason": "too few", "results": {}}))
    complete.write_text(json.dumps({"status": "complete", "results": {"calibration": result}}))
    rng = np.random.default_rng(1)
    true = rng.normal(size=(200, 3))
    raw = Recording("accelerometer", "trajectory", "a.csv", np.arange(200) / 50, true @ matrix.T + bias,
                    None, 50.0, "m/s^2")  # fmt: skip
    found = notebook.calibrated(raw, "", str(refused), str(complete))
    assert found.values == pytest.approx(true)
    assert "is corrected with the calibration (multi position)" in shown[0][0]["text/plain"]
    assert notebook.calibrated(raw, "", str(refused)) is raw
    assert shown[-1][0]["text/plain"].startswith("No calibration of the accelerometer is at hand")
