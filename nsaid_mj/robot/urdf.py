"""Reads URDF files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from lxml import etree
from lxml.etree import _Element as Element

from ..errors import BadRobot
from ..parameters import Array
from ..structure.joints import body_names, joint_names
from ..structure.optional import coal, pin
from .findings import Finding
from .inertias import check_inertias, make_physical
from .meshes import resolve_meshes
from .mimic import Follower, mimicking, weld
from .model import RobotModel
from .reduction import check_tree, home, locked_joints, reduced
from .shapes import Shape, Shapes, shapes_of_geometry
from .urdf_checks import check_masses, check_urdf, passive_joints, warn_of_mimics
from .urdf_inertials import check_inertials

_HELD = "this floating joint was taken as fixed"
_REMEDY = "Correct the URDF; `check_urdf` of ROS may tell more."


def load_urdf(
    path: Path,
    root: Element,
    encoding: Sequence[Finding] = (),
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    base: str | None = None,
) -> RobotModel:
    """Reads a URDF.

    Args:
        path: of the file.
        root: its content, which is changed.
        encoding: findings about its encoding.
        lock: joints to fix, at 0 or at the limit nearest to it.
        joints: joints to keep; None keeps all that are not in `lock`.
        base: of a robot to simulate, `held` or `free`; None for one to identify, on a stand.

    Raises:
        BadRobot: the file describes a robot that is not a tree of revolute and prismatic joints.
        InvalidInput: a joint is both to be locked and to be kept.
        UnknownName: there is no such joint.
    """
    findings, followers = _checked(path, root, base is not None)
    findings = [*encoding, *findings, *resolve_meshes(root, path)]
    xml = etree.tostring(root, encoding="unicode")
    whole = _pinocchio(path, xml, base == "free")
    names = [name for name in list(whole.names)[1:] if name not in followers]
    locked = locked_joints(names, lock, joints)
    findings += weld(followers, set(names) - locked)
    q = _configuration(whole, followers)
    locked |= set(followers)
    floating = _floating(whole, {"free": [], "held": names[:1]}.get(base or "", names), locked)
    findings += [Finding("warning", "base_held", f"joint {name}", _HELD) for name in floating]
    locked |= floating
    model = reduced(whole, pin.GeometryModel(), locked, q)[0]
    check_tree(str(path), model, base)
    if base is not None:
        check_inertias(str(path), model)
    else:
        findings += make_physical(model, body_names(model))

    moving = tuple(joint_names(model))
    first = model.nv - len(moving)  # 6 if the base is free
    return RobotModel(
        name=model.name or path.stem,
        source=path,
        kind="urdf",
        model=model,
        joints=moving,
        damping=model.damping[first:].copy(),
        friction=model.upperDryFrictionLimit[first:].copy(),
        rotor=np.zeros(len(moving)),
        gain=np.ones(len(moving)),
        limits=_limits(model.effortLimit[first:]),
        findings=tuple(findings),
        visuals=Shapes(model, partial(_shapes, root, xml, whole, locked, q)),
        file=path,
        passive=tuple(name for name in passive_joints(root) if name in moving),
    )


def _checked(
    path: Path, root: Element, simulated: bool
) -> tuple[list[Finding], dict[str, Follower]]:
    """Checks a URDF; returns what was mended in it, and the joints that follow others."""
    check_urdf(path, root)
    if not simulated:
        return check_inertials(path, root), mimicking(path, root)
    check_masses(path, root)
    warn_of_mimics(path, root)
    return [], {}


def _limits(effort: Array) -> Array:
    """(n,) largest forces, inf where a file states none or 0."""
    return np.where(effort > 0, effort, np.inf)


def _floating(model: pin.Model, names: Sequence[str], locked: set[str]) -> set[str]:
    """The floating joints among some that are not locked."""
    return {n for n in names if model.joints[model.getJointId(n)].nv == 6} - locked


def _shapes(
    root: Element, xml: str, whole: pin.Model, locked: set[str], q: Array
) -> Iterable[Shape]:
    """The meshes of a URDF with joints locked at q (nq,); none if a mesh file is broken."""
    if root.find("link/visual/geometry/mesh") is None:
        return ()
    boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the fastest type that shows its triangles
    visual = pin.GeometryType.VISUAL
    try:
        found = pin.buildGeomFromUrdfString(whole, xml, visual, mesh_loader=boxes)
    except (ValueError, RuntimeError):
        return ()
    return shapes_of_geometry(reduced(whole, found, locked, q)[1])


def _configuration(model: pin.Model, followers: dict[str, Follower]) -> Array:
    """(nq,) `home`, with mimic joints where their leaders put them."""
    q = home(model)
    for name, follower in followers.items():
        position = follower.position(_position(model, follower.leader, q))
        if model.existJointName(name):
            own = model.joints[model.getJointId(name)]
            turned = position if own.nq == 1 else [np.cos(position), np.sin(position)]
            q[own.idx_q : own.idx_q + own.nq] = turned
    return q


def _position(model: pin.Model, joint: str, q: Array) -> float:
    """The position of a 1-DOF joint at a configuration q (nq,); 0 if it is fixed in the URDF."""
    if not model.existJointName(joint):
        return 0.0
    own = model.joints[model.getJointId(joint)]
    return float(q[own.idx_q] if own.nq == 1 else np.arctan2(q[own.idx_q + 1], q[own.idx_q]))


def _pinocchio(path: Path, xml: str, floats: bool) -> pin.Model:
    """Pinocchio's model of a URDF.

    Raises:
        BadRobot: Pinocchio cannot read it.
    """
    build, root = pin.buildModelFromXML, (pin.JointModelFreeFlyer(),) if floats else ()
    try:  # the line above is outside of it: Pinocchio may be missing
        return build(xml, *root)
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and its own
        reason = f"Pinocchio cannot read it: {error}"
        raise BadRobot(str(path), "", reason, _REMEDY) from error
