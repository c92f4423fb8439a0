"""`sensorbook apply`: the same table, the sensors' columns corrected, the rest as it was."""

from __future__ import annotations

import gzip
import json
import sqlite3

import h5py
import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sensorbook.apply_file import apply_file
from sensorbook.calibration import ErrorModel
from sensorbook.cli import main
from sensorbook.errors import InputError
from sensorbook.thermal import ThermalModel
from sensorbook.units import factor

MATRIX = [[1.01, 0.0, 0.0], [0.02, 0.97, 0.0], [-0.01, 0.005, 1.03]]
ACCELEROMETER = {
    "method": "multi_position",
    "matrix": MATRIX,
    "bias": [0.1, -0.3, 0.2],
    "g_sensitivity": None,
}
GYROSCOPE = {
    "method": "rest_to_rest",
    "matrix": [[0.99, 0.01, 0.0], [0.0, 1.02, -0.01], [0.005, 0.0, 1.0]],
    "bias": [0.01, -0.02, 0.03],
    "g_sensitivity": None,
}


def entry(sensor, unit, columns, **more):
    return {"file": "log.csv", "sensor": sensor, "kind": "positions", "unit": unit, "columns": columns,
            "rate_hz": 100.0, "time_unit": "s"} | more  # fmt: skip


A = entry("accelerometer", "g", {"time": "t", "x": "ax", "y": "ay", "z": "az"})
W = entry("gyroscope", "deg/s", {"time": "t", "x": "wx", "y": "wy", "z": "wz"})


def results(tmp_path, accelerometer=None, gyroscope=None, inputs=(A, W), **sensors):
    made = {
        "schema": 1,
        "device": {"id": "imu"},
        "inputs": list(inputs),
        "sensors": {"accelerometer": accelerometer or {}, "gyroscope": gyroscope or {}} | sensors,
    }
    path = tmp_path / "results.json"
    path.write_text(json.dumps(made))
    return path


def truth(n=200, seed=1):
    rng = np.random.default_rng(seed)
    return 9.8 * rng.standard_normal((n, 3)), rng.standard_normal((n, 3))


def raw_frame(a, w, acceleration_unit="g", rate_unit="deg/s"):
    model_a, model_w = ErrorModel.from_results(ACCELEROMETER), ErrorModel.from_results(GYROSCOPE)
    frame = {"t": np.arange(len(a)) / 100}
    raw_a = model_a.distort(a) / factor(acceleration_unit, "m/s^2")
    raw_w = model_w.distort(w) / factor(rate_unit, "rad/s")
    for k, axis in enumerate("xyz"):
        frame[f"a{axis}"], frame[f"w{axis}"] = raw_a[:, k], raw_w[:, k]
    return pd.DataFrame(frame)


def back(frame, acceleration_unit="g", rate_unit="deg/s"):
    a = frame[["ax", "ay", "az"]].to_numpy() * factor(acceleration_unit, "m/s^2")
    return a, frame[["wx", "wy", "wz"]].to_numpy() * factor(rate_unit, "rad/s")


BOTH = {"accelerometer": {"calibration": ACCELEROMETER}, "gyroscope": {"calibration": GYROSCOPE}}


