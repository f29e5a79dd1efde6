"""The page of an inspected log."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...core import Array, Log, number
from ...report import (
    Cell,
    Figures,
    Items,
    Mark,
    Page,
    Panel,
    Result,
    Section,
    Table,
    Text,
    count,
    figures_of,
)
from ...robots import RobotModel
from ..logs.recordings import Recordings
from .inspection import ChannelFigures, Inspection, signal_names

_LISTED = 1000  # channels that are printed, those in use first
_MOST = 40  # largest number of drawn channels of a log without a map


def _tables(found: Inspection) -> list[Section]:
    """A table of the channels of each clock, below what they share.

    "flat" is the share of rows at a flat extreme, "same" of those that repeat the value before; a
    column without any entry is left out.
    """
    heads = ("channel", "from", "to", "noise", "step", "flat", "same", "used as")
    sections = []
    for clock in dict.fromkeys(map(_clock, found.channels)):
        own = [channel for channel in found.channels if _clock(channel) == clock]
        more = len(own) - _LISTED
        if more > 0:
            own.sort(key=lambda channel: not channel.role)
        lines = [_cells(channel) for channel in own[:_LISTED]]
        table = Table(heads, lines, (0, len(heads) - 1), most=len(lines)).without_empty_columns()
        rest = [Text(f"… and {more} more, which --json lists")] if more > 0 else []
        sections.append(Section("", [Text(clock), table, *rest], brief=True))
    return sections


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


def inspection_page(found: Inspection) -> Page:
    """The page of an inspected log: findings, signals over time, and all channels.

    The signals are q, v and u of every joint, or all channels if they are not matched. What a fit
    does not use of them is shaded; changes of a controller's mode are vertical lines.
    """
    if found.recordings is not None and found.robot is not None:
        sections = _signals(found.recordings, found.robot)
    else:
        sections = [Section("Channels over time", [Figures(figures_of(_channels(found)))])]
    files = list(dict.fromkeys(table.source for table in found.tables))
    more = len(files) - 1
    result = replace(result_of(found), findings=found.findings)
    return Page(
        heading=f"{', '.join(files[:1])}{f' and {more} more' if more > 0 else ''}",
        result=result,
        eyebrow="inspected log",
        lead="" if result.explains else count(len(found.channels), "channel"),
        sections=[*sections, *_tables(found)],
        detailed=True,
    )


class _Part(NamedTuple):
    """A segment, or a phase that is left out, on the axis of all logs."""

    log: Log
    start: float  # of its first sample on that axis [s]
    usable: np.ndarray | None  # (N, n) rows that a fit may use; None of a phase that is left out
    kind: str = ""  # of such a phase

    @property
    def t(self) -> Array:
        """(N,) its times on the axis of all logs [s]."""
        return self.log.t - self.log.t[0] + self.start


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


def _signals(recordings: Recordings, robot: RobotModel) -> list[Section]:
    """Positions, velocities and commands over time, and which phases are left out."""
    parts = _parts(recordings)
    modes = _modes(recordings)
    names = signal_names(robot)
    own = zip(names["u"], recordings.command_units, strict=False)
    names["u"] = [(name, unit) for (name, _), unit in own] or names["u"]
    kinds = {"Positions": "position", "Velocities": "velocity", "Commands": "command"}
    sections = []
    for place, (title, columns) in enumerate(zip(kinds, names.values(), strict=True), 1):
        panels = _panels(parts, place, kinds[title], columns)
        for panel in panels:
            panel.events = [time for time, _ in modes]
            panel.event_name = "mode"
        if panels:
            sections.append(Section(title, [Figures(figures_of(panels), title.lower())]))
    left_out = [
        f"{part.kind}: {part.t[0]:.4g} to {part.t[-1]:.4g} s" for part in parts if part.kind
    ]
    if left_out:
        sections.append(Section("Phases that are not used", [Items(left_out)]))
    if modes:
        begun = [f"{name} from {time:.4g} s" for time, name in modes]
        sections.append(Section("Modes of the controller", [Items(begun)]))
    return sections


def _panels(
    parts: Sequence[_Part], place: int, kind: str, columns: Sequence[tuple[str, str]]
) -> list[Panel]:
    """A panel for each column of the q, v or u (`place` 1, 2 or 3) of a kind, with all parts."""
    found = []
    for j, (name, unit) in enumerate(columns):
        panel = Panel(name, f"{name} [{unit}]" if unit else name)
        shaded: list[tuple[float, float]] = []
        for part in parts:
            t = part.t
            left_out = part.usable is None
            values = part.log[place][:, j]
            panel.add(t, values, "" if left_out else kind, place=8 if left_out else 0)
            if part.usable is None:
                shaded.append((float(t[0]), float(t[-1])))
            elif place == 2:
                shaded += _spans(t, ~part.usable[:, j])
        panel.unused = shaded
        found.append(panel)
    return found


def _spans(t: Array, chosen: np.ndarray) -> list[tuple[float, float]]:
    """First and last times of every stretch of chosen rows, which reach half-way to the others."""
    middle = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    return [(float(middle[a]), float(middle[b])) for a, b in edges.reshape(-1, 2)]


def _channels(found: Inspection) -> list[Panel]:
    """The first channels of the files over time."""
    panels = []
    for name, channel in [c for table in found.tables for c in table.channels.items()][:_MOST]:
        panel = Panel(name, name)
        panel.add(channel.t, channel.values, "value")
        panels.append(panel)
    return panels
