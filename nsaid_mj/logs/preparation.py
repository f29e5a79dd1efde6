"""From tables to `Recordings`: one grid, joint coordinates, segments without gaps, usable rows."""

import math
from collections.abc import Sequence

import numpy as np

from ..log import Log
from ..parameters import Array
from ..robot.findings import Finding
from ..robot.model import RobotModel
from . import signals
from .cleaning import Rest, about_rows, clean, cut_rest, limits_stated, moving_part, rows_of
from .layout import Layout, Source, layout, pose_velocity, with_angles
from .mapping import Map
from .recordings import Recordings, Segment
from .signals import Signal
from .tables import Table, join, values_of
from .unusable import UnusableLog

HIGHEST_RATE = 1000.0
"""Largest rate of the grid [Hz]; faster logs are low-passed and decimated."""

MOST_ROWS, ENOUGH = 1_000_000, 200.0
"""Logs with more rows than this are decimated, too, but not below this rate [Hz]: more rows of a
robot's motion add little information, and memory and time are proportional to them."""

SHORTEST = 0.5
"""Shorter stretches between gaps are left out [s]."""

_MOST = 0.3  # share of rows at a flat extreme above which it is not saturation


def prepare(tables: Sequence[Table], mapping: Map | None, robot: RobotModel) -> Recordings:
    """Resamples the logs of a robot to one grid, in the robot's coordinates and SI units.

    Files that hold all columns are separate logs; files that hold some are parts of one log, on one
    clock. Every step of the processing is a finding with row numbers.

    Args:
        tables: at least one.
        mapping: the meaning of columns; None to match them by name.
        robot: whose coordinates, joints and limits are used.

    Raises:
        UnmatchedChannels: no map is given, and the channels' names are ambiguous.
        InvalidInput: the map names something that does not exist, or files share no time.
        UnusableLog: no stretch of the logs has all signals for at least half a second.
    """
    mapping = mapping or Map()
    tables = [with_angles(table, robot) for table in tables]
    made = layout(mapping, robot, tables)
    findings = [finding for table in tables for finding in table.findings]
    if made.assumed:
        remedy = "If that is wrong, give a map.toml; docs/map.md shows one."
        findings.append(Finding("note", "standard_map", "", made.assumed, remedy))
    recordings, said = join(tables, mapping, [s.column.column for s in made.sources])
    findings += said
    if robot.system is None:
        made, said = _without_dead_velocities(made, recordings)
        findings += said
    del tables  # a log may be large, and what was read is not needed besides what was cleaned
    cleaned = _cleaned(recordings, made, findings)
    if not cleaned:
        raise UnusableLog(tuple(findings))
    rate = _rate([found for _, found in cleaned], made, findings)
    rest = Rest(made, mapping, robot, rate)
    segments: list[Segment] = []
    for source, found in cleaned:
        segments += _segments(source, found, made, mapping, robot, rest, findings)
    if not segments:
        text, remedy = f"no interval of {SHORTEST} s has all signals", "Record a longer log."
        if any(finding.code == "rest" for finding in findings):
            text = f"no joint moves faster than its noise for {SHORTEST} s"
            remedy = "Record a motion; check that the columns of the positions are the right ones."
        findings.append(Finding("refusal", "short_log", "", text, remedy))
        raise UnusableLog(tuple(findings))
    return Recordings(tuple(segments), rate, made.command_units, tuple(findings))


def _cleaned(
    recordings: list[Table], made: Layout, findings: list[Finding]
) -> list[tuple[str, dict[str, Signal]]]:
    """Source and signals of the recordings with numbers in all channels; empties their list."""
    cleaned = []
    while recordings:
        recording = recordings.pop(0)
        found, said = clean(recording, made)
        findings += said
        if all(len(signal.t) > 9 for signal in found.values()):
            cleaned.append((recording.source, found))
            continue
        few = min(found, key=lambda name: len(found[name].t))
        count = len(found[few].t)
        text = f"only {count} rows have a number" if count else "no row has a number"
        remedy = "Map another column, or leave the joint out with --lock."
        where = f"{recording.source}, {few}"
        findings.append(Finding("refusal", "dead_channel", where, text, remedy))
    return cleaned


