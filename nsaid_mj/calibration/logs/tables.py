"""A log file as channels: numbers over time, each with its own clock and row numbers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...parameters import Array
from ..findings import Finding
from . import clocks, formats
from .errors import UnreadableLog
from .mapping import Map


class Channel(NamedTuple):
    """A quantity over time.

    Attributes:
        t: (N,) times since the table's origin [s], as in the file: possibly unordered or NaN.
        values: (N,) in the file's unit; NaN where a row has none.
    """

    t: Array
    values: Array


@dataclass(frozen=True)
class Table:
    """What a log file holds.

    Attributes:
        source: name of the file.
        channels: by name, in the order of the file. Row k of a channel is the file's row k + 1:
            rows are counted from 1, without a header.
        origin: the file's own time at t = 0 [ns].
        findings: what was noticed while reading, such as a detected unit of time.
    """

    source: str
    channels: dict[str, Channel]
    origin: int
    findings: tuple[Finding, ...] = ()


def read(
    path: str | os.PathLike[str],
    time: str | None = None,
    unit: str | None = None,
    rate: float | None = None,
) -> Table:
    """Reads a log file or folder of any known format.

    Args:
        path: of the file, of a run's folder, or of a ROS 2 bag's folder.
        time: name of the time column; None to find it by its name, or because it increases.
        unit: of the time: `s`, `ms`, `us`, `ns` or `date`; None to detect it.
        rate: rows per second [Hz] of a file without times.

    Raises:
        UnreadableLog: there is no such file, it is damaged, or the time column cannot be told.
        MissingExtra: the library for its format is not installed.
    """
    file = Path(path).expanduser()
    groups, findings = [], []
    for columns in formats.read(file):
        findings += _unread(file, columns)
        groups.append(_timed(file, columns, time, unit, rate, findings))
    origin = min(clock.origin for clock, _ in groups)
    channels: dict[str, Channel] = {}
    for clock, values in groups:
        t = clock.t + (clock.origin - origin) * 1e-9
        channels |= {name: Channel(t, column) for name, column in values.items()}
    if not channels:
        remedy = "Export positions and commands as numbers, one column for each."
        raise UnreadableLog(file, "there is no column of numbers beside the time", remedy)
    return Table(file.name, channels, origin, tuple(findings))


def read_tables(
    paths: Sequence[str | os.PathLike[str]], mapping: Map | None = None
) -> tuple[Table, ...]:
    """Reads log files, and those of folders; the map may state their time column, unit or rate.

    Raises:
        UnreadableLog: a file is missing or damaged, or its time column cannot be told.
        MissingExtra: the library for a file's format is not installed.
    """
    time = (mapping or Map()).time
    files = [file for path in paths for file in formats.files(Path(path).expanduser())]
    return tuple(read(file, time.column, time.unit, time.rate) for file in files)


def _timed(
    file: Path,
    columns: formats.Columns,
    time: str | None,
    unit: str | None,
    rate: float | None,
    findings: list[Finding],
) -> tuple[clocks.Clock, dict[str, Array]]:
    """The clock of a group of columns, and its columns of numbers."""
    if columns.time is not None:
        clock = clocks.read(columns.time, "", "ns")
        assert clock is not None
        return clock, _numbers(columns.values)
    name = time if time in columns.values else clocks.time_column(columns.values)
    clock = clocks.read(columns.values[name], name, unit) if name is not None else None
    if name is None or clock is None or rate is not None:
        if rate is None:
            raise UnreadableLog(
                file,
                f"no column is the time; the columns are {', '.join(columns.values)}",
                "Name it in map.toml, as in `[time]` `column = …`, or state `rate = …` there.",
            )
        count = len(next(iter(columns.values.values())))
        return clocks.Clock(np.arange(count) / rate, 0, "s", False), _numbers(columns.values)
    if time is not None and name != time:
        text = f"there is no column {time!r}, which the map calls the time; {name!r} is used"
        findings.append(Finding("warning", "time_column", file.name, text, "Correct map.toml."))
    if clock.unit != "s":
        findings.append(_converted(file, name, clock))
    rest = {other: column for other, column in columns.values.items() if other != name}
    return clock, _numbers(rest)


def _numbers(values: dict[str, np.ndarray]) -> dict[str, Array]:
    return {
        name: column.astype(np.float64)
        for name, column in values.items()
        if column.dtype.kind in "fiu"
    }


def _converted(file: Path, name: str, clock: clocks.Clock) -> Finding:
    how = "judging by their size" if clock.guessed else "as stated"
    what = "dates" if clock.unit == "date" else f"in {clock.unit}"
    return Finding(
        "note",
        "time_unit",
        file.name,
        f"the times in column {name!r} are {what}, {how}, and were converted to seconds",
        data={"column": name, "unit": clock.unit, "guessed": clock.guessed},
    )


def _unread(file: Path, columns: formats.Columns) -> list[Finding]:
    if not columns.problems:
        return []
    rows = [row for row, _ in columns.problems]
    return [
        Finding(
            "note",
            "malformed_rows",
            file.name,
            f"{len(rows)} malformed rows were skipped, the first in row {rows[0]} "
            f"({columns.problems[0][1]})",
            data={"count": len(rows), "rows": rows[:100]},
        )
    ]
