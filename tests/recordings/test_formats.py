"""Binary tables: what independent writers wrote comes back, and what cannot be read is said."""

import sqlite3

import h5py
import netCDF4
import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
import pytest
from pyarrow import feather
from scipy.io import savemat

import sensorbook
from sensorbook import InputError
from sensorbook.recordings import check, open_table
from sensorbook.recordings.assemble import stamps
from sensorbook.recordings.tables import table_names

COUNT = 400


@pytest.fixture
def columns():
    rng = np.random.default_rng(11)
    named = {axis: rng.normal(size=COUNT) for axis in ("gx", "gy", "gz")}
    return {"t": np.arange(COUNT) / 100, **named, "n": np.arange(COUNT, dtype=np.int32)}


def parquet(path, columns):
    pyarrow.parquet.write_table(pyarrow.table(columns), path, row_group_size=150)


def feather_(path, columns):
    feather.write_feather(pyarrow.table(columns), str(path), compression="lz4", chunksize=150)


def pandas_parquet(path, columns):
    pandas.DataFrame(columns).to_parquet(path)


def hdf5(path, columns):
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, chunks=(100,), compression="gzip")


def hdf5_group(path, columns):
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"imu/{name}"] = values
        file["version"] = 3


def hdf5_compound(path, columns):
    with h5py.File(path, "w") as file:
        file["log"] = pandas.DataFrame(columns).to_records(index=False)


def matlab5(path, columns):
    savemat(path, columns)


def matlab5_compressed(path, columns):
    savemat(path, columns, do_compression=True, oned_as="column")


def matlab5_struct(path, columns):
    savemat(path, {"log": columns, "rate": 100.0})


def netcdf(kind):
    def write(path, columns):
        with netCDF4.Dataset(path, "w", format=kind) as file:
            file.createDimension("time", len(columns["t"]))
            for name, values in columns.items():
                variable = file.createVariable(name, values.dtype, ("time",))
                variable[:] = values
                variable.units = "s" if name == "t" else "deg/s"

    return write


def sqlite(path, columns):
    with sqlite3.connect(path) as database:
        pandas.DataFrame(columns).to_sql("log", database, index=False)


WRITERS = {
    "parquet": parquet,
    "pandas-parquet": pandas_parquet,
    "feather": feather_,
    "hdf5": hdf5,
    "hdf5-group": hdf5_group,
    "hdf5-compound": hdf5_compound,
    "matlab5": matlab5,
    "matlab5-compressed": matlab5_compressed,
    "matlab5-struct": matlab5_struct,
    "netcdf3": netcdf("NETCDF3_CLASSIC"),
    "netcdf3-64bit": netcdf("NETCDF3_64BIT_OFFSET"),
    "netcdf4": netcdf("NETCDF4"),
    "sqlite": sqlite,
}


@pytest.mark.parametrize("writer", WRITERS)
def test_what_was_written_comes_back_whatever_the_name(tmp_path, columns, writer):
    path = tmp_path / "log.dat"  # read by content
    WRITERS[writer](path, columns)
    table = open_table(path)
    assert set(table.names) == set(columns)
    for name, values in columns.items():
        got = table.column(name)
        assert got.dtype.kind == values.dtype.kind
        np.testing.assert_array_equal(got.ravel(), values)
        assert got.shape == (COUNT,)


@pytest.mark.parametrize("writer", ["netcdf3", "netcdf4"])
def test_units_a_file_declares(tmp_path, columns, writer):
    WRITERS[writer](tmp_path / "log.nc", columns)
    table = open_table(tmp_path / "log.nc")
    assert dict(zip(table.names, table.units, strict=True))["gx"] == "deg/s"


def test_matrices_have_their_samples_along_the_longer_side(tmp_path, columns):
    matrix = np.stack([columns["t"], columns["gx"], columns["gy"], columns["gz"]])
    for name, value in (("wide", matrix), ("tall", matrix.T)):
        savemat(tmp_path / f"{name}.mat", {"log": value})
        np.testing.assert_array_equal(open_table(tmp_path / f"{name}.mat").column(2), matrix[2])
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["log"] = value
        np.testing.assert_array_equal(open_table(tmp_path / f"{name}.h5").column(3), matrix[3])


