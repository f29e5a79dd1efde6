"""Parquet, Arrow IPC files and streams, Feather."""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from ..unusable import UnreadableLog
from . import Columns, check_size

_PARQUET = b"PAR1"  # first bytes of files that are no streams
_FILE = b"ARROW1"


def read(path: Path) -> list[Columns]:
    """The columns of a table; a column of lists becomes one column for each entry.

    Raises:
        UnreadableLog: it is empty or beyond the limit.
    """
    table = table_of(path)
    if not table.num_rows:
        raise UnreadableLog(path, "the table has no rows", "Record the log again.")
    values = {}
    dropped = []
    names = table.column_names
    left = table.columns[::-1]
    del table
    for name in names:
        found = flat(name, left.pop())  # frees what has been converted
        values |= found
        if not found:
            dropped.append((name, "lists of differing lengths, or not of numbers"))
    pa.default_memory_pool().release_unused()
    return [Columns(values, dropped=tuple(dropped))]


def table_of(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """The table of a file, read batch by batch; of a Parquet file only `columns`, unless None.

    Raises:
        UnreadableLog: it is beyond the limit.
    """
    batches = []
    size = 0
    for batch in _batches(path, columns):
        size += batch.nbytes
        check_size(path, size)
        batches.append(batch)
    return pa.Table.from_batches(batches) if batches else pa.table({})


def _batches(path: Path, columns: Sequence[str] | None) -> Iterator[pa.RecordBatch]:
    """The record batches of a file, one after the other."""
    with path.open("rb") as stream:
        head = stream.read(6)
    if head.startswith(_PARQUET):
        with pa.parquet.ParquetFile(path) as file:
            about = file.metadata
            groups = map(about.row_group, range(about.num_row_groups))
            chunks = [g.column(k) for g in groups for k in range(about.num_columns)]
            check_size(path, sum(8 * chunk.num_values for chunk in chunks))
            yield from file.iter_batches(columns=columns, use_threads=False)
        return
    with pa.OSFile(os.fsencode(path)) as source:
        if head.startswith(_FILE):
            file = pa.ipc.open_file(source)
            yield from map(file.get_batch, range(file.num_record_batches))
        else:
            yield from pa.ipc.open_stream(source)


def flat(name: str, column: pa.ChunkedArray, entries: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """A column by name; lists of one length become `name_0`, `name_1` …, or the given entries."""
    if not (pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type)):
        return {name: numpy_column(column)}
    rows = column.to_pylist()
    widths = {len(row) for row in rows if row is not None}
    inner = column.type.value_type
    if len(widths) != 1 or not (pa.types.is_floating(inner) or pa.types.is_integer(inner)):
        return {}
    width = widths.pop()
    dense = np.array([[np.nan] * width if row is None else row for row in rows], np.float64)
    names = entries if len(entries) == width else [f"{name}_{k}" for k in range(width)]
    return dict(zip(names, dense.T, strict=True))


def numpy_column(column: pa.ChunkedArray, decimal: str = ".") -> np.ndarray:
    """A column as float64 with NaN for nulls, int64, datetime64[ns] or strings.

    Text in which most fields are numbers counts as numbers; its other fields become NaN. `decimal`
    is the mark of numbers in text, "." or ","; the other one groups thousands.
    """
    kind = column.type
    if pa.types.is_timestamp(kind):
        return column.cast(pa.timestamp("ns")).to_numpy()
    if pa.types.is_time(kind):
        whole = column.cast(pa.time64("ns")).cast(pa.int64())
        return whole.to_numpy().astype("datetime64[ns]")
    if pa.types.is_date(kind):
        return column.cast(pa.timestamp("ns")).to_numpy()
    if pa.types.is_duration(kind):
        return column.cast(pa.duration("ns")).cast(pa.int64()).to_numpy()
    if pa.types.is_integer(kind) and not column.null_count:
        return column.to_numpy().astype(np.int64)
    if pa.types.is_floating(kind) or pa.types.is_integer(kind):
        own = column.cast(pa.float64(), safe=False).to_numpy()
        return own.copy()  # Arrow's pool would keep the memory once the log is cleaned
    if pa.types.is_boolean(kind) or pa.types.is_null(kind):
        return np.array([np.nan if x is None else float(x) for x in column.to_pylist()])
    texts = np.array([str(x) if x is not None else "" for x in column.to_pylist()], dtype=object)
    numbers = np.array([_number(text, decimal) for text in texts])
    return numbers if np.isfinite(numbers).mean() > 0.5 else texts


def _number(text: str, decimal: str) -> float:
    other = "," if decimal == "." else "."
    if other in text:
        if not re.fullmatch(rf"[+-]?\d{{1,3}}(\{other}\d{{3}})+(\{decimal}\d*)?", text.strip()):
            return np.nan
        text = text.replace(other, "")
    try:
        return np.nan if "_" in text else float(text.replace(decimal, "."))
    except ValueError:
        return np.nan
