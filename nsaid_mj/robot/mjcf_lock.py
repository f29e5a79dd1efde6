"""An MJCF whose locked joints are gone, and whose bodies have at most one joint each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from ..parameters import Array
from ..structure.optional import pin
from .mjcf_tree import pose
from .mjcf_xml import bodies_of, own_joints, place, wxyz

_REFERENCES = ("joint", "joint1", "joint2", "tendon", "tendon1", "tendon2", "actuator",
               "jointinparent")  # fmt: skip


def one_joint_per_body(
    root: Element, mj: Any, locked: Collection[str], q: Mapping[str, float]
) -> dict[str, Element]:
    """Removes locked joints from an MJCF, in place, and splits bodies of several joints.

    Args:
        root: the MJCF, as `exact_xml` writes it.
        mj: its compiled model.
        locked: names of the joints to remove.
        q: position of each locked hinge and slide [rad or m].

    Returns:
        The body behind each joint that is left, by the joint's name.
    """
    moved, index = {}, 0
    for b, body in enumerate(bodies_of(root), start=1):
        steps, here = [], pose(mj.body_pos[b], mj.body_quat[b])
        for joint in own_joints(body):
            name = joint.get("name", "")
            if name in locked:
                body.remove(joint)
                here = here * _displacement(mj, index, q.get(name, 0.0))
            else:
                steps.append((here, joint))
                here = pin.SE3.Identity()
            index += 1
        if not here.isIdentity(0.0) or not steps:
            steps.append((here, None))
        for joint, part in _split(body, steps):
            moved[joint.get("name", "")] = part
    _remove_references(root, set(locked))
    return moved


def remove_actuators(root: Element, names: Collection[str]) -> None:
    """Removes actuators, and what refers to them."""
    _remove_references(root, set(names), ("actuator",), also_named=("actuator",))


def remove_keyframes(root: Element) -> None:
    """Removes keyframes, which list all joints and actuators."""
    for section in root.findall("keyframe"):
        root.remove(section)
    for size in root.findall("size"):
        size.attrib.pop("nkey", None)


def _displacement(mj: Any, j: int, position: float) -> pin.SE3:
    """How a joint at a position displaces its body."""
    axis, anchor = mj.jnt_axis[j], mj.jnt_pos[j]
    kind, travel = mujoco.mjtJoint(mj.jnt_type[j]), position - mj.qpos0[mj.jnt_qposadr[j]]
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.SE3(np.eye(3), travel * axis)
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        turn: Array = pin.exp3(travel * axis)
        return pin.SE3(turn, anchor - turn @ anchor)
    return pin.SE3.Identity()


def _split(
    body: Element, steps: list[tuple[pin.SE3, Element | None]]
) -> list[tuple[Element, Element]]:
    """Makes a body a chain of bodies, one for each step; the last one keeps name and content.

    Args:
        body: changed in place; it becomes the first of the chain.
        steps: pose of each body in the one before it, and its joint, if it has one.

    Returns:
        Each joint and its body.
    """
    joints = own_joints(body)
    content = [part for part in body if part not in joints]
    attributes = {k: v for k, v in body.attrib.items() if k not in {"pos", "quat"}}
    name, found = body.get("name", "body"), []
    for part in list(body):
        body.remove(part)
    for number, (where, joint) in enumerate(steps):
        last = number == len(steps) - 1
        if number:
            inner = Element("body")
            body.append(inner)
            body = inner
        body.attrib.clear()
        if last:
            body.attrib.update(attributes)
        else:
            body.set("name", f"{name}_{joint.get('name') if joint is not None else number}")
            if "childclass" in attributes:
                body.set("childclass", attributes["childclass"])
        place(body, where.translation, wxyz(where.rotation))
        if joint is not None:
            body.append(joint)
            found.append((joint, body))
    body.extend(content)
    return found


def _remove_references(
    root: Element,
    gone: set[str],
    keys: Collection[str] = _REFERENCES,
    also_named: Collection[str] = (),
) -> None:
    """Removes actuators, tendons, constraints and sensors that refer to what is gone.

    Args:
        root: the MJCF.
        gone: names of joints or actuators.
        keys: attributes that refer to them.
        also_named: sections whose elements of these names are removed themselves.
    """
    for tag in ("tendon", "equality", "actuator", "sensor"):
        for section in root.findall(tag):
            for part in list(section):
                used = {e.get(key) for e in part.iter() for key in keys}
                if used & gone or (tag in also_named and part.get("name") in gone):
                    section.remove(part)
                    if tag in {"tendon", "actuator"} and part.get("name"):
                        gone.add(part.get("name", ""))
