"""MJCF files as text: read with or without their meshes, their inertias checked, and edited.

Poses stay as written. If a locked joint is not at its initial position, everything it carries is
moved into a body with its displacement.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from lxml import etree
from lxml.etree import SubElement
from lxml.etree import _Element as Node

from ..base import LARGEST, Finding, InputFile, pin
from ..core import Array
from .errors import BadRobot
from .inertias import moved, moved_inside, plausible_size
from .silence import quiet
from .tree import body_name, wxyz
from .xml import check_named_files, numbers, read_xml

_REMEDY = "Correct the file; MuJoCo's `simulate` must be able to load it."
_UNDRAWN = (
    "these geoms are not drawn; masses must come from <inertial>",
    "Put the files where the MJCF expects them, to see them.",
)


def compile_file(path: Path) -> tuple[Any, Any, list[Finding]]:
    """Compiles an MJCF or .mjb file.

    Missing mesh and texture files are left out, and inertias that MuJoCo would reject are moved
    inside the cone of physical ones. Returns MuJoCo's specification (None for .mjb), the compiled
    model, and findings about changes and what MuJoCo warns of.

    Raises:
        BadRobot: MuJoCo rejects the file, or accepts a number that no robot has.
    """
    with quiet() as heard:
        spec, mj, findings = _compiled(path)
    for words in heard:
        if "NaN" in words:  # such as in a keyframe
            raise BadRobot(str(path), "", "a number in it is NaN", "Write finite numbers.")
        findings.append(Finding("note", "mujoco", path.name, f"MuJoCo warns: {words.strip()}"))
    return spec, mj, findings


def _compiled(path: Path) -> tuple[Any, Any, list[Finding]]:
    """Carries out `compile_file`, during which MuJoCo may warn."""
    try:
        if path.suffix.lower() == ".mjb":
            InputFile(path).check()
            mj = mujoco.MjModel.from_binary_path(str(path))
            check_numbers(str(path), mj)
            return None, mj, []
        check_named_files(path)
        spec = mujoco.MjSpec.from_file(str(path))
        missing = _without_missing_files(spec, path.parent)
        findings = [
            *Finding.missing_files(path, "mesh or texture", missing, *_UNDRAWN),
            *check_inertials(spec),
            *_bounded(spec, path),
        ]
        mj = spec.compile()
        mj.names.decode()
        check_numbers(str(path), mj)
        return spec, mj, findings
    except UnicodeDecodeError as error:
        raise BadRobot(str(path), "", f"it is not UTF-8: {error}", "Save it as UTF-8.") from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadRobot(str(path), "", reason, "Give a readable, regular file.") from error
    except (ValueError, RuntimeError) as error:
        raise BadRobot(str(path), "", f"MuJoCo rejects it: {error}", _REMEDY) from error


_NUMBERS = {
    "body": ("mass", "inertia", "ipos", "iquat", "pos", "quat"),
    "jnt": ("pos", "axis", "stiffness"),
    "dof": ("damping", "frictionloss", "armature"),
    "actuator": ("gear", "gainprm", "biasprm", "damping", "armature"),
}
_RANGES = {"jnt": ("range", "actfrcrange"), "actuator": ("ctrlrange", "forcerange")}
_WORDS = {
    "ipos": "centre of mass",
    "iquat": "orientation of its inertia",
    "pos": "place",
    "quat": "orientation",
    "frictionloss": "friction",
    "gainprm": "gain",
    "biasprm": "bias",
    "actfrcrange": "range of forces",
    "ctrlrange": "range of commands",
    "forcerange": "range of forces",
}  # for messages, where the field's name is not a word


def check_numbers(robot: str, mj: Any) -> None:
    """Checks that a compiled model's numbers are within bounds; ends of ranges may be infinite.

    MuJoCo accepts some that are infinite or NaN.

    Raises:
        BadRobot: names the body, joint or actuator of a number that is not.
    """
    if not (np.abs(mj.opt.gravity) <= LARGEST).all():
        raise _bad(robot, "", "gravity", mj.opt.gravity)
    for table, largest in ((_NUMBERS, LARGEST), (_RANGES, np.inf)):
        for kind, field in [(kind, field) for kind, fields in table.items() for field in fields]:
            for i, row in enumerate(getattr(mj, f"{kind}_{field}")):
                if not (np.abs(row) <= largest).all():
                    raise _bad(robot, _part(mj, kind, i), field, row)


def _part(mj: Any, kind: str, i: int) -> str:
    """The name of a body, joint or actuator, or its number."""
    if kind == "body":
        return f"body {body_name(mj, i)}"
    if kind == "actuator":
        return f"actuator {mj.actuator(i).name or i + 1}"
    j = mj.dof_jntid[i] if kind == "dof" else i
    return f"joint {mj.joint(j).name or j + 1}"


def _bad(robot: str, part: str, field: str, row: Any) -> BadRobot:
    values = " ".join(f"{x:g}" for x in np.ravel(row))
    reason = f"its {_WORDS.get(field, field)} is {values}"
    return BadRobot(robot, part, reason, f"Write numbers of at most {LARGEST:g} in size.")


_PIXELS = 2**26
"""Most pixels of a texture: MuJoCo takes three bytes or more for each, used or not."""
_USER = 1000
"""Most numbers of a user's own for each body, joint and so on."""


