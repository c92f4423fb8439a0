"""Parquet and Feather (Arrow IPC): columns by name, each read when asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sensorbook.errors import InputError
from sensorbook.recordings.tables import MAX_BYTES, Source, Table, too_large


def table_names(source: Source) -> tuple[str, ...]:
    """None: a file is one table."""
    return ()


def open_table(source: Source, table: str | None, wanted: Sequence[str | int]) -> Table:
    """Opens a Parquet or Feather file; units stand in the fields' metadata, if anywhere."""
    import pyarrow
    from pyarrow import ipc, parquet

    if table is not None:
        raise source.wrong("holds one table only", "leave `table` out", f"table {table!r}")
    try:
        if source.head.startswith(b"PAR1"):
            # A few kB can say a long text many times: it is held once.
            texts = [
                field.name for field in parquet.read_schema(source.path) if _is_text(field.type)
            ]
            file = parquet.ParquetFile(
                source.path, page_checksum_verification=True, read_dictionary=texts
            )
            schema, rows = file.schema_arrow, file.metadata.num_rows
        else:
            reader = ipc.open_file(pyarrow.memory_map(str(source.path)))
            schema, rows = reader.schema, None
        names = tuple(schema.names)
    except (pyarrow.ArrowException, OSError, ValueError, OverflowError):
        raise _damaged(source) from None
    if rows is not None and rows * 8 > MAX_BYTES:
        raise too_large(source.file)

    def read(indices: Sequence[int]) -> dict[int, np.ndarray]:
        out = {}
        for index in indices:
            try:
                if rows is None:
                    options = ipc.IpcReadOptions(included_fields=[index])
                    with pyarrow.memory_map(str(source.path)) as stream:
                        part = ipc.open_file(stream, options=options).read_all()
                else:
                    parts = [
                        file.read_row_group(k, columns=[names[index]])
                        for k in range(file.metadata.num_row_groups)
                    ]
                    part = pyarrow.concat_tables(parts) if parts else schema.empty_table()
                if rows not in (None, part.num_rows):
                    raise _damaged(source)  # a damaged page gives fewer
                # Parquet reads by name, which gives all columns of one name in their order.
                there = [k for k, name in enumerate(part.column_names) if name == names[index]]
                which = names[:index].count(names[index]) if len(there) > 1 else 0
                out[index] = _values(source, part.column(there[which]), names[index])
            except (pyarrow.ArrowException, OSError, ValueError, LookupError,
                    OverflowError) as error:  # fmt: skip
                if isinstance(error, InputError):
                    raise
                raise _damaged(source) from None
        return out

    units = tuple(
        next((v.decode("utf-8", "replace") for k, v in (field.metadata or {}).items()
              if k.lower() in (b"unit", b"units")), "")
        for field in schema
    )  # fmt: skip
    return Table(source.file, names, read, units=units)


def _values(source: Source, column, name: str) -> np.ndarray:
    """A column's values; nulls are NaN among numbers, and text stays text.

    Durations and times of day are moments after 1970, since numbers would lose their unit.
    """
    import pyarrow
    from pyarrow import types

    kind = column.type
    if types.is_dictionary(kind):
        if _is_text(kind.value_type):
            return _texts(column)
        column = column.cast(kind.value_type)
        kind = column.type
    if types.is_duration(kind) or types.is_time(kind):
        whole = column.cast("int32") if types.is_time32(kind) else column
        column = whole.cast("int64").cast(pyarrow.timestamp(kind.unit))
        kind = column.type
    if types.is_timestamp(kind) or types.is_date(kind):
        column = column.cast("timestamp[ns]")
        return column.to_numpy().astype("datetime64[ns]")
    if types.is_boolean(kind):
        column = column.cast("int8")
    elif types.is_decimal(kind) or types.is_float16(kind) or types.is_null(kind):
        column = column.cast("float64")
    elif not (types.is_integer(kind) or types.is_floating(kind) or _is_text(kind)):
        raise source.wrong(f"holds {kind} values", "save plain numbers", f"column {name!r}")
    if column.null_count and types.is_integer(column.type):
        column = column.cast("float64", safe=False)
    return column.to_numpy()


def _is_text(kind) -> bool:
    from pyarrow import types

    return types.is_string(kind) or types.is_large_string(kind)


def _texts(column) -> np.ndarray:
    """(N,) text of a column that counts its words; None for nulls."""
    parts = [np.empty(0, dtype=object)]
    for chunk in column.chunks:
        words = np.append(chunk.dictionary.to_numpy(zero_copy_only=False), [None])
        which = chunk.indices.cast("int64").fill_null(len(words) - 1).to_numpy()
        if len(which) and which.min() < 0:
            raise IndexError("a word before the first")
        parts.append(words[which])
    return np.concatenate(parts)


def _damaged(source: Source) -> InputError:
    kind = "Parquet" if source.head.startswith(b"PAR1") else "Feather"
    return source.wrong(
        f"is a damaged {kind} file, or one that is cut off", "save or copy it again"
    )
