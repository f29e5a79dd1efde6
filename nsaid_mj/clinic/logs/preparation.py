"""From tables to `Recordings`: one grid, joint coordinates, segments without gaps, usable rows."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...base import Finding
from ...core import Array, Log
from ...robots import RobotModel
from . import signals
from .causes import gross_clock
from .cleaning import (
    Cleaned,
    Rest,
    ShortStretch,
    about_rows,
    clean,
    cut_rest,
    limits_stated,
    moving_part,
    rows_of,
    short_stated,
)
from .imu import held_still, read_imu
from .layout import (
    ChannelSource,
    Layout,
    apart,
    layout,
    pose_velocity,
    with_angles,
    with_servos,
)
from .mapping import Map
from .pd_law import held_mean
from .phases import LogPhase, events_of, modes_stated, parts_in_words, phases, phases_stated
from .recordings import LogSegment, Recordings
from .tables import LogTable, join, values_of
from .unusable import UnusableLog

HIGHEST_RATE = 1000.0
"""Largest rate of the grid [Hz]; faster logs are low-passed and decimated."""

MOST_ROWS = 1_000_000
ENOUGH = 200.0
"""Logs with more rows than this are decimated, too, but not below this rate [Hz]: more rows of a
robot's motion add little information, and memory and time are proportional to them."""

SHORTEST = 0.25
"""Shorter stretches are left out [s]: the row filter of a fast motion is as long. All others count
together."""

LEAST = 0.5
"""Length of a usable log, of all stretches together [s]."""

_MOST = 0.3  # share of rows at a flat extreme above which it is not saturation


def prepare(tables: Sequence[LogTable], mapping: Map | None, robot: RobotModel) -> Recordings:
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
    tables = [with_angles(table, robot) for table in apart(mapping, robot, tables)]
    mapping = with_servos(mapping, robot, tables)
    made = layout(mapping, robot, tables)
    findings = [finding for table in tables for finding in table.findings]
    if made.assumed:
        remedy = "If that is wrong, give a map.toml; docs/map.md shows one."
        findings.append(Finding("note", "standard_map", "", made.assumed, remedy))
    if made.pd is not None:
        findings.append(made.pd.stated(robot.leaders))
    recordings, said = join(tables, mapping, [s.column.column for s in made.sources])
    findings += said
    if robot.jointed:
        made, said = _without_dead_velocities(made, recordings)
        findings += said
        if made.pd is None and (magnitudes := _magnitudes(made, recordings)):
            raise UnusableLog((*findings, *magnitudes))
        if made.imu is not None and held_still(made.imu, recordings):
            made = made._replace(imu=None)
            text = "the IMU does not turn: the robot is taken to hang on a stand"
            findings.append(Finding("note", "on_stand", "base", text))
    del tables  # a log may be large, and what was read is not needed besides what was cleaned
    short: list[ShortStretch] = []
    cleaned = _cleaned(recordings, made, mapping, robot, findings, short)
    if not cleaned:
        raise UnusableLog(tuple(findings))
    if (clock := gross_clock(cleaned, findings)) is not None:
        raise UnusableLog((*findings, clock))
    rate = _rate(cleaned, findings)
    segments: list[LogSegment] = []
    seen: list[LogPhase] = []
    for log in cleaned:
        own, parts = _segments(log, mapping, robot, rate, findings, short)
        segments += own
        seen += parts
    stated = phases_stated(seen, "note")
    findings[:0] = stated  # what the rest is said of comes first
    findings += modes_stated(seen)
    findings += short_stated(short, len(segments), SHORTEST)
    if sum(len(segment.log.t) for segment in segments) < LEAST * rate:
        findings.append(_too_short(stated, seen, findings))
        raise UnusableLog(tuple(findings))
    return Recordings(
        tuple(segments),
        rate,
        made.command_units,
        tuple(findings),
        made.vehicle,
        tuple(seen),
        made.on_leaders(made.pd.feedback) if made.pd else None,
        made.imu.stated if made.imu else None,
        replace(mapping.contacts, force=made.imu.feet if made.imu else ()),
        timed=mapping.time.scale is not None,
    )


def _too_short(
    stated: Sequence[Finding], seen: Sequence[LogPhase], findings: Sequence[Finding]
) -> Finding:
    """Why too little of the logs can be used; `stated` names the phases that are left out."""
    text = f"no interval of {LEAST} s has all signals"
    remedy = "Record a longer log."
    if stated:
        left = parts_in_words(seen).partition("left out: ")[2].rstrip(".")
        text = f"no interval of {LEAST} s remains; left out: {left}"
        remedy = "Record a motion; `[phases]` in map.toml corrects phases found wrongly."
    elif any(finding.code == "rest" for finding in findings):
        text = f"no joint moves faster than its noise for {LEAST} s"
        remedy = "Record a motion; check that the columns of the positions are the right ones."
    return Finding("refusal", "short_log", "", text, remedy)


