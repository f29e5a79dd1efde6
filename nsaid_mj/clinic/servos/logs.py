"""Logs of (target, position): channels, clocks and gaps, and each joint's gravity and inertia."""

from __future__ import annotations

import itertools
from collections.abc import Container, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...base import Finding, InvalidInput, pin
from ...core import Array, JointTree
from ...lab import followed_targets
from ...robots import RobotModel, Servos
from ..identify.loads import Load
from ..logs import signals
from ..logs.checks import beyond_limits
from ..logs.cleaning import ShortStretch, clean, rows_of, short_stated
from ..logs.first_map import WHOLE
from ..logs.formats.run import FOLLOWED
from ..logs.layout import Layout, layout
from ..logs.mapping import ColumnMap, Joint, Map
from ..logs.matching import candidates, is_gripper, lacking_targets, match_targets
from ..logs.phases import Event, events_of, events_stated
from ..logs.remedies import remedy_of
from ..logs.tables import LogTable, join, values_of
from ..logs.unusable import UnmatchedChannels, UnusableLog
from .simulation import STEP, JointLog, move_arm

DELAYS = np.arange(0.0, 0.31, 0.01)
"""Delays at which a target is compared with the position [s]."""
TRAVEL = 5e-3
"""Least travel of a joint that moves [rad or m]."""
_LEADS = 0.8  # error of an early target over that of a late one, below which columns are swapped
_SETTLES = 0.3  # time in which a joint forgets how a stretch began [s]
_BEGINS = 0.04  # after the start and again after that, positions tell the first speed [s]
_MOVES = 0.12  # first speed from which a stretch begins in motion [rad/s or m/s]
_SPAN = 0.02  # half of that over which speeds are differences of positions [s]
_SHORTEST = 0.5  # shorter stretches are left out [s]: a joint's delay and damping last as long


class ServoLog(NamedTuple):
    """A stretch of a log without gaps, of an arm with n joints."""

    source: str  # name of the file
    t: Array  # (N,) times [s]
    issued: Array  # (N, n) targets [rad or m], clipped to the servos' `ctrlrange`
    target: Array  # (N, n) the targets after limits and smoothing; see `robot.target_profile`
    position: Array  # (N, n) measured [rad or m]
    # (N, n) torque or force that gravity and the joints' speeds require of each joint, and the
    # other joints' accelerations where they are known [N·m or N]
    load: Array
    mass: Array  # (N, n, n) mass matrix without armatures [kg·m², kg·m or kg]
    loaded: bool = False  # whether the arm carries a weighed load
    limit: Array | None = None  # (n,) largest force of each servo [N·m or N]; None without limits
    stiffer: float = 1.0  # kp of all servos in this log over that of the first

    def part(self, rows: slice) -> ServoLog:
        """Some of the rows."""
        return self._replace(**{name: getattr(self, name)[rows] for name in self._fields[1:7]})

    def halves(self) -> list[ServoLog]:
        """The first and the second half of the rows."""
        half = len(self.t) // 2
        return [self.part(slice(None, half)), self.part(slice(half, None))]

    def joint(self, j: int) -> JointLog:
        """The log of one joint, for its simulation."""
        columns = (self.target[:, j], self.position[:, j], self.load[:, j], self.mass[:, j, j])
        limit = np.inf if self.limit is None else float(self.limit[j])
        rows = map(np.ascontiguousarray, columns)
        return JointLog(self.t, *rows, limit=limit, stiffer=self.stiffer)


class ServoLogs(NamedTuple):
    """An arm with position servos, and logs of their targets."""

    robot: RobotModel
    logs: tuple[ServoLog, ...]  # stretches without gaps
    kp: Array  # (n,) stiffness of the servos in the model file [N·m/rad or N/m]
    findings: tuple[Finding, ...]  # about file and logs
    load: Load | None = None  # payload of known mass that the loaded logs carry; None if none does


