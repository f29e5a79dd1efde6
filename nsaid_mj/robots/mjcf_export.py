"""A MuJoCo model with identified inertias, frictions, rotor inertias and gains.

A robot read from an MJCF gets its own file back, with new numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lxml.etree import Element, SubElement
from lxml.etree import _Element as Node

from ..base import InvalidInput, OutputFile, pin
from ..core import Array
from .identified import Identified, SharedFriction, remarks
from .mjcf import initial_pose
from .mjcf_file import (
    actuators_of_file,
    bodies_of_file,
    compile_file,
    joints_of_file,
    name_joints,
    own_file,
    own_joints,
    relocate,
    remove_references,
    split_bodies,
)
from .model import RobotModel
from .tree import actuators_of, is_motor, joint_names, rigid_tree, wxyz
from .xml import numbers, with_remarks

_OVERRULING = ("inertiafromgeom", "balanceinertia", "boundmass", "boundinertia", "settotalmass")
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # of MuJoCo's fullinertia


def write_mjcf(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a MuJoCo model with identified values.

    From an MJCF it keeps everything but these numbers; from another file it has bodies, joints with
    their limits, and motors. A joint's motor takes the command of the logs. Mass matrix and bias
    forces are those of `values.model`.

    Paths of meshes are relative to the file's folder.

    Raises:
        InvalidInput: the robot is a vehicle.
    """
    OutputFile(path).write_text(mjcf_text(robot, values, path.resolve().parent))


def mjcf_text(robot: RobotModel, values: Identified, folder: Path) -> str:
    """The text of the file that `write_mjcf` writes; raises `InvalidInput` for a vehicle."""
    return with_remarks(*_calibrated(robot, values, folder))


def moving_bodies(robot: RobotModel, values: Identified) -> Iterator[tuple[str, Array]]:
    """Names and inertial parameters (10,), about the body's frame, of the file's moving bodies."""
    root, _ = _calibrated(robot, values, Path.cwd())
    for body in bodies_of_file(root):
        if own_joints(body):
            inertial = body.find("inertial")
            read = {k: np.array([float(x) for x in v.split()]) for k, v in inertial.attrib.items()}
            tensor = np.zeros((3, 3))
            for place, entry in zip(_PLACES, read["fullinertia"], strict=True):
                tensor[place] = tensor[place[::-1]] = entry
            inertia = pin.Inertia(float(read["mass"][0]), read["pos"], tensor)
            yield body.get("name", ""), inertia.toDynamicParameters()


def _calibrated(robot: RobotModel, values: Identified, folder: Path) -> tuple[Node, str]:
    """The file's root, and remarks on it."""
    if robot.kind == "vehicle":
        raise InvalidInput("robot", "a tree of joints", "a vehicle", "Vehicles have no such file.")
    if robot.kind == "mjcf" and robot.file and robot.file.suffix.lower() != ".mjb":
        root, also = _edited(robot, robot.file, values, folder)
    else:
        root = _built(robot, values)
        also = ("It has no shapes: they stay in the robot's own file.",)
    joints = {joint.get("name"): joint for joint in joints_of_file(root)}
    for k, name in enumerate(robot.joints):
        joints[name].set("armature", numbers(values.rotor[k]))
        joints[name].set("damping", numbers(values.damping[k]))
        joints[name].set("frictionloss", numbers(values.friction[k]))
    degrees = next((c.get("angle") for c in root.iter("compiler") if c.get("angle")), "degree")
    for spring in values.springs:
        own = joints[robot.joints[spring.joint]]
        own.set("stiffness", numbers(spring.stiffness))
        turns = own.get("type") != "slide" and degrees == "degree"
        own.set("springref", numbers(np.rad2deg(spring.rest) if turns else spring.rest))
    if values.couplings is not None:
        tendons = {f.where for f in robot.findings if f.code == "tendon"}
        remove_references(root, tendons, ("tendon",), "tendon")
        for coupling in values.couplings:
            _couple(root, robot, coupling, joints)
    return root, remarks(robot, values, also)