def test_several_tables_ask_which(tmp_path, columns):
    path = tmp_path / "phone.db"
    with sqlite3.connect(path) as database:
        pandas.DataFrame(columns).to_sql("Gyroscope", database, index=False)
        pandas.DataFrame(columns).head(100).to_sql("Accelerometer", database, index=False)
        database.execute("CREATE VIEW both AS SELECT * FROM Gyroscope")
    assert table_names(path) == ("Accelerometer", "Gyroscope")
    with pytest.raises(InputError) as caught:
        open_table(path)
    assert str(caught.value) == (
        'phone.db: holds 2 tables of samples — say which with table = "…"; '
        "tables: 'Accelerometer', 'Gyroscope'"
    )
    assert len(open_table(path, table="Accelerometer").column("gx")) == 100
    with pytest.raises(
        InputError, match=r"phone.db: table 'both': there is no such table — tables: 'A"
    ):
        open_table(path, table="both")


def matlab73(path, columns):
    """Written as MATLAB does: (1, N) for columns, text and logicals among them."""
    with h5py.File(path, "w") as file:
        held = {name: (values[None], b"double") for name, values in columns.items()}
        held["unit"] = np.frombuffer(b"degrees per second", "u1").astype("u2")[:, None], b"char"
        held["still"] = np.ones((1, COUNT), "u1"), b"logical"
        for name, (values, kind) in held.items():
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)


@pytest.mark.parametrize("ending", ["h5", "mat", "mat73"])
def test_settings_text_and_logicals_beside_samples_are_no_columns(tmp_path, columns, ending):
    path = tmp_path / f"log.{ending}"
    if ending == "mat73":
        matlab73(path, columns)
    else:
        settings = {"rate": 100.0, "bias": np.array([1.0, 2, 3]), "axes": np.eye(3)}
        if ending == "mat":
            savemat(path, columns | settings | {"still": columns["t"] > 1, "unit": "deg/s"})
        else:
            with h5py.File(path, "w") as file:
                for name, value in (columns | settings).items():
                    file[name] = value
    assert set(open_table(path).names) == set(columns)


def test_variables_of_several_lengths_are_told_by_the_columns_wanted(folder, rng):
    path = folder(MIXED.replace("phone.db", "log.mat").replace('table = "Gyroscope"\n', "")
                  .replace('table = "Accelerometer"\n', "").replace('time = "t"', 'time = "ta"', 2)
                  .replace('"ta", x = "x", y = "y", z = "z"', '"tg", x = "g:0", y = "g:1", z = "g:2"', 1)
                  .replace('x = "x", y = "y", z = "z"', 'x = "a:0", y = "a:1", z = "a:2"'))  # fmt: skip
    values = {"tg": np.arange(1000) / 200, "g": rng.normal(size=(1000, 3)),
              "ta": np.arange(500) / 100, "a": rng.normal(size=(500, 3))}  # fmt: skip
    savemat(path / "log.mat", values)
    device = sensorbook.load(path)
    np.testing.assert_array_equal(device.gyroscope.static.values, values["g"])
    np.testing.assert_array_equal(device.accelerometer.static.values, values["a"])
    savemat(path / "struct.mat", {"imu": values, "other": np.arange(50.0)})
    imu = open_table(path / "struct.mat", table="imu", wanted=["ta", "a:0"])
    np.testing.assert_array_equal(imu.column("a:2"), values["a"][:, 2])
    refused(
        path / "log.mat",
        'log.mat: holds 4 variables of samples — say which with table = "…"; variables: '
        "'a', 'g', 'ta', 'tg'",
    )


def test_rows_of_a_database_keep_the_order_they_were_written_in(tmp_path):
    rows = [(3.0, 30.0), (1.0, 10.0), (2.0, 20.0)]
    with sqlite3.connect(tmp_path / "a.db") as database:
        database.execute("CREATE TABLE android_metadata (locale)")
        database.execute("INSERT INTO android_metadata VALUES ('en_GB')")
        database.execute("CREATE TABLE a (x, rowid)")  # a name that hides SQLite's own
        database.executemany("INSERT INTO a VALUES (?, ?)", rows)
        database.execute("CREATE INDEX sorted ON a (x, rowid)")
    table = open_table(tmp_path / "a.db")
    assert list(zip(table.column("x"), table.column("rowid"), strict=True)) == rows


