"""Loads a tree of joints from a URDF or MJCF file, or by name; the only entry point."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

from ..errors import BadRobot, UnknownName
from ..resources import (
    MORE_ROBOTS,
    asset,
    example_robots,
    folder,
    has_example_robots,
    known_robots,
    packed_robots,
    path_of,
)
from .findings import Finding
from .mjcf import load_mjcf
from .model import RobotModel
from .urdf import load_urdf
from .xml import read_xml

Base = Literal["held", "free"]
"""Whether a floating base is fixed to a stand or free."""

REMEDY = "Give the path of a file ending in .urdf, .xml or .mjb (MJCF), or a vehicle's .toml."
_CUT_IN_CODE = "talos_legs"  # the only one whose loader removes joints in its file


class RobotFile(NamedTuple):
    """The file that describes a robot."""

    path: Path  # path of its URDF or MJCF
    named: bool = False  # whether it was given by a name
    floats: bool = False  # whether its base floats although its file does not state it


def load_robot(name: str, base: Base = "held") -> RobotModel:
    """Reads a robot to simulate; errors in its file are raised, not corrected.

    Joints that follow others (`<mimic>`) get coordinates of their own, and a warning.

    Args:
        name: a robot, packed or of example-robot-data, or the path of a URDF or MJCF file.
        base: whether a floating base is held or free. With `free`, a URDF file's root floats.

    Raises:
        MissingPackage: Pinocchio is not installed.
        UnknownName: there is no robot of this name; near matches are listed.
        BadRobot: it cannot be read, has a joint of several degrees of freedom or a link of
            physically impossible inertia, or its base cannot float.
    """
    file = robot_file(name)
    if base == "free" and file.named and not file.floats:
        raise BadRobot(name, "", "its base is fixed", "Use ArmPlant, or a robot that floats.")
    found = _read(file.path, (), None, base)
    return replace(found, name=name, source=None if file.named else found.source)


def load_tree(
    name: str,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    others: Sequence[str] = (),
) -> RobotModel:
    """Reads a robot to identify: unphysical inertias are moved inside the cone, and reported.

    Args:
        name: a robot, packed or of example-robot-data, or the path of a URDF or MJCF file.
        lock: joints to fix, at 0 or at the nearest limit.
        joints: joints to keep; None keeps all that are not in `lock`.
        others: further names to suggest.

    Raises:
        BadRobot: the file cannot be read, or describes a robot that is not a tree of revolute and
            prismatic joints.
        InvalidInput: a joint is to be both locked and kept.
        UnknownName: there is no such robot or joint; the message lists similar names.
    """
    file = robot_file(name, others)
    found = _read(file.path, lock, joints)
    if not file.named:
        return found
    findings = found.findings
    if file.floats:
        text = "its base can move; it was taken as fixed to a stand, level"
        remedy = "Use logs of the robot on a stand."
        findings += (Finding("warning", "base_held", name, text, remedy),)
    return replace(found, name=name, source=None, findings=findings)


def robot_file(name: str, others: Sequence[str] = ()) -> RobotFile:
    """The file that describes a robot, by its path or name; `others` are further names to suggest.

    Raises:
        BadRobot: there is no such file, or no file describes the robot of this name.
        UnknownName: there is no robot of this name.
    """
    path, packed = path_of(name), {**packed_robots(), **packed_folders()}
    if name in packed:
        return RobotFile(packed[name], named=True)
    if path.is_dir() and name not in example_robots():  # a folder hides no robot of its name
        reason = "no such file, but a folder without a vehicle.toml"
        raise BadRobot(name or ".", "", reason, REMEDY)
    if path.is_file():
        return RobotFile(path)
    if path.suffix or path.name != name:
        raise BadRobot(name, "", "no such file", REMEDY)
    if name not in example_robots():
        remedy = REMEDY if has_example_robots() else f"{REMEDY} {MORE_ROBOTS}"
        raise UnknownName("robot", name, [*known_robots(), *packed_folders(), *others], remedy)
    from example_robot_data.robots_loader import getModelPath

    loader = example_robots()[name]
    file = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    if file.suffix != ".urdf" or name == _CUT_IN_CODE:
        reason = "example-robot-data has no URDF file of it"
        raise BadRobot(name, "", reason, "Choose another robot.")
    return RobotFile(Path(getModelPath(str(file))) / file, True, bool(loader.free_flyer))


def packed_folders() -> dict[str, Path]:
    """The robots in assets, each described by a URDF or MJCF of its folder's name."""
    names = sorted(path.name for path in folder("assets").iterdir())
    files = [(name, asset(name, name + end)) for name in names for end in (".urdf", ".xml")]
    return {name: file for name, file in files if file.is_file()}


def _read(
    path: Path, lock: Sequence[str], joints: Sequence[str] | None, base: Base | None = None
) -> RobotModel:
    """Reads a file by its content: a URDF may be called .xml. `base` is None to identify."""
    if path.suffix.lower() == ".xacro":
        remedy = f"Convert it first: `xacro {path.name} > {path.stem}.urdf`."
        raise BadRobot(str(path), "", "it is a xacro template, not a URDF", remedy)
    if path.suffix.lower() == ".mjb":
        return load_mjcf(path, lock, joints, base)
    root, encoding = read_xml(path)
    if root.tag == "robot":
        return load_urdf(path, root, encoding, lock, joints, base)
    if root.tag == "mujoco":
        return load_mjcf(path, lock, joints, base)
    reason = f"its root element is <{root.tag}>, neither <robot> nor <mujoco>"
    raise BadRobot(str(path), "", reason, REMEDY)