def servo_map(
    tables: Sequence[LogTable], mapping: Map | None, joints: Sequence[str]
) -> dict[str, Joint] | None:
    """Position and target columns of every joint; None if the log holds no targets.

    A map holds targets if the unit of each `command` is one of positions, or it states none and the
    column is called a target; without a map, channels are matched by name, and a log that holds
    torques or currents as well counts as one of them.

    Raises:
        UnmatchedChannels: only some joints have a target.
    """
    channels = list(dict.fromkeys(name for table in tables for name in table.channels))
    targets = match_targets(channels, joints)
    if mapping is not None and mapping.joints:
        commands = [joint.command for joint in mapping.joints.values()]
        called = {*targets.values()}
        known = all(c and (c.is_position or (not c.unit and c.column in called)) for c in commands)
        return dict(mapping.joints) if known else None
    found = candidates(channels, joints)
    lacking = lacking_targets(channels, joints)
    if not targets and lacking:
        reason = "If a joint stood still, lock it: `--lock JOINT`."
        raise UnmatchedChannels([f"the target of {joint}" for joint in lacking], [reason], channels)
    measured = [
        g for g in found["position"].values() if not set(g.values()) & set(targets.values())
    ]
    if not targets or len(measured) != 1 or _torques(found["command"], targets, tables):
        return None
    return {
        joint: Joint(
            position=ColumnMap(column=measured[0][joint]), command=ColumnMap(column=targets[joint])
        )
        for joint in joints
    }


def _torques(
    commands: dict[str, dict[str, str]], targets: dict[str, str], tables: Sequence[LogTable]
) -> bool:
    """Whether groups of channels hold torques or currents, with their signs."""
    groups = (list(group.values()) for group in commands.values())
    others = [group for group in groups if not set(group) & set(targets.values())]
    return any(
        not signals.without_signs([values_of(name, tables) for name in own]) for own in others
    )


def read_servo_logs(
    robot: RobotModel,
    tables: Sequence[LogTable],
    columns: dict[str, Joint],
    mapping: Map | None,
    carrying: Container[str] = (),
) -> tuple[tuple[ServoLog, ...], tuple[Finding, ...]]:
    """The stretches of logs, and findings about the data.

    The robot has a position servo on each joint; `columns` are from `servo_map`, `mapping` may hold
    the files' clocks, and `carrying` names the files whose arm carries a weighed load.

    Raises:
        InvalidInput: a column or joint of the map does not exist, or it states `p` of some files.
        UnusableLog: no stretch lasts half a second, or positions are in another unit.
    """
    mapping = replace(mapping or Map(), joints=columns)
    short: list[ShortStretch] = []
    made = layout(mapping, robot, tables, targets=True)._replace(velocities=())
    recordings, findings = join(tables, mapping, [s.column.column for s in made.sources])
    logs: list[ServoLog] = []
    assert robot.servos is not None
    model = without_armature(robot.model)
    sources = [recording.source for recording in recordings]
    stated = {name: file.p for name, file in mapping.files.items() if file.p is not None}
    missing = [source for source in sources if stated and source not in stated]
    if missing:
        remedy = "State `p` of every file, or of none."
        raise InvalidInput("map: files", "p of every log", f"none of {missing[0]}", remedy)
    for recording in recordings:
        events = events_of(recording.channels, mapping.phases)
        stretches, said = _stretches(recording, made, robot.servos, events, short)
        loaded = recording.source in carrying
        kp = stated[recording.source] / stated[sources[0]] if stated else 1.0
        logs += [log._replace(loaded=loaded, stiffer=kp) for log in stretches]
        findings += said
    findings += short_stated(short, len(logs), _SHORTEST)
    if not logs:
        text = f"no stretch of {_SHORTEST:g} s has all targets and positions"
        refusal = Finding("refusal", "short_log", "", text, "Record a longer log.")
        raise UnusableLog((*findings, refusal))
    speeds = [np.abs(np.gradient(log.position, log.t, axis=0)) for log in logs]
    fast = np.quantile(np.concatenate(speeds), 0.95, axis=0)
    measured = np.concatenate([log.position for log in logs])
    findings += _in_one(beyond_limits(measured, fast, robot), robot, measured)
    findings += _motionless(logs)
    if Finding.refused(findings):
        raise UnusableLog(tuple(findings))
    return tuple(weighed(model, log) for log in logs), tuple(findings)


