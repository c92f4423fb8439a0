"""Guesses on simulated recordings in every common unit: right, or not sure."""

import gzip
import re

import numpy as np
import pandas
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import sensorbook
from sensorbook import InputError
from sensorbook.guessing import guess_files
from sensorbook.units import SENSOR_UNITS, factor

from .moved import FIELD, GRAVITY, moved

UNITS = {
    "accelerometer": ["m/s^2", "g", "mg"],
    "gyroscope": ["deg/s", "rad/s"],
    "magnetometer": ["uT", "gauss", "mG", "nT"],
}
KINDS = {
    "static": dict.fromkeys(SENSOR_UNITS, "static"),
    "positions": {
        "accelerometer": "positions",
        "gyroscope": "positions",
        "magnetometer": "rotation",
    },
    "trajectory": dict.fromkeys(SENSOR_UNITS, "trajectory"),
}
LETTERS = {"accelerometer": "a", "gyroscope": "g", "magnetometer": "m"}


def written(path, kind, sensors, units, seed, named=True, stamps=True, rate=100.0):
    """A log of these sensors, six digits, columns by letter or v1, v2 …"""
    recorded = moved(kind, 90, rate, np.random.default_rng(seed))
    columns = {"t": np.arange(len(recorded.gyroscope)) / rate} if stamps else {}
    for sensor in sensors:
        values = getattr(recorded, sensor) / factor(units[sensor], SENSOR_UNITS[sensor])
        for axis, column in zip("xyz", values.T, strict=True):
            columns[f"{LETTERS[sensor]}{axis}"] = column
    frame = pandas.DataFrame(columns)
    if not named:
        frame.columns = [f"v{k + 1}" for k in range(frame.shape[1])]
    frame.to_csv(path, index=False, float_format="%.7g")
    return frame


def true_columns(sensors, sensor, named, stamps):
    first = int(stamps) + 3 * list(sensors).index(sensor)
    return (
        [f"{LETTERS[sensor]}{a}" for a in "xyz"]
        if named
        else [f"v{first + k + 1}" for k in range(3)]
    )


def wrong(guessed, kind, sensors, units, named, stamps):
    """Guesses of these certainties that are not so, as (certainty, sensor, key, value)."""
    found = []
    for recording in guessed.recordings:
        table = recording.table
        columns = [table["columns"][a] for a in "xyz"]
        sensor = next(
            (s for s in sensors if true_columns(sensors, s, named, stamps) == columns), None
        )
        certainty = {g.key: g.certainty for g in recording.guesses}
        if sensor != table["sensor"]:
            found.append((certainty["sensor"], sensor, "sensor", table["sensor"]))
            continue
        if table["kind"] != KINDS[kind][sensor] and not (
            kind == "trajectory"
            and table["kind"] == "rotation"
            and (sensor == "magnetometer" or "gyroscope" not in sensors)
        ):
            found.append((certainty["kind"], sensor, "kind", table["kind"]))
        si = SENSOR_UNITS[sensor]
        if certainty["unit"] != "not known" and factor(table["unit"], si) != factor(
            units[sensor], si
        ):
            found.append((certainty["unit"], sensor, "unit", table["unit"]))
    return found


SETS = [("accelerometer", "gyroscope", "magnetometer"), ("gyroscope", "accelerometer"),
        ("accelerometer", "magnetometer"), ("gyroscope",), ("accelerometer",)]  # fmt: skip


@given(
    kind=st.sampled_from(list(KINDS)),
    sensors=st.sampled_from(SETS),
    units=st.fixed_dictionaries({s: st.sampled_from(u) for s, u in UNITS.items()}),
    named=st.booleans(),
    stamps=st.booleans(),
    seed=st.integers(0, 999),
)
@settings(max_examples=40, deadline=None, phases=[Phase.reuse, Phase.generate])
def test_nothing_wrong_is_stated_with_high_certainty(
    tmp_path_factory, kind, sensors, units, named, stamps, seed
):
    path = tmp_path_factory.mktemp("g") / "log.csv"
    written(path, kind, sensors, units, seed, named, stamps)
    if named:
        guessed = guess_files([path])
    else:
        try:
            guessed = guess_files([path])
        except InputError:
            return  # that it cannot tell is an answer, too
    assert [w for w in wrong(guessed, kind, sensors, units, named, stamps) if w[0] == "high"] == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("named", [True, False])
