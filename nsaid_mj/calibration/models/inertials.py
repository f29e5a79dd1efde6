"""The `<inertial>` elements of a URDF, checked one by one before fixed joints merge them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...errors import BadRobot
from ...parameters import Array
from ..findings import Finding
from .inertias import is_physical, moved, moved_inside, plausible_size

_ENTRIES = {
    "ixx": (0, 0),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyy": (1, 1),
    "iyz": (1, 2),
    "izz": (2, 2),
}


def check_inertials(path: Path, root: ElementTree.Element) -> list[Finding]:
    """Moves the inertias of a URDF inside the cone of physical ones, in place.

    An `<inertial>` without mass is left out; what moves without any mass is found later, when
    links welded together are merged.

    Args:
        path: of the file.
        root: the URDF.

    Returns:
        A warning for each inertial of a moving link that was changed or left out.

    Raises:
        BadRobot: a mass is missing or not a finite number.
    """
    findings, base = [], _base(root)
    for link in root.iter("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        if inertial is None:
            continue
        mass, about = _mass(path, name, inertial), _inertia(inertial)
        if mass <= 0:
            link.remove(inertial)
            if name not in base and (mass < 0 or np.any(about)):
                text = f"its mass is {mass:g} kg; its <inertial> was left out"
                findings.append(Finding("warning", "inertial_dropped", f"link {name}", text))
        elif not np.isfinite(about).all() or not is_physical(mass, about):
            known = np.nan_to_num(about, posinf=0.0, neginf=0.0)
            changed = moved_inside(mass, known, _size(root, link))
            _write(inertial, changed)
            if name not in base:
                findings.append(moved(name, (mass, known), (mass, changed)))
    return findings


def _mass(path: Path, link: str, inertial: ElementTree.Element) -> float:
    """The mass of an `<inertial>` [kg].

    Raises:
        BadRobot: it is missing or not a finite number.
    """
    mass = inertial.find("mass")
    value = "" if mass is None else mass.get("value", "")
    number = _number(value)
    if not np.isfinite(number):
        remedy = 'Write a number of kilograms, <mass value="1.5"/>.'
        raise BadRobot(str(path), f"link {link}", f"its mass is {value!r}", remedy)
    return number


def _inertia(inertial: ElementTree.Element) -> Array:
    """(3, 3) the inertia of an `<inertial>`, in its own axes [kg·m²]; NaN where unreadable."""
    element, about = inertial.find("inertia"), np.zeros((3, 3))
    for key, (i, j) in _ENTRIES.items():
        about[i, j] = about[j, i] = _number(
            (element.get(key, "nan" if i == j else "0")) if element is not None else "nan"
        )
    return about


def _write(inertial: ElementTree.Element, about: Array) -> None:
    """Sets the inertia (3, 3) of an `<inertial>`."""
    element = inertial.find("inertia")
    if element is None:
        element = ElementTree.SubElement(inertial, "inertia")
    for key, place in _ENTRIES.items():
        element.set(key, repr(float(about[place])))


def _size(root: ElementTree.Element, link: ElementTree.Element) -> float:
    """A link's size [m], from its centre of mass and the joints on it."""
    origins = [link.find("inertial/origin")]
    for joint in root.iter("joint"):
        if _end(joint, "parent") == link.get("name"):
            origins.append(joint.find("origin"))
    levers = [[_number(x) for x in o.get("xyz", "").split()] for o in origins if o is not None]
    return plausible_size(float(np.linalg.norm(lever)) for lever in levers)


def _base(root: ElementTree.Element) -> set[str]:
    """The names of the root link and all links welded to it, whose inertias do not matter."""
    joints = root.findall("joint")
    found = {link.get("name", "") for link in root.iter("link")}
    found -= {_end(joint, "child") for joint in joints}
    for _ in joints:
        for joint in joints:
            if joint.get("type") == "fixed" and _end(joint, "parent") in found:
                found.add(_end(joint, "child"))
    return found


def _end(joint: ElementTree.Element, end: str) -> str:
    """The name of a joint's `parent` or `child` link."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _number(text: str) -> float:
    """The number that a text stands for; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