def _bounded(spec: Any, path: Path) -> list[Finding]:
    """Removes textures of more than `_PIXELS` from a specification that is to be compiled.

    Raises:
        BadRobot: it asks for more than `_USER` numbers of a user's own.
    """
    for key in (name for name in dir(spec) if name.startswith("nuser_")):
        count = getattr(spec, key)
        if count > _USER:
            remedy = f"Give at most {_USER} in <size>."
            raise BadRobot(str(path), "", f"its {key} is {count}", remedy)
    large = []
    for texture in list(spec.textures):
        if _pixels(texture, path.parent / spec.texturedir) > _PIXELS:
            large.append(texture.name or texture.file)
            _without_texture(spec, texture)
    if not large:
        return []
    text = f"textures of more than {_PIXELS / 1e6:.0f} million pixels are left out: "
    return [Finding("note", "large_texture", path.name, text + ", ".join(large))]


def _pixels(texture: Any, folder: Path) -> int:
    """Pixels of a texture: of a PNG file as its header states them."""
    if not texture.file:
        return texture.width * (texture.height or 6 * texture.width)
    with (folder / texture.file).open("rb") as stream:
        head = stream.read(24)
    if head[:8] != b"\x89PNG\r\n\x1a\n" or len(head) < 24:
        return 0
    return int.from_bytes(head[16:20], "big") * int.from_bytes(head[20:24], "big")


def _without_texture(spec: Any, texture: Any) -> None:
    """Removes a texture, and its name from the materials."""
    for material in spec.materials:
        material.textures = ["" if t == texture.name else t for t in material.textures]
    spec.delete(texture)


def _without_missing_files(spec: Any, folder: Path) -> list[str]:
    """Removes meshes and textures whose files are missing; returns the names of these files."""
    missing = []
    for mesh in list(spec.meshes):
        if mesh.file and not _exists(mesh.file, folder, spec.meshdir):
            missing.append(mesh.file)
            name = mesh.name or Path(mesh.file).stem
            for geom in [g for g in spec.geoms if g.meshname == name]:
                spec.delete(geom)
            spec.delete(mesh)
    for texture in list(spec.textures):
        files = [file for file in [texture.file, *texture.cubefiles] if file]
        gone = [file for file in files if not _exists(file, folder, spec.texturedir)]
        if gone:
            missing += gone
            _without_texture(spec, texture)
    return missing


def _exists(file: str, folder: Path, inside: str) -> bool:
    return any(os.path.isfile(folder / part / file) for part in (inside, ""))