def _cleaned(
    recordings: list[LogTable],
    made: Layout,
    mapping: Map,
    robot: RobotModel,
    findings: list[Finding],
    short: list[ShortStretch],
) -> list[Cleaned]:
    """The recordings with numbers in all channels; empties their list."""
    cleaned = []
    kinds = [] if robot.jointed else [c.kind for c in robot.system.structure.columns]
    actuator = next((kind for kind in ("rotor", "thruster") if kind in kinds), "")
    while recordings:
        table = recordings.pop(0)
        log, said = clean(table, made)
        log = log._replace(events=events_of(table.channels, mapping.phases, actuator))
        findings += said
        few, signal = min(log.signals.items(), key=lambda item: len(item[1].t))
        if len(signal.t) > 9:
            cleaned.append(log)
            continue
        rows = max(len(channel.t) for channel in table.channels.values())
        if rows <= 9 and (cleaned or recordings):  # an episode among others
            short.append(ShortStretch(log.source, (1, rows), float(np.ptp(signal.t))))
            continue
        text = (
            f"only {len(signal.t)} rows have a number" if len(signal.t) else "no row has a number"
        )
        remedy = "Map another column, or leave the joint out with --lock."
        where = f"{log.source}, {few}"
        findings.append(Finding("refusal", "dead_channel", where, text, remedy))
    return cleaned


def _magnitudes(made: Layout, recordings: Sequence[LogTable]) -> list[Finding]:
    """The refusal of commands of which none ever changes its sign."""
    names = [source.column.column for source in made.commands if source]
    if not signals.without_signs([values_of(name, recordings) for name in names]):
        return []
    text = "the commands have no signs: none ever changes its sign, and all are 0 again and again, "
    text += "as magnitudes of currents or loads are"
    remedy = "Record them with their signs. Of position servos, give the targets instead, in "
    remedy += "columns or a file called so (`target_1`, `control.csv`), or in map.toml."
    return [Finding("refusal", "unsigned", "", text, remedy)]


def _without_dead_velocities(
    made: Layout, recordings: Sequence[LogTable]
) -> tuple[Layout, list[Finding]]:
    """The layout without velocities whose column is constant or has no numbers."""
    kept = list(made.velocities)
    findings = []
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


def _rate(cleaned: Sequence[Cleaned], findings: list[Finding]) -> float:
    """Samples per second of the grid: the median rate of the positions, or a fraction of it."""
    own = float(np.median([log.of(s).rate for log in cleaned for s in log.made.positions]))
    if abs(own - round(own)) < 2e-3 * own and own > 10:
        own = float(round(own))
    rows = sum(len(log.reference.t) for log in cleaned)
    every = max(1, math.ceil(own / HIGHEST_RATE - 0.05))
    every = max(every, min(math.ceil(rows / MOST_ROWS), int(own / ENOUGH)))
    if every > 1:
        text = f"reduced from {own:g} to {own / every:g} Hz, after a zero-phase low-pass filter"
        data = {"from": own, "to": own / every}
        findings.append(Finding("note", "decimated", "", text, data=data))
    return own / every


def _stretches(
    log: Cleaned, findings: list[Finding], short: list[ShortStretch]
) -> list[tuple[float, float]]:
    """Start and end [s] of the stretches between the gaps of all signals."""
    found = log.signals
    source = log.source
    start = max(signal.t[0] for signal in found.values())
    end = min(signal.t[-1] for signal in found.values())
    cuts: dict[tuple[float, float], list[str]] = {}
    for name, signal in found.items():
        for a, b in signals.gaps(signal):
            cuts.setdefault((float(a), float(b)), []).append(name)
    parts = []
    last = start
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
    kept = []
    for start, end in parts:
        if end - start >= SHORTEST:
            kept.append((start, end))
        elif end > start:
            rows = rows_of(log.reference, start, end)
            short.append(ShortStretch(source, rows, end - start))
    return kept