def _in_one(found: list[Finding], robot: RobotModel, measured: Array) -> list[Finding]:
    """Findings of `beyond_limits` at positions (N, n), with one in place of those about units."""
    own = [f for f in found if f.code == "degrees" and f.level == "refusal"]
    if not own:
        return found
    sizes = dict(zip(robot.joints, np.abs(measured).max(axis=0), strict=True))
    widest = max(own, key=lambda f: (not is_gripper(f.where), sizes[f.where]))
    text = f"positions and targets are not in rad: at {widest.where} "
    text += widest.text.partition(";")[0]
    data: dict[str, Any] = {"joints": [f.where for f in own]}
    if sizes[widest.where] > WHOLE:
        data["map"] = {"factors.position": "deg"}
        remedy = remedy_of(data["map"])
    else:
        remedy = "They are degrees, or LeRobot's -100 to 100 of each joint's range, which the log "
        remedy += 'cannot tell: set `[factors]` `position = "deg"` or `position = "range"` in '
        remedy += "map.toml, once for all joints."
    rest = [f for f in found if f not in own]
    return [Finding("refusal", "degrees", "", text, remedy, data), *rest]


def _motionless(logs: Sequence[ServoLog]) -> tuple[Finding, ...]:
    """Refusals of logs in which no joint moves, or positions move before their targets."""
    travel = np.ptp(np.concatenate([log.position for log in logs]), axis=0)
    moving = np.flatnonzero(travel > TRAVEL)
    if not len(moving):
        text = f"no joint moves by more than {1e3 * TRAVEL:g} mrad or mm"
        remedy = "Record motions of every joint, slow and fast, with stops and reversals."
        return (Finding("refusal", "no_motion", "", text, remedy),)
    used = np.ones(sum(len(log.t) for log in logs))
    early = []
    for j in moving:
        own = [JointLog(log.t, log.target[:, j], log.position[:, j], log.t, log.t) for log in logs]
        behind, ahead = (min(late(own, used, x * side) for x in DELAYS) for side in (1, -1))
        early.append(ahead < _LEADS * behind)
    if np.mean(early) <= 0.5:
        return ()
    text = "most joints move before their targets do: the columns of both seem to be swapped"
    return (Finding("refusal", "swapped_targets", "", text, "Swap them, in a map.toml."),)


def _stretches(
    recording: LogTable,
    made: Layout,
    servos: Servos,
    events: Sequence[Event],
    short: list[ShortStretch],
) -> tuple[list[ServoLog], tuple[Finding, ...]]:
    """The stretches of a recording between gaps, not yet weighed, at the first position's times.

    Those of `events` take no part; `short` is extended by those that are too short.
    """
    found, findings = clean(recording, made)
    measured = list(map(found.of, made.positions))
    sources = [s for s in made.commands if s]
    targets = [source.column for source in sources]
    wanted = list(map(found.of, sources))
    done = np.array([[column.column.startswith(FOLLOWED)] for column in targets])
    every = found.signals.values()
    t = measured[0].t
    if min(len(signal.t) for signal in every) < 10:
        short.append(ShortStretch(recording.source, (1, len(t)), float(np.ptp(t)) if len(t) else 0))
        return [], findings
    findings = (*findings, *events_stated(recording.source, events, t[0], t[-1]))
    inside = (t >= max(s.t[0] for s in every)) & (t <= min(s.t[-1] for s in measured))
    for event in events:
        inside &= (t < event.start) | (t > event.end)
    rows = np.flatnonzero(inside)
    t = t[inside]
    cuts = {0, len(t), *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist()}
    for signal in measured:
        cuts |= set(np.searchsorted(t, signals.gaps(signal)[:, 1]).tolist())
    edges = sorted(cuts)
    logs: list[ServoLog] = []
    for first, last in itertools.pairwise(edges):
        own = t[first:last]
        if len(own) < 10 or own[-1] - own[0] < _SHORTEST:
            if len(own):
                ends = rows_of(measured[0], own[0], own[-1])
                short.append(ShortStretch(recording.source, ends, float(own[-1] - own[0])))
            continue
        q = np.column_stack([np.interp(own, s.t, s.x) for s in measured])
        u = np.column_stack([signals.resample(s, own, hold=True) for s in wanted])
        q += [source.column.zero for source in made.positions]
        u += [column.zero for column in targets]
        u = np.clip(u, *servos.range.T)
        acting = followed_targets(own, u, np.where(done, 0.0, servos.profile))
        logs.append(ServoLog(recording.source, own, u, acting, q, np.empty(0), np.empty(0)))
    if len(logs) > 1:
        logs = [log._replace(source=f"{log.source} at {log.t[0]:.0f} s") for log in logs]
    return logs, findings