def test_a_whole_imu_is_known_from_its_motion(tmp_path, kind, named):
    sensors = SETS[0]
    for acc, gyro, mag in (("m/s^2", "deg/s", "uT"), ("g", "rad/s", "gauss"), ("mg", "rad/s", "mG"),
                           ("g", "deg/s", "nT")):  # fmt: skip
        units = {"accelerometer": acc, "gyroscope": gyro, "magnetometer": mag}
        written(tmp_path / "log.csv", kind, sensors, units, 7, named)
        guessed = guess_files([tmp_path / "log.csv"])
        found = wrong(guessed, kind, sensors, units, named, True)
        if kind != "static" or named:
            assert len(guessed.recordings) == 3
        if kind != "static":
            assert found == []  # what moves shows its scale
        assert [w for w in found if w[0] in ("high", "medium")] == []


@pytest.mark.parametrize("unit", ["uT", "gauss", "nT"])
def test_a_compass_turned_by_hand_beside_an_imu_is_calibrated(tmp_path, unit):
    units = {"accelerometer": "g", "gyroscope": "deg/s", "magnetometer": unit}
    written(tmp_path / "log.csv", "trajectory", SETS[0], units, 11)
    recordings = guess_files([tmp_path / "log.csv"]).recordings
    kinds = {r.table["sensor"]: r.table["kind"] for r in recordings}
    assert kinds == dict.fromkeys(SETS[0], "trajectory") | {"magnetometer": "rotation"}
    (told,) = (g for r in recordings for g in r.guesses if g.value == "rotation")
    assert re.fullmatch(
        r"it turns, and sees its field in \d+ % of all directions, which calibrates it", told.reason
    )
    assert sensorbook.load(tmp_path / "log.csv").magnetometer.rotation.rate == pytest.approx(100)


def test_a_compass_that_is_driven_about_is_on_a_trajectory(tmp_path):
    """Turned through every heading, tilted by some 10°: its field lies on a band of the sphere."""
    rng = np.random.default_rng(12)
    time = np.arange(0, 90, 0.01)
    knots = np.arange(0, 93, 1.5)
    angles = CubicSpline(knots, rng.normal(0, 1, (len(knots), 3)) * [2, 0.17, 0.17])(time)
    attitude = Rotation.from_euler("ZYX", angles)
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * 100
    seen = [
        attitude.inv().apply(GRAVITY),
        np.vstack([turn, turn[-1:]]),
        attitude.inv().apply(FIELD) * 1e6,
    ]
    noisy = [
        v + rng.normal(scale=s, size=v.shape) for v, s in zip(seen, (0.02, 1e-3, 0.1), strict=True)
    ]
    names = ["t", *(f"{letter}{axis}" for letter in "agm" for axis in "xyz")]
    pandas.DataFrame(np.column_stack([time, *noisy]), columns=names).to_csv(
        tmp_path / "log.csv", index=False, float_format="%.7g"
    )
    kinds = {
        r.table["sensor"]: r.table["kind"] for r in guess_files([tmp_path / "log.csv"]).recordings
    }
    assert kinds == dict.fromkeys(SETS[0], "trajectory")


# ---- real recordings, under their names, renamed and without a header ----

