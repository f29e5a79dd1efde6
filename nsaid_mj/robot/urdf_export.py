"""A robot's own URDF with identified inertias and frictions."""

from __future__ import annotations

from pathlib import Path

from lxml.etree import SubElement
from lxml.etree import _Element as Element

from ..errors import InvalidInput
from ..structure.optional import pin
from .identified import Identified, remarks
from .model import RobotModel
from .urdf_checks import ENTRIES, end_of
from .xml import numbers, read_xml, write_xml


def write_urdf(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a robot's URDF with identified values.

    `<inertial>` and `<dynamics>` of moving links and joints are replaced; everything else is kept
    as it is, comments and meshes included. A moving link carries the inertia of all links welded to
    it, theirs being removed. Gains, rotor inertias and the scale's anchor are in a comment.

    Args:
        robot: as read from a URDF.
        values: what was identified.
        path: of the file to write.

    Raises:
        InvalidInput: the robot was not read from a URDF.
    """
    if robot.kind != "urdf" or robot.file is None:
        raise InvalidInput("robot", "one read from a URDF", robot.kind, "Write an MJCF file.")
    root, _ = read_xml(robot.file)
    moving, held, welded, model = {}, [], [], values.model
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
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
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
    write_xml(path, root, remarks(robot, values, also))


def _replaced(parent: Element, tag: str) -> Element:
    """An empty child element, in place of the old one if there is one."""
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