@pytest.mark.parametrize("ending", [".csv", ".csv.gz", ".parquet", ".feather", ".npz"])
@pytest.mark.parametrize("source", ["csv", "parquet", "npz", "h5"])
def test_truth_comes_back_in_every_format(tmp_path, source, ending):
    a, w = truth()
    frame = raw_frame(a, w)
    file = tmp_path / f"log.{source}"
    if source == "csv":
        frame.to_csv(file, index=False, float_format="%.12g")
    elif source == "parquet":
        frame.to_parquet(file)
    elif source == "npz":
        np.savez(file, **{c: frame[c].to_numpy() for c in frame})
    else:
        with h5py.File(file, "w") as h5:
            for c in frame:
                h5[c] = frame[c].to_numpy()
    target = tmp_path / f"out{ending}"
    applied = apply_file(results(tmp_path, **BOTH), file, target)
    assert applied.done == (
        "accelerometer: calibration (multi position), in g",
        "gyroscope: calibration (rest to rest), in deg/s",
    )
    read = {
        ".csv": pd.read_csv, ".csv.gz": pd.read_csv, ".parquet": pd.read_parquet, ".feather": pd.read_feather,
        ".npz": lambda p: pd.DataFrame(dict(np.load(p))),
    }[ending]  # fmt: skip
    found = read(target)
    assert sorted(found.columns) == sorted(frame.columns)  # HDF5 has an order of its own
    np.testing.assert_allclose(found["t"], frame["t"], rtol=0, atol=1e-12)
    for got, true in zip(back(found), (a, w), strict=True):
        np.testing.assert_allclose(got, true, rtol=0, atol=2e-7)  # nine digits of 30
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


small = st.floats(-0.05, 0.05)


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.lists(small, min_size=9, max_size=9),
    st.lists(small, min_size=3, max_size=3),
    st.sampled_from(["m/s^2", "g", "mg", "counts"]),
)
def test_any_calibration_and_unit(tmp_path, off, bias, unit):
    model = ErrorModel(np.eye(3) + np.reshape(off, (3, 3)), bias)
    a, _ = truth(50, 2)
    scale = {"factor": [2e-3, 1e-3, 5e-4], "offset": 100, "unit": "m/s^2"}
    raw = model.distort(a)
    raw = raw / scale["factor"] + 100 if unit == "counts" else raw / factor(unit, "m/s^2")
    pd.DataFrame(raw, columns=["ax", "ay", "az"]).to_csv(
        tmp_path / "log.csv", index=False, float_format="%.15g"
    )
    calibration = ACCELEROMETER | {"matrix": model.matrix.tolist(), "bias": list(bias)}
    declared = A | {"unit": unit} | ({"scale": scale} if unit == "counts" else {})
    declared["columns"] = {k: declared["columns"][k] for k in "xyz"}
    where = results(tmp_path, {"calibration": calibration}, inputs=[declared])
    apply_file(where, tmp_path / "log.csv", tmp_path / "out.npz")
    out = np.load(tmp_path / "out.npz")
    got = np.stack([out[c] for c in ("ax", "ay", "az")], axis=1)
    got = (got - 100) * scale["factor"] if unit == "counts" else got * factor(unit, "m/s^2")
    np.testing.assert_allclose(got, a, rtol=0, atol=1e-9)


def test_every_other_character_stays(tmp_path):
    text = (
        "# logger 7; firmware 1,2\r\n"
        "time; ax ;ay;az;note;wx;wy;wz\r\n"
        '0,00;1,0;0;0;"a; b";5;5;5\r\n'
        "0,01; 1,0 ;0,0;0;;;5;5\r\n"
        "# paused\r\n"
        "\r\n"
        "0,02;1,0;0;0;x;5;5;5\r\n"
    )
    text += "".join(f"0,{k:02d};1,0;0;0;x;5;5;5\r\n" for k in range(3, 60))
    (tmp_path / "log.csv").write_bytes(text.encode())
    columns = {"time": "time", "x": "ax", "y": "ay", "z": "az"}
    double = {
        "method": "multi_position",
        "matrix": [[2, 0, 0], [0, 1, 0], [0, 0, 1]],
        "bias": [0, 0, 0],
    }
    where = results(tmp_path, {"calibration": double}, inputs=[A | {"columns": columns}])
    apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    got = (tmp_path / "out.csv").read_bytes().decode()
    expected = text.replace(";1,0;", ";0,5;").replace("; 1,0 ;0,0;", "; 0,5 ;0;")
    assert got == expected


def test_compressed_text(tmp_path):
    a, w = truth()
    with gzip.open(tmp_path / "log.csv.gz", "wt") as file:
        raw_frame(a, w).to_csv(file, index=False)
    apply_file(results(tmp_path, **BOTH), tmp_path / "log.csv.gz", tmp_path / "out.csv.gz")
    np.testing.assert_allclose(back(pd.read_csv(tmp_path / "out.csv.gz"))[0], a, atol=2e-7)


