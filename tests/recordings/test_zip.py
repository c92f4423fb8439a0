"""ZIP archives of phone recorders: read as their texts on the disk are, and nothing unpacked."""

import io
import re
import struct
import tomllib
import zipfile

import numpy as np
import pandas
import pytest
from guessing.moved import moved

import sensorbook
from recordings.mutants import OPERATIONS, mutant
from sensorbook import InputError
from sensorbook.cli import main
from sensorbook.guessing import guess_files
from sensorbook.recordings import check, open_table
from sensorbook.recordings.tables import table_names

EPOCH = 1_700_000_000_000_000_000  # ns
METADATA = (
    "version,device name,recording epoch time,recording time,platform,sensors,sampleRateMs\n"
    "3,Pixel 6,1700000000000,2023-11-14_22-13-20,android,Accelerometer|Gyroscope,10|10\n"
)


@pytest.fixture(scope="module")
def motion():
    return moved("positions", 30, 50.0, np.random.default_rng(41))


@pytest.fixture(scope="module")
def sensor_logger(motion):
    """Members as Sensor Logger (Tszheichoi) writes them: ns since 1970, z before y before x."""
    time = EPOCH + 2 * 10**7 * np.arange(len(motion.gyroscope))
    gravity = motion.attitude.inv().apply([0, 0, 9.80665])
    values = {"TotalAcceleration": motion.accelerometer, "Gravity": gravity,
              "Accelerometer": motion.accelerometer - gravity, "Gyroscope": motion.gyroscope,
              "GyroscopeUncalibrated": motion.gyroscope + 0.01,
              "Magnetometer": 1e6 * motion.magnetometer}  # fmt: skip
    return {
        f"{name}.csv": pandas.DataFrame(
            {
                "time": time,
                "seconds_elapsed": (time - EPOCH) / 1e9,
                "z": v[:, 2],
                "y": v[:, 1],
                "x": v[:, 0],
            }
        ).to_csv(index=False)
        for name, v in values.items()
    }