def test_nulls_are_nan_and_fill_values_too(tmp_path, columns):
    values = [1, None, 3]
    pyarrow.parquet.write_table(pyarrow.table({"x": values}), tmp_path / "a.parquet")
    np.testing.assert_array_equal(open_table(tmp_path / "a.parquet").column("x"), [1, np.nan, 3])
    pyarrow.parquet.write_table(pyarrow.table({"x": pyarrow.nulls(3)}), tmp_path / "a.parquet")
    assert np.isnan(open_table(tmp_path / "a.parquet").column("x")).all()
    with sqlite3.connect(tmp_path / "a.db") as database:
        database.execute("CREATE TABLE a (x)")
        database.executemany("INSERT INTO a VALUES (?)", [(v,) for v in values])
    np.testing.assert_array_equal(open_table(tmp_path / "a.db").column("x"), [1, np.nan, 3])
    for kind in ("NETCDF3_CLASSIC", "NETCDF4"):
        with netCDF4.Dataset(tmp_path / "a.nc", "w", format=kind) as file:
            file.createDimension("time", 3)
            x = file.createVariable("x", "i2", ("time",), fill_value=-999)
            x.scale_factor, x.add_offset = 0.5, 10.0
            x[:] = np.ma.masked_array([10.5, 0, 11.5], mask=[0, 1, 0])
        # Packed to 16 bits with a step of 0.5, which holds these values exactly.
        np.testing.assert_array_equal(
            open_table(tmp_path / "a.nc").column("x"), [10.5, np.nan, 11.5]
        )


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF4"])
def test_values_never_written_to_netcdf_are_nan(tmp_path, kind):
    with netCDF4.Dataset(tmp_path / "a.nc", "w", format=kind) as file:
        file.createDimension("time", 3)
        for name, dtype in (("x", "f4"), ("n", "i2"), ("m", "i4")):
            file.createVariable(name, dtype, ("time",))[:2] = [1, 2]
    table = open_table(tmp_path / "a.nc")
    for name in "xnm":
        np.testing.assert_array_equal(table.column(name), [1, 2, np.nan])


def test_time_stamps_of_parquet(tmp_path):
    moments = pandas.date_range("2024-05-01", periods=5, freq="10ms", tz="UTC")
    pandas.DataFrame({"t": moments}).to_parquet(tmp_path / "a.parquet")
    column = open_table(tmp_path / "a.parquet").column("t")
    assert column.dtype == "datetime64[ns]"
    assert (np.diff(column) == np.timedelta64(10, "ms")).all()


def test_durations_of_parquet_keep_their_unit(tmp_path):
    steps = pyarrow.array([10, 20, None, 40], pyarrow.duration("ms"))
    daytimes = pyarrow.array([10, 20, None, 40], pyarrow.time32("ms"))
    table = pyarrow.table({"t": steps, "day": daytimes})
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    read = open_table(tmp_path / "a.parquet")
    for name in ("t", "day"):
        seconds, start = stamps(read, name, "s")
        np.testing.assert_allclose(seconds, [0, 0.01, np.nan, 0.03], rtol=1e-15)  # rounding
        assert start == pytest.approx(0.01, rel=1e-15)


def test_columns_of_one_name_are_told_apart_by_index(tmp_path):
    arrays = [pyarrow.array([k, k + 1.0]) for k in (1, 3, 5)]
    table = pyarrow.Table.from_arrays(arrays, names=["x", "x.y", "x"])
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    with pyarrow.ipc.new_file(tmp_path / "a.arrow", table.schema) as writer:
        writer.write_table(table)
    for path in (tmp_path / "a.parquet", tmp_path / "a.arrow"):
        read = open_table(path)
        assert [read.column(k).tolist() for k in range(3)] == [[1, 2], [3, 4], [5, 6]]


def test_units_in_the_metadata_of_arrow_fields(tmp_path):
    field = pyarrow.field("x", pyarrow.float64(), metadata={"unit": "deg/s"})
    table = pyarrow.table({"x": [1.0], "y": [2.0]}).cast(
        pyarrow.schema([field, pyarrow.field("y", pyarrow.float64())])
    )
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    feather.write_feather(table, str(tmp_path / "a.feather"))
    for path in (tmp_path / "a.parquet", tmp_path / "a.feather"):
        assert open_table(path).units == ("deg/s", "")


MIXED = """
[[recording]]
sensor = "gyroscope"
kind = "static"
file = "phone.db"
table = "Gyroscope"
unit = "rad/s"
columns = { time = "t", x = "x", y = "y", z = "z" }

[[recording]]
sensor = "accelerometer"
kind = "static"
file = "phone.db"
table = "Accelerometer"
unit = "m/s^2"
columns = { time = "t", x = "x", y = "y", z = "z" }
"""


