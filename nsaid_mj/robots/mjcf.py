"""Reads MJCF files: MuJoCo's own models, such as those of the MuJoCo Menagerie."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..base import Finding, pin
from ..core import Array, JointTree
from .errors import BadRobot, RobotChanged
from .inertias import make_physical
from .mjcf_file import compile_file
from .model import (
    MimicLaw,
    RobotModel,
    check_tree,
    coupled,
    home,
    locked_joints,
    reduced,
    resolved,
)
from .shapes import Shapes, shapes_of_geoms
from .tree import actuators_of, joint_names, motor_name, motors, position_servos, rigid_tree

_NAMELESS = "MuJoCo Model"  # MuJoCo's name of a model without one
_HELD = (
    "this free joint was fixed at its initial pose",
    "Use logs of a robot on a stand, or log its IMU, too.",
)


def load_mjcf(
    path: Path,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    base: str | None = None,
    floating: bool = False,
) -> RobotModel:
    """Reads an MJCF or .mjb file.

    Its rigid tree of hinges and slides becomes Pinocchio's model, with the same mass matrix and
    bias forces. `base` is None for a robot to identify; `floating` keeps the base's free joint. The
    other arguments, and what it raises, are those of `load_tree`: of ball joints, and of tendons
    and equality constraints between joints that move, it raises `BadRobot`.
    """
    mj, findings = compile_file(path)[1:]
    name = mj.names.partition(b"\0")[0].decode().replace(_NAMELESS, "") or path.stem
    whole = rigid_tree(mj, name)
    names = joint_names(mj)
    free = [n for n in names if whole.joints[whole.getJointId(n)].nv == 6]
    held = free[1:] if floating else free
    movable = [n for n in names if n not in free]
    laws = {} if base is not None else joint_laws(str(path), mj, names)
    if joints is not None:  # what follows a joint moves with it
        led = [f for f, law in laws.items() if law.leader in joints and f not in {*lock, *joints}]
        joints = [*joints, *led]
    locked = locked_joints(movable, [n for n in lock if n not in free], joints)
    locked |= set(held)
    model = reduced(whole, pin.GeometryModel(), locked, initial_pose(mj, whole, free))[0]
    check_tree(str(path), model, base, floating)
    laws = {f: law for f, law in laws.items() if f in locked or law.leader not in locked}
    findings += check_couplings(str(path), mj, names, locked, laws)
    tree = JointTree.links(model)
    moving = tuple(tree.joint_names)
    gain, limits, damping, passive, said = motors(mj, names, moving)
    findings += [Finding("warning", "base_held", f"joint {n}", *_HELD) for n in held]
    findings += [*_ignored_forces(mj, names, locked), *make_physical(model, tree.body_names)]
    dof = [mj.jnt_dofadr[names.index(joint)] for joint in moving]
    first = model.nv - len(dof)  # 6 if the base is free
    model.effortLimit[first:] = np.abs(gain) * limits
    servos = position_servos(mj, names, [j for j in moving if j not in {*passive, *laws}])
    said = [f for f in said if f.code != "no_actuator" or not set(f.where.split(", ")) <= {*laws}]
    robot = RobotModel(
        name=name,
        source=path,
        kind="mjcf",
        model=model,
        joints=moving,
        damping=mj.dof_damping[dof] + damping,
        friction=mj.dof_frictionloss[dof],
        rotor=model.armature[first:].copy(),
        gain=gain,
        limits=limits,
        findings=tuple([*findings, *said]),
        visuals=Shapes(model, lambda: shapes_of_geoms(mj, model)),
        file=path,
        passive=passive,
        servos=servos,
        motors=tuple(motor_name(mj, names.index(joint)) for joint in moving),
    )
    mixed = [] if servos is not None else [f for f in said if f.code == "servo"]
    warned = [str(f) for f in [*findings, *mixed] if f.level == "warning"]
    if base is not None and warned:
        warnings.warn(RobotChanged(str(path), warned), stacklevel=2)
    return coupled(robot, laws)


def initial_pose(mj: Any, model: pin.Model, free: Sequence[str]) -> Array:
    """(nq,) `home`, with the floating bodies `free` where MuJoCo's model initially has them."""
    q = home(model)
    for name in free:
        joint = model.joints[model.getJointId(name)]
        at = mj.jnt_qposadr[joint_names(mj).index(name)]
        x, y, z, qw, qx, qy, qz = mj.qpos0[at : at + 7]
        q[joint.idx_q : joint.idx_q + 7] = [x, y, z, qx, qy, qz, qw]
    return q


