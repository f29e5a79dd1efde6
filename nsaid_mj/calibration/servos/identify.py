"""`identify_servos`: from an MJCF and logs of targets and positions to servos with intervals."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from ...errors import InvalidInput
from ...numerics.threads import single_threaded
from ...parameters import Array
from ...resources import asset
from ...robot.mjcf_file import compile_file
from ...robot.mjcf_tree import actuators_of, joint_names
from ..data import RobotModel
from ..findings import Finding
from ..logs import Map, read_map, read_tables
from ..models import load_robot_model
from .estimate import estimate
from .logs import ServoLog, read_servo_logs, servo_map
from .result import ServoIdentification
from .words import gravity_notes, parameters, servo, verdict

_MOST = 0.3  # share of masked samples above which the structure is at fault, not foreign forces


class ServoLogs(NamedTuple):
    """An arm with position servos, and logs of their targets.

    Attributes:
        robot: the model.
        logs: stretches without gaps.
        kp: (n,) stiffness of the servos in the model file [N·m/rad or N/m].
        findings: what was noticed about file and logs.
    """

    robot: RobotModel
    logs: tuple[ServoLog, ...]
    kp: Array
    findings: tuple[Finding, ...]


def servo_logs(
    model: str | Path,
    logs: Sequence[str | Path] = (),
    mapping: Path | Map | None = None,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
) -> ServoLogs | None:
    """Reads an arm and its logs; None if it is no MJCF with servos, or the logs hold no targets.

    Args:
        model: path of an MJCF file; or the name of a packed arm, whose own log is read if none are
            given.
        logs: files of targets and positions.
        mapping: map.toml, whose `command` columns are the targets; None to match by name.
        lock: joints that do not move.
        joints: the joints that move; all others are locked.

    Raises:
        NsaidError: a file cannot be read or used.
    """
    packed = asset(str(model), f"{model}.xml") if str(model) == Path(model).name else Path(model)
    if packed.is_file() and not logs:
        logs = sorted(packed.parent.glob("*.csv.gz"))
    path = packed if packed.is_file() else Path(model)
    if path.suffix.lower() != ".xml" or not path.is_file() or not logs:
        return None
    robot = load_robot_model(str(path), lock, joints)
    found = _servos(path, robot.joints) if robot.kind == "mjcf" else None
    if found is None:
        return None
    kp, limits = found
    chosen = read_map(mapping) if isinstance(mapping, Path) else mapping
    tables = read_tables(logs, chosen)
    columns = servo_map(tables, chosen, robot.joints)
    if columns is None:
        return None
    read, findings = read_servo_logs(robot, tables, columns, chosen, limits)
    own = [f for f in robot.findings if f.code != "servo"]
    return ServoLogs(robot, read, kp, (*own, *findings))


def _servos(path: Path, joints: Sequence[str]) -> tuple[Array, Array] | None:
    """(n,) kp and (n, 2) limits of the targets; None unless every joint has one position servo."""
    mj = compile_file(path)[1]
    names, kp, limits = joint_names(mj), [], []
    for joint in joints:
        own = actuators_of(mj, names.index(joint))
        if len(own) != 1 or mj.actuator_biastype[own[0]] != mujoco.mjtBias.mjBIAS_AFFINE:
            return None
        gain, bias = mj.actuator_gainprm[own[0], 0], mj.actuator_biasprm[own[0]]
        if gain <= 0 or not np.isclose(bias[1], -gain) or mj.actuator_gear[own[0], 0] != 1:
            return None
        kp.append(gain)
        limited = mj.actuator_ctrllimited[own[0]]
        limits.append(mj.actuator_ctrlrange[own[0]] if limited else [-np.inf, np.inf])
    return np.array(kp), np.array(limits, dtype=np.float64)


@single_threaded
def identify_servos(
    given: ServoLogs, told: Callable[[str], None] = lambda _: None
) -> ServoIdentification:
    """Identifies stiffness, damping, friction, armature and delay of every servo by output error.

    Args:
        given: an arm and its logs, see `servo_logs`.
        told: called with the name of every stage, for progress.

    Raises:
        InvalidInput: the logs are shorter than ten seconds together.
    """
    begin = time.perf_counter()
    length = sum(log.t[-1] - log.t[0] for log in given.logs)
    if length < 10.0:
        remedy = "Intervals need several motions."
        raise InvalidInput("log", "ten seconds of motion or more", f"{length:.1f} s", remedy)
    joints, used = estimate(given.robot, given.logs, given.kp, told)
    names = given.robot.joints
    servos = tuple(servo(name, joint) for name, joint in zip(names, joints, strict=True))
    explains, sentence, doubts = verdict(servos, joints)
    masked = float(1 - used.mean())
    notes = (*_masked(given.logs, used), *gravity_notes(servos, joints))
    return ServoIdentification(
        given.robot,
        explains,
        sentence,
        servos,
        tuple(
            p
            for k, (name, joint) in enumerate(zip(names, joints, strict=True), 1)
            for p in parameters(name, k, joint)
        ),
        masked,
        (*doubts, *notes, *given.findings),
        time.perf_counter() - begin,
    )


def _masked(logs: Sequence[ServoLog], used: Array) -> tuple[Finding, ...]:
    """Which logs have windows with foreign forces."""
    share, found, begin = float(1 - used.mean()), [], 0
    for log in logs:
        own = used[begin : begin + len(log.t)]
        begin += len(log.t)
        if not own.all():
            found.append(f"{log.source} {100 * (1 - own.mean()):.0f} %")
    if not found:
        return ()
    text = f"{100 * share:.0f} % of the samples lie in two-second windows that depart far more than"
    text += " others, as where the gripper rests on a table; they were left out: "
    remedy = "" if share < _MOST else "So many tell of a fault of the model rather than contact."
    level = "note" if share < _MOST else "warning"
    return (Finding(level, "foreign_force", "", text + ", ".join(found), remedy),)