TRUTH = {  # sensors: unit, as their authors' device folders declare them
    "cats-tag/cycle1.csv.gz": ("thermal", {"accelerometer": "m/s^2", "gyroscope": "mrad/s",
                                           "magnetometer": "uT"}, 1.0),
    "cats-tag/cycle2.csv.gz": ("thermal", {"accelerometer": "m/s^2", "gyroscope": "mrad/s",
                                           "magnetometer": "uT"}, 1.0),
    "broad-slow/trajectory.csv": ("trajectory", {"gyroscope": "rad/s", "accelerometer": "m/s^2",
                                                 "magnetometer": "uT"}, 1 / 0.035),
    "imucal-ferraris/example_ferraris_session.csv": (
        "positions", {"gyroscope": "deg/s", "accelerometer": "m/s^2"}, 102.4),
    "ck-mag-acc/log.csv": ("rotation", {"accelerometer": "g", "magnetometer": "gauss"}, None),
}  # fmt: skip


def bare(source, path, form):
    """A plain copy of a recording: as it is, with columns v1 … vn, or without a header."""
    content = source.read_bytes()
    text = (gzip.decompress(content) if source.suffix == ".gz" else content).decode()
    header, body = text.split("\n", 1)
    header += "\n"
    names = ",".join(f"v{k + 1}" for k in range(len(header.split(",")))) + "\n"
    path.write_text({"as it is": header, "renamed": names, "bare": ""}[form] + body)
    return path


@pytest.mark.parametrize("form", ["as it is", "renamed", "bare"])
@pytest.mark.parametrize("file", TRUTH)
def test_real_recordings(real_data, tmp_path, file, form):
    kind, units, rate = TRUTH[file]
    guessed = guess_files([bare(real_data / file, tmp_path / "log.csv", form)])
    found = {r.table["sensor"]: r for r in guessed.recordings if r.table["sensor"] != "reference"}
    assert set(found) == set(units)
    for sensor, unit in units.items():
        table, sure = found[sensor].table, {g.key: g.certainty for g in found[sensor].guesses}
        assert table["kind"] == kind
        assert table["unit"] == unit
        if form == "as it is":
            assert sure["sensor"] == "high"
        if "rate" in table:
            # A rate by kinematics is good to its stated per cent; one that is not known is said.
            known = sure["rate"] != "not known"
            assert (
                table["rate"] == pytest.approx(rate, rel=0.015) if known else table["rate"] == 1.0
            )
        elif rate is not None:
            assert table["time_unit"] == "s"
            assert "time" in table["columns"]


@pytest.mark.parametrize("form", ["as it is", "renamed", "bare"])
def test_the_reference_attitude_is_read_by_what_it_turns(real_data, tmp_path, form):
    source = real_data / "broad-slow" / "trajectory.csv"
    guessed = guess_files([bare(source, tmp_path / "log.csv", form)])
    (reference,) = (r for r in guessed.recordings if r.table["sensor"] == "reference")
    assert reference.table["quaternion"] == "body_to_reference"
    columns = reference.table["columns"]
    first = {"as it is": "qw_sensor_to_ENU", "renamed": "v11", "bare": 10}[form]
    assert columns["w"] == first
    (sense,) = reference.guesses
    assert sense.certainty == "high"


def test_real_counts(real_data):
    accelerometer = guess_files([real_data / "xsens-mti" / "xsens_acc.mat"]).recordings[0].table
    assert (accelerometer["kind"], accelerometer["unit"]) == ("positions", "counts")
    assert accelerometer["scale"]["offset"] == 32768
    # The factory's 413 to 415 counts a m/s²; a raw sensor's own errors are some per cent.
    assert 1 / accelerometer["scale"]["factor"] == pytest.approx(414, rel=0.03)
    gyroscope = guess_files([real_data / "xsens-mti" / "xsens_gyro.mat"]).recordings[0].table
    assert gyroscope["guessed"]["unit"] == "not known"
    static = guess_files([real_data / "adis16405-1" / "static.npz"]).recordings
    assert [r.table["kind"] for r in static] == ["static", "static"]
    assert [r.table["guessed"] for r in static] == [
        {"unit": "not known", "rate": "not known"}, {"rate": "not known"}
    ]  # fmt: skip


