"""Log files as channels, numbers over time with their own clocks, and as parts of one log."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...base import Finding, InvalidInput, path_of, printable
from ...core import Array
from . import clocks, formats
from .mapping import File, Map, Time
from .unusable import UnreadableLog

_FOUND = Time()
_FEW = 0.01  # share of rows with problems from which they are a warning
_SHOWN = 6  # columns named in a message
_AWAY = 5.0  # least distance of a missing value from all others, over their range
# an extreme that far away marks missing values if it is a number commonly used for this
_SENTINEL = re.compile(r"-?(?:999+(?:\.9+)?|32768|32767|65535|2147483648|2147483647|1e\+?[1-9]\d+)")


class Channel(NamedTuple):
    """A quantity over time."""

    t: Array  # (N,) times since the table's origin [s], as in the file: possibly unordered or NaN
    values: Array  # (N,) in the file's unit; NaN where a row has none


@dataclass(frozen=True)
class LogTable:
    """The content of a log file, or of several that are parts of one log."""

    source: str  # name of the file, or of the files
    # by name, in the order of the file. Row k of a channel is the file's row k + 1: rows are
    # counted from 1, without a header
    channels: dict[str, Channel]
    origin: int  # the file's own time at t = 0 [ns]
    findings: tuple[Finding, ...] = ()  # about the reading, such as a detected unit of time


def channel_names(tables: Sequence[LogTable]) -> list[str]:
    """The names of all channels, each once."""
    return list(dict.fromkeys(name for table in tables for name in table.channels))


def listed(names: Iterable[str]) -> str:
    """Names of columns for a message: the first thirty, and how many there are."""
    every = list(names)
    return ", ".join(every[:30]) + (f" … ({len(every)} in all)" if len(every) > 30 else "")


def values_of(name: str, tables: Sequence[LogTable]) -> Array:
    """All finite values of a channel."""
    found = [table.channels[name].values for table in tables if name in table.channels]
    values = np.concatenate([np.zeros(0), *found])
    return values[np.isfinite(values)]


def read(path: str | os.PathLike[str], time: Time = _FOUND) -> LogTable:
    """Reads a log file, or the folder of a run or of a ROS 2 bag, of any known format.

    The time column is that of `time`, or found by its name, or because it increases.

    Raises:
        UnreadableLog: there is no such file, it is damaged or too large, or its time column is
            ambiguous.
        MissingExtra: the library for its format is not installed.
    """
    file = path_of(path)
    findings: list[Finding] = []
    groups = []
    dropped = []
    for columns in formats.read(file):
        findings += _unread(file, columns)
        clock, rest = _timed(file, columns, time, findings)
        clock = clock.scaled(time.scale or 1.0)
        groups.append((clock, _numbers(file, rest, findings)))
        dropped += columns.dropped
        for name, column in rest.items():
            if column.dtype.kind not in "fiu":
                texts = column.dtype.kind in "OU"
                what = f"text such as {str(column[0])[:20]!r}" if texts else "dates"
                dropped.append((name, what))
    if dropped:
        total = len(dropped) + sum(len(numbers) for _, numbers in groups)
        what = "; ".join(f"{name} ({why})" for name, why in dropped[:_SHOWN])
        what += f"; and {len(dropped) - _SHOWN} more" if len(dropped) > _SHOWN else ""
        text = f"left out {len(dropped)} of {total} channels: {printable(what)}"
        data = {"columns": dict(dropped)}
        findings.append(Finding("note", "left_out", file.name, text, data=data))
    origin = min(clock.origin for clock, _ in groups)
    channels: dict[str, Channel] = {}
    for clock, numbers in groups:
        t = clock.t + (clock.origin - origin) * 1e-9
        channels |= {name: Channel(t, column) for name, column in numbers.items()}
    if not channels:
        remedy = "Export positions and commands as numbers, one column for each."
        raise UnreadableLog(file, "there is no column of numbers beside the time", remedy)
    return LogTable(printable(file.name), channels, origin, tuple(findings))


def read_tables(
    paths: Sequence[str | os.PathLike[str]], mapping: Map | None = None
) -> tuple[LogTable, ...]:
    """Reads log files, and those of folders; the map may state their time column, unit or rate.

    Raises:
        UnreadableLog: a file is missing or damaged, or its time column is ambiguous.
        MissingExtra: the library for a file's format is not installed.
    """
    files = [file for path in paths for file in formats.files(path_of(path))]
    return tuple(read(file, (mapping or Map()).time) for file in files)


def _timed(
    file: Path, columns: formats.Columns, stated: Time, findings: list[Finding]
) -> tuple[clocks.Clock, dict[str, np.ndarray]]:
    """The clock of a group of columns, and its other columns."""
    if columns.time is not None:
        clock = clocks.read(columns.time, "", "ns")
        assert clock is not None
        return clock, columns.values
    time = stated.column
    rate = stated.rate
    values = columns.values if time in columns.values else clocks.with_whole_stamps(columns.values)
    name = time if time in values else clocks.time_column(values)
    clock = clocks.read(values[name], name, stated.unit) if name is not None else None
    if name is None or clock is None or rate is not None:
        if rate is None:
            raise UnreadableLog(
                file,
                f"no column looks like the time; the columns are {listed(values)}",
                "Name it in map.toml, as in `[time]` `column = …`, or state `rate = …` there.",
            )
        count = len(next(iter(values.values())))
        return clocks.Clock(np.arange(count) / rate, 0, "s", False), values
    if time is not None and name != time:
        text = f"there is no column {time!r}, the time of the map; {name!r} is used instead"
        findings.append(Finding("warning", "time_column", file.name, text, "Correct map.toml."))
    if clock.unit != "s":
        how = "judging by their size" if clock.guessed else "as stated"
        what = "dates" if clock.unit == "date" else f"in {clock.unit}"
        text = f"the times in column {name!r} are {what}, {how}, and were converted to seconds"
        data = {"column": name, "unit": clock.unit, "guessed": clock.guessed}
        findings.append(Finding("note", "time_unit", file.name, text, data=data))
    rest = {other: column for other, column in values.items() if other != name}
    return clock, rest


def _numbers(
    file: Path, values: dict[str, np.ndarray], findings: list[Finding]
) -> dict[str, Array]:
    """The columns of numbers, with NaN for a number that marks a missing one, such as −9999."""
    found = {
        name: np.require(column, np.float64, "W")
        for name, column in values.items()
        if column.dtype.kind in "fiu"
    }
    for name, column in found.items():
        finite = column[np.isfinite(column)]
        for extreme in (finite.min(), finite.max()) if len(finite) else ():
            if not _SENTINEL.fullmatch(f"{extreme:.17g}"):
                continue
            others = finite[finite != extreme]
            if len(others) < 2 or np.abs(others - extreme).min() <= _AWAY * np.ptp(others):
                continue
            rows = np.flatnonzero(column == extreme)
            column[rows] = np.nan
            text = f"{len(rows)} rows hold {extreme:g}, far from all others; it was read as missing"
            data = {"value": float(extreme), "count": len(rows), "rows": (rows[:100] + 1).tolist()}
            where = f"{file.name}, {name}"
            findings.append(Finding("warning", "sentinel", where, text, data=data))
            break
    return found


def _unread(file: Path, columns: formats.Columns) -> list[Finding]:
    """Reports the rows of a table that were skipped, or not read literally."""
    found = []
    total = columns.skipped + (len(next(iter(columns.values.values()))) if columns.values else 0)
    for code, how in (("malformed_rows", "skipped"), ("stray_quotes", "ignored stray quotes in")):
        stray = code == "stray_quotes"
        problems = [p for p in columns.problems if (p[1] == formats.STRAY) is stray]
        if not problems:
            continue
        level = "warning" if len(problems) > _FEW * total else "note"
        text = f"{how} {len(problems)} of {total} rows; the first is row {problems[0][0]}"
        text += "" if stray else f" ({problems[0][1]})"
        data = {"count": len(problems), "rows": [row for row, _ in problems[:100]]}
        found.append(Finding(level, code, file.name, text, data={**data, "of": total}))
    return found


def join(
    tables: Sequence[LogTable], mapping: Map, wanted: Sequence[str]
) -> tuple[list[LogTable], list[Finding]]:
    """The logs in tables: one for each table with all `wanted` channels, one merged from the rest.

    `mapping` has the offsets of the files' clocks.

    Raises:
        InvalidInput: files that belong together have no time in common.
    """
    whole = [t for t in tables if set(wanted) <= set(t.channels)]
    parts = [t for t in tables if t not in whole and set(wanted) & set(t.channels)]
    found = [replace(table, channels=_shifted(table, mapping)) for table in whole]
    unused = "no channel of this file is used", "Map its columns or leave it out."
    others = [table.source for table in tables if not set(wanted) & set(table.channels)]
    findings = [Finding("warning", "unused_file", source, *unused) for source in others]
    held = {name for table in parts for name in table.channels}
    if whole and (lacking := [name for name in wanted if name not in held]):
        text = f"the file has no channel {lacking[0]}, which other files have beside those of the "
        text += "same names: it was left out"
        remedy = "If it holds something else, such as targets, name its columns in map.toml as "
        for table in parts:
            own = next(name for name in wanted if name in table.channels)
            stem = table.source.partition(".")[0]
            told = f'{remedy}`{{ column = "{stem}/{own}" }}`.'
            findings.append(Finding("warning", "unused_file", table.source, text, told))
        parts = []
    if parts:
        joined = _joined(parts, mapping, wanted)
        found.append(joined)
        text = f"{joined.source} are parts of one log and were merged on one clock"
        findings.append(Finding("note", "joined", "", text))
    return found, findings


def told_apart(tables: Sequence[LogTable]) -> list[LogTable]:
    """Tables whose columns of equal names in several files are called `FILE/COLUMN`.

    FILE is the name of the file without its ending.
    """
    names = [name for table in tables for name in table.channels]
    several = {name for name in names if names.count(name) > 1}
    found = []
    for table in tables:
        stem = table.source.partition(".")[0]
        channels = {f"{stem}/{n}" if n in several else n: c for n, c in table.channels.items()}
        found.append(replace(table, channels=channels))
    return found


def _shifted(table: LogTable, mapping: Map, shift: float = 0.0) -> dict[str, Channel]:
    """A table's channels, later by its offset in the map and by `shift` [s]."""
    own = mapping.files.get(table.source, File())
    shift += own.offset
    if not shift and own.scale == 1:
        return table.channels
    times = {id(c.t): own.scale * c.t + shift for c in table.channels.values()}
    return {name: Channel(times[id(c.t)], c.values) for name, c in table.channels.items()}


def _joined(parts: Sequence[LogTable], mapping: Map, wanted: Sequence[str]) -> LogTable:
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
    return LogTable(names, channels, origin)
