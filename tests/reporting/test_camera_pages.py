"""A camera's images in results.json, its schema, index, group page, csv, gate, comparison and check."""

import copy
import csv
import io
import json
import re
import struct
import zlib

import numpy as np
import pytest
from cameras import png, recording, shot, write
from jsonschema import Draft202012Validator, ValidationError

from sensorbook.cli import main
from sensorbook.reporting import group, index, results
from sensorbook.reporting.cameras import camera_numbers, camera_table
from sensorbook.reporting.gate import gate
from sensorbook.reporting.junit import junit_xml

SOFTWARE = dict.fromkeys(("sensorbook", "python", "numpy", "scipy"), "1")
EMPTY = dict.fromkeys(
    ("earth_direction", "earth_direction_std_deg", "earth_angular_radius_deg",
     "earth_angular_radius_std_deg", "limb_residual_px", "sun_direction", "sun_direction_std_deg",
     "quaternion", "attitude_std_deg", "attitude_covariance", "error_deg", "partner", "note", "time")
)  # fmt: skip
SOLVED = {
    "image": "a.png", "status": "ok", "sees": "both", "earth_direction": [0.6, 0.0, 0.8],
    "earth_direction_std_deg": 0.02, "earth_angular_radius_deg": 49.6, "earth_angular_radius_std_deg": 0.05,
    "limb_residual_px": 0.3, "sun_direction": [0.0, 0.6, 0.8], "sun_direction_std_deg": 0.005,
    "quaternion": [0.0, 0.6, 0.0, 0.8], "attitude_std_deg": [0.03, 0.04, 0.0], "error_deg": 0.04,
    "attitude_covariance": [[2.7e-7, 0.0, 0.0], [0.0, 4.9e-7, 0.0], [0.0, 0.0, 0.0]],
    "time": "2024-05-01T12:00:00.250000Z", "partner": None, "note": "12 bits are read as 8",
}  # fmt: skip
# A pair's two images, one attitude, and three that gave nothing.
PAIR = [
    SOLVED | {"image": "e.png", "sees": "earth", "partner": "s.png", "attitude_std_deg": [0.0, 0.0, 0.1],
              "sun_direction": None, "sun_direction_std_deg": None, "error_deg": 0.08},
    EMPTY | {"image": "s.png", "status": "ok", "sees": "sun", "partner": "e.png", "error_deg": 0.08,
             "sun_direction": [0, 0, 1], "sun_direction_std_deg": 0.005, "quaternion": [0, 0, 0, 1],
             "attitude_std_deg": [0.0, 0.0, 0.1]},
]  # fmt: skip
BAD = [
    EMPTY | {"image": "b.png", "status": "no solution: Sun not in view", "sees": "both"},
    EMPTY | {"image": "c.png", "status": "no solution: Sun not in view (d.png)", "sees": "earth",
             "partner": "d.png"},
    EMPTY | {"image": "<b>&.png", "status": "no solution: <script>alert(1)</script>", "sees": "both"},
]  # fmt: skip
ALL = [SOLVED, *PAIR, *BAD]


def assembled(images, reason=None, folder="cam"):
    """results.json of a device with these images, or with a refused chapter."""
    record = {
        "sensor": "camera", "chapter": "horizon_sun_camera", "title": "Horizon and Sun camera",
        "status": "refused" if reason else "complete", "reason": reason,
        "results": {} if reason else {"images": images},
        "inputs": [{"file": "*.png", "sha256": 64 * "0", "sensor": "camera", "kind": "images", "samples": 6,
                    "rate_hz": None, "duration_s": None, "gaps": 0}],
    }  # fmt: skip
    device = {"id": folder, "name": "Camera", "model": None, "serial": None, "spec": {}}
    found = results.assemble(device, SOFTWARE, "2026-01-01T00:00:00+00:00", [record])
    return json.loads(results.dumps(found))


def validate(found):
    Draft202012Validator(json.loads(results.SCHEMA.read_text())).validate(found)


