"""Logs of (target, position): channels, clocks and gaps, and each joint's gravity and inertia."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import InvalidInput
from ...parameters import Array
from ...structure.optional import pin
from ..data import RobotModel
from ..findings import Finding, UnusableLog
from ..links import positions
from ..logs import Map, signals
from ..logs.cleaning import Recording, clean
from ..logs.joining import join
from ..logs.layout import Layout, Source
from ..logs.mapping import Column, Joint
from ..logs.matching import candidates, match_targets
from ..logs.tables import Table
from ..logs.units import FACTORS
from .simulation import JointLog

_SHORTEST = 2.0  # shorter stretches between gaps are left out [s]


class ServoLog(NamedTuple):
    """A stretch of a log without gaps, of an arm with n joints.

    Attributes:
        source: name of the file.
        t: (N,) times [s].
        target: (N, n) of the servos [rad or m], clipped to their `ctrlrange`.
        position: (N, n) measured [rad or m].
        load: (N, n) torque or force that gravity, and the other joints' motion where it is known,
            ask of each joint [N·m or N].
        inertia: (N, n) diagonal of the mass matrix without armatures [kg·m² or kg].
    """

    source: str
    t: Array
    target: Array
    position: Array
    load: Array
    inertia: Array

    def joint(self, j: int) -> JointLog:
        """What the simulation of one joint needs."""
        columns = (self.target, self.position, self.load, self.inertia)
        return JointLog(self.t, *(np.ascontiguousarray(part[:, j]) for part in columns))


def servo_map(
    tables: Sequence[Table], mapping: Map | None, joints: Sequence[str]
) -> dict[str, Joint] | None:
    """Position and target columns of every joint; None if the log holds no targets.

    A map holds targets if the unit of each `command` is one of positions; without a map, channels
    are matched by name, and a log that holds torques or currents as well counts as one of them.
    """
    if mapping is not None and mapping.joints:
        units = {joint.command.unit for joint in mapping.joints.values()}
        return dict(mapping.joints) if units <= set(FACTORS["position"]) else None
    channels = list(dict.fromkeys(name for table in tables for name in table.channels))
    found = candidates(channels, joints)
    targets = match_targets(channels, joints)
    measured = [
        g for g in found["position"].values() if not set(g.values()) & set(targets.values())
    ]
    if not targets or len(measured) != 1 or _torques(found["command"], targets):
        return None
    return {
        joint: Joint(
            position=Column(column=measured[0][joint]), command=Column(column=targets[joint])
        )
        for joint in joints
    }


def _torques(commands: dict[str, dict[str, str]], targets: dict[str, str]) -> bool:
    return any(not set(group.values()) & set(targets.values()) for group in commands.values())


def read_servo_logs(
    robot: RobotModel,
    tables: Sequence[Table],
    columns: dict[str, Joint],
    mapping: Map | None,
    limits: Array,
) -> tuple[tuple[ServoLog, ...], tuple[Finding, ...]]:
    """The stretches of logs, and what was done to the data.

    Args:
        robot: a tree of joints with a position servo on each.
        tables: of the files.
        columns: of every joint, see `servo_map`.
        mapping: may hold the files' clocks.
        limits: (n, 2) least and largest target of every servo; ±inf without limit.

    Raises:
        InvalidInput: a column or joint of the map does not exist.
        UnusableLog: no stretch lasts two seconds.
    """
    made = _layout(columns, robot.joints)
    names = [source.column.column for source in made.sources]
    known = {name for table in tables for name in table.channels}
    for name in names:
        if name not in known:
            raise InvalidInput("map: column", "a column of the log", name, "Correct map.toml.")
    recordings, findings = join(tables, mapping or Map(), names)
    logs: list[ServoLog] = []
    for recording in recordings:
        stretches, said = _stretches(robot, recording, made, limits)
        logs += stretches
        findings += said
    if not logs:
        text = f"no stretch of {_SHORTEST:g} s has all targets and positions"
        refusal = Finding("refusal", "short_log", "", text, "Record a longer log.")
        raise UnusableLog((*findings, refusal))
    return tuple(logs), tuple(findings)


def _layout(columns: dict[str, Joint], joints: Sequence[str]) -> Layout:
    """The layout with targets, which are converted as positions are, in place of commands."""
    for name in set(columns) ^ set(joints):
        remedy = f"The robot's actuated joints are {', '.join(joints)}."
        raise InvalidInput("map: joints", "one entry for each actuated joint", name, remedy)
    parts = [(columns[j].position, columns[j].command) for j in joints]
    measured, wanted = zip(*parts, strict=True)
    return Layout(
        tuple(Source("position", c, c.factor("position"), angle=True) for c in measured),
        (),
        tuple(Source("command", c, c.factor("position")) for c in wanted),
    )


def _stretches(
    robot: RobotModel, recording: Recording, made: Layout, limits: Array
) -> tuple[list[ServoLog], tuple[Finding, ...]]:
    """The stretches of a recording between gaps, at the times of the first position's rows."""
    found, findings = clean(recording, made)
    measured = [found[source.column.column] for source in made.positions]
    wanted = [found[source.column.column] for source in made.commands]
    if min(len(signal.t) for signal in found.values()) < 10:
        return [], findings
    t = measured[0].t
    inside = (t >= max(s.t[0] for s in found.values())) & (t <= min(s.t[-1] for s in measured))
    t = t[inside]
    cuts = {0, len(t)}
    for signal in measured:
        cuts |= set(np.searchsorted(t, signals.gaps(signal)[:, 1]).tolist())
    edges = sorted(cuts)
    logs = []
    for first, last in itertools.pairwise(edges):
        own = t[first:last]
        if len(own) < 10 or own[-1] - own[0] < _SHORTEST:
            continue
        q = np.column_stack([np.interp(own, s.t, s.x) for s in measured])
        u = np.column_stack([signals.resample(s, own, hold=True) for s in wanted])
        q += [source.column.offset for source in made.positions]
        u += [source.column.offset for source in made.commands]
        u = np.clip(u, limits[:, 0], limits[:, 1])
        logs.append(ServoLog(recording.source, own, u, q, *_loads(robot, q)))
    return logs, findings


def _loads(robot: RobotModel, q: Array) -> tuple[Array, Array]:
    """(N, n) gravity and (N, n) diagonal of the mass matrix of the model file's links."""
    model = _without_armature(robot)
    data, load, inertia = model.createData(), np.empty_like(q), np.empty_like(q)
    for k, at in enumerate(positions(model, q)):
        load[k] = pin.computeGeneralizedGravity(model, data, at)
        inertia[k] = np.diag(pin.crba(model, data, at))
    return load, inertia


def coupled(robot: RobotModel, log: ServoLog, q: Array) -> ServoLog:
    """The log with the loads of a simulated motion: gravity, and what joints exert on each other.

    Args:
        robot: whose links they are.
        log: of targets and positions.
        q: (N, n) simulated positions [rad or m].
    """
    model = _without_armature(robot)
    v = np.gradient(q, log.t, axis=0)
    a = np.gradient(v, log.t, axis=0)
    data, load = model.createData(), -log.inertia * a
    for k, at in enumerate(positions(model, q)):
        load[k] += pin.rnea(model, data, at, v[k], a[k])
    return log._replace(load=load)


def _without_armature(robot: RobotModel) -> pin.Model:
    model = pin.Model(robot.model)
    model.armature = np.zeros(model.nv)
    return model
