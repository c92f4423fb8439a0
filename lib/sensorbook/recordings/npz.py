"""NumPy archives (.npz): one-dimensional arrays by name, columns of two-dimensional ones as "name:0"."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError, Problem
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, too_large


def table_names(source: Source) -> tuple[str, ...]:
    """None: all arrays of an archive are one table."""
    return ()


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens an archive; `table` names the one array whose columns are then addressed by index."""
    file = source.file
    try:
        archive = zipfile.ZipFile(source.path)
        if "[Content_Types].xml" in archive.namelist():
            raise source.wrong("is an Excel file: format not supported yet", "save it as .csv")
        shapes = {
            entry.filename.removesuffix(".npy"): _header(archive, entry)
            for entry in archive.infolist()
            if entry.filename.endswith(".npy")
        }
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError):
        raise _damaged(file) from None
    if table is not None:
        if table not in shapes:
            raise InputError(
                Problem(file, f"table {table!r}", "there is no such array",
                        f"arrays: {', '.join(sorted(shapes)) or 'none'}")
            )  # fmt: skip
        shapes = {table: shapes[table]}
    places = [  # array and column of every column of the table
        (name, k)
        for name, (shape, *_) in shapes.items()
        for k in (
            [None] if len(shape) == 1 else range(min(shape[1], 1000)) if len(shape) == 2 else []
        )
    ]
    if not places:
        raise InputError(
            Problem(
                file, "", "holds no array of samples", "save one array a column with numpy.savez"
            )
        )

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        arrays, columns = {}, {}
        for index in indices:
            name, k = places[index]
            if name not in arrays:
                arrays[name] = _array(archive, name, shapes[name], file)
            columns[index] = arrays[name] if k is None else arrays[name][:, k]
        return columns

    names = tuple(
        name if k is None or shapes[name][0][1] == 1 else f"{name}:{k}" for name, k in places
    )
    return Table(file, names, read)


def _header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[tuple[int, ...], int, str]:
    """Shape, declared size in bytes and dtype of an array, without reading it."""
    try:
        with archive.open(entry) as stream:
            version = np.lib.format.read_magic(stream)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, dtype = read(stream)
    except ValueError:
        return (), 0, "damaged"
    size = dtype.itemsize
    for length in shape:  # Python integers: a declared shape may overflow any fixed width
        size *= length
    # An array longer than its member would be allocated before its absence is noticed.
    return shape, max(size, entry.file_size), dtype.str if size <= entry.file_size else "damaged"


def _array(archive: zipfile.ZipFile, name: str, header, file: str) -> np.ndarray:
    _, size, dtype = header
    where = f"array {name!r}"
    if size > MAX_BYTES:
        raise too_large(file, where)
    if dtype == "damaged":
        raise _damaged(file)
    if np.dtype(dtype).kind not in "iufbMmUS":
        raise InputError(
            Problem(file, where, f"holds {np.dtype(dtype).name} values", "save plain numbers")
        )
    try:
        with archive.open(f"{name}.npy") as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
    except (
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
        RuntimeError,
    ):
        raise _damaged(file) from None
    return array


def _damaged(file: str) -> InputError:
    return InputError(Problem(file, "", "is a damaged .npz archive", "save or copy it again"))