def _without_dead_velocities(
    made: Layout, recordings: Sequence[Table]
) -> tuple[Layout, list[Finding]]:
    """The layout without velocities whose column is constant or has no numbers."""
    kept, findings = list(made.velocities), []
    for j, velocity in enumerate(made.velocities):
        if velocity is None or made.vehicle is not None:
            continue
        name = velocity.column.column
        values = values_of(name, recordings)
        if len(values) < 10 or np.ptp(values) == 0:
            kept[j] = None
            text = "the velocity has one value or none; the position is differentiated instead"
            findings.append(Finding("warning", "dead_channel", name, text))
    return made._replace(velocities=tuple(kept)), findings


def _rate(cleaned: Sequence[dict[str, Signal]], made: Layout, findings: list[Finding]) -> float:
    """Samples per second of the grid: the median rate of the positions, or a fraction of it."""
    rates = [found[s.column.column].rate for found in cleaned for s in made.positions]
    own = float(np.median(rates))
    if abs(own - round(own)) < 2e-3 * own and own > 10:
        own = float(round(own))
    rows = sum(len(found[made.positions[0].column.column].t) for found in cleaned)
    every = max(1, math.ceil(own / HIGHEST_RATE - 0.05))
    every = max(every, min(math.ceil(rows / MOST_ROWS), int(own / ENOUGH)))
    if every > 1:
        text = f"reduced from {own:g} to {own / every:g} Hz, after a zero-phase low-pass filter"
        data = {"from": own, "to": own / every}
        findings.append(Finding("note", "decimated", "", text, data=data))
    return own / every


def _stretches(
    source: str, found: dict[str, Signal], made: Layout, findings: list[Finding]
) -> list[tuple[float, float]]:
    """Start and end [s] of the stretches between the gaps of all signals."""
    start = max(signal.t[0] for signal in found.values())
    end = min(signal.t[-1] for signal in found.values())
    cuts: dict[tuple[float, float], list[str]] = {}
    for name, signal in found.items():
        for a, b in signals.gaps(signal):
            cuts.setdefault((float(a), float(b)), []).append(name)
    parts, last = [], start
    for (a, b), names in sorted(cuts.items()):
        one = found[names[0]]
        row = int(one.row[np.searchsorted(one.t, a)])
        text = f"{b - a:.3g} s without rows after row {row}; the log is split there"
        where = source if len(names) == len(found) else f"{source}, {names[0]}"
        data = {"seconds": b - a, "row": row, "channels": names}
        findings.append(Finding("note", "gap", where, text, data=data))
        parts.append((last, min(a, end)))
        last = max(last, b)
    parts.append((last, end))
    reference = found[made.positions[0].column.column]
    kept = []
    for start, end in parts:
        if end - start >= SHORTEST:
            kept.append((start, end))
        elif end > start:
            rows = rows_of(reference, start, end)
            text = f"{end - start:.2g} s between gaps (rows {rows[0]}–{rows[1]}) are "
            text += "too short and were left out"
            data = {"rows": list(rows)}
            findings.append(Finding("note", "short_stretch", source, text, data=data))
    return kept


def _segments(
    source: str,
    found: dict[str, Signal],
    made: Layout,
    mapping: Map,
    robot: RobotModel,
    rest: Rest,
    findings: list[Finding],
) -> list[Segment]:
    """The segments of a recording on the grid."""
    reference = found[made.positions[0].column.column]
    drop_rest = robot.system is None and mapping.drop_rest
    saturated = _saturated(source, found, made, robot, findings)
    if any(velocity is None for velocity in made.velocities):
        text = f"velocities are derived from positions up to {signals.bandwidth(rest.rate):g} Hz"
        missing = [j for j, v in zip(robot.joints, made.velocities, strict=False) if v is None]
        findings.append(Finding("note", "differentiated", source, text, data={"joints": missing}))
    logs: list[Log] = []
    for start, end in _stretches(source, found, made, findings):
        first = reference.t[np.searchsorted(reference.t, start)]
        grid = first + np.arange(int((end - first) * rest.rate + 1e-6) + 1) / rest.rate
        logs.append(_log(grid, found, made, mapping.hold, rest.rate))
    limits = rest.limits(found, logs) if drop_rest and logs else np.zeros(0)
    segments = []
    for log in logs:
        grid = log.t
        usable = _trusted(grid, found, made, saturated, log.v.shape[1])
        if drop_rest:
            speed = np.abs(rest.speed(found, log))
            moving = np.asarray(speed >= np.maximum(limits, 1e-12))
            usable &= moving
            kept = moving_part(np.any(moving, axis=1), rest.rate)
            if kept.stop - kept.start < SHORTEST * rest.rate:
                kept = slice(0, 0)
            findings += cut_rest(source, reference, grid, kept)
        else:
            kept = slice(0, len(grid))
        if kept.stop > kept.start:
            rows = rows_of(reference, grid[kept.start], grid[kept.stop - 1])
            segments.append(Segment(log.part(kept.start, kept.stop), usable[kept], source, rows))
    if segments and drop_rest:
        findings.append(limits_stated(source, segments, limits, robot.joints))
    return segments