def _ignored_forces(mj: Any, names: Sequence[str], locked: set[str]) -> list[Finding]:
    """Forces of the file that the structure lacks."""
    moving = [j for j, name in enumerate(names) if name not in locked]
    dof = mj.jnt_dofadr
    springs = [names[j] for j in moving if mj.jnt_stiffness[j] or np.any(mj.jnt_stiffnesspoly[j])]
    curved = [names[j] for j in moving if np.any(mj.dof_dampingpoly[dof[j]])]
    found = {
        "spring": springs and "joint springs of " + ", ".join(springs),
        "damping_curve": curved and "damping that is not linear of " + ", ".join(curved),
        "gravity_compensation": mj.body_gravcomp.any() and "gravity compensation (gravcomp)",
        "fluid": (mj.opt.density > 0 or mj.opt.viscosity > 0) and "forces of air or water",
    }
    text = "the file has {}; the model has none"
    return [Finding("warning", code, "", text.format(x)) for code, x in found.items() if x]


_TENDON = mujoco.mjtTrn.mjTRN_TENDON
_OF_JOINTS = mujoco.mjtWrap.mjWRAP_JOINT


def joint_laws(robot: str, mj: Any, names: Sequence[str]) -> dict[str, MimicLaw]:
    """The joints that follow another one by an equality constraint that is a straight line.

    The leader is the one with an actuator, by default the constraint's second joint. Constraints of
    two joints with actuators are left out.
    """
    laws: dict[str, MimicLaw] = {}
    for e in range(mj.neq):
        pair = int(mj.eq_obj1id[e]), int(mj.eq_obj2id[e])
        start, slope, *curve = mj.eq_data[e, :5].tolist()
        of_joints = mujoco.mjtEq(mj.eq_type[e]) == mujoco.mjtEq.mjEQ_JOINT
        if not (mj.eq_active0[e] and of_joints and min(pair) >= 0) or slope == 0 or any(curve):
            continue
        driven = [bool(actuators_of(mj, j)) for j in pair]
        if all(driven):
            continue
        zero = [float(mj.qpos0[mj.jnt_qposadr[j]]) for j in pair]
        offset = zero[0] + start - slope * zero[1]
        if driven[0]:  # q1 = slope · q2 + offset, the other way round
            laws[names[pair[1]]] = MimicLaw(names[pair[0]], 1 / slope, -offset / slope)
        else:
            laws[names[pair[0]]] = MimicLaw(names[pair[1]], slope, offset)
    return resolved(robot, laws)


def check_couplings(
    robot: str,
    mj: Any,
    names: Sequence[str],
    locked: set[str],
    laws: Mapping[str, MimicLaw],
) -> list[Finding]:
    """Checks that no equality constraint, and no tendon by a spring or actuator, couples joints.

    `laws` are those of joints that follow others, whose constraints are part of the structure.
    Returns warnings of tendons between moving joints that have inertia or friction only, as of a
    motor that two joints share, and notes of tendons that only limit the motion.

    Raises:
        BadRobot: names the tendon or constraint, and the joints to lock.
    """
    for e in range(mj.neq):
        followed = {names[j] for j in _of_equality(mj, e)} & {*laws}
        if mj.eq_active0[e] and not followed:
            _refuse(
                robot,
                "equality constraint",
                mj.eq(e).name or str(e),
                [names[j] for j in sorted(_of_equality(mj, e))],
                locked,
            )
    found = []
    for t in range(mj.ntendon):
        name = mj.tendon(t).name or str(t)
        joints = [names[j] for j in sorted(_of_tendon(mj, t))]
        if _acts(mj, t):
            _refuse(robot, "tendon", name, joints, locked)
        elif mj.tendon_limited[t]:
            text = "this tendon only limits the motion, and was ignored"
            remedy = "Leave out rows in which it is taut, if there are any."
            found.append(Finding("note", "limit_tendon", name, text, remedy))
        elif _drags(mj, t) and len(set(joints) - locked) > 1:
            text = (
                f"inertia and friction of this tendon are left out; it couples {', '.join(joints)}"
            )
            remedy = "Name the coupling of the joints in the map."
            found.append(Finding("warning", "tendon", name, text, remedy))
    return found