def test_mixed_rates_and_disorder_of_a_phone_recorder(folder, rng):
    path = folder(MIXED)
    gyro = pandas.DataFrame(rng.normal(size=(1000, 3)), columns=list("xyz")).assign(
        t=np.arange(1000) / 200
    )
    gyro.loc[500, "t"] = gyro.loc[499, "t"]  # the same stamp twice
    gyro.loc[[700, 701], "t"] = gyro.loc[[701, 700], "t"].to_numpy()  # and two in the wrong order
    acc = pandas.DataFrame(rng.normal((0, 0, 9.8), size=(500, 3)), columns=list("xyz")).assign(
        t=np.arange(500) / 100
    )
    with sqlite3.connect(path / "phone.db") as database:
        gyro.to_sql("Gyroscope", database, index=False)
        acc.to_sql("Accelerometer", database, index=False)
    device = sensorbook.load(path)
    # Rates to 1e-3: one stamp of a thousand is out of place.
    assert device.gyroscope.static.rate == pytest.approx(200, rel=1e-3)
    assert device.accelerometer.static.rate == pytest.approx(100, rel=1e-6)
    kinds = {finding.kind for finding in device.gyroscope.static.findings}
    assert {"duplicate", "backward"} <= kinds


# ---- what cannot be read ----


def refused(path, expected, **options):
    def read():
        table = open_table(path, **options)
        table.parse(range(len(table.names)))

    with pytest.raises(InputError) as caught:
        read()
    assert str(caught.value).startswith(expected)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(("writer", "expected"), [
    ("parquet", "log.dat: is a damaged Parquet file, or one that is cut off — save or copy it again"),
    ("feather", "log.dat: is a damaged Feather file, or one that is cut off — save or copy it again"),
    ("hdf5", "log.dat: is a damaged HDF5 file, or one that is cut off — save or copy it again"),
    ("netcdf4", "log.dat: is a damaged HDF5 file, or one that is cut off — save or copy it again"),
    ("netcdf3", "log.dat: is a damaged netCDF file, or one that is cut off — save or copy it again"),
    ("matlab5", "log.dat: is cut off — copy it again"),
    ("matlab5-compressed", "log.dat: is cut off — copy it again"),
    ("sqlite", "log.dat: is cut off — copy it again"),
])  # fmt: skip
def test_a_file_that_ends_early_is_said_to(tmp_path, columns, writer, expected):
    path = tmp_path / "log.dat"
    WRITERS[writer](path, columns)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole))])
    refused(path, expected)


