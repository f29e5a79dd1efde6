"""Recordings of Rerun (.rrd): the scalars of every entity, through `rerun-sdk`."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..unusable import UnreadableLog
from . import Columns

_VALUES = "Scalars:scalars"
_NAMES = "SeriesLines:names"
_LOGGED = "log_time"  # Rerun's own timeline, used where the recording has no other times


def read(path: Path) -> list[Columns]:
    """One group of columns for each entity, called by its path, or `PATH/SERIES` if several series.

    Times are those of the recording's first timeline of times or durations, or of Rerun's
    `log_time` if there is no other.

    Raises:
        UnreadableLog: the file has no scalars over time.
    """
    from rerun.chunk import RrdReader

    parts: dict[str, list[pa.RecordBatch]] = defaultdict(list)
    names: dict[str, list[str]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        entity = chunk.entity_path.replace("\\", "").strip("/")
        if _NAMES in batch.schema.names:
            names[entity] = batch.column(_NAMES).to_pylist()[-1] or []
        if _VALUES in batch.schema.names and not chunk.is_static:
            parts[entity].append(batch)
    timeline = _timeline([batch for batches in parts.values() for batch in batches])
    found = [_columns(entity, p, names.get(entity, []), timeline) for entity, p in parts.items()]
    found = [columns for columns in found if columns is not None]
    if not found:
        remedy = "Log positions and commands as `rerun.Scalars` on a timeline of times."
        raise UnreadableLog(path, "the recording has no scalars over time", remedy)
    return found


def _timeline(batches: list[pa.RecordBatch]) -> str:
    """The timeline by which the most batches have times."""
    count: dict[str, int] = defaultdict(int)
    for batch in batches:
        for field in batch.schema:
            if pa.types.is_duration(field.type) or pa.types.is_timestamp(field.type):
                count[field.name] += 1
    own = {name: number for name, number in count.items() if name != _LOGGED} or count
    return max(own, key=lambda name: own[name], default=_LOGGED)


def _columns(
    entity: str, batches: list[pa.RecordBatch], names: list[str], timeline: str
) -> Columns | None:
    """An entity's series, for the number of values of most rows; None without times."""
    times: list[int] = []
    rows: list[list[float]] = []
    for batch in batches:
        if timeline in batch.schema.names:
            times += batch.column(timeline).cast(pa.int64()).to_pylist()
            rows += batch.column(_VALUES).to_pylist()
    widths = [len(row or ()) for row in rows]
    width = max(set(widths), key=widths.count, default=0)
    keep = [k for k, own in enumerate(widths) if own == width and times[k] is not None]
    if not width or not keep:
        return None
    time = np.array(times)[keep]
    values = np.array([rows[k] for k in keep], np.float64)
    order: Any = np.argsort(time, kind="stable")  # chunks are compacted in any order
    if len(names) != width:
        names = [str(k) for k in range(width)]
    series = [entity] if width == 1 else [f"{entity}/{name}" for name in names]
    return Columns(dict(zip(series, values[order].T, strict=True)), time[order])
