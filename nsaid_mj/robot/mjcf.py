"""Reads MJCF files: MuJoCo's own models, such as those of the MuJoCo Menagerie."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RobotChanged
from ..parameters import Array
from ..structure.joints import body_names
from ..structure.joints import joint_names as system_joints
from ..structure.optional import pin
from .findings import Finding
from .inertias import make_physical
from .mjcf_actuators import motors
from .mjcf_couplings import check_couplings
from .mjcf_file import compile_file
from .mjcf_tree import joint_names, rigid_tree
from .model import RobotModel
from .reduction import check_tree, home, locked_joints, reduced
from .shapes import Shapes, shapes_of_geoms

_NAMELESS = "MuJoCo Model"  # what MuJoCo calls a model without a name


def load_mjcf(
    path: Path,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    base: str | None = None,
) -> RobotModel:
    """Reads an MJCF or .mjb file.

    Its rigid tree of hinges and slides becomes Pinocchio's model, with the same mass matrix and
    bias forces.

    Args:
        path: of the file.
        lock: joints to fix, at 0 or at the limit nearest to it.
        joints: joints to keep; None keeps all that are not in `lock`.
        base: of a robot to simulate, `held` or `free`; None for one to identify, on a stand.

    Raises:
        BadRobot: MuJoCo rejects the file, or it is not a tree of hinges and slides: it has ball
            joints, or tendons or equality constraints between joints that move.
        InvalidInput: a joint is both to be locked and to be kept.
        UnknownName: there is no such joint.
    """
    mj, findings = compile_file(path)[1:]
    name = mj.names.partition(b"\0")[0].decode().replace(_NAMELESS, "") or path.stem
    whole, names = rigid_tree(mj, name), joint_names(mj)
    free = [n for n in names if whole.joints[whole.getJointId(n)].nv == 6]
    kept = free[:1] if base == "free" else []
    movable = [n for n in names if n not in free]
    locked = locked_joints(movable, [n for n in lock if n not in free], joints)
    locked |= set(free) - set(kept)
    model = reduced(whole, pin.GeometryModel(), locked, initial_pose(mj, whole, free))[0]
    check_tree(str(path), model, base)
    findings += check_couplings(str(path), mj, names, locked)
    found = motors(mj, names, tuple(system_joints(model)))
    findings += [*_held([n for n in free if n not in kept]), *_ignored_forces(mj, names, locked)]
    findings += make_physical(model, body_names(model))
    dof = [mj.jnt_dofadr[names.index(joint)] for joint in found.joints]
    first = model.nv - len(dof)  # 6 if the base is free
    model.effortLimit[first:] = np.abs(found.gain) * found.limits
    robot = RobotModel(
        name=name,
        source=path,
        kind="mjcf",
        model=model,
        joints=found.joints,
        damping=mj.dof_damping[dof] + found.damping,
        friction=mj.dof_frictionloss[dof],
        rotor=model.armature[first:].copy(),
        gain=found.gain,
        limits=found.limits,
        findings=tuple([*findings, *found.findings]),
        visuals=Shapes(model, lambda: shapes_of_geoms(mj, model)),
        file=path,
        passive=found.passive,
    )
    told = [str(f) for f in findings if f.level == "warning"]
    if base is not None and told:
        warnings.warn(RobotChanged(str(path), told), stacklevel=2)
    return robot


def initial_pose(mj: Any, model: pin.Model, free: Sequence[str]) -> Array:
    """(nq,) `home`, with the floating bodies `free` where MuJoCo's model has them at first."""
    q = home(model)
    for name in free:
        joint = model.joints[model.getJointId(name)]
        at = mj.jnt_qposadr[joint_names(mj).index(name)]
        x, y, z, qw, qx, qy, qz = mj.qpos0[at : at + 7]
        q[joint.idx_q : joint.idx_q + 7] = [x, y, z, qx, qy, qz, qw]
    return q


def _held(free: Sequence[str]) -> list[Finding]:
    text, remedy = (
        "this free joint was fixed at its initial pose",
        "Use logs of a robot on a stand.",
    )
    return [Finding("warning", "base_held", f"joint {name}", text, remedy) for name in free]


def _ignored_forces(mj: Any, names: Sequence[str], locked: set[str]) -> list[Finding]:
    """Forces of the file that the structure does not have."""
    moving = [j for j, name in enumerate(names) if name not in locked]
    dof = mj.jnt_dofadr
    springs = [names[j] for j in moving if mj.jnt_stiffness[j] or np.any(mj.jnt_stiffnesspoly[j])]
    curved = [names[j] for j in moving if np.any(mj.dof_dampingpoly[dof[j]])]
    found = [
        ("spring", "joint springs of " + ", ".join(springs), bool(springs)),
        ("damping_curve", "damping that is not linear of " + ", ".join(curved), bool(curved)),
        ("gravity_compensation", "gravity compensation (gravcomp)", bool(mj.body_gravcomp.any())),
        ("fluid", "forces of air or water", mj.opt.density > 0 or mj.opt.viscosity > 0),
    ]
    return [
        Finding("warning", code, "", f"the file has {what}; the model has none")
        for code, what, there in found
        if there
    ]