def test_links_out_of_an_hdf5_file_are_not_followed(tmp_path, columns):
    hdf5(tmp_path / "secret.h5", columns)
    (tmp_path / "secret.bin").write_bytes(np.arange(COUNT, dtype="f8").tobytes())
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name in columns:
            file[name] = h5py.ExternalLink("secret.h5", f"/{name}")
        layout = h5py.VirtualLayout(shape=(COUNT,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "gx", shape=(COUNT,))
        file.create_virtual_dataset("v", layout)
        file.create_dataset("e", shape=(COUNT,), dtype="f8",
                            external=[(str(tmp_path / "secret.bin"), 0, 8 * COUNT)])  # fmt: skip
    refused(tmp_path / "log.h5", "log.h5: holds no variables of samples — name another file")


def test_declared_sizes_are_not_believed(tmp_path):
    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        file.create_dataset("x", shape=(10**12,), dtype="f8", chunks=(10**6,), compression="gzip")
    refused(tmp_path / "bomb.h5", "bomb.h5: variable 'x': holds more than 4 GiB — split it into")


def test_a_long_text_said_many_times_is_held_once(tmp_path):
    texts = pyarrow.array(["x" * 1_000_000, None, "y"]).dictionary_encode()
    which = pyarrow.array(np.arange(60_000) % 3)
    column = pyarrow.DictionaryArray.from_arrays(texts.indices.take(which), texts.dictionary)
    table = pyarrow.table({"label": column})
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet", dictionary_pagesize_limit=1 << 24)
    feather.write_feather(table, str(tmp_path / "a.feather"))
    for name in ("a.parquet", "a.feather"):
        labels = open_table(tmp_path / name).column("label")
        assert [label and label[:2] for label in labels[-3:]] == ["xx", None, "y"]
        assert len(labels) == 60_000
        assert labels[0] is labels[3]  # 20 GB otherwise


def test_a_compressed_matlab_bomb(tmp_path, monkeypatch):
    monkeypatch.setattr("sensorbook.recordings.matlab.MAX_BYTES", 1 << 20)
    savemat(tmp_path / "bomb.mat", {"x": np.zeros(1 << 20)}, do_compression=True)
    assert (tmp_path / "bomb.mat").stat().st_size < 1 << 16
    refused(tmp_path / "bomb.mat", "bomb.mat: holds more than")


def test_pickles_in_hdf5_are_no_columns(tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset(
            "x", data=[b"cos\nsystem\n(S'id'\ntR."], dtype=h5py.special_dtype(vlen=bytes)
        )
        file["y"] = np.arange(5.0)
    assert open_table(tmp_path / "log.h5").names == ("y",)


def test_a_database_its_recorder_left_open(tmp_path):
    path = tmp_path / "phone.db"
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("CREATE TABLE a (x)")
    database.execute("INSERT INTO a VALUES (1)")
    database.commit()
    refused(
        path, "phone.db: was not closed by its recorder: phone.db-wal holds more of it — open and"
    )
    database.close()


def test_a_database_that_takes_too_long(tmp_path, monkeypatch):
    with sqlite3.connect(tmp_path / "a.db") as database:
        database.execute("CREATE TABLE a (x)")
        database.executemany("INSERT INTO a VALUES (?)", [(k,) for k in range(100_000)])
    monkeypatch.setattr("sensorbook.recordings.sqlite._LONGEST", 0.0)
    refused(tmp_path / "a.db", "a.db: takes longer than 0 s to read — save the table as .csv")


def test_text_among_the_numbers_of_a_database_names_its_row(folder):
    path = folder(MIXED)
    with sqlite3.connect(path / "phone.db") as database:
        for name in ("Gyroscope", "Accelerometer"):
            database.execute(f"CREATE TABLE {name} (t, x, y, z)")
            rows = [(k / 100, k % 7, k % 5, "oops" if k == 41 else k % 3) for k in range(300)]
            database.executemany(f"INSERT INTO {name} VALUES (?, ?, ?, ?)", rows)
    problems, _ = check(path)
    assert {str(p) for p in problems} == {
        "phone.db: column 'z', row 42: 'oops' is not a number — mend the row or leave the cell empty"
    }


def test_other_kinds_of_values_are_refused(tmp_path):
    pyarrow.parquet.write_table(pyarrow.table({"x": [[1, 2], [3]]}), tmp_path / "a.parquet")
    refused(
        tmp_path / "a.parquet", "a.parquet: column 'x': holds list<element: int64> values — save"
    )
    savemat(tmp_path / "a.mat", {"s": "text", "yes": np.arange(5) > 2})
    refused(tmp_path / "a.mat", "a.mat: holds no variables of samples")


def test_complex_variables_are_refused_when_asked_for(tmp_path):
    values = np.arange(20) * 1j
    savemat(tmp_path / "a.mat", {"t": np.arange(20.0), "x": values})
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["x"] = np.arange(20.0), values
    pair = np.empty(20, dtype=[("real", "f8"), ("imag", "f8")])
    pair["real"], pair["imag"] = values.real, values.imag
    with h5py.File(tmp_path / "b.h5", "w") as file:  # as MATLAB v7.3 writes them
        file["t"], file["x"] = np.arange(20.0)[None], pair[None]
    for name in ("a.mat", "a.h5", "b.h5"):
        assert open_table(tmp_path / name).column("t")[19] == 19
        refused(tmp_path / name, f"{name}: variable 'x': holds complex values — save its real and")


def test_a_matlab_table_cannot_be_read(tmp_path):
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["T"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype="u4")
        file["T"].attrs["MATLAB_class"] = np.bytes_("table")
        file["T"].attrs["MATLAB_object_decode"] = np.int32(3)
    refused(
        tmp_path / "a.mat",
        "a.mat: holds MATLAB objects only ('T'), such as tables — save the columns as plain",
    )


def test_groups_that_hold_themselves_come_to_an_end(tmp_path, columns):
    hdf5_group(tmp_path / "log.h5", columns)
    with h5py.File(tmp_path / "log.h5", "a") as file:
        for k in range(8):
            file[f"imu/again{k}"] = file["imu"]
    assert table_names(tmp_path / "log.h5") == ("imu",)