def _segments(
    log: Cleaned,
    mapping: Map,
    robot: RobotModel,
    rate: float,
    findings: list[Finding],
    short: list[ShortStretch],
) -> tuple[list[LogSegment], list[LogPhase]]:
    """The segments of a log on the grid, and the phases that they are cut from."""
    made = log.made
    source = log.source
    reference = log.reference
    # the weight of a robot that stands still is told by the joints at rest
    drop_rest = robot.jointed and mapping.drop_rest and made.imu is None
    findings += _differentiated(made, robot, rate, source)
    seen = _phases(log, mapping, robot, rate, _stretches(log, findings, short))
    logs = []
    for phase in seen:
        if phase.used and phase.seconds >= SHORTEST:
            logs.append(phase.log)
        elif phase.used:
            rows = rows_of(reference, *phase.log.t[[0, -1]].tolist())
            short.append(ShortStretch(source, rows, phase.seconds))
    if not logs:
        return [], seen
    saturated: dict[str, Array] = {}
    if made.pd is None:
        saturated = _saturated(log, [(own.t[0], own.t[-1]) for own in logs], robot, findings)
    rest = None
    limits = np.zeros(0)
    if drop_rest:
        stated = [mapping.joints[j].rest if j in mapping.joints else 0.0 for j in robot.joints]
        rest = Rest(log, np.array(stated), rate)
        limits = rest.limits(logs)
    segments = []
    for own in logs:
        grid = own.t
        usable = _trusted(grid, log, saturated, own.v.shape[1])
        if made.pd is not None:  # at its limit a torque no longer follows the law
            usable &= np.abs(own.u) < 0.999 * robot.limits
        kept = slice(0, len(grid))
        if rest is not None:
            moving = rest.speed(own) >= np.maximum(limits, 1e-12)
            usable &= moving
            kept = moving_part(np.any(moving, axis=1), rate)
            if 0 < kept.stop - kept.start < SHORTEST * rate:
                rows = rows_of(reference, *grid[[kept.start, kept.stop - 1]].tolist())
                short.append(ShortStretch(source, rows, (kept.stop - kept.start) / rate))
                kept = slice(0, 0)
            findings += cut_rest(log, grid, kept)
        if kept.stop > kept.start:
            rows = rows_of(reference, grid[kept.start], grid[kept.stop - 1])
            moved = own.part(kept.start, kept.stop)
            imu = _imu(moved.t, log, findings)
            felt = _felt(log, moved, rate)
            segments.append(LogSegment(moved, usable[kept], source, rows, imu, felt))
    if segments and drop_rest:
        findings.append(limits_stated(source, segments, limits, robot))
    return segments, seen


def _phases(
    log: Cleaned,
    mapping: Map,
    robot: RobotModel,
    rate: float,
    stretches: Sequence[tuple[float, float]],
) -> list[LogPhase]:
    """The phases of a log's stretches between a start and an end [s], on the grid."""
    known = log.reference.t
    unmeasured = 3 if log.made.turns_only else 0
    seen: list[LogPhase] = []
    for start, end in stretches:
        first = known[np.searchsorted(known, start)]
        grid = first + np.arange(int((end - first) * rate + 1e-6) + 1) / rate
        own = _log(grid, log, mapping.hold, rate)
        detect = mapping.phases.detect
        seen += phases(own, log.source, robot, log.events, detect, unmeasured)
    return seen


def _differentiated(made: Layout, robot: RobotModel, rate: float, source: str) -> list[Finding]:
    """A note of the velocities that the log does not have, but its positions."""
    names = robot.leaders if robot.jointed else robot.system.velocity_labels
    missing = [j for j, v in zip(names, made.velocities, strict=False) if v is None]
    if made.turns_only:
        missing = missing[3:]
    if not missing:
        return []
    text = f"velocities are derived from positions up to {signals.bandwidth(rate):g} Hz"
    return [Finding("note", "differentiated", source, text, data={"joints": missing})]


def _felt(log: Cleaned, moved: Log, rate: float) -> Array | None:
    """(N, 3) specific force of a vehicle along a motion; None if it is not measured."""
    made = log.made
    if not made.specific:
        return None
    return made.force(_on_grid(log, moved.t, made.specific), moved.v, rate)


def _log(grid: Array, log: Cleaned, hold: bool, rate: float) -> Log:
    """q, v and u on a grid."""
    made = log.made
    q_raw = _on_grid(log, grid, made.positions)
    q = made.q(q_raw)
    v_raw = _on_grid(log, grid, made.velocities)
    none = [source is None for source in made.velocities]
    if made.vehicle is not None:
        v = made.v(v_raw, q)
        if any(none):
            derived = pose_velocity(q, rate)[:, none]
            v[:, none] = signals.low_pass(derived, signals.bandwidth(rate) / (0.5 * rate))
    else:
        if any(none):
            v_raw[:, none] = signals.derivative(q_raw[:, none], rate)
        v = made.v(v_raw, q)
    u = _by_pd(grid, log, q, v) if made.pd else made.u(_on_grid(log, grid, made.commands, hold))
    if made.voltage is not None:  # a motor turns the more slowly the lower it is
        u = u * np.where(made.powered, _on_grid(log, grid, [made.voltage]), 1.0)
    return Log(grid, made.placed(q, v, rate), v, u)


