"""Reads URDF files."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import BadRobot
from ..structure.joints import body_names
from ..structure.optional import coal, pin
from .findings import Finding
from .inertias import make_physical
from .meshes import resolve_meshes
from .mimic import mimicking, weld
from .model import RobotModel
from .reduction import check_tree, home, locked_joints, reduced
from .text import read_text
from .tree import RobotVisuals
from .urdf_checks import check_urdf, parse
from .urdf_inertials import check_inertials

_REMEDY = "Correct the URDF; `check_urdf` of ROS may tell more."


def load_urdf(
    path: Path, lock: Sequence[str] = (), joints: Sequence[str] | None = None
) -> RobotModel:
    """Reads a URDF file; its base is fixed to the world.

    Args:
        path: of the file.
        lock: joints to fix, at 0 or at the limit nearest to it.
        joints: joints to keep; None keeps all that are not in `lock`.

    Raises:
        BadRobot: the file cannot be read, or describes a robot that is not a tree of revolute and
            prismatic joints.
        InvalidInput: a joint is both to be locked and to be kept.
        UnknownName: there is no such joint.
    """
    text, encoding = read_text(path)
    root = parse(path, text)
    check_urdf(path, root)
    findings = [*encoding, *check_inertials(path, root), *resolve_meshes(root, path)]
    followers = mimicking(path, root)
    xml = ElementTree.tostring(root, encoding="unicode")
    whole = _pinocchio(path, xml)
    names = [name for name in list(whole.names)[1:] if name not in followers]
    locked = locked_joints(names, lock, joints)
    findings += weld(followers, set(names) - locked)
    q = home(whole)
    for name, follower in followers.items():
        _place(whole, name, q, follower.position(_position(whole, follower.leader, q)))
    locked |= set(followers)
    floating = [n for n in names if whole.joints[whole.getJointId(n)].nv == 6 and n not in locked]
    for name in floating:
        note = "this floating joint was taken as fixed"
        findings.append(Finding("warning", "base_held", f"joint {name}", note))
    drawing = Drawing(path, xml, whole, locked | set(floating), q)
    model = drawing.model
    check_tree(str(path), model)
    findings += make_physical(model, body_names(model))
    return RobotModel(
        name=model.name or path.stem,
        source=path,
        kind="urdf",
        model=model,
        joints=tuple(model.names)[1:],
        damping=model.damping.copy(),
        friction=model.upperDryFrictionLimit.copy(),
        rotor=np.zeros(model.nv),
        gain=np.ones(model.nv),
        limits=np.where(model.effortLimit > 0, model.effortLimit, np.inf),
        findings=tuple(findings),
        visuals=RobotVisuals(drawing) if _has_meshes(root) else None,
    )


def _has_meshes(root: ElementTree.Element) -> bool:
    return root.find("link/visual/geometry/mesh") is not None


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


def _pinocchio(path: Path, xml: str) -> pin.Model:
    """Pinocchio's model of a URDF.

    Raises:
        BadRobot: Pinocchio cannot read it.
    """
    build = pin.buildModelFromXML  # outside of `try`: Pinocchio may be missing
    try:
        return build(xml)
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and its own
        reason = f"Pinocchio cannot read it: {error}"
        raise BadRobot(str(path), "", reason, _REMEDY) from error


class Drawing:
    """A URDF's kinematics and its visual meshes, which are loaded on first access.

    Args:
        path: of the URDF file.
        xml: the URDF with absolute paths of meshes.
        whole: its model.
        locked: names of the joints to lock.
        q: (nq,) the configuration at which they are locked.

    Attributes:
        model: the model with locked joints.
    """

    def __init__(self, path: Path, xml: str, whole: pin.Model, locked: set[str], q: np.ndarray):
        self._path, self._xml, self._whole, self._locked, self._q = path, xml, whole, locked, q
        self.model = reduced(whole, pin.GeometryModel(), locked, q)[0]

    @cached_property
    def visual(self) -> pin.GeometryModel:
        """Pinocchio's visual geometry; empty if a mesh file is broken."""
        boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the fastest type that shows its triangles
        try:
            shapes = pin.buildGeomFromUrdfString(
                self._whole, self._xml, pin.GeometryType.VISUAL, mesh_loader=boxes
            )
        except (ValueError, RuntimeError):
            return pin.GeometryModel()
        return reduced(self._whole, shapes, self._locked, self._q)[1]
