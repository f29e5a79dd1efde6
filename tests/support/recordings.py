"""Rerun recordings read back."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pyarrow as pa
from rerun.chunk import RrdReader


@cache
def entities_of(file: Path) -> dict[str, dict[str, list]]:
    """Column name to values, by entity, over all of a recording's chunks.

    Mesh vertices are large and have one None in place of their values; `log_time` is left out,
    since its nanoseconds since 1970 do not fit a `datetime`.
    """
    entities: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(file).stream():
        columns = entities.setdefault(str(chunk.entity_path), {})
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.startswith("Mesh3D:vertex_"):
                columns[name] = [None]
            elif name != "log_time":
                column = batch.column(name)
                if pa.types.is_duration(column.type):  # `timedelta` has no nanoseconds
                    column = column.cast(pa.duration("us"), safe=False)
                columns.setdefault(name, []).extend(column.to_pylist())
    return entities