def weighed(model: pin.Model, log: ServoLog) -> ServoLog:
    """The log with mass matrices and loads of a model's links, without what accelerations exert.

    The model has no armatures; the log's payload, if it carries one, is part of a link.
    """
    data = model.createData()
    load = np.empty_like(log.position)
    mass = np.empty((*load.shape, load.shape[1]))
    ends = (np.clip(log.t + side, log.t[0], log.t[-1]) for side in (-_SPAN, _SPAN))
    early, late = (np.transpose([np.interp(t, log.t, x) for x in log.position.T]) for t in ends)
    v = (late - early) / (2 * _SPAN)
    still = np.zeros(load.shape[1])
    for k, at in enumerate(JointTree.links(model).position(log.position)):
        mass[k] = pin.crba(model, data, at)
        load[k] = pin.rnea(model, data, at, v[k], still)
    mass = np.triu(mass) + np.triu(mass, 1).swapaxes(1, 2)
    return log._replace(load=load, mass=mass)


def coupled(log: ServoLog, theta: Array) -> tuple[Array, ServoLog]:
    """(N, n) positions of all joints, simulated together, and the log with the loads they exert.

    The log's loads do not include accelerations; theta (n, 5) is that of `simulation.simulate`.
    """
    q = np.empty_like(log.position)
    v = np.zeros_like(log.position)
    q[0] = log.position[0]
    limit = np.full(len(theta), np.inf) if log.limit is None else log.limit
    own = log.joint(0).own(theta)
    move_arm(log.t, log.target, log.load, log.mass, limit, own, STEP, q, v)
    a = np.gradient(v, log.t, axis=0)
    others = np.einsum("kji,ki->kj", log.mass, a) - np.einsum("kjj,kj->kj", log.mass, a)
    return q, log._replace(load=log.load + others)


def without_armature(model: pin.Model) -> pin.Model:
    """A copy of a model of links alone."""
    found = pin.Model(model)
    found.armature = np.zeros(found.nv)
    return found


def settled(logs: Sequence[ServoLog]) -> Array:
    """(N,) 1, or 0 in the first 0.3 s of the stretches that begin in motion.

    A simulation begins at rest, and does not know the targets before.
    """
    found = []
    for log in logs:
        own = np.ones(len(log.t))
        since = log.t - log.t[0]
        q, later, last = (
            np.array([np.interp(k * _BEGINS, since, x) for x in log.position.T]) for k in range(3)
        )
        speed = np.sign(last - q) * (4 * later - 3 * q - last) / (2 * _BEGINS)  # of a parabola
        if (speed > _MOVES).any():
            own[since < _SETTLES] = 0.0
        found.append(own)
    return np.concatenate(found)


def late(logs: Sequence[JointLog], used: Array, delay: float) -> float:
    """Mean absolute error of the target at a delay [rad or m], of the samples (N,) in use."""
    errors = [
        log.target[np.clip(np.searchsorted(log.t, log.t - delay, side="right") - 1, 0, None)]
        - log.position
        for log in logs
    ]
    return float(np.abs(np.concatenate(errors)) @ used / used.sum())
