"""What phone recorders write: a table a sensor in SQLite, CSV merged wrongly, corrupt stretches."""

import re
import sqlite3
import tomllib
from contextlib import closing

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sensorbook
from sensorbook import Recording
from sensorbook.cli import main
from sensorbook.guessing import guess_files
from sensorbook.recordings import check
from sensorbook.recordings.corruption import frozen
from sensorbook.recordings.findings import examine
from sensorbook.recordings.merging import merged
from sensorbook.simulate import simulate
from sensorbook.simulate.positions import FACES, hand_moved
from sensorbook.units import SENSOR_UNITS

REAL = ("adis16405-1", "adis16405-2", "adis16405-3", "broad-slow", "cats-tag", "ck-mag-acc",
        "sunsided-tilt-sphere", "xsens-mti")  # fmt: skip


@pytest.fixture(scope="module")
def phone(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("recorder") / "phone", "phone", seed=3)


@pytest.fixture(scope="module")
def moved():
    """Time (N,) s and accelerometer (N, 3) m/s² of six rests, at 100 Hz."""
    made = hand_moved(np.random.default_rng([12, 1]), FACES, initial=10.0)
    return made["t"], made["accelerometer"]


def findings(time, values, sensor="accelerometer", kind="positions"):
    rate = 1 / float(np.median(np.diff(time)))
    run = Recording(
        sensor, kind, "log.csv", time, values, rate=rate, unit=SENSOR_UNITS[sensor],
        declaration={"columns": {"time": "t"}},
    )  # fmt: skip
    return {f.kind: f for f in examine(run, list(np.transpose(values)), ["x", "y", "z"])}


# ---- the recorder's database ----


def test_each_sensor_has_its_table_and_its_rate(phone):
    with closing(sqlite3.connect(phone / "positions.db")) as database:
        tables = {
            name: [row[1] for row in database.execute(f"PRAGMA table_info({name})")]
            for (name,) in database.execute("SELECT name FROM sqlite_master ORDER BY name")
        }
        counts = {n: database.execute(f"SELECT count(*) FROM {n}").fetchone()[0] for n in tables}
        stamps = np.array(database.execute("SELECT timestamp FROM accelerometer").fetchall())[:, 0]
    axes = ["timestamp", "x", "y", "z"]
    assert tables == {
        "accelerometer": axes,
        "gyroscope": axes,
        "gnss": ["timestamp", "latitude", "longitude", "height", "accuracy"],
    }
    assert counts["accelerometer"] == counts["gyroscope"]
    assert counts["gnss"] == counts["accelerometer"] // 100
    steps = np.diff(stamps)
    assert set(steps) > {9, 10, 11}  # ms, jittering
    assert (steps > 0).all()


def test_the_declared_tables_are_read(phone):
    device = sensorbook.load(phone)
    (positions,) = (
        r for r in device.runs("accelerometer", "positions") if r.file == "positions.db"
    )
    with closing(sqlite3.connect(phone / "positions.db")) as database:
        rows = np.array(database.execute("SELECT x, y, z FROM accelerometer").fetchall())
        began = database.execute("SELECT min(timestamp) FROM accelerometer").fetchone()[0]
    np.testing.assert_array_equal(positions.values, rows)
    assert positions.start == pytest.approx(began / 1000, abs=1e-6)
    assert positions.rate == pytest.approx(100, rel=1e-4)
    assert positions.findings == ()
    assert positions.declaration["table"] == "accelerometer"


@pytest.mark.parametrize("file", ["positions", "six_position"])
def test_the_database_alone_is_understood(phone, tmp_path, capsys, file):
    assert main(["new", str(tmp_path / "mine"), "--from", str(phone / f"{file}.db")]) == 0
    said = capsys.readouterr().out
    assert (
        f"{file}.db, gnss: holds a satellite receiver's places, which may stand under [site], and no "
        "sensor: left out."
    ) in said
    declared = tomllib.loads((tmp_path / "mine" / "device.toml").read_text())["recording"]
    found = {r["sensor"]: r for r in declared}
    assert len(declared) == 2
    for sensor, unit in (("accelerometer", "m/s^2"), ("gyroscope", "rad/s")):
        table = found[sensor]
        assert (table["table"], table["unit"], table["time_unit"]) == (sensor, unit, "ms")
        assert table["columns"] == {"time": "timestamp", "x": "x", "y": "y", "z": "z"}
        assert "guessed" not in table
    assert found["accelerometer"]["kind"] == file
    assert found["gyroscope"]["kind"] == "positions"
    assert check(tmp_path / "mine") == ([], [])
    device = sensorbook.load(tmp_path / "mine")
    assert device.gyroscope.positions.rate == pytest.approx(100, rel=1e-4)