def _refuse(robot: str, kind: str, name: str, joints: list[str], locked: set[str]) -> None:
    moving = [joint for joint in joints if joint not in locked]
    if moving:
        couples = f"it couples {', '.join(joints)}"
        reason = f"{couples}; only joints that move by themselves can be identified"
        remedy = (
            f"Lock them if they stood still in the log, `--lock {','.join(moving)}`, or remove the "
            f"{kind} from a copy of the file."
        )
        raise BadRobot(robot, f"{kind} {name}", reason, remedy)


def _of_equality(mj: Any, e: int) -> set[int]:
    """The joints that an equality constraint acts on."""
    kind = mujoco.mjtEq(mj.eq_type[e])
    one = mj.eq_obj1id[e]
    two = mj.eq_obj2id[e]
    if kind == mujoco.mjtEq.mjEQ_JOINT:
        return {int(j) for j in (one, two) if j >= 0}
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        return set().union(*(_of_tendon(mj, t) for t in (one, two) if t >= 0))
    if kind in {mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD}:
        sites = mj.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE
        bodies = [int(mj.site_bodyid[o]) if sites else int(o) for o in (one, two)]
        return _between(mj, bodies)
    return set(range(mj.njnt))  # of flexible bodies


def _acts(mj: Any, t: int) -> bool:
    """Whether a tendon can exert a force on joints at rest that are within its limits."""
    driven = (mj.actuator_trntype == _TENDON) & (mj.actuator_trnid[:, 0] == t)
    taut = np.any(mj.tendon_stiffness[t]) or driven.any()
    return bool(taut or (_drags(mj, t) and mj.wrap_type[mj.tendon_adr[t]] != _OF_JOINTS))


def _drags(mj: Any, t: int) -> bool:
    """Whether a tendon has inertia or friction."""
    numbers = (mj.tendon_damping, mj.tendon_frictionloss, mj.tendon_armature)
    return any(np.any(x[t]) for x in numbers)


def _of_tendon(mj: Any, t: int) -> set[int]:
    """The joints that change a tendon's length."""
    wraps = range(mj.tendon_adr[t], mj.tendon_adr[t] + mj.tendon_num[t])
    if mj.wrap_type[wraps[0]] == _OF_JOINTS:
        return {int(mj.wrap_objid[w]) for w in wraps}
    bodies = []
    for w in wraps:
        kind = mujoco.mjtWrap(mj.wrap_type[w])
        if kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(int(mj.site_bodyid[mj.wrap_objid[w]]))
        elif kind in {mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER}:
            bodies.append(int(mj.geom_bodyid[mj.wrap_objid[w]]))
    return _between(mj, bodies)


def _between(mj: Any, bodies: Sequence[int]) -> set[int]:
    """The joints that move some bodies relative to each other."""
    chains = []
    for body in bodies:
        chain = set()
        b = body
        while b:
            first = int(mj.body_jntadr[b])
            chain |= set(range(first, first + int(mj.body_jntnum[b])))
            b = int(mj.body_parentid[b])
        chains.append(chain)
    return set().union(*chains) - set.intersection(*chains) if chains else set()