def test_missing_cells_stay_missing(tmp_path):
    a, w = truth()
    frame = raw_frame(a, w)
    frame.loc[5, "ay"] = np.nan
    frame.to_csv(tmp_path / "log.csv", index=False)
    apply_file(results(tmp_path, **BOTH), tmp_path / "log.csv", tmp_path / "out.csv")
    found = pd.read_csv(tmp_path / "out.csv")
    assert found.loc[5, ["ax", "ay", "az"]].isna().all()
    assert found[["wx", "wy", "wz"]].notna().all().all()
    assert found.drop(index=5).notna().all().all()


def test_thermal_first_then_calibration(tmp_path):
    n = 4000
    warmth = np.linspace(20, 40, n)
    a, _ = truth(n)
    model = ErrorModel.from_results(ACCELEROMETER)
    slopes = np.array([0.01, -0.02, 0.005])
    raw = model.distort(a) + (warmth - 30)[:, None] * slopes
    frame = pd.DataFrame(raw, columns=["ax", "ay", "az"])
    frame["temp"] = warmth
    frame.to_csv(tmp_path / "log.csv", index=False, float_format="%.12g")
    thermal = {
        axis: ThermalModel(30.0, ((20.0, 40.0, (7.0, float(s))),)).to_results()
        for axis, s in zip("xyz", slopes, strict=True)
    }
    columns = {"x": "ax", "y": "ay", "z": "az", "temperature": "temp"}
    declared = A | {"unit": "m/s^2", "columns": columns, "rate": 1.0}
    where = results(tmp_path, {"thermal": thermal, "calibration": ACCELEROMETER}, inputs=[declared])
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    assert applied.done == ("accelerometer: thermal model, calibration (multi position), in m/s^2",)
    got = pd.read_csv(tmp_path / "out.csv")[["ax", "ay", "az"]].to_numpy()
    # The temperature is smoothed over 30 s, which a straight ramp does not feel but at its ends.
    np.testing.assert_allclose(got[50:-50], a[50:-50], rtol=0, atol=2e-6)


def test_calibration_by_temperature_and_its_edges(tmp_path):
    n = 2000
    warmth = np.linspace(5, 45, n)
    a, _ = truth(n)
    t = np.clip(warmth, 10, 40) - 25
    scale, shift = np.array([1e-3, -5e-4, 0]), np.array([0.01, 0, -0.02])
    matrix = np.array(MATRIX) + t[:, None, None] * np.diag(scale)
    raw = np.einsum("nij,nj->ni", matrix, a) + ACCELEROMETER["bias"] + t[:, None] * shift
    frame = pd.DataFrame(raw, columns=["ax", "ay", "az"])
    frame["temp"] = warmth
    frame.to_csv(tmp_path / "log.csv", index=False, float_format="%.12g")
    calibration = ACCELEROMETER | {
        "reference_temperature": 25.0,
        "temperature": {
            "degree": 1, "range": [10.0, 40.0],
            "matrix_coefficients": [np.diag(scale).tolist()], "bias_coefficients": [shift.tolist()],
        },
    }  # fmt: skip
    columns = {"x": "ax", "y": "ay", "z": "az", "temperature": "temp"}
    declared = A | {"unit": "m/s^2", "columns": columns, "rate": 0.01}
    where = results(tmp_path, {"calibration": calibration}, inputs=[declared])
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    np.testing.assert_allclose(pd.read_csv(tmp_path / "out.csv")[["ax", "ay", "az"]], a, atol=1e-6)
    assert any("outside the calibrated 10.0 … 40.0 °C" in w for w in applied.warnings)


