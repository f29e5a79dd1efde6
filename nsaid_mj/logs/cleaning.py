"""Converts a table's channels to ordered signals in SI, and reports every cleaning step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..numerics.spatial import continuous_signs
from ..parameters import Array, number
from ..robot.findings import Finding, Level
from . import signals
from .layout import Layout, Source
from .signals import Signal
from .tables import Channel, Table

SHOWN = 5
"""Row numbers stated in a message; the finding's data hold up to a hundred."""


_JITTER = 0.2  # half the spread of intervals, over their median, from which it is reported


def clean(table: Table, layout: Layout) -> tuple[dict[str, Signal], tuple[Finding, ...]]:
    """The signals of a layout's sources by the names of their columns, in SI.

    Rows without a value or out of order are dropped, angles continued across whole turns, and
    outliers of positions and velocities interpolated. Every step adds a finding.
    """
    table = _same_signs(table, layout)
    findings: list[Finding] = []
    orders: dict[int, signals.Order] = {}
    found: dict[str, Signal] = {}
    for source in layout.sources:
        name = source.column.column
        channel = table.channels[name]
        key = id(channel.t)
        if key not in orders:
            orders[key] = signals.order(channel.t)
            said = _disorder(table.source, channel, orders[key])
            findings += [finding for finding in said if finding not in findings]
        found[name] = _clean_one(table.source, source, channel, orders[key], findings)
    return found, tuple(findings)


def _same_signs(table: Table, layout: Layout) -> Table:
    """A table whose quaternions q and −q do not alternate, so that they can be interpolated."""
    names = layout.quaternion
    parts = [table.channels[name] for name in names]
    if not parts or len({len(part.values) for part in parts}) > 1:
        return table
    signs = continuous_signs(np.column_stack([part.values for part in parts]))
    turned = {
        name: Channel(part.t, part.values * signs) for name, part in zip(names, parts, strict=True)
    }
    return replace(table, channels=table.channels | turned)


def _clean_one(
    file: str, source: Source, channel: Channel, order: signals.Order, findings: list[Finding]
) -> Signal:
    where = f"{file}, {source.column.column}"
    values = channel.values[order.index] * source.factor
    present = np.isfinite(values)
    t, x, row = order.t, values, order.rows  # shared by all signals of a clock: a log may be large
    if not present.all():
        text = "rows without a number were dropped"
        findings.append(about_rows("note", "missing_values", where, row[~present], text))
        t, x, row = t[present], x[present], row[present]
    if source.angle:
        raw = np.sign(source.factor) * abs(source.column.ratio)  # a whole turn in the column's unit
        x_turns, jumps = signals.unwrap(x * raw)
        if len(jumps):
            x = x_turns / raw
            text = "jumps of a whole turn were removed"
            findings.append(about_rows("note", "wrapped_angle", where, row[jumps], text))
    bad = signals.outliers(t, x) if source.quantity != "command" else np.zeros(0, int)
    if len(bad):
        good = np.setdiff1d(np.arange(len(x)), bad)
        away = float(np.max(np.abs(x[bad] - np.interp(t[bad], t[good], x[good]))))
        x[bad] = np.interp(t[bad], t[good], x[good])
        text = f"outliers (up to {number(away, significant=3)} from their neighbours) were "
        text += "interpolated"
        findings.append(about_rows("note", "outliers", where, row[bad], text))
    last = len(t) - 1
    doubtful = np.column_stack([t[np.maximum(bad - 1, 0)], t[np.minimum(bad + 1, last)]])
    made = Signal(t, x, row, doubtful)
    if len(t) > 2:
        made = made._replace(doubtful=np.concatenate([doubtful, signals.dropouts(made)]))
    return made


def _disorder(file: str, channel: Channel, order: signals.Order) -> list[Finding]:
    """Findings about a clock: missing, repeated and late times, and resets."""
    found = []
    undated = np.flatnonzero(~np.isfinite(channel.t))
    for code, rows, text in (
        ("missing_times", undated, "rows without a time were dropped"),
        ("duplicates", order.repeated, "rows that repeat the time before were dropped"),
        ("backward_times", order.late, "rows whose time lies before an earlier one were dropped"),
        ("clock_reset", order.resets, "restarts of the clock; the log is split there"),
    ):
        if len(rows):
            level = "warning" if len(rows) > 0.2 * len(channel.t) else "note"
            found.append(about_rows(level, code, file, rows + 1, text))
    return found + _jitter(file, order.t)


def _jitter(file: str, t: Array) -> list[Finding]:
    """Whether the intervals between rows scatter."""
    if len(t) < 10:
        return []
    intervals = np.diff(t)
    period = float(np.median(intervals))
    low, high = np.quantile(intervals, [0.05, 0.95])
    if high - low < 2 * _JITTER * period:
        return []
    text = f"intervals between rows scatter from {low * 1e3:.3g} to {high * 1e3:.3g} ms (5 % to "
    text += "95 %); values are interpolated to a constant rate"
    data = {"period": period, "low": float(low), "high": float(high)}
    return [Finding("note", "jitter", file, text, data=data)]


def about_rows(
    level: Level, code: str, where: str, rows: Sequence[int] | np.ndarray, text: str
) -> Finding:
    """A finding that begins with a number of rows and ends with the first of them.

    `rows` are their numbers in the file, from 1; `text` says what happened to them, without their
    number; `where` is file and channel.
    """
    listed = [int(row) for row in rows[:100]]
    first = ", ".join(str(row) for row in listed[:SHOWN]) + (" …" if len(rows) > SHOWN else "")
    plural = "row" if len(rows) == 1 else "rows"
    data = {"count": len(rows), "rows": listed}
    return Finding(level, code, where, f"{len(rows)} {text} ({plural} {first})", data=data)