def _couple(
    root: Node, robot: RobotModel, coupling: SharedFriction, joints: dict[str, Node]
) -> None:
    """Adds tendons for what two joints share.

    A tendon of length q_i ± q_j with armature A adds A to both diagonal entries of the mass matrix,
    already in the joints' own armatures, and ±A between them; likewise for damping.
    """
    section = root.find("tendon")
    section = SubElement(root, "tendon") if section is None else section
    pair = [robot.joints[i] for i in coupling.joints]
    shared = {"armature": coupling.inertia, "damping": coupling.damping}
    signs = {key: -1 if value < 0 else 1 for key, value in shared.items()}
    for sign in (1, -1):
        own = {key: abs(value) for key, value in shared.items() if signs[key] == sign and value}
        for key, value in own.items():
            for joint in pair:
                joints[joint].set(key, numbers(float(joints[joint].get(key)) - value))
        if coupling.sign == sign:
            own["frictionloss"] = max(coupling.friction, 0.0)
        if own:
            name = f"{pair[0]} {'+' if sign > 0 else '-'} {pair[1]}"
            tendon = SubElement(section, "fixed", name=name)
            tendon.attrib.update({key: numbers(value) for key, value in own.items()})
            for joint, factor in zip(pair, (1, sign), strict=True):
                SubElement(tendon, "joint", joint=joint, coef=str(factor))


def _built(robot: RobotModel, values: Identified) -> Node:
    """An MJCF of a robot that was not read from one."""
    model = values.model
    root = Element("mujoco", model=robot.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity=numbers(model.gravity.linear), integrator="implicitfast")
    bodies = [SubElement(root, "worldbody")]
    for i, own in enumerate(robot.system.structure.bodies, start=1):
        name = "link world" if own.name == "world" else own.name
        body = SubElement(bodies[own.parent + 1], "body", name=name)
        body.set("pos", numbers(model.jointPlacements[i].translation))
        body.set("quat", numbers(wxyz(model.jointPlacements[i].rotation)))
        _set_inertial(body, model.inertias[i])
        bodies.append(body)
        if own.joint == "free":
            SubElement(body, "freejoint", name=model.names[i])
            continue
        kind = "slide" if own.joint == "slide" else "hinge"
        axis = numbers(np.asarray(own.axis))
        joint = SubElement(body, "joint", name=model.names[i], axis=axis, type=kind)
        at = model.joints[i].idx_q
        low = model.lowerPositionLimit[at]
        high = model.upperPositionLimit[at]
        if model.joints[i].nq == 1 and np.isfinite([low, high]).all() and low < high:
            joint.set("range", numbers([low, high]))
    section = SubElement(root, "actuator")
    for k, name in enumerate(robot.joints):
        if values.gain[k]:
            _add_motor(section, robot, name, float(values.gain[k]))
    _lead_followers(root, robot)
    return root


def _lead_followers(root: Node, robot: RobotModel) -> None:
    """Constrains joints that follow others to q = ratio · leader + offset.

    MuJoCo advises a time constant of at least two time steps, which are 2 ms by default.
    """
    if robot.coupling is None:
        return
    section = SubElement(root, "equality")
    ratio = robot.coupling.ratio
    for name in robot.followers:
        own = robot.joints.index(name)
        leader = int(np.flatnonzero(ratio[own])[0])
        law = SubElement(section, "joint", joint1=name, joint2=robot.leaders[leader])
        law.set("polycoef", numbers([robot.coupling.offset[own], ratio[own, leader], 0, 0, 0]))
        law.set("solref", numbers([0.004, 1.0]))
        law.set("solimp", numbers([0.99, 0.999, 0.001]))


def _edited(
    robot: RobotModel, source: Path, values: Identified, folder: Path
) -> tuple[Node, tuple[str, ...]]:
    """A robot's own MJCF with identified inertias and gains, and remarks on it."""
    spec, mj, findings = compile_file(source)
    root, exact = own_file(source, spec, mj, findings)
    also = tuple(f"{finding.text}." for finding in findings)
    if not exact:
        also += ("Its poses have six digits, since MuJoCo wrote it.",)
    names = joint_names(mj)
    locked = [name for name in names if not robot.model.existJointName(name)]
    whole = rigid_tree(mj, robot.name)
    q = initial_pose(mj, whole, [n for n in names if whole.joints[whole.getJointId(n)].nv == 6])
    held = {n: float(q[whole.joints[whole.getJointId(n)].idx_q]) for n in locked}
    name_joints(root, mj, names)
    for number, body in enumerate(bodies_of_file(root), start=1):
        if not body.get("name") and own_joints(body):
            body.set("name", f"body {number}")
    tendons = (part for section in root.findall("tendon") for part in section.iterchildren("*"))
    for number, tendon in enumerate(tendons):
        tendon.set("name", tendon.get("name") or str(number))
    before = actuators_of_file(root)
    also += _set_motors(root, robot, values, mj, names)
    links = split_bodies(root, mj, held)
    anchors = dict(zip(names, mj.jnt_pos, strict=True))
    remove_references(root, set(locked))
    if locked or before != actuators_of_file(root):
        for section in root.findall("keyframe"):  # keyframes list all joints and actuators
            root.remove(section)
    welded = _set_inertials(root, values.model, links, anchors)
    for compiler in root.iter("compiler"):
        for key in _OVERRULING:
            compiler.attrib.pop(key, None)
    relocate(root, spec, source, folder)
    if locked:
        also += ("Joints fixed: " + ", ".join(locked) + ".",)
    if welded:
        also += ("Their inertia is part of the body they are fixed to: " + ", ".join(welded) + ".",)
    return root, also