def test_g_sensitivity_takes_the_corrected_acceleration(tmp_path):
    a, w = truth()
    g = [[1e-3, 0, 0], [2e-3, 0, 0], [0, 0, -1e-3]]
    gyroscope = GYROSCOPE | {"g_sensitivity": g}
    frame = raw_frame(a, w)
    raw = ErrorModel.from_results(gyroscope).distort(w, a) / factor("deg/s", "rad/s")
    frame[["wx", "wy", "wz"]] = raw
    frame.to_csv(tmp_path / "log.csv", index=False, float_format="%.12g")
    both = BOTH | {"gyroscope": {"calibration": gyroscope}}
    apply_file(results(tmp_path, **both), tmp_path / "log.csv", tmp_path / "out.csv")
    np.testing.assert_allclose(back(pd.read_csv(tmp_path / "out.csv"))[1], w, atol=1e-7)
    alone = results(tmp_path, gyroscope={"calibration": gyroscope}, inputs=[W])
    applied = apply_file(alone, tmp_path / "log.csv", tmp_path / "out.csv")
    assert any("sensitivity to acceleration is left in" in line for line in applied.warnings)


def test_magnetometer(tmp_path):
    rng = np.random.default_rng(3)
    true = 5e-5 * rng.standard_normal((50, 3))
    soft = np.array([[1.1, 0.02, 0], [0.02, 0.9, 0], [0, 0, 1.0]])
    raw = true @ np.linalg.inv(soft).T + [1e-5, 2e-5, -3e-5]
    pd.DataFrame(raw * 1e6, columns=["mx", "my", "mz"]).to_csv(
        tmp_path / "log.csv", index=False, float_format="%.12g"
    )
    declared = entry("magnetometer", "uT", {"x": "mx", "y": "my", "z": "mz"})
    calibration = {
        "method": "ellipsoid",
        "hard_iron": [1e-5, 2e-5, -3e-5],
        "soft_iron": soft.tolist(),
    }
    where = results(tmp_path, inputs=[declared], magnetometer={"calibration": calibration})
    apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    np.testing.assert_allclose(pd.read_csv(tmp_path / "out.csv") * 1e-6, true, atol=1e-12)


IRON = {
    "method": "ellipsoid",
    "hard_iron": [1.7e-5, -2.3e-5, 4.1e-6],
    "soft_iron": [[1.08, 0.021, -0.013], [0.021, 0.94, 0.006], [-0.013, 0.006, 1.2]],
}
COUNTS = {"factor": [1.5e-3, 1.4e-3, 1.6e-3], "offset": [12, -7, 3], "unit": "gauss"}


