"""URDF files in and out: read as a tree of joints, and written with identified numbers.

Pinocchio's torque regressor does not support mimic joints: to it they move by themselves, and their
coupling is data of the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree
from lxml.etree import SubElement
from lxml.etree import _Element as Element

from ..base import Finding, InvalidInput, pin, require
from ..core import Array, JointTree
from .errors import BadRobot
from .inertias import check_inertias, make_physical
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
from .shapes import Shape, Shapes, resolve_meshes, shapes_of_geometry
from .urdf_checks import (
    ENTRIES,
    check_inertials,
    check_masses,
    check_urdf,
    end_of,
    passive_joints,
    warn_of_mimics,
)
from .xml import numbers, read_xml, write_xml

if TYPE_CHECKING:
    from .identified import Identified

_HELD = "this floating joint was taken as fixed"
_REMEDY = "Correct the URDF; `check_urdf` of ROS may say more."


def load_urdf(
    path: Path,
    root: Element,
    encoding: Sequence[Finding] = (),
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    base: str | None = None,
    floating: bool = False,
) -> RobotModel:
    """Reads a URDF.

    `root` is changed; `encoding` holds findings about it. `base` is None for a robot to identify;
    with `floating` its root floats. The other arguments, and what it raises, are those of
    `load_tree`.
    """
    check_urdf(path, root)
    followers = {}
    findings = [*encoding]
    if base is None:
        followers = mimicking(path, root)
        findings += check_inertials(path, root)
    else:
        check_masses(path, root)
        warn_of_mimics(path, root)
    findings += resolve_meshes(root, path)
    whole = _pinocchio(path, xml := etree.tostring(root, encoding="unicode"), floating)
    names = [name for name in list(whole.names)[1:] if name not in followers]
    held = followers.keys() & set(lock)
    jointed = names[1:] if floating else names  # the root's own joint is none of the file
    locked = held | locked_joints(jointed, [name for name in lock if name not in held], joints)
    still = {name for name, law in followers.items() if law.leader not in set(names) - locked}
    q = _configuration(whole, followers)
    may_float = jointed
    if base is not None:
        may_float = [] if floating else names[:1]
    bases = {n for n in may_float if whole.joints[whole.getJointId(n)].nv == 6} - locked
    findings += [Finding("warning", "base_held", f"joint {name}", _HELD) for name in bases]
    locked |= bases | still
    model = reduced(whole, pin.GeometryModel(), locked, q)[0]
    check_tree(str(path), model, base, floating)
    tree = JointTree.links(model)
    if base is not None:
        check_inertias(str(path), model)
    else:
        findings += make_physical(model, tree.body_names)
    moving = tuple(tree.joint_names)
    first = model.nv - len(moving)  # 6 if the base is free
    robot = RobotModel(
        name=model.name or path.stem,
        source=path,
        kind="urdf",
        model=model,
        joints=moving,
        damping=model.damping[first:].copy(),
        friction=model.upperDryFrictionLimit[first:].copy(),
        rotor=np.zeros(len(moving)),
        gain=np.ones(len(moving)),
        limits=np.where((effort := model.effortLimit[first:]) > 0, effort, np.inf),
        findings=tuple(findings),
        visuals=Shapes(model, partial(_shapes, root, xml, whole, locked, q)),
        file=path,
        passive=tuple(name for name in passive_joints(root) if name in moving),
    )
    return coupled(robot, followers)


def _shapes(
    root: Element, xml: str, whole: pin.Model, locked: set[str], q: Array
) -> Iterable[Shape]:
    """The meshes of a URDF with joints locked at q (nq,); none if a mesh file is broken."""
    if root.find("link/visual/geometry/mesh") is None:
        return ()
    coal = require("coal", "arms", "A robot with joints")
    boxes = coal.MeshLoader(coal.NODE_TYPE.BV_OBB)  # the fastest type that shows its triangles
    visual = pin.GeometryType.VISUAL
    try:
        found = pin.buildGeomFromUrdfString(whole, xml, visual, mesh_loader=boxes)
    except (ValueError, RuntimeError):
        return ()
    return shapes_of_geometry(reduced(whole, found, locked, q)[1])


def _configuration(model: pin.Model, followers: dict[str, MimicLaw]) -> Array:
    """(nq,) `home`, with mimic joints at their leaders' positions."""
    q = home(model)
    for name, follower in followers.items():
        leader, multiplier, offset = follower
        position = multiplier * _position(model, leader, q) + offset
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
    """Pinocchio's model of a URDF; raises `BadRobot` if Pinocchio cannot read it."""
    build = pin.buildModelFromXML
    root = (pin.JointModelFreeFlyer(),) if floats else ()
    try:  # without the line above: Pinocchio may be missing
        return build(xml, *root)
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and its own
        reason = f"Pinocchio cannot read it: {error}"
        raise BadRobot(str(path), "", reason, _REMEDY) from error