# ---- results.json ----


@pytest.mark.parametrize("images", [ALL, BAD, [], [SOLVED]])
def test_the_schema_takes_all_of_them(images):
    validate(assembled(images))


def test_the_schema_takes_a_refusal():
    found = assembled(None, "The files hold nothing.")
    assert found["sensors"]["camera"] == {"images": {"reason": "The files hold nothing."}}
    validate(found)


@pytest.mark.parametrize(
    "change",
    [
        {"status": None}, {"status": ""}, {"image": 3}, {"sees": "moon"}, {"earth_direction": [0, 1]},
        {"earth_angular_radius_deg": 90}, {"earth_angular_radius_deg": 0}, {"earth_direction_std_deg": -1},
        {"quaternion": [0, 0, 1]}, {"attitude_std_deg": [1, 2]}, {"error_deg": "0.1"}, {"partner": 2},
        {"attitude_covariance": [1e-7, 1e-7, 1e-7]}, {"time": 1714564800.0}, {"time": "yesterday"},
    ],
)  # fmt: skip
def test_the_schema_refuses(change):
    with pytest.raises(ValidationError):
        validate(assembled([SOLVED | change]))


@pytest.mark.parametrize("key", ["image", "status", "earth_direction", "quaternion", "error_deg"])
def test_keys_of_the_contract_are_required(key):
    with pytest.raises(ValidationError):
        validate(assembled([{k: v for k, v in SOLVED.items() if k != key}]))


def test_more_keys_are_taken():
    validate(assembled([SOLVED | {"more": 1}]))


# ---- numbers in short ----


def test_numbers():
    numbers = camera_numbers({"images": ALL})
    assert numbers == {
        "solved_percent": 50.0,
        "earth_direction_std_deg": 0.02,
        # Of errors vectors' sizes 0.05 and 0.1: the pair's attitude counts once.
        "attitude_std_deg": pytest.approx(0.075),
        "attitude_error_deg": pytest.approx(0.06),
    }
    assert camera_numbers({"images": BAD}) == {"solved_percent": 0.0}
    for none in ({}, {"images": []}, {"images": {"reason": "none"}}, {"noise": {}}):
        assert camera_numbers(none) == {}
        assert camera_table(none) is None


def test_reasons_are_counted_without_the_partner_s_name():
    table = camera_table({"images": ALL})
    assert table["solved"] == "3 of 6 images"
    assert camera_table({"images": [SOLVED]})["solved"] == "1 of 1 image"
    assert table["reasons"] == [("Sun not in view", 2), ("<script>alert(1)</script>", 1)]
    assert [(row["name"], row["value"], row["unit"]) for row in table["rows"]] == [
        ("Earth's direction, standard error per axis", "0.02", "°"),
        ("Attitude, standard error of all axes", "0.075", "°"),
        ("Attitude, error", "0.06", "°"),
    ]
    assert table["caption"].endswith("; mean of the errors against the true attitude")
    blind = camera_table({"images": [SOLVED | {"error_deg": None}]})
    assert blind["caption"].startswith(
        "Medians of the standard errors: of a direction for each axis"
    )
    assert "true attitude" not in blind["caption"]
    many = [EMPTY | {"image": f"{k}", "status": f"no solution: reason {k}"} for k in range(30)]
    assert (
        len(camera_table({"images": many})["reasons"]),
        camera_table({"images": many})["more"],
    ) == (8, 22)


def test_csv():
    rows = list(csv.DictReader(io.StringIO(results.csv_text(assembled(ALL)))))
    assert {
        (r["sensor"], r["quantity"]): (float(r["value"]), r["unit"], r["field_unit"]) for r in rows
    } == {
        ("camera", "solved_percent"): (50.0, "percent", "%"),
        ("camera", "earth_direction_std_deg"): (0.02, "deg", "°"),
        ("camera", "attitude_std_deg"): (pytest.approx(0.075), "deg", "°"),
        ("camera", "attitude_error_deg"): (pytest.approx(0.06), "deg", "°"),
    }
    assert results.csv_text(assembled(None, "nothing")).splitlines() == [",".join(results.COLUMNS)]


