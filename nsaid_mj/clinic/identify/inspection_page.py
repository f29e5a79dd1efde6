"""Terminal output and plot of an inspected log."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from rich.console import Console

from ...core import Array, number
from ...report import (
    BAD,
    COLOURS,
    Cell,
    Mark,
    Page,
    Result,
    Table,
    Text,
    count,
    extremes,
    gravest_first,
    png_of,
    print_findings,
    print_page,
    print_panels,
)
from ...robots import RobotModel
from ..logs.recordings import Recordings
from .inspection import ChannelFigures, Inspection, signal_names

_POINTS = 4000  # of a curve; more are thinned to the extremes of equal parts
_LISTED = 1000  # channels that are printed, those in use first
_MOST = 40  # largest number of drawn channels of a log without a map


def print_inspection(found: Inspection, console: Console) -> None:
    """Prints whether the log can be identified, a line for each channel, then the findings.

    "flat" is the share of rows at a flat extreme, "same" of those that repeat the value before; a
    column without any entry is left out.
    """
    if (result := result_of(found)).explains is not None:
        print_page(Page("", result), console)
        console.print()
    heads = ("channel", "from", "to", "noise", "step", "flat", "same", "used as")
    for clock in dict.fromkeys(map(_clock, found.channels)):
        own = [channel for channel in found.channels if _clock(channel) == clock]
        more = len(own) - _LISTED
        if more > 0:
            own.sort(key=lambda channel: not channel.role)
        lines = [_cells(channel) for channel in own[:_LISTED]]
        table = Table(heads, lines, (0, len(heads) - 1), most=len(lines)).without_empty_columns()
        rest = [Text(f"… and {more} more, which --json lists")] if more > 0 else []
        print_panels([Text(clock), table, *rest], console)
        console.print()
    print_findings(gravest_first(found.findings), console, codes=True)


def result_of(found: Inspection) -> Result:
    """Whether `nsaid identify` would take the log; without a verdict if there is no model."""
    refusals = sum(finding.level == "refusal" for finding in found.findings)
    if refusals:
        words = f"nsaid identify refuses this log: {count(refusals, 'refusal')} below."
        return Result(explains="no", verdict=words)
    if any(finding.code == "unmatched" for finding in found.findings):
        words = "Columns could not be matched with the model: complete the map."
        return Result(explains="no", verdict=words)
    if found.robot is None:
        return Result()
    return Result(explains="yes", verdict="nsaid identify can use this log.")


def _clock(channel: ChannelFigures) -> str:
    """The properties that channels of one clock share: file, rows, rate, jitter, gaps."""
    said = f"{channel.source}: {count(channel.rows, 'row')}"
    if np.isfinite(channel.rate):
        said += f" at {channel.rate:.4g} Hz, jitter {100 * channel.jitter:.0f} %"
        said += (
            f", {count(channel.gaps, 'gap')} up to {channel.longest:.3g} s" if channel.gaps else ""
        )
    return said + (f", {channel.missing} without a number" if channel.missing else "")


def _cells(channel: ChannelFigures) -> list[Cell]:
    return [
        channel.name,
        number(channel.low),
        number(channel.high),
        Mark("", "poor", "constant") if channel.dead else number(channel.noise, significant=1),
        number(channel.quantum, significant=3) if channel.quantum else "–",
        f"{100 * channel.saturated:.1f} %" if channel.saturated else "–",
        f"{100 * channel.unchanged:.0f} %" if channel.unchanged > 0.005 else "–",
        channel.role,
    ]


def draw_inspection(found: Inspection, path: Path) -> Path:
    """Draws q, v and u of every joint over time, or all channels if they are not matched, as PNG.

    Rows that are not used for a joint are marked on its velocity. Returns the path.
    """
    if found.recordings is not None and found.robot is not None:
        lines = _signals(found.recordings, found.robot)
    else:
        lines = _channels(found)
    return png_of(lines, (11.0, 1.8 * len(lines) + 0.4), path)


Line = Mapping[str, Callable[[Axes], None]]


def _signals(recordings: Recordings, robot: RobotModel) -> list[Line]:
    """A line for each joint, or for each position, velocity and command of a vehicle."""
    logs = [segment.log for segment in recordings.segments]
    starts = np.cumsum([0.0, *(log.t[-1] - log.t[0] for log in logs)])
    times = [log.t - log.t[0] + start for log, start in zip(logs, starts, strict=False)]
    names = signal_names(robot)
    own = zip(names["u"], recordings.command_units, strict=False)
    names["u"] = [(name, unit) for (name, _), unit in own] or names["u"]
    titles = ("position", "velocity (red: rows that are not used)", "command")
    lines: list[Line] = []
    for j in range(max(map(len, names.values()))):
        line: dict[str, Callable[[Axes], None]] = dict.fromkeys(titles, Axes.set_axis_off)
        for part, (title, columns) in enumerate(zip(titles, names.values(), strict=True), 1):
            if j < len(columns):
                name, unit = columns[j]
                label = f"{name} [{unit}]" if unit else name
                segments = recordings.segments if part == 2 else ()
                used = [segment.usable[:, j] for segment in segments]
                values = [log[part][:, j] for log in logs if j < log[part].shape[1]]
                line[title] = partial(_curves, times, values, label, used)
        lines.append(line)
    return lines


def _channels(found: Inspection) -> list[Line]:
    channels = [c for table in found.tables for c in table.channels.items()][:_MOST]
    lines: list[Line] = []
    for start in range(0, len(channels), 3):
        row = channels[start : start + 3]
        panels = {
            " " * k: partial(_curves, [channel.t], [channel.values], name, [])
            for k, (name, channel) in enumerate(row)
        }
        lines.append(panels | {" " * k: Axes.set_axis_off for k in range(len(row), 3)})
    return lines


def _curves(
    times: Sequence[Array],
    values: Sequence[Array],
    label: str,
    used: Sequence[np.ndarray],
    axis: Axes,
) -> None:
    """Draws one curve for each segment; rows that are not used are dots."""
    for k, (t, x) in enumerate(zip(times, values, strict=False)):
        rows = extremes(x, _POINTS)
        axis.plot(t[rows], x[rows], color=COLOURS[k % len(COLOURS)], linewidth=0.8)
        if k < len(used):
            off = np.flatnonzero(~used[k])
            off = off[extremes(x[off], _POINTS)] if len(off) else off
            axis.plot(t[off], x[off], ".", color=BAD, markersize=1.5)
    axis.margins(x=0.0)
    axis.set_ylabel(label)
    axis.set_xlabel("t [s]")