def mimicking(path: Path, root: Element) -> dict[str, MimicLaw]:
    """The mimic joints of a URDF by name, leaders resolved along chains.

    A joint whose leader does not exist moves freely. `check_urdf` must have checked the numbers.

    Raises:
        BadRobot: a mimic joint follows itself.
    """
    found = {}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None or joint.get("type") == "fixed" or mimic.get("joint") not in joints:
            continue
        ratio = float(mimic.get("multiplier", "1"))
        offset = float(mimic.get("offset", "0"))
        found[name] = MimicLaw(mimic.get("joint", ""), ratio, offset)
    return resolved(str(path), found)


def write_urdf(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a robot's URDF with identified values.

    `<inertial>` and `<dynamics>` of moving links and joints are replaced; everything else stays,
    comments and meshes included. A moving link carries the inertia of all links welded to it, whose
    own is removed. Gains, rotor inertias and the scale's anchor are in a comment.

    Raises:
        InvalidInput: the robot was not read from a URDF.
    """
    if robot.kind != "urdf" or robot.file is None:
        raise InvalidInput("robot", "one read from a URDF", robot.kind, "Write an MJCF file.")
    root, _ = read_xml(robot.file)
    moving = {}
    held = []
    welded = []
    model = values.model
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        if name in robot.joints:
            k = robot.joints.index(name)
            moving[end_of(joint, "child")] = name
            part = _replaced(joint, "dynamics")
            part.set("damping", numbers(values.damping[k]))
            part.set("friction", numbers(values.friction[k]))
        elif joint.get("type") != "fixed":
            held.append(name)
    if robot.floating:
        children = {end_of(joint, "child") for joint in root.findall("joint")}
        first = {link.get("name", "") for link in root.findall("link")} - children
        moving |= dict.fromkeys(first, model.names[1])
    for link in root.findall("link"):
        name = link.get("name", "")
        inertial = link.find("inertial")
        frame = model.getFrameId(name, pin.FrameType.BODY)
        if name in moving:
            inertia = model.inertias[model.getJointId(moving[name])]
            _set_inertial(_replaced(link, "inertial"), inertia)
        elif inertial is not None and frame < model.nframes and model.frames[frame].parentJoint:
            link.remove(inertial)
            welded.append(name)
    also = ("Joints taken as fixed: " + ", ".join(held) + ".",) if held else ()
    if welded:
        whose = "Their inertia is part of the link that they are fixed to: "
        also += (whose + ", ".join(welded) + ".",)
    if values.springs:
        sprung = ", ".join(robot.joints[spring.joint] for spring in values.springs)
        also += (
            f"Springs were identified, which a URDF cannot hold: {sprung}. The MJCF has them.",
        )
    from .identified import remarks

    write_xml(path, root, remarks(robot, values, also))


def _replaced(parent: Element, tag: str) -> Element:
    """An empty child element, replacing the old one if there is one."""
    part = parent.find(tag)
    if part is None:
        return SubElement(parent, tag)
    tail = part.tail
    part.clear()
    part.tail = tail
    return part


def _set_inertial(element: Element, inertia: pin.Inertia) -> None:
    """Fills an `<inertial>` with an inertia about the link's frame."""
    SubElement(element, "origin", xyz=numbers(inertia.lever), rpy="0 0 0")
    SubElement(element, "mass", value=numbers(inertia.mass))
    tensor = inertia.inertia
    SubElement(element, "inertia", {key: numbers(tensor[at]) for key, at in ENTRIES.items()})
