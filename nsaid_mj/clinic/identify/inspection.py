"""Inspects a log: figures of every channel, and findings about the log as a whole."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base import Finding
from ...robots import RobotModel
from ..logs import signals
from ..logs.checks import checks
from ..logs.layout import Layout, apart, layout, with_angles
from ..logs.mapping import Map
from ..logs.preparation import prepare
from ..logs.recordings import Recordings
from ..logs.tables import Channel, LogTable
from ..logs.unnamed import unnamed, unnamed_in_words
from ..logs.unusable import UnmatchedChannels, UnusableLog

_ALONE = Finding(
    "note",
    "rotation_alone",
    "",
    "neither position nor linear velocity is given: `nsaid identify` fits roll, pitch and yaw, and "
    "surge, sway and heave as far as depth or acceleration measure them",
)


@dataclass(frozen=True)
class ChannelFigures:
    """Figures of one channel, in the unit of its file."""

    source: str  # name of the file
    name: str  # name of the channel
    role: str  # such as "q of elbow"; "" if unused
    rows: int  # with a number
    missing: int  # rows without one
    rate: float = np.nan  # median rows per second [Hz]
    jitter: float = np.nan  # half the spread of intervals, 5 % to 95 %, over their median
    gaps: int = 0  # number of intervals longer than five periods and 50 ms
    longest: float = np.nan  # the longest interval between rows [s]
    low: float = np.nan  # smallest value
    high: float = np.nan  # largest value
    noise: float = np.nan  # standard deviation of the white part, from fourth differences
    quantum: float = 0.0  # smallest step; 0 if the values are continuous
    saturated: float = 0.0  # share of rows at a flat extreme
    unchanged: float = 0.0  # share of rows that repeat the value before
    dead: bool = False  # whether all values are equal


@dataclass(frozen=True)
class Inspection:
    """The result of inspecting a log."""

    tables: tuple[LogTable, ...]  # the files
    channels: tuple[ChannelFigures, ...]  # figures of all channels
    findings: tuple[Finding, ...]  # all findings; `identify` stops at refusals
    # the log in the robot's coordinates; None without a model, or if channels could not be matched
    # or used
    recordings: Recordings | None
    robot: RobotModel | None  # the model; None without one


def inspect(
    tables: Sequence[LogTable], mapping: Map | None = None, robot: RobotModel | None = None
) -> Inspection:
    """Computes figures of every channel of a log and, given a robot, runs the checks of `identify`.

    Without a `mapping`, columns are matched by name.

    Raises:
        InvalidInput: the map names something that does not exist.
    """
    roles: dict[str, str] = {}
    recordings = None
    findings = tuple(f for table in tables for f in table.findings)
    if robot is not None:
        tables = [with_angles(table, robot) for table in apart(mapping, robot, tables)]
        try:
            given = _servo_findings(tables, mapping, robot)
            if given is not None:
                findings += given
            else:
                roles = _roles(layout(mapping, robot, tables), robot)
                recordings = prepare(tables, mapping, robot)
                findings = (*recordings.findings, *checks(recordings, robot))
                if recordings.turns_only:
                    findings += (_ALONE,)
        except UnmatchedChannels as error:
            text = f"found no channels for {', '.join(error.missing)}"
            reasons = error.reasons
            remedy = "Complete map.toml by hand and pass it with --map."
            leaders = [joint for joint in robot.joints if joint in robot.leaders]
            if robot.jointed and (told := unnamed(tables, leaders)):
                reasons = (unnamed_in_words(told),)
                remedy = "Check what map.toml says of them, complete it, and pass it with --map."
            text += f". {' '.join(reasons)}".rstrip(".")
            findings += (Finding("warning", "unmatched", "", text, remedy),)
        except UnusableLog as error:
            findings = error.findings
    figures = tuple(
        figures_of(table.source, name, channel, roles.get(name, ""))
        for table in tables
        for name, channel in table.channels.items()
    )
    if dead := [f.name for f in figures if f.dead and not f.role]:  # may be why a match failed
        text = f"unused and constant: {', '.join(dead[:12])}"
        text += f" and {len(dead) - 12} more" if len(dead) > 12 else ""
        findings += (Finding("note", "dead_channel", "", text, data={"channels": dead}),)
    return Inspection(tuple(tables), figures, findings, recordings, robot)


def _servo_findings(
    tables: Sequence[LogTable], mapping: Map | None, robot: RobotModel
) -> tuple[Finding, ...] | None:
    """Findings about position targets of a servo arm; None for other logs."""
    under_pd = mapping is not None and mapping.pd is not None
    if under_pd or not any(finding.code == "servo" for finding in robot.findings):
        return None
    from ..servos.identify import read_servos

    given = read_servos(robot, tables, mapping)
    if given is None:
        return None
    text = "the commands are position targets; `nsaid identify` fits the servos to them"
    return (Finding("note", "targets", "", text), *given.findings)


def figures_of(source: str, name: str, channel: Channel, role: str = "") -> ChannelFigures:
    """The figures of a channel; NaN where it has too few rows for one."""
    order = signals.order(channel.t)
    present = np.isfinite(channel.values[order.index])
    t = order.t[present]
    x = channel.values[order.index][present]
    missing = int(np.sum(~np.isfinite(channel.values)))
    if len(t) < 10:
        return ChannelFigures(source, name, role, len(t), missing)
    signal = signals.Signal(t, x, order.index[present], np.zeros((0, 2)))
    intervals = np.diff(t)
    spread = np.quantile(intervals, [0.05, 0.95])
    return ChannelFigures(
        source=source,
        name=name,
        role=role,
        rows=len(x),
        missing=missing,
        rate=float(1 / signal.period),
        jitter=float((spread[1] - spread[0]) / 2 / signal.period),
        gaps=len(signals.gaps(signal)),
        longest=float(intervals.max()),
        low=float(x.min()),
        high=float(x.max()),
        noise=signals.noise(x),
        quantum=signals.quantum(x),
        saturated=float(np.mean(signals.flat_extremes(x, signal.period))),
        unchanged=float(np.mean(np.diff(x) == 0)),
        dead=bool(np.ptp(x) == 0),
    )


def _roles(made: Layout, robot: RobotModel) -> dict[str, str]:
    """The role of each channel in use."""
    found: dict[str, str] = {}
    groups = made.positions, made.velocities, made.commands
    for (word, every), group in zip(signal_names(robot).items(), groups, strict=True):
        names = [every[j] for j in robot.independent] if robot.coupling else every
        if made.vehicle is not None and word == "q" and made.vehicle.position is None:
            names = every[3 - len(made.vehicle.place) :]  # a depth is that of z
        for (name, _), source in zip(names, group, strict=False):
            if source is not None:
                found[source.column.column] = f"{word} of {name}"
    if made.imu is not None:
        for source, role in zip(made.imu.sources, made.imu.roles, strict=False):
            found[source.column.column] = role
    return found


def signal_names(robot: RobotModel) -> dict[str, list[tuple[str, str]]]:
    """Name and unit of every position q, velocity v and command u; "" for an unknown unit."""
    system = robot.system
    rates = [f"{unit}/s" for unit in robot.units]
    q = robot.joints
    v = robot.joints
    units = list(robot.units)
    if not robot.jointed:
        q = system.position_labels
        v = system.velocity_labels
    if system.group == 6:  # its attitude is a quaternion
        units[3:6] = [""] * 4
    return {
        "q": list(zip(q, units, strict=False)),
        "v": list(zip(v, rates, strict=False)),
        "u": [(joint, "") for joint in robot.joints],
    }
