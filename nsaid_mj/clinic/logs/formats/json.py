"""JSON: a list of records, records one a line, or a table of columns."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size

_DEEPEST = 8  # objects in objects
_MOST = 256  # entries of a list in a record


def read(path: Path) -> list[Columns]:
    """Columns by name: `a/b` of an object in an object, `a_0`, `a_1` … of a list in a record.

    An object of objects of columns has one group of columns for each length.

    Raises:
        UnreadableLog: it is beyond the limit, or has no records and no columns.
    """
    check_size(path, 4 * path.stat().st_size)
    text = path.read_text(encoding="utf-8-sig")
    try:
        content = json.loads(text)
    except json.JSONDecodeError:
        lines = text.splitlines()
        try:
            content = [json.loads(line) for line in lines if line.strip()]
        except json.JSONDecodeError as error:
            remedy = "Export it again, complete, or as CSV."
            raise UnreadableLog(path, f"it is no JSON: {error}", remedy) from error
    records = _records(content)
    if records is not None:
        return [_of_records(path, records)]
    from .npz import grouped

    return grouped(path, dict(_columns("", content)))


def _records(content: Any, depth: int = 0) -> Sequence[Mapping[str, Any]] | None:
    """The list of records in a document: the document itself, or its only long entry."""
    if isinstance(content, list):
        return content if content and all(isinstance(row, dict) for row in content) else None
    if not isinstance(content, dict) or depth > 2:
        return None
    found = [own for own in map(lambda x: _records(x, depth + 1), content.values()) if own]
    return max(found, key=len) if found else None


def _of_records(path: Path, records: Sequence[Mapping[str, Any]]) -> Columns:
    """The columns of records; NaN where one lacks a number."""
    rows = [dict(_entries("", record)) for record in records]
    names = dict.fromkeys(name for row in rows for name in row)
    check_size(path, 8 * len(rows) * len(names))
    values = {}
    dropped = []
    for name in names:
        own = [row.get(name) for row in rows]
        if any(isinstance(x, str) for x in own):
            values[name] = np.array([x if isinstance(x, str) else "" for x in own], dtype=object)
        else:
            values[name] = np.array([np.nan if x is None else x for x in own], dtype=np.float64)
    if not any(column.dtype.kind == "f" for column in values.values()):
        remedy = 'Write numbers, such as [{"t": 0.0, "q_1": 0.1}, …].'
        raise UnreadableLog(path, "its records have no numbers", remedy)
    return Columns(values, dropped=tuple(dropped))


def _entries(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, float | str | None]]:
    """The numbers and texts of a record by name."""
    if isinstance(value, dict) and depth < _DEEPEST:
        for key, inner in value.items():
            yield from _entries(f"{name}/{key}" if name else key, inner, depth + 1)
    elif isinstance(value, list) and len(value) <= _MOST and depth < _DEEPEST:
        for k, inner in enumerate(value):
            yield from _entries(f"{name}_{k}", inner, depth + 1)
    elif value is None or isinstance(value, int | float | str):
        yield name, value


def _columns(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, np.ndarray | None]]:
    """The columns of an object of columns by name; None for what is none."""
    if isinstance(value, dict) and depth < _DEEPEST:
        for key, inner in value.items():
            yield from _columns(f"{name}/{key}" if name else key, inner, depth + 1)
        return
    try:
        array = np.array(value)
        if array.dtype == object and isinstance(value, list):  # null for a missing number
            array = np.array([np.nan if x is None else x for x in value], dtype=np.float64)
    except (TypeError, ValueError):
        array = None
    yield name, None if array is None or array.dtype == object or array.ndim == 0 else array
