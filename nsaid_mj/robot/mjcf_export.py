"""Writes an MJCF with identified inertias, frictions, rotor inertias and gains."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..resources import write_text
from ..structure.joints import body_names
from ..structure.optional import pin
from .identified import Identified, remarks
from .mjcf import initial_pose
from .mjcf_actuators import is_motor
from .mjcf_file import compile_file
from .mjcf_lock import one_joint_per_body, remove_actuators, remove_keyframes
from .mjcf_tree import actuators_of, joint_names, rigid_tree
from .mjcf_xml import bodies_of, exact_xml, joints_of, numbers, own_joints, set_inertial
from .model import RobotModel
from .tree import tree_spec

_STEP = 1e-3  # time step of a model that is not made from an MJCF [s]


def write_mjcf(robot: RobotModel, values: Identified, path: Path) -> None:
    """Writes a MuJoCo model with identified values.

    From an MJCF it keeps bodies, geoms, sensors and options; from another file it has bodies,
    joints with their limits, and motors. A joint's motor takes the command of the logs. Mass matrix
    and bias forces are those of `values.model`.

    Args:
        robot: a tree of joints.
        values: what was identified.
        path: of the file to write; paths of meshes are relative to its folder.

    Raises:
        InvalidInput: the robot is a vehicle.
    """
    write_text(path, mjcf_text(robot, values, path.resolve().parent))


def mjcf_text(robot: RobotModel, values: Identified, folder: Path) -> str:
    """The text of the file that `write_mjcf` writes into a folder.

    Raises:
        InvalidInput: the robot is a vehicle.
    """
    if robot.kind == "vehicle":
        raise InvalidInput("robot", "a tree of joints", "a vehicle", "Vehicles have no such file.")
    if robot.kind == "mjcf" and robot.source and robot.source.suffix.lower() != ".mjb":
        root, also = _edited(robot, robot.source, values, folder)
    else:
        root, also = (
            _built(robot, values),
            ("It has no shapes: they stay in the robot's own file.",),
        )
    joints = {joint.get("name"): joint for joint in joints_of(root)}
    for k, name in enumerate(robot.joints):
        joints[name].set("armature", numbers(values.rotor[k]))
        joints[name].set("damping", numbers([values.damping[k], 0, 0]))
        joints[name].set("frictionloss", numbers(values.friction[k]))
    root.insert(0, ElementTree.Comment(f" {remarks(robot, values, also)} "))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def moving_bodies(robot: RobotModel, values: Identified) -> Iterator[tuple[str, str, Array]]:
    """The bodies that move in the file of `write_mjcf`.

    Yields:
        Name of the body, name of its joint, and the joint's anchor (3,) in the body's frame [m].
    """
    root = ElementTree.fromstring(mjcf_text(robot, values, Path.cwd()))
    for body in bodies_of(root):
        for joint in own_joints(body):
            anchor = np.array([float(x) for x in joint.get("pos", "0 0 0").split()])
            yield body.get("name", ""), joint.get("name", ""), anchor


def _built(robot: RobotModel, values: Identified) -> Element:
    """An MJCF of a robot that was not read from one."""
    model = values.model
    spec = tree_spec(model, _STEP)
    spec.modelname = robot.name
    spec.option.disableflags = 0
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.compiler.degree = False
    bodies = [spec.joint(name).parent for name in robot.joints]
    for i, body in enumerate(bodies):
        body.name = f"body {i + 1}"  # so that no new name is another body's old one
    for body, link in zip(bodies, body_names(model), strict=True):
        body.name = "link world" if link == "world" else link
    for i, name in enumerate(robot.joints, start=1):
        joint = model.joints[i]
        low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        if joint.nq == 1 and np.isfinite([low, high]).all() and low < high:
            spec.joint(name).range = [low, high]
            spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_TRUE
    root, _ = exact_xml(spec)
    for compiler in root.findall("compiler"):
        compiler.attrib.pop("meshdir", None)
    section = SubElement(root, "actuator")
    for k, name in enumerate(robot.joints):
        _add_motor(section, robot, name, float(values.gain[k]))
    return root


def _edited(
    robot: RobotModel, source: Path, values: Identified, folder: Path
) -> tuple[Element, tuple[str, ...]]:
    """A robot's own MJCF with identified inertias and gains, and remarks on it."""
    spec, mj, findings = compile_file(source)
    root, _ = exact_xml(spec)
    names = joint_names(mj)
    locked = [name for name in names if name not in robot.joints]
    whole = rigid_tree(mj, robot.name)
    q = initial_pose(mj, whole, [n for n in names if whole.joints[whole.getJointId(n)].nv == 6])
    at = {n: whole.joints[whole.getJointId(n)] for n in names}
    held = {n: float(q[at[n].idx_q]) for n in locked if at[n].nq == 1}
    also = tuple(f"{finding.text}." for finding in findings)
    before = _actuators(root)
    also += _set_motors(root, robot, values, mj, names)
    links = one_joint_per_body(root, mj, locked, held)
    if locked or before != _actuators(root):
        remove_keyframes(root)
    welded = _set_inertials(root, values.model, links)
    for directory in ("meshdir", "texturedir"):
        _redirect(root, directory, source.resolve().parent, folder)
    if locked:
        also += ("Joints fixed: " + ", ".join(locked) + ".",)
    if welded:
        also += ("Their inertia is part of the body they are fixed to: " + ", ".join(welded) + ".",)
    return root, also


