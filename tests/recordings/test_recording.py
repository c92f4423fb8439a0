"""Recordings: what is found odd, the and what a recording tells of itself."""

import json
import struct
import zlib

import numpy as np
import pytest

import sensorbook
from sensorbook import InputError, Recording, Refusal
from sensorbook.recordings import check
from sensorbook.recordings.findings import saturation, too_coarse

from .conftest import recording

TIMED = """
[[recording]]
sensor = "SENSOR"
kind = "KIND"
file = "log.csv"
unit = "UNIT"
columns = { time = "t", x = "x", y = "y", z = "z" EXTRA }
"""
UNITS = {"gyroscope": "rad/s", "accelerometer": "m/s^2", "magnetometer": "uT"}


@pytest.fixture
def write(folder):
    """Writes a folder with log.csv of these columns and gives its path."""

    def write(sensor="gyroscope", kind="static", extra="", more="", **columns):
        recording = TIMED.replace("SENSOR", sensor).replace("KIND", kind)
        recording = recording.replace("UNIT", UNITS[sensor]).replace("EXTRA", extra)
        path = folder(recording + more)
        names = list(columns)
        cells = [
            ["" if v != v else repr(v) for v in np.asarray(columns[n]).tolist()] for n in names
        ]
        rows = "\n".join(map(",".join, zip(*cells, strict=True)))
        (path / "log.csv").write_text(f"{','.join(names)}\n{rows}\n")
        return path

    return write


def axes(rng, count, scale=1e-3, offset=0.0):
    values = rng.normal(scale=scale, size=(count, 3)) + offset
    return dict(zip("xyz", values.T, strict=True))


def findings(path) -> list[str]:
    problems, found = check(path)
    assert problems == []
    return [f"{f.kind}: {f.message}" for f in found]


# ---- findings ----


def test_gaps_duplicates_and_backward_stamps_are_counted(write, rng):
    index = np.delete(np.arange(1000.0), [300, 301, 700])
    index[100] = index[99]
    index[500] = index[499] - 2
    found = findings(write(t=index / 100, **axes(rng, 997)))
    assert found == [
        "duplicate: 1 sample with the same time stamp as the one before",
        "backward: the time goes back at 1 place, first at 5.01 s by 0.02 s",
        # The two rows set aside are there, in the holes that they leave.
        "gap: samples missing at 2 places, 3 in all; the longest gap is 0.03 s at 2.99 s",
    ]


def test_shuffled_rows_are_to_be_sorted(write, rng):
    """The few stamps that advance by chance tell neither the rate nor gaps."""
    (problems, (found,)) = check(write(t=rng.permutation(1000) / 100, **axes(rng, 1000)))
    assert problems == []
    assert (found.kind, found.remedy) == ("backward", "sort the rows by time")


def test_a_declared_rate_that_the_stamps_deny(write, rng):
    path = write(t=np.arange(500) / 50, **axes(rng, 500))
    text = (
        (path / "device.toml").read_text().replace('unit = "rad/s"', 'unit = "rad/s"\nrate = 100')
    )
    (path / "device.toml").write_text(text)
    assert findings(path) == [
        "rate: the time column gives 50 Hz, not the 100 Hz declared: the time column is used"
    ]
    assert sensorbook.load(path).gyroscope.static.rate == 50.0


def test_missing_values(write, rng):
    columns = axes(rng, 500)
    columns["y"][[3, 7]] = np.nan
    assert findings(write(t=np.arange(500) / 50, **columns)) == [
        "nan: 2 of 500 values missing (0.4 %)"
    ]


def test_spikes_are_named_with_their_time(write, rng):
    columns = axes(rng, 500)
    columns["z"][[100, 120]] += 0.1
    assert findings(write(t=np.arange(500) / 50, **columns)) == [
        "spike: 2 samples beyond 10 robust standard deviations, from 2 s to 2.4 s"
    ]
    (lone,) = findings(write(kind="trajectory", t=np.arange(500) / 50, **columns))
    assert lone.startswith("coverage: Nothing beside the gyroscope tells the attitude")