@pytest.fixture
def pack(tmp_path):
    def pack(members, name="phone.zip", method=zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(tmp_path / name, "w", method) as archive:
            for member, content in members.items():
                archive.writestr(member, content)
        return tmp_path / name

    return pack


def said_of(path, table=None):
    """The message, or the columns where it can be read."""
    try:
        opened = open_table(path, table=table)
        opened.parse(range(len(opened.names)))
    except InputError as error:
        return str(error)
    return [opened.column(k) for k in range(len(opened.names))]


def rows(count=200, seed=1):
    values = np.random.default_rng(seed).normal(size=(count, 3)).round(5)
    return "t,x,y,z\n" + "".join(
        f"{k / 100:.2f},{a},{b},{c}\n" for k, (a, b, c) in enumerate(values)
    )


def guesses(guessed, prefix=""):
    """What is declared and why, by sensor, without the names of files."""
    return {
        r.table["sensor"]: (
            {k: v for k, v in r.table.items() if k not in ("file", "table")},
            [(g.key, g.value, g.certainty, re.sub(r"in '[^']*'", "", g.reason)) for g in r.guesses],
        )
        for r in guessed.recordings
    }


# ---- read as on the disk ----


def test_an_archive_gives_what_its_files_give_on_the_disk(sensor_logger, pack, tmp_path):
    path = pack(sensor_logger | {"Metadata.csv": METADATA, "Annotation.csv": "time,text\n"})
    assert table_names(path) == tuple(sensor_logger)
    for member, content in sensor_logger.items():
        (tmp_path / member).write_text(content)
        there, here = open_table(tmp_path / member), open_table(path, table=member)
        assert here.names == there.names
        for k in range(len(there.names)):
            np.testing.assert_array_equal(here.column(k), there.column(k))
            assert here.column(k).dtype == there.column(k).dtype
    on_disk = guess_files([tmp_path / member for member in sensor_logger])
    in_archive = guess_files([path])
    assert guesses(in_archive) == guesses(on_disk)
    assert {r.table["sensor"]: r.table["table"] for r in in_archive.recordings} == {
        r.table["sensor"]: r.table["file"] for r in on_disk.recordings
    }
    assert [text.removeprefix("phone.zip, ").replace("as phone.zip, ", "as ") for text in
            in_archive.left_out] == list(on_disk.left_out)  # fmt: skip


def test_a_phones_archive_alone_is_understood(sensor_logger, pack, tmp_path, motion, capsys):
    path = pack(sensor_logger | {"Metadata.csv": METADATA})
    assert main(["new", str(tmp_path / "mine"), "--from", str(path)]) == 0
    assert "phone.zip, Gravity.csv: gravity as it is computed, not a reading: left out." in (
        capsys.readouterr().out.splitlines()
    )
    assert sorted(p.name for p in (tmp_path / "mine").iterdir()) == ["device.toml", "phone.zip"]
    declared = tomllib.loads((tmp_path / "mine" / "device.toml").read_text())["recording"]
    assert {r["sensor"]: (r["table"], r["unit"], r["time_unit"]) for r in declared} == {
        "accelerometer": ("TotalAcceleration.csv", "m/s^2", "ns"),
        "gyroscope": ("Gyroscope.csv", "rad/s", "ns"),
        "magnetometer": ("Magnetometer.csv", "uT", "ns"),
    }
    assert check(tmp_path / "mine")[0] == []
    device = sensorbook.load(tmp_path / "mine")
    np.testing.assert_allclose(device.gyroscope.positions.values, motion.gyroscope, atol=1e-15)
    assert device.gyroscope.positions.file == "phone.zip"


def test_phyphox_with_its_folder_of_notes(motion, pack):
    time = np.arange(len(motion.gyroscope)) / 50
    frames = {}
    for name, unit, values in (("Accelerometer", "m/s^2", motion.accelerometer),
                               ("Gyroscope", "rad/s", motion.gyroscope)):  # fmt: skip
        head = ["Time (s)", *(f"{a} ({unit})" for a in "XYZ")]
        frame = pandas.DataFrame(np.column_stack([time, values]), columns=head)
        frames[f"{name}.csv"] = frame.to_csv(index=False)
    path = pack(frames | {
        "meta/device.csv": '"property","value"\n"version","1.1.3"\n"build","1010308"\n"deviceModel","FP4"\n',
        "meta/time.csv": '"event","experiment time","system time","system time text"\n'
        '"START",0.000E0,1.700E9,"2023-11-14 22:13:20.000 UTC+00:00"\n'
        '"PAUSE",6.000E1,1.700E9,"2023-11-14 22:14:20.000 UTC+00:00"\n',
    })  # fmt: skip
    tables = {r.table["sensor"]: r.table for r in guess_files([path]).recordings}
    assert {
        s: (t["table"], t["unit"], t["columns"]["time"], t["kind"]) for s, t in tables.items()
    } == {
        "accelerometer": ("Accelerometer.csv", "m/s^2", "Time (s)", "positions"),
        "gyroscope": ("Gyroscope.csv", "rad/s", "Time (s)", "positions"),
    }


def test_physics_toolbox(motion, pack):
    time = np.arange(len(motion.gyroscope)) / 50
    members = {}
    for name, letters, values in (("G-Force Meter", "gF", motion.accelerometer / 9.80665),
                                  ("Gyroscope", "w", motion.gyroscope),
                                  ("Magnetometer", "B", 1e6 * motion.magnetometer)):  # fmt: skip
        total = np.linalg.norm(values, axis=1)
        head = [
            "time",
            *(f"{letters}{a}" for a in "xyz"),
            "TgF" if letters == "gF" else f"{letters}T",
        ]
        frame = pandas.DataFrame(np.column_stack([time, values, total]), columns=head)
        members[f"{name} 2024-05-01 10.00.00.csv"] = frame.to_csv(index=False)
    recordings = guess_files([pack(members)]).recordings
    declared = {
        r.table["sensor"]: (r.table["unit"], list(r.table["columns"].values())) for r in recordings
    }
    assert declared == {
        "accelerometer": ("g", ["time", "gFx", "gFy", "gFz"]),
        "gyroscope": ("rad/s", ["time", "wx", "wy", "wz"]),
        "magnetometer": ("uT", ["time", "Bx", "By", "Bz"]),
    }


@pytest.mark.parametrize(("extra", "recorder"), [
    ({"gFx": 0.01, "gFy": -0.02, "gFz": 1.0}, "Physics Toolbox"),
    ({"seconds_elapsed": None}, "Sensor Logger"),
])  # fmt: skip
def test_a_recorder_whose_unit_is_documented(tmp_path, extra, recorder):
    """A rest in rad/s that might be deg/s, but for the layout."""
    rng = np.random.default_rng(12)
    time = np.arange(6000) / 100
    frame = {"time": time} | {
        n: time if m is None else rng.normal(m, 0.002, 6000) for n, m in extra.items()
    }
    frame |= {f"w{a}": rng.normal(0.01, 2e-3, 6000) for a in "xyz"}
    pandas.DataFrame(frame).to_csv(tmp_path / "log.csv", index=False)
    (found,) = (r for r in guess_files([tmp_path / "log.csv"]).recordings
                if r.table["sensor"] == "gyroscope")  # fmt: skip
    (unit,) = (g for g in found.guesses if g.key == "unit")
    assert (unit.value, unit.certainty) == ("rad/s", "medium")
    assert unit.reason.startswith(f"{recorder} writes rad/s, and it reads 0.01")
    assert "unit" not in found.table.get("guessed", {})


def test_the_only_file_tells_the_sensor_by_its_name(sensor_logger, pack):
    path = pack(
        {"2023-11-14_accelerometer_test/Gyroscope.csv": sensor_logger["Gyroscope.csv"]}, "a.zip"
    )
    (recording,) = guess_files([path]).recordings
    assert recording.table["sensor"] == "gyroscope"
    assert "table" not in recording.table
    with pytest.raises(InputError, match="holds gravity as it is computed"):
        guess_files([pack({"Gravity.csv": sensor_logger["Gravity.csv"]}, "b.zip")])


def test_what_is_no_table_is_passed_over(pack):
    path = pack({
        "rest/a.csv": rows(), "b.txt": rows(seed=2).encode("utf-16"), "notes.txt": "turned by hand\n",
        "photo.jpg": b"\xff\xd8\xff\xe0" + bytes(90), "__MACOSX/rest/._a.csv": rows(9), "empty.csv": "",
        "rest/": "", "more.zip": b"PK\x03\x04" + bytes(50), "log.csv.gz": b"\x1f\x8b\x08" + bytes(50),
    })  # fmt: skip
    assert table_names(path) == ("rest/a.csv", "b.txt")
    assert len(said_of(path, "b.txt")[0]) == 200
    listed = "files: 'rest/a.csv', 'b.txt'"
    assert said_of(path) == (
        f'phone.zip: holds 2 files of samples — say which with table = "…"; {listed}'
    )
    assert said_of(path, "notes.txt").startswith("phone.zip, notes.txt: holds no rows of numbers")
    assert said_of(path, "photo.jpg").startswith("phone.zip, photo.jpg: is a binary file, not text")
    for absent in ("more.zip", "log.csv.gz", "../a.csv"):
        assert said_of(path, absent) == (
            f"phone.zip: table {absent!r}: there is no such file — {listed}"
        )


def test_stored_members_and_npz_are_read_as_before(pack, tmp_path):
    path = pack({"a.csv": rows()}, method=zipfile.ZIP_STORED)
    assert len(said_of(path)[0]) == 200
    np.savez(tmp_path / "log.npz", x=np.arange(50.0), t=np.arange(50))
    assert table_names(tmp_path / "log.npz") == ()
    assert open_table(tmp_path / "log.npz").names == ("x", "t")


def test_a_problem_in_a_member_names_it(pack):
    broken = rows().replace("0.50,", "0.50,1,", 1)
    assert said_of(pack({"a.csv": rows(), "b.csv": broken}), "b.csv") == (
        "phone.zip, b.csv: line 52: holds 5 cells, the table has 4 columns — mend or remove the line"
    )
    assert said_of(pack({"a.csv": rows(), "b.csv": rows()[:-9]}), "b.csv").startswith(
        "phone.zip, b.csv: line 201: is cut off: its last line breaks off"
    )


# ---- refused ----


def encrypted(path):
    """The archive with the bit that marks its members as encrypted set (APPNOTE.TXT 6.3.10, 4.4.4)."""
    content = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        for match in re.finditer(re.escape(mark), bytes(content)):
            content[match.start() + at] |= 1
    path.write_bytes(content)
    return path


def test_an_encrypted_archive(pack):
    assert said_of(encrypted(pack({"a.csv": rows()}))) == (
        "phone.zip: holds a file that is encrypted, 'a.csv' — unpack it with its password, and name the "
        "recordings"
    )


@pytest.mark.parametrize(
    "name", ["../../etc/a.csv", "/a.csv", "a/../../b.csv", "C:\\a.csv", "..\\a.csv"]
)
def test_a_member_that_would_be_unpacked_elsewhere(pack, tmp_path, name):
    before = sorted(tmp_path.rglob("*"))
    path = pack({"b.csv": rows(), name: rows()})
    assert said_of(path, "b.csv") == (
        f"phone.zip: holds a file whose name leads out of it, {name!r} — do not unpack it: make the "
        "archive anew"
    )
    assert sorted(tmp_path.rglob("*")) == sorted([*before, path])


def test_archives_in_an_archive(pack):
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("a.csv", rows())
    assert said_of(pack({"notes.txt": "two of them\n", "one.zip": inner.getvalue()})) == (
        "phone.zip: holds archives in an archive ('one.zip') — unpack it, and name the recordings"
    )


def test_other_archives(pack):
    with zipfile.ZipFile(io.BytesIO(), "w"):
        pass
    assert (
        said_of(pack({})) == "phone.zip: is an empty archive — name a file that holds the recording"
    )
    excel = {"[Content_Types].xml": "<Types/>", "xl/workbook.xml": "<workbook/>"}
    assert said_of(pack(excel, "log.xlsx")) == (
        "log.xlsx: is an Excel file: format not supported yet — save it as .csv"
    )
    for others in ({"readme.md": "# Nothing\n"}, {"phone.db": b"SQLite format 3\0" + bytes(84)}):
        assert said_of(pack(others)) == (
            "phone.zip: holds no text with rows of numbers — unpack it, and name the recordings"
        )
    assert said_of(pack({"a.csv": rows()}, method=zipfile.ZIP_LZMA)) == (
        "phone.zip: holds a file packed by another method than deflate, 'a.csv' — unpack it, and name the "
        "recordings"
    )
    assert said_of(pack({f"{k}.csv": "" for k in range(1001)})) == (
        "phone.zip: holds 1001 files — unpack it, and name the recordings"
    )
    path = pack({"a.csv": rows()})
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("a.csv", rows(seed=2))
    assert said_of(path) == "phone.zip: holds two files named 'a.csv' — make the archive anew"


def test_a_bomb_stops_at_the_limit(pack, monkeypatch):
    path = pack({"a.csv": "t,x\n" + "0.000000,0.000000\n" * 200_000})
    monkeypatch.setattr("sensorbook.recordings.tables._BOMB", 1 << 20)
    assert said_of(path) == (
        "phone.zip, a.csv: inflates more than 150 times, as no recording does — look at what it holds, "
        "and save it alone"
    )
    monkeypatch.setattr("sensorbook.recordings.tables.MAX_BYTES", 1 << 20)
    assert said_of(path).startswith("phone.zip, a.csv: holds more than")


def test_a_declared_size_is_not_trusted(pack):
    path = pack({"a.csv": rows(5000)})  # beyond its first 64 KiB, where it is read as a whole
    content = bytearray(path.read_bytes())
    size = content.rindex(b"PK\x01\x02") + 24  # of what it inflates to
    struct.pack_into("<I", content, size, 100_000)
    path.write_bytes(content)
    assert said_of(path) == "phone.zip, a.csv: is damaged — copy the archive again"
    struct.pack_into("<I", content, size, 0xFFFFFFF0)
    path.write_bytes(content)
    assert len(said_of(path)[0]) == 5000


def test_a_member_whose_check_sum_differs(pack):
    path = pack({"a.csv": rows(20_000)}, method=zipfile.ZIP_STORED)
    content = path.read_bytes()
    at = content.rindex(b"150.00,")
    path.write_bytes(content[:at] + b"151.00," + content[at + 7 :])
    assert said_of(path) == "phone.zip, a.csv: is damaged — copy the archive again"


def test_damage_is_told(pack):
    """90 damaged archives: refused, or every value as it was written."""
    members = {"Gyroscope.csv": rows(2500), "Accelerometer.csv": rows(300, seed=2)}
    path = pack(members)
    whole = path.read_bytes()
    written = {name: said_of(path, name) for name in members}
    refused = 0
    for number in range(90):
        rng = np.random.default_rng([20240502, number])
        path.write_bytes(mutant(whole, OPERATIONS[number % len(OPERATIONS)], rng).content)
        for name in members:
            got = said_of(path, name)
            if isinstance(got, str):
                assert "\n" not in got
                refused += 1
            else:
                for one, other in zip(got, written[name], strict=True):
                    np.testing.assert_array_equal(one, other)
    assert 90 < refused < 180