def own_file(path: Path, spec: Any, mj: Any, findings: list[Finding]) -> tuple[Node, bool]:
    """The content of an MJCF file for editing, with included files in their places.

    Meshes and textures of files that `findings` name as missing are removed. Returns the root, and
    whether it is the file's own. If elements stand for several bodies, as `<replicate>` and
    `<attach>` do, it is MuJoCo's output, with six digits.
    """
    root, _ = read_xml(path)
    while (include := next(root.iter("include"), None)) is not None:
        parent = include.getparent()
        assert parent is not None  # the root is <mujoco>
        at = parent.index(include)
        parent[at : at + 1] = list(read_xml(path.parent / include.get("file", ""))[0])
    for finding in findings:
        if finding.code == "mesh_missing":
            _without_files(root, finding.data["files"])  # type: ignore[arg-type]  # a list
    own = [joint.get("name", "") for joint in joints_of_file(root)]
    exact = (
        own == [mj.joint(j).name for j in range(mj.njnt)]
        and len(bodies_of_file(root)) == mj.nbody - 1
        and len(actuators_of_file(root)) == mj.nu
    )
    return (root, True) if exact else (etree.fromstring(spec.to_xml()), False)


def _without_files(root: Node, missing: list[str]) -> None:
    """Removes meshes and textures of some files, and elements that show them."""
    for asset in [e for e in root.iter("mesh", "texture") if set(e.attrib.values()) & set(missing)]:
        name = asset.get("name") or Path(asset.get("file", "")).stem
        if asset.tag == "texture":
            for material in root.iter("material"):
                if material.get("texture") == name:
                    del material.attrib["texture"]
        else:
            for geom in [g for g in root.iter("geom") if g.get("mesh") == name]:
                _remove(geom)
        _remove(asset)


_ROWS = [0, 1, 2, 0, 0, 1]  # places of MuJoCo's fullinertia
_COLUMNS = [0, 1, 2, 1, 2, 2]


def check_inertials(spec: Any) -> list[Finding]:
    """Moves explicit inertias inside the cone of physical ones, in place; warns of each."""
    findings = []
    for body in spec.bodies:
        full = np.isfinite(body.fullinertia).all()
        about = np.diag(body.inertia)
        if full:
            about[_ROWS, _COLUMNS] = about[_COLUMNS, _ROWS] = body.fullinertia
        if not (body.explicitinertial and body.mass > 0 and _rejected(body, about)):
            continue
        children = [child.pos for child in body.bodies]
        size = plausible_size(float(np.linalg.norm(place)) for place in [body.ipos, *children])
        changed = moved_inside(body.mass, about, size)
        findings.append(moved(body.name, (body.mass, about), (body.mass, changed)))
        if full:
            body.fullinertia = changed[_ROWS, _COLUMNS]
        else:
            body.inertia = changed.diagonal()
    return findings


def _rejected(body: Any, about: Array) -> bool:
    """Whether MuJoCo rejects a body's inertia (3, 3) about its centre of mass."""
    if not (np.abs([body.mass, *about.flat]) <= LARGEST).all():
        return False  # `check_numbers` refuses those of these that MuJoCo accepts
    low, middle, high = np.linalg.eigvalsh(about)
    return low < 0 or low + middle < high or (low <= 0 and len(body.joints) > 0)


_JOINTS = ("joint", "freejoint")
_NAMING = ("joint", "jointinparent", "joint1", "joint2")  # attributes that hold a joint's name
_REFERENCES = (*_NAMING, "tendon", "tendon1", "tendon2", "actuator")
_OF_CONTENT = ("name", "gravcomp", "user", "sleep")  # attributes that belong to a body's content


def bodies_of_file(root: Node) -> list[Node]:
    """All bodies in MuJoCo's order."""
    return [body for world in root.findall("worldbody") for body in world.iter("body")]


def joints_of_file(root: Node) -> list[Node]:
    """All joints in MuJoCo's order: a body's own come before those of its children."""
    return [joint for body in bodies_of_file(root) for joint in own_joints(body)]


