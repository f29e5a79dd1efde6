"""Checks of URDF files as XML, before Pinocchio merges links and drops unreadable elements.

Pinocchio treats a link with an unreadable `<inertial>` as massless, and merges links that are
welded together, which hides the loss.
"""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from lxml import etree
from lxml.etree import SubElement
from lxml.etree import _Element as Element

from ..base import LARGEST, Finding
from ..core import Array
from .assets import packed_robots
from .errors import BadRobot, MimicIgnored
from .inertias import is_physical, moved, moved_inside, plausible_size

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Attributes of `<inertia>`, with their places in the matrix."""
_RANGED = ("revolute", "prismatic")
_KINDS = (*_RANGED, "continuous", "fixed", "floating", "planar")
_CORRECT = "Correct the URDF."
_MOST_LINKS = 2000  # per robot; the equations of more would not fit into memory
_WORLD = "world"  # the name of the link that does not move, in Drake and SDFormat


def check_urdf(path: Path, root: Element) -> None:
    """Checks names, tree, limits and numbers, whose faults Pinocchio reports without the cause.

    Raises:
        BadRobot: names the link or joint at fault.
    """
    if root.tag != "robot":
        reason = f"its root element is <{root.tag}>, not <robot>"
        raise BadRobot(str(path), "", reason, "Give a URDF file.")
    if any("xacro}" in element.tag for element in root.iter(etree.Element)):
        remedy = f"Convert it first: `xacro {path.name} > {path.stem}.urdf`."
        raise BadRobot(str(path), "", "it has xacro macros", remedy)
    if (count := len(root.findall("link"))) > _MOST_LINKS:
        reason = f"it has {count} links, more than {_MOST_LINKS}"
        raise BadRobot(str(path), "", reason, "Leave out what does not move by itself.")
    for kind in ("link", "joint"):
        names = [element.get("name", "") for element in root.findall(kind)]
        if twice := sorted({name for name in names if names.count(name) > 1 or not name}):
            reason = f"two {kind}s have this name" if twice[0] else f"a {kind} has no name"
            raise BadRobot(str(path), f"{kind} {twice[0]!r}", reason, "Give each its own name.")
    _check_tree(path, root)
    for joint in root.findall("joint"):
        _check_joint(path, joint)


def _check_tree(path: Path, root: Element) -> None:
    """Checks that the joints connect the links to one tree.

    A parent `world` that is not among the links is added: Drake and SDFormat have it built in.
    """
    parents = {end_of(joint, "parent") for joint in root.findall("joint")}
    if _WORLD in parents and all(link.get("name") != _WORLD for link in root.findall("link")):
        SubElement(root, "link", name=_WORLD)
    links = [link.get("name", "") for link in root.findall("link")]
    above = {}
    if not links:
        raise BadRobot(str(path), "", "it has no link", _CORRECT)
    for joint in root.findall("joint"):
        name = joint.get("name")
        parent, child = (end_of(joint, e) for e in ("parent", "child"))
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                reason = f"its {end} link {link!r} does not exist"
                raise BadRobot(str(path), f"joint {name}", reason, _CORRECT)
        if child in above:
            reason = f"its child link {child} already has the parent {above[child]}"
            remedy = "A robot is a tree: leave out one of the two joints."
            raise BadRobot(str(path), f"joint {name}", reason, remedy)
        above[child] = parent
    for link in links:
        passed = [link]
        while passed[-1] in above:
            passed.append(above[passed[-1]])
            if passed[-1] == link:
                loop = " → ".join(reversed(passed))
                remedy = "A robot is a tree: leave out the joint that closes the loop."
                raise BadRobot(str(path), f"link {link}", f"links form a loop, {loop}", remedy)
            if len(passed) > len(links):
                break  # a loop above: reported at one of its own links
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        reason = f"the links {' and '.join(roots[:2])} both have no parent"
        raise BadRobot(str(path), "", reason, "Connect them by a joint, or leave one out.")


def _check_joint(path: Path, joint: Element) -> None:
    """Checks the numbers of a joint, and that its range is not empty."""
    part = f"joint {joint.get('name')}"
    kind = joint.get("type")
    limit = joint.find("limit")
    if kind not in _KINDS:
        remedy = f"It is one of {', '.join(_KINDS)}."
        raise BadRobot(str(path), part, f"its type is {kind!r}", remedy)
    _check_vector(path, part, joint.find("axis"), "xyz")
    for key in ("xyz", "rpy"):
        _check_vector(path, part, joint.find("origin"), key)
    if kind == "fixed":
        return
    axis = joint.find("axis")
    mimic = joint.find("mimic")
    direction = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    if kind != "floating" and not np.any([float(x) for x in direction.split()]):
        raise BadRobot(str(path), part, "its axis is 0 0 0", "Give the axis a direction.")
    for key in ("multiplier", "offset"):
        if mimic is not None and not np.isfinite(number(mimic.get(key, "0"))):
            reason = f'its <mimic {key}="{mimic.get(key)}"> is not a number'
            raise BadRobot(str(path), part, reason, _CORRECT)
    if limit is None:
        if kind in _RANGED:
            remedy = "Add <limit lower= upper= effort= velocity=/>, or make it continuous."
            raise BadRobot(str(path), part, "it has no <limit>", remedy)
        return
    for key, text in limit.attrib.items():
        if key in ("lower", "upper", "effort", "velocity") and not np.isfinite(number(text)):
            remedy = "Write a number; a joint without end stops is of the type continuous."
            raise BadRobot(str(path), part, f"its limit {key} is {text!r}", remedy)
    low, high = (number(limit.get(key, "0")) for key in ("lower", "upper"))
    if kind in _RANGED and low > high:
        reason = f"its lower limit {low:g} is above its upper limit {high:g}"
        raise BadRobot(str(path), part, reason, "Exchange the two.")


def check_masses(path: Path, root: Element) -> None:
    """Checks that every `<inertial>` can be read, even of links that do not move.

    Raises:
        BadRobot: names the first link whose mass or inertia is not a number, or negative.
    """
    for link, inertial in inertials(root):
        part = f"link {link.get('name')}"
        element = inertial.find("inertia")
        mass = mass_of(path, link, inertial)
        about = inertia_of(inertial)
        if mass < 0:
            remedy = "Give it a mass ≥ 0."
            raise BadRobot(str(path), part, f"its mass is {mass:g} kg", remedy)
        if not (np.abs(about) <= LARGEST).all():
            reason = "it has no <inertia>"
            if element is not None:
                bad = [key for key, place in ENTRIES.items() if not abs(about[place]) <= LARGEST]
                wrong = ", ".join(f"{key}={element.get(key, '')!r}" for key in bad)
                reason = f"its inertia has {wrong}"
            remedy = "Write numbers of kg·m², with a decimal point."
            raise BadRobot(str(path), part, reason, remedy)
        if (np.diag(about) < 0).any():
            reason = f"its moments of inertia are {', '.join(f'{x:g}' for x in np.diag(about))}"
            raise BadRobot(str(path), part, f"{reason} kg·m²", "None may be negative.")


def inertials(root: Element) -> Iterator[tuple[Element, Element]]:
    """The links that have an `<inertial>`, and that element."""
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            yield link, inertial


def mass_of(path: Path, link: Element, inertial: Element) -> float:
    """The mass of an `<inertial>` [kg]; its `<origin>` is checked as well.

    Raises:
        BadRobot: the mass is missing, not a number, or beyond all bounds.
    """
    part = f"link {link.get('name', '')}"
    mass = inertial.find("mass")
    value = "" if mass is None else mass.get("value", "")
    kilograms = number(value)
    if not abs(kilograms) <= LARGEST:
        remedy = 'Write a number of kilograms, <mass value="1.5"/>.'
        raise BadRobot(str(path), part, f"its mass is {value!r}", remedy)
    for key in ("xyz", "rpy"):
        _check_vector(path, part, inertial.find("origin"), key)
    return kilograms


def inertia_of(inertial: Element) -> Array:
    """(3, 3) the inertia of an `<inertial>`, in its own axes [kg·m²]; NaN where unreadable."""
    element = inertial.find("inertia")
    about = np.full((3, 3), np.nan)
    if element is not None:
        for key, (i, j) in ENTRIES.items():
            about[i, j] = about[j, i] = number(element.get(key, "nan" if i == j else "0"))
    return about


def _check_vector(path: Path, part: str, element: Element | None, key: str) -> None:
    """Checks that an attribute is three numbers, if it is there."""
    text = None if element is None else element.get(key)
    if element is None or text is None:
        return
    numbers = [number(word) for word in text.split()]
    if len(numbers) != 3 or not np.all(np.abs(numbers) <= LARGEST):
        reason = f'its <{element.tag} {key}="{text}"> is not three numbers'
        raise BadRobot(str(path), part, reason, _CORRECT)


def end_of(joint: Element, end: str) -> str:
    """The name of a joint's `parent` or `child` link."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def number(text: str) -> float:
    """The number in a text; NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def warn_of_mimics(path: Path, root: Element) -> None:
    """Warns of mimic joints, which are simulated as independent joints.

    Packed robots, whose joints are known, cause no warning.
    """
    names = [j.get("name", "") for j in _moving(root) if j.find("mimic") is not None]
    if names and path not in packed_robots().values():
        warnings.warn(MimicIgnored(str(path), names), stacklevel=2)


def passive_joints(root: Element) -> list[str]:
    """Joints of effort 0, unless all have effort 0: many files state none."""
    limits = {joint.get("name", ""): joint.find("limit") for joint in _moving(root)}
    efforts = {name: number(x.get("effort", "")) for name, x in limits.items() if x is not None}
    passive = [name for name, effort in efforts.items() if effort == 0.0]
    return passive if len(passive) < len(efforts) else []


def _moving(root: Element) -> list[Element]:
    """The joints that are not fixed."""
    return [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]


def check_inertials(path: Path, root: Element) -> list[Finding]:
    """Moves the inertias of a URDF inside the cone of physical ones, in place.

    An `<inertial>` without mass is left out; a moving link without any mass is found later, when
    welded links are merged. Returns a warning for each inertial of a moving link that was changed
    or left out.

    Raises:
        BadRobot: a mass is missing or not a number.
    """
    findings = []
    base = _base(root)
    for link, inertial in inertials(root):
        name = link.get("name", "")
        mass = mass_of(path, link, inertial)
        about = inertia_of(inertial)
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