def test_a_gyroscope_alone_remains_a_doubtful_guess(phone, tmp_path):
    with closing(sqlite3.connect(phone / "positions.db")) as database:
        frame = pandas.read_sql("SELECT * FROM gyroscope", database)
    with closing(sqlite3.connect(tmp_path / "gyroscope.db")) as database:
        frame.to_sql("gyroscope", database, index=False)
    (recording,) = guess_files([tmp_path / "gyroscope.db"]).recordings
    assert recording.table["guessed"]["kind"] == "low"


def test_a_table_that_is_not_there(phone, tmp_path):
    text = (phone / "device.toml").read_text()
    for file in ("positions.db", "six_position.db", "check.db"):
        (tmp_path / file).write_bytes((phone / file).read_bytes())
    (tmp_path / "device.toml").write_text(text.replace('"accelerometer"\nunit', '"ACC"\nunit'))
    problems, _ = check(tmp_path)
    assert {str(p) for p in problems} == {
        f"{file}: table 'ACC': there is no such table — tables: 'accelerometer', 'gnss', 'gyroscope'"
        for file in ("positions.db", "six_position.db", "check.db")
    }
    (tmp_path / "device.toml").write_text(re.sub(r'table = "accelerometer"\n', "", text))
    problems, _ = check(tmp_path)
    assert (
        'check.db: holds 3 tables of samples — say which with table = "…"; tables: '
        "'accelerometer', 'gnss', 'gyroscope'"
    ) in {str(p) for p in problems}


def test_a_database_without_any_table(phone, tmp_path):
    text = (phone / "device.toml").read_text().split("[[recording]]")
    (tmp_path / "device.toml").write_text(text[0] + "[[recording]]" + text[1])
    with closing(sqlite3.connect(tmp_path / "six_position.db")) as database:
        database.execute("CREATE TABLE accelerometer (timestamp, x, y, z)")
        database.commit()
    (problem,), _ = check(tmp_path)
    assert str(problem) == (
        "six_position.db: table 'accelerometer': there is no such table — it holds no table of samples"
    )


# ---- rates merged wrongly ----


def held(time, values, rate, rng):
    """Readings at the stamps of another sensor of this rate, each the last one there was."""
    stamps = np.arange(0, time[-1], 1 / rate)
    stamps = np.sort(stamps + rng.normal(scale=4e-4, size=len(stamps)))
    return stamps, values[np.clip(np.searchsorted(time, stamps) - 1, 0, None)]


