"""MuJoCo's specifications as XML, with all digits: MuJoCo itself writes six."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from ..parameters import Array
from ..structure.optional import pin
from .mjcf_tree import joint_names, pose

_JOINTS = ("joint", "freejoint")
_REFERENCES = ("joint", "jointinparent", "joint1", "joint2", "objname")  # attributes with a name
_OVERRULING = ("inertiafromgeom", "balanceinertia", "boundmass", "boundinertia", "settotalmass",
               "discardvisual", "fusestatic")  # fmt: skip


def exact_xml(spec: Any) -> tuple[Element, Any]:
    """The XML of a specification whose bodies and joints have all digits.

    Every body has an explicit `<inertial>`, and every joint a name.

    Args:
        spec: MuJoCo's specification; it is compiled.

    Returns:
        The root element, and the compiled model.
    """
    mj = spec.compile()
    root = ElementTree.fromstring(spec.to_xml())
    for compiler in root.iter("compiler"):
        for key in _OVERRULING:
            compiler.attrib.pop(key, None)
    unwrap_frames(root)
    for b, body in enumerate(bodies_of(root), start=1):
        place(body, mj.body_pos[b], mj.body_quat[b])
        set_inertial(body, mj.body_mass[b], mj.body_ipos[b], moments=mj.body_inertia[b])
        inertial = body.find("inertial")
        assert inertial is not None
        inertial.set("quat", numbers(mj.body_iquat[b]))
    names = joint_names(mj)
    renamed = {mj.joint(j).name: name for j, name in enumerate(names) if mj.joint(j).name != name}
    for element, key in ((e, k) for e in root.iter() for k in _REFERENCES if k in e.attrib):
        if key != "objname" or element.get("objtype") == "joint":
            element.set(key, renamed.get(element.attrib[key], element.attrib[key]))
    for j, joint in enumerate(joints_of(root)):
        joint.set("name", names[j])
        if mj.jnt_type[j] in {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}:
            joint.set("pos", numbers(mj.jnt_pos[j]))
            joint.set("axis", numbers(mj.jnt_axis[j]))
            joint.set("ref", numbers(mj.qpos0[mj.jnt_qposadr[j]]))
            joint.set("armature", numbers(mj.dof_armature[mj.jnt_dofadr[j]]))
            if mj.jnt_limited[j]:
                joint.set("range", numbers(mj.jnt_range[j]))
    return root, mj


def unwrap_frames(parent: Element) -> None:
    """Replaces every `<frame>` in an element by its content, in place."""
    for child in list(parent):
        unwrap_frames(child)
        if child.tag != "frame":
            continue
        at, where = list(parent).index(child), _pose(child)
        parent.remove(child)
        for part in reversed(list(child)):
            inside = where * _pose(part)
            part.set("pos", numbers(inside.translation))
            if part.tag == "light":
                direction = [float(x) for x in part.get("dir", "0 0 -1").split()]
                part.set("dir", numbers(where.rotation @ direction))
            elif part.tag != "joint":  # bodies and joints get all digits later
                part.set("quat", numbers(wxyz(inside.rotation)))
            key = "childclass" if part.tag == "body" else "class"
            if "childclass" in child.attrib and part.tag not in {"frame", "inertial", "freejoint"}:
                part.attrib.setdefault(key, child.attrib["childclass"])
            parent.insert(at, part)


def _pose(element: Element) -> pin.SE3:
    """The pose of an element, which MuJoCo writes as pos and quat."""
    position = [float(x) for x in element.get("pos", "0 0 0").split()]
    quaternion = [float(x) for x in element.get("quat", "1 0 0 0").split()]
    return pose(np.array(position), np.array(quaternion))


def bodies_of(root: Element) -> list[Element]:
    """All bodies in MuJoCo's order."""
    world = root.find("worldbody")
    return [] if world is None else list(world.iter("body"))


def joints_of(root: Element) -> list[Element]:
    """All joints in MuJoCo's order: a body's own come before those of its children."""
    return [part for body in bodies_of(root) for part in body if part.tag in _JOINTS]


def own_joints(body: Element) -> list[Element]:
    """The joints of one body."""
    return [part for part in body if part.tag in _JOINTS]


def place(body: Element, position: Array, quaternion: Array) -> None:
    """Sets the pose of a body by its position (3,) and quaternion w, x, y, z (4,)."""
    for key in ("euler", "axisangle", "xyaxes", "zaxis"):
        body.attrib.pop(key, None)
    body.set("pos", numbers(position))
    body.set("quat", numbers(quaternion))


def set_inertial(
    body: Element,
    mass: float,
    centre: Array,
    *,
    moments: Array | None = None,
    tensor: Array | None = None,
) -> None:
    """Gives a body an `<inertial>`, in place of the one it has.

    Args:
        body: the body.
        mass: of the body [kg].
        centre: (3,) its centre of mass [m].
        moments: (3,) principal moments of inertia [kg·m²].
        tensor: (3, 3) inertia about the centre of mass in the body's axes, if no moments are given.
    """
    for old in body.findall("inertial"):
        body.remove(old)
    inertial = Element("inertial", pos=numbers(centre), mass=numbers(mass))
    if moments is not None:
        inertial.set("diaginertia", numbers(moments))
    elif tensor is not None:
        places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        inertial.set("fullinertia", numbers(tensor[place] for place in places))
    body.insert(0, inertial)


def wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (4,) of a rotation matrix (3, 3)."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])


def numbers(values: float | Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(list_of(values)))


def list_of(values: float | Iterable[float]) -> Any:
    """A list of numbers, or one number."""
    return list(values) if isinstance(values, Iterable) else values