@pytest.mark.parametrize("unit", ["mG", "uT", "nT", "gauss", "T", "counts"])
@pytest.mark.parametrize("ending", [".csv", ".parquet", ".npz"])
def test_a_magnetometers_file_in_its_own_unit(tmp_path, unit, ending):
    rng = np.random.default_rng(20240601)
    raw = 6e-5 * rng.standard_normal((300, 3))  # T
    true = np.array([np.array(IRON["soft_iron"]) @ (m - IRON["hard_iron"]) for m in raw])

    def shown(field):
        if unit == "counts":
            return field / 1e-4 / COUNTS["factor"] + COUNTS["offset"]
        return field / {"mG": 1e-7, "uT": 1e-6, "nT": 1e-9, "gauss": 1e-4, "T": 1.0}[unit]

    cells = [
        [f"{k / 50:.3f}", *map(repr, row), f"{k % 7} x", f"0{k}", "+1.50E+00"]
        for k, row in enumerate(shown(raw).tolist())
    ]
    head = ["t", "my", "mz", "mx", "note", "frame", "other"]
    for row in cells:
        row[1], row[2], row[3] = row[2], row[3], row[1]
    text = "".join(f"{','.join(row)}\n" for row in [head, *cells])
    (tmp_path / "log.csv").write_text(text)
    columns = {"time": "t", "x": "mx", "y": "my", "z": "mz"}
    scale = {"scale": COUNTS} if unit == "counts" else {}
    declared = entry("magnetometer", unit, columns, **scale)
    where = results(tmp_path, inputs=[declared], magnetometer={"calibration": IRON})
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / f"out{ending}")
    assert applied.done == (f"magnetometer: hard and soft iron (ellipsoid), in {unit}",)
    assert applied.warnings == ()
    expected = shown(true)
    if ending == ".csv":
        lines = [line.split(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
        assert lines[0] == head
        got = np.array([[float(row[k]) for k in (3, 1, 2)] for row in lines[1:]])
        np.testing.assert_allclose(
            got, expected, rtol=5.1e-9
        )  # nine digits, half a unit of the last
        for new, old in zip(lines[1:], cells, strict=True):
            assert [new[0], *new[4:]] == [old[0], *old[4:]]
        return
    if ending == ".npz":
        found = pd.DataFrame(dict(np.load(tmp_path / "out.npz")))
    else:
        found = pd.read_parquet(tmp_path / "out.parquet")
    assert list(found.columns) == head
    # Rounding in units and product, 1e-16 of the largest term, which an offset of counts may exceed.
    got = found[["mx", "my", "mz"]].to_numpy()
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max() / 1e3)
    assert found["t"].tolist() == [float(row[0]) for row in cells]
    assert found["note"].tolist() == [row[4] for row in cells]
    assert found["frame"].tolist() == [float(row[5]) for row in cells]
    assert set(found["other"]) == {1.5}


@pytest.mark.parametrize(("factor", "noted"), [
    (1.0, ""), (1.4, ""), (0.7, ""), (10.0, "480"), (0.1, "4.8"), (1.6, "76.8"), (0.6, "28.8"),
])  # fmt: skip
def test_a_field_of_another_strength_is_noted(tmp_path, factor, noted):
    """As of a file in mG where uT is declared, or one from elsewhere."""
    rng = np.random.default_rng(5)
    directions = rng.standard_normal((400, 3))
    true = 48e-6 * directions / np.linalg.norm(directions, axis=1)[:, None] * factor
    raw = np.linalg.solve(IRON["soft_iron"], true.T).T + IRON["hard_iron"]
    raw[7] = np.nan
    pd.DataFrame(raw * 1e6, columns=["mx", "my", "mz"]).to_csv(tmp_path / "log.csv", index=False)
    declared = entry("magnetometer", "uT", {"x": "mx", "y": "my", "z": "mz"})
    where = results(
        tmp_path, inputs=[declared], magnetometer={"calibration": IRON | {"field": 48e-6}}
    )
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    told = (
        f"magnetometer: corrected, the field is {noted} µT strong in the median, where the calibration "
        "has 48 µT: the file's unit or the place is another"
    )
    assert applied.warnings == ((told,) if noted else ())
    assert applied.done == ("magnetometer: hard and soft iron (ellipsoid), in uT",)


# --- what is wrong ---


def fails(tmp_path, words, **arguments):
    target = tmp_path / arguments.pop("target", "out.csv")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError) as caught:
        apply_file(
            arguments.pop("where"), tmp_path / arguments.pop("file", "log.csv"), target, **arguments
        )
    assert words in str(caught.value), caught.value
    assert sorted(tmp_path.iterdir()) == before
    return caught.value


@pytest.fixture
def log(tmp_path):
    raw_frame(*truth()).to_csv(tmp_path / "log.csv", index=False)
    return results(tmp_path, **BOTH)


def test_refused_calibrations_write_nothing(tmp_path, log):
    refused = {"calibration": {"method": None, "reason": "Six faces are not enough."}}
    where = results(tmp_path, refused, refused)
    error = fails(tmp_path, "no calibration: Six faces are not enough.", where=where)
    assert {p.where for p in error.problems} == {"sensors.accelerometer", "sensors.gyroscope"}


