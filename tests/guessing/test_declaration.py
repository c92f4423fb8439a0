"""`sensorbook new`, and check and report of a bare recording."""

import json

import numpy as np
import pytest

import sensorbook
from sensorbook.cli import main


@pytest.fixture
def log(tmp_path):
    """A log of a gyroscope at rest, 100 Hz, as its header says."""
    rng = np.random.default_rng(12)
    rows = np.column_stack([np.arange(2000) / 100, rng.normal(0.2, 0.05, (2000, 3))])
    np.savetxt(tmp_path / "my log.csv", rows, "%.5f", ",", comments="",
               header="time [s],gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s]")  # fmt: skip
    return tmp_path / "my log.csv"


def test_new_writes_a_commented_declaration_that_runs(log, tmp_path, capsys):
    folder = tmp_path / "imu-7"
    assert main(["new", str(folder), "--from", str(log)]) == 0
    said = capsys.readouterr().out
    assert "gyroscope (my log.csv)" in said
    assert (
        "unit             deg/s                        high       the file says so, and it reads"
        in said
    )
    text = (folder / "device.toml").read_text(encoding="utf-8")
    assert text.count("# high: ") == 4
    assert 'id = "imu-7"' in text
    assert main(["check", str(folder)]) == 0
    run = sensorbook.load(folder).gyroscope.static
    assert (run.rate, len(run), run.declaration["unit"]) == (100.0, 2000, "deg/s")
    assert (folder / "my log.csv").read_bytes() == log.read_bytes()


@pytest.mark.parametrize(
    ("names", "values", "limits"),
    [
        ("gx [deg/s],gy [deg/s],gz [deg/s]", (0.0, 0.1), ["gyroscope", "random_walk"]),
        ("ax [g],ay [g],az [g]", (0.577, 0.001), ["accelerometer", "random_walk"]),
        ("mx [uT],my [uT],mz [uT]", (28.0, 0.3), ["magnetometer", "residual_percent"]),
    ],
)
def test_new_suggests_a_limit_of_a_sensor_that_is_there(names, values, limits, tmp_path):
    rows = np.random.default_rng(3).normal(*values, (2000, 3))
    rows = np.column_stack([np.arange(2000) / 100, rows])
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ",", comments="", header=f"time [s],{names}")
    assert main(["new", str(tmp_path / "d"), "--from", str(tmp_path / "a.csv")]) == 0
    file = tmp_path / "d" / "device.toml"
    head, _, tail = file.read_text(encoding="utf-8").partition("# [spec.")
    assert tail
    # Taken out of its comment it is a valid limit.
    file.write_text(head + ("# [spec." + tail).replace("# ", ""), encoding="utf-8")
    ((sensor, spec),) = sensorbook.load(tmp_path / "d").spec.items()
    assert [sensor, *spec] == limits


def test_new_never_overwrites(log, tmp_path, capsys):
    assert main(["new", str(tmp_path), "--from", str(log)]) == 0  # a log that is there already
    before = (tmp_path / "device.toml").read_bytes()
    assert main(["new", str(tmp_path), "--from", str(log)]) == 1
    assert (
        "device.toml: is there already — edit it, or name another folder" in capsys.readouterr().err
    )
    assert (tmp_path / "device.toml").read_bytes() == before
    other = tmp_path / "other"
    other.mkdir()
    (other / "my log.csv").write_text("mine")
    assert main(["new", str(other), "--from", str(log)]) == 1
    assert (
        "my log.csv is there already — name that one, or rename this one" in capsys.readouterr().err
    )
    assert [p.name for p in other.iterdir()] == ["my log.csv"]


def test_new_leaves_nothing_where_it_cannot_tell(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("x,y\n" + "1,2\n3,4\n" * 200)
    assert main(["new", str(tmp_path / "d"), "--from", str(tmp_path / "a.csv"), "nothere"]) == 1
    assert "nothere: there is no such file — name a recording" in capsys.readouterr().err
    assert main(["new", str(tmp_path / "d"), "--from", str(tmp_path / "a.csv")]) == 1
    assert "a.csv: holds no three columns of a sensor (2 columns in all)" in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


def test_a_bare_recording_is_checked_and_says_what_it_guessed(log, capsys):
    assert main(["check", str(log)]) == 0
    said = capsys.readouterr().out
    assert "kind             static" in said


def test_a_report_of_a_bare_recording(log, tmp_path, capsys):
    assert main(["report", str(log), "--only", "psd", "--out", str(tmp_path / "out")]) == 0
    assert "gyroscope (my log.csv)" in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "my-log" / "results.json").read_text(encoding="utf-8"))
    assert [c["status"] for c in found["chapters"]] == ["complete"]
    assert {(g["key"], g["value"], g["confidence"]) for g in found["guesses"]} >= {
        ("unit", "deg/s", "high"), ("kind", "static", "medium")
    }  # fmt: skip


def test_what_is_not_known_is_refused_not_computed(tmp_path, capsys):
    rng = np.random.default_rng(13)
    np.savetxt(tmp_path / "log.csv", rng.normal(0.2, 0.05, (2000, 3)), "%.5f", ",",
               header="gx,gy,gz", comments="")  # fmt: skip
    assert (
        main(["report", str(tmp_path / "log.csv"), "--only", "psd", "--out", str(tmp_path / "out")])
        == 0
    )
    found = json.loads((tmp_path / "out" / "log" / "results.json").read_text(encoding="utf-8"))
    (chapter,) = found["chapters"]
    assert chapter["status"] == "refused"
    assert chapter["reason"] == (
        "log.csv: the rate of the gyroscope cannot be told from the file, and every result hangs on "
        "it. Write a device.toml (sensorbook new DIR --from log.csv), give the rate there, and delete "
        "it from its `guessed`."
    )


def test_new_writes_through_no_link(log, tmp_path, capsys):
    folder = tmp_path / "imu"
    folder.mkdir()
    (folder / "my log.csv").symlink_to(tmp_path / "outside")
    assert main(["new", str(folder), "--from", str(log)]) == 1
    assert "my log.csv is there already" in capsys.readouterr().err
    assert not (tmp_path / "outside").exists()


def test_a_recording_is_not_named_as_the_declaration(log, tmp_path, capsys):
    (tmp_path / "x").mkdir()
    odd = log.rename(tmp_path / "x" / "device.toml")
    assert main(["new", str(tmp_path / "imu"), "--from", str(odd)]) == 1
    assert "is what the declaration is named — rename the recording" in capsys.readouterr().err


def test_names_reach_the_terminal_without_its_commands(log, capsys):
    text = log.read_text().replace("gyro_x", "gyro\x1b[31m_x\u202e", 1)
    log.write_text(text, encoding="utf-8")
    main(["check", str(log)])
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert "\u202e" not in said.out + said.err
