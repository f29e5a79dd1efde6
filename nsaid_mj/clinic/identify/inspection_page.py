"""Terminal output and plot of an inspected log."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from rich.console import Console

from ...base import Finding
from ...core import Array, Log, number
from ...report import (
    BAD,
    COLOURS,
    GRID,
    Cell,
    Mark,
    Page,
    Result,
    Table,
    Text,
    count,
    extremes,
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
    """Prints whether the log can be identified and why not, every channel, then the notes.

    "flat" is the share of rows at a flat extreme, "same" of those that repeat the value before; a
    column without any entry is left out.
    """
    result = result_of(found)
    findings = Finding.gravest_first(found.findings)
    grave = tuple(finding for finding in findings if finding.level != "note")
    if result.explains is not None:
        print_page(Page("", result), console)
    print_findings(grave, console, codes=True)
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
    notes = [finding for finding in findings if finding.level == "note"]
    print_findings(notes, console, codes=True)


def result_of(found: Inspection) -> Result:
    """Whether `nsaid identify` would take the log; without a verdict if there is no model."""
    refusals = sum(finding.level == "refusal" for finding in found.findings)
    if refusals:
        words = f"nsaid identify rejects this log for {count(refusals, 'reason')}."
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

    Rows that are not used for a joint are marked on its velocity, phases that take no part in the
    fit are grey, with their kinds, and changes of a controller's mode are dotted. Returns the path.
    """
    if found.recordings is not None and found.robot is not None:
        lines = _signals(found.recordings, found.robot)
    else:
        lines = _channels(found)
    return png_of(lines, (11.0, 1.8 * len(lines) + 0.4), path)


Line = Mapping[str, Callable[[Axes], None]]


class _Part(NamedTuple):
    """A segment, or a phase that is left out, on the axis of all logs."""

    log: Log
    start: float  # of its first sample on that axis [s]
    usable: np.ndarray | None  # (N, n) rows that a fit may use; None of a phase that is left out
    kind: str = ""  # of such a phase


def _parts(recordings: Recordings) -> list[_Part]:
    """The phases of all logs, one after another: used ones as their segments."""
    found = []
    start = 0.0
    for phase in recordings.phases:
        first, last = phase.log.t[[0, -1]].tolist()
        if not phase.used:
            found.append(_Part(phase.log, start, None, phase.kind))
        for segment in recordings.segments if phase.used else ():
            begin = float(segment.log.t[0])
            if segment.source == phase.source and first <= begin <= last:
                found.append(_Part(segment.log, start + begin - first, segment.usable))
        start += last - first
    return found


def _modes(recordings: Recordings) -> list[tuple[float, str]]:
    """Where each mode of a controller begins on the axis of all logs [s], and its name."""
    found: list[tuple[float, str]] = []
    start = 0.0
    for phase in recordings.phases:
        first, last = phase.log.t[[0, -1]].tolist()
        for mode in phase.own_modes:
            if not found or found[-1][1] != mode.name:
                found.append((start + mode.start - first, mode.name))
        start += last - first
    return found


def _signals(recordings: Recordings, robot: RobotModel) -> list[Line]:
    """A line for each joint, or for each position, velocity and command of a vehicle."""
    parts = _parts(recordings)
    modes = _modes(recordings)
    names = signal_names(robot)
    own = zip(names["u"], recordings.command_units, strict=False)
    names["u"] = [(name, unit) for (name, _), unit in own] or names["u"]
    titles = ("position", "velocity (red: rows that are not used)", "command")
    lines: list[Line] = []
    for j in range(max(map(len, names.values()))):
        line: dict[str, Callable[[Axes], None]] = dict.fromkeys(titles, Axes.set_axis_off)
        for place, (title, columns) in enumerate(zip(titles, names.values(), strict=True), 1):
            if j < len(columns):
                name, unit = columns[j]
                label = f"{name} [{unit}]" if unit else name
                line[title] = partial(_phases, parts, modes, place, j, label)
        lines.append(line)
    return lines


def _channels(found: Inspection) -> list[Line]:
    channels = [c for table in found.tables for c in table.channels.items()][:_MOST]
    lines: list[Line] = []
    for start in range(0, len(channels), 3):
        row = channels[start : start + 3]
        panels = {
            " " * k: partial(_curve, channel.t, channel.values, name)
            for k, (name, channel) in enumerate(row)
        }
        lines.append(panels | {" " * k: Axes.set_axis_off for k in range(len(row), 3)})
    return lines


def _phases(
    parts: Sequence[_Part],
    modes: Sequence[tuple[float, str]],
    place: int,
    j: int,
    label: str,
    axis: Axes,
) -> None:
    """Draws column j of the q, v or u (`place` 1, 2 or 3) of all parts; those left out are grey.

    `modes` are the times at which a controller's modes begin, and their names.
    """
    used = 0
    for part in parts:
        t = part.log.t - part.log.t[0] + part.start
        x = part.log[place][:, j]
        rows = extremes(x, _POINTS)
        left_out = part.usable is None
        colour = COLOURS[8] if left_out else COLOURS[used % len(COLOURS)]
        used += not left_out
        axis.plot(t[rows], x[rows], color=colour, linewidth=0.8)
        if part.usable is not None and place == 2:
            off = np.flatnonzero(~part.usable[:, j])
            off = off[extremes(x[off], _POINTS)] if len(off) else off
            axis.plot(t[off], x[off], ".", color=BAD, markersize=1.5)
        if left_out:
            axis.axvspan(t[0], t[-1], color=GRID, zorder=0)
            top = axis.get_xaxis_transform()
            axis.text(t[0], 0.97, f" {part.kind}", fontsize=6, va="top", transform=top)
    for time, name in modes:
        axis.axvline(time, color=COLOURS[8], linestyle=":", linewidth=0.8)
        bottom = axis.get_xaxis_transform()
        axis.text(time, 0.03, f" {name}", fontsize=6, va="bottom", clip_on=True, transform=bottom)
    axis.margins(x=0.0)
    axis.set_ylabel(label)
    axis.set_xlabel("t [s]")


def _curve(t: Array, x: Array, label: str, axis: Axes) -> None:
    """Draws one curve."""
    rows = extremes(x, _POINTS)
    axis.plot(t[rows], x[rows], color=COLOURS[0], linewidth=0.8)
    axis.margins(x=0.0)
    axis.set_ylabel(label)
    axis.set_xlabel("t [s]")