def _log(grid: Array, found: dict[str, Signal], made: Layout, hold: bool, rate: float) -> Log:
    """q, v and u on a grid."""

    def on_grid(sources: Sequence[Source | None], held: bool = False) -> Array:
        signal = [found[s.column.column] if s else None for s in sources]
        columns = [signals.resample(x, grid, held) if x else 0.0 * grid for x in signal]
        return np.column_stack(columns)

    q_raw = on_grid(made.positions)
    q = made.q(q_raw)
    u = made.u(on_grid(made.commands, hold))
    if made.vehicle is not None and made.velocities[0] is None:
        v = signals.low_pass(pose_velocity(q, rate), signals.bandwidth(rate) / (0.5 * rate))
    else:
        v_raw = np.empty((len(grid), len(made.velocities)))
        for j, source in enumerate(made.velocities):
            if source is None:
                v_raw[:, j] = signals.derivative(q_raw[:, j], rate)
            else:
                v_raw[:, j] = signals.resample(found[source.column.column], grid)
        v = made.v(v_raw, q)
    return Log(grid, made.placed(q, v, rate), v, u)


def _trusted(
    grid: Array, found: dict[str, Signal], made: Layout, saturated: dict[str, Array], n: int
) -> np.ndarray:
    """(N, n) rows in which no signal of a joint is saturated or bridges a drop-out."""
    usable = np.ones((len(grid), n), bool)
    step = (grid[-1] - grid[0]) / (len(grid) - 1)
    for group, mixing in (
        (made.positions, made.coupling),
        (made.velocities, made.coupling),
        (made.commands, made.torque),
    ):
        for k, source in enumerate(group):
            if source is None:
                continue
            spans = found[source.column.column].doubtful
            spans = spans[spans[:, 1] - spans[:, 0] > 1.2 * step]
            touched = np.ones(n, bool) if mixing is None else mixing[:, k] != 0
            bad = _within(grid, spans)
            if source.column.column in saturated:
                bad |= _within(grid, saturated[source.column.column])
            usable[np.ix_(bad, touched)] = False
    return usable


def _within(grid: Array, spans: Array) -> np.ndarray:
    """(N,) whether a time lies in one of the open intervals (k, 2)."""
    inside = np.zeros(len(grid), bool)
    for a, b in spans:
        inside[np.searchsorted(grid, a, side="right") : np.searchsorted(grid, b)] = True
    return inside


def _saturated(
    source: str,
    found: dict[str, Signal],
    made: Layout,
    robot: RobotModel,
    findings: list[Finding],
) -> dict[str, Array]:
    """Intervals of time (k, 2) in which a command is at its limit, by column."""
    spans: dict[str, Array] = {}
    torque = np.eye(len(made.commands)) if made.torque is None else made.torque
    diagonal = np.array_equal(torque, np.diag(np.diag(torque)))
    for j, (command, limit) in enumerate(zip(made.commands, robot.limits, strict=True)):
        if command is None:
            continue
        name = command.column.column
        signal = found[name]
        flat = signals.flat_extremes(signal.x, signal.period)
        where, how = f"{source}, {name}", "a flat extreme"
        size = np.abs(signal.x * torque[j, j] + command.column.offset)
        if diagonal and np.isfinite(limit) and size.max() <= 1.02 * limit:
            at_limit = size >= 0.999 * limit
            if at_limit.any():
                flat, how = flat | at_limit, f"the model's limit of {limit:g}"
        share = float(flat.mean())
        if share == 0:
            continue
        if share > _MOST:
            text = f"{100 * share:.0f} % of the rows are at an extreme, as of a command that "
            text += "switches between levels or saturates; the rows are used"
            findings.append(Finding("warning", "saturated", where, text, data={"share": share}))
            continue
        edges = signals.runs(flat)
        last = len(signal.t) - 1
        spans[name] = np.column_stack(
            [signal.t[np.maximum(edges[:, 0] - 1, 0)], signal.t[np.minimum(edges[:, 1], last)]]
        )
        text = f"rows are saturated at {how} and not used"
        findings.append(about_rows("warning", "saturated", where, signal.row[flat], text))
    return spans