def test_one_refused_of_two_is_said(tmp_path, log):
    where = results(
        tmp_path, {"calibration": {"method": None, "reason": "Too few."}}, BOTH["gyroscope"]
    )
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    assert [d.split(":")[0] for d in applied.done] == ["gyroscope"]
    assert "accelerometer: no calibration: Too few." in applied.warnings


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("log.csv", "is the recording itself"),
        ("results.json", "is the results.json itself"),
        ("out.mat", "tells no table that can be written"),
        ("there/out.csv", "its folder does not exist"),
    ],
)
def test_bad_targets(tmp_path, log, target, words):
    fails(tmp_path, words, where=log, target=target)


def test_columns_of_no_recording(tmp_path, log):
    (tmp_path / "other.csv").write_text("a,b,c,d\n" + "1,2,3,4\n" * 20)
    fails(
        tmp_path,
        "has none of the columns of the device's recordings (ax, ay, az, wx, wy, wz)",
        where=log,
        file="other.csv",
    )
    given = {"x": "a", "y": "b", "z": "3"}
    applied = apply_file(log, tmp_path / "other.csv", tmp_path / "out.csv", "accelerometer", given)
    assert applied.done == ("accelerometer: calibration (multi position), in g",)


def test_two_sensors_of_the_same_columns(tmp_path, log):
    again = W | {"columns": A["columns"], "file": "gyro.csv"}
    where = results(tmp_path, **BOTH, inputs=[A | {"file": "acc.csv"}, again])
    fails(tmp_path, "are those of accelerometer and gyroscope alike", where=where)
    apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv", "gyroscope")


def test_two_units(tmp_path, log):
    where = results(
        tmp_path, **BOTH, inputs=[A | {"file": "a.csv"}, A | {"unit": "m/s^2", "file": "b.csv"}]
    )
    fails(tmp_path, "could be read in 2 ways", where=where)


def test_a_database_with_a_table_a_sensor(tmp_path, log):
    with sqlite3.connect(tmp_path / "log.db") as base:
        frame = raw_frame(*truth())
        for table, letter in (("acc", "a"), ("gyr", "w")):
            part = frame[["t", *(f"{letter}{k}" for k in "xyz")]].set_axis(list("txyz"), axis=1)
            part.to_sql(table, base, index=False)
    base.close()
    columns = {"time": "t", "x": "x", "y": "y", "z": "z"}
    inputs = [A | {"table": "acc", "columns": columns}, W | {"table": "gyr", "columns": columns}]
    where = results(tmp_path, **BOTH, inputs=inputs)
    fails(tmp_path, "holds a table each for accelerometer, gyroscope", where=where, file="log.db")
    apply_file(where, tmp_path / "log.db", tmp_path / "out.csv", "gyroscope")
    got = pd.read_csv(tmp_path / "out.csv")[["x", "y", "z"]].to_numpy() * factor("deg/s", "rad/s")
    np.testing.assert_allclose(got, truth()[1], atol=1e-7)


def test_text_where_a_number_should_be(tmp_path, log):
    text = (tmp_path / "log.csv").read_text().splitlines()
    text[10] = text[10].replace(text[10].split(",")[1], "oops")
    (tmp_path / "log.csv").write_text("\n".join(text) + "\n")
    fails(tmp_path, "'oops' is not a number", where=log)


def test_the_command(tmp_path, log, capsys):
    arguments = ["apply", str(log), str(tmp_path / "log.csv"), "-o", str(tmp_path / "out.csv")]
    assert main(arguments) == 0
    assert "accelerometer: calibration (multi position), in g" in capsys.readouterr().out
    assert main([*arguments, "--columns", "x=a,y=b,z=c"]) == 2
    assert main([*arguments, "--sensor", "gyroscope", "--columns", "x=a"]) == 2
    assert (
        main(
            [
                "apply",
                str(tmp_path / "no.json"),
                str(tmp_path / "log.csv"),
                "-o",
                str(tmp_path / "o.csv"),
            ]
        )
        == 1
    )
    assert "cannot be read" in capsys.readouterr().err