def test_gyroscope_counts_by_what_they_turn(real_data, tmp_path):
    folder = real_data / "xsens-mti"
    acc, gyro = (np.loadtxt(folder / f"xsens_{s}.mat") for s in ("acc", "gyro"))
    rows = min(len(acc), len(gyro))
    np.savetxt(tmp_path / "log.csv", np.c_[acc[:rows], gyro[:rows, 1:]], delimiter=",")
    tables = {r.table["sensor"]: r.table for r in guess_files([tmp_path / "log.csv"]).recordings}
    # The factory's 4758 to 4778 counts a rad/s.
    assert 1 / tables["gyroscope"]["scale"]["factor"] == pytest.approx(4767, rel=0.02)


def test_arrival_stamps_and_steps_of_a_converter(real_data):
    folder = real_data / "sunsided-tilt-sphere"
    for file, unit, rate in (("mpu6050_accelerometer", "g", 100), ("mpu6050_gyroscope", "deg/s", 100),
                             ("hmc5883l_compass", "gauss", 75)):  # fmt: skip
        table = guess_files([folder / f"{file}.mat"]).recordings[0].table
        assert (table["unit"], table["guessed"]) == (unit, {"rate": "low"})
        assert table["rate"] == pytest.approx(rate, rel=0.03)  # nominal


@pytest.mark.parametrize(("file", "expected"), [
    ("stable32/PHASE.DAT", "PHASE.DAT: holds no three columns of a sensor"),
    ("stable32/phase_dat_oadev.txt", "phase_dat_oadev.txt: holds"),
    ("ellipse-szpak/szpak_points.csv", "szpak_points.csv: holds 50 rows, too few for a recording"),
    ("iss-limb/clear_limb.jpg", "clear_limb.jpg: is a JPEG image, not a table"),
])  # fmt: skip
def test_what_is_no_recording(real_data, file, expected):
    with pytest.raises(InputError) as caught:
        guess_files([real_data / file])
    assert str(caught.value).startswith(expected)


# ---- declared units that cannot be true ----


def log(path, columns):
    pandas.DataFrame(columns).to_csv(path, index=False, float_format="%.6g")
    (recording,) = guess_files([path]).recordings
    return recording.table, {g.key: g for g in recording.guesses}


def test_one_g_is_not_one_metre_per_second_squared(tmp_path):
    rng = np.random.default_rng(3)
    v = rng.normal((0.01, -0.02, 1.0), 0.002, (1000, 3))
    table, guesses = log(tmp_path / "log.csv",
                         {f"acc_{a} [m/s^2]": c for a, c in zip("xyz", v.T, strict=True)})  # fmt: skip
    assert table["unit"] == "g"
    assert guesses["unit"].certainty == "medium"
    assert guesses["unit"].reason == ("the file says m/s^2, but gravity reads 1 at rest: that is g")


def test_hundreds_at_rest_are_no_radians_per_second(tmp_path):
    rng = np.random.default_rng(4)
    v = rng.normal((310.0, -120.0, 45.0), 25, (1000, 3))
    table, guesses = log(tmp_path / "log.csv",
                         {f"gyro_{a} (rad/s)": c for a, c in zip("xyz", v.T, strict=True)})  # fmt: skip
    assert guesses["unit"].certainty == "low"
    assert table["guessed"]["unit"] == "low"
    assert "which no gyroscope in rad/s does" in guesses["unit"].reason


@given(st.lists(st.text(max_size=12), min_size=4, max_size=9), st.integers(0, 99))
@settings(deadline=None)
def test_any_names_are_guessed_or_refused(tmp_path_factory, names, seed):
    path = tmp_path_factory.mktemp("n") / "log.csv"
    values = np.random.default_rng(seed).normal(size=(150, len(names)))
    pandas.DataFrame(values, columns=names).to_csv(path, index=False)
    try:
        device = sensorbook.load(path)
    except InputError:
        return
    assert device.guessed.recordings
