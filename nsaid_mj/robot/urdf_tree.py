"""Writes the tree of an MJCF file as a URDF, with its shapes as OBJ meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import BadRobot, InvalidInput
from ..parameters import Array
from ..resources import write_text
from ..structure.optional import pin
from .mjcf_visuals import MjcfVisuals
from .model import RobotModel
from .shapes import VisualMesh

_GRAVITY = (0.0, 0.0, -9.81)  # of every URDF [m/s²]
_MESHES = "meshes"


def write_tree_urdf(robot: RobotModel, path: Path) -> None:
    """Writes a robot's kinematics, inertias, limits, frictions and shapes as a URDF.

    Links are called by their joints. The efforts are the largest forces of the motors [N·m or N],
    and 0 where there is no limit; an MJCF has no limits of speed, which are 0. Rotor inertias and
    gains have no place in a URDF.

    Args:
        robot: as read from an MJCF file.
        path: of the file; the meshes are written into a folder beside it.

    Raises:
        BadRobot: gravity is not that of a URDF, 9.81 m/s² against z.
        InvalidInput: the robot was not read from an MJCF file.
    """
    if robot.kind != "mjcf":
        raise InvalidInput("robot", "one read from an MJCF file", robot.kind, "Take it as it is.")
    model = robot.model
    if not np.allclose(model.gravity.linear, _GRAVITY, atol=0.05):
        gravity = _numbers(model.gravity.linear)
        remedy = "Turn the robot's base instead, or set gravity to 0 0 -9.81."
        raise BadRobot(str(robot.source), "", f"its gravity is {gravity} m/s²", remedy)
    root = ElementTree.Element("robot", name=robot.name)
    links = [ElementTree.SubElement(root, "link", name="base")]
    links += [
        ElementTree.SubElement(root, "link", name=f"link of {joint}") for joint in robot.joints
    ]
    for i, link in enumerate(links[1:], 1):
        _add_inertial(link, model.inertias[i])
        _add_joint(root, robot, i, links)
    if isinstance(robot.visuals, MjcfVisuals):
        _add_visuals(links, robot.visuals, path.parent / _MESHES)
    ElementTree.indent(root)
    write_text(path, ElementTree.tostring(root, encoding="unicode") + "\n")


def _add_inertial(link: ElementTree.Element, inertia: pin.Inertia) -> None:
    part = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(part, "origin", xyz=_numbers(inertia.lever), rpy="0 0 0")
    ElementTree.SubElement(part, "mass", value=f"{inertia.mass!r}")
    own = inertia.inertia
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    entries = {name: f"{float(own[at])!r}" for name, at in (names | {"izz": (2, 2)}).items()}
    ElementTree.SubElement(part, "inertia", entries)


def _add_joint(
    root: ElementTree.Element, robot: RobotModel, i: int, links: Sequence[ElementTree.Element]
) -> None:
    """Adds joint number i of Pinocchio's model."""
    model, k = robot.model, i - 1
    data, joint = model.createData(), model.joints[i]
    pin.computeJointJacobians(model, data, pin.neutral(model))
    jacobian = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL)
    subspace = jacobian.reshape(6, -1)[:, joint.idx_v]  # Pinocchio returns one column as (6,)
    slides = np.linalg.norm(subspace[:3]) > 0.5
    low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
    limited = np.isfinite([low, high]).all() and low < high
    kind = "prismatic" if slides else "revolute" if limited else "continuous"
    element = ElementTree.SubElement(root, "joint", name=robot.joints[k], type=kind)
    placement = model.jointPlacements[i]
    turn = _numbers(pin.rpy.matrixToRpy(placement.rotation))
    ElementTree.SubElement(element, "origin", xyz=_numbers(placement.translation), rpy=turn)
    ElementTree.SubElement(element, "parent", link=links[model.parents[i]].get("name", ""))
    ElementTree.SubElement(element, "child", link=links[i].get("name", ""))
    axis = subspace[:3] if slides else subspace[3:]
    ElementTree.SubElement(element, "axis", xyz=_numbers(axis))
    effort = abs(robot.gain[k]) * robot.limits[k]
    limits = {"effort": f"{float(effort) if np.isfinite(effort) else 0.0!r}", "velocity": "0"}
    if limited:
        limits |= {"lower": f"{float(low)!r}", "upper": f"{float(high)!r}"}
    elif slides:
        limits |= {"lower": "-1.0", "upper": "1.0"}
    ElementTree.SubElement(element, "limit", limits)
    friction = {"damping": robot.damping[k], "friction": robot.friction[k]}
    entries = {name: f"{float(value)!r}" for name, value in friction.items()}
    ElementTree.SubElement(element, "dynamics", entries)


def _add_visuals(links: Sequence[ElementTree.Element], visuals: MjcfVisuals, folder: Path) -> None:
    """Writes the meshes into a folder, and adds them to the links that they move with."""
    folder.mkdir(exist_ok=True)
    pairs = zip(visuals.visuals(), visuals.places(), strict=True)
    for number, (mesh, (joint, place)) in enumerate(pairs):
        file = folder / f"{number}.obj"
        write_text(file, _obj(mesh))
        part = ElementTree.SubElement(links[joint], "visual")
        turn = _numbers(pin.rpy.matrixToRpy(place.rotation))
        ElementTree.SubElement(part, "origin", xyz=_numbers(place.translation), rpy=turn)
        shape = ElementTree.SubElement(part, "geometry")
        ElementTree.SubElement(shape, "mesh", filename=f"{folder.name}/{file.name}")
        colour = ElementTree.SubElement(part, "material", name=f"colour {number}")
        ElementTree.SubElement(colour, "color", rgba=_numbers(mesh.color))


def _obj(mesh: VisualMesh) -> str:
    """A mesh in Wavefront's format, whose indices begin at 1."""
    rows = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    return "\n".join(rows) + "\n"


def _numbers(values: Array | Sequence[float]) -> str:
    return " ".join(repr(float(x)) for x in values)