def test_between_blanks_a_missing_number_stays_a_cell(tmp_path):
    a, w = truth()
    frame = raw_frame(a, w)
    frame.loc[5, "ay"] = np.nan
    frame.to_csv(tmp_path / "log.txt", index=False, sep=" ", na_rep="nan")
    apply_file(results(tmp_path, **BOTH), tmp_path / "log.txt", tmp_path / "out.txt")
    lines = (tmp_path / "out.txt").read_text().splitlines()
    assert {len(line.split()) for line in lines} == {7}
    assert lines[6].split().count("nan") == 3


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_marks_of_encoding_stay(tmp_path, encoding):
    a, w = truth()
    raw_frame(a, w).to_csv(tmp_path / "log.csv", index=False, encoding=encoding)
    apply_file(results(tmp_path, **BOTH), tmp_path / "log.csv", tmp_path / "out.csv")
    before, after = ((tmp_path / n).read_bytes()[:3] for n in ("log.csv", "out.csv"))
    assert before == after
    found = pd.read_csv(tmp_path / "out.csv", encoding=encoding)
    np.testing.assert_allclose(back(found)[0], a, atol=2e-7)


def test_a_preamble_with_odd_line_breaks(tmp_path):
    a, w = truth()
    text = "Logger\x0b v1 \u2028 x\n" + raw_frame(a, w).to_csv(index=False)
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    apply_file(results(tmp_path, **BOTH), tmp_path / "log.csv", tmp_path / "out.csv")
    found = pd.read_csv(tmp_path / "out.csv", skiprows=1)
    assert len(found) == len(a)
    np.testing.assert_allclose(back(found)[0], a, atol=2e-7)


def test_a_sensor_left_raw_is_said(tmp_path, log):
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "other.csv").write_text(text.replace("ax,", "Ax,", 1))
    applied = apply_file(log, tmp_path / "other.csv", tmp_path / "out.csv")
    assert [d.split(":")[0] for d in applied.done] == ["gyroscope"]
    assert any(
        "accelerometer: left as it is, column 'ax' there is no such column" in w
        for w in applied.warnings
    )


def test_a_csv_of_a_device_that_was_recorded_in_a_database(tmp_path, log):
    where = results(tmp_path, **BOTH, inputs=[A | {"table": "acc"}, W | {"table": "gyr"}])
    applied = apply_file(where, tmp_path / "log.csv", tmp_path / "out.csv")
    assert len(applied.done) == 2


@pytest.mark.parametrize(
    "damage",
    [{"matrix": [[0, 0, 0]] * 3}, {"matrix": [[1, 2]]}, {"bias": None}, {"bias": ["a", 1, 2]}],
)
def test_damaged_results(tmp_path, log, damage):
    where = results(tmp_path, {"calibration": ACCELEROMETER | damage})
    fails(tmp_path, "sensors.accelerometer.calibration: cannot serve", where=where)


SHAPES = "hard_iron is not of three numbers, or soft_iron not of three by three"


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"hard_iron": None}, SHAPES),
        ({"hard_iron": [1e-5, "a", 0]}, "could not convert string to float: 'a'"),
        ({"hard_iron": [[1e-5, 0, 0]]}, SHAPES),
        ({"soft_iron": [[1, 0], [0, 1]]}, SHAPES),
        (
            {"soft_iron": [[1, 0, 0], [0, 1, 0], [0, 0, float("nan")]]},
            "hard_iron or soft_iron is not finite",
        ),
    ],
)
def test_a_damaged_magnetometers_calibration(tmp_path, damage, words):
    (tmp_path / "log.csv").write_text("mx,my,mz\n" + "1,2,3\n" * 20)
    declared = entry("magnetometer", "mG", {"x": "mx", "y": "my", "z": "mz"})
    calibration = {"calibration": IRON | damage}
    where = results(tmp_path, inputs=[declared], magnetometer=calibration)
    fails(tmp_path, f"sensors.magnetometer.calibration: cannot serve: {words}", where=where)
    calibration["calibration"].pop("hard_iron")
    where = results(tmp_path, inputs=[declared], magnetometer=calibration)
    fails(tmp_path, "sensors.magnetometer.calibration: cannot serve: 'hard_iron'", where=where)
