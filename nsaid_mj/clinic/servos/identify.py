"""`identify_servos`: servos with intervals, from an MJCF and logs of targets and positions."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base import Finding, InvalidInput, single_threaded
from ...core import Array
from ...lab import followed_targets
from ...robots import RobotModel, mjcf_of
from ..identify.choose.servo_effects import hidden_profile
from ..identify.links import carrier, check_loads
from ..identify.loads import Load
from ..identify.models import load_robot_model
from ..logs.layout import apart, with_servos
from ..logs.mapping import Map, read_map
from ..logs.matching import named
from ..logs.tables import LogTable, read_tables
from .estimate import JointEstimate, estimate
from .fit import DELAY, clusters
from .logs import ServoLog, ServoLogs, read_servo_logs, servo_map, settled
from .result import (
    LeftOut,
    ServoIdentification,
    gravity_notes,
    masses,
    parameters,
    saturation_notes,
    servo,
    verdict,
    weighed,
)

_MOST = 0.3  # share of masked samples that points to the structure rather than external forces

_TRADED = 1e-3  # that an unstated profile trades with a delay, on simulated arms [s]


def servo_logs(
    model: str | Path,
    logs: Sequence[str | Path] = (),
    mapping: Path | Map | None = None,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    loads: Sequence[Load] = (),
) -> ServoLogs | None:
    """Reads an arm and its logs; None if it is no MJCF with servos, or the logs hold no targets.

    Args:
        model: path of an MJCF file; or the name of a packed arm, whose own log is read if none are
            given.
        logs: files of targets and positions.
        mapping: map.toml, whose `command` columns are the targets; None to match by name.
        lock: joints that do not move.
        joints: the joints that move; all others are locked.
        loads: one weighed load, with every log that carries it.

    Raises:
        NsaidError: a file cannot be read or used.
    """
    path = mjcf_of(str(model))
    if path is not None and not logs:
        logs = sorted(path.parent.glob("*.csv.gz"))
    if path is None or not logs:
        return None
    chosen = read_map(mapping) if isinstance(mapping, Path) else mapping
    robot = load_robot_model(str(path), lock, joints)
    return read_servos(robot, read_tables(logs, chosen), chosen, loads)


def read_servos(
    robot: RobotModel,
    tables: Sequence[LogTable],
    mapping: Map | None = None,
    loads: Sequence[Load] = (),
) -> ServoLogs | None:
    """The logs of an arm's servos; None if it has none, or the tables hold no targets.

    See `servo_logs`.

    Raises:
        InvalidInput: a column or joint of the map does not exist, or loads differ.
        UnusableLog: no stretch lasts two seconds, or positions are in another unit.
    """
    tables = apart(mapping, robot, tables)
    if with_servos(mapping or Map(), robot, tables).pd is not None:
        return None  # it walks: contact forces are unknown, and its motion cannot be simulated
    found = None if set(robot.passive) - {*robot.followers} else robot.servos
    columns = (
        servo_map(tables, mapping, [j for j in named(robot) if j in robot.leaders])
        if found is not None
        else None
    )
    if found is None or columns is None:
        return None
    if robot.followers:
        remedy = f"Lock them, if their inertia is small: `--lock {','.join(robot.followers)}`."
        raise InvalidInput("servos", "joints that move by themselves", "joints that follow", remedy)
    check_loads(loads, [table.source for table in tables])
    kinds = {load._replace(source="") for load in loads}
    carrying = {load.source for load in loads}
    if len(kinds) > 1:
        remedy = "Give logs of one load, in one place."
        raise InvalidInput("--load", "one load of a servo arm", f"{len(kinds)} of them", remedy)
    stated = [columns[joint].profile or (mapping or Map()).profile for joint in robot.joints]
    rows = zip(stated, found.profile, strict=True)
    profile = [(own.speed, own.acceleration, own.lag) if own else row for own, row in rows]
    found = found._replace(profile=np.array(profile))
    robot = replace(robot, servos=found)
    read, findings = read_servo_logs(robot, tables, columns, mapping, carrying)
    own = [f for f in robot.findings if f.code != "servo"]
    in_order = tuple(sorted(read, key=lambda log: log.loaded))  # free ones first
    return ServoLogs(robot, in_order, found.kp, (*own, *findings), next(iter(kinds), None))


@single_threaded
def identify_servos(
    given: ServoLogs, report: Callable[[str], None] = lambda _: None
) -> ServoIdentification:
    """Identifies stiffness, damping, friction, armature and delay of every servo by output error.

    `given` is from `servo_logs`; `report` is called with the name of every stage, for progress.

    Raises:
        InvalidInput: the logs without a load are shorter than ten seconds together.
    """
    begin = time.perf_counter()
    length = sum(log.t[-1] - log.t[0] for log in given.logs if not log.loaded)
    if length < 10.0:
        short = [f"{f.text}." for f in given.findings if f.code == "short_stretch"]
        remedy = " ".join([*short, "Intervals need several motions."])
        raise InvalidInput("log", "ten seconds of motion or more", f"{length:.1f} s", remedy)
    report("looking for a profile of the targets")
    given, profile = _with_profile(given)
    found = estimate(given, report)
    if profile:
        found = found._replace(joints=tuple(j.widened(DELAY, _TRADED) for j in found.joints))
    joints = found.joints
    used = found.used
    own = tuple(p for k, j in enumerate(joints, 1) for p in parameters(k, j, found.scale))
    explains, sentence, doubts = verdict(joints, loaded=found.scale is not None)
    notes = [*_masked(given.logs, used), *gravity_notes(joints), *saturation_notes(joints)]
    if given.load is not None and found.scale is not None:
        carrying = joints[carrier(given.robot.model, given.load)[0] - 1].name
        notes.append(weighed(given.load, carrying, found.scale))
    return ServoIdentification(
        explains=explains,
        verdict=sentence,
        parameters=own,
        findings=(*doubts, *profile, *found.findings, *notes, *given.findings),
        robot=given.robot,
        servos=tuple(servo(joint, found.scale) for joint in joints),
        scale=masses(found.scale),
        used=used,
        seconds=time.perf_counter() - begin,
        joints=joints,
        left_out=() if given.load is not None else _left_out(given.logs, joints),
    )


def _left_out(logs: Sequence[ServoLog], joints: Sequence[JointEstimate]) -> tuple[LeftOut, ...]:
    """The logs, or halves of few, with the servos as identified without them.

    They are found by the Gauss–Newton steps of the jackknife, whose clusters a part contains.
    """
    cluster = clusters(logs)
    found = []
    begin = 0
    for number, log in enumerate(logs):
        own = cluster[begin : begin + len(log.t)]
        begin += len(log.t)
        count = int(own[-1] - own[0]) + 1
        middle = int(np.searchsorted(own, own[0] + count // 2)) if count > 1 else len(own)
        for rows in (slice(0, middle), slice(middle, len(own))):
            if rows.start == rows.stop:
                continue
            part = np.unique(own[rows])
            steps = [np.clip(j.without[part].sum(axis=0), -_FARTHEST, _FARTHEST) for j in joints]
            without = [j._replace(x=j.x + s) for j, s in zip(joints, steps, strict=True)]
            found.append(LeftOut(number, rows, tuple(servo(j, None) for j in without)))
    return tuple(found)


_FARTHEST = 1.0  # step of ln θ


_NO_TORQUE = (
    "Laws identify a motion from forces; a servo's log has none, and its velocity is too coarse "
    "between two rows."
)


def check_servo_options(law: str, **others: object) -> None:
    """Checks that no option of logs of forces was given with logs of targets.

    Those of `others`, by name, must be empty.

    Raises:
        InvalidInput: one was.
    """
    logs = "with logs of targets and positions"
    for name, value in others.items():
        if value is not None and value != {}:
            raise InvalidInput(f"--{name}", f"no such option {logs}", value, "Leave it out.")
    if law != "batch":
        raise InvalidInput("--law", f"batch {logs}", law, _NO_TORQUE)


def _with_profile(given: ServoLogs) -> tuple[ServoLogs, tuple[Finding, ...]]:
    """The arm and its logs with the targets' profile that the logs show, if none was stated."""
    servos = given.robot.servos
    assert servos is not None  # as the logs are of targets
    if servos.profile.any():
        return given, ()
    found, said = hidden_profile([log for log in given.logs if not log.loaded])
    every = servos.profile + found
    logs = tuple(
        log._replace(target=followed_targets(log.t, log.issued, every)) for log in given.logs
    )
    robot = replace(given.robot, servos=servos._replace(profile=every))
    return given._replace(robot=robot, logs=logs) if said else given, said


def _masked(logs: Sequence[ServoLog], used: Array) -> tuple[Finding, ...]:
    """Reports the logs that have windows with external forces."""
    used = np.where(settled(logs) > 0, used, 1.0)
    share = float(1 - used.mean())
    found = []
    begin = 0
    for log in logs:
        own = used[begin : begin + len(log.t)]
        begin += len(log.t)
        if not own.all():
            found.append(f"{log.source} {100 * (1 - own.mean()):.0f} %")
    if not found:
        return ()
    text = f"{100 * share:.0f} % of the samples lie in two-second windows with far larger residuals"
    text += " than others, as when the gripper rests on a table; they were excluded: "
    remedy = "" if share < _MOST else "So many indicate a wrong model rather than contact."
    level = "note" if share < _MOST else "warning"
    return (Finding(level, "foreign_force", "", text + ", ".join(found), remedy),)