def _set_inertials(root: Element, model: pin.Model, links: dict[str, Element]) -> list[str]:
    """Gives bodies their inertias; returns the names of those welded to a moving body.

    Args:
        root: the MJCF.
        model: Pinocchio's model with the inertias.
        links: the body behind each joint.
    """
    moving = {id(body): joint for joint, body in links.items()}
    welded = []

    def visit(parent: Element, behind: bool) -> None:
        for body in parent.findall("body"):
            joint = moving.get(id(body))
            if joint is not None:
                element = next(j for j in body if j.get("name") == joint)
                anchor = np.array([float(x) for x in element.get("pos", "0 0 0").split()])
                own = model.inertias[model.getJointId(joint)]
                set_inertial(body, own.mass, own.lever + anchor, tensor=own.inertia)
            elif behind:
                set_inertial(body, 0.0, np.zeros(3), moments=np.zeros(3))
                welded.append(body.get("name", "a body without a name"))
            visit(body, behind or joint is not None)

    world = root.find("worldbody")
    assert world is not None  # a robot with joints has bodies
    visit(world, False)
    return welded


def _set_motors(
    root: Element, robot: RobotModel, values: Identified, mj: Any, names: list[str]
) -> tuple[str, ...]:
    """Gives every joint one motor with the identified gain; returns remarks."""
    elements = _actuators(root)
    section = root.find("actuator")
    section = SubElement(root, "actuator") if section is None else section
    replaced, dropped = [], []
    for k, joint in enumerate(robot.joints):
        own = actuators_of(mj, names.index(joint))
        motor = next((i for i in own if is_motor(mj, i)), None) if own[:1] else None
        if motor is not None and motor == own[0]:
            element, gear = elements[motor], mj.actuator_gear[motor]
            element.set("gear", numbers(gear))
            element.set("gainprm", numbers(values.gain[k] / gear[0]))
            element.set("armature", "0")
            element.set("damping", "0")
            own = own[1:]
        else:
            replaced += [joint] if own else []
        for i in own:
            name = elements[i].get("name") or f"removed {i}"
            elements[i].set("name", name)
            dropped.append(name)
        if motor is None or motor in own:
            _add_motor(section, robot, joint, float(values.gain[k]))
    remove_actuators(root, dropped)
    return ("Servos replaced by motors: " + ", ".join(replaced) + ".",) if replaced else ()


def _actuators(root: Element) -> list[Element]:
    return [part for section in root.findall("actuator") for part in section]


def _add_motor(section: Element, robot: RobotModel, joint: str, gain: float) -> None:
    """Adds a motor whose command is that of the logs."""
    taken = {part.get("name") for part in section}
    name = joint if joint not in taken else f"{joint} motor"
    motor = SubElement(section, "general", name=name, joint=joint, gainprm=numbers(gain))
    motor.attrib |= {"gear": "1", "biastype": "none", "dyntype": "none", "armature": "0"}
    limit = robot.limits[robot.joints.index(joint)]
    if np.isfinite(limit):
        motor.attrib |= {"ctrllimited": "true", "ctrlrange": numbers([-limit, limit])}


def _redirect(root: Element, directory: str, old: Path, new: Path) -> None:
    """Makes a folder of meshes or textures relative to the new file's folder."""
    for compiler in root.findall("compiler"):
        inside = compiler.get(directory, compiler.get("assetdir", ""))
        try:
            relative = os.path.relpath(old / inside, new)
        except ValueError:  # on another drive of Windows
            relative = str(old / inside)
        compiler.set(directory, Path(relative).as_posix())
