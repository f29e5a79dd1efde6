"""Sorts tables into separate logs, and parts of one log on one clock."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import InvalidInput
from ..findings import Finding
from .cleaning import Recording
from .mapping import Map
from .tables import Channel, Table


def join(
    tables: Sequence[Table], mapping: Map, wanted: Sequence[str]
) -> tuple[list[Recording], list[Finding]]:
    """The recordings of tables: one for each table with all `wanted` channels, one for the rest.

    `mapping` has the offsets of the files' clocks.

    Raises:
        InvalidInput: files that belong together have no time in common.
    """
    whole = [t for t in tables if set(wanted) <= set(t.channels)]
    parts = [t for t in tables if t not in whole and set(wanted) & set(t.channels)]
    found = [Recording(table.source, _shifted(table, mapping)) for table in whole]
    findings = [_unused(t) for t in tables if not set(wanted) & set(t.channels)]
    if parts:
        joined = _joined(parts, mapping, wanted)
        found.append(joined)
        text = f"{joined.source} are parts of one log and were merged on one clock"
        findings.append(Finding("note", "joined", "", text))
    return found, findings


def _shifted(table: Table, mapping: Map, shift: float = 0.0) -> dict[str, Channel]:
    """A table's channels, later by its offset in the map and by `shift` [s]."""
    shift += mapping.files[table.source].offset if table.source in mapping.files else 0.0
    if not shift:
        return table.channels
    times = {id(c.t): c.t + shift for c in table.channels.values()}
    return {name: Channel(times[id(c.t)], c.values) for name, c in table.channels.items()}


def _joined(parts: Sequence[Table], mapping: Map, wanted: Sequence[str]) -> Recording:
    """The channels of several tables on the clock of the first."""
    origin = parts[0].origin
    channels: dict[str, Channel] = {}
    ranges = []
    for table in parts:
        mine = _shifted(table, mapping, (table.origin - origin) * 1e-9)
        used = [mine[name].t for name in wanted if name in mine]
        ranges.append((min(np.nanmin(t) for t in used), max(np.nanmax(t) for t in used)))
        for name, channel in mine.items():
            if name in channels and name in wanted:
                both = zip(channels[name], channel, strict=True)
                channels[name] = Channel(*(np.concatenate(pair) for pair in both))
            else:
                channels[name] = channel
    missing = [name for name in wanted if name not in channels]
    names = ", ".join(table.source for table in parts)
    if missing:
        remedy = "Give all files of a log."
        raise InvalidInput(names, f"the channel {missing[0]}", "none of this name", remedy)
    if max(a for a, _ in ranges) >= min(b for _, b in ranges) and len(channels) == len(
        {n for t in parts for n in t.channels}
    ):
        each = "; ".join(
            f"{t.source} {a:.6g} to {b:.6g} s" for t, (a, b) in zip(parts, ranges, strict=True)
        )
        remedy = "Put them on one clock by an offset in map.toml, as in "
        remedy += f'`[files."{parts[1].source}"]` `offset = {ranges[0][0] - ranges[1][0]:.6g}`.'
        raise InvalidInput(names, "files with a time in common", each, remedy)
    return Recording(names, channels)


def _unused(table: Table) -> Finding:
    text = "no channel of this file is used"
    return Finding("warning", "unused_file", table.source, text, "Map its columns or leave it out.")