def _set_inertials(
    root: Node, model: pin.Model, links: dict[str, Node], anchors: dict[str, Array]
) -> list[str]:
    """Sets inertias of bodies; returns the names of those welded to a moving body.

    `links` are the bodies behind the joints, `anchors` the joints' in the frames of their bodies
    [m].
    """
    moving = {body: name for name, body in links.items()}
    welded = []
    for body in bodies_of_file(root):
        if body in moving:
            own = model.inertias[model.getJointId(moving[body])]
            lever = own.lever + anchors[moving[body]]
            _set_inertial(body, pin.Inertia(own.mass, lever, own.inertia))
        elif any(above in moving for above in body.iterancestors("body")):
            _set_inertial(body, pin.Inertia.Zero())
            welded.append(body.get("name", "a body without a name"))
    return welded


def _set_inertial(body: Node, inertia: pin.Inertia) -> None:
    """Replaces a body's inertia with one about its frame."""
    for old in body.findall("inertial"):
        body.remove(old)
    tensor = inertia.inertia
    key = "fullinertia" if inertia.mass else "diaginertia"
    entries = numbers([tensor[place] for place in _PLACES[: 6 if inertia.mass else 3]])
    part = Element("inertial", pos=numbers(inertia.lever), mass=numbers(inertia.mass))
    part.set(key, entries)
    part.tail = body.text
    body.text = body.text or "\n"
    body.insert(0, part)


def _set_motors(
    root: Node, robot: RobotModel, values: Identified, mj: Any, names: list[str]
) -> tuple[str, ...]:
    """Gives every joint with a gain a motor; returns remarks.

    It is the first of its actuators, if that is a motor; further motors stay, and servos go.
    """
    elements = actuators_of_file(root)
    section = root.find("actuator")
    section = SubElement(root, "actuator") if section is None else section
    replaced = []
    dropped = set()
    for k, joint in enumerate(robot.joints):
        own = actuators_of(mj, names.index(joint))
        kept = [i for i in own if is_motor(mj, i)] if own and is_motor(mj, own[0]) else []
        for i in kept:
            elements[i].set("armature", "0")  # the joint's includes it, as well as the damping
            elements[i].set("damping", "0")
        for i in set(own) - set(kept):
            elements[i].set("name", elements[i].get("name") or f"removed {i}")
            dropped.add(elements[i].get("name"))
        if kept:
            gear = mj.actuator_gear[kept[0]]
            elements[kept[0]].tag = "general"  # a <motor> has no gain
            elements[kept[0]].set("gear", numbers(gear))
            elements[kept[0]].set("gainprm", numbers(values.gain[k] / gear[0]))
        elif values.gain[k]:
            replaced += [joint] if own else []
            _add_motor(section, robot, joint, float(values.gain[k]))
    remove_references(root, dropped, ("actuator",), "actuator")
    return ("Servos replaced by motors: " + ", ".join(replaced) + ".",) if replaced else ()


def _add_motor(section: Node, robot: RobotModel, joint: str, gain: float) -> None:
    """Adds a motor whose command is that of the logs."""
    taken = {part.get("name") for part in section}
    name = joint if joint not in taken else f"{joint} motor"
    motor = SubElement(section, "general", name=name, joint=joint, gainprm=numbers(gain))
    motor.attrib.update({"gear": "1", "biastype": "none", "dyntype": "none", "armature": "0"})
    limit = robot.limits[robot.joints.index(joint)]
    if np.isfinite(limit):
        motor.attrib.update({"ctrllimited": "true", "ctrlrange": numbers([-limit, limit])})