def test_saturation(rng):
    noise = rng.normal(size=20_000)
    assert saturation(noise, "static") == ""
    assert "highest value 2: saturated" in saturation(np.clip(noise, -9, 2), "static")
    assert "lowest value -2: saturated" in saturation(np.clip(noise, -2, 9), "static")
    assert saturation(np.clip(noise, -9, 2), "positions") == ""  # may be a rest
    counts = np.clip(np.rint(noise * 20_000), -32768, 32767).astype(np.int16)
    assert "-32768" in saturation(counts, "positions")
    assert saturation(np.rint(noise * 2).astype(np.int16), "static") == ""  # coarse, not stuck
    assert saturation(np.sin(np.arange(20_000) / 50).round(3), "rotation") == ""


@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5])  # of a step, from a level
def test_a_resolution_coarser_than_the_noise(rng, offset):
    noise = offset + rng.normal(size=(20_000, 3)) * [0.3, 0.45, 0.6]
    noise[5000] += 100  # a shock
    steps = [too_coarse(column) for column in (0.1 * np.rint(noise)).T]
    assert steps == pytest.approx([0.1, 0.1, 0.0])
    assert too_coarse(noise[:, 0]) == 0.0
    assert too_coarse(np.zeros(500)) == 0.0


def test_a_coarse_resolution_is_a_finding_of_a_rest(write, rng):
    columns = axes(rng, 500)
    assert findings(write(t=np.arange(500) / 50, **columns)) == []
    columns["y"] = 0.01 * np.rint(0.4 * rng.normal(size=500))
    assert findings(write(t=np.arange(500) / 50, **columns)) == [
        "resolution: its resolution of 0.01 rad/s on y is coarser than its noise: "
        "what is reported as white noise is that of rounding"
    ]
    (lone,) = findings(write(kind="trajectory", t=np.arange(500) / 50, **columns))
    assert lone.startswith("coverage: Nothing beside the gyroscope tells the attitude")


@pytest.mark.parametrize(
    ("sensor", "offset", "expected"),
    [
        ("accelerometer", 0.58, "reads 1 m/s^2 at rest, but gravity is 9.8 m/s²"),
        ("gyroscope", 3.0, "reads 5.2 rad/s at rest, but at rest it turns with the Earth"),
        ("magnetometer", 0.5, "reads 8.66e-07 T at rest, but the Earth's field is"),
    ],
)
def test_a_unit_that_cannot_be_right_is_named(write, rng, sensor, offset, expected):
    path = write(sensor=sensor, t=np.arange(500) / 50, **axes(rng, 500, 1e-3, offset))
    (found,) = findings(path)
    assert found.startswith(f"unit: {expected}")
    assert found.endswith(f"check the unit '{UNITS[sensor]}' and the scale")


PROBLEMS = [
    ({"x": np.zeros(500)}, "log.csv: column 'x': is constant: every sample is 0 — name the column"),
    ({"x": np.full(500, np.nan)}, "log.csv: column 'x': holds no number at all"),
    ({"t": np.zeros(500)}, "log.csv: column 't': the time does not advance — name the column that"),
    ({"t": np.full(500, np.nan)}, "log.csv: column 't': holds no time at all"),
    ({"t": np.linspace(-1, 1, 500) * 1e308}, "log.csv: column 't': spans more than 30 000 years"),
]


@pytest.mark.parametrize(("columns", "expected"), PROBLEMS)
@pytest.mark.parametrize("kind", ["static", "positions", "trajectory"])
def test_channels_that_hold_nothing(write, rng, columns, expected, kind):
    path = write(kind=kind, **({"t": np.arange(500) / 50} | axes(rng, 500) | columns))
    (line,) = map(str, check(path)[0])
    assert line.startswith(expected)


def test_ten_samples_are_too_few_and_every_column_says_so(write, rng):
    path = write(t=np.arange(10) / 50, **axes(rng, 10))
    assert [str(p) for p in check(path)[0]] == [
        f"log.csv: column '{axis}': holds 10 samples — record at least 100" for axis in "xyz"
    ]


def test_columns_of_different_length(folder, rng):
    path = folder(TIMED.replace("SENSOR", "gyroscope").replace("KIND", "static")
                  .replace("UNIT", "deg/s").replace("EXTRA", ', segment = "s"'))  # fmt: skip
    columns = {"t": np.arange(500) / 50, **axes(rng, 500), "s": np.ones(501)}
    with open(path / "log.csv", "wb") as file:  # readers go by content
        np.savez(file, **columns)
    assert [str(p) for p in check(path)[0]] == [
        "log.csv: its columns differ in length (500, 501) — save columns of one length"
    ]