def actuators_of_file(root: Node) -> list[Node]:
    """All actuators in MuJoCo's order."""
    return [part for section in root.findall("actuator") for part in section.iterchildren("*")]


def relocate(root: Node, spec: Any, source: Path, folder: Path) -> None:
    """Makes the folders of a file's meshes and textures relative to another folder, in place."""
    if root.find("compiler") is None:
        root.insert(0, etree.Element("compiler"))
    for compiler in root.iter("compiler"):
        for key in ("meshdir", "texturedir", "assetdir"):
            compiler.attrib.pop(key, None)
    for key in ("meshdir", "texturedir"):
        place = source.resolve().parent / getattr(spec, key)
        try:
            seen = Path(os.path.relpath(place, folder))
        except ValueError:  # on another drive of Windows
            seen = place
        next(root.iter("compiler")).set(key, seen.as_posix())


def own_joints(body: Node) -> list[Node]:
    """The joints of one body, those in its frames included."""
    return [j for j in body.iter(*_JOINTS) if next(j.iterancestors("body")) is body]


def name_joints(root: Node, mj: Any, names: list[str]) -> None:
    """Names all joints, in MuJoCo's order, in place, also where others refer to them."""
    for joint, name in zip(joints_of_file(root), names, strict=True):
        joint.set("name", name)
    renamed = {mj.joint(j).name: name for j, name in enumerate(names) if mj.joint(j).name != name}
    for element in root.iter("*"):
        keys = [*_NAMING, *(["objname"] if element.get("objtype") == "joint" else [])]
        for key in filter(element.attrib.has_key, keys):
            element.set(key, renamed.get(element.get(key), element.get(key)))


def split_bodies(root: Node, mj: Any, held: Mapping[str, float]) -> dict[str, Node]:
    """Removes locked joints, in place, and splits bodies of several joints into chains of bodies.

    The last body of a chain keeps name and content. All joints must have names. `held` has the
    position of each locked joint [rad or m]; it has no meaning for balls and free joints. Returns
    the body behind each joint that is left.
    """
    found = {}
    j = 0
    for body in bodies_of_file(root):
        here = pin.SE3.Identity()
        steps = []
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
    """Replaces a body by a chain of bodies, one for each step; returns the body behind each joint.

    A step is the pose of a body in the previous one, and its joint, if it has one. A body with one
    joint stays alone, where it is drawn.
    """
    joints = [joint for _, joint in steps if joint is not None]
    alone = len(steps) < 2 and all(place.isIdentity(0.0) for place, _ in steps)
    if alone:
        return {joint.get("name", ""): body for joint in joints}
    name = body.get("name", "body")
    current = body
    found = {}
    content = [part for part in body if part not in joints and part.tag != "inertial"]
    for old in body.findall("inertial"):  # to be replaced
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
    """The displacement of a body by its joint at a position."""
    axis = mj.jnt_axis[j]
    anchor = mj.jnt_pos[j]
    kind = mujoco.mjtJoint(mj.jnt_type[j])
    travel = position - mj.qpos0[mj.jnt_qposadr[j]]
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.SE3(np.eye(3), travel * axis)
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        turn = pin.exp3(travel * axis)
        return pin.SE3(turn, anchor - turn @ anchor)
    return pin.SE3.Identity()


def remove_references(
    root: Node, gone: set[str], keys: Collection[str] = _REFERENCES, named: str = ""
) -> None:
    """Removes actuators, tendons, constraints and sensors that refer to the names in `gone`.

    `keys` are the referring attributes; elements of the section `named` refer by their own names.
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
    parent = element.getparent()
    before = element.getprevious()
    tail = element.tail
    assert parent is not None  # no root is removed
    if tail and before is not None:
        before.tail = (before.tail or "") + tail
    elif tail:
        parent.text = (parent.text or "") + tail
    parent.remove(element)
