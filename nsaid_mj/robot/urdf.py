"""Reads URDF files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from lxml import etree
from lxml.etree import _Element as Element

from ..errors import BadRobot
from ..systems.joints import body_names, joint_names
from ..systems.optional import coal, pin
from .findings import Finding
from .inertias import check_inertias, make_physical
from .meshes import resolve_meshes
from .mimic import mimicking, weld
from .model import RobotModel
from .reduction import check_tree, home, locked_joints, reduced
from .shapes import Shape, Shapes, shapes_of_geometry
from .urdf_checks import check_masses, check_urdf, passive_joints, warn_of_mimics
from .urdf_inertials import check_inertials

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
        base: of a robot to simulate, `held` or `free`, whose inertias must be physical, and whose
            mimic joints move freely; None for one to identify, on a stand.

    Raises:
        BadRobot: the file describes a robot that is not a tree of revolute and prismatic joints.
        InvalidInput: a joint is both to be locked and to be kept.
        UnknownName: there is no such joint.
    """
    check_urdf(path, root)
    simulated, followers = base is not None, {}
    if simulated:
        check_masses(path, root)
        warn_of_mimics(path, root)
        findings = list(encoding)
    else:
        findings = [*encoding, *check_inertials(path, root)]
        followers = mimicking(path, root)
    findings += resolve_meshes(root, path)
    xml = etree.tostring(root, encoding="unicode")
    whole = _pinocchio(path, xml, base == "free")
    names = [name for name in list(whole.names)[1:] if name not in followers]
    locked = locked_joints(names, lock, joints)
    findings += weld(followers, set(names) - locked)
    q = home(whole)
    for name, follower in followers.items():
        _place(whole, name, q, follower.position(_position(whole, follower.leader, q)))
    locked |= set(followers)
    kept = [n for n in names if n not in locked and base != "free"]
    floating = [n for n in kept if whole.joints[whole.getJointId(n)].nv == 6]
    for name in floating:
        note = "this floating joint was taken as fixed"
        findings.append(Finding("warning", "base_held", f"joint {name}", note))
    locked |= set(floating)
    model = reduced(whole, pin.GeometryModel(), locked, q)[0]
    check_tree(str(path), model, floats=base == "free")
    if simulated:
        check_inertias(str(path), model)
    else:
        findings += make_physical(model, body_names(model))

    def shapes() -> Iterable[Shape]:
        """The meshes; none if a mesh file is broken."""
        if root.find("link/visual/geometry/mesh") is None:
            return ()
        boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the fastest type that shows its triangles
        visual = pin.GeometryType.VISUAL
        try:
            found = pin.buildGeomFromUrdfString(whole, xml, visual, mesh_loader=boxes)
        except (ValueError, RuntimeError):
            return ()
        return shapes_of_geometry(reduced(whole, found, locked, q)[1])

    moving = tuple(joint_names(model))
    first = model.nv - len(moving)
    effort = model.effortLimit[first:]
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
        limits=np.where(effort > 0, effort, np.inf),
        findings=tuple(findings),
        visuals=Shapes(model, shapes),
        file=path,
        passive=tuple(name for name in passive_joints(root) if name in moving),
    )


def _position(model: pin.Model, joint: str, q: np.ndarray) -> float:
    """The position of a 1-DOF joint at a configuration q (nq,); 0 if it is fixed in the URDF."""
    if not model.existJointName(joint):
        return 0.0
    own = model.joints[model.getJointId(joint)]
    return float(q[own.idx_q] if own.nq == 1 else np.arctan2(q[own.idx_q + 1], q[own.idx_q]))


def _place(model: pin.Model, joint: str, q: np.ndarray, position: float) -> None:
    """Sets the position of a 1-DOF joint in a configuration q (nq,)."""
    own = model.joints[model.getJointId(joint)]
    at = slice(own.idx_q, own.idx_q + own.nq)
    q[at] = position if own.nq == 1 else [np.cos(position), np.sin(position)]


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