# ---- temperature and segments ----

THERMAL = """
[[recording]]
sensor = "temperature"
kind = "thermal"
file = "temperature.csv"
unit = "K"
columns = { time = 0, temperature = 1 }
"""


def test_a_temperature_of_its_own_time_base_is_interpolated(write, rng):
    path = write(kind="thermal", more=THERMAL, t=100 + np.arange(500) / 50, **axes(rng, 500))
    (path / "temperature.csv").write_text("90;283,15\n130;323,15\n")
    run = sensorbook.load(path).gyroscope.thermal
    np.testing.assert_allclose(run.temperature, 10 + (10 + np.arange(500) / 50), rtol=1e-12)
    assert run.findings == ()
    assert check(path) == ([], [])


def test_a_temperature_of_another_time_is_a_problem(write, rng):
    path = write(kind="thermal", more=THERMAL, t=np.arange(500) / 50, **axes(rng, 500))
    (path / "temperature.csv").write_text("90;283,15\n130;323,15\n")
    assert [str(p) for p in check(path)[0]] == [
        "temperature.csv: temperature: does not overlap log.csv in time — record both on one clock"
    ]


def test_a_thermal_recording_needs_a_temperature(write, rng):
    path = write(kind="thermal", t=np.arange(500) / 50, **axes(rng, 500))
    assert [str(p) for p in check(path)[0]] == [
        "device.toml: recording 1 (gyroscope, thermal): columns.temperature: is missing"
        " — name the temperature's column, or add a recording of the temperature"
    ]


def test_a_temperature_column_in_fahrenheit(write, rng):
    extra = ', temperature = "T" }\ntemperature_unit = "degF"\n#'
    path = write(kind="thermal", extra=extra, t=np.arange(500) / 50, **axes(rng, 500),
                 T=np.full(500, 212.0))  # fmt: skip
    run = sensorbook.load(path).gyroscope.thermal
    np.testing.assert_allclose(run.temperature, 100, rtol=1e-14)


def test_segments_from_a_column_and_from_a_file(write, rng):
    label = np.repeat(np.array([1.0, np.nan, 2.0, 1.0]), 125)
    path = write("accelerometer", "six_position", ', segment = "s"', t=5 + np.arange(500) / 50,
                 **axes(rng, 500), s=label)  # fmt: skip
    run = sensorbook.load(path).accelerometer.six_position
    got = [(s.label, round(s.start, 9), round(s.end, 9)) for s in run.segments]
    assert got == [("1", 0.0, 2.5), ("2", 5.0, 7.5), ("1", 7.5, 10.0)]

    declaration = (path / "device.toml").read_text().replace(', segment = "s"', "")
    (path / "device.toml").write_text(declaration + 'segments = "labels.csv"\n')
    (path / "labels.csv").write_text("label,start,end\nup,6,8\ndown,9,11\n")
    run = sensorbook.load(path).accelerometer.six_position
    assert [(s.label, s.start, s.end) for s in run.segments] == [("up", 1, 3), ("down", 4, 6)]


def test_a_rotation_needs_no_rate(write, rng):
    path = write("magnetometer", "rotation", t=np.arange(500), **axes(rng, 500))
    text = (path / "device.toml").read_text().replace('time = "t",', "")
    (path / "device.toml").write_text(text)
    run = sensorbook.load(path).magnetometer.rotation
    assert run.rate is None
    assert run.provenance()["rate_hz"] is run.provenance()["duration_s"] is None
    with pytest.raises(Refusal, match="has no time base: neither a rate nor a time column"):
        run.evenly_sampled()


# ---- what a recording tells ----


def test_arrays_are_read_only():
    run = recording(np.arange(200) / 100)
    with pytest.raises(ValueError, match="read-only"):
        run.values[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        run.x[0] = 1
    with pytest.raises(ValueError, match="values has 3 rows, time has 200"):
        recording(np.arange(200) / 100, np.zeros((3, 3)))


def test_slices_keep_the_clock():
    run = recording(np.arange(1000) / 100).between(2, 5).between(3, 4)
    assert (len(run), run.time[0], run.duration) == (100, 3.0, pytest.approx(1.0))


def test_frame():
    run = recording(np.arange(200) / 100, temperature=np.full(200, 25.0))
    frame = run.to_frame()
    assert list(frame.columns) == ["x", "y", "z", "temperature"]
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame["y"], run.y)


