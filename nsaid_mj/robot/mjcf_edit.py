"""Edits of an MJCF file: joints and actuators removed, bodies of several joints split.

Poses stay as they are written. Where a locked joint is not as drawn, what it carries is put into a
body with its displacement.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import mujoco
import numpy as np
from lxml.etree import SubElement
from lxml.etree import _Element as Node

from ..structure.optional import pin
from .tree import wxyz
from .xml import numbers

_JOINTS = ("joint", "freejoint")
_NAMING = ("joint", "jointinparent", "joint1", "joint2")  # attributes that hold a joint's name
_REFERENCES = (*_NAMING, "tendon", "tendon1", "tendon2", "actuator")
_OF_CONTENT = ("name", "gravcomp", "user", "sleep")  # attributes that go with a body's content


def bodies_of_file(root: Node) -> list[Node]:
    """All bodies in MuJoCo's order."""
    return [body for world in root.findall("worldbody") for body in world.iter("body")]


def joints_of_file(root: Node) -> list[Node]:
    """All joints in MuJoCo's order: a body's own come before those of its children."""
    return [joint for body in bodies_of_file(root) for joint in own_joints(body)]


def own_joints(body: Node) -> list[Node]:
    """The joints of one body, those in its frames included."""
    return [j for j in body.iter(*_JOINTS) if next(j.iterancestors("body")) is body]


def name_joints(root: Node, mj: Any, names: list[str]) -> None:
    """Gives all joints names, in place, also where others refer to them.

    Args:
        root: the MJCF.
        mj: its compiled model.
        names: of all joints, in MuJoCo's order.
    """
    for joint, name in zip(joints_of_file(root), names, strict=True):
        joint.set("name", name)
    renamed = {mj.joint(j).name: name for j, name in enumerate(names) if mj.joint(j).name != name}
    for element in root.iter("*"):
        keys = [*_NAMING, *(["objname"] if element.get("objtype") == "joint" else [])]
        for key in filter(element.attrib.has_key, keys):
            element.set(key, renamed.get(element.get(key), element.get(key)))


def split_bodies(root: Node, mj: Any, held: Mapping[str, float]) -> dict[str, Node]:
    """Removes locked joints, in place, and makes bodies of several joints chains of bodies of one.

    The last body of a chain keeps name and content.

    Args:
        root: the MJCF, all of whose joints have names.
        mj: its compiled model.
        held: position of each locked joint [rad or m]; of no meaning for balls and free joints.

    Returns:
        The body behind each joint that is left.
    """
    found, j = {}, 0
    for body in bodies_of_file(root):
        here, steps = pin.SE3.Identity(), []
        joints = own_joints(body)
        for joint in joints:
            name = joint.get("name", "")
            if name in held:
                here = here * _displacement(mj, j, held[name])
                _remove(joint)
            else:
                if joint.getparent() is not body and len(joints) > 1:  # it is in a frame
                    joint.set("pos", numbers(mj.jnt_pos[j]))
                    joint.set("axis", numbers(mj.jnt_axis[j]))
                    body.append(joint)
                steps.append((here, joint))
                here = pin.SE3.Identity()
            j += 1
        if not here.isIdentity(0.0):
            steps.append((here, None))
        found |= _chain(body, steps)
    return found


def _chain(body: Node, steps: list[tuple[pin.SE3, Node | None]]) -> dict[str, Node]:
    """Makes a body a chain of bodies, one for each step.

    Args:
        body: the first of the chain; it stays alone if it has one joint, where it is drawn.
        steps: pose of each body in the one before it, and its joint, if it has one.

    Returns:
        The body behind each joint.
    """
    joints = [joint for _, joint in steps if joint is not None]
    alone = len(steps) < 2 and all(place.isIdentity(0.0) for place, _ in steps)
    if alone:
        return {joint.get("name", ""): body for joint in joints}
    name, current, found = body.get("name", "body"), body, {}
    content = [part for part in body if part not in joints and part.tag != "inertial"]
    for old in body.findall("inertial"):  # another one takes its place
        _remove(old)
    for number, (place, joint) in enumerate(steps):
        if number or not place.isIdentity(0.0):
            current.set("name", f"{name}_{number}")
            current = SubElement(current, "body")
            current.set("pos", numbers(place.translation))
            current.set("quat", numbers(wxyz(place.rotation)))
        if joint is not None:
            current.append(joint)
            found[joint.get("name", "")] = current
    kept = {key: body.attrib.pop(key) for key in _OF_CONTENT[1:] if key in body.attrib}
    current.attrib.update({"name": name, **kept})
    current.extend(content)
    return found


def _displacement(mj: Any, j: int, position: float) -> pin.SE3:
    """How a joint at a position displaces its body."""
    axis, anchor = mj.jnt_axis[j], mj.jnt_pos[j]
    kind, travel = mujoco.mjtJoint(mj.jnt_type[j]), position - mj.qpos0[mj.jnt_qposadr[j]]
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.SE3(np.eye(3), travel * axis)
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        turn = pin.exp3(travel * axis)
        return pin.SE3(turn, anchor - turn @ anchor)
    return pin.SE3.Identity()


def remove_references(
    root: Node, gone: set[str], keys: Collection[str] = _REFERENCES, named: str = ""
) -> None:
    """Removes actuators, tendons, constraints and sensors that refer to what is gone.

    Args:
        root: the MJCF.
        gone: names of joints or actuators.
        keys: attributes that refer to them.
        named: section whose elements of these names are removed themselves.
    """
    for tag in ("tendon", "equality", "actuator", "sensor"):
        for part in [p for section in root.findall(tag) for p in section.iterchildren("*")]:
            used = {e.get(key) for e in part.iter("*") for key in keys}
            if used & gone or (tag == named and part.get("name") in gone):
                _remove(part)
                if tag in {"tendon", "actuator"} and part.get("name"):
                    gone = gone | {part.get("name", "")}


def _remove(element: Node) -> None:
    """Removes an element, but not the text after it."""
    parent, before, tail = element.getparent(), element.getprevious(), element.tail
    assert parent is not None  # no root is removed
    if tail and before is not None:
        before.tail = (before.tail or "") + tail
    elif tail:
        parent.text = (parent.text or "") + tail
    parent.remove(element)