# ---- pages ----


def test_index(tmp_path):
    page = " ".join(index.device_page(assembled(ALL), tmp_path).split())
    assert "A camera is judged against no limits: what its images gave stands below." in page
    assert "<strong>3 of 6 images solved.</strong>" in page
    assert (
        "Without solution: 2 × Sun not in view; 1 × &lt;script&gt;alert(1)&lt;/script&gt;." in page
    )
    assert "<script>alert" not in page
    assert '<th scope="row">Attitude, error</th><td>0.06</td>' in page
    assert "<td>camera</td><td>images</td><td>–</td><td>–</td><td>6 images</td>" in page


def test_index_of_none_solved_and_of_a_refusal(tmp_path):
    page = index.device_page(assembled(BAD), tmp_path)
    assert "0 of 3 images solved." in page
    assert "Attitude, error" not in page
    page = index.device_page(assembled(None, "The files hold nothing."), tmp_path)
    assert "images solved" not in page
    assert "The files hold nothing." in page
    failed = assembled(None, "fault")
    failed["chapters"][0] |= {"status": "failed", "page": None}
    failed["sensors"] = {}
    page = index.device_page(failed, tmp_path)
    assert "A camera is judged against no limits." in page
    assert "stands below" not in page


def test_group_page(tmp_path):
    for name, images in (("good", ALL), ("bad", BAD)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "results.json").write_text(json.dumps(assembled(images, folder=name)))
    page = group.group_page(tmp_path)
    assert "Camera<br>Images solved<br>" in page
    assert "Camera<br>Earth&#39;s direction, standard error per axis, median<br>" in page
    assert "A camera's numbers are of all its images that have them: medians" in page
    assert "worst axis" not in page
    assert "Camera<br>Attitude, error, mean<br>" in page
    rows = {
        line.split("index.html'>")[1].split("<")[0]: line
        for line in page.splitlines()
        if "<tr><th scope=row>" in line
    }
    assert "<td>0.0600 <td>0.0750 <td>0.0200 <td>50.0 <td>" in rows["good"]
    assert "<td>–<td>–<td>–<td>0.00 <td>" in rows["bad"]
    assert list(rows) == ["bad", "good"], "those that need attention first"
    needing = page.split('id="attention"')[1].split("</ul>")[0]
    assert "camera: none of its images is solved" in needing
    assert "good" not in needing


def test_group_page_of_a_results_json_by_others(tmp_path):
    wrong = assembled(ALL)
    wrong["sensors"]["camera"]["images"] = [{"image": "a"}]
    (tmp_path / "wrong").mkdir()
    (tmp_path / "wrong" / "results.json").write_text(json.dumps(wrong))
    assert "its results.json cannot be read" in group.group_page(
        tmp_path
    ) or "failed" in group.group_page(tmp_path)


# ---- gate, junit, comparison ----


def test_gate_and_junit():
    found = assembled(ALL)
    assert list(gate(found)) == [
        "cam: cannot be decided: it is a camera, on which no limits can be set"
    ]
    text = junit_xml([found], {("cam", "camera", "horizon_sun_camera"): 1.0})
    assert "horizon_sun_camera" in text


