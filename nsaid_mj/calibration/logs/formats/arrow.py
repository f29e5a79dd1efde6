"""Parquet, Arrow IPC files and streams, Feather."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from ..errors import UnreadableLog
from . import Columns

_PARQUET, _FILE, _STREAM = b"PAR1", b"ARROW1", b"\xff\xff\xff\xff"


def recognises(_path: Path, head: bytes) -> bool:
    """Whether it begins as Parquet or Arrow does."""
    return head.startswith((_PARQUET, _FILE, _STREAM))


def read(path: Path) -> list[Columns]:
    """The columns of a table; a column of lists becomes one column for each entry.

    Raises:
        UnreadableLog: it is damaged or empty.
    """
    try:
        table = _table(path)
    except (pa.ArrowException, OSError) as error:
        raise UnreadableLog(path, f"unreadable ({error})", "Write the file again.") from error
    if not table.num_rows:
        raise UnreadableLog(path, "the table has no rows", "Record the log again.")
    values: dict[str, np.ndarray] = {}
    for name in table.column_names:
        values |= flat(name, table.column(name))
    return [Columns(values)]


def _table(path: Path) -> pa.Table:
    with path.open("rb") as stream:
        head = stream.read(6)
    if head.startswith(_PARQUET):
        return pa.parquet.read_table(path)
    with pa.memory_map(str(path)) as source:
        opened = pa.ipc.open_file if head.startswith(_FILE) else pa.ipc.open_stream
        return opened(source).read_all()


def flat(name: str, column: pa.ChunkedArray, entries: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """A column by name; lists of one length become `name_0`, `name_1` …, or the given entries."""
    if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
        rows = column.to_pylist()
        widths = {len(row) for row in rows if row is not None}
        if len(widths) != 1:
            return {}
        width = widths.pop()
        dense = np.array([[np.nan] * width if row is None else row for row in rows], np.float64)
        names = entries if len(entries) == width else [f"{name}_{k}" for k in range(width)]
        return dict(zip(names, dense.T, strict=True))
    return {name: numpy_column(column)}


def numpy_column(column: pa.ChunkedArray) -> np.ndarray:
    """A column as float64 with NaN for nulls, int64, datetime64[ns] or strings.

    Text in which most fields are numbers counts as numbers; its other fields become NaN.
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
        return column.cast(pa.float64(), safe=False).to_numpy()
    if pa.types.is_boolean(kind) or pa.types.is_null(kind):
        return np.array([np.nan if x is None else float(x) for x in column.to_pylist()])
    texts = np.array([str(x) if x is not None else "" for x in column.to_pylist()], dtype=object)
    numbers = np.array([_number(text) for text in texts])
    return numbers if np.isfinite(numbers).mean() > 0.5 else texts


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan
