"""The `<inertial>` elements of a URDF, checked one by one before fixed joints merge them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml.etree import SubElement
from lxml.etree import _Element as Element

from ..bounds import LARGEST
from ..parameters import Array
from .findings import Finding
from .inertias import is_physical, moved, moved_inside, plausible_size
from .urdf_checks import ENTRIES, end_of, inertia_of, inertials, mass_of, number


def check_inertials(path: Path, root: Element) -> list[Finding]:
    """Moves the inertias of a URDF inside the cone of physical ones, in place.

    An `<inertial>` without mass is left out; what moves without any mass is found later, when
    links welded together are merged.

    Args:
        path: of the file.
        root: the URDF.

    Returns:
        A warning for each inertial of a moving link that was changed or left out.

    Raises:
        BadRobot: a mass is missing or not a number.
    """
    findings, base = [], _base(root)
    for link, inertial in inertials(root):
        name = link.get("name", "")
        mass, about = mass_of(path, link, inertial), inertia_of(inertial)
        if mass <= 0:
            link.remove(inertial)
            if name not in base and (mass < 0 or np.any(about)):
                text = f"its mass is {mass:g} kg; its <inertial> was left out"
                findings.append(Finding("warning", "inertial_dropped", f"link {name}", text))
        elif not (np.abs(about) <= LARGEST).all() or not is_physical(mass, about):
            known = np.where(np.abs(about) <= LARGEST, about, 0.0)
            changed = moved_inside(mass, known, _size(root, link))
            _write(inertial, changed)
            if name not in base:
                findings.append(moved(name, (mass, known), (mass, changed)))
    return findings


def _write(inertial: Element, about: Array) -> None:
    """Sets the inertia (3, 3) of an `<inertial>`."""
    element = inertial.find("inertia")
    if element is None:
        element = SubElement(inertial, "inertia")
    for key, place in ENTRIES.items():
        element.set(key, repr(float(about[place])))


def _size(root: Element, link: Element) -> float:
    """A link's size [m], from its centre of mass and the joints on it."""
    origins = [link.find("inertial/origin")]
    for joint in root.iter("joint"):
        if end_of(joint, "parent") == link.get("name"):
            origins.append(joint.find("origin"))
    levers = [[number(x) for x in o.get("xyz", "").split()] for o in origins if o is not None]
    return plausible_size(float(np.linalg.norm(lever)) for lever in levers)


def _base(root: Element) -> set[str]:
    """The names of the root link and all links welded to it, whose inertias do not matter."""
    joints = root.findall("joint")
    found = {link.get("name", "") for link in root.iter("link")}
    found -= {end_of(joint, "child") for joint in joints}
    for _ in joints:
        for joint in joints:
            if joint.get("type") == "fixed" and end_of(joint, "parent") in found:
                found.add(end_of(joint, "child"))
    return found