def _imu(grid: Array, log: Cleaned, findings: list[Finding]) -> Array | None:
    """(N, 10) readings of the IMU on a grid, None without one; new findings are added."""
    imu = log.made.imu
    if imu is None:
        return None
    raw = [signals.resample(log.of(s), grid) + s.column.zero for s in imu.sources]
    readings, said = read_imu(imu, grid, np.column_stack(raw))
    findings += [finding for finding in said if finding not in findings]
    return readings


def _on_grid(
    log: Cleaned, grid: Array, sources: Sequence[ChannelSource | None], held: bool = False
) -> Array:
    """(N, k) scaled values of sources on a grid, 0 without a source."""
    return np.column_stack(
        [signals.resample(log.of(s), grid, held) if s else 0.0 * grid for s in sources]
    )


def _by_pd(grid: Array, log: Cleaned, q: Array, v: Array) -> Array:
    """(N, n) commands of motors under a PD law, from their targets on a grid and (N, n) q and v."""
    law = log.made.pd
    assert law is not None

    def on_grid(sources: Sequence[ChannelSource | None]) -> Array:
        held = [held_mean(log.of(s), grid) + s.column.zero if s else 0.0 * grid for s in sources]
        return np.column_stack(held)

    targets = on_grid(log.made.commands)
    rates = on_grid(law.velocities)
    forward = on_grid(law.forward)
    own = slice(None) if log.made.led is None else list(log.made.led.independent)
    u = law.commands(targets, rates, forward, q[:, own], v[:, own])
    return log.made.on_leaders(u * [source is not None for source in log.made.commands])


def _trusted(grid: Array, log: Cleaned, saturated: dict[str, Array], n: int) -> np.ndarray:
    """(N, n) rows in which no signal of a joint is saturated or bridges a drop-out."""
    usable = np.ones((len(grid), n), bool)
    made = log.made
    step = (grid[-1] - grid[0]) / (len(grid) - 1)
    for group, mixing in (
        (made.positions, made.coupling),
        (made.velocities, made.coupling),
        (made.commands, None if made.torque is None else made.on_leaders(made.torque.T).T),
    ):
        for k, source in enumerate(group):
            if source is None:
                continue
            spans = log.of(source).doubtful
            spans = [spans[spans[:, 1] - spans[:, 0] > 1.2 * step]]
            spans += [saturated[name] for name in (source.column.column,) if name in saturated]
            touched = np.ones(n, bool) if mixing is None else mixing[:, k] != 0
            for a, b in np.concatenate(spans):  # open intervals
                bad = slice(np.searchsorted(grid, a, side="right"), np.searchsorted(grid, b))
                usable[bad, touched] = False
    return usable


def _saturated(
    log: Cleaned,
    used: Sequence[tuple[float, float]],
    robot: RobotModel,
    findings: list[Finding],
) -> dict[str, Array]:
    """Intervals of time (k, 2) in which a command is at its limit, by column.

    Motors that are off are not at a limit: `used` are start and end [s] of the phases in use.
    """
    spans = {}
    made = log.made
    torque = np.eye(len(made.commands)) if made.torque is None else made.torque
    diagonal = np.array_equal(torque, np.diag(np.diag(torque)))
    for j, (command, limit) in enumerate(
        zip(made.commands, robot.limits[list(robot.independent)], strict=True)
    ):
        if command is None:
            continue
        name = command.column.column
        signal = log.of(command)
        inside = np.any([(signal.t >= a) & (signal.t <= b) for a, b in used], axis=0)
        flat = inside.copy()
        flat[inside] = signals.flat_extremes(signal.x[inside], signal.period)
        where = f"{log.source}, {name}"
        how = "a flat extreme"
        size = np.abs(signal.x * torque[j, j] + command.column.offset)
        if diagonal and np.isfinite(limit) and size.max() <= 1.02 * limit:
            at_limit = inside & (size >= 0.999 * limit)
            if at_limit.any():
                flat = flat | at_limit
                how = f"the model's limit of {limit:g}"
        share = float(flat.sum() / max(inside.sum(), 1))
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