@pytest.mark.parametrize(
    ("own", "rows"), [(1, 100), (10, 100), (50, 100), (100, 150), (100, 200), (100, 400)]
)
# A fine sensor, and one so coarse that some readings repeat by themselves; m/s².
@pytest.mark.parametrize("step", [0.0, 0.02])
def test_a_slow_table_repeated_in_a_faster_one(moved, own, rows, step):
    time, values = (a[:: 100 // own] for a in moved)
    values = np.round(values / step) * step if step else values
    stamps, merged_values = held(time, values, rows, np.random.default_rng([12, 2]))
    finding = findings(stamps, merged_values)["merged"]
    rate = float(
        re.search(
            r"it is sampled at about ([\d.]+) Hz, and repeated in faster rows$", finding.message
        )[1]
    )
    assert rate == pytest.approx(own, rel=0.03)  # readings equal by chance hide some
    in_rows = float(
        re.match(r"each reading stands in ([\d.]+) rows, regularly", finding.message)[1]
    )
    assert in_rows == pytest.approx(rows / own, rel=0.1)


@pytest.mark.parametrize("own", [1, 25, 50])
def test_a_slow_table_among_empty_cells(moved, own):
    time, values = moved
    sparse = np.full_like(values, np.nan)
    sparse[:: 100 // own] = values[:: 100 // own]
    found = findings(time, sparse)
    assert found["merged"].message == (
        f"one row in {100 // own} holds a reading, regularly: it is sampled at about {own} Hz, in a "
        "faster table"
    )
    assert "nan" in found


def test_tables_of_two_rates_joined_row_by_row(moved):
    time, values = moved
    half = values.copy()
    half[len(half) // 2 :] = np.nan
    assert findings(time, half)["merged"].message == (
        f"its readings end at row {len(half) // 2} of {len(half)}: joined row by row with a longer "
        "table, whose stamps may not be its own"
    )


def test_a_merged_csv_is_told_with_its_remedy(moved, tmp_path, capsys):
    time, values = moved
    slow = np.repeat(values[::2], 2, axis=0)[: len(values)]
    frame = pandas.DataFrame(slow, columns=["ax", "ay", "az"])
    frame.insert(0, "time_s", time)
    frame.to_csv(tmp_path / "log.csv", index=False)
    assert main(["check", str(tmp_path / "log.csv")]) == 0
    assert (
        "warning: log.csv: accelerometer: each reading stands in 2 rows, regularly: it is sampled at "
        "about 50 Hz, and repeated in faster rows — save each sensor at its own rate: its own table, or "
        "the recorder's database, not its CSV"
    ) in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("step", [0.0, 0.005, 0.02, 0.05, 0.1, 0.15, 0.3, 1.0])
def test_quiet_coarse_sensors_raise_no_alarm(moved, step):
    # Noise of 0.015 m/s²: at 0.1 m/s² and more whole rests read one value on all axes.
    time, values = moved
    coarse = np.round(values / step) * step if step else values
    assert not {"merged", "corrupt"} & findings(time, coarse).keys()


@pytest.mark.parametrize("equal", [0.1, 0.3, 0.5, 0.8, 0.95])
def test_readings_equal_by_chance_raise_no_alarm(equal):
    for seed in range(20):
        rng = np.random.default_rng([12, 3, seed])
        rows = np.cumsum(rng.uniform(size=5000) > equal)
        values = rng.normal(size=(5001, 3))[rows]
        assert merged(values, np.arange(5000) / 100) == ""
        lost = np.where(rng.uniform(size=(5000, 1)) < equal, np.nan, rng.normal(size=(5000, 3)))
        if np.isfinite(lost[-100:]).any():  # otherwise it may have ended
            assert merged(lost, np.arange(5000) / 100) == ""


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_are_neither_merged_nor_corrupt(real_data, name):
    _, found = check(real_data / name)
    assert not {f.kind for f in found} & {"merged", "corrupt"}
    device = sensorbook.load(real_data / name)
    for sensor in set(device.sensors) & set(SENSOR_UNITS):
        for kind in device.kinds(sensor):
            for run in device.runs(sensor, kind):
                # Six times as coarse as its noise, too.
                step = 6 * np.nanstd(np.diff(run.values, axis=0), axis=0)
                coarse = np.round(run.values / step) * step
                assert merged(coarse, run.time) == ""
                assert frozen(coarse, run.rate or 100.0) == []


def test_a_real_log_without_a_declaration_is_neither(real_data):
    _, found = check(real_data / "imucal-ferraris" / "example_ferraris_session.csv")
    assert {f.kind for f in found} <= {"guessed"}


@settings(max_examples=60, deadline=None)
@given(
    times=st.integers(2, 30),
    readings=st.integers(40, 300),
    seed=st.integers(0, 2**32 - 1),
    unit=st.sampled_from([1.0, 9.80665, 1e-6]),
)
def test_whatever_is_repeated_is_told_in_any_unit(times, readings, seed, unit):
    own = np.random.default_rng(seed).normal(size=(readings, 3)) * unit
    time = np.arange(times * readings) / 100
    assert merged(own, time[::times]) == ""
    expected = f"it is sampled at about {100 / times:.3g} Hz"
    assert expected in merged(np.repeat(own, times, axis=0), time)
    sparse = np.full((times * readings, 3), np.nan)
    sparse[::times] = own
    # What stands empty after the last reading is less than a fortieth of the rows.
    assert expected in merged(sparse, time)


# ---- corrupt stretches ----


@pytest.mark.parametrize("seconds", [0.7, 5.0, 30.0])
@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_a_frozen_stretch(sensor, seconds):
    made = hand_moved(np.random.default_rng([12, 4]), initial=10.0)
    time, values = made["t"], made[sensor].copy()
    first, last = 2000, 2000 + round(100 * seconds)
    values[first : last + 1] = values[first]
    values[[first - 1, last + 1]] += 1.0  # whatever their chance
    finding = findings(time, values, sensor)["corrupt"]
    assert finding.message == (
        f"repeats one and the same reading at 1 place from {time[first]:.6g} s to {time[last]:.6g} s: "
        "frozen"
    )


def test_several_frozen_stretches_of_a_rest():
    rng = np.random.default_rng([12, 5])
    values = np.round(rng.normal((0, 0, 9.8), 0.02, (60_000, 3)) / 0.01) * 0.01
    values[1000:1200], values[5000:5090] = values[1000], values[5000]
    finding = findings(np.arange(60_000) / 100, values, kind="static")["corrupt"]
    assert finding.message == (
        "repeats one and the same reading at 2 places, the longest from 10 s to 11.99 s: frozen"
    )


def test_less_than_half_a_second_is_no_stretch(moved):
    time, values = moved
    values = values.copy()
    values[1500:1549] = values[1500]
    assert "corrupt" not in findings(time, values)


@pytest.mark.parametrize(("sensor", "burst", "limit"), [
    ("accelerometer", 4000.0, "1000 m/s^2"), ("gyroscope", -3e4, "105 rad/s"),
    ("magnetometer", 2.0, "0.1 T"),
])  # fmt: skip
def test_a_burst_of_readings_that_cannot_be(sensor, burst, limit):
    rng = np.random.default_rng([12, 6])
    size = {"accelerometer": 9.8, "gyroscope": 1.0, "magnetometer": 5e-5}[sensor]
    values = size * rng.normal(size=(5000, 3))
    time = np.arange(5000) / 100
    assert "corrupt" not in findings(time, values, sensor, "rotation")
    values[3000:3040, 1] = burst
    assert findings(time, values, sensor, "rotation")["corrupt"].message == (
        f"40 samples beyond {limit}, which it cannot have met, from 30 s to 30.39 s"
    )
    # Where most are so large, it is the unit that is wrong.
    assert "corrupt" not in findings(time, 3000 * values, sensor, "rotation")


def test_a_locked_screen_leaves_a_gap_and_stamps_that_jump(moved, tmp_path, capsys):
    time, values = moved
    time = np.where(time > 20, time + 7.5, time)
    time[3000:] -= 2.0
    frame = pandas.DataFrame(values, columns=["ax", "ay", "az"])
    frame.insert(0, "time_s", time.round(3))
    frame.to_csv(tmp_path / "log.csv", index=False)
    main(["check", str(tmp_path / "log.csv")])
    said = capsys.readouterr().out
    assert (
        "the longest gap is 7.51 s at 20 s — record without losses: fewer channels, a faster card"
        in said
    )
    assert "a phone with its screen on" in said
    assert re.search(
        r"the time goes back at 1 place, first at 37\.49 s by 1\.99 s — stamp each", said
    )


def test_corrupt_comes_with_a_remedy(moved, tmp_path, capsys):
    time, values = moved
    values = values.copy()
    values[1500:1700] = values[1500]
    frame = pandas.DataFrame(values, columns=["ax", "ay", "az"])
    frame.insert(0, "time_s", time)
    frame.to_csv(tmp_path / "log.csv", index=False)
    main(["check", str(tmp_path / "log.csv")])
    assert (
        "warning: log.csv: accelerometer: repeats one and the same reading at 1 place from 15 s to "
        "16.99 s: frozen — cut it out, or record again: a phone with its screen on and the recorder in "
        "front"
    ) in capsys.readouterr().out.splitlines()
