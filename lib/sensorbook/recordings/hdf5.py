"""HDF5, and what is written as it: MATLAB v7.3, netCDF-4. Links out of the file are not followed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.arrays import Variable, objects_only, places_of, tables_of
from sensorbook.recordings.tables import Source, Table

_ERRORS = (OSError, ValueError, RuntimeError, KeyError, TypeError, OverflowError, MemoryError)
_MOST_OBJECTS = 10_000
_DEEPEST = 8
_DEFAULT_FILLS = {"f4": 9.969209968386869e36, "f8": 9.969209968386869e36, "i2": -32767, "u2": 65535,
                  "i4": -2147483647, "u4": 4294967295, "i8": -9223372036854775806,
                  "u8": 18446744073709551614}  # fmt: skip


def table_names(source: Source) -> tuple[str, ...]:
    """Groups of equally long arrays, and matrices."""
    return tuple(sorted(tables_of(_variables(source))))


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a file; `table` names a group, an array or a compound data set."""
    variables = _variables(source)
    places = places_of(source, variables, table, wanted)

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        with _opened(source) as file:
            for index in indices:
                place = places[index]
                place.check(source)
                path, _, field = place.variable.path.partition("\0")
                try:
                    data = file[path]
                    if not _is_whole(data):
                        raise _damaged(source)
                    if field:
                        column = data.fields(field)[...]
                    elif place.column is None:
                        column = data[...]
                    else:
                        row = place.variable.is_row
                        column = data[place.column, :] if row else data[:, place.column]
                    is_netcdf = "_NCProperties" in file.attrs
                    out[index] = _scaled(np.asarray(column), data.attrs, is_netcdf)
                except _ERRORS as error:
                    if isinstance(error, InputError):
                        raise
                    raise _damaged(source) from None
        return out

    names = tuple(place.name.rpartition("\0")[2] for place in places)
    return Table(source.file, names, read, units=tuple(p.variable.unit for p in places))


def _opened(source: Source):
    import h5py

    _check_end(source)
    try:
        return h5py.File(source.path, "r", locking=False)
    except _ERRORS:
        raise _damaged(source) from None


def _check_end(source: Source) -> None:
    """Raises where the file does not end where its superblock says (HDF5 File Format 3.0, II.A).

    libhdf5 refuses files that are cut off, but reads those with bytes too many, and what lies after
    them comes from the wrong place.
    """
    head = source.head[512:] if source.head.startswith(b"MATLAB") else source.head
    if not head.startswith(b"\x89HDF") or len(head) < 64:
        raise _damaged(source)
    version = head[8]
    size = head[13] if version < 2 else head[9]
    at = {0: 24, 1: 28}.get(version, 12) + 2 * size
    if int.from_bytes(head[at : at + size], "little") != source.path.stat().st_size:
        raise _damaged(source)