def test_comparison_leaves_images_out(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.json").write_text(json.dumps(assembled(ALL)))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 0
    assert capsys.readouterr().out.splitlines()[2:] == [
        "  Note: a camera's results are its images: they are not compared",
        "  Nothing to compare: the two have no number with an interval in common.",
    ]


def test_a_camera_has_no_calibration_to_apply(tmp_path, capsys):
    (tmp_path / "cam.json").write_text(json.dumps(assembled(ALL)))
    (tmp_path / "log.csv").write_text("x,y,z\n1,2,3\n")
    out = tmp_path / "out.csv"
    assert (
        main(["apply", str(tmp_path / "cam.json"), str(tmp_path / "log.csv"), "-o", str(out)]) == 1
    )
    assert capsys.readouterr().err == (
        f"{tmp_path}/cam.json: inputs: are a camera's images: a camera has no calibration that could be "
        "applied — name the results.json of an inertial sensor or a magnetometer\n"
    )
    assert not out.exists()


# ---- declarations ----

NIGHT = np.zeros((360, 640), np.uint8)


def checked(folder, capsys):
    code = main(["check", str(folder)])
    said = capsys.readouterr()
    return code, (said.out + said.err).splitlines()


def test_check_of_a_good_folder(tmp_path, capsys):
    moment = shot(0)
    folder = write(tmp_path / "cam", [recording("*.png")], {"a.png": NIGHT}, [moment.row("a.png")])
    assert checked(folder, capsys) == (0, [f"{folder}: nothing to mend"])


def test_check_names_images_that_cannot_be_used(tmp_path, capsys):
    images = {
        "a.png": NIGHT,
        "b.png": b"none",
        "c.png": NIGHT[:100],
        "d.png": NIGHT[:100],
        "e.png": b"none",
    }
    folder = write(tmp_path / "cam", [recording("*.png", poses=False)], images)
    mend = "mend the image or the camera table; a report goes on without it"
    assert checked(folder, capsys) == (
        0,
        [
            "warning: b.png: file cannot be read as an image (not one that is known); the same of "
            f"e.png — {mend}",
            "warning: c.png: image is 640 × 100 pixels, its camera 640 × 360; the same of "
            f"d.png — {mend}",
            f"{folder}: 2 warnings",
        ],
    )


def test_check_of_bad_poses(tmp_path, capsys):
    row = shot(0).row("a.png") | {"x": 1.0, "y": 2.0, "z": 2.0}
    folder = write(tmp_path / "cam", [recording("*.png")], {"a.png": NIGHT}, [row])
    code, lines = checked(folder, capsys)
    assert code == 1
    assert lines[0] == (
        "poses.csv: row 1 (a.png): x y z are 3 m from the Earth's centre, inside the Earth — give metres, ECI"
    )


@pytest.mark.parametrize("radius", [6371000.0, 7e6])
def test_check_of_a_place_inside_the_declared_earth(tmp_path, capsys, radius):
    row = shot(0).row("a.png") | {"x": radius - 1000, "y": 0.0, "z": 0.0}
    text = recording("*.png").replace("earth_radius = 6371000.0", f"earth_radius = {radius}")
    folder = write(tmp_path / "cam", [text], {"a.png": NIGHT}, [row])
    code, lines = checked(folder, capsys)
    assert (code, lines) == (
        1,
        [
            f"poses.csv: row 1 (a.png): x y z are {radius - 1000:.6g} m from the Earth's centre, "
            "inside the Earth — give metres, ECI"
        ],
    )
    row["x"] = radius + 1000
    folder = write(tmp_path / "above", [text], {"a.png": NIGHT}, [row])
    assert checked(folder, capsys)[0] == 0


def test_check_tells_all_that_is_wrong_with_images_in_one_go(tmp_path, capsys):
    row = shot(0).row("a.png") | {"time": "noon"}
    folder = write(tmp_path / "cam", [recording("images/*.png")], {"images/a.png": NIGHT}, [row])
    (tmp_path / "out.png").write_bytes(png(NIGHT))
    (folder / "images" / "dangling.png").symlink_to("none.png")
    (folder / "images" / "out.png").symlink_to(tmp_path / "out.png")
    (folder / "images" / "sub.png").mkdir()
    code, lines = checked(folder, capsys)
    where = "device.toml: recording 1 (camera, images): file: 'images"
    assert code == 1
    assert [line.split(" — ")[0] for line in lines] == [
        f"{where}/dangling.png' does not exist",
        f"{where}/out.png' is a link that leads out of the device folder",
        f"{where}/sub.png' is not a file",
        "poses.csv: row 1 (a.png): time: 'noon' is no time",
    ]


def test_a_linked_folder_is_told_as_one(tmp_path, capsys):
    folder = write(tmp_path / "cam", [recording("images/*.png", poses=False)], {"b.png": NIGHT})
    (tmp_path / "elsewhere").mkdir()
    for name in ("a.png", "b.png"):
        (tmp_path / "elsewhere" / name).write_bytes(png(NIGHT))
    (folder / "images").symlink_to(tmp_path / "elsewhere")
    assert checked(folder, capsys) == (
        1,
        [
            "device.toml: recording 1 (camera, images): file: 'images' is a link that leads out of the"
            " device folder — copy the file into the folder"
        ],
    )


def header(width, height):
    """A PNG whose header declares a size that its few bytes do not hold."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    about = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = chunk(b"IHDR", about) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def test_an_image_beyond_any_size_costs_only_itself(tmp_path, capsys):
    images = {"a.png": NIGHT, "b.png": header(60000, 60000), "c.png": header(11000, 10000)}
    folder = write(tmp_path / "cam", [recording("*.png", poses=False)], images)
    mend = "mend the image or the camera table; a report goes on without it"
    assert checked(folder, capsys) == (
        0,
        [
            f"warning: b.png: image declares 3600 million pixels: none that large is read — {mend}",
            f"warning: c.png: image is 11000 × 10000 pixels, its camera 640 × 360 — {mend}",
            f"{folder}: 2 warnings",
        ],
    )


def test_hidden_files_are_left_out(tmp_path, capsys):
    images = {"a.png": NIGHT, "._a.png": b"a system's own"}
    folder = write(tmp_path / "cam", [recording("*.png", poses=False)], images)
    assert checked(folder, capsys) == (0, [f"{folder}: nothing to mend"])
    (folder / "a.png").unlink()
    assert "no image matches '*.png'" in checked(folder, capsys)[1][0]


def test_images_that_two_recordings_list(tmp_path, capsys):
    twice = [recording("*.png", poses=False), recording("./*.png", poses=False)]
    folder = write(tmp_path / "cam", twice, {"a.png": NIGHT})
    assert checked(folder, capsys) == (
        1,
        [
            "device.toml: recording 2 (camera, images): file: './*.png' is that of recording 1 "
            "(camera, images) already — give each camera a folder of its own, or leave one recording out"
        ],
    )


def test_images_that_two_patterns_share(tmp_path, capsys):
    both = [recording("*.png", poses=False), recording("a*.png", poses=False)]
    folder = write(tmp_path / "cam", both, {f"{k}.png": NIGHT for k in ("a1", "a2", "b")})
    assert checked(folder, capsys) == (
        0,
        [
            "warning: a1.png: 2 images belong to two recordings, this one first: each counts twice"
            " — give each camera a folder of its own",
            f"{folder}: 1 warning",
        ],
    )


def test_a_row_of_several_images_is_told(tmp_path, capsys):
    images = {f"{place}/{name}.png": NIGHT for place in ("one", "two") for name in "ab"}
    both = [recording("one/*.png"), recording("two/*.png")]
    rows = [shot(0).row("a.png"), shot(0).row("b.png")]
    folder = write(tmp_path / "cam", both, images, rows)
    told = [
        "warning: poses.csv: a.png: is the row of 2 images alike, one/a.png and two/a.png, and so is 1 more "
        "— name images by their path in the device folder where they were not taken together",
        f"{folder}: 1 warning",
    ]
    assert checked(folder, capsys) == (0, told)
    rows = [shot(0).row(name) for name in images]
    folder = write(tmp_path / "named", both, images, rows)
    assert checked(folder, capsys) == (0, [f"{folder}: nothing to mend"])


def test_the_contract_s_example(tmp_path, capsys):
    """An inline table over several lines, with comments: TOML 1.1."""
    example = """[[recording]]
sensor = "camera"
kind = "images"
file = "images/*.png"                # pattern, sorted by name
camera = { width = 1280, height = 720, focal_px = 369.5, principal_point = [639.5, 359.5], distortion = [0.0, 0.0],
           sees = "both",            # earth | sun | both
           to_body = [[1,0,0],[0,1,0],[0,0,1]] }
poses = "poses.csv"                  # optional: image, time (UTC), satellite x y z in ECI metres
"""  # noqa: E501
    row = {("time (UTC)" if key == "time" else key): v for key, v in shot(0).row("a.png").items()}
    night = np.zeros((720, 1280), np.uint8)
    folder = write(tmp_path / "cam", ["\n" + example], {"images/a.png": night}, [row])
    assert checked(folder, capsys) == (0, [f"{folder}: nothing to mend"])


def test_the_contract_s_example_as_it_stands(real_data, tmp_path, capsys):
    text = (real_data.parent / "contract.md").read_text()
    (example,) = [e for e in re.findall("```toml\n(.*?)```", text, re.S) if '"camera"\n' in e]
    assert "#" in example.split("camera = {")[1].split("\n")[1], "a comment within the inline table"
    night = np.zeros((720, 1280), np.uint8)
    folder = write(
        tmp_path / "cam", ["\n" + example], {"images/a.png": night}, [shot(0).row("a.png")]
    )
    assert checked(folder, capsys) == (0, [f"{folder}: nothing to mend"])


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("width = 640\n", "", "camera.width: is missing — a camera needs width, height and focal_px"),
        ("width = 640\nheight = 360", "width = 20000\nheight = 10000",
         "camera: has 20000 × 10000 pixels, 200 million — at most 100 million are read"),
        ("focal_px =", "principal_point = [9000, 179.5]\nfocal_px =", "camera.principal_point: [9000, 179.5] "
         "is far outside the image of 640 × 360 pixels — write [x, y] in pixels, such as [319.5, 179.5]"),
        ("focal_px =", "principal_point = [100, 600]\nfocal_px =", "camera.principal_point: [100, 600] is "
         "outside the image of 640 × 360 pixels — did you mean [600, 100]? x comes first"),
        ("focal_px =", "principal_point = [179.5, 319.5]\nfocal_px =", "camera.principal_point: "
         "[179.5, 319.5] would be the image's middle the other way round — did you mean [319.5, 179.5]? "
         "x comes first"),
        ("focal_px =", "focal =", "camera.focal: is not a key of this table — "),
        ('sees = "both"', 'sees = "moon"', "camera.sees: 'moon'"),
        ("focal_px = 184.75", "focal_px = -1", "camera.focal_px: -1"),
        ("[recording.camera]", "camera = 3\n[recording.other]", "camera: 3 is not a table"),
    ],
)  # fmt: skip
def test_wrong_keys_of_a_camera_are_told(tmp_path, capsys, old, new, line):
    folder = write(tmp_path / "cam", [recording("*.png", poses=False)], {"a.png": NIGHT})
    text = (folder / "device.toml").read_text()
    assert old in text
    (folder / "device.toml").write_text(text.replace(old, new))
    code, lines = checked(folder, capsys)
    assert code == 1
    assert [
        said
        for said in lines
        if said.startswith(f"device.toml: recording 1 (camera, images): {line}")
    ], lines


def test_no_limits_are_set_on_a_camera(tmp_path, capsys):
    folder = write(tmp_path / "cam", [recording("*.png", poses=False)], {"a.png": NIGHT})
    with (folder / "device.toml").open("a") as stream:
        stream.write("\n[spec.camera]\nattitude_error_deg = { max = 0.1 }\n")
    code, lines = checked(folder, capsys)
    assert code == 1
    assert lines[0].startswith("device.toml: spec.camera: is not a sensor with limits — ")


def test_records_are_not_changed_by_what_reads_them():
    images = copy.deepcopy(ALL)
    camera_numbers({"images": images})
    camera_table({"images": images})
    assert images == ALL