def test_provenance_is_plain_json_and_holds_the_declaration(folder):
    run = sensorbook.load(folder()).gyroscope.static
    entry = json.loads(json.dumps(run.provenance(), allow_nan=False))
    assert len(entry.pop("sha256")) == 64
    assert entry == {
        "file": "static.csv", "sensor": "gyroscope", "kind": "static", "unit": "deg/s",
        "columns": {"x": "gx", "y": "gy", "z": "gz"}, "rate": 100.0,
        "samples": 500, "rate_hz": 100.0, "duration_s": 5.0, "gaps": 0,
    }  # fmt: skip


def test_html_is_escaped():
    run = Recording("gyroscope", "static", "<b>.csv", np.arange(3.0), np.zeros((3, 3)), rate=1.0)
    assert "<b>" not in run._repr_html_()
    assert "&lt;b&gt;.csv" in run._repr_html_()


# ---- camera ----

CAMERA = """
[[recording]]
sensor = "camera"
kind = "images"
file = "images/*.png"
camera = { width = 4, height = 3, focal_px = 5.0, to_body = [[0,1,0],[-1,0,0],[0,0,1]] }
poses = "poses.csv"
"""


def test_an_image_of_absurd_size_is_not_read(folder):
    path = folder(CAMERA)
    (path / "images").mkdir()
    for name, side in (("a.png", 16), ("b.png", 60_000)):
        size = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
        parts = [(b"IHDR", size), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
        chunks = (struct.pack(">I", len(of)) + name_ + of + struct.pack(">I", zlib.crc32(name_ + of))
                  for name_, of in parts)  # fmt: skip
        (path / "images" / name).write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    (path / "poses.csv").write_text("image,x,y,z\na.png,7e6,0,0\nb.png,7e6,0,0\n")
    problems, findings = check(path)
    assert problems == []
    told = [f.message for f in findings if f.file == "images/b.png"]
    assert told == ["image declares 3600 million pixels: none that large is read"]


def test_a_distortion_that_has_no_direction_for_a_pixel_is_a_problem(folder):
    path = folder(CAMERA.replace("focal_px = 5.0", "focal_px = 2.0, distortion = [-0.3]"))
    (problem,) = check(path)[0]
    assert str(problem).endswith(
        "camera: distortion (-0.3,) has no direction for pixel (0, 0): it turns back before — give "
        "coefficients that hold for the whole image, or the image's used part"
    )


def test_images_are_listed_by_name_with_their_poses(folder):
    path = folder(CAMERA)
    (path / "images").mkdir()
    for name in ("b.png", "a.png"):
        (path / "images" / name).write_bytes(b"png")
    (path / "poses.csv").write_text(
        "image,time,x,y,z\na.png,2024-05-01,7e6,0,0\nb.png,2024-05-01,0,7e6,0\n"
    )
    images = sensorbook.load(path).camera.images
    assert images.names == ("images/a.png", "images/b.png")
    assert images.poses["images/b.png"].position.tolist() == [0, 7e6, 0]
    assert images.poses["images/a.png"].time == np.datetime64("2024-05-01")
    assert images.poses["images/a.png"].quaternion is None
    assert json.loads(json.dumps(images.provenance()))["samples"] == 2


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "[0,1,0],[-1",
            "[0,1,0],[1",
            "camera.to_body: [[0, 1, 0], [1, 0, 0], [0, 0, 1]] is a reflection",
        ),
        ("[0,1,0],[-1", "[0,2,0],[-1", "is not a rotation: its rows are not orthonormal"),
        ("width = 4", "width = 4.5", "camera.width: 4.5 is not a number of pixels"),
        ("width = 4, ", "", "camera.width: is missing"),
        ("images/*.png", "../*.png", "file: '../*.png' leads out of the device folder"),
        ("images/*.png", "images/*.jpg", "file: no image matches 'images/*.jpg'"),
    ],
)
def test_camera_problems(folder, old, new, expected):
    path = folder(CAMERA.replace(old, new))
    with pytest.raises(InputError) as caught:
        _ = sensorbook.load(path).camera.images
    assert expected in str(caught.value)