def _is_whole(data) -> bool:
    """True where what is stored of a data set fits its shape, which no check sum covers.

    Less may be stored where what is missing shows, since it is not filled with zeros.
    """
    if data.chunks:
        pairs = zip(data.shape, data.chunks, strict=True)
        expected, stored = math.prod(-(-n // c) for n, c in pairs), data.id.get_num_chunks()
    else:
        expected = math.prod(data.shape) * data.id.get_type().get_size()
        stored = data.id.get_storage_size()
    is_seen = bool(np.asarray(data.fillvalue).tobytes().strip(b"\0"))
    return stored == expected or (stored < expected and is_seen)


def _variables(source: Source) -> list[Variable]:
    """Every array of numbers in the file, at most eight groups deep."""
    import h5py

    found: list[Variable] = []
    objects: list[str] = []
    groups: set[int] = set()  # by address: one may hold itself
    count = 0

    def look(group, path: str, depth: int) -> None:
        nonlocal count
        address = h5py.h5o.get_info(group.id).addr
        if address in groups:
            return
        groups.add(address)
        for name in group:
            if depth > _DEEPEST or name.startswith("#"):
                return  # "#refs#" and "#subsystem#" are MATLAB's own
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue  # soft and external links may lead out of the file, or round in it
            item = group[name]
            count += 1
            if count > _MOST_OBJECTS:
                raise source.wrong(f"holds more than {_MOST_OBJECTS} groups and variables",
                                   "save the columns of the recording alone")  # fmt: skip
            here = f"{path}/{name}" if path else name
            if "MATLAB_object_decode" in item.attrs:
                objects.append(here)
            elif isinstance(item, h5py.Group):
                look(item, here, depth + 1)
            elif isinstance(item, h5py.Dataset):
                _note(item, here, found)

    with _opened(source) as file:
        try:
            look(file, "", 0)
        except _ERRORS as error:
            if isinstance(error, InputError):
                raise
            raise _damaged(source) from None
    if objects and not found:
        raise objects_only(source, objects)
    return found


def _note(item, here: str, found: list[Variable]) -> None:
    if item.shape is None or item.is_virtual or item.external:
        return
    kind = item.dtype
    matlab = _text(item.attrs.get("MATLAB_class"))
    if matlab in ("char", "logical", "cell"):
        return
    unit = _text(item.attrs.get("units", item.attrs.get("unit", "")))
    is_complex = kind.names == ("real", "imag")  # as MATLAB writes it
    if kind.names and not is_complex and len(item.shape) == 1:  # compound: a field a column
        found += [
            Variable(f"{here}\0{name}", item.shape, kind[name].itemsize)
            for name in kind.names
            if kind[name].kind in "iuf" and not kind[name].shape and "/" not in name
        ]
    elif _text(item.attrs.get("NAME")).startswith("This is a netCDF dimension but not"):
        return
    elif "MATLAB_empty" not in item.attrs and (kind.kind in "iufc" or is_complex):
        is_complex |= kind.kind == "c"
        found.append(Variable(here, tuple(item.shape), kind.itemsize, unit, is_complex))


def _text(value) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else ""


def _scaled(column: np.ndarray, attributes, is_netcdf: bool) -> np.ndarray:
    """Fill values as NaN, and packed values unpacked, as netCDF's conventions have it."""
    return unpacked(
        column, {k: attributes.get(k) for k in
                 ("_FillValue", "missing_value", "scale_factor", "add_offset")}, is_netcdf
    )  # fmt: skip


def unpacked(column: np.ndarray, attributes: dict, is_netcdf: bool = True) -> np.ndarray:
    """A column as netCDF's attributes say: fill values are NaN, value = packed · scale + offset.

    A netCDF variable that declares no fill value has its type's (NetCDF Users' Guide, Attribute
    Conventions); types of one byte have none.
    """
    fills = [np.asarray(attributes[k]).ravel() for k in ("_FillValue", "missing_value")
             if attributes.get(k) is not None]  # fmt: skip
    default = _DEFAULT_FILLS.get(column.dtype.str[1:])
    if is_netcdf and default is not None and attributes.get("_FillValue") is None:
        fills.append(np.array([default], dtype=column.dtype))
    missing = np.isin(column, np.concatenate(fills)) if fills else None
    scale, offset = attributes.get("scale_factor"), attributes.get("add_offset")
    missing = np.isin(column, np.concatenate(fills)) if fills else None
    packed = scale is not None or offset is not None
    if packed or (missing is not None and missing.any()):
        column = column.astype(np.float64)
    if packed:
        column = column * float(np.ravel(1 if scale is None else scale)[0])
        column += float(np.ravel(0 if offset is None else offset)[0])
    if missing is not None and missing.any():
        column[missing] = np.nan
    if not column.dtype.isnative:
        column = column.astype(column.dtype.newbyteorder("="))
    return column


def _damaged(source: Source) -> InputError:
    matlab = source.head.startswith(b"MATLAB")
    kind = "MATLAB v7.3" if matlab else "HDF5"
    return source.wrong(
        f"is a damaged {kind} file, or one that is cut off", "save or copy it again"
    )
